# SPDX-License-Identifier: Apache-2.0
"""Rows of tables for the page and for a paper.

They have K, B and I of each condition and of each group of crossings, the parts of their intervals,
and the components of the drivetrain (Table I).

Example: `tex_for_paper(condition_rows(conditions(impedance)), "Simulated data")`.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from statistics import median
from typing import Any

import polars as pl

from osl_analysis.base.files import package_yaml
from osl_analysis.judge.joining import GROUP_DOUBTS, RESULTS, WIDE_ESTIMATES
from osl_analysis.judge.known_findings import known_finding
from osl_analysis.report.typography import in_latex, in_markdown, markdown_table, template
from osl_analysis.report.verdicts import DOUBTFUL
from osl_analysis.stats.budget import CLEAR, IN_INTERVAL, QUANTITIES, WIDE, budgets_in
from osl_analysis.stats.doubts import DOUBTS, counted, doubts_about
from osl_analysis.stats.promises import BETWEEN_TRIALS, RANGE_PROMISE, promise_texts
from osl_analysis.stats.repeats import OWN_CONDITION, summary_row
from osl_analysis.stats.rounding import (
    NOTHING,
    PrintedNumber,
    PrintedRange,
    printed_number,
    printed_range,
    significant,
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
IN_LATEX: Mapping[str, str] = package_yaml(Path(__file__).with_suffix(".yaml"))
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
INTERVAL_METHOD = "interval_method"
SUBTRACTED = {ENSEMBLE: "mean unperturbed gait", PREDICTED: "predicted gait"}
"""What each estimator of a group subtracts from the perturbed crossings."""
DAGGER = (
    "†: doubtful. Numbers are of the trials that are not doubtful; a condition whose trials are all"
    " doubtful has none"
)
DAGGER_OF_GROUPS = "†: doubtful. A number is of all crossings of its group"
HALF_WIDTH = "±: half of the 95 % interval"
ROUNDED_UP = (
    "where the range is wider, it decides on the digits, and ± is rounded up to the last one"
)
HALF_WIDTH_OF_MEAN = f"{HALF_WIDTH} of the mean over n trials"
WIDTHS = (
    "repeatability, sensor, bench, all: half of the 95 % interval of one trial, by part and by all"
    " of them; range: half of the range over amplitudes and parts of the band; each the median"
    " over n trials; bench has friction's shape, and of a belt the drift and where loading begins."
    " mean"
    " of n: half of the 95 % interval of their mean, with the scatter between trials, or with their"
    " own errors where these are larger"
)


Cell = str | PrintedNumber | PrintedRange
Cells = list[Cell]  # a row of a table for a paper


@dataclass(frozen=True)
class LeftOut:
    """A trial that is not in the mean of its condition."""

    trial: str
    estimates: Sequence[str]  # K, B, I that it is left out of
    causes: Sequence[str]  # titles of the findings that doubt them

    def __str__(self) -> str:
        of_some = ""
        if len(self.estimates) < len(QUANTITIES):
            of_some = f" from {', '.join(self.estimates)}"
        return f"{self.trial}{of_some} ({', '.join(self.causes)})"


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
    ranges: Mapping[str, PrintedRange] = field(default_factory=dict)
    wide: Sequence[str] = ()  # symbols of estimates whose intervals are wider than needed
    interval_method: str | None = None  # a key of `stats.promises.PROMISES`
    left_out: Sequence[LeftOut] = ()  # of several trials those that are doubtful

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
        method = (used if len(used) else fits).row(0, named=True).get(INTERVAL_METHOD)
        n_sound = []
        estimates = {}
        ranges = {}
        for symbol in symbols:
            sound = counted(fits, [symbol])
            n_sound.append(len(sound))
            # a single trial is shown also where it is doubtful
            rows = fits if len(fits) == 1 else sound
            mean = summary_row(rows, symbol)
            ends = range_of(rows, symbol)
            half_range = 0.0
            if ends is not None and mean["mean"] is not None:
                half_range = (ends[1] - ends[0]) / 2
                ranges[symbol] = printed_range(*ends, mean["mean"])
            estimates[symbol] = mean_of_row(mean, symbol, half_range)
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
                interval_method=BETWEEN_TRIALS if max(n_sound) > 1 else method,
                left_out=left_out_of_mean(fits) if len(fits) > 1 else (),
            )
        )
    return summaries


def left_out_of_mean(fits: pl.DataFrame) -> list[LeftOut]:
    """The trials of a condition that are not in its mean, with the causes of their doubts."""
    left_out = []
    for row in fits.to_dicts():
        doubts_of = {symbol: doubts_about(row.get(DOUBTS), [symbol]) for symbol in QUANTITIES}
        doubted = [symbol for symbol, doubts in doubts_of.items() if doubts]
        sources = dict.fromkeys(
            doubt["source"] for doubt in chain.from_iterable(doubts_of.values())
        )
        if doubted:
            causes = [known_finding(source).title for source in sources]
            left_out.append(LeftOut(row["trial"], doubted, causes))
    return left_out


def range_of(fits: pl.DataFrame, symbol: str) -> tuple[float, float] | None:
    """The range of an estimate over amplitudes and parts of the band, in all of these fits."""
    ends = [f"{symbol}_range_low", f"{symbol}_range_high"]
    if not {*ends} <= {*fits.columns}:
        return None
    low, high = fits.select(pl.min(ends[0]), pl.max(ends[1])).row(0)
    return None if low is None else (low, high)


def sheet_text(cell: object) -> str:
    """A cell of the sheet as text."""
    if cell in (None, ""):
        return NOTHING
    return f"{cell:g}" if isinstance(cell, float) else str(cell)


def mean_of_row(row: Mapping[str, Any], symbol: str = "", half_range: float = 0.0) -> PrintedNumber:
    """A mean over trials or crossings with its 95 % interval."""
    if symbol == "VAF" and row["mean"] is not None:  # a share of 100 %: no interval is printed
        return PrintedNumber(f"{min(row['mean'], LARGEST_VAF):.2f}")
    return printed_number(row["mean"], row["low"], row["high"], half_range=half_range)


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
                    number = replace(number, mark="†")
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
    """The table of conditions or of groups, with the number of trials that count, and a range
    beside K, B and I; that of B without friction would make it wider than a page. † marks a
    doubtful one; where none counts there are no numbers. Where intervals are of several methods,
    a row names its own."""
    first = conditions_or_groups[0]
    heads: Cells = [*(first.stated or ["condition"]), "n"]
    methods = {condition.interval_method for condition in conditions_or_groups}
    if len(methods) > 1:
        heads.append("interval")
    ranged = [
        name for name in QUANTITIES if any(name in each.ranges for each in conditions_or_groups)
    ]
    for name in first.estimates:
        heads.append(HEADS[name])
        if name in ranged:
            heads.append(f"{name} range")
    rows = [heads]
    for condition in conditions_or_groups:
        *labels, last = condition.stated.values() or [NOTHING]
        row: Cells = [*labels, f"{last}†" if condition.is_doubtful else last, str(condition.n)]
        if len(methods) > 1:
            row.append(condition.interval_method or NOTHING)
        for name, number in condition.estimates.items():
            row.append(number if condition.n else NOTHING)
            if name in ranged:
                row.append(condition.ranges.get(name, NOTHING) if condition.n else NOTHING)
        rows.append(row)
    return rows


def notes_on_conditions(of_conditions: Sequence[Condition]) -> list[str]:
    """What ±, range and † mean in the table of conditions, and which trials are in no mean and
    why, a sentence each."""
    promises = promise_texts(condition.interval_method for condition in of_conditions)
    notes = [f"±: half of the 95 % interval. {'. '.join(promises)}" if promises else HALF_WIDTH]
    if any(condition.ranges for condition in of_conditions):
        notes.append(f"range: {RANGE_PROMISE}; {ROUNDED_UP}")
    if any(condition.is_doubtful for condition in of_conditions):
        notes.append(DAGGER)
    left_out = [str(trial) for condition in of_conditions for trial in condition.left_out]
    if left_out:
        notes.append(f"in no mean: {'; '.join(left_out)}")
    return notes


def notes_on_groups(of_groups: Sequence[Condition]) -> list[str]:
    """What ± and † mean in the table of groups of crossings, a sentence each."""
    notes = [f"{HALF_WIDTH} of the fit to the mean response of n perturbed crossings"]
    if any(group.is_doubtful for group in of_groups):
        notes.append(DAGGER_OF_GROUPS)
    return notes


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


UNIT_BELOW = r"\\begin{tabular}[t]{@{}c@{}}\1\\\\(\2\\end{tabular}"
NUMBER_IN_TEXT = re.compile(r"(-?\d+(?:\.\d+)?)(†)?")


@dataclass(frozen=True)
class LatexColumn:
    """A column of a table for a paper as columns of `tabular`, numbers aligned on the point."""

    columns: str  # their types
    head: str
    cells: Sequence[str]


def tex_for_paper(rows: Sequence[Cells], origin: str, notes: Sequence[str] = ()) -> str:
    r"""A `tabular` with rules of booktabs and units of siunitx, to be `\input`, and below it the
    notes that say what its signs mean."""
    heads, *body = rows
    columns = [
        latex_column(str(head), cells)
        for head, cells in zip(heads, zip(*body, strict=True), strict=True)
    ]
    lines = [" & ".join(cells) for cells in zip(*(each.cells for each in columns), strict=True)]
    return template("table.tex.j2", keep_trailing_newline=True).render(
        origin=origin,
        columns="".join(each.columns for each in columns),
        head=" & ".join(each.head for each in columns),
        lines=lines,
        notes=[in_latex(note) for note in notes],
    )


def latex_column(head: str, cells: Sequence[Cell]) -> LatexColumn:
    """A column by what it holds: numbers with half-widths, ranges, numbers, or text."""
    head = re.sub(r"(.+) \((.+)", UNIT_BELOW, latex_text(head))
    if any(isinstance(cell, PrintedRange) for cell in cells):
        ends = [(cell.low, cell.high) if isinstance(cell, PrintedRange) else None for cell in cells]
        return column_of_pairs(head, ends, cells, "to", r"\,")
    half_widths = [half_width_pair(cell) for cell in cells]
    if any(half_widths):
        return column_of_pairs(head, half_widths, cells, r"$\pm$", r"\,")
    numbers = [NUMBER_IN_TEXT.fullmatch(str(cell)) for cell in cells]
    if not any(numbers):
        return LatexColumn("l", head, [latex_text(str(cell)) for cell in cells])
    texts = [
        number[1] + (f"{{{in_latex(number[2])}}}" if number[2] else "")
        if number
        else f"{{{latex_text(str(cell))}}}"
        for number, cell in zip(numbers, cells, strict=True)
    ]
    decimals = decimal_column([number[1] for number in numbers if number])
    return LatexColumn(decimals, f"{{{head}}}", texts)


def half_width_pair(cell: Cell) -> tuple[str, str] | None:
    """A number and half of its interval; None without one."""
    if isinstance(cell, PrintedNumber) and cell.half_width:
        return cell.value, cell.half_width
    return None


def column_of_pairs(
    head: str, pairs: Sequence[tuple[str, str] | None], cells: Sequence[Cell], sign: str, space: str
) -> LatexColumn:
    """A column of two numbers with a sign between them; a cell without a pair stands over all."""
    left = decimal_column([pair[0] for pair in pairs if pair])
    right = decimal_column([pair[1] for pair in pairs if pair])
    texts = []
    for pair, cell in zip(pairs, cells, strict=True):
        if pair is None:
            text = in_latex(cell.short if isinstance(cell, PrintedNumber) else str(cell))
            texts.append(rf"\multicolumn{{3}}{{c}}{{{negative(text)}}}")
            continue
        mark = f"{{{cell.mark}}}" if isinstance(cell, PrintedNumber) and cell.mark else ""
        texts.append(f"{pair[0]} & {sign} & {pair[1]}{mark}")
    types = f"{left}@{{{space}}}c@{{{space}}}{right}"
    return LatexColumn(types, rf"\multicolumn{{3}}{{c}}{{{head}}}", texts)


def decimal_column(numbers: Sequence[str]) -> str:
    """A column of siunitx that is as wide as its numbers."""
    sign = "-" if any(number.startswith("-") for number in numbers) else ""
    whole, _, decimals = zip(
        *(number.lstrip("-").partition(".") for number in numbers), strict=True
    )
    digits = f"{max(map(len, whole))}.{max(map(len, decimals))}"
    return f"S[table-format={sign}{digits}]"


def latex_text(text: str) -> str:
    """A text as LaTeX, a head in its symbols."""
    return IN_LATEX.get(text) or negative(in_latex(text))


def negative(text: str) -> str:
    """A text with a minus sign before its negative numbers."""
    return re.sub(r"(?<!\w)-(?=\d)", "$-$", text)


def markdown_for_paper(rows: Sequence[Cells], origin: str, notes: Sequence[str] = ()) -> str:
    """The table in Markdown, what its signs mean, and what it is made of."""
    texts = [[str(cell) for cell in row] for row in rows]
    below = "".join(f"{in_markdown(note)}.\n\n" for note in notes)
    return f"{markdown_table(texts)}\n{below}{in_markdown(origin)}.\n"
