"""Logs as canonical columns. A log is a table of rows (CSV, JSON lines, MATLAB, TDMS, OpenSim) or a
file of messages by topic (MCAP, ROS bags), which are put in the order of their stamps. Nothing is
interpolated or held."""

import json
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.errors import InputError, listing, naming
from osl_analysis.ingest import source as sources
from osl_analysis.ingest.captures import exported_columns, exported_plates
from osl_analysis.ingest.conversion import origin_of, to_si
from osl_analysis.old_formats import csv_table
from osl_analysis.old_formats.binary_table import read_binary_table
from osl_analysis.old_formats.gait_text import opensim_header, read_opensim
from osl_analysis.old_formats.json_lines import (
    JsonLines,
    addresses_of,
    decode_lines,
    read_json_lines,
)
from osl_analysis.old_formats.mat import Value, open_mat
from osl_analysis.old_formats.mcap import read_mcap
from osl_analysis.old_formats.messages import (
    Decoded,
    MessageFile,
    RefusedFileError,
    WrongFieldError,
    decode_topics,
)
from osl_analysis.old_formats.rosbag import read_rosbag1, read_rosbag2, siblings
from osl_analysis.old_formats.table import Ledger, Table
from osl_analysis.old_formats.tdms import TdmsChannel, read_tdms
from osl_analysis.signals import runs
from osl_analysis.trial import Array, check_time, counter_column, median, unit_of
from osl_analysis.units import is_unit, name_and_ending, normalised, si_factor

RATE = "state the rate of the rows in Hz, as `time: {rate: HZ}`"
SECOND = 1_000_000_000
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # [s], of clocks
# last part of an address in MATLAB or HDF5, without its struct or group
NAME_ALONE = r"[./]?[^./]*$"
MOST_TRIED = 1000  # first rows of a column that decide whether it may be a clock


def read_table_log(path: Path, source: sources.TableSource) -> sources.Recording:
    """The columns that the source file maps, in SI units. Time [s] starts at 0 in the first row.
    Raises InputError."""
    table = TABLES[source.format](path, source)
    table.damage.read[0] = table.rows
    if table.rows < 2:
        raise InputError(
            f"holds one {table.noun} of data: nothing to analyse; record the trial again, or"
            " exclude it"
        )
    time, start = time_of(table, source)
    apart = check_other_clocks(table, source, time)
    first_by: dict[int, str] = {}
    # one column may be mapped twice, by its name and by its number
    for column, channel in source.channels.items():
        other = first_by.setdefault(id(table.columns[channel.name]), column)
        if other != column and sources.LEVEL_UNIT not in (unit_of(other), unit_of(column)):
            where = source.place("channels", column, channel.ADDRESS)
            raise InputError(
                f"{channel.title} is {other} and {column} in the source file; correct {where}"
            )
    table = with_own_rows(table, [one.name for one in source.channels.values()])
    columns, said = canonical_columns(table, source.channels, time, source)
    samples = pl.DataFrame([pl.Series("time", time), *columns])
    missing, origins = (
        {column: int(samples[column].is_nan().sum()) for column in source.channels},
        {},
    )
    said += [
        f"{name} is {table.failed} in {n} of {time.size} {table.noun}s"
        for name, n in missing.items()
        if n
    ]
    for column, channel in source.channels.items():
        unit = table.units.get(channel.name, "")
        origins[column] = {**origin_of(channel, column, unit), **table.found.get(channel.name, {})}
        if channel.unit and unit and channel.unit != unit:
            said.append(f"{column} is read in {channel.unit}; the file says {unit}")
    # rows that do not repeat the stamp of the row before
    fresh = np.concatenate([[True], np.diff(time) != 0])
    kept, did, repeated = fresh, "were left out", int((~fresh).sum())
    if source.time.repeated != "drop":
        kept, did = (
            np.ones_like(fresh),
            "are taken for samples whose stamps were rounded; if the device was read ",
        )
        did += f"faster than it sampled, write `repeated: drop` under {source.place('time')}"
        values = samples.drop("time")  # for rows that repeat the row before in stamp and values
        same = (
            (values[1:] == values[:-1])
            .select(pl.all_horizontal(pl.all().fill_null(True)))
            .to_series()
        )
        copied = int((~fresh[1:] & same.to_numpy()).sum())
        if copied > max(20, 0.1 * fresh.size):
            twice = (
                f"{copied} of {fresh.size} {table.noun}s have time and values of the {table.noun}"
                " before"
            )
            raise InputError(
                f"{twice}; write `repeated: drop` under {source.place('time')}, to read each once"
            )
    if repeated:
        said.append(
            f"{repeated} of {fresh.size} {table.noun}s repeat the stamp of the {table.noun} before"
            f" and {did}"
        )
    facts: dict[str, Any] = {"time": {**source.time.model_dump(exclude_none=True), "start": start}}
    facts |= {
        "rates_hz": {path.name: rate_of(time[kept])},
        "repeated_stamps": repeated,
        "missing": missing,
    }
    facts |= ({"clocks_apart": apart} if apart else {}) | {**table.facts}
    recording = sources.Recording(
        samples.filter(pl.Series(kept)), origins, facts, said, table.damage
    )
    if isinstance(source, sources.OpenSimSource) and source.plates:
        return exported_plates(table, recording, source)
    return recording


def wanted(source: sources.TableSource) -> list[str]:
    """The addresses of all columns that a source file names (time, signals, counters), without
    repeats."""
    named = [name for one in source.channels.values() for name in (one.name, one.counter)]
    plates = source.plates.values() if isinstance(source, sources.OpenSimSource) else ()
    named += [name for plate in plates for name in exported_columns(plate)]
    return [*dict.fromkeys(name for name in [source.time.name, *named] if name)]


def with_own_rows(table: Table, names: Sequence[str]) -> Table:
    """The table with failed readings masked where several devices write rows of their own into one
    log. Columns are of two such devices if no row has readings of both. Each then keeps only its
    own rows."""
    real = {name: column for name in names if (column := table.columns[name]).dtype.kind == "f"}
    failed = {
        name: one for name, column in real.items() if (one := np.isnan(np.ma.getdata(column))).any()
    }
    apart = [
        a
        for a, of_a in failed.items()
        if any((of_a | of_b).all() and not of_b.all() for of_b in failed.values())
    ]
    own = {
        name: np.ma.masked_where(failed[name], real[name])
        for name in apart
        if not failed[name].all()
    }
    return replace(table, columns={**table.columns, **own}) if len(own) > 1 else table


def canonical_columns(
    table: Table, channels: Mapping[str, sources.LogChannel], time: Array, source: sources.LogSource
) -> tuple[list[pl.Series], list[str]]:
    """The channels of a table with times (rows,) [s] as canonical columns, with their counters, and
    a sentence for each channel that lacks values. Raises InputError: a count is missing or is no
    whole number."""
    columns, absent = list[pl.Series](), dict[str, None]()
    for column, channel in channels.items():
        what, lacking = channel.title, np.ma.getmaskarray(table.columns[channel.name])
        columns.append(canonical_column(column, table, time, source))
        if lacking.any() and not table.has_own_rows:
            count = f"{int(lacking.sum())} of {lacking.size} {table.noun}s, first {table.noun}"
            absent[f"{what} has no value in {count} {int(np.argmax(lacking)) + 1}"] = None
        if channel.counter is None:
            continue
        found = table.columns[channel.counter]
        raw, wrong = np.ma.getdata(found), np.ma.getmaskarray(found) | (found.dtype == bool)
        # floats hold whole numbers exactly below 2**53
        largest = 2.0**53 if raw.dtype.kind == "f" else 2**63
        if raw.dtype != bool:
            wrong = wrong | ~(np.abs(raw.astype(np.float64)) < largest) | (raw != np.rint(raw))
        if wrong.any():
            row = int(np.argmax(wrong))
            shown = "nothing" if np.ma.getmaskarray(found)[row] else raw[row]
            said = (
                f"{channel.ADDRESS} '{channel.counter}': {shown} in {table.place(row)}, at"
                f" {time[row]:.3f} s"
            )
            said += f", is no count of samples, a whole number below {largest:.3g}"
            remedy = (
                f"correct `counter` in the source file or leave it out, or remove the {table.noun}"
                " from the log"
            )
            raise InputError(f"{said}; {remedy}")
        columns.append(pl.Series(counter_column(column), raw.astype(np.int64)))
    return columns, list(absent)


def canonical_column(
    column: str, table: Table, time: Array, source: sources.LogSource
) -> pl.Series:
    """A channel of a table in SI units: NaN where a reading failed, null where there is no value.
    Raises InputError: truth values in a column that is no level, infinity, or more failed readings
    than `most_missing`."""
    channel, what = source.channels[column], source.channels[column].title
    raw, lacking = table.columns[channel.name], np.ma.getmaskarray(table.columns[channel.name])
    if raw.dtype == bool and unit_of(column) != sources.LEVEL_UNIT:
        row = int(np.argmin(lacking))
        said = (
            f"{what} is {str(bool(np.ma.getdata(raw)[row])).lower()} in {table.place(row)}, a truth"
            " value"
        )
        raise InputError(
            f"{said} and no number in {unit_of(column)}; name a number as `{channel.ADDRESS}` in"
            " the source file"
        )
    with np.errstate(invalid="ignore"):  # a signalling NaN is a missing value, too
        values = np.where(lacking, 0.0, np.ma.getdata(raw).astype(np.float64))
    missing = np.isnan(values)
    sources.check_values(what, np.where(missing, 0.0, values), time)
    if (count := int(missing.sum())) > source.most_missing * values.size:
        row = int(np.argmax(missing))
        first = f"at {time[row]:.3f} s" if table.lines is None else f"in {table.place(row)}"
        said = f"{what}: {table.failed} in {count} of {values.size} {table.noun}s, first {first}"
        most = f"`most_missing: {csv_table.share_above(count, values.size):g}`"
        remedy = f"repair the recording, or write {most} in the source file"
        raise InputError(f"{said}; at most {source.most_missing:.1%} may be: {remedy}")
    if channel.wraps_at is not None:
        known = ~(missing | lacking)
        values[known] = np.unwrap(values[known], period=channel.wraps_at)
    with naming(what, f", as {source.place('channels', column, 'unit')}"):
        series = pl.Series(
            column, to_si(channel, values, unit_of(column), table.units.get(channel.name, ""))
        )
    return series.set(pl.Series(lacking), None) if lacking.any() else series


def time_of(table: Table, source: sources.TableSource) -> tuple[Array, float]:
    """Time (rows,) [s] since the first row, and the reading of the clock in that row."""
    stated = source.time
    if not stated.name:
        own = np.arange(table.rows) / stated.rate if stated.rate is not None else table.time
        # the source file must state a rate or a name if the format has no time
        assert own is not None
        return own - own[0], float(own[0])
    what, raw = stated.title, np.ma.getdata(table.columns[stated.name])
    other = f"take another {stated.ADDRESS}, or {RATE}"
    lacking = np.isnan(raw.astype(np.float64)) | np.ma.getmaskarray(table.columns[stated.name])
    if raw.dtype == bool or lacking.any():
        where = (
            "but truth values"
            if raw.dtype == bool
            else f"in {table.place(int(np.argmax(lacking)))}"
        )
        raise InputError(f"{what}: no time {where}; remove it there, {other}")
    if stated.rate is not None:
        factor = 1 / stated.rate
        if (raw != np.rint(raw)).any():
            row = int(np.argmax(raw != np.rint(raw)))
            said = (
                f"{raw[row]} in {table.place(row)} is no count of samples, which a column beside"
                " `rate` is"
            )
            raise InputError(f"{what}: {said}; state its unit in place of the rate")
    elif table.has_stamps:
        factor = 1e-9
    else:
        with naming(what, f", as {source.place('time', 'unit')}"):
            factor = si_factor(
                table.units.get(stated.name, "") if stated.unit is None else stated.unit, "s"
            )
    # single precision would round the differences
    raw = raw.astype(np.float64) if raw.dtype.kind == "f" else raw
    raw, remark = unwrapped(raw, what)
    table.damage.remarks.extend(remark)
    time = np.asarray((raw - raw[0]) * factor, dtype=np.float64)
    check_time(what, time)
    _, first, counts = np.unique(time, return_index=True, return_counts=True)
    most, row = int(counts.max()), int(first[counts.argmax()])
    # s
    is_coarse = most > 20 and (
        most > 0.1 * time.size or (len(first) > 3 and median(np.diff(time[first])) > 0.4)
    )
    if most == time.size or (is_coarse and stated.repeated != "drop"):
        at = f"{raw[row] * factor if table.has_stamps else raw[row]:.15g}{' s' * table.has_stamps}"
        which = f"at {at} in {most} of {time.size} {table.noun}s, from {table.place(row)} on"
        # stamps in whole seconds still tell the rate, from the first change to the last
        if len(first) > 3:
            other += (
                ": its stamps tell"
                f" {(first[-1] - first[1]) / (time[first[-1]] - time[first[1]]):.4g}"
            )
        raise InputError(
            f"{what}: time stands still {which}: it stopped, or tells no less; cut the log, {other}"
        )
    return time, float(raw[0])


def unwrapped(raw: NDArray[Any], what: str) -> tuple[NDArray[Any], list[str]]:
    """The readings (n,) of a counter that overflows at a power of two, unwrapped; and a remark if
    it overflowed. A step back is an overflow if adding that power makes it about as short as the
    other steps."""
    steps = np.diff(raw.astype(np.float64))
    back = steps < 0
    if not back.any() or (raw != np.rint(raw)).any() or not (steps > 0).any():
        return raw, []
    usual = float(np.median(steps[steps > 0]))
    for bits in (8, 16, 24, 32):
        again = steps[back] + 2.0**bits
        if (again >= 0).all() and (again <= 10 * usual).all():
            turns = np.concatenate([[0], np.cumsum(back)])
            said = (
                f"{what} counts to 2**{bits} and began anew {turns[-1]} times; it is taken to go on"
            )
            return np.asarray(raw.astype(np.int64) + turns * 2**bits), [said]
    return raw, []


TRUTHS = {"true": "1", "false": "0"}


def read_any_table(
    name: str, path: Path, layout: csv_table.CsvLayout, most_rows: int | None = None
) -> csv_table.CsvTable:
    """The rows of a table, of text or in a binary format; at most about the first `most_rows`."""
    of_text = {"csv": csv_table.read_csv_table, "opensim": read_opensim}
    return of_text.get(name, read_binary_table)(path, layout, is_unit, most_rows)


def csv_log(path: Path, source: sources.SheetSource) -> Table:
    chosen = {one.name for one in fields(csv_table.CsvLayout)} & {*type(source).model_fields}
    layout = csv_table.CsvLayout(**{name: getattr(source, name) for name in chosen})
    text = read_any_table(source.format, path, layout)
    text.damage.remarks.extend(text.not_read)
    places = {name: csv_table.place_of(name, text.names) for name in wanted(source)}
    text, sizes = of_asked_size(text, [*places.values()])
    clock = places.get(source.time.name)
    stamps = None if clock is None else csv_table.cell_stamps(text.body.to_series(clock))
    levels = level_places(source, places)
    values = {
        place: cells_of(text, place, source, place in levels)
        for place in {*places.values()} - {clock}
    }
    if clock is not None:
        values[clock] = (
            cells_of(text, clock, source, level=False, is_time=True) if stamps is None else stamps
        )
    if len({*sizes.values()}) > 1:
        return log_of_devices(text, source, places, values, sizes)
    clocks = list(clock_columns(text, source, {*places.values()}))
    end = len(text.lines)
    # rows end with the last value of any asked column; a longer column, as an EMG, is not asked
    if clock is not None:
        end = max(
            int(np.flatnonzero(~np.isnan(one.astype(np.float64)))[-1:].sum()) + 1
            for one in values.values()
        )
    values = {place: one[:end] for place, one in values.items()}
    rates = [("in words", one)] if (one := stated_rate(text.comments)) else []
    found = {}
    for name, place in places.items():
        if csv_table.name_and_unit(text.names[place])[0] != csv_table.name_and_unit(name)[0]:
            found[name] = {"found": text.names[place]}
    columns = {name: values[place] for name, place in places.items()}
    units = {name: text.units[place] for name, place in places.items()}
    return Table(
        end, columns, units, damage=text.damage, facts={"comments": text.comments[:100]},
        found=found, rates=rates,
        lines=text.lines[:end] if text.noun == "line" else None, failed="missing",
        has_stamps=stamps is not None,
        clocks=[(name, unit, one[:end]) for name, unit, one in clocks],
    )  # fmt: skip


def level_places(source: sources.SheetSource, places: Mapping[str, int]) -> set[int]:
    return {
        places[one.name]
        for name, one in source.channels.items()
        if unit_of(name) == sources.LEVEL_UNIT
    }


def of_asked_size(
    text: csv_table.CsvTable, asked: Sequence[int]
) -> tuple[csv_table.CsvTable, dict[int, int]]:
    """The table, cut to the length of the asked columns if that is one; and the number of values in
    each of these."""
    if not text.is_padded:
        return text, dict.fromkeys(asked, len(text.lines))
    sizes = [one.len() - one.null_count() for one in text.body]
    if len(known := {sizes[place] for place in asked}) == 1:
        own = [
            one if size in known else one.clear(one.len())
            for one, size in zip(text.body, sizes, strict=True)
        ]
        text = replace(text, lines=text.lines[: max(known)], body=pl.DataFrame(own)[: max(known)])
    return text, {place: sizes[place] for place in asked}


def log_of_devices(
    text: csv_table.CsvTable,
    source: sources.SheetSource,
    places: Mapping[str, int],
    values: Mapping[int, NDArray[Any]],
    sizes: Mapping[int, int],
) -> Table:
    """The table of asked columns that differ in length. Each keeps its own instants
    (`on_instants_of_all`)."""
    names, units = text.names, {name: text.units[place] for name, place in places.items()}
    signals = {
        name: (names[place], values[place][: sizes[place]], units[name])
        for name, place in places.items()
    }
    every = list[tuple[str, Array]]()
    for name, unit, one in zip(names, text.units, text.body, strict=True):
        if one.dtype.is_numeric():
            every.append(
                (
                    f"{name}_{unit}" * is_of_time(unit) or name,
                    one.drop_nulls().cast(pl.Float64).to_numpy(),
                )
            )
    columns = on_instants_of_all(signals, source, every)
    rows, facts = next(iter(columns.values())).size, {"comments": text.comments[:100]}
    return Table(rows, columns, units, damage=text.damage, facts=facts, has_own_rows=True)


def clock_columns(
    text: csv_table.CsvTable, source: sources.SheetSource, asked: Collection[int]
) -> Iterator[tuple[str, str, NDArray[Any]]]:
    """Name, unit and readings of columns that may be clocks. An asked signal may be one only by its
    name or stamps."""
    for place, (name, unit) in enumerate(zip(text.names, text.units, strict=True)):
        cells = text.body.to_series(place)
        if csv_table.cell_stamps(cells[:MOST_TRIED]) is not None:
            if (stamps := csv_table.cell_stamps(cells)) is not None:
                yield name, "s", stamps / SECOND
        elif is_like_clock(name) or place not in asked:
            with suppress(csv_table.UnreadableCellError):
                tried = csv_table.cell_numbers(cells[:MOST_TRIED], source.missing, text.decimal)
                if may_be_clock(name, unit, tried):
                    yield name, unit, csv_table.cell_numbers(cells, source.missing, text.decimal)
                elif source.time.rate is not None and np.mean(np.diff(tried) == 1) > 0.9:
                    check_count(
                        name,
                        csv_table.cell_numbers(cells, source.missing, text.decimal),
                        source.time,
                    )


def check_count(name: str, values: Array, time: sources.RowTime) -> None:
    """Refuse a stated rate of the rows if a column (n,) counts the rows and shows that some are
    missing."""
    steps = np.diff(unwrapped(values, name)[0])
    if (steps > 0).all() and (absent := int(steps.sum()) - steps.size):
        said = (
            f"{time.ADDRESS} '{name}' counts {absent} rows that are missing, and those behind would"
            " be early"
        )
        raise InputError(f"{said}; write `time: {{{time.ADDRESS}: {name}, rate: {time.rate:g}}}`")


def is_like_clock(name: str) -> bool:
    """Whether a column may be a clock by its name, such as `LabVIEW time`, `Date` or `sec`. Its
    readings decide."""
    last = re.split(r"[./]", csv_table.name_and_unit(name)[0])[-1]
    return (
        csv_table.is_clock(last)
        or re.search(r"(?i)time|date|clock|stamp|zeit|^[mu]?secs?$", last) is not None
    )


def may_be_clock(name: str, unit: str, values: NDArray[Any]) -> bool:
    """Whether a column (n,) may be a clock: by its name, or because it rises like one."""
    return is_like_clock(name) or ticks(values, unit)


def tells_time(name: str, unit: str) -> bool:
    return is_like_clock(name) or is_of_time(unit or likely_unit(csv_table.name_and_unit(name)[0]))


def is_of_time(unit: str) -> bool:
    """Whether a unit is a unit of time, or a multiple of one, such as `10 us`."""
    return re.sub(r"^\d+\*?", "", normalised(unit)) in TIME_UNITS


def likely_unit(name: str) -> str:
    """The unit that a column's name implies: by its ending (`ankle_deg`), or as a clock (`millis`);
    else empty."""
    return name_and_ending(name)[1] or {"millis": "ms", "ms": "ms", "micros": "us", "us": "us"}.get(
        name, ""
    )


def ticks(values: NDArray[Any], unit: str) -> bool:
    """Whether readings (n,) rise like a clock, apart from counter overflows: more than 80 % of the
    steps are within 20 % of their median, and the unit is one of time. Without a unit, `time_unit`
    must find one that fits."""
    steps = np.diff(unwrapped(values[np.isfinite(values)], "")[0])
    usual = float(np.median(steps)) if steps.size >= 20 and (steps >= 0).all() else 0.0
    even = usual > 0 and float(np.mean(np.abs(steps / usual - 1) < 0.2)) > 0.8
    return even and bool(is_of_time(unit) if unit else time_unit(values))


def rate_of(time: NDArray[Any], second: float = 1.0) -> float | None:
    """Median rate [Hz] of stamps (n,), with `second` units per second; None if no stamp is later
    than another."""
    steps = np.diff(time)
    steps = steps[steps > 0]
    return second / median(steps) if steps.size else None


def time_unit(clock: Array) -> str:
    """The likely unit of the readings (n,) of a clock; else empty. Recorders of joints run at 50 to
    5000 Hz, a span of less than 1000: only one unit gives such a rate. Readings that rise by one
    are left out: they may count rows, or be the whole seconds of a stamp in two parts."""
    rate, steps = rate_of(clock), np.diff(clock)
    counts = np.isin(steps, (0, 1)).all() or (rate == 1 and (steps == np.rint(steps)).all())
    if rate is None or clock.size < 20 or counts:
        return ""
    units = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9, "d": 1 / 86_400}
    return next((unit for unit, in_s in units.items() if 50.0 <= rate * in_s <= 5000.0), "")


WRITTEN = r"(\d+(?:[.,]\d+)*(?:e[+-]?\d+)?)"
OF_ROWS = (
    r"(?:sampl\w*|scan|acquisition|recording|data|output)["
    r" _]*(?:rate|frequency|freq)|fs\b|^(?:rate|frequency)\b"
)
OF_ROWS += r"|abtast(?:rate|frequenz)|fr\w+ d.\w*chantillonnage"
INTERVAL = (
    rf"(?i)\b(?:delta_x|dt|(?:sampl\w*[ _]*)?(?:interval|period))\b\D*?{WRITTEN}(?:\s*([mu]?)s\b)?"
)
NOT_OF_ROWS = (
    r"(?i)decimat|(down|sub|over)-?sampl|\bevery\W+(\d|other|second|n)|averag(ing|ed)|\bthinn"
)
NOT_OF_ROWS += r"|\b(device|internal|sensor|adc|emg|hardware)\b.*(rate|freq)"


def stated_rate(comments: Sequence[str]) -> float | None:
    """The rate of the rows [Hz] that comments state, such as `Sample rate: 500 Hz` or LabVIEW's
    `Delta_X`. None if they state several, or mention a device or a decimation: the rate may then
    not be that of the rows."""
    alone = r"[\s:=\x22[]*(\d{2,5}(?:\.\d*)?)(?:$|[\]};]|, )"
    rates, in_words = (
        set[float](),
        rf"(?i)\b(?:{OF_ROWS})(?:\D*?{WRITTEN}\s*(k?)(?:hz|s/s|sps)|{alone})",
    )
    for text in comments:
        if re.search(NOT_OF_ROWS, text):
            return None
        if (found := re.search(INTERVAL, text)) and (step := written_number(found[1])) > 0:
            rates.add(float(f"{1 / (step * TIME_UNITS[(found[2] or '') + 's']):.9g}"))
        elif found := re.search(in_words, text):
            rates.add(written_number(found[1] or found[3]) * (1000 if found[2] else 1))
    return rates.pop() if len(rates) == 1 and 1 < min(rates) < 1e6 else None


def written_number(text: str) -> float:
    """The number in a text with a decimal point or comma, or with thousands separators, as `1,000`;
    0 if none."""
    if re.fullmatch(r"[1-9]\d{0,2}(,\d{3})+(\.\d*)?", text):
        text = text.replace(",", "")
    with suppress(ValueError):
        return float(text.replace(",", "."))
    return 0.0


def span_ratio(
    span: float, other: float, more: Sequence[float] = (60.0, 3600.0, 86_400.0)
) -> float:
    """Ratio of two spans of time in unknown units: the one nearest to 1 over all units of time and
    those of `more`."""
    units = np.array([*TIME_UNITS.values(), *more])
    ratios = np.divide.outer(units, units).ravel() * span / other
    return float(ratios[np.argmin(np.abs(np.log(ratios)))])


def began(clock: Array, span: float) -> float:
    """First reading [s] of a clock (n,) in an unknown unit of time. Its known `span` [s] tells the
    unit."""
    units = np.array([*TIME_UNITS.values(), 60.0, 3600.0, 86_400.0])
    return float(clock[0] * units[np.argmin(np.abs(np.log(units * np.ptp(clock) / span)))])


def check_begin(
    table: Table,
    time: sources.RowTime,
    name: str,
    begin: float,
    own: Array,
    known: NDArray[np.bool_],
) -> None:
    """Remark a clock that begins [s] at another time than the table's, `own` (n,) [s] in the
    `known` rows (rows,). Refused if both have one name, as in tables side by side: it is then the
    time of the columns next to it."""
    if not time.name:
        return
    readings = unwrapped(np.ma.getdata(table.columns[time.name]), name)[0][known].astype(np.float64)
    late = begin - began(readings, float(np.ptp(own)))
    if 0.5 * median(np.diff(own)) < abs(late) < np.ptp(own):
        other = f"another {time.ADDRESS} '{name}' begins {late:.4g} s after time"
        if name == table.found.get(time.name, {}).get("found", time.name):
            raise InputError(
                f"{other}: what stands beside it is of its time; export each with the time of all"
            )
        table.damage.remarks.append(f"{other}: what it stamps, if anything, is early by that")


def check_other_clocks(table: Table, source: sources.TableSource, time: Array) -> dict[str, float]:
    """Other clocks of a table whose rate differs from that of its time [s] by 0.5 % or more, in any
    unit, each with the RMS [s] of the difference. Raises InputError: a stated rate that a clock
    contradicts by 5 %, or that differs from the rate in the file; a clock of the same name that
    begins at another time (`check_begin`)."""
    rate, apart, is_held = source.time.rate, dict[str, float](), False
    of_time = csv_table.name_and_unit(source.time.name)[0]
    for name, unit, every in table.clocks:
        known = np.isfinite(every.astype(np.float64))
        if (
            csv_table.name_and_unit(name)[0] == of_time
            or known.sum() < 3
            or known.size != time.size
        ):
            continue
        if rate is None and not tells_time(name, unit):  # a signal may rise as evenly
            continue
        values, own = unwrapped(every[known], name)[0].astype(np.float64), time[known]
        steps, span = np.diff(values), own[-1] - own[0]
        step, most = float(steps.mean()), float(steps.max())
        if not (
            span > 0
            and step > 0
            and (steps >= 0).all()
            and most <= max(3 * step, 0.02 * steps.sum())
        ):
            continue  # it does not run
        is_held = True
        ratio = span_ratio(float(steps.sum()), span)
        if not known[-1] and abs(ratio - 1) > 0.05:
            raise InputError(
                f"{source.time.ADDRESS} '{name}' ends at"
                f" {table.place(int(np.flatnonzero(known)[-1]))} and tells another time for what"
                " stands beside it; export the channels of each rate on their own"
            )
        if rate is not None and abs(ratio - 1) > 0.05:
            what = (
                f"`rate: {rate:g}` of time, but {source.time.ADDRESS} '{name}' rises by {step:.4g}"
                " a row"
            )
            raise InputError(
                f"{what}; write `time: {{{source.time.ADDRESS}: {name}}}` with its unit, or correct"
                " the rate"
            )
        if abs(ratio - 1) > 0.005 + most / steps.sum():
            apart[name] = abs(ratio - 1) * span / 12**0.5
            said = f"{source.time.ADDRESS} '{name}' goes on {ratio:.4g} times as fast as time"
            beside = f" ({source.time.title})" * bool(source.time.name)
            table.damage.remarks.append(f"{said}{beside}: B and I depend on which of them is right")
        elif rate is None:
            check_begin(table, source.time, name, began(values, span), own, known)
    if rate is not None:
        check_rate(rate, table, is_held)
    return apart


def check_rate(rate: float, table: Table, is_held: bool) -> None:
    """Refuse a stated rate [Hz] that the file contradicts. Remark it if nothing in the file
    confirms it."""
    for name, stated in table.rates:
        if abs(rate / stated - 1) > 0.01:
            raise InputError(
                f"`rate: {rate:g}` of time, but the file says {stated:.6g} Hz ({name}); correct the"
                " rate"
            )
    if not (is_held or table.rates):
        said = (
            f"`rate: {rate:g}` of time is held against nothing: no clock and no rate stand in the"
            " file"
        )
        table.damage.remarks.append(f"{said}; by one that is 10 % wrong B is 10 % and I 21 % wrong")


def cells_of(
    text: csv_table.CsvTable,
    place: int,
    source: sources.SheetSource,
    level: bool,
    is_time: bool = False,
) -> NDArray[Any]:
    """Numbers of one column, (rows,), NaN where they are missing. In a `level`, the words `True`
    and `False` (any case) are 1 and 0: loggers in Python write them so."""
    cells: Any = text.body.to_series(place)
    if cells.dtype == pl.Boolean:
        return np.asarray(cells.to_numpy())
    if is_time and (cells.dtype == pl.String or cells.dtype.is_integer()):
        whole = cells.cast(pl.Int64, strict=False)  # floats would round nanoseconds since 1970
        if not whole.null_count():
            return np.asarray(whole.to_numpy())
    if level and cells.dtype == pl.String:
        cells = [TRUTHS.get(cell.casefold(), cell) if cell is not None else None for cell in cells]
    try:
        return csv_table.cell_numbers(cells, source.missing, text.decimal)
    except csv_table.UnreadableCellError as error:
        cell = str(cells[error.place])
        said = (
            f"{text.noun} {text.lines[error.place]}, column '{text.names[place]}': '{cell[:40]}' is"
            " not a number"
        )
        raise InputError(
            f"{said}; {remedy_for(cell, text.names[place], text.decimal, is_time)}"
        ) from error


def remedy_for(text: str, name: str, decimal: str, is_time: bool) -> str:
    """What to do about a cell that is not a number."""
    if text.casefold() in TRUTHS:
        return "name a column of numbers; a truth value can only be `sync` or `trigger`"
    # 2024-05-01T12:00:00, 12:00:00.5
    if re.search(r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}|\d{1,2}:\d{2}", text):
        return "write time as seconds, or as `12:00:00.500` in every row"
    if text == name:
        return (
            "the header stands here again, as where a recorder begins anew: cut the file in two, a"
            " log each"
        )
    if decimal == "," and "." in text:
        return 'write `decimal: "."` in the source file if the full stop is the decimal sign'
    if re.fullmatch(r"[+-]?\d+,\d+", text):
        return 'write `decimal: ","` in the source file if the comma is the decimal sign'
    if is_time:
        return "correct the cell, or delete the line"
    return (
        f"correct the cell, or add {json.dumps(text[:40], ensure_ascii=False)} to `missing` in the"
        " source file"
    )


def json_log(path: Path, source: sources.JsonSource) -> Table:
    """The table of a log in JSON lines. A missing field or `null` is no sample; `NaN` is a failed
    reading."""
    lines, field = read_json_lines(path), source.time.field
    names, (found, _) = wanted(source), addresses_of(lines)
    parts = next((pair for pair in stamp_fields(field) if {*pair} <= {*found}), ()) if field else ()
    if parts:  # time is an object of seconds and nanoseconds
        names = [*parts, *(name for name in names if name != field)]
        if source.time.unit is not None:
            raise InputError(
                f"field '{field}' is a stamp whose unit is known; remove"
                f" {source.place('time', 'unit')}"
            )
    decoded = decode_lines(lines, names)
    count, total, by_rate = decoded.misfits, len(lines.texts), source.time.rate is not None
    # with a rate, a missing line shifts all later ones
    if count > (0 if by_rate else source.most_missing * total):
        advice = (
            f", or write `most_missing: {csv_table.share_above(count, total):g}` in the source file"
        )
        what = f"{count} of {total} lines cannot be used: {decoded.misfit}"
        raise InputError(f"{what}; repair the log{advice * (not by_rate)}")
    kept = ~np.all([np.ma.getmaskarray(decoded.values[name]) for name in names], axis=0)
    # lines without any asked field, such as a header; with a rate, every line counts
    if field and not kept.all():
        left_out, first = int((~kept).sum()), lines.numbers[decoded.rows[int(np.argmin(kept))]]
        said = (
            f"{left_out} of {kept.size} lines have none of the fields and were left out, first line"
            f" {first}"
        )
        lines.damage.remarks.append(said)
    rows = np.flatnonzero(kept) if field else np.arange(kept.size)
    # masked where a line lacks the field
    columns = {name: values[rows] for name, values in decoded.values.items()}
    few = replace(lines, texts=lines.texts[:MOST_TRIED], numbers=lines.numbers[:MOST_TRIED])
    likely = [
        name
        for name in found
        if name not in names and may_be_clock(name, "", readings_of(few, name))
    ]
    clocks = [(name, "", readings_of(lines, name)[decoded.rows[rows]]) for name in likely]
    table = Table(
        rows.size,
        columns,
        damage=lines.damage,
        lines=lines.numbers[decoded.rows[rows]],
        clocks=clocks,
    )
    if not parts:
        return table
    stamps = whole_stamps(table, parts, f"name another time, or {RATE}")
    return replace(table, columns={**columns, str(field): stamps}, units={str(field): "ns"})


def readings_of(lines: JsonLines, name: str) -> Array:
    """The readings (n,) of a field that is not mapped, one per line; NaN where a line has no number
    there."""
    values = np.full(len(lines.texts), np.nan)
    with suppress(InputError):
        decoded = decode_lines(replace(lines, damage=Ledger()), [name])
        values[decoded.rows] = np.ma.filled(decoded.values[name].astype(np.float64), np.nan)
    return values


def stamp_fields(field: str) -> list[tuple[str, str]]:
    """Paths of a stamp's seconds and nanoseconds, as ROS 2, protobuf, Foxglove's JSON and ROS 1
    name them."""
    names = (("sec", "nanosec"), ("seconds", "nanos"), ("sec", "nsec"), ("secs", "nsecs"))
    return [(f"{field}.{seconds}", f"{field}.{nanoseconds}") for seconds, nanoseconds in names]


def whole_stamps(table: Table, parts: Sequence[str], remedy: str) -> NDArray[Any]:
    """Stamps [ns], (rows,), from columns of seconds and nanoseconds; masked where a row lacks one
    of them."""
    whole = []
    for name, most in zip(parts, (2**63 // SECOND - 1, SECOND), strict=True):
        values = np.ma.filled(table.columns[name], 0)
        number = values.astype(np.float64)
        wrong = (
            (number < 0) | (number > most) | (number != np.rint(number)) | (values.dtype == bool)
        )
        if wrong.any():
            row = int(np.argmax(wrong))
            said = (
                f"field '{name}' is {values[row]} in {table.place(row)}, which is no whole number"
                f" from 0 to {most}"
            )
            raise InputError(f"{said}; {remedy}")
        whole.append(
            np.ma.array(values.astype(np.int64), mask=np.ma.getmaskarray(table.columns[name]))
        )
    return np.ma.asarray(whole[0] * SECOND + whole[1])


def mat_log(path: Path, source: sources.MatSource) -> Table:
    file, every = open_mat(path), list[tuple[str, Array]]()
    with suppress(InputError):  # variables that are not mapped may be too large, or of another kind
        every = [*vectors_in(file.read(file.names))]
    signals = file.signals(wanted(source), source.log_part)
    vectors = {text: values for text, (_, values, _) in signals.items()}
    reference = source.time.name or next(iter(vectors))
    facts = {"version": file.version, "header": file.header, "log_part": source.log_part}
    found = {text: {"variable": address} for text, (address, _, _) in signals.items()}
    units = {text: unit for text, (_, _, unit) in signals.items()}
    if len({values.size for values in vectors.values()}) > 1:
        vectors = on_instants_of_all(signals, source, every)
        return Table(
            vectors[reference].size,
            vectors,
            units,
            None,
            file.damage,
            facts,
            found,
            noun="sample",
            has_own_rows=True,
        )
    lacking = reduce(np.logical_or, map(np.ma.getmaskarray, vectors.values()))
    if lost := int(lacking.sum()):
        of = [text for text, values in vectors.items() if np.ma.getmaskarray(values).any()]
        said = (
            f"{lost} of {lacking.size} samples of {listing(of)} were never written and are left out"
        )
        # the rest would have no time
        if lost == lacking.size or (not source.time.name and lacking[:-lost].any()):
            raise InputError(f"{said}; record the trial again, or name its time")
        file.damage.lose(said, 0, Counter({0: lost}), 0)
        vectors = {text: np.ma.getdata(values)[~lacking] for text, values in vectors.items()}
    beside = {address.rpartition(".")[0] for address, _, _ in signals.values()}
    every = [one for one in every if one[0].rpartition(".")[0] in beside]
    asked = {address for address, _, _ in signals.values()}
    clocks = [(name, "", values[~lacking]) for name, values in every if values.size == lacking.size]
    clocks = [
        one
        for one in clocks
        if is_like_clock(one[0]) or (one[0] not in asked and ticks(one[2], ""))
    ]
    rates = [
        (name, float(values[0]))
        for name, values in every
        if values.size == 1 and re.search(r"(?i)\bfs$", name)
    ]
    return Table(
        vectors[reference].size, vectors, units, damage=file.damage, facts=facts, found=found,
        noun="sample",
        clocks=clocks, rates=[(name, rate) for name, rate in rates if rate > 0],
    )  # fmt: skip


def on_instants_of_all(
    signals: Mapping[str, tuple[str, Array, str]],
    source: sources.TableSource,
    every: Sequence[tuple[str, Array]],
) -> dict[str, Array]:
    """The signals of several devices at the instants of all, (instants,), masked where a device has
    no sample. Each signal's time is the only clock of its length in its struct or group. All clocks
    are taken to count from one origin, as in TDMS. The column of time holds the instants, in its
    own unit."""
    time = source.time.name if source.time.rate is None else None
    stamps = dict[str, NDArray[np.int64]]()
    reference = time or next(iter(signals))
    first = signals[reference][1]
    unit = str(source.time.unit or (signals[time][2] if time else "s"))
    for text, (address, values, _) in signals.items():
        place = re.sub(NAME_ALONE, "", address.removeprefix("/"))
        beside = [
            one
            for one in every
            if re.sub(NAME_ALONE, "", one[0]) == place and one[1].size == values.size
        ]
        clocks = [one for one in beside if may_be_clock(one[0], "", one[1])]
        own = [(reference, first)] if values.size == first.size else clocks
        if (
            not time
            or len(own) != 1
            or np.ma.is_masked(values)
            or not (np.diff(own[0][1]) > 0).all()
        ):
            said = f"{text} has {values.size} numbers and {reference} has {first.size}"
            said += (
                ", and no one vector of time of its length is beside it; interpolate it to the"
                " times of the others"
            )
            raise InputError(
                f"{said}, as `torque = interp1(t_torque, torque, t_angle)`, and never cut to one"
                " length"
            )
        name, clock = own[0]
        told = name_and_ending(name)[1]
        factor = si_factor(told if told in TIME_UNITS and name != time else unit, "s")
        stamps[text] = np.rint(clock * factor * SECOND).astype(np.int64)
    union, placed = on_union({text: values for text, (_, values, _) in signals.items()}, stamps)
    return placed | {str(time): union / (SECOND * si_factor(unit, "s"))}


def on_union(
    values: Mapping[str, NDArray[Any]], stamps: Mapping[str, NDArray[np.int64]]
) -> tuple[NDArray[np.int64], dict[str, NDArray[Any]]]:
    """All instants (n,) of channels with rising whole stamps, and their values, masked where a
    channel has none."""
    if max(one[0] for one in stamps.values()) > min(one[-1] for one in stamps.values()):
        raise InputError(
            f"its channels do not overlap in time; name those of one recording, or {RATE}"
        )
    union = np.unique(np.concatenate([*{id(one): one for one in stamps.values()}.values()]))
    placed = dict[str, NDArray[Any]]()
    for name, one in values.items():
        placed[name] = np.ma.array(np.zeros(union.size, one.dtype), mask=True)
        placed[name][np.searchsorted(union, stamps[name])] = one
    return union, placed


def vectors_in(values: Mapping[str, Value], place: str = "") -> Iterator[tuple[str, Array]]:
    """Address and numbers of each numeric variable of a MATLAB file."""
    for name, value in values.items():
        address = f"{place}.{name}".removeprefix(".")
        if value.numbers is not None:
            yield address, np.ma.filled(value.numbers, np.nan).ravel()
        for element in value.elements:
            yield from vectors_in(element, address)


def tdms_log(path: Path, source: sources.TdmsSource) -> Table:
    """TDMS channels, timed by a channel, a stated rate or their own timing. If timings differ, each
    has own rows."""
    file = read_tdms(path)
    channels = {name: file.channel(name) for name in wanted(source)}
    by_address = {channel.address: channel for channel in channels.values()}
    values, one = file.values([*by_address.values()]), next(iter(by_address.values()))
    by_properties = not source.time.name and source.time.rate is None
    # the last segment may be cut within a channel
    if file.damage.end_missing and not by_properties:
        shortest = min(each.size for each in values.values())
        values = {address: each[:shortest] for address, each in values.items()}
    rows = {size: np.arange(size) for size in {each.size for each in values.values()}}
    stamps, facts = {address: rows[each.size] for address, each in values.items()}, dict[str, Any]()
    for other in by_address.values():
        if by_properties and other.step is None:
            said = f"channel '{other.address}' has no timing (`wf_increment` among its properties)"
            raise InputError(
                f"{said}; name the channel of time, as `time: {{channel: GROUP/NAME, unit: s}}`, or"
                f" {RATE}"
            )
    if not (by_properties and file.damage.end_missing):
        check_alike(by_address, values, by_properties)
    if by_properties and len({(other.begin, other.step) for other in by_address.values()}) > 1:
        for address, other in by_address.items():
            after = np.rint(stamps[address] * float(other.step or 0.0) * SECOND).astype(np.int64)
            stamps[address] = other.begin - one.begin + after
        facts = {
            "rates_hz": {
                address: 1 / float(other.step or 1.0) for address, other in by_address.items()
            }
        }
    union, placed = on_union(values, stamps)
    own = (
        np.asarray(union * (1 / SECOND if facts else float(one.step or 0.0)))
        if by_properties
        else None
    )
    columns = {name: placed[channel.address] for name, channel in channels.items()}
    units = {
        name: "s" if channel.holds_times else channel.unit for name, channel in channels.items()
    }
    others = {
        one.address: one
        for one in file.channels
        if one.count and (one.holds_times or one.holds_numbers)
    }
    others = {address: one for address, one in others.items() if address not in by_address}
    tried = file.values([*others.values()], MOST_TRIED)
    likely = [
        one
        for at, one in others.items()
        if one.holds_times or may_be_clock(one.name, one.unit, tried[at])
    ]
    clocks = [(at, others[at].unit, values) for at, values in file.values(likely).items()]
    rates = [
        (f"wf_increment of '{each.address}'", 1 / each.step)
        for each in by_address.values()
        if each.step
    ]
    return Table(
        placed[one.address].size, columns, units, own, file.damage, facts, clocks=clocks,
        rates=rates,
        has_own_rows="rates_hz" in facts,
    )  # fmt: skip


def check_alike(
    channels: Mapping[str, TdmsChannel], values: Mapping[str, NDArray[Any]], by_properties: bool
) -> None:
    """Refuse channels with one timing (begin and rate, or one time) but unequal counts. Some have
    lost values, nothing tells where, and all later values would be early against the other
    channels."""
    first: dict[tuple[int, float | None] | None, str] = {}
    for address, channel in channels.items():
        other = first.setdefault((channel.begin, channel.step) if by_properties else None, address)
        if values[other].size != values[address].size:
            said = (
                f"channel '{address}' has {values[address].size} values and '{other}' has"
                f" {values[other].size}"
            )
            said += (
                " for one time: a segment has lost some, nothing tells where, or they are of two"
                " recordings"
            )
            raise InputError(f"{said}; copy the file again, or name channels of one length")


def opensim_log(path: Path, source: sources.OpenSimSource) -> Table:
    table = csv_log(path, source)
    header = opensim_header(table.facts["comments"])
    angles = {"rad": {"yes": "deg", "no": "rad"}, "rad/s": {"yes": "deg/s", "no": "rad/s"}}
    # the unit of an angle must agree with the header's inDegrees
    for column, channel in source.channels.items():
        canonical, said = unit_of(column), header.get("indegrees", "").casefold()
        own = angles.get(canonical, {}).get(said)
        if own is not None and not np.isclose(
            si_factor(str(channel.unit), canonical), si_factor(own, canonical)
        ):
            what = (
                f"its header says inDegrees={said}, and column '{channel.column}' is read in"
                f" {channel.unit}"
            )
            raise InputError(f"{what}; write {own}, as {source.place('channels', column, 'unit')}")
    return replace(table, facts={"header": header, "clock": source.clock})


TABLES: dict[str, Callable[[Path, Any], Table]] = {
    "csv": csv_log,
    "table": csv_log,
    "json_lines": json_log,
}
TABLES |= {"mat": mat_log, "tdms": tdms_log, "opensim": opensim_log}
OPENERS = {"mcap": read_mcap, "rosbag1": read_rosbag1, "rosbag2": read_rosbag2}


def read_message_log(path: Path, source: sources.MessageSource) -> sources.Recording:
    """The columns that the source file maps, in SI units. Time [s] counts from the first stamp.
    Topics with different stamps have rows of their own, null in the columns of the others. The
    file's losses are in the recording's `damage`. Raises InputError: messages cannot be decoded, a
    loss exceeds `largest_loss`, or stamps contradict each other."""
    file = OPENERS[source.format](path)
    if source.format == "mcap" and (remark := siblings(path)[-1]):
        file.damage.remarks.append(remark)
    by_topic: dict[str, dict[str, sources.MessageChannel]] = defaultdict(dict)
    for column, channel in source.channels.items():
        by_topic[channel.topic][column] = channel
    decoded = decode_wanted(file, by_topic, source)
    tables, orders, absent = dict[str, pl.DataFrame](), dict[str, dict[str, int]](), list[str]()
    how = {topic: one.how for topic, one in decoded.items()}
    for topic in [*decoded]:
        with naming(f"topic '{topic}'"):
            tables[topic], orders[topic], lacking = read_topic(
                by_topic[topic], decoded.pop(topic), source, file.damage
            )
        absent += [f"topic '{topic}': {text}" for text in lacking]
    rates = {topic: rate_of(table["stamp"].to_numpy(), SECOND) for topic, table in tables.items()}
    joined = joined_on_stamp([tables.pop(topic) for topic in [*tables]])
    missing = {column: int(joined[column].is_nan().sum()) for column in source.channels}
    start, stamp = (
        int(joined["stamp"][0]),
        str(source.time.field if source.time.source == "header" else "log"),
    )
    time = ((joined.drop_in_place("stamp") - start) / SECOND).alias("time")
    facts: dict[str, Any] = {
        "time": {"source": stamp, "stamps": source.time.stamps, "start_ns": start}
    }
    facts |= {"rates_hz": rates, "decoding": how, "stamps": orders, "missing": missing}
    columns = {column: origin_of(channel, column) for column, channel in source.channels.items()}
    remarks, topics = list[str](), {topic: file.channels_of(topic) for topic in by_topic}
    for topic, order in orders.items():
        counts = {
            "came late and were put in the order of their stamps": order["late"],
            "repeat a stamp and were joined to its first": (
                order["repeated"] - order["contradicted"]
            ),
            "contradict an earlier one of the same stamp and are lost": order["contradicted"],
        }
        remarks += [
            f"topic '{topic}': {count} messages {what}" for what, count in counts.items() if count
        ]
    remarks += [
        *absent,
        *(f"{column} is NaN in {n} of {len(joined)} rows" for column, n in missing.items() if n),
    ]
    return sources.Recording(
        pl.DataFrame([time, *joined]), columns, facts, remarks, file.damage, topics
    )


def decode_wanted(
    file: MessageFile,
    by_topic: Mapping[str, Mapping[str, sources.MessageChannel]],
    source: sources.MessageSource,
) -> dict[str, Decoded]:
    """The mapped fields of each topic, and its stamp. Raises InputError: the file has lost a larger
    share of a topic than `largest_loss`. This is also the message if the loss is why decoding
    fails."""
    stamps = [name for pair in stamp_fields(str(source.time.field)) for name in pair]
    first, wanted, failed = stamps if source.time.source == "header" else [], {}, None
    for topic, channels in by_topic.items():
        named = (
            name
            for channel in channels.values()
            for name in (channel.field, channel.counter)
            if name
        )
        wanted[topic] = [*dict.fromkeys([*first, *named])]
    try:
        decoded = decode_topics(file, wanted, optional=stamps)
    except (RefusedFileError, WrongFieldError):
        raise
    except InputError as error:
        failed = error
    for topic in by_topic:
        numbers = file.channels_of(topic)
        share = file.damage.share_lost(numbers or None)
        if share > source.largest_loss:
            misfits = sum(file.damage.misfits[number] for number in numbers)
            are_all = misfits == file.damage.lost(numbers)
            what = (
                "messages that cannot be used" if are_all else f"damaged or incomplete {file.kind}"
            )
            said = (
                f"{what}: {100 * share:.3g} % of topic '{topic}' is lost, at most"
                f" {100 * source.largest_loss:.3g}"
            )
            said += (
                " % may be (largest_loss in the source file):"
                f" {'; '.join(file.damage.all_remarks())}"
            )
            raise InputError(
                f"{said}; record again{', or map another field' * are_all}"
            ) from failed
    if failed is None:
        return decoded
    if not file.damage.remarks:
        raise failed
    remarks, (reason, semicolon, remedy) = (
        ", ".join(file.damage.all_remarks()),
        str(failed).rpartition("; "),
    )
    raise InputError(
        f"{reason} ({remarks}); {remedy}" if semicolon else f"{failed} ({remarks})"
    ) from failed


def read_topic(
    channels: Mapping[str, sources.MessageChannel],
    decoded: Decoded,
    source: sources.MessageSource,
    damage: Ledger,
) -> tuple[pl.DataFrame, dict[str, int], list[str]]:
    """Stamps [ns] and columns of a topic, sorted by stamp; counts of the sorting; a sentence per
    field with gaps."""
    logged, number, from_header = decoded.log_time, decoded.channel, source.time.source == "header"
    table = Table(logged.size, decoded.values, noun="message")
    stamp: NDArray[Any] = logged
    if from_header:
        field = str(source.time.field)
        named = [
            pair
            for pair in stamp_fields(field)
            if all(np.ma.count(decoded.values[path]) for path in pair)
        ]
        if not named:
            said = f"it has no field '{field}' with seconds and nanoseconds"
            raise InputError(f"{said}; correct time.field in the source file, or write source: log")
        stamp = whole_stamps(table, named[0], "write source: log")
        if lacking := int(np.ma.getmaskarray(stamp).sum()):
            raise InputError(
                f"{lacking} of {logged.size} messages have no '{field}'; write source: log"
            )
        stamp = np.ma.getdata(stamp)
    elif (logged < 0).any():
        row = int(np.argmax(logged < 0))
        said = f"message {row + 1} was logged at {int(logged[row]) + 2**64} ns, which is not a time"
        raise InputError(f"{said}; write source: header, or record again")
    columns, absent = canonical_columns(table, channels, (stamp - stamp[0]) / SECOND, source)
    logged_in_order = ((logged[1:] >= logged[:-1]) | (number[1:] != number[:-1])).all()
    advice = "its times cannot be used: record again, or exclude the trial"
    if from_header and logged_in_order:
        advice = "write source: log in the source file, or exclude the trial"
    samples = pl.DataFrame([pl.Series("stamp", stamp), *columns])
    in_order, ordering = sorted_by_stamp(samples, number, source.largest_loss, advice)
    counted = logged.size - sum(
        damage.read[one] - damage.misfits[one] for one in np.unique(number).tolist()
    )
    # they may be copies that overwrote others
    damage.is_doubted |= damage.gaps and ordering["repeated"] > counted
    damage.misfits[number[0]] += ordering["contradicted"]
    if from_header and ordering["repeated"]:  # messages logged at one time are reported at decoding
        at, logs = [*samples.columns, "channel"], [*samples.columns, "channel", "logged"]
        whole = samples.with_columns(channel=number, logged=logged)
        first, own = (pl.struct(names).is_first_distinct() for names in (at, logs))
        anew = pl.any_horizontal(pl.col(at).ne_missing(pl.col(at).shift()))
        if copied := whole.select((anew & own & ~first).sum()).item():
            damage.lose(
                f"{copied} messages of a topic hold the payload of another one, and are lost",
                0,
                Counter(),
                0,
            )
            damage.misfits[number[0]] += copied
    return in_order, ordering, absent


def sorted_by_stamp(
    table: pl.DataFrame, channel: NDArray[np.uint16], largest_loss: float, advice: str
) -> tuple[pl.DataFrame, dict[str, int]]:
    """The topic's rows sorted by `stamp` [ns], and counts of messages: `late` ones came after one
    with a later stamp, `repeated` ones have the stamp of an earlier one, `contradicted` ones have
    other values than that one. Rows are given in the order of recording, with their channel (n,).
    `advice` is the remedy if the clock was set back."""
    ordering, channels = {"late": 0, "repeated": 0, "contradicted": 0}, np.unique(channel)
    for number in channels:
        ordering["late"] += check_not_set(
            table.filter(channel == number) if len(channels) > 1 else table, advice
        )
    stamp = table["stamp"].to_numpy()
    if (stamp[1:] > stamp[:-1]).all():
        return table, ordering
    ticks, messages = np.unique(stamp, return_counts=True)
    if len(channels) == 1 and ticks.size > 2 and not table.is_duplicated().any():
        # Stamps may repeat because they are rounded to a step as long as the sampling step or
        # longer. Then nearly every tick of the rounding has a message, and no tick has two more
        # than usual. The messages are kept: the time base finds when they were sampled, as in a CSV
        # log.
        empty = (int(ticks[-1] - ticks[0]) // int(np.diff(ticks).min()) + 1) - ticks.size
        even = int(messages[1:-1].max()) - int(np.median(messages[1:-1])) <= 1
        if even and empty <= 0.5 * (stamp.size - ticks.size):
            return table.sort("stamp", maintain_order=True), ordering
    once = (
        table.group_by("stamp", maintain_order=True)
        .agg(pl.all().drop_nulls().first())
        .sort("stamp")
    )
    beside = table.join(once, on="stamp", how="left", suffix=" kept", maintain_order="left")
    differs = [
        (pl.col(c) != pl.col(f"{c} kept")).fill_null(value=False)
        for c in table.columns
        if c != "stamp"
    ]
    contradicted, most = (
        int(beside.select(pl.any_horizontal(differs).sum()).item()),
        largest_loss * stamp.size,
    )
    standing = int(np.maximum(messages - len(channels), 0).sum())
    for count, also, remedy in (
        (standing, "", ", or write source: log in the source file"),
        (contradicted, " and other values", " or the time source in the source file"),
    ):
        if count > most:
            said = f"{count} of {stamp.size} messages have the stamp of an earlier one{also}"
            raise InputError(
                f"{said}; stamps must be their own: check the recorder's clock{remedy}"
            )
    return once, ordering | {"repeated": stamp.size - once.height, "contradicted": contradicted}


def check_not_set(table: pl.DataFrame, advice: str) -> int:
    """Refuse one channel's rows if the clock was set back; else return how many of them are late.
    The clock was set back if time goes back by more than a second, or if many consecutive messages
    overlap with earlier ones. Late messages, in contrast, fill a gap. Repeated messages do not
    count: a part of the file was copied."""
    stamp, many = table["stamp"].to_numpy(), 10
    if (stamp[1:] >= stamp[:-1]).all():
        return 0
    rows = np.flatnonzero(~table.is_duplicated().to_numpy())
    stamp = stamp[rows]
    by = np.maximum.accumulate(stamp) - stamp
    if (by > SECOND).any():
        row = int(np.argmax(by > SECOND))
        said = (
            f"time goes back by {by[row] / SECOND:.6f} s at message {rows[row] + 1} of"
            f" {table.height}"
        )
        raise InputError(f"{said}; the clock was set while recording: {advice}")
    for run in (one for one in runs(by > 0) if one.stop - one.start >= many):
        before, inside = stamp[: run.start], stamp[run]
        if ((before >= inside[0]) & (before <= inside[-1])).sum() >= many:
            said = (
                f"time goes back from {before.max() / SECOND:.6f} s to {inside[0] / SECOND:.6f} s"
            )
            said += f" at message {rows[run.start] + 1} of {table.height}"
            said += f", and {len(inside)} messages fall among those before"
            raise InputError(f"{said}; the clock was set while recording: {advice}")
    return int((by > 0).sum())


def joined_on_stamp(tables: list[pl.DataFrame]) -> pl.DataFrame:
    """One table, sorted, with a row per stamp; if a table repeats stamps (they are rounded), all
    rows are kept."""
    each = [table["stamp"].to_numpy() for table in tables]
    *own, together = (
        (np.diff(np.sort(one, kind="stable")) == 0).any() for one in (*each, np.concatenate(each))
    )
    if any(own) or not together:
        whole = pl.concat(tables, how="diagonal")
        order = np.argsort(whole["stamp"].to_numpy(), kind="stable")
        tables.clear()  # sorting column by column saves 0.5 GB for an hour's rows
        return pl.DataFrame([whole.drop_in_place(name).gather(order) for name in whole.columns])
    return reduce(
        lambda one, other: one.join(other, on="stamp", how="full", coalesce=True), tables
    ).sort("stamp")
