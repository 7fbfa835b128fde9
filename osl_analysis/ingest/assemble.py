"""The recordings of a trial, put together to canonical samples with the provenance of every column."""

from collections.abc import Mapping
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.ingest.alignment import aligned_clock
from osl_analysis.ingest.clock import ClockFit
from osl_analysis.ingest.recording import Recording
from osl_analysis.ingest.source_fields import SharedAngle
from osl_analysis.trial import Trial

NANOSECOND = 1e-9
SHARED_FACTS = ("plates", "damage")  # facts that have a key of their own in the provenance


def assemble(
    name: str,
    recordings: Mapping[str, Recording],
    files: Mapping[str, Mapping[str, Any]],
    shared: SharedAngle | None = None,
) -> Trial:
    """A trial of the recordings `log`, `mocap` or both; with both, the log's clock is fitted to motion capture's.

    `files` identifies the file of each recording (`identity`), `shared` an angle that aligns the clocks without sync
    edges. The log's rows before and after motion capture are counted and not used. The column `sync` is motion
    capture's.

    Raises
    ------
    InputError
        The clocks cannot be aligned, or a column comes from both.
    """
    provenance = provenance_of(recordings, files)
    if len(recordings) == 1:
        (only,) = recordings.values()
        return Trial(name, only.samples, provenance)
    log, mocap = recordings["log"], recordings["mocap"]
    both = sorted((set(log.columns) & set(mocap.columns)) - {"sync"})
    if both:
        raise InputError(f"column '{both[0]}' is mapped in log and motion capture; remove it from one source file")
    fit, warnings = aligned_clock(log, mocap, shared)
    clock = {**asdict(fit), **rows_outside(log, mocap, fit)}
    warnings = [*provenance["warnings"], *warnings]
    return Trial(name, merged(log, mocap, fit), {**provenance, "warnings": warnings, "clock": clock})


def provenance_of(recordings: Mapping[str, Recording], files: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Where every column comes from, and the facts and warnings of each recording."""
    in_order = [(role, recordings[role]) for role in ("log", "mocap") if role in recordings]
    return {
        "software": {"name": "osl-analysis", "version": version("osl-analysis")},
        "files": dict(files),
        "columns": {name: {"file": role, **origin} for role, one in in_order for name, origin in one.columns.items()},
        "plates": [plate for _, one in in_order for plate in one.facts.get("plates", [])],
        "warnings": [warning for _, one in in_order for warning in one.warnings],
        **{key: fact for _, one in in_order for key, fact in one.facts.items() if key == "damage"},
        **{role: {key: fact for key, fact in one.facts.items() if key not in SHARED_FACTS} for role, one in in_order},
    }


def rows_outside(log: Recording, mocap: Recording, fit: ClockFit) -> dict[str, int]:
    """Number of rows of the log before and after motion capture, which `merged` does not use."""
    time, end = fit.to_master(log.samples["time"].to_numpy()), float(mocap.samples["time"][-1])
    return {"rows_before": int((time < 0.0).sum()), "rows_after": int((time > end).sum())}


def merged(log: Recording, mocap: Recording, fit: ClockFit) -> pl.DataFrame:
    """The rows of both in the order of motion capture's time [s]; rows of the same nanosecond become one row."""
    time = pl.Series("log_time", fit.to_master(log.samples["time"].to_numpy()))
    end = float(mocap.samples["time"][-1])
    own = log.samples.drop("time", "sync", strict=False)
    rows = own.insert_column(0, time).filter(time.is_between(0.0, end))
    if rows.is_empty():
        raise InputError("log and motion capture do not overlap in time; check that they are of the same trial")
    rows = rows.with_columns(key=whole_nanoseconds("log_time"))
    joined = mocap.samples.with_columns(key=whole_nanoseconds("time")).join(rows, on="key", how="full", coalesce=True)
    return joined.sort("key").with_columns(time=pl.coalesce("time", "log_time")).drop("key", "log_time")


def whole_nanoseconds(column: str) -> pl.Expr:
    """Times [s] as whole nanoseconds, on which tables can be joined; floats would not match."""
    return (pl.col(column) / NANOSECOND).round().cast(pl.Int64)
