"""Files of formats that are not read are told by what they hold: one line with what it is and what to do."""

import gzip
import io
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from c3d_builder import write_c3d

from osl_analysis.errors import InputError
from osl_analysis.formats.mcap import MAGIC
from osl_analysis.ingest.raw_files import recognise, trial_from_files

BENCH = "t,angle\n0,1\n0.01,2\n0.02,3\n"


def archive(name: str, content: bytes = b"x") -> bytes:
    """A ZIP archive with one entry."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as file:
        file.writestr(name, content)
    return stream.getvalue()


QTM = "NO_OF_FRAMES\t100\nNO_OF_CAMERAS\t8\nMARKER_NAMES\tA\tB\n1\t2\t3\n"
OTHER_FILES = {
    "Qualisys": QTM.encode(),
    "Motive": b"Format Version,1.23,Take Name,walk\n,,Marker\nFrame,Time,X\n0,0.0,1\n",
    "LabVIEW measurement": b"LabVIEW Measurement\t\nWriter_Version\t2\n",
    "JSON": json.dumps([{"t": 0.0}], indent=2).encode(),
    "document of JSON": b"[0.0, 1.0]\n[0.1, 2.0]\n",
    "a document of JSON": b"{'t': 0.0, 'angle': 1.0}\n",
    "Excel workbook": archive("[Content_Types].xml"),
    "an Excel workbook": b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(500),
    "ZIP": archive("log.csv", b"t,angle\n"),
    "HDF5": b"\x89HDF\r\n\x1a\n" + bytes(100),
    "compressed": gzip.compress(BENCH.encode()),
    "zero bytes": bytes(2000),
}


@pytest.mark.parametrize("what", OTHER_FILES)
def test_a_file_of_another_format_is_named_whatever_it_is_called(tmp_path: Path, what: str) -> None:
    for name in ("log.csv", "log.dat", "log.c3d"):
        (tmp_path / name).write_bytes(OTHER_FILES[what])
        with pytest.raises(InputError, match=rf"{name}: .*{what}.*, which is not read; \w+") as caught:
            recognise(tmp_path / name)
        assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    "text",
    [
        BENCH,
        "<__main__.Joint object at 0x7fe6>.output_position,time\n1,0\n",
        "[s],[deg]\n0,1\n",
        "CDF,MZ\n1,2\n",
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


def test_a_full_stop_is_no_decimal_sign_beside_a_decimal_comma(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t;angle\n0;1,5\n0,01;1.234\n")
    with pytest.raises(InputError, match=r"line 3, column 'angle': '1.234' is not a number; write `decimal: "):
        ingested(tmp_path, "a.csv", SOURCE.replace("csv\n", 'csv\ndecimal: ","\n'))
