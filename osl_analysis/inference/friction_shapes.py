# SPDX-License-Identifier: Apache-2.0
"""Shapes of dry friction: torques of 1 N*m that oppose a motion.

Friction either changes sign with the velocity, or builds up over an angle before it slides, like a
bristle (Dahl, Aerospace Corp. TOR-158(3107-18)-1, 1968; Canudas de Wit et al., IEEE Trans. Autom.
Control 40, 1995). Which of these a joint has nobody knows beforehand: all are columns, and
what they are together must oppose the motion.
"""

from collections.abc import Sequence

import numpy as np

from osl_analysis.base.trial import Array
from osl_analysis.inference.constants import FRICTION_WINDS, SIGN_WIDTH
from osl_analysis.inference.spectra import Spectra

WIDER = 5.0  # times the first width, over which the second sign changes
LEAST_SPEED = 1e-6  # rad/s, so that no width is 0


def slipping_springs(angle: Array, widths: Sequence[float]) -> Array:
    """Compute the torques of springs that slip at +-1 (Prandtl's stop operator).

    Parameters
    ----------
    angle : Array (n,)
        Angle that winds the springs up [rad].
    widths : sequence of float
        Angle from slack to the limit [rad] of each of k springs.

    Returns
    -------
    Array (k, n)
        Torques over their limits; 0 in the first row.
    """
    rising = np.diff(angle) >= 0
    reversals = np.flatnonzero(rising[1:] != rising[:-1]) + 1
    turns = np.concatenate([[0], reversals, [len(angle) - 1]])
    rows_of_turn = np.diff(turns)
    since_turn = angle[:-1] - np.repeat(angle[turns[:-1]], rows_of_turn)
    ways = np.diff(angle[turns])

    torques = np.empty((len(widths), len(angle)))
    for torque, width in zip(torques, widths, strict=True):
        # between two turning points the motion has one direction, so that one clip is enough
        level = 0.0
        wound = [level]
        for way in (ways / width).tolist():
            level += way
            if level > 1.0:
                level = 1.0
            elif level < -1.0:
                level = -1.0
            wound.append(level)
        unclipped = np.repeat(wound[:-1], rows_of_turn) + since_turn / width
        np.clip(unclipped, -1.0, 1.0, out=torque[:-1])
        torque[-1] = level
    return torques


def friction_torques(spectra: Spectra) -> Array:
    """Compute the columns (k, p) of dry friction, at the product rate.

    Two slide, with a sign that changes over a narrow and a wide velocity. Springs slip behind each
    of `FRICTION_WINDS`.

    The sign of a noisy velocity chatters: its width is at least the velocity's noise, whose
    variance is the integral of (2 pi f)^2 times the angle's noise density over the product band.
    """
    velocity = np.gradient(spectra.sliding, spectra.padded_seconds / spectra.product_rows)
    variance = spectra.angle_noise * (2 * np.pi) ** 2 * spectra.product_band_hz**3 / 3
    usual = SIGN_WIDTH * velocity[spectra.inside].std()
    width = max(usual, np.sqrt(variance), LEAST_SPEED)
    sliding = np.tanh(velocity / (width * np.array([[1.0], [WIDER]])))
    return np.vstack([sliding, slipping_springs(spectra.sliding, FRICTION_WINDS)])
