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
        trial=lambda wildcards: trial_file(wildcards.static),
        motion=lambda wildcards: [trial_file(trial) for trial in motion_of(wildcards.static)],
    output:
        output=RESULTS / "fits/calibration/{static}.json",
        comparison=RESULTS / "fits/hinge/{static}.csv",
    log:
        RESULTS / "logs/calibration/{static}.log",
    wildcard_constraints:
        static=CAMPAIGN.pattern("static"),
    group:
        "shared"
    params:
        code=jobs.code_of("crossing.calibrate"),
        settings=lambda wildcards: CAMPAIGN.calibration_settings(wildcards.static),
    run:
        read = {"quality": checked([wildcards.static, *motion_of(wildcards.static)])}
        jobs.run_job(log, "crossing.calibrate", input, output, params, read=read)


rule identify_plate:
    input:
        trials=[trial_file(trial) for trial in CAMPAIGN.plate_trials()],
        calibrations=lambda wildcards: calibrations(CAMPAIGN.plate_trials()),
    output:
        output=RESULTS / "fits/plate.json",
        comparison=RESULTS / "tables/plate.csv",
    log:
        RESULTS / "logs/walking/plate.log",
    group:
        "shared"
    params:
        code=jobs.code_of("crossing.identify_plate"),
        settings=CONFIG.walking.part("PlateModelSettings"),
        statics=lambda wildcards: statics(CAMPAIGN.plate_trials()),
    run:
        read = {"quality": checked(CAMPAIGN.plate_trials())}
        jobs.run_job(log, "crossing.identify_plate", input, output, params, read=read)


rule measure_platform:
    input:
        trials=[trial_file(trial) for trial in CAMPAIGN.crossings(perturbed=True)],
        calibrations=lambda wildcards: calibrations(CAMPAIGN.crossings(perturbed=True)),
    output:
        output=RESULTS / "fits/platform.json",
        comparison=RESULTS / "tables/platform.csv",
    log:
        RESULTS / "logs/walking/platform.log",
    group:
        "shared"
    params:
        code=jobs.code_of("crossing.measure_platform"),
        settings=CONFIG.walking.part("PlatformMotionSettings"),
        places=WALKED,
        statics=lambda wildcards: statics(CAMPAIGN.crossings(perturbed=True)),
    run:
        read = {"quality": checked(CAMPAIGN.crossings(perturbed=True))}
        jobs.run_job(log, "crossing.measure_platform", input, output, params, read=read)


rule analyse_crossing:
    input:
        trial=RESULTS / "trials/{trial}.parquet",
        calibration=lambda wildcards: calibration(CAMPAIGN.static(wildcards.trial)),
        plate=RESULTS / "fits/plate.json",
        platform=RESULTS / "fits/platform.json",
    output:
        RESULTS / "crossings/{trial}.parquet",
    log:
        RESULTS / "logs/crossings/{trial}.log",
    group:
        "crossings"
    params:
        code=jobs.code_of("crossing.analyse"),
        settings=CONFIG.walking.part("CrossingSettings"),
        perturbed=lambda wildcards: CAMPAIGN.row(wildcards.trial)["perturbed"],
        direction=lambda wildcards: CAMPAIGN.row(wildcards.trial)["direction"],
        body_mass_kg=lambda wildcards: CAMPAIGN.row(wildcards.trial)["body_mass_kg"],
    run:
        jobs.run_job(log, "crossing.analyse", input, output, params)


rule select_crossings:
    input:
        crossings=crossings(CAMPAIGN.trials("walking")),
    output:
        RESULTS / "tables/walking_crossings.csv",
    log:
        RESULTS / "logs/walking/selection.log",
    params:
        code=jobs.code_of("walking.select_crossings"),
        settings=CONFIG.walking.part("SelectionSettings"),
        sheet=CAMPAIGN.conditions(),
        places=WALKED,
    run:
        read = {"quality": checked(CAMPAIGN.trials("walking"))}
        jobs.run_job(log, "walking.select_crossings", input, output, params, read=read)


rule average_unperturbed:
    input:
        selection=RESULTS / "tables/walking_crossings.csv",
    output:
        RESULTS / "fits/unperturbed.parquet",
    log:
        RESULTS / "logs/walking/unperturbed.log",
    params:
        code=jobs.code_of("walking.average_unperturbed"),
        settings=CONFIG.walking.part("UnperturbedSettings"),
    run:
        jobs.run_job(log, "walking.average_unperturbed", input, output, params, read=crossed(perturbed=False))


rule fit_perturbation:
    input:
        crossing=RESULTS / "crossings/{trial}.parquet",
        unperturbed=RESULTS / "fits/unperturbed.parquet",
    output:
        RESULTS / "fits/walking/{trial}.csv",
    log:
        RESULTS / "logs/walking/{trial}.log",
    group:
        "perturbations"
    params:
        code=jobs.code_of("walking.fit_perturbation"),
        settings=CONFIG.walking.part("ResponseSettings"),
    run:
        read = {"selection": RESULTS / "tables/walking_crossings.csv"}
        jobs.run_job(log, "walking.fit_perturbation", input, output, params, read=read)


rule summarise_walking:
    input:
        table=RESULTS / "tables/walking.csv",
        selection=RESULTS / "tables/walking_crossings.csv",
        unperturbed=RESULTS / "fits/unperturbed.parquet",
    output:
        output=RESULTS / "tables/walking_summary.csv",
        responses=RESULTS / "tables/walking_responses.csv",
        excluded=RESULTS / "tables/walking_excluded.csv",
        groups=RESULTS / "tables/walking_groups.csv",
    log:
        RESULTS / "logs/walking/summary.log",
    params:
        code=jobs.code_of("walking.summarise_perturbations"),
        settings=CONFIG.walking.part("EnsembleSettings"),
        sheet=CAMPAIGN.conditions(),
        places=WALKED,
        limits=CONFIG.doubtful.of("walking_groups").model_dump(mode="json"),
    run:
        jobs.run_job(log, "walking.summarise_perturbations", input, output, params, read=crossed(perturbed=True))


rule impedance_over_stance:
    input:
        summary=RESULTS / "tables/walking_summary.csv",
        groups=RESULTS / "tables/walking_groups.csv",
        trajectory=[CONFIG.impedance_trajectory] if CONFIG.impedance_trajectory else [],
    output:
        RESULTS / "tables/impedance_over_stance.csv",
    log:
        RESULTS / "logs/walking/over_stance.log",
    params:
        code=jobs.code_of("walking.tabulate_over_stance"),
        stance_share=CONFIG.figures.stance_share,
        data=CAMPAIGN.data,
    run:
        jobs.run_job(log, "walking.tabulate_over_stance", input, output, params)
