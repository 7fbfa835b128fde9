"""One recorder's clock fitted to another's by correlating a signal that both recorded, where sync edges cannot be used.

The signal can be a joint's encoder and the angle between markers, or two sync voltages with hum or drift. Its scale,
offset and sign may differ between the recorders.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.ingest.clock import LARGEST_DRIFT, MINIMUM_EDGES, ClockFit, robust_line
from osl_analysis.trial import Array

SECTIONS = 12  # parts of the recording, whose lags give the drift
ALIKE = 0.5  # smallest correlation that counts as one signal
RIVAL = 0.8  # of the highest peak: a second peak above this makes the lag ambiguous
OVERLAP = 0.5  # smallest common part, as a share of the shorter recording
QUIET = 0.05  # of the variance of the recording: a section with less is not used


@dataclass(frozen=True)
class Course:
    """A signal over the time of its recorder."""

    time: Array
    """Strictly increasing times, (n,) [s]."""
    value: Array
    """The signal, (n,), in any unit."""

    @property
    def step(self) -> float:
        """Median sampling interval [s]."""
        return float(np.median(np.diff(self.time)))

    def on_grid(self, step: float) -> Array:
        """Values every `step` [s] from the first sample on, interpolated, without their mean."""
        grid = self.time[0] + step * np.arange(int((self.time[-1] - self.time[0]) / step) + 1)
        values = np.interp(grid, self.time, self.value)
        return np.asarray(values - values.mean())


def correlate_clocks(slave: Course, master: Course) -> ClockFit:
    """Offset from the highest peak of the correlation, drift from the lags of twelve sections of the recording.

    In the result `edges` counts the sections that were used, `excluded_edges` those that were quiet or did not fit.

    Raises
    ------
    InputError
        The signals are too short, constant or unlike, a second peak reaches 80 % of the first, fewer than six of the
        twelve sections have movement, or the residual exceeds the sampling interval of the slower recorder.
    """
    if min(slave.time.size, master.time.size) < 4 * SECTIONS:
        raise InputError(f"fewer than {4 * SECTIONS} samples of the shared signal; record longer")
    step = min(slave.step, master.step)
    ours, theirs = slave.on_grid(step), master.on_grid(step)
    if not min(np.ptp(ours), np.ptp(theirs)) > 0:
        raise InputError("the shared signal of one recorder is constant; check the channel and its sensor")
    lag = whole_lag(ours, theirs)
    first, second = section_lags(ours, theirs, lag)
    if first.size < MINIMUM_EDGES:
        raise InputError(
            f"the shared signal moves in {first.size} of {SECTIONS} sections of the recording, at least "
            f"{MINIMUM_EDGES} are needed; move the joint throughout"
        )
    return lag_line(slave.time[0] + step * first, master.time[0] + step * second, max(slave.step, master.step), step)


def lag_line(first: Array, second: Array, limit: float, step: float) -> ClockFit:
    """Line through pairs of times [s], (n,) each; the residual of a first fit is the noise of the second."""
    line, used = robust_line(first, second, step)
    for _ in range(2):
        rms = float(np.sqrt(((second - line.at(first))[used] ** 2).mean()))
        line, used = robust_line(first, second, max(rms, 0.01 * step))
    if rms > limit:
        raise InputError(
            f"the lags of the shared signal scatter by {1e3 * rms:.2f} ms, within {1e3 * limit:.2f} ms is needed; "
            "check that both channels show the same thing"
        )
    count = int(used.sum())
    return ClockFit(line.offset, line.drift, line.drift_error, rms, count, SECTIONS - count, "correlation")


def whole_lag(ours: Array, theirs: Array) -> int:
    """Samples by which `theirs` (m,) is behind `ours` (n,), from the whole recordings.

    Raises
    ------
    InputError
        The highest peak is too low, or a second one is nearly as high.
    """
    lags, score = correlation_by_lag(ours, theirs)
    best = int(np.argmax(score))
    if not score[best] >= ALIKE:
        raise InputError(
            f"the shared signal of both recorders correlates by {score[best]:.2f} at best, {ALIKE} is needed; check "
            "that both channels show the same thing"
        )
    low = np.flatnonzero(score < 0.5 * score[best])
    before, after = low[low < best].max(initial=-1), low[low > best].min(initial=score.size)
    rival = max(score[: before + 1].max(initial=0.0), score[after:].max(initial=0.0))
    if rival > RIVAL * score[best]:
        raise InputError(
            f"the shared signal fits in two places (correlation {score[best]:.2f} and {rival:.2f}): it repeats "
            "itself; add one movement that does not, such as a single stamp at the beginning"
        )
    return int(lags[best])


def correlation_by_lag(ours: Array, theirs: Array) -> tuple[NDArray[np.intp], Array]:
    """Lags [samples] with enough overlap, and the absolute correlation coefficient over the overlap at each lag."""
    flipped, one, other = ours[::-1], np.ones(ours.size), np.ones(theirs.size)
    overlap = np.maximum(np.rint(convolved(other, one)), 1)
    sum_ours, sum_theirs = convolved(other, flipped), convolved(theirs, one)
    covariance = convolved(theirs, flipped) - sum_ours * sum_theirs / overlap
    scatter_ours = convolved(other, flipped**2) - sum_ours**2 / overlap
    scatter_theirs = convolved(theirs**2, one) - sum_theirs**2 / overlap
    # over a quiet overlap the coefficient would be noise: its scatter counts as at least QUIET of the whole
    floor_ours, floor_theirs = (max(QUIET * float((x**2).sum()), np.finfo(float).tiny) for x in (ours, theirs))
    scatter = np.maximum(scatter_ours, floor_ours) * np.maximum(scatter_theirs, floor_theirs)
    enough = overlap >= OVERLAP * min(ours.size, theirs.size)
    lags = np.arange(overlap.size) - (ours.size - 1)
    return lags[enough], (abs(covariance) / np.sqrt(scatter))[enough]


def convolved(first: Array, second: Array) -> Array:
    """Full convolution, (n + m - 1,)."""
    count = first.size + second.size - 1
    size = 1 << (count - 1).bit_length()
    return np.asarray(np.fft.irfft(np.fft.rfft(first, size) * np.fft.rfft(second, size), size)[:count])


def section_lags(ours: Array, theirs: Array, lag: int) -> tuple[Array, Array]:
    """Middles of the sections of `ours`, and where they are in `theirs` [samples], (sections,) each.

    Quiet sections are not used. A parabola through three samples gives the peak between samples.
    """
    begin, end = max(0, -lag), min(ours.size, theirs.size - lag)
    length = (end - begin) // SECTIONS
    reach = int(np.ceil(LARGEST_DRIFT * ours.size)) + 8
    first, second = [], []
    for start in range(begin, begin + length * SECTIONS, length):
        part = ours[start : start + length]
        low, high = start + lag - reach, start + lag + length + reach
        if low < 0 or high > theirs.size or part.var() < QUIET * ours.var():
            continue
        shift = best_shift(part, theirs[low:high])
        if shift is not None:
            first.append(start + length / 2)
            second.append(start + lag - reach + shift + length / 2)
    return np.array(first), np.array(second)


def best_shift(part: Array, around: Array) -> float | None:
    """Where in `around` (n + 2 reach,) the part (n,) fits best [samples]; None if that is at its beginning or end."""
    windows = np.lib.stride_tricks.sliding_window_view(around, part.size)
    centred = part - part.mean()
    scatter = np.maximum(windows.std(axis=1), np.finfo(float).tiny)
    score = abs(windows @ centred) / (scatter * part.std() * part.size)
    best = int(np.argmax(score))
    if best in (0, score.size - 1) or score[best] < ALIKE:
        return None
    left, middle, right = score[best - 1 : best + 2]
    return best + float(0.5 * (left - right) / (left - 2 * middle + right))
