"""Results of the inference, as values with named fields."""

from dataclasses import dataclass

import scipy

from osl_analysis.inference.constants import BLOCKS
from osl_analysis.stats.estimates import Impedance


def student_half_width() -> float:
    """Half-width of a 95 % interval in standard errors that the scatter of the blocks gives."""
    return float(scipy.special.stdtrit(BLOCKS - 1, 0.975))


@dataclass(frozen=True)
class Explanation:
    """A hypothesis that may be why the torque is not that of Eq. 15 alone."""

    family: str
    name: str
    probability: float  # given that one of the hypotheses is right
    gain: float  # nats by which it predicts better than the best sound joint


@dataclass(frozen=True)
class ImpedanceInference:
    """What one recording tells of a joint.

    Attributes
    ----------
    impedance : Impedance
        The mixture of all hypotheses. It holds what cannot be told apart.
    sound : Impedance
        The best joint of which nothing is at fault, with friction if that predicts better.
    fault_probability : float
        Probability of a fault of any size.
    friction_probability : float
        Probability of dry friction.
    harm : float
        By how much faults move K, B or I, in multiples of what matters to the user.
    doubt : Explanation or None
        The most probable fault, if a fault is likely and does harm.
    explanations : tuple of Explanation
        Faults by their probability, the most probable first.
    delay_told_s : float or None
        Standard error to which the recording itself tells a delay between angle and torque [s];
        None for a drivetrain, whose belt tells it.
    unexplained_shares : tuple of float
        Shares of K, B and I by which torque that no hypothesis explains could move them at most.
    """

    impedance: Impedance
    sound: Impedance
    fault_probability: float
    friction_probability: float
    harm: float
    doubt: Explanation | None
    explanations: tuple[Explanation, ...]
    delay_told_s: float | None
    unexplained_shares: tuple[float, float, float]
