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


def compared(name: str) -> dict[str, list[Path]]:
    """The trials of a comparison over trials, and the verdicts on them."""
    return {"trials": [trial_file(trial) for trial in REPEATS[name]], "quality": checked(REPEATS[name])}


rule compare_belt_models:
    input:
        unpack(
            lambda wildcards: job(
                rules.compare_belt_models,
                wildcards,
                "bench.compare_belt_models",
                input={"fitted": rows("belt", REPEATS[wildcards.belts])},
                read=compared(wildcards.belts),
                files={"parameters": device(REPEATS[wildcards.belts][0])},
                settings={"settings": CONFIG.dynamometer.part("BeltAnalysis")},
            )
        ),
    output:
        RESULTS / "fits/model_comparison/{belts}.csv",
    log:
        RESULTS / "logs/model_comparison/{belts}.log",
    wildcard_constraints:
        belts="belt_trials(_[0-9]+)?",
    shell:
        JOB


rule compare_transmission_models:
    input:
        unpack(
            lambda wildcards: job(
                rules.compare_transmission_models,
                wildcards,
                "bench.compare_transmission_models",
                input={"fitted": rows("transmission", REPEATS[wildcards.transmissions])},
                read=compared(wildcards.transmissions),
                settings={
                    "settings": CONFIG.dynamometer.part("SteppedSineAnalysis"),
                    "sign_width": CONFIG.model_comparison.sign_width,
                },
            )
        ),
    output:
        RESULTS / "fits/model_comparison/{transmissions}.csv",
    log:
        RESULTS / "logs/model_comparison/{transmissions}.log",
    wildcard_constraints:
        transmissions="transmission_trials(_[0-9]+)?",
    shell:
        JOB


rule compare_impedance_models:
    input:
        unpack(
            lambda wildcards: job(
                rules.compare_impedance_models,
                wildcards,
                "bench.compare_impedance_models",
                input={"fitted": rows("impedance", [wildcards.trial])},
                read={"trial": trial_file(wildcards.trial)},
                files={"parameters": device(wildcards.trial)},
                settings={
                    "settings": CONFIG.dynamometer.part("ImpedanceAnalysis"),
                    "weight": CONFIG.gain_weight.model_dump(mode="json"),
                    "sign_width": CONFIG.model_comparison.sign_width,
                    "windows": CAMPAIGN.row(wildcards.trial)["windows"],
                    **condition(wildcards.trial, ("controller", "K_d", "B_d")),
                },
            )
        ),
    output:
        RESULTS / "fits/model_comparison/{trial}.csv",
    log:
        RESULTS / "logs/model_comparison/{trial}.log",
    wildcard_constraints:
        trial="(?!(belt|transmission)_trials).*",
    shell:
        JOB
