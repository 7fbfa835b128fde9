"""The signals of a stepped sine that its fits use: raw ones with segments, and filtered ones of settled cycles."""

from collections.abc import Sequence
from dataclasses import dataclass

from osl_analysis.bench.segments import Segment
from osl_analysis.signals import Motion
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


@dataclass(frozen=True)
class Settled:
    """Signals of a trial in the rows of its settled segments, one after the other, shape (n,) each."""

    motion: Motion
    """Filtered joint angle with its derivatives."""
    torque: Array
    """The torque through the same filter [N*m]."""
    filtered_off: Array
    """What the filter took off the torque [N*m]."""
