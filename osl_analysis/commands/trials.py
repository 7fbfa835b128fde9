"""Ingest and quality control of one trial in one job: the samples are examined while they are in memory."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.ingest.examine import Commanded, check_ranges, examine, measured_table
from osl_analysis.ingest.raw_files import check_columns, check_markers, trial_from_files
from osl_analysis.ingest.units import is_unit
from osl_analysis.signals.grid import with_stamp_evidence
from osl_analysis.table import write_table
from osl_analysis.trial import Trial, write_trial


def preload() -> None:
    """For the process from which jobs are forked: all units, which take 0.2 s."""
    is_unit("rad")


def ingest_trial(
    row: Mapping[str, Any], raw_folder: Path, sources_folder: Path, output: Path, needed_columns: Sequence[str] = ()
) -> Trial:
    """The trial of one row of the sheet, written as Parquet to `output`; arguments and errors as in `checked_trial`."""
    trial = checked_trial(row, raw_folder, sources_folder, needed_columns)
    write_trial(trial, output)
    return trial


def checked_trial(
    row: Mapping[str, Any], raw_folder: Path, sources_folder: Path, needed_columns: Sequence[str] = ()
) -> Trial:
    """The trial of one row of the sheet, from its files relative to `raw_folder`, with the `needed_columns`."""
    trial = trial_from_files(row, raw_folder, sources_folder)
    check_columns(trial, row.get("experiment"), needed_columns)
    facts = EXPERIMENTS.get(str(row.get("experiment")))
    if facts is not None and facts.place == "walkway" and not needed_columns:  # those of the log tell all
        check_markers(trial, row["experiment"])
    check_ranges(trial)
    return with_stamp_evidence(trial)


def ingest_and_check(
    row: Mapping[str, Any],
    raw_folder: Path,
    sources_folder: Path,
    needed_columns: Sequence[str],
    commanded: Commanded,
    trial: Path,
    quality: Path,
) -> None:
    """Write the trial of one row of the sheet to `trial`, and what every check measures on it to `quality`, a row each,
    without limits and verdicts."""
    record = ingest_trial(row, raw_folder, sources_folder, trial, needed_columns)
    write_table(measured_table(record.name, examine(record, str(row["experiment"]), commanded)), quality)
