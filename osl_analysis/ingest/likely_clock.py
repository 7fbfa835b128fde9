"""What tells a clock: its name, its readings, its unit, and what the text of a file says of rates.

Names and readings make a clock likely, for a draft and for a check beside the stated time. None of
them is ever taken for the time of a recording unasked."""

import re
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.trial import Array
from osl_analysis.units import base_units, dimension, is_clock, name_and_ending, normalised

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # [s], of clocks
LONG_UNITS = (60.0, 3600.0, 86_400.0)  # [s], of clocks of programs of tables
OVERFLOWS = (8, 16, 24, 32)  # bits of the counters of microcontrollers
RECORDED_HZ = (50.0, 5000.0)  # rates of recorders of joints: less than a factor of 1000
FEWEST_TICKS = 20  # readings that show whether a column rises like a clock
EVEN_STEP = 0.2  # a step differs from the median by less than this share of it
EVEN_SHARE = 0.8  # of the steps of a clock are even


def is_like_clock(name: str) -> bool:
    """Whether a column may be a clock by its name, such as `LabVIEW time`, `Date` or `sec`. Its
    readings decide."""
    last = re.split(r"[./]", name)[-1]
    if is_clock(last):
        return True
    return re.search(r"(?i)time|date|clock|stamp|zeit|^[mu]?secs?$", last) is not None


def tells_time(name: str, unit: str) -> bool:
    """Whether a column is a clock by its name or its unit."""
    return is_like_clock(name) or is_of_time(unit or likely_unit(name))


def is_of_time(unit: str) -> bool:
    """Whether a unit is a unit of time, or a multiple of one, such as `second` and `10 us`."""
    spelled = re.sub(r"^\d+\*?", "", normalised(unit))
    if spelled in TIME_UNITS:
        return True
    known = base_units(spelled) if spelled else None
    return known is not None and known[1] == dimension("s")


def likely_unit(name: str) -> str:
    """The unit that a column's name implies: by its ending (`ankle_deg`), or as a clock (`millis`);
    else empty."""
    ending = name_and_ending(name)[1]
    return ending or {"millis": "ms", "ms": "ms", "micros": "us", "us": "us"}.get(name, "")


def unwrapped(readings: NDArray[Any]) -> tuple[NDArray[Any], int, int]:
    """Let a counter that overflowed at a power of two go on.

    A step back is an overflow if adding that power makes it about as short as the other steps.

    Parameters
    ----------
    readings
        Shape (n,).

    Returns
    -------
    readings
        Shape (n,), without overflows.
    bits
        Size of the counter; 0 if it did not overflow.
    turns
        How often it overflowed.
    """
    steps = np.diff(readings.astype(np.float64))
    goes_back = steps < 0
    are_counts = bool((readings == np.rint(readings)).all())
    if goes_back.any() and are_counts and (steps > 0).any():
        usual = float(np.median(steps[steps > 0]))
        turns = np.append(0, np.cumsum(goes_back))
        for bits in OVERFLOWS:
            across = steps[goes_back] + 2.0**bits
            if (across >= 0).all() and (across <= 10 * usual).all():
                return readings.astype(np.int64) + turns * 2**bits, bits, int(turns[-1])
    return readings, 0, 0


def ticks(values: NDArray[Any], unit: str) -> bool:
    """Whether readings (n,) rise like a clock, apart from counter overflows. Without a unit,
    `time_unit` must find one that fits."""
    known = values[np.isfinite(values)]
    steps = np.diff(unwrapped(known)[0])
    if steps.size < FEWEST_TICKS or not (steps >= 0).all():
        return False
    usual = float(np.median(steps))
    if not usual > 0 or float(np.mean(np.abs(steps / usual - 1) < EVEN_STEP)) <= EVEN_SHARE:
        return False
    return bool(is_of_time(unit) if unit else time_unit(values))


def rate_of(time: NDArray[Any], second: float = 1.0) -> float | None:
    """Median rate [Hz] of stamps (n,), with `second` units per second; None if no stamp is later
    than another."""
    steps = np.diff(time)
    steps = steps[steps > 0]
    return second / np.median(steps) if steps.size else None


def time_unit(clock: Array) -> str:
    """The likely unit of the readings (n,) of a clock; else empty.

    Recorders of joints run at `RECORDED_HZ`: only one unit gives such a rate. Readings that rise
    by one are left out: they may count rows, or be the whole seconds of a stamp in two parts.
    """
    rate = rate_of(clock)
    steps = np.diff(clock)
    counts_rows = bool(np.isin(steps, (0, 1)).all())
    counts_seconds = rate == 1 and bool((steps == np.rint(steps)).all())
    if rate is None or clock.size < FEWEST_TICKS or counts_rows or counts_seconds:
        return ""
    lowest, highest = RECORDED_HZ
    per_second = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9, "d": 1 / 86_400}
    for unit, factor in per_second.items():
        if lowest <= rate * factor <= highest:
            return unit
    return ""


NUMBER = r"(\d+(?:[.,]\d+)*(?:e[+-]?\d+)?)"
OF_ROWS = (
    r"(?:sampl\w*|scan|acquisition|recording|data|output)["
    r" _]*(?:rate|frequency|freq)|fs\b|^(?:rate|frequency)\b"
    r"|abtast(?:rate|frequenz)|fr\w+ d.\w*chantillonnage"
)
INTERVAL = (
    rf"(?i)\b(?:delta_x|dt|(?:sampl\w*[ _]*)?(?:interval|period))\b\D*?{NUMBER}(?:\s*([mu]?)s\b)?"
)
NOT_OF_ROWS = (
    r"(?i)decimat|(down|sub|over)-?sampl|\bevery\W+(\d|other|second|n)|averag(ing|ed)|\bthinn"
    r"|\b(device|internal|sensor|adc|emg|hardware)\b.*(rate|freq)"
)
RATE_ALONE = r"[\s:=\x22[]*(\d{2,5}(?:\.\d*)?)(?:$|[\]};]|, )"
RATE_IN_WORDS = rf"(?i)\b(?:{OF_ROWS})(?:\D*?{NUMBER}\s*(k?)(?:hz|s/s|sps)|{RATE_ALONE})"


def stated_rate(texts: Sequence[str]) -> float | None:
    """The rate of the rows [Hz] that texts state, such as `Sample rate: 500 Hz` or LabVIEW's
    `Delta_X`. None if they state several, or mention a device or a decimation: the rate may then
    not be that of the rows."""
    rates: set[float] = set()
    for text in texts:
        if re.search(NOT_OF_ROWS, text):
            return None
        interval = re.search(INTERVAL, text)
        step = number_in(interval[1]) if interval else 0.0
        if interval and step > 0:
            seconds = step * TIME_UNITS[(interval[2] or "") + "s"]
            rates.add(float(f"{1 / seconds:.9g}"))
            continue
        words = re.search(RATE_IN_WORDS, text)
        if words:
            kilo = 1000 if words[2] else 1
            rates.add(number_in(words[1] or words[3]) * kilo)
    if len(rates) == 1 and 1 < min(rates) < 1e6:
        return rates.pop()
    return None


def number_in(text: str) -> float:
    """The number in a text with a decimal point or comma, or with thousands separators, as `1,000`;
    0 if none."""
    if re.fullmatch(r"[1-9]\d{0,2}(,\d{3})+(\.\d*)?", text):
        text = text.replace(",", "")
    with suppress(ValueError):
        return float(text.replace(",", "."))
    return 0.0


def span_ratio(span: float, other: float, more_units: Sequence[float] = LONG_UNITS) -> float:
    """Ratio of two spans of time in unknown units: the one nearest to 1 over all units of time and
    those of `more_units` [s]."""
    units = np.array([*TIME_UNITS.values(), *more_units])
    ratios = np.divide.outer(units, units).ravel() * span / other
    return float(ratios[np.argmin(np.abs(np.log(ratios)))])
