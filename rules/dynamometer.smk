"""Belt stiffness (Fig. 3), transmission losses, and the rendered impedance on the dynamometer (Figs. 4-7)."""

DYNAMOMETER = CONFIG.dynamometer.model_dump(mode="json")
WEIGHT = CONFIG.gain_weight.model_dump(mode="json")


def dynamometer_settings(params) -> DynamometerAnalysis:
    """The dynamometer's part of the configuration, as the job's parameters carry it."""
    return DynamometerAnalysis.model_validate(params.settings)


def gain_weight(params) -> Weight:
    """W of Eq. 14, as the job's parameters carry it."""
    return WeightSettings.model_validate(params.weight).weight


rule fit_belt_trial:
    input:
        trial=RESULTS / "trials/{trial}.parquet",
        parameters=CONFIG.parameters,
    output:
        fit=RESULTS / "fits/belt/{trial}.csv",
        curve=RESULTS / "fits/belt_curves/{trial}.csv",
    log:
        RESULTS / "logs/belt/{trial}.log",
    params:
        code=jobs.code_of("bench.fit_belt_trial"),
        settings=DYNAMOMETER,
    run:
        jobs.run_job(
            log[0],
            "bench.fit_belt_trial",
            trial=Path(input.trial),
            parameters=Path(input.parameters),
            settings=dynamometer_settings(params),
            tables={"belt": Path(output.fit), "belt_curves": Path(output.curve)},
        )


rule fit_transmission_trial:
    input:
        trial=RESULTS / "trials/{trial}.parquet",
    output:
        RESULTS / "fits/transmission/{trial}.csv",
    log:
        RESULTS / "logs/transmission/{trial}.log",
    params:
        code=jobs.code_of("bench.fit_transmission_trial"),
        settings=DYNAMOMETER,
    run:
        jobs.run_job(
            log[0],
            "bench.fit_transmission_trial",
            trial=Path(input.trial),
            settings=dynamometer_settings(params),
            tables={"transmission": Path(output[0])},
        )


rule fit_impedance_trial:
    input:
        trial=RESULTS / "trials/{trial}.parquet",
        parameters=CONFIG.parameters,
    output:
        fit=RESULTS / "fits/impedance/{trial}.csv",
        phasors=RESULTS / "fits/phasors/{trial}.csv",
        estimators=RESULTS / "fits/estimators/{trial}.csv",
    log:
        RESULTS / "logs/impedance/{trial}.log",
    params:
        code=jobs.code_of("bench.fit_impedance_trial"),
        settings=DYNAMOMETER,
        weight=WEIGHT,
        row=lambda wildcards: {key: CAMPAIGN.row(wildcards.trial)[key] for key in ("controller", "K_d", "B_d")},
    run:
        jobs.run_job(
            log[0],
            "bench.fit_impedance_trial",
            trial=Path(input.trial),
            parameters=Path(input.parameters),
            settings=dynamometer_settings(params),
            condition=DesiredImpedance(**params.row),
            weight=gain_weight(params),
            tables={
                "impedance": Path(output.fit),
                "phasors": Path(output.phasors),
                "estimators": Path(output.estimators),
            },
        )


rule frequency_response:
    input:
        phasors=RESULTS / "tables/phasors.csv",
    output:
        RESULTS / "tables/frequency_response.csv",
    log:
        RESULTS / "logs/tables/frequency_response.log",
    params:
        code=jobs.code_of("bench.average_over_amplitudes"),
    run:
        jobs.run_job(log[0], "bench.average_over_amplitudes", table=Path(input.phasors), output=Path(output[0]))
