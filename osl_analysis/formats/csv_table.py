# SPDX-License-Identifier: Apache-2.0
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
from polars import selectors
from polars.exceptions import PolarsError

from osl_analysis.base.errors import InputError
from osl_analysis.base.recording import Format, Recording
from osl_analysis.formats.cell_forms import without_arrows
from osl_analysis.formats.cell_table import (
    COMMENT_SIGNS,
    LISTING,
    SheetSource,
    Table,
    recording_of_table,
    table_of_rows,
)
from osl_analysis.formats.text_cells import (
    FIRST_LINES,
    LAST_LINES,
    WHOLE,
    Line,
    Text,
    delimiter_of,
    is_text,
    numbered,
    read_text,
    split_rows,
)

CELL_PADDING = ' \t\v\f"'  # of cells


def table_of_text(text: Text, layout: SheetSource) -> Table:
    """Find the table in a text: in a long one by its first and last lines."""
    data = without_arrows(text.data)
    first = re.match(rb"(?:.*\n){%d}" % FIRST_LINES, data)
    above = len(data)  # up to where the last lines begin
    for _ in range(LAST_LINES):
        above = max(data.rfind(b"\n", 0, above), 0)
    if first and first.end() < above:
        between = data[first.end() : above]
        count = between.count(b"\n") + 1
        end = numbered(data[above + 1 :], FIRST_LINES + count + 1)
        with suppress(InputError, PolarsError):  # the whole text then tells what is wrong
            ends = _table_of_lines(numbered(first[0]) + end, layout, text.is_ended)
            if not ends.skipped and not ends.has_forms:
                return _with_rows_between(ends, between, count)
    return _table_of_lines(numbered(data), layout, text.is_ended)


def _table_of_lines(lines: Sequence[Line], layout: SheetSource, is_ended: bool) -> Table:
    comments: list[Line] = []
    content: list[Line] = []
    for line in lines:
        is_comment = line.text.lstrip().startswith(COMMENT_SIGNS)
        (comments if is_comment else content).append(line)
    delimiter = delimiter_of(content)
    rows = split_rows(content, delimiter)
    return table_of_rows(rows, comments, layout, delimiter, is_ended)


def _with_rows_between(ends: Table, text: bytes, count: int) -> Table:
    """Add the lines between the first and the last ones. Columns are read as numbers where all
    cells of them are, else as text.

    Raises
    ------
    InputError, PolarsError
        One is a comment or blank, or has not a cell for each name.
    """
    delimiter = ends.delimiter
    if ends.header and delimiter.join(ends.header).encode() + b"\n" in text:
        raise InputError("the header stands again")
    if delimiter == " ":
        text = re.sub(rb"(?m)^[ \t]+|[ \t]+$", b"", text)
        text = re.sub(rb"[ \t]+", b"\t", text)
        delimiter = "\t"
    read_csv = partial(pl.read_csv, text, has_header=False, separator=delimiter, quote_char=None)
    kinds = {cells.name: _kind_of(cells, ends.decimal) for cells in ends.body}
    between = read_csv(schema=kinds, ignore_errors=True)
    are_numbers = selectors.numeric().is_finite().all(ignore_nulls=False)
    if not all(between.select(are_numbers).row(0)):
        between = read_csv(schema=ends.body.schema)
    if pl.String in between.dtypes:
        between = between.with_columns(
            pl.col(pl.String).fill_null("").str.strip_chars(CELL_PADDING)
        )
        # polars refuses a line with more cells than names, so that as many cells in all as names
        # times lines say that no line has fewer
        are_whole = text.count(delimiter.encode()) == count * (between.width - 1)
        has_comment = any(sign.encode() in text for sign in COMMENT_SIGNS)
        is_blank = pl.all_horizontal(pl.col(pl.String) == "").any()
        has_blank = {*between.dtypes} == {pl.String} and between.select(is_blank).item()
        if not are_whole or has_comment or has_blank:
            raise InputError("lines are not alike")
    above = int((ends.lines <= FIRST_LINES).sum())
    lines = np.arange(FIRST_LINES + 1, FIRST_LINES + 1 + count)
    outer = ends.body.cast(between.schema)
    return replace(
        ends,
        lines=np.concatenate([ends.lines[:above], lines, ends.lines[above:]]),
        body=pl.concat([outer[:above], between, outer[above:]]),
    )


def _kind_of(cells: pl.Series, decimal: str) -> type[pl.DataType]:
    """The type of a column of text: floats would round nanoseconds since 1970."""
    numbers = cells.cast(pl.Float64, strict=False)
    if decimal == "," or not numbers.is_finite().all(ignore_nulls=False):
        return pl.String
    return pl.Int64 if cells.str.contains(WHOLE).all() else pl.Float64


def read(path: Path, source: SheetSource | None) -> Recording:
    """Read a table of text."""
    text = read_text(path)
    layout = source or LISTING
    table = table_of_text(text, layout)
    return recording_of_table(
        "csv", table, layout, facts={"rows": len(table.lines), "delimiter": table.delimiter}
    )


FORMAT = Format(
    name="csv",
    suffixes=(".csv", ".tsv", ".txt", ".dat", ".lvm", ".asc"),
    begins=is_text,
    source=SheetSource,
    read=read,
    is_any_text=True,
)
