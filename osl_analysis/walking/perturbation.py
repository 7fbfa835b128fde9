"""What a perturbation adds to a crossing: the crossing minus the mean unperturbed one at the same phase of stance."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import make_interp_spline

from osl_analysis.errors import InputError, OslAnalysisError
from osl_analysis.second_order import ImpedanceFit, impedance_torque
from osl_analysis.signals import Motion, differentiate, sampling_rate
from osl_analysis.stats.degrees_of_freedom import welch_satterthwaite
from osl_analysis.stats.regression import linear_fit
from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing

PHASES = np.linspace(0.0, 1.0, 401)
"""Phases of stance at which unperturbed crossings are kept: finer than the markers' frames."""
MARGIN = 8
"""Samples on either side of what is used, for the derivatives' spline."""
GAIT, GAIT_AND_PLATE = "unperturbed crossings", "unperturbed crossings + plate trials"
"""Where the interval of a single perturbation is from; a single trial of the plate cannot tell the plate's share."""


@dataclass(frozen=True)
class NormalGait:
    """Unperturbed crossings at `PHASES`: theta [rad], torque [N*m], (crossings, phases); stance [s], (crossings,).

    `plate_errors` (m, crossings, phases) [N*m]: as those of a `Crossing`.
    """

    names: tuple[str, ...]
    theta: Array
    torque: Array
    stance: Array
    plate_errors: Array


@dataclass(frozen=True)
class Timing:
    """Window [s] after the onset that is fitted; baseline [s], which ends `guard` [s] before the onset."""

    window: float
    baseline: float
    guard: float


@dataclass(frozen=True)
class Response:
    """Isolated response to one perturbation, k samples at `time` [s] from the onset, zero on the baseline's mean.

    `motion` of the ankle's angle and `torque` [N*m]; `thetas` and `torques` (crossings, k) are angle and torque with
    each unperturbed crossing subtracted instead of their mean, for what gait makes of an estimate. `plate_errors`
    (m, k) [N*m]: what leaving out each trial of the unloaded plate does to the torque.
    """

    name: str
    time: Array
    motion: Motion
    torque: Array
    thetas: Array
    torques: Array
    plate_errors: Array
    timing: Timing

    @property
    def window(self) -> slice:
        """Samples of the fitted window."""
        return window_rows(self.time, self.timing)


def window_rows(time: Array, timing: Timing) -> slice:
    """Samples from the onset, where the grid has one, up to but without the window's end: 30 at 300 Hz for 0.1 s."""
    first = int(np.argmin(np.abs(time)))
    return slice(first, first + round(timing.window / (time[1] - time[0])))


def normal_gait(crossings: Sequence[Crossing], fewest: int) -> NormalGait:
    """Unperturbed crossings on a common grid of stance phase: 0 at heel strike, 1 at toe-off.

    Raises
    ------
    InputError
        There are fewer than `fewest`.
    """
    if len(crossings) < fewest:
        raise InputError(
            f"{len(crossings)} unperturbed crossings ({', '.join(c.name for c in crossings) or 'none'}), expected "
            f"{fewest} or more; record more, or exclude fewer in the sheet"
        )
    theta, torque, plate_errors = (
        np.stack(
            [at_times(c, getattr(c, signal), c.stance.heel_strike + PHASES * c.stance.duration) for c in crossings],
            axis=-2,
        )
        for signal in ("theta", "torque", "plate_errors")
    )
    stance = np.array([c.stance.duration for c in crossings])
    return NormalGait(tuple(c.name for c in crossings), theta, torque, stance, plate_errors)


def at_times(crossing: Crossing, signal: Array, time: Array) -> Array:
    """Signals (..., n) of a crossing at other times (k,) [s], by a cubic spline; at the record's ends they are held."""
    inside = np.clip(time, crossing.time[0], crossing.time[-1])
    return np.asarray(make_interp_spline(crossing.time, signal, k=3, axis=-1)(inside))


def isolate(crossing: Crossing, normal: NormalGait, timing: Timing, stance: float) -> Response:
    """The crossing's response to its perturbation.

    Phase is time since heel strike over `stance` [s]: the crossing's own duration, or the unperturbed mean where the
    perturbation changes how long stance lasts. The response is zero on average over the baseline, which ends before
    the zero-phase filter smears the onset into it: zeroing at the onset itself reads K 321 for 340.

    Raises
    ------
    InputError
        The crossing has no onset, or baseline or window leave the phases of the unperturbed gait.
    """
    if crossing.onset is None:
        raise InputError(f"trial {crossing.name}: no perturbation in it; mark it as unperturbed in the sheet")
    time = response_grid(sampling_rate(crossing.time), timing)
    phase = (crossing.onset + time - crossing.stance.heel_strike) / stance
    used = phase[MARGIN:-MARGIN]
    if used[0] < 0 or used[-1] > 1:
        raise InputError(
            f"trial {crossing.name}: baseline and window span {used[0]:.2f}-{used[-1]:.2f} of stance, expected 0-1; "
            "shorten window_s, baseline_s or guard_s, or exclude the trial"
        )
    phase = np.clip(phase, 0.0, 1.0)
    rest = slice(MARGIN, MARGIN + round(timing.baseline * sampling_rate(time)))
    thetas, torques = (
        without_baseline(at_times(crossing, own, crossing.onset + time) - at_phases(others, phase), rest)
        for own, others in ((crossing.theta, normal.theta), (crossing.torque, normal.torque))
    )
    own_errors = at_times(crossing, crossing.plate_errors, crossing.onset + time)
    plate_errors = without_baseline(own_errors - at_phases(normal.plate_errors.mean(axis=1), phase), rest)
    motion = differentiate(time, thetas.mean(axis=0))
    return Response(crossing.name, time, motion, torques.mean(axis=0), thetas, torques, plate_errors, timing)


def response_grid(rate: float, timing: Timing) -> Array:
    """Times [s] from the onset at the marker `rate` [Hz]: baseline, guard and window, with the spline's margins."""
    first = -round((timing.baseline + timing.guard) * rate) - MARGIN
    last = round(timing.window * rate) + MARGIN
    return np.arange(first, last + 1) / rate


def at_phases(curves: Array, phase: Array) -> Array:
    """Curves (..., phases) at other phases (k,): (..., k)."""
    return np.asarray(make_interp_spline(PHASES, curves, k=3, axis=-1)(phase))


def without_baseline(curves: Array, rest: slice) -> Array:
    """Curves (..., k) without their means over the samples `rest` of the baseline."""
    return np.asarray(curves - curves[..., rest].mean(axis=-1, keepdims=True))


def fit_response(response: Response) -> ImpedanceFit:
    """Eq. 15 in the window after the onset, without an offset: the baseline before the onset is the zero.

    An offset would be fitted to whatever of the response is not of second order: it reads K 321 for 334 on the exact
    response of the simulated drivetrain, and 308 if the onset is found 20 ms late. The covariance is what ordinary gait
    makes of an estimate (`gait_errors`) and what the trials of the unloaded plate do (`plate_effects`): the residual of
    the fit, a few correlated samples, knows nothing of either.

    Raises
    ------
    InputError, IdentifiabilityError
        As `linear_fit`, naming the trial: a ramp longer than the window can't tell K from I.
    """
    rows = response.window
    try:
        found = fit_without_offset(response.motion[rows], response.torque[rows])
    except OslAnalysisError as error:
        raise type(error)(f"trial {response.name}: {error}") from error
    gait, plate = gait_errors(response, found), plate_effects(response)
    n = len(gait)
    by_gait, by_plate = (1 + 1 / n) * np.cov(gait, rowvar=False), jackknife_covariance(plate)
    freedom = welch_satterthwaite([np.diag(by_gait), np.diag(by_plate)], [n - 1, max(len(plate) - 1, 1)])
    method = GAIT_AND_PLATE if len(plate) > 1 else GAIT
    known = replace(found.fit, covariance=by_gait + by_plate, degrees_of_freedom=freedom, interval_method=method)
    return replace(found, fit=known)


def gait_errors(response: Response, found: ImpedanceFit) -> Array:
    """Errors (crossings, 3) of K, B, I if what each unperturbed crossing differs from their mean were in the response.

    A perturbed crossing differs as they do, and their mean from the true one by 1/n of the variance. To first order
    an estimate's error is the regression of d_torque - K d_theta - B d_omega - I d_alpha on the response's motion.
    """
    own = differentiate(response.time, (response.motion.theta - response.thetas).T)
    unexplained = (response.torque - response.torques).T - impedance_torque(found.K, found.B, found.I, own)
    return effects_of(unexplained.T, response)


def plate_effects(response: Response) -> Array:
    """What leaving out each of m trials of the unloaded plate does to K, B and I: (m, 3), to first order."""
    return effects_of(response.plate_errors, response)


def effects_of(torques: Array, response: Response) -> Array:
    """What m torques (m, k) [N*m], each added to the response's own, do to K, B and I: (m, 3)."""
    rows, motion = response.window, response.motion
    columns = np.column_stack([motion.theta, motion.omega, motion.alpha])
    return np.asarray(np.linalg.lstsq(columns[rows], torques.T[rows])[0].T)


def jackknife_covariance(left_out: Array) -> Array:
    """Covariance (p, p) of estimates from what leaving out each of m trials does to them, (m, p); 0 with less than two.

    Tukey's: (m - 1)/m times the sum of squares about the mean.
    """
    m, p = left_out.shape
    return (m - 1) ** 2 / m * np.cov(left_out, rowvar=False) if m > 1 else np.zeros((p, p))


def fit_without_offset(motion: Motion, torque: Array) -> ImpedanceFit:
    """K, B, I of a motion (n,) and torque (n,) [N*m] whose zeros are known."""
    fit = linear_fit(torque, {"K": motion.theta, "B": motion.omega, "I": motion.alpha})
    return ImpedanceFit(fit["K"], fit["B"], fit["I"], 0.0, fit)
