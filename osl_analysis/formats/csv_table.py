# SPDX-License-Identifier: Apache-2.0
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
from polars.exceptions import PolarsError

from osl_analysis.errors import InputError
from osl_analysis.formats._table import (
    COMMENT_SIGNS,
    LISTING,
    SheetSource,
    Table,
    recording_of_table,
    table_of_rows,
)
from osl_analysis.formats._text import (
    FIRST_LINES,
    LAST_LINES,
    Line,
    Text,
    delimiter_of,
    is_text,
    numbered,
    read_text,
    split_rows,
)
from osl_analysis.recording import Format, Recording

LAST_BYTES = 1_000_000  # in which the last lines are
PADDING = ' \t\v\f"'  # of cells
LABVIEW = b"LabVIEW Measurement"
END_OF_HEADER = b"***End_of_Header***"


def table_of_text(text: Text, layout: SheetSource) -> Table:
    """Find the table in a text: in a long one by its first and last lines."""
    data = text.data
    first = re.match(rb"(?:.*\n){%d}" % FIRST_LINES, data)
    _, *last = data[-LAST_BYTES:].rsplit(b"\n", LAST_LINES)
    if first and last:
        end = b"\n".join(last)
        between = data[first.end() : len(data) - len(end) - 1]
        count = between.count(b"\n") + 1
        if count > FIRST_LINES:
            lines = numbered(first[0]) + numbered(end, FIRST_LINES + count + 1)
            with suppress(InputError, PolarsError):  # the whole text then tells what is wrong
                ends = _table_of_lines(lines, layout, text.is_ended)
                if not ends.skipped:
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
    """Add the lines between the first and the last ones.

    Raises
    ------
    InputError, PolarsError
        One is a comment or blank, or has not a cell for each name.
    """
    delimiter = ends.delimiter
    if delimiter == " ":
        text = re.sub(rb"(?m)^[ \t]+|[ \t]+$", b"", text)
        text = re.sub(rb"[ \t]+", b"\t", text)
        delimiter = "\t"
    between = pl.read_csv(
        text, has_header=False, separator=delimiter, quote_char=None, schema=ends.body.schema
    )
    between = between.with_columns(pl.all().fill_null("").str.strip_chars(PADDING))
    # polars refuses a line with more cells than names, so that as many cells in all as names times
    # lines say that no line has fewer
    are_whole = text.count(delimiter.encode()) == count * (between.width - 1)
    has_comment = any(sign.encode() in text for sign in COMMENT_SIGNS)
    has_blank = between.select(pl.all_horizontal(pl.all() == "").any()).item()
    if not are_whole or has_comment or has_blank:
        raise InputError("lines are not alike")
    above = int((ends.lines <= FIRST_LINES).sum())
    lines = np.arange(FIRST_LINES + 1, FIRST_LINES + 1 + count)
    return replace(
        ends,
        lines=np.concatenate([ends.lines[:above], lines, ends.lines[above:]]),
        body=pl.concat([ends.body[:above], between, ends.body[above:]]),
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
