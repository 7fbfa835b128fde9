"""Inspect and watch: what files hold is listed, drafts become source files, recordings are examined
as they come."""

import json
import os
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
import pytest
import yaml
from any_motion import TRUE, made_trial, noise
from c3d_builder import REAL_DATA, write_c3d
from click.testing import CliRunner
from mcap_builder import HEADER, stamped, write_log
from test_ingest_assemble import WRITERS

from osl_analysis.cli import main
from osl_analysis.commands import trials as module
from osl_analysis.commands import watch as watching
from osl_analysis.commands.first_look import first_look
from osl_analysis.commands.new_campaign import new_campaign as drafted_campaign
from osl_analysis.errors import InputError
from osl_analysis.files import config_here, default_config
from osl_analysis.ingest.clock_choice import ClockChoice, gaps_text, likely_clock, span_of
from osl_analysis.ingest.draft import draft_source
from osl_analysis.ingest.likely_clock import likely_unit, rate_of
from osl_analysis.ingest.likely_column import likely_column
from osl_analysis.ingest.overview import Overview, RecordedChannel
from osl_analysis.ingest.placeholders import open_places
from osl_analysis.ingest.raw_files import read_converted, read_source
from osl_analysis.trial import Trial
from osl_analysis.units import is_clock

NASTY = 'a\x1b[2J": {x\n# y\u202eb'
LATIN = NASTY.replace("\u202e", "\x9b")
REAL_FILES = sorted(
    p for p in REAL_DATA.glob("*/*") if p.parent.name in ("c3d", "mcap", "nexus_csv")
)
JOINTS = (
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] effort\nfloat32[3]"
    " bias\nstring note\n"
)


def joint_log(path: Path, topic: str = "/joints", **options: Any) -> Path:
    """The angles of a knee and an ankle at 100 Hz, with a gap after 0.2 s."""
    log, known = (
        [],
        {"name": ["knee", "left ankle"], "effort": [], "bias": [1.0, 2.0, 3.0], "note": "x"},
    )
    for i in range(50):
        log.append(
            stamped(
                i * 10_000_000 + (500_000_000 if i > 20 else 0),
                **known,
                position=[0.1 * i, 0.2 * i],
            )
        )
    return write_log(path, log, JOINTS + HEADER, "sensor_msgs/msg/JointState", topic, **options)


def test_messages_are_listed_by_field_with_type_rate_and_gaps(
    tmp_path: Path,
) -> None:
    path = joint_log(tmp_path / "a.mcap", chunk_size=1000)
    overview = module.inspect_file(path)
    assert {channel.address["field"]: (channel.type,
        channel.likely_unit) for channel in overview.channels} == {
        **dict.fromkeys(["position[name=knee]", "position[name=left ankle]"], ("float64[2]",
        "rad")),
        "bias[0]": ("float32[3]", ""),
    }  # fmt: skip
    text, gaps = module.overview_text(overview), "50 samples at 100 Hz; 1 gaps, the longest 0.510 s"
    assert f"field          /joints position[name=left ankle]  {gaps}; float64[2]" in text
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


def test_a_csv_file_is_listed_and_its_draft_reads_it(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.csv"
    path.write_text(BENCH)
    text = module.overview_text(module.inspect_file(path))
    assert "! the last line, 7, is cut off and was skipped" in text
    for said in ("comment 1: rig: B", "3 x 'ok'",
    "a clock, 0.1 per unit, 1 gaps, the longest 70.000 s",
                 "column         angle [deg]  4 samples; from 1.5 to 4.5"):  # fmt: skip
        assert said in text
    for text in (BENCH, BENCH.replace(",", ";").replace(".", ",")):
        path.write_text(text)
        content = draft_source(module.inspect_file(path), "a.csv").replace("NAME_1", "theta")
        (tmp_path / "a.yaml").write_text(
            "\n".join(line for line in content.splitlines() if "NAME_2" not in line)
        )
        samples = read_converted(path, read_source(tmp_path / "a.yaml")).samples
        np.testing.assert_allclose(
            samples.to_numpy().T, [[0, 0.01, 0.02, 0.09], np.radians([1.5, 2.5, 3.5, 4.5])]
        )


@pytest.mark.parametrize("kind", ["mcap", "c3d", "csv", "nexus"])
def test_nothing_of_a_file_reaches_the_terminal_raw_or_leaves_its_quotes(
    tmp_path: Path, kind: str
) -> None:
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
        nexus = (
            f"Trajectories\n100\n,,{nasty},,\nFrame,Sub Frame,X,Y,Z\n,,{nasty},mm,mm\n1,0,1,2,3\n"
        )
        path.write_text(table if kind == "csv" else nexus)
    result = CliRunner().invoke(main, ["inspect", str(path)])
    assert result.exit_code == 0, result.output
    assert all(line.isprintable() for line in result.output.split("\n"))
    drafted = result.output.partition("A source file to start from:")[2]
    assert isinstance(yaml.safe_load(drafted), dict)
    begins = (
        "format",
        "desc",
        "clock",
        "delim",
        "header",
        "time",
        "#",
        "channels",
        "  NAME_",
        "markers",
        "plates",
    )
    assert all(line.startswith(begins) for line in drafted.split("\n") if line)


def test_the_draft_is_written_where_it_is_asked_for_and_never_over_a_file(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(BENCH)
    arguments = ["inspect", str(tmp_path / "a.csv"), "--draft", str(tmp_path / "a.yaml")]
    assert CliRunner().invoke(main, arguments).exit_code == 0
    assert (tmp_path / "a.yaml").read_text().startswith("format: csv\n")
    assert "exists; name a new file" in CliRunner().invoke(main, arguments).output


@pytest.mark.parametrize("path", REAL_FILES, ids=lambda path: path.stem)
def test_every_real_file_is_listed_or_refused_in_a_sentence(path: Path) -> None:
    if path.name in {
        "Empty.c3d",
        "Optotrak_truncated_29_of_1149.c3d",
        "s18_bad_parameter_section.c3d",
    }:
        with pytest.raises(InputError, match=path.name):
            module.inspect_file(path)
        return
    overview = module.inspect_file(path)
    assert overview.channels
    assert isinstance(yaml.safe_load(draft_source(overview, path.name)), dict)


@pytest.mark.parametrize(("name", "unit", "column"), [
    ("angleJIM", "", "theta"), ("JointPosition", "rad", "theta"),
    ("position[name=ankle]", "rad", "theta"),
    ("desired_angle", "deg", "theta_command"), ("motor_position", "rad", "theta_m"),
    ("I_q", "A", "current"),
    ("actuator velocity", "rad/s", "omega_m"), ("LoadCellTorque", "Nm", "torque"),
    ("Trig", "", "trigger"),
    ("sync_out", "V", "sync"), ("motor_torque", "N*m", "torque_m"), ("torque", "deg", ""),
    ("angle", "V", ""),
    ("commanded_torque", "N*m", ""), ("R_ground_torque_y", "N*m", ""), ("case_temperature", "", ""),
    ("load", "Nm", "torque"), ("ch3", "deg", "theta"), ("roll", "deg", ""),
])  # fmt: skip
def test_a_name_and_its_unit_tell_the_column(name: str, unit: str, column: str) -> None:
    assert likely_column(RecordedChannel("column", {"column": name}, unit)) == column


def test_a_draft_names_only_what_leaves_no_doubt() -> None:
    units = {
        "ankle_angle": "rad",
        "joint_angle": "rad",
        "torque": "N*m",
        **dict.fromkeys("abcdef", ""),
    }
    every = [RecordedChannel("column", {"column": name}, unit) for name, unit in units.items()]
    found = yaml.safe_load(draft_source(Overview("csv", {}, every), "a"))["channels"]
    assert [*found] == ["NAME_1", "NAME_2", "torque"]


TIME = np.arange(50) * 0.004
SIGNALS = {"ankle_angle_deg": np.sin(TIME), "torque_Nm": np.cos(TIME)}
EVERY = pytest.mark.parametrize("what", ["csv", "mat", "json_lines", "tdms"])


@pytest.mark.parametrize(("slow", "asked"), [
    (1.0, "may be the clock, to be checked: .*loop_time, .*sys_time; .*loop_time is taken"),
    (1.1, "contradict each other: .*loop_time spans 0.2156, .*sys_time spans 0.196; name the one"),
])  # fmt: skip
@EVERY
def test_of_two_clocks_the_first_is_taken_if_they_agree_and_the_user_is_asked(
    tmp_path, what, slow, asked
):
    """Taken by a clock that is 10 % slow, B would be 10 % and I 21 % off, at a VAF of 100 %."""
    path = WRITERS[what][2](
        tmp_path / f"a.{what}", {"loop_time": slow * TIME, "sys_time": TIME, **SIGNALS}
    )
    overview = module.inspect_file(path)
    time = yaml.safe_load(draft_source(overview, path.name))["time"]
    assert slow == 1 or list(open_places({"time": time}))
    assert any("loop_time" in one for one in time.values()) == (slow == 1)
    (said,) = overview.open
    assert re.search(asked, said)
    assert f"! {said}" in module.overview_text(overview)
    assert f"# {said}\n" in draft_source(overview, "a")


@pytest.mark.parametrize(
    ("factor", "taken"), [(1.004, "a"), (0.996, "a"), (1.006, None), (0.997e9, "a"), (60, None)]
)
def test_clocks_agree_within_half_a_percent_in_any_unit_of_seconds(factor, taken):
    assert likely_clock({"a": TIME, "b": factor * TIME}).key == taken
    assert likely_clock({"a": TIME, "b": factor * TIME, "c": TIME}).key == taken
    assert likely_clock({"b": TIME - 0.02 * (np.arange(50) % 5 == 0), "a": TIME}) == ClockChoice(
        "a"
    ), "it goes back"


def test_names_tell_clocks_and_units_and_stamps_tell_rate_span_and_gaps():
    units = {
        f"x_{unit}": unit
        for unit in re.split(" ", "deg rad rev rpm Nm N A mA V mV s ms us ns Hz mm")
    }
    units |= {
        f"x_{angle}_{per}s": f"{angle}/s" for angle in ("deg", "rad") for per in ("", "per_")
    } | {"t_sec": "s"}
    units |= {"M/Nm": "Nm", **dict.fromkeys(("theta_m", "deg", "deg/s"), "")}
    assert {name: likely_unit(name) for name in units} == units
    clocks = (
        "time T timestamp stamp state_time loop_time pi_time sys_time ROS_time elapsed_time elapsed"
        " clock seconds"
    )
    clocks += (
        " __time time_since_start t_us t_ns time_ms Time_sec t_s stance_time t0 time_to_peak times"
        " theta t_m"
    )
    assert [is_clock(name) for name in re.split(" ", clocks)] == [True] * 20 + [False] * 6
    for time, said, rate in (
        ([0, 1, 2, 3.4, 5, 5.5], "1 gaps, the longest 1.600 s", 1),
        ([0, 1, 2, 2, 2, 3, 4], "2 stamps twice", 1),
        ([0, 0.5, 1, 0.75, 1.5, 2], "1 stamps out of order", 2), ([4], "", None),
        ([0, 2, 2, 2], "2 stamps twice", 0.5),
    ):  # fmt: skip
        assert (gaps_text(np.array(time)), rate_of(np.array(time))) == (said, rate)
    back, often = np.r_[0:11.0, 9:20], np.r_[0:9.0, 7:9]
    assert [span_of(one) for one in (back, often, np.array([0, np.nan, 0, 3, 3]))] == [
        19,
        0,
        3,
    ]


def test_a_folder_lists_what_each_recording_holds_or_why_it_is_refused(tmp_path: Path) -> None:
    write_c3d(
        tmp_path / "walk.c3d", np.ones((100, 1, 4)) * [1, 2, 3, 0], rate=100.0, POINT__LABELS=["a"]
    )
    (tmp_path / "a\x1b[31m.csv").write_text("a,b\n1,2\n")
    (tmp_path / "broken.mcap").write_bytes(b"no MCAP file")

    lines = module.folder_text(tmp_path).splitlines()

    assert lines[0] == r"a\x1b[31m.csv: csv, 2 x column"
    assert lines[1].startswith("broken.mcap: refused: not an MCAP file")
    assert lines[2] == "walk.c3d: c3d, 1 x marker at 100 Hz"
    as_json = json.loads(module.folder_json(tmp_path))
    assert as_json["walk.c3d"]["channels"] == [
        {
            "kind": "marker",
            "label": "a",
            "unit": "mm",
            "samples": 100,
            "rate_hz": 100.0,
            "note": None,
        }
    ]
    assert as_json["broken.mcap"]["refused"].endswith(lines[1].partition("refused: ")[2])
    with pytest.raises(InputError, match=r"no recordings below it \(\.\w+, "):
        module.folder_text(tmp_path / "none")


def test_the_folder_of_a_ros_2_bag_is_one_recording(tmp_path: Path) -> None:
    assert module.is_folder_of_recordings(tmp_path)
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: {}")
    assert not module.is_folder_of_recordings(tmp_path)


pytestmark = pytest.mark.usefixtures("in_root", "schemas_made_once")
STIFFNESS, DAMPING, INERTIA = 120.0, 2.0, 0.02


@pytest.fixture
def bench(tmp_path):
    return watching.WatchedBench(default_config(), None, tmp_path / "pictures")


def write_joint(path, sign=1.0):
    """A log of an exact joint under a stepped sine, as a laboratory's own CSV: 1 and 3 Hz at 4 deg,
    250 Hz."""
    time = np.arange(0, 17, 0.004)
    angle = np.zeros_like(time)
    for start, frequency in ((1.0, 1.0), (12.0, 3.0)):
        inside = (time >= start) & (time < start + 10 / frequency)
        angle[inside] = np.radians(4) * np.sin(2 * np.pi * frequency * (time[inside] - start))
    omega, noise = np.gradient(angle, time), np.random.default_rng(3).normal(0, 0.05, time.size)
    torque = STIFFNESS * angle + DAMPING * omega + INERTIA * np.gradient(omega, time) + noise
    path.parent.mkdir(parents=True, exist_ok=True)
    columns = np.column_stack([time, np.degrees(angle), sign * torque])
    np.savetxt(
        path, columns, "%.6f", ",", header="time_s,ankle_angle_deg,loadcell_torque_Nm", comments=""
    )


def touch(path, text, second):
    """Write a file whose date is `second`."""
    path.write_text(text)
    os.utime(path, (second, second))


def looks(arrivals, *seconds):
    """The names of what is complete at each of these times, which is then examined."""
    found = []
    for now in seconds:
        complete = arrivals.complete(float(now))
        arrivals.seen |= {path.name: state for path, state in complete}
        found.append([path.name for path, _ in complete])
    return found


def test_a_file_that_grows_with_pauses_is_taken_for_complete_once_at_most(tmp_path):
    """A recorder that writes every 6 s gave a refusal for each part."""
    arrivals, log, found = watching.Arrivals(tmp_path), tmp_path / "a.csv", []
    touch(log, "x", 0)
    assert looks(arrivals, 0, 3, 4) == [[], [], ["a.csv"]]
    touch(log, "xx", 10)
    assert looks(arrivals, 10, 14, 29, 30) == [[], [], [], ["a.csv"]]
    arrivals = watching.Arrivals(tmp_path)
    for second in range(60):
        if second % 6 == 0:
            touch(log, "x" * (second + 1), second)
        found += looks(arrivals, second)
    assert [second for second, names in enumerate(found) if names] in ([4], [])
    assert ["a.csv"] in looks(arrivals, *range(60, 75))
    touch(log, log.read_text().replace("x", "y"), 80)  # written again, of the same size
    assert looks(arrivals, *range(100, 130)).count(["a.csv"]) == 1
    touch(log, "", 140)
    assert looks(arrivals, 200, 204, 219, 220, 260) == [
        [],
        [],
        [],
        ["a.csv"],
        [],
    ], "it stays empty: a word, once"


def test_a_restarted_watch_examines_what_was_not_and_no_more(tmp_path, bench, monkeypatch):
    """All that lay there was noted before the first was examined: after Ctrl-C the rest was
    lost."""
    (tmp_path / "in").mkdir()
    for name in ("a.csv", "b.csv", "c.csv"):
        touch(tmp_path / f"in/{name}", "text", 1)
    clock = iter(range(0, 1000, 5))
    monkeypatch.setattr(watching.time, "monotonic", lambda: float(next(clock)))
    monkeypatch.setattr(watching.time, "sleep", lambda _: None)
    said = iter([("a: K", True), ("b: no channels", False), ("b: K", True), ("c: K", True)])
    monkeypatch.setattr(watching, "recording_line", lambda *_: next(said))
    first = watching.watched_lines(tmp_path / "in", bench)
    assert [next(first), next(first)] == ["a: K", "b: no channels"]
    first.close()
    again = watching.watched_lines(tmp_path / "in", bench)
    assert [next(again), next(again)] == ["b: K", "c: K"]
    again.close()
    assert sorted(watching.read_notes(bench.output / "examined.json")) == [
        "a.csv",
        "b.csv",
        "c.csv",
    ]
    (bench.output / "examined.json").write_text("{cut")
    assert watching.read_notes(bench.output / "examined.json") == {}


@pytest.mark.usefixtures("without_inference")
def test_a_fault_in_one_recording_does_not_end_the_watch(tmp_path, bench, monkeypatch):
    write_joint(path := tmp_path / "in/k120_b2.csv")
    # and no picture takes the numbers away
    bench.output.write_text("a file in place of the folder")
    path.write_text(path.read_text() + "17.000")  # of which the reader warns
    said = watching.recording_line(path, tmp_path / "in", bench)[0]
    assert re.search(
        r"\bK 1[12]\d.*k120_b2.csv: the last line, 4252, is cut off .*no picture: ", said
    )
    monkeypatch.setattr(watching, "fit_of_row", lambda *_: 1 / 0)
    assert (
        "FAILED: unexpected ZeroDivisionError"
        in watching.recording_line(path, tmp_path / "in", bench)[0]
    )


@pytest.mark.usefixtures("without_inference")
def test_a_stiffness_far_from_the_desired_one_is_pointed_at(tmp_path, bench):
    write_joint(path := tmp_path / "in/impedance_k300_b2.csv")
    doubt = "K is farther from the K_d .*: K is 0.4 times K_d. Check K_d"
    line, *_ = watching.recording_line(path, tmp_path / "in", bench)
    assert re.search(f"DOUBTFUL: stiffness unlike K_d: {doubt}", line)
    drafted_campaign(tmp_path / "c", recordings=tmp_path / "in")
    (look,) = first_look(tmp_path / "c")
    assert re.search(
        f"(?s)first trial of experiment impedance, [^\n]*: doubtful\n.*{doubt}", look.text
    )


def test_a_capture_is_skipped_in_a_line_that_says_what_it_is(tmp_path, bench):
    capture = {
        "trial": "pass_1",
        "experiment": "walking",
        "log": None,
        "mocap": "pass_1.c3d",
        "mocap_source": "c3d",
    }
    (tmp_path / "in").mkdir(exist_ok=True)
    (tmp_path / "in/pass_1.c3d").write_bytes(b"")
    bench.campaign = SimpleNamespace(rows={"pass_1": capture})
    bench.config = bench.config.model_copy(update={"raw_data": tmp_path / "in"})
    said, is_analysed = watching.recording_line(tmp_path / "in/pass_1.c3d", tmp_path / "in", bench)
    assert said.endswith("pass_1.c3d: walking capture, skipped: `osl-analysis run` analyses it"), (
        said
    )
    assert is_analysed


@pytest.mark.usefixtures("without_inference")
def test_a_recording_of_an_unknown_recorder_gives_its_joint(tmp_path, bench):
    write_joint(tmp_path / "in/k120_b2.csv")
    write_joint(tmp_path / "in/rec7.csv", sign=-1.0)
    (tmp_path / "in/x.csv").write_text("junk\n")
    paths = sorted((tmp_path / "in").iterdir())
    sound, turned, junk = (
        watching.recording_line(path, tmp_path / "in", bench)[0] for path in paths
    )
    found = {name: float(value) for name, value in re.findall(r"\b([KBI]) (\S+) ±", sound)}
    assert found == pytest.approx({"K": STIFFNESS, "B": DAMPING, "I": INERTIA}, rel=0.03)
    assert 'channels are guessed: theta: {column: "ankle_angle_deg"' in sound
    assert (tmp_path / "pictures/k120_b2.png").stat().st_size > 10_000
    assert re.search(
        r"rec7.csv: K 1[12]\d.* channels are guessed: .*, torque: {[^}]*, sign: -1}", turned
    )
    assert re.search(r"x.csv: REFUSED: no rows", junk)
    # what no recording of a kind has is told once
    assert ["behind the load cell" in line for line in (sound, turned)] == [True, False]
    assert "\n" not in sound + turned + junk
    written = (
        tmp_path / f"pictures/{name}" for name in ("k120_b2.png", "rec7.png", "measured.json")
    )
    assert {*paths, *written} == {path for path in tmp_path.rglob("*") if path.is_file()}


@pytest.mark.usefixtures("without_inference")
def test_outside_of_a_campaign_nobody_stated_a_protocol_or_a_device(tmp_path, monkeypatch):
    write_joint(tmp_path / "in/k120_b2.csv")
    monkeypatch.chdir(tmp_path)
    bench = watching.WatchedBench(config_here(), None, tmp_path / "pictures")
    said = watching.recording_line(tmp_path / "in/k120_b2.csv", tmp_path / "in", bench)[0]
    assert "quality ok" in said
    assert (bench.config.parameters, bench.config.dynamometer.amplitudes_deg) == (None, None)


@pytest.mark.usefixtures("without_inference")
def test_the_stated_source_file_decides(tmp_path):
    write_joint(tmp_path / "in/k120_b2.csv", sign=-1.0)
    theta, torque = (
        "{column: ankle_angle_deg, unit: deg}",
        "{column: loadcell_torque_Nm, unit: N*m, sign: -1}",
    )
    source = (
        f"format: csv\ntime: {{column: time_s, unit: s}}\nchannels:\n  theta: {theta}\n  torque:"
        f" {torque}\n"
    )
    (tmp_path / "mine.yaml").write_text(source)
    bench = watching.WatchedBench(
        Path("config/config.yaml"), tmp_path / "mine.yaml", tmp_path / "pictures"
    )
    said = watching.recording_line(tmp_path / "in/k120_b2.csv", tmp_path / "in", bench)[0]
    assert "guessed" not in said
    assert "NOT CHECKED: " in said
    assert float(re.search(r"\bK (\S+) ±", said)[1]) == pytest.approx(STIFFNESS, rel=0.01)


def test_a_trial_of_the_sheet_is_fitted_in_its_windows_and_against_its_curve(monkeypatch):
    rng = np.random.default_rng(1)
    motion = noise(rng, duration=40.0)
    disturbed = np.where((motion[0] > 15) & (motion[0] < 25), 30 * np.sin(9 * motion[0]), 0.0)
    trial = made_trial(rng, motion, more=disturbed)
    row = {
        "experiment": "impedance",
        "controller": "mine",
        "K_d": 250.0,
        "B_d": None,
        "windows": "2-14.5 25.5-40",
    }
    (found,) = watching.fit_of_row(trial, row, None, default_config()).table.to_dicts()
    assert [found[name] for name in TRUE] == pytest.approx(list(TRUE.values()), rel=0.01)
    assert (found["controller"], found["K_d"]) == ("mine", 250.0)
    assert "gains" not in found["not_checked"]  # of a device that nobody stated
    monkeypatch.setattr("osl_analysis.commands.fit.fit_trial", lambda *given: given[-2]["desired"])
    row = {"experiment": "torque_angle", "desired": "foot"}
    assert watching.fit_of_row(trial, row, None, default_config()) == "foot"


def test_the_parameters_of_an_ankle_judge_no_knee(bench):
    device, without = bench.config.parameters, bench.config.model_copy(update={"parameters": None})
    found = [
        watching.device_of_row({"joint": joint}, bench.config) for joint in ("knee", "ankle", None)
    ]
    assert [*found, watching.device_of_row({}, without)] == [None, device, device, None]


def test_a_failed_check_is_told_with_its_whole_remedy(
    bench,
):
    rng = np.random.default_rng(1)
    trial = made_trial(rng, noise(rng, duration=20.0))
    spoilt = replace(trial, samples=trial.samples.with_columns(torque=pl.col("torque").clip(-4, 4)))
    told = watching.quality_text(spoilt, "impedance", bench.config, ())
    assert told.startswith("QUALITY flag saturation: ")
    assert told.endswith(watching.FINDINGS["clipped_signal"].remedy)
    assert "saturation" not in watching.quality_text(
        spoilt, "impedance", bench.config, ("saturation",)
    )


def test_a_recording_is_compared_with_its_siblings_of_which_a_wrong_gain_is_told(tmp_path):
    def said(name, K, kind=("impedance", "ankle", "", "pd", "300"), sign=1):
        row = (
            {"experiment": "impedance", "K_d": 300.0, "B_d": 5.0}
            if kind[3]
            else {"experiment": "impedance"}
        )
        samples = pl.DataFrame({"time": [0.0, 1.0, 2.0], "theta": [0.0, 0.1, 0.2]})
        provenance = {"columns": {"torque": {"sign": sign}}}
        estimates = {"K": K, "K_se": 1.0, "B": 5.0, "B_se": 0.1}
        numbers = watching.comparable(Trial(name, samples, provenance), row, estimates)
        return [watching.beside_siblings(name, kind, numbers, tmp_path / "measured.json")]

    for k, (name, K) in enumerate((("a", 299.0), ("b", 301.0), ("c", 303.0))):
        assert said(name, K) == [f"{k} siblings to compare with, 3 are needed"]
    assert said("d", 300.0) == ["like its 3 siblings"]
    (differs,) = said("e", 340.0)
    assert differs.startswith("DIFFERS from its 4 siblings: K is 340, theirs 300 ± 3: look")
    (turned,) = said("e", 300.0, sign=-1)
    assert "sign of torque is -1, theirs 1 " in turned
    assert said("e", 301.0) == ["like its 4 siblings"], (
        "a recording made again is no sibling of itself"
    )
    none = ["0 siblings to compare with, 3 are needed"]
    assert said("k", 190.0, ("impedance", "ankle", "", "pd", "200")) == none, (
        "another K_d has siblings of its own"
    )
    assert said("f", 340.0, ("impedance", "knee", "", "pd", "300")) == none, (
        "another joint has siblings of its own"
    )
    # nobody said that the same K was asked for
    for name, K in zip("ghij", (300, 301, 300, 200), strict=True):
        assert said(name, K, ("impedance", "ankle", "", "")) == ["no siblings: no K_d is stated"]
