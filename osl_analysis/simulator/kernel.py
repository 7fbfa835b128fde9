"""The compiled loops of the simulator: the drivetrain of Eqs. 1-5 and 7, the position loop, and even splines.

All compiled functions are in this file, because numba's disk cache does not notice changes of functions in other files.
Those of the drivetrain are `fused`: the last bit of a motion depends on the processor, as that of numpy's sines does.
"""

from typing import NamedTuple

import numpy as np

from osl_analysis.compiled import compiled, fused
from osl_analysis.errors import InputError
from osl_analysis.trial import Array

SHORT = 1 / 16
"""Step of the deflection, in widths of the hysteresis, up to which a series is as exact as the exponential function."""
SERIES = (1.0, -1 / 2, 1 / 6, -1 / 24, 1 / 120, -1 / 720, 1 / 5040, -1 / 40320)
"""Coefficients of the series of (1 - exp(-x))/x."""


class Plant(NamedTuple):
    """Fine step [s], fine steps per sample, and the drivetrain in SI units; torque_constant is k_tau n_m. Without
    friction a fine step leaves the velocity kept omega_m + mobility torque."""

    step: float
    substeps: int
    kept: float
    mobility: float
    n_T: float
    K_s: float
    K_s2: float
    torque_constant: float
    f_C: float
    f_G: float
    hysteresis_torque: float
    hysteresis_width: float


class Controller(NamedTuple):
    """Fine steps per update, updates per second, delay [updates], encoder resolution [rad], and the friction model.
    With smoothing 0 the controller gets the true velocity."""

    every: int
    updates_per_second: float
    delay: int
    resolution: float
    smoothing: float
    sign_width: float
    cancels_friction: bool
    torque_constant: float
    f_C: float
    f_G: float


@fused
def friction_level(current: float, f_C: float, f_G: float) -> float:
    """Size of the friction [N*m] at a current I_q [A] (Eq. 2)."""
    return f_C + f_G * abs(current)


@fused
def feedforward_current(u: float, direction: float, torque_constant: float, f_C: float, f_G: float) -> float:
    """Current [A] for an actuator torque u [N*m] in closed form (Eq. 5); direction 0 ignores friction."""
    r = u + direction * f_C
    side = direction if r >= 0.0 else -direction
    return r / (torque_constant - side * f_G)


@fused
def hysteresis_step(z: float, turned: float) -> float:
    """Change of the hysteresis state z in a monotone step of the deflection [widths], from dz = dturned - z |dturned|.
    It is exact: up to `SHORT` the rest of the series is below 1e-16. Each fine step waits for the velocity that the one
    before has left, and this is most of the way; pairs of the series' terms do not wait for each other."""
    x = abs(turned)
    if x > SHORT:
        return (turned - z * x) * float(-np.expm1(-x) / x)
    x2 = x * x
    low = (SERIES[0] + SERIES[1] * x) + (SERIES[2] + SERIES[3] * x) * x2
    high = (SERIES[4] + SERIES[5] * x) + (SERIES[6] + SERIES[7] * x) * x2
    return (turned - z * x) * (low + x2 * x2 * high)


@fused
def hysteretic_belt_torque(theta_s: float, z: float, plant: Plant) -> float:
    """Torque [N*m] in the belt: linear, quadratic, and hysteresis of state z in [-1, 1]."""
    return (plant.K_s + plant.K_s2 * abs(theta_s)) * theta_s + plant.hysteresis_torque * z


@fused
def braked(free: float, lost: float) -> float:
    """Velocity [rad/s] that implicit friction leaves, which takes away `lost`. It stops but never drives."""
    return free - max(-lost, min(free, lost))


@fused
def encoder_reading(angle: float, resolution: float) -> float:
    """Angle [rad] to the nearest encoder count; resolution 0 is an ideal encoder."""
    return float(np.rint(angle / resolution) * resolution) if resolution > 0.0 else angle


@fused
def estimated_velocity(estimate: float, angle_step: float, true: float, c: Controller) -> float:
    """The controller's next velocity estimate [rad/s]: encoder difference, then a one-pole low-pass."""
    if c.smoothing <= 0.0:
        return true
    return estimate + c.smoothing * (angle_step * c.updates_per_second - estimate)


@fused
def smoothed_sign(x: float) -> float:
    """tanh(x) to 2e-16, in half the time: beyond 20 it is 1."""
    if abs(x) > 20.0:
        return 1.0 if x > 0.0 else -1.0
    e = float(np.exp(-2.0 * abs(x)))
    return (1.0 - e) / (1.0 + e) if x > 0.0 else (e - 1.0) / (e + 1.0)


@fused
def controller_current(theta_m: float, omega_m: float, gains: tuple[float, float, float], c: Controller) -> float:
    """Current [A] for one measurement and gains (K_1, B_1, theta_eq) (Eqs. 5 and 7)."""
    K_1, B_1, theta_eq = gains
    direction = smoothed_sign(omega_m / c.sign_width) if c.cancels_friction else 0.0
    u = K_1 * (theta_eq - theta_m) - B_1 * omega_m
    return feedforward_current(u, direction, c.torque_constant, c.f_C, c.f_G)


@fused
def joint_cubic(i: int, theta: Array, omega: Array, sample: float) -> tuple[float, float, float, float]:
    """Coefficients [rad] of the cubic Hermite interpolation of theta [rad] from sample i to i + 1."""
    a, b, rise = omega[i] * sample, omega[i + 1] * sample, theta[i + 1] - theta[i]
    return theta[i], a, 3.0 * rise - 2.0 * a - b, a + b - 2.0 * rise


@fused
def joint_angle(fraction: float, cubic: tuple[float, float, float, float]) -> float:
    """Angle [rad] at a fraction of the way between two samples."""
    start, first, second, third = cubic
    return start + fraction * (first + fraction * (second + fraction * third))


@fused
def integrate(
    theta: Array, omega: Array, gains: Array, theta_m: float, plant: Plant, c: Controller, columns: Array
) -> None:
    """Fill `columns`, shape (4, n), with theta_m, omega_m, current, belt torque, from rest at `theta_m`. The rows of
    `gains`, shape (3, n) or (3, 1), are K_1, B_1, theta_eq. During the initial delay of the controller the current is
    0."""
    half, last_one, last_gain = 0.5 * plant.step, len(theta) - 1, gains.shape[1] - 1
    # to multiply by: a division takes four times as long
    per_turn, per_width, fine = 1.0 / plant.n_T, 1.0 / plant.hysteresis_width, 1.0 / plant.substeps
    push = plant.mobility * per_turn  # velocity [rad/s] that 1 N*m in the belt gives in a step
    per_z = push * plant.hysteresis_torque
    pending, slot, current = np.zeros(c.delay + 1), 0, 0.0
    omega_m, velocity, seen, z = 0.0, 0.0, encoder_reading(theta_m, c.resolution), 0.0
    theta_s = theta[0] - theta_m * per_turn
    for i in range(len(theta)):
        middle, theta_s = theta_s, theta[i] - theta_m * per_turn
        z += hysteresis_step(z, (theta_s - middle) * per_width)
        columns[0, i], columns[1, i], columns[3, i] = theta_m, omega_m, hysteretic_belt_torque(theta_s, z, plant)
        asked = min(i, last_gain)
        told = (gains[0, asked], gains[1, asked], gains[2, asked])
        joint, cubic = theta[i], joint_cubic(min(i, last_one - 1), theta, omega, plant.step * plant.substeps)
        for update in range(0, plant.substeps, c.every):
            last, seen = seen, encoder_reading(theta_m, c.resolution)
            velocity = estimated_velocity(velocity, seen - last, omega_m, c)
            pending[slot] = controller_current(seen, velocity, told, c)
            slot = 0 if slot == c.delay else slot + 1
            current = pending[slot]
            if update == 0:
                columns[2, i] = current
            if i == last_one:
                break
            driven = plant.mobility * plant.torque_constant * current
            lost = plant.mobility * friction_level(current, plant.f_C, plant.f_G)
            for k in range(update, update + c.every):
                # from the middle of a step to that of the next one; the first one begins at the sample
                drift = half if k == 0 else plant.step
                before, joint = joint, joint_angle((k + 0.5) * fine, cubic)
                rise = joint - before - drift * per_turn * omega_m
                theta_s += rise
                change = hysteresis_step(z, rise * per_width)
                free = plant.kept * omega_m + driven + push * hysteretic_belt_torque(theta_s, z, plant) + per_z * change
                theta_m += half * omega_m
                omega_m = braked(free, lost)
                theta_m += half * omega_m
                z += change


@fused
def belt_path(theta_s: Array, plant: Plant) -> Array:
    """Torque [N*m] of the belt along a path of deflections [rad], shape (n,), from a rested belt."""
    torque, z = np.empty_like(theta_s), 0.0
    for i in range(len(theta_s)):
        z += hysteresis_step(z, (theta_s[i] - theta_s[max(i - 1, 0)]) / plant.hysteresis_width)
        torque[i] = hysteretic_belt_torque(theta_s[i], z, plant)
    return torque


@fused
def torque_through_gap(
    theta: Array,
    omega: Array,
    alpha: Array,
    joint: tuple[float, float, float],
    gap: float,
    sample: float,
    substeps: int,
) -> Array:
    """Torque [N*m] at the samples of a bench that turns a joint (K, B, I) through a gap [rad], shape (n,). At an end of
    the gap the bench can push the joint but not pull it. Inside the gap the joint moves freely. The contact at an end
    is plastic. Its impulse is spread over one sample."""
    K, B, I = joint
    step, half = sample / substeps, 0.5 * gap
    torque = np.zeros_like(theta)
    side, angle, velocity, blow, blows = 0, theta[0], 0.0, 0.0, 0
    for i in range(len(theta)):
        for k in range(substeps if i + 1 < len(theta) else 1):
            part = k / substeps
            bench = joint_angle(part, joint_cubic(i, theta, omega, sample)) if k else theta[i]
            later = i + 1 if k else i
            speed = omega[i] + part * (omega[later] - omega[i])
            turning = alpha[i] + part * (alpha[later] - alpha[i])
            push = 0.0
            if side != 0:
                angle, velocity = bench - side * half, speed
                push = K * angle + B * velocity + I * turning
                if push * side < 0.0:
                    side, push = 0, 0.0
            elif angle <= bench - half or angle >= bench + half:
                side = 1 if angle <= bench - half else -1
                blow, blows = I * (speed - velocity) / sample, substeps
                angle, velocity = bench - side * half, speed
                push = K * angle + B * velocity + I * turning
            if blows > 0:
                push += blow
                blows -= 1
            if k == 0:
                torque[i] = push
            if side == 0:
                velocity += -step * (K * angle + B * velocity) / I
                angle += step * velocity
    return torque


FEWEST = 4  # Fewest samples of a spline without knots beside its ends
SETTLED = 20  # Rows of the elimination after which its factor is 2 - sqrt(3) to rounding: each comes 14 times closer


def spline_at(samples: Array, rate_hz: float, instants: Array) -> Array:
    """The cubic spline through samples (n,) that begin at 0 and have a rate [Hz], at instants (m,) [s].

    It is the not-a-knot spline of `scipy.interpolate.CubicSpline`, to rounding, also beyond the last sample.
    """
    if len(samples) < FEWEST:
        raise InputError(
            f"a recording of {len(samples)} samples at {rate_hz:g} Hz is too short for a sensor that samples in "
            f"between, expected {FEWEST} or more; simulate a longer motion"
        )
    values = np.ascontiguousarray(samples, dtype=float)
    return evaluated(values, slopes(values), float(rate_hz), np.ascontiguousarray(instants, dtype=float))


@compiled
def slopes(y: Array) -> Array:
    """Slopes of the spline at its samples (n,), per step: s[i-1] + 4 s[i] + s[i+1] = 3 (y[i+1] - y[i-1]). The first two
    and the last two pieces are one cubic each: s[0] + 2 s[1] = (5 (y[1] - y[0]) + y[2] - y[1])/2. Gauss's elimination
    divides row i by 4 - factor[i-1], and so does a constant number after `SETTLED` rows."""
    n = len(y)
    s, factor = np.empty(n), np.full(SETTLED, 2.0)
    s[0] = 0.5 * (5.0 * (y[1] - y[0]) + (y[2] - y[1]))
    for i in range(1, SETTLED):
        factor[i] = 1.0 / (4.0 - factor[i - 1])
    for i in range(1, n - 1):
        s[i] = (3.0 * (y[i + 1] - y[i - 1]) - s[i - 1]) * factor[min(i, SETTLED - 1)]
    end = 0.5 * (5.0 * (y[n - 1] - y[n - 2]) + (y[n - 2] - y[n - 3]))
    s[n - 1] = (end - 2.0 * s[n - 2]) / (1.0 - 2.0 * factor[min(n - 2, SETTLED - 1)])
    for i in range(n - 2, -1, -1):
        s[i] -= factor[min(i, SETTLED - 1)] * s[i + 1]
    return s


@compiled
def evaluated(y: Array, s: Array, rate_hz: float, instants: Array) -> Array:
    """The piecewise cubic with values y and slopes s per step, (n,) each, at instants (m,) [s]."""
    values, last = np.empty(len(instants)), len(y) - 2
    for k in range(len(instants)):
        place = instants[k] * rate_hz
        i = min(max(int(place), 0), last)
        t, rise = place - i, y[i + 1] - y[i]
        cubic = s[i] + s[i + 1] - 2.0 * rise
        values[k] = y[i] + t * (s[i] + t * (rise - s[i] - cubic + t * cubic))
    return values


@compiled
def propagate(transition: Array, commanded: Array, speed: Array, step: float) -> Array:
    """Angle and velocity, shape (2, n), from rest at the first of the commanded angles [rad], (n,), with their speeds.
    `transition` (2, 6) takes both, and the command with its three derivatives, over a step [s]."""
    states = np.zeros((2, len(commanded)))
    states[0, 0] = commanded[0]
    for i in range(len(commanded) - 1):
        mean = (commanded[i + 1] - commanded[i]) / step
        curvature = 2.0 * (3.0 * mean - 2.0 * speed[i] - speed[i + 1]) / step
        jerk = 6.0 * (speed[i] + speed[i + 1] - 2.0 * mean) / step**2
        for row in range(2):
            t = transition[row]
            forced = t[2] * commanded[i] + t[3] * speed[i] + t[4] * curvature + t[5] * jerk
            states[row, i + 1] = t[0] * states[0, i] + t[1] * states[1, i] + forced
    return states
