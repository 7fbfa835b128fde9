# SPDX-License-Identifier: Apache-2.0
"""Measure the quality of a recording: the checks that `MEASURES` lists.

A check gives numbers. Limits and verdicts come later (`judge`).
"""

import itertools
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.base.errors import InputError, listing
from osl_analysis.base.measured import UNIFORM_WIDTH, noise_of, spoiled, usual_step
from osl_analysis.base.trial import Array, Trial, plate_columns
from osl_analysis.config.experiments import EXPERIMENTS, Experiment
from osl_analysis.ingest.force_plates import distance_from_plate, plate_axes
from osl_analysis.ingest.guard import ANGLES, recorded
from osl_analysis.signals.filters import longest_of, run_edges
from osl_analysis.signals.grid import (
    USUAL_FILTER,
    TimeBase,
    devices_of,
    origin,
    uniform_signals,
)
from osl_analysis.signals.plateaus import (
    find_leaps,
    has_levels,
    repeats,
    run_at_extreme,
    standing_runs,
    steps_by_friction,
)
from osl_analysis.spectral.stepped_sine import (
    Run,
    SteppedSineProtocol,
    find_sines,
    moving_bins,
)


@dataclass(frozen=True)
class Commanded:
    """What the configuration says of a recording: the stepped sine that is commanded, each
    amplitude at every frequency, or the marker clusters of a crossing."""

    amplitudes_deg: Sequence[float] | None = None  # None, in any field: not stated
    frequencies_hz: Sequence[float] | None = None
    cycles: int | Sequence[int] | None = None  # one number for all frequencies, or one for each
    excitation: str = "auto"
    """What moves the joint in impedance trials: `stepped_sine`, `any` other motion, or `auto`: the
    recording tells."""
    longest_gap_s: float = 0.5  # that the fits bridge
    clusters: Mapping[str, Sequence[str]] = field(default_factory=dict)  # markers by segment


@dataclass(frozen=True)
class Examined:
    """A trial that is checked, and what is known of it."""

    trial: Trial
    experiment: Experiment
    commanded: Commanded
    fitted: Trial  # the part that is fitted

    @property
    def moved(self) -> str:
        """The column of the motion."""
        return self.experiment.motion or "theta"

    @property
    def torque(self) -> str:
        """The column of the torque."""
        return self.experiment.torque or "torque"

    @cached_property
    def stamps(self) -> dict[str, Array]:
        """Times [s] of each device that samples, by its first channel. Of an actuator that stands,
        only plateaus of its current count, and not what lies between: it has none."""
        if self.experiment.may_stand and self.moved not in self.trial.columns:
            return {}
        devices = devices_of(self.trial, [name for name in self.trial.columns if name != "time"])
        stamps = {channel: self.trial.arrays(channel)[0] for channel, *_ in devices}
        return {channel: time for channel, time in stamps.items() if time.size > 2}

    @cached_property
    def steps(self) -> dict[str, float]:
        """Usual step [s] of each device."""
        return {channel: usual_step(time) for channel, time in self.stamps.items()}


@dataclass(frozen=True)
class CheckResult:
    """What a check measured."""

    value: float | None  # in the check's unit; None where the check does not apply
    remark: str = ""  # the worst channel, or why the check does not apply


def not_applicable(reason: str) -> CheckResult:
    return CheckResult(None, f"not applicable: {reason}")


def readings_of(trial: Trial, pattern: str) -> dict[str, tuple[Array, Array]]:
    """Time [s] and values, (n,) each, of the columns that fit a pattern, by its group."""
    matches = [re.fullmatch(pattern, column) for column in trial.columns]
    return {match[1]: recorded(trial, match[0]) for match in matches if match}


# Sampling, clocks and damage. `judge/words.yaml` says what each check measures.


@dataclass(frozen=True)
class GapLimits:
    """What makes a step between stamps a gap."""

    steps: float = 1.5  # usual steps between stamps, from which a sample is missing


GAPS = GapLimits()


def longest_gap(time: Array, usual: float) -> float:
    """The longest of the steps of stamps (n,) [s] beyond the usual one [s]; 0 if none is a gap."""
    longest = np.diff(time).max(initial=0.0)
    return longest - usual if longest > GAPS.steps * usual else 0.0


def measure_rates(examined: Examined) -> dict[str, float]:
    return {channel: 1 / step for channel, step in examined.steps.items()}


def measure_gaps(examined: Examined) -> dict[str, float]:
    first, last = examined.fitted.samples["time"][[0, -1]]
    return {
        channel: longest_gap(time[(time >= first) & (time <= last)], examined.steps[channel])
        for channel, time in examined.stamps.items()
    }


def measure_clock(examined: Examined) -> dict[str, float]:
    """RMS [s] of sync edges about the fit beyond that of sampling: an edge lies anywhere in a step
    of the log, whose rectangular distribution has the standard deviation step / sqrt(12)."""
    log = examined.trial.provenance.get("log", {})
    clock = examined.trial.provenance.get("clock")
    if not clock:
        return dict(log.get("clocks_apart", {}))
    slowest_hz = min(log.get("rates_hz", {}).values(), default=math.inf)
    sampling_error_s = 1 / (slowest_hz * UNIFORM_WIDTH)
    residual = math.sqrt(max(clock["residual"] ** 2 - sampling_error_s**2, 0.0))
    return {f"{clock['edges']} edges by {clock['method']}": residual}


def measure_damage(examined: Examined) -> CheckResult | dict[str, float]:
    """Lost share [%] of each log. Of whole ones the remark is what was remarkable of reading them,
    as that few rows were left out."""
    shares = {}
    for role, damage in examined.trial.provenance.get("damage", {}).items():
        remarks = "; ".join([f"{damage['lost']} lost", *damage["remarks"]])
        shares[f"{role}: {remarks}"] = 100 * damage["share_lost"]
    warnings = examined.trial.provenance.get("warnings")
    if warnings and not any(shares.values()):
        return CheckResult(0.0, "; ".join(warnings))
    return shares


def measure_truncation(examined: Examined) -> dict[str, float]:
    reports = examined.trial.provenance.get("damage", {})
    return {role: damage["end_missing"] for role, damage in reports.items()}


def measure_units(examined: Examined) -> dict[str, float]:
    """Number of channels that the source file converts from another unit than their file states."""
    columns = examined.trial.provenance.get("columns", {})
    remarks = [
        f"{column} is read in {facts.get('scale', 1):.4g} {facts['unit']}, not"
        f" {facts['unit_of_file']}"
        for column, facts in columns.items()
        if "unit_of_file" in facts
    ]
    return {"; ".join(remarks): len(remarks)}


def measure_contradiction(examined: Examined) -> dict[str, float]:
    """By how much [%] a speed is not the derivative of the angle of its body."""
    deviations_percent = {}
    for column, facts in examined.trial.provenance.get("columns", {}).items():
        for speed, ratio in facts.get("speeds", {}).items():
            both = f"of {column} and {speed} the speed is {ratio:.3g} times the change of the angle"
            deviations_percent[both] = 100 * abs(ratio - 1)
    return deviations_percent


# The motion that was commanded.


@dataclass(frozen=True)
class ProtocolLimits:
    """How a recorded motion is compared with its command."""

    most_remarks: int = 20  # differences from the protocol that a remark names
    # share by which an amplitude differs from its command; benches lose less at their slowest
    other_size: float = 0.03


PROTOCOL = ProtocolLimits()


def measure_protocol(examined: Examined) -> CheckResult:
    """Number of differences from the protocol: commanded pairs of amplitude and frequency that are
    missing, runs that were not commanded, and amplitudes of another size. A motion that is no
    stepped sine is remarked and counts 0."""
    experiment = examined.experiment
    commanded = examined.commanded
    amplitudes = np.deg2rad(commanded.amplitudes_deg or ()).tolist()
    protocol = SteppedSineProtocol(amplitudes, commanded.frequencies_hz or (), commanded.cycles)
    if not experiment.stepped_sine or "theta" not in examined.trial.columns:
        return not_applicable("no stepped sine")
    excitation = commanded.excitation if experiment.any_motion else "stepped_sine"
    if excitation == "any":
        return CheckResult(0.0, "any motion moves the joint, says the configuration")
    try:
        time_base = TimeBase(longest_gap_s=commanded.longest_gap_s)
        settings = USUAL_FILTER.model_copy(update={"time_base": time_base})
        angle = uniform_signals(examined.trial, ["theta"], settings)
    except InputError as error:
        return not_applicable(f"no time base, {error}")
    theta = angle.signals["theta"]
    rate_hz = angle.rate_hz
    noise = noise_of(theta, 2)
    moving = moving_bins(theta, rate_hz, noise)
    sines, is_stepped = find_sines(theta, rate_hz, noise, moving, protocol)
    if excitation == "auto" and not is_stepped:
        return CheckResult(0.0, "no stepped sine but another motion, which is fitted as such")
    if not (protocol.amplitudes and protocol.frequencies_hz):
        return not_applicable("amplitudes_deg and frequencies_hz are not stated")
    remarks = differences(sines, protocol)
    return CheckResult(len(remarks), listing(remarks, PROTOCOL.most_remarks))


def differences(runs: Sequence[Run], protocol: SteppedSineProtocol) -> list[str]:
    """What a recorded stepped sine has otherwise than it was commanded, in words. Sizes are
    compared at the slowest frequency, where a bench loses least."""
    missing = set(itertools.product(protocol.amplitudes, protocol.frequencies_hz))
    remarks = []
    for run in runs:
        command = protocol.command_of(run)
        if command is None:
            remarks.append(f"besides {run}")
            continue
        missing.discard(command)
        amplitude, frequency = command
        ratio = run.amplitude / amplitude
        if frequency == min(protocol.frequencies_hz) and abs(ratio - 1) > PROTOCOL.other_size:
            remarks.append(
                f"{run} is {ratio:.3g} times the command (if the joint did as commanded, divide"
                " theta's `scale` by this)"
            )
    remarks += [f"missing {np.rad2deg(size):g} deg at {f:g} Hz" for size, f in sorted(missing)]
    return remarks


# Sensors that stand at an end of their range, that stand still, and that leap.


NOISY = "(torque|torque_m|current)"  # columns that noise keeps changing


@dataclass(frozen=True)
class SensorLimits:
    """Limits by which a sensor is at an end of its range, or stands still."""

    clear_change: float = 0.05  # share of a reference's range, which noise of no kind reaches
    near_end: float = 1e-3  # share of a stated range: a value nearer to its end is at it
    at_end: int = 5  # samples in a row at an end of the range; noise stands there for two


SENSORS = SensorLimits()


def samples_at_rail(trial: Trial, column: str, torque: str, angle: str = "theta") -> int:
    """Longest run [samples] of a channel at an end of its stated range, or at its lowest or highest
    value. A channel without noise, as an angle, may rest at an extreme: it is clipped only if the
    `torque`, or of a torque the `angle`, changes meanwhile, and if it does not stand more often
    between both extremes, as behind backlash. A current without noise is a command and has
    levels."""
    time, values = recorded(trial, column)
    if values.size < 2 or not np.isfinite(values).all():  # the fit refuses it
        return 0
    low, high = origin(trial, column).get("range", (-math.inf, math.inf))
    near = SENSORS.near_end * (high - low) / 2
    at_end = values[longest_of(run_edges((values <= low + near) | (values >= high - near)))].size
    is_angle = column.startswith("theta")
    standing = None
    if is_angle or has_levels(values):
        reference = recorded(trial, torque if is_angle else angle)
        if column == "current" or not reference[0].size:
            return at_end
        standing = standing_runs(time, values, reference)
    length = values[run_at_extreme(values, standing)].size
    if standing is not None:
        levels = values[standing[2 * np.diff(standing)[:, 0] > length, 0]]
        is_at_end = np.isin(levels, (values.min(), values.max()))
        if 2 * is_at_end.sum() < levels.size:  # backlash
            return at_end
    return max(at_end, length)


def measure_saturation(examined: Examined) -> dict[str, float]:
    trial = examined.trial
    # an angle that is not driven may stand by friction
    motion = examined.experiment.motion
    names = {name for name in trial.columns if name == motion or "range" in origin(trial, name)}
    return {
        name: samples_at_rail(trial, name, examined.torque, examined.moved)
        for name in sorted(names.union(readings_of(trial, NOISY)))
    }


def saturated(trial: Trial, torque: str = "torque", other_column: str = "theta") -> pl.Expr:
    """The column `saturated_samples`: the longest `samples_at_rail` of a torque and another column,
    the angle or the current."""
    longest = max(samples_at_rail(trial, column, torque) for column in (torque, other_column))
    return pl.lit(longest, pl.Int64).alias("saturated_samples")


# times the longest rest before, up to which an angle rests on the last stair of a staircase: it has
# no motion at its end, and the recorder is stopped by hand
LAST_OF_RESTS = 2.0


def measure_stuck(examined: Examined) -> dict[str, float]:
    """Longest time [s] that a channel repeats one value: a noisy one, while the joint moves if it
    ever does; and an angle from some time to the end, while its command or else the torque changes
    (behind an earlier time it leaps, see `measure_leaps`). These do not count: a joint at rest in
    static and plate trials; a channel that the experiment does not use, such as a locked motor; a
    command, which has levels."""
    trial = examined.trial
    experiment = examined.experiment
    seconds = {}
    motion = recorded(trial, examined.moved)
    at, angle = motion
    turns = (angle != angle[:1]).any()
    for name, (time, values) in readings_of(trial, NOISY).items():
        is_command = name == "current" and has_levels(values)
        if is_command or not values.size or not experiment.uses(name):
            continue
        runs = standing_runs(time, values, motion) if turns and np.ptp(values) else repeats(values)
        seconds[name] = longest_s(time, runs)
    by = "theta_command" if "theta_command" in trial.columns else "torque"
    reference = recorded(trial, by)
    if turns and reference[0].size:
        runs = standing_runs(at, angle, reference, SENSORS.clear_change)
        is_last = runs[:, 1] == angle.size
        rests = repeats(angle)
        before_last_s = longest_s(at, rests[rests[:, 1] != angle.size])
        standing_s = longest_s(at, runs[is_last])
        is_stair = standing_s <= LAST_OF_RESTS * before_last_s
        seconds[examined.moved] = 0.0 if is_stair else standing_s
    elif angle.size and (experiment.motion or experiment.tables):
        seconds[examined.moved] = 0.0 if turns else np.ptp(at)
    return seconds


def longest_s(time: Array, edges: NDArray[np.intp]) -> float:
    """Time [s] from the first to the last sample of the longest of runs (k, 2) of rows; 0 of
    none."""
    return (np.diff(edges).max() - 1) * usual_step(time) if edges.size else 0.0


@dataclass(frozen=True)
class LeapLimits:
    """Limits that tell the cause of leaps, and the size of windows without them."""

    # [s] that a window leaves out beside a leap; three time constants of the usual low-pass
    around_s: float = 0.2
    # of leaps: if as many are of single values, leaving these out mends the trial
    least_alone: float = 0.75
    shortest_window_s: float = 1.0  # [s]; a cycle of the slowest usual sine
    fewest_at_stop: int = 3  # leaps of a torque at one angle: fewer are there by chance
    # of the range of the angle, SD of the places of a stop; simulated ones have 0.01
    one_angle: float = 0.05
    # share by which a step of an angle differs from a turn and passes for one
    one_turn: float = 0.1


LEAPS = LeapLimits()


def measure_leaps(examined: Examined) -> dict[str, float]:
    """Number of leaps of the angle or the torque off its curve (`plateaus.find_leaps`). A torque
    may leap by friction, where the joint turns, and that of an actuator where its current does."""
    trial = examined.fitted
    columns = [name for name in (examined.moved, examined.torque) if name in trial.columns]
    leaps = {column: find_leaps(*trial.arrays(column)) for column in columns}
    angle = recorded(trial, examined.moved)
    if "torque" in leaps and angle[0].size:
        times = leaps["torque"]
        is_friction = steps_by_friction(times, angle, recorded(trial, "torque"))
        faults = times[~is_friction]
        # a step beside a fault is the other end of it
        leaps["torque"] = times[distances(times, faults) <= LEAPS.around_s]
    if "torque_m" in leaps:
        steps = find_leaps(*recorded(trial, "current"))
        distances_s = distances(leaps["torque_m"], steps)
        leaps["torque_m"] = leaps["torque_m"][distances_s > LEAPS.around_s]
    every = np.sort(np.concatenate([*leaps.values(), []]))
    remedy = ""
    if every.size:
        alone = sum(int(spoiled(trial.arrays(column)[1]).sum()) for column in columns)
        at_rail = samples_at_rail(trial, examined.torque, examined.torque, examined.moved)
        cause = cause_of_leaps(leaps, angle, at_rail)
        remedy = remedy_of_leaps(examined, every, cause, alone)
    return {f"{column} leaps{remedy}": times.size for column, times in leaps.items()}


def distances(times: Array, other_times: Array) -> Array:
    """Of times (n,), each one's distance to the nearest of others; infinite without any."""
    return np.abs(np.subtract.outer(times, other_times)).min(axis=1, initial=np.inf)


def cause_of_leaps(leaps: Mapping[str, Array], angle: tuple[Array, Array], at_rail: int) -> str:
    """Why a signal leaps: a torque that leaps at one angle again and again does at a stop, one that
    stands at an end of its range leaps to it; where the angle leaps, too, rows are missing. An
    angle that leaps alone need not have lost any."""
    times = leaps.get("torque", np.empty(0))
    angle_leaps = sum(len(column_times) for column_times in leaps.values()) - len(times)
    if angle_leaps and times.size:
        return "rows were lost or doubled"
    if angle_leaps:
        return "the angle froze or slipped, or rows were lost or doubled"
    if at_rail > SENSORS.at_end:
        return "the torque stands at an end of its range"
    if times.size >= LEAPS.fewest_at_stop:
        at = np.interp(times, *angle)
        if np.std(at) < LEAPS.one_angle * np.ptp(angle[1]):
            return f"a stop (move it by less) or backlash at {np.rad2deg(at.mean()):.3g} deg"
    return "a sensor failed, or the command jumped"


def remedy_of_leaps(examined: Examined, leaps: Array, cause: str, alone: int) -> str:
    """Say where leaps at rising times (n,) [s] are, and what leaves them out, at which cost: values
    that leap `alone`, so many; or what is outside of the longest window without any."""
    time = examined.fitted.samples["time"]
    edges = np.array([time[0], *leaps, time[-1]])
    longest = np.argmax(np.diff(edges))
    first = edges[longest] + LEAPS.around_s
    last = edges[longest + 1] - LEAPS.around_s
    remedy = "exclude the trial"
    if alone >= LEAPS.least_alone * leaps.size:
        remedy = f"write `damaged: skip` in the source file, which leaves out {alone} values"
    elif examined.experiment.place == "bench" and last - first > LEAPS.shortest_window_s:
        lost = time.len() - time.is_between(first, last).sum()
        remedy = (
            f"state `windows` {first:.1f}-{last:.1f} in the sheet, which leaves out {lost} of"
            f" {time.len()} rows"
        )
    return f", first at {leaps[0]:.3f} s: {cause}; {remedy}"


def measure_turns(examined: Examined) -> dict[str, float]:
    """Number of steps of an angle by one turn, or by 360 (degrees declared as radians)."""
    wraps: dict[str, float] = {}
    for column, (_, angle) in readings_of(examined.trial, f"({'|'.join(ANGLES)})").items():
        turns = np.divide.outer(np.abs(np.diff(angle)), (2 * np.pi, 360.0))
        wraps[column] = int(np.count_nonzero(np.abs(turns - 1) < LEAPS.one_turn))
    return wraps


FEWEST_MARKERS = 3  # that tell where a cluster stands and how it is turned


def measure_marker_gaps(examined: Examined) -> dict[str, float]:
    """Longest time [s] that a cluster had fewer than three markers in sight, between two sightings
    of three, minus one step; the whole time if it never had. One that is not recorded is none."""
    samples = examined.trial.samples
    seconds = {}
    for segment, names in examined.commanded.clusters.items():
        columns = {f"marker_{name}_x" for name in names}.intersection(samples.columns)
        if columns:
            in_sight = pl.sum_horizontal(pl.col(*columns).is_not_nan())
            followed = samples.filter(in_sight >= FEWEST_MARKERS)["time"].to_numpy()
            step = usual_step(followed)
            seconds[segment] = longest_gap(followed, step) if followed.size else samples["time"][-1]
    return seconds


# Force plates.


@dataclass(frozen=True)
class PlateLimits:
    """Limits that part a bare plate from a loaded one."""

    part_s: float = 0.2  # [s] of a force, whose level is its mean
    # [N] largest standard deviation of a plate at rest, and largest level of a bare one
    at_rest_N: float = 20.0
    loaded_N: float = 100.0  # [N]; below, noise and a moving platform shift the centre of pressure
    fewest_loaded: int = 10  # samples


PLATES = PlateLimits()


def measure_unzeroed_plates(examined: Examined) -> dict[str, float]:
    """Level [N] of a bare plate: the mean over a part at rest that is nearest to zero. A larger
    positive level may be a load, unless the experiment leaves every plate bare at some time."""
    levels = {}
    for plate, (time, force) in readings_of(examined.trial, "(plate.*)_force_z").items():
        length = max(round(PLATES.part_s / (usual_step(time) or math.inf)), 1)
        parts = force[: force.size // length * length].reshape(-1, length)
        quiet = parts[parts.std(axis=1) < PLATES.at_rest_N].mean(axis=1)
        level = min(quiet, key=abs, default=math.inf)
        if level < PLATES.at_rest_N or (quiet.size and examined.experiment.bare_plate):
            levels[plate] = abs(level)
    return levels


def pressed_plates(examined: Examined) -> Iterator[tuple[str, Array, Array]]:
    """For every plate on which somebody stands: its name, corners
    (4, 3) [m], and the centre of pressure (k, 2) [m] in the loaded samples, from the plate's centre
    along its edges."""
    trial = examined.trial
    plates = trial.provenance.get("plates", []) if examined.experiment.walker else []
    for plate in plates:
        number = plate["plate"]
        corners = np.array(plate["corners"])
        columns = plate_columns(number)
        axes = plate_axes(corners)
        wrench = np.stack(trial.arrays(*columns)[1:], axis=1)
        wrench = wrench[wrench[:, :3] @ axes[:, 2] > PLATES.loaded_N]
        if len(wrench) >= PLATES.fewest_loaded:
            vertical = wrench[:, :3] @ axes[:, 2:]
            point = np.cross(axes[:, 2], wrench[:, 3:]) / vertical
            yield f"plate{number}", corners, point @ axes[:, :2]


def measure_cop_outside_plates(examined: Examined) -> dict[str, float]:
    """Distance [m] of a centre of pressure outside its plate under load: the 80th percentile over
    samples. The first and last samples of a stance are inexact. While a plate is turned, its own
    inertia, which the analysis takes away, moves the point far out."""
    return {
        plate: np.percentile(distance_from_plate(points, corners), 80)
        for plate, corners, points in pressed_plates(examined)
    }


def measure_cop_travel(examined: Examined) -> dict[str, float]:
    """Distance [m] between the 5th and 95th percentiles of a centre of pressure."""
    ways = {}
    if examined.experiment.tables:  # somebody walks
        for plate, _, points in pressed_plates(examined):
            low, high = np.percentile(points, [5, 95], axis=0)
            ways[plate] = np.hypot(*(high - low))
    return ways


MEASURES: dict[str, Callable[[Examined], CheckResult | Mapping[str, float]]] = {
    "rate": measure_rates,
    "gap": measure_gaps,
    "saturation": measure_saturation,
    "stuck": measure_stuck,
    "dropout": measure_leaps,
    "unzeroed_plate": measure_unzeroed_plates,
    "encoder_wrap": measure_turns,
    "marker_gap": measure_marker_gaps,
    "cop_outside_plate": measure_cop_outside_plates,
    "cop_travel": measure_cop_travel,
    "clock_residual": measure_clock,
    "damage": measure_damage,
    "truncated": measure_truncation,
    "unit": measure_units,
    "contradiction": measure_contradiction,
    "protocol": measure_protocol,
}
"""The function of every check by name: it gives a value and a remark, or a value per channel, of
which the worst counts. A new check also needs its entry, with its unit, and its finding in
`judge/checks.py` and `judge/words.yaml`, its threshold under `quality` in config/config.yaml, and
a test."""
LOWEST = ("rate", "cop_travel")  # checks of which the lowest value is the worst


def measure_quality(
    trial: Trial, experiment: str, commanded: Commanded, windows: str = ""
) -> dict[str, CheckResult]:
    """The result of every check on a trial, by name. `commanded` is the protocol of stepped-sine
    experiments; leaps and gaps outside of the `windows` [s] that are fitted do not count."""
    facts = EXPERIMENTS[experiment]
    is_cut = windows and facts.fit is not None and facts.fit.windows
    fitted = trial.within(windows) if is_cut else trial
    examined = Examined(trial, facts, commanded, fitted)
    return {name: checked(name, examined) for name in MEASURES}


def checked(name: str, examined: Examined) -> CheckResult:
    """The result of one check, with the worst channel."""
    measured = MEASURES[name](examined)
    if isinstance(measured, CheckResult):
        return measured
    if not measured:
        return not_applicable("nothing here that it judges")
    worst = min if name in LOWEST else max
    channel, value = worst(measured.items(), key=lambda item: item[1])
    return CheckResult(float(value), channel if value or name in LOWEST else "")
