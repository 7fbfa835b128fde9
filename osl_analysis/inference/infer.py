# SPDX-License-Identifier: Apache-2.0
"""The inference: from angle and torque of a recording to what may be wrong with it.

1. `spectra`: signals in the band of the motion.
2. `whitening`: the noise becomes white.
3. `rivals` of Eq. 15: each is fitted, with and without dry friction (`friction_shapes`), where
   the columns of all of them together gain anything.
4. `weighing`: each predicts parts of the recording by its fit to the others; predictions and
   priors give weights.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from osl_analysis.base.trial import Array
from osl_analysis.inference.constants import INEXACTNESS
from osl_analysis.inference.rivals import EQ_15, RIVALS, Rival, Search, candidates
from osl_analysis.inference.rounding_errors import rounding_torques
from osl_analysis.inference.spectra import BenchSignals, Spectra, solve_scaled
from osl_analysis.inference.weighing import Predicted, all_columns, predict, weigh
from osl_analysis.inference.whitening import Whitened

# what is left over the noise of the rows that move least and over rounding, up to which it is
# theirs: three standard errors in 20 s of motion to 6 Hz
MOST_NOISE = 1.6


def largest_shifts(
    data: Whitened, best: Predicted, plain_left: float, impedance: Array, rounding: Array
) -> Array:
    """The largest changes of K, B and I (3,) [SI] by torque that no rival explains.

    Parameters
    ----------
    data : Whitened
        The recording.
    best : Predicted
        The most probable one.
    plain_left : float
        Sum of squares that Eq. 15 alone leaves.
    impedance : Array (3,)
        K, B and I of the joint [SI].
    rounding : Array (draws, m)
        Torques that rounding alone makes.
    """
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
    own = Search(data, best.has_friction).rest(data.motion)
    return np.sqrt(unexplained * np.diag(np.linalg.inv(own @ own.T)))


SCREEN_DEVIATIONS = 3.0  # beyond chance, that all columns together must gain: once in 700 times


@dataclass(frozen=True)
class Alternative:
    """A rival that may be why the torque is not that of Eq. 15 alone."""

    family: str
    name: str
    probability: float  # given that one of the rivals is right
    change: Array  # (3,) by how much K, B and I would be others at most, by it [SI]


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
        Each rival, the most probable first.
    unexplained : Array (3,)
        By how much torque that no rival explains could move K, B and I at most [SI].
    """

    without_friction: Mapping[str, float]
    friction_probability: float
    alternatives: tuple[Alternative, ...]
    unexplained: Array

    def probability_of(self, family: str) -> float:
        """Probability that a rival of a family is right."""
        return sum(each.probability for each in self.alternatives if each.family == family)


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
    InputError
        The signals are not finite, or do not move.
    NotWeighedError
        They are too short.
    """
    spectra = Spectra(signals)
    data = Whitened(spectra)
    fits, rounding = fit_all(data, RIVALS)
    weighed, best_sound = weigh(fits, spectra.freedom)
    # a rival is compared with the sound joint that has friction as it has
    sound_with = {fit.has_friction: fit for fit in fits if fit.rival is EQ_15}
    alternatives = [
        Alternative(
            family=fit.rival.family,
            name=fit.rival.name,
            probability=weight,
            change=np.abs(fit.impedances - sound_with[fit.has_friction].impedance).max(axis=0),
        )
        for fit, weight in weighed
        if fit.rival is not EQ_15
    ]
    best, _ = max(weighed, key=lambda each: each[1])
    return ImpedanceInference(
        without_friction=dict(zip("KBI", best_sound.impedances[0].tolist(), strict=True)),
        friction_probability=sum(weight for fit, weight in weighed if fit.has_friction),
        alternatives=tuple(sorted(alternatives, key=lambda each: -each.probability)),
        unexplained=largest_shifts(data, best, fits[0].left, best_sound.impedance, rounding),
    )


def fit_all(data: Whitened, rivals: Sequence[Rival]) -> tuple[list[Predicted], Array]:
    """Fit rivals without and with friction, and let each predict all blocks; with the torques of
    rounding."""
    searches = [Search(data, has_friction) for has_friction in (False, True)]
    without_friction = searches[0]
    if len(rivals) > 1 and is_explained_by_eq15(without_friction):
        rivals = [EQ_15]
    rounding = rounding_torques(data, without_friction.impedance)
    fits = [
        predict(search, candidate, rounding)
        for search in searches
        for rival in rivals
        for candidate in candidates(rival, search)
    ]
    return fits, rounding


def is_explained_by_eq15(plain: Search) -> bool:
    """Whether the columns of all rivals together explain no more than chance would.

    By chance k columns gain k/2 of log-likelihood, with a standard deviation of the root of that.
    One fit then does for those of all rivals. B and I of Eq. 15 alone must be positive: otherwise a
    path may explain them although it gains nothing.
    """
    noise = max(plain.left / plain.data.spectra.freedom, 1.0)
    if not plain.is_body or noise >= MOST_NOISE:
        return False
    columns = plain.data.rich
    gain = (plain.left - plain.fit(columns)[0]) / 2 / noise
    by_chance = len(columns) / 2
    return bool(gain < by_chance + SCREEN_DEVIATIONS * np.sqrt(by_chance))
