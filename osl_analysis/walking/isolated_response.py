# SPDX-License-Identifier: Apache-2.0
"""Steps 5 and 6, isolated response: a perturbed crossing minus unperturbed gait at the same phase.

A perturbation may change the duration of stance, so that the expected duration is read from the
ankle's angle before the onset. At phases p a curve is c mean(r p) + drift(p), by least squares. The
pace r is wanted. Size c and the polynomial drift differ from step to step and are fitted, too: they
cannot imitate the ankle's sharp turn after heel strike. The order of the drift is that for which
the unperturbed r scatter least. Torque and load would misread a slower crossing: low-pass and heel
impact act in time, not in phase.

The response is zero on average over a baseline that ends before the onset, because the zero-phase
filter spreads the response to earlier times. A response zeroed at the onset gives K = 321 N*m/rad
for a true 340.

Example: `isolate_response(crossing, unperturbed_gait(crossings, 3), timing).torque`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from osl_analysis.base.errors import InputError
from osl_analysis.base.measured import rounding_of
from osl_analysis.base.trial import Array
from osl_analysis.signals.filters import Motion, differentiate, sampling_rate
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.poses import StoredArray
from osl_analysis.walking.walking_settings import TimingSettings

# Phases of stance at which crossings are sampled, finer than the frames
PHASES = np.linspace(0.0, 1.0, 401)
MATCHED_STEP = 4  # every fourth phase is enough after a low-pass of 20 Hz

SMALLEST_SCALE = 0.75
LARGEST_SCALE = 1 / SMALLEST_SCALE
DRIFT_ORDERS = range(1, 9)
SCALE_ROUNDING = 1e-6  # a smaller step of the search is rounding, and ends it
SCALE_ROUNDS = round(-np.log2(SCALE_ROUNDING))  # steps, if each halves the error


@dataclass(frozen=True)
class UnperturbedGait:
    """Unperturbed crossings at `PHASES`: 0 at heel strike, 1 at toe-off."""

    theta: StoredArray  # angle of the ankle (crossings, phases) [rad]
    torque: StoredArray  # (crossings, phases) [N*m]
    stance: StoredArray  # duration of stance (crossings,) [s]
    changes: StoredArray  # of the torque (m + 4, crossings, phases) [N*m], as in `Crossing`


def unperturbed_gait(
    crossings: Sequence[Crossing], fewest: int, lost: Mapping[str, str] | None = None
) -> UnperturbedGait:
    """Sample crossings on the common grid of stance phase.

    Parameters
    ----------
    crossings : sequence of Crossing
        Unperturbed crossings.
    fewest : int
        Smallest number that is accepted.
    lost : mapping, optional
        The reasons for which other crossings are not used, by trial, for the message.

    Raises
    ------
    InputError
        There are fewer crossings.
    """
    if len(crossings) < fewest:
        remedy = "record more"
        if lost:
            remedy = f"walking_crossings.csv says why others cannot: {next(iter(lost.values()))}"
        raise InputError(
            f"{len(crossings)} unperturbed crossings can be used, expected {fewest} or more", remedy
        )

    return UnperturbedGait(
        theta=curves_of(crossings, "theta"),
        torque=curves_of(crossings, "torque"),
        stance=np.array([crossing.stance.duration for crossing in crossings]),
        changes=curves_of(crossings, "changes"),
    )


def curves_of(crossings: Sequence[Crossing], signal: str, phases: Array = PHASES) -> Array:
    """A signal of crossings at phases of stance, shape (..., crossings, phases)."""
    curves = [
        signal_at(crossing, getattr(crossing, signal), stance_times(crossing, phases))
        for crossing in crossings
    ]
    return np.stack(curves, axis=-2)


def stance_times(crossing: Crossing, phases: Array) -> Array:
    """Times [s] of the phases (k,) of a crossing's stance."""
    return crossing.stance.heel_strike + phases * crossing.stance.duration


def signal_at(crossing: Crossing, signal: Array, time: Array) -> Array:
    """Interpolate signals (..., n) of a crossing at times (k,) [s]; constant beyond its ends."""
    spline = scipy.interpolate.make_interp_spline(crossing.time, signal, axis=-1)
    return spline(np.clip(time, crossing.time[0], crossing.time[-1]))


def matched_scales(phase: Array, curves: Array, mean: Array, order: int) -> Array:
    """Fit the pace of curves to a mean curve by Gauss-Newton.

    The model of a curve at phases p is c mean(r p) + drift(p), where the drift is a polynomial. The
    scale r is wanted; c and the drift's coefficients are not, and their columns are taken off the
    others (Frisch and Waugh, Econometrica 1, 1933).

    Parameters
    ----------
    phase : Array
        Phases p (k,), from 0.
    curves : Array
        (m, k).
    mean : Array
        (n,), at equal steps of phase from 0 to 1.
    order : int
        Of the drift.

    Returns
    -------
    Array
        Scales r (m,); NaN where the search from 1 does not converge within bounds.
    """
    mean_curve = scipy.interpolate.make_interp_spline(np.linspace(0.0, 1.0, len(mean)), mean)
    mean_slope = mean_curve.derivative()
    drift = np.linalg.qr(np.vander(phase / phase[-1], order + 1))[0]
    negligible = len(phase) * rounding_of(mean)
    scales = np.ones(len(curves))
    for _ in range(SCALE_ROUNDS):
        scaled_phase = np.clip(scales[:, None] * phase, 0.0, 1.0)
        expected = mean_curve(scaled_phase)
        columns = np.stack([expected, phase * mean_slope(scaled_phase), curves - expected])
        by_size, by_scale, unexplained = columns - columns @ drift @ drift.T
        by_scale -= by_size * coefficients(by_scale, by_size, negligible)[:, None]
        step = coefficients(unexplained, by_scale, negligible)
        scales += step
    within = (scales > SMALLEST_SCALE) & (scales < LARGEST_SCALE)
    return np.where((np.abs(step) < SCALE_ROUNDING) & within, scales, np.nan)


def coefficients(curves: Array, columns: Array, negligible: float) -> Array:
    """Coefficients (m,) of the regression of each curve on its column, both (m, k).

    They are NaN where the sum of the column's squares is `negligible`.
    """
    squares = np.vecdot(columns, columns)
    return np.vecdot(curves, columns) / np.where(squares > negligible, squares, np.nan)


@dataclass(frozen=True)
class AlignedGait:
    """The phases of a perturbed crossing and of the unperturbed ones on the mean gait."""

    stance: float  # duration of stance [s] that converts the perturbed crossing's time to phase
    # Phase on the mean gait over own phase, of each unperturbed crossing (crossings,)
    scales: Array

    def curves(self, unperturbed: Array, phase: Array) -> Array:
        """Interpolate unperturbed curves (crossings, `PHASES`) at phases (k,) of the mean gait.

        Returns
        -------
        Array
            (crossings, k).
        """
        own_phases = np.clip(phase / self.scales[:, None], 0.0, 1.0)
        curves = [
            scipy.interpolate.make_interp_spline(PHASES, curve)(own_phase)
            for curve, own_phase in zip(unperturbed, own_phases, strict=True)
        ]
        return np.array(curves)


def aligned_gait(crossing: Crossing, gait: UnperturbedGait, known_until: float) -> AlignedGait:
    """Match the pace of a perturbed crossing, and of each unperturbed one, to the mean gait.

    Parameters
    ----------
    known_until : float
        Time [s] until which the angle is matched. With a guard of 30 ms before the onset, what a
        filter of 20 Hz spreads of a turn of 4 deg changes the pace by 0.15 %, and K by 0.3 %.

    Raises
    ------
    InputError
        No pace fits.
    """
    stance = crossing.stance
    known = stance.heel_strike + PHASES * stance.duration <= known_until
    phase = PHASES[known][::MATCHED_STEP]
    if len(phase) > len(DRIFT_ORDERS):
        theta = signal_at(crossing, crossing.theta, stance_times(crossing, phase))
        curves = np.vstack([theta, gait.theta[:, ::MATCHED_STEP][:, : len(phase)]])
        mean = gait.theta.mean(axis=0)
        scales = np.array([matched_scales(phase, curves, mean, order) for order in DRIFT_ORDERS])
        # The order of drift is the one at which all curves have a scale and the unperturbed scales
        # scatter least
        is_whole = np.isfinite(scales).all(axis=1)
        scatters = np.where(is_whole, np.std(scales[:, 1:], axis=1), np.inf)
        best = np.argmin(scatters)
        if np.isfinite(scatters[best]):
            return AlignedGait(stance.duration / scales[best, 0], scales[best, 1:])
    raise InputError(
        f"trial {crossing.name}: its angle before the onset tells no pace from"
        f" {SMALLEST_SCALE:g} to {LARGEST_SCALE:g} of the mean unperturbed gait: it has no sharp"
        " turn after heel strike, or is of another gait",
        "give it another group, or exclude the trial",
    )


# Samples at both ends of a response beyond what is used: a spline's derivatives are less accurate
# at its ends
MARGIN = 8
# Means and slopes of curves before the onset, from which a crossing's gait is predicted
BEHAVIOUR = ("angle", "torque", "angle_slope", "torque_slope")
Predictors = tuple[str, ...]
"""Some of `BEHAVIOUR`; if empty, the prediction is the mean unperturbed gait."""


def regressors(behaviour: Array, predictors: Predictors) -> Array:
    """Columns (c, q + 1) of the regression on some of the behaviour (4, c): 1, and each at unit
    size."""
    chosen = behaviour[[BEHAVIOUR.index(name) for name in predictors]]
    sizes = np.sqrt(np.mean(chosen**2, axis=1, keepdims=True))
    scaled = chosen / np.where(sizes > 0, sizes, 1.0)
    return np.column_stack([np.ones(chosen.shape[1]), scaled.T])


@dataclass(frozen=True)
class PerturbationResponse:
    """Isolated response to one perturbation, or the mean over several: k samples, zero on average
    over the baseline.

    Row i of `thetas` and `torques` is the crossing minus the i-th unperturbed one. The response is
    their mean, or where gait is predicted their regression on what each crossing did before.
    """

    name: str
    time: Array  # (k,) [s] from the onset
    thetas: Array  # (crossings, k) [rad]
    torques: Array  # (crossings, k) [N*m]
    changes: Array  # of the torque (m + 4, k) [N*m], as in `Crossing`
    # (4, crossings): `BEHAVIOUR` before the onset minus that of each unperturbed crossing
    behaviour: Array
    # Samples of the fitted window, from the onset, without its end: 30 for 0.1 s at 300 Hz
    window: slice
    # stance at the matched pace over that of the unperturbed crossings, minus 1
    pace_change: float
    predictors: Predictors = ()

    @property
    def weights(self) -> Array:
        """Of the rows (crossings,): their regression at the behaviour of the perturbed crossing."""
        return np.linalg.pinv(regressors(self.behaviour, self.predictors))[0]

    @cached_property
    def motion(self) -> Motion:
        """Angle [rad] of the ankle with its derivatives, (k,) each."""
        return differentiate(self.time, self.weights @ self.thetas)

    @cached_property
    def torque(self) -> Array:
        """(k,) [N*m]."""
        return self.weights @ self.torques

    def without(self, i: int) -> "PerturbationResponse":
        """The response without the i-th unperturbed crossing."""
        return replace(
            self,
            thetas=np.delete(self.thetas, i, axis=0),
            torques=np.delete(self.torques, i, axis=0),
            behaviour=np.delete(self.behaviour, i, axis=1),
        )

    @property
    def fitted_motion(self) -> Motion:
        return Motion(*self.motion.columns[self.window].T)

    @property
    def fitted_torque(self) -> Array:
        return self.torque[self.window]


def isolate_response(
    crossing: Crossing, gait: UnperturbedGait, timing: TimingSettings
) -> PerturbationResponse:
    """Subtract unperturbed gait from a perturbed crossing.

    Parameters
    ----------
    timing : TimingSettings
        Baseline, guard and window about the onset.

    Raises
    ------
    InputError
        The crossing has no onset, no pace fits, or baseline and window leave stance.
    """
    # without an onset no pace fits, and `aligned_gait` refuses the crossing
    onset = np.nan if crossing.onset is None else crossing.onset
    aligned = aligned_gait(crossing, gait, onset - timing.guard_s)

    # Time from the onset, and phase on the mean gait
    rate = sampling_rate(crossing.time)
    before = round((timing.baseline_s + timing.guard_s) * rate) + MARGIN  # samples
    after = round(timing.window_s * rate) + MARGIN
    time = np.arange(-before, after + 1) / rate
    crossing_time = onset + time
    phase = (crossing_time - crossing.stance.heel_strike) / aligned.stance
    first_phase = phase[MARGIN]
    last_phase = phase[-MARGIN - 1]
    if first_phase < 0 or last_phase > 1:
        raise InputError(
            f"trial {crossing.name}: baseline and window span {first_phase:.2f}-{last_phase:.2f}"
            " of stance, expected 0-1",
            "exclude the trial, or turn the platform nearer to midstance",
        )
    phase = np.clip(phase, 0.0, 1.0)

    # The crossing minus each unperturbed one, or for changes minus their mean
    theta = signal_at(crossing, crossing.theta, crossing_time)
    torque = signal_at(crossing, crossing.torque, crossing_time)
    changes = signal_at(crossing, crossing.changes, crossing_time)
    thetas = theta - aligned.curves(gait.theta, phase)
    torques = torque - aligned.curves(gait.torque, phase)
    gait_changes = scipy.interpolate.make_interp_spline(PHASES, gait.changes.mean(axis=1), axis=-1)
    changes = changes - gait_changes(phase)

    baseline = slice(MARGIN, MARGIN + round(timing.baseline_s * rate))
    window = slice(before, before + round(timing.window_s * rate))
    return PerturbationResponse(
        name=crossing.name,
        time=time,
        thetas=zeroed(thetas, baseline),
        torques=zeroed(torques, baseline),
        changes=zeroed(changes, baseline),
        behaviour=behaviour_before(time, thetas, torques, timing.guard_s),
        window=window,
        pace_change=aligned.stance * aligned.scales.mean() / gait.stance.mean() - 1,
    )


def zeroed(curves: Array, baseline: slice) -> Array:
    """Curves (..., k) minus their means over the baseline."""
    return curves - curves[..., baseline].mean(axis=-1, keepdims=True)


def behaviour_before(time: Array, thetas: Array, torques: Array, guard_s: float) -> Array:
    """`BEHAVIOUR` (4, crossings) of curves (crossings, k) until the filter spreads the response."""
    rows = time <= -guard_s
    centred_time = time[rows] - time[rows].mean()
    curves = np.vstack([thetas, torques])[:, rows]
    return np.polynomial.polynomial.polyfit(centred_time, curves.T, 1).reshape(4, -1)
