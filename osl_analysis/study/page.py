"""The table of the study as docs/study.md has it: a line for each experiment, estimator and interval."""

from collections.abc import Iterable

import polars as pl

AIM = (0.93, 0.97)  # Coverage of 95 % intervals that the study aims at
CERTAIN = 2.0  # Monte Carlo errors by which a coverage must lie outside before it is said to
HEADER = ("experiment", "estimator, interval", "quantities", "n", "bias / SD", "RMSE / bound", "SE / SD", "coverage, %")
LETTERS = {"k_tau_n_m": "k_τ n_m", "magnitude": "\\|Y\\|", "phase": "arg Y"}


def page(table: pl.DataFrame) -> str:
    """The table of `performance_table` in Markdown, and what lies outside the aim."""
    keys = ["experiment", "estimator", "interval_method", "n"]
    groups = [rows for _, rows in table.group_by(keys, maintain_order=True)]
    lines = [line(HEADER), line(["---"] * len(HEADER)), *(line(cells(rows)) for rows in groups)]
    return "\n".join([*lines, "", *(f"* {sentence}" for sentence in findings(table)), ""])


def cells(rows: pl.DataFrame) -> list[str]:
    """The cells of one experiment, estimator and interval: a number for each quantity."""
    first = rows.row(0, named=True)
    names = [quantity.partition(",")[0] for quantity in rows["quantity"]]
    bias, errors = range_of(rows["bias_mc"], "{:.2f}"), range_of(100 * rows["coverage_mc"], "{:.1f}")
    return [
        first["experiment"],
        f"{first['estimator']}, {first['interval_method']}",
        ", ".join(LETTERS.get(name, name) for name in names),
        str(first["n"]),
        f"{numbers(rows['bias'], '{:.2f}')} ± {bias}",
        numbers(rows["rmse_over_bound"], "{:.2f}"),
        numbers(rows["se_over_sd"], "{:.2f}"),
        f"{numbers(100 * rows['coverage'], '{:.1f}')} ± {errors}",
    ]


def findings(table: pl.DataFrame) -> list[str]:
    """How many coverages are there, the mean of them, and which lie outside the aim beyond chance."""
    low, high = AIM
    default = table.filter(pl.col("estimator").str.contains("filtered|sinusoid"))
    off = default.filter(
        (pl.col("coverage") + CERTAIN * pl.col("coverage_mc") < low)
        | (pl.col("coverage") - CERTAIN * pl.col("coverage_mc") > high)
    )
    inside = default.filter(pl.col("coverage").is_between(low, high))
    mean = 100 * float(default["coverage"].mean() or 0.0)  # type: ignore[arg-type]
    named = [f"{r['experiment']}, {r['quantity']}: {100 * r['coverage']:.1f} %" for r in off.iter_rows(named=True)]
    return [
        f"Bench, default estimator: {len(default)} coverages with a mean of {mean:.1f} %; {len(inside)} lie between "
        f"{100 * low:g} and {100 * high:g} %.",
        f"Outside by more than {CERTAIN:g} Monte Carlo errors: {'; '.join(named) or 'none'}.",
    ]


def numbers(values: pl.Series, form: str) -> str:
    """The numbers of some quantities, a dash where there is none."""
    return ", ".join("–" if value is None else form.format(value) for value in values)


def range_of(values: pl.Series, form: str) -> str:
    """The largest of some Monte Carlo errors."""
    return form.format(float(values.max() or 0.0))  # type: ignore[arg-type]


def line(columns: Iterable[str]) -> str:
    """A row of a Markdown table."""
    return f"| {' | '.join(columns)} |"
