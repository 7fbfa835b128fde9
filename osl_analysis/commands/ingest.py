"""Ingest: the raw files that one row of the sample sheet names, to one canonical trial."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from osl_analysis.experiments import EXPERIMENTS
from osl_analysis.ingest.raw_files import check_columns, check_markers, trial_from_files
from osl_analysis.rails import check_ranges
from osl_analysis.trial import Trial, write_trial


def ingest_trial(
    row: Mapping[str, Any], raw_folder: Path, sources_folder: Path, output: Path, needed_columns: Sequence[str] = ()
) -> Trial:
    """The trial of one row of the sheet, written as Parquet to `output`; arguments and errors as in `checked_trial`.

    Nothing is written where it is refused.
    """
    trial = checked_trial(row, raw_folder, sources_folder, needed_columns)
    write_trial(trial, output)
    return trial


def checked_trial(
    row: Mapping[str, Any], raw_folder: Path, sources_folder: Path, needed_columns: Sequence[str] = ()
) -> Trial:
    """The trial of one row of the sheet, from its files relative to `raw_folder`.

    `needed_columns` are those that a trial of its experiment must have.
    """
    trial = trial_from_files(row, raw_folder, sources_folder)
    check_columns(trial, row.get("experiment"), needed_columns)
    facts = EXPERIMENTS.get(str(row.get("experiment")))
    if facts is not None and facts.place == "walkway":
        check_markers(trial, row["experiment"])
    check_ranges(trial)
    return trial
