"""Ingest and quality control of one trial in one job: the samples are examined while they are in memory."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from osl_analysis.commands.ingest import ingest_trial
from osl_analysis.commands.quality import measure_trial
from osl_analysis.errors import PartialResultError
from osl_analysis.quality.checks import Commanded


def ingest_and_check(
    row: Mapping[str, Any],
    raw_folder: Path,
    sources_folder: Path,
    needed_columns: Sequence[str],
    commanded: Commanded,
    trial: Path,
    quality: Path,
) -> None:
    """Write the trial of one row of the sheet to `trial`, and what every check measures on it to `quality`.

    The arguments are those of `ingest.ingest_trial` and `quality.measure_trial`. Raises PartialResultError where the
    trial is written and nothing measured, for the error that this one is raised from.
    """
    record = ingest_trial(row, raw_folder, sources_folder, trial, needed_columns)
    try:
        measure_trial(record, str(row["experiment"]), commanded, quality)
    except Exception as error:
        raise PartialResultError([quality]) from error
