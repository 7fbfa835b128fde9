# SPDX-License-Identifier: Apache-2.0
"""Logs in JSON lines and TDMS: numbers at any depth and of any timing, and nothing is lost without
a word."""

import json
import math
import re
import struct
from functools import partial

import numpy as np
import pytest
import yaml
from conftest import ROOT
from log_builders import write_tdms
from recognised_files import read_recognised, refusal_of

from osl_analysis import formats
from osl_analysis.base.recording import End
from osl_analysis.commands.trials import inspect_file
from osl_analysis.draft.draft_source import draft_source
from osl_analysis.ingest.raw_files import read_converted, read_source

ROWS = 200
TORQUE = {"column": "functions.torque", "unit": "N*m", "sign": -1}
SOURCE = {
    "format": "table",
    "time": {"column": "variables.time", "unit": "ms"},
    "channels": {"theta": {"column": "variables.ankle_angle", "unit": "deg"}, "torque": TORQUE},
}


def rust_lines():
    """Objects as the recorder of the Open-Source Leg in Rust writes them: an angle of k degrees, a
    torque of -k / 2."""
    variables = [
        {"time": 2.0 * k + 17, "ankle_angle": float(k), "on": k % 2 == 0} for k in range(ROWS)
    ]
    return [{"variables": one, "functions": {"torque": -k / 2}} for k, one in enumerate(variables)]


def write(path, lines, end="\n"):
    path.write_text(
        "\n".join(one if isinstance(one, str) else json.dumps(one) for one in lines) + end
    )
    return path


read = partial(read_recognised, **SOURCE)
refused = partial(refusal_of, **SOURCE)


def test_a_name_with_a_dot_is_quoted_and_never_taken_for_a_level(tmp_path):
    k = np.arange(20)
    lines = [{"t": 0.01 * n, "f": {"cell.mz": n + 0.5, "cell": {"mz": -n}}} for n in range(20)]
    fields = {"torque": 'f["cell.mz"]', "torque_m": "f.cell.mz"}
    channels = {f"signal_{name}": {"column": field, "unit": "1"} for name, field in fields.items()}

    samples = read(
        write(tmp_path / "a", lines), time={"column": "t", "unit": "s"}, channels=channels
    ).samples

    np.testing.assert_array_equal(samples["signal_torque"], k + 0.5)
    np.testing.assert_array_equal(samples["signal_torque_m"], -k)


def test_the_unit_of_a_clock_is_guessed_from_its_rate_and_never_for_a_count(tmp_path):
    steps = {
        1: "UNKNOWN",
        1.5e-4: "UNKNOWN",
        2e-4: "s",
        0.001: "s",
        0.02: "s",
        0.1: "UNKNOWN",
        2.0: "ms",
        500: "us",
        1e6: "ns",
    }
    for step, unit in steps.items():
        path = write(tmp_path / "a", [{"time": 7 + step * k, "q": 0.5} for k in range(30)])
        drafted = draft_source(inspect_file(path), "a")
        assert yaml.safe_load(drafted)["time"] == {"column": "time", "unit": unit}
        assert ("# time: " in drafted) == (unit != "UNKNOWN")


def test_a_line_that_is_no_json_is_refused_by_its_number(tmp_path):
    lines = rust_lines()
    lines[11] = '{"variables": {"time": 39.0, "ankle_an'
    assert "line 12" in refused(write(tmp_path / "a", lines))


def test_a_number_may_be_whole_in_one_part_of_a_log_alone(tmp_path):
    path = write(tmp_path / "a.jsonl", [{"t": k, "x": x} for k, x in enumerate((1, 2, 3.5, 4.5))])

    _, readings = formats.read(path).channels

    assert readings.values.tolist() == [1, 2, 3.5, 4.5]


def test_null_is_no_value_and_what_is_no_number_or_missing_is_refused(tmp_path):
    whole = write(tmp_path / "a", rust_lines())
    lines = rust_lines()
    for field, said in (
        ("variables.ankle_angel", "'variables.ankle_angel'.*'variables.ankle_angle'"),
        ("variables.on", "'variables.on'.* rad"),
    ):
        message = refused(whole, channels={"theta": {"column": field, "unit": "deg"}})
        assert re.search(said, message)
    lines[7]["functions"]["torque"], lines[9]["functions"]["torque"] = math.nan, None
    recording = read(write(tmp_path / "b", lines))
    assert recording.samples["torque"].is_nan().arg_true().to_list() == [7, 9]
    del lines[4]["variables"]["time"]
    assert re.search("'variables.time'.* row 5", refused(write(tmp_path / "b", lines)))


def test_the_shipped_source_file_for_the_recorder_in_rust_fits_its_lines(tmp_path):
    names = {"joint_position": 0.25, "output_position": 0.5, "motor_current": 1500}
    lines = [
        {"variables": {"time": k / 500, "sync": k % 50 < 25, **names}, "functions": {}}
        for k in range(100)
    ]
    source = read_source(ROOT / "config/sources/osl_rust.yaml")
    samples = read_converted(write(tmp_path / "a", lines), source).samples
    assert samples.drop("time", "sync").row(7, named=True) == {
        "theta": 0.25,
        "theta_m": 0.5,
        "current": 1.5,
    }
    np.testing.assert_array_equal(samples["sync"], np.arange(100) % 50 < 25)


SAMPLES = 100
START = np.datetime64("2024-05-01T12:00:00")
ANGLE = np.linspace(-10.0, 10.0, SAMPLES)
TORQUE = 40.0 * np.sin(np.arange(SAMPLES) / 7)
BENCH = {
    "format": "tdms",
    "channels": {
        "theta": {"channel": "Bench/Angle"},
        "torque": {"channel": "Torque", "unit": "lbf*in", "sign": -1},
    },
}


TIMING = {
    "wf_increment": 1e-3,
    "wf_start_offset": 0.0,
    "wf_start_time": START,
    "wf_samples": 1,
}


def test_a_channel_of_time_stamps_that_is_called_so_is_drafted_as_the_time(tmp_path):
    stamps = START + np.arange(SAMPLES) * np.timedelta64(1000, "us")
    path = write_tdms(
        tmp_path / "a.tdms",
        [("Time [s]", stamps, {}), ("Angle", ANGLE, {}), ("Torque", TORQUE, {})],
    )
    assert inspect_file(path).settings["time"] == {"channel": "Bench/Time [s]"}


read_tdms = partial(read_recognised, **BENCH)
refused_tdms = partial(refusal_of, **BENCH)


@pytest.mark.parametrize("segments", [1, 7])
def test_channels_with_timing_give_canonical_columns(tmp_path, segments):
    angle = ("Angle", ANGLE, TIMING | {"unit_string": "Degrees"})
    load = ("Torque", np.float32(TORQUE), TIMING | {"unit_string": "Volts"})

    recording = read_tdms(write_tdms(tmp_path / "a.tdms", [angle, load], segments))

    newton_metres = 4.4482216152605 * 0.0254  # lbf and in by definition
    torque = -np.float32(TORQUE).astype(float) * newton_metres
    for column, expected in (
        ("time", np.arange(SAMPLES) * 1e-3),
        ("theta", np.radians(ANGLE)),
        ("torque", torque),
    ):
        np.testing.assert_allclose(recording.samples[column], expected, rtol=1e-12, atol=1e-12)
    assert recording.origins["theta"]["unit"] == "Degrees"


def test_without_timing_the_file_is_refused_until_the_source_file_tells_it(tmp_path):
    k = np.arange(SAMPLES)
    signals = [("Angle", ANGLE, {"NI_UnitDescription": "deg"}), ("Torque", TORQUE, {})]
    stamped = START + k * np.timedelta64(2, "ms")
    path = write_tdms(tmp_path / "a.tdms", [*signals, ("t", k * 5.0, {}), ("Stamp", stamped, {})])
    assert "'Bench/Angle'" in refused_tdms(path)
    for time, step in (({"channel": "t", "unit": "ms"}, 5e-3), ({"channel": "Stamp"}, 2e-3)):
        np.testing.assert_allclose(read_tdms(path, time=time).samples["time"], k * step, atol=1e-9)
    alone = write_tdms(tmp_path / "b.tdms", signals)
    np.testing.assert_allclose(
        read_tdms(alone, time={"rate": 400}).samples["time"], k * 2.5e-3, atol=1e-9
    )


LINEAR = {"NI_Scale[0]_Linear_Slope": 2.0, "NI_Scale[0]_Linear_Y_Intercept": 1.0}


@pytest.mark.parametrize(
    ("kind", "parameters"), [("Linear", LINEAR), ("PieceWisePolynomial", {}), ("Spline", {})]
)
def test_a_scale_is_applied_or_its_channel_refused_by_name(tmp_path, kind, parameters):
    scale = {
        "NI_Number_Of_Scales": 1,
        "NI_Scaling_Status": "unscaled",
        "NI_Scale[0]_Scale_Type": kind,
        "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF,
    }
    angle = ("Angle", ANGLE, TIMING | {"unit_string": "deg"})
    torque = ("Torque", TORQUE, TIMING | scale | parameters)
    path = write_tdms(tmp_path / "a.tdms", [angle, torque])

    recording = formats.read(path)

    read_angle, read_torque = recording.channels
    np.testing.assert_allclose(read_angle.values, ANGLE)
    if parameters:
        np.testing.assert_allclose(read_torque.values, 2 * TORQUE + 1)
    else:
        assert re.search(f"Torque.*raw.*{kind}", refused_tdms(path))
        assert re.search(f"Torque.*raw.*{kind}", " ".join(inspect_file(path).remarks))


def test_a_segment_that_is_not_as_long_as_its_channels_say_is_refused(tmp_path):
    """Else the library would give one channel numbers of the next."""
    path = write_tdms(tmp_path / "a.tdms", [("Angle", ANGLE, {}), ("Torque", TORQUE, {})], 2)
    data = path.read_bytes()
    second = data.index(b"TDSm", 4)
    longer = struct.pack("<Q", second - 28 + 12)
    path.write_bytes(data[:12] + longer + data[20:second] + bytes(12) + data[second:])

    assert "contradict" in refused_tdms(path)


@pytest.mark.parametrize("lost", [1, 500, 1700])
def test_a_last_segment_that_is_cut_off_is_remarked(tmp_path, lost):
    path = write_tdms(tmp_path / "a.tdms", [("Angle", ANGLE, {}), ("Torque", TORQUE, {})], 2)
    path.write_bytes(path.read_bytes()[:-lost])

    loss = formats.read(path).loss

    assert loss.end == End.MISSING
    assert "did not finish" in " ".join(loss.remarks)


def bench_log(path, segments=1):
    """A log of angle and torque with the same timing."""
    angle = ("Angle", ANGLE, TIMING | {"unit_string": "deg"})
    return write_tdms(path, [angle, ("Torque", TORQUE, TIMING)], segments)


@pytest.mark.parametrize(("step_s", "late_s"), [(5e-3, 0.0), (1e-3, 0.02)])
def test_channels_of_other_timing_have_their_own_times(tmp_path, step_s, late_s):
    angle = ("Angle", ANGLE, TIMING | {"unit_string": "deg"})
    other = TIMING | {"wf_increment": step_s, "wf_start_offset": late_s}
    path = write_tdms(tmp_path / "a.tdms", [angle, ("Torque", TORQUE, other)])

    time = read_tdms(path).samples.drop_nulls("torque")["time"]

    np.testing.assert_allclose(time, late_s + step_s * np.arange(SAMPLES), atol=2e-9)


@pytest.mark.parametrize(
    ("channels", "reason"),
    [
        ({"Angle": ANGLE, "Torque": np.empty(0)}, "'Torque'.* Bench/Angle"),
        (
            {"Angle": ANGLE, "Torque": TORQUE, "B/Torque": TORQUE},
            "'Torque'.* Bench/Torque, Bench/B/Torque",
        ),
        ({"Angle": ANGLE, "Torqe": TORQUE}, "'Torque'.*'Torqe'"),
    ],
)
def test_a_channel_that_is_empty_ambiguous_or_mistyped_is_refused(tmp_path, channels, reason):
    units = {"Angle": {"unit_string": "deg"}}
    signals = [(name, values, TIMING | units.get(name, {})) for name, values in channels.items()]

    assert re.search(reason, refused_tdms(write_tdms(tmp_path / "a.tdms", signals)))


def test_an_angle_in_a_unit_of_length_is_refused_with_what_the_unit_is(tmp_path):
    furlongs = ("Angle", ANGLE, TIMING | {"unit_string": "furlongs"})
    path = write_tdms(tmp_path / "a.tdms", [furlongs, ("Torque", TORQUE, TIMING)])

    assert "201.168 m" in refused_tdms(path)


def test_numbers_of_the_other_byte_order_are_read(tmp_path):
    """A file put together by LabVIEW's description of the format: a segment of one channel, whose
    numbers are doubles, most significant byte first."""
    path = tmp_path / "a.tdms"
    double = 10
    is_big_endian = 0b1001110
    about = struct.pack(">2I16s3IQI", 1, 16, b"/'Bench'/'Angle'", 20, double, 1, SAMPLES, 0)
    lengths = struct.pack(">IQQ", 4713, len(about) + 8 * SAMPLES, len(about))
    head = b"TDSm" + struct.pack("<I", is_big_endian) + lengths
    path.write_bytes(head + about + ANGLE.astype(">f8").tobytes())

    angle = {"theta": {"channel": "Angle", "unit": "deg"}}
    samples = read_tdms(path, time={"rate": 400}, channels=angle).samples

    np.testing.assert_array_equal(samples["theta"], np.radians(ANGLE))


def test_a_file_that_is_cut_off_is_read_up_to_there_with_a_warning(tmp_path):
    path = bench_log(tmp_path / "a.tdms", segments=4)
    whole = path.read_bytes()

    # each segment has 25 numbers of the angle, then 25 of the torque, of 8 bytes
    path.write_bytes(whole[:-100])
    recording = read_tdms(path)
    assert len(recording.samples) == 75 + 100 // 8
    assert recording.warnings
    assert recording.losses["lost"] is None

    path.write_bytes(whole[: whole.rindex(b"TDSm") + 20])  # within its head
    assert read_tdms(path).warnings


@pytest.mark.recordings
def test_a_real_file_of_daqmx_is_scaled_as_its_properties_say(recordings):
    """Rows of seven 16-bit integers stand before its last segment; they are decoded here by
    hand."""
    path = recordings / "tdms" / "raw1.tdms"
    recording = read_tdms(path, channels={"sync": {"channel": "Third Chan", "unit": "V"}})
    content = path.read_bytes()
    end = content.rindex(b"TDSm")
    counts = np.frombuffer(content[end - 2000 * 7 * 2 : end], "<i2").reshape(2000, 7)[:, 2]
    np.testing.assert_allclose(
        recording.samples["sync"], counts * 0.0003051850947599719, rtol=1e-12
    )
