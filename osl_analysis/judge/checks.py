# SPDX-License-Identifier: Apache-2.0
"""The checks of recordings: their sources, and their thresholds in the shipped configuration.

`ingest/quality.py` measures the values; the configuration has the thresholds under `quality`.

Example: `CHECKS["gap"].failed(0.2, limit=0.05)`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from osl_analysis.judge.known_findings import MEANINGS_OF_CHECKS
from osl_analysis.stats.sources import Source

TOLERANCE = 1e-3  # share of a threshold: clocks of 100 Hz that nobody set run at 99.99 Hz


@dataclass(frozen=True)
class Check:
    """A check of recordings.

    Attributes
    ----------
    name
        Its name under `quality` in the configuration.
    source
        The source of the finding where its value is beyond the threshold.
    unit
        The unit of its value and threshold.
    threshold
        The threshold of the shipped configuration; 0 where there is none: a single fault is beyond
        it.
    fails
        The side of the threshold on which the check fails.
    excludes
        Whether its failure keeps a trial out of all other tables in the shipped configuration.
    """

    name: str
    source: Source
    unit: str
    threshold: float = 0.0
    fails: Literal["above", "below"] = "above"
    excludes: bool = False

    @property
    def meaning(self) -> str:
        """The meaning of its value, in words."""
        return MEANINGS_OF_CHECKS[self.name]

    def failed(self, value: float | None, limit: float) -> bool:
        """Whether a value is beyond its threshold by more than `TOLERANCE`; NaN fails, None (not
        applicable) does not."""
        if value is None:
            return False
        tolerance = TOLERANCE * limit
        if self.fails == "below":
            return not value >= limit - tolerance
        return not value <= limit + tolerance


LISTED_CHECKS = (
    # 20 times the fastest motion of the protocol
    Check("rate", Source.SLOW_SAMPLING, "Hz", threshold=100.0, fails="below"),
    # half a perturbation's window
    Check("gap", Source.GAP_IN_RECORDING, "s", threshold=0.05),
    # at one extreme in a row; noise stands there for two
    Check("saturation", Source.CLIPPED_SIGNAL, "samples", threshold=5),
    # a value repeated although noise or motion is expected
    Check("stuck", Source.FROZEN_SIGNAL, "s", threshold=0.5),
    Check("dropout", Source.SIGNAL_JUMPS, "samples"),
    # below the load that begins a stance
    Check("unzeroed_plate", Source.NOT_ZEROED, "N", threshold=20.0, excludes=True),
    # as walking.longest_gap_s bridges
    Check("marker_gap", Source.OCCLUDED_MARKER, "s", threshold=0.2),
    # a tenth of a small plate
    Check("cop_outside_plate", Source.WRONG_CENTRE_OF_PRESSURE, "m", threshold=0.03, excludes=True),
    # a rolling foot covers 0.1 m and more
    Check(
        "cop_travel",
        Source.WRONG_CENTRE_OF_PRESSURE,
        "m",
        threshold=0.02,
        fails="below",
        excludes=True,
    ),
    Check("encoder_wrap", Source.ANGLE_WRAPS, "jumps", excludes=True),
    # 1 ms changes B by 0.3 N*m*s/rad at 340 N*m/rad
    Check("clock_residual", Source.CLOCKS_DISAGREE, "s", threshold=0.001),
    # share of the log that was lost
    Check("damage", Source.DAMAGED_LOG, "%", threshold=1.0, excludes=True),
    Check("truncated", Source.DAMAGED_LOG, "logs"),
    Check("unit", Source.WRONG_UNIT, "channels"),
    # filters change a speed by 1 % of the derivative of its angle
    Check("contradiction", Source.COLUMNS_CONTRADICT, "%", threshold=3.0),
    Check("protocol", Source.OTHER_MOTION, "segments"),
)
CHECKS = {check.name: check for check in LISTED_CHECKS}
SHIPPED_QUALITY: Mapping[str, Any] = {
    "exclude": [check.name for check in LISTED_CHECKS if check.excludes],
    **{
        check.name: f"{check.threshold:g} {check.unit}"
        for check in LISTED_CHECKS
        if check.threshold
    },
}
"""`quality` of the shipped configuration, which may be edited in a clone; a test holds both against
each other."""
