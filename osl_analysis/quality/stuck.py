"""Channels that do not change where they should."""

import numpy as np

from osl_analysis.experiments import Experiment
from osl_analysis.quality.checks import (
    AT_REST,
    NO_ANALOG,
    CheckResult,
    Examined,
    channel,
    duration,
    length_of_longest,
    median_step,
    own_channels,
    raw_channels,
    worst,
)
from osl_analysis.rails import is_command
from osl_analysis.signals import run_edges
from osl_analysis.trial import Array

MOVES = 0.2  # of the reference's range: while it changes by more, the joint should have moved

SMOOTHED = 0.05  # s, over which a reference is averaged; a sine of 5 Hz keeps nine tenths of its amplitude


def measure_stuck(examined: Examined) -> CheckResult:
    """Longest time [s] that a noisy channel repeats one value, or that an angle stands while it should change."""
    raw = raw_channels(examined.trial)
    channels = own_channels(examined, raw)
    plates = {name: x for name, x in channels.items() if name.startswith("plate")}
    angle = moving_joint(examined)
    times = {name: held_while_moving(*x, angle) for name, x in channels.items()}
    times |= {"current": held_measured(*channels["current"])} if "current" in channels else {}
    times |= {
        name: duration(time) if dead(name, plates) else held_loaded(time, x) for name, (time, x) in plates.items()
    }
    times |= {name: (facts["stands_to_s"] or 0.0) - (facts["stands_from_s"] or 0.0) for name, facts in raw.items()}
    return worst(times | standing_angles(examined), NO_ANALOG)


def held(time: Array, values: Array) -> float:
    """Longest time [s] of one value, (n,) each."""
    return length_of_longest(np.diff(values) == 0) * median_step(time)


def moving_joint(examined: Examined) -> tuple[Array, Array]:
    """Time [s] and values of the angle that moves in the experiment, (n,) each; empty without one."""
    angle = next((c for c in (moving_angle(examined.experiment), "theta") if c in examined.samples.columns), None)
    return channel(examined.samples, angle) if angle else (np.empty(0), np.empty(0))


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


def held_measured(time: Array, values: Array) -> float:
    """Longest time [s] that a measured current repeats one value, (n,) each; 0 for a commanded one."""
    return 0.0 if is_command(values) else held(time, values)


def held_loaded(time: Array, values: Array) -> float:
    """Longest time [s] that a plate's channel repeats a value other than 0, (n,) each: Nexus writes 0 without load."""
    return length_of_longest((np.diff(values) == 0) & (values[1:] != 0)) * median_step(time)


def dead(name: str, plates: dict[str, tuple[Array, Array]]) -> bool:
    """Whether a plate's channel is exactly 0 throughout while another of the same plate is not.

    A plate all of whose channels are 0 is unused.
    """
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
    """Times [s] and mean values of consecutive stretches of `SMOOTHED` seconds, from samples (n,)."""
    length = max(round(SMOOTHED / median_step(time)), 1) if time.size > 1 else 1
    whole = values.size // length * length
    means = [x[:whole].reshape(-1, length).mean(axis=1) for x in (time, values)]
    return means[0], means[1]


def moving_angle(experiment: Experiment) -> str:
    """The angle that changes in every trial of the experiment; empty where the joint may rest throughout.

    The joint rests in static and plate trials, which have no result tables.
    """
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
