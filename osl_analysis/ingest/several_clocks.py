# SPDX-License-Identifier: Apache-2.0
"""Channels with clocks of their own, of one table or of two recorders of one trial, on one clock,
as topics are: each with its own rows."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

import polars as pl

from osl_analysis.ingest.clock import ClockFit
from osl_analysis.ingest.conversion import Converted
from osl_analysis.ingest.message_log import join_on_stamp
from osl_analysis.recording import SECOND_NS


def joined_clocks(parts: Sequence[Converted]) -> Converted:
    """The channels of several clocks of one table, which count from one time."""
    first = min(parts, key=lambda part: part.start_s)
    fits = [ClockFit(part.start_s - first.start_s) for part in parts]
    origins = {}
    for part in parts:
        for name, origin in part.origins.items():
            origins[name] = {**origin, "time": part.facts["time"]}
    damage = chain(*(part.facts["damage"] for part in parts))
    remarks = chain(*(part.warnings for part in parts))
    return replace(
        first,
        samples=on_one_clock([part.samples for part in parts], fits),
        origins=origins,
        facts={**first.facts, "damage": [*dict.fromkeys(damage)]},
        warnings=[*dict.fromkeys(remarks)],
    )


def on_one_clock(tables: Sequence[pl.DataFrame], fits: Sequence[ClockFit]) -> pl.DataFrame:
    """Rows of tables in the order of the clock to which `fits` bring their `time` [s]; it then
    counts from the first of them. Rows of the same nanosecond become one row."""
    stamped = []
    for number, (table, fit) in enumerate(zip(tables, fits, strict=True)):
        time = pl.Series(f"time_{number}", fit.to_master(table["time"].to_numpy()))
        # whole nanoseconds can be joined; floats would not match
        stamp = (time * SECOND_NS).round().cast(pl.Int64).alias("stamp")
        stamped.append(table.drop("time").insert_column(0, time).insert_column(0, stamp))
    rows = join_on_stamp(stamped)
    time = pl.coalesce("^time_.*$").alias("time")
    return rows.select(time - time.first(), pl.exclude("stamp", "^time_.*$"))
