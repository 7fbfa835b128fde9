"""Tables of numbers in text files of any program: CSV, TSV, LabVIEW's LVM, printed columns.

By hand: `polars.read_csv` and `pandas.read_csv` find neither header nor units, decimal sign or
footer. Polars reads the lines between the first and the last ones where all are alike.
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
from osl_analysis.formats._cells import are_times, cell_values, is_number_cell
from osl_analysis.formats._table import (
    COMMENT_SIGNS,
    LISTING,
    SheetSource,
    Table,
    recording_of_table,
    table_of_rows,
)
from osl_analysis.formats._text import (
    Line,
    Text,
    delimiter_of,
    is_text,
    numbered,
    read_text,
    split_rows,
)
from osl_analysis.recording import Format, Recording

FIRST_LINES = 300  # of a long text, from which its header is found
LAST_LINES = 60  # of a long text, among which its footer is
LABVIEW = b"LabVIEW Measurement"
END_OF_HEADER = b"***End_of_Header***"


def table_of_text(text: Text, layout: SheetSource) -> Table:
    """Find the table in a text."""
    *first, rest = text.data.split(b"\n", FIRST_LINES)
    between, *last = rest.rsplit(b"\n", LAST_LINES)
    count = between.count(b"\n") + 1
    if len(first) == FIRST_LINES and count > FIRST_LINES:
        lines = numbered(b"\n".join(first))
        lines += numbered(b"\n".join(last), FIRST_LINES + count + 1)
        with suppress(InputError):  # reading the whole text then says what is wrong
            ends = _table_of_lines(lines, layout, text.is_ended)
            table = _with_rows_between(ends, between, count, layout)
            if table is not None:
                return table
    return _table_of_lines(numbered(text.data), layout, text.is_ended)


def _table_of_lines(lines: Sequence[Line], layout: SheetSource, is_ended: bool) -> Table:
    comments: list[Line] = []
    content: list[Line] = []
    for line in lines:
        is_comment = line.text.lstrip().startswith(COMMENT_SIGNS)
        (comments if is_comment else content).append(line)
    delimiter = delimiter_of(content)
    rows = split_rows(content, delimiter)
    return table_of_rows(rows, comments, layout, delimiter, is_ended)


def _with_rows_between(ends: Table, text: bytes, lines: int, layout: SheetSource) -> Table | None:
    """Add the rows between the first and the last ones, if all have a cell for each name: as
    numbers where all cells of a column are plain numbers, or else as text; None if they differ."""
    delimiter = ends.delimiter
    if delimiter == " ":
        text = re.sub(rb"(?m)^[ \t]+|[ \t]+$", b"", text)
        text = re.sub(rb"[ \t]+", b"\t", text)
        delimiter = "\t"
    tries: list[tuple[pl.DataFrame, list[str]]] = [(ends.body, [])]
    # polars would take a point for a decimal sign, too, and a word that is a number for missing
    has_points = ends.decimal == "," and b"." in text
    if not has_points and not any(map(is_number_cell, layout.missing)):
        numbers = _as_numbers(ends, layout)  # without words it is faster
        tries = [(numbers, []), (numbers, [*layout.missing]), *tries]
    for outer, words in tries:
        try:
            between = pl.read_csv(
                text,
                has_header=False,
                separator=delimiter,
                quote_char='"' if b'"' in text else None,
                schema=outer.schema,
                null_values=words,
                decimal_comma=ends.decimal == ",",
            )
        except pl.exceptions.PolarsError:
            continue
        if len(between) == lines and _are_read(between, layout):
            break
    else:
        return None
    if pl.String in between.schema.values() or any(column.has_nulls() for column in between):
        # polars refuses a line with more cells than the first one, so that as many cells in all as
        # names times lines say that no line has fewer
        are_whole = text.count(delimiter.encode()) == lines * (between.width - 1)
        if not are_whole or any(sign.encode() in text for sign in COMMENT_SIGNS):
            return None
    between = between.with_columns(pl.col(pl.String).fill_null("").str.strip_chars(' \t\v\f"'))
    is_empty = pl.all_horizontal(pl.exclude(pl.String).is_null(), pl.col(pl.String) == "")
    has_dropped = layout.ragged == "dropped_variable" and ends.remarks
    if ends.skipped or has_dropped or between.select(is_empty.any()).item():
        return None
    above = int((ends.lines <= FIRST_LINES).sum())
    lines_between = FIRST_LINES + 1 + np.arange(lines)
    return replace(
        ends,
        lines=np.concatenate([ends.lines[:above], lines_between, ends.lines[above:]]),
        body=pl.concat([outer[:above], between, outer[above:]], rechunk=True),
    )


def _as_numbers(ends: Table, layout: SheetSource) -> pl.DataFrame:
    """The first and last rows, with columns of numbers where all of their cells are numbers."""
    columns: list[pl.Series] = []
    for cells in ends.body:
        values, unread = cell_values(cells, layout.missing, ends.decimal)
        is_text = values.dtype == bool or unread.size or are_times(cells)
        columns.append(cells if is_text else pl.Series(cells.name, values))
    return pl.DataFrame(columns)


def _are_read(between: pl.DataFrame, layout: SheetSource) -> bool:
    """Tell whether all numbers are finite, and none lacks but where an empty cell may."""
    for column in between.select(pl.exclude(pl.String)):
        if not column.is_finite().all() or (column.has_nulls() and "" not in layout.missing):
            return False
    return True


def read(path: Path, source: SheetSource | None) -> Recording:
    """Read a table of text."""
    text = read_text(path)
    if text.data.startswith(LABVIEW):
        segments = text.data.count(END_OF_HEADER) - 1  # the file itself has a header, too
        if segments > 1:
            raise InputError(
                f"LabVIEW wrote a header for each of its {segments} segments; choose `Segment"
                " Headers: One header only` in Write To Measurement File, or delete the headers but"
                " the first"
            )
    layout = source or LISTING
    table = table_of_text(text, layout)
    return recording_of_table("csv", table, layout, facts={"rows": str(len(table.lines))})


FORMAT = Format(
    name="csv",
    suffixes=(".csv", ".tsv", ".txt", ".dat", ".lvm", ".asc"),
    begins=is_text,
    source=SheetSource,
    read=read,
    priority=TEXT_PRIORITY,
)
