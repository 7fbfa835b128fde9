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


def plotted(command: str, name: str, **constraints):
    """The step that writes the numbers of a figure."""
    return step(command, RESULTS / f"figures/{name}.csv", f"figures/{name}_numbers", **constraints)


@plotted(
    "figure.plot_numbers",
    "{figure}",
    figure="|".join(name for name, figure in FIGURES.items() if not figure.own_rule),
)
def plot_numbers(wildcards):
    figure = FIGURES[wildcards.figure]
    return {
        "modules": (f"figures.{figure.module}",),
        "input": {"table": tabled(figure.table)},
        "settings": {"name": figure.name, "option": figure.option and setting(figure.option)},
    }


@plotted("figure.fig3", "fig3")
def plot_numbers_fig3(_):
    return {
        "input": {"table": tabled("belt"), "summary": tabled("belt_summary")},
        "read": {"curves": rows("belt_curves"), "quality": verdicts_on("belt_curves")},
    }


@plotted("figure.fig4", "fig4")
def plot_numbers_fig4(_):
    trial = TIME_SERIES.trial
    return {
        "input": {"trial": trial_file(trial), "quality": checked([trial]), "fit": rows("impedance", [trial])[0]},
        "settings": {
            "settings": CONFIG.dynamometer.part("ImpedanceAnalysis"),
            "choice": asdict(TIME_SERIES),
            "limits": limits_of("impedance"),
            "windows": CAMPAIGN.row(trial)["windows"],
        },
    }


@plotted("figure.fig7", "fig7")
def plot_numbers_fig7(_):
    choice = RESPONSE and RESPONSE.model_dump(mode="json")
    return {
        "input": {"table": tabled("frequency_response")},
        "files": {"parameters": CONFIG.parameters or []},
        "settings": {"weight": CONFIG.gain_weight.model_dump(mode="json"), "choice": choice},
    }


@plotted("figure.fig9", "fig9")
def plot_numbers_fig9(_):
    tables = {"table": "walking_summary", "fits": "walking", "over_stance": "impedance_over_stance"}
    return {
        "input": {name: tabled(table) for name, table in tables.items()},
        "settings": {"commanded_K": CONFIG.figures.midstance_stiffness},
    }


@plotted("figure.response", "response")
def plot_numbers_response(_):
    return {"input": {"table": tabled("response"), "pooled_table": tabled("response_pooled")}}


@plotted("figure.plot_walking_page", "walking_page")
def plot_numbers_walking_page(_):
    return {
        "input": {
            "selection": SELECTION,
            "unperturbed": UNPERTURBED,
            "responses": tabled("walking_responses"),
            "table": tabled("walking"),
        },
        "read": crossed(perturbed=True),
        "settings": {"settings": CONFIG.walking.part("TimingSettings")},
    }


@plotted("figure.plot_over_stance", "impedance_over_stance")
def plot_numbers_impedance_over_stance(_):
    return {"input": {"table": tabled("impedance_over_stance")}, **over_stance()}


@plotted("figure.torque_angle", "torque_angle")
def plot_numbers_torque_angle(_):
    return {"input": {"curves": tabled("torque_angle_curves"), "table": tabled("torque_angle")}}


@step("figure.draw_figure", [RESULTS / f"figures/{{figure}}.{suffix}" for suffix in SUFFIXES], "figures/{figure}")
def draw_figure(wildcards):
    return {
        "modules": ("figures.names", f"figures.{FIGURES[wildcards.figure].module}"),
        "input": {"table_csv": RESULTS / f"figures/{wildcards.figure}.csv"},
        "read": {"fitted": shown_rows(wildcards.figure)},
        "settings": {"name": wildcards.figure, "footer": ABOUT.of_figure()},
    }


@step("figure.write_captions", RESULTS / "figures/captions.md", "figures/captions")
def captions(_):
    tables = {name: RESULTS / f"figures/{name}.csv" for name in drawn_names()}
    return {
        "modules": ("figures.names", *sorted({f"figures.{FIGURES[name].module}" for name in tables})),
        "input": {"fitted": list(tables.values())},
        "read": {"shown": {name: shown_rows(name) for name in tables}},
        "settings": {"tables": {name: str(path) for name, path in tables.items()}, "footer": ABOUT.sentence()},
    }
