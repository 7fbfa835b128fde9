"""Markers in TRC, as Motion Analysis defined it: a header of five lines, then a row per frame.

By hand: no maintained library reads it alone.
"""

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.formats._cells import is_number_cell
from osl_analysis.formats._markers import (
    EXPORT_AGAIN,
    begins_with_key,
    positions_in,
    recording_of_markers,
)
from osl_analysis.formats._text import (
    Row,
    check_last_line,
    column_of,
    numbered,
    read_text,
    unpadded,
)
from osl_analysis.recording import Format, Recording
from osl_analysis.source_file import MarkerSource
from osl_analysis.units import LengthUnit

FIRST_KEY = "PathFileType"
HEADER_LINES = 5
MOST_FRAMES = 10**8
CORRECT = f"{EXPORT_AGAIN}, or correct the header"


class TrcSource(MarkerSource):
    """The source file of markers in TRC."""

    OF = " of format trc"
    point_unit: LengthUnit | None = None  # Unit of length, where the file's own is absent or wrong.


def read(path: Path, source: TrcSource | None) -> Recording:
    """Read the markers; refused if the header is not that of TRC, or contradicts the rows."""
    text = read_text(path)
    lines = numbered(text.data)
    if not lines or not lines[0].text.lstrip().casefold().startswith(FIRST_KEY.casefold()):
        raise InputError(
            "no TRC file: its first line does not begin with PathFileType; check the source's"
            " format"
        )
    if len(lines) <= HEADER_LINES:
        raise InputError(f"holds no frames, only {len(lines)} lines of a header; export it again")
    rows = []
    for line in lines:
        cells = line.text.split("\t") if "\t" in line.text else line.text.split()
        rows.append(Row(line.number, [cell.strip() for cell in cells]))
    header = {
        key.casefold(): value
        for key, value in zip(rows[1].cells, rows[2].cells, strict=False)
        if key
    }
    line_of_values = rows[2].number
    frames = _count(header, "NumFrames", line_of_values)
    markers = _count(header, "NumMarkers", line_of_values)
    labels = [cell for cell in rows[3].cells[2:] if cell]
    if len(labels) < markers:
        raise InputError(
            f"NumMarkers is {markers}, line {rows[3].number} names {len(labels)}; {CORRECT}"
        )
    body = rows[HEADER_LINES:]
    if len(body) != frames:
        cut = ": the end is missing" if len(body) < frames else ""
        raise InputError(f"NumFrames is {frames}, the file holds {len(body)} rows{cut}; {CORRECT}")
    check_last_line(text.is_ended, body)
    for row in body:
        count = len(unpadded(row.cells)) - 2
        if count > 3 * markers or count % 3:
            raise InputError(
                f"line {row.number} has {count} coordinates, its header names {markers} markers;"
                f" {CORRECT}"
            )
    frame = column_of(body, 0, (), "frame")
    time = column_of(body, 1, (), "time")
    rate_hz = _rate(header, line_of_values)
    _check_frames(body, frame)
    _check_times(body, time, rate_hz)
    remarks: list[str] = []
    if len(labels) > markers:  # Cortex names its virtual markers and leaves them out
        remarks.append(
            f"{len(labels) - markers} names after the {markers} markers have no positions, such as"
            f" {labels[-1][:40]}"
        )
    return recording_of_markers(
        "trc",
        labels[:markers],
        positions_in(body, first=2, markers=markers),
        unit=header.get("units", ""),
        rate_hz=rate_hz,
        first_frame=int(frame[0]),
        start_s=float(time[0]),
        remarks=remarks,
    )


def _count(header: dict[str, str], key: str, line: int) -> int:
    text = header.get(key.casefold(), "")
    is_whole = text.isascii() and text.isdigit()
    if not is_whole or not 0 < int(text) < MOST_FRAMES:
        raise InputError(f"line {line}: {key} is {text[:40]!r} and no count above zero; {CORRECT}")
    return int(text)


def _rate(header: dict[str, str], line: int) -> float:
    text = header.get("datarate", "")
    rate_hz = float(text) if is_number_cell(text) else 0.0
    if rate_hz <= 0:
        raise InputError(f"line {line}: DataRate is {text[:40]!r} and no rate in Hz; {CORRECT}")
    return rate_hz


def _check_frames(rows: Sequence[Row], frame: NDArray[np.float64]) -> None:
    """Refuse frames that do not follow one another."""
    follows = frame == frame[0] + np.arange(frame.size)
    if frame[0] != np.rint(frame[0]):
        follows[:] = False
    if not follows.all():
        row = int(np.argmin(follows))
        raise InputError(
            f"line {rows[row].number}: frame {frame[row]:g} does not follow the line before;"
            " export all frames"
        )


def _check_times(rows: Sequence[Row], time: NDArray[np.float64], rate_hz: float) -> None:
    """Refuse times that do not fit the rate."""
    # OpenSim prints more decimals than its times have
    printed = [row.cells[1].partition(".")[2] for row in rows]
    most = max(len(decimals) for decimals in printed)
    used = max(len(decimals.rstrip("0")) for decimals in printed)
    needed = math.ceil(math.log10(rate_hz))  # with fewer, no frame is told from the next
    rounding_s = 0.6 * 10.0 ** -min(most, max(used, needed))  # half of the last decimal, and some
    count = np.arange(time.size)
    tolerance_s = 2 * rounding_s + (1e-3 + 1e-4 * count) / rate_hz
    fits = np.abs(time - time[0] - count / rate_hz) <= tolerance_s
    if not fits.all():
        row = int(np.argmin(fits))
        raise InputError(
            f"line {rows[row].number}: time {time[row]:g} s does not fit DataRate {rate_hz:g} Hz"
            f" from {time[0]:g} s on; correct DataRate or the times"
        )


FORMAT = Format(
    name="trc",
    suffixes=(".trc",),
    begins=partial(begins_with_key, key=FIRST_KEY),
    source=TrcSource,
    read=read,
    priority=1,
)
