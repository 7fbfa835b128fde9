"""One crossing of the walkway: from markers and plate to angle and torque over stance, with its events."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.signals import longest_run, sampling_rate
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.ankle import (
    FootInertia,
    StaticCalibration,
    ankle_angle,
    ankle_in_lab,
    ankle_torque,
    foot_torque,
)
from osl_analysis.walking.encoder import EncoderCheck, compare_encoder
from osl_analysis.walking.events import Stance, checked_onset, find_onset, find_stances, only_stance
from osl_analysis.walking.kinematics import body_motion
from osl_analysis.walking.moving_plate import Wrench, at_marker_times, in_laboratory, rotation_from_rest
from osl_analysis.walking.plate_inertia import PlateInertia, PlateModel
from osl_analysis.walking.plate_zero import check_range, plate_axes, unloaded_zero
from osl_analysis.walking.rigid_body import Poses, smoothed
from osl_analysis.walking.segments import plate_centre, plate_corners, plate_wrench, reference_of, segment_poses
from osl_analysis.walking.settings import FootSettings, WalkingAnalysis

SEGMENTS = ("foot", "shank", "platform")
MOVED = ("foot", "platform")
"""What a perturbation moves; the shank, which carries the body, goes on as in any stance."""
EDGE_S = 0.1
"""What the low-pass needs [s] of the record before and after a stance, where there is that much."""
FOOT_FLAT = (0.15, 0.35)
"""Part of stance, ahead of the perturbation, over which the foot's place on the plate is averaged."""


@dataclass(frozen=True)
class Quality:
    """What says how far a crossing can be trusted.

    RMS residual [m] of each cluster's markers from their rigid body in stance; `zero` [N]: vertical force of the plate
    before it was stepped on, which was taken away (None: it was not looked for); `placement` (2,) [m]: the ankle
    forward and to the left of the plate's centre while the foot is flat; `encoder`: the leg's own (None: no column
    theta).
    """

    residuals: Mapping[str, float]
    zero: float | None
    placement: tuple[float, float]
    encoder: EncoderCheck | None


@dataclass(frozen=True)
class Crossing:
    """Joint angle [rad] and internal plantarflexion moment [N*m] of one crossing, n samples at the marker rate.

    `platform` is the platform's rotation [rad], not filtered; `onset` [s] of the perturbation, None without one;
    `bridged` the fraction of frames in stance in which a hidden cluster was interpolated. `plate_errors` (m, n) [N*m]
    is what leaving out each of the m trials of the unloaded plate does to the torque; m = 0 if there was one.
    """

    name: str
    time: Array
    theta: Array
    torque: Array
    platform: Array
    stance: Stance
    onset: float | None
    bridged: float
    quality: Quality
    plate_errors: Array


def analyse_crossing(
    trial: Trial, calibration: StaticCalibration, plate: PlateModel, perturbed: bool, settings: WalkingAnalysis
) -> Crossing:
    """Angle and torque of a crossing; `perturbed` is what the sheet says, checked against the platform's motion.

    Markers and wrench pass the same low-pass at the same rate first; what follows from them is not filtered again.

    Raises
    ------
    InputError
        No or several stances, a perturbation that is not where or what it should be, or a cluster hidden in stance.
    """
    try:
        return crossing_of(trial, calibration, plate, perturbed, settings)
    except InputError as error:
        text = str(error)
        raise InputError(text if trial.name in text else f"trial {trial.name}: {text}") from error


def crossing_of(
    trial: Trial, calibration: StaticCalibration, plate: PlateModel, perturbed: bool, settings: WalkingAnalysis
) -> Crossing:
    """As `analyse_crossing`; its messages do not name the trial."""
    clusters = {name: (getattr(settings.markers, name), getattr(calibration, name)) for name in SEGMENTS}
    raw = {}
    for name, (labels, positions) in clusters.items():
        time, raw[name] = segment_poses(trial, labels, positions, settings)
    reading, zero = plate_reading(trial, settings)
    stance = stance_of(time, reading.at(time, plate.lag), settings)
    rotation = rotation_from_rest(raw["platform"])
    onset = find_onset(time, rotation, float(np.deg2rad(settings.perturbation_deg)))
    lead = settings.guard_s + settings.baseline_s
    onset = checked_onset(onset, stance, perturbed, lead, settings.window_s)
    if onset is not None:
        moved = {name: raw[name] for name in MOVED}
        check_followed(time, moved, (onset, onset + settings.window_s), settings.longest_fitted_gap_s)
    rows = rows_of_stance(time, raw, stance)
    rate = sampling_rate(time)
    poses = {
        name: smoothed(raw[name][rows], reference_of(positions, labels, trial.name), settings.low_pass, rate)
        for name, (labels, positions) in clusters.items()
    }
    centre = plate_centre(trial, settings.plate)

    def torque_by(model: PlateModel) -> Array:
        wrench = reading.at(time, model.lag)
        filtered = Wrench(settings.low_pass(wrench.force, rate)[rows], settings.low_pass(wrench.moment, rate)[rows])
        return torque_of(time[rows], poses, filtered, centre, calibration, model.inertia, settings.foot)

    torque = torque_by(plate)
    theta = ankle_angle(poses["foot"], poses["shank"], calibration.ankle_axis)
    inside = (time[rows] >= stance.heel_strike) & (time[rows] <= stance.toe_off)
    bridged = np.any([pose.bridged for pose in poses.values()], axis=0)
    quality = Quality(
        {name: residual_of(pose[inside]) for name, pose in poses.items()},
        zero,
        placement_of(time[rows], poses["foot"], calibration, centre, stance),
        encoder_check(trial, time[rows], theta, settings),
    )
    errors = np.reshape([torque_by(model) - torque for model in plate.left_out], (-1, len(torque)))
    share = float(np.mean(bridged[inside]))
    return Crossing(trial.name, time[rows], theta, torque, rotation[rows], stance, onset, share, quality, errors)


def residual_of(poses: Poses) -> float:
    """RMS distance [m] of the markers from their rigid body, over the frames in which they were seen."""
    return float(np.sqrt(np.nanmean(poses.residual**2))) if np.isfinite(poses.residual).any() else float("nan")


def placement_of(
    time: Array, foot: Poses, calibration: StaticCalibration, centre: Array, stance: Stance
) -> tuple[float, float]:
    """Where the ankle is [m], forward and to the left of the plate's centre at rest, while the foot is flat."""
    phase = (time - stance.heel_strike) / stance.duration
    flat = (phase >= FOOT_FLAT[0]) & (phase <= FOOT_FLAT[1])
    ankle = foot[flat].points(calibration.ankle_centre[None])[:, 0].mean(axis=0) - centre
    return float(ankle[0]), float(ankle[1])


def encoder_check(trial: Trial, time: Array, theta: Array, settings: WalkingAnalysis) -> EncoderCheck | None:
    """The leg's joint encoder beside the angle from markers, where the trial has one."""
    if "theta" not in trial.samples.columns:
        return None
    encoder_time, encoder = trial.signals("theta")
    return compare_encoder(time, theta, encoder_time, encoder, settings.low_pass)


@dataclass(frozen=True)
class PlateReading:
    """Wrench in the plate's axes, without its zero, at the plate's own stamps `time` (k,) [s]."""

    time: Array
    wrench: Wrench

    def at(self, marker_time: Array, lag: float) -> Wrench:
        """The wrench at the marker frames (n,) [s] of a plate that is `lag` [s] late."""
        return at_marker_times(self.time, self.wrench, marker_time, lag)


def plate_reading(trial: Trial, settings: WalkingAnalysis) -> tuple[PlateReading, float | None]:
    """What the plate read, and the vertical force [N] of its zero, None where none was looked for."""
    plate_time, measured = plate_wrench(trial, settings.plate)
    zero = None
    if settings.unloaded_s is not None:
        own = unloaded_zero(plate_time, measured, settings.unloaded_s, settings.largest_zero_n)
        measured, zero = measured - own, float(own.force[0, 2])
    check_range(plate_time, measured.force, plate_axes(plate_corners(trial, settings.plate)), settings.load_on_n)
    return PlateReading(plate_time, measured), zero


def stance_of(time: Array, wrench: Wrench, settings: WalkingAnalysis) -> Stance:
    """The one stance that the vertical force at the frames `time` (n,) [s] shows."""
    limits = settings.load_on_n, settings.load_off_n, settings.shortest_stance_s
    return only_stance(find_stances(time, wrench.force[:, 2], *limits))


def rows_of_stance(time: Array, poses: dict[str, Poses], stance: Stance) -> slice:
    """Frames of the stance and up to 0.1 s either side, in all of which every cluster is seen.

    Raises
    ------
    InputError
        A cluster is hidden within the stance for longer than gaps are bridged.
    """
    for name, pose in poses.items():
        inside = (time >= stance.heel_strike) & (time <= stance.toe_off)
        hidden = np.flatnonzero(inside & ~pose.seen())
        if len(hidden):
            raise InputError(
                f"the {name} markers cannot be followed at {time[hidden[0]]:.3f} s, in {len(hidden)} frames of stance; "
                "fill the gap in Nexus, raise longest_gap_s, or exclude the trial"
            )
    seen = np.all([pose.seen() for pose in poses.values()], axis=0)
    first = int(np.searchsorted(time, stance.heel_strike))
    last = int(np.searchsorted(time, stance.toe_off, side="right")) - 1
    while first > 0 and seen[first - 1] and time[first - 1] >= stance.heel_strike - EDGE_S:
        first -= 1
    while last < len(time) - 1 and seen[last + 1] and time[last + 1] <= stance.toe_off + EDGE_S:
        last += 1
    return slice(first, last + 1)


def check_followed(time: Array, poses: dict[str, Poses], span: tuple[float, float], longest: float) -> None:
    """Refuse a perturbation in whose `span` [s] one of the clusters is bridged for more than `longest` [s].

    Stance is slow enough for bridges, a perturbation is not: what is fitted would be the bridge.
    """
    inside, step = (time >= span[0]) & (time <= span[1]), time[1] - time[0]
    for name, pose in poses.items():
        gap = longest_run(pose.bridged & inside)
        if (gap.stop - gap.start - 0.5) * step > longest:
            raise InputError(
                f"the {name} markers are hidden for {1e3 * (gap.stop - gap.start) * step:.0f} ms from "
                f"{time[gap.start]:.3f} s, while the perturbation is fitted; fill the gap in Nexus, raise "
                "longest_fitted_gap_s, or exclude the trial"
            )


def torque_of(
    time: Array,
    poses: dict[str, Poses],
    wrench: Wrench,
    centre: Array,
    calibration: StaticCalibration,
    inertia: PlateInertia,
    foot: FootSettings | None,
) -> Array:
    """Internal plantarflexion moment (n,) [N*m] from filtered poses and the filtered wrench in the plate's axes."""
    own = inertia.wrench(body_motion(time, poses["platform"], centre))
    reaction, plate_now = in_laboratory(wrench - own, poses["platform"], centre)
    ankle, axis = ankle_in_lab(poses["foot"], poses["shank"], calibration)
    torque = ankle_torque(reaction.force, reaction.moment, plate_now, ankle, axis)
    if foot is None:
        return torque
    carried = FootInertia(foot.mass_kg, np.array(foot.centre_of_mass_m), foot.inertia_kg_m2)
    mass_centre = calibration.ankle_centre + carried.centre_of_mass
    motion = body_motion(time, poses["foot"], mass_centre)
    return torque + foot_torque(motion, motion.point, ankle, axis, carried)
