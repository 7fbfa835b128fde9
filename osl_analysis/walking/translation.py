"""A platform that shifts instead of turning."""

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.trial import Array
from osl_analysis.walking.cluster import Poses
from osl_analysis.walking.events import Stance

BEFORE_S = 0.1
"""Length [s] of the interval before heel strike in which the platform rests."""


def platform_shift(time: Array, platform: Poses, stance: Stance) -> float:
    """Largest shift [m] of the platform's markers in stance, from their mean place just before heel strike.

    Where they are hidden before heel strike, from their place at the start of stance. NaN if they are always hidden.
    """
    seen, centre = platform.seen(), platform.position
    inside = seen & (time >= stance.heel_strike) & (time <= stance.toe_off)
    if not inside.any():
        return float("nan")
    before = seen & (time >= stance.heel_strike - BEFORE_S) & (time < stance.heel_strike)
    rest = centre[before].mean(axis=0) if before.any() else centre[inside][0]
    return float(np.linalg.norm(centre[inside] - rest, axis=1).max())


def check_translation(time: Array, platform: Poses, stance: Stance, largest: float) -> None:
    """Refuse a platform that does not turn, but shifts by more than `largest` [m] in stance.

    It is no unperturbed crossing. It is not analysed as a perturbed one either: onset, direction and shape of a
    perturbation are those of the platform's turn, and the ankle turns by what the leg does, late and little, instead of
    by what the platform does.

    Raises
    ------
    InputError
        Names the shift.
    """
    shift = platform_shift(time, platform, stance)
    if shift > largest:
        raise InputError(
            f"the platform shifts by {1e3 * shift:.0f} mm in stance without a turn, expected {1e3 * largest:g} mm or "
            "less: a translation is neither an unperturbed crossing nor a turn of the ankle, and is not analysed; give "
            "the trial the experiment ingest_only, or correct largest_shift_mm"
        )
