"""Phasors of angle and torque in each segment of a stepped sine (Fig. 7) with their covariance, and harmonics."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isclose
from typing import TypeVar

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import stdtrit

from osl_analysis.bench.record import Label, Record
from osl_analysis.errors import InputError
from osl_analysis.measured import SMALLEST_SIGNAL, check_finite
from osl_analysis.protocol.stepped_sine import whole_rows
from osl_analysis.stats.covariance import (
    CYCLES,
    FEWEST_CYCLES,
    NO_REPEATS,
    between_cycles,
    products_between,
    welch_satterthwaite,
)
from osl_analysis.stats.fit_row import Row
from osl_analysis.stats.regression import regressors
from osl_analysis.trial import Array

COMPLEX_PARTS = ("re", "im", "var_re", "cov", "var_im", "degrees_of_freedom")  # endings of the columns of an estimate


@dataclass(frozen=True)
class ComplexEstimate:
    """A complex number that was estimated. Raises InputError: value or covariance cannot be measured."""

    value: complex
    covariance: Array  # covariance (2, 2) of real and imaginary part
    degrees_of_freedom: float  # degrees of freedom of its variances; infinite where these are 0

    def __post_init__(self) -> None:
        check_finite("the estimate", [self.value.real, self.value.imag])
        check_finite("the estimate's standard error", np.sqrt(np.abs(self.covariance)))

    @property
    def magnitude(self) -> float:
        return abs(self.value)

    @property
    def phase(self) -> float:
        """Phase [rad] between -pi and pi."""
        return float(np.angle(self.value))

    @property
    def magnitude_se(self) -> float:
        """Standard error of the magnitude, in the unit of the number; refused for 0."""
        return self._se_along(self.value / self._size)

    @property
    def phase_se(self) -> float:
        """Standard error of the phase [rad]; refused for 0."""
        return self._se_along(1j * self.value / self._size) / self._size

    @property
    def quantile(self) -> float:
        """Student's quantile: half the width of a 95 % interval in standard errors."""
        return float(stdtrit(self.degrees_of_freedom, 0.975))

    @property
    def _size(self) -> float:
        if self.magnitude < SMALLEST_SIGNAL:
            raise InputError(f"the number {self.value:.3g} has no phase; check the signals from which it was estimated")
        return self.magnitude

    def _se_along(self, direction: complex) -> float:
        unit = np.array([direction.real, direction.imag])
        return float(np.sqrt(max(float(unit @ self.covariance @ unit), 0.0)))


Estimate = TypeVar("Estimate", bound=ComplexEstimate)


def complex_quotient(numerator: ComplexEstimate, denominator: ComplexEstimate) -> ComplexEstimate:
    """numerator/denominator. The covariance is of first order; the two errors must be independent.

    Raises InputError: The denominator is 0, or smaller than anything measured.
    """
    if denominator.magnitude < SMALLEST_SIGNAL:
        raise InputError(f"no quotient by {denominator.value:.3g}; check the signal from which it was estimated")
    ratio = numerator.value / denominator.value
    derivatives = (1 / denominator.value, -ratio / denominator.value)
    covariances = [
        as_matrix(derivative) @ number.covariance @ as_matrix(derivative).T
        for derivative, number in zip(derivatives, (numerator, denominator), strict=True)
    ]
    return ComplexEstimate(ratio, *sum_covariances(covariances, (numerator, denominator)))


def complex_mean(numbers: Sequence[ComplexEstimate]) -> ComplexEstimate:
    """Mean of complex numbers whose errors are independent."""
    covariances = [number.covariance / len(numbers) ** 2 for number in numbers]
    return ComplexEstimate(complex(np.mean([n.value for n in numbers])), *sum_covariances(covariances, numbers))


def with_known_error(number: Estimate, error: complex) -> Estimate:
    """The number with one more error of known size, one standard deviation, in the direction of `error` (type B)."""
    parts = np.array([error.real, error.imag])
    covariances = [number.covariance, np.outer(parts, parts)]
    each = [number.degrees_of_freedom, np.inf]
    degrees_of_freedom = float(welch_satterthwaite([np.trace(C) for C in covariances], each))
    return replace(number, covariance=np.sum(covariances, axis=0), degrees_of_freedom=degrees_of_freedom)


def as_matrix(z: complex) -> Array:
    """Multiplication by a complex number, as a matrix (2, 2) on real and imaginary part."""
    return np.array([[z.real, -z.imag], [z.imag, z.real]])


def sum_covariances(covariances: Sequence[Array], numbers: Sequence[ComplexEstimate]) -> tuple[Array, float]:
    """Sum of the independent covariances (2, 2) that come from `numbers`, and its degrees of freedom (by the trace)."""
    each = [number.degrees_of_freedom for number in numbers]
    return np.sum(covariances, axis=0), float(welch_satterthwaite([np.trace(C) for C in covariances], each))


def complex_row(name: str, number: ComplexEstimate) -> dict[str, float]:
    """The number as columns of a table: `name_re`, `name_im`, their covariance and its degrees of freedom."""
    C = number.covariance
    values = (number.value.real, number.value.imag, C[0, 0], C[0, 1], C[1, 1], number.degrees_of_freedom)
    return {f"{name}_{part}": float(value) for part, value in zip(COMPLEX_PARTS, values, strict=True)}


def complex_from_row(name: str, row: Mapping[str, float]) -> ComplexEstimate:
    """The number that `complex_row` wrote into a row of a table."""
    re, im, var_re, cov, var_im, degrees_of_freedom = (row[f"{name}_{part}"] for part in COMPLEX_PARTS)
    return ComplexEstimate(complex(re, im), np.array([[var_re, cov], [cov, var_im]]), degrees_of_freedom)


def polar_row(number: ComplexEstimate) -> dict[str, float]:
    """Magnitude and phase [deg] with standard errors and 95 % intervals (Student), to first order."""
    magnitude, phase = number.magnitude, float(np.rad2deg(number.phase))
    magnitude_se, phase_se = number.magnitude_se, float(np.rad2deg(number.phase_se))
    return {
        "magnitude": magnitude,
        "magnitude_se": magnitude_se,
        "magnitude_low": magnitude - number.quantile * magnitude_se,
        "magnitude_high": magnitude + number.quantile * magnitude_se,
        "phase_deg": phase,
        "phase_se_deg": phase_se,
        "phase_low_deg": phase - number.quantile * phase_se,
        "phase_high_deg": phase + number.quantile * phase_se,
    }


HIGHEST_HARMONIC = 5  # highest harmonic that is fitted. Harmonics 3 and 5, which friction makes, are among them.


@dataclass(frozen=True)
class Phasor(ComplexEstimate):
    """Complex amplitude P of a sine: signal = Re(P exp(j w t)) + offset + harmonics, in the unit of the signal."""

    distortion: float  # root sum of squares of harmonics 2 to 5, divided by the fundamental
    harmonics: NDArray[np.complex128]
    """Complex amplitudes of the fundamental and of harmonics 2 to 5, shape (5,): harmonic k is Re(H exp(j k w t))."""
    interval_method: str  # source of the covariance, as in `LinearFit`

    @property
    def amplitudes(self) -> Array:
        """Amplitudes of the fundamental and of harmonics 2 to 5, shape (5,)."""
        return np.abs(self.harmonics)


CycleEdges = tuple[Array, Array]  # where each cycle begins and where it ends (m,), in rows, which need not be whole


def fit_sinusoid(time: Array, signal: Array, frequency_hz: float, cycles: CycleEdges | None = None) -> Phasor:
    """Phasor of a settled signal (n,) at a known frequency, with offset and harmonics 2 to 5.

    `time` [s] sets the zero of the phase: fit angle and torque with the same times. The spread of the `cycles` gives
    the covariance, and only their rows are fitted; None: all rows, divided into cycles from the first one on. Of fewer
    than five cycles the covariance is that of the residual's autocorrelation.

    Raises InputError: less than one cycle, steps too long for the highest harmonic, or no sine of this frequency.
    """
    check_finite("time", time)
    step = float(np.median(np.diff(time))) if len(time) > 1 else np.inf
    if len(time) * step < 0.99 / frequency_hz:
        raise InputError(
            f"the signal has less than one cycle at {frequency_hz:g} Hz; record more cycles, or lower `settle_cycles` "
            "in the configuration"
        )
    if 2 * HIGHEST_HARMONIC * frequency_hz * step >= 1:
        raise InputError(
            f"a step of {step * 1e3:.2f} ms is too long for harmonic {HIGHEST_HARMONIC} of {frequency_hz:g} Hz; sample "
            "faster"
        )
    once, columns = np.exp(2j * np.pi * frequency_hz * time), {"offset": np.ones(len(time))}
    turned = once
    for k in range(1, HIGHEST_HARMONIC + 1):
        columns |= {f"cos{k}": turned.real, f"sin{k}": turned.imag}
        turned = turned * once
    inside = np.full(len(time), cycles is None)
    if cycles is None:
        edges = np.arange(round(len(time) * step * frequency_hz) + 1) / (step * frequency_hz)
        cycles = edges[:-1], np.minimum(edges[1:], len(time))
    for first, stop in zip(*cycles, strict=True):
        inside[whole_rows(first, stop)] = True
    found = regressors({name: column[inside] for name, column in columns.items()}, (int(np.count_nonzero(inside)),))
    estimates = found.solved(signal[inside])
    X = np.array(list(columns.values())).T
    residual = signal - X @ estimates
    if len(cycles[0]) < FEWEST_CYCLES:
        covariance, freedom, method = NO_REPEATS.covariance(found.X, found.inverse, residual[inside])
    else:
        scores = products_between(X, residual[:, None], *cycles)[..., 0] @ found.inverse
        covariance, freedom = between_cycles(scores, np.zeros(len(scores), dtype=np.intp))
        method = CYCLES
    harmonics = estimates[1::2] - 1j * estimates[2::2]  # a cos(wt) + b sin(wt) = Re((a - j b) exp(j w t))
    size = np.abs(harmonics)
    if size[0] <= 1e-12 * np.abs(signal).max():  # the fit's rounding error
        raise InputError(
            f"the signal has no sine of {frequency_hz:g} Hz, it stays at {signal[0]:g}; check its channel in "
            "the source file, or exclude the trial"
        )
    to_phasor = np.array([[1.0, -1.0], [-1.0, 1.0]])
    own = to_phasor * covariance[1:3, 1:3], float(np.min(freedom[1:3]))
    return Phasor(complex(harmonics[0]), *own, float(np.linalg.norm(size[1:]) / size[0]), harmonics, method)


RESPONSE_KEYS = ("trial", "joint", "side", "controller", "K_d", "B_d", "frequency_hz")
"""Columns of the phasor table whose rows differ in the amplitude only."""


@dataclass(frozen=True)
class SegmentPhasors:
    """Phasors of raw angle and torque in one segment."""

    amplitude_deg: float  # measured amplitude [deg] by which the fits to this and the other frequencies are named
    frequency_hz: float  # frequency [Hz]
    theta: Phasor  # of the joint angle [rad]
    torque: Phasor  # of the resisting torque [N*m]
    compliance_error: float = 0.0
    """Standard error [rad/(N*m)] of the bench's compliance, whose yielding was taken off the angle."""
    commanded_deg: float | None = None  # amplitude of the protocol that it follows [deg]

    @property
    def admittance(self) -> ComplexEstimate:
        """Integral admittance Y = theta/torque [rad/(N*m)]. An error of the bench's compliance c changes the angle by
        -c torque, and Y by -c."""
        return with_known_error(complex_quotient(self.theta, self.torque), self.compliance_error)


def phasors_of_record(record: Record) -> list[SegmentPhasors]:
    """Phasors of the settled cycles of every segment of a stepped sine, amplitude by amplitude; none of another motion.
    The last cycle is not used. If the angle lags the command by more at one frequency than at another, this cycle
    contains the beginning of the next frequency."""
    if not record.is_stepped_sine:
        return []
    order = sorted(
        range(len(record.groups.strata)), key=lambda k: record.groups.labels.index(record.groups.strata[k].label)
    )
    try:
        return [phasors_of(record, k) for k in order]
    except InputError as error:
        raise InputError(f"trial {record.name}, {error}") from error


def phasors_of(record: Record, k: int) -> SegmentPhasors:
    """Phasors of one stratum of a record."""
    groups, one = record.groups, record.groups.strata[k]
    assert isinstance(one.label, float)
    first, stop = groups.first[groups.stratum == k], groups.stop[groups.stratum == k]
    rows = whole_rows(first.min(), stop.max())
    time, cycles = record.time[rows], (first - rows.start, stop - rows.start)

    def phasor(name: str, signal: Array) -> Phasor:
        try:
            return fit_sinusoid(time, signal[rows], one.frequency_hz, cycles)
        except InputError as error:
            raise InputError(f"{name} from {time[0]:.1f} s: {error}") from error

    theta, torque = phasor("theta", record.theta), phasor("torque", record.torque)
    compliance_error = record.bench.compliance_error if record.bench else 0.0
    commanded_deg = None if one.commanded is None else round(float(np.rad2deg(one.commanded)), 9)
    return SegmentPhasors(one.label, one.frequency_hz, theta, torque, compliance_error, commanded_deg)


def at_amplitude(phasors: Sequence[SegmentPhasors], label: Label) -> list[SegmentPhasors]:
    """The segments of one amplitude [deg], or all (None)."""
    return [s for s in phasors if not isinstance(label, float) or isclose(s.amplitude_deg, label, rel_tol=1e-5)]


def phasor_table(trial: str, phasors: Sequence[SegmentPhasors]) -> pl.DataFrame:
    """A row per amplitude and frequency: phasors of angle [rad] and torque [N*m] and Y [rad/(N*m)] with covariances and
    degrees of freedom, distortions, magnitude and phase of Y."""
    rows = list[Row]()
    for segment in phasors:
        admittance = segment.admittance
        rows.append(
            {
                "trial": trial,
                "amplitude_deg": segment.amplitude_deg,
                "frequency_hz": segment.frequency_hz,
                **complex_row("theta", segment.theta),
                **complex_row("torque", segment.torque),
                "theta_distortion": segment.theta.distortion,
                "torque_distortion": segment.torque.distortion,
                **complex_row("Y", admittance),
                **{f"Y_{name}": value for name, value in polar_row(admittance).items()},
                "Y_se_bench": segment.compliance_error,
                "interval_method": max(segment.theta.interval_method, segment.torque.interval_method, key=len),
                "commanded_deg": segment.commanded_deg,
            }
        )
    return pl.DataFrame(rows, schema_overrides={"commanded_deg": pl.Float64})


def no_phasors() -> pl.DataFrame:
    """The columns of `phasor_table` without a row, for a trial that no sine moved."""
    return example_phasors().clear()


def example_phasors() -> pl.DataFrame:
    """One row of `phasor_table`, of a sine that stands for no trial; only its columns count."""
    time = np.arange(200) / 200
    sine = fit_sinusoid(time, np.sin(2 * np.pi * 10 * time), 10.0)
    return phasor_table("", [SegmentPhasors(1.0, 10.0, sine, sine)])


def frequency_response_table(phasors: pl.DataFrame) -> pl.DataFrame:
    """Complex mean of Y over the amplitudes, a row per trial and frequency, from the gathered phasor tables."""
    keys = [key for key in RESPONSE_KEYS if key in phasors.columns]
    groups = phasors.group_by(keys, maintain_order=True)
    rows = [{**dict(zip(keys, values, strict=True)), **mean_response_row(group)} for values, group in groups]
    if not rows:  # its columns
        numbers = ("K_d", "B_d", "frequency_hz")
        named = {name: pl.lit(None, pl.Float64 if name in numbers else pl.String) for name in RESPONSE_KEYS}
        row = pl.DataFrame([mean_response_row(example_phasors().with_columns(doubtful=pl.lit("")))])
        return row.select(**named).hstack(row).clear()
    return pl.DataFrame(rows, schema_overrides={key: phasors.schema[key] for key in keys}, infer_schema_length=None)


def mean_response_row(amplitudes: pl.DataFrame) -> Row:
    """Mean of Y over amplitudes at one frequency: magnitude [rad/(N*m)] and phase [deg] with 95 % intervals.

    The intervals contain the noise of the phasors only. `_min` and `_max` are the values of the single amplitudes.
    Their phases are computed relative to that of the mean, so that they do not jump at 180 degrees. `doubtful` lists
    the reasons of doubtful phasors with their amplitudes.
    """
    rows = list(amplitudes.iter_rows(named=True))
    shared = max(float(row["Y_se_bench"]) for row in rows)
    responses = [complex_from_row("Y", row | {"Y_var_re": row["Y_var_re"] - shared**2}) for row in rows]
    mean = with_known_error(complex_mean(responses), shared)  # all amplitudes share the error of the bench
    phases = [np.rad2deg(mean.phase + np.angle(r.value / mean.value)) for r in responses]
    reasons = amplitudes.select("amplitude_deg", "doubtful").drop_nulls().filter(pl.col("doubtful") != "").rows()
    return {
        **polar_row(mean),
        **complex_row("Y", mean),
        "interval_method": " and ".join(amplitudes["interval_method"].unique().sort()),
        "magnitude_min": min(r.magnitude for r in responses),
        "magnitude_max": max(r.magnitude for r in responses),
        "phase_min_deg": float(min(phases)),
        "phase_max_deg": float(max(phases)),
        "n_amplitudes": len(responses),
        "doubtful": "; ".join(f"at {amplitude:g} deg: {reason}" for amplitude, reason in reasons),
    }


def harmonic_shares(phasors: Sequence[SegmentPhasors], linear: tuple[float, float, float]) -> tuple[float, float]:
    """Even and odd harmonics of the torque beyond those of a linear joint (K, B, I), as shares of the fundamental.

    The angle's own harmonics make some of the torque's: these are taken off first. Even harmonics, 2 and 4, count as
    far as all segments have the same: asymmetry. A symmetric joint that chatters has some, at any phase. Odd ones, 3
    and 5, are those of friction, play, or a spring that stiffens.
    """
    K, B, I = linear
    own = []
    for one in phasors:
        k = np.arange(1, one.torque.harmonics.size + 1)
        s = 2j * np.pi * one.frequency_hz * k
        left = one.torque.harmonics - (K + B * s + I * s**2) * one.theta.harmonics
        own.append(left * np.exp(-1j * k * one.theta.phase))
    size, left = np.array([abs(one.torque.value) for one in phasors]), np.array(own)
    even = (left / size[:, None])[:, [1, 3]].mean(axis=0)
    return float(np.linalg.norm(even)), float(np.linalg.norm(left[:, [2, 4]]) / np.linalg.norm(size))
