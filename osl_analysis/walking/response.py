"""The response to a perturbation in walking: the perturbed crossing minus unperturbed gait at the
same phase of stance (docs/walking.md); the result of a group of crossings: mean response, its fit,
bootstrap and both directions; and a plan: the intervals that n crossings will have, from the
unperturbed crossings of a pilot.

A perturbation may change the duration of stance. The duration to be expected comes from the ankle's
angle before the onset. The size and drift of a motion differ from step to step and look like pace,
but they cannot imitate the ankle's sharp turn after heel strike. So size and drift are fitted too,
with the order of drift for which the unperturbed scales scatter least. Torque and load would
misread a slower crossing: low-pass and heel impact act in time, not in phase.

Responses to turns in both directions are joined by half their difference, mean up minus mean down
over 2. A reaction that does not depend on the direction, and the error of the mean unperturbed
gait, cancel in it.

The draft subtracts the mean unperturbed gait. A crossing that is unlike the mean before the onset
stays so for a while. The unperturbed crossings tell how: their deviations in the window are
regressed on level and slope of angle and torque before the onset. Cross-validation over unperturbed
crossings decides which of these predictors count, or none.

For a plan, the expected joint's response to the planned turn is added to each unperturbed crossing,
which is analysed against the others. The scatter of K, B and I is then the effect of gait on one
crossing. The mean over n has 1/n of this variance. The mean of m unperturbed crossings adds 1/m of
it, which cancels between directions."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import polars as pl
import scipy
from numpy.typing import NDArray

from osl_analysis import refusal
from osl_analysis.errors import IdentifiabilityError, InputError, naming
from osl_analysis.signals import Motion, differentiate, sampling_rate
from osl_analysis.stats.regression import LinearFit, linear_fit, welch_satterthwaite
from osl_analysis.stats.repeats import CommonError
from osl_analysis.trial import EXACT_FIT_SHARE, REFLEX_DELAYS_MS, Array, rounding_of
from osl_analysis.walking.crossing import DOWN, UP, Crossing
from osl_analysis.walking.settings import (
    EnsembleSettings,
    ResponseSettings,
    StanceSource,
    TimingSettings,
)

# Phases of stance at which crossings are sampled, finer than the frames
PHASES = np.linspace(0.0, 1.0, 401)


@dataclass(frozen=True)
class UnperturbedGait:
    """Unperturbed crossings at `PHASES`: 0 at heel strike, 1 at toe-off."""

    names: tuple[str, ...]
    theta: Array  # angle of the ankle (crossings, phases) [rad]
    torque: Array  # (crossings, phases) [N*m]
    stance: Array  # duration of stance (crossings,) [s]
    plate_errors: Array  # (m, crossings, phases) [N*m], as in `Crossing`
    lab_errors: Array  # (6, crossings, phases) [N*m], as in `Crossing`


def unperturbed_gait(
    crossings: Sequence[Crossing], fewest: int, lost: Mapping[str, str] | None = None
) -> UnperturbedGait:
    """Crossings on the common grid of stance phase. `lost`: why other crossings are not used, by
    trial."""
    if len(crossings) < fewest:
        used = ", ".join(c.name for c in crossings)
        if not lost:
            raise InputError(
                f"{len(crossings)} unperturbed crossings ({used or 'none'}), expected {fewest} or"
                " more; record more, or exclude fewer in the sheet"
            )
        # The most frequent reason, in one trial's words. Reasons that differ only in numbers or
        # trial name are one.
        kinds = {trial: refusal.alike(why, trial) for trial, why in lost.items()}
        kind, count = Counter(kinds.values()).most_common(1)[0]
        alike = [trial for trial, of in kinds.items() if of == kind]
        said = lost[alike[0]].removeprefix(f"trial {alike[0]}: ")
        named = f" ({', '.join(alike)})" if 1 < count <= 8 else ""
        others = f" beside {len(lost) - count} for other reasons, which walking_crossings.csv lists"
        raise InputError(
            f"{len(crossings)} of {len(crossings) + len(lost)} unperturbed crossings can be used"
            f"{f' ({used})' if used else ''}, expected {fewest} or more; {count} times"
            f"{named}{others if count < len(lost) else ''}, as in {alike[0]}: {said}"
        )
    theta, torque, *errors = (
        np.stack([signal_at(c, getattr(c, signal), stance_times(c)) for c in crossings], axis=-2)
        for signal in ("theta", "torque", "plate_errors", "lab_errors")
    )
    stance = np.array([c.stance.duration for c in crossings])
    return UnperturbedGait(tuple(c.name for c in crossings), theta, torque, stance, *errors)


def stance_times(crossing: Crossing, phases: Array = PHASES) -> Array:
    """Times [s] of the phases (k,) of a crossing's stance."""
    return crossing.stance.heel_strike + phases * crossing.stance.duration


def signal_at(crossing: Crossing, signal: Array, time: Array) -> Array:
    """Signals (..., n) of a crossing at other times (k,) [s], by a cubic spline; constant beyond
    the recording."""
    spline = scipy.interpolate.make_interp_spline(crossing.time, signal, k=3, axis=-1)
    return np.asarray(spline(np.clip(time, crossing.time[0], crossing.time[-1])))


SMALLEST, LARGEST = 0.75, 1.33  # Bounds of a scale


def matched_scales(phase: Array, curves: Array, mean: Array) -> Array:
    """Scales r (8, m) of curves (m, k) at phases p (k,). The model is a multiple of the mean curve
    (n,) at phases r p, plus a drift, a polynomial of order 1 to 8. NaN if Gauss-Newton from 1 does
    not converge within bounds."""
    spline = scipy.interpolate.make_interp_spline(np.linspace(0.0, 1.0, len(mean)), mean, k=3)
    slope = spline.derivative()
    orders = np.arange(1, 9)
    # orthonormal polynomials
    drift = np.linalg.qr(np.vander(phase / phase[-1], orders[-1] + 1, increasing=True))[0]
    used = (np.arange(drift.shape[1]) <= orders[:, None])[:, None].astype(float)

    def beside(curves: Array) -> Array:
        """Curves (orders, m, k) without the drift of each order."""
        return np.asarray(curves - ((curves @ drift) * used) @ drift.T)

    nothing = len(phase) * rounding_of(mean)
    scales = np.ones((len(orders), len(curves)))
    step = np.full_like(scales, np.inf)
    last = 1e-6  # step that ends the search
    for _ in range(15):
        there = np.clip(scales[..., None] * phase, 0.0, 1.0)
        expected = spline(there)
        size, change, left = (
            beside(v) for v in (expected, phase * slope(there), curves - expected)
        )
        # the coefficient of `change` in the regression of `left` on `size` and `change`, if it is
        # determined
        ff, fs, ss = (
            np.sum(a * b, axis=-1) for a, b in ((size, size), (size, change), (change, change))
        )
        alone = ss * ff - fs**2
        some = (ff > nothing) & (ss > nothing) & (alone > nothing * ff)
        found = ff * np.sum(change * left, axis=-1) - fs * np.sum(size * left, axis=-1)
        step = np.clip(np.where(some, found, np.nan) / np.where(some, alone, 1.0), -0.05, 0.05)
        scales = np.clip(scales + step, SMALLEST, LARGEST)
        if np.all(np.abs(step) < last):
            break
    settled = (np.abs(step) < last) & (scales > SMALLEST) & (scales < LARGEST)
    return np.where(settled, scales, np.nan)


# [s] before the onset that matching leaves out: the filter spreads the response into it
BEFORE_ONSET_S = 0.03


@dataclass(frozen=True)
class AlignedGait:
    """The phases of a perturbed crossing and of the unperturbed ones on the mean gait."""

    stance: float  # duration of stance [s] that converts the perturbed crossing's time to phase
    # (crossings,) phase on the mean gait over own phase, of each unperturbed crossing
    scales: Array
    # duration of stance [s] expected from the gait before the onset; NaN: no pace fits
    expected: float

    def curves(self, unperturbed: Array, phase: Array) -> Array:
        """The unperturbed curves (crossings, `PHASES`) at phases (k,) of the mean gait: (crossings,
        k)."""
        own = np.clip(phase / self.scales[:, None], 0.0, 1.0)
        spline, made = (
            scipy.interpolate.make_interp_spline(PHASES, unperturbed.T, 3),
            scipy.interpolate.BSpline,
        )
        return np.array(
            [made.construct_fast(spline.t, spline.c[:, k], 3)(there) for k, there in enumerate(own)]
        )


def aligned_gait(crossing: Crossing, gait: UnperturbedGait, source: StanceSource) -> AlignedGait:
    """The alignment of a perturbed crossing, whose duration of stance comes from `source`."""
    own, usual = crossing.stance.duration, float(np.mean(gait.stance))
    onset, scale, others = crossing.onset, np.nan, np.full(len(gait.names), np.nan)
    last = crossing.stance.toe_off if onset is None else onset
    phase = PHASES[(last - BEFORE_ONSET_S - crossing.stance.heel_strike) / own >= PHASES]
    if len(phase) >= 20:  # 5 % of stance between heel strike and onset: a pace can be read
        theta = signal_at(crossing, crossing.theta, stance_times(crossing, phase))
        # enough after a low-pass of 20 Hz
        both = np.vstack([theta, gait.theta[:, : len(phase)]])[:, ::4]
        found = matched_scales(phase[::4], both, gait.theta.mean(axis=0))
        # The order of drift is the one at which all curves have a scale and the unperturbed scales
        # scatter least.
        scatters = np.where(np.isfinite(found).all(axis=1), np.std(found[:, 1:], axis=1), np.inf)
        best = int(np.argmin(scatters))
        if np.isfinite(scatters[best]):
            scale, others = float(found[best, 0]), found[best, 1:]
    expected = own / scale * float(others.mean())
    if source != "matched":
        return AlignedGait(own if source == "own" else usual, np.ones(len(gait.names)), expected)
    if not np.isfinite(scale):
        raise InputError(
            f"trial {crossing.name}: its angle before the onset tells no pace from {SMALLEST:g} to"
            f" {LARGEST:g} of the mean unperturbed gait: it has no sharp turn after heel strike, or"
            " is of another gait; state perturbed_stance: own, or give it another group"
        )
    return AlignedGait(own / scale, others, expected)


# Additional samples at both ends of a response. A spline's derivatives are less accurate at its
# ends.
MARGIN = 8
# mean and slope of curves before the response begins
BEHAVIOUR = ("angle", "torque", "angle_slope", "torque_slope")
# some of `BEHAVIOUR`; if empty, the prediction is the mean unperturbed gait
Predictors = tuple[str, ...]


@dataclass(frozen=True)
class PerturbationResponse:
    """Isolated response to one perturbation, k samples, zero on average over the baseline. Row i of
    `thetas` and `torques` is the crossing minus the i-th unperturbed one. The response is the mean
    row; the rows scatter by gait."""

    name: str
    time: Array  # time (k,) [s] from the onset
    thetas: Array  # (crossings, k) [rad]
    torques: Array  # (crossings, k) [N*m]
    # changes (m, k) [N*m] of the torque without each of m plate trials in the plate's model
    plate_errors: Array
    lab_errors: Array  # changes (6, k) [N*m] of the torque by each of `crossing.LABORATORY_ERRORS`
    # (4, crossings): `BEHAVIOUR` before the onset minus that of each unperturbed crossing
    behaviour: Array
    # samples of the fitted window, from the onset, without its end: 30 for 0.1 s at 300 Hz
    window: slice
    sign: int = 1  # -1 if the platform turned the toes down, else 1
    stance: float = float("nan")  # duration of stance [s] that converts time to phase
    stance_change: float = 0.0  # own duration of stance over the expected one, minus 1
    # `stance` over the expected duration, minus 1; 0 if it is the expected one
    stance_error: float = 0.0

    @cached_property
    def motion(self) -> Motion:
        """Angle [rad] of the ankle with its derivatives, (k,) each."""
        return differentiate(self.time, self.thetas.mean(axis=0))

    @property
    def torque(self) -> Array:
        """(k,) [N*m]."""
        return np.asarray(self.torques.mean(axis=0))

    @property
    def fitted_motion(self) -> Motion:
        return self.motion[self.window]

    @property
    def fitted_torque(self) -> Array:
        return self.torque[self.window]


def isolate_response(
    crossing: Crossing,
    gait: UnperturbedGait,
    timing: TimingSettings,
    perturbed_stance: StanceSource = "own",
) -> PerturbationResponse:
    """The crossing's response to its perturbation, at phases from `aligned_gait`. The baseline ends
    before the onset, because the filter spreads the response. A response zeroed at the onset gives
    K = 321 N*m/rad for a true 340."""
    if crossing.onset is None:
        raise InputError(
            f"trial {crossing.name}: no onset, expected a perturbed crossing; mark it as"
            " unperturbed in the sheet"
        )
    aligned = aligned_gait(crossing, gait, perturbed_stance)
    rate = sampling_rate(crossing.time)
    first = round((timing.baseline_s + timing.guard_s) * rate) + MARGIN
    time = np.arange(-first, round(timing.window_s * rate) + MARGIN + 1) / rate
    phase = (crossing.onset + time - crossing.stance.heel_strike) / aligned.stance
    begins, ends = phase[MARGIN], phase[-MARGIN - 1]
    if begins < 0 or ends > 1:
        raise InputError(
            f"trial {crossing.name}: baseline and window span {begins:.2f}-{ends:.2f} of stance,"
            " expected 0-1; shorten window_s, baseline_s or guard_s, or exclude the trial"
        )
    own_time, phase = crossing.onset + time, np.clip(phase, 0.0, 1.0)
    thetas = signal_at(crossing, crossing.theta, own_time) - aligned.curves(gait.theta, phase)
    torques = signal_at(crossing, crossing.torque, own_time) - aligned.curves(gait.torque, phase)
    errors, of_lab = (
        signal_at(crossing, own, own_time)
        - scipy.interpolate.make_interp_spline(PHASES, usual.mean(axis=1), k=3, axis=-1)(phase)
        for own, usual in (
            (crossing.plate_errors, gait.plate_errors),
            (crossing.lab_errors, gait.lab_errors),
        )
    )
    before = time <= -BEFORE_ONSET_S
    x, curves = time[before] - time[before].mean(), np.array([thetas, torques])[..., before]
    behaviour = np.concatenate(
        [curves.mean(axis=-1), curves @ x / max(float(x @ x), np.finfo(float).tiny)]
    )
    baseline = slice(MARGIN, MARGIN + round(timing.baseline_s * sampling_rate(time)))
    every = thetas, torques, errors, of_lab
    thetas, torques, errors, of_lab = (
        c - c[..., baseline].mean(axis=-1, keepdims=True) for c in every
    )
    return PerturbationResponse(
        name=crossing.name,
        time=time,
        thetas=thetas,
        torques=torques,
        plate_errors=errors,
        lab_errors=of_lab,
        behaviour=behaviour,
        window=slice(first, first + round(timing.window_s / (time[1] - time[0]))),
        sign=crossing.sign,
        stance=aligned.stance,
        stance_change=crossing.stance.duration / aligned.expected - 1,
        stance_error=(
            0.0 if perturbed_stance == "matched" else aligned.stance / aligned.expected - 1
        ),
    )


def fit_response(response: PerturbationResponse) -> LinearFit:
    """Fit Eq. 15 in the window, without an offset. An offset would absorb torque that is not of
    second order: K = 321 N*m/rad instead of 334 on the exact response of the simulated drivetrain.
    The covariance comes from gait (the perturbed crossing deviates like an unperturbed one, and the
    mean of n adds 1/n of the variance) and from the plate trials, if there are several. The
    residual has a few correlated samples and shows neither."""
    with naming(f"trial {response.name}"):
        fit = fit_without_offset(response.fitted_motion, response.fitted_torque)
    gait, plate = estimate_changes(response, fit)
    n, m = len(gait), len(plate)
    of_gait, of_plate = (1 + 1 / n) * np.cov(gait, rowvar=False), jackknife_covariance(plate)
    return replace(
        fit,
        covariance=of_gait + of_plate,
        degrees_of_freedom=welch_satterthwaite(
            [np.diag(of_gait), np.diag(of_plate)], [n - 1, max(m - 1, 1)]
        ),
        interval_method="unperturbed crossings" + (" + plate trials" if m > 1 else ""),
    )


def impedance_columns(motion: Motion) -> dict[str, Array]:
    """Columns of Eq. 15, torque = K theta + B omega + I alpha, of a motion (n,). Angle and torque
    must have passed the same filter: if only the angle is filtered at 15 Hz, B is 3.43 instead of
    3."""
    return {"K": motion.theta, "B": motion.omega, "I": motion.alpha}


def fit_without_offset(motion: Motion, torque: Array) -> LinearFit:
    """K [N*m/rad], B [N*m*s/rad], I [kg*m^2] of a motion (n,) and torque (n,) [N*m] whose zeros are
    known."""
    return linear_fit(torque, impedance_columns(motion))


def gait_torque(response: PerturbationResponse, fit: LinearFit) -> Array:
    """Torque (crossings, k) [N*m] that each unperturbed crossing's deviation from their mean adds
    to a residual."""
    deviation = differentiate(response.time, (response.motion.theta - response.thetas).T)
    explained = fit["K"] * deviation.theta + fit["B"] * deviation.omega + fit["I"] * deviation.alpha
    return np.asarray(response.torque - response.torques - explained.T)


def estimate_changes(response: PerturbationResponse, fit: LinearFit) -> tuple[Array, Array]:
    """First-order changes of K, B, I: (crossings, 3) by each unperturbed crossing, (m, 3) without
    each plate trial."""
    columns, rows = response.fitted_motion.columns, response.window
    gait, plate = (
        np.asarray(np.linalg.lstsq(columns, torques.T[rows])[0].T, float)
        for torques in (gait_torque(response, fit), response.plate_errors)
    )
    return gait, plate


def jackknife_covariance(changes: Array) -> Array:
    """Tukey's covariance (p, p) from the changes (m, p) of estimates without each of m trials; 0
    with one."""
    m, p = changes.shape
    return (m - 1) ** 2 / m * np.cov(changes, rowvar=False) if m > 1 else np.zeros((p, p))


def offset_comparison(motion: Motion, torque: Array, K: float) -> tuple[float, float]:
    """Offset [N*m] of a fit with an offset to a motion and torque (n,), and by how much it lowers
    `K`, as a share. The decrease is large if the response is not of second order. NaN if the fit is
    impossible."""
    try:
        free = linear_fit(torque, impedance_columns(motion) | {"offset": np.ones_like(torque)})
    except IdentifiabilityError:
        return float("nan"), float("nan")
    return free["offset"], 1 - free["K"] / K if K else float("nan")


@dataclass(frozen=True)
class EnsembleResponse:
    """Mean over n perturbations, k samples: angle [rad], torque [N*m], and Eq. 15 in the window."""

    n: int
    motion: Motion
    torque: Array
    fit: LinearFit

    def estimates(self) -> dict[str, float]:
        return {name: self.fit[name] for name in "KBI"} | {"VAF": self.fit.vaf}


@dataclass(frozen=True)
class Bootstrap:
    """Estimates of resampled ensembles: K, B, I and VAF [percent] of each sample; the degrees of
    freedom, the smaller of those of perturbations and unperturbed crossings; and `reactions`,
    unless it is of one direction."""

    draws: Mapping[str, Array]
    degrees_of_freedom: float
    reactions: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def se(self, name: str) -> float:
        """Standard error of a quantity, in its unit."""
        return float(np.std(self.draws[name], ddof=1))

    def interval(self, name: str) -> tuple[float, float]:
        """Bounds of the 95 % interval of a quantity: percentiles, widened for Student's t
        (Hesterberg, 2015)."""
        tail = float(scipy.special.ndtr(scipy.special.stdtrit(self.degrees_of_freedom, 0.025)))
        low, high = np.quantile(self.draws[name], [tail, 1 - tail])
        return float(low), float(high)


def signs_of(responses: Sequence[PerturbationResponse]) -> NDArray[np.int_]:
    """Directions (n,) of responses: 1 or -1 if there are two, else all 1."""
    signs = np.array([r.sign for r in responses])
    return signs if len(np.unique(signs)) > 1 else np.ones_like(signs)


def joining_weights(signs: NDArray[np.int_]) -> Array:
    """Weights (n,) of responses with `signs` (n,) in their mean, or in half the difference of two
    directions."""
    count = np.where(signs > 0, np.sum(signs > 0), np.sum(signs < 0))
    return np.asarray(signs / count / len(np.unique(signs)))


def resampling_weights(random: np.random.Generator, samples: int, n: int) -> Array:
    """Weights (samples, n) of n items in the mean of n - 1 draws with replacement. The mean of n
    draws would have a variance too small by (n - 1)/n (Hesterberg, The American Statistician 69,
    2015). A single item has weight 1."""
    if n < 2:
        return np.ones((samples, n))
    return random.multinomial(n - 1, np.full(n, 1 / n), size=samples) / (n - 1)


SLOPING, RAMP = "a stiffness that changes with stance", "a voluntary torque or another pace"
REFLEX, STIFFER = "a reflex", "co-contraction"
# they begin after the delay; at half the window (two); at the onset
REACTIONS = (REFLEX, STIFFER, RAMP, SLOPING)


def reflex_column(time: Array, window: slice, motion: Motion, delay_s: float) -> Array:
    """Velocity (k, samples) [rad/s] a delay [s] ago with which the turn stretches a muscle: the
    half-wave in the turn's direction. The muscle also feels the velocity of gait. So a return
    counts up to a share of the largest velocity."""
    way = np.sign(motion.theta[window.stop - 1, 0])
    before = np.maximum(time - delay_s, time[0])
    past = way * np.asarray(scipy.interpolate.make_interp_spline(time, motion.omega, k=3)(before))
    # share of the largest velocity that gait itself has; the low-pass swings back by less
    returns = 0.2
    return np.asarray(way * np.maximum(past, -returns * past.max(axis=0)))


def reaction_columns(time: Array, window: slice, motion: Motion, delay_s: float) -> list[Array]:
    """Regression columns (k, samples) of `REACTIONS`, with the units of their coefficients:
    `reflex_column` [N*m*s/rad], the angle from half the window on [N*m/rad], a ramp from then on
    [N*m/s], and angle times time [N*m/rad/s]. Steps and ramps are smoothed as by the low-pass."""
    half = 0.5 * (window.stop - window.start) * float(time[1] - time[0])
    width, since, now = 0.2 * half, (time - half)[:, None], np.maximum(time, 0.0)[:, None]
    step, density = (
        scipy.special.ndtr(since / width),
        np.exp(-0.5 * (since / width) ** 2) / np.sqrt(2 * np.pi),
    )
    ramp = np.broadcast_to(since * step + width * density, motion.theta.shape)
    stiffer = motion.theta * scipy.special.ndtr(since / width - 1.5)
    return [reflex_column(time, window, motion, delay_s), stiffer, ramp, motion.theta * now]


def reactions(
    time: Array, window: slice, theta: Array, torque: Array
) -> dict[str, tuple[float, float]]:
    """Sizes of `REACTIONS` beside Eq. 15, each with its standard error. Theta and torque (k, 1 +
    samples) are the mean response, in the first column, and its resamples. Each reaction but the
    reflex is added to Eq. 15 alone, and `and jerk` together with the jerk, which the third-order
    drivetrain of a leg causes.

    The reflex is always fitted with the jerk: `REFLEX` for each of `REFLEX_DELAYS_MS`, and for the
    best `delay` [ms]. A reflex that yields must fit certainly better than one that resists. K is
    given for each delay that fits nearly as well. The fit is generalised least squares from 0.6
    windows before the onset on. Residuals are weighed by their covariance over the resamples:
    deviations before the onset tell those after it (Aitken). Few crossings have a singular
    covariance, so 3 % of its mean variance is added."""
    motion, window_s = (
        differentiate(time, theta),
        (window.stop - window.start) * float(time[1] - time[0]),
    )
    rows = slice(max(MARGIN, int(np.searchsorted(time, -0.6 * window_s - 1e-9))), window.stop)
    sound = [motion.theta, motion.omega, motion.alpha]
    jerk = np.asarray(scipy.interpolate.make_interp_spline(time, theta, k=5).derivative(3)(time))
    plain = np.linalg.lstsq(np.stack(sound, -1)[window, 0], torque[window, 0])[0]
    noise = np.cov((torque - np.tensordot(plain, sound, 1))[:, 1:])

    def fitted(columns: Sequence[Array]) -> tuple[Array, float]:
        """Estimates (1 + samples, columns) of the fit, and chi-square of the mean's fit."""
        # [(N*m)^2]
        own, least = noise[rows, rows], 1e-12 * float(np.mean(torque[rows, 0] ** 2)) + 1e-24
        root = np.linalg.cholesky(
            own + (0.03 * np.trace(own) / len(own) + least) * np.eye(len(own))
        )
        X = np.linalg.solve(root, np.stack(columns)[:, rows]).transpose(2, 1, 0)
        y = np.linalg.solve(root, torque[rows]).T[..., None]
        sizes = np.linalg.norm(X, axis=1, keepdims=True)
        X = X / np.where(sizes > 0, sizes, 1.0)
        estimates = np.linalg.pinv(X.swapaxes(1, 2) @ X, hermitian=True) @ (X.swapaxes(1, 2) @ y)
        left = float(np.sum((y[0] - X[0] @ estimates[0]) ** 2))
        return (estimates / np.where(sizes > 0, sizes, 1.0).swapaxes(1, 2))[..., 0], left

    def told(estimates: Array) -> tuple[float, float]:
        """The estimate, the first of (1 + samples,), and its standard error."""
        return float(estimates[0]), float(estimates[1:].std(ddof=1))

    found, misfits = dict[str, tuple[float, float]](), dict[int, float]()
    for delay in REFLEX_DELAYS_MS:
        late, left = fitted([*sound, jerk, reflex_column(time, window, motion, 1e-3 * delay)])
        found |= {
            f"{REFLEX} {delay}": told(late[:, -1]),
            f"K with {REFLEX} {delay}": told(late[:, 0]),
        }
        # a reflex that yields must fit better by four standard deviations
        misfits[delay] = left if late[0, -1] > 0 else left + 16.0
    best = min(misfits, key=lambda delay: misfits[delay])
    found |= {REFLEX: found[f"{REFLEX} {best}"], "delay": (float(best), 0.0)}
    # the interval of K includes delays that fit nearly as well, within two standard deviations
    for delay in misfits:
        if misfits[delay] > misfits[best] + 4.0:
            del found[f"K with {REFLEX} {delay}"]
    columns = reaction_columns(time, window, motion, 1e-3 * best)
    for name, column in zip(REACTIONS[1:], columns[1:], strict=True):
        for beside, others in ((name, sound), (f"{name} and jerk", [*sound, jerk])):
            found[beside] = told(fitted([*others, column])[0][:, -1])
    return found


class Ensemble:
    """The n responses of a group against c unperturbed crossings, k samples, stacked: theta and
    torque (n, c, k), behaviour (n, 4, c), directions (n,), and the influence (n, m, k) of each of m
    plate trials on the torque."""

    def __init__(self, responses: Sequence[PerturbationResponse]) -> None:
        if len(responses) < 2:
            raise InputError(
                f"perturbations in the ensemble: {len(responses)}, expected 2 or more; record more"
            )
        self.signs, self.time, self.window = (
            signs_of(responses),
            responses[0].time,
            responses[0].window,
        )
        for sign, word in ((1, UP), (-1, DOWN)):
            if np.sum(self.signs == sign) == 1:
                raise InputError(
                    f"1 perturbation turns the toes {word} and {len(self.signs) - 1} the other way,"
                    " expected 2 or more of each to join them; record more, or exclude it in the"
                    " sheet"
                )
        first = responses[0]
        for r in responses[1:]:
            shapes = r.thetas.shape, r.plate_errors.shape
            if shapes != (first.thetas.shape, first.plate_errors.shape) or not np.allclose(
                r.time, first.time
            ):
                raise InputError(
                    f"trial {r.name}: {len(r.time)} samples from {len(r.thetas)} unperturbed"
                    f" crossings and {len(r.plate_errors)} plate trials, but trial {first.name} has"
                    f" {len(first.time)} from {len(first.thetas)} and {len(first.plate_errors)}, or"
                    " other sampling times; record all crossings at one marker rate and run the"
                    " analysis again"
                )
        self.theta, self.torque, self.behaviour, plate = (
            np.array([getattr(r, name) for r in responses])
            for name in ("thetas", "torques", "behaviour", "plate_errors")
        )
        trials = plate.shape[1]
        self.influence = (
            -(trials - 1) * (plate - plate.mean(axis=1, keepdims=True)) if trials > 1 else plate
        )

    def joined(
        self, weights: Array, unperturbed: Array, predictors: Predictors = ()
    ) -> tuple[Array, Array]:
        """Angle and torque (k,) of the responses joined with `weights` (n,). Unperturbed gait is
        the mean of the crossings with weights `unperturbed` (c,), or its prediction for each
        direction."""
        if not predictors:
            theta, torque = (
                np.tensordot(weights, curves, 1) for curves in (self.theta, self.torque)
            )
            return unperturbed @ theta, unperturbed @ torque
        chosen, used, parts = [BEHAVIOUR.index(name) for name in predictors], unperturbed > 0, []
        for sign in np.unique(self.signs[weights != 0]):
            own, baseline = np.where(self.signs == sign, weights, 0.0), unperturbed
            if used.sum() >= len(chosen) + 2:
                # The prediction is the weighted regression of the curves at behaviour 0: behaviour
                # is the perturbed crossing's minus the unperturbed one's.
                behaviour = np.tensordot(own, self.behaviour, 1)[chosen]
                sizes = np.sqrt(np.mean(behaviour**2, axis=1, keepdims=True))
                columns = np.column_stack(
                    [np.ones_like(unperturbed), (behaviour / np.where(sizes > 0, sizes, 1.0)).T]
                )
                root = np.sqrt(unperturbed)
                baseline = root * np.linalg.pinv(root[:, None] * columns)[0]
            parts.append(
                (
                    baseline @ np.tensordot(own, self.theta, 1),
                    baseline @ np.tensordot(own, self.torque, 1),
                )
            )
        theta, torque = np.sum(parts, axis=0)
        return theta, torque

    def fitted(self, predictors: Predictors = (), sign: int = 0) -> EnsembleResponse:
        """Mean response (or half the difference of two directions, or the mean of one `sign`), with
        its fit."""
        crossings, own = self.theta.shape[1], self.signs == sign
        weights = own / own.sum() if sign else joining_weights(self.signs)
        theta, torque = self.joined(weights, np.full(crossings, 1 / crossings), predictors)
        motion = differentiate(self.time, theta)
        fit = fit_without_offset(motion[self.window], torque[self.window])
        return EnsembleResponse(int(own.sum()) if sign else len(own), motion, torque, fit)

    def resampled(self, samples: int, predictors: Predictors = (), sign: int = 0) -> Bootstrap:
        """The ensemble, refitted to resamples of perturbations (within their direction),
        unperturbed crossings and, to first order, plate trials. Errors of mean gait and plate are
        common to all responses: the responses' scatter does not show them. With a `sign`, the mean
        of that direction alone, from the same draws."""
        # the same data give the same interval
        random, signs = np.random.default_rng(20), self.signs
        perturbed = np.empty((samples, len(signs)))
        for each in np.unique(signs)[::-1]:
            perturbed[:, signs == each] = resampling_weights(
                random, samples, int(np.sum(signs == each))
            )
        sizes = self.theta.shape[1], self.influence.shape[1]
        of_gait, of_plate = (resampling_weights(random, samples, size) for size in sizes)
        weights = perturbed * (signs == sign) if sign else perturbed * signs / len(np.unique(signs))
        angles, torques = np.empty((2, len(self.time), samples))
        for i, (w, unperturbed, unloaded) in enumerate(
            zip(weights, of_gait, of_plate, strict=True)
        ):
            angles[:, i], torques[:, i] = self.joined(w, unperturbed, predictors)
            torques[:, i] += unloaded @ np.tensordot(w, self.influence, 1)
        # degrees of freedom of a mean, or of a difference of two means (Welch, equal variances)
        counts = np.unique(signs[signs == sign] if sign else signs, return_counts=True)[1].tolist()
        own = float(welch_satterthwaite([1 / n for n in counts], [n - 1 for n in counts]))
        freedom = min(own, self.theta.shape[1] - 1 - len(predictors))
        # as `fit_without_offset` and `variance_accounted_for`, for all samples at once
        motion, y = differentiate(self.time, angles)[self.window], torques[self.window].T
        columns = np.stack([motion.theta.T, motion.omega.T, motion.alpha.T], axis=-1)
        sizes = np.linalg.norm(columns, axis=1, keepdims=True)
        estimates = np.linalg.pinv(columns / sizes) @ y[..., None] / sizes.swapaxes(1, 2)
        left, variance = (y - (columns @ estimates)[..., 0]).var(axis=1), y.var(axis=1)
        rounding = EXACT_FIT_SHARE * np.mean(y**2, axis=1)
        share = np.divide(
            left, variance, out=(left > rounding).astype(float), where=variance > rounding
        )
        draws = dict(zip("KBI", estimates[:, :, 0].T, strict=True)) | {"VAF": 100 * (1 - share)}
        if sign:
            return Bootstrap(draws, freedom)
        mean = self.fitted(predictors)
        both = np.column_stack([mean.motion.theta, angles]), np.column_stack([mean.torque, torques])
        return Bootstrap(draws, freedom, reactions(self.time, self.window, *both))


def cross_validated(
    responses: Sequence[PerturbationResponse], fit: LinearFit
) -> tuple[Predictors, float]:
    """The predictors that best predict, from the others, the torque that each unperturbed crossing
    adds to the residual of the mean's fit; and the share of its mean square that they predict.
    None: the mean is at least as good."""
    curves = np.mean([gait_torque(r, fit)[:, responses[0].window] for r in responses], axis=0)
    behaviour, missed = np.mean([r.behaviour for r in responses], axis=0), dict[Predictors, float]()
    for predictors in ((), ("angle_slope",), ("angle", "torque"), BEHAVIOUR):
        # too few for the bootstrap's regressions
        if predictors and len(curves) < 3 * len(predictors) + 4:
            continue
        some = behaviour[[BEHAVIOUR.index(name) for name in predictors]]
        columns = np.column_stack(
            [np.ones(len(curves)), (some - some.mean(axis=1, keepdims=True)).T]
        )
        sizes = np.sqrt(np.mean(columns**2, axis=0))
        columns = columns / np.where(sizes > 0, sizes, 1.0)
        hat = columns @ np.linalg.pinv(columns)
        # 0 for a curve that determines a coefficient alone
        alone = np.maximum(1 - np.diag(hat), 1e-9)
        missed[predictors] = float(np.mean(((curves - hat @ curves) / alone[:, None]) ** 2))
    best = min(missed, key=lambda predictors: missed[predictors])
    return best, 1 - missed[best] / missed[()] if best else 0.0


def common_errors(
    responses: Sequence[PerturbationResponse],
) -> tuple[dict[str, list[CommonError]], dict[str, float]]:
    """Variances of the errors of K, B and I that all perturbations share (mean gait, plate), with
    their degrees of freedom; and the variances of one perturbation by the scatter of unperturbed
    crossings."""
    shares = np.abs(joining_weights(signs_of(responses)))
    changes = [
        estimate_changes(r, fit_without_offset(r.fitted_motion, r.fitted_torque)) for r in responses
    ]
    of_one = np.mean([np.var(gait, axis=0, ddof=1) for gait, _ in changes], axis=0)
    gait, plate = (np.average(each, axis=0, weights=shares) for each in zip(*changes, strict=True))
    gait_variances, plate_variances = (
        np.var(gait, axis=0, ddof=1) / len(gait),
        np.diag(jackknife_covariance(plate)),
    )
    common: dict[str, list[CommonError]] = {
        name: [(float(g), len(gait) - 1), (float(p), max(len(plate) - 1, 1))]
        for name, g, p in zip("KBI", gait_variances, plate_variances, strict=True)
    }
    return common, dict(zip("KBI", of_one.tolist(), strict=True))


@dataclass(frozen=True)
class GroupHeadline:
    responses: Sequence[PerturbationResponse]
    common: Mapping[str, Sequence[CommonError]]  # errors that all single fits share, by quantity
    # variance of one perturbation as unperturbed crossings scatter, by quantity
    of_one: Mapping[str, float]
    directions: Mapping[str, tuple[Mapping[str, float], Bootstrap, int]]
    """For `up`, `down` and `up minus down`: estimates, resamples, number of perturbations. Empty
    for one direction."""
    # share of the unperturbed crossings' deviations that their behaviour before the onset predicts
    share: float
    ensemble: EnsembleResponse  # with the baseline that the settings name
    resampled: Bootstrap
    # with the other baseline, and the name of that estimator
    other: tuple[str, EnsembleResponse, Bootstrap]


def group_headline(
    perturbed: Sequence[Crossing], gait: UnperturbedGait, settings: EnsembleSettings
) -> GroupHeadline:
    """The result of the perturbed crossings of one group, whose mean unperturbed gait is `gait`."""
    responses = [isolate_response(c, gait, settings, settings.perturbed_stance) for c in perturbed]
    ensemble, samples = Ensemble(responses), settings.bootstrap_samples
    of_mean = ensemble.fitted(), ensemble.resampled(samples)
    names, share = cross_validated(responses, of_mean[0].fit)
    predicted = (ensemble.fitted(names), ensemble.resampled(samples, names)) if names else of_mean
    if settings.baseline == "predicted":
        own, other = predicted, ("ensemble, mean gait", *of_mean)
    else:
        own, other = of_mean, ("ensemble, predicted gait", *predicted)
    directions = dict[str, tuple[Mapping[str, float], Bootstrap, int]]()
    for name, sign in ((UP, 1), (DOWN, -1)) if len(np.unique(ensemble.signs)) > 1 else ():
        mean = ensemble.fitted(sign=sign)
        directions[name] = mean.estimates(), ensemble.resampled(samples, sign=sign), mean.n
    if directions:  # the same draws: the error of mean gait does not cancel in the difference
        (up, ups, n_up), (down, downs, n_down) = directions.values()
        draws = {name: ups.draws[name] - downs.draws[name] for name in up}
        difference = Bootstrap(draws, min(ups.degrees_of_freedom, downs.degrees_of_freedom))
        directions["up minus down"] = (
            {name: up[name] - down[name] for name in up},
            difference,
            n_up + n_down,
        )
    return GroupHeadline(responses, *common_errors(responses), directions, share, *own, other)


@dataclass(frozen=True)
class PlannedTurn:
    """A planned perturbation, and the expected joint (K, B, I) [N*m/rad, N*m*s/rad, kg*m^2]."""

    turn: float  # [rad]
    ramp_s: float  # of a minimum-jerk ramp
    phase: float  # of its onset, as a share of stance
    joint: tuple[float, float, float]

    def added_to(self, crossing: Crossing, settings: ResponseSettings) -> Crossing:
        """The unperturbed crossing plus the turn and the joint's torque, both through the
        crossings' low-pass."""
        onset = crossing.stance.heel_strike + self.phase * crossing.stance.duration
        since = np.clip((crossing.time - onset) / self.ramp_s, 0, 1)
        ramp = self.turn * since**3 * (10 - 15 * since + 6 * since**2)
        turned = differentiate(crossing.time, settings.low_pass(ramp, sampling_rate(crossing.time)))
        answer = turned.columns @ self.joint
        theta, torque = crossing.theta + turned.theta, crossing.torque + answer
        return replace(crossing, onset=onset, turn=self.turn, theta=theta, torque=torque)


def scatter_of_one(
    crossings: Sequence[Crossing], planned: PlannedTurn, settings: ResponseSettings
) -> Array:
    """Standard deviations (3,) of K, B and I of one perturbed crossing against the mean of many
    unperturbed ones."""
    if (count := len(crossings)) < 4:
        raise InputError(
            f"{count} unperturbed crossings can be used, expected 4 or more to know how they"
            " scatter; record more"
        )
    earliest = (settings.guard_s + settings.baseline_s) / min(c.stance.duration for c in crossings)
    if planned.phase < earliest:
        raise InputError(
            f"an onset at {100 * planned.phase:g} % of stance leaves no room for guard and baseline"
            f" before it, expected {100 * earliest:.0f} % or more; state a later phase, in percent"
        )
    motions, left = list[Array](), list[Array]()
    for k, crossing in enumerate(crossings):
        others = unperturbed_gait([*crossings[:k], *crossings[k + 1 :]], 3)
        response = isolate_response(
            planned.added_to(crossing, settings), others, settings, settings.perturbed_stance
        )
        motions.append(response.fitted_motion.columns)
        left.append(response.fitted_torque - motions[-1] @ planned.joint)
    # first order, as for a mean of many: the fit to one crossing also has the square of its gait's
    # deviation
    estimates = np.linalg.lstsq(np.mean(motions, axis=0), np.transpose(left))[0].T
    return np.asarray(np.std(estimates, axis=0, ddof=1) / np.sqrt(1 + 1 / (count - 1)))


def half_widths(
    scatter: Array, counts: Sequence[int], unperturbed: int, both: bool
) -> pl.DataFrame:
    """Half-widths of the 95 % intervals of K, B and I: a row per number of perturbed crossings,
    with this number of `unperturbed` ones. With turns in `both` directions, of half their
    difference."""
    rows = []
    for n in counts:
        freedom = min(n - 2 if both else n - 1, unperturbed - 1)
        share = 1 / n + (0.0 if both else 1 / unperturbed)
        half = (
            -scipy.special.stdtrit(freedom, 0.025) * scatter * np.sqrt(share)
            if freedom > 0
            else np.full(3, np.nan)
        )
        rows.append(
            {"n": n, "n_unperturbed": unperturbed} | dict(zip("KBI", half.tolist(), strict=True))
        )
    return pl.DataFrame(rows)
