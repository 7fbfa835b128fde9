"""The uncertainty of one estimate: what contributes to it, and the half-width of all of it.

Every printed 95 % interval of a fit is made here, by JCGM 100:2008: independent contributions add
as variances (5.1.2), and Student's quantile has the degrees of freedom of their sum (G.4).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike

from osl_analysis.measured import LARGEST_VARIANCE, check_finite
from osl_analysis.trial import Array

MOST_FREEDOM = 1e12  # degrees of freedom
NORMAL_HALF_WIDTH = 1.959964  # standard errors of a 95 % interval where their size is known

Part = Literal["repeatability", "sensor", "bench", "motion", "fault"]
"""repeatability: the scatter of this recording; sensor: encoder and rounding; bench: what is stated
or assumed of it; motion: half of the range over amplitudes and frequencies; fault: what a fault of
the recording would do. The last two are in no interval."""
Basis = Literal["measured", "stated", "assumed", "bound", "weighed"]
NOT_IN_INTERVAL = ("motion", "fault")


@dataclass(frozen=True)
class KnownError:
    """An error of p estimates whose size is known, and that no scatter shows (type B)."""

    source: str
    change: Array  # (p,) change of the estimates by one standard uncertainty
    shared: bool  # whether all trials on a bench have it


@dataclass(frozen=True)
class Contribution:
    """What one source does to one estimate, in its unit; a row of `budget.csv`."""

    source: str
    standard: float  # standard uncertainty
    freedom: float = np.inf  # degrees of freedom of its variance
    basis: Basis = "stated"
    part: Part = "bench"
    shared: bool = False  # whether all trials on a bench have it


def half_width(contributions: Sequence[Contribution]) -> float:
    """Half of the 95 % interval of an estimate, by what contributes to it."""
    variances = [each.standard**2 for each in contributions if each.part not in NOT_IN_INTERVAL]
    freedoms = [each.freedom for each in contributions if each.part not in NOT_IN_INTERVAL]
    if not variances:
        return 0.0
    quantile = scipy.special.stdtrit(welch_satterthwaite(variances, freedoms), 0.975)
    return float(quantile * np.sqrt(sum(variances)))


def welch_satterthwaite(
    variances: Sequence[ArrayLike] | Array, degrees_of_freedom: ArrayLike
) -> Array:
    """Find the degrees of freedom of a sum of k independent variances (Satterthwaite, Biometrics
    Bulletin 2, 1946; Welch, Biometrika 34, 1947).

    Parameters
    ----------
    variances : (k, ...)
        The summands.
    degrees_of_freedom : (k,) or (k, ...)
        Of each.

    Returns
    -------
    Array (...)
        Infinite where all variances are zero, or the uncertain ones vanish beside the others: the
        rounding of a sum would decide on more than `MOST_FREEDOM`.

    Raises
    ------
    InputError
        A variance is not finite or beyond `LARGEST_VARIANCE`.
    """
    summands = np.asarray(variances, dtype=float)
    check_finite("the variance", summands, LARGEST_VARIANCE)
    certainty = 1 / np.asarray(degrees_of_freedom, dtype=float)
    if certainty.ndim < summands.ndim:
        certainty = certainty.reshape(-1, *[1] * (summands.ndim - 1))
    uncertainty = np.sum(certainty * summands**2, axis=0)
    square_of_sum = np.sum(summands, axis=0) ** 2
    is_finite = uncertainty > square_of_sum / MOST_FREEDOM
    infinite = np.full_like(square_of_sum, np.inf)
    return np.divide(square_of_sum, uncertainty, out=infinite, where=is_finite)
