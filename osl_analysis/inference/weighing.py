# SPDX-License-Identifier: Apache-2.0
"""Weights of the candidate models, by how each predicts parts of a recording that it was not fitted
to.

A model with more parameters always fits better; it predicts better only if it is closer to what
happened (Stone, J. R. Stat. Soc. B 36, 1974). All of it is algebra on the normal matrices of the
blocks, which need one pass over the rows.

The weight of a candidate model is its prior times the exponential of what it gains in prediction,
averaged over a Bayesian bootstrap of the blocks (pseudo-BMA+: Yao, Vehtari, Simpson and Gelman,
Bayesian Analysis 13, 2018). The gain is divided by a *temperature*, since two things are not noise:

* rounding, which alone would give some candidate model a gain;
* that no mechanism is exactly its formula: it misses `INEXACTNESS` of its own torque.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from osl_analysis.base.trial import Array
from osl_analysis.inference.candidate_models import (
    CANDIDATE_MODELS,
    EQ_15,
    CandidateModel,
    Family,
    ModelAtValue,
    Search,
    models_at_values,
)
from osl_analysis.inference.model_names import ModelName
from osl_analysis.inference.rounding_errors import rounding_torques
from osl_analysis.inference.spectra import (
    BLOCKS,
    LENGTH_ROUNDING,
    RIDGE_ROUNDING,
    BenchSignals,
    WorkingSpectra,
    solve_scaled,
)
from osl_analysis.inference.whitening import Whitened
from osl_analysis.stats.linear_fit import FALSE_ALARM

# Share of recordings without a fault that matters; before 1.0: 0.9, 0.98, 0.995 accuse 1, 1, 0 of
# 159 sound files; of 239 faults 22, 25, 26 are silent
PRIOR_SOUND = 0.98
# Share of joints in which dry friction matters; a choice: no knowledge; 0.2 to 0.8 changes the
# odds by a factor of 4 at most
PRIOR_FRICTION = 0.5
# Share of its own torque that a named mechanism misses, since none is exactly its formula;
# before 1.0: at 0 and 0.2 69 and 85 % of I's ranges hold under a fault; 0.4 names a quarter
INEXACTNESS = 0.2
# Draws of the Bayesian bootstrap of blocks; a weight of 0.5 is known to 0.03, far below what
# decides
BOOTSTRAP_DRAWS = 200

FAMILIES = {model.family for model in CANDIDATE_MODELS if model.family}
SEED = 1  # of the bootstrap: the same recording gives the same numbers


@dataclass(frozen=True)
class Predicted:
    """A candidate with its estimates, and how well it predicts each block.

    Attributes
    ----------
    candidate : ModelAtValue
        The candidate model, at a value of its own parameter.
    has_friction : bool
        Whether friction is beside it.
    squares : Array (BLOCKS,)
        Sum of squares of what the fit to the other blocks leaves of each block, in units of the
        noise's variance.
    impedances : Array (r, 3)
        K, B, I by each of its matrices [SI].
    errors : Array (3,)
        Standard errors of the first of them [SI].
    friction_torque : float
        Mean size of sliding friction [N*m]; 0 without friction.
    friction_impedance : Array (3,)
        What its friction adds to K, B, I of Eq. 15 without friction [SI].
    left : float
        Sum of squares that the fit to all blocks leaves.
    rounding_left : float
        Sum of squares that it leaves of rounding alone.
    """

    candidate: ModelAtValue
    has_friction: bool
    squares: Array
    impedances: Array
    errors: Array
    friction_torque: float
    friction_impedance: Array
    left: float
    rounding_left: float

    @property
    def model(self) -> CandidateModel:
        """What the candidate is of."""
        return self.candidate.model

    @property
    def impedance(self) -> Array:
        """Mean of the K, B, I (3,) that it has."""
        return self.impedances.mean(axis=0)


def all_columns(data: Whitened, candidate: ModelAtValue, has_friction: bool) -> Array:
    """Columns (c, m) of a candidate: its own, its slope, friction, offset and drift."""
    return np.concatenate([candidate.columns, *candidate.slopes, data.shared(has_friction)])


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
        self.length = np.sqrt(matrices.sum(axis=0).diagonal()[:-1]) + LENGTH_ROUNDING
        scale = np.append(self.length, 1.0)
        self.blocks = matrices / np.outer(scale, scale)
        total = self.blocks.sum(axis=0)
        self.inverse = np.linalg.inv(total[:-1, :-1] + RIDGE_ROUNDING * np.eye(len(self.length)))
        with_torque = total[:-1, -1]
        self.estimates = self.inverse @ with_torque
        self.left = float(total[-1, -1] - self.estimates @ with_torque)

    def squares_of_unseen(self) -> Array:
        """Sum of squares (BLOCKS,) that each block has left by the fit to the others: the block is
        taken out of the sums that estimate."""
        others = self.blocks.sum(axis=0) - self.blocks
        ridge = RIDGE_ROUNDING * np.eye(len(self.estimates))
        by_others = np.linalg.solve(others[:, :-1, :-1] + ridge, others[:, :-1, -1:])[..., 0]
        misses = np.hstack([by_others, -np.ones((BLOCKS, 1))])
        return np.einsum("bp,bpq,bq->b", misses, self.blocks, misses)

    def left_of_rounding(self, rounding: Array, columns: Array) -> float:
        """Sum of squares that the columns (c, m) leave of torques (draws, m) that rounding alone
        makes, the mean over its draws."""
        projections = rounding @ columns.T / self.length
        # sum(rounding (rounding - errors @ columns/length))
        left = np.sum(rounding**2) - np.sum(projections @ self.inverse * projections)
        return float(left / len(rounding))


def predict(search: Search, candidate: ModelAtValue, rounding: Array) -> Predicted:
    """Fit a candidate, and predict each block by the fit to the others.

    Parameters
    ----------
    search : Search
        The recording, with or without friction.
    candidate : ModelAtValue
    rounding : Array (draws, m)
        Torques that rounding alone makes.
    """
    data = search.data
    columns = all_columns(data, candidate, search.has_friction)
    fit = BlockFit(np.vstack([columns, candidate.torque]))
    estimates = fit.estimates / fit.length
    variances = fit.inverse.diagonal() * max(fit.left / data.spectra.freedom, 1.0)

    # K, B and I, and their changes by the added columns
    width = len(candidate.columns)
    changes = np.zeros(3)
    changes[: width - 3] = estimates[3:width]

    first = width + len(candidate.slopes)
    of_shapes = estimates[first : first + len(data.mean_friction)]  # of friction, if it has any
    friction_impedance = np.zeros(3)
    if search.has_friction:
        friction_impedance = of_shapes @ data.friction_impedances
    return Predicted(
        candidate=candidate,
        has_friction=search.has_friction,
        squares=fit.squares_of_unseen(),
        impedances=estimates[:3] + np.outer(candidate.model.shares, changes),
        errors=(np.sqrt(variances) / fit.length)[:3],
        friction_torque=float(of_shapes @ data.mean_friction) if search.has_friction else 0.0,
        friction_impedance=friction_impedance,
        left=fit.left,
        rounding_left=fit.left_of_rounding(rounding, columns),
    )


def log_prior(fits: Sequence[Predicted]) -> Array:
    """Logarithms (h,) of the prior probabilities.

    Families share what is not sound evenly, and so do candidate models within a family. Each
    candidate of a candidate model has the candidate model's own: if they shared it, 6 fewer of 977
    planted causes would be named. B and I are those of a body, and positive.
    """
    of_family = Counter(model.family for model in {fit.model for fit in fits})
    found = []
    for fit in fits:
        family = fit.model.family
        prior = (1 - PRIOR_SOUND) / len(FAMILIES) if family else PRIOR_SOUND
        prior *= PRIOR_FRICTION if fit.has_friction else 1 - PRIOR_FRICTION
        deviations = fit.impedances[0] / fit.errors
        are_positive = np.sum(scipy.special.log_ndtr(deviations[1:]))
        found.append(np.log(prior / of_family[family]) + are_positive)
    return np.array(found)


def weigh(
    fits: Sequence[Predicted], freedom: float
) -> tuple[list[tuple[Predicted, float]], Predicted]:
    """Weigh candidate models by prediction.

    Parameters
    ----------
    fits : sequence of Predicted
        Candidate models beside friction, or not.
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
    plain = {fit.has_friction: fit for fit in fits if fit.model is EQ_15}
    of_friction = max(plain[False].rounding_left - plain[True].rounding_left, 0.0)
    squares = np.array([fit.squares for fit in possible])
    squares[[fit.has_friction for fit in possible]] += of_friction / BLOCKS
    totals = squares.sum(axis=1)
    is_sound = np.array([fit.model is EQ_15 for fit in possible])
    best = np.argmin(totals)
    best_sound = np.argmin(np.where(is_sound, totals, np.inf))

    # by how much log-likelihood each predicts each block better than the best sound one
    noise = max(totals[best] / freedom, 1.0)
    gains_of_blocks = (squares[best_sound] - squares) / 2 / noise
    draws = np.random.default_rng(SEED).dirichlet(np.ones(BLOCKS), BOOTSTRAP_DRAWS) * BLOCKS
    gains = draws @ gains_of_blocks.T

    # the temperature of each draw: rounding is no noise, and a mechanism that misses a share e of
    # its own torque leaves e^2 of what it explains, which is twice the gain; and no more than the
    # best one may leave beyond noise: one that leaves noise alone is exactly its formula
    of_rounding = possible[best_sound].rounding_left - possible[best].rounding_left
    gain_over_sound = gains.max(axis=1) - gains[:, is_sound].max(axis=1)
    beyond_noise = max(totals[best], freedom) - scipy.special.chdtri(freedom, 1 - FALSE_ALARM)
    inexact = np.minimum(INEXACTNESS**2 * 2 * gain_over_sound, beyond_noise / noise)
    temperature = 1 + max(of_rounding, 0.0) / noise + inexact

    log_weights = log_prior(possible) + gains / temperature[:, None]
    weights = scipy.special.softmax(log_weights, axis=1).mean(axis=0)

    # the members of a family that leave noise alone are not told apart by prediction
    of_noise = np.sqrt(freedom / 2)  # SD of the log-likelihood by noise alone
    mean_gains = gains_of_blocks.sum(axis=1)
    for family in {fit.model.family for fit in possible} & FAMILIES:
        members = [number for number, fit in enumerate(possible) if fit.model.family == family]
        within = log_prior(possible)[members] + mean_gains[members] / of_noise
        weights[members] = weights[members].sum() * scipy.special.softmax(within)
    return list(zip(possible, weights.tolist(), strict=True)), possible[best_sound]


# The inference, from angle and torque of a recording to what may be wrong with it: `spectra` have
# the band of the motion; `whitening` makes the noise white; `candidate_models` of Eq. 15 are
# fitted, with and without dry friction, where the columns of all of them together gain anything;
# and each predicts parts of the recording by its fit to the others.


# what is left over the noise of the rows that move least and over rounding, up to which it is
# theirs: three standard errors in 20 s of motion to 6 Hz
MOST_NOISE = 1.6


def largest_shifts(
    search: Search, best: Predicted, plain_left: float, impedance: Array, rounding: Array
) -> Array:
    """The largest changes of K, B and I (3,) [SI] by torque that no candidate model explains.

    Parameters
    ----------
    search : Search
        The recording, with friction or without, as the most probable one has it.
    best : Predicted
        This one.
    plain_left : float
        Sum of squares that Eq. 15 alone leaves.
    impedance : Array (3,)
        K, B and I of the joint [SI].
    rounding : Array (draws, m)
        Torques that rounding alone makes.
    """
    data = search.data
    columns = all_columns(data, best.candidate, best.has_friction)
    torque = best.candidate.torque
    squares = (torque - solve_scaled(columns, torque) @ columns) ** 2

    # a sine is never still in both its torque and the derivative of it
    derivatives = data.columns["derivatives"]
    modelled = np.array([impedance @ derivatives[:3], impedance @ derivatives[1:4]])
    motion = np.sum(modelled**2 / np.mean(modelled**2, axis=1, keepdims=True), axis=0)
    quiet = np.median(squares[motion < np.median(motion)])
    # half of the squares of noise are below this share of its variance
    noise = quiet / scipy.special.chdtri(1, 0.5) * len(squares)
    # shapes of friction are not exactly its formula
    of_friction = INEXACTNESS**2 * (plain_left - best.left)
    of_rounding = np.sum(rounding**2) / len(rounding)
    of_sensors = MOST_NOISE * (noise + of_rounding)
    unexplained = max(squares.sum() - of_sensors - of_friction, 0.0)

    # squares of what the other two leave of a column are 1 over the diagonal of the inverse
    own = search.rest(data.motion)
    return np.sqrt(unexplained * np.diag(np.linalg.inv(own @ own.T)))


@dataclass(frozen=True)
class Alternative:
    """A candidate model that may be why the torque is not that of Eq. 15 alone."""

    family: Family
    name: ModelName
    probability: float  # given that one of the candidate models is right
    # (3,) by how much K, B and I of Eq. 15 would be others at most, by it [SI]
    change: Array
    change_without_friction: Array  # (3,) the same of K, B and I without friction


@dataclass(frozen=True)
class ImpedanceInference:
    """What may be wrong with a recording of a joint.

    Attributes
    ----------
    without_friction : dict
        K, B and I of the best joint without a fault, less its friction [SI].
    friction_probability : float
        Probability of dry friction.
    alternatives : tuple of Alternative
        Each candidate model, the most probable first.
    unexplained : Array (3,)
        By how much torque that no candidate model explains could move K, B and I at most [SI].
    """

    without_friction: Mapping[str, float]
    friction_probability: float
    alternatives: tuple[Alternative, ...]
    unexplained: Array


def infer_impedance(signals: BenchSignals) -> ImpedanceInference:
    """Weigh what may be wrong with a recording of a joint.

    Parameters
    ----------
    signals : BenchSignals
        Angle and torque on one time base.

    Returns
    -------
    ImpedanceInference
        Alternatives with their probabilities, and what each would change.

    Raises
    ------
    NotWeighedError
        They are too short.
    """
    spectra = WorkingSpectra(signals)
    data = Whitened(spectra)
    searches = [Search(data, has_friction) for has_friction in (False, True)]
    without_friction = searches[0]
    models = (EQ_15,) if is_explained_by_eq15(without_friction) else CANDIDATE_MODELS
    rounding = rounding_torques(data, without_friction.impedance)
    fits = [
        predict(search, candidate, rounding)
        for search in searches
        for model in models
        for candidate in models_at_values(model, search)
    ]
    weighed, best_sound = weigh(fits, spectra.freedom)
    # without what is wrong Eq. 15 alone would still have the friction in its K, B and I
    sound_with = {fit.has_friction: fit.impedance for fit in fits if fit.model is EQ_15}
    alternatives = [
        Alternative(
            family=fit.model.family,
            name=fit.model.name,
            probability=weight,
            change=largest(fit.impedances + fit.friction_impedance - sound_with[False]),
            change_without_friction=largest(fit.impedances - sound_with[True]),
        )
        for fit, weight in weighed
        if fit.model is not EQ_15
    ]
    best, _ = max(weighed, key=lambda each: each[1])
    return ImpedanceInference(
        without_friction=dict(zip("KBI", best_sound.impedances[0].tolist(), strict=True)),
        friction_probability=sum(weight for fit, weight in weighed if fit.has_friction),
        alternatives=tuple(sorted(alternatives, key=lambda each: -each.probability)),
        unexplained=largest_shifts(
            searches[best.has_friction], best, fits[0].left, best_sound.impedance, rounding
        ),
    )


def largest(changes: Array) -> Array:
    """The largest size (k,) of changes (r, k)."""
    return np.abs(changes).max(axis=0)


def is_explained_by_eq15(plain: Search) -> bool:
    """Whether the columns of all candidate models together explain no more than chance would.

    By chance twice the log-likelihood that k columns gain is a chi-square of k degrees of freedom.
    One fit then does for those of all candidate models. B and I of Eq. 15 alone must be positive:
    otherwise a path may explain them although it gains nothing.
    """
    noise = max(plain.left / plain.data.spectra.freedom, 1.0)
    if not plain.is_body or noise >= MOST_NOISE:
        return False
    columns = plain.data.rich
    gain = (plain.left - plain.fit(columns)[0]) / noise
    return bool(gain < scipy.special.chdtri(len(columns), FALSE_ALARM))
