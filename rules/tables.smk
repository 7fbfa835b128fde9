# SPDX-License-Identifier: Apache-2.0
"""Rows of single trials -> tables over trials -> findings and headline numbers."""

from osl_analysis.commands.fit import derive
from osl_analysis.commands.gains import select_trajectory
from osl_analysis.commands.tables import (
    check_claims,
    gather,
    judge_campaign,
    list_excluded,
    list_settings,
    write_paper_table,
    write_summary,
)
from osl_analysis.judge.limits import DoubtfulFits, Limits
from osl_analysis.model.compensator import Weight


rule table:
    """A table from the rows of single trials, with the doubts about each row."""
    input:
        lambda wildcards: FILES.checks(FILES.places_in(wildcards.table)),
        rows=lambda wildcards: FILES.rows(wildcards.table),
        fits=lambda wildcards: FILES.tables(DOUBTS_OF.get(wildcards.table, "")),
        budget=lambda wildcards: FILES.budget_of(wildcards.table),
    output:
        output="<results>/tables/{table}.csv",
    log:
        "<logs>/tables/{table}.log",
    wildcard_constraints:
        table=name_pattern(FILES.gathered_tables),
    localrule: True
    params:
        limits=lambda wildcards: limits(wildcards.table),
        places=lambda wildcards: FILES.places_in(wildcards.table),
        excluded=lambda wildcards: excluded(FILES.places_in(wildcards.table)),
        faults=lambda wildcards: faults(FILES.places_in(wildcards.table)),
        made_by=MADE_BY,
    message:
        WITHOUT_EXCLUDED
    run:
        job(
            gather,
            output,
            log,
            inputs=dict(rows=input.rows, fits=input.fits, budget=input.budget),
            arguments=dict(
                name=wildcards.table,
                limits=Limits(**params.limits) if params.limits else None,
                places=params.places,
                faults=params.faults,
            ),
            left_out=LeftOut(excluded=params.excluded, argument="not_analysed"),
        )


rule summary_table:
    """A table that is computed from another one alone."""
    input:
        table=lambda wildcards: f"<results>/tables/{DERIVED[wildcards.table]}.csv",
    output:
        output="<results>/tables/{table}.csv",
    log:
        "<logs>/tables/{table}.log",
    wildcard_constraints:
        table=name_pattern(DERIVED),
    localrule: True
    params:
        made_by=MADE_BY,
    run:
        job(
            derive,
            output,
            log,
            inputs=dict(table=input.table),
            arguments=dict(name=wildcards.table),
        )


rule gains_table:
    """Gains for the impedance over the gait cycle (Fig. 8)."""
    input:
        trajectory=CONFIG.impedance_trajectory or [],
        parameters=PARAMETERS,
    output:
        output="<results>/tables/gains.csv",
    log:
        "<logs>/tables/gains.log",
    localrule: True
    params:
        weight=as_json(CONFIG.gain_weight),
        made_by=MADE_BY,
    run:
        job(
            select_trajectory,
            output,
            log,
            inputs=dict(trajectory=input.trajectory, parameters=input.parameters or None),
            arguments=dict(weight=Weight(**params.weight)),
        )


rule check_claims:
    """The claims of the author's text, compared with the campaign's numbers."""
    input:
        tables=FILES.tables(*FILES.claimed_tables),
        claims=CONFIG.claims or [],
    output:
        output="<results>/tables/claims.csv",
    log:
        "<logs>/tables/claims.log",
    localrule: True
    params:
        made_by=MADE_BY,
    run:
        job(
            check_claims,
            output,
            log,
            inputs=dict(tables=by_name(input.tables), claims=input.claims),
        )


rule settings_table:
    """The settings that judge or label results: which are stated, and which assumed."""
    output:
        output="<results>/tables/settings.csv",
    log:
        "<logs>/tables/settings.log",
    localrule: True
    params:
        states=states_of(CONFIG, config, [name for name in EXPERIMENTS if CAMPAIGN.trials(name)])
        + CHANGED,
        made_by=MADE_BY,
    run:
        job(
            list_settings,
            output,
            log,
            arguments=dict(states=params.states),
        )


rule excluded_trials:
    """Every trial that is not used, and why."""
    input:
        fitted=FILES.of_single_trials,
        tables=FILES.all_tables,
        verdicts=QUALITY,
    output:
        output="<results>/tables/excluded.csv",
    log:
        "<logs>/tables/excluded.log",
    localrule: True
    params:
        sheet=CAMPAIGN.sheet,
        places=PLACES,
        made_by=MADE_BY,
    run:
        job(
            list_excluded,
            output,
            log,
            inputs=dict(tables=by_name(input.tables), verdicts=input.verdicts),
            arguments=dict(sheet=params.sheet, places=params.places),
            left_out=LeftOut(
                argument="refused",
                also_of=[Path(file) for file in input.fitted],
                is_called_anyway=True,
            ),
        )


rule findings:
    """What was found on all trials, as values and in words."""
    input:
        FILES.checks(FILES.trials_for_findings),
        tables=FILES.tables(*JUDGED_TABLES),
        fits=FILES.fits_for_findings,
        budget=FILES.tables("budget", "walking_budget"),
        verdicts=QUALITY,
    output:
        output="<results>/tables/findings.csv",
    log:
        "<logs>/tables/findings.log",
    localrule: True
    params:
        limits=as_json(CONFIG.doubtful),
        places=PLACES,
        excluded=lambda wildcards: excluded(FILES.trials_for_findings),
        made_by=MADE_BY,
    message:
        WITHOUT_EXCLUDED
    run:
        job(
            judge_campaign,
            output,
            log,
            inputs=dict(
                tables=by_name(input.tables),
                fits=input.fits,
                budget=input.budget,
                verdicts=input.verdicts,
            ),
            arguments=dict(limits=DoubtfulFits(**params.limits), places=params.places),
            left_out=LeftOut(
                excluded=params.excluded, argument="refused", is_called_anyway=True
            ),
        )


rule headline_numbers:
    """The numbers of the paper's text, for programs and for LaTeX."""
    input:
        table_paths=FILES.all_tables,
        trials=expand("<results>/trials/{trial}.parquet", trial=TRIALS),
        excluded="<results>/tables/excluded.csv",
        findings="<results>/tables/findings.csv",
        verdicts=QUALITY,
    output:
        summary_json="<results>/summary.json",
        numbers_tex="<results>/numbers.tex",
    log:
        "<logs>/summary.log",
    localrule: True
    params:
        about=ABOUT,
        sheet=CAMPAIGN.sheet,
        beside_draft=CAMPAIGN.beside_draft,
        settings=settings_of(CAMPAIGN),
        stated=stated_digests(CAMPAIGN, SIMULATION_FILES),
        changed=CHANGED,
        made_by=MADE_BY,
    run:
        job(
            write_summary,
            output,
            log,
            inputs=dict(
                table_paths=by_name(input.table_paths),
                trials=input.trials,
                excluded=input.excluded,
                findings=input.findings,
                verdicts=input.verdicts,
            ),
            arguments=dict(
                about=params.about,
                sheet=params.sheet,
                beside_draft=params.beside_draft,
                settings=params.settings,
                stated=params.stated,
                changed=params.changed,
                summary_json=Path(output.summary_json),
                numbers_tex=Path(output.numbers_tex),
            ),
            left_out=LeftOut(argument="refused", is_called_anyway=True),
        )


rule table_for_paper:
    """K, B and I of each condition or group of crossings, or the measured components."""
    input:
        tables=lambda wildcards: FILES.for_paper[wildcards.name],
        parameters=PARAMETERS,
    output:
        tex="<results>/tables/latex/{name}.tex",
        markdown="<results>/tables/markdown/{name}.md",
    log:
        "<logs>/tables/{name}_for_paper.log",
    wildcard_constraints:
        name=name_pattern(FILES.for_paper),
    localrule: True
    params:
        about=ABOUT,
        beside_draft=CAMPAIGN.beside_draft,
        made_by=MADE_BY,
    run:
        job(
            write_paper_table,
            output,
            log,
            inputs=dict(tables=by_name(input.tables), parameters=input.parameters or None),
            arguments=dict(
                about=params.about,
                beside_draft=params.beside_draft,
                tex=Path(output.tex),
                markdown=Path(output.markdown),
            ),
        )
