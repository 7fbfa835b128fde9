"""The nomenclature: every canonical column of a trial, with symbol, unit and sign.

Ingest converts to these units and signs. Later steps convert nothing.
"""

import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Column:
    symbol: str  # of the paper; empty where it has none
    unit: str  # SI
    meaning: str  # what it is, and what a positive value means


COLUMNS: dict[str, Column] = {
    "time": Column("t", "s", "experiment time as stamped, which never goes back"),
    "theta": Column("θ_j", "rad", "joint angle from the bench's or the leg's joint encoder, dorsiflexion positive"),
    "theta_m": Column("θ_m", "rad", "actuator output angle, after the gear and before the belt"),
    "omega_m": Column(
        "dθ_m/dt", "rad/s", "actuator output velocity, for the actuator's own bench where that logs no theta_m"
    ),
    "theta_command": Column("θ_j*", "rad", "joint angle that the dynamometer was told to follow"),
    "current": Column("I_q", "A", "q-axis motor current"),
    "torque": Column("τ", "N*m", "resisting joint torque, minus the τ_j of Eq. 4; internal plantarflexion moment"),
    "torque_m": Column(
        "τ_m", "N*m", "torque that the actuator exerts at its output, positive if it drives θ_m up (Eq. 1)"
    ),
    "K_1": Column("K_1", "N*m/rad", "stiffness gain that the leg applied at the actuator output"),
    "B_1": Column("B_1", "N*m*s/rad", "damping gain that the leg applied at the actuator output"),
    "sync": Column("", "V", "synchronisation pulse train, shared by the recorders"),
    "trigger": Column("", "V", "trigger of the perturbation platform"),
}

AXES = ("x", "y", "z")

# units of columns that exist once per marker, plate or side of the laboratory
FAMILIES = {
    re.compile(r"marker_.+_[xyz]", re.DOTALL): "m",  # a label is the laboratory's own
    re.compile(r"plate[1-9][0-9]*_force_[xyz]"): "N",
    re.compile(r"plate[1-9][0-9]*_moment_[xyz]"): "N*m",
    re.compile(r"reference_ankle_moment_(left|right)"): "N*m/kg",
}


def marker_columns(label: str) -> tuple[str, str, str]:
    """Columns of one marker's position in the laboratory [m]; NaN where the marker was not seen."""
    return f"marker_{label}_x", f"marker_{label}_y", f"marker_{label}_z"


def plate_columns(plate: int, quantity: str) -> tuple[str, str, str]:
    """Columns of one force plate, counted from 1: ground reaction `force` [N] or `moment` [N*m].

    Both act on the foot, are expressed in the laboratory axes of the plate's resting pose, and the moment is
    about the centre of the plate's surface (the mean of its four corners).
    """
    name = f"plate{plate}_{quantity}"
    return f"{name}_x", f"{name}_y", f"{name}_z"


def counter_column(column: str) -> str:
    """Column with the device's own count of the samples of a column, where the source file names its `counter`."""
    return f"{column}_counter"


def unit_of(column: str) -> str:
    of_family = (unit for pattern, unit in FAMILIES.items() if pattern.fullmatch(column))
    return next(of_family, None) or COLUMNS[column].unit
