"""Belt stiffness (Fig. 3), transmission losses, and the rendered impedance on the dynamometer (Figs. 4-7)."""

DYNAMOMETER = CONFIG.dynamometer.model_dump(mode="json")
WEIGHT = CONFIG.gain_weight.model_dump(mode="json")


def dynamometer_settings(params) -> DynamometerAnalysis:
    """The dynamometer's part of the configuration, as the job's parameters carry it."""
    return DynamometerAnalysis.model_validate(params.settings)


def gain_weight(params) -> Weight:
    """W of Eq. 14, as the job's parameters carry it."""
    return WeightSettings.model_validate(params.weight).weight


def bench_code(*modules: str) -> str:
    """Fingerprint of a job in commands/bench.py that calls these modules."""
    return jobs.code(*modules, "table", "trial_file", job="commands.bench")


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
        code=bench_code("bench.belt"),
        settings=DYNAMOMETER,
    run:
        jobs.run_job(
            log[0],
            "bench.fit_belt_trial",
            trial=Path(input.trial),
            parameters=Path(input.parameters),
            settings=dynamometer_settings(params),
            fit=Path(output.fit),
            curve=Path(output.curve),
        )


rule fit_transmission_trial:
    input:
        trial=RESULTS / "trials/{trial}.parquet",
    output:
        RESULTS / "fits/transmission/{trial}.csv",
    log:
        RESULTS / "logs/transmission/{trial}.log",
    params:
        code=bench_code("bench.transmission"),
        settings=DYNAMOMETER,
    run:
        jobs.run_job(
            log[0],
            "bench.fit_transmission_trial",
            trial=Path(input.trial),
            settings=dynamometer_settings(params),
            output=Path(output[0]),
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
        code=bench_code("bench.impedance", "bench.estimators"),
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
            desired=DesiredImpedance(weight=gain_weight(params), **params.row),
            fit=Path(output.fit),
            phasors=Path(output.phasors),
            estimators=Path(output.estimators),
        )


rule frequency_response:
    input:
        phasors=RESULTS / "tables/phasors.csv",
    output:
        RESULTS / "tables/frequency_response.csv",
    log:
        RESULTS / "logs/tables/frequency_response.log",
    params:
        code=bench_code("bench.frequency_response"),
    run:
        jobs.run_job(log[0], "bench.average_over_amplitudes", phasors=Path(input.phasors), output=Path(output[0]))
