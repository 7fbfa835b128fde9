# SPDX-License-Identifier: Apache-2.0
"""Step 4, crossing: angle and torque of one crossing, and whether its set-up allows them.

`geometry` has the equation of the torque, `set_up` the checks. The changes of the torque without
each plate trial, and by errors of the plate's lag, height, place and mass, follow the torque
through all later steps.

Example: `analyse_crossing(trial, calibration, plate, True, settings, onset=None, lag=0.0).torque`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from osl_analysis.base.errors import InputError
from osl_analysis.base.measured import check_measured
from osl_analysis.base.trial import Array, Trial
from osl_analysis.signals.filters import longest_run, runs, sampling_rate
from osl_analysis.walking import platform
from osl_analysis.walking import poses as rigid
from osl_analysis.walking.geometry import (
    VERTICAL,
    Ankle,
    Passage,
    ankle_between,
    ankle_torque,
    load_on_foot,
    moment_of_foot,
    platform_turn,
)
from osl_analysis.walking.plate import (
    Stance,
    between,
    check_place,
    check_plate,
    check_type_on_platform,
    check_vertical,
    only_stance,
    recorded_corners,
    zeroed_wrench,
)
from osl_analysis.walking.plate_inertia import PlateModel, inertial_columns
from osl_analysis.walking.poses import Mask, Poses, StaticCalibration, StoredArray
from osl_analysis.walking.set_up import (
    CrossingQuality,
    check_followed,
    check_on_plate,
    check_onset,
    check_roll,
    check_side,
    check_turn,
    crossing_quality,
)
from osl_analysis.walking.walking_settings import CrossingSettings

SPARE_S = 0.1  # before and after stance, for the low-pass

UP = "up"  # direction of a perturbation in sheet and tables: toes up (dorsiflexion)
DOWN = "down"

PER_UNIT = ("plate_lag", "plate_height", "foot_place", "plate_mass")
"""Errors whose effects per ms, mm, mm and kg are the last rows of `Crossing.changes`."""


def recorded_passage(
    trial: Trial,
    calibration: StaticCalibration,
    lag: float,
    perturbed: bool,
    settings: CrossingSettings,
    onset: float | None,
) -> Passage:
    """Find poses, stance and onset of a crossing.

    Parameters
    ----------
    lag : float
        Lag of the plate behind the markers [s].
    perturbed : bool
        Whether the sheet says that the crossing is perturbed.
    onset : float or None
        Onset of the perturbation [s] by the mean ramp of all crossings; None: by its own ramp.

    Raises
    ------
    InputError
        The recording is not one crossing, or its plate or markers cannot be used.
    """
    recorded = {}
    reference = {}
    for segment, labels in settings.markers.clusters.items():
        frames, recorded[segment] = rigid.segment_poses(trial, labels, calibration, settings)
        reference[segment] = calibration.positions(labels)

    wrench = zeroed_wrench(trial, frames, settings)
    force = wrench(lag)[:, :3]
    check_vertical(force, settings.load_on_n)
    stance = only_stance(frames, force[:, 2], settings)
    check_plate(trial, settings.plate, stance, force[:, 2])
    corners = recorded_corners(trial, settings.plate)
    check_place(corners, settings.plate, calibration.corners)

    for segment, pose in recorded.items():
        check_followed(segment, frames, pose, stance, settings.largest_residual_mm)
    foot_markers = recorded["foot"].points(reference["foot"])
    check_on_plate(settings.plate, frames, foot_markers, stance, corners)
    ramp = platform.ramp_of(frames, recorded["platform"], settings.smallest_turn)
    check_turn(ramp is not None, perturbed)
    if ramp is not None and onset is None:
        onset = platform.ramp_onsets({trial.name: ramp})[0][trial.name]
    if onset is not None:
        check_onset(onset, stance, settings)
        check_window(trial, frames, recorded, onset, settings)

    rows = rows_about_stance(frames, recorded, stance)
    rate = sampling_rate(frames)
    low_passed = {}
    for segment, cluster in reference.items():
        markers = settings.low_pass(recorded[segment][rows].points(cluster), rate)
        low_passed[segment] = rigid.cluster_poses(cluster, markers)
    return Passage(trial.name, frames, recorded, wrench, corners, stance, onset, rows, low_passed)


def rows_about_stance(frames: Array, recorded: Mapping[str, Poses], stance: Stance) -> slice:
    """Stance and the frames about it in which all clusters were seen."""
    seen = np.all([pose.seen() for pose in recorded.values()], axis=0)
    near = seen & between(frames, (stance.heel_strike - SPARE_S, stance.toe_off + SPARE_S))
    first = int(np.argmax(stance.contains(frames)))
    return run_around(near, first)


def run_around(mask: Mask, row: int) -> slice:
    """The run of a mask that contains a row."""
    return next(run for run in runs(mask) if run.start <= row < run.stop)


def check_window(
    trial: Trial,
    time: Array,
    recorded: Mapping[str, Poses],
    onset: float,
    settings: CrossingSettings,
) -> None:
    """Refuse a perturbation on a plate without moments, or with occluded markers in its window."""
    check_type_on_platform(trial, settings.plate)
    window = between(time, (onset, onset + settings.window_s))
    for segment in ("foot", "platform"):  # the shank carries the body and moves as in any stance
        pose = recorded[segment]
        gap = longest_run(pose.bridged & window)
        if rigid.gap_duration(time, gap) > settings.longest_fitted_gap_s:
            occluded_s = (gap.stop - gap.start) * (time[1] - time[0])
            raise InputError(
                f"the {segment} markers are occluded for {1e3 * occluded_s:.0f} ms from"
                f" {time[gap.start]:.3f} s, while the perturbation is fitted, expected"
                f" {1e3 * settings.longest_fitted_gap_s:g} ms or less",
                "exclude the trial, or record it again with them in sight: a filled response is"
                " no measurement",
            )


def reactions_on_foot(
    passage: Passage,
    readings: Sequence[tuple[Array, float]],
    calibration: StaticCalibration,
    settings: CrossingSettings,
) -> tuple[list[Array], Array]:
    """Compute the ground reaction on the foot, without the plate's own wrench.

    The plate's own wrench is that of its measured motion, without accelerations at rest. In each of
    the `readings` it has other inertial parameters (10,) and another lag [s].

    Returns
    -------
    tuple of list of Array and Array
        Reactions (n, 6) [N, N*m] by each reading, in laboratory axes, and the plate's centre (n, 3)
        [m], about which they are.
    """
    rows = passage.rows
    poses_of_plate = passage.recorded["platform"]
    run = run_around(poses_of_plate.seen(), rows.start)
    track = platform.platform_track(
        passage.name, passage.frames[run], poses_of_plate[run], calibration, settings
    )
    middle = passage.corners.mean(axis=0)
    axes = platform.moving_directions([track])
    in_track = slice(rows.start - run.start, rows.stop - run.start)
    motion, weights = track.measured_motion(axes, middle)
    columns = inertial_columns(motion.weighted(weights))[in_track]

    plate = passage.poses["platform"]
    R_transposed = np.swapaxes(plate.rotation, 1, 2)
    rate = sampling_rate(passage.frames)
    reactions = []
    for parameters, lag in readings:
        wrench = settings.low_pass(passage.wrench(lag), rate)[rows]
        wrench_on_foot = wrench - columns @ parameters
        in_laboratory = wrench_on_foot.reshape(-1, 2, 3) @ R_transposed
        reactions.append(in_laboratory.reshape(-1, 6))
    return reactions, plate.point(middle)


def readings_of(plate: PlateModel, lag: float) -> list[tuple[Array, float]]:
    """Parameters and lag [s] of a plate: as identified, without each plate trial, 1 ms later, and
    with 1 kg more."""
    readings = [(model.parameters, lag) for model in (plate, *plate.leave_one_out)]
    heavier = plate.parameters.copy()
    heavier[0] += 1.0
    return [*readings, (plate.parameters, lag + 1e-3), (heavier, lag)]


@dataclass(frozen=True)
class Crossing:
    """Ankle angle and torque of one crossing, n samples at the marker rate."""

    name: str
    time: StoredArray
    theta: StoredArray  # joint angle (n,) [rad]
    torque: StoredArray  # internal plantarflexion moment (n,) [N*m]
    # Vertical force [N], and centre of pressure [m] to the left of the ankle and before it: (3, n)
    load: StoredArray
    stance: Stance
    onset: float | None  # of the perturbation [s]; None without one
    bridged: float  # fraction of the frames in stance in which an occluded cluster was interpolated
    # Changes (m + 4, n) [N*m] of the torque without the i-th of m plate trials, m = 0 with one, and
    # by `PER_UNIT`
    changes: StoredArray
    quality: CrossingQuality = field(default_factory=CrossingQuality)
    # Largest turn [rad] of the platform about the ankle in the window, toes up; None without one
    turn: float | None = None
    body_mass: float | None = None  # [kg]; None if nobody states it

    def __post_init__(self) -> None:
        for signal in ("time", "theta", "torque", "load", "changes"):
            check_measured(f"trial {self.name}: {signal}", getattr(self, signal))
        sampling_rate(self.time)  # it refuses stamps that do not go forward

    @property
    def direction(self) -> str | None:
        if self.turn is None:
            return None
        return UP if self.turn > 0 else DOWN


def analyse_crossing(
    trial: Trial,
    calibration: StaticCalibration,
    unloaded: PlateModel,
    perturbed: bool,
    settings: CrossingSettings,
    onset: float | None,
    lag: float,
) -> Crossing:
    """Compute angle and torque of a crossing, through one low-pass at one rate.

    Parameters
    ----------
    trial : Trial
        Markers and force plate; the joint's encoder, if there is one.
    unloaded : PlateModel
        Inertia and lag of the plate, which are removed.
    perturbed : bool
        Whether the sheet says that the crossing is perturbed.
    onset : float or None
        Onset of the perturbation [s] by the mean ramp of all crossings; None: by its own ramp.
    lag : float
        Lag of the plate in this crossing [s].

    Raises
    ------
    InputError
        The recording, or the laboratory's set-up, does not allow it.
    """
    # Poses, stance and onset
    passage = recorded_passage(trial, calibration, lag, perturbed, settings, onset)
    foot, shank = passage.poses["foot"], passage.poses["shank"]
    phase = passage.stance.phase(passage.time)

    # Angle
    ankle = ankle_between(foot, shank, calibration)
    _, ahead = ankle.along(shank.position - ankle.centre)
    check_side(phase, ahead)

    # Torque
    readings = readings_of(unloaded, lag)
    reactions, centre = reactions_on_foot(passage, readings, calibration, settings)
    torques = np.array(
        [ankle_torque(reaction, centre, ankle.centre, ankle.axis) for reaction in reactions]
    )
    load = load_on_foot(reactions[0], centre, ankle)
    push = ankle.along(reactions[0][:, :3])
    torque = torques[0]
    if settings.foot is not None:
        stated_foot = settings.foot
        centre_of_mass = calibration.ankle_centre + stated_foot.centre_of_mass_m
        motion = rigid.body_motion(passage.time, foot, centre_of_mass)
        torque = torque + moment_of_foot(
            motion, ankle.centre, ankle.axis, stated_foot.mass_kg, stated_foot.inertia_kg_m2
        )

    # Checks of the set-up
    undisturbed_torque = torque if passage.onset is None else np.zeros_like(torque)
    check_roll(phase, load, push, undisturbed_torque)
    inside = passage.stance.contains(passage.frames)
    bridged = np.any([pose.bridged[inside] for pose in passage.recorded.values()], axis=0)

    turn = None
    if passage.onset is not None:
        window = passage.onset, passage.onset + settings.window_s
        turn = platform_turn(passage.time, passage.poses["platform"], ankle.axis, window)
    return Crossing(
        name=trial.name,
        time=passage.time,
        theta=ankle.theta,
        torque=torque,
        load=load,
        stance=passage.stance,
        onset=passage.onset,
        bridged=float(np.mean(bridged)),
        changes=changes_of(torques, reactions[0], passage.poses["platform"].rotation, ankle),
        quality=crossing_quality(trial, passage, ankle, load, calibration, settings),
        turn=turn,
    )


def changes_of(torques: Array, reaction: Array, turned: Array, ankle: Ankle) -> Array:
    """Changes (m + 4, n) [N*m] of the torque, as in `Crossing`.

    They come from the torques by all `readings_of` the plate, and from errors of the plate's place,
    which turn with the platform's rotation `turned` (n, 3, 3).
    """
    *without_trials, later, heavier = torques - torques[0]
    force = np.hstack([reaction[:, :3], np.zeros_like(ankle.centre)])
    higher, further = (
        ankle_torque(force, 1e-3 * turned @ direction, np.zeros(3), ankle.axis)
        for direction in (VERTICAL, ankle.forward.mean(axis=0))
    )
    return np.array([*without_trials[1:], later, higher, further, heavier])
