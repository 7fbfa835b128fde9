"""One crossing of the walkway: from markers and plate to ankle angle and torque, with events and quality."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.measured import check_measured
from osl_analysis.plate_surface import furthest_outside
from osl_analysis.signals import longest_run, runs, sampling_rate
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
    gap_duration,
    moment_of_foot,
    reference_positions,
    segment_poses,
)
from osl_analysis.walking.plate import (
    Load,
    PlateModel,
    Stance,
    ankle_torque,
    check_plate,
    check_type_on_platform,
    find_stances,
    load_on_foot,
    only_stance,
    recorded_corners,
    zeroed_wrench,
)
from osl_analysis.walking.platform import (
    ALONE,
    PlatformModel,
    PlatformTemplate,
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
        if len(self.time) < 6 or not (np.diff(self.time) > 0).all():  # a spline of fifth degree needs as many
            raise InputError(
                f"trial {self.name}: {len(self.time)} samples, expected 6 or more, each later than the one before; "
                "exclude the trial"
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
        return crossing_from_trial(trial, calibration, plate, perturbed, settings, platform)
    except InputError as error:
        text = "; ".join(filter(None, [str(error), exchanged_labels(trial, calibration, settings)]))
        raise InputError(text if trial.name in text else f"trial {trial.name}: {text}") from error


def crossing_from_trial(
    trial: Trial,
    calibration: StaticCalibration,
    plate: PlateModel,
    perturbed: bool,
    settings: CrossingSettings,
    platform: PlatformModel,
) -> Crossing:
    """The crossing, refused without the trial's name."""
    name, reference, recorded = trial.name, {}, {}
    for segment in SEGMENTS:
        labels, cluster = getattr(settings.markers, segment), getattr(calibration, segment)
        frames, recorded[segment] = segment_poses(trial, labels, cluster, settings)
        reference[segment] = reference_positions(cluster, labels, name)
    (read, zero), rate, low_pass = zeroed_wrench(trial, frames, settings), sampling_rate(frames), settings.low_pass
    force = read(plate.delay)[:, :3]
    check_vertical(force)
    limits = settings.load_on_n, settings.load_off_n, settings.shortest_stance_s
    stance = only_stance(find_stances(frames, force[:, 2], *limits))
    check_plate(trial, settings.plate, stance, force[:, 2])
    onset = onset_of(trial, frames, recorded, stance, perturbed, settings, platform)

    rows = rows_of_stance(frames, recorded, stance)
    time, follows = frames[rows], platform.followed(name)
    poses = {s: filtered_poses(recorded[s][rows], reference[s], low_pass, rate) for s in SEGMENTS}
    theta = ankle_angle(poses["foot"], poses["shank"], calibration.ankle_axis)
    ankle, axis = ankle_in_lab(poses["foot"], poses["shank"], calibration)
    corners = recorded_corners(trial, settings.plate)
    track = track_about(name, frames, recorded["platform"], calibration, settings, float(time[0]))
    first = int(np.searchsorted(track.time, time[0] - 1e-9))
    centre, turned = poses["platform"].point(corners.mean(axis=0)), poses["platform"].rotation

    def motion(template: PlatformTemplate | None) -> BodyMotion:
        """Motion of the plate's centre, by a shape that crossings share if this one follows it."""
        return inertial_motion(track, corners.mean(axis=0), template, follows, slice(first, first + len(time)))

    def wrench_at(delay: float) -> Array:
        return low_pass(read(delay), rate)[rows]

    def reaction(wrench: Array, own: Array) -> Array:
        """Ground reaction (n, 6) on the foot in laboratory axes, about the plate's centre, without the plate's own."""
        parts = (wrench - own).reshape(-1, 2, 3)
        return np.asarray(np.einsum("nij,nkj->nki", turned, parts).reshape(-1, 6))

    def torque_of(wrench: Array, own: Array) -> Array:
        return ankle_torque(reaction(wrench, own), centre, ankle, axis)

    moving, wrench = motion(platform.template), wrench_at(plate.delay)
    on_foot = reaction(wrench, plate.inertia.wrench(moving))
    torque = ankle_torque(on_foot, centre, ankle, axis)
    without_plate = [
        torque_of(wrench_at(other.delay), other.inertia.wrench(moving)) - torque for other in plate.leave_one_out
    ]
    without_crossings = [  # the shape changes the motion of those alone that follow it
        torque * 0 if follows is None else torque_of(wrench, plate.inertia.wrench(motion(other))) - torque
        for other in platform.leave_out
    ]
    if settings.foot is not None:
        point = calibration.ankle_centre + settings.foot.centre_of_mass_m
        of_foot = body_motion(time, poses["foot"], point)
        torque = torque + moment_of_foot(of_foot, ankle, axis, settings.foot.mass_kg, settings.foot.inertia_kg_m2)
    phase = stance.phase(time)
    check_heading(phase, poses["shank"].position - ankle, axis)
    turn = None
    if onset is None:
        check_push(phase, torque)
    else:
        turn = platform_turn(time, poses["platform"], axis, (onset, onset + settings.window_s))
    inside = (time >= stance.heel_strike) & (time <= stance.toe_off)
    left = {segment: pose.residual[inside & np.isfinite(pose.residual)] for segment, pose in poses.items()}
    flat = poses["foot"][(phase >= 0.15) & (phase <= 0.35)]  # before the perturbation
    placed = flat.point(calibration.ankle_centre).mean(axis=0) - corners.mean(axis=0)
    quality = CrossingQuality(
        residuals={s: float(np.sqrt(np.mean(r**2))) if len(r) else float("nan") for s, r in left.items()},
        zero=zero,
        placement=(float(placed[0]), float(placed[1])),
        encoder=encoder_check(trial, time, theta, low_pass),
        outside=furthest_outside(flat.points(reference["foot"]).reshape(-1, 3), corners),
    )
    return Crossing(
        name=name,
        time=time,
        theta=theta,
        torque=torque,
        platform=rotation_from_rest(recorded["platform"])[rows],
        stance=stance,
        onset=onset,
        bridged=float(np.mean(np.any([pose.bridged for pose in poses.values()], axis=0)[inside])),
        quality=quality,
        plate_errors=np.reshape(jackknife_rows(without_plate, without_crossings), (-1, len(torque))),
        load=load_on_foot(on_foot, centre, ankle, axis),
        turn=turn,
    )


def onset_of(
    trial: Trial,
    time: Array,
    poses: Mapping[str, Poses],
    stance: Stance,
    perturbed: bool,
    settings: CrossingSettings,
    platform: PlatformModel,
) -> float | None:
    """Onset [s] of the perturbation, checked against the sheet, the stance, the plate's type and hidden markers."""
    turned = rotation_from_rest(poses["platform"])
    onset = find_onset(time, turned, float(np.deg2rad(settings.perturbation_deg)))
    if onset is None:
        check_translation(time, poses["platform"], stance, 1e-3 * settings.largest_shift_mm)
    else:
        onset = platform.onset(trial.name, onset)
    check_onset(onset, stance, perturbed, settings.timing)
    if onset is None:
        return None
    check_type_on_platform(trial, settings.plate)
    inside = (time >= onset) & (time <= onset + settings.window_s)
    for name in ("foot", "platform"):  # The shank carries the body and moves as in any stance
        gap, longest = longest_run(poses[name].bridged & inside), settings.longest_fitted_gap_s
        if gap_duration(time, gap) > longest:
            hidden = (gap.stop - gap.start) * (time[1] - time[0])
            raise InputError(
                f"the {name} markers are hidden for {1e3 * hidden:.0f} ms from {time[gap.start]:.3f} s, while the "
                f"perturbation is fitted, expected {1e3 * longest:g} ms or less; fill the gap in Nexus, raise "
                "longest_fitted_gap_s, or exclude the trial"
            )
    return onset


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


def rows_of_stance(time: Array, poses: Mapping[str, Poses], stance: Stance) -> slice:
    """Frames of the stance and up to 0.1 s before and after it, for the low-pass. Every cluster is seen in all."""
    inside = (time >= stance.heel_strike) & (time <= stance.toe_off)
    for name, pose in poses.items():
        hidden = np.flatnonzero(inside & ~pose.seen())
        if len(hidden):
            raise InputError(
                f"the {name} markers cannot be followed at {time[hidden[0]]:.3f} s, in {len(hidden)} frames of stance; "
                "fill the gap in Nexus, raise longest_gap_s, or exclude the trial"
            )
    seen = np.all([pose.seen() for pose in poses.values()], axis=0)
    around = next(run for run in runs(seen) if run.start <= np.argmax(inside) < run.stop)
    first = np.searchsorted(time, stance.heel_strike - 0.1)
    last = np.searchsorted(time, stance.toe_off + 0.1, side="right")
    return slice(max(around.start, int(first)), min(around.stop, int(last)))
