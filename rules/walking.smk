"""Ankle impedance of a walking person, from perturbed and unperturbed crossings (Fig. 9)."""

WALKING = CONFIG.walking.model_dump(mode="json")


def walking_settings(params) -> WalkingAnalysis:
    """The walking part of the configuration, as the job's parameters carry it."""
    return WalkingAnalysis.model_validate(params.settings)


def crossings(perturbed: bool) -> list[Path]:
    """The analysed crossings that were perturbed, or those that were not."""
    return [RESULTS / f"crossings/{trial}.parquet" for trial in CAMPAIGN.crossings(perturbed)]


rule calibrate_markers:
    input:
        trial=ingested("static")[:1],
        quality=checked(CAMPAIGN.trials("static")[:1]),
    output:
        RESULTS / "fits/calibration.json",
    log:
        RESULTS / "logs/walking/calibration.log",
    params:
        code=jobs.code("commands.calibration"),
        settings=WALKING,
    run:
        jobs.run_job(
            log[0],
            "calibration.calibrate",
            trial=kept(input.trial, input.quality)[0],
            settings=walking_settings(params),
            output=Path(output[0]),
        )


rule identify_plate:
    input:
        trials=ingested("plate"),
        quality=checked(CAMPAIGN.trials("plate")),
        calibration=RESULTS / "fits/calibration.json",
    output:
        RESULTS / "fits/plate.json",
    log:
        RESULTS / "logs/walking/plate.log",
    params:
        code=jobs.code("commands.calibration"),
        settings=WALKING,
    run:
        jobs.run_job(
            log[0],
            "calibration.identify_plate",
            trials=kept(input.trials, input.quality),
            calibration=Path(input.calibration),
            settings=walking_settings(params),
            output=Path(output[0]),
        )


rule analyse_crossing:
    input:
        trial=RESULTS / "trials/{trial}.parquet",
        calibration=RESULTS / "fits/calibration.json",
        plate=RESULTS / "fits/plate.json",
    output:
        RESULTS / "crossings/{trial}.parquet",
    log:
        RESULTS / "logs/crossings/{trial}.log",
    params:
        code=jobs.code("commands.crossing"),
        settings=WALKING,
        perturbed=lambda wildcards: bool(CAMPAIGN.row(wildcards.trial)["perturbed"]),
    run:
        jobs.run_job(
            log[0],
            "crossing.analyse",
            trial=Path(input.trial),
            calibration=Path(input.calibration),
            plate=Path(input.plate),
            perturbed=params.perturbed,
            settings=walking_settings(params),
            output=Path(output[0]),
        )


rule average_unperturbed:
    input:
        crossings=crossings(perturbed=False),
        quality=checked(CAMPAIGN.crossings(perturbed=False)),
    output:
        RESULTS / "fits/unperturbed.parquet",
    log:
        RESULTS / "logs/walking/unperturbed.log",
    params:
        code=jobs.code("commands.walking"),
        settings=WALKING,
    run:
        jobs.run_job(
            log[0],
            "walking.average_unperturbed",
            crossings=kept(input.crossings, input.quality),
            settings=walking_settings(params),
            output=Path(output[0]),
        )


rule fit_perturbation:
    input:
        crossing=RESULTS / "crossings/{trial}.parquet",
        unperturbed=RESULTS / "fits/unperturbed.parquet",
    output:
        RESULTS / "fits/walking/{trial}.csv",
    log:
        RESULTS / "logs/walking/{trial}.log",
    params:
        code=jobs.code("commands.walking"),
        settings=WALKING,
    run:
        jobs.run_job(
            log[0],
            "walking.fit_perturbation",
            crossing=Path(input.crossing),
            unperturbed=Path(input.unperturbed),
            settings=walking_settings(params),
            output=Path(output[0]),
        )


rule summarise_walking:
    input:
        table=RESULTS / "tables/walking.csv",
        crossings=crossings(perturbed=True),
        quality=checked(CAMPAIGN.crossings(perturbed=True)),
        unperturbed=RESULTS / "fits/unperturbed.parquet",
    output:
        summary=RESULTS / "tables/walking_summary.csv",
        responses=RESULTS / "tables/walking_responses.csv",
    log:
        RESULTS / "logs/walking/summary.log",
    params:
        code=jobs.code("commands.walking"),
        settings=WALKING,
    run:
        jobs.run_job(
            log[0],
            "walking.summarise",
            table=Path(input.table),
            crossings=kept(input.crossings, input.quality),
            unperturbed=Path(input.unperturbed),
            settings=walking_settings(params),
            output=Path(output.summary),
            responses=Path(output.responses),
        )
