"""The motion of a platform in one trial: in its few directions, and without noise while it rests."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from osl_analysis.signals import LowPass, runs, sampling_rate
from osl_analysis.trial import Array
from osl_analysis.walking.cluster import BodyMotion, Mask, Poses, body_motion, filtered_poses
from osl_analysis.walking.platform_rank import Screws, directions, frame_noise, gate, moving, speed

SPREAD_S = 0.025
"""Time [s] by which the low-pass widens a motion, for a cut-off of `SPREAD_CUTOFF_HZ`: half a period."""
SPREAD_CUTOFF_HZ = 20.0

LONG_GAP_S = 0.015
"""Shortest gap [s] of the platform's markers that is bridged by a straight line. A turn is never hidden for as long."""
BESIDE = 4
"""Frames beside a gap whose mean is the end of that line."""
FEWEST_FRAMES = 10
"""Fewest frames from which a position at rest is read."""


@dataclass(frozen=True)
class PlatformTrack:
    """The platform's scaled coordinates in n consecutive frames of one trial.

    name: the trial.
    time: (n,) [s], uniform.
    reference: positions (m, 3) [m] of the cluster's markers in the static trial.
    measured: coordinates (n, 6) [m], each frame with its noise.
    filtered: the same through the low-pass of the crossings.
    low_pass: that low-pass.
    noise: standard deviation [m] of the noise in one frame of `measured`.
    """

    name: str
    time: Array
    reference: Array
    measured: Array
    filtered: Array
    low_pass: LowPass
    noise: float

    @classmethod
    def of(cls, name: str, time: Array, poses: Poses, reference: Array, low_pass: LowPass) -> "PlatformTrack":
        """The track of a platform's poses (n,), none NaN, whose markers were at the reference (m, 3) [m] at rest."""
        measured = straight_over_gaps(Screws.of(reference).coordinates(poses), poses.bridged, sampling_rate(time))
        filtered = low_pass(measured, sampling_rate(time))
        return cls(name, time, reference, measured, filtered, low_pass, frame_noise(measured[~poses.bridged]))

    @property
    def rate(self) -> float:
        """Frames per second [Hz]."""
        return sampling_rate(self.time)

    @property
    def spread(self) -> float:
        """Time [s] by which the low-pass widens a motion."""
        return SPREAD_S * SPREAD_CUTOFF_HZ / self.low_pass.cutoff_hz

    def moves(self, axes: Array) -> Mask:
        """Frames (n,) in which the platform moves along some of the directions (r, 6).

        The ends of a recording do not count: a low-pass passes more noise there.
        """
        inside = (self.time > self.time[0] + self.spread) & (self.time < self.time[-1] - self.spread)
        return np.asarray(inside & moving(self.time, self.filtered @ axes.T, self.noise, self.low_pass))

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
        """Motion (n,) of the point that rests at `centre` (3,) [m] for other coordinates (n, 6) [m], not filtered.

        The markers of that pose pass the low-pass, as the wrench does; its coordinates do not.
        """
        poses = Screws.of(self.reference).poses(coordinates)
        return body_motion(self.time, filtered_poses(poses, self.reference, self.low_pass, self.rate), centre)


def straight_over_gaps(coordinates: Array, bridged: Mask, rate: float) -> Array:
    """Coordinates (n, 6) [m] with straight lines in place of the curves that bridge longer gaps, between the means of
    the frames beside them.

    A cubic over 50 ms carries the noise of the frames beside it to several times its size: a motion that never was.
    """
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
    trial has alone. A platform that only turns in one trial and shifts in another has other directions in each.
    """
    low_pass, rate = tracks[0].low_pass, tracks[0].rate
    moved = [track.displaced() for track in tracks]
    noise = float(np.sqrt(np.mean([track.noise**2 for track in tracks])))
    alone = [
        directions([one], track.noise, low_pass, rate) if len(one) else np.zeros((0, 6))
        for one, track in zip(moved, tracks, strict=True)
    ]
    known = [one for one in moved if len(one)]
    together = directions(known, noise, low_pass, rate) if known else np.zeros((0, 6))
    return [together if len(own) == len(together) else own for own in alone]
