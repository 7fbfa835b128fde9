# SPDX-License-Identifier: Apache-2.0
"""Tables -> the numbers that a figure plots (CSV) -> the figure; all of it -> `report.html`."""

from osl_analysis.campaign.configuration import FrequencyResponseFigure
from osl_analysis.commands.figure import (
    draw_figure,
    fig3,
    fig4,
    fig7,
    plot_numbers,
    plot_walking_page,
    write_captions,
)
from osl_analysis.commands.report import (
    MethodsOutputs,
    ReportFiles,
    write_brief,
    write_methods,
    write_report,
)
from osl_analysis.commands.run import end_run
from osl_analysis.model.compensator import Weight
from osl_analysis.walking.walking_settings import TimingSettings

OWN_NUMBERS = ("fig3", "fig4", "fig7", "walking_page")
"""Figures whose numbers have a rule of their own; each of the others shows one to three tables."""
NUMBERS_OF_FIGURES = {name: f"{CONFIG.results}/figures/{name}.csv" for name in FILES.figure_names}


rule plot_numbers:
    """The plotted numbers of a figure that shows one to three tables."""
    input:
        table=lambda wildcards: f"<results>/tables/{FIGURES[wildcards.figure].table}.csv",
        further_tables=lambda wildcards: expand(
            "<results>/tables/{table}.csv", table=FIGURES[wildcards.figure].further_tables
        ),
        findings=lambda wildcards: FILES.findings(
            FIGURES[wildcards.figure].table, *FIGURES[wildcards.figure].further_tables
        ),
    output:
        output="<results>/figures/{figure}.csv",
    log:
        "<logs>/figures/{figure}_numbers.log",
    wildcard_constraints:
        figure=name_pattern(figure for figure in FIGURES if figure not in OWN_NUMBERS),
    localrule: True
    params:
        option=figure_setting,
        made_by=MADE_BY,
    run:
        job(
            plot_numbers,
            output,
            log,
            inputs=dict(
                table=input.table, further_tables=input.further_tables, findings=input.findings
            ),
            arguments=dict(name=wildcards.figure, option=params.option),
        )


rule fig3_numbers:
    """Torque against deflection of the belt, by trial."""
    input:
        FILES.checks(CAMPAIGN.trials("belt")),
        curves=FILES.rows("belt_curves"),
        table="<results>/tables/belt.csv",
        findings=FILES.findings("belt"),
        summary="<results>/tables/belt_summary.csv",
    output:
        output="<results>/figures/fig3.csv",
    log:
        "<logs>/figures/fig3_numbers.log",
    localrule: True
    params:
        excluded=lambda wildcards: excluded(CAMPAIGN.trials("belt")),
        made_by=MADE_BY,
    message:
        WITHOUT_EXCLUDED
    run:
        job(
            fig3,
            output,
            log,
            inputs=dict(
                curves=input.curves,
                table=input.table,
                findings=input.findings,
                summary=input.summary,
            ),
            left_out=LeftOut(excluded=params.excluded),
        )


if TIME_SERIES:

    rule fig4_numbers:
        """Ten seconds of one impedance trial, measured and modelled."""
        input:
            FILES.checks(TIME_SERIES.trials),
            series=expand("<results>/fits/impedance/{trial}.zip", trial=TIME_SERIES.trials),
            table="<results>/tables/impedance.csv",
            findings=FILES.findings("impedance"),
        output:
            output="<results>/figures/fig4.csv",
        log:
            "<logs>/figures/fig4_numbers.log",
        localrule: True
        params:
            chosen=TIME_SERIES.chosen,
            excluded=lambda wildcards: excluded(TIME_SERIES.trials),
            made_by=MADE_BY,
        message:
            WITHOUT_EXCLUDED
        run:
            job(
                fig4,
                output,
                log,
                inputs=dict(series=input.series, table=input.table, findings=input.findings),
                arguments=dict(chosen=params.chosen),
                left_out=LeftOut(excluded=params.excluded),
            )


rule fig7_numbers:
    """Measured frequency responses beside the desired one and the linear model."""
    input:
        table=f"<results>/tables/{FIGURES['fig7'].table}.csv",
        findings=FILES.findings(FIGURES["fig7"].table),
        parameters=PARAMETERS,
    output:
        output="<results>/figures/fig7.csv",
    log:
        "<logs>/figures/fig7_numbers.log",
    localrule: True
    params:
        weight=as_json(CONFIG.gain_weight),
        choice=as_json(response_example(CAMPAIGN)),
        made_by=MADE_BY,
    run:
        job(
            fig7,
            output,
            log,
            inputs=dict(
                table=input.table,
                findings=input.findings,
                parameters=input.parameters or None,
            ),
            arguments=dict(
                weight=Weight(**params.weight),
                choice=FrequencyResponseFigure(**params.choice) if params.choice else None,
            ),
        )


rule walking_page_numbers:
    """Angle and torque of perturbed and unperturbed crossings over time."""
    input:
        FILES.checks(PERTURBED),
        table="<results>/tables/walking.csv",
        findings=FILES.findings("walking"),
        responses="<results>/tables/walking_responses.csv",
        selection="<results>/tables/walking_crossings.csv",
        unperturbed="<results>/fits/unperturbed.json",
        crossings=FILES.crossings(PERTURBED),
    output:
        output="<results>/figures/walking_page.csv",
    log:
        "<logs>/figures/walking_page_numbers.log",
    localrule: True
    params:
        settings=CONFIG.walking.part(TimingSettings),
        excluded=lambda wildcards: excluded(PERTURBED),
        made_by=MADE_BY,
    message:
        WITHOUT_EXCLUDED
    run:
        job(
            plot_walking_page,
            output,
            log,
            inputs=dict(
                crossings=input.crossings,
                selection=input.selection,
                unperturbed=input.unperturbed,
                responses=input.responses,
                table=input.table,
                findings=input.findings,
            ),
            arguments=dict(settings=TimingSettings(**params.settings)),
            left_out=LeftOut(excluded=params.excluded),
        )


rule draw_figure:
    """The figure as PDF, SVG and PNG, or a page that says why it is not drawn."""
    input:
        table_csv="<results>/figures/{figure}.csv",
        fitted=lambda wildcards: FILES.results_in_figure(wildcards.figure),
    output:
        outputs=[
            "<results>/figures/{figure}.pdf",
            report("<results>/figures/{figure}.svg", category="Figures"),
            "<results>/figures/{figure}.png",
        ],
    log:
        "<logs>/figures/{figure}.log",
    localrule: True
    params:
        origin=lambda wildcards: sentence(ABOUT, below_figure=True),
        footer=CONFIG.figures.footer,
        made_by=MADE_BY,
    run:
        job(
            draw_figure,
            output,
            log,
            inputs=dict(table_csv=input.table_csv),
            arguments=dict(
                name=wildcards.figure,
                outputs=[Path(file) for file in output.outputs],
                origin=params.origin,
                footer=params.footer,
            ),
            left_out=LeftOut(
                argument="refused",
                also_of=[Path(file) for file in input.fitted],
                is_called_anyway=True,
            ),
        )


rule captions:
    """A caption for each figure, or why it is not drawn."""
    input:
        NUMBERS_OF_FIGURES.values(),
        expand("<results>/figures/{figure}.svg", figure=FILES.figure_names),
    output:
        markdown="<results>/figures/captions.md",
        tex="<results>/figures/captions.tex",
    log:
        "<logs>/figures/captions.log",
    localrule: True
    params:
        tables=NUMBERS_OF_FIGURES,
        footer=lambda wildcards: sentence(ABOUT),
        made_by=MADE_BY,
    run:
        job(
            write_captions,
            output,
            log,
            arguments=dict(
                tables={name: Path(file) for name, file in params.tables.items()},
                footer=params.footer,
                markdown=Path(output.markdown),
                tex=Path(output.tex),
            ),
        )


rule report_page:
    """The page of the run: verdict, conditions, findings, figures and every trial."""
    input:
        NUMBERS_OF_FIGURES.values(),
        trials=expand("<results>/trials/{trial}.parquet", trial=TRIALS),
        series=FILES.rows("series"),
        crossings=FILES.crossings(WALKED),
        tables=FILES.all_tables + (["<results>/tables/walking_responses.csv"] if WALKED else []),
        figures=expand("<results>/figures/{figure}.svg", figure=FILES.figure_names),
        verdicts=QUALITY,
        excluded="<results>/tables/excluded.csv",
        findings="<results>/tables/findings.parquet",
        states="<results>/tables/settings.csv",
        summary="<results>/summary.json",
    output:
        output="<results>/report.html",
    log:
        "<logs>/report.log",
    localrule: True
    params:
        about=ABOUT,
        sheet=CAMPAIGN.sheet,
        left_out=lambda wildcards: LEFT_OUT,
        made_by=MADE_BY,
    run:
        job(
            write_report,
            output,
            log,
            inputs=dict(
                files=ReportFiles(
                    trials=by_name(input.trials),
                    series=by_name(input.series),
                    crossings=by_name(input.crossings),
                    tables=by_name(input.tables),
                    figures=by_name(input.figures),
                    verdicts=input.verdicts,
                    excluded=input.excluded,
                    findings=input.findings,
                    states=input.states,
                    summary=input.summary,
                ),
            ),
            arguments=dict(
                about=params.about,
                sheet=params.sheet,
                left_out=params.left_out,
                output=Path(output.output),
            ),
            left_out=LeftOut(argument="refused", is_called_anyway=True),
        )


rule methods:
    """The text of a methods section."""
    input:
        tables=FILES.all_tables,
        summary="<results>/summary.json",
        captures=expand("<results>/trials/{trial}.parquet", trial=[*WALKED][:1]),
    output:
        markdown="<results>/methods.md",
        tex="<results>/methods.tex",
        bib="<results>/methods.bib",
    log:
        "<logs>/methods.log",
    localrule: True
    params:
        about=ABOUT,
        settings=as_json(CONFIG),
        sheet=CAMPAIGN.rows,
        made_by=MADE_BY,
    run:
        job(
            write_methods,
            output,
            log,
            inputs=dict(
                tables=by_name(input.tables), summary=input.summary, captures=input.captures
            ),
            arguments=dict(
                about=params.about,
                settings=params.settings,
                sheet=params.sheet,
                outputs=MethodsOutputs(
                    markdown=Path(output.markdown),
                    tex=Path(output.tex),
                    bib=Path(output.bib),
                ),
            ),
        )


rule brief:
    """The lines at the end of a run."""
    input:
        summary="<results>/summary.json",
        excluded="<results>/tables/excluded.csv",
        page="<results>/report.html",
    output:
        output="<results>/brief.txt",
    log:
        "<logs>/brief.log",
    localrule: True
    params:
        recordings={trial: [str(log) for log in CAMPAIGN.logs(trial)] for trial in TRIALS},
        left_out=lambda wildcards: LEFT_OUT,
        failed_trials=CONFIG.failed_trials,
        made_by=MADE_BY,
    run:
        job(
            write_brief,
            output,
            log,
            inputs=dict(summary=input.summary, excluded=input.excluded, page=input.page),
            arguments=dict(
                recordings=params.recordings,
                left_out=params.left_out,
                failed_trials=params.failed_trials,
                output=Path(output.output),
            ),
        )


rule verdict:
    """Fail the run where trials could not be analysed, unless the configuration accepts it."""
    input:
        summary="<results>/summary.json",
        brief=shown_at_the_end(f"{CONFIG.results}/brief.txt"),
    output:
        verdict="<results>/verdict.txt",
    log:
        "<logs>/verdict.log",
    localrule: True
    params:
        failed_trials=CONFIG.failed_trials,
        made_by=MADE_BY,
    run:
        job(
            end_run,
            output,
            log,
            inputs=dict(summary=input.summary, brief=input.brief),
            arguments=dict(failed_trials=params.failed_trials, verdict=Path(output.verdict)),
        )
