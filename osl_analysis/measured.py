"""Which numbers can be a measurement, and the steps to which signals are rounded: a fit refuses what can be none before
it overflows, vanishes or turns into NaN."""

import math

import numpy as np
from numpy.typing import ArrayLike

from osl_analysis.errors import InputError
from osl_analysis.trial import Array

LARGEST_VARIANCE = 1e150  # its square is finite
EXACT_FIT_SHARE = 1e-24
"""Mean square of the rounding error of an exact fit, as a share of that of y. Whether an exact fit leaves 0 or 1e-16
depends on the processor's kernels; nothing may depend on which."""


def significant(value: float, digits: int = 2) -> str:
    """A number with so many significant digits for a sentence: -720 and 0.00012, never -7.2e+02."""
    return np.format_float_positional(value, digits, unique=False, fractional=False, trim="-")


def check_finite(name: str, values: ArrayLike, limit: float = 1e30, least: float = 0.0) -> None:
    """Refuse numbers, of any shape, of which one is not finite or beyond the limit, or all are below `least` without
    being 0 throughout. `name` is for the message."""
    array = np.asarray(values)
    largest = float(np.abs(array).max(initial=0.0))
    no_sensor = "no sensor gives that; check its channel and unit in the source file, and the bytes of the log"
    if not np.isfinite(largest):
        row = int(np.argmin(np.isfinite(array).ravel()))
        raise InputError(f"{name} is not finite at sample {row}; repair the log, or cut it there")
    if largest > limit:
        raise InputError(f"{name} reaches {largest:.3g}, more than {limit:g}: {no_sensor}")
    if 0 < largest < least:
        raise InputError(f"{name} reaches {largest:.3g}, less than {least:g} and not 0: {no_sensor}")


def check_measured(name: str, values: ArrayLike) -> None:
    """Refuse a signal, of any shape, that no sensor can have given. In SI units no signal of a laboratory comes near
    1e30 or 1e-30, and within them a squared variance of a quotient of two signals, the largest power that any estimate
    needs, neither overflows nor vanishes."""
    check_finite(name, values, least=1e-30)


def rounding_of(y: Array) -> float:
    """Mean square of what rounding alone leaves of an exact fit to y (n,), in its squared unit; 0 for no samples."""
    return EXACT_FIT_SHARE * float(y @ y) / len(y) if len(y) else 0.0


def varies(y: Array) -> bool:
    """Whether y (n,) varies by more than its rounding. A constant 0.1 has a variance of 2e-34, not of 0."""
    return bool(len(y)) and float(np.var(y)) > rounding_of(y)


def usual_size(values: Array) -> float:
    return float(np.median(np.abs(values)))


def rms(values: Array) -> float:
    """Root of the mean square of all values."""
    return float(np.sqrt(np.mean(values**2)))


def factor_of(y: Array, x: Array) -> float | None:
    """The factor by which y (n,) is another signal x (n,), but for an offset and the rounding of both, or a thousandth
    of y; None if it is not. What two sensors measure differs by more, even if one follows the other closely."""
    known = np.isfinite(y) & np.isfinite(x) if len(y) == len(x) else np.zeros(0, dtype=bool)
    if np.count_nonzero(known) < 10 or not (np.any(y[known]) and np.any(x[known])):
        return None
    of_y, of_x = (float(np.max(np.abs(one[known]))) for one in (y, x))  # squares of any signal then are numbers
    y, x = y[known] / of_y, x[known] / of_x
    if not (varies(y) and varies(x)):
        return None
    y, x = y - y.mean(), x - x.mean()
    factor = float(x @ y) / float(x @ x)
    step_y, step_x = (float(np.median(np.diff(np.unique(one)))) for one in (y, x))
    rounding = 1.2 * math.hypot(step_y, factor * step_x) / math.sqrt(12)
    is_same = rms(y - factor * x) <= max(1e-3 * rms(y), min(rounding, 0.01 * rms(y)))
    return factor * of_y / of_x if is_same else None


def visible_step(values: Array) -> float | None:
    """The step to which a signal (n,) was rounded, in its unit, between distinct values. None if it is not seen (more
    than half of the values are distinct, or less than 99 % of the differences are a whole number of steps), and for a
    signal that is constant, empty or not finite."""
    if not len(values) or not np.isfinite(values).all():
        return None
    distinct = np.unique(values)
    if not 2 <= len(distinct) <= len(values) // 2:
        return None
    apart = np.diff(distinct)
    apart = apart[apart > 1e-9 * (distinct[-1] - distinct[0])]  # nearer ones are one, converted with another error
    if len(apart) < 2:
        return None
    step = float(np.median(apart[apart < 1.5 * np.min(apart)]))
    off = np.abs(apart / step - np.rint(apart / step))
    return step if float(np.mean(off < 0.02)) >= 0.99 else None
