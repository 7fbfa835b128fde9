"""Fits to one load-unload cycle of the belt: the slope of torque on deflection, with the joint's damping beside it."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from osl_analysis.bench.alternatives import (
    widened,
)
from osl_analysis.errors import InputError
from osl_analysis.measured import check_measured
from osl_analysis.stats.regression import LinearFit
from osl_analysis.stats.slow_motion import fit_slow_motion
from osl_analysis.trial import Array

ONSET_FRACTION = 0.05
"""Deflection at which loading begins, as a share of the peak; below it the hysteresis of the belt reverses."""

LARGEST_FALL = 0.2
"""Largest fall of the deflection while loading, as a share of the peak."""

SMALLEST_DEFLECTION = np.deg2rad(0.5)

CONSTANT_VELOCITY = 0.05
"""Scatter of the velocity on one branch, as a share of its mean, up to which it counts as constant."""


@dataclass(frozen=True)
class BeltFit:
    """Fits to one load-unload cycle."""

    K_s: float
    """Slope while loading [N*m/rad]."""
    loading: LinearFit
    """Straight line with damping while loading: `K_s`, `offset` [N*m], and `B_j` [N*m per rad and sample] where the
    velocity is not constant."""
    unloading: LinearFit
    """The same while unloading."""
    quadratic: LinearFit
    """Torque on theta_s and theta_s |theta_s| while loading: `K_s`, `K_s2` [N*m/rad^2], `offset`."""
    hysteresis_area: float
    """Area of the loop [N*m*rad = J]."""

    def widened(self, softer: "BeltFit") -> "BeltFit":
        """The fit with the error of the bench's stiffness in its intervals, as `alternatives.widened`."""
        return replace(
            self,
            loading=widened(self.loading, softer.loading),
            unloading=widened(self.unloading, softer.unloading),
            quadratic=widened(self.quadratic, softer.quadratic),
        )


def fit_belt_stiffness(
    theta_s: Array, torque: Array, every: int = 1, drift: float = 0.0, usable: NDArray[np.bool_] | None = None
) -> BeltFit:
    """Fit one load-unload cycle: belt deflection theta_s [rad] and resisting torque [N*m], shape (n,).

    Rows that are not `usable` (n,) are not fitted.

    For the intervals: noise is independent after `every` samples (`LowPass.independent_samples`), and the load cell's
    drift has a standard deviation of `drift` [N*m per sample]. A straight line cannot tell a drift during the ramp from
    stiffness.

    Raises
    ------
    InputError
        The deflection stays below 0.5 degrees, the trial ends before unloading, or there is more than one loading;
        there are no samples, or a value is not finite or cannot be measured.
    """
    check_measured("theta_s", theta_s)
    check_measured("torque", torque)
    if not len(theta_s):
        raise InputError("no samples of the belt; record the trial again")
    deflection = theta_s - theta_s[0]
    onset, peak, release = loaded_rows(deflection)
    velocity = np.gradient(theta_s)
    good = np.arange(len(theta_s)) if usable is None else np.flatnonzero(usable)
    there, back = good[(good >= onset) & (good <= peak)], good[(good >= peak) & (good < release)]
    loading, unloading = (
        fit_straight_belt(Branch(deflection[rows], velocity[rows], torque[rows]), every, drift)
        for rows in (there, back)
    )
    quadratic = fit_quadratic_belt(Branch(deflection[there], velocity[there], torque[there]), every, drift)
    return BeltFit(loading["K_s"], loading, unloading, quadratic, float(np.trapezoid(torque, theta_s)))


def loaded_rows(deflection: Array) -> tuple[int, int, int]:
    """Rows of one load-unload cycle: the onset of loading, the peak, and the row after unloading.

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
        raise InputError("the trial ends while the belt is still loaded; record the way back too")
    check_one_loading(deflection[onset : peak + 1])
    return onset, peak, release


def check_one_loading(deflection: Array) -> None:
    """Refuse a deflection that falls on its way to the peak: the motion is not one turn there and back."""
    way = deflection * np.sign(deflection[-1])
    fall = float(np.max(np.maximum.accumulate(way) - way))
    if fall > LARGEST_FALL * abs(float(way[-1])):
        raise InputError(
            f"the belt falls back by {np.rad2deg(fall):.2f} deg before its peak of {np.rad2deg(abs(way[-1])):.2f} deg: "
            "this is no single loading; check that the trial is of experiment 'belt'"
        )


@dataclass(frozen=True)
class Branch:
    """The usable rows of loading or unloading, shape (n,) each."""

    theta_s: Array
    """Deflection [rad] from the first row of the trial on."""
    velocity: Array
    """Velocity of the joint [rad per sample]; the actuator is locked."""
    torque: Array
    """Resisting torque [N*m]."""

    @property
    def damping(self) -> dict[str, Array]:
        """The column of the joint's damping; none where the velocity is constant.

        Left in the slope, B_j omega shifts K_s by 0.12 N*m/rad on a raised cosine, because loading begins at a
        velocity and ends at rest. At a constant velocity it is a constant torque, which the offset contains, and K_s
        does not depend on it.
        """
        constant = float(np.std(self.velocity)) <= CONSTANT_VELOCITY * abs(float(np.mean(self.velocity)))
        return {} if constant else {"B_j": self.velocity}


def fit_straight_belt(branch: Branch, every: int, drift: float) -> LinearFit:
    """Straight line with intercept: `K_s` [N*m/rad], `offset` [N*m], and damping; curvature does not count as noise."""
    theta_s, velocity = branch.theta_s, branch.velocity
    columns = {"K_s": theta_s, "offset": np.ones_like(theta_s), **branch.damping}
    richer = {"K_s2": theta_s * np.abs(theta_s), "B_j": velocity}
    beside = {name: column for name, column in richer.items() if name not in columns}
    return fit_slow_motion(branch.torque, columns, beside, every, drift)


def fit_quadratic_belt(branch: Branch, every: int, drift: float) -> LinearFit:
    """Quadratic belt with intercept, odd in the deflection: `K_s`, `K_s2` [N*m/rad^2], `offset` [N*m].

    On a raised cosine damping and curvature look alike, so that this fit has no damping; it does not count as noise.
    """
    theta_s = branch.theta_s
    columns = {"K_s": theta_s, "K_s2": theta_s * np.abs(theta_s), "offset": np.ones_like(theta_s)}
    return fit_slow_motion(branch.torque, columns, {"B_j": branch.velocity}, every, drift)
