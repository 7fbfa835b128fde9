"""Whether the laboratory's axes, the leg's side and the malleoli are as the analysis takes them to be."""

import numpy as np

from osl_analysis.columns import AXES
from osl_analysis.errors import InputError
from osl_analysis.trial import Array

LOADED = 0.5
"""Share of the largest force above which a sample counts as loaded."""
FIRST, LAST = 0.1, 0.9
"""Phases of stance between which the shank leans forward."""
LATE = (0.5, 0.9)
"""Phases of stance in which the foot pushes: the internal moment is a plantarflexion moment in every gait."""
SIDE_REMEDY = (
    "correct `side`, exchange ankle_medial and ankle_lateral, or correct the labels of the static trial's markers"
)


def check_vertical(force: Array) -> None:
    """Refuse a load (n, 3) [N] that does not act along +z.

    Raises
    ------
    InputError
        Names the axis along which the load acts, and `axes` of the source file that turns it up.
    """
    size = np.linalg.norm(force, axis=1)
    if not size.any():
        return
    mean = force[size > LOADED * size.max()].mean(axis=0)
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
    """Refuse a shank that leans backwards over stance, seen along the ankle's axis: the axis points to the right.

    phase: of stance (n,).
    shank_from_ankle: a point of the shank minus the ankle (n, 3) [m].
    axis: the ankle's axis (n, 3), to the left.

    Raises
    ------
    InputError
        The side is wrong, or the malleoli are exchanged.
    """
    forward = np.cross(axis, [0.0, 0.0, 1.0])
    first, last = (int(np.argmin(np.abs(phase - edge))) for edge in (FIRST, LAST))
    ahead = np.sum(shank_from_ankle * forward, axis=1)
    if ahead[last] <= ahead[first]:
        raise InputError(
            f"the shank moves {100 * (ahead[first] - ahead[last]):.0f} cm backwards over the foot in stance: the "
            f"ankle's axis points to the wrong side; {SIDE_REMEDY}"
        )


def check_push(phase: Array, torque: Array) -> None:
    """Refuse an ankle torque (n,) [N*m] that pulls the toes up in late stance.

    Raises
    ------
    InputError
        Side, malleoli, plate or its corners are wrong.
    """
    mean = float(torque[(phase >= LATE[0]) & (phase <= LATE[1])].mean())
    if mean < 0:
        raise InputError(
            f"the ankle's moment in late stance is {mean:.0f} N*m, expected a plantarflexion moment above 0: "
            f"{SIDE_REMEDY}; or correct the plate's corners and channels"
        )
