"""A canonical trial as one Parquet file, its provenance inside."""

import json
from pathlib import Path

import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.files import atomic_path
from osl_analysis.trial import Trial

NAME_KEY = "osl_analysis.trial"
PROVENANCE_KEY = "osl_analysis.provenance"


def write_trial(trial: Trial, path: Path) -> None:
    """Write the trial whole or not at all; name and provenance (JSON) stand in the file's metadata."""
    metadata = {NAME_KEY: trial.name, PROVENANCE_KEY: json.dumps(trial.provenance, sort_keys=True)}
    with atomic_path(path) as temporary:
        trial.samples.write_parquet(temporary, compression="zstd", metadata=metadata)


def read_trial(path: Path) -> Trial:
    """Read what `write_trial` wrote.

    Raises
    ------
    InputError
        The file is missing, is not Parquet, or is Parquet that ingest did not write.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such trial; ingest it first (osl-analysis ingest)")
    try:
        metadata = pl.read_parquet_metadata(path)
        samples = pl.read_parquet(path)
    except (pl.exceptions.PolarsError, OSError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"{path}: not a Parquet file ({reason}); ingest the trial again") from error
    if PROVENANCE_KEY not in metadata:
        raise InputError(f"{path}: Parquet without provenance; only a file that ingest wrote is a trial")
    return Trial(metadata[NAME_KEY], samples, json.loads(metadata[PROVENANCE_KEY]))
