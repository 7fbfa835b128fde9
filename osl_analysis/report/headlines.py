"""Headline numbers of a campaign, computed from its result tables, each with label and interval;
and their output as JSON, as LaTeX macros and as tables."""

import json
import math
import re
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import chain, count, product
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.campaign.origin import ABOUT_MACROS, ABOUT_MEANING, sentence
from osl_analysis.errors import InputError
from osl_analysis.judge.causes import doubts_of_result
from osl_analysis.judge.exclusions import exclusion_said
from osl_analysis.judge.words import printed
from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.stats.repeats import (
    DOUBTFUL,
    RULE_OF_MEANS,
    counted,
    doubtful_count,
    doubts_of_trials,
    repeating_trials,
)
from osl_analysis.table import held_against_desired
from osl_analysis.trial import Array
from osl_analysis.yaml_settings import read_mapping

DRAFT_JOINT = "ankle"  # the joint whose numbers the draft prints
# largest number of conditions, or of trials without a stated one, that the summary lists one by one
MOST_UNSTATED = 8


@dataclass(frozen=True)
class Headline:
    """A number with its label; in `LABELS` only the label."""

    name: str  # its key in the summary
    unit: str
    draft: float | None  # the value that the paper's draft prints; None if it prints none
    macro: str  # its LaTeX macro without the prefix, letters only
    meaning: str
    value: float = math.nan  # in `unit`
    low: float | None = None
    high: float | None = None
    interval: str | None = None  # kind of the interval; None if there is none
    n: int = 0  # number of trials or fits behind the number
    sd: float | None = None  # standard deviation between the trials; None if unknown
    n_doubtful: int = 0  # number of doubtful trials or fits among the candidates
    n_left_out: int = 0  # number of doubtful ones that are left out
    doubt: str | None = None  # why the number itself is doubtful; None if it is not, or not judged
    # verdict on the paper's claim about this number; None without a claim
    verdict: str | None = None
    # lowest result of the fits to single amplitudes; None if there are none
    amplitudes_low: float | None = None
    # highest result of the fits to single amplitudes; None if there are none
    amplitudes_high: float | None = None
    of: str = ""  # controller, group or joint, with which `meaning` ends; empty: all
    begins: str = ""  # begin of the page's first sentence with this number; empty: there is none
    # whether it stands in `numbers.tex` alone, as one of many conditions, which are in a table
    is_macro_only: bool = False


@dataclass(frozen=True)
class Example:
    """The desired impedance of Fig. 4, whose estimates are headline numbers; by default that of the
    draft."""

    K_d: float | None = 300.0  # desired stiffness [N*m/rad]; None: not stated
    B_d: float | None = 5.0  # desired damping [N*m*s/rad]; None: not stated
    chosen: str = ""  # why this one, if the configuration does not name it

    def meaning(self) -> str:
        stated = [
            f"{name} = {value:g}"
            for name, value in (("K_d", self.K_d), ("B_d", self.B_d))
            if value is not None
        ]
        if not stated:
            return "as measured"
        words = f"for {', '.join(stated)}"
        return f"{words} (that of {self.chosen})" if self.chosen else words


ENTRIES: dict[str, Any] = read_mapping(Path(__file__).with_suffix(".yaml"))
LABELS = {
    table: {name: Headline(**one) for name, one in labels.items()}
    for table, labels in ENTRIES.items()
}
"""The labels by table and quantity, in the order of the summary."""


def with_controller(
    label: Headline, controller: str | None, example: Example, alone: bool = False
) -> Headline:
    """The label of one controller, which is not named if no trial states one (`alone`)."""
    known, meaning = controller or "no controller", label.meaning.format(example=example.meaning())
    name, macro = f"{label.name}_{known.replace(' ', '_')}", letters(known)[:32] + label.macro
    of = controller or "controller not stated" * (not alone)
    return replace(
        label, name=name, macro=macro, meaning=", ".join(filter(None, [meaning, of])), of=of
    )


def of_group(number: Headline, group: str) -> Headline:
    """The number with the name of its group, such as of crossings; unchanged if the campaign has
    one group only."""
    if group == "all":
        return number
    named = replace(
        number, name=f"{number.name} ({group})", draft=None, macro=number.macro + letters(group)
    )
    return with_end(named, group)


def with_end(number: Headline, end: str) -> Headline:
    return replace(
        number, meaning=f"{number.meaning}, {end}", of=", ".join(filter(None, [number.of, end]))
    )


def letters(text: str) -> str:
    """Text as Latin letters only, for a macro: `K_d 200, timing 41 %` gives
    `KdTwoZeroZeroTimingFourOne`."""
    plain = unicodedata.normalize("NFKD", text.replace("_", "")).encode("ascii", "ignore").decode()
    digits = ("Zero", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine")
    words = re.findall(r"[A-Za-z]+|[0-9]", plain)
    return (
        "".join(
            digits[int(word)] if word.isdigit() else word[0].upper() + word[1:] for word in words
        )
        or "Unnamed"
    )


def all_labels() -> list[Headline]:
    """Every number that the summary of the draft's campaign can have, and those of a trial of
    torque against angle."""
    found = []
    for table, labels in LABELS.items():
        for label in labels.values():
            of_each = [with_controller(label, name, Example()) for name in CONTROLLERS]
            found += of_each if table == "impedance" else [label]
    return found


STUDENT = "95 % of the mean (Student)"
FOR_MOTION = "95 % for another motion of this kind"
FEW = "95 % for a repetition of this motion"
OF_NOISE = "95 % of this recording's noise"
KIND_OF_FIT = {"repeats": FEW, "white noise": OF_NOISE}
"""The interval of a fit by its `interval_method`; of any other it is `FOR_MOTION`."""
BOOTSTRAP = "95 % (bootstrap)"
RANGE = "lowest to highest"
COUNT = "count"


def headline(
    label: Headline,
    value: float,
    n: int,
    low: float | None,
    high: float | None,
    kind: str,
    **more: Any,
) -> Headline:
    """A number with `more` fields, without an interval where a bound is missing (a single trial has
    no scatter)."""
    number = replace(label, value=value, n=n, **more)
    known = low is not None and high is not None and np.isfinite([low, high]).all()
    return replace(number, low=low, high=high, interval=kind) if known else number


def rule_of_means(numbers: Iterable[Mapping[str, Any]]) -> str:
    """The sentence on which doubtful trials a mean counts; empty where none is doubtful."""
    is_doubtful = any(int(number.get("n_doubtful") or 0) for number in numbers)
    return RULE_OF_MEANS if is_doubtful else ""


def over_fits(
    label: Headline,
    values: pl.Series,
    middle: Callable[[Array], np.floating] = np.mean,
    candidates: pl.DataFrame | None = None,
    used: pl.DataFrame | None = None,
) -> list[Headline]:
    """Mean or median of the finite values, with their range if there are several. Doubtful rows are
    counted among the `candidates`, and those not in `used`. Empty without finite values."""
    finite = values.drop_nulls().filter(values.drop_nulls().is_finite()).to_numpy()
    if not len(finite):
        return []
    low, high = (float(finite.min()), float(finite.max())) if len(finite) > 1 else (None, None)
    more = {} if candidates is None else {"n_doubtful": doubtful_count(candidates)[0]}
    more |= (
        {} if candidates is None or used is None else {"n_left_out": len(candidates) - len(used)}
    )
    return [headline(label, float(middle(finite)), len(finite), low, high, RANGE, **more)]


def summary_means(
    table: pl.DataFrame, labels: Mapping[str, Headline], interval: str = STUDENT
) -> list[Headline]:
    """The means of a summary table with their intervals, for the labelled quantities."""
    rows = {row["quantity"]: row for row in table.drop_nulls("mean").iter_rows(named=True)}
    numbers = []
    for quantity, label in labels.items():
        if (row := rows.get(quantity)) is None:
            continue
        n, mean, low, high = (row[column] for column in ("n", "mean", "low", "high"))
        if not math.isfinite(mean):
            raise InputError(
                f"summary table: the mean of '{quantity}' is {mean}; look for a fit without a"
                " result in its trials"
            )
        counts = {column: int(row.get(column) or 0) for column in ("n_doubtful", "n_left_out")}
        more = counts | {"sd": row.get("sd"), "doubt": row.get("doubt") or None}
        numbers.append(headline(label, mean, int(n), low, high, interval, **more))
    return numbers


def impedance_headlines(impedance: pl.DataFrame, example: Example) -> Iterator[Headline]:
    """The numbers of the rendered impedance by controller (None: without one), those of the draft
    first. For each condition they are means over its trials; the condition of Fig. 4 comes
    first."""
    found = set(impedance["controller"])
    others = sorted(found - {*CONTROLLERS, None})
    for controller in (one for one in (*CONTROLLERS, *others, None) if one in found):
        fits = impedance.filter(pl.col("controller").eq_missing(pl.lit(controller, pl.String)))
        of_all = len(found) == 1
        labels = {
            key: with_controller(one, controller, example, of_all)
            for key, one in LABELS["impedance"].items()
        }
        trials = fits.filter(pl.col("amplitude_deg").is_null())
        alone = pl.len().over("trial") == 1 if "trial" in fits.columns else pl.lit(False)
        is_single = pl.col("amplitude_deg").is_not_null() | alone
        single = doubts_of_trials(fits).filter(is_single)
        used, used_single = counted(trials), counted(fits).filter(is_single)
        VAF = used_single["VAF"]
        yield from over_fits(labels["VAF_median"], VAF, np.median, single, used_single)
        yield from over_fits(labels["VAF_mean"], VAF, np.mean, single, used_single)
        yield from over_fits(
            labels["K_bias"], 100 * (used["K"] / used["K_d"] - 1), np.mean, trials, used
        )
        B, of_B = held_against_desired(used)["B"], labels["B_error"]
        of_B = (
            with_end(of_B, "B without friction where this is certain")
            if used["B_viscous"].count()
            else of_B
        )
        yield from over_fits(of_B, (B - used["B_d"]).abs(), np.mean, trials, used)
        if "torque_error" in used.columns:
            yield from over_fits(
                labels["torque_error"], used["torque_error"], np.mean, trials, used
            )
        pairs = trials.drop_nulls("K_d").select("K_d", "B_d").unique().sort("K_d", "B_d").rows()
        others = [Example(*pair) for pair in pairs if pair != (example.K_d, example.B_d)]
        yield from numbers_of_condition(trials, example, controller, of_all, is_other=False)
        are_many = len(others) >= MOST_UNSTATED
        for condition in others:
            numbers = numbers_of_condition(trials, condition, controller, of_all, is_other=True)
            for number in numbers:
                yield replace(number, is_macro_only=are_many)


def numbers_of_condition(
    trials: pl.DataFrame, example: Example, controller: str | None, alone: bool, is_other: bool
) -> Iterator[Headline]:
    """K, B, I and friction of the trials of one desired impedance. It is named if it `is_other`
    than that of Fig. 4. Without a desired impedance, trials are listed one by one."""
    asked = {"K_d": example.K_d, "B_d": example.B_d}
    shown = trials.filter(
        pl.col(name).eq_missing(pl.lit(value, pl.Float64)) for name, value in asked.items()
    )
    # trials that nobody stated to be alike have no common mean, unless they repeat one another
    unstated = example.K_d is None and len(shown) > 1
    repeated = repeating_trials(shown) if unstated else pl.lit("all")
    parts = shown.with_columns(repeated=repeated).partition_by("repeated", maintain_order=True)
    named = [(part, counted(part)) for part in parts] if len(parts) <= MOST_UNSTATED else []
    for (part, used), symbol in product(named, ("K", "B", "I", "B_viscous", "f_C")):
        having, its = part.drop_nulls(symbol), used.drop_nulls(symbol)
        label = with_controller(
            LABELS["impedance"][f"{symbol}_example"], controller, example, alone
        )
        if is_other:
            said = ", ".join(
                f"{name} {value:g}" for name, value in asked.items() if value is not None
            )
            label = replace(of_group(label, said), meaning=label.meaning)
        label = of_group(label, its["trial"][0] if unstated and len(its) else "all")
        label = (
            with_end(label, f"mean with {len(its) - 1} that repeat it")
            if unstated and len(its) > 1
            else label
        )
        if len(having) != 1:
            yield from over_fits(label, its[symbol], np.mean, having, its)
            continue
        row = having.row(0, named=True)
        kind = KIND_OF_FIT.get(row["interval_method"], FOR_MOTION)
        more = {
            f"amplitudes_{end}": row.get(f"{symbol}_amplitudes_{end}") for end in ("low", "high")
        }
        more["n_doubtful"] = doubtful_count(having)[0]
        yield headline(
            label, row[symbol], 1, row[f"{symbol}_low"], row[f"{symbol}_high"], kind, **more
        )


# its bias decreases with the number of crossings, unlike that of the mean of fits
HEADLINE_ESTIMATOR = "ensemble"


def numbers_of(name: str, table: pl.DataFrame, example: Example) -> Iterator[Headline]:
    """The headline numbers of the table `name`, of one joint and side on the bench."""
    labels = LABELS[name]
    if name == "impedance":
        yield from impedance_headlines(table, example)
    elif name == "torque_angle":  # trial by trial
        kind = "95 % of the mean of cycles (Student)" if name == "torque_angle" else FOR_MOTION
        for row in table.drop_nulls([*labels]).iter_rows(named=True):
            for quantity, label in labels.items():
                ends = row[f"{quantity}_low"], row[f"{quantity}_high"]
                number = headline(label, row[quantity], int(row.get("cycles", 1)), *ends, kind)
                doubt = doubts_of_result(row[DOUBTFUL] or "", quantity)
                yield replace(of_group(number, row["trial"]), doubt=doubt or None)
    elif name == "walking_summary":
        for rows in table.filter(pl.col("mean").is_not_null()).partition_by(
            "group", maintain_order=True
        ):
            for estimator, its in (
                (HEADLINE_ESTIMATOR, labels),
                ("up minus down", LABELS["walking_symmetry"]),
            ):
                for number in summary_means(
                    rows.filter(pl.col("estimator") == estimator), its, BOOTSTRAP
                ):
                    yield of_group(number, rows["group"][0])
    elif name == "claims":
        for row in (
            (known := table.filter(pl.col("subject").is_null()))
            .drop_nulls("value")
            .iter_rows(named=True)
        ):
            meaning = f"{row['claim']}, {row['quantity']}"
            label = Headline(
                row["name"], row["unit"], None, letters(row["name"].replace("_", " ")), meaning
            )
            where = ", ".join(filter(None, [row["joint"], row["side"]]))
            label = of_group(label, where) if len(known.filter(name=row["name"])) > 1 else label
            number = headline(
                label, row["value"], int(row["n"] or 0), row["low"], row["high"], row["interval"]
            )
            yield replace(number, verdict=row["verdict"], interval=row["interval"])
    elif name == "prediction":
        made = table.filter(pl.col("VAF").is_not_null())
        yield from over_fits(labels["VAF"], made["VAF"], np.median, made)
        better = replace(
            labels["better"], value=float((made["VAF"] > made["VAF_fitted"]).sum()), interval=COUNT
        )
        yield from [replace(better, n=len(made))] * bool(len(made))
        off = {symbol: (made[symbol] - made[f"{symbol}_measured"]).abs() for symbol in "KB"}
        yield from over_fits(labels["K"], 100 * off["K"] / made["K_measured"].abs(), np.median)
        yield from over_fits(labels["B"], off["B"], np.median)
    elif name == "transmission":
        whole = table.filter(pl.col("amplitude_deg").is_null())
        yield from over_fits(labels["VAF"], whole["VAF"], np.mean, whole)
    elif name == "walking":
        yield from over_fits(labels["VAF"], table["VAF"])
    else:
        yield from summary_means(table, labels)


def placed_numbers(name: str, table: pl.DataFrame, example: Example) -> Iterator[Headline]:
    """The numbers of one table; on the bench by joint and side, if these differ. The draft's joint
    is an ankle."""
    places = ("joint", "side")
    if name == "claims" or name.startswith("walking") or not set(places) <= set(table.columns):
        yield from numbers_of(name, table, example)
        return
    parts = table.partition_by(places, maintain_order=True)
    for part in parts:
        joint, side = part.select(places).row(0)
        where = ", ".join(filter(None, [joint or DRAFT_JOINT, side]))
        for number in numbers_of(name, part, example):
            alone = with_end(number, where) if where != DRAFT_JOINT else number
            named = of_group(number, where) if len(parts) > 1 else alone
            yield replace(
                named, draft=number.draft if (joint or DRAFT_JOINT) == DRAFT_JOINT else None
            )


def headline_numbers(
    tables: Mapping[str, pl.DataFrame], example: Example | None = None, beside_draft: bool = True
) -> list[Headline]:
    """Headline numbers of a campaign, from its `tables` by name and the `example` of Fig. 4. Those
    of the draft are None unless `beside_draft`. Names and macros are unique: macros have only
    letters, so of `PD 1` and `PD-1` the second becomes `PDOneB`. Raises InputError: a summary table
    has no finite mean for a quantity that it lists."""
    own = (
        placed_numbers(name, tables[name], example or Example())
        for name in LABELS
        if name in tables
    )
    names, macros, found = set[str](), set[str](ABOUT_MACROS.values()), []
    for number in chain.from_iterable(own):
        name = next(
            free
            for k in count(1)
            if (free := number.name + (f" ({k})" if k > 1 else "")) not in names
        )
        tried = ([number.macro + "B" * k + ending for ending in ENDINGS] for k in count())
        free_macros = next(free for free in tried if macros.isdisjoint(free))
        names.add(name)
        macros.update(free_macros)
        found.append(
            replace(
                number,
                name=name,
                macro=free_macros[0],
                draft=number.draft if beside_draft else None,
            )
        )
    return found


def hold_bench_errors(tables: Mapping[str, pl.DataFrame]) -> bool | None:
    """Whether the intervals of the result tables include the stated errors of the bench; None
    without a bench."""
    shared = [
        table[name].max()
        for table in tables.values()
        for name in table.columns
        if name.endswith("_se_bench")
    ]
    return any(shared) if shared else None


def intervals_said(tables: Mapping[str, pl.DataFrame]) -> str:
    """A text on which errors of calibration the intervals of a bench's tables include; empty
    without a bench."""
    if (held := hold_bench_errors(tables)) is None:
        return ""
    if held:
        return (
            "Intervals on the bench contain what is stated of its errors; differences within the"
            " campaign have none."
        )
    return (
        "Intervals on the bench are of noise, repeatability and what the model misses alone. Errors"
        " that all of its trials share (gains, alignment, hysteresis, delay) are not in them until"
        " `calibration` states them in the configuration."
    )


# endings of the macros of a number
ENDINGS = ("", "Low", "High", "AmplitudesLow", "AmplitudesHigh", "Verdict")


# The trials behind the numbers.


def used_and_missing(
    trials: Mapping[str, Sequence[str]], excluded: pl.DataFrame
) -> dict[str, dict[str, Any]]:
    """By experiment: number `of` trials, number `used`, and why others are `missing`, unless
    excluded in the sheet."""
    reasons: dict[str, str] = {}
    for row in excluded.filter(pl.col("check") != "sample sheet").iter_rows(named=True):
        reasons.setdefault(row["trial"], exclusion_said(row))
    found = {}
    for experiment, names in trials.items():
        missing = {name: reasons[name] for name in names if name in reasons}
        found[experiment] = {
            "used": len(names) - len(missing),
            "of": len(names),
            "missing": missing,
        }
    return found


def missing_lines(content: Mapping[str, Any], reasons: bool) -> list[str]:
    """A line per experiment with missing trials, with their `reasons` or without, and per missing
    result."""
    lines = []
    for experiment, counts in content.get("trials", {}).items():
        if counts["missing"]:
            named = [
                f"{trial} ({why})" if reasons else trial for trial, why in counts["missing"].items()
            ]
            lines.append(
                f"{counts['used']} of {counts['of']} {experiment} trials; without"
                f" {', '.join(named)}"
            )
    return lines + [f"no {file}: {why}" for file, why in content.get("missing_results", {}).items()]


# How they are written.

SPECIAL = {sign: f"\\{sign}" for sign in "#$%&_{}"} | {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"
}  # fmt: skip
"""Special characters of LaTeX, and their commands."""


def in_latex(text: str) -> str:
    """Text with the special characters of LaTeX escaped."""
    return "".join(SPECIAL.get(sign, sign) for sign in text)


def to_json(
    about: Mapping[str, str],
    headlines: Sequence[Headline],
    missing: Mapping[str, Any] | None = None,
) -> str:
    """The numbers' origin, the `missing` trials and results, and an object per number in full
    precision. Null if there is no interval, or no value of the draft."""
    numbers = {number.name: asdict(number) for number in headlines if not number.is_macro_only}
    for number in numbers.values():
        del number["name"], number["macro"], number["is_macro_only"]
    content = {**about, **(missing or {}), "numbers": numbers}
    return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def to_tex(
    about: Mapping[str, str], headlines: Sequence[Headline], remarks: Sequence[str] = ()
) -> str:
    r"""Macros such as `\oslBeltStiffness`, with `Low` and `High` where there is an interval,
    rounded, without unit; `\oslData`, `\oslCampaign` ... say what the numbers are made of. Each
    line ends in a comment, so that reading the file puts no space into the text. `remarks` are
    comments too."""
    lines = [
        f"% {sentence(about)}",
        "% Headline numbers by osl-analysis; \\input this file and use the macros.",
    ]
    lines += [f"% {remark}" for remark in remarks]
    for name, value in about.items():
        text = in_latex(value)
        lines.append(f"\\newcommand{{\\osl{ABOUT_MACROS[name]}}}{{{text}}}% {ABOUT_MEANING[name]}")
    for h in headlines:
        digits, finer = digits_of(h.value, h.low, h.high, *rounded_by(asdict(h)))
        remark = f", n = {trials_text(asdict(h))}" if h.n_doubtful or h.doubt else ""
        ends = (
            (h.value, digits, f"{h.unit}, {h.meaning}{remark}"),
            (h.low, finer, f"low end: {h.interval}"),
            (h.high, finer, f"high end: {h.interval}"),
            (h.amplitudes_low, digits, "lowest of the fits to single amplitudes"),
            (h.amplitudes_high, digits, "highest of the fits to single amplitudes"),
        )
        for suffix, (number, its, comment) in zip(ENDINGS[:-1], ends, strict=True):
            if number is None:
                continue
            # read the same in text and in mathematics: with a true minus, small ones with a power
            # of ten
            text, _, power = fixed(number, its).partition("e")
            text += rf"\times 10^{{{int(power)}}}" if power else ""
            if power or text.startswith("-"):
                text = rf"\ensuremath{{{text}}}"
            lines.append(f"\\newcommand{{\\osl{h.macro}{suffix}}}{{{text}}}% {comment}")
        if h.verdict:
            lines.append(f"\\newcommand{{\\osl{h.macro}Verdict}}{{{h.verdict}}}% verdict")
    return "\n".join(lines) + "\n"


def to_table(numbers: Mapping[str, Mapping[str, Any]], markdown: bool) -> str:
    """The numbers of a summary, as `to_json` writes them, in Markdown or aligned columns: meaning,
    value, interval, trials, the draft's value."""
    rows: list[tuple[str, ...]] = [("quantity", "value", "interval", "n", "draft")]
    beside_draft = any(number["draft"] is not None for number in numbers.values())
    for number in numbers.values():
        value, interval, single = numbers_said(number)
        interval += f", {number['interval']}" * bool(
            interval
        ) + f"; single amplitudes {single}" * bool(single)
        interval += (
            f"{'; ' if interval else ''}{number['verdict']}" if number.get("verdict") else ""
        )
        draft = "" if number["draft"] is None else f"{number['draft']:g}"
        rows.append(
            (number["meaning"], f"{value} {number['unit']}", interval, trials_text(number), draft)
        )
    rows = rows if beside_draft else [row[:-1] for row in rows]
    return markdown_table(rows) if markdown else aligned(rows)


def markdown_table(rows: Sequence[Sequence[str]]) -> str:
    """Rows as a table in Markdown; the first row is the head."""
    lines = [rows[0], ["---"] * len(rows[0]), *rows[1:]]
    return "".join(
        "| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines
    )


def aligned(rows: Sequence[Sequence[str]]) -> str:
    """Rows with the same number of cells as lines with aligned columns."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    padded = (
        "  ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True))
        for cells in rows
    )
    return "".join(f"{line.rstrip()}\n" for line in padded)


def numbers_said(number: Mapping[str, Any]) -> tuple[str, str, str]:
    """A number, its interval and the range over single amplitudes; these are empty where there is
    none."""
    digits, finer = digits_of(number["value"], number["low"], number["high"], *rounded_by(number))
    parts = []
    for low, high, its in (
        (number["low"], number["high"], finer),
        (number.get("amplitudes_low"), number.get("amplitudes_high"), digits),
    ):
        parts.append(
            "" if low is None or high is None else f"{fixed(low, its)} to {fixed(high, its)}"
        )
    return fixed(number["value"], digits), parts[0], parts[1]


def first_said(numbers: Sequence[Mapping[str, Any]], most: int = 3) -> list[str]:
    """A sentence per `begins`, with each number and its `of`; of more than `most` numbers, only the
    two extremes."""
    found = dict[str, list[dict[str, Any]]]()
    for number in numbers:
        if number["begins"]:
            found.setdefault(number["begins"], []).append({**number, **said_number(number)})
    said = []
    for begins, every in found.items():
        few = len(every) <= most
        own = (
            every
            if few
            else [pick(every, key=lambda one: float(one["value"])) for pick in (min, max)]
        )
        parts = []
        for one in own:
            ends = f"{one['interval']} {one['ends']}" if one["interval"] == RANGE else one["ends"]
            more = "; ".join(filter(None, [one["of"], ends, f"n = {one['behind']}"]))
            parts.append(f"{one['text']}\N{NO-BREAK SPACE}{one['unit']} ({more})")
        said.append(f"{begins} {(', ' if few else ' to ').join(parts)}.")
    return said


def said_number(number: Mapping[str, Any]) -> dict[str, str]:
    """`text` and `ends` of a number for a reader, and the trials `behind` it. No digits if 0 is in
    the interval."""
    value, ends, single = numbers_said(number)
    low, high, known = number["low"], number["high"], number["interval"] not in (None, RANGE, COUNT)
    value = "≈ 0" if known and low is not None and low <= 0 <= high else value
    kind = number["interval"] or "" if ends else "single amplitudes" * bool(single)
    behind = trials_text(number).replace("DOUBTFUL", "doubtful")
    text, its_ends, unit = map(printed, (value, ends or single, number["unit"]))
    return {"text": text, "ends": its_ends, "kind": kind, "unit": unit, "behind": behind}


def trials_text(number: Mapping[str, Any]) -> str:
    """Number of trials or fits behind a number, doubtful ones in it or left out, and why it is
    doubtful itself."""
    if number.get("doubt"):
        return f"{number['n']}, DOUBTFUL: {number['doubt']}"
    n, doubtful, left_out = (int(number.get(key) or 0) for key in ("n", "n_doubtful", "n_left_out"))
    if left_out:
        return f"{n} of {n + left_out}, {left_out} doubtful left out"
    return f"{n}, {f'{doubtful} of them ' * (n > 1)}doubtful" if doubtful else str(n)


def rounded_by(
    number: Mapping[str, Any],
) -> tuple[float | None, float | None, str | None, float | None]:
    """Bounds by which a number is rounded, their kind, and its scatter. The bounds are the range
    over single amplitudes if it is wider than the interval, else the interval."""
    low, high = (number.get(f"amplitudes_{end}") for end in ("low", "high"))
    if (
        low is None
        or high is None
        or (number["low"] is not None and number["high"] - number["low"] > high - low)
    ):
        return number["low"], number["high"], number["interval"], number.get("sd")
    return low, high, None, number.get("sd")


NO_WIDTH = 1e-9  # relative width below which an interval is only rounding


def decimals(
    value: float,
    low: float | None,
    high: float | None,
    interval: str | None,
    scatter: float | None = None,
) -> int:
    """Decimal places of a written number. Half its interval keeps two digits; without an interval
    it has three digits. The trials' `scatter`, or a thousandth of the number, keeps one. With a
    range, which does not show the precision, it has three digits, at most one beyond the range's
    two, or more until the ends differ. A count has no decimals."""
    if interval == COUNT:
        return 0
    half = 0.0 if low is None or high is None else abs(high - low) / 2
    if interval == RANGE and half > NO_WIDTH * abs(value):
        finest = 2 - exponent_of(half)
        return told_apart(low, high, max(min(2 - exponent_of(value) if value else 0, finest), 0))
    if half > NO_WIDTH * abs(value):
        # no torque is calibrated better than to a thousandth, whatever the interval by noise is
        coarsest = max(1e-3 * abs(value), scatter or 0.0, np.finfo(float).tiny)
        return max(min(1 - exponent_of(half), -exponent_of(coarsest)), 0)
    return max(2 - exponent_of(value), 0) if value else 0


def digits_of(value: float, low: float | None, high: float | None, *by: Any) -> tuple[int, int]:
    """Decimal places of a number and of its ends, so that it reads as lying between two different
    ends: `decimals`, and up to two more if rounding would put it on or beyond an end. `by` as for
    `decimals`; without it, the ends are those of the interval."""
    digits = decimals(value, *(by or (low, high, None)))
    finer = told_apart(low, high, digits)
    if low is not None and high is not None and RANGE in by and high - low > NO_WIDTH * abs(value):
        finer = told_apart(low, high, max(min(digits, 1 - exponent_of((high - low) / 2)), 0))
    if low is None or high is None or not low < value < high or high - low <= NO_WIDTH * abs(value):
        return digits, finer
    for _ in range(2):
        if float(fixed(low, finer)) < float(fixed(value, digits)) < float(fixed(high, finer)):
            break
        finer += 1
        digits = digits if low < float(fixed(value, digits)) < high else finer
    return digits, finer


def told_apart(low: float | None, high: float | None, digits: int) -> int:
    """Decimal places, at least `digits`, with which two different bounds read differently."""
    if low is None or high is None or abs(high - low) <= NO_WIDTH * max(abs(low), abs(high)):
        return digits
    while fixed(low, digits) == fixed(high, digits):
        digits += 1
    return digits


def exponent_of(number: float) -> int:
    """Power of ten of the leading digit."""
    return math.floor(math.log10(abs(number)))


def fixed(number: float, digits: int) -> str:
    """The number with `digits` decimal places; with a power of ten up to 0.0001; never a minus
    before zero."""
    text = f"{number:.{digits}f}"
    if float(text) == 0:
        return text.removeprefix("-")
    return (
        f"{number:.{max(digits + exponent_of(float(text)), 0)}e}"
        if abs(float(text)) <= 1e-4
        else text
    )
