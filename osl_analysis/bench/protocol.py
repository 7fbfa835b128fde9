"""Finding the stepped-sine protocol in the recorded motion, wherever the recording begins."""

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
"""Largest relative deviation of a recorded amplitude from the commanded one. Some is lost to the dynamometer's
bandwidth."""
GOES_ON = 0.1
"""Largest misfit of a further cycle of the same sine, as a share of the sine's variance. A sine whose frequency is a
tenth higher has a misfit of 0.13."""


@dataclass(frozen=True)
class SteppedSineProtocol:
    """A stepped sine: at each amplitude a block of segments, one per frequency, without a pause between them."""

    amplitudes: tuple[float, ...]
    """Amplitude of each block [rad]."""
    frequencies_hz: tuple[float, ...]
    """Frequency of each segment of a block [Hz]."""
    cycles: int
    """Number of cycles in a segment."""


@dataclass(frozen=True)
class Segment:
    """Rows [start, stop) of one amplitude at one frequency."""

    amplitude: float
    """Commanded amplitude [rad]."""
    frequency_hz: float
    """Frequency [Hz]."""
    start: int
    """First row."""
    stop: int
    """Row after the last one."""
    cycles: int
    """Number of cycles in these rows."""

    @property
    def amplitude_deg(self) -> float:
        """Commanded amplitude [deg] as tables show it: 6 and not 6.000000000000001."""
        return round(float(np.rad2deg(self.amplitude)), 9)

    @property
    def rows(self) -> slice:
        """The rows of the segment."""
        return slice(self.start, self.stop)


@dataclass(frozen=True)
class Block:
    """The segments of one amplitude, which follow one another without a gap."""

    amplitude: float
    """Commanded amplitude [rad]."""
    segments: tuple[Segment, ...]
    """One segment per frequency, in the order of the protocol."""

    @property
    def amplitude_deg(self) -> float:
        """Commanded amplitude [deg] as tables show it."""
        return self.segments[0].amplitude_deg

    @property
    def rows(self) -> slice:
        """The rows of all segments."""
        return slice(self.segments[0].start, self.segments[-1].stop)


def find_blocks(time: Array, theta: Array, protocol: SteppedSineProtocol) -> tuple[Block, ...]:
    """Rows of each amplitude's block in the joint angle theta [rad] at uniform times [s], shape (n,) each.

    The angle is correlated with one block of unit amplitude. Where a block begins, the correlation equals its
    amplitude. The highest peaks that do not overlap, in the order of time, must match the protocol.

    Raises
    ------
    InputError
        The trial is too short, the amplitudes found are not those of the protocol, or a sine has more cycles.
    """
    rate = sampling_rate(time)
    template = unit_block(protocol, rate)
    needed = len(protocol.amplitudes) * len(template)
    if len(theta) < needed:
        raise InputError(
            f"the trial lasts {len(theta) / rate:.1f} s, the protocol {needed / rate:.1f} s; "
            "correct the protocol in the configuration, or record the whole trial"
        )
    matched = fftconvolve(theta - np.mean(theta), template[::-1], mode="valid") / float(template @ template)
    starts = highest_peaks(matched, len(protocol.amplitudes), len(template))
    blocks = tuple(
        Block(amplitude, block_segments(start, amplitude, protocol, rate))
        for start, amplitude in zip(starts, protocol.amplitudes, strict=True)
    )
    for block in blocks:
        check_cycles(time, theta, block)
        check_amplitude(float(matched[block.rows.start]), block.amplitude, float(time[block.rows.start]))
    return blocks


def unit_block(protocol: SteppedSineProtocol, rate: float) -> Array:
    """One block of unit amplitude, sampled at `rate` [Hz]."""
    pieces = [
        np.sin(2 * np.pi * f * np.arange(round(protocol.cycles / f * rate)) / rate) for f in protocol.frequencies_hz
    ]
    return np.concatenate(pieces)


def highest_peaks(matched: Array, count: int, apart: int) -> list[int]:
    """Rows of the `count` highest values that are 98 % of `apart` rows apart or more, in the order of time."""
    remaining, clearance = matched.copy(), int(0.98 * apart)
    starts = []
    for _ in range(count):
        best = int(np.argmax(remaining))
        starts.append(best)
        remaining[max(best - clearance, 0) : best + clearance] = -np.inf
    return sorted(starts)


def check_cycles(time: Array, theta: Array, block: Block) -> None:
    """Refuse a sine with more cycles than the protocol says: it goes on where another frequency or a rest is due."""
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
    """Number of whole cycles by which the segment's sine extends before it (side -1) or after it (1).

    0 if the segment itself is not such a sine.
    """
    period = (segment.stop - segment.start) / segment.cycles
    turn = 2 * np.pi / period
    inside = np.arange(segment.start, segment.stop)
    middle = float(np.mean(theta[inside]))
    phasor = 2 * complex(np.mean(theta[inside] * np.exp(-1j * turn * inside)))

    def is_sine(rows: NDArray[np.intp]) -> bool:
        """Whether the angle in these rows is the segment's sine."""
        left = theta[rows] - middle - np.real(phasor * np.exp(1j * turn * rows))
        return float(np.mean(left**2)) < GOES_ON * abs(phasor) ** 2 / 2

    if not is_sine(inside):
        return 0
    starts = np.arange(segment.stop, len(theta) - period, period)
    if side < 0:
        starts = np.arange(segment.start - period, 0, -period)
    cycle = np.arange(round(period))
    return next((k for k, start in enumerate(starts) if not is_sine(round(start) + cycle)), len(starts))


def check_amplitude(recorded: float, commanded: float, start: float) -> None:
    """Refuse a recorded amplitude [rad] that is not the commanded one, in the block that begins at `start` [s]."""
    if not abs(recorded - commanded) <= AMPLITUDE_TOLERANCE * commanded:
        raise InputError(
            f"the block at {start:.1f} s has an amplitude of {np.rad2deg(recorded):.2f} deg, the protocol says "
            f"{np.rad2deg(commanded):g} deg; correct the protocol in the configuration, or the angle's unit in the "
            "source file"
        )


def block_segments(start: int, amplitude: float, protocol: SteppedSineProtocol, rate: float) -> tuple[Segment, ...]:
    """The segments of a block that starts at row `start`."""
    ends = np.cumsum([0.0, *(protocol.cycles / f for f in protocol.frequencies_hz)]) * rate
    rows = start + np.rint(ends).astype(int)
    return tuple(
        Segment(amplitude, f, int(a), int(b), protocol.cycles)
        for f, a, b in zip(protocol.frequencies_hz, rows, rows[1:], strict=False)
    )


def settled(blocks: Sequence[Block], settle_cycles: int) -> tuple[Segment, ...]:
    """All segments without their first `settle_cycles` cycles and without their last one; one cycle at least is kept.

    The first cycles still contain the transient. Into the last one the zero-phase filter smears the beginning of the
    next frequency.
    """
    return tuple(
        trimmed_segment(segment, min(settle_cycles, segment.cycles - 1), 1)
        for block in blocks
        for segment in block.segments
    )


def trimmed_segment(segment: Segment, before: int, after: int) -> Segment:
    """The segment without its first `before` and, where more than one cycle is left, its last `after` cycles."""
    after = min(after, segment.cycles - before - 1)
    edges = cycle_edges(segment)
    stop = int(edges[segment.cycles - after])
    return replace(segment, start=int(edges[before]), stop=stop, cycles=segment.cycles - before - after)


def cycle_edges(segment: Segment) -> Array:
    """First row of each cycle and the end of the last one, shape (cycles + 1,)."""
    return np.asarray(np.rint(np.linspace(segment.start, segment.stop, segment.cycles + 1)))


def rows_of(segments: Sequence[Segment]) -> NDArray[np.intp]:
    """Rows of the segments, one after the other."""
    return np.concatenate([np.r_[segment.rows] for segment in segments])


def repeated_cycles(segments: Sequence[Segment], every: int = 1, skip: int = 0) -> Cycles | None:
    """The cycles among the rows of the segments (`rows_of`); None if a segment has fewer than five.

    Of each segment only every `every`-th row counts, and of these not the first `skip`. This serves signals that were
    thinned and then lost samples at the start to a filter.
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
