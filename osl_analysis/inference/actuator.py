# SPDX-License-Identifier: Apache-2.0
"""What a leg's actuator would do without its friction.

A belt of stiffness K_s joins joint and actuator, whose angle theta_m is recorded. Whatever friction
does in the actuator, it does to theta_m, so that the torque (Eqs. 3-4, 8)

    torque = K_s theta + B_j omega + J_j alpha - (K_s/n_T) theta_m + hysteresis of the belt

needs no friction of the actuator. K, B and I of the leg without that friction need the theta_m that
there would be without it. While the actuator slides, Eqs. 1, 2 and 7 are linear in

    theta = c_0 theta_m + c_1 omega_m + c_2 alpha_m + sign(omega_m) (f_0 + f_1 |current|) + h z

with an offset, where z is the hysteresis of the belt: (theta - h z)/(c_0 + c_1 s + c_2 s^2) is the
motion without friction. While it sticks, friction is whatever holds it: those rows tell nothing and
are left out.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from osl_analysis.base.trial import Array
from osl_analysis.inference.spectra import (
    BLOCKS,
    EDGE,
    FRICTION_WINDS,
    LENGTH_ROUNDING,
    RIDGE_ROUNDING,
    BenchSignals,
    Spectra,
    slipping_springs,
)

# speed above which an actuator slides [SD of its velocity], and others, whose change is an error;
# 16 uncompensated legs: B is off by 0.037, 0.016, 0.012 N*m*s/rad (RMS) at 0.05, 0.1, 0.2
SPEEDS = (0.2, 0.1, 0.3)
# time about a standstill that is left out, since filters spread it [s]; 16 legs, sliding above
# 0.05 SD: B is off by 0.028 with 0.01 s, 0.037 with 0.02 s (RMS)
SETTLING = 0.02
# share of what friction does to K, B, I that its formula misses; seven legs of the simulator: B is
# off by 0.02 of it (RMS)
MISSED_OF_FRICTION = 0.02
BEYOND_ENDS_S = 2.0  # odd extension of a motion at both ends [s]: 30 periods of its low-pass


@dataclass(frozen=True)
class FrictionlessActuator:
    """How an actuator follows its joint without friction.

    Attributes
    ----------
    coefficients : Array (1 + 2 + BLOCKS, 4)
        c_0, c_1, c_2 and h; then by the other speeds above which it slides, and without each block.
    friction_probability : float
        Probability that the actuator's friction, as far as no controller cancels it, opposes its
        motion.
    """

    coefficients: Array
    friction_probability: float

    def angles(self, theta: Array, hysteresis: Array, rate_hz: float) -> Array:
        """Angles (1 + 2 + BLOCKS, n) of the actuator without friction, of a joint's angle (n,) and
        the hysteresis z (n,) of its belt, by each row of the coefficients."""
        pad = min(round(BEYOND_ENDS_S * rate_hz), len(theta) - 1)
        signals = np.array([theta - theta.mean(), hysteresis])
        extended = np.pad(signals, ((0, 0), (pad, pad)), "reflect", reflect_type="odd")
        n = extended.shape[1]
        of_theta, of_hysteresis = scipy.fft.rfft(extended)
        s = 2j * np.pi * scipy.fft.rfftfreq(n, 1 / rate_hz)
        pushed = of_theta - self.coefficients[:, 3:] * of_hysteresis
        moved = pushed / (self.coefficients[:, :3] @ s ** np.arange(3)[:, None])
        return scipy.fft.irfft(moved, n)[:, pad : pad + len(theta)]


def frictionless_actuator(signals: BenchSignals) -> FrictionlessActuator:
    """Estimate how an actuator follows its joint while it slides.

    Parameters
    ----------
    signals : BenchSignals
        Angle, torque and the actuator's angle on one time base.

    Raises
    ------
    NotWeighedError
        They are too short.
    """
    spectra = Spectra(signals)
    assert spectra.actuator_derivatives is not None
    motion = spectra.actuator_derivatives
    sign = np.sign(motion[1])
    recorded_load = spectra.signals.load
    mean_load = 0.0
    load = np.zeros_like(sign)
    if recorded_load is not None:
        mean_load = float(np.mean(np.abs(recorded_load)))
        load = np.abs(spectra.resampled(*spectra.transformed(recorded_load)))
    (hysteresis,) = slipping_springs(spectra.sliding, FRICTION_WINDS[-1:])
    offset, drift = np.ones_like(sign), spectra.relative_time - 0.5
    # columns (8, p) of the joint's angle while the actuator slides, and the angle itself
    columns = np.array([*motion, sign, sign * load, hysteresis, offset, drift, spectra.angle])
    # (3, 1 + BLOCKS, 8); without a block at the first speed only
    fits = np.array([sliding_fits(spectra, columns, share) for share in SPEEDS])
    coefficients = np.vstack([fits[:, 0], fits[0, 1:]])

    # its friction at the mean load
    c_0, c_1, c_2, f_0, f_1, h, *_ = coefficients.T
    friction = f_0 + f_1 * mean_load
    deviation = np.linalg.norm(deviations(friction))
    probability = scipy.special.ndtr(friction[0] / (deviation + LENGTH_ROUNDING))
    return FrictionlessActuator(np.column_stack([c_0, c_1, c_2, h]), float(probability))


def deviations(values: Array) -> Array:
    """Independent errors of the first of values (1 + 2 + BLOCKS, ...) by each row of the
    coefficients: what the other speeds change, and by the jackknife what each block does."""
    speeds = len(SPEEDS)
    by_speed = values[1:speeds] - values[0]
    by_block = values[speeds:] - values[speeds:].mean(axis=0)
    return np.concatenate([by_speed, np.sqrt((BLOCKS - 1) / BLOCKS) * by_block])


def sliding_fits(spectra: Spectra, columns: Array, share: float) -> Array:
    """Coefficients (1 + BLOCKS, 8) of the equation of sliding where the speed is above a share of
    its standard deviation; then the same, each without one block."""
    speed = np.abs(columns[1])
    slow = speed < share * speed[spectra.inside].std()
    rate = spectra.product_rows / spectra.padded_seconds
    near = scipy.ndimage.maximum_filter1d(slow, 2 * round(SETTLING * rate) + 1)
    slides = (spectra.time > EDGE) & (spectra.time < spectra.seconds - EDGE) & ~near

    length = np.linalg.norm(columns, axis=1) + LENGTH_ROUNDING
    unit = columns / length[:, None]
    sliding = unit[:, slides]
    edges = np.searchsorted(spectra.relative_time[slides] * BLOCKS, np.arange(BLOCKS + 1))
    blocks = [sliding[:, first:stop] @ sliding[:, first:stop].T for first, stop in pairwise(edges)]
    total = np.sum(blocks, axis=0)
    normal = np.concatenate([total[None], total - np.array(blocks)])
    ridge = RIDGE_ROUNDING * np.eye(len(unit) - 1)
    solved = np.linalg.solve(normal[:, :-1, :-1] + ridge, normal[:, :-1, -1:])[..., 0]
    return solved * length[-1] / length[:-1]
