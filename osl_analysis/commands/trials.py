"""Ingest and quality control of one trial in one job: the samples are judged while they are in memory."""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from osl_analysis.commands.ingest import ingest_trial
from osl_analysis.commands.quality import check_trial
from osl_analysis.errors import PartialResultError
from osl_analysis.memory import return_memory
from osl_analysis.quality.checks import Commanded, QualityRules


def ingest_and_check(
    row: Mapping[str, Any],
    raw_folder: Path,
    sources_folder: Path,
    needed_columns: Sequence[str],
    accept: Collection[str],
    rules: QualityRules,
    commanded: Commanded,
    trial: Path,
    quality: Path,
) -> None:
    """Write the trial of one row of the sheet to `trial`, and the verdict of every check on it to `quality`.

    The arguments are those of `ingest.ingest_trial` and `quality.check_trial`.

    Raises
    ------
    InputError
        As `ingest_trial`; nothing is written then.
    PartialResultError
        The trial is written, and no verdict, for the error that this one is raised from.
    """
    record = ingest_trial(row, raw_folder, sources_folder, trial, needed_columns)
    return_memory()
    try:
        check_trial(record, str(row["experiment"]), accept, rules, commanded, quality)
    except Exception as error:
        raise PartialResultError([quality]) from error
