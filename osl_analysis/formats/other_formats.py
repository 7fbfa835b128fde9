"""Formats that are not read, told by their content: what a file is, and what to do with it.

The ending of a name proves nothing. Without this table a marker file in TSV passes for a CSV log with nonsense columns.
"""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from osl_analysis.errors import InputError
from osl_analysis.formats.csv_table import CONTROL, UTF_16_MARKS, decoded_text
from osl_analysis.formats.json_lines import is_json_lines

FIRST_BYTES = 1 << 16
"""Bytes of a file that `other_format` needs."""
ZIP = b"PK\x03\x04"
HDF5 = b"\x89HDF\r\n\x1a\n"
AS_C3D = "export the trial as C3D"
AS_CSV = "export its table as CSV in UTF-8"
UNPACK = "unpack it and name the recording inside"
NO_RECORDING = "name the recording itself"


@dataclass(frozen=True)
class OtherFormat:
    """One format that is not read."""

    name: str
    """What the file is, with its article."""
    remedy: str
    """What to do, as an imperative."""
    begins: Callable[[bytes], bool]
    """Whether a file that begins with these bytes is of this format."""


def starting(*marks: bytes, at: int = 0) -> Callable[[bytes], bool]:
    """A test of the bytes at one place. Text never passes: `PAR1` is also the name of a column."""
    return lambda begin: begin.startswith(marks, at) and CONTROL.search(begin) is not None


def text_starting(*marks: str) -> Callable[[bytes], bool]:
    """A test of how a text begins, whatever its encoding, blanks and capitals."""
    return lambda begin: text_of(begin).lstrip().casefold().startswith(tuple(mark.casefold() for mark in marks))


def text_with(pattern: str) -> Callable[[bytes], bool]:
    """A test for a regular expression in a text, with `^` at the begin of any line.

    A `\\s*` that may begin at any line would read a file of empty lines once per line.
    """
    found = re.compile(pattern, re.MULTILINE | re.IGNORECASE)
    return lambda begin: found.search(text_of(begin)) is not None


def zip_with(*names: bytes) -> Callable[[bytes], bool]:
    """A test for a ZIP archive whose first entries have one of these names."""
    return lambda begin: begin.startswith(ZIP) and any(name in begin for name in names)


def text_of(begin: bytes) -> str:
    """The text that a file begins with; empty if it is not text."""
    return decoded_text(begin) if b"\0" not in begin or begin[:2] in UTF_16_MARKS else ""


def is_json(begin: bytes) -> bool:
    """Whether a text begins with an object or a list of JSON, or with a dictionary as Python prints it."""
    text = text_of(begin).lstrip()
    if text[:1] not in ("{", "["):
        return False
    if re.match(r"\{\s*[\"'}]|\[\s*\{", text):
        return True
    try:
        return isinstance(json.loads(text.splitlines()[0]), dict | list)
    except (ValueError, RecursionError):
        return False


def is_json_document(begin: bytes) -> bool:
    """Whether a file is JSON and not JSON lines."""
    return is_json(begin) and not is_json_lines(begin)


def is_utf_16_without_mark(begin: bytes) -> bool:
    """Whether every other byte is zero: Latin text in UTF-16 that does not begin with its mark."""
    even, odd = begin[: len(begin) // 2 * 2 : 2], begin[1::2]
    return len(odd) > 3 and ((not any(even) and all(odd)) or (not any(odd) and all(even)))


def is_edf(begin: bytes) -> bool:
    """Whether a file begins with the header of the European Data Format."""
    return begin[:8] == b"0       " and len(begin) > 255 and begin[184:192].strip().isdigit()


def is_hdf5(begin: bytes) -> bool:
    """Whether a file is HDF5 and none that MATLAB wrote."""
    return any(begin[at : at + 8] == HDF5 for at in (0, 512, 1024, 2048)) and not begin.startswith(b"MATLAB 7.")


VIDEO = starting(b"RIFF", b"\x1aE\xdf\xa3", b"OggS", b"fLaC", b"ID3")
OTHERS = (
    OtherFormat("nothing but zero bytes", "copy or record it again", lambda begin: bool(begin) and not any(begin)),
    OtherFormat(
        "an export of Qualisys Track Manager in TSV", AS_C3D, text_with(r"\A\s*NO_OF_(FRAMES|SAMPLES|CAMERAS)\b")
    ),
    OtherFormat("an export of OptiTrack Motive in CSV", AS_C3D, text_with(r"\A\"?Format Version\"?,\"?\d")),
    OtherFormat("an analog file of Cortex (.anc or .forces)", AS_C3D, text_starting("File_Type:", "[Force Data]")),
    OtherFormat("a BVH animation", AS_C3D, text_starting("HIERARCHY\n", "HIERARCHY\r")),
    OtherFormat(
        "a LabVIEW measurement (.lvm)",
        "delete its lines down to the last `***End_of_Header***` and save the rest as CSV",
        text_starting("LabVIEW Measurement"),
    ),
    OtherFormat(
        "a pointer of Git LFS",
        "fetch the recording itself with `git lfs pull`",
        text_starting("version https://git-lfs"),
    ),
    OtherFormat(
        "a pointer of git-annex",
        "fetch the recording with `git annex get`",
        text_with(r"\A/?\S*annex/objects/\S++\s*+\Z"),
    ),
    OtherFormat("the description of a ROS 2 bag", "name its folder", text_with(r"^rosbag2_bagfile_information:")),
    OtherFormat(
        "what `ros2 topic echo` prints",
        "record with `ros2 bag record -s mcap`",
        text_with(r"\A\s*(header|stamp):[ \t\r]*\n\s+\w+:"),
    ),
    OtherFormat("a source file", NO_RECORDING, text_with(r"\A(\s*#.*\n)*format: *[a-z][a-z0-9_]*[ \t\r]*$")),
    OtherFormat("a web page", "download the recording itself", text_starting("<!DOCTYPE html", "<html")),
    OtherFormat("XML", AS_CSV, text_starting("<?xml", "<!--", "<!DOCTYPE", "<svg")),
    OtherFormat("an RTF document", AS_CSV, text_starting("{\\rtf")),
    OtherFormat("a document of JSON", "write JSON lines, an object per line and sample", is_json_document),
    OtherFormat("a script", NO_RECORDING, text_starting("#!/")),
    OtherFormat("an Excel workbook", "save its sheet as 'CSV UTF-8'", zip_with(b"xl/", b"[Content_Types].xml")),
    OtherFormat("an OpenDocument file", "save its sheet as CSV in UTF-8", zip_with(b"mimetypeapplication/vnd.oasis")),
    OtherFormat("a NumPy archive (.npz)", AS_CSV, zip_with(b".npy")),
    OtherFormat("a ZIP archive", UNPACK, starting(ZIP, b"PK\x05\x06")),
    OtherFormat(
        "an old Excel or Word file", "save its sheet as 'CSV UTF-8'", starting(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1")
    ),
    OtherFormat("an HDF5 file", AS_CSV, is_hdf5),
    OtherFormat("a NetCDF file", AS_CSV, starting(b"CDF\x01", b"CDF\x02", b"CDF\x05")),
    OtherFormat(
        "a Parquet file",
        f"{AS_CSV}, or give it to `osl-analysis fit` if `ingest` wrote it",
        starting(b"PAR1"),
    ),
    OtherFormat("an Arrow or Feather file", AS_CSV, starting(b"ARROW1", b"FEA1")),
    OtherFormat("a NumPy array (.npy)", AS_CSV, starting(b"\x93NUMPY")),
    OtherFormat("a Python pickle", AS_CSV, starting(b"\x80\x02", b"\x80\x03", b"\x80\x04", b"\x80\x05")),
    OtherFormat("an EDF or BDF file", AS_CSV, lambda begin: is_edf(begin) or begin[:8] == b"\xffBIOSEMI"),
    OtherFormat(
        "compressed (gzip, bzip2, xz, zstd or lz4)",
        UNPACK,
        starting(b"\x1f\x8b", b"BZh", b"\xfd7zXZ\0", b"\x28\xb5\x2f\xfd", b"\x04\x22\x4d\x18"),
    ),
    OtherFormat("a 7z or RAR archive", UNPACK, starting(b"7z\xbc\xaf\x27\x1c", b"Rar!")),
    OtherFormat("a tar archive", UNPACK, starting(b"ustar", at=257)),
    OtherFormat("a PDF document", NO_RECORDING, lambda begin: begin.startswith((b"%PDF-", b"%!PS"))),
    OtherFormat(
        "an image",
        NO_RECORDING,
        starting(b"\x89PNG", b"\xff\xd8\xff", b"GIF8", b"II*\0", b"MM\0*", b"\0\0\1\0"),
    ),
    OtherFormat("a video or a sound", NO_RECORDING, lambda begin: VIDEO(begin) or starting(b"ftyp", at=4)(begin)),
    OtherFormat("a program", NO_RECORDING, starting(b"\x7fELF", b"MZ\x90\0")),
    OtherFormat("text in UTF-32", "save it in UTF-8", starting(b"\xff\xfe\0\0", b"\0\0\xfe\xff")),
    OtherFormat("text in UTF-16 without its mark", "save it in UTF-8", is_utf_16_without_mark),
)
"""In the order in which they are tried: what is more special comes first."""


def other_format(begin: bytes) -> OtherFormat | None:
    """The format of a file that begins with these bytes, if it is one that is not read; None if it is not known."""
    return next((other for other in OTHERS if other.begins(begin)), None)


def refuse_others(path: Path, begin: bytes) -> None:
    """Refuse a file of a format that is not read.

    Raises
    ------
    InputError
        The file that begins with `begin` is of such a format; the message says of which, and what to do.
    """
    other = other_format(begin[:FIRST_BYTES])
    if other is not None:
        raise InputError(f"{path}: {other.name}, which is not read; {other.remedy}")
