"""A log in JSON lines: its source file, its reader, and what it holds."""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from osl_analysis.errors import InputError
from osl_analysis.formats.csv_table import share_above
from osl_analysis.formats.json_lines import (
    MOST_ELEMENTS,
    DecodedLines,
    JsonLines,
    addresses_of,
    decode_lines,
    read_json_lines,
)
from osl_analysis.formats.object_messages import last_name
from osl_analysis.ingest.overview import (
    NAME_OF_TIME,
    UNKNOWN,
    Overview,
    RecordedChannel,
    gaps_text,
    guessed_units,
    is_clock,
    likely_clock,
    likely_unit,
    range_text,
    rate_of,
    unit_of_clock,
)
from osl_analysis.ingest.recording import Recording
from osl_analysis.ingest.stamps import LAST_SECOND, SECOND, stamp_fields
from osl_analysis.ingest.table_log import Table, TableChannel, TableColumn, TableSource, TableTime, read_table_log
from osl_analysis.ingest.units import Unit
from osl_analysis.trial import Array

Parts = tuple[str, str]  # paths of the seconds and of the nanoseconds


def stamps_among(names: Collection[str]) -> Mapping[str, Parts]:
    """The stamps among several paths, by the path of the object, the shortest way first."""
    above = dict.fromkeys(name.rpartition(".")[0] for name in names if "." in name)
    found = {path: parts for path in above for parts in stamp_fields(path) if path and set(parts) <= set(names)}
    return dict(sorted(found.items(), key=lambda one: one[0].count(".")))


def stamp_column(lines: JsonLines, decoded: DecodedLines, parts: Parts) -> TableColumn:
    """The stamps [ns] as one column; a line that lacks one of the parts has none."""
    for name, most in zip(parts, (LAST_SECOND, SECOND), strict=True):
        values, there = decoded.values[name], decoded.present[name]
        numbers = np.where(there, values, 0).astype(np.float64)
        wrong = there & ((np.abs(numbers) > most) | (numbers != np.rint(numbers)) | (values.dtype == bool))
        if wrong.any():
            row = int(np.argmax(wrong))
            raise InputError(
                f"{lines.path}: field '{name}' is {values[row]} in line {lines.numbers[decoded.rows[row]]}, which is "
                f"no whole number from 0 to {most}; name another time, or state the rate: `time: {{rate: 1000}}`"
            )
    there = decoded.present[parts[0]] & decoded.present[parts[1]]
    seconds, nanoseconds = (np.where(there, decoded.values[name], 0).astype(np.int64) for name in parts)
    return TableColumn(seconds * SECOND + nanoseconds, there, "ns")


def without_other_lines(lines: JsonLines, decoded: DecodedLines, names: Sequence[str]) -> tuple[DecodedLines, str]:
    """The lines that have one of the fields at least, and a sentence on the others, such as a header; empty if none."""
    kept = np.any([decoded.present[name] for name in names], axis=0)
    if kept.all():
        return decoded, ""
    first = lines.numbers[decoded.rows[int(np.argmin(kept))]]
    count = int((~kept).sum())
    note = (
        f"{lines.path.name}: {count} of {kept.size} lines have none of the fields and were left out, first line {first}"
    )
    values = {name: one[kept] for name, one in decoded.values.items()}
    present = {name: one[kept] for name, one in decoded.present.items()}
    return DecodedLines(decoded.rows[kept], values, present, decoded.misfits, decoded.misfit), note


MOST_ALONE = 100  # largest number of fields that are read one by one to be listed


class JsonChannel(TableChannel):
    """One number of every line."""

    ADDRESS: ClassVar[str] = "field"

    field: str
    """Dotted path of the number, with an index or a name where it passes an array: `variables.ankle_angle`,
    `position[0]`, `position[name=ankle]`; a name with a dot in it in quotes, `functions["loadcell.mz"]`."""
    unit: Unit
    """Unit of the number; JSON states none."""


class JsonTime(TableTime):
    """Where the time of a line comes from: a number in the line, or the rate at which lines were written."""

    ADDRESS: ClassVar[str] = "field"

    field: str | None = None
    """Path of the number that holds time, or of a stamp: an object of seconds and nanoseconds, without `unit`."""


class JsonSource(TableSource):
    """A log in JSON lines, one object per line. An incomplete last line is always skipped, with a warning."""

    format: Literal["json_lines"]
    """Format of the file."""
    time: JsonTime
    """Where the time of a line comes from."""
    channels: dict[str, JsonChannel] = Field(min_length=1)
    """The number of each canonical column."""


def read_json_log(path: Path, source: JsonSource) -> Recording:
    """The columns that the source file maps, in SI units; time [s] counts from the first line.

    A line that lacks a field has no sample of it. `null` is no value, `NaN` a reading that failed.
    """
    lines = read_json_lines(path)
    field = source.time.field
    parts = stamps_among(addresses_of(lines)[0]).get(field) if field else None
    if parts and source.time.unit is not None:
        raise InputError(
            f"{path}: field '{field}' is a stamp of '{parts[0]}' and '{parts[1]}', whose units are known; remove "
            f"{source.place('time', 'unit')}"
        )
    wanted = [name for channel in source.channels.values() for name in (channel.field, channel.counter) if name]
    names = list(dict.fromkeys([*wanted, *(parts or filter(None, [field]))]))
    decoded, note = decode_lines(lines, names), ""
    check_misfits(lines, decoded, source)
    if field:  # with a rate, every line counts
        decoded, note = without_other_lines(lines, decoded, names)

    def column(name: str) -> TableColumn:
        """A field of the lines that can be used."""
        if parts and name == field:
            return stamp_column(lines, decoded, parts)
        return TableColumn(decoded.values[name], decoded.present[name])

    notes = [*notes_on(lines, decoded), *[note] * bool(note)]
    return read_table_log(Table(path, decoded.rows.size, column, notes, damage_of(decoded)), source)


def check_misfits(lines: JsonLines, decoded: DecodedLines, source: JsonSource) -> None:
    """Refuse a log of which too many lines cannot be used; with a rate, any that is not the last one moves the rest."""
    count, total = decoded.misfits, lines.starts.size
    if count and (count > source.most_missing * total or source.time.rate is not None):
        share = share_above(count, total)
        advice = f", or write `most_missing: {share:g}` in the source file" if source.time.rate is None else ""
        raise InputError(
            f"{lines.path}: {count} of {total} lines cannot be used: {decoded.misfit}; repair the log{advice}"
        )


def notes_on(lines: JsonLines, decoded: DecodedLines) -> list[str]:
    count, total = decoded.misfits, lines.starts.size
    skipped = [f"{lines.path.name}: {count} of {total} lines cannot be used and were skipped: {decoded.misfit}"]
    return [*lines.notes, *skipped * bool(count)]


def damage_of(decoded: DecodedLines) -> dict[str, object]:
    """Lines that are lost, for the trial's provenance."""
    share = decoded.misfits / max(1, decoded.rows.size + decoded.misfits)
    return {"damage": {"messages_lost": decoded.misfits, "share_lost": share}} if decoded.misfits else {}


def inspect_json(path: Path) -> Overview:
    """Every number in the lines, with its range, and the likely clock."""
    lines = read_json_lines(path)
    names, long = addresses_of(lines)
    if not names:
        raise InputError(f"{path}: no line holds a number; name a recording")
    decoded = decoded_for_list(lines, names)
    stamp, parts = next(iter(stamps_among(names).items()), ("", ("", "")))
    shortest_first = sorted((name for name in names if name not in parts), key=lambda name: name.count("."))
    called = [name for name in shortest_first if is_clock(last_name(name))]
    named, left_open = likely_clock({name: readings_of(name, decoded[name]) for name in called}, "fields")
    clock = named or ("" if called else stamp)
    channels = [channel_of(name, decoded[name], name == clock) for name in names]
    remarks = list(dict.fromkeys(note for one in decoded.values() for note in notes_on(lines, one)))
    remarks += [f"{name} has {size} elements; only the first {MOST_ELEMENTS} are listed" for name, size in long.items()]
    remarks += guessed_units(channels, "field", last_name)
    unit = next((one.likely_unit for one in channels if one.address["field"] == clock), "")
    time = {"field": clock or NAME_OF_TIME, "unit": unit or UNKNOWN}
    if clock and clock == stamp:
        time = {"field": stamp}
        try:
            as_one = stamp_channel(stamp, stamp_column(lines, decode_lines(lines, parts), parts))
            channels = [as_one, *(one for one in channels if one.address["field"] not in parts)]
        except InputError as error:
            remarks.append(str(error))
    facts, settings = {"rows": str(lines.starts.size)}, {"clock": "master", "time": time}
    return Overview("json_lines", facts, channels, remarks, settings, open=left_open)


def stamp_channel(name: str, column: TableColumn) -> RecordedChannel:
    """A stamp of seconds and nanoseconds, as one clock."""
    there = np.ones(column.values.size, bool) if column.present is None else column.present
    seconds = (column.values[there] - column.values[there][:1].sum()) * 1e-9
    notes = ["a stamp of seconds and nanoseconds", gaps_text(seconds)]
    notes += [f"in {seconds.size} of {there.size} lines"] * bool(seconds.size < there.size)
    note = ", ".join(filter(None, notes))
    return RecordedChannel("field", {"field": name}, "", int(seconds.size), rate_of(seconds), note, "int64")


def decoded_for_list(lines: JsonLines, names: Sequence[str]) -> dict[str, DecodedLines]:
    """Every field for the list; each on its own where a line has something else than a number in one of them."""
    decoded = decode_lines(lines, names)
    if not decoded.misfits or len(names) > MOST_ALONE:
        return dict.fromkeys(names, decoded)
    return {name: decode_lines(lines, [name]) for name in names}


def readings_of(name: str, decoded: DecodedLines) -> Array:
    """The numbers of a field, (lines that have it,)."""
    return np.asarray(decoded.values[name][decoded.present[name]].astype(np.float64))


def channel_of(name: str, decoded: DecodedLines, is_time: bool) -> RecordedChannel:
    there = decoded.present[name]
    values = readings_of(name, decoded)
    known = values[np.isfinite(values)]
    note = range_text(known, is_time)
    note += f", {values.size - known.size} x NaN or Infinity" if known.size < values.size else ""
    note += f", in {values.size} of {there.size} lines" if values.size < there.size else ""
    kind = decoded.values[name].dtype.name
    unit = likely_unit(last_name(name)) or (unit_of_clock(known) if is_time else "")
    return RecordedChannel("field", {"field": name}, "", int(known.size), None, note, kind, likely_unit=unit)
