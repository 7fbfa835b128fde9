# SPDX-License-Identifier: Apache-2.0
"""Rows of single trials -> findings -> tables over trials and headline numbers."""

from osl_analysis.commands.fit import derive
from osl_analysis.commands.gains import select_trajectory
from osl_analysis.commands.tables import (
    HeadlineFacts,
    HeadlineFiles,
    check_claims,
    gather,
    gather_findings,
    judge_table,
    list_excluded,
    list_settings,
    write_paper_table,
    write_summary,
)
from osl_analysis.judge.limits import Limits
from osl_analysis.model.compensator import Weight


rule findings:
    """The findings on the fits, or groups, of one table, by their budgets, limits and checks."""
    input:
        lambda wildcards: FILES.checks(FILES.places_in(wildcards.table)),
        rows=lambda wildcards: FILES.rows(wildcards.table),
        budget=lambda wildcards: FILES.budgets(wildcards.table),
    output:
        output="<results>/findings/_{table}.parquet",
    log:
        "<logs>/findings/{table}.log",
    wildcard_constraints:
        table=name_pattern(FILES.judged_tables),
    localrule: True
    params:
        limits=lambda wildcards: as_json(CONFIG.doubtful.of(wildcards.table)),
        places=lambda wildcards: FILES.places_in(wildcards.table),
        excluded=lambda wildcards: excluded(FILES.places_in(wildcards.table)),
        faults=lambda wildcards: faults(FILES.places_in(wildcards.table)),
        made_by=MADE_BY,
    message:
        WITHOUT_EXCLUDED
    run:
        job(
            judge_table,
            output,
            log,
            inputs=dict(rows=input.rows, budget=input.budget),
            arguments=dict(
                name=wildcards.table,
                limits=Limits(**params.limits),
                places=params.places,
                faults=params.faults,
            ),
            left_out=LeftOut(excluded=params.excluded, is_called_anyway=True),
        )


rule campaign_findings:
    """The findings on all trials: as values, which decide, and as a view for people."""
    input:
        table_findings=FILES.findings(*FILES.judged_tables),
        verdicts=QUALITY,
        calibration=FILES.tables("calibration"),
        fitted=FILES.fits_for_findings,
    output:
        findings="<results>/tables/findings.parquet",
        view="<results>/tables/findings.csv",
    log:
        "<logs>/tables/findings.log",
    localrule: True
    params:
        made_by=MADE_BY,
    run:
        job(
            gather_findings,
            output,
            log,
            inputs=dict(
                table_findings_files=input.table_findings,
                verdicts=input.verdicts,
                calibration=input.calibration,
            ),
            arguments=dict(
                data=CAMPAIGN.data,
                findings=Path(output.findings),
                view=Path(output.view),
            ),
            left_out=LeftOut(
                argument="refused",
                also_of=[Path(file) for file in input.fitted],
                is_called_anyway=True,
            ),
        )


rule table:
    """A table from the rows of single trials, or of groups, with the doubts about each row."""
    input:
        lambda wildcards: FILES.checks(FILES.places_in(wildcards.table)),
        rows=lambda wildcards: FILES.rows(wildcards.table),
        findings=lambda wildcards: FILES.findings(wildcards.table),
    output:
        output="<results>/tables/{table}.csv",
    log:
        "<logs>/tables/{table}.log",
    wildcard_constraints:
        table=name_pattern([*FILES.gathered_tables, GROUPS]),
    localrule: True
    params:
        places=lambda wildcards: FILES.places_in(wildcards.table),
        excluded=lambda wildcards: excluded(FILES.places_in(wildcards.table)),
        made_by=MADE_BY,
    message:
        WITHOUT_EXCLUDED
    run:
        job(
            gather,
            output,
            log,
            inputs=dict(rows=input.rows, findings=input.findings),
            arguments=dict(name=wildcards.table, places=params.places),
            left_out=LeftOut(excluded=params.excluded, argument="not_analysed"),
        )


rule summary_table:
    """A table that is computed from another one alone, without its doubtful estimates."""
    input:
        table=lambda wildcards: f"<results>/tables/{DERIVED[wildcards.table]}.csv",
        findings=lambda wildcards: FILES.findings(DERIVED[wildcards.table]),
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
            inputs=dict(table=input.table, findings=input.findings),
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
        findings=FILES.findings(*FILES.claimed_tables),
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
            inputs=dict(
                tables=by_name(input.tables), claims=input.claims, findings=input.findings
            ),
        )


rule settings_table:
    """The settings that judge or label results, and whether they are stated or assumed."""
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
    """The trials that are not used, with their reasons."""
    input:
        fitted=FILES.files_of_single_trials,
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


rule headline_numbers:
    """The numbers of the paper's text, for programs and for LaTeX."""
    input:
        table_paths=FILES.all_tables,
        trials=expand("<results>/trials/{trial}.parquet", trial=TRIALS),
        excluded="<results>/tables/excluded.csv",
        findings="<results>/tables/findings.parquet",
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
                files=HeadlineFiles(
                    tables=by_name(input.table_paths),
                    trials=input.trials,
                    excluded=input.excluded,
                    verdicts=input.verdicts,
                    findings=input.findings,
                ),
            ),
            arguments=dict(
                facts=HeadlineFacts(
                    about=params.about,
                    beside_draft=params.beside_draft,
                    settings=params.settings,
                    stated=params.stated,
                    changed=params.changed,
                ),
                sheet=params.sheet,
                summary_json=Path(output.summary_json),
                numbers_tex=Path(output.numbers_tex),
            ),
            left_out=LeftOut(argument="refused", is_called_anyway=True),
        )


rule table_for_paper:
    """K, B and I of each condition or group of crossings, or the measured components."""
    input:
        tables=lambda wildcards: FILES.for_paper[wildcards.name],
        findings=lambda wildcards: FILES.findings(*ON_PAPER[wildcards.name]),
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
            inputs=dict(
                tables=by_name(input.tables),
                findings=input.findings,
                parameters=input.parameters or None,
            ),
            arguments=dict(
                about=params.about,
                beside_draft=params.beside_draft,
                tex=Path(output.tex),
                markdown=Path(output.markdown),
            ),
        )
