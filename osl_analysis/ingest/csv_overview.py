"""What a log in CSV holds: columns with units, rate and gaps, cells that are no numbers, and rows that do not fit."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.formats.csv_rows import check_header_place, unpadded
from osl_analysis.formats.csv_text import (
    DELIMITERS,
    Rows,
    delimiter_of,
    is_number_cell,
    name_and_unit,
    read_lines,
    split_rows,
    without_brackets,
)
from osl_analysis.ingest.column_names import is_clock, lasting_name, likely_unit
from osl_analysis.ingest.draft_places import NAME_OF_TIME, UNKNOWN
from osl_analysis.ingest.likely_clock import likely_clock
from osl_analysis.ingest.overview import Overview, RecordedChannel, gaps_text, rate_of, unit_of_clock
from osl_analysis.ingest.units import base_units, normalised

COMMENT = "#"
MOST_WORDS = 5
MOST_COMMENTS = 20
LEAST_NUMBERS = 0.5
"""Share of the rows in which one column at least must hold a number: what has less is prose."""
SAMPLE = 5  # rows in which a decimal comma is sought


def inspect_csv(path: Path) -> Overview:
    """Columns with units, rate, gaps and cells that are no numbers.

    Raises
    ------
    InputError
        The file is not text, has no rows, or is no table of numbers.
    """
    lines = read_lines(path)
    comments = [text for _, text in lines if text.lstrip().startswith(COMMENT)]
    content = [(line, text) for line, text in lines if not text.lstrip().startswith(COMMENT)]
    delimiter = delimiter_of(content, "auto")
    rows = split_rows(path, content, delimiter)
    if not rows:
        raise InputError(f"{path}: holds no rows; check that it is a recording")
    headed = not all(is_number_cell(cell.replace(",", ".")) for cell in rows[0][1] if cell)
    first = unpadded(rows[0][1], 0)
    names = first if headed else [str(place + 1) for place in range(len(first))]
    body = [(line, unpadded(cells, len(names))) for line, cells in (rows[1:] if headed else rows)]
    if headed:
        check_header_place(path, rows[0], body)
    has_units = headed and bool(body) and is_units_row(body[0][1])
    units, body = (body[0][1], body[1:]) if has_units else ([], body)
    if not body:
        raise InputError(f"{path}: no rows of data below the header; check that it is a recording")
    check_numbers(path, body)
    named = {name: numbers(cells_of(body, place)).to_numpy() for place, name in enumerate(names) if is_clock(name)}
    clock, left_open = likely_clock(named)
    channels = list(column_channels(names, units, body, clock))
    facts = {"rows": str(len(body)), "delimiter": repr(delimiter), "header": "yes" if headed else "none"}
    facts |= {f"comment {i + 1}": text.strip() for i, text in enumerate(comments[:MOST_COMMENTS])}
    remarks = [*odd_rows(body, len(names)), *guesses(channels)]
    time = None if clock is None else channels[names.index(clock)]
    settings = settings_of(time, len(names), body, delimiter, headed, has_units)
    return Overview("csv", facts, channels, remarks, settings, open=left_open)


def is_units_row(cells: list[str]) -> bool:
    """Whether a row below the header holds units: no number, and a unit in most of its cells."""
    known = [
        bool(cell) and base_units(normalised(without_brackets(cell))) is not None and cell != "1" for cell in cells
    ]
    return not any(is_number_cell(cell.replace(",", ".")) for cell in cells) and sum(known) > len(cells) / 2


def check_numbers(path: Path, rows: Rows) -> None:
    """Refuse text that is no table: most of its rows hold no number."""
    numeric = sum(any(is_number_cell(cell.replace(",", ".")) for cell in cells) for _, cells in rows)
    if rows and numeric < LEAST_NUMBERS * len(rows):
        line, cells = next(row for row in rows if not any(is_number_cell(cell.replace(",", ".")) for cell in row[1]))
        raise InputError(
            f"{path}: no table of numbers: {len(rows) - numeric} of {len(rows)} rows hold none, such as line {line}, "
            f"'{' '.join(cells)[:40]}'; name a recording, or write a header and a row per sample"
        )


def settings_of(
    clock: RecordedChannel | None, width: int, rows: Rows, delimiter: str, headed: bool, has_units: bool
) -> dict[str, object]:
    """The fields of a source file that the file tells."""
    settings: dict[str, object] = {"clock": "master"}
    settings["delimiter"] = {sign: name for name, sign in DELIMITERS.items()}.get(delimiter, delimiter)
    settings |= {} if headed else {"header": "none"}
    settings |= {"units_row": True} if has_units else {}
    decimal_comma = delimiter != "," and any("," in cell for _, cells in rows[:SAMPLE] for cell in cells)
    settings |= {"decimal": ","} if decimal_comma else {}
    if rows and all(len(cells) == len(rows[0][1]) > width for _, cells in rows):
        settings["extra_cells"] = UNKNOWN
    if clock is None:
        settings["time"] = {"column": NAME_OF_TIME, "unit": UNKNOWN}
    else:
        settings["time"] = {"column": clock.address["column"], "unit": clock.unit or clock.likely_unit or UNKNOWN}
    return settings


def cells_of(rows: Rows, place: int) -> pl.Series:
    """The cells of a column; empty where a row is too short."""
    return pl.Series([cells[place] if place < len(cells) else "" for _, cells in rows], dtype=pl.String)


def numbers(cells: pl.Series) -> pl.Series:
    """Cells as numbers; null for any other text."""
    return cells.str.replace(",", ".", literal=True).cast(pl.Float64, strict=False)


def column_channels(names: list[str], units: list[str], rows: Rows, clock: str | None) -> Iterator[RecordedChannel]:
    """Every column with its range, and the words in it that are not numbers."""
    for place, title in enumerate(names):
        name, unit = name_and_unit(title)
        unit = unit or (without_brackets(units[place]) if place < len(units) else "")
        cells = cells_of(rows, place)
        values = numbers(cells)
        words = Counter(cells.filter(values.is_null()).to_list()).most_common(MOST_WORDS)
        known = values.drop_nulls().to_numpy()
        note = f"from {known.min():.6g} to {known.max():.6g}" if known.size else "no numbers"
        if title == clock:
            rate = rate_of(known)
            note = f"a clock, {rate:g} per unit" if rate else "a clock that stands still"
            note += f", {gaps_text(known)}" if gaps_text(known) else ""
        note += "".join(f", {count} x '{word}'" for word, count in words)
        address = {"column": lasting_name(name, names)}
        guess = "" if unit else likely_unit(name) or (unit_of_clock(known) if title == clock else "")
        yield RecordedChannel("column", address, unit, int(known.size), None, note, likely_unit=guess)


def guesses(channels: list[RecordedChannel]) -> Iterator[str]:
    """A remark on units that are guessed from names."""
    names = {channel.address["column"]: channel.likely_unit for channel in channels if channel.likely_unit}
    guessed = [f"{name} [{unit}]" for name, unit in names.items() if likely_unit(name)]
    if guessed:
        yield f"units guessed from the names, to be checked: {', '.join(guessed)}"


def odd_rows(rows: Rows, width: int) -> Iterator[str]:
    """Remarks on rows of another length than the header."""
    for length, count in Counter(len(cells) for _, cells in rows).items():
        if length != width:
            first = next(line for line, cells in rows if len(cells) == length)
            yield f"{count} rows have {length} cells under {width} names, the first in line {first}"
