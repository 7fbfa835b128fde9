# SPDX-License-Identifier: Apache-2.0
"""Make a trial from its raw files: find and read them, and join them by their source files.

Example: `trial_from_files(row, folder, sources)` with a row of the sample sheet.
"""

import hashlib
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis import formats
from osl_analysis.base.errors import InputError, naming, nearest, printable
from osl_analysis.base.files import DISTRIBUTION, check_name, digest
from osl_analysis.base.recording import alone
from osl_analysis.base.source_file import MarkerSource, MessageSource, Source, TableSource
from osl_analysis.base.trial import Trial
from osl_analysis.base.yaml_settings import read_mapping, read_yaml, text_in
from osl_analysis.config.sheet import RECORDINGS
from osl_analysis.formats import known_formats
from osl_analysis.ingest.capture import convert_capture
from osl_analysis.ingest.conversion import Converted, numbers_of
from osl_analysis.ingest.guard import check_sizes
from osl_analysis.ingest.message_log import convert_messages
from osl_analysis.ingest.several_clocks import check_clocks, joined_recordings
from osl_analysis.ingest.table_log import convert_table

ENDINGS_OF_ANY = ("", ".log", ".json")  # of recordings, and of much else


def suffixes() -> tuple[str, ...]:
    """Endings of recordings that are read."""
    return tuple(chain.from_iterable(known.suffixes for known in known_formats().values()))


def recorded_files(path: Path) -> list[Path]:
    """The files of a recording; a folder that is none stands for itself."""
    is_folder = path.is_dir()
    may_have_parts = is_folder or any(
        known.files_in is not alone and path.suffix.lower() in known.suffixes
        for known in known_formats().values()
    )
    if may_have_parts and (is_folder or path.is_file()):
        for known_format in formats.formats_of(path):
            with suppress(InputError):
                return [*known_format.files_in(path)]
    return [path]


def recordings_in(folder: Path) -> list[Path]:
    """Files and folders below a folder that may be recordings, by their endings, or of
    `ENDINGS_OF_ANY` by what they hold."""
    recordings: set[Path] = set()
    for path in sorted(folder.rglob("*")):
        is_folder = path.is_dir() and formats.formats_of(path)
        is_part = not recordings.isdisjoint(path.parents)
        if not is_part and (is_folder or (path.is_file() and may_be_recording(path))):
            recordings.add(path)
    for path in sorted(recordings):
        recordings.difference_update(recorded_files(path)[1:])
    return sorted(recordings)


def may_be_recording(path: Path) -> bool:
    """Whether a file may be a recording, by its ending, or by two columns of numbers that it
    holds."""
    suffix = path.suffix.lower()
    if suffix not in ENDINGS_OF_ANY:
        return suffix in suffixes()
    try:
        channels = formats.read(path).channels
    except (OSError, InputError):
        return False
    return sum(bool(np.isfinite(numbers_of(channel)).any()) for channel in channels) > 1


def read_source(path: Path) -> Source:
    """Read a source file and check it: columns are canonical, every unit converts to its column's.

    Raises
    ------
    InputError
        Its format is unknown, a field is wrong, or it is a draft with places to be edited.
    """
    content = read_mapping(path)
    name = text_in(content.get("format"))
    known = known_formats()
    if name not in known:
        raise InputError(
            f"{path}: format '{name}' is not known: write one of"
            f" {', '.join(known)}{nearest(name, known)}"
        )
    source: Source = read_yaml(path, known[name].source)
    source.written_in(path)
    return source


@np.errstate(all="ignore")  # values of damaged files may be of any size: checks tell them
def read_converted(path: Path, source: Source) -> Converted:
    """Read a file as canonical columns in SI units, by its source file.

    Raises
    ------
    InputError
        The message names the file, and all of its damage.
    """
    try:
        converted = converted_as_stated(path, source)
    except InputError as error:
        if getattr(source, "damaged", "skip") == "skip":
            raise
        try:  # what else is damaged, and whether all of it can be left out
            skipping = source.model_copy(update={"damaged": "skip"})
            converted = converted_as_stated(path, skipping)
        except InputError:
            raise error from None
        damage = converted.facts.get("damage", converted.warnings)
        if not damage:
            raise
        further_damage = [text for text in damage if text not in error.reason]
        raise InputError(
            f"{error.reason} (and: {', '.join(further_damage)})"
            if further_damage
            else error.reason,
            "write `damaged: skip` in the source file, which leaves all of this out, or"
            f" {error.remedy}",
            changes=error.changes,
        ) from error
    warnings = [f"{printable(path.name)}: {text}" for text in converted.warnings]
    return replace(converted, warnings=warnings)


def converted_as_stated(path: Path, source: Source) -> Converted:
    """A file as canonical columns, with what is damaged in it refused or left out as the source
    file says."""
    recording = formats.read(path, source)
    with naming(path):
        if isinstance(source, MessageSource):
            converted = convert_messages(recording, source)
        elif isinstance(source, TableSource):
            converted = convert_table(recording, source)
        else:
            assert isinstance(source, MarkerSource)
            converted = convert_capture(recording, source)
        check_sizes(converted.samples, converted.origins)
    return converted


def trial_from_files(row: Mapping[str, Any], raw_folder: Path, sources_folder: Path) -> Trial:
    """Make the trial whose raw files one row of the sample sheet names.

    Parameters
    ----------
    row
        With the sheet's columns (`config/sheet.py`). A value that is not text (None, NA) counts as
        empty.
    raw_folder
        The folder to which the names of files are relative.

    Raises
    ------
    InputError
        A file is missing, empty, changed or not what its source file says, changes while it is
        read, holds values that nothing can reach, or the recordings do not fit together.
    """
    cells = {column: value.strip() for column, value in row.items() if isinstance(value, str)}
    name = cells.get("trial", "")
    files = {role: cells[role] for role in RECORDINGS if cells.get(role)}
    sources: dict[str, Source] = {}
    for role, file in files.items():
        check_file(raw_folder / file)
        sources[role] = read_source(sources_folder / f"{cells[f'{role}_source']}.yaml")
    if len(sources) == 2:
        check_clocks(sources)

    provenance: dict[str, Any] = {
        "software": {DISTRIBUTION: version(DISTRIBUTION)},
        "files": {},
        "columns": {},
        "plates": [],
        "warnings": [],
    }
    recordings: dict[str, Converted] = {}
    for role, source in sources.items():
        part = source.for_part(cells.get(f"{role}_part", ""))
        recording, identity = read_raw_file(raw_folder / files[role], part)
        recordings[role] = recording
        sheet_cells = {"path": files[role], "source": cells[f"{role}_source"]}
        provenance["files"][role] = identity | sheet_cells
        facts = dict(recording.facts)
        provenance["plates"] += facts.pop("plates", [])
        provenance["warnings"] += [printable(text) for text in recording.warnings]
        provenance[role] = facts
        for column, origin in recording.origins.items():
            if role != "log_2" or column not in provenance["columns"]:
                provenance["columns"][column] = {"file": role, **origin}
        if recording.losses:
            provenance.setdefault("damage", {})[role] = recording.losses
    samples = recording.samples
    with naming(f"trial {name} ({', '.join(files.values())})"):
        if len(recordings) == 2:
            samples, fit, warnings = joined_recordings(recordings, sources)
            provenance["clock"] = asdict(fit)
            provenance["warnings"] += warnings
        trial = Trial(name, samples, provenance)
    fixture = {
        column.removeprefix("fixture_"): value
        for column, value in row.items()
        if column.startswith("fixture_") and value is not None
    }
    # the time base takes its torque off; 0 states that there is none
    if fixture and "torque" in trial.columns:
        trial.provenance["columns"]["torque"]["fixture"] = fixture
    return trial


def read_raw_file(path: Path, source: Source) -> tuple[Converted, dict[str, Any]]:
    """Read a recording, and identify it for the provenance.

    Raises
    ------
    InputError
        It changes while it is read.
    """
    files = recorded_files(path)
    before = [written_at(file) for file in files]
    identities = [{"path": file.name, "sha256": digest(file)} for file in files]
    try:
        converted = read_converted(path, source)
    finally:  # also where it cannot be read: it may have changed in between
        for file, then in zip(files, before, strict=True):
            if not file.is_file() or written_at(file) != then:
                raise InputError(
                    f"{file}: the file changed while it was read",
                    "wait until it is recorded or copied, then run again",
                )
    if len(files) == 1 and not path.is_dir():
        return converted, identities[0]
    together = "".join(str(part["sha256"]) for part in identities)
    joint_digest = hashlib.sha256(together.encode()).hexdigest()
    return converted, {"sha256": joint_digest, "parts": identities}


def check_columns(trial: Trial, experiment: str | None, needed: Sequence[str]) -> None:
    """Refuse a trial without a column that every trial of its experiment needs."""
    missing = ", ".join(column for column in needed if column not in trial.columns)
    if missing:
        raise InputError(
            f"trial {trial.name}: no column {missing}, which a trial of experiment"
            f" '{experiment}' needs",
            "map it to its channel under `channels` in the source file, or correct `experiment`"
            " in the sheet",
        )


def check_markers(trial: Trial, experiment: str | None) -> None:
    """Refuse a trial without a marker that was ever seen, for an experiment whose analysis follows
    markers."""
    markers = [column for column in trial.columns if column.startswith("marker_")]
    if not any(trial.samples[column].is_finite().any() for column in markers):
        raise InputError(
            f"trial {trial.name}: no marker was ever seen, and a trial of experiment"
            f" '{experiment}' needs them",
            "label them in the capture (of a system without markers, export positions: rotations"
            " of segments are not read), or exclude the trial in the sheet",
        )


def check_file(path: Path) -> None:
    """Refuse a file that is missing, and what is no recording: a device, a pipe, a folder without
    parts. And a name that no sheet can hold."""
    check_name(path)
    if path.is_dir():
        readers = formats.formats_of(path)
        if not readers:
            raise InputError(f"{path}: a folder, and no recording", "name a file in it")
        readers[0].files_in(path)
        return
    if not path.is_file():
        raise InputError(f"{path}: no such file", "correct its name, or copy it there")


def written_at(path: Path) -> tuple[int, int, int]:
    """Facts on a file that change if it is written to, or replaced, while it is read."""
    with path.open("rb") as file:  # opening makes a network file system ask its server again
        known = os.fstat(file.fileno())
    return known.st_ino, known.st_size, known.st_ctime_ns
