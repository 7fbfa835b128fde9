"""The stiffness of a bench's frame, of angles on both sides of it."""

from dataclasses import dataclass

import numpy as np
import scipy

from osl_analysis.bench.bench_settings import BenchStiffness, SteppedSineAnalysis
from osl_analysis.bench.row_groups import Groups
from osl_analysis.signals.grid import uniform_signals
from osl_analysis.stats.estimates import NORMAL_HALF_WIDTH
from osl_analysis.stats.table_rows import INTERVAL_ENDS, Row
from osl_analysis.trial import Array, Trial

JOINT_SIDE = "theta_joint"  # column of the angle between frame and joint


@dataclass(frozen=True)
class Frame:
    """What yields between the angles `theta` and `theta_joint`.

    Attributes
    ----------
    compliance, standard_error : float
        Of the deflection per torque [rad/(N*m)].
    freedom : int
        Degrees of freedom of the standard error.
    """

    compliance: float
    standard_error: float
    freedom: int

    @property
    def half_width(self) -> float:
        """Of the 95 % interval of the compliance [rad/(N*m)]."""
        return float(scipy.special.stdtrit(self.freedom, 0.975)) * self.standard_error

    @property
    def yields(self) -> bool:
        """Whether the compliance is certainly above zero."""
        return self.compliance > self.half_width

    @property
    def stiffness(self) -> BenchStiffness | None:
        """As the configuration states it; None of a frame that does not certainly yield."""
        if not self.yields:
            return None
        value = 1 / self.compliance
        return BenchStiffness(
            value=f"{value:.4g} N*m/rad",
            standard_error=f"{value**2 * self.half_width / NORMAL_HALF_WIDTH:.2g} N*m/rad",
        )

    def row(self) -> Row:
        """The columns `frame_stiffness...` [N*m/rad]; null of a frame that does not certainly
        yield. The interval is that of the compliance, inverted."""
        if not self.yields:
            return dict.fromkeys(NO_FRAME)
        ends = (1 / (self.compliance + way * self.half_width) for way in (1, -1))
        value = 1 / self.compliance
        return dict(zip(NO_FRAME, (value, *ends), strict=True))


NO_FRAME = tuple(f"frame_stiffness{ending}" for ending in INTERVAL_ENDS)


def measured_frame(trial: Trial, settings: SteppedSineAnalysis, groups: Groups) -> Frame | None:
    """Measure the frame in the rows of groups; None without an angle on the joint's side.

    Notes
    -----
    Least squares of theta - theta_joint over the torque, with an offset. The standard error is that
    of leaving out a group of rows at a time.

    Raises
    ------
    InputError
        The angle has no time base.
    """
    if JOINT_SIDE not in trial.columns:
        return None
    signals = uniform_signals(trial, ("theta", JOINT_SIDE, "torque"), settings.gap_limits)
    rate_hz = signals.rate_hz
    wound = settings.low_pass(signals["theta"] - signals[JOINT_SIDE], rate_hz)
    torque = settings.low_pass(signals["torque"], rate_hz)
    edges = np.rint(np.stack([groups.first, groups.stop], axis=1)).astype(np.intp)
    sums = np.array([sums_of(torque[first:stop], wound[first:stop]) for first, stop in edges])
    total = sums.sum(axis=0)
    without = np.array([slope_of(total - one) for one in sums])
    m = len(sums)
    variance = (m - 1) / m * np.sum((without - without.mean()) ** 2)
    return Frame(slope_of(total), float(np.sqrt(variance)), m - 1)


def sums_of(x: Array, y: Array) -> Array:
    """n, sum of x, of y, of x^2 and of x y, (5,)."""
    return np.array([len(x), x.sum(), y.sum(), x @ x, x @ y])


def slope_of(sums: Array) -> float:
    """Slope of y over x of a line with an offset, by `sums_of`."""
    n, x, y, xx, xy = sums
    return float((xy - x * y / n) / (xx - x * x / n))
