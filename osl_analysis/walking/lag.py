"""By how much the torque of a response lags its angle, as far as the response itself can tell."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from osl_analysis.errors import OslAnalysisError
from osl_analysis.trial import Array
from osl_analysis.walking.perturbation import Response, fit_without_offset

LARGEST_S, STEP_S = 0.01, 0.001
"""Lags that are tried [s]; the response's grid has a margin of eight frames, 27 ms at 300 Hz."""


@dataclass(frozen=True)
class ResponseLag:
    """Lag [s] of the torque behind the angle, positive if the torque is late, and its standard error."""

    lag: float
    se: float


def response_lag(response: Response) -> ResponseLag | None:
    """The lag at which Eq. 15 leaves the least of the torque; None where no lag within 10 ms does.

    A lag hides in the damping, which it moves by -K times the lag, and shows only in what is left. Its standard error
    says whether that suffices; it takes the residuals' correlation in time from the fit. A response that is not of
    second order shifts it: compare crossings and sessions with it, do not correct by it.
    """
    lags = np.arange(-LARGEST_S, LARGEST_S + STEP_S / 2, STEP_S)
    try:
        misfit = np.array([misfit_at(response, float(lag)) for lag in lags])
    except OslAnalysisError:
        return None
    best = int(np.argmin(misfit))
    if best in (0, len(lags) - 1):
        return None
    before, least, after = misfit[best - 1 : best + 2]
    curvature = (before - 2 * least + after) / STEP_S**2
    lag = float(lags[best] + 0.5 * STEP_S * (before - after) / (before - 2 * least + after))
    fit = fit_without_offset(response.motion[response.window], shifted(response, lag)).fit
    freedom = max(fit.samples / fit.correlation_samples - 4, 1.0)
    return ResponseLag(lag, float(np.sqrt(2 * least / freedom / curvature)))


def misfit_at(response: Response, lag: float) -> float:
    """Sum of squares [N^2 m^2] that Eq. 15 leaves of the torque read a lag [s] later, per sample's share."""
    rows, torque = response.window, shifted(response, lag)
    fit = fit_without_offset(response.motion[rows], torque)
    return float(np.sum((torque - fit.torque(response.motion[rows])) ** 2))


def shifted(response: Response, lag: float) -> Array:
    """Torque (n,) [N*m] in the window, read a lag [s] later."""
    spline = make_interp_spline(response.time, response.torque, k=5)
    return np.asarray(spline(response.time[response.window] + lag))
