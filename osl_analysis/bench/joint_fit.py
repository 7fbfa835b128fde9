"""Results of an impedance recording as values with named fields.

A value is never overwritten: one that is widened is a new value.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from osl_analysis.bench.analysis import QUANTITIES
from osl_analysis.stats.estimates import Estimate, Impedance
from osl_analysis.stats.table_rows import INTERVAL_ENDS, Row


def estimate_columns(name: str, estimate: Estimate | None) -> Row:
    """The columns of an estimate, null where there is none."""
    if estimate is None:
        return dict.fromkeys(f"{name}{end}" for end in INTERVAL_ENDS)
    return estimate.columns(name)


@dataclass(frozen=True)
class FrictionFit:
    """Dry friction beside Eq. 15, and the estimates without it where it is certain.

    Attributes
    ----------
    share : float
        The part of the damping that is certainly friction's; 0 where none is certain.
    size : Estimate or None
        Coulomb friction [N*m]; None where it is not certain.
    without : Impedance or None
        K, B and I of the torque less its friction; None where friction is not certain.
    """

    share: float
    size: Estimate | None = None
    without: Impedance | None = None


def friction_columns(friction: FrictionFit | None) -> Row:
    """The columns of friction, null where the motion does not tell it from damping."""
    without = friction.without if friction else None
    size = friction.size if friction else None
    return {
        "coulomb_share": friction.share if friction else None,
        **estimate_columns("f_C", size),
        **estimate_columns("B_viscous", without.B if without else None),
        **estimate_columns("K_without_friction", without.K if without else None),
        **estimate_columns("I_without_friction", without.I if without else None),
    }


@dataclass(frozen=True)
class SuspectedFault:
    """What else than Eq. 15 and friction the torque may hold.

    Attributes
    ----------
    fault_probability : float
        Probability that a fault is in the recording.
    harm : float
        By how much a probable fault moves K, B or I, in multiples of what matters; 0 where no fault
        is probable.
    family : str or None
        That of the most probable fault, as path, time, speed, size, direction or clipping; None
        where no fault is probable.
    explanations : str or None
        All that are not improbable among the faults, the most probable first.
    offered : Impedance or None
        K, B and I beside the fault. None where no fault is probable and does harm, or where parts
        of the recording that no fit has seen do not prefer it.
    unexplained_shares : tuple of float
        Shares of K, B and I by which torque that nothing explains could move them at most.
    delay_told_s : float or None
        Standard error to which the recording tells a delay [s].
    """

    fault_probability: float
    harm: float
    family: str | None
    explanations: str | None
    offered: Impedance | None
    unexplained_shares: tuple[float, float, float]
    delay_told_s: float | None = None


FAULT_FIELDS = {
    "fault_probability": "fault_probability",
    "fault_harm": "harm",
    "fault_family": "family",
    "explanations": "explanations",
}
"""Fields of a fault by their columns."""
IMPEDANCE_SYMBOLS = {"K": "K", "B": "B", "I": "I"}
LOSSES_SYMBOLS = {"B": "B_j", "I": "J_j"}


def fault_columns(
    fault: SuspectedFault | None, symbols: Mapping[str, str] = IMPEDANCE_SYMBOLS
) -> Row:
    """The columns of a fault, null where no hypotheses were weighed. `symbols` has the names of
    the offered estimates in the table."""
    facts: Row = {column: getattr(fault, field, None) for column, field in FAULT_FIELDS.items()}
    offered = fault.offered if fault else None
    unexplained = fault.unexplained_shares if fault else (None, None, None)
    shares = dict(zip(QUANTITIES, unexplained, strict=True))
    for symbol, column in symbols.items():
        facts[f"{column}_unexplained_share"] = shares[symbol]
        estimate = getattr(offered, symbol) if offered else None
        facts.update(estimate_columns(f"{column}_without", estimate))
    return facts


MIXTURE = "mixture of hypotheses"  # `interval_method` of the inference
MIXTURE_BESIDE_FRICTION = "mixture of hypotheses, B by Eq. 15"  # B holds certain friction


@dataclass(frozen=True)
class JointFit:
    """K, B and I of a recording or of one of its amplitudes, and what else it tells.

    Attributes
    ----------
    impedance : Impedance
        K, B and I. Where friction is certain B holds it, as Eq. 15 does.
    friction : FrictionFit or None
        Dry friction; None where the motion does not tell it from damping.
    suspected_fault : SuspectedFault or None
        What may be wrong; None of a leg, whose drivetrain is no fault of the recording.
    delay_told_s : float or None
        Standard error to which the recording tells a delay that nobody states and none finds [s].
    estimator : str or None
        What gave K, B and I; None of least squares (Eq. 15).
    """

    impedance: Impedance
    friction: FrictionFit | None = None
    suspected_fault: SuspectedFault | None = None
    delay_told_s: float | None = None
    estimator: str | None = None

    def widened_to_include(self, other: "JointFit") -> "JointFit":
        """The fit with intervals that hold those of another fit of the same recording.

        Parameters
        ----------
        other : JointFit
            The same recording, read in another way.

        Returns
        -------
        JointFit
            Estimates of this fit; its intervals, and those beside friction, hold both.
        """
        friction = self.friction
        if friction and friction.without and other.friction and other.friction.without:
            without = friction.without.widened_to_include(other.friction.without)
            friction = replace(friction, without=without)
        return replace(
            self,
            impedance=self.impedance.widened_to_include(other.impedance),
            friction=friction,
        )

    def to_row(self) -> Row:
        """The cells of one row of `impedance.csv`, in SI units."""
        return {
            **self.impedance.K.columns("K"),
            **self.impedance.B.columns("B"),
            **self.impedance.I.columns("I"),
            "K_se": self.impedance.K.standard_error,
            "B_se": self.impedance.B.standard_error,
            "I_se": self.impedance.I.standard_error,
            **friction_columns(self.friction),
            **fault_columns(self.suspected_fault),
            "delay_told_s": self.delay_told_s,
        }
