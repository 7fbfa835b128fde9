"""Sinusoid fits and the frequency response: phasors of angle and torque, their ratio, their mean (Fig. 7)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from osl_analysis.errors import InputError
from osl_analysis.stats.covariance import FEWEST_CYCLES, Cycles
from osl_analysis.stats.degrees_of_freedom import welch_satterthwaite
from osl_analysis.stats.regression import linear_fit
from osl_analysis.trial import Array

HARMONICS = 5
"""Highest harmonic in the distortion: friction's odd ones, 3 and 5, lie within."""
NO_SINE = 1e-12
"""Amplitude, as a part of the largest reading, that is no more than rounding."""


@dataclass(frozen=True)
class Uncertain:
    """A complex number, the covariance (2, 2) of (Re, Im), and the degrees of freedom that its variances are worth."""

    value: complex
    covariance: Array
    freedom: float

    @property
    def magnitude(self) -> float:
        return abs(self.value)

    @property
    def phase(self) -> float:
        """Phase [rad] between -pi and pi."""
        return float(np.angle(self.value))

    @property
    def magnitude_se(self) -> float:
        """Standard error along the phasor, in its unit."""
        return self._se_along(self.value / abs(self.value))

    @property
    def phase_se(self) -> float:
        """Standard error across the phasor as an angle [rad]."""
        return self._se_along(1j * self.value / abs(self.value)) / abs(self.value)

    @property
    def quantile(self) -> float:
        """Student's quantile: half the width of a 95 % interval in standard errors."""
        return float(stdtrit(self.freedom, 0.975))

    def _se_along(self, direction: complex) -> float:
        unit = np.array([direction.real, direction.imag])
        return float(np.sqrt(unit @ self.covariance @ unit))


@dataclass(frozen=True)
class Phasor(Uncertain):
    """Complex amplitude P of signal = Re(P exp(j w t)) + ..., and the distortion.

    `distortion` is the root sum of squares of harmonics 2 to 5 over the fundamental, whose amplitudes are `amplitudes`
    (5,), the fundamental's first. `interval_method` says where the covariance is from.
    """

    distortion: float
    vaf: float
    amplitudes: Array
    interval_method: str


class Response(Uncertain):
    """Integral admittance Y = theta/torque [rad/(N*m)] at one frequency."""


def fit_sinusoid(time: Array, signal: Array, frequency_hz: float) -> Phasor:
    """Phasor of a settled signal (n,) at a known frequency, with offset and harmonics 2 to 5.

    `time` [s] also sets the phase's zero: fit angle and torque with the same times.

    Raises
    ------
    InputError
        It is less than one whole cycle, the sampling is too slow for the fifth harmonic, or the signal is constant.
    """
    step = float(np.median(np.diff(time))) if len(time) > 1 else np.inf
    if len(time) * step < 0.99 / frequency_hz:
        raise InputError(f"less than one cycle at {frequency_hz:g} Hz; record more cycles or settle fewer")
    if 2 * HARMONICS * frequency_hz * step >= 1:
        raise InputError(
            f"a step of {step * 1e3:.2f} ms is too long for harmonic {HARMONICS} of {frequency_hz:g} Hz; sample faster"
        )
    cycles = whole_cycles(len(time), len(time) * step * frequency_hz)
    fit = linear_fit(signal, harmonic_columns(time, frequency_hz), cycles=cycles)
    cosines, sines = fit.estimates[1::2], fit.estimates[2::2]
    amplitudes = np.hypot(cosines, sines)
    if amplitudes[0] <= NO_SINE * np.abs(signal).max():
        raise InputError(
            f"there is no sine of {frequency_hz:g} Hz in it, it stays at {signal[0]:g}; check its channel in the "
            "source file, or exclude the trial"
        )
    to_phasor = np.diag([1.0, -1.0])
    return Phasor(
        complex(cosines[0], -sines[0]),
        to_phasor @ fit.covariance[1:3, 1:3] @ to_phasor,
        float(np.min(fit.degrees_of_freedom[1:3])),
        float(np.linalg.norm(amplitudes[1:]) / amplitudes[0]),
        fit.vaf,
        amplitudes,
        fit.interval_method,
    )


def whole_cycles(samples: int, cycles: float) -> Cycles | None:
    """Samples of one sine cut into cycles; None with fewer than five."""
    count = round(cycles)
    if count < FEWEST_CYCLES:
        return None
    first = np.rint(np.arange(count) * samples / cycles).astype(np.intp)
    return Cycles(first, np.zeros(count, dtype=np.intp))


def harmonic_columns(time: Array, frequency_hz: float) -> dict[str, Array]:
    """Offset, then cosine and sine of the fundamental and each harmonic."""
    columns = {"offset": np.ones_like(time)}
    for k in range(1, HARMONICS + 1):
        phase = 2 * np.pi * k * frequency_hz * time
        columns |= {f"cos{k}": np.cos(phase), f"sin{k}": np.sin(phase)}
    return columns


def response(theta: Phasor, torque: Phasor) -> Response:
    """Y = theta/torque [rad/(N*m)] from the phasors of angle [rad] and resisting torque [N*m].

    The covariance is propagated to first order, the errors of angle and torque taken as independent.
    """
    Y = theta.value / torque.value
    parts = [
        factor @ phasor.covariance @ factor.T
        for factor, phasor in ((as_matrix(1 / torque.value), theta), (as_matrix(-Y / torque.value), torque))
    ]
    return Response(Y, *summed(parts, [theta.freedom, torque.freedom]))


def as_matrix(z: complex) -> Array:
    """Multiplication by a complex number, as a matrix on (Re, Im)."""
    return np.array([[z.real, -z.imag], [z.imag, z.real]])


def mean_response(responses: Sequence[Uncertain]) -> Response:
    """Complex mean over amplitudes at one frequency; covariance from the fits' own, taken as independent."""
    parts = [r.covariance / len(responses) ** 2 for r in responses]
    return Response(complex(np.mean([r.value for r in responses])), *summed(parts, [r.freedom for r in responses]))


def summed(parts: Sequence[Array], freedoms: Sequence[float]) -> tuple[Array, float]:
    """Sum of independent covariances (2, 2), and its degrees of freedom, by their traces."""
    return np.sum(parts, axis=0), float(welch_satterthwaite([np.trace(part) for part in parts], freedoms))


def complex_row(name: str, number: Uncertain) -> dict[str, float]:
    """A complex number as columns of a table: `_re`, `_im`, their covariance, its degrees of freedom."""
    C = number.covariance
    values = (number.value.real, number.value.imag, C[0, 0], C[0, 1], C[1, 1], number.freedom)
    ends = ("re", "im", "var_re", "cov", "var_im", "freedom")
    return {f"{name}_{end}": float(value) for end, value in zip(ends, values, strict=True)}


def from_row(name: str, row: Mapping[str, float]) -> Uncertain:
    """The number that `complex_row` put into a row of a table."""
    re, im, var_re, cov, var_im, freedom = (
        row[f"{name}_{end}"] for end in ("re", "im", "var_re", "cov", "var_im", "freedom")
    )
    return Uncertain(complex(re, im), np.array([[var_re, cov], [cov, var_im]]), freedom)


def polar_row(number: Uncertain) -> dict[str, float]:
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
