"""Ankle impedance of a walking person, from perturbed and unperturbed crossings (Fig. 9)."""

CALIBRATED = CAMPAIGN.statics if CAMPAIGN.trials("walking") else {}
"""The crossings that each static trial calibrates."""

PLATE, PLATFORM, UNPERTURBED = (
    RESULTS / f"fits/{name}" for name in ("plate.json", "platform.json", "unperturbed.parquet")
)
SELECTION = tabled("walking_crossings")
WALKED = {trial: PLACES[trial] for trial in CAMPAIGN.trials("walking")}
"""Joint and side of every crossing."""


def motion_of(static: str) -> list[str]:
    """Crossings that show how foot and shank turn against each other: the first unperturbed ones of a static trial."""
    return [trial for trial in CALIBRATED[static] if not CAMPAIGN.row(trial)["perturbed"]][:3]


def calibration(static: str) -> Path:
    """The calibration by a static trial."""
    return RESULTS / f"fits/calibration/{static}.json"


def statics(trials) -> dict[str, str]:
    """The static trial of each of these trials."""
    return {trial: CAMPAIGN.static(trial) for trial in trials}


def calibrations(trials) -> list[Path]:
    """The calibrations that these trials need."""
    return [calibration(static) for static in dict.fromkeys(statics(trials).values())]


def crossings(trials) -> list[Path]:
    """The analysed crossings of these trials."""
    return [RESULTS / f"crossings/{trial}.parquet" for trial in trials]


def crossed(perturbed: bool) -> dict[str, list[Path]]:
    """The analysed crossings that are perturbed, or those that are not, and the verdicts on them."""
    trials = CAMPAIGN.crossings(perturbed)
    return {"crossings": crossings(trials), "quality": checked(trials)}


@step(
    "walking.calibrate",
    {"output": calibration("{static}"), "comparison": RESULTS / "fits/hinge/{static}.csv"},
    "calibration/{static}",
    static=CAMPAIGN.pattern("static"),
)
def calibrate_markers(wildcards):
    static = wildcards.static
    return {
        "input": {"trial": trial_file(static), "motion": [trial_file(trial) for trial in motion_of(static)]},
        "read": {"quality": checked([static, *motion_of(static)])},
        "settings": {"settings": CAMPAIGN.calibration_settings(static)},
    }


def of_crossings(trials) -> dict[str, dict[str, list[Path]]]:
    """The ingested crossings and their calibrations, and the verdicts on them, as parts of a job."""
    return {
        "input": {"trials": [trial_file(trial) for trial in trials], "calibrations": calibrations(trials)},
        "read": {"quality": checked(trials)},
    }


@step("walking.identify_plate", {"output": PLATE, "comparison": tabled("plate")}, "walking/plate")
def identify_plate(_):
    trials = CAMPAIGN.plate_trials()
    settings = {"settings": CONFIG.walking.part("PlateModelSettings"), "statics": statics(trials)}
    return of_crossings(trials) | {"settings": settings}


@step("walking.measure_platform", {"output": PLATFORM, "comparison": tabled("platform")}, "walking/platform")
def measure_platform(_):
    trials = CAMPAIGN.crossings(perturbed=True)
    settings = {"settings": CONFIG.walking.part("PlatformMotionSettings"), "places": WALKED, "statics": statics(trials)}
    return of_crossings(trials) | {"settings": settings}


@step("walking.analyse", RESULTS / "crossings/{trial}.parquet", "crossings/{trial}")
def analyse_crossing(wildcards):
    trial, row = wildcards.trial, CAMPAIGN.row(wildcards.trial)
    return {
        "input": {
            "trial": trial_file(trial),
            "calibration": calibration(CAMPAIGN.static(trial)),
            "plate": PLATE,
            "platform": PLATFORM,
        },
        "settings": {
            "settings": CONFIG.walking.part("CrossingSettings"),
            **{column: row[column] for column in ("perturbed", "direction", "body_mass_kg")},
        },
    }


@step("walking.select_crossings", SELECTION, "walking/selection")
def select_crossings(_):
    trials = CAMPAIGN.trials("walking")
    return {
        "input": {"crossings": crossings(trials)},
        "read": {"quality": checked(trials)},
        "settings": {
            "settings": CONFIG.walking.part("SelectionSettings"),
            "sheet": CAMPAIGN.conditions(),
            "places": WALKED,
        },
    }


@step("walking.average_unperturbed", UNPERTURBED, "walking/unperturbed")
def average_unperturbed(_):
    return {
        "input": {"selection": SELECTION},
        "read": crossed(perturbed=False),
        "settings": {"settings": CONFIG.walking.part("UnperturbedSettings")},
    }


@step("walking.fit_perturbation", RESULTS / "fits/walking/{trial}.csv", "walking/{trial}")
def fit_perturbation(wildcards):
    (crossing,) = crossings([wildcards.trial])
    return {
        "input": {"crossing": crossing, "unperturbed": UNPERTURBED},
        "read": {"selection": SELECTION},
        "settings": {"settings": CONFIG.walking.part("ResponseSettings")},
    }


SUMMARIES = {"output": "summary", "responses": "responses", "excluded": "excluded", "groups": "groups"}


@step(
    "walking.summarise_perturbations",
    {name: tabled(f"walking_{table}") for name, table in SUMMARIES.items()},
    "walking/summary",
)
def summarise_walking(_):
    return {
        "input": {"table": tabled("walking"), "selection": SELECTION, "unperturbed": UNPERTURBED},
        "read": crossed(perturbed=True),
        "settings": {
            "settings": CONFIG.walking.part("EnsembleSettings"),
            "sheet": CAMPAIGN.conditions(),
            "places": WALKED,
            "limits": CONFIG.doubtful.of("walking_groups").model_dump(mode="json"),
        },
    }


def over_stance() -> dict[str, dict[str, object]]:
    """File and settings of what shows the commanded impedance over stance, if there is one."""
    return {
        "files": {"trajectory": [CONFIG.impedance_trajectory] if CONFIG.impedance_trajectory else []},
        "settings": {"stance_share": CONFIG.figures.stance_share, "data": CAMPAIGN.data},
    }


@step("walking.tabulate_over_stance", tabled("impedance_over_stance"), "walking/over_stance")
def impedance_over_stance(_):
    return {"input": {"summary": tabled("walking_summary"), "groups": tabled("walking_groups")}, **over_stance()}
