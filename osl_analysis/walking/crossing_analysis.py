"""The analysis of one crossing: from markers and plate to angle and torque over stance, with its events."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.plate_surface import furthest_outside
from osl_analysis.signals import sampling_rate
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.ankle import SEGMENTS, StaticCalibration
from osl_analysis.walking.cluster import Mask, Poses, filtered_poses, reference_positions, segment_poses
from osl_analysis.walking.crossing import Crossing, CrossingQuality
from osl_analysis.walking.crossing_torque import FilteredCrossing
from osl_analysis.walking.direction import platform_turn
from osl_analysis.walking.encoder import encoder_check
from osl_analysis.walking.events import Stance, check_onset, find_onset, find_stances, only_stance
from osl_analysis.walking.labels import exchanged_labels
from osl_analysis.walking.load import load_on_foot
from osl_analysis.walking.orientation import check_heading, check_push, check_vertical
from osl_analysis.walking.plate import (
    WrenchAtFrames,
    plate_centre,
    recorded_corners,
    rotation_from_rest,
    zeroed_wrench,
)
from osl_analysis.walking.plate_faults import check_plate, check_type_on_platform
from osl_analysis.walking.plate_model import PlateModel
from osl_analysis.walking.platform_jackknife import jackknife_rows
from osl_analysis.walking.platform_model import ALONE, PlatformModel, track_about
from osl_analysis.walking.settings import CrossingSettings
from osl_analysis.walking.translation import check_translation
from osl_analysis.walking.visible_frames import check_gaps, rms_residual, rows_of_stance

PERTURBED_SEGMENTS = ("foot", "platform")
"""Segments that a perturbation moves. The shank carries the body and moves as in any stance."""
FOOT_FLAT = (0.15, 0.35)
"""Phases of stance, before the perturbation, over which the foot's place on the plate is averaged."""


def analyse_crossing(
    trial: Trial,
    calibration: StaticCalibration,
    plate: PlateModel,
    perturbed: bool,
    settings: CrossingSettings,
    platform: PlatformModel = ALONE,
) -> Crossing:
    """Angle and torque of a crossing. `perturbed` comes from the sheet and is checked against the platform's motion.

    `platform` is what the platform's motions share; without it each crossing has its own motion and onset.

    Markers and wrench first pass the same low-pass at the same rate. Angle and torque are not filtered again.

    Raises
    ------
    InputError
        No or several stances, a perturbation that disagrees with the sheet or leaves the stance, a plate out of range,
        or a cluster that is hidden in stance. Names the trial.
    """
    try:
        recorded = RecordedCrossing.of(trial, calibration, plate.delay, settings)
        onset = recorded.onset(perturbed, platform)
        return recorded.analysed(plate, platform, onset)
    except InputError as error:
        text = "; ".join(filter(None, [str(error), exchanged_labels(trial, calibration, settings)]))
        raise InputError(text if trial.name in text else f"trial {trial.name}: {text}") from error


@dataclass(frozen=True)
class RecordedCrossing:
    """A crossing before it is filtered.

    trial: the ingested trial.
    calibration: the static calibration.
    settings: choices of the analysis.
    time: the marker frames (k,) [s].
    poses: poses by segment, in all frames.
    plate: the plate's wrench at the marker frames, without its zero.
    zero: vertical force [N] of the zero; None if no zero was removed.
    stance: heel strike and toe-off.
    """

    trial: Trial
    calibration: StaticCalibration
    settings: CrossingSettings
    time: Array
    poses: Mapping[str, Poses]
    plate: WrenchAtFrames
    zero: float | None
    stance: Stance

    @classmethod
    def of(
        cls, trial: Trial, calibration: StaticCalibration, lag: float, settings: CrossingSettings
    ) -> "RecordedCrossing":
        """Poses, wrench and stance of a trial whose plate is late by `lag` [s]."""
        poses = {}
        for name in SEGMENTS:
            labels, cluster = getattr(settings.markers, name), getattr(calibration, name)
            time, poses[name] = segment_poses(trial, labels, cluster, settings)
        plate, zero = zeroed_wrench(trial, settings)
        limits = settings.load_on_n, settings.load_off_n, settings.shortest_stance_s
        at_frames = plate.at_frames(time)
        force = at_frames.late_by(lag).force
        check_vertical(force)
        vertical = force[:, 2]
        stance = only_stance(find_stances(time, vertical, *limits))
        check_plate(trial, settings.plate, stance, vertical)
        return cls(trial, calibration, settings, time, poses, at_frames, zero, stance)

    def onset(self, perturbed: bool, platform: PlatformModel) -> float | None:
        """Onset [s] of the perturbation, checked against the sheet, the stance and hidden markers."""
        settings = self.settings
        threshold = float(np.deg2rad(settings.perturbation_deg))
        onset = find_onset(self.time, rotation_from_rest(self.poses["platform"]), threshold)
        if onset is None:
            check_translation(self.time, self.poses["platform"], self.stance, 1e-3 * settings.largest_shift_mm)
        onset = None if onset is None else platform.onset(self.trial.name, onset)
        check_onset(onset, self.stance, perturbed, settings.timing)
        if onset is not None:
            check_type_on_platform(self.trial, settings.plate)
            window = onset, onset + settings.window_s
            for name in PERTURBED_SEGMENTS:
                check_gaps(name, self.time, self.poses[name], window, settings.longest_fitted_gap_s)
        return onset

    def analysed(self, model: PlateModel, platform: PlatformModel, onset: float | None) -> Crossing:
        """Filtered angle and torque over stance, with their quality."""
        crossing = self.filtered_crossing()
        time, poses, (ankle, axis) = crossing.time, crossing.poses, crossing.ankle
        follows = platform.followed(self.trial.name)
        motion, wrench = crossing.motion(platform.template, follows), crossing.wrench(model.delay)
        load = load_on_foot(*crossing.reaction(wrench, model.inertia, motion), ankle, axis)
        torque = crossing.torque(wrench, model.inertia, motion)
        without_plate = [
            crossing.torque(crossing.wrench(other.delay), other.inertia, motion) - torque
            for other in model.leave_one_out
        ]
        without_crossings = [
            crossing.torque(wrench, model.inertia, crossing.motion(other, follows)) - torque
            for other in platform.leave_out
        ]
        phase = (time - self.stance.heel_strike) / self.stance.duration
        check_heading(phase, poses["shank"].position - ankle, axis)
        if onset is None:
            check_push(phase, torque)
        inside = (time >= self.stance.heel_strike) & (time <= self.stance.toe_off)
        bridged = np.any([pose.bridged for pose in poses.values()], axis=0)
        quality = CrossingQuality(
            {name: rms_residual(pose[inside]) for name, pose in poses.items()},
            self.zero,
            self.placement(time, poses["foot"]),
            encoder_check(self.trial, time, crossing.theta, self.settings.low_pass),
            self.outside(time, poses["foot"]),
        )
        return Crossing(
            name=self.trial.name,
            time=time,
            theta=crossing.theta,
            torque=torque,
            platform=rotation_from_rest(self.poses["platform"])[crossing.rows],
            stance=self.stance,
            onset=onset,
            bridged=float(np.mean(bridged[inside])),
            quality=quality,
            plate_errors=np.reshape(jackknife_rows(without_plate, without_crossings), (-1, len(torque))),
            load=load,
            turn=None if onset is None else self.turn(crossing, onset),
        )

    def turn(self, crossing: FilteredCrossing, onset: float) -> float:
        """Turn [rad] of the platform in the window, toes up positive."""
        window = onset, onset + self.settings.window_s
        return platform_turn(crossing.time, crossing.poses["platform"], crossing.ankle[1], window)

    def filtered_crossing(self) -> FilteredCrossing:
        """The crossing through the low-pass, over its stance."""
        rows = rows_of_stance(self.time, self.poses, self.stance)
        poses, begins = {name: self.filtered(name, rows) for name in SEGMENTS}, float(self.time[rows][0])
        centre = plate_centre(self.trial, self.settings.plate)
        seen = self.trial.name, self.time, self.poses["platform"]
        track = track_about(*seen, self.calibration, self.settings, begins)
        return FilteredCrossing(rows, poses, self.plate, track, centre, self.calibration, self.settings)

    def filtered(self, name: str, rows: slice) -> Poses:
        """Filtered poses of a segment in some rows."""
        cluster, labels = getattr(self.calibration, name), getattr(self.settings.markers, name)
        reference = reference_positions(cluster, labels, self.trial.name)
        return filtered_poses(self.poses[name][rows], reference, self.settings.low_pass, sampling_rate(self.time))

    def outside(self, time: Array, foot: Poses) -> float:
        """Largest distance [m] by which a foot marker lies outside the plate while the foot is flat."""
        reference = reference_positions(self.calibration.foot, self.settings.markers.foot, self.trial.name)
        markers = foot[self.flat(time)].points(reference).reshape(-1, 3)
        return furthest_outside(markers, recorded_corners(self.trial, self.settings.plate))

    def flat(self, time: Array) -> Mask:
        """Samples (n,) in which the foot is flat on the plate."""
        phase = (time - self.stance.heel_strike) / self.stance.duration
        return np.asarray((phase >= FOOT_FLAT[0]) & (phase <= FOOT_FLAT[1]))

    def placement(self, time: Array, foot: Poses) -> tuple[float, float]:
        """Position [m] of the ankle, forward and to the left of the plate's centre, while the foot is flat."""
        centre = plate_centre(self.trial, self.settings.plate)
        ankle = foot[self.flat(time)].point(self.calibration.ankle_centre).mean(axis=0) - centre
        return float(ankle[0]), float(ankle[1])
