# SPDX-License-Identifier: Apache-2.0
"""Describe a channel of a recording for a user, with the unit that its name implies."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Self

import numpy as np

from osl_analysis.base.measured import LARGEST_SIGNAL
from osl_analysis.base.trial import Array
from osl_analysis.base.units import (
    ALIASES,
    DATA,
    EXAMPLES,
    TICKS,
    TORQUE,
    in_si,
    normalised,
    torque_spelled,
)


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
    numbers: Array = field(kw_only=True, compare=False, repr=False)
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
    def spelled_unit(self) -> str:
        """The stated unit, or else the likely one."""
        return self.unit or self.likely_unit

    @property
    def base(self) -> tuple[float, str]:
        """Factor of the stated or likely unit to an SI unit, and this; 0 and empty if unknown."""
        return in_si(normalised(self.spelled_unit))


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
    remarks: Sequence[str]
    settings: Mapping[str, object]
    drafted: Sequence[RecordedChannel] = ()
    clock: RecordedChannel | None = None
    open: Sequence[str] = ()
    is_capture: bool = False


# ---- Units that names imply, such as `ankle_deg`

# what a name may end with; no `m`, since `theta_m` is the motor's
AT_END: dict[str, str] = {
    **{name: name for name in chain(ALIASES, *EXAMPLES.values()) if name.isalpha() and name != "m"},
    **DATA["endings"],
}
# as `SEC` and `mSec`: only a letter alone has a meaning by its case
IN_ANY_CASE = {spelling.lower(): unit for spelling, unit in AT_END.items() if len(spelling) > 1}
DIVISORS = ("s", "rad", "deg")  # that a name may spell behind its unit
# where a unit may begin: behind a sign, or at a capital in camel case
UNIT_BEGINS = re.compile(r"[\s_.,:/-]|(?<=[a-z0-9])(?=[A-Z])")


def name_and_ending(name: str) -> tuple[str, str]:
    """Part a column's name from the unit that its end spells.

    Parameters
    ----------
    name : str
        As `ankle_deg`, `torque_N_cm` and `MomentLbfFt`.

    Returns
    -------
    name, unit : str
        The unit is empty if the end spells none. A prefix is never apart from its unit:
        `torque_m_Nm` is the motor's.
    """
    if ending_spelled(name):  # `deg/s` is no name
        return name, ""
    for match in UNIT_BEGINS.finditer(name):
        start = match.end()
        unit = ending_spelled(name[start:])
        in_camel_case = name[start - 1].isalnum()
        is_one_letter = len(name) - start == 1
        if in_camel_case and (is_one_letter or ending_spelled(name[start - 1 :])):
            continue
        if unit:
            return name[:start], unit
    return name, ""


def ending_spelled(text: str) -> str:
    """A text as a unit; empty if it is none that a name may end with. In it `_s` and `_per_s` are
    `/s`."""
    if text in AT_END:
        return AT_END[text]
    unit, *divisors = re.split(r"[\s_./-]+(?:per[\s_]+)?", TORQUE.sub(torque_spelled, text))
    if not re.fullmatch(rf"[A-Za-z]+\*[A-Za-z]+|{TICKS.pattern}", unit):
        unit = one_unit_spelled(unit)
    if not unit or not divisors:
        return unit
    divisor = one_unit_spelled(" ".join(divisors))
    return f"{unit}/{divisor}" if divisor in DIVISORS else ""


def one_unit_spelled(text: str) -> str:
    """A text as a unit without a divisor; empty if it is none that a name may end with."""
    is_letter = len(text) == 1
    return AT_END.get(text, "") if is_letter else IN_ANY_CASE.get(text.lower(), "")


def likely_unit(name: str) -> str:
    """The unit that a column's name implies: by its ending (`ankle_deg`), or as a clock (`millis`);
    else empty."""
    ending = name_and_ending(name)[1]
    return ending or {"millis": "ms", "ms": "ms", "micros": "us", "us": "us"}.get(name, "")
