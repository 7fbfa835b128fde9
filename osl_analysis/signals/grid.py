"""The one door from a trial to uniform signals: its columns on one grid, with what the source file says of its sensors,
and the report of what was done. Filter, differentiate and fit only what stands on the grid. Short gaps are bridged,
longer ones marked so that fits leave their rows out, long ones refused."""

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError, naming
from osl_analysis.signals import LowPass, differentiate
from osl_analysis.signals.samples import Taken, take
from osl_analysis.signals.stream import FEWEST_STAMPS, LONG_STEP, SensorLowPass, Stream
from osl_analysis.spline import cubic_through, rows_before
from osl_analysis.trial import Array, Trial, counter_column

BRIDGE_MORE = (  # what the user may do where gaps leave nothing to fit
    "record again with fewer lost samples, or lower time_base.highest_hz, which bridges gaps up to 0.1/highest_hz: "
    "50 ms bridged in every cycle change I by about 1 %"
)


MOVED = ("theta", "theta_m", "torque", "torque_m", "current")
"""Columns whose stamps the fits of a joint or of an actuator ask for."""


@dataclass(frozen=True)
class GapLimits:
    """Which gaps do what. 20 missing samples at 1 kHz are a gap of 20 ms, between samples 21 ms apart."""

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


def fixture_torque(
    time: Array, theta: Array, cutoff_hz: float, inertia: float = 0.0, weight: float = 0.0, rest_deg: float = 0.0
) -> Array:
    """Resisting torque (n,) [N*m] at angles (n,) [rad] of what turns with the joint and is not the joint, as a clamp:
    its inertia [kg*m^2], and its weight m g r [N*m], whose centre is straight below the axis at `rest_deg` [deg]. It is
    behind a low-pass of twice the cut-off of the fit's filter: of an acceleration at a third of that it loses 1e-6, and
    no noise grows."""
    rate = (len(time) - 1) / float(time[-1] - time[0])
    smooth = LowPass(min(2 * cutoff_hz, 0.45 * rate))(theta, rate)
    inertial = inertia * differentiate(time, smooth).alpha if inertia else 0.0
    return np.asarray(inertial + weight * np.sin(theta - np.deg2rad(rest_deg)))


@dataclass(frozen=True)
class UniformSignals:
    """Signals of all streams of a trial at uniform times."""

    time: Array  # (m,) [s]
    rate_hz: float
    signals: Mapping[str, Array]
    """By name (m,), in the units of the streams, without the silent ones, after the low-pass filters that the others'
    sensors have and its own has not; the torque without that of a fixture."""
    usable: NDArray[np.bool_]
    """(m,) false where a row lies in or near a marked gap. Filter and differentiate all rows, then drop these."""
    farthest_s: float  # largest distance [s] of a usable row to the nearest sample of any stream
    streams: Sequence[Mapping[str, Any]]
    """What was found and done in each stream, by the names of `timebase.csv`; all of it is JSON."""
    taken: tuple[Taken, ...]
    limits: GapLimits
    trial: str = ""

    def __getitem__(self, column: str) -> Array:
        return self.signals[column]

    def of(self, column: str) -> Taken:
        return next(one for one in self.taken if column in one.signals)

    def other(self) -> "UniformSignals | None":
        """The same with every undecided stream taken the other way: true stamps as even, even ones as true. None where
        no stream is undecided. The difference of the two fits is what the missing decision costs."""
        turned = [taken.matters and not taken.firm for taken in self.taken]
        if not any(turned):
            return None
        taken = [one.other() if turn else one for one, turn in zip(self.taken, turned, strict=True)]
        return on_one_grid(taken, self.limits, self.trial)


def why_unusable(stamps: Array, time: Array, limits: GapLimits) -> str:
    """Why no row of a grid (m,) [s] is usable, and what to do."""
    if np.mean(np.diff(stamps) == 0) > 0.5:
        shared = f"its stamps are rounded, {stamps.size / np.unique(stamps).size:.0f} rows share one"
        return f"{shared}; state the rate of the rows in place of its time, as `time: {{rate: HZ}}`"
    span = f"from {round(time[0], 4) + 0.0:.4f} s to {time[-1]:.4f} s lies within {limits.margin_s:.2f} s"
    return f"every row {span} of a gap longer than {limits.bridged_s * 1e3:g} ms; {BRIDGE_MORE}"


def on_one_grid(taken: Sequence[Taken], limits: GapLimits, trial: str = "") -> UniformSignals:
    """All signals of a trial on one uniform grid at the fastest stream's rate, over what all streams cover, by a cubic
    spline through the samples at true stamps or at the times of an even device's own clock. Raises InputError: The
    streams do not overlap; a gap is too long; no row is usable."""
    late = max(taken, key=lambda part: part.samples[0][0])
    early = min(taken, key=lambda part: part.samples[0][-1])
    first, last, step = float(late.samples[0][0]), float(early.samples[0][-1]), min(part.step for part in taken)
    rows = int(np.floor((last - first) / step + ON_GRID)) + 1  # a last row that rounding shortened counts
    if rows < FEWEST_STAMPS:
        raise InputError(
            f"{late.stream.name} begins at {first:.4f} s and {early.stream.name} ends at {last:.4f} s: they "
            f"overlap in {max(rows, 0)} rows, at least {FEWEST_STAMPS} are needed; "
            "check that both clocks count from the same time"
        )
    gaps = [gaps_of(part, first, last, limits) for part in taken]
    time, rate = step * np.arange(rows, dtype=np.float64), 1 / step
    time += first
    usable = np.ones(rows, dtype=bool)
    for begin, end in np.concatenate([marked for _, marked in gaps]):
        inner = np.searchsorted(time, begin - limits.margin_s), np.searchsorted(time, end + limits.margin_s, "right")
        usable[slice(*inner)] = False
    if not usable.any():
        raise InputError(f"{taken[0].stream.name}: {why_unusable(taken[0].clock.stamps, time, limits)}")
    signals, farthest = dict[str, Array](), 0.0
    low_passes = {name: one for part in taken for name, one in part.stream.low_passes.items()}
    for times, values, _ in (part.samples for part in taken):
        behind = rows_before(times, time + ON_GRID * step) + 1
        nearest = np.minimum(np.abs(time - times[behind - 1]), np.abs(times[behind] - time))
        farthest = max(farthest, float(nearest[usable].max()))
        for column, signal in resampled(times, values, time, step).items():
            signals[column] = signal
            # a signal that is not filtered as the others are would have another phase
            for low_pass in dict.fromkeys(low_passes.values()):
                if low_pass != low_passes.get(column):
                    signals[column] = low_pass(signals[column], rate)
    fixture = next((part.stream.fixture for part in taken if part.stream.fixture), None)
    if fixture and signals.keys() >= {"theta", "torque"}:
        load = fixture_torque(time, signals["theta"], limits.cutoff_hz, **fixture)
        signals["torque"] = signals["torque"] - load
    streams = [stream_row(part, *found, time, limits) for part, found in zip(taken, gaps, strict=True)]
    # without what samples and clocks have found: 0.4 GB of an hour
    kept = tuple(replace(part, clock=replace(part.clock)) for part in taken)
    return UniformSignals(time, rate, signals, usable, farthest, streams, kept, limits, trial)


def gaps_of(part: Taken, first: float, last: float, limits: GapLimits) -> tuple[Array, Array]:
    """Gaps between two times [s], bridged and marked ones: begin and end of each, (gaps, 2) [s]; refused if too long.
    Jitter may lengthen a gap that is still bridged by a tenth of a step."""
    times = part.samples[0]
    row = np.flatnonzero(np.diff(times) > LONG_STEP * part.step)
    ends = np.stack([times[row], times[row + 1]], axis=1)
    ends = ends[(ends[:, 1] > first) & (ends[:, 0] < last)]
    length = ends[:, 1] - ends[:, 0] - 1.1 * part.step
    if (length > limits.longest_s).any():
        begin, end = ends[np.argmax(length)]
        raise InputError(
            f"{part.stream.name}: {', '.join(part.signals)} has no sample from {begin:.4f} s to "
            f"{end:.4f} s, {end - begin:.3f} s long; gaps up to {limits.longest_s:g} s are bridged: cut the log "
            "there, or see whether the recorder's clock jumped"
        )
    return ends[length <= limits.bridged_s], ends[length > limits.bridged_s]


def stream_row(part: Taken, bridged: Array, marked: Array, time: Array, limits: GapLimits) -> dict[str, Any]:
    """What was found and done in one stream, beside times (m,) [s] of a grid; g is of the signal that knows it best."""
    clock, rate = part.clock, 1 / part.clock.step
    ratio = rate / ((len(time) - 1) / float(time[-1] - time[0])) - 1
    best = min(part.evidence.values(), key=lambda said: said.se, default=None)
    gap = float(np.max(bridged[:, 1] - bridged[:, 0], initial=0.0))
    # largest error of a cubic through a sine, as a share of its amplitude, sampled at steps or across a single gap
    error, bridge_error = ((2 * np.pi * limits.highest_hz * h) ** 4 / 384 for h in (part.step, gap))
    stated = [(name, one) for name, one in part.stream.low_passes.items() if name in part.signals]
    return {
        "signals": ", ".join(part.signals),
        "rate_hz": rate,
        # against the fastest stream, where it is the clocks that differ and not the devices' intention
        "ppm": 1e6 * ratio if abs(ratio) < 1e-3 else None,
        "firm": part.firm,
        "why": part.why,
        "residual_sd_s": clock.sd,
        "wander_s": clock.wander,
        "skew": clock.skew(clock.residual),
        "missing": clock.missing,
        "empty": max(round(np.count_nonzero(~part.present) - len(part.present) * (1 - 1 / part.stride)), 0),
        "repeated": part.repeated,
        "merged": part.samples[2],
        "bridged": len(bridged),
        "marked": len(marked),
        "interpolation": "cubic spline on the device's even clock" if part.even else "cubic spline at true stamps",
        "delay_s": part.delay,
        "error": error,
        "bridge_error": bridge_error,
        "stamps": "even" if part.even else "exact",
        "g": None if best is None else best.g,
        "g_se": None if best is None else best.se,
        "held": part.held,
        "age": part.age if part.firm and part.evidence and not part.even else None,
        "low_pass": "; ".join(f"{name}: {one.cutoff_hz:g} Hz, order {one.order}" for name, one in stated) or None,
    }


SPLINED, REACH = 1 << 14, 64
"""Samples that one spline gives, so few that a processor holds them near, and those beyond its ends that it passes: of
what it is there, 0.27^64 is left inside. The coefficients of a whole hour would take 0.7 GB."""
ON_GRID = 1e-6  # distance, in steps, at which a sample counts as lying on the grid


def resampled(times: Array, values: Mapping[str, Array], grid: Array, step: float) -> dict[str, Array]:
    """Values (m,) of each signal at the grid's times (m,) [s]: the samples where they lie on it, else a cubic spline.
    Nothing is extrapolated: a last row that rounding put behind the last sample has its value."""
    row = int(np.searchsorted(times, grid[0] - ON_GRID * step))
    there = times[row : row + len(grid)]
    # from 1e6 rows on the rounding of a step, which is known to 1e-13 of itself, adds up
    if len(there) == len(grid) and np.max(np.abs(there - grid)) < ON_GRID * step * max(len(grid) / 1e6, 1.0):
        return {name: one[row : row + len(grid)] for name, one in values.items()}
    found = np.empty((len(values), len(grid)))
    for begin in range(0, len(grid), SPLINED):
        inside = np.clip(grid[begin : begin + SPLINED], times[0], times[-1])
        first, last = np.searchsorted(times, (inside[0], inside[-1]))
        rows = slice(max(first - REACH, 0), last + REACH)
        curves = cubic_through(times[rows], np.array([one[rows] for one in values.values()]), inside)
        found[:, begin : begin + SPLINED] = curves
    return dict(zip(values, found, strict=True))


def uniform_signals(
    trial: Trial,
    columns: Sequence[str],
    limits: GapLimits,
    computed: Sequence[str] = (),
    wanted: Collection[str] | None = None,
) -> UniformSignals:
    """The columns of a trial on one uniform grid: stated delays taken out, sensors' low-pass filters made alike.
    `computed` are columns without a sensor, such as a command, which say nothing about the stamps that they share. Of
    all that decide on the stamps those that are `wanted` are made uniform; None: all.
    Raises InputError: A column is missing, or its stamps cannot be brought on a grid; the message names the trial."""
    devices = devices_of(trial, columns, computed)
    with naming(f"trial {trial.name}"):
        taken = take(streams(trial, devices, frozenset(computed)))
        kept = [tuple(name for name in part.signals if wanted is None or name in wanted) for part in taken]
        taken = [replace(part, signals=names or part.signals) for part, names in zip(taken, kept, strict=True)]
        return on_one_grid(taken, limits, trial.name)


def devices_of(trial: Trial, columns: Sequence[str], computed: Sequence[str] = ()) -> list[list[str]]:
    """The columns of each device, which have samples in the same rows. A `computed` one is named beside others only."""
    found: dict[bytes, list[str]] = {}
    for column in columns:
        found.setdefault(trial.present(column).tobytes(), []).append(column)
    for column in computed:
        if column in trial.columns and (rows := trial.present(column).tobytes()) in found:
            found[rows].append(column)
    return list(found.values())


def streams(trial: Trial, devices: Sequence[Sequence[str]], silent: frozenset[str] = frozenset()) -> list[Stream]:
    """The streams of a trial, one for the columns of each device (`devices_of`)."""
    found = []
    for names in devices:
        stamps, *values = trial.arrays(*names)
        of = {name: origin(trial, name) for name in names}
        choice = trial.provenance.get(of[names[0]].get("file", ""), {}).get("time", {}).get("stamps", "auto")
        counted = next((c for c in map(counter_column, names) if c in trial.columns), None)
        counter = None if counted is None else np.asarray(trial.arrays(counted)[1], dtype=np.int64)
        delays = {name: facts["delay"] for name, facts in of.items() if facts.get("delay") is not None}
        low_passes = {name: SensorLowPass(**low) for name, facts in of.items() if (low := facts.get("low_pass"))}
        signals = dict(zip(names, values, strict=True))
        fixture, known = of.get("torque", {}).get("fixture"), trial.provenance.get("stamps", {})
        measured = {name: known[name] and tuple(map(np.array, known[name])) for name in names if name in known}
        label = ", ".join(names)
        facts = (choice, counter, silent, delays, low_passes, measured, fixture, trial.clocks)
        found.append(Stream(label, stamps, signals, *facts))
    return found


def with_stamp_evidence(trial: Trial) -> Trial:
    """The trial with what its signals say about their stamps in its provenance, `stamps`, where every later step that
    makes them uniform finds it: by column the response and the covariance of `StampEvidence`, or null."""
    columns = [column for column in MOVED if column in trial.columns and trial.present(column).any()]
    found: dict[str, Any] = {}
    with suppress(InputError):  # whoever needs these signals will say so
        for part in take(streams(trial, devices_of(trial, columns))):
            told = {name: [one.response.tolist(), one.covariance.tolist()] for name, one in part.evidence.items()}
            found |= {name: told.get(name) for name in part.signals}
    return replace(trial, provenance={**trial.provenance, "stamps": found})


def origin(trial: Trial, column: str) -> dict[str, Any]:
    """What the provenance has on a column; nothing for a trial that was not ingested."""
    return dict(trial.provenance.get("columns", {}).get(column, {}))
