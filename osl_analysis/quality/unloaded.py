"""Sensors that do not read zero when nothing loads them."""

import numpy as np
import polars as pl

from osl_analysis.experiments import EXPERIMENTS
from osl_analysis.quality.channels import signal, step_of
from osl_analysis.quality.finding import Finding, not_applicable
from osl_analysis.trial import Array

WINDOW = 0.2  # s
QUIET = 20.0  # N, largest scatter in a window that a resting plate has
AT_REST = 0.02  # of the angle's range, that the joint may creep
LEAST_REST = 0.2  # s


def check_load_cell(samples: pl.DataFrame, experiment: str) -> Finding:
    """Size of the mean torque [N*m] before the joint first moves, on the dynamometer."""
    if EXPERIMENTS[experiment].torque != "torque" or not {"theta", "torque"} <= set(samples.columns):
        return not_applicable("no torque on a dynamometer")
    rows = samples.select("time", "theta", "torque").drop_nulls()
    time, theta, torque = (rows[c].to_numpy() for c in rows.columns)
    moved = abs(theta - theta[:1]) > AT_REST * np.ptp(theta) if theta.size else np.zeros(0, bool)
    rest = int(np.argmax(moved)) if moved.any() else theta.size
    if rest < 2 or time[rest - 1] - time[0] < LEAST_REST:
        return not_applicable("the recording begins while the joint moves")
    mean = float(torque[:rest].mean())
    return Finding(abs(mean), f"{mean:.3g} N*m over the first {time[rest - 1] - time[0]:.2f} s")


def check_plates(samples: pl.DataFrame, experiment: str) -> Finding:
    """Largest size of a bare plate's vertical force [N].

    A plate's level is the mean of the quiet window of 0.2 s that lies nearest to zero. A negative one is an error
    whatever stands there; a positive one only in experiments in which the plate is bare at some time.
    """
    columns = [c for c in samples.columns if c.startswith("plate") and c.endswith("_force_z")]
    levels = {c.removesuffix("_force_z"): bare_level(*signal(samples, c)) for c in columns}
    told = {
        plate: level
        for plate, level in levels.items()
        if level is not None and (level < QUIET or EXPERIMENTS[experiment].bare_plate)
    }
    if not told:
        return not_applicable("no plate" if not columns else "the plates are never at rest, or loaded throughout")
    read = [f"{plate} {level:.1f} N" for plate, level in told.items()]
    read += [f"{plate} is never at rest, or loaded throughout" for plate in levels if plate not in told]
    return Finding(max(abs(level) for level in told.values()), ", ".join(read))


def bare_level(time: Array, force: Array) -> float | None:
    """Mean [N] of the quiet window nearest to zero, of a vertical force (n,); None where no window is quiet."""
    length = max(round(WINDOW / step_of(time)), 1) if time.size > 1 else 1
    if force.size < length:
        return None
    windows = force[: force.size // length * length].reshape(-1, length)
    quiet = windows[windows.std(axis=1) < QUIET].mean(axis=1)
    return float(quiet[np.argmin(abs(quiet))]) if quiet.size else None
