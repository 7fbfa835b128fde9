"""Tables -> the numbers that a figure plots (CSV) -> the figure; all of it -> `report.html`."""


rule plot_numbers:
    """What a figure plots that shows one table, or up to three."""
    input:
        table=lambda wildcards: f"<results>/tables/{FIGURES[wildcards.figure].table}.csv",
        evidence=lambda wildcards: evidence_of(FIGURES[wildcards.figure].table),
        second=table_beside(0),
        third=table_beside(1),
    output:
        "<results>/figures/{figure}.csv",
    log:
        "<logs>/figures/{figure}_numbers.log",
    wildcard_constraints:
        figure="|".join(figure for figure in FIGURES if figure not in OWN_NUMBERS),
    localrule: True
    params:
        name="{figure}",
        option=option,
        made_by=MADE_BY,
    run:
        job("figure.plot_numbers", input, output, params, log)


rule fig3_numbers:
    """Torque against deflection of the belt, by trial."""
    input:
        curves=rows("belt_curves"),
        table="<results>/tables/belt.csv",
        summary="<results>/tables/belt_summary.csv",
        quality=checks(CAMPAIGN.trials("belt")),
    output:
        "<results>/figures/fig3.csv",
    log:
        "<logs>/figures/fig3_numbers.log",
    localrule: True
    params:
        excluded=lambda wildcards: excluded(CAMPAIGN.trials("belt")),
        made_by=MADE_BY,
    run:
        job("figure.fig3", input, output, params, log)


if TIME_SERIES:

    rule fig4_numbers:
        """The last seconds of one impedance trial, measured and modelled."""
        input:
            trial=f"<results>/trials/{TIME_SERIES['trial']}.parquet",
            fit=rows("impedance", [TIME_SERIES["trial"]]),
            quality=checks([TIME_SERIES["trial"]]),
        output:
            "<results>/figures/fig4.csv",
        log:
            "<logs>/figures/fig4_numbers.log",
        localrule: True
        params:
            settings=CONFIG.dynamometer.part("ImpedanceAnalysis"),
            choice=TIME_SERIES,
            limits=limits("impedance"),
            windows=CAMPAIGN.row(TIME_SERIES["trial"])["windows"],
            excluded=lambda wildcards: excluded([TIME_SERIES["trial"]]),
            made_by=MADE_BY,
        run:
            job("figure.fig4", input, output, params, log)


rule fig7_numbers:
    """Measured frequency responses beside the desired one and the linear model."""
    input:
        table=f"<results>/tables/{FIGURES['fig7'].table}.csv",
        parameters=PARAMETERS,
    output:
        "<results>/figures/fig7.csv",
    log:
        "<logs>/figures/fig7_numbers.log",
    localrule: True
    params:
        weight=plain(CONFIG.gain_weight),
        choice=plain(RESPONSE),
        made_by=MADE_BY,
    run:
        job("figure.fig7", input, output, params, log)


rule walking_page_numbers:
    """Angle and torque of perturbed and unperturbed crossings over time."""
    input:
        table="<results>/tables/walking.csv",
        responses="<results>/tables/walking_responses.csv",
        selection="<results>/tables/walking_crossings.csv",
        unperturbed="<results>/fits/unperturbed.parquet",
        crossings=expand("<results>/crossings/{trial}.parquet", trial=PERTURBED),
        quality=checks(PERTURBED),
    output:
        "<results>/figures/walking_page.csv",
    log:
        "<logs>/figures/walking_page_numbers.log",
    localrule: True
    params:
        settings=CONFIG.walking.part("TimingSettings"),
        excluded=lambda wildcards: excluded(PERTURBED),
        made_by=MADE_BY,
    run:
        job("figure.plot_walking_page", input, output, params, log)


rule over_stance_numbers:
    """The identified impedance beside the commanded one over stance."""
    input:
        table="<results>/tables/impedance_over_stance.csv",
        trajectory=TRAJECTORY,
    output:
        "<results>/figures/impedance_over_stance.csv",
    log:
        "<logs>/figures/impedance_over_stance_numbers.log",
    localrule: True
    params:
        stance_share=CONFIG.figures.stance_share,
        data=CAMPAIGN.data,
        made_by=MADE_BY,
    run:
        job("figure.plot_over_stance", input, output, params, log)


rule draw_figure:
    """The figure as PDF, SVG and PNG, or a page that says why it is not drawn."""
    input:
        table_csv="<results>/figures/{figure}.csv",
        fitted=lambda wildcards: shown(wildcards.figure),
    output:
        "<results>/figures/{figure}.pdf",
        report("<results>/figures/{figure}.svg", category="Figures"),
        "<results>/figures/{figure}.png",
    log:
        "<logs>/figures/{figure}.log",
    localrule: True
    params:
        name="{figure}",
        origin=sentence(ABOUT, below_figure=True),
        footer=CONFIG.figures.footer,
        made_by=MADE_BY,
    run:
        job("figure.draw_figure", input, output, params, log)


rule captions:
    """A caption for each figure, or why it is not drawn."""
    input:
        fitted=[
            *expand("<results>/figures/{figure}.csv", figure=FIGURE_NAMES),
            *(file for figure in FIGURE_NAMES for file in shown(figure)),
        ],
    output:
        "<results>/figures/captions.md",
    log:
        "<logs>/figures/captions.log",
    localrule: True
    params:
        tables={figure: place(f"<results>/figures/{figure}.csv") for figure in FIGURE_NAMES},
        shown={figure: [place(file) for file in shown(figure)] for figure in FIGURE_NAMES},
        footer=sentence(ABOUT),
        made_by=MADE_BY,
    run:
        job("figure.write_captions", input, output, params, log)


rule report_page:
    """The page of the run: every number, figure and trial; and the text of its methods."""
    input:
        trials=expand("<results>/trials/{trial}.parquet", trial=TRIALS),
        series=rows("series"),
        crossings=expand("<results>/crossings/{trial}.parquet", trial=list(WALKED)),
        tables=TABLES + (["<results>/tables/walking_responses.csv"] if WALKED else []),
        figures=expand("<results>/figures/{figure}.svg", figure=FIGURE_NAMES),
        numbers=expand("<results>/figures/{figure}.csv", figure=FIGURE_NAMES),
        captions=CAPTIONS,
        verdicts=QUALITY,
        excluded="<results>/tables/excluded.csv",
        findings="<results>/tables/findings.csv",
        states="<results>/tables/settings.csv",
        summary="<results>/summary.json",
    output:
        output="<results>/report.html",
        methods_md="<results>/methods.md",
        methods_tex="<results>/methods.tex",
        methods_bib="<results>/methods.bib",
    log:
        "<logs>/report.log",
    localrule: True
    params:
        about=ABOUT,
        settings={
            name: plain(getattr(CONFIG, name))
            for name in ("dynamometer", "actuator", "torque_angle", "walking", "overground")
        },
        accuracy=plain(CONFIG.doubtful.accuracy),
        sheet={**CAMPAIGN.rows, **CAMPAIGN.unused},
        unnamed=UNNAMED,
        made_by=MADE_BY,
    run:
        job("report.write_report", input, output, params, log)
