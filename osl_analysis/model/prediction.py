"""The impedance that linear theory predicts for a fit of Eq. 15 with given gains."""

from collections.abc import Sequence

import numpy as np

from osl_analysis.model.compensator import Gains
from osl_analysis.model.drivetrain import joint_admittance
from osl_analysis.parameters import DrivetrainParameters


def predicted_impedance(
    gains: Gains, p: DrivetrainParameters, frequencies_hz: Sequence[float]
) -> tuple[float, float, float]:
    """K [N*m/rad], B [N*m*s/rad], I [kg*m^2] that least squares finds in a stepped sine on the linear drivetrain.

    A stepped sine has equally many cycles at each frequency f, so it spends 1/f of its samples there. The residual of
    1/Y against K + j w B - w^2 I is weighted accordingly. Friction is not included.
    """
    w = 2 * np.pi * np.asarray(frequencies_hz, dtype=float)
    Z = 1 / joint_admittance(gains.K_1, gains.B_1, p, p.J_j)(1j * w)
    weight = 1 / np.sqrt(w)
    storage = np.column_stack([np.ones_like(w), -(w**2)])
    (K, I), *_ = np.linalg.lstsq(storage * weight[:, None], Z.real * weight, rcond=None)
    B = np.sum(weight**2 * w * Z.imag) / np.sum(weight**2 * w**2)
    return float(K), float(B), float(I)
