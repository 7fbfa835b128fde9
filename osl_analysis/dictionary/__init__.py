"""The data dictionary: meaning and unit of every column of every table that the pipeline writes.

The YAML files beside this module and `figures/figures.yaml` have a section per table, and in it a
line per column, `name: unit | meaning`, in three short forms: `K, _se, _low: N*m/rad | ...`
describes K, K_se and K_low, by the endings in `shared.yaml`; `cov K B I:` the covariances cov_K_B,
cov_K_I and cov_B_I, whose units are the products of the columns'; `include GROUP:` takes a group of
columns, and a name without a description a column, from `shared.yaml`.

Two things stand in no section: a result table with the column `trial` has `joint` and `side` behind
it, and the last column of every table is `data`. A new column is its line of code and its line
here; a test fails where one is missing.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain, combinations
from pathlib import Path
from typing import Any

import yaml

HERE = Path(__file__).parent
SHARED = HERE / "shared.yaml"


@cache
def own_yaml(path: Path) -> dict[str, Any]:
    """A YAML file of this package, by the reader in C: every process reads them, a fifth of a
    second by the other."""
    content: dict[str, Any] = yaml.load(path.read_bytes(), yaml.CSafeLoader)
    return content


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


def file_at(place: str) -> str:
    """The file at the `place` of a table, with words for the names of trial and experiment."""
    named = place.replace("*/*", "EXPERIMENT/*").replace("*", "TRIAL")
    return f"{named}.csv"


@cache
def described_tables() -> tuple[DescribedTable, ...]:
    """All tables, in the order of the page."""
    files = ("bench.yaml", "walking.yaml", "campaign.yaml", "../figures/figures.yaml")
    return tuple(chain.from_iterable(described_in(HERE / name) for name in files))


@cache
def described_tables_by_name() -> dict[str, DescribedTable]:
    """The result tables of campaigns by name, each with the columns of its evidence."""
    tables = {
        Path(table.place).name: table
        for table in described_tables()
        if table.place.startswith("tables/")
    }
    with_evidence = {}
    for name, table in tables.items():
        evidence = tables.get(f"{name}_evidence")
        columns = {} if evidence is None else evidence.columns
        with_evidence[name] = replace(table, columns={**table.columns, **columns})
    return with_evidence


@cache
def described_in(path: Path) -> tuple[DescribedTable, ...]:
    """The tables that one file describes."""
    tables = []
    shared = own_yaml(SHARED)
    for place, table in own_yaml(path).items():
        lines: list[tuple[str, str | None]] = []
        for key, text in table["columns"].items():
            lines.append((key, text))
            if key == "trial" and place.startswith("tables/"):
                lines.append(("include place", None))
        lines.append(("data", None))

        described: dict[str, DescribedColumn] = {}
        for key, text in lines:
            for column in described_columns(key, text, described, shared):
                described[column.name] = column
        tables.append(DescribedTable(place, table.get("also", ""), table["rows"], described))
    return tuple(tables)


def described_columns(
    key: str, text: str | None, before: Mapping[str, DescribedColumn], shared: Mapping[str, Any]
) -> Iterator[DescribedColumn]:
    """The columns that one line of the dictionary describes; `before` are those of the same table
    above it, `shared` the content of `shared.yaml`."""
    word, _, rest = key.partition(" ")
    if word == "include":
        for name, described in shared["groups"][rest].items():
            yield from described_columns(name, described, before, shared)
    elif word == "cov":
        for a, b in combinations(rest.split(), 2):
            unit = f"({before[a].unit}) * ({before[b].unit})"
            yield DescribedColumn(f"cov_{a}_{b}", unit, f"covariance of the estimates {a} and {b}")
    else:
        name, *endings = key.split(", ")
        unit, meaning = (text or shared["columns"][name]).split(" | ")
        yield DescribedColumn(name, unit, meaning)
        for ending in endings:
            meaning_of_ending = shared["endings"][ending].replace("NAME", name)
            yield DescribedColumn(f"{name}{ending}", unit, meaning_of_ending)
