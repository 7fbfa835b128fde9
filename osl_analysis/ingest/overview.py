"""Content of a file of an unknown laboratory, for the user and for the draft of a source file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from osl_analysis.trial import Array

GAP = 1.5  # of the median step: what is longer is a gap
USUAL_RATES = (50.0, 5000.0)
"""Rates of recorders of joints [Hz], less than a factor of 1000 apart: a reading fits them in one unit only."""
FEWEST_READINGS = 20
"""Readings of a clock from which its unit is guessed."""


@dataclass(frozen=True)
class RecordedChannel:
    """One thing that the file recorded."""

    kind: str
    """What it is: marker, model output, analog, plate, device, column, or the type of a topic's messages."""
    address: Mapping[str, str]
    """How a source file names it: `topic` and `field`, `column`, `channel`, `label` ..."""
    unit: str = ""
    """Unit of the numbers, as the file spells it; empty where it gives none."""
    count: int = 0
    """Number of samples."""
    rate: float | None = None
    """Median rate [Hz]; None where nothing tells it."""
    note: str = ""
    """Remark for the user."""
    type: str = ""
    """Type of the numbers and the length of the array that they stand in, such as `float64[4]`."""
    likely_unit: str = ""
    """Unit that the channel's name ends with; a guess, for the user to check."""
    load: float | None = None
    """Range of the force on a plate [N]; None for anything else, and where it cannot be computed."""
    centre: tuple[float, ...] = ()
    """Mean position of a marker, or of the corners of a plate, (3,) in the file's unit and axes; empty if unknown."""
    missing: float = 0.0
    """Share of the frames or rows in which nothing was recorded, 0 to 1."""


@dataclass(frozen=True)
class Overview:
    """What one file holds."""

    format: str
    """The format's name in source files."""
    facts: Mapping[str, str]
    """Facts about the whole file."""
    channels: Sequence[RecordedChannel]
    """What it recorded, in the order of the file."""
    remarks: Sequence[str] = ()
    """Damage and oddities, a sentence each."""
    settings: Mapping[str, object] = field(default_factory=dict)
    """Fields of a source file that the format needs and the file tells."""
    drafted: Sequence[RecordedChannel] | None = None
    """The channels of the draft, where it has others than `channels`: those of one trial of several."""
    open: Sequence[str] = ()
    """What the file leaves open, as which of its clocks counts, a sentence each: the draft has a guess, or nothing, and
    the user decides."""
    draft_note: str = ""
    """A remark that the draft has as a comment."""


def rate_of(time: Array) -> float | None:
    """Median rate [Hz] of stamps [s]; None where they tell none."""
    steps = np.diff(time)
    steps = steps[steps > 0]
    return float(1 / np.median(steps)) if steps.size else None


def unit_of_clock(time: Array) -> str:
    """The unit in which readings of a clock come at a usual rate: a guess; empty where none does, or they may count."""
    per_unit = rate_of(time)
    if per_unit is None or time.size < FEWEST_READINGS or bool((np.diff(time) == 1).all()):
        return ""
    lowest, highest = USUAL_RATES
    units = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
    return next((unit for unit, in_second in units.items() if lowest <= per_unit * in_second <= highest), "")


def gaps_text(time: Array) -> str:
    """Gaps, stamps that go back and repeated stamps, in words; empty if there are none."""
    steps = np.diff(np.sort(time))
    usual = float(np.median(steps)) if steps.size else 0.0
    wide = steps[steps > GAP * usual] if usual > 0 else steps[:0]
    oddities = []
    if wide.size:
        oddities.append(f"{wide.size} gaps, the longest {wide.max():.3f} s")
    for count, what in ((int((np.diff(time) < 0).sum()), "out of order"), (int((steps == 0).sum()), "twice")):
        if count:
            oddities.append(f"{count} stamps {what}")
    return ", ".join(oddities)
