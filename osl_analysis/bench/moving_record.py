"""A trial of any excitation as its fit needs it: the rows in which the joint moves, and the filtered signals there."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from osl_analysis.bench.alternatives import joint_angle
from osl_analysis.bench.load_cell_drift import without_drift
from osl_analysis.bench.moving_rows import band_of, fitted_pieces, rows_inside, stretches_of
from osl_analysis.bench.segments import Segment
from osl_analysis.bench.settings import BenchStiffness, ImpedanceAnalysis
from osl_analysis.bench.settled_signals import RawSignals
from osl_analysis.bench.unfiltered_noise import UnfilteredNoise, noise_beyond
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.protocol.likeness import moving_bins
from osl_analysis.second_order import impedance_columns
from osl_analysis.signals import LowPass, Motion, filtered_motion
from osl_analysis.spectral.realisations import PeriodicMotion, periodic_motion
from osl_analysis.stats.covariance import ResidualCorrelation
from osl_analysis.stats.regression import LinearFit, Regressors, regressors
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
    softer: "MovingRecord | None" = None
    """The same with a bench that is softer by one standard error; None where it does not yield."""

    @property
    def name(self) -> str:
        """Name of the trial."""
        return self.uniform.trial

    @property
    def time(self) -> Array:
        """Uniform times (n,) [s]."""
        return self.uniform.time

    @property
    def rate_hz(self) -> float:
        """Samples per second."""
        return self.uniform.rate_hz

    @cached_property
    def rows(self) -> NDArray[np.intp]:
        """The rows that are fitted, one stretch after the other."""
        return np.concatenate([np.r_[piece] for piece in self.pieces])

    def part(self, signal: Array) -> Array:
        """A signal (n,) in the rows that are fitted; a view where they follow one another."""
        parts = [signal[piece] for piece in self.pieces]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    @property
    def seconds(self) -> float:
        """Duration [s] of what is fitted."""
        return len(self.rows) / self.rate_hz

    def residual_correlation(self, modelled: Array) -> ResidualCorrelation:
        """How residuals in the fitted rows depend on one another, if the torque without noise is `modelled` (n,).

        What the filter takes off the torque is noise, but for the motion near the cut-off.
        """
        off = noise_beyond(self.torque - self.filtered_torque, modelled, self.low_pass, self.rate_hz)
        return UnfilteredNoise(every=self.low_pass.independent_samples(self.rate_hz), filtered_off=self.part(off))

    @cached_property
    def fit(self) -> LinearFit:
        """Eq. 15 with offset and drift, as `fit_of` has it."""
        return fit_of(self)

    @cached_property
    def periodic(self) -> PeriodicMotion | None:
        """The realisations of a motion that repeats itself, in the whole record or the stated windows; else None."""
        used = self.uniform.usable & self.inside
        return periodic_motion(self.theta, self.torque, self.rate_hz, PERIODIC * self.low_pass.cutoff_hz, used)

    @property
    def raw(self) -> RawSignals:
        """The raw signals for the estimators, each stretch as one segment."""
        middle = float(np.mean(self.band_hz))
        segments = [Segment(0.0, middle, float(p.start), float(p.stop), 1) for p in self.pieces]
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
    bench, stated = settings.bench_stiffness, windows or settings.windows
    try:
        made = record_of(signals, settings, stated)
        other = made.uniform.other()
        return replace(
            made,
            other=None if other is None else record_of(other, settings, stated),
            softer=None if bench is None else record_of(made.uniform, settings, stated, bench.compliance_error),
        )
    except (InputError, IdentifiabilityError) as error:
        raise type(error)(f"trial {trial.name}: {error}") from error


def record_of(
    signals: UniformSignals, settings: ImpedanceAnalysis, windows: str | None, more_compliance: float = 0.0
) -> MovingRecord:
    """The record behind uniform signals; raises as `moving_record`, without the trial's name.

    The time base bridges gaps up to a tenth of a period of the fastest motion, which is found first. The bench is
    softer than its settings by `more_compliance` [rad/(N*m)].
    """
    bench, low_pass = settings.bench_stiffness, settings.low_pass
    compliance = (bench.compliance if bench else 0.0) + more_compliance
    made = filtered_record(signals, low_pass, compliance, windows)
    highest = min(made.band_hz[1], settings.cutoff_hz)
    if made.uniform.report.masked or any(stream.bridged for stream in made.uniform.report.streams):
        limits = GapLimits(highest, settings.cutoff_hz, settings.time_base.longest_gap_s)
        made = filtered_record(regridded(signals, limits), low_pass, compliance, windows)
    drift = drift_of(made)
    torque = without_drift(made.time, made.torque, drift)
    theta = joint_angle(made.uniform["theta"], torque, compliance)
    motion, filtered = filtered_motion(made.time, theta, torque, low_pass)
    return replace(
        made,
        theta=theta,
        torque=torque,
        motion=motion,
        filtered_torque=filtered,
        drift=drift,
        bench=bench,
        largest_inertia_error=settings.largest_inertia_error,
        largest_drift_ppm=settings.time_base.largest_drift_ppm,
    )


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
    pieces, inside = fitted_pieces(signals, low_pass, windows), rows_inside(signals, windows)
    band = band_of(motion, signals.rate_hz, stretches_of(pieces, inside))
    return MovingRecord(signals, theta, signals["torque"], motion, filtered, pieces, inside, band, low_pass)


def fit_of(record: MovingRecord, more: Sequence[tuple[str, Array]] = ()) -> LinearFit:
    """Eq. 15 with offset and drift over the fitted rows, and `more` columns (n,) of the record, by name.

    Raises
    ------
    InputError, IdentifiabilityError
        As `linear_fit`.
    """
    columns, found, estimates = solved(record, more)
    modelled = np.zeros(len(record.time))
    for size, column in zip(estimates, columns.values(), strict=True):
        modelled += size * column
    del columns
    return found.fit(record.part(record.filtered_torque), record.residual_correlation(modelled))


def left_by(record: MovingRecord) -> float:
    """RMS [N*m] of what Eq. 15 with offset and drift leaves of the fitted rows; raises as `fit_of`."""
    _, found, estimates = solved(record)
    return float(np.std(record.part(record.filtered_torque) - found.X @ estimates))


def estimates_of(record: MovingRecord, more: Sequence[tuple[str, Array]] = ()) -> dict[str, float]:
    """The estimates of `fit_of` by name, without their intervals, for a tenth of the work."""
    columns, _, estimates = solved(record, more)
    return dict(zip(columns, estimates.tolist(), strict=True))


def solved(
    record: MovingRecord, more: Sequence[tuple[str, Array]] = ()
) -> tuple[Mapping[str, Array], Regressors, Array]:
    """The columns (n,) of `fit_of` by name, those of its rows, and its estimates (p,)."""
    time = record.time - record.time.mean()
    columns = {**impedance_columns(record.motion), "drift": time, **dict(more)}
    torque = record.part(record.filtered_torque)
    found = regressors({name: record.part(column) for name, column in columns.items()}, np.shape(torque))
    return columns, found, found.solved(torque)
