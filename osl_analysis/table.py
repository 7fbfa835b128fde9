"""Tidy result tables as CSV, with full precision. A table is written completely or not at all."""

import math
import zipfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.files import atomic_path
from osl_analysis.refusal import check_not_refused

if TYPE_CHECKING:
    import pandas

ARCHIVE_SUFFIX = ".zip"  # of several tables in one file
FIRST_ROWS = 1000  # from which the types of columns are inferred
DATE_IN_ARCHIVE = (1980, 1, 1, 0, 0, 0)  # fixed, so that equal tables are an equal archive
# a spreadsheet runs a text that begins so
FORMULA = r"^(['=+@\t\r]|-[A-Za-z(])"
# columns that are text even if every entry looks like a number, such as a trial named `01`
TEXT_COLUMNS = (
    "trial", "controller", "branch", "quantity", "estimator", "check", "unit", "verdict", "remark",
    "reason", "excluded", "panel", "curve", "interval_method", "doubtful", "model",
    "motion", "group", "direction", "subject", "side", "different", "doubt",
    "remarks", "excitation", "desired", "loading", "method", "joint", "scope",
    "data", "chosen", "trajectory", "table", "grade",
    "name", "cause", "evidence", "says", "size", "remedy", "fault_family", "explanations",
)  # fmt: skip
# columns that identify a row of a table and of its evidence
ROW_KEYS = ("trial", "joint", "side", "amplitude_deg")

# `joint` and `side` by the name of a trial or group
Places = Mapping[str, Mapping[str, str | None]]


SIMULATED = "simulated"
MEASURED = "measured"


def marked_data(frame: pl.DataFrame, data: str = "") -> pl.DataFrame:
    """A table as it is written: with a last column `data` (`SIMULATED` or `MEASURED`; none if
    empty), without a `side` that is all null, and safe from spreadsheet formulas."""
    left_out = ["data"] if data else []
    has_place = "joint" in frame.columns and "side" in frame.columns
    if has_place and frame["side"].null_count() == len(frame):
        left_out.append("side")
    columns = []
    for name, dtype in frame.schema.items():
        if name in left_out:
            continue
        column = pl.col(name)
        if dtype == pl.String:
            # a ' before it prevents that a spreadsheet runs a text
            column = column.str.replace(FORMULA, "'$1")
        columns.append(column)
    if data:
        columns.append(pl.lit(data, pl.String).alias("data"))
    return frame.select(columns)


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
        # without compression
        with atomic_path(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
            for name, content in parts.items():
                archive.writestr(zipfile.ZipInfo(name, DATE_IN_ARCHIVE), content)


def with_places(table: pl.DataFrame, places: Places, by: str = "trial") -> pl.DataFrame:
    """Add the columns `joint` and `side` behind the column `by`.

    They are null for a trial that is not in `places`. A table without the column `by`, and a column
    that is there already, stay as they are.
    """
    if by not in table.columns:
        return table
    columns = []
    for name in ("joint", "side"):
        if name not in table.columns:
            values = [places.get(trial, {}).get(name) for trial in table[by]]
            columns.append(pl.Series(name, values, dtype=pl.String))
    behind = table.columns.index(by) + 1
    return table.select(*table.columns[:behind], *columns, *table.columns[behind:])


def read_table(path: Path | str, required: Sequence[str] = (), name: str = "") -> pl.DataFrame:
    """Read a result table of a campaign, such as `results/tables/impedance.csv`; `osl-analysis
    results --columns` explains it.

    Parameters
    ----------
    path : Path or str
        CSV file, or an archive of several.
    required : Sequence of str
        Columns that must exist and hold numbers, except `TEXT_COLUMNS`.
    name : str
        The table's name if `path` is an archive.

    Returns
    -------
    polars.DataFrame
        Columns without entries are Float64 null, `TEXT_COLUMNS` are text, and a missing `side` is
        null.

    Raises
    ------
    InputError
        The table is missing, is no CSV, or was refused.
    """
    path = Path(path)
    table = table_of(path, content_of(path, name))
    for column in required:
        check_column(path, table, column)
    return without_blank_lines(table)


def read_tables(paths: Sequence[Path], name: str = "") -> pl.DataFrame:
    """Read tables below one another; arguments and errors as in `read_table`.

    Those with equal columns that follow one another are read as one: a file takes milliseconds, its
    rows microseconds.
    """
    contents = [content_of(path, name) for path in paths]
    headers = [content.partition(b"\n")[0] for content in contents]
    begins = [row for row in range(len(paths)) if row == 0 or headers[row] != headers[row - 1]]
    tables = []
    for first, stop in pairwise([*begins, len(paths)]):
        rows = [content.partition(b"\n")[2].removesuffix(b"\n") for content in contents[first:stop]]
        text = b"\n".join([headers[first], *filter(None, rows)])
        try:
            tables.append(table_of(paths[first], text))
        except InputError:
            for row in range(first, stop):
                table_of(paths[row], contents[row])  # names the file that is no table
            raise
    return without_blank_lines(pl.concat(tables, how="diagonal_relaxed"))


def content_of(path: Path, name: str = "") -> bytes:
    """The CSV text of a table; arguments and errors as in `read_table`."""
    check_not_refused(path)
    if not path.is_file():
        raise InputError(f"{path}: no such table; run the step that writes it, or check the path")
    return part_of_archive(path, name) if path.suffix == ARCHIVE_SUFFIX else path.read_bytes()


def table_of(path: Path, content: bytes) -> pl.DataFrame:
    """The table of a CSV text, with the types of `read_table`; `path` is named in errors."""
    try:
        table = typed_csv(content)
    except pl.exceptions.PolarsError as error:
        reason = str(error).strip().splitlines()[0]
        raise InputError(
            f"{path}: not a CSV table ({reason}); rewrite it with the step that makes it"
        ) from error
    changed = []
    for column in table:
        if column.name not in TEXT_COLUMNS and column.null_count() == len(table):
            changed.append(pl.col(column.name).cast(pl.Float64))
        elif column.dtype == pl.String:
            changed.append(pl.col(column.name).str.strip_prefix("'"))
    if changed:
        table = table.with_columns(changed)
    if "joint" in table.columns and "side" not in table.columns:
        side = pl.lit(None, pl.String).alias("side")
        table.insert_column(table.columns.index("joint") + 1, side)
    return table


def without_blank_lines(table: pl.DataFrame) -> pl.DataFrame:
    """A table without the blank lines that an editor may leave."""
    if all(column.has_nulls() for column in table):
        return table.filter(~pl.all_horizontal(pl.all().is_null()))
    return table


def part_of_archive(path: Path, name: str) -> bytes:
    """The CSV text of one table of an archive."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.read(f"{name}.csv")
    except (OSError, KeyError, zipfile.BadZipFile) as error:
        raise InputError(
            f"{path / name}.csv: no such table ({error}); run the step that writes it, or check the"
            " path"
        ) from error


def check_column(path: Path, table: pl.DataFrame, column: str) -> None:
    """Refuse a table without a column, or with text in it that is to be numbers."""
    if column not in table.columns:
        raise InputError(
            f"{path}: no column '{column}'; it has {', '.join(table.columns)}. Rewrite it with the"
            " step that makes it"
        )
    if column in TEXT_COLUMNS or table[column].dtype.is_numeric():
        return
    words = table[column].cast(pl.String)
    is_filled = words.is_not_null()
    is_wrong = is_filled & words.cast(pl.Float64, strict=False).is_null()
    row = (is_wrong if is_wrong.any() else is_filled).arg_max() or 0
    raise InputError(
        f"{path}: line {row + 2}: column '{column}' holds '{words[row]}', expected numbers; correct"
        " the entry"
    )


def typed_csv(source: bytes) -> pl.DataFrame:
    """Read a CSV with column types that fit all rows.

    Types are inferred from the first rows, which takes a third of the time; from all rows if a
    later entry does not fit, or if a column is empty in the first ones.
    """
    types = dict.fromkeys(TEXT_COLUMNS, pl.String)
    with suppress(pl.exceptions.ComputeError):
        table = pl.read_csv(source, schema_overrides=types, infer_schema_length=FIRST_ROWS)
        if not any(is_empty_at_first(column) for column in table):
            return table
    return pl.read_csv(source, schema_overrides=types, infer_schema_length=None)


def is_empty_at_first(column: pl.Series) -> bool:
    """Whether a column has entries, but none in the first rows."""
    is_empty = column.head(FIRST_ROWS).null_count() == FIRST_ROWS
    return is_empty and column.null_count() < len(column)


def with_evidence(path: Path, required: Sequence[str] = ()) -> pl.DataFrame:
    """Read a table as `read_table`, joined with its evidence, `NAME_evidence.csv`, which the same
    step writes."""
    table = read_table(path, required)
    evidence_path = path.with_stem(f"{path.stem}_evidence")
    if not evidence_path.is_file():
        return table
    keys = [name for name in ROW_KEYS if name in table.columns]
    evidence = read_table(evidence_path).drop("data", strict=False)
    evidence = evidence.with_columns(pl.col(name).cast(table.schema[name]) for name in keys)
    return table.join(evidence, on=keys, how="left", nulls_equal=True, maintain_order="left")


def finite_or_null(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row of a table, with nested mappings, for JSON. Infinity and NaN become null: JSON has
    neither."""
    finite: dict[str, Any] = {}
    for key, value in row.items():
        if isinstance(value, Mapping):
            finite[key] = finite_or_null(value)
        elif isinstance(value, float) and not math.isfinite(value):
            finite[key] = None
        else:
            finite[key] = value
    return finite


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

    columns = {}
    for column in table:
        is_number = column.dtype.is_numeric()
        columns[column.name] = column.to_numpy() if is_number else column.to_list()
    return pd.DataFrame(columns)
