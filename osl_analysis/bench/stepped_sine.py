"""A stepped-sine trial, from the recording to its fits: time base, protocol, the load cell's drift, the filter, and one
regression for each amplitude and one over all of them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from osl_analysis.bench.alternatives import joint_angle, widened, without_drift
from osl_analysis.bench.rounding import RepeatedRounding, Rounded, RoundingSums, total, with_sines
from osl_analysis.bench.segments import Block, Segment, find_blocks, repeated_cycles, rows_of, settled
from osl_analysis.bench.series import Series
from osl_analysis.bench.settings import BenchStiffness, SteppedSineAnalysis
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.protocol.likeness import Likeness
from osl_analysis.signals import LowPass, Motion, filtered_motion, joined
from osl_analysis.stats.covariance import FEWEST_CYCLES, KnownMemory, RepeatedError, ResidualCorrelation, sums_between
from osl_analysis.stats.regression import LinearFit, linear_fit, variance_accounted_for
from osl_analysis.stats.rounding import visible_step
from osl_analysis.timebase.drift import SinePiece, check_drift, clock_drift, drift_row
from osl_analysis.trial import Array, Trial
from osl_analysis.uniform import UniformSignals, origin, uniform_signals

Columns = Callable[[Motion], Mapping[str, Array]]  # the named columns (n,) of a model for a motion (n,)


@dataclass(frozen=True)
class Recorded:
    """Angle and torque of a trial on one time base, with the command if a log has it, and what the joint did."""

    signals: UniformSignals
    motion: Likeness  # the motion of the bench's angle, which the bench controls

    def other(self) -> "Recorded | None":
        """The same if undecided stamps were taken the other way; None where all are decided."""
        signals = self.signals.other()
        if signals is None:
            return None
        return Recorded(signals, Likeness(signals.time, signals["theta"], self.motion.protocol))


def recorded(trial: Trial, settings: SteppedSineAnalysis) -> Recorded:
    """The signals of a trial, as every fit of a stepped sine, or of another motion, takes them."""
    signals = uniform_signals(trial, ("theta", "torque"), settings.gap_limits, computed=("theta_command",))
    return Recorded(signals, Likeness(signals.time, signals["theta"], settings.protocol))


def resolution_of(trial: Trial, column: str, known: Recorded) -> float | None:
    """The step to which a column was rounded, in its unit: what the source file states, else what the values show."""
    stated = origin(trial, column).get("resolution")
    return float(stated) if stated else visible_step(known.signals.as_recorded(column))


@dataclass(frozen=True)
class SteppedSineTrial:
    """Raw and filtered signals of one stepped-sine trial, shape (n,) each, and the blocks of its protocol."""

    name: str  # name of the trial
    time: Array  # time [s]
    rate_hz: float  # sampling rate [Hz]
    theta: Array  # raw joint angle [rad]
    torque: Array  # raw resisting torque [N*m] without the load cell's drift
    motion: Motion  # filtered joint angle with its derivatives
    filtered_torque: Array  # the torque through the same filter [N*m]
    blocks: tuple[Block, ...]  # one block per amplitude
    settle_cycles: int  # number of cycles at the start of each segment that are not fitted
    low_pass: LowPass  # the filter of angle and torque
    drift: float  # drift of the load cell [N*m/s] that was subtracted from the torque
    steps: tuple[float | None, float | None] = (None, None)
    """Steps to which angle [rad] and torque [N*m] were rounded; None where they are not known."""
    usable: NDArray[np.bool_] | None = None  # rows that are not near a gap in the recording; None: all
    uniform: UniformSignals | None = None
    """The signals on their time base, with what the recorders did; None for a trial that no file holds."""
    bench: BenchStiffness | None = None  # stiffness of the bench; its yielding is taken off the angle
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
    rounding: dict[tuple[Columns, Segment], dict[str, RoundingSums]] = field(
        default_factory=dict, init=False, compare=False, repr=False
    )
    """What rounding adds up to beside a model in a segment (`rounding_beside`), as far as it was asked for."""

    @property
    def amplitudes(self) -> tuple[float | None, ...]:
        """Amplitude [deg] of each block, then None for all of them."""
        return (*(block.amplitude_deg for block in self.blocks), None)

    def part(self, amplitude: float | None) -> tuple[Motion, Array]:
        """Motion and filtered torque of the settled cycles of one amplitude [deg], or of all (None)."""
        segments = self.segments(amplitude)
        return joined([self.moved(segment) for segment in segments]), self.rows_in(self.filtered_torque, segments)

    def moved(self, segment: Segment) -> Motion:
        return joined([self.motion[piece] for piece in segment.pieces])

    def rows_in(self, signal: Array, segments: Sequence[Segment]) -> Array:
        """A signal (n,) in the rows of the segments, one after the other."""
        return np.concatenate([segment.part(signal) for segment in segments])

    def segments(self, amplitude: float | None) -> tuple[Segment, ...]:
        """The settled, usable segments of one amplitude [deg], or of all (None)."""
        each = zip(self.blocks, self.settled_blocks, strict=True)
        chosen = (one for b, one in each if amplitude is None or np.isclose(np.rad2deg(b.amplitude), amplitude))
        return tuple(segment for one in chosen for segment in one)

    @cached_property
    def settled_blocks(self) -> tuple[tuple[Segment, ...], ...]:
        """The settled, usable segments of each block."""
        return tuple(settled([block], self.settle_cycles, self.usable) for block in self.blocks)

    def beside(self, fit: LinearFit, columns: Columns) -> Series:
        """The filtered signals beside the torque of a model with these columns, which is fitted to settled cycles."""
        fitted = np.zeros(len(self.time), dtype=bool)
        fitted[rows_of(self.segments(None))] = True
        modelled = fit.predicted(columns(self.motion))
        return Series(self.time, self.filtered_torque, modelled, self.motion.theta, fitted)

    @property
    def independent_samples(self) -> int:
        """Samples after which the filter leaves noise independent."""
        return self.low_pass.independent_samples(self.rate_hz)

    def residual_correlation(
        self, amplitude: float | None, repeated: Sequence[RepeatedError] | None = None
    ) -> ResidualCorrelation:
        """How residuals in these rows depend on one another: the cycles repeat, and the filter correlates noise.
        `repeated` are the errors that the cycles repeat; None: the rounding of angle and torque."""
        segments = self.segments(amplitude)
        repeated = self.repeated_rounding(segments) if repeated is None else repeated
        cycles, every = repeated_cycles(segments), self.independent_samples
        if cycles is None:
            memory = self.low_pass.memory(self.rate_hz)
            return KnownMemory(every=every, repeated=repeated, memory=memory, position=rows_of(segments))
        off = self.rows_in(self.torque, segments) - self.rows_in(self.filtered_torque, segments)
        return ResidualCorrelation(cycles, every, filtered_off=off, repeated=repeated)

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


def stepped_sine_trial(trial: Trial, settings: SteppedSineAnalysis, known: Recorded | None = None) -> SteppedSineTrial:
    """Bring a canonical trial on one time base, find its protocol, subtract the load cell's drift, and filter.

    `known` is what `recorded` gives, where it was called already.

    Raises InputError: A signal is missing, has no time base, or does not follow the protocol; the message names the
    trial.
    """
    known = known or recorded(trial, settings)
    made, bench = stepped_sine_alone(trial, settings, known), settings.bench_stiffness
    try:
        again = known.other()
        return replace(
            made,
            other=None if again is None else stepped_sine_of(again, settings),
            softer=None if bench is None else stepped_sine_of(known, settings, bench.compliance_error),
        )
    except InputError as error:
        raise InputError(f"trial {trial.name}: {error}") from error


def stepped_sine_alone(trial: Trial, settings: SteppedSineAnalysis, known: Recorded | None = None) -> SteppedSineTrial:
    """As `stepped_sine_trial`, without `other` and `softer`, which cost as much again."""
    known = known or recorded(trial, settings)
    steps = resolution_of(trial, "theta", known), resolution_of(trial, "torque", known)
    try:
        return replace(stepped_sine_of(known, settings), steps=steps)
    except InputError as error:
        raise InputError(f"trial {trial.name}: {error}") from error


def stepped_sine_of(known: Recorded, settings: SteppedSineAnalysis, more_compliance: float = 0.0) -> SteppedSineTrial:
    """The trial behind uniform signals; raises as `stepped_sine_trial`, without the trial's name. The bench is softer
    than its settings by `more_compliance` [rad/(N*m)]."""
    signals, bench = known.signals, settings.bench_stiffness
    time, measured, usable = signals.time, signals["torque"], signals.usable
    blocks = find_blocks(time, signals["theta"], settings.protocol, known.motion.runs)
    drift = drift_rate(time, without_angle(signals["theta"], measured), settled(blocks, settings.settle_cycles, usable))
    torque = without_drift(time, measured, drift)
    theta = joint_angle(signals["theta"], torque, (bench.compliance if bench else 0.0) + more_compliance)
    motion, filtered = filtered_motion(time, theta, torque, settings.low_pass)
    return SteppedSineTrial(
        name=signals.trial,
        time=time,
        rate_hz=signals.rate_hz,
        theta=theta,
        torque=torque,
        motion=motion,
        filtered_torque=filtered,
        blocks=blocks,
        settle_cycles=settings.settle_cycles,
        low_pass=settings.low_pass,
        drift=drift,
        usable=usable,
        uniform=signals,
        bench=bench,
        largest_drift_ppm=settings.time_base.largest_drift_ppm,
    )


def drift_rate(time: Array, torque: Array, segments: Sequence[Segment]) -> float:
    """Drift of the load cell [N*m/s]: the slope that the settled cycles' mean torques have in common.

    A sine has no mean, so that the joint's own torque does not cause a slope of its cycles' means. A drift of
    0.05 N*m/min that is not subtracted is a tenth of the error of K at 1 Hz. It is the same in every cycle, so that the
    spread between cycles, from which intervals come, does not contain it.

    Each amplitude has a mean torque of its own: that of an asymmetric joint grows with the amplitude, and amplitudes
    may grow with time. The drift is 0 if no amplitude has the five cycles that an interval needs, because transients
    could then pass for drift. The times [s] are uniform.
    """
    along = across = 0.0
    for amplitude in dict.fromkeys(segment.amplitude for segment in segments):
        alike = [segment for segment in segments if segment.amplitude == amplitude]
        first, stop = (np.concatenate([s.edges[s.used + end] for s in alike]) for end in (0, 1))
        if len(first) >= FEWEST_CYCLES:
            samples = stop - first
            level = sums_between(torque[:, None], first, stop)[:, 0] / samples
            middle = (first + stop) / 2 * (time[-1] - time[0]) / (len(time) - 1)
            middle -= np.average(middle, weights=samples)
            along += float(np.sum(samples * middle**2))
            across += float(np.sum(samples * middle * level))
    return across / along if along else 0.0


def without_angle(theta: Array, torque: Array) -> Array:
    """The torque (n,) [N*m] minus what is proportional to the angle (n,) [rad]. A sine whose amplitude decays has a
    mean, of another size at each frequency. What the joint makes of it would pass for drift."""
    moved = theta - theta.mean()
    return np.asarray(torque - float(moved @ torque) / max(float(moved @ moved), np.finfo(float).tiny) * moved)


def widened_fits(trial: SteppedSineTrial, columns: Columns) -> Mapping[float | None, LinearFit]:
    """The `fits_by_amplitude` of a trial with the error of the bench's stiffness. They are made once, and kept."""
    if columns not in trial.fits:
        softer = {} if trial.softer is None else fits_by_amplitude(trial.softer, columns)
        fits = fits_by_amplitude(trial, columns)
        trial.fits[columns] = {amplitude: widened(fit, softer.get(amplitude)) for amplitude, fit in fits.items()}
    return trial.fits[columns]


def fits_by_amplitude(trial: SteppedSineTrial, columns: Columns) -> dict[float | None, LinearFit]:
    """The fit of a model to each amplitude [deg] of a trial, and to all of them (None); raises as `linear_fit`. What
    the rounding of a sensor adds up to in a segment is the same in the fit to its amplitude and in that to all."""
    rounding = {segment: rounding_beside(trial, segment, columns) for segment in trial.segments(None)}
    fits: dict[float | None, LinearFit] = {}
    for amplitude in trial.amplitudes:
        segments = trial.segments(amplitude)
        repeated = [total([rounding[s][column] for s in segments], segments) for column in trial.rounded]
        motion, torque = trial.part(amplitude)
        fits[amplitude] = linear_fit(torque, columns(motion), trial.residual_correlation(amplitude, repeated))
    return fits


def rounding_beside(
    trial: SteppedSineTrial, segment: Segment, columns: Columns, own: Array | None = None
) -> dict[str, RoundingSums]:
    """What the rounding of each signal whose step is known adds up to in a segment, by column. With columns `own` (n,
    q) of a fit to each rounded signal itself, this is beside them. What it is beside the columns of the model comes
    along in the same pass over the samples, and is kept in the trial."""
    key = columns, segment
    if own is not None or key not in trial.rounding:
        X = np.array(list(columns(trial.moved(segment)).values())).T
        p = X.shape[1]
        each = {c: RepeatedRounding(one, trial.filtered_torque, [segment]) for c, one in trial.rounded.items()}
        both = {column: one.sums_of(segment, X, own) for column, one in each.items()}
        trial.rounding[key] = {column: sums.beside(slice(p)) for column, sums in both.items()}
        if own is not None:
            return {column: sums.beside(slice(p, None)) for column, sums in both.items()}
    return trial.rounding[key]


def held_out_vaf(fit: LinearFit, trial: SteppedSineTrial, amplitude: float, columns: Columns) -> float:
    """VAF [percent] of a fit at an amplitude [deg] that it did not use."""
    motion, torque = trial.part(amplitude)
    return variance_accounted_for(torque, torque - fit.predicted(columns(motion)))


def clock_drift_row(trial: SteppedSineTrial) -> dict[str, float | str | None]:
    """`clock_drift_ppm` of the torque's clock against the angle's, its standard error, and the drift if it is certain.

    All null where one device recorded both, or the signals do not show it. Raises InputError, with the trial's name, if
    the drift is beyond what the configuration allows.
    """
    if trial.uniform is None or trial.uniform.one_device("theta", "torque"):
        return drift_row(None)
    pieces = [
        SinePiece(segment.frequency_hz, trial.time[rows], trial.motion[rows], trial.filtered_torque[rows])
        for segment in trial.segments(None)
        for rows in segment.pieces
    ]
    try:
        drift = clock_drift(pieces, trial.low_pass)
        check_drift(drift, trial.largest_drift_ppm)
    except IdentifiabilityError:
        return drift_row(None)
    except InputError as error:
        raise InputError(f"trial {trial.name}: {error}") from error
    return drift_row(drift)
