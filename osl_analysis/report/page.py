"""The page itself: one HTML file with packed signals, figures and captions. It needs no other file
and no network."""

import hashlib
import json
import math
from base64 import b64encode
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import polars as pl
from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.dictionary import apparent_inertia
from osl_analysis.judge.finding import UNITS_OF_ESTIMATES, Grade
from osl_analysis.judge.summary_findings import CampaignFinding, findings_in_summary
from osl_analysis.refusal import Refusal
from osl_analysis.report import BOKEH, TEMPLATES
from osl_analysis.report.condition_rows import ConditionRow
from osl_analysis.report.headline import (
    Headline,
    HeadlineLabel,
    HeadlineValue,
    headlines_in_summary,
)
from osl_analysis.report.headline_text import NumberTexts, first_sentences, number_texts
from osl_analysis.report.methods import MethodsText
from osl_analysis.report.packed_tables import deflated, every_kth, packed_table
from osl_analysis.report.page_figures import ShownFigure
from osl_analysis.report.page_text import WALKING_GROUPS, joints_of, verdicts_text, what_was_done
from osl_analysis.report.reported_trial import ReportedTrial
from osl_analysis.report.trial_table import TrialTable
from osl_analysis.report.typography import printed

FIRST_FIGURES = ("fig5", "walking_page", "torque_angle", "response", "fig3")
"""The first of these figures that the campaign has is on the first screen; Fig. 5 only if an
impedance was desired."""

BOKEH_VERSION = "3.9.2"  # of the files in `bokeh`, which draw plots
BOKEH_SCRIPTS = ("bokeh.min.js", "bokeh-api.min.js")
SCRIPTS = ("elements.js", "tables.js", "readings.js", "loops.js", "report.js")
"""The page's own scripts, in the order in which they are one."""
TRIALS_WITH_ALL_SAMPLES = 150  # of more, fewer: so that a page of 1,000 opens in 2 s


@dataclass(frozen=True, kw_only=True)
class Report:
    """What `report.html.j2` shows of a campaign.

    Attributes
    ----------
    about, made_of
        What the numbers are made of, as facts and in a sentence.
    overview
        The first screen.
    trials
        The table of trials, and which are left out.
    conditions
        K, B and I of each condition.
    claims
        The paper's claims.
    methods
        The text of a methods section.
    equation
        Which equation is fitted, and how, in a few sentences.
    assumed
        Which settings nobody stated.
    intervals
        What the intervals contain.
    unnamed
        Tells recordings without a row; empty for none.
    sensitivity
        Rows of `walking_sensitivity.csv`.
    absent_figures
        By title, why a figure is not drawn.
    not_made
        Results that were refused.
    """

    about: Mapping[str, str]
    made_of: str
    overview: "Overview"
    trials: TrialTable
    conditions: Sequence[ConditionRow]
    claims: Sequence["ShownClaim"]
    methods: MethodsText
    equation: str
    assumed: str
    intervals: str
    unnamed: str
    sensitivity: Sequence[Mapping[str, Any]]
    absent_figures: Mapping[str, str]
    not_made: Sequence[Refusal]


TablesOfTrial = Mapping[str, pl.DataFrame]
"""What the panels of one trial draw, by name."""


def written_page(
    report: Report, trials: Mapping[str, tuple[Mapping[str, Any], TablesOfTrial]]
) -> str:
    """The HTML of a report, with the content and the tables of each trial."""
    bokeh_parts = [(BOKEH / name).read_text(encoding="utf-8") for name in BOKEH_SCRIPTS]
    bokeh_js = "\n".join([*bokeh_parts, 'Bokeh.set_log_level("warn");'])
    report_js = "\n".join((TEMPLATES / name).read_text(encoding="utf-8") for name in SCRIPTS)
    style = (TEMPLATES / "report.css").read_text(encoding="utf-8")
    every = max(math.ceil(len(trials) / TRIALS_WITH_ALL_SAMPLES), 1)
    packed = {}
    for name, (content_of_trial, tables) in trials.items():
        packed[name] = packed_trial(content_of_trial, tables, every)
    return template("report.html.j2").render(
        report=report,
        experiments={name: facts.description for name, facts in EXPERIMENTS.items()},
        apparent_inertia=apparent_inertia(),
        bokeh_version=BOKEH_VERSION,
        policy=policy_of(bokeh_js, report_js),
        bokeh_js=Markup(bokeh_js),
        report_js=Markup(report_js),
        style=Markup(style),
        packed=packed,
        every=every,
    )


def policy_of(*scripts: str) -> str:
    """The content security policy: nothing is loaded, and no script runs but these, by their
    hashes."""
    hashes = []
    for script in scripts:
        digest = hashlib.sha256(script.encode()).digest()
        hashes.append(f"'sha256-{b64encode(digest).decode()}'")
    return (
        f"default-src 'none'; script-src {' '.join(hashes)}; style-src 'unsafe-inline'; img-src"
        " data: blob:; font-src data:; base-uri 'none'; form-action 'none'"
    )


def packed_trial(
    content: Mapping[str, Any], tables: Mapping[str, pl.DataFrame], every: int
) -> Markup:
    """What the page shows of one trial, with every k-th row of its tables."""
    text = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    packed = {name: packed_table(every_kth(table, every)) for name, table in tables.items()}
    packed_content = json.dumps(
        {"content": deflated(text.encode()), "tables": packed}, allow_nan=False
    )
    # it cannot end the script element that holds it
    return Markup(packed_content.replace("<", "\\u003c"))


@dataclass(frozen=True)
class ChecksOfExperiment:
    """A part of the map of trials and causes. Each row has all trials, sorted by condition."""

    experiment: str
    trials: Sequence[tuple[str, str]]  # name and verdict
    rows: Sequence[tuple[str, Sequence[tuple[str, str]]]]
    """Of each cause that a trial does not pass, or that could not be checked on it: name and state
    of every trial."""


def check_map(
    trials: Sequence[ReportedTrial], findings: Sequence[CampaignFinding] = ()
) -> list[ChecksOfExperiment]:
    """The map of trials and causes. A finding on a walking group, of the campaign's `findings`,
    counts for each of its trials."""
    by_experiment: dict[str, list[ReportedTrial]] = {}
    for trial in trials:
        by_experiment.setdefault(trial.row["experiment"], []).append(trial)
    maps = []
    for experiment, of_experiment in by_experiment.items():
        ordered = sorted(of_experiment, key=by_condition)
        states_of_cause: dict[str, dict[str, str]] = {}
        for trial in ordered:
            for cause, state in states_in(trial, findings):
                states_of_cause.setdefault(cause, {}).setdefault(trial.name, state)
        rows = []
        for cause, states in states_of_cause.items():
            rows.append(
                (cause, [(trial.name, states.get(trial.name, "passed")) for trial in ordered])
            )
        verdicts = [(trial.name, trial.verdict) for trial in ordered]
        maps.append(ChecksOfExperiment(experiment, verdicts, rows))
    return maps


def by_condition(trial: ReportedTrial) -> list[Any]:
    """The order of trials: controller, K_d, B_d."""
    row = trial.row
    return [str(row.get("controller")), row.get("K_d") or 0.0, row.get("B_d") or 0.0]


def states_in(
    trial: ReportedTrial, findings: Sequence[CampaignFinding]
) -> Iterator[tuple[str, str]]:
    """Each cause of a trial with its state; of several states of a cause the first counts."""
    for doubt in trial.doubts_worst_first:
        yield doubt.cause, doubt.verdict
    for worded in trial.unchecked:
        is_remark = worded.finding.grade is Grade.NOTES
        yield worded.finding.cause, "remark" if is_remark else "not checked"
    if "group" not in trial.main.columns:
        return
    groups = {*trial.main["group"]}
    for finding in findings:
        if finding.subject == WALKING_GROUPS and groups & {*finding.trials}:
            yield finding.cause, finding.verdict


@dataclass(frozen=True)
class ShownClaim:
    """A claim of the paper's text with the number that decides on it."""

    claim: str
    where: str  # joint and side; empty for all
    quantity: str
    estimate: HeadlineValue
    texts: NumberTexts
    limit: str
    verdict: str


def claim_rows(claims: pl.DataFrame) -> list[ShownClaim]:
    """The claims on the campaign, of the rows of `claims.csv`."""
    shown = []
    for row in claims.filter(pl.col("subject").is_null()).drop_nulls("verdict").to_dicts():
        n = int(row["n"] or 0)
        estimate = HeadlineValue(row["value"], row["low"], row["high"], row["interval"], n)
        margin = "" if row["margin"] is None else f" ± {row['margin']:g}"
        shown.append(
            ShownClaim(
                claim=row["claim"],
                where=", ".join(filter(None, [row["joint"], row["side"]])),
                quantity=row["quantity"],
                estimate=estimate,
                texts=number_texts(estimate, row["unit"]),
                limit=" ".join(
                    filter(None, [row["wanted"], f"{row['target']:g}{margin}", row["unit"]])
                ),
                verdict=row["verdict"],
            )
        )
    return shown


@dataclass(frozen=True)
class ShownNumber:
    """A headline number on the page."""

    label: HeadlineLabel
    estimate: HeadlineValue
    texts: NumberTexts


def size_in_results(finding: CampaignFinding) -> tuple[float, ...]:
    """By how much a finding changes K, B and I at worst, in their units; 0 where that is unknown.
    Findings are compared by K first, then by B, then by I."""
    return tuple(abs(finding.numbers.get(f"{symbol}_size", 0.0)) for symbol in UNITS_OF_ESTIMATES)


def changes_text(finding: CampaignFinding) -> str:
    """`size_in_results` for a reader; empty if nothing is known of it."""
    texts = []
    sizes = zip(UNITS_OF_ESTIMATES.items(), size_in_results(finding), strict=True)
    for (symbol, unit), size in sizes:
        if size:
            texts.append(f"{symbol} by up to {size:.2g} {unit}")
    return ", ".join(texts)


def shown_number(number: Headline) -> ShownNumber:
    texts = number_texts(number.estimate, number.label.unit)
    return ShownNumber(number.label, number.estimate, texts)


@dataclass(frozen=True)
class ShownFinding:
    """A finding on the first screen."""

    finding: CampaignFinding
    trials: Sequence[tuple[str, str]]  # the names of those on the page, and how large it is there
    changes: str  # by how much it changes K, B and I; empty: unknown


@dataclass(frozen=True)
class Overview:
    """The first screen of the page.

    Attributes
    ----------
    joints
        With their sides; empty where nobody states them.
    what_was_done
        The campaign in a sentence.
    answers
        A sentence per quantity that is asked for first.
    verdicts
        How many trials are doubtful or not used, and why.
    checks
        The map of trials and causes.
    numbers, findings
        Those of the summary; findings by what they change, the largest first.
    main_figures, further_figures
        The figure of the first screen, if there is one, and all others.
    """

    joints: str
    what_was_done: str
    answers: Sequence[str]
    verdicts: str
    checks: Sequence[ChecksOfExperiment]
    numbers: Sequence[ShownNumber]
    findings: Sequence[ShownFinding]
    main_figures: Sequence[ShownFigure]
    further_figures: Sequence[ShownFigure]


def overview(
    trials: Sequence[ReportedTrial],
    summary: Mapping[str, Any],
    figures: Sequence[ShownFigure],
    about: Mapping[str, str],
) -> Overview:
    """Gather the first screen from trials, the content of `summary.json`, and figures."""
    findings = findings_in_summary(summary)
    numbers = headlines_in_summary(summary).values()
    size_of_trial = sizes_by_cause_and_trial(trials)
    names_of_trials = {trial.name for trial in trials}
    shown_findings = []
    for finding in sorted(findings, key=size_in_results, reverse=True):
        of_trials = []
        for name in finding.trials:
            if name in names_of_trials:
                of_trials.append((name, size_of_trial.get((finding.cause, name), "")))
        shown_findings.append(ShownFinding(finding, of_trials, changes_text(finding)))
    main_figure = first_figure(trials, [figure.name for figure in figures])
    return Overview(
        joints=joints_of(trials),
        what_was_done=what_was_done(trials, about),
        answers=first_sentences(numbers),
        verdicts=verdicts_text(trials, findings),
        checks=check_map(trials, findings),
        numbers=[shown_number(number) for number in numbers],
        findings=shown_findings,
        main_figures=[figure for figure in figures if figure.name == main_figure],
        further_figures=[figure for figure in figures if figure.name != main_figure],
    )


def sizes_by_cause_and_trial(trials: Sequence[ReportedTrial]) -> dict[tuple[str, str], str]:
    """How large each finding on a trial is; of several, that of the whole trial rather than that of
    a part."""
    sizes: dict[tuple[str, str], str] = {}
    findings = [worded for trial in trials for worded in trial.findings]
    for worded in sorted(findings, key=lambda worded: not worded.finding.is_of_part):
        sizes[worded.finding.cause, worded.finding.subject] = worded.words.size
    return sizes


def first_figure(trials: Sequence[ReportedTrial], names: Sequence[str]) -> str:
    """The figure of the first screen, of those that the campaign has; empty without one."""
    is_desired = False
    for trial in trials:
        if trial.row.get("controller") is not None or trial.row.get("K_d") is not None:
            is_desired = True
    preferred = FIRST_FIGURES if is_desired else FIRST_FIGURES[1:]
    candidates: Sequence[str] = (*preferred, *names)
    for name in candidates:
        if name in names:
            return name
    return ""


@cache
def template(name: str) -> Template:
    """A template of this package, by its file's name."""
    loader = FileSystemLoader(TEMPLATES)
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    environment.filters["printed"] = printed
    return environment.get_template(name)
