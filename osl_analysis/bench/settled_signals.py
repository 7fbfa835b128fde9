"""The signals of a stepped sine that its fits use: raw ones with segments, and filtered ones of settled cycles."""

from collections.abc import Sequence
from dataclasses import dataclass

from osl_analysis.bench.segments import Segment
from osl_analysis.stats.covariance import RepeatedError
from osl_analysis.trial import Array


@dataclass(frozen=True)
class RawSignals:
    """Raw signals of one stepped-sine trial, shape (n,) each, and the segments that are fitted."""

    time: Array
    """Time [s]."""
    theta: Array
    """Joint angle [rad]."""
    command: Array | None
    """Commanded joint angle [rad]; None if no log has it."""
    torque: Array
    """Resisting torque [N*m] without the load cell's drift."""
    rate_hz: float
    """Sampling rate [Hz]."""
    segments: Sequence[Segment]
    """The settled segments."""
    repeated: Sequence[RepeatedError] = ()
    """The rounding of angle and of torque as errors of the torque in the rows of the segments."""
