"""The report of a run, and the comparison of two: reads what the runs wrote, and writes one
page."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from os.path import realpath
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.campaign.origin import sentence
from osl_analysis.commands.figure import UNDRAWN, draw_figure
from osl_analysis.commands.tables import read_summary
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.dictionary import described_tables
from osl_analysis.errors import InputError
from osl_analysis.figures import FIGURES
from osl_analysis.figures.names import figure_title
from osl_analysis.files import atomic_path, write_text
from osl_analysis.judge.finding import WordedFinding, read_findings
from osl_analysis.judge.summary_findings import findings_in_summary
from osl_analysis.judge.two_campaigns import (
    COMPARED_QUANTITIES,
    comparison_table,
    label_of,
    verdicts_in_words,
)
from osl_analysis.refusal import Refusal, is_refused
from osl_analysis.report import page, panels
from osl_analysis.report.brief import findings_lines
from osl_analysis.report.condition_rows import condition_rows
from osl_analysis.report.decimal_places import digits_of, fixed
from osl_analysis.report.headline_text import aligned
from osl_analysis.report.left_out import LeftOut, left_out_trials
from osl_analysis.report.methods import methods_content, methods_text
from osl_analysis.report.page import Report, written_page
from osl_analysis.report.page_figures import ShownFigure, captions_by_title, inline_svg
from osl_analysis.report.page_text import assumed_text, method_text
from osl_analysis.report.reported_trial import ReportedTrial
from osl_analysis.report.trial_page import trial_content
from osl_analysis.report.trial_table import trial_table
from osl_analysis.report.used_trials import missing_lines
from osl_analysis.table import read_table, with_evidence, write_table
from osl_analysis.trial import metadata_of, read_trial, unit_of


@dataclass(frozen=True, kw_only=True)
class ReportFiles:
    """What the page of a run is made of, and the files that are written.

    Attributes
    ----------
    about
        What the numbers are made of.
    sheet
        The row of every trial of the sample sheet, also of those that it excludes.
    settings
        The sections of the configuration by which the experiments are analysed.
    accuracy
        The shares by which findings may move K, B and I without making them doubtful.
    trials, series, crossings
        The files of each trial that has them.
    tables
        Result tables, by name.
    figures
        SVG files, by name.
    verdicts, excluded, findings, states, summary
        `quality.csv`, `excluded.csv`, `findings.csv`, `settings.csv`, `summary.json`.
    captions
        Those of the figures.
    refused
        The causes of all that is missing.
    unnamed
        Tells recordings without a row.
    output, methods_md, methods_tex, methods_bib
        `report.html`, `methods.md`, `methods.tex` and `methods.bib`, which are written.
    """

    about: Mapping[str, str]
    sheet: Mapping[str, Mapping[str, Any]]
    settings: Mapping[str, Any]
    accuracy: Mapping[str, float]
    trials: Mapping[str, Path]
    series: Mapping[str, Path]
    crossings: Mapping[str, Path]
    tables: Mapping[str, Path]
    figures: Mapping[str, Path]
    verdicts: Path
    excluded: Path
    findings: Path
    states: Path
    summary: Path
    output: Path
    methods_md: Path
    methods_tex: Path
    methods_bib: Path
    captions: Path | None = None
    refused: Sequence[Refusal] = ()
    unnamed: str = ""


def write_report(files: ReportFiles) -> None:
    """Write the page of a run, and the text of its methods."""
    results = {name: with_evidence(path) for name, path in files.tables.items()}
    findings_by_trial: dict[str, list[WordedFinding]] = {}
    for worded in read_findings(files.findings):
        findings_by_trial.setdefault(worded.finding.subject, []).append(worded)
    refusals: dict[str, str] = {}
    not_made: list[Refusal] = []
    for refusal in files.refused:
        if refusal.trial:
            refusals[refusal.trial] = f"{refusal.reason}; {refusal.remedy}"
        else:
            not_made.append(refusal)
    checks = read_table(files.verdicts).filter(pl.col("verdict") != "refused")
    campaign = CampaignResults(
        files={"trial": files.trials, "series": files.series, "crossing": files.crossings},
        rows=rows_by_trial(results),
        findings=findings_by_trial,
        checks=checks.partition_by("trial", as_dict=True),
        left_out=left_out_trials(files.sheet, read_table(files.excluded), results, refusals),
    )
    reported = [reported_trial(row, campaign) for row in files.sheet.values()]

    numbers = {} if is_refused(files.summary) else read_summary(files.summary)
    drawn, absent = drawn_figures(files.figures, read_captions(files.captions))
    overview = page.overview(reported, numbers, drawn, files.about)
    shown_findings = [shown.finding for shown in overview.findings]
    facts = methods_content(files.settings, files.accuracy, results, reported, shown_findings)
    methods = methods_text(facts, files.about)
    write_text(files.methods_md, methods.markdown())
    write_text(files.methods_tex, methods.latex())
    write_text(files.methods_bib, methods.bibtex())

    claims = results.get("claims", pl.DataFrame(schema=["subject", "verdict"]))
    report = Report(
        about=files.about,
        made_of=sentence(files.about),
        overview=overview,
        trials=trial_table(reported),
        conditions=condition_rows(results, findings_by_trial),
        claims=page.claim_rows(claims),
        methods=methods,
        equation=method_text(files.settings, results),
        assumed=assumed_text(read_table(files.states)),
        intervals=numbers.get("intervals", ""),
        unnamed=files.unnamed,
        sensitivity=results.get("walking_sensitivity", pl.DataFrame()).to_dicts(),
        absent_figures=absent,
        not_made=not_made,
    )
    pages = {}
    for trial in reported:
        pages[trial.name] = (trial_content(trial), trial.pictures.tables)
    write_text(files.output, written_page(report, pages))


RowsOfTrials = Mapping[tuple[Any, ...], pl.DataFrame]
"""The rows of a table by `(trial,)`."""


def rows_by_trial(results: Mapping[str, pl.DataFrame]) -> dict[str, RowsOfTrials]:
    """The rows of each trial in each table that has trials."""
    rows: dict[str, RowsOfTrials] = {}
    for name, table in results.items():
        if "trial" in table.columns:
            rows[name] = table.partition_by("trial", as_dict=True)
    return rows


def read_captions(path: Path | None) -> Mapping[str, Any]:
    """The captions of figures by title; none where they were not written."""
    if path is None or is_refused(path):
        return {}
    return captions_by_title(path.read_text(encoding="utf-8"))


def drawn_figures(
    figures: Mapping[str, Path], captions: Mapping[str, Any]
) -> tuple[list[ShownFigure], dict[str, str]]:
    """The figures with their captions, and, by title, why each of the others is not drawn."""
    drawn: list[ShownFigure] = []
    absent: dict[str, str] = {}
    for name, path in figures.items():
        title = figure_title(name)
        caption = captions.get(title, "")
        plotted_numbers = path.with_suffix(".csv")
        if is_refused(plotted_numbers) or read_table(plotted_numbers).is_empty():
            absent[title] = str(caption).removeprefix(UNDRAWN).strip()
            continue
        drawing = inline_svg(path.read_text(encoding="utf-8"), name, title)
        drawn.append(ShownFigure(name, title, caption, drawing, FIGURES[name].reading))
    return drawn, absent


@dataclass(frozen=True)
class CampaignResults:
    """What a campaign has of its trials.

    Attributes
    ----------
    files
        By role (trial, series, crossing) and trial.
    rows
        Of the result tables, by table and `(trial,)`.
    findings
        By trial.
    checks
        Verdicts on recordings, by `(trial,)`.
    left_out
        Trials that are not used.
    """

    files: Mapping[str, Mapping[str, Path]]
    rows: Mapping[str, RowsOfTrials]
    findings: Mapping[str, Sequence[WordedFinding]]
    checks: RowsOfTrials
    left_out: Mapping[str, LeftOut]


def reported_trial(row: Mapping[str, Any], campaign: CampaignResults) -> ReportedTrial:
    """A trial of the sample sheet from its row there, its files, its rows of the tables, and why it
    has no result."""
    name = row["trial"]
    experiment = EXPERIMENTS[row["experiment"]]
    files = {role: paths[name] for role, paths in campaign.files.items() if name in paths}
    tables: dict[str, pl.DataFrame] = {}
    for table in [*(table.name for table in experiment.tables), "walking_responses"]:
        rows = campaign.rows.get(table, {}).get((name,))
        if rows is not None:
            tables[table] = rows

    left_out = campaign.left_out.get(name, LeftOut(False, "", []))
    provenance: Mapping[str, Any] = {}
    if "trial" in files:
        _, provenance = metadata_of(files["trial"])
    return ReportedTrial(
        name=name,
        row=row,
        tables=tables,
        findings=campaign.findings.get(name, []),
        quality=campaign.checks.get((name,)),
        provenance=provenance,
        left_out=left_out.reasons,
        left_out_for=left_out.cause,
        refused=left_out.by_job,
        pictures=pictures(row["experiment"], tables, files),
    )


MOVING = {"belt": "Belt deflection", "actuator": "Motor motion"}
"""What moves in an experiment; in any other it is the joint."""


def pictures(
    experiment: str, tables: Mapping[str, pl.DataFrame], files: Mapping[str, Path]
) -> panels.Pictures:
    """What is drawn of a trial: the fit, the crossing with its isolated response, or else the
    recording."""
    drawn: list[panels.Pictures] = []
    crossing = pl.DataFrame()
    if "crossing" in files:
        crossing = pl.read_parquet(files["crossing"])
    if "series" in files:
        series = read_table(files["series"], name="series")
        motion = MOVING.get(experiment, "Joint angle")
        drawn.append(panels.bench_pictures(series, motion, experiment == "belt"))
    elif len(crossing):
        drawn.append(panels.crossing_pictures(crossing))
    elif "trial" in files:
        samples = read_trial(files["trial"]).samples
        units: dict[str, str] = {}
        for name in samples.columns:
            unit = unit_of(name)
            if name != "time" and unit:
                units[name] = unit
        drawn.append(panels.recorded_pictures(samples, units))
    if "walking_responses" in tables:
        drawn.append(panels.isolated_pictures(tables["walking_responses"]))
    if "phasors" in tables and "impedance" in tables:
        fit_to_all = tables["impedance"].row(-1, named=True)
        drawn.append(panels.phasor_pictures(tables["phasors"], fit_to_all))
    if "response" in tables:
        drawn.append(panels.response_pictures(tables["response"]))
    return panels.together(*drawn)


def compared_cells(
    row: Mapping[str, Any], of_a: Mapping[str, Any], of_b: Mapping[str, Any]
) -> dict[str, str]:
    """A row of `comparison.csv` in words, by the heads of what is printed, from the summaries of
    both campaigns."""
    ratio = number_text(row, "relative_percent")
    return {
        "quantity": label_of(row),
        f"A: {of_a.get('campaign')}": number_text(row, "mean_A"),
        f"B: {of_b.get('campaign')}": number_text(row, "mean_B"),
        "unit": row["unit"],
        "B - A": number_text(row, "difference"),
        "B over A, less 1": f"{ratio} %" if ratio else "",
        "verdict": row["verdict"] or "",
        "remark": row["remark"] or without_difference(row),
    }


def without_difference(row: Mapping[str, Any]) -> str:
    """Why a row of `comparison.csv` with numbers of both campaigns has no difference."""
    method = str(row["method"] or "")
    return method.removeprefix("none: ") if method.startswith("none: ") else ""


@dataclass(frozen=True)
class Comparison:
    """Two campaigns beside each other.

    Attributes
    ----------
    table
        The rows of `comparison.csv`.
    text
        What to print.
    """

    table: pl.DataFrame
    text: str


def number_text(row: Mapping[str, Any], name: str) -> str:
    """A number of a row with its interval in brackets; empty if it has none."""
    value, low, high = row[name], row.get(f"{name}_low"), row.get(f"{name}_high")
    if value is None:
        return ""
    places = digits_of(value, low, high)
    text = fixed(value, places.value)
    if low is None or high is None:
        return text
    return f"{text} [{fixed(low, places.ends)}, {fixed(high, places.ends)}]"


def tables_to_compare(folder: Path) -> dict[str, pl.DataFrame]:
    """The tables of a campaign that are compared, by name, of those that it has, with the errors of
    its bench."""
    tables: dict[str, pl.DataFrame] = {}
    for name, columns in COMPARED_QUANTITIES.items():
        path = folder / f"tables/{name}.csv"
        if name == "walking_summary":  # a row per quantity
            columns = ("quantity", "estimator", "n", "mean", "low", "high", "commanded")
        if path.is_file() and not is_refused(path):
            tables[name] = with_evidence(path, columns)
    return tables


def remarks_on(
    a: Mapping[str, Any], b: Mapping[str, Any], tables: Sequence[Mapping[str, pl.DataFrame]]
) -> list[str]:
    """In what two summaries differ beside their numbers, or whether all numbers of their `tables`
    are the same."""
    remarks = []
    for name in ("data", "version"):
        if a.get(name) != b.get(name):
            remarks.append(f"{name}: {a.get(name)} in A, {b.get(name)} in B")
    if are_equal(*tables):
        remarks.append("A and B have the same estimates in all trials; one is a copy of the other")
    return remarks


def are_equal(a: Mapping[str, pl.DataFrame], b: Mapping[str, pl.DataFrame]) -> bool:
    """Whether two campaigns have the same tables."""
    return a.keys() == b.keys() and all(table.equals(b[name]) for name, table in a.items())


def both_summaries(folders: Sequence[Path]) -> list[dict[str, Any]]:
    """The summaries in two folders of results. Raises InputError: as `compare_campaigns`."""
    if realpath(folders[0]) == realpath(folders[1]):
        raise InputError(
            f"{folders[1]}: A and B are the same folder; name the results of another campaign"
        )
    a, b = (read_summary(folder / "summary.json") for folder in folders)
    for name, number in a["numbers"].items():
        unit = b["numbers"].get(name, number)["unit"]
        if unit != number["unit"]:
            raise InputError(
                f"{folders[1] / 'summary.json'}: '{name}' is in {unit}, but in {number['unit']} in"
                f" {folders[0]}; run the older campaign again with this version"
            )
    return [a, b]


def compare_campaigns(
    folders: Sequence[Path], output: Path, margin: float | None = None
) -> Comparison:
    """Compare the results of two campaigns.

    Parameters
    ----------
    folders : Sequence of Path
        Those of A and B.
    output : Path
        Folder for `comparison` as .csv, .pdf, .svg and .png: all or none.
    margin : float or None
        As in `comparison_table`.

    Returns
    -------
    Comparison

    Raises
    ------
    InputError
        Both are one folder, one has no summary or an older table, there is nothing to compare, or a
        number has two units.
    """
    a, b = both_summaries(folders)
    tables = [tables_to_compare(folder) for folder in folders]
    table = comparison_table(tables[0], tables[1], margin)
    if table["difference"].is_null().all():
        raise InputError(
            f"{folders[0]} and {folders[1]}: nothing to compare, no quantity is of one condition in"
            " both; run both to their end, state K_d and B_d in both sheets, or give trials that"
            " belong together one name"
        )
    table.insert_column(2, pl.Series("unit", units_of(table)))
    paths = {kind: output / f"comparison.{kind}" for kind in ("csv", "pdf", "svg", "png")}
    origins = dict.fromkeys(summary.get("data", "") for summary in (a, b))
    with ExitStack() as stack:
        new = {kind: stack.enter_context(atomic_path(path)) for kind, path in paths.items()}
        write_table(table, new["csv"], " and ".join(origins))
        footer = f"A: {sentence(a)}; B: {sentence(b)}"
        draw_figure(
            "comparison", new["csv"], [new[kind] for kind in ("pdf", "svg", "png")], origin=footer
        )
    cells = [compared_cells(row, a, b) for row in table.iter_rows(named=True)]
    rows = aligned([list(cells[0]), *(list(row.values()) for row in cells)])
    lines = [rows, "", *verdicts_in_words(table), *remarks_on(a, b, tables)]
    of_campaigns = {"A": a, "B": b}
    for name, summary in of_campaigns.items():
        lines += [f"{name}: {line}" for line in findings_lines(findings_in_summary(summary))]
    for name, summary in of_campaigns.items():
        lines += [f"{name}: {line}" for line in missing_lines(summary, reasons=True)]
    lines.append(f"wrote {', '.join(str(path) for path in paths.values())}")
    return Comparison(table, "\n".join(lines))


def units_of(comparison: pl.DataFrame) -> list[str]:
    """The unit of each row of a comparison, from the described tables."""
    columns = {table.place: table.columns for table in described_tables()}
    units = []
    for experiment, quantity in comparison.select("experiment", "quantity").iter_rows():
        units.append(columns[f"tables/{experiment}"][quantity].unit)
    return units
