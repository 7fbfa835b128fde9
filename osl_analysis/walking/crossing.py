"""Steps 1 to 4 of one crossing of the walkway, and whether the laboratory's set-up allows them.

Axes, side, corners, sheet and body mass are checked. What stays the same from the static trial on
is compared directly: the markers of each cluster, the ankle between foot and shank, the platform at
rest and the corners of the plate. What differs is named by itself, whatever it does to the torque.
"""

from dataclasses import dataclass, field

import numpy as np
import scipy

from osl_analysis.errors import InputError
from osl_analysis.measured import check_measured
from osl_analysis.plates import furthest_outside
from osl_analysis.signals import LowPass, sampling_rate
from osl_analysis.signals.grid import GapLimits, uniform_signals
from osl_analysis.trial import Array, Trial
from osl_analysis.walking import poses as rigid
from osl_analysis.walking.ankle import (
    VERTICAL,
    Ankle,
    LoadOnFoot,
    Passage,
    ankle_between,
    ankle_torques,
    load_on_foot,
    moment_of_foot,
    recorded_passage,
)
from osl_analysis.walking.plate import Stance, recorded_plate
from osl_analysis.walking.plate_inertia import PlateModel
from osl_analysis.walking.poses import (
    Mask,
    Poses,
    StaticCalibration,
    StoredArray,
    marker_tracks,
    moved_marker,
)
from osl_analysis.walking.walking_settings import CrossingSettings

FLAT = (0.15, 0.35)  # phases of stance in which the foot is flat, before a perturbation
LATE = (0.6, 0.85)  # phases of stance in which a walker pushes off
PUSH = (0.5, 0.9)  # phases of stance in which every foot pushes the toes down
LARGEST_OUT_TOEING_DEG = 45.0  # between the roll of the load and forward; a foot out-toes by 20 deg
SMALLEST_ROLL_M = 0.03  # of the centre of pressure, that has a direction
SMALLEST_PUSH = 0.08  # change of the shear, as a share of the load, that has a direction
LARGEST_MASS_DIFFERENCE = 0.1  # clothes, shoes and leg weigh something
BODY_MASSES_KG = (10.0, 300.0)


def phases_between(phase: Array, bounds: tuple[float, float]) -> Mask:
    return np.asarray((phase >= bounds[0]) & (phase <= bounds[1]))


def check_side(phase: Array, shank_from_ankle: Array, axis: Array) -> None:
    """Refuse an ankle's axis (n, 3) that points to the right.

    The shank (n, 3) [m] then leans backwards in stance.
    """
    first = int(np.argmin(np.abs(phase - 0.1)))
    last = int(np.argmin(np.abs(phase - 0.9)))
    ahead = np.sum(shank_from_ankle * np.cross(axis, VERTICAL), axis=1)
    if ahead[last] <= ahead[first]:
        raise InputError(
            f"the shank moves {100 * (ahead[first] - ahead[last]):.0f} cm backwards over the foot"
            " in stance: the ankle's axis points to the wrong side; correct `side`, exchange"
            " ankle_medial and ankle_lateral, or correct the labels of the static trial's markers"
        )


def check_roll(phase: Array, load: LoadOnFoot, shear: Array, torque: Array | None) -> None:
    """Refuse a load that does not roll forward over the foot, or a torque that pulls the toes up.

    A walker brakes and then pushes. If the shear changes in another direction, the plate's axes are
    turned; if not, another foot has stepped on it.

    Parameters
    ----------
    phase : Array
        Of stance (n,).
    shear : Array
        Force on the foot (2, n) [N], to the left and forward.
    torque : Array or None
        Undisturbed torque (n,) [N*m]; in late stance every foot pushes the toes down.
    """
    flat = phases_between(phase, FLAT)
    late = phases_between(phase, LATE)

    def change(left_and_forward: Array) -> tuple[float, float]:
        """Size of the change of (2, n) from flat foot to late stance, and its angle to forward."""
        left, forward = left_and_forward[:, late].mean(axis=1) - left_and_forward[:, flat].mean(
            axis=1
        )
        return float(np.hypot(left, forward)), abs(float(np.rad2deg(np.arctan2(left, forward))))

    roll_m, roll_deg = change(np.array([load.left, load.forward]))
    push_n, push_deg = change(shear)
    moment = 0.0
    if torque is not None:
        moment = float(torque[phases_between(phase, PUSH)].mean())
    rolls_forward = roll_deg <= LARGEST_OUT_TOEING_DEG or roll_m < SMALLEST_ROLL_M
    if moment >= 0 and rolls_forward:
        return

    observed = (
        f"the centre of pressure moves by {100 * roll_m:.0f} cm in stance, {roll_deg:.0f} deg from"
        " forward"
    )
    if moment < 0:
        observed += f", and the ankle's moment in late stance is {moment:.0f} N*m, expected above 0"
    flat_load = load.vertical[flat].mean()
    if push_deg > LARGEST_OUT_TOEING_DEG and push_n > SMALLEST_PUSH * flat_load:
        raise InputError(
            f"{observed}, and the foot pushes off {push_deg:.0f} deg from forward: the plate's"
            f" corners are turned by {90 * round(push_deg / 90)} deg or exchanged; correct their"
            " order, the first lies in +x and +y of the plate's own axes, or `axes` in the source"
            " file"
        )
    raise InputError(
        f"{observed}, though the foot pushes off forward: another foot stands on the plate, whose"
        f" load in late stance is {load.vertical[late].mean() / flat_load:.2f} of that before;"
        " exclude the trial, or, if it is so in all of them, correct the plate's corners and"
        " moment channels"
    )


def body_mass(trial: Trial, sheet: float | None) -> float | None:
    """Body mass [kg] of a trial: the sheet's, else the recording's.

    Raises
    ------
    InputError
        Sheet and recording differ, or it is not the mass of a person.
    """
    # a recording that does not know it has 0
    recorded = trial.provenance.get("mocap", {}).get("body_mass_kg") or None
    if sheet and recorded and abs(sheet / recorded - 1) > LARGEST_MASS_DIFFERENCE:
        raise InputError(
            f"trial {trial.name}: body_mass_kg is {sheet:g} in the sheet and {recorded:g} in the"
            " recording; correct the sheet, or leave its cell empty to use the recording's"
        )
    mass = sheet or recorded
    if not mass:
        return None
    if not BODY_MASSES_KG[0] <= mass <= BODY_MASSES_KG[1]:
        where = "sheet" if sheet else "recording"
        raise InputError(
            f"trial {trial.name}: a body mass of {mass:g} kg, from the {where}, is not one of a"
            " person; state body_mass_kg in the sheet, in kg"
        )
    return float(mass)


FEWEST_FRAMES = 10  # at rest, that tell where the platform stands


def differences(
    trial: Trial,
    passage: Passage,
    ankle: Ankle,
    calibration: StaticCalibration,
    settings: CrossingSettings,
) -> dict[str, float]:
    """Tell by how much [m] each thing stands otherwise in a crossing than in the static trial.

    Parameters
    ----------
    ankle : Ankle
        In the rows of the passage; its centre is the mean of the foot's and the shank's.
    """
    distances = {}
    before = passage.onset if passage.onset is not None else passage.stance.toe_off
    stands = (passage.frames >= passage.stance.heel_strike) & (passage.frames <= before)
    for segment, names in settings.markers.clusters.items():
        poses = passage.recorded[segment]
        rows = stands & poses.seen() & ~poses.bridged
        if not rows.any():
            continue
        _, tracks = marker_tracks(trial, names)
        reference = calibration.positions(names, trial.name)
        marker, distance_m = moved_marker(reference, tracks[rows], poses[rows])
        distances[f"marker {names[marker]} of the {segment}"] = distance_m

    inside = (passage.time >= passage.stance.heel_strike) & (passage.time <= before)
    of_foot = passage.poses["foot"].point(calibration.ankle_centre)
    apart = 2 * (of_foot - ankle.centre)[inside]  # the shank's centre is as far on the other side
    in_foot = np.einsum("nji,nj->ni", passage.poses["foot"].rotation[inside], apart)
    distances["the ankle between foot and shank"] = float(np.linalg.norm(in_foot.mean(axis=0)))

    in_static = calibration.corners.get(settings.plate)
    in_trial = recorded_plate(trial, settings.plate).get("corners")
    if in_static is not None and in_trial is not None:
        shift = np.asarray(in_trial) - in_static
        distances[f"the corners of force plate {settings.plate}"] = root_mean_square(shift)

    platform = passage.recorded["platform"]
    rests = (passage.frames < passage.stance.heel_strike) & platform.seen()
    if rests.sum() >= FEWEST_FRAMES:
        reference = calibration.positions(settings.markers.platform, trial.name)
        place = np.median(platform[rests].points(reference), axis=0)
        distances["the platform at rest"] = root_mean_square(place - reference)
    return distances


def root_mean_square(distances: Array) -> float:
    """RMS length of vectors (k, 3)."""
    return float(np.sqrt(np.mean(np.sum(distances**2, axis=1))))


FEWEST_ENCODER_SAMPLES = 30  # that overlap with the markers
LARGEST_DELAY_S = 0.05  # of the encoder, beyond which the clocks are not aligned
NEWTON_STEPS = 8


@dataclass(frozen=True)
class CrossingQuality:
    """Measures of one crossing; None where unknown. The dictionary says what each is."""

    foot_forward_m: float | None = None
    foot_left_m: float | None = None
    foot_outside_m: float | None = None
    pressure_outside_m: float | None = None
    encoder_rms_deg: float | None = None
    different: str | None = None
    different_mm: float | None = None


def crossing_quality(
    trial: Trial,
    passage: Passage,
    ankle: Ankle,
    load: LoadOnFoot,
    calibration: StaticCalibration,
    settings: CrossingSettings,
) -> CrossingQuality:
    """Measure the quality of a crossing that markers and plate recorded."""
    flat = phases_between(passage.stance.phase(passage.time), FLAT)
    foot = passage.poses["foot"][flat]
    plate_centre = passage.corners.mean(axis=0)
    from_plate = foot.point(calibration.ankle_centre).mean(axis=0) - plate_centre
    forward = unit_vector(ankle.forward[flat].mean(axis=0))
    left = np.cross(VERTICAL, forward)
    markers = foot.points(calibration.positions(settings.markers.foot, "static"))

    from_ankle = load.forward[:, None] * ankle.forward + load.left[:, None] * ankle.axis
    pressure = (ankle.centre + from_ankle)[flat]
    unlike_static = differences(trial, passage, ankle, calibration, settings)
    different = max(unlike_static, key=lambda what: unlike_static[what])
    return CrossingQuality(
        foot_forward_m=float(from_plate @ forward),
        foot_left_m=float(from_plate @ left),
        foot_outside_m=furthest_outside(markers.reshape(-1, 3), passage.corners),
        pressure_outside_m=pressure_outside(pressure, markers),
        encoder_rms_deg=compare_encoder(trial, passage.time, ankle.theta, settings.low_pass),
        different=different,
        different_mm=1e3 * unlike_static[different],
    )


def unit_vector(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))


def pressure_outside(pressure: Array, markers: Array) -> float:
    """Mean distance [m] of the centre of pressure (n, 3) [m] beyond the edges of the area between
    foot markers.

    Both are seen from above, the markers (n, m, 3) [m] at their mean place.
    """
    on_mean_foot = pressure - markers.mean(axis=1) + markers.mean(axis=(0, 1))
    hull = scipy.spatial.ConvexHull(markers.mean(axis=0)[:, :2])
    beyond = on_mean_foot[:, :2] @ hull.equations[:, :2].T + hull.equations[:, 2]
    return float(np.mean(np.maximum(beyond.max(axis=1), 0.0)))


def compare_encoder(trial: Trial, time: Array, theta: Array, low_pass: LowPass) -> float | None:
    """Compare the joint's encoder, a column of the trial, with the angle from markers.

    Both pass one low-pass, and encoder(t + delay) = theta(t) + offset.

    Parameters
    ----------
    time, theta : Array
        Times [s] and angle from markers [rad], (n,) each.

    Returns
    -------
    float or None
        RMS difference [deg]; None if fewer than 30 samples overlap.

    Raises
    ------
    InputError
        The encoder does not follow the markers.
    """
    if "theta" not in trial.columns:
        return None
    if trial.samples["theta"].count() < FEWEST_ENCODER_SAMPLES:
        return None
    encoder = uniform_signals(trial, ["theta"], GapLimits(cutoff_hz=low_pass.cutoff_hz))
    check_measured("the angle from markers", theta)
    check_measured("the encoder's angle", encoder["theta"])

    spare = LARGEST_DELAY_S + 1 / sampling_rate(time)
    inside = (time > encoder.time[0] + spare) & (time < encoder.time[-1] - spare)
    usable = np.interp(time, encoder.time, encoder.usable) == 1
    rows = inside & usable
    if rows.sum() < FEWEST_ENCODER_SAMPLES:
        return None
    spline = scipy.interpolate.make_interp_spline(
        encoder.time, low_pass(encoder["theta"], sampling_rate(encoder.time)), k=5
    )
    offset, delay = 0.0, 0.0
    for _ in range(NEWTON_STEPS):
        residual = spline(time[rows] + delay) - theta[rows] - offset
        columns = np.column_stack([np.ones(len(residual)), -spline(time[rows] + delay, 1)])
        change = np.linalg.lstsq(columns, residual, rcond=None)[0]
        offset += float(change[0])
        delay += float(change[1])
        if abs(delay) > LARGEST_DELAY_S:
            raise InputError(
                "the leg's joint encoder does not follow the angle from markers within"
                f" {LARGEST_DELAY_S * 1e3:g} ms; check the sync line, and which encoder and which"
                " sign the source file maps to theta"
            )

    residual = spline(time[rows] + delay) - theta[rows] - offset
    return float(np.rad2deg(np.sqrt(np.mean(residual**2))))


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
    torques = ankle_torques(passage, ankle, unloaded, calibration, settings)
    torque = torques.torque
    if settings.foot is not None:
        of_foot = settings.foot
        motion = rigid.body_motion(
            passage.time, foot, calibration.ankle_centre + of_foot.centre_of_mass_m
        )
        torque = torque + moment_of_foot(
            motion, ankle.centre, ankle.axis, of_foot.mass_kg, of_foot.inertia_kg_m2
        )

    # What shows that the set-up is right
    load = load_on_foot(torques.on_foot, torques.centre, ankle)
    force = torques.on_foot[:, :3]
    shear = np.array([np.sum(force * ankle.axis, axis=1), np.sum(force * ankle.forward, axis=1)])
    check_roll(phase, load, shear, torque if passage.onset is None else None)
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
        load=np.array([load.vertical, load.left, load.forward]),
        stance=passage.stance,
        onset=passage.onset,
        bridged=float(np.mean(bridged[passage.inside])),
        plate_errors=torques.plate_errors,
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
