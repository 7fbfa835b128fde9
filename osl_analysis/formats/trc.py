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
from osl_analysis.formats._text import (
    Row,
    check_last_line,
    column_of,
    decoded,
    is_text,
    numbered,
    read_text,
    unpadded,
)
from osl_analysis.recording import Channel, Format, Kind, Loss, Recording, Rows
from osl_analysis.source_file import MarkerSource
from osl_analysis.units import LengthUnit

HEADER_LINES = 5
UNSEEN = ("", "nan", "NaN", "NAN")  # cells of a marker that was not seen
MOST_FRAMES = 10**8
EXPORT_AGAIN = "export it again, or correct the header"


class TrcSource(MarkerSource):
    """The source file of markers in TRC."""

    OF = " of format trc"
    point_unit: LengthUnit | None = None  # Unit of length, where the file's own is absent or wrong.


def read(path: Path, source: TrcSource | None) -> Recording:
    """Read the markers; refused if the header is not that of TRC, or contradicts the rows."""
    text = read_text(path)
    lines = numbered(text.data)
    if not lines or not lines[0].text.lstrip().casefold().startswith("pathfiletype"):
        raise InputError(
            "no TRC file: its first line does not begin with PathFileType; check the source's"
            " format"
        )
    if len(lines) <= HEADER_LINES:
        raise InputError(f"holds no frames, only {len(lines)} lines of a header; export it again")
    rows = [Row(line.number, _cells_of(line.text)) for line in lines]
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
            f"NumMarkers is {markers}, line {rows[3].number} names {len(labels)}; {EXPORT_AGAIN}"
        )
    body = rows[HEADER_LINES:]
    if len(body) != frames:
        cut = ": the end is missing" if len(body) < frames else ""
        raise InputError(
            f"NumFrames is {frames}, the file holds {len(body)} rows{cut}; {EXPORT_AGAIN}"
        )
    check_last_line(text.is_ended, body)
    _check_widths(body, markers)
    frame = column_of(body, 0, (), "frame", "export it again")
    time = column_of(body, 1, (), "time", "export it again")
    coordinates = [
        column_of(body, place, UNSEEN, f"column {place + 1}", "export it again")
        for place in range(2, 2 + 3 * markers)
    ]
    rate_hz = _rate(header, line_of_values)
    _check_frames(body, frame)
    _check_times(body, time, rate_hz)
    positions = np.column_stack(coordinates).reshape(frames, markers, 3)
    positions[(positions == 0).all(axis=2)] = np.nan  # not seen
    remarks: list[str] = []
    if len(labels) > markers:  # Cortex names its virtual markers and leaves them out
        remarks.append(
            f"{len(labels) - markers} names after the {markers} markers have no positions, such as"
            f" {labels[-1][:40]}"
        )
    unit = header.get("units", "")
    of_frames = Rows(frames, "points", rate_hz, start_s=float(time[0]), noun="frame")
    channels = [
        Channel(
            address={"label": label},
            rows=of_frames,
            read=partial(np.asanyarray, positions[:, place]),
            name=label,
            unit=unit,
            kind=Kind.MARKER,
        )
        for place, label in enumerate(labels[:markers])
    ]
    facts = {
        "frames": frames,
        "first_frame": int(frame[0]),
        "frame_rate_hz": rate_hz,
        "samples_per_frame": 1,
        "length_unit": unit,
        "start_s": float(time[0]),
    }
    return Recording("trc", channels, Loss(frames, frames, remarks=remarks), facts=facts)


def _cells_of(text: str) -> list[str]:
    cells = text.split("\t") if "\t" in text else text.split()
    return [cell.strip() for cell in cells]


def _count(header: dict[str, str], key: str, line: int) -> int:
    text = header.get(key.casefold(), "")
    is_whole = text.isascii() and text.isdigit()
    if not is_whole or not 0 < int(text) < MOST_FRAMES:
        raise InputError(
            f"line {line}: {key} is {text[:40]!r} and no count above zero; {EXPORT_AGAIN}"
        )
    return int(text)


def _rate(header: dict[str, str], line: int) -> float:
    text = header.get("datarate", "")
    rate_hz = float(text) if is_number_cell(text) else 0.0
    if rate_hz <= 0:
        raise InputError(
            f"line {line}: DataRate is {text[:40]!r} and no rate in Hz; {EXPORT_AGAIN}"
        )
    return rate_hz


def _check_widths(rows: Sequence[Row], markers: int) -> None:
    for row in rows:
        count = len(unpadded(row.cells)) - 2
        if count > 3 * markers or count % 3:
            raise InputError(
                f"line {row.number} has {count} coordinates, its header names {markers} markers;"
                f" {EXPORT_AGAIN}"
            )


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


def _begins(begin: bytes) -> bool:
    return is_text(begin) and decoded(begin[:200]).lstrip().casefold().startswith("pathfiletype")


FORMAT = Format(
    name="trc", suffixes=(".trc",), begins=_begins, source=TrcSource, read=read, priority=1
)
