"""The sentence that a page and a run begin with: does the joint render what was asked for, and
better with compensation than without."""

from collections.abc import Mapping

import polars as pl

from osl_analysis.measured import significant
from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.stats.repeats import counted

MOST_CONTROLLERS = 3  # in a sentence
WORST_K = 100 * (pl.col("K") / pl.col("K_d") - 1).abs()
WORST_B = (pl.col("B") - pl.col("B_d")).abs()
COMPARED = {"K_error": "K", "B_error": "B"}
FIRST = "{}K is within {} % of K_d and B within {} N*m*s/rad of B_d"


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
    whole = counted(tables["impedance"]).filter(pl.col("amplitude_deg").is_null())
    is_asked = (pl.col("K_d") > 0) & pl.col("B_d").is_not_null()
    asked = whole.filter(is_asked).with_columns(K_error=WORST_K, B_error=WORST_B)
    worst = asked.group_by("controller").agg(pl.max("K_error", "B_error"))
    order = dict(zip(CONTROLLERS, range(len(CONTROLLERS)), strict=True))
    rows = worst.sort(pl.col("controller").replace_strict(order, default=len(order)), "controller")
    texts: list[str] = []
    for row in rows.head(MOST_CONTROLLERS).to_dicts():
        K, B = (significant(row[name] or 0.0) for name in COMPARED)
        # what and in which unit is said once
        words = "{}within {} % and {}" if texts else FIRST
        texts.append(words.format(f"{row['controller']}, " if row["controller"] else "", K, B))
    pairs = tables.get("compensation", pl.DataFrame())
    if texts and len(pairs):  # an empty file has no types
        of_quantity = pairs.filter(of="trials").group_by("quantity").agg(pl.sum("better", "pairs"))
        counts = {row["quantity"]: row for row in of_quantity.to_dicts()}
        nearer = [
            f"in {symbol} in {counts[name]['better']} of {counts[name]['pairs']} pairs"
            for name, symbol in COMPARED.items()
            if name in counts
        ]
        if nearer:
            texts.append(f"compensation is nearer {', '.join(nearer)}")
    if not texts:
        return ""
    sentence = "; ".join(texts)
    return f"{sentence[0].upper()}{sentence[1:]}."
