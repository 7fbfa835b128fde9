# SPDX-License-Identifier: Apache-2.0
"""Compare the results of two runs of one campaign, cell by cell.

    python tools/compare_results.py BEFORE AFTER [--tolerance 1e-9] [--only tables/impedance.csv]

BEFORE and AFTER are folders `results` of `snakemake reproduce-all`. Compared are the tables in
`tables/`, `fits/` and `quality/`, those in the archives of `fits/`, the samples in `trials/` and
`crossings/`, and the values in JSON files. A row is known by its names, such as trial, amplitude
and estimate, so that a row that is new or gone moves no other one. One line is printed for each
column that moved: how many of its cells, and the cell that moved most. With the interval of an
estimate known (`K_low`, `K_high`), the largest move is in half-widths, too.

A number has moved where it differs by more than the tolerance: as a share of itself, and of a
signal over time as a share of the signal's largest value. The exit code is 1 if anything differs.
"""

import argparse
import io
import json
import sys
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

ROUNDING = 1e-9  # relative difference, above that of another order of additions
TABLES = ("tables/*.csv", "fits/*/*.csv", "quality/*.csv")
ARCHIVES = ("fits/*/*.zip",)
SAMPLES = ("trials/*.parquet", "crossings/*.parquet")
VALUES = ("summary.json", "fits/*.json", "fits/*/*.json")
# the columns that name a row, as far as a table has them
NAMES = (
    *("trial", "group", "joint", "side", "scope", "commanded_deg", "perturbed"),
    *("estimate", "source", "part", "basis", "detail", "per", "quantity", "estimator", "of"),
    *("check", "finding", "table", "name", "claim", "setting", "signals", "motion", "unit"),
    *("phase", "trajectory", "K_d", "B_d"),
)
NAMES_DIGITS = 6  # of a number in a row's name
SHOWN = 60  # characters of a text that are printed
TIME = "time"  # the column of a table of signals


@dataclass(frozen=True)
class Difference:
    """How one column of a table differs between two runs.

    Attributes
    ----------
    column : str
    cells : int
        How many of its cells differ.
    size : float
        The largest relative difference; NaN where a text differs, or a cell is empty in one run.
    half_widths : float
        The largest difference over half of the interval before; NaN without an interval.
    example : str
        The cell that differs most, before and after.
    """

    column: str
    cells: int
    size: float
    half_widths: float
    example: str

    def __str__(self) -> str:
        moved = "text" if np.isnan(self.size) else f"{self.size:.1e}"
        if not np.isnan(self.half_widths):
            moved += f" ({self.half_widths:.1e} half-widths)"
        return f"  {self.column}: {self.cells} cells, {moved}; {self.example}"


def contents_of(folder: Path) -> dict[str, bytes]:
    """Bytes of all tables below a folder of results, by the names that they have there."""
    contents = {}
    for pattern in (*TABLES, *SAMPLES, *VALUES):
        for path in sorted(folder.glob(pattern)):
            contents[str(path.relative_to(folder))] = path.read_bytes()
    for pattern in ARCHIVES:
        for path in sorted(folder.glob(pattern)):
            with zipfile.ZipFile(path) as archive:
                for part in archive.namelist():
                    contents[f"{path.relative_to(folder)}/{part}"] = archive.read(part)
    return contents


def table_of(name: str, content: bytes) -> pl.DataFrame:
    """The table that a file of this name holds."""
    if name.endswith(".json"):
        leaves = list(leaves_of(json.loads(content)))
        return pl.DataFrame(leaves, schema=["name", "value"], orient="row")
    if name.endswith(".csv"):
        return pl.read_csv(content, infer_schema_length=None)
    table = pl.read_parquet(io.BytesIO(content))
    for column in table:
        if isinstance(column.dtype, pl.Array):  # as the three coordinates of a marker
            parts = [f"{column.name}.{k}" for k in range(column.dtype.size)]
            split = pl.DataFrame(column.to_numpy(), schema=parts)
            table = table.drop(column.name).hstack(split)
    return table


def leaves_of(value: Any, place: str = "") -> Iterator[tuple[str, str]]:
    """Places and texts of all values within a value of JSON."""
    if isinstance(value, Mapping):
        for key, part in value.items():
            yield from leaves_of(part, f"{place}.{key}" if place else key)
    elif isinstance(value, list):
        for number, part in enumerate(value):
            yield from leaves_of(part, f"{place}.{number}")
    else:
        yield place, str(value)


def row_names(table: pl.DataFrame) -> list[str]:
    """A name for each row, from the columns that name it; rows of one name are numbered."""
    columns = []
    for name in NAMES:
        if name not in table.columns:
            continue
        column = table[name]
        if column.dtype.is_float():
            if TIME in table.columns:  # a sample is known by its place
                continue
            column = column.round_sig_figs(NAMES_DIGITS)
        columns.append(column.cast(pl.String).fill_null("").to_list())
    seen: dict[str, int] = {}
    names = []
    for cells in zip(*columns, strict=True) if columns else [()] * len(table):
        name = " ".join(cell for cell in cells if cell)
        seen[name] = seen.get(name, 0) + 1
        names.append(f"{name} #{seen[name]}" if seen[name] > 1 or not name else name)
    return names


def numbers_of(column: pl.Series) -> np.ndarray:
    """Numbers (n,) of a column; NaN where a cell is no number."""
    return column.cast(pl.Float64, strict=False).fill_null(np.nan).to_numpy()


def texts_of(column: pl.Series) -> list[str]:
    """Texts (n) of a column's cells."""
    return column.cast(pl.String).fill_null("").to_list()


def half_widths_of(table: pl.DataFrame, column: str) -> np.ndarray | None:
    """Half of the interval (n,) of a column of estimates or of one of its ends; None: none."""
    estimate = column.removesuffix("_low").removesuffix("_high")
    low, high = f"{estimate}_low", f"{estimate}_high"
    if low not in table.columns or high not in table.columns:
        return None
    return (numbers_of(table[high]) - numbers_of(table[low])) / 2


def shown(text: str) -> str:
    """A cell as it is printed."""
    return repr(text if len(text) <= SHOWN else f"{text[:SHOWN]}…")


def compare_column(
    before: pl.DataFrame, after: pl.DataFrame, column: str, names: list[str], tolerance: float
) -> Difference | None:
    """Compare one column of two tables with equal rows."""
    x, y = (numbers_of(table[column]) for table in (before, after))
    are_numbers = ~np.isnan(x) & ~np.isnan(y)
    scale = np.maximum(np.abs(x), np.abs(y))
    if TIME in before.columns and are_numbers.any():
        scale = np.full(len(x), scale[are_numbers].max())
    # of zeros, and of what is no number, there is no share
    share = np.divide(np.abs(x - y), scale, where=are_numbers & (scale > 0), out=np.zeros(len(x)))
    if are_numbers.all() and share.max(initial=0.0) <= tolerance:
        return None
    texts_before, texts_after = texts_of(before[column]), texts_of(after[column])
    is_other_text = np.array(texts_before) != np.array(texts_after)
    differs = np.where(are_numbers, share > tolerance, is_other_text)
    if not differs.any():
        return None

    differs_in_text = differs & ~are_numbers
    worst = int(np.argmax(differs_in_text) if differs_in_text.any() else np.argmax(share))
    half_widths = half_widths_of(before, column)
    moved_by = np.nan
    if half_widths is not None:
        has_interval = are_numbers & (half_widths > 0)
        if has_interval.any():
            moved_by = np.max(np.abs(x - y)[has_interval] / half_widths[has_interval])
    return Difference(
        column=column,
        cells=int(differs.sum()),
        size=np.nan if differs_in_text.any() else share.max(),
        half_widths=moved_by,
        example=f"{names[worst]}: {shown(texts_before[worst])} → {shown(texts_after[worst])}",
    )


def compare_tables(before: pl.DataFrame, after: pl.DataFrame, tolerance: float) -> list[str]:
    """Lines that say how two tables differ; none where they are equal."""
    lines = []
    only_before = [column for column in before.columns if column not in after.columns]
    only_after = [column for column in after.columns if column not in before.columns]
    if only_before or only_after:
        lines.append(f"  columns gone: {only_before}; new: {only_after}")

    names_before, names_after = row_names(before), row_names(after)
    places = {name: row for row, name in enumerate(names_after)}
    common = [name for name in names_before if name in places]
    gone = [name for name in names_before if name not in places]
    new = sorted(places.keys() - set(names_before), key=places.__getitem__)
    if gone or new:
        lines.append(f"  rows gone: {len(gone)} {gone[:3]}; new: {len(new)} {new[:3]}")

    place_before = {name: row for row, name in enumerate(names_before)}
    before = before[[place_before[name] for name in common]]
    after = after[[places[name] for name in common]]
    for column in before.columns:
        if column in after.columns:
            difference = compare_column(before, after, column, common, tolerance)
            if difference is not None:
                lines.append(str(difference))
    return lines


def main() -> int:
    """Print how two folders of results differ."""
    parser = argparse.ArgumentParser(description="Compare two folders of results cell by cell.")
    parser.add_argument("before", type=Path, metavar="BEFORE")
    parser.add_argument("after", type=Path, metavar="AFTER")
    parser.add_argument("--tolerance", type=float, default=ROUNDING, help="relative difference")
    parser.add_argument("--only", default="", metavar="TEXT", help="tables whose names contain it")
    asked = parser.parse_args()

    before, after = (contents_of(folder) for folder in (asked.before, asked.after))
    names = [name for name in {**before, **after} if asked.only in name]
    n_different = 0
    for name in names:
        if name not in before or name not in after:
            lines = [f"  only {'after' if name in after else 'before'}"]
        elif before[name] == after[name]:
            lines = []
        else:
            tables = (table_of(name, content[name]) for content in (before, after))
            lines = compare_tables(*tables, asked.tolerance)
        if lines:
            n_different += 1
            print(name, *lines, sep="\n")
    print(f"{n_different} of {len(names)} tables differ by more than {asked.tolerance:g}")
    return int(n_different > 0)


if __name__ == "__main__":
    sys.exit(main())
