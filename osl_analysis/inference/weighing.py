# SPDX-License-Identifier: Apache-2.0
"""Weights of the rivals, by how each predicts parts of a recording that it was not fitted to.

A model with more parameters always fits better; it predicts better only if it is closer to what
happened (Stone, J. R. Stat. Soc. B 36, 1974). All of it is algebra on the normal matrices of the
blocks, which need one pass over the rows.

The weight of a rival is its prior times the exponential of what it gains in prediction,
averaged over a Bayesian bootstrap of the blocks (pseudo-BMA+: Yao, Vehtari, Simpson and Gelman,
Bayesian Analysis 13, 2018). The gain is divided by a *temperature*, since two things are not noise:

* rounding, which alone would give some rival a gain;
* that no mechanism is exactly its formula: it misses `INEXACTNESS` of its own torque.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from osl_analysis.base.trial import Array
from osl_analysis.inference.constants import (
    BLOCKS,
    BOOTSTRAP_DRAWS,
    INEXACTNESS,
    PRIOR_FRICTION,
    PRIOR_SOUND,
    RIDGE,
    TINY,
)
from osl_analysis.inference.rivals import EQ_15, RIVALS, Candidate, Rival, Search
from osl_analysis.inference.whitening import Whitened

RIVAL_FAMILIES = {rival.family for rival in RIVALS if rival.family}
SEED = 1  # of the bootstrap: the same recording gives the same numbers


@dataclass(frozen=True)
class Predicted:
    """A candidate with its estimates, and how well it predicts each block.

    Attributes
    ----------
    candidate : Candidate
        The rival, at a value of its own parameter.
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
    def rival(self) -> Rival:
        """What the candidate is of."""
        return self.candidate.rival

    @property
    def impedance(self) -> Array:
        """Mean of the K, B, I (3,) that it has."""
        return self.impedances.mean(axis=0)


def all_columns(data: Whitened, candidate: Candidate, has_friction: bool) -> Array:
    """Columns (c, m) of a candidate: its own, its slope, friction, offset and drift."""
    parts = [candidate.columns]
    if candidate.slope is not None:
        parts.append(candidate.slope[None])
    return np.concatenate([*parts, data.shared(has_friction)])


class BlockFit:
    """A regression on whitened columns, scaled to length 1, in normal matrices of the blocks.

    Parameters
    ----------
    rows : Array (c + 1, m)
        The columns; the torque is last.

    Attributes
    ----------
    edges : Array (BLOCKS + 1,)
        First row of each block, and the number of rows.
    length : Array (c,)
        Lengths of the columns.
    blocks : Array (BLOCKS, c + 1, c + 1)
        Normal matrices; the torque is last.
    inverse : Array (c, c)
        Of the normal matrix of all blocks.
    estimates : Array (c,)
        Of all blocks.
    left : float
        Sum of squares that they leave.
    """

    def __init__(self, rows: Array) -> None:
        self.edges = -(-np.arange(BLOCKS + 1) * rows.shape[1] // BLOCKS)
        parts = [rows[:, first:stop] for first, stop in pairwise(self.edges)]
        matrices = np.array([part @ part.T for part in parts])
        # the matrices are scaled and not the columns, of which an hour has hundreds of megabytes
        self.length = np.sqrt(matrices.sum(axis=0).diagonal()[:-1]) + TINY
        scale = np.append(self.length, 1.0)
        self.blocks = matrices / np.outer(scale, scale)
        total = self.blocks.sum(axis=0)
        self.inverse = np.linalg.inv(total[:-1, :-1] + RIDGE * np.eye(len(self.length)))
        with_torque = total[:-1, -1]
        self.estimates = self.inverse @ with_torque
        self.left = float(total[-1, -1] - self.estimates @ with_torque)

    def squares_of_unseen(self) -> Array:
        """Sum of squares (BLOCKS,) that each block has left by the fit to the others: the block is
        taken out of the sums that estimate."""
        others = self.blocks.sum(axis=0) - self.blocks
        ridge = RIDGE * np.eye(len(self.estimates))
        by_others = np.linalg.solve(others[:, :-1, :-1] + ridge, others[:, :-1, -1:])[..., 0]
        misses = np.hstack([by_others, -np.ones((BLOCKS, 1))])
        return np.einsum("bp,bpq,bq->b", misses, self.blocks, misses)

    def covariance(self, freedom: float) -> Array:
        """Covariance (c, c) of the estimates, by noise."""
        return self.inverse * max(self.left / freedom, 1.0)

    def left_of_rounding(self, rounding: Array, columns: Array) -> float:
        """Sum of squares that the columns (c, m) leave of torques (draws, m) that rounding alone
        makes, the mean over its draws."""
        projections = rounding @ columns.T / self.length
        # sum(rounding (rounding - errors @ columns/length))
        left = np.sum(rounding**2) - np.sum(projections @ self.inverse * projections)
        return float(left / len(rounding))


def predict(search: Search, candidate: Candidate, rounding: Array) -> Predicted:
    """Fit a candidate, and predict each block by the fit to the others.

    Parameters
    ----------
    search : Search
        The recording, with or without friction.
    candidate : Candidate
    rounding : Array (draws, m)
        Torques that rounding alone makes.
    """
    data = search.data
    columns = all_columns(data, candidate, search.has_friction)
    fit = BlockFit(np.vstack([columns, candidate.torque]))
    estimates = fit.estimates / fit.length
    covariance = fit.covariance(data.spectra.freedom) / np.outer(fit.length, fit.length)

    width = len(candidate.columns)
    coefficients = estimates[:width]
    # what turns the coefficients into K, B and I
    of_added = np.eye(3, width - 3)
    matrices = [np.hstack([np.eye(3), share * of_added]) for share in candidate.rival.shares]
    of_impedance = matrices[0] @ covariance[:width, :width] @ matrices[0].T

    friction_torque = 0.0
    if search.has_friction:
        first = width if candidate.slope is None else width + 1
        of_shapes = estimates[first : first + len(data.mean_friction)]
        friction_torque = float(of_shapes @ data.mean_friction)
    return Predicted(
        candidate=candidate,
        has_friction=search.has_friction,
        squares=fit.squares_of_unseen(),
        impedances=np.array([matrix @ coefficients for matrix in matrices]),
        covariance=of_impedance,
        friction_torque=friction_torque,
        left=fit.left,
        rounding_left=fit.left_of_rounding(rounding, columns),
    )


def log_prior(fits: Sequence[Predicted]) -> Array:
    """Logarithms (h,) of the prior probabilities.

    Families share what is not sound evenly, and so do rivals within a family. Each candidate of a
    rival has the rival's own: if they shared it, 6 fewer of 977 planted causes would be named. B
    and I are those of a body, and positive.
    """
    of_family = Counter(rival.family for rival in {fit.rival for fit in fits})
    found = []
    for fit in fits:
        family = fit.rival.family
        prior = (1 - PRIOR_SOUND) / len(RIVAL_FAMILIES) if family else PRIOR_SOUND
        prior *= PRIOR_FRICTION if fit.has_friction else 1 - PRIOR_FRICTION
        deviations = fit.impedances[0] / np.sqrt(np.diag(fit.covariance))
        are_positive = np.sum(scipy.special.log_ndtr(deviations[1:]))
        found.append(np.log(prior / of_family[family]) + are_positive)
    return np.array(found)


def weigh(
    fits: Sequence[Predicted], freedom: float
) -> tuple[list[tuple[Predicted, float]], Predicted]:
    """Weigh rivals by prediction.

    Parameters
    ----------
    fits : sequence of Predicted
        Rivals beside friction, or not.
    freedom : float
        Number of independent rows.

    Returns
    -------
    weighed : list of (Predicted, float)
        The fits whose friction opposes the motion, each with its probability, given that one of
        them is right.
    best_sound : Predicted
        The one without a fault that predicts best.
    """
    possible = [fit for fit in fits if fit.friction_torque >= 0 and np.isfinite(fit.squares).all()]
    # what friction takes up of rounding alone is no gain
    plain = {fit.has_friction: fit for fit in fits if fit.rival is EQ_15}
    of_friction = max(plain[False].rounding_left - plain[True].rounding_left, 0.0)
    squares = np.array([fit.squares for fit in possible])
    squares[[fit.has_friction for fit in possible]] += of_friction / BLOCKS
    totals = squares.sum(axis=1)
    is_sound = np.array([fit.rival is EQ_15 for fit in possible])
    best = np.argmin(totals)
    best_sound = np.argmin(np.where(is_sound, totals, np.inf))

    # by how much log-likelihood each predicts each block better than the best sound one
    noise = max(totals[best] / freedom, 1.0)
    gains_of_blocks = (squares[best_sound] - squares) / 2 / noise
    draws = np.random.default_rng(SEED).dirichlet(np.ones(BLOCKS), BOOTSTRAP_DRAWS) * BLOCKS
    gains = draws @ gains_of_blocks.T

    # the temperature of each draw: rounding is no noise, and a mechanism that misses a share e of
    # its own torque leaves e^2 of what it explains, which is twice the gain
    of_rounding = possible[best_sound].rounding_left - possible[best].rounding_left
    gain_over_sound = gains.max(axis=1) - gains[:, is_sound].max(axis=1)
    temperature = 1 + max(of_rounding, 0.0) / noise + INEXACTNESS**2 * 2 * gain_over_sound

    log_weights = log_prior(possible) + gains / temperature[:, None]
    weights = scipy.special.softmax(log_weights, axis=1).mean(axis=0).tolist()
    return list(zip(possible, weights, strict=True)), possible[best_sound]
