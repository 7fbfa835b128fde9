"""Frequency response of a joint to a stepped sine or any other motion (`response.csv`, Fig. 7).

A piece is a settled cycle of a sine, or a window of another motion. At each frequency

    Z = sum(conj(theta) torque) / sum(abs(theta)^2),   Y = 1/Z

over the complex amplitudes of the pieces. Leaving out one unit at a time gives the error of Y.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import polars as pl
import scipy
from numpy.typing import NDArray

from osl_analysis.bench.analysis import Analysis
from osl_analysis.bench.record import Label, Record
from osl_analysis.dictionary import table_of
from osl_analysis.errors import InputError
from osl_analysis.stats.covariance import products_between, welch_satterthwaite
from osl_analysis.stats.table_rows import Row
from osl_analysis.trial import Array

Spectrum = NDArray[np.complex128]

HIGHEST_HARMONIC = 5
"""Friction makes odd harmonics, which fall as 1/k or faster; asymmetry makes even ones."""
SMALLEST_SINE = 1e-12  # of the signal: a smaller sine is rounding
LEAST_FREEDOM = 0.9  # of an interval: two cycles have one degree
WINDOW_S = 4.0  # s; of a motion that is no stepped sine
DISTINCT_LINES = 2  # lines of a Hann window, of which each depends on its neighbours
LEAST_POWER = 1e-4  # of the angle's strongest line


@dataclass(frozen=True)
class Response:
    """Integral admittance Y = theta/torque [rad/(N*m)] at one frequency.

    Attributes
    ----------
    frequency_hz : float
    Y : complex
    deviations : Array (u,)
        Complex errors of Y, whose sum of squares along any direction is the variance along it.
    freedom : float
        Degrees of freedom of that variance.
    distortion : Array (2,)
        Harmonics 2 to 5 of angle and torque over the fundamental; NaN but of one sine.
    """

    frequency_hz: float
    Y: complex
    deviations: Spectrum
    freedom: float
    distortion: Array = field(default_factory=lambda: np.full(2, np.nan))

    def to_row(self, record: Record) -> Row:
        """Magnitude, phase and damping with 95 % intervals (Student), to first order.

        The intervals include what is stated of the bench, which all amplitudes share. The damping
        is the real part of the impedance torque/velocity, Im(1/Y)/w.
        """
        gain, phase = record.calibration.polar(self.frequency_hz)
        compliance = record.bench.compliance_error if record.bench else 0.0
        deviations = np.append(self.deviations, [compliance, gain * self.Y, 1j * phase * self.Y])
        own, total = np.linalg.norm(self.deviations), np.linalg.norm(deviations)
        freedom = self.freedom * (total / own) ** 4 if own else np.inf
        quantile = scipy.special.stdtrit(freedom, 0.975)

        relative = deviations / self.Y
        w = 2 * np.pi * self.frequency_hz
        values = {
            "magnitude": (abs(self.Y), abs(self.Y) * relative.real),
            "phase_deg": (np.rad2deg(np.angle(self.Y)), np.rad2deg(relative.imag)),
            "damping": ((1 / self.Y).imag / w, (relative / self.Y).imag / w),
        }
        row: Row = {"frequency_hz": self.frequency_hz}
        for name, (value, errors) in values.items():
            half_width = quantile * np.linalg.norm(errors)
            row[name] = float(value)
            row[f"{name}_low"] = float(value - half_width)
            row[f"{name}_high"] = float(value + half_width)
        row["theta_distortion"], row["torque_distortion"] = self.distortion.tolist()
        return row


def response_table(analysis: Analysis) -> pl.DataFrame:
    """The trial's rows of `response.csv`.

    Of a stepped sine a row per amplitude and frequency, and one of the mean of Y over the
    amplitudes. Of any other motion a row per line that moves the joint.

    Parameters
    ----------
    analysis : Analysis
        Eq. 15 of a recording of the bench.

    Raises
    ------
    InputError
        The signal of a sine has none; the message names the trial.
    """
    record = analysis.record
    method = "cycles"
    if record.is_stepped_sine:
        responses = responses_to_sines(record)
    else:
        method = "windows"
        responses = {None: list(responses_of_windows(analysis))}
    rows = []
    for label, of_label in responses.items():
        for response in of_label:
            rows.append(
                {
                    **analysis.place(label),
                    **response.to_row(record),
                    "interval_method": method,
                }
            )
    return table_of(rows, "response").fill_nan(None)


def responses_to_sines(record: Record) -> Mapping[Label, Sequence[Response]]:
    """The responses of each amplitude, and their mean over the amplitudes (None)."""
    groups = record.groups
    responses: dict[Label, list[Response]] = {label: [] for label in groups.labels}
    at_frequency: dict[float, list[Response]] = {}
    for number, stratum in enumerate(groups.strata):
        response = response_to_sine(record, number)
        responses[stratum.label].append(response)
        at_frequency.setdefault(stratum.frequency_hz, []).append(response)
    responses[None] = [mean_response(alike) for alike in at_frequency.values()]
    return responses


def response_to_sine(record: Record, stratum: int) -> Response:
    """The response to the sine of one frequency and amplitude, by its settled cycles."""
    groups = record.groups
    frequency_hz = groups.strata[stratum].frequency_hz
    first, stop = (edges[groups.stratum == stratum] for edges in (groups.first, groups.stop))
    rows = slice(int(first.min()), int(np.ceil(stop.max())))
    harmonics = np.arange(1, HIGHEST_HARMONIC + 1)
    turns = np.exp(-2j * np.pi * frequency_hz * np.outer(record.time[rows], harmonics))
    signals = np.column_stack([record.theta[rows], record.torque[rows]])
    sums = products_between(
        np.hstack([turns.real, turns.imag]), signals, first - rows.start, stop - rows.start
    )
    complex_sums = sums[:, :HIGHEST_HARMONIC] + 1j * sums[:, HIGHEST_HARMONIC:]
    amplitudes = 2 * complex_sums / (stop - first)[:, None, None]  # cycles, harmonics, signals

    sizes = np.abs(amplitudes.mean(axis=0))
    for name, size, signal in zip(("theta", "torque"), sizes[0], signals.T, strict=True):
        if size <= SMALLEST_SINE * np.abs(signal).max():
            raise InputError(
                f"trial {record.name}: {name} has no sine of {frequency_hz:g} Hz, it stays at"
                f" {signal[0]:g}; check its channel in the source file, or exclude the trial"
            )
    distortion = np.linalg.norm(sizes[1:], axis=0) / sizes[0]
    theta, torque = amplitudes[:, 0].T
    response = response_of_pieces(frequency_hz, theta, torque, np.arange(len(first)))
    return replace(response, distortion=distortion)


def response_of_pieces(
    frequency_hz: float,
    theta: Spectrum,
    torque: Spectrum,
    unit: NDArray[np.intp],
) -> Response:
    """The response at one frequency by the amplitudes of k pieces, (k,), which belong to units.

    Units that move the joint more count for more, so that their number is their effective one.
    """
    belongs = unit == np.unique(unit)[:, None]
    power = belongs @ np.abs(theta) ** 2
    cross = belongs @ (theta.conj() * torque)
    Y = power.sum() / cross.sum()
    freedom = power.sum() ** 2 / np.sum(power**2) - 1
    deviations = np.array([np.nan + 0j])
    if freedom > LEAST_FREEDOM:
        without_unit = (power.sum() - power) / (cross.sum() - cross)
        u = len(power)
        deviations = (without_unit - without_unit.mean()) * np.sqrt((u - 1) / u)
    return Response(frequency_hz, complex(Y), deviations, float(freedom))


def mean_response(responses: Sequence[Response]) -> Response:
    """The mean of Y over amplitudes, whose errors are independent.

    It has no interval where the error of one of them is unknown.
    """
    deviations = [response.deviations for response in responses]
    variances = [float(np.sum(np.abs(errors) ** 2)) for errors in deviations]
    freedom = float("nan")
    if np.isfinite(variances).all():
        freedoms = [response.freedom for response in responses]
        freedom = float(welch_satterthwaite(variances, freedoms))
    return Response(
        responses[0].frequency_hz,
        complex(np.mean([response.Y for response in responses])),
        np.asarray(np.concatenate(deviations) / len(responses), dtype=np.complex128),
        float(freedom),
    )


def responses_of_windows(analysis: Analysis) -> Iterator[Response]:
    """The responses of a motion that is no stepped sine, at every other line of Hann windows.

    The torque's amplitude in a window is that of Eq. 15 plus the window's of what Eq. 15 leaves:
    the window would mix neighbouring frequencies, between which Z changes (2 % at 6 Hz), and what
    is left hardly changes.
    """
    record, fit = analysis.record, analysis.whole
    starts, unit, n = windows_of(record)
    if not len(starts):
        return
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(n) / n)

    def lines(signal: Array) -> Spectrum:
        pieces = np.lib.stride_tricks.sliding_window_view(signal, n)[starts]
        return np.asarray(np.fft.rfft(window * (pieces - pieces.mean(axis=1, keepdims=True))))

    frequency_hz = np.fft.rfftfreq(n, 1 / record.rate_hz)
    s = 2j * np.pi * frequency_hz
    theta = lines(record.motion.theta)
    by_fit = fit["K"] + fit["B"] * s + fit["I"] * s**2
    torque = by_fit * theta + lines(record.filtered_torque - analysis.modelled())
    power = np.mean(np.abs(theta) ** 2, axis=0)
    highest_hz = min(record.band_hz[1], record.low_pass.cutoff_hz)
    for k in range(DISTINCT_LINES, len(frequency_hz), DISTINCT_LINES):
        if frequency_hz[k] <= highest_hz and power[k] > LEAST_POWER * power.max():
            hz = float(frequency_hz[k])
            yield response_of_pieces(hz, theta[:, k], torque[:, k], unit)


def windows_of(record: Record) -> tuple[NDArray[np.intp], NDArray[np.intp], int]:
    """First rows (k,), units (k,) and length [rows] of windows that overlap by half.

    Every window is a unit, but in a periodic motion the same half of each period is one: its
    distortion by friction repeats, in an odd motion with the other sign. So few realisations have
    wide intervals, and one of a period of 4 s has none.
    """
    periodic = record.periodic
    if periodic is None:
        n = round(WINDOW_S * record.rate_hz)
        pieces = [np.arange(rows.start, rows.stop - n + 1, n // 2) for rows in record.pieces]
        starts = np.concatenate(pieces)
        return starts, np.arange(len(starts)), n

    per_period = max(round(periodic.period / WINDOW_S), 1)
    window_s = periodic.period / per_period
    n = round(window_s * record.rate_hz)
    all_starts, units = [], []
    for number, realisation in enumerate(periodic.realisations):
        half_windows = np.arange(2 * per_period * realisation.periods - 1)
        begins_s = realisation.start + half_windows * window_s / 2
        all_starts.append(np.rint(begins_s * record.rate_hz).astype(np.intp))
        units.append(number * per_period + half_windows % per_period)
    starts = np.minimum(np.concatenate(all_starts), len(record.time) - n)
    return starts, np.concatenate(units), n
