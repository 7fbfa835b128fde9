# SPDX-License-Identifier: Apache-2.0
"""lmfit: the angle that the measured torque would make, simulated, is fitted to the measured angle
(output error).

https://lmfit.github.io/lmfit-py/fitting.html (`minimize` with `Parameters`, bounds, `calc_covar`)
https://lmfit.github.io/lmfit-py/confidence.html: the covariance is "normally quite good";
`conf_interval` is for models that are far from linear, which this one is not.
"""

import lmfit
import numpy as np
from scipy.signal import bilinear, lfilter

PACKAGES = ("lmfit",)


def simulated(parameters, torque, rate_hz):
    K, B, I, offset = (parameters[name].value for name in ("K", "B", "I", "offset"))
    pushed = torque - offset
    b, a = bilinear([1.0], [I, B, K], rate_hz)
    start = pushed[0] / K  # at rest
    return start + lfilter(b, a, pushed - pushed[0])


def estimate(t, theta, torque, rate_hz=500.0, **known):
    even = np.arange(t[0], t[-1], 1 / (2 * rate_hz))
    theta, torque = np.interp(even, t, theta), np.interp(even, t, torque)
    parameters = lmfit.Parameters()
    parameters.add("K", value=100.0, min=1.0)
    parameters.add("B", value=1.0, min=1e-3)
    parameters.add("I", value=0.01, min=1e-5)
    parameters.add("offset", value=float(np.mean(torque)))
    settled = round(rate_hz)  # half a second, in which the start is forgotten

    def residual(p):
        return (simulated(p, torque, 2 * rate_hz) - theta)[settled:]

    fit = lmfit.minimize(residual, parameters)
    found = {name: fit.params[name] for name in "KBI"}
    intervals = {
        n: (p.value - 1.96 * p.stderr, p.value + 1.96 * p.stderr)
        for n, p in found.items()
        if p.stderr
    }
    return *(p.value for p in found.values()), intervals, [] if fit.success else [fit.message]
