"""Complex estimates with their covariance: quotient, mean, and their columns in a result table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from scipy.special import stdtrit

from osl_analysis.errors import InputError
from osl_analysis.measured import SMALLEST, check_finite
from osl_analysis.stats.covariance import welch_satterthwaite
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
    covariance: Array
    """Covariance (2, 2) of real and imaginary part."""
    degrees_of_freedom: float
    """Degrees of freedom of its variances; infinite where these are 0."""

    def __post_init__(self) -> None:
        check_finite("the estimate", [self.value.real, self.value.imag])
        check_finite("the estimate's standard error", np.sqrt(np.abs(self.covariance)))

    @property
    def magnitude(self) -> float:
        """Absolute value, in the unit of the number."""
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
        if self.magnitude < SMALLEST:
            raise InputError(f"the number {self.value:.3g} has no phase; check the signals from which it was estimated")
        return self.magnitude

    def _se_along(self, direction: complex) -> float:
        unit = np.array([direction.real, direction.imag])
        return float(np.sqrt(max(float(unit @ self.covariance @ unit), 0.0)))


Estimate = TypeVar("Estimate", bound=ComplexEstimate)


def complex_quotient(numerator: ComplexEstimate, denominator: ComplexEstimate) -> ComplexEstimate:
    """numerator/denominator. The covariance is of first order; the two errors must be independent.

    Raises
    ------
    InputError
        The denominator is 0, or smaller than anything measured.
    """
    if denominator.magnitude < SMALLEST:
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
