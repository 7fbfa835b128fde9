"""Mean, scatter and interval over repeated trials."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from osl_analysis.errors import InputError


@dataclass(frozen=True)
class Repeats:
    """Mean over n trials, standard deviation between them, standard error and 95 % interval of the mean (Student)."""

    n: int
    mean: float
    sd: float
    se: float
    low: float
    high: float


def over_repeats(values: ArrayLike, common_variance: float = 0.0, common_count: int = 2) -> Repeats:
    """Summary of one estimate per trial, shape (n,), any unit.

    An error that all trials have in common does not show in their scatter: `common_variance` is its variance, found
    from `common_count` repetitions. Degrees of freedom then after Welch and Satterthwaite.

    Raises
    ------
    InputError
        Fewer than two trials: scatter and interval need repeats.
    """
    values = np.asarray(values, dtype=float)
    if len(values) < 2:
        raise InputError(f"{len(values)} trial cannot give a scatter; repeat the experiment at least twice")
    mean, sd = float(np.mean(values)), float(np.std(values, ddof=1))
    own, freedom = sd**2 / len(values), len(values) - 1.0
    se = float(np.sqrt(own + common_variance))
    if common_variance > 0:
        freedom = se**4 / (own**2 / freedom + common_variance**2 / (common_count - 1))
    half = float(stdtrit(freedom, 0.975)) * se
    return Repeats(len(values), mean, sd, se, mean - half, mean + half)
