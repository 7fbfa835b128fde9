"""Doubtful fits: fits with a value beyond a limit of the configuration."""

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Self

import polars as pl
from pydantic import ConfigDict, Field, model_validator

from osl_analysis.causes import remedy
from osl_analysis.errors import InputError
from osl_analysis.experiments import judged_tables
from osl_analysis.refusal import is_refused
from osl_analysis.table import read_table
from osl_analysis.yaml_settings import Settings

DOUBTFUL = "doubtful"
"""Column with the reasons: empty text if the fit is not doubtful, null in a row without a fit."""
IS_DOUBTFUL = pl.col(DOUBTFUL).fill_null("") != ""
FEWEST_SOUND = 0.5
"""Share of sound trials from which on a mean over trials leaves out the doubtful ones. With fewer, all trials count:
the doubt is then about the campaign, and the rest would be a selection."""
EXCLUDED = "excluded"
"""Column with the reason why a row has no fit, in tables that have such rows; null in rows with a fit."""


class Doubt(Settings):
    """Limits of one table, by column. Null: no limit."""

    above: dict[str, float | None] = Field(default_factory=dict)
    """Upper limits, by column. A fit is doubtful if the absolute value is above its limit."""
    below: dict[str, float | None] = Field(default_factory=dict)
    """Lower limits, by column. A fit is doubtful if the value is below its limit."""


class DoubtfulFits(Settings):
    """Limits by table. The tables of `judged_tables` can have limits on every numeric column."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Doubt] = Field(init=False)

    @model_validator(mode="after")
    def _tables_are_judged(self) -> Self:
        unknown = [name for name in self.__pydantic_extra__ if name not in judged_tables()]
        if unknown:
            raise ValueError(f"unknown table '{unknown[0]}'; limits may stand on {', '.join(judged_tables())}")
        return self

    def of(self, table: str) -> Doubt:
        """The limits of a table; no limits if the configuration has none."""
        return self.__pydantic_extra__.get(table, Doubt())


def marked(table: pl.DataFrame, limits: Doubt, name: str) -> pl.DataFrame:
    """The table `name` with the column `DOUBTFUL`, which lists each value beyond its limit, with the limit.

    Raises
    ------
    InputError
        A limit is set on a column that the table does not have or that is not numeric. The message names the column.
    """
    fitted = pl.col(EXCLUDED).is_null() if EXCLUDED in table.columns else pl.lit(True)
    fits = table.filter(fitted)
    above, below = (
        {column: limit for column, limit in side.items() if limit is not None} for side in (limits.above, limits.below)
    )
    for column in [*above, *below] * (len(fits) > 0):
        check_limited(table, column, f"doubtful.{name}")
    reasons = pl.Series([doubts(row, above, below) for row in table.iter_rows(named=True)], dtype=pl.String)
    return table.with_columns(reasons.alias(DOUBTFUL)).with_columns(pl.when(fitted).then(DOUBTFUL).alias(DOUBTFUL))


def check_limited(table: pl.DataFrame, column: str, place: str) -> None:
    """Refuse a limit on a missing or non-numeric column. `place` is the place of the limit in the configuration."""
    if column not in table.columns or not (table[column].dtype.is_numeric() or table[column].dtype == pl.Null):
        known = ", ".join(name for name in table.columns if table[name].dtype.is_numeric())
        raise InputError(
            f"configuration, {place}: the table has no column '{column}' of numbers; put the limit on one of {known}, "
            "or write null for no limit"
        )


def doubts(row: Mapping[str, object], largest: Mapping[str, float], smallest: Mapping[str, float]) -> str:
    """Why a row of a table is doubtful: each value that is beyond its limit or NaN, with likely cause and remedy if the
    column has one. The text is empty if the row is not doubtful.

    `largest` are upper limits of absolute values, `smallest` lower limits of values. A null is not checked.
    """
    reasons = []
    for limits, word in ((largest, "above"), (smallest, "below")):
        for name, limit in limits.items():
            value = row.get(name)
            if not isinstance(value, int | float):
                continue
            if math.isnan(value):
                reasons.append(f"{name} is not a number")
            elif word == "above" and value < -limit:
                reasons.append(f"{name} {value:.3g} is below {-limit:g}{remedy(name, value, row)}")
            elif value > limit if word == "above" else value < limit:
                reasons.append(f"{name} {value:.3g} is {word} {limit:g}{remedy(name, value, row)}")
    return "; ".join(reasons)


def with_doubts_of(table: pl.DataFrame, fits: pl.DataFrame, limits: Doubt, name: str) -> pl.DataFrame:
    """The marked table with the reasons of another table, `name`, on the same trial and amplitude.

    What makes a fit doubtful, as a clipped or late torque, concerns everything that comes from the same samples. A
    table without amplitudes has the reasons of the row of `fits` over all amplitudes.
    """
    judged = marked(fits, Doubt(above=limits.above, below=limits.below), name)
    reasons = {(row["trial"], row["amplitude_deg"]): row[DOUBTFUL] for row in judged.iter_rows(named=True)}
    shared = []
    for row in table.iter_rows(named=True):
        other = reasons.get((row["trial"], row.get("amplitude_deg")))
        both = [row[DOUBTFUL], f"{name}.csv: {other}" if other else ""]
        shared.append(None if row[DOUBTFUL] is None else "; ".join(filter(None, both)))
    return table.with_columns(pl.Series(DOUBTFUL, shared, dtype=pl.String))


def counted(table: pl.DataFrame) -> pl.DataFrame:
    """The rows, one per trial, that count in a mean: the sound ones if these are a share of `FEWEST_SOUND`, else all.

    A table without the column `DOUBTFUL` is not judged: all its rows count.
    """
    if DOUBTFUL not in table.columns:
        return table
    doubtful, n = doubtful_count(table)
    return table.filter(~IS_DOUBTFUL) if doubtful and n - doubtful >= FEWEST_SOUND * n else table


def doubtful_row(table: pl.DataFrame) -> dict[str, int]:
    """`n_doubtful` for a row that summarises a table; empty for a table without the column `DOUBTFUL`."""
    return {"n_doubtful": doubtful_count(table)[0]} if DOUBTFUL in table.columns else {}


def doubtful_count(table: pl.DataFrame) -> tuple[int, int]:
    """Number of doubtful fits of a table with the column `DOUBTFUL`, and number of its fits."""
    return len(table.filter(IS_DOUBTFUL)), table[DOUBTFUL].count()


def unchecked_report(tables: Iterable[Path]) -> str:
    """Message at the end of a run: for each thing that could not be checked, the number of trials; empty if all was."""
    counts: dict[str, set[str]] = {}
    for path in tables:
        table = read_table(path) if path.is_file() and not is_refused(path) else pl.DataFrame()
        if "not_checked" in table.columns:
            for trial, reason in table.select("trial", "not_checked").drop_nulls().unique().iter_rows():
                counts.setdefault(reason, set()).add(trial)
    return "\n".join(f"not checked: {reason} (trials: {len(counts[reason])})" for reason in sorted(counts))


def doubt_report(tables: Iterable[Path]) -> str:
    """Message at the end of a run: the number of doubtful fits of each table; empty without doubtful fits."""
    written = {path.stem: read_table(path) for path in tables if path.is_file() and not is_refused(path)}
    counts = {name: doubtful_count(table) for name, table in written.items() if DOUBTFUL in table.columns}
    parts = [f"{name} {doubtful} of {fits}" for name, (doubtful, fits) in counts.items() if doubtful]
    return f"doubtful fits (the column `{DOUBTFUL}` of each table says why): {', '.join(parts)}" if parts else ""
