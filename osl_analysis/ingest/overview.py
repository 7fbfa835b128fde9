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
from osl_analysis.formats import csv_table
from osl_analysis.formats.c3d import C3DRecording, CountsError, read_c3d
from osl_analysis.formats.gait_text import read_opensim, read_sections, read_trc
from osl_analysis.formats.json_lines import MOST_ELEMENTS, addresses_of, decode_lines, read_json_lines
from osl_analysis.formats.mat import Value, open_mat
from osl_analysis.formats.message_fields import FieldDescription, describe_message, last_name
from osl_analysis.formats.messages import ChannelSurvey, MessageFile, survey_channels
from osl_analysis.formats.table import Loss
from osl_analysis.formats.tdms import read_tdms
from osl_analysis.ingest import logs
from osl_analysis.ingest.captures import analog_rates, plate_count, plate_loads, plate_parameter, vertical_axis
from osl_analysis.ingest.source import KEYS, NAME_OF_TIME, UNKNOWN, model_of
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
    load: float | None = None  # range of the force on a plate [N], where it can be computed
    centre: tuple[float, ...] = ()  # mean position of a marker, or of a plate's corners, (3,); empty if unknown
    missing: float = 0.0  # share of the frames or rows in which nothing was recorded, 0 to 1


@dataclass(frozen=True)
class Overview:
    """What one file holds."""

    format: str  # the format's name in source files
    facts: Mapping[str, str]  # facts about the whole file
    channels: Sequence[RecordedChannel]  # what it recorded, in the order of the file
    remarks: Sequence[str] = ()  # damage and oddities, a sentence each
    settings: Mapping[str, object] = field(default_factory=dict)  # fields of a source file that the file tells
    drafted: Sequence[RecordedChannel] | None = None  # those of the draft, where it has one trial of several
    open: Sequence[str] = ()  # what the user decides, as which of its clocks counts, a sentence each
    draft_note: str = ""  # A remark that the draft has as a comment


def likely_unit(name: str) -> str:
    """The unit that the end of a column's name tells, as `deg` in `ankle_deg`; empty if it tells none. `_m` is none:
    `theta_m` is the motor's angle."""
    plain = ("deg", "rad", "rev", "rpm", "Nm", "N", "A", "mA", "V", "mV", "s", "ms", "us", "ns", "Hz", "mm")
    spelled = {"deg_s": "deg/s", "deg_per_s": "deg/s", "rad_s": "rad/s", "rad_per_s": "rad/s", "sec": "s"}
    endings = [end for end in (*plain, *spelled) if name.endswith(f"_{end}")]
    longest = max(endings, key=len, default="")
    return spelled.get(longest, longest)


def guesses(units: Mapping[str, str]) -> list[str]:
    """A remark on the units that names tell, by channel."""
    named = ", ".join(f"{name} [{unit}]" for name, unit in units.items() if unit)
    return [f"units guessed from the names, to be checked: {named}"] * bool(named)


CLOCKS = (
    "time", "t", "timestamp", "stamp", "state_time", "loop_time", "pi_time", "sys_time", "ros_time", "elapsed",
    "elapsed_time", "clock", "seconds", "time_since_start",
)  # fmt: skip
"""How columns of time are called, without a unit behind it."""


def is_clock(title: str) -> bool:
    """Whether a column is called like a clock: `time`, `t_s`, `loop_time [ms]`."""
    name = csv_table.name_and_unit(title)[0].strip()
    return name.casefold() in CLOCKS or re.sub(r"_(s|sec|ms|us|ns)$", "", name).casefold() in CLOCKS


def likely_clock(readings: Mapping[str, NDArray[Any]], what: str = "columns") -> tuple[str | None, list[str]]:
    """The clock that a draft names, and what the user has to decide, from the readings (n,) of all that are called so.
    The first of several, if they span the same time in s, ms, us or ns. None if they contradict each other, as then B
    and I depend on the choice. What does not run, as the duration of each loop, is no clock beside one that does."""
    clocks = {name: values.astype(np.float64) for name, values in readings.items()}
    spans = {name: span_of(values) for name, values in clocks.items()}
    running = [name for name, span in spans.items() if span > 0] or list(readings)
    if len(running) < 2:
        return next(iter(running), None), []
    count, first, most = f"{len(running)} {what} may be the clock", running[0], 6
    if all(one_time(clocks[name], clocks[first]) for name in running):
        named = listing([printable(name) for name in running], most)
        return first, [f"{count}, to be checked: {named}; {printable(first)} is taken"]
    named = listing([f"{printable(name)} spans {spans[name]:.6g}" for name in running], most)
    return None, [f"{count}, and they contradict each other: {named}; name the one by which the signals were sampled"]


def span_of(values: Array) -> float:
    """Last minus first of the readings (n,) of a clock, in its unit; 0 if they do not run: a tenth of the steps go
    back."""
    known = values[np.isfinite(values)]
    runs = known.size > 1 and float(np.mean(np.diff(known) >= 0)) > 0.9
    return max(float(known[-1] - known[0]), 0.0) if runs else 0.0


def one_time(one: Array, other: Array) -> bool:
    """Whether two clocks span the same time within 0.5 %, which puts I wrong by 1 %, in units that are a power of 1000
    apart, where both have readings."""
    if one.shape == other.shape:
        known = np.isfinite(one) & np.isfinite(other)
        one, other = one[known], other[known]
    spans = span_of(one), span_of(other)
    if min(spans) <= 0:
        return max(spans) <= 0
    ratio = spans[0] / spans[1]
    return abs(ratio / 1000.0 ** round(math.log10(ratio) / 3) - 1) <= 0.005


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


@dataclass(frozen=True)
class Numbers:
    """One column of numbers, as a file has it."""

    name: str  # its address in a source file
    own: str  # the part of the address that is its name
    values: NDArray[Any]  # (n,) those that can be read
    unit: str = ""  # that the file states
    type: str = ""
    also: str = ""  # a remark for the user

    def listed(self, key: str, is_time: bool) -> RecordedChannel:
        """Its range, or as a clock its rate and gaps, from the finite numbers; `key` is that of its address."""
        numbers = self.values.astype(np.float64)
        known = numbers[np.isfinite(numbers)]
        note = f"from {known.min():.6g} to {known.max():.6g}" if known.size else "no numbers"
        rate, guess = rate_of(known) if is_time else None, "" if self.unit else likely_unit(self.own)
        if is_time:
            note, gaps = f"a clock, {rate:g} per unit" if rate else "a clock that stands still", gaps_text(known)
            note += f", {gaps}" * bool(gaps)
        if rate and not self.unit and not guess and known.size >= 20 and not (np.diff(known) == 1).all():
            # Recorders of joints have rates from 50 to 5000 Hz, less than a factor of 1000 apart: a reading fits them
            # in one unit only. Readings that rise by one may count rows.
            units = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
            guess = next((unit for unit, in_s in units.items() if 50.0 <= rate * in_s <= 5000.0), "")
        lost = f", {numbers.size - known.size} x NaN or infinity" * (known.size < numbers.size)
        count, note = int(known.size), f"{note}{lost}{self.also}"
        return RecordedChannel(key, {key: self.name}, self.unit, count, None, note, self.type, guess)


def clock_among(what: str, columns: Sequence[Numbers]) -> tuple[str | None, list[str]]:
    """The likely clock of a table's columns, the shortest address first, and what the user has to decide."""
    called = [one for one in sorted(columns, key=lambda one: one.name.count(".")) if is_clock(one.own)]
    return likely_clock({one.name: one.values for one in called}, what)


def time_setting(key: str, clock: RecordedChannel | None) -> dict[str, str]:
    """The field `time` of a source file, by the clock that the draft names."""
    if clock is None:
        return {key: NAME_OF_TIME, "unit": UNKNOWN}
    return {key: clock.address[key], "unit": clock.unit or clock.likely_unit or UNKNOWN}


def guessed_csv(rows: csv_table.Rows) -> tuple[list[str], list[str], csv_table.Rows, bool]:
    """Titles of the columns (their numbers, counted from 1, without a header), units in a row below (or none), rows,
    and whether there is a header; refused is text that is no table: more than half of its rows hold no number."""
    if not rows:
        raise InputError("holds no rows; check that it is a recording")

    def seems_number(cell: str) -> bool:
        return csv_table.is_number_cell(cell.replace(",", "."))

    headed = not all(seems_number(cell) for cell in rows[0][1] if cell)
    first = csv_table.unpadded(rows[0][1], 0)
    titles = first if headed else [str(place + 1) for place in range(len(first))]
    body = [(line, csv_table.unpadded(cells, len(titles))) for line, cells in (rows[1:] if headed else rows)]
    if headed:
        csv_table.check_header_place(rows[0], body)
    below = body[0][1] if headed and body else []
    known = [bool(cell) and is_unit(csv_table.without_brackets(cell)) and cell != "1" for cell in below]
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


def inspect_csv(path: Path) -> Overview:
    lines = csv_table.read_lines(path)
    comments = [text for _, text in lines if text.lstrip().startswith("#")]
    content = [(line, text) for line, text in lines if not text.lstrip().startswith("#")]
    delimiter = csv_table.delimiter_of(content, "auto")
    titles, units, body, has_header = guessed_csv(csv_table.split_rows(content, delimiter))
    columns = []
    for place, title in enumerate(titles):
        cells = pl.Series([row[place] if place < len(row) else "" for _, row in body], dtype=pl.String)
        values = cells.str.replace(",", ".", literal=True).cast(pl.Float64, strict=False)
        unit = csv_table.name_and_unit(title)[1] or (
            csv_table.without_brackets(units[place]) if place < len(units) else ""
        )
        words = Counter(cells.filter(values.is_null()).to_list()).most_common(5)
        also = "".join(f", {count} x '{word}'" for word, count in words)
        columns.append(Numbers(title, title, values.drop_nulls().to_numpy(), unit, also=also))
    clock, left_open = clock_among("columns", columns)
    channels = []
    for column in columns:
        name = csv_table.name_and_unit(column.name)[0]
        # of an object without a name Python prints its number, which changes from run to run; the pattern fits the next
        # recording too, where only this column of the file fits it
        pattern = re.sub(r"<[^<>]* object at 0x[0-9a-fA-F]+>", "*", name)
        lasting = pattern if pattern != name and len(csv_table.places_of(pattern, titles)) == 1 else name
        channels.append(replace(column, name=lasting).listed("column", column.name == clock))
    remarks = []
    for length, count in Counter(len(row) for _, row in body).items():
        if length != len(titles):
            line = next(line for line, row in body if len(row) == length)
            remarks.append(f"{count} rows have {length} cells under {len(titles)} names, the first in line {line}")
    settings = {
        "clock": "master",
        "delimiter": {sign: word for word, sign in csv_table.DELIMITERS.items()}.get(delimiter, delimiter),
        **({} if has_header else {"header": "none"}),
        **({"units_row": True} if units else {}),
        **({"decimal": ","} if delimiter != "," and any("," in c for _, row in body[:5] for c in row) else {}),
        **({"extra_cells": UNKNOWN} if all(len(row) == len(body[0][1]) > len(titles) for _, row in body) else {}),
        "time": time_setting("column", None if clock is None else channels[titles.index(clock)]),
    }
    facts = {"rows": str(len(body)), "delimiter": repr(delimiter), "header": "yes" if has_header else "none"}
    facts |= {f"comment {i + 1}": text.strip() for i, text in enumerate(comments[:20])}
    named = {one.address["column"]: one.likely_unit for one in channels}
    remarks += guesses({name: unit for name, unit in named.items() if likely_unit(name)})
    return Overview("csv", facts, channels, remarks, settings, open=left_open)


def inspect_json(path: Path) -> Overview:
    """Every number in the lines, with its range, and the likely clock."""
    lines = read_json_lines(path)
    names, long = addresses_of(lines)
    if not names:
        raise InputError("no line holds a number; name a recording")
    decoded = dict.fromkeys(names, decode_lines(lines, names))
    if decoded[names[0]].misfits and len(names) <= 100:  # a line has something else than a number in one of them
        decoded = {name: decode_lines(lines, [name]) for name in names}
    stamp, parts = next(iter(logs.stamps_among(names).items()), ("", ("", "")))
    columns = []
    for name, one in decoded.items():
        numbers, total = one.values[name][one.present[name]], one.present[name].size
        also = f", in {numbers.size} of {total} lines" * (numbers.size < total)
        columns.append(Numbers(name, last_name(name), numbers, type=numbers.dtype.name, also=also))
    timing = [one for one in columns if one.name not in parts]
    clock, left_open = clock_among("fields", timing)
    channels = {one.name: one.listed("field", one.name == clock) for one in columns}
    remarks = list(dict.fromkeys(note for one in decoded.values() for note in logs.notes_on(lines, one)))
    remarks += [f"{name} has {size} elements; only the first {MOST_ELEMENTS} are listed" for name, size in long.items()]
    remarks += guesses({name: one.likely_unit for name, one in channels.items() if likely_unit(last_name(name))})
    time = time_setting("field", channels[clock] if clock else None)
    if stamp and not any(is_clock(one.own) for one in timing):
        time = {"field": stamp}
        try:
            of_parts = decode_lines(lines, parts)
            table = logs.lines_table(lines, of_parts, Loss(), np.ones(of_parts.rows.size, dtype=bool))
            column = logs.nanoseconds(table, parts, "field", f"name another time, or {logs.RATE}")
            there = np.ma.getdata(column)[~np.ma.getmaskarray(column)]
            seconds = (there - there[:1].sum()) / logs.SECOND
            notes = ["a stamp of seconds and nanoseconds", gaps_text(seconds)]
            notes += [f"in {seconds.size} of {column.size} lines"] * bool(seconds.size < column.size)
            note, rate = ", ".join(filter(None, notes)), rate_of(seconds)
            whole = RecordedChannel("field", {"field": stamp}, "", seconds.size, rate, note, "int64")
            channels = {stamp: whole, **{name: one for name, one in channels.items() if name not in parts}}
        except InputError as error:
            remarks.append(str(error))
    facts = {"rows": str(len(lines.texts))}
    return Overview(
        "json_lines", facts, [*channels.values()], remarks, {"clock": "master", "time": time}, open=left_open
    )


@dataclass(frozen=True)
class Variable:
    """One variable or field that is no struct and no cell."""

    part: str  # address of what it is in; empty for the file itself
    name: str  # its own name, or the choice of a cell
    value: Value

    @property
    def address(self) -> str:
        return f"{self.part}{'.' * (bool(self.part) and not self.name.startswith('{'))}{self.name}"

    @property
    def is_signal(self) -> bool:
        """Whether it may be a signal: a vector of real numbers, or a matrix of columns."""
        return self.value.numbers is not None and len(self.value.shape) == 2 and max(self.value.shape) >= 10

    @property
    def seems_clock(self) -> bool:
        """By how its name is or begins: `t`, `time_ms`, `timeJIM`."""
        likely = re.match(r"(time|t|stamp|clock)(?![a-z])|time", self.name, re.IGNORECASE)
        return self.is_signal and (is_clock(self.name) or likely is not None)

    def listed(self, name: str) -> RecordedChannel:
        """It under a name, for the list or the draft."""
        readings, text = np.empty(0) if self.value.numbers is None else self.value.numbers.ravel(), self.value.text
        found = Numbers(name, self.name, readings, type=self.value.described()).listed("variable", self.seems_clock)
        return replace(found, count=self.value.size, note=found.note if readings.size else f"'{text}'" * bool(text))


def variables_in(part: str, name: str, value: Value) -> Iterator[Variable]:
    here = Variable(part, name, value)
    if value.kind == "struct" and value.elements:
        for number, fields in enumerate(value.elements, start=1):
            inside = f"{here.address}({number})" if len(value.elements) > 1 else here.address
            for own in value.fields:
                yield from variables_in(inside, own, fields[own])
    elif value.kind == "cell" and value.cells:
        for number, cell in enumerate(value.cells, start=1):
            yield from variables_in(here.address, f"{{{number}}}", cell)
    else:
        yield here


def inspect_mat(path: Path) -> Overview:
    """Variables, fields and cells with size, range and likely unit; what cannot be read; parts that are alike."""
    file, most = open_mat(path), 500
    variables = [one for name, value in file.read(file.names).items() for one in variables_in("", name, value)]
    facts = {"version": file.version, "header": file.header, "variables": str(len(file.names))}
    remarks = [
        f"{one.address} is a {one.value.described()}, which is not read; {one.value.remedy()}"
        for one in variables
        if one.value.numbers is None and one.value.kind not in ("char", "struct", "cell")
    ]
    remarks += [f"and {len(variables) - most} more variables"] * (len(variables) > most)
    by_part: dict[str, list[Variable]] = {}
    for one in variables:
        if one.is_signal:
            by_part.setdefault(one.part, []).append(one)
    groups: dict[tuple[str, ...], dict[str, list[Variable]]] = {}  # the parts that hold the same signals
    for part, own in by_part.items():
        groups.setdefault(tuple(one.name for one in own), {})[part] = own
    alike = max(groups.values(), key=lambda group: sum(map(len, group.values())), default={})
    drafted, part = next(iter(alike.values()), []), next(iter(alike), "") if len(alike) == 1 else ""
    clocks = {one.name: one for one in drafted if one.seems_clock and 1 in one.value.shape}
    readings = {name: one.value.numbers.ravel() for name, one in clocks.items() if one.value.numbers is not None}
    clock, left_open = likely_clock(readings, "variables")
    if len(alike) > 1:
        parts = listing([printable(one) for one in alike], 40)
        what = f"{len(alike)} parts hold the same variables: name one per trial in the column `log_part` of the sheet"
        left_open = [f"{what}: {parts}", *left_open]
    time = time_setting("variable", clocks[clock].listed(clock) if clock else None)
    settings = {"clock": "master", **({"log_part": part} if part else {}), "time": time}
    channels, signals = [one.listed(one.address) for one in variables[:most]], []
    for one in drafted:  # each column of a matrix, or row if it has more columns
        rows, columns = one.value.shape
        lines = [f"(:,{k + 1})" for k in range(columns)] if rows >= columns else [f"({k + 1},:)" for k in range(rows)]
        signals += [one.listed(f"{one.name}{line}") for line in (lines if min(rows, columns) > 1 else [""])]
    return Overview("mat", facts, channels, remarks, settings, signals, left_open)


def inspect_tdms(path: Path) -> Overview:
    """Channels with unit, range and rate by their own timing."""
    file = read_tdms(path)
    remarks, numbers = list(file.notes), dict[str, NDArray[Any]]()
    for one in file.channels:
        try:
            numbers |= file.values([one]) if one.count and (one.holds_numbers or one.holds_times) else {}
        except InputError as error:
            remarks.append(str(error))
    stamps = [one.address for one in file.channels if one.holds_times and one.count]
    timed = any(one.step is not None for one in file.channels)
    columns = []
    for one in file.channels:
        unit, values = "s" if one.address in stamps else one.unit, numbers.get(one.address, np.empty(0))
        columns.append(Numbers(one.address, one.name, values, unit, np.dtype(one.kind).name))
    clock, left_open = clock_among("channels", [one for one in columns if one.name in numbers])
    clock = None if timed else clock or (None if left_open else next(iter(stamps), None))
    channels = {}
    for one, column in zip(file.channels, columns, strict=True):
        rate = 1 / one.step if one.step else None
        channels[one.address] = replace(column.listed("channel", one.address == clock), count=one.count, rate=rate)
    time = {} if timed else {"time": time_setting("channel", channels[clock] if clock else None)}
    facts = {"channels": str(len(file.channels)), "own timing": "yes" if timed else "no", **file.properties}
    drafted = [channels[one.address] for one in file.channels if one.count and one.holds_numbers]
    still_open, settings = [] if timed else left_open, {"clock": "master", **time}
    return Overview("tdms", facts, [*channels.values()], remarks, settings, drafted, still_open)


# units that OpenSim gives to columns whose names end so
ENDINGS = {r"force.*_v[xyz]": "N", r"force.*_p[xyz]": "m", r"(torque|moment).*_[xyz]|_moment": "N*m", r"_t[xyz]": "m"}


def inspect_opensim(path: Path) -> Overview:
    """Columns with range and likely unit."""
    table = read_opensim(path)
    columns, remarks = [], list[str]()
    for name in dict.fromkeys(table.names):
        try:
            columns.append(Numbers(name, name.rpartition(".")[2], table.column(name)))
        except InputError as error:
            remarks.append(str(error))
    clock, left_open = clock_among("columns", columns)
    channels = {}
    for column in columns:
        name = column.name
        known = [unit for pattern, unit in ENDINGS.items() if re.search(f"({pattern})$", name, re.IGNORECASE)]
        guess = likely_unit(name) or (known[0] if known else table.angles)  # of a coordinate by `inDegrees`
        channels[name] = replace(column.listed("column", name == clock), likely_unit="" if name == clock else guess)
    remarks += guesses({name: one.likely_unit for name, one in channels.items()})
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


ROS_UNITS = {
    "sensor_msgs/JointState": {"position": "rad", "velocity": "rad/s", "effort": "N*m"},
    "geometry_msgs/Wrench": {"force": "N", "torque": "N*m"},
    "geometry_msgs/WrenchStamped": {"wrench.force": "N", "wrench.torque": "N*m"},
}
"""Units of standard messages of ROS (REP 103), by the beginning of the field. A joint that slides has other ones."""


def inspect_messages(name: str, opened: Callable[[Path], MessageFile], path: Path) -> Overview:
    """Topics with schema, encoding, rate and gaps by log time, every field of each, and what is damaged."""
    file = opened(path)
    surveys = survey_channels(file)
    remarks = list(file.damage.all_remarks())
    for survey in surveys:
        table = pl.DataFrame({"stamp": survey.log_time, "message": np.arange(survey.log_time.size)})
        try:  # what ingest will say of a channel's log times, if they go back
            logs.check_not_set(survey.channel.topic, table, "its log times cannot be used")
        except InputError as error:
            remarks.append(str(error))
    described = [topic_channels(survey, remarks) for survey in surveys]
    channels, stamped = [one for some, _ in described for one in some], any(has_stamps for _, has_stamps in described)
    settings = {"clock": "master", "time": {"source": "header" if stamped else "log"}}
    damage, lost = file.damage, file.damage.messages_lost()
    facts = {"bytes": str(file.size), "chunks": str(damage.chunks), "messages": str(damage.messages)}
    facts |= {"messages lost": "the file does not tell" if lost is None else str(lost), "checksums": damage.crc()}
    return Overview(name, facts, channels, remarks, settings)


def topic_channels(survey: ChannelSurvey, remarks: list[str]) -> tuple[list[RecordedChannel], bool]:
    """A topic's numbers, one by one as a source file names them, by the first message or else the schema; the topic
    alone where there are none. And whether it has stamps. What cannot be described is remarked."""
    reason, fields = "", list[FieldDescription]()
    for message in dict.fromkeys([survey.first, None]):
        try:
            fields = describe_message(survey.channel, survey.schema, message)
            if fields or not reason:  # JSON has no schema to tell what a message does not
                break
        except (ValueError, RecursionError) as error:
            reason = reason or " ".join(str(error).split())
    else:
        remarks.append(f"topic '{survey.channel.topic}': its fields cannot be listed: {reason}")
    topic, kind, units = survey.channel.topic, survey.channel.message_encoding, dict[str, str]()
    if survey.schema:
        kind, units = f"{survey.schema.name} ({kind})", ROS_UNITS.get(survey.schema.name.replace("/msg/", "/"), {})
    count, stamps = survey.log_time.size, (survey.log_time - survey.log_time[:1].sum()) / logs.SECOND
    rate, timing, most, channels = rate_of(stamps), gaps_text(stamps) or "empty" * (not count), 500, []
    # every message of ROS has a header, and no signal is in it
    numbers = [(path, one) for one in fields if not one.path.startswith("header.") for path in one.addresses()]
    for path, one in numbers[:most]:
        unit = next((unit for begin, unit in units.items() if path.startswith(begin)), "")
        samples = 0 if one.length == 0 else count
        type_ = one.type if one.length is None else f"{one.type}[{one.length}]"
        address = {"topic": topic, "field": path}
        channels.append(RecordedChannel(kind, address, "", samples, rate if samples else None, timing, type_, unit))
    if len(numbers) > most or not numbers:
        more = f"and {len(numbers) - most} more numbers" if numbers else ""
        channels.append(RecordedChannel(kind, {"topic": topic}, "", count, rate, timing, more))
    return channels, any(one.path.startswith("header.stamp") for one in fields)


def inspect_c3d(path: Path) -> Overview:
    """Markers with the share of frames in which they were seen, model outputs, analog channels and plates. Where header
    and parameters contradict each other, the file is read by the counts that fit its size."""
    settings, remarks = dict[str, object](), list[str]()
    try:
        recording = read_c3d(path)
    except CountsError as error:
        if not error.fitting:
            raise
        recording = read_c3d(path, error.fitting[0])
        settings, remarks = {"counts": UNKNOWN}, [f"read here with the counts of the {error.fitting[0]}: {error}"]
    header, outputs, unit = recording.header, recording.model_outputs, recording.point_unit()
    channels = []
    for label, positions in zip(recording.point_labels, recording.points.transpose(1, 0, 2), strict=False):
        of_kind = ("", header.rate, "model output") if label in outputs else (unit, header.rate)
        channels.append(marker_channel(label, positions, *of_kind))
    for place, label in enumerate(recording.analog_labels):
        values, rate = recording.analogs[:, place], header.rate * header.samples_per_frame
        low, high = values.min(), values.max()
        note = f"from {low:.6g} to {high:.6g}" if low != high else f"always {low:.6g}"
        unit_of_channel = recording.analog_unit(place)
        channels.append(RecordedChannel("analog", {"channel": label}, unit_of_channel, values.size, rate, note))
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


def marker_channel(label: str, positions: Array, unit: str, rate: float, kind: str = "marker") -> RecordedChannel:
    """A marker or a model output by its positions, (frames, 3), NaN where it was not seen."""
    seen = ~np.isnan(positions).any(axis=1)
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
