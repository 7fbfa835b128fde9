# SPDX-License-Identifier: Apache-2.0
"""From raw logs to Figures 3-9: recording -> trial -> fit -> table -> figure.

`snakemake reproduce-all` runs the campaign of config/config.yaml; `--configfile FILE` overrides
fields of it, as does the `config` of a workflow that has this one as a module. Read rules/bench.smk
first. Names in capitals that several files use are made in rules/common.smk; `<results>` and
`<logs>` are its `pathvars`.
"""

from snakemake.utils import min_version

min_version("9.19")


include: "rules/common.smk"
include: "rules/simulate.smk"
include: "rules/trials.smk"
include: "rules/bench.smk"
include: "rules/walking.smk"
include: "rules/tables.smk"
include: "rules/figures.smk"


rule complete:
    """Every result of the campaign."""
    name:
        "reproduce-all"
    default_target: True
    input:
        recordings=SIMULATED_FILES,
        trials=FILES.files_of_single_trials,
        published=FILES.published,
        verdict="<results>/verdict.txt",
    localrule: True
