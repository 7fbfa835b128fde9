"""Doubts in plain words: each value beyond its limit, with what that value is."""

import re
from collections.abc import Mapping
from typing import Any

import polars as pl

from osl_analysis.dictionary import DescribedTable

BEGINNING = re.compile(r"(?:^|; )(?=(?:\w+\.csv: )?\w+ (?:\S+ is (?:above|below) |is not a number))")
"""Where the next doubt of a cell begins, as `doubtful.doubts` writes it."""
COLUMN = re.compile(r"(?:\w+\.csv: )?(\w+) ")


def doubts_of(table: pl.DataFrame, described: DescribedTable | None) -> list[dict[str, Any]]:
    """Each doubt about the rows of one trial: `where` in it, whether that is `of_all` of it, `text`, and `meaning` of
    the value.
    """
    found = []
    for row in table.iter_rows(named=True):
        for text in split(row.get("doubtful") or ""):
            of_all = row.get("amplitude_deg") is None
            found.append({"where": where(row), "of_all": of_all, "text": text, "meaning": meaning(text, described)})
    return found


def split(cell: str) -> list[str]:
    """The single doubts of a cell of the column `doubtful`."""
    return [part for part in BEGINNING.split(cell) if part]


def where(row: Mapping[str, Any]) -> str:
    """The part of a trial that a row is of."""
    if "amplitude_deg" not in row:
        return "whole trial"
    return "all amplitudes" if row["amplitude_deg"] is None else f"{row['amplitude_deg']:g} deg"


def meaning(text: str, described: DescribedTable | None) -> str:
    """What the value is that a doubt names; empty if nobody knows."""
    named = COLUMN.match(text)
    column = described.columns.get(named[1]) if named and described else None
    return column.meaning if column else ""
