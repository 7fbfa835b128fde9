"""Ankle impedance of a walking person, from perturbed and unperturbed crossings (Fig. 9)."""

CALIBRATED = CAMPAIGN.statics if CAMPAIGN.trials("walking") else {}
"""The crossings that each static trial calibrates."""

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


rule calibrate_markers:
    input:
        unpack(
            lambda wildcards: job(
                rules.calibrate_markers,
                wildcards,
                "crossing.calibrate",
                input={
                    "trial": trial_file(wildcards.static),
                    "motion": [trial_file(trial) for trial in motion_of(wildcards.static)],
                },
                read={"quality": checked([wildcards.static, *motion_of(wildcards.static)])},
                settings={"settings": CAMPAIGN.calibration_settings(wildcards.static)},
            )
        ),
    output:
        output=RESULTS / "fits/calibration/{static}.json",
        comparison=RESULTS / "fits/hinge/{static}.csv",
    log:
        RESULTS / "logs/calibration/{static}.log",
    wildcard_constraints:
        static=CAMPAIGN.pattern("static"),
    shell:
        JOB


rule identify_plate:
    input:
        unpack(
            lambda wildcards: job(
                rules.identify_plate,
                wildcards,
                "crossing.identify_plate",
                input={
                    "trials": [trial_file(trial) for trial in CAMPAIGN.plate_trials()],
                    "calibrations": calibrations(CAMPAIGN.plate_trials()),
                },
                read={"quality": checked(CAMPAIGN.plate_trials())},
                settings={
                    "settings": CONFIG.walking.part("PlateModelSettings"),
                    "statics": statics(CAMPAIGN.plate_trials()),
                },
            )
        ),
    output:
        output=RESULTS / "fits/plate.json",
        comparison=RESULTS / "tables/plate.csv",
    log:
        RESULTS / "logs/walking/plate.log",
    shell:
        JOB


rule measure_platform:
    input:
        unpack(
            lambda wildcards: job(
                rules.measure_platform,
                wildcards,
                "crossing.measure_platform",
                input={
                    "trials": [trial_file(trial) for trial in CAMPAIGN.crossings(perturbed=True)],
                    "calibrations": calibrations(CAMPAIGN.crossings(perturbed=True)),
                },
                read={"quality": checked(CAMPAIGN.crossings(perturbed=True))},
                settings={
                    "settings": CONFIG.walking.part("PlatformMotionSettings"),
                    "places": WALKED,
                    "statics": statics(CAMPAIGN.crossings(perturbed=True)),
                },
            )
        ),
    output:
        output=RESULTS / "fits/platform.json",
        comparison=RESULTS / "tables/platform.csv",
    log:
        RESULTS / "logs/walking/platform.log",
    shell:
        JOB


rule analyse_crossing:
    input:
        unpack(
            lambda wildcards: job(
                rules.analyse_crossing,
                wildcards,
                "crossing.analyse",
                input={
                    "trial": RESULTS / f"trials/{wildcards.trial}.parquet",
                    "calibration": calibration(CAMPAIGN.static(wildcards.trial)),
                    "plate": RESULTS / "fits/plate.json",
                    "platform": RESULTS / "fits/platform.json",
                },
                settings={
                    "settings": CONFIG.walking.part("CrossingSettings"),
                    "perturbed": CAMPAIGN.row(wildcards.trial)["perturbed"],
                    "direction": CAMPAIGN.row(wildcards.trial)["direction"],
                    "body_mass_kg": CAMPAIGN.row(wildcards.trial)["body_mass_kg"],
                },
            )
        ),
    output:
        RESULTS / "crossings/{trial}.parquet",
    log:
        RESULTS / "logs/crossings/{trial}.log",
    shell:
        JOB


rule select_crossings:
    input:
        unpack(
            lambda wildcards: job(
                rules.select_crossings,
                wildcards,
                "walking.select_crossings",
                input={"crossings": crossings(CAMPAIGN.trials("walking"))},
                read={"quality": checked(CAMPAIGN.trials("walking"))},
                settings={
                    "settings": CONFIG.walking.part("SelectionSettings"),
                    "sheet": CAMPAIGN.conditions(),
                    "places": WALKED,
                },
            )
        ),
    output:
        RESULTS / "tables/walking_crossings.csv",
    log:
        RESULTS / "logs/walking/selection.log",
    shell:
        JOB


rule average_unperturbed:
    input:
        unpack(
            lambda wildcards: job(
                rules.average_unperturbed,
                wildcards,
                "walking.average_unperturbed",
                input={"selection": RESULTS / "tables/walking_crossings.csv"},
                read=crossed(perturbed=False),
                settings={"settings": CONFIG.walking.part("UnperturbedSettings")},
            )
        ),
    output:
        RESULTS / "fits/unperturbed.parquet",
    log:
        RESULTS / "logs/walking/unperturbed.log",
    shell:
        JOB


rule fit_perturbation:
    input:
        unpack(
            lambda wildcards: job(
                rules.fit_perturbation,
                wildcards,
                "walking.fit_perturbation",
                input={
                    "crossing": RESULTS / f"crossings/{wildcards.trial}.parquet",
                    "unperturbed": RESULTS / "fits/unperturbed.parquet",
                },
                read={"selection": RESULTS / "tables/walking_crossings.csv"},
                settings={"settings": CONFIG.walking.part("ResponseSettings")},
            )
        ),
    output:
        RESULTS / "fits/walking/{trial}.csv",
    log:
        RESULTS / "logs/walking/{trial}.log",
    shell:
        JOB


rule summarise_walking:
    input:
        unpack(
            lambda wildcards: job(
                rules.summarise_walking,
                wildcards,
                "walking.summarise_perturbations",
                input={
                    "table": RESULTS / "tables/walking.csv",
                    "selection": RESULTS / "tables/walking_crossings.csv",
                    "unperturbed": RESULTS / "fits/unperturbed.parquet",
                },
                read=crossed(perturbed=True),
                settings={
                    "settings": CONFIG.walking.part("EnsembleSettings"),
                    "sheet": CAMPAIGN.conditions(),
                    "places": WALKED,
                    "limits": CONFIG.doubtful.of("walking_groups").model_dump(mode="json"),
                },
            )
        ),
    output:
        output=RESULTS / "tables/walking_summary.csv",
        responses=RESULTS / "tables/walking_responses.csv",
        excluded=RESULTS / "tables/walking_excluded.csv",
        groups=RESULTS / "tables/walking_groups.csv",
    log:
        RESULTS / "logs/walking/summary.log",
    shell:
        JOB


def trajectory() -> list[Path]:
    """The file of the commanded impedance over stance, if there is one."""
    return [CONFIG.impedance_trajectory] if CONFIG.impedance_trajectory else []


rule impedance_over_stance:
    input:
        unpack(
            lambda wildcards: job(
                rules.impedance_over_stance,
                wildcards,
                "walking.tabulate_over_stance",
                input={
                    "summary": RESULTS / "tables/walking_summary.csv",
                    "groups": RESULTS / "tables/walking_groups.csv",
                },
                files={"trajectory": trajectory()},
                settings={"stance_share": CONFIG.figures.stance_share, "data": CAMPAIGN.data},
            )
        ),
    output:
        RESULTS / "tables/impedance_over_stance.csv",
    log:
        RESULTS / "logs/walking/over_stance.log",
    shell:
        JOB
