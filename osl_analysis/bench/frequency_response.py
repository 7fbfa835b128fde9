# SPDX-License-Identifier: Apache-2.0
"""Frequency response of a joint to a stepped sine or any other motion (`response.csv`, Fig. 7).

A piece is a settled cycle of a sine, a period of a motion that repeats itself, or a window of any
other motion. At each frequency

    Z = sum(conj(theta) torque) / sum(abs(theta)^2),   Y = 1/Z

over the complex amplitudes of the pieces. Leaving out one unit at a time gives the error of Y.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl
import scipy
from numpy.typing import NDArray

from osl_analysis.base.trial import Array
from osl_analysis.bench.impedance import SAME_FREQUENCY_RATIO, Analysis
from osl_analysis.bench.record import Record
from osl_analysis.dictionary.described import table_of
from osl_analysis.model.drivetrain import Spectrum
from osl_analysis.signals.filters import runs
from osl_analysis.stats.budget import Budget, Contribution, Row, scatter, welch_satterthwaite
from osl_analysis.stats.linear_fit import products_between
from osl_analysis.stats.sources import Source

WINDOW_S = 4.0  # s; of a motion that is no stepped sine
DISTINCT_LINES = 2  # lines of a Hann window, of which each depends on its neighbours
# of neighbouring pairs of Hann windows that overlap by three quarters: the variance of a mean to
# that of independent pairs, by the squares of the window's correlation with itself
UNITS_ALIKE = 1.34
LEAST_POWER = 1e-4  # of the angle's strongest line
# of a spread over units, one of which may move the joint far more than the others. Below, an
# interval has more than 165 standard errors, and tells nothing (a chirp had 5.6e153 N*m/rad)
LEAST_FREEDOM = 0.5


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
    """

    frequency_hz: float
    Y: complex
    deviations: Spectrum
    freedom: float

    def to_row(self, record: Record) -> Row:
        """Magnitude, phase, stiffness and damping with 95 % intervals (Student), to first order.

        The intervals include what is stated of the bench, which all amplitudes share. Stiffness
        and damping at the frequency are K = Re Z and B = Im Z/w of Z = 1/Y: of a joint of second
        order K - I w^2 and B.
        """
        gain, phase = record.settings.calibration.polar(self.frequency_hz)
        bench = record.settings.bench_stiffness
        compliance = bench.compliance_error if bench else 0.0
        of_bench = np.array([compliance, gain * self.Y, 1j * phase * self.Y])
        errors = np.append(self.deviations, of_bench) / self.Y

        w = 2 * np.pi * self.frequency_hz
        size = abs(self.Y)
        row: Row = {"frequency_hz": self.frequency_hz}
        for name, value, changes in (
            ("magnitude", size, size * errors.real),
            ("phase_deg", np.rad2deg(np.angle(self.Y)), np.rad2deg(errors.imag)),
            ("stiffness", (1 / self.Y).real, (errors / self.Y).real),
            ("damping", (1 / self.Y).imag / w, (errors / self.Y).imag / w),
        ):
            own = float(np.linalg.norm(changes[: -len(of_bench)]))
            shared = float(np.linalg.norm(changes[-len(of_bench) :]))
            parts = (scatter(own, self.freedom), Contribution(Source.BENCH, shared, shared=True))
            row |= Budget(value, parts).columns(name)
        return row


def response_table(
    analysis: Analysis, at_hz: float | None = None, **condition: float | str | None
) -> pl.DataFrame:
    """The trial's rows of `response.csv`.

    Of a stepped sine a row per amplitude and frequency, and one of the mean of Y over the
    amplitudes. Of any other motion a row per line that moves the joint.

    Parameters
    ----------
    analysis : Analysis
        Eq. 15 of a recording of the bench.
    at_hz
        Frequency of which K and B are headline numbers; None: of none.
    **condition
        What the leg was asked to render, by column.
    """
    record = analysis.record
    rows = []
    if record.groups.kind == "cycles":
        at_frequency: dict[float, list[Response]] = {}
        for number, stratum in enumerate(record.groups.strata):
            response = response_to_sine(analysis, number)
            place = analysis.place(stratum.label)
            rows.append({**place, **response.to_row(record), **condition})
            at_frequency.setdefault(stratum.frequency_hz, []).append(response)
        of_all = [mean_response(responses) for responses in at_frequency.values()]
    else:
        of_all = responses_of_windows(analysis, at_hz)
    whole = {**analysis.place(None), **condition}
    rows += [{**whole, **response.to_row(record)} for response in of_all]
    table = table_of(rows, "response").fill_nan(None)
    if at_hz is None:
        return table
    is_near = pl.col("frequency_hz").is_between(
        at_hz / SAME_FREQUENCY_RATIO, at_hz * SAME_FREQUENCY_RATIO, closed="none"
    )
    return table.with_columns(is_headline=is_near & (pl.col("scope") == "all"))


def with_errors(response: pl.DataFrame) -> pl.DataFrame:
    """Add to rows of `response.csv` how far the impedance Z = 1/Y is from the desired one, Z_d =
    K_d + j w B_d: in magnitude [%], in phase [deg], and as |Z - Z_d| / |Z_d| [%]."""
    columns = ("frequency_hz", "K_d", "B_d", "magnitude", "phase_deg")
    frequency_hz, K_d, B_d, magnitude, phase_deg = response.select(columns).to_numpy().T
    Y = magnitude * np.exp(1j * np.deg2rad(phase_deg))
    Z_d = K_d + 2j * np.pi * frequency_hz * B_d
    with np.errstate(invalid="ignore"):  # what is not stated is not a number
        ratio = 1 / (Y * Z_d)
    errors = pl.DataFrame(
        {
            "magnitude_error": 100 * (np.abs(ratio) - 1),
            "phase_error": np.rad2deg(np.angle(ratio)),
            "Z_error": 100 * np.abs(ratio - 1),
        }
    ).fill_nan(None)
    return response.with_columns(errors).sort("amplitude_deg", "frequency_hz", nulls_last=True)


def response_to_sine(analysis: Analysis, number: int) -> Response:
    """The response to the sine of one stratum by its settled cycles, before the filter."""
    record = analysis.record
    groups = record.groups
    drift = analysis.whole["drift"] * (record.time - record.time.mean())
    frequency_hz = groups.strata[number].frequency_hz
    is_of_sine = groups.stratum == number
    first = groups.first[is_of_sine]
    stop = groups.stop[is_of_sine]
    rows = slice(int(first.min()), int(np.ceil(stop.max())))
    turn = np.exp(-2j * np.pi * frequency_hz * record.time[rows, None])
    signals = np.column_stack([record.theta, record.torque - drift])[rows]
    sums = products_between(turn, signals, first - rows.start, stop - rows.start)
    theta, torque = (sums[:, 0] / (stop - first)[:, None]).T
    return response_of_pieces(frequency_hz, theta, torque, np.arange(len(first)))


def response_of_pieces(
    frequency_hz: float,
    theta: Spectrum,
    torque: Spectrum,
    unit: NDArray[np.intp],
    alike: float = 1.0,
) -> Response:
    """The response at one frequency by the amplitudes of k pieces, (k,), which belong to units.

    Units that move the joint more count for more, so that their number is their effective one.
    """
    belongs = unit == np.unique(unit)[:, None]
    power = belongs @ np.abs(theta) ** 2
    cross = belongs @ (theta.conj() * torque)
    all_power = power.sum()
    all_cross = cross.sum()
    freedom = all_power**2 / (power**2).sum() - 1
    deviations = np.array([np.nan + 0j])
    if freedom >= LEAST_FREEDOM:
        without_unit = (all_power - power) / (all_cross - cross)
        u = len(power)
        deviations = (without_unit - without_unit.mean()) * np.sqrt(alike * (u - 1) / u)
    return Response(frequency_hz, complex(all_power / all_cross), deviations, freedom)


def mean_response(responses: Sequence[Response]) -> Response:
    """The mean of Y over amplitudes, whose errors are independent.

    It has no interval where the error of one of them is unknown.
    """
    deviations = [response.deviations for response in responses]
    variances = np.array([(np.abs(errors) ** 2).sum() for errors in deviations])
    freedom = np.nan
    if np.isfinite(variances).all():
        freedom = float(welch_satterthwaite(variances, [each.freedom for each in responses]))
    Y = complex(np.mean([response.Y for response in responses]))
    errors = np.concatenate(deviations) / len(responses)
    return Response(responses[0].frequency_hz, Y, errors, freedom)


def responses_of_windows(analysis: Analysis, at_hz: float | None) -> list[Response]:
    """The responses of a motion that is no stepped sine, at the lines of windows, and, of one that
    is not periodic, at a stated frequency within its band.

    The torque's amplitude in a window is that of Eq. 15 plus the window's of what Eq. 15 leaves:
    the window would mix neighbouring frequencies, between which Z changes (2 % at 6 Hz), and what
    is left changes less. Of a motion that is not periodic, Z is told where the joint moves: at the
    mean, by their power, of the frequencies that a window has at a line. There the window is asked
    again, since a line beside a sine has up to a sixth of the next sine, 0.5 Hz apart, which beats
    with it alike in all windows, so that no scatter shows it. Lines whose means
    are of one line are one.
    """
    record = analysis.record
    fit = analysis.whole
    starts, unit, window = windows_of(record)
    unexplained = record.filtered_torque - analysis.modelled()
    signals = np.array([record.motion.theta, record.motion.omega, unexplained])
    pieces = signals[:, starts[:, None] + np.arange(len(window))]
    windows = window * (pieces - pieces.mean(axis=2, keepdims=True))
    highest_hz = min(record.band_hz[1], record.settings.cutoff_hz)
    step = 1 if record.periodic else DISTINCT_LINES
    lines_hz = np.fft.rfftfreq(len(window), 1 / record.rate_hz)[step::step]
    frequency_hz = lines_hz[lines_hz <= highest_hz]
    if at_hz and not record.periodic and record.band_hz[0] <= at_hz <= highest_hz:
        frequency_hz = np.append(at_hz, frequency_hz)

    if not starts.size or not frequency_hz.size:  # shorter than a window, or slower than its lines
        return []
    *_, power, moving_hz = moving_at(frequency_hz, windows, record, at_hz)
    moving_hz = moving_hz[power > LEAST_POWER * power.max()]
    theta, left, _, frequency_hz = moving_at(moving_hz, windows, record, at_hz)
    _, distinct = np.unique(np.rint(frequency_hz / lines_hz[0]), return_index=True)
    s = 2j * np.pi * frequency_hz
    torque = (fit["K"] + fit["B"] * s + fit["I"] * s**2) * theta + left
    alike = 1.0 if record.periodic else UNITS_ALIKE
    return [
        response_of_pieces(frequency_hz[k], theta[:, k], torque[:, k], unit, alike)
        for k in distinct
    ]


def moving_at(
    asked_hz: NDArray[np.floating], windows: Array, record: Record, at_hz: float | None
) -> tuple[Spectrum, Spectrum, Array, Array]:
    """Amplitudes (k, f) in windows (3, k, n) of the angle and of the torque that is left, at
    frequencies, the angle's power (f,), and the mean by power of the frequencies (f,) [Hz] that a
    window has there. A line of a period and a stated frequency are what they are."""
    time = np.arange(windows.shape[2]) / record.rate_hz
    theta, omega, left = windows @ np.exp(-2j * np.pi * np.outer(time, asked_hz))
    power = (np.abs(theta) ** 2).sum(axis=0)
    moving_hz = (theta.conj() * omega).sum(axis=0).imag / (2 * np.pi * power)
    is_exact = (asked_hz == at_hz) | (record.periodic is not None)
    return theta, left, power, np.where(is_exact, asked_hz, moving_hz)


def windows_of(record: Record) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """First rows (k,), units (k,) and shape (n,) of windows.

    They are Hann windows that overlap by three quarters, two of them a unit: what neighbouring
    sines 0.5 Hz apart add to one window the next one takes away. In a periodic motion they are
    the periods, and a realisation is a unit: its distortion by friction repeats in each period. So
    few realisations have wide intervals, and one has none.
    """
    periodic = record.periodic
    rate_hz = record.rate_hz
    if periodic is not None:
        n = round(periodic.period * rate_hz)
        starts = np.rint(periodic.begins * rate_hz).astype(np.intp)
        return np.minimum(starts, len(record.time) - n), periodic.realisation, np.ones(n)

    n = round(WINDOW_S * rate_hz)
    pieces = [np.arange(rows.start, rows.stop - n + 1, n // 4) for rows in runs(record.is_fitted())]
    starts = np.concatenate(pieces)
    return starts, np.arange(len(starts)) // 2, scipy.signal.windows.hann(n, sym=False)
