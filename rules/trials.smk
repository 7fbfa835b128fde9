# SPDX-License-Identifier: Apache-2.0
"""Recording -> trial, and what quality control measures on it."""

from osl_analysis.commands.tables import judge
from osl_analysis.commands.trials import ingest_and_check


rule ingest:
    """The trial of a recording, in SI units on one clock, and what is measured for each check."""
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
        data=CAMPAIGN.data,
        made_by=MADE_BY,
    run:
        job(ingest_and_check, input, output, params, log)


rule judge:
    """The verdict on every recording, by the thresholds of the configuration."""
    input:
        rows=FILES.checks(TRIALS),
    output:
        output=QUALITY,
    log:
        "<logs>/tables/quality.log",
    localrule: True
    params:
        rules=as_json(CONFIG.quality),
        accept=ACCEPTED,
        places=PLACES,
        made_by=MADE_BY,
    run:
        job(judge, input, output, params, log, "refused")
