"""The checks of channels: those that rail, stick, wrap or vanish, and sensors that do not read zero without load."""

import numpy as np
from numpy.typing import NDArray

from osl_analysis.experiments import Experiment
from osl_analysis.quality.checks import (
    AT_REST,
    NO_ANALOG,
    Check,
    CheckResult,
    Examined,
    channel,
    duration,
    length_of_longest,
    median_step,
    not_applicable,
    own_channels,
    raw_channels,
    worst,
)
from osl_analysis.rails import is_command, samples_at_rail, stated_range
from osl_analysis.signals import run_edges
from osl_analysis.trial import Array

MOVES = 0.2  # of the reference's range: while it changes by more, the joint should have moved

SMOOTHED = 0.05  # s, over which a reference is averaged; a sine of 5 Hz keeps nine tenths of its amplitude


def measure_stuck(examined: Examined) -> CheckResult:
    """Longest time [s] that a noisy channel repeats one value, or that an angle stands while it should change."""
    raw = raw_channels(examined.trial)
    channels = own_channels(examined, raw)
    plates = {name: x for name, x in channels.items() if name.startswith("plate")}
    column = next((c for c in (moving_angle(examined.experiment), "theta") if c in examined.samples.columns), None)
    angle = channel(examined.samples, column) if column else (np.empty(0), np.empty(0))
    times = {name: held_while_moving(*x, angle) for name, x in channels.items()}
    if "current" in channels:
        times["current"] = 0.0 if is_command(channels["current"][1]) else held(*channels["current"])
    for name, (time, x) in plates.items():  # Nexus writes 0 without load
        loaded = length_of_longest((np.diff(x) == 0) & (x[1:] != 0)) * median_step(time)
        times[name] = duration(time) if dead(name, plates) else loaded
    times |= {name: (facts["stands_to_s"] or 0.0) - (facts["stands_from_s"] or 0.0) for name, facts in raw.items()}
    return worst(times | standing_angles(examined), NO_ANALOG)


def held(time: Array, values: Array) -> float:
    return length_of_longest(np.diff(values) == 0) * median_step(time)


def held_while_moving(time: Array, values: Array, angle: tuple[Array, Array]) -> float:
    """Longest time [s] that a channel repeats one value, (n,) each, while the joint's angle changes.

    A load cell whose steps are larger than its noise repeats a value while the joint rests. Without an angle, or where
    the channel never changes, the motion does not matter.
    """
    if angle[0].size < 2 or not values.size or not np.ptp(values):
        return held(time, values)
    there, moved = np.interp(time, *angle), AT_REST * float(np.ptp(angle[1]))
    repeated = run_edges(np.diff(values) == 0)
    ends = np.add(repeated, [0, 1]).ravel()  # the rows of each run, and after each the rows up to the next
    padded = np.append(there, there[-1])
    turned = (np.maximum.reduceat(padded, ends) - np.minimum.reduceat(padded, ends))[::2] if len(ends) else np.empty(0)
    moving = (repeated[:, 1] - repeated[:, 0])[turned > moved]
    return int(moving.max(initial=0)) * median_step(time)


def dead(name: str, plates: dict[str, tuple[Array, Array]]) -> bool:
    """Whether a plate's channel is exactly 0 throughout and another of its plate is not: all are if it is unused."""
    plate = name.partition("_")[0]
    silent = {other for other, (_, values) in plates.items() if not values.any()}
    return name in silent and any(other.partition("_")[0] == plate for other in plates.keys() - silent)


def standing_angles(examined: Examined) -> dict[str, float]:
    """Longest time [s] that an angle stands: all the time if it never changes, else while its reference changes.

    The reference of the joint's angle is its command, or else the torque, smoothed: while the joint rests, the noise of
    a small torque is a part of its range.
    """
    samples, times = examined.samples, {}
    reference = next((c for c in ("theta_command", "torque") if c in samples.columns), None)
    if reference and "theta" in samples.columns:
        time, values = channel(samples, "theta")
        commanded = smoothed(*channel(samples, reference))
        if time.size and commanded[0].size:
            times["theta"] = standing(time, values, commanded)
    angle = moving_angle(examined.experiment)
    if angle in samples.columns:
        time, values = channel(samples, angle)
        if values.size and not np.ptp(values):
            times[angle] = duration(time)
    return times


def smoothed(time: Array, values: Array) -> tuple[Array, Array]:
    """Times [s] and mean values of consecutive stretches of `SMOOTHED` seconds."""
    length = max(round(SMOOTHED / median_step(time)), 1) if time.size > 1 else 1
    whole = values.size // length * length
    means = [x[:whole].reshape(-1, length).mean(axis=1) for x in (time, values)]
    return means[0], means[1]


def moving_angle(experiment: Experiment) -> str:
    """The angle that changes in every trial; empty for static and plate trials, in which the joint may rest."""
    return experiment.motion or ("theta" if experiment.tables else "")


def standing(time: Array, theta: Array, reference: tuple[Array, Array]) -> float:
    """Longest time [s] that theta (n,) repeats one value while the reference goes through a part of its range.

    `reference` has times [s] and means of stretches (m,), of which those within the repetition count: at the start of a
    motion the torque jumps before the angle leaves its value.
    """
    middle, means = reference
    least, half = MOVES * float(np.ptp(means)), SMOOTHED / 2 + median_step(time)
    ends = time[run_edges(np.diff(theta) == 0)]
    longest = 0.0
    for start, stop in ends[ends[:, 1] - ends[:, 0] > 2 * half].tolist():
        first, after = np.searchsorted(middle, start + half, "right"), np.searchsorted(middle, stop - half)
        if first < after and np.ptp(means[first:after]) > least:
            longest = max(longest, stop - start)
    return longest


TURNS = (2 * np.pi, 360.0)  # one turn, and one turn in degrees that the source file calls radians
TURN_TOLERANCE = 0.1  # of a turn
WINDOW = 0.2  # s, in which the level of a plate is read
QUIET = 20.0  # N, largest standard deviation in a window of a plate at rest
LEAST_REST = 0.2  # s, shortest rest from which a load cell is judged
PERSON = 200.0  # N: what a zeroed plate reads below minus this is somebody's weight, of the wrong sign
NO_DYNAMOMETER = "no torque on a dynamometer"
NO_PLATE, NEVER_BARE = "no plate", "the plates are never at rest, or loaded throughout"


def measure_saturation(examined: Examined) -> CheckResult:
    """Longest run [samples] of a channel at the lowest or highest value of its sensor, stated or seen; of a plate, of
    its raw channels.
    """
    trial, torque, raw = examined.trial, examined.experiment.torque, raw_channels(examined.trial)
    names = [name for name, (_, values) in own_channels(examined, raw).items() if values.size]
    driven = examined.experiment.motion  # what nobody drives may stand by friction
    names += [name for name in trial.samples.columns if name == driven or stated_range(trial, name)]
    lengths = {name: samples_at_rail(trial, name, torque) for name in names}
    return worst(lengths | {name: facts["clipped_samples"] for name, facts in raw.items()}, NO_ANALOG)


def measure_unzeroed_load_cell(examined: Examined) -> CheckResult:
    """Size of the mean torque [N*m] before the dynamometer first moves the joint."""
    if not {"theta", "torque"} <= set(examined.samples.columns):
        return not_applicable(NO_DYNAMOMETER)
    (moving, angle), (time, torque) = (channel(examined.samples, name) for name in ("theta", "torque"))
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
    levels = {c.removesuffix("_force_z"): bare_level(*channel(examined.samples, c)) for c in columns}
    known = {plate: level for plate, level in levels.items() if level is not None}
    counted = {plate: level for plate, level in known.items() if level < QUIET or examined.experiment.bare_plate}
    if not counted:
        return not_applicable(NEVER_BARE if columns else NO_PLATE)
    remarks = [plate_level(plate, level, examined.experiment.walker) for plate, level in counted.items()]
    remarks += [f"{plate} is never at rest, or loaded throughout" for plate in levels if plate not in counted]
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
    quiet = windows[windows.std(axis=1) < QUIET].mean(axis=1)
    return float(quiet[np.argmin(abs(quiet))]) if quiet.size else None


def measure_encoder_wrap(examined: Examined) -> CheckResult:
    """Number of steps of an angle by about a turn."""
    jumps: dict[str, float] = {}
    for column in ("theta", "theta_m", "theta_command"):
        if column in examined.samples.columns:
            _, angle = channel(examined.samples, column)
            jump = abs(np.diff(angle))
            jumps[column] = float(sum((abs(jump / turn - 1) < TURN_TOLERANCE).sum() for turn in TURNS))
    return worst(jumps, "no angle")


def measure_marker_gap(examined: Examined) -> CheckResult:
    """Longest time [s] that a marker was hidden; the remark counts the markers with gaps."""
    gaps = {}
    for column in examined.samples.columns:
        if column.startswith("marker_") and column.endswith("_x"):
            time, x = channel(examined.samples, column)
            gaps[column.removeprefix("marker_").removesuffix("_x")] = hidden(time, ~np.isnan(x))
    result = worst(gaps, "no markers")
    with_gaps = sum(gap > 0 for gap in gaps.values())
    return CheckResult(result.value, f"{result.remark}; {with_gaps} of {len(gaps)} markers") if with_gaps else result


def hidden(time: Array, seen: NDArray[np.bool_]) -> float:
    """Longest time [s] between two sightings, beyond one step; all the time if it was never seen."""
    if not seen.any():
        return duration(time)
    gaps = np.diff(time[seen])
    longest = float(gaps.max(initial=0.0)) - median_step(time)
    return longest if longest > 0.5 * median_step(time) else 0.0


CHANNEL_CHECKS = (
    Check("saturation", "samples", "above",
        "longest run of a torque, current, angle or raw channel of a plate at an end of its sensor's range",
        measure_saturation),
    Check("stuck", "s", "above",
        "longest time that a noisy channel repeats one value, or that an angle stands while it should change",
        measure_stuck),
    Check("unzeroed_load_cell", "N*m", "above", "size of the torque before the joint first moves",
        measure_unzeroed_load_cell, applies_to=lambda experiment: experiment.motion == "theta",
        otherwise=NO_DYNAMOMETER),
    Check("unzeroed_plate", "N", "above", "size of the vertical force of a bare plate", measure_unzeroed_plate),
    Check("encoder_wrap", "jumps", "above", "steps of an angle by about 2 pi, or by 360", measure_encoder_wrap),
    Check("marker_gap", "s", "above", "longest time that a marker was hidden between two sightings",
        measure_marker_gap),
)  # fmt: skip
