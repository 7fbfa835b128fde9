"""The report of a run: reads what the run wrote, and writes one page."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.campaign.campaign import sentence
from osl_analysis.commands.tables import read_summary
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.dictionary import described_tables
from osl_analysis.errors import listing
from osl_analysis.figures.names import figure_title
from osl_analysis.files import atomic_path
from osl_analysis.refusal import Refusal, is_refused
from osl_analysis.report import panels, trial_page
from osl_analysis.report.headlines import COUNT
from osl_analysis.report.page import captions_by_title, inline_svg, written_page
from osl_analysis.report.trial_page import ReportedTrial, left_out_trials, trial_content
from osl_analysis.table import read_table
from osl_analysis.trial import metadata_of, read_trial, unit_of


def write_report(
    *,
    about: Mapping[str, str],
    sheet: Mapping[str, Mapping[str, Any]],
    largest_mb: float,
    trials: Mapping[str, Path],
    series: Mapping[str, Path],
    crossings: Mapping[str, Path],
    tables: Mapping[str, Path],
    figures: Mapping[str, Path],
    verdicts: Path,
    excluded: Path,
    summary: Path,
    output: Path,
    captions: Path | None = None,
    refused: Sequence[Refusal] = (),
) -> None:
    """Write the page `report.html`, of about `largest_mb` [MB] at most where thinning out its signals allows it.

    `sheet` has the row of every trial, also of those that it excludes; `trials`, `series` and `crossings` the files of
    each that has them, `tables` the result tables and `figures` the SVG files by name. `verdicts` is `quality.csv`,
    `excluded` the trials that are not used, `summary` `summary.json`, `refused` the causes of all that is missing.
    """
    written = {name: read_table(path) for name, path in tables.items()}
    said_of = {one.trial: f"{one.reason}; {one.remedy}" for one in refused if one.trial}
    without = written.get("walking_excluded", pl.DataFrame(schema=["trial", "reason"]))
    left_out = left_out_trials(read_table(excluded), without, said_of)
    described = {Path(table.place).name: table for table in described_tables() if table.place.startswith("tables/")}
    by_role = {"trial": trials, "series": series, "crossing": crossings}
    judged = read_table(verdicts).filter(pl.col("verdict") != "refused").partition_by("trial", as_dict=True)
    reported = []
    for name, row in sheet.items():
        files = {role: paths[name] for role, paths in by_role.items() if name in paths}
        why = left_out.get(name)
        facts = EXPERIMENTS[row["experiment"]]
        names = [*(table.name for table in facts.tables), "walking_responses"]
        own = {table: written[table].filter(pl.col("trial") == name) for table in names if table in written}
        own = {table: rows for table, rows in own.items() if len(rows)}
        # every trial of such an experiment has a result
        if why is None and (not own if facts.fit else row["experiment"] == "walking" and "crossing" not in files):
            causes = listing(list(left_out), 3)
            were = f", because {causes} {'was' if len(left_out) == 1 else 'were'} refused or excluded"
            why = True, [f"it has no result{were if left_out else ''}"]
        origin = metadata_of(files["trial"])[1] if "trial" in files else {}
        missing, reasons = why or (False, [])
        picture = pictures(row["experiment"], own, files)
        reported.append(ReportedTrial(name, row, own, judged.get((name,)), origin, reasons, missing, picture))
    pages = {one.name: (trial_content(one, described), one.pictures.tables) for one in reported}
    found = {} if is_refused(summary) else read_summary(summary)
    said = captions_by_title(captions.read_text(encoding="utf-8")) if captions and not is_refused(captions) else {}
    shown = []
    for name, path in figures.items():
        title = figure_title(name)
        drawn = inline_svg(path.read_text(encoding="utf-8"), name, title)
        shown.append({"name": name, "title": title, "caption": said.get(title, ""), "drawing": drawn})
    content = {
        "about": about,
        "made_of": sentence(about),
        **trial_page.trials_content(reported),
        "headlines": [
            trial_page.headline_row(number)
            for number in found.get("numbers", {}).values()
            if number["interval"] != COUNT  # the findings say it, with the causes
        ],
        "findings": found.get("findings", []),
        "figures": shown,
        "not_made": [one for one in refused if not one.trial],
    }
    with atomic_path(output) as temporary:
        temporary.write_text(written_page(content, pages, largest_mb), encoding="utf-8")


def pictures(experiment: str, tables: Mapping[str, pl.DataFrame], files: Mapping[str, Path]) -> panels.Pictures:
    """What is drawn of a trial: the fit, the crossing with its isolated response, or else the recording."""
    found = []
    if "series" in files:
        series = read_table(files["series"], of="series")
        motion = {"belt": "Belt deflection", "actuator": "Motor motion"}.get(experiment, "Joint angle")
        found.append(panels.bench_pictures(series, motion, experiment == "belt"))
    elif "crossing" in files and len(crossing := pl.read_parquet(files["crossing"])):
        found.append(panels.crossing_pictures(crossing))
    elif "trial" in files:
        samples = read_trial(files["trial"]).samples
        units = {name: unit for name in samples.columns if name != "time" and (unit := unit_of(name))}
        found.append(panels.recorded_pictures(samples, units))
    if "walking_responses" in tables:
        found.append(panels.isolated_pictures(tables["walking_responses"]))
    if "phasors" in tables and "impedance" in tables:
        found.append(panels.phasor_pictures(tables["phasors"], tables["impedance"].row(-1, named=True)))
    if "response" in tables:
        found.append(panels.response_pictures(tables["response"]))
    return panels.together(*found)
