"""Results of the inference, as values with named fields."""

from dataclasses import dataclass

Cell = float | str | None
SYMBOLS = ("K", "B", "I")


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % interval, in the SI unit of what it estimates."""

    value: float
    low: float
    high: float

    @property
    def half_width(self) -> float:
        """Half of the interval's width."""
        return (self.high - self.low) / 2

    def holds(self, true: float) -> bool:
        """Whether the interval holds a value."""
        return self.low <= true <= self.high


@dataclass(frozen=True)
class Impedance:
    """Stiffness [N*m/rad], damping [N*m*s/rad] and inertia [kg*m^2] of a joint (Eq. 15)."""

    K: Estimate
    B: Estimate
    I: Estimate

    def columns(self, suffix: str = "") -> dict[str, Cell]:
        """Cells of a table: `K`, `K_low`, `K_high`, and so on, with a suffix to the symbol."""
        found: dict[str, Cell] = {}
        for symbol, estimate in zip(SYMBOLS, (self.K, self.B, self.I), strict=True):
            found[f"{symbol}{suffix}"] = estimate.value
            found[f"{symbol}{suffix}_low"] = estimate.low
            found[f"{symbol}{suffix}_high"] = estimate.high
        return found


@dataclass(frozen=True)
class Parameter:
    """A parameter of a mechanism's own."""

    name: str
    unit: str
    value: float
    standard_error: float


@dataclass(frozen=True)
class Explanation:
    """A hypothesis that may be why the torque is not that of Eq. 15 alone."""

    family: str
    name: str
    term: str  # what the field calls it
    probability: float  # given that one of the hypotheses is right
    gain: float  # nats by which it predicts better than the best sound joint
    has_friction: bool
    impedance: Impedance
    parameters: tuple[Parameter, ...]


@dataclass(frozen=True)
class ReflexEstimate:
    """The reflex of a person's joint."""

    probability: float
    delay_s: float
    rising: Parameter  # torque over a lasting speed while the angle rises
    falling: Parameter


@dataclass(frozen=True)
class KnownDelay:
    """What a delay between angle and torque does to B and I, where nobody states it.

    `recording_s` is the standard error to which the recording itself tells a delay. `B` and `I`
    hold any delay of a standard deviation of `known_s`; K does not depend on it.
    """

    known_s: float
    recording_s: float
    B: Estimate
    I: Estimate


@dataclass(frozen=True)
class ImpedanceInference:
    """What one recording tells of a joint.

    Attributes
    ----------
    impedance : Impedance
        The mixture of all hypotheses. It holds what cannot be told apart.
    sound : Impedance
        The best joint of which nothing is at fault, with friction if that predicts better.
    without_friction_column : Impedance
        Eq. 15 alone, as least squares reads it: B has all of the friction.
    fault_probability : float
        Probability of a fault of any size.
    friction_probability : float
        Probability of dry friction.
    friction_harm : float
        By how much K, B or I move if friction is left out, in multiples of what matters.
    harm : float
        By how much faults move K, B or I, in multiples of what matters to the user.
    doubt : Explanation or None
        The most probable fault, if a fault is likely and does harm.
    explanations : tuple of Explanation
        Faults by their probability, the most probable first.
    delay : KnownDelay or None
        What an unstated delay does; None for a drivetrain, whose belt tells it.
    reflex : ReflexEstimate or None
        The reflex of a person's joint, if it probably has one.
    without_reflex : Impedance or None
        The most probable joint without a reflex, for which such a joint would be taken.
    reflex_harm : float
        By how much K, B or I differ between the two, in multiples of what matters to the user.
    VAF_held_out : float
        Variance of the torque accounted for by fits to the other blocks [%], in the motion's band.
    band_hz : float
        End of the band [Hz].
    noise_ratio : float
        Variance of what the best hypothesis leaves, over that of the noise; 1 is a perfect model.
    """

    impedance: Impedance
    sound: Impedance
    without_friction_column: Impedance
    fault_probability: float
    friction_probability: float
    friction_harm: float
    harm: float
    doubt: Explanation | None
    explanations: tuple[Explanation, ...]
    delay: KnownDelay | None
    reflex: ReflexEstimate | None
    without_reflex: Impedance | None
    reflex_harm: float
    VAF_held_out: float
    band_hz: float
    noise_ratio: float

    def to_row(self) -> dict[str, Cell]:
        """Return the cells of one row of a table, in SI units."""
        return {
            **self.impedance.columns(),
            **self.sound.columns("_sound"),
            "fault_probability": self.fault_probability,
            "friction_probability": self.friction_probability,
            "friction_harm": self.friction_harm,
            "harm": self.harm,
            "doubt": self.doubt.family if self.doubt else None,
            "explanation": self.explanations[0].name if self.explanations else None,
            **self._delay_columns(),
            **self._reflex_columns(),
            "VAF_held_out": self.VAF_held_out,
            "band_hz": self.band_hz,
            "noise_ratio": self.noise_ratio,
        }

    def _delay_columns(self) -> dict[str, Cell]:
        names = ("B_known_delay_low", "B_known_delay_high", "I_known_delay_low")
        delay = self.delay
        if delay is None:
            return dict.fromkeys((*names, "I_known_delay_high"))
        return {
            "B_known_delay_low": delay.B.low,
            "B_known_delay_high": delay.B.high,
            "I_known_delay_low": delay.I.low,
            "I_known_delay_high": delay.I.high,
        }

    def _reflex_columns(self) -> dict[str, Cell]:
        names = ("reflex_probability", "reflex_delay_s", "reflex_gain_rising")
        more = ("reflex_gain_rising_se", "reflex_gain_falling", "reflex_gain_falling_se")
        reflex = self.reflex
        if reflex is None:
            return dict.fromkeys((*names, *more))
        return {
            "reflex_probability": reflex.probability,
            "reflex_delay_s": reflex.delay_s,
            "reflex_gain_rising": reflex.rising.value,
            "reflex_gain_rising_se": reflex.rising.standard_error,
            "reflex_gain_falling": reflex.falling.value,
            "reflex_gain_falling_se": reflex.falling.standard_error,
        }
