"""Result tables from the tables of single trials, and the frequency responses of trials of one condition, pooled."""

import json
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.bench.settings import FilterSettings
from osl_analysis.errors import InputError
from osl_analysis.files import atomic_path
from osl_analysis.judge.doubts import marked, with_doubts_of
from osl_analysis.judge.table import Doubt, QualityRules
from osl_analysis.judge.usable import Judge
from osl_analysis.parameters import FileOrNone, joint_of, known_parameters
from osl_analysis.refusal import Refusal, refused_trials
from osl_analysis.spectral.realisations import Realisation, pooled, realisations_from
from osl_analysis.spectral.tables import MODELS, RESPONSE, periodic_tables
from osl_analysis.table import Places, read_table, with_places, write_table


def gather(
    rows: Sequence[Path],
    output: Path,
    limits: Doubt | None = None,
    fits: Sequence[Path] = (),
    limits_of_fits: Doubt | None = None,
    places: Places | None = None,
) -> None:
    """One table from the tables of single trials, in the order given; with `limits`, doubtful fits are marked.

    `rows` are their files, or the archives with a table of the same name as `output`. `fits` are the trials' fits of
    the table whose doubts the rows share, if any, with the limits of that table. `places` has joint and side of each
    trial, which become columns.
    """
    if not rows:
        raise InputError(f"{output}: no trials fill this table; add some to the sample sheet")
    table = pl.concat([read_table(path, of=output.stem) for path in rows], how="diagonal_relaxed")
    if limits is not None:
        table = marked(table, limits, output.stem)
    if limits_of_fits is not None and fits:
        of = pl.concat([read_table(path) for path in fits], how="diagonal_relaxed")
        table = with_doubts_of(table, of, limits_of_fits, fits[0].parent.name)
    write_table(with_places(table, places or {}), output)


def list_fits(fits: Sequence[Path], output: Path, refused: Sequence[Refusal] = ()) -> None:
    """Write which trials of an experiment were fitted, and why the others were not, as JSON.

    `fits` has one file of the results of each trial. Whatever uses the results of all of them is made again with it.
    """
    reasons = {trial: cause.reason for trial, cause in refused_trials(refused).items()}
    with atomic_path(output) as temporary:
        said = {"fitted": [path.stem for path in fits], "refused": reasons}
        temporary.write_text(json.dumps(said, indent=1) + "\n", encoding="utf-8")


CONDITION = ("joint", "side", "subject", "session", "group", "controller", "K_d", "B_d")
"""Columns of the sample sheet in which trials that are pooled agree."""
CONDITION_TYPES: dict[str, type[pl.DataType]] = {c: pl.Float64 if c in ("K_d", "B_d") else pl.String for c in CONDITION}


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
    for group in alike_groups(lines, conditions):
        names = list(group)
        every = [one for realisations in group.values() for one in realisations]
        place = [
            pl.lit(conditions[names[0]].get(column), dtype).alias(column) for column, dtype in CONDITION_TYPES.items()
        ]
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
    return {**CONDITION_TYPES, **{"trials" if name == "trial" else name: dtype for name, dtype in schema.items()}}


def alike_groups(
    lines: Sequence[Path], conditions: Mapping[str, Mapping[str, Any]]
) -> list[dict[str, list[Realisation]]]:
    """The trials of one condition with motions that are alike, each with its realisations."""
    by_condition: dict[tuple[Any, ...], dict[str, list[Realisation]]] = {}
    for path in lines:
        table = read_table(path, of="response_lines")
        if not table.is_empty():
            trial = str(table["trial"][0])
            key = tuple(conditions[trial].get(column) for column in CONDITION)
            by_condition.setdefault(key, {})[trial] = realisations_from(table)
    return [group for trials in by_condition.values() for group in pooled(trials)]


def judge(
    rows: Sequence[Path],
    rules: QualityRules,
    accept: Mapping[str, Collection[str]],
    output: Path,
    refused: Sequence[Refusal] = (),
    places: Places | None = None,
) -> None:
    """The verdict on every trial from what was measured, with a row for each that could not be measured, and why."""
    table = Judge(rules, accept).verdicts(rows)
    table = pl.concat([table, refused_rows(refused, verdict="refused")], how="diagonal_relaxed")
    write_table(with_places(table, places or {}), output)


def refused_rows(refused: Sequence[Refusal], **cells: str) -> pl.DataFrame:
    """A row per refused trial, with its outcome as check and its reason and remedy as remark; `cells` are added."""
    rows = [
        {"trial": one.trial, "check": one.outcome, "remark": f"{one.reason}; {one.remedy}", **cells}
        for one in refused_trials(refused).values()
    ]
    text, empty = pl.String(), pl.Null()
    schema = {"trial": text, "check": text, "value": empty, "unit": empty, "threshold": empty}
    return pl.DataFrame(rows, schema=schema | dict.fromkeys(cells, text) | {"remark": text})


def list_excluded(
    verdicts: Path,
    by_sheet: Mapping[str, str],
    output: Path,
    refused: Sequence[Refusal] = (),
    places: Places | None = None,
) -> None:
    """List every trial that is not used, with the reason: the failed checks that exclude it, why it was refused, or
    what the sheet says.
    """
    failed = read_table(verdicts).filter(pl.col("verdict") == "exclude").drop("verdict")
    rows = [{"trial": trial, "check": "sample sheet", "remark": reason} for trial, reason in by_sheet.items()]
    stated = pl.DataFrame(rows, schema=dict.fromkeys(("trial", "check", "remark"), pl.String))
    table = pl.concat([refused_rows(refused), failed, stated], how="diagonal_relaxed")
    write_table(with_places(table.drop("joint", "side", strict=False), places or {}), output)
