"""CSV logs: what others' loggers write is read, repaired by a stated rule, or refused by its line."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from osl_analysis.errors import InputError
from osl_analysis.ingest.csv_log import CsvSource, read_csv_log
from osl_analysis.ingest.recording import Recording

SOURCES = Path(__file__).parents[1] / "config" / "sources"


def source(**fields: object) -> CsvSource:
    usual = {
        "format": "csv",
        "time": {"column": "t", "unit": "s"},
        "channels": {"theta": {"column": "angle", "unit": "deg"}, "torque": {"column": "load", "unit": "Nm"}},
    }
    return CsvSource.model_validate({**usual, **fields})


def read(tmp_path: Path, text: str | bytes, csv_source: CsvSource | None = None) -> Recording:
    path = tmp_path / "log.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_csv_log(path, csv_source or source())


def refused(tmp_path: Path, text: str | bytes, csv_source: CsvSource | None = None) -> str:
    with pytest.raises(InputError) as caught:
        read(tmp_path, text, csv_source)
    message = str(caught.value)
    assert message.startswith(str(tmp_path / "log.csv"))
    assert message.isprintable()
    return message


UNITLESS: dict[str, object] = {
    "channels": {"theta": {"column": "angle"}, "torque": {"column": "load"}},
    "time": {"column": "t"},
}
LOG = "t,angle,load\n10.0,0,1\n10.5,90,2\n11.0,-180,+3.5\n"


def assert_log(recording: Recording) -> None:
    np.testing.assert_allclose(recording.samples["time"], [0, 0.5, 1.0], rtol=1e-12)
    np.testing.assert_allclose(recording.samples["theta"], [0, math.pi / 2, -math.pi], rtol=1e-12)
    np.testing.assert_allclose(recording.samples["torque"], [1, 2, 3.5], rtol=1e-12)


@pytest.mark.parametrize(
    ("text", "fields"),
    [
        (LOG, {}),
        (LOG.replace(",", ";"), {}),
        (LOG.replace(",", "\t"), {}),
        (LOG.replace(",", "   "), {"delimiter": "space"}),
        (LOG.replace(",", ";").replace(".", ","), {"decimal": ","}),
        (LOG.replace("\n", "\r\n"), {}),
        (LOG.replace("\n", ",,,\n"), {}),
        (LOG.replace(",", " , "), {}),
        (LOG.encode("utf-16"), {}),
        (b"\xef\xbb\xbf" + LOG.encode(), {}),
        ("\n\n" + LOG + "\n\n", {}),
        ("# Bench 3, calibrated\n#\n" + LOG.replace("10.5", "# pause\n10.5"), {}),
        ("# rig B\n# " + LOG, {"header": "comment"}),
        (LOG.replace("t,angle,load", "load,t,angle").replace("10.0,0,1", "1,10.0,0").replace(
            "10.5,90,2", "2,10.5,90").replace("11.0,-180,+3.5", "3.5,11.0,-180"), {}),
        (LOG, {"time": {"rate": 2.0}}),
        (LOG.replace("load\n", "load\ns,deg,Nm\n"), UNITLESS | {"units_row": True}),
        ('"t","angle","load"\n"10.0","0","1"\n"10.5","90","2"\n"11.0","-180","+3.5"\n', {}),
    ],
    ids=[
        *("plain", "semicolons", "tabs", "spaces", "decimal-comma", "crlf", "padded", "blanks", "utf-16", "bom"),
        *("blank-lines", "comments", "header-in-comment", "order", "rate", "row-of-units", "quoted"),
    ],
)  # fmt: skip
def test_one_log_in_any_dress_is_one_log(tmp_path: Path, text: str | bytes, fields: dict[str, object]) -> None:
    assert_log(read(tmp_path, text, source(**fields)))


@pytest.mark.parametrize("title", ["angle [deg]", "angle (deg)", "angle[deg]"])
def test_units_in_the_columns_names_are_the_files(tmp_path: Path, title: str) -> None:
    text = (
        LOG.replace("t,angle,load", f"t [s],{title},load [N.mm]").replace(",1\n", ",1000\n").replace(",2\n", ",2e3\n")
    )
    recording = read(tmp_path, text.replace("+3.5", "3500"), source(**UNITLESS))
    assert_log(recording)
    assert recording.columns["torque"]["unit"] == "N.mm"


def test_a_log_without_header_is_read_by_the_columns_numbers(tmp_path: Path) -> None:
    channels = {"theta": {"column": 2, "unit": "deg"}, "torque": {"column": 3, "unit": "Nm"}}
    by_number = source(channels=channels, time={"column": "1", "unit": "s"}, header="none")
    assert_log(read(tmp_path, LOG.partition("\n")[2], by_number))


def test_scale_sign_and_offset_are_applied_in_that_order(tmp_path: Path) -> None:
    channel = {"column": "angle", "unit": "rev", "scale": 0.5, "sign": -1, "offset": 10.0}
    theta = read(tmp_path, LOG, source(channels={"theta": channel})).samples["theta"]
    np.testing.assert_allclose(theta, [-10 * math.pi, -100 * math.pi, 170 * math.pi], rtol=1e-12)


def test_the_source_files_unit_wins_over_the_files_and_says_so(tmp_path: Path) -> None:
    recording = read(tmp_path, LOG.replace("angle", "angle [rad]"))
    assert_log(recording)
    assert recording.warnings == ["log.csv: theta is read in deg; the file says rad"]


@pytest.mark.parametrize(
    ("text", "fields", "problem"),
    [
        ("", {}, "holds no rows"),
        ("t,angle,load\n", {}, "no rows of data"),
        (LOG.partition("\n")[2], {}, "line 1 holds numbers, not the columns' names; write `header: none`"),
        (LOG.replace("angle", "winkel"), {}, "column 'angle' is missing; the file has t, winkel, load"),
        (LOG.replace("load", "angle"), {}, "column 'angle' occurs 2 times"),
        (LOG.replace("90", "fault"), {}, "line 3, column 'angle': 'fault' is not a number"),
        (LOG.replace("90", "1e999"), {}, "line 3, column 'angle': '1e999' is not a number"),
        (LOG.replace("90", "inf"), {}, "line 3, column 'angle': 'inf' is not a number"),
        (LOG.replace("90", "9_0"), {}, "line 3, column 'angle': '9_0' is not a number"),
        (LOG.replace("10.5", "9.5"), {}, "time goes from 0.000000 s to -0.500000 s at row 1"),
        (LOG.replace("10.5", ""), {}, "line 3: no time in column 't'"),
        (LOG.replace("90", ""), {}, "column 'angle' is missing in 1 of 3 rows, first in line 3; at most 1.0% may be"),
        (LOG.replace("90,2", "90,2,7"), {}, "line 3 has 4 cells under 3 names, and 1 of 3 rows do not fit"),
        (LOG.replace("90,2", "90"), {}, "line 3 has 2 cells under 3 names"),
        (LOG.replace("90", '"90'), {}, "line 3: a quote is not closed"),
        (LOG.replace("90", "9" * 200_000), {}, "line 3: field larger than field limit"),
        (b"\x89MCAP0\r\n\0\0\0", {}, "line 2 holds zero bytes"),
        (LOG, {"time": {"column": "t"}}, "column 't': the unit is empty; write one of s, ms"),
        (LOG, {"channels": {"theta": {"column": "angle"}}}, "column 'angle': the unit is empty; write one of rad"),
        ("t,angle,load\n1,2\n", {"ragged": "skip", "most_missing": 1.0}, "none of its rows fits the header's 3 names"),
        (LOG, {"header": "comment"}, "no line begins with '#'"),
        (LOG.replace("angle", "an\x1b[2Jgle"), {}, r"the file has t, an\x1b[2Jgle, load"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_refused_by_line_or_column(
    tmp_path: Path, text: str | bytes, fields: dict[str, object], problem: str
) -> None:
    assert problem in refused(tmp_path, text, source(**fields))


def test_failed_reads_become_nan_and_are_counted(tmp_path: Path) -> None:
    text = LOG.replace("90", "ERROR")
    recording = read(tmp_path, text, source(missing=["ERROR"], most_missing=0.4))
    assert recording.samples["theta"].is_nan().to_list() == [False, True, False]
    assert recording.facts["missing"] == {"theta": 1, "torque": 0}
    assert recording.warnings == ["log.csv: theta is missing in 1 of 3 rows"]


DROPPED = "t,angle,load\n0,1,5\n1,ERROR,6\n2,ERROR,7\n3,8\n4,9\n"


def test_a_variable_that_the_logger_dropped_is_missing_from_there_on_and_the_others_keep_their_columns(
    tmp_path: Path,
) -> None:
    recording = read(tmp_path, DROPPED, source(missing=["ERROR"], most_missing=0.8, ragged="dropped_variable"))
    np.testing.assert_allclose(recording.samples["torque"], [5, 6, 7, 8, 9])
    assert recording.samples["theta"].is_nan().to_list() == [False, True, True, True, True]
    assert recording.warnings[0] == "log.csv: from line 5 on, columns 2 are missing"


@pytest.mark.parametrize(
    "text",
    [
        DROPPED.replace("2,ERROR,7", "2,3,7"),
        DROPPED.replace("2,ERROR,7", "2,ERROR,ERROR"),
        DROPPED.replace("4,9", "4,9,9"),
    ],
    ids=["none was missing", "two were missing", "longer again"],
)
def test_a_row_whose_columns_nothing_tells_is_refused_by_its_line(tmp_path: Path, text: str) -> None:
    message = refused(tmp_path, text, source(missing=["ERROR"], most_missing=1.0, ragged="dropped_variable"))
    assert "it is unknown which column was omitted" in message
    assert f"line {6 if '4,9,9' in text else 5} has" in message


def test_stray_rows_are_skipped_and_counted_where_the_source_allows_it(tmp_path: Path) -> None:
    text = LOG.replace("10.5,90,2", "10.2,1,2,3,4\n10.5,90,2")
    recording = read(tmp_path, text, source(ragged="skip", most_missing=0.3))
    assert_log(recording)
    assert recording.warnings == ["log.csv: 1 of 4 rows do not fit the header and were skipped"]


def test_a_last_line_that_is_cut_off_is_left_out_with_a_warning(tmp_path: Path) -> None:
    recording = read(tmp_path, LOG + "11.5,17")
    assert_log(recording)
    assert recording.warnings == ["log.csv: the last line, 5, is cut off and was skipped"]
    assert recording.facts["damage"] == {"complete": False}
    assert "damage" not in read(tmp_path, LOG).facts


def test_the_comment_lines_of_a_bench_are_kept_in_the_provenance(tmp_path: Path) -> None:
    assert read(tmp_path, "# rig: B\n#operator: K\n" + LOG).facts["comments"] == ["rig: B", "operator: K"]


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({"time": {}}, "state either the column that holds time or the rate"),
        ({"time": {"column": "t", "rate": 100}}, "state either"),
        ({"clock": "sync"}, "needs the column sync"),
        ({"channels": {"plate": {"column": "a", "unit": "N"}}}, "'plate' is not a canonical column"),
        ({"channels": {"plate1_force": {"column": "a", "unit": "N"}}}, "not a canonical column"),
        ({"channels": {"marker_": {"column": "a", "unit": "m"}}}, "not a canonical column"),
        ({"channels": {"theta": {"column": "a", "unit": "N"}}}, r"unit 'N' measures \[N\]"),
        ({"channels": {"theta": {"column": "a", "unit": "rad", "scale": 0}}}, "scale of zero"),
        ({"units_row": True, "header": "none"}, "needs a header row"),
    ],
)
def test_a_mistake_in_a_source_file_is_refused(fields: dict[str, object], problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        source(**fields)


cells = st.one_of(
    st.floats(allow_nan=True).map(repr), st.text(max_size=6), st.sampled_from(["", "ERROR", "1,5", '"', "#", "\0", "t"])
)


@given(
    rows=st.lists(st.lists(cells, max_size=5), max_size=8),
    sign=st.sampled_from([",", ";", "\t", " "]),
    fields=st.fixed_dictionaries(
        {},
        optional={
            "header": st.sampled_from(["row", "none", "comment"]),
            "ragged": st.sampled_from(["refuse", "skip", "dropped_variable"]),
            "units_row": st.booleans(),
            "most_missing": st.sampled_from([0.0, 0.5, 1.0]),
            "time": st.just({"rate": 100.0}),
            "decimal": st.sampled_from([".", ","]),
        },
    ),
)
@settings(max_examples=400, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_text_is_samples_or_a_sentence(
    tmp_path: Path, rows: list[list[str]], sign: str, fields: dict[str, object]
) -> None:
    text = "\n".join(["t;angle;load".replace(";", sign), *(sign.join(row) for row in rows)])
    path = tmp_path / "log.csv"
    path.write_bytes(text.encode("utf-8", errors="replace"))
    try:
        csv_source = source(**fields)
    except ValueError:
        return
    try:
        recording = read_csv_log(path, csv_source)
    except InputError as error:
        message = str(error)
    else:
        message = "read"
        assert len(recording.samples) <= len(rows) + 1
        assert recording.samples["time"].is_finite().all()
    assert message.isprintable()


@given(
    values=st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=20),
    sign=st.sampled_from([",", ";", "\t"]),
    decimal=st.sampled_from([".", ","]),
)
@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_numbers_come_back_to_the_last_bit(tmp_path: Path, values: list[float], sign: str, decimal: str) -> None:
    if sign == decimal == ",":
        return
    lines = [sign.join(["t", "angle", "load"])]
    lines += [sign.join([str(i), repr(value).replace(".", decimal), "0"]) for i, value in enumerate(values)]
    channels = {"theta": {"column": "angle", "unit": "rad"}}
    samples = read(tmp_path, "\n".join(lines), source(decimal=decimal, channels=channels)).samples
    assert samples["theta"].to_list() == values


def test_equal_stamps_are_kept_as_few_decimals_or_a_row_written_twice_make_them(tmp_path: Path) -> None:
    recording = read(tmp_path, LOG.replace("10.5", "10.0"))
    assert recording.samples["time"].to_list() == [0.0, 0.0, 1.0]


def test_what_a_source_file_states_of_a_sensor_stands_in_si_units_in_the_provenance(tmp_path: Path) -> None:
    stated = {"delay": "2 ms", "low_pass": {"cutoff": "0.1 kHz", "order": 2}, "resolution": "10 N*mm"}
    fields = {
        "time": {"column": "t", "unit": "s", "stamps": "even"},
        "channels": {
            "theta": {"column": "angle", "unit": "deg", "bits": 14},
            "torque": {"column": "load", "unit": "Nm", **stated},
        },
    }
    recording = read(tmp_path, LOG, source(**fields))
    torque = recording.columns["torque"]
    assert torque["delay"] == 0.002
    assert torque["low_pass"] == {"cutoff_hz": 100.0, "order": 2}
    assert torque["resolution"] == pytest.approx(0.01)
    assert recording.columns["theta"]["resolution"] == pytest.approx(2 * np.pi / 2**14)
    assert "delay" not in recording.columns["theta"]
    assert recording.facts["time"]["stamps"] == "even"


@pytest.mark.parametrize(
    ("stated", "problem"),
    [
        ({"delay": "2"}, "the unit is empty; write one of s, ms"),
        ({"delay": "2 deg"}, "unit 'deg' measures [rad], expected one of s, ms"),
        ({"delay": "soon"}, "'soon' is not a number with a unit; write it as in `2 s`"),
        ({"low_pass": {"cutoff": "-5 Hz"}}, "a cut-off must be above zero"),
        ({"low_pass": {"cutoff": "5 Hz", "order": 0}}, "greater than or equal to 1"),
        ({"resolution": "0.1 deg"}, "'0.1 deg' is not allowed: unit 'deg' measures [rad]"),
        ({"bits": 14}, "14 is not allowed: `bits` are those of an encoder per revolution; state `resolution`"),
    ],
)
def test_a_sensor_that_is_stated_wrongly_is_refused_with_the_remedy(stated: dict[str, object], problem: str) -> None:
    with pytest.raises(ValueError, match=re.escape(problem)):
        source(channels={"torque": {"column": "load", "unit": "Nm", **stated}})


def test_a_delay_longer_than_the_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"torque: a delay of 2 s is longer than the recording of 1 s; correct"):
        read(tmp_path, LOG, source(channels={"torque": {"column": "load", "unit": "Nm", "delay": "2 s"}}))


def test_a_device_s_counter_is_read_beside_its_channel_and_must_be_whole(tmp_path: Path) -> None:
    text = "t,angle,load,n\n0,0,1,5\n0.5,90,2,6\n1,-180,3,8\n"
    counted = source(channels={"theta": {"column": "angle", "unit": "deg", "counter": "n"}})
    assert read(tmp_path, text, counted).samples["theta_counter"].to_list() == [5, 6, 8]
    for broken in ("6.5", ""):
        assert "line 3, column 'n': " in refused(tmp_path, text.replace("2,6", f"2,{broken}"), counted)
