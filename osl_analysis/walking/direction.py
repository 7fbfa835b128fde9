"""In which direction the platform turned the ankle, from the platform's markers."""

import numpy as np
from scipy.spatial.transform import Rotation

from osl_analysis.errors import InputError
from osl_analysis.trial import Array
from osl_analysis.walking.cluster import Poses

UP, DOWN = "up", "down"
"""Names of the directions in sheet and tables: toes up (dorsiflexion), and toes down."""


def platform_turn(time: Array, platform: Poses, axis: Array, window: tuple[float, float]) -> float:
    """Largest turn [rad] of the platform about the ankle's axis within a `window` [s]; toes up is positive.

    `platform` has n poses at `time` (n,) [s], `axis` (n, 3) is the ankle's in the laboratory, to the person's left: a
    positive rotation about it turns the toes down. The turn is from the last pose before the window, in the laboratory,
    so that it does not matter how the platform stood in the static trial or which way the person walks.
    """
    start = max(int(np.searchsorted(time, window[0])) - 1, 0)
    rows = slice(start, int(np.searchsorted(time, window[1], side="right")))
    since = platform.rotation[rows] @ platform.rotation[start].T
    turns = -Rotation.from_matrix(since).as_rotvec() @ axis[start]
    return float(turns[np.argmax(np.abs(turns))])


def check_direction(trial: str, stated: str | None, turn: float | None) -> None:
    """Refuse a direction in the sheet that is not that of the measured `turn` [rad, toes up].

    Raises
    ------
    InputError
        They differ.
    """
    if stated is None or turn is None or (turn > 0) == (stated == UP):
        return
    measured = UP if turn > 0 else DOWN
    raise InputError(
        f"trial {trial}: the platform turned by {np.rad2deg(turn):.1f} deg (positive: toes up), but the sheet says "
        f"direction '{stated}', expected '{measured}'; correct the sheet, or exclude the trial"
    )
