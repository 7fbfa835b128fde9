"""Canonical trial -> what quality control says of it. Trials that it excludes are left out when trials are brought together."""

QUALITY = CONFIG.quality.model_dump(mode="json")


def checked(trials) -> list[Path]:
    """What quality control says of these trials."""
    return [RESULTS / f"quality/{trial}.csv" for trial in trials]


rule check_quality:
    input:
        trial=RESULTS / "trials/{trial}.parquet",
    output:
        RESULTS / "quality/{trial}.csv",
    log:
        RESULTS / "logs/quality/{trial}.log",
    params:
        code=jobs.code("commands.quality"),
        rules=QUALITY,
        protocol=CONFIG.dynamometer.model_dump(mode="json", include={"amplitudes_deg", "frequencies_hz", "cycles"}),
        experiment=lambda wildcards: CAMPAIGN.row(wildcards.trial)["experiment"],
        accept=lambda wildcards: CAMPAIGN.accepted(wildcards.trial),
    run:
        jobs.run_job(
            log[0],
            "quality.check_trial",
            trial=Path(input.trial),
            experiment=params.experiment,
            accept=params.accept,
            rules=QualityRules.model_validate(params.rules),
            commanded=Commanded(**params.protocol),
            output=Path(output[0]),
        )


rule excluded_trials:
    input:
        quality=RESULTS / "tables/quality.csv",
    output:
        RESULTS / "tables/excluded.csv",
    log:
        RESULTS / "logs/tables/excluded.log",
    params:
        code=jobs.code("commands.quality"),
        by_sheet=dict(CAMPAIGN.excluded),
    run:
        jobs.run_job(
            log[0],
            "quality.list_excluded",
            quality=Path(input.quality),
            by_sheet=params.by_sheet,
            output=Path(output[0]),
        )
