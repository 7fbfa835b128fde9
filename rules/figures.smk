# SPDX-License-Identifier: Apache-2.0
"""Tables -> the numbers that a figure plots (CSV) -> the figure; all of it -> `report.html`."""

from osl_analysis.commands.figure import (
    draw_figure,
    fig3,
    fig4,
    fig7,
    plot_numbers,
    plot_walking_page,
    write_captions,
)
from osl_analysis.commands.report import write_brief, write_methods, write_report
from osl_analysis.commands.run import end_run

OWN_NUMBERS = ("fig3", "fig4", "fig7", "walking_page")
"""Figures whose numbers have a rule of their own; each of the others shows one to three tables."""
NUMBERS_OF_FIGURES = {name: f"{CONFIG.results}/figures/{name}.csv" for name in FILES.figure_names}


rule plot_numbers:
    """What a figure plots that shows one table, or up to three."""
    input:
        table=lambda wildcards: f"<results>/tables/{FIGURES[wildcards.figure].table}.csv",
        others=lambda wildcards: expand(
            "<results>/tables/{table}.csv", table=FIGURES[wildcards.figure].beside
        ),
    output:
        output="<results>/figures/{figure}.csv",
    log:
        "<logs>/figures/{figure}_numbers.log",
    wildcard_constraints:
        figure=name_pattern(figure for figure in FIGURES if figure not in OWN_NUMBERS),
    localrule: True
    params:
        name="{figure}",
        option=figure_setting,
        made_by=MADE_BY,
    run:
        job(plot_numbers, input, output, params, log)


rule fig3_numbers:
    """Torque against deflection of the belt, by trial."""
    input:
        FILES.checks(CAMPAIGN.trials("belt")),
        curves=FILES.rows("belt_curves"),
        table="<results>/tables/belt.csv",
        summary="<results>/tables/belt_summary.csv",
    output:
        output="<results>/figures/fig3.csv",
    log:
        "<logs>/figures/fig3_numbers.log",
    localrule: True
    params:
        excluded=lambda wildcards: excluded(CAMPAIGN.trials("belt")),
        made_by=MADE_BY,
    run:
        job(fig3, input, output, params, log)


if TIME_SERIES:

    rule fig4_numbers:
        """The last seconds of one impedance trial, measured and modelled."""
        input:
            FILES.checks([TIME_SERIES["trial"]]),
            series=f"<results>/fits/impedance/{TIME_SERIES['trial']}.zip",
            table="<results>/tables/impedance.csv",
        output:
            output="<results>/figures/fig4.csv",
        log:
            "<logs>/figures/fig4_numbers.log",
        localrule: True
        params:
            chosen=TIME_SERIES["chosen"],
            excluded=lambda wildcards: excluded([TIME_SERIES["trial"]]),
            made_by=MADE_BY,
        run:
            job(fig4, input, output, params, log)


rule fig7_numbers:
    """Measured frequency responses beside the desired one and the linear model."""
    input:
        table=f"<results>/tables/{FIGURES['fig7'].table}.csv",
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
        job(fig7, input, output, params, log)


rule walking_page_numbers:
    """Angle and torque of perturbed and unperturbed crossings over time."""
    input:
        FILES.checks(PERTURBED),
        table="<results>/tables/walking.csv",
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
        settings=CONFIG.walking.part("TimingSettings"),
        excluded=lambda wildcards: excluded(PERTURBED),
        made_by=MADE_BY,
    run:
        job(plot_walking_page, input, output, params, log)


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
        name="{figure}",
        origin=lambda wildcards: sentence(ABOUT, below_figure=True),
        footer=CONFIG.figures.footer,
        made_by=MADE_BY,
    run:
        job(draw_figure, input, output, params, log, "refused")


rule captions:
    """A caption for each figure, or why it is not drawn."""
    input:
        NUMBERS_OF_FIGURES.values(),
        expand("<results>/figures/{figure}.svg", figure=FILES.figure_names),
    output:
        output="<results>/figures/captions.md",
    log:
        "<logs>/figures/captions.log",
    localrule: True
    params:
        tables=NUMBERS_OF_FIGURES,
        footer=lambda wildcards: sentence(ABOUT),
        made_by=MADE_BY,
    run:
        job(write_captions, input, output, params, log)


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
        findings="<results>/tables/findings.csv",
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
        job(write_report, input, output, params, log, "refused")


rule methods:
    """What the campaign did, as the text of a methods section."""
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
        job(write_methods, input, output, params, log)


rule brief:
    """What a user must know at the end of a run."""
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
        job(write_brief, input, output, params, log)


rule verdict:
    """The run fails where trials could not be analysed, which the configuration does not accept."""
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
        job(end_run, input, output, params, log)
