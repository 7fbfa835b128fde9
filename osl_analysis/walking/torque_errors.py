"""Step 4, torque of one crossing: from the plate's wrench without its own inertia, with its errors.

Beside the torque stand its changes without each plate trial, which follow it through all later
steps.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from osl_analysis.signals import sampling_rate
from osl_analysis.trial import Array
from osl_analysis.walking import platform
from osl_analysis.walking.ankle import Ankle, ankle_torque
from osl_analysis.walking.passage import Passage
from osl_analysis.walking.plate import WrenchReader
from osl_analysis.walking.plate_model import PlateModel, inertial_columns
from osl_analysis.walking.poses import BodyMotion, StaticCalibration
from osl_analysis.walking.walking_settings import CrossingSettings


@dataclass(frozen=True)
class AnkleTorques:
    """The torque of one crossing in n frames, and its changes."""

    on_foot: Array  # ground reaction (n, 6) in laboratory axes, without the plate's own wrench
    centre: Array  # the plate's centre (n, 3) [m], about which it is
    torque: Array  # (n,) [N*m]
    plate_errors: Array  # changes (m, n) [N*m] without each plate trial


@dataclass(frozen=True)
class MovingPlate:
    """A crossing's plate, which turns its wrench into the torque about the ankle."""

    passage: Passage
    ankle: Ankle
    track: platform.PlatformTrack  # of the platform
    wrench: WrenchReader  # low-passed, in the rows of the passage

    @property
    def middle(self) -> Array:
        """The plate's centre (3,) [m] at rest."""
        return np.asarray(self.passage.corners.mean(axis=0))

    @property
    def centre(self) -> Array:
        """The plate's centre (n, 3) [m]."""
        return self.passage.poses["platform"].point(self.middle)

    def motion(self) -> BodyMotion:
        """Motion of the plate's centre, without accelerations at rest."""
        time = self.passage.time
        first = int(np.searchsorted(self.track.time, time[0] - 1e-9))
        rows = slice(first, first + len(time))
        axes = platform.shared_directions([self.track])[0]
        motion, weights = self.track.measured_motion(axes, self.middle, rows)
        return motion.weighted(weights)

    def reaction(self, model: PlateModel, motion: BodyMotion) -> Array:
        """Ground reaction (n, 6) on the foot, in laboratory axes."""
        of_plate = inertial_columns(motion) @ model.parameters
        force_and_moment = (self.wrench(model.lag or 0.0) - of_plate).reshape(-1, 2, 3)
        R_transposed = np.swapaxes(self.passage.poses["platform"].rotation, 1, 2)
        return np.asarray((force_and_moment @ R_transposed).reshape(-1, 6))

    def torque(self, model: PlateModel, motion: BodyMotion) -> Array:
        """The ankle's torque (n,) [N*m]."""
        reaction = self.reaction(model, motion)
        return ankle_torque(reaction, self.centre, self.ankle.centre, self.ankle.axis)


def moving_plate(
    passage: Passage,
    ankle: Ankle,
    calibration: StaticCalibration,
    settings: CrossingSettings,
) -> MovingPlate:
    """Follow the plate of a crossing."""
    track = platform.track_about(
        passage.name,
        passage.frames,
        passage.recorded["platform"],
        calibration,
        settings,
        float(passage.time[0]),
    )

    @cache  # the jackknife reads the same lag ten times
    def wrench(lag: float) -> Array:
        low_passed = settings.low_pass(passage.wrench.read(lag), sampling_rate(passage.frames))
        return low_passed[passage.rows]

    return MovingPlate(passage, ankle, track, wrench)


def ankle_torques(plate: MovingPlate, unloaded: PlateModel) -> AnkleTorques:
    """Compute the ankle's torque, and its changes without each plate trial."""
    motion = plate.motion()
    torque = plate.torque(unloaded, motion)
    changes = [plate.torque(model, motion) - torque for model in unloaded.leave_one_out]
    return AnkleTorques(
        plate.reaction(unloaded, motion),
        centre=plate.centre,
        torque=torque,
        plate_errors=np.reshape(changes, (-1, len(torque))),
    )
