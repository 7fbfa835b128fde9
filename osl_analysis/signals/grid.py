# SPDX-License-Identifier: Apache-2.0
"""The only way from a trial to uniform signals: its columns on one grid, corrected for their
sensors as the source file states, with a report.

Filter, differentiate and fit only signals on the grid. Short gaps are bridged. Longer gaps are
marked, and fits leave their rows out. Too long gaps are refused.
"""

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any

import numpy as np
import polars as pl
import scipy
from numpy.typing import NDArray
from pydantic import Field

from osl_analysis.base.errors import InputError, naming
from osl_analysis.base.trial import COUNTER, Array, Trial
from osl_analysis.base.yaml_settings import FilterOrder, Positive, Seconds, Settings
from osl_analysis.signals.filters import REACH_PERIODS, LowPass, differentiate
from osl_analysis.signals.sample_count import FEWEST_STAMPS, LONG_STEP
from osl_analysis.signals.samples import Samples, SensorLowPass, Stream, Taken, take, take_stream
from osl_analysis.signals.stamp_evidence import Reading

BRIDGE_MORE = (  # remedy if gaps leave nothing to fit
    "record again with fewer lost samples, or lower time_base.highest_hz, which bridges gaps up to"
    " 0.1/highest_hz: 50 ms bridged in every cycle change I by about 1 %"
)

# distance, in steps, up to which a sample lies on the grid: the rounding of a step, 1e-13 of it,
# adds up to it in 1e8 rows
GRID_ROUNDING = 1e-5
OF_CLOCKS = 1e-3  # relative difference of two rates; a larger one is intended
NO_GAP = 1.1  # steps between samples that are none: a tenth of a step is jitter
BRIDGED_PERIODS = 0.1  # of the fastest motion: a cubic across a gap is wrong by 5e-4 there


class TimeBase(Settings):
    """How the channels of a trial are brought on one uniform grid (docs/time_base.md). 20 missing
    samples at 1 kHz are a gap of 20 ms, between samples that are 21 ms apart."""

    highest_hz: Positive = 5.0
    """Fastest motion [Hz] of the bench; gaps up to a tenth of its period are bridged and count as
    data."""
    longest_gap_s: Seconds = 0.5
    """Longest gap [s]; between the two a gap is bridged and its rows are not fitted, beyond it a
    trial is refused."""


class FilterSettings(Settings):
    """The time base and the one zero-phase Butterworth filter of all signals of a trial."""

    cutoff_hz: Annotated[float, Field(gt=0, le=1000)]  # cut-off [Hz] of one run of the filter
    order: FilterOrder  # of one run
    time_base: TimeBase = TimeBase()  # the uniform grid on which the signals are filtered

    @property
    def low_pass(self) -> LowPass:
        return LowPass(self.cutoff_hz, self.order)


USUAL_FILTER = FilterSettings(cutoff_hz=15.0, order=4)
"""Of the bench, where no settings are stated."""


@dataclass(frozen=True)
class UniformSignals:
    """Signals of all streams of a trial at uniform times.

    Attributes
    ----------
    time : Array
        (m,) [s].
    rate_hz : float
    signals : Mapping
        (m,) by name, in the streams' units. Each has passed the low-pass
        filters of the other signals' sensors that its own sensor lacks. A fixture's torque is taken
        off the torque.
    usable : Array
        (m,) false in and near a marked gap. Filter and differentiate all rows, then drop these.
    taken : tuple of Taken
        How the samples of each stream were taken.
    gaps : Sequence of (int, int)
        Numbers of bridged and of marked gaps of each.
    settings : FilterSettings
    is_decided : bool
        Whether stamps and signals decide how the stamps of each stream are read.
    trial : str
        Its name.
    """

    time: Array
    rate_hz: float
    signals: Mapping[str, Array]
    usable: NDArray[np.bool_]
    taken: tuple[Taken, ...]
    gaps: Sequence[tuple[int, int]]
    settings: FilterSettings
    is_decided: bool
    trial: str = ""

    @cached_property
    def streams(self) -> Sequence[Mapping[str, Any]]:
        """What was found and done in each stream, by the names of `timebase.csv`; all of it is
        JSON."""
        rows = []
        for part, (bridged, marked) in zip(self.taken, self.gaps, strict=True):
            clock, reading = part.clock, part.reading
            rate = 1 / clock.step
            difference = rate / self.rate_hz - 1
            rows.append(
                {
                    "signals": ", ".join(part.stream.signals),
                    "rate_hz": rate,
                    # against the fastest stream
                    "ppm": 1e6 * difference if abs(difference) < OF_CLOCKS else None,
                    "firm": reading.firm,
                    "why": reading.why,
                    "missing": clock.missing,
                    "bridged": bridged,
                    "marked": marked,
                    "delay_s": part.delay,
                    "stamps": "even" if reading.even else "exact",
                }
            )
        return rows

    def with_other_reading(self) -> "UniformSignals":
        """The same with the other reading of every undecided stream: true stamps as even, even ones
        as true. The difference of the two fits is the cost of the missing decision."""
        taken = [part if part.reading.firm else part.with_other_reading() for part in self.taken]
        return on_one_grid(taken, self.settings, self.trial)


def uniform_signals(
    trial: Trial,
    columns: Sequence[str],
    settings: FilterSettings,
    optional_columns: Collection[str] = (),
) -> UniformSignals:
    """Bring the columns of a trial on one uniform grid.

    Stated delays are taken off, and the low-pass filters of sensors made equal.

    Parameters
    ----------
    trial : Trial
    columns : Sequence of str
    settings : FilterSettings
    optional_columns : Collection of str
        Columns that come along where they can: the grid has not their time and rate, they mark no
        row, and one that is missing or has too long a gap is left out.

    Returns
    -------
    UniformSignals

    Raises
    ------
    InputError
        A column is missing, or its stamps cannot be brought on a grid; the message names the trial.
    """
    with naming(f"trial {trial.name}"):
        along = []
        for name in optional_columns:
            with suppress(InputError):  # it is missing, or broken
                stream_of(trial, [name])
                along.append(name)
        devices = devices_of(trial, [*columns, *along])
        taken = take([stream_of(trial, names, optional_columns) for names in devices])
        return on_one_grid(taken, settings, trial.name)


CLOCKED_COLUMNS = ("theta", "theta_m", "omega_m", "theta_joint", "current", "torque", "torque_m")
"""Columns of a bench that tell how the stamps of their device are read."""


def with_clocks(trial: Trial) -> Trial:
    """The trial with `clocks`: how the stamps of each device of a bench are read, by all that it
    measured. A device that no grid can take, such as one with a clock that jumps, has none."""
    clocks = dict[str, Reading]()
    for names in devices_of(trial, [name for name in CLOCKED_COLUMNS if name in trial.columns]):
        with suppress(InputError):
            for part in take_stream(stream_of(trial, names)):
                if part.held is None:
                    clocks.update(dict.fromkeys(part.stream.signals, part.reading))
    return replace(trial, clocks=clocks)


def sampling_times(trial: Trial, column: str, stamps: Array) -> Array:
    """When samples with stamps (n,) [s] were taken, as a fit reads the stamps of the device of a
    column; the stamps themselves where no grid can take it."""
    with suppress(InputError):
        for part in take_stream(stream_of(trial, [column])):
            if part.held is None:
                return np.interp(stamps, part.clock.stamps, part.reading.times(part.clock))
    return stamps


def on_one_grid(
    taken: Sequence[Taken], settings: FilterSettings, trial: str = ""
) -> UniformSignals:
    """Bring all signals on one grid, at the fastest stream's rate, over the time that all cover.

    A cubic spline passes through the samples, at true stamps or at the times of an even device's
    clock.

    Parameters
    ----------
    taken : Sequence of Taken
        How the samples of each stream were taken.
    settings : FilterSettings
    trial : str
        Its name.

    Returns
    -------
    UniformSignals

    Raises
    ------
    InputError
        The streams do not overlap, a gap is too long, or no row is usable.
    """
    leading = [part for part in taken if part.leads]
    step = min(part.samples.step for part in leading)
    rate = 1 / step
    first, last_to_begin = max((part.samples.times[0], part.stream.name) for part in leading)
    last, first_to_end = min((part.samples.times[-1], part.stream.name) for part in leading)
    # keeps a last row that rounding would cut off
    rows = int(np.floor((last - first) / step + GRID_ROUNDING)) + 1
    if rows < FEWEST_STAMPS:
        raise InputError(
            f"{last_to_begin} begins at {first:.4f} s and {first_to_end} ends at {last:.4f} s:"
            f" they overlap in {max(rows, 0)} rows, at least {FEWEST_STAMPS} are needed",
            "check that both clocks count from the same time",
        )
    time = step * np.arange(rows) + first
    bridged_s = BRIDGED_PERIODS / settings.time_base.highest_hz
    margin_s = REACH_PERIODS / settings.cutoff_hz
    margins = np.array([-margin_s, margin_s])
    usable = np.ones(len(time), dtype=bool)
    signals = {}
    gaps = []
    for part in leading:
        ends, length = gaps_of(part, time, settings.time_base.longest_gap_s)
        marked = ends[length > bridged_s]
        for first, stop in np.searchsorted(time, marked + margins).tolist():
            usable[first:stop] = False
        signals.update(resampled(part.samples, time, step))
        gaps.append((len(ends) - len(marked), len(marked)))
    if not usable.any():
        raise InputError(
            f"{taken[0].stream.name}: every row from {time[0]:.4f} s to {time[-1]:.4f} s lies"
            f" within {margin_s:.2f} s of a gap longer than {bridged_s * 1e3:g} ms",
            f"{BRIDGE_MORE}; if stamps are rounded so that many rows share one, state `time:"
            " {rate: HZ}`",
        )
    for part in taken:
        if not part.leads:
            with suppress(InputError):
                gaps_of(part, time, settings.time_base.longest_gap_s)
                signals.update(resampled(part.samples, time, step))
    stated_facts: dict[str, Mapping[str, Any]] = {}
    for part in taken:
        stated_facts.update(part.stream.stated)
    sensor_filters = {
        name: SensorLowPass(**facts["low_pass"])
        for name, facts in stated_facts.items()
        if "low_pass" in facts
    }
    if sensor_filters:
        signals = with_equal_sensor_filters(signals, sensor_filters, rate)
    fixture = stated_facts.get("torque", {}).get("fixture")
    if fixture and {"theta", "torque"} <= signals.keys():
        load = fixture_torque(time, signals["theta"], settings.cutoff_hz, **fixture)
        signals["torque"] = signals["torque"] - load

    return UniformSignals(
        time=time,
        rate_hz=rate,
        signals=signals,
        usable=usable,
        # copies without cached properties: these take 0.4 GB for an hour
        taken=tuple(replace(part, clock=replace(part.clock)) for part in leading),
        gaps=gaps,
        is_decided=all(part.reading.firm for part in leading),
        settings=settings,
        trial=trial,
    )


def with_equal_sensor_filters(
    signals: Mapping[str, Array], sensor_filters: Mapping[str, SensorLowPass], rate_hz: float
) -> dict[str, Array]:
    """Pass each signal through the filter of every sensor, except its `own` one, which it has
    already passed. Signals must have equal phase."""
    filtered = {}
    for name, signal in signals.items():
        for low_pass in dict.fromkeys(sensor_filters.values()):
            if low_pass != sensor_filters.get(name):
                signal = low_pass(signal, rate_hz)
        filtered[name] = signal
    return filtered


def fixture_torque(
    time: Array,
    theta: Array,
    cutoff_hz: float,
    inertia: float = 0.0,
    weight: float = 0.0,
    rest_deg: float = 0.0,
) -> Array:
    """Find the torque of a fixture that turns with the joint, such as a clamp.

    Parameters
    ----------
    time, theta : Array
        Uniform times (n,) [s] and angles (n,) [rad].
    cutoff_hz : float
        Of the fit's filter [Hz].
    inertia : float
        [kg*m^2].
    weight : float
        m g r [N*m].
    rest_deg : float
        Angle [deg] at which the centre of mass is straight below the axis.

    Returns
    -------
    Array
        Resisting torque (n,) [N*m], inertia * alpha + weight * sin(theta - rest).

    Notes
    -----
    The angle is low-passed at twice the fit's cut-off, so that noise does not grow. An acceleration
    at a third of the fit's cut-off loses 1e-6.
    """
    rate = (len(time) - 1) / (time[-1] - time[0])
    smooth = LowPass(min(2 * cutoff_hz, 0.45 * rate))(theta, rate)
    inertial = inertia * differentiate(time, smooth).alpha if inertia else 0.0
    return inertial + weight * np.sin(theta - np.deg2rad(rest_deg))


def gaps_of(part: Taken, time: Array, longest_s: float) -> tuple[Array, Array]:
    """Begin and end (gaps, 2) [s] of the gaps of a stream within times (m,) [s], and their lengths
    (gaps,) [s]. Raises InputError: one is longer than allowed."""
    times, _, step = part.samples
    rows = np.flatnonzero(np.diff(times) > LONG_STEP * step)
    ends = np.stack([times[rows], times[rows + 1]], axis=1)
    ends = ends[(ends[:, 1] > time[0]) & (ends[:, 0] < time[-1])]
    length = ends[:, 1] - ends[:, 0] - NO_GAP * step
    if (length > longest_s).any():
        begin, end = ends[np.argmax(length)]
        raise InputError(
            f"{part.stream.name}: no sample from {begin:.4f} s to {end:.4f} s, {end - begin:.3f}"
            " s long",
            f"gaps up to `longest_gap_s`, {longest_s:g} s, are bridged: give each part beside the"
            " gap a trial of its own by `windows` in the sample sheet, or see whether the"
            " recorder's clock jumped",
        )
    return ends, length


def resampled(samples: Samples, grid: Array, step: float) -> dict[str, Array]:
    """Take signals at the times of a grid.

    Parameters
    ----------
    samples : Samples
    grid : Array
        Uniform times (m,) [s], within the samples'.
    step : float
        Of the grid [s].

    Returns
    -------
    dict
        (m,) by signal: the samples if they lie on the grid, else a cubic spline. Nothing is
        extrapolated: a last row that lies behind the last sample by rounding has its value.
    """
    times, values, _ = samples
    row = np.searchsorted(times, grid[0] - GRID_ROUNDING * step)
    nearby = times[row : row + len(grid)]
    if len(nearby) == len(grid) and np.max(np.abs(nearby - grid)) < GRID_ROUNDING * step:
        return {name: signal[row : row + len(grid)] for name, signal in values.items()}

    inside = np.clip(grid, times[0], times[-1])
    return {
        name: scipy.interpolate.CubicSpline(times, signal)(inside)
        for name, signal in values.items()
    }


def devices_of(trial: Trial, columns: Sequence[str]) -> list[list[str]]:
    """Group columns by device: those sampled in the same rows."""
    trial.check_columns(*columns)
    devices: dict[bytes, list[str]] = {}
    for is_sampled in trial.samples.select(pl.col(columns).is_not_null()):
        devices.setdefault(is_sampled.to_numpy().tobytes(), []).append(is_sampled.name)
    return list(devices.values())


def stream_of(trial: Trial, names: Sequence[str], optional_columns: Collection[str] = ()) -> Stream:
    """Make a stream of columns that one device recorded, with what the source file states."""
    stamps, *values = trial.arrays(*names)
    described = trial.provenance.get("columns", {})
    origins = {name: described.get(name, {}) for name in names}
    log_facts = trial.provenance.get(origins[names[0]].get("file", ""), {})
    time = origins[names[0]].get("time") or log_facts.get("time", {})
    choice = time.get("stamps", "auto")
    reading = next(
        (Reading(*trial.clocks[name][:3]) for name in names if name in trial.clocks), None
    )
    if choice != "auto":
        reading = Reading(choice == "even", True, f"stated: {choice}")
    counters = [name + COUNTER for name in names if name + COUNTER in trial.samples]
    name = ", ".join(names)
    files = trial.provenance.get("files", {})
    if "log_2" in files:
        name += f" of {files[origins[names[0]]['file']]['path']}"
    return Stream(
        name=name,
        stamps=stamps,
        signals=dict(zip(names, values, strict=True)),
        reading=reading,
        counter=trial.arrays(counters[0])[1].astype(np.int64) if counters else None,
        stated=origins,
        optional=optional_columns,
    )


def origin(trial: Trial, column: str) -> dict[str, Any]:
    """The provenance of a column; empty for a trial that was not ingested."""
    return dict(trial.provenance.get("columns", {}).get(column, {}))
