"""Ankle impedance of a walking person, from perturbed and unperturbed crossings (Fig. 9)."""

WALKING = CONFIG.walking.model_dump(mode="json")


def walking_settings(params) -> WalkingAnalysis:
    """The walking part of the configuration, as the job's parameters carry it."""
    return WalkingAnalysis.model_validate(params.settings)


def crossings(perturbed: bool) -> list[Path]:
    """The analysed crossings that were perturbed, or those that were not."""
    return [RESULTS / f"crossings/{trial}.parquet" for trial in CAMPAIGN.crossings(perturbed)]


def every_crossing() -> list[Path]:
    """The analysed crossings, perturbed or not, in the order of the sheet."""
    return [RESULTS / f"crossings/{trial}.parquet" for trial in CAMPAIGN.trials("walking")]


rule calibrate_markers:
    input:
        trial=ingested("static")[:1],
        motion=[RESULTS / f"trials/{trial}.parquet" for trial in CAMPAIGN.crossings(perturbed=False)[:3]],
        quality=checked([*CAMPAIGN.trials("static")[:1], *CAMPAIGN.crossings(perturbed=False)[:3]]),
    output:
        calibration=RESULTS / "fits/calibration.json",
        hinge=RESULTS / "tables/hinge.csv",
    log:
        RESULTS / "logs/walking/calibration.log",
    params:
        code=jobs.code("commands.crossing"),
        settings=WALKING,
    run:
        jobs.run_job(
            log[0],
            "crossing.calibrate",
            trial=kept(input.trial, input.quality)[0],
            motion=kept([*input.trial, *input.motion], input.quality)[1:],
            settings=walking_settings(params),
            output=Path(output.calibration),
            comparison=Path(output.hinge),
        )


rule identify_plate:
    input:
        trials=ingested("plate"),
        quality=checked(CAMPAIGN.trials("plate")),
        calibration=RESULTS / "fits/calibration.json",
    output:
        model=RESULTS / "fits/plate.json",
        comparison=RESULTS / "tables/plate.csv",
    log:
        RESULTS / "logs/walking/plate.log",
    params:
        code=jobs.code("commands.crossing"),
        settings=WALKING,
    run:
        jobs.run_job(
            log[0],
            "crossing.identify_plate",
            trials=kept(input.trials, input.quality),
            calibration=Path(input.calibration),
            settings=walking_settings(params),
            output=Path(output.model),
            comparison=Path(output.comparison),
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


rule select_crossings:
    input:
        crossings=every_crossing(),
        quality=checked(CAMPAIGN.trials("walking")),
    output:
        RESULTS / "tables/walking_crossings.csv",
    log:
        RESULTS / "logs/walking/selection.log",
    params:
        code=jobs.code("commands.walking"),
        settings=WALKING,
    run:
        jobs.run_job(
            log[0],
            "walking.select_crossings",
            crossings=kept(input.crossings, input.quality),
            settings=walking_settings(params),
            output=Path(output[0]),
        )


rule average_unperturbed:
    input:
        crossings=crossings(perturbed=False),
        quality=checked(CAMPAIGN.crossings(perturbed=False)),
        selection=RESULTS / "tables/walking_crossings.csv",
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
            selection=Path(input.selection),
            settings=walking_settings(params),
            output=Path(output[0]),
        )


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
        code=jobs.code("commands.walking"),
        settings=WALKING,
    run:
        jobs.run_job(
            log[0],
            "walking.fit_perturbation",
            crossing=Path(input.crossing),
            selection=Path(input.selection),
            unperturbed=Path(input.unperturbed),
            settings=walking_settings(params),
            output=Path(output[0]),
        )


rule summarise_walking:
    input:
        table=RESULTS / "tables/walking.csv",
        crossings=crossings(perturbed=True),
        quality=checked(CAMPAIGN.crossings(perturbed=True)),
        selection=RESULTS / "tables/walking_crossings.csv",
        unperturbed=RESULTS / "fits/unperturbed.parquet",
    output:
        summary=RESULTS / "tables/walking_summary.csv",
        responses=RESULTS / "tables/walking_responses.csv",
        excluded=RESULTS / "tables/walking_excluded.csv",
    log:
        RESULTS / "logs/walking/summary.log",
    params:
        code=jobs.code("commands.walking"),
        settings=WALKING,
    run:
        jobs.run_job(
            log[0],
            "walking.summarise_perturbations",
            table=Path(input.table),
            crossings=kept(input.crossings, input.quality),
            selection=Path(input.selection),
            unperturbed=Path(input.unperturbed),
            settings=walking_settings(params),
            output=Path(output.summary),
            responses=Path(output.responses),
            excluded=Path(output.excluded),
        )
