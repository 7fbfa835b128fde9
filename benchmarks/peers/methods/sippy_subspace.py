# SPDX-License-Identifier: Apache-2.0
"""sippy-unipi: a state-space model by N4SID from angle to torque; its frequency response in the
band gives K, B and I.

https://github.com/CPCLAB-UNIPI/SIPPY (`system_identification(y, u, "N4SID", ...)`, centring by the
mean). The bench imposes the angle: it is the input. The torque is made two samples late, so that
derivatives of the angle are causal. It states no intervals.
"""

import numpy as np
from scipy.signal import decimate
from sippy_unipi import system_identification

PACKAGES = ("sippy-unipi",)
LATE = 2  # samples


def estimate(t, theta, torque, rate_hz=500.0, **known):
    factor = round(rate_hz / 100)
    even, step = np.arange(t[0], t[-1], 1 / rate_hz), factor / rate_hz
    u, y = (decimate(np.interp(even, t, one), factor, ftype="fir") for one in (theta, torque))
    chosen = {"centering": "MeanVal", "tsample": step, "SS_fixed_order": 4, "SS_D_required": True}
    model = system_identification(y[None, :-LATE], u[None, LATE:], "N4SID", **chosen)
    s = 2j * np.pi * np.linspace(0.5, 6, 50)
    states = [
        np.linalg.solve(np.exp(one * step) * np.eye(len(model.A)) - model.A, model.B) for one in s
    ]
    response = np.array([(model.C @ one + model.D).item() for one in states]) * np.exp(
        s * LATE * step
    )
    X = np.column_stack([np.ones_like(s), s, s**2])
    K, B, I = np.linalg.lstsq(
        np.vstack([X.real, X.imag]), np.r_[response.real, response.imag], rcond=None
    )[0]
    return K, B, I, {}, []
