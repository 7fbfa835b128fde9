"""Step 4, ankle: angle and torque of one crossing, from its poses, its stance and its wrench.

The torque is computed from force and moment at the plate's origin, never from a centre of pressure,
which is undefined while the plate is unloaded. Beside it stand its changes without each plate
trial, which follow it through all later steps.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy

from osl_analysis.errors import InputError
from osl_analysis.signals import longest_run, runs, sampling_rate
from osl_analysis.trial import Array, Trial
from osl_analysis.walking import platform, poses
from osl_analysis.walking.plate import (
    Stance,
    WrenchReader,
    check_plate,
    check_type_on_platform,
    check_vertical,
    only_stance,
    recorded_corners,
    zeroed_wrench,
)
from osl_analysis.walking.plate_inertia import PlateModel, inertial_columns
from osl_analysis.walking.platform import ramp_of, ramp_onsets
from osl_analysis.walking.poses import FREE_FALL, BodyMotion, Mask, Poses, StaticCalibration
from osl_analysis.walking.walking_settings import CrossingSettings

PRESSED_N = 100.0  # vertical force above which a centre of pressure is defined
VERTICAL = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Ankle:
    """The ankle in n frames: the means of foot's and shank's centre and axis."""

    theta: Array  # joint angle (n,) [rad], dorsiflexion positive
    centre: Array  # (n, 3) [m]
    axis: Array  # unit vectors (n, 3) to the left

    @property
    def forward(self) -> Array:
        """Level directions (n, 3) in which the foot points."""
        return np.cross(self.axis, VERTICAL)


def ankle_between(foot: Poses, shank: Poses, calibration: StaticCalibration) -> Ankle:
    """Find angle, centre and axis of the ankle from the poses of foot and shank."""
    axis = (foot.rotation + shank.rotation) @ calibration.ankle_axis
    centre = calibration.ankle_centre
    return Ankle(
        theta=ankle_angle(foot, shank, calibration.ankle_axis),
        centre=(foot.point(centre) + shank.point(centre)) / 2,
        axis=axis / np.linalg.norm(axis, axis=1, keepdims=True),
    )


def ankle_angle(foot: Poses, shank: Poses, axis: Array) -> Array:
    """Joint angle theta (n,) [rad], zero in the static pose.

    It is minus the twist of the foot relative to the shank about the axis (3,), which points to
    the left: a foot that turns about it by a positive angle lowers its toes.
    """
    relative = np.einsum("nji,njk->nik", shank.rotation, foot.rotation)
    quaternion = scipy.spatial.transform.Rotation.from_matrix(relative).as_quat(canonical=True)
    return np.asarray(-2 * np.arctan2(quaternion[:, :3] @ axis, quaternion[:, 3]))


def ankle_torque(reaction: Array, plate_centre: Array, ankle: Array, axis: Array) -> Array:
    """Internal plantarflexion moment about the ankle's axis.

    Parameters
    ----------
    reaction : Array
        Force F [N] and moment M [N*m] of the ground on the foot (n, 6), in laboratory axes, about
        the plate's centre.
    plate_centre, ankle : Array
        The plate's centre c and the ankle's centre a [m], (3,) or (n, 3).
    axis : Array
        Unit vectors (n, 3) to the left.

    Returns
    -------
    Array
        tau (n,) [N*m] = -(M + (c - a) x F) . axis.
    """
    F, M = reaction[:, :3], reaction[:, 3:]
    about_ankle = M + np.cross(plate_centre - ankle, F)
    return np.asarray(-np.sum(about_ankle * axis, axis=1))


@dataclass(frozen=True)
class LoadOnFoot:
    """What presses on the foot in n frames: the rows of `Crossing.load`."""

    vertical: Array  # force (n,) [N]
    left: Array  # centre of pressure (n,) [m] from the ankle along its axis; 0 if hardly pressed
    forward: Array  # the same before the ankle


def load_on_foot(reaction: Array, centre: Array, ankle: Ankle) -> LoadOnFoot:
    """Vertical force and centre of pressure, from the reaction (n, 6) about `centre` (n, 3) [m]."""
    vertical = reaction[:, 2]
    pressed = vertical > PRESSED_N
    divisor = np.where(pressed, vertical, 1.0)[:, None]
    pressure = centre + np.cross(VERTICAL, reaction[:, 3:]) / divisor
    from_ankle = pressure - ankle.centre
    return LoadOnFoot(
        vertical,
        left=np.where(pressed, np.sum(from_ankle * ankle.axis, axis=1), 0.0),
        forward=np.where(pressed, np.sum(from_ankle * ankle.forward, axis=1), 0.0),
    )


def moment_of_foot(
    foot: BodyMotion, ankle: Array, axis: Array, mass: float, inertia: float
) -> Array:
    """Torque of weight and inertia of all that moves with the foot.

    Parameters
    ----------
    foot : BodyMotion
        Of the foot and of its centre of mass c, n frames.
    ankle, axis : Array
        Centre a (n, 3) [m] and axis (n, 3) of the ankle.
    mass, inertia : float
        m [kg], and I [kg*m^2] about the axis through c.

    Returns
    -------
    Array
        (n,) [N*m]: axis . ((c - a) x m (c'' - g) + I alpha).
    """
    of_mass = np.cross(foot.point - ankle, mass * (foot.acceleration - FREE_FALL))
    return np.asarray(np.sum(axis * (of_mass + inertia * foot.alpha), axis=1))


SPARE_S = 0.1  # before and after stance, for the low-pass


@dataclass(frozen=True)
class Passage:
    """A crossing as markers and plate recorded it, in all k frames and in n `rows`.

    The rows are stance, and up to 0.1 s before and after it for the low-pass.
    """

    name: str
    frames: Array  # time (k,) [s] of all frames
    recorded: dict[str, Poses]  # of foot, shank and platform in all frames, not low-passed
    wrench: WrenchReader  # of the plate, in all frames, minus its zero
    corners: Array  # of the plate (4, 3) [m] at rest
    stance: Stance
    onset: float | None  # of the perturbation [s]
    rows: slice
    poses: dict[str, Poses]  # in `rows`, low-passed

    @property
    def time(self) -> Array:
        return self.frames[self.rows]

    @property
    def inside(self) -> Mask:
        """Which of `rows` are in stance."""
        return in_stance(self.time, self.stance)


def in_stance(time: Array, stance: Stance) -> Mask:
    return np.asarray((time >= stance.heel_strike) & (time <= stance.toe_off))


def recorded_passage(
    trial: Trial,
    calibration: StaticCalibration,
    lag: float,
    perturbed: bool,
    settings: CrossingSettings,
    onset: float | None = None,
) -> Passage:
    """Find poses, stance and onset of a crossing.

    Parameters
    ----------
    lag : float
        Of the plate behind the markers [s].
    perturbed : bool
        Whether the sheet says so.
    onset : float or None
        Of the perturbation [s], by the mean ramp of all crossings; None: by its own ramp.

    Raises
    ------
    InputError
        The recording is not one crossing, or its plate or markers cannot be used.
    """
    recorded = {}
    reference = {}
    for segment, labels in settings.markers.clusters.items():
        frames, recorded[segment] = poses.segment_poses(trial, labels, calibration, settings)
        reference[segment] = calibration.positions(labels, trial.name)

    wrench = zeroed_wrench(trial, frames, settings)
    force = wrench(lag)[:, :3]
    check_vertical(force)
    stance = only_stance(frames, force[:, 2], settings)
    check_plate(trial, settings.plate, stance, force[:, 2])
    corners = recorded_corners(trial, settings.plate)

    onset = onset_of(trial, frames, recorded, stance, perturbed, settings, onset)
    for segment, pose in recorded.items():
        check_same_cluster(segment, trial, frames, pose, stance, reference[segment], settings)
        check_followed(segment, frames, pose, stance)

    rows = rows_about_stance(frames, recorded, stance)
    rate = sampling_rate(frames)
    low_passed = {}
    for segment, cluster in reference.items():
        markers = settings.low_pass(recorded[segment][rows].points(cluster), rate)
        low_passed[segment] = poses.cluster_poses(cluster, markers)
    return Passage(trial.name, frames, recorded, wrench, corners, stance, onset, rows, low_passed)


def check_same_cluster(
    segment: str,
    trial: Trial,
    frames: Array,
    pose: Poses,
    stance: Stance,
    reference: Array,
    settings: CrossingSettings,
) -> None:
    """Refuse a cluster that was put on again since the static trial, where its markers were at
    `reference` (m, 3) [m]."""
    inside = in_stance(frames, stance)
    in_stance_residual = pose.residual[inside & np.isfinite(pose.residual)]
    residual_mm = 1e3 * float(np.median(np.r_[0.0, in_stance_residual]))
    if residual_mm <= settings.largest_residual_mm:
        return
    labels = settings.markers.clusters[segment]
    tracks = poses.marker_tracks(trial, labels)[1][inside]
    marker, distance_m = poses.moved_marker(
        reference, tracks, poses.cluster_poses(reference, tracks)
    )
    raise InputError(
        f"the {segment} markers stand {residual_mm:.0f} mm (RMS) otherwise than in the static trial"
        f" throughout stance, {labels[marker]} most, by {1e3 * distance_m:.0f} mm,"
        f" expected {settings.largest_residual_mm:g} mm or less: they were put on again, or carry"
        " other labels; record a static trial after the change and name it in the column static,"
        " correct the labels, or exclude the trial"
    )


def check_followed(segment: str, frames: Array, pose: Poses, stance: Stance) -> None:
    """Refuse a cluster that is hidden in stance."""
    hidden = np.flatnonzero(in_stance(frames, stance) & ~pose.seen())
    if len(hidden):
        raise InputError(
            f"the {segment} markers cannot be followed at {frames[hidden[0]]:.3f} s, in"
            f" {len(hidden)} frames of stance; correct exchanged labels in"
            " Nexus, raise longest_gap_s, or exclude the trial"
        )


def rows_about_stance(frames: Array, recorded: Mapping[str, Poses], stance: Stance) -> slice:
    """Stance and the frames about it in which all clusters were seen."""
    seen = np.all([pose.seen() for pose in recorded.values()], axis=0)
    near = seen & (frames >= stance.heel_strike - SPARE_S) & (frames <= stance.toe_off + SPARE_S)
    first = np.argmax(in_stance(frames, stance))
    return next(run for run in runs(near) if run.start <= first < run.stop)


def onset_of(
    trial: Trial,
    time: Array,
    recorded: Mapping[str, Poses],
    stance: Stance,
    perturbed: bool,
    settings: CrossingSettings,
    of_mean_ramp: float | None,
) -> float | None:
    """Find the onset [s] of the perturbation: that of the mean ramp, else of the crossing's own.

    Returns
    -------
    float or None
        None without a perturbation.

    Raises
    ------
    InputError
        Sheet, stance, plate or markers forbid it.
    """
    ramp = ramp_of(time, recorded["platform"], settings.smallest_turn)
    onset = None
    if ramp is not None:
        onset = of_mean_ramp
        if onset is None:
            onset = ramp_onsets({trial.name: ramp})[trial.name]
    check_onset(onset, perturbed, stance, settings)
    if onset is None:
        return None

    check_type_on_platform(trial, settings.plate)
    window = (time >= onset) & (time <= onset + settings.window_s)
    for segment in ("foot", "platform"):  # the shank carries the body and moves as in any stance
        pose = recorded[segment]
        gap = longest_run(pose.bridged & window)
        if poses.gap_duration(time, gap) > settings.longest_fitted_gap_s:
            hidden_s = (gap.stop - gap.start) * (time[1] - time[0])
            raise InputError(
                f"the {segment} markers are hidden for {1e3 * hidden_s:.0f} ms from"
                f" {time[gap.start]:.3f} s, while the perturbation is"
                f" fitted, expected {1e3 * settings.longest_fitted_gap_s:g} ms or less; exclude the"
                " trial, or record it again with them in sight: a filled response is no measurement"
            )
    return onset


def check_onset(
    onset: float | None, perturbed: bool, stance: Stance, settings: CrossingSettings
) -> None:
    """Refuse an onset [s] that the sheet contradicts, or whose response leaves stance."""
    if (onset is not None) != perturbed:
        raise InputError(
            f"the platform {'turns' if perturbed is False else 'does not turn'}, but the sheet says"
            f" perturbed = {str(perturbed).lower()}; correct the sheet, perturbation_deg or the"
            " platform markers, or exclude the trial"
        )
    if onset is None:
        return
    span = f"stance {stance.heel_strike:.3f}-{stance.toe_off:.3f} s"
    if not stance.heel_strike < onset < stance.toe_off:
        raise InputError(
            f"the perturbation starts at {onset:.3f} s, outside {span}; exclude the trial"
        )
    first = onset - settings.guard_s - settings.baseline_s
    last = onset + settings.window_s
    if first < stance.heel_strike or last > stance.toe_off:
        raise InputError(
            f"baseline and window, {first:.3f}-{last:.3f} s, leave {span}; shorten window_s,"
            " baseline_s or guard_s, or exclude the trial"
        )


@dataclass(frozen=True)
class AnkleTorques:
    """The torque of one crossing in n frames, and its changes."""

    on_foot: Array  # ground reaction (n, 6) in laboratory axes, without the plate's own wrench
    centre: Array  # the plate's centre (n, 3) [m], about which it is
    torque: Array  # (n,) [N*m]
    plate_errors: Array  # changes (m, n) [N*m] without each plate trial


def ankle_torques(
    passage: Passage,
    ankle: Ankle,
    unloaded: PlateModel,
    calibration: StaticCalibration,
    settings: CrossingSettings,
) -> AnkleTorques:
    """Compute the ankle's torque, and its changes without each plate trial.

    The plate's own wrench is that of its measured motion, without accelerations at rest.
    """
    rows = passage.rows
    poses_of_plate = passage.recorded["platform"]
    run = next(run for run in runs(poses_of_plate.seen()) if run.start <= rows.start < run.stop)
    track = platform.platform_track(
        passage.name, passage.frames[run], poses_of_plate[run], calibration, settings
    )
    middle = np.asarray(passage.corners.mean(axis=0))
    axes = platform.shared_directions([track])[0]
    in_track = slice(rows.start - run.start, rows.stop - run.start)
    motion, weights = track.measured_motion(axes, middle, in_track)
    columns = inertial_columns(motion.weighted(weights))

    plate = passage.poses["platform"]
    centre = plate.point(middle)
    R_transposed = np.swapaxes(plate.rotation, 1, 2)

    @cache  # the jackknife reads the same lag ten times
    def wrench(lag: float) -> Array:
        return settings.low_pass(passage.wrench(lag), sampling_rate(passage.frames))[rows]

    def reaction(model: PlateModel) -> Array:
        """Ground reaction (n, 6) on the foot, in laboratory axes."""
        of_foot = wrench(model.lag or 0.0) - columns @ model.parameters
        return np.asarray((of_foot.reshape(-1, 2, 3) @ R_transposed).reshape(-1, 6))

    def torque(model: PlateModel) -> Array:
        return ankle_torque(reaction(model), centre, ankle.centre, ankle.axis)

    of_all = torque(unloaded)
    changes = [torque(model) - of_all for model in unloaded.leave_one_out]
    return AnkleTorques(
        reaction(unloaded), centre, of_all, plate_errors=np.reshape(changes, (-1, len(of_all)))
    )
