"""Logs that are tables of rows, in CSV, JSON lines, MATLAB, TDMS and tables of OpenSim, as canonical columns."""

import json
import re
from collections import defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.formats.csv_table import (
    CsvLayout,
    CsvTable,
    UnreadableCellError,
    name_and_unit,
    numbers,
    read_csv_table,
    share_above,
    without_brackets,
)
from osl_analysis.formats.gait_text import read_opensim
from osl_analysis.formats.json_lines import JsonLines, addresses_of, decode_lines, read_json_lines
from osl_analysis.formats.mat import find, no_variable, open_mat, parsed, vector
from osl_analysis.formats.message_fields import Columns
from osl_analysis.formats.table import Loss, Table
from osl_analysis.formats.tdms import read_tdms
from osl_analysis.ingest.captures import exported_columns, exported_plates
from osl_analysis.ingest.message_log import LAST_SECOND, SECOND, joined_on_stamp, median_rate, stamp_fields
from osl_analysis.ingest.recording import LEVEL_UNIT, Recording, canonical_series, checked_numbers
from osl_analysis.ingest.source import Channel, Source
from osl_analysis.ingest.units import is_unit, si_factor
from osl_analysis.trial import Array, check_time, counter_column, unit_of

RATE = "state the rate: `time: {rate: 1000}`"


def read_table_log(path: Path, source: Source) -> Recording:
    """The columns that the source file maps, in SI units; time [s] counts from the first row.

    Rows of another timing, as TDMS may have, are null in the columns of the others. Nothing is interpolated.
    Raises InputError: the recording is not what the source file says, or holds no numbers where it should.
    """
    tables = TABLE_FORMATS[source.format](path, source)
    parts = [(start, table_recording(table, source, path.name)) for start, table in tables]
    recording = parts[0][1] if len(parts) == 1 else on_one_time(parts, path.name)
    if source.format == "opensim" and source.plates:
        return exported_plates(tables[0][1], recording, source)
    return recording


def wanted(source: Source) -> list[str]:
    """The addresses of all columns that a source file names, each once: time, signals, counters."""
    named = [name for one in source.channels.values() for name in (one.name, one.counter)]
    return [*dict.fromkeys(name for name in [source.time.name, *named] if name)]


def table_recording(table: Table, source: Source, file: str) -> Recording:
    """The channels of the source file that a table has."""
    channels = {column: one for column, one in source.channels.items() if one.name in table.columns}
    time, start = time_of(table, source)
    first_by: dict[int, str] = {}
    for column, channel in channels.items():  # two signals of different units, such as angle and torque, of one column
        other = first_by.setdefault(id(table.columns[channel.name]), column)
        if unit_of(other) != unit_of(column):
            raise InputError(
                f"{channel.title} is {other} and {column} in the source file; correct "
                f"{source.place('channels', column, channel.ADDRESS)}"
            )
    columns, origins, missing, absent, units = [pl.Series("time", time)], {}, {}, [], []
    for column, channel in channels.items():
        what, raw, unit = channel.title, table.columns[channel.name], table.units.get(channel.name, "")
        if raw.dtype == bool and unit_of(column) != LEVEL_UNIT:
            needed = f"no numbers in {unit_of(column)}"
            raise InputError(f"{what} holds truth values and {needed}; name another one in the source file")
        values = checked_numbers(what, raw, time, source.most_missing, table)
        missing[column], lacking = int(np.isnan(values).sum()), np.ma.getmaskarray(raw)
        try:
            columns.append(canonical_series(column, channel, values, lacking, unit))
        except InputError as error:
            raise InputError(f"{what}: {error}, as {source.place('channels', column, 'unit')}") from error
        origins[column] = {**channel.origin(column, unit), **table.found.get(channel.name, {})}
        if lacking.any():
            count = f"{int(lacking.sum())} of {lacking.size} rows, first row {int(np.argmax(lacking)) + 1}"
            absent.append(f"{channel.title} has no value in {count}")
        if channel.unit and unit and channel.unit != unit:
            units.append(f"{column} is read in {channel.unit}; the file says {unit}")
        if channel.counter is not None:
            columns.append(counter_of(table, channel, time).alias(counter_column(column)))
    fresh = np.concatenate([[True], np.diff(time) != 0])  # rows whose stamp is not that of the row before
    kept = fresh if source.time.repeated == "drop" else np.ones_like(fresh)
    facts = {
        "time": {**source.time.model_dump(exclude_none=True), "start": start},
        "rates_hz": {file: median_rate(time[kept])},
        "repeated_stamps": int((~fresh).sum()),
        "missing": missing,
        **table.facts,
        **({"damage": dict(table.loss.report)} if table.loss.report else {}),
    }
    failed = [f"{name} is {table.failed} in {n} of {time.size} {table.noun}s" for name, n in missing.items() if n]
    said = [*table.loss.notes, *absent, *failed, *units]
    if not fresh.all():
        did = (
            "and were left out"
            if source.time.repeated == "drop"
            else "and are taken for samples whose stamps were rounded; if the device was read faster than it sampled, "
            f"write `repeated: drop` under {source.place('time')}"
        )
        repeated = f"{int((~fresh).sum())} of {fresh.size} {table.noun}s repeat the stamp of the {table.noun} before"
        said.append(f"{repeated} {did}")
    warnings = [f"{file}: {text}" for text in said]
    return Recording(pl.DataFrame(columns).filter(pl.Series(kept)), origins, facts, warnings)


def time_of(table: Table, source: Source) -> tuple[Array, float]:
    """Time [s] of every row since the first one, and the reading of the clock in the first row."""
    stated = source.time
    if not stated.name:
        own = np.arange(table.rows) / stated.rate if stated.rate is not None else table.time
        assert own is not None  # the model of the source file asks for a rate or a name where the file has no time
        return own - own[0], float(own[0])
    what, raw = stated.title, np.ma.getdata(table.columns[stated.name])
    lacking = np.isnan(raw.astype(np.float64)) | np.ma.getmaskarray(table.columns[stated.name])
    if raw.dtype == bool or lacking.any():
        where = "but truth values" if raw.dtype == bool else f"in {table.place(int(np.argmax(lacking)))}"
        raise InputError(f"{what}: no time {where}; remove it there, take another {stated.ADDRESS}, or {RATE}")
    try:
        factor = si_factor(table.units.get(stated.name, "") if stated.unit is None else stated.unit, "s")
    except InputError as error:
        raise InputError(f"{what}: {error}, as {source.place('time', 'unit')}") from error
    time = np.asarray((raw - raw[0]) * factor, dtype=np.float64)
    check_time(what, time)
    if time.size > 1 and time[0] == time[-1]:
        still = f"time stands still at {raw[0]:g} in all {time.size} {table.noun}s"
        raise InputError(f"{what}: {still}; take another {stated.ADDRESS}, or {RATE}")
    return time, float(raw[0])


def counter_of(table: Table, channel: Channel, time: Array) -> pl.Series:
    """The device's count of its samples, (rows,); refused where it is missing or not whole."""
    found = table.columns[str(channel.counter)]
    raw = np.ma.getdata(found).astype(np.float64)
    wrong = (raw != np.rint(raw)) | np.ma.getmaskarray(found)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InputError(
            f"{channel.ADDRESS} '{channel.counter}': {raw[row]} in {table.place(row)}, at "
            f"{time[row]:.3f} s, is no count of samples; remove `counter` from the source file, or the {table.noun} "
            "from the log"
        )
    return pl.Series(np.ma.getdata(found).astype(np.int64))


def on_one_time(parts: Sequence[tuple[float, Recording]], file: str) -> Recording:
    """Recordings of several timings as one, each with the time [s] by which it begins after the first."""
    last = max(start for start, _ in parts)
    lasts = min(start + float(one.samples["time"][-1]) for start, one in parts)
    if last > lasts:
        raise InputError(
            f"its channels begin up to {last:.3f} s apart and do not overlap; name channels of one task, or {RATE}"
        )
    stamps = []
    for start, one in parts:
        stamp = ((pl.col("time") + start) * SECOND).round().cast(pl.Int64).alias("stamp")
        stamps.append(one.samples.select(stamp, pl.exclude("time")))
    table = joined_on_stamp(stamps)
    time = ((table["stamp"] - int(table["stamp"][0])) / SECOND).alias("time")
    recordings = [one for _, one in parts]
    rates = {", ".join(one.columns): one.facts["rates_hz"][file] for one in recordings}
    facts = {**recordings[0].facts, "rates_hz": rates}
    facts["missing"] = {name: count for one in recordings for name, count in one.facts["missing"].items()}
    warnings = list(dict.fromkeys(text for one in recordings for text in one.warnings))
    origins = {name: origin for one in recordings for name, origin in one.columns.items()}
    return Recording(table.select(time, pl.exclude("stamp")), origins, facts, warnings)


Tables = Sequence[tuple[float, Table]]
"""The tables of a recording, each with the time [s] by which it begins after the first."""

LIKE_A_DATE = re.compile(r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}|\d{1,2}:\d{2}")  # such as 2024-05-01T12:00:00 and 12:00:00.5
TRUTHS = {"true": "1", "false": "0"}


def csv_tables(path: Path, source: Source) -> Tables:
    layout = CsvLayout(**{one.name: getattr(source, one.name) for one in fields(CsvLayout)})
    text = read_csv_table(path, layout)
    places = {name: text.column(name) for name in wanted(source)}
    levels = {places[one.name] for column, one in source.channels.items() if unit_of(column) == LEVEL_UNIT}
    clock = places.get(source.time.name)
    values = {place: cells_of(text, place, source, place in levels, place == clock) for place in {*places.values()}}
    full = {name: text.names[place] for name, place in places.items()}
    found = {name: {"found": one} for name, one in full.items() if name_and_unit(one)[0] != name_and_unit(name)[0]}
    table = Table(
        len(text.lines),
        {name: values[place] for name, place in places.items()},
        {name: text.units[place] for name, place in places.items()},
        loss=Loss(text.notes, {} if text.complete else {"complete": False}),
        facts={"comments": text.comments[:100]},
        found=found,
        lines=text.lines,
        failed="missing",
    )
    return [(0.0, table)]


def cells_of(text: CsvTable, place: int, source: Source, level: bool, is_time: bool) -> NDArray[Any]:
    """Numbers of one column, (rows,), NaN where they are missing.

    In a `level` the words `True` and `False`, in any capitals, are 1 and 0, as Python's loggers write them.
    """
    cells: Any = text.body.to_series(place)
    if is_time:
        whole = cells.cast(pl.Int64, strict=False)
        if not whole.null_count():  # nanoseconds since 1970, which floats would round
            return np.asarray(whole.to_numpy())
    if level:
        cells = [TRUTHS.get(cell.casefold(), cell) if cell is not None else None for cell in cells]
    try:
        return numbers(cells, source.missing, source.decimal)
    except UnreadableCellError as error:
        cell = str(cells[error.place])
        raise InputError(
            f"line {text.lines[error.place]}, column '{text.names[place]}': '{cell[:40]}' is not "
            f"a number; {remedy_for(cell, text.names[place], source, is_time, first=error.place == 0)}"
        ) from error


def remedy_for(text: str, name: str, source: Source, is_time: bool, first: bool) -> str:
    """What to do about a cell that is not a number; `first`: it stands in the first row of data."""
    if text.casefold() in TRUTHS:
        return "name a column of numbers; a truth value can only be `sync` or `trigger`"
    if LIKE_A_DATE.search(text):
        return "write time as seconds, or state the rate of the rows in place of the column: `time: {rate: 1000}`"
    if text == name:
        return "the header stands here again: cut the file in two, a log each"
    if source.decimal == "," and "." in text:
        return 'write `decimal: "."` in the source file if the full stop is the decimal sign'
    if re.fullmatch(r"[+-]?\d+,\d+", text):
        return 'write `decimal: ","` in the source file if the comma is the decimal sign'
    if first and source.header == "none":
        return "write `header: row` in the source file if this line holds the columns' names"
    if first and is_unit(without_brackets(text)):
        return "write `units_row: true` in the source file if this line holds units"
    if is_time:
        return "correct the cell, or delete the line"
    return f"correct the cell, or add {json.dumps(text[:40], ensure_ascii=False)} to `missing` in the source file"


Parts = tuple[str, str]  # paths of the seconds and of the nanoseconds


def json_tables(path: Path, source: Source) -> Tables:
    """A line that lacks a field has no sample of it. `null` is no value, `NaN` a reading that failed."""
    lines, field = read_json_lines(path), source.time.field
    parts = stamps_among(addresses_of(lines)[0]).get(field) if field else None
    if parts and source.time.unit is not None:
        raise InputError(
            f"field '{field}' is a stamp of '{parts[0]}' and '{parts[1]}', whose units are known; remove "
            f"{source.place('time', 'unit')}"
        )
    names = [name for name in wanted(source) if not (parts and name == field)]
    decoded = decode_lines(lines, [*names, *(parts or ())])
    count, total = decoded.misfits, len(lines.texts)
    if count and (count > source.most_missing * total or source.time.rate is not None):
        # with a rate, a line that is left out moves the rest
        advice = f", or write `most_missing: {share_above(count, total):g}` in the source file"
        raise InputError(
            f"{count} of {total} lines cannot be used: {decoded.misfit}; repair the log"
            f"{advice if source.time.rate is None else ''}"
        )
    notes = notes_on(lines, decoded)
    kept = np.any([decoded.present[name] for name in [*names, *(parts or ())]], axis=0)
    if field and not kept.all():  # lines without any of the fields, such as a header; with a rate, every line counts
        left_out, first = int((~kept).sum()), lines.numbers[decoded.rows[int(np.argmin(kept))]]
        notes.append(f"{left_out} of {kept.size} lines have none of the fields and were left out, first line {first}")
        values = {name: one[kept] for name, one in decoded.values.items()}
        present = {name: one[kept] for name, one in decoded.present.items()}
        decoded = replace(decoded, rows=decoded.rows[kept], values=values, present=present)
    given, there = decoded.values, decoded.present
    columns: dict[str, NDArray[Any]] = {name: np.ma.array(given[name], mask=~there[name]) for name in names}
    units = {}
    if parts and field:
        columns[field], units[field] = stamp_column(lines, decoded, parts), "ns"
    share = count / max(1, decoded.rows.size + count)
    report = {"messages_lost": count, "share_lost": share} if count else {}
    numbered = lines.numbers[decoded.rows]
    return [(0.0, Table(decoded.rows.size, columns, units, loss=Loss(notes, report), lines=numbered))]


def stamps_among(names: Collection[str]) -> Mapping[str, Parts]:
    """The stamps among several paths, by the path of the object, the shortest way first."""
    above = dict.fromkeys(name.rpartition(".")[0] for name in names if "." in name)
    found = {path: parts for path in above for parts in stamp_fields(path) if path and set(parts) <= set(names)}
    return dict(sorted(found.items(), key=lambda one: one[0].count(".")))


def stamp_column(lines: JsonLines, decoded: Columns, parts: Parts) -> NDArray[Any]:
    """The stamps [ns] as one column; a line that lacks one of the parts has none."""
    for name, most in zip(parts, (LAST_SECOND, SECOND), strict=True):
        values, there = decoded.values[name], decoded.present[name]
        whole = np.where(there, values, 0).astype(np.float64)
        wrong = there & ((np.abs(whole) > most) | (whole != np.rint(whole)) | (values.dtype == bool))
        if wrong.any():
            row = int(np.argmax(wrong))
            raise InputError(
                f"field '{name}' is {values[row]} in line {lines.numbers[decoded.rows[row]]}, which is "
                f"no whole number from 0 to {most}; name another time, or {RATE}"
            )
    there = decoded.present[parts[0]] & decoded.present[parts[1]]
    seconds, nanoseconds = (np.where(there, decoded.values[name], 0).astype(np.int64) for name in parts)
    return np.ma.array(seconds * SECOND + nanoseconds, mask=~there)


def notes_on(lines: JsonLines, decoded: Columns) -> list[str]:
    count, total = decoded.misfits, len(lines.texts)
    skipped = [f"{count} of {total} lines cannot be used and were skipped: {decoded.misfit}"]
    return [*lines.notes, *skipped * bool(count)]


def mat_tables(path: Path, source: Source) -> Tables:
    file = open_mat(path)
    part = parsed(source.log_part) if source.log_part else None
    addresses = {
        text: parsed(text, inside=part is not None and not text.startswith("/")).below(part) for text in wanted(source)
    }
    variables = file.read({address.variable for address in addresses.values()})
    vectors: dict[str, NDArray[Any]] = {}
    for text, address in addresses.items():
        if address.variable not in file.names and not source.log_part:
            raise no_variable(file, address)
        vectors[text] = vector(address, find(variables, file.names, address))
    reference = source.time.name or next(iter(vectors))
    rows = vectors[reference].size
    for text, values in vectors.items():
        if values.size != rows:
            raise InputError(
                f"{text} has {values.size} numbers and {reference} has {rows}; name variables of one "
                "recording, or cut them to one length in MATLAB"
            )
    facts = {"version": file.version, "header": file.header, "log_part": source.log_part}
    found = {text: {"variable": address.text} for text, address in addresses.items()}
    return [(0.0, Table(rows, vectors, facts=facts, found=found, noun="sample"))]


def tdms_tables(path: Path, source: Source) -> Tables:
    """A table for each timing that channels have by their own properties; one where the source file tells the time."""
    file = read_tdms(path)
    timings: dict[tuple[int, float, float | None, int], list[Channel]] = defaultdict(list)
    for mapped in source.channels.values():
        channel = file.channel(mapped.name)
        told = (channel.begin, channel.offset, channel.step, channel.count)
        if source.time.name or source.time.rate is not None:
            told = (0, 0.0, None, 0)
        elif channel.step is None:
            raise InputError(
                f"channel '{channel.address}' has no timing (`wf_increment` among its properties); name the "
                f"channel of time, as `time: {{channel: GROUP/NAME, unit: s}}`, or {RATE}"
            )
        timings[told].append(mapped)
    first, tables = min(begin for begin, *_ in timings), list[tuple[float, Table]]()
    report = {"complete": False, "messages_lost": None, "remarks": list(file.notes)} if file.notes else {}
    for (begin, offset, step, length), of_timing in timings.items():
        named = [name for mapped in of_timing for name in (mapped.name, mapped.counter)]
        channels = {name: file.channel(name) for name in [*named, source.time.name] if name}
        some = list(channels.values())
        for one in some:
            if one.count != some[0].count:
                raise InputError(
                    f"channel '{one.address}' has {one.count} values and '{some[0].address}' has "
                    f"{some[0].count}; name channels of one recording, or export those of each length on their own"
                )
        values = file.values(some)
        columns = {name: values[one.address] for name, one in channels.items()}
        units = {name: "s" if one.holds_times else one.unit for name, one in channels.items()}
        own = None if step is None else np.asarray(np.arange(length) * step, dtype=np.float64)
        table = Table(some[0].count, columns, units, own, Loss(file.notes, report))
        tables.append((offset + (begin - first) * 1e-6, table))
    return tables


ANGLES = {"rad": {"deg": "deg", "rad": "rad"}, "rad/s": {"deg": "deg/s", "rad": "rad/s"}}
"""By canonical unit, the unit that the header's `inDegrees` means."""


def opensim_tables(path: Path, source: Source) -> Tables:
    table = read_opensim(path)
    for column, channel in source.channels.items():  # a unit of an angle that is not the one of the header
        canonical = unit_of(column)
        own = ANGLES.get(canonical, {}).get(table.angles)
        if own is not None and not np.isclose(si_factor(str(channel.unit), canonical), si_factor(own, canonical)):
            raise InputError(
                f"its header says inDegrees={table.header['indegrees']}, and column '{channel.column}' is read in "
                f"{channel.unit}; write {own}, as {source.place('channels', column, 'unit')}"
            )
    facts = {"header": table.header, "clock": source.clock}
    plates = [name for plate in source.plates.values() for name in exported_columns(plate)]
    columns = {name: table.column(name) for name in dict.fromkeys([*wanted(source), *plates])}
    return [(0.0, Table(len(table.rows), columns, facts=facts))]


TABLE_FORMATS: Mapping[str, Callable[[Path, Source], Tables]] = {
    "csv": csv_tables,
    "json_lines": json_tables,
    "mat": mat_tables,
    "tdms": tdms_tables,
    "opensim": opensim_tables,
}
