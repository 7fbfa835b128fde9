# SPDX-License-Identifier: Apache-2.0
"""Write and read result tables: tidy CSV with full precision, written completely or not at all.

A refused trial has a row in the table of its fits, without estimates: `status` is `not analysed`,
and `reason` says why. In the table of all trials these rows stand last. A file of samples has the
reason in its metadata. Jobs that need a refused trial pass its reason on.
"""

import json
import re
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import polars as pl

from osl_analysis.base.errors import InputError
from osl_analysis.base.files import atomic_path
from osl_analysis.dictionary.described import text_columns

if TYPE_CHECKING:
    import pandas

ARCHIVE_SUFFIX = ".zip"  # of several tables in one file
FORMULA = "^[=+@'\t\r-]"  # how a text begins that a spreadsheet computes, or that is written quoted
QUOTED = re.compile(r"^'(?=[=+@'\t\r-])")  # what stands before it in a file

# `joint` and `side` by the name of a trial or group
Places = Mapping[str, Mapping[str, str | None]]


SIMULATED = "simulated"
MEASURED = "measured"
ANALYSED = "analysed"
OUTCOME = {"status": pl.lit(ANALYSED), "reason": pl.lit(None, pl.String)}  # of what was analysed
NOT_ANALYSED = "not analysed"
NOT_ANALYSED_KEY = "not_analysed"  # of JSON, and of the metadata of a Parquet file
SCHEMA = 4  # of names, units and types of columns; CONTRIBUTING.md says when it is raised
SCHEMA_FIELD = "tables_schema"  # of `summary.json`


def marked_data(frame: pl.DataFrame, data: str) -> pl.DataFrame:
    """A table as it is written: without a `side` that is all null, with texts that no spreadsheet
    takes for a formula, and with `data` as last column (`SIMULATED` or `MEASURED`; none if
    empty)."""
    frame = frame.with_columns(pl.col(pl.String).str.replace(FORMULA, "'$0"))
    if "side" in frame.columns and frame["side"].null_count() == len(frame):
        frame = frame.drop("side")
    if not data:
        return frame
    return frame.drop("data", strict=False).with_columns(data=pl.lit(data))


def write_table(frame: pl.DataFrame, path: Path, data: str = "") -> None:
    """Write a table as CSV that reads back to the same numbers, with `data` in its last column.
    null becomes an empty field, NaN is `NaN`. A path that ends in `.parquet` is written as Parquet,
    without that column."""
    with atomic_path(path) as temporary:
        if path.suffix == ".parquet":
            frame.write_parquet(temporary, compression="lz4")
        else:
            marked_data(frame, data).write_csv(temporary)


def write_tables(tables: Mapping[Path, pl.DataFrame], data: str = "") -> None:
    """Write tables, with `data` in their last column. A path below an archive is a part of it."""
    archives: dict[Path, dict[str, str]] = {}
    for path, frame in tables.items():
        if path.parent.suffix == ARCHIVE_SUFFIX:
            archives.setdefault(path.parent, {})[path.name] = marked_data(frame, data).write_csv()
        else:
            write_table(frame, path, data)
    for path, parts in archives.items():
        # without compression, and of no date, so that equal tables are an equal archive
        with atomic_path(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
            for name, content in parts.items():
                archive.writestr(zipfile.ZipInfo(name), content)


def with_places(table: pl.DataFrame, places: Places | None, by: str = "trial") -> pl.DataFrame:
    """Add the columns `joint` and `side` behind the column `by`.

    They are null for a trial that is not in `places`. A table without the column `by`, and a column
    that is there already, stay as they are.
    """
    if by not in table.columns:
        return table
    table = table.clone()
    places = places or {}
    behind = table.columns.index(by) + 1
    for name in ("side", "joint"):
        if name not in table.columns:
            values = [places.get(trial, {}).get(name) for trial in table[by]]
            table.insert_column(behind, pl.Series(name, values, dtype=pl.String))
    return table


def read_table(path: Path | str, required: Sequence[str] = (), name: str = "") -> pl.DataFrame:
    """Read a result table of a campaign, such as `results/tables/impedance.csv`; `osl-analysis
    results --columns` explains it.

    Parameters
    ----------
    path : Path or str
        CSV file, or an archive of several.
    required : Sequence of str
        Columns that must exist and hold numbers, or true and false, except those that the
        dictionary calls text.
    name : str
        The table's name if `path` is an archive.

    Returns
    -------
    polars.DataFrame
        Columns without entries are Float64 null, those that the dictionary calls text are
        text, and a missing `side` is null.

    Raises
    ------
    InputError
        The table is missing, is no CSV, or was refused.
    """
    path = Path(path)
    table = with_usual_types(rows_of(path, name))
    usable = [
        column.name
        for column in table
        if column.name in text_columns() or column.dtype.is_numeric() or column.dtype == pl.Boolean
    ]
    for name in required:
        if name not in usable:
            raise InputError(
                f"{path}: no column '{name}', or one with text where numbers are expected",
                f"it has {', '.join(table.columns)}: correct it, or make it again",
            )
    return table


def read_by_name(paths: Mapping[str, Path]) -> dict[str, pl.DataFrame]:
    """Read result tables, each by its name."""
    return {name: read_table(path) for name, path in paths.items()}


def read_tables(paths: Sequence[Path], name: str = "") -> pl.DataFrame:
    """Read tables below one another; arguments and errors as in `read_table`."""
    tables = [rows_of(path, name) for path in paths]
    return with_usual_types(pl.concat(tables, how="diagonal_relaxed"))


def rows_of(path: Path, name: str) -> pl.DataFrame:
    """The rows of a table, whose columns without entries are of type Null; arguments and errors as
    in `read_table`."""
    check_analysed(path)
    try:
        table = typed_rows(content_of(path, name))
    except UNREADABLE as error:
        raise InputError(
            f"{path}: no such table", "run the step that writes it, or check the path"
        ) from error
    except pl.exceptions.PolarsError as error:
        reason = str(error).strip().splitlines()[0]
        raise InputError(
            f"{path}: not a CSV table ({reason})", "correct it, or make it again"
        ) from error
    table = unquoted(table)
    if all(column.null_count() for column in table):  # else no line is blank, as of an editor
        table = table.filter(~pl.all_horizontal(pl.all().is_null()))
    if "status" in table.columns:
        table = table.filter(pl.col("status").ne_missing(NOT_ANALYSED))
    return table.with_columns(
        column.cast(pl.Null) for column in table if column.null_count() == len(table)
    )


FIRST_ROWS = 1000  # by which a table is typed: to ask all rows first takes five times as long


def typed_rows(content: bytes) -> pl.DataFrame:
    """The rows of a CSV. Its first ones tell the types, unless a number among the others
    contradicts them, or a column may only begin without entries: it passes for text."""
    types = dict.fromkeys(text_columns(), pl.String)
    read = partial(pl.read_csv, content, comment_prefix="#", schema_overrides=types)
    with suppress(pl.exceptions.PolarsError):
        table = read(infer_schema_length=FIRST_ROWS)
        if text_columns().issuperset(table.select(pl.col(pl.String)).columns):
            return table
    return read(infer_schema_length=None)


def unquoted(table: pl.DataFrame) -> pl.DataFrame:
    """A table that was read, with its texts as they were before they were written."""
    return table.with_columns(pl.col(pl.String).str.replace("^'([=+@'\t\r-])", "$1"))


UNREADABLE = (OSError, LookupError, zipfile.BadZipFile)  # errors of `content_of`


def content_of(path: Path, name: str) -> bytes:
    """A table as CSV, in an archive that of this name."""
    if path.suffix != ARCHIVE_SUFFIX:
        return path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        return archive.read(f"{name}.csv")


def with_usual_types(table: pl.DataFrame) -> pl.DataFrame:
    """A table whose columns without entries are numbers, or text by the dictionary, with a `side`
    beside a `joint`."""
    table = table.with_columns(
        column.cast(pl.String if column.name in text_columns() else pl.Float64)
        for column in table.select(pl.col(pl.Null))
    )
    if "joint" in table.columns and "side" not in table.columns:
        side = pl.lit(None, pl.String).alias("side")
        table.insert_column(table.columns.index("joint") + 1, side)
    return table


def to_pandas(table: pl.DataFrame) -> "pandas.DataFrame":
    """Convert a table to a pandas data frame, without pyarrow.

    Parameters
    ----------
    table : polars.DataFrame
        What `read_table`, `check` and the like return, `fit.table` or `trial.samples`.

    Returns
    -------
    pandas.DataFrame
        The same columns; null is NaN in numbers, else None.

    Examples
    --------
    >>> osl.to_pandas(trial.samples).columns.to_list()
    ['time', 'theta', 'torque']
    """
    import pandas as pd  # takes 0.3 s

    columns = {
        column.name: column.to_numpy() if column.dtype.is_numeric() else column.to_list()
        for column in table
    }
    return pd.DataFrame(columns)


# Whether a file of the campaign holds results, and of this release


def check_schema(schema: object, path: Path, release: object = None) -> None:
    """Refuse results with columns of another schema than that of this release.

    Parameters
    ----------
    stated : object
        What the file has; None where it has none.
    path : Path
        The file, for the message.
    release : object
        Version of osl-impedance that wrote it; None: not known.

    Raises
    ------
    InputError
        It is older or newer, so that columns may mean something else.
    """
    if schema == SCHEMA:
        return
    raise InputError(
        f"{path}: columns of schema {schema}, by release {release or '(not stated)'}",
        f"this release reads {SCHEMA}: make it again (`osl-analysis run`), or install that release",
    )


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
    causes: Sequence[Sequence[str]] = ()
    try:
        if path.suffix == ".parquet":
            causes = json.loads(pl.read_parquet_metadata(path).get(NOT_ANALYSED_KEY, "[]"))
        elif path.suffix == ".json":
            text = path.read_text(encoding="utf-8")
            if text.startswith(f'{{"{NOT_ANALYSED_KEY}"'):  # models are large
                causes = json.loads(text)[NOT_ANALYSED_KEY]
        elif path.suffix in (".csv", ARCHIVE_SUFFIX):
            columns = ("status", "trial", "reason")
            content = content_of(path, NOT_ANALYSED_KEY)
            if NOT_ANALYSED.encode() in content:  # most hold results, and need not be read
                rows = unquoted(pl.read_csv(content, columns=columns, infer_schema=False))
                if (rows["status"] == NOT_ANALYSED).all():
                    causes = rows.select(pl.col("trial", "reason").fill_null("")).rows()
    except (*UNREADABLE, ValueError, pl.exceptions.PolarsError):
        return ()
    return tuple(NotAnalysed(*cause) for cause in causes)


def check_analysed(path: Path) -> None:
    """If a file holds no results, raise the reason as an InputError."""
    for cause in not_analysed(path):
        reason, _, remedy = cause.text.partition("; ")  # a file holds both in one text
        raise InputError(f"{path}: there is no result: {reason}", remedy)


def by_trial(causes: Iterable[NotAnalysed]) -> dict[str, str]:
    """The first reason of each trial, by trial."""
    reasons: dict[str, str] = {}
    for cause in causes:
        if cause.trial:
            reasons.setdefault(cause.trial, cause.reason)
    return reasons
