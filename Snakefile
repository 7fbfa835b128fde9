"""From raw logs to Figures 3-9: raw log -> trial -> fit -> table -> figure.

`snakemake reproduce-all` runs the campaign of config/config.yaml; `--configfile FILE` overrides fields of it.
"""

import os
from operator import attrgetter
from pathlib import Path

from snakemake.exceptions import WorkflowError

from osl_analysis import workflow as jobs
from osl_analysis.bench.impedance import DesiredImpedance
from osl_analysis.campaign import open_campaign
from osl_analysis.commands.simulate import planned_sheet, settings_files
from osl_analysis.bench.settings import ActuatorAnalysis, DynamometerAnalysis
from osl_analysis.config import WeightSettings, campaign_config
from osl_analysis.doubtful import Doubt, doubt_report
from osl_analysis.errors import OslAnalysisError
from osl_analysis.exclusion import exclusion_report, kept
from osl_analysis.figures import FIGURES, drawn_figures
from osl_analysis.model.admittance_error import Weight
from osl_analysis.quality.checks import Commanded
from osl_analysis.quality.settings import QualityRules
from osl_analysis.walking.settings import OvergroundAnalysis, WalkingAnalysis


configfile: "config/config.yaml"


try:
    CONFIG = campaign_config(config, " overridden by ".join(os.path.relpath(f) for f in reversed(workflow.configfiles)))
    CAMPAIGN = open_campaign(CONFIG, planned_sheet(CONFIG.simulation, CONFIG.sheet) if CONFIG.simulation else None)
    CAMPAIGN.check_files()
    CAMPAIGN.check_figures()
    CAMPAIGN.check_quality()
    CAMPAIGN.check_walking()
    SIMULATION_FILES = settings_files(CONFIG.simulation) if CONFIG.simulation else []
except OslAnalysisError as error:
    raise WorkflowError(str(error)) from None

RESULTS = CONFIG.results


wildcard_constraints:
    trial="[A-Za-z0-9][A-Za-z0-9_.-]*",
    figure="|".join(FIGURES),


include: "rules/simulate.smk"
include: "rules/ingest.smk"
include: "rules/quality.smk"
include: "rules/dynamometer.smk"
include: "rules/actuator.smk"
include: "rules/model_comparison.smk"
include: "rules/walking.smk"
include: "rules/overground.smk"
include: "rules/tables.smk"
include: "rules/figures.smk"
include: "rules/study.smk"


rule:
    name:
        "reproduce-all"
    default_target: True
    input:
        simulated_logs(),
        ingested(),
        fitted(),
        result_tables(),
        RESULTS / "tables/quality.csv",
        RESULTS / "tables/excluded.csv",
        drawn_files(),
        RESULTS / "summary.json",
        RESULTS / "numbers.tex",


onsuccess:
    print(jobs.time_table())
    print(doubt_report(result_tables()))
    print(exclusion_report(checked(CAMPAIGN.trials()), CAMPAIGN.excluded))


onerror:
    print(jobs.failure_report())
    print(exclusion_report(checked(CAMPAIGN.trials()), CAMPAIGN.excluded))
