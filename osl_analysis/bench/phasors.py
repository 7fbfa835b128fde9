"""Phasors of angle and torque in each segment of a stepped sine: `phasors.csv`, behind Fig. 7."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.bench.complex_estimate import (
    NO_BENCH_ERROR,
    BenchError,
    ComplexEstimate,
    complex_quotient,
    complex_row,
)
from osl_analysis.bench.record import Record
from osl_analysis.bench.row_groups import Stratum
from osl_analysis.dictionary import table_of
from osl_analysis.errors import InputError
from osl_analysis.measured import check_finite, check_measured
from osl_analysis.spectral.stepped_sine import whole_rows
from osl_analysis.stats.covariance import (
    FEWEST_CYCLES,
    between_cycles,
    hac,
    products_between,
)
from osl_analysis.stats.table_rows import Row
from osl_analysis.trial import Array

SHARED = ("Y_se_bench", "Y_gain_se_bench", "Y_phase_se_bench")
"""Columns of the `BenchError` of Y: compliance, gain, phase."""
HIGHEST_HARMONIC = 5
"""Friction makes odd harmonics, which fall as 1/k or faster; asymmetry makes even ones."""
WHOLE_CYCLE = (
    0.99  # a cycle may lack this much of its last sample, which ends before the next begins
)
SMALLEST_SINE = 1e-12  # of the signal: a smaller sine is the rounding of the fit


@dataclass(frozen=True)
class Phasor(ComplexEstimate):
    """Complex amplitude P of a sine: signal = Re(P exp(j w t)) + offset + harmonics.

    Attributes
    ----------
    harmonics : NDArray[np.complex128]
        Complex amplitudes of the fundamental and of harmonics 2 to 5 (5,), in the unit of the
        signal: harmonic k is Re(H exp(j k w t)).
    interval_method : str
        Source of the covariance, as in `LinearFit`.
    """

    harmonics: NDArray[np.complex128]
    interval_method: str

    @property
    def distortion(self) -> float:
        """Root sum of squares of harmonics 2 to 5, divided by the fundamental."""
        size = np.abs(self.harmonics)
        return float(np.linalg.norm(size[1:]) / size[0])


@dataclass(frozen=True)
class FittedCycles:
    """Where the fitted cycles of a segment begin and end, as rows, which may be fractional."""

    first: Array  # (m,)
    stop: Array  # (m,)

    @property
    def rows(self) -> slice:
        """The rows from the first cycle to the last one."""
        return whole_rows(self.first.min(), self.stop.max())

    @property
    def samples(self) -> float:
        """Number of samples in all cycles."""
        return float(np.sum(self.stop - self.first))

    def counted_from(self, row: int) -> "FittedCycles":
        """The same cycles in a signal that begins at a row."""
        return FittedCycles(self.first - row, self.stop - row)


def fit_sinusoids(
    time: Array, frequency_hz: float, *signals: Array, cycles: FittedCycles | None = None
) -> list[Phasor]:
    """Fit the phasor of each signal, with an offset and harmonics 2 to 5.

    Parameters
    ----------
    time : Array
        Times (n,) [s], evenly spaced; they define zero phase.
    frequency_hz : float
        Frequency of the sine [Hz].
    *signals : Array
        Settled signals (n,), each in its unit.
    cycles : FittedCycles, optional
        The fitted cycles. Without them all rows are, divided into cycles from the first one on.

    Returns
    -------
    list[Phasor]
        One phasor per signal.

    Raises
    ------
    InputError
        Less than one cycle, steps too long for harmonic 5, not more samples than unknowns, a value
        that cannot be measured, or no sine.

    Notes
    -----
    Least squares of the signal on 1, cos(k w t) and sin(k w t), k = 1 ... 5. The normal equations
    are well conditioned: sines are orthogonal over whole cycles. The covariance comes from the
    spread of cycles; with fewer than five, from the autocorrelation of the residual.
    """
    check_finite("time", time)
    step_s = check_sampling(time, frequency_hz)
    columns = harmonic_columns(time, frequency_hz)
    if cycles is None:
        cycles = cycles_from_first_row(len(time), step_s, frequency_hz)
        fitted_rows = np.ones(len(time), dtype=np.bool_)
    else:
        fitted_rows = rows_of_cycles(len(time), cycles)
    fitted: Array = columns if fitted_rows.all() else columns[fitted_rows]
    samples, unknowns = fitted.shape
    if samples <= unknowns:
        raise InputError(
            f"{samples} samples cannot determine a sine with its offset and harmonics 2 to"
            f" {HIGHEST_HARMONIC}, which have {unknowns} unknowns; sample faster, or record more"
            " cycles"
        )
    inverse = np.asarray(np.linalg.inv(fitted.T @ fitted), dtype=np.float64)

    phasors = []
    for signal in signals:
        check_measured("the signal", signal)
        estimates = inverse @ (fitted.T @ signal[fitted_rows])
        residual = signal - columns @ estimates
        if len(cycles.first) < FEWEST_CYCLES:
            covariance, freedom, method, _ = hac(fitted, inverse, residual[fitted_rows])
        else:
            products = products_between(columns, residual[:, None], cycles.first, cycles.stop)
            scores = products[..., 0] @ inverse
            covariance, freedom = between_cycles(scores, of_one_stratum(scores))
            method = "cycles"
        # a cos(wt) + b sin(wt) = Re((a - j b) exp(j w t))
        harmonics = estimates[1::2] - 1j * estimates[2::2]
        if abs(harmonics[0]) <= SMALLEST_SINE * np.abs(signal).max():
            raise InputError(
                f"the signal has no sine of {frequency_hz:g} Hz, it stays at {signal[0]:g}; check"
                " its channel in the source file, or exclude the trial"
            )
        sign_of_parts = np.array([[1.0, -1.0], [-1.0, 1.0]])  # the imaginary part is -b
        phasors.append(
            Phasor(
                complex(harmonics[0]),
                sign_of_parts * covariance[1:3, 1:3],
                float(np.min(freedom[1:3])),
                harmonics,
                method,
            )
        )
    return phasors


def check_sampling(time: Array, frequency_hz: float) -> float:
    """The step of the times [s]. Raises InputError: less than one cycle, or too long a step."""
    n = len(time)
    step_s = float(time[-1] - time[0]) / (n - 1) if n > 1 else np.inf
    if n * step_s < WHOLE_CYCLE / frequency_hz:
        raise InputError(
            f"the signal has less than one cycle at {frequency_hz:g} Hz; record more cycles, or"
            " lower `settle_cycles` in the configuration"
        )
    if 2 * HIGHEST_HARMONIC * frequency_hz * step_s >= 1:
        raise InputError(
            f"a step of {step_s * 1e3:.2f} ms is too long for harmonic {HIGHEST_HARMONIC} of"
            f" {frequency_hz:g} Hz; sample faster"
        )
    return step_s


def harmonic_columns(time: Array, frequency_hz: float) -> Array:
    """The columns (n, 11) of the fit: 1, then cos(k w t) and sin(k w t) for k = 1 ... 5."""
    turn = np.exp(2j * np.pi * frequency_hz * time)
    turns = np.cumprod(np.tile(turn, (HIGHEST_HARMONIC, 1)), axis=0)
    columns = [np.ones(len(time))]
    for turn_of_harmonic in turns:
        columns += [turn_of_harmonic.real, turn_of_harmonic.imag]
    return np.vstack(columns).T


def cycles_from_first_row(n: int, step_s: float, frequency_hz: float) -> FittedCycles:
    """The whole cycles of n rows, one after the other from the first row on."""
    edges = np.arange(round(n * step_s * frequency_hz) + 1) / (step_s * frequency_hz)
    return FittedCycles(edges[:-1], np.minimum(edges[1:], n))


def rows_of_cycles(n: int, cycles: FittedCycles) -> NDArray[np.bool_]:
    """Which of n rows lie in a cycle, (n,)."""
    inside = np.zeros(n, dtype=np.bool_)
    for first, stop in zip(cycles.first, cycles.stop, strict=True):
        inside[whole_rows(first, stop)] = True
    return inside


def of_one_stratum(scores: Array) -> NDArray[np.intp]:
    """The stratum of each cycle (m,) where all repeat one another."""
    return np.zeros(len(scores), dtype=np.intp)


@dataclass(frozen=True)
class SegmentPhasors:
    """Phasors of raw angle and torque in one segment: one frequency at one amplitude."""

    amplitude_deg: float  # measured amplitude [deg] that names the fits to all its frequencies
    frequency_hz: float
    theta: Phasor  # of the joint angle [rad]
    torque: Phasor  # of the resisting torque [N*m]
    bench_error: BenchError = NO_BENCH_ERROR
    commanded_deg: float | None = None  # amplitude [deg] in the protocol

    @property
    def admittance(self) -> ComplexEstimate:
        """Integral admittance Y = theta/torque [rad/(N*m)]. An error c of the bench's compliance
        changes Y by -c."""
        return self.bench_error.added_to(complex_quotient(self.theta, self.torque))

    def to_row(self, trial: str) -> Row:
        """The segment's row of `phasors.csv`."""
        Y = self.admittance
        return {
            "trial": trial,
            "amplitude_deg": self.amplitude_deg,
            "frequency_hz": self.frequency_hz,
            "theta_distortion": self.theta.distortion,
            "torque_distortion": self.torque.distortion,
            **complex_row("Y", Y),
            "Y_phase_deg_se": float(np.rad2deg(Y.phase_se)),
            "Y_se_bench": self.bench_error.compliance,
            "Y_gain_se_bench": self.bench_error.gain,
            "Y_phase_se_bench": self.bench_error.phase,
            "interval_method": self.theta.interval_method,  # the torque's are the same cycles
            "commanded_deg": self.commanded_deg,
        }


def phasors_of_record(record: Record) -> list[SegmentPhasors]:
    """Fit the phasors of every segment of a stepped sine, amplitude by amplitude.

    Parameters
    ----------
    record : Record
        A recording of the bench. Its last cycle of a segment is not used: if the lag of the angle
        grows, it contains the beginning of the next frequency.

    Returns
    -------
    list[SegmentPhasors]
        Of the settled cycles; empty for other motions than a stepped sine.

    Raises
    ------
    InputError
        As `fit_sinusoids`; the message names the trial.
    """
    if not record.is_stepped_sine:
        return []
    groups = record.groups
    by_amplitude = sorted(
        range(len(groups.strata)),
        key=lambda stratum: groups.labels.index(groups.strata[stratum].label),
    )
    return [segment_phasors(record, stratum) for stratum in by_amplitude]


def segment_phasors(record: Record, index: int) -> SegmentPhasors:
    """The phasors of one stratum of a record: the cycles of one frequency at one amplitude."""
    segment: Stratum = record.groups.strata[index]
    assert isinstance(segment.label, float)
    of_segment = record.groups.stratum == index
    cycles = FittedCycles(record.groups.first[of_segment], record.groups.stop[of_segment])
    rows = cycles.rows
    theta, torque = fit_sinusoids(
        record.time[rows],
        segment.frequency_hz,
        record.theta[rows],
        record.torque[rows],
        cycles=cycles.counted_from(rows.start),
    )
    gain, phase = record.calibration.polar(segment.frequency_hz)
    compliance = record.bench.compliance_error if record.bench else 0.0
    return SegmentPhasors(
        segment.label,
        segment.frequency_hz,
        theta,
        torque,
        BenchError(compliance, gain, phase),
        segment.commanded_deg,
    )


def phasor_table(trial: str, phasors: Sequence[SegmentPhasors]) -> pl.DataFrame:
    """A row per amplitude and frequency; none without sines."""
    return table_of([segment.to_row(trial) for segment in phasors], "phasors")
