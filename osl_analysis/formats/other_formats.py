"""Formats that are not read, told by their content: those that pass for a log, or that laboratories often have.

The ending of a name proves nothing. Without this table a marker file in TSV passes for a CSV log with nonsense columns.
"""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from osl_analysis.errors import InputError
from osl_analysis.formats.csv_table import CONTROL, UTF_16_MARKS, decoded_text
from osl_analysis.formats.json_lines import is_json_lines

FIRST_BYTES = 1 << 16  # bytes of a file that `refuse_others` needs
ZIP = b"PK\x03\x04"
HDF5 = b"\x89HDF\r\n\x1a\n"
COMPRESSED = (ZIP, b"\x1f\x8b", b"BZh", b"\xfd7zXZ\0", b"\x28\xb5\x2f\xfd", b"7z\xbc\xaf\x27\x1c", b"Rar!")
AS_C3D = "export the trial as C3D"
AS_CSV = "export its table as CSV in UTF-8"
SHEET = "save its sheet as 'CSV UTF-8'"


class OtherFormat(NamedTuple):
    """One format that is not read."""

    name: str  # what the file is, with its article
    remedy: str  # what to do, as an imperative
    begins: Callable[[bytes], bool]  # whether a file that begins with these bytes is of this format


def starting(*marks: bytes) -> Callable[[bytes], bool]:
    """A test of the first bytes. Text never passes: `PAR1` is also the name of a column."""
    return lambda begin: begin.startswith(marks) and CONTROL.search(begin) is not None


def text_with(pattern: str) -> Callable[[bytes], bool]:
    """A test for a regular expression in a text, with `^` at the begin of any line."""
    found = re.compile(pattern, re.MULTILINE | re.IGNORECASE)
    return lambda begin: found.search(beginning_text(begin)) is not None


def beginning_text(begin: bytes) -> str:
    """The text that a file begins with; empty if it is not text."""
    return decoded_text(begin) if b"\0" not in begin or begin[:2] in UTF_16_MARKS else ""


def is_json_document(begin: bytes) -> bool:
    """Whether a text begins with an object or a list of JSON, or a dictionary as Python prints it, and is not lines."""
    text = beginning_text(begin).lstrip()
    if text[:1] not in ("{", "[") or is_json_lines(begin):
        return False
    if re.match(r"\{\s*[\"'}]|\[\s*\{", text):
        return True
    try:
        return isinstance(json.loads(text.splitlines()[0]), dict | list)
    except (ValueError, RecursionError):
        return False


LVM = "delete its lines down to the last `***End_of_Header***` and save the rest as CSV"
PARQUET = f"{AS_CSV}, or give it to `osl-analysis fit` if `ingest` wrote it"
OTHERS = (
    OtherFormat("nothing but zero bytes", "copy or record it again", lambda begin: bool(begin) and not any(begin)),
    OtherFormat(
        "an export of Qualisys Track Manager in TSV", AS_C3D, text_with(r"\A\s*NO_OF_(FRAMES|SAMPLES|CAMERAS)\b")
    ),
    OtherFormat("an export of OptiTrack Motive in CSV", AS_C3D, text_with(r"\A\"?Format Version\"?,\"?\d")),
    OtherFormat("a LabVIEW measurement (.lvm)", LVM, text_with(r"\A\s*LabVIEW Measurement")),
    OtherFormat(
        "a pointer of Git LFS",
        "fetch the recording itself with `git lfs pull`",
        text_with(r"\A\s*version https://git-lfs"),
    ),
    OtherFormat("the description of a ROS 2 bag", "name its folder", text_with(r"^rosbag2_bagfile_information:")),
    OtherFormat("a document of JSON", "write JSON lines, an object per line and sample", is_json_document),
    OtherFormat("an Excel workbook", SHEET, starting(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1")),
    OtherFormat(
        "an Excel workbook",
        SHEET,
        lambda begin: begin.startswith(ZIP) and any(name in begin for name in (b"xl/", b"[Content_Types].xml")),
    ),
    OtherFormat(  # none that MATLAB wrote
        "an HDF5 file",
        AS_CSV,
        lambda begin: (
            not begin.startswith(b"MATLAB 7.") and HDF5 in [begin[at : at + 8] for at in (0, 512, 1024, 2048)]
        ),
    ),
    OtherFormat("a Parquet file", PARQUET, starting(b"PAR1")),
    OtherFormat("compressed (such as ZIP or gzip)", "unpack it and name the recording inside", starting(*COMPRESSED)),
)
"""In the order in which they are tried: what is more special comes first."""


def refuse_others(path: Path, begin: bytes) -> None:
    """Refuse a file of a format that is not read."""
    other = next((one for one in OTHERS if one.begins(begin[:FIRST_BYTES])), None)
    if other is not None:
        raise InputError(f"{path}: {other.name}, which is not read; {other.remedy}")
