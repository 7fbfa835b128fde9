"""Nominal curves of one step with a prosthetic ankle: angles, ankle moment, ground reaction, foot path.

The curves resemble published curves of level walking. They have three or more continuous derivatives, so that every
body has an acceleration. Cycle phase c: 0 at heel strike, 1 at the next one, any real number; stance phase p: 0 at heel
strike, 1 at toe-off.
"""

import numpy as np

from osl_analysis.trial import Array

STANCE_FRACTION = 0.62
FLAT_FROM, FLAT_TO = 0.12, 0.60

ANKLE_HEIGHT = 0.08
HEEL = np.array([-0.06, 0.0, -ANKLE_HEIGHT])
BALL = np.array([0.13, 0.0, -ANKLE_HEIGHT])
FOOT_WIDTH = 0.09
"""Width [m] of the foot, whose middle is below the ankle."""

# (size, cycle phase of the peak, sharpness) of periodic bumps; sizes in degrees and N*m/kg
ANKLE_ANGLE = ((-7.0, 0.06, 20.0), (12.0, 0.40, 3.5), (-18.0, 0.63, 11.0))
ANKLE_MOMENT = ((0.45, 0.28, 6.0), (0.35, 0.37, 14.0), (1.35, 0.475, 11.0), (-0.15, 0.05, 30.0))

HEEL_STRIKE_PITCH = np.radians(18.0)
TOE_OFF_PITCH = np.radians(-58.0)
CLEARANCE = 0.04


def smooth_step(x: Array) -> Array:
    """0 for x <= 0, 1 for x >= 1; 35 x^4 - 84 x^5 + 70 x^6 - 20 x^7 between: three derivatives vanish at both ends."""
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x**4 * (35.0 + x * (-84.0 + x * (70.0 - 20.0 * x))))


def periodic_bumps(c: Array, bumps: tuple[tuple[float, float, float], ...]) -> Array:
    """Sum of size * exp(sharpness (cos 2 pi (c - peak) - 1)) over (size, peak, sharpness)."""
    waves = [a * np.exp(k * (np.cos(2 * np.pi * (c - peak)) - 1.0)) for a, peak, k in bumps]
    return np.asarray(np.sum(waves, axis=0))


def nominal_ankle_angle(c: Array) -> Array:
    """Ankle angle [rad], dorsiflexion positive, against cycle phase."""
    return np.radians(periodic_bumps(c, ANKLE_ANGLE))


def nominal_ankle_moment(c: Array) -> Array:
    """Internal plantarflexion moment [N*m/kg] against cycle phase: 0.5 at midstance, 1.4 at push-off, 0 in swing."""
    inside = np.mod(c, 1.0) / STANCE_FRACTION
    return periodic_bumps(c, ANKLE_MOMENT) * stance_window(inside)


def stance_window(p: Array) -> Array:
    """1 from 8 % to 92 % of stance, 0 outside stance, smooth between."""
    return smooth_step(p / 0.08) * smooth_step((1.0 - p) / 0.08)


def ground_reaction(p: Array) -> Array:
    """Ground reaction on a right foot in multiples of body weight, laboratory axes, shape (n, 3)."""

    def hump(peak: float, width: float) -> Array:
        """A Gaussian bump of stance phase."""
        return np.exp(-(((p - peak) / width) ** 2))

    forward = -0.16 * hump(0.18, 0.10) + 0.18 * hump(0.85, 0.09)
    inward = 0.045 * hump(0.22, 0.14) + 0.04 * hump(0.75, 0.14)
    upward = 0.74 + 0.36 * hump(0.22, 0.13) + 0.40 * hump(0.76, 0.13)
    return np.asarray(np.stack([forward, inward, upward], axis=-1) * stance_window(p)[:, None])


def foot_pitch(c: Array) -> Array:
    """Pitch [rad] of the foot against the floor, toes up positive; exactly 0 from 12 % to 60 % of stance."""
    c = np.mod(c, 1.0)
    heel_rocker = HEEL_STRIKE_PITCH * (1.0 - smooth_step(c / (FLAT_FROM * STANCE_FRACTION)))
    heel_off = TOE_OFF_PITCH * smooth_step((c - FLAT_TO * STANCE_FRACTION) / 0.29)
    swing = (HEEL_STRIKE_PITCH - TOE_OFF_PITCH) * smooth_step((c - 0.67) / 0.33)
    return np.asarray(heel_rocker + heel_off + swing)


def ankle_path(c: Array, stride: float) -> Array:
    """Ankle centre [m], shape (n, 3), relative to its place with the foot flat in cycle 0. `stride` [m] is along x.

    In stance the foot rolls over its heel, lies flat, and rolls over its ball. Both pivots give the same path while the
    foot is flat. In swing the path changes smoothly from one to the other.
    """
    pitch, inside = foot_pitch(c), np.mod(c, 1.0)
    on_ball = smooth_step((inside - 0.15) / 0.20) - smooth_step((inside - 0.72) / 0.22)
    path = (1.0 - on_ball)[:, None] * rolled_over(HEEL, pitch) + on_ball[:, None] * rolled_over(BALL, pitch)
    swung = np.clip((inside - STANCE_FRACTION) / (1.0 - STANCE_FRACTION), 0.0, 1.0)
    path[:, 0] += stride * (np.floor(c) + smooth_step(swung))
    path[:, 2] += CLEARANCE * 256.0 * (swung * (1.0 - swung)) ** 4
    return np.asarray(path)


def rolled_over(pivot: Array, pitch: Array) -> Array:
    """Ankle [m], shape (n, 3), of a foot pitched [rad, toes up] about a pivot that stays where it is when flat."""
    cos, sin = np.cos(pitch), np.sin(pitch)
    x, z = pivot[0], pivot[2]
    # the pivot as seen from the ankle turns by -pitch about y
    return np.stack([x - (cos * x - sin * z), np.zeros_like(pitch), z - (sin * x + cos * z)], axis=-1)
