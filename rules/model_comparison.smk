"""Rival models side by side: belt and transmission predict other trials, the rendered impedance other amplitudes."""

REPEATS = {
    f"{experiment}_trials" + f"_{number}" * (number > 1): trials
    for experiment in ("belt", "transmission")
    for number, trials in enumerate(CAMPAIGN.by_place(experiment), start=1)
}
"""Comparisons over trials: the trials of each joint and side, which predict each other."""
AMPLITUDES = CAMPAIGN.predicted() if len(CONFIG.dynamometer.amplitudes_deg) > 1 else []
COMPARISONS = [*REPEATS, *AMPLITUDES]
IS_PREDICTED = bool(AMPLITUDES) or any(len(trials) > 1 for trials in REPEATS.values())
"""Whether any model predicts data that it was not fitted to."""


rule compare_belt_models:
    input:
        parameters=lambda wildcards: CAMPAIGN.device(REPEATS[wildcards.belts][0]) or [],
        fitted=lambda wildcards: rows("belt", REPEATS[wildcards.belts]),
    output:
        RESULTS / "fits/model_comparison/{belts}.csv",
    log:
        RESULTS / "logs/model_comparison/{belts}.log",
    wildcard_constraints:
        belts="belt_trials(_[0-9]+)?",
    group:
        "shared"
    params:
        code=jobs.code_of("bench.compare_belt_models"),
        settings=CONFIG.dynamometer.part("BeltAnalysis"),
    run:
        trials = REPEATS[wildcards.belts]
        read = {"trials": [trial_file(trial) for trial in trials], "quality": checked(trials)}
        jobs.run_job(log, "bench.compare_belt_models", input, output, params, read=read)


rule compare_transmission_models:
    input:
        fitted=lambda wildcards: rows("transmission", REPEATS[wildcards.transmissions]),
    output:
        RESULTS / "fits/model_comparison/{transmissions}.csv",
    log:
        RESULTS / "logs/model_comparison/{transmissions}.log",
    wildcard_constraints:
        transmissions="transmission_trials(_[0-9]+)?",
    group:
        "shared"
    params:
        code=jobs.code_of("bench.compare_transmission_models"),
        settings=CONFIG.dynamometer.part("SteppedSineAnalysis"),
        sign_width=CONFIG.model_comparison.sign_width,
    run:
        trials = REPEATS[wildcards.transmissions]
        read = {"trials": [trial_file(trial) for trial in trials], "quality": checked(trials)}
        jobs.run_job(log, "bench.compare_transmission_models", input, output, params, read=read)


rule compare_impedance_models:
    input:
        fitted=[RESULTS / "fits/impedance/{trial}.csv"],
    output:
        RESULTS / "fits/model_comparison/{trial}.csv",
    log:
        RESULTS / "logs/model_comparison/{trial}.log",
    wildcard_constraints:
        trial="(?!(belt|transmission)_trials).*",
    group:
        "trials"
    params:
        code=jobs.code_of("bench.compare_impedance_models"),
        settings=CONFIG.dynamometer.part("ImpedanceAnalysis"),
        weight=CONFIG.gain_weight.model_dump(mode="json"),
        sign_width=CONFIG.model_comparison.sign_width,
        of_trial=stated("impedance", ("controller", "K_d", "B_d"), windows=True),
    run:
        device = CAMPAIGN.device(wildcards.trial) or []
        read = {"trial": trial_file(wildcards.trial), "parameters": device}
        jobs.run_job(log, "bench.compare_impedance_models", input, output, params, read=read)
