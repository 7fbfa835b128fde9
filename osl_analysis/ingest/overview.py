"""What a file holds: channels with ranges, rates and gaps, what is odd, and what names tell of clocks and units."""

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
from osl_analysis.formats.c3d import C3DRecording, read_c3d
from osl_analysis.formats.gait_text import read_opensim, read_sections, read_trc
from osl_analysis.formats.json_lines import MOST_ELEMENTS, addresses_of, decode_lines, read_json_lines
from osl_analysis.formats.mat import Value, open_mat
from osl_analysis.formats.message_fields import FieldDescription, describe_message, last_name
from osl_analysis.formats.messages import ChannelLog, decode_topics, read_channels
from osl_analysis.formats.tdms import read_tdms
from osl_analysis.ingest import logs
from osl_analysis.ingest.captures import plate_count, plate_loads, plate_parameter, vertical_axis
from osl_analysis.ingest.source import NAME_OF_TIME, SOURCES, UNKNOWN
from osl_analysis.ingest.units import is_unit, normalised
from osl_analysis.trial import Array, plate_columns


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
    numbers: Array | None = field(default=None, compare=False, repr=False)  # readings, positions, size of a force [N]
    times: Array | None = field(default=None, compare=False, repr=False)  # of its readings [s]; None: those of the rows
    centre: tuple[float, ...] = ()  # mean position of a marker, or of a plate's corners, (3,); empty if unknown


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


def likely_unit(name: str) -> str:
    """The unit that the end of a column's name tells, as in `ankle_deg`; empty if none. `theta_m` is the motor's."""
    plain = ("deg", "rad", "rev", "rpm", "Nm", "N", "A", "mA", "V", "mV", "s", "ms", "us", "ns", "Hz", "mm")
    spelled = {"deg_s": "deg/s", "deg_per_s": "deg/s", "rad_s": "rad/s", "rad_per_s": "rad/s", "sec": "s"}
    endings = [end for end in (*plain, *spelled) if name.endswith(f"_{end}")]
    longest = max(endings, key=len, default="")
    return spelled.get(longest, longest)


def guesses(units: Mapping[str, str]) -> list[str]:
    """A remark on the units that names tell, by channel."""
    named = ", ".join(f"{name} [{unit}]" for name, unit in units.items() if unit)
    return [f"units guessed from the names, to be checked: {named}"] * bool(named)


def likely_clock(readings: Mapping[str, NDArray[Any]], what: str = "columns") -> tuple[str | None, list[str]]:
    """The clock that a draft names, and what the user has to decide, from the readings (n,) of all that are called so.
    The first of several, if they span the same time in s, ms, us or ns: within 0.5 %, which puts I wrong by 1 %. None
    if they contradict each other, as then B and I depend on the choice. What does not run, as the duration of each
    loop, is no clock beside one that does."""
    clocks = {name: values.astype(np.float64) for name, values in readings.items()}
    spans = {name: span_of(values) for name, values in clocks.items()}
    running = [name for name, span in spans.items() if span > 0] or list(readings)
    if len(running) < 2:
        return next(iter(running), None), []
    count, first, most = f"{len(running)} {what} may be the clock", running[0], 6
    agree = True
    for name in running[1:]:
        pair = clocks[name], clocks[first]
        if pair[0].shape == pair[1].shape:  # compared where both have readings
            known = np.isfinite(pair[0]) & np.isfinite(pair[1])
            pair = pair[0][known], pair[1][known]
        one, other = map(span_of, pair)
        thousands = round(math.log10(one / other) / 3) if min(one, other) > 0 else 0
        agree &= abs(one / other / 1000.0**thousands - 1) <= 0.005 if min(one, other) > 0 else one == other
    if agree:
        named = listing([printable(name) for name in running], most)
        return first, [f"{count}, to be checked: {named}; {printable(first)} is taken"]
    named = listing([f"{printable(name)} spans {spans[name]:.6g}" for name in running], most)
    return None, [f"{count}, and they contradict each other: {named}; name the one by which the signals were sampled"]


def clock_of(
    what: str, readings: Mapping[str, NDArray[Any]], called: Callable[[str], bool], units: Mapping[str, str]
) -> tuple[str | None, list[str]]:
    """The likely clock of a table's columns by address, the shortest first, and what the user has to decide: among
    those that are `called` a clock, or else among those that rise as one, a guess. `units` are those that it states."""
    shortest = sorted(readings, key=lambda name: name.count("."))
    if named := {name: readings[name] for name in shortest if called(name)}:
        return likely_clock(named, what)
    rising = {name: readings[name] for name in shortest if ticks(readings[name], units.get(name, ""))}
    clock, left_open = likely_clock(rising, what)
    if clock is not None and not left_open:
        step, unit = float(np.median(np.diff(rising[clock]))), units.get(clock) or time_unit(rising[clock])
        left_open = [f"time is a guess: {printable(clock)} rises by {step:.4g} {unit} a row"]
    return clock, left_open


def ticks(values: NDArray[Any], unit: str) -> bool:
    """Whether readings (n,) rise as those of a clock do: never back, by steps of which four in five are within a fifth
    of their median, in a unit of time, or in none and as fast as a recorder of joints in one unit only."""
    steps = np.diff(np.nan_to_num(values.astype(np.float64), posinf=0.0, neginf=0.0))
    usual = float(np.median(steps)) if steps.size >= 20 and (steps >= 0).all() else 0.0
    even = usual > 0 and float(np.mean(np.abs(steps / usual - 1) < 0.2)) > 0.8
    return even and bool(normalised(unit) in ("s", "ms", "us", "ns") if unit else time_unit(values))


def span_of(values: Array) -> float:
    """Last minus first of the readings (n,) of a clock, in its unit; 0 if a tenth of the steps go back."""
    known = values[np.isfinite(values)]
    runs = known.size > 1 and float(np.mean(np.diff(known) >= 0)) > 0.9
    return max(float(known[-1] - known[0]), 0.0) if runs else 0.0


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


def time_unit(clock: Array) -> str:
    """The unit of the readings (n,) of a clock, where one only is likely; else empty. Recorders of joints have rates
    from 50 to 5000 Hz, less than a factor of 1000 apart: a reading fits them in one unit only. Readings that rise by
    one may count rows, or be the whole seconds of stamps in two parts."""
    rate = rate_of(clock)
    if rate is None or clock.size < 20 or np.isin(np.diff(clock), (0, 1)).all():
        return ""
    units = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
    return next((unit for unit, in_s in units.items() if 50.0 <= rate * in_s <= 5000.0), "")


def listed(
    at: Mapping[str, str], own: str, values: NDArray[Any], is_time: bool, unit: str = "", kind: str = "", also: str = ""
) -> RecordedChannel:
    """A column by those of its readings that are numbers, (n,): its range, or as a clock its rate and gaps. `own` is
    its name without its place, `unit` what the file states, `also` a remark for the user."""
    numbers = values.astype(np.float64)
    known = numbers[np.isfinite(numbers)]
    note = f"from {known.min():.6g} to {known.max():.6g}" if known.size else "no numbers"
    rate, guess = rate_of(known) if is_time else None, "" if unit else likely_unit(own)
    if is_time:
        note, gaps = f"a clock, {rate:g} per unit" if rate else "a clock that stands still", gaps_text(known)
        note += f", {gaps}" * bool(gaps)
    guess = guess or (time_unit(known) if is_time and not unit else "")
    lost = f", {numbers.size - known.size} x NaN or infinity" * (known.size < numbers.size)
    count, said = int(known.size), f"{note}{lost}{also}"
    return RecordedChannel(next(iter(at)), at, unit, count, None, said, kind, guess, numbers=numbers)


def time_setting(key: str, clock: RecordedChannel | None) -> dict[str, str]:
    """The field `time` of a source file, by the clock that the draft names."""
    if clock is None:
        return {key: NAME_OF_TIME, "unit": UNKNOWN}
    return {key: clock.address[key], "unit": clock.unit or clock.likely_unit or UNKNOWN}


def inspect_csv(path: Path) -> Overview:
    """Columns with unit, range and words, read by a guess at the layout: text of which more than half of the rows hold
    no number is no table."""

    def seems_number(cell: str) -> bool:
        return csv_table.is_number_cell(cell.replace(",", "."))

    lines = csv_table.read_lines(path)
    content = [(line, text) for line, text in lines if not text.lstrip().startswith("#")]
    delimiter = csv_table.delimiter_of(content, "auto")
    rows = csv_table.split_rows(content, delimiter)
    if not rows:
        raise InputError("holds no rows; check that it is a recording")
    headed = not all(seems_number(cell) for cell in rows[0][1] if cell)
    below = rows[1][1] if headed and len(rows) > 1 else []
    known = [bool(cell) and is_unit(csv_table.without_brackets(cell)) and cell != "1" for cell in below]
    has_units = not any(map(seems_number, below)) and sum(known) > len(below) / 2
    body = rows[headed + has_units :]
    if headed:
        csv_table.check_header_place(rows[0], body)
    prose = [row for row in body if not any(map(seems_number, row[1]))]
    if len(prose) > len(body) / 2:
        raise InputError(
            f"no table of numbers: {len(prose)} of {len(body)} rows hold none, such as line {prose[0][0]}, "
            f"'{' '.join(prose[0][1])[:40]}'; name a recording, or write a header and a row per sample"
        )
    layout = csv_table.CsvLayout(delimiter, header="row" if headed else "none", units_row=has_units, most_missing=1.0)
    table = csv_table.table_of(lines, replace(layout, ragged="skip"))
    titles, cells = table.names, table.body.get_columns()
    values = [one.str.replace(",", ".", literal=True).cast(pl.Float64, strict=False) for one in cells]
    readings = {title: one.drop_nulls().to_numpy() for title, one in zip(titles, values, strict=True)}
    clock, left_open = clock_of("columns", readings, csv_table.is_clock, dict(zip(titles, table.units, strict=True)))
    channels, failed = [], dict.fromkeys(csv_table.CsvLayout.missing)
    for title, unit, text, numbers in zip(titles, table.units, cells, values, strict=True):
        # of an object without a name Python prints its number, which changes from run to run; the pattern fits the next
        # recording too, where only this column of the file fits it
        name = csv_table.name_and_unit(title)[0]
        pattern = re.sub(r"<[^<>]* object at 0x[0-9a-fA-F]+>", "*", name)
        lasting = pattern if pattern != name and len(csv_table.places_of(pattern, titles)) == 1 else name
        words = Counter(text.filter(numbers.is_null()).to_list()).most_common(5)
        also = "".join(f", {count} x '{word}'" for word, count in words)
        failed |= {str(word): None for word, count in words if count < len(text) / 100}  # of readings that failed
        found = listed({"column": lasting}, title, readings[title], title == clock, unit, also=also)
        channels.append(replace(found, numbers=numbers.fill_null(np.nan).to_numpy()))
    settings = {
        "clock": "master",
        "delimiter": {sign: word for word, sign in csv_table.DELIMITERS.items()}.get(delimiter, delimiter),
        **({} if headed else {"header": "none"}),
        **({"units_row": True} if has_units else {}),
        **({"decimal": ","} if delimiter != "," and any("," in c for _, row in body[:5] for c in row) else {}),
        **({"missing": [*failed]} if len(failed) > len(csv_table.CsvLayout.missing) else {}),
        "time": time_setting("column", None if clock is None else channels[titles.index(clock)]),
    }
    facts = {"rows": str(len(table.lines)), "delimiter": repr(delimiter), "header": "yes" if headed else "none"}
    facts |= {f"comment {i + 1}": text for i, text in enumerate(table.comments[:20])}
    named = {one.address["column"]: one.likely_unit for one in channels}
    remarks = [*table.damage.remarks, *guesses({name: unit for name, unit in named.items() if likely_unit(name)})]
    return Overview("csv", facts, channels, remarks, settings, open=left_open)


def inspect_json(path: Path) -> Overview:
    """Every number in the lines, with its range, and the likely clock."""
    lines = read_json_lines(path)
    names, long = addresses_of(lines)
    if not names:
        raise InputError("no line holds a number; name a recording")
    decoded = decode_lines(lines, names)
    numbers = {name: np.ma.compressed(values) for name, values in decoded.values.items()}
    pairs = ((name.rpartition(".")[0], logs.stamp_fields(name.rpartition(".")[0])) for name in names if "." in name)
    stamps = {stamp: pair for stamp, likely in pairs for pair in likely if {*pair} <= {*names}}
    stamp = min(stamps, key=lambda name: name.count("."), default="")
    drafted = [name for name in numbers if name not in stamps.get(stamp, ())]
    own = {name: numbers[name] for name in drafted if not stamp or csv_table.is_clock(last_name(name))}
    clock, left_open = clock_of("fields", own, lambda name: csv_table.is_clock(last_name(name)), {})
    channels = {}
    for name, one in numbers.items():
        also = f", in {one.size} of {decoded.rows.size} lines" * (one.size < decoded.rows.size)
        found = listed({"field": name}, last_name(name), one, name == clock, kind=one.dtype.name, also=also)
        channels[name] = replace(found, numbers=np.ma.filled(decoded.values[name].astype(np.float64), np.nan))
    remarks = lines.damage.remarks
    remarks += [f"{name} has {size} elements; only the first {MOST_ELEMENTS} are listed" for name, size in long.items()]
    remarks += guesses({name: one.likely_unit for name, one in channels.items() if likely_unit(last_name(name))})
    time = time_setting("field", channels[clock] if clock else None)
    settings = {"clock": "master", "time": {"field": stamp} if stamp and not clock and not left_open else time}
    signals, facts = [channels[name] for name in drafted], {"rows": str(len(lines.texts))}
    return Overview("json_lines", facts, [*channels.values()], remarks, settings, signals, left_open)


def variables_in(part: str, name: str, value: Value) -> Iterator[tuple[str, str, str, Value]]:
    """What is no struct and no cell in a variable: the address of what it is in, its name, its address, its value."""
    address = f"{part}{'.' * (bool(part) and not name.startswith('{'))}{name}"
    if value.elements:
        for number, fields in enumerate(value.elements, start=1):
            inside = f"{address}({number})" if len(value.elements) > 1 else address
            for own in fields:
                yield from variables_in(inside, own, fields[own])
    elif value.kind == "cell" and value.cells:
        for number, cell in enumerate(value.cells, start=1):
            yield from variables_in(address, f"{{{number}}}", cell)
    else:
        yield part, name, address, value


def inspect_mat(path: Path) -> Overview:
    """Variables, fields and cells with size, range and likely unit; what cannot be read; parts that are alike."""
    file, most = open_mat(path), 500
    variables = [one for name, value in file.read(file.names).items() for one in variables_in("", name, value)]
    facts = {"version": file.version, "header": file.header, "variables": str(len(file.names))}
    remarks = [
        f"{address} is a {value.described()}, which is not read; {value.remedy()}"
        for _, _, address, value in variables
        if value.numbers is None and value.kind not in ("char", "struct", "cell")
    ]
    remarks += [f"and {len(variables) - most} more variables"] * (len(variables) > most)
    by_part: dict[str, dict[str, Value]] = {}
    for part, name, _, value in variables:
        if is_signal(value):
            by_part.setdefault(part, {})[name] = value
    groups: dict[tuple[str, ...], dict[str, dict[str, Value]]] = {}  # the parts that hold the same signals
    for part, own in by_part.items():
        groups.setdefault(tuple(own), {})[part] = own
    alike = max(groups.values(), key=lambda group: sum(map(len, group.values())), default={})
    drafted, part = next(iter(alike.values()), {}), next(iter(alike), "") if len(alike) == 1 else ""
    single = {name: one.numbers.ravel() for name, one in drafted.items() if one.numbers is not None and 1 in one.shape}
    clock, left_open = clock_of("variables", single, lambda name: seems_clock(name, drafted[name]), {})
    if len(alike) > 1:
        parts = listing([printable(one) for one in alike], 40)
        what = f"{len(alike)} parts hold the same variables: name one per trial in the column `log_part` of the sheet"
        left_open = [f"{what}: {parts}", *left_open]
    time = time_setting("variable", variable_channel(clock, clock, drafted[clock], True) if clock else None)
    settings = {"clock": "master", **({"log_part": part} if part else {}), "time": time}
    channels, signals = [variable_channel(address, name, value) for _, name, address, value in variables[:most]], []
    for name, value in drafted.items():  # each column of a matrix, or row if it has more columns
        rows, columns = value.shape
        lines = [f"(:,{k + 1})" for k in range(columns)] if rows >= columns else [f"({k + 1},:)" for k in range(rows)]
        for place, line in enumerate(lines if min(rows, columns) > 1 else [""]):
            numbers = np.empty(0) if value.numbers is None else value.numbers.astype(np.float64)
            each = numbers.ravel() if not line else numbers[:, place] if rows >= columns else numbers[place]
            signals.append(replace(variable_channel(f"{name}{line}", name, value, name == clock), numbers=each))
    return Overview("mat", facts, channels, remarks, settings, signals, left_open)


def is_signal(value: Value) -> bool:
    """Whether a variable may be a signal: a vector of real numbers, or a matrix of columns."""
    return value.numbers is not None and len(value.shape) == 2 and max(value.shape) >= 10


def seems_clock(name: str, value: Value) -> bool:
    """Whether the name of a signal is or begins as that of a clock: `t`, `time_ms`, `timeJIM`."""
    likely = re.match(r"(time|t|stamp|clock)(?![a-z])|time", name, re.IGNORECASE)
    return is_signal(value) and (csv_table.is_clock(name) or likely is not None)


def variable_channel(address: str, name: str, value: Value, is_time: bool | None = None) -> RecordedChannel:
    readings = np.empty(0) if value.numbers is None else value.numbers.ravel()
    is_time = seems_clock(name, value) if is_time is None else is_time
    found = listed({"variable": address}, name, readings, is_time, value.unit, kind=value.described())
    return replace(found, count=value.size, note=found.note if readings.size else f"'{value.text}'" * bool(value.text))


def inspect_tdms(path: Path) -> Overview:
    """Channels with unit, range and rate by their own timing."""
    file = read_tdms(path)
    remarks, numbers = list(file.damage.remarks), dict[str, NDArray[Any]]()
    for one in file.channels:
        try:
            numbers |= file.values([one]) if one.count and (one.holds_numbers or one.holds_times) else {}
        except InputError as error:
            remarks.append(str(error))
    stamps = [one.address for one in file.channels if one.holds_times and one.count]
    timed, names = any(one.step is not None for one in file.channels), {one.address: one.name for one in file.channels}
    units = {one.address: one.unit for one in file.channels}
    clock, left_open = None, list[str]()
    if not timed:
        clock, left_open = clock_of("channels", numbers, lambda one: csv_table.is_clock(names[one]), units)
        clock = clock or (None if left_open else next(iter(stamps), None))
    channels = {}
    for one in file.channels:
        unit, values = "s" if one.address in stamps else one.unit, numbers.get(one.address, np.empty(0))
        address, is_time = {"channel": one.address}, one.address == clock
        found = listed(address, one.name, values, is_time, unit, np.dtype(one.kind).name)
        rate, times = (1 / one.step, one.step * np.arange(values.size, dtype=np.float64)) if one.step else (None, None)
        channels[one.address] = replace(found, count=one.count, rate=rate, times=times)
    time = {} if timed else {"time": time_setting("channel", channels[clock] if clock else None)}
    facts = {"channels": str(len(file.channels)), "own timing": "yes" if timed else "no", **file.properties}
    drafted = [channels[one.address] for one in file.channels if one.count and one.holds_numbers]
    return Overview("tdms", facts, [*channels.values()], remarks, {"clock": "master", **time}, drafted, left_open)


def inspect_opensim(path: Path) -> Overview:
    """Columns with range and likely unit: by its name, by what OpenSim calls forces, or of an angle by `inDegrees`."""
    table = read_opensim(path)
    numbers, remarks = dict[str, NDArray[Any]](), list[str]()
    for name in dict.fromkeys(table.names):
        try:
            numbers[name] = table.column(name)
        except InputError as error:
            remarks.append(str(error))
    clock, left_open = clock_of("columns", numbers, lambda name: csv_table.is_clock(name.rpartition(".")[2]), {})
    endings = {"force.*_v[xyz]": "N", "force.*_p[xyz]": "m", "(torque|moment).*_[xyz]|_moment": "N*m", "_t[xyz]": "m"}
    channels = {}
    for name, values in numbers.items():
        known = [unit for ending, unit in endings.items() if re.search(f"({ending})$", name, re.IGNORECASE)]
        guess = "" if name == clock else likely_unit(name) or (known[0] if known else table.angles)
        channels[name] = replace(listed({"column": name}, name, values, name == clock), likely_unit=guess)
    remarks += guesses({name: one.likely_unit for name, one in channels.items()})
    facts = {"rows": str(len(table.rows))} | {key: value for key, value in table.header.items() if value}
    settings = {"clock": "master", "time": {"column": clock or NAME_OF_TIME, "unit": "s" if clock else UNKNOWN}}
    # the plates that the names of columns tell, as a source file has them but for their corners
    triples = {name[:-1] for name in table.names if {f"{name[:-1]}{axis}" for axis in "xyz"} <= {*table.names}}
    plates: list[str] = []
    for name in table.names:
        force, stem = name[:-1], name[:-2]  # `R_ground_force_v`; of `R_ground_force_` is the moment `R_ground_torque_`
        moments = {re.sub("force", word, stem): None for word in ("torque", "moment")} if name.endswith("vx") else {}
        moment = next((one for one in moments if one != stem and one in triples), None)
        if moment is not None and {force, f"{stem}p"} <= triples:
            keys = {"force": force, "point": f"{stem}p", "moment": moment}
            text = ", ".join(f"{key}: {json.dumps(begin)}" for key, begin in keys.items())
            plates.append(f"{len(plates) + 1}: {{{text}, corners: {UNKNOWN}}}")
    note = f"these columns are force plates, if you state their corners: plates: {{{', '.join(plates)}}}"
    left_open += [printable(note)] * bool(plates)
    return Overview("opensim", facts, list(channels.values()), remarks, settings, open=left_open)


ROS_UNITS = {
    "sensor_msgs/JointState": {"position": "rad", "velocity": "rad/s", "effort": "N*m"},
    "geometry_msgs/Wrench": {"force": "N", "torque": "N*m"},
    "geometry_msgs/WrenchStamped": {"wrench.force": "N", "wrench.torque": "N*m"},
}
"""Units of standard messages of ROS (REP 103), by the beginning of the field. A joint that slides has other ones."""


def inspect_messages(name: str, path: Path) -> Overview:
    """Topics with schema, encoding, rate, gaps and readings by log time, every field of each, and what is damaged."""
    file = logs.OPENERS[name](path)
    surveys, remarks = read_channels(file), list(file.damage.all_remarks())
    channels, source = list[RecordedChannel](), "log"
    for survey in surveys:
        fields, reason = list[FieldDescription](), ""
        for message in dict.fromkeys([survey.first, None]):  # by the first message, or else by the schema
            try:
                fields = describe_message(survey.channel, survey.schema, message)
                if fields or not reason:  # JSON has no schema to tell what a message does not
                    break
            except (ValueError, RecursionError) as error:
                reason = reason or " ".join(str(error).split()).removeprefix(f"topic '{survey.channel.topic}': ")
        else:
            remarks.append(f"topic '{survey.channel.topic}': its fields cannot be listed: {reason}")
        channels += topic_channels(survey, fields)
        source = "header" if any(one.path.startswith("header.stamp") for one in fields) else source
    damage, lost = file.damage, file.damage.lost()
    facts = {"bytes": str(file.size), "chunks": str(damage.chunks), "messages": str(damage.messages)}
    facts |= {"messages lost": "the file does not tell" if lost is None else str(lost), "checksums": damage.crc()}
    wanted = dict[str, list[str]]()
    for one in (one for one in channels if "field" in one.address and one.count):
        wanted.setdefault(one.address["topic"], []).append(one.address["field"])
    with suppress(InputError):  # where a field of some message is no number, none has readings
        decoded = decode_topics(logs.OPENERS[name](path), wanted, [field for own in wanted.values() for field in own])
        for place, one in enumerate(channels):
            topic, field = (*one.address.values(), "")[:2]
            if topic in decoded and field in decoded[topic].values:
                numbers = np.ma.filled(decoded[topic].values[field].astype(np.float64), np.nan)
                channels[place] = replace(one, numbers=numbers, times=decoded[topic].log_time / logs.SECOND)
    return Overview(name, facts, channels, remarks, {"clock": "master", "time": {"source": source}})


def topic_channels(survey: ChannelLog, fields: Sequence[FieldDescription]) -> Iterator[RecordedChannel]:
    """A topic's numbers, one by one as a source file names them; the topic alone where there are none."""
    topic, kind, units = survey.channel.topic, survey.channel.message_encoding, dict[str, str]()
    if survey.schema:
        kind, units = f"{survey.schema.name} ({kind})", ROS_UNITS.get(survey.schema.name.replace("/msg/", "/"), {})
    count, stamps = survey.log_time.size, (survey.log_time - survey.log_time[:1].sum()) / logs.SECOND
    rate, timing = rate_of(stamps), gaps_text(stamps) or "empty" * (not count)
    # every message of ROS has a header, and no signal is in it
    numbers = [(path, one) for one in fields if not one.path.startswith("header.") for path in one.addresses()]
    for path, one in numbers:
        unit = next((unit for begin, unit in units.items() if path.startswith(begin)), "")
        of_type, at = one.type if one.length is None else f"{one.type}[{one.length}]", {"topic": topic, "field": path}
        timed = (0, None) if one.length == 0 else (count, rate)
        yield RecordedChannel(kind, at, "", *timed, timing, of_type, unit)
    if not numbers:
        yield RecordedChannel(kind, {"topic": topic}, "", count, rate, timing)


def inspect_c3d(path: Path) -> Overview:
    """Markers with the share of frames in which they were seen, model outputs, analog channels and plates."""
    recording = read_c3d(path)
    header, unit, labels = recording.header, recording.point_unit(), recording.analog_labels
    channels, rate = [], header.rate * header.samples_per_frame
    for label, positions in zip(recording.point_labels, recording.points.transpose(1, 0, 2), strict=False):
        of_kind = ("model output", "") if label in recording.model_outputs else ("marker", unit)
        channels.append(marker_channel(label, positions, header.rate, *of_kind))
    for place, (label, values) in enumerate(zip(labels, recording.analogs.T, strict=False)):
        low, high, own = values.min(), values.max(), recording.analog_unit(place)
        note = f"from {low:.6g} to {high:.6g}" if low != high else f"always {low:.6g}"
        channels.append(RecordedChannel("analog", {"channel": label}, own, values.size, rate, note))
    plates = plate_count(header)
    channels += [plate_channel(recording, number) for number in range(1, plates + 1)]
    facts = {
        "frames": f"{header.frames}, from {header.first_frame} on, at {header.rate:g} Hz",
        "unit of length": unit or "none",
        "force plates": str(plates),
        "vertical on screen": "".join(header.texts("POINT:Y_SCREEN")[:1]) or "not said",
        "software": " ".join(header.texts("MANUFACTURER:SOFTWARE")) or "not said",
    }
    return Overview("c3d", facts, channels, settings={"plates": "all" if plates else "none"})


def marker_channel(label: str, positions: Array, rate: float, kind: str, unit: str) -> RecordedChannel:
    """A marker or a model output by its positions, (frames, 3), NaN where it was not seen."""
    seen = ~np.isnan(positions).any(axis=1)
    missing = 1.0 - float(seen.mean())
    note = f"missing in {missing:.1%} of the frames" if missing else ""
    centre = tuple(positions[seen].mean(axis=0).tolist()) if seen.any() else ()
    return RecordedChannel(kind, {"label": label}, unit, int(seen.sum()), rate, note, numbers=positions, centre=centre)


def plate_channel(recording: C3DRecording, number: int) -> RecordedChannel:
    """A plate with its type and channels, the range of its force [N] and its middle, as far as they can be known."""
    load, size, centre = None, None, tuple[float, ...]()
    try:
        kind = int(plate_parameter(recording, "TYPE", number))
        own = plate_parameter(recording, "CHANNEL", number, (0,)).astype(int).tolist()
        note = f"type {kind}, analog channels {own}"
    except InputError as error:
        note = str(error)
    with suppress(InputError):
        corners = plate_parameter(recording, "CORNERS", number, (3, 4)).mean(axis=1)
        source = SOURCES["c3d"].model_validate({"format": "c3d", "plates": [number]})
        ((columns, _, _),) = plate_loads(recording, source)
        size = np.linalg.norm([columns[name] for name in plate_columns(number, "force")], axis=0)
        load, centre = float(np.ptp(size)), tuple(corners.tolist())
        note += f", force changes by {load:.0f} N"
    return RecordedChannel("plate", {"plate": str(number)}, note=note, load=load, numbers=size, centre=centre)


def inspect_nexus(path: Path) -> Overview:
    """The sections' columns: one per trajectory, and per component of anything else."""
    facts, channels = {}, []
    for title, section in read_sections(path).items():
        facts[title] = f"{len(section.rows)} rows at {section.rate:g} Hz"
        kind = {"Trajectories": "marker", "Model Outputs": "model output"}.get(title, "device")
        for place, (name, component) in enumerate(zip(section.names, section.components, strict=True)):
            if not name or (kind == "marker" and component.casefold() != "x"):
                continue
            address = {"label": name} if kind == "marker" else {"device": name, "component": component}
            lacking, unit = np.isnan(section.values(place)), section.units[place]
            missing, seen = float(lacking.mean()), int((~lacking).sum())
            note = f"missing in {missing:.1%} of the rows" if missing else ""
            channels.append(RecordedChannel(kind, address, unit, seen, section.rate, note))
    return Overview("nexus_csv", facts, channels)


def inspect_trc(path: Path) -> Overview:
    """Markers with the share of frames in which they were seen."""
    file = read_trc(path)
    upward, positions = vertical_axis(file.positions), file.positions.transpose(1, 0, 2)
    facts = {
        "frames": f"{len(file.positions)}, from {file.first_frame} on, at {file.rate:g} Hz",
        "unit of length": file.unit or "none",
        "time of the first frame": f"{file.start:g} s",
        "vertical axis": upward or "not told by the markers",
    }
    markers = zip(file.labels, positions, strict=True)
    channels = [marker_channel(label, one, file.rate, "marker", file.unit) for label, one in markers]
    return Overview("trc", facts, channels, file.damage.remarks, {"axes": ["x", "-z", "y"]} if upward == "y" else {})
