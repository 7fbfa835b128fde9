"""Whether compensation is better, in one sentence."""

from collections.abc import Iterator, Mapping

import polars as pl

from osl_analysis.measured import significant
from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.stats.repeats import counted

PAIRED = ["joint", "side", "K_d", "B_d", "frequency_hz"]
NEARER = {"K_error": "K is nearer to K_d", "B_error": "B is nearer to B_d"}


def compensation_text(tables: Mapping[str, pl.DataFrame]) -> str:
    """Whether K, B and the impedance over frequency of compensated trials are nearer to what was
    commanded than those of uncompensated ones of the same condition; empty without pairs."""
    parts = [*estimate_parts(tables.get("compensation", pl.DataFrame()))]
    if parts and "response" in tables:
        parts += response_parts(tables["response"])
    return f"Is compensation better? {'; '.join(parts)}." if parts else ""


def estimate_parts(compensation: pl.DataFrame) -> Iterator[str]:
    """In how many pairs of trials K and B are nearer, and by how much."""
    if compensation.is_empty():
        return
    for row in compensation.filter(of="trials").to_dicts():
        if row["quantity"] in NEARER:
            ends = row["difference"], row["difference_high"], row["difference_low"]
            mean, low, high = (significant(-end) for end in ends)
            yield (
                f"{NEARER[row['quantity']]} in {row['better']} of {row['pairs']} pairs of trials,"
                f" by {mean} {row['unit']} on average ({low} to {high})"
            )


def response_parts(response: pl.DataFrame) -> Iterator[str]:
    """At how many frequencies the impedance is nearer."""
    of_whole = counted(response).filter(scope="all").drop_nulls("Z_error")
    compensated, uncompensated = (
        of_whole.filter(controller=name).group_by(PAIRED).agg(pl.col("Z_error").mean())
        for name in CONTROLLERS
    )
    pairs = compensated.join(uncompensated, on=PAIRED, nulls_equal=True)
    if len(pairs):
        better = pairs.filter(pl.col("Z_error") < pl.col("Z_error_right"))
        yield f"|Z - Z_d| is smaller at {len(better)} of {len(pairs)} frequencies of pairs"
