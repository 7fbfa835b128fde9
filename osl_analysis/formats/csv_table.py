"""Tables of numbers in text files of any program: CSV, TSV, LabVIEW's LVM, printed columns.

By hand: `polars.read_csv` and `pandas.read_csv` find neither header nor units, decimal sign or
footer. Polars reads the lines between the first and the last ones where all are alike.
"""

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import polars as pl
from polars.exceptions import PolarsError

from osl_analysis.errors import InputError
from osl_analysis.formats import TEXT_PRIORITY
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
FIRST_TYPED = 1000  # lines by which columns of numbers are told from text
LAST_LINES = 60  # of a long text, among which its footer is
PADDING = ' \t\v\f"'  # of cells
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
        with suppress(InputError, PolarsError):  # the whole text then tells what is wrong
            ends = _table_of_lines(lines, layout, text.is_ended)
            has_dropped = layout.ragged == "dropped_variable" and ends.remarks
            table = None
            if not ends.skipped and not has_dropped:
                table = _with_rows_between(ends, between, count)
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


def _with_rows_between(ends: Table, text: bytes, count: int) -> Table | None:
    """Add the rows between the first and the last ones, as numbers where all columns are whole, or
    else as text; None if some have not a cell for each name, or are comments."""
    delimiter = ends.delimiter
    if delimiter == " ":
        text = re.sub(rb"(?m)^[ \t]+|[ \t]+$", b"", text)
        text = re.sub(rb"[ \t]+", b"\t", text)
        delimiter = "\t"
    read_csv = partial(
        pl.read_csv,
        text,
        has_header=False,
        separator=delimiter,
        quote_char='"' if b'"' in text else None,
        new_columns=ends.body.columns,
        decimal_comma=ends.decimal == ",",
    )
    outer = ends.body
    between = numbers = pl.DataFrame()
    if ends.decimal == "." or b"." not in text:  # else polars would take points for decimals, too
        with suppress(PolarsError):  # a cell is unlike the first ones of its column
            between = read_csv(infer_schema_length=FIRST_TYPED)
            numbers = between.select(pl.exclude(pl.String))
            points = pl.col(numbers.columns).str.replace(ends.decimal, ".", literal=True)
            outer = ends.body.with_columns(points).cast(between.schema)
    are_finite = all(column.is_finite().all(ignore_nulls=False) for column in numbers)
    if outer is ends.body or not are_finite:
        outer = ends.body
        between = read_csv(infer_schema=False)
    if pl.String in between.schema.values():
        # polars refuses a line with more cells than names, so that as many cells in all as names
        # times lines say that no line has fewer
        are_whole = text.count(delimiter.encode()) == count * (between.width - 1)
        if not are_whole or any(sign.encode() in text for sign in COMMENT_SIGNS):
            return None
        between = between.with_columns(pl.col(pl.String).fill_null("").str.strip_chars(PADDING))
    is_empty = pl.all_horizontal(pl.col(pl.String) == "").any()
    if len(between) != count or (outer is ends.body and between.select(is_empty).item()):
        return None
    above = int((ends.lines <= FIRST_LINES).sum())
    lines_between = FIRST_LINES + 1 + np.arange(count)
    return replace(
        ends,
        lines=np.concatenate([ends.lines[:above], lines_between, ends.lines[above:]]),
        body=pl.concat([outer[:above], between, outer[above:]], rechunk=True),
    )


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
