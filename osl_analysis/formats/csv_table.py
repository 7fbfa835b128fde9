"""CSV logs: text of any encoding, delimiter and decimal sign to a table of cells, and cells to numbers."""

import csv
import math
import re
from collections import Counter
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.errors import InputError, listing, nearest
from osl_analysis.formats.table import Ledger
from osl_analysis.trial import Array

DELIMITERS = {"tab": "\t", "space": " "}
CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1a]")  # bytes that no text has
UTF_16_MARKS = (b"\xff\xfe", b"\xfe\xff")
TextLines = list[tuple[int, str]]  # number in the file, counted from 1, and text
Rows = list[tuple[int, list[str]]]


def read_lines(path: Path) -> TextLines:
    """The lines of a file without blank ones; refused where zero bytes show that it is not text."""
    text = decoded_text(path.read_bytes())
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise InputError(
            f"line {line} holds zero bytes, as a loss of power leaves them; delete the file from there on, or "
            "name a text file"
        )
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    return [(number, line) for number, line in enumerate(lines, start=1) if line and not line.isspace()]


def decoded_text(data: bytes) -> str:
    """Text in UTF-8, UTF-16 with its mark, or else Windows' western code page."""
    if data[:2] in UTF_16_MARKS:
        return data.decode("utf-16", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def is_text(begin: bytes) -> bool:
    """Whether a file that begins with these bytes is text, by its first line: a loss of power leaves zeros behind."""
    return begin[:2] in UTF_16_MARKS or CONTROL.search(begin.partition(b"\n")[0]) is None


def delimiter_of(lines: TextLines, given: str) -> str:
    """The delimiter that is given, or for `auto` the first of tab, `;`, `|`, `,` and blank that every line has."""
    if given != "auto":
        return DELIMITERS.get(given, given)
    sample = [text for _, text in lines if text.strip()][:50]
    everywhere = [sign for sign in "\t;|" if sample and all(sign in text for text in sample)]
    # the comma may be the decimal sign, the blank may stand in names: it is taken where no line has a comma
    spaced = sample and not any("," in text for text in sample) and all(" " in text.strip() for text in sample)
    return everywhere[0] if everywhere else " " if spaced else ","


def split_rows(lines: TextLines, delimiter: str) -> Rows:
    """Cells of every line, stripped, without lines of empty cells; refused where a quote is not closed on its line."""
    reader = csv.reader((text for _, text in lines), delimiter=delimiter, skipinitialspace=True)
    rows: Rows = []
    try:
        for (line, _), cells in zip(lines, reader, strict=False):  # a quote that is not closed takes in several lines
            if lines[reader.line_num - 1][0] != line:
                raise InputError(f"line {line}: a quote is not closed; remove it")
            stripped = [cell.strip() for cell in cells]
            if any(stripped):
                rows.append((line, stripped))
    except csv.Error as error:
        raise InputError(f"line {lines[reader.line_num - 1][0]}: {error}; repair it") from error
    return rows


def name_and_unit(title: str) -> tuple[str, str]:
    """`torque [Nm]` or `torque (Nm)` as name and unit; the unit is empty where the title has none."""
    match = re.fullmatch(r"(.*\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))", title, re.DOTALL)
    return (match[1], match[2] or match[3] or "") if match else (title, "")


def without_brackets(unit: str) -> str:
    """A unit below a header without the brackets around it: `[deg]` and `(deg)` are `deg`."""
    return unit[1:-1].strip() if unit[:1] + unit[-1:] in ("[]", "()") else unit


@dataclass
class UnreadableCellError(Exception):
    """A cell that is not a number."""

    place: int  # in the column


def cell_numbers(cells: Sequence[str | None] | pl.Series, missing: Collection[str], decimal: str) -> Array:
    """Values (n,): NaN where a cell is None or one of the words in `missing`. Raises UnreadableCellError."""
    text = pl.Series(cells, dtype=pl.String)
    absent = (text.is_null() | text.is_in(list(missing))).to_numpy()
    plain = text
    if decimal == ",":  # a full stop then separates thousands, or the decimal sign is stated wrongly: no number
        plain = text.str.replace(".", "?", literal=True).str.replace(",", ".", literal=True)
    values = plain.cast(pl.Float64, strict=False).to_numpy().copy()
    values[absent] = np.nan
    for place in np.flatnonzero(~np.isfinite(values) & ~absent).tolist():  # such as `+1.5`, which polars does not read
        if not is_number_cell(str(plain[place])):
            raise UnreadableCellError(place)
        values[place] = float(plain[place])
    return values


def is_number_cell(cell: str) -> bool:
    is_number = re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?", cell, re.ASCII)
    return is_number is not None and math.isfinite(float(cell))


@dataclass(frozen=True)
class CsvLayout:
    """How a logger writes its table: fields of the source file of a log in CSV, which tells their meaning."""

    delimiter: str = "auto"
    comment: str = "#"
    header: Literal["row", "comment", "none"] = "row"
    units_row: bool = False
    missing: tuple[str, ...] = ("", "nan", "NaN")
    most_missing: float = 0.01
    ragged: Literal["refuse", "skip", "dropped_variable"] = "refuse"


@dataclass(frozen=True)
class CsvTable:
    """The rows of a log in CSV, as text."""

    names: list[str]  # names of the columns, as in the header
    units: list[str]  # of the columns, from a row of units or from brackets behind the name; empty where there is none
    lines: NDArray[np.int64]  # number of each row's line in the file, (rows,)
    body: pl.DataFrame  # the cells as text, a column each; null in rows in which the logger omitted the column
    comments: list[str]  # the comment lines without their sign
    damage: Ledger  # what was repaired or left out
    delimiter: str


def place_of(name: str, names: Sequence[str]) -> int:
    """Place of a column by its name, with or without its unit, by a pattern with `*`, or by its number from 1."""
    places, where = places_of(name, names), f"column '{name[:80]}'"
    if len(places) > 1:
        which = listing([f"{place + 1} ('{names[place]}')" for place in places])
        advice = "write a pattern or a name that only one has, or its number"
        raise InputError(f"{where} occurs {len(places)} times, as columns {which}; {advice}")
    if not places:
        advice = nearest(name, names) or "; correct the name in the source file"
        advice = advice if len(names) > 1 else "; state `delimiter` if these are several columns"
        raise InputError(f"{where} is missing; the file has {listing(names)}{advice}")
    return places[0]


def places_of(name: str, names: Sequence[str]) -> list[int]:
    """Places of the columns that a name, a pattern with `*` for any text, or a number from 1 means."""
    plain = [name_and_unit(title)[0] for title in names]
    for titles in (names, plain):
        if name in titles:
            return [i for i, title in enumerate(titles) if title == name]
    if "*" in name:
        pattern = re.compile(re.escape(name).replace(r"\*", ".*"), re.DOTALL)
        return [i for i in range(len(names)) if pattern.fullmatch(names[i]) or pattern.fullmatch(plain[i])]
    number_given = re.fullmatch(r"[1-9]\d{0,4}", name, re.ASCII) and int(name) <= len(names)
    return [int(name) - 1] if number_given else []


def is_clock(title: str) -> bool:
    """Whether a column is called like a clock: `time`, `t_s`, `loop_time [ms]`."""
    name = name_and_unit(title)[0].strip()
    words = "time|t|timestamp|stamp|(state|loop|pi|sys|ros|elapsed)_time|elapsed|clock|seconds|time_since_start"
    return re.fullmatch(f"({words})(_(s|sec|ms|us|ns))?", name, re.IGNORECASE) is not None


def read_csv_table(path: Path, layout: CsvLayout) -> CsvTable:
    """The rows of a log in CSV; InputError if it has no header, or rows that the layout does not allow."""
    lines, ends = read_lines(path), ends_whole(path)
    below = [text for _, text in lines[200:] if ends]
    # lines that are all alike below the first ones are split by polars, in an eighth of the time and of the memory
    with suppress(InputError):  # the whole file tells what is wrong
        table = table_of(lines[:200] if below else [], layout)
        sign, between = table.delimiter, len(table.names) - 1
        odd = ['"', *[layout.comment] * bool(layout.comment)]
        alike = (text.count(sign) == between < len(text) and not any(one in text for one in odd) for text in below)
        if not table.damage.remarks and sign != " " and all(alike):
            body = "\n".join(below).encode()
            rest = pl.read_csv(body, has_header=False, separator=sign, quote_char=None, infer_schema=False)
            rest = rest.with_columns(pl.all().fill_null("").str.strip_chars())
            rest.columns = table.body.columns
            if not rest.select(pl.all_horizontal(pl.all() == "").any()).item():
                numbered = np.concatenate([table.lines, [line for line, _ in lines[200:]]])
                return replace(table, lines=numbered, body=pl.concat([table.body, rest]))
    return table_of(lines, layout, ends)


def ends_whole(path: Path) -> bool:
    """Whether the last line of a text has its break."""
    with path.open("rb") as file:
        file.seek(-min(64, path.stat().st_size), 2)
        return file.read().rstrip(b" \t\0")[-1:] in (b"\n", b"\r")  # also in UTF-16


def is_last_whole(cells: Sequence[str]) -> bool:
    """Whether the last cell of a column at the end of a file, without a line break, was not cut within its number: it
    has as many decimals as all others. Nothing tells of whole numbers."""
    decimals = {len(re.split("[.,]", cell, maxsplit=1)[-1]) * bool(re.search("[.,]", cell)) for cell in cells}
    return len(cells) > 1 and len(decimals) == 1 and 0 not in decimals


def table_of(lines: TextLines, layout: CsvLayout, ends: bool = True) -> CsvTable:
    # programs of Xsens begin the lines above their table with two slashes
    sign = "//" if layout.comment == "#" and lines and lines[0][1].startswith("//") else layout.comment
    comments, content = TextLines(), TextLines()
    for line, text in lines:
        if sign and text.lstrip().startswith(sign):
            comments.append((line, text.strip()[len(sign) :].strip()))
        else:
            content.append((line, text))
    delimiter = delimiter_of(content, layout.delimiter)
    rows = split_rows(content, delimiter)
    said, damage = [text for _, text in comments], Ledger()
    if layout.header != "comment" and not rows:
        raise InputError("holds no rows; record it again, or exclude the trial")
    if layout.header == "comment":
        named = split_rows(comments[-1:], delimiter)
        if not named:
            raise InputError(f"no line begins with '{sign}'; write `header: row` or `header: none`")
        names = named[0][1]
    elif layout.header == "none":
        names = [str(i + 1) for i in range(len(rows[0][1]))]
    else:
        (line, first), *rows = rows
        if all(is_number_cell(cell.replace(",", ".")) for cell in first if cell):
            raise InputError(
                f"line {line} holds numbers, not the columns' names; write `header: none` and the columns' numbers"
            )
        names = unpadded(first, 0)
        check_header_place((line, first), rows)
    units = [name_and_unit(name)[1] for name in names]
    rows = [(line, unpadded(cells, len(names))) for line, cells in rows]
    lengths = {len(cells) for _, cells in rows}
    if len(lengths) == 1 and (extra := lengths.pop() - len(names)) > 0:
        line, cells = rows[0]
        raise InputError(
            f"every row has {extra} more cells than the header has names: line {line} begins with '{cells[0][:40]}' "
            f"and ends with '{cells[-1][:40]}'; write a name for each, and the same sign between names as between cells"
        )
    if layout.units_row and rows:
        units, rows = ([*map(without_brackets, rows[0][1]), *units[len(rows[0][1]) :]], rows[1:])
    if not rows:
        raise InputError("no rows of data; record it again, or exclude the trial")
    cut = len(rows) > 1 and len(rows[-1][1]) < min(len(names), len(rows[-2][1]))  # as by an interrupted recorder
    if cut:
        damage.miss_end(f"the last line, {rows[-1][0]}, is cut off and was skipped")
        rows = rows[:-1]
    elif len(rows) > 1 and not ends and not is_last_whole([cells[-1] for _, cells in rows]):
        damage.remarks.append(
            f"the last line, {rows[-1][0]}, has no line break, may be cut in a number and was skipped"
        )
        damage.uncounted, rows = True, rows[:-1]
    fitting, repairs = fitting_rows(rows, len(names), layout)
    if skipped := len(rows) - len(fitting):
        damage.lose(repairs.pop(), 0, Counter({0: skipped}), 0)
    damage.remarks += repairs
    if not fitting:
        raise InputError(f"none of its rows fits the header's {len(names)} names; state `delimiter` or `header`")
    body = [pl.Series(str(k), [row[k] for _, row in fitting], dtype=pl.String) for k in range(len(names))]
    numbered = np.array([line for line, _ in fitting])
    return CsvTable(names, units, numbered, pl.DataFrame(body), said, damage, delimiter)


def check_header_place(header: tuple[int, list[str]], rows: Rows) -> None:
    """Refuse a table below other text: most rows have more cells than the first, and the first of them no number."""
    names = unpadded(header[1], 0)
    (width, count), *_ = Counter(len(cells) for _, cells in rows).most_common(1) or [(0, 0)]
    if count <= len(rows) / 2 or width <= len(names) or width < 2:
        return
    line, cells = next((line, cells) for line, cells in rows if len(cells) == width)
    far = rows[0][0] != line or width > len(names) + 1  # else maybe units below a header that lacks a name
    if far and not any(is_number_cell(cell.replace(",", ".")) for cell in cells):
        raise InputError(
            f"line {header[0]} has {len(names)} cells and most rows have {width}: the names of the columns "
            f"seem to stand in line {line}; delete the lines above it, or begin each with `#`"
        )


def share_above(count: int, total: int) -> float:
    """A share of three decimals that is at least count / total, for the user to write."""
    return math.ceil(1000 * count / total) / 1000


def unpadded(cells: list[str], width: int) -> list[str]:
    """Cells without the empty ones beyond `width`, with which some writers pad lines."""
    last = max((place for place, cell in enumerate(cells, start=1) if cell), default=0)
    return cells[: max(last, width)]


def fitting_rows(rows: Rows, width: int, layout: CsvLayout) -> tuple[list[tuple[int, list[str | None]]], list[str]]:
    """The rows that fit, with None for omitted columns, and what was repaired."""
    if layout.ragged == "dropped_variable":
        return dropped_variables(rows, width, layout.missing)
    odd = [(line, len(cells)) for line, cells in rows if len(cells) != width]
    if odd and (layout.ragged == "refuse" or len(odd) > layout.most_missing * len(rows)):
        share = share_above(len(odd), len(rows))
        more = f" and `most_missing: {share:g}`" if share > layout.most_missing else ""
        raise InputError(
            f"line {odd[0][0]} has {odd[0][1]} cells under {width} names, and {len(odd)} of {len(rows)} rows "
            f"do not fit; repair these lines, or write `ragged: skip`{more} in the source file to leave them out"
        )
    note = f"{len(odd)} of {len(rows)} rows do not fit the header and were skipped"
    return [(line, list(cells)) for line, cells in rows if len(cells) == width], [note] * bool(odd)


def dropped_variables(
    rows: Rows, width: int, missing: Collection[str]
) -> tuple[list[tuple[int, list[str | None]]], list[str]]:
    """The rows of a logger that omits failed variables, with None from there on: those missing in the row before. The
    logger of `opensourceleg` writes the header with the first thousand rows: variables that failed before have no name
    there, and their cells, those missing in the last row that has them, are left out."""
    notes, columns, filled = list[str](), list(range(width)), list[tuple[int, list[str | None]]]()
    first = next((place for place, (_, cells) in enumerate(rows) if len(cells) == width), 0)
    lengths = {len(cells) for _, cells in rows[:first]}
    unnamed = [place for place, cell in enumerate(rows[first - 1][1]) if cell in missing] if first else []
    if unnamed and lengths == {width + len(unnamed)}:
        named = [(n, [cell for k, cell in enumerate(cells) if k not in unnamed]) for n, cells in rows[:first]]
        which = ", ".join(str(place + 1) for place in unnamed)
        notes.append(f"up to line {rows[first - 1][0]}, cells {which} of every row have no name and were left out")
        rows = [*named, *rows[first:]]
    for place, (line, cells) in enumerate(rows):
        if len(cells) != len(columns):
            before = rows[place - 1][1] if place else []
            failed = [column for column, cell in zip(columns, before, strict=False) if cell in missing]
            if len(cells) > len(columns) or len(columns) - len(cells) != len(failed):
                raise InputError(
                    f"line {line} has {len(cells)} cells where {len(columns)} were, and {len(failed)} were "
                    "missing in the line before: it is unknown which column was omitted; cut the file off there"
                )
            columns = [column for column in columns if column not in failed]
            which = ", ".join(str(column + 1) for column in failed)
            notes.append(f"from line {line} on, columns {which} are missing")
        by_column: dict[int, str] = dict(zip(columns, cells, strict=True))
        filled.append((line, [by_column.get(column) for column in range(width)]))
    return filled, notes
