"""The measures of a recording's quality: sampling, clocks, damage to the log, the commanded motion,
sensors that saturate, stand still or wrap, force plates. They are numbers; limits and verdicts come
later (`judge`)."""

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.config.experiments import EXPERIMENTS, Experiment
from osl_analysis.errors import Change, InputError, listing
from osl_analysis.ingest.guard import find_leaps
from osl_analysis.measured import factor_of, true_differences, usual_size
from osl_analysis.plates import beside, plate_axes
from osl_analysis.signals import longest_run, run_at_extreme, run_edges, runs
from osl_analysis.signals.grid import GapLimits, devices_of, origin, streams, uniform_signals
from osl_analysis.signals.plateaus import STANDS, is_clamped, plateaus_of
from osl_analysis.signals.samples import take
from osl_analysis.spectral.sine_runs import Run
from osl_analysis.spectral.stepped_sine import Likeness, SteppedSineProtocol, stated_protocol
from osl_analysis.trial import Array, Trial, plate_columns, unit_of
from osl_analysis.units import si_factor

OF_CLAMPED = "the actuator stands, and its plateaus of current are analysed alone"


@dataclass(frozen=True)
class Commanded:
    """The stepped sine that the configuration commands: each amplitude at every frequency."""

    amplitudes_deg: Sequence[float] | None  # None, in any field: not stated
    frequencies_hz: Sequence[float] | None
    cycles: int | Sequence[int] | None  # one number for all frequencies, or one for each
    excitation: str = "auto"
    """What moves the joint in impedance trials: `stepped_sine`, `any` other motion, or `auto`: the
    recording tells."""

    @property
    def protocol(self) -> SteppedSineProtocol:
        """The same with amplitudes in rad and cycles at each frequency."""
        return stated_protocol(self.amplitudes_deg, self.frequencies_hz, self.cycles)


@dataclass(frozen=True)
class Examined:
    trial: Trial
    experiment: Experiment
    commanded: Commanded

    @cached_property
    def steps(self) -> dict[str, tuple[float, float, float]]:
        """Median, mean and largest sampling step [s] of each device, by the name of its first
        channel."""
        found = dict[str, tuple[float, float, float]]()
        for first, *_ in devices_of(
            self.trial, [one for one in self.trial.columns if one != "time"]
        ):
            steps = np.diff(self.trial.arrays(first)[0])
            if steps.size > 1:
                found[first] = float(np.median(steps)), float(steps.mean()), float(steps.max())
        return found

    @cached_property
    def is_clamped(self) -> bool:
        """Whether the recording is of an actuator that stands while its current is stepped: what
        lies between its plateaus, and when exactly samples were taken, does not matter."""
        if not self.experiment.may_stand:
            return False
        time, current = recorded(self.trial, "current")
        if not np.isfinite(current).all():
            return False
        at, motion = recorded(self.trial, self.experiment.motion)
        is_angle = bool(at.size)
        if not is_angle:
            at, motion = recorded(self.trial, "omega_m")
        on_rows = np.interp(time, at, motion) if at.size else None
        plateaus = plateaus_of(time, current)
        return is_clamped(time, current, plateaus, on_rows, is_angle, STANDS)


@dataclass(frozen=True)
class CheckResult:
    value: float | None  # in the check's unit; None where the check does not apply
    remark: str = ""  # the worst channel, or why the check does not apply


def not_applicable(reason: str) -> CheckResult:
    return CheckResult(None, f"not applicable: {reason}")


def worst(values: Mapping[str, float], reason: str) -> CheckResult:
    """The largest of the channels' values, with its channel; without channels, not applicable for
    this `reason`."""
    if not values:
        return not_applicable(reason)
    name = max(values, key=lambda channel: values[channel])
    return CheckResult(float(values[name]), name if values[name] else "")


def recorded(trial: Trial, column: str | None) -> tuple[Array, Array]:
    """Time [s] and values of a column, (n,) each, where it was sampled; empty without the column.
    NaN is left out."""
    if column is None or column not in trial.columns:
        return np.empty(0), np.empty(0)
    time, values = trial.arrays(column)
    missing = np.isnan(values)
    return (time[~missing], values[~missing]) if missing.any() else (time, values)


def median_step(time: Array) -> float:
    """Median step [s], or the mean step if most stamps are repeated; 0 for a single sample."""
    if time.size < 2:
        return 0.0
    usual_step = float(np.median(np.diff(time)))
    return usual_step or float(np.ptp(time)) / (time.size - 1)


def consecutive(time: Array, values: Array, seconds: float) -> Array:
    """Values (..., n) cut into consecutive pieces (..., k, m) of `seconds` each; the rest is
    dropped."""
    length = max(round(seconds / median_step(time)), 1) if time.size > 1 else 1
    return values[..., : time.size // length * length].reshape(*values.shape[:-1], -1, length)


# Sampling, clocks and damage. `judge/findings.yaml` says what each check measures.


def measure_rate(examined: Examined) -> CheckResult:
    if examined.is_clamped:
        return not_applicable(OF_CLAMPED)
    rates = {column: 1 / (median or mean) for column, (median, mean, _) in examined.steps.items()}
    said = ", ".join(f"{column} {rate:.6g} Hz" for column, rate in rates.items())
    return (
        CheckResult(min(rates.values()), said)
        if rates
        else not_applicable("no channel has three samples")
    )


def measure_jitter(examined: Examined) -> CheckResult:
    """Largest slow wander of a recorder's stamps about their line, in percent of a step. 0 if the
    signals or the source file decide how stamps are read (docs/time_base.md): scatter of any size
    then costs nothing."""
    if examined.is_clamped:
        return not_applicable(OF_CLAMPED)
    wander, remarks = {}, []
    columns = [
        column for column in examined.experiment.needed_columns if column in examined.trial.columns
    ]
    try:
        parts = take(streams(examined.trial, devices_of(examined.trial, columns), frozenset()))
    except InputError as error:
        return not_applicable(f"no time base, {error}")
    for part in parts:
        name, step = ", ".join(part.signals), part.clock.step
        wander[name] = 100 * part.clock.wander / step if part.matters and not part.firm else 0.0
        if part.matters:
            remarks.append(f"{name}: {100 * part.clock.sd / step:.3g} % of scatter, {part.why}")
    found = worst(wander, "no signals of a bench")
    return CheckResult(found.value, "; ".join(remarks)) if wander else found


def measure_gap(examined: Examined) -> CheckResult:
    if examined.is_clamped:
        return not_applicable(OF_CLAMPED)
    steps = examined.steps.items()
    gaps = {
        column: most - usual if most > 1.5 * usual else 0.0 for column, (usual, _, most) in steps
    }
    return worst(gaps, "no channel has three samples")


def measure_clock(examined: Examined) -> CheckResult:
    clock, logged = examined.trial.provenance.get("clock"), examined.trial.provenance.get("log", {})
    if not clock:
        return worst(logged.get("clocks_apart", {}), "one clock")
    ppm, error = 1e6 * clock["drift"], 1e6 * clock["drift_error"]
    outside = (
        f"{clock.get('rows_before', 0)} and {clock.get('rows_after', 0)} rows of the log before and"
        " after"
    )
    matched = (
        f"{clock['edges']} matched and {clock['excluded_edges']} excluded by"
        f" {clock.get('method', 'edges')}"
    )
    return CheckResult(
        beyond_sampling(clock["residual"], logged.get("rates_hz", {}).values()),
        f"drift {ppm:.1f} +- {error:.1f} ppm; {matched}; {outside} motion capture",
    )


def beyond_sampling(residual_s: float, rates_hz: Iterable[float]) -> float:
    """The RMS [s] of sync edges beyond that of sampling: an edge lies anywhere in a step of the
    log, whose rectangular distribution has the standard deviation step / sqrt(12)."""
    step_s = 1 / min(rates_hz, default=math.inf)
    return math.sqrt(max(residual_s**2 - step_s**2 / 12, 0.0))


def measure_damage(examined: Examined) -> CheckResult:
    if not (reports := examined.trial.provenance.get("damage")):
        return not_applicable("no damage report")
    states, said = (
        {None: "whether it is complete is not known", False: "the file is not complete"},
        list[str](),
    )
    for role, damage in reports.items():
        told = [
            f"{damage[key]} {key.replace('_', ' ')}"
            for key in ("chunks_lost", "lost")
            if damage.get(key)
        ]
        told += [
            states.get(damage.get("complete", True), ""),
            f"CRC {damage.get('crc')}" * ("crc" in damage),
        ]
        said.append(
            f"{role}: " * (len(reports) > 1)
            + "; ".join(filter(None, [*told, *(damage.get("remarks") or [])]))
        )
    return CheckResult(
        100 * max(float(one.get("share_lost") or 0.0) for one in reports.values()), "; ".join(said)
    )


def measure_truncation(examined: Examined) -> CheckResult:
    reports = examined.trial.provenance.get("damage", {})
    if any(damage.get("end_missing") for damage in reports.values()):
        return CheckResult(1.0, "no end: see whether the trial lasts as long as it should")
    return CheckResult(0.0) if reports else not_applicable("no damage report")


def measure_unit(examined: Examined) -> CheckResult:
    """Number of channels that the source file converts from another unit than their file states."""
    remarks = []
    for column, facts in examined.trial.provenance.get("columns", {}).items():
        if "unit_of_file" in facts:
            remarks.append(f"{column} is read in {facts['unit']}, not {facts['unit_of_file']}")
    return CheckResult(float(len(remarks)), "; ".join(remarks))


# The motion that was commanded.


def measure_protocol(examined: Examined) -> CheckResult:
    """Number of differences from the protocol: commanded pairs of amplitude and frequency that are
    missing or have other numbers of cycles, runs that were not commanded, and amplitudes of another
    size. A protocol may repeat a pair. A motion that is no stepped sine is remarked and counts
    0."""
    if not examined.experiment.stepped_sine or "theta" not in examined.trial.columns:
        return not_applicable("no stepped sine")
    commanded = examined.commanded.protocol
    try:
        angle = uniform_signals(examined.trial, ["theta"], GapLimits())
    except InputError as error:
        return not_applicable(f"no time base, {error}")
    excitation = examined.commanded.excitation if examined.experiment.any_motion else "stepped sine"
    if excitation == "any":
        return CheckResult(
            0.0, "not compared: the configuration says that any motion moves the joint"
        )
    alike = Likeness(angle.time, angle["theta"], commanded)
    if excitation == "auto" and alike.kind == "other":
        return CheckResult(0.0, "no stepped sine but another motion, which is fitted as such")
    if not (commanded.amplitudes and commanded.frequencies_hz):
        recorded = listing([str(run) for run in alike.runs], 20)
        return not_applicable(
            f"amplitudes_deg and frequencies_hz are not stated; recorded: {recorded}"
        )
    cycles = defaultdict[tuple[float, float], float](float)
    counts = commanded.cycles_at or (math.nan,) * len(commanded.frequencies_hz)
    for amplitude in commanded.amplitudes:
        for frequency, count in zip(commanded.frequencies_hz, counts, strict=True):
            cycles[amplitude, frequency] += count
    followed = [
        (commanded.amplitude_near(r.amplitude), commanded.frequency_near(r.frequency_hz))
        for r in alike.runs
    ]
    remarks = other_sizes(alike.runs, commanded)
    for (amplitude, frequency), wanted in cycles.items():
        own = [
            run
            for run, pair in zip(alike.runs, followed, strict=True)
            if pair == (amplitude, frequency)
        ]
        # Equal within 5 %, or half a cycle per run: a ramp has no sharp end. Cycles of a soft start
        # may count too.
        slack, least = max(0.05 * wanted, 0.5 * len(own)), sum(run.cycles for run in own)
        if not own:
            remarks.append(f"missing {np.rad2deg(amplitude):g} deg at {frequency:g} Hz")
        elif wanted < least - slack or wanted > slack + sum(
            cycles_with_ramps(run, alike) for run in own
        ):
            remarks.append(f"{' and '.join(map(str, own[:3]))}, commanded are {wanted:g}")
    remarks += [
        f"besides {run}" for run, pair in zip(alike.runs, followed, strict=True) if None in pair
    ]
    words = [*remarks[:20], *[f"and {len(remarks) - 20} differences more"] * (len(remarks) > 20)]
    pairs = len(commanded.amplitudes) * len(commanded.frequencies_hz)
    words = words or [f"{pairs} commanded pairs of amplitude and frequency found"]
    return CheckResult(float(len(remarks)), "; ".join(words))


def cycles_with_ramps(run: Run, alike: Likeness) -> float:
    """The cycles of a run, with those of a soft start or end beside it: the same period at another
    amplitude. If there are any, two more are added, because the outermost ones are too small to be
    seen."""
    others = [one for one in alike.runs if one is not run]
    start = max((one.stop for one in others if one.stop <= run.start), default=-np.inf)
    stop = min((one.start for one in others if one.start >= run.stop), default=np.inf)
    rises = alike.crossings[(alike.crossings > start) & (alike.crossings < stop)]
    apart = np.abs(np.diff(rises) * run.frequency_hz - 1) < 0.25
    margin = 0.35 / run.frequency_hz
    beside = apart & ((rises[:-1] < run.start - margin) | (rises[1:] > run.stop + margin))
    return run.cycles + np.count_nonzero(beside) + 2 * int(beside.any())


def other_sizes(found: Sequence[Run], commanded: SteppedSineProtocol) -> list[str]:
    """A sentence per amplitude more than 3 % off its command, at the slowest frequency: a bench
    loses least there."""
    slowest, said = min(commanded.frequencies_hz), []
    sizes = sorted(
        run.amplitude for run in found if commanded.frequency_near(run.frequency_hz) == slowest
    )
    near = [commanded.amplitude_near(size) for size in sizes]
    if len(sizes) == len(commanded.amplitudes) and None not in near:
        # all amplitudes may be off by one factor: matched by order
        near = [*sorted(commanded.amplitudes)]
    for size, meant in zip(sizes, near, strict=True):
        if meant is not None and abs(size / meant - 1) > 0.03:
            said.append(
                f"{np.rad2deg(size):.3g} deg at {slowest:g} Hz, commanded are {np.rad2deg(meant):g}"
                f" deg (if the joint did them, theta is {size / meant:.3g} times its angle, and K"
                f" {meant / size:.3g} times its own)"
            )
    return said


# Saturation: load cells, currents and encoders that stand at an end of their range.


def stated_range(trial: Trial, column: str) -> tuple[float, float] | None:
    """Lowest and highest value of a channel that its source file states, in the column's unit; None
    if not stated."""
    ends = trial.provenance.get("columns", {}).get(column, {}).get("range")
    return (float(ends[0]), float(ends[1])) if ends else None


def check_ranges(trial: Trial) -> None:
    """Refuse values beyond the sensor's range as the source file states it (InputError)."""
    for column in trial.columns:
        if (ends := stated_range(trial, column)) is None or not (
            values := recorded(trial, column)[1]
        ).size:
            continue
        (low, high), (least, most) = ends, (float(values.min()), float(values.max()))
        slack = 0.01 * (high - low)  # electronics reach a little further than data sheets
        if least < low - slack or most > high + slack:
            raise InputError(
                f"trial {trial.name}: {column} goes from {least:.4g} to {most:.4g}"
                f" {unit_of(column)}, beyond the `range` of its sensor, {low:g} to {high:g};"
                " correct `unit`, `scale` or `range` in the source file"
            )


def samples_at_rail(trial: Trial, column: str, torque: str | None = None) -> int:
    """Longest run [samples] of a channel at an end of its stated range, or at its lowest or highest
    value. 0 for a command, which has levels, and for a torque without noise while the joint rests.
    A driven angle may rest at an extreme: it is clipped only if `torque` changes meanwhile. Do not
    ask this of a motor behind a belt: its own friction may hold it."""
    time, values = recorded(trial, column)
    if not values.size or not np.isfinite(values).all():  # the fit refuses it
        return 0
    if column.startswith("theta"):
        seen = 0 if torque is None else longest_clipped_angle(time, values, recorded(trial, torque))
    else:
        rail = run_at_extreme(values)
        changes = np.flatnonzero(np.diff(values, prepend=np.nan)).astype(float)
        # rows per value, if the source is slower than the log (as floats: a median of equal
        # integers is slow)
        held_for = int(np.median(np.diff(changes))) if len(changes) > 1 else 1
        if column == "current":
            stands = is_command(values)
        else:
            beside = values[values != values[rail.start]]
            stands = is_command(beside) and angle_rests(trial, time[rail])
        seen = 0 if stands else length(rail) // held_for
    if ends := stated_range(trial, column):
        near = 1e-3 * (ends[1] - ends[0])
        for there in map(longest_run, (values <= ends[0] + near, values >= ends[1] - near)):
            seen = max(seen, length(there))
    return seen


def angle_rests(trial: Trial, time: Array) -> bool:
    """Whether the joint's angle hardly changes in the middle of these times (n,) [s]; a torque may
    be late at both ends."""
    when, angle = recorded(trial, "theta")
    if not angle.size or not time.size:
        return False
    during = means_of(np.interp(middle_half(time), when, angle))
    return bool(np.ptp(during) < AT_REST / 4 * np.ptp(angle))


def middle_half(values: Array) -> Array:
    return values[values.size // 4 : values.size - values.size // 4]


def is_command(values: Array) -> bool:
    """Whether a channel (n,) has levels without noise: beside its longest run, over 30 % of samples
    repeat the last."""
    repeated = np.diff(values) == 0
    return bool(repeated.sum() - length(longest_run(repeated)) > 0.3 * repeated.size)


LEAST_CHANGE = 0.02  # share of a reference's range; a joint at rest creeps by less
LEAST_AT_RAIL = 5  # samples; a peak may have as many
CORNER_STEPS = 8.0  # a sine that is rounded to steps moves by four within half of its standing time
MEANS = 16  # of a run, which scatter less than single samples
NOISE_SDS = 8.0  # of such a mean, that are a change


def longest_clipped_angle(time: Array, theta: Array, torque: tuple[Array, Array]) -> int:
    """Longest run [samples] of an angle (n,) at its lowest or highest value while the joint turns
    on, as the `torque`, times [s] and values, tells.

    The angle must reach and leave the rail with a corner, and turn on for most of the time there.
    An angle behind play stands at other values as often.
    """
    when, values = torque
    if min(theta.size, values.size) <= LEAST_AT_RAIL or not np.isfinite(values).all():
        return 0
    noise = usual_size(np.diff(values, 3)) / 3.016  # of white noise
    least = LEAST_CHANGE * float(np.ptp(values))
    step = smallest_step(theta)

    def is_clipped(run: slice) -> bool:
        during = slice(*np.searchsorted(when, (time[run.start], time[run.stop - 1])))
        corner = CORNER_STEPS * step
        return has_corners(theta, run, corner) and turns_on(values[during], least, noise)

    longest = 0
    rails = (theta.min(), theta.max())
    for rail in rails:
        standing = [run for run in runs(theta == rail) if length(run) > LEAST_AT_RAIL]
        clipped = [length(run) for run in standing if is_clipped(run)]
        # long runs tell more
        if 2 * sum(n**2 for n in clipped) > sum(length(run) ** 2 for run in standing):
            longest = max(longest, *clipped)
    if not longest:
        return 0
    alike = [slice(first, stop + 1) for first, stop in run_edges(np.diff(theta) == 0).tolist()]
    as_long = [run for run in alike if 2 * length(run) > longest and is_clipped(run)]
    at_rail = [theta[run.start] in rails for run in as_long]
    return longest if 2 * sum(at_rail) >= len(at_rail) else 0


def length(run: slice) -> int:
    return int(run.stop - run.start)


def means_of(values: Array) -> Array:
    """Means of up to `MEANS` parts of values (n,), equally long."""
    return np.array([part.mean() for part in np.array_split(values, MEANS) if part.size])


def has_corners(theta: Array, run: slice, least: float) -> bool:
    """Whether an angle (n,) is further than `least` from where it stands, half as long before and
    after the run."""
    half = length(run) // 2
    sides = [at for at in (run.start - half, run.stop - 1 + half) if 0 <= at < theta.size]
    return bool(sides and np.abs(theta[sides] - theta[run.start]).min() > least)


def turns_on(values: Array, least: float, noise: float) -> bool:
    """Whether a torque (n,) with white noise changes as that of a joint that turns on and back: by
    more than `least`, and in the middle of the time, too, there and back or no less than before. At
    rest it settles."""
    if not values.size:
        return False
    means = means_of(values)
    middle = middle_half(means)
    change = np.ptp(middle)
    scatter = NOISE_SDS * noise * math.sqrt(means.size / values.size)
    if np.ptp(means) <= least or change <= max(least / 4, scatter):
        return False
    ends = middle[[0, -1]]
    returns = max(middle.max() - ends.max(), ends.min() - middle.min())
    half = middle.size // 2
    return bool(returns > change / 4 or np.ptp(middle[half:]) >= np.ptp(middle[:-half]))


def smallest_step(values: Array) -> float:
    """Smallest difference between two values of a signal (n,), apart from rounding errors."""
    return float(np.min(true_differences(np.unique(values)), initial=np.ptp(values)))


def raw_channels(trial: Trial) -> dict[str, Mapping[str, Any]]:
    """Facts on every raw channel of the trial's plates, by name, as ingest recorded them."""
    return {
        f"plate{plate['plate']} channel {facts['label']}": facts
        for plate in trial.provenance.get("plates", [])
        for facts in plate.get("channels", [])
    }


def noisy_channels(trial: Trial) -> dict[str, tuple[Array, Array]]:
    """Time [s] and values of channels that noise keeps changing: torques, current, and the forces
    and moments of plates whose raw channels are not known."""
    noisy = {"current"} | {facts.torque for facts in EXPERIMENTS.values()}
    plates = {name.partition(" ")[0] for name in raw_channels(trial)}
    columns = [c for c in trial.samples.columns if c in noisy or c.startswith("plate")]
    found = {c: recorded(trial, c) for c in columns if c.partition("_")[0] not in plates}
    return {name: x for name, x in found.items() if x[1].size}


def measure_saturation(examined: Examined) -> CheckResult:
    # an angle that is not driven may stand by friction
    trial, driven = examined.trial, examined.experiment.motion
    names = [
        *noisy_channels(trial),
        *(c for c in trial.samples.columns if c == driven or stated_range(trial, c)),
    ]
    lengths = {name: samples_at_rail(trial, name, examined.experiment.torque) for name in names}
    lengths |= {name: facts["clipped_samples"] for name, facts in raw_channels(trial).items()}
    return worst(lengths, "no torque, current or plate")


def saturated(trial: Trial, torque: str = "torque", *others: str) -> pl.Expr:
    """The column `saturated_samples`: the longest `samples_at_rail` of the torque and the other
    columns."""
    longest = max(samples_at_rail(trial, column, torque) for column in (torque, *others))
    return pl.lit(longest, pl.Int64).alias("saturated_samples")


# Channels that stand still: torque, current, plates and angles.

AT_REST = 0.02  # share of the angle's range by which a joint at rest may creep
AVERAGED_S = 0.05  # of a reference; a sine of 5 Hz keeps nine tenths of its amplitude


def measure_stuck(examined: Examined) -> CheckResult:
    """Longest time [s] that a noisy channel repeats one value, or that an angle stands while its
    command (or else the averaged torque) changes. These do not count: a load cell with coarse steps
    while the joint rests; a plate at 0, which Nexus writes without load; a joint at rest in static
    and plate trials; a channel that the experiment does not use, such as a locked motor; a current
    before the motion starts."""
    trial, columns = examined.trial, examined.trial.samples.columns
    moving = examined.experiment.motion or ("theta" if examined.experiment.tables else "")
    angle = recorded(trial, moving if moving in columns else "theta")
    times, channels = {}, noisy_channels(trial)
    used = {name.partition("_")[0] for name, (_, x) in channels.items() if x.any()}
    for name, (time, x) in channels.items():
        # a channel that is always 0 is dead if another channel of its plate is not
        if name.startswith("plate"):
            dead = not x.any() and name.partition("_")[0] in used
            times[name] = float(np.ptp(time)) if dead else held(time, np.where(x == 0, np.nan, x))
        elif not examined.experiment.uses(name):
            times[name] = 0.0
        elif name == "current":
            times[name] = 0.0 if is_command(x) else held(time, without_start(time, x, angle))
        elif angle[0].size < 2 or not np.ptp(x):
            times[name] = held(time, x)
        else:
            turned = time, np.interp(time, *angle)
            times[name] = held(time, x, turned, AT_REST * float(np.ptp(angle[1])))
    for name, facts in raw_channels(trial).items():
        times[name] = (facts["stands_to_s"] or 0.0) - (facts["stands_from_s"] or 0.0)
    by = next((c for c in ("theta_command", "torque") if c in columns), None)
    reference = recorded(trial, by)
    time, theta = recorded(trial, "theta")
    if time.size and reference[0].size:
        when, level = consecutive(reference[0], np.stack(reference), AVERAGED_S).mean(axis=-1)
        if when.size:  # while it changes by a fifth of its range, the joint should have moved
            times["theta"] = held(time, theta, (when, level), 0.2 * float(np.ptp(level)))
    if moving in columns and angle[1].size and not np.ptp(angle[1]):
        times[moving] = float(np.ptp(angle[0]))
    return worst(times, "no torque, current or plate")


def without_start(time: Array, values: Array, angle: tuple[Array, Array]) -> Array:
    """A channel (n,), NaN while it stands at the beginning, before the `angle` moves: the drive is
    still off."""
    changed = np.flatnonzero(values != values[0])
    if not changed.size or angle[0].size < 2:
        return values
    moved = np.abs(angle[1] - angle[1][0]) > AT_REST * np.ptp(angle[1])
    is_rest = moved.any() and time[changed[0]] <= angle[0][np.argmax(moved)]
    return np.where((np.arange(len(values)) < changed[0]) & is_rest, np.nan, values)


def held(
    time: Array,
    values: Array,
    reference: tuple[Array, Array] | None = None,
    least: float = 0.0,
) -> float:
    """Longest time [s] that a channel (n,) repeats one value while its reference (times, values)
    changes by more than `least` in the middle half of it: at rest a reference settles, and it may
    be earlier or later than the channel at both ends."""
    edges = run_edges(np.diff(values) == 0)
    if reference is not None and len(edges):
        when, what = reference
        begin, end = time[edges[:, 0]], time[edges[:, 1]]
        quarter = (end - begin) / 4
        first, stop = np.searchsorted(when, (begin + quarter, end - quarter))
        padded, rows = np.append(what, what[-1]), np.stack([first, stop], axis=1).ravel()
        change = (np.maximum.reduceat(padded, rows) - np.minimum.reduceat(padded, rows))[::2]
        edges = edges[(change > least) & (stop > first)]
    return float(np.diff(edges).max(initial=0) * median_step(time))


def measure_dropout(examined: Examined) -> CheckResult:
    """Largest number of leaps of the angle or the torque off its curve (`guard.find_leaps`)."""
    trial = examined.trial
    angle = "theta" if "theta" in trial.columns else "theta_m"
    guarded = [column for column in (angle, "torque") if column in trial.columns]
    if not guarded:
        return not_applicable("no angle and no torque")
    leaps = [find_leaps(column, *trial.arrays(column)) for column in guarded]
    most = max(leaps, key=lambda of_column: of_column.count)
    if not most.count:
        return CheckResult(0.0)
    words = (
        f"{most.column} leaps {most.count} times, first at {most.times[0]:.3f} s: rows were lost or"
        " doubled, or a sensor failed; state `windows` without them"
    )
    return CheckResult(float(most.count), words)


def measure_unzeroed_plate(examined: Examined) -> CheckResult:
    """Largest level [N] of a bare plate: the mean over 0.2 s at rest that is nearest to zero. A
    larger positive level may be a load, unless the experiment leaves every plate bare at some
    time."""
    at_rest = 20.0  # N, largest standard deviation of a plate at rest
    counted, loaded, remarks = [], [], []
    for column in examined.trial.samples.columns:
        if not (column.startswith("plate") and column.endswith("_force_z")):
            continue
        plate, parts = (
            column.removesuffix("_force_z"),
            consecutive(*recorded(examined.trial, column), 0.2),
        )
        quiet = parts[parts.std(axis=1) < at_rest].mean(axis=1)
        level = float(quiet[np.argmin(abs(quiet))]) if quiet.size else np.inf
        if not quiet.size or not (level < at_rest or examined.experiment.bare_plate):
            loaded.append(f"{plate} is never at rest, or loaded throughout")
            continue
        counted.append(abs(level))
        remarks.append(f"{plate} {level:.1f} N")
        # N: somebody's weight, where a plate was zeroed
        if examined.experiment.walker and level <= -200:
            remarks[-1] += (
                ", a person's weight with the wrong sign: correct the plate's `sign` or corners, or"
                " `axes` in the source file, unless it was zeroed while somebody stood on it"
            )
    if not counted:
        return not_applicable(
            "the plates are never at rest, or loaded throughout" if loaded else "no plate"
        )
    return CheckResult(max(counted), ", ".join(remarks + loaded))


def measure_encoder_wrap(examined: Examined) -> CheckResult:
    """Number of steps of an angle by one turn, within 10 %, or by 360 (degrees declared as
    radians)."""
    jumps: dict[str, float] = {}
    for column in ("theta", "theta_m", "theta_command"):
        if column in examined.trial.columns:
            jump = abs(np.diff(recorded(examined.trial, column)[1]))
            jumps[column] = float(
                sum((abs(jump / turn - 1) < 0.1).sum() for turn in (2 * np.pi, 360.0))
            )
    return worst(jumps, "no angle")


def measure_marker_gap(examined: Examined) -> CheckResult:
    """Longest time [s] that a marker was hidden between two sightings, minus one step; the whole
    time if it was never seen. The remark counts the markers with gaps."""
    gaps = {}
    for column in examined.trial.samples.columns:
        if column.startswith("marker_") and column.endswith("_x"):
            time, x = examined.trial.arrays(column)
            seen, usual = time[~np.isnan(x)], median_step(time)
            longest = float(np.diff(seen).max(initial=0.0)) - usual
            if not seen.size and time.size:
                longest = float(np.ptp(time))
            gaps[column.removeprefix("marker_").removesuffix("_x")] = (
                longest if longest > 0.5 * usual else 0.0
            )
    result, with_gaps = worst(gaps, "no markers"), sum(gap > 0 for gap in gaps.values())
    return (
        CheckResult(result.value, f"{result.remark}; {with_gaps} of {len(gaps)} markers")
        if with_gaps
        else result
    )


# Force plates: while somebody walks over a plate, the centre of pressure lies on it and moves.


def pressed_plates(trial: Trial) -> Iterator[tuple[int, Array, Array]]:
    """For every loaded plate with known corners and columns: its number, corners (4, 3) [m], and
    the centre of pressure (k, 2) [m] in the loaded samples, from the plate's centre along its
    edges."""
    for plate in trial.provenance.get("plates", []):
        number, corners = int(plate["plate"]), np.array(plate["corners"], dtype=float)
        columns = [*plate_columns(number, "force"), *plate_columns(number, "moment")]
        if set(columns) <= set(trial.columns):
            values, axes = trial.sampled(*columns).select(columns).to_numpy(), plate_axes(corners)
            vertical = values[:, :3] @ axes[:, 2]
            # N; below, noise and a moving platform shift the centre of pressure
            loaded = vertical > 100.0
            if loaded.sum() >= 10:  # samples
                point = np.cross(axes[:, 2], values[loaded, 3:]) / vertical[loaded, None]
                yield number, corners, np.asarray(point @ axes[:, :2])


def travel(points: Array) -> float:
    """Distance [m] between the 5th and 95th percentiles of points (k, 2) [m]."""
    low, high = np.percentile(points, [5, 95], axis=0)
    return float(np.hypot(*(high - low)))


def measure_pressure_centre(examined: Examined) -> CheckResult:
    """Largest distance [m] of a centre of pressure outside its plate under load: the 80th
    percentile over samples. The first and last samples of a stance are inexact. While a plate is
    turned, its own inertia, which the analysis takes away, moves the point far out. The remark
    gives the likely cause."""
    if not examined.experiment.walker:
        return not_applicable("nobody stands on a plate")
    distances, remarks = [], []
    for number, corners, points in pressed_plates(examined.trial):
        distance, thousandth = (
            float(np.percentile(beside(p, corners), 80)) for p in (points, points / 1000)
        )
        distances.append(distance)
        if distance > 0:
            why = "a moment channel is dead, clipped or of the other sign, or the corners are wrong"
            # m, which a rolling foot covers at least
            if thousandth == 0 and travel(points / 1000) > 0.02:
                why = (
                    "its moments look a thousand times too large; state `plate_units` in the source"
                    " file, as "
                )
                why += "{force: N, moment: N*mm}"
            remarks.append(
                f"plate{number}: the centre of pressure is {distance:.3g} m outside: {why}"
            )
    return (
        CheckResult(max(distances), "; ".join(remarks))
        if distances
        else not_applicable("no plate is stood on")
    )


def measure_pressure_travel(examined: Examined) -> CheckResult:
    if not (examined.experiment.walker and examined.experiment.tables):
        return not_applicable("nobody walks over a plate")
    ways = [(travel(points), number) for number, _, points in pressed_plates(examined.trial)]
    if not ways:
        return not_applicable("no plate is stood on")
    way, number = min(ways)
    return CheckResult(
        way,
        f"plate{number}: if it stands still, the moments are dead or a thousand times too small",
    )


# Recordings of a bench that are refused before a fit.

ANGLES = ("theta", "theta_m", "theta_command")
CONFUSED_UNITS = {"rad": ("rad", "deg", "mrad"), "N*m": ("N*m", "N*mm", "N*cm")}
"""By SI unit, the most usual ones first."""
SMALLEST_MOTION = math.radians(0.5)  # of an angle's range; no recording of a joint has less


def check_own_torque(trial: Trial, torque: str = "torque") -> None:
    """Refuse a torque that is the motor's current times a constant, or another function of what the
    log has: a fit to it would be circular."""
    own = origin(trial, torque)
    if own.get("computed_from"):
        raise InputError(
            f"trial {trial.name}: {torque} follows exactly from {own['computed_from']}: it is"
            " computed, not measured, and a fit gives the formula back; name the channel of a load"
            f" cell as {torque} in the source file, or write experiment ingest_only"
        )
    both = trial.arrays(torque, "current")[1:] if {torque, "current"} <= set(trial.columns) else ()
    if both and (factor := factor_of(*both)) is not None:
        raise InputError(
            f"trial {trial.name}: {torque} is current times {factor:.4g} {unit_of(torque)}/A, to"
            " within rounding: it is computed from the motor's current, not measured, so that a"
            f" fit gives what it was computed with; name the channel of a load cell as {torque} in"
            " the source file, or state the experiment ingest_only"
        )


def check_recording(
    trial: Trial, limits: Any, torque: str = "torque", angle: str | None = "theta"
) -> None:
    """Refuse an angle beyond `limits.largest_angle` [rad]; a torque beyond `limits.load_cell_range`
    [N*m], constant while the joint turns, or computed from the current (`check_own_torque`); and
    samples less than 10 us apart."""
    who, time = f"trial {trial.name}:", trial.arrays()[0]
    # The mean step: stamps of a late host come in clusters, and the steps within one are
    # microseconds.
    step = float(np.ptp(time)) / (len(time) - 1) if len(time) > 1 else 0.0
    if 0 < step < 1e-5:  # no recorder of a joint is faster than 100 kHz
        larger = Change("take a 1000 times larger `unit` of `time` (s for ms)", {"time": 1e3})
        raise InputError(
            f"{who} its samples are {step:.2g} s apart, {1 / step:.3g} in a second; correct the"
            " `unit` of `time` in the source file",
            [larger],
        )
    check_own_torque(trial, torque)
    turned, measured = (
        x[np.isfinite(x)] for x in (recorded(trial, angle)[1], recorded(trial, torque)[1])
    )
    turn, change = (float(np.ptp(x)) if x.size else 0.0 for x in (turned, measured))
    if turn and measured.size > 1 and not change:
        said = (
            f"{who} {torque} is {measured[0]:.4g} N*m in all samples while {angle} turns by"
            f" {turn:.2g} rad"
        )
        raise InputError(
            f"{said}; is this the channel of the load cell? Correct it in the source file"
        )
    if turn / 2 > limits.largest_angle:
        angles = [name for name in ANGLES if name in trial.columns]
        assert angle is not None
        too_large = [name for name in angles if half_range(trial, name) > limits.largest_angle]
        changes = in_other_units(trial, too_large)
        cause = "is it another channel, or of another unit or scale? Correct it in the source file"
        if measured.size and change / 2 < limits.largest_angle:
            changes = swapped_channels(trial, angle, torque)
            cause = (
                f"{torque} has +-{change / 2:.2g} N*m only, are the two swapped? Correct them in"
                " the source file"
            )
        if np.abs(np.diff(turned)).max() > 0.9 * turn:
            changes = []
            cause = (
                "it jumps so far from a row to the next, as where an encoder begins anew: state"
                " after how much of its own unit, as `wraps_at: 360` or 65536, in the source file"
            )
        said = f"{who} {angle} turns by +-{turn / 2:.3g} rad ({math.degrees(turn / 2):.0f} deg)"
        limit = (
            f"more than the {limits.largest_angle:g} rad of `largest_angle` in the configuration"
        )
        raise InputError(f"{said}, {limit}; {cause}", changes)
    largest = float(np.abs(measured).max(initial=0.0))
    if limits.load_cell_range is not None and largest > limits.load_cell_range:
        raise InputError(
            f"{who} {torque} reaches {largest:.4g} N*m, more than the {limits.load_cell_range:g}"
            " N*m of `load_cell_range` in the configuration; correct its `unit` or `scale` in the"
            " source file, or the range",
            in_other_units(trial, [torque]),
        )


def swapped_channels(trial: Trial, angle: str, torque: str) -> list[Change]:
    """The changes that exchange the channels of two columns, each of which keeps its unit; then
    with an angle in deg."""
    words = f"swap the channels of {angle} and {torque} in the source file"
    factor = float(origin(trial, angle).get("factor", 1))
    of_torque = float(origin(trial, torque).get("factor", 1))
    swapped = {angle: torque, torque: angle}
    in_deg = {angle: math.radians(1) / of_torque, torque: of_torque / factor}
    return [
        Change(words, {**in_deg, angle: factor / of_torque}, swapped),
        Change(f"{words}, and state `unit: deg` of {angle}", in_deg, swapped, rank=1),
    ]


def half_range(trial: Trial, column: str) -> float:
    """Half of the range of a column; 0 of one without readings."""
    values = recorded(trial, column)[1]
    finite = values[np.isfinite(values)]
    return float(np.ptp(finite)) / 2 if finite.size else 0.0


def in_other_units(trial: Trial, columns: Sequence[str]) -> list[Change]:
    """The changes that take columns for numbers of another unit than they are declared in, the more
    usual unit first. A unit with which the joint hardly moves is none of them."""
    si_unit = unit_of(columns[0])
    declared = float(origin(trial, columns[0]).get("factor", 1))
    turn = 2 * half_range(trial, "theta") if "theta" in trial.columns else math.inf
    changes: list[Change] = []
    for unit in CONFUSED_UNITS[si_unit]:
        factor = si_factor(unit, si_unit) / declared
        moves = turn * (factor if "theta" in columns else 1) > SMALLEST_MOTION
        if moves and not math.isclose(factor, 1):
            words = f"state `unit: {unit}` of {' and '.join(columns)} in the source file"
            changes.append(Change(words, dict.fromkeys(columns, factor), rank=len(changes)))
    return changes


MEASURES: dict[str, tuple[Callable[[Examined], CheckResult], str]] = {
    "rate": (measure_rate, "Hz"), "jitter": (measure_jitter, "%"), "gap": (measure_gap, "s"),
    "saturation": (measure_saturation, "samples"), "stuck": (measure_stuck, "s"),
    "dropout": (measure_dropout, "samples"),
    "unzeroed_plate": (measure_unzeroed_plate, "N"), "encoder_wrap": (measure_encoder_wrap,
    "jumps"),
    "marker_gap": (measure_marker_gap, "s"),
    "pressure_centre": (measure_pressure_centre, "m"), "pressure_travel": (measure_pressure_travel,
    "m"),
    "clock_residual": (measure_clock, "s"), "damage": (measure_damage, "%"),
    "truncated": (measure_truncation, "logs"), "unit": (measure_unit, "channels"),
    "protocol": (measure_protocol, "segments"),
}  # fmt: skip
"""Every check by name: its function and the unit of its value. A new check also needs its
entry and its finding in `judge/findings.yaml`, its rule under `quality` in config/config.yaml, and
a test."""
UNITS = {name: unit for name, (_, unit) in MEASURES.items()}


def examine(
    trial: Trial, experiment: str, commanded: Commanded, windows: str = ""
) -> dict[str, CheckResult]:
    """The result of every check on a trial, by name. `commanded` is the protocol of stepped-sine
    experiments; leaps outside of the `windows` [s] that are fitted do not count."""
    facts = EXPERIMENTS[experiment]
    examined = Examined(trial, facts, commanded)
    results = {name: measure(examined) for name, (measure, _) in MEASURES.items()}
    if windows and facts.fit is not None and facts.fit.windows:
        results["dropout"] = measure_dropout(replace(examined, trial=trial.within(windows)))
    return results


def measured_table(trial: str, results: Mapping[str, CheckResult]) -> pl.DataFrame:
    """What `examine` measured, a row per check: trial, check, value, unit, remark."""
    rows = [
        (trial, name, result.value, UNITS[name], result.remark) for name, result in results.items()
    ]
    columns = dict.fromkeys(("trial", "check", "value", "unit", "remark"), pl.String) | {
        "value": pl.Float64
    }
    return pl.DataFrame(rows, columns, orient="row")
