"""The motion of a platform in one trial: in its few directions, without noise in all others and at rest.

A pose has six coordinates: the screw (logarithm in SE(3)) that carries the cluster from its place in the static trial.
A rotation about a fixed axis, however large, is a straight line in them. They are scaled so that marker noise is the
same in each direction: their length is the root of the sum of squared displacements of the markers [m].
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from osl_analysis.signals import LowPass, runs, sampling_rate
from osl_analysis.trial import Array
from osl_analysis.walking.bodies import BodyMotion, Mask, Poses, body_motion, cross_matrix, filtered_poses

COORDINATES = 6
SIGNIFICANT = 1.3  # Margin on the largest variance that noise alone would show in any direction (Marchenko and Pastur)
LEAST_NOISE_M = 2e-7  # Smallest noise [m] of a coordinate: the resolution of single precision at a metre
STILL = 7.0  # A platform moves where its speed is above this multiple of its noise: 1 in 10^7 frames of a resting one

PLAIN = 2.0  # Time before and after a motion that is seen, over the low-pass's spread, in which it may still move


@dataclass(frozen=True)
class Screws:
    """The scaled coordinates of one marker cluster: the product of scale (6, 6) [m/rad, 1] with rotation vector and
    translation, from the centroid (3,) [m] of the markers in the static trial, the origin."""

    origin: Array
    scale: Array

    @classmethod
    def of(cls, reference: Array) -> "Screws":
        """Coordinates of markers at the reference positions (m, 3) [m]: noise of s [m] in each marker's coordinate is s
        in each of the six, to first order."""
        local = reference - reference.mean(axis=0)
        spread = np.sum(local**2) * np.eye(3) - local.T @ local
        size, axes = np.linalg.eigh(spread)
        scale = np.zeros((6, 6))
        scale[:3, :3] = (axes * np.sqrt(size)) @ axes.T
        scale[3:, 3:] = np.sqrt(len(reference)) * np.eye(3)
        return cls(reference.mean(axis=0), scale)

    def coordinates(self, poses: Poses) -> Array:
        """Scaled coordinates (n, 6) [m] of poses; NaN where the cluster was not seen."""
        seen = poses.seen()
        found = np.full((len(seen), COORDINATES), np.nan)
        turn = Rotation.from_matrix(poses.rotation[seen]).as_rotvec()
        shift = np.linalg.solve(left_jacobian(turn), (poses.position[seen] - self.origin)[:, :, None])[:, :, 0]
        found[seen] = np.hstack([turn, shift]) @ self.scale.T
        return found

    def poses(self, coordinates: Array) -> Poses:
        """Poses of scaled coordinates (n, 6) [m], the inverse of `coordinates`."""
        screw: Array = np.linalg.solve(self.scale, coordinates.T).T.astype(float)
        turn, n = screw[:, :3], len(screw)
        position = np.einsum("nij,nj->ni", left_jacobian(turn), screw[:, 3:]) + self.origin
        rotation = Rotation.from_rotvec(turn).as_matrix()
        return Poses(rotation, position, self.origin, np.full(n, np.nan), np.zeros(n, dtype=bool))


def left_jacobian(turn: Array) -> Array:
    """Matrices (n, 3, 3) that map the translation of a screw to the shift of the origin, for rotation vectors (n, 3). I
    + (1 - cos a)/a^2 W + (a - sin a)/a^3 W^2, with the angle a and the cross-product matrix W (Sola et al., A micro Lie
    theory for state estimation in robotics, 2018, Eq. 145)."""
    angle = np.linalg.norm(turn, axis=1)
    near = angle < 1e-4
    a = np.where(near, 1.0, angle)
    first = np.where(near, 0.5 - angle**2 / 24, (1 - np.cos(a)) / a**2)
    second = np.where(near, 1 / 6 - angle**2 / 120, (a - np.sin(a)) / a**3)
    W = cross_matrix(turn)
    matrices: Array = np.eye(3) + first[:, None, None] * W + second[:, None, None] * (W @ W)
    return matrices


def frame_noise(coordinates: Array) -> float:
    """Standard deviation [m] of the noise in each frame of coordinates (n, k), from second differences. The median is
    blind to the few frames in which the platform accelerates."""
    second = np.diff(coordinates[np.isfinite(coordinates).all(axis=1)], n=2, axis=0)
    if not second.size:
        return LEAST_NOISE_M
    return float(max(1.4826 * float(np.median(np.abs(second))) / np.sqrt(6.0), LEAST_NOISE_M))


def noise_gain(low_pass: LowPass, rate: float, derivative: int = 0) -> float:
    """Variance of the `derivative`-th derivative [1/s^derivative, squared] of white unit noise through a low-pass. The
    integral over frequency of (2 pi f)^(2 derivative) |H|^2, with H = 1/(1 + (f/f_c)^(2 m)) for both runs."""
    f = np.linspace(0.0, rate / 2, 2001)
    power = (2 * np.pi * f) ** (2 * derivative) / (1 + (f / low_pass.cutoff_hz) ** (2 * low_pass.order)) ** 2
    return float(np.trapezoid(power, f) * 2 / rate)


def gated_noise(weights: Array, rate: float, low_pass: LowPass, further: LowPass) -> float:
    """Sum of squares of noise in an acceleration, over its mean square before it is weighted and filtered again. White
    noise of markers passes `low_pass`, is differentiated twice, multiplied by the weights (n,) and passes the `further`
    filter. With the autocorrelations r of the acceleration (1 at lag 0), q of the further filter's response and A of
    the weights, it is the sum of A r q over all lags."""
    n = 2 * len(weights)
    f = np.fft.rfftfreq(n, 1 / rate)
    passed = [1 / (1 + (f / one.cutoff_hz) ** (2 * one.order)) ** 2 for one in (low_pass, further)]
    acceleration = np.fft.irfft(passed[0] * f**4, n)
    lags = np.fft.irfft(np.abs(np.fft.rfft(weights, n)) ** 2, n)
    return float(np.sum(lags * acceleration / acceleration[0] * np.fft.irfft(passed[1], n)))


def speed(time: Array, coordinates: Array) -> Array:
    """Speed (n,) [m/s] of filtered coordinates (n, k) [m]."""
    return np.asarray(np.linalg.norm(np.gradient(coordinates, time, axis=0), axis=1))


def gate(time: Array, moves: Mask, spread: float) -> Array:
    """Weights (n,) of inertial forces: 1 where the platform moves and up to `PLAIN` times `spread` [s] beside it, 0 one
    `spread` later, half a cosine between: a slow ramp accelerates most while its speed is below that of noise. Weights
    that fall after one `spread` make a plate's mass 0.1 % too large at 5 deg, and its moment 1 % too small at 2.5."""
    if not moves.any():
        return np.zeros(len(time))
    motion = time[moves]
    after = np.searchsorted(motion, time)
    nearest = np.minimum(
        np.abs(time - motion[np.minimum(after, len(motion) - 1)]), np.abs(time - motion[np.maximum(after - 1, 0)])
    )
    return np.asarray(0.5 + 0.5 * np.cos(np.pi * np.clip(nearest / spread - PLAIN, 0, 1)))


def directions(coordinates: Sequence[Array], noise: float, low_pass: LowPass, rate: float) -> Array:
    """Orthonormal directions (r, 6) of motions (n, 6) [m] from rest, each of one trial, filtered: one, and all whose
    mean square is above the largest that filtered noise alone would show. `noise` [m] is that of one frame before the
    low-pass."""
    stacked = np.concatenate(list(coordinates))

    _, size, axes = np.linalg.svd(stacked, full_matrices=False)
    gain = noise_gain(low_pass, rate)
    independent = max(len(stacked) * gain, 1.0)
    largest = noise**2 * gain * (1 + np.sqrt(COORDINATES / independent)) ** 2
    count = int(np.sum(size**2 / len(stacked) > SIGNIFICANT * largest))
    return np.asarray(axes[: max(count, 1)])


SPREAD_S = 0.025  # Time [s] by which the low-pass widens a motion, for a cut-off of `SPREAD_CUTOFF_HZ`: half a period
SPREAD_CUTOFF_HZ = 20.0

LONG_GAP_S = 0.015
"""Shortest gap [s] of the platform's markers that is bridged by a straight line. A turn is never hidden for as long."""
BESIDE = 4  # Frames beside a gap whose mean is the end of that line
FEWEST_FRAMES = 10  # Fewest frames from which a position at rest is read


@dataclass(frozen=True)
class PlatformTrack:
    """The platform's scaled coordinates in n consecutive frames of one trial, at uniform time (n,) [s]."""

    name: str
    time: Array
    reference: Array  # positions (m, 3) [m] of the cluster's markers in the static trial
    measured: Array  # coordinates (n, 6) [m], each frame with its noise
    filtered: Array  # the same through the low-pass of the crossings
    low_pass: LowPass
    noise: float  # standard deviation [m] of the noise in one frame of `measured`

    @classmethod
    def of(cls, name: str, time: Array, poses: Poses, reference: Array, low_pass: LowPass) -> "PlatformTrack":
        """The track of a platform's poses (n,), none NaN, whose markers were at the reference (m, 3) [m] at rest."""
        measured = straight_over_gaps(Screws.of(reference).coordinates(poses), poses.bridged, sampling_rate(time))
        filtered = low_pass(measured, sampling_rate(time))
        return cls(name, time, reference, measured, filtered, low_pass, frame_noise(measured[~poses.bridged]))

    @property
    def rate(self) -> float:
        return sampling_rate(self.time)

    @property
    def spread(self) -> float:
        """Time [s] by which the low-pass widens a motion."""
        return SPREAD_S * SPREAD_CUTOFF_HZ / self.low_pass.cutoff_hz

    def moves(self, axes: Array) -> Mask:
        """Frames (n,) in which the platform's speed along some of the directions (r, 6) stands out of the noise. The
        ends of a recording do not count: a low-pass passes more noise there."""
        inside = (self.time > self.time[0] + self.spread) & (self.time < self.time[-1] - self.spread)
        noise = self.noise * np.sqrt(noise_gain(self.low_pass, self.rate, 1))
        return np.asarray(inside & (speed(self.time, self.filtered @ axes.T) > STILL * noise))

    @cached_property
    def moving(self) -> Mask:
        """Frames (n,) in which the platform moves along any direction."""
        return self.moves(np.eye(6))

    @cached_property
    def rest(self) -> Array:
        """Coordinates (6,) [m] at rest: their mean while the platform rests, until it moves fastest."""
        resting = gate(self.time, self.moving, self.spread) == 0
        fastest = int(np.argmax(speed(self.time, self.filtered)))
        before = resting & (self.time < self.time[fastest])
        if before.sum() < FEWEST_FRAMES:
            before = self.time <= self.time[0] + self.spread
        return np.asarray(self.measured[before].mean(axis=0))

    def displaced(self) -> Array:
        """Filtered coordinates (k, 6) [m] from rest, in the frames in which the platform moves."""
        near = gate(self.time, self.moving, self.spread) > 0
        return np.asarray((self.filtered - self.rest)[near])

    def own_motion(self, axes: Array, centre: Array) -> tuple[BodyMotion, Array]:
        """Motion of the point that rests at `centre` (3,) [m], as measured along the directions (r, 6), and weights
        (n,) that are 0 where the platform rests."""
        motion = self.motion_of(self.rest + (self.measured - self.rest) @ axes.T @ axes, centre)
        return motion, gate(self.time, self.moves(axes), self.spread)

    def motion_of(self, coordinates: Array, centre: Array) -> BodyMotion:
        """Motion (n,) of the point that rests at `centre` (3,) [m] for other coordinates (n, 6) [m], not filtered. The
        markers of that pose pass the low-pass, as the wrench does; its coordinates do not."""
        poses = Screws.of(self.reference).poses(coordinates)
        return body_motion(self.time, filtered_poses(poses, self.reference, self.low_pass, self.rate), centre)


def straight_over_gaps(coordinates: Array, bridged: Mask, rate: float) -> Array:
    """Coordinates (n, 6) [m] with straight lines, between the means of the frames beside them, over longer gaps. A
    cubic over 50 ms carries the noise of the frames beside it to several times its size: a motion that never was."""
    found = coordinates.copy()
    for gap in runs(bridged):
        if (gap.stop - gap.start) / rate < LONG_GAP_S:
            continue
        before = [row for row in range(max(gap.start - BESIDE, 0), gap.start) if not bridged[row]]
        after = [row for row in range(gap.stop, min(gap.stop + BESIDE, len(bridged))) if not bridged[row]]
        ends = np.mean(before), np.mean(after)
        share = (np.arange(gap.start, gap.stop) - ends[0]) / (ends[1] - ends[0])
        first, last = coordinates[before].mean(axis=0), coordinates[after].mean(axis=0)
        found[gap] = first + share[:, None] * (last - first)
    return found


def shared_directions(tracks: Sequence[PlatformTrack]) -> list[Array]:
    """Directions (r, 6) of the motion in each trial: those of all trials together, where these are no more than each
    trial has alone. A platform that turns in one trial and shifts in another has others in each."""
    low_pass, rate = tracks[0].low_pass, tracks[0].rate
    moved, none = [track.displaced() for track in tracks], np.zeros((0, 6))
    noise = float(np.sqrt(np.mean([track.noise**2 for track in tracks])))
    pairs = zip(moved, tracks, strict=True)
    alone = [directions([one], track.noise, low_pass, rate) if len(one) else none for one, track in pairs]
    known = [one for one in moved if len(one)]
    together = directions(known, noise, low_pass, rate) if known else none
    return [together if len(own) == len(together) else own for own in alone]
