"""Tables of numbers in text files of any program: CSV, TSV, LabVIEW's LVM, printed columns.

By hand: `polars.read_csv` and `pandas.read_csv` find neither header nor units, decimal sign or
footer. Polars reads the lines where all are alike, which takes an eighth of the time; where all of
their cells are plain numbers, without a text of each cell.
"""

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.formats import TEXT_PRIORITY
from osl_analysis.formats._cells import WHOLE, is_number_cell
from osl_analysis.formats._table import (
    Layout,
    SheetSource,
    Table,
    layout_of,
    recording_of_table,
    table_of_rows,
)
from osl_analysis.formats._text import (
    Decimal,
    Delimiter,
    Line,
    delimiter_of,
    is_text,
    numbered,
    read_text,
    split_rows,
)
from osl_analysis.recording import Format, Recording

FIRST_LINES = 300  # of a long text, from which its header is found
LAST_LINES = 60  # of a long text, among which its footer is
MOST_LISTED = 200_000  # rows of a long text that are read to list what it holds
LABVIEW = b"LabVIEW Measurement"
IN_NUMBERS = set("+-.0123456789eE")  # signs of a plain number
BLANKS = (b" ", b"\t", b"\v", b"\f")  # of ASCII
END_OF_HEADER = b"***End_of_Header***"


class CsvSource(SheetSource):
    """The source file of a table of text."""

    OF = " of format csv"
    delimiter: Delimiter = "auto"
    """Sign between cells; `auto` takes that of tab, `;`, `|`, `,` and blank by which most cells are
    numbers."""
    # Decimal sign; `auto` takes the one that the numbers have.
    decimal: Decimal = "auto"


def table_of_text(
    data: bytes, is_ended: bool, layout: Layout, most_rows: int | None = None
) -> Table:
    """Find the table in a text; in a long one about the first `most_rows` of it."""
    count = data.count(b"\n")
    if count < 2 * (FIRST_LINES + LAST_LINES):
        return _table_of_lines(numbered(data), layout, is_ended)
    with suppress(InputError):  # reading the whole text then says what is wrong
        table = _table_of_alike_lines(data, count, is_ended, layout, most_rows)
        if table is not None:
            return table
    return _table_of_lines(numbered(data), layout, is_ended)


def _table_of_lines(lines: Sequence[Line], layout: Layout, is_ended: bool) -> Table:
    comments: list[Line] = []
    content: list[Line] = []
    for line in lines:
        text = line.text.strip()
        if not text.startswith(layout.comment_signs):
            content.append(line)
            continue
        sign = next(sign for sign in layout.comment_signs if text.startswith(sign))
        comments.append(Line(line.number, text[len(sign) :].strip()))
    if content:
        of_excel = re.fullmatch(r"sep=(.)", content[0].text.strip())  # as Excel reads it
        if of_excel:
            content = content[1:]
            if layout.delimiter == "auto":
                layout = replace(layout, delimiter=of_excel[1])
    delimiter = delimiter_of(content, layout.delimiter)
    rows = split_rows(content, delimiter)
    return table_of_rows(rows, comments, layout, delimiter, is_ended)


def _table_of_alike_lines(
    data: bytes, count: int, is_ended: bool, layout: Layout, most_rows: int | None
) -> Table | None:
    """Find the table in a text of `count` line breaks by the first and last lines, and read those
    between, at most about `most_rows`, at one go; None if one of these differs."""
    begin_of_between = 0
    for _ in range(FIRST_LINES):
        begin_of_between = data.index(b"\n", begin_of_between) + 1

    break_before_end = len(data)
    for _ in range(LAST_LINES):
        break_before_end = data.rindex(b"\n", 0, break_before_end)
    begin_of_end = break_before_end + 1
    lines_before_end = count - LAST_LINES + 1  # as many as breaks, since each of them has its own

    end_of_between = begin_of_end
    lines_between = lines_before_end - FIRST_LINES
    if most_rows is not None and count > most_rows:
        share_of_bytes = most_rows * (begin_of_end - begin_of_between) // count
        last_break = data.rfind(b"\n", begin_of_between, begin_of_between + share_of_bytes)
        end_of_between = last_break + 1
        lines_between = data.count(b"\n", begin_of_between, end_of_between)

    last_lines = numbered(data[begin_of_end:], lines_before_end + 1)
    lines = [*numbered(data[:begin_of_between]), *last_lines]
    table = _table_of_lines(lines, layout, is_ended)
    if table.skipped:
        return None
    numbers = _rows_of_numbers(data, lines_between, table, layout)
    if numbers is not None:
        outer, middle = numbers
    else:
        outer = table.body
        alike = _alike_rows(data[begin_of_between:end_of_between], table, layout)
        if alike is None:
            return None
        middle = alike
    above = int((table.lines <= FIRST_LINES).sum())
    between = FIRST_LINES + 1 + np.arange(len(middle))
    return replace(
        table,
        lines=np.concatenate([table.lines[:above], between, table.lines[above:]]),
        body=pl.concat([outer[:above], middle, outer[above:]], rechunk=True),
    )


def _rows_of_numbers(
    data: bytes, rows: int, table: Table, layout: Layout
) -> tuple[pl.DataFrame, pl.DataFrame] | None:
    """Read the first and last rows, which are the table's, and those between as numbers; None if a
    cell is no plain number.

    Polars refuses words, quotes, blanks behind a number and lines with more cells; a line with
    fewer, or of none, lacks a number.
    """
    is_comment_number = any(set(sign) <= IN_NUMBERS for sign in layout.comment_signs)
    is_missing_number = any(map(is_number_cell, layout.missing))
    if is_comment_number or is_missing_number or table.decimal != ".":
        return None
    kinds = pl.Schema()
    for name, cells in table.body.to_dict().items():  # floats would round nanoseconds since 1970
        kinds[name] = pl.Int64() if cells.str.contains(WHOLE).all() else pl.Float64()
    outer = table.body.cast(kinds, strict=False)
    if not _are_finite(outer):
        return None
    try:
        middle = pl.read_csv(
            data,
            has_header=False,
            separator=table.delimiter,
            quote_char=None,
            schema=kinds,
            skip_lines=FIRST_LINES,
            n_rows=rows,
        )
    except pl.exceptions.PolarsError:
        return None
    return (outer, middle) if len(middle) == rows and _are_finite(middle) else None


def _are_finite(numbers: pl.DataFrame) -> bool:
    """Tell whether no number lacks, or is infinite."""
    return not any(
        column.has_nulls() or not column.is_finite().all() for column in numbers.iter_columns()
    )


def _alike_rows(text: bytes, table: Table, layout: Layout) -> pl.DataFrame | None:
    """The cells of lines that all have a cell for each name; None if a line differs."""
    has_comments = any(sign.encode() in text for sign in layout.comment_signs)
    if has_comments or b'"' in text:
        return None
    delimiter = table.delimiter
    if delimiter == " ":
        text = re.sub(rb"(?m)^[ \t]+|[ \t]+$", b"", text)
        text = re.sub(rb"[ \t]+", b"\t", text)
        delimiter = "\t"
    # polars refuses a line with more cells than the first one, so that as many cells in all as
    # names times lines say that no line has fewer
    lines = text.count(b"\n")
    if text.count(delimiter.encode()) != lines * (len(table.names) - 1):
        return None
    try:
        rows = pl.read_csv(
            text, has_header=False, separator=delimiter, quote_char=None, infer_schema=False
        )
    except pl.exceptions.PolarsError:
        return None
    if rows.shape != (lines, len(table.names)):
        return None
    rows = rows.fill_null("")
    blanks = (sign for sign in BLANKS if sign != delimiter.encode())
    if not text.isascii() or any(sign in text for sign in blanks):
        rows = rows.with_columns(pl.all().str.strip_chars())
    rows.columns = table.body.columns
    has_empty_rows = rows.select(pl.all_horizontal(pl.all() == "").any()).item()
    return None if has_empty_rows else rows


def read(path: Path, source: CsvSource | None) -> Recording:
    """Read a table of text; without a source file about the first 200,000 rows of a long one."""
    layout = layout_of(source)
    text = read_text(path)
    segments = text.data.count(END_OF_HEADER) - 1  # the file itself has a header, too
    if text.data.startswith(LABVIEW) and segments > 1:
        raise InputError(
            f"LabVIEW wrote a header for each of its {segments} segments; choose `Segment Headers:"
            " One header only` in Write To Measurement File, or delete the headers but the first"
        )
    most_rows = MOST_LISTED if source is None else None
    table = table_of_text(text.data, text.is_ended, layout, most_rows)
    is_partial = most_rows is not None and len(table.lines) >= most_rows
    facts = {"rows": f"{len(table.lines)}, of more" if is_partial else str(len(table.lines))}
    return recording_of_table("csv", table, layout, facts=facts)


FORMAT = Format(
    name="csv",
    suffixes=(".csv", ".tsv", ".txt", ".dat", ".lvm", ".asc"),
    begins=is_text,
    source=CsvSource,
    read=read,
    priority=TEXT_PRIORITY,
)
