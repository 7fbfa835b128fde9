# SPDX-License-Identifier: Apache-2.0
"""Read the data dictionary, and make tables as it describes them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.base.files import package_yaml

HERE = Path(__file__).parent
SHARED = HERE / "shared.yaml"


@dataclass(frozen=True)
class DescribedColumn:
    """A column of a table."""

    name: str
    unit: str  # SI unit; 1 for a number without one, count, text, or what else the values are
    meaning: str


@dataclass(frozen=True)
class DescribedTable:
    """A table that the pipeline writes."""

    # path below `results/` without the suffix .csv; * stands for a trial, and before it for an
    # experiment
    place: str
    # path of the tables of single trials that it gathers, with the same columns; empty if there are
    # none
    also: str
    rows: str  # what a row is
    columns: Mapping[str, DescribedColumn]
    # further columns of the tables of single trials, which findings read
    of_fits: Mapping[str, DescribedColumn]

    @property
    def sections(self) -> list[tuple[str, str, list[DescribedColumn]]]:
        """A file, what its rows are, and its columns; then those that the files of single trials
        have beside."""
        sections = [(file_at(self.place), self.rows, list(self.columns.values()))]
        if self.of_fits:
            rows = "the same of one trial, with further columns"
            sections.append((file_at(self.also), rows, list(self.of_fits.values())))
        return sections


def file_at(place: str) -> str:
    """The file at the `place` of a table, with words for the names of trial and experiment."""
    return place.replace("*/*", "EXPERIMENT/*").replace("*", "TRIAL") + ".csv"


@cache
def described_tables() -> tuple[DescribedTable, ...]:
    """All tables, in the order of the page."""
    files = ("bench.yaml", "walking.yaml", "campaign.yaml", "../figures/figures.yaml")
    return tuple(chain.from_iterable(described_in(HERE / name) for name in files))


@cache
def described_tables_by_name() -> dict[str, DescribedTable]:
    """The result tables of campaigns by name."""
    return {
        Path(table.place).name: table
        for table in described_tables()
        if table.place.startswith("tables/")
    }


@cache
def described_in(path: Path) -> tuple[DescribedTable, ...]:
    """The tables that one file describes."""
    tables = []
    shared = package_yaml(SHARED)
    for place, table in package_yaml(path).items():
        lines = []
        for key, text in table["columns"].items():
            lines.append((key, text))
            if key == "trial" and place.startswith("tables/"):
                lines.append(("include place", None))
        lines.append(("data", None))

        columns = described_lines(lines, shared)
        fit_columns = described_lines(table.get("of_fits", {}).items(), shared)
        tables.append(
            DescribedTable(place, table.get("also", ""), table["rows"], columns, fit_columns)
        )
    return tuple(tables)


def described_lines(
    lines: Sequence[tuple[str, str | None]], shared: Mapping[str, Any]
) -> dict[str, DescribedColumn]:
    """The columns that lines of the dictionary describe, by name."""
    described: dict[str, DescribedColumn] = {}
    for key, text in lines:
        for column in described_columns(key, text, shared):
            described[column.name] = column
    return described


def described_columns(
    key: str, text: str | None, shared: Mapping[str, Any]
) -> Iterator[DescribedColumn]:
    """The columns that one line of the dictionary describes; `shared` is the content of
    `shared.yaml`."""
    word, _, name_or_group = key.partition(" ")
    if word == "include":
        for name, described in shared["groups"][name_or_group].items():
            yield from described_columns(name, described, shared)
    else:
        name, *endings = key.split(", ")
        unit, meaning = (text or shared["columns"][name]).split(" | ")
        yield DescribedColumn(name, unit, meaning)
        for ending in endings:
            meaning_of_ending = shared["endings"][ending].replace("NAME", name)
            yield DescribedColumn(f"{name}{ending}", unit, meaning_of_ending)


@cache
def text_columns() -> frozenset[str]:
    """The columns that are text in each table that has them, such as a trial named `01`."""
    columns = [
        column
        for table in described_tables()
        for column in (*table.columns.values(), *table.of_fits.values())
    ]
    names = {column.name for column in columns}
    return frozenset(names - {column.name for column in columns if column.unit != "text"})


TYPES: Mapping[str, type[pl.DataType]] = {
    "text": pl.String,
    "true or false": pl.Boolean,
    "count": pl.Int64,
}
"""By unit; any other column holds numbers."""
ADDED_TO_ALL = {
    "joint",
    "side",
    "doubtful",
    "remarks",
    "status",
    "reason",
    "data",
    "K_verdict",
    "B_verdict",
    "I_verdict",
}
"""Columns that rows of single trials get where a table is gathered from them."""


def columns_of_trial(name: str) -> list[str]:
    """The columns of the result table `name` in a file of a single trial, in their order, but for
    `data`. One that was not analysed has the same."""
    table = described_tables_by_name()[name]
    names = [name for name in (*table.columns, *table.of_fits) if name not in ADDED_TO_ALL]
    return [*names, "status", "reason"]


def table_of(rows: Sequence[Mapping[str, Any]], name: str) -> pl.DataFrame:
    """Rows of the result table `name` with all columns that a fit may give, null where no row has
    them, and the types that its description gives. Raises ValueError: a column is not described."""
    table = described_tables_by_name()[name]
    described = {**table.columns, **table.of_fits}
    row_names = rows[0].keys() if rows else set()
    names = sorted({*row_names, *(described.keys() - ADDED_TO_ALL)}, key=[*described].index)
    types = {name: TYPES.get(described[name].unit, pl.Float64) for name in names}
    return pl.DataFrame(rows, schema=types)
