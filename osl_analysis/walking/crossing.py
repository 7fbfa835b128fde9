# SPDX-License-Identifier: Apache-2.0
"""Step 4, crossing: angle and torque of one crossing, and whether its set-up allows them.

The torque is computed from force and moment at the plate's origin, never from a centre of pressure,
which is undefined while the plate is unloaded. Its changes without each plate trial follow it
through all later steps.

Axes, side, sheet and body mass are checked here; what the static trial and markers alone tell, in
`set_up`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy

from osl_analysis.errors import InputError
from osl_analysis.measured import check_measured
from osl_analysis.signals import longest_run, runs, sampling_rate
from osl_analysis.trial import Array, Trial
from osl_analysis.walking import platform
from osl_analysis.walking import poses as rigid
from osl_analysis.walking.plate import (
    FLAT,
    Stance,
    WrenchReader,
    check_plate,
    check_type_on_platform,
    check_vertical,
    furthest_outside,
    only_stance,
    phases_between,
    recorded_corners,
    zeroed_wrench,
)
from osl_analysis.walking.plate_inertia import PlateModel, inertial_columns
from osl_analysis.walking.poses import (
    FREE_FALL,
    BodyMotion,
    Mask,
    Poses,
    StaticCalibration,
    StoredArray,
)
from osl_analysis.walking.set_up import CrossingQuality, check_place, crossing_quality
from osl_analysis.walking.walking_settings import CrossingSettings


class StanceLimits:
    """Of what a stance shows."""

    PRESSED_N = 100.0  # vertical force above which a centre of pressure is defined
    SPARE_S = 0.1  # before and after stance, for the low-pass
    LATE = (0.6, 0.85)  # phases of stance in which a walker pushes off
    PUSH = (0.5, 0.9)  # phases of stance in which every foot pushes the toes down
    # of roll [m] and push [N] that have a direction, and its largest angle from forward: a foot
    # out-toes by 20 deg, and the side force of slow gait changes nearly as much as its push
    SMALLEST_CHANGE = (0.03, 20.0)
    LARGEST_TURN_DEG = (45.0, 60.0)
    LARGEST_MASS_DIFFERENCE = 0.1  # clothes, shoes and leg weigh something
    FEWEST_SAMPLES = 6  # for a quintic spline


VERTICAL = np.array([0.0, 0.0, 1.0])


# Directions of a perturbation in sheet and tables: toes up (dorsiflexion), and toes down
UP, DOWN = "up", "down"


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

    def along(self, vectors: Array) -> Array:
        """Components (2, n) of vectors (n, 3) to the left and forward."""
        return np.einsum("kni,ni->kn", (self.axis, self.forward), vectors)


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
    return -2 * np.arctan2(quaternion[:, :3] @ axis, quaternion[:, 3])


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
    return -np.sum(about_ankle * axis, axis=1)


def load_on_foot(reaction: Array, centre: Array, ankle: Ankle) -> Array:
    """Vertical force [N], and centre of pressure [m] to the left of the ankle and before it, 0 if
    hardly pressed: (3, n), from the reaction (n, 6) about `centre` (n, 3) [m]."""
    vertical = reaction[:, 2]
    pressed = vertical > StanceLimits.PRESSED_N
    divisor = np.where(pressed, vertical, 1.0)[:, None]
    from_ankle = centre + np.cross(VERTICAL, reaction[:, 3:]) / divisor - ankle.centre
    return np.vstack([vertical, pressed * ankle.along(from_ankle)])


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
    return np.sum(axis * (of_mass + inertia * foot.alpha), axis=1)


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
        return self.stance.contains(self.time)


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
        frames, recorded[segment] = rigid.segment_poses(trial, labels, calibration, settings)
        reference[segment] = calibration.positions(labels, trial.name)

    wrench = zeroed_wrench(trial, frames, settings)
    force = wrench(lag)[:, :3]
    check_vertical(force, settings.load_on_n)
    stance = only_stance(frames, force[:, 2], settings)
    check_plate(trial, settings.plate, stance, force[:, 2])
    corners = recorded_corners(trial, settings.plate)
    check_place(corners, settings.plate, calibration.corners)

    for segment, pose in recorded.items():
        check_followed(segment, frames, pose, stance, settings.largest_residual_mm)
    onset = onset_of(trial, frames, recorded, stance, perturbed, settings, onset)

    rows = rows_about_stance(frames, recorded, stance)
    rate = sampling_rate(frames)
    low_passed = {}
    for segment, cluster in reference.items():
        markers = settings.low_pass(recorded[segment][rows].points(cluster), rate)
        low_passed[segment] = rigid.cluster_poses(cluster, markers)
    return Passage(trial.name, frames, recorded, wrench, corners, stance, onset, rows, low_passed)


def check_followed(
    segment: str, frames: Array, pose: Poses, stance: Stance, largest_residual_mm: float
) -> None:
    """Refuse a cluster that is hidden in stance, or was put on again since the static trial."""
    hidden = np.flatnonzero(stance.contains(frames) & ~pose.seen())
    if len(hidden):
        raise InputError(
            f"the {segment} markers cannot be followed at {frames[hidden[0]]:.3f} s, in"
            f" {len(hidden)} frames of stance: fewer than three are seen, or they stand more than"
            f" {largest_residual_mm:g} mm (RMS) otherwise than in the static trial; correct"
            " exchanged labels in Nexus, record a static trial after they were put on again and"
            " name it in the column static, or exclude the trial"
        )


def rows_about_stance(frames: Array, recorded: Mapping[str, Poses], stance: Stance) -> slice:
    """Stance and the frames about it in which all clusters were seen."""
    seen = np.all([pose.seen() for pose in recorded.values()], axis=0)
    near = (
        seen
        & (frames >= stance.heel_strike - StanceLimits.SPARE_S)
        & (frames <= stance.toe_off + StanceLimits.SPARE_S)
    )
    first = np.argmax(stance.contains(frames))
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
    ramp = platform.ramp_of(time, recorded["platform"], settings.smallest_turn)
    onset = None
    if ramp is not None:
        onset = of_mean_ramp
        if onset is None:
            onset = platform.ramp_onsets({trial.name: ramp})[trial.name]
    check_onset(onset, perturbed, stance, settings)
    if onset is None:
        return None

    check_type_on_platform(trial, settings.plate)
    window = (time >= onset) & (time <= onset + settings.window_s)
    for segment in ("foot", "platform"):  # the shank carries the body and moves as in any stance
        pose = recorded[segment]
        gap = longest_run(pose.bridged & window)
        if rigid.gap_duration(time, gap) > settings.longest_fitted_gap_s:
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
            f"the platform {'does not turn' if perturbed else 'turns'}, but the sheet says"
            f" perturbed = {str(perturbed).lower()}; correct the sheet, perturbation_deg or the"
            " platform markers, or exclude the trial"
        )
    if onset is None:
        return
    first = onset - settings.guard_s - settings.baseline_s
    last = onset + settings.window_s
    if first < stance.heel_strike or last > stance.toe_off:
        raise InputError(
            f"baseline and window of the perturbation, {first:.3f}-{last:.3f} s, leave stance"
            f" {stance.heel_strike:.3f}-{stance.toe_off:.3f} s; exclude the trial, or shorten"
            " window_s, baseline_s or guard_s"
        )


def reactions_on_foot(
    passage: Passage,
    models: list[PlateModel],
    lag: float,
    calibration: StaticCalibration,
    settings: CrossingSettings,
) -> tuple[list[Array], Array]:
    """Compute the ground reaction on the foot, without the plate's own wrench.

    The plate's own wrench is that of its measured motion, without accelerations at rest. The first
    model has the `lag` [s], others as much more as in the unloaded recordings.

    Returns
    -------
    tuple of list of Array and Array
        Reactions (n, 6) [N, N*m] by each model of the unloaded plate, in laboratory axes, and the
        plate's centre (n, 3) [m], about which they are.
    """
    rows = passage.rows
    poses_of_plate = passage.recorded["platform"]
    run = next(run for run in runs(poses_of_plate.seen()) if run.start <= rows.start < run.stop)
    track = platform.platform_track(
        passage.name, passage.frames[run], poses_of_plate[run], calibration, settings
    )
    middle = passage.corners.mean(axis=0)
    axes = platform.shared_directions([track])[0]
    in_track = slice(rows.start - run.start, rows.stop - run.start)
    motion, weights = track.measured_motion(axes, middle, in_track)
    columns = inertial_columns(motion.weighted(weights))

    plate = passage.poses["platform"]
    R_transposed = np.swapaxes(plate.rotation, 1, 2)
    rate = sampling_rate(passage.frames)
    reactions = []
    for model in models:
        later = (model.lag or 0.0) - (models[0].lag or 0.0)
        wrench = settings.low_pass(passage.wrench(lag + later), rate)[rows]
        of_foot = wrench - columns @ model.parameters
        reactions.append((of_foot.reshape(-1, 2, 3) @ R_transposed).reshape(-1, 6))
    return reactions, plate.point(middle)


def check_side(phase: Array, ahead: Array) -> None:
    """Refuse an ankle's axis that points to the right.

    The shank, which is `ahead` (n,) [m] of the ankle, then leans backwards in stance.
    """
    first, last = np.interp((0.1, 0.9), phase, ahead)
    if last <= first:
        raise InputError(
            f"the shank moves {100 * (first - last):.0f} cm backwards over the foot"
            " in stance: the ankle's axis points to the wrong side; correct `side`, exchange"
            " ankle_medial and ankle_lateral, or correct the labels of the static trial's markers"
        )


def check_roll(phase: Array, load: Array, push: Array, torque: Array) -> None:
    """Refuse a load that does not roll and push forward over the foot, or pulls the toes up.

    Turned corners turn both. A channel of the wrong sign turns one, and corners that are turned to
    make up for it turn the other.

    Parameters
    ----------
    phase : Array
        Of stance (n,).
    load : Array
        (3, n), as in `Crossing`.
    push : Array
        Horizontal force [N] to the left and forward (2, n), which brakes before it pushes.
    torque : Array
        Undisturbed torque (n,) [N*m], else 0; in late stance every foot pushes the toes down.
    """
    both = np.vstack([load[1:], push])
    late = both[:, phases_between(phase, StanceLimits.LATE)].mean(axis=1)
    flat = both[:, phases_between(phase, FLAT)].mean(axis=1)
    left, forward = (late - flat).reshape(2, 2).T
    size = np.hypot(left, forward)
    deg = np.abs(np.rad2deg(np.arctan2(left, forward)))
    turned = (deg > StanceLimits.LARGEST_TURN_DEG) & (size > StanceLimits.SMALLEST_CHANGE)
    moment = torque[phases_between(phase, StanceLimits.PUSH)].mean()
    if moment >= 0 and not turned.any():
        return
    cause = (
        "a channel of the plate, of a moment or of a horizontal force, has the wrong sign: correct"
        " it in the recorder and export again; the source file cannot reverse one channel, and"
        " corners that are turned in its place give a wrong K"
    )
    if turned.all():
        cause = (
            "the plate's corners or axes are turned: correct the corners' order, the first lies in"
            " +x and +y of the plate's own axes, or `axes` in the source file"
        )
    pulls = f", and the ankle pulls the toes up with {-moment:.1f} N*m" if moment < 0 else ""
    raise InputError(
        "from the flat foot to late stance the centre of pressure moves by"
        f" {100 * size[0]:.0f} cm, {deg[0]:.0f} deg from forward, and the horizontal force changes"
        f" by {size[1]:.0f} N, {deg[1]:.0f} deg from forward{pulls}. If it is so in all trials,"
        f" {cause}; else another foot stands on the plate: exclude the trial"
    )


def body_mass(trial: Trial, sheet: float | None) -> float | None:
    """Body mass [kg] of a trial: the sheet's, else the recording's.

    Raises
    ------
    InputError
        Sheet and recording differ.
    """
    # a recording that does not know it has 0
    recorded = trial.provenance.get("mocap", {}).get("body_mass_kg") or None
    if sheet and recorded and abs(sheet / recorded - 1) > StanceLimits.LARGEST_MASS_DIFFERENCE:
        raise InputError(
            f"trial {trial.name}: body_mass_kg is {sheet:g} in the sheet and {recorded:g} in the"
            " recording; correct the sheet, or leave its cell empty to use the recording's"
        )
    mass = sheet or recorded
    return None if mass is None else float(mass)


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
    bridged: float  # fraction of the frames in stance in which a hidden cluster was interpolated
    # Changes (m, n) [N*m] of the torque without the i-th of m plate trials; m = 0 with one
    plate_errors: StoredArray = field(default_factory=lambda: np.zeros((0, 0)))
    quality: CrossingQuality = field(default_factory=CrossingQuality)
    # Largest turn [rad] of the platform about the ankle in the window, toes up; None without one
    turn: float | None = None
    body_mass: float | None = None  # [kg]; None if nobody states it

    def __post_init__(self) -> None:
        if not self.plate_errors.size:
            object.__setattr__(self, "plate_errors", np.zeros((0, len(self.time))))
        for signal in ("time", "theta", "torque", "load", "plate_errors"):
            check_measured(f"trial {self.name}: {signal}", getattr(self, signal))
        if len(self.time) < StanceLimits.FEWEST_SAMPLES:
            raise InputError(f"trial {self.name}: {len(self.time)} samples; exclude the trial")
        sampling_rate(self.time)  # which refuses stamps that do not go forward

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
    onset: float | None = None,
    lag: float | None = None,
) -> Crossing:
    """Compute angle and torque of a crossing, through one low-pass at one rate.

    Parameters
    ----------
    trial : Trial
        Markers and force plate; the joint's encoder, if there is one.
    unloaded : PlateModel
        Inertia and lag of the plate, which are removed.
    perturbed : bool
        What the sheet says.
    onset : float or None
        Of the perturbation [s], by the mean ramp of all crossings; None: by its own ramp.
    lag : float or None
        Of the plate in this crossing [s]; None: that of the unloaded plate.

    Raises
    ------
    InputError
        The recording, or the laboratory's set-up, does not allow it.
    """
    # Poses, stance and onset
    lag = (unloaded.lag or 0.0) if lag is None else lag
    passage = recorded_passage(trial, calibration, lag, perturbed, settings, onset)
    foot, shank = passage.poses["foot"], passage.poses["shank"]
    phase = passage.stance.phase(passage.time)

    # Angle
    ankle = ankle_between(foot, shank, calibration)
    half_a_foot_m = 0.15  # an ankle that is farther beside the plate does not load it
    stands = phases_between(phase, (0.1, 0.9))
    outside_m = furthest_outside(ankle.centre[stands], passage.corners)
    if outside_m > half_a_foot_m:
        raise InputError(
            f"the ankle is {100 * outside_m:.0f} cm beside force plate {settings.plate} while it is"
            " loaded: another foot stands on it; state the plate under this foot as `walking.plate`"
        )
    _, ahead = ankle.along(shank.position - ankle.centre)
    check_side(phase, ahead)

    # Torque, and its changes without each plate trial
    models = [unloaded, *unloaded.leave_one_out]
    reactions, centre = reactions_on_foot(passage, models, lag, calibration, settings)
    torques = np.array(
        [ankle_torque(reaction, centre, ankle.centre, ankle.axis) for reaction in reactions]
    )
    torque = torques[0]
    if settings.foot is not None:
        of_foot = settings.foot
        motion = rigid.body_motion(
            passage.time, foot, calibration.ankle_centre + of_foot.centre_of_mass_m
        )
        torque = torque + moment_of_foot(
            motion, ankle.centre, ankle.axis, of_foot.mass_kg, of_foot.inertia_kg_m2
        )

    # What shows that the set-up is right
    load = load_on_foot(reactions[0], centre, ankle)
    push = ankle.along(reactions[0][:, :3])
    undisturbed_torque = torque if passage.onset is None else np.zeros_like(torque)
    check_roll(phase, load, push, undisturbed_torque)
    clusters = passage.recorded.values()
    bridged = np.any([pose.bridged[passage.rows] for pose in clusters], axis=0)

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
        bridged=float(np.mean(bridged[passage.inside])),
        plate_errors=torques[1:] - torques[0],
        quality=crossing_quality(trial, passage, ankle, load, calibration, settings),
        turn=turn,
    )


def platform_turn(time: Array, turned: Poses, axis: Array, window: tuple[float, float]) -> float:
    """Find the largest turn of the platform in a window [s] from its start.

    Parameters
    ----------
    turned : Poses
        Of the platform, at times (n,) [s].
    axis : Array
        Of the ankle (n, 3), to the left.

    Returns
    -------
    float
        [rad], toes up positive.
    """
    start = max(int(np.searchsorted(time, window[0])) - 1, 0)
    rows = slice(start, int(np.searchsorted(time, window[1], side="right")))
    since_start = turned.rotation[rows] @ turned.rotation[start].T
    vectors = scipy.spatial.transform.Rotation.from_matrix(since_start).as_rotvec()
    turns = -vectors @ axis[start]
    return float(turns[np.argmax(np.abs(turns))])
