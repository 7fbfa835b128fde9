"""Checks of the laboratory's set-up against one crossing: axes, side, corners, sheet, body mass."""

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.trial import AXES, Array, Trial
from osl_analysis.walking.ankle import VERTICAL, LoadOnFoot
from osl_analysis.walking.poses import Mask
from osl_analysis.walking.stance import Stance
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


def check_vertical(force: Array) -> None:
    """Refuse a load (n, 3) [N] that does not act along +z."""
    size = np.linalg.norm(force, axis=1)
    if not size.any():
        return
    mean = force[size > 0.5 * size.max()].mean(axis=0)
    axis = int(np.argmax(np.abs(mean)))
    if axis == 2 and mean[2] > 0:
        return
    sign = "-" if mean[axis] < 0 else "+"
    raise InputError(
        f"the load on the plate acts along {sign}{AXES[axis]} ({mean[axis]:.0f} N), expected +z:"
        " correct `sign` or the plate's corners in the source file, or state `axes`, as"
        " [x, -z, y] where y points up"
    )


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
    pressure = np.array([load.left, load.forward])
    left, forward = pressure[:, late].mean(axis=1) - pressure[:, flat].mean(axis=1)
    push_left, push_forward = shear[:, late].mean(axis=1) - shear[:, flat].mean(axis=1)
    roll_m = np.hypot(left, forward)
    push_n = np.hypot(push_left, push_forward)
    roll_deg = abs(float(np.rad2deg(np.arctan2(left, forward))))
    push_deg = abs(float(np.rad2deg(np.arctan2(push_left, push_forward))))

    moment = 0.0
    if torque is not None:
        moment = float(torque[phases_between(phase, PUSH)].mean())
    rolls_forward = roll_deg <= LARGEST_OUT_TOEING_DEG or roll_m < SMALLEST_ROLL_M
    if moment >= 0 and rolls_forward:
        return

    observed = f"the centre of pressure moves by {100 * roll_m:.0f} cm in stance"
    if roll_deg > LARGEST_OUT_TOEING_DEG:
        observed += f", {roll_deg:.0f} deg from forward"
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


def check_onset(
    onset: float | None, perturbed: bool, stance: Stance, settings: CrossingSettings
) -> None:
    """Refuse an onset [s] that the sheet contradicts, or whose response leaves stance."""
    if (onset is not None) != perturbed:
        raise InputError(
            f"the platform {'turns' if perturbed is False else 'does not turn'}, but the sheet says"
            f" perturbed = {str(perturbed).lower()}; correct the sheet, perturbation_deg or the"
            " platform markers, or exclude the trial"
        )
    if onset is None:
        return
    span = f"stance {stance.heel_strike:.3f}-{stance.toe_off:.3f} s"
    if not stance.heel_strike < onset < stance.toe_off:
        raise InputError(
            f"the perturbation starts at {onset:.3f} s, outside {span}; exclude the trial"
        )
    first = onset - settings.guard_s - settings.baseline_s
    last = onset + settings.window_s
    if first < stance.heel_strike or last > stance.toe_off:
        raise InputError(
            f"baseline and window, {first:.3f}-{last:.3f} s, leave {span}; shorten window_s,"
            " baseline_s or guard_s, or exclude the trial"
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
