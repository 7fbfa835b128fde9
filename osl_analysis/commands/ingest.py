"""Ingest: the raw files that one row of the sample sheet names, to one canonical trial."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from osl_analysis.ingest.raw_files import recorded_trial
from osl_analysis.trial import write_trial


def ingest_trial(row: Mapping[str, Any], raw_folder: Path, sources_folder: Path, output: Path) -> None:
    """Read the files of one row of the sheet, relative to `raw_folder`, and write the trial as Parquet to `output`.

    Raises
    ------
    InputError
        A file is missing, empty or not what its source file says, or the recordings do not fit together; nothing is
        written then.
    """
    write_trial(recorded_trial(row, raw_folder, sources_folder), output)
