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


def comparison(command: str, pattern: str, **constraints):
    """The step that writes a comparison of models."""
    return step(command, RESULTS / f"fits/model_comparison/{pattern}.csv", f"model_comparison/{pattern}", **constraints)


@comparison("bench.compare_belt_models", "{belts}", belts="belt_trials(_[0-9]+)?")
def compare_belt_models(wildcards):
    trials = REPEATS[wildcards.belts]
    return {
        "input": {"fitted": rows("belt", trials)},
        "read": compared(wildcards.belts),
        "files": {"parameters": device(trials[0])},
        "settings": {"settings": CONFIG.dynamometer.part("BeltAnalysis")},
    }


@comparison("bench.compare_transmission_models", "{transmissions}", transmissions="transmission_trials(_[0-9]+)?")
def compare_transmission_models(wildcards):
    return {
        "input": {"fitted": rows("transmission", REPEATS[wildcards.transmissions])},
        "read": compared(wildcards.transmissions),
        "settings": {
            "settings": CONFIG.dynamometer.part("SteppedSineAnalysis"),
            "sign_width": CONFIG.model_comparison.sign_width,
        },
    }


@comparison("bench.compare_impedance_models", "{trial}", trial="(?!(belt|transmission)_trials).*")
def compare_impedance_models(wildcards):
    trial = wildcards.trial
    return {
        "input": {"fitted": rows("impedance", [trial])},
        "read": {"trial": trial_file(trial)},
        "files": {"parameters": device(trial)},
        "settings": {
            "settings": CONFIG.dynamometer.part("ImpedanceAnalysis"),
            "weight": CONFIG.gain_weight.model_dump(mode="json"),
            "sign_width": CONFIG.model_comparison.sign_width,
            "windows": CAMPAIGN.row(trial)["windows"],
            **condition(trial, ("controller", "K_d", "B_d")),
        },
    }
