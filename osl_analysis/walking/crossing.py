"""One crossing of the walkway: from markers and plate to ankle angle and torque, with events and quality."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.measured import check_measured
from osl_analysis.plate_surface import furthest_outside
from osl_analysis.signals import longest_run, sampling_rate
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.bodies import (
    SEGMENTS,
    BodyMotion,
    Poses,
    StaticCalibration,
    ankle_angle,
    ankle_in_lab,
    body_motion,
    exchanged_labels,
    filtered_poses,
    foot_torque,
    gap_duration,
    reference_positions,
    segment_poses,
)
from osl_analysis.walking.plate import (
    Load,
    PlateInertia,
    PlateModel,
    PlateWrench,
    Stance,
    WrenchAtFrames,
    ankle_torque,
    check_plate,
    check_type_on_platform,
    find_stances,
    in_laboratory,
    load_on_foot,
    only_stance,
    recorded_corners,
    zeroed_wrench,
)
from osl_analysis.walking.platform import (
    ALONE,
    Alignment,
    PlatformModel,
    PlatformTemplate,
    PlatformTrack,
    find_onset,
    inertial_motion,
    jackknife_rows,
    rotation_from_rest,
    track_about,
)
from osl_analysis.walking.settings import CrossingSettings, Timing
from osl_analysis.walking.setup import (
    EncoderCheck,
    check_heading,
    check_push,
    check_translation,
    check_vertical,
    encoder_check,
    platform_turn,
)


def check_onset(onset: float | None, stance: Stance, perturbed: bool, timing: Timing) -> None:
    """Refuse an onset [s] that disagrees with what the sheet says, or whose baseline or window leave the stance."""
    if (onset is not None) != perturbed:
        motion = "does not turn" if onset is None else f"turns at {onset:.3f} s"
        raise InputError(
            f"the platform {motion} but the sheet says perturbed = {str(perturbed).lower()}; correct the sheet, "
            "perturbation_deg or the platform markers, or exclude the trial"
        )
    if onset is None:
        return
    span = f"stance {stance.heel_strike:.3f}-{stance.toe_off:.3f} s"
    if not stance.heel_strike < onset < stance.toe_off:
        raise InputError(f"the perturbation starts at {onset:.3f} s, outside {span}; exclude the trial")
    first, last = onset - timing.lead, onset + timing.window
    if first < stance.heel_strike or last > stance.toe_off:
        raise InputError(
            f"baseline and window, {first:.3f}-{last:.3f} s, leave {span}; shorten window_s, baseline_s or guard_s, or "
            "exclude the trial"
        )


EDGE_S = 0.1  # Length [s] of the recording before and after a stance that the low-pass needs, where it is available


def rows_of_stance(time: Array, poses: Mapping[str, Poses], stance: Stance) -> slice:
    """Frames of the stance and up to 0.1 s before and after it. Every cluster is seen in all of these frames."""
    inside = (time >= stance.heel_strike) & (time <= stance.toe_off)
    for name, pose in poses.items():
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


def check_gaps(name: str, time: Array, poses: Poses, window: tuple[float, float], longest: float) -> None:
    """Refuse a cluster that is interpolated for more than `longest` [s] within the fitted `window` [s]: Eq. 15 would be
    fitted to the interpolation."""
    inside = (time >= window[0]) & (time <= window[1])
    gap = longest_run(poses.bridged & inside)
    if gap_duration(time, gap) > longest:
        hidden = (gap.stop - gap.start) * (time[1] - time[0])
        raise InputError(
            f"the {name} markers are hidden for {1e3 * hidden:.0f} ms from {time[gap.start]:.3f} s, while the "
            f"perturbation is fitted, expected {1e3 * longest:g} ms or less; fill the gap in Nexus, raise "
            "longest_fitted_gap_s, or exclude the trial"
        )


FEWEST_SAMPLES = 6  # Samples that a spline of fifth degree needs


@dataclass(frozen=True)
class CrossingQuality:
    """Numbers that show the quality of a crossing."""

    residuals: Mapping[str, float]  # RMS distance [m], in stance, of each cluster's markers from their rigid body
    zero: float | None  # vertical force [N] of the plate before the step, which was removed; None if none was
    placement: tuple[float, float]  # of the ankle [m], forward and left of the plate's centre, while the foot is flat
    encoder: EncoderCheck | None  # comparison with the leg's own encoder; None without a column theta
    outside: float = 0.0  # largest distance [m] by which a foot marker lies outside the plate while the foot is flat


@dataclass(frozen=True)
class Crossing:
    """Ankle angle and torque of one crossing, n samples at the marker rate."""

    name: str
    time: Array
    theta: Array  # joint angle (n,) [rad]
    torque: Array  # internal plantarflexion moment (n,) [N*m]
    platform: Array  # rotation (n,) [rad] of the platform, not filtered
    stance: Stance
    onset: float | None  # of the perturbation [s]; None without one
    bridged: float  # fraction of the frames in stance in which a hidden cluster was interpolated
    quality: CrossingQuality
    plate_errors: Array  # changes (m, n) [N*m] of the torque without the i-th of m plate trials; m = 0 with one
    load: Load | None = None  # ground reaction on the foot; None if it is not known
    turn: float | None = None  # largest [rad] of the platform about the ankle in the window, toes up; None: unknown
    body_mass: float | None = None  # [kg]; None if nobody states it

    def __post_init__(self) -> None:
        for signal in ("time", "theta", "torque", "plate_errors"):
            check_measured(f"trial {self.name}: {signal}", getattr(self, signal))
        if len(self.time) < FEWEST_SAMPLES or not (np.diff(self.time) > 0).all():
            raise InputError(
                f"trial {self.name}: {len(self.time)} samples, expected {FEWEST_SAMPLES} or more, each later than the "
                "one before; exclude the trial"
            )
        if not self.stance.duration > 0:
            raise InputError(f"trial {self.name}: stance lasts {self.stance.duration:g} s; exclude the trial")

    @property
    def sign(self) -> int:
        """-1 if the platform turned the toes down, else 1."""
        return -1 if self.turn is not None and self.turn < 0 else 1


@dataclass(frozen=True)
class RefusedCrossing:
    """A crossing that cannot be analysed, whether the sheet says that it is perturbed, and why it is refused."""

    name: str
    perturbed: bool
    reason: str


@dataclass(frozen=True)
class FilteredCrossing:
    """A crossing through the low-pass, in the n frames of stance. A crossing asks for its torque with each of some
    fifteen models, whose scatter is the torque's error: what these do not change is computed once."""

    rows: slice
    poses: Mapping[str, Poses]  # filtered poses by segment, in these rows
    plate: WrenchAtFrames  # the plate's wrench at all frames, not filtered
    track: PlatformTrack  # the platform's own coordinates in the run of seen frames about the first row
    centre: Array  # the plate's centre (3,) [m] at rest
    calibration: StaticCalibration
    settings: CrossingSettings

    @property
    def time(self) -> Array:
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
        motion = body_motion(self.time, self.poses["foot"], self.calibration.ankle_centre + foot.centre_of_mass_m)
        return foot_torque(motion, *self.ankle, foot.mass_kg, foot.inertia_kg_m2)

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
        """Ground reaction on the foot, and the plate's centre (n, 3) [m], about which its moment acts. `motion` is the
        plate's, for its own `inertia`."""
        return in_laboratory(wrench - inertia.wrench(motion), self.poses["platform"], self.centre)

    def torque(self, wrench: PlateWrench, inertia: PlateInertia, motion: BodyMotion) -> Array:
        """Internal plantarflexion moment (n,) [N*m], from the same as `reaction`."""
        reaction, centre_now = self.reaction(wrench, inertia, motion)
        return ankle_torque(reaction, centre_now, *self.ankle) + self.own_torque


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
    """Angle and torque of a crossing, from markers and wrench through the same low-pass at the same rate. `perturbed`
    comes from the sheet and is checked against the platform's motion. `platform` is what the platform's motions share;
    without it each crossing has its own motion and onset. Refused with the trial's name."""
    try:
        recorded = RecordedCrossing.of(trial, calibration, plate.delay, settings)
        onset = recorded.onset(perturbed, platform)
        return recorded.analysed(plate, platform, onset)
    except InputError as error:
        text = "; ".join(filter(None, [str(error), exchanged_labels(trial, calibration, settings)]))
        raise InputError(text if trial.name in text else f"trial {trial.name}: {text}") from error


@dataclass(frozen=True)
class RecordedCrossing:
    """A crossing before it is filtered, at the marker frames (k,) [s]."""

    trial: Trial
    calibration: StaticCalibration
    settings: CrossingSettings
    time: Array
    poses: Mapping[str, Poses]  # by segment, in all frames
    plate: WrenchAtFrames  # the plate's wrench without its zero
    zero: float | None  # the zero's vertical force [N]; None if none was removed
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
        stance = only_stance(find_stances(time, force[:, 2], *limits))
        check_plate(trial, settings.plate, stance, force[:, 2])
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
        without_crossings = [  # the shape changes the motion of those alone that follow it
            torque * 0
            if follows is None
            else crossing.torque(wrench, model.inertia, crossing.motion(other, follows)) - torque
            for other in platform.leave_out
        ]
        phase = (time - self.stance.heel_strike) / self.stance.duration
        check_heading(phase, poses["shank"].position - ankle, axis)
        if onset is None:
            check_push(phase, torque)
        inside = (time >= self.stance.heel_strike) & (time <= self.stance.toe_off)
        bridged = np.any([pose.bridged for pose in poses.values()], axis=0)
        left = {name: pose.residual[inside & np.isfinite(pose.residual)] for name, pose in poses.items()}
        residuals = {name: float(np.sqrt(np.mean(r**2))) if len(r) else float("nan") for name, r in left.items()}
        placement, outside = self.foot_on_plate(phase, poses["foot"])
        encoder = encoder_check(self.trial, time, crossing.theta, self.settings.low_pass)
        window = None if onset is None else (onset, onset + self.settings.window_s)
        return Crossing(
            name=self.trial.name,
            time=time,
            theta=crossing.theta,
            torque=torque,
            platform=rotation_from_rest(self.poses["platform"])[crossing.rows],
            stance=self.stance,
            onset=onset,
            bridged=float(np.mean(bridged[inside])),
            quality=CrossingQuality(residuals, self.zero, placement, encoder, outside),
            plate_errors=np.reshape(jackknife_rows(without_plate, without_crossings), (-1, len(torque))),
            load=load,
            turn=None if window is None else platform_turn(time, poses["platform"], axis, window),
        )

    def filtered_crossing(self) -> FilteredCrossing:
        """The crossing through the low-pass, over its stance."""
        settings, name = self.settings, self.trial.name
        rows, rate = rows_of_stance(self.time, self.poses, self.stance), sampling_rate(self.time)
        poses = {}
        for segment in SEGMENTS:
            labels, cluster = getattr(settings.markers, segment), getattr(self.calibration, segment)
            reference = reference_positions(cluster, labels, name)
            poses[segment] = filtered_poses(self.poses[segment][rows], reference, settings.low_pass, rate)
        begins, moving = float(self.time[rows][0]), self.poses["platform"]
        track = track_about(name, self.time, moving, self.calibration, settings, begins)
        centre = recorded_corners(self.trial, settings.plate).mean(axis=0)
        return FilteredCrossing(rows, poses, self.plate, track, centre, self.calibration, settings)

    def foot_on_plate(self, phase: Array, foot: Poses) -> tuple[tuple[float, float], float]:
        """Position [m] of the ankle, forward and left of the plate's centre, while the foot is flat, and the largest
        distance [m] by which a foot marker then lies outside the plate; at phases of stance (n,)."""
        flat = foot[(phase >= FOOT_FLAT[0]) & (phase <= FOOT_FLAT[1])]
        corners = recorded_corners(self.trial, self.settings.plate)
        ankle = flat.point(self.calibration.ankle_centre).mean(axis=0) - corners.mean(axis=0)
        reference = reference_positions(self.calibration.foot, self.settings.markers.foot, self.trial.name)
        return (float(ankle[0]), float(ankle[1])), furthest_outside(flat.points(reference).reshape(-1, 3), corners)
