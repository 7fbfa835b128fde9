"""What the raw channels of a force plate show before they are added, rotated and shifted.

After the rotation a clipped or dead sensor cannot be seen: the moment of one type 3 sensor at its limit moves on with
the other three.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from osl_analysis.plateaus import run_at_extreme
from osl_analysis.signals import runs
from osl_analysis.trial import Array

LOADED = 0.2
"""Share of the range of the plate's force: where the force changes by more, every channel should change."""
LEAST_FORCE = 50.0
"""Range [N] of the plate's force above which the plate was used."""


def channel_facts(labels: Sequence[str], channels: Array, force: Array, rate: float) -> list[dict[str, Any]]:
    """Facts about each raw channel of a plate, for the trial's provenance.

    labels: names of the channels in the file.
    channels: raw samples (n, channels) in the file's units.
    force: (n, 3) [N], what the plate's channels give together.
    rate: sampling rate [Hz].

    `clipped_samples` is the length of the longest run at an extreme, `clipped_at` its value in the unit of the file.
    `stands_samples` is the length of the longest run of one value while the plate's force changes. `..._from_s` and
    `..._to_s` are the times of a run's first and last sample.
    """
    load = np.linalg.norm(force, axis=1)
    return [
        {"label": label, **clipping(values, rate), **spanned("stands", standing_run(values, load), rate)}
        for label, values in zip(labels, channels.T, strict=True)
    ]


def clipping(values: Array, rate: float) -> dict[str, Any]:
    """The longest run of a channel (n,) at an extreme, with its value."""
    run = run_at_extreme(values)
    return spanned("clipped", run, rate) | {"clipped_at": float(values[run.start]) if run.stop > run.start else None}


def standing_run(values: Array, load: Array) -> slice:
    """The longest run in which a channel (n,) repeats a value while the size of the plate's force (n,) changes."""
    least = max(LOADED * float(np.ptp(load)), LEAST_FORCE) if load.size else LEAST_FORCE
    repeated = [slice(run.start, run.stop + 1) for run in runs(np.diff(values) == 0)]
    standing = [run for run in repeated if np.ptp(load[run]) > least]
    return max(standing, key=lambda run: run.stop - run.start, default=slice(0, 0))


def spanned(name: str, run: slice, rate: float) -> dict[str, Any]:
    """A run's length in samples, and the times [s] of its first and last sample; None for an empty run."""
    found = run.stop > run.start
    return {
        f"{name}_samples": int(run.stop - run.start),
        f"{name}_from_s": run.start / rate if found else None,
        f"{name}_to_s": (run.stop - 1) / rate if found else None,
    }
