"""Headline numbers of a campaign, computed from its result tables, each with label and interval;
and their output as JSON, as LaTeX macros and as tables."""

import json
import math
import re
import unicodedata
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import count, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from osl_analysis.campaign.origin import ABOUT_MACROS, ABOUT_MEANING, sentence
from osl_analysis.errors import InputError
from osl_analysis.judge.causes import doubts_of_result
from osl_analysis.judge.exclusions import exclusion_text
from osl_analysis.judge.words import printed
from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.report.decimal_places import COUNT, RANGE, fixed, places_of
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
LONGEST_CONTROLLER = 32  # letters of its name in a macro

STUDENT = "95 % of the mean (Student)"
OF_CYCLES = "95 % of the mean of cycles (Student)"
FOR_MOTION = "95 % for another motion of this kind"
FEW = "95 % for a repetition of this motion"
OF_NOISE = "95 % of this recording's noise"
KIND_OF_FIT = {"repeats": FEW, "white noise": OF_NOISE}
"""The interval of a fit by its `interval_method`; of any other it is `FOR_MOTION`."""
BOOTSTRAP = "95 % (bootstrap)"


@dataclass(frozen=True)
class Headline:
    """A number with its label; in `LABELS` only the label. The summary has the fields in this
    order.

    Attributes
    ----------
    name
        Its key in the summary.
    draft
        The value that the paper's draft prints; None if it prints none.
    macro
        Its LaTeX macro without the prefix, letters only.
    value, low, high
        In `unit`; None where there is no interval.
    interval
        Kind of the interval; None if there is none.
    n
        Number of trials or fits behind the number.
    sd
        Standard deviation between the trials; None if unknown.
    n_doubtful, n_left_out
        Numbers of doubtful trials or fits among the candidates, and of those that are left out.
    doubt
        Why the number itself is doubtful; None if it is not, or not judged.
    verdict
        On the paper's claim about this number; None without a claim.
    amplitudes_low, amplitudes_high
        Lowest and highest result of the fits to single amplitudes; None if there are none.
    of
        Controller, group or joint, with which `meaning` ends; empty: all.
    begins
        Begin of the page's first sentence with this number; empty: there is none.
    is_macro_only
        Whether it stands in `numbers.tex` alone, as one of many conditions, which are in a table.
    """

    name: str
    unit: str
    draft: float | None
    macro: str
    meaning: str
    value: float = math.nan
    low: float | None = None
    high: float | None = None
    interval: str | None = None
    n: int = 0
    sd: float | None = None
    n_doubtful: int = 0
    n_left_out: int = 0
    doubt: str | None = None
    verdict: str | None = None
    amplitudes_low: float | None = None
    amplitudes_high: float | None = None
    of: str = ""
    begins: str = ""
    is_macro_only: bool = False


@dataclass(frozen=True)
class Example:
    """The desired impedance of Fig. 4, whose estimates are headline numbers; by default that of the
    draft."""

    K_d: float | None = 300.0  # desired stiffness [N*m/rad]; None: not stated
    B_d: float | None = 5.0  # desired damping [N*m*s/rad]; None: not stated
    chosen: str = ""  # why this one, if the configuration does not name it

    def stated(self) -> dict[str, float]:
        """K_d and B_d, as far as they are stated."""
        desired = {"K_d": self.K_d, "B_d": self.B_d}
        return {name: value for name, value in desired.items() if value is not None}

    def meaning(self) -> str:
        stated = [f"{name} = {value:g}" for name, value in self.stated().items()]
        if not stated:
            return "as measured"
        meaning = f"for {', '.join(stated)}"
        return f"{meaning} (that of {self.chosen})" if self.chosen else meaning


ENTRIES: dict[str, Any] = read_mapping(Path(__file__).with_suffix(".yaml"))
LABELS = {
    table: {quantity: Headline(**fields) for quantity, fields in labels.items()}
    for table, labels in ENTRIES.items()
}
"""The labels by table and quantity, in the order of the summary."""


# Labels.


def with_controller(
    label: Headline, controller: str | None, example: Example, is_only: bool = False
) -> Headline:
    """The label of one controller, which is not named if it is the only one and no trial states
    it."""
    controller_name = controller or "no controller"
    named = replace(
        label,
        name=f"{label.name}_{controller_name.replace(' ', '_')}",
        macro=letters(controller_name)[:LONGEST_CONTROLLER] + label.macro,
        meaning=label.meaning.format(example=example.meaning()),
    )
    if controller is None and is_only:
        return named
    return with_end(named, controller or "controller not stated")


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
    """The number with an addition to its meaning."""
    of = f"{number.of}, {end}" if number.of else end
    return replace(number, meaning=f"{number.meaning}, {end}", of=of)


DIGITS = ("Zero", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine")


def letters(text: str) -> str:
    """Text as Latin letters only, for a macro: `K_d 200, timing 41 %` gives
    `KdTwoZeroZeroTimingFourOne`."""
    plain = unicodedata.normalize("NFKD", text.replace("_", "")).encode("ascii", "ignore").decode()
    macro = ""
    for word in re.findall(r"[A-Za-z]+|[0-9]", plain):
        macro += DIGITS[int(word)] if word.isdigit() else word[0].upper() + word[1:]
    return macro or "Unnamed"


def all_labels() -> list[Headline]:
    """Every number that the summary of the draft's campaign can have, and those of a trial of
    torque against angle."""
    labels: list[Headline] = []
    for table, by_quantity in LABELS.items():
        for label in by_quantity.values():
            if table == "impedance":
                labels += [with_controller(label, name, Example()) for name in CONTROLLERS]
            else:
                labels.append(label)
    return labels


# Numbers.


def with_interval(
    number: Headline, low: float | None, high: float | None, kind: str | None
) -> Headline:
    """A number with its interval, or without one where a bound is missing (a single trial has no
    scatter)."""
    if low is None or high is None or not np.isfinite([low, high]).all():
        return number
    return replace(number, low=low, high=high, interval=kind)


def rule_of_means(numbers: Iterable[Mapping[str, Any]]) -> str:
    """The sentence on which doubtful trials a mean counts; empty where none is doubtful."""
    is_any_doubtful = any(int(number.get("n_doubtful") or 0) for number in numbers)
    return RULE_OF_MEANS if is_any_doubtful else ""


def over_fits(
    label: Headline,
    values: pl.Series,
    middle: Callable[[Array], np.floating] = np.mean,
    candidates: pl.DataFrame | None = None,
    used: pl.DataFrame | None = None,
) -> list[Headline]:
    """Summarise one number per fit.

    Parameters
    ----------
    label : Headline
    values : polars.Series
        One per fit, in the unit of the label; those that are not finite do not count.
    middle : Callable
        Mean or median.
    candidates : polars.DataFrame or None
        Rows among which doubtful ones are counted; None: not judged.
    used : polars.DataFrame or None
        Rows that count; the others of `candidates` are left out.

    Returns
    -------
    list of Headline
        One number, with the range of the values if there are several; none without finite values.
    """
    not_null = values.drop_nulls()
    finite = not_null.filter(not_null.is_finite()).to_numpy()
    if not len(finite):
        return []
    number = replace(label, value=float(middle(finite)), n=len(finite))
    if candidates is not None:
        number = replace(number, n_doubtful=doubtful_count(candidates)[0])
        if used is not None:
            number = replace(number, n_left_out=len(candidates) - len(used))
    if len(finite) > 1:
        number = with_interval(number, float(finite.min()), float(finite.max()), RANGE)
    return [number]


def summary_means(
    table: pl.DataFrame, labels: Mapping[str, Headline], interval: str = STUDENT
) -> list[Headline]:
    """The means of a summary table with their intervals, for the labelled quantities."""
    rows = {row["quantity"]: row for row in table.drop_nulls("mean").iter_rows(named=True)}
    numbers = []
    for quantity, label in labels.items():
        if quantity not in rows:
            continue
        row = rows[quantity]
        if not math.isfinite(row["mean"]):
            raise InputError(
                f"summary table: the mean of '{quantity}' is {row['mean']}; look for a fit without"
                " a result in its trials"
            )
        number = replace(
            label,
            value=row["mean"],
            n=int(row["n"]),
            sd=row.get("sd"),
            n_doubtful=int(row.get("n_doubtful") or 0),
            n_left_out=int(row.get("n_left_out") or 0),
            doubt=row.get("doubt") or None,
        )
        numbers.append(with_interval(number, row["low"], row["high"], interval))
    return numbers


def impedance_headlines(impedance: pl.DataFrame, example: Example) -> Iterator[Headline]:
    """The numbers of the rendered impedance by controller (None: without one), those of the draft
    first. For each condition they are means over its trials; the condition of Fig. 4 comes
    first."""
    present = set(impedance["controller"])
    further = sorted(present - {*CONTROLLERS, None})
    for controller in (*CONTROLLERS, *further, None):
        if controller not in present:
            continue
        is_controller = pl.col("controller").eq_missing(pl.lit(controller, pl.String))
        fits = impedance.filter(is_controller)
        is_only = len(present) == 1
        yield from errors_of_controller(fits, example, controller, is_only)
        yield from numbers_of_conditions(fits, example, controller, is_only)


def errors_of_controller(
    fits: pl.DataFrame, example: Example, controller: str | None, is_only: bool
) -> Iterator[Headline]:
    """How well one controller renders what it was asked for, over its trials, and the VAF of fits
    to single amplitudes, or to all of a trial with one amplitude."""
    labels = {}
    for quantity, label in LABELS["impedance"].items():
        labels[quantity] = with_controller(label, controller, example, is_only)
    is_of_whole = pl.col("amplitude_deg").is_null()
    trials = fits.filter(is_of_whole)
    has_one_fit = pl.lit(False)
    if "trial" in fits.columns:
        has_one_fit = pl.len().over("trial") == 1
    is_single = ~is_of_whole | has_one_fit
    single = doubts_of_trials(fits).filter(is_single)
    used = counted(trials)
    used_single = counted(fits).filter(is_single)
    VAF = used_single["VAF"]
    yield from over_fits(labels["VAF_median"], VAF, np.median, single, used_single)
    yield from over_fits(labels["VAF_mean"], VAF, np.mean, single, used_single)
    K_bias_percent = 100 * (used["K"] / used["K_d"] - 1)
    yield from over_fits(labels["K_bias"], K_bias_percent, np.mean, trials, used)
    label_of_B = labels["B_error"]
    if used["B_viscous"].count():
        label_of_B = with_end(label_of_B, "viscous where friction is certain")
    B_error = (held_against_desired(used)["B"] - used["B_d"]).abs()
    yield from over_fits(label_of_B, B_error, np.mean, trials, used)
    if "torque_error" in used.columns:
        yield from over_fits(labels["torque_error"], used["torque_error"], np.mean, trials, used)


def numbers_of_conditions(
    fits: pl.DataFrame, example: Example, controller: str | None, is_only: bool
) -> Iterator[Headline]:
    """The estimates of each desired impedance of one controller, the `example` first. Its macros
    also have the names of a condition like the others."""
    trials = fits.filter(pl.col("amplitude_deg").is_null())
    yield from numbers_of_condition(trials, example, controller, is_only, is_other=False)
    desired = trials.drop_nulls("K_d").select("K_d", "B_d").unique().sort("K_d", "B_d")
    are_many = len(desired) > MOST_UNSTATED
    for K_d, B_d in desired.rows():
        is_example = (K_d, B_d) == (example.K_d, example.B_d)
        condition = Example(K_d, B_d)
        numbers = numbers_of_condition(trials, condition, controller, is_only, is_other=True)
        for number in numbers:
            yield replace(number, is_macro_only=are_many or is_example)


ESTIMATES_OF_CONDITION = ("K", "B", "I", "B_viscous", "f_C")


def numbers_of_condition(
    trials: pl.DataFrame, example: Example, controller: str | None, is_only: bool, is_other: bool
) -> Iterator[Headline]:
    """K, B, I and friction of the trials of one desired impedance. It is named if it `is_other`
    than that of Fig. 4. Without a desired impedance, trials are listed one by one."""
    has_K_d = pl.col("K_d").eq_missing(pl.lit(example.K_d, pl.Float64))
    has_B_d = pl.col("B_d").eq_missing(pl.lit(example.B_d, pl.Float64))
    shown = trials.filter(has_K_d, has_B_d)
    # trials that nobody stated to be alike have no common mean, unless they repeat one another
    is_unstated = example.K_d is None and len(shown) > 1
    repeated = repeating_trials(shown) if is_unstated else pl.lit("all")
    parts = shown.with_columns(repeated=repeated).partition_by("repeated", maintain_order=True)
    if len(parts) > MOST_UNSTATED:
        return
    counted_parts = [counted(part) for part in parts]
    pairs = zip(parts, counted_parts, strict=True)
    for (part, counted_part), symbol in product(pairs, ESTIMATES_OF_CONDITION):
        candidates = part.drop_nulls(symbol)
        used = counted_part.drop_nulls(symbol)
        label = LABELS["impedance"][f"{symbol}_example"]
        label = with_controller(label, controller, example, is_only)
        if is_other:
            stated = [f"{name} {value:g}" for name, value in example.stated().items()]
            label = replace(of_group(label, ", ".join(stated)), meaning=label.meaning)
        if is_unstated and len(used):
            label = of_group(label, used["trial"][0])
        if is_unstated and len(used) > 1:
            label = with_end(label, f"mean with {len(used) - 1} that repeat it")
        if len(candidates) == 1:
            yield number_of_trial(label, candidates, symbol)
        else:
            yield from over_fits(label, used[symbol], np.mean, candidates, used)


def number_of_trial(label: Headline, trial: pl.DataFrame, symbol: str) -> Headline:
    """An estimate of the only trial of a condition, with its own interval."""
    row = trial.row(0, named=True)
    number = replace(
        label,
        value=row[symbol],
        n=1,
        n_doubtful=doubtful_count(trial)[0],
        amplitudes_low=row.get(f"{symbol}_amplitudes_low"),
        amplitudes_high=row.get(f"{symbol}_amplitudes_high"),
    )
    kind = KIND_OF_FIT.get(row["interval_method"], FOR_MOTION)
    return with_interval(number, row[f"{symbol}_low"], row[f"{symbol}_high"], kind)


# its bias decreases with the number of crossings, unlike that of the mean of fits
HEADLINE_ESTIMATOR = "ensemble"


def numbers_of(name: str, table: pl.DataFrame, example: Example) -> Iterator[Headline]:
    """The headline numbers of the table `name`, of one joint and side on the bench."""
    labels = LABELS[name]
    if name == "impedance":
        yield from impedance_headlines(table, example)
    elif name == "torque_angle":
        yield from torque_angle_headlines(table)
    elif name == "walking_summary":
        yield from walking_headlines(table)
    elif name == "claims":
        yield from claim_headlines(table)
    elif name == "prediction":
        yield from prediction_headlines(table)
    elif name == "transmission":
        whole = table.filter(pl.col("amplitude_deg").is_null())
        yield from over_fits(labels["VAF"], whole["VAF"], np.mean, whole)
    elif name == "walking":
        yield from over_fits(labels["VAF"], table["VAF"])
    else:
        yield from summary_means(table, labels)


def torque_angle_headlines(table: pl.DataFrame) -> Iterator[Headline]:
    """Stiffness and energies of each trial of torque against angle."""
    labels = LABELS["torque_angle"]
    for row in table.drop_nulls(list(labels)).iter_rows(named=True):
        for quantity, label in labels.items():
            doubt = doubts_of_result(row[DOUBTFUL] or "", quantity)
            number = replace(
                of_group(label, row["trial"]),
                value=row[quantity],
                n=int(row.get("cycles", 1)),
                doubt=doubt or None,
            )
            yield with_interval(number, row[f"{quantity}_low"], row[f"{quantity}_high"], OF_CYCLES)


def walking_headlines(table: pl.DataFrame) -> Iterator[Headline]:
    """K, B and I of each group of crossings, and by how much turns up differ from turns down."""
    labels_of_estimator = {
        HEADLINE_ESTIMATOR: LABELS["walking_summary"],
        "up minus down": LABELS["walking_symmetry"],
    }
    with_mean = table.filter(pl.col("mean").is_not_null())
    for rows in with_mean.partition_by("group", maintain_order=True):
        for estimator, labels in labels_of_estimator.items():
            of_estimator = rows.filter(pl.col("estimator") == estimator)
            for number in summary_means(of_estimator, labels, BOOTSTRAP):
                yield of_group(number, rows["group"][0])


def claim_headlines(table: pl.DataFrame) -> Iterator[Headline]:
    """The claims on the campaign, each with its verdict; those on single trials are in
    `claims.csv`."""
    claims = table.filter(pl.col("subject").is_null())
    for row in claims.drop_nulls("value").iter_rows(named=True):
        label = Headline(
            name=row["name"],
            unit=row["unit"],
            draft=None,
            macro=letters(row["name"].replace("_", " ")),
            meaning=f"{row['claim']}, {row['quantity']}",
        )
        if len(claims.filter(name=row["name"])) > 1:
            label = of_group(label, place_text(row["joint"], row["side"]))
        number = replace(
            label,
            value=row["value"],
            n=int(row["n"] or 0),
            verdict=row["verdict"],
            interval=row["interval"],
        )
        yield with_interval(number, row["low"], row["high"], row["interval"])


def prediction_headlines(table: pl.DataFrame) -> Iterator[Headline]:
    """How well the components predict the trials' torque, K and B."""
    labels = LABELS["prediction"]
    predicted = table.filter(pl.col("VAF").is_not_null())
    if predicted.is_empty():
        return
    yield from over_fits(labels["VAF"], predicted["VAF"], np.median, predicted)
    better = float((predicted["VAF"] > predicted["VAF_fitted"]).sum())
    yield replace(labels["better"], value=better, interval=COUNT, n=len(predicted))
    K_error = (predicted["K"] - predicted["K_measured"]).abs()
    K_error_percent = 100 * K_error / predicted["K_measured"].abs()
    yield from over_fits(labels["K"], K_error_percent, np.median)
    B_error = (predicted["B"] - predicted["B_measured"]).abs()
    yield from over_fits(labels["B"], B_error, np.median)


def place_text(joint: str | None, side: str | None) -> str:
    return ", ".join(filter(None, [joint, side]))


def placed_numbers(name: str, table: pl.DataFrame, example: Example) -> Iterator[Headline]:
    """The numbers of one table; on the bench by joint and side, if these differ. The draft's joint
    is an ankle."""
    places = ("joint", "side")
    is_of_bench = name != "claims" and not name.startswith("walking")
    if not is_of_bench or not set(places) <= set(table.columns):
        yield from numbers_of(name, table, example)
        return
    parts = table.partition_by(places, maintain_order=True)
    for part in parts:
        joint, side = part.select(places).row(0)
        joint = joint or DRAFT_JOINT
        place = place_text(joint, side)
        for number in numbers_of(name, part, example):
            draft = number.draft if joint == DRAFT_JOINT else None
            if len(parts) > 1:
                number = of_group(number, place)
            elif place != DRAFT_JOINT:
                number = with_end(number, place)
            yield replace(number, draft=draft)


def headline_numbers(
    tables: Mapping[str, pl.DataFrame], example: Example | None = None, beside_draft: bool = True
) -> list[Headline]:
    """Compute the headline numbers of a campaign.

    Parameters
    ----------
    tables : Mapping of str to polars.DataFrame
        Its result tables, by name.
    example : Example or None
        The desired impedance of Fig. 4; None: that of the draft.
    beside_draft : bool
        Whether the numbers of the draft stand beside them.

    Returns
    -------
    list of Headline
        Names and macros are unique: macros have only letters, so of `PD 1` and `PD-1` the second
        becomes `PDOneB`.

    Raises
    ------
    InputError
        A summary table has no finite mean for a quantity that it lists.
    """
    names: set[str] = set()
    macros = set(ABOUT_MACROS.values())
    numbers: list[Headline] = []
    for table in LABELS:
        if table not in tables:
            continue
        for number in placed_numbers(table, tables[table], example or Example()):
            name = free_name(number.name, names)
            macro = free_macro(number.macro, macros)
            names.add(name)
            macros.update(macros_of(macro))
            draft = number.draft if beside_draft else None
            numbers.append(replace(number, name=name, macro=macro, draft=draft))
    return numbers


# endings of the macros of a number
ENDINGS = ("", "Low", "High", "AmplitudesLow", "AmplitudesHigh", "Verdict")


def free_name(name: str, taken: Collection[str]) -> str:
    """The name, with a number if it is taken."""
    if name not in taken:
        return name
    return next(f"{name} ({k})" for k in count(2) if f"{name} ({k})" not in taken)


def macros_of(macro: str) -> list[str]:
    """All macros of a number."""
    return [macro + ending for ending in ENDINGS]


def free_macro(macro: str, taken: set[str]) -> str:
    """The macro, with as many letters B at its end as make all of its macros new."""
    while not taken.isdisjoint(macros_of(macro)):
        macro += "B"
    return macro


def hold_bench_errors(tables: Mapping[str, pl.DataFrame]) -> bool | None:
    """Whether the intervals of the result tables include the stated errors of the bench; None
    without a bench."""
    largest_errors = []
    for table in tables.values():
        for name in table.columns:
            if name.endswith("_se_bench"):
                largest_errors.append(table[name].max())
    return any(largest_errors) if largest_errors else None


def intervals_text(tables: Mapping[str, pl.DataFrame]) -> str:
    """A text on which errors of calibration the intervals of a bench's tables include; empty
    without a bench."""
    are_included = hold_bench_errors(tables)
    if are_included is None:
        return ""
    if are_included:
        return (
            "Intervals on the bench contain what is stated of its errors; differences within the"
            " campaign have none."
        )
    return (
        "Intervals on the bench are of noise, repeatability and what the model misses alone. Errors"
        " that all of its trials share (gains, alignment, hysteresis, delay) are not in them until"
        " `calibration` states them in the configuration."
    )


# The trials behind the numbers.


def used_and_missing(
    trials: Mapping[str, Sequence[str]], excluded: pl.DataFrame
) -> dict[str, dict[str, Any]]:
    """By experiment: number `of` trials, number `used`, and why others are `missing`, unless
    excluded in the sheet."""
    reasons: dict[str, str] = {}
    for row in excluded.filter(pl.col("check") != "sample sheet").iter_rows(named=True):
        reasons.setdefault(row["trial"], exclusion_text(row))
    by_experiment: dict[str, dict[str, Any]] = {}
    for experiment, names in trials.items():
        missing = {name: reasons[name] for name in names if name in reasons}
        used = len(names) - len(missing)
        by_experiment[experiment] = {"used": used, "of": len(names), "missing": missing}
    return by_experiment


def missing_lines(content: Mapping[str, Any], reasons: bool) -> list[str]:
    """A line per experiment with missing trials, with their `reasons` or without, and per missing
    result."""
    lines = []
    for experiment, counts in content.get("trials", {}).items():
        if not counts["missing"]:
            continue
        trials = list(counts["missing"])
        if reasons:
            trials = [f"{trial} ({reason})" for trial, reason in counts["missing"].items()]
        used = f"{counts['used']} of {counts['of']} {experiment} trials"
        lines.append(f"{used}; without {', '.join(trials)}")
    for file, reason in content.get("missing_results", {}).items():
        lines.append(f"no {file}: {reason}")
    return lines


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
    """Write a summary as JSON.

    Parameters
    ----------
    about : Mapping of str to str
        What the numbers are made of.
    headlines : Sequence of Headline
        Each becomes an object in full precision; null if there is no interval, or no value of the
        draft.
    missing : Mapping or None
        What else the summary has, such as the missing trials and results.
    """
    numbers: dict[str, dict[str, Any]] = {}
    for headline in headlines:
        if headline.is_macro_only:
            continue
        fields = asdict(headline)
        for name in ("name", "macro", "is_macro_only"):
            del fields[name]
        numbers[headline.name] = fields
    content = {**about, **(missing or {}), "numbers": numbers}
    return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def to_tex(
    about: Mapping[str, str], headlines: Sequence[Headline], remarks: Sequence[str] = ()
) -> str:
    r"""Write headline numbers as LaTeX macros such as `\oslBeltStiffness`, rounded, without unit.

    Parameters
    ----------
    about : Mapping of str to str
        What the numbers are made of: `\oslData`, `\oslCampaign` ...
    headlines : Sequence of Headline
        `Low` and `High` are added where there is an interval.
    remarks : Sequence of str
        Comments at the begin.

    Returns
    -------
    str
        Each line ends in a comment, so that reading the file puts no space into the text.
    """
    lines = [
        f"% {sentence(about)}",
        "% Headline numbers by osl-analysis; \\input this file and use the macros.",
    ]
    lines += [f"% {remark}" for remark in remarks]
    for name, value in about.items():
        lines.append(tex_macro(ABOUT_MACROS[name], in_latex(value), ABOUT_MEANING[name]))
    for headline in headlines:
        lines += tex_macros(headline)
    return "\n".join(lines) + "\n"


def tex_macros(headline: Headline) -> list[str]:
    """The macros of one number: its value, the ends of its interval and of the fits to single
    amplitudes, its verdict."""
    fields = asdict(headline)
    places = places_of(fields)
    comment = f"{headline.unit}, {headline.meaning}"
    if headline.n_doubtful or headline.doubt:
        comment += f", n = {trials_text(fields)}"
    kind = headline.interval
    numbers = {
        "": (headline.value, places.value, comment),
        "Low": (headline.low, places.ends, f"low end: {kind}"),
        "High": (headline.high, places.ends, f"high end: {kind}"),
        "AmplitudesLow": (
            headline.amplitudes_low,
            places.value,
            "lowest of the fits to single amplitudes",
        ),
        "AmplitudesHigh": (
            headline.amplitudes_high,
            places.value,
            "highest of the fits to single amplitudes",
        ),
    }
    lines = []
    for ending, (number, digits, remark) in numbers.items():
        if number is not None:
            lines.append(tex_macro(f"{headline.macro}{ending}", tex_number(number, digits), remark))
    if headline.verdict:
        lines.append(tex_macro(f"{headline.macro}Verdict", headline.verdict, "verdict"))
    return lines


def tex_macro(name: str, text: str, comment: str) -> str:
    return f"\\newcommand{{\\osl{name}}}{{{text}}}% {comment}"


def tex_number(number: float, digits: int) -> str:
    """A rounded number that reads the same in text and in mathematics: with a true minus, small
    ones with a power of ten."""
    text, _, power = fixed(number, digits).partition("e")
    if power:
        text += rf"\times 10^{{{int(power)}}}"
    if power or text.startswith("-"):
        text = rf"\ensuremath{{{text}}}"
    return text


def to_table(numbers: Mapping[str, Mapping[str, Any]], markdown: bool) -> str:
    """The numbers of a summary, as `to_json` writes them, in Markdown or aligned columns: meaning,
    value, interval, trials, the draft's value."""
    rows: list[tuple[str, ...]] = [("quantity", "value", "interval", "n", "draft")]
    beside_draft = any(number["draft"] is not None for number in numbers.values())
    for number in numbers.values():
        written = written_number(number)
        interval = ""
        if written.interval:
            interval = f"{written.interval}, {number['interval']}"
        if written.single_amplitudes:
            interval += f"; single amplitudes {written.single_amplitudes}"
        if number.get("verdict"):
            interval += f"{'; ' if interval else ''}{number['verdict']}"
        draft = "" if number["draft"] is None else f"{number['draft']:g}"
        value = f"{written.value} {number['unit']}"
        rows.append((number["meaning"], value, interval, trials_text(number), draft))
    if not beside_draft:
        rows = [row[:-1] for row in rows]
    return markdown_table(rows) if markdown else aligned(rows)


def markdown_table(rows: Sequence[Sequence[str]]) -> str:
    """Rows as a table in Markdown; the first row is the head."""
    text = ""
    for cells in (rows[0], ["---"] * len(rows[0]), *rows[1:]):
        escaped = [cell.replace("|", "\\|") for cell in cells]
        text += f"| {' | '.join(escaped)} |\n"
    return text


def aligned(rows: Sequence[Sequence[str]]) -> str:
    """Rows with the same number of cells as lines with aligned columns."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    text = ""
    for cells in rows:
        padded = [cell.ljust(width) for cell, width in zip(cells, widths, strict=True)]
        text += f"{'  '.join(padded).rstrip()}\n"
    return text


class WrittenNumber(NamedTuple):
    """A rounded number as text."""

    value: str
    interval: str  # as `1 to 2`; empty: there is none
    single_amplitudes: str  # the range over single amplitudes; empty: there is none


def written_number(number: Mapping[str, Any]) -> WrittenNumber:
    """Write a number of a summary with as many digits as its interval allows."""
    places = places_of(number)
    interval = range_text(number["low"], number["high"], places.ends)
    single = range_text(number.get("amplitudes_low"), number.get("amplitudes_high"), places.value)
    return WrittenNumber(fixed(number["value"], places.value), interval, single)


def range_text(low: float | None, high: float | None, digits: int) -> str:
    if low is None or high is None:
        return ""
    return f"{fixed(low, digits)} to {fixed(high, digits)}"


MOST_IN_SENTENCE = 3  # numbers; of more only the two extremes are written


def first_sentences(numbers: Sequence[Mapping[str, Any]]) -> list[str]:
    """A sentence per `begins`, with each number and its `of`; of many numbers, only the two
    extremes."""
    by_begin: dict[str, list[Mapping[str, Any]]] = {}
    for number in numbers:
        if number["begins"]:
            by_begin.setdefault(number["begins"], []).append(number)
    sentences = []
    for begins, of_sentence in by_begin.items():
        separator = ", "
        if len(of_sentence) > MOST_IN_SENTENCE:
            lowest = min(of_sentence, key=lambda number: float(number["value"]))
            highest = max(of_sentence, key=lambda number: float(number["value"]))
            of_sentence = [lowest, highest]
            separator = " to "
        parts = [number_in_sentence(number) for number in of_sentence]
        sentences.append(f"{begins} {separator.join(parts)}.")
    return sentences


def number_in_sentence(number: Mapping[str, Any]) -> str:
    """A number with unit, and in brackets what it is of, its interval and its trials."""
    texts = number_texts(number)
    ends = texts["ends"]
    if number["interval"] == RANGE:
        ends = f"{RANGE} {ends}"
    remarks = filter(None, [number["of"], ends, f"n = {texts['behind']}"])
    return f"{texts['text']}\N{NO-BREAK SPACE}{texts['unit']} ({'; '.join(remarks)})"


def number_texts(number: Mapping[str, Any]) -> dict[str, str]:
    """`text`, `unit` and `ends` of a number for a reader, the `kind` of these, and the trials
    `behind` it. No digits if 0 is in the interval."""
    written = written_number(number)
    low, high = number["low"], number["high"]
    value = written.value
    is_confidence_interval = number["interval"] not in (None, RANGE, COUNT)
    if is_confidence_interval and low is not None and low <= 0 <= high:
        value = "≈ 0"
    ends = written.interval
    kind = number["interval"] or ""
    if not ends:
        ends = written.single_amplitudes
        kind = "single amplitudes" if ends else ""
    return {
        "text": printed(value),
        "ends": printed(ends),
        "kind": kind,
        "unit": printed(number["unit"]),
        "behind": trials_text(number).replace("DOUBTFUL", "doubtful"),
    }


def trials_text(number: Mapping[str, Any]) -> str:
    """Number of trials or fits behind a number, doubtful ones in it or left out, and why it is
    doubtful itself."""
    if number.get("doubt"):
        return f"{number['n']}, DOUBTFUL: {number['doubt']}"
    n = int(number.get("n") or 0)
    n_doubtful = int(number.get("n_doubtful") or 0)
    n_left_out = int(number.get("n_left_out") or 0)
    if n_left_out:
        return f"{n} of {n + n_left_out}, {n_left_out} doubtful left out"
    if not n_doubtful:
        return str(n)
    return f"{n}, {n_doubtful} of them doubtful" if n > 1 else f"{n}, doubtful"
