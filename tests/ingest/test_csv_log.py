# SPDX-License-Identifier: Apache-2.0
"""CSV logs and units: what others' loggers write is read, repaired by a stated rule, or refused by
its line."""

import json
import math
import re

import numpy as np
import pint
import pytest
import yaml
from conftest import ROOT, refused_with
from recognised_files import refusal_by

from osl_analysis.base.units import (
    EXAMPLES,
    NAME,
    SI_UNITS,
    in_si,
    name_for_pint,
    si_factor,
)
from osl_analysis.ingest.raw_files import read_converted, read_source, trial_from_files

SOURCE = {
    "format": "csv",
    "time": {"column": "t", "unit": "s"},
    "channels": {
        "theta": {"column": "angle", "unit": "rad"},
        "torque": {"column": "load", "unit": "Nm"},
    },
}


ROW = {"trial": "a", "log": "log.csv", "log_source": "source"}


def ingested(folder, text, **fields):
    """The trial of a log, by a source file with other fields than the usual."""
    (folder / "log.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
    (folder / "source.yaml").write_text(yaml.safe_dump({**SOURCE, **fields}, sort_keys=False))
    return trial_from_files(ROW, folder, folder)


@pytest.mark.parametrize("weight", [0.5, 0.0])
def test_a_fixture_is_in_the_provenance_and_the_torque_as_recorded(tmp_path, weight):
    """One of 0 is a value, too: nothing turns with the joint."""
    bare = ingested(tmp_path, LOG)
    row = ROW | {"fixture_weight": weight, "fixture_rest_deg": None}
    trial = trial_from_files(row, tmp_path, tmp_path)
    assert trial.provenance["columns"]["torque"]["fixture"] == {"weight": weight}
    assert trial.samples["torque"].equals(bare.samples["torque"])


def refused(folder, text, **fields):
    """What is said to a log, in one printable line."""
    return refusal_by(ingested, folder, text, **fields)


UNITLESS = {
    "channels": {"theta": {"column": "angle"}, "torque": {"column": "load"}},
    "time": {"column": "t"},
}
NUMBERED = {"theta": {"column": 2, "unit": "rad"}, "torque": {"column": 3, "unit": "Nm"}}
LOG = "t,angle,load\n10.0,0,1\n10.5,90,2\n11.0,-180,+3.5\n"


def assert_log(trial):
    np.testing.assert_allclose(trial.samples["time"], [0, 0.5, 1.0], rtol=1e-12)
    np.testing.assert_allclose(trial.samples["theta"], [0, 90, -180], rtol=1e-12)
    np.testing.assert_allclose(trial.samples["torque"], [1, 2, 3.5], rtol=1e-12)


@pytest.mark.parametrize(
    ("text", "fields"),
    [
        (b"\xfe\xff" + LOG.encode("utf-16-be"), {}),
        ("# Bench 3, calibrated\n#\n" + LOG.replace("10.5", "  # pause\n10.5"), {}),
        ("% rig B\n" + LOG.replace("10.5", "% pause\n10.5"), {"channels": NUMBERED}),
        (LOG.partition("\n")[2], {"time": {"column": 1, "unit": "s"}, "channels": NUMBERED}),
        (LOG.replace("t,angle,load", "t [s],angle (rad),load[N.m]"), UNITLESS),
    ],
)
def test_one_log_in_any_dress_is_one_log(tmp_path, text, fields):
    assert_log(ingested(tmp_path, text, **fields))


@pytest.mark.parametrize(
    ("text", "fields", "problem"),
    [
        ("t,angle,load\n", {}, "log.csv: "),
        (LOG.partition("\n")[2], {}, "'t'.* 1, 2, 3"),
        (LOG, {"channels": {"theta": {"column": 4, "unit": "rad"}}}, "'4'.* t, angle"),
        (LOG.replace("90", "deg"), {}, "line 3, column 'angle': 'deg'"),
        ("t;angle;load\n0;1,5;2\n0,1;1.234;3\n", {}, "'angle': '1,5'"),
        (LOG.replace("90", '"90'), {}, "line 3: "),
        (LOG, {"channels": {"theta": {"column": "angle"}}}, "column 'angle': .*rad"),
    ],
)
def test_what_cannot_be_read_is_refused_by_line_or_column(tmp_path, text, fields, problem):
    assert re.search(problem, refused(tmp_path, text, **fields))


def test_the_shipped_source_file_reads_the_logger_of_opensourceleg(
    tmp_path,
):
    """Recorded with the package's own logger, row k at k ms."""
    osl_logging = pytest.importorskip(
        "opensourceleg.logging", reason="the package opensourceleg is not installed"
    )
    logger = osl_logging.LOGGER  # there is one in a process
    logger._log_path = str(tmp_path)  # its constructor would take the folder of the call before
    logger.set_file_name("trial")
    logger.set_stream_level(osl_logging.LogLevel.CRITICAL)
    k = 0
    functions = {
        "time": lambda: k * 1e-3,
        "joint_position": lambda: np.cos(k / 50),
        "output_position": lambda: np.sin(k / 50),
        "motor_current": lambda: 100.0 * k,
        "sync": lambda: k % 100 < 50,
    }
    logger.track_function(list(functions.values()), list(functions))
    for k in range(400):  # noqa: B007
        logger.update()
    logger.close()
    logger.reset()
    shipped = read_source(ROOT / "config/sources/opensourceleg.yaml")

    samples = read_converted(tmp_path / "trial.csv", shipped).samples

    rows = np.arange(400)
    np.testing.assert_allclose(samples["time"], rows * 1e-3, atol=1e-12)
    np.testing.assert_allclose(samples["theta"], np.cos(rows / 50), atol=1e-12)
    np.testing.assert_allclose(samples["theta_m"], np.sin(rows / 50), atol=1e-12)
    np.testing.assert_allclose(samples["current"], 0.1 * rows, atol=1e-12)
    np.testing.assert_array_equal(samples["sync"], rows % 100 < 50)


@pytest.mark.parametrize("cut", ["11.5,17", "11.5,17,12"])
def test_a_cut_last_line_is_told(tmp_path, cut):
    trial = ingested(tmp_path, LOG + cut)
    assert_log(trial)
    (said,) = trial.provenance["warnings"]
    assert re.search("log.csv: .* 5, ", said)
    damage = trial.provenance["damage"]["log"]
    assert (damage["end_missing"], damage["read"], damage["lost"]) == (True, 3, None)


@pytest.mark.parametrize(
    ("stated", "in_file", "is_told"),
    [
        ({"unit": "lbf*in"}, "N*m", True),
        ({"unit": "N*m"}, "Nm", False),
        ({"unit": "N*m", "scale": 1.03}, "Nm", False),
        ({"unit": "N*m", "scale": 0.001}, "mNm", False),
        ({"unit": "N*m"}, "mNm", True),
        ({"unit": "N*m"}, "kNm", False),
        ({"unit": "rad"}, "mrad", False),
        ({"unit": "N*m", "scale": 12.5}, "V", False),
        ({"unit": "N*m", "scale": 1.09}, "N*m", False),
        ({"unit": "N*m", "scale": 1.15}, "N*m", True),
    ],
)
def test_a_unit_that_contradicts_the_file_is_told_from_a_calibration(
    tmp_path, stated, in_file, is_told
):
    text = LOG.replace("load", f"load [{in_file}]")

    name = "theta" if stated["unit"] == "rad" else "torque"
    trial = ingested(tmp_path, text, channels={name: {"column": "load", **stated}})

    assert ("unit_of_file" in trial.provenance["columns"][name]) == is_told


@pytest.mark.parametrize(
    ("name", "unit", "in_file", "largest", "is_possible"),
    [
        ("torque", "N*m", "mNm", 0.9e6, True),
        ("torque", "N*m", "mNm", 1.1e6, False),  # more than 1000 N*m
        ("theta", "rad", "mrad", 5.0, True),
        ("theta", "rad", "mrad", 4.0, False),  # less than 4.4 mrad, a quarter of a degree
        ("theta", "rad", "mrad", 1100.0, True),
        ("theta", "rad", "mrad", 1300.0, False),  # more than 1.2 rad
    ],
)
def test_the_unit_of_a_file_is_proposed_if_a_joint_can_have_its_values(
    tmp_path, name, unit, in_file, largest, is_possible
):
    text = f"t,value [{in_file}]\n" + "".join(
        f"{row / 100},{largest * math.sin(math.pi * row / 100)}\n" for row in range(101)
    )
    channels = {name: {"column": "value", "unit": unit}}

    trial = ingested(tmp_path, text, channels=channels)

    assert ("unit_of_file" in trial.provenance["columns"][name]) == is_possible


def test_what_is_stated_of_a_sensor_is_in_si_units_in_the_provenance(tmp_path):
    stated = {
        "delay": "2 ms",
        "low_pass": {"cutoff": "0.1 kHz", "order": 2},
        "resolution": "10 N*mm",
        "range": ["-20 N*m", "60 N*m"],
        "sign": -1,
        "scale": 2,
        "offset": 5,
    }

    trial = ingested(tmp_path, LOG, **load(**stated))

    torque = trial.provenance["columns"]["torque"]
    assert torque["low_pass"] == {"cutoff_hz": 100.0, "order": 2}
    assert torque["delay"] == 0.002
    assert torque["resolution"] == pytest.approx(0.01)
    assert torque["range"] == [-70, 10]
    assert trial.samples["torque"].to_list() == [-12, -14, -17]


def advised(message):
    """The fields that a message says to write, as `name: value` in backquotes."""
    written = re.findall(r"`(\w+: [^`]+)`", message)
    return {key: value for text in written for key, value in yaml.safe_load(text).items()}


TABLE = "t,angle,load\n0,1,5\n0.01,2,6\n0.02,3,7\n0.03,4,8\n"
SAMPLES = {"theta": [1, 2, 3, 4], "torque": [5, 6, 7, 8]}


def assert_samples(trial, **columns):
    for name, values in (columns or SAMPLES).items():
        np.testing.assert_array_equal(trial.samples[name], values)


def test_devices_with_rows_of_their_own_are_joined_as_topics_are(tmp_path):
    rows = "".join(f"{k / 100},{k},\n{k / 100 + 0.0031},,{2 * k}\n" for k in range(50))

    trial = ingested(tmp_path, "t,angle,load\n" + rows)

    for column, late in (("theta", 0.0), ("torque", 0.0031)):
        time, values = trial.arrays(column)
        np.testing.assert_allclose(time, np.arange(50) / 100 + late, atol=1e-9)
        assert np.ptp(np.diff(values)) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(
    ("text", "stated", "told", "samples"),
    [
        (TABLE.replace("0.02,", "0.015,9\n0.02,"), {"most_missing": 0.2}, "line 4 ", SAMPLES),
        (TABLE.replace("0.02,3,7", "0.02,3"), {"damaged": "skip"}, "line 4 ", {"theta": [1, 2, 4]}),
        (
            TABLE.replace("2,6", "-9999.0,6"),
            {"missing": ["-9999"]},
            "'angle'.* 1 ",
            {"theta": [1, np.nan, 3, 4]},
        ),
        (TABLE.replace("2,6", "nan(ind),6"), {}, "'angle'.* 1 ", {"theta": [1, np.nan, 3, 4]}),
        (re.sub(r"^0\.0\d", "0", TABLE, flags=re.M), {}, "'t'.* 0 s .* 4 .* 4 .* 2 ", SAMPLES),
    ],
)
def test_the_log_is_read_as_the_refusal_says(tmp_path, text, stated, told, samples):
    message = refused(tmp_path, text, **stated)
    assert re.search(told, message)
    if samples:
        assert_samples(
            ingested(tmp_path, text, **stated | advised(message.replace("HZ", "100"))), **samples
        )


def test_one_row_a_clock_that_stops_and_one_too_coarse_are_no_log(tmp_path):
    time = np.arange(200) * 0.004
    for stamps, told in (
        (time[:1], "log.csv: "),
        (
            np.minimum(time, time[150]),
            "0.6 s .* 50 .* 200 .* 152 ",
        ),
        (1.773e9 + 128 * (time > 0.5), "1773000000 s .* 126 .* 200 "),
    ):
        text = "t,angle,load\n" + "".join(
            f"{t},{k},{k % 7}\n" for k, t in enumerate(stamps.tolist())
        )
        assert re.search(told, refused(tmp_path, text))


LOGGER = (
    "time,<__main__.Joint object at 0x7fe6c0>.output_position,<__main__.Joint object at"
    " 0x7fe6c0>.current\n0,1,5\n"
)


def test_a_pattern_finds_a_column_whose_name_changes_from_run_to_run(
    tmp_path,
):
    theta = {"column": "*.output_position", "unit": "rad"}
    torque = {"column": "<*>.current", "unit": "Nm"}
    for address in ("0x7fe6c0", "0x55d1a2b3"):
        text = (LOGGER + "0.01,2,6\n0.02,3,7\n0.03,4,8\n").replace("0x7fe6c0", address)
        channels = {"theta": theta, "torque": torque}
        trial = ingested(tmp_path, text, channels=channels, time={"column": "ti*", "unit": "s"})
        assert_samples(trial)
        origin = trial.provenance["columns"]["theta"]
        found = f"<__main__.Joint object at {address}>.output_position"
        assert (origin["column"], origin["found"]) == ("*.output_position", found)


def test_repeated_stamps_are_kept_with_a_warning_and_dropped_as_it_says(tmp_path):
    text = TABLE.replace("0.02,3,7", "0.01,2,6.5\n0.02,3,7")
    kept = ingested(tmp_path, text)
    (warning,) = kept.provenance["warnings"]
    assert re.search("1 .* 5", warning)
    assert len(kept.samples) == 5
    dropped = ingested(tmp_path, text, time=SOURCE["time"] | advised(warning))
    assert_samples(dropped)


def test_rows_that_stand_twice_are_read_once_as_the_refusal_says(
    tmp_path,
):
    rows = [f"{k / 500},{k % 7},{k % 5}\n" for k in range(100)]
    twice = "t,angle,load\n" + "".join(2 * row for row in rows)
    message = refused(tmp_path, twice)
    assert re.search("100 .* 200", message)
    read = ingested(tmp_path, twice, time=SOURCE["time"] | advised(message))
    np.testing.assert_allclose(read.samples["time"], np.arange(100) / 500)


def load(**stated):
    """A source file's channel of the torque, of whose sensor something is stated."""
    return {"channels": {"torque": {"column": "load", "unit": "Nm", **stated}}}


@pytest.mark.parametrize(
    ("fields", "told"),
    [
        ({"time": {"column": "t", "unit": "s", "rate": 9}}, "time.* rate"),
        ({"time": {"column": "t", "rate": 9}}, "0.01 .*line 3"),
        ({"channels": {"plate": {"column": "a", "unit": "N"}}}, "'plate'"),
        (
            {
                "channels": {
                    name: {"column": "angle", "unit": "rad"} for name in ("theta", "theta_m")
                }
            },
            "theta_m.column: .*'angle'.*theta",
        ),
        (load(delay="soon"), "'soon'.*`2 s`"),
        (load(delay="-2 ms"), "other channels are late.* 0 .*0.2 s"),
        (load(low_pass={"cutoff": "0.4 Hz"}), r" 0\.5 .*1e\+06 Hz"),
        (load(resolution="0.1 deg"), "'0.1 deg'.* rad"),
        (load(range=["5 N*m", "5 N*m"]), "range.*5"),
    ],
)
def test_a_mistake_in_a_source_file_is_answered_with_what_to_write(tmp_path, fields, told):
    assert re.search(told, refused(tmp_path, TABLE, **fields))


def test_nanoseconds_since_1970_keep_their_last_digit(tmp_path):
    stamps = [1_700_000_000_000_000_001 + 1_000_003 * n for n in range(4)]
    rows = "".join(f"{stamp},{n},{n}\n" for n, stamp in enumerate(stamps))
    trial = ingested(tmp_path, f"t,angle,load\n{rows}", time={"column": "t", "unit": "ns"})
    np.testing.assert_allclose(trial.samples["time"], np.arange(4) * 1.000003e-3, rtol=1e-12)
    assert f'"start": {stamps[0]}' in json.dumps(trial.provenance)


@pytest.mark.parametrize(
    ("unit", "expected", "factor"),
    [
        ("Degrees", "rad", math.pi / 180),
        ("º", "rad", math.pi / 180),
        ("Newtonmeter/Grad", "N*m/rad", 180 / math.pi),
        ("%", "1", 0.01),
        ("N·mm", "N*m", 1e-3),
        ("µs", "s", 1e-6),
        (" mA ", "A", 1e-3),
        ("N.m.", "N*m", 1.0),
        ("MS", "s", 1e-3),
    ],
)
def test_a_laboratorys_spelling_has_its_factor(unit, expected, factor):
    assert si_factor(unit, expected) == pytest.approx(factor, rel=1e-15)


def test_the_listed_units_are_those_of_pint():
    for units in EXAMPLES.values():
        for unit in units:
            text = re.sub(NAME, name_for_pint, unit)
            of_pint = pint.application_registry.Quantity(1.0, text).to_base_units()
            assert in_si(unit) == (of_pint.magnitude, SI_UNITS[str(of_pint.units)])


@pytest.mark.parametrize(
    ("unit", "expected", "told"),
    [
        ("mmm", "m", "unit 'mmm'.*m, cm, mm"),
        # torque and stiffness differ
        ("Nm", "N*m/rad", r"unit 'Nm'.*1 N\*m;.*N\*m/rad"),
        ("deg", "N", r"unit 'deg'.*0\.0174533 rad;.*N,"),
        ("Mm", "m", r"1e\+06 m;.*m"),
        # a row of units without one; pint raises an error that is none of its own
        ("nan", "m", "unit 'nan' is unknown"),
        # text of a file is never evaluated
        ("9**9**9**9", "m", r"'9\*\*9"),
        ("m*" * 5000, "m", r"'m\*m"),
    ],
)
def test_a_unit_that_cannot_be_is_refused_with_what_would_do(unit, expected, told):
    with refused_with(told):
        si_factor(unit, expected)
