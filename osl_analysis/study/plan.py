"""The jobs of the study: how many trials each takes, so that a large study is few jobs that take about as long."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

MOST_JOBS = 90
"""Largest number of jobs that simulate. The table, the page and the figure come to them."""
SECONDS = {
    "linear drivetrain": 0.26,
    "drivetrain": 0.55,
    "frequency response": 0.26,
    "transmission": 0.28,
    "repeated transmission": 1.2,
    "belt": 0.04,
    "repeated belt": 0.32,
    "actuator": 0.28,
    "walking": 0.7,
    "walking recorded": 6.0,
}
"""Time of one core per trial, or per campaign of repeated and walking trials, with the settings of
config/config.yaml [s], as a job's log states for its number of them."""
USUAL_SECONDS = 0.3
"""Of an experiment that `SECONDS` does not have: a joint of second order in one of its recordings [s]."""
LIMIT_OVER_EXPECTED, STARTING_S = 3.0, 60.0
"""Time limit of a job over the expected time, and what it has beside it [s]."""


@dataclass(frozen=True)
class Batch:
    """What one job takes: trials (or campaigns) number `first` to `first + number - 1` of an experiment."""

    experiment: str
    first: int
    number: int

    @property
    def seconds(self) -> float:
        """The time of one core that is expected [s]."""
        return self.number * SECONDS.get(self.experiment, USUAL_SECONDS)


def batches(numbers: Mapping[str, tuple[int, int]]) -> list[Batch]:
    """The jobs of a study with so many trials of each experiment, and so many of them at least in one job.

    There are at most `MOST_JOBS` of them (or one for each experiment, if these are more): a job takes as many trials as
    are needed for that, all jobs about as long.
    """
    expected = sum(Batch(name, 0, number).seconds for name, (number, _) in numbers.items())
    longest = expected / max(MOST_JOBS - len(numbers), 1)
    found: list[Batch] = []
    for name, (number, least) in numbers.items():
        size = max(least, math.ceil(longest / Batch(name, 0, 1).seconds))
        found += [Batch(name, first, min(size, number - first)) for first in range(0, number, size)]
    return found


def time_limit(seconds: float) -> int:
    """The time limit of a job with this expected time [min]."""
    return math.ceil((STARTING_S + LIMIT_OVER_EXPECTED * seconds) / 60)


def planned(expected: Mapping[str, float]) -> str:
    """What a dry run says of the jobs that it would run, from the expected time of each by its name [s].

    Empty without any.
    """
    if not expected:
        return ""
    hours = sum(expected.values()) / 3600
    lines = [f"  {name}: {clock(seconds)}" for name, seconds in expected.items()]
    head = f"expected time of one core for {len(expected)} jobs of the study, {hours:.1f} h in all:"
    return "\n".join([head, *lines])


def clock(seconds: float) -> str:
    """A time in minutes, or in seconds if it is short."""
    return f"{seconds / 60:.0f} min" if seconds >= 90 else f"{seconds:.0f} s"
