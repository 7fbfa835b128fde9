"""Rival models side by side: repeats held out for belt and transmission, amplitudes for the rendered impedance."""

REPEATED = ("belt", "transmission")


def comparisons() -> list[str]:
    """What is compared: all trials of an experiment together, and each impedance trial that has amplitudes to hold out."""
    return [f"{experiment}_trials" for experiment in REPEATED if CAMPAIGN.trials(experiment)] + amplitudes_held_out()


def amplitudes_held_out() -> list[str]:
    """The impedance trials, where they have amplitudes to hold out."""
    return CAMPAIGN.trials("impedance") if len(CONFIG.dynamometer.amplitudes_deg) > 1 else []


def held_out() -> bool:
    """Whether anything at all is predicted from other data."""
    return bool(amplitudes_held_out()) or any(len(CAMPAIGN.trials(experiment)) > 1 for experiment in REPEATED)


rule compare_belt_models:
    input:
        trials=ingested("belt"),
        quality=checked(CAMPAIGN.trials("belt")),
        parameters=CONFIG.parameters,
    output:
        RESULTS / "fits/model_comparison/belt_trials.csv",
    log:
        RESULTS / "logs/model_comparison/belt_trials.log",
    params:
        code=jobs.code_of("bench.compare_belt_models"),
        settings=DYNAMOMETER,
    run:
        jobs.run_job(
            log[0],
            "bench.compare_belt_models",
            trials=kept(input.trials, input.quality),
            parameters=Path(input.parameters),
            settings=dynamometer_settings(params),
            output=Path(output[0]),
        )


rule compare_transmission_models:
    input:
        trials=ingested("transmission"),
        quality=checked(CAMPAIGN.trials("transmission")),
    output:
        RESULTS / "fits/model_comparison/transmission_trials.csv",
    log:
        RESULTS / "logs/model_comparison/transmission_trials.log",
    params:
        code=jobs.code_of("bench.compare_transmission_models"),
        settings=DYNAMOMETER,
        sign_width=CONFIG.model_comparison.sign_width,
    run:
        jobs.run_job(
            log[0],
            "bench.compare_transmission_models",
            trials=kept(input.trials, input.quality),
            settings=dynamometer_settings(params),
            sign_width=params.sign_width,
            output=Path(output[0]),
        )


rule compare_impedance_models:
    input:
        trial=RESULTS / "trials/{trial}.parquet",
        parameters=CONFIG.parameters,
    output:
        RESULTS / "fits/model_comparison/{trial}.csv",
    log:
        RESULTS / "logs/model_comparison/{trial}.log",
    wildcard_constraints:
        trial=CAMPAIGN.pattern("impedance"),
    params:
        code=jobs.code_of("bench.compare_impedance_models"),
        settings=DYNAMOMETER,
        weight=WEIGHT,
        sign_width=CONFIG.model_comparison.sign_width,
        row=lambda wildcards: {key: CAMPAIGN.row(wildcards.trial)[key] for key in ("controller", "K_d", "B_d")},
    run:
        jobs.run_job(
            log[0],
            "bench.compare_impedance_models",
            trial=Path(input.trial),
            parameters=Path(input.parameters),
            settings=dynamometer_settings(params),
            condition=DesiredImpedance(**params.row),
            weight=gain_weight(params),
            sign_width=params.sign_width,
            output=Path(output[0]),
        )
