"""The drivetrain: physical parameters of one device (Table I), each with unit and source, from
`config/parameters/`; actuator (Eqs. 1-2), belt transmission (Eqs. 3-4), joint admittance (Eqs.
8-11), in the paper's signs."""

import warnings
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BeforeValidator, Field, WithJsonSchema, field_validator

from osl_analysis.errors import InputError, nearest
from osl_analysis.trial import Array
from osl_analysis.yaml_settings import Settings, located, misplaced, read_yaml

PARAMETER_UNITS = {
    "k_tau": "N*m/A", "n_m": "1", "B_m": "N*m*s/rad", "J_m": "kg*m^2", "f_C": "N*m", "f_G": "N*m/A",
    "n_T": "1", "K_s": "N*m/rad", "K_s2": "N*m/rad^2", "B_j": "N*m*s/rad", "J_j": "kg*m^2",
}  # fmt: skip


@dataclass(frozen=True)
class DrivetrainParameters:
    """Actuator and transmission (Table I) in SI units; J_m and B_m are at the actuator's output."""

    k_tau: float
    n_m: float
    B_m: float
    J_m: float
    f_C: float
    f_G: float
    n_T: float
    K_s: float
    B_j: float
    J_j: float
    K_s2: float = 0.0

    def __post_init__(self) -> None:
        if self.f_G >= self.k_tau * self.n_m:
            raise InputError(
                f"parameter f_G = {self.f_G} N*m/A is not below k_tau n_m ="
                f" {self.k_tau * self.n_m:g}: gear friction would exceed the motor's torque;"
                " correct the parameter file"
            )
        for name, unit in PARAMETER_UNITS.items():
            value, may_be_0 = getattr(self, name), name not in ("k_tau", "n_m", "J_m", "n_T", "K_s")
            # a value outside has a wrong exponent
            if not (1e-9 <= value <= 1e9 or (value == 0 and may_be_0)):
                bound = f"{'zero or ' * may_be_0}positive, 1e-09 to 1e+09"
                raise InputError(
                    f"parameter {name} = {value} {unit} must be {bound}; correct the parameter file"
                )


class Quantity(Settings):
    """A number, its unit and its source. A ratio may be written as a fraction, such as 83/18."""

    value: Annotated[float, WithJsonSchema({"type": ["number", "string"]})]
    unit: Annotated[str, WithJsonSchema({"enum": sorted(set(PARAMETER_UNITS.values()))})]
    source: str = Field(min_length=1)

    @field_validator("value", mode="before")
    @classmethod
    def _ratio(cls, value: object) -> object:
        try:
            return float(Fraction(value)) if isinstance(value, str) else value
        except (ValueError, ZeroDivisionError, OverflowError) as error:
            raise ValueError("write a number or a ratio such as 83/18") from error


class ParameterFile(Settings):
    """A parameter file: the device's name, its joint, a warning that is shown at every use, and the
    quantities."""

    name: str
    description: str
    joint: str = "ankle"
    """Joint of the device, as in the sample sheet. Trials of other joints are analysed as without a
    parameter file."""
    warning: str = ""
    parameters: dict[str, Quantity]

    @field_validator("parameters")
    @classmethod
    def _complete(cls, quantities: dict[str, Quantity]) -> dict[str, Quantity]:
        for name, quantity in quantities.items():
            if name not in PARAMETER_UNITS:
                like = nearest(name, set(PARAMETER_UNITS) - set(quantities)) or "; remove it"
                known = f"the known ones are {', '.join(PARAMETER_UNITS)}{like}"
                raise misplaced(f"unknown parameter {name}; {known}", name)
            if quantity.unit != (unit := PARAMETER_UNITS[name]):
                said = f"{name} has unit '{quantity.unit}', expected '{unit}'; convert its value"
                raise misplaced(said, name, "unit")
        for name in PARAMETER_UNITS:
            if name not in quantities and name != "K_s2":
                raise ValueError(
                    f"{name} [{PARAMETER_UNITS[name]}] is missing; add it, with value, unit and"
                    " source"
                )
        return quantities


FileOrNone = Annotated[Path | None, BeforeValidator(lambda value: value or None)]
"""A parameter file as rules pass it on: an input without files is an empty list."""


def joint_of(path: Path) -> str:
    """The joint of the device of a parameter file. Raises as `read_parameters`."""
    return read_yaml(path, ParameterFile).joint


def known_parameters(path: Path | None) -> DrivetrainParameters | None:
    """Parameters of a device; None for one without a parameter file. Raises as
    `read_parameters`."""
    return None if path is None else read_parameters(path)


def read_parameters(path: Path) -> DrivetrainParameters:
    """Parameters of one device, from a file like `config/parameters/default.yaml`, whose warning is
    given. Raises InputError where it is missing, or a quantity is unknown, is missing, has another
    unit or is out of range."""
    file = read_yaml(path, ParameterFile)
    if file.warning:
        warnings.warn(f"{path}: {' '.join(file.warning.split())}", stacklevel=2)
    try:
        return DrivetrainParameters(**{name: q.value for name, q in file.parameters.items()})
    except InputError as error:
        name = str(error).split(maxsplit=2)[1]
        raise InputError(f"{path}: {located([path], ('parameters', name))}{error}") from error


@dataclass(frozen=True)
class RationalFunction:
    """numerator(s) / denominator(s); coefficients with the highest power first."""

    numerator: Array
    denominator: Array

    def __call__(self, s: ArrayLike) -> NDArray[np.complex128]:
        """Value at complex frequencies s [rad/s], any shape."""
        s = np.asarray(s, dtype=np.complex128)
        return np.asarray(
            np.polyval(self.numerator, s) / np.polyval(self.denominator, s), dtype=np.complex128
        )

    def poles(self) -> NDArray[np.complex128]:
        """Roots of the denominator [rad/s]."""
        return np.roots(self.denominator).astype(np.complex128)


def motor_friction(direction: ArrayLike, current: ArrayLike, p: DrivetrainParameters) -> Array:
    """Coulomb and gear friction f [N*m] at the actuator's output (Eq. 2) for a current I_q [A].
    `direction` is the sign of omega_m, or a smooth substitute between -1 and 1."""
    return np.asarray(np.asarray(direction) * (p.f_C + p.f_G * np.abs(current)))


def actuator_torque(
    current: ArrayLike, omega_m: ArrayLike, alpha_m: ArrayLike, p: DrivetrainParameters
) -> Array:
    """Torque tau_m [N*m] at the actuator's output from I_q [A], omega_m [rad/s] and alpha_m
    [rad/s^2] (Eq. 1)."""
    friction = motor_friction(np.sign(omega_m), current, p)
    driven = np.asarray(current) * p.k_tau * p.n_m
    return np.asarray(driven - friction - p.B_m * np.asarray(omega_m) - p.J_m * np.asarray(alpha_m))


def belt_deflection(theta: ArrayLike, theta_m: ArrayLike, p: DrivetrainParameters) -> Array:
    """Deflection theta_s [rad] of the belt, seen at the joint (Eq. 3)."""
    return np.asarray(theta) - np.asarray(theta_m) / p.n_T


def belt_torque(theta_s: ArrayLike, p: DrivetrainParameters) -> Array:
    """Torque tau_s [N*m] in the belt (Eq. 8), plus the quadratic term K_s2, which is 0 in most
    parameter files."""
    theta_s = np.asarray(theta_s)
    return np.asarray(p.K_s * theta_s + p.K_s2 * theta_s * np.abs(theta_s))


def desired_admittance(K_d: float, B_d: float) -> RationalFunction:
    """Y_d = 1/Q = 1/(B_d s + K_d) [rad/(N*m)] (Eq. 11). If K_d/B_d is above 1e9 rad/s, B_d counts
    as 0."""
    return RationalFunction(np.array([1.0]), np.array([B_d, K_d] if B_d > 1e-9 * K_d else [K_d]))


def joint_admittance(
    K_1: float, B_1: float, p: DrivetrainParameters, J_j: float = 0.0
) -> RationalFunction:
    """Closed-loop integral admittance Y = theta_j/tau [rad/(N*m)] for gains K_1 and B_1 (Eqs.
    9-10).

    Y = N/D with

        N = J_m s^2 + x s + kappa      the actuator under control, x = B_m + B_1, kappa = K_1 +
        K_s/n_T^2 P = J_j s^2 + B_j s + K_s      the joint that the belt holds D = N P - c
        c = (K_s/n_T)^2

    The other modules use the same letters. The paper neglects J_j. `J_j=p.J_j` includes it, one
    power more."""
    N = np.array([p.J_m, p.B_m + B_1, K_1 + p.K_s / p.n_T**2])
    P = np.array([J_j, p.B_j, p.K_s])
    D = np.convolve(N, P)
    D[-1] -= p.K_s**2 / p.n_T**2
    return RationalFunction(N, D if J_j else D[1:])
