"""One headline number with its interval, and how numbers come from the columns of tables."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from itertools import count

import numpy as np
import polars as pl

from osl_analysis.about import ABOUT_MACROS
from osl_analysis.doubtful import doubtful_count
from osl_analysis.errors import InputError
from osl_analysis.summary.labels import Label
from osl_analysis.trial import Array

STUDENT = "95 % of the mean (Student)"
FIT = "95 % of the fit (its noise; without errors of the model)"
BOOTSTRAP = "95 % (bootstrap over crossings and trials of the unloaded plate)"
CYCLES = "95 % of the mean of cycles (Student)"
PAIRED = "95 % of the mean difference of the same trials (Student)"
RANGE = "lowest to highest"
COUNT = "count"
RESERVED = ABOUT_MACROS.values()
"""Macros that are no numbers."""
ENDINGS = ("", "Low", "High", "AmplitudesLow", "AmplitudesHigh")
"""Endings of the macros of a number and its bounds."""


@dataclass(frozen=True)
class Interval:
    """Bounds of a number, in its unit."""

    low: float | None
    high: float | None
    kind: str


@dataclass(frozen=True)
class Headline(Label):
    """A headline number."""

    value: float
    """In `unit`."""
    low: float | None
    high: float | None
    interval: str | None
    """Kind of the interval; None if there is none."""
    n: int
    """Number of trials or fits that the number is computed from."""
    n_doubtful: int = 0
    """Number of doubtful trials or fits among those that could be in the number."""
    n_left_out: int = 0
    """Number of these that are not in it."""
    doubt: str | None = None
    """Why the number itself is doubtful; None if it is not, or not judged."""
    amplitudes_low: float | None = None
    """Lowest result of the fits to single amplitudes; None if there are none."""
    amplitudes_high: float | None = None
    """Highest result of the fits to single amplitudes; None if there are none."""


def said_of(numbers: Iterable[Headline], candidates: pl.DataFrame, used: pl.DataFrame | None = None) -> list[Headline]:
    """The numbers with the count of doubtful rows among their candidates, and of those that are not in `used`.

    A VAF uses all rows: to leave out fits that are doubtful for a low VAF would raise it.
    """
    left_out = 0 if used is None else len(candidates) - len(used)
    return [replace(n, n_doubtful=doubtful_count(candidates)[0], n_left_out=left_out) for n in numbers]


def over_fits(label: Label, values: pl.Series, middle: Callable[[Array], np.floating]) -> list[Headline]:
    """Mean or median of the finite values, with their range if there are several. Empty without finite values."""
    finite = values.filter(values.is_finite()).to_numpy()
    if not len(finite):
        return []
    low, high = (float(finite.min()), float(finite.max())) if len(finite) > 1 else (None, None)
    return [headline(label, float(middle(finite)), len(finite), Interval(low, high, RANGE))]


def headline(label: Label, value: float, n: int, interval: Interval) -> Headline:
    """A number, without an interval where a bound is missing (a single trial has no scatter)."""
    if interval.low is None or interval.high is None or not np.isfinite([interval.low, interval.high]).all():
        return Headline(**asdict(label), value=value, low=None, high=None, interval=None, n=n)
    return Headline(**asdict(label), value=value, low=interval.low, high=interval.high, interval=interval.kind, n=n)


def summary_means(table: pl.DataFrame, labels: Mapping[str, Label], interval: str = STUDENT) -> list[Headline]:
    """The labelled quantities that a summary table lists, with their intervals."""
    rows = {row["quantity"]: row for row in table.iter_rows(named=True)}
    numbers = []
    for quantity, label in labels.items():
        if quantity not in rows:
            continue
        n, mean, low, high = (rows[quantity][column] for column in ("n", "mean", "low", "high"))
        if mean is None or not math.isfinite(mean):
            raise InputError(
                f"summary table: the mean of '{quantity}' is {mean}; look for a fit without a result in its trials"
            )
        found = headline(label, mean, int(n), Interval(low, high, interval))
        doubtful, left_out = (int(rows[quantity].get(column) or 0) for column in ("n_doubtful", "n_left_out"))
        doubt = rows[quantity].get("doubt") or None
        numbers.append(replace(found, n_doubtful=doubtful, n_left_out=left_out, doubt=doubt))
    return numbers


def label_of(number: Headline) -> Label:
    """The label of a number."""
    return Label(**{field.name: getattr(number, field.name) for field in fields(Label)})


def with_own_names(numbers: Sequence[Headline]) -> list[Headline]:
    """The numbers with names and macros that no other one has, with its endings; the first one keeps its own.

    Different names of a campaign may have the same letters: the second `PD 1` and `PD-1` becomes `PDOneB`.
    """
    names, macros, found = set[str](), set[str](RESERVED), []
    for number in numbers:
        name = next(free for k in count(1) if (free := number.name + (f" ({k})" if k > 1 else "")) not in names)
        macro = next(free for k in count() if not macros & with_endings(free := number.macro + "B" * k))
        names.add(name)
        macros |= with_endings(macro)
        found.append(replace(number, name=name, macro=macro))
    return found


def with_endings(macro: str) -> set[str]:
    """A macro and those of its bounds."""
    return {macro + ending for ending in ENDINGS}


def over_all_amplitudes(table: pl.DataFrame) -> pl.DataFrame:
    """The rows that were fitted to all amplitudes of their trial together."""
    return table.filter(pl.col("amplitude_deg").is_null())
