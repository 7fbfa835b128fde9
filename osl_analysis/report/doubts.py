"""Doubts in plain words: each value beyond its limit, with what that value is."""

import re
from collections.abc import Mapping
from typing import Any

import polars as pl

from osl_analysis.dictionary import DescribedTable

BEGINNING = re.compile(r"(?:^|; )(?=(?:\w+\.csv: )?\w+ (?:\S+ is (?:above|below) |is not a number))")
"""Where the next doubt of a cell begins, as `doubtful.doubts` writes it."""
PARTS = {"amplitude_deg": "deg", "frequency_hz": "Hz"}
"""Columns that say which part of a trial a row is of, and their units."""
REPEATED = re.compile(r"\w+\.csv: ")
"""Beginning of a doubt that another table has."""
COLUMN = re.compile(r"(?:\w+\.csv: )?(\w+) ")


def doubts_of(tables: Mapping[str, pl.DataFrame], described: Mapping[str, DescribedTable]) -> list[dict[str, Any]]:
    """Each doubt about one trial: `where` in it, `of` all of its fit, a part, or an other table, `text`, `meaning`.

    `tables` has its rows of each table, that of its fit first. Doubts that other tables only repeat are left out.
    """
    found = []
    for number, (name, table) in enumerate(tables.items()):
        for row in table.iter_rows(named=True):
            part = "part" if row.get("amplitude_deg") is not None else "all"
            place = where(row) if number == 0 else f"{name}.csv, {where(row)}"
            for text in split(row.get("doubtful") or ""):
                if number and REPEATED.match(text):
                    break  # the rest of the cell is the other table's
                said = meaning(text, described.get(name))
                found.append({"where": place, "of": "other" if number else part, "text": text, "meaning": said})
    return found


def split(cell: str) -> list[str]:
    """The single doubts of a cell of the column `doubtful`."""
    return [part for part in BEGINNING.split(cell) if part]


def where(row: Mapping[str, Any]) -> str:
    """The part of a trial that a row is of."""
    at = [f"{row[column]:g} {unit}" for column, unit in PARTS.items() if row.get(column) is not None]
    return ", ".join(at) or ("all amplitudes" if "amplitude_deg" in row else "whole trial")


def meaning(text: str, described: DescribedTable | None) -> str:
    """What the value is that a doubt names; empty if nobody knows."""
    named = COLUMN.match(text)
    column = described.columns.get(named[1]) if named and described else None
    return column.meaning if column else ""
