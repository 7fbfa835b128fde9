"""The ankle's torque in one crossing, for any model of the plate and any motion of the platform."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from osl_analysis.signals import sampling_rate
from osl_analysis.trial import Array
from osl_analysis.walking.ankle import (
    FootInertia,
    StaticCalibration,
    ankle_angle,
    ankle_in_lab,
    ankle_torque,
    foot_torque,
)
from osl_analysis.walking.cluster import BodyMotion, Poses, body_motion
from osl_analysis.walking.plate import PlateWrench, WrenchAtFrames, in_laboratory
from osl_analysis.walking.plate_inertia import PlateInertia
from osl_analysis.walking.platform_model import inertial_motion
from osl_analysis.walking.platform_motion import PlatformTrack
from osl_analysis.walking.platform_shape import Alignment, PlatformTemplate
from osl_analysis.walking.settings import CrossingSettings


@dataclass(frozen=True)
class FilteredCrossing:
    """A crossing through the low-pass, in n rows of its marker frames: the rows of stance.

    What the plate's model and the platform's motion do not change is computed once: a crossing asks for its torque with
    each of some fifteen models, whose scatter is the torque's error.

    rows: the n rows.
    poses: filtered poses by segment, in these rows.
    plate: the plate's wrench at all frames, not filtered.
    track: the platform's own coordinates in the run of seen frames about the first row.
    centre: the plate's centre (3,) [m] at rest.
    calibration: the static calibration.
    settings: choices of the analysis.
    """

    rows: slice
    poses: Mapping[str, Poses]
    plate: WrenchAtFrames
    track: PlatformTrack
    centre: Array
    calibration: StaticCalibration
    settings: CrossingSettings

    @property
    def time(self) -> Array:
        """Times (n,) [s]."""
        return self.plate.time[self.rows]

    @cached_property
    def theta(self) -> Array:
        """The joint's angle (n,) [rad]."""
        return ankle_angle(self.poses["foot"], self.poses["shank"], self.calibration.ankle_axis)

    @cached_property
    def ankle(self) -> tuple[Array, Array]:
        """Centre (n, 3) [m] and axis (n, 3) of the ankle."""
        return ankle_in_lab(self.poses["foot"], self.poses["shank"], self.calibration)

    @cached_property
    def own_torque(self) -> Array | float:
        """Torque (n,) [N*m] of the foot's weight and inertia; 0 if the settings do not give them."""
        foot = self.settings.foot
        if foot is None:
            return 0.0
        inertia = FootInertia(foot.mass_kg, np.array(foot.centre_of_mass_m), foot.inertia_kg_m2)
        place = self.calibration.ankle_centre + inertia.centre_of_mass
        return foot_torque(body_motion(self.time, self.poses["foot"], place), *self.ankle, inertia)

    def motion(self, template: PlatformTemplate | None, follows: Alignment | None) -> BodyMotion:
        """Motion (n,) of the plate's centre: by the shape that crossings share, if this one `follows` it."""
        first = int(np.searchsorted(self.track.time, self.time[0] - 1e-9))
        motion = inertial_motion(self.track, self.centre, template, follows)
        return motion[first : first + len(self.time)]

    def wrench(self, delay: float) -> PlateWrench:
        """The filtered wrench (n, 3) of a plate that is late by `delay` [s], with the plate's own inertia."""
        rate = sampling_rate(self.plate.time)
        return self.plate.late_by(delay).filtered(self.settings.low_pass, rate)[self.rows]

    def reaction(self, wrench: PlateWrench, inertia: PlateInertia, motion: BodyMotion) -> tuple[PlateWrench, Array]:
        """Ground reaction on the foot, and the plate's centre (n, 3) [m], about which its moment acts.

        `wrench` is as from `wrench`, `motion` the plate's, for its own `inertia`.
        """
        return in_laboratory(wrench - inertia.wrench(motion), self.poses["platform"], self.centre)

    def torque(self, wrench: PlateWrench, inertia: PlateInertia, motion: BodyMotion) -> Array:
        """Internal plantarflexion moment (n,) [N*m], from the same as `reaction`."""
        reaction, centre_now = self.reaction(wrench, inertia, motion)
        return ankle_torque(reaction, centre_now, *self.ankle) + self.own_torque
