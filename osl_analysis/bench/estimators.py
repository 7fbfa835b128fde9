"""Estimators of Eq. 15 side by side: the same regression on other columns. Raw signals in, K, B, I and offset out."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl
from scipy.signal import fftconvolve, savgol_filter

from osl_analysis.bench.alternatives import widened
from osl_analysis.bench.moving_record import MovingRecord, softer_record
from osl_analysis.bench.segments import repeated_cycles, rows_of
from osl_analysis.bench.settled_signals import RawSignals
from osl_analysis.bench.stepped_sine import SteppedSineTrial
from osl_analysis.doubtful import EXCLUDED
from osl_analysis.errors import InputError, OslAnalysisError
from osl_analysis.second_order import impedance_columns
from osl_analysis.signals import LowPass, Motion, differentiate, filtered_motion
from osl_analysis.stats.covariance import ResidualCorrelation
from osl_analysis.stats.fit_row import Row, covariance_row, diagnostics_row, estimates_row
from osl_analysis.stats.regression import LinearFit, linear_fit
from osl_analysis.trial import Array

TEST_FUNCTION_POWER = 6
"""phi(s) = (1 - s^2)^6. Five derivatives are zero at the window's ends, so that sums over samples are integrals."""
TEST_FUNCTION_CYCLES = 1.2
"""Half width of the test function in periods of the cut-off. Its spectrum falls to a half near the cut-off."""
SAVGOL_ORDER = 4
"""Order of the moving polynomial."""
SAVGOL_CYCLES = 1.0
"""Width of the Savitzky-Golay window in periods of the cut-off."""
AR_ORDER = 8
"""Order of the autoregression that whitens the residual, at `AR_RATE` times the cut-off."""
AR_RATE = 4
"""Samples per period of the cut-off that the whitening estimator keeps."""


@dataclass(frozen=True)
class CovarianceChoice:
    """Source of the covariance of an estimator's estimates."""

    cycles: bool = True
    """Whether it comes from the spread between cycles, if there are enough; else from autocorrelation (`HAC`)."""
    lags: int = 0
    """Number of samples over which residuals may be correlated; 0: Andrews' bandwidth."""


Estimator = Callable[[RawSignals, LowPass, CovarianceChoice], LinearFit]


@dataclass(frozen=True)
class FilteredSignals:
    """Motion and torque that passed the low-pass filter or one like it, shape (n,) each."""

    motion: Motion
    """Joint angle and its derivatives."""
    torque: Array
    """Resisting torque [N*m]."""
    instruments: Motion | None = None
    """Motion whose columns are the instruments, if any."""


def fit_segments(raw: RawSignals, low_pass: LowPass, signals: FilteredSignals, choice: CovarianceChoice) -> LinearFit:
    """Eq. 15 over the rows of the segments; `raw` and `low_pass` are what the signals come from."""
    rows, instruments = rows_of(raw.segments), signals.instruments
    residuals = ResidualCorrelation(
        cycles=repeated_cycles(raw.segments) if choice.cycles else None,
        every=low_pass.independent_samples(raw.rate_hz),
        lags=choice.lags or None,
        filtered_off=raw.torque[rows] - signals.torque[rows],
        repeated=raw.repeated if choice.cycles else (),
    )
    return linear_fit(
        signals.torque[rows],
        impedance_columns(signals.motion[rows]),
        residuals,
        instruments=None if instruments is None else impedance_columns(instruments[rows]),
    )


def filtered_estimator(raw: RawSignals, low_pass: LowPass, choice: CovarianceChoice) -> LinearFit:
    """One zero-phase filter for all signals, then derivatives, then least squares."""
    signals = FilteredSignals(*filtered_motion(raw.time, raw.theta, raw.torque, low_pass))
    return fit_segments(raw, low_pass, signals, choice)


def weak_form_estimator(raw: RawSignals, low_pass: LowPass, choice: CovarianceChoice) -> LinearFit:
    """Modulating functions: Eq. 15 times phi, integrated by parts, so that no measured signal is differentiated.

    int phi tau = K int phi theta - B int phi' theta + I int phi'' theta + offset, for a window about every sample.
    """
    kernels = modulating_function(TEST_FUNCTION_CYCLES / low_pass.cutoff_hz, raw.rate_hz)
    motion = Motion(*(fftconvolve(raw.theta, kernel, mode="same") for kernel in kernels))
    signals = FilteredSignals(motion, fftconvolve(raw.torque, kernels[0], mode="same"))
    return fit_segments(raw, low_pass, signals, choice)


def modulating_function(half_width: float, rate_hz: float) -> tuple[Array, Array, Array]:
    """phi of unit integral over +-`half_width` [s], phi' and phi'', as kernels of a convolution at `rate_hz`.

    A convolution reverses phi, and with it the sign of phi'. This is the minus sign of the integration by parts.
    """
    reach = int(np.ceil(half_width * rate_hz))
    s, p = np.linspace(-1, 1, 2 * reach + 1), TEST_FUNCTION_POWER
    h, rest = reach / rate_hz, 1 - s**2
    phi = rest**p
    first = -2 * p * s * rest ** (p - 1) / h
    second = (-2 * p * rest ** (p - 1) + 4 * p * (p - 1) * s**2 * rest ** (p - 2)) / h**2
    total = phi.sum()
    return phi / total, first / total, second / total


def savitzky_golay_estimator(raw: RawSignals, low_pass: LowPass, choice: CovarianceChoice) -> LinearFit:
    """A quartic through a moving window, its value and derivatives; the torque through the same window.

    Raises
    ------
    InputError
        The window has fewer samples than a quartic has coefficients.
    """
    window = 2 * int(SAVGOL_CYCLES * raw.rate_hz / low_pass.cutoff_hz / 2) + 1
    rate, least = raw.rate_hz, SAVGOL_ORDER + 1
    if window < least:
        raise InputError(
            f"a period of cutoff_hz = {low_pass.cutoff_hz:g} Hz has {window} samples at {rate:g} Hz, the window of a "
            f"quartic needs {least}; lower dynamometer.cutoff_hz to {rate / SAVGOL_ORDER:g} Hz"
        )
    motion = Motion(*(savgol_filter(raw.theta, window, SAVGOL_ORDER, deriv=d, delta=1 / rate) for d in range(3)))
    signals = FilteredSignals(motion, savgol_filter(raw.torque, window, SAVGOL_ORDER))
    return fit_segments(raw, low_pass, signals, choice)


def instrumental_estimator(raw: RawSignals, low_pass: LowPass, choice: CovarianceChoice) -> LinearFit:
    """Filtered least squares with the commanded motion as instrument, which the encoder's noise does not reach."""
    if raw.command is None:
        raise InputError("no commanded angle to be the instrument; map 'theta_command' in the source file")
    motion, torque = filtered_motion(raw.time, raw.theta, raw.torque, low_pass)
    command = differentiate(raw.time, low_pass(raw.command, raw.rate_hz))
    return fit_segments(raw, low_pass, FilteredSignals(motion, torque, instruments=command), choice)


def whitened_estimator(raw: RawSignals, low_pass: LowPass, choice: CovarianceChoice) -> LinearFit:
    """Generalised least squares: signals are thinned, then whitened by an autoregression of the first fit's residual.

    The autoregression (Cochrane and Orcutt, JASA 44, 1949) is fitted after thinning to four samples per period of the
    cut-off. At that rate the filter leaves noise in every band that can be whitened.
    """
    motion, torque = filtered_motion(raw.time, raw.theta, raw.torque, low_pass)
    every = max(int(raw.rate_hz / (AR_RATE * low_pass.cutoff_hz)), 1)
    pieces = [slice(p.start, p.stop, every) for segment in raw.segments for p in segment.pieces]
    first = fit_segments(raw, low_pass, FilteredSignals(motion, torque), choice)
    residual = torque - first.predicted(impedance_columns(motion))
    ar = autoregression([residual[rows] for rows in pieces], AR_ORDER)
    signals = {"torque": torque, **impedance_columns(motion)}
    white = {
        name: np.concatenate([np.convolve(s[rows], ar, "valid") for rows in pieces]) for name, s in signals.items()
    }
    y = white.pop("torque")
    cycles = repeated_cycles(raw.segments, every, AR_ORDER) if choice.cycles else None
    return linear_fit(y, white, ResidualCorrelation(cycles, lags=choice.lags or None))


def autoregression(pieces: Sequence[Array], order: int) -> Array:
    """Whitening filter (1, -a_1, ..., -a_order) of a signal given in pieces, by least squares on its own past."""
    now = np.concatenate([piece[order:] for piece in pieces])
    past = {
        str(k): np.concatenate([piece[order - k : len(piece) - k] for piece in pieces]) for k in range(1, order + 1)
    }
    return np.concatenate([[1.0], -linear_fit(now, past, condition_limit=np.inf).estimates])


ESTIMATORS: Mapping[str, Estimator] = {
    "filtered": filtered_estimator,
    "weak form": weak_form_estimator,
    "Savitzky-Golay": savitzky_golay_estimator,
    "instrumental": instrumental_estimator,
    "whitened": whitened_estimator,
}
DEFAULT = "filtered"
"""The estimator of every table but `estimators.csv`; the Monte Carlo study led to this choice."""


def estimator_table(trial: SteppedSineTrial | MovingRecord) -> pl.DataFrame:
    """The trial's rows of `estimators.csv`: Eq. 15 over all amplitudes by every estimator that its signals allow.

    An estimator that refuses the trial has a row without numbers and with the reason. A moving polynomial does so if
    there are too few samples per period of the cut-off.
    """
    rows: list[Row] = []
    raw, softer = trial.raw, raw_of_softer(trial)
    for name, estimator in ESTIMATORS.items():
        if name == "instrumental" and raw.command is None:
            continue
        try:
            fit = estimator(raw, trial.low_pass, CovarianceChoice())
            if softer is not None:
                fit = widened(fit, estimator(softer, trial.low_pass, CovarianceChoice()))
        except OslAnalysisError as error:
            rows.append({"trial": trial.name, "estimator": name, EXCLUDED: str(error)})
            continue
        estimates = {**estimates_row(fit, "K", "B", "I"), **covariance_row(fit, "K", "B", "I")}
        rate = trial.rate_hz * fit.samples / len(rows_of(raw.segments))  # an estimator may have thinned them
        diagnostics = diagnostics_row(fit, rate, trial.low_pass)
        rows.append({"trial": trial.name, "estimator": name, **estimates, **diagnostics, EXCLUDED: None})
    return pl.DataFrame(rows, schema_overrides={EXCLUDED: pl.String}, infer_schema_length=None)


def raw_of_softer(trial: SteppedSineTrial | MovingRecord) -> RawSignals | None:
    """The raw signals on a bench that is softer by one standard error; None where it does not yield."""
    if isinstance(trial, MovingRecord):
        return None if trial.bench is None else softer_record(trial, trial.bench).raw
    return None if trial.softer is None else trial.softer.raw
