# SPDX-License-Identifier: Apache-2.0
"""The campaign, and look-ups in it for the rules of several files.

A rule calls one function, `job(FUNCTION, output, log, inputs={...}, arguments={...})`, with every
argument by its name: `inputs` are results of earlier jobs, out of which refused trials are taken,
`arguments` are the others. It runs in a warm process (`osl_analysis/jobs/workers.py`). A table that
the function returns is written by the job.

Inputs without a name only say when a job of the rule is due. The function finds these files by its
arguments. A recording may be a folder; and what the sheet names and is missing refuses one trial,
by the function, while as an input it would end the run.

Params are what Snakemake compares with the last run, and what it finds when the job begins. All
rules have `made_by`. `file_states` and `sources` of a recording are compared alone. `excluded` are
the trials, of the checks among the inputs without a name, that are taken out of `inputs`; a rule
that has it has a `message`, without which Snakemake does not look it up anew as the job begins if
jobs are processes of their own.

A param is a value, or a function of `wildcards`: Snakemake does not compare a function of `input`.
Text that a person wrote is one of a function, too: in a plain text Snakemake replaces what stands
in braces.

A recording that the function refuses is a row without estimates and with a reason in each output.
Any other error is one of the job. The longest jobs, and those before them, have a `priority`: at the
end no core waits for them alone. A job has one core, the default of `threads`, and up to 400 MB for
the longest trials of the bench: no rule states resources, and profiles/slurm states those of all.
"""

import gc
from functools import cache
from operator import attrgetter
from pathlib import Path

from snakemake.exceptions import WorkflowError

try:
    import osl_analysis
except ImportError as error:
    raise WorkflowError(
        f"the Python package of this workflow cannot be imported ({error}): install it where Snakemake"
        " is installed, by `pip install .` in a copy of the repository of the release of these rules"
    ) from None

from osl_analysis.campaign.origin import (
    about,
    changed_settings,
    made_by,
    sentence,
    settings_of,
    stated_digests,
    states_of,
)
from osl_analysis.campaign.result_files import (
    DERIVED,
    GROUPS,
    ON_PAPER,
    ResultFiles,
    name_pattern,
    response_example,
    time_series_example,
)
from osl_analysis.bench.bench_settings import (
    ActuatorAnalysis,
    BeltAnalysis,
    ImpedanceAnalysis,
    SteppedSineAnalysis,
    TorqueAngleAnalysis,
)
from osl_analysis.commands.run import left_out_recordings, start_campaign
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.config.sheet import ON_DYNAMOMETER, RECORDINGS
from osl_analysis.base.errors import OslAnalysisError, listing, nearest
from osl_analysis.figures.drawing import FIGURES
from osl_analysis.jobs.job import Job, LeftOut, TrialFiles, as_paths
from osl_analysis.jobs.progress import LogHandler
from osl_analysis.jobs.snakemake_attributes import (
    configuration_files,
    has_prefix,
    parallel_jobs,
    say_what_to_state,
    look_for_jobs_at_once,
)
from osl_analysis.jobs.workers import run_in_worker
from osl_analysis.judge.recording_checks import read_verdicts, spoiled_trials
from osl_analysis.base.yaml_settings import as_json

# to look for garbage among all that is imported and planned takes a fifth of the planning
gc.set_threshold(100_000)

if has_prefix(workflow):
    raise WorkflowError(
        "a module of this workflow takes no `prefix`: jobs find recordings and results by the"
        " configuration; state `results` in its `config` for another place of all results"
    )

try:  # what is wrong in a file of the campaign is told without a traceback
    CAMPAIGN, SIMULATION_FILES = start_campaign(config, configuration_files(workflow))
except OslAnalysisError as error:
    raise WorkflowError(str(error)) from None
CONFIG = CAMPAIGN.config


pathvars:
    results=CONFIG.results.as_posix(),
    logs=f"{CONFIG.results.as_posix()}/logs",
    raw=CONFIG.raw_data.as_posix(),


wildcard_constraints:
    trial="[A-Za-z0-9][A-Za-z0-9_.-]*",
    figure=name_pattern(FIGURES),


FILES = ResultFiles(CAMPAIGN)
"""The campaign's results, and what each is made from (osl_analysis/campaign/result_files.py)."""
TRIALS = CAMPAIGN.trials()
PLACES = CAMPAIGN.places
"""Joint and side by trial."""
ABOUT = about(CAMPAIGN, SIMULATION_FILES)
"""Where the results come from, as figures and page say."""
MADE_BY = made_by(CAMPAIGN)
"""Version and digest of the code, and kind of the data. All rules have it as a param: another release
makes all again, and so does another line of code or another library, since results say which made
them. While you work on code, `--rerun-triggers mtime input` keeps what is made."""
CHANGED = changed_settings(CAMPAIGN)
"""What decides verdicts, and is not the shipped default."""
PARAMETERS = CONFIG.parameters or []
TRAJECTORY = [CONFIG.impedance_trajectory] if CONFIG.impedance_trajectory else []
TIME_SERIES = time_series_example(CAMPAIGN)
"""The trial of Fig. 4; None without one."""
LEFT_OUT = left_out_recordings(CAMPAIGN)
"""What is to be said of recordings that are not analysed."""
QUALITY = "<results>/tables/quality.csv"
ACCEPTED = {trial: CAMPAIGN.accepted(trial) for trial in TRIALS}
"""The checks that the sheet accepts, by trial."""


def job(
    function,
    output,
    log,
    inputs=None,
    arguments=None,
    left_out=LeftOut(),
    trial=TrialFiles(),
    simulates=False,
):
    """Call `function(**inputs, **arguments)` in a warm process; osl_analysis/jobs/job.py says what
    each of these is. `output` and `log` are those of the rule."""
    run_in_worker(
        Job(
            function,
            outputs=[Path(file) for file in output],
            log=Path(log[0]),
            inputs={name: as_paths(files) for name, files in (inputs or {}).items()},
            arguments=arguments or {},
            left_out=left_out,
            trial=trial,
            data=CAMPAIGN.data,
            parallel_jobs=parallel_jobs(workflow),
            simulates=simulates,
        )
    )


def by_name(files):
    """Files by the stems of their names."""
    return {Path(file).stem: file for file in files}


onstart:
    look_for_jobs_at_once(workflow)


@cache
def look_at_options():
    """Say once, when the first trial is planned, what makes this run slow: while this file is read,
    Snakemake does not know its options, and of a module it calls no `onstart`."""
    say_what_to_state(workflow)


def of_trials(trials, files="<results>/trials/{trial}.parquet".format):
    """An input: the files of the job's trial, which is one of these trials.

    A `wildcard_constraints` of their names would not do: Snakemake reads it anew for each file of
    each job, so that planning would take a time that grows with the square of their number.
    """
    names = frozenset(trials)

    def files_of_trial(wildcards):
        look_at_options()
        if wildcards.trial not in names:
            raise WorkflowError(
                f"trial {wildcards.trial} is none of this analysis; ask for one of these:"
                f" {listing(sorted(names), 3)}{nearest(wildcards.trial, names)}"
            )
        return files(trial=wildcards.trial)

    return files_of_trial


def shown_at_the_end(file):
    """An input: this file, which the logger of the profile prints when its rule has ended, and where
    nothing is to be done. Its path is known to the logger only where the run asks for it."""

    def announced(wildcards):
        LogHandler.brief = Path(file)
        return file

    return announced


def source_values(trial):
    """A param: the digests of what the source files of a trial state. As inputs, the files would make
    a trial anew for a comment."""
    return [CAMPAIGN.source_digests[path] for path in CAMPAIGN.sources(trial)]


def experiment(wildcards):
    """The facts of a trial's experiment."""
    return EXPERIMENTS[CAMPAIGN.rows[wildcards.trial]["experiment"]]


def device(wildcards):
    """The parameter file of a trial's device; none for another joint."""
    return CAMPAIGN.device(wildcards.trial) or []


def recordings_of(row, raw_folder):
    """The raw files or folders that a row of the sheet names."""
    return [Path(raw_folder, row[role]) for role in RECORDINGS if row[role]]


def cell(column):
    """A param: the cell of the sample sheet for the trial in this column."""
    return lambda wildcards: CAMPAIGN.rows[wildcards.trial][column]


SETTINGS_OF_FIT = {
    "belt": CONFIG.dynamometer.part(BeltAnalysis),
    "transmission": CONFIG.dynamometer.part(SteppedSineAnalysis),
    "actuator": CONFIG.actuator.part(ActuatorAnalysis),
    "impedance": CONFIG.dynamometer.part(ImpedanceAnalysis),
    "torque_angle": CONFIG.torque_angle.part(TorqueAngleAnalysis),
    "calibration": CONFIG.dynamometer.part(ImpedanceAnalysis),
}
"""By experiment, the settings that its fit uses: a change of others does not fit anew."""
FITTED_WITH_DEVICE = ("belt", "transmission", "actuator", "impedance")
"""Experiments whose fit takes the parameter file of the device."""
TRIAL_OF_FIT = {name: of_trials(CAMPAIGN.trials(name)) for name in SETTINGS_OF_FIT}


def trial_of_fit(wildcards):
    """An input: a trial of the experiment."""
    return TRIAL_OF_FIT[wildcards.experiment](wildcards)


def device_of_fit(wildcards):
    """An input: the parameter file, of a fit that takes it."""
    return device(wildcards) if wildcards.experiment in FITTED_WITH_DEVICE else []


def stated_for_fit(wildcards):
    """A param: the cells of the sheet that the fit takes, by column."""
    row = CAMPAIGN.rows[wildcards.trial]
    facts = EXPERIMENTS[wildcards.experiment].fit
    return {column: row[column] for column in facts.sheet}


def windows_of_fit(wildcards):
    """A param: the windows of the sheet, of a fit that takes them."""
    facts = EXPERIMENTS[wildcards.experiment].fit
    return CAMPAIGN.rows[wildcards.trial]["windows"] if facts.windows else None


def figure_setting(wildcards):
    """The setting that a figure depends on; None without one."""
    setting = FIGURES[wildcards.figure].option
    return as_json(attrgetter(setting)(CONFIG)) if setting else None


def judged(of_verdicts, trials):
    """What follows from the verdicts on these trials, whose checks the rule has as an input.

    As a param, `lambda wildcards: excluded(trials)`, it is looked up when the run is planned and
    anew when the job begins. Thresholds and `accept` are no params of such a rule: what is judged
    as before makes no table again. A text where checks are missing: such a run has yet to measure.
    """
    files = [Path(file) for file in FILES.checks(trials)]
    if not all(map(Path.is_file, files)):
        return "not measured yet"
    return of_verdicts(read_verdicts(files, CONFIG.quality, ACCEPTED))


def excluded(trials):
    """A param: those of these trials that quality control excludes."""
    return judged(lambda verdicts: sorted({*verdicts.filter(verdict="exclude")["trial"]}), trials)


WITHOUT_EXCLUDED = "{rule}, without what quality control excludes: {params.excluded}"
"""The message of a rule with this param. To write it, Snakemake looks params up anew as the job
begins. Otherwise jobs that are processes of their own would keep those of the plan for the next
run."""


def faults(trials):
    """A param: by trial, the fault of its recording that spoils the estimates."""
    return judged(spoiled_trials, trials)
