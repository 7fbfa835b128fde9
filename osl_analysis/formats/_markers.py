"""Markers in tables of text: three columns of coordinates a marker, a row a frame."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from osl_analysis.formats._text import Row, column_of, decoded, is_text
from osl_analysis.recording import Channel, Kind, Loss, Recording, Rows

UNSEEN = ("", "nan", "NaN", "NAN", "null")  # cells of a marker that was not seen
EXPORT_AGAIN = "export it again"


def positions_in(rows: Sequence[Row], first: int, markers: int) -> NDArray[np.float64]:
    """Read the positions of markers, (rows, markers, 3); NaN where one was not seen.

    Parameters
    ----------
    first
        Place of the first coordinate in each row.

    Raises
    ------
    InputError
        A cell is no number.
    """
    coordinates = [
        column_of(rows, place, UNSEEN, f"column {place + 1}")
        for place in range(first, first + 3 * markers)
    ]
    positions = np.column_stack(coordinates).reshape(len(rows), markers, 3)
    positions[(positions == 0).all(axis=2)] = np.nan  # programs write 0 for an unseen marker
    return positions


def recording_of_markers(
    format_name: str,
    labels: Sequence[str],
    positions: NDArray[np.float64],
    unit: str,
    rate_hz: float,
    first_frame: int = 1,
    start_s: float = 0.0,
    remarks: Sequence[str] = (),
) -> Recording:
    """Make a channel of each marker.

    Parameters
    ----------
    positions
        Shape (frames, markers, 3), in `unit`.
    """
    frames = len(positions)
    rows = Rows(frames, "points", rate_hz, start_s=start_s, noun="frame")
    channels = [
        Channel(
            address={"label": label},
            rows=rows,
            read=partial(np.asanyarray, positions[:, place]),
            name=label,
            unit=unit,
            kind=Kind.MARKER,
        )
        for place, label in enumerate(labels)
    ]
    facts = {
        "frames": frames,
        "first_frame": first_frame,
        "frame_rate_hz": rate_hz,
        "samples_per_frame": 1,
        "length_unit": unit,
        "start_s": start_s,
    }
    return Recording(format_name, channels, Loss(frames, frames, remarks=remarks), facts=facts)


def begins_with_key(begin: bytes, key: str) -> bool:
    """Tell whether a file is text whose first word begins with a key, in any case."""
    return is_text(begin) and decoded(begin[:200]).lstrip().casefold().startswith(key.casefold())
