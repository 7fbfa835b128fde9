"""Rival models side by side: belt and transmission predict other trials, the rendered impedance other amplitudes."""

REPEATS = [name for name in ("belt", "transmission") if CAMPAIGN.trials(name)]
AMPLITUDES = CAMPAIGN.predicted() if len(CONFIG.dynamometer.amplitudes_deg) > 1 else []
COMPARISONS = [*(f"{name}_trials" for name in REPEATS), *AMPLITUDES]
IS_PREDICTED = bool(AMPLITUDES) or any(len(CAMPAIGN.trials(name)) > 1 for name in REPEATS)
"""Whether any model predicts data that it was not fitted to."""


rule compare_belt_models:
    input:
        **device(),
        trials=ingested("belt"),
        quality=checked(CAMPAIGN.trials("belt")),
        fitted=lambda wildcards: rows("belt"),
    output:
        RESULTS / "fits/model_comparison/belt_trials.csv",
    log:
        RESULTS / "logs/model_comparison/belt_trials.log",
    params:
        **no_device(),
        code=jobs.code_of("bench.compare_belt_models"),
        settings=CONFIG.dynamometer.part("BeltAnalysis"),
    run:
        jobs.run_job(log, "bench.compare_belt_models", input, output, params)


rule compare_transmission_models:
    input:
        trials=ingested("transmission"),
        quality=checked(CAMPAIGN.trials("transmission")),
        fitted=lambda wildcards: rows("transmission"),
    output:
        RESULTS / "fits/model_comparison/transmission_trials.csv",
    log:
        RESULTS / "logs/model_comparison/transmission_trials.log",
    params:
        code=jobs.code_of("bench.compare_transmission_models"),
        settings=CONFIG.dynamometer.part("SteppedSineAnalysis"),
        sign_width=CONFIG.model_comparison.sign_width,
    run:
        jobs.run_job(log, "bench.compare_transmission_models", input, output, params)


rule compare_impedance_models:
    input:
        **device(),
        trial=RESULTS / "trials/{trial}.parquet",
        fitted=lambda wildcards: rows("impedance", [wildcards.trial]),
    output:
        RESULTS / "fits/model_comparison/{trial}.csv",
    log:
        RESULTS / "logs/model_comparison/{trial}.log",
    wildcard_constraints:
        trial=CAMPAIGN.pattern("impedance"),
    params:
        code=jobs.code_of("bench.compare_impedance_models"),
        settings=CONFIG.dynamometer.part("ImpedanceAnalysis"),
        weight=CONFIG.gain_weight.model_dump(mode="json"),
        sign_width=CONFIG.model_comparison.sign_width,
        condition=sheet_row("controller", "K_d", "B_d"),
        windows=stated_windows,
    run:
        jobs.run_job(log, "bench.compare_impedance_models", input, output, params)
