"""Files of formats that are not read are told by what they hold: one line with what it is and what to do."""

import gzip
import io
import json
import sqlite3
import tarfile
import time
import zipfile
from contextlib import closing
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from c3d_builder import REAL_DATA, write_c3d
from click.testing import CliRunner

from osl_analysis.cli import main
from osl_analysis.errors import InputError
from osl_analysis.formats.mcap.walk import MAGIC
from osl_analysis.formats.other_formats import OTHERS, other_format
from osl_analysis.ingest.known_formats import recognise
from osl_analysis.ingest.raw_files import trial_from_files

BENCH = "t,angle\n0,1\n0.01,2\n0.02,3\n"


def archive(name: str, content: bytes = b"x") -> bytes:
    """A ZIP archive with one entry."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as file:
        file.writestr(name, content)
    return stream.getvalue()


def saved(save: object, *content: object) -> bytes:
    """What a function writes to a stream."""
    stream = io.BytesIO()
    save(stream, *content)  # type: ignore[operator]
    return stream.getvalue()


def database() -> bytes:
    """An SQLite database as `ros2 bag record` writes it."""
    with closing(sqlite3.connect(":memory:")) as connection:
        connection.execute("CREATE TABLE topics (id INTEGER, name TEXT)")
        return connection.serialize()


def tar() -> bytes:
    """A tar archive of one file."""
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w") as file:
        file.addfile(tarfile.TarInfo("log.csv"))
    return stream.getvalue()


QTM = "NO_OF_FRAMES\t100\nNO_OF_CAMERAS\t8\nMARKER_NAMES\tA\tB\n1\t2\t3\n"
OTHER_FILES = {
    "Qualisys": QTM.encode(),
    "Motive": b"Format Version,1.23,Take Name,walk\n,,Marker\nFrame,Time,X\n0,0.0,1\n",
    "Cortex": b"File_Type:\tAnalog R/C ASCII\tGeneration#:\t1\n",
    "BVH": b"HIERARCHY\nROOT Hips\n{\n",
    "LabVIEW measurement": b"LabVIEW Measurement\t\nWriter_Version\t2\n",
    "Git LFS": b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n",
    "git-annex": b"/annex/objects/SHA256E-s1234--4d7a.csv\n",
    "description of a ROS 2 bag": b"rosbag2_bagfile_information:\n  version: 5\n",
    "ros2 topic echo": b"header:\n  stamp:\n    sec: 12\nposition:\n- 0.1\n---\n",
    "source file": b"# mine\nformat: csv\ntime: {column: t}\n",
    "web page": b"\n<!DOCTYPE html><html><head></head></html>",
    "XML": b'<?xml version="1.0"?><a/>',
    "RTF": b"{\\rtf1\\ansi t,angle}",
    "JSON": json.dumps([{"t": 0.0}], indent=2).encode(),
    "document of JSON": b"[0.0, 1.0]\n[0.1, 2.0]\n",
    "a document of JSON": b"{'t': 0.0, 'angle': 1.0}\n",
    "script": b"#!/usr/bin/env python3\nprint(1)\n",
    "Excel workbook": archive("[Content_Types].xml"),
    "OpenDocument": archive("mimetype", b"application/vnd.oasis.opendocument.spreadsheet"),
    "NumPy archive": saved(np.savez, np.arange(3)),
    "ZIP archive": archive("log.csv", b"t,angle\n"),
    "old Excel": b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(500),
    "HDF5": b"\x89HDF\r\n\x1a\n" + bytes(100),
    "NetCDF": b"CDF\x01" + bytes(20),
    "Parquet": saved(lambda stream: pl.DataFrame({"t": [0.0, 1.0]}).write_parquet(stream)),
    "Arrow": saved(lambda stream: pl.DataFrame({"t": [0.0, 1.0]}).write_ipc(stream)),
    "NumPy array": saved(np.save, np.arange(3)),
    "pickle": b"\x80\x04\x95\x10\x00\x00\x00",
    "EDF": (b"0       " + b"X" * 176 + b"768     ").ljust(256),
    "compressed": gzip.compress(BENCH.encode()),
    "7z": b"7z\xbc\xaf\x27\x1c\x00\x04",
    "tar": tar(),
    "PDF": b"%PDF-1.4\n1 0 obj\n",
    "image": b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR",
    "video": b"\x00\x00\x00\x18ftypmp42",
    "program": b"\x7fELF\x02\x01\x01\x00",
    "UTF-32": BENCH.encode("utf-32"),
    "UTF-16 without its mark": BENCH.encode("utf-16-le"),
    "zero bytes": bytes(2000),
}


@pytest.mark.parametrize("what", OTHER_FILES)
def test_a_file_of_another_format_is_named_whatever_it_is_called(tmp_path: Path, what: str) -> None:
    for name in ("log.csv", "log.dat", "log.c3d"):
        (tmp_path / name).write_bytes(OTHER_FILES[what])
        with pytest.raises(InputError, match=rf"{name}: .*{what}.*, which is not read; \w+") as caught:
            recognise(tmp_path / name)
        assert str(caught.value).isprintable()


def test_every_format_that_is_not_read_has_a_file_here() -> None:
    named = {other_format(content) for content in OTHER_FILES.values()}
    assert named == set(OTHERS)


@pytest.mark.parametrize(
    "text",
    [
        BENCH,
        "<__main__.Joint object at 0x7fe6>.output_position,time\n1,0\n",
        "<Joint object at 0x7fe6>.output_position,time\n1,0\n",
        "[s],[deg]\n0,1\n",
        "PAR1,PAR2\n1,2\n",
        "CDF,MZ\n1,2\n",
        "header,stamp\n1,2\n",
        "# endheader follows\nt,angle\n0,1\n",
        "0       ,1\n",
        "format;t\n1;2\n",
    ],
)
def test_a_table_is_not_taken_for_another_format(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.txt").write_text(text)
    assert recognise(tmp_path / "a.txt") == "csv"


def ingested(folder: Path, name: str, source: str) -> object:
    """A trial from one file, by a source file."""
    (folder / "source.yaml").write_text(source)
    return trial_from_files({"trial": "a", "log": name, "log_source": "source"}, folder, folder)


SOURCE = "format: csv\ntime: {column: t, unit: s}\nchannels:\n  theta: {column: angle, unit: deg}\n"


def test_ingest_refuses_by_content_too(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(QTM)
    with pytest.raises(InputError, match="an export of Qualisys Track Manager in TSV, which is not read"):
        ingested(tmp_path, "a.csv", SOURCE)


def test_a_source_file_of_another_format_is_refused_with_the_format_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(MAGIC + bytes(100))
    with pytest.raises(InputError, match="is mcap, its source file says csv; write `format: mcap`"):
        ingested(tmp_path, "a.csv", SOURCE)
    write_c3d(tmp_path / "b.csv", np.ones((4, 2, 4)), np.ones((8, 1)))
    with pytest.raises(InputError, match="is c3d, its source file says csv"):
        ingested(tmp_path, "b.csv", SOURCE)
    (tmp_path / "c.csv").write_bytes(b"\x01\x00\x02")
    with pytest.raises(InputError, match=r"is no text .* its source file says csv; name the recording itself"):
        ingested(tmp_path, "c.csv", SOURCE)
    (tmp_path / "d.c3d").write_text(BENCH)
    assert ingested(tmp_path, "d.c3d", SOURCE)


def test_zeros_after_a_loss_of_power_are_named_by_line_and_the_advice_works(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(BENCH.encode() + bytes(300))
    with pytest.raises(InputError, match=r"line 5 holds zero bytes, .* delete the file from there on"):
        ingested(tmp_path, "a.csv", SOURCE)
    lines = (tmp_path / "a.csv").read_bytes().split(b"\n")
    (tmp_path / "a.csv").write_bytes(b"\n".join(lines[:4]))
    assert ingested(tmp_path, "a.csv", SOURCE)


@pytest.mark.skipif(not REAL_DATA.is_dir(), reason="no recordings made by others here")
@pytest.mark.parametrize(
    ("path", "what"),
    [
        ("bag/rosbag2_test_metadata.yaml", "the description of a ROS 2 bag"),
    ],
)
def test_real_files_of_other_formats_are_named_in_one_line(path: str, what: str) -> None:
    result = CliRunner().invoke(main, ["inspect", str(REAL_DATA / path)])
    assert result.exit_code == 1
    assert len(result.output.splitlines()) == 1
    assert f": {what}" in result.output


@pytest.mark.parametrize("begin", [b"\n" * 65536, b"header:" + b"\n" * 65500, b"annex/objects/" * 4600 + b" x"])
def test_the_format_of_64_kb_is_told_in_a_moment_whatever_they_repeat(begin: bytes) -> None:
    """A pattern that reads the rest of the text at each of its lines takes 20 s, a good one below 0.4 s."""
    started = time.process_time()
    assert other_format(begin[:65536]) is None
    assert time.process_time() - started < 3


@pytest.mark.parametrize("name", ["ros2 topic echo"])
def test_the_ends_of_lines_do_not_hide_a_format(name: str) -> None:
    content = OTHER_FILES[name]
    found = other_format(content.replace(b"\n", b"\r\n"))
    assert found is not None
    assert found == other_format(content)
