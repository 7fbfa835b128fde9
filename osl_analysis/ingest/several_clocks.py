# SPDX-License-Identifier: Apache-2.0
"""Put rows with clocks of their own on one clock: of one table, or of two recorders of one trial.

Each clock keeps its rows, as topics of a log of messages do.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import polars as pl

from osl_analysis.base.errors import InputError
from osl_analysis.base.recording import SECOND_NS
from osl_analysis.base.source_file import Source
from osl_analysis.base.trial import Trial
from osl_analysis.ingest.clock import (
    ClockFit,
    Signal,
    aligned_clock,
    find_edges,
    fit_clock,
    values_of,
)
from osl_analysis.ingest.conversion import Converted
from osl_analysis.ingest.message_log import join_on_stamp
from osl_analysis.signals.grid import CLOCKED_COLUMNS, sampling_times
from osl_analysis.stats.budget import NORMAL_HALF_WIDTH


@dataclass(frozen=True)
class CutLogs:
    """How differently two hands may stop the logs of a trial."""

    longest_s: float = 1.0  # [s] by which the second log may end before or after the first


CUT_LOGS = CutLogs()


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


def roles_of(cells: Collection[str]) -> tuple[str, str]:
    """The cells of the sheet that name both recordings of a trial, that with the clock first."""
    return ("mocap", "log") if "mocap" in cells else ("log", "log_2")


def check_clocks(sources: Mapping[str, Source]) -> None:
    """Refuse source files, by cell of the sheet, that do not state how the clock of a log beside
    motion capture, or of a second log, is aligned."""
    first, slave = (sources[role] for role in roles_of(sources))
    columns = getattr(slave, "channels", {}).keys()
    if "mocap" in sources:
        has_sync = "sync" in columns & getattr(first, "analogs", {}).keys()
        has_times = first.format == "trc"
        aligns = {"sync": has_sync, "common": has_times}
    else:
        both = columns & getattr(first, "channels", {}).keys()
        aligns = {"sync": "sync" in both, "common": True, "start": True}
    clock = getattr(slave, "clock", "")
    if not aligns.get(clock):
        raise InputError(
            f"{slave.place('clock')}: '{clock}' does not align both recordings of the trial",
            "record a line with pulses of changing length by both, map it as the column sync in"
            " both source files, and write clock: sync; of two logs also clock: common, if they"
            " count from one time, or clock: start, if they begin at one instant",
        )


def joined_recordings(
    recordings: Mapping[str, Converted], sources: Mapping[str, Source]
) -> tuple[pl.DataFrame, ClockFit, list[str]]:
    """Join both recordings of a trial: a log and motion capture, or `log` and `log_2`.

    Parameters
    ----------
    recordings, sources
        By the cell of the sheet that names them.

    Returns
    -------
    samples
        Rows of both, each with its own, on the clock of motion capture, or of the first log. A
        column that both have is that one's. Rows of a log before and after motion capture are not
        used.
    fit
        Of the other clock to it.
    remarks
        What aligns the clocks, and what only one log recorded, a sentence each.

    Raises
    ------
    InputError
        What is stated does not align the clocks, another column is in both, or a log and motion
        capture do not overlap.
    """
    roles = roles_of(recordings)
    master, slave = (recordings[role] for role in roles)
    clock = getattr(sources[roles[1]], "clock", "")
    both = [column for column in master.origins if column in slave.origins]
    twice = {*both} - {"sync"}
    if twice:
        raise InputError(
            f"column '{min(twice)}' is mapped in both source files",
            "remove it from one of them",
        )
    remarks: list[str] = []
    if clock == "common":
        fit = ClockFit(slave.start_s - master.start_s, method=clock)
    elif clock == "start":
        fit = ClockFit(0.0, method=clock)
    elif "mocap" in recordings:
        fit = aligned_clock(slave, master)
    else:
        first = sampled(master, "sync", [*master.origins])
        second = sampled(slave, "sync", [name for name in slave.origins if name != "sync"])
        fit = fit_clock(find_edges(*second), find_edges(*first))
    rows = slave.samples.drop(both)
    end_s = master.samples["time"][-1]
    if "mocap" in recordings:
        time = pl.Series(fit.to_master(rows["time"].to_numpy()))
        rows = rows.filter(time.is_between(0.0, end_s))
        if rows.is_empty():
            raise InputError(
                "log and motion capture do not overlap in time",
                "check that they are of the same trial",
            )
    else:
        remarks.append(remark_on_second(fit))
        longer_s = fit.to_master(rows["time"][-1]) - end_s
        if abs(longer_s) > CUT_LOGS.longest_s:
            shorter = "log" if longer_s > 0 else "log_2"
            remarks.append(
                f"{shorter} ends {abs(longer_s):.3f} s before the other, which is cut there"
            )
    return on_one_clock([master.samples, rows], [ClockFit(0.0), fit]), fit, remarks


def remark_on_second(fit: ClockFit) -> str:
    """Say how the clock of the second log runs, or that nothing shows it."""
    if fit.drift_error is None:
        return UNKNOWN_CLOCK
    fast_ppm = -1e6 * fit.drift
    half_width_ppm = 1e6 * NORMAL_HALF_WIDTH * fit.drift_error
    return (
        f"log_2 begins {1e3 * fit.offset:.3f} ms after log, and runs {fast_ppm:.2f} ppm fast"
        f" (within {half_width_ppm:.2g}), by sync"
    )


def sampled(log: Converted, column: str, kept: Sequence[str]) -> Signal:
    """Times [s] and values (n,) of a column when they were sampled, and not when a late host
    stamped them, as a fit reads the stamps of the columns that are `kept`: else the clocks would
    differ by what the hosts are late, which the fit takes off once more."""
    time, values = values_of(log, "both logs", column)
    trial = Trial("log", log.samples, {"columns": log.origins, "": log.facts})
    for name in CLOCKED_COLUMNS:
        if name in kept:
            time = sampling_times(trial, name, time)
            break
    return time - log.origins[column].get("delay", 0.0), values
