"""One crossing of the walkway: from markers and plate to ankle angle and torque, with events and
quality; and checks of the laboratory's set-up: axes, side, encoder, direction and shift of the
platform, body mass."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
import scipy

from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass, longest_run, runs, sampling_rate
from osl_analysis.signals.grid import GapLimits, uniform_signals
from osl_analysis.trial import AXES, Array, Trial, check_measured, furthest_outside, plate_columns
from osl_analysis.walking import bodies, plate, platform
from osl_analysis.walking.bodies import SEGMENTS, BodyMotion, Kept, Mask, Poses, StaticCalibration
from osl_analysis.walking.plate import PlateModel, Stance
from osl_analysis.walking.platform import ALONE, PlatformModel, PlatformTemplate
from osl_analysis.walking.settings import CrossingSettings

# Names of the directions in sheet and tables: toes up (dorsiflexion), and toes down
UP, DOWN = "up", "down"


QUALITY_COLUMNS = (
    "foot_forward_m", "foot_left_m", "foot_outside_m", "foot_residual_mm", "platform_residual_mm",
    "shank_residual_mm",
    "plate_zero_N", "plate_height_m", "plate_ringing_hz", "plate_unexplained", "pressure_ahead_m",
    "pressure_beside_m",
    "pressure_outside_m", "filled_share", "filled_fitted", "encoder_offset_deg", "encoder_delay_ms",
    "encoder_rms_deg",
    "shoe_compliance",
)  # fmt: skip
"""Columns of `walking_crossings.csv` that show the quality of one crossing; the dictionary says
what each is."""
LABORATORY_ERRORS = {
    "corners_height": ("corners of the plate, or ORIGIN, too high", 10.0, "mm"),
    "corners_forward": ("corners too far forward", 10.0, "mm"),
    "moments": ("moment channels too large", 1.0, "%"),
    "forces": ("force channels too large", 1.0, "%"),
    "pitch": (
        "cameras pitched, so that all markers turn toes down about the laboratory's origin",
        1.0,
        "deg",
    ),
    "plate_lag": ("plate later than it is corrected for", 1.0, "ms"),
    "plate_inertia": ("the plate's own wrench removed too much", 1.0, "%"),
    "skin": ("shank markers that slide on the skin with the ankle's angle", 5.0, "%"),
    "shoe": ("foot that yields in the shoe", 60.0, "N*m/deg"),
}
LOG_ERRORS = {
    "torque_lag": ("torque later than the angle", 1.0, "ms"),
    "torque": ("torque too large", 1.0, "%"),
}
"""Errors of a laboratory, or of a boot's or leg's log, that the data do not show: the name of the
stated uncertainty, with size and unit. Rows of `Crossing.lab_errors` have their order. The last two
of the laboratory change no torque: their effect follows from the fit."""


@dataclass(frozen=True)
class Crossing:
    """Ankle angle and torque of one crossing, n samples at the marker rate."""

    name: str
    time: Kept
    theta: Kept  # joint angle (n,) [rad]
    torque: Kept  # internal plantarflexion moment (n,) [N*m]
    platform: Kept | None  # rotation (n,) [rad] of the platform, not filtered; None without one
    stance: Stance
    onset: float | None  # of the perturbation [s]; None without one
    bridged: float  # fraction of the frames in stance in which a hidden cluster was interpolated
    plate_errors: Kept = field(default_factory=lambda: np.zeros((0, 0)))
    """Changes (m, n) [N*m] of the torque without the i-th of m plate trials; m = 0 with one."""
    lab_errors: Kept = field(default_factory=lambda: np.zeros((0, 0)))
    """The same (e, n) [N*m] by each of `LABORATORY_ERRORS`, or of `LOG_ERRORS`."""
    # of `QUALITY_COLUMNS`, those that are known
    quality: dict[str, float | None] = field(default_factory=dict)
    load: Kept | None = None  # `load_on_foot` (3, n); None if it is not known
    # largest turn [rad] of the platform about the ankle in the window, toes up; None: unseen
    turn: float | None = None
    # Without a turning platform: the range of the ankle's angle, with the sign of the perturbation.
    body_mass: float | None = None  # [kg]; None if nobody states it

    def __post_init__(self) -> None:
        for errors in ("plate_errors", "lab_errors"):
            if not getattr(self, errors).size:
                object.__setattr__(self, errors, np.zeros((0, len(self.time))))
        for signal in ("time", "theta", "torque", "plate_errors"):
            check_measured(f"trial {self.name}: {signal}", getattr(self, signal))
        # a quintic spline needs six samples
        if len(self.time) < 6 or not (np.diff(self.time) > 0).all():
            raise InputError(
                f"trial {self.name}: {len(self.time)} samples, expected 6 or more, each later than"
                " the one before; exclude the trial"
            )
        if not self.stance.duration > 0:
            raise InputError(
                f"trial {self.name}: stance lasts {self.stance.duration:g} s; exclude the trial"
            )

    @property
    def sign(self) -> int:
        """-1 if the perturbation turned the toes down, else 1."""
        return -1 if self.turn is not None and self.turn < 0 else 1

    @property
    def direction(self) -> str | None:
        return None if self.turn is None else UP if self.turn > 0 else DOWN


@dataclass(frozen=True)
class RefusedCrossing:
    """A crossing that cannot be analysed, whether the sheet says that it is perturbed, and why it
    is refused."""

    name: str
    perturbed: bool
    reason: str


@dataclass(frozen=True)
class Passage:
    """The recording of a crossing by markers and plate, in all frames and in the n `rows`: stance,
    and up to 0.1 s before and after it for the low-pass."""

    frames: Array  # time (k,) [s] of all frames
    recorded: dict[str, Poses]  # of foot, shank and platform in all frames, not filtered
    # wrench (k, 6) of the plate minus its zero, read a lag [s] later
    read: Callable[[float], Array]
    zero: float | None  # vertical force [N] of the plate's zero
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
        return np.asarray(
            (self.time >= self.stance.heel_strike) & (self.time <= self.stance.toe_off)
        )


def recorded_passage(
    trial: Trial,
    calibration: StaticCalibration,
    lag: float,
    perturbed: bool,
    settings: CrossingSettings,
    shared: PlatformModel,
) -> Passage:
    """Poses, stance and onset of a crossing; its plate lags behind the markers by `lag` [s]."""
    reference, recorded = {}, {}
    for segment, labels in followed_segments(settings).items():
        frames, recorded[segment] = bodies.segment_poses(trial, labels, calibration, settings)
        reference[segment] = calibration.positions(labels, trial.name)
    read, zero = plate.zeroed_wrench(trial, frames, settings)
    force = read(lag)[:, :3]
    check_vertical(force)
    several = (
        "check the plate's number, zero and load thresholds, cut the recording to one crossing"
    )
    stance = only_stance(frames, force[:, 2], settings, "on the plate", several)
    plate.check_plate(trial, settings.plate, stance, force[:, 2])
    corners = plate.recorded_corners(trial, settings.plate)
    if "platform" not in recorded:  # the plate below a belt rests
        resting = bodies.cluster_poses(corners, np.tile(corners, (len(frames), 1, 1)))
        reference["platform"], recorded["platform"] = corners, resting
    onset = onset_of(trial, frames, recorded, stance, perturbed, settings, shared)
    inside = (frames >= stance.heel_strike) & (frames <= stance.toe_off)
    for segment, pose in recorded.items():
        apart = 1e3 * float(
            np.median(np.r_[0.0, pose.residual[inside & np.isfinite(pose.residual)]])
        )
        if apart > settings.largest_residual_mm:
            raise InputError(
                f"the {segment} markers stand {apart:.0f} mm (RMS) otherwise than in the static"
                f" trial throughout stance, expected {settings.largest_residual_mm:g} mm or less:"
                " they were put on again, or carry other labels; record a static trial after the"
                " change and name it in the column static, correct the labels, or exclude the"
                " trial"
            )
        if len(lost := np.flatnonzero(inside & ~pose.seen())):
            raise InputError(
                f"the {segment} markers cannot be followed at {frames[lost[0]]:.3f} s, in"
                f" {len(lost)} frames of stance{pose.by_filling(lost)}; correct exchanged labels in"
                " Nexus, raise longest_gap_s, or exclude the trial"
            )
    seen = np.all([pose.seen() for pose in recorded.values()], axis=0)
    near = seen & (frames >= stance.heel_strike - 0.1) & (frames <= stance.toe_off + 0.1)
    rows, rate = (
        next(run for run in runs(near) if run.start <= np.argmax(inside) < run.stop),
        sampling_rate(frames),
    )
    poses = {
        segment: bodies.cluster_poses(
            cluster, settings.low_pass(recorded[segment][rows].points(cluster), rate)
        )
        for segment, cluster in reference.items()
    }
    return Passage(frames, recorded, read, zero, corners, stance, onset, rows, poses)


def followed_segments(settings: CrossingSettings) -> dict[str, tuple[str, ...]]:
    return {
        segment: labels for segment in SEGMENTS if (labels := getattr(settings.markers, segment))
    }


@dataclass(frozen=True)
class Ankle:
    """The ankle in n frames: angle [rad], centre [m] and axis to the left, the means of foot's and
    shank's."""

    theta: Array  # (n,)
    centre: Array  # (n, 3)
    axis: Array  # (n, 3), unit vectors

    @property
    def forward(self) -> Array:
        """Level directions (n, 3) in which the foot points."""
        return np.cross(self.axis, [0.0, 0.0, 1.0])


def ankle_torques(
    name: str,
    passage: Passage,
    ankle: Ankle,
    unloaded: PlateModel,
    shared: PlatformModel,
    calibration: StaticCalibration,
    settings: CrossingSettings,
) -> tuple[Array, Array, Array, Array, Array]:
    """Ground reaction (n, 6) on the foot, in laboratory axes, minus the plate's own wrench; the
    plate's centre (n, 3), about which it is; the ankle's torque (n,) [N*m]; its changes (m, n)
    without each plate trial, and without each group of crossings in the shared shape, as rows of
    one jackknife; and (7, n) by the first `LABORATORY_ERRORS`."""
    time, plates, follows = passage.time, passage.poses["platform"], shared.followed(name)
    middle, track = passage.corners.mean(axis=0), None
    if settings.markers.platform:
        poses = passage.recorded["platform"]
        track = platform.track_about(
            name, passage.frames, poses, calibration, settings, float(time[0])
        )
    turned, centre = plates.rotation, plates.point(middle)

    def motion(template: PlatformTemplate | None) -> BodyMotion:
        """Motion of the plate's centre, by the shared shape if this crossing follows it."""
        if track is None:
            return bodies.body_motion(time, plates, middle)
        first = int(np.searchsorted(track.time, time[0] - 1e-9))
        return platform.inertial_motion(
            track, middle, template, follows, slice(first, first + len(time))
        )

    @cache
    def read(lag: float) -> Array:
        return settings.low_pass(passage.read(lag), sampling_rate(passage.frames))[passage.rows]

    def reaction(model: PlateModel, moving: BodyMotion) -> Array:
        parts = (
            read(model.lag or 0.0) - plate.inertial_columns(moving) @ model.parameters
        ).reshape(-1, 2, 3)
        return np.asarray((parts @ np.swapaxes(turned, 1, 2)).reshape(-1, 6))

    def of_plate(model: PlateModel, moving: BodyMotion) -> Array:
        return plate.ankle_torque(reaction(model, moving), centre, ankle.centre, ankle.axis)

    moving = motion(shared.template)
    on_foot = reaction(unloaded, moving)
    torque = plate.ankle_torque(on_foot, centre, ankle.centre, ankle.axis)
    without_trials = [of_plate(other, moving) - torque for other in unloaded.leave_one_out]
    without_crossings = [  # the shape only changes crossings that follow it
        torque * 0 if follows is None else of_plate(unloaded, motion(other)) - torque
        for other in shared.leave_out
    ]
    jackknife = np.reshape(
        platform.jackknife_rows(without_trials, without_crossings), (-1, len(torque))
    )
    ahead = ankle.forward.mean(axis=0)
    wrong = [
        plate.ankle_torque(on_foot * np.repeat(gains, 3), centre + moved, ankle.centre, ankle.axis)
        for gains, moved in (
            ((1.0, 1.0), 0.01 * turned[:, :, 2]), ((1.0, 1.0), 0.01 * turned @ ahead),
            ((1.0, 1.01), 0.0), ((1.01, 1.0), 0.0),
        )
    ]  # fmt: skip
    pitch = scipy.spatial.transform.Rotation.from_rotvec(
        np.deg2rad(1.0) * ankle.axis.mean(axis=0)
    ).as_matrix()
    seen_force = np.einsum(
        "ij,njk,lk,nml,nqm->nqi", pitch, turned, pitch, turned, on_foot.reshape(-1, 2, 3)
    )
    seen_centre = plates.point(pitch.T @ middle) @ pitch.T
    pitched = seen_force.reshape(-1, 6), seen_centre, ankle.centre @ pitch.T, ankle.axis @ pitch.T
    later = of_plate(replace(unloaded, lags=((unloaded.lag or 0.0) + 1e-3,)), moving)
    more = of_plate(replace(unloaded, parameters=1.01 * unloaded.parameters), moving)
    of_lab = [
        *(each - torque for each in (*wrong, plate.ankle_torque(*pitched))),
        torque - later,
        more - torque,
    ]
    return on_foot, centre, torque, jackknife, np.array(of_lab)


def quality_of(
    passage: Passage,
    ankle: Ankle,
    load: Array,
    unloaded: PlateModel,
    calibration: StaticCalibration,
    settings: CrossingSettings,
) -> dict[str, float | None]:
    """Columns of `QUALITY_COLUMNS` but the encoder's, from the load (3, n) on the foot. Filled
    markers are given as two shares of frames in which a cluster's marker was filled before the
    export, which hides the gap: in stance, and from baseline to the end of the window. The latter
    counts only poses that rest on the filling. None if no cluster tells."""
    phase, segments = passage.stance.phase(passage.time), followed_segments(settings)
    flat = (phase >= 0.15) & (phase <= 0.35)  # before a perturbation
    foot = passage.poses["foot"][flat]
    placed = foot.point(calibration.ankle_centre).mean(axis=0) - passage.corners.mean(axis=0)
    to_pressure = load[2:].T * ankle.forward + load[1:2].T * ankle.axis  # (n, 3) from the ankle
    pressed = to_pressure[flat].mean(axis=0)
    markers = foot.points(calibration.positions(segments["foot"], "static"))
    # how far the centre of pressure lies outside the area between the foot's markers, seen from
    # above
    corners = markers.mean(axis=0)[:, :2]
    hull = scipy.spatial.ConvexHull(corners)
    at = ((ankle.centre + to_pressure)[flat] - markers.mean(axis=1) + markers.mean(axis=(0, 1)))[
        :, :2
    ]
    start = corners[hull.vertices]
    edges, away = np.roll(start, -1, axis=0) - start, at[:, None] - start
    share = np.clip(np.sum(away * edges, axis=2) / np.sum(edges**2, axis=1), 0.0, 1.0)
    nearest = np.linalg.norm(away - share[..., None] * edges, axis=2).min(axis=1)
    outside = (at @ hull.equations[:, :2].T + hull.equations[:, 2] > 0).any(axis=1)
    quality: dict[str, float | None] = {
        "foot_forward_m": float(placed[0]),
        "foot_left_m": float(placed[1]),
        "foot_outside_m": furthest_outside(markers.reshape(-1, 3), passage.corners),
        "plate_zero_N": passage.zero,
        "plate_height_m": unloaded.certain_height,
        "plate_ringing_hz": unloaded.ringing_hz,
        "plate_unexplained": unloaded.unexplained,
        "pressure_ahead_m": float(pressed[0]),
        "pressure_beside_m": float(pressed[1]),
        "pressure_outside_m": float(np.mean(np.where(outside, nearest, 0.0))),
        "filled_share": None,
        "filled_fitted": None,
    }
    for segment, pose in (
        (segment, passage.recorded[segment][passage.rows]) for segment in segments
    ):
        left = pose.residual[passage.inside & np.isfinite(pose.residual)]
        quality[f"{segment}_residual_mm"] = (
            1e3 * float(np.sqrt(np.mean(left**2))) if len(left) else float("nan")
        )
    poses = [pose[passage.rows] for pose in passage.recorded.values()]
    told = [(pose.filled, pose.filled & pose.bridged) for pose in poses if pose.filled is not None]
    if told:
        filled, rests = np.any(told, axis=0)
        since = passage.time - (np.nan if passage.onset is None else passage.onset)
        fitted = (since >= -settings.guard_s - settings.baseline_s) & (since <= settings.window_s)
        quality["filled_share"] = float(np.mean(filled[passage.inside]))
        quality["filled_fitted"] = float(np.mean(rests[fitted])) if fitted.any() else None
    return quality


def analyse_crossing(
    trial: Trial,
    calibration: StaticCalibration,
    unloaded: PlateModel,
    perturbed: bool,
    settings: CrossingSettings,
    shared: PlatformModel = ALONE,
) -> Crossing:
    """Angle and torque of a crossing, through one low-pass at one rate. `perturbed` is stated in
    the sheet. `shared` is the model of the platform's motions; without it, motion and onset are the
    crossing's own."""
    passage = recorded_passage(trial, calibration, unloaded.lag or 0.0, perturbed, settings, shared)
    time, rows, onset, stance = passage.time, passage.rows, passage.onset, passage.stance
    foot, shank, plates = (passage.poses[segment] for segment in SEGMENTS)
    axis = (foot.rotation + shank.rotation) @ calibration.ankle_axis
    axis = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    between = (foot.point(calibration.ankle_centre) + shank.point(calibration.ankle_centre)) / 2
    check_side(stance.phase(time), shank.position - between, axis)
    ankle = Ankle(bodies.ankle_angle(foot, shank, calibration.ankle_axis), between, axis)
    on_foot, centre, torque, plate_errors, lab_errors = ankle_torques(
        trial.name, passage, ankle, unloaded, shared, calibration, settings
    )
    load = plate.load_on_foot(on_foot, centre, ankle.centre, ankle.axis)
    if (own := settings.foot) is not None:
        of_foot = bodies.body_motion(time, foot, calibration.ankle_centre + own.centre_of_mass_m)
        torque = torque + bodies.moment_of_foot(
            of_foot, ankle.centre, ankle.axis, own.mass_kg, own.inertia_kg_m2
        )
    shear = np.array([np.sum(on_foot[:, :3] * way, axis=1) for way in (ankle.axis, ankle.forward)])
    check_roll(stance.phase(time), load, shear, torque if onset is None else None)
    quality = quality_of(passage, ankle, load, unloaded, calibration, settings)
    bridged = np.any([pose.bridged[rows] for pose in passage.recorded.values()], axis=0)[
        passage.inside
    ]
    turn, window = None, () if onset is None else (onset, onset + settings.window_s)
    if window and settings.perturbed_by != "belt":
        turn = platform_turn(time, plates, axis, window)
    elif window:
        first, last = np.searchsorted(time, window)  # a belt that goes backward turns the toes up
        ahead = np.diff(plates.position[[first, last]], axis=0) @ ankle.forward[first]
        sign = commanded_onset(trial, stance)[1] if settings.by_command else -1 if ahead > 0 else 1
        turn = sign * float(np.ptp(ankle.theta[first:last]))
    return Crossing(
        name=trial.name,
        time=time,
        theta=ankle.theta,
        torque=torque,
        platform=platform.rotation_from_rest(passage.recorded["platform"])[rows],
        stance=stance,
        onset=onset,
        bridged=float(np.mean(bridged)),
        quality=quality | encoder_check(trial, time, ankle.theta, torque, settings.low_pass),
        plate_errors=plate_errors,
        load=load,
        turn=turn,
        lab_errors=lab_errors,
    )


def only_stance(
    time: Array, force: Array, settings: CrossingSettings, where: str, remedy: str
) -> Stance:
    """The only stance in a vertical force (n,) [N]. Raises InputError: none or several."""
    limits = settings.load_on_n, settings.load_off_n, settings.shortest_stance_s
    stances = plate.find_stances(time, force, *limits)
    if len(stances) != 1:
        times = ", ".join(f"{s.heel_strike:.3f}-{s.toe_off:.3f} s" for s in stances) or "none"
        raise InputError(
            f"one stance {where} is expected, found {times}; {remedy}, or exclude it in the sheet"
        )
    return stances[0]


def crossing_of_log(trial: Trial, perturbed: bool, settings: CrossingSettings) -> Crossing:
    """A crossing that a boot or the leg perturbs. Its log has `theta` [rad], `torque` [N*m], the
    command `trigger`, and `load` [N]; without `load`, a plate gives the vertical force. The
    command's direction is the perturbation's sign."""
    found = uniform_signals(trial, ("theta", "torque"), GapLimits(cutoff_hz=settings.cutoff_hz))
    load = next(
        (c for c in ("load", plate_columns(settings.plate, "force")[2]) if c in trial.columns), None
    )
    if load is None:
        raise InputError(
            "neither a column 'load' nor a force plate tells when the foot is on the ground; map"
            " the leg's load cell, insole or contact switch to 'load' in the source file, a switch"
            " with a `scale` of 100 N"
        )
    several = (
        "cut the log to one by `windows` in the sheet, one row per stride; check load_on_n and"
        " load_off_n"
    )
    stamps, force = trial.signals(load)
    stance = only_stance(stamps, force, settings, f"in '{load}'", several)
    inside = (found.time >= stance.heel_strike) & (found.time <= stance.toe_off)
    missing = max(found.time[0] - stance.heel_strike, stance.toe_off - found.time[-1])
    if missing > 1 / found.rate_hz or not found.usable[inside].all():
        raise InputError(
            "theta and torque are not known throughout stance,"
            f" {stance.heel_strike:.3f}-{stance.toe_off:.3f} s; cut the log 0.3 s before and after"
            " it, or exclude the trial"
        )
    onset, sign = commanded_onset(trial, stance)
    check_onset(onset, perturbed, stance, settings)
    first, last = (
        max(stance.heel_strike - 0.1, found.time[0]),
        min(stance.toe_off + 0.1, found.time[-1]),
    )
    # one for all logs, whose rates differ a little; enough after a low-pass of 20 Hz
    rate_hz = 300.0
    time = first + np.arange(int((last - first) * rate_hz) + 1) / rate_hz
    both = np.column_stack(
        [settings.low_pass(found[name], found.rate_hz) for name in ("theta", "torque")]
    )
    theta, torque = scipy.interpolate.make_interp_spline(found.time, both, k=3)(time).T
    window = (time >= (onset or 0.0)) & (time <= (onset or 0.0) + settings.window_s)
    turn = None if onset is None else sign * float(np.ptp(theta[window]))
    wrong = np.array([-1e-3 * np.gradient(torque, time), 0.01 * torque])  # by `LOG_ERRORS`
    return Crossing(
        trial.name, time, theta, torque, None, stance, onset, 0.0, lab_errors=wrong, turn=turn
    )


def commanded_onset(trial: Trial, stance: Stance) -> tuple[float | None, int]:
    """Time [s] in stance at which the column `trigger` leaves its rest by 0.5 or more, and to which
    side, 1 or -1. None if it does not, or is not there."""
    time, level = trial.signals("trigger") if "trigger" in trial.columns else np.zeros((2, 0))
    rows = (time >= stance.heel_strike - 0.25) & (time <= stance.toe_off)
    if not rows.any():
        return None, 1
    away = level[rows] - level[rows][0]
    sign = -1 if away[np.argmax(np.abs(away))] < 0 else 1
    return platform.find_onset(time[rows], sign * away, 0.5, "the command leaves its rest"), sign


def check_onset(
    onset: float | None, perturbed: bool, stance: Stance, settings: CrossingSettings
) -> None:
    """Refuse an onset [s] that the sheet contradicts, or whose baseline or window extends beyond
    stance."""
    if (onset is not None) != perturbed:
        turns = settings.perturbed_by == "platform"
        verb, limit = ("turn", "perturbation_deg") if turns else ("shift", "largest_shift_mm")
        what, rests, moves, remedy = (
            "platform",
            f"does not {verb}",
            f"{verb}s",
            f"{limit} or the platform markers",
        )
        if settings.by_command:
            what, rests, moves = (
                "command in 'trigger'",
                "rests in stance, or is missing,",
                "leaves its rest",
            )
            remedy = "the channel of 'trigger' in the source file"
        motion = rests if onset is None else f"{moves} at {onset:.3f} s"
        raise InputError(
            f"the {what} {motion} but the sheet says perturbed = {str(perturbed).lower()}; correct"
            f" the sheet, {remedy}, or exclude the trial"
        )
    if onset is None:
        return
    span = f"stance {stance.heel_strike:.3f}-{stance.toe_off:.3f} s"
    if not stance.heel_strike < onset < stance.toe_off:
        raise InputError(
            f"the perturbation starts at {onset:.3f} s, outside {span}; exclude the trial"
        )
    first, last = onset - settings.guard_s - settings.baseline_s, onset + settings.window_s
    if first < stance.heel_strike or last > stance.toe_off:
        raise InputError(
            f"baseline and window, {first:.3f}-{last:.3f} s, leave {span}; shorten window_s,"
            " baseline_s or guard_s, or exclude the trial"
        )


def onset_of(
    trial: Trial,
    time: Array,
    poses: Mapping[str, Poses],
    stance: Stance,
    perturbed: bool,
    settings: CrossingSettings,
    shared: PlatformModel,
) -> float | None:
    """Onset [s] of the perturbation, None without one; refused where sheet, stance, plate or
    markers forbid it."""
    if settings.markers.platform:
        moved, threshold = platform.moved_from_rest(poses["platform"], settings)
        verb = "turns" if settings.perturbed_by == "platform" else "shifts"
        onset = platform.find_onset(time, moved, threshold, f"the platform {verb}")
    else:
        onset, _ = commanded_onset(trial, stance)
    seen, centre = poses["platform"].seen(), poses["platform"].position
    inside = seen & (time >= stance.heel_strike) & (time <= stance.toe_off)
    if onset is not None:
        onset = shared.onset(trial.name, onset)
    # from its mean before, or if hidden, from its start
    elif settings.perturbed_by == "platform" and inside.any():
        before = seen & (time >= stance.heel_strike - 0.1) & (time < stance.heel_strike)
        rest = centre[before].mean(axis=0) if before.any() else centre[inside][0]
        shift = 1e3 * float(np.linalg.norm(centre[inside] - rest, axis=1).max())
        if shift > settings.largest_shift_mm:
            raise InputError(
                f"the platform shifts by {shift:.0f} mm in stance without a turn, expected"
                f" {settings.largest_shift_mm:g} mm or less: a translation is neither an"
                " unperturbed crossing nor a turn of the ankle; state perturbed_by: belt if shifts"
                " perturb, give the trial the experiment ingest_only, or correct largest_shift_mm"
            )
    check_onset(onset, perturbed, stance, settings)
    if onset is None:
        return None
    if settings.markers.platform:
        plate.check_type_on_platform(trial, settings.plate)
    window = (time >= onset) & (time <= onset + settings.window_s)
    for name in ("foot", "platform"):  # The shank carries the body and moves as in any stance
        gap, longest = longest_run(poses[name].bridged & window), settings.longest_fitted_gap_s
        if bodies.gap_duration(time, gap) > longest:
            hidden = (gap.stop - gap.start) * (time[1] - time[0])
            raise InputError(
                f"the {name} markers are hidden for {1e3 * hidden:.0f} ms from"
                f" {time[gap.start]:.3f} s{poses[name].by_filling(gap)}, while the perturbation is"
                f" fitted, expected {1e3 * longest:g} ms or less; raise longest_fitted_gap_s, or"
                " exclude the trial"
            )
    return onset


def check_vertical(force: Array) -> None:
    """Refuse a load (n, 3) [N] that does not act along +z."""
    size = np.linalg.norm(force, axis=1)
    if not size.any():
        return
    mean = force[size > 0.5 * size.max()].mean(axis=0)
    axis = int(np.argmax(np.abs(mean)))
    if axis == 2 and mean[2] > 0:
        return
    raise InputError(
        f"the load on the plate acts along {'-' if mean[axis] < 0 else '+'}{AXES[axis]}"
        f" ({mean[axis]:.0f} N), expected +z: correct `sign` or the plate's corners in the source"
        " file, or state `axes`, as [x, -z, y] where y points up"
    )


def check_side(phase: Array, shank_from_ankle: Array, axis: Array) -> None:
    """Refuse an ankle's axis (n, 3) that points to the right: the shank (n, 3) [m] leans backwards
    in stance."""
    first, last = (int(np.argmin(np.abs(phase - edge))) for edge in (0.1, 0.9))
    ahead = np.sum(shank_from_ankle * np.cross(axis, [0.0, 0.0, 1.0]), axis=1)
    if ahead[last] <= ahead[first]:
        raise InputError(
            f"the shank moves {100 * (ahead[first] - ahead[last]):.0f} cm backwards over the foot"
            " in stance: the ankle's axis points to the wrong side; correct `side`, exchange"
            " ankle_medial and ankle_lateral, or correct the labels of the static trial's markers"
        )


def check_roll(phase: Array, load: Array, shear: Array, torque: Array | None) -> None:
    """Refuse a load (3, n) (`load_on_foot`) that does not roll forward over the foot, and an
    undisturbed torque (n,) [N*m] that pulls the toes up in late stance, where every foot pushes.
    The `shear` (2, n) [N], to the left and forward, tells the cause. A walker brakes and then
    pushes. If the shear changes in another direction, the plate's axes are turned; if not, another
    foot has stepped on it."""
    flat, late = ((phase >= first) & (phase <= last) for first, last in ((0.15, 0.35), (0.6, 0.85)))
    (left, forward), (to_left, ahead) = (
        c[:, late].mean(axis=1) - c[:, flat].mean(axis=1) for c in (load[1:], shear)
    )
    way, turned = (
        float(np.rad2deg(np.arctan2(*one))) for one in ((left, forward), (to_left, ahead))
    )
    mean = 0.0 if torque is None else float(torque[(phase >= 0.5) & (phase <= 0.9)].mean())
    # [m]; a foot out-toes by 20 deg
    if mean >= 0 and (abs(way) <= 45 or np.hypot(left, forward) < 0.03):
        return
    found = f"the centre of pressure moves by {100 * np.hypot(left, forward):.0f} cm in stance"
    found += f", {abs(way):.0f} deg from forward" if abs(way) > 45 else ""
    found += (
        f", and the ankle's moment in late stance is {mean:.0f} N*m, expected above 0"
        if mean < 0
        else ""
    )
    if abs(turned) > 45 and np.hypot(to_left, ahead) > 0.08 * load[0, flat].mean():
        raise InputError(
            f"{found}, and the foot pushes off {abs(turned):.0f} deg from forward: the plate's"
            f" corners are turned by {90 * round(abs(turned) / 90)} deg or exchanged; correct their"
            " order, the first lies in +x and +y of the plate's own axes, or `axes` in the source"
            " file"
        )
    raise InputError(
        f"{found}, though the foot pushes off forward: another foot stands on the plate, whose load"
        f" in late stance is {load[0, late].mean() / load[0, flat].mean():.2f} of that before;"
        " exclude the trial, or, if it is so in all of them, correct the plate's corners and"
        " moment channels"
    )


def platform_turn(time: Array, turned: Poses, axis: Array, window: tuple[float, float]) -> float:
    """Largest turn [rad] of the platform about the ankle's axis (n, 3), toes up positive, within a
    `window` [s]."""
    start = max(int(np.searchsorted(time, window[0])) - 1, 0)
    rows = slice(start, int(np.searchsorted(time, window[1], side="right")))
    since = turned.rotation[rows] @ turned.rotation[start].T
    turns = -scipy.spatial.transform.Rotation.from_matrix(since).as_rotvec() @ axis[start]
    return float(turns[np.argmax(np.abs(turns))])


def encoder_check(
    trial: Trial, time: Array, theta: Array, torque: Array, low_pass: LowPass
) -> dict[str, float | None]:
    """The joint encoder's angle, a column of the trial, compared with the markers' (n,) [rad],
    through one low-pass: theta_encoder(t + delay) = theta(t) + offset. Also the RMS residual, and
    its part that follows the torque (n,) [N*m]: the compliance of the foot in its shoe [rad/(N*m)].
    Empty if fewer than 30 samples overlap."""
    fewest, longest = 30, 0.05  # samples; delay [s], beyond which the clocks are not aligned
    if "theta" not in trial.columns or trial.samples["theta"].count() < fewest:
        return {}
    own = uniform_signals(trial, ["theta"], GapLimits(cutoff_hz=low_pass.cutoff_hz))
    check_measured("the angle from markers", theta)
    check_measured("the encoder's angle", own["theta"])
    spare = longest + 1 / sampling_rate(time)
    rows = (
        (time > own.time[0] + spare)
        & (time < own.time[-1] - spare)
        & (np.interp(time, own.time, own.usable) == 1)
    )
    if rows.sum() < fewest:
        return {}
    spline = scipy.interpolate.make_interp_spline(
        own.time, low_pass(own["theta"], sampling_rate(own.time)), k=5
    )
    offset, delay = 0.0, 0.0
    for _ in range(8):  # by Newton
        difference = spline(time[rows] + delay) - theta[rows] - offset
        columns = np.column_stack([np.ones(len(difference)), -spline(time[rows] + delay, 1)])
        change = np.linalg.lstsq(columns, difference, rcond=None)[0]
        offset, delay = offset + float(change[0]), delay + float(change[1])
        if abs(delay) > longest:
            raise InputError(
                "the leg's joint encoder does not follow the angle from markers within"
                f" {longest * 1e3:g} ms; check the sync line, and which encoder and which sign the"
                " source file maps to theta"
            )
    difference = spline(time[rows] + delay) - theta[rows] - offset
    rms = float(np.rad2deg(np.sqrt(np.mean(difference**2))))
    columns = np.column_stack(
        [np.ones(len(difference)), spline(time[rows] + delay, 1), torque[rows]]
    )
    compliance = -float(np.linalg.lstsq(columns, difference, rcond=None)[0][2])
    found = {
        "encoder_offset_deg": float(np.rad2deg(offset)),
        "encoder_delay_ms": 1e3 * delay,
        "encoder_rms_deg": rms,
    }
    return {**found, "shoe_compliance": compliance}


def body_mass(trial: Trial, sheet: float | None, configured: float | None = None) -> float | None:
    """Body mass [kg] of a trial: the sheet's, else the recording's if not 0, else the configured
    one, else None."""
    recorded = trial.provenance.get("mocap", {}).get("body_mass_kg") or None
    # clothes, shoes and leg weigh something
    if sheet and recorded and abs(sheet / recorded - 1) > 0.1:
        raise InputError(
            f"trial {trial.name}: body_mass_kg is {sheet:g} in the sheet and {recorded:g} in the"
            " recording; correct the sheet, or leave its cell empty to use the recording's"
        )
    mass = sheet or recorded or configured
    if mass and not 10 <= mass <= 300:
        where = "sheet" if sheet else "recording" if recorded else "configuration"
        raise InputError(
            f"trial {trial.name}: a body mass of {mass:g} kg, from the {where}, is not one of a"
            " person; state body_mass_kg in the sheet, in kg"
        )
    return float(mass) if mass else None
