"""Weights of the hypotheses by prediction.

The weight of a hypothesis is its prior times the exponential of what it gains in prediction,
averaged over a Bayesian bootstrap of the blocks (pseudo-BMA+: Yao, Vehtari, Simpson and Gelman,
Bayesian Analysis 13, 2018). The gain is divided by a *temper*, since two things are not noise:

* rounding, which alone would give some hypothesis a gain;
* that no mechanism is exactly its formula: it misses `INEXACTNESS` of its own torque.

"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from osl_analysis.inference.constants import (
    BLOCKS,
    BOOTSTRAP_DRAWS,
    INEXACTNESS,
    PRIOR_FRICTION,
    PRIOR_SOUND,
)
from osl_analysis.inference.cross_validation import Predicted
from osl_analysis.inference.hypothesis import Family
from osl_analysis.trial import Array

FAMILIES: tuple[Family, ...] = (
    "path",
    "time",
    "speed",
    "size",
    "direction",
    "clipping",
)
PLAIN = "nothing"  # the hypothesis that is Eq. 15 alone
SEED = 1  # of the bootstrap: the same recording gives the same numbers


@dataclass(frozen=True)
class Weighed:
    """A hypothesis with its weight among all.

    Attributes
    ----------
    fit : Predicted
        The hypothesis, with or without friction.
    weight : float
        Its probability, given that one of those that compete is right.
    """

    fit: Predicted
    weight: float

    @property
    def family(self) -> Family:
        """Family of the hypothesis; empty if nothing is at fault."""
        return self.fit.candidate.hypothesis.family

    @property
    def impedance(self) -> Array:
        """Mean of the K, B, I (3,) that it has."""
        return np.asarray(self.fit.impedances.mean(axis=0))


def log_prior(fits: Sequence[Predicted]) -> Array:
    """Logarithms (h,) of the prior probabilities.

    Families share what is not sound evenly, and so do hypotheses within a family.
    """
    members = {(fit.candidate.hypothesis.family, fit.candidate.hypothesis.name) for fit in fits}
    of_family = Counter(family for family, _ in members)
    found = []
    for fit in fits:
        family = fit.candidate.hypothesis.family
        prior = PRIOR_SOUND if family == "" else (1 - PRIOR_SOUND) / len(FAMILIES)
        prior /= of_family[family]
        prior *= PRIOR_FRICTION if fit.has_friction else 1 - PRIOR_FRICTION
        found.append(np.log(prior))
    return np.array(found)


def log_positive(impedance: Array, covariance: Array) -> float:
    """Logarithm of the probability that B and I are positive, as those of a body are."""
    deviations = np.sqrt(np.diag(covariance))[1:]
    return float(np.sum(scipy.special.log_ndtr(impedance[1:] / deviations)))


def weigh(
    fits: Sequence[Predicted], freedom: float, is_body: bool = True
) -> tuple[list[Weighed], int]:
    """Weigh hypotheses by prediction; with the number of the sound one that predicts best.

    Parameters
    ----------
    fits : sequence of Predicted
        Hypotheses beside friction, or not.
    freedom : float
        Number of independent rows.
    is_body : bool
        Whether B and I are those of a body, and positive. A powered leg's may be negative.
    """
    possible = [fit for fit in fits if fit.is_possible and np.isfinite(fit.squares).all()]
    # what friction takes up of rounding alone is no gain
    plain = {fit.has_friction: fit for fit in fits if fit.candidate.hypothesis.name == PLAIN}
    of_friction = max(plain[False].rounding_left - plain[True].rounding_left, 0.0)
    squares = np.array([fit.squares for fit in possible])
    squares[[fit.has_friction for fit in possible]] += of_friction / BLOCKS
    totals = squares.sum(axis=1)
    is_sound = np.array([fit.candidate.hypothesis.family == "" for fit in possible])
    best = int(np.argmin(totals))
    best_sound = int(np.argmin(np.where(is_sound, totals, np.inf)))

    # by how many nats each predicts each block better than the best sound one
    noise = max(float(totals[best]) / freedom, 1.0)
    gains_of_blocks = (squares[best_sound] - squares) / 2 / noise
    draws = np.random.default_rng(SEED).dirichlet(np.ones(BLOCKS), BOOTSTRAP_DRAWS) * BLOCKS
    gains = draws @ gains_of_blocks.T

    # the temper of each draw: rounding is no noise, and a mechanism that misses a share e of its
    # own torque leaves e^2 of what it explains, which is twice the gain
    of_rounding = possible[best_sound].rounding_left - possible[best].rounding_left
    gain_over_sound = gains.max(axis=1) - gains[:, is_sound].max(axis=1)
    temper = 1 + max(of_rounding, 0.0) / noise + INEXACTNESS**2 * 2 * gain_over_sound

    prior = log_prior(possible)
    if is_body:
        prior += [log_positive(fit.impedances[0], fit.covariance) for fit in possible]
    log_weights = prior + gains / temper[:, None]
    weights = np.exp(log_weights - log_weights.max(axis=1, keepdims=True))
    weights /= weights.sum(axis=1, keepdims=True)
    probabilities = weights.mean(axis=0).tolist()
    weighed = [Weighed(fit, weight) for fit, weight in zip(possible, probabilities, strict=True)]
    return weighed, best_sound
