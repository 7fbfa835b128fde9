"""One zero-phase filter for every signal of a trial, then derivatives. Never filter angle and
torque differently."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.measured import check_finite
from osl_analysis.trial import Array

SLOPE = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60
CURVATURE = np.array([2.0, -27.0, 270.0, -490.0, 270.0, -27.0, 2.0]) / 180
"""First derivative per step and second per squared step, of the polynomial of degree 6 through
seven samples (Fornberg, Math. Comput. 51, 1988, table 1). For a sine of w rad per sample, they are
too small by w^6/140 and w^6/560."""
ENDS = 40
"""Samples at either end for a spline, which gives the derivatives of the outermost three: enough to
forget its end."""


@dataclass(frozen=True)
class LowPass:
    """Butterworth low-pass of the given order and cut-off [Hz], run forwards and backwards: no
    phase, order doubled."""

    cutoff_hz: float
    order: int = 4

    @property
    def noise_bandwidth_hz(self) -> float:
        """Width [Hz] of the ideal low-pass that passes the same power of white noise, after both
        runs: 0.90 of the cut-off for order 4. For order m: the cut-off times the integral of (1 +
        x^2m)^-2 over x = frequency/cut-off."""
        angle = np.pi / (2 * self.order)
        return float(self.cutoff_hz * angle / np.sin(angle) * (1 - 1 / (2 * self.order)))

    def gain(self, frequency_hz: Array) -> Array:
        """Gain (n,) of both runs together, at frequencies (n,) [Hz] well below half the sampling
        rate. No phase."""
        return np.asarray(1 / (1 + (frequency_hz / self.cutoff_hz) ** (2 * self.order)))

    def __call__(self, signal: Array, rate_hz: float) -> Array:
        """Filter samples along the first axis, shape (n, ...), taken at `rate_hz`."""
        check_finite("the signal", signal)
        if not 0 < self.cutoff_hz < rate_hz / 2:
            raise InputError(
                f"filter cut-off {self.cutoff_hz:g} Hz must lie between 0 and half the sampling"
                f" rate of {rate_hz:g} Hz; lower it in the configuration (`cutoff_hz`)"
            )
        edge = int(np.ceil(3 * rate_hz / self.cutoff_hz))
        if len(signal) <= edge:
            raise InputError(
                f"{len(signal)} samples cannot be filtered at {self.cutoff_hz:g} Hz; record over"
                f" {edge / rate_hz:.3g} s"
            )
        filtered = scipy.signal.sosfiltfilt(
            sections_of(self, rate_hz), signal, axis=0, padtype="odd", padlen=edge
        )
        return np.asarray(filtered)

    def independent_samples(self, rate_hz: float) -> int:
        """Half a period of the cut-off, in samples. At this distance, filtered white noise is
        nearly white."""
        return max(round(rate_hz / (2 * self.cutoff_hz)), 1)


@lru_cache(32)
def sections_of(low_pass: LowPass, rate_hz: float) -> Array:
    """Second-order sections of one run. To design them takes as long as to filter a trial."""
    return np.asarray(
        scipy.signal.butter(low_pass.order, low_pass.cutoff_hz, fs=rate_hz, output="sos")
    )


@dataclass(frozen=True)
class Motion:
    """An angle and its derivatives, shape (n,) each: theta [rad], omega [rad/s], alpha
    [rad/s^2]."""

    theta: Array
    omega: Array
    alpha: Array

    @property
    def columns(self) -> Array:
        """Columns (n, 3) of Eq. 15."""
        return np.column_stack([self.theta, self.omega, self.alpha])

    def __getitem__(self, rows: slice | NDArray[np.intp]) -> "Motion":
        return Motion(self.theta[rows], self.omega[rows], self.alpha[rows])


def runs(true: NDArray[np.bool_]) -> list[slice]:
    """Runs of consecutive true samples, shape (n,), in their order."""
    return [slice(first, stop) for first, stop in run_edges(true).tolist()]


def run_edges(true: NDArray[np.bool_]) -> NDArray[np.intp]:
    """First row and row after the last, (k, 2), of each run of consecutive true samples, shape
    (n,)."""
    ends = np.zeros(len(true) + 2, dtype=bool)
    ends[1:-1] = true
    return np.flatnonzero(ends[1:] != ends[:-1]).reshape(-1, 2)


def longest_run(true: NDArray[np.bool_]) -> slice:
    """The longest run of consecutive true samples, or the first of equally long ones; empty if no
    sample is true."""
    edges = run_edges(true)
    return slice(*edges[np.argmax(np.diff(edges))].tolist()) if len(edges) else slice(0, 0)


def sampling_rate(time: Array) -> float:
    """Rate [Hz] of uniform stamps [s]. Raises InputError: a step deviates from the mean by more
    than 20 %, stamps are equal or not finite, or there are fewer than two."""
    check_finite("time", time)
    step = np.diff(time)
    mean = float(np.mean(step)) if len(step) else 0.0
    if not mean > 0:
        raise InputError(
            f"{len(time)} stamps that do not go forward have no rate; check the time's channel"
        )
    if max(np.max(step) - mean, mean - np.min(step)) > 0.2 * mean:
        worst = int(np.argmax(np.abs(step - mean)))
        raise InputError(
            f"the step at {time[worst]:.4f} s is {step[worst] * 1e3:.3f} ms, the mean step"
            f" {mean * 1e3:.3f} ms: samples are missing or irregular; resample the log or cut the"
            " trial at the gap"
        )
    return 1 / mean


def differentiate(time: Array, theta: Array) -> Motion:
    """Angle [rad] at times [s] with its derivatives, from a quintic spline through the (already
    filtered) samples. It loses less than 0.1 % of a velocity at 20 Hz sampled at 300 Hz; central
    differences lose 3 %. Raises InputError."""
    check_finite("time", time)
    check_finite("the angle", theta)
    if len(time) < 6 or not (np.diff(time) > 0).all():
        raise InputError(
            f"{len(time)} samples cannot be differentiated: 6 or more are needed, each later than"
            " the one before; take a longer window, or check the time's channel"
        )
    spline = scipy.interpolate.make_interp_spline(time, theta, k=5)
    return Motion(np.asarray(theta), spline(time, 1), spline(time, 2))


def filtered_motion(
    time: Array, theta: Array, torque: Array, low_pass: LowPass
) -> tuple[Motion, Array]:
    """Motion from the filtered angle [rad], and the torque [N*m] through the *same* filter; shape
    (n,) each. The times [s] are uniform. The spline is used below some 60 samples per period of the
    cut-off, where seven samples would lose more than 1e-8 of a velocity at the cut-off. It takes
    fifty times as long."""
    rate = sampling_rate(time)
    smooth = low_pass(theta, rate)
    coarse = (2 * np.pi * low_pass.cutoff_hz / rate) ** 6 / 140 > 1e-8 or len(time) < 2 * ENDS
    motion = differentiate(time, smooth) if coarse else seven_point_motion(time, smooth, rate)
    return motion, low_pass(torque, rate)


def seven_point_motion(time: Array, theta: Array, rate_hz: float) -> Motion:
    """Motion from an angle (n,) [rad] sampled evenly at `rate_hz`, and slow compared to it.
    Derivatives are from seven samples each; in the three rows at either end, from the spline."""
    omega, alpha = np.empty(len(theta)), np.empty(len(theta))
    omega[3:-3] = np.correlate(theta, SLOPE, "valid") * rate_hz
    alpha[3:-3] = np.correlate(theta, CURVATURE, "valid") * rate_hz**2
    for rows, own in ((slice(ENDS), slice(3)), (slice(-ENDS, None), slice(-3, None))):
        end = differentiate(time[rows], theta[rows])
        omega[own], alpha[own] = end.omega[own], end.alpha[own]
    return Motion(theta, omega, alpha)


def run_at_extreme(values: Array) -> slice:
    """Longest run of a noisy channel (n,) at its lowest or highest value: one sample, or many if it
    is clipped. Values near zero (an unloaded sensor) or near the median do not count. Nor does the
    peak of a slow signal, which repeats a value too: a parabola with the slopes at the ends of such
    a plateau rises by less than 2.5 steps."""
    if not values.size or not np.isfinite(values).all():
        return slice(0, 0)
    low, high, middle = float(values.min()), float(values.max()), float(np.median(values))
    steps = np.abs(np.diff(values))
    step, longest = float(steps[steps > 0].min(initial=np.inf)), slice(0, 0)
    for end in (low, high):
        if abs(end) <= 0.05 * (high - low) or abs(end - middle) <= 0.25 * (high - low):
            continue
        run = longest_run(values == end)
        length = run.stop - run.start
        near = max(5, length // 2)  # beside a long plateau, values stay one step away for a while
        sides = values[max(run.start - near, 0) : run.start], values[run.stop : run.stop + near]
        slope = min(
            (float(np.abs(side - end).max()) / side.size for side in sides if side.size),
            default=0.0,
        )
        if length > longest.stop - longest.start and (
            length == 1 or slope * length / 4 > 2.5 * step
        ):
            longest = run
    return longest
