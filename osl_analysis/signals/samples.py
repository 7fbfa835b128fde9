"""When the samples of a stream were taken: at true stamps, on the even clock of the device, or on
the clock of a slower source whose values the log repeats."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.signals.device_clock import DeviceClock
from osl_analysis.signals.held_values import HeldValues, held_values
from osl_analysis.signals.sample_count import missing_by_rhythm, places_of_samples
from osl_analysis.signals.stamp_evidence import StampEvidence, evidence_by_signal
from osl_analysis.signals.stamp_reading import Reading, reading_by_stamps, reading_of
from osl_analysis.signals.stream import Stream
from osl_analysis.trial import Array

CLOSE_STAMPS = 0.5  # steps; closer samples are merged: close knots of a spline amplify noise
SAME_BEAT = 0.05  # steps of the log; a beat that leaves less leaves no doubt about held values
COUNTABLE = 0.1  # steps of scatter, beyond which a missing sample may be taken for a late one
NEVER_PROMPT = 3  # steps of scatter (SD), beyond which hardly a sample is prompt
# Differences between the rates of two devices that are too large for clocks, too small for intent
RATE_DIFFERENCE = (2e-4, 0.1)


@dataclass(frozen=True)
class Taken:
    """Signals of a stream with the stream's clock, and how their stamps are taken."""

    stream: Stream
    clock: DeviceClock
    signals: tuple[str, ...]  # names; they lack values in the same rows
    even: bool  # whether the device samples evenly; else the stamps are true
    # whether this is stated, or seen in the signals; else the other hypothesis may be right
    firm: bool
    matters: bool  # whether the two hypotheses differ
    why: str  # one sentence for the provenance
    # per signal; empty if none was needed
    evidence: Mapping[str, StampEvidence] = field(default_factory=dict)
    repeated: int = 0  # number of rows that were written twice
    delay: float = 0.0  # [s] by which the samples are older than their times
    # [loops] by which samples are older than their true stamps, by the signals' evidence
    age: float = 0.0
    # rows per value if the log repeats each; None: every row has its own value
    held: float | None = None
    unsure: float = 0.0  # [s] by which held values may be older than assumed

    def other(self) -> "Taken":
        """The same samples under the other hypothesis."""
        if self.unsure:
            return replace(self, delay=self.delay + self.unsure, unsure=-self.unsure)
        return replace(self, even=not self.even, why=f"the other hypothesis to: {self.why}")

    @property
    def times(self) -> Array:
        """When the rows were sampled, (n,) [s], without the delay."""
        return self.clock.times() if self.even else self.clock.aged(self.age)

    @cached_property
    def present(self) -> NDArray[np.bool_]:
        """Rows (n,) in which the signals have values."""
        return np.asarray(~np.isnan(self.stream.signals[self.signals[0]]))

    @cached_property
    def stride(self) -> int:
        """Rows from one value to the next: more than 1 if signals of a lower rate share the rows of
        a faster one."""
        return int(np.median(np.diff(self.clock.count[self.present])))

    @property
    def step(self) -> float:
        """Usual step [s] from one value to the next."""
        return self.clock.step * self.stride

    @property
    def clearest_evidence(self) -> StampEvidence | None:
        """The evidence of the signal with the smallest standard error."""
        return min(self.evidence.values(), key=lambda signal: signal.se, default=None)

    @cached_property
    def samples(self) -> tuple[Array, dict[str, Array], int]:
        """Rising times (k,) [s] of the samples, minus the delay; their values (k,) by signal,
        without silent ones; and the number of samples merged because their true stamps are so
        close."""
        values = {
            name: self.stream.signals[name][self.present]
            for name in self.signals
            if name in self.stream.signals and name not in self.stream.silent
        }
        times = self.times[self.present]
        merged = 0
        if not self.even:
            begins = begins_of_groups(times, CLOSE_STAMPS * self.step)
            merged = len(times) - len(begins)
            if merged:
                sizes = np.diff(np.append(begins, len(times)))
                values = {
                    name: np.add.reduceat(signal, begins) / sizes for name, signal in values.items()
                }
                times = np.add.reduceat(times, begins) / sizes
        return times - self.delay, values, merged


def begins_of_groups(times: Array, closest: float) -> NDArray[np.intp]:
    """First rows (k,) of groups of times (n,) [s]: a group is what lies within `closest` [s] of its
    first sample."""
    begins = np.concatenate([[True], np.diff(times) >= closest])
    start = 0.0
    for row in np.flatnonzero(~begins):
        if begins[row - 1]:
            start = times[row - 1]
        begins[row] = times[row] - start >= closest
    return np.flatnonzero(begins)


def take(streams: Sequence[Stream]) -> list[Taken]:
    """Decide for every stream when its samples were taken.

    Parameters
    ----------
    streams : Sequence of Stream
        All that are brought on one grid.

    Returns
    -------
    list of Taken
        A stream is split by delay and by rows with missing values.

    Raises
    ------
    InputError
        As `places_of_samples` and `check_countable`.
    """
    taken = [part for stream in streams for part in take_stream(stream)]
    if len(streams) > 1 or len({part.even for part in taken}) > 1:
        fastest = max(1 / part.clock.step for part in taken)
        for part in taken:
            check_countable(part, fastest)
    return taken


def take_stream(recorded: Stream) -> list[Taken]:
    """Decide when the samples of one stream were taken."""
    stream = recorded.without_repeats()
    repeated = len(recorded.stamps) - len(stream.stamps)
    clock = clock_of(stream)
    held = signals_of_slower_sources(stream, clock.step)
    own_rows = {name: values for name, values in stream.signals.items() if name not in held}

    row_times = stream.stamps
    of_rows = list[Taken]()
    if own_rows:
        decided = decide(replace(stream, signals=own_rows), clock)
        row_times = decided.times
        of_rows = [
            replace(decided, signals=names, repeated=repeated, delay=stream.delays.get(names[0], 0))
            for names in names_with_equal_samples(stream, own_rows)
        ]
    of_held = [
        held_taken(stream, name, values, row_times, clock.step) for name, values in held.items()
    ]
    if len(of_rows) + len(held) > 1:
        of_rows = [with_name_of_signals(part, stream) for part in of_rows]
    return [*of_held, *of_rows]


def clock_of(stream: Stream) -> DeviceClock:
    """The clock of a stream without repeats, from the trial's cache if it is known."""
    key = stream.stamps.tobytes()
    if stream.counter is not None:
        key += stream.counter.tobytes()
    clock: DeviceClock | None = stream.clocks.get(key)
    if clock is None:
        is_counted = stream.counter is not None
        clock = DeviceClock(stream.stamps, places_of_samples(stream), is_counted)
        stream.clocks[key] = clock
    return clock


def signals_of_slower_sources(stream: Stream, step: float) -> dict[str, HeldValues]:
    """The values of signals that the log repeats, because their sources are slower than its rows.

    Silent signals and those with missing values are left out.
    """
    held = {}
    for name, signal in stream.signals.items():
        if name in stream.silent or np.isnan(signal).any():
            continue
        values = held_values(signal, step)
        if values is not None:
            held[name] = values
    return held


def names_with_equal_samples(stream: Stream, names: Iterable[str]) -> list[tuple[str, ...]]:
    """Groups of signals with the same delay and the same missing rows, in their order."""
    groups: dict[tuple[float, bytes], list[str]] = {}
    for name in names:
        key = (stream.delays.get(name, 0.0), np.isnan(stream.signals[name]).tobytes())
        groups.setdefault(key, []).append(name)
    return [tuple(group) for group in groups.values()]


def with_name_of_signals(part: Taken, stream: Stream) -> Taken:
    """Say in the stream's name which of its signals these are."""
    signals = {name: stream.signals[name] for name in part.signals}
    name = f"{stream.name} [{', '.join(signals)}]"
    return replace(part, stream=replace(stream, name=name, signals=signals))


def held_taken(stream: Stream, name: str, held: HeldValues, row_times: Array, step: float) -> Taken:
    """Take a held signal at its own rate.

    If its source samples evenly, each value was taken at its first row or less than one step of the
    log earlier. The beat of the two rates narrows this to one clock. If the rates keep step, the
    first rows are taken, and only a stated delay makes this firm. Values of an uneven source are
    taken half a step older.

    Parameters
    ----------
    row_times : Array
        When the rows (n,) of the log were sampled [s].
    step : float
        Of the log [s].
    """
    stamps = np.interp(held.rows, np.arange(len(row_times)), row_times)
    clock = DeviceClock(stamps, np.arange(len(stamps)))
    late = stamps - clock.times()
    low, high = (float(value) for value in np.quantile(late, (0.005, 0.995)))
    is_even = high - low < 2 * step

    # time within a step of the log that the beat leaves open
    open_s = step - (high - low)
    is_open = open_s > SAME_BEAT * step and name not in stream.delays
    unsure = open_s if is_open else 0.0
    if unsure:
        when = f"the first of them, or up to {unsure * 1e3:.3g} ms before"
    else:
        when = "known by where it changes"
    why = f"held: each value stands for {held.period:.4g} rows, its time is {when}"
    if not is_even:
        why = f"undecided, true: {why}, uneven"
        older = step / 2
    elif open_s > 0:
        older = -low
    else:
        older = step / 2 - float(np.mean(late))
    return Taken(
        stream=replace(
            stream,
            name=f"{stream.name} [{name}]",
            stamps=stamps,
            signals={name: held.values},
            counter=None,
        ),
        clock=clock,
        signals=(name,),
        even=is_even,
        firm=is_even and not unsure,
        matters=True,
        why=why,
        delay=stream.delays.get(name, 0.0) + older,
        held=held.period,
        unsure=unsure,
    )


def decide(stream: Stream, clock: DeviceClock) -> Taken:
    """Make one decision for all signals of a stream; a stated choice stands."""
    evidence = dict[str, StampEvidence]()
    reading: Reading | None = Reading(
        stream.choice == "even", 0.0, True, f"stated: {stream.choice}"
    )
    if stream.choice == "auto":
        reading = reading_by_stamps(clock)
    if reading is None:
        heard = {
            name: values for name, values in stream.signals.items() if name not in stream.silent
        }
        evidence = evidence_by_signal(heard, clock)
        reading = reading_of(clock, evidence)
    return Taken(stream, clock, tuple(stream.signals), evidence=evidence, **reading._asdict())


def check_countable(taken: Taken, fastest_hz: float) -> None:
    """Refuse one of several devices if its host is late and loses samples, and no counter tells
    which.

    If waits hide the rhythm of the stamps, it is refused if samples seem to be missing, or if its
    rate is below the fastest one by a share too large for clocks and too small to be intended. If
    even stamps are late by more than three steps (SD), it is always refused: hardly a sample is
    prompt, and all times are late by an unknown wait.
    """
    clock = taken.clock
    best = taken.clearest_evidence
    is_even = taken.even if best is None else best.g <= 0.5
    is_late = clock.scatter > COUNTABLE * clock.step
    if not (is_even and is_late) or taken.held or clock.counted:
        return

    missing = missing_by_rhythm(clock.stamps)
    slower = 1 - 1 / clock.step / fastest_hz
    seems_to_miss = clock.missing or RATE_DIFFERENCE[0] < slower < RATE_DIFFERENCE[1]
    if missing or (missing is not None and clock.missing):
        loss = f"about {missing or clock.missing} samples are missing"
    elif clock.scatter > NEVER_PROMPT * clock.step or (missing is None and seems_to_miss):
        loss = "it cannot be seen whether samples are missing"
    else:
        return
    raise InputError(
        f"{taken.stream.name}: the host's stamps are late by {clock.scatter * 1e3:.2f} ms (SD) at a"
        f" step of {clock.step * 1e3:.2f} ms, and {loss}: beside another device nothing tells which"
        " sample is which; state the device's sample counter in the source file, stamp on the"
        " device, or record without loss"
    )
