"""The raw files of one trial, read by their source files and put together to canonical samples."""

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.formats.rosbag import files_in
from osl_analysis.ingest.clock import ClockFit, aligned_clock
from osl_analysis.ingest.known_formats import FORMATS, check_format, named, read_source
from osl_analysis.ingest.recording import Recording, check_sizes
from osl_analysis.ingest.source import SharedAngle
from osl_analysis.trial import Trial


def trial_from_files(row: Mapping[str, Any], raw_folder: Path, sources_folder: Path) -> Trial:
    """The trial whose raw files, relative to `raw_folder`, one row of the sample sheet names.

    `row` has the sheet's columns (`sheet.py`). An absent or missing value (None, NA) counts as empty.

    Raises
    ------
    InputError
        A file is missing, empty or not what its source file says, changes while it is read, holds values that
        nothing can reach, or the recordings do not fit together.
    """
    name = text(row, "trial")
    files = {role: text(row, role) for role in ("log", "mocap") if text(row, role)}
    if not files:
        raise InputError(f"trial {name}: the sheet names no file; fill in log or mocap, or exclude the trial")
    recordings, identities, shared = {}, {}, None
    for role, given in files.items():
        path, source = raw_folder / given, text(row, f"{role}_source")
        if not source:
            raise InputError(f"trial {name}: {role}_source is empty; name the file in {sources_folder} for {given}")
        check_file(path)
        before = identities_of(path)
        described = read_source(sources_folder / f"{source}.yaml")
        is_capture = FORMATS[described.format].is_capture
        if not is_capture:
            described = described.of_part(text(row, "log_part"))
        check_format(path, described)
        if len(files) == 2 and not is_capture and described.clock == "master":
            raise InputError(
                f"{sources_folder / f'{source}.yaml'}: clock: master, but the trial has motion capture too; write "
                "clock: sync and map the column sync (or clock: shared, with `shared` in motion capture's source file)"
            )
        try:
            with named(path):
                recordings[role] = FORMATS[described.format].read(path, described)
                check_sizes(recordings[role])
        finally:
            check_unchanged(before)  # also where it cannot be read: it may have changed in between
        shared = described.shared if is_capture else shared
        identities[role] = {**identified(path, before), "path": given, "source": source}
    try:
        return assemble(name, recordings, identities, shared)
    except InputError as error:
        raise InputError(f"trial {name} ({', '.join(files.values())}): {error}") from error


def check_columns(trial: Trial, experiment: str | None, needed: Sequence[str]) -> None:
    """Refuse a trial without a column that every trial of its experiment needs."""
    missing = [column for column in needed if column not in trial.samples.columns]
    if missing:
        raise InputError(
            f"trial {trial.name}: no column {', '.join(missing)}, which a trial of experiment '{experiment}' needs; "
            "map it to its channel under `channels` in the source file, or correct `experiment` in the sheet"
        )


def check_markers(trial: Trial, experiment: str | None) -> None:
    """Refuse a trial without a marker that was ever seen, for an experiment whose analysis follows markers."""
    markers = [column for column in trial.samples.columns if column.startswith("marker_")]
    if any(trial.samples[column].is_finite().any() for column in markers):
        return
    seen = f"none of its {len(markers) // 3} markers was ever seen" if markers else "no markers"
    raise InputError(
        f"trial {trial.name}: {seen}, and a trial of experiment '{experiment}' needs them; label and fill them in the "
        "capture and export it again, or exclude the trial in the sheet"
    )


def check_file(path: Path) -> None:
    """Refuse a file that is missing or empty, and what is no recording: a device, a pipe, a folder without parts."""
    if path.is_dir():
        files_in(path)
        return
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: a device or a pipe, not a recording; name a file, or copy its content into one")
    if not path.is_file():
        raise InputError(f"{path}: no such file; correct the sample sheet, or copy the file there")
    if path.stat().st_size == 0:
        raise InputError(f"{path}: the file is empty; copy or record it again, or exclude the trial in the sheet")


def text(row: Mapping[str, Any], column: str) -> str:
    """A value of the sheet as text. A value that is not text counts as empty."""
    value = row.get(column)
    return value.strip() if isinstance(value, str) else ""


@dataclass(frozen=True)
class Identity:
    """A raw file at the moment at which it was hashed."""

    path: Path
    size: int  # [bytes]
    sha256: str
    state: tuple[int, ...]
    """Device, number, size and times [ns] of the file; another value means another file or other bytes."""

    @classmethod
    def of(cls, path: Path) -> Self:
        with path.open("rb") as file:
            state = state_of(os.fstat(file.fileno()))
            digest = hashlib.file_digest(file, "sha256").hexdigest()
            return cls(path, file.tell(), digest, state)

    @property
    def report(self) -> dict[str, Any]:
        return {"path": self.path.name, "bytes": self.size, "sha256": self.sha256}


def state_of(stat: os.stat_result) -> tuple[int, ...]:
    """What changes in a file's entry when the file is replaced or written to."""
    return stat.st_dev, stat.st_ino, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns


def identities_of(path: Path) -> list[Identity]:
    """A raw file, or every file of a folder, before it is read."""
    return [Identity.of(file) for file in (files_in(path) if path.is_dir() else [path])]


def identified(path: Path, parts: Sequence[Identity]) -> dict[str, Any]:
    """What identifies a recording in the provenance: size and SHA-256; of a folder, those of its files too."""
    if not path.is_dir():
        return parts[0].report
    together = hashlib.sha256("".join(one.sha256 for one in parts).encode()).hexdigest()
    return {"bytes": sum(one.size for one in parts), "sha256": together, "parts": [one.report for one in parts]}


def check_unchanged(parts: Sequence[Identity]) -> None:
    """Refuse a file that is not the one that was hashed, now that it has been read."""
    for one in parts:
        try:
            same = state_of(one.path.stat()) == one.state and one.size == one.state[2]
        except OSError:
            same = False
        if not same:
            raise InputError(
                f"{one.path}: the file changed while it was read; wait until it is recorded or copied, then run again"
            )


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
    time, end = fit.to_master(log.samples["time"].to_numpy()), float(mocap.samples["time"][-1])
    clock = {**asdict(fit), "rows_before": int((time < 0.0).sum()), "rows_after": int((time > end).sum())}
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
