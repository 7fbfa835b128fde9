"""What a log holds, table or messages: channels with their ranges, rates and gaps, and what is damaged or odd."""

import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.errors import InputError, listing, printable
from osl_analysis.formats.csv_table import (
    DELIMITERS,
    Rows,
    check_header_place,
    delimiter_of,
    is_number_cell,
    name_and_unit,
    read_lines,
    split_rows,
    unpadded,
    without_brackets,
)
from osl_analysis.formats.gait_text import read_opensim
from osl_analysis.formats.json_lines import (
    MOST_ELEMENTS,
    addresses_of,
    decode_lines,
    read_json_lines,
)
from osl_analysis.formats.mat import Value, open_mat
from osl_analysis.formats.message_fields import FieldDescription, describe_message, last_name
from osl_analysis.formats.messages import ChannelSurvey, survey_channels
from osl_analysis.formats.tdms import read_tdms
from osl_analysis.ingest.message_log import FILES
from osl_analysis.ingest.overview import (
    NAME_OF_TIME,
    UNKNOWN,
    Overview,
    RecordedChannel,
    clocks_among,
    gaps_text,
    guessed_units,
    is_clock,
    lasting_name,
    likely_clock,
    likely_unit,
    range_text,
    rate_of,
    unit_of_clock,
)
from osl_analysis.ingest.stamps import SECOND, check_not_set
from osl_analysis.ingest.table_log import notes_on, stamp_column, stamps_among
from osl_analysis.ingest.units import is_unit

NO_NUMBERS = np.empty(0)


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
    """A channel of a table with its range; `own` is the part of its address that is its name, `also` a remark."""
    numbers = values.astype(np.float64)
    known = numbers[np.isfinite(numbers)]
    lost = f", {numbers.size - known.size} x NaN or infinity" if known.size < numbers.size else ""
    guess = "" if unit else likely_unit(own or name) or (unit_of_clock(known) if is_time else "")
    note = f"{range_text(known, is_time)}{lost}{also}"
    return RecordedChannel(key, {key: name}, unit, int(known.size), None, note, kind, likely_unit=guess)


def time_setting(key: str, clock: RecordedChannel | None) -> dict[str, str]:
    """The field `time` of a source file, by the clock that the draft names."""
    if clock is None:
        return {key: NAME_OF_TIME, "unit": UNKNOWN}
    return {key: clock.address[key], "unit": clock.unit or clock.likely_unit or UNKNOWN}


COMMENT = "#"
MOST_WORDS = 5
MOST_COMMENTS = 20
LEAST_NUMBERS = 0.5  # share of the rows in which one column at least must hold a number: what has less is prose
SAMPLE = 5  # rows in which a decimal comma is sought


@dataclass(frozen=True)
class GuessedCsv:
    """A table in text, as its lines suggest it."""

    titles: list[str]  # of the columns; their numbers, counted from 1, without a header
    units: list[str]  # in a row below the header; empty without one
    body: Rows
    has_header: bool


def guessed_csv(rows: Rows) -> GuessedCsv:
    """Header, units and rows; refused is text that is no table: most of its rows hold no number."""
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
    if len(prose) > (1 - LEAST_NUMBERS) * len(body):
        raise InputError(
            f"no table of numbers: {len(prose)} of {len(body)} rows hold none, such as line {prose[0][0]}, "
            f"'{' '.join(prose[0][1])[:40]}'; name a recording, or write a header and a row per sample"
        )
    return GuessedCsv(titles, below, body, headed)


def seems_number(cell: str) -> bool:
    return is_number_cell(cell.replace(",", "."))


def inspect_csv(path: Path) -> Overview:
    lines = read_lines(path)
    comments = [text for _, text in lines if text.lstrip().startswith(COMMENT)]
    content = [(line, text) for line, text in lines if not text.lstrip().startswith(COMMENT)]
    delimiter = delimiter_of(content, "auto")
    table = guessed_csv(split_rows(content, delimiter))
    titles, body = table.titles, table.body
    columns = [[row[k] if k < len(row) else "" for _, row in body] for k in range(len(titles))]
    cells = [pl.Series(column, dtype=pl.String) for column in columns]
    values = [one.str.replace(",", ".", literal=True).cast(pl.Float64, strict=False) for one in cells]
    clock, left_open = likely_clock({t: v.to_numpy() for t, v in zip(titles, values, strict=True) if is_clock(t)})
    channels = []
    for place, title in enumerate(titles):
        (name, unit), numbers = name_and_unit(title), values[place].drop_nulls().to_numpy()
        unit = unit or (without_brackets(table.units[place]) if place < len(table.units) else "")
        words = Counter(cells[place].filter(values[place].is_null()).to_list()).most_common(MOST_WORDS)
        also = "".join(f", {count} x '{word}'" for word, count in words)
        channels.append(listed("column", lasting_name(name, titles), numbers, title == clock, unit, name, also))
    remarks = []
    for length, count in Counter(len(row) for _, row in body).items():
        if length != len(titles):
            line = next(line for line, row in body if len(row) == length)
            remarks.append(f"{count} rows have {length} cells under {len(titles)} names, the first in line {line}")
    decimal_comma = delimiter != "," and any("," in cell for _, row in body[:SAMPLE] for cell in row)
    longer = all(len(row) == len(body[0][1]) > len(titles) for _, row in body)
    settings = {
        "clock": "master",
        "delimiter": {sign: word for word, sign in DELIMITERS.items()}.get(delimiter, delimiter),
        **({} if table.has_header else {"header": "none"}),
        **({"units_row": True} if table.units else {}),
        **({"decimal": ","} if decimal_comma else {}),
        **({"extra_cells": UNKNOWN} if longer else {}),
        "time": time_setting("column", None if clock is None else channels[titles.index(clock)]),
    }
    facts = {"rows": str(len(body)), "delimiter": repr(delimiter), "header": "yes" if table.has_header else "none"}
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
        all_lines, kind = decoded[name].present[name].size, numbers.dtype.name
        also = f", in {numbers.size} of {all_lines} lines" if numbers.size < all_lines else ""
        channels[name] = listed("field", name, numbers, name == clock, own=last_name(name), also=also, kind=kind)
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
    facts, settings = {"rows": str(lines.starts.size)}, {"clock": "master", "time": time}
    return Overview("json_lines", facts, list(channels.values()), remarks, settings, open=left_open)


MOST_LISTED = 500  # largest number of variables that are listed
MOST_PARTS = 40  # largest number of parts that are named
FEWEST = 10  # numbers in the shortest vector that may be a signal
CLOCK = re.compile(r"(time|t|stamp|clock)(?![a-z])|time", re.IGNORECASE)
"""How the name of a variable of time begins."""


@dataclass(frozen=True)
class Leaf:
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
        return NO_NUMBERS if self.value.numbers is None else self.value.numbers.ravel()

    @property
    def is_signal(self) -> bool:
        """Whether it may be a signal: a vector of real numbers, or a matrix of columns."""
        return self.value.numbers is not None and len(self.value.shape) == 2 and max(self.value.shape) >= FEWEST

    @property
    def seems_clock(self) -> bool:
        """Whether it is a signal that is called like a clock: `t`, `time_ms`, `timeJIM`."""
        return self.is_signal and (is_clock(self.name) or CLOCK.match(self.name) is not None)

    def listed(self, name: str) -> RecordedChannel:
        """It under a name, for the list or the draft."""
        kind, text = self.value.described(), self.value.text
        found = listed("variable", name, self.readings, self.seems_clock, own=self.name, kind=kind)
        note = found.note if self.readings.size else f"'{text}'" * bool(text)
        return replace(found, count=self.value.size, note=note)


def inspect_mat(path: Path) -> Overview:
    """Variables, fields and cells with size, range and likely unit; what cannot be read; parts that are alike."""
    file = open_mat(path)
    leaves = [leaf for name, value in file.read(file.names).items() for leaf in leaves_of("", name, value)]
    facts = {"version": file.version, "header": file.header, "variables": str(len(file.names))}
    remarks = [
        f"{leaf.address} is a {leaf.value.described()}, which is not read; {leaf.value.remedy()}"
        for leaf in leaves
        if leaf.value.numbers is None and leaf.value.kind not in ("char", "struct", "cell")
    ]
    if len(leaves) > MOST_LISTED:
        remarks.append(f"and {len(leaves) - MOST_LISTED} more variables")
    alike = parts_alike(leaves)
    drafted, part = next(iter(alike.values()), []), next(iter(alike), "") if len(alike) == 1 else ""
    clocks = {leaf.name: leaf for leaf in drafted if leaf.seems_clock and 1 in leaf.value.shape}
    clock, left_open = likely_clock({name: leaf.readings for name, leaf in clocks.items()}, "variables")
    if len(alike) > 1:
        parts = listing([printable(one) for one in alike], MOST_PARTS)
        what = f"{len(alike)} parts hold the same variables: name one per trial in the column `log_part` of the sheet"
        left_open = [f"{what}: {parts}", *left_open]
    time = time_setting("variable", clocks[clock].listed(clock) if clock else None)
    settings = {"clock": "master", **({"log_part": part} if part else {}), "time": time}
    channels, signals = [leaf.listed(leaf.address) for leaf in leaves[:MOST_LISTED]], []
    for leaf in drafted:  # each column of a matrix, or row if it has more columns
        rows, columns = leaf.value.shape
        lines = [f"(:,{k + 1})" for k in range(columns)] if rows >= columns else [f"({k + 1},:)" for k in range(rows)]
        signals += [leaf.listed(f"{leaf.name}{line}") for line in (lines if min(rows, columns) > 1 else [""])]
    return Overview("mat", facts, channels, remarks, settings, signals, left_open)


def leaves_of(part: str, name: str, value: Value) -> Iterator[Leaf]:
    here = Leaf(part, name, value)
    if value.kind == "struct" and value.elements:
        several = len(value.elements) > 1
        for number, fields in enumerate(value.elements, start=1):
            inside = f"{here.address}({number})" if several else here.address
            for field in value.fields:
                yield from leaves_of(inside, field, fields[field])
    elif value.kind == "cell" and value.cells:
        for number, cell in enumerate(value.cells, start=1):
            yield from leaves_of(here.address, f"{{{number}}}", cell)
    else:
        yield here


def parts_alike(leaves: Sequence[Leaf]) -> Mapping[str, list[Leaf]]:
    """The signals of the parts of the file that hold the same signals, by part: of the largest such group."""
    by_part: dict[str, list[Leaf]] = {}
    for leaf in leaves:
        if leaf.is_signal:
            by_part.setdefault(leaf.part, []).append(leaf)
    groups: dict[tuple[str, ...], dict[str, list[Leaf]]] = {}
    for part, own in by_part.items():
        groups.setdefault(tuple(leaf.name for leaf in own), {})[part] = own
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
    called = [paths[path] for path in clocks_among(list(paths)) if paths[path] in numbers]
    clock, left_open = likely_clock({name: numbers[name].astype(np.float64) for name in called}, "channels")
    clock = None if timed else clock or (None if left_open else next(iter(stamps), None))
    channels = {}
    for one in file.channels:
        values, kind = numbers.get(one.address, NO_NUMBERS), np.dtype(one.kind).name
        unit = "s" if one.address in stamps else one.unit
        found = listed("channel", one.address, values, one.address == clock, unit, one.name, kind=kind)
        channels[one.address] = replace(found, count=one.count, rate=1 / one.step if one.step else None)
    settings: dict[str, object] = {"clock": "master"}
    if not timed:
        settings["time"] = time_setting("channel", channels[clock] if clock else None)
    facts = {"channels": str(len(file.channels)), "own timing": "yes" if timed else "no", **file.properties}
    drafted = [channels[one.address] for one in file.channels if one.count and one.holds_numbers]
    return Overview("tdms", facts, list(channels.values()), remarks, settings, drafted, [] if timed else left_open)


ENDINGS = {r"force.*_v[xyz]": "N", r"force.*_p[xyz]": "m", r"(torque|moment).*_[xyz]|_moment": "N*m", r"_t[xyz]": "m"}
"""Unit that OpenSim gives to columns of these names."""


def inspect_opensim(path: Path) -> Overview:
    """Columns with range and likely unit."""
    table = read_opensim(path)
    remarks: list[str] = []
    clock, left_open = likely_clock({name: table.column(name) for name in clocks_among(table.names)})
    channels = {}
    for name in dict.fromkeys(table.names):
        try:
            found = listed("column", name, table.column(name), name == clock)
        except InputError as error:
            remarks.append(str(error))
            continue
        known = [unit for pattern, unit in ENDINGS.items() if re.search(f"({pattern})$", name, re.IGNORECASE)]
        guess = likely_unit(name) or (known[0] if known else table.angles)  # of a coordinate by `inDegrees`
        channels[name] = replace(found, likely_unit="" if name == clock else guess)
    guessed = [f"{name} [{one.likely_unit}]" for name, one in channels.items() if one.likely_unit]
    remarks += [f"units guessed from the names, to be checked: {', '.join(guessed)}"] * bool(guessed)
    facts = {"rows": str(len(table.rows))} | {key: value for key, value in table.header.items() if value}
    settings = {"clock": "master", "time": {"column": clock or NAME_OF_TIME, "unit": "s" if clock else UNKNOWN}}
    note = plates_text(table.names)
    return Overview("opensim", facts, list(channels.values()), remarks, settings, open=left_open, draft_note=note)


def plates_text(names: Sequence[str]) -> str:
    """The plates that the names of columns tell, as a source file has them but for their corners; empty if none."""
    plates = [
        f"{number}: {{{', '.join(f'{key}: {json.dumps(begin)}' for key, begin in found.items())}, corners: {UNKNOWN}}}"
        for number, found in enumerate(named_plates(names), start=1)
    ]
    text = f"these columns are force plates, if you state their corners: plates: {{{', '.join(plates)}}}"
    return printable(text) if plates else ""


def named_plates(names: Sequence[str]) -> Iterator[dict[str, str]]:
    """Beginnings of the names of force, point and moment of each plate: `ground_force_v`, `ground_force_p` ..."""
    triples = {name[:-1] for name in names if name[-1:] == "x" and {f"{name[:-1]}y", f"{name[:-1]}z"} <= {*names}}
    for name in names:
        force = name[:-1]
        if name.endswith("vx") and force in triples and f"{force[:-1]}p" in triples:
            stem = force[:-1]  # `R_ground_force_`: its moment is `R_ground_torque_` or `R_ground_moment_`
            moments = [re.sub("force", word, stem) for word in ("torque", "moment")]
            moment = next((one for one in moments if one != stem and one in triples), None)
            if moment is not None:
                yield {"force": force, "point": f"{stem}p", "moment": moment}


MOST_FIELDS = 500  # of one topic
UNITS = {
    "sensor_msgs/JointState": {"position": "rad", "velocity": "rad/s", "effort": "N*m"},
    "geometry_msgs/Wrench": {"force": "N", "torque": "N*m"},
    "geometry_msgs/WrenchStamped": {"wrench.force": "N", "wrench.torque": "N*m"},
}
"""Units of standard messages of ROS (REP 103), by the beginning of the field. A joint that slides has other ones."""
STAMP = "header."  # what every message of ROS has, and no signal is in


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
    stamped = any(field.path.startswith(f"{STAMP}stamp") for _, fields in described for field in fields)
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
    topic, encoding = survey.channel.topic, survey.channel.message_encoding
    kind = f"{survey.schema.name} ({encoding})" if survey.schema else encoding
    units = UNITS.get(survey.schema.name.replace("/msg/", "/"), {}) if survey.schema else {}
    log_time = survey.log_time
    stamps = (log_time - log_time[:1].sum()) / SECOND
    rate = rate_of(stamps)
    timing = gaps_text(stamps) or ("" if survey.log_time.size else "empty")
    numbers = [(path, field) for field in fields if not field.path.startswith(STAMP) for path in field.addresses()]
    for path, field in numbers[:MOST_FIELDS]:
        array = "" if field.length is None else f"[{field.length}]"
        address = {"topic": topic, "field": path}
        samples = 0 if field.length == 0 else survey.log_time.size
        unit = next((unit for begin, unit in units.items() if path.startswith(begin)), "")
        own_rate = rate if samples else None
        yield RecordedChannel(kind, address, "", samples, own_rate, timing, f"{field.type}{array}", likely_unit=unit)
    if len(numbers) > MOST_FIELDS or not numbers:
        more = f"and {len(numbers) - MOST_FIELDS} more numbers" if numbers else ""
        yield RecordedChannel(kind, {"topic": topic}, "", survey.log_time.size, rate, timing, more)
