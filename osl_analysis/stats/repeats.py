"""Mean, scatter and interval over repeated trials."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from osl_analysis.errors import InputError
from osl_analysis.stats.degrees_of_freedom import welch_satterthwaite


@dataclass(frozen=True)
class Repeats:
    """Mean over n trials, standard deviation between them, standard error and 95 % interval of the mean (Student)."""

    n: int
    mean: float
    sd: float
    se: float
    low: float
    high: float


@dataclass(frozen=True)
class CommonError:
    """An error that all trials share, and that their scatter does not show: its variance, and what that is worth."""

    variance: float
    degrees_of_freedom: float


def over_repeats(values: ArrayLike, common: Sequence[CommonError] = ()) -> Repeats:
    """Summary of one estimate per trial, shape (n,), any unit; standard error and interval count in what is `common`.

    Raises
    ------
    InputError
        Fewer than two trials: scatter and interval need repeats.
    """
    values = np.asarray(values, dtype=float)
    if len(values) < 2:
        raise InputError(f"{len(values)} trial cannot give a scatter; repeat the experiment at least twice")
    mean, sd = float(np.mean(values)), float(np.std(values, ddof=1))
    variances = [sd**2 / len(values), *(error.variance for error in common)]
    freedom = welch_satterthwaite(variances, [len(values) - 1, *(error.degrees_of_freedom for error in common)])
    se = float(np.sqrt(sum(variances)))
    half = float(stdtrit(freedom, 0.975)) * se
    return Repeats(len(values), mean, sd, se, mean - half, mean + half)
