"""Channels with clocks of their own, of one table or of two logs of one trial, on one clock, as
topics are: each with its own rows."""

from collections.abc import Sequence

import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.ingest.clock import ClockFit
from osl_analysis.ingest.conversion import Converted
from osl_analysis.ingest.message_log import join_on_stamp
from osl_analysis.recording import SECOND_NS


def joined_clocks(parts: Sequence[Converted]) -> Converted:
    """The channels of several clocks of one table, which count from one time."""
    first = min(parts, key=lambda part: part.facts["time"]["start_s"])
    starts_s = [part.facts["time"]["start_s"] - first.facts["time"]["start_s"] for part in parts]
    tables = [part.samples for part in parts]
    origins = {}
    rates = {}
    remarks: list[str] = []
    for part in parts:
        time = part.facts["time"]
        origins.update(
            {column: {**origin, "time": time} for column, origin in part.origins.items()}
        )
        rates[", ".join(part.origins)] = part.facts["rates_hz"]["rows"]
        remarks += part.warnings
    return Converted(
        samples=on_one_clock(tables, [ClockFit(start_s, method="common") for start_s in starts_s]),
        origins=origins,
        facts={**first.facts, "rates_hz": rates},
        warnings=[*dict.fromkeys(remarks)],
        losses=first.losses,
    )


def on_one_clock(tables: Sequence[pl.DataFrame], fits: Sequence[ClockFit]) -> pl.DataFrame:
    """Rows of tables in the order of the clock to which `fits` bring their `time` [s], which then
    counts from the first of them. Raises InputError: two tables have no time in common."""
    stamped = []
    for table, fit in zip(tables, fits, strict=True):
        stamps = fit.to_master(table["time"].to_numpy()) * SECOND_NS
        stamp = pl.Series("stamp", stamps).round().cast(pl.Int64)
        stamped.append(table.drop("time").insert_column(0, stamp))
    last = max(stamped, key=lambda table: table["stamp"][0])
    first = min(stamped, key=lambda table: table["stamp"][-1])
    if last["stamp"][0] >= first["stamp"][-1]:
        begin, end = last["stamp"][0] / SECOND_NS, first["stamp"][-1] / SECOND_NS
        raise InputError(
            f"{last.columns[1]} begins at {begin:.3f} s, after the end of {first.columns[1]} at"
            f" {end:.3f} s: no motion is in both; name clocks that count from one time, or the"
            " recordings of one trial"
        )
    rows = join_on_stamp(stamped)
    time = ((rows["stamp"] - rows["stamp"][0]) / SECOND_NS).alias("time")
    return pl.DataFrame([time, *rows.drop("stamp")])
