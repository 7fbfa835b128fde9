"""What a file holds, as inspect lists it: channels with ranges, rates and gaps, what is damaged or odd, and what names
tell of clocks and units for a draft."""

import json
import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.errors import InputError, listing, printable
from osl_analysis.formats.c3d import C3DRecording, CountsError, read_c3d
from osl_analysis.formats.csv_table import (
    DELIMITERS,
    Rows,
    check_header_place,
    delimiter_of,
    is_number_cell,
    name_and_unit,
    places_of,
    read_lines,
    split_rows,
    unpadded,
    without_brackets,
)
from osl_analysis.formats.gait_text import read_opensim, read_sections, read_trc
from osl_analysis.formats.json_lines import MOST_ELEMENTS, addresses_of, decode_lines, read_json_lines
from osl_analysis.formats.mat import Value, open_mat
from osl_analysis.formats.message_fields import FieldDescription, describe_message, last_name
from osl_analysis.formats.messages import ChannelSurvey, survey_channels
from osl_analysis.formats.tdms import read_tdms
from osl_analysis.ingest.captures import analog_rates, plate_count, plate_loads, plate_parameter, vertical_axis
from osl_analysis.ingest.message_log import FILES, SECOND, check_not_set
from osl_analysis.ingest.source import KEYS, NAME_OF_TIME, UNKNOWN, model_of
from osl_analysis.ingest.table_log import notes_on, stamp_column, stamps_among
from osl_analysis.ingest.units import is_unit
from osl_analysis.trial import Array


@dataclass(frozen=True)
class RecordedChannel:
    """One thing that the file recorded."""

    kind: str  # What it is: marker, model output, analog, plate, device, column, or the type of a topic's messages.
    address: Mapping[str, str]  # How a source file names it: `topic` and `field`, `column`, `channel`, `label` ...
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


UNIT_ENDINGS = {
    "deg": "deg", "rad": "rad", "rev": "rev", "rpm": "rpm", "deg_s": "deg/s", "deg_per_s": "deg/s", "rad_s": "rad/s",
    "rad_per_s": "rad/s", "Nm": "Nm", "N": "N", "A": "A", "mA": "mA", "V": "V", "mV": "mV", "s": "s", "sec": "s",
    "ms": "ms", "us": "us", "ns": "ns", "Hz": "Hz", "mm": "mm",
}  # fmt: skip
"""Unit that a name may end with, as in `torque_Nm`. `_m` is none: `theta_m` is the motor's angle."""


def likely_unit(name: str) -> str:
    """The unit that the end of a column's name tells, as `deg` in `ankle_deg`; empty if it tells none."""
    endings = [end for end in UNIT_ENDINGS if name.endswith(f"_{end}")]
    return UNIT_ENDINGS[max(endings, key=len)] if endings else ""


def guessed_units(channels: Sequence[RecordedChannel], key: str, own: Callable[[str], str] = str) -> list[str]:
    """A remark on the units that names tell; `key` is that of the address, `own` gives its part that is the name."""
    units = {one.address[key]: one.likely_unit for one in channels if one.likely_unit}
    return guesses([f"{name} [{unit}]" for name, unit in units.items() if likely_unit(own(name))])


def guesses(names: Sequence[str]) -> list[str]:
    return [f"units guessed from the names, to be checked: {', '.join(names)}"] * bool(names)


HOW_CLOCKS_ARE_CALLED = (
    "time", "t", "timestamp", "stamp", "state_time", "loop_time", "pi_time", "sys_time", "ros_time", "elapsed",
    "elapsed_time", "clock", "seconds", "time_since_start",
)  # fmt: skip
"""Without a unit behind it."""
USUAL_RATES = (50.0, 5000.0)
"""Rates of recorders of joints [Hz], less than a factor of 1000 apart: a reading fits them in one unit only."""
FEWEST_READINGS = 20  # readings of a clock from which its unit is guessed
LARGEST_DIFFERENCE = 0.005
"""Largest difference, as a share, of what two clocks of one recording span: it puts I wrong by twice as much."""
RUNS_ON = 0.9  # smallest share of the steps of a clock that do not go back
MOST_CLOCKS = 6  # largest number of clocks that are named


def is_clock(title: str) -> bool:
    """Whether a column is called like a clock: `time`, `t_s`, `loop_time [ms]`."""
    name = name_and_unit(title)[0].strip()
    plain = re.sub(r"_(s|sec|ms|us|ns)$", "", name)
    return name.casefold() in HOW_CLOCKS_ARE_CALLED or plain.casefold() in HOW_CLOCKS_ARE_CALLED


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
        named, taken = (listing([printable(name) for name in some], MOST_CLOCKS) for some in (running, running[:1]))
        return first, [f"{count}, to be checked: {named}; {taken} is taken"]
    named = listing([f"{printable(name)} spans {spans[name]:.6g}" for name in running], MOST_CLOCKS)
    return None, [f"{count}, and they contradict each other: {named}; name the one by which the signals were sampled"]


def span_of(values: Array) -> float:
    """Last minus first of the readings (n,) of a clock, in its unit; 0 if they do not run."""
    known = values[np.isfinite(values)]
    runs = known.size > 1 and float(np.mean(np.diff(known) >= 0)) > RUNS_ON
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


def rate_of(time: Array) -> float | None:
    """Median rate [Hz] of stamps [s]; None where they tell none."""
    steps = np.diff(time)
    steps = steps[steps > 0]
    return float(1 / np.median(steps)) if steps.size else None


def gaps_text(time: Array) -> str:
    """Gaps, steps of more than 1.5 usual ones, stamps that go back and repeated ones, in words; empty if none."""
    steps = np.diff(np.sort(time))
    usual = float(np.median(steps)) if steps.size else 0.0
    wide = steps[steps > 1.5 * usual] if usual > 0 else steps[:0]
    oddities = [f"{wide.size} gaps, the longest {wide.max():.3f} s"] if wide.size else []
    counts = {"out of order": int((np.diff(time) < 0).sum()), "twice": int((steps == 0).sum())}
    return ", ".join([*oddities, *(f"{count} stamps {what}" for what, count in counts.items() if count)])


def listed(
    key: str,
    name: str,
    values: NDArray[Any],
    is_time: bool = False,
    unit: str = "",
    own: str = "",
    also: str = "",
    kind: str = "",
) -> RecordedChannel:
    """A channel of a table with the range of its finite numbers, or as a clock with rate and gaps; `own` is the part of
    its address that is its name, `also` a remark."""
    numbers = values.astype(np.float64)
    known = numbers[np.isfinite(numbers)]
    note = f"from {known.min():.6g} to {known.max():.6g}" if known.size else "no numbers"
    if is_time:
        rate, gaps = rate_of(known), gaps_text(known)
        note = f"a clock, {rate:g} per unit" if rate else "a clock that stands still"
        note += f", {gaps}" * bool(gaps)
    lost = f", {numbers.size - known.size} x NaN or infinity" * (known.size < numbers.size)
    guess = "" if unit else likely_unit(own or name)
    per_unit = rate_of(known) if is_time and not unit and not guess and known.size >= FEWEST_READINGS else None
    if per_unit is not None and not (np.diff(known) == 1).all():  # such readings may count rows
        units = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
        usual = [unit for unit, in_s in units.items() if USUAL_RATES[0] <= per_unit * in_s <= USUAL_RATES[1]]
        guess = usual[0] if usual else ""
    return RecordedChannel(key, {key: name}, unit, int(known.size), None, f"{note}{lost}{also}", kind, guess)


def time_setting(key: str, clock: RecordedChannel | None) -> dict[str, str]:
    """The field `time` of a source file, by the clock that the draft names."""
    if clock is None:
        return {key: NAME_OF_TIME, "unit": UNKNOWN}
    return {key: clock.address[key], "unit": clock.unit or clock.likely_unit or UNKNOWN}


MOST_WORDS, MOST_COMMENTS = 5, 20  # words of a column and comment lines that are listed
OBJECT = re.compile(r"<[^<>]* object at 0x[0-9a-fA-F]+>")
"""How Python prints an object without a name; the number changes from run to run."""


def guessed_csv(rows: Rows) -> tuple[list[str], list[str], Rows, bool]:
    """Titles of the columns (their numbers, counted from 1, without a header), units in a row below (or none), rows,
    and whether there is a header; refused is text that is no table: more than half of its rows hold no number."""
    if not rows:
        raise InputError("holds no rows; check that it is a recording")
    headed = not all(seems_number(cell) for cell in rows[0][1] if cell)
    first = unpadded(rows[0][1], 0)
    titles = first if headed else [str(place + 1) for place in range(len(first))]
    body = [(line, unpadded(cells, len(titles))) for line, cells in (rows[1:] if headed else rows)]
    if headed:
        check_header_place(rows[0], body)
    below = body[0][1] if headed and body else []
    known = [bool(cell) and is_unit(without_brackets(cell)) and cell != "1" for cell in below]
    has_units = not any(map(seems_number, below)) and sum(known) > len(below) / 2
    below, body = (below, body[1:]) if has_units else ([], body)
    if not body:
        raise InputError("no rows of data below the header; check that it is a recording")
    prose = [row for row in body if not any(map(seems_number, row[1]))]
    if len(prose) > len(body) / 2:
        raise InputError(
            f"no table of numbers: {len(prose)} of {len(body)} rows hold none, such as line {prose[0][0]}, "
            f"'{' '.join(prose[0][1])[:40]}'; name a recording, or write a header and a row per sample"
        )
    return titles, below, body, headed


def seems_number(cell: str) -> bool:
    return is_number_cell(cell.replace(",", "."))


def inspect_csv(path: Path) -> Overview:
    lines = read_lines(path)
    comments = [text for _, text in lines if text.lstrip().startswith("#")]
    content = [(line, text) for line, text in lines if not text.lstrip().startswith("#")]
    delimiter = delimiter_of(content, "auto")
    titles, units, body, has_header = guessed_csv(split_rows(content, delimiter))
    columns = [[row[k] if k < len(row) else "" for _, row in body] for k in range(len(titles))]
    cells = [pl.Series(column, dtype=pl.String) for column in columns]
    values = [one.str.replace(",", ".", literal=True).cast(pl.Float64, strict=False) for one in cells]
    clock, left_open = likely_clock({t: v.to_numpy() for t, v in zip(titles, values, strict=True) if is_clock(t)})
    channels = []
    for place, title in enumerate(titles):
        (name, unit), numbers = name_and_unit(title), values[place].drop_nulls().to_numpy()
        unit = unit or (without_brackets(units[place]) if place < len(units) else "")
        words = Counter(cells[place].filter(values[place].is_null()).to_list()).most_common(MOST_WORDS)
        also = "".join(f", {count} x '{word}'" for word, count in words)
        pattern = OBJECT.sub("*", name)  # fits the next recording too, where only this column of the file fits it
        lasting = pattern if pattern != name and len(places_of(pattern, titles)) == 1 else name
        channels.append(listed("column", lasting, numbers, title == clock, unit, name, also))
    remarks = []
    for length, count in Counter(len(row) for _, row in body).items():
        if length != len(titles):
            line = next(line for line, row in body if len(row) == length)
            remarks.append(f"{count} rows have {length} cells under {len(titles)} names, the first in line {line}")
    decimal_comma = delimiter != "," and any("," in cell for _, row in body[:5] for cell in row)
    longer = all(len(row) == len(body[0][1]) > len(titles) for _, row in body)
    settings = {
        "clock": "master",
        "delimiter": {sign: word for word, sign in DELIMITERS.items()}.get(delimiter, delimiter),
        **({} if has_header else {"header": "none"}),
        **({"units_row": True} if units else {}),
        **({"decimal": ","} if decimal_comma else {}),
        **({"extra_cells": UNKNOWN} if longer else {}),
        "time": time_setting("column", None if clock is None else channels[titles.index(clock)]),
    }
    facts = {"rows": str(len(body)), "delimiter": repr(delimiter), "header": "yes" if has_header else "none"}
    facts |= {f"comment {i + 1}": text.strip() for i, text in enumerate(comments[:MOST_COMMENTS])}
    return Overview("csv", facts, channels, [*remarks, *guessed_units(channels, "column")], settings, open=left_open)


MOST_ALONE = 100  # largest number of fields that are read one by one to be listed


def inspect_json(path: Path) -> Overview:
    """Every number in the lines, with its range, and the likely clock."""
    lines = read_json_lines(path)
    names, long = addresses_of(lines)
    if not names:
        raise InputError("no line holds a number; name a recording")
    decoded = dict.fromkeys(names, decode_lines(lines, names))
    if decoded[names[0]].misfits and len(names) <= MOST_ALONE:  # a line has something else than a number in one of them
        decoded = {name: decode_lines(lines, [name]) for name in names}
    values = {name: one.values[name][one.present[name]] for name, one in decoded.items()}
    stamp, parts = next(iter(stamps_among(names).items()), ("", ("", "")))
    shortest_first = sorted((name for name in names if name not in parts), key=lambda name: name.count("."))
    called = [name for name in shortest_first if is_clock(last_name(name))]
    clock, left_open = likely_clock({name: values[name].astype(np.float64) for name in called}, "fields")
    channels = {}
    for name, numbers in values.items():
        all_lines = decoded[name].present[name].size
        also = f", in {numbers.size} of {all_lines} lines" * (numbers.size < all_lines)
        own, kind = last_name(name), numbers.dtype.name
        channels[name] = listed("field", name, numbers, name == clock, own=own, also=also, kind=kind)
    remarks = list(dict.fromkeys(note for one in decoded.values() for note in notes_on(lines, one)))
    remarks += [f"{name} has {size} elements; only the first {MOST_ELEMENTS} are listed" for name, size in long.items()]
    remarks += guessed_units(list(channels.values()), "field", last_name)
    time = time_setting("field", channels[clock] if clock else None)
    if stamp and not called:
        time = {"field": stamp}
        try:
            column = stamp_column(lines, decode_lines(lines, parts), parts)
            there = np.ma.getdata(column)[~np.ma.getmaskarray(column)]
            seconds = (there - there[:1].sum()) / SECOND
            notes = ["a stamp of seconds and nanoseconds", gaps_text(seconds)]
            notes += [f"in {seconds.size} of {column.size} lines"] * bool(seconds.size < column.size)
            note, rate = ", ".join(filter(None, notes)), rate_of(seconds)
            whole = RecordedChannel("field", {"field": stamp}, "", seconds.size, rate, note, "int64")
            channels = {stamp: whole, **{name: one for name, one in channels.items() if name not in parts}}
        except InputError as error:
            remarks.append(str(error))
    facts, settings = {"rows": str(len(lines.texts))}, {"clock": "master", "time": time}
    return Overview("json_lines", facts, list(channels.values()), remarks, settings, open=left_open)


MOST_VARIABLES = 500  # largest number of variables that are listed
MOST_PARTS = 40  # largest number of parts that are named
SHORTEST_SIGNAL = 10  # numbers in the shortest vector that may be a signal
LIKE_A_CLOCK = re.compile(r"(time|t|stamp|clock)(?![a-z])|time", re.IGNORECASE)
"""How the name of a variable of time begins: `t`, `time_ms`, `timeJIM`."""


@dataclass(frozen=True)
class Variable:
    """One variable or field that is no struct and no cell."""

    part: str  # address of what it is in; empty for the file itself
    name: str  # its own name, or the choice of a cell
    value: Value

    @property
    def address(self) -> str:
        joint = "." if self.part and not self.name.startswith("{") else ""
        return f"{self.part}{joint}{self.name}"

    @property
    def readings(self) -> NDArray[Any]:
        """Its numbers, (n,); none if it has none."""
        return np.empty(0) if self.value.numbers is None else self.value.numbers.ravel()

    @property
    def is_signal(self) -> bool:
        """Whether it may be a signal: a vector of real numbers, or a matrix of columns."""
        return (
            self.value.numbers is not None and len(self.value.shape) == 2 and max(self.value.shape) >= SHORTEST_SIGNAL
        )

    @property
    def seems_clock(self) -> bool:
        return self.is_signal and (is_clock(self.name) or LIKE_A_CLOCK.match(self.name) is not None)

    def listed(self, name: str) -> RecordedChannel:
        """It under a name, for the list or the draft."""
        kind, text = self.value.described(), self.value.text
        found = listed("variable", name, self.readings, self.seems_clock, own=self.name, kind=kind)
        return replace(
            found, count=self.value.size, note=found.note if self.readings.size else f"'{text}'" * bool(text)
        )


def inspect_mat(path: Path) -> Overview:
    """Variables, fields and cells with size, range and likely unit; what cannot be read; parts that are alike."""
    file = open_mat(path)
    variables = [one for name, value in file.read(file.names).items() for one in variables_in("", name, value)]
    facts = {"version": file.version, "header": file.header, "variables": str(len(file.names))}
    remarks = [
        f"{one.address} is a {one.value.described()}, which is not read; {one.value.remedy()}"
        for one in variables
        if one.value.numbers is None and one.value.kind not in ("char", "struct", "cell")
    ]
    if len(variables) > MOST_VARIABLES:
        remarks.append(f"and {len(variables) - MOST_VARIABLES} more variables")
    alike = parts_alike(variables)
    drafted, part = next(iter(alike.values()), []), next(iter(alike), "") if len(alike) == 1 else ""
    clocks = {one.name: one for one in drafted if one.seems_clock and 1 in one.value.shape}
    clock, left_open = likely_clock({name: one.readings for name, one in clocks.items()}, "variables")
    if len(alike) > 1:
        parts = listing([printable(one) for one in alike], MOST_PARTS)
        what = f"{len(alike)} parts hold the same variables: name one per trial in the column `log_part` of the sheet"
        left_open = [f"{what}: {parts}", *left_open]
    time = time_setting("variable", clocks[clock].listed(clock) if clock else None)
    settings = {"clock": "master", **({"log_part": part} if part else {}), "time": time}
    channels, signals = [one.listed(one.address) for one in variables[:MOST_VARIABLES]], []
    for one in drafted:  # each column of a matrix, or row if it has more columns
        rows, columns = one.value.shape
        lines = [f"(:,{k + 1})" for k in range(columns)] if rows >= columns else [f"({k + 1},:)" for k in range(rows)]
        signals += [one.listed(f"{one.name}{line}") for line in (lines if min(rows, columns) > 1 else [""])]
    return Overview("mat", facts, channels, remarks, settings, signals, left_open)


def variables_in(part: str, name: str, value: Value) -> Iterator[Variable]:
    here = Variable(part, name, value)
    if value.kind == "struct" and value.elements:
        several = len(value.elements) > 1
        for number, fields in enumerate(value.elements, start=1):
            inside = f"{here.address}({number})" if several else here.address
            for own in value.fields:
                yield from variables_in(inside, own, fields[own])
    elif value.kind == "cell" and value.cells:
        for number, cell in enumerate(value.cells, start=1):
            yield from variables_in(here.address, f"{{{number}}}", cell)
    else:
        yield here


def parts_alike(variables: Sequence[Variable]) -> Mapping[str, list[Variable]]:
    """The signals of the parts of the file that hold the same signals, by part: of the largest such group."""
    by_part: dict[str, list[Variable]] = {}
    for one in variables:
        if one.is_signal:
            by_part.setdefault(one.part, []).append(one)
    groups: dict[tuple[str, ...], dict[str, list[Variable]]] = {}
    for part, own in by_part.items():
        groups.setdefault(tuple(one.name for one in own), {})[part] = own
    return max(groups.values(), key=lambda group: sum(map(len, group.values())), default={})


def inspect_tdms(path: Path) -> Overview:
    """Channels with unit, range and rate by their own timing."""
    file = read_tdms(path)
    remarks, numbers = list(file.notes), dict[str, NDArray[Any]]()
    readable = [one for one in file.channels if one.count and (one.holds_numbers or one.holds_times)]
    try:
        numbers = file.values(readable)
    except InputError:
        for one in readable:
            try:
                numbers |= file.values([one])
            except InputError as error:
                remarks.append(str(error))
    stamps = [one.address for one in file.channels if one.holds_times and one.count]
    timed = any(one.step is not None for one in file.channels)
    paths = {one.address.replace(".", "_").replace("/", "."): one.address for one in file.channels}
    shortest_first = sorted(paths, key=lambda path: path.count("."))
    called = [paths[p] for p in shortest_first if is_clock(p.rpartition(".")[2]) and paths[p] in numbers]
    clock, left_open = likely_clock({name: numbers[name].astype(np.float64) for name in called}, "channels")
    clock = None if timed else clock or (None if left_open else next(iter(stamps), None))
    channels = {}
    for one in file.channels:
        values, kind = numbers.get(one.address, np.empty(0)), np.dtype(one.kind).name
        unit = "s" if one.address in stamps else one.unit
        found = listed("channel", one.address, values, one.address == clock, unit, one.name, kind=kind)
        channels[one.address] = replace(found, count=one.count, rate=1 / one.step if one.step else None)
    time = {} if timed else {"time": time_setting("channel", channels[clock] if clock else None)}
    facts = {"channels": str(len(file.channels)), "own timing": "yes" if timed else "no", **file.properties}
    drafted = [channels[one.address] for one in file.channels if one.count and one.holds_numbers]
    settings, left_open = {"clock": "master", **time}, [] if timed else left_open
    return Overview("tdms", facts, list(channels.values()), remarks, settings, drafted, left_open)


OPENSIM_UNITS = {
    r"force.*_v[xyz]": "N",
    r"force.*_p[xyz]": "m",
    r"(torque|moment).*_[xyz]|_moment": "N*m",
    r"_t[xyz]": "m",
}
"""Unit that OpenSim gives to columns whose names end so."""


def inspect_opensim(path: Path) -> Overview:
    """Columns with range and likely unit."""
    table = read_opensim(path)
    remarks: list[str] = []
    shortest_first = sorted(dict.fromkeys(table.names), key=lambda name: name.count("."))
    called = [name for name in shortest_first if is_clock(name.rpartition(".")[2])]
    clock, left_open = likely_clock({name: table.column(name) for name in called})
    channels = {}
    for name in dict.fromkeys(table.names):
        try:
            found = listed("column", name, table.column(name), name == clock)
        except InputError as error:
            remarks.append(str(error))
            continue
        known = [unit for pattern, unit in OPENSIM_UNITS.items() if re.search(f"({pattern})$", name, re.IGNORECASE)]
        guess = likely_unit(name) or (known[0] if known else table.angles)  # of a coordinate by `inDegrees`
        channels[name] = replace(found, likely_unit="" if name == clock else guess)
    remarks += guesses([f"{name} [{one.likely_unit}]" for name, one in channels.items() if one.likely_unit])
    facts = {"rows": str(len(table.rows))} | {key: value for key, value in table.header.items() if value}
    settings = {"clock": "master", "time": {"column": clock or NAME_OF_TIME, "unit": "s" if clock else UNKNOWN}}
    note = plates_text(table.names)
    return Overview("opensim", facts, list(channels.values()), remarks, settings, open=left_open, draft_note=note)


def plates_text(names: Sequence[str]) -> str:
    """The plates that names of columns tell, as a source file has them but for their corners; empty if none."""
    triples = {name[:-1] for name in names if name[-1:] == "x" and {f"{name[:-1]}y", f"{name[:-1]}z"} <= {*names}}
    plates: list[str] = []
    for name in names:
        force, stem = name[:-1], name[:-2]  # `R_ground_force_v`; of `R_ground_force_` is the moment `R_ground_torque_`
        if name.endswith("vx") and {force, f"{stem}p"} <= triples:
            moments = [re.sub("force", word, stem) for word in ("torque", "moment")]
            moment = next((one for one in moments if one != stem and one in triples), None)
            if moment is not None:
                keys = {"force": force, "point": f"{stem}p", "moment": moment}
                text = ", ".join(f"{key}: {json.dumps(begin)}" for key, begin in keys.items())
                plates.append(f"{len(plates) + 1}: {{{text}, corners: {UNKNOWN}}}")
    text = f"these columns are force plates, if you state their corners: plates: {{{', '.join(plates)}}}"
    return printable(text) if plates else ""


MOST_FIELDS_LISTED = 500  # of one topic
ROS_UNITS = {
    "sensor_msgs/JointState": {"position": "rad", "velocity": "rad/s", "effort": "N*m"},
    "geometry_msgs/Wrench": {"force": "N", "torque": "N*m"},
    "geometry_msgs/WrenchStamped": {"wrench.force": "N", "wrench.torque": "N*m"},
}
"""Units of standard messages of ROS (REP 103), by the beginning of the field. A joint that slides has other ones."""


def inspect_messages(name: str, path: Path) -> Overview:
    """Topics with schema, encoding, rate and gaps by log time, every field of each, and what is damaged."""
    file = FILES[name](path)
    surveys = survey_channels(file)
    remarks = list(file.damage.all_remarks())
    for survey in surveys:
        table = pl.DataFrame({"stamp": survey.log_time, "message": np.arange(survey.log_time.size)})
        try:  # what ingest will say of a channel's log times, if they go back
            check_not_set(survey.channel.topic, table, "its log times cannot be used")
        except InputError as error:
            remarks.append(str(error))
    described = [(survey, fields_of(survey, remarks)) for survey in surveys]
    channels = [channel for survey, fields in described for channel in channels_of(survey, fields)]
    stamped = any(field.path.startswith("header.stamp") for _, fields in described for field in fields)
    settings = {"clock": "master", "time": {"source": "header" if stamped else "log"}}
    damage, lost = file.damage, file.damage.messages_lost()
    facts = {
        "bytes": str(file.size),
        "chunks": str(damage.chunks),
        "messages": str(damage.messages),
        "messages lost": "the file does not tell" if lost is None else str(lost),
        "checksums": damage.crc(),
    }
    return Overview(name, facts, channels, remarks, settings)


def fields_of(survey: ChannelSurvey, remarks: list[str]) -> list[FieldDescription]:
    """The fields of a channel's first message, or else of its schema; what cannot be described is remarked."""
    reason = ""
    for message in dict.fromkeys([survey.first, None]):
        try:
            fields = describe_message(survey.channel, survey.schema, message)
            if fields or not reason:  # JSON has no schema to tell what a message does not
                return fields
        except (ValueError, RecursionError) as error:
            reason = reason or " ".join(str(error).split())
    remarks.append(f"topic '{survey.channel.topic}': its fields cannot be listed: {reason}")
    return []


def channels_of(survey: ChannelSurvey, fields: list[FieldDescription]) -> Iterator[RecordedChannel]:
    """A topic's numbers, one by one as a source file names them; the topic alone where there are none."""
    topic, kind, units = survey.channel.topic, survey.channel.message_encoding, dict[str, str]()
    if survey.schema:
        kind, units = f"{survey.schema.name} ({kind})", ROS_UNITS.get(survey.schema.name.replace("/msg/", "/"), {})
    count, stamps = survey.log_time.size, (survey.log_time - survey.log_time[:1].sum()) / SECOND
    rate, timing = rate_of(stamps), gaps_text(stamps) or "empty" * (not count)
    # every message of ROS has a header, and no signal is in it
    numbers = [(path, one) for one in fields if not one.path.startswith("header.") for path in one.addresses()]
    for path, one in numbers[:MOST_FIELDS_LISTED]:
        unit = next((unit for begin, unit in units.items() if path.startswith(begin)), "")
        samples = 0 if one.length == 0 else count
        type_ = one.type if one.length is None else f"{one.type}[{one.length}]"
        address = {"topic": topic, "field": path}
        yield RecordedChannel(kind, address, "", samples, rate if samples else None, timing, type_, unit)
    if len(numbers) > MOST_FIELDS_LISTED or not numbers:
        more = f"and {len(numbers) - MOST_FIELDS_LISTED} more numbers" if numbers else ""
        yield RecordedChannel(kind, {"topic": topic}, "", count, rate, timing, more)


def inspect_c3d(path: Path) -> Overview:
    """Markers with the share of frames in which they were seen, model outputs, analog channels and plates.

    Where header and parameters contradict each other, the file is read by the counts that fit its size.
    """
    settings, remarks = dict[str, object](), list[str]()
    try:
        recording = read_c3d(path)
    except CountsError as error:
        if not error.fitting:
            raise
        recording = read_c3d(path, error.fitting[0])
        settings, remarks = {"counts": UNKNOWN}, [f"read here with the counts of the {error.fitting[0]}: {error}"]
    header, outputs, unit = recording.header, recording.model_outputs, recording.point_unit()
    channels = [
        marker_channel(label, positions, "" if label in outputs else unit, header.rate, label in outputs)
        for label, positions in zip(recording.point_labels, recording.points.transpose(1, 0, 2), strict=False)
    ]
    for place, label in enumerate(recording.analog_labels):
        values, rate = recording.analogs[:, place], header.rate * header.samples_per_frame
        low, high = values.min(), values.max()
        note = f"from {low:.6g} to {high:.6g}" if low != high else f"always {low:.6g}"
        own = recording.analog_unit(place)
        channels.append(RecordedChannel("analog", {"channel": label}, own, values.size, rate, note))
    plates = plate_count(recording)
    channels += [plate_channel(recording, number) for number in range(1, plates + 1)]
    facts = {
        "processor": header.processor,
        "frames": f"{header.frames}, from {header.first_frame} on, at {header.rate:g} Hz",
        "unit of length": unit or "none",
        "force plates": str(plates),
        "vertical on screen": "".join(header.texts("POINT:Y_SCREEN")[:1]) or "not said",
        "software": " ".join(header.texts("MANUFACTURER:SOFTWARE")) or "not said",
    }
    settings["plates"] = "all" if plates else "none"
    points, analogs = recording.point_labels, recording.analog_labels
    remarks += [header.remark] * bool(header.remark)
    for what, labels in (("marker", points), ("analog channel", analogs)):
        repeated = [f"'{label}' {count} times" for label, count in Counter(labels).items() if count > 1]
        remarks += [f"{what}s of the same label: {listing(repeated)}"] * bool(repeated)
    stated, actual = analog_rates(header)
    if stated is not None:
        remarks.append(f"ANALOG:RATE is {stated:g} Hz, the frames hold samples at {actual:g} Hz")
    for what, labels, count in (("points", points, header.points), ("analog channels", analogs, header.channels)):
        if len(labels) < count:
            remarks.append(f"{count - len(labels)} of {count} {what} have no label")
    return Overview("c3d", facts, channels, remarks, settings)


def marker_channel(label: str, positions: Array, unit: str, rate: float, is_output: bool = False) -> RecordedChannel:
    """A marker or a model output by its positions, (frames, 3), NaN where it was not seen."""
    seen, kind = ~np.isnan(positions).any(axis=1), "model output" if is_output else "marker"
    missing = 1.0 - float(seen.mean())
    note = f"missing in {missing:.1%} of the frames" if missing else ""
    centre = tuple(positions[seen].mean(axis=0).tolist()) if seen.any() else ()
    return RecordedChannel(kind, {"label": label}, unit, int(seen.sum()), rate, note, missing=missing, centre=centre)


def plate_channel(recording: C3DRecording, number: int) -> RecordedChannel:
    """A plate with its type and channels, the range of its force [N] and its middle, as far as they can be known."""
    load, centre = None, tuple[float, ...]()
    try:
        kind = int(plate_parameter(recording, "TYPE", number))
        own = plate_parameter(recording, "CHANNEL", number, (0,)).astype(int).tolist()
        note = f"type {kind}, analog channels {own}"
    except InputError as error:
        note = str(error)
    with suppress(InputError):
        corners = plate_parameter(recording, "CORNERS", number, (3, 4)).mean(axis=1)
        source = model_of("c3d", KEYS["c3d"]).model_validate({"format": "c3d", "plates": [number]})
        (found,) = plate_loads(recording, source)
        load, centre = float(np.ptp(np.linalg.norm(found.force, axis=1))), tuple(corners.tolist())
        note += f", force changes by {load:.0f} N"
    return RecordedChannel("plate", {"plate": str(number)}, note=note, load=load, centre=centre)


def inspect_nexus(path: Path) -> Overview:
    """The sections' columns: one per trajectory, and per component of anything else."""
    facts, remarks, channels = {}, [], []
    for title, section in read_sections(path).items():
        facts[title] = f"{len(section.rows)} rows at {section.rate:g} Hz"
        try:
            section.counts()
        except InputError as error:
            remarks.append(f"{title}: {error}")
        kind = {"Trajectories": "marker", "Model Outputs": "model output"}.get(title, "device")
        for place, (name, component) in enumerate(zip(section.names, section.components, strict=True)):
            if not name or (kind == "marker" and component.casefold() != "x"):
                continue
            address = {"label": name} if kind == "marker" else {"device": name, "component": component}
            values, unit = section.values(place), section.units[place]
            missing, seen = float(np.isnan(values).mean()), int((~np.isnan(values)).sum())
            note = f"missing in {missing:.1%} of the rows" if missing else ""
            channels.append(RecordedChannel(kind, address, unit, seen, section.rate, note, missing=missing))
    return Overview("nexus_csv", facts, channels, remarks)


def inspect_trc(path: Path) -> Overview:
    """Markers with the share of frames in which they were seen; raises InputError as `read_trc`."""
    file = read_trc(path)
    upward = vertical_axis(file.positions)
    facts = {
        "frames": f"{file.positions.shape[0]}, from {file.first_frame} on, at {file.rate:g} Hz",
        "unit of length": file.unit or "none",
        "time of the first frame": f"{file.start:g} s",
        "vertical axis": upward or "not told by the markers",
    }
    channels = [
        marker_channel(label, file.positions[:, place], file.unit, file.rate) for place, label in enumerate(file.labels)
    ]
    twice = sorted({label for label in file.labels if file.labels.count(label) > 1})
    remarks = [*file.notes, *[f"markers of the same label: {', '.join(twice)}"] * bool(twice)]
    return Overview("trc", facts, channels, remarks, {"axes": ["x", "-z", "y"]} if upward == "y" else {})
