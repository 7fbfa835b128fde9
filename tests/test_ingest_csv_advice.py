"""What a refusal of a CSV log or of its source file advises works when it is followed literally."""

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from osl_analysis.cli import main
from osl_analysis.commands.inspect import inspect_file
from osl_analysis.errors import InputError
from osl_analysis.formats.csv_table import share_above
from osl_analysis.ingest.draft import draft_source
from osl_analysis.ingest.known_formats import read_source
from osl_analysis.ingest.overview import likely_unit
from osl_analysis.ingest.raw_files import trial_from_files
from osl_analysis.trial import Trial

SOURCE = {
    "format": "csv",
    "time": {"column": "t", "unit": "s"},
    "channels": {"theta": {"column": "angle", "unit": "rad"}, "torque": {"column": "load", "unit": "Nm"}},
}


def ingested(folder: Path, text: str, **fields: object) -> Trial:
    """The trial of a log, by a source file with other fields than the usual."""
    (folder / "log.csv").write_text(text)
    (folder / "source.yaml").write_text(yaml.safe_dump({**SOURCE, **fields}, sort_keys=False))
    return trial_from_files({"trial": "a", "log": "log.csv", "log_source": "source"}, folder, folder)


def refused(folder: Path, text: str, **fields: object) -> str:
    """What is said to a log, in one printable line."""
    with pytest.raises(InputError) as caught:
        ingested(folder, text, **fields)
    assert str(caught.value).isprintable()
    return str(caught.value)


def advised(message: str) -> dict[str, object]:
    """The fields that a message says to write, as `name: value` in backquotes."""
    written = re.findall(r"`(\w+: [^`]+)`", message)
    return {key: value for text in written for key, value in yaml.safe_load(text).items()}


LOG = "t,angle,load\n0,1,5\n0.01,2,6\n0.02,3,7\n0.03,4,8\n"
SAMPLES = {"theta": [1, 2, 3, 4], "torque": [5, 6, 7, 8]}


def assert_samples(trial: Trial, **columns: list[float]) -> None:
    for name, values in (columns or SAMPLES).items():
        np.testing.assert_array_equal(trial.samples[name], values)


@pytest.mark.parametrize(
    ("text", "stated", "told", "samples"),
    [
        (LOG.replace("0.02,", "0.015,9\n0.02,"), {}, "line 4 has", SAMPLES),
        (LOG.replace("0.02,", "0.015,9,9,9\n0.02,"), {}, "line 4 has", SAMPLES),
        (LOG.replace("0.02,3,7", "0.02,3"), {"ragged": "skip"}, "line 4 has", {"theta": [1, 2, 4]}),
        (LOG.replace("2,6", ",6"), {}, "is missing in 1 of 4 rows", {"theta": [1, np.nan, 3, 4]}),
        (LOG.replace(",", ";").replace(".", ","), {}, "if the comma is the decimal sign", SAMPLES),
        (LOG.replace("load\n", "load\ns,rad,Nm\n"), {}, "if this line holds units", SAMPLES),
        (
            re.sub(r"^0\.0\d", "0", LOG, flags=re.MULTILINE),
            {},
            "column 't': time stands still at 0 in all 4 rows; take another column, or state the rate",
            SAMPLES,
        ),
    ],
    ids=["short row", "long row", "larger share", "missing cell", "decimal comma", "units", "time stands still"],
)
def test_the_log_is_read_as_the_refusal_says(
    tmp_path: Path, text: str, stated: dict[str, object], told: str, samples: dict[str, list[float]]
) -> None:
    message = refused(tmp_path, text, **stated)
    assert told in message
    assert_samples(ingested(tmp_path, text, **stated | advised(message)), **samples)


@pytest.mark.parametrize(
    ("text", "fields", "told"),
    [
        (LOG.replace("2,6", "2,6,0"), {"extra_cells": "last"}, "line 3 has 4 cells"),
        (
            LOG.replace("t,angle,load", "t;angle;load"),
            {},
            "line 1 separates the names by ';', the rows below it do not",
        ),
        ("sep=;\n" + LOG.replace(",", ";"), {}, "seem to stand in line 2; delete the lines above it"),
        (LOG + LOG, {}, "line 6, column 't': 't' is not a number; the header stands here again"),
        (
            LOG,
            {
                "channels": {
                    name: {"column": "angle", "unit": unit} for name, unit in (("theta", "rad"), ("torque", "Nm"))
                }
            },
            "column 'angle' is theta and torque in the source file; correct",
        ),
    ],
    ids=["some rows longer", "other signs in the header", "line of Excel", "header again", "two signals of one column"],
)
def test_what_no_advice_can_repair_is_told_by_its_line(
    tmp_path: Path, text: str, fields: dict[str, object], told: str
) -> None:
    assert told in refused(tmp_path, text, **fields)


def test_cells_without_a_name_are_left_out_as_the_source_file_says(tmp_path: Path) -> None:
    lines = LOG.splitlines()
    last = "\n".join([lines[0], *(f"{line},0" for line in lines[1:])])
    first = "\n".join([lines[0], *(f"{n},{line}" for n, line in enumerate(lines[1:], start=1))])
    message = refused(tmp_path, last)
    assert "every row has 1 more cells than the header has names: line 2 begins with '0' and ends with '0'" in message
    assert "`extra_cells: first` or `extra_cells: last`" in message
    trial = ingested(tmp_path, last, extra_cells="last")
    assert_samples(trial)
    assert trial.provenance["warnings"] == ["log.csv: the last 1 cells of every row have no name and were left out"]
    assert_samples(ingested(tmp_path, first, extra_cells="first"))
    assert_samples(ingested(tmp_path, LOG, extra_cells="last"))  # another log of the same source file has none


def test_a_row_of_units_may_have_the_cell_without_a_name_too(tmp_path: Path) -> None:
    units = "s,mrad,Nm"
    text = LOG.replace("load\n", f"load\n{units}\n").splitlines()
    rows = "\n".join([text[0], *(f"x,{line}" for line in text[1:])])
    channels = {"theta": {"column": "angle"}, "torque": {"column": "load"}}
    trial = ingested(tmp_path, rows, extra_cells="first", units_row=True, channels=channels, time={"column": "t"})
    np.testing.assert_allclose(trial.samples["theta"], [1e-3, 2e-3, 3e-3, 4e-3])


LOGGER = "time,<__main__.Joint object at 0x7fe6c0>.output_position,<__main__.Joint object at 0x7fe6c0>.current\n0,1,5\n"
ROWS = "0.01,2,6\n0.02,3,7\n0.03,4,8\n"


def test_a_pattern_finds_the_column_whose_name_changes_from_run_to_run(tmp_path: Path) -> None:
    channels = {
        "theta": {"column": "*.output_position", "unit": "rad"},
        "torque": {"column": "<*>.current", "unit": "Nm"},
    }
    for address in ("0x7fe6c0", "0x55d1a2b3"):
        text = (LOGGER + ROWS).replace("0x7fe6c0", address)
        trial = ingested(tmp_path, text, channels=channels, time={"column": "ti*", "unit": "s"})
        assert_samples(trial)
        origin = trial.provenance["columns"]["theta"]
        assert origin["column"] == "*.output_position"
        assert origin["found"] == f"<__main__.Joint object at {address}>.output_position"


def test_a_pattern_of_several_columns_or_none_is_refused_with_the_columns(tmp_path: Path) -> None:
    two = (LOGGER + ROWS).replace("0x7fe6c0>.current", "0x7fe6d0>.output_position")
    pattern = {"theta": {"column": "*.output_position", "unit": "rad"}}
    message = refused(tmp_path, two, channels=pattern, time={"column": "time", "unit": "s"})
    assert "column '*.output_position' occurs 2 times, as columns 2 ('<__main__.Joint object at 0x7fe6c0>" in message
    assert "or its number" in message
    by_number = {"theta": {"column": 2, "unit": "rad"}, "torque": {"column": 3, "unit": "Nm"}}
    trial = ingested(tmp_path, two, channels=by_number, time={"column": 1, "unit": "s"})
    assert_samples(trial)
    none = {"theta": {"column": "*.velocity", "unit": "rad"}}
    assert "column '*.velocity' is missing; the file has time, <__main__" in refused(
        tmp_path, two, channels=none, time={"column": "time", "unit": "s"}
    )


def test_a_name_goes_before_a_pattern_and_a_number(tmp_path: Path) -> None:
    text = LOG.replace("t,angle,load", "t,a*,a1")
    channels = {"theta": {"column": "a*", "unit": "rad"}, "torque": {"column": "a1", "unit": "Nm"}}
    assert_samples(ingested(tmp_path, text, channels=channels))
    dots = LOG.replace("t,angle,load", "t,a.b,axb")
    only = {"theta": {"column": "a.*", "unit": "rad"}}
    assert_samples(ingested(tmp_path, dots, channels=only), theta=[1, 2, 3, 4])  # a full stop is a full stop


def test_the_draft_of_a_logger_with_addresses_fits_its_next_recording(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(LOGGER + ROWS)
    channels = yaml.safe_load(draft_source(inspect_file(tmp_path / "a.csv"), "a.csv"))["channels"]
    assert [channel["column"] for channel in channels.values()] == ["*.output_position", "*.current"]
    two = (LOGGER + ROWS).replace("0x7fe6c0>.current", "0x7fe6d0>.output_position")
    (tmp_path / "b.csv").write_text(two)
    channels = yaml.safe_load(draft_source(inspect_file(tmp_path / "b.csv"), "b.csv"))["channels"]
    assert channels["NAME_1"]["column"] == "<__main__.Joint object at 0x7fe6c0>.output_position"


def test_repeated_stamps_are_kept_with_a_warning_and_dropped_as_it_says(tmp_path: Path) -> None:
    text = LOG.replace("0.02,3,7", "0.01,2,6.5\n0.02,3,7")
    kept = ingested(tmp_path, text)
    (warning,) = kept.provenance["warnings"]
    assert warning.startswith("log.csv: 1 of 5 rows repeat the stamp of the row before and are taken for samples")
    assert f"`time` in {tmp_path / 'source.yaml'}, line 2" in warning
    assert len(kept.samples) == 5
    dropped = ingested(tmp_path, text, time=SOURCE["time"] | advised(warning))  # type: ignore[operator]
    assert_samples(dropped)
    assert dropped.provenance["log"]["repeated_stamps"] == 1
    assert dropped.provenance["warnings"] == [
        "log.csv: 1 of 5 rows repeat the stamp of the row before and were left out"
    ]


def test_a_word_that_is_no_number_is_added_to_the_missing_ones_as_the_refusal_says(tmp_path: Path) -> None:
    message = refused(tmp_path, LOG.replace("2,6", "ERROR,6"))
    assert 'add "ERROR" to `missing` in the source file' in message
    assert ingested(tmp_path, LOG.replace("2,6", "ERROR,6"), missing=["ERROR"], most_missing=0.3)


@pytest.mark.parametrize("stamp", ["2024-05-01T12:00:00.{}", "12:00:00.{}", "01/05/2024 12:00:{}"])
def test_a_date_is_replaced_by_the_rate_as_the_refusal_says(tmp_path: Path, stamp: str) -> None:
    text = re.sub(r"^0(\.0)?(\d?)", lambda found: stamp.format(found[2] or 0), LOG, flags=re.MULTILINE)
    message = refused(tmp_path, text)
    assert "write time as seconds, or state the rate of the rows in place of the column" in message
    trial = ingested(tmp_path, text, **advised(message))
    np.testing.assert_allclose(trial.samples["time"], [0, 1e-3, 2e-3, 3e-3])


def test_columns_without_names_are_given_by_number_as_the_refusal_says(tmp_path: Path) -> None:
    text = LOG.partition("\n")[2]
    message = refused(tmp_path, text)
    assert "write `header: none` and the columns' numbers" in message
    by_number = {"theta": {"column": 2, "unit": "rad"}, "torque": {"column": 3, "unit": "Nm"}}
    fields = advised(message) | {"channels": by_number, "time": {"column": 1, "unit": "s"}}
    assert_samples(ingested(tmp_path, text, **fields))


def test_lines_above_the_header_are_marked_as_the_refusal_says(tmp_path: Path) -> None:
    text = f"Rig: B\nOperator: C, D\n{LOG}"
    message = refused(tmp_path, text)
    assert (
        "the names of the columns seem to stand in line 3; delete the lines above it, or begin each with `#`" in message
    )
    assert_samples(ingested(tmp_path, f"# Rig: B\n# Operator: C, D\n{LOG}"))
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError, match="seem to stand in line 3"):
        inspect_file(tmp_path / "a.csv")


def test_columns_between_blanks_and_one_that_is_called_unknown_are_read(tmp_path: Path) -> None:
    assert_samples(ingested(tmp_path, LOG.replace(",", "   ")))
    channels = {"theta": {"column": "UNKNOWN", "unit": "rad"}}
    assert_samples(ingested(tmp_path, LOG.replace("angle", "UNKNOWN"), channels=channels), theta=[1, 2, 3, 4])


def test_a_unit_that_is_wrong_is_named_with_file_line_key_and_value(tmp_path: Path) -> None:
    channels = {"theta": {"column": "angle", "unit": "xyz"}}
    message = refused(tmp_path, LOG, channels=channels)
    assert message.startswith(
        f"{tmp_path / 'source.yaml'}: line 8: channels.theta.unit: 'xyz' is not allowed: unit 'xyz'"
    )
    message = refused(tmp_path, LOG.replace("angle", "angle [xyz]"), channels={"theta": {"column": "angle"}})
    where = f"write one of rad, mrad, deg, °, rev, as `channels.theta.unit` in {tmp_path / 'source.yaml'}, line 6"
    assert message == f"{tmp_path / 'log.csv'}: column 'angle [xyz]': unit 'xyz' is unknown; {where}"
    message = refused(tmp_path, LOG, time={"column": "t"})
    assert message.endswith(f"write one of s, ms, us, ns, as `time.unit` in {tmp_path / 'source.yaml'}, line 2")


@pytest.mark.parametrize(
    ("fields", "meant"),
    [
        ({"chanels": SOURCE["channels"]}, "channels"),
        ({"channels": {"theta": {"colunm": "angle", "unit": "rad"}}}, "column"),
        ({"channels": {"thetta": {"column": "angle", "unit": "rad"}}}, "theta"),
        ({"channels": {"Torque": {"column": "angle", "unit": "Nm"}}}, "torque"),
        ({"channels": {"theta": {"column": "Angle", "unit": "rad"}}}, "angle"),
        ({"time": {"column": "t", "unti": "s"}}, "unit"),
        ({"format": "cvs"}, "csv"),
    ],
)
def test_a_misspelt_name_is_asked_for(tmp_path: Path, fields: dict[str, object], meant: str) -> None:
    usual = {key: value for key, value in SOURCE.items() if "chanels" not in fields or key != "channels"}
    content = usual | fields
    (tmp_path / "source.yaml").write_text(yaml.safe_dump(content))
    (tmp_path / "log.csv").write_text(LOG)
    with pytest.raises(InputError, match=rf"; did you mean '{meant}'\?"):
        trial_from_files({"trial": "a", "log": "log.csv", "log_source": "source"}, tmp_path, tmp_path)


BENCH = "loop_time,ankle_deg,load_Nm,motor_mA,phase\n0,1,5,7,0\n10,2,6,7,0\n20,3,7,7,0\n"


def test_a_draft_knows_clocks_and_units_by_their_names_and_says_that_it_guessed(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(BENCH)
    overview = inspect_file(tmp_path / "a.csv")
    drafted = draft_source(overview, "a.csv")
    source = yaml.safe_load(drafted)
    assert source["time"] == {"column": "loop_time", "unit": "UNKNOWN"}
    assert {channel["column"]: channel["unit"] for channel in source["channels"].values()} == {
        "ankle_deg": "deg",
        "load_Nm": "Nm",
        "motor_mA": "mA",
        "phase": "UNKNOWN",
    }
    assert drafted.count("the unit is guessed: check it") == 3
    assert re.findall(r"# (\w+)\?", drafted) == ["theta", "torque", "current"]
    assert overview.remarks == [
        "units guessed from the names, to be checked: ankle_deg [deg], load_Nm [Nm], motor_mA [mA]"
    ]


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("t_s", "s"),
        ("time_ms", "ms"),
        ("loop_time_us", "us"),
        ("pi_time", "UNKNOWN"),
        ("Time [s]", "s"),
        ("state_time", "UNKNOWN"),
        ("t_ns", "ns"),
    ],
)
def test_a_clock_is_known_by_its_name_with_or_without_its_unit(tmp_path: Path, name: str, unit: str) -> None:
    (tmp_path / "a.csv").write_text(BENCH.replace("loop_time", name))
    clock = yaml.safe_load(draft_source(inspect_file(tmp_path / "a.csv"), "a.csv"))["time"]
    assert clock == {"column": name.partition(" [")[0], "unit": unit}


def test_a_draft_that_was_not_edited_is_refused_with_the_places_and_reads_the_log_once_they_are(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(BENCH)
    path = tmp_path / "source.yaml"
    result = CliRunner().invoke(main, ["inspect", str(tmp_path / "log.csv"), "--draft", str(path)])
    assert result.exit_code == 0
    row = {"trial": "a", "log": "log.csv", "log_source": "source"}
    with pytest.raises(
        InputError, match=r"a draft of `osl-analysis inspect` in which 5 places are to be edited"
    ) as caught:
        trial_from_files(row, tmp_path, tmp_path)
    places = re.findall(r"`([\w.]+)` in line (\d+)", str(caught.value))
    assert [name for name, _ in places] == ["time.unit", *(f"channels.NAME_{n}" for n in range(1, 5))]
    lines = path.read_text().splitlines()
    for name, number in places:
        assert name.rpartition(".")[2] in lines[int(number) - 1]
    edited = [
        line.replace("NAME_1", "theta").replace("UNKNOWN", "ms") for line in lines if not re.search("NAME_[234]", line)
    ]
    path.write_text("\n".join(edited))
    np.testing.assert_allclose(trial_from_files(row, tmp_path, tmp_path).samples["time"], [0, 0.01, 0.02])


def test_a_file_without_a_clock_asks_for_one_or_for_the_rate(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(BENCH.replace("loop_time", "n"))
    drafted = draft_source(inspect_file(tmp_path / "a.csv"), "a.csv")
    assert "state the rate of the rows instead, as {rate: 1000}" in drafted
    named = drafted.replace('{"column": "NAME_OF_TIME", "unit": "UNKNOWN"}', "{rate: 1000}").replace("NAME_1", "theta")
    kept = [line for line in named.splitlines() if not re.match(r"  NAME_", line)]
    (tmp_path / "source.yaml").write_text("\n".join(kept).replace('"UNKNOWN"', "deg"))
    assert read_source(tmp_path / "source.yaml").time.rate == 1000  # type: ignore[union-attr]


def test_extra_cells_and_units_below_the_header_are_drafted(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,angle\n0,1,9\n1,2,9\n2,3,9\n")
    assert yaml.safe_load(draft_source(inspect_file(tmp_path / "a.csv"), "a.csv"))["extra_cells"] == "UNKNOWN"
    (tmp_path / "b.csv").write_text("t,angle\ns,deg\n0,1\n1,2\n")
    source = yaml.safe_load(draft_source(inspect_file(tmp_path / "b.csv"), "b.csv"))
    assert source["units_row"] is True
    assert (source["time"]["unit"], source["channels"]["NAME_1"]["unit"]) == ("s", "deg")


def test_prose_is_no_table(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("Dear all,\nthe bench was warm\ntoday, more tomorrow\n")
    with pytest.raises(
        InputError, match="no table of numbers: 2 of 2 rows hold none, such as line 2, 'the bench was warm'"
    ):
        inspect_file(tmp_path / "a.csv")


def test_a_comma_between_thousands_is_not_read_as_a_decimal_sign(tmp_path: Path) -> None:
    text = LOG.replace("0.02,3,7", '0.02,"1,234",7')
    message = refused(tmp_path, text)
    assert "if the comma is the decimal sign" in message
    assert 'write `decimal: "."` in the source file if the full stop is' in refused(tmp_path, text, **advised(message))


def test_nanoseconds_since_1970_keep_their_last_digit(tmp_path: Path) -> None:
    stamps = [1_700_000_000_000_000_001 + 1_000_003 * n for n in range(4)]
    rows = "".join(f"{stamp},{n},{n}\n" for n, stamp in enumerate(stamps))
    trial = ingested(tmp_path, f"t,angle,load\n{rows}", time={"column": "t", "unit": "ns"})
    np.testing.assert_allclose(trial.samples["time"], np.arange(4) * 1.000003e-3, rtol=1e-12)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("formt: csv", "field 'format' is missing; rename 'formt', or add it"),
        (
            "format: csv\ntime: t",
            "line 2: time: 't' is not allowed: write its fields below it, as `name: value`; the known",
        ),
        ("format: csv\ntime: {rate: 500 Hz}", "time.rate: '500 Hz' is not allowed: write a number, without a unit"),
        ("format: csv\nmissing: NA", "missing: 'NA' is not allowed: write a list"),
        ("format: csv\nclock: mastr", "write 'master', 'sync' or 'shared'; did you mean 'master'?"),
        ("format: csv\n\ttime: 1", "indent with blanks, not with tabs"),
        ("format: csv\ntime: {column: t, unit: Hz}", "line 2: time.unit: 'Hz' is not allowed: unit 'Hz' measures [Hz]"),
    ],
)
def test_a_field_of_a_wrong_kind_is_answered_with_what_to_write(tmp_path: Path, text: str, problem: str) -> None:
    (tmp_path / "source.yaml").write_text(text + "\nchannels: {theta: {column: angle, unit: deg}}\n")
    with pytest.raises(InputError, match=re.escape(problem)):
        read_source(tmp_path / "source.yaml")


def test_aliases_that_stand_for_billions_of_values_are_refused_at_once(tmp_path: Path) -> None:
    lines = ["format: csv", "a: &a {x: 1, y: 1, z: 1}"]
    names = "abcdefghijklmnop"
    lines += [f"{b}: &{b} {{x: *{a}, y: *{a}, z: *{a}, w: *{a}}}" for a, b in pairwise(names)]
    (tmp_path / "source.yaml").write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"its aliases \(`\*name`\) stand for more than 100000 values"):
        read_source(tmp_path / "source.yaml")
    (tmp_path / "source.yaml").write_text("format: csv\nchannels: &c {theta: *c}\n")
    with pytest.raises(InputError, match="stand for more than"):
        read_source(tmp_path / "source.yaml")


def test_the_share_that_is_advised_is_never_too_small() -> None:
    assert [share_above(1, 3), share_above(2, 3), share_above(1, 2), share_above(1, 100_000)] == [
        0.334,
        0.667,
        0.5,
        0.001,
    ]


def test_the_longest_unit_at_the_end_of_a_name_counts() -> None:
    names = ("ankle_deg_s", "motor_rad_per_s", "t_s", "load_Nm", "theta_m", "deg")
    assert [likely_unit(name) for name in names] == ["deg/s", "rad/s", "s", "Nm", "", ""]
