# SPDX-License-Identifier: Apache-2.0
"""Rounding of results: an interval keeps two digits, and its number as many decimal places.

Example: `written(300.123, 298.71, 301.55)` is `300.1 (298.7 to 301.6)`.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import ROUND_CEILING, Context
from typing import Any

import numpy as np


def significant(value: float, digits: int = 2) -> str:
    """Write a number with `digits` significant digits for a sentence: -720 and 0.00012, never
    -7.2e+02."""
    return np.format_float_positional(value, digits, unique=False, fractional=False, trim="-")


def rounded_up(value: float) -> str:
    """Write a bound with two significant digits: 2.4028 is within 2.5. What differs in the tenth
    digit is rounding."""
    return f"{Context(2, ROUND_CEILING).create_decimal(significant(value, 9)):f}"


def decimal_places(
    value: float, low: float | None = None, high: float | None = None, unit: str = ""
) -> int:
    """Decimal places for a number.

    They keep two digits of the half-width. Without an interval they keep three digits of the
    number; of a percentage near 100, two digits of the difference to 100; of a whole number, none.
    """
    half = 0.0 if low is None or high is None else abs(high - low) / 2
    if half > 1e-9 * abs(value):
        return places_of(half, 2)
    if value == round(value):
        return 0
    to_100 = 100 - value
    if unit == "%" and 1e-6 < to_100 < 1:  # less is rounding; more shows in three digits
        return places_of(to_100, 2)
    return places_of(abs(value), 3)


def places_of(size: float, digits: int) -> int:
    """Decimal places that leave so many significant digits of a size."""
    return max(digits - 1 - math.floor(math.log10(size)), 0)


def to_places(places: int, *numbers: float | None) -> list[str]:
    """Numbers with so many decimal places; empty for none."""
    return ["" if number is None else f"{number:z.{places}f}" for number in numbers]


NOTHING = "–"


def plus_minus(places: int, value: float, low: float | None, high: float | None) -> str:
    """A number with its half-width, both with so many decimal places, as `300.1 ± 1.4`.

    It has both ends in place of the half-width where it is not in their middle, and stands alone
    without an interval.
    """
    if low is None or high is None:
        return f"{value:z.{places}f}"
    half = (high - low) / 2
    if abs(value - low - half) > 10**-places:
        return "{} ({} to {})".format(*to_places(places, value, low, high))
    return f"{value:z.{places}f} ± {half:.{places}f}"


@dataclass(frozen=True)
class PrintedNumber:
    """A number with its interval as readers see it, or a dash for none."""

    text: str  # with both ends of the interval: `300.1 (298.7 to 301.6)`
    short: str  # where there is less room: `300.1 ± 1.4`

    def __str__(self) -> str:
        return self.text


def printed_number(
    value: float | None, low: float | None = None, high: float | None = None, unit: str = ""
) -> PrintedNumber:
    """A number and its interval, both rounded as the interval allows."""
    if value is None:
        return PrintedNumber(NOTHING, NOTHING)
    places = decimal_places(value, low, high, unit)
    short = plus_minus(places, value, low, high)
    if low is None or high is None:
        return PrintedNumber(short, short)
    return PrintedNumber("{} ({} to {})".format(*to_places(places, value, low, high)), short)


def written(
    value: float | None, low: float | None = None, high: float | None = None, unit: str = ""
) -> str:
    """A number as `300.1 (298.7 to 301.6)`, or a dash for none."""
    return printed_number(value, low, high, unit).text


def estimate_text(row: Mapping[str, Any], name: str, unit: str = "") -> str:
    """An estimate of a row of a result table with its 95 % interval, as far as it has them."""
    return written(row.get(name), row.get(f"{name}_low"), row.get(f"{name}_high"), unit)
