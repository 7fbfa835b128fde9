"""From raw logs to Figures 3-9: raw log -> trial -> fit -> table -> figure.

`snakemake reproduce-all` runs the campaign of config/config.yaml; `--configfile FILE` overrides fields of it, as does the
`config` of a workflow that has this one as a module. A rule is a `step`: a function that says what its jobs read and
with which settings. A job waits for files, and for its request (`osl_analysis/jobs/request.py`): what changes there is
made again.
"""

import atexit
import gc
import os
import sys
from contextlib import suppress
from operator import attrgetter
from pathlib import Path

from osl_analysis.jobs.run import at_end_of_run, begin, end_timers, run_job

gc.freeze()  # what Snakemake has imported stays
gc.set_threshold(50_000)  # garbage collection at every 700th object took a sixth of the planning
atexit.register(gc.freeze)  # garbage collection at the end of Python took 0.5 s
os.environ["TMPDIR"] = str(
    workflow.snakemake_tmp_dir
)  # for jobs: what a killed one leaves goes with the run's own
if workflow.is_main_process and not any(one.startswith(("-n", "--dry")) for one in sys.argv):
    with suppress(OSError):  # a folder that cannot be written to is refused below
        begin(workflow.snakemake_tmp_dir)

from osl_analysis.commands.run import check_start, unnamed_recordings, with_shipped_profile
from osl_analysis.campaign.campaign import about, matching, open_campaign
from osl_analysis.campaign.campaign import response_example, sentence, time_series_example
from osl_analysis.campaign.configuration import campaign_config, over_default, states_of
from osl_analysis.config.experiments import EXPERIMENTS, PROTOCOL, judged_tables
from osl_analysis.dictionary import described_tables_by_name
from osl_analysis.errors import OslAnalysisError
from osl_analysis.figures import FIGURES
from osl_analysis.files import check_working_folder, default_config
from osl_analysis.refusal import is_refused, refusal_report
from osl_analysis.jobs.request import Requests
from osl_analysis.judge.claims import CLAIMED
from osl_analysis.judge.campaign import JUDGED_FURTHER, exclusion_report, findings_report
from osl_analysis.judge.used import Judge, left_behind_report
from osl_analysis.report import TEMPLATES

try:
    list(with_shipped_profile(sys.argv))  # a mistyped profile is refused
    DEFAULT = default_config()
    FILES = [DEFAULT, *(Path(os.path.relpath(file)) for file in reversed(workflow.configfiles))]
    CONFIG = campaign_config(over_default(config), FILES)
    if CONFIG.simulation:
        from osl_analysis.commands.simulate import (
            planned_sheet,
            settings_files,
        )  # it loads the simulator
    CAMPAIGN = open_campaign(
        CONFIG, planned_sheet(CONFIG.simulation, CONFIG.sheet) if CONFIG.simulation else None
    )
    check_working_folder(CONFIG.results)
    check_start(CAMPAIGN)
    TIME_SERIES, RESPONSE = time_series_example(CAMPAIGN), response_example(CAMPAIGN)
    SIMULATION_FILES = (
        settings_files(CONFIG.simulation, CONFIG.shared()) if CONFIG.simulation else []
    )
except OslAnalysisError as error:
    sys.exit(
        f"error: {error}"
    )  # an exception would be printed with the line of this file and a traceback

ABOUT = about(CAMPAIGN, SIMULATION_FILES)
UNNAMED = unnamed_recordings(CAMPAIGN)
RESULTS, RAW, PLACES = CONFIG.results, CONFIG.raw_data, CAMPAIGN.places
JUDGE = Judge(CONFIG.quality, {trial: CAMPAIGN.accepted(trial) for trial in CAMPAIGN.trials()})
PARAMETERS = {"files": {"parameters": CONFIG.parameters or []}}
REQUESTS = Requests(RESULTS, CAMPAIGN.data, JUDGE, workflow, [RAW] if CONFIG.simulation else [])


def tabled(name: str) -> Path:
    """The file of a table of results."""
    return RESULTS / f"tables/{name}.csv"


def setting(name: str):
    """A setting of the configuration by its dotted name, as it stands in a request."""
    value = attrgetter(name)(CONFIG)
    return value.model_dump(mode="json") if hasattr(value, "model_dump") else value


def step(command: str, output, log: str = "", name: str = "", **constraints):
    """Make a rule of the function below, which gives the parts of each job (`Requests.job`) for the rule's wildcards.

    The rule has the function's name, or `name`. `output` is a file, a list of files, or files by the names of the
    arguments with which `command` takes them; texts are below the results. `log` is below the logs, without suffix, and
    that of the output where it is not given. The parts may name another `command`.
    """
    placed = lambda file: RESULTS / file if isinstance(file, str) else file
    named = {key: placed(file) for key, file in output.items()} if isinstance(output, dict) else {}
    files = (
        []
        if named
        else [placed(file) for file in (output if isinstance(output, list) else [output])]
    )
    place = log or [*files, *named.values()][0].relative_to(RESULTS).with_suffix("")

    def made(parts) -> None:
        rule_name = name or parts.__name__

        rule:
            name:
                rule_name
            input:
                unpack(
                    lambda one: REQUESTS.job(
                        getattr(rules, rule_name), one, **{"command": command, **parts(one)}
                    )
                ),
            output:
                *files,
                **named,
            log:
                RESULTS / f"logs/{place}.log",
            wildcard_constraints:
                **constraints,
            run:
                run_job(input.request)

    return made


def single(command: str, output, log: str, parts, name: str = "") -> None:
    """Make a rule of a single job, which has these parts. It has the name of the command's function, or `name`."""
    step(command, output, log, name or command.partition(".")[2])(lambda _: parts)


wildcard_constraints:
    trial="[A-Za-z0-9][A-Za-z0-9_.-]*",
    figure="|".join(FIGURES),


include: "rules/trials.smk"
include: "rules/walking.smk"
include: "rules/tables.smk"
include: "rules/figures.smk"


rule:
    name:
        "reproduce-all"
    default_target: True
    input:
        [CONFIG.sheet, *(log for trial in CAMPAIGN.trials() for log in CAMPAIGN.logs(trial))]
        * bool(CONFIG.simulation),
        result_tables(),
        drawn_files(),
        [tabled("quality"), tabled("excluded"), tabled("findings"), tabled("settings")],
        [RESULTS / name for name in ("summary.json", "numbers.tex", "report.html")],


def end_of_run(records) -> str:
    """What a user must know at the end of a run; what was refused stands last. `records`: the refusal records in it."""
    recordings = {
        trial: [str(path) for path in CAMPAIGN.logs(trial)] for trial in CAMPAIGN.trials()
    }
    page, verdicts = RESULTS / "report.html", JUDGE.verdicts(checked(CAMPAIGN.trials()))
    said = [
        (
            f"open {page} in a browser: every number, figure and trial"
            if page.is_file() and not is_refused(page)
            else ""
        ),
        findings_report(tabled("findings"), result_tables(), verdicts),
        exclusion_report(verdicts, CAMPAIGN.excluded),
        UNNAMED,
        left_behind_report(
            (RESULTS / "trials").glob("*.parquet"), {*CAMPAIGN.trials(), *CAMPAIGN.excluded}
        ),
        refusal_report(records, recordings, ACCEPT),
    ]
    return "\n".join(filter(None, said))


# Where a cluster runs the jobs of single trials, the others, which take a moment, run here.
OF_TRIALS = ("simulate_", "ingest", "fit_", "analyse_crossing")
workflow.localrules(*(rule.name for rule in workflow.rules if not rule.name.startswith(OF_TRIALS)))
ACCEPT = CONFIG.failed_trials == "accept"
at_end_of_run(workflow, RESULTS / "logs", end_of_run, ACCEPT)


onsuccess:
    end_timers()


onerror:
    end_timers()
