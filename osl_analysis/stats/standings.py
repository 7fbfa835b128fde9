"""Rival models over trials: mean scores with intervals, paired differences, and which models can be told apart."""

from dataclasses import replace

import numpy as np

from osl_analysis.stats.repeats import Repeats, over_repeats
from osl_analysis.trial import Array

PREFERRED, TIED, WORSE = "preferred", "tied", "worse"


def over_trials(values: Array, shared: bool = False) -> Repeats:
    """Mean of one value per trial, (n,), any unit, with Student's interval; of one trial, or none, only what there is.

    `shared`: each value was found with a fit to all the other trials. Such values depend on one another, with a
    correlation of 1/n: the variance of their mean is s^2 (1/n + 1/(n - 1)), with the n - 1 degrees of freedom of their
    one scatter s (Nadeau and Bengio, Mach. Learn. 52, 2003).
    """
    n = len(values)
    if n < 2:
        return Repeats(n, float(values[0]) if n else np.nan, *[np.nan] * 4)
    own = over_repeats(values)
    wider = float(np.sqrt(1 + n / (n - 1))) if shared else 1.0
    half = wider * (own.high - own.mean)
    return replace(own, se=wider * own.se, low=own.mean - half, high=own.mean + half)


def behind_best(loss: Array) -> Array:
    """By how much each loss (trials, models) exceeds, in the same trial, that of the model of the smallest mean."""
    return loss - loss[:, [int(np.argmin(loss.mean(axis=0)))]] if len(loss) else loss


def verdicts(loss: Array, shared: bool = False) -> list[str | None]:
    """A word per model on losses (trials, models), smaller is better, the simplest model first.

    A model is tied with the best where the interval of their paired difference holds zero; the first of those that are
    tied is preferred: what is more complicated has to show that it is better. None without trials.
    """
    if not len(loss):
        return [None] * loss.shape[1]
    tied = [not over_trials(behind, shared).low > 0 for behind in behind_best(loss).T]
    words: list[str | None] = [TIED if as_good else WORSE for as_good in tied]
    words[tied.index(True)] = PREFERRED
    return words
