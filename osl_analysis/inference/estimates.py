"""Results of the inference, as values with named fields."""

from dataclasses import dataclass

from osl_analysis.stats.estimates import Impedance


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
    without_actuator_friction : Impedance or None
        K, B and I of a leg as they would be without the friction of its actuator; None of any other
        joint.
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
    delay_told_s : float or None
        Standard error to which the recording itself tells a delay between angle and torque [s];
        None for a drivetrain, whose belt tells it.
    unexplained_shares : tuple of float
        Shares of K, B and I by which torque that no hypothesis explains could move them at most.
    """

    without_actuator_friction: Impedance | None
    fault_probability: float
    friction_probability: float
    fault_shares: tuple[float, ...]
    doubt: Explanation | None
    explanations: tuple[Explanation, ...]
    delay_told_s: float | None
    unexplained_shares: tuple[float, float, float]
