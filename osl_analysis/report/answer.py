# SPDX-License-Identifier: Apache-2.0
"""The sentence that a page and a run begin with: does the joint render what was asked for, and
better with compensation than without."""

from collections.abc import Mapping

import polars as pl

from osl_analysis.figures.drawing import look_numbers
from osl_analysis.report.numbers import MOST_IN_SENTENCE
from osl_analysis.stats.repeats import counted
from osl_analysis.stats.rounding import significant

ERRORS = {
    "K": 100 * (pl.col("K") / pl.col("K_d") - 1).abs(),
    "B": (pl.col("B") - pl.col("B_d")).abs(),
}
UNITS = {"K": "%", "B": "N*m*s/rad"}  # of these errors
COMPARED = {"K_error": "K", "B_error": "B"}


def answer(tables: Mapping[str, pl.DataFrame]) -> str:
    """How far K and B of the trials are at most from what was asked for, by controller, and in how
    many pairs compensation is nearer; empty where nothing was asked for, or all is doubtful.

    Parameters
    ----------
    tables
        `impedance` and `compensation`, as far as the campaign has them.
    """
    if "impedance" not in tables:
        return ""
    whole = tables["impedance"].filter(
        pl.col("amplitude_deg").is_null() & (pl.col("K_d") > 0) & pl.col("B_d").is_not_null()
    )
    whole = whole.with_columns(look_numbers(whole["controller"])).sort("look", nulls_last=True)
    texts: list[str] = []
    for trials in whole.partition_by("controller")[:MOST_IN_SENTENCE]:
        clauses = []
        for symbol, error in ERRORS.items():
            worst = counted(trials, [symbol]).select(error.max()).item()
            if worst is not None:
                size = f"within {significant(worst)} {UNITS[symbol]}"
                clauses.append(f"{symbol} {size}" if texts else f"{symbol} is {size} of {symbol}_d")
        if clauses:
            texts.append(", ".join(filter(None, [trials["controller"][0], " and ".join(clauses)])))
    pairs = tables.get("compensation", pl.DataFrame())
    if texts and len(pairs):  # an empty file has no types
        nearer = []
        for quantity, symbol in COMPARED.items():
            of_quantity = pairs.filter(of="trials", quantity=quantity)
            better, count = of_quantity.select(pl.sum("better", "pairs")).row(0)
            if count:
                nearer.append(f"in {symbol} in {better} of {count}")
        if nearer:
            texts.append(f"compensation is nearer {', '.join(nearer)} pairs")
    if not texts:
        return ""
    sentence = "; ".join(texts)
    return f"{sentence[0].upper()}{sentence[1:]}."
