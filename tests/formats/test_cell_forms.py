# SPDX-License-Identifier: Apache-2.0
"""Numbers that stand in a pattern of text, headers that begin with a number, and stamps in two
columns are read as what they are."""

import numpy as np
import pytest
from conftest import said_in_refusal
from log_builders import ankle
from recognised_files import source_of

from osl_analysis import formats
from osl_analysis.base.recording import Kind
from osl_analysis.formats.text_cells import FIRST_LINES, LAST_LINES

TIME, ANGLE, TORQUE = ankle(50)
LONG = FIRST_LINES + LAST_LINES + 200  # lines of a text that is read in parts


def recording_of(folder, lines):
    path = folder / "log.csv"
    path.write_text("\n".join(lines) + "\n")
    return formats.read(path)


def values(recording, name):
    return recording.find({"column": name}).values


# --- one pattern in every cell ------------------------------------------------------------------

FORMS = {
    "np.float64({})": "",
    "tensor({})": "",
    "[{}]": "",
    "{} Nm": "Nm",
    "torque:{}": "",
    "torque = {} Nm;": "Nm",
}


@pytest.mark.parametrize("rows", [50, LONG])
@pytest.mark.parametrize(("form", "unit"), FORMS.items())
def test_a_number_in_one_pattern_of_text_is_read(tmp_path, form, unit, rows):
    time, angle, torque = ankle(rows)
    lines = [
        f"{t:.3f}\t{a:.5f}\t{form.format(f'{m:.5f}')}"
        for t, a, m in zip(time, angle, torque, strict=True)
    ]

    recording = recording_of(tmp_path, ["t\tangle\tload", *lines])

    np.testing.assert_allclose(values(recording, "load"), torque, atol=1e-5)
    assert recording.find({"column": "load"}).unit == unit
    assert "the number alone is read" in " ".join(recording.loss.remarks)


def test_the_name_before_each_number_is_that_of_a_column_without_one(tmp_path):
    lines = [f"angle:{a:.5f}\ttorque:{m:.5f}" for a, m in zip(ANGLE, TORQUE, strict=True)]

    recording = recording_of(tmp_path, lines)

    np.testing.assert_allclose(values(recording, "torque"), TORQUE, atol=1e-5)


def test_a_column_whose_pattern_changes_keeps_its_text(tmp_path):
    lines = [
        f"{t:.3f},{m:.4f} {'N' if row % 2 else 'kg'}"
        for row, (t, m) in enumerate(zip(TIME, TORQUE, strict=True))
    ]
    path = tmp_path / "log.csv"
    path.write_text("t,load\n" + "\n".join(lines) + "\n")
    source = source_of(
        "csv",
        time={"column": "t", "unit": "s"},
        channels={"torque": {"column": "load", "unit": "N*m"}},
    )

    recording = formats.read(path, source)

    message = said_in_refusal(lambda: values(recording, "load"))
    assert "'load' holds no number" in message
    assert "`missing`" not in message


@pytest.mark.parametrize("sign", ["_", "'", " "])
def test_a_sign_between_thousands_is_no_pattern(tmp_path, sign):
    lines = [f"{t:.3f},1{sign}{row:03d}.5" for row, t in enumerate(TIME)]

    recording = recording_of(tmp_path, ["t,load", *lines])

    assert np.isnan(values(recording, "load")).all()
    assert not recording.loss.remarks


@pytest.mark.parametrize("rows", [50, LONG])
@pytest.mark.parametrize("sign", [",", "\t", " "])
def test_the_arrow_of_a_serial_monitor_is_a_sign_between_cells(tmp_path, sign, rows):
    _, angle, torque = ankle(rows)
    head = f"09:04:50.196 -> angle{sign}torque"
    lines = [
        f"09:0{4 + row // 6000}:{50 + row // 100 % 10}.{row % 100:02d}0 -> {a:.5f}{sign}{m:.5f}"
        for row, (a, m) in enumerate(zip(angle, torque, strict=True))
    ]

    recording = recording_of(tmp_path, [head, *lines])

    np.testing.assert_allclose(values(recording, "angle"), angle, atol=1e-5)
    assert recording.channels[0].kind == Kind.CLOCK
    assert np.unique(np.diff(values(recording, "1"))[:99]) == [10_000_000]


# --- headers ------------------------------------------------------------------------------------


@pytest.mark.parametrize("first", ["1784012345.4821", "0", "12:00:00.100"])
def test_a_header_may_begin_with_a_number(tmp_path, first):
    lines = [f"{t:.3f},{a:.5f},{m:.5f}" for t, a, m in zip(TIME, ANGLE, TORQUE, strict=True)]

    recording = recording_of(tmp_path, [f"{first},POSITION_FB,TORQUE_SENS", *lines])

    assert [channel.name for channel in recording.channels] == ["1", "POSITION_FB", "TORQUE_SENS"]
    np.testing.assert_allclose(values(recording, "TORQUE_SENS"), TORQUE, atol=1e-5)
    assert recording.channels[0].rows.count == 50


def test_a_first_row_with_a_word_among_numbers_is_no_header(tmp_path):
    lines = [f"{t:.3f},{a:.5f},{m:.5f}" for t, a, m in zip(TIME, ANGLE, TORQUE, strict=True)]
    lines[0] = "0.000,Overload,30"

    recording = recording_of(tmp_path, ["t,angle,torque", *lines])

    assert recording.channels[0].rows.count == 50


@pytest.mark.parametrize("rows", [50, LONG])
def test_a_header_that_stands_again_is_left_out(tmp_path, rows):
    lines = [f"{t:.3f},{a:.5f},{m:.5f}" for t, a, m in zip(*ankle(rows), strict=True)]
    lines.insert(rows // 2, "t,angle,torque")

    recording = recording_of(tmp_path, ["t,angle,torque", *lines])

    np.testing.assert_allclose(values(recording, "torque"), ankle(rows)[2], atol=1e-5)
    assert f"again in line {rows // 2 + 2}" in " ".join(recording.loss.remarks)


@pytest.mark.parametrize(
    ("first", "names"), [(1, ["1", "t", "angle"]), (0.5, None)], ids=["row names", "no names"]
)
def test_a_header_with_a_name_too_few_lacks_that_of_the_row_numbers(tmp_path, first, names):
    lines = [
        f"{row + first} {t:.3f} {a:.5f}" for row, (t, a) in enumerate(zip(TIME, ANGLE, strict=True))
    ]
    path = tmp_path / "log.txt"
    path.write_text("\n".join(["t angle", *lines]) + "\n")

    if names is None:
        assert "3 cells under 2 names" in said_in_refusal(formats.read, path)
    else:
        assert [channel.name for channel in formats.read(path).channels] == names


# --- clocks -------------------------------------------------------------------------------------


@pytest.mark.parametrize("ticks", [10**3, 10**6, 10**9])
@pytest.mark.parametrize("rows", [300, LONG])
def test_seconds_and_their_rest_in_two_columns_are_one_clock(tmp_path, ticks, rows):
    stamps_ns = 1_784_012_345_731_000_000 + 10_000_000 * np.arange(rows)
    seconds, rest = np.divmod(stamps_ns, 10**9)
    lines = [
        f"{s},{r * ticks // 10**9},{row / 7:.5f}"
        for row, (s, r) in enumerate(zip(seconds, rest, strict=True))
    ]

    recording = recording_of(tmp_path, lines)

    clock = recording.find({"column": "1 + 2"})
    assert clock.kind == Kind.CLOCK
    np.testing.assert_array_equal(clock.values, stamps_ns)


def test_a_count_beside_whole_numbers_is_no_clock_of_two_columns(tmp_path):
    lines = [f"{row // 7},{(row * row) % 1000},{row / 7:.5f}" for row in range(300)]

    names = [channel.key for channel in recording_of(tmp_path, lines).channels]

    assert names == ["1", "2", "3"]


def test_minutes_and_seconds_are_a_time(tmp_path):
    lines = [f"{row // 600:02d}:{row / 10 % 60:04.1f},{row}" for row in range(1300)]

    stamps = recording_of(tmp_path, ["elapsed,count", *lines]).channels[0].values

    np.testing.assert_array_equal(stamps, 100_000_000 * np.arange(1300))
