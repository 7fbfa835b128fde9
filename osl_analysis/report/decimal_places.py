"""How many decimal places a number has in print: as many as its interval, its range over single
amplitudes, or the scatter of trials allows."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

RANGE = "lowest to highest"  # kind of an interval that does not show the precision
COUNT = "count"  # kind of a number without decimals

EVEN = 1.1  # ratio of an interval's sides below which it is printed with a ±
NO_WIDTH = 1e-9  # relative width below which an interval is only rounding
FINEST_CALIBRATION = 1e-3  # of a number: no torque is calibrated better, whatever its interval is
MOST_FURTHER_PLACES = 2  # beyond those of `decimals`, that keep a value between its ends


@dataclass(frozen=True)
class Bounds:
    """By what a number is rounded, in its unit.

    Attributes
    ----------
    low, high
        Ends of an interval or a range; None: there are none.
    interval
        Kind of the interval; None: not told.
    scatter
        Standard deviation between trials; None: unknown.
    """

    low: float | None
    high: float | None
    interval: str | None = None
    scatter: float | None = None


class Places(NamedTuple):
    """Decimal places."""

    value: int  # of a number
    ends: int  # of the ends of its interval


def digits_of(value: float, low: float | None, high: float | None) -> Places:
    """Decimal places of a number that is rounded by its interval, and of the ends."""
    return places_between(value, low, high, Bounds(low, high))


def decimals(value: float, bounds: Bounds) -> int:
    """Decimal places of a written number. Half its interval keeps two digits; without an interval
    it has three digits. The trials' scatter, or a thousandth of the number, keeps one. With a
    range, which does not show the precision, it has three digits, at most one beyond the range's
    two, or more until the ends differ. A count has no decimals."""
    if bounds.interval == COUNT:
        return 0
    three_digits = 2 - exponent_of(value) if value else 0
    low, high = bounds.low, bounds.high
    half = 0.0 if low is None or high is None else abs(high - low) / 2
    if half <= NO_WIDTH * abs(value):
        return max(three_digits, 0)
    if bounds.interval == RANGE:
        beyond_range = 2 - exponent_of(half)
        return told_apart(low, high, max(min(three_digits, beyond_range), 0))
    coarsest = max(FINEST_CALIBRATION * abs(value), bounds.scatter or 0.0, np.finfo(float).tiny)
    return max(min(1 - exponent_of(half), -exponent_of(coarsest)), 0)


def places_between(value: float, low: float | None, high: float | None, bounds: Bounds) -> Places:
    """Decimal places of a number and of its ends, so that it reads as lying between two different
    ends: `decimals`, and up to two more if rounding would put it on or beyond an end."""
    digits = decimals(value, bounds)
    if low is None or high is None:
        return Places(digits, digits)
    has_width = high - low > NO_WIDTH * abs(value)
    finer = told_apart(low, high, digits)
    if bounds.interval == RANGE and has_width:
        two_digits_of_half = 1 - exponent_of((high - low) / 2)
        finer = told_apart(low, high, max(min(digits, two_digits_of_half), 0))
    if not has_width or not low < value < high:
        return Places(digits, finer)
    for _ in range(MOST_FURTHER_PLACES):
        written = float(fixed(value, digits))
        if float(fixed(low, finer)) < written < float(fixed(high, finer)):
            break
        finer += 1
        if not low < written < high:
            digits = finer
    return Places(digits, finer)


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


LARGEST_WITH_POWER = 1e-4  # numbers up to it are written with a power of ten


def fixed(number: float, digits: int) -> str:
    """The number with `digits` decimal places, a small one with a power of ten; never a minus
    before zero."""
    text = f"{number:.{digits}f}"
    rounded = float(text)
    if rounded == 0:
        return text.removeprefix("-")
    if abs(rounded) > LARGEST_WITH_POWER:
        return text
    return f"{number:.{max(digits + exponent_of(rounded), 0)}e}"
