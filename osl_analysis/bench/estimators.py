"""Estimators of Eq. 15 side by side: the same regression on other columns. Raw signals in, K, B, I, offset out."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import fftconvolve, savgol_filter

from osl_analysis.bench.protocol import Segment, cycles_of, rows_of
from osl_analysis.errors import InputError
from osl_analysis.second_order import impedance_columns
from osl_analysis.signals import LowPass, Motion, differentiate, filtered_motion
from osl_analysis.stats.regression import LinearFit, linear_fit
from osl_analysis.trial import Array

TEST_FUNCTION_POWER = 6
"""phi(s) = (1 - s^2)^6: five derivatives vanish at the window's ends, so that sums over samples are integrals."""
TEST_FUNCTION_CYCLES = 1.2
"""Half width of the test function in periods of the cut-off: its spectrum then falls to a half near the cut-off."""
SAVGOL_ORDER = 4
SAVGOL_CYCLES = 1.0
"""Width of the Savitzky-Golay window in periods of the cut-off."""
AR_ORDER = 8
"""Order of the autoregression that whitens the residual, at `AR_RATE` times the cut-off."""
AR_RATE = 4


@dataclass(frozen=True)
class Record:
    """Raw signals of one stepped-sine trial, shape (n,): time [s], theta, command [rad], torque [N*m].

    `command` is what the dynamometer was told, None where no log says; `segments` are what is fitted: settled.
    """

    time: Array
    theta: Array
    command: Array | None
    torque: Array
    rate_hz: float
    segments: Sequence[Segment]


@dataclass(frozen=True)
class Covariance:
    """How the covariance is taken: between cycles, or over `lags` samples (0: Andrews' bandwidth)."""

    cycles: bool = True
    lags: int = 0


Estimator = Callable[[Record, LowPass, Covariance], LinearFit]


def regress(
    record: Record,
    low_pass: LowPass,
    motion: Motion,
    torque: Array,
    covariance: Covariance,
    instruments: Motion | None = None,
) -> LinearFit:
    """Eq. 15 over the rows of the segments, of a motion and torque that passed the low-pass or its like."""
    rows = rows_of(record.segments)
    return linear_fit(
        torque[rows],
        impedance_columns(motion[rows]),
        cycles=cycles_of(record.segments) if covariance.cycles else None,
        instruments=None if instruments is None else impedance_columns(instruments[rows]),
        lags=covariance.lags or None,
        every=low_pass.independent_samples(record.rate_hz),
    )


def filtered(record: Record, low_pass: LowPass, covariance: Covariance) -> LinearFit:
    """One zero-phase filter for all signals, then derivatives, then least squares."""
    return regress(record, low_pass, *filtered_motion(record.time, record.theta, record.torque, low_pass), covariance)


def weak_form(record: Record, low_pass: LowPass, covariance: Covariance) -> LinearFit:
    """Modulating functions: Eq. 15 times phi, integrated by parts, so that no measured signal is differentiated.

    int phi tau = K int phi theta - B int phi' theta + I int phi'' theta + offset, for a window about every sample.
    """
    kernels = modulating_function(TEST_FUNCTION_CYCLES / low_pass.cutoff_hz, record.rate_hz)
    motion = Motion(*(fftconvolve(record.theta, kernel, mode="same") for kernel in kernels))
    return regress(record, low_pass, motion, fftconvolve(record.torque, kernels[0], mode="same"), covariance)


def modulating_function(half_width: float, rate_hz: float) -> tuple[Array, Array, Array]:
    """phi of unit integral over +-`half_width` [s], phi' and phi'', as kernels of a convolution at `rate_hz`.

    A convolution turns phi round, and with it the sign of phi': that is the minus of the integration by parts.
    """
    reach = int(np.ceil(half_width * rate_hz))
    s, p = np.linspace(-1, 1, 2 * reach + 1), TEST_FUNCTION_POWER
    h, rest = reach / rate_hz, 1 - s**2
    phi = rest**p
    first = -2 * p * s * rest ** (p - 1) / h
    second = (-2 * p * rest ** (p - 1) + 4 * p * (p - 1) * s**2 * rest ** (p - 2)) / h**2
    total = phi.sum()
    return phi / total, first / total, second / total


def savitzky_golay(record: Record, low_pass: LowPass, covariance: Covariance) -> LinearFit:
    """A quartic through a moving window, its value and derivatives; the torque through the same window.

    Raises
    ------
    InputError
        The window has fewer samples than a quartic has coefficients.
    """
    window = 2 * int(SAVGOL_CYCLES * record.rate_hz / low_pass.cutoff_hz / 2) + 1
    rate, least = record.rate_hz, SAVGOL_ORDER + 1
    if window < least:
        raise InputError(
            f"a period of cutoff_hz = {low_pass.cutoff_hz:g} Hz has {window} samples at {rate:g} Hz, the window of a "
            f"quartic needs {least}; lower dynamometer.cutoff_hz to {rate / SAVGOL_ORDER:g} Hz"
        )
    step = 1 / rate
    motion = Motion(*(savgol_filter(record.theta, window, SAVGOL_ORDER, deriv=d, delta=step) for d in range(3)))
    return regress(record, low_pass, motion, savgol_filter(record.torque, window, SAVGOL_ORDER), covariance)


def instrumental(record: Record, low_pass: LowPass, covariance: Covariance) -> LinearFit:
    """Filtered least squares with the commanded motion as instrument: it knows nothing of the encoder's noise."""
    if record.command is None:
        raise InputError("no commanded angle to be the instrument; map 'theta_command' in the source file")
    motion, torque = filtered_motion(record.time, record.theta, record.torque, low_pass)
    command = differentiate(record.time, low_pass(record.command, record.rate_hz))
    return regress(record, low_pass, motion, torque, covariance, command)


def whitened(record: Record, low_pass: LowPass, covariance: Covariance) -> LinearFit:
    """Generalised least squares: signals thinned out, then whitened by an autoregression of the first fit's residual.

    The autoregression (Cochrane and Orcutt, JASA 44, 1949) is fitted after thinning to four samples per period of the
    cut-off, where the filter leaves something to whiten in every band.
    """
    motion, torque = filtered_motion(record.time, record.theta, record.torque, low_pass)
    every = max(int(record.rate_hz / (AR_RATE * low_pass.cutoff_hz)), 1)
    pieces = [slice(segment.start, segment.stop, every) for segment in record.segments]
    first = regress(record, low_pass, motion, torque, covariance)
    residual = torque - sum(first[name] * column for name, column in impedance_columns(motion).items())
    ar = autoregression([residual[rows] for rows in pieces], AR_ORDER)
    signals = {"torque": torque, **impedance_columns(motion)}
    white = {
        name: np.concatenate([np.convolve(s[rows], ar, "valid") for rows in pieces]) for name, s in signals.items()
    }
    y = white.pop("torque")
    cycles = cycles_of(record.segments, every, AR_ORDER) if covariance.cycles else None
    return linear_fit(y, white, cycles=cycles, lags=covariance.lags or None)


def autoregression(pieces: Sequence[Array], order: int) -> Array:
    """Whitening filter (1, -a_1, ..., -a_order) of a signal given in pieces: least squares on its own past."""
    now = np.concatenate([piece[order:] for piece in pieces])
    past = {
        str(k): np.concatenate([piece[order - k : len(piece) - k] for piece in pieces]) for k in range(1, order + 1)
    }
    return np.concatenate([[1.0], -linear_fit(now, past, condition_limit=np.inf).estimates])


ESTIMATORS: Mapping[str, Estimator] = {
    "filtered": filtered,
    "weak form": weak_form,
    "Savitzky-Golay": savitzky_golay,
    "instrumental": instrumental,
    "whitened": whitened,
}
DEFAULT = "filtered"
"""The estimator of every table but `estimators.csv`: chosen by the study in docs/validation.md."""
