"""Tables for a paper and for the page: K, B and I of each condition and each group of crossings, and
the components of the drivetrain (Table I)."""

from collections.abc import Mapping

import pandas as pd
import polars as pl

from osl_analysis.report.numbers import ENTRIES
from osl_analysis.report.rounding import written
from osl_analysis.stats.repeats import IS_DOUBTFUL, counted, summary_row

CONDITION = ("joint", "side", "excitation", "controller", "K_d", "B_d")
HEADS = {  # of columns, in LaTeX
    "K_d": r"$K_\mathrm{d}$",
    "B_d": r"$B_\mathrm{d}$",
    "K": r"$K$ (\unit{\newton\meter\per\radian})",
    "B": r"$B$ (\unit{\newton\meter\second\per\radian})",
    "B_viscous": r"$B_\mathrm{viscous}$ (\unit{\newton\meter\second\per\radian})",
    "I": r"$I$ (\unit{\kilogram\meter\squared})",
    "VAF": r"VAF (\unit{\percent})",
}
ESTIMATED = ("K", "B", "B_viscous", "I", "VAF")


def conditions_table(impedance: pl.DataFrame) -> pd.DataFrame:
    """K, B and I of each condition: of its trial, or the mean of several. † marks a doubtful fit."""
    whole = impedance.filter(pl.col("amplitude_deg").is_null())
    keys = [name for name in CONDITION if name in whole.columns and whole[name].count()]
    keys = [name for name in keys if whole[name].n_unique() > 1] or keys[-1:]
    rows = []
    for fits in whole.sort(keys).partition_by(keys, maintain_order=True):
        used = counted(fits)
        row = {key: cell_text(fits[key][0]) for key in keys}
        row["n"] = f"{len(used)}{'†' if used.select(IS_DOUBTFUL.any()).item() else ''}"
        for name in ESTIMATED:
            if name in fits.columns and whole[name].count():
                row[name] = estimate_text(used, name)
        rows.append(row)
    return pd.DataFrame(rows)


def cell_text(cell: object) -> str:
    """What the sheet states."""
    return "–" if cell is None else f"{cell:g}" if isinstance(cell, float) else str(cell)


def estimate_text(used: pl.DataFrame, name: str) -> str:
    """An estimate with its 95 % interval."""
    if len(used) > 1:
        mean = summary_row(used, name)
        numbers = mean["mean"], mean["low"], mean["high"]
    else:
        row = used.row(0, named=True)
        numbers = row[name], row.get(f"{name}_low"), row.get(f"{name}_high")
    return "–" if numbers[0] is None else written(*numbers)


def walking_table(summary: pl.DataFrame) -> pd.DataFrame:
    """K, B and I under each group of crossings, of all perturbations together."""
    return quantities_table(summary.filter(estimator="ensemble"), "group")


def components_table(summaries: Mapping[str, pl.DataFrame], beside_draft: bool) -> pd.DataFrame:
    """The measured components of the drivetrain (Eqs. 1 to 4), as means over trials."""
    table = quantities_table(pl.concat(summaries.values(), how="diagonal_relaxed"), None)
    drafts = {entry.name: entry.draft for entry in ENTRIES}
    table = table[table["quantity"].isin(drafts)]
    if not beside_draft:
        return table
    return table.assign(draft=table["quantity"].map(drafts).map("{:g}".format))


def quantities_table(summary: pl.DataFrame, by: str | None) -> pd.DataFrame:
    """The means of a summary with their intervals; with `by`, a column for each quantity."""
    rows = summary.drop_nulls("mean").to_dicts()
    texts = [written(row["mean"], row["low"], row["high"]) for row in rows]
    table = pd.DataFrame(rows).assign(mean=texts)
    if by is None:
        return table[["quantity", "mean", "n"]]
    return table.pivot_table(
        index=[by, "n"], columns="quantity", values="mean", aggfunc="first", sort=False
    ).reset_index()


def to_tex(table: pd.DataFrame, origin: str) -> str:
    r"""A `tabular` with rules of booktabs and units of siunitx, to be `\input`."""
    style = table.rename(columns=HEADS).style.hide(axis="index").format(escape="latex")
    return f"% {origin}\n{style.to_latex(hrules=True)}"


def to_markdown(table: pd.DataFrame, origin: str) -> str:
    """The table in Markdown, and what it is made of."""
    return f"{table.to_markdown(index=False)}\n\n{origin}. †: with a doubtful fit.\n"
