"""What a file of an unknown laboratory holds: for a person to read, and to draft a source file from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from osl_analysis.trial import Array

GAP = 1.5  # of the median step: what is longer is a gap


@dataclass(frozen=True)
class Channel:
    """One thing that the file recorded. `count` samples at `rate` [Hz]; `note` says what a reader should know.

    `address` is how a source file names it: `topic` and `field`, `column`, `channel`, `label` ...
    """

    kind: str
    address: Mapping[str, str]
    unit: str = ""
    count: int = 0
    rate: float | None = None
    note: str = ""


@dataclass(frozen=True)
class Overview:
    """A file: its format as source files call it, facts about the whole, channels, and damage or oddities.

    `settings` are fields of a source file that the format needs and the file tells, in the file's own order.
    """

    format: str
    facts: Mapping[str, str]
    channels: Sequence[Channel]
    remarks: Sequence[str] = ()
    settings: Mapping[str, object] = field(default_factory=dict)


def rate_of(time: Array) -> float | None:
    """Median rate [Hz] of stamps [s]; None where they tell none."""
    steps = np.diff(time)
    steps = steps[steps > 0]
    return float(1 / np.median(steps)) if steps.size else None


def gaps_of(time: Array) -> str:
    """Gaps, stamps that go back and stamps that stand twice, in words; empty where there are none."""
    steps = np.diff(np.sort(time))
    usual = float(np.median(steps)) if steps.size else 0.0
    wide = steps[steps > GAP * usual] if usual > 0 else steps[:0]
    found = []
    if wide.size:
        found.append(f"{wide.size} gaps, the longest {wide.max():.3f} s")
    for count, what in ((int((np.diff(time) < 0).sum()), "out of order"), (int((steps == 0).sum()), "twice")):
        if count:
            found.append(f"{count} stamps {what}")
    return ", ".join(found)
