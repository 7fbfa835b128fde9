"""Tables -> the numbers that a figure plots (CSV) -> the figure."""

SUFFIXES = ("pdf", "svg", "png")


def setting(name: str):
    """A setting of the configuration by its dotted name."""
    return attrgetter(name)(CONFIG)


def drawn_names() -> list[str]:
    """The names of the figures that the campaign's tables and settings give."""
    tables = {path.stem for path in result_tables()} - ({"model_comparison"} if not IS_PREDICTED else set())
    return [figure.name for figure in drawn_figures(tables, setting)]


def drawn_files() -> list[Path]:
    """Every figure of the campaign, in each format, and its numbers; the captions, if there is any."""
    files = [RESULTS / f"figures/{name}.{suffix}" for name in drawn_names() for suffix in ("csv", *SUFFIXES)]
    return [*files, RESULTS / "figures/captions.md"] if files else []


def shown_rows(figure: str) -> list[Path]:
    """The results of single trials that a figure shows; those that are missing are named below it."""
    if figure == "fig4":
        return []  # one trial, without which it is not drawn
    if figure == "fig7":
        asked = {} if RESPONSE is None else {"K_d": RESPONSE.K_d, "B_d": RESPONSE.B_d}
        return rows("phasors", matching(CAMPAIGN, asked))
    return rows_behind(FIGURES[figure].table)


rule plot_numbers:
    input:
        table=lambda wildcards: RESULTS / f"tables/{FIGURES[wildcards.figure].table}.csv",
    output:
        RESULTS / "figures/{figure}.csv",
    log:
        RESULTS / "logs/figures/{figure}_numbers.log",
    wildcard_constraints:
        figure="|".join(name for name, figure in FIGURES.items() if not figure.own_rule),
    params:
        code=lambda wildcards: jobs.code("commands.figure", f"figures.{wildcards.figure}"),
        name="{figure}",
        option=lambda wildcards: (option := FIGURES[wildcards.figure].option) and setting(option),
    run:
        jobs.run_job(log, "figure.plot_numbers", input, output, params)


rule plot_numbers_fig3:
    input:
        table=RESULTS / "tables/belt.csv",
        summary=RESULTS / "tables/belt_summary.csv",
    output:
        RESULTS / "figures/fig3.csv",
    log:
        RESULTS / "logs/figures/fig3_numbers.log",
    params:
        code=jobs.code_of("plotted_numbers.fig3"),
    run:
        read = {"curves": rows("belt_curves"), "quality": verdicts_on("belt_curves")}
        jobs.run_job(log, "plotted_numbers.fig3", input, output, params, read=read)


rule plot_numbers_fig4:
    input:
        trial=lambda wildcards: trial_file(TIME_SERIES.trial),
        quality=lambda wildcards: checked([TIME_SERIES.trial]),
        fit=lambda wildcards: rows("impedance", [TIME_SERIES.trial])[0],
    output:
        RESULTS / "figures/fig4.csv",
    log:
        RESULTS / "logs/figures/fig4_numbers.log",
    params:
        code=jobs.code_of("plotted_numbers.fig4"),
        settings=CONFIG.dynamometer.part("ImpedanceAnalysis"),
        choice=TIME_SERIES and asdict(TIME_SERIES),
        limits=limits_of("impedance"),
        windows=lambda wildcards: CAMPAIGN.row(TIME_SERIES.trial)["windows"],
    run:
        jobs.run_job(log, "plotted_numbers.fig4", input, output, params)


rule plot_numbers_fig7:
    input:
        table=RESULTS / "tables/frequency_response.csv",
        parameters=CONFIG.parameters or [],
    output:
        RESULTS / "figures/fig7.csv",
    log:
        RESULTS / "logs/figures/fig7_numbers.log",
    params:
        code=jobs.code_of("plotted_numbers.fig7"),
        weight=CONFIG.gain_weight.model_dump(mode="json"),
        choice=RESPONSE and RESPONSE.model_dump(mode="json"),
    run:
        jobs.run_job(log, "plotted_numbers.fig7", input, output, params)


rule plot_numbers_fig9:
    input:
        table=RESULTS / "tables/walking_summary.csv",
        fits=RESULTS / "tables/walking.csv",
        over_stance=RESULTS / "tables/impedance_over_stance.csv",
    output:
        RESULTS / "figures/fig9.csv",
    log:
        RESULTS / "logs/figures/fig9_numbers.log",
    params:
        code=jobs.code_of("plotted_numbers.fig9"),
        commanded_K=CONFIG.figures.midstance_stiffness,
    run:
        jobs.run_job(log, "plotted_numbers.fig9", input, output, params)


rule plot_numbers_response:
    input:
        table=RESULTS / "tables/response.csv",
        pooled_table=RESULTS / "tables/response_pooled.csv",
    output:
        RESULTS / "figures/response.csv",
    log:
        RESULTS / "logs/figures/response_numbers.log",
    params:
        code=jobs.code_of("response.plotted_numbers"),
    run:
        jobs.run_job(log, "response.plotted_numbers", input, output, params)


rule plot_numbers_walking_page:
    input:
        selection=RESULTS / "tables/walking_crossings.csv",
        unperturbed=RESULTS / "fits/unperturbed.parquet",
        responses=RESULTS / "tables/walking_responses.csv",
        table=RESULTS / "tables/walking.csv",
    output:
        RESULTS / "figures/walking_page.csv",
    log:
        RESULTS / "logs/figures/walking_page_numbers.log",
    params:
        code=jobs.code_of("walking_page.plot_walking_page"),
        settings=CONFIG.walking.part("TimingSettings"),
    run:
        jobs.run_job(log, "walking_page.plot_walking_page", input, output, params, read=crossed(perturbed=True))


rule plot_numbers_impedance_over_stance:
    input:
        table=RESULTS / "tables/impedance_over_stance.csv",
        trajectory=[CONFIG.impedance_trajectory] if CONFIG.impedance_trajectory else [],
    output:
        RESULTS / "figures/impedance_over_stance.csv",
    log:
        RESULTS / "logs/figures/impedance_over_stance_numbers.log",
    params:
        code=jobs.code_of("walking_page.plot_over_stance"),
        stance_share=CONFIG.figures.stance_share,
        data=CAMPAIGN.data,
    run:
        jobs.run_job(log, "walking_page.plot_over_stance", input, output, params)


rule plot_numbers_torque_angle:
    input:
        curves=RESULTS / "tables/torque_angle_curves.csv",
        table=RESULTS / "tables/torque_angle.csv",
    output:
        RESULTS / "figures/torque_angle.csv",
    log:
        RESULTS / "logs/figures/torque_angle_numbers.log",
    params:
        code=jobs.code_of("torque_angle.plotted_numbers"),
    run:
        jobs.run_job(log, "torque_angle.plotted_numbers", input, output, params)


rule draw_figure:
    input:
        table_csv=RESULTS / "figures/{figure}.csv",
    output:
        multiext(str(RESULTS / "figures/{figure}"), *(f".{suffix}" for suffix in SUFFIXES)),
    log:
        RESULTS / "logs/figures/{figure}.log",
    group:
        "figures"
    params:
        code=lambda wildcards: jobs.code("commands.figure", "figures.names", f"figures.{wildcards.figure}"),
        name="{figure}",
        footer=ABOUT.sentence(),
    run:
        read = {"fitted": shown_rows(wildcards.figure)}
        jobs.run_job(log, "figure.draw_figure", input, output, params, read=read)


rule captions:
    input:
        fitted=lambda wildcards: [RESULTS / f"figures/{name}.csv" for name in drawn_names()],
    output:
        RESULTS / "figures/captions.md",
    log:
        RESULTS / "logs/figures/captions.log",
    params:
        code=lambda wildcards: jobs.code("commands.figure", *(f"figures.{name}" for name in drawn_names())),
        tables=lambda wildcards: {name: str(RESULTS / f"figures/{name}.csv") for name in drawn_names()},
        footer=ABOUT.sentence(),
    run:
        read = {"shown": {name: shown_rows(name) for name in drawn_names()}}
        jobs.run_job(log, "figure.write_captions", input, output, params, read=read)
