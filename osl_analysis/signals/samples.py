# SPDX-License-Identifier: Apache-2.0
"""The signals that one device recorded at the same stamps, and when their samples were taken: at
true stamps, on the even clock of the device, or on the clock of a slower source whose values the
log repeats."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.base.errors import InputError
from osl_analysis.base.trial import Array
from osl_analysis.signals.device_clock import DeviceClock, HeldValues, held_values
from osl_analysis.signals.plateaus import means_from
from osl_analysis.signals.sample_count import (
    FEWEST_STAMPS,
    SampleCount,
    count_from_stamps,
    count_of_device,
)
from osl_analysis.signals.stamp_evidence import Reading, decide

CLOSE = 0.5  # steps between two true stamps; closer knots of a spline amplify noise
COUNTABLE = 0.1  # steps of scatter, beyond which a missing sample may be taken for a late one
PROMPT_ROWS = 75  # of a block, of which the promptest is hardly late
# scatter of these over that of all stamps: at most 0.083 of hosts that are late by up to two steps
# and lose nothing, at least 0.092 if they lose a sample in 20 to 5000 (100 to 1000 Hz, 24 s)
MOST_PROMPT = 0.088
RARELY = 0.005  # share of the values of a slow source at either end, which do not tell its beat
SAME_BEAT = 0.05  # steps of the log, within which the beat of two rates leaves no doubt


@dataclass(frozen=True)
class SensorLowPass:
    """Analogue Butterworth low-pass of a sensor or its amplifier: causal, run once, with its
    phase."""

    cutoff_hz: float
    order: int

    def __call__(self, values: Array, rate_hz: float) -> Array:
        """Filter samples (n,) taken at `rate_hz` [Hz]; the filter starts in steady state.

        The bilinear transform is not prewarped, since the cut-off may lie above half the rate: 5 Hz
        at 1 kHz are taken for 8e-5 more.
        """
        unwarped = rate_hz / np.pi * np.arctan(np.pi * self.cutoff_hz / rate_hz)
        sections = scipy.signal.butter(self.order, unwarped, fs=rate_hz, output="sos")
        steady_state = scipy.signal.sosfilt_zi(sections) * values[0]
        filtered, _ = scipy.signal.sosfilt(sections, values, zi=steady_state)
        return filtered


@dataclass(frozen=True)
class Stream:
    """Signals sampled at shared stamps, as recorded.

    Attributes
    ----------
    name : str
        Device, topic or column, for messages.
    stamps : Array
        (n,) [s], on the clock that all streams of the trial share.
    signals : Mapping
        (n,) samples each; NaN where the device sampled but the log lacks the value.
    reading : Reading or None
        How the stamps are read; None: they and the signals decide.
    counter : Array or None
        (n,) the device's own count of its samples, where it writes one.
    stated : Mapping
        What the source file states of a signal, by signal: `delay` [s] by which its samples are
        older than their stamps, `low_pass` of its sensor (arguments of `SensorLowPass`),
        `resolution` in its unit, and of a torque its `fixture` (arguments of `fixture_torque`).
    optional : Collection
        Signals that come along on the grid of the others, where they can.

    Raises
    ------
    InputError
        Too few values, an infinite value, or stamps that do not advance.
    """

    name: str
    stamps: Array
    signals: Mapping[str, Array]
    reading: Reading | None = None
    counter: SampleCount | None = None
    stated: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    optional: Collection[str] = ()

    @property
    def came_in_batches(self) -> bool:
        """Whether stamps were spread over batches, and nobody states how they are read."""
        times = [sensor.get("time", {}) for sensor in self.stated.values()]
        return any("in_batches" in time and time.get("stamps") == "auto" for time in times)

    def __post_init__(self) -> None:
        stamps = self.stamps
        for name, values in self.signals.items():
            is_infinite = np.isinf(values)
            if is_infinite.any():
                row = int(np.argmax(is_infinite))
                raise InputError(
                    f"{self.name}: {name} is {values[row]} at row {row}, after"
                    f" {stamps[max(row - 1, 0)]:.6f} s",
                    f"{is_infinite.sum()} of {len(values)} values are not finite: repair the log"
                    " or exclude the trial",
                )
            number = np.count_nonzero(~np.isnan(values))
            if number < FEWEST_STAMPS:
                raise InputError(
                    f"{self.name}: {name} has {number} values in {len(values)} rows",
                    f"at least {FEWEST_STAMPS} are needed: repair the log or exclude the trial",
                )
        if not stamps[-1] > stamps[0]:
            raise InputError(
                f"{self.name}: time stands still at {stamps[0]:.6f} s for {len(stamps)} samples",
                "take another time source",
            )


class Samples(NamedTuple):
    """Samples of some signals when they were taken."""

    times: Array  # (k,) [s], rising
    values: Mapping[str, Array]  # (k,) by signal
    step: float  # usual one [s] from one sample to the next


@dataclass(frozen=True)
class Taken:
    """Signals of a stream with the stream's clock, and how their stamps are taken."""

    stream: Stream  # whose signals lack values in the same rows
    clock: DeviceClock
    reading: Reading
    delay: float = 0.0  # [s] by which the samples are older than their times
    # rows per value if the log repeats each; None: every row has its own value
    held: float | None = None
    unsure: float = 0.0  # [s] by which held values may be older than assumed
    # width [s] of what the beat of two rates leaves open of a delay that it tells, as a rectangular
    # distribution; 0: stated, or no delay is inferred
    beat_width: float = 0.0
    # whether a grid has the time and the rate of these samples, and no row in their gaps
    leads: bool = True

    def with_other_reading(self) -> "Taken":
        """The same samples under the other hypothesis."""
        if self.unsure:
            return replace(self, delay=self.delay + self.unsure, unsure=-self.unsure)
        reading = self.reading
        why = f"the other hypothesis to: {reading.why}"
        return replace(self, reading=reading._replace(even=not reading.even, why=why))

    @cached_property
    def samples(self) -> Samples:
        """The samples at their times, minus the delay. Those whose true stamps are very close are
        merged."""
        present = ~np.isnan(next(iter(self.stream.signals.values())))
        # several rows if signals of a lower rate share the rows of a faster one
        step = self.clock.step * int(np.median(np.diff(self.clock.count[present])))
        values = {name: signal[present] for name, signal in self.stream.signals.items()}
        times = self.reading.times(self.clock)[present]
        if not self.reading.even:
            closest = CLOSE * step
            if np.diff(times).min() < closest:
                begins = begins_of_groups(times, closest)
                values = {name: means_from(begins, signal) for name, signal in values.items()}
                times = means_from(begins, times)
        return Samples(times - self.delay, values, step)


def begins_of_groups(times: Array, closest: float) -> NDArray[np.intp]:
    """First rows (k,) of groups of times (n,) [s]: a group is what lies within `closest` [s] of its
    first sample."""
    begins = [0]
    first = times[0]
    for row, time in enumerate(times.tolist()):
        if time - first >= closest:
            begins.append(row)
            first = time
    return np.array(begins)


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
        As `count_of_device` and `check_countable`.
    """
    parts_by_stream = [take_stream(stream) for stream in streams]
    taken = [part for parts in parts_by_stream for part in parts]
    leading = [part for part in taken if part.leads]
    are_several = sum(any(part.leads for part in parts) for parts in parts_by_stream) > 1
    if are_several or len({part.reading.even for part in leading}) > 1:
        for part in leading:
            check_countable(part)
    return taken


def take_stream(stream: Stream) -> list[Taken]:
    """Decide when the samples of one stream were taken."""
    if stream.counter is None:
        count = count_from_stamps(stream.stamps)
    else:
        count = count_of_device(stream.stamps, stream.counter, stream.name)
    clock = DeviceClock(stream.stamps, count, stream.counter is not None)
    held: dict[str, HeldValues] = {}  # of signals whose sources are slower than the rows
    groups: dict[tuple[float, bytes], dict[str, Array]] = {}  # by delay and missing rows
    for name, signal in stream.signals.items():
        is_missing = np.isnan(signal)
        values = None if is_missing.any() else held_values(signal, clock.step)
        if values is None:
            delay = stream.stated.get(name, {}).get("delay", 0.0)
            groups.setdefault((delay, is_missing.tobytes()), {})[name] = signal
        else:
            held[name] = values

    row_times = stream.stamps
    row_parts = []
    if groups:
        row_signals = {name: values for name, values in stream.signals.items() if name not in held}
        reading = stream.reading or decide(row_signals, clock)
        if stream.came_in_batches:  # when its samples were taken is assumed
            reading = reading._replace(firm=False)
        if held:
            row_times = reading.times(clock)
        for (delay, _), signals in groups.items():
            is_all = len(groups) + len(held) == 1
            name = stream.name if is_all else ", ".join(signals)
            named = replace(stream, name=name, signals=signals)
            leads = not signals.keys() <= {*stream.optional}
            row_parts.append(Taken(named, clock, reading, delay, leads=leads))
    held_parts = [
        held_taken(stream, name, values, row_times, clock.step) for name, values in held.items()
    ]
    return [*held_parts, *row_parts]


def held_taken(stream: Stream, name: str, held: HeldValues, row_times: Array, step: float) -> Taken:
    """Take a held signal at its own rate.

    If its source samples evenly, each value was taken at its first row or less than one step of the
    log earlier. The beat of the two rates narrows this to one clock, on which the promptest value
    is as old as its row. If the rates keep step, only a stated delay makes this firm. Values of an
    uneven source are taken half a step older.

    Parameters
    ----------
    row_times : Array
        When the rows (n,) of the log were sampled [s].
    step : float
        Of the log [s].
    """
    stamps = np.interp(held.rows, np.arange(len(row_times)), row_times)
    clock = DeviceClock(stamps, np.arange(len(stamps)))
    low, high = np.quantile(stamps - clock.times(), (RARELY, 1 - RARELY))
    is_even = high - low < 2 * step

    # time within a step of the log that the beat leaves open; less of it leaves no doubt
    open_s = step - (high - low)
    stated_facts = stream.stated.get(name, {})
    is_known = open_s <= SAME_BEAT * step or "delay" in stated_facts
    when = "known by where it changes"
    if not is_known:
        when = f"the first of them, or up to {open_s * 1e3:.3g} ms before"
    why = f"held: each value stands for {held.period:.4g} rows, its time is {when}"
    if not is_even:
        why = f"undecided, true: {why}, uneven"
    return Taken(
        stream=replace(
            stream,
            name=name,
            stamps=stamps,
            signals={name: held.values},
            counter=None,
        ),
        clock=clock,
        reading=Reading(is_even, is_even and is_known, why),
        delay=stated_facts.get("delay", 0.0) + (-low if is_even else step / 2),
        held=held.period,
        unsure=0.0 if is_known else open_s,
        beat_width=max(open_s, 0.0) if is_known and "delay" not in stated_facts else 0.0,
        leads=name not in stream.optional,
    )


def check_countable(taken: Taken) -> None:
    """Refuse one of several devices if its host is late and loses samples, and no counter tells
    which.

    The promptest samples of blocks hardly scatter where none is missing. They do where samples are
    missing, and where hardly a sample is prompt. What a clock creeps, a cubic follows.
    """
    clock = taken.clock
    is_true = taken.reading.firm and not taken.reading.even
    if is_true or taken.held or clock.counted or clock.scatter <= COUNTABLE * clock.step:
        return
    last = len(clock.residual) // PROMPT_ROWS * PROMPT_ROWS
    prompt = clock.residual[:last].reshape(-1, PROMPT_ROWS).min(axis=1)
    number = np.linspace(-1, 1, len(prompt))
    creeping = np.polynomial.Polynomial.fit(number, prompt, 3)(number)
    if clock.missing:
        loss = f"about {clock.missing} samples are missing"
    elif np.std(prompt - creeping) > MOST_PROMPT * clock.scatter:
        loss = "samples seem to be missing"
    else:
        return
    raise InputError(
        f"{taken.stream.name}: the host's stamps are late by {clock.scatter * 1e3:.2f} ms (SD)"
        f" at a step of {clock.step * 1e3:.2f} ms, and {loss}: beside another device nothing"
        " tells which sample is which",
        "state the device's sample counter in the source file, stamp on the device, or record"
        " without loss",
    )
