# SPDX-License-Identifier: Apache-2.0
"""Markers that OptiTrack Motive exports as CSV.

The first line has keys and values, as `Export Frame Rate` and `Length Units`. Below it stand a row
each of types, names, IDs, and quantities, the header `Frame, Time (Seconds), X, Y, Z, ...`, and a
row a frame.
"""

from functools import partial
from itertools import pairwise
from pathlib import Path

from osl_analysis.base.errors import InputError, shortened
from osl_analysis.base.recording import Format, Loss, Recording
from osl_analysis.base.source_file import MarkerSource
from osl_analysis.formats.marker_text import TRAJECTORIES, Section
from osl_analysis.formats.text_cells import (
    begins_with_text,
    check_last_line,
    is_number_cell,
    numbered,
    padded_to,
    read_text,
    split_rows,
)

UNITS = {"meters": "m", "centimeters": "cm", "millimeters": "mm"}  # as Motive spells them
MARKERS = ("Marker", "Bone Marker", "Rigid Body Marker")  # types of columns that are positions
BEFORE = 2  # columns: the number of the frame and its time


class OptitrackSource(MarkerSource):
    """The source file of exports of OptiTrack Motive."""


def read(path: Path, source: OptitrackSource | None) -> Recording:
    """Read the markers of an export; rigid bodies and bones are left out."""
    text = read_text(path)
    rows = split_rows(numbered(text.data), ",")
    first = next((place for place, row in enumerate(rows) if row.cells[0] == "Frame"), 0)
    frames = rows[first + 1 :]
    if not first or not frames:
        raise InputError("holds no header `Frame, Time (Seconds)` or no frame", "export it again")
    check_last_line(text.is_ended, frames)
    keys = dict(pairwise(rows[0].cells))
    rate = keys.get("Export Frame Rate") or keys.get("Capture Frame Rate") or ""
    unit = UNITS.get(keys.get("Length Units", "").casefold(), "")
    if not is_number_cell(rate) or float(rate) <= 0 or not unit:
        raise InputError(
            f"its first line says Export Frame Rate '{shortened(rate)}' and Length Units"
            f" '{shortened(keys.get('Length Units', ''))}'",
            "export it again, with its header",
        )
    stated_frames = keys.get("Total Exported Frames", "")
    if is_number_cell(stated_frames) and float(stated_frames) != len(frames):
        raise InputError(
            f"its first line states {stated_frames} frames, and it holds {len(frames)}",
            "copy or export it again",
        )
    width = len(rows[first].cells)
    above = [padded_to(width, row.cells, "") for row in rows[1:first]]
    kinds, names, *_, quantities = above
    is_marker = [
        kind in MARKERS and quantity == "Position"
        for kind, quantity in zip(kinds, quantities, strict=True)
    ]
    section = Section(
        title=TRAJECTORIES,
        rate_hz=float(rate),
        rows=frames,
        names=[name if chosen else "" for name, chosen in zip(names, is_marker, strict=True)],
        components=rows[first].cells,
        units=[unit] * width,
    )
    channels = section.channels()
    if not channels:
        raise InputError("holds no marker", "export markers, not rigid bodies alone")
    facts = {
        "frames": len(frames),
        "first_frame": section.first_frame(),
        "frame_rate_hz": section.rate_hz,
        "samples_per_frame": 1,
        "length_unit": unit,
        "vertical_on_screen": "Y",  # of Motive's axes
    }
    return Recording("optitrack", channels, Loss(len(frames), len(frames)), facts=facts)


FORMAT = Format(
    name="optitrack",
    suffixes=(),
    begins=partial(begins_with_text, r'\A"?Format Version"?,"?\d'),
    source=OptitrackSource,
    read=read,
)
