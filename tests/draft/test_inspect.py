# SPDX-License-Identifier: Apache-2.0
"""Inspect and watch: what files hold is listed, drafts become source files, recordings are examined
as they come."""

import re

import numpy as np
import pytest
import yaml
from c3d_builder import write_c3d
from command_line import call
from log_builders import write_text
from mcap_builder import HEADER, stamped, write_log

from osl_analysis.base.units import is_clock
from osl_analysis.commands import trials as module
from osl_analysis.draft.draft_source import draft_source
from osl_analysis.draft.overview import choose_clock
from osl_analysis.draft.recorded_channel import RecordedChannel
from osl_analysis.ingest.raw_files import read_converted, read_source

NASTY = 'a\x1b[2J": {x\n# y\u202eb'
LATIN = NASTY.replace("\u202e", "\x9b")
JOINTS = (
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] effort\nfloat32[3]"
    " bias\nstring note\n"
)


def joint_log(path, topic="/joints", **options):
    """The angles of a knee and an ankle at 100 Hz, with a gap after 0.2 s."""
    log = []
    known = {"name": ["knee", "left ankle"], "effort": [], "bias": [1.0, 2.0, 3.0], "note": "x"}
    for i in range(50):
        log.append(
            stamped(
                i * 10_000_000 + (500_000_000 if i > 20 else 0),
                **known,
                position=[0.1 * i, 0.2 * i],
            )
        )
    return write_log(path, log, JOINTS + HEADER, "sensor_msgs/msg/JointState", topic, **options)


def test_messages_are_listed_by_field_with_rate_and_gaps(
    tmp_path,
):
    path = joint_log(tmp_path / "a.mcap", chunk_size=1000)
    overview = module.inspect_file(path)
    assert {one.address["field"]: one.likely_unit for one in overview.channels} == {
        **dict.fromkeys(["position[name=knee]", "position[name=left ankle]"], "rad"),
        "bias[0]": "",
    }
    assert re.search(r"100 Hz.* 1 .*0\.510 s", module.overview_text(overview))
    draft = draft_source(overview, "a.mcap")
    assert "effort" not in draft
    kept = [line for line in draft.splitlines() if "NAME_" not in line or "NAME_2" in line]
    (tmp_path / "a.yaml").write_text(
        "\n".join(kept).replace("NAME_2", "theta").replace("UNKNOWN", "rad")
    )
    theta = read_converted(path, read_source(tmp_path / "a.yaml")).samples["theta"]
    np.testing.assert_array_equal(theta, 0.2 * np.arange(50))


BENCH = (
    "# rig: B\ntime [ms],angle [deg],state\n0,1.5,ok\n10,2.5,ok\n20,3.5,ERROR\n90,4.5,ok\n100,4\n"
)


@pytest.mark.parametrize("kind", ["mcap", "c3d", "csv"])
def test_nothing_of_a_file_reaches_the_terminal_raw_or_leaves_its_quotes(tmp_path, kind):
    path = tmp_path / f"a.{kind}"
    if kind == "mcap":
        joint_log(path, NASTY)
    elif kind == "c3d":
        write_c3d(
            path, np.ones((4, 1, 4)), np.ones((4, 1)), POINT__LABELS=[LATIN], ANALOG__UNITS=[LATIN]
        )
    else:
        nasty = NASTY.replace("\n", "").replace('"', "'")
        table = f"# {nasty}\nt,{nasty} [{nasty}]\n0,{nasty}\n"
        path.write_text(table)
    result = call("inspect", path)
    assert result.exit_code == 0, result.output
    assert all(line.isprintable() for line in result.output.split("\n"))
    drafted = result.output.rpartition("\nformat:")[2]
    assert isinstance(yaml.safe_load(f"format:{drafted}"), dict)


def test_the_draft_is_written_where_it_is_asked_for_and_never_over_a_file(tmp_path):
    (tmp_path / "a.csv").write_text(BENCH)
    arguments = ("inspect", tmp_path / "a.csv", "--draft", tmp_path / "a.yaml")
    assert call(*arguments).exit_code == 0
    assert (tmp_path / "a.yaml").read_text().startswith('format: "csv"\n')
    assert "a.yaml" in call(*arguments).output


TIME = np.arange(50) * 0.004


def test_of_two_clocks_that_agree_the_first_is_taken_and_the_user_is_asked(tmp_path):
    path = tmp_path / "a.csv"
    write_text(
        path,
        {
            "loop_time": TIME,
            "sys_time": TIME,
            "ankle_angle_deg": np.sin(TIME),
            "torque_Nm": np.cos(TIME),
        },
    )
    overview = module.inspect_file(path)
    time = yaml.safe_load(draft_source(overview, path.name))["time"]
    assert time["column"] == "loop_time"
    (message,) = overview.open
    assert re.search("loop_time.*sys_time.*loop_time", message)
    assert f"# {message}\n" in draft_source(overview, "a")


def clocks(**readings):
    """Columns of a table, as clocks."""
    return [
        RecordedChannel("column", {"column": name}, numbers=numbers, name=name, count=len(numbers))
        for name, numbers in readings.items()
    ]


@pytest.mark.parametrize(
    ("factor", "taken"), [(1.004, "t"), (0.996, "t"), (1.006, ""), (0.997e9, "t"), (60, "")]
)
def test_clocks_agree_within_half_a_percent_in_any_unit_of_seconds(factor, taken):
    for channels in (
        clocks(t=TIME, time=factor * TIME),
        clocks(t=TIME, time=factor * TIME, stamp=TIME),
    ):
        clock, _ = choose_clock(channels)
        assert (clock.name if clock else "") == taken


def test_what_goes_back_is_no_clock_beside_another():
    channels = clocks(t=TIME - 0.02 * (np.arange(50) % 5 == 0), time=TIME)

    assert choose_clock(channels) == (channels[1], "")


def test_names_tell_clocks():
    clocks = (
        "time T timestamp stamp state_time loop_time pi_time sys_time ROS_time elapsed_time elapsed"
        " clock seconds __time time_since_start t_us t_ns time_ms Time_sec t_s stance_time t0"
        " time_to_peak times theta t_m"
    )
    assert [is_clock(name) for name in clocks.split()] == [True] * 20 + [False] * 6


pytestmark = pytest.mark.usefixtures("in_root", "schemas_made_once")
