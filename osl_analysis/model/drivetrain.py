# SPDX-License-Identifier: Apache-2.0
"""The drivetrain: physical parameters of one device (Table I), each with unit and source, from
`config/parameters/`; actuator (Eqs. 1-2), belt transmission (Eqs. 3-4), joint admittance (Eqs.
8-11), in the paper's signs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray
from pydantic import BeforeValidator, Field, WithJsonSchema, field_validator

from osl_analysis.base.errors import InputError, advise, nearest, on_one_line
from osl_analysis.base.files import digest
from osl_analysis.base.trial import Array
from osl_analysis.base.yaml_settings import Settings, from_fraction, misplaced, read_yaml

PARAMETER_UNITS = {
    "k_tau": "N*m/A",
    "n_m": "1",
    "B_m": "N*m*s/rad",
    "J_m": "kg*m^2",
    "f_C": "N*m",
    "f_G": "N*m/A",
    "n_T": "1",
    "K_s": "N*m/rad",
    "K_s2": "N*m/rad^2",
    "B_j": "N*m*s/rad",
    "J_j": "kg*m^2",
}
NEVER_ZERO = ("k_tau", "n_m", "J_m", "n_T", "K_s")  # each divides or drives
REQUIRED = tuple(name for name in PARAMETER_UNITS if name != "K_s2")  # of the drivetrain's model
# a parameter outside, in SI units, has a wrong exponent
SMALLEST_PARAMETER = 1e-9
LARGEST_PARAMETER = 1e9
LONGEST_LOOP_DELAY = 0.1  # s; a longer one is in ms


@dataclass(frozen=True)
class DrivetrainParameters:
    """Actuator and transmission (Table I); J_m and B_m are at the actuator's output. NaN is a
    parameter that is not known."""

    k_tau: float  # torque constant of the motor [N*m/A]
    n_m: float  # gear ratio of the actuator
    B_m: float  # viscous damping of the actuator [N*m*s/rad]
    J_m: float  # inertia of the actuator [kg*m^2]
    f_C: float  # Coulomb friction [N*m]
    f_G: float  # gear friction [N*m/A]
    n_T: float  # ratio of the belt transmission
    K_s: float  # stiffness of the belt at the joint [N*m/rad]
    B_j: float  # viscous damping of the joint [N*m*s/rad]
    J_j: float  # inertia of the joint [kg*m^2]
    K_s2: float = 0.0  # quadratic stiffness of the belt [N*m/rad^2]

    @property
    def K_s_at_actuator(self) -> float:
        """Stiffness of the belt at the actuator's output [N*m/rad]."""
        return self.K_s / self.n_T**2


class Quantity(Settings):
    """A number, its unit and its source. A ratio may be written as a fraction, such as 83/18."""

    value: Annotated[
        float, BeforeValidator(from_fraction), WithJsonSchema({"type": ["number", "string"]})
    ]
    unit: Annotated[str, WithJsonSchema({"enum": sorted(set(PARAMETER_UNITS.values()))})]
    source: str = Field(min_length=1)
    standard_error: Annotated[float | None, Field(ge=0)] = None
    """Standard uncertainty, in the same unit; null: not stated."""


class ParameterFile(Settings):
    """A parameter file: the device's name, its joint, a warning that is shown at every use, and the
    quantities that are known."""

    name: str
    description: str
    joint: str = "ankle"
    """Joint of the device, as in the sample sheet. Trials of other joints are analysed as without a
    parameter file."""
    warning: str = ""
    loop_delay: Annotated[float | None, Field(ge=0, lt=LONGEST_LOOP_DELAY)] = None
    """Time [s] from a sample of theta_m to the torque that the controller makes of it; null: not
    stated."""
    parameters: dict[str, Quantity]

    @field_validator("parameters")
    @classmethod
    def _are_possible(cls, quantities: dict[str, Quantity]) -> dict[str, Quantity]:
        wrong = {name: wrong_in(name, quantity) for name, quantity in quantities.items()}
        values = {name: quantity.value for name, quantity in quantities.items()}
        if values.get("f_G", 0.0) >= values.get("k_tau", np.inf) * values.get("n_m", 1.0):
            wrong["f_G"] = (
                f"parameter f_G = {values['f_G']} N*m/A is not below k_tau n_m: gear friction would"
                " exceed the motor's torque; correct it"
            )
        faults = {name: fault for name, fault in wrong.items() if fault}
        if faults:  # all are told, with the line of the first
            raise misplaced("; ".join(faults.values()), next(iter(faults)))
        return quantities


def wrong_in(name: str, quantity: Quantity) -> str:
    """What is wrong with a quantity: it is unknown, in another unit, or has a wrong exponent; empty
    for nothing."""
    if name not in PARAMETER_UNITS:
        known = ", ".join(PARAMETER_UNITS)
        return f"unknown parameter {name}; known are {known}{nearest(name, PARAMETER_UNITS)}"
    unit = PARAMETER_UNITS[name]
    if quantity.unit != unit:
        return f"{name} has unit '{quantity.unit}', expected '{unit}'; convert its value"
    zero = "" if name in NEVER_ZERO else "zero or "
    if (zero and quantity.value == 0) or SMALLEST_PARAMETER <= quantity.value <= LARGEST_PARAMETER:
        return ""
    return f"parameter {name} = {quantity.value} {unit} must be {zero}positive, 1e-09 to 1e+09"


def joint_of(path: Path) -> str:
    """The joint of the device of a parameter file. Raises as `read_parameters`."""
    return read_yaml(path, ParameterFile).joint


# to validate it takes 2 ms, and a notebook fits many trials
@lru_cache(maxsize=8)
def file_of_state(path: Path, state: str | None) -> ParameterFile:
    """What a parameter file holds while its `state` is the same. Raises as `read_parameters`."""
    return read_yaml(path, ParameterFile)


def known_parameters(
    path: Path | None, needed: Sequence[str] = REQUIRED
) -> DrivetrainParameters | None:
    """Parameters of a device, whose warning is given; None without a parameter file, or where it
    lacks one that is `needed`. Raises as `read_parameters`, but that none is missing."""
    if path is None:
        return None
    file = file_of_state(path, digest(path))
    if file.warning:
        advise(f"{path}: {on_one_line(file.warning)}")
    if not file.parameters.keys() >= {*needed}:
        return None
    known = {name: quantity.value for name, quantity in file.parameters.items()}
    return DrivetrainParameters(**dict.fromkeys(REQUIRED, np.nan) | known)


class StatedOfDevice(NamedTuple):
    """What a parameter file may state beside its values."""

    standard_errors: Mapping[str, float]  # by parameter, in its unit
    loop_delay: float | None  # [s]


NOTHING_STATED = StatedOfDevice({}, None)


def stated_of_device(path: Path | None) -> StatedOfDevice:
    """What a parameter file states beside its values. Raises as `read_parameters`."""
    if path is None:
        return NOTHING_STATED
    file = file_of_state(path, digest(path))
    errors = {name: quantity.standard_error for name, quantity in file.parameters.items()}
    known = {name: error for name, error in errors.items() if error is not None}
    return StatedOfDevice(known, file.loop_delay)


def read_parameters(path: Path) -> DrivetrainParameters:
    """Read all parameters of one device, and give the file's warning.

    Parameters
    ----------
    path : Path
        A file like `config/parameters/default.yaml`.

    Returns
    -------
    DrivetrainParameters

    Raises
    ------
    InputError
        The file is missing, or quantities are unknown, are missing, have another unit or are out of
        range.
    """
    parameters = known_parameters(path)
    if parameters is None:
        stated_parameters = read_yaml(path, ParameterFile).parameters
        missing = [
            f"{name} [{PARAMETER_UNITS[name]}]"
            for name in REQUIRED
            if name not in stated_parameters
        ]
        raise InputError(
            f"{path}: the model of the drivetrain needs {', '.join(missing)}, which the file lacks",
            "add each with value, unit and source",
        )
    return parameters


def motor_friction(direction: ArrayLike, current: ArrayLike, p: DrivetrainParameters) -> Array:
    """Find Coulomb and gear friction at the actuator's output (Eq. 2).

    Parameters
    ----------
    direction : ArrayLike
        Sign of omega_m, or a smooth substitute between -1 and 1.
    current : ArrayLike
        I_q [A].
    p : DrivetrainParameters

    Returns
    -------
    Array
        f = direction (f_C + f_G abs(I_q)) [N*m].
    """
    return np.asarray(np.asarray(direction) * (p.f_C + p.f_G * np.abs(current)))


def actuator_torque(
    current: ArrayLike, omega_m: ArrayLike, alpha_m: ArrayLike, p: DrivetrainParameters
) -> Array:
    """Find the torque at the actuator's output (Eq. 1).

    Parameters
    ----------
    current, omega_m, alpha_m : ArrayLike
        I_q [A], omega_m [rad/s] and alpha_m [rad/s^2].
    p : DrivetrainParameters

    Returns
    -------
    Array
        tau_m = I_q k_tau n_m - f - B_m omega_m - J_m alpha_m [N*m].
    """
    friction = motor_friction(np.sign(omega_m), current, p)
    driven = np.asarray(current) * p.k_tau * p.n_m
    return np.asarray(driven - friction - p.B_m * np.asarray(omega_m) - p.J_m * np.asarray(alpha_m))


def belt_deflection(theta: ArrayLike, theta_m: ArrayLike, p: DrivetrainParameters) -> Array:
    """Deflection theta_s [rad] of the belt, seen at the joint (Eq. 3)."""
    return np.asarray(theta) - np.asarray(theta_m) / p.n_T


def held_actuator(
    s: ArrayLike, K_1: ArrayLike, B_1: ArrayLike, p: DrivetrainParameters, delay: ArrayLike = 0.0
) -> NDArray[np.complex128]:
    """N of `dynamic_stiffness`: the actuator under its controller, with the joint held."""
    s = np.asarray(s, dtype=np.complex128)
    controlled = (np.asarray(K_1) + np.asarray(B_1) * s) * np.exp(-s * np.asarray(delay))
    return np.asarray(p.J_m * s**2 + p.B_m * s + controlled + p.K_s_at_actuator)


def dynamic_stiffness(
    s: ArrayLike, K_1: ArrayLike, B_1: ArrayLike, p: DrivetrainParameters, delay: ArrayLike = 0.0
) -> NDArray[np.complex128]:
    """Find the closed-loop dynamic stiffness of the joint (Eqs. 9-10), the inverse of its integral
    admittance, with the inertia J_j that the paper neglects.

    Parameters
    ----------
    s : ArrayLike
        Complex frequencies [rad/s].
    K_1, B_1 : ArrayLike
        Gains [N*m/rad] and [N*m*s/rad] that broadcast with them.
    p : DrivetrainParameters
    delay : ArrayLike
        By which the controller acts late [s].

    Returns
    -------
    Array
        Z = tau/theta_j [N*m/rad].

    Notes
    -----
    Z = 1/Y = D/N = P - c/N, with letters that the other modules use, too::

        N = J_m s^2 + x s + kappa      the actuator under control,
                                       x = B_m + B_1, kappa = K_1 + K_s/n_T^2
        P = J_j s^2 + B_j s + K_s      the joint that the belt holds
        D = N P - c                    c = (K_s/n_T)^2
    """
    s = np.asarray(s, dtype=np.complex128)
    c = p.K_s**2 / p.n_T**2
    return np.asarray(p.J_j * s**2 + p.B_j * s + p.K_s - c / held_actuator(s, K_1, B_1, p, delay))


# What gains render: the delays that it bears, and K and B that a fit will estimate. The
# dynamic stiffness is Z = 1/Y = P - c/N, in the letters of
# `drivetrain.dynamic_stiffness`. At s = j w the joint takes in energy at the rate of Im Z
# = w (B_j + c x/|N|^2), which is positive for every x = B_m + B_1 > 0: without a delay it
# is passive with every gain that Eq. 14 selects.


PASSIVE_TO_HZ = 10.0  # twice the fastest motion of the draft's protocol
DELAY_STEP = 1e-4  # s, to which a delay is told
LONGEST_DELAY = 0.05  # s; of a loop that is closed at 20 Hz
Spectrum = NDArray[np.complex128]
Stiffness = Callable[[Any], Any]
"""Torque over angle [N*m/rad] at frequencies s [rad/s]."""


def delay_margin(K_1: float, B_1: float, p: DrivetrainParameters) -> float:
    """Smallest delay [s] of the control loop that makes the held actuator, J_m s^2 + B_m s + k
    under K_1 + B_1 s, unstable; infinite if it is stable with any delay.

    The loop gain is 1 where v = w^2 solves

        J_m^2 v^2 + (B_m^2 - B_1^2 - 2 J_m k) v + k^2 - K_1^2 = 0,   k = K_s/n_T^2.
    """
    k = p.K_s_at_actuator
    roots = np.roots([p.J_m**2, p.B_m**2 - B_1**2 - 2 * p.J_m * k, k**2 - K_1**2])
    margin = np.inf
    for v in roots[np.isreal(roots)].real.tolist():
        if v > 0:
            w = np.sqrt(v)
            loop = (K_1 + 1j * w * B_1) / (k - p.J_m * v + 1j * w * p.B_m)
            phase_margin = np.mod(np.pi + np.angle(loop), 2 * np.pi)
            margin = min(margin, float(phase_margin / w))
    return margin


def passive_delay(
    K_1: float, B_1: float, p: DrivetrainParameters, highest_hz: float = PASSIVE_TO_HZ
) -> float:
    """Smallest delay [s] of the control loop with which the joint gives away energy at some
    frequency up to `highest_hz`; infinite where none up to `LONGEST_DELAY` does.

    The joint takes in energy at s = j w where Im Z is positive.
    """
    s = 2j * np.pi * np.geomspace(highest_hz / 1e3, highest_hz, 360)
    delays = np.arange(LONGEST_DELAY, 0, -DELAY_STEP)
    for rising in np.array_split(delays[::-1], 25):  # most gains bear few, and the others cost time
        Z = dynamic_stiffness(s, K_1, B_1, p, rising[:, None])
        gives_energy = (Z.imag < 0).any(axis=1)
        if gives_energy.any():
            return float(rising[gives_energy].min())
    return np.inf


def predicted_impedance(
    K_1: float, B_1: float, p: DrivetrainParameters, frequencies_hz: Sequence[float]
) -> tuple[float, float]:
    """Predict the fit of Eq. 15 to a stepped sine on the linear drivetrain without friction.

    Parameters
    ----------
    K_1, B_1 : float
        Gains [N*m/rad] and [N*m*s/rad].
    p : DrivetrainParameters
    frequencies_hz : Sequence of float
        Of the stepped sine [Hz], with the same number of cycles at each: the number of samples goes
        with 1/f.

    Returns
    -------
    K, B : float
        [N*m/rad] and [N*m*s/rad] by least squares.
    """
    w = 2 * np.pi * np.asarray(frequencies_hz, dtype=float)
    Z = dynamic_stiffness(1j * w, K_1, B_1, p)
    # Re Z = K - I w^2, Im Z = B w
    K = np.polyfit(w**2, Z.real, 1, w=1 / np.sqrt(w))[1]
    B = np.average(Z.imag / w, weights=w)
    return float(K), float(B)


@dataclass(frozen=True)
class MotionSpectrum:
    """A motion as a spectrum, without its mean and without what is faster than counts, from which
    the torques of many stiffnesses are made.

    Attributes
    ----------
    s : Array (f,)
        Frequencies [rad/s], times i.
    angle : Array (f,)
        Lines of the angle [rad].
    n : int
        Samples of the angle.
    rows : int
        The same with the mirror image that makes the angle periodic.
    """

    s: Spectrum
    angle: Spectrum
    n: int
    rows: int

    def torque(self, stiffness: Stiffness) -> Array:
        """Torque (n,) [N*m] of a joint of this dynamic stiffness, or (k, n) of several (k, f)."""
        return scipy.fft.irfft(self.angle * stiffness(self.s), self.rows)[..., : self.n]


def motion_spectrum(theta: Array, rate_hz: float, highest_hz: float) -> MotionSpectrum:
    """The spectrum of an angle (n,) [rad] that counts up to a frequency."""
    n = len(theta)
    # it rests between angle and mirror image: transforms of other lengths take up to a hundred
    # times as long
    rows = 2 * scipy.fft.next_fast_len(n)
    at_rest = np.full(rows - 2 * n, theta[-1])
    frequency_hz = scipy.fft.rfftfreq(rows, 1 / rate_hz)
    counts = frequency_hz < highest_hz
    angle = scipy.fft.rfft(np.concatenate([theta, at_rest, theta[::-1]]))[counts]
    angle[0] = 0.0
    s = np.asarray(2j * np.pi * frequency_hz[counts], dtype=np.complex128)
    return MotionSpectrum(s, angle, n, rows)


def linear_torque(
    stiffness: Stiffness,
    theta: Array,
    rate_hz: float,
    highest_hz: float,
) -> Array:
    """Find the torque of a joint of this dynamic stiffness for a motion without what is faster.

    Parameters
    ----------
    stiffness : Stiffness
        Of one joint, or of several (k, f).
    theta : Array
        Angle (n,) [rad]; its mean does not count. Its mirror image is added to make it periodic.
    rate_hz : float
    highest_hz : float
        Up to which the motion counts.

    Returns
    -------
    Array
        (n,) or (k, n) [N*m].
    """
    return motion_spectrum(theta, rate_hz, highest_hz).torque(stiffness)
