"""Markers that Qualisys Track Manager exports as TSV: an example of a format in one file.

Lines of keys stand above the frames: NO_OF_FRAMES, FREQUENCY, MARKER_NAMES. Then a header may name
the columns, and each line holds one frame: maybe its number and time, then x, y, z of each marker
[mm] (QTM user manual, "TSV file formats").
"""

from functools import partial
from pathlib import Path

from osl_analysis.errors import InputError
from osl_analysis.formats._captured_text import (
    begins_with_key,
    recording_of_markers,
    rows_of,
)
from osl_analysis.formats._cells import is_number_cell
from osl_analysis.formats._text import check_last_line, read_text, unpadded
from osl_analysis.recording import Format, Recording
from osl_analysis.source_file import MarkerSource

FIRST_KEY = "NO_OF_FRAMES"


class QualisysSource(MarkerSource):
    """The source file of markers in Qualisys' TSV."""


def read(path: Path, source: QualisysSource | None) -> Recording:
    """Read the markers; refused if the keys contradict the frames."""
    text = read_text(path)
    rows = rows_of(text)
    keys = {row.cells[0].casefold(): row.cells[1:] for row in rows}
    header = {key: "".join(values[:1]) for key, values in keys.items()}
    frames = [row for row in rows if is_number_cell(row.cells[0])]
    labels = unpadded(keys.get("marker_names", []))
    if not labels or not frames:
        raise InputError(
            f"it has {len(labels)} names under MARKER_NAMES and {len(frames)} frames; export the"
            " trial again"
        )
    check_last_line(text.is_ended, frames)
    return recording_of_markers(
        "qualisys",
        labels,
        frames,
        # a frame may begin with its number, or number and time
        first=max(len(unpadded(row.cells)) for row in frames) - 3 * len(labels),
        header=header,
        keys=(FIRST_KEY, "FREQUENCY"),
        unit="mm",  # the export has no other one
    )


FORMAT = Format(
    name="qualisys",
    suffixes=(),
    begins=partial(begins_with_key, key=FIRST_KEY),
    source=QualisysSource,
    read=read,
    priority=1,
)
