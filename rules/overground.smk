"""Overground gait beside the ankle moment that its laboratory computed."""


rule compare_ankle_moment:
    input:
        trial=RESULTS / "trials/{trial}.parquet",
    output:
        RESULTS / "fits/ankle_moment/{trial}.csv",
    log:
        RESULTS / "logs/overground/{trial}.log",
    params:
        code=jobs.code("commands.overground"),
        settings=CONFIG.overground.model_dump(mode="json"),
    run:
        jobs.run_job(
            log[0],
            "overground.compare_ankle_moment",
            trial=Path(input.trial),
            settings=OvergroundAnalysis.model_validate(params.settings),
            output=Path(output[0]),
        )
