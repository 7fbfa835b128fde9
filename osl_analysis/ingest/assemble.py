"""The recordings of one trial as a trial: log and motion capture on one clock."""

from collections.abc import Mapping
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

import polars as pl

from osl_analysis.errors import InputError, printable
from osl_analysis.ingest.clock import ClockFit, aligned_clock
from osl_analysis.ingest.conversion import Converted
from osl_analysis.source_file import SharedAngle
from osl_analysis.trial import Trial


def assemble(
    name: str,
    recordings: Mapping[str, Converted],
    files: Mapping[str, Mapping[str, Any]],
    shared: SharedAngle | None = None,
    is_common: bool = False,
) -> Trial:
    """Make a trial of the recordings `log`, `mocap` or both.

    With both, the log's clock is fitted to motion capture's. The log's rows before and after motion
    capture are counted and not used. The column `sync` is motion capture's.

    Parameters
    ----------
    files
        What identifies the file of each recording.
    shared
        An angle that aligns the clocks without sync edges.
    is_common
        Whether the log has the times of motion capture.
    """
    provenance: dict[str, Any] = {
        "software": {"name": "osl-analysis", "version": version("osl-analysis")},
        "files": dict(files),
        "columns": {},
        "plates": [],
        "warnings": [],
    }
    damage: dict[str, Any] = {}
    for role, recording in recordings.items():
        facts = dict(recording.facts)
        provenance["plates"] += facts.pop("plates", [])
        provenance["warnings"] += [printable(text) for text in recording.warnings]
        provenance[role] = facts
        for column, origin in recording.origins.items():
            provenance["columns"][column] = {"file": role, **origin}
        if recording.losses:
            damage[role] = recording.losses
    if damage:
        provenance["damage"] = damage
    if len(recordings) == 1:
        return Trial(name, recording.samples, provenance)

    log = recordings["log"]
    mocap = recordings["mocap"]
    twice = sorted((log.origins.keys() & mocap.origins.keys()) - {"sync"})
    if twice:
        raise InputError(
            f"column '{twice[0]}' is mapped in log and motion capture; remove it from one source"
            " file"
        )
    fit, warnings = aligned_clock(log, mocap, shared, is_common)
    provenance["clock"] = asdict(fit)
    provenance["warnings"] += warnings
    return Trial(name, merged(log, mocap, fit), provenance)


def merged(log: Converted, mocap: Converted, fit: ClockFit) -> pl.DataFrame:
    """The rows of both in the order of motion capture's time [s]; rows of the same nanosecond
    become one row."""
    log_time = pl.Series("log_time", fit.to_master(log.samples["time"].to_numpy()))
    own = log.samples.drop("time", "sync", strict=False).insert_column(0, log_time)
    rows = own.filter(log_time.is_between(0.0, float(mocap.samples["time"][-1])))
    if rows.is_empty():
        raise InputError(
            "log and motion capture do not overlap in time; check that they are of the same trial"
        )
    # by whole nanoseconds, on which tables can be joined; floats would not match
    of_mocap = with_key(mocap.samples, "time")
    of_log = with_key(rows, "log_time")
    joined = of_mocap.join(of_log, on="key", how="full", coalesce=True)
    in_order = joined.sort("key").with_columns(time=pl.coalesce("time", "log_time"))
    return in_order.drop("key", "log_time")


def with_key(table: pl.DataFrame, column: str) -> pl.DataFrame:
    return table.with_columns(key=(pl.col(column) / 1e-9).round().cast(pl.Int64))
