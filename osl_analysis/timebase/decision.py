"""Are the stamps true, or does the device sample evenly? The signal itself decides.

With delta the residual of the stamps to their line, a signal x sampled at its true stamps is x(line) + x' delta: sixth
differences D6 take the smooth motion away and leave D6(x' delta). Of a device that samples evenly they leave nothing.
The slope g of D6 x on D6(x' delta) is therefore 1 or 0. How one-sided or slow the residual is does not decide: a loop
that waits for absolute targets is late, never early, and its stamps are true.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from math import comb

import numpy as np
import scipy

from osl_analysis.timebase.counting import Counts
from osl_analysis.timebase.device_clock import DeviceClock
from osl_analysis.timebase.drift import chunked_slope
from osl_analysis.timebase.stream import Stream
from osl_analysis.trial import Array

TRUE_ABOVE, EVEN_BELOW, LARGEST_ERROR = 0.75, 0.25, 0.1
"""Bounds of g, and of its standard error, from which a signal is firm; 1727 of 1730 cases so decided, none wrongly."""
NO_MATTER = 0.001  # residual, in steps, below which both answers are the same samples
ORDER = 6
DIFFERENCE = np.array([(-1.0) ** k * comb(ORDER, k) for k in range(ORDER + 1)])
"""Weights of seven samples in a sixth difference."""
LARGEST_NOISE = 0.2  # share of the slope's mean square that may be noise
SLOPE_S = 0.02  # half the stretch [s] over which the signal's slope is taken


@dataclass(frozen=True)
class Evidence:
    """What one signal says: g, 1 where the stamps are true and 0 where the device is even, and its standard error."""

    g: float
    se: float

    @property
    def true(self) -> bool:
        return self.g > TRUE_ABOVE and self.se < LARGEST_ERROR

    @property
    def even(self) -> bool:
        return self.g < EVEN_BELOW and self.se < LARGEST_ERROR


def evidence_of(values: Array, clock: DeviceClock) -> Evidence:
    """g and its standard error of one signal (n,), by the regression of D6 x on D6(x' delta).

    The slope x' is that of a cubic over 40 ms. The slow part of delta is subtracted first: sixth differences remove it,
    but not its product with the noise of x'. A difference needs seven consecutive samples; others are left out.

    The error is infinite, so that the signal decides nothing, where delta does not scatter, or where more than a fifth
    of the mean square of x' is noise: noise in the regressor would pull g towards 0.
    """
    there = ~np.isnan(values)
    x, late = values[there], clock.residual[there] / clock.step
    window = max(2 * round(SLOPE_S / clock.step) + 1, 7)
    smooth = Smoother(clock.count[there], window)
    slope, jitter = smooth(x, 1), late - smooth(late, 0)
    whole = smooth.count[ORDER:] - smooth.count[:-ORDER] == ORDER
    push, seen = (np.correlate(signal, DIFFERENCE, "valid")[whole] for signal in (slope * jitter, x))
    g, se = chunked_slope(push, seen)
    noise = float(np.sum((seen - g * push) ** 2)) / comb(2 * ORDER, ORDER) / max(len(seen), 1)
    moves, scatter = float(slope @ slope) / len(x), float(np.var(jitter))
    slope_noise = float(np.sum(smoothing(window, 1)[window // 2] ** 2))  # per variance of white noise in the samples
    if noise * slope_noise > LARGEST_NOISE * moves or scatter < NO_MATTER**2:
        return Evidence(0.0, np.inf)
    return Evidence(g, se)


@dataclass(frozen=True)
class Smoother:
    """A cubic through each `window` of evenly counted samples (Savitzky-Golay), missing ones bridged linearly. A gap is
    shortened to two windows, so that a clock that jumps by years costs no memory. Half a window at each end is on the
    cubic of the last window."""

    count: Counts
    window: int

    def __call__(self, values: Array, order: int) -> Array:
        """Value (order 0) or slope per step (order 1) at every sample, (n,)."""
        if self.count[-1] - self.count[0] == len(values) - 1:
            return self.filtered(values, order)
        place = np.concatenate([[0], np.cumsum(np.minimum(np.diff(self.count), 2 * self.window))])
        return np.asarray(self.filtered(np.interp(np.arange(place[-1] + 1), place, values), order)[place])

    def filtered(self, values: Array, order: int) -> Array:
        """The same for samples (n,) of which none is missing."""
        window = min(self.window, (len(values) - 1) // 2 * 2 + 1)
        weights, half = smoothing(window, order), window // 2
        found = np.empty_like(values)
        found[half:-half] = np.correlate(values, weights[half], "valid")
        found[:half], found[-half:] = weights[:half] @ values[:window], weights[-half:] @ values[-window:]
        return found


@lru_cache
def smoothing(window: int, order: int) -> Array:
    """Weights (window, window) of a window's samples in the value (order 0), or slope per step, at each of them."""
    return np.asarray(scipy.signal.savgol_filter(np.eye(window), window, 3, deriv=order, axis=0))


WANDERS = 0.1  # slow wander of the residual, in steps, from which an undecided stream keeps its stamps


@dataclass(frozen=True)
class Decision:
    """How the stamps of some signals of a stream are taken.

    signals: their names.
    even: the device samples evenly (else the stamps are true).
    firm: stated, or seen in the signals; else the other hypothesis may be right.
    matters: the two hypotheses differ.
    why: one sentence for provenance.
    evidence: g and its error per signal; empty where none was sought.
    """

    signals: tuple[str, ...]
    even: bool
    firm: bool
    matters: bool
    why: str
    evidence: Mapping[str, Evidence]


def decide(stream: Stream, clock: DeviceClock) -> list[Decision]:
    """One decision for all signals of a stream; one for each kind where one signal is firmly true and one firmly even.
    A stated choice stands. A residual that does not matter, below a thousandth of a step, leaves the device even."""
    names = tuple(stream.signals)
    if stream.choice != "auto":
        return [Decision(names, stream.choice == "even", True, True, f"stated: {stream.choice}", {})]
    if clock.sd < NO_MATTER * clock.step:
        return [Decision(names, True, True, False, "even: the stamps lie on their line", {})]
    evidence = {n: evidence_of(values, clock) for n, values in stream.signals.items() if n not in stream.silent}
    true = [name for name in evidence if evidence[name].true]
    even = [name for name in evidence if evidence[name].even]
    if true and even:
        return split(names, even, evidence)
    return [firm_decision(names, bool(even), evidence) if true or even else open_decision(names, clock, evidence)]


def split(names: tuple[str, ...], even: list[str], evidence: Mapping[str, Evidence]) -> list[Decision]:
    """Two decisions: the signals that are firmly even were held by their own device, all others take the stamps."""
    others = tuple(name for name in names if name not in even)
    return [firm_decision(group, taken, evidence) for group, taken in ((others, False), (tuple(even), True))]


def firm_decision(names: tuple[str, ...], even: bool, evidence: Mapping[str, Evidence]) -> Decision:
    """The decision that the signals themselves bear."""
    said = {name: evidence[name] for name in names if name in evidence}
    seen = ", ".join(f"{name} g = {e.g:.3f} +- {e.se:.3f}" for name, e in said.items())
    return Decision(names, even, True, True, f"{'even' if even else 'true'}: {seen}", said)


def open_decision(names: tuple[str, ...], clock: DeviceClock, evidence: Mapping[str, Evidence]) -> Decision:
    """Where no signal moves enough to tell: stamps that wander slowly are kept, stamps that only scatter are not."""
    wanders = clock.wander > WANDERS * clock.step
    why = f"undecided, {'true' if wanders else 'even'}: the residual wanders by {clock.wander / clock.step:.3f} steps"
    return Decision(names, not wanders, False, True, why, evidence)
