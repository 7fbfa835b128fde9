# SPDX-License-Identifier: Apache-2.0
"""statsmodels: ordinary least squares on smoothed derivatives with a covariance that allows for
autocorrelation (HAC).

https://www.statsmodels.org/stable/generated/statsmodels.regression.linear_model.OLSResults.get_robustcov_results.html
https://www.statsmodels.org/stable/diagnostic.html (Ramsey's RESET, with the same covariance, is the
doubt) https://docs.scipy.org/doc/scipy/reference/generated/scipy.signal.savgol_filter.html
(`deriv`, `delta`)
"""

import numpy as np
import statsmodels.api as sm
from scipy.signal import savgol_filter
from statsmodels.stats.diagnostic import linear_reset

PACKAGES = ("statsmodels",)


def estimate(t, theta, torque, rate_hz=500.0, **known):
    even = np.arange(t[0], t[-1], 1 / rate_hz)
    theta, torque = np.interp(even, t, theta), np.interp(even, t, torque)
    window = 2 * round(rate_hz / 40) + 1  # 50 ms
    smoothed = [savgol_filter(theta, window, 4, deriv=k, delta=1 / rate_hz) for k in range(3)]
    X = sm.add_constant(np.column_stack(smoothed))
    alike = {"cov_type": "HAC", "cov_kwds": {"maxlags": 2 * window}}
    model = sm.OLS(savgol_filter(torque, window, 4), X).fit(**alike)
    test = linear_reset(model, power=3, **alike)
    doubts = [f"not linear (RESET, p = {test.pvalue:.1g})"] if test.pvalue < 1e-3 else []
    intervals = {name: tuple(model.conf_int()[k + 1]) for k, name in enumerate("KBI")}
    return *model.params[1:4], intervals, doubts
