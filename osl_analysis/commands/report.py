"""The report of a run, and the comparison of two: reads what the runs wrote, and writes one
page."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from copy import deepcopy
from os.path import realpath
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.campaign.origin import sentence
from osl_analysis.commands.figure import UNDRAWN, draw_figure
from osl_analysis.commands.tables import read_summary
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.dictionary import described_tables
from osl_analysis.errors import InputError, listing
from osl_analysis.figures.names import figure_title
from osl_analysis.files import atomic_path, write_text
from osl_analysis.judge.campaign import Entry, entries
from osl_analysis.judge.finding import read_findings
from osl_analysis.judge.two_campaigns import (
    COMPARED_QUANTITIES,
    comparison_table,
    label_of,
    verdicts_in_words,
)
from osl_analysis.refusal import Refusal, is_refused
from osl_analysis.report import page, trial_page
from osl_analysis.report.headlines import aligned, digits_of, fixed, missing_lines
from osl_analysis.report.page import captions_by_title, inline_svg, written_page
from osl_analysis.report.trial_page import ReportedTrial, left_out_trials, trial_content
from osl_analysis.table import read_table, with_evidence, write_table
from osl_analysis.trial import metadata_of, read_trial, unit_of


def write_report(
    *,
    about: Mapping[str, str],
    sheet: Mapping[str, Mapping[str, Any]],
    settings: Mapping[str, Any],
    trials: Mapping[str, Path],
    series: Mapping[str, Path],
    crossings: Mapping[str, Path],
    tables: Mapping[str, Path],
    figures: Mapping[str, Path],
    verdicts: Path,
    excluded: Path,
    findings: Path,
    states: Path,
    summary: Path,
    output: Path,
    methods_md: Path,
    methods_tex: Path,
    captions: Path | None = None,
    refused: Sequence[Refusal] = (),
    unnamed: str = "",
) -> None:
    """Write the page `report.html`, and the text of its methods, `methods.md` and `methods.tex`.

    `sheet` has the row of every trial, also of those that it excludes, `settings` the sections of
    the configuration by which the experiments are analysed; `trials`, `series` and `crossings` the
    files of each that has them, `tables` the result tables and `figures` the SVG files by name.
    `verdicts` is `quality.csv`, `excluded` the trials that are not used, `findings` `findings.csv`,
    `states` `settings.csv`, `summary` `summary.json`, `refused` the causes of all that is missing,
    `unnamed` tells recordings without a row."""
    written = {name: with_evidence(path) for name, path in tables.items()}
    said_of = {one.trial: f"{one.reason}; {one.remedy}" for one in refused if one.trial}
    left_out = left_out_trials(read_table(excluded), written, said_of)
    by_role = {"trial": trials, "series": series, "crossing": crossings}
    judged = (
        read_table(verdicts)
        .filter(pl.col("verdict") != "refused")
        .partition_by("trial", as_dict=True)
    )
    of_trial: dict[str, list[Entry]] = {}
    for entry in entries(read_findings(findings)):
        of_trial.setdefault(entry["trial"], []).append(entry)
    rows_of = {
        n: own.partition_by("trial", as_dict=True)
        for n, own in written.items()
        if "trial" in own.columns
    }
    reported = []
    for name, row in sheet.items():
        files = {role: paths[name] for role, paths in by_role.items() if name in paths}
        findings_on, judged_checks = of_trial.get(name, []), judged.get((name,))
        reported.append(reported_trial(row, files, left_out, rows_of, findings_on, judged_checks))
    pages = {one.name: (trial_content(one), one.pictures.tables) for one in reported}
    found = {} if is_refused(summary) else read_summary(summary)
    said = (
        captions_by_title(captions.read_text(encoding="utf-8"))
        if captions and not is_refused(captions)
        else {}
    )
    # the figures with their captions, and why each of the others is not drawn
    shown, absent = [], dict[str, str]()
    for name, path in figures.items():
        title, numbers = figure_title(name), path.with_suffix(".csv")
        if is_refused(numbers) or read_table(numbers).is_empty():
            absent[title] = str(said.get(title, "")).removeprefix(UNDRAWN).strip()
            continue
        drawn = inline_svg(path.read_text(encoding="utf-8"), name, title)
        shown.append(
            {"name": name, "title": title, "caption": said.get(title, ""), "drawing": drawn}
        )
    content = {
        "about": about,
        "made_of": sentence(about),
        **trial_page.trials_content(reported),
        **page.overview(reported, found, shown, about),
        "intervals": found.get("intervals", ""),
        "claims": page.claims_said(
            written.get("claims", pl.DataFrame(schema=["subject", "verdict"]))
        ),
        "methods": trial_page.methods_content(settings, written, reported),
        "absent_figures": absent,
        "unnamed": unnamed,
        "conditions": page.conditions(written, of_trial),
        "method": page.method_said(settings, written),
        "assumed": page.assumed_said(read_table(states)),
        "sensitivity": written.get("walking_sensitivity", pl.DataFrame()).to_dicts(),
        "not_made": [one for one in refused if not one.trial],
    }
    for path, form in ((methods_md, "md"), (methods_tex, "tex")):
        # what a template asks for is there
        told = content | {"methods": deepcopy(content["methods"]), "form": form}
        write_text(path, page.template("methods.txt.j2").render(told))
    write_text(output, written_page(content, pages))


def reported_trial(
    row: Mapping[str, Any],
    files: Mapping[str, Path],
    left_out: Mapping[str, tuple[bool, list[str]]],
    rows_of: Mapping[str, Mapping[tuple[Any, ...], pl.DataFrame]],
    findings_on: list[Entry],
    judged_checks: pl.DataFrame | None,
) -> ReportedTrial:
    """A trial of the sample sheet from its row there, its files, its rows of the tables, and why it
    has no result."""
    name, facts = row["trial"], EXPERIMENTS[row["experiment"]]
    names = [*(table.name for table in facts.tables), "walking_responses"]
    own = {table: rows_of[table][name,] for table in names if (name,) in rows_of.get(table, ())}
    why = left_out.get(name)
    # every trial of such an experiment has a result
    if why is None and (
        not own if facts.fit else row["experiment"] == "walking" and "crossing" not in files
    ):
        causes = listing(list(left_out), 3)
        were = f", because {causes} {'was' if len(left_out) == 1 else 'were'} refused or excluded"
        why = True, [f"it has no result{were if left_out else ''}"]
    origin = metadata_of(files["trial"])[1] if "trial" in files else {}
    missing, reasons = why or (False, [])
    picture = pictures(row["experiment"], own, files)
    return ReportedTrial(
        name, row, own, findings_on, judged_checks, origin, reasons, missing, picture
    )


def pictures(
    experiment: str, tables: Mapping[str, pl.DataFrame], files: Mapping[str, Path]
) -> trial_page.Pictures:
    """What is drawn of a trial: the fit, the crossing with its isolated response, or else the
    recording."""
    found = []
    if "series" in files:
        series = read_table(files["series"], of="series")
        motion = {"belt": "Belt deflection", "actuator": "Motor motion"}.get(
            experiment, "Joint angle"
        )
        found.append(trial_page.bench_pictures(series, motion, experiment == "belt"))
    elif "crossing" in files and len(crossing := pl.read_parquet(files["crossing"])):
        found.append(trial_page.crossing_pictures(crossing))
    elif "trial" in files:
        samples = read_trial(files["trial"]).samples
        units = {
            name: unit for name in samples.columns if name != "time" and (unit := unit_of(name))
        }
        found.append(trial_page.recorded_pictures(samples, units))
    if "walking_responses" in tables:
        found.append(trial_page.isolated_pictures(tables["walking_responses"]))
    if "phasors" in tables and "impedance" in tables:
        found.append(
            trial_page.phasor_pictures(tables["phasors"], tables["impedance"].row(-1, named=True))
        )
    if "response" in tables:
        found.append(trial_page.response_pictures(tables["response"]))
    return trial_page.together(*found)


def compared_cells(
    row: Mapping[str, Any], of_a: Mapping[str, Any], of_b: Mapping[str, Any]
) -> dict[str, str]:
    """A row of `comparison.csv` in words, by the heads of what is printed, from the summaries of
    both campaigns."""
    a, b = f"A: {of_a.get('campaign')}", f"B: {of_b.get('campaign')}"

    def said(name: str, sign: str = "") -> str:
        value, low, high = (row.get(f"{name}{end}") for end in ("", "_low", "_high"))
        if value is None:
            return ""
        digits, finer = digits_of(value, low, high)
        ends = (
            "" if low is None or high is None else f" [{fixed(low, finer)}, {fixed(high, finer)}]"
        )
        return f"{fixed(value, digits)}{ends}{sign}"

    cells = {"quantity": label_of(row), a: said("mean_A"), b: said("mean_B"), "unit": row["unit"]}
    cells |= {"B - A": said("difference"), "B over A, less 1": said("relative_percent", " %")}
    return cells | {name: row[name] or "" for name in ("verdict", "remark")}


def tables_to_compare(folder: Path) -> dict[str, pl.DataFrame]:
    """The tables of a campaign that are compared, by name, of those that it has, with the errors of
    its bench."""
    paths = {name: folder / f"tables/{name}.csv" for name in COMPARED_QUANTITIES}
    there = {name: path for name, path in paths.items() if path.is_file() and not is_refused(path)}
    of_walking = ("quantity", "estimator", "n", "mean", "low", "high", "commanded")
    needed = COMPARED_QUANTITIES | {"walking_summary": of_walking}
    return {name: with_evidence(path, needed[name]) for name, path in there.items()}


def remarks_on(
    a: Mapping[str, Any], b: Mapping[str, Any], tables: Sequence[Mapping[str, pl.DataFrame]]
) -> list[str]:
    """In what two summaries differ beside their numbers, or whether all numbers of their `tables`
    are the same."""
    apart = [name for name in ("data", "version") if a.get(name) != b.get(name)]
    remarks = [f"{name}: {a.get(name)} in A, {b.get(name)} in B" for name in apart]
    if tables[0].keys() == tables[1].keys() and all(
        own.equals(tables[1][name]) for name, own in tables[0].items()
    ):
        remarks.append("A and B have the same estimates in all trials; one is a copy of the other")
    return remarks


def both_summaries(folders: Sequence[Path]) -> list[dict[str, Any]]:
    """The summaries in two folders of results. Raises InputError: as `compare_campaigns`."""
    if realpath(folders[0]) == realpath(folders[1]):
        raise InputError(
            f"{folders[1]}: A and B are the same folder; name the results of another campaign"
        )
    a, b = (read_summary(folder / "summary.json") for folder in folders)
    for name, number in a["numbers"].items():
        if (unit := b["numbers"].get(name, number)["unit"]) != number["unit"]:
            said = f"'{name}' is in {unit}, but in {number['unit']} in {folders[0]}"
            raise InputError(
                f"{folders[1] / 'summary.json'}: {said}; run the older campaign again with this"
                " version"
            )
    return [a, b]


def compare_campaigns(folders: Sequence[Path], output: Path, margin: float | None = None) -> str:
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
    str
        What to print.

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
    units = {
        (one.place, name): column.unit
        for one in described_tables()
        for name, column in one.columns.items()
    }
    of_rows = [
        units[f"tables/{where}", what]
        for where, what in table.select("experiment", "quantity").iter_rows()
    ]
    table.insert_column(2, pl.Series("unit", of_rows))
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
    known = [
        f"{name}: {one['line']}"
        for name, of in (("A", a), ("B", b))
        for one in of.get("findings", ())
    ]
    lacks = [
        f"{name}: {line}" for name, of in (("A", a), ("B", b)) for line in missing_lines(of, True)
    ]
    rows = aligned([[*cells[0]], *([*row.values()] for row in cells)])
    said = [verdicts_in_words(table), *remarks_on(a, b, tables), "", rows, *known, *lacks]
    return "\n".join([*said, *(f"wrote {path}" for path in paths.values())])
