# SPDX-License-Identifier: Apache-2.0
"""What decides the results of a campaign, and a digest (SHA-256) of each: what is stated, by its
values, so that a comment changes nothing; recordings by their bytes; the code with its libraries.
"""

import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import cache
from importlib.metadata import requires, version
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.base.errors import OslAnalysisError
from osl_analysis.base.files import DISTRIBUTION, PACKAGE, ROOT, digest
from osl_analysis.base.trial import metadata_of
from osl_analysis.base.yaml_settings import read_mapping
from osl_analysis.ingest.raw_files import read_source

DIGITS = 12  # of the digest of values: one that is equal by chance is not met
CODE = {".py", ".yaml", ".j2", ".smk"}  # suffixes of what computes, judges and words


def digest_of(content: Any) -> str:
    """The first digits of the digest of values, whatever the order of their names."""
    text = json.dumps(content, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


def values_in(path: Path) -> Any:
    """The values in a file: of YAML its fields, of CSV its rows without comments."""
    if path.suffix == ".yaml":
        return read_mapping(path)
    return pl.read_csv(path, comment_prefix="#", infer_schema=False).rows()


def digest_of_source(path: Path) -> str | None:
    """The digest of what a source file states, without its description; of its bytes where it is
    wrong, None where it is missing."""
    with suppress(OslAnalysisError):
        return digest_of(read_source(path).model_dump(mode="json", exclude={"description"}))
    return digest(path)


@cache
def code() -> str:
    """The digest of this package, its rules and the versions of its libraries."""
    files = [file for folder in (PACKAGE, ROOT / "rules") for file in sorted(folder.rglob("*"))]
    return digest_of([[digest(file) for file in files if file.suffix in CODE], libraries()])


def libraries() -> dict[str, str]:
    """The versions of the libraries that this package needs."""
    needed = [line for line in requires(DISTRIBUTION) or () if "extra ==" not in line]
    names = [re.split(r"[^\w.-]", line)[0] for line in needed]
    return {name: version(name) for name in names}


def trace(
    stated: Mapping[str, str | None], trials: Iterable[Path], experiments: Mapping[str, str]
) -> dict[str, Any]:
    """What decides results: the digests of what is `stated` and of recordings; by trial (Parquet),
    its experiment, and which of both are its own; code and libraries."""
    recordings: dict[str, str] = {}
    of_trials: dict[str, dict[str, Any]] = {}
    for path in trials:
        trial, provenance = metadata_of(path)
        files = of_trials[trial] = {"experiment": experiments[trial], "files": []}
        for file in provenance["files"].values():
            recordings[file["path"]] = file["sha256"]
            files["files"] += [file["path"], f"source {file['source']}"]
    return {
        "stated": stated,
        "recordings": recordings,
        "trials": of_trials,
        "code": {"version": version(DISTRIBUTION), "digest": code()},
        "libraries": libraries(),
    }
