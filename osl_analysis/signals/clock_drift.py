"""The drift between the clocks of two devices, as a fit of both signals shows it."""

import numpy as np
import scipy

from osl_analysis.errors import InputError

# columns of a drift, where none can be seen
NO_DRIFT = dict.fromkeys(("clock_drift_ppm", "clock_drift_se_ppm", "certain_clock_drift_ppm"))
CERTAIN_ERRORS = 4.0  # exact standard errors beyond which a drift is certain


def drift_row(ppm: float, se: float, freedom: float, largest_ppm: float) -> dict[str, float]:
    """Say whether a drift between the clocks of angle and torque is certain.

    Parameters
    ----------
    ppm, se : float
        How much faster the torque's clock runs than the angle's, and its standard error [ppm].
    freedom : float
        Degrees of freedom of the standard error. Certain is as improbable by Student's t as 4 exact
        standard errors.
    largest_ppm : float
        Largest certain drift that is not refused [ppm].

    Returns
    -------
    dict
        Columns of `NO_DRIFT` [ppm]; the certain drift is 0 if it is not certain.

    Raises
    ------
    InputError
        A certain drift beyond `largest_ppm`, which would make B and I wrong.
    """
    errors = CERTAIN_ERRORS
    if not np.isinf(freedom):
        probability = float(scipy.special.ndtr(-CERTAIN_ERRORS))
        errors = float(-scipy.special.stdtrit(freedom, probability))
    certain_ppm = ppm if abs(ppm) > errors * se else 0.0
    if abs(certain_ppm) > largest_ppm:
        raise InputError(
            f"the clocks of angle and torque drift apart by {ppm:.2f} +- {se:.2f} ppm, more than"
            f" {largest_ppm:g}: B and I would be wrong; synchronise the clocks, or record both"
            " channels with one device"
        )
    return {
        "clock_drift_ppm": ppm,
        "clock_drift_se_ppm": se,
        "certain_clock_drift_ppm": certain_ppm,
    }
