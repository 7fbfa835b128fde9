"""What a file holds: channels with ranges, rates and gaps, what is odd, and what names tell of
clocks and units."""

import json
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
from osl_analysis.ingest import logs
from osl_analysis.ingest.captures import plate_count, plate_loads, plate_parameter, vertical_axis
from osl_analysis.ingest.source import NAME_OF_TIME, UNKNOWN, C3dSource
from osl_analysis.old_formats import csv_table
from osl_analysis.old_formats.binary_table import titles_of_columns
from osl_analysis.old_formats.c3d import C3DRecording, read_c3d
from osl_analysis.old_formats.gait_text import opensim_header, read_sections, read_trc
from osl_analysis.old_formats.json_lines import (
    MOST_ELEMENTS,
    addresses_of,
    decode_lines,
    read_json_lines,
)
from osl_analysis.old_formats.mat import Value, address_with, open_mat
from osl_analysis.old_formats.message_fields import FieldDescription, describe_message, last_name
from osl_analysis.old_formats.messages import ChannelLog, decode_topics, read_channels
from osl_analysis.old_formats.table import Ledger
from osl_analysis.old_formats.tdms import read_tdms
from osl_analysis.trial import Array, plate_columns


@dataclass(frozen=True)
class RecordedChannel:
    # What it is: marker, model output, analog, plate, device, column, or the type of a topic's
    # messages.
    kind: str
    # How a source file names it: `topic` and `field`, `column`, `channel`, `label` ...
    address: Mapping[str, str]
    unit: str = ""  # unit of the numbers, as the file spells it; empty where it gives none
    count: int = 0
    rate: float | None = None  # median rate [Hz]; None where nothing tells it
    note: str = ""  # remark for the user
    # type of the numbers and the length of the array that they stand in, such as `float64[4]`
    type: str = ""
    # what its name or its readings tell of its unit; a guess, for the user to check
    likely_unit: str = ""
    # readings, positions, size of a force [N]
    numbers: Array | None = field(default=None, compare=False, repr=False)
    # of its readings [s]; None: those of the rows
    times: Array | None = field(default=None, compare=False, repr=False)
    name: str = ""  # without its place, as a table's column may tell a clock or a unit by it

    @property
    def key(self) -> str:
        """What a source file calls it."""
        return next(iter(self.address.values()))


@dataclass(frozen=True)
class Overview:
    format: str  # the format's name in source files
    facts: Mapping[str, str]  # facts about the whole file
    channels: Sequence[RecordedChannel]  # what it recorded, in the order of the file
    remarks: Sequence[str] = ()  # damage and oddities, a sentence each
    # fields of a source file that the file tells
    settings: Mapping[str, object] = field(default_factory=dict)
    # those of the draft, where it has one trial of several
    drafted: Sequence[RecordedChannel] | None = None
    # what the user decides, as which of its clocks counts, a sentence each
    open: Sequence[str] = ()


def likely_clock(
    readings: Mapping[str, NDArray[Any]], what: str = "columns"
) -> tuple[str | None, list[str]]:
    """The clock that a draft names, and what the user has to decide, from the readings (n,) of all
    that are called so. The first of several, if they span the same time in s, ms, us or ns: within
    0.5 %, which puts I wrong by 1 %. None if they contradict each other, as then B and I depend on
    the choice. What does not run, or stands still in most rows, is no clock beside others."""
    clocks = {name: values.astype(np.float64) for name, values in readings.items()}
    spans = {name: span_of(values) for name, values in clocks.items()}
    running = [name for name, span in spans.items() if span > 0] or list(readings)
    # in how many rows
    risen = {name: np.count_nonzero(np.diff(clocks[name]) > 0) for name in running}
    # else of whole seconds
    running = [name for name in running if 2 * risen[name] > clocks[name].size] or running
    if len(running) < 2:
        return next(iter(running), None), []
    count, first, most = f"{len(running)} {what} may be the clock", running[0], 6
    if all(span_alike(clocks[name], clocks[first]) for name in running):
        named = listing([printable(name) for name in running], most)
        return first, [f"{count}, to be checked: {named}; {printable(first)} is taken"]
    named = listing([f"{printable(name)} spans {spans[name]:.6g}" for name in running], most)
    return None, [
        f"{count}, and they contradict each other: {named}; name the one by which the signals were"
        " sampled"
    ]


def span_alike(clock: Array, other: Array) -> bool:
    """Whether two clocks (n,) span the same time, where both have readings, in s, ms, us or ns:
    within 0.5 %."""
    if clock.shape == other.shape:
        known = np.isfinite(clock) & np.isfinite(other)
        clock, other = clock[known], other[known]
    one, two = span_of(clock), span_of(other)
    return abs(logs.span_ratio(one, two, ()) - 1) <= 0.005 if min(one, two) > 0 else one == two


def clock_of(
    what: str, readings: Mapping[str, NDArray[Any]], named: Sequence[str], units: Mapping[str, str]
) -> tuple[str | None, list[str]]:
    """The likely clock of a table's columns by address, the shortest first, and what the user has
    to decide: among those that are `named` like a clock, unless another one that tells time
    contradicts it, or else among those that rise as one, a guess. `units` are those that it
    states."""
    shortest = sorted(readings, key=lambda name: name.count("."))
    rising = {
        name: readings[name] for name in shortest if logs.ticks(readings[name], units.get(name, ""))
    }
    if named:
        clock, left_open = likely_clock(
            {name: readings[name] for name in shortest if name in named}, what
        )
        span = 0.0 if clock is None else span_of(readings[clock].astype(np.float64))
        others = {
            name: one
            for name, one in rising.items()
            if span and logs.tells_time(name, units.get(name, ""))
        }
        others = {
            name: one
            for name, one in others.items()
            if abs(logs.span_ratio(span_of(one), span) - 1) > 0.005
        }
        return (
            likely_clock({str(clock): readings[str(clock)], **others}, what)
            if others
            else (clock, left_open)
        )
    clock, left_open = likely_clock(rising, what)
    if clock is not None and not left_open:
        step, unit = (
            float(np.median(np.diff(rising[clock]))),
            units.get(clock) or logs.time_unit(rising[clock]),
        )
        left_open = [f"time is a guess: {printable(clock)} rises by {step:.4g} {unit} a row"]
    return clock, left_open


def span_of(values: Array) -> float:
    """Last minus first of the readings (n,) of a clock, in its unit; 0 if a tenth of the steps go
    back."""
    known = values[np.isfinite(values)]
    runs = known.size > 1 and float(np.mean(np.diff(known) >= 0)) > 0.9
    return max(float(known[-1] - known[0]), 0.0) if runs else 0.0


def gaps_text(time: Array) -> str:
    """Gaps, steps of more than 1.5 usual ones, stamps that go back and repeated ones, in words;
    empty if none."""
    steps = np.diff(np.sort(time))
    usual = float(np.median(steps)) if steps.size else 0.0
    wide = steps[steps > 1.5 * usual] if usual > 0 else steps[:0]
    oddities = [f"{wide.size} gaps, the longest {wide.max():.3f} s"] if wide.size else []
    counts = {"out of order": int((np.diff(time) < 0).sum()), "twice": int((steps == 0).sum())}
    return ", ".join(
        [*oddities, *(f"{count} stamps {what}" for what, count in counts.items() if count)]
    )


def column(
    address: Mapping[str, str],
    name: str,
    values: NDArray[Any],
    unit: str = "",
    kind: str = "",
    also: str = "",
    likely: str = "",
    count: int | None = None,
) -> RecordedChannel:
    """A column of a table by its readings (rows,), NaN or masked where there is none. Its name,
    without its place, may tell its unit, else `likely` does; `also`: a remark; `count`: of what it
    holds, where that is not its numbers."""
    numbers = np.ma.compressed(values).astype(np.float64)
    known = numbers[np.isfinite(numbers)]
    lost = f", {numbers.size - known.size} x NaN or infinity" * (known.size < numbers.size)
    note = f"from {known.min():.6g} to {known.max():.6g}" if known.size else "no numbers"
    note, guess = (
        f"{note}{lost}{also}" * bool(values.size),
        "" if unit else logs.likely_unit(name) or likely,
    )
    filled = np.ma.filled(np.ma.asarray(values).astype(np.float64), np.nan)
    count = int(known.size) if count is None else count
    return RecordedChannel(
        next(iter(address)), address, unit, count, None, note, kind, guess, filled, name=name
    )


def as_clock(channel: RecordedChannel) -> RecordedChannel:
    """A column as the clock of its table: its rate and gaps."""
    assert channel.numbers is not None
    known = channel.numbers[np.isfinite(channel.numbers)]
    rate, gaps = logs.rate_of(known), gaps_text(known)
    note = (
        f"a clock, {rate:g} per unit" if rate else "a clock that stands still"
    ) + f", {gaps}" * bool(gaps)
    likely = "" if channel.unit else logs.likely_unit(channel.name) or logs.time_unit(known)
    return replace(channel, note=note, likely_unit=likely)


def overview_of(
    name: str,
    columns: Sequence[RecordedChannel],
    what: str,
    called: Callable[[str], bool] = csv_table.is_clock,
    drafted: Sequence[RecordedChannel] | None = None,
    timing: Mapping[str, object] | None = None,
    left_open: Sequence[str] = (),
    facts: Mapping[str, str] | None = None,
    remarks: Sequence[str] = (),
    settings: Mapping[str, object] | None = None,
    clock: str | None = None,
) -> Overview:
    """What a table holds, the same for every format: its channels, the likely clock among those
    that a draft has, what is guessed. `called`: whether a column is called like a clock; `timing`,
    `clock`: `time` and its column if known."""
    offered, questions = columns if drafted is None else drafted, list(left_open)
    if timing is None or clock is not None:
        own = {one.key: one for one in offered if one.numbers is not None and one.numbers.size}
        named = [
            key for key, one in own.items() if (called(one.name) if clock is None else key == clock)
        ]
        units = {key: one.unit for key, one in own.items()}
        given = clock
        clock, asked = clock_of(
            what, {key: np.asarray(one.numbers) for key, one in own.items()}, named, units
        )
        timing = timing if clock == given else None
        questions += asked
    shown = [as_clock(one) if one.key == clock else one for one in columns]
    signals = (
        None if drafted is None else [as_clock(one) if one.key == clock else one for one in drafted]
    )
    if timing is None:
        time = next((one for one in signals or shown if one.key == clock), None)
        key = next(iter(columns[0].address)) if columns else "column"
        unit = UNKNOWN if time is None else time.unit or time.likely_unit or UNKNOWN
        timing = {"time": {key: NAME_OF_TIME if time is None else time.address[key], "unit": unit}}
    units = {
        one.key: one.likely_unit for one in shown if one.key != clock or logs.likely_unit(one.name)
    }
    told = ", ".join(f"{key} [{unit}]" for key, unit in units.items() if unit)
    guesses = [f"units guessed from the names, to be checked: {told}"] * bool(told)
    stated = {"clock": "master", **(settings or {}), **timing}
    return Overview(name, facts or {}, shown, [*remarks, *guesses], stated, signals, questions)


# written as no table is read, unlike Windows' `1.#QNAN`
OTHER_NUMBER = re.compile(r"[+-]?\d[^#]*$")
# what a text says of a counter without a unit
TICK = re.compile(r"(?i)\bticks?\b\D*(\d+) ?([nuµm]?s)\b")
MOST_ROWS = 200_000  # of a long table at which an overview looks


def inspect_table(name: str, path: Path) -> Overview:
    """Columns with unit, range and words. Of a long table the first rows and the last ones are
    looked at."""
    layout = csv_table.CsvLayout(ragged="skip", most_missing=1.0)
    table = logs.read_any_table(name, path, layout, MOST_ROWS)
    columns, failed, times, is_anew = (
        [],
        dict.fromkeys(layout.missing),
        list[RecordedChannel](),
        False,
    )
    angles = {"yes": "deg", "no": "rad"}.get(
        opensim_header(table.comments).get("indegrees", "").casefold(), ""
    )
    tick = next(
        (f"{told[1]} {told[2]}" for text in table.comments if (told := TICK.search(text))), ""
    )
    for place, (title, unit) in enumerate(zip(table.names, table.units, strict=True)):
        cells = table.body.to_series(place)
        cells = cells.drop_nulls() if table.is_padded else cells
        stamps = csv_table.cell_stamps(cells)
        numbers = readable_numbers(cells, table.decimal) if stamps is None else stamps
        words = Counter[str]()
        if cells.dtype == pl.String and stamps is None:
            words = Counter(cells.filter(pl.Series(np.isnan(numbers))).drop_nulls().to_list())
        few = (word for word, count in words.items() if count < len(cells) / 100)
        failed |= dict.fromkeys(
            word for word in few if word != title and not OTHER_NUMBER.match(word)
        )
        is_anew |= title in words
        also = "".join(f", {count} x '{word}'" for word, count in words.most_common(5))
        address = {"column": lasting_address(title, place, table.names)}
        unit = unit or (tick if tick and logs.ticks(numbers, tick) else "")
        forces = (
            one for ending, one in FORCES.items() if re.search(f"({ending})$", title, re.IGNORECASE)
        )
        likely = next(forces, angles) if name == "opensim" else ""
        unit = unit if stamps is None else "ns"
        own = column(address, title, np.ma.masked_invalid(numbers), unit, also=also, likely=likely)
        columns.append(own)
        times += [own] * (stamps is not None)
    named = [one.key for one in times if csv_table.is_clock(one.name)]
    clock = named[0] if named else times[0].key if len(times) == 1 else None
    timing: dict[str, object] | None = {"time": {"column": clock}} if clock else None
    left_open = [*table.not_read]
    if not clock and not any(
        logs.ticks(np.asarray(one.numbers), one.unit) for one in columns if one.count
    ):
        timing, asked = timing_by_words(table.comments, columns)
        left_open += asked
    if is_anew:
        failed, anew = {}, "the header stands again among the rows, as where a recorder begins anew"
        left_open = [*left_open, f"{anew}: cut the file in two, a log each"]
    settings: dict[str, object] = (
        {"missing": [*failed]} if len(failed) > len(layout.missing) else {}
    )
    if skipped := table.damage.indexed_lost.total():
        settings |= {
            "ragged": "skip",
            "most_missing": csv_table.share_above(skipped, skipped + len(table.lines)),
        }
    is_long = len(table.lines) >= MOST_ROWS
    if is_long:
        settings.pop("missing", None)
    facts = {"rows": f"{len(table.lines)}{', of more' * is_long}"}
    facts |= {"delimiter": repr(table.delimiter)} if table.delimiter else {}
    facts |= end_of(table.damage)
    facts |= {f"comment {i + 1}": text for i, text in enumerate(table.comments[:20])}
    return overview_of(
        name, columns, "columns", timing=timing, left_open=left_open, facts=facts,
        remarks=table.damage.remarks, settings=settings, clock=clock,
    )  # fmt: skip


def end_of(damage: Ledger) -> dict[str, str]:
    """What a file that does not tell its end is said to lack."""
    return (
        {"end": "not told by the file: whether rows are missing there is not known"}
        if damage.end_unknown
        else {}
    )


def readable_numbers(cells: pl.Series, decimal: str) -> Array:
    """The cells that are numbers, NaN elsewhere."""
    if cells.dtype == pl.String:
        cells = cells.str.replace(decimal, ".", literal=True).str.replace(
            r"^([+-]?[\d.]+)[dD]([+-]?\d+)$", "${1}e$2"
        )
        cells = cells.str.strip_prefix("+")
    return cells.cast(pl.Float64, strict=False).fill_null(np.nan).to_numpy()


def lasting_address(title: str, place: int, names: Sequence[str]) -> str:
    """What a source file calls a column: its name without its unit where only one has it, or else
    its number. Of an object without a name Python prints its number, which changes from run to run:
    a pattern fits the next recording."""
    name = csv_table.name_and_unit(title)[0]
    pattern = re.sub(r"<[^<>]* object at 0x[0-9a-fA-F]+>", "*", name)
    for address in (*[pattern] * (pattern != name), name, title):
        if csv_table.places_of(address, names) == [place]:
            return address
    return str(place + 1)


def timing_by_words(
    texts: Sequence[str], columns: Sequence[RecordedChannel]
) -> tuple[dict[str, object] | None, list[str]]:
    """The field `time` by the rate that texts state, where no column with readings is called like a
    clock, and what tells of it. LabVIEW may write no times below `X_Value`."""
    if any(one.count and logs.is_like_clock(one.name) for one in columns):
        return None, []
    if rate := logs.stated_rate(texts):
        return {"time": {"rate": rate}}, [f"time by the file's own words: {rate} rows a second"]
    told = [text for text in texts if re.search(rf"{logs.NOT_OF_ROWS}|{logs.OF_ROWS}", text)]
    said = (
        "which rate is that of the rows? State it, as `time: {rate: HZ}`:"
        f" {printable(listing(told, 4))}"
    )
    return None, [said] * bool(told)


def inspect_json(path: Path) -> Overview:
    """Every number in the lines, with its range, and the likely clock."""
    lines = read_json_lines(path)
    names, long = addresses_of(lines)
    if not names:
        raise InputError("no line holds a number; name a recording")
    decoded = decode_lines(lines, names)
    pairs = (
        (name.rpartition(".")[0], logs.stamp_fields(name.rpartition(".")[0]))
        for name in names
        if "." in name
    )
    stamps = {stamp: pair for stamp, likely in pairs for pair in likely if {*pair} <= {*names}}
    stamp = min(stamps, key=lambda name: name.count("."), default="")
    columns = []
    for name, values in decoded.values.items():
        count = np.ma.count(values)
        also = f", in {count} of {decoded.rows.size} lines" * bool(count < decoded.rows.size)
        columns.append(
            column({"field": name}, last_name(name), values, kind=values.dtype.name, also=also)
        )
    drafted = [one for one in columns if one.key not in stamps.get(stamp, ())]
    by_stamp = bool(stamp) and not any(csv_table.is_clock(one.name) for one in drafted)
    remarks = lines.damage.remarks
    remarks += [
        f"{name} has {size} elements; only the first {MOST_ELEMENTS} are listed"
        for name, size in long.items()
    ]
    timing = {"time": {"field": stamp}} if by_stamp else None
    facts = {"rows": str(len(lines.texts)), **end_of(lines.damage)}
    return overview_of(
        "json_lines",
        columns,
        "fields",
        drafted=drafted,
        timing=timing,
        facts=facts,
        remarks=remarks,
    )


def variables_in(part: str, name: str, value: Value) -> Iterator[tuple[str, str, str, Value]]:
    """What is no struct and no cell in a variable: the address of what it is in, its name, its
    address, its value."""
    address = f"{part}{'.' * (bool(part) and not name.startswith('{'))}{name}"
    if value.elements:
        for number, fields in enumerate(value.elements, start=1):
            inside = f"{address}({number})" if len(value.elements) > 1 else address
            # its signals stand beside them
            is_logged = {"time", "signals"} <= fields.keys() and len(fields) > 2
            for own in (own for own in fields if own != "signals" or not is_logged):
                yield from variables_in(inside, own, fields[own])
    elif value.kind == "cell" and value.cells:
        for number, cell in enumerate(value.cells, start=1):
            yield from variables_in(address, f"{{{number}}}", cell)
    else:
        yield part, name, address, value


def inspect_mat(path: Path) -> Overview:
    """Variables, fields and cells with size, range and likely unit; what cannot be read; parts that
    are alike."""
    file, most = open_mat(path), 500
    content = file.read(file.names)
    variables = [one for name, value in content.items() for one in variables_in("", name, value)]
    readable = ("char", "struct", "cell")
    others = [
        (at, one) for *_, at, one in variables if one.numbers is None and one.kind not in readable
    ]
    remarks = [
        f"{at} is a {one.described()}, which is not read; {one.remedy()}" for at, one in others
    ]
    remarks += file.damage.remarks
    remarks += [f"and {len(variables) - most} more variables"] * (len(variables) > most)
    by_part: dict[str, dict[str, Value]] = {}
    for part, name, _, value in variables:
        # it may be a signal
        if value.numbers is not None and len(value.shape) == 2 and max(value.shape) >= 10:
            by_part.setdefault(part, {})[name] = value
    by_part = with_logged_joined(content, by_part)
    # of parts that hold the same signals
    groups: dict[tuple[str, ...], dict[str, dict[str, Value]]] = {}
    for place, own in by_part.items():
        groups.setdefault(tuple(own), {})[place] = own
    alike = max(groups.values(), key=lambda group: sum(map(len, group.values())), default={})
    part, left_open = next(iter(alike), "") * (len(alike) == 1), list[str]()
    if len(alike) > 1:
        parts = listing([printable(one) for one in alike], 40)
        what = (
            f"{len(alike)} parts hold the same variables: name one per trial in the column"
            " `log_part` of the sheet"
        )
        left_open = [f"{what}: {parts}"]
    if apart := [one for one in by_part if one not in alike]:
        what = (
            "a draft is of one part; to read a variable of another, write its address with `/`, as"
        )
        # of the file itself it is the name alone
        address = address_with(apart[0], list(by_part[apart[0]])[-1])
        left_open.append(f"{what} `/{printable(address)}`")
    cells: dict[str, list[str]] = {}
    for place, name, _, value in variables:
        cells.setdefault(place * name.startswith("{"), []).append(value.text)
    titles = titles_of_columns(cells.values())
    signals = next(iter(alike.values()), {})
    drafted = [
        one for name, value in signals.items() for one in columns_of_matrix(name, value, titles)
    ]
    columns = [
        variable_column(address, name, value) for _, name, address, value in variables[:most]
    ]
    facts = {"version": file.version, "header": file.header, "variables": str(len(file.names))}
    settings = {"log_part": part} if part else {}
    texts = [f"{key}={np.ravel(np.asarray(one.numbers))[:2]}" for _, key, _, one in variables]
    timing, said = timing_by_words(texts, drafted)
    left_open += said
    return overview_of(
        "mat",
        columns,
        "variables",
        logs.is_like_clock,
        drafted,
        timing,
        left_open,
        facts,
        remarks,
        settings,
    )


def with_logged_joined(
    content: Mapping[str, Value], by_part: dict[str, dict[str, Value]]
) -> dict[str, dict[str, Value]]:
    """The signals by part, those of one recording that Simulink logged each in a structure of its
    own as one: with its time, the same in all, or beside the one variable `tout`."""
    alone = {name: value.elements[0] for name, value in content.items() if len(value.elements) == 1}
    structures = [name for name, fields in alone.items() if {"time", "signals"} <= fields.keys()]
    every = {(name, key): one for name in structures for key, one in by_part.get(name, {}).items()}
    clocks, joined = dict[str, Value](), dict[str, Value]()
    for (name, key), one in every.items():
        (clocks if key == "time" else joined)[f"{name}.{key}"] = one
    if not clocks and "tout" in by_part.get("", {}):
        clocks = {"tout": by_part[""]["tout"]}
    names = {key for _, key in every} - {"time"}  # those of several trials are the same
    unlike = len(joined) in (len(structures), len(names))
    shapes = {one.shape for one in (*clocks.values(), *joined.values())}
    times = {np.asarray(one.numbers).tobytes() for one in clocks.values()}
    if not (unlike and len(joined) >= len(structures) > len(shapes) == len(times) == 1):
        return by_part
    others = {part: own for part, own in by_part.items() if part not in ("", *structures)}
    return {"": dict([next(iter(clocks.items())), *joined.items()]), **others}


def columns_of_matrix(
    name: str, value: Value, titles: Mapping[int, Sequence[str]] | None = None
) -> Iterator[RecordedChannel]:
    """Each column of a matrix, or row if it has more columns, called by its title where a list has
    one for each."""
    rows, columns = value.shape
    upright = rows >= columns
    for place in range(min(rows, columns) if value.numbers is not None else 0):
        line = f"(:,{place + 1})" if upright else f"({place + 1},:)"
        values = (
            np.asarray(value.numbers)[:, place] if upright else np.asarray(value.numbers)[place]
        )
        address, own = (
            (name, name.rpartition(".")[2]) if 1 in value.shape else (f"{name}{line}", line)
        )
        title = (titles or {}).get(min(rows, columns), ())[place : place + 1] if own == line else ()
        own, unit = csv_table.name_and_unit(title[0]) if title else (own, "")
        yield column(
            {"variable": address},
            own,
            values.astype(np.float64),
            value.unit or unit,
            value.described(),
        )


def variable_column(address: str, name: str, value: Value) -> RecordedChannel:
    readings = np.empty(0) if value.numbers is None else value.numbers.ravel()
    is_vector = value.numbers is not None and 1 in value.shape
    at = {"variable": address}
    found = column(
        at, name if is_vector else "", readings, value.unit, value.described(), count=value.size
    )
    return replace(found, note=f"'{value.text}'") if value.text and value.numbers is None else found


def inspect_tdms(path: Path) -> Overview:
    """Channels with unit, range and rate by their own timing."""
    file = read_tdms(path)
    remarks, columns, offered = (
        list(file.damage.remarks),
        list[RecordedChannel](),
        list[RecordedChannel](),
    )
    for one in file.channels:
        values = np.empty(0)
        try:
            if one.count and (one.holds_numbers or one.holds_times):
                values = file.values([one])[one.address]
        except InputError as error:
            remarks.append(str(error))
        unit = "s" if one.holds_times and one.count else one.unit
        found = column(
            {"channel": one.address}, one.name, values, unit, one.kind.name, count=one.count
        )
        if one.step:
            times = one.begin / logs.SECOND + one.step * np.arange(values.size, dtype=np.float64)
            found = replace(found, rate=1 / one.step, times=times)
        columns.append(found)
        offered += [found] * bool(one.count and one.holds_numbers)
    timed = any(one.step is not None for one in file.channels)
    named = any(csv_table.is_clock(one.name) for one in offered)
    stamps = [
        one
        for one, channel in zip(columns, file.channels, strict=True)
        if channel.holds_times and channel.count
    ]
    clock = stamps[0].key if stamps and not timed and not named else None
    facts = {"channels": str(len(file.channels)), "own timing": "yes" if timed else "no"}
    facts |= {**end_of(file.damage), **file.properties}
    drafted, timing = [*offered, *stamps[:1] * bool(clock)], dict[str, object]() if timed else None
    return overview_of(
        "tdms",
        columns,
        "channels",
        drafted=drafted,
        timing=timing,
        facts=facts,
        remarks=remarks,
        clock=clock,
    )


FORCES = {
    "force.*_v[xyz]": "N",
    "force.*_p[xyz]": "m",
    "(torque|moment).*_[xyz]|_moment": "N*m",
    "_t[xyz]": "m",
}
"""What columns of OpenSim measure by the ends of their names."""


def inspect_opensim(path: Path) -> Overview:
    """Columns with range and likely unit: by its name, by what OpenSim calls forces, or of an angle
    by `inDegrees`."""
    found = inspect_table("opensim", path)
    time: Any = found.settings["time"]
    time = {"column": time["column"], "unit": UNKNOWN if time["column"] == NAME_OF_TIME else "s"}
    plates = plates_in([one.key for one in found.channels])
    note = (
        "these columns are force plates, if you state their corners: plates:"
        f" {{{', '.join(plates)}}}"
    )
    questions = [*found.open, *[printable(note)] * bool(plates)]
    return replace(found, settings={**found.settings, "time": time}, open=questions)


def plates_in(names: Sequence[str]) -> list[str]:
    """The plates that the names of columns tell, as a source file has them but for their
    corners."""
    triples = {name[:-1] for name in names if {f"{name[:-1]}{axis}" for axis in "xyz"} <= {*names}}
    plates: list[str] = []
    for name in names:
        # `R_ground_force_v`; of `R_ground_force_` is the moment `R_ground_torque_`
        force, stem = name[:-1], name[:-2]
        moments = (
            {re.sub("force", word, stem): None for word in ("torque", "moment")}
            if name.endswith("vx")
            else {}
        )
        moment = next((one for one in moments if one != stem and one in triples), None)
        if moment is not None and {force, f"{stem}p"} <= triples:
            keys = {"force": force, "point": f"{stem}p", "moment": moment}
            text = ", ".join(f"{key}: {json.dumps(begin)}" for key, begin in keys.items())
            plates.append(f"{len(plates) + 1}: {{{text}, corners: {UNKNOWN}}}")
    return plates


ROS_UNITS = {
    "sensor_msgs/JointState": {"position": "rad", "velocity": "rad/s", "effort": "N*m"},
    "geometry_msgs/Wrench": {"force": "N", "torque": "N*m"},
    "geometry_msgs/WrenchStamped": {"wrench.force": "N", "wrench.torque": "N*m"},
}
"""Units of standard messages of ROS (REP 103), by the beginning of the field. A joint that slides
has other ones."""


def inspect_messages(name: str, path: Path) -> Overview:
    """Topics with schema, encoding, rate, gaps and readings by log time, every field of each, and
    what is damaged."""
    file = logs.OPENERS[name](path)
    surveys, remarks = read_channels(file), list(file.damage.all_remarks())
    channels, source = list[RecordedChannel](), "log"
    for survey in surveys:
        fields, reason = list[FieldDescription](), ""
        # by the first message, or else by the schema
        for message in dict.fromkeys([survey.first, None]):
            try:
                fields = describe_message(survey.channel, survey.schema, message)
                if fields or not reason:  # JSON has no schema to tell what a message does not
                    break
            except (ValueError, RecursionError) as error:
                reason = reason or " ".join(str(error).split()).removeprefix(
                    f"topic '{survey.channel.topic}': "
                )
        else:
            remarks.append(f"topic '{survey.channel.topic}': its fields cannot be listed: {reason}")
        channels += topic_channels(survey, fields)
        source = "header" if any(one.path.startswith("header.stamp") for one in fields) else source
    damage, lost = file.damage, file.damage.lost()
    facts = {
        "bytes": str(file.size),
        "chunks": str(damage.chunks),
        "messages": str(damage.messages),
    }
    facts |= {
        "messages lost": "the file does not tell" if lost is None else str(lost),
        "checksums": damage.crc(),
    }
    wanted = dict[str, list[str]]()
    for one in (one for one in channels if "field" in one.address and one.count):
        wanted.setdefault(one.address["topic"], []).append(one.address["field"])
    with suppress(InputError):  # where a field of some message is no number, none has readings
        decoded = decode_topics(
            logs.OPENERS[name](path), wanted, [field for own in wanted.values() for field in own]
        )
        for place, one in enumerate(channels):
            topic, field = (*one.address.values(), "")[:2]
            if topic in decoded and field in decoded[topic].values:
                numbers = np.ma.filled(decoded[topic].values[field].astype(np.float64), np.nan)
                channels[place] = replace(
                    one, numbers=numbers, times=decoded[topic].log_time / logs.SECOND
                )
    return Overview(name, facts, channels, remarks, {"clock": "master", "time": {"source": source}})


def topic_channels(
    survey: ChannelLog, fields: Sequence[FieldDescription]
) -> Iterator[RecordedChannel]:
    """A topic's numbers, one by one as a source file names them; the topic alone where there are
    none."""
    topic, kind, units = survey.channel.topic, survey.channel.message_encoding, dict[str, str]()
    if survey.schema:
        kind, units = (
            f"{survey.schema.name} ({kind})",
            ROS_UNITS.get(survey.schema.name.replace("/msg/", "/"), {}),
        )
    count, stamps = (
        survey.log_time.size,
        (survey.log_time - survey.log_time[:1].sum()) / logs.SECOND,
    )
    rate, timing = logs.rate_of(stamps), gaps_text(stamps) or "empty" * (not count)
    # every message of ROS has a header, and no signal is in it
    numbers = [
        (path, one)
        for one in fields
        if not one.path.startswith("header.")
        for path in one.addresses()
    ]
    for path, one in numbers:
        own = logs.likely_unit(re.split(r"[./]", path)[-1])
        unit = next((unit for begin, unit in units.items() if path.startswith(begin)), own)
        of_type, at = (
            one.type if one.length is None else f"{one.type}[{one.length}]",
            {"topic": topic, "field": path},
        )
        timed = (0, None) if one.length == 0 else (count, rate)
        yield RecordedChannel(kind, at, "", *timed, timing, of_type, unit)
    if not numbers:
        yield RecordedChannel(kind, {"topic": topic}, "", count, rate, timing)


def inspect_c3d(path: Path) -> Overview:
    """Markers with the share of frames in which they were seen, model outputs, analog channels and
    plates."""
    recording = read_c3d(path)
    header, unit, labels = recording.header, recording.point_unit(), recording.analog_labels
    channels, rate = [], header.rate * header.samples_per_frame
    for label, positions in zip(
        recording.point_labels, recording.points.transpose(1, 0, 2), strict=False
    ):
        of_kind = ("model output", "") if label in recording.model_outputs else ("marker", unit)
        channels.append(marker_channel(label, positions, header.rate, *of_kind))
    for place, (label, values) in enumerate(zip(labels, recording.analogs.T, strict=False)):
        low, high, own = values.min(), values.max(), recording.analog_unit(place)
        note = f"from {low:.6g} to {high:.6g}" if low != high else f"always {low:.6g}"
        channels.append(RecordedChannel("analog", {"channel": label}, own, values.size, rate, note))
    plates = plate_count(header)
    channels += [plate_channel(recording, number) for number in range(1, plates + 1)]
    facts = {"frames": f"{header.frames}, from {header.first_frame} on, at {header.rate:g} Hz"}
    facts |= {"unit of length": unit or "none", "force plates": str(plates)}
    facts["vertical on screen"] = "".join(header.texts("POINT:Y_SCREEN")[:1]) or "not said"
    facts["software"] = " ".join(header.texts("MANUFACTURER:SOFTWARE")) or "not said"
    return Overview("c3d", facts, channels, settings={"plates": "all" if plates else "none"})


def marker_channel(
    label: str, positions: Array, rate: float, kind: str, unit: str
) -> RecordedChannel:
    """A marker or a model output by its positions, (frames, 3), NaN where it was not seen."""
    seen = ~np.isnan(positions).any(axis=1)
    missing = 1.0 - float(seen.mean())
    note = f"missing in {missing:.1%} of the frames" if missing else ""
    return RecordedChannel(
        kind, {"label": label}, unit, int(seen.sum()), rate, note, numbers=positions
    )


def plate_channel(recording: C3DRecording, number: int) -> RecordedChannel:
    """A plate with its type, its channels, and its force [N], as far as they can be known."""
    size = None
    try:
        kind = int(plate_parameter(recording, "TYPE", number))
        own = plate_parameter(recording, "CHANNEL", number, (0,)).astype(int).tolist()
        note = f"type {kind}, analog channels {own}"
    except InputError as error:
        note = str(error)
    with suppress(InputError):
        ((columns, _, _),) = plate_loads(recording, C3dSource(format="c3d", plates=(number,)))
        size = np.linalg.norm([columns[name] for name in plate_columns(number, "force")], axis=0)
        note += f", force changes by {float(np.ptp(size)):.0f} N"
    return RecordedChannel("plate", {"plate": str(number)}, note=note, numbers=size)


def inspect_nexus(path: Path) -> Overview:
    """The sections' columns: one per trajectory, and per component of anything else."""
    facts, channels = {}, []
    for title, section in read_sections(path).items():
        facts[title] = f"{len(section.rows)} rows at {section.rate:g} Hz"
        kind = {"Trajectories": "marker", "Model Outputs": "model output"}.get(title, "device")
        for place, (name, component) in enumerate(
            zip(section.names, section.components, strict=True)
        ):
            if not name or (kind == "marker" and component.casefold() != "x"):
                continue
            address = (
                {"label": name} if kind == "marker" else {"device": name, "component": component}
            )
            lacking, unit = np.isnan(section.values(place)), section.units[place]
            missing, seen = float(lacking.mean()), int((~lacking).sum())
            note = f"missing in {missing:.1%} of the rows" if missing else ""
            channels.append(RecordedChannel(kind, address, unit, seen, section.rate, note))
    return Overview("nexus_csv", facts | end_of(Ledger(end_unknown=len(facts) == 1)), channels)


def inspect_trc(path: Path) -> Overview:
    """Markers with the share of frames in which they were seen."""
    file = read_trc(path)
    upward, positions = vertical_axis(file.positions), file.positions.transpose(1, 0, 2)
    facts = {"frames": f"{len(file.positions)}, from {file.first_frame} on, at {file.rate:g} Hz"}
    facts |= {"unit of length": file.unit or "none", "time of the first frame": f"{file.start:g} s"}
    facts["vertical axis"] = upward or "not told by the markers"
    markers = zip(file.labels, positions, strict=True)
    channels = [
        marker_channel(label, one, file.rate, "marker", file.unit) for label, one in markers
    ]
    return Overview(
        "trc",
        facts,
        channels,
        file.damage.remarks,
        {"axes": ["x", "-z", "y"]} if upward == "y" else {},
    )
