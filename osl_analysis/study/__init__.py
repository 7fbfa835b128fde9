"""The Monte Carlo study: bias and efficiency of the estimators, and coverage of their intervals. Here stands which
experiments it has, and how many trials each of its jobs takes. Rules read it: it imports nothing that simulates."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
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
MOST_JOBS = 90  # Largest number of jobs that simulate. The table, the page and the figure come to them
SECONDS = {
    "frequency response": 3.0, "repeated transmission": 7.0, "belt": 0.04, "repeated belt": 0.35, "actuator": 0.4,
    "walking": 0.7, "walking recorded": 6.0,
}  # fmt: skip
"""Time of one core per trial, or per campaign of repeated and walking trials, with the settings of
config/config.yaml [s], as a job's log states. Those that are not here are stepped sines, of 1.4 s."""


@dataclass(frozen=True)
class Batch:
    """What one job takes: trials (or campaigns) number `first` to `first + number - 1` of an experiment."""

    experiment: str
    first: int
    number: int

    @property
    def seconds(self) -> float:
        """The time of one core that is expected [s]."""
        return self.number * SECONDS.get(self.experiment, 1.4)


def study_batches(numbers: Mapping[str, tuple[int, int]]) -> list[Batch]:
    """The jobs of a study with so many trials of each experiment, and so many of them at least in one job. At most
    `MOST_JOBS` (or one for each experiment, if these are more) take about as long each."""
    expected = sum(Batch(name, 0, number).seconds for name, (number, _) in numbers.items())
    longest = expected / max(MOST_JOBS - len(numbers), 1)
    found: list[Batch] = []
    for name, (number, least) in numbers.items():
        size = max(least, math.ceil(longest / Batch(name, 0, 1).seconds))
        found += [Batch(name, first, min(size, number - first)) for first in range(0, number, size)]
    return found


def planned(expected: Mapping[str, float]) -> str:
    """What a dry run says of the jobs that it would run, from the expected time of each by its name [s]. Empty without
    any."""
    if not expected:
        return ""
    hours = sum(expected.values()) / 3600
    lines = [f"expected time of one core for {len(expected)} jobs of the study, {hours:.1f} h in all:"]
    for name, seconds in expected.items():
        lines.append(f"  {name}: " + (f"{seconds / 60:.0f} min" if seconds >= 90 else f"{seconds:.0f} s"))
    return "\n".join(lines)
