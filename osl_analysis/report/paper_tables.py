# SPDX-License-Identifier: Apache-2.0
"""Rows of tables for the page and for a paper.

They have K, B and I of each condition and of each group of crossings, the parts of their intervals,
and the components of the drivetrain (Table I).

Example: `tex_for_paper(condition_rows(conditions(impedance)), "Simulated data")`.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from statistics import median
from typing import Any

import polars as pl

from osl_analysis.base.files import own_yaml
from osl_analysis.judge.joining import GROUP_DOUBTS, RESULTS, WIDE_ESTIMATES
from osl_analysis.judge.known_findings import known_finding
from osl_analysis.report.typography import in_latex, in_markdown, markdown_table, template
from osl_analysis.report.verdicts import DOUBTFUL
from osl_analysis.stats.budget import CLEAR, IN_INTERVAL, WIDE, budgets_in
from osl_analysis.stats.doubts import counted, doubts_about
from osl_analysis.stats.repeats import OWN_CONDITION, summary_row
from osl_analysis.stats.rounding import (
    NOTHING,
    PrintedNumber,
    decimal_places,
    printed_number,
    significant,
    to_places,
)
from osl_analysis.walking.impedance_fit import ENSEMBLE
from osl_analysis.walking.tables import PREDICTED, budget_name

CONDITION_KEYS = ("joint", "side", "excitation", "controller", "K_d", "B_d", "own_condition")
HEADS = {
    "K": "K [N*m/rad]",
    "B": "B [N*m*s/rad]",
    "B_viscous": "B_viscous [N*m*s/rad]",
    "I": "I [kg*m^2]",
    "VAF": "VAF [%]",
}
"""Heads of the estimates of conditions and groups, by column."""
IN_LATEX: Mapping[str, str] = own_yaml(Path(__file__).with_suffix(".yaml"))
"""Heads of columns and components as LaTeX."""


@dataclass(frozen=True)
class Component:
    """A component of the drivetrain in Table I."""

    quantity: str  # name of the measured or stated quantity
    head: str
    draft: str  # value of the paper's draft; empty for none


COMPONENTS = (
    Component("n_m", "n_m", "9"),
    Component("n_T", "n_T", "7.55 (83/11)"),
    Component("k_tau", "k_tau [N*m/A]", "0.1133"),
    Component("K_s", "K_s [N*m/rad]", "685.6"),
    Component("B_m", "B_m [N*m*s/rad]", "0.0056"),
    Component("B_j", "B_j [N*m*s/rad]", "0.452"),
    Component("B_j_viscous", "viscous B_j [N*m*s/rad]", ""),
    Component("J_m", "J_m [kg*m^2]", "0.009211"),
    Component("J_j", "J_j [kg*m^2]", "0.005"),
    Component("f_C", "f_C [N*m]", "0.377"),
    Component("f_G", "f_G [N*m/A]", "0.0896"),
)
"""Table I, in its order."""
LARGEST_VAF = 99.99  # [%] largest one that is printed: none is rounded to 100
SUBTRACTED = {ENSEMBLE: "mean unperturbed gait", PREDICTED: "predicted gait"}
"""What each estimator of a group subtracts from the perturbed crossings."""
DAGGER = (
    "†: doubtful. Numbers are of the trials that are not doubtful; a condition whose trials are all"
    " doubtful has none. The number of a group of crossings is of all of its crossings. ±: 95 %"
    " interval; of one trial that of the same motion again, whose range over amplitudes and parts"
    " of the band is in impedance.csv; of several, of components and of crossings that of the mean"
)
WIDTHS = (
    "repeatability, sensor, bench, all: half of the 95 % interval of one trial, by part and by all"
    " of them; range: half of the range over amplitudes and parts of the band; each the median"
    " over n trials; `bench` has friction's shape; of K_s the drift and where loading begins. mean"
    " of n: half of the 95 % interval of their mean, with the scatter between trials, or with their"
    " own errors where these are larger"
)


Cells = list[str | PrintedNumber]  # a row of a table for a paper


@dataclass(frozen=True)
class Condition:
    """K, B and I of one condition, or of one group of crossings."""

    stated: Mapping[str, str]  # cells of the sheet in which its trials agree, by column
    trials: Sequence[str]  # names of its trials; none for a group
    n: int  # number of trials or perturbations that count
    is_doubtful: bool  # whether its only trial is doubtful, or all of several
    results: Sequence[str]  # titles of properties of the device, as friction
    estimates: Mapping[str, PrintedNumber]  # with their intervals, by symbol
    # over amplitudes and parts of the band, by symbol
    ranges: Mapping[str, str] = field(default_factory=dict)
    wide: Sequence[str] = ()  # symbols of estimates whose intervals are wider than needed

    @property
    def verdict(self) -> str:
        """The verdict in one word."""
        if self.is_doubtful:
            return DOUBTFUL
        return WIDE if self.wide else CLEAR


def conditions(impedance: pl.DataFrame) -> list[Condition]:
    """K, B and I of each condition: of its only trial, or the mean of its sound trials.

    Parameters
    ----------
    impedance : polars.DataFrame
        `impedance.csv`, with the findings on its rows (`judge.joining.joined`).
    """
    whole = impedance.filter(pl.col("amplitude_deg").is_null())
    whole = whole.with_columns(OWN_CONDITION)
    present = [name for name in CONDITION_KEYS if name in whole.columns]
    keys = [name for name in present if whole[name].n_unique() > 1]
    if not keys:  # one condition, named by the cells of its row that are filled
        keys = [name for name in present if whole[name][0] not in (None, "")]
    symbols = [name for name in HEADS if whole[name].count()]
    parts = whole.sort(keys).partition_by(keys) if keys else [whole]
    summaries = []
    for fits in parts:
        first = fits.row(0, named=True)
        used = fits if len(fits) == 1 else counted(fits)
        results = dict.fromkeys(chain.from_iterable(used[RESULTS]))
        n_sound = []
        estimates = {}
        ranges = {}
        for symbol in symbols:
            sound = counted(fits, [symbol])
            n_sound.append(len(sound))
            # a single trial is shown also where it is doubtful
            rows = fits if len(fits) == 1 else sound
            estimates[symbol] = mean_of_row(summary_row(rows, symbol), symbol)
            ranges[symbol] = range_text(rows, symbol)
        summaries.append(
            Condition(
                stated={key: sheet_text(first[key]) for key in keys},
                trials=fits["trial"].to_list(),
                n=max(n_sound),
                is_doubtful=0 in n_sound,
                results=[known_finding(source).title for source in results],
                estimates=estimates,
                ranges=ranges,
                wide=first[WIDE_ESTIMATES] if len(fits) == 1 else (),
            )
        )
    return summaries


def range_text(fits: pl.DataFrame, symbol: str) -> str:
    """The range of an estimate over amplitudes and parts of the band, in all of these fits.

    It is rounded by its own width, and empty where no fit has one.
    """
    ends = [f"{symbol}_range_low", f"{symbol}_range_high"]
    if not {*ends} <= {*fits.columns}:
        return ""
    low, high = fits.select(pl.min(ends[0]), pl.max(ends[1])).row(0)
    if low is None:
        return ""
    return " to ".join(to_places(decimal_places(low, low, high), low, high))


def sheet_text(cell: object) -> str:
    """A cell of the sheet as text."""
    if cell in (None, ""):
        return NOTHING
    return f"{cell:g}" if isinstance(cell, float) else str(cell)


def mean_of_row(row: Mapping[str, Any], symbol: str = "") -> PrintedNumber:
    """A mean over trials or crossings with its 95 % interval."""
    if symbol == "VAF" and row["mean"] is not None:  # a share of 100 %: no interval is printed
        text = f"{min(row['mean'], LARGEST_VAF):.2f}"
        return PrintedNumber(text, text)
    return printed_number(row["mean"], row["low"], row["high"])


def groups(summary: pl.DataFrame) -> Iterator[Condition]:
    """K, B and I of each group of crossings, by the fit to the mean response.

    The response is that minus the mean unperturbed gait, and that minus predicted gait. † marks a
    doubtful estimate. `summary` is `walking_summary.csv` with the findings on its groups.
    """
    for (group,), group_rows in summary.group_by("group", maintain_order=True):
        for estimator, subtracted in SUBTRACTED.items():
            rows = group_rows.filter(estimator=estimator).to_dicts()
            estimates = {}
            doubtful = []
            wide: list[str] = []
            for row in rows:
                quantity = row["quantity"]
                number = mean_of_row(row, quantity)
                is_doubtful = bool(doubts_about(row[GROUP_DOUBTS], [quantity]))
                doubtful.append(is_doubtful)
                if is_doubtful:
                    number = PrintedNumber(f"{number.text}†", f"{number.short}†")
                elif budget_name(quantity, row["estimator"]) in row[WIDE_ESTIMATES]:
                    wide.append(quantity)
                estimates[quantity] = number
            if rows:
                yield Condition(
                    stated={
                        "group": "walking" if group == "all" else f"walking, {group}",
                        "minus": subtracted,
                    },
                    trials=(),
                    n=rows[0]["n"],
                    is_doubtful=any(doubtful),
                    results=[],
                    estimates=estimates,
                    wide=wide,
                )


def condition_rows(conditions_or_groups: Sequence[Condition]) -> list[Cells]:
    """The table of conditions or of groups, with the number of trials that count.

    † marks a doubtful one. Without a trial that counts it has no numbers.
    """
    first = conditions_or_groups[0]
    heads = [*(first.stated or ["condition"]), "n", *(HEADS[name] for name in first.estimates)]
    rows: list[Cells] = [heads]
    for condition in conditions_or_groups:
        *labels, last = condition.stated.values() or [NOTHING]
        marked = [*labels, f"{last}†" if condition.is_doubtful else last]
        numbers: Cells = [*condition.estimates.values()]
        if not condition.n:
            numbers = [NOTHING] * len(numbers)
        rows.append([*marked, str(condition.n), *numbers])
    return rows


def interval_rows(
    budget: pl.DataFrame, impedance: pl.DataFrame, means: Sequence[pl.DataFrame]
) -> list[Cells]:
    """The parts of the intervals of K, B and I by controller, and of the components.

    A row has the half-widths of one trial, by part and of all parts, and half of the range over its
    motion, each the median over n trials. Components also have the half-width of the mean over
    trials, from their summaries `means`.
    """
    # the last row of a trial is that of the fit to the whole trial
    fits = {row["trial"]: row for row in impedance.to_dicts()}
    half_of_mean = {
        row["quantity"]: (row["high"] - row["low"]) / 2
        for summary in means
        for row in summary.drop_nulls("low").to_dicts()
    }
    title_of = {component.quantity: component.head for component in COMPONENTS}
    title_of.update(HEADS)
    widths_of: dict[tuple[str, str], list[list[float]]] = {}
    whole = budget.filter(pl.col("amplitude_deg").is_null(), pl.col("estimate").is_in(title_of))
    for (trial, name), rows in whole.group_by("trial", "estimate", maintain_order=True):
        (budget_of_trial,) = budgets_in(rows.to_dicts(), {str(name): 0.0}).values()
        parts = [budget_of_trial.half_width(part) for part in IN_INTERVAL]
        fit = fits.get(trial, {})
        ends = [fit.get(f"{name}_range_{end}") or 0.0 for end in ("low", "high")]
        widths = [*parts, budget_of_trial.half_width(), (ends[1] - ends[0]) / 2]
        controller = fit.get("controller") or NOTHING
        widths_of.setdefault((controller, str(name)), []).append(widths)
    table: list[Cells] = [
        ["controller", "estimate", "n", *IN_INTERVAL, "all", "range", "mean of n"]
    ]
    for (controller, name), trial_widths in widths_of.items():
        medians = map(median, zip(*trial_widths, strict=True))
        half_width_of_mean = half_of_mean.get(name, 0.0)
        texts = [
            significant(width) if width else NOTHING for width in (*medians, half_width_of_mean)
        ]
        table.append([controller, title_of[name], str(len(trial_widths)), *texts])
    return table


def component_rows(
    summaries: Mapping[str, pl.DataFrame], stated: Mapping[str, float], beside_draft: bool
) -> list[Cells]:
    """The components of the drivetrain (Table I), as means over trials.

    A component without trials is that of the parameter file. If `beside_draft`, the draft's values
    stand beside them.
    """
    cells: dict[str, Cells] = {
        name: [printed_number(value), "stated"] for name, value in stated.items()
    }
    for summary in summaries.values():
        for row in summary.drop_nulls("mean").iter_rows(named=True):
            cells[row["quantity"]] = [mean_of_row(row), str(row["n"])]
    rows: list[Cells] = [["quantity", "mean", "n", "draft"]]
    for component in COMPONENTS:
        if component.quantity in cells:
            rows.append([component.head, *cells[component.quantity], component.draft])
    return rows if beside_draft else [row[:-1] for row in rows]


UNIT_BELOW = r"\\begin{tabular}[t]{@{}l@{}}\1\\\\(\2\\end{tabular}"


def tex_for_paper(rows: Sequence[Cells], origin: str) -> str:
    r"""A `tabular` with rules of booktabs and units of siunitx, to be `\input`."""
    filters = {
        "cell": latex_cell,
        "head": lambda text: re.sub(r"(.+) \((.+)", UNIT_BELOW, latex_cell(text)),
        "signs": lambda line: re.sub(r"(?<!\w)-(?=\d)", "$-$", line),
    }
    table = template("table.tex.j2", filters, keep_trailing_newline=True)
    return table.render(rows=rows, origin=origin)


def latex_cell(cell: str | PrintedNumber) -> str:
    """A cell as LaTeX: a number with half of its interval, a head in its symbols."""
    if isinstance(cell, PrintedNumber):
        return in_latex(cell.short).replace("±", r"$\pm$")
    return IN_LATEX.get(cell) or in_latex(cell)


def markdown_for_paper(rows: Sequence[Cells], origin: str) -> str:
    """The table in Markdown, with the origin of its numbers below."""
    texts = [[str(cell) for cell in row] for row in rows]
    return f"{markdown_table(texts)}\n{in_markdown(origin)}.\n"
