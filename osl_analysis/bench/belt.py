"""Belt stiffness: slope of torque on belt deflection while loading (Fig. 3)."""

from dataclasses import dataclass

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.stats.regression import LinearFit
from osl_analysis.stats.slow_motion import slow_fit
from osl_analysis.trial import Array

ONSET_FRACTION = 0.05
"""Loading begins where the deflection first passes this fraction of its peak: below it the belt's hysteresis turns."""
LARGEST_FALL = 0.2
"""Share of the peak by which the deflection may fall back while loading."""
SMALLEST_DEFLECTION = np.deg2rad(0.5)


@dataclass(frozen=True)
class BeltFit:
    """Loading slope `K_s` [N*m/rad] with its regression, slope while unloading, and the loop's area [N*m*rad = J].

    `quadratic` regresses torque on theta_s and theta_s |theta_s| while loading (`K_s`, `K_s2` [N*m/rad^2]).
    """

    K_s: float
    loading: LinearFit
    unloading: LinearFit
    quadratic: LinearFit
    hysteresis_area: float


def fit_belt_stiffness(theta_s: Array, torque: Array, every: int = 1, drift: float = 0.0) -> BeltFit:
    """Fit one load-unload cycle: belt deflection theta_s [rad] and resisting torque [N*m], shape (n,).

    For the intervals: noise is independent `every` so many samples (`LowPass.independent_samples`), and the load cell
    drifts by a standard deviation of `drift` [N*m per sample]. A straight line through a ramp takes a drift for
    stiffness.

    Raises
    ------
    InputError
        The deflection stays under 0.5 degrees, or the record ends before unloading.
    """
    deflection = theta_s - theta_s[0]
    onset, peak, release = loaded_rows(deflection)
    there, back = slice(onset, peak + 1), slice(peak, release)
    loading = slope(deflection[there], torque[there], every, drift)
    unloading = slope(deflection[back], torque[back], every, drift)
    quadratic = curvature(deflection[there], torque[there], every, drift)
    area = float(np.trapezoid(torque, theta_s))
    return BeltFit(loading["K_s"], loading, unloading, quadratic, area)


def loaded_rows(deflection: Array) -> tuple[int, int, int]:
    """Rows of one cycle where loading begins, where it ends at the peak, and where the belt is released again.

    Raises
    ------
    InputError
        As `fit_belt_stiffness`.
    """
    peak = int(np.argmax(np.abs(deflection)))
    if abs(deflection[peak]) < SMALLEST_DEFLECTION:
        raise InputError(
            f"the belt deflects by {np.rad2deg(abs(deflection[peak])):.3f} deg at most, expected 0.5 deg or more; "
            "check the angle channels and their units in the source file"
        )
    loaded = np.abs(deflection) >= ONSET_FRACTION * abs(deflection[peak])
    onset = int(np.argmax(loaded))
    release = len(loaded) - int(np.argmax(loaded[::-1]))
    if release - peak < 10 or release == len(loaded):
        raise InputError("the record ends while the belt is still loaded; record the way back too")
    check_one_loading(deflection[onset : peak + 1])
    return onset, peak, release


def check_one_loading(deflection: Array) -> None:
    """Refuse a belt that gives way on its way to the peak: another protocol than one turn there and back."""
    way = deflection * np.sign(deflection[-1])
    fall = float(np.max(np.maximum.accumulate(way) - way))
    if fall > LARGEST_FALL * abs(float(way[-1])):
        raise InputError(
            f"the belt falls back by {np.rad2deg(fall):.2f} deg before its peak of {np.rad2deg(abs(way[-1])):.2f} deg: "
            "this is no single loading; check that the trial is of experiment 'belt'"
        )


def slope(theta_s: Array, torque: Array, every: int, drift: float) -> LinearFit:
    """Straight line with intercept: `K_s` [N*m/rad], `offset` [N*m]. Curvature and damping are no noise about it."""
    richer = {"K_s2": theta_s * np.abs(theta_s), "B_j": np.gradient(theta_s)}
    return slow_fit(torque, {"K_s": theta_s, "offset": np.ones_like(theta_s)}, richer, every, drift)


def curvature(theta_s: Array, torque: Array, every: int, drift: float) -> LinearFit:
    """Quadratic belt with intercept, odd in the deflection: `K_s`, `K_s2` [N*m/rad^2], `offset` [N*m]."""
    columns = {"K_s": theta_s, "K_s2": theta_s * np.abs(theta_s), "offset": np.ones_like(theta_s)}
    return slow_fit(torque, columns, {"B_j": np.gradient(theta_s)}, every, drift)
