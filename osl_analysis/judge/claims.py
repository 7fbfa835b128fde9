# SPDX-License-Identifier: Apache-2.0
"""Compare the claims of a paper with the numbers of a campaign.

The author writes the claims in a file; `config/claims/draft.yaml` explains its fields. A number
meets its claim if it lies within the margin of its target. A pair of numbers of two controllers
meets it if the first is nearer to the target by more than the margin. The claim is met certainly if
the whole interval meets it, and missed certainly if no part does. A number without an interval
counts by its value.

Example: `claims_table(tables, read_claims(Path("config/claims/draft.yaml")))`.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import polars as pl
from pydantic import BeforeValidator, Field

from osl_analysis.base.errors import naming
from osl_analysis.base.yaml_settings import (
    Settings,
    check_known,
    read_mapping,
    refuse_if,
    validated,
)
from osl_analysis.bench.summaries import PLACE
from osl_analysis.dictionary.described import described_tables_by_name, table_of
from osl_analysis.stats.doubts import counted
from osl_analysis.stats.repeats import RANGE

NOT_TESTED = "not tested"


def parsed(text: str | float) -> str:
    """The text, if it is an expression of columns; ValueError otherwise."""
    try:
        pl.sql_expr(str(text))
    except pl.exceptions.PolarsError as error:
        raise ValueError(f"no expression of columns ({error})") from error
    return str(text)


Expression = Annotated[str, BeforeValidator(parsed)]


class Claim(Settings):
    """A sentence of the text, and the number that it is compared with."""

    says: str  # The sentence.
    at: str  # Where it stands in the text.
    table: str  # Result table with the numbers.
    rows: Expression = "TRUE"  # Condition on its rows.
    number: Expression  # What is compared.
    low: Expression = "NULL"  # Lower end of its 95 % interval.
    high: Expression = "NULL"  # Upper end.
    unit: str  # Of number and margin.
    target: Expression  # What the number should be.
    margin: Annotated[float, Field(ge=0)]  # By how much it may differ, or must be nearer.
    controller: str | None = None  # Whose trials; null: all rows.
    than: str | None = None  # Controller that is to be farther from the target.
    pairs: tuple[str, ...] = ()  # Columns in which the two of a pair agree.
    better: str = "nearer"  # What the better one of a pair is, in a word.
    condition: str = ""  # Under which the claim is tested.

    _has_pairs = refuse_if(
        lambda s: s.than is not None and not (s.pairs and s.controller),
        "`than` compares two controllers; write `controller` and `pairs`, such as [K_d, B_d]",
        "than",
    )


def read_claims(path: Path) -> dict[str, Claim]:
    """The claims of a file by name. InputError: as `read_yaml`, or a claim asks for an unknown
    table or column."""
    claims = {
        name: validated(fields, Claim, f"{path}: {name}", ())
        for name, fields in read_mapping(path).items()
    }
    tables = described_tables_by_name()
    for name, claim in claims.items():
        with naming(f"{path}: {name}"):
            check_known(tables, "table", claim.table)
            columns = tables[claim.table].columns
            needed = [*claim.pairs, *(["controller"] if claim.controller else [])]
            for text in (claim.rows, claim.number, claim.low, claim.high, claim.target):
                needed += pl.sql_expr(text).meta.root_names()
            for column in needed:
                check_known(columns, f"column of the table {claim.table}", column)
    return claims


def claims_table(tables: Mapping[str, pl.DataFrame], claims: Mapping[str, Claim]) -> pl.DataFrame:
    """Compare the claims of a text with the numbers of a campaign.

    Parameters
    ----------
    tables
        The campaign's result tables, by name, with the doubts about their rows.
    claims
        Claims by name.

    Returns
    -------
    polars.DataFrame
        `claims.csv`: a row for each claim, joint and side of its table.
    """
    tested = []
    for name, claim in claims.items():
        statement = {
            "name": name, "claim": claim.says, "at": claim.at, "unit": claim.unit,
            "margin": claim.margin,
        }  # fmt: skip
        rows = tables.get(claim.table, pl.DataFrame())
        places = [place for place in PLACE if place in rows.columns]
        for part in rows.partition_by(places) if places else [rows]:
            place = part.select(places).row(0, named=True) if places else {}
            tested.append({**dict.fromkeys(PLACE), **place, **statement, **result_of(claim, part)})
    return table_of(tested, "claims")


def result_of(claim: Claim, table: pl.DataFrame) -> dict[str, Any]:
    """Numbers, counts and verdict of a claim on the rows of one joint and side."""
    if table.is_empty():
        return {"n": 0, "verdict": NOT_TESTED}
    expressions = {
        name: pl.sql_expr(getattr(claim, name)).cast(pl.Float64)
        for name in ("number", "low", "high", "target")
    }
    kept = counted(table, pl.sql_expr(claim.number).meta.root_names())
    rows = kept.filter(pl.sql_expr(claim.rows)).with_columns(**expressions)
    if claim.than is not None:
        rows = paired(claim, rows)
    else:
        if claim.controller is not None:
            rows = rows.filter(controller=claim.controller)
        rows = rows.with_columns(
            value=pl.when(pl.col("target").is_not_null()).then("number"),
            below=pl.col("target") - claim.margin,
            above=pl.col("target") + claim.margin,
        )
    return summary_of(rows.drop_nulls("value"), len(rows), claim)


def paired(claim: Claim, rows: pl.DataFrame) -> pl.DataFrame:
    """A row per pair of both controllers, whose `value` is the difference of their distances.

    It says how much nearer to its target the number of the first is; negative: farther. Its
    half-width is the root of the sum of both squared half-widths. It is null where one controller
    has no number.
    """
    distances = rows.with_columns(
        distance=(pl.col("number") - pl.col("target")).abs(),
        half=(pl.col("high") - pl.col("low")) / 2,
    )
    by_controller = [
        distances.filter(controller=name)
        .group_by(claim.pairs, maintain_order=True)
        .agg(pl.col("distance", "half").mean())
        for name in (claim.controller, claim.than)
    ]
    pairs = by_controller[0].join(
        by_controller[1], on=claim.pairs, nulls_equal=True, suffix="_of_other"
    )
    value = pl.col("distance_of_other") - pl.col("distance")
    half = (pl.col("half").pow(2) + pl.col("half_of_other").pow(2)).sqrt()
    return pairs.with_columns(
        value=value,
        low=value - half,
        high=value + half,
        below=pl.lit(claim.margin),
        above=pl.lit(math.inf),
    )


def summary_of(compared: pl.DataFrame, among: int, claim: Claim) -> dict[str, Any]:
    """Counts, mean and verdict of the conditions that could be compared, of `among` in all."""
    n = len(compared)
    low, high = pl.coalesce("low", "value"), pl.coalesce("high", "value")
    below, above = pl.col("below"), pl.col("above")
    outcomes = compared.select(
        met=pl.col("value").is_between(below, above).sum(),
        certain=((low >= below) & (high <= above)).sum(),
        missed=((low > above) | (high < below)).sum(),
    )
    counts = outcomes.row(0, named=True)
    if not n:
        return {"n": n, "among": among, "verdict": NOT_TESTED}
    text = claim.better
    if not claim.than:
        text = f"within {compared['target'][0]:g} ± {claim.margin:g} {claim.unit}"
    if n > 1:
        text += f" in {counts['met']} of {n}"
        if compared["low"].count():
            text += ", with the whole interval in {certain}, with none of it in {missed}".format(
                **counts
            )
    if n < among:
        text += f"; {among} were to be compared"
    if claim.condition:
        text += f" ({claim.condition})"
    values = compared["value"]
    ends: tuple[Any, Any] = (values.min(), values.max())
    interval: str | None = RANGE
    if n == 1:
        ends = compared.select("low", "high").row(0)
        interval = "95 %" if ends[0] is not None else None
    return {
        "quantity": text,
        "value": values.mean(), "low": ends[0], "high": ends[1], "interval": interval,
        "n": n, "among": among, "verdict": verdict_of(n, among, **counts),
    }  # fmt: skip


def verdict_of(n: int, among: int, met: int, certain: int, missed: int) -> str:
    """`holds`, `fails`, `mixed` or `undecided`, by how many of n numbers meet a claim, meet it
    certainly, and miss it certainly."""
    if 2 * n < among:  # less than half of the conditions do not stand for all
        return "undecided"
    if met == n and 2 * certain > n:
        return "holds"
    if met == 0 and 2 * missed > n:
        return "fails"
    return "mixed" if certain and missed else "undecided"
