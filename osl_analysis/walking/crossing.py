"""Steps 1 to 4 of one crossing of the walkway: from a recording to ankle angle and torque."""

from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from osl_analysis.errors import InputError
from osl_analysis.measured import check_measured
from osl_analysis.trial import Array, Trial
from osl_analysis.walking import poses as rigid
from osl_analysis.walking.alike import differences
from osl_analysis.walking.ankle import Ankle, ankle_between, load_on_foot, moment_of_foot
from osl_analysis.walking.crossing_quality import (
    CrossingQuality,
    compare_encoder,
    crossing_quality,
)
from osl_analysis.walking.passage import Passage, recorded_passage
from osl_analysis.walking.plate_model import PlateModel
from osl_analysis.walking.poses import Poses, StaticCalibration, StoredArray
from osl_analysis.walking.setup_checks import check_roll, check_side
from osl_analysis.walking.stance import Stance
from osl_analysis.walking.torque_errors import ankle_torques, moving_plate
from osl_analysis.walking.walking_settings import CrossingSettings, FootSettings

# Directions of a perturbation in sheet and tables: toes up (dorsiflexion), and toes down
UP, DOWN = "up", "down"
FEWEST_SAMPLES = 6  # for a quintic spline


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
    onset: float | None = None,
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

    Raises
    ------
    InputError
        The recording, or the laboratory's set-up, does not allow it.
    """
    # Poses, stance and onset
    passage = recorded_passage(trial, calibration, unloaded.lag or 0.0, perturbed, settings, onset)
    foot, shank = passage.poses["foot"], passage.poses["shank"]
    phase = passage.stance.phase(passage.time)

    # Angle
    ankle = ankle_between(foot, shank, calibration)
    check_side(phase, shank.position - ankle.centre, ankle.axis)

    # Torque
    plate = moving_plate(passage, ankle, calibration, settings)
    torques = ankle_torques(plate, unloaded)
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
    encoder_rms_deg = compare_encoder(trial, passage.time, ankle.theta, settings.low_pass)
    quality = crossing_quality(passage, ankle, load, calibration, encoder_rms_deg, settings)
    unlike_static = differences(trial, passage, ankle, calibration, settings)
    different = max(unlike_static, key=lambda what: unlike_static[what])
    quality = replace(quality, different=different, different_mm=1e3 * unlike_static[different])
    clusters = passage.recorded.values()
    bridged = np.any([pose.bridged[passage.rows] for pose in clusters], axis=0)

    return Crossing(
        name=trial.name,
        time=passage.time,
        theta=ankle.theta,
        torque=torque,
        load=np.array([load.vertical, load.left, load.forward]),
        stance=passage.stance,
        onset=passage.onset,
        bridged=float(np.mean(bridged[passage.inside])),
        plate_errors=torques.plate_errors,
        quality=quality,
        turn=perturbing_turn(passage, ankle, settings),
    )


def torque_of_foot(
    time: Array, foot: Poses, ankle: Ankle, inertia: FootSettings, ankle_centre: Array
) -> Array:
    """Torque (n,) [N*m] of weight and inertia of what moves below the ankle."""
    motion = rigid.body_motion(time, foot, ankle_centre + inertia.centre_of_mass_m)
    return moment_of_foot(motion, ankle.centre, ankle.axis, inertia.mass_kg, inertia.inertia_kg_m2)


def perturbing_turn(passage: Passage, ankle: Ankle, settings: CrossingSettings) -> float | None:
    """Turn [rad] by the perturbation in the window, toes up; None without one."""
    if passage.onset is None:
        return None
    plate = passage.poses["platform"]
    end = passage.onset + settings.window_s
    return platform_turn(passage.time, plate, ankle.axis, (passage.onset, end))


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
