# SPDX-License-Identifier: Apache-2.0
"""Numbers that the last commit left, right or not, so that none changes unnoticed.

reference_numbers.csv has a row for each headline, table, figure and text of a small campaign.
`python tests/reference.py` writes it anew; the commit shows what changed.
"""

import json
import re
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from zlib import crc32

import numpy as np
import polars as pl

HERE = Path(__file__).parent
NUMBERS = HERE / "reference_numbers.csv"
NUMBER = re.compile(r"(?<![\d.])-?\d+\.\d+(?![\d.])")
NOT_COMPARED = re.compile(r"<(script|style|svg)\b.*?</\1>|base64,[^\"']*", re.DOTALL)
"""What comes from other packages, and drawings, whose numbers stand in `figures/*.csv`."""
UNDETERMINED = re.compile(
    "lag|delay_s|noise_share|B_viscous_se|unexplained_share|fault_probability|told_s"
)
"""Columns of what a recording does not determine, where other matrix kernels give other numbers: in
the fifth digit for an inertia beside friction, which is known to the first."""
SUMS = ("size", "mean", "trend")
NEAR = 2e-6
"""How far a number may be off, as a part of it, and a sum over columns as it is: other matrix
kernels give 4e-8."""


def as_number(cell) -> float:
    """A name has a number of its own, a sentence 1: new wording changes nothing, a verdict gained
    or lost does."""
    if not isinstance(cell, str):
        return float(cell)
    return 1.0 if " " in cell else crc32(cell.encode()) / 2**32


def row_of(columns: dict[str, list]) -> dict[str, float]:
    """The numbers of a table, each the sum over its columns with weights of 1 to 2 by name: `size`
    of the decimal logarithm of the largest (a factor, a unit), `mean` and `trend` (sign, order) of
    the values over the largest."""
    row = {
        "columns": len(columns),
        "cells": sum(map(len, columns.values())),
        **dict.fromkeys(SUMS, 0.0),
    }
    for name, cells in columns.items():
        x = np.array([as_number(cell) for cell in cells])
        x = x[np.isfinite(x)]
        if (largest := np.abs(x).max(initial=0)) > 1e-9:  # else it is rounding
            weight = 1 + crc32(name.encode()) / 2**32
            rank = np.arange(1, x.size + 1)
            row["size"] += weight * np.log10(largest)
            row["mean"] += weight * x.mean() / largest
            row["trend"] += weight * (rank @ x) / rank.sum() / largest
    return row


def numbers_of(results: Path) -> dict[str, dict[str, float]]:
    """Those of every headline, table, figure and text of a campaign, by place. The trials of an
    experiment are one."""
    columns = {}
    for path in sorted(
        path
        for pattern in ("tables/*.csv", "figures/*.csv", "trials/*.parquet", "crossings/*.parquet")
        for path in results.glob(pattern)
    ):
        is_table = path.suffix == ".csv"
        table = pl.read_csv(path, infer_schema_length=None) if is_table else pl.read_parquet(path)
        place = f"{path.parent.name}/{path.name if is_table else re.match('[a-z]+', path.name)[0]}"
        for column in (
            column.drop_nulls() for column in table if not UNDETERMINED.search(column.name)
        ):
            columns.setdefault(place, {}).setdefault(column.name, []).extend(
                column.to_numpy().ravel()
            )
    for path in sorted(
        path for pattern in ("report.html", "numbers.tex") for path in results.glob(pattern)
    ):
        text = NOT_COMPARED.sub("", path.read_text(encoding="utf-8"))
        columns[str(path.relative_to(results))] = {"numbers": [*map(float, NUMBER.findall(text))]}
    headlines = json.loads((results / "summary.json").read_text())["numbers"]
    values = {
        name: {
            key: float(each[key])
            for key in ("value", "low", "high", "n")
            if each.get(key) is not None
        }
        for name, each in headlines.items()
    }
    return values | {place: row_of(each) for place, each in columns.items()}


def changed(results: Path) -> list[str]:
    """Where the numbers of the campaign are no longer those of the file, and both."""
    kept = {
        place: {name: float(number) for name, number in re.findall(r"(\w+) (\S+)", numbers)}
        for place, numbers in pl.read_csv(NUMBERS).rows()
    }
    now = numbers_of(results)
    near = {
        place
        for place in kept.keys() & now.keys()
        if kept[place].keys() == now[place].keys()
        and all(
            abs(now[place][k] - x) <= NEAR * (1 if k in SUMS else abs(x))
            for k, x in kept[place].items()
        )
    }
    return sorted(
        f"{place}: {kept.get(place)} -> {now.get(place)}"
        for place in (kept.keys() | now.keys()) - near
    )


if __name__ == "__main__":
    sys.path += [str(HERE.parent), str(HERE / "builders")]
    from snakemake_runs import Workspace

    with TemporaryDirectory() as folder:
        space = Workspace(Path(folder))
        assert space.run("reproduce-all").returncode == 0
        every = numbers_of(space.folder / "results")
    rows = [
        (place, " ".join(f"{name} {number:.10g}" for name, number in numbers.items()))
        for place, numbers in every.items()
    ]
    pl.DataFrame(rows, ["place", "numbers"], orient="row").write_csv(NUMBERS)
