"""By how much the torque lags the angle: a filter, a clock or a yielding frame, and not friction.

Of a stepped sine from its phasors; of any other motion as a fourth parameter beside K, B and I.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import chdtri, stdtrit

from osl_analysis.bench.moving_record import MovingRecord, estimates_of, fit_of, left_by
from osl_analysis.bench.phasors import Admittance, Phasors, SegmentPhasors, stacked
from osl_analysis.errors import OslAnalysisError
from osl_analysis.signals import LowPass, differentiate
from osl_analysis.stats.fit_row import Row, lag_damping_row
from osl_analysis.stats.regression import LinearFit, regressors
from osl_analysis.trial import Array

CERTAIN_LAG = 10.0
"""Standard errors from which a lag is certain. They come from what the fit leaves, so that a lag is certain only if it
explains most of what a fit without it leaves. Friction and higher dynamics also leave something."""
CERTAIN_BESIDE_NOISE = 5.0
"""The same where the fit leaves no more than the noise of many phasors; few know their noise less well."""
ONCE_IN = 1e-3  # probability that noise alone goes beyond what counts as noise, beside which few phasors count for less
CERTAINLY_LESS = 3.0
"""Square root of the difference of two sums of squares, in noise, from which one fit leaves certainly less."""
LARGEST_TURN = 0.2
"""Phase [rad] at the highest frequency, 6 ms at 5 Hz, beyond which a lag stands for other dynamics if no model is
known."""
ONLY_NOISE = 1.5  # what the fit leaves, over the noise of the phasors, up to which it counts as noise
LAG_STEPS = 5  # steps of Gauss and Newton to the lag; a lag of 5 ms is found to a nanosecond in four
LAG_CONDITION = 1e6  # largest scaled condition number: near 1000 with five frequencies, since a lag is nearly a damping
MUCH_BETTER = 5.0  # A model of the joint decides alone if it leaves less than the other by this factor
LARGEST_YIELD = 0.5  # largest share of the joint's angle by which a frame may yield; beyond it the fit did not find one
YIELD_STARTS = (0.0, 0.25, 0.5)  # shares of the angle from which the yielding of a frame is sought


@dataclass(frozen=True)
class TorqueLag:
    """By how much the torque lags the angle."""

    lag: float  # lag [s]; positive if the torque is late
    se: float  # its standard error [s], from what the fit leaves
    misfit: float  # standard deviation of what the fit leaves [N*m, at 1 Hz]
    frame_stiffness: float | None = None
    """Stiffness [N*m/rad] of a frame whose yielding explains the data as well as the lag; None if none does."""
    freedom: int = 1  # degrees of freedom that the fit leaves
    apart: float = 0.0  # distance [s] to another small lag that explains the data as well; 0 if none does

    def certain_from(self, noise: float) -> float:
        """Standard errors from which the lag is certain, if the phasors have this `noise` [N*m, at 1 Hz]."""
        if self.misfit >= ONLY_NOISE * noise:
            return CERTAIN_LAG
        return min(max(CERTAIN_BESIDE_NOISE, float(stdtrit(self.freedom, 1 - ONCE_IN / 2))), CERTAIN_LAG)


@dataclass(frozen=True)
class ImpedancePoints:
    """Measured impedances, shape (n,) each."""

    frequency_hz: Array  # frequency [Hz]
    theta: Array  # amplitude [rad]
    amplitude: Array  # commanded amplitude, in any unit: equal where the protocol's is
    impedance: Phasors  # torque/theta [N*m/rad]


def torque_lag(points: ImpedancePoints, expected: Phasors) -> TorqueLag:
    """Lag of the torque behind the angle.

    `expected` (n,) are the impedances of the linear model with the same gains. A lag d multiplies the impedance by
    exp(-s d). This differs from a damping of -K d only in that B and I are turned, too. The joint is taken as a
    second-order system, or as the linear model with other K, B and I, whichever fits better together with a lag. Their
    higher dynamics differ by as much as a lag of milliseconds. Where neither fits much better than the other, the
    difference between their lags is part of the standard error.
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
    tried = [found_from(points, base, LAG, start) for start in (largest, -largest)]
    others = [one for one in tried if one and abs(one.lag) < largest]
    best = min([found, *others], key=lambda one: one.misfit)
    alike = [one for one in (found, *others) if one.freedom * (one.misfit**2 / best.misfit**2 - 1) < CERTAINLY_LESS**2]
    return beside_others(found if found in alike else best, alike)


def beside_others(found: TorqueLag, alike: Sequence[TorqueLag]) -> TorqueLag:
    """A lag with its distance to others that explain the data as well."""
    apart = max(abs(one.lag - found.lag) for one in alike)
    return replace(found, apart=apart if apart > CERTAINLY_LESS * found.se else 0.0)


def largest_lag(points: ImpedancePoints) -> float:
    return LARGEST_TURN / (2 * np.pi * float(np.max(points.frequency_hz)))


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
    slope: Callable[[Phasors, Phasors], Phasors]  # by how much the joint's impedance changes with x


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


UNSEEN = 0.1
"""Share of B or of I that a lag may make without being certain, beyond which it is not known whether the torque is
late."""
POSSIBLE = 2.0  # standard errors by which a lag may be larger than it is found
LITTLE_DAMPING, LITTLE_INERTIA = 2.0, 5e-3
"""B [N*m*s/rad] and I [kg*m^2] below which their shares say little; added in quadrature to what a share is taken of."""
OF_CERTAIN_LAG = ("lag_share", "lag_inertia_share", "frame_stiffness")  # columns of a lag that is certain


def torque_lag_row(phasors: Sequence[SegmentPhasors], fit: LinearFit, expected: Admittance | None) -> Row:
    """`lag_damping_row` of the torque's lag, `lag_share` and `lag_inertia_share`, the shares of B and I that a certain
    lag makes, and the `frame_stiffness` [N*m/rad] that explains a certain lag as well.

    `expected` is the admittance of the linear model, None where the gains are not known; `fit` is that of Eq. 15. All
    null where the lag cannot be estimated.
    """
    lag = lag_in_noise(phasors, fit) if expected is None else lag_of(phasors, expected)
    if lag is None:
        return {**lag_damping_row(None, None, fit["K"]), **dict.fromkeys(OF_CERTAIN_LAG)}
    return lag_row(lag, lag.certain_from(noise_of(phasors)), fit)


def lag_row(lag: TorqueLag, certain_from: float, fit: LinearFit) -> Row:
    """As `torque_lag_row`, of a lag that is certain from so many standard errors. Both shares are null where it is not
    certain, and might yet change I by more than `UNSEEN`. Where two lags explain the data, and none does not, the
    smaller one counts as certain, and its standard error contains their distance."""
    se = float(np.hypot(lag.se, lag.apart))
    row = {**lag_damping_row(lag.lag, lag.se, fit["K"], certain_from), "lag_se_s": se}
    if row["certain_lag_damping"]:
        return {**row, **dict(zip(OF_CERTAIN_LAG, (*lag_shares(lag.lag, fit), lag.frame_stiffness), strict=True))}
    possible = max(certain_from * lag.se, abs(lag.lag) + POSSIBLE * se)
    share = None if lag_shares(possible, fit)[1] > UNSEEN else 0.0
    return {**row, **dict(zip(OF_CERTAIN_LAG, (share, share, None), strict=True))}


def lag_shares(lag: float, fit: LinearFit) -> tuple[float, float]:
    """Shares of B and of I that a lag [s] makes: exp(-s d) takes K d off B, and d times the joint's own B off I."""
    own_damping = fit["B"] + fit["K"] * lag
    return abs(fit["K"] * lag / fit["B"]), abs(own_damping * lag) / float(np.hypot(fit["I"], LITTLE_INERTIA))


def noise_of(phasors: Sequence[SegmentPhasors]) -> float:
    """RMS standard error of measured impedances, weighed as `lag_beyond` weighs them [N*m, at 1 Hz]."""
    variances = [
        (np.trace(s.torque.covariance) + abs(s.torque.value / s.theta.value) ** 2 * np.trace(s.theta.covariance))
        / (2 * s.frequency_hz)
        for s in phasors
    ]  # of torque/theta times |theta|, to first order
    return float(np.sqrt(np.mean(variances)))


def lag_of(phasors: Sequence[SegmentPhasors], expected: Admittance) -> TorqueLag | None:
    """The torque's lag; None where it cannot be estimated."""
    points = points_of(phasors)
    try:
        found = torque_lag(points, 1 / expected(np.asarray(2j * np.pi * points.frequency_hz, dtype=np.complex128)))
    except OslAnalysisError:
        return None
    return replace(found, se=se_in_noise(found, noise_of(phasors)))


def se_in_noise(found: TorqueLag, noise: float) -> float:
    """Standard error [s] of a lag in a `noise` [N*m, at 1 Hz]; few phasors may leave less than theirs by chance."""
    return found.se * max(noise / found.misfit, 1.0)


def lag_in_noise(phasors: Sequence[SegmentPhasors], fit: LinearFit) -> TorqueLag | None:
    """The torque's lag where the gains are not known; None where it cannot be told.

    It is told of a second-order joint only, of which Eq. 15, Coulomb friction and a lag leave no more than the noise of
    the phasors. What a drivetrain leaves looks like a lag of 2 to 20 ms. That there is none is not told where one that
    makes much of B would not be certain.
    """
    noise, points = noise_of(phasors), points_of(phasors)
    found = smallest_lag(points, noise)
    if found is None:
        return None
    se = se_in_noise(found, noise)
    unseen = abs(fit["K"]) * CERTAIN_BESIDE_NOISE * se / float(np.hypot(fit["B"], LITTLE_DAMPING))
    if unseen > UNSEEN and abs(found.lag) < CERTAIN_BESIDE_NOISE * se:
        return None
    frame = yielding_frame(points, np.zeros_like(points.impedance), MUCH_BETTER * found.misfit)
    return replace(found, se=se, frame_stiffness=frame)


def smallest_lag(points: ImpedancePoints, noise: float) -> TorqueLag | None:
    """The smallest lag beside which a second-order joint leaves the `noise` [N*m, at 1 Hz]; None if there is none. Up
    to the third power of s two lags explain the same torque, some ms apart; a larger one counts if it leaves certainly
    less. One that turns the fastest sine by more than `LARGEST_TURN` stands for other dynamics."""
    largest = largest_lag(points)
    freedom = 2 * len(points.theta) - len(np.unique(points.amplitude)) - 4  # K of each amplitude, B, I, friction, lag
    enough = max(ONLY_NOISE, float(np.sqrt(chdtri(freedom, ONCE_IN) / freedom))) * noise
    tried = [found_from(points, np.zeros_like(points.impedance), LAG, start) for start in (0.0, largest, -largest)]
    sound = [one for one in tried if one is not None and one.misfit < enough and abs(one.lag) < largest]
    least = min((one.misfit for one in sound), default=0.0)
    alike = [one for one in sound if freedom * (one.misfit**2 - least**2) < (CERTAINLY_LESS * noise) ** 2]
    return beside_others(min(alike, key=lambda one: abs(one.lag)), alike) if alike else None


def points_of(phasors: Sequence[SegmentPhasors]) -> ImpedancePoints:
    """The impedances of phasors."""
    return ImpedancePoints(
        np.array([s.frequency_hz for s in phasors]),
        np.array([abs(s.theta.value) for s in phasors]),
        np.array([s.amplitude_deg for s in phasors]),
        np.array([s.torque.value / s.theta.value for s in phasors]),
    )


CERTAIN_IN_NOISE = 3.0  # standard errors from which a lag is certain where the fit leaves only noise
BEYOND = 3.0  # cut-offs of the filter up to which the linear model is taken into account
SETTLED = 0.01  # standard errors by which the last step to the lag changes it
KEPT, WIDER = 0.25, 1.5
"""Share of a sampling rate [Hz] below which a cubic between samples keeps their noise; least cut-off, in cut-offs."""
MOST = 0.5
"""Share of what the fit leaves without a lag, below which it leaves with one, so that the lag explains most of it."""


@dataclass(frozen=True)
class RecordLag:
    """The lag [s] of the torque, its standard error [s], and the RMS [N*m] of what fits with and without it leave."""

    lag: float
    se: float
    misfit: float
    without: float


def lag_beside(record: MovingRecord, base: Array | None, jerk: Array) -> RecordLag | None:
    """The lag d if the torque is that of `base` (n,) [N*m] and of K, B and I, late by d; None: no base.

    The `jerk` (n,) [rad/s^3] is that of the filtered motion.

    A lag adds -d times the torque's derivative. Its parts K omega and B alpha look like damping and inertia: only the
    rest, the base's derivative and I times the jerk, tells a lag. Each step takes the lag found so far off the torque.
    None if the lag is no longer small against the fastest motion: it then stands for other dynamics.
    """
    largest = 1 / (2 * np.pi * record.band_hz[1])
    lag = first_lag(record, jerk, largest) if base is None else 0.0
    slope = 0.0 if base is None else np.gradient(base, record.time)
    for _ in range(LAG_STEPS):
        rest = without_torque(advanced(record, lag) if lag else record, base)
        fit = fit_of(rest, {"lag": -(estimates_of(rest)["I"] * jerk + slope)})
        step, se, misfit = fit["lag"], fit.se("lag"), float(np.std(fit.residual))
        lag += step
        if abs(lag) > largest:
            return None
        if abs(step) < SETTLED * se:
            break
    return RecordLag(lag, se, misfit, left_by(without_torque(record, base)))


def jerk_of(record: MovingRecord) -> Array:
    """Jerk (n,) [rad/s^3] of the filtered motion."""
    return differentiate(record.time, record.motion.omega).alpha


def first_lag(record: MovingRecord, jerk: Array, largest: float) -> float:
    """The lag [s] of a second-order joint from a fit with the jerk (n,) as a fourth column, below the `largest`.

    By the series of exp(-s d) the four coefficients of a late torque, K, B', I' and J', obey
    K d^3/6 + B' d^2/2 + I' d + J' = 0. Two of its real roots explain the torque to third order. The smaller one counts,
    unless the torque made earlier by another leaves certainly less.
    """
    fit = estimates_of(record, {"J": jerk})
    roots = np.roots([fit["K"] / 6, fit["B"] / 2, fit["I"], fit["J"]])
    tried = sorted((float(r.real) for r in roots if abs(r.imag) < 1e-9 and abs(r.real) < largest), key=abs)
    if len(tried) < 2:
        return tried[0] if tried else 0.0
    left = [left_by(advanced(record, lag)) for lag in tried]
    return next(lag for lag, size in zip(tried, left, strict=True) if size < certainly_more(record) * min(left))


def certainly_more(record: MovingRecord) -> float:
    """Factor by which what one model leaves is certainly more than what another one does, if both leave noise."""
    independent = 2 * record.low_pass.noise_bandwidth_hz * record.seconds
    return float(1 + CERTAIN_IN_NOISE / np.sqrt(independent))


def advanced(record: MovingRecord, lag: float) -> MovingRecord:
    """The record with a torque that is earlier by `lag` [s]."""
    time = record.time
    both = CubicSpline(time, np.array([record.torque, record.filtered_torque]), axis=1)
    torque, filtered = both(np.clip(time + lag, time[0], time[-1]))
    return replace(record, torque=torque, filtered_torque=filtered)


def without_torque(record: MovingRecord, base: Array | None) -> MovingRecord:
    """The record with a torque (n,) [N*m] taken off; None: none."""
    if base is None:
        return record
    return replace(record, torque=record.torque - base, filtered_torque=record.filtered_torque - base)


def linear_torque(record: MovingRecord, expected: Admittance) -> Array:
    """Torque (n,) [N*m] of the linear model of admittance `expected` for the filtered motion, without its K, B, I. The
    record is continued by its mirror image, so that its ends fit together."""
    n, theta = len(record.time), record.motion.theta
    mirrored = np.fft.rfft(np.concatenate([theta, theta[::-1]]))
    s = np.asarray(2j * np.pi * np.fft.rfftfreq(2 * n, 1 / record.rate_hz), dtype=np.complex128)
    kept = np.abs(s) < 2 * np.pi * BEYOND * record.low_pass.cutoff_hz
    response = np.zeros(len(s), dtype=np.complex128)
    response[kept] = 1 / expected(s[kept])
    return np.asarray(np.fft.irfft(response * mirrored, 2 * n)[:n])


def record_lag(record: MovingRecord, expected: Admittance | None) -> RecordLag | None:
    """The lag, by a second-order joint or by the linear model with other K, B and I, whichever fits better.

    A joint of second order that leaves only noise decides alone where the other model leaves more. Where neither fits
    much better than the other, the difference of their lags is part of the standard error. None where it cannot be
    estimated: a lag and what a model misses look alike. Beside friction a lag is seen only if it explains most of what
    the linear model leaves; without that model the lag of a device that is not of second order is not seen.
    """
    try:
        bases = [None] if expected is None else [None, linear_torque(record, expected)]
        jerk = jerk_of(record)
        tried = [lag for base in bases if (lag := lag_beside(record, base, jerk)) is not None]
    except OslAnalysisError:
        return None
    found = sorted(tried, key=lambda lag: lag.misfit)
    if not found:
        return None
    only_noise = found[0].misfit < ONLY_NOISE * noise_behind(record, record.low_pass)
    if not only_noise and (expected is None or found[0].misfit > MOST * found[0].without):
        return None
    if len(found) == 1:
        return found[0]
    better, worse = found
    enough = certainly_more(record) if only_noise else MUCH_BETTER
    doubt = better.lag - worse.lag if worse.misfit < enough * better.misfit else 0.0
    return replace(better, se=float(np.hypot(better.se, doubt)))


def record_lag_row(record: MovingRecord, fit: LinearFit, expected: Admittance | None) -> Row:
    """As `torque_lag_row`. A frame in series looks like a lag up to the third power of s."""
    found = record_lag(record, expected)
    if found is None:
        return {**lag_damping_row(None, None, fit["K"]), **dict.fromkeys(OF_CERTAIN_LAG)}
    beside_noise = found.misfit < ONLY_NOISE * noise_behind(record, record.low_pass)
    certain_from = CERTAIN_IN_NOISE if beside_noise else CERTAIN_LAG
    certain = abs(found.lag) > certain_from * found.se
    frame = yielding_in(estimates_of(record, {"J": jerk_of(record)})) if certain else None
    return lag_row(TorqueLag(found.lag, found.se, found.misfit, frame), certain_from, fit)


def yielding_in(series: Mapping[str, float]) -> float | None:
    """Stiffness [N*m/rad] of a frame in series with a second-order joint of which K, B, I and J are measured.
    1/measured = 1/joint + 1/stiffness, to the third power of s, where the joint has none. None if there is none."""
    K, B, I, J = (series[name] for name in "KBIJ")
    b, i, j = B / K, I / K, J / K
    first, second, third = -b, b**2 - i, 2 * b * i - b**3 - j
    left = np.roots([third, -2 * first * second, first**3])
    yielded = [1 - float(share.real) for share in left if abs(share.imag) < 1e-9]
    return K / min(sound) if (sound := [share for share in yielded if 0 < share < LARGEST_YIELD]) else None


def noise_behind(record: MovingRecord, low_pass: LowPass) -> float:
    """RMS [N*m] of the torque's noise behind the filter, from what the filter takes off; the noise is white.

    Where the samples are not the rows, the spline between them has taken off noise near half their rate: then from
    what the filter takes off of the torque up to a quarter of that rate, below which the spline keeps 97 % of it.
    """
    samples = record.uniform.sampled("torque")
    if samples is record.time:
        whole, passed = record.torque, 2 * low_pass.noise_bandwidth_hz / record.rate_hz
        over = passed / max(1 - passed, 1e-3)
    else:
        rate = (len(samples) - 1) / float(samples[-1] - samples[0])
        wide = LowPass(max(KEPT * rate, WIDER * low_pass.cutoff_hz), low_pass.order)
        whole, over = wide(record.torque, record.rate_hz), passed_over_taken(low_pass, wide, record.rate_hz)
    off = np.concatenate([whole[piece] - record.filtered_torque[piece] for piece in record.pieces])
    return float(np.std(off) * np.sqrt(over))


def passed_over_taken(low_pass: LowPass, wide: LowPass, rate_hz: float) -> float:
    """Power of white noise behind a filter over that of what it takes off behind a `wide` one, at a rate [Hz]."""
    impulse = np.zeros(2 * low_pass.remembers(rate_hz) + 1)
    impulse[len(impulse) // 2] = 1.0
    passed = low_pass(impulse, rate_hz)
    taken = wide(impulse, rate_hz) - passed
    return float(passed @ passed / (taken @ taken))
