"""One shape of the platform's motion, and how a crossing follows it: start, amplitude, duration."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline, make_lsq_spline

from osl_analysis.trial import Array
from osl_analysis.walking.platform_motion import PlatformTrack
from osl_analysis.walking.platform_rank import noise_gain

LEAD_S = 0.15
"""Time [s] before the middle of the rise at which the shape begins."""
KNOT_S = 0.01
"""Distance [s] between the knots of the shape: 50 Hz, beyond the low-pass of the analysis."""
GRID_S = 0.002
"""Step [s] of the shape as it is stored."""
ROUNDS = 6
"""Alternations of shape and alignment. A start that is 5 ms off is right to 1e-5 s after four."""
LARGEST_STEP_S = 0.02
"""Largest change [s] of a start in one step of Gauss and Newton."""
UNLIKE = 4.0
"""A crossing does not follow the shape if its misfit lies this many standard deviations above that of noise."""


@dataclass(frozen=True)
class Alignment:
    """How one crossing follows the shape.

    name: the trial.
    start: time [s] at which the motion starts.
    start_se: its standard error [s] from the marker noise of this crossing. What all share is in `PlatformTemplate`.
    amplitude: size of the motion, 1 on average, negative in the other direction.
    duration: time scale of the motion, 1 on average; 1 for all where it does not scatter.
    duration_se: standard error of a free time scale.
    shared: covariance [s] of the errors of start and time scale.
    offset: coordinates (r,) [m] at rest.
    misfit: mean square of the filtered difference between motion and shape, over that of noise.
    follows: whether the misfit is that of noise.
    """

    name: str
    start: float
    start_se: float
    amplitude: float
    duration: float
    duration_se: float
    shared: float
    offset: Array
    misfit: float
    follows: bool


@dataclass(frozen=True)
class PlatformTemplate:
    """The shape that motions of the platform share.

    axes: directions (r, 6) of the motion, as in `PlatformTrack`.
    time: grid (g,) [s] from the start of the motion.
    shape: coordinates (g, r) [m] from rest, of a motion of amplitude 1.
    noise: standard deviation [m] of the noise in one frame of a crossing.
    crossings: number of crossings whose mean the shape is.
    scaled: whether the duration of the motion differs between crossings.
    start_se: standard error [s] of the start of the shape, which shifts the start of every crossing alike.
    start_shape: [s], as `shape` of `RiseStart`.
    """

    axes: Array
    time: Array
    shape: Array
    noise: float
    crossings: int
    scaled: bool
    start_se: float = 0.0
    start_shape: float = 0.0

    @cached_property
    def spline(self) -> BSpline:
        """The spline through the shape."""
        return make_interp_spline(self.time, self.shape, k=5)

    def at(self, time: Array, derivative: int = 0) -> Array:
        """Coordinates (n, r) [m], or their derivative, at times [s] from the start; constant beyond the grid."""
        inside = (time >= self.time[0]) & (time <= self.time[-1])
        values = self.spline(np.clip(time, self.time[0], self.time[-1]), derivative)
        return np.asarray(values if derivative == 0 else values * inside[:, None])

    def grid_noise(self, rate: float) -> float:
        """Standard deviation [m] of the noise in each sample of the shape, as if it were independent of the others, for
        crossings of `rate` frames per second [Hz]."""
        return float(self.noise / np.sqrt(self.crossings * rate * GRID_S))

    def curve(self, time: Array, alignment: Alignment) -> Array:
        """Coordinates (n, r) [m] from rest, at times [s], of a crossing that follows the shape."""
        return alignment.amplitude * self.at((time - alignment.start) / alignment.duration)


def mean_shape(
    tracks: Sequence[PlatformTrack],
    alignments: Sequence[Alignment],
    axes: Array,
    ends: tuple[float, float],
    noise: float,
    scaled: bool,
) -> PlatformTemplate:
    """The least-squares spline through all aligned motions. The mean size and duration of its crossings are 1."""
    size = float(np.mean([abs(a.amplitude) for a in alignments]))
    duration = float(np.exp(np.mean([np.log(a.duration) for a in alignments])))
    time, values, weights = [], [], []
    for track, a in zip(tracks, alignments, strict=True):
        since, amplitude = (track.time - a.start) / (a.duration / duration), a.amplitude / size
        near = (since >= ends[0]) & (since <= ends[1])
        time.append(since[near])
        values.append((track.measured[near] @ axes.T - a.offset) / amplitude)
        weights.append(np.full(near.sum(), abs(amplitude)))
    order = np.argsort(np.concatenate(time), kind="stable")
    step = max(KNOT_S, 1.5 / tracks[0].rate)
    inner = np.linspace(*ends, round((ends[1] - ends[0]) / step) + 1)[1:-1]
    stamps = np.concatenate(time)[order]
    edges = [stamps[0]] * 4, [stamps[-1]] * 4
    spline = make_lsq_spline(
        stamps, np.concatenate(values)[order], np.r_[edges[0], inner, edges[1]], k=3, w=np.concatenate(weights)[order]
    )
    grid = np.arange(np.ceil(stamps[0] / GRID_S), np.floor(stamps[-1] / GRID_S) + 1) * GRID_S
    shape = spline(grid)
    rest = shape[grid <= grid[0] + LEAD_S / 4].mean(axis=0)
    return PlatformTemplate(axes, grid, shape - rest, noise, len(tracks), scaled)


def aligned(track: PlatformTrack, guess: Alignment, template: PlatformTemplate, scaled: bool) -> Alignment:
    """The start, amplitude and, if `scaled`, duration with which a motion follows a shape, by Gauss and Newton."""
    measured, a = track.measured @ template.axes.T, guess if scaled else replace(guess, duration=1.0)
    r = measured.shape[1]
    for _ in range(ROUNDS):
        since = (track.time - a.start) / a.duration
        near = (since >= template.time[0]) & (since <= template.time[-1])
        shape, slope = template.at(since[near]), template.at(since[near], 1)
        amplitude = a.amplitude if abs(a.amplitude) > 0.1 else 1.0
        columns = [shape, -slope * amplitude / a.duration, -slope * since[near, None] * amplitude / a.duration]
        moving = np.stack([c.T.ravel() for c in columns[: 3 if scaled else 2]], axis=1)
        constant = np.repeat(np.eye(r), near.sum(), axis=0)
        design = np.hstack([moving, constant])
        linear = (measured[near] - amplitude * shape).T.ravel()
        change = np.linalg.lstsq(design, linear)[0]
        a = replace(
            a,
            amplitude=amplitude + float(change[0]),
            start=a.start + float(np.clip(change[1], -LARGEST_STEP_S, LARGEST_STEP_S)),
            duration=float(np.clip(a.duration + (change[2] if scaled else 0.0), 0.5, 2.0)),
            offset=change[-r:],
        )
    covariance = template.noise**2 * np.linalg.inv(design.T @ design)
    errors, shared = np.sqrt(np.diag(covariance)), float(covariance[1, 2])
    misfit, follows = misfit_of(track, a, template)
    return replace(
        a,
        start_se=float(errors[1]),
        duration_se=float(errors[2]) if scaled else 0.0,
        shared=shared if scaled else 0.0,
        misfit=misfit,
        follows=follows,
    )


def moved_start(a: Alignment, later: float) -> Alignment:
    """The alignment whose start is a point of the shape `later` [s] than now: more uncertain where durations are."""
    variance = a.start_se**2 + 2 * later * a.shared + (later * a.duration_se) ** 2
    return replace(
        a,
        start=a.start + later * a.duration,
        start_se=float(np.sqrt(variance)),
        shared=a.shared + later * a.duration_se**2,
    )


def misfit_of(track: PlatformTrack, a: Alignment, template: PlatformTemplate) -> tuple[float, bool]:
    """Mean square of the filtered difference between a motion and its shape over that of noise, and whether it is
    noise's."""
    difference = track.measured @ template.axes.T - a.offset - template.curve(track.time, a)
    since = (track.time - a.start) / a.duration
    near = (since >= template.time[0]) & (since <= template.time[-1])
    inside = near & (since <= template.time[-1] - 2 * track.spread)
    difference[~near] = 0.0
    filtered = track.low_pass(difference, track.rate)[inside]
    gain = noise_gain(track.low_pass, track.rate)
    before = filtered[since[inside] < template.time[0] + LEAD_S / 2]
    level = max(template.noise**2 * gain, float(np.mean(before**2)) if before.size else 0.0)
    misfit = float(np.mean(filtered**2)) / level
    independent = max(filtered.size * gain, 1.0)
    return misfit, bool(misfit < 1 + UNLIKE * np.sqrt(2 / independent))
