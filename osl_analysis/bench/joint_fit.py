"""Results of an impedance recording as values with named fields.

A value is never overwritten: one that is widened is a new value.
"""

from collections.abc import Sequence
from dataclasses import dataclass

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
    fault_shares : tuple of float
        Shares of K, B and I by which probable faults move them at most; 0 where none is probable.
    family : str or None
        That of the most probable fault, as path, time, speed, size, direction or clipping; None
        where no fault is probable.
    explanations : str or None
        All that are not improbable among the faults, the most probable first.
    unexplained_shares : tuple of float
        Shares of K, B and I by which torque that nothing explains could move them at most.
    delay_told_s : float or None
        Standard error to which the recording tells a delay [s].
    """

    fault_probability: float
    fault_shares: tuple[float, ...]
    family: str | None
    explanations: str | None
    unexplained_shares: tuple[float, float, float]
    delay_told_s: float | None = None


FAULT_FIELDS = {
    "fault_probability": "fault_probability",
    "fault_family": "family",
    "explanations": "explanations",
}
"""Fields of a fault by their columns."""
COLUMNS_OF_LOSSES = (None, "B_j", "J_j")  # of K, B and I in `transmission.csv`


def fault_columns(fault: SuspectedFault | None, names: Sequence[str | None] = QUANTITIES) -> Row:
    """The columns of a fault, null where no hypotheses were weighed. `names` are those of K, B and
    I in the table; None: it has no such column."""
    facts: Row = {column: getattr(fault, field, None) for column, field in FAULT_FIELDS.items()}
    for k, name in enumerate(names):
        if name is not None:
            facts[f"{name}_fault_share"] = fault.fault_shares[k] if fault else None
            facts[f"{name}_unexplained_share"] = fault.unexplained_shares[k] if fault else None
    return facts


@dataclass(frozen=True)
class JointFit:
    """K, B and I of a recording or of one of its amplitudes, and what else it tells.

    Attributes
    ----------
    impedance : Impedance
        K, B and I of Eq. 15; B holds the friction.
    friction : FrictionFit or None
        Dry friction; None where the motion does not tell it from damping.
    suspected_fault : SuspectedFault or None
        What may be wrong; None of a leg, whose drivetrain is no fault of the recording.
    delay_told_s : float or None
        Standard error to which the recording tells a delay that nobody states and none finds [s].
    """

    impedance: Impedance
    friction: FrictionFit | None = None
    suspected_fault: SuspectedFault | None = None
    delay_told_s: float | None = None

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
