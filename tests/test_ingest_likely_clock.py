"""Which of several clocks in one recording is taken, when none is, and what the user is asked."""

import json

import numpy as np
import pytest
import scipy.io
import yaml
from test_ingest_tdms_log import write

from osl_analysis.commands.inspect import inspect_file, overview_text
from osl_analysis.commands.new_campaign import draft_campaign, left_to_decide, new_campaign
from osl_analysis.ingest.draft import draft_source
from osl_analysis.ingest.overview import likely_clock, open_places

TIME = np.arange(50) * 0.004
SIGNALS = {"ankle_angle_deg": np.sin(TIME), "torque_Nm": np.cos(TIME)}
STEPS = 0.004 - 1e-5 * np.cos(np.arange(50))


def as_csv(path, columns):
    rows = zip(*columns.values(), strict=True)
    path.write_text("\n".join([",".join(columns), *(",".join(map(repr, map(float, row))) for row in rows)]))


def as_json(path, columns):
    path.write_text(
        "\n".join(json.dumps(dict(zip(columns, row, strict=True))) for row in zip(*columns.values(), strict=True))
    )


def as_mat(path, columns):
    scipy.io.savemat(path, columns)


def as_opensim(path, columns):
    head = f"joint\nversion=1\nnRows={len(TIME)}\nnColumns={len(columns)}\ninDegrees=yes\nendheader\n"
    rows = zip(*columns.values(), strict=True)
    path.write_text(
        head + "\n".join(["\t".join(columns), *("\t".join(map(repr, map(float, row))) for row in rows)]) + "\n"
    )


WRITERS = {"a.csv": as_csv, "a.jsonl": as_json, "a.mat": as_mat, "a.sto": as_opensim}


def drafted(folder, name, **clocks):
    """The overview of a file with these clocks, and the `time` of the draft."""
    WRITERS[name](folder / name, {**clocks, **SIGNALS})
    overview = inspect_file(folder / name)
    return overview, yaml.safe_load(draft_source(overview, name))["time"]


@pytest.mark.parametrize("name", WRITERS)
def test_of_two_clocks_that_agree_the_first_is_taken_and_the_user_is_asked(tmp_path, name):
    overview, time = drafted(tmp_path, name, loop_time=TIME, sys_time=1e3 * TIME + 5.0)
    assert "loop_time" in time.values()
    (asked,) = overview.open
    assert "2 " in asked
    assert "may be the clock, to be checked: loop_time, sys_time; loop_time is taken" in asked
    assert f"! {asked}" in overview_text(overview)
    assert f"# {asked}\n" in draft_source(overview, name)


@pytest.mark.parametrize("name", WRITERS)
def test_of_two_clocks_that_contradict_each_other_none_is_taken(tmp_path, name):
    """Taken by a clock that is 10 % slow, B would be 10 % and I 21 % off, at a VAF of 100 %."""
    overview, time = drafted(tmp_path, name, loop_time=1.1 * TIME, sys_time=TIME)
    assert list(open_places({"time": time}))
    (asked,) = overview.open
    assert "contradict each other: loop_time spans 0.2156, sys_time spans 0.196; name the one" in asked


@pytest.mark.parametrize("name", WRITERS)
def test_the_duration_of_each_loop_is_no_clock_beside_one(tmp_path, name):
    overview, time = drafted(tmp_path, name, loop_time=STEPS, sys_time=TIME)
    assert "sys_time" in time.values()
    assert not overview.open


def test_a_clock_of_tdms_is_taken_by_the_same_rule(tmp_path):
    for wrong, found in ((1.0, "Bench/loop_time"), (1.1, "NAME_OF_TIME")):
        columns = {"loop_time": wrong * TIME, "sys_time": TIME, **SIGNALS}
        overview = inspect_file(
            write(tmp_path / f"{wrong}.tdms", [(name, values, {}) for name, values in columns.items()])
        )
        assert overview.settings["time"]["channel"] == found
        assert len(overview.open) == 1


@pytest.mark.parametrize(
    ("factor", "taken"), [(1.004, "a"), (0.996, "a"), (1.006, None), (1e9 * 0.997, "a"), (60.0, None)]
)
def test_clocks_agree_within_half_a_percent_in_any_unit_of_seconds(factor, taken):
    assert likely_clock({"a": TIME, "b": factor * TIME})[0] == taken
    assert likely_clock({"a": TIME, "b": factor * TIME, "c": TIME})[0] == taken


def test_readings_that_are_missing_do_not_count():
    holes = np.where(np.arange(50) % 7 == 0, np.nan, TIME)
    assert likely_clock({"a": TIME, "b": 1e3 * holes})[0] == "a"
    assert likely_clock({"a": np.full(50, np.nan), "b": TIME}) == ("b", [])
    assert likely_clock({"a": np.empty(0), "b": np.zeros(3)})[0] == "a"
    assert likely_clock({}) == (None, [])


def test_only_a_file_with_several_trials_is_said_to_hold_them(tmp_path):
    one = {"time": TIME, **SIGNALS}
    as_mat(tmp_path / "single.mat", one)
    as_mat(tmp_path / "several.mat", {"run1": one, "run2": one})
    new_campaign(tmp_path / "mine", recordings=tmp_path)
    lines = left_to_decide(tmp_path / "mine", draft_campaign(tmp_path))
    said = [line for line in lines if "log_part" in line]
    assert said == [
        "2 parts hold the same variables: name one per trial in the column `log_part` of the sheet: run1, run2 "
        "(several.mat)"
    ]
