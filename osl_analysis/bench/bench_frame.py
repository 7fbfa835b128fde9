"""The stiffness of a bench's frame, of angles on both sides of it."""

from dataclasses import dataclass

import numpy as np
import scipy

from osl_analysis.bench.bench_settings import BenchStiffness, SteppedSineAnalysis
from osl_analysis.bench.record import Groups
from osl_analysis.bench.regression import jackknife
from osl_analysis.signals.grid import uniform_signals
from osl_analysis.stats.covariance import products_between
from osl_analysis.stats.estimates import NORMAL_HALF_WIDTH
from osl_analysis.stats.table_rows import Row
from osl_analysis.trial import Trial

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
        """The columns `frame_stiffness...` [N*m/rad]; none of a frame that does not certainly
        yield. The interval is that of the compliance, inverted."""
        if not self.yields:
            return {}
        return {
            "frame_stiffness": 1 / self.compliance,
            "frame_stiffness_low": 1 / (self.compliance + self.half_width),
            "frame_stiffness_high": 1 / (self.compliance - self.half_width),
        }


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
    X = np.column_stack([torque, np.ones_like(torque)])
    products = products_between(X, np.column_stack([X, wound]), groups.first, groups.stop)
    A_g, b_g = products[..., :2], products[..., 2]
    A, b = A_g.sum(axis=0), b_g.sum(axis=0)
    m = len(groups.first)
    variance = jackknife(A_g, b_g, A, b, np.arange(m))[0, 0]
    return Frame(float(np.linalg.solve(A, b)[0]), float(np.sqrt(variance)), m - 1)
