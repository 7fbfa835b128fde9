# SPDX-License-Identifier: Apache-2.0
"""Rounding of results: an interval keeps two digits, and its number as many decimal places.

Example: `written(300.123, 298.71, 301.55)` is `300.1 (298.7 to 301.6)`.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import ROUND_CEILING, Context, Decimal
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


def raised_to(places: int, size: float) -> str:
    """A size rounded up to so many decimal places. What differs in the tenth digit is rounding."""
    step = Decimal(1).scaleb(-places)
    return f"{Decimal(significant(size, 9)).quantize(step, ROUND_CEILING):f}"


NOTHING = "–"


def plus_minus(places: int, value: float, low: float | None, high: float | None) -> str:
    """A number with its half-width, both with so many decimal places, as `300.1 ± 1.4`.

    It has both ends in place of the half-width where it is not in their middle, and stands alone
    without an interval.
    """
    return rounded_to(places, value, low, high).short


@dataclass(frozen=True)
class PrintedNumber:
    """A number with its interval as readers see it, or a dash for none."""

    value: str
    half_width: str = ""  # of its interval; empty where the number is not in its middle
    ends: tuple[str, str] | None = None  # of its interval, where the digits show them
    mark: str = ""  # † of a doubtful number

    @property
    def text(self) -> str:
        """With both ends of the interval: `300.1 (298.7 to 301.6)`."""
        if self.ends is None:
            return self.short
        low, high = self.ends
        return f"{self.value} ({low} to {high}){self.mark}"

    @property
    def short(self) -> str:
        """Where there is less room: `300.1 ± 1.4`."""
        if self.half_width:
            return f"{self.value} ± {self.half_width}{self.mark}"
        return f"{self.value}{self.mark}" if self.ends is None else self.text

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True)
class PrintedRange:
    """The ends of a range as readers see them."""

    low: str
    high: str

    def __str__(self) -> str:
        return f"{self.low} to {self.high}"


def printed_number(
    value: float | None,
    low: float | None = None,
    high: float | None = None,
    unit: str = "",
    half_range: float = 0.0,
) -> PrintedNumber:
    """A number and its interval, both rounded as the interval allows.

    Where half of its range over the motion is larger than half of its interval, the range decides
    on the digits, and the half-width is rounded up (JCGM 100:2008, 7.2.6): 296.744 ± 0.0073 with a
    range from 294 to 297 is `296.7 ± 0.1`.
    """
    if value is None:
        return PrintedNumber(NOTHING)
    half_width = 0.0 if low is None or high is None else (high - low) / 2
    if half_range > half_width:
        places = places_of(half_range, 2)
        half_text = raised_to(places, half_width) if half_width else ""
        return PrintedNumber(to_places(places, value)[0], half_text)
    return rounded_to(decimal_places(value, low, high, unit), value, low, high)


def rounded_to(places: int, value: float, low: float | None, high: float | None) -> PrintedNumber:
    """A number and its interval with so many decimal places."""
    text = f"{value:z.{places}f}"
    if low is None or high is None:
        return PrintedNumber(text)
    low_text, high_text = to_places(places, low, high)
    half_width = (high - low) / 2
    is_in_middle = abs(value - low - half_width) <= 10**-places
    half_text = f"{half_width:.{places}f}" if is_in_middle else ""
    return PrintedNumber(text, half_text, (low_text, high_text))


def printed_range(low: float, high: float, value: float) -> PrintedRange:
    """A range with one digit of its half, or with two where its ends would exclude the value that
    it is of."""
    half_range = (high - low) / 2
    if half_range == 0:
        places = decimal_places(value)
        return PrintedRange(*to_places(places, low, high))
    places = places_of(half_range, 1)
    if not round(low, places) <= value <= round(high, places):
        places = places_of(half_range, 2)
    return PrintedRange(*to_places(places, low, high))


def written(
    value: float | None, low: float | None = None, high: float | None = None, unit: str = ""
) -> str:
    """A number as `300.1 (298.7 to 301.6)`, or a dash for none."""
    return printed_number(value, low, high, unit).text


def estimate_text(row: Mapping[str, Any], name: str, unit: str = "") -> str:
    """An estimate of a row of a result table with its 95 % interval, as far as it has them."""
    return written(row.get(name), row.get(f"{name}_low"), row.get(f"{name}_high"), unit)
