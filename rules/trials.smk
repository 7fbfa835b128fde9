# SPDX-License-Identifier: Apache-2.0
"""Recording -> trial, and what quality control measures on it."""

from osl_analysis.commands.tables import judge
from osl_analysis.commands.trials import ingest_and_check
from osl_analysis.ingest.quality import Commanded
from osl_analysis.judge.recording_checks import QualityRules


rule ingest:
    """The trial of a recording, in SI units on one clock, and the measured value of each check."""
    input:
        of_trials(TRIALS, CAMPAIGN.followed_logs),
    output:
        trial="<results>/trials/{trial}.parquet",
        quality="<results>/quality/{trial}.csv",
    log:
        "<logs>/ingest/{trial}.log",
    priority: 1
    params:
        row=lambda wildcards: CAMPAIGN.recording(wildcards.trial),
        raw_folder=lambda wildcards: str(CONFIG.raw_data),
        sources_folder=lambda wildcards: str(CONFIG.sources),
        needed_columns=lambda wildcards: experiment(wildcards).needed_columns,
        commanded=lambda wildcards: CAMPAIGN.commanded(wildcards.trial),
        file_states=lambda wildcards: CAMPAIGN.file_states(wildcards.trial),
        sources=lambda wildcards: source_values(wildcards.trial),
        made_by=MADE_BY,
    run:
        job(
            ingest_and_check,
            output,
            log,
            arguments=dict(
                row=params.row,
                raw_folder=Path(params.raw_folder),
                sources_folder=Path(params.sources_folder),
                needed_columns=params.needed_columns,
                commanded=Commanded(**params.commanded),
                trial=Path(output.trial),
                quality=Path(output.quality),
                data=CAMPAIGN.data,
            ),
            trial=TrialFiles(wildcards.trial, recordings_of(params.row, params.raw_folder)),
        )


rule judge:
    """The verdict on every recording, by the thresholds of the configuration."""
    input:
        rows=FILES.checks(TRIALS),
    output:
        QUALITY,
    log:
        "<logs>/tables/quality.log",
    localrule: True
    params:
        rules=as_json(CONFIG.quality),
        accept=ACCEPTED,
        places=PLACES,
        made_by=MADE_BY,
    run:
        job(
            judge,
            output,
            log,
            inputs=dict(rows=input.rows),
            arguments=dict(
                rules=QualityRules(**params.rules), accept=params.accept, places=params.places
            ),
            left_out=LeftOut(argument="refused", is_called_anyway=True),
        )
