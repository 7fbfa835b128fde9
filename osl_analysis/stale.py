"""What a result was made of, as the log of its job says, and whether that is still so.

Snakemake's own notes on settings, program and recordings stand in the folder `.snakemake`. They are gone after
`rm -rf .snakemake`, in a new clone, and beside results that were copied. The logs are copied with the results.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import polars as pl
import yaml

from osl_analysis.files import digest
from osl_analysis.job_log import MADE_OF, plain, text_of
from osl_analysis.trial import PROVENANCE_KEY

RECORDED = "recorded"
"""Parameter of a rule with the `file_state` of each recording that its job reads."""
OF_TRIAL = "of_trial"
"""Parameter of a rule that has several by name: one function of the wildcards is called for them all, once per job."""
UNKNOWN = "not known: there is no log of its job"
SETTINGS = "other settings, inputs or program"
RECORDINGS = "other recordings"


def each_param(params: Mapping[str, Any]) -> dict[str, Any]:
    """The parameters of a rule by name, with those in `OF_TRIAL`."""
    found = {str(name): value for name, value in params.items()}
    return found | dict(found.pop(OF_TRIAL, {}))


def made_of(inputs: Iterable[Any], params: Mapping[str, Any]) -> dict[str, Any]:
    """What a job's results are made of: a digest of its inputs' names and its parameters, and its recordings' state."""
    settings = {name: plain(value) for name, value in each_param(params).items()}
    recordings = settings.pop(RECORDED, None) or {}
    text = json.dumps([sorted(map(str, inputs)), settings], sort_keys=True)
    return {"digest": hashlib.sha256(text.encode()).hexdigest()[:16], "recordings": recordings}


def logged(log: Path) -> dict[str, Any] | None:
    """What a log says that its results were made of; None without a log, or if it says nothing."""
    try:
        said = yaml.load(text_of(log, MADE_OF), Loader=yaml.CSafeLoader)
    except (OSError, ValueError, yaml.YAMLError):
        return None
    return said if isinstance(said, dict) and said.keys() == {"digest", "recordings"} else None


def stale(now: Mapping[str, Any], log: Path, results: Sequence[Path], known: bool) -> str:
    """Why results no longer hold, or an empty text.

    Recordings are compared by size and date, and by their hash where these differ. `now` is as from `made_of`. `known`:
    Snakemake has notes on these results, and compares settings and inputs itself.
    """
    if known and not now["recordings"]:
        return ""
    then = logged(log)
    if then is None:
        return "" if known else UNKNOWN
    if not known and then["digest"] != now["digest"]:
        return SETTINGS
    same = then["recordings"] == now["recordings"] or same_recordings(results[0], now["recordings"])
    return "" if same else RECORDINGS


def same_recordings(trial: Path, recordings: Iterable[str]) -> bool:
    """Whether a trial was made of files with this content, by size and SHA-256 in its provenance.

    False for a refusal record, which has none, and if a file cannot be read.
    """
    try:
        provenance = json.loads(pl.read_parquet_metadata(trial)[PROVENANCE_KEY])
        parts = [part for one in provenance["files"].values() for part in one.get("parts", [one])]
        read = [(part["bytes"], part["sha256"]) for part in parts]
        files = [Path(file) for file in recordings]
        sizes = [file.stat().st_size for file in files]
        return sizes == [size for size, _ in read] and [digest(file) for file in files] == [sha for _, sha in read]
    except (pl.exceptions.PolarsError, OSError, KeyError, ValueError, TypeError):
        return False
