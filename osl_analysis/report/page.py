# SPDX-License-Identifier: Apache-2.0
"""The page of a run: one HTML file with verdict, conditions, findings, figures and a view of each
trial, which opens without a network."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import polars as pl
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.config.sheet import RECORDINGS, SOURCES
from osl_analysis.dictionary.described import described_tables_by_name
from osl_analysis.judge.campaign import CampaignFinding
from osl_analysis.judge.finding import Grade, WordedFinding
from osl_analysis.judge.judging import fit_of, rows_by_fit
from osl_analysis.judge.known_findings import known_finding
from osl_analysis.report.numbers import Number
from osl_analysis.report.paper_tables import Condition, estimate_text, stated_text
from osl_analysis.report.signals import Signals
from osl_analysis.report.typography import printed
from osl_analysis.report.verdicts import LeftOut, results_on, verdict_on
from osl_analysis.stats.budget import IN_INTERVAL, budgets_in
from osl_analysis.stats.rounding import WithInterval, plus_minus

TEMPLATES = Path(__file__).with_name("templates")
NO_CONDITIONS = ("trial", "experiment", "exclude", *RECORDINGS, *SOURCES)
# between dollar signs, or with a subscript and no part of a name
SYMBOLS = re.compile(
    r"(?<!\\)\$(.+?)(?<!\\)\$|(?<![\w-])([KBJZknf]_(?:viscous|tau|d_rendered|[dsjm1CGT]))(?![\w-])"
)


@dataclass(frozen=True)
class ShownFigure:
    """A figure of the page."""

    name: str
    title: str
    caption: Sequence[str]  # sentences: what it shows, and how to read it
    svg: str

    @property
    def drawing(self) -> Markup:
        """The drawing as part of a page, whose names are no other figure's, and whose points lead
        to their trials."""
        svg = self.svg[self.svg.index("<svg") :]
        svg = re.sub(r'(\bid="|href="#|url\(#)', rf"\1{self.name}-", svg)
        svg = svg.replace('"../report.html#', '"#')
        return Markup(svg.replace("<svg", f'<svg role="img" aria-label="{self.title}"', 1))


@dataclass(frozen=True)
class ShownBudget:
    """An estimate with its verdict, and the parts of its interval as a bar."""

    name: str
    text: str
    verdict: str
    parts: Mapping[str, float]  # shares of the squares of its half-widths [percent], by part
    not_known: str  # what nobody has checked would change


@dataclass(frozen=True, kw_only=True)
class TrialView:
    """What the page shows of one trial."""

    name: str
    experiment: str
    condition: str  # what the sheet states
    recordings: str
    verdict: str
    left_out: Sequence[str]  # why it has no result
    doubts: Sequence[WordedFinding]  # about its recording or the fit to all of it
    doubts_of_parts: Sequence[WordedFinding]
    results: Sequence[WordedFinding]  # why its device is not of second order
    remarks: Sequence[WordedFinding]  # others, and what was not checked
    impedance: Mapping[str, str]  # K, B and I of the fit to all of it
    estimates: Sequence[Sequence[str]]  # a row per fit; heads first
    budgets: Sequence["ShownBudget"]  # of the fit to all of it
    checks: Sequence[Mapping[str, Any]]  # of its recording
    signals: Signals | None = None

    @property
    def why(self) -> str:
        """The causes of its verdict in a few words, or what is to be known of its device."""
        worst = self.doubts or self.doubts_of_parts or self.results
        causes = [worded.finding.cause for worded in worst]
        return ", ".join(dict.fromkeys(causes)) or "; ".join(self.left_out)


@dataclass(frozen=True, kw_only=True)
class Page:
    """What `page.html.j2` shows."""

    about: Mapping[str, str]
    made_of: str
    answer: str  # the sentence that it begins with
    sentences: Sequence[str]  # further ones
    notes: Sequence[str]  # on intervals, settings that nobody stated, recordings without a row
    conditions: Sequence[Condition]
    groups: Sequence[Condition]
    numbers: Sequence[Number]
    findings: Sequence[CampaignFinding]
    trials: Sequence[TrialView]
    figures: Sequence[ShownFigure]
    absent_figures: Mapping[str, str]  # why others are not drawn
    missing_results: Mapping[str, str]


def written_page(page: Page) -> str:
    """The HTML of a page."""
    # it imports Bokeh, which takes longer than all else of a dry run's imports (0.3 s)
    from osl_analysis.report import plots

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    # models of Bokeh are read in the order in which they refer to each other
    environment.policies["json.dumps_kwargs"] = {"sort_keys": False}
    environment.filters["printed"] = lambda text: with_symbols(printed(text))
    environment.filters["plus_minus"] = lambda text: (
        plus_minus(*text.parts) if isinstance(text, WithInterval) else text
    )
    signals = {trial.name: trial.signals.packed() for trial in page.trials if trial.signals}
    return environment.get_template("page.html.j2").render(
        page=page,
        experiments=EXPERIMENTS,
        signals=signals,
        plots=plots.plots(),
        library=Markup(plots.library()),
    )


def with_symbols(text: str) -> Markup:
    """A text whose symbols, as `K_d` and `$\\hat{K}$`, are set in HTML; a dollar sign behind a
    backslash is one."""

    def symbol(match: re.Match[str]) -> str:
        letters = re.sub(r"\\hat\{(\w)\}", "\\1\u0302", match[1] or match[2])
        letters = re.sub(r"\\\w+\{(\w+)\}", r"\1", letters)
        letters = re.sub(r"_\{?([A-Za-z0-9]+)\}?", r"<sub>\1</sub>", letters)
        return f"<i>{re.sub(r'[{}^]', '', letters).replace('tau', 'τ')}</i>"

    in_html = SYMBOLS.sub(symbol, str(escape(text)))
    return Markup(in_html.replace("\\$", "$"))


def trial_view(
    row: Mapping[str, Any],
    tables: Mapping[str, pl.DataFrame],
    findings: Sequence[WordedFinding],
    left_out: LeftOut | None,
    checks: Sequence[Mapping[str, Any]],
    signals: Signals | None,
) -> TrialView:
    """What the page shows of a trial.

    Parameters
    ----------
    row : Mapping
        Its row of the sample sheet.
    tables : Mapping of str to polars.DataFrame
        Its rows of each result table.
    findings : Sequence of WordedFinding
        Those on it.
    left_out : LeftOut or None
        Why it has no result.
    checks : Sequence of Mapping
        Its rows of `quality.csv`.
    signals : Signals or None
        What is plotted of it.
    """
    experiment = row["experiment"]
    facts = EXPERIMENTS[experiment]
    main = facts.tables[0].name if facts.tables else ""
    fits = tables.get(main, pl.DataFrame())

    of_whole = [worded for worded in findings if not worded.finding.is_of_part]
    doubts = [worded for worded in findings if worded.finding.grade is Grade.DOUBTS]
    results = results_on(findings)
    notes = [w for w in of_whole if w.finding.grade in (Grade.UNCHECKED, Grade.NOTES)]
    last = fits.row(-1, named=True) if len(fits) else {}
    names = zip(("K", "B", "I"), facts.impedance, strict=True)
    return TrialView(
        name=row["trial"],
        experiment=experiment,
        condition=condition_text(row),
        recordings=", ".join(str(row[name]) for name in RECORDINGS if row.get(name)),
        verdict=verdict_on(experiment, findings, left_out),
        left_out=left_out.reasons if left_out else (),
        doubts=[worded for worded in doubts if worded in of_whole],
        doubts_of_parts=[worded for worded in doubts if worded not in of_whole],
        results=results,
        remarks=[worded for worded in notes if worded not in results],
        impedance={symbol: estimate_text(last, name) for symbol, name in names},
        estimates=estimate_rows(fits, main) if len(fits) else (),
        budgets=shown_budgets(last, tables.get("budget")),
        checks=checks,
        signals=signals,
    )


def shown_budgets(row: Mapping[str, Any], budget: pl.DataFrame | None) -> list[ShownBudget]:
    """The budgets of the estimates of the fit to all of a trial."""
    shown = []
    for name, of_name in budgets_in(rows_by_fit(budget).get(fit_of(row), ()), row).items():
        squares = {part: of_name.half_width(part) ** 2 for part in IN_INTERVAL}
        total = sum(squares.values()) or 1.0
        shown.append(
            ShownBudget(
                name=name,
                text=estimate_text(row, name),
                verdict=row.get(f"{name}_verdict") or "",
                parts={part: 100 * square / total for part, square in squares.items()},
                not_known="; ".join(
                    f"{known_finding(each.source).title.replace('_', ' ')}: {each.per}"
                    for each in of_name.unknown
                    if each.per
                ),
            )
        )
    return shown


def condition_text(row: Mapping[str, Any]) -> str:
    """What the sheet states of a trial."""
    texts = []
    for name, value in row.items():
        if name == "perturbed" and value is not None:
            texts.append("perturbed" if value else "unperturbed")
        elif value is not None and name not in NO_CONDITIONS:
            texts.append(f"{name} {stated_text(value)}")
    return ", ".join(texts)


def estimate_rows(fits: pl.DataFrame, table: str) -> list[list[str]]:
    """The estimates of a trial with their intervals, a row per fit; the heads have the units."""
    described = described_tables_by_name()[table].columns
    known = [name for name in fits.columns if fits[name].count()]
    names = [name for name in known if name == "VAF" or f"{name}_low" in fits.columns]
    rows = [["amplitude [deg]", *(f"{name} [{described[name].unit}]" for name in names)]]
    for fit in fits.iter_rows(named=True):
        amplitude = fit.get("amplitude_deg")
        of_fit = [estimate_text(fit, name, described[name].unit) for name in names]
        rows.append(["all" if amplitude is None else f"{amplitude:.3g}", *of_fit])
    return rows
