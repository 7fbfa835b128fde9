"""Tidy result tables as CSV, with full precision. A table is written completely or not at all."""

import math
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.files import atomic_path
from osl_analysis.refusal import check_not_refused

if TYPE_CHECKING:
    import pandas

SUFFIX = ".zip"  # Of an archive of several tables.
TEXT_COLUMNS = (
    "trial", "controller", "branch", "quantity", "estimator", "check", "unit", "verdict", "remark",
    "reason",
    "excluded", "panel", "curve", "interval_method", "doubtful", "experiment", "model", 
    "motion", "group", "gait", "direction", "subject", "session", "side", "speed", "pooled",
    "series", "group_stated",
    "not_checked", "excitation", "desired", "loading", "method", "joint", "data",
    "chosen", "trajectory", "axis_from", "over", "missing_components", "table", "grade", "cause",
    "inherited",
    "evidence", "side", "says", "size", "remedy", "reaction", "rivals", "heard", "law",
)  # fmt: skip
"""Columns that are text even if every entry looks like a number, such as a trial named `01`."""


SIMULATED, MEASURED = "simulated", "measured"
OF_DATA: ContextVar[str] = ContextVar("of_data", default="")


@contextmanager
def tables_of(data: str) -> Iterator[None]:
    """Within the block, every table gets a last column `data`: `SIMULATED` or `MEASURED`; none if
    `data` is empty."""
    token = OF_DATA.set(data)
    try:
        yield
    finally:
        OF_DATA.reset(token)


def marked_data(frame: pl.DataFrame) -> pl.DataFrame:
    """A table as it is written: with `data`, without a `side` that is all null, and safe from
    spreadsheet formulas."""
    data = OF_DATA.get()
    if {"joint", "side"} <= {*frame.columns} and frame["side"].null_count() == len(frame):
        frame = frame.drop("side")
    frame = frame.drop("data") if data and "data" in frame.columns else frame
    last = [pl.lit(data, pl.String).alias("data")] * bool(data)
    # A spreadsheet runs a text that begins so; a ' before it prevents that.
    return frame.with_columns(
        pl.col(pl.String).str.replace(r"^(['=+@\t\r]|-[A-Za-z(])", "'$1"), *last
    )


def write_table(frame: pl.DataFrame, path: Path) -> None:
    """Write a table as CSV that reads back to the same numbers. null becomes an empty field, NaN is
    `NaN`. A path that ends in `.parquet` is written as Parquet."""
    with atomic_path(path) as temporary:
        if path.suffix == ".parquet":
            frame.write_parquet(temporary, compression="lz4")
        else:
            marked_data(frame).write_csv(temporary)


def write_tables(tables: Mapping[Path, pl.DataFrame]) -> None:
    """Write tables. A path below an archive is a part of it. A fixed date makes equal tables an
    equal archive."""
    archives: dict[Path, dict[str, str]] = {}
    for path, frame in tables.items():
        if path.parent.suffix == SUFFIX:
            archives.setdefault(path.parent, {})[path.name] = marked_data(frame).write_csv()
        else:
            write_table(frame, path)
    for path, parts in archives.items():
        # without compression
        with atomic_path(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
            for name, content in parts.items():
                archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), content)


# `joint` and `side` by the name of a trial or group.
Places = Mapping[str, Mapping[str, str | None]]


def with_places(table: pl.DataFrame, places: Places, by: str = "trial") -> pl.DataFrame:
    """A table with the columns `joint` and `side` behind its column `by`. They are null for a trial
    that is not in `places`. A table without the column `by`, and a column that is there already,
    stay as they are."""
    if by not in table.columns:
        return table
    added = [name for name in ("joint", "side") if name not in table.columns]
    known = {name: [places.get(one, {}).get(name) for one in table[by]] for name in added}
    at = table.columns.index(by) + 1
    places_of = [pl.Series(name, values, dtype=pl.String) for name, values in known.items()]
    return table.select(*table.columns[:at], *places_of, *table.columns[at:])


def read_table(path: Path | str, required: Sequence[str] = (), of: str = "") -> pl.DataFrame:
    """A result table of a campaign, such as `results/tables/impedance.csv`; `osl-analysis
    results --columns` explains it.

    Columns without entries are Float64 null, `TEXT_COLUMNS` are text, and a missing `side` is null.
    The `required` columns must exist and hold numbers, except `TEXT_COLUMNS`. `of` is the table's
    name if `path` is an archive of several. Raises InputError: the table is missing, is no CSV, or
    was refused."""
    path = Path(path)
    check_not_refused(path)
    if not path.is_file():
        raise InputError(f"{path}: no such table; run the step that writes it, or check the path")
    source: Path | bytes = path
    if path.suffix == SUFFIX:
        try:
            with zipfile.ZipFile(path) as archive:
                source = archive.read(f"{of}.csv")
        except (OSError, KeyError, zipfile.BadZipFile) as error:
            missing = f"{path / of}.csv: no such table ({error})"
            raise InputError(
                f"{missing}; run the step that writes it, or check the path"
            ) from error
    try:
        table = typed_csv(source)
    except pl.exceptions.PolarsError as error:
        reason = str(error).strip().splitlines()[0]
        raise InputError(
            f"{path}: not a CSV table ({reason}); rewrite it with the step that makes it"
        ) from error
    empty = [
        c for c in table.columns if c not in TEXT_COLUMNS and table[c].null_count() == len(table)
    ]
    texts = pl.col(pl.String).exclude(empty)
    table = table.with_columns(texts.str.strip_prefix("'"), pl.col(empty).cast(pl.Float64))
    if "joint" in table.columns and "side" not in table.columns:
        table.insert_column(table.columns.index("joint") + 1, pl.lit(None, pl.String).alias("side"))
    for column in required:
        if column not in table.columns:
            there = ", ".join(table.columns)
            raise InputError(
                f"{path}: no column '{column}'; it has {there}. Rewrite it with the step that"
                " makes it"
            )
        if column not in TEXT_COLUMNS and not table[column].dtype.is_numeric():
            words = table[column].cast(pl.String)
            wrong = words.is_not_null() & words.cast(pl.Float64, strict=False).is_null()
            row = (wrong if wrong.any() else words.is_not_null()).arg_max() or 0
            said = f"column '{column}' holds '{words[row]}', expected numbers; correct the entry"
            raise InputError(f"{path}: line {row + 2}: {said}")
    # there may be blank lines, as an editor leaves them
    blank = all(one.has_nulls() for one in table)
    return table.filter(~pl.all_horizontal(pl.all().is_null())) if blank else table


def typed_csv(source: Path | bytes) -> pl.DataFrame:
    """A table with column types that fit all rows. Types are inferred from the first rows, which
    takes a third of the time; from all rows if a later entry does not fit, or if a column is empty
    in the first ones."""
    read, first = (
        partial(pl.read_csv, source, schema_overrides=dict.fromkeys(TEXT_COLUMNS, pl.String)),
        1000,
    )
    with suppress(pl.exceptions.ComputeError):
        table: pl.DataFrame = read(infer_schema_length=first)
        if not any(
            one.head(first).null_count() == first and one.null_count() < len(one) for one in table
        ):
            return table
    return read(infer_schema_length=None)


# columns that identify a row of a table and of its evidence
OF_ROW = ("trial", "joint", "side", "amplitude_deg")


def with_evidence(path: Path, required: Sequence[str] = ()) -> pl.DataFrame:
    """As `read_table`, joined with the table's evidence, `NAME_evidence.csv`, which the same step
    writes."""
    table, beside = read_table(path, required), path.with_stem(f"{path.stem}_evidence")
    if not beside.is_file():
        return table
    keys = [name for name in OF_ROW if name in table.columns]
    evidence = read_table(beside).drop("data", strict=False)
    evidence = evidence.with_columns(pl.col(name).cast(table.schema[name]) for name in keys)
    return table.join(evidence, on=keys, how="left", nulls_equal=True, maintain_order="left")


def held_against_desired(fits: pl.DataFrame) -> pl.DataFrame:
    """Fits whose B and interval are those to compare with B_d. Where friction is certain, that is
    `B_viscous`: a desired damping has no friction. The range over single amplitudes includes
    friction, so it is null there."""
    ends = ("", "_low", "_high", "_amplitudes_low", "_amplitudes_high")
    own = {
        f"B{end}": f"B_viscous{end}"
        for end in ends
        if f"B{end}" in fits.columns and "B_viscous" in fits.columns
    }
    without = {
        name: pl.col(other) if other in fits.columns else None for name, other in own.items()
    }
    rubs = pl.col("B_viscous").is_not_null()
    return fits.with_columns(
        pl.when(rubs).then(one).otherwise(name).alias(name) for name, one in without.items()
    )


def finite_or_null(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row of a table, with nested mappings, for JSON. Infinity and NaN become null: JSON has
    neither."""
    lost = {
        key for key, value in row.items() if isinstance(value, float) and not math.isfinite(value)
    }
    finite = {key: None if key in lost else value for key, value in row.items()}
    return {
        key: finite_or_null(value) if isinstance(value, Mapping) else value
        for key, value in finite.items()
    }


def to_pandas(table: pl.DataFrame) -> "pandas.DataFrame":
    """A table as a pandas data frame, null as NaN or None. Polars' own method would need
    pyarrow."""
    import pandas as pd  # takes 0.3 s

    return pd.DataFrame(
        {one.name: one.to_numpy() if one.dtype.is_numeric() else one.to_list() for one in table}
    )
