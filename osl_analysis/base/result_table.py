# SPDX-License-Identifier: Apache-2.0
"""Read a result table of a campaign that this release has made."""

import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.base import table


def read_table(path: Path | str, required: Sequence[str] = (), name: str = "") -> pl.DataFrame:
    """Read a result table of a campaign, such as `results/tables/impedance.csv`.

    `osl-analysis results --columns` says what each column is, and in which unit.

    Parameters
    ----------
    path : Path or str
        CSV file, or an archive of several.
    required : Sequence of str
        Columns that must exist and hold numbers, or text where they are text.
    name : str
        The table's name if `path` is an archive.

    Returns
    -------
    polars.DataFrame
        A row per trial, amplitude, frequency or group. Columns are in SI units, or that of their
        ending (`_deg`, `_hz`). One without entries is Float64 null.

    Raises
    ------
    InputError
        The table is missing, is no CSV, was refused, lacks a column, or is of another release.

    Examples
    --------
    >>> table = osl.read_table("results/tables/belt.csv", ["K_s"])
    >>> table["K_s"].round(1).to_list()
    [685.6]
    """
    path = Path(path)
    about = summary_beside(path)
    if about:
        table.check_schema(about.get(table.SCHEMA_FIELD), path, about.get("version"))
    return table.read_table(path, required, name)


def summary_beside(path: Path) -> dict[str, Any]:
    """What `summary.json` says of the results that a table is of; empty without one."""
    results = path.resolve().parent.parent  # also of "belt.csv" within results/tables
    with suppress(OSError, ValueError, TypeError):  # none is there, or it is of another program
        content: dict[str, Any] = json.loads((results / "summary.json").read_bytes())
        if "numbers" in content:
            return content
    return {}
