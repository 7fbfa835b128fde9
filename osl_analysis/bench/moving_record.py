"""A trial of any excitation as its fit needs it: the rows in which the joint moves, and the filtered signals there."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from osl_analysis.bench.alternatives import joint_angle, widened
from osl_analysis.bench.load_cell_drift import without_drift
from osl_analysis.bench.moving_fit import estimates_of, fit_of
from osl_analysis.bench.moving_rounding import with_rounding
from osl_analysis.bench.moving_rows import band_of, fitted_pieces, rows_inside, stretches_of
from osl_analysis.bench.periodic_fit import by_lines
from osl_analysis.bench.segments import Segment
from osl_analysis.bench.settings import BenchStiffness, ImpedanceAnalysis
from osl_analysis.bench.settled_signals import RawSignals
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.pieces import pieces
from osl_analysis.protocol.likeness import moving_bins
from osl_analysis.signals import LowPass, Motion, filtered_motion
from osl_analysis.spectral.realisations import PeriodicMotion, periodic_motion
from osl_analysis.stats.regression import LinearFit
from osl_analysis.stats.rounding import visible_step
from osl_analysis.timebase.gaps import GapLimits
from osl_analysis.trial import Array, Trial
from osl_analysis.uniform import UniformSignals, regridded, uniform_signals

PERIODIC = 1.5
"""Highest line of a periodic motion, in cut-offs of the filter."""


@dataclass(frozen=True)
class MovingRecord:
    """Signals of one trial of any excitation, shape (n,) each, and the stretches that are fitted."""

    uniform: UniformSignals
    """The signals on their time base."""
    theta: Array
    """Angle of the joint [rad], the yielding of the bench taken off."""
    torque: Array
    """Raw resisting torque [N*m] without the load cell's drift."""
    motion: Motion
    """Filtered joint angle with its derivatives."""
    filtered_torque: Array
    """The torque through the same filter [N*m]."""
    pieces: tuple[slice, ...]
    """Rows of the stretches that are fitted: moving, measured, away from ends."""
    inside: NDArray[np.bool_]
    """Rows of the stated windows; all of them without one."""
    band_hz: tuple[float, float]
    """Lowest and highest frequency [Hz] of the motion."""
    low_pass: LowPass
    """The filter of angle and torque."""
    largest_inertia_error: float | None = None
    """Change of I [kg*m^2] by a small torque error from which the record is refused; None: no limit."""
    largest_drift_ppm: float = np.inf
    """Drift [ppm] between the clocks of angle and torque from which the record is refused."""
    drift: float = 0.0
    """Drift of the load cell [N*m/s] that was subtracted from the torque."""
    bench: BenchStiffness | None = None
    """Stiffness of the bench."""
    other: "MovingRecord | None" = None
    """The same if undecided stamps were taken the other way; None where all are decided."""
    steps: tuple[float | None, float | None] = (None, None)
    """Steps to which the raw angle [rad] and torque [N*m] were rounded; None where they are not seen."""

    @property
    def name(self) -> str:
        """Name of the trial."""
        return self.uniform.trial

    @property
    def time(self) -> Array:
        """Uniform times (n,) [s]."""
        return self.uniform.time

    @property
    def bench_angle(self) -> Array:
        """Raw angle of the bench (n,) [rad], which is that of the joint where nothing yields."""
        return self.theta if self.bench is None else self.uniform["theta"]

    @property
    def rate_hz(self) -> float:
        """Samples per second."""
        return self.uniform.rate_hz

    @cached_property
    def samples(self) -> int:
        """Number m of fitted rows."""
        return sum(piece.stop - piece.start for piece in self.pieces)

    def rows_at(self, fitted: slice) -> list[slice]:
        """The rows behind some of the fitted ones, which are counted from 0 to m."""
        found, before = list[slice](), 0
        for piece in self.pieces:
            first, stop = (max(at - before, 0) + piece.start for at in (fitted.start, fitted.stop))
            if first < min(stop, piece.stop):
                found.append(slice(first, min(stop, piece.stop)))
            before += piece.stop - piece.start
        return found

    def fitted_pieces(self) -> Iterator[slice]:
        """All fitted rows, some at a time."""
        for stretch in self.pieces:
            for some in pieces(stretch.stop - stretch.start):
                yield slice(stretch.start + some.start, stretch.start + some.stop)

    @property
    def rows(self) -> NDArray[np.intp]:
        """The rows that are fitted (m,), one stretch after the other: as much room as a signal, for a short time."""
        return np.concatenate([np.r_[piece] for piece in self.pieces])

    def part(self, signal: Array) -> Array:
        """A signal (n,) in the rows that are fitted (m,); a view where they follow one another."""
        parts = [signal[piece] for piece in self.pieces]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    @property
    def seconds(self) -> float:
        """Duration [s] of what is fitted."""
        return self.samples / self.rate_hz

    @cached_property
    def fit(self) -> LinearFit:
        """Eq. 15 with offset and drift, as `fit_of` has it, with the encoder's rounding in the intervals."""
        return with_rounding(fit_of(self), self)

    @property
    def of_noise_and_lines(self) -> LinearFit:
        """The fit, of a periodic motion with estimates and intervals from its lines (`by_lines`)."""
        return by_lines(self.fit, self.periodic, self.time, self.low_pass)

    @cached_property
    def estimate(self) -> LinearFit:
        """The fit with the error of the bench's stiffness in its intervals; raises as `fit_of`."""
        softer = None if self.bench is None else softer_record(self, self.bench)
        return widened(self.of_noise_and_lines, None if softer is None else softer.of_noise_and_lines)

    @cached_property
    def periodic(self) -> PeriodicMotion | None:
        """The realisations of a motion that repeats itself, in the whole record or the stated windows; else None."""
        used = self.uniform.usable & self.inside
        return periodic_motion(self.theta, self.torque, self.rate_hz, PERIODIC * self.low_pass.cutoff_hz, used)

    def released(self) -> "MovingRecord":
        """The record without what its fits need no more: samples as recorded, and raw signals where nothing yields."""
        grid = replace(self.uniform.grid, signals={}, taken=())
        uniform = replace(self.uniform, grid=grid, signals={} if self.bench is None else self.uniform.signals)
        return replace(self, uniform=uniform, other=None if self.other is None else self.other.released())

    @property
    def raw(self) -> RawSignals:
        """The raw signals for the estimators, each stretch as one segment."""
        segments = [Segment(0.0, float(np.mean(self.band_hz)), float(p.start), float(p.stop), 1) for p in self.pieces]
        command = self.uniform.computed("theta_command")
        return RawSignals(self.time, self.theta, command, self.torque, self.rate_hz, segments)


def moving_record(
    trial: Trial, settings: ImpedanceAnalysis, windows: str | None = None, signals: UniformSignals | None = None
) -> MovingRecord:
    """Bring a trial on one time base, find where the joint moves, and filter; `windows` as in `stated_windows`.

    `signals` are those of `recorded`, where it was called already.

    Raises
    ------
    InputError
        A signal is missing or has no time base, windows are not in the record, or nothing is left to fit. The message
        names the trial.
    """
    if signals is None:
        signals = uniform_signals(trial, ("theta", "torque"), settings.gap_limits, computed=("theta_command",))
    stated = windows or settings.windows
    try:
        made = record_of(signals, settings, stated)
        other = made.uniform.other()
        return made if other is None else replace(made, other=record_of(other, settings, stated))
    except (InputError, IdentifiabilityError) as error:
        raise type(error)(f"trial {trial.name}: {error}") from error


def record_of(signals: UniformSignals, settings: ImpedanceAnalysis, windows: str | None) -> MovingRecord:
    """The record behind uniform signals; raises as `moving_record`, without the trial's name.

    The time base bridges gaps up to a tenth of a period of the fastest motion, which is found first.
    """
    bench, low_pass = settings.bench_stiffness, settings.low_pass
    compliance = bench.compliance if bench else 0.0
    made = filtered_record(signals, low_pass, compliance, windows)
    highest = min(made.band_hz[1], settings.cutoff_hz)
    if made.uniform.report.masked or any(stream.bridged for stream in made.uniform.report.streams):
        limits = GapLimits(highest, settings.cutoff_hz, settings.time_base.longest_gap_s)
        made = filtered_record(regridded(signals, limits), low_pass, compliance, windows)
    drift, raw = drift_of(made), made.uniform
    return replace(
        yielding(made, without_drift(made.time, made.torque, drift), compliance),
        drift=drift,
        bench=bench,
        largest_inertia_error=settings.largest_inertia_error,
        largest_drift_ppm=settings.time_base.largest_drift_ppm,
        steps=(visible_step(raw["theta"]), visible_step(raw["torque"])),
    )


def yielding(record: MovingRecord, torque: Array, compliance: float) -> MovingRecord:
    """The record with another torque (n,) [N*m], on a bench of some compliance [rad/(N*m)]; raises as the filter."""
    if not compliance:
        return replace(record, torque=torque, filtered_torque=record.low_pass(torque, record.rate_hz))
    theta = joint_angle(record.uniform["theta"], torque, compliance)
    motion, filtered = filtered_motion(record.time, theta, torque, record.low_pass)
    return replace(record, theta=theta, torque=torque, motion=motion, filtered_torque=filtered)


def softer_record(record: MovingRecord, bench: BenchStiffness) -> MovingRecord:
    """The record on a bench that is softer by one standard error; raises as `fit_of`."""
    raw, compliance = record.uniform["torque"], bench.compliance + bench.compliance_error
    drift = drift_of(yielding(record, raw, compliance))
    return yielding(record, without_drift(record.time, raw, drift), compliance)


def drift_of(record: MovingRecord) -> float:
    """Drift [N*m/s] of the load cell beside Eq. 15; raises IdentifiabilityError in the words of `moves_little`."""
    try:
        return estimates_of(record)["drift"]
    except IdentifiabilityError as error:
        raise IdentifiabilityError(moves_little(record, error)) from error


def moves_little(record: MovingRecord, error: IdentifiabilityError) -> str:
    """For how long and at which frequencies a record moves, where Eq. 15 cannot be fitted to it or to a part of it."""
    moving = np.count_nonzero(moving_bins(record.time, record.theta)[record.rows]) / record.rate_hz
    low, high = record.band_hz
    return (
        f"the joint moves for {moving:.2g} of the {record.seconds:.3g} s that are fitted, at {low:.2g} to "
        f"{high:.2g} Hz: {str(error).partition(';')[0]}; keep it moving by 0.5 to 6 Hz, or take the stiffness alone by "
        "experiment 'torque_angle'"
    )


def filtered_record(signals: UniformSignals, low_pass: LowPass, compliance: float, windows: str | None) -> MovingRecord:
    """The record of signals whose torque still has its drift."""
    theta = joint_angle(signals["theta"], signals["torque"], compliance)
    motion, filtered = filtered_motion(signals.time, theta, signals["torque"], low_pass)
    found, inside = fitted_pieces(signals, low_pass, windows), rows_inside(signals, windows)
    band = band_of(motion, signals.rate_hz, stretches_of(found, inside))
    return MovingRecord(signals, theta, signals["torque"], motion, filtered, found, inside, band, low_pass)
