"""What a laboratory's set-up must have right: axes and side, encoder, direction, shift of the platform, body mass."""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.measured import check_measured
from osl_analysis.signals import LowPass, sampling_rate
from osl_analysis.timebase.grid import GapLimits, uniform_signals
from osl_analysis.trial import AXES, Array, Trial
from osl_analysis.walking.bodies import Poses
from osl_analysis.walking.plate import Stance

SIDE_REMEDY = (
    "correct `side`, exchange ankle_medial and ankle_lateral, or correct the labels of the static trial's markers"
)


def check_vertical(force: Array) -> None:
    """Refuse a load (n, 3) [N] that does not act along +z."""
    size = np.linalg.norm(force, axis=1)
    if not size.any():
        return
    mean = force[size > 0.5 * size.max()].mean(axis=0)
    axis = int(np.argmax(np.abs(mean)))
    if axis == 2 and mean[2] > 0:
        return
    along = f"{'-' if mean[axis] < 0 else '+'}{AXES[axis]}"
    remedy = {
        "+y": "its vertical axis is y; state `axes: [x, -z, y]` in the source file",
        "-z": "the force is of the other sign; correct `sign` or the plate's corners in the source file",
    }.get(along, "state `axes` in the source file, so that z points up")
    raise InputError(f"the load on the plate acts along {along} ({mean[axis]:.0f} N), expected +z: {remedy}")


def check_heading(phase: Array, shank_from_ankle: Array, axis: Array) -> None:
    """Refuse a shank, `shank_from_ankle` (n, 3) [m], that leans backwards from a tenth to nine tenths of stance, seen
    along the ankle's axis (n, 3), which should point to the left."""
    forward = np.cross(axis, [0.0, 0.0, 1.0])
    first, last = (int(np.argmin(np.abs(phase - edge))) for edge in (0.1, 0.9))
    ahead = np.sum(shank_from_ankle * forward, axis=1)
    if ahead[last] <= ahead[first]:
        raise InputError(
            f"the shank moves {100 * (ahead[first] - ahead[last]):.0f} cm backwards over the foot in stance: the "
            f"ankle's axis points to the wrong side; {SIDE_REMEDY}"
        )


def check_push(phase: Array, torque: Array) -> None:
    """Refuse an ankle torque (n,) [N*m] that pulls the toes up in late stance, where every foot pushes."""
    mean = float(torque[(phase >= 0.5) & (phase <= 0.9)].mean())
    if mean < 0:
        raise InputError(
            f"the ankle's moment in late stance is {mean:.0f} N*m, expected a plantarflexion moment above 0: "
            f"{SIDE_REMEDY}; or correct the plate's corners and channels"
        )


LARGEST_DELAY_S = 0.05  # Largest delay [s] between the clocks; beyond it they are not aligned
FEWEST_COMPARED = 30


@dataclass(frozen=True)
class EncoderCheck:
    """The encoder's angle minus the markers': offset [rad], delay [s] (positive if the encoder's clock is late), and
    RMS [rad] of the difference that remains."""

    offset: float
    delay: float
    rms: float


def compare_encoder(
    time: Array,
    theta: Array,
    encoder_time: Array,
    encoder: Array,
    low_pass: LowPass,
    usable: NDArray[np.bool_] | None = None,
) -> EncoderCheck | None:
    """The angle (n,) [rad] at `time` [s] and the encoder's (k,) at uniform stamps, where `usable` (k,), through one
    low-pass: least squares of theta_encoder(t + delay) = theta(t) + offset; None if fewer than 30 samples overlap."""
    check_measured("the angle from markers", theta)
    check_measured("the encoder's angle", encoder)
    spare = LARGEST_DELAY_S + 1 / sampling_rate(time)
    rows = (time > encoder_time[0] + spare) & (time < encoder_time[-1] - spare) if len(encoder_time) else time < -1
    if usable is not None and len(encoder_time):
        rows &= np.interp(time, encoder_time, usable) == 1
    if rows.sum() < FEWEST_COMPARED:
        return None
    spline = scipy.interpolate.make_interp_spline(encoder_time, low_pass(encoder, sampling_rate(encoder_time)), k=5)
    offset, delay = 0.0, 0.0
    for _ in range(8):  # by Newton
        difference = spline(time[rows] + delay) - theta[rows] - offset
        columns = np.column_stack([np.ones(len(difference)), -spline(time[rows] + delay, 1)])
        change = np.linalg.lstsq(columns, difference, rcond=None)[0]
        offset, delay = offset + float(change[0]), delay + float(change[1])
        if abs(delay) > LARGEST_DELAY_S:
            raise InputError(
                f"the leg's joint encoder does not follow the angle from markers within {LARGEST_DELAY_S * 1e3:g} ms; "
                "check the sync line, and which encoder and which sign the source file maps to theta"
            )
    difference = spline(time[rows] + delay) - theta[rows] - offset
    return EncoderCheck(offset, delay, float(np.sqrt(np.mean(difference**2))))


def encoder_check(trial: Trial, time: Array, theta: Array, low_pass: LowPass) -> EncoderCheck | None:
    """The leg's joint encoder compared with the angle (n,) [rad] from markers; None in a trial without one."""
    samples = trial.samples
    if "theta" not in samples.columns or samples["theta"].count() < FEWEST_COMPARED:
        return None
    own = uniform_signals(trial, ["theta"], GapLimits(cutoff_hz=low_pass.cutoff_hz))
    return compare_encoder(time, theta, own.time, own["theta"], low_pass, own.usable)


UP, DOWN = "up", "down"  # Names of the directions in sheet and tables: toes up (dorsiflexion), and toes down


def platform_turn(time: Array, platform: Poses, axis: Array, window: tuple[float, float]) -> float:
    """Largest turn [rad] of the platform about the ankle's axis (n, 3), toes up positive, within a `window` [s], from
    the last of its n poses before it: where it stood in the static trial does not matter."""
    start = max(int(np.searchsorted(time, window[0])) - 1, 0)
    rows = slice(start, int(np.searchsorted(time, window[1], side="right")))
    since = platform.rotation[rows] @ platform.rotation[start].T
    turns = -scipy.spatial.transform.Rotation.from_matrix(since).as_rotvec() @ axis[start]
    return float(turns[np.argmax(np.abs(turns))])


def check_direction(trial: str, stated: str | None, turn: float | None) -> None:
    """Refuse a direction in the sheet that is not that of the measured `turn` [rad, toes up]."""
    if stated is None or turn is None or (turn > 0) == (stated == UP):
        return
    measured = UP if turn > 0 else DOWN
    raise InputError(
        f"trial {trial}: the platform turned by {np.rad2deg(turn):.1f} deg (positive: toes up), but the sheet says "
        f"direction '{stated}', expected '{measured}'; correct the sheet, or exclude the trial"
    )


def check_translation(time: Array, platform: Poses, stance: Stance, largest: float) -> None:
    """Refuse a platform that does not turn, but shifts by more than `largest` [m] in stance, from its mean place just
    before, or, hidden there, at its start: it is no unperturbed crossing, and the ankle turns late and little."""
    seen, centre = platform.seen(), platform.position
    inside = seen & (time >= stance.heel_strike) & (time <= stance.toe_off)
    if not inside.any():
        return
    before = seen & (time >= stance.heel_strike - 0.1) & (time < stance.heel_strike)
    rest = centre[before].mean(axis=0) if before.any() else centre[inside][0]
    shift = float(np.linalg.norm(centre[inside] - rest, axis=1).max())
    if shift > largest:
        raise InputError(
            f"the platform shifts by {1e3 * shift:.0f} mm in stance without a turn, expected {1e3 * largest:g} mm or "
            "less: a translation is neither an unperturbed crossing nor a turn of the ankle, and is not analysed; give "
            "the trial the experiment ingest_only, or correct largest_shift_mm"
        )


def body_mass(trial: Trial, sheet: float | None, configured: float | None = None) -> float | None:
    """Body mass [kg] of a trial: the sheet's, else the recording's, else the campaign's configured one; None without
    any. A recording that states 0 states none."""
    recorded = trial.provenance.get("mocap", {}).get("body_mass_kg") or None
    if sheet and recorded and abs(sheet / recorded - 1) > 0.1:  # clothes, shoes and leg weigh something
        raise InputError(
            f"trial {trial.name}: body_mass_kg is {sheet:g} in the sheet and {recorded:g} in the recording; correct "
            "the sheet, or leave its cell empty to use the recording's"
        )
    mass = sheet or recorded or configured
    if mass and not 10 <= mass <= 300:
        where = "sheet" if sheet else "recording" if recorded else "configuration"
        raise InputError(
            f"trial {trial.name}: a body mass of {mass:g} kg, from the {where}, is not one of a person; state "
            "body_mass_kg in the sheet, in kg"
        )
    return float(mass) if mass else None
