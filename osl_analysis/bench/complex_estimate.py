"""Complex numbers that are estimates: with a covariance, an interval, and columns of a table."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from osl_analysis.measured import check_finite
from osl_analysis.stats.covariance import welch_satterthwaite
from osl_analysis.trial import Array

POLAR = (
    *("magnitude", "magnitude_low", "magnitude_high"),
    *("phase_deg", "phase_deg_low", "phase_deg_high"),
)
"""Columns of magnitude and phase [deg] with 95 % intervals."""


@dataclass(frozen=True)
class ComplexEstimate:
    """An estimate of a complex number.

    Attributes
    ----------
    value : complex
        The number, in its unit.
    covariance : Array
        Covariance (2, 2) of real and imaginary part [unit squared].
    degrees_of_freedom : float
        Of these variances, for Student's quantile; infinite if they are known, or zero.

    Raises
    ------
    InputError
        The value or its standard error is not finite, or too large to be measured.
    """

    value: complex
    covariance: Array
    degrees_of_freedom: float

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
        """Standard error of the magnitude, in the unit of the number."""
        along_the_number = self.value / self.magnitude
        return self._se_along(along_the_number)

    @property
    def phase_se(self) -> float:
        """Standard error of the phase [rad]."""
        across_the_number = 1j * self.value / self.magnitude
        return self._se_along(across_the_number) / self.magnitude

    @property
    def quantile(self) -> float:
        """Half-width of the 95 % interval in standard errors (Student)."""
        return float(scipy.special.stdtrit(self.degrees_of_freedom, 0.975))

    def variance_along(self, gradient: Array) -> float:
        """Variance of a real function with this gradient (2,) by real and imaginary part."""
        # rounding of a singular covariance may make the form a little negative
        return max(float(gradient @ self.covariance @ gradient), 0.0)

    def _se_along(self, direction: complex) -> float:
        """Standard error of the part of the number along a direction of length 1."""
        return float(np.sqrt(self.variance_along(np.array([direction.real, direction.imag]))))


@dataclass(frozen=True)
class IndependentError:
    """One of the independent errors of a complex number."""

    covariance: Array  # (2, 2), of real and imaginary part
    degrees_of_freedom: float


def with_errors(value: complex, errors: Sequence[IndependentError]) -> ComplexEstimate:
    """Give a number the sum of independent errors.

    Their degrees of freedom are combined by the traces of their covariances (Welch, Satterthwaite).
    """
    traces = [np.trace(error.covariance) for error in errors]
    freedom = [error.degrees_of_freedom for error in errors]
    return ComplexEstimate(
        value,
        np.sum([error.covariance for error in errors], axis=0),
        float(welch_satterthwaite(traces, freedom)),
    )


def multiplication_matrix(factor: complex) -> Array:
    """The matrix (2, 2) that multiplies real and imaginary part by a complex factor."""
    return np.array([[factor.real, -factor.imag], [factor.imag, factor.real]])


def complex_quotient(numerator: ComplexEstimate, denominator: ComplexEstimate) -> ComplexEstimate:
    """Divide two estimates, with a covariance of first order.

    Notes
    -----
    q = a/b has dq = da/b - q db/b. The errors of a and b count as independent: of a phasor of the
    angle and one of the torque they are noise and rounding of two sensors. Where the motion itself
    varies from cycle to cycle both vary alike, most of it cancels in q, and the interval is too
    wide, never too narrow.
    """
    quotient = numerator.value / denominator.value
    by_numerator = multiplication_matrix(1 / denominator.value)
    by_denominator = multiplication_matrix(-quotient / denominator.value)
    errors = [
        IndependentError(matrix @ number.covariance @ matrix.T, number.degrees_of_freedom)
        for matrix, number in ((by_numerator, numerator), (by_denominator, denominator))
    ]
    return with_errors(quotient, errors)


def complex_mean(numbers: Sequence[ComplexEstimate]) -> ComplexEstimate:
    """Average estimates whose errors are independent."""
    errors = [
        IndependentError(number.covariance / len(numbers) ** 2, number.degrees_of_freedom)
        for number in numbers
    ]
    return with_errors(complex(np.mean([number.value for number in numbers])), errors)


@dataclass(frozen=True)
class BenchError:
    """Standard uncertainties of Y = theta/torque that all recordings of a bench share."""

    compliance: float = 0.0  # of the real part, due to the bench's stiffness [rad/(N*m)]
    gain: float = 0.0  # of the magnitude, relative
    phase: float = 0.0  # of the phase [rad]

    def covariance(self, Y: complex) -> Array:
        """Covariance (2, 2) of Y by these uncertainties."""
        along = np.array([Y.real, Y.imag])
        across = np.array([-Y.imag, Y.real])
        of_calibration = self.gain**2 * np.outer(along, along)
        of_calibration = of_calibration + self.phase**2 * np.outer(across, across)
        return np.asarray(np.diag([self.compliance**2, 0.0]) + of_calibration)

    def added_to(self, Y: ComplexEstimate) -> ComplexEstimate:
        """Y with these uncertainties beside its own. They are stated, so that they count as known:
        with infinite degrees of freedom."""
        own = IndependentError(Y.covariance, Y.degrees_of_freedom)
        shared = IndependentError(self.covariance(Y.value), np.inf)
        return with_errors(Y.value, [own, shared])

    def taken_off(self, Y: ComplexEstimate) -> ComplexEstimate:
        """Undo `added_to`: Y with its own errors and their degrees of freedom alone.

        Notes
        -----
        Beside an error of infinite degrees of freedom the sum has nu = own_nu (total/own)^2, by the
        traces (Welch, Satterthwaite), so that own_nu = nu (own/total)^2.
        """
        own = Y.covariance - self.covariance(Y.value)
        total_trace = float(np.trace(Y.covariance))
        own_trace = max(float(np.trace(own)), 0.0)
        freedom = Y.degrees_of_freedom
        if np.isfinite(freedom) and total_trace > 0:
            freedom = freedom * (own_trace / total_trace) ** 2
        return ComplexEstimate(Y.value, own, freedom)


NO_BENCH_ERROR = BenchError()


def complex_row(name: str, number: ComplexEstimate) -> dict[str, float]:
    """A number as columns `name_re`, `name_im`, their covariance and its degrees of freedom."""
    covariance = number.covariance
    return {
        f"{name}_re": float(number.value.real),
        f"{name}_im": float(number.value.imag),
        f"{name}_var_re": float(covariance[0, 0]),
        f"{name}_cov": float(covariance[0, 1]),
        f"{name}_var_im": float(covariance[1, 1]),
        f"{name}_degrees_of_freedom": float(number.degrees_of_freedom),
    }


def polar_row(number: ComplexEstimate) -> dict[str, float]:
    """The columns `POLAR` of a number: magnitude and phase with 95 % intervals, to first order."""
    size, size_half = number.magnitude, number.quantile * number.magnitude_se
    phase_deg = np.rad2deg(number.phase)
    phase_deg_half = number.quantile * np.rad2deg(number.phase_se)
    return {
        "magnitude": size,
        "magnitude_low": size - size_half,
        "magnitude_high": size + size_half,
        "phase_deg": float(phase_deg),
        "phase_deg_low": float(phase_deg - phase_deg_half),
        "phase_deg_high": float(phase_deg + phase_deg_half),
    }
