"""Markers in TRC, as Motion Analysis defined it: a header of five lines, then a row per frame.

By hand: no maintained library reads it alone.
"""

from functools import partial
from pathlib import Path

from osl_analysis.errors import InputError
from osl_analysis.formats._captured_text import begins_with_key, recording_of_markers, rows_of
from osl_analysis.formats._text import check_last_line, read_text
from osl_analysis.recording import Format, Recording
from osl_analysis.source_file import MarkerSource
from osl_analysis.units import LengthUnit

FIRST_KEY = "PathFileType"
HEADER_LINES = 5


class TrcSource(MarkerSource):
    """The source file of markers in TRC."""

    point_unit: LengthUnit | None = None  # Unit of length, where the file's own is absent or wrong.


def read(path: Path, source: TrcSource | None) -> Recording:
    """Read the markers; refused if the header is not that of TRC, or contradicts the rows."""
    text = read_text(path)
    rows = rows_of(text)
    if len(rows) <= HEADER_LINES:
        raise InputError(f"holds no frames, only {len(rows)} lines of a header; export it again")
    keys, values, names = ([cell for cell in row.cells if cell] for row in rows[1:4])
    header = dict(zip([key.casefold() for key in keys], values, strict=False))
    body = rows[HEADER_LINES:]
    check_last_line(text.is_ended, body)
    markers = header.get("nummarkers", "")
    # Cortex names its virtual markers behind the others, and leaves them out
    labels = names[2:][: int(markers) if markers.isdecimal() else None]
    return recording_of_markers(
        "trc",
        labels,
        body,
        first=2,
        header=header,
        keys=("NumFrames", "DataRate"),
        unit=header.get("units", ""),
    )


FORMAT = Format(
    name="trc",
    suffixes=(".trc",),
    begins=partial(begins_with_key, key=FIRST_KEY),
    source=TrcSource,
    read=read,
    priority=1,
)
