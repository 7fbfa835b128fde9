"""Finding the stepped-sine protocol in the recorded motion: nothing relies on when the recorder was started."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve

from osl_analysis.errors import InputError
from osl_analysis.signals import sampling_rate
from osl_analysis.stats.covariance import FEWEST_CYCLES, Cycles
from osl_analysis.trial import Array

AMPLITUDE_TOLERANCE = 0.25
"""Largest relative deviation of a recorded amplitude from the commanded one: a dynamometer's bandwidth costs some."""
GOES_ON = 0.1
"""Share of a sine's variance by which a further cycle may miss it; one of a tenth more in frequency misses by 0.13."""


@dataclass(frozen=True)
class SteppedSine:
    """The protocol: at each amplitude [rad], `cycles` cycles at each frequency [Hz] without pause between them."""

    amplitudes: tuple[float, ...]
    frequencies_hz: tuple[float, ...]
    cycles: int


@dataclass(frozen=True)
class Segment:
    """Rows [start, stop) of the `cycles` cycles of one frequency [Hz] at one commanded amplitude [rad]."""

    amplitude: float
    frequency_hz: float
    start: int
    stop: int
    cycles: int

    @property
    def amplitude_deg(self) -> float:
        """The amplitude [deg] as it labels tables: 6 and not 6.000000000000001."""
        return round(float(np.rad2deg(self.amplitude)), 9)

    @property
    def rows(self) -> slice:
        return slice(self.start, self.stop)


@dataclass(frozen=True)
class Block:
    """The segments of one amplitude [rad], which follow one another without a gap."""

    amplitude: float
    segments: tuple[Segment, ...]

    @property
    def amplitude_deg(self) -> float:
        """As of its segments."""
        return self.segments[0].amplitude_deg

    @property
    def rows(self) -> slice:
        return slice(self.segments[0].start, self.segments[-1].stop)


def find_blocks(time: Array, theta: Array, protocol: SteppedSine) -> tuple[Block, ...]:
    """Where in the joint angle theta [rad] at uniform times [s], shape (n,), each amplitude's block lies.

    The angle is correlated with one block of unit amplitude: at a block the correlation is the block's
    amplitude. The highest peaks that do not overlap, in the order of time, must match the protocol.

    Raises
    ------
    InputError
        The record is too short, the amplitudes found are not those of the protocol, or a sine has more cycles.
    """
    rate = sampling_rate(time)
    template = unit_block(protocol, rate)
    needed = len(protocol.amplitudes) * len(template)
    if len(theta) < needed:
        raise InputError(
            f"the record lasts {len(theta) / rate:.1f} s, the protocol {needed / rate:.1f} s; "
            "correct the protocol in the configuration, or record the whole trial"
        )
    matched = fftconvolve(theta - np.mean(theta), template[::-1], mode="valid") / float(template @ template)
    starts = highest_peaks(matched, len(protocol.amplitudes), len(template))
    blocks = tuple(
        Block(amplitude, split(start, amplitude, protocol, rate))
        for start, amplitude in zip(starts, protocol.amplitudes, strict=True)
    )
    for block in blocks:
        check_cycles(time, theta, block)
        check_amplitude(float(matched[block.rows.start]), block.amplitude, float(time[block.rows.start]))
    return blocks


def unit_block(protocol: SteppedSine, rate: float) -> Array:
    """One block of unit amplitude, sampled at `rate` [Hz]."""
    pieces = [
        np.sin(2 * np.pi * f * np.arange(round(protocol.cycles / f * rate)) / rate) for f in protocol.frequencies_hz
    ]
    return np.concatenate(pieces)


def highest_peaks(matched: Array, count: int, apart: int) -> list[int]:
    """Rows of the `count` highest values that lie at least (almost) a block apart, in the order of time."""
    remaining = matched.copy()
    starts = []
    for _ in range(count):
        best = int(np.argmax(remaining))
        starts.append(best)
        clearance = int(0.98 * apart)
        remaining[max(best - clearance, 0) : best + clearance] = -np.inf
    return sorted(starts)


def check_cycles(time: Array, theta: Array, block: Block) -> None:
    """Refuse a sine that goes on where the protocol has another frequency or a rest: more cycles than it says."""
    around = [0.0, *(segment.frequency_hz for segment in block.segments), 0.0]
    more = {}
    for segment, before, after in zip(block.segments, around, around[2:], strict=False):
        others = {-1: before, 1: after}
        sides = [side for side, other in others.items() if abs(other / segment.frequency_hz - 1) >= GOES_ON]
        more[segment] = sum(cycles_beyond(theta, segment, side) for side in sides)
    worst = max(more, key=more.__getitem__)
    if more[worst]:
        raise InputError(
            f"the sine of {worst.frequency_hz:g} Hz at {time[worst.start]:.1f} s goes on for about "
            f"{worst.cycles + more[worst]} cycles, the protocol says {worst.cycles}; correct `cycles` in the "
            "configuration"
        )


def cycles_beyond(theta: Array, segment: Segment, side: int) -> int:
    """Whole cycles of the segment's sine before it (side -1) or after it (1); 0 where the segment is no such sine."""
    period = (segment.stop - segment.start) / segment.cycles
    turn = 2 * np.pi / period
    inside = np.arange(segment.start, segment.stop)
    middle = float(np.mean(theta[inside]))
    phasor = 2 * complex(np.mean(theta[inside] * np.exp(-1j * turn * inside)))

    def is_sine(rows: NDArray[np.intp]) -> bool:
        left = theta[rows] - middle - np.real(phasor * np.exp(1j * turn * rows))
        return float(np.mean(left**2)) < GOES_ON * abs(phasor) ** 2 / 2

    if not is_sine(inside):
        return 0
    starts = np.arange(segment.stop, len(theta) - period, period)
    if side < 0:
        starts = np.arange(segment.start - period, 0, -period)
    cycle = np.arange(round(period))
    return next((k for k, start in enumerate(starts) if not is_sine(round(start) + cycle)), len(starts))


def check_amplitude(found: float, commanded: float, start: float) -> None:
    """Refuse an amplitude [rad] that is not the commanded one, at the block starting at `start` [s]."""
    if not abs(found - commanded) <= AMPLITUDE_TOLERANCE * commanded:
        raise InputError(
            f"the block at {start:.1f} s has an amplitude of {np.rad2deg(found):.2f} deg, the protocol says "
            f"{np.rad2deg(commanded):g} deg; correct the protocol in the configuration, or the angle's unit in the "
            "source file"
        )


def split(start: int, amplitude: float, protocol: SteppedSine, rate: float) -> tuple[Segment, ...]:
    """The segments of a block that starts at row `start`."""
    ends = np.cumsum([0.0, *(protocol.cycles / f for f in protocol.frequencies_hz)]) * rate
    rows = start + np.rint(ends).astype(int)
    return tuple(
        Segment(amplitude, f, int(a), int(b), protocol.cycles)
        for f, a, b in zip(protocol.frequencies_hz, rows, rows[1:], strict=False)
    )


def settled(blocks: Sequence[Block], settle_cycles: int) -> tuple[Segment, ...]:
    """All segments without what is not periodic: `settle_cycles` at their start, and the last cycle.

    Into the last cycle the zero-phase filter smears the next frequency's beginning. One cycle at least is kept.
    """
    return tuple(
        trimmed(segment, min(settle_cycles, segment.cycles - 1), 1) for block in blocks for segment in block.segments
    )


def trimmed(segment: Segment, before: int, after: int) -> Segment:
    """The segment without its first `before` and, where it has more than one left, its last `after` cycles."""
    after = min(after, segment.cycles - before - 1)
    edges = cycle_edges(segment)
    stop = int(edges[segment.cycles - after])
    return replace(segment, start=int(edges[before]), stop=stop, cycles=segment.cycles - before - after)


def cycle_edges(segment: Segment) -> Array:
    """Rows at which the cycles begin, and the end of the last: (cycles + 1,)."""
    return np.asarray(np.rint(np.linspace(segment.start, segment.stop, segment.cycles + 1)))


def rows_of(segments: Sequence[Segment]) -> NDArray[np.intp]:
    """Rows of the segments, one after the other."""
    return np.concatenate([np.r_[segment.rows] for segment in segments])


def cycles_of(segments: Sequence[Segment], every: int = 1, skip: int = 0) -> Cycles | None:
    """The cycles in the rows of the segments, one after the other; None with fewer than five in a segment.

    Of each segment every `every`-th row counts, and of those not the first `skip`: for signals that were thinned out
    and then lost a filter's start.
    """
    if min(segment.cycles for segment in segments) < FEWEST_CYCLES:
        return None
    first, offset = [], 0
    for segment in segments:
        edges = np.ceil((cycle_edges(segment) - segment.start) / every) - skip
        first.append(offset + np.maximum(edges[:-1], 0))
        offset += int(edges[-1])
    stratum = np.repeat(np.arange(len(segments)), [segment.cycles for segment in segments])
    return Cycles(np.concatenate(first).astype(np.intp), stratum)
