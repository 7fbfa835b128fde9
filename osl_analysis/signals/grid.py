"""The only way from a trial to uniform signals: its columns on one grid, corrected for their
sensors as the source file states, with a report. Filter, differentiate and fit only signals on the
grid. Short gaps are bridged. Longer gaps are marked, and fits leave their rows out. Too long gaps
are refused."""

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.errors import InputError, naming
from osl_analysis.signals import LowPass, differentiate
from osl_analysis.signals.samples import Taken, take
from osl_analysis.signals.stream import FEWEST_STAMPS, LONG_STEP, SensorLowPass, Stream
from osl_analysis.trial import Array, Trial, counter_column

BRIDGE_MORE = (  # remedy if gaps leave nothing to fit
    "record again with fewer lost samples, or lower time_base.highest_hz, which bridges gaps up to"
    " 0.1/highest_hz: 50 ms bridged in every cycle change I by about 1 %"
)


MOVED = ("theta", "theta_m", "torque", "torque_m", "current")
"""Columns whose stamps matter to the fits of a joint or an actuator."""


@dataclass(frozen=True)
class GapLimits:
    """Limits of gaps. 20 missing samples at 1 kHz are a gap of 20 ms, between samples that are 21
    ms apart."""

    highest_hz: float = 5.0  # [Hz] fastest motion that the fits use
    cutoff_hz: float = 15.0  # [Hz] of the filter that the signals pass afterwards
    longest_s: float = 0.5  # [s] longest gap that is not refused

    @property
    def bridged_s(self) -> float:
        """Longest gap [s] that is bridged: a tenth of a period of `highest_hz`; a cubic is wrong by
        5e-4 there."""
        return 0.1 / self.highest_hz

    @property
    def margin_s(self) -> float:
        """Time [s] to either side of a marked gap into which the filter spreads its values."""
        return 3 / self.cutoff_hz


def fixture_torque(
    time: Array,
    theta: Array,
    cutoff_hz: float,
    inertia: float = 0.0,
    weight: float = 0.0,
    rest_deg: float = 0.0,
) -> Array:
    """Resisting torque (n,) [N*m], at angles (n,) [rad], of a fixture that turns with the joint,
    such as a clamp. It has an inertia [kg*m^2] and a weight m g r [N*m]. Its centre of mass is
    straight below the axis at `rest_deg`. The angle is low-passed at twice the fit's `cutoff_hz`,
    so that noise does not grow. An acceleration at a third of this cut-off loses 1e-6."""
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
    """(m,) by name, in the streams' units, without silent ones. Each has passed the low-pass
    filters of the other signals' sensors that its own sensor lacks. A fixture's torque is taken off
    the torque."""
    usable: NDArray[np.bool_]
    """(m,) false in and near a marked gap. Filter and differentiate all rows, then drop these."""
    # largest distance [s] from a usable row to the nearest sample, over all streams
    farthest_s: float
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
        """The same with the other reading of every undecided stream: true stamps as even, even ones
        as true. None if no stream is undecided. The difference of the two fits is the cost of the
        missing decision."""
        turned = [taken.matters and not taken.firm for taken in self.taken]
        if not any(turned):
            return None
        taken = [one.other() if turn else one for one, turn in zip(self.taken, turned, strict=True)]
        return on_one_grid(taken, self.limits, self.trial)


def why_unusable(stamps: Array, time: Array, limits: GapLimits) -> str:
    """The message if no row of a grid (m,) [s] is usable: why, and what to do."""
    if np.mean(np.diff(stamps) == 0) > 0.5:
        shared = (
            f"its stamps are rounded, {stamps.size / np.unique(stamps).size:.0f} rows share one"
        )
        return f"{shared}; state the rate of the rows in place of its time, as `time: {{rate: HZ}}`"
    span = (
        f"from {round(time[0], 4) + 0.0:.4f} s to {time[-1]:.4f} s lies within"
        f" {limits.margin_s:.2f} s"
    )
    return f"every row {span} of a gap longer than {limits.bridged_s * 1e3:g} ms; {BRIDGE_MORE}"


def on_one_grid(taken: Sequence[Taken], limits: GapLimits, trial: str = "") -> UniformSignals:
    """All signals of a trial on one uniform grid, at the fastest stream's rate, over the time that
    all streams cover. A cubic spline passes through the samples, at true stamps or at the times of
    an even device's clock. Raises InputError: the streams do not overlap, a gap is too long, or no
    row is usable."""
    late = max(taken, key=lambda part: part.samples[0][0])
    early = min(taken, key=lambda part: part.samples[0][-1])
    first, last, step = (
        float(late.samples[0][0]),
        float(early.samples[0][-1]),
        min(part.step for part in taken),
    )
    # keeps a last row that rounding would cut off
    rows = int(np.floor((last - first) / step + ON_GRID)) + 1
    if rows < FEWEST_STAMPS:
        raise InputError(
            f"{late.stream.name} begins at {first:.4f} s and {early.stream.name} ends at {last:.4f}"
            f" s: they overlap in {max(rows, 0)} rows, at least {FEWEST_STAMPS} are needed; check"
            " that both clocks count from the same time"
        )
    gaps = [gaps_of(part, first, last, limits) for part in taken]
    time, rate = step * np.arange(rows, dtype=np.float64), 1 / step
    time += first
    usable = np.ones(rows, dtype=bool)
    for begin, end in np.concatenate([marked for _, marked in gaps]):
        inner = (
            np.searchsorted(time, begin - limits.margin_s),
            np.searchsorted(time, end + limits.margin_s, "right"),
        )
        usable[slice(*inner)] = False
    if not usable.any():
        raise InputError(
            f"{taken[0].stream.name}: {why_unusable(taken[0].clock.stamps, time, limits)}"
        )
    signals, farthest = dict[str, Array](), 0.0
    low_passes = {name: one for part in taken for name, one in part.stream.low_passes.items()}
    for times, values, _ in (part.samples for part in taken):
        behind = np.searchsorted(times, time + ON_GRID * step, "right").clip(1, len(times) - 1)
        nearest = np.minimum(np.abs(time - times[behind - 1]), np.abs(times[behind] - time))
        farthest = max(farthest, float(nearest[usable].max()))
        for column, signal in resampled(times, values, time, step).items():
            signals[column] = signal
            # signals must have equal phase: each passes every sensor's filter, except the one it
            # has already passed
            for low_pass in dict.fromkeys(low_passes.values()):
                if low_pass != low_passes.get(column):
                    signals[column] = low_pass(signals[column], rate)
    fixture = next((part.stream.fixture for part in taken if part.stream.fixture), None)
    if fixture and signals.keys() >= {"theta", "torque"}:
        load = fixture_torque(time, signals["theta"], limits.cutoff_hz, **fixture)
        signals["torque"] = signals["torque"] - load
    streams = [
        stream_row(part, *found, time, limits) for part, found in zip(taken, gaps, strict=True)
    ]
    # copies without cached properties: these take 0.4 GB for an hour
    kept = tuple(replace(part, clock=replace(part.clock)) for part in taken)
    return UniformSignals(time, rate, signals, usable, farthest, streams, kept, limits, trial)


def gaps_of(part: Taken, first: float, last: float, limits: GapLimits) -> tuple[Array, Array]:
    """Bridged and marked gaps between two times [s]: begin and end of each, (gaps, 2) [s]. Raises
    InputError: a gap is too long. A gap may be longer by a tenth of a step, because of jitter."""
    times = part.samples[0]
    row = np.flatnonzero(np.diff(times) > LONG_STEP * part.step)
    ends = np.stack([times[row], times[row + 1]], axis=1)
    ends = ends[(ends[:, 1] > first) & (ends[:, 0] < last)]
    length = ends[:, 1] - ends[:, 0] - 1.1 * part.step
    if (length > limits.longest_s).any():
        begin, end = ends[np.argmax(length)]
        raise InputError(
            f"{part.stream.name}: {', '.join(part.signals)} has no sample from {begin:.4f} s to"
            f" {end:.4f} s, {end - begin:.3f} s long; gaps up to {limits.longest_s:g} s are"
            " bridged: cut the log there, or see whether the recorder's clock jumped"
        )
    return ends[length <= limits.bridged_s], ends[length > limits.bridged_s]


def stream_row(
    part: Taken, bridged: Array, marked: Array, time: Array, limits: GapLimits
) -> dict[str, Any]:
    """The report on one stream resampled to times (m,) [s]. g is from the signal with the smallest
    standard error."""
    clock, rate = part.clock, 1 / part.clock.step
    ratio = rate / ((len(time) - 1) / float(time[-1] - time[0])) - 1
    best = min(part.evidence.values(), key=lambda said: said.se, default=None)
    gap = float(np.max(bridged[:, 1] - bridged[:, 0], initial=0.0))
    # largest error of a cubic through a sine, as a share of its amplitude: sampled at steps, and
    # across a gap
    error, bridge_error = ((2 * np.pi * limits.highest_hz * h) ** 4 / 384 for h in (part.step, gap))
    stated = [(name, one) for name, one in part.stream.low_passes.items() if name in part.signals]
    return {
        "signals": ", ".join(part.signals),
        "rate_hz": rate,
        # against the fastest stream; a larger difference is intended, not one of the clocks
        "ppm": 1e6 * ratio if abs(ratio) < 1e-3 else None,
        "firm": part.firm,
        "why": part.why,
        "residual_sd_s": clock.sd,
        "wander_s": clock.wander,
        "skew": clock.skew(clock.residual),
        "missing": clock.missing,
        "empty": max(
            round(np.count_nonzero(~part.present) - len(part.present) * (1 - 1 / part.stride)), 0
        ),
        "repeated": part.repeated,
        "merged": part.samples[2],
        "bridged": len(bridged),
        "marked": len(marked),
        "interpolation": (
            "cubic spline on the device's even clock"
            if part.even
            else "cubic spline at true stamps"
        ),
        "delay_s": part.delay,
        "error": error,
        "bridge_error": bridge_error,
        "stamps": "even" if part.even else "exact",
        "g": None if best is None else best.g,
        "g_se": None if best is None else best.se,
        "held": part.held,
        "age": part.age if part.firm and part.evidence and not part.even else None,
        "low_pass": (
            "; ".join(f"{name}: {one.cutoff_hz:g} Hz, order {one.order}" for name, one in stated)
            or None
        ),
    }


SPLINED, REACH = 1 << 14, 64
"""Grid rows per spline, which fit into a processor's cache, and samples beyond its ends: the effect
of an end falls by
0.27 per sample. One spline for an hour would take 0.7 GB."""
ON_GRID = 1e-6  # distance, in steps, up to which a sample lies on the grid


def resampled(
    times: Array, values: Mapping[str, Array], grid: Array, step: float
) -> dict[str, Array]:
    """Values (m,) of each signal at the grid's times (m,) [s]: the samples if they lie on it, else
    a cubic spline. Nothing is extrapolated: a last row that lies behind the last sample by rounding
    has its value."""
    row = int(np.searchsorted(times, grid[0] - ON_GRID * step))
    there = times[row : row + len(grid)]
    # the rounding of a step, 1e-13 of it, adds up over more than 1e6 rows
    if len(there) == len(grid) and np.max(np.abs(there - grid)) < ON_GRID * step * max(
        len(grid) / 1e6, 1.0
    ):
        return {name: one[row : row + len(grid)] for name, one in values.items()}
    found = np.empty((len(values), len(grid)))
    for begin in range(0, len(grid), SPLINED):
        inside = np.clip(grid[begin : begin + SPLINED], times[0], times[-1])
        first, last = np.searchsorted(times, (inside[0], inside[-1]))
        rows = slice(max(first - REACH, 0), last + REACH)
        samples = np.array([one[rows] for one in values.values()])
        curves = scipy.interpolate.CubicSpline(times[rows], samples, axis=1)
        found[:, begin : begin + SPLINED] = curves(inside)
    return dict(zip(values, found, strict=True))


def uniform_signals(
    trial: Trial,
    columns: Sequence[str],
    limits: GapLimits,
    computed: Sequence[str] = (),
    wanted: Collection[str] | None = None,
) -> UniformSignals:
    """The columns of a trial on one uniform grid, without stated delays, and with equal low-pass
    filters of sensors. `computed` columns have no sensor, such as a command, and do not help to
    decide on the stamps that they share. All `columns` help to decide; those `wanted` (None: all)
    are made uniform. Raises InputError: a column is missing, or its stamps cannot be brought on a
    grid; the message names the trial."""
    devices = devices_of(trial, columns, computed)
    with naming(f"trial {trial.name}"):
        taken = take(streams(trial, devices, frozenset(computed)))
        kept = [
            tuple(name for name in part.signals if wanted is None or name in wanted)
            for part in taken
        ]
        taken = [
            replace(part, signals=names or part.signals)
            for part, names in zip(taken, kept, strict=True)
        ]
        return on_one_grid(taken, limits, trial.name)


def devices_of(
    trial: Trial, columns: Sequence[str], computed: Sequence[str] = ()
) -> list[list[str]]:
    """The columns of each device: those sampled in the same rows. A `computed` column only joins a
    device of others."""
    found: dict[bytes, list[str]] = {}
    for column in columns:
        found.setdefault(trial.present(column).tobytes(), []).append(column)
    for column in computed:
        if column in trial.columns and (rows := trial.present(column).tobytes()) in found:
            found[rows].append(column)
    return list(found.values())


def streams(
    trial: Trial, devices: Sequence[Sequence[str]], silent: frozenset[str] = frozenset()
) -> list[Stream]:
    """The streams of a trial, one for the columns of each device (`devices_of`)."""
    found = []
    for names in devices:
        stamps, *values = trial.arrays(*names)
        of = {name: origin(trial, name) for name in names}
        choice = (
            trial.provenance.get(of[names[0]].get("file", ""), {})
            .get("time", {})
            .get("stamps", "auto")
        )
        counted = next((c for c in map(counter_column, names) if c in trial.columns), None)
        counter = None if counted is None else np.asarray(trial.arrays(counted)[1], dtype=np.int64)
        delays = {
            name: facts["delay"] for name, facts in of.items() if facts.get("delay") is not None
        }
        low_passes = {
            name: SensorLowPass(**low)
            for name, facts in of.items()
            if (low := facts.get("low_pass"))
        }
        signals = dict(zip(names, values, strict=True))
        fixture, known = of.get("torque", {}).get("fixture"), trial.provenance.get("stamps", {})
        measured = {
            name: known[name] and tuple(map(np.array, known[name]))
            for name in names
            if name in known
        }
        label = ", ".join(names)
        facts = (choice, counter, silent, delays, low_passes, measured, fixture, trial.clocks)
        found.append(Stream(label, stamps, signals, *facts))
    return found


def with_stamp_evidence(trial: Trial) -> Trial:
    """The trial with the evidence of its signals on their stamps in its provenance, under `stamps`:
    response and covariance of `StampEvidence` by column, or null. Later steps read it there instead
    of computing it again."""
    columns = [
        column for column in MOVED if column in trial.columns and trial.present(column).any()
    ]
    found: dict[str, Any] = {}
    with suppress(InputError):  # whoever needs these signals will say so
        for part in take(streams(trial, devices_of(trial, columns))):
            told = {
                name: [one.response.tolist(), one.covariance.tolist()]
                for name, one in part.evidence.items()
            }
            found |= {name: told.get(name) for name in part.signals}
    return replace(trial, provenance={**trial.provenance, "stamps": found})


def origin(trial: Trial, column: str) -> dict[str, Any]:
    """The provenance of a column; empty for a trial that was not ingested."""
    return dict(trial.provenance.get("columns", {}).get(column, {}))
