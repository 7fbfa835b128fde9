"""Jobs of the frequency response: realisations of one condition in several trials are pooled; the figure's numbers."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.bench.settings import FilterSettings
from osl_analysis.figures.response import points
from osl_analysis.parameters import FileOrNone, joint_of, known_parameters
from osl_analysis.spectral.realisations import Realisation, pooled, realisations_from
from osl_analysis.spectral.tables import MODELS, RESPONSE, periodic_tables
from osl_analysis.table import read_table, write_table

CONDITION = ("joint", "side", "subject", "session", "group", "controller", "K_d", "B_d")
"""Columns of the sample sheet in which trials that are pooled agree."""
PLACE: dict[str, type[pl.DataType]] = {c: pl.Float64 if c in ("K_d", "B_d") else pl.String for c in CONDITION}


def pool_responses(
    lines: Sequence[Path],
    conditions: Mapping[str, Mapping[str, Any]],
    settings: FilterSettings,
    response_pooled: Path,
    response_models_pooled: Path,
    parameters: FileOrNone = None,
) -> None:
    """Write the response of all realisations of each condition, and the structures fitted to it.

    `lines` are the files of the periods' lines of single trials; `conditions` are the rows of the sheet by trial.
    Conditions with a single trial have no rows, nor have trials whose motions differ in more than phases.
    """
    p, of_joint = known_parameters(parameters), joint_of(parameters) if parameters else None
    made: dict[str, list[pl.DataFrame]] = {"response": [], "response_models": []}
    for group in groups_of(lines, conditions):
        names = list(group)
        every = [one for realisations in group.values() for one in realisations]
        place = [pl.lit(conditions[names[0]].get(column), dtype).alias(column) for column, dtype in PLACE.items()]
        device = p if conditions[names[0]].get("joint") == of_joint else None
        frames = periodic_tables(", ".join(names), every, settings.low_pass, device).frames()
        for name, pools in made.items():
            pools.append(frames[name].rename({"trial": "trials"}).select(*place, pl.all()))
    for name, schema, path in (
        ("response", RESPONSE, response_pooled),
        ("response_models", MODELS, response_models_pooled),
    ):
        write_table(pl.concat([pl.DataFrame(schema=pooled_schema(schema)), *made[name]]), path)


def pooled_schema(schema: Mapping[str, type[pl.DataType]] = RESPONSE) -> dict[str, type[pl.DataType]]:
    """The columns of a pooled table: the condition, and `trials` in place of `trial`."""
    return {**PLACE, **{"trials" if name == "trial" else name: dtype for name, dtype in schema.items()}}


def groups_of(lines: Sequence[Path], conditions: Mapping[str, Mapping[str, Any]]) -> list[dict[str, list[Realisation]]]:
    """The trials of one condition with motions that are alike, each with its realisations."""
    by_condition: dict[tuple[Any, ...], dict[str, list[Realisation]]] = {}
    for path in lines:
        table = read_table(path, of="response_lines")
        if not table.is_empty():
            trial = str(table["trial"][0])
            key = tuple(conditions[trial].get(column) for column in CONDITION)
            by_condition.setdefault(key, {})[trial] = realisations_from(table)
    return [group for trials in by_condition.values() for group in pooled(trials)]


def plotted_numbers(table: Path, pooled_table: Path, output: Path) -> None:
    """The numbers of the figure `response`: pooled conditions, and the trials that are in none."""
    write_table(points(read_table(table), read_table(pooled_table)), output)
