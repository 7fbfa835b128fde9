"""A force plate's zero and its range: what it reads with nobody on it, and whether it reached its limit."""

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.signals import longest_run, sampling_rate
from osl_analysis.trial import Array
from osl_analysis.walking.moving_plate import Wrench

HELD_S = 0.02
"""A component that keeps its largest reading for so long [s] has reached its limit: noise and gait keep none."""


def unloaded_zero(time: Array, wrench: Wrench, stretch: float, largest: float) -> Wrench:
    """Mean wrench (1, 3) each [N, N*m] of a plate before it is stepped on, to be taken away from all samples.

    `wrench` (n,) at `time` [s] in the plate's axes. The stretch is the `stretch` [s] ahead of the largest vertical
    force over which that force varies least: gait never keeps a load so still, and afterwards the platform may be
    tilted, where the plate's own weight shows.

    Raises
    ------
    InputError
        There is no such stretch, or the vertical force in it is more than `largest` [N].
    """
    length, vertical = round(stretch * sampling_rate(time)), wrench.force[:, 2]
    before = vertical[: int(np.argmax(vertical)) + 1]
    if len(before) < length:
        raise InputError(
            f"the plate is loaded within {stretch:g} s of the record's start, so that its zero cannot be read; record "
            "earlier, or set unloaded_s to null"
        )
    windows = np.lib.stride_tricks.sliding_window_view(before - before[0], length)
    start = int(np.argmin(np.var(windows, axis=1)))
    rows = slice(start, start + length)
    zero = Wrench(*(part[rows].mean(axis=0, keepdims=True) for part in (wrench.force, wrench.moment)))
    check_zero(float(zero.force[0, 2]), largest)
    return zero


def check_zero(reading: float, largest: float) -> None:
    """Refuse a plate that reads more than `largest` [N] upwards or downwards with nobody on it."""
    if abs(reading) > largest:
        raise InputError(
            f"the plate reads {reading:.0f} N with nobody on it, expected less than {largest:g} N: it was not zeroed "
            "or has reached its limit; zero it and record again, leave it out, or raise largest_zero_n"
        )


def check_range(time: Array, force: Array, axes: Array, load: float) -> None:
    """Refuse a force (n, 3) [N] whose component in the plate's `axes` (3, 3), as columns, stays at its extreme.

    Forces below `load` [N] count as unloaded.

    Raises
    ------
    InputError
        A component above `load` is held for 20 ms at its largest or smallest value.
    """
    held = max(round(HELD_S * sampling_rate(time)), 3)
    for name, channel in zip("xyz", (force @ axes).T, strict=True):
        for extreme in (float(channel.max()), float(channel.min())):
            run = longest_run(np.abs(channel - extreme) <= 1e-6 * abs(extreme))
            if abs(extreme) > load and run.stop - run.start >= held:
                duration = 1e3 * (run.stop - run.start) / sampling_rate(time)
                raise InputError(
                    f"the plate's F{name} stays at {abs(extreme):.0f} N for {duration:.0f} ms until "
                    f"{time[run.stop - 1]:.3f} s: "
                    "it has reached its limit; choose a larger range, or exclude the trial"
                )


def plate_axes(corners: Array) -> Array:
    """The plate's axes as columns (3, 3), along its edges, from its corners (4, 3) [m]; signs do not matter here."""
    x, y = corners[0] - corners[1], corners[0] - corners[3]
    z = np.cross(x, y)
    y = np.cross(z, x)
    return np.column_stack([axis / np.linalg.norm(axis) for axis in (x, y, z)])
