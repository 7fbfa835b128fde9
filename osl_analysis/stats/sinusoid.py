"""Complex estimates with their covariance, and the fit of a sine of known frequency with its harmonics."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from osl_analysis.errors import InputError
from osl_analysis.measured import SMALLEST_SIGNAL, check_finite, check_measured
from osl_analysis.stats.covariance import (
    CYCLES,
    FEWEST_CYCLES,
    Cycles,
    ResidualCorrelation,
    between_cycles,
    welch_satterthwaite,
)
from osl_analysis.stats.regression import Regressors, regressors_of
from osl_analysis.trial import Array

PARTS = ("re", "im", "var_re", "cov", "var_im", "degrees_of_freedom")
"""Endings of the columns that hold one complex estimate."""


@dataclass(frozen=True)
class ComplexEstimate:
    """A complex number that was estimated.

    Raises
    ------
    InputError
        Value or covariance is not finite or cannot be measured.
    """

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
    return {f"{name}_{part}": float(value) for part, value in zip(PARTS, values, strict=True)}


def complex_from_row(name: str, row: Mapping[str, float]) -> ComplexEstimate:
    """The number that `complex_row` wrote into a row of a table."""
    re, im, var_re, cov, var_im, degrees_of_freedom = (row[f"{name}_{part}"] for part in PARTS)
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


HARMONICS = 5  # highest harmonic that is fitted. Harmonics 3 and 5, which friction makes, are among them.
NAMES = ("offset", *(f"{wave}{k}" for k in range(1, HARMONICS + 1) for wave in ("cos", "sin")))
"""The columns of a sine with its harmonics."""
SOME = 1000  # times that say how fast a signal was sampled
NO_SINE = 1e-12
"""Smallest amplitude that counts as a sine, as a share of the largest reading. Below it is the fit's rounding error."""


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


def fit_sinusoid(
    time: Array,
    signal: Array,
    frequency_hz: float,
    cycles: Cycles | None = None,
) -> Phasor:
    """Phasor of a settled signal (n,) at a known frequency, with offset and harmonics 2 to 5.

    `time` [s] sets the zero of the phase: fit angle and torque with the same times. `cycles` are the signal's cycles,
    whose spread gives the covariance; None: it is divided from its first sample on.
    """
    return sinusoid(time, frequency_hz, cycles).phasors({"signal": signal})["signal"]


@dataclass(frozen=True)
class Sinusoid:
    """A sine of known frequency with its harmonics at some times, which several signals are fitted with."""

    frequency_hz: float  # frequency [Hz]
    begin: float  # the first of the times [s]
    columns: Regressors  # offset, and cosine and sine of every harmonic
    cycles: Cycles | None  # the cycles whose spread gives the covariance; None: too few

    def phasors(self, signals: Mapping[str, Array]) -> dict[str, Phasor]:
        """Phasors of signals (n,), by name; what is raised as in `fit_sinusoid`, with name and time."""
        for name, signal in signals.items():
            with self.named(name):
                check_measured("the signal", signal)
        y = np.array(list(signals.values()))
        estimates = self.columns.estimated(y.T).T
        spreads = self.spreads(y - estimates @ self.columns.X.T)
        found = {}
        for name, signal, own, spread in zip(signals, y, estimates, spreads, strict=True):
            with self.named(name):
                found[name] = self.phasor(signal, own, spread)
        return found

    @contextmanager
    def named(self, signal: str) -> Iterator[None]:
        """Within the block a refusal names a signal and its first time."""
        try:
            yield
        except InputError as error:
            raise InputError(f"{signal} from {self.begin:.1f} s: {error}") from error

    def spreads(self, residuals: Array) -> list[tuple[Array, Array, str]]:
        """Covariance, degrees of freedom and source of each residual (q, n), whose cycles are summed at once."""
        X, inverse = self.columns.X, self.columns.inverse
        if self.cycles is None:
            return [ResidualCorrelation().covariance(X, inverse, residual) for residual in residuals]
        sums = np.moveaxis(self.cycles.products(X, residuals.T), 2, 1) @ inverse
        covariance, freedom = between_cycles(sums.reshape(len(sums), -1), self.cycles.stratum)
        own = [slice(first, first + len(inverse)) for first in range(0, len(covariance), len(inverse))]
        return [(covariance[k, k], freedom[k], CYCLES) for k in own]

    def phasor(self, signal: Array, estimates: Array, spread: tuple[Array, Array, str]) -> Phasor:
        """The phasor by the estimates of a signal (n,), with what `spreads` gives for it; no sine is refused."""
        cosines, sines = estimates[1::2], estimates[2::2]
        amplitudes = np.hypot(cosines, sines)
        if amplitudes[0] <= NO_SINE * np.abs(signal).max():
            raise InputError(
                f"the signal has no sine of {self.frequency_hz:g} Hz, it stays at {signal[0]:g}; check its channel in "
                "the source file, or exclude the trial"
            )
        covariance, degrees_of_freedom, method = spread
        to_phasor = np.array([[1.0, -1.0], [-1.0, 1.0]])  # a cos(wt) + b sin(wt) = Re((a - j b) exp(j w t))
        return Phasor(
            complex(cosines[0], -sines[0]),
            to_phasor * covariance[1:3, 1:3],
            float(np.min(degrees_of_freedom[1:3])),
            float(np.linalg.norm(amplitudes[1:]) / amplitudes[0]),
            cosines - 1j * sines,
            method,
        )


def sinusoid(time: Array, frequency_hz: float, cycles: Cycles | None = None) -> Sinusoid:
    """The sine at times [s] (n,); `cycles` and what is raised as in `fit_sinusoid`."""
    check_finite("time", time)
    step = float(np.median(np.diff(time[:SOME]))) if len(time) > 1 else np.inf
    check_sampling(len(time), step, frequency_hz)
    cycles = cycles or whole_cycles(len(time), 1 / (step * frequency_hz))
    rows = np.concatenate([np.ones((1, len(time))), waves(time, frequency_hz, HARMONICS)])
    return Sinusoid(frequency_hz, float(time[0]), regressors_of(NAMES, rows.T), cycles)


def check_sampling(samples: int, step: float, frequency_hz: float) -> None:
    """Refuse less than one cycle, or a step [s] too long for the highest harmonic."""
    if samples * step < 0.99 / frequency_hz:
        raise InputError(
            f"the signal has less than one cycle at {frequency_hz:g} Hz; record more cycles, or lower `settle_cycles` "
            "in the configuration"
        )
    if 2 * HARMONICS * frequency_hz * step >= 1:
        raise InputError(
            f"a step of {step * 1e3:.2f} ms is too long for harmonic {HARMONICS} of {frequency_hz:g} Hz; sample faster"
        )


def whole_cycles(samples: int, period: float) -> Cycles | None:
    """The samples of one sine divided into cycles of `period` samples, whole or not; None with fewer than five."""
    count = round(samples / period)
    if count < FEWEST_CYCLES:
        return None
    edges = np.minimum(np.arange(count + 1) * period, samples)
    return Cycles(edges[:-1], edges[1:], np.zeros(count, dtype=np.intp))


def waves(time: Array, frequency_hz: float, harmonics: int = 1) -> Array:
    """cos(2 pi k f t) and sin(2 pi k f t) (2 harmonics, n) in turn for k from 1 on, at times [s] (n,)."""
    found, once = np.empty((harmonics, 2, len(time))), np.exp(2j * np.pi * frequency_hz * time)
    turned = np.ones_like(once)
    for pair in found:
        turned = turned * once
        pair[0], pair[1] = turned.real, turned.imag
    return found.reshape(2 * harmonics, -1)
