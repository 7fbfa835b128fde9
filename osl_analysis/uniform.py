"""The one door from a trial to uniform signals: its columns on one grid, with what the source file says of its sensors.

Trials stay as recorded. Every analysis that filters or differentiates takes its signals from here.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.timebase.grid import GapLimits, TimebaseReport, UniformGrid, on_one_grid, one_time_base, rows_on_grid
from osl_analysis.timebase.stream import Stream
from osl_analysis.trial import Array, Trial, counter_column


@dataclass(frozen=True)
class SensorLowPass:
    """Analogue Butterworth low-pass of a sensor or its amplifier: causal, run once, with its phase."""

    cutoff_hz: float  # cut-off [Hz]
    order: int  # order

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


def lacking(column: str, low_passes: Mapping[str, SensorLowPass]) -> list[SensorLowPass]:
    """The filters of other columns' sensors that this column's sensor does not have, each once."""
    return [one for one in dict.fromkeys(low_passes.values()) if one != low_passes.get(column)]


@dataclass(frozen=True)
class UniformSignals:
    """Columns of a trial on one uniform grid.

    trial: name of the trial.
    grid: the time base and what it did.
    signals: column -> (m,), after the low-pass filters that other columns' sensors have and its own has not.
    low_passes: column -> its sensor's own low-pass, as stated in the source file; only the columns that have one.
    devices: column -> the column that stands for all columns with the same stamps.
    """

    trial: str
    grid: UniformGrid
    signals: Mapping[str, Array]
    low_passes: Mapping[str, SensorLowPass]
    devices: Mapping[str, str]

    def __getitem__(self, column: str) -> Array:
        return self.signals[column]

    @property
    def time(self) -> Array:
        return self.grid.time

    @property
    def rate_hz(self) -> float:
        return self.grid.rate_hz

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Rows (m,) that are not near a marked gap: filter and differentiate all rows, then fit these."""
        return self.grid.usable

    @property
    def report(self) -> TimebaseReport:
        """What was decided about the stamps of every stream."""
        return self.grid.report

    def sampled(self, column: str) -> Array:
        """When the sensor of a column took its samples (k,) [s], on the grid's clock; `time` where it took the rows."""
        sensor = next((one for one in self.grid.taken if column in one.decision.signals), None)
        if sensor is None:  # no stream has it by this name: the rows are all that is known
            return self.time
        samples = sensor.samples()
        rows = rows_on_grid(samples, self.time)
        return samples.times if rows is None else self.time

    def as_recorded(self, column: str) -> Array:
        """The values (k,) of a column as its recorder has them, without those that are missing."""
        taken = next(one for one in self.grid.taken if column in one.decision.signals)
        values = taken.stream.signals[column]
        return values if taken.present.all() else values[taken.present]

    def alike(self, column: str, signal: Array) -> Array:
        """A column (m,) through the low-pass filters of the others that its own sensor lacks."""
        for low_pass in lacking(column, self.low_passes):
            signal = low_pass(signal, self.rate_hz)
        return signal

    def other(self) -> "UniformSignals | None":
        """The same if the streams whose stamps nothing decided were taken the other way; None where all are decided."""
        grid = self.grid.other_hypothesis()
        return None if grid is None else on_grid(self.trial, grid, self.low_passes, self.devices)

    def one_device(self, *columns: str) -> bool:
        """Whether these columns share their stamps."""
        return len({self.devices[column] for column in columns}) == 1


def uniform_signals(
    trial: Trial, columns: Sequence[str], limits: GapLimits, computed: Sequence[str] = ()
) -> UniformSignals:
    """The columns of a trial on one uniform grid: stated delays taken out, sensors' low-pass filters made alike.

    `computed` are columns without a sensor, such as a command. They are named where they have the stamps of one of the
    others, and say nothing about these.

    Raises InputError: A column is missing, or its stamps cannot be brought on a grid; the message names the trial.
    """
    rows = {column: sampled_rows(trial, column) for column in columns}
    stamped = set(rows.values())
    also = {c: sampled_rows(trial, c) for c in computed if c in trial.columns}
    rows |= {column: there for column, there in also.items() if there in stamped}
    try:
        grid = one_time_base(streams(trial, rows, frozenset(also)), limits)
        stated = {column: one for column in rows if (one := origin(trial, column).get("low_pass"))}
        low_passes = {column: SensorLowPass(**one) for column, one in stated.items()}
        return on_grid(trial.name, grid, low_passes, devices(rows))
    except InputError as error:
        raise InputError(f"trial {trial.name}: {error}") from error


def regridded(signals: UniformSignals, limits: GapLimits) -> UniformSignals:
    """The same signals with other limits of their gaps; raises as `uniform_signals`, without the trial's name."""
    grid = on_one_grid(signals.grid.taken, limits)
    return on_grid(signals.trial, grid, signals.low_passes, signals.devices)


def on_grid(
    trial: str, grid: UniformGrid, low_passes: Mapping[str, SensorLowPass], devices: Mapping[str, str]
) -> UniformSignals:
    """The signals of a grid, each through the low-pass filters of the others that its own sensor lacks."""
    found = UniformSignals(trial, grid, {}, low_passes, devices)
    return replace(found, signals={column: found.alike(column, signal) for column, signal in grid.signals.items()})


def sampled_rows(trial: Trial, column: str) -> bytes:
    """In which rows of the trial a column was sampled, a bit each; nothing where in all."""
    there = trial.present(column)
    return b"" if there.all() else np.packbits(there).tobytes()


def streams(trial: Trial, rows: Mapping[str, bytes], silent: frozenset[str]) -> list[Stream]:
    """The streams of a trial: columns with samples in the same `rows` (`sampled_rows`) share their stamps."""
    groups = dict[str, list[str]]()
    for column, first in devices(rows).items():
        groups.setdefault(first, []).append(column)
    found = []
    for first, names in groups.items():
        stamps, *values = trial.arrays(*names)
        one = Stream(
            ", ".join(names),
            stamps,
            dict(zip(names, values, strict=True)),
            choice=trial.provenance.get(origin(trial, first).get("file", ""), {}).get("time", {}).get("stamps", "auto"),
            counter=device_counter(trial, names),
            silent=silent,
            delays={name: origin(trial, name).get("delay") or 0.0 for name in names},
        )
        found.append(one)
    return found


def device_counter(trial: Trial, names: Sequence[str]) -> NDArray[np.int64] | None:
    """The device's count of the samples of columns that share their stamps; None where the log has none."""
    name = next((c for c in map(counter_column, names) if c in trial.columns), None)
    return None if name is None else np.asarray(trial.arrays(name)[1], dtype=np.int64)


def devices(rows: Mapping[str, bytes]) -> dict[str, str]:
    """For each column the first one with samples in the same rows, as `sampled_rows` has these."""
    first: dict[bytes, str] = {}
    return {column: first.setdefault(there, column) for column, there in rows.items()}


def origin(trial: Trial, column: str) -> Mapping[str, Any]:
    """What the provenance has on a column; nothing for a trial that was not ingested."""
    found: Mapping[str, Any] = trial.provenance.get("columns", {}).get(column, {})
    return found
