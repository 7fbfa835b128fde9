"""Weights of the hypotheses by prediction.

The weight of a hypothesis is its prior times the exponential of what it gains in prediction,
averaged over a Bayesian bootstrap of the blocks (pseudo-BMA+: Yao, Vehtari, Simpson and Gelman,
Bayesian Analysis 13, 2018). The gain is divided by a *temper*, since two things are not noise:

* rounding, which alone would give some hypothesis a gain;
* that no mechanism is exactly its formula: it misses `INEXACTNESS` of its own torque.

"""

from collections import Counter
from collections.abc import Mapping, Sequence
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
LATE: tuple[Family, ...] = ("path", "time")  # families with a torque that is late
PLAIN = "nothing"  # the hypothesis that is Eq. 15 alone
SEED = 1  # of the bootstrap: the same recording gives the same numbers


@dataclass(frozen=True)
class Part:
    """One of the values that K, B and I of a hypothesis may have."""

    weight: float
    impedance: Array  # K, B, I (3,) [SI]


@dataclass(frozen=True)
class Weighed:
    """A hypothesis with its weight among all.

    Attributes
    ----------
    fit : Predicted
        The hypothesis, with or without friction.
    weight : float
        Its probability, given that one of those that compete is right.
    parts : tuple of Part
        What K, B and I may be, or its own parameter's values; their weights have the sum 1.
    """

    fit: Predicted
    weight: float
    parts: tuple[Part, ...]

    @property
    def family(self) -> Family:
        """Family of the hypothesis; empty if nothing is at fault."""
        return self.fit.candidate.hypothesis.family

    @property
    def impedance(self) -> Array:
        """Mean K, B, I (3,) of its parts."""
        return np.asarray(sum(part.weight * part.impedance for part in self.parts))


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


@dataclass(frozen=True)
class Evidence:
    """What the predictions of some hypotheses say together.

    Attributes
    ----------
    block_gains : Array (h, BLOCKS)
        By how many nats each hypothesis predicts each block better than the reference.
    reference : int
        The sound joint that predicts best.
    rounding : float
        1, and the squares that rounding alone would give the best hypothesis, over the noise.
    sound : Array (h,) of bool
        Which hypotheses are no fault.
    """

    block_gains: Array
    reference: int
    rounding: float
    sound: Array

    def tempers(self, gains: Array) -> Array:
        """What to divide gains (..., h) by, for each draw of blocks."""
        best = gains.max(axis=-1)
        best_sound = gains[..., self.sound].max(axis=-1)
        return temper(best - best_sound, self.rounding)


def temper(gain: Array, rounding: float) -> Array:
    """What to divide a gain [nat] by: rounding is no noise, and no formula is exact.

    A mechanism that misses a share e of its own torque leaves e^2 of what it explains, which is
    twice the gain. So evidence saturates at 1/(2 e^2) nats.
    """
    return np.asarray(rounding + INEXACTNESS**2 * 2 * np.maximum(gain, 0.0))


def evidence_of(
    fits: Sequence[Predicted], noise: float, plain_rounding: Mapping[bool, float]
) -> Evidence:
    """Compare the predictions of hypotheses with those of the best sound one among them.

    What friction would gain by rounding alone does not count.

    Parameters
    ----------
    fits : sequence of Predicted
        The hypotheses.
    noise : float
        Variance of what the best of all leaves.
    plain_rounding : Mapping
        Sum of squares that Eq. 15 leaves of rounding alone, without and with friction, even where
        that friction drives: a late torque makes Eq. 15 look so, and a path is compared beside the
        same friction, too.
    """
    by_friction = {
        has_friction: max(plain_rounding[False] - left, 0.0)
        for has_friction, left in plain_rounding.items()
    }
    squares = np.array([fit.squares + by_friction[fit.has_friction] / BLOCKS for fit in fits])
    totals = squares.sum(axis=1)
    sound = np.array([fit.candidate.hypothesis.family == "" for fit in fits])
    reference = int(np.argmin(np.where(sound, totals, np.inf)))
    gains = (squares[reference] - squares) / 2 / noise

    # rounding is compared beside the same friction, which takes up rounding, too
    best = fits[int(np.argmin(totals))]
    friction_is_possible = any(
        is_plain(fit) and fit.has_friction == best.has_friction for fit in fits
    )
    of_sound = fits[reference].rounding_left
    if friction_is_possible or best.candidate.hypothesis.family in LATE:
        of_sound = plain_rounding[best.has_friction]
    by_rounding = max(of_sound - best.rounding_left, 0.0)
    return Evidence(gains, reference, 1 + by_rounding / noise, sound)


def is_plain(fit: Predicted) -> bool:
    """Whether it is Eq. 15 alone, with or without friction."""
    return fit.candidate.hypothesis.name == PLAIN


def noise_of(fits: Sequence[Predicted], freedom: float) -> float:
    """Variance of what the best hypothesis leaves; 1 unless it is not noise alone."""
    return max(min(float(fit.squares.sum()) for fit in fits) / freedom, 1.0)


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
    noise = noise_of(possible, freedom)
    draws = np.random.default_rng(SEED).dirichlet(np.ones(BLOCKS), BOOTSTRAP_DRAWS) * BLOCKS
    draws = np.vstack([np.ones(BLOCKS), draws])
    plain_rounding = {fit.has_friction: fit.rounding_left for fit in fits if is_plain(fit)}
    evidence = evidence_of(possible, noise, plain_rounding)
    prior = log_prior(possible)
    all_blocks = evidence.block_gains.sum(axis=1)
    half_nat = noise * float(evidence.tempers(all_blocks))
    parts = []
    for k, fit in enumerate(possible):
        more, own_parts = parts_of(fit, half_nat, is_body)
        prior[k] += more
        parts.append(own_parts)

    gains = draws @ evidence.block_gains.T
    log_weights = prior + gains / evidence.tempers(gains)[:, None]
    weights = np.exp(log_weights - log_weights.max(axis=1, keepdims=True))
    weights /= weights.sum(axis=1, keepdims=True)
    weights = weights.mean(axis=0)
    weighed = [Weighed(fit, float(weights[k]), tuple(parts[k])) for k, fit in enumerate(possible)]
    return weighed, evidence.reference


def parts_of(fit: Predicted, half_nat: float, is_body: bool) -> tuple[float, list[Part]]:
    """Parts of a hypothesis, and what they add to the logarithm of its prior.

    Parameters
    ----------
    fit : Predicted
        The hypothesis.
    half_nat : float
        Sum of squares that counts as half a nat.
    is_body : bool
        Whether B and I are positive.
    """
    if not fit.candidate.profile:
        more = log_positive(fit.impedances[0], fit.covariance) if is_body else 0.0
        share = 1 / len(fit.impedances)
        return more, [Part(share, impedance) for impedance in fit.impedances]

    # over its own parameter, with a flat prior between the ends of the profile
    profile, covariance = fit.candidate.profile, fit.covariance
    log_weights = -0.5 * np.array([point.left for point in profile]) / half_nat
    if is_body:
        log_weights += [log_positive(point.impedance, covariance) for point in profile]
    least = min(point.left for point in profile)
    relative = np.exp(log_weights + 0.5 * least / half_nat)
    more = float(np.log(max(relative.mean(), np.finfo(float).tiny)))
    shares = np.exp(log_weights - log_weights.max())
    shares = shares / shares.sum()
    pairs_of_profile = zip(shares.tolist(), profile, strict=True)
    return more, [Part(share, point.impedance) for share, point in pairs_of_profile]
