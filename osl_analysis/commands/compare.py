# SPDX-License-Identifier: Apache-2.0
"""The comparison of two campaigns: headline numbers and conditions side by side, the settings that
differ, and whether both hold the same recordings."""

import math
from collections.abc import Mapping, Sequence
from os.path import realpath
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.base.errors import InputError
from osl_analysis.base.table import write_table
from osl_analysis.campaign.origin import sentence
from osl_analysis.commands.tables import read_summary
from osl_analysis.report.numbers import MOST_CONDITIONS, Number, first_of, numbers_in_summary
from osl_analysis.report.typography import aligned
from osl_analysis.stats.repeats import RANGE
from osl_analysis.stats.rounding import written

COLUMNS = {
    **dict.fromkeys(("quantity", "meaning", "unit"), pl.String),
    **dict.fromkeys(("A", "A_low", "A_high", "B", "B_low", "B_high"), pl.Float64),
    **dict.fromkeys(("difference", "difference_low", "difference_high"), pl.Float64),
}
"""Those of `comparison.csv`."""


def compare_campaigns(folders: Sequence[Path], output: Path) -> tuple[pl.DataFrame, str]:
    """Compare the results of two campaigns.

    Parameters
    ----------
    folders : Sequence of Path
        The folders of the results of A and of B.
    output : Path
        Folder for `comparison.csv`.

    Returns
    -------
    table : polars.DataFrame
        The rows of `comparison.csv`.
    text : str
        What to print.

    Raises
    ------
    InputError
        Both are one folder, one has no summary or one of another release, or they have no number
        in common.
    """
    if realpath(folders[0]) == realpath(folders[1]):
        raise InputError(
            f"{folders[1]}: A and B are the same folder", "name the results of another campaign"
        )
    a, b = (read_summary(folder / "summary.json") for folder in folders)
    recordings_of_a, recordings_of_b = ({*each["trace"]["recordings"].values()} for each in (a, b))
    shared = recordings_of_a & recordings_of_b
    numbers_of_a = compared_numbers(a)
    numbers_of_b = compared_numbers(b)
    rows = []
    cells = []
    for name, of_a in numbers_of_a.items():
        if name not in numbers_of_b:
            continue
        of_b = numbers_of_b[name]
        row = compared(of_a, of_b, not shared)
        rows.append(row)
        if shared and of_a.texts == of_b.texts:
            continue
        ends = row.get("difference_low"), row.get("difference_high")
        difference = written(row["difference"], *ends)
        cells.append([of_a.meaning, of_a.text, of_b.text, difference, of_a.unit])
    if not rows:
        raise InputError(
            f"{folders[0]} and {folders[1]}: nothing to compare, they have no quantity of the"
            " same controller and condition",
            "run both to their end, or state K_d and B_d in both sheets",
        )
    table = pl.DataFrame(rows, schema=COLUMNS)
    path = output / "comparison.csv"
    write_table(table, path, " and ".join(dict.fromkeys([a["data"], b["data"]])))
    lines = [f"A, {folders[0]}: {sentence(a)}", f"B, {folders[1]}: {sentence(b)}"]
    lines += differing_settings(a["settings"], b["settings"])
    lines += without_counterpart("A", numbers_of_a, numbers_of_b)
    lines += without_counterpart("B", numbers_of_b, numbers_of_a)
    if shared:
        which = "the same" if recordings_of_a == recordings_of_b else f"{len(shared)} common"
        alike = len(rows) - len(cells)
        lines.append(
            f"A and B hold {which} recordings, so that a difference comes from settings, sheet or"
            f" release, and has no interval; equal, and not listed: {alike} of {len(rows)} numbers"
        )
    shown = aligned([["quantity", "A", "B", "B - A", "unit"], *cells])
    return table, "\n".join([*lines, "", shown, f"wrote {path}"])


def compared(a: Number, b: Number, are_independent: bool = True) -> dict[str, Any]:
    """A number of both campaigns and B - A, whose half-width is the root of the sum of squares of
    both half-widths, of recordings that are independent. Without two intervals it has none: the
    range of trials is none."""
    difference = b.value - a.value
    row = {"quantity": a.name, "meaning": a.meaning, "unit": a.unit, "difference": difference}
    halves = []
    for name, number in (("A", a), ("B", b)):
        row.update({name: number.value, f"{name}_low": number.low, f"{name}_high": number.high})
        if number.low is not None and number.high is not None and number.kind != RANGE:
            halves.append((number.high - number.low) / 2)
    if are_independent and len(halves) == 2:
        half = math.hypot(*halves)
        row.update(difference_low=difference - half, difference_high=difference + half)
    return row


def compared_numbers(summary: Mapping[str, Any]) -> dict[str, Number]:
    """The numbers of a campaign by name, without claims, which have texts and limits of their
    own."""
    return {number.name: number for number in numbers_in_summary(summary) if not number.verdict}


def without_counterpart(
    campaign: str, own: Mapping[str, Number], others: Mapping[str, Number]
) -> list[str]:
    """A line on the conditions and groups of numbers that a campaign alone has, or else on what
    the numbers are; none without one."""
    alone = [number for name, number in own.items() if name not in others]
    told = [*dict.fromkeys(number.subject or number.meaning for number in alone)]
    if not told:
        return []
    return [f"in {campaign} alone, so not compared: {'; '.join(first_of(told, MOST_CONDITIONS))}"]


def differing_settings(a: Mapping[str, str], b: Mapping[str, str]) -> list[str]:
    """A line per setting that differs."""
    names = sorted(name for name in {*a, *b} if a.get(name) != b.get(name))
    if not names:
        return ["all settings are the same"]
    return [f"{name}: {a.get(name, 'none')} in A, {b.get(name, 'none')} in B" for name in names]
