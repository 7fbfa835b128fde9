"""A force plate that rides on a moving platform: its wrench, measured in its own axes, into the laboratory."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from osl_analysis.signals import LowPass, sampling_rate
from osl_analysis.trial import Array
from osl_analysis.walking.rigid_body import Poses

ANTI_ALIAS = 1 / 3
"""Cut-off of the low-pass ahead of resampling, as a fraction of the marker rate."""


@dataclass(frozen=True)
class Wrench:
    """Ground reaction force (n, 3) [N] on the foot and its moment (n, 3) [N*m] about the plate's surface centre."""

    force: Array
    moment: Array

    def __getitem__(self, rows: slice) -> "Wrench":
        return Wrench(self.force[rows], self.moment[rows])

    def __sub__(self, other: "Wrench") -> "Wrench":
        return Wrench(self.force - other.force, self.moment - other.moment)


def in_laboratory(wrench: Wrench, platform: Poses, centre: Array) -> tuple[Wrench, Array]:
    """Wrench in laboratory axes, and where the plate's centre (n, 3) [m] is, about which its moment acts.

    The wrench is in axes that are fixed to the plate and coincide with the laboratory's in the resting pose, which the
    platform's poses refer to; `centre` (3,) [m] is the surface centre at rest.
    """
    force = np.einsum("nij,nj->ni", platform.rotation, wrench.force)
    moment = np.einsum("nij,nj->ni", platform.rotation, wrench.moment)
    return Wrench(force, moment), platform.points(centre[None])[:, 0]


def rotation_from_rest(platform: Poses) -> Array:
    """Angle (n,) [rad] by which the platform is turned out of its pose in the static trial, NaN where not seen.

    About the axis of its largest excursion, which is positive. The angle is signed, so that noise of the markers
    stays centred about zero.
    """
    seen = np.flatnonzero(platform.seen())
    angle = np.full(len(platform.position), np.nan)
    if not len(seen):
        return angle
    vectors = Rotation.from_matrix(platform.rotation[seen]).as_rotvec()
    size = np.linalg.norm(vectors, axis=1)
    largest = int(np.argmax(size))
    angle[seen] = vectors @ vectors[largest] / max(float(size[largest]), np.finfo(float).tiny)
    return angle


def at_marker_times(plate_time: Array, wrench: Wrench, marker_time: Array, lag: float = 0.0) -> Wrench:
    """A wrench sampled at plate_time (k,) [s] as it was at marker_time (n,) [s], without delay.

    A zero-phase low-pass at a third of the marker rate keeps what is faster from folding into the signal; it takes
    less than 1e-5 at a fifteenth of that rate (20 Hz of 300 Hz), so that the analysis' own filter stays the only one.
    A plate that lags behind the markers by `lag` [s] is read that much later.
    """
    anti_alias = LowPass(sampling_rate(marker_time) * ANTI_ALIAS)
    both = anti_alias(np.hstack([wrench.force, wrench.moment]), sampling_rate(plate_time))
    read = np.clip(marker_time + lag, plate_time[0], plate_time[-1])
    sampled = make_interp_spline(plate_time, both, k=3)(read)
    return Wrench(sampled[:, :3], sampled[:, 3:])
