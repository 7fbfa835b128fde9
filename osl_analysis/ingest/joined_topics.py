"""Topics of a log, each with stamps of its own, as one table with a row per stamp."""

from collections.abc import Sequence

import numpy as np
import polars as pl

from osl_analysis.formats.messages.leaves import Indices
from osl_analysis.memory import return_memory

MANY = 1 << 20
"""Rows from which on the memory of what made them is given back."""


def joined_on_stamp(tables: Sequence[pl.DataFrame]) -> pl.DataFrame:
    """One table with a row per stamp of any of the tables, which are sorted by it; rows of their own where stamps are
    rounded and equal.

    Where stamps differ, columns are taken out of the tables one by one: a recording of hours has no room for both.
    """
    joined, *others = tables
    return_much(sum(map(len, tables)))
    if others and any((np.diff(table["stamp"].to_numpy()) == 0).any() for table in tables):
        return pl.concat(tables, how="diagonal").sort("stamp", maintain_order=True)
    if all(joined["stamp"].equals(table["stamp"]) for table in others):
        return joined.hstack([column for table in others for column in table.drop("stamp")])
    stamp = np.concatenate([table["stamp"].to_numpy() for table in tables])
    stamp.sort(kind="stable")  # fast, because the stamps of each table rise
    stamp = stamp[np.append(True, stamp[1:] != stamp[:-1])]
    columns = [pl.Series("stamp", stamp)]
    for table in tables:
        rows = rows_among(table.drop_in_place("stamp").to_numpy(), stamp)
        for name in table.columns:
            columns.append(table.drop_in_place(name).gather(rows))
            return_much(len(stamp))
    return pl.DataFrame(columns)


def rows_among(some: Indices, stamps: Indices) -> pl.Series:
    """The row of each of the stamps (n,) among `some` of them (k,), null where it is not there; both rise."""
    there = np.searchsorted(stamps, some)
    rows = np.zeros(len(stamps), np.uint32)
    rows[there] = np.arange(len(some), dtype=np.uint32)
    absent = np.ones(len(stamps), bool)
    absent[there] = False
    return pl.Series(rows).set(pl.Series(absent), None)


def return_much(rows: int) -> None:
    """Give back the memory that is free, where many rows were made."""
    if rows > MANY:
        return_memory()
