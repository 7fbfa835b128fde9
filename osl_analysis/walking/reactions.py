"""What a response may hold beyond Eq. 15: a person who reacts within the window, or K over stance.

Each effect is a further column of the regression. A reflex is a torque that follows the stretch
velocity after a delay.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from osl_analysis.signals import Motion, differentiate
from osl_analysis.trial import REFLEX_DELAYS_MS, Array
from osl_analysis.walking.isolated_response import MARGIN

REFLEX = "a reflex"
STIFFER = "co-contraction"
RAMP = "a voluntary torque or another pace"
SLOPING = "a stiffness that changes with stance"
REACTIONS = (REFLEX, STIFFER, RAMP, SLOPING)

# Share of the largest velocity up to which a return counts: gait itself has as much, the low-pass
# swings back by less
RETURN_SHARE = 0.2
BLUR_SHARE = 0.2  # of half the window, by which steps and ramps are smoothed, as by the low-pass
STIFFENING_DELAY = 1.5  # blurs from half the window to the middle of the step of stiffness
BEFORE_WINDOWS = 0.6  # windows before the onset from which the fit begins
RIDGE_SHARE = 0.03  # of the mean variance: few crossings have a singular covariance
CERTAIN_CHI_SQUARE = 16.0  # four standard deviations, by which a reflex that yields must fit better
NEARLY_AS_WELL = 4.0  # chi-square of two standard deviations


@dataclass(frozen=True)
class Effect:
    """Size of an effect, or an estimate beside it, with its standard error."""

    size: float
    se: float


@dataclass(frozen=True)
class Reactions:
    """Sizes of `REACTIONS` beside Eq. 15."""

    reflexes: Mapping[int, Effect]  # by delay [ms]: gain [N*m*s/rad] beside the jerk
    # K [N*m/rad] beside a reflex, for each delay [ms] that fits nearly as well as the best
    K_with_reflex: Mapping[int, Effect]
    delay_ms: int  # of the reflex that fits best
    alone: Mapping[str, Effect]  # the others, each alone beside Eq. 15
    with_jerk: Mapping[str, Effect]  # the same with the jerk

    @property
    def sizes(self) -> dict[str, Effect]:
        """Each of `REACTIONS` alone; the reflex at its best delay."""
        return {REFLEX: self.reflexes[self.delay_ms], **self.alone}


def reflex_column(time: Array, window: slice, motion: Motion, delay_s: float) -> Array:
    """Velocity a delay [s] ago with which the turn stretches a muscle.

    It is the half-wave in the turn's direction. The muscle also feels the velocity of gait, so a
    return counts up to a share of the largest velocity.

    Returns
    -------
    Array
        (k, samples) [rad/s].
    """
    direction = np.sign(motion.theta[window.stop - 1, 0])
    before = np.maximum(time - delay_s, time[0])
    velocity = scipy.interpolate.make_interp_spline(time, motion.omega, k=3)(before)
    stretch = direction * np.asarray(velocity)
    return np.asarray(direction * np.maximum(stretch, -RETURN_SHARE * stretch.max(axis=0)))


def reaction_columns(
    time: Array, window: slice, motion: Motion, delay_s: float
) -> dict[str, Array]:
    """Regression columns (k, samples) of `REACTIONS`.

    The reflex is the stretch velocity a delay ago [rad/s]. Co-contraction is the angle from half
    the window on [rad]. A voluntary torque is a ramp from then on [s]. A changing stiffness is
    angle times time [rad*s].
    """
    half_s = 0.5 * (window.stop - window.start) * float(time[1] - time[0])
    blur_s = BLUR_SHARE * half_s
    since_half = (time - half_s)[:, None]
    step = scipy.special.ndtr(since_half / blur_s)
    density = np.exp(-0.5 * (since_half / blur_s) ** 2) / np.sqrt(2 * np.pi)
    ramp = since_half * step + blur_s * density  # the integral of the step
    later_step = scipy.special.ndtr(since_half / blur_s - STIFFENING_DELAY)
    return {
        REFLEX: reflex_column(time, window, motion, delay_s),
        STIFFER: motion.theta * later_step,
        RAMP: np.asarray(np.broadcast_to(ramp, motion.theta.shape)),
        SLOPING: motion.theta * np.maximum(time, 0.0)[:, None],
    }


class ReactionFit:
    """Generalised least squares of a mean response and its resamples, with columns of choice.

    It begins 0.6 windows before the onset. Residuals are weighed by their covariance over the
    resamples: deviations before the onset tell those after it (Aitken).
    """

    def __init__(self, time: Array, window: slice, motion: Motion, torque: Array) -> None:
        window_s = (window.stop - window.start) * float(time[1] - time[0])
        first = int(np.searchsorted(time, -BEFORE_WINDOWS * window_s - 1e-9))
        self.rows = slice(max(MARGIN, first), window.stop)
        self.torque = torque[self.rows]

        eq_15 = [motion.theta, motion.omega, motion.alpha]
        of_mean = np.stack(eq_15, -1)[window, 0]
        estimates = np.linalg.lstsq(of_mean, torque[window, 0])[0]
        residual = torque - np.tensordot(estimates, eq_15, 1)
        covariance = np.cov(residual[:, 1:])[self.rows, self.rows]
        # crossings that are all equal have no covariance at all
        floor = 1e-12 * float(np.mean(torque[self.rows, 0] ** 2)) + 1e-24
        ridge = RIDGE_SHARE * np.trace(covariance) / len(covariance) + floor
        self.root = np.linalg.cholesky(covariance + ridge * np.eye(len(covariance)))

    def fit(self, columns: Sequence[Array]) -> tuple[Array, float]:
        """Estimates (1 + samples, columns) of columns (k, 1 + samples); chi-square of the mean."""
        X = np.linalg.solve(self.root, np.stack(columns)[:, self.rows]).transpose(2, 1, 0)
        y = np.linalg.solve(self.root, self.torque).T[..., None]
        sizes = np.linalg.norm(X, axis=1, keepdims=True)
        sizes = np.where(sizes > 0, sizes, 1.0)
        X = X / sizes
        X_transposed = X.swapaxes(1, 2)
        estimates = np.linalg.pinv(X_transposed @ X, hermitian=True) @ (X_transposed @ y)
        chi_square = float(np.sum((y[0] - X[0] @ estimates[0]) ** 2))
        return (estimates / sizes.swapaxes(1, 2))[..., 0], chi_square


def effect_of(estimates: Array) -> Effect:
    """The estimate of the mean, the first of (1 + samples,), and its standard error."""
    return Effect(float(estimates[0]), float(estimates[1:].std(ddof=1)))


def fit_reactions(time: Array, window: slice, theta: Array, torque: Array) -> Reactions:
    """Fit `REACTIONS` beside Eq. 15 to a mean response.

    Each reaction but the reflex is added to Eq. 15 alone, and once more together with the jerk,
    which the third-order drivetrain of a leg causes. The reflex is always fitted with the jerk, for
    each of `REFLEX_DELAYS_MS`.

    Parameters
    ----------
    time : Array
        (k,) [s] from the onset.
    window : slice
        The rows to which Eq. 15 is fitted.
    theta, torque : Array
        (k, 1 + samples) [rad], [N*m]: the mean response in the first column, then its resamples.
    """
    motion = differentiate(time, theta)
    beside = ReactionFit(time, window, motion, torque)
    eq_15 = [motion.theta, motion.omega, motion.alpha]
    jerk = np.asarray(scipy.interpolate.make_interp_spline(time, theta, k=5).derivative(3)(time))

    reflexes = {}
    K_with_reflex = {}
    chi_squares = {}
    for delay_ms in REFLEX_DELAYS_MS:
        column = reflex_column(time, window, motion, 1e-3 * delay_ms)
        estimates, chi_square = beside.fit([*eq_15, jerk, column])
        gains = estimates[:, -1]
        reflexes[delay_ms] = effect_of(gains)
        K_with_reflex[delay_ms] = effect_of(estimates[:, 0])
        resists = gains[0] > 0
        chi_squares[delay_ms] = chi_square if resists else chi_square + CERTAIN_CHI_SQUARE
    best = min(chi_squares, key=lambda delay_ms: chi_squares[delay_ms])

    columns = reaction_columns(time, window, motion, 1e-3 * best)
    alone = {}
    with_jerk = {}
    for name in (STIFFER, RAMP, SLOPING):
        estimates, _ = beside.fit([*eq_15, columns[name]])
        alone[name] = effect_of(estimates[:, -1])
        estimates, _ = beside.fit([*eq_15, jerk, columns[name]])
        with_jerk[name] = effect_of(estimates[:, -1])
    return Reactions(
        reflexes,
        K_with_reflex={
            delay_ms: K
            for delay_ms, K in K_with_reflex.items()
            if chi_squares[delay_ms] <= chi_squares[best] + NEARLY_AS_WELL
        },
        delay_ms=best,
        alone=alone,
        with_jerk=with_jerk,
    )
