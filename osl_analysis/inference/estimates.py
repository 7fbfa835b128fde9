"""Results of the inference, as values with named fields."""

from dataclasses import dataclass

from osl_analysis.stats.estimates import Impedance


@dataclass(frozen=True)
class Explanation:
    """A hypothesis that may be why the torque is not that of Eq. 15 alone."""

    family: str
    name: str
    probability: float  # given that one of the hypotheses is right


@dataclass(frozen=True)
class ImpedanceInference:
    """What may be wrong with a recording of a joint.

    Attributes
    ----------
    without_friction : Impedance
        K, B and I of the best joint without a fault, less its friction.
    fault_probability : float
        Probability of a fault of any size.
    friction_probability : float
        Probability of dry friction.
    fault_shares : tuple of float
        Shares of K, B and I by which the faults move them at most.
    doubt : Explanation or None
        The most probable fault, if a fault is likely and does harm.
    explanations : tuple of Explanation
        Faults by their probability, the most probable first.
    delay_told_s : float
        Standard error to which the recording itself tells a delay between angle and torque [s].
    unexplained_shares : tuple of float
        Shares of K, B and I by which torque that no hypothesis explains could move them at most.
    """

    without_friction: Impedance
    fault_probability: float
    friction_probability: float
    fault_shares: tuple[float, ...]
    doubt: Explanation | None
    explanations: tuple[Explanation, ...]
    delay_told_s: float
    unexplained_shares: tuple[float, float, float]


@dataclass(frozen=True)
class LegInference:
    """What a recording tells of the friction in a leg's actuator.

    Attributes
    ----------
    friction_probability : float
        Probability of dry friction.
    without_friction : Impedance
        K, B and I as they would be without it.
    """

    friction_probability: float
    without_friction: Impedance
