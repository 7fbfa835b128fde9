"""The isolated response to a perturbation: the perturbed crossing minus the mean unperturbed gait at the same phase."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import make_interp_spline

from osl_analysis.errors import IdentifiabilityError, InputError, OslAnalysisError
from osl_analysis.second_order import ImpedanceFit, fit_impedance, impedance_torque
from osl_analysis.signals import Motion, differentiate, sampling_rate
from osl_analysis.stats.covariance import welch_satterthwaite
from osl_analysis.stats.regression import linear_fit
from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.gait import BEFORE_ONSET_S, UnperturbedGait, aligned_gait, at_phases, signal_at
from osl_analysis.walking.settings import StanceSource, Timing

MARGIN = 8  # Additional samples at both ends of a response. A spline's derivatives are less accurate at its ends.
BEHAVIOUR = ("angle", "torque", "angle_slope", "torque_slope")
"""What a crossing does before the onset, up to where the filter spreads the response: mean and slope of its curves."""
FROM_GAIT, FROM_GAIT_AND_PLATE = "unperturbed crossings", "unperturbed crossings + plate trials"
"""Sources of the interval of a single perturbation. With a single plate trial the plate's part is unknown."""


@dataclass(frozen=True)
class PerturbationResponse:
    """Isolated response to one perturbation, k samples, zero on average over the baseline. Row i of `thetas` and
    `torques` has the i-th unperturbed crossing subtracted instead of the mean: their scatter shows how gait varies."""

    name: str
    time: Array  # time (k,) [s] from the onset
    motion: Motion  # angle [rad] of the ankle with its derivatives, (k,) each
    torque: Array  # (k,) [N*m]
    thetas: Array  # (crossings, k) [rad]
    torques: Array  # (crossings, k) [N*m]
    plate_errors: Array  # changes (m, k) [N*m] of the torque without each of m plate trials in the plate's model
    behaviour: Array  # (4, crossings), `BEHAVIOUR` before the onset, minus that of the i-th unperturbed crossing
    timing: Timing
    sign: int = 1  # -1 if the platform turned the toes down, else 1
    stance: float = float("nan")  # duration of stance [s] that converts time to phase
    stance_change: float = 0.0  # own stance over the one that the gait before the onset leads to expect, minus 1
    stance_error: float = 0.0  # the same of `stance`; 0 if it is the expected one

    @property
    def window(self) -> slice:
        return window_samples(self.time, self.timing)

    @property
    def fitted_motion(self) -> Motion:
        return self.motion[self.window]

    @property
    def fitted_torque(self) -> Array:
        return self.torque[self.window]


def window_samples(time: Array, timing: Timing) -> slice:
    """Samples from the onset to the end of the window, without that end: 30 for 0.1 s at 300 Hz."""
    first = int(np.argmin(np.abs(time)))
    return slice(first, first + round(timing.window / (time[1] - time[0])))


def isolate_response(
    crossing: Crossing, gait: UnperturbedGait, timing: Timing, perturbed_stance: StanceSource = "own"
) -> PerturbationResponse:
    """The crossing's response to its perturbation. Phase is the time since heel strike over a duration of stance, as of
    `aligned_gait`. The baseline ends before the onset, because the filter spreads the response to earlier times: a
    response zeroed at the onset itself gives K = 321 N*m/rad for a true 340."""
    if crossing.onset is None:
        raise InputError(
            f"trial {crossing.name}: no onset, expected a perturbed crossing; mark it as unperturbed in the sheet"
        )
    aligned = aligned_gait(crossing, gait, perturbed_stance)
    rate = sampling_rate(crossing.time)
    first = round((timing.baseline + timing.guard) * rate) + MARGIN
    time = np.arange(-first, round(timing.window * rate) + MARGIN + 1) / rate
    phase = (crossing.onset + time - crossing.stance.heel_strike) / aligned.stance
    begins, ends = phase[MARGIN], phase[-MARGIN - 1]
    if begins < 0 or ends > 1:
        raise InputError(
            f"trial {crossing.name}: baseline and window span {begins:.2f}-{ends:.2f} of stance, expected 0-1; "
            "shorten window_s, baseline_s or guard_s, or exclude the trial"
        )
    own_time, phase = crossing.onset + time, np.clip(phase, 0.0, 1.0)
    thetas = signal_at(crossing, crossing.theta, own_time) - aligned.curves(gait.theta, phase)
    torques = signal_at(crossing, crossing.torque, own_time) - aligned.curves(gait.torque, phase)
    errors = signal_at(crossing, crossing.plate_errors, own_time) - at_phases(gait.plate_errors.mean(axis=1), phase)
    before = time <= -BEFORE_ONSET_S
    x, curves = time[before] - time[before].mean(), np.array([thetas, torques])[..., before]
    behaviour = np.concatenate([curves.mean(axis=-1), curves @ x / max(float(x @ x), np.finfo(float).tiny)])
    baseline = slice(MARGIN, MARGIN + round(timing.baseline * sampling_rate(time)))
    thetas, torques, errors = (c - c[..., baseline].mean(axis=-1, keepdims=True) for c in (thetas, torques, errors))
    return PerturbationResponse(
        name=crossing.name,
        time=time,
        motion=differentiate(time, thetas.mean(axis=0)),
        torque=torques.mean(axis=0),
        thetas=thetas,
        torques=torques,
        plate_errors=errors,
        timing=timing,
        sign=crossing.sign,
        stance=aligned.stance,
        behaviour=behaviour,
        stance_change=crossing.stance.duration / aligned.expected - 1,
        stance_error=0.0 if perturbed_stance == "matched" else aligned.stance / aligned.expected - 1,
    )


def fit_response(response: PerturbationResponse) -> ImpedanceFit:
    """Fit Eq. 15 without an offset in the window. The zero is the mean over the baseline: an offset would absorb what
    is not of second order (on the exact response of the simulated drivetrain, K = 321 N*m/rad instead of 334). The
    covariance comes from gait (the perturbed crossing deviates as each unperturbed one does, the mean of n with 1/n of
    their variance) and from the plate trials; the residual, a few correlated samples, shows neither."""
    try:
        impedance = fit_without_offset(response.fitted_motion, response.fitted_torque)
    except OslAnalysisError as error:
        raise type(error)(f"trial {response.name}: {error}") from error
    gait = estimate_changes(gait_torque(response, impedance), response)
    plate, n = estimate_changes(response.plate_errors, response), len(gait)
    of_gait, of_plate = (1 + 1 / n) * np.cov(gait, rowvar=False), jackknife_covariance(plate)
    freedom = welch_satterthwaite([np.diag(of_gait), np.diag(of_plate)], [n - 1, max(len(plate) - 1, 1)])
    method = FROM_GAIT_AND_PLATE if len(plate) > 1 else FROM_GAIT
    covariance = of_gait + of_plate
    fit = replace(impedance.fit, covariance=covariance, degrees_of_freedom=freedom, interval_method=method)
    return replace(impedance, fit=fit)


def fit_without_offset(motion: Motion, torque: Array) -> ImpedanceFit:
    """K, B, I of a motion (n,) and torque (n,) [N*m] whose zeros are known."""
    fit = linear_fit(torque, {"K": motion.theta, "B": motion.omega, "I": motion.alpha})
    return ImpedanceFit(fit["K"], fit["B"], fit["I"], 0.0, fit)


def gait_torque(response: PerturbationResponse, impedance: ImpedanceFit) -> Array:
    """Torque (crossings, k) [N*m] that each unperturbed crossing's deviation from their mean adds to a residual:
    d_torque - K d_theta - B d_omega - I d_alpha."""
    deviation = differentiate(response.time, (response.motion.theta - response.thetas).T)
    explained = impedance_torque(impedance.K, impedance.B, impedance.I, deviation)
    return np.asarray(((response.torque - response.torques).T - explained).T)


def estimate_changes(torques: Array, response: PerturbationResponse) -> Array:
    """Changes (m, 3) of K, B, I, to first order, when each of m torques (m, k) [N*m] is added to the response's own: of
    `gait_torque`, or without one plate trial each."""
    rows, motion = response.window, response.motion
    columns = np.column_stack([motion.theta, motion.omega, motion.alpha])
    return np.asarray(np.linalg.lstsq(columns[rows], torques.T[rows])[0].T)


def jackknife_covariance(changes: Array) -> Array:
    """Tukey's covariance (p, p) from the changes (m, p) of estimates when each of m trials is omitted: (m - 1)/m times
    the sum of squares about the mean; 0 with fewer than two trials."""
    m, p = changes.shape
    return (m - 1) ** 2 / m * np.cov(changes, rowvar=False) if m > 1 else np.zeros((p, p))


def offset_comparison(motion: Motion, torque: Array, K: float) -> dict[str, float | None]:
    """A fit to a motion and torque (n,) with an offset [N*m], null if impossible: a large `offset_share`, the relative
    decrease of K [N*m/rad] with it, shows that the response is not of second order."""
    try:
        free = fit_impedance(motion, torque)
    except IdentifiabilityError:
        return {"offset": None, "K_with_offset": None, "offset_share": None}
    return {"offset": free.offset, "K_with_offset": free.K, "offset_share": 1 - free.K / K if K else None}


def response_lag(response: PerturbationResponse) -> tuple[float, float] | None:
    """Lag [s] at which the residual of Eq. 15 is smallest, positive if the torque is late, with its standard error;
    None from 10 ms on. It changes the damping by -K times the lag, and else shows only in the residual. A response that
    is not of second order shifts it too: compare sessions with it, and do not correct the torque."""
    motion, stamps = response.fitted_motion, response.time[response.window]
    later = make_interp_spline(response.time, response.torque, k=5)
    step = 0.001  # [s]
    lags = np.arange(-0.01, 0.01 + step / 2, step)  # within the margin of 8 frames
    misfit = np.empty(len(lags))
    try:
        for i, lag in enumerate(lags):
            torque = np.asarray(later(stamps + lag))
            misfit[i] = np.sum((torque - fit_without_offset(motion, torque).torque(motion)) ** 2)
    except OslAnalysisError:
        return None
    best = int(np.argmin(misfit))
    if best in (0, len(lags) - 1):
        return None
    before, least, after = misfit[best - 1 : best + 2]
    curvature = (before - 2 * least + after) / step**2
    lag = float(lags[best] + 0.5 * step * (before - after) / (before - 2 * least + after))
    fit = fit_without_offset(motion, np.asarray(later(stamps + lag))).fit
    freedom = max(fit.samples / fit.correlation_samples - 4, 1.0)
    return lag, float(np.sqrt(2 * least / freedom / curvature))
