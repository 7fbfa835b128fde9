# SPDX-License-Identifier: Apache-2.0
"""Channels with clocks of their own, of one table or of two logs of one trial, on one clock, as
topics are: each with its own rows."""

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
    starts_s = [part.facts["time"]["start_s"] for part in parts]
    first_s = min(starts_s)
    fits = [ClockFit(start_s - first_s) for start_s in starts_s]
    first = parts[starts_s.index(first_s)]
    origins = {}
    for part in parts:
        time = part.facts["time"]
        origins.update({name: {**origin, "time": time} for name, origin in part.origins.items()})
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
    counts from the first of them."""
    stamped = []
    for table, fit in zip(tables, fits, strict=True):
        stamp = pl.Series("stamp", fit.to_master(table["time"].to_numpy()) * SECOND_NS).round()
        stamped.append(table.drop("time").insert_column(0, stamp.cast(pl.Int64)))
    rows = join_on_stamp(stamped)
    time = ((rows["stamp"] - rows["stamp"][0]) / SECOND_NS).alias("time")
    return pl.DataFrame([time, *rows.drop("stamp")])
