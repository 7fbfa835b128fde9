"""The Monte Carlo study: bias and efficiency of the estimators, and coverage of their intervals. Here stands which
experiments it has, and how many trials each of its jobs takes. Rules read it: it imports nothing that simulates.
`precision` says beforehand what intervals a protocol will give."""

import math
from collections.abc import Mapping
from typing import Any


def on(size: float, unit: str) -> Mapping[str, Any]:
    """A switch of the simulation that is on."""
    return {"enabled": True, "size": size, "unit": unit}


LATER = on(3e-4, "s")  # how much later the node of the torque samples
RECORDINGS: Mapping[str, tuple[Mapping[str, Any], float, int | None]] = {
    "jitter of 1 us": ({"node": {"jitter": on(1e-6, "s")}}, 1000, None),
    "jitter of 50 us": ({"node": {"jitter": on(50e-6, "s")}}, 1000, None),
    "four decimals at 300 Hz": ({"node": {"decimals": on(4, "decimal")}}, 300, None),
    "four decimals at 1024 Hz": ({"node": {"decimals": on(4, "decimal")}}, 1024, None),
    "missing samples": ({"node": {"dropped": on(1e-3, "1")}}, 1000, None),
    "two nodes": ({"node": {}, "torque_node": {"phase": LATER}}, 1000, None),
    "333 Hz and 1 kHz": ({"node": {"rate": on(333, "Hz")}, "torque_node": {"phase": LATER}}, 1000, None),
    "14 bits": ({}, 1000, 14),
    "14 bits and 50 us": ({"node": {"jitter": on(50e-6, "s")}}, 1000, 14),
    "250 Hz": ({}, 250, None),
}
"""Recordings of the joint that is exactly Eq. 15, each an experiment of its own: the recorder's nodes, as in a
simulation's settings; the bench's rate [Hz]; and the bits of the joint's encoder, None for those of the campaign."""
BENCH_EXPERIMENTS = (
    "second order", *(f"second order, {name}" for name in RECORDINGS), "linear drivetrain", "drivetrain",
    "frequency response", "transmission", "repeated transmission", "belt", "repeated belt", "actuator",
)  # fmt: skip
"""Experiments on a bench, which `study/bench.py` prepares."""
REPEATED = {"repeated transmission": 20, "repeated belt": 20}
"""Experiments on a bench whose estimate is a mean over the trials of a campaign, and how many means one job takes."""
WALKING_EXPERIMENTS = {"walking": ("campaigns", 10), "walking recorded": ("recorded", 5)}
"""Walking, from angle and torque on, and through markers, plate, C3D files and ingest: the field of `study` in the
configuration with the number of campaigns, and how many of them one job takes."""


def study_batches(numbers: Mapping[str, tuple[int, int]]) -> list[tuple[str, int, int]]:
    """The jobs of a study with so many trials (or campaigns) of each experiment, and so many of them at least in one
    job: the experiment, the number of the first trial, and how many there are. Each experiment has at most four jobs,
    so that a study has fewer than a hundred."""
    found = []
    for name, (number, least) in numbers.items():
        size = max(least, math.ceil(number / 4))
        found += [(name, first, min(size, number - first)) for first in range(0, number, size)]
    return found
