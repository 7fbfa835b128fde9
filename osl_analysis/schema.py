"""The version of the columns of result tables and of stored trials. They state it, and readers
check it."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis import table
from osl_analysis.errors import InputError

SCHEMA = 2  # of names, units and types of columns; CONTRIBUTING.md says when it is raised
SCHEMA_FIELD = "tables_schema"  # of `summary.json`


def check_schema(stated: object, path: Path, release: object = None) -> None:
    """Refuse results with columns of another schema than that of this release.

    Parameters
    ----------
    stated : object
        What the file has; None where it has none.
    path : Path
        The file, for the message.
    release : object
        Version of osl-analysis that wrote it; None: not known.

    Raises
    ------
    InputError
        It is older or newer, so that columns may mean something else.
    """
    if stated == SCHEMA:
        return
    raise InputError(
        f"{path}: columns of schema {stated}, by release {release or '(not stated)'}; this release"
        f" reads {SCHEMA}: make it again (`osl-analysis run`), or install that release"
    )


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
        check_schema(about.get(SCHEMA_FIELD), path, about.get("version"))
    return table.read_table(path, required, name)


def summary_beside(path: Path) -> dict[str, Any]:
    """What `summary.json` says of the results that a table is of; empty without one."""
    try:
        results = path.resolve().parent.parent  # also of "belt.csv" within results/tables
        content = json.loads((results / "summary.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    is_summary = isinstance(content, dict) and "numbers" in content
    return content if is_summary else {}
