"""What is measured on channels: sensors at the end of their range, that stand, wrap or vanish, or do not read zero, and
force plates whose centre of pressure is beside them or stands.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.errors import InputError
from osl_analysis.judge.table import Cause, Check, CheckResult, Examined
from osl_analysis.measured import usual_size
from osl_analysis.plate_surface import beside, plate_axes
from osl_analysis.signals import longest_at_extreme, longest_run, run_edges, runs
from osl_analysis.trial import Array, Trial, plate_columns, unit_of

NO_ANALOG = "no torque, current or plate"


def not_applicable(reason: str) -> CheckResult:
    return CheckResult(None, f"not applicable: {reason}")


def worst(values: Mapping[str, float], reason: str) -> CheckResult:
    """The largest of the channels' values, with its channel; `reason`: why there are no channels, if there are none."""
    if not values:
        return not_applicable(reason)
    name = max(values, key=lambda channel: values[channel])
    return CheckResult(float(values[name]), name if values[name] else "")


def sampled(trial: Trial, column: str | None) -> tuple[Array, Array]:
    """Time [s] and values of a column, (n,) each, where it was sampled; empty without the column. NaN is left out."""
    if column is None or column not in trial.columns:
        return np.empty(0), np.empty(0)
    time, values = trial.arrays(column)
    missing = np.isnan(values)
    return (time[~missing], values[~missing]) if missing.any() else (time, values)


def median_step(time: Array) -> float:
    """Median step [s]; 0 for a single sample."""
    return float(np.median(np.diff(time))) if time.size > 1 else 0.0


# Sensors at the end of their range: load cells, currents and encoders that stand at a rail.

AT_RAIL = 1e-3  # distance from a stated end of a sensor's range, as a share of the range, that counts as the end
BEYOND_RANGE = 0.01
"""Share of a sensor's range by which a value may lie beyond it: electronics reach a little further than data sheets."""
IS_COMMAND = 0.3  # share of samples that repeat their predecessor, beside the longest run, in a commanded current
CORNER = 8.0
"""Steps by which a clipped angle moves within half of its standing time before it, or after it. A sine that is rounded
to steps moves by four at most."""


def stated_range(trial: Trial, column: str) -> tuple[float, float] | None:
    """Lowest and highest value of a channel that its source file states, in the column's unit; None if not stated."""
    found: Mapping[str, Any] = trial.provenance.get("columns", {}).get(column, {})
    ends = found.get("range")
    return (float(ends[0]), float(ends[1])) if ends else None


def check_ranges(trial: Trial) -> None:
    """Refuse values that no sensor of the range that the source file states can measure (InputError)."""
    for column in trial.columns:
        if (ends := stated_range(trial, column)) is None or not (values := sampled(trial, column)[1]).size:
            continue
        (low, high), (least, most) = ends, (float(values.min()), float(values.max()))
        slack = BEYOND_RANGE * (high - low)
        if least < low - slack or most > high + slack:
            raise InputError(
                f"trial {trial.name}: {column} goes from {least:.4g} to {most:.4g} {unit_of(column)}, beyond the "
                f"`range` of its sensor, {low:g} to {high:g}; correct `unit`, `scale` or `range` in the source file"
            )


def samples_at_rail(trial: Trial, column: str, torque: str | None = None) -> int:
    """Longest run [samples] of a channel at an end of its range, stated or seen; 0 for a command, which has levels. A
    channel with noise is at an end where it repeats its lowest or highest value. An angle also rests at an extreme: it
    is clipped only where `torque` goes on to change meanwhile. This holds for an angle that a bench drives; a motor
    behind a belt may stand by its own friction while the torque changes."""
    if column not in trial.columns:
        return 0
    time, values = sampled(trial, column)
    if not np.isfinite(values).all():  # the fit refuses it
        return 0
    at_stated = longest_at_stated(values, stated_range(trial, column))
    if column.startswith("theta"):
        seen = 0 if torque is None else longest_clipped_angle(time, values, sampled(trial, torque))
    else:
        seen = 0 if column == "current" and is_command(values) else longest_at_extreme(values)
    return max(at_stated, seen)


def longest_at_stated(values: Array, ends: tuple[float, float] | None) -> int:
    """Longest run [samples] of a channel (n,) at a stated end of its range, or beyond it."""
    if ends is None or not values.size:
        return 0
    near = AT_RAIL * (ends[1] - ends[0])
    runs_there = (longest_run(at_end) for at_end in (values <= ends[0] + near, values >= ends[1] - near))
    return max(int(run.stop - run.start) for run in runs_there)


def is_command(values: Array) -> bool:
    """Whether a channel (n,) goes from level to level without noise: most of its samples repeat their predecessor."""
    repeated = np.diff(values) == 0
    elsewhere = repeated.copy()
    elsewhere[longest_run(repeated)] = False
    return bool(elsewhere.sum() > IS_COMMAND * elsewhere.size)


def longest_clipped_angle(time: Array, theta: Array, torque: tuple[Array, Array]) -> int:
    """Longest run [samples] of an angle (n,) at its lowest or highest value while the torque changes. `torque` are
    times [s] and values. The angle must come to the extreme, and leave it, with a corner."""
    when, values = torque
    if not theta.size or not np.ptp(theta) or not when.size or not np.isfinite(values).all() or not np.ptp(values):
        return 0
    noise = usual_size(np.diff(values, 3)) / 3.016 if values.size > 3 else np.inf  # of white noise
    changes = max(10 * noise, 0.02 * float(np.ptp(values)))  # beyond noise, and the creep of a joint that rests
    longest = 0
    for end in (theta.min(), theta.max()):
        for run in runs(theta == end):
            count = run.stop - run.start
            within = values[slice(*np.searchsorted(when, (time[run.start], time[run.stop - 1])))]
            if count > max(5, longest) and within.size > 1 and np.ptp(within) > changes:
                sides = (run.start - count // 2, run.stop - 1 + count // 2)
                moved = [abs(theta[at] - end) for at in sides if 0 <= at < theta.size]
                longest = count if moved and min(moved) > CORNER * smallest_step(theta) else longest
    return longest


def smallest_step(values: Array) -> float:
    """Smallest difference between two values (n,), but for errors of rounding."""
    span = float(np.ptp(values))
    apart = np.diff(pl.Series(values).unique().sort().to_numpy())
    return float(np.min(apart[apart > 1e-9 * span], initial=span))


# Noisy channels, of torque, current and plates, and angles that stand.

AT_REST = 0.02  # share of the angle's range by which a joint at rest may creep
MOVES = 0.2  # of the reference's range: while it changes by more, the joint should have moved
SMOOTHED = 0.05  # s, over which a reference is averaged; a sine of 5 Hz keeps nine tenths of its amplitude


def raw_channels(trial: Trial) -> dict[str, Mapping[str, Any]]:
    """Facts of every raw channel of the trial's plates by name, as ingest found them."""
    return {
        f"plate{plate['plate']} channel {facts['label']}": facts
        for plate in trial.provenance.get("plates", [])
        for facts in plate.get("channels", [])
    }


def noisy_channels(trial: Trial, raw: Iterable[str]) -> dict[str, tuple[Array, Array]]:
    """Time [s] and values of the channels with samples that a sensor's noise keeps changing: torques, current, and
    force and moment of plates whose raw channels are not known."""
    noisy = {"current"} | {facts.torque for facts in EXPERIMENTS.values()}
    plates = {name.partition(" ")[0] for name in raw}
    columns = [c for c in trial.samples.columns if c in noisy or c.startswith("plate")]
    found = {c: sampled(trial, c) for c in columns if c.partition("_")[0] not in plates}
    return {name: x for name, x in found.items() if x[1].size}


def measure_saturation(examined: Examined) -> CheckResult:
    """Longest run [samples] of a channel at the lowest or highest value of its sensor, stated or seen; of a plate, of
    its raw channels."""
    trial, raw = examined.trial, raw_channels(examined.trial)
    driven = examined.experiment.motion  # what nobody drives may stand by friction
    names = [*noisy_channels(trial, raw), *(c for c in trial.samples.columns if c == driven or stated_range(trial, c))]
    lengths = {name: samples_at_rail(trial, name, examined.experiment.torque) for name in names}
    return worst(lengths | {name: facts["clipped_samples"] for name, facts in raw.items()}, NO_ANALOG)


def measure_stuck(examined: Examined) -> CheckResult:
    """Longest time [s] that a noisy channel repeats one value, or that an angle stands while it should change. A load
    cell whose steps are larger than its noise repeats a value while the joint rests, and Nexus writes 0 without load.
    The angle should follow its command, or else the torque, averaged: while the joint rests, the noise of a small
    torque is a part of its range. It may rest in static and plate trials."""
    trial, columns, raw = examined.trial, examined.samples.columns, raw_channels(examined.trial)
    moving = examined.experiment.motion or ("theta" if examined.experiment.tables else "")
    angle = sampled(trial, moving if moving in columns else "theta")
    creep = AT_REST * float(np.ptp(angle[1])) if angle[1].size else 0.0
    times, channels = {}, noisy_channels(trial, raw)
    silent = {name for name, (_, x) in channels.items() if not x.any()}
    used = {name.partition("_")[0] for name in channels.keys() - silent}
    for name, (time, x) in channels.items():
        if name.startswith("plate"):  # one that is 0 throughout is dead if another of its plate is not
            times[name] = held(time, np.where(x == 0, np.nan, x))
            if name in silent and name.partition("_")[0] in used:
                times[name] = float(np.ptp(time))
        elif name == "current":
            times[name] = 0.0 if is_command(x) else held(time, x)
        elif angle[0].size < 2 or not np.ptp(x):
            times[name] = held(time, x)
        else:
            times[name] = held(time, x, (time, np.interp(time, *angle)), creep)
    times |= {name: (facts["stands_to_s"] or 0.0) - (facts["stands_from_s"] or 0.0) for name, facts in raw.items()}
    reference = next((c for c in ("theta_command", "torque") if c in columns), None)
    time, theta = sampled(trial, "theta")
    if reference and time.size and (means := averaged(*sampled(trial, reference)))[0].size:
        beside = SMOOTHED / 2 + median_step(time)  # at the start of a motion the torque jumps before the angle
        times["theta"] = held(time, theta, means, MOVES * float(np.ptp(means[1])), beside)
    if moving in columns and angle[1].size and not np.ptp(angle[1]):
        times[moving] = float(np.ptp(angle[0]))
    return worst(times, NO_ANALOG)


def held(
    time: Array, values: Array, reference: tuple[Array, Array] | None = None, least: float = 0.0, beside: float = 0.0
) -> float:
    """Longest time [s] that a channel (n,) repeats one value while its reference, times and values, changes by more
    than `least`. At both ends of the repetition `beside` [s] do not count."""
    edges = run_edges(np.diff(values) == 0)
    for first, last in edges[np.argsort(edges[:, 0] - edges[:, 1], kind="stable")].tolist():
        if reference is not None:
            start = np.searchsorted(reference[0], time[first] + beside)
            within = reference[1][start : np.searchsorted(reference[0], time[last] - beside, "right")]
            if not within.size or np.ptp(within) <= least:
                continue
        return float((last - first) * median_step(time))
    return 0.0


def averaged(time: Array, values: Array) -> tuple[Array, Array]:
    """Times [s] and mean values of consecutive stretches of `SMOOTHED` seconds."""
    length = max(round(SMOOTHED / median_step(time)), 1) if time.size > 1 else 1
    whole = values.size // length * length
    means = [x[:whole].reshape(-1, length).mean(axis=1) for x in (time, values)]
    return means[0], means[1]


# Zeros, turns, and markers.

TURNS = (2 * np.pi, 360.0)  # one turn, and one turn in degrees that the source file calls radians
TURN_TOLERANCE = 0.1  # of a turn
WINDOW = 0.2  # s, in which the level of a plate is read
RESTING_PLATE = 20.0  # N, largest standard deviation in a window of a plate at rest
LEAST_REST = 0.2  # s, shortest rest from which a load cell is judged
PERSON = 200.0  # N: what a zeroed plate reads below minus this is somebody's weight, of the wrong sign
NO_DYNAMOMETER = "no torque on a dynamometer"
NEVER_BARE = "never at rest, or loaded throughout"


def measure_unzeroed_load_cell(examined: Examined) -> CheckResult:
    """Size of the mean torque [N*m] before the dynamometer first moves the joint."""
    if not {"theta", "torque"} <= set(examined.samples.columns):
        return not_applicable(NO_DYNAMOMETER)
    (moving, angle), (time, torque) = (sampled(examined.trial, name) for name in ("theta", "torque"))
    moved = abs(angle - angle[:1]) > AT_REST * np.ptp(angle) if angle.size else np.zeros(0, bool)
    rest = time < moving[np.argmax(moved)] if moved.any() else np.ones(time.size, bool)
    if rest.sum() < 2 or np.ptp(time[rest]) < LEAST_REST:
        return not_applicable("the recording begins while the joint moves")
    mean = float(torque[rest].mean())
    return CheckResult(abs(mean), f"{mean:.3g} N*m over the first {np.ptp(time[rest]):.2f} s")


def measure_unzeroed_plate(examined: Examined) -> CheckResult:
    """Largest size of the level [N] of a bare plate. A negative level is always an error, a positive one where it is
    below what a resting plate may scatter, or every plate is bare at some time."""
    columns = [c for c in examined.samples.columns if c.startswith("plate") and c.endswith("_force_z")]
    levels = {c.removesuffix("_force_z"): bare_level(*sampled(examined.trial, c)) for c in columns}
    bare = examined.experiment.bare_plate
    counted = {plate: level for plate, level in levels.items() if level is not None and (level < RESTING_PLATE or bare)}
    if not counted:
        return not_applicable(f"the plates are {NEVER_BARE}" if columns else "no plate")
    remarks = [plate_level(plate, level, examined.experiment.walker) for plate, level in counted.items()]
    remarks += [f"{plate} is {NEVER_BARE}" for plate in levels if plate not in counted]
    return CheckResult(max(abs(level) for level in counted.values()), ", ".join(remarks))


def plate_level(plate: str, level: float, walker: bool) -> str:
    """A plate's level [N] in words, with the cause where it can only be a person's weight with the wrong sign."""
    if not walker or level > -PERSON:
        return f"{plate} {level:.1f} N"
    return (
        f"{plate} {level:.1f} N, a person's weight with the wrong sign: correct the plate's `sign` or corners, or "
        "`axes` in the source file, unless it was zeroed while somebody stood on it"
    )


def bare_level(time: Array, force: Array) -> float | None:
    """Mean [N] of the quiet window nearest to zero, of a vertical force (n,); None where no window is quiet."""
    length = max(round(WINDOW / median_step(time)), 1) if time.size > 1 else 1
    if force.size < length:
        return None
    windows = force[: force.size // length * length].reshape(-1, length)
    quiet = windows[windows.std(axis=1) < RESTING_PLATE].mean(axis=1)
    return float(quiet[np.argmin(abs(quiet))]) if quiet.size else None


def measure_encoder_wrap(examined: Examined) -> CheckResult:
    """Number of steps of an angle by about a turn."""
    jumps: dict[str, float] = {}
    for column in ("theta", "theta_m", "theta_command"):
        if column in examined.samples.columns:
            jump = abs(np.diff(sampled(examined.trial, column)[1]))
            jumps[column] = float(sum((abs(jump / turn - 1) < TURN_TOLERANCE).sum() for turn in TURNS))
    return worst(jumps, "no angle")


def measure_marker_gap(examined: Examined) -> CheckResult:
    """Longest time [s] that a marker was hidden; the remark counts the markers with gaps."""
    gaps = {}
    for column in examined.samples.columns:
        if column.startswith("marker_") and column.endswith("_x"):
            time, x = examined.trial.arrays(column)
            gaps[column.removeprefix("marker_").removesuffix("_x")] = hidden(time, ~np.isnan(x))
    result = worst(gaps, "no markers")
    with_gaps = sum(gap > 0 for gap in gaps.values())
    return CheckResult(result.value, f"{result.remark}; {with_gaps} of {len(gaps)} markers") if with_gaps else result


def hidden(time: Array, seen: NDArray[np.bool_]) -> float:
    """Longest time [s] between two sightings, beyond one step; all the time if it was never seen."""
    if not seen.any():
        return float(np.ptp(time)) if time.size else 0.0
    longest = float(np.diff(time[seen]).max(initial=0.0)) - median_step(time)
    return longest if longest > 0.5 * median_step(time) else 0.0


# Force plates: the centre of pressure lies on the plate, and moves, while somebody walks over it.

UNDER_FOOT = 100.0
"""Vertical force [N] from which a plate has a centre of pressure; below, noise and a moving platform shift it."""
FEWEST_PRESSED = 10  # fewest samples under load from which a plate is judged
OFTEN = 95.0  # percentile of the distances that is judged: the first and last samples of a stance are inexact
ROLLS = 0.02  # way [m] of the centre of pressure under a rolling foot, at least
NO_LOAD = "no plate is stood on"


def pressed_plates(trial: Trial) -> Iterator[tuple[int, Array, Array]]:
    """Of every plate that somebody stands on, as far as corners and columns are known: its number, corners (4, 3) [m],
    and centre of pressure (k, 2) [m] from its centre along its edges, in the samples under load."""
    for plate in trial.provenance.get("plates", []):
        number, corners = int(plate["plate"]), np.array(plate["corners"], dtype=float)
        columns = [*plate_columns(number, "force"), *plate_columns(number, "moment")]
        if not set(columns) <= set(trial.samples.columns):
            continue
        values, axes = trial.sampled(*columns).select(columns).to_numpy(), plate_axes(corners)
        vertical = values[:, :3] @ axes[:, 2]
        loaded = vertical > UNDER_FOOT
        if loaded.sum() >= FEWEST_PRESSED:
            point = np.cross(axes[:, 2], values[loaded, 3:]) / vertical[loaded, None]
            yield number, corners, np.asarray(point @ axes[:, :2])


def measure_pressure_centre(examined: Examined) -> CheckResult:
    """Largest distance [m] by which a centre of pressure lies outside its plate under load; the remark says why."""
    distances, remarks = [], []
    for number, corners, points in pressed_plates(examined.trial):
        distance, thousandth = (float(np.percentile(beside(p, corners), OFTEN)) for p in (points, points / 1000))
        distances.append(distance)
        if distance > 0:
            why = (
                "its moments look a thousand times too large; state `plate_units` in the source file, as {force: N, "
                "moment: N*mm}"
                if thousandth == 0 and travel(points / 1000) > ROLLS
                else "a moment channel is dead, clipped or of the other sign, or the corners are wrong"
            )
            remarks.append(f"plate{number}: the centre of pressure is {distance:.3g} m outside: {why}")
    return CheckResult(max(distances), "; ".join(remarks)) if distances else not_applicable(NO_LOAD)


def measure_pressure_travel(examined: Examined) -> CheckResult:
    """Shortest way [m] that the centre of pressure covers under a loaded plate, from its 5th to its 95th percentile."""
    ways = {number: travel(points) for number, _, points in pressed_plates(examined.trial)}
    if not ways:
        return not_applicable(NO_LOAD)
    number = min(ways, key=lambda plate: ways[plate])
    return CheckResult(
        ways[number], f"plate{number}: if it stands still, the moments are dead or a thousand times too small"
    )


def travel(points: Array) -> float:
    """Way [m] of points (k, 2) from their 5th to their 95th percentile."""
    low, high = np.percentile(points, [100 - OFTEN, OFTEN], axis=0)
    return float(np.hypot(*(high - low)))


CHANNEL_CHECKS = (
    Check("saturation", "samples", "above",
        "longest run of a torque, current, angle or raw channel of a plate at an end of its sensor's range",
        Cause("clipped signal",
            "a sensor stands at the end of its range, so that the largest torques or angles are missing",
            "use a sensor of larger range, or a smaller motion"), measure_saturation),
    Check("stuck", "s", "above",
        "longest time that a noisy channel repeats one value, or that an angle stands while it should change",
        Cause("frozen signal", "a channel repeats one value although the joint moves, as of a loose cable",
            "check the sensor, its cable and its channel in the source file"), measure_stuck),
    Check("unzeroed_load_cell", "N*m", "above", "size of the torque before the joint first moves",
        Cause("load cell not zeroed",
            "the torque is not zero before the joint moves, fits have an offset and bear it, unless the sensor is near "
            "the end of its range", "zero the load cell, or accept a joint that rests under load"),
        measure_unzeroed_load_cell, lambda experiment: experiment.motion == "theta", NO_DYNAMOMETER),
    Check("unzeroed_plate", "N", "above", "size of the vertical force of a bare plate",
        Cause("force plate not zeroed", "the empty plate reads a force, which falsifies load and centre of pressure",
            "zero the plate before the trial"), measure_unzeroed_plate),
    Check("encoder_wrap", "jumps", "above", "steps of an angle by about 2 pi, or by 360",
        Cause("angle jumps by a turn", "the encoder's counter starts anew within the recording",
            "set its zero away from the motion, or count turns in the recorder"), measure_encoder_wrap),
    Check("marker_gap", "s", "above", "longest time that a marker was hidden between two sightings",
        Cause("hidden marker", "a marker was hidden for longer than is bridged, and its frames are not used",
            "fill the gap in the capture software, or correct the marker's place"), measure_marker_gap),
    Check("pressure_centre", "m", "above",
        "distance by which the centre of pressure of a loaded plate lies outside the plate",
        Cause("load beside the plate", "the foot seems to press beside the plate, so that moments, signs or corners "
            "are wrong", "check units, signs and corners of the plate in the source file"), measure_pressure_centre,
        lambda experiment: experiment.walker, "nobody stands on a plate"),
    Check("pressure_travel", "m", "below",
        "way of the centre of pressure over a loaded plate; a foot rolls over 0.1 m and more",
        Cause("load that does not roll", "the centre of pressure stands still under a walking foot, so that moments "
            "are dead or in another unit", "check the plate's moment channels and `plate_units` in the source file"),
        measure_pressure_travel, lambda experiment: experiment.walker and bool(experiment.tables),
        "nobody walks over a plate"),
)  # fmt: skip
