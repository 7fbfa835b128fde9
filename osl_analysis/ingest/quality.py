"""The measures of a recording's quality, one rule for each check. They are numbers; limits and
verdicts come later (`judge`)."""

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.config.experiments import EXPERIMENTS, Experiment
from osl_analysis.errors import InputError, listing
from osl_analysis.ingest.guard import recorded, stated_range
from osl_analysis.ingest.leaps import find_leaps
from osl_analysis.ingest.repeats import (
    has_levels,
    repeats,
    run_at_extreme,
    standing_runs,
)
from osl_analysis.plates import beside, plate_axes
from osl_analysis.signals import longest_run
from osl_analysis.signals.grid import GapLimits, devices_of, streams, uniform_signals
from osl_analysis.signals.plateaus import STANDS, is_clamped, plateaus_of
from osl_analysis.signals.samples import take
from osl_analysis.spectral.stepped_sine import (
    Run,
    SteppedSineProtocol,
    find_sines,
    stated_protocol,
)
from osl_analysis.trial import Array, Trial, plate_columns


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
    fitted: Trial  # the part that is fitted

    @property
    def steps(self) -> dict[str, Array]:
        """Sampling steps [s] of each device, by the name of its first channel."""
        columns = [column for column in self.trial.columns if column != "time"]
        firsts = [first for first, *_ in devices_of(self.trial, columns)]
        steps = {first: np.diff(self.trial.arrays(first)[0]) for first in firsts}
        return {first: of_device for first, of_device in steps.items() if of_device.size > 1}


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


def usual_step(steps: Array) -> float:
    """Median of steps (n,) [s], or their mean if most stamps are repeated; 0 of none."""
    return float(np.median(steps)) or float(steps.mean()) if steps.size else 0.0


# Sampling, clocks and damage. `judge/findings.yaml` says what each check measures.


def measure_rate(examined: Examined) -> CheckResult:
    rates = {column: 1 / usual_step(steps) for column, steps in examined.steps.items()}
    if not rates:
        return not_applicable("no channel has three samples")
    words = [f"{column} {rate:.6g} Hz" for column, rate in rates.items()]
    return CheckResult(min(rates.values()), ", ".join(words))


def measure_jitter(examined: Examined) -> CheckResult:
    """Largest slow wander of a recorder's stamps about their line, in percent of a step. 0 if the
    signals or the source file decide how stamps are read (docs/time_base.md): scatter of any size
    then costs nothing."""
    trial = examined.trial
    columns = [name for name in examined.experiment.needed_columns if name in trial.columns]
    try:
        parts = take(streams(trial, columns))
    except InputError as error:
        return not_applicable(f"no time base, {error}")
    if not parts:
        return not_applicable("no signals of a bench")
    deciding = [part for part in parts if part.matters]
    wander = [100 * part.clock.wander / part.clock.step for part in deciding if not part.firm]
    return CheckResult(max(wander, default=0.0), "; ".join(part.why for part in deciding))


def measure_gap(examined: Examined) -> CheckResult:
    gaps = {column: longest_gap(steps) for column, steps in examined.steps.items()}
    return worst(gaps, "no channel has three samples")


def longest_gap(steps: Array) -> float:
    """The longest of sampling steps (n,) [s] beyond the usual one; 0 if none is longer than 1.5."""
    usual = float(np.median(steps)) if steps.size else 0.0
    longest = float(steps.max(initial=0.0))
    return longest - usual if longest > 1.5 * usual else 0.0


def measure_clock(examined: Examined) -> CheckResult:
    """RMS [s] of sync edges about the fit beyond that of sampling: an edge lies anywhere in a step
    of the log, whose rectangular distribution has the standard deviation step / sqrt(12)."""
    facts = examined.trial.provenance
    clock = facts.get("clock")
    log = facts.get("log", {})
    if not clock:
        return worst(log.get("clocks_apart", {}), "one clock")
    step_s = 1 / min(log.get("rates_hz", {}).values(), default=math.inf)
    residual = math.sqrt(max(clock["residual"] ** 2 - step_s**2 / 12, 0.0))
    return CheckResult(
        residual,
        f"drift {1e6 * clock['drift']:.1f} +- {1e6 * clock['drift_error']:.1f} ppm;"
        f" {clock['edges']} matched and {clock['excluded_edges']} excluded by {clock['method']};"
        f" {clock['rows_before']} and {clock['rows_after']} rows of the log before and after motion"
        " capture",
    )


def measure_damage(examined: Examined) -> CheckResult:
    reports = examined.trial.provenance.get("damage")
    if not reports:
        return not_applicable("no damage report")
    remarks: list[str] = []
    for role, damage in reports.items():
        if damage.get("lost"):
            remarks.append(f"{role}: {damage['lost']} lost")
        elif not damage.get("complete", True):
            remarks.append(f"{role}: whether it is complete is not known")
        remarks += [f"{role}: {text}" for text in damage.get("remarks", ())]
    lost = max(float(damage.get("share_lost") or 0.0) for damage in reports.values())
    return CheckResult(100 * lost, "; ".join(remarks))


def measure_truncation(examined: Examined) -> CheckResult:
    reports = examined.trial.provenance.get("damage", {})
    if any(damage.get("end_missing") for damage in reports.values()):
        return CheckResult(1.0, "no end: see whether the trial lasts as long as it should")
    return CheckResult(0.0) if reports else not_applicable("no damage report")


def measure_unit(examined: Examined) -> CheckResult:
    """Number of channels that the source file converts from another unit than their file states."""
    remarks: list[str] = []
    for column, facts in examined.trial.provenance.get("columns", {}).items():
        if "unit_of_file" in facts:
            remarks.append(f"{column} is read in {facts['unit']}, not {facts['unit_of_file']}")
    return CheckResult(float(len(remarks)), "; ".join(remarks))


# The motion that was commanded.

MOST_REMARKS = 20
OTHER_SIZE = 0.03  # share by which an amplitude differs from its command
OTHER_CYCLES = 0.05  # share by which the number of cycles may differ
UNSEEN_CYCLES = 0.5  # of a run, which has no sharp end
MOST_IN_RAMPS = 1.5  # commanded cycles over those of a run: a soft start and end may count, too


def measure_protocol(examined: Examined) -> CheckResult:
    """Number of differences from the protocol: commanded pairs of amplitude and frequency that are
    missing or have other numbers of cycles, runs that were not commanded, and amplitudes of another
    size. A protocol may repeat a pair. A motion that is no stepped sine is remarked and counts
    0."""
    experiment = examined.experiment
    protocol = examined.commanded.protocol
    if not experiment.stepped_sine or "theta" not in examined.trial.columns:
        return not_applicable("no stepped sine")
    excitation = examined.commanded.excitation if experiment.any_motion else "stepped_sine"
    if excitation == "any":
        return CheckResult(
            0.0, "not compared: the configuration says that any motion moves the joint"
        )
    try:
        angle = uniform_signals(examined.trial, ["theta"], GapLimits())
    except InputError as error:
        return not_applicable(f"no time base, {error}")
    sines = find_sines(angle.time, angle["theta"], protocol)
    if excitation == "auto" and sines.moving.any() and not sines.is_stepped:
        return CheckResult(0.0, "no stepped sine but another motion, which is fitted as such")
    if not (protocol.amplitudes and protocol.frequencies_hz):
        runs = listing([str(run) for run in sines.runs], MOST_REMARKS)
        return not_applicable(f"amplitudes_deg and frequencies_hz are not stated; recorded: {runs}")
    remarks = differences(sines.runs, protocol)
    if not remarks:
        pairs = len(protocol.amplitudes) * len(protocol.frequencies_hz)
        return CheckResult(0.0, f"{pairs} commanded pairs of amplitude and frequency found")
    more = [f"and {len(remarks) - MOST_REMARKS} more"] if len(remarks) > MOST_REMARKS else []
    return CheckResult(float(len(remarks)), "; ".join(remarks[:MOST_REMARKS] + more))


def differences(recorded: Sequence[Run], protocol: SteppedSineProtocol) -> list[str]:
    """What a recorded stepped sine has otherwise than it was commanded, in words."""
    commanded = defaultdict[tuple[float, float], float](float)
    counts = protocol.cycles_at or (math.nan,) * len(protocol.frequencies_hz)
    for amplitude in protocol.amplitudes:
        for frequency, cycles in zip(protocol.frequencies_hz, counts, strict=True):
            commanded[amplitude, frequency] += cycles
    followed: dict[tuple[float | None, ...], list[Run]] = {pair: [] for pair in commanded}
    remarks: list[str] = []
    for run in recorded:
        near = protocol.amplitude_near(run.amplitude), protocol.frequency_near(run.frequency_hz)
        if None in near:
            remarks.append(f"besides {run}")
        else:
            followed[near].append(run)
    for (amplitude, frequency), cycles in commanded.items():
        runs = followed[amplitude, frequency]
        if not runs:
            remarks.append(f"missing {np.rad2deg(amplitude):g} deg at {frequency:g} Hz")
            continue
        recorded_cycles = sum(run.cycles for run in runs)
        slack = max(OTHER_CYCLES * cycles, UNSEEN_CYCLES * len(runs))
        if cycles < recorded_cycles - slack or cycles > MOST_IN_RAMPS * recorded_cycles + slack:
            remarks.append(f"{listing([str(run) for run in runs], 3)}, commanded are {cycles:g}")
    return remarks + other_sizes(recorded, protocol)


def other_sizes(runs: Sequence[Run], protocol: SteppedSineProtocol) -> list[str]:
    """A sentence per amplitude that is off its command at the slowest frequency: a bench loses
    least there. As all may be off by one factor, they are matched by their order."""
    slowest = min(protocol.frequencies_hz)
    sizes = [run.amplitude for run in runs if protocol.frequency_near(run.frequency_hz) == slowest]
    sizes = [size for size in sizes if protocol.amplitude_near(size) is not None]
    if len(sizes) != len(protocol.amplitudes):
        return []
    return [
        f"{np.rad2deg(size):.3g} deg at {slowest:g} Hz, commanded are {np.rad2deg(amplitude):g}"
        f" deg (if the joint did them, theta is {size / amplitude:.3g} times its angle, and K"
        f" {amplitude / size:.3g} times its own)"
        for size, amplitude in zip(sorted(sizes), sorted(protocol.amplitudes), strict=True)
        if abs(size / amplitude - 1) > OTHER_SIZE
    ]


# Sensors that stand at an end of their range, that stand still, and that leap.

CLEAR_CHANGE = 0.05  # share of a reference's range, which noise of no kind reaches
NEAR_END = 1e-3  # share of a stated range: a value nearer to its end is at it


def samples_at_rail(trial: Trial, column: str, torque: str, angle: str = "theta") -> int:
    """Longest run [samples] of a channel at an end of its stated range, or at its lowest or highest
    value. 0 for a command, which has levels. A channel without noise, as an angle, may rest at an
    extreme: it is clipped only if the `torque`, or of a torque the `angle`, changes meanwhile, and
    if it does not stand elsewhere as often, as behind play."""
    time, values = recorded(trial, column)
    if values.size < 2 or not np.isfinite(values).all():  # the fit refuses it
        return 0
    longest = 0
    ends = stated_range(trial, column)
    if ends is not None:
        near = NEAR_END * (ends[1] - ends[0])
        for is_at_end in (values <= ends[0] + near, values >= ends[1] - near):
            at_end = longest_run(is_at_end)
            longest = max(longest, at_end.stop - at_end.start)
    is_angle = column.startswith("theta")
    has_noise = not is_angle and not has_levels(values)
    reference = recorded(trial, torque if is_angle else angle)
    if (column == "current" and not has_noise) or (is_angle and not reference[0].size):
        return longest
    standing = None
    if not has_noise and reference[0].size:
        standing = standing_runs(time, values, np.interp(time, *reference))
    rail = run_at_extreme(values, standing)
    length = int(rail.stop - rail.start)
    if standing is not None and length:
        as_long = standing[2 * np.diff(standing)[:, 0] > length]
        at_rail = values[as_long[:, 0]] == values[rail.start]
        length = length if 2 * at_rail.sum() >= at_rail.size else 0
    return max(longest, length)


def noisy_channels(trial: Trial) -> list[str]:
    """The torques and the current of a trial, which noise keeps changing."""
    noisy = {"current"} | {facts.torque for facts in EXPERIMENTS.values()}
    return [name for name in trial.columns if name in noisy and recorded(trial, name)[1].size]


def raw_channels(trial: Trial) -> dict[str, Mapping[str, Any]]:
    """Facts on every raw channel of the trial's plates, by name, as ingest recorded them."""
    return {
        f"plate{plate['plate']} channel {facts['label']}": facts
        for plate in trial.provenance.get("plates", [])
        for facts in plate.get("channels", [])
    }


def measure_saturation(examined: Examined) -> CheckResult:
    trial = examined.trial
    # an angle that is not driven may stand by friction
    moved = examined.experiment.motion
    names = [*noisy_channels(trial)]
    names += [c for c in trial.samples.columns if c == moved or stated_range(trial, c) is not None]
    torque = examined.experiment.torque or ""
    lengths = {name: samples_at_rail(trial, name, torque, moved or "theta") for name in names}
    lengths |= {name: facts["clipped_samples"] for name, facts in raw_channels(trial).items()}
    return worst(lengths, "no torque, current or plate")


def saturated(trial: Trial, torque: str = "torque", other: str = "theta") -> pl.Expr:
    """The column `saturated_samples`: the longest `samples_at_rail` of a torque and another column,
    the angle or the current."""
    longest = max(samples_at_rail(trial, column, torque) for column in (torque, other))
    return pl.lit(longest, pl.Int64).alias("saturated_samples")


def measure_stuck(examined: Examined) -> CheckResult:
    """Longest time [s] that a channel repeats one value: a noisy one, while the joint moves if it
    ever does; and an angle from some time to the end, while its command or else the torque changes
    (behind an earlier time it leaps, see `measure_dropout`). These do not count: a joint at rest in
    static and plate trials; a channel that the experiment does not use, such as a locked motor; a
    command, which has levels."""
    trial = examined.trial
    experiment = examined.experiment
    seconds = {
        name: (facts["stands_to_s"] or 0.0) - (facts["stands_from_s"] or 0.0)
        for name, facts in raw_channels(trial).items()
    }
    moved = experiment.motion or "theta"
    at, angle = recorded(trial, moved)
    turns = bool((angle != angle[:1]).any())
    for name in noisy_channels(trial):
        time, values = recorded(trial, name)
        is_live = np.ptp(values) > 0
        if not experiment.uses(name) or (name == "current" and is_live and has_levels(values)):
            continue
        edges = repeats(values)
        if turns and is_live:
            edges = standing_runs(time, values, np.interp(time, at, angle))
        seconds[name] = longest_s(time, edges)
    by = "theta_command" if "theta_command" in trial.columns else "torque"
    reference = recorded(trial, by)
    if turns and reference[0].size:
        edges = standing_runs(at, angle, np.interp(at, *reference), CLEAR_CHANGE)
        seconds[moved] = longest_s(at, edges[edges[:, 1] == angle.size])
    elif angle.size and (experiment.motion or experiment.tables):
        seconds[moved] = 0.0 if turns else float(np.ptp(at))
    return worst(seconds, "no torque, current or plate")


def longest_s(time: Array, edges: NDArray[np.intp]) -> float:
    """Time [s] from the first to the last sample of the longest of runs (k, 2) of rows."""
    return (int(np.diff(edges).max(initial=1)) - 1) * usual_step(np.diff(time))


def measure_dropout(examined: Examined) -> CheckResult:
    """Largest number of leaps of the angle or the torque off its curve (`leaps.find_leaps`)."""
    trial = examined.fitted
    angle = "theta" if "theta" in trial.columns else "theta_m"
    columns = [column for column in (angle, "torque") if column in trial.columns]
    if not columns:
        return not_applicable("no angle and no torque")
    leaps = {column: find_leaps(*trial.arrays(column)) for column in columns}
    column = max(leaps, key=lambda column: leaps[column].size)
    count = leaps[column].size
    if not count:
        return CheckResult(0.0)
    return CheckResult(
        float(count),
        f"{column} leaps {count} times, first at {leaps[column][0]:.3f} s: rows were lost or"
        " doubled, or a sensor failed; state `windows` without them",
    )


def measure_encoder_wrap(examined: Examined) -> CheckResult:
    """Number of steps of an angle by one turn, within 10 %, or by 360 (degrees declared as
    radians)."""
    wraps: dict[str, float] = {}
    for column in ("theta", "theta_m", "theta_command"):
        if column in examined.trial.columns:
            steps = np.abs(np.diff(recorded(examined.trial, column)[1]))
            turns = steps[:, None] / (2 * np.pi, 360.0)
            wraps[column] = float(np.count_nonzero(np.abs(turns - 1) < 0.1))
    return worst(wraps, "no angle")


def measure_marker_gap(examined: Examined) -> CheckResult:
    """Longest time [s] that a marker was hidden between two sightings, minus one step; the whole
    time if it was never seen. The remark counts the markers with gaps."""
    gaps: dict[str, float] = {}
    for column in examined.trial.columns:
        if column.startswith("marker_") and column.endswith("_x"):
            time, x = examined.trial.arrays(column)
            seen = time[~np.isnan(x)]
            whole = float(time.max(initial=0.0))
            marker = column.removeprefix("marker_").removesuffix("_x")
            gaps[marker] = longest_gap(np.diff(seen)) if seen.size else whole
    hidden = worst(gaps, "no markers")
    if not hidden.value:
        return hidden
    with_gaps = sum(gap > 0 for gap in gaps.values())
    return replace(hidden, remark=f"{hidden.remark}; {with_gaps} of {len(gaps)} markers")


# Force plates. While somebody walks over a plate, the centre of pressure lies on it and moves.

PART_S = 0.2  # of a force, whose level is its mean
AT_REST_N = 20.0  # largest standard deviation of a plate at rest, and largest level of a bare one
LOADED_N = 100.0  # below, noise and a moving platform shift the centre of pressure
FEWEST_LOADED = 10  # samples


def measure_unzeroed_plate(examined: Examined) -> CheckResult:
    """Largest level [N] of a bare plate: the mean over 0.2 s at rest that is nearest to zero. A
    larger positive level may be a load, unless the experiment leaves every plate bare at some
    time."""
    levels: dict[str, float] = {}
    for column in examined.trial.columns:
        if column.startswith("plate") and column.endswith("_force_z"):
            time, force = recorded(examined.trial, column)
            length = max(round(PART_S / usual_step(np.diff(time))), 1) if time.size > 1 else 1
            parts = force[: force.size // length * length].reshape(-1, length)
            quiet = parts[parts.std(axis=1) < AT_REST_N].mean(axis=1)
            level = min(quiet.tolist(), key=abs, default=math.inf)
            if level < AT_REST_N or (quiet.size and examined.experiment.bare_plate):
                levels[column.removesuffix("_force_z")] = level
    if not levels:
        return not_applicable("no plate, or none at rest and bare")
    remarks = [f"{plate} {level:.1f} N" for plate, level in levels.items()]
    return CheckResult(max(abs(level) for level in levels.values()), ", ".join(remarks))


def pressed_plates(trial: Trial) -> Iterator[tuple[str, Array, Array]]:
    """For every loaded plate with known corners and columns: its name, corners (4, 3) [m], and
    the centre of pressure (k, 2) [m] in the loaded samples, from the plate's centre along its
    edges."""
    for plate in trial.provenance.get("plates", []):
        number, corners = int(plate["plate"]), np.array(plate["corners"], dtype=float)
        columns = [*plate_columns(number, "force"), *plate_columns(number, "moment")]
        if not set(columns) <= set(trial.columns):
            continue
        axes = plate_axes(corners)
        wrench = trial.sampled(*columns).select(columns).to_numpy()
        wrench = wrench[wrench[:, :3] @ axes[:, 2] > LOADED_N]
        if len(wrench) >= FEWEST_LOADED:
            vertical = wrench[:, :3] @ axes[:, 2:]
            point = np.cross(axes[:, 2], wrench[:, 3:]) / vertical
            yield f"plate{number}", corners, np.asarray(point @ axes[:, :2])


def travel(points: Array) -> float:
    """Distance [m] between the 5th and 95th percentiles of points (k, 2) [m]."""
    low, high = np.percentile(points, [5, 95], axis=0)
    return float(np.hypot(*(high - low)))


def measure_pressure_centre(examined: Examined) -> CheckResult:
    """Largest distance [m] of a centre of pressure outside its plate under load: the 80th
    percentile over samples. The first and last samples of a stance are inexact. While a plate is
    turned, its own inertia, which the analysis takes away, moves the point far out."""
    if not examined.experiment.walker:
        return not_applicable("nobody stands on a plate")
    distances = {
        plate: float(np.percentile(beside(points, corners), 80))
        for plate, corners, points in pressed_plates(examined.trial)
    }
    furthest = worst(distances, "no plate is stood on")
    if not furthest.value:
        return furthest
    return replace(
        furthest,
        remark=f"{furthest.remark}: the centre of pressure is {furthest.value:.3g} m outside: a"
        " moment channel is dead, clipped, of the other sign or of another unit (state"
        " `plate_units` in the source file, as {force: N, moment: N*mm}), or the corners are wrong",
    )


def measure_pressure_travel(examined: Examined) -> CheckResult:
    if not (examined.experiment.walker and examined.experiment.tables):
        return not_applicable("nobody walks over a plate")
    ways = [(travel(points), plate) for plate, _, points in pressed_plates(examined.trial)]
    if not ways:
        return not_applicable("no plate is stood on")
    way, plate = min(ways)
    cause = "if it stands still, the moments are dead or a thousand times too small"
    return CheckResult(way, f"{plate}: {cause}")


MEASURES: dict[str, tuple[Callable[[Examined], CheckResult], str]] = {
    "rate": (measure_rate, "Hz"),
    "jitter": (measure_jitter, "%"),
    "gap": (measure_gap, "s"),
    "saturation": (measure_saturation, "samples"),
    "stuck": (measure_stuck, "s"),
    "dropout": (measure_dropout, "samples"),
    "unzeroed_plate": (measure_unzeroed_plate, "N"),
    "encoder_wrap": (measure_encoder_wrap, "jumps"),
    "marker_gap": (measure_marker_gap, "s"),
    "pressure_centre": (measure_pressure_centre, "m"),
    "pressure_travel": (measure_pressure_travel, "m"),
    "clock_residual": (measure_clock, "s"),
    "damage": (measure_damage, "%"),
    "truncated": (measure_truncation, "logs"),
    "unit": (measure_unit, "channels"),
    "protocol": (measure_protocol, "segments"),
}
"""Every check by name: its function and the unit of its value. A new check also needs its
entry and its finding in `judge/findings.yaml`, its rule under `quality` in config/config.yaml, and
a test."""
UNITS = {name: unit for name, (_, unit) in MEASURES.items()}
OF_SAMPLING = ("rate", "jitter", "gap")


def measure_quality(
    trial: Trial, experiment: str, commanded: Commanded, windows: str = ""
) -> dict[str, CheckResult]:
    """The result of every check on a trial, by name. `commanded` is the protocol of stepped-sine
    experiments; leaps outside of the `windows` [s] that are fitted do not count."""
    facts = EXPERIMENTS[experiment]
    is_cut = windows and facts.fit is not None and facts.fit.windows
    fitted = trial.within(windows) if is_cut else trial
    examined = Examined(trial, facts, commanded, fitted)
    results = {name: measure(examined) for name, (measure, _) in MEASURES.items()}
    # what lies between plateaus, and when exactly samples were taken, does not matter
    if facts.may_stand and stands(trial, facts):
        reason = "the actuator stands, and its plateaus of current are analysed alone"
        results |= dict.fromkeys(OF_SAMPLING, not_applicable(reason))
    return results


def stands(trial: Trial, experiment: Experiment) -> bool:
    """Whether the recording is of an actuator that stands while its current is stepped."""
    time, current = recorded(trial, "current")
    if not np.isfinite(current).all():
        return False
    angle = experiment.motion in trial.columns
    at, motion = recorded(trial, experiment.motion if angle else "omega_m")
    on_rows = np.interp(time, at, motion) if at.size else None
    return is_clamped(time, current, plateaus_of(time, current), on_rows, angle, STANDS)


def measured_table(trial: str, results: Mapping[str, CheckResult]) -> pl.DataFrame:
    """What `measure_quality` found, a row per check: trial, check, value, unit, remark."""
    rows = [
        (trial, name, result.value, UNITS[name], result.remark) for name, result in results.items()
    ]
    columns = dict.fromkeys(("trial", "check", "value", "unit", "remark"), pl.String)
    return pl.DataFrame(rows, columns | {"value": pl.Float64}, orient="row")
