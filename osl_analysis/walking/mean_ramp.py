"""Step 2b, onset: when the platform starts to turn in each perturbed crossing.

A platform repeats its ramp. The mean over crossings has little noise, so that the time shift of
each crossing against it is known to a tenth of a millisecond. The start of the mean ramp is the
same in all crossings: an error of it shifts all onsets alike.
"""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from osl_analysis.errors import InputError
from osl_analysis.trial import Array
from osl_analysis.walking.platform import rotation_from_rest
from osl_analysis.walking.poses import Mask, Poses

STEP_S = 0.002  # of the mean ramp
SINCE_MIDDLE = np.arange(-0.15, 0.1 + STEP_S / 2, STEP_S)  # [s] from the middle of the rise
AT_REST = SINCE_MIDDLE < -0.1
LEAST_REST_S = 0.2  # that is recorded before the turn
ROUNDS = 6  # of mean and alignment in turn; four reduce an error of 5 ms to 1e-5 s
LARGEST_STRETCH = 0.2  # by which one round may change a duration
LARGEST_MISFIT = 3.0  # of a ramp over its noise at rest; sound ones reach 2.4
LEAST_MISFIT = 0.002  # of a height, that lines between frames leave of an exact ramp
LEAST_NOISE = 1e-6  # of a mean ramp, as a share of its height

USUAL_STEP = 3  # minimum jerk
STEPS = (USUAL_STEP, 1, 2, 4)
FAR_MORE_LIKELY = 30.0  # decrease of chi-square for which another step replaces the usual one
PLATEAU = 0.95  # of the largest turn, above which the ramp has ended
FITTED_RISE = 0.7  # of the height, that the step is fitted to; the end may overshoot
SHARE_OF_RISE = 0.3  # of the duration of a smooth step: from 10 to 50 % of its height


@dataclass(frozen=True)
class Ramp:
    """The turn of the platform in n frames of one crossing, not low-passed."""

    time: Array  # (n,) [s]
    angle: Array  # (n,) [rad], positive at the largest turn

    @property
    def middle(self) -> float:
        """The first time [s] at which half of the largest turn is exceeded."""
        return float(self.time[np.argmax(self.angle > self.angle.max() / 2)])


def ramp_of(time: Array, platform: Poses, smallest_turn: float) -> Ramp | None:
    """Find the turn of a platform from its poses (n,); None if it turns less than `smallest_turn`
    [rad].

    Raises
    ------
    InputError
        The recording does not begin at rest.
    """
    angle = rotation_from_rest(platform)
    seen = np.isfinite(angle)
    time = time[seen]
    angle = angle[seen]
    above = np.flatnonzero(angle > smallest_turn)
    if not len(above):
        return None
    if time[above[0]] - time[0] < LEAST_REST_S:
        raise InputError(
            f"the platform turns at {time[above[0]]:.3f} s, within {LEAST_REST_S:g} s of the"
            " recording's start; start to record earlier, or exclude the trial"
        )
    return Ramp(time, angle)


def ramp_onsets(ramps: Mapping[str, Ramp]) -> dict[str, float]:
    """Find the onsets [s] of ramps, by trial, from their time shifts against the mean ramp.

    A ramp may have any height. If some do not follow the mean, each has a duration of its own. One
    that still does not follow has an onset by itself.
    """
    if not ramps:
        return {}
    aligned = align(list(ramps.values()), stretched=False)
    if not aligned.follows.all():
        aligned = align(list(ramps.values()), stretched=True)
    onsets = dict(zip(ramps, aligned.starts.tolist(), strict=True))
    for (name, ramp), follows in zip(ramps.items(), aligned.follows, strict=True):
        if not follows:
            warnings.warn(
                f"trial {name}: the platform does not turn as in the other crossings: the onset is"
                " that of its own ramp, which may be some ms off",
                stacklevel=2,
            )
            onsets[name] = float(align([ramp], stretched=False).starts[0])
    return onsets


@dataclass(frozen=True)
class AlignedRamps:
    """How n ramps follow their mean."""

    starts: Array  # (n,) [s]
    follows: Mask  # whether noise explains the difference from the mean (n,)


def align(ramps: list[Ramp], stretched: bool) -> AlignedRamps:
    """Fit height, time shift and, if `stretched`, duration of each ramp to the mean of all.

    Mean and alignment are found in turn, to first order. Ramps that do not follow are left out of
    the mean.
    """
    middles = np.array([ramp.middle for ramp in ramps])
    durations = np.ones(len(ramps))  # over that of the mean
    heights = np.array([ramp.angle.max() for ramp in ramps])
    follows = np.ones(len(ramps), dtype=bool)
    for _ in range(ROUNDS):
        angles = np.array(
            [
                np.interp(middle + duration * SINCE_MIDDLE, ramp.time, ramp.angle)
                for ramp, middle, duration in zip(ramps, middles, durations, strict=True)
            ]
        )
        angles -= angles[:, AT_REST].mean(axis=1, keepdims=True)
        weights = np.where(follows, heights, 0.0)  # a small ramp has more noise in its height
        mean = weights @ angles / (weights @ heights)

        slope = np.gradient(mean, SINCE_MIDDLE)
        columns = [mean, slope, np.ones_like(mean), SINCE_MIDDLE * slope]
        X = np.column_stack(columns if stretched else columns[:3])
        estimates = np.linalg.lstsq(X, angles.T)[0]
        heights = estimates[0]
        middles = middles - durations * estimates[1] / heights
        if stretched:
            stretch = np.clip(estimates[3] / heights, -LARGEST_STRETCH, LARGEST_STRETCH)
            durations = durations * (1 - stretch)
            durations /= durations[follows].mean()

        noise = np.maximum(angles[:, AT_REST].std(axis=1), LEAST_MISFIT * heights)
        misfit = np.sqrt(np.mean((angles - (X @ estimates).T) ** 2, axis=1)) / noise
        # The better half is always in the mean
        follows = misfit <= max(LARGEST_MISFIT, float(np.median(misfit)))
    return AlignedRamps(
        middles + durations * start_of_rise(SINCE_MIDDLE, mean), misfit <= LARGEST_MISFIT
    )


def start_of_rise(time: Array, ramp: Array) -> float:
    """Find the start [s] of a ramp (n,) at times (n,) [s], from a smooth step fitted to its rise.

    Steps are the incomplete beta functions I(x; p, p): a straight ramp for p = 1, a cubic for 2,
    minimum jerk for 3, degree seven for 4. Minimum jerk is taken unless another is far more likely:
    starts of two steps that fit equally well differ by 6 to 10 % of the rise.
    """
    height = float(ramp[ramp > PLATEAU * ramp.max()].mean())
    noise = max(float(ramp[AT_REST].std()), LEAST_NOISE * height)
    tenth, half, end = (int(np.argmax(ramp >= s * height)) for s in (0.1, 0.5, FITTED_RISE))
    duration = max(float(time[half] - time[tenth]), STEP_S) / SHARE_OF_RISE
    guess = [time[half] - duration / 2, duration]

    def residuals(step: Array, p: int) -> Array:
        """Over noise, so that `cost` is half of chi-square."""
        since_start = np.clip((time[: end + 1] - step[0]) / step[1], 0, 1)
        return np.asarray(
            (height * scipy.special.betainc(p, p, since_start) - ramp[: end + 1]) / noise
        )

    least_squares: Any = scipy.optimize.least_squares
    fits = {
        p: least_squares(residuals, guess, args=(p,), x_scale=[0.01, 0.05], diff_step=1e-4)
        for p in STEPS
    }
    best = min(fits, key=lambda p: float(fits[p].cost))
    is_certain = 2 * (fits[USUAL_STEP].cost - fits[best].cost) > FAR_MORE_LIKELY
    return float(fits[best if is_certain else USUAL_STEP].x[0])
