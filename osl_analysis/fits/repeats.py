"""Mean, scatter and interval over repeated trials."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from osl_analysis.errors import InputError


@dataclass(frozen=True)
class Repeats:
    """Mean over n trials, standard deviation between them, standard error of the mean, 95 % interval (Student)."""

    n: int
    mean: float
    sd: float
    se: float
    low: float
    high: float


def over_repeats(values: ArrayLike) -> Repeats:
    """Summary of one estimate per trial, shape (n,), any unit.

    Raises
    ------
    InputError
        Fewer than two trials: scatter and interval need repeats.
    """
    values = np.asarray(values, dtype=float)
    if len(values) < 2:
        raise InputError(f"{len(values)} trial cannot give a scatter; repeat the experiment at least twice")
    mean, sd = float(np.mean(values)), float(np.std(values, ddof=1))
    se = sd / float(np.sqrt(len(values)))
    half = float(stdtrit(len(values) - 1, 0.975)) * se
    return Repeats(len(values), mean, sd, se, mean - half, mean + half)
