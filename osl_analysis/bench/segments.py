"""The segments of a stepped sine: what the joint really did, in whole cycles of one amplitude and frequency each."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.protocol.likeness import Likeness
from osl_analysis.protocol.runs import Run, SteppedSineProtocol
from osl_analysis.signals import longest_run, runs, sampling_rate
from osl_analysis.stats.covariance import FEWEST_CYCLES
from osl_analysis.stats.sinusoid import waves
from osl_analysis.timebase.grid import BRIDGE_MORE
from osl_analysis.trial import Array

SAME_FREQUENCY = 1e-3  # relative difference of frequencies that are one
SAME_PHASE = 2e-3  # part of a cycle by which a run may slip against a frequency that is taken for its own
SAME_AMPLITUDE = 0.15
"""Relative difference of two runs, next to one another in size, that have one label: what a bench loses at 5 Hz."""
TOUCHING = 0.3  # largest part of a cycle between two runs that follow one another without a rest
WHOLE, UPWARD = 0.15, 0.5
"""Deviation of a run from whole cycles, and of its phase [rad] at its start from 0, with which it is a plain sine."""


@dataclass(frozen=True)
class Segment:
    """Whole cycles of one amplitude at one frequency. Rows are counted in the record; they need not be whole."""

    amplitude: float  # measured amplitude [rad]
    frequency_hz: float  # frequency [Hz], the commanded one where the recorded one cannot be told from it
    start: float  # row at which the first cycle begins
    stop: float  # row at which the last one ends
    cycles: int  # number of cycles in between
    commanded: float | None = None  # amplitude of the protocol that it follows [rad]
    used: tuple[int, ...] = ()  # its cycles that are fitted, counted from 0; see `settled`

    @cached_property
    def edges(self) -> Array:
        """Where each cycle begins and the last one ends, shape (cycles + 1,). The first edge is a whole row.

        The others are not rounded: a cycle with a fraction of a row too many has a mean, and products of sine and
        cosine, that no other cycle has. At 250 Hz and 3 Hz the stated error of B was 5.8 times too large.
        """
        period = (self.stop - self.start) / self.cycles
        return np.asarray(np.rint(self.start) + period * np.arange(self.cycles + 1))

    @property
    def rows(self) -> slice:
        """Its rows, transient included."""
        return slice(round(self.start), round(self.stop))


def whole_rows(start: float, stop: float) -> slice:
    """The rows that lie between two edges at least in part, but for errors of rounding."""
    return slice(int(np.floor(start + 1e-6)), int(np.ceil(stop - 1e-6)))


def settled(segment: Segment, settle_cycles: int, usable: NDArray[np.bool_]) -> Segment:
    """The segment with the cycles that are `used`: not its first `settle_cycles` and not its last one; one is kept.

    The first cycles still contain the transient. Into the last one the zero-phase filter smears the beginning of the
    next frequency. Cycles with a row that is not `usable` (n,) are not used, nor are stretches between them with too
    few cycles for an interval where there is a longer one. The first edge of what is left is a whole row again.
    """
    before = min(settle_cycles, segment.cycles - 1)
    after = min(1, segment.cycles - before - 1)
    period = (segment.stop - segment.start) / segment.cycles
    count, start = segment.cycles - before - after, segment.start + before * period
    kept = replace(segment, start=start, stop=start + count * period, cycles=count)
    whole = np.array([bool(usable[whole_rows(a, b)].all()) for a, b in pairwise(kept.edges)])
    if not whole.any():
        raise InputError(
            f"no cycle of {np.rad2deg(segment.amplitude):.3g} deg at {segment.frequency_hz:g} Hz is free of rows near "
            f"a gap that is too long to be bridged; {BRIDGE_MORE}"
        )
    longest = longest_run(whole)
    fewest = min(longest.stop - longest.start, FEWEST_CYCLES)
    used = [k for run in runs(whole) if run.stop - run.start >= fewest for k in range(run.start, run.stop)]
    return replace(kept, used=tuple(used))


def labels_deg(segments: Sequence[Segment]) -> list[float]:
    """The measured amplitude [deg] by which each segment is named, to three digits: the median of all that share it.

    Segments share a label if they follow one commanded amplitude and no gap in size lies between them: two amplitudes
    are never one.
    """
    found = [0.0] * len(segments)
    for commanded in dict.fromkeys(segment.commanded for segment in segments):
        alike = sorted((s.amplitude, k) for k, s in enumerate(segments) if s.commanded == commanded)
        cuts = [k for k in range(1, len(alike)) if alike[k][0] > (1 + SAME_AMPLITUDE) * alike[k - 1][0]]
        for a, b in pairwise([0, *cuts, len(alike)]):
            label = float(f"{np.rad2deg(np.median([size for size, _ in alike[a:b]])):.3g}")
            for _, k in alike[a:b]:
                found[k] = label
    return found


def find_segments(
    time: Array, theta: Array, protocol: SteppedSineProtocol, known: Sequence[Run] | None = None
) -> list[Segment]:
    """The segments of a joint angle theta [rad] at uniform times [s], shape (n,) each, in the order of time.

    `known` are the runs of its `likeness`, where they are known already.

    Frequencies, their order, rests, ramps and numbers of cycles are as recorded. The protocol says which amplitudes
    are meant. A run of another amplitude is not used if all of the commanded ones were recorded.
    """
    rate = sampling_rate(time)
    found = Likeness(time, theta, protocol).runs if known is None else known
    check_amplitudes(theta, found, protocol, float(time[0]))
    followed = [(run, a) for run in found if (a := protocol.amplitude_near(run.amplitude)) is not None]
    frequencies = common_frequencies([run for run, _ in followed], protocol)
    segments = [
        Segment(run.amplitude, frequency, *placed(run, frequency, rate), run.whole_cycles, amplitude)
        for (run, amplitude), frequency in zip(followed, frequencies, strict=True)
    ]
    deviation = theta - np.mean(theta)
    aligned: list[Segment] = []
    for group in without_a_rest([run for run, _ in followed], segments):
        plain = all(is_plain(run) for run, _ in group)
        alike = [segment for _, segment in group]
        aligned += shifted(alike, best_start(deviation, alike, rate)) if plain else alike
    return aligned


def check_amplitudes(theta: Array, found: Sequence[Run], protocol: SteppedSineProtocol, begin: float) -> None:
    """Refuse an angle (n,) [rad] without a sine, and runs of another amplitude than a commanded one. `begin` is the
    time [s] of the first row."""
    commanded = ", ".join(f"{np.rad2deg(a):g}" for a in protocol.amplitudes)
    if not found:
        raise InputError(
            f"no sine was found: the joint angle moves by {np.rad2deg(np.ptp(theta)):.3g} deg in all, the protocol "
            f"says sines of {commanded} deg; check the channel and the unit of theta in the source file, and that "
            "the trial is a stepped sine"
        )
    others = [run for run in found if protocol.amplitude_near(run.amplitude) is None]
    recorded = {protocol.amplitude_near(run.amplitude) for run in found}
    if others and any(amplitude not in recorded for amplitude in protocol.amplitudes):
        run = others[0]
        raise InputError(
            f"the sine of {run.frequency_hz:.4g} Hz at {run.start + begin:.1f} s has an amplitude of "
            f"{run.amplitude_deg:.2f} deg, the protocol says {commanded} deg; correct `amplitudes_deg` in the "
            "configuration, or the angle's unit in the source file"
        )


def common_frequencies(found: Sequence[Run], protocol: SteppedSineProtocol) -> list[float]:
    """The frequency [Hz] of each run, the same for all runs that are alike.

    It is the commanded one where none of them slips against it, else the mean of those found: where the clock of the
    bench is off, the recorded frequency counts.
    """
    frequencies = []
    for run in found:
        alike = [other for other in found if abs(other.frequency_hz / run.frequency_hz - 1) < SAME_FREQUENCY]
        mean = float(np.average([r.frequency_hz for r in alike], weights=[r.cycles**2 for r in alike]))
        commanded = protocol.frequency_near(mean)
        slip = np.inf if commanded is None else abs(mean / commanded - 1) * max(r.cycles for r in alike)
        frequencies.append(float(commanded) if commanded is not None and slip < SAME_PHASE else float(f"{mean:.6g}"))
    return frequencies


def placed(run: Run, frequency_hz: float, rate: float) -> tuple[float, float]:
    """First and last edge, in rows at `rate` [Hz], of the whole cycles of a run, in the middle of the run."""
    length = run.whole_cycles / frequency_hz
    start = max((run.start + run.stop - length) / 2, 0.0)
    return start * rate, (start + length) * rate


def is_plain(run: Run) -> bool:
    """Whether a run is whole cycles of a sine that begins at its centre and rises."""
    return abs(run.cycles - run.whole_cycles) < WHOLE and abs(run.phase_at(run.start)) < UPWARD


def without_a_rest(found: Sequence[Run], segments: Sequence[Segment]) -> list[list[tuple[Run, Segment]]]:
    """Runs of one amplitude, with their segments, that follow one another without a rest, group by group."""
    pairs = list(zip(found, segments, strict=True))
    groups = [pairs[:1]]
    for (run, segment), (following, its) in pairwise(pairs):
        gap = (following.start - run.stop) * max(run.frequency_hz, following.frequency_hz)
        if gap < TOUCHING and segment.commanded == its.commanded:
            groups[-1].append((following, its))
        else:
            groups.append([(following, its)])
    return groups


def best_start(theta: Array, group: Sequence[Segment], rate: float) -> float:
    """Row at which a group of plain sines begins: there the angle (n,) [rad] agrees best with them."""
    template = unit_sines([(s.frequency_hz, s.cycles) for s in group], rate)
    reach = int(rate / max(s.frequency_hz for s in group) / 2)
    low = max(round(group[0].start) - reach, 0)
    near = theta[low : round(group[0].start) + reach + len(template)]
    if len(near) < len(template):
        return group[0].start
    return float(low + np.argmax(np.correlate(near, template, "valid")))


def shifted(group: Sequence[Segment], start: float) -> list[Segment]:
    """The segments of a group, one after the other from row `start` on."""
    lengths = [segment.stop - segment.start for segment in group]
    edges = start + np.cumsum([0.0, *lengths])
    return [replace(s, start=float(a), stop=float(b)) for s, a, b in zip(group, edges, edges[1:], strict=False)]


def unit_sines(sines: Sequence[tuple[float, float]], rate: float) -> Array:
    """Sines of unit amplitude, one after the other: frequency [Hz] and number of cycles of each, at `rate` [Hz]."""
    pieces = [waves(np.arange(round(cycles / f * rate)) / rate, f)[1] for f, cycles in sines]
    return np.concatenate(pieces)
