# SPDX-License-Identifier: Apache-2.0
"""pandas and `scipy.optimize.curve_fit`: a centred rolling mean, differences at the stamps, a fit
with its covariance.

https://pandas.pydata.org/docs/reference/api/pandas.DataFrame.rolling.html
https://docs.scipy.org/doc/scipy/reference/generated/scipy.optimize.curve_fit.html (`perr =
sqrt(diag(pcov))`)
"""

import numpy as np
import pandas as pd
from scipy.optimize import curve_fit

PACKAGES = ("pandas", "scipy")


def joint(motion, K, B, I, offset):
    theta, omega, alpha = motion
    return K * theta + B * omega + I * alpha + offset


def estimate(t, theta, torque, rate_hz=500.0, **known):
    window = 2 * round(rate_hz / 50) + 1  # 40 ms: both signals alike, so that it cancels
    frame = pd.DataFrame({"theta": theta, "torque": torque}, index=t)
    frame = frame.rolling(window, center=True, win_type="hann").mean()
    frame["omega"] = np.gradient(frame["theta"], frame.index)
    frame["alpha"] = np.gradient(frame["omega"], frame.index)
    frame = frame.dropna()
    found, covariance = curve_fit(
        joint, frame[["theta", "omega", "alpha"]].to_numpy().T, frame["torque"].to_numpy()
    )
    half = 1.96 * np.sqrt(np.diag(covariance))
    intervals = {name: (found[k] - half[k], found[k] + half[k]) for k, name in enumerate("KBI")}
    return *found[:3], intervals, []
