"""The one door from a trial to uniform signals: its columns on one grid, with what the source file says of its sensors,
and the report of what was done.

Trials stay as recorded. Filter, differentiate and fit only what stands on the grid. Short gaps are bridged, longer ones
marked so that fits leave their rows out, long ones refused.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.timebase.samples import Samples, Taken, take
from osl_analysis.timebase.stream import FEWEST_STAMPS, LONG_STEP, Stream
from osl_analysis.trial import Array, Trial, counter_column

BRIDGE_MORE = (
    "record again with fewer lost samples, or lower time_base.highest_hz, which bridges gaps up to 0.1/highest_hz: "
    "50 ms bridged in every cycle change I by about 1 %"
)
"""What the user may do where gaps leave nothing to fit."""
JITTER = 0.1  # steps by which jitter may lengthen a gap that is still bridged


@dataclass(frozen=True)
class GapLimits:
    """Which gaps do what. A gap is as long as its missing samples: 20 of them at 1 kHz are 20 ms, between samples that
    lie 21 ms apart."""

    highest_hz: float = 5.0  # [Hz] fastest motion that the fits use
    cutoff_hz: float = 15.0  # [Hz] of the filter that the signals pass afterwards
    longest_s: float = 0.5  # [s] longest gap that is not refused

    @property
    def bridged_s(self) -> float:
        """Longest gap [s] that counts as data: a tenth of a period, of which the cubic loses 5e-4."""
        return 0.1 / self.highest_hz

    @property
    def margin_s(self) -> float:
        """Rows [s] to either side of a marked gap that the filter fills from it."""
        return 3 / self.cutoff_hz


@dataclass(frozen=True)
class Gaps:
    """Gaps of one stream within the overlap, bridged and marked ones: begin and end of each, (gaps, 2) [s]."""

    bridged: Array
    marked: Array

    @classmethod
    def of(cls, samples: Samples, first: float, last: float, limits: GapLimits) -> "Gaps":
        """Gaps of a stream between two times [s]; one that is too long is refused."""
        times = samples.times
        row = np.flatnonzero(np.diff(times) > LONG_STEP * samples.step)
        ends = np.stack([times[row], times[row + 1]], axis=1)
        ends = ends[(ends[:, 1] > first) & (ends[:, 0] < last)]
        length = ends[:, 1] - ends[:, 0] - (1 + JITTER) * samples.step
        if (length > limits.longest_s).any():
            begin, end = ends[np.argmax(length)]
            raise InputError(
                f"{samples.name}: {', '.join(samples.taken.decision.signals)} has no sample from {begin:.4f} s to "
                f"{end:.4f} s, {end - begin:.3f} s long; gaps up to {limits.longest_s:g} s are bridged: cut the log "
                "there, or see whether the recorder's clock jumped"
            )
        return cls(ends[length <= limits.bridged_s], ends[length > limits.bridged_s])


NOMINALLY_EQUAL = 1e-3  # difference of two rates below which it is the clocks' and not the devices' intention


@dataclass(frozen=True)
class StreamReport:
    """What was found and done in one stream."""

    name: str
    signals: tuple[str, ...]
    rate_hz: float  # [Hz] samples per second by the line through its stamps
    ppm: float | None  # rate against that of the fastest stream where the two are nominally equal, within 0.1 %
    even: bool  # the device was taken to sample evenly; else its stamps were taken as true
    firm: bool  # stated or seen in the signals; else the other hypothesis may be right
    why: str  # the decision in words
    g: Mapping[str, float]  # by signal the slope of the sixth differences (1 true, 0 even), where it was sought
    g_se: Mapping[str, float | None]  # its standard error; None where the signal says nothing
    residual_sd_s: float  # SD [s] of the stamps' residual to the line
    wander_s: float  # SD [s] of its slow part
    skew: float  # its skewness
    missing: int  # samples that the device took and the log lacks
    empty: int  # rows of the log in which these signals lack a value
    repeated: int  # rows written twice
    merged: int  # samples averaged
    bridged: int  # gaps filled as data
    marked: int  # gaps whose rows are not usable
    interpolation: str  # how values came to the grid
    delay_s: float  # stated delay [s] of the samples, which was taken out
    error: float  # largest error of a sine at the fastest motion, as a share of its amplitude
    bridge_error: float  # the same within the longest bridged gap


@dataclass(frozen=True)
class TimebaseReport:
    """The grid and its streams."""

    rate_hz: float
    first_s: float  # of the overlap [s]
    last_s: float
    rows: int
    masked: int  # rows that are not usable
    farthest_s: float  # largest distance [s] of a usable row to the nearest sample of any stream
    highest_hz: float  # [Hz] the motion for which the errors of the interpolation are stated
    streams: tuple[StreamReport, ...]


def cubic_error(frequency_hz: float, step: float) -> float:
    """Largest error of a cubic through a sine sampled at `step` [s], as a share of its amplitude: (2 pi f h)^4 / 384.
    2.5e-5 of 5 Hz at 100 Hz. The same holds within a single gap of length `step`."""
    return float((2 * np.pi * frequency_hz * step) ** 4 / 384)


def stream_report(part: Samples, gaps: Gaps, rate_hz: float, limits: GapLimits) -> StreamReport:
    """What was found and done in one stream, beside a grid of the given rate [Hz]."""
    clock, decision = part.taken.clock, part.taken.decision
    ratio = clock.rate_hz / rate_hz - 1
    longest = float(np.max(gaps.bridged[:, 1] - gaps.bridged[:, 0], initial=0.0))
    return StreamReport(
        name=part.name,
        signals=decision.signals,
        rate_hz=clock.rate_hz,
        ppm=1e6 * ratio if abs(ratio) < NOMINALLY_EQUAL else None,
        even=decision.even,
        firm=decision.firm,
        why=decision.why,
        g={name: e.g for name, e in decision.evidence.items()},
        g_se={name: e.se if np.isfinite(e.se) else None for name, e in decision.evidence.items()},
        residual_sd_s=clock.sd,
        wander_s=clock.wander,
        skew=clock.skew,
        missing=clock.missing,
        empty=part.taken.empty,
        repeated=part.taken.repeated,
        merged=part.merged,
        bridged=len(gaps.bridged),
        marked=len(gaps.marked),
        interpolation="cubic spline at true stamps" if not decision.even else "cubic spline on the device's even clock",
        delay_s=part.taken.delay,
        error=cubic_error(limits.highest_hz, part.step),
        bridge_error=cubic_error(limits.highest_hz, longest),
    )


ON_GRID = 1e-6  # distance, in steps, at which a sample counts as lying on the grid
STEP_KNOWN = 1e6  # rows of a grid from which that distance grows with their number: a step is known to 1e-13 of itself


@dataclass(frozen=True)
class SensorLowPass:
    """Analogue Butterworth low-pass of a sensor or its amplifier: causal, run once, with its phase."""

    cutoff_hz: float
    order: int

    def __call__(self, values: Array, rate_hz: float) -> Array:
        """Samples (n,), taken at `rate_hz`, after the filter. The filter starts at rest at the first sample.

        The bilinear transform without prewarping: at frequency f it is the analogue filter at f (1 + (pi f/rate)^2/3),
        8e-5 too high for 5 Hz at 1 kHz. The cut-off may lie above half the rate.
        """
        unwarped = rate_hz / np.pi * np.arctan(np.pi * self.cutoff_hz / rate_hz)
        sections = scipy.signal.butter(self.order, unwarped, fs=rate_hz, output="sos")
        filtered, _ = scipy.signal.sosfilt(sections, values, zi=scipy.signal.sosfilt_zi(sections) * values[0])
        return np.asarray(filtered)

    def __str__(self) -> str:
        return f"{self.cutoff_hz:g} Hz, order {self.order}"


@dataclass(frozen=True)
class UniformSignals:
    """Signals of all streams of a trial at uniform times."""

    time: Array  # (m,) [s]
    rate_hz: float
    signals: Mapping[str, Array]
    """By name (m,), in the units of the streams, without the silent ones, after the low-pass filters that the others'
    sensors have and its own has not."""
    usable: NDArray[np.bool_]
    """(m,) false where a row lies in or near a marked gap. Filter and differentiate all rows, then drop these."""
    report: TimebaseReport  # what was decided and done
    taken: tuple[Taken, ...]
    limits: GapLimits
    trial: str = ""
    low_passes: Mapping[str, SensorLowPass] = field(default_factory=dict)
    """By column its sensor's own, where the source file states one."""
    devices: Mapping[str, str] = field(default_factory=dict)
    """By column the one that stands for all columns with the same stamps."""

    def __getitem__(self, column: str) -> Array:
        return self.signals[column]

    def sampled(self, column: str) -> Array:
        """When the sensor of a column took its samples (k,) [s], on the grid's clock; `time` where it took the rows."""
        sensor = next((one for one in self.taken if column in one.decision.signals), None)
        if sensor is None:  # no stream has it by this name: the rows are all that is known
            return self.time
        samples = sensor.samples()
        return samples.times if rows_on_grid(samples, self.time) is None else self.time

    def as_recorded(self, column: str) -> Array:
        """The values (k,) of a column as its recorder has them, without those that are missing."""
        taken = next(one for one in self.taken if column in one.decision.signals)
        return taken.stream.signals[column][taken.present]

    def alike(self, column: str, signal: Array) -> Array:
        """A column (m,) through the low-pass filters of the others that its own sensor lacks, each once."""
        for low_pass in dict.fromkeys(self.low_passes.values()):
            if low_pass != self.low_passes.get(column):
                signal = low_pass(signal, self.rate_hz)
        return signal

    def other(self) -> "UniformSignals | None":
        """The same with every undecided stream taken the other way: true stamps as even, even ones as true. None where
        no stream is undecided. The difference of the two fits is what the missing decision costs."""
        turned = [t.decision.matters and not t.decision.firm for t in self.taken]
        if not any(turned):
            return None
        taken = [t.other() if turn else t for t, turn in zip(self.taken, turned, strict=True)]
        return on_one_grid(taken, self.limits, self.trial, self.low_passes, self.devices)

    def one_device(self, *columns: str) -> bool:
        """Whether these columns share their stamps."""
        return len({self.devices[column] for column in columns}) == 1


def on_one_grid(
    taken: Sequence[Taken],
    limits: GapLimits,
    trial: str = "",
    low_passes: Mapping[str, SensorLowPass] | None = None,
    devices: Mapping[str, str] | None = None,
) -> UniformSignals:
    """All signals of a trial on one uniform grid at the fastest stream's rate, over what all streams cover.

    True stamps: cubic spline through the samples at their stamps. Even device: the same at the times of its own clock;
    where these are the grid, the samples themselves. Nothing is extrapolated.

    Raises InputError: The streams do not overlap; a gap is too long; no row is usable.
    """
    parts = [t.samples() for t in taken]
    late, early = max(parts, key=lambda part: part.times[0]), min(parts, key=lambda part: part.times[-1])
    first, last, step = float(late.times[0]), float(early.times[-1]), min(part.step for part in parts)
    rows = int(np.floor((last - first) / step + ON_GRID)) + 1  # a last row that rounding shortened counts
    if rows < FEWEST_STAMPS:
        raise InputError(
            f"{late.name} begins at {first:.4f} s and {early.name} ends at {last:.4f} s: they "
            f"overlap in {max(rows, 0)} rows, at least {FEWEST_STAMPS} are needed; "
            "check that both clocks count from the same time"
        )
    gaps = [Gaps.of(part, first, last, limits) for part in parts]
    time, rate = step * np.arange(rows, dtype=np.float64), 1 / step
    time += first
    usable = np.ones(rows, dtype=bool)
    for begin, end in np.concatenate([g.marked for g in gaps]):
        inner = np.searchsorted(time, begin - limits.margin_s), np.searchsorted(time, end + limits.margin_s, "right")
        usable[slice(*inner)] = False
    if not usable.any():
        raise InputError(
            f"{parts[0].name}: every row from {round(time[0], 4) + 0.0:.4f} s to "
            f"{time[-1]:.4f} s lies within {limits.margin_s:.2f} s of a gap longer than "
            f"{limits.bridged_s * 1e3:g} ms; {BRIDGE_MORE}"
        )
    signals = {name: values for part in parts for name, values in zip(part.names, resampled(part, time), strict=True)}
    farthest, at, masked = 0.0, time[usable], int(np.count_nonzero(~usable))
    for times in (part.times for part in parts):
        behind = np.clip(np.searchsorted(times, at), 1, len(times) - 1)
        farthest = max(farthest, float(np.minimum(np.abs(at - times[behind - 1]), np.abs(times[behind] - at)).max()))
    measured_rate = (len(time) - 1) / float(time[-1] - time[0])
    streams = tuple(stream_report(part, found, measured_rate, limits) for part, found in zip(parts, gaps, strict=True))
    ends = float(time[0]), float(time[-1])
    report = TimebaseReport(measured_rate, *ends, rows, masked, farthest, limits.highest_hz, streams)
    of_trial = (trial, low_passes or {}, devices or {})
    found = UniformSignals(time, rate, signals, usable, report, tuple(taken), limits, *of_trial)
    return replace(found, signals={column: found.alike(column, signal) for column, signal in signals.items()})


def resampled(part: Samples, time: Array) -> Sequence[Array]:
    """Values (m,) of each signal at the grid's times (m,) [s]: the samples where they lie on it, else a cubic spline.

    Nothing is extrapolated: a last row that rounding put behind the last sample has its value.
    """
    rows = rows_on_grid(part, time)
    if rows is not None:
        return [values[rows] for values in part.values]
    spline = scipy.interpolate.CubicSpline(part.times, np.array(part.values), axis=1)
    return list(spline(np.clip(time, part.times[0], part.times[-1])))


def rows_on_grid(part: Samples, time: Array) -> slice | None:
    """The samples that are the rows of a grid with times (m,) [s]; None where they do not lie on it."""
    row = int(np.searchsorted(part.times, time[0] - ON_GRID * part.step))
    there = part.times[row : row + len(time)]
    apart = ON_GRID * part.step * max(len(time) / STEP_KNOWN, 1.0)  # the rounding of a step adds up
    if len(there) < len(time) or np.max(np.abs(there - time)) >= apart:
        return None
    return slice(row, row + len(time))


def uniform_signals(
    trial: Trial, columns: Sequence[str], limits: GapLimits, computed: Sequence[str] = ()
) -> UniformSignals:
    """The columns of a trial on one uniform grid: stated delays taken out, sensors' low-pass filters made alike.

    `computed` are columns without a sensor, such as a command. They are named where they have the stamps of one of the
    others, and say nothing about these.

    Raises InputError: A column is missing, or its stamps cannot be brought on a grid; the message names the trial.
    """
    also = [column for column in computed if column in trial.columns]
    devices = {c: device for c, device in devices_of(trial, [*columns, *also]).items() if device in columns}
    try:
        taken = take(streams(trial, devices, frozenset(also)))
        stated = {column: one for column in devices if (one := origin(trial, column).get("low_pass"))}
        low_passes = {column: SensorLowPass(**one) for column, one in stated.items()}
        return on_one_grid(taken, limits, trial.name, low_passes, devices)
    except InputError as error:
        raise InputError(f"trial {trial.name}: {error}") from error


def regridded(signals: UniformSignals, limits: GapLimits) -> UniformSignals:
    """The same signals with other limits of their gaps; raises as `uniform_signals`, without the trial's name."""
    return on_one_grid(signals.taken, limits, signals.trial, signals.low_passes, signals.devices)


def devices_of(trial: Trial, columns: Sequence[str]) -> dict[str, str]:
    """For each column the first one with samples in the same rows, which share their stamps."""
    first: dict[bytes, str] = {}
    return {column: first.setdefault(trial.present(column).tobytes(), column) for column in columns}


def streams(trial: Trial, devices: Mapping[str, str], silent: frozenset[str]) -> list[Stream]:
    """The streams of a trial, one for all columns of one of the `devices` (`devices_of`)."""
    found = []
    for first in dict.fromkeys(devices.values()):
        names = [column for column, device in devices.items() if device == first]
        stamps, *values = trial.arrays(*names)
        counter = next((c for c in map(counter_column, names) if c in trial.columns), None)
        one = Stream(
            ", ".join(names),
            stamps,
            dict(zip(names, values, strict=True)),
            choice=trial.provenance.get(origin(trial, first).get("file", ""), {}).get("time", {}).get("stamps", "auto"),
            counter=None if counter is None else np.asarray(trial.arrays(counter)[1], dtype=np.int64),
            silent=silent,
            delays={name: origin(trial, name).get("delay") or 0.0 for name in names},
        )
        found.append(one)
    return found


def origin(trial: Trial, column: str) -> Mapping[str, Any]:
    """What the provenance has on a column; nothing for a trial that was not ingested."""
    found: Mapping[str, Any] = trial.provenance.get("columns", {}).get(column, {})
    return found
