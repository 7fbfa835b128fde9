"""By how much the torque of a stepped sine lags the angle: a filter, a clock or a yielding frame, and not friction."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from osl_analysis.bench.nonlinearity import Phasors, stacked
from osl_analysis.errors import OslAnalysisError
from osl_analysis.stats.regression import regressors
from osl_analysis.trial import Array

CERTAIN_LAG = 10.0
"""Standard errors from which a lag is certain. They come from what the fit leaves, so that a lag is certain only if it
explains most of what a fit without it leaves. Friction and higher dynamics also leave something."""
CERTAIN_BESIDE_NOISE = 5.0
"""The same where the fit leaves no more than the noise of many phasors; few know their noise less well."""
ONCE_IN = 1e-3
"""Probability that noise alone goes beyond what counts as noise, beside which few phasors count for less."""
CERTAINLY_LESS = 3.0
"""Square root of the difference of two sums of squares, in noise, from which one fit leaves certainly less."""
LARGEST_TURN = 0.2
"""Phase [rad] at the highest frequency, 6 ms at 5 Hz, beyond which a lag stands for other dynamics if no model is
known."""
ONLY_NOISE = 1.5
"""What the fit leaves, over the noise of the phasors, up to which it counts as noise."""
LAG_STEPS = 5
"""Steps of Gauss and Newton to the lag; a lag of 5 ms is found to a nanosecond in four."""
LAG_CONDITION = 1e6
"""Largest scaled condition number: near 1000 with five frequencies, since a lag is nearly a damping."""
MUCH_BETTER = 5.0
"""A model of the joint decides alone if it leaves less than the other by this factor."""
LARGEST_YIELD = 0.5
"""Largest share of the joint's angle by which a frame may yield; beyond it the fit did not find one."""
YIELD_STARTS = (0.0, 0.25, 0.5)
"""Shares of the angle from which the yielding of a frame is sought."""


@dataclass(frozen=True)
class TorqueLag:
    """By how much the torque lags the angle."""

    lag: float
    """Lag [s]; positive if the torque is late."""
    se: float
    """Its standard error [s], from what the fit leaves."""
    misfit: float
    """Standard deviation of what the fit leaves [N*m, at 1 Hz]."""
    frame_stiffness: float | None = None
    """Stiffness [N*m/rad] of a frame whose yielding explains the data as well as the lag; None if none does."""
    freedom: int = 1
    """Degrees of freedom that the fit leaves."""
    apart: float = 0.0
    """Distance [s] to another small lag that explains the data as well; 0 if none does."""

    def certain_from(self, noise: float) -> float:
        """Standard errors from which the lag is certain, if the phasors have this `noise` [N*m, at 1 Hz]."""
        if self.misfit >= ONLY_NOISE * noise:
            return CERTAIN_LAG
        return min(max(CERTAIN_BESIDE_NOISE, float(stdtrit(self.freedom, 1 - ONCE_IN / 2))), CERTAIN_LAG)


@dataclass(frozen=True)
class ImpedancePoints:
    """Measured impedances, shape (n,) each."""

    frequency_hz: Array
    """Frequency [Hz]."""
    theta: Array
    """Amplitude [rad]."""
    amplitude: Array
    """Commanded amplitude, in any unit: equal where the protocol's is."""
    impedance: Phasors
    """torque/theta [N*m/rad]."""


def torque_lag(points: ImpedancePoints, expected: Phasors) -> TorqueLag:
    """Lag of the torque behind the angle.

    `expected` (n,) are the impedances of the linear model with the same gains. A lag d multiplies the impedance by
    exp(-s d). This differs from a damping of -K d only in that B and I are turned, too. The joint is taken as a
    second-order system, or as the linear model with other K, B and I, whichever fits better together with a lag. Their
    higher dynamics differ by as much as a lag of milliseconds. Where neither fits much better than the other, the
    difference between their lags is part of the standard error.

    Raises
    ------
    InputError, IdentifiabilityError
        Too few points, or points that are too similar, to distinguish a lag from the rest.
    """
    fits = [(best_lag(points, base), base) for base in (0 * expected, expected)]
    (better, base), (worse, _) = sorted(fits, key=lambda fit: fit[0].misfit)
    doubt = better.lag - worse.lag if worse.misfit < MUCH_BETTER * better.misfit else 0.0
    frame = yielding_frame(points, base, MUCH_BETTER * better.misfit)
    return replace(better, se=float(np.hypot(better.se, doubt)), frame_stiffness=frame)


def best_lag(points: ImpedancePoints, base: Phasors) -> TorqueLag:
    """The lag beside a base (n,), as `lag_beyond` finds it from none, or a small one that leaves certainly less.

    Up to the third power of s two lags explain the same torque, some ms apart. Raises as `torque_lag`.
    """
    found = lag_beyond(points, base, LAG)
    largest = largest_lag(points)
    others = [one for start in (largest, -largest) if (one := lag_from(points, base, start)) and abs(one.lag) < largest]
    best = min([found, *others], key=lambda one: one.misfit)
    alike = [one for one in (found, *others) if one.freedom * (one.misfit**2 / best.misfit**2 - 1) < CERTAINLY_LESS**2]
    return beside_others(found if found in alike else best, alike)


def beside_others(found: TorqueLag, alike: Sequence[TorqueLag]) -> TorqueLag:
    """A lag with its distance to others that explain the data as well."""
    apart = max(abs(one.lag - found.lag) for one in alike)
    return replace(found, apart=apart if apart > CERTAINLY_LESS * found.se else 0.0)


def largest_lag(points: ImpedancePoints) -> float:
    """The lag [s] that turns the fastest sine by `LARGEST_TURN`."""
    return LARGEST_TURN / (2 * np.pi * float(np.max(points.frequency_hz)))


def lag_from(points: ImpedancePoints, base: Phasors, start: float) -> TorqueLag | None:
    """The lag [s] beside a base (n,) that is found from a start [s]; None if it is not found."""
    return found_from(points, base, LAG, start)


def found_from(points: ImpedancePoints, base: Phasors, effect: "Effect", start: float) -> TorqueLag | None:
    """As `lag_beyond`; None where nothing is found."""
    try:
        with np.errstate(all="ignore"):
            return lag_beyond(points, base, effect, start)
    except (OslAnalysisError, np.linalg.LinAlgError):
        return None


def yielding_frame(points: ImpedancePoints, base: Phasors, largest_misfit: float) -> float | None:
    """Stiffness [N*m/rad] of a frame in series with the joint that explains the points; None if none does.

    Against free K, B and I, a frame leaves the same as a lag up to the third power of s: phasors alone cannot tell the
    two apart. They differ in K, which a frame lowers and a lag does not.
    """
    size = float(np.max(np.abs(points.impedance)))
    found = [found_from(points, base, FRAME, share / size) for share in YIELD_STARTS]
    sound = [one for one in found if one and 0 < one.lag * size < LARGEST_YIELD and one.misfit < largest_misfit]
    return 1 / min(one.lag for one in sound) if sound else None


@dataclass(frozen=True)
class Effect:
    """An effect of one unknown size x on an impedance."""

    undone: Callable[[Phasors, Phasors, float], Phasors]
    """The joint's impedance behind a measured one, for complex s [rad/s] and x."""
    slope: Callable[[Phasors, Phasors], Phasors]
    """By how much the joint's impedance changes with x."""


LAG = Effect(lambda measured, s, d: measured * np.exp(s * d), lambda joint, s: s * joint)
"""A lag x = d [s]: the measured impedance is exp(-s d) times the joint's."""
FRAME = Effect(lambda measured, _, c: measured / (1 - c * measured), lambda joint, _: joint**2)
"""A frame of compliance x = c [rad/(N*m)] in series: 1/measured = 1/joint + c."""


def lag_beyond(points: ImpedancePoints, base: Phasors, effect: Effect, start: float = 0.0) -> TorqueLag:
    """The lag d if the impedance is exp(-s d) (base + K + B s + I s^2) and Coulomb friction, or the size of another
    effect in its place, as Gauss and Newton's steps find it from a `start`; raises as `torque_lag`.

    Every amplitude has a K of its own, so that a spring that stiffens is not taken for a lag. Coulomb friction T_C adds
    4j T_C/(pi theta), its describing function. A point weighs as its torque is known: as many cycles at each frequency.
    """
    s = np.asarray(2j * np.pi * points.frequency_hz, dtype=np.complex128)
    weight = points.theta / np.sqrt(points.frequency_hz)
    shared = {"B": s, "I": s**2, "T_C": 4j / (np.pi * points.theta)}
    own = {f"K at {a:g}": (points.amplitude == a).astype(np.complex128) for a in np.unique(points.amplitude)}
    known, lag = {name: stacked(c * weight) for name, c in {**own, **shared}.items()}, start
    for _ in range(LAG_STEPS):
        early = effect.undone(points.impedance, s, lag)
        slope = {"lag": stacked(-effect.slope(early, s) * weight)}
        found = regressors(known | slope, (2 * len(s),), condition_limit=LAG_CONDITION)
        y = stacked((early - base) * weight)
        step = found.solved(y)
        lag += float(step[-1])
    left = y - found.X @ step
    freedom = len(left) - len(step)
    variance = float(left @ left) / freedom
    se = float(np.sqrt(variance * found.inverse[-1, -1]))
    return TorqueLag(lag, se, float(np.sqrt(variance)), freedom=freedom)
