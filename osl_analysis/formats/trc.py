"""Marker positions in TRC, as Cortex and OpenSim write them: a header of five lines, and a row per frame."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.formats.csv_table import (
    Rows,
    UnreadableCellError,
    decoded_text,
    is_number_cell,
    is_text,
    number,
    numbers,
    read_lines,
    unpadded,
)
from osl_analysis.trial import Array

BEGIN = "PathFileType"
UNSEEN = ("", "nan", "NaN", "NAN")  # cells of a marker that was not seen
ROUNDING = 0.6  # of the last decimal of a time: half of it by rounding, and a little for sums in single precision
EXPORT = "export it again, or correct the header"


@dataclass(frozen=True)
class TrcFile:
    """The markers of one file."""

    path: Path
    labels: list[str]
    positions: Array  # (frames, markers, 3) in `unit`; NaN where a marker was not seen
    rate: float  # frames per second [Hz]
    unit: str  # unit of length, as the file spells it; empty where it gives none
    first_frame: int
    start: float  # time of the first frame [s]
    notes: tuple[str, ...] = ()  # oddities, a sentence each


def is_trc(begin: bytes) -> bool:
    return is_text(begin) and decoded_text(begin[:200]).lstrip().casefold().startswith(BEGIN.casefold())


def read_trc(path: Path) -> TrcFile:
    """The markers of a file; InputError if its header is not that of TRC, or contradicts the rows."""
    lines = read_lines(path)
    if not lines or not lines[0][1].lstrip().casefold().startswith(BEGIN.casefold()):
        raise InputError(f"{path}: no TRC file: its first line does not begin with {BEGIN}; check the source's format")
    if len(lines) < 6:
        raise InputError(f"{path}: holds no frames, only {len(lines)} lines of a header; export it again")
    said = {key.casefold(): value for key, value in zip(cells_of(lines[1]), cells_of(lines[2]), strict=False) if key}
    frames, markers = (whole(path, said, key, lines[2][0]) for key in ("NumFrames", "NumMarkers"))
    labels = [cell for cell in cells_of(lines[3])[2:] if cell]
    if len(labels) < markers:
        raise InputError(f"{path}: NumMarkers is {markers}, line {lines[3][0]} names {len(labels)}; {EXPORT}")
    rows = [(line, cells_of((line, text))) for line, text in lines[5:]]
    if len(rows) != frames:
        cut = ": the end is missing" if len(rows) < frames else ""
        raise InputError(f"{path}: NumFrames is {frames}, the file holds {len(rows)} rows{cut}; {EXPORT}")
    width = 2 + 3 * markers
    table = np.column_stack([column_of(path, rows, place, place < 2) for place in range(width)])
    check_widths(path, rows, width)
    rate = hertz(path, said, lines[2][0])
    first, start = check_frames(path, rows, table[:, :2], rate)
    positions = table[:, 2:].reshape(frames, markers, 3)
    positions[(positions == 0).all(axis=2)] = np.nan
    empty = f"{len(labels) - markers} names after the {markers} markers have no positions, such as {labels[-1][:40]}"
    notes = (empty,) * (len(labels) > markers)  # Cortex names its virtual markers and leaves them out
    return TrcFile(path, labels[:markers], positions, rate, said.get("units", ""), first, start, notes)


def cells_of(line: tuple[int, str]) -> list[str]:
    """The cells of a line, stripped. Tabs separate them; only a header without a tab is separated by blanks."""
    return [cell.strip() for cell in (line[1].split("\t") if "\t" in line[1] else line[1].split())]


def whole(path: Path, said: dict[str, str], key: str, line: int) -> int:
    text = said.get(key.casefold(), "")
    if not (text.isascii() and text.isdigit() and 0 < int(text) < 10**8):
        raise InputError(f"{path}: line {line}: {key} is {text[:40]!r} and no count above zero; {EXPORT}")
    return int(text)


def hertz(path: Path, said: dict[str, str], line: int) -> float:
    text = said.get("datarate", "")
    rate = number(text, 0) if is_number_cell(text) else 0.0
    if rate <= 0:
        raise InputError(f"{path}: line {line}: DataRate is {text[:40]!r} and no rate in Hz; {EXPORT}")
    return rate


def column_of(path: Path, rows: Rows, place: int, required: bool) -> Array:
    """One column, (frames,); NaN where a marker was not seen."""
    cells = [row[place] if place < len(row) else "" for _, row in rows]
    try:
        return numbers(cells, () if required else UNSEEN, ".")[0]
    except UnreadableCellError as error:
        what = ("frame", "time")[place] if place < 2 else f"column {place + 1}"
        raise InputError(
            f"{path}: line {rows[error.place][0]}, {what}: '{cells[error.place][:40]}' is not a number; export it again"
        ) from error


def check_widths(path: Path, rows: Rows, width: int) -> None:
    """Refuse a row that has more coordinates than the header names, or a marker of which one or two are missing."""
    for line, padded in rows:
        cells = unpadded(padded, 0)
        if len(cells) > width:
            raise InputError(
                f"{path}: line {line} has {len(cells) - 2} coordinates, the header names {(width - 2) // 3} markers; "
                f"{EXPORT}"
            )
        if len(cells) < width and (len(cells) - 2) % 3:
            raise InputError(f"{path}: line {line} ends within a marker, after {len(cells)} cells; export it again")


def check_frames(path: Path, rows: Rows, table: Array, rate: float) -> tuple[int, float]:
    """First frame and its time [s], of frames and times (frames, 2); refused unless they go on evenly."""
    frame, time = table.T
    count = np.arange(frame.size)
    wrong = frame != frame[0] + count
    if wrong.any() or frame[0] != np.rint(frame[0]):
        place = int(np.argmax(wrong))
        raise InputError(
            f"{path}: line {rows[place][0]}: frame {frame[place]:g} does not follow the line before; export all frames"
        )
    decimals = max(len(row[1].partition(".")[2]) for _, row in rows[:100])
    late = np.abs(time - time[0] - count / rate)
    wrong = late > 2 * ROUNDING * 10.0**-decimals + 1e-3 / rate + 1e-4 * count / rate
    if wrong.any():
        place = int(np.argmax(wrong))
        raise InputError(
            f"{path}: line {rows[place][0]}: time {time[place]:g} s does not fit DataRate {rate:g} Hz from "
            f"{time[0]:g} s on; correct DataRate or the times"
        )
    return int(frame[0]), float(time[0])
