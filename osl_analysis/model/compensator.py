"""The compensator: friction feedforward (Eqs. 5-7), the choice of K_1 and B_1 (Eqs. 12-14), and
what they render.

Eq. 14, in the letters of `drivetrain.joint_admittance`, with Q = B_d s + K_d and K_1 from Eq. 13:

    W (Y - Y_d) = b(s; x)/a(s; x),   a = W_den D Q,   b = W_num (N Q - D).

Both are affine in x = B_m + B_1. Astrom's recursion (Introduction to Stochastic Control Theory,
1970, ch. 5) turns the squared norm into a sum over the rows of a's Routh table, so that its slope
in x is exact. Its changes of sign on a logarithmic grid bracket the minima, of which
docs/gain_selection.md says how many there are.

The joint's dynamic stiffness is Z = 1/Y = P - c/N, in the same letters. Passivity needs no test: at
s = j w the joint takes in energy at the rate of Im Z = w (B_j + c x/|N|^2), positive for every x =
B_m + B_1
> 0. The rendered impedance is therefore passive with every gain that Eq. 14 selects.

In time, with friction: the linear part is N(s) theta_m = K_s/n_T theta. Between samples it is
solved exactly for an angle that is linear there. Friction is constant over a step: what would stop
the actuator, within the largest friction.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import scipy
from numpy.typing import ArrayLike
from pydantic import Field

from osl_analysis.errors import InputError, UnreachableImpedanceError, nearest
from osl_analysis.model.compiled import compiled
from osl_analysis.model.drivetrain import (
    DrivetrainParameters,
    belt_deflection,
    belt_torque,
    joint_admittance,
)
from osl_analysis.trial import Array
from osl_analysis.yaml_settings import Settings

CONTROLLERS = ("compensated", "uncompensated")  # The controllers whose gains the draft states


class Weight(Settings):
    """W of Eq. 14: the Butterworth low-pass with which the laboratory selected its gains; the
    paper's is 1 Hz (2 pi rad/s) of order 3. The limits of its cut-off lie far outside the
    frequencies at which a leg moves."""

    cutoff_hz: Annotated[float, Field(ge=1e-3, le=1e4)]  # Cut-off [Hz].
    order: Annotated[int, Field(ge=1, le=10)]  # Order.


PAPER_WEIGHT = Weight(cutoff_hz=1.0, order=3)


@dataclass(frozen=True)
class Gains:
    """Control gains at the actuator's output."""

    K_1: float  # Stiffness gain [N*m/rad]
    B_1: float  # Damping gain [N*m*s/rad]
    cancels_friction: bool  # Whether the controller adds the friction term of Eq. 5


def motor_current(u: ArrayLike, direction: ArrayLike, p: DrivetrainParameters) -> Array:
    """Current I_q [A] that makes the actuator's torque u [N*m]: Eq. 5, which has I_q on both sides,
    solved for I_q. `direction` s is the smoothed sign of the *measured* actuator velocity, between
    -1 and 1."""
    s = np.asarray(direction)
    r = np.asarray(u) + s * p.f_C
    return np.asarray(r / (p.k_tau * p.n_m - np.where(r >= 0, s, -s) * p.f_G))


def check_request(K_d: ArrayLike, B_d: ArrayLike, p: DrivetrainParameters) -> None:
    """Refuse a desired stiffness [N*m/rad] or damping [N*m*s/rad], any shape, that no gains can
    render (UnreachableImpedanceError): the belt is in series, so K_d is between 0 and K_s."""
    least, most = 1e-9, 1e6
    K_d, B_d = (np.ravel(np.asarray(values, dtype=float)) for values in (K_d, B_d))
    for value in K_d[~((K_d > 0) & (K_d < p.K_s))]:
        nearest = (
            f"less than {p.K_s:g} (99 % of it: {0.99 * p.K_s:.4g})"
            if value >= p.K_s
            else "more than 0"
        )
        raise UnreachableImpedanceError(
            f"K_d = {value:g} N*m/rad cannot be rendered: the actuator acts in series with a belt"
            f" of K_s = {p.K_s:g} N*m/rad; ask for {nearest}"
        )
    for value in B_d[~((B_d >= 0) & (B_d < np.inf))]:
        raise UnreachableImpedanceError(
            f"B_d = {value:g} N*m*s/rad cannot be rendered: a desired damping must be finite and"
            " not negative; ask for 0 or more"
        )
    for name, unit, values in (("K_d", "N*m/rad", K_d), ("B_d", "N*m*s/rad", B_d)):
        for value in values[((values < least) | (values > most)) & (values != 0)]:
            raise UnreachableImpedanceError(
                f"{name} = {value:g} {unit} is outside the accepted range; ask for {least:g} to"
                f" {most:g} {unit}"
            )


def stiffness_gain(K_d: ArrayLike, p: DrivetrainParameters) -> Array:
    """K_1 [N*m/rad] that gives the joint the static stiffness K_d [N*m/rad] (Eq. 13), any shape;
    refused as above."""
    check_request(K_d, 0.0, p)
    K_d = np.asarray(K_d, dtype=float)
    return np.asarray(K_d * p.K_s / (p.n_T**2 * (p.K_s - K_d)))


def compensated_gains(
    K_d: float, B_d: float, p: DrivetrainParameters, weight: Weight = PAPER_WEIGHT
) -> Gains:
    """Gains that render stiffness K_d [N*m/rad] and damping B_d [N*m*s/rad] best (Eqs. 13-14).
    Raises UnreachableImpedanceError as `check_request`, or where no finite B_1 minimises the error
    of Eq. 14."""
    check_request(K_d, B_d, p)
    damping = optimal_damping([K_d], [B_d], p, weight)
    if damping["unbounded"][0]:
        raise UnreachableImpedanceError(
            f"no finite B_1 minimises Eq. 14 for K_d = {K_d:g} N*m/rad, B_d = {B_d:g} N*m*s/rad:"
            f" with the cut-off of W at {weight.cutoff_hz:g} Hz the error decreases until the motor"
            " is locked; lower the cut-off of W"
        )
    return Gains(float(stiffness_gain(K_d, p)), float(damping["B_1"][0]), cancels_friction=True)


def uncompensated_gains(K_d: float, B_d: float, p: DrivetrainParameters) -> Gains:
    """Gains that neglect the drivetrain's dynamics: K_1 = K_d/n_T^2, B_1 = B_d/n_T^2, no friction
    term."""
    for name, value in (("K_d", K_d), ("B_d", B_d)):
        if not 0 <= value < np.inf:
            raise UnreachableImpedanceError(
                f"{name} = {value:g} cannot be asked for; give a finite number, 0 or more"
            )
    return Gains(K_d / p.n_T**2, B_d / p.n_T**2, cancels_friction=False)


def select_gains(
    controller: str, K_d: float, B_d: float, p: DrivetrainParameters, weight: Weight = PAPER_WEIGHT
) -> Gains:
    """The gains of a `compensated` or an `uncompensated` trial. InputError: another one; as
    `compensated_gains`."""
    if controller not in CONTROLLERS:
        raise InputError(
            f"the gains of controller '{controller}' are not"
            f" known{nearest(controller, CONTROLLERS)}; write one of {', '.join(CONTROLLERS)}"
        )
    if controller == "uncompensated":
        return uncompensated_gains(K_d, B_d, p)
    return compensated_gains(K_d, B_d, p, weight)


def optimal_damping(
    K_d: ArrayLike, B_d: ArrayLike, p: DrivetrainParameters, weight: Weight, J_j: float = 0.0
) -> dict[str, Array]:
    """Minimise ||W (Y - Y_d)||_2 over B_1 with B_m + B_1 > 0 (Eq. 14), for K_d, B_d of shape
    (pairs,): of each pair,

    * `B_1`: damping gain [N*m*s/rad] at the global minimum;
    * `error`: the norm there [rad/(N*m)/s^1/2];
    * `minima`: number of stable local minima;
    * `at_lower_bound`: the error falls towards B_m + B_1 = 0, so that the joint alone damps more
      than was asked for; `B_1` is then the last stable value of the search;
    * `unbounded`: the error falls for every increase of B_1: a locked motor would be best; `B_1` is
      then infinite.

    The paper neglects the joint's inertia; `J_j` [kg*m^2] includes it. `compensator.check_request`
    refuses impossible requests. The search for x = B_m + B_1 spans 1e-9 to 1e9 times (K_1 J_m)^1/2,
    the scale of the actuator's damping, in points a factor of 1.8 apart. The closest two minima
    that were found are a factor of 4 apart."""
    from scipy.optimize.elementwise import find_root  # 0.2 s, for the few that select gains

    K_d, B_d = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (K_d, B_d)))
    polynomials = admittance_error(K_d, B_d, p, weight, J_j)
    scale, points = np.sqrt(K_d * p.K_s / (p.n_T**2 * (p.K_s - K_d)) * p.J_m), 73
    x = scale[:, None] * np.geomspace(1e-9, 1e9, points)
    J, slope = squared_norm(x, *([c[:, None] for c in each] for each in polynomials))
    falls = (slope[:, :-1] < 0) & (slope[:, 1:] >= 0)
    pair, k = np.nonzero(falls)
    own = [[c[pair] for c in each] for each in polynomials]
    sizes = np.cumsum([len(each) for each in own])[:-1]

    def slope_at(at: Array, *coefficients: Array) -> Array:
        """The slope by pair; scipy passes only the pairs that have not converged."""
        parts = [
            [coefficients[i] for i in part]
            for part in np.split(np.arange(len(coefficients)), sizes)
        ]
        return squared_norm(at, *parts)[1]

    candidates, norms = np.full((2, len(x), points + 1), np.inf)
    candidates[pair, k] = find_root(
        slope_at, (x[pair, k], x[pair, k + 1]), args=tuple(c for e in own for c in e)
    ).x
    norms[pair, k] = squared_norm(candidates[pair, k], *own)[0]
    candidates[:, -2:], norms[:, -2:] = x[:, [0, -1]], J[:, [0, -1]]
    best = np.argmin(norms, axis=1)  # among the minima and the two ends of the search
    lowest, unbounded = (np.arange(len(x)), best), best == points
    return {
        "B_1": np.where(unbounded, np.inf, candidates[lowest] - p.B_m),
        "error": np.sqrt(norms[lowest]),
        "minima": falls.sum(axis=1),
        "at_lower_bound": best == points - 1,
        "unbounded": unbounded,
    }


def admittance_error(
    K_d: Array, B_d: Array, p: DrivetrainParameters, weight: Weight, J_j: float = 0.0
) -> list[list[Array]]:
    """The coefficients a0, a1, b0, b1 of the polynomials a = a0 + x a1 and b = b0 + x b1 in s
    [rad/s], highest power first, of every pair K_d [N*m/rad], B_d [N*m*s/rad], shape (pairs,). N Q
    - D is computed as N (Q - P) + c, so that no nearly equal numbers are subtracted; by Eq. 12 its
    constant term is exactly 0."""
    K_1 = K_d * p.K_s / (p.n_T**2 * (p.K_s - K_d))
    gain, W = scipy.signal.butter(weight.order, 2 * np.pi * weight.cutoff_hz, analog=True)
    zero, one = np.zeros_like(K_d), np.ones_like(K_d)
    N0, N1 = [p.J_m * one, zero, K_1 + p.K_s / p.n_T**2], [one, zero]  # N = N0 + x N1
    P = [J_j * one] * bool(J_j) + [p.B_j * one, p.K_s * one]
    Q = [zero] * bool(J_j) + [B_d, K_d]
    difference = [q - j for q, j in zip(Q, P, strict=True)]
    D0, b0 = polynomial_product(N0, P), polynomial_product(N0, difference)
    D0[-1], b0[-1] = K_1 * p.K_s, zero  # kappa K_s - c, and kappa (K_d - K_s) + c = 0 (Eq. 12)
    fixed = polynomial_product([B_d, K_d], [w * one for w in W])
    a0 = polynomial_product(D0, fixed)
    a1 = polynomial_product(polynomial_product(N1, P), fixed)
    b1 = polynomial_product(N1, difference)

    numerator = [[gain[-1] * one for one in b] for b in (b0, b1)]
    lengths = (len(a0), len(a0), len(a0) - 1, len(a0) - 1)  # with zeros as missing higher powers
    return [[zero] * (n - len(c)) + c for n, c in zip(lengths, (a0, a1, *numerator), strict=True)]


def polynomial_product(u: Sequence[Array], v: Sequence[Array]) -> list[Array]:
    out = [np.zeros_like(u[0])] * (len(u) + len(v) - 1)
    for i, ui in enumerate(u):
        for j, vj in enumerate(v):
            out[i + j] = out[i + j] + ui * vj
    return out


def squared_norm(
    x: Array, a0: Sequence[Array], a1: Sequence[Array], b0: Sequence[Array], b1: Sequence[Array]
) -> tuple[Array, Array]:
    """||b/a||^2 [(rad/(N*m))^2/s] at x [N*m*s/rad], and its derivative in x; coefficients broadcast
    with x. Each row of the recursion loses its first coefficient, and every second one of those
    that stay is reduced. A row's part of the sum, beta^2/(2 alpha), is 0 where beta is 0, even if
    alpha is 0 too (B_d = 0)."""
    a, da = [c + x * d for c, d in zip(a0, a1, strict=True)], list(a1)
    b, db = [c + x * d for c, d in zip(b0, b1, strict=True)], list(b1)
    n, total, slope = len(b), np.zeros_like(x), np.zeros_like(x)
    for r in range(n):
        alpha, beta = a[r] / a[r + 1], b[r] / a[r + 1]
        dalpha, dbeta = (
            (da[r] - alpha * da[r + 1]) / a[r + 1],
            (db[r] - beta * da[r + 1]) / a[r + 1],
        )
        twice = 2 * np.where(beta == 0, 1.0, alpha)
        part = beta * beta / twice
        total, slope = total + part, slope + 2 * (beta * dbeta - part * dalpha) / twice
        for i in range(r + 2, n, 2):
            c, dc = a[i + 1], da[i + 1]
            a[i], da[i] = a[i] - alpha * c, da[i] - (dalpha * c + alpha * dc)
            b[i], db[i] = b[i] - beta * c, db[i] - (dbeta * c + beta * dc)
    return total, slope


def rendering(
    K_1: ArrayLike, B_1: ArrayLike, K_d: ArrayLike, B_d: ArrayLike, p: DrivetrainParameters
) -> dict[str, Any]:
    """Properties of the impedance that gains K_1, B_1 render for K_d, B_d, arrays (pairs,) by name,
    without J_j.

    decay_rate: that of the slowest mode of the free joint [1/s]. It is negative where the joint is
    unstable. delay_margin: smallest delay [s] in the control loop that makes the held actuator, J_m
    s^2 + B_m s + K_s/n_T^2 under
        K_1 + B_1 s, unstable; infinite if it is stable with any delay. The loop gain is 1 where v =
        w^2 solves J_m^2 v^2 + (B_m^2 - B_1^2 - 2 J_m k) v + k^2 - K_1^2 = 0, k = K_s/n_T^2.
    positive_real: whether Re Y >= 0 at every frequency, a quadratic in w^2, so that Y itself, and
    not only s Y, is
        positive real. This can only hold where J_j is neglected.
    faithful_to_hz: frequency [Hz] up to which |Z - Z_d| <= 0.1 |Z_d|; infinite where Z never leaves
    this range."""
    K_1, B_1, K_d, B_d = np.broadcast_arrays(
        *(np.asarray(v, dtype=float) for v in (K_1, B_1, K_d, B_d))
    )
    k = p.K_s / p.n_T**2
    half = (2 * p.J_m * k + B_1**2 - p.B_m**2) / (2 * p.J_m**2)
    root = np.sqrt(np.maximum(half**2 - (k**2 - K_1**2) / p.J_m**2, 0.0))
    real = half**2 >= (k**2 - K_1**2) / p.J_m**2
    margin = np.full(K_1.shape, np.inf)
    for v in (half + root, half - root):
        crosses = real & (v > 0)
        w = np.sqrt(np.where(crosses, v, 1.0))
        loop = (K_1 + 1j * w * B_1) / (k - p.J_m * w**2 + 1j * w * p.B_m)
        lead = np.mod(np.pi + np.angle(loop), 2 * np.pi)
        margin = np.where(crosses, np.minimum(margin, lead / w), margin)
    kappa, x, square = K_1 + k, p.B_m + B_1, p.K_s * p.J_m**2
    linear = p.K_s * (x**2 - 2 * kappa * p.J_m) + p.J_m * (p.K_s / p.n_T) ** 2
    decay, frequency = np.empty(K_1.shape), np.full(K_1.shape, np.inf)
    for i, (stiffness, damping) in enumerate(zip(K_d, B_d, strict=True)):
        Y = joint_admittance(K_1[i], B_1[i], p)
        decay[i] = -np.max(Y.poles().real)
        asked = np.convolve(Y.numerator, [damping, stiffness])
        size = max(len(asked), len(Y.denominator))
        asked, rendered = (np.pad(u, (size - len(u), 0)) for u in (asked, Y.denominator))
        excess = magnitude_squared(rendered - asked) - 0.1**2 * magnitude_squared(asked)
        crossings = [v.real for v in np.roots(excess) if v.real > 0 and abs(v.imag) < 1e-9 * abs(v)]
        if crossings:
            frequency[i] = np.sqrt(min(crossings)) / (2 * np.pi)
    return {
        "decay_rate": decay,
        "delay_margin": margin,
        "positive_real": linear >= -2 * np.sqrt(square * kappa * p.K_s * K_1),
        "faithful_to_hz": frequency,
    }


def magnitude_squared(polynomial: Array) -> Array:
    """|u(j w)|^2 as a polynomial in w^2, highest power first."""
    ascending = polynomial[::-1]
    even = np.convolve(ascending, ascending * (-1.0) ** np.arange(len(ascending)))[::2]
    return np.asarray((even * (-1.0) ** np.arange(len(even)))[::-1])


def predicted_impedance(
    gains: Gains, p: DrivetrainParameters, frequencies_hz: Sequence[float]
) -> tuple[float, float, float]:
    """K [N*m/rad], B [N*m*s/rad], I [kg*m^2] that least squares give for a stepped sine on the
    linear drivetrain without friction: with the same number of cycles at each frequency f, the
    number of samples goes with 1/f."""
    w = 2 * np.pi * np.asarray(frequencies_hz, dtype=float)
    Z = 1 / joint_admittance(gains.K_1, gains.B_1, p, p.J_j)(1j * w)
    weight = 1 / np.sqrt(w)
    storage = np.column_stack([np.ones_like(w), -(w**2)])
    (K, I), *_ = np.linalg.lstsq(storage * weight[:, None], Z.real * weight, rcond=None)
    B = np.sum(weight**2 * w * Z.imag) / np.sum(weight**2 * w**2)
    return float(K), float(B), float(I)


@dataclass(frozen=True)
class Controller:
    """The program's numbers in the law of Eqs. 5-7, which may differ from the drivetrain that it
    controls."""

    gains: Gains
    p: DrivetrainParameters  # torque constant and friction in the feedforward of Eq. 5
    sign_width: float  # velocity [rad/s] over which its sign is smoothed
    angle_delay: float = 0.0  # age [s] of theta_m at its use
    velocity_delay: float = 0.0  # age [s] of omega_m at its use


def belt_responses(
    theta: Array, rate_hz: float, legs: Sequence[tuple[Controller, DrivetrainParameters]]
) -> Array:
    """Torque [N*m] in the belt of each of k legs, (k, n), for a joint angle theta (n,) [rad] at
    uniform samples. The actuator starts at rest, in equilibrium with the first angle. Its friction
    has the true sign of the velocity and can hold it at rest. If the gains cancel friction, the
    current includes the feedforward of Eq. 5."""
    # N(s) theta_m = K_s/n_T theta + e over one sample, e a torque [N*m] constant in between: the
    # next state (theta_m, omega_m) is transition (2, 4) @ (theta_m, omega_m, theta, next theta) +
    # push (2,) e
    theta, paths = np.ascontiguousarray(theta, dtype=float), np.zeros((len(legs), 2, len(theta)))
    step, motions, laws, plants = (
        1 / rate_hz,
        list[Array](),
        list[Sequence[float]](),
        list[Sequence[float]](),
    )
    for path, (controller, p) in zip(paths, legs, strict=True):
        continuous, gains = np.zeros((5, 5)), controller.gains
        continuous[0, 1] = continuous[2, 3] = 1.0
        continuous[1] = (
            -(gains.K_1 + p.K_s / p.n_T**2),
            -(p.B_m + gains.B_1),
            p.K_s / p.n_T,
            0.0,
            1.0,
        )
        continuous[1] /= p.J_m
        exact = scipy.linalg.expm(continuous * step)[:2]
        slope = exact[:, 3] / step
        transition, push = np.column_stack([exact[:, :2], exact[:, 2] - slope, slope]), exact[:, 4]
        motions.append(np.append(transition, push))
        constant, ages = (
            controller.p.k_tau * controller.p.n_m,
            (controller.angle_delay, controller.velocity_delay),
        )
        law = (gains.K_1, gains.B_1, gains.cancels_friction, controller.sign_width, constant)
        laws.append((*law, controller.p.f_C, controller.p.f_G, *(age * rate_hz for age in ages)))
        plants.append((p.k_tau * p.n_m, p.f_C, p.f_G, p.n_T, p.K_s2))
        path[0, 0] = p.K_s / p.n_T * theta[0] / (gains.K_1 + p.K_s / p.n_T**2)
    actuator_paths(theta, paths, np.array(motions), np.array(laws), np.array(plants))
    for path, (_, p) in zip(paths, legs, strict=True):
        path[0] = belt_torque(belt_deflection(theta, path[0], p), p)
    return paths[:, 0]


@compiled
def actuator_paths(theta: Array, paths: Array, motions: Array, laws: Array, plants: Array) -> None:
    """Fill `paths`, (k, 2, n), with angle [rad] and velocity [rad/s] of k actuators for theta (n,),
    from those of the first sample. Each step depends on the one before it; the processor fills the
    wait with the other actuators. Eq. 5 is written out for scalars; `motor_current` has it for
    arrays."""
    for i in range(len(theta) - 1):
        now, then = theta[i], theta[i + 1]
        for of in range(len(paths)):
            path, (a, b, c, d, e, f, g, h, drift, kick) = paths[of], motions[of]
            K_1, B_1, cancels, sign_width, constant, f_C, f_G, angle_age, velocity_age = laws[of]
            torque_constant, coulomb, gear, n_T, K_s2 = plants[of]
            theta_m, omega_m = path[0, i], path[1, i]
            old_angle, old_velocity = aged(path[0], i, angle_age), aged(path[1], i, velocity_age)
            u = -K_1 * old_angle - B_1 * old_velocity
            direction = math.tanh(old_velocity / sign_width) if cancels else 0.0
            r = u + direction * f_C
            current = r / (constant - (direction if r >= 0.0 else -direction) * f_G)
            theta_s = now - theta_m / n_T
            torque = (
                torque_constant * current
                + K_1 * theta_m
                + B_1 * omega_m
                + K_s2 * theta_s * abs(theta_s) / n_T
            )
            free = e * theta_m + f * omega_m + g * now + h * then + kick * torque
            limit = coulomb + gear * abs(current)
            friction = min(max(free / kick, -limit), limit)
            path[0, i + 1] = (
                a * theta_m + b * omega_m + c * now + d * then + drift * (torque - friction)
            )
            path[1, i + 1] = free - kick * friction


@compiled
def aged(values: Array, i: int, age: float) -> float:
    """A signal (n,) `age` samples before sample i, interpolated linearly; before the first sample,
    the first value."""
    whole = int(age)
    late = values[max(i - whole, 0)]
    return float(late + (age - whole) * (values[max(i - whole - 1, 0)] - late))
