"""Inspect: what a file holds is listed, a draft becomes a source file, and nothing reaches the terminal raw."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from c3d_builder import REAL_DATA, write_c3d
from click.testing import CliRunner
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from osl_analysis.cli import main
from osl_analysis.commands.inspect import inspect_file, overview_text
from osl_analysis.errors import InputError
from osl_analysis.ingest.csv_log import read_csv_log
from osl_analysis.ingest.csv_source import CsvSource
from osl_analysis.ingest.draft import draft_source
from osl_analysis.ingest.known_formats import read_source

NASTY = 'a\x1b[2J": {x\n# y\u202eb'
LATIN = NASTY.replace("\u202e", "\x9b")
REAL_FILES = sorted(p for p in REAL_DATA.glob("*/*") if p.parent.name in ("c3d", "mcap", "nexus_csv"))


def write_mcap(path: Path, topic: str = "/leg", count: int = 50, finish: bool = True) -> Path:
    schema = b"std_msgs/Header header\nfloat64 angle\nfloat32[] load\nstring note\n"
    header = b"===\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1000, compression=CompressionType.ZSTD)
        writer.start()
        leg = writer.register_schema("x_msgs/msg/Leg", "ros2msg", schema + header)
        binary = writer.register_channel(topic, "cdr", leg)
        text = writer.register_channel("/text", "json", 0)
        for i in range(count):
            stamp = i * 10_000_000 + (500_000_000 if i > 20 else 0)
            writer.add_message(binary, stamp, bytes(40), stamp)
            writer.add_message(text, stamp, b'{"a": {"b": 1.5}, "c": [1, 2], "d": "x"}', stamp)
        writer.finish()
    if not finish:
        path.write_bytes(path.read_bytes()[:-300])
    return path


def test_an_mcap_file_lists_fields_rates_and_gaps(tmp_path: Path) -> None:
    text = overview_text(inspect_file(write_mcap(tmp_path / "a.mcap")))
    assert "x_msgs/msg/Leg (cdr) /leg angle  50 samples at 100 Hz; 1 gaps, the longest 0.510 s" in text
    assert "/leg load[0]" in text
    assert "note" not in text
    assert "json           /text a.b" in text
    assert "/text c[0]" in text
    assert "messages: 100" in text


def test_damage_of_an_mcap_file_is_listed_and_the_rest_too(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "a.mcap", finish=False)
    assert "! no footer: the recorder did not finish" in overview_text(inspect_file(path))
    whole = bytearray(write_mcap(path).read_bytes())
    whole[700] ^= 0xFF
    path.write_bytes(whole)
    text = overview_text(inspect_file(path))
    assert "is damaged" in text
    assert "/leg angle" in text


def test_a_drafted_mcap_source_is_complete_once_its_channels_are_named(tmp_path: Path) -> None:
    content = draft_source(inspect_file(write_mcap(tmp_path / "a.mcap")), "a.mcap")
    path = tmp_path / "source.yaml"
    path.write_text(content)
    with pytest.raises(InputError, match="'NAME_1' is no canonical column"):
        read_source(path)
    kept = [line for line in content.splitlines() if "NAME_" not in line or "NAME_1:" in line]
    path.write_text("\n".join(kept).replace("NAME_1", "theta").replace("UNKNOWN,", "").replace("UNKNOWN", "deg"))
    source = read_source(path)
    assert source.format == "mcap"
    assert (source.time.source, source.channels["theta"].field) == ("header", "angle")


BENCH = "# rig: B\ntime [ms],angle [deg],state\n0,1.5,ok\n10,2.5,ok\n20,3.5,ERROR\n90,4\n"


def test_a_csv_file_lists_columns_units_gaps_words_and_odd_rows(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(BENCH)
    text = overview_text(inspect_file(tmp_path / "a.csv"))
    assert "comment 1: # rig: B" in text
    assert "column         angle [deg]  4 samples; from 1.5 to 4" in text
    assert "a clock, 0.1 per unit, 1 gaps, the longest 70.000 s" in text
    assert "2 x 'ok'" in text
    assert "! 1 rows have 2 cells under 3 names, the first in line 6" in text


def test_a_drafted_csv_source_reads_the_file_that_it_came_from(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(BENCH)
    content = draft_source(inspect_file(path), "a.csv").replace("NAME_1", "theta")
    (tmp_path / "a.yaml").write_text("\n".join(line for line in content.splitlines() if "NAME_2" not in line))
    source = read_source(tmp_path / "a.yaml")
    assert isinstance(source, CsvSource)
    np.testing.assert_allclose(read_csv_log(path, source).samples["time"], [0, 0.01, 0.02])


def test_a_drafted_c3d_source_is_complete(tmp_path: Path) -> None:
    path = write_c3d(tmp_path / "a.c3d", np.ones((4, 2, 4)), np.ones((8, 1)), POINT__LABELS=["TOE", LATIN])
    (tmp_path / "a.yaml").write_text(draft_source(inspect_file(path), "a.c3d"))
    source = read_source(tmp_path / "a.yaml")
    assert source.format == "c3d"
    assert source.plates == ()
    assert source.markers == "all"
    (tmp_path / "some.yaml").write_text(
        (tmp_path / "a.yaml")
        .read_text()
        .replace("# or some: markers", "")
        .replace("markers: all", "", 1)
        .replace("\n: [", "\nmarkers: [")
    )
    some = read_source(tmp_path / "some.yaml")
    assert some.markers[0] == "TOE"
    assert some.markers[1].startswith('a\x1b[2J": {x\n# y')


@pytest.mark.parametrize("kind", ["mcap", "c3d", "csv", "nexus"])
def test_nothing_of_a_file_reaches_the_terminal_raw_or_leaves_its_quotes(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"a.{kind}"
    if kind == "mcap":
        write_mcap(path, topic=NASTY)
    elif kind == "c3d":
        write_c3d(path, np.ones((4, 1, 4)), np.ones((4, 1)), POINT__LABELS=[LATIN], ANALOG__UNITS=[LATIN])
    else:
        nasty = NASTY.replace("\n", "").replace('"', "'")
        table = f"# {nasty}\nt,{nasty} [{nasty}]\n0,{nasty}\n"
        nexus = f"Trajectories\n100\n,,{nasty},,\nFrame,Sub Frame,X,Y,Z\n,,{nasty},mm,mm\n1,0,1,2,3\n"
        path.write_text(table if kind == "csv" else nexus)
    result = CliRunner().invoke(main, ["inspect", str(path)])
    assert result.exit_code == 0, result.output
    assert all(line.isprintable() for line in result.output.split("\n"))
    drafted = result.output.partition("A source file to start from:")[2]
    assert isinstance(yaml.safe_load(drafted), dict)
    begins = ("format", "desc", "clock", "delim", "header", "time", "#", "channels", "  NAME_", "markers", "plates")
    assert all(line.startswith(begins) for line in drafted.split("\n") if line)


def test_the_draft_is_written_where_it_is_asked_for_and_never_over_a_file(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(BENCH)
    arguments = ["inspect", str(tmp_path / "a.csv"), "--draft", str(tmp_path / "a.yaml")]
    assert CliRunner().invoke(main, arguments).exit_code == 0
    assert (tmp_path / "a.yaml").read_text().startswith("format: csv\n")
    again = CliRunner().invoke(main, arguments)
    assert again.exit_code == 2
    assert "exists; name a new file" in again.output


@pytest.mark.parametrize(
    ("content", "problem"),
    [(b"", "the file is empty"), (b"PK\x03\x04\0\0\0", "neither MCAP, C3D nor text"), (b"\n\n", "holds no rows")],
)
def test_a_file_of_no_known_format_is_refused(tmp_path: Path, content: bytes, problem: str) -> None:
    (tmp_path / "a").write_bytes(content)
    with pytest.raises(InputError, match=problem):
        inspect_file(tmp_path / "a")


@pytest.mark.parametrize("path", REAL_FILES, ids=lambda path: path.stem)
def test_every_real_file_is_listed_or_refused_in_a_sentence(path: Path) -> None:
    if path.name in {"Empty.c3d", "Optotrak_truncated_29_of_1149.c3d", "s18_bad_parameter_section.c3d"}:
        with pytest.raises(InputError, match=path.name):
            inspect_file(path)
        return
    overview = inspect_file(path)
    assert overview.channels
    assert isinstance(yaml.safe_load(draft_source(overview, path.name)), dict)


@given(st.integers(0, 2000), st.integers(0, 255))
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_damaged_mcap_file_is_listed_as_far_as_it_goes(tmp_path: Path, place: int, value: int) -> None:
    path = tmp_path / "a.mcap"
    content = bytearray(write_mcap(path, count=20).read_bytes())
    content[place % len(content)] = value
    path.write_bytes(content)
    try:
        text = overview_text(inspect_file(path))
    except InputError as error:
        text = str(error)
    assert all(line.isprintable() for line in text.split("\n"))
