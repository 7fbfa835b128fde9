"""Tables -> the numbers that a figure plots (CSV) -> the figure, and the headline numbers."""

SUFFIXES = ("pdf", "svg", "png")
TIME_SERIES = CONFIG.figures.time_series
RESPONSE = CONFIG.figures.frequency_response


def setting(name: str):
    """A setting of the configuration by its dotted name."""
    return attrgetter(name)(CONFIG)


def drawn_files() -> list[Path]:
    """Every figure that the campaign's tables and settings give, in each format, and its numbers."""
    tables = {path.stem for path in result_tables()} - ({"model_comparison"} if not held_out() else set())
    return [
        RESULTS / f"figures/{figure.name}.{suffix}"
        for figure in drawn_figures(tables, setting)
        for suffix in ("csv", *SUFFIXES)
    ]


def time_series_trial() -> str:
    """The trial that Fig. 4 shows."""
    return CAMPAIGN.impedance_trial(TIME_SERIES.controller, TIME_SERIES.K_d, TIME_SERIES.B_d)


rule plot_numbers_fig3:
    input:
        curves=fitted("belt_curves"),
        quality=verdicts_on("belt_curves"),
        table=RESULTS / "tables/belt.csv",
        summary=RESULTS / "tables/belt_summary.csv",
    output:
        RESULTS / "figures/fig3.csv",
    log:
        RESULTS / "logs/figures/fig3_numbers.log",
    params:
        code=jobs.code_of("bench.plotted_numbers_fig3"),
    run:
        jobs.run_job(
            log[0],
            "bench.plotted_numbers_fig3",
            curves=kept(input.curves, input.quality),
            table=Path(input.table),
            summary=Path(input.summary),
            output=Path(output[0]),
        )


rule plot_numbers_fig4:
    input:
        trial=lambda wildcards: RESULTS / f"trials/{time_series_trial()}.parquet",
        quality=lambda wildcards: checked([time_series_trial()]),
        fit=lambda wildcards: RESULTS / f"fits/impedance/{time_series_trial()}.csv",
    output:
        RESULTS / "figures/fig4.csv",
    log:
        RESULTS / "logs/figures/fig4_numbers.log",
    params:
        code=jobs.code_of("bench.plotted_numbers_fig4"),
        settings=DYNAMOMETER,
        choice=TIME_SERIES and TIME_SERIES.model_dump(mode="json"),
        limits=CONFIG.doubtful.of("impedance").model_dump(mode="json"),
    run:
        jobs.run_job(
            log[0],
            "bench.plotted_numbers_fig4",
            trial=kept([input.trial], input.quality)[0],
            fit=Path(input.fit),
            settings=dynamometer_settings(params),
            choice=TIME_SERIES,
            limits=doubt_limits(params),
            output=Path(output[0]),
        )


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
        code=jobs.code("commands.figure"),
        figure=lambda wildcards: jobs.code(f"figures.{wildcards.figure}"),
        option=lambda wildcards: (option := FIGURES[wildcards.figure].option) and setting(option),
    run:
        jobs.run_job(
            log[0],
            "figure.plot_numbers",
            name=wildcards.figure,
            table=Path(input.table),
            option=params.option,
            output=Path(output[0]),
        )


rule plot_numbers_fig7:
    input:
        table=RESULTS / "tables/frequency_response.csv",
        parameters=CONFIG.parameters,
    output:
        RESULTS / "figures/fig7.csv",
    log:
        RESULTS / "logs/figures/fig7_numbers.log",
    params:
        code=jobs.code_of("bench.plotted_numbers_fig7"),
        weight=WEIGHT,
        choice=RESPONSE and RESPONSE.model_dump(mode="json"),
        frequencies_hz=CONFIG.dynamometer.frequencies_hz,
    run:
        jobs.run_job(
            log[0],
            "bench.plotted_numbers_fig7",
            table=Path(input.table),
            parameters=Path(input.parameters),
            weight=gain_weight(params),
            frequencies_hz=params.frequencies_hz,
            choice=RESPONSE,
            output=Path(output[0]),
        )


rule plot_numbers_walking_page:
    input:
        crossings=crossings(perturbed=True),
        quality=checked(CAMPAIGN.crossings(perturbed=True)),
        selection=RESULTS / "tables/walking_crossings.csv",
        unperturbed=RESULTS / "fits/unperturbed.parquet",
        responses=RESULTS / "tables/walking_responses.csv",
        table=RESULTS / "tables/walking.csv",
    output:
        RESULTS / "figures/walking_page.csv",
    log:
        RESULTS / "logs/figures/walking_page_numbers.log",
    params:
        code=jobs.code("commands.walking"),
        settings=WALKING,
    run:
        jobs.run_job(
            log[0],
            "walking.plot_walking_page",
            crossings=kept(input.crossings, input.quality),
            selection=Path(input.selection),
            unperturbed=Path(input.unperturbed),
            responses=Path(input.responses),
            table=Path(input.table),
            settings=walking_settings(params),
            output=Path(output[0]),
        )


rule draw_figure:
    input:
        table=RESULTS / "figures/{figure}.csv",
    output:
        multiext(str(RESULTS / "figures/{figure}"), *(f".{suffix}" for suffix in SUFFIXES)),
    log:
        RESULTS / "logs/figures/{figure}.log",
    params:
        code=jobs.code("commands.figure"),
        figure=lambda wildcards: jobs.code(f"figures.{wildcards.figure}"),
    run:
        jobs.run_job(
            log[0],
            "figure.draw_figure",
            name=wildcards.figure,
            table_csv=Path(input.table),
            outputs=[Path(p) for p in output],
        )


rule headline_numbers:
    input:
        tables=result_tables(),
    output:
        summary=RESULTS / "summary.json",
        macros=RESULTS / "numbers.tex",
    log:
        RESULTS / "logs/summary.log",
    params:
        code=jobs.code("commands.summarise"),
        campaign=CONFIG.campaign,
    run:
        jobs.run_job(
            log[0],
            "summarise.write_summary",
            campaign=params.campaign,
            table_paths={Path(p).stem: Path(p) for p in input.tables},
            summary_json=Path(output.summary),
            numbers_tex=Path(output.macros),
        )
