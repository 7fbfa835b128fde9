"""Steps 1 to 4 of one crossing of the walkway: from a recording to ankle angle and torque.

The crossing is recorded by markers and a force plate, or by the log of a boot or leg.
"""

from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from osl_analysis.errors import InputError
from osl_analysis.measured import check_measured
from osl_analysis.signals.grid import GapLimits, uniform_signals
from osl_analysis.trial import Array, Trial, plate_columns
from osl_analysis.walking import poses as rigid
from osl_analysis.walking.alike import differences
from osl_analysis.walking.ankle import Ankle, ankle_between, load_on_foot, moment_of_foot
from osl_analysis.walking.crossing_quality import (
    CrossingQuality,
    compare_encoder,
    crossing_quality,
)
from osl_analysis.walking.passage import Passage, find_command, in_stance, recorded_passage
from osl_analysis.walking.plate_model import PlateModel
from osl_analysis.walking.platform import rotation_from_rest
from osl_analysis.walking.poses import Poses, StaticCalibration, StoredArray
from osl_analysis.walking.setup_checks import check_onset, check_roll, check_side
from osl_analysis.walking.shared_motion import NO_SHARED_MOTION, PlatformModel
from osl_analysis.walking.stance import Stance, only_stance
from osl_analysis.walking.torque_errors import LOG_ERRORS, ankle_torques, moving_plate
from osl_analysis.walking.walking_settings import CrossingSettings, FootSettings

# Directions of a perturbation in sheet and tables: toes up (dorsiflexion), and toes down
UP, DOWN = "up", "down"
FEWEST_SAMPLES = 6  # for a quintic spline
LOG_RATE_HZ = 300.0  # one for all logs, whose rates differ a little; enough after 20 Hz
LOG_SPARE_S = 0.1  # before and after stance
ONE_STRIDE = (
    "cut the log to one by `windows` in the sheet, one row per stride; check load_on_n and"
    " load_off_n"
)


@dataclass(frozen=True)
class Crossing:
    """Ankle angle and torque of one crossing, n samples at the marker rate."""

    name: str
    time: StoredArray
    theta: StoredArray  # joint angle (n,) [rad]
    torque: StoredArray  # internal plantarflexion moment (n,) [N*m]
    platform: StoredArray | None  # rotation (n,) [rad], not low-passed; None without a platform
    stance: Stance
    onset: float | None  # of the perturbation [s]; None without one
    bridged: float  # fraction of the frames in stance in which a hidden cluster was interpolated
    # Changes (m, n) [N*m] of the torque without the i-th of m plate trials; m = 0 with one
    plate_errors: StoredArray = field(default_factory=lambda: np.zeros((0, 0)))
    # The same (e, n) [N*m] by each of `LABORATORY_ERRORS`, or of `LOG_ERRORS`
    lab_errors: StoredArray = field(default_factory=lambda: np.zeros((0, 0)))
    quality: CrossingQuality = field(default_factory=CrossingQuality)
    # Vertical force [N], and centre of pressure [m] to the left of the ankle and before it: (3, n)
    load: StoredArray | None = None  # None if it is not known
    # Largest turn [rad] of the platform about the ankle in the window, toes up; without a turning
    # platform the range of the ankle's angle, with the sign of the perturbation
    turn: float | None = None  # None without a perturbation
    body_mass: float | None = None  # [kg]; None if nobody states it

    def __post_init__(self) -> None:
        for errors in ("plate_errors", "lab_errors"):
            if not getattr(self, errors).size:
                object.__setattr__(self, errors, np.zeros((0, len(self.time))))
        for signal in ("time", "theta", "torque", "plate_errors"):
            check_measured(f"trial {self.name}: {signal}", getattr(self, signal))
        if len(self.time) < FEWEST_SAMPLES or not (np.diff(self.time) > 0).all():
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
        if self.turn is None:
            return None
        return UP if self.turn > 0 else DOWN


@dataclass(frozen=True)
class RefusedCrossing:
    """A crossing that cannot be analysed, whether the sheet says that it is perturbed, and why."""

    name: str
    perturbed: bool
    reason: str


def analyse_crossing(
    trial: Trial,
    calibration: StaticCalibration,
    unloaded: PlateModel,
    perturbed: bool,
    settings: CrossingSettings,
    shared: PlatformModel = NO_SHARED_MOTION,
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
    shared : PlatformModel
        What the motions of the platform have in common; without it, motion and onset are the
        crossing's own.

    Raises
    ------
    InputError
        The recording, or the laboratory's set-up, does not allow it.
    """
    # Poses, stance and onset
    passage = recorded_passage(trial, calibration, unloaded.lag or 0.0, perturbed, settings, shared)
    foot, shank = passage.poses["foot"], passage.poses["shank"]
    phase = passage.stance.phase(passage.time)

    # Angle
    ankle = ankle_between(foot, shank, calibration)
    check_side(phase, shank.position - ankle.centre, ankle.axis)

    # Torque
    plate = moving_plate(passage, ankle, shared, calibration, settings)
    torques = ankle_torques(plate, unloaded, shared)
    torque = torques.torque
    if settings.foot is not None:
        torque = torque + torque_of_foot(
            passage.time, foot, ankle, settings.foot, calibration.ankle_centre
        )

    # What shows that the set-up is right
    load = load_on_foot(torques.on_foot, torques.centre, ankle)
    force = torques.on_foot[:, :3]
    shear = np.array([np.sum(force * ankle.axis, axis=1), np.sum(force * ankle.forward, axis=1)])
    check_roll(phase, load, shear, torque if passage.onset is None else None)
    encoder = compare_encoder(trial, passage.time, ankle.theta, torque, settings.low_pass)
    quality = crossing_quality(
        trial, passage, ankle, load, unloaded, calibration, encoder, settings
    )
    unlike_static = {
        **differences(trial, passage, ankle, calibration, settings),
        **unloaded.differences,
    }
    different = max(unlike_static, key=lambda what: unlike_static[what])
    quality = replace(quality, different=different, different_mm=1e3 * unlike_static[different])
    clusters = passage.recorded.values()
    bridged = np.any([pose.bridged[passage.rows] for pose in clusters], axis=0)

    return Crossing(
        name=trial.name,
        time=passage.time,
        theta=ankle.theta,
        torque=torque,
        platform=rotation_from_rest(passage.recorded["platform"])[passage.rows],
        stance=passage.stance,
        onset=passage.onset,
        bridged=float(np.mean(bridged[passage.inside])),
        plate_errors=torques.plate_errors,
        lab_errors=torques.lab_errors,
        quality=quality,
        load=np.array([load.vertical, load.left, load.forward]),
        turn=perturbing_turn(trial, passage, ankle, settings),
    )


def torque_of_foot(
    time: Array, foot: Poses, ankle: Ankle, inertia: FootSettings, ankle_centre: Array
) -> Array:
    """Torque (n,) [N*m] of weight and inertia of what moves below the ankle."""
    motion = rigid.body_motion(time, foot, ankle_centre + inertia.centre_of_mass_m)
    return moment_of_foot(motion, ankle.centre, ankle.axis, inertia.mass_kg, inertia.inertia_kg_m2)


def perturbing_turn(
    trial: Trial, passage: Passage, ankle: Ankle, settings: CrossingSettings
) -> float | None:
    """Turn [rad] by the perturbation in the window, toes up; None without one."""
    if passage.onset is None:
        return None
    plate = passage.poses["platform"]
    end = passage.onset + settings.window_s
    if settings.perturbed_by != "belt":
        return platform_turn(passage.time, plate, ankle.axis, (passage.onset, end))

    first, last = np.searchsorted(passage.time, (passage.onset, end))
    if settings.by_command:
        sign = find_command(trial, passage.stance).sign
    else:
        shift = np.diff(plate.position[[first, last]], axis=0) @ ankle.forward[first]
        sign = -1 if shift > 0 else 1  # a belt that goes backward turns the toes up
    return sign * float(np.ptp(ankle.theta[first:last]))


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


def crossing_of_log(trial: Trial, perturbed: bool, settings: CrossingSettings) -> Crossing:
    """Read a crossing that a boot or the leg perturbs from its log.

    Parameters
    ----------
    trial : Trial
        With columns `theta` [rad], `torque` [N*m], the command `trigger`, and `load` [N]; without
        `load`, a plate gives the vertical force. The command's direction is the perturbation's
        sign.

    Raises
    ------
    InputError
        Stance, angle and torque are not known, or the sheet contradicts the command.
    """
    log = uniform_signals(trial, ("theta", "torque"), GapLimits(cutoff_hz=settings.cutoff_hz))
    load_column = column_of_load(trial, settings)
    stamps, force = trial.signals(load_column)
    stance = only_stance(stamps, force, settings, f"in '{load_column}'", ONE_STRIDE)

    inside = in_stance(log.time, stance)
    missing_s = max(log.time[0] - stance.heel_strike, stance.toe_off - log.time[-1])
    if missing_s > 1 / log.rate_hz or not log.usable[inside].all():
        raise InputError(
            "theta and torque are not known throughout stance,"
            f" {stance.heel_strike:.3f}-{stance.toe_off:.3f} s; cut the log 0.3 s before and after"
            " it, or exclude the trial"
        )
    command = find_command(trial, stance)
    check_onset(command.onset, perturbed, stance, settings)

    first = max(stance.heel_strike - LOG_SPARE_S, log.time[0])
    last = min(stance.toe_off + LOG_SPARE_S, log.time[-1])
    time = first + np.arange(int((last - first) * LOG_RATE_HZ) + 1) / LOG_RATE_HZ
    low_passed = np.column_stack(
        [settings.low_pass(log[name], log.rate_hz) for name in ("theta", "torque")]
    )
    theta, torque = scipy.interpolate.make_interp_spline(log.time, low_passed, k=3)(time).T
    turn = None
    if command.onset is not None:
        window = (time >= command.onset) & (time <= command.onset + settings.window_s)
        turn = command.sign * float(np.ptp(theta[window]))
    late = 1e-3 * LOG_ERRORS["torque_lag"].size
    share = LOG_ERRORS["torque"].size / 100
    return Crossing(
        trial.name,
        time,
        theta,
        torque,
        platform=None,
        stance=stance,
        onset=command.onset,
        bridged=0.0,
        lab_errors=np.array([-late * np.gradient(torque, time), share * torque]),
        turn=turn,
    )


def column_of_load(trial: Trial, settings: CrossingSettings) -> str:
    """The column that tells when the foot is on the ground: `load`, or a plate's vertical force."""
    for column in ("load", plate_columns(settings.plate, "force")[2]):
        if column in trial.columns:
            return column
    raise InputError(
        "neither a column 'load' nor a force plate tells when the foot is on the ground; map"
        " the leg's load cell, insole or contact switch to 'load' in the source file, a switch"
        " with a `scale` of 100 N"
    )
