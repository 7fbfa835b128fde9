"""What a leg's actuator would do without its friction.

A belt of stiffness K_s joins joint and actuator, whose angle theta_m is recorded. Whatever friction
does in the actuator, it does to theta_m, so that the torque (Eqs. 3-4, 8)

    torque = K_s theta + B_j omega + J_j alpha - (K_s/n_T) theta_m + hysteresis of the belt

needs no friction of the actuator. K, B and I of the leg without that friction need the theta_m that
there would be without it. While the actuator slides, Eqs. 1, 2 and 7 are linear in

    theta = c_0 theta_m + c_1 omega_m + c_2 alpha_m + sign(omega_m) (f_0 + f_1 |current|) + offset,

so that theta/(c_0 + c_1 s + c_2 s^2) is the motion without friction. While it sticks, friction is
whatever holds it: those rows tell nothing and are left out.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from osl_analysis.inference.constants import (
    BLOCKS,
    EDGE,
    RIDGE,
    TINY,
)
from osl_analysis.inference.spectra import Spectra
from osl_analysis.trial import Array


class Sliding:
    """While an actuator slides, and how well its equation is known then."""

    # speed above which it slides; what the further two would change is an error [SD of its
    # velocity]; 16 uncompensated legs: B is off by 0.037, 0.016, 0.012 N*m*s/rad (RMS) at 0.05,
    # 0.1, 0.2
    SPEEDS = (0.2, 0.1, 0.3)
    # time about a standstill that is left out, since filters spread it [s]; 16 legs, sliding above
    # 0.05 SD: B is off by 0.028 with 0.01 s, 0.037 with 0.02 s (RMS)
    SETTLING = 0.02
    # share of what friction does to K, B, I that its formula misses; 32 legs of other seeds: B is
    # held in 28 without it, in 31 with it
    INEXACTNESS = 0.005


FRICTION = slice(3, 5)  # coefficients f_0 and f_1


@dataclass(frozen=True)
class FrictionlessActuator:
    """The motion of an actuator without friction, as that of its joint.

    Attributes
    ----------
    impedance_column : Array (3,)
        Its angle without friction, projected on angle, velocity and acceleration of the joint.
    covariance : Array (3, 3)
        Covariance of `impedance_column`.
    friction_probability : float
        Probability that the actuator's friction, as far as no controller cancels it, opposes its
        motion.
    """

    impedance_column: Array
    covariance: Array
    friction_probability: float


def frictionless_actuator(spectra: Spectra, hysteresis: Array) -> FrictionlessActuator:
    """Estimate the motion of an actuator without friction from its sliding motion.

    The error has three parts: the scatter of estimates that leave out one block each (jackknife),
    what changes if other speeds part sliding from sticking, and a share of what friction does. The
    `hysteresis` (p,) is that of its belt.
    """
    columns = equation_of_sliding(spectra, hysteresis)
    # (3, 1 + BLOCKS, 8); without a block at the first speed only
    fits = np.array([sliding_fits(spectra, columns, share) for share in Sliding.SPEEDS])
    coefficients = np.vstack([fits[:, 0], fits[0, 1:]])

    # K, B, I per angle of the actuator as it moves, and as it would move without its friction
    powers = np.vander(spectra.s, 3, increasing=True).T
    moved = spectra.derivatives[0] / (coefficients[:, :3] @ powers)
    motion = scipy.fft.irfft(spectra.derivatives[:3] * spectra.roll_off, spectra.working_rows)
    motion -= motion[:, spectra.rows].mean(axis=1, keepdims=True)
    motion *= spectra.rows
    # sums over the rows, by Parseval: 28 motions of the actuator need no transform
    weights = np.conj(scipy.fft.rfft(motion)) * spectra.roll_off * 2 / spectra.working_rows
    products = np.column_stack([weights @ spectra.motion[3], weights @ moved.T]).real
    with_friction, *per_angle = np.linalg.solve(motion @ motion.T, products).T
    # and its friction at the mean load
    load = spectra.signals.load
    mean_load = 0.0 if load is None else np.mean(np.abs(load))
    of_all_fits = np.column_stack([per_angle, coefficients[:, FRICTION] @ [1.0, mean_load]])
    result = of_all_fits[0]
    by_speed = of_all_fits[1 : len(Sliding.SPEEDS)] - result
    by_block = np.cov(of_all_fits[len(Sliding.SPEEDS) :].T, ddof=0) * (BLOCKS - 1)
    covariance = by_speed.T @ by_speed + by_block

    # its formula misses a share of what friction does
    by_friction = Sliding.INEXACTNESS * np.append(result[:3] - with_friction, 0.0)
    covariance = covariance + np.outer(by_friction, by_friction)

    deviation = np.sqrt(covariance[3, 3] + np.finfo(float).tiny)
    probability = scipy.special.ndtr(result[3] / deviation)
    return FrictionlessActuator(result[:3], covariance[:3, :3], probability)


def equation_of_sliding(spectra: Spectra, hysteresis: Array) -> Array:
    """Columns (8, p) of the joint's angle while the actuator slides, and the angle itself (p,)."""
    assert spectra.actuator_derivatives is not None
    motion = spectra.actuator_derivatives
    sign = np.sign(motion[1])
    load = np.zeros_like(sign)
    if spectra.signals.load is not None:
        load = np.abs(spectra.resampled(*spectra.transformed(spectra.signals.load)))
    offset, drift = np.ones_like(sign), spectra.relative_time - 0.5
    return np.array([*motion, sign, sign * load, hysteresis, offset, drift, spectra.angle])


def sliding_fits(spectra: Spectra, columns: Array, share: float) -> Array:
    """Coefficients (1 + BLOCKS, 8) of the equation of sliding where the speed is above a share of
    its standard deviation; then the same, each without one block."""
    speed = np.abs(columns[1])
    slow = speed < share * speed[spectra.inside].std()
    rate = spectra.product_rows / spectra.padded_seconds
    near = scipy.ndimage.maximum_filter1d(slow, 2 * round(Sliding.SETTLING * rate) + 1)
    slides = (spectra.time > EDGE) & (spectra.time < spectra.seconds - EDGE) & ~near

    length = np.linalg.norm(columns, axis=1) + TINY
    unit = columns / length[:, None]
    sliding = unit[:, slides]
    edges = np.searchsorted(spectra.relative_time[slides] * BLOCKS, np.arange(BLOCKS + 1))
    blocks = [sliding[:, first:stop] @ sliding[:, first:stop].T for first, stop in pairwise(edges)]
    total = np.sum(blocks, axis=0)
    normal = np.concatenate([total[None], total - np.array(blocks)])
    ridge = RIDGE * np.eye(len(unit) - 1)
    solved = np.linalg.solve(normal[:, :-1, :-1] + ridge, normal[:, :-1, -1:])[..., 0]
    return solved * length[-1] / length[:-1]
