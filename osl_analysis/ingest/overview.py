"""What a file holds, as inspect lists it; what names tell of clocks and units; what a draft leaves open."""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis.config.yaml_settings import dotted, field_line
from osl_analysis.errors import InputError, listing, printable
from osl_analysis.formats.csv_table import name_and_unit, places_of
from osl_analysis.trial import COLUMNS, Array

CLOCKS = (
    "time", "t", "timestamp", "stamp", "state_time", "loop_time", "pi_time", "sys_time", "ros_time", "elapsed",
    "elapsed_time", "clock", "seconds", "time_since_start",
)  # fmt: skip
"""How loggers call their time, without a unit behind it."""
ENDINGS = {
    "deg": "deg", "rad": "rad", "rev": "rev", "rpm": "rpm", "deg_s": "deg/s", "deg_per_s": "deg/s", "rad_s": "rad/s",
    "rad_per_s": "rad/s", "Nm": "Nm", "N": "N", "A": "A", "mA": "mA", "V": "V", "mV": "mV", "s": "s", "sec": "s",
    "ms": "ms", "us": "us", "ns": "ns", "Hz": "Hz", "mm": "mm",
}  # fmt: skip
"""Unit that a name may end with, as in `torque_Nm`. `_m` is none: `theta_m` is the motor's angle."""
ADDRESS = re.compile(r"<[^<>]* object at 0x[0-9a-fA-F]+>")
"""How Python prints an object without a name; the number changes from run to run."""


def likely_unit(name: str) -> str:
    """The unit that the end of a column's name tells, as `deg` in `ankle_deg`; empty if it tells none."""
    endings = sorted((end for end in ENDINGS if name.endswith(f"_{end}")), key=len)
    return ENDINGS[endings[-1]] if endings else ""


def is_clock(title: str) -> bool:
    """Whether a column is called like a clock: `time`, `t_s`, `loop_time [ms]`."""
    name = name_and_unit(title)[0].strip()
    plain = re.sub(r"_(s|sec|ms|us|ns)$", "", name)
    return name.casefold() in CLOCKS or plain.casefold() in CLOCKS


def clocks_among(paths: Sequence[str]) -> list[str]:
    """Those of several dotted paths whose last name is that of a clock, each once, the shortest way first."""
    shortest_first = sorted(dict.fromkeys(paths), key=lambda path: path.count("."))
    return [path for path in shortest_first if is_clock(path.rpartition(".")[2])]


def lasting_name(name: str, names: Sequence[str]) -> str:
    """A name for a source file that also fits the next recording of the same logger.

    A pattern in place of an object's address in memory, where only this column of the file fits it; else the name.
    """
    pattern = ADDRESS.sub("*", name)
    return pattern if pattern != name and len(places_of(pattern, names)) == 1 else name


GAP = 1.5  # of the median step: what is longer is a gap
USUAL_RATES = (50.0, 5000.0)
"""Rates of recorders of joints [Hz], less than a factor of 1000 apart: a reading fits them in one unit only."""
FEWEST_READINGS = 20  # readings of a clock from which its unit is guessed


@dataclass(frozen=True)
class RecordedChannel:
    """One thing that the file recorded."""

    kind: str
    """What it is: marker, model output, analog, plate, device, column, or the type of a topic's messages."""
    address: Mapping[str, str]
    """How a source file names it: `topic` and `field`, `column`, `channel`, `label` ..."""
    unit: str = ""  # unit of the numbers, as the file spells it; empty where it gives none
    count: int = 0
    rate: float | None = None  # median rate [Hz]; None where nothing tells it
    note: str = ""  # remark for the user
    type: str = ""  # type of the numbers and the length of the array that they stand in, such as `float64[4]`
    likely_unit: str = ""  # unit that the channel's name ends with; a guess, for the user to check
    load: float | None = None
    """Range of the force on a plate [N]; None for anything else, and where it cannot be computed."""
    centre: tuple[float, ...] = ()
    """Mean position of a marker, or of the corners of a plate, (3,) in the file's unit and axes; empty if unknown."""
    missing: float = 0.0  # share of the frames or rows in which nothing was recorded, 0 to 1


@dataclass(frozen=True)
class Overview:
    """What one file holds."""

    format: str  # the format's name in source files
    facts: Mapping[str, str]  # facts about the whole file
    channels: Sequence[RecordedChannel]  # what it recorded, in the order of the file
    remarks: Sequence[str] = ()  # damage and oddities, a sentence each
    settings: Mapping[str, object] = field(default_factory=dict)
    """Fields of a source file that the format needs and the file tells."""
    drafted: Sequence[RecordedChannel] | None = None
    """The channels of the draft, where it has others than `channels`: those of one trial of several."""
    open: Sequence[str] = ()
    """What the file leaves open, as which of its clocks counts, a sentence each: the draft has a guess, or nothing, and
    the user decides."""
    draft_note: str = ""  # A remark that the draft has as a comment


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


def range_text(known: Array, is_clock: bool) -> str:
    """The range of the finite numbers (n,) of a column, or the rate and gaps of a clock, in words."""
    if not is_clock:
        return f"from {known.min():.6g} to {known.max():.6g}" if known.size else "no numbers"
    rate, gaps = rate_of(known), gaps_text(known)
    return (f"a clock, {rate:g} per unit" if rate else "a clock that stands still") + (f", {gaps}" if gaps else "")


def guessed_units(channels: Sequence[RecordedChannel], key: str, own: Callable[[str], str] = str) -> list[str]:
    """A remark on the units that names tell; `key` is that of the address, `own` gives its part that is the name."""
    units = {one.address[key]: one.likely_unit for one in channels if one.likely_unit}
    guessed = [f"{name} [{unit}]" for name, unit in units.items() if likely_unit(own(name))]
    return [f"units guessed from the names, to be checked: {', '.join(guessed)}"] * bool(guessed)


LARGEST_DIFFERENCE = 0.005
"""Largest difference, as a share, of what two clocks of one recording span: it puts I wrong by twice as much."""
MOSTLY = 0.9  # smallest share of the steps of a clock that do not go back
MOST_NAMED = 6  # largest number of clocks that are named


def likely_clock(readings: Mapping[str, Array], what: str = "columns") -> tuple[str | None, list[str]]:
    """The clock that a draft names, and what the user has to decide, from the readings (n,) of all that are called so.

    The first of several, if they span the same time in s, ms, us or ns. None if they contradict each other, as then B
    and I depend on the choice. What does not run, as the duration of each loop, is no clock beside one that does.
    """
    spans = {name: span_of(values) for name, values in readings.items()}
    running = [name for name, span in spans.items() if span > 0] or list(readings)
    if len(running) < 2:
        return next(iter(running), None), []
    count, first = f"{len(running)} {what} may be the clock", running[0]
    if all(one_time(readings[name], readings[first]) for name in running):
        named, taken = (listing([printable(name) for name in some], MOST_NAMED) for some in (running, running[:1]))
        return first, [f"{count}, to be checked: {named}; {taken} is taken"]
    named = listing([f"{printable(name)} spans {spans[name]:.6g}" for name in running], MOST_NAMED)
    return None, [f"{count}, and they contradict each other: {named}; name the one by which the signals were sampled"]


def span_of(values: Array) -> float:
    """Last minus first of the readings (n,) of a clock, in its unit; 0 if they do not run."""
    known = values[np.isfinite(values)]
    runs = known.size > 1 and float(np.mean(np.diff(known) >= 0)) > MOSTLY
    return max(float(known[-1] - known[0]), 0.0) if runs else 0.0


def one_time(one: Array, other: Array) -> bool:
    """Whether two clocks span the same time, in units that are a power of 1000 apart, where both have readings."""
    if one.shape == other.shape:
        known = np.isfinite(one) & np.isfinite(other)
        one, other = one[known], other[known]
    spans = span_of(one), span_of(other)
    if min(spans) <= 0:
        return max(spans) <= 0
    ratio = spans[0] / spans[1]
    return abs(ratio / 1000.0 ** round(math.log10(ratio) / 3) - 1) <= LARGEST_DIFFERENCE


UNKNOWN = "UNKNOWN"  # stands where the file does not tell a value
NAME_OF_TIME = "NAME_OF_TIME"  # stands for the column of time where no column is called like a clock
UNNAMED = re.compile(r"NAME_\d+")  # stands for the canonical name of a channel
STATED = ("unit", "extra_cells", "counts")
"""Fields in which `UNKNOWN` is what a draft leaves open. Elsewhere it may be a name in the recording."""
LISTED = 6  # largest number of places in a message


def refuse_draft(path: Path, content: dict[str, Any]) -> None:
    """Refuse a source file in which places of a draft are not edited."""
    places = list(open_places(content))
    if places:
        named = listing([f"`{dotted(place)}` in line {field_line(path, place)}" for place in places], LISTED)
        raise InputError(
            f"{path}: a draft of `osl-analysis inspect` in which {len(places)} places are to be edited: {named}; give "
            f"each signal that you need its canonical name ({', '.join(c for c in COLUMNS if c != 'time')}), state "
            f"each {UNKNOWN}, and delete the other lines of `channels`"
        )


def open_places(content: Any, above: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The places of a draft that are not edited yet: channels without a name, and what is UNKNOWN."""
    for key, value in content.items() if isinstance(content, dict) else ():
        place = (*above, str(key))
        if UNNAMED.fullmatch(str(key)) or (value == UNKNOWN and key in STATED) or value == NAME_OF_TIME:
            yield place
        else:
            yield from open_places(value, place)
