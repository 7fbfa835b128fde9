"""A channel of a recording as a user is shown it, and what else a recording holds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from osl_analysis.measured import LARGEST_SIGNAL
from osl_analysis.trial import Array
from osl_analysis.units import base_units, normalised


def no_readings() -> Array:
    return np.empty(0)


@dataclass(frozen=True)
class RecordedChannel:
    """One channel as a user is shown it.

    Attributes
    ----------
    kind
        `marker`, `model output`, `analog`, `plate`, or how a source file names it: `column`,
        `field`, `variable`, `channel`.
    address
        How a source file names it: `topic` and `field`, `column`, `channel`, `label` ...
    unit
        As the file spells it; empty where it gives none.
    rate
        Median rate [Hz]; None where nothing tells it.
    likely_unit
        What its name or its readings tell of its unit; a guess, for the user to check.
    numbers
        Readings (n,), positions (n, 3), corners of a plate (4, 3) in the unit of the markers.
    times
        Of its readings (n,) [s]; None: those of the rows.
    name
        Without its place, as a table's column may tell a clock or a unit by it.
    group
        What it is a part of: a topic, a struct.
    is_stamp
        Whether its readings are times of day, which the file has as such.
    """

    kind: str
    address: Mapping[str, str]
    unit: str = ""
    count: int = 0
    rate: float | None = None
    note: str = ""
    likely_unit: str = ""
    numbers: Array = field(default_factory=no_readings, compare=False, repr=False)
    times: Array | None = field(default=None, compare=False, repr=False)
    name: str = ""
    group: str = ""
    is_stamp: bool = False

    @property
    def key(self) -> str:
        """What a source file calls it."""
        return next(iter(self.address.values()))

    def at(self, key: str) -> Self:
        """The channel under another key."""
        return replace(self, address={next(iter(self.address)): key})

    @property
    def readings(self) -> Array:
        """The readings (n,) that are numbers of a sensor, in the channel's unit."""
        return self.numbers[np.abs(self.numbers) < LARGEST_SIGNAL]

    @property
    def base(self) -> tuple[float, str]:
        """Factor of the stated or likely unit to base units, and these; 0 and empty if unknown."""
        return base_units(normalised(self.unit or self.likely_unit)) or (0.0, "")


@dataclass(frozen=True)
class Overview:
    """What a recording holds.

    Attributes
    ----------
    format
        The format's name in source files.
    facts
        About the whole file.
    channels
        What it recorded, in the order of the file.
    remarks
        Damage and oddities, a sentence each.
    settings
        Fields of a source file that the file tells.
    drafted
        The channels of the draft of a log, which is of one trial of several.
    clock
        The channel that tells their time, if one does.
    open
        What the user decides, as which of its clocks counts, a sentence each.
    is_capture
        Whether it comes from a motion-capture laboratory.
    """

    format: str
    facts: Mapping[str, str]
    channels: Sequence[RecordedChannel]
    remarks: Sequence[str] = ()
    settings: Mapping[str, object] = field(default_factory=dict)
    drafted: Sequence[RecordedChannel] = ()
    clock: RecordedChannel | None = None
    open: Sequence[str] = ()
    is_capture: bool = False
