"""Step 4, torque of one crossing: from the plate's wrench without its own inertia, with its errors.

Beside the torque stand its changes without each plate trial, and by each error of the laboratory
that no crossing shows. They follow the torque through all later steps.
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import scipy

from osl_analysis.signals import sampling_rate
from osl_analysis.trial import Array
from osl_analysis.walking import platform, poses
from osl_analysis.walking.ankle import Ankle, ankle_torque
from osl_analysis.walking.passage import Passage
from osl_analysis.walking.plate import WrenchReader
from osl_analysis.walking.plate_model import PlateModel, inertial_columns
from osl_analysis.walking.poses import BodyMotion, StaticCalibration
from osl_analysis.walking.shared_motion import (
    Alignment,
    PlatformModel,
    PlatformTemplate,
    inertial_motion,
    jackknife_rows,
)
from osl_analysis.walking.walking_settings import CrossingSettings


@dataclass(frozen=True)
class UnseenErrorSize:
    """An error that the data do not show: what it is, and the size whose effect is computed."""

    words: str
    size: float
    unit: str


LABORATORY_ERRORS = {
    "corners_height": UnseenErrorSize("corners of the plate, or ORIGIN, too high", 10.0, "mm"),
    "corners_forward": UnseenErrorSize("corners too far forward", 10.0, "mm"),
    "moments": UnseenErrorSize("moment channels too large", 1.0, "%"),
    "forces": UnseenErrorSize("force channels too large", 1.0, "%"),
    "pitch": UnseenErrorSize(
        "cameras pitched, so that all markers turn toes down about the laboratory's origin",
        1.0,
        "deg",
    ),
    "plate_lag": UnseenErrorSize("plate later than it is corrected for", 1.0, "ms"),
    "plate_inertia": UnseenErrorSize("the plate's own wrench removed too much", 1.0, "%"),
    "skin": UnseenErrorSize(
        "shank markers that slide on the skin with the ankle's angle", 5.0, "%"
    ),
    "shoe": UnseenErrorSize("foot that yields in the shoe", 60.0, "N*m/deg"),
}
"""Of a laboratory, by the name of the stated uncertainty. The last two change no torque: their
effect follows from the fit."""

LOG_ERRORS = {
    "torque_lag": UnseenErrorSize("torque later than the angle", 1.0, "ms"),
    "torque": UnseenErrorSize("torque too large", 1.0, "%"),
}
"""The same of a boot's or leg's log."""


@dataclass(frozen=True)
class AnkleTorques:
    """The torque of one crossing in n frames, and its changes."""

    on_foot: Array  # ground reaction (n, 6) in laboratory axes, without the plate's own wrench
    centre: Array  # the plate's centre (n, 3) [m], about which it is
    torque: Array  # (n,) [N*m]
    # Changes (m, n) [N*m] without each plate trial, and without each group of crossings in the
    # shared shape, as rows of one jackknife
    plate_errors: Array
    lab_errors: Array  # changes (7, n) [N*m] by the first `LABORATORY_ERRORS`


@dataclass(frozen=True)
class MovingPlate:
    """A crossing's plate, which turns its wrench into the torque about the ankle."""

    passage: Passage
    ankle: Ankle
    track: platform.PlatformTrack | None  # of the platform; None without markers
    alignment: Alignment | None  # how the platform follows the shared shape
    wrench: WrenchReader  # low-passed, in the rows of the passage

    @property
    def middle(self) -> Array:
        """The plate's centre (3,) [m] at rest."""
        return np.asarray(self.passage.corners.mean(axis=0))

    @property
    def centre(self) -> Array:
        """The plate's centre (n, 3) [m]."""
        return self.passage.poses["platform"].point(self.middle)

    def motion(self, template: PlatformTemplate | None) -> BodyMotion:
        """Motion of the plate's centre, by the shared shape if this crossing follows it."""
        time = self.passage.time
        if self.track is None:
            return poses.body_motion(time, self.passage.poses["platform"], self.middle)
        first = int(np.searchsorted(self.track.time, time[0] - 1e-9))
        rows = slice(first, first + len(time))
        return inertial_motion(self.track, self.middle, template, self.alignment, rows)

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
    shared: PlatformModel,
    calibration: StaticCalibration,
    settings: CrossingSettings,
) -> MovingPlate:
    """Follow the plate of a crossing."""
    track = None
    if settings.markers.platform:
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

    return MovingPlate(passage, ankle, track, shared.followed(passage.name), wrench)


def ankle_torques(plate: MovingPlate, unloaded: PlateModel, shared: PlatformModel) -> AnkleTorques:
    """Compute the ankle's torque, and its changes by errors of plate, platform and laboratory."""
    motion = plate.motion(shared.template)
    on_foot = plate.reaction(unloaded, motion)
    torque = plate.torque(unloaded, motion)

    without_trials = [plate.torque(model, motion) - torque for model in unloaded.leave_one_out]
    without_crossings = []
    for template in shared.leave_out:
        change = torque * 0  # the shape only changes crossings that follow it
        if plate.alignment is not None:
            change = plate.torque(unloaded, plate.motion(template)) - torque
        without_crossings.append(change)
    jackknife = jackknife_rows(without_trials, without_crossings)
    return AnkleTorques(
        on_foot,
        centre=plate.centre,
        torque=torque,
        plate_errors=np.reshape(jackknife, (-1, len(torque))),
        lab_errors=laboratory_changes(plate, unloaded, motion, torque),
    )


def laboratory_changes(
    plate: MovingPlate, unloaded: PlateModel, motion: BodyMotion, torque: Array
) -> Array:
    """Changes (7, n) [N*m] of the torque by each of the first `LABORATORY_ERRORS`."""
    ankle = plate.ankle
    centre = plate.centre
    on_foot = plate.reaction(unloaded, motion)
    R = plate.passage.poses["platform"].rotation
    forward = ankle.forward.mean(axis=0)
    size = {name: error.size for name, error in LABORATORY_ERRORS.items()}

    def changed(reaction: Array, about: Array) -> Array:
        return ankle_torque(reaction, about, ankle.centre, ankle.axis) - torque

    high = 1e-3 * size["corners_height"] * R[:, :, 2]
    ahead = 1e-3 * size["corners_forward"] * R @ forward
    more_moment = np.repeat((1.0, 1 + size["moments"] / 100), 3)
    more_force = np.repeat((1 + size["forces"] / 100, 1.0), 3)

    tilt = scipy.spatial.transform.Rotation.from_rotvec(
        np.deg2rad(size["pitch"]) * ankle.axis.mean(axis=0)
    ).as_matrix()
    # The tilted markers turn the wrench by what they say of the platform: P R P^T for R
    force_and_moment = np.einsum(
        "ij,njk,lk,nml,nqm->nqi", tilt, R, tilt, R, on_foot.reshape(-1, 2, 3)
    )
    seen_centre = plate.passage.poses["platform"].point(tilt.T @ plate.middle) @ tilt.T
    pitched = ankle_torque(
        force_and_moment.reshape(-1, 6), seen_centre, ankle.centre @ tilt.T, ankle.axis @ tilt.T
    )

    late_lag = (unloaded.lag or 0.0) + 1e-3 * size["plate_lag"]
    read_later = plate.torque(replace(unloaded, lags=(late_lag,)), motion)
    heavier = 1 + size["plate_inertia"] / 100
    too_much_removed = replace(unloaded, parameters=heavier * unloaded.parameters)
    return np.array(
        [
            changed(on_foot, centre + high),
            changed(on_foot, centre + ahead),
            changed(on_foot * more_moment, centre),
            changed(on_foot * more_force, centre),
            pitched - torque,
            torque - read_later,  # a plate that is later than corrected for was read too early
            plate.torque(too_much_removed, motion) - torque,
        ]
    )
