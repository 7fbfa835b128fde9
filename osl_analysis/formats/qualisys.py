"""Markers that Qualisys Track Manager exports as TSV: an example of a format in one file.

Lines of keys stand above the frames: NO_OF_FRAMES, FREQUENCY, MARKER_NAMES. Then a header may name
the columns, and each line holds one frame: maybe its number and time, then x, y, z of each marker
[mm] (QTM user manual, "TSV file formats").
"""

from functools import partial
from pathlib import Path

from osl_analysis.errors import InputError
from osl_analysis.formats._cells import is_number_cell
from osl_analysis.formats._markers import (
    EXPORT_AGAIN,
    begins_with_key,
    positions_in,
    recording_of_markers,
)
from osl_analysis.formats._text import Row, check_last_line, numbered, read_text, unpadded
from osl_analysis.recording import Format, Recording
from osl_analysis.source_file import MarkerSource

FIRST_KEY = "NO_OF_FRAMES"
UNIT = "mm"  # the export has no other one


class QualisysSource(MarkerSource):
    """The source file of markers in Qualisys' TSV."""

    OF = " of format qualisys"


def read(path: Path, source: QualisysSource | None) -> Recording:
    """Read the markers; refused if the keys contradict the frames."""
    text = read_text(path)
    rows = [
        Row(line.number, [cell.strip() for cell in line.text.split("\t")])
        for line in numbered(text.data)
    ]
    frames = [row for row in rows if is_number_cell(row.cells[0])]
    keys = {row.cells[0]: row.cells[1:] for row in rows if not is_number_cell(row.cells[0])}
    count = int(_number(keys, FIRST_KEY))
    rate_hz = _number(keys, "FREQUENCY")
    labels = unpadded(keys.get("MARKER_NAMES", []))
    if not labels or rate_hz <= 0:
        raise InputError(
            f"MARKER_NAMES has {len(labels)} names, FREQUENCY is {rate_hz:g} Hz; {EXPORT_AGAIN}"
        )
    if len(frames) != count:
        raise InputError(
            f"NO_OF_FRAMES is {count}, the file holds {len(frames)} frames; {EXPORT_AGAIN}"
        )
    check_last_line(text.is_ended, frames)
    first = _first_coordinate(frames[0], 3 * len(labels))
    positions = positions_in(frames, first, len(labels))
    return recording_of_markers("qualisys", labels, positions, UNIT, rate_hz)


def _number(keys: dict[str, list[str]], key: str) -> float:
    values = keys.get(key, [""])
    if not is_number_cell(values[0]):
        raise InputError(f"{key} is {values[0][:40]!r} and no number; {EXPORT_AGAIN}")
    return float(values[0])


def _first_coordinate(frame: Row, coordinates: int) -> int:
    """Place of the first coordinate: a frame may begin with its number, or number and time."""
    before = len(frame.cells) - coordinates
    if before not in (0, 1, 2):
        raise InputError(
            f"line {frame.number} has {len(frame.cells)} cells, MARKER_NAMES asks for"
            f" {coordinates}; {EXPORT_AGAIN}"
        )
    return before


FORMAT = Format(
    name="qualisys",
    suffixes=(),
    begins=partial(begins_with_key, key=FIRST_KEY),
    source=QualisysSource,
    read=read,
    priority=1,
)
