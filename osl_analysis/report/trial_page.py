"""The page's content on each trial: conditions, verdict, estimates, doubts, provenance."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import polars as pl

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.judge.known_findings import CHECKS
from osl_analysis.judge.recording_checks import NOT_APPLICABLE
from osl_analysis.judge.words import sentence_of
from osl_analysis.report.provenance import provenance_content
from osl_analysis.report.reported_trial import ReportedTrial
from osl_analysis.report.shown_numbers import cell_text, shown_estimate, unit_and_meaning
from osl_analysis.report.typography import printed


def trial_content(trial: ReportedTrial) -> dict[str, Any]:
    """The content of one trial's part of the page, as `templates/report.js` reads it."""
    tables = {name: table for name, table in trial.tables.items() if len(table)}
    name = next(iter(tables), "")
    fit_to_all = tables[name].row(-1, named=True) if tables else {}
    columns = []
    column_values = []
    for column, value in fit_to_all.items():
        if value not in (None, ""):
            columns.append([column, cell_text(value), *unit_and_meaning(column, name).values()])
            column_values.append([None, shown_estimate(fit_to_all, column).full[:1]])
    not_checked = []
    for worded in trial.unchecked:
        words = worded.words._replace(size="")
        not_checked.append(printed(sentence_of(words, worded.finding.cause)))
    experiment = trial.row["experiment"]
    return {
        "name": trial.name,
        "experiment": experiment,
        "description": EXPERIMENTS[experiment].description,
        "condition": trial.condition(),
        "verdict": trial.verdict,
        "left_out": [printed(reason) for reason in trial.left_out],
        "doubts": [asdict(doubt) for doubt in trial.doubts],
        "not_checked": not_checked,
        "table": name,
        "estimates": estimate_rows(tables[name], name) if tables else None,
        "columns": columns,
        "column_values": column_values,
        "quality": quality_rows(trial.quality) if trial.quality is not None else [],
        "time_base": time_base_rows(trial.tables.get("timebase", pl.DataFrame())),
        "provenance": provenance_content(trial.provenance),
        "panels": trial.pictures.panels,
        "remark": trial.pictures.remark,
    }


def time_base_rows(time_base: pl.DataFrame) -> list[list[str]]:
    """What is known of the time base of each group of signals: column, a value per group, meaning;
    the names of the signals first."""
    rows: list[list[str]] = []
    for name, values in time_base.to_dict(as_series=False).items():
        cells = [name, *map(cell_text, values)]
        if name == "signals":
            rows.insert(0, [*cells, "meaning"])
        elif name not in ("trial", "joint", "side", "data") and is_known(values):
            rows.append([*cells, unit_and_meaning(name, "timebase")["meaning"]])
    return rows


def is_known(values: Sequence[object]) -> bool:
    """Whether a column has a value in a row."""
    return any(value is not None for value in values)


def quality_rows(verdicts: pl.DataFrame) -> list[list[str]]:
    """Check, its meaning, value, threshold, verdict and remark of each row of `quality.csv` that
    applies."""
    rows = []
    for row in verdicts.iter_rows(named=True):
        if row["verdict"] == NOT_APPLICABLE:
            continue
        cells = [row["check"], CHECKS[row["check"]].meaning]
        unit = printed(row["unit"] or "")
        for name in ("value", "threshold"):
            unit_of_cell = "" if row[name] is None else unit
            cells.append(f"{cell_text(row[name])} {unit_of_cell}".strip())
        rows.append([*cells, row["verdict"], row["remark"] or ""])
    return rows


def estimate_rows(table: pl.DataFrame, of: str) -> dict[str, Any]:
    """The estimates of one trial from the table named `of`: `columns` with unit and meaning, and
    per fit texts (`rows`) and the numbers behind them (`values`)."""
    columns_of_table = table.to_dict(as_series=False)
    present = columns_of_table.keys()
    estimates = []
    for name, column in columns_of_table.items():
        if {f"{name}_low", f"{name}_high"} <= present and is_known(column):
            estimates.append(name)
    for name in ("VAF", "R2"):  # without an interval
        if name in present:
            estimates.append(name)
    has_amplitudes = "amplitude_deg" in present
    rows = []
    values = []
    for row in table.iter_rows(named=True):
        cells = []
        numbers: list[Sequence[float | None] | None] = []
        if has_amplitudes:
            amplitude = row["amplitude_deg"]
            cells.append("all" if amplitude is None else f"{amplitude:g}")
            numbers.append(None)
        for name in estimates:
            shown = shown_estimate(row, name)
            cells.append(f"{shown.text} {shown.interval}".strip())
            numbers.append(shown.full)
        rows.append(cells)
        values.append(numbers)
    names = ["amplitude_deg", *estimates] if has_amplitudes else estimates
    columns = [{"name": name, **unit_and_meaning(name, of)} for name in names]
    return {"columns": columns, "rows": rows, "values": values}
