"""Ankle impedance of a walking person, from perturbed and unperturbed crossings (Fig. 9)."""

CALIBRATED_ON = CAMPAIGN.crossings(perturbed=False)[:3]
"""Crossings that show how foot and shank turn against each other."""


def crossings(trials) -> list[Path]:
    """The analysed crossings of these trials."""
    return [RESULTS / f"crossings/{trial}.parquet" for trial in trials]


rule calibrate_markers:
    input:
        trial=lambda wildcards: trial_file(CAMPAIGN.trials("static")[0]),
        motion=[trial_file(trial) for trial in CALIBRATED_ON],
        quality=checked([*CAMPAIGN.trials("static")[:1], *CALIBRATED_ON]),
    output:
        output=RESULTS / "fits/calibration.json",
        comparison=RESULTS / "tables/hinge.csv",
    log:
        RESULTS / "logs/walking/calibration.log",
    params:
        code=jobs.code_of("crossing.calibrate"),
        settings=CONFIG.walking.part("CalibrationSettings"),
    run:
        jobs.run_job(log, "crossing.calibrate", input, output, params)


rule identify_plate:
    input:
        trials=ingested("plate"),
        quality=checked(CAMPAIGN.trials("plate")),
        calibration=RESULTS / "fits/calibration.json",
    output:
        output=RESULTS / "fits/plate.json",
        comparison=RESULTS / "tables/plate.csv",
    log:
        RESULTS / "logs/walking/plate.log",
    params:
        code=jobs.code_of("crossing.identify_plate"),
        settings=CONFIG.walking.part("PlateModelSettings"),
    run:
        jobs.run_job(log, "crossing.identify_plate", input, output, params)


rule measure_platform:
    input:
        trials=[trial_file(trial) for trial in CAMPAIGN.crossings(perturbed=True)],
        quality=checked(CAMPAIGN.crossings(perturbed=True)),
        calibration=RESULTS / "fits/calibration.json",
    output:
        output=RESULTS / "fits/platform.json",
        comparison=RESULTS / "tables/platform.csv",
    log:
        RESULTS / "logs/walking/platform.log",
    params:
        code=jobs.code_of("crossing.measure_platform"),
        settings=CONFIG.walking.part("PlatformMotionSettings"),
    run:
        jobs.run_job(log, "crossing.measure_platform", input, output, params)


rule analyse_crossing:
    input:
        trial=RESULTS / "trials/{trial}.parquet",
        calibration=RESULTS / "fits/calibration.json",
        plate=RESULTS / "fits/plate.json",
        platform=RESULTS / "fits/platform.json",
    output:
        RESULTS / "crossings/{trial}.parquet",
    log:
        RESULTS / "logs/crossings/{trial}.log",
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
        quality=checked(CAMPAIGN.trials("walking")),
    output:
        RESULTS / "tables/walking_crossings.csv",
    log:
        RESULTS / "logs/walking/selection.log",
    params:
        code=jobs.code_of("walking.select_crossings"),
        settings=CONFIG.walking.part("SelectionSettings"),
        sheet=CAMPAIGN.conditions(),
    run:
        jobs.run_job(log, "walking.select_crossings", input, output, params)


rule average_unperturbed:
    input:
        crossings=crossings(CAMPAIGN.crossings(perturbed=False)),
        quality=checked(CAMPAIGN.crossings(perturbed=False)),
        selection=RESULTS / "tables/walking_crossings.csv",
    output:
        RESULTS / "fits/unperturbed.parquet",
    log:
        RESULTS / "logs/walking/unperturbed.log",
    params:
        code=jobs.code_of("walking.average_unperturbed"),
        settings=CONFIG.walking.part("UnperturbedSettings"),
    run:
        jobs.run_job(log, "walking.average_unperturbed", input, output, params)


rule fit_perturbation:
    input:
        crossing=RESULTS / "crossings/{trial}.parquet",
        selection=RESULTS / "tables/walking_crossings.csv",
        unperturbed=RESULTS / "fits/unperturbed.parquet",
    output:
        RESULTS / "fits/walking/{trial}.csv",
    log:
        RESULTS / "logs/walking/{trial}.log",
    params:
        code=jobs.code_of("walking.fit_perturbation"),
        settings=CONFIG.walking.part("ResponseSettings"),
    run:
        jobs.run_job(log, "walking.fit_perturbation", input, output, params)


rule summarise_walking:
    input:
        table=RESULTS / "tables/walking.csv",
        crossings=crossings(CAMPAIGN.crossings(perturbed=True)),
        quality=checked(CAMPAIGN.crossings(perturbed=True)),
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
    run:
        jobs.run_job(log, "walking.summarise_perturbations", input, output, params)


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
        code=jobs.code_of("over_stance.tabulate"),
        stance_share=CONFIG.figures.stance_share,
    run:
        jobs.run_job(log, "over_stance.tabulate", input, output, params)
