"""Weights of the hypotheses, by how each predicts parts of a recording that it was not fitted to.

A model with more parameters always fits better; it predicts better only if it is closer to what
happened (Stone, J. R. Stat. Soc. B 36, 1974). All of it is algebra on the normal matrices of the
blocks, which need one pass over the rows.

The weight of a hypothesis is its prior times the exponential of what it gains in prediction,
averaged over a Bayesian bootstrap of the blocks (pseudo-BMA+: Yao, Vehtari, Simpson and Gelman,
Bayesian Analysis 13, 2018). The gain is divided by a *temper*, since two things are not noise:

* rounding, which alone would give some hypothesis a gain;
* that no mechanism is exactly its formula: it misses `INEXACTNESS` of its own torque.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from osl_analysis.inference.constants import (
    BLOCKS,
    BOOTSTRAP_DRAWS,
    INEXACTNESS,
    PRIOR_FRICTION,
    PRIOR_SOUND,
    RIDGE,
    TINY,
)
from osl_analysis.inference.hypothesis import PLAIN, Candidate, Family
from osl_analysis.inference.whitening import Whitened
from osl_analysis.trial import Array

FAMILIES: tuple[Family, ...] = (
    "path",
    "time",
    "speed",
    "size",
    "direction",
    "clipping",
)
SEED = 1  # of the bootstrap: the same recording gives the same numbers


@dataclass(frozen=True)
class Predicted:
    """A candidate with its estimates, and how well it predicts each block.

    Attributes
    ----------
    candidate : Candidate
        The hypothesis, at a value of its own parameter.
    has_friction : bool
        Whether friction is beside it.
    squares : Array (BLOCKS,)
        Sum of squares of what the fit to the other blocks leaves of each block, in units of the
        noise's variance.
    impedances : Array (r, 3)
        K, B, I by each of its matrices [SI].
    covariance : Array (3, 3)
        Of the first of them [SI].
    friction_torque : float
        Mean size of sliding friction [N*m]; 0 without friction.
    left : float
        Sum of squares that the fit to all blocks leaves.
    rounding_left : float
        Sum of squares that it leaves of rounding alone.
    """

    candidate: Candidate
    has_friction: bool
    squares: Array
    impedances: Array
    covariance: Array
    friction_torque: float
    left: float
    rounding_left: float

    @property
    def is_possible(self) -> bool:
        """Whether its friction opposes the motion."""
        return self.friction_torque >= 0.0


def block_edges(rows: int) -> Array:
    """First row of each block, and the number of rows, (BLOCKS + 1,)."""
    return np.asarray(-(-np.arange(BLOCKS + 1) * rows // BLOCKS))


def all_columns(data: Whitened, candidate: Candidate, has_friction: bool) -> Array:
    """Columns (c, m) of a candidate: its own, its slope, friction, offset and drift."""
    parts = [candidate.columns]
    if candidate.slope is not None:
        parts.append(candidate.slope[None])
    return np.concatenate([*parts, data.shared(has_friction)])


def normal_matrices(columns: Array, others: Array) -> Array:
    """Products (BLOCKS, c, d) of columns (c, m) and others (d, m) in each block."""
    edges = pairwise(block_edges(columns.shape[1]).tolist())
    return np.array([columns[:, first:stop] @ others[:, first:stop].T for first, stop in edges])


@dataclass(frozen=True)
class BlockFit:
    """A regression on whitened columns, scaled to length 1, in normal matrices of the blocks.

    Attributes
    ----------
    blocks : Array (BLOCKS, c + 1, c + 1)
        Normal matrices; the torque is last.
    inverse : Array (c, c)
        Of the normal matrix of all blocks.
    estimates : Array (c,)
        Of all blocks.
    left : float
        Sum of squares that they leave.
    """

    blocks: Array
    inverse: Array
    estimates: Array
    left: float

    def squares_of_unseen(self) -> Array:
        """Sum of squares (BLOCKS,) that each block has left by the fit to the others: the block is
        taken out of the sums that estimate."""
        others = self.blocks.sum(axis=0) - self.blocks
        ridge = RIDGE * np.eye(len(self.estimates))
        by_others = np.linalg.solve(others[:, :-1, :-1] + ridge, others[:, :-1, -1:])[..., 0]
        misses = np.hstack([by_others, -np.ones((BLOCKS, 1))])
        return np.asarray(np.einsum("bp,bpq,bq->b", misses, self.blocks, misses))

    def covariance(self, freedom: float) -> Array:
        """Covariance (c, c) of the estimates, by noise.

        The larger of two, for each estimate: the likelihood's, and that from the scatter of the
        blocks' scores (White, Econometrica 48, 1980), which holds for a noise that changes.
        Correlations are the likelihood's.
        """
        variance = max(self.left / freedom, 1.0)
        of_columns, of_torque = self.blocks[:, :-1, :-1], self.blocks[:, :-1, -1]
        scores = (of_torque - of_columns @ self.estimates) @ self.inverse
        by_scatter = np.diag(scores.T @ scores) * BLOCKS / (BLOCKS - 1)
        by_likelihood = np.diag(self.inverse) * variance
        factor = np.sqrt(np.maximum(by_scatter, by_likelihood) / by_likelihood)
        return np.asarray(self.inverse * variance * np.outer(factor, factor))


def fit_blocks(matrices: Array) -> tuple[BlockFit, Array]:
    """Fit the columns that have these normal matrices (BLOCKS, c + 1, c + 1); the torque is last.

    Returns
    -------
    fit : BlockFit
        Of columns that are scaled to length 1.
    length : Array (c,)
        Their lengths.
    """
    # the matrices are scaled and not the columns, of which an hour has hundreds of megabytes
    length = np.sqrt(matrices.sum(axis=0).diagonal()[:-1]) + TINY
    scale = np.append(length, 1.0)
    blocks = matrices / np.outer(scale, scale)
    total = blocks.sum(axis=0)
    inverse = np.linalg.inv(total[:-1, :-1] + RIDGE * np.eye(len(length)))
    estimates = inverse @ total[:-1, -1]
    left = float(total[-1, -1] - estimates @ total[:-1, -1])
    return BlockFit(blocks, inverse, estimates, left), length


class Predictor:
    """Fits candidates for one kind of joint, and predicts each block by the fit to the others.

    Parameters
    ----------
    data : Whitened
        The recording.
    has_friction : bool
        Whether the shapes of dry friction are beside the candidates' columns.
    rounding : Array (draws, m)
        Torques that rounding alone makes.
    """

    def __init__(self, data: Whitened, has_friction: bool, rounding: Array) -> None:
        self.data = data
        self.has_friction = has_friction
        self._rounding = rounding

    def by_rounding(self, columns: Array, length: Array, inverse: Array) -> tuple[Array, float]:
        """What rounding alone does to the estimates of columns (c, m), scaled to length 1.

        Returns
        -------
        covariance : Array (c, c)
            Of the estimates.
        left : float
            Sum of squares that the columns leave of rounding, the mean over its draws.
        """
        draws = len(self._rounding)
        if not draws:
            return np.zeros_like(inverse), 0.0
        projections = self._rounding @ columns.T / length
        errors = projections @ inverse
        # sum(rounding (rounding - errors @ columns/length))
        unexplained = np.sum(self._rounding**2) - np.sum(errors * projections)
        return errors.T @ errors / draws, float(unexplained / draws)

    def predict(self, candidate: Candidate) -> Predicted:
        """Fit a candidate, and predict each block by the fit to the others."""
        data = self.data
        columns = all_columns(data, candidate, self.has_friction)
        with_torque = np.vstack([columns, candidate.torque])
        fit, length = fit_blocks(normal_matrices(with_torque, with_torque))
        of_rounding, rounding_left = self.by_rounding(columns, length, fit.inverse)
        estimates = fit.estimates / length
        of_noise = fit.covariance(data.spectra.freedom)
        covariance = (of_noise + of_rounding) / np.outer(length, length)

        width = len(candidate.columns)
        coefficients = estimates[:width]
        matrices = candidate.to_impedance(width)
        of_impedance = matrices[0] @ covariance[:width, :width] @ matrices[0].T
        if data.actuator is not None and len(coefficients) > 3:
            of_impedance = of_impedance + coefficients[3] ** 2 * data.actuator.covariance

        friction_torque = 0.0
        if self.has_friction:
            first = width if candidate.slope is None else width + 1
            of_shapes = estimates[first : first + len(data.friction)]
            friction_torque = float(of_shapes @ data.mean_friction)
        return Predicted(
            candidate=candidate,
            has_friction=self.has_friction,
            squares=fit.squares_of_unseen(),
            impedances=np.array([matrix @ coefficients for matrix in matrices]),
            covariance=of_impedance,
            friction_torque=friction_torque,
            left=fit.left,
            rounding_left=rounding_left,
        )


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
