"""Ankle impedance of a walking person, from perturbed and unperturbed crossings (Fig. 9)."""

WALKED = {trial: PLACES[trial] for trial in CAMPAIGN.trials("walking")}
"""Joint and side of every crossing."""
SELECTION = tabled("walking_crossings")
PLATE, PLATFORM, UNPERTURBED = (
    RESULTS / f"fits/{n}" for n in ("plate.json", "platform.json", "unperturbed.parquet")
)


def calibration(static: str) -> Path:
    """The calibration by a static trial."""
    return RESULTS / f"fits/calibration/{static}.json"


def crossings(trials) -> list[Path]:
    """The analysed crossings of these trials."""
    return [RESULTS / f"crossings/{trial}.parquet" for trial in trials]


def crossed(perturbed: bool) -> dict[str, list[Path]]:
    """The analysed crossings that are perturbed, or those that are not, and the verdicts on them."""
    trials = CAMPAIGN.crossings(perturbed)
    return {"crossings": crossings(trials), "quality": checked(trials)}


def of_crossings(trials, **settings) -> dict[str, dict[str, object]]:
    """The ingested crossings and their calibrations, and the verdicts on them, as parts of a job."""
    statics = {trial: CAMPAIGN.static(trial) for trial in trials if CAMPAIGN.statics}
    calibrations = [calibration(static) for static in dict.fromkeys(statics.values())]
    inputs = {"trials": [trial_file(trial) for trial in trials], "calibrations": calibrations}
    return {
        "input": inputs,
        "read": {"quality": checked(trials)},
        "settings": {**settings, "statics": statics},
    }


@step(
    "walking.calibrate",
    calibration("{static}"),
    "calibration/{static}",
    static=CAMPAIGN.pattern("static"),
)
def calibrate_markers(wildcards):
    static = wildcards.static
    inputs, settings = {"trial": trial_file(static)}, {
        "settings": CAMPAIGN.calibration_settings(static)
    }
    return {"input": inputs, "read": {"quality": checked([static])}, "settings": settings}


UNLOADED = of_crossings(CAMPAIGN.plate_trials(), settings=CONFIG.walking.part("PlateModelSettings"))
single(
    "walking.identify_plate",
    {"output": PLATE, "comparison": tabled("plate")},
    "walking/plate",
    UNLOADED,
)
TURNING = {"settings": CONFIG.walking.part("CrossingSettings"), "places": WALKED}
TURNING = of_crossings(CAMPAIGN.crossings(perturbed=True), **TURNING)
single(
    "walking.measure_platform",
    {"output": PLATFORM, "comparison": tabled("platform")},
    "walking/platform",
    TURNING,
)


@step("walking.analyse", "crossings/{trial}.parquet")
def analyse_crossing(wildcards):
    trial, row, by_log = wildcards.trial, CAMPAIGN.row(wildcards.trial), CONFIG.walking.by_log
    stated = {
        column: row[column] for column in ("perturbed", "direction", "body_mass_kg", "windows")
    }
    stated |= {"calibration": None, "plate": None} if by_log else {}
    inputs = {
        "trial": trial_file(trial),
        **({} if by_log else {"plate": PLATE, "platform": PLATFORM}),
    }
    inputs |= {} if by_log else {"calibration": calibration(CAMPAIGN.static(trial))}
    return {
        "input": inputs,
        "settings": {"settings": CONFIG.walking.part("CrossingSettings"), **stated},
    }


IN_SHEET = {"sheet": CAMPAIGN.conditions(), "places": WALKED}
ANALYSED = {"input": {"crossings": crossings(WALKED)}, "read": {"quality": checked(WALKED)}}
ANALYSED["settings"] = {**IN_SHEET, "settings": CONFIG.walking.part("SelectionSettings")}
single("walking.select_crossings", SELECTION, "walking/selection", ANALYSED)
STEADY = {"input": {"selection": SELECTION}, "read": crossed(perturbed=False)}
STEADY["settings"] = {"fewest": CONFIG.walking.fewest_unperturbed}
single("walking.average_unperturbed", UNPERTURBED, "walking/unperturbed", STEADY)


@step("walking.fit_perturbation", "fits/walking/{trial}.csv", "walking/{trial}")
def fit_perturbation(wildcards):
    inputs = {"crossing": crossings([wildcards.trial])[0], "unperturbed": UNPERTURBED}
    settings = {"settings": CONFIG.walking.part("ResponseSettings")}
    return {"input": inputs, "read": {"selection": SELECTION}, "settings": settings}


SUMMARIES = {
    name: tabled(f"walking_{name}") for name in ("responses", "excluded", "groups", "sensitivity")
}
SUMMARIES["output"] = tabled("walking_summary")


@step("walking.summarise_perturbations", SUMMARIES, "walking/summary")
def summarise_walking(_):
    settings = {**IN_SHEET, "limits": limits_of("walking_groups")}
    settings["settings"] = CONFIG.walking.part("EnsembleSettings")
    inputs = {"table": tabled("walking"), "selection": SELECTION, "unperturbed": UNPERTURBED}
    return {"input": inputs, "read": crossed(perturbed=True), "settings": settings}


def over_stance() -> dict[str, dict[str, object]]:
    """File and settings of what shows the commanded impedance over stance, if there is one."""
    trajectory = [CONFIG.impedance_trajectory] if CONFIG.impedance_trajectory else []
    settings = {"stance_share": CONFIG.figures.stance_share, "data": CAMPAIGN.data}
    return {"files": {"trajectory": trajectory}, "settings": settings}


STANCE = {
    "input": {"summary": tabled("walking_summary"), "groups": tabled("walking_groups")},
    **over_stance(),
}
OVER_STANCE = "impedance_over_stance"
single(
    "walking.tabulate_over_stance", tabled(OVER_STANCE), "walking/over_stance", STANCE, OVER_STANCE
)
