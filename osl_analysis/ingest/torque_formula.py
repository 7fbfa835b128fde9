"""Of which signals of a log a torque was computed: a fit of it gives the program's formula back.

A load cell has noise of its own. So no measured torque is a function of angle, speed and current in
all of its digits. The deflection of a spring between two encoders is a measurement of torque."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from osl_analysis.measured import factor_of, rms, varies, visible_step
from osl_analysis.trial import Array

Kind = Literal["angle", "speed", "current", "other"]
MOST_ROWS = 2000  # that are compared
FEWEST_ROWS = 200
MOST_SIGNALS = 8
MOST_REPEATED = 20_000  # rows in which an angle may come back
FEWEST_REPEATED = 100  # angles that come back
APART = 20  # rows between them
HIGHEST_POWER = 5  # of an angle
MOST_DIGITS = 9  # decimal places that are looked for
LARGEST_ROUNDING = 2e-4  # of the torque's RMS; a coarser log tells no formula
SMALLEST_ROUNDING = 1e-10  # the same, which arithmetic leaves
OVER_ROUNDING = 1.5  # times what rounding leaves, for its scatter
OUTSIDE = 0.02  # share of the rows in which rounding may turn the sign of a speed
TERM = 100.0  # times what rounding leaves, from which a term belongs to the formula


@dataclass(frozen=True)
class Signal:
    """A signal from which a torque may have been computed."""

    name: str
    kind: Kind
    values: Array  # (n,) in any unit
    is_command: bool = False


@dataclass(frozen=True)
class Term:
    """A term of a formula."""

    of: tuple[int, ...]  # the signals in it, by place
    column: Array  # (n,)
    is_linear: bool = False


def computed_from(torque: Array, signals: Sequence[Signal]) -> str:
    """Tell of which signals a torque is a function to within rounding.

    Parameters
    ----------
    torque : Array
        (n,) in any unit.
    signals : sequence of Signal
        In the same rows.

    Returns
    -------
    str
        The formula; the names of the signals where it has other factors than constants; empty for a
        torque that is measured, or where the log is too coarse to tell.
    """
    everywhere = signals
    some = np.arange(0, len(torque), max(len(torque) // MOST_ROWS, 1))
    is_known = np.isfinite(torque[some])
    for signal in signals:
        is_known &= np.isfinite(signal.values[some])
    some = some[is_known]
    if len(some) < FEWEST_ROWS:
        return ""
    signals = independent([replace(one, values=one.values[some]) for one in signals])[:MOST_SIGNALS]
    y = torque[some]
    if not signals or not varies(y):
        return ""
    step = rounding_step(y)
    size = rms(y - y.mean())
    if step > math.sqrt(12) * LARGEST_ROUNDING * size:
        return ""

    terms = terms_of(signals)
    factors, left = fitted(terms, y)
    steps = [step, *rounding_of_signals(signals, terms, factors)]
    expected = max(math.hypot(*steps) / math.sqrt(12), SMALLEST_ROUNDING * size)
    if left > min(OVER_ROUNDING * expected, LARGEST_ROUNDING * size):
        most = max(step, SMALLEST_ROUNDING * size)
        for signal in everywhere:
            if signal.kind == "angle" and is_same_again(signal.values, torque, most):
                return f"a function of {signal.name!r}"
        return ""
    return formula(signals, terms, factors, TERM * expected)


def is_same_again(angle: Array, torque: Array, most: float) -> bool:
    """Whether a torque (n,) is the same to within `most` wherever its angle comes back in another
    motion: no load cell does that, and no device has neither losses nor inertia."""
    is_known = np.isfinite(angle[:MOST_REPEATED]) & np.isfinite(torque[:MOST_REPEATED])
    angle, torque = angle[:MOST_REPEATED][is_known], torque[:MOST_REPEATED][is_known]
    order = np.argsort(angle, kind="stable")
    is_again = np.diff(angle[order]) == 0
    # the angle has gone elsewhere in between
    is_again &= np.diff(order) > APART
    if np.count_nonzero(is_again) < FEWEST_REPEATED:
        return False
    return bool(np.abs(np.diff(torque[order])[is_again]).max() <= most * (1 + 1e-6))


def independent(signals: Sequence[Signal]) -> list[Signal]:
    """The signals that vary, and are no multiples of an earlier one."""
    found: list[Signal] = []
    for signal in signals:
        is_multiple = any(factor_of(signal.values, other.values) for other in found)
        if varies(signal.values) and not is_multiple:
            found.append(signal)
    return found


def terms_of(signals: Sequence[Signal], signs: Sequence[Signal] | None = None) -> list[Term]:
    """Powers of angles, losses of speeds, currents, friction that grows with the current, and a
    constant; `signs` are the signals of whose speeds the signs are taken."""
    terms: list[Term] = []
    signs_of = {k: np.sign(s.values) for k, s in enumerate(signs or signals) if s.kind == "speed"}
    for place, signal in enumerate(signals):
        x = signal.values
        terms.append(Term((place,), x, is_linear=True))
        if signal.kind == "other":
            continue
        if signal.kind == "angle":
            terms += [Term((place,), x**power) for power in range(2, HIGHEST_POWER + 1)]
        else:
            terms.append(Term((place,), x * np.abs(x)))
        if signal.kind == "speed":
            terms.append(Term((place,), signs_of[place]))
        if signal.kind == "current":
            terms += [Term((place, k), sign * np.abs(x)) for k, sign in signs_of.items()]
    return [*terms, Term((), np.ones_like(terms[0].column))]


def fitted(terms: Sequence[Term], y: Array) -> tuple[Array, float]:
    """Factors of the terms for y (n,) by least squares, without the few rows that are far off, and
    the RMS of what is left of the others."""
    columns = np.stack([term.column for term in terms], axis=1)
    scale = np.abs(columns).max(axis=0)
    scaled = columns / np.where(scale > 0, scale, 1.0)
    factors = np.linalg.lstsq(scaled, y, rcond=1e-12)[0]
    off = np.abs(y - scaled @ factors)
    inside = off <= np.quantile(off, 1 - OUTSIDE)
    factors = np.linalg.lstsq(scaled[inside], y[inside], rcond=1e-12)[0]
    left = rms(y[inside] - scaled[inside] @ factors)
    return factors / np.where(scale > 0, scale, 1.0), left


def rounding_of_signals(
    signals: Sequence[Signal], terms: Sequence[Term], factors: Array
) -> list[float]:
    """What a step of each signal changes of the torque."""
    changes: list[float] = []
    for place, signal in enumerate(signals):
        step = rounding_step(signal.values)
        by_a_step = list(signals)
        by_a_step[place] = replace(signal, values=signal.values + step)
        change = np.zeros_like(signal.values)
        for factor, term, moved in zip(factors, terms, terms_of(by_a_step, signals), strict=True):
            change += factor * (moved.column - term.column)
        changes.append(float(np.median(np.abs(change))))
    return changes


def rounding_step(values: Array) -> float:
    """The step to which numbers (n,) were rounded: a decimal place, the step of a converter, or
    that of single precision; 0 if none is seen."""
    largest = float(np.abs(values).max(initial=0.0))
    for digits in range(MOST_DIGITS + 1):
        scaled = values * 10.0**digits
        if np.abs(scaled - np.rint(scaled)).max() < 1e-6 + 1e-15 * largest * 10.0**digits:
            return 10.0**-digits
    if (values.astype(np.float32) == values).all():
        return largest * 2.0**-24
    return visible_step(values) or 0.0


def formula(signals: Sequence[Signal], terms: Sequence[Term], factors: Array, least: float) -> str:
    """The terms of at least this size in words; empty where they are the deflection of a spring,
    between two encoders, or of other signals alone, which may be a load cell's own channels."""
    used = [
        (factor, term)
        for factor, term in zip(factors, terms, strict=True)
        if term.of and rms(factor * (term.column - term.column.mean())) > least
    ]
    places = sorted({place for _, term in used for place in term.of})
    encoders = [
        place
        for place in places
        if signals[place].kind == "angle" and not signals[place].is_command
    ]
    if len(encoders) > 1 or all(signals[place].kind == "other" for place in places):
        return ""
    if not all(term.is_linear for _, term in used):
        return f"a function of {' and '.join(repr(signals[place].name) for place in places)}"
    parts = [f"{factor:.4g} * {signals[term.of[0]].name!r}" for factor, term in used]
    return " + ".join(parts).replace("+ -", "- ")
