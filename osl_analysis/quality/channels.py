"""Channels that rail, stick, wrap or vanish."""

import numpy as np
import polars as pl

from osl_analysis.quality.finding import Finding, longest_run, worst
from osl_analysis.trial import Array

NEAR = 0.05  # of a channel's range: an extreme so close to zero is an unloaded sensor, not a rail
AWAY = 0.25  # of a channel's range, that a rail lies from where the channel mostly is
MOVES = 0.2  # of the reference's range, by which the joint should have moved
ANGLES = ("theta", "theta_m", "theta_command")
TURNS = (2 * np.pi, 360.0)  # a turn, and a turn in degrees that the source file calls radians
TURN_TOLERANCE = 0.1
NO_ANALOG = "no torque, current or plate"


def analog_channels(samples: pl.DataFrame) -> dict[str, tuple[Array, Array]]:
    """Time [s] and values of the channels that have noise: torque, current, plates."""
    columns = [c for c in samples.columns if c in ("torque", "current") or c.startswith("plate")]
    return {column: signal(samples, column) for column in columns}


def signal(samples: pl.DataFrame, column: str) -> tuple[Array, Array]:
    """Time [s] and values of one column, where it was sampled."""
    rows = samples.select("time", column).drop_nulls()
    return rows["time"].to_numpy(), rows[column].to_numpy()


def check_saturation(samples: pl.DataFrame) -> Finding:
    """Longest run [samples] of a noisy channel at its lowest or highest value, away from zero and from its median."""
    return worst({name: rail(x) for name, (_, x) in analog_channels(samples).items() if x.size}, NO_ANALOG)


def rail(values: Array) -> int:
    """Longest run at an extreme, (n,); a single sample there is what every noisy channel has."""
    low, high = float(values.min()), float(values.max())
    span, middle = high - low, float(np.median(values))
    extremes = [e for e in (low, high) if abs(e) > NEAR * span and abs(e - middle) > AWAY * span]
    return max((longest_run(values == e) for e in extremes), default=0)


def check_stuck(samples: pl.DataFrame) -> Finding:
    """Longest time [s] that a noisy channel repeats one value, or that the joint's angle stands while it should move.

    A plate that reads exactly zero is unloaded or unused: Nexus writes such.
    """
    found = {name: held(*channel, zero=name.startswith("plate")) for name, channel in analog_channels(samples).items()}
    reference = next((c for c in ("theta_command", "torque") if c in samples.columns), None)
    if reference and "theta" in samples.columns:
        rows = samples.select("time", "theta", reference).drop_nulls()
        found["theta"] = standing(*(rows[c].to_numpy() for c in rows.columns))
    return worst(found, NO_ANALOG)


def held(time: Array, values: Array, zero: bool) -> float:
    """Longest time [s] of one value, (n,) each; `zero`: that value may be 0."""
    same = (np.diff(values) == 0) & ~((values[1:] == 0) & zero)
    return longest_run(same) * step_of(time)


def standing(time: Array, theta: Array, reference: Array) -> float:
    """Longest time [s] that theta repeats one value while the reference goes through a part of its range."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], (np.diff(theta) == 0).astype(np.int8), [0]])))
    least = MOVES * float(np.ptp(reference)) if reference.size else 0.0
    runs = [
        float(time[stop] - time[start])
        for start, stop in zip(edges[::2], edges[1::2], strict=True)
        if np.ptp(reference[start : stop + 1]) > least
    ]
    return max(runs, default=0.0)


def step_of(time: Array) -> float:
    """Median step [s]; 0 for a single sample."""
    return float(np.median(np.diff(time))) if time.size > 1 else 0.0


def check_encoder_wrap(samples: pl.DataFrame) -> Finding:
    """Steps of an angle by about a turn."""
    found = {}
    for column in ANGLES:
        if column in samples.columns:
            _, angle = signal(samples, column)
            jump = abs(np.diff(angle))
            found[column] = float(sum((abs(jump / turn - 1) < TURN_TOLERANCE).sum() for turn in TURNS))
    return worst(found, "no angle")


def check_marker_gap(samples: pl.DataFrame) -> Finding:
    """Longest time [s] that a marker was hidden between two sightings; all the time, if it was never seen."""
    found = {}
    for column in samples.columns:
        if column.startswith("marker_") and column.endswith("_x"):
            time, x = signal(samples, column)
            found[column.removeprefix("marker_").removesuffix("_x")] = hidden(time, ~np.isnan(x))
    finding = worst(found, "no markers")
    with_gaps = sum(gap > 0 for gap in found.values())
    return Finding(finding.value, f"{finding.remark}; {with_gaps} of {len(found)} markers") if with_gaps else finding


def hidden(time: Array, seen: np.ndarray) -> float:
    """Longest time [s] beyond one step between two sightings, (n,) each."""
    if not seen.any():
        return float(np.ptp(time)) if time.size else 0.0
    gaps = np.diff(time[seen])
    longest = float(gaps.max(initial=0.0)) - step_of(time)
    return longest if longest > 0.5 * step_of(time) else 0.0
