"""The actuator on its own bench: the left half of Table I."""


rule fit_actuator_trial:
    input:
        trial=RESULTS / "trials/{trial}.parquet",
    output:
        RESULTS / "fits/actuator/{trial}.csv",
    log:
        RESULTS / "logs/actuator/{trial}.log",
    params:
        code=jobs.code_of("bench.fit_actuator_trial"),
        settings=CONFIG.actuator.model_dump(mode="json"),
    run:
        jobs.run_job(
            log[0],
            "bench.fit_actuator_trial",
            trial=Path(input.trial),
            settings=ActuatorAnalysis.model_validate(params.settings),
            tables={"actuator": Path(output[0])},
        )
