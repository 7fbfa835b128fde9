"""Formats that are not read, told by their content: those that pass for a log, or that laboratories often have.

The ending of a name proves nothing. Without this table a marker file in TSV passes for a CSV log with nonsense columns.
"""

import re
from pathlib import Path

from osl_analysis.errors import InputError
from osl_analysis.formats.csv_table import CONTROL, UTF_16_MARKS, decoded_text
from osl_analysis.formats.json_lines import is_json_lines

FIRST_BYTES = 1 << 16  # bytes of a file that `refuse_others` needs
AS_C3D = "export the trial as C3D"
LVM = "delete its lines down to the last `***End_of_Header***` and save the rest as CSV"
JSON = r"\A\s*(\{\s*[\"'}]|\[\s*\{|\[[^\[\]]*\d\s*\]\s*$)"  # or a dictionary as Python prints it
EXCEL = r"(?s)\A(\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1|PK\x03\x04.*(xl/|\[Content_Types\]\.xml))"
HDF5 = r"(?s)\A(?!MATLAB [57]\.)(.{512}|.{1024}|.{2048})?\x89HDF\r\n\x1a\n"
PACKED = r"\A(PK\x03\x04|\x1f\x8b|BZh|\xfd7zXZ\0|\x28\xb5\x2f\xfd|7z\xbc\xaf\x27\x1c|Rar!)"
OTHERS = (
    ("an export of Qualisys Track Manager in TSV", r"\A\s*NO_OF_(FRAMES|SAMPLES|CAMERAS)\b", AS_C3D),
    ("an export of OptiTrack Motive in CSV", r'\A"?Format Version"?,"?\d', AS_C3D),
    ("a LabVIEW measurement (.lvm)", r"\A\s*LabVIEW Measurement", LVM),
    ("a document of JSON", JSON, "write JSON lines, an object per line and sample"),
    ("nothing but zero bytes", r"\A\0+\Z", "copy or record it again"),
    ("a PNG image", r"\A\x89PNG", "name the recording itself"),
    ("an Excel workbook", EXCEL, "save its sheet as 'CSV UTF-8'"),
    ("an HDF5 file", HDF5, "if it is MATLAB's, copy it again; else export its table as CSV in UTF-8"),
    ("compressed (such as ZIP or gzip)", PACKED, "unpack it and name the recording inside"),
)
"""What a file is, how it begins, and what to do; what is more special comes first."""


def refuse_others(path: Path, begin: bytes) -> None:
    """Refuse a file of a format that is not read."""
    begin = begin[:FIRST_BYTES]
    is_text = begin[:2] in UTF_16_MARKS or not CONTROL.search(begin)
    text = decoded_text(begin) if is_text else begin.decode("latin-1")
    for name, pattern, remedy in OTHERS:
        if re.search(pattern, text, re.MULTILINE | re.IGNORECASE) and not is_json_lines(begin):
            raise InputError(f"{path}: {name}, which is not read; {remedy}")
