"""Drift between the clocks of two devices, one of which measured the angle and the other the torque."""

from dataclasses import dataclass

import numpy as np

from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.signals import Motion
from osl_analysis.timebase.chunks import chunked_slope
from osl_analysis.trial import Array

DOUBTFUL_PPM, REFUSED_PPM = 0.5, 2.0
"""Drifts beyond which a fit is doubtful and refused: 50 ppm over a trial cost B 11 and I 53 %."""
CERTAIN = 3.0
"""Standard errors by which a drift must differ from zero before it is believed."""


@dataclass(frozen=True)
class ClockDrift:
    """How much faster the torque's clock runs than the angle's [ppm], and its standard error [ppm]."""

    ppm: float
    se: float

    def beyond(self, limit_ppm: float) -> bool:
        """The drift is larger than the limit, and larger than chance makes it."""
        return abs(self.ppm) > max(limit_ppm, CERTAIN * self.se)


def clock_drift(time: Array, motion: Motion, torque: Array) -> ClockDrift:
    """Drift from filtered motion and torque [N*m], (n,) each, at uniform usable times [s], of a second-order joint.

    A torque whose clock gains drifts to later stamps: at time t it is the torque of t - ppm (t - mean t). To first
    order that adds -ppm K (t - mean t) omega. The column (t - mean t) omega beside those of Eq. 15 measures it, to
    0.1 ppm in 142 s. It does not see a constant offset between the clocks, and a joint that warms up looks alike.

    Raises
    ------
    IdentifiabilityError
        The joint has no stiffness to see it by, or does not move.
    """
    ones = np.ones_like(time)
    columns = np.stack([motion.theta, motion.omega, motion.alpha, ones], axis=1)
    late = (time - time.mean()) * motion.omega
    both = np.stack([late, torque], axis=1)
    scale = np.linalg.norm(columns, axis=0)
    if not scale.all():
        raise IdentifiabilityError("the joint does not move: a drift between clocks cannot be seen; use another trial")
    solution = np.linalg.lstsq(columns / scale, both, rcond=None)[0]
    stiffness = solution[0, 1] / scale[0]
    rest = both - columns / scale @ solution
    slope, se = chunked_slope(rest[:, 0], rest[:, 1])
    if not stiffness or not np.isfinite(se):
        raise IdentifiabilityError("the torque does not follow the angle: a drift between clocks cannot be seen")
    return ClockDrift(float(-1e6 * slope / stiffness), float(1e6 * se / abs(stiffness)))


def is_drift_doubtful(drift: ClockDrift, doubtful_ppm: float = DOUBTFUL_PPM, refused_ppm: float = REFUSED_PPM) -> bool:
    """Whether B and I are doubtful since the clocks drift apart.

    Raises
    ------
    InputError
        The drift is beyond what B and I bear.
    """
    if drift.beyond(refused_ppm):
        raise InputError(
            f"the clocks of angle and torque drift apart by {drift.ppm:.2f} +- {drift.se:.2f} ppm, "
            f"more than {refused_ppm:g}: B and I would be wrong; "
            "synchronise the clocks, or record both channels with one device"
        )
    return drift.beyond(doubtful_ppm)
