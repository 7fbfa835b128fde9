"""Tables for a paper, in LaTeX and in Markdown: K, B and I of each condition on the bench and of
each group of crossings, and the components of the drivetrain, as in Table I."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import polars as pl

from osl_analysis.report.decimal_places import EVEN, digits_of, fixed
from osl_analysis.report.headline import LABELS
from osl_analysis.report.headline_files import in_latex
from osl_analysis.report.headline_statistics import FOR_MOTION, KIND_OF_FIT, STUDENT
from osl_analysis.report.headline_text import markdown_table
from osl_analysis.report.headlines import HEADLINE_ESTIMATOR
from osl_analysis.stats.repeats import (
    DOUBTFUL,
    IS_DOUBTFUL,
    counted,
    own_condition,
    summary_row,
)


@dataclass(frozen=True)
class Unit:
    """The unit in which a quantity is printed."""

    in_tex: str  # of siunitx
    in_text: str
    scale: float = 1.0  # of a number in SI units, to this unit


@dataclass(frozen=True)
class Symbol:
    """A quantity with its unit, at the head of a column or a row."""

    in_tex: str  # in mathematics
    in_text: str
    unit: Unit

    def tex(self) -> str:
        return f"${self.in_tex}$ / \\unit{{{self.unit.in_tex}}}"

    def markdown(self) -> str:
        return f"{self.in_text} [{self.unit.in_text}]"


STIFFNESS = Unit(r"\newton\meter\per\radian", "N·m/rad")
DAMPING = Unit(r"\newton\meter\second\per\radian", "N·m·s/rad")
INERTIA = Unit(r"\kilogram\meter\squared", "kg·m²")
SMALL_INERTIA = Unit(r"\kilogram\meter\squared", "10⁻³ kg·m²", scale=1e3)
TORQUE = Unit(r"\newton\meter", "N·m")
TORQUE_PER_CURRENT = Unit(r"\newton\meter\per\ampere", "N·m/A")
PERCENT = Unit(r"\percent", "%")

STATED = {
    "K_d": Symbol(r"K_\mathrm{d}", "K_d", unit=STIFFNESS),
    "B_d": Symbol(r"B_\mathrm{d}", "B_d", unit=DAMPING),
}
"""What the controller was asked for, by column of `impedance.csv`."""
ESTIMATED = {
    "K": Symbol("K", "K", unit=STIFFNESS),
    "B": Symbol("B", "B", unit=DAMPING),
    "B_viscous": Symbol(r"B_\mathrm{viscous}", "B_viscous", unit=DAMPING),
    "I": Symbol("I", "I", unit=SMALL_INERTIA),
    "VAF": Symbol(r"\mathrm{VAF}", "VAF", unit=PERCENT),
}
"""What was estimated, by column of `impedance.csv`."""
COMPONENT_SYMBOLS = {
    "belt_summary": {"K_s": Symbol(r"K_\mathrm{s}", "K_s", unit=STIFFNESS)},
    "transmission_summary": {
        "B_j": Symbol(r"B_\mathrm{j}", "B_j", unit=DAMPING),
        "J_j": Symbol(r"J_\mathrm{j}", "J_j", unit=INERTIA),
    },
    "actuator_summary": {
        "k_tau_n_m": Symbol(r"k_\tau n_\mathrm{m}", "k_τ n_m", unit=TORQUE_PER_CURRENT),
        "f_C": Symbol(r"f_\mathrm{C}", "f_C", unit=TORQUE),
        "f_G": Symbol(r"f_\mathrm{G}", "f_G", unit=TORQUE_PER_CURRENT),
        "B_m": Symbol(r"B_\mathrm{m}", "B_m", unit=DAMPING),
        "J_m": Symbol(r"J_\mathrm{m}", "J_m", unit=INERTIA),
    },
}
"""The parameters of Eqs. 1 to 4, by table and its `quantity`."""
DECIMALS_OF_VAF = 2  # with which 99.99 % is not 100 %
DOUBTFUL_SIGN = "†"
NO_NUMBER = "{--}"  # in braces, so that siunitx takes it for text


@dataclass(frozen=True)
class Stated:
    """A value that somebody wrote down, or none."""

    value: float | None

    def written(self) -> str:
        """The value with all of its digits; empty for none."""
        return "" if self.value is None else f"{self.value:g}"

    def interval(self) -> "WrittenInterval | None":
        return None


@dataclass(frozen=True)
class WrittenInterval:
    """An interval with its digits, in both ways of writing it."""

    low: str
    high: str
    half_width: str | None  # None where the interval is not even

    def numbers(self, has_half_width: bool) -> tuple[str, ...]:
        """The half-width alone, or both ends."""
        if has_half_width and self.half_width is not None:
            return (self.half_width,)
        return self.low, self.high


@dataclass(frozen=True)
class Estimated:
    """A value, or none, with the ends of its 95 % interval, if it has one."""

    value: float | None
    low: float | None = None
    high: float | None = None
    decimals: int | None = None  # of a value without an interval; None: three digits

    def written(self) -> str:
        """The value, rounded by its interval; empty for none."""
        if self.value is None:
            return ""
        if self.decimals is not None and self.interval() is None:
            return fixed(self.value, self.decimals)
        return fixed(self.value, digits_of(self.value, self.low, self.high).value)

    def interval(self) -> WrittenInterval | None:
        """The interval as it may be written; None for none."""
        if self.value is None or self.low is None or self.high is None:
            return None
        places = digits_of(self.value, self.low, self.high)
        above = self.high - self.value
        below = self.value - self.low
        is_even = 0 < max(above, below) <= EVEN * min(above, below)
        has_power = "e" in fixed(self.value, places.value)
        half_width = None
        if is_even and not has_power:
            half_width = f"{max(above, below):.{max(places.ends, 0)}f}"
        return WrittenInterval(
            fixed(self.low, places.ends), fixed(self.high, places.ends), half_width
        )


@dataclass(frozen=True)
class Words:
    """A column of words, or of symbols."""

    head: str
    cells: Sequence[str | Symbol]

    def formats(self) -> str:
        return "l"

    def head_tex(self) -> str:
        return f"{{{self.head}}}"

    def unit_tex(self) -> str:
        return ""

    def cells_tex(self) -> list[list[str]]:
        texts = []
        for cell in self.cells:
            if isinstance(cell, Symbol):
                texts.append(cell.tex())
            else:
                texts.append(in_latex(cell).replace(DOUBTFUL_SIGN, r"$^\dagger$"))
        return [texts]

    def markdown(self) -> list[str]:
        cells = [cell.markdown() if isinstance(cell, Symbol) else cell for cell in self.cells]
        return [self.head, *cells]


@dataclass(frozen=True)
class Numbers:
    """A column of numbers; in LaTeX two, so that the decimal points of the values are aligned."""

    head: str | Symbol
    cells: Sequence[Stated | Estimated]

    def has_intervals(self) -> bool:
        return any(cell.interval() for cell in self.cells)

    def intervals(self) -> list[tuple[str, ...]]:
        """The numbers of each cell's interval, empty for none: half-widths if all intervals of the
        column are even, else ends."""
        written = [cell.interval() for cell in self.cells]
        are_even = all(interval is None or interval.half_width for interval in written)
        return [() if interval is None else interval.numbers(are_even) for interval in written]

    def values(self) -> list[str]:
        return [cell.written() or NO_NUMBER for cell in self.cells]

    def formats(self) -> str:
        of_values = f"S[table-format={table_format(self.values())}]"
        return rf"{of_values} @{{\ }}l" if self.has_intervals() else of_values

    def head_tex(self) -> str:
        head = f"${self.head.in_tex}$" if isinstance(self.head, Symbol) else self.head
        return self.over_columns(head)

    def unit_tex(self) -> str:
        """The unit, as it stands below the head. What was asked for has the units of what was
        estimated."""
        is_estimate = any(isinstance(cell, Estimated) for cell in self.cells)
        if not isinstance(self.head, Symbol) or not is_estimate:
            return self.over_columns("")
        unit = rf"\unit{{{self.head.unit.in_tex}}}"
        if self.head.unit.scale != 1:
            power = -round(math.log10(self.head.unit.scale))
            unit = rf"\num{{e{power}}} {unit}"
        return self.over_columns(f"({unit})")

    def over_columns(self, text: str) -> str:
        """A text above the column of values and that of intervals."""
        return rf"\multicolumn{{2}}{{c}}{{{text}}}" if self.has_intervals() else f"{{{text}}}"

    def cells_tex(self) -> list[list[str]]:
        if not self.has_intervals():
            return [self.values()]
        intervals = []
        for written in self.intervals():
            numbers = [rf"\num{{{number}}}" for number in written]
            intervals.append(rf"$\pm$ {numbers[0]}" if len(numbers) == 1 else in_brackets(numbers))
        return [self.values(), intervals]

    def markdown(self) -> list[str]:
        texts = [self.head.markdown() if isinstance(self.head, Symbol) else self.head]
        for cell, numbers in zip(self.cells, self.intervals(), strict=True):
            interval = f"± {numbers[0]}" if len(numbers) == 1 else in_brackets(numbers)
            texts.append(f"{cell.written() or '–'} {interval}".rstrip())
        return texts


def in_brackets(ends: Sequence[str]) -> str:
    """The ends of an interval; empty for none."""
    return f"[{', '.join(ends)}]" if ends else ""


@dataclass(frozen=True)
class PaperTable:
    """A table, and what is said below it.

    Attributes
    ----------
    columns
        From left to right.
    notes
        Sentences for its caption.
    parts
        Words that many rows below one another share, as a column of the Markdown and as a line
        above these rows in LaTeX, where a page has no room for them; None: there are none.
    """

    columns: Sequence[Words | Numbers]
    notes: Sequence[str]
    parts: Words | None = None

    def to_tex(self, origin: str) -> str:
        r"""The table as a `tabular` of booktabs and siunitx (version 3), to be `\input`."""
        formats = " ".join(column.formats() for column in self.columns)
        heads = [" & ".join(column.head_tex() for column in self.columns)]
        units = [column.unit_tex() for column in self.columns]
        if any(r"\unit" in unit for unit in units):
            heads.append(" & ".join(units))
        lines = [
            f"% {origin}",
            r"% \usepackage{booktabs, siunitx}; \input this file in a table environment (table* in",
            r"% two columns), with a caption that says:",
            *(f"% {note}" for note in self.notes),
            r"\begingroup\footnotesize\setlength{\tabcolsep}{2pt}\sisetup{per-mode=symbol}%",
            rf"\begin{{tabular}}{{{formats}}}",
            r"\toprule",
            *(rf"{head} \\" for head in heads),
            r"\midrule",
            *(rf"{row} \\" for row in self.rows_tex()),
            r"\bottomrule",
            r"\end{tabular}\endgroup",
        ]
        return "\n".join(lines) + "\n"

    def rows_tex(self) -> list[str]:
        """The rows in LaTeX, with a line above those of each part."""
        cells = [texts for column in self.columns for texts in column.cells_tex()]
        rows = [" & ".join(row) for row in zip(*cells, strict=True)]
        if self.parts is None:
            return rows
        lines: list[str] = []
        last = ""
        (part_of_rows,) = self.parts.cells_tex()  # words fill one column
        for part, row in zip(part_of_rows, rows, strict=True):
            if part != last:
                lines.append(rf"\multicolumn{{{len(cells)}}}{{l}}{{\itshape {part}}}")
            lines.append(row)
            last = part
        return lines

    def to_markdown(self, origin: str) -> str:
        """The table in Markdown, with a number and its interval in one cell."""
        columns = [*filter(None, [self.parts]), *self.columns]
        rows = zip(*(column.markdown() for column in columns), strict=True)
        below = "".join(f"\n{note}\n" for note in (*self.notes, f"{origin}."))
        return markdown_table(list(rows)) + below


def table_format(values: Sequence[str]) -> str:
    """The `table-format` of siunitx that holds these numbers: digits before and behind the point,
    a sign and a power of ten where one has them."""
    sign = ""
    digits_before = 1
    digits_behind = 0
    digits_of_power = 0
    for value in values:
        if value == NO_NUMBER:
            continue
        if value.startswith("-"):
            sign = "-"
        mantissa, _, exponent = value.removeprefix("-").partition("e")
        whole, _, decimals = mantissa.partition(".")
        digits_before = max(digits_before, len(whole))
        digits_behind = max(digits_behind, len(decimals))
        digits_of_power = max(digits_of_power, len(exponent.lstrip("+-0")))
    power = f"e-{digits_of_power}" if digits_of_power else ""
    return f"{sign}{digits_before}.{digits_behind}{power}"


def conditions_table(impedance: pl.DataFrame) -> PaperTable:
    """K, B and I of each condition, over all amplitudes.

    Trials of one condition (joint, side, motion, controller, K_d and B_d) count as their mean. A
    trial without a stated K_d has a row of its own.

    Parameters
    ----------
    impedance
        `impedance.csv` with its evidence.
    """
    whole = impedance.filter(pl.col("amplitude_deg").is_null())
    whole = whole.with_columns(own_condition=own_condition(whole))
    keys = [name for name in ("joint", "side", "excitation") if has_several(whole, name)]
    keys += [name for name in ("controller", *STATED) if has_any(whole, name)]
    groups = whole.partition_by([*keys, "own_condition"], maintain_order=True)
    groups = [groups[place] for place in order_of(groups, keys)]
    used = [counted(rows) for rows in groups]

    columns: list[Words | Numbers] = []
    parts = None
    if (whole["own_condition"] != "").any():
        columns.append(Words("trial", [rows["own_condition"][0] for rows in groups]))
    for name in keys:
        stated = [rows[name][0] for rows in groups]
        if name in STATED:
            columns.append(Numbers(STATED[name], [Stated(value) for value in stated]))
        elif name == "controller":
            parts = Words(name, [value or "–" for value in stated])
        else:
            columns.append(Words(name, [value or "–" for value in stated]))
    columns.append(Words("n", [f"{len(rows)}{doubtful_sign(rows)}" for rows in used]))
    for name, symbol in ESTIMATED.items():
        if has_any(whole, name):
            estimates = [estimate_of(rows, name, symbol.unit.scale) for rows in used]
            columns.append(Numbers(symbol, estimates))

    notes = [f"n: trials. Intervals, ± or in brackets: {', '.join(interval_kinds(used))}."]
    if any(map(doubtful_sign, used)):
        notes.append(f"{DOUBTFUL_SIGN}: with a doubtful fit.")
    return PaperTable(columns, notes, parts)


def order_of(groups: Sequence[pl.DataFrame], keys: Sequence[str]) -> list[int]:
    """The places of conditions in their order: by K_d and B_d upwards, within the order of the
    others as they come, of which the controller is the last."""
    firsts = [rows.row(0, named=True) for rows in groups]
    others = [name for name in keys if name not in STATED]
    seen = list(dict.fromkeys(tuple(row[name] for name in others) for row in firsts))

    def rank(place: int) -> tuple[float, ...]:
        row = firsts[place]
        desired = [row[name] for name in STATED if name in keys]
        first_seen = seen.index(tuple(row[name] for name in others))
        return (first_seen, *(math.inf if value is None else value for value in desired))

    return sorted(range(len(groups)), key=rank)


def interval_kinds(used: Sequence[pl.DataFrame]) -> list[str]:
    """What the intervals of these rows of the table are."""
    kinds = []
    for rows in used:
        kind = STUDENT
        if len(rows) == 1:
            method = rows.row(0, named=True).get("interval_method") or ""
            kind = KIND_OF_FIT.get(method, FOR_MOTION)
        kinds.append(kind)
    return list(dict.fromkeys(kinds))


def has_any(table: pl.DataFrame, name: str) -> bool:
    """Whether some row has a value in a column."""
    return name in table.columns and table[name].count() > 0


def has_several(table: pl.DataFrame, name: str) -> bool:
    """Whether rows have different values in a column."""
    return name in table.columns and table[name].n_unique() > 1


def doubtful_sign(rows: pl.DataFrame) -> str:
    """The sign behind a row of the table, if one of these fits is doubtful."""
    is_doubtful = DOUBTFUL in rows.columns and rows.select(IS_DOUBTFUL.any()).item()
    return DOUBTFUL_SIGN if is_doubtful else ""


def estimate_of(used: pl.DataFrame, name: str, scale: float) -> Estimated:
    """A quantity of one condition: that of its trial, or the mean of several; times a `scale`."""
    if len(used) > 1:
        return mean_of(summary_row(used, name), scale)
    row = used.row(0, named=True)
    estimate = scaled((row[name], row.get(f"{name}_low"), row.get(f"{name}_high")), scale)
    return replace(estimate, decimals=DECIMALS_OF_VAF) if name == "VAF" else estimate


def mean_of(row: Mapping[str, Any], scale: float = 1.0) -> Estimated:
    """The mean of a row of a summary, times a `scale`."""
    return scaled((row["mean"], row["low"], row["high"]), scale)


def scaled(numbers: Sequence[float | None], scale: float) -> Estimated:
    """A value and the ends of its interval, times a `scale`."""
    value, low, high = (None if number is None else scale * number for number in numbers)
    return Estimated(value, low, high)


def walking_table(summary: pl.DataFrame) -> PaperTable:
    """K, B and I under each group of crossings, of all perturbations together.

    Parameters
    ----------
    summary
        `walking_summary.csv`.
    """
    rows = summary.filter(pl.col("estimator") == HEADLINE_ESTIMATOR, pl.col("mean").is_not_null())
    groups = rows.partition_by("group", maintain_order=True)
    columns: list[Words | Numbers] = [Words("group", [of_group["group"][0] for of_group in groups])]
    for name in ("joint", "side"):
        if has_several(rows, name):
            columns.append(Words(name, [of_group[name][0] or "–" for of_group in groups]))
    signs = [doubtful_sign_of_group(of_group) for of_group in groups]
    columns.append(
        Words(
            "n", [f"{of_group['n'][0]}{sign}" for of_group, sign in zip(groups, signs, strict=True)]
        )
    )
    for name, symbol in ESTIMATED.items():
        if name not in rows["quantity"]:
            continue
        estimates = []
        for of_group in groups:
            of_quantity = of_group.filter(quantity=name).to_dicts()
            estimates.append(
                mean_of(of_quantity[0], symbol.unit.scale) if of_quantity else Estimated(None)
            )
        columns.append(Numbers(symbol, estimates))

    notes = ["n: perturbations, fitted together. Intervals, ± or in brackets: 95 % (bootstrap)."]
    if any(signs):
        notes.append(f"{DOUBTFUL_SIGN}: doubtful.")
    return PaperTable(columns, notes)


def doubtful_sign_of_group(rows: pl.DataFrame) -> str:
    """The sign behind a group of which some estimate is doubtful."""
    has_doubt = "doubt" in rows.columns and (rows["doubt"].fill_null("") != "").any()
    return DOUBTFUL_SIGN if has_doubt else ""


def components_table(summaries: Mapping[str, pl.DataFrame], beside_draft: bool) -> PaperTable:
    """The measured components of the drivetrain (Eqs. 1 to 4), as means over trials.

    Parameters
    ----------
    summaries
        `belt_summary`, `transmission_summary` and `actuator_summary`, as far as there are any.
    beside_draft
        Whether the values that the paper's draft prints stand beside them.
    """
    symbols: list[Symbol] = []
    measured: list[dict[str, Any]] = []
    printed: list[float | None] = []
    for table, quantities in COMPONENT_SYMBOLS.items():
        if table not in summaries:
            continue
        for quantity, symbol in quantities.items():
            for row in summaries[table].filter(quantity=quantity).to_dicts():
                symbols.append(symbol)
                measured.append(row)
                printed.append(LABELS[table][quantity].draft)

    columns: list[Words | Numbers] = [Words("parameter", symbols)]
    for name in ("joint", "side"):
        places = [row.get(name) for row in measured]
        if len(set(places)) > 1:
            columns.append(Words(name, [place or "–" for place in places]))
    columns.append(Numbers("value", [mean_of(row) for row in measured]))
    columns.append(Words("n", [str(row["n"]) for row in measured]))
    if beside_draft:
        columns.append(Numbers("draft", [Stated(value) for value in printed]))
    return PaperTable(columns, ["n: trials. Intervals, ± or in brackets: 95 % of the mean."])
