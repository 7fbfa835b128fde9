# SPDX-License-Identifier: Apache-2.0
"""Any table of a laboratory: one recording in many dialects is read by the draft that its own
overview makes."""

import datetime as dt
import re
from functools import partial
from itertools import zip_longest

import numpy as np
import polars as pl
import pytest
import xlsxwriter
from conftest import refused_with
from log_builders import HEAD, ankle, table_text, write_mat, written
from recognised_files import read_recognised

from osl_analysis.commands.trials import inspect_file
from osl_analysis.draft.draft_source import draft_source
from osl_analysis.draft.overview import inspect_recording
from osl_analysis.ingest.likely_clock import ticks
from osl_analysis.ingest.raw_files import trial_from_files

ROWS = 480  # lines between the first 300 and the last 60 are split by polars
TIME, ANGLE, TORQUE = ankle(ROWS)
T, A, M = map(written, (TIME, ANGLE, TORQUE))
CLOCK = [
    dt.datetime(2024, 5, 1, 23, 59, 59, 500_000) + dt.timedelta(microseconds=round(1e6 * x))
    for x in TIME
]


text = partial(table_text, t=T, a=A, m=M)


def since(form):
    return [stamp.strftime(form) for stamp in CLOCK]


LVM = (
    "LabVIEW"
    " Measurement\t\nX_Columns\tOne\n***End_of_Header***\t\n"
    "Channels\t2\t\t\nDelta_X\t0.002\t0.002\n"
)
TEXTS = {
    "semicolons and commas": text(";", ["Tijd [s]", "Hoek [graden]", "Koppel [Nm]"], decimal=","),
    "whole seconds beside": text(
        head=["Time", *HEAD], t=[f"{at},{x}" for at, x in zip(since("%H:%M:%S"), T, strict=True)]
    ),
    "samples a second": text(
        ",", head=[*HEAD[1:], ""], above="Abtastrate: 0.5 kS/s\n", t=A, a=M, m=[""] * ROWS
    ),
    "LabVIEW with units": text(
        "\t",
        ["X_Value", "Angle", "Torque", "Comment"],
        LVM + "Y_Unit_Label\tdeg\tNewton-meter\t\n***End_of_Header***\t\n",
    ),
    "Windows": text(";", ["Zeit [s]", "Winkel [°]", "Moment [N·m]"]).encode("cp1252"),
    "Excel's days": text(head=["Time", *HEAD[1:]], t=[f"{45413.5 + x / 86400:.12f}" for x in TIME]),
    "counter of 32 bits": text(
        head=["t_us", *HEAD[1:]], t=[str(round(2**32 - 9e5 + 1e6 * x) % 2**32) for x in TIME]
    ),
    "quoted, with decimal commas": text(
        ",",
        ['"t [s]"', '"angle [deg]"', '"torque [Nm]"'],
        **{
            name: [f'"{x}"'.replace(".", ",") for x in column]
            for name, column in zip("tam", (T, A, M), strict=True)
        },
    ),
    "Biodex": text(
        "   ",
        ["   TIME", "POS (ANAT)", "TORQUE"],
        "Session : ankle\n\n",
        t=["mSec", *(f"{1e3 * x:.0f}" for x in TIME)],
        a=["DEGREES", *A],
        m=["N-M", *M],
    ),
    "ticks in a name": text(
        head=["t_100us", "angle:deg", "Torque_mNm"],
        t=[f"{1e4 * x:.0f}" for x in TIME],
        m=[f"{1e3 * x:.6f}" for x in TORQUE],
    ),
    "ticks of the header's resolution": text(
        ",",
        ["ticks", *HEAD[1:]],
        "# timer: 16 bit, resolution: 0.5 us\n",
        t=[f"{2e6 * x % 2**16:.0f}" for x in TIME],
    ),
    "stamps that stand still": text(above="Abtastrate: 500 Hz\n\n", t=["0.000"] * ROWS),
    "an angle within one turn": text(a=[f"{x % 360:.9f}" for x in ANGLE]),
    "units behind commas": text(",", ['"time,s"', '"angle,deg"', '"Ankle torque,Nm"']),
}


def made(path, kind):
    """The recording as programs write it, with what a table of numbers alone does not have."""
    if kind == "parquet":
        stamped = {"timestamp": CLOCK, "ankle_angle_deg": ANGLE, "torque_Nm": TORQUE}
        pl.DataFrame(stamped).write_parquet(path)
    else:
        with xlsxwriter.Workbook(path) as book:
            sheet = book.add_worksheet()
            style = book.add_format({"num_format": "hh:mm:ss.000"})
            sheet.write_row(0, 0, ["Bench 3"])
            sheet.write_row(1, 0, ["Time", "Angle", "Torque"])
            sheet.write_row(2, 0, ["", "deg", "Nm"])
            for place, row in enumerate(zip(CLOCK, ANGLE, TORQUE, strict=True), start=3):
                sheet.write_datetime(place, 0, row[0], style)
                sheet.write_row(place, 1, row[1:])
    return path


def read_by(path, source):
    """The trial of a file, by the text of a source file."""
    (path.parent / "source.yaml").write_text(source)
    row = {"trial": "a", "log": path.name, "log_source": "source"}
    return trial_from_files(row, path.parent, path.parent)


ASKED = '{"column": "NAME_OF_TIME", "unit": "UNKNOWN"}'


def read_by_draft(path, time=ASKED):
    """The trial of a file, by the draft of its overview as it is, or with the time that it asks."""
    return read_by(path, draft_source(inspect_file(path), path.name).replace(ASKED, time))


ANGLE_ALONE = "channels:\n  theta: {column: Ankle angle, unit: deg}\n"


def assert_recording(trial):
    samples = trial.samples  # hh:mm:ss.mmm and ms are rounded
    coarse = 1.1e-3
    np.testing.assert_allclose(samples["time"], TIME, atol=coarse)
    np.testing.assert_allclose(samples["theta"], np.radians(ANGLE), atol=1e-8)
    np.testing.assert_allclose(samples["torque"], TORQUE, atol=1e-6)


@pytest.mark.parametrize("dialect", TEXTS)
def test_a_table_of_text_is_read_by_the_draft_of_its_own_overview(tmp_path, dialect):
    content = TEXTS[dialect]
    (tmp_path / "a.dat").write_bytes(content if isinstance(content, bytes) else content.encode())
    assert_recording(read_by_draft(tmp_path / "a.dat"))


@pytest.mark.parametrize("kind", ["parquet", "xls"])
def test_a_table_of_a_program_is_read_by_the_draft_of_its_own_overview(tmp_path, kind):
    assert_recording(read_by_draft(made(tmp_path / f"a.{kind}", kind)))


def test_two_clocks_that_disagree_are_a_question_and_a_doubt(tmp_path):
    """By the column called `time` B was 10 % and I 21 % off, and nothing was said."""
    path = tmp_path / "a.csv"
    fast = [f"{1.1 * x:.9f}" for x in TIME]
    stamps = [f"{time},{other}" for time, other in zip(T, fast, strict=True)]
    path.write_text(text(head=["time_s", "host_time", *HEAD[1:]], t=stamps))

    trial = read_by_draft(path, "{column: time_s, unit: s}")

    (question,) = inspect_file(path).open
    assert "time_s" in question
    assert "host_time" in question
    assert_recording(trial)
    assert "'host_time' " in trial.provenance["warnings"][0]
    # RMS of what the two tell differently
    apart = trial.provenance["log"]["clocks_apart"]
    assert apart == {"host_time": pytest.approx(np.std(0.1 * TIME), rel=0.01)}


def test_clocks_that_agree_and_signals_that_rise_evenly_are_no_contradiction(tmp_path):
    """Days of Excel, minutes, and stamps of whole seconds tell no more than time does; a ramp is no
    clock."""
    frame = pl.DataFrame(
        {
            "time_s": TIME,
            "Date": 45413.5 + TIME / 86400,
            "time of the PC [min]": TIME / 60,
            "turns": 0.003 * np.arange(TIME.size),
            "secs": np.floor(TIME),
            "ankle_angle_deg": ANGLE,
            "torque_Nm": TORQUE,
        }
    )
    frame.write_parquet(tmp_path / "a.parquet")
    source = "format: table\ntime: {column: time_s, unit: s}\nchannels:\n"
    source += "  theta: {column: ankle_angle_deg, unit: deg}\n"

    trial = read_by(tmp_path / "a.parquet", source)

    assert trial.provenance["warnings"] == []


def read_with_two_clocks(folder, channels, *columns):
    """Read a table with a clock for each of two channels, of which one may have fewer rows."""
    rows = map(",".join, zip_longest(*columns, fillvalue=""))
    path = folder / "a.csv"
    path.write_text("X [s],Angle,X [s],Torque\n" + "\n".join(rows) + "\n")
    source = "format: csv\nmost_missing: 0.6\ntime: {column: '1', unit: s}\nchannels:\n"
    return read_by(path, source + channels)


ANGLE_BESIDE = "  theta: {column: '2', unit: deg}\n"


def test_channels_of_several_rates_in_one_table_are_refused(tmp_path):
    """With `most_missing: 0.5`, as the refusal proposed, every second torque stood at half its
    time."""
    both = ANGLE_BESIDE + "  torque: {column: '4', unit: Nm}\n"
    with refused_with(r"a\.csv: .*'3'"):
        read_with_two_clocks(tmp_path, both, T, A, T[::2], M[::2])


def test_a_channel_with_its_own_clock_may_end_before_the_others(tmp_path):
    half = ROWS // 2

    samples = read_with_two_clocks(tmp_path, ANGLE_BESIDE, T[:half], A[:half], T, M).samples

    np.testing.assert_allclose(samples["theta"], np.radians(ANGLE[:half]), atol=1e-8)


def test_a_draft_leaves_a_channel_of_another_length_out_and_asks(tmp_path):
    write_mat(tmp_path / "a.mat", time_s=TIME, angle_deg=ANGLE, torque_Nm=TORQUE[::2])

    overview = inspect_recording(tmp_path / "a.mat")

    assert "torque_Nm: " in overview.open[0]


def test_a_later_clock_of_the_same_name_is_of_what_stands_beside_it(
    tmp_path,
):
    """Tables side by side, or LabVIEW's columns `X_Value`: the torque was 4 ms early, and B 1.2 of
    5 off."""
    for late, name in ((0.1, "daq_s"), (0.0, HEAD[0]), (0.004, HEAD[0])):
        rows = zip(T, A, [f"{x + late:.6f}" for x in TIME], M, strict=True)
        (tmp_path / "a.csv").write_text(
            "\n".join(map(",".join, [[*HEAD[:2], name, HEAD[2]], *rows])) + "\n"
        )
        if late != 0.004:
            assert_recording(read_by_draft(tmp_path / "a.csv"))
    with refused_with(r"a\.csv: .*'3'"):
        read_by_draft(tmp_path / "a.csv")


@pytest.mark.parametrize("more", ["Decimation: 4", "Output rate: 500 Hz"])
def test_a_rate_beside_a_decimation_or_another_rate_is_a_question(tmp_path, more):
    """Read at 2000 Hz, rows of 500 Hz gave B = 1.25 for 5."""
    path = tmp_path / "a.csv"
    path.write_text(
        text(head=[*HEAD[1:], ""], t=A, a=M, m=[""] * ROWS, above=f"Sample rate: 2000 Hz\n{more}\n")
    )

    assert_recording(read_by_draft(path, "{rate: 500}"))


@pytest.mark.parametrize(("decimal", "thousands"), [(",", "."), (".", "\u202f")])
def test_signs_between_thousands_are_refused_and_never_taken_for_decimals(
    tmp_path, decimal, thousands
):
    whole = [f"{round(1e3 * x):,}".replace(",", thousands) for x in TORQUE]
    angles = [x.replace(".", decimal) for x in A]
    (tmp_path / "a.csv").write_text(text(";", [*HEAD[:2], "Torque [Nmm]"], a=angles, m=whole))

    with refused_with(r"a\.csv: .*column"):
        read_by(
            tmp_path / "a.csv",
            "format: csv\ntime: {column: Time, unit: s}\nchannels:\n"
            "  torque: {column: Torque, unit: Nmm}\n",
        )


@pytest.mark.parametrize("sign", ["_", "'", " "])
def test_numbers_in_another_writing_are_no_failed_readings(tmp_path, sign):
    """A draft listed each of them under `missing`, so that half of the torque would have been left
    out; without what stands before the sign, 1_198.0 would be 198.0."""
    thousands = [f"{1e3 * x + 900:_.1f}".replace("_", sign) for x in TIME]
    (tmp_path / "a.csv").write_text(text(t=thousands, head=["time_ms", *HEAD[1:]]))

    with refused_with(rf"'1{sign}000\.0'"):
        read_by_draft(tmp_path / "a.csv")


def test_units_of_which_one_is_missing_are_of_no_column(tmp_path):
    """Of two units below three names between blanks nothing tells which column has none."""
    names = ["mSec", "TORQUE", "POSITION"]
    path = tmp_path / "a.dat"
    path.write_text(text("  ", names).replace("POSITION", "POSITION\nNm deg"))

    assert [channel.unit for channel in inspect_file(path).channels] == ["", "", ""]


def test_a_recorder_that_begins_anew_is_told_with_its_line(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(text() * 2)

    with refused_with(rf"line {ROWS + 3}: the file holds 2 recordings"):
        read_by_draft(path)


def test_a_column_beside_a_rate_counts_samples_so_that_lost_ones_are_a_gap(tmp_path):
    path = tmp_path / "a.csv"
    kept = np.delete(np.arange(ROWS), [100, 101])
    angle, torque = ([column[k] for k in kept] for column in (A, M))
    path.write_text(text(head=["n", *HEAD[1:]], t=map(str, kept), a=angle, m=torque))

    trial = read_by(path, "format: csv\ntime: {column: n, rate: 500}\n" + ANGLE_ALONE)

    np.testing.assert_allclose(trial.samples["time"], TIME[kept])


def test_a_damaged_parquet_file_is_one_refusal_and_no_trace_of_rust(tmp_path, capfd):
    pl.DataFrame({"t": TIME, "a": TIME}).write_parquet(
        path := tmp_path / "a.parquet", compression="uncompressed"
    )
    path.write_bytes(path.read_bytes()[:4] + path.read_bytes()[2000:])
    with refused_with(r"a\.parquet: .*\("):
        inspect_file(path)
    assert capfd.readouterr().err == ""


def test_columns_of_no_numbers_are_told(tmp_path):
    pl.DataFrame({"t": [0.0, 1.0], "pairs": [[1], [2]]}).write_parquet(tmp_path / "a.parquet")

    assert "pairs" in " ".join(inspect_file(tmp_path / "a.parquet").remarks)


@pytest.mark.parametrize("lost", [[], [500], [3, 700, 701]])
def test_a_count_of_rows_is_no_clock_also_where_rows_were_lost(lost):
    """Taken for ms, rows of 500 Hz gave half of B, and nothing was doubted."""
    counted = np.delete(np.arange(1000.0), lost)
    assert not ticks(counted, "")
    assert ticks(2 * counted, "")


SOURCE = {"theta": {"column": "a", "unit": "rad"}, "torque": {"column": "q", "unit": "N*m"}}
SWEEP = np.sin(np.arange(400) / 20)


@pytest.mark.parametrize(
    ("stamps", "time", "message"),
    [
        ((np.arange(400) * 4 + 65_000) % 2**16, {"unit": "ms"}, r"2\*\*16 ticks of 1 "),
        (
            (np.arange(400) * 4000 + 2**31 - 9000) % 2**31 / 1e6,
            {"unit": "s"},
            r"2\*\*31 ticks of 1e-06",
        ),
        (np.full(400, 4.0), {"unit": "ms", "each": "interval"}, ""),
    ],
)
def test_a_counter_that_falls_goes_on_and_intervals_are_summed(tmp_path, stamps, time, message):
    rows = np.column_stack([stamps, SWEEP, SWEEP])
    path = tmp_path / "a.csv"
    np.savetxt(path, rows, "%.10g", ",", header="t,a,q", comments="")

    recording = read_recognised(path, time={"column": "t", **time}, channels=SOURCE)

    np.testing.assert_allclose(recording.samples["time"], np.arange(400) * 0.004, atol=1e-9)
    assert bool(message) == bool(re.search(message or "ticks", " ".join(recording.warnings)))


AT_RATE = {"rate": 400.0}


@pytest.mark.parametrize(
    ("head", "clock", "time"),
    [
        ("VUnit,V,V\nSampleRate,4.000000E+02,4.000000E+02\n", "", AT_RATE),
        ("VUnit,V,V\nHResolution,2.5E-03,2.5E-03\n", "", AT_RATE),
        ("Sampling period [ms],2.5,2.5", "", AT_RATE),
        ("# resolution: 0.5 us\nticks,a,q", "{}", {"column": "ticks", "unit": "0.5 us"}),
        (
            "# Gear 5:1\nms since last,a,q",
            "4",
            {"column": "ms since last", "each": "interval", "unit": "ms"},
        ),
    ],
)
def test_what_a_header_tells_of_time_and_of_a_gear_is_drafted(tmp_path, head, clock, time):
    rows = [f"{clock.format(8000 * k % 65536)},{a:+.5E},{a:+.5E}" for k, a in enumerate(SWEEP)]
    (tmp_path / "a.csv").write_text("\n".join([head, *rows, ""]))

    overview = inspect_recording(tmp_path / "a.csv")

    assert overview.settings["time"] == time
    assert ("5:1" in head) == any("5:1" in question for question in overview.open)


def test_what_offset_and_wraps_at_do_is_told(tmp_path):
    rows = np.column_stack([np.arange(400) / 100, SWEEP, SWEEP])
    np.savetxt(tmp_path / "a.csv", rows, "%.6f", ",", header="t,a,q", comments="")
    angle = {"column": "a", "unit": "rev", "scale": "1/4", "offset": 2, "wraps_at": 360}

    recording = read_recognised(
        tmp_path / "a.csv",
        time={"column": "t", "unit": "s"},
        channels={**SOURCE, "theta": angle},
    )

    message = " ".join(recording.warnings)
    assert re.search("`wraps_at` had no effect", message)
    assert re.search("before `scale`, which shifts theta by 3.142 rad", message)
