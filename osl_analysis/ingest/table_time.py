"""The time of a table: a named clock, a rate, or what the recording tells.

Rows of another time are left out; a clock that stands still or stays back is refused.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.ingest.asked_table import STATE_RATE, Table, clock_factor
from osl_analysis.ingest.likely_clock import unwrapped
from osl_analysis.ingest.stale_rows import find_stale_rows, remarks_on_stale_rows
from osl_analysis.recording import Channel, Kind
from osl_analysis.source_file import TableSource
from osl_analysis.trial import Array, check_time

COARSE_STEP_S = 0.4  # stamps this far apart tell seconds, not samples
COARSE_ROWS = 20  # rows with one stamp: beyond it the stamps are coarse, or the clock stopped
COARSE_SHARE = 0.1  # of the rows with one stamp, as above


def with_time(
    table: Table, source: TableSource, clock: Channel | None
) -> tuple[Table, Array, float]:
    """Give the rows that count, their times (rows,) [s] since the first one, and the reading of the
    clock in that row."""
    stated = source.time
    if table.clock is None or clock is None:
        time = table.time
        if time is None:
            assert stated.rate is not None
            time = np.arange(table.rows.count) / stated.rate
        return table, time - time[0], float(time[0])

    what = stated.title
    raw = np.ma.getdata(table.clock)
    check_no_reading_lacks(table, what, f"take another {stated.ADDRESS}, or {STATE_RATE}")
    factor = 1 / stated.rate if stated.rate is not None else clock_factor(clock, source)
    if stated.rate is not None and (raw != np.rint(raw)).any():
        row = int(np.argmax(raw != np.rint(raw)))
        raise InputError(
            f"{what}: {raw[row]} in {table.rows.place(row)} is no count of samples, which a column"
            " beside `rate` is; state its unit in place of the rate"
        )
    # single precision would round the differences
    if raw.dtype.kind == "f":
        raw = raw.astype(np.float64)
    raw, bits, turns = unwrapped(raw)
    remarks = [*table.remarks]
    if turns:
        remarks.append(
            f"{what} counts to 2**{bits} and began anew {turns} times; it is taken to go on"
        )
    stale = find_stale_rows(raw)
    if stale.size:
        remarks += remarks_on_stale_rows(table.rows, raw, stale, factor)
        table = table.at(~np.isin(np.arange(raw.size), stale))
        raw = np.delete(raw, stale)
    time = np.asarray((raw - raw[0]) * factor, dtype=np.float64)
    check_time(what, time)
    check_clock_runs(table, source, time, raw, factor if clock.kind == Kind.CLOCK else 1.0)
    return replace(table, remarks=remarks), time, float(raw[0])


def check_no_reading_lacks(table: Table, what: str, remedy: str) -> None:
    """Refuse a clock of truth values, or one without a reading in some row."""
    assert table.clock is not None
    if table.clock.dtype == bool:
        raise InputError(f"{what}: no time but truth values; remove it there, {remedy}")
    lacking = np.isnan(np.ma.getdata(table.clock).astype(np.float64))
    lacking |= np.ma.getmaskarray(table.clock)
    if lacking.any():
        place = table.rows.place(int(np.argmax(lacking)))
        raise InputError(f"{what}: no time in {place}; remove it there, {remedy}")


def check_clock_runs(
    table: Table, source: TableSource, time: Array, raw: NDArray[Any], shown_factor: float
) -> None:
    """Refuse a clock (n,) that stands still, or tells whole seconds and no less."""
    is_new = time[1:] != time[:-1]  # time never goes back
    if is_new.size and is_new.all():
        return
    first = np.flatnonzero(np.concatenate([[True], is_new]))
    counts = np.diff(first, append=time.size)
    most = int(counts.max())
    row = int(first[counts.argmax()])
    distinct = time[first]
    many_alike = most > COARSE_SHARE * time.size
    far_apart = first.size > 3 and np.median(np.diff(distinct)) > COARSE_STEP_S
    is_coarse = most > COARSE_ROWS and (many_alike or far_apart)
    if most < time.size and not (is_coarse and source.time.repeated != "drop"):
        return
    other = f"take another {source.time.ADDRESS}, or {STATE_RATE}"
    if first.size > 3:  # whole seconds still tell the rate, from the first change to the last
        rate = (first[-1] - first[1]) / (distinct[-1] - distinct[1])
        other += f": its stamps tell {rate:.4g}"
    unit = "" if shown_factor == 1.0 else " s"
    raise InputError(
        f"{source.time.title}: time stands still at {raw[row] * shown_factor:.15g}{unit} in {most}"
        f" of {time.size} {table.rows.noun}s, from {table.rows.place(row)} on: it stopped, or"
        f" tells no less; cut the log, {other}"
    )
