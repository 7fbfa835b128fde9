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
        unpack(
            lambda wildcards: job(
                rules.plot_numbers,
                wildcards,
                "figure.plot_numbers",
                (
                    "commands.figure",
                    f"figures.{wildcards.figure}",
                ),
                input={"table": RESULTS / f"tables/{FIGURES[wildcards.figure].table}.csv"},
                settings={
                    "name": wildcards.figure,
                    "option": (option := FIGURES[wildcards.figure].option) and setting(option),
                },
            )
        ),
    output:
        RESULTS / "figures/{figure}.csv",
    log:
        RESULTS / "logs/figures/{figure}_numbers.log",
    wildcard_constraints:
        figure="|".join(name for name, figure in FIGURES.items() if not figure.own_rule),
    shell:
        JOB


rule plot_numbers_fig3:
    input:
        unpack(
            lambda wildcards: job(
                rules.plot_numbers_fig3,
                wildcards,
                "plotted_numbers.fig3",
                input={"table": RESULTS / "tables/belt.csv", "summary": RESULTS / "tables/belt_summary.csv"},
                read={"curves": rows("belt_curves"), "quality": verdicts_on("belt_curves")},
            )
        ),
    output:
        RESULTS / "figures/fig3.csv",
    log:
        RESULTS / "logs/figures/fig3_numbers.log",
    shell:
        JOB


rule plot_numbers_fig4:
    input:
        unpack(
            lambda wildcards: job(
                rules.plot_numbers_fig4,
                wildcards,
                "plotted_numbers.fig4",
                input={
                    "trial": trial_file(TIME_SERIES.trial),
                    "quality": checked([TIME_SERIES.trial]),
                    "fit": rows("impedance", [TIME_SERIES.trial])[0],
                },
                settings={
                    "settings": CONFIG.dynamometer.part("ImpedanceAnalysis"),
                    "choice": TIME_SERIES and asdict(TIME_SERIES),
                    "limits": limits_of("impedance"),
                    "windows": CAMPAIGN.row(TIME_SERIES.trial)["windows"],
                },
            )
        ),
    output:
        RESULTS / "figures/fig4.csv",
    log:
        RESULTS / "logs/figures/fig4_numbers.log",
    shell:
        JOB


rule plot_numbers_fig7:
    input:
        unpack(
            lambda wildcards: job(
                rules.plot_numbers_fig7,
                wildcards,
                "plotted_numbers.fig7",
                input={"table": RESULTS / "tables/frequency_response.csv"},
                files={"parameters": CONFIG.parameters or []},
                settings={
                    "weight": CONFIG.gain_weight.model_dump(mode="json"),
                    "choice": RESPONSE and RESPONSE.model_dump(mode="json"),
                },
            )
        ),
    output:
        RESULTS / "figures/fig7.csv",
    log:
        RESULTS / "logs/figures/fig7_numbers.log",
    shell:
        JOB


rule plot_numbers_fig9:
    input:
        unpack(
            lambda wildcards: job(
                rules.plot_numbers_fig9,
                wildcards,
                "plotted_numbers.fig9",
                input={
                    "table": RESULTS / "tables/walking_summary.csv",
                    "fits": RESULTS / "tables/walking.csv",
                    "over_stance": RESULTS / "tables/impedance_over_stance.csv",
                },
                settings={"commanded_K": CONFIG.figures.midstance_stiffness},
            )
        ),
    output:
        RESULTS / "figures/fig9.csv",
    log:
        RESULTS / "logs/figures/fig9_numbers.log",
    shell:
        JOB


rule plot_numbers_response:
    input:
        unpack(
            lambda wildcards: job(
                rules.plot_numbers_response,
                wildcards,
                "response.plotted_numbers",
                input={
                    "table": RESULTS / "tables/response.csv",
                    "pooled_table": RESULTS / "tables/response_pooled.csv",
                },
            )
        ),
    output:
        RESULTS / "figures/response.csv",
    log:
        RESULTS / "logs/figures/response_numbers.log",
    shell:
        JOB


rule plot_numbers_walking_page:
    input:
        unpack(
            lambda wildcards: job(
                rules.plot_numbers_walking_page,
                wildcards,
                "walking_page.plot_walking_page",
                input={
                    "selection": RESULTS / "tables/walking_crossings.csv",
                    "unperturbed": RESULTS / "fits/unperturbed.parquet",
                    "responses": RESULTS / "tables/walking_responses.csv",
                    "table": RESULTS / "tables/walking.csv",
                },
                read=crossed(perturbed=True),
                settings={"settings": CONFIG.walking.part("TimingSettings")},
            )
        ),
    output:
        RESULTS / "figures/walking_page.csv",
    log:
        RESULTS / "logs/figures/walking_page_numbers.log",
    shell:
        JOB


rule plot_numbers_impedance_over_stance:
    input:
        unpack(
            lambda wildcards: job(
                rules.plot_numbers_impedance_over_stance,
                wildcards,
                "walking_page.plot_over_stance",
                input={"table": RESULTS / "tables/impedance_over_stance.csv"},
                files={"trajectory": trajectory()},
                settings={"stance_share": CONFIG.figures.stance_share, "data": CAMPAIGN.data},
            )
        ),
    output:
        RESULTS / "figures/impedance_over_stance.csv",
    log:
        RESULTS / "logs/figures/impedance_over_stance_numbers.log",
    shell:
        JOB


rule plot_numbers_torque_angle:
    input:
        unpack(
            lambda wildcards: job(
                rules.plot_numbers_torque_angle,
                wildcards,
                "plotted_numbers.torque_angle",
                input={
                    "curves": RESULTS / "tables/torque_angle_curves.csv",
                    "table": RESULTS / "tables/torque_angle.csv",
                },
            )
        ),
    output:
        RESULTS / "figures/torque_angle.csv",
    log:
        RESULTS / "logs/figures/torque_angle_numbers.log",
    shell:
        JOB


rule draw_figure:
    input:
        unpack(
            lambda wildcards: job(
                rules.draw_figure,
                wildcards,
                "figure.draw_figure",
                (
                    "commands.figure",
                    "figures.names",
                    f"figures.{wildcards.figure}",
                ),
                input={"table_csv": RESULTS / f"figures/{wildcards.figure}.csv"},
                read={"fitted": shown_rows(wildcards.figure)},
                settings={"name": wildcards.figure, "footer": ABOUT.of_figure()},
            )
        ),
    output:
        multiext(str(RESULTS / "figures/{figure}"), *(f".{suffix}" for suffix in SUFFIXES)),
    log:
        RESULTS / "logs/figures/{figure}.log",
    shell:
        JOB


rule captions:
    input:
        unpack(
            lambda wildcards: job(
                rules.captions,
                wildcards,
                "figure.write_captions",
                (
                    "commands.figure",
                    *(f"figures.{name}" for name in drawn_names()),
                ),
                input={"fitted": [RESULTS / f"figures/{name}.csv" for name in drawn_names()]},
                read={"shown": {name: shown_rows(name) for name in drawn_names()}},
                settings={
                    "tables": {name: str(RESULTS / f"figures/{name}.csv") for name in drawn_names()},
                    "footer": ABOUT.sentence(),
                },
            )
        ),
    output:
        RESULTS / "figures/captions.md",
    log:
        RESULTS / "logs/figures/captions.log",
    shell:
        JOB
