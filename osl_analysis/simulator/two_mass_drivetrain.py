# SPDX-License-Identifier: Apache-2.0
"""The two-mass drivetrain in time: prescribed joint motion, actuator with friction, sampled
controller.

Between two samples of the controller the actuator is integrated in `substeps` fine steps by the
second-order Stoermer-Verlet scheme (half drift, kick, half drift):

    J_m domega_m/dt = k_tau n_m I_q - f - B_m omega_m + tau_s/n_T

where tau_s is the belt's torque at theta_s = theta - theta_m/n_T. Friction enters the kick
implicitly with the true sign of the velocity. The actuator therefore sticks exactly, for any step.

In its place a trial may have a joint of Eq. 15.
"""

import math
from collections import namedtuple
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numba
import numpy as np

from osl_analysis.base.errors import InputError
from osl_analysis.base.trial import Array
from osl_analysis.model.drivetrain import PARAMETER_UNITS, DrivetrainParameters

RUNS_AWAY = 100.0  # angle of the output, 16 turns [rad]: beyond it the control loop is unstable

# the effects by which drivetrain and controller differ from the linear model
EFFECTS = (
    "friction",  # whether there is any. Without it the controller cancels none
    "friction_scale",  # true friction over that of the parameters, which the controller cancels
    "cancels_friction",  # whether the controller adds the friction term of Eq. 5
    "control_delay",  # from a measurement to the current computed from it [updates]
    "encoder_resolution",  # [rad] at the actuator's output. 0: an ideal encoder
    # of the one-pole low-pass over the differentiated encoder. 0: the true velocity
    "velocity_cutoff_hz",
    "sign_width",  # velocity [rad/s] over which the controller smooths its sign
    "hysteresis_torque",  # largest rate-independent torque [N*m] of the belt
    # deflection [rad] over which the hysteresis torque changes sign after a reversal
    "hysteresis_width",
    "substeps",  # integration steps per sample
    # per sample; the current is held in between. As many as `substeps`: it is continuous
    "control_updates",
)
# parameters and effects, as compiled functions take them
Constants: Any = namedtuple("Constants", [*PARAMETER_UNITS, *EFFECTS])  # type: ignore[misc]


def constants(effects: Mapping[str, float], p: DrivetrainParameters) -> Any:
    """Parameters and effects (`EFFECTS`) as compiled functions take them."""
    return Constants(**asdict(p), **effects)


def simulate_drivetrain(
    rate_hz: float,
    theta: Array,
    omega: Array,
    commands: Array,
    effects: Mapping[str, float],
    p: DrivetrainParameters,
    theta_m_start: float = 0.0,
) -> dict[str, Array]:
    """Simulate the drivetrain under a prescribed joint motion, from rest.

    Parameters
    ----------
    rate_hz : float
        Sampling rate [Hz].
    theta, omega : Array
        Motion of the joint, (n,) [rad] and [rad/s]. omega must be the exact derivative of theta,
        because the motion is interpolated by cubic Hermite polynomials.
    commands : Array
        (3, n) or (3, 1): K_1 [N*m/rad], B_1 [N*m*s/rad] and theta_eq [rad] at the actuator's
        output.
    effects : Mapping
        By the `EFFECTS`.
    p : DrivetrainParameters
    theta_m_start : float
        Angle of the actuator at rest [rad].

    Returns
    -------
    dict
        True values at the samples, (n,) each: theta_m [rad], omega_m [rad/s], current [A], applied
        from that sample on, and belt_torque [N*m] with hysteresis.

    Raises
    ------
    InputError
        The actuator runs away.
    """
    columns = np.empty((4, len(theta)))
    gains = np.ascontiguousarray(commands, dtype=float)
    integrate(
        np.ascontiguousarray(theta, dtype=float),
        np.ascontiguousarray(omega, dtype=float),
        gains,
        float(theta_m_start),
        float(rate_hz),
        constants(effects, p),
        columns,
    )
    if not np.abs(columns[0]).max(initial=0.0) <= RUNS_AWAY:  # NaN is none either
        raise InputError(
            f"the simulated actuator runs away, beyond {RUNS_AWAY:g} rad: its loop is unstable"
            f" with K_1 up to {gains[0].max():.4g} N*m/rad, B_1 down to {gains[1].min():.4g}"
            " N*m*s/rad",
            "lower effects.control_delay, raise effects.velocity_filter or control_updates, or"
            " ask for more damping",
        )
    return dict(zip(("theta_m", "omega_m", "current", "belt_torque"), columns, strict=True))


def compiled(function: Any) -> Any:
    """Compile a function, and keep the result on disk where a folder can be written.

    A product and a sum are one operation, rounded once, on processors that have it: a long chain
    takes an eighth less time. On other processors results differ in the last bit.
    """
    options: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}}
    try:
        return numba.njit(function, cache=True, **options)
    except (RuntimeError, OSError):
        return numba.njit(function, **options)


@compiled
def turned_belt(theta_s: float, z: float, turned_to: float, per_rad: float) -> float:
    """State z in [-1, 1] of the belt's hysteresis after its deflection went from theta_s to
    `turned_to` [rad]: z tends to the sign of this change.

    Exact for a monotone change. Most of the simulation's time is spent here. For short steps, the
    series of (1 - exp(-x))/x is exact to 1e-16 and takes a third of the time.
    """
    change = (turned_to - theta_s) * per_rad
    x = abs(change)
    if x > 1 / 16:
        return z + (z - math.copysign(1.0, change)) * math.expm1(-x)
    squared = x * x
    low = 1.0 - x / 2 + (1 / 6 - (1 / 24) * x) * squared
    high = 1 / 120 - (1 / 720) * x + (1 / 5040 - (1 / 40320) * x) * squared
    return z + (change - z * x) * (low + squared * squared * high)


@compiled
def belt_tension(theta_s: float, z: float, c: Any) -> float:
    """Torque [N*m] in the belt: linear, quadratic, and hysteresis."""
    return float((c.K_s + c.K_s2 * abs(theta_s)) * theta_s + c.hysteresis_torque * z)


@compiled
def encoder_reading(angle: float, resolution: float) -> float:
    """An angle as an encoder reads it; a resolution of 0 is exact."""
    return float(np.rint(angle / resolution) * resolution) if resolution > 0.0 else angle


@compiled
def between(fraction: float, i: int, theta: Array, omega: Array, sample: float) -> float:
    """Angle [rad] at a fraction of the way from sample i to i + 1, by cubic Hermite
    interpolation."""
    a = omega[i] * sample
    b = omega[i + 1] * sample
    rise = theta[i + 1] - theta[i]
    angle = theta[i] + fraction * (
        a + fraction * (3.0 * rise - 2.0 * a - b + fraction * (a + b - 2.0 * rise))
    )
    return float(angle)


@compiled
def motor_current(u: float, direction: float, c: Any) -> float:
    """Current [A] that makes the actuator's torque u [N*m] and cancels friction: Eq. 5, which has
    I_q on both sides, solved for I_q. `direction` is the smoothed sign of the *measured* velocity,
    between -1 and 1; 0 cancels none."""
    r = u + direction * c.f_C
    gear_friction = direction * c.f_G if r >= 0.0 else -direction * c.f_G
    return float(r / (c.k_tau * c.n_m - gear_friction))


@compiled
def integrate(
    theta: Array, omega: Array, gains: Array, theta_m: float, rate_hz: float, c: Any, columns: Array
) -> None:
    """Fill `columns`, shape (4, n), with theta_m, omega_m, current, belt torque, from rest at
    `theta_m`.

    During the initial delay of the controller the current is 0. The actuator's damping is
    trapezoidal.
    """
    step = 1.0 / (rate_hz * c.substeps)
    sample = 1.0 / rate_hz
    # factors in place of divisions, which take four times as long
    per_turn = 1.0 / c.n_T
    mobility = 1.0 / (c.J_m / step + 0.5 * c.B_m)  # velocity [rad/s] that 1 N*m gives in a step
    kept = mobility * (c.J_m / step - 0.5 * c.B_m)
    pushed = mobility * c.k_tau * c.n_m
    width = 1.0 / c.hysteresis_width
    friction_scale = c.friction_scale if c.friction else 0.0

    substeps_per_update = c.substeps // c.control_updates
    updates_per_second = rate_hz * c.control_updates
    smoothing = -math.expm1(-2 * math.pi * c.velocity_cutoff_hz / updates_per_second)
    pending = np.zeros(c.control_delay + 1)  # currents of updates that are not applied yet
    slot = 0

    current = 0.0
    omega_m = 0.0
    velocity = 0.0
    z = 0.0
    reading = encoder_reading(theta_m, c.encoder_resolution)
    theta_s = theta[0] - theta_m * per_turn
    for i in range(len(theta)):
        theta_s_before = theta_s
        theta_s = theta[i] - theta_m * per_turn
        z = turned_belt(theta_s_before, z, theta_s, width)
        columns[0, i] = theta_m
        columns[1, i] = omega_m
        columns[3, i] = belt_tension(theta_s, z, c)
        K_1, B_1, theta_eq = gains[:, min(i, gains.shape[1] - 1)]
        for k in range(c.substeps):
            if k % substeps_per_update == 0:
                reading_before = reading
                reading = encoder_reading(theta_m, c.encoder_resolution)
                velocity += smoothing * ((reading - reading_before) * updates_per_second - velocity)
                velocity = velocity if smoothing else omega_m
                sign = (
                    math.tanh(velocity / c.sign_width) if c.cancels_friction and c.friction else 0.0
                )
                u = K_1 * (theta_eq - reading) - B_1 * velocity  # Eq. 7
                pending[slot] = motor_current(u, sign, c)
                slot = 0 if slot == c.control_delay else slot + 1
                current = pending[slot]
                if k == 0:
                    columns[2, i] = current
            if i == len(theta) - 1:
                break

            theta_m += 0.5 * step * omega_m
            theta_s_before = theta_s
            theta_s = between((k + 0.5) / c.substeps, i, theta, omega, sample) - theta_m * per_turn
            z = turned_belt(theta_s_before, z, theta_s, width)
            omega_without_friction = (
                kept * omega_m
                + pushed * current
                + mobility * per_turn * belt_tension(theta_s, z, c)
            )
            lost = mobility * friction_scale * (c.f_C + c.f_G * abs(current))
            # friction stops the actuator but never drives it
            omega_m = omega_without_friction - max(-lost, min(omega_without_friction, lost))
            theta_m += 0.5 * step * omega_m


@compiled
def belt_path(theta_s: Array, c: Any) -> Array:
    """Torque [N*m] of the belt along a path of deflections theta_s (n,) [rad], from a rested
    belt."""
    torque = np.empty_like(theta_s)
    z = 0.0
    for i in range(len(theta_s)):
        z = turned_belt(theta_s[max(i - 1, 0)], z, theta_s[i], 1.0 / c.hysteresis_width)
        torque[i] = belt_tension(theta_s[i], z, c)
    return torque
