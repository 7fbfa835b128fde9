# SPDX-License-Identifier: Apache-2.0
"""Recordings as text: tables."""

import re
from functools import partial

import numpy as np
import pytest
from conftest import refused_with, said_in_refusal
from log_builders import ankle, table_text, written

from osl_analysis import formats
from osl_analysis.base.errors import InputError
from osl_analysis.base.units import in_si, normalised
from osl_analysis.formats import known_formats

TIME, ANGLE, TORQUE = ankle(900)  # long enough that polars splits the middle of the text
table = partial(table_text, t=written(TIME), a=written(ANGLE), m=written(TORQUE))


def read(folder, content, name="a.csv", **stated):
    """A recording, by a source file if fields of one are stated."""
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    if not stated:
        return formats.read(path)
    return formats.read(path, known_formats()[stated["format"]].source.model_validate(stated))


def refusal(folder, content, name="a.csv", **stated):
    def read_all():
        for channel in read(folder, content, name, **stated).channels:
            channel.read()

    return said_in_refusal(read_all)


def csv_source(**stated):
    """A source file of a table in CSV."""
    channels = {"theta": {"column": "Ankle angle", "unit": "deg"}}
    return {"format": "csv", "time": {"column": "Time"}, "channels": channels, **stated}


def column(recording, name):
    return recording.find({"column": name}).values


# --- tables of text -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("12:00:00.5", "12:00:01.75"),
        ("11:59:59.5 AM", "12:00:00.75 PM"),
        ("12:59:59.5 AM", "01:00:00.75 AM"),
        ("2024-05-01T08:00:00.5+02:00", "2024-05-01T08:00:01.75+02:00"),
        ("0 days 00:00:00.5", "0 days 00:00:01.75"),
        ("0.5 sec", "1.75 sec"),
    ],
)
def test_times_of_any_writing_are_on_one_clock(tmp_path, first, second):
    clock = read(tmp_path, f"time;a\n{first};1.5\n{second};2.5\n").find({"column": "time"})

    assert np.diff(clock.values).tolist() == [1_250_000_000]


def test_a_truth_value_that_is_no_pulse_is_refused(tmp_path):
    content = "t;a\n0;1.5\n1;True\n2;2.5\n3;2.0\n"
    stated = csv_source(
        channels={"theta": {"column": "a", "unit": "deg"}}, time={"column": "t", "unit": "s"}
    )

    message = refusal(tmp_path, content, **stated)

    assert "'True'" in message


def test_rows_that_do_not_fit_are_refused_by_line_or_skipped_and_counted(tmp_path):
    lines = table().splitlines(keepends=True)
    odd = "".join([*lines[:500], "0.5,1\n", *lines[500:]])

    message = refusal(tmp_path, odd, **csv_source())
    skipped = read(tmp_path, odd, **csv_source(damaged="skip"))

    assert re.search("line 501 .* 2 .* 3 .* 1 .* 901 .*repair these", message)
    again = refusal(tmp_path, "".join(["Gain 4\n", *lines, "Gain 4\n", *lines[1:]]), **csv_source())
    assert f"before line {len(lines) + 2}," in again
    assert (skipped.loss.read, skipped.loss.expected) == (900, 901)
    np.testing.assert_allclose(column(skipped, "Torque"), TORQUE, atol=1e-9)


@pytest.mark.parametrize(("sign", "decimal"), [(",", "."), (";", ","), ("  ", "."), (", ", ".")])
@pytest.mark.parametrize("missing", [["", "nan"], ["-999"]])
@pytest.mark.parametrize(
    "amid",
    [
        "-999",
        "",
        "nan",
        "NaN",
        " 1@5 ",
        '"1@5"',
        "+1@5",
        "7",
        "inf",
        "ok",
        "1.5",
        "#",
        "1 2",
    ],
)
def test_a_cell_amid_a_long_text_is_read_as_in_a_short_one(tmp_path, sign, decimal, missing, amid):
    """Polars reads the middle of a long text."""
    lines = table(sign, decimal=decimal).splitlines(keepends=True)
    cells = lines[450].split(sign)
    lines[450] = sign.join([cells[0], amid.replace("@", decimal), cells[2]])
    stated = csv_source(missing=missing, most_missing=0.5)

    def angle(text):
        try:
            return column(read(tmp_path, text, **stated), "Ankle angle").tolist()
        except InputError:
            return "refused"

    of_long = angle("".join(lines))
    of_short = angle("".join([lines[0], *lines[440:460]]))
    if isinstance(of_long, list):
        of_long = of_long[439:459]
    assert str(of_long) == str(of_short)


@pytest.mark.parametrize("amid", ["-7", "-7.5"])
def test_numbers_of_a_long_text_keep_their_last_digit_and_their_line(tmp_path, amid):
    stamps = [str(1_700_000_000_000_000_000 + 2_000_001 * row) for row in range(900)]
    other = ["8"] * 450 + [amid] + ["8"] * 449
    rows = [f"{stamp},{number}\n" for stamp, number in zip(stamps, other, strict=True)]

    recording = read(tmp_path, "Time [ns],Level\n" + "".join(rows), **csv_source())

    assert column(recording, "Time").tolist() == [int(stamp) for stamp in stamps]
    assert column(recording, "Level").tolist() == [*map(float, other)]
    assert recording.channels[0].rows.place(899) == "line 901"


NUMBERS = [f"{k / 100},{k % 7},{k % 5}" for k in range(40)]


@pytest.mark.parametrize(("head", "names", "units"), [
    (["Time,1,2", ",ANGLE,TORQUE", ",joint,shaft", "s,deg,Nm"],
     ["Time", "ANGLE joint", "TORQUE shaft"], ["s", "deg", "Nm"]),
    (["t,Position,Torque", "clock,encoder 1,object 6077h", "(s),(deg),(Nm)"],
     ["t", "Position", "Torque"], ["s", "deg", "Nm"]),
    (["Device,Encoder,Load cell", "Time,Angle,Torque", "s,deg,Nm", "raw,raw,scaled"],
     ["Time", "Angle", "Torque"], ["s", "deg", "Nm"]),
    (["CH1,angle,20deg", "CH2,torque,50Nm", "No.,CH1 angle,CH2 torque", ",deg,Nm"],
     ["No.", "CH1 angle", "CH2 torque"], ["", "deg", "Nm"]),
    (["Device,Bench 2", "Clock,ESP32,us", "", "Interval,Encoder,Torque", "us,deg,Nm"],
     ["Interval", "Encoder", "Torque"], ["us", "deg", "Nm"]),
    (["s,deg,Nm", "t,Position,Torque"], ["t", "Position", "Torque"], ["s", "deg", "Nm"]),
    (["/leg/t[s],/leg/q[deg],/leg/effort[ankle]"],
     ["/leg/t", "/leg/q", "/leg/effort[ankle]"], ["s", "deg", ""]),
    (["t [s],Î¸ [Â°],M [â€°]"], ["t", "θ", "M"], ["s", "°", "‰"]),
    (["Model,DLM4058", "TraceName,ANGLE,TORQUE", "VUnit,V,V", "Time,09:15:41.25,09:15:41.25"],
     ["1", "ANGLE", "TORQUE"], ["", "V", "V"]),
])  # fmt: skip
def test_names_stand_over_units_or_behind_their_key(tmp_path, head, names, units):
    path = tmp_path / "a.csv"
    path.write_text("\n".join([*head, *NUMBERS, ""]))

    channels = formats.read(path).channels

    assert [channel.name for channel in channels] == names
    assert [channel.unit for channel in channels] == units


def test_a_degree_in_the_code_page_of_a_console_is_one(tmp_path):
    text = "\n".join(["t [s],a [Ä],q [Nm]", *NUMBERS, ""])
    (tmp_path / "a.csv").write_bytes(text.encode("latin-1"))

    angle = formats.read(tmp_path / "a.csv").channels[1]

    assert in_si(normalised(angle.unit)) == in_si("deg")


def test_rows_that_lack_a_sign_between_cells_are_refused_with_one(tmp_path):
    (tmp_path / "a.csv").write_text(
        "\n".join(["t,a,q", *(f"{k}-0.04,{k % 5}" for k in range(40)), ""])
    )

    with refused_with("2 cells under 3 names, '0-0.04.* 40 of 40 "):
        formats.read(tmp_path / "a.csv")
