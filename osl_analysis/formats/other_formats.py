"""Formats that are not read, told by their content: those that pass for a log, or that laboratories often have.

The ending of a name proves nothing. Without this table a marker file in TSV passes for a CSV log with nonsense columns.
"""

import re
from pathlib import Path

from osl_analysis.errors import InputError
from osl_analysis.formats.binary_table import is_table_file
from osl_analysis.formats.csv_table import CONTROL, UTF_16_MARKS, decoded_text
from osl_analysis.formats.json_lines import is_json_lines

FIRST_BYTES = 1 << 16  # bytes of a file that `refuse_others` needs
AS_C3D = "export the trial as C3D"
HTML = r"\A\s*<(!doctype html|html|head|table|meta|\?xml[^>]*>\s*<(\?mso|workbook))"
JSON = r"\A\s*(\{\s*[\"'}]|\[\s*\{|\[[^\[\]]*\d\s*\]\s*$)"  # or a dictionary as Python prints it
PACKED = r"\A(PK\x03\x04|\x1f\x8b|BZh|\xfd7zXZ\0|\x28\xb5\x2f\xfd|7z\xbc\xaf\x27\x1c|Rar!)"
OTHERS = (
    ("an export of Qualisys Track Manager in TSV", r"\A\s*NO_OF_(FRAMES|SAMPLES|CAMERAS)\b", AS_C3D),
    ("an export of OptiTrack Motive in CSV", r'\A"?Format Version"?,"?\d', AS_C3D),
    ("a page of HTML or XML", HTML, "open it in the program that shows it, and save its table as CSV"),
    ("a document of JSON", JSON, "write JSON lines, an object per line and sample"),
    ("nothing but zero bytes", r"\A\0+\Z", "copy or record it again"),
    ("a PNG image", r"\A\x89PNG", "name the recording itself"),
    ("compressed (such as ZIP or gzip)", PACKED, "unpack it and name the recording inside"),
)
"""What a file is, how it begins, and what to do; what is more special comes first."""


def refuse_others(path: Path, begin: bytes) -> None:
    """Refuse a file of a format that is not read."""
    begin = begin[:FIRST_BYTES]
    if is_table_file(begin):
        return
    is_text = begin[:2] in UTF_16_MARKS or not CONTROL.search(begin)
    text = decoded_text(begin) if is_text else begin.decode("latin-1")
    for name, pattern, remedy in OTHERS:
        if re.search(pattern, text, re.MULTILINE | re.IGNORECASE) and not is_json_lines(begin):
            raise InputError(f"{path}: {name}, which is not read; {remedy}")
