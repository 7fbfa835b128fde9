"""A stepped-sine trial as the fits need it: raw and filtered signals, the settled cycles, the load cell's drift."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from osl_analysis.bench.rounding import RepeatedRounding, Rounded, RoundingSums
from osl_analysis.bench.segments import Block, Segment, repeated_cycles, rows_of, settled
from osl_analysis.bench.series import Series
from osl_analysis.bench.settings import BenchStiffness
from osl_analysis.bench.settled_signals import RawSignals
from osl_analysis.bench.sines import with_sines
from osl_analysis.pieces import pieces
from osl_analysis.signals import LowPass, Motion, joined
from osl_analysis.stats.covariance import RepeatedError, ResidualCorrelation
from osl_analysis.stats.leverage import KnownMemory
from osl_analysis.stats.partwise import Sums
from osl_analysis.stats.regression import LinearFit
from osl_analysis.trial import Array
from osl_analysis.uniform import UniformSignals

Columns = Callable[[Motion], Mapping[str, Array]]
"""The named columns (n,) of a model for a motion (n,)."""


@dataclass(frozen=True)
class SteppedSineTrial:
    """Raw and filtered signals of one stepped-sine trial, shape (n,) each, and the blocks of its protocol."""

    name: str
    """Name of the trial."""
    time: Array
    """Time [s]."""
    rate_hz: float
    """Sampling rate [Hz]."""
    theta: Array
    """Raw joint angle [rad]."""
    torque: Array
    """Raw resisting torque [N*m] without the load cell's drift."""
    motion: Motion
    """Filtered joint angle with its derivatives."""
    filtered_torque: Array
    """The torque through the same filter [N*m]."""
    blocks: tuple[Block, ...]
    """One block per amplitude."""
    command: Array | None
    """Commanded joint angle [rad] of a trial that no file holds; None: `uniform` has it, or there is none."""
    settle_cycles: int
    """Number of cycles at the start of each segment that are not fitted."""
    low_pass: LowPass
    """The filter of angle and torque."""
    drift: float
    """Drift of the load cell [N*m/s] that was subtracted from the torque."""
    steps: tuple[float | None, float | None] = (None, None)
    """Steps to which angle [rad] and torque [N*m] were rounded; None where they are not known."""
    usable: NDArray[np.bool_] | None = None
    """Rows that are not near a gap in the recording; None: all."""
    uniform: UniformSignals | None = None
    """The signals on their time base, with what the recorders did; None for a trial that no file holds."""
    bench: BenchStiffness | None = None
    """Stiffness of the bench; its yielding is taken off the angle."""
    other: "SteppedSineTrial | None" = None
    """The same if undecided stamps were taken the other way; None where all are decided."""
    softer: "SteppedSineTrial | None" = None
    """The same with a bench that is softer by one standard error; None where it does not yield."""
    largest_drift_ppm: float = np.inf
    """Drift [ppm] between the clocks of angle and torque from which the trial is refused."""
    fits: dict[Columns, Mapping[float | None, LinearFit]] = field(
        default_factory=dict, init=False, compare=False, repr=False
    )
    """The `widened_fits` that were made, by model and amplitude [deg]. A trial that is made of this one has none."""
    sums: dict[Columns, Mapping[Segment, Sums]] = field(default_factory=dict, init=False, compare=False, repr=False)
    """What the rows of each segment add up to for a model (`segment_sums`), as far as it was asked for."""
    rounding: dict[tuple[Columns, Segment], dict[str, RoundingSums]] = field(
        default_factory=dict, init=False, compare=False, repr=False
    )
    """What rounding adds up to beside a model in a segment (`rounding_beside`), as far as it was asked for."""

    @property
    def raw(self) -> RawSignals:
        """The raw signals with the settled segments of all amplitudes."""
        segments = self.segments(None)
        repeated = self.repeated_rounding(segments)
        command = self.command if self.uniform is None else self.uniform.computed("theta_command")
        return RawSignals(self.time, self.theta, command, self.torque, self.rate_hz, segments, repeated)

    def released(self) -> "SteppedSineTrial":
        """The trial without what its fits need no more: the samples as recorded, and the command that is among them."""
        return replace(self, uniform=None if self.uniform is None else self.uniform.released())

    @property
    def amplitudes(self) -> tuple[float | None, ...]:
        """Amplitude [deg] of each block, then None for all of them."""
        return (*(block.amplitude_deg for block in self.blocks), None)

    def parts(self) -> Iterator[tuple[float | None, Motion, Array]]:
        """Amplitude [deg], motion and filtered torque of each block's settled cycles, then of all (amplitude None)."""
        for amplitude in self.amplitudes:
            yield amplitude, *self.part(amplitude)

    def part(self, amplitude: float | None) -> tuple[Motion, Array]:
        """Motion and filtered torque of the settled cycles of one amplitude [deg], or of all (None)."""
        segments = self.segments(amplitude)
        return joined([self.moved(segment) for segment in segments]), self.rows_in(self.filtered_torque, segments)

    def with_fits_alone(self) -> "SteppedSineTrial":
        """The trial without samples: only the fits that were made of it can be asked for."""
        none = np.empty(0)
        bare = replace(self, time=none, theta=none, torque=none, motion=Motion(none, none, none), filtered_torque=none)
        bare.fits.update(self.fits)
        return bare

    def moved(self, segment: Segment) -> Motion:
        """The motion in the rows of a segment."""
        return joined([self.motion[piece] for piece in segment.pieces])

    def rows_in(self, signal: Array, segments: Sequence[Segment]) -> Array:
        """A signal (n,) in the rows of the segments, one after the other."""
        return np.concatenate([segment.part(signal) for segment in segments])

    def segments(self, amplitude: float | None) -> tuple[Segment, ...]:
        """The settled, usable segments of one amplitude [deg], or of all (None); `parts` yields their rows."""
        each = zip(self.blocks, self.settled_blocks, strict=True)
        chosen = (one for b, one in each if amplitude is None or np.isclose(np.rad2deg(b.amplitude), amplitude))
        return tuple(segment for one in chosen for segment in one)

    @cached_property
    def settled_blocks(self) -> tuple[tuple[Segment, ...], ...]:
        """The settled, usable segments of each block."""
        return tuple(settled([block], self.settle_cycles, self.usable) for block in self.blocks)

    def beside(self, fit: LinearFit, columns: Columns) -> Series:
        """The filtered signals beside the torque of a model with these columns, which is fitted to settled cycles."""
        fitted, modelled = np.zeros(len(self.time), dtype=bool), np.empty(len(self.time))
        for rows in pieces(len(self.time)):
            modelled[rows] = fit.predicted(columns(self.motion[rows]))
        for piece in (piece for segment in self.segments(None) for piece in segment.pieces):
            fitted[piece] = True
        return Series(self.time, self.filtered_torque, modelled, self.motion.theta, fitted)

    @property
    def independent_samples(self) -> int:
        """Samples after which the filter leaves noise independent."""
        return self.low_pass.independent_samples(self.rate_hz)

    def residual_correlation(
        self, amplitude: float | None, repeated: Sequence[RepeatedError] | None = None
    ) -> ResidualCorrelation:
        """How residuals in these rows depend on one another: the cycles repeat, and the filter correlates noise.

        `repeated` are the errors that the cycles repeat; None: the rounding of angle and torque.
        """
        segments = self.segments(amplitude)
        repeated = self.repeated_rounding(segments) if repeated is None else repeated
        cycles, every = repeated_cycles(segments), self.independent_samples
        if cycles is None:
            memory = self.low_pass.memory(self.rate_hz)
            return KnownMemory(every=every, repeated=repeated, memory=memory, position=rows_of(segments))
        return ResidualCorrelation(
            cycles,
            every,
            filtered_off=self.rows_in(self.torque, segments) - self.rows_in(self.filtered_torque, segments),
            repeated=repeated,
        )

    def repeated_rounding(self, segments: Sequence[Segment]) -> list[RepeatedRounding]:
        """The rounding of angle and torque, which the cycles of the segments may repeat, as errors of the torque; none
        where no step is known."""
        return [RepeatedRounding(one, self.filtered_torque, segments) for one in self.rounded.values()]

    @cached_property
    def rounded(self) -> Mapping[str, Rounded]:
        """The signals, angle and torque, whose steps are known, by column."""
        turned = self.theta if self.steps[0] is None else with_sines(self.motion.theta, self.time, self.segments(None))
        pairs = {"theta": (self.theta, turned), "torque": (self.torque, self.filtered_torque)}
        return {
            column: Rounded(step, *pair, self.time, self.time if self.uniform is None else self.uniform.sampled(column))
            for step, (column, pair) in zip(self.steps, pairs.items(), strict=True)
            if step is not None
        }
