# SPDX-License-Identifier: Apache-2.0
"""Angle and torque of one recording in the band of its motion, as spectra and as signals.

Derivatives and filters are exact in the frequency domain. What a Fourier transform assumes about
the ends is made harmless by order: derivatives and filters first, then a window in time. A linear
relation of samples, torque = K theta + B omega + I alpha, survives both.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.base.errors import NotWeighedError
from osl_analysis.base.trial import Array
from osl_analysis.model.drivetrain import Spectrum
from osl_analysis.signals.filters import power_density, run_edges

# Consecutive parts of the recording, each of which is predicted by the others; 24 scatters give a
# standard error to 15 %; blocks of 2 to 6 s outlast the noise's memory
BLOCKS = 24
# Left out at both ends, where filters depend on what was not recorded [s]; ten times the longest
# time constant of a path, and a period of the slowest band's end
EDGE = 0.5
# Time over which rows begin and end at an end or a gap [s]; without a taper the whitening filter
# spreads the step; longer tapers only lose rows
TAPER = 0.25
# Odd extension of both ends before a Fourier transform [s]; 60 times the longest time constant of
# a path
PADDING = 3.0
# Shortest recording: with a quarter of a second a block is one motion [s]; blocks of 0.25 s are
# one half-period of 2 Hz
SHORTEST = 6.0
# Added to the normal equations of scaled columns; far below any that a recording tells, keeps equal
# ones apart
RIDGE_ROUNDING = 1e-11
# Length of a column of zeros, whose square is a number, too
LENGTH_ROUNDING = 1e-150
# Power of the angle over its noise below which the band ends; noise is then 1 % of a column's
# power at the band's end
VISIBLE_ABOVE_NOISE = 100.0
# End of the band at most [Hz]; a choice: eight times the fastest motion of a bench
HIGHEST_BAND = 40.0
# End of the band over the sampling rate at most; the working rate of 3.4 bands must stay below the
# sampling rate
BAND_OF_RATE = 0.28
# Rate at which signals are multiplied, or pass a nonlinearity [Hz]; a choice: 16 rows in a period
# of the fastest motion behind the usual filter
PRODUCT_RATE = 250.0
# Least backlash, dead zone, motion or RMS of what is cut, over K, that is not rounding [encoder
# steps]; at 1.5 steps a joint at rest explains its own rounding as a dead zone, with a
# log-likelihood of 143; sound steps between levels look cut by up to 2.1, and what is cut and named
# by 9 or more
FEWEST_STEPS = 3.0
# Angles over which friction builds up before it slides [rad]; bristles of 3e-5 to 1e-3 rad are
# sums of these: docs/bench_validation.md
FRICTION_WINDS = (5e-5, 1.5e-4, 5e-4, 1.5e-3)
# Share of the velocity's SD over which sliding friction changes sign, if the velocity's noise is
# smaller; the next wider shape, five times as wide, is a column too
SIGN_SHARE = 0.01

# Band of signals that are multiplied [bands], and at least [Hz]: products have two or three bands
PRODUCT_BAND = (3.0, 20.0)
END_S = 0.03  # of a recording [s], whose mean is the value at its end
# Frequencies that show the angle's noise: above so many Hz, where the rate allows
NOISE_ABOVE_HZ = 100.0
# From where noise may end a band, and where the band of a slow motion ends [Hz]
BAND_ENDS = (1.0, 2.0)

WORKING_RATE = 3.4  # bands; there the roll-off has taken all but 1.4 % of a signal
LAST_LINES = 0.2  # share of the lines, over which the rest of the roll-off falls to 0
SPECTRUM_S = 2.0  # [s] of a segment of Welch's spectrum
REST = 0.02  # SD of the angle that a joint at rest does not leave
HIGHEST_OF_RATE = (0.35, 0.45)  # of the sampling rate: frequencies that show the noise
DERIVATIVE_COUNT = 5  # angle and its derivatives up to the fourth


@dataclass(frozen=True)
class BenchSignals:
    """Angle and torque of one joint, on one clock and evenly sampled.

    Parameters
    ----------
    theta : Array (n,)
        Angle of the joint [rad].
    torque : Array (n,)
        Resisting torque [N*m].
    rate_hz : float
        Sampling rate [Hz].
    encoder_step : float
        Resolution of the angle [rad]; 0 if it is not known.
    usable : Array (n,) of bool, optional
        False at rows of a gap or outside of the stated windows.
    sliding_angle : Array (n,), optional
        Of a leg, the angle [rad] of its actuator, on the other side of the belt, whose velocity dry
        friction opposes. None: a joint, whose own velocity it opposes.
    load : Array (n,), optional
        What friction grows with, as a motor's current [A]. Without it friction has one size.
    """

    theta: Array
    torque: Array
    rate_hz: float
    encoder_step: float = 0.0
    usable: NDArray[np.bool_] | None = None
    sliding_angle: Array | None = None
    load: Array | None = None

    def moving_part(self) -> "BenchSignals":
        """Return the part from the first to the last motion, with `EDGE` at both ends.

        A joint at rest shows one error of the encoder for seconds, and nothing else.
        """
        least = max(FEWEST_STEPS * self.encoder_step, REST * self.theta.std())
        from_start, from_end = np.abs(self.theta - self.theta[[0, -1], None]) > least
        edge = round(EDGE * self.rate_hz)
        first = max(np.argmax(from_start) - edge, 0)
        stop = len(self.theta) - np.argmax(from_end[::-1]) + edge
        rows = slice(first, stop)
        if len(self.theta[rows]) < SHORTEST * self.rate_hz:
            return self
        signals_in_part: dict[str, Any] = {
            name: signal[rows] for name, signal in vars(self).items() if np.ndim(signal) == 1
        }
        return replace(self, **signals_in_part)


class Spectra:
    """A recording's spectra at its own rate, and its signals at the product rate. Raises
    NotWeighedError: it is too short.

    Letters of shapes, here and in the modules that use it:

    | letter | rows at | what for |
    |---|---|---|
    | r | the recorded rate, with padding | rounding, which is faster than the band |
    | p | the *product* rate, `PRODUCT_RATE` | signals that are multiplied, or pass a nonlinearity |
    | w | the *working* rate, `WORKING_RATE` bands, with padding | to compare with the torque |
    | m | the same without padding, edges and gaps | the rows that are fitted |
    | f | frequencies of the w rows | working spectra |

    Attributes
    ----------
    signals : BenchSignals
        The moving part of the recording, of n rows.
    seconds : float
        Its duration [s].
    angle_noise : float
        Density of the angle's noise, taken as white [rad^2/Hz].
    band_hz : float
        Where the angle's power falls to `VISIBLE_ABOVE_NOISE` times its noise [Hz].
    product_rows : int
        Number of rows, with their padding, at the product rate (p).
    first_row : int
        The first row of the recording in its padded signals.
    padded_rows, padded_seconds : int, float
        Number of recorded rows with their padding (r), and the duration of it [s].
    thinned : int
        Recorded rows in one at the product rate, not fewer; they divide `padded_rows`.
    raw_angle : Spectrum (r/2 + 1,)
        Spectrum of the padded angle, less the line between its ends, at the recorded rate.
    ends : tuple of float
        Ends of that line [rad].
    raw_torque : tuple
        The same spectrum and ends of the torque.
    time : Array (p,)
        Times of product rows [s] from the first row of the recording.
    relative_time : Array (p,)
        These times over the recording's duration, from 0 to 1.
    theta, omega, alpha : Array (p,)
        Angle less the line between its ends, its velocity and acceleration [SI].
    angle : Array (p,)
        Angle about its mean, with that line, for products.
    sliding : Array (p,)
        Angle whose velocity friction opposes, with its line [rad]; the deflection of a
        drivetrain's belt, whose hysteresis it is.
    actuator_derivatives : Array (3, p) or None
        The angle of a drivetrain's actuator less the line between its ends, its velocity and
        acceleration, for products.
    inside : Array (p,) of bool
        Rows of the recording, not of its padding.
    """

    def __init__(self, signals: BenchSignals) -> None:
        if len(signals.theta) < SHORTEST * signals.rate_hz:
            raise NotWeighedError(
                f"the recording lasts {len(signals.theta) / signals.rate_hz:.3g} s",
                f"record {SHORTEST:g} s or more",
            )
        self.signals = signals.moving_part()
        rate, n = self.signals.rate_hz, len(self.signals.theta)
        self.seconds = n / rate

        # odd extension at both ends, less the line between them, so that no end leaps
        self.first_row = min(round(PADDING * rate), n - 2)
        self.thinned = max(int(rate / PRODUCT_RATE), 1)
        thinned_rows = -(-(n + 2 * self.first_row) // self.thinned)
        self.padded_rows = self.thinned * int(scipy.fft.next_fast_len(thinned_rows, real=True))
        self.padded_seconds = self.padded_rows / rate
        self.raw_angle, self.ends = self.transformed(self.signals.theta)

        self.raw_torque = self.transformed(self.signals.torque)
        self.angle_noise, self.band_hz = noise_and_band(self.signals.theta, rate)

        # product rate
        self.product_rows = 2 * int(
            scipy.fft.next_fast_len(int(PRODUCT_RATE / 2 * self.padded_seconds))
        )
        rows = np.arange(self.product_rows) * self.padded_seconds / self.product_rows
        self.time = rows - self.first_row / rate
        self.inside = (self.time >= 0) & (self.time < self.seconds)
        self.relative_time = np.clip(self.time / self.seconds, 0.0, 1.0)
        self.product_band_hz = max(PRODUCT_BAND[0] * self.band_hz, PRODUCT_BAND[1])
        self.theta, self.omega, self.alpha = self._at_product_rate(self.raw_angle, 3)
        with_line = self.theta + np.linspace(*self.ends, self.product_rows)
        self.angle = with_line - with_line[self.inside].mean()

        # the other side of a drivetrain's belt
        self.actuator_derivatives: Array | None = None
        self.sliding = self.angle
        if self.signals.sliding_angle is not None:
            raw_actuator, ends = self.transformed(self.signals.sliding_angle)
            self.actuator_derivatives = self._at_product_rate(raw_actuator, 3)
            actuator = self.actuator_derivatives[0] + np.linspace(*ends, self.product_rows)
            # what turns a belt, theta - theta_m/n_T, by the torque that it transmits
            others = [self.omega, self.alpha, np.ones_like(self.theta), self.relative_time]
            columns = np.array([self.angle, actuator, *others])
            torque = self.resampled(*self.raw_torque)
            of_torque = solve_scaled(columns[:, self.inside], torque[self.inside])
            self.sliding = self.angle + of_torque[1] / of_torque[0] * actuator

    def transformed(self, x: Array) -> tuple[Spectrum, tuple[float, float]]:
        """Spectrum (r/2 + 1,) of a signal (n,) with an odd extension at both ends, less the line
        between its ends, and these."""
        few = max(round(END_S * self.signals.rate_hz), 2)
        pad = self.first_row
        stop = pad + len(x)
        # in place: new memory takes longer than the transform
        extended = np.empty(self.padded_rows)
        extended[:pad] = 2 * x[:few].mean() - x[pad:0:-1]
        extended[pad:stop] = x
        extended[stop : stop + pad] = 2 * x[-few:].mean() - x[-2 : -pad - 2 : -1]
        extended[stop + pad :] = extended[stop + pad - 1]
        ends = extended[0], extended[-1]
        extended -= np.linspace(*ends, self.padded_rows)
        return scipy.fft.rfft(extended), ends

    def _at_product_rate(self, spectrum: Spectrum, number: int) -> Array:
        """A signal and its derivatives, `number` in all, at the product rate."""
        spectrum = spectrum[: self.product_rows // 2 + 1]
        frequency = np.arange(len(spectrum)) / self.padded_seconds
        gain = roll_off(frequency, self.product_band_hz) * (self.product_rows / self.padded_rows)
        powers = np.vander(2j * np.pi * frequency, number, increasing=True).T
        return scipy.fft.irfft(powers * gain * spectrum, self.product_rows)

    def resampled(self, spectrum: Spectrum, ends: tuple[float, float]) -> Array:
        """A signal at the product rate (p,), whose spectrum is `transformed`."""
        smooth = self._at_product_rate(spectrum, 1)[0]
        return smooth + np.linspace(*ends, self.product_rows)


class WorkingSpectra(Spectra):
    """The same with what is compared with the torque, in the band of the motion.

    Attributes
    ----------
    working_rows : int
        Number of rows, with their padding, at the working rate (w).
    working_rate_hz : float
        The working rate [Hz].
    freedom : float
        Number of independent rows.
    frequency : Array (f,)
        Frequencies of working spectra [Hz].
    s : Spectrum (f,)
        2 pi i times them [rad/s].
    powers : Spectrum (5, f)
        Powers of s from 0, by which derivatives are taken.
    roll_off : Array (f,)
        Gain that ends the band.
    derivatives : Spectrum (5, f)
        Angle and its first four derivatives.
    torque : Spectrum (f,)
        The torque.
    window : Array (w,)
        Weight of each working row: 0 in padding, edges and gaps.
    rows : Array (w,) of bool
        Where the window is not 0; their number is m.
    """

    def __init__(self, signals: BenchSignals) -> None:
        super().__init__(signals)
        half = scipy.fft.next_fast_len(
            int(WORKING_RATE / 2 * self.band_hz * self.padded_seconds), real=True
        )
        self.working_rows = 2 * int(half)
        self.working_rate_hz = self.working_rows / self.padded_seconds
        self.frequency = np.arange(self.working_rows // 2 + 1) / self.padded_seconds
        self.s = 2j * np.pi * self.frequency
        self.roll_off = roll_off(self.frequency, self.band_hz)
        # a recording that ends in motion would ring at the last line, if this were cut off
        to_last = 1 - self.frequency / self.frequency[-1]
        self.roll_off *= np.sin(np.pi / 2 * np.clip(to_last / LAST_LINES, 0.0, 1.0)) ** 2
        self.powers = np.vander(self.s, DERIVATIVE_COUNT, increasing=True).T
        in_band = slice(len(self.frequency))
        share = self.working_rows / self.padded_rows
        self.derivatives: Spectrum = self.raw_angle[in_band] * share * self.powers
        self.torque: Spectrum = self.raw_torque[0][in_band] * share
        self.window = self._window()
        self.rows = self.window > 0
        # independent rows, of which the roll-off leaves a part
        self.freedom = float(np.count_nonzero(self.rows) * np.mean(self.roll_off**2))

    def windowed(self, spectrum: Spectrum) -> Spectrum:
        """Spectra (..., f) of signals with these working spectra in the window, behind the
        roll-off."""
        x = scipy.fft.irfft(spectrum * self.roll_off, self.working_rows)
        x *= self.window
        return scipy.fft.rfft(x)

    def _window(self) -> Array:
        """The weight (w,) of each working row, which rises over `TAPER` from edges and gaps."""
        time = (
            np.arange(self.working_rows) / self.working_rate_hz
            - self.first_row / self.signals.rate_hz
        )
        to_edge = np.minimum(time, self.seconds - time) - EDGE
        usable = self.signals.usable
        if usable is not None and not usable.all():
            to_gap = scipy.ndimage.distance_transform_edt(usable) / self.signals.rate_hz
            rows = np.clip(np.rint(time * self.signals.rate_hz), 0, len(usable) - 1).astype(np.intp)
            to_edge = np.minimum(to_edge, to_gap[rows] - 1 / self.band_hz)
        risen = np.clip(to_edge / TAPER, 0.0, 1.0)
        return risen**2 * (3 - 2 * risen)

    def spectrum_of(self, x: Array) -> Spectrum:
        """The working spectrum (..., f) of signals (..., p) at the product rate."""
        of_products: Spectrum = scipy.fft.rfft(x)[..., : len(self.frequency)]
        return of_products * (self.working_rows / self.product_rows)


def scaled_normal(columns: Array) -> tuple[Array, Array]:
    """The normal matrix (k, k) of columns (k, m) scaled to length 1, and their lengths (k,)."""
    products = columns @ columns.T
    length = np.sqrt(products.diagonal()) + LENGTH_ROUNDING
    return products / np.outer(length, length) + RIDGE_ROUNDING * np.eye(len(length)), length


def solve_scaled(columns: Array, torque: Array) -> Array:
    """Estimate the coefficients (k,) of columns (k, m) for a torque (m,)."""
    normal, length = scaled_normal(columns)
    estimates = np.linalg.solve(normal, columns @ torque / length) / length
    # one step of refinement takes off what rounding of the normal matrix has added
    left = torque - estimates @ columns
    return estimates + np.linalg.solve(normal, columns @ left / length) / length


def roll_off(frequency: Array, end_hz: float) -> Array:
    """Gain 1/(1 + (f/end)^8), which ends a band without ringing."""
    square = (frequency / end_hz) ** 2
    return 1 / (1 + (square**2) ** 2)  # a power of 8 takes as long as a transform


def noise_and_band(theta: Array, rate_hz: float) -> tuple[float, float]:
    """Find the density of an angle's noise [rad^2/Hz], and the end of its motion's band [Hz].

    The noise is taken as white, and read at the highest frequencies (above 100 Hz where there are
    such). The band ends at the first frequency above 1 Hz at which the power falls below
    `VISIBLE_ABOVE_NOISE` times the noise.
    """
    rows = min(round(SPECTRUM_S * rate_hz), len(theta))
    frequency, power = power_density(theta, rate_hz, rows)
    above, below = HIGHEST_OF_RATE
    highest = (frequency > min(NOISE_ABOVE_HZ, above * rate_hz)) & (frequency < below * rate_hz)
    noise = float(np.median(power[highest]))

    limit = min(HIGHEST_BAND, BAND_OF_RATE * rate_hz)
    hidden = frequency[(frequency > BAND_ENDS[0]) & (power < VISIBLE_ABOVE_NOISE * noise)]
    end = max(float(hidden.min(initial=limit)), min(BAND_ENDS[1], limit))
    return noise, end


# Shapes of dry friction: torques of 1 N*m that oppose a motion. Friction either changes
# sign with the velocity, or builds up over an angle before it slides, like a bristle
# (Dahl, Aerospace Corp. TOR-158(3107-18)-1, 1968; Canudas de Wit et al., IEEE Trans.
# Autom. Control 40, 1995). Which of these a joint has nobody knows beforehand: all are
# columns, and what they are together must oppose the motion.


WIDER = 5.0  # times the first width, over which the second sign changes
SPEED_ROUNDING = 1e-6  # rad/s, so that no width is 0
WHOLE_RANGE = 2.0  # of a spring that slips at +-1, from one limit to the other


def slipping_springs(angle: Array, widths: Sequence[float]) -> Array:
    """Compute the torques of springs that slip at +-1 (Prandtl's stop operator).

    Parameters
    ----------
    angle : Array (n,)
        Angle that winds the springs up [rad].
    widths : sequence of float
        Angle from slack to the limit [rad] of each of k springs.

    Returns
    -------
    Array (k, n)
        Torques over their limits; 0 in the first row.
    """
    rising = np.diff(angle) >= 0
    reversals = np.flatnonzero(rising[1:] != rising[:-1]) + 1
    turns = np.concatenate([[0], reversals, [len(angle) - 1]])
    rows_of_turn = np.diff(turns)
    since_turn = angle[:-1] - np.repeat(angle[turns[:-1]], rows_of_turn)
    ways = np.diff(angle[turns])

    torques = np.empty((len(widths), len(angle)))
    for torque, width in zip(torques, widths, strict=True):
        # between two turning points the motion has one direction, so that one clip is enough
        wound = wound_at_turns(ways / width)
        unclipped = np.repeat(wound[:-1], rows_of_turn) + since_turn / width
        np.clip(unclipped, -1.0, 1.0, out=torque[:-1])
        torque[-1] = wound[-1]
    return torques


def wound_at_turns(ways: Array) -> Array:
    """How far a spring that slips at +-1 is wound at each turning point of its motion.

    Parameters
    ----------
    ways : Array (k,)
        From each turning point to the next, in units of the spring's limit.

    Returns
    -------
    Array (k + 1,)
        From 0 at the first one on.

    Notes
    -----
    A way of 2 or more winds it from any state to its limit. Only states after shorter ways are
    computed one by one, of which large motions have few.
    """
    wound = np.append(0.0, np.sign(ways))
    is_short = np.abs(ways) < WHOLE_RANGE
    for first, stop in run_edges(is_short).tolist():
        level = float(wound[first])
        levels = []
        for way in ways[first:stop].tolist():
            level = min(max(level + way, -1.0), 1.0)
            levels.append(level)
        wound[first + 1 : stop + 1] = levels
    return wound


def friction_torques(spectra: Spectra) -> Array:
    """Compute the columns (k, p) of dry friction, at the product rate.

    Two slide, with a sign that changes over a narrow and a wide velocity. Springs slip behind each
    of `FRICTION_WINDS`.

    The sign of a noisy velocity chatters: its width is at least the velocity's noise, whose
    variance is the integral of (2 pi f)^2 times the angle's noise density over the product band.
    """
    velocity = np.gradient(spectra.sliding, spectra.padded_seconds / spectra.product_rows)
    variance = spectra.angle_noise * (2 * np.pi) ** 2 * spectra.product_band_hz**3 / 3
    usual = SIGN_SHARE * velocity[spectra.inside].std()
    width = max(usual, np.sqrt(variance), SPEED_ROUNDING)
    sliding = np.tanh(velocity / (width * np.array([[1.0], [WIDER]])))
    return np.vstack([sliding, slipping_springs(spectra.sliding, FRICTION_WINDS)])
