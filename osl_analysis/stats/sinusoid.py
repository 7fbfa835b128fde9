"""Fit of a sine of known frequency with its harmonics: the phasor, its covariance and the distortion."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.measured import check_finite
from osl_analysis.stats.complex_estimate import ComplexEstimate
from osl_analysis.stats.covariance import FEWEST_CYCLES, RepeatedError, ResidualCorrelation
from osl_analysis.stats.cycle_sums import Cycles
from osl_analysis.stats.regression import Regressors, regressors
from osl_analysis.trial import Array

HARMONICS = 5
"""Highest harmonic that is fitted. Harmonics 3 and 5, which friction makes, are among them."""
EVEN = 1e-9
"""Phase [rad] that steps between even times may lose over a table of `phase_factors`; rounding loses less by far."""
NO_SINE = 1e-12
"""Smallest amplitude that counts as a sine, as a share of the largest reading. Below it is the fit's rounding error."""


@dataclass(frozen=True)
class Phasor(ComplexEstimate):
    """Complex amplitude P of a sine: signal = Re(P exp(j w t)) + offset + harmonics, in the unit of the signal."""

    distortion: float
    """Root sum of squares of harmonics 2 to 5, divided by the fundamental."""
    harmonics: NDArray[np.complex128]
    """Complex amplitudes of the fundamental and of harmonics 2 to 5, shape (5,): harmonic k is Re(H exp(j k w t))."""
    interval_method: str
    """Source of the covariance, as in `LinearFit`."""

    @property
    def amplitudes(self) -> Array:
        """Amplitudes of the fundamental and of harmonics 2 to 5, shape (5,)."""
        return np.abs(self.harmonics)


def fit_sinusoid(
    time: Array,
    signal: Array,
    frequency_hz: float,
    cycles: Cycles | None = None,
    repeated: Sequence[RepeatedError] = (),
) -> Phasor:
    """Phasor of a settled signal (n,) at a known frequency, with offset and harmonics 2 to 5.

    `time` [s] sets the zero of the phase: fit angle and torque with the same times. `cycles` are the signal's cycles,
    whose spread gives the covariance; None: it is divided from its first sample on. `repeated` are the signal's errors
    that every cycle repeats, to which that spread is blind.

    Raises
    ------
    InputError
        The signal lasts less than one cycle, is sampled too slowly for the fifth harmonic, or is constant. A time or
        value is not finite or cannot be measured.
    """
    return sinusoid(time, frequency_hz, cycles).phasor(signal, repeated)


@dataclass(frozen=True)
class Sinusoid:
    """A sine of known frequency with its harmonics at some times, which several signals are fitted with."""

    frequency_hz: float
    """Frequency [Hz]."""
    begin: float
    """The first of the times [s]."""
    columns: Regressors
    """Offset, and cosine and sine of every harmonic."""
    cycles: Cycles | None
    """The cycles whose spread gives the covariance; None: too few."""

    def phasor(self, signal: Array, repeated: Sequence[RepeatedError] = ()) -> Phasor:
        """Phasor of a signal (n,); `repeated` and what is raised as in `fit_sinusoid`."""
        X, inverse, estimates = self.columns.X, self.columns.inverse, self.columns.solved(signal)
        known = ResidualCorrelation(cycles=self.cycles, repeated=repeated)
        covariance, degrees_of_freedom, method = known.covariance(X, inverse, signal - X @ estimates)
        cosines, sines = estimates[1::2], estimates[2::2]
        amplitudes = np.hypot(cosines, sines)
        if amplitudes[0] <= NO_SINE * np.abs(signal).max():
            raise InputError(
                f"the signal has no sine of {self.frequency_hz:g} Hz, it stays at {signal[0]:g}; check its channel in "
                "the source file, or exclude the trial"
            )
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
    step = float(np.median(np.diff(time))) if len(time) > 1 else np.inf
    check_sampling(len(time), step, frequency_hz)
    cycles = cycles or whole_cycles(len(time), 1 / (step * frequency_hz))
    return Sinusoid(
        frequency_hz, float(time[0]), regressors(harmonic_columns(time, frequency_hz), np.shape(time)), cycles
    )


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


def harmonic_columns(time: Array, frequency_hz: float) -> dict[str, Array]:
    """Offset, then cosine and sine of the fundamental and of each harmonic, at times [s] (n,)."""
    columns = {"offset": np.ones_like(time)}
    for k in range(1, HARMONICS + 1):
        wave = phase_factors(time, k * frequency_hz)
        columns |= {f"cos{k}": wave.real, f"sin{k}": wave.imag}
    return columns


def phase_factors(time: Array, frequency_hz: float) -> NDArray[np.complex128]:
    """exp(2j pi f t) at times [s] (n,); at even times it is the product of two short tables, a tenth of the work."""
    few = max(math.isqrt(len(time)), 1)
    turn = 2j * np.pi * frequency_hz
    if len(time) > 2 and np.ptp(np.diff(time)) * abs(turn) * few < EVEN:
        each = np.outer(np.exp(turn * time[::few]), np.exp(turn * (time[:few] - time[0])))
        return np.asarray(each.ravel()[: len(time)])
    return np.asarray(np.exp(turn * time))
