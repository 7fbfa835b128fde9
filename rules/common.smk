"""The configuration, the sample sheet, and what rules look up in them.

Rules have one line of code, as `job("bench.fit_belt_trial", input, output, params, log)`. It calls
the function `fit_belt_trial` of `osl_analysis/commands/bench.py` in a warm process
(`osl_analysis/jobs/workers.py`). The names of inputs, outputs and params are those of its
arguments, but for these (`osl_analysis/outcomes/perform.py`):

* `recordings`, `sources`, `made_of`, `evidence`, `numbers`, `quality`: inputs that only say when a
  job is due. The function finds the files by its other arguments.
* `fitted`: an input of which the function gets the refusals alone, as `refused`.
* `log`, `mocap`: outputs that the function places itself.
* `sizes`, `made_by`, `excluded`: params. Snakemake compares the first, every rule has the second,
  and the trials of the third are taken out of the inputs.

A param is a value, or a function of `wildcards`: Snakemake does not compare a function of `input`.

A recording that the function refuses leaves a table of reasons in place of each output. The longest
jobs, and those before them, have a `priority`: at the end no core waits for them alone.
"""

import atexit
import json
import os
import re
import sys
from operator import attrgetter
from pathlib import Path

from osl_analysis.campaign.campaign_trials import open_campaign
from osl_analysis.campaign.configuration import campaign_config, over_default
from osl_analysis.campaign.figure_examples import matching, response_example, time_series_example
from osl_analysis.campaign.origin import about, sentence
from osl_analysis.campaign.setting_states import states_of
from osl_analysis.commands.campaign_start import check_start, unnamed_recordings
from osl_analysis.commands.killed_runs import begin_run
from osl_analysis.commands.run import cancel_timers, check_profile, end_run
from osl_analysis.commands.run import left_behind_report, made_by
from osl_analysis.config.experiments import EXPERIMENTS, PROTOCOL, judged_tables
from osl_analysis.dictionary import described_tables_by_name
from osl_analysis.errors import OslAnalysisError
from osl_analysis.figures import FIGURES
from osl_analysis.files import check_working_folder, default_config
from osl_analysis.jobs.workers import job
from osl_analysis.judge.campaign import JUDGED_FURTHER, exclusion_report
from osl_analysis.judge.claims import CLAIMED
from osl_analysis.judge.exclusions import Judge
from osl_analysis.refusal import refusal_report
from osl_analysis.report.brief import brief_lines

try:  # what is wrong in a file of the campaign is one line, without a traceback
    check_profile(sys.argv)
    CONFIG_FILES = [Path(os.path.relpath(file)) for file in reversed(workflow.configfiles)]
    CONFIG = campaign_config(over_default(config), [default_config(), *CONFIG_FILES])
    PLANNED, SIMULATION_FILES = None, []
    if CONFIG.simulation:
        from osl_analysis.commands.simulate import planned_sheet, settings_files

        PLANNED = planned_sheet(CONFIG.simulation, CONFIG.sheet)
        SIMULATION_FILES = settings_files(CONFIG.simulation, CONFIG.shared())
    CAMPAIGN = open_campaign(CONFIG, PLANNED)
    check_working_folder(CONFIG.results)
    check_start(CAMPAIGN)
    TIME_SERIES = time_series_example(CAMPAIGN)
    RESPONSE = response_example(CAMPAIGN)
except OslAnalysisError as error:
    sys.exit(f"error: {error}")


pathvars:
    results=str(CONFIG.results),
    logs=f"{CONFIG.results}/logs",
    raw=str(CONFIG.raw_data),


wildcard_constraints:
    trial="[A-Za-z0-9][A-Za-z0-9_.-]*",
    figure="|".join(FIGURES),


def one_of(names):
    """A constraint of a wildcard to these names; "(?!)" matches nothing."""
    return "|".join(map(re.escape, names)) or "(?!)"


def plain(setting):
    """A section of the configuration as a param."""
    return setting.model_dump(mode="json") if hasattr(setting, "model_dump") else setting


def place(pattern):
    """A file below the results, for params, where Snakemake fills in no `<results>`."""
    return pattern.replace("<results>", str(CONFIG.results))


TRIALS = CAMPAIGN.trials()
PLACES = CAMPAIGN.places
"""Joint and side by trial."""
ABOUT = about(CAMPAIGN, SIMULATION_FILES)
"""Where the results come from, as figures and page say."""
MADE_BY = made_by(CAMPAIGN)
"""Version and sources of the package. All rules have it as a param: a change makes all again.

A digest for each rule would have to follow its imports, which reach most packages. While you work,
`snakemake --rerun-triggers mtime` leaves it out, and with it changed settings, which are params too.
"""
PARAMETERS = CONFIG.parameters or []
TRAJECTORY = [CONFIG.impedance_trajectory] if CONFIG.impedance_trajectory else []
UNNAMED = unnamed_recordings(CAMPAIGN)
"""What is to be said of recordings that no row of the sheet names."""
QUALITY = "<results>/tables/quality.csv"
JUDGE = Judge(CONFIG.quality, {trial: CAMPAIGN.accepted(trial) for trial in TRIALS})


def device(wildcards):
    """The parameter file of a trial's device; none for another joint."""
    return CAMPAIGN.device(wildcards.trial) or []


def cells(*columns):
    """What the sample sheet states for a trial in some columns."""
    return lambda wildcards: {column: CAMPAIGN.row(wildcards.trial)[column] for column in columns}


def cell(column):
    """What the sample sheet states for a trial in a column."""
    return lambda wildcards: CAMPAIGN.row(wildcards.trial)[column]


def checks(trials):
    """What quality control measured on these trials: an input of rules with a param `excluded`."""
    return expand("<results>/quality/{trial}.csv", trial=trials)


def excluded(trials):
    """Those of these trials that quality control excludes, by what it has measured until now.

    As a param, `excluded=lambda wildcards: excluded(trials)`, it is looked up anew when a job
    begins. A changed threshold that excludes the same trials as before makes no table again.
    """
    return JUDGE.excluded(CONFIG.results / f"quality/{trial}.csv" for trial in trials)


def limits(table):
    """The limits beyond which a fit of a table is doubtful; None for a table that is not judged."""
    return plain(CONFIG.doubtful.of(table)) if table in judged_tables() else None


# Simulation and ingest


SIMULATED_FILES = []
if CONFIG.simulation:
    SIMULATED_FILES += [CONFIG.sheet, *(file for trial in TRIALS for file in CAMPAIGN.logs(trial))]


def logged_in(folder):
    """The trials whose log stands in a folder of the raw data."""
    logs = {trial: CAMPAIGN.row(trial)["log"] for trial in TRIALS}
    return [trial for trial, log in logs.items() if log and Path(log).parent.name == folder]


def followed(wildcards):
    """What the configuration decides for the simulator."""
    return plain(CONFIG.shared(CAMPAIGN.row(wildcards.trial)["experiment"]))


def commanded(wildcards):
    """The stepped sine that was asked for, with which quality control compares the motion."""
    if EXPERIMENTS[CAMPAIGN.row(wildcards.trial)["experiment"]].stepped_sine:
        return {name: getattr(CONFIG.dynamometer, name) for name in PROTOCOL}
    return {"amplitudes_deg": [], "frequencies_hz": [], "cycles": 1}


def recordings(wildcards):
    """The recordings of a trial; its job refuses one that is missing or cannot be read."""
    files = CAMPAIGN.logs(wildcards.trial)
    return [file for file in files if CONFIG.simulation or os.access(file, os.R_OK)]


def sizes(wildcards):
    """The sizes of recordings [bytes]: another one is seen even if its date is older."""
    return [file.stat().st_size for file in recordings(wildcards) if file.exists()]


# Walking


WALKED = {trial: PLACES[trial] for trial in CAMPAIGN.trials("walking")}
"""Joint and side of every crossing."""
PERTURBED = CAMPAIGN.crossings(perturbed=True)
UNPERTURBED = CAMPAIGN.crossings(perturbed=False)
PLATE_TRIALS = CAMPAIGN.plate_trials()


def statics(trials):
    """The static trial that calibrates each of these trials."""
    return {trial: CAMPAIGN.static(trial) for trial in trials if CAMPAIGN.statics}


def calibrations(trials):
    """The calibrations of these trials."""
    used = dict.fromkeys(statics(trials).values())
    return expand("<results>/fits/calibration/{static}.json", static=list(used))


def calibration_of_crossing(wildcards):
    """The calibration of a crossing; none where the leg's log has angle and torque."""
    return [] if CONFIG.walking.by_log else calibrations([wildcards.trial])[0]


# Tables


PARTS = ("actuator", "belt", "transmission")
"""Experiments that measure the components of the drivetrain."""
TABLES_OF = [(name, table) for name, facts in EXPERIMENTS.items() for table in facts.tables]
DERIVED = {
    derived: (table.name, command)
    for _, table in TABLES_OF
    for derived, command in table.derived.items()
}
"""By table that is computed from another one alone: that table, and the command."""


def rows(table, trials=None):
    """The files with the rows of single trials, or of these trials, behind a table."""
    files = []
    for experiment, other in TABLES_OF:
        if other.name == table:
            first = EXPERIMENTS[experiment].tables[0].name
            suffix = {first: "csv", "record": "parquet"}.get(table, "zip")
            fitted = CAMPAIGN.rows_of(experiment, other)
            used = [trial for trial in fitted if trials is None or trial in trials]
            files += expand(f"<results>/fits/{first}/{{trial}}.{suffix}", trial=used)
    return files


def rows_behind(table):
    """The results of single trials behind a table, also behind one that is derived from another."""
    if table in EXPERIMENTS["walking"].further_tables:
        return expand("<results>/crossings/{trial}.parquet", trial=list(WALKED)) + rows("walking")
    source, _ = DERIVED.get(table, (table, ""))
    return rows(source)


def places_in(table):
    """Joint and side of the trials that have rows in a table."""
    trials = {Path(file).stem for file in rows(table)}
    return {trial: place for trial, place in PLACES.items() if trial in trials}


def doubts_of(table):
    """The table of the same trials whose doubts the rows of a table share; empty for none."""
    for experiment, other in TABLES_OF:
        if other.name == table and CAMPAIGN.trials(experiment):
            return other.doubts_of
    return ""


def components_of(trial):
    """The experiments that measured components of the joint and side of a trial."""
    return [part for part in PARTS if PLACES[trial] in [PLACES[of] for of in CAMPAIGN.trials(part)]]


MEASURED_PARTS = {trial: components_of(trial) for trial in CAMPAIGN.predicted()}
PREDICTED = [trial for trial, parts in MEASURED_PARTS.items() if len(parts) == len(PARTS)]
"""The impedance trials with known gains whose components were all measured."""
UNPREDICTED = {
    trial: " and ".join(part for part in PARTS if part not in parts)
    for trial, parts in MEASURED_PARTS.items()
    if 0 < len(parts) < len(PARTS)
}
"""By impedance trial for which some components were measured: those that were not."""


def result_tables():
    """The names of the tables that the campaign's experiments give."""
    tables = list(dict.fromkeys(table.name for _, table in TABLES_OF if table.published))
    names = [table for table in tables if rows(table)]
    names += [table for table, (source, _) in DERIVED.items() if source in names]
    names += CAMPAIGN.further_tables()
    if "impedance" in names:
        names.append("impedance_evidence")
    if CONFIG.impedance_trajectory:
        names.append("gains")
    if PREDICTED or UNPREDICTED:
        names += ["prediction", "prediction_causes", "prediction_frequencies"]
    if any(table in names for table in CLAIMED):
        names.append("claims")
    return names


TABLE_NAMES = result_tables()
TABLES = expand("<results>/tables/{table}.csv", table=TABLE_NAMES)
GATHERED = [table for table in dict.fromkeys(table.name for _, table in TABLES_OF) if rows(table)]
FITS = list(dict.fromkeys(file for table in GATHERED for file in rows(table)))
RESULTS_OF_TRIALS = [
    *expand("<results>/trials/{trial}.parquet", trial=TRIALS),
    *expand("<results>/crossings/{trial}.parquet", trial=list(WALKED)),
    *calibrations(WALKED),
    *FITS,
]


def tables(*names):
    """Those of these tables that the campaign has."""
    of_campaign = [name for name in TABLE_NAMES if name in names]
    return expand("<results>/tables/{table}.csv", table=of_campaign)


COMPONENT_SUMMARIES = tables(*(f"{part}_summary" for part in PARTS))
PAPER_TABLES = []
if "impedance" in TABLE_NAMES:
    PAPER_TABLES += [
        "<results>/tables/latex/conditions.tex",
        "<results>/tables/markdown/conditions.md",
    ]
if COMPONENT_SUMMARIES:
    PAPER_TABLES += [
        "<results>/tables/latex/components.tex",
        "<results>/tables/markdown/components.md",
    ]


def evidence_of(*names):
    """The evidence that is read beside the table `impedance`, where it is one of these tables."""
    return tables("impedance_evidence") if "impedance" in names else []


def example(wildcards):
    """The desired impedance of Fig. 4; None without one."""
    if TIME_SERIES is None:
        return None
    return {name: TIME_SERIES[name] for name in ("K_d", "B_d", "chosen")}


# Figures and page


OWN_NUMBERS = ("fig3", "fig4", "fig7", "walking_page", "impedance_over_stance")
"""Figures whose numbers have a rule of their own; each of the others shows one to three tables."""
FIGURE_NAMES = [name for name, figure in FIGURES.items() if figure.table in TABLE_NAMES]
FIGURE_FILES = expand(
    "<results>/figures/{figure}.{suffix}", figure=FIGURE_NAMES, suffix=("csv", "pdf", "svg", "png")
)
CAPTIONS = ["<results>/figures/captions.md"] if FIGURE_NAMES else []
FIGURE_FILES += CAPTIONS


def table_beside(number):
    """A further table that a figure shows, as a function of wildcards; none if it shows less."""
    names = lambda wildcards: FIGURES[wildcards.figure].beside[number : number + 1]
    return lambda wildcards: expand("<results>/tables/{table}.csv", table=names(wildcards))


def option(wildcards):
    """The setting that a figure depends on; None without one."""
    name = FIGURES[wildcards.figure].option
    return plain(attrgetter(name)(CONFIG)) if name else None


def shown(figure):
    """The results of single trials that a figure shows; the refused ones are named below it."""
    if figure == "fig4":
        return []  # one trial, without which it is not drawn
    if figure == "fig7":
        return rows("phasors", matching(CAMPAIGN, RESPONSE.model_dump() if RESPONSE else {}))
    return rows_behind(FIGURES[figure].table)


def report_of(files, refused):
    """What a user must know at the end of a run, from the files of it and those that are
    refused."""
    recordings_of = {trial: list(map(str, CAMPAIGN.logs(trial))) for trial in TRIALS}
    verdicts = JUDGE.verdicts(Path(place(file)) for file in checks(TRIALS))
    stored = (CONFIG.results / "trials").glob("*.parquet")
    lines = [
        exclusion_report(verdicts, CAMPAIGN.excluded),
        UNNAMED,
        left_behind_report(stored, [*TRIALS, *CAMPAIGN.excluded]),
        refusal_report(refused, recordings_of, ACCEPT),
    ]
    summary = place("<results>/summary.json")
    if summary in files and summary not in refused:
        lines = [*brief_lines(json.loads(Path(summary).read_text())), *lines]
    return "\n".join(line for line in lines if line)
