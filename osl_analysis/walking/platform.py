# SPDX-License-Identifier: Apache-2.0
"""Step 2, platform: how it moves in one trial, and when it starts to turn.

A pose has six coordinates: the screw (logarithm in SE(3)) from the cluster's pose in the static
trial. A rotation about a fixed axis, however large, is a straight line in them. They are scaled so
that marker noise is equal in all directions: their norm is the root of the sum of squared
displacements of the markers [m].

A platform repeats its ramp. The mean over crossings has little noise, so that the time shift of
each crossing against it is known to a tenth of a millisecond. The start of the mean ramp is the
same in all crossings: an error of it shifts all onsets alike.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy

from osl_analysis.base.errors import advise
from osl_analysis.base.trial import Array
from osl_analysis.signals.filters import LowPass, sampling_rate
from osl_analysis.walking import poses as rigid
from osl_analysis.walking.poses import BodyMotion, Mask, Poses, StaticCalibration
from osl_analysis.walking.walking_settings import PlatformSettings

# Of the platform's motion in one trial.
FEWEST_FRAMES = 10  # for a position at rest
# speed over its noise above which a platform moves; at rest, 1 frame in 10^7 is above
STILL = 7.0
MARKER_ROUNDING = 2e-7  # of a marker: single precision at 1 m
MARGIN_OVER_NOISE = 1.3  # of a direction's mean square over the largest that noise would show


def rotation_from_rest(platform: Poses) -> Array:
    """Angle (n,) [rad] from the static pose about the axis of the largest rotation; NaN if unseen.

    It is positive at the largest rotation. It has a sign, so that marker noise has zero mean.
    """
    seen = platform.seen()
    angle = np.full(len(seen), np.nan)
    if seen.any():
        vectors = scipy.spatial.transform.Rotation.from_matrix(platform.rotation[seen]).as_rotvec()
        largest = vectors[np.argmax(np.linalg.norm(vectors, axis=1))]
        size = max(np.linalg.norm(largest), np.finfo(float).tiny)
        angle[seen] = vectors @ largest / size
    return angle


def screw_scale(reference: Array) -> Array:
    """Scale of the six coordinates of a pose, such that marker noise is equal in all of them.

    Parameters
    ----------
    reference : Array
        Positions of the markers in the static trial (m, 3) [m].

    Returns
    -------
    Array
        (6, 6) [m/rad, 1], for rotation vector and translation about the markers' centroid. To
        first order, noise of s [m] in each coordinate of a marker is s in each of the six.
    """
    local = reference - reference.mean(axis=0)
    inertia, axes = np.linalg.eigh(np.sum(local**2) * np.eye(3) - local.T @ local)
    rotation_scale = (axes * np.sqrt(inertia)) @ axes.T
    translation_scale = np.sqrt(len(reference)) * np.eye(3)
    return scipy.linalg.block_diag(rotation_scale, translation_scale)


def noise_gain(low_pass: LowPass, rate: float, derivative: int = 0) -> float:
    """Variance of a derivative of low-passed white noise of variance 1 [1/s^(2 derivative)]."""
    f = np.linspace(0.0, rate / 2, 2001)  # [Hz]
    power = (2 * np.pi * f) ** (2 * derivative) * low_pass.gain(f) ** 2
    return float(np.trapezoid(power, f) * 2 / rate)


@dataclass(frozen=True)
class PlatformTrack:
    """The platform's scaled coordinates in n consecutive frames of one trial, at uniform times."""

    name: str
    time: Array  # (n,) [s]
    reference: Array  # positions (m, 3) [m] of the cluster's markers in the static trial
    measured: Array  # coordinates (n, 6) [m], each frame with its noise
    low_pass: LowPass  # of the crossings
    noise: float  # standard deviation [m] of the noise in one frame of `measured`

    @property
    def rate(self) -> float:
        return sampling_rate(self.time)

    @property
    def spread(self) -> float:
        """Time [s] by which the low-pass widens a motion: 25 ms by one of 20 Hz."""
        return 0.5 / self.low_pass.cutoff_hz

    @cached_property
    def filtered(self) -> Array:
        return self.low_pass(self.measured, self.rate)

    @cached_property
    def velocity(self) -> Array:
        """Of the filtered coordinates (n, 6) [m/s]."""
        return np.gradient(self.filtered, self.time, axis=0)

    def moves(self, axes: Array) -> Mask:
        """Frames (n,) in which the speed along any of the directions (r, 6) exceeds the noise.

        The ends of a recording do not count: a low-pass passes more noise there.
        """
        first = self.time[0] + self.spread
        last = self.time[-1] - self.spread
        inside = (self.time > first) & (self.time < last)
        speed = np.linalg.norm(self.velocity @ axes.T, axis=1)
        noise = self.noise * np.sqrt(noise_gain(self.low_pass, self.rate, 1))
        return inside & (speed > STILL * noise)

    @cached_property
    def moving(self) -> Mask:
        """Frames (n,) in which the platform moves along any direction."""
        return self.moves(np.eye(6))

    def gate(self, moves: Mask) -> Array:
        """Weights (n,) of inertial forces: 1 within 2 `spread` of a motion, 0 beyond 3.

        A slow ramp accelerates most while noise hides its speed: with 1 `spread`, a mass would be
        0.1 % wrong.
        """
        if not moves.any():
            return np.zeros(len(moves))
        to_motion_s = scipy.ndimage.distance_transform_edt(~moves) / self.rate
        fading = np.clip(to_motion_s / self.spread - 2, 0, 1)
        return 0.5 + 0.5 * np.cos(np.pi * fading)

    @cached_property
    def rest(self) -> Array:
        """Coordinates (6,) [m] at rest: their mean while it rests before its fastest motion."""
        fastest = self.time[np.argmax(np.linalg.norm(self.velocity, axis=1))]
        before = (self.gate(self.moving) == 0) & (self.time < fastest)
        if before.sum() < FEWEST_FRAMES:
            before = self.time <= self.time[0] + self.spread
        return self.measured[before].mean(axis=0)

    def measured_motion(self, axes: Array, centre: Array) -> tuple[BodyMotion, Array]:
        """Differentiate the measured motion, along some directions, of a point of the platform.

        Markers at these poses pass the low-pass, as the wrench does.

        Parameters
        ----------
        axes : Array
            Directions (r, 6).
        centre : Array
            Where the point rests (3,) [m].

        Returns
        -------
        tuple of BodyMotion and Array
            The motion, and its `gate`.
        """
        along = self.rest + (self.measured - self.rest) @ axes.T @ axes
        screw = np.linalg.solve(screw_scale(self.reference), along.T).T.astype(float)
        pose = scipy.spatial.transform.RigidTransform.from_exp_coords(screw)
        origin = self.reference.mean(axis=0)
        turned = (self.reference - origin) @ np.swapaxes(pose.rotation.as_matrix(), 1, 2)
        markers = self.low_pass(turned + (pose.translation + origin)[:, None], self.rate)
        poses = rigid.cluster_poses(self.reference, markers)
        return rigid.body_motion(self.time, poses, centre), self.gate(self.moves(axes))


def platform_track(
    trial: str,
    time: Array,
    poses: Poses,
    calibration: StaticCalibration,
    settings: PlatformSettings,
) -> PlatformTrack:
    """Make the track of a platform from its poses (n,), none NaN.

    Gaps of 15 ms and more, which never hide a turn, become straight lines: a cubic would amplify
    the noise beside them into a motion. The noise, of any colour, is what the speed leaves
    of straight lines at rest.
    """
    reference = calibration.positions(settings.markers.platform)
    rate = sampling_rate(time)
    pose = scipy.spatial.transform.RigidTransform.from_components(
        poses.position - reference.mean(axis=0),
        scipy.spatial.transform.Rotation.from_matrix(poses.rotation),
    )
    measured = pose.as_exp_coords() @ screw_scale(reference).T

    track = PlatformTrack(trial, time, reference, measured, settings.low_pass, MARKER_ROUNDING)
    step = round(2 * track.spread * rate)  # speeds so far apart hardly share noise
    velocity = track.velocity
    bends = np.abs(velocity[step:-step] - (velocity[: -2 * step] + velocity[2 * step :]) / 2)
    if not bends.size:
        return track
    # half of normal noise, times sqrt(1.5) of a bend, lies between its quantiles 0.375 and 0.625
    speed_noise = np.quantile(bends, 0.25) / (scipy.special.ndtri(0.625) * np.sqrt(1.5))
    noise = speed_noise / np.sqrt(noise_gain(track.low_pass, rate, 1))
    return replace(track, noise=max(noise, MARKER_ROUNDING))


def shared_directions(tracks: Sequence[PlatformTrack]) -> list[Array]:
    """Find the directions (r, 6) of the motion in each trial.

    They are those of all trials together, if no trial has fewer alone. Else each has its own: a
    platform may turn in one trial and shift in another.
    """
    together = moving_directions(tracks)
    by_trial = [moving_directions([track]) for track in tracks]
    return [together if len(alone) == len(together) else alone for alone in by_trial]


def moving_directions(tracks: Sequence[PlatformTrack]) -> Array:
    """Find the directions along which platforms move, beyond marker noise.

    Returns
    -------
    Array
        Orthonormal directions (r, 6): none if no platform moves, else at least one, and all whose
        mean square exceeds the largest that noise would show.

    References
    ----------
    Marchenko and Pastur, Math. USSR Sb. 1 (1967) 457: the largest eigenvalue of noise in six
    coordinates and n independent rows is its variance times (1 + sqrt(6/n))^2.
    """
    motions = [(track.filtered - track.rest)[track.gate(track.moving) > 0] for track in tracks]
    moved = np.concatenate(motions)
    if not len(moved):
        return np.zeros((0, 6))
    _, size, axes = np.linalg.svd(moved, full_matrices=False)
    gain = noise_gain(tracks[0].low_pass, tracks[0].rate)
    independent_rows = max(len(moved) * gain, 1.0)
    noise_square = np.mean([track.noise**2 for track in tracks])
    largest_of_noise = noise_square * gain * (1 + np.sqrt(6 / independent_rows)) ** 2
    exceeding = np.sum(size**2 / len(moved) > MARGIN_OVER_NOISE * largest_of_noise)
    return axes[: max(exceeding, 1)]


STEP_S = 0.002  # of the mean ramp
SINCE_MIDDLE = np.arange(-0.15, 0.1 + STEP_S / 2, STEP_S)  # [s] from the middle of the rise
BEFORE_RAMP = SINCE_MIDDLE < -0.1


# Of the mean ramp and its start.
MEAN_ROUNDS = 6  # of mean and alignment in turn; four reduce an error of 5 ms to 1e-5 s
LARGEST_LACK_OF_FIT_OF_RAMP = 3.0  # of a ramp over its noise at rest; sound ones reach 2.4
LEAST_LACK_OF_FIT = 0.002  # of a height, that lines between frames leave of an exact ramp
RAMP_ROUNDING = 1e-6  # of a mean ramp, as a share of its height
USUAL_STEP = 3  # minimum jerk
FAR_MORE_LIKELY = 30.0  # decrease of chi-square for which another step replaces the usual one
PLATEAU = 0.95  # of the largest turn, above which the ramp has ended
FITTED_RISE = 0.7  # of the height, that the step is fitted to; the end may overshoot


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
    [rad]."""
    angle = rotation_from_rest(platform)
    seen = np.isfinite(angle)
    if not (angle[seen] > smallest_turn).any():
        return None
    return Ramp(time[seen], angle[seen])


def ramp_onsets(ramps: Mapping[str, Ramp]) -> tuple[dict[str, float], float]:
    """Find the onsets [s] of ramps, by trial, from their time shifts against the mean ramp.

    A ramp may have any height. One that does not follow the mean has an onset by itself. The second
    result is the standard error [s] that all share.
    """
    if not ramps:
        return {}, 0.0
    starts, se, follow = align(list(ramps.values()))
    onsets = dict(zip(ramps, starts.tolist(), strict=True))
    for (name, ramp), follows in zip(ramps.items(), follow, strict=True):
        if not follows:
            advise(
                f"trial {name}: the platform does not turn as in the other crossings: the onset is"
                " that of its own ramp, which may be some ms off"
            )
            onsets[name] = float(align([ramp])[0][0])
    return onsets, se


def align(ramps: list[Ramp]) -> tuple[Array, float, Mask]:
    """Fit height and time shift of each ramp to the mean of all.

    Mean and alignment are found in turn, to first order. Ramps that do not follow are left out of
    the mean.

    Returns
    -------
    tuple of Array, float and Mask
        Starts (n,) [s], the standard error [s] that they share, and whether noise explains the
        difference from the mean (n,).
    """
    middles = np.array([ramp.middle for ramp in ramps])
    heights = np.array([ramp.angle.max() for ramp in ramps])
    follows = np.ones(len(ramps), dtype=bool)
    for _ in range(MEAN_ROUNDS):
        angles = np.array(
            [
                np.interp(middle + SINCE_MIDDLE, ramp.time, ramp.angle)
                for ramp, middle in zip(ramps, middles, strict=True)
            ]
        )
        angles -= angles[:, BEFORE_RAMP].mean(axis=1, keepdims=True)
        weights = np.where(follows, heights, 0.0)  # a small ramp has more noise in its height
        mean = weights @ angles / (weights @ heights)

        slope = np.gradient(mean, SINCE_MIDDLE)
        X = np.column_stack([mean, slope, np.ones_like(mean)])
        estimates = np.linalg.lstsq(X, angles.T)[0]
        heights = estimates[0]
        middles = middles - estimates[1] / heights

        noise = np.maximum(angles[:, BEFORE_RAMP].std(axis=1), LEAST_LACK_OF_FIT * heights)
        lack_of_fit = np.sqrt(np.mean((angles - (X @ estimates).T) ** 2, axis=1)) / noise
        # The better half is always in the mean
        follows = lack_of_fit <= max(LARGEST_LACK_OF_FIT_OF_RAMP, np.median(lack_of_fit))
    start, se = start_of_rise(mean)
    return middles + start, se, lack_of_fit <= LARGEST_LACK_OF_FIT_OF_RAMP


def start_of_rise(ramp: Array) -> tuple[float, float]:
    """Find the start [s] of a ramp at the times `SINCE_MIDDLE`, from a smooth step fitted to its
    rise, and its standard error [s]: that of a step whose shape is free, too.

    Steps are the incomplete beta functions I(x; p, p): a straight ramp for p = 1, a cubic for 2,
    minimum jerk for 3, degree seven for 4. Minimum jerk is taken unless another is far more likely:
    starts of two steps that fit equally well differ by 6 to 10 % of the rise. A free shape is none
    of them: it follows what alignment smears of the mean, and the start is 1.2 ms off.
    """
    height = ramp[ramp > PLATEAU * ramp.max()].mean()
    noise = max(ramp[BEFORE_RAMP].std(), RAMP_ROUNDING * height)
    half, end = (np.argmax(ramp >= share * height) for share in (0.5, FITTED_RISE))
    quarter = np.argmax(ramp >= height / 4)
    duration = 4 * max(SINCE_MIDDLE[half] - SINCE_MIDDLE[quarter], STEP_S)
    guess = [SINCE_MIDDLE[half] - duration / 2, duration]

    def residuals(step: Array, p: float) -> Array:
        """Over noise, so that `cost` is half of chi-square."""
        since_start = np.clip((SINCE_MIDDLE[: end + 1] - step[0]) / step[1], 0, 1)
        return (height * scipy.special.betainc(p, p, since_start) - ramp[: end + 1]) / noise

    least_squares: Any = scipy.optimize.least_squares
    fits = {
        p: least_squares(residuals, guess, args=(p,), x_scale=[0.01, 0.05], diff_step=1e-4)
        for p in (USUAL_STEP, 1, 2, 4)
    }
    best = min(fits, key=lambda p: fits[p].cost)
    is_certain = 2 * (fits[USUAL_STEP].cost - fits[best].cost) > FAR_MORE_LIKELY
    chosen = best if is_certain else USUAL_STEP
    step = fits[chosen].x
    # where the shape is free, too: none of the four need be that of the platform
    free = least_squares(lambda x: residuals(x[:2], x[2]), [*step, chosen])
    return step[0], float(np.sqrt(np.linalg.inv(free.jac.T @ free.jac)[0, 0]))
