"""The page of a run: one HTML file with numbers, findings, trials, figures and captions."""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import polars as pl
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.judge.finding import Grade, WordedFinding
from osl_analysis.judge.summary_findings import CampaignFinding
from osl_analysis.report.left_out import LeftOut
from osl_analysis.report.numbers import Number
from osl_analysis.report.rounding import written

TEMPLATES = Path(__file__).with_name("templates")
NO_CONDITIONS = ("trial", "experiment", "log", "log_source", "mocap", "mocap_source", "exclude")


@dataclass(frozen=True)
class ShownFigure:
    """A figure of the page."""

    name: str
    title: str
    caption: str
    reading: str  # how to read it
    svg: bytes

    @property
    def source(self) -> str:
        """The drawing as the address of an image."""
        return f"data:image/svg+xml;base64,{b64encode(self.svg).decode()}"


@dataclass(frozen=True, kw_only=True)
class Page:
    """What `page.html.j2` shows; each table is a frame of texts."""

    title: str
    made_of: str
    intervals: str
    numbers: Sequence[Number]
    findings: Sequence[CampaignFinding]
    tables: Mapping[str, pd.DataFrame]  # by heading
    figures: Sequence[ShownFigure]
    absent_figures: Mapping[str, str]  # why others are not drawn


def written_page(page: Page) -> str:
    """The HTML of a page."""
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES), autoescape=True, undefined=StrictUndefined
    )
    return environment.get_template("page.html.j2").render(page=page)


def trials_table(
    sheet: Mapping[str, Mapping[str, Any]],
    tables: Mapping[str, pl.DataFrame],
    findings: Sequence[WordedFinding],
    left_out: Mapping[str, LeftOut],
) -> pd.DataFrame:
    """A row per trial of the sheet: condition, verdict with its causes, and estimates."""
    by_trial: dict[str, list[WordedFinding]] = {}
    for worded in findings:
        by_trial.setdefault(worded.finding.subject, []).append(worded)
    rows = []
    for name, cells in sheet.items():
        experiment = EXPERIMENTS[cells["experiment"]]
        main = experiment.tables[0].name if experiment.tables else ""
        row = {"trial": name, "experiment": cells["experiment"], "condition": condition(cells)}
        row |= verdict(main, by_trial.get(name, []), left_out.get(name))
        fits = tables.get(main, pl.DataFrame(schema=["trial"])).filter(trial=name)
        if len(fits):
            fit = fits.row(-1, named=True)
            for symbol, column in zip(("K", "B", "I"), experiment.impedance, strict=True):
                value = fit.get(column)
                if value is not None:
                    low, high = fit.get(f"{column}_low"), fit.get(f"{column}_high")
                    row[symbol] = written(value, low, high)
        rows.append(row)
    return pd.DataFrame(rows).fillna("–")


def condition(cells: Mapping[str, Any]) -> str:
    """What the sheet states of a trial."""
    return ", ".join(
        f"{name} {value}"
        for name, value in cells.items()
        if value is not None and name not in NO_CONDITIONS
    )


def verdict(
    table: str, findings: Sequence[WordedFinding], left_out: LeftOut | None
) -> dict[str, str]:
    """The verdict on a trial by its findings, with their causes; `table` is that of its fit."""
    if left_out is not None:
        return {"verdict": "left out", "why": "; ".join(left_out.reasons)}
    doubts = [worded.finding for worded in findings if worded.finding.grade is Grade.DOUBTS]
    whole = [doubt for doubt in doubts if doubt.table == table and not doubt.is_of_part]
    causes = ", ".join(dict.fromkeys(doubt.cause for doubt in whole or doubts))
    if whole:
        return {"verdict": "doubtful", "why": causes}
    return {"verdict": "doubtful in part" if doubts else "clear", "why": causes}
