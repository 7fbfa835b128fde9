"""Tables -> the numbers that a figure plots (CSV) -> the figure; and all that a run made -> the page (report.html)."""

SUFFIXES = ("pdf", "svg", "png")


def drawn_names() -> list[str]:
    """The names of the figures that the campaign's tables give."""
    tables = {path.stem for path in result_tables()}
    return [name for name, figure in FIGURES.items() if figure.table in tables]


def drawn_files() -> list[Path]:
    """Every figure of the campaign, in each format, and its numbers; the captions, if there is any."""
    files = [
        RESULTS / f"figures/{name}.{suffix}"
        for name in drawn_names()
        for suffix in ("csv", *SUFFIXES)
    ]
    return [*files, RESULTS / "figures/captions.md"] if files else []


def shown_rows(figure: str) -> list[Path]:
    """The results of single trials that a figure shows; those that are missing are named below it."""
    if figure == "fig4":
        return []  # one trial, without which it is not drawn
    if figure == "fig7":
        return rows("phasors", matching(CAMPAIGN, RESPONSE.model_dump() if RESPONSE else {}))
    return rows_behind(FIGURES[figure].table)


@step("figure.plot_numbers", "figures/{figure}.csv", "figures/{figure}_numbers")
def plot_numbers(wildcards):
    """Most figures show one table; the others are made by a command of their own, from several or from trials."""
    name = wildcards.figure
    figure, own, parts = FIGURES[name], f"figure.{name}", {}
    inputs, settings = {"table": tabled(figure.table)}, {}
    match name:
        case "fig3":
            inputs["summary"] = tabled("belt_summary")
            parts["read"] = {"curves": rows("belt_curves"), "quality": verdicts_on("belt_curves")}
        case "fig4":
            trial = TIME_SERIES["trial"]
            inputs = {
                "trial": trial_file(trial),
                "quality": checked([trial]),
                "fit": rows("impedance", [trial])[0],
            }
            settings = {
                "settings": CONFIG.dynamometer.part("ImpedanceAnalysis"),
                "choice": TIME_SERIES,
            }
            settings |= {
                "limits": limits_of("impedance"),
                "windows": CAMPAIGN.row(trial)["windows"],
            }
        case "fig7":
            parts = PARAMETERS
            settings = {
                "weight": setting("gain_weight"),
                "choice": RESPONSE and RESPONSE.model_dump(mode="json"),
            }
        case "walking_page":
            own, parts["read"] = "figure.plot_walking_page", crossed(perturbed=True)
            inputs = {
                "selection": SELECTION,
                "unperturbed": UNPERTURBED,
                "table": tabled("walking"),
            }
            inputs["responses"] = tabled("walking_responses")
            settings = {"settings": CONFIG.walking.part("TimingSettings")}
        case "impedance_over_stance":
            own, parts = "figure.plot_over_stance", over_stance()
        case _:
            own, parts["modules"] = "figure.plot_numbers", (f"figures.{figure.module}",)
            inputs |= {key: tabled(table) for key, table in zip(("second", "third"), figure.beside)}
            settings = {"name": name, "option": figure.option and setting(figure.option)}
    return {"command": own, "input": inputs, "settings": settings, **parts}


@step("figure.draw_figure", [f"figures/{{figure}}.{suffix}" for suffix in SUFFIXES])
def draw_figure(wildcards):
    name, settings = wildcards.figure, {
        "name": wildcards.figure,
        "footer": sentence(ABOUT, below_figure=True),
    }
    modules = [f"figures.{module}" for module in ("names", "others", FIGURES[name].module)]
    inputs = {
        "input": {"table_csv": RESULTS / f"figures/{name}.csv"},
        "read": {"fitted": shown_rows(name)},
    }
    return {"modules": modules, **inputs, "settings": settings}


@step("figure.write_captions", "figures/captions.md")
def captions(_):
    tables = {name: RESULTS / f"figures/{name}.csv" for name in drawn_names()}
    modules = ("figures.names", *sorted({f"figures.{FIGURES[name].module}" for name in tables}))
    settings = {"tables": tables, "footer": sentence(ABOUT)}
    read = {"shown": {name: shown_rows(name) for name in tables}}
    return {
        "input": {"fitted": list(tables.values())},
        "read": read,
        "modules": modules,
        "settings": settings,
    }


PAGE = {"output": "report.html", "methods_md": "methods.md", "methods_tex": "methods.tex"}


@step("report.write_report", PAGE, name="report")
def report_page(_):
    tables = [*result_tables(), *[tabled("walking_responses")] * bool(WALKED)]
    drawn = [RESULTS / f"figures/{name}.svg" for name in drawn_names()]
    ends = {
        "verdicts": tabled("quality"),
        **{name: tabled(name) for name in ("excluded", "findings")},
    }
    ends |= {"states": tabled("settings")}
    ends |= {"summary": RESULTS / "summary.json"}
    ends |= {"captions": RESULTS / "figures/captions.md"} if drawn else {}
    shown = {
        "tables": tables,
        "figures": drawn,
        "series": rows("series"),
        "crossings": crossings(WALKED),
    }
    shown["trials"] = [trial_file(trial) for trial in CAMPAIGN.trials()]
    told = {
        name: setting(name)
        for name in ("dynamometer", "actuator", "torque_angle", "walking", "overground")
    }
    settings = {"about": ABOUT, "settings": told}
    settings |= {"sheet": CAMPAIGN.rows | CAMPAIGN.unused, "unnamed": UNNAMED}
    inputs = {
        "input": {"tables": tables, "figures": drawn, **ends},
        "made_of": sorted(TEMPLATES.iterdir()),
    }
    return {
        **inputs,
        "read": {name: by_stem(files) for name, files in shown.items()},
        "settings": settings,
    }
