"""Oddities that recordings of others have: a stale row, two publishers, a gate, a copied topic."""

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from mcap.writer import Writer as McapWriter
from mcap_builder import HEADER, stamped, write_log
from recognised_files import read_recognised, refusal_of

from osl_analysis.commands.trials import inspect_file
from osl_analysis.errors import InputError
from osl_analysis.ingest.clock import aligned_clock
from osl_analysis.ingest.conversion import Converted
from osl_analysis.ingest.draft import draft_source
from osl_analysis.ingest.stale_rows import find_stale_rows

TIME = np.arange(4000) / 500
ANGLE = 5 * np.sin(9 * TIME)
TORQUE = 30 * np.sin(9 * TIME + 0.3)
CSV = {
    "time": {"column": "time", "unit": "ms"},
    "channels": {
        "theta": {"column": "angle", "unit": "deg"},
        "torque": {"column": "torque", "unit": "N*m"},
    },
}


def write_rows(path: Path, rows: np.ndarray[Any, Any]) -> Path:
    lines = [f"{t:.0f},{a:.9f},{f:.9f}" for t, a, f in rows]
    path.write_text("\n".join(["time,angle,torque", *lines, ""]))
    return path


# Rows of another time.


@pytest.mark.parametrize("row", [0, 1800, 3999])
def test_a_stale_row_is_left_out_and_named(tmp_path: Path, row: int) -> None:
    rows = np.column_stack([1e3 * TIME + 50_000, ANGLE, TORQUE])
    rows[row] = rows[1200] + [1, 0, 0]

    recording = read_recognised(write_rows(tmp_path / "a.csv", rows), **CSV)

    kept = np.delete(np.arange(TIME.size), row)
    if row == 3999:  # it stands at the end, where time just ends
        kept = np.arange(3999)
    np.testing.assert_allclose(recording.samples["torque"], TORQUE[kept], atol=1e-8)
    assert any(f"line {row + 2} is left out" in text for text in recording.warnings)


def test_a_clock_that_stays_back_is_refused(tmp_path: Path) -> None:
    rows = np.column_stack([1e3 * TIME + 50_000, ANGLE, TORQUE])
    rows[2000:, 0] -= 1000

    message = refusal_of(write_rows(tmp_path / "a.csv", rows), **CSV)

    assert "the recorder's clock was set back" in message


def test_few_rows_are_stale_and_many_are_a_clock_that_goes_back() -> None:
    clock = np.arange(10_000)
    few = clock.copy()
    few[[500, 7000]] = [10, 20]
    many = clock.copy()
    many[500:600] -= 300

    assert find_stale_rows(few).tolist() == [500, 7000]
    apart = clock.copy()
    apart[np.arange(300, 9000, 300)] -= 200
    assert find_stale_rows(many).size == 0
    assert find_stale_rows(apart).size == 0
    assert find_stale_rows(clock).size == 0


def test_early_and_late_rows_of_one_recording_are_stale_each() -> None:
    clock = np.arange(20_000) * 0.002
    clock[4000] = 0.2  # waited since the beginning
    clock[9000:9002] = 15.2
    clock[15_000] = 32.0  # of a later time

    assert find_stale_rows(clock).tolist() == [4000, 9000, 9001, 15_000]


@pytest.mark.parametrize("off_s", [-3.0, 40.0])
def test_three_stale_rows_in_a_row_are_found_and_four_are_not(off_s: float) -> None:
    clock = 10 + np.arange(20_000) * 0.002
    three = clock.copy()
    three[9000:9003] += off_s
    four = clock.copy()
    four[9000:9004] += off_s

    assert find_stale_rows(three).tolist() == [9000, 9001, 9002]
    assert find_stale_rows(four).size == 0


@pytest.mark.parametrize("gap_s", [0.7, 96.8])
def test_a_first_row_long_before_the_others_is_stale(gap_s: float) -> None:
    clock = 100 + np.arange(2000) * 0.002
    clock[0] -= gap_s

    assert find_stale_rows(clock).tolist() == [0]


def test_a_gap_in_a_recording_makes_no_row_stale() -> None:
    clock = np.arange(2000) * 0.002
    clock[10:] += 5

    assert find_stale_rows(clock).size == 0


# Several publishers of one topic.

STATE = "std_msgs/Header header\nstring[] name\nfloat64[] position\n" + HEADER


def write_states(path: Path, other_angle: float) -> Path:
    """The ankle at 500 Hz, and every fourth time a second publisher that calls it first."""
    messages = []
    for k, angle in enumerate(np.radians(ANGLE[:1000])):
        ns = k * 2_000_000
        messages.append(stamped(ns, name=["knee", "ankle"], position=[0.1, angle]))
        if k % 4 == 0:
            value = other_angle if np.isfinite(other_angle) else angle
            names = ["ankle", "knee"]
            messages.append(stamped(ns + 900_000, name=names, position=[value, 0.1]))
    return write_log(path, messages, STATE, "sensor_msgs/msg/JointState", "/joints")


JOINTS = {
    "time": {"source": "header"},
    "channels": {"theta": {"topic": "/joints", "field": "position[name=ankle]", "unit": "rad"}},
}


def test_a_second_publisher_of_other_values_is_named(tmp_path: Path) -> None:
    message = refusal_of(write_states(tmp_path / "a.mcap", other_angle=0.0), **JOINTS)

    assert "250 of 1250 messages are of another publisher" in message
    assert "[ankle, knee]" in message


def test_a_second_publisher_of_the_same_values_is_read(tmp_path: Path) -> None:
    recording = read_recognised(write_states(tmp_path / "a.mcap", np.nan), **JOINTS)

    assert len(recording.samples) == 1250


@pytest.mark.parametrize(("number", "count", "angle"), [(1, 1000, None), (2, 250, 0.25)])
def test_a_source_file_chooses_one_of_several_publishers(
    tmp_path: Path, number: int, count: int, angle: float | None
) -> None:
    path = write_states(tmp_path / "a.mcap", other_angle=0.25)

    recording = read_recognised(path, **JOINTS, publishers={"/joints": number})

    expected = np.radians(ANGLE[:1000]) if angle is None else np.full(count, angle)
    assert recording.samples["theta"].to_numpy() == pytest.approx(expected)
    left_out = f"{1250 - count} messages of other publishers are left out"
    assert any(left_out in text for text in recording.warnings)


@pytest.mark.parametrize(("number", "count"), [(1, 300), (2, 100)])
def test_two_channels_of_the_recorder_are_two_publishers(
    tmp_path: Path, number: int, count: int
) -> None:
    """Both write the same fields, the less frequent one first."""
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema("Sample", "jsonschema", b"{}")
        rare, frequent = (writer.register_channel("/joints", "json", schema) for _ in range(2))
        for k in range(300):
            if k % 3 == 0:
                writer.add_message(rare, k * 10**7 + 5, b'{"angle": -1}', k * 10**7)
            writer.add_message(frequent, k * 10**7, b'{"angle": %d}' % k, k * 10**7)
        writer.finish()
    stated = {
        "time": {"source": "log"},
        "channels": {"theta": {"topic": "/joints", "field": "angle", "unit": "rad"}},
    }

    refused = refusal_of(path, **stated)
    recording = read_recognised(path, **stated, publishers={"/joints": number})

    assert "write `publishers: {/joints: 1}`" in refused
    assert "2 channels, of 100, 300 messages" in refused
    assert len(recording.samples) == count


WRENCH = "std_msgs/Header header\nfloat64 force\n" + HEADER
FORCE = {
    "time": {"source": "header"},
    "channels": {"torque": {"topic": "/cell", "field": "force", "unit": "N*m"}},
}


def write_cells(path: Path, later_ns: int, gain: float, frame: str = "cell") -> Path:
    """A load cell at 250 Hz, and one of another gain that writes behind each of its messages."""
    noise = np.random.default_rng(4)
    messages = []
    for k in range(500):
        torque = 13 * np.sin(0.03 * k) + 0.15 * noise.standard_normal()
        ns = k * 4_000_000
        messages.append((ns, {"header": header(ns, "cell"), "force": torque}))
        second = gain * torque + 0.02 * noise.standard_normal()
        ns += later_ns
        messages.append((ns, {"header": header(ns, frame), "force": second}))
    return write_log(path, messages, WRENCH, "lab_msgs/msg/Force", "/cell")


def header(ns: int, frame: str) -> dict[str, Any]:
    return {"stamp": {"sec": ns // 10**9, "nanosec": ns % 10**9}, "frame_id": frame}


@pytest.mark.parametrize(
    ("later_ns", "frame"), [(2_000_000, "raw"), (1_000_000, "cell"), (0, "cell"), (20_000, "raw")]
)
def test_publishers_without_names_are_told_by_frames_or_stamps_and_values(
    tmp_path: Path, later_ns: int, frame: str
) -> None:
    path = write_cells(tmp_path / "a.mcap", later_ns, gain=0.9, frame=frame)

    message = refusal_of(path, **FORCE)
    recording = read_recognised(path, **FORCE, publishers={"/cell": 1})

    assert "500 of 1000 messages are of another publisher" in message
    torque = recording.samples["torque"].to_numpy()
    assert torque == pytest.approx(13 * np.sin(0.03 * np.arange(500)), abs=0.7)


@pytest.mark.parametrize(("later_ns", "noise_Nm"), [(0, 0.15), (1_000_000, 0.15), (0, 1.5)])
def test_one_series_whose_stamps_go_in_pairs_is_of_one_publisher(
    tmp_path: Path, later_ns: int, noise_Nm: float
) -> None:
    """A cell at 500 Hz whose stamps are rounded to 4 ms, or late every second time."""
    noise = np.random.default_rng(5)
    messages = []
    for k in range(1000):
        ns = k // 2 * 4_000_000 + (k % 2) * later_ns
        torque = 13 * np.sin(0.015 * k) + noise_Nm * noise.standard_normal()
        messages.append((ns, {"header": header(ns, "cell"), "force": torque}))
    path = write_log(tmp_path / "a.mcap", messages, WRENCH, "lab_msgs/msg/Force", "/cell")

    assert len(read_recognised(path, **FORCE).samples) == 1000


@pytest.mark.parametrize(
    ("publishers", "reason"),
    [({"/joints": 3}, "no publisher 3; it has 2"), ({"/joint": 1}, "no channel is of topic")],
)
def test_a_publisher_that_is_not_there_is_refused(
    tmp_path: Path, publishers: dict[str, int], reason: str
) -> None:
    path = write_states(tmp_path / "a.mcap", other_angle=0.0)

    with pytest.raises(ValueError, match=reason):
        read_recognised(path, **JOINTS, publishers=publishers)


# A gate in place of pulses.


def recorded(time: np.ndarray[Any, Any], level: np.ndarray[Any, Any]) -> Converted:
    return Converted(pl.DataFrame({"time": time, "sync": level}), {})


def test_a_gate_is_the_one_pulse_that_is_as_long_as_the_capture() -> None:
    session = np.arange(0, 60, 0.002)
    level = ((session > 10) & (session < 14)) | ((session > 30) & (session < 37))
    noise = 0.01 * np.random.default_rng(1).standard_normal(7000)

    fit, warnings = aligned_clock(
        recorded(session, level.astype(float)),
        recorded(np.arange(7000) / 1000, 4.93 + noise),
        shared=None,
    )

    assert fit.to_master(np.array([30.0]))[0] == pytest.approx(0.0, abs=0.003)
    assert (fit.method, warnings) == ("gate", [])


def test_noise_of_a_steady_level_is_no_edge() -> None:
    session = np.arange(0, 60, 0.002)
    level = (session % 10 > 5).astype(float)
    noise = 0.01 * np.random.default_rng(1).standard_normal(5000)

    with pytest.raises(InputError, match=r"has no edge: it is a gate, .* 5 pulses .* `shared`"):
        aligned_clock(
            recorded(session, level), recorded(np.arange(5000) / 1000, 4.93 + noise), shared=None
        )


# Drafts.


def drafted(path: Path, columns: dict[str, np.ndarray[Any, Any]]) -> str:
    pl.DataFrame(columns).write_csv(path, null_value="")
    return draft_source(inspect_file(path), path.name)


def test_a_decimated_copy_is_no_second_torque(tmp_path: Path) -> None:
    some = np.where(np.arange(TIME.size) % 5 == 0, TORQUE, np.nan)
    columns = {
        "__time": TIME,
        "/fts/decimated/wrench/torque/z": some,
        "/joint_states/ankle/position": ANGLE,
        "/fts/full/wrench/torque/z": TORQUE,
    }

    draft = drafted(tmp_path / "a.csv", columns)

    assert '\n  torque: {column: "/fts/full/wrench/torque/z"' in draft
    assert "left out: some readings of" in draft


def test_the_logger_of_opensourceleg_has_the_units_of_its_library(tmp_path: Path) -> None:
    leg = "ankle[DephyActpack]:"
    columns = {
        "OSL:timestamp": 1.7e9 + TIME,
        f"{leg}motor_current": 1e3 * np.sin(4 * TIME),
        f"{leg}case_temperature": 26 + 0.1 * TIME,
        f"{leg}battery_voltage": 39_000 - 2 * TIME,
        f"{leg}joint_position": np.radians(ANGLE),
        "torque": TORQUE,
    }

    draft = drafted(tmp_path / "a.csv", columns)

    assert f'\n  theta: {{column: "{leg}joint_position", unit: "rad"}}' in draft
    assert f'\n  current: {{column: "{leg}motor_current", unit: "mA"}}' in draft
    assert draft.count("UNKNOWN") == 2  # how to edit, and the unit of the torque
    for quiet in ("case_temperature", "battery_voltage"):
        assert "\n#   NAME" in draft.partition(quiet)[0]
        assert "\n  NAME_" not in draft


def test_torque_and_current_without_an_angle_are_those_of_an_actuator(tmp_path: Path) -> None:
    columns = {
        "time [s]": TIME,
        "torque [N*m]": TORQUE,
        "current [A]": np.sin(4 * TIME) + np.sin(7 * TIME),
        "speed [rad/s]": np.cos(9 * TIME),
    }

    draft = drafted(tmp_path / "a.csv", columns)

    for column in ("torque_m", "current", "omega_m"):
        assert f"\n  {column}: {{" in draft


def test_a_matrix_without_signals_is_one_line(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).standard_normal((500, 58))
    np.savez(tmp_path / "a.npz", calibration=noise)

    draft = draft_source(inspect_file(tmp_path / "a.npz"), "a.npz")

    assert '"calibration": left out: 58 of its columns' in draft
    assert draft.count("calibration") == 1
