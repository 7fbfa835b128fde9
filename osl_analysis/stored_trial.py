"""A trial that stays in its file, of which a fit reads one column at a time: that of a long recording."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.trial import Array, Trial, check_time, read_metadata, read_samples, read_trial

LONG = 1 << 23
"""Values of a file from which it is not read as a whole: 64 MB, twenty minutes of six signals at 1 kHz."""


AT_ONCE = 1 << 20
"""Rows that are read at a time."""


class StoredTrial(Trial):
    """A trial whose columns are read from its file (Parquet) each time that they are asked for."""

    def __init__(self, path: Path) -> None:
        """Raises as `read_trial`."""
        name, provenance = read_metadata(path)
        fields = {"name": name, "provenance": provenance, "path": path, "schema": pl.read_parquet_schema(path)}
        for key, value in fields.items():
            object.__setattr__(self, key, value)
        object.__setattr__(self, "rows", rows_of(path))
        self.check_columns("time")
        check_time(self.name, self.arrays()[0])

    path: Path
    schema: dict[str, pl.DataType]
    rows: int

    @property
    def columns(self) -> Sequence[str]:
        """Names of the columns, `time` among them."""
        return list(self.schema)

    @property
    def samples(self) -> pl.DataFrame:
        """All of them, read anew."""
        return read_samples(pl.scan_parquet(self.path), self.path)

    def present(self, column: str) -> NDArray[np.bool_]:
        """As `Trial.present`."""
        self.check_columns(column)
        wanted = pl.scan_parquet(self.path).select(pl.col(column).is_not_null())
        return read_samples(wanted, self.path)[column].to_numpy()

    def sampled(self, *columns: str) -> pl.DataFrame:
        """As `Trial.sampled`."""
        self.check_columns(*columns)
        return read_samples(self._wanted(*columns).drop_nulls(), self.path)

    def _wanted(self, *columns: str) -> pl.LazyFrame:
        return pl.scan_parquet(self.path).select("time", *columns)

    def arrays(self, *columns: str) -> list[Array]:
        """As `Trial.arrays`. Rows are read some at a time, since a column is there twice before it is one array."""
        self.check_columns(*columns)
        found, used = [np.empty(0, self.schema[name].to_python()) for name in ("time", *columns)], 0
        for first in range(0, self.rows, AT_ONCE):
            rows = read_samples(self._wanted(*columns).slice(first, AT_ONCE).drop_nulls(), self.path)
            for array, values in zip(found, rows.iter_columns(), strict=True):
                array.resize(used + len(rows), refcheck=False)
                array[used:] = values
            used += len(rows)
        return found


def open_trial(path: Path) -> Trial:
    """The trial of a file of `write_trial`, for its fit: in memory, or in its file if it is long.

    Raises
    ------
    InputError
        As `read_trial`.
    """
    read_metadata(path)
    columns = len(pl.read_parquet_schema(path))
    return StoredTrial(path) if rows_of(path) * columns > LONG else read_trial(path)


def rows_of(path: Path) -> int:
    """Number of rows of a file; raises as `read_trial`."""
    return int(read_samples(pl.scan_parquet(path).select(pl.len()), path).item())
