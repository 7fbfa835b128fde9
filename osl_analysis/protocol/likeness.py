"""How much the motion of a joint is like a stepped sine: which share of it is sines, and which those commanded."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from osl_analysis.protocol.runs import FEWEST_CYCLES, Run, SteppedSineProtocol, find_runs, noise_of, upward_crossings
from osl_analysis.trial import Array

Kind = Literal["stepped sine", "unclear", "other"]
BIN_S = 0.25  # time [s] within which a joint that moves turns measurably
MOVES = 0.02
"""Share of the largest turn that it makes in this time; at the peak of a sine of 1 Hz it makes a seventh of its own."""
STEADY = 0.01
"""Largest relative difference of the frequencies of the two halves of a sine; those of a sweep differ by more."""
PURE = 0.08  # largest misfit of a sine that was not commanded, as a share of its own RMS; that of a triangle is 0.12
FEWEST_OF_A_HALF = 2  # number of crossings in each half of a run that tell its frequency
MOSTLY, HARDLY = 0.5, 0.25
"""Shares of the moving time in sines: above the one a motion is a stepped sine, below the other it is not."""
AS_COMMANDED = 0.6
"""Share of the moving time in cycles of a commanded frequency and amplitude, from which a damaged stepped sine is
likely. Noise of 0.5 to 6 Hz has up to 0.4 of them by chance."""
PIECE_S = 4.0  # time [s] of the pieces whose spectra are compared with the commanded frequencies
ONE_LINE = 0.85
"""Mean share of a piece's power at one commanded frequency, from which a damaged stepped sine is likely: a stepped sine
has 0.95 beside spikes, hum and a wandering angle, a sweep 0.7 to 0.8, noise less."""
WON = 0.6
"""Share of a piece's power at one commanded frequency that it holds for its own, and share of the commanded
frequencies of which a damaged stepped sine has such pieces."""


@dataclass(frozen=True)
class Likeness:
    """Likeness of a joint angle to a stepped sine: shares of the moving time, 0 to 1. Each is found when it is asked
    for, and most motions are known for what they are by the first."""

    recorded: Array  # uniform times (n,) [s]
    theta: Array  # joint angle (n,) [rad]
    protocol: SteppedSineProtocol  # what was commanded

    @property
    def time(self) -> Array:
        return np.asarray(self.recorded - self.recorded[0])

    @cached_property
    def noise(self) -> float:
        """Standard deviation [rad] of the angle's noise."""
        return noise_of(self.theta)

    @cached_property
    def moving(self) -> NDArray[np.bool_]:
        return moving_bins(self.time, self.theta, self.noise)

    @cached_property
    def crossings(self) -> Array:
        """Times [s] at which the angle rises through its centre."""
        return upward_crossings(self.time, self.theta, self.noise)

    @cached_property
    def runs(self) -> list[Run]:
        """What the joint did, as `find_runs` has it, of three cycles or as few as were commanded."""
        fewest = min(FEWEST_CYCLES, int(min(self.protocol.cycles_at, default=FEWEST_CYCLES)))
        return find_runs(self.time, self.theta, fewest, self.crossings)

    @property
    def moves(self) -> bool:
        return bool(self.moving.any())

    @cached_property
    def sines(self) -> float:
        """In sines of three cycles or more, each of one frequency and amplitude."""
        if not self.moves:
            return 0.0
        found = [run for run in self.runs if is_sine(run, self.crossings, self.protocol)]
        return share_of(self.moving, self.time, [(run.start, run.stop) for run in found])

    @cached_property
    def commanded(self) -> float:
        """In single cycles of a commanded frequency and amplitude."""
        time = self.time
        cycles = ((self.theta[rows_between(time, *cycle)], cycle) for cycle in pairwise(self.crossings))
        found = [cycle for angle, cycle in cycles if as_commanded(angle, cycle, self.protocol)]
        return share_of(self.moving, self.time, found)

    @cached_property
    def one_line(self) -> float:
        """Power at one commanded frequency at a time, as a share of all; 0 if most of them never come."""
        return one_line_share(self.time, self.theta, self.protocol)

    @property
    def kind(self) -> Kind:
        """`stepped sine`; `unclear` where sines, commanded cycles or frequencies are in a part of it, or where nothing
        moves; else `other`."""
        if self.sines > MOSTLY:
            return "stepped sine"
        if not self.moves:
            return "unclear"
        damaged = self.sines > HARDLY or self.commanded > AS_COMMANDED or self.one_line > ONE_LINE
        return "unclear" if damaged else "other"


def moving_bins(time: Array, theta: Array, noise: float | None = None) -> NDArray[np.bool_]:
    """Rows (n,) of a joint angle theta [rad] at times [s] in which the joint moves, in bins of `BIN_S`. A bin in which
    a sensor at rest only rounds or makes noise does not count. `noise` is that of `noise_of`, where it is known
    already."""
    bins = np.floor((time - time[0]) / BIN_S)
    first = np.flatnonzero(np.concatenate([[True], bins[1:] != bins[:-1]]))
    turn = np.maximum.reduceat(theta, first) - np.minimum.reduceat(theta, first)
    noise = noise_of(theta) if noise is None else noise
    moves = turn > max(MOVES * float(np.ptp(theta)), 12 * noise)
    return np.asarray(np.repeat(moves, np.diff(np.append(first, len(theta)))))


def rows_between(time: Array, start: float, stop: float) -> slice:
    return slice(*(int(row) for row in np.searchsorted(time, [start, stop])))


def share_of(moving: NDArray[np.bool_], time: Array, parts: Sequence[tuple[float, float]]) -> float:
    """Share of the moving rows (n,) that lie in parts, from a time [s] to another one."""
    inside = np.zeros_like(moving)
    for part in parts:
        inside[rows_between(time, *part)] = True
    return float(np.count_nonzero(inside & moving) / np.count_nonzero(moving))


def as_commanded(theta: Array, cycle: tuple[float, float], protocol: SteppedSineProtocol) -> bool:
    """Whether the angle (n,) [rad] of a cycle, from a time [s] to another one, is one that was commanded."""
    half, frequency = (float(np.ptp(theta)) / 2 if theta.size else 0.0), 1 / (cycle[1] - cycle[0])
    return bool(half) and protocol.frequency_near(frequency) is not None and protocol.amplitude_near(half) is not None


def is_sine(run: Run, crossings: Array, protocol: SteppedSineProtocol) -> bool:
    """Whether a run is a sine of one frequency: one that was commanded, or a pure one; `crossings` are its upward ones
    [s]."""
    commanded = protocol.frequency_near(run.frequency_hz) and protocol.amplitude_near(run.amplitude)
    return is_steady(run, crossings) and bool(commanded or run.misfit < PURE * run.amplitude / np.sqrt(2))


def is_steady(run: Run, crossings: Array) -> bool:
    """Whether both halves of a run have one frequency, by its upward crossings [s]; those of a sweep differ."""
    margin = 0.1 / run.frequency_hz
    own = crossings[(crossings > run.start - margin) & (crossings < run.stop + margin)]
    middle = len(own) // 2
    if middle < FEWEST_OF_A_HALF:
        return True
    periods = (own[middle] - own[0]) / middle, (own[-1] - own[middle]) / (len(own) - 1 - middle)
    return bool(max(periods) / min(periods) - 1 < STEADY)


def one_line_share(time: Array, theta: Array, protocol: SteppedSineProtocol) -> float:
    """Mean over pieces of the largest share of power of the angle (n,) [rad] at one commanded frequency. Power counts
    from below the slowest to above the fastest commanded frequency. 0 if fewer than `WON` of the commanded frequencies
    prevail in a piece, as they do in turn in a stepped sine."""
    rate, commanded = (len(time) - 1) / float(time[-1]), np.unique(protocol.frequencies_hz)
    n = round(PIECE_S * rate)
    f = np.fft.rfftfreq(n, 1 / rate)
    band = (f >= 0.6 * commanded[0]) & (f <= 1.5 * commanded[-1])
    near = np.abs(f[:, None] - commanded) <= np.maximum(0.05 * commanded, 1.01 / PIECE_S)
    shares, most = [], MOVES * float(np.ptp(theta))
    for start in range(0, len(theta) - n + 1, n // 2):
        piece = theta[start : start + n]
        power = np.abs(np.fft.rfft(np.hanning(n) * (piece - piece.mean()))) ** 2
        if np.ptp(piece) > most and power[band].sum() > 0:
            shares.append((power[:, None] * near).sum(axis=0) / power[band].sum())
    if not shares:
        return 0.0
    won = np.count_nonzero((np.array(shares) > WON).any(axis=0))
    return float(np.max(shares, axis=1).mean()) if won >= WON * len(commanded) else 0.0
