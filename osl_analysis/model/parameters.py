"""Physical parameters of one device (Table I), each with unit and source, from `config/parameters/`."""

import warnings
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Annotated

from pydantic import BeforeValidator, Field, WithJsonSchema, field_validator

from osl_analysis.errors import InputError, nearest
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
                f"parameter f_G = {self.f_G} N*m/A is not below k_tau n_m = {self.k_tau * self.n_m:g}: gear friction "
                "would exceed the motor's torque; correct the parameter file"
            )
        for name, unit in PARAMETER_UNITS.items():
            value, may_be_0 = getattr(self, name), name not in ("k_tau", "n_m", "J_m", "n_T", "K_s")
            if not (1e-9 <= value <= 1e9 or (value == 0 and may_be_0)):  # a value outside has a wrong exponent
                bound = f"{'zero or ' * may_be_0}positive, 1e-09 to 1e+09"
                raise InputError(f"parameter {name} = {value} {unit} must be {bound}; correct the parameter file")


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
    """A parameter file: the device's name, its joint, a warning that is shown at every use, and the quantities."""

    name: str
    description: str
    joint: str = "ankle"
    """Joint of the device, as in the sample sheet. Trials of other joints are analysed as without a parameter file."""
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
                raise ValueError(f"{name} [{PARAMETER_UNITS[name]}] is missing; add it, with value, unit and source")
        return quantities


FileOrNone = Annotated[Path | None, BeforeValidator(lambda value: value or None)]
"""A parameter file as a rule passes it on: an input without files is an empty list."""


def joint_of(path: Path) -> str:
    """The joint of the device of a parameter file. Raises as `read_parameters`."""
    return read_yaml(path, ParameterFile).joint


def known_parameters(path: Path | None) -> DrivetrainParameters | None:
    """Parameters of a device; None for one without a parameter file. Raises as `read_parameters`."""
    return None if path is None else read_parameters(path)


def read_parameters(path: Path) -> DrivetrainParameters:
    """Parameters of one device, from a file like `config/parameters/default.yaml`, whose warning is given. Raises
    InputError where it is missing, or a quantity is unknown, is missing, has another unit or is out of range."""
    file = read_yaml(path, ParameterFile)
    if file.warning:
        warnings.warn(f"{path}: {' '.join(file.warning.split())}", stacklevel=2)
    try:
        return DrivetrainParameters(**{name: q.value for name, q in file.parameters.items()})
    except InputError as error:
        name = str(error).split(maxsplit=2)[1]
        raise InputError(f"{path}: {located([path], ('parameters', name))}{error}") from error
