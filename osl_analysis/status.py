"""Whether a file of the campaign holds results.

A trial that cannot be analysed has a row in each of its tables, without estimates: `status` is
`not analysed`, and `reason` says why. Its samples are a Parquet file with the same columns and no
rows. Tables over trials have these rows below the others; jobs that need its results pass the
reason on."""

import csv
import io
import json
import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import polars as pl

from osl_analysis.errors import InputError

ANALYSED = "analysed"
NOT_ANALYSED = "not analysed"
KEY = "not_analysed"  # of the metadata of a Parquet file
JSON_BEGIN = f'{{"status": "{NOT_ANALYSED}"'


class NotAnalysed(NamedTuple):
    """Why there is no result."""

    trial: str  # empty for a result over several trials
    reason: str  # what was wrong, and behind a semicolon what the user can do

    @property
    def text(self) -> str:
        return f"{self.trial}: {self.reason}" if self.trial else self.reason


def not_analysed(path: Path | str) -> tuple[NotAnalysed, ...]:
    """Why a file holds no results; empty if it holds some, is not there or is unreadable."""
    path = Path(path)
    try:
        if path.suffix == ".parquet":
            stated = pl.read_parquet_metadata(path).get(KEY, "[]")
            return tuple(NotAnalysed(*row) for row in json.loads(stated))
        if path.suffix == ".json":
            text = path.read_text(encoding="utf-8")
            is_result = not text.startswith(JSON_BEGIN)
            rows = [] if is_result else json.loads(text)["reasons"]
            return tuple(NotAnalysed(*row) for row in rows)
        if path.suffix == ".csv":
            with path.open(encoding="utf-8", newline="") as file:
                return tuple(reasons_in(file))
        if path.suffix == ".zip":
            with zipfile.ZipFile(path) as archive:
                content = archive.read(archive.namelist()[0]).decode()
            return tuple(reasons_in(io.StringIO(content)))
    except (OSError, ValueError, csv.Error, zipfile.BadZipFile, pl.exceptions.PolarsError):
        pass
    return ()


def reasons_in(table: Iterable[str]) -> Iterator[NotAnalysed]:
    """The reasons of a CSV table whose first row, and so each, is of what was not analysed."""
    for row in csv.DictReader(table):
        if row.get("status") != NOT_ANALYSED:
            return
        yield NotAnalysed(row.get("trial") or "", row.get("reason") or "")


def check_analysed(path: Path) -> None:
    """If a file holds no results, raise the reason as an InputError."""
    for cause in not_analysed(path):
        raise InputError(f"{path}: there is no result: {cause.text}")


def by_trial(causes: Iterable[NotAnalysed]) -> dict[str, str]:
    """The first reason of each trial, by trial."""
    reasons: dict[str, str] = {}
    for cause in causes:
        if cause.trial:
            reasons.setdefault(cause.trial, cause.reason)
    return reasons
