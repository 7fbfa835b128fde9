"""The raw files of one trial, read by their source files and put together."""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from osl_analysis.errors import InputError
from osl_analysis.ingest.assemble import assemble
from osl_analysis.ingest.known_formats import FORMATS, Source, read_source
from osl_analysis.ingest.source_fields import CaptureSource, LogSource
from osl_analysis.trial import Trial


def trial_from_files(row: Mapping[str, Any], raw_folder: Path, sources_folder: Path) -> Trial:
    """The trial whose raw files, relative to `raw_folder`, one row of the sample sheet names.

    `row` has the sheet's columns (`sheet.py`). An absent or missing value (None, NA) counts as empty.

    Raises
    ------
    InputError
        A file is missing, empty or not what its source file says, or the recordings do not fit together.
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
        described = read_source(sources_folder / f"{source}.yaml")
        if len(files) == 2:
            check_alignment(described, sources_folder / f"{source}.yaml")
        recordings[role] = FORMATS[described.format].read(path, described)
        shared = described.shared if isinstance(described, CaptureSource) else shared
        identities[role] = identity(path, given, source)
    try:
        return assemble(name, recordings, identities, shared)
    except InputError as error:
        raise InputError(f"trial {name} ({', '.join(files.values())}): {error}") from error


def check_alignment(source: Source, source_path: Path) -> None:
    """Refuse a log with motion capture if its source file does not say how the clocks are aligned."""
    if isinstance(source, LogSource) and source.clock == "master":
        raise InputError(
            f"{source_path}: clock: {source.clock}, but the trial has motion capture too; write clock: sync and map "
            "the column sync (or clock: shared, with `shared` in motion capture's source file)"
        )


def check_columns(trial: Trial, experiment: str | None, needed: Sequence[str]) -> None:
    """Refuse a trial without a column that every trial of its experiment needs."""
    missing = [column for column in needed if column not in trial.samples.columns]
    if missing:
        raise InputError(
            f"trial {trial.name}: no column {', '.join(missing)}, which a trial of experiment '{experiment}' needs; "
            "map it to its channel under `channels` in the source file, or correct `experiment` in the sheet"
        )


def check_file(path: Path) -> None:
    """Refuse a file that is missing or empty."""
    if not path.is_file():
        raise InputError(f"{path}: no such file; correct the sample sheet, or copy the file there")
    if path.stat().st_size == 0:
        raise InputError(f"{path}: the file is empty; copy or record it again, or exclude the trial in the sheet")


def text(row: Mapping[str, Any], column: str) -> str:
    """A value of the sheet as text. A value that is not text counts as empty."""
    value = row.get(column)
    return value.strip() if isinstance(value, str) else ""


def identity(path: Path, given: str, source: str) -> dict[str, Any]:
    """What identifies a raw file: its name in the sheet, size and SHA-256, and the source file that describes it."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return {"path": given, "bytes": path.stat().st_size, "sha256": digest, "source": source}
