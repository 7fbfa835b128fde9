"""Shapes of dry friction: torques of 1 N*m that oppose a motion.

Friction either changes sign with the velocity, or builds up over an angle before it slides, like a
bristle (Dahl, Aerospace Corp. TOR-158(3107-18)-1, 1968; Canudas de Wit et al., IEEE Trans. Autom.
Control 40, 1995). Which of these a joint has nobody knows beforehand: all are columns, and
what they are together must oppose the motion.
"""

import numpy as np

from osl_analysis.inference.constants import FRICTION_WINDS, SIGN_WIDTH
from osl_analysis.inference.spectra import Spectra
from osl_analysis.trial import Array

WIDER = 5.0  # times the first width, over which the second sign changes
SLOWEST = 1e-6  # rad/s, so that no width is 0


def slipping_spring(angle: Array, width: float) -> Array:
    """Compute the torque of a spring that slips at +-1 (Prandtl's stop operator).

    Parameters
    ----------
    angle : Array (n,)
        Angle that winds the spring up [rad].
    width : float
        Angle from slack to the limit [rad].

    Returns
    -------
    Array (n,)
        Torque over its limit; 0 in the first row.
    """
    rising = np.diff(angle) >= 0
    reversals = np.flatnonzero(rising[1:] != rising[:-1]) + 1
    turns = np.concatenate([[0], reversals, [len(angle) - 1]])

    # between two turning points the motion has one direction, so that one clip is enough
    wound = [0.0]
    for way in (np.diff(angle[turns]) / width).tolist():
        wound.append(min(max(wound[-1] + way, -1.0), 1.0))

    last_turn = np.repeat(np.arange(len(turns) - 1), np.diff(turns))
    since_turn = (angle[:-1] - angle[turns][last_turn]) / width
    within = np.clip(np.array(wound)[last_turn] + since_turn, -1.0, 1.0)
    return np.append(within, wound[-1])


def sliding_velocity(spectra: Spectra) -> tuple[Array, float]:
    """Compute the velocity (p,) that friction opposes, and that over which it changes sign [rad/s].

    The sign of a noisy velocity chatters: its width is at least the velocity's noise, whose
    variance is the integral of (2 pi f)^2 times the angle's noise density over the product band.
    """
    velocity = np.gradient(spectra.sliding, spectra.padded_seconds / spectra.product_rows)
    variance = spectra.angle_noise * (2 * np.pi) ** 2 * spectra.product_band_hz**3 / 3
    usual = SIGN_WIDTH * float(velocity[spectra.inside].std())
    return velocity, max(usual, float(np.sqrt(variance)), SLOWEST)


def friction_torques(spectra: Spectra) -> Array:
    """Compute the columns (k, p) of dry friction, at the product rate.

    Two slide, with a sign that changes over a narrow and a wide velocity. Springs slip behind each
    of `FRICTION_WINDS`. Where the load is known, the last one grows with it.
    """
    velocity, width = sliding_velocity(spectra)
    slides = np.tanh(velocity / width)
    wider = np.tanh(velocity / (WIDER * width))
    rests = [slipping_spring(spectra.sliding, wind) for wind in FRICTION_WINDS]
    columns = [slides, wider, *rests]
    if spectra.signals.load is not None and spectra.actuator_spectrum is None:
        columns.append(slides * np.abs(spectra.resampled(spectra.signals.load)))
    return np.array(columns)
