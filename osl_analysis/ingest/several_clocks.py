# SPDX-License-Identifier: Apache-2.0
"""Channels with clocks of their own, of one table or of two recorders of one trial, on one clock,
as topics are: each with its own rows."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain

import polars as pl

from osl_analysis.base.errors import InputError
from osl_analysis.base.recording import SECOND_NS
from osl_analysis.base.trial import Trial
from osl_analysis.ingest import LIMITS
from osl_analysis.ingest.clock import (
    ClockFit,
    Signal,
    common_clock,
    correlate_clocks,
    find_edges,
    fit_clock,
    values_of,
)
from osl_analysis.ingest.conversion import Converted
from osl_analysis.ingest.message_log import join_on_stamp
from osl_analysis.signals.grid import MEASURED, sampling_times
from osl_analysis.stats.budget import NORMAL_HALF_WIDTH


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
    on_clock = pl.coalesce("^time_.*$").alias("time")
    return rows.select(on_clock - on_clock.first(), pl.exclude("stamp", "^time_.*$"))


UNKNOWN_CLOCK = (
    "no signal shows the clock of log_2 beside that of log: by each ms that it is late B changes by"
    " 0.001 K, by each ppm that it runs fast by 0.5e-6 K per second of the trial; a calibration"
    " tells both"
)


def joined_logs(
    logs: Mapping[str, Converted], clock: str
) -> tuple[pl.DataFrame, ClockFit, list[str]]:
    """Join the `log` and `log_2` of a trial.

    Parameters
    ----------
    logs
        Both recordings, by the cell of the sheet that names them.
    clock
        How the second is aligned, as its source file says.

    Returns
    -------
    samples
        Rows of both, each with its own; a column that both have is the first's.
    fit
        Of the second's clock to the first's.
    remarks
        What aligns the clocks, and what only one of them recorded, a sentence each.

    Raises
    ------
    InputError
        The signal of both does not align the clocks, or another column is in both.
    """
    log, second = logs.values()
    both = [column for column in log.origins if column in second.origins]
    if {*both} - {"sync"} and clock != "shared":
        raise InputError(
            f"{', '.join(both)}: mapped in log and log_2",
            "remove it from one source file, or write `clock: shared` in that of log_2, where"
            " both recorded the same signal",
        )
    fit = second_clock(log, second, clock, both)
    samples = on_one_clock([log.samples, second.samples.drop(both)], [ClockFit(0.0), fit])
    remarks = [UNKNOWN_CLOCK]
    if fit.drift_error is not None:
        fast_ppm = -1e6 * fit.drift
        half_width_ppm = 1e6 * NORMAL_HALF_WIDTH * fit.drift_error
        remarks = [
            f"log_2 begins {1e3 * fit.offset:.3f} ms after log, and runs {fast_ppm:.2f} ppm"
            f" fast (within {half_width_ppm:.2g}), by {both[0]}"
        ]
    longer_s = fit.to_master(second.samples["time"][-1]) - log.samples["time"][-1]
    if abs(longer_s) > LIMITS.longest_cut_s:
        shorter = "log" if longer_s > 0 else "log_2"
        remarks.append(f"{shorter} ends {abs(longer_s):.3f} s before the other, which is cut there")
    return samples, fit, remarks


def second_clock(log: Converted, second: Converted, clock: str, both: Sequence[str]) -> ClockFit:
    """Fit the second log's clock to the first's, by a column of `both`, or as stated."""
    if clock == "common":
        return common_clock(second, log)
    if clock == "start":
        return ClockFit(0.0, method=clock)
    column = "sync" if clock == "sync" else both[0]
    first = sampled(log, column, [*log.origins])
    other = sampled(second, column, [name for name in second.origins if name not in both])
    if clock == "sync":
        return fit_clock(find_edges(*other), find_edges(*first))
    return correlate_clocks(other, first)


def sampled(log: Converted, column: str, kept: Sequence[str]) -> Signal:
    """Times [s] and values (n,) of a column when they were sampled, and not when a late host
    stamped them, as a fit reads the stamps of the columns that are `kept`: else the clocks would
    differ by what the hosts are late, which the fit takes off once more."""
    time, values = values_of(log, "both logs", column)
    trial = Trial("log", log.samples, {"columns": log.origins, "": log.facts})
    for name in MEASURED:
        if name in kept:
            time = sampling_times(trial, name, time)
            break
    return time - log.origins[column].get("delay", 0.0), values
