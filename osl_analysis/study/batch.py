"""One batch of the study: the estimates of some trials, or some campaigns of walking, of one experiment."""

from osl_analysis.study import BENCH, RECORDINGS, WALKING, actuator, bench, phasors, recorded, repeats
from osl_analysis.study.trials import StudiedExperiment, StudyInputs, StudyRow, trial_rows
from osl_analysis.study.walking import walking_rows

MODULES = {"actuator": actuator, "bench": bench, "phasors": phasors, "repeats": repeats}


def studied(experiment: str, inputs: StudyInputs) -> StudiedExperiment:
    """An experiment on a bench, ready to be repeated."""
    _, _, recording = experiment.partition(", ")
    if recording in RECORDINGS:
        return bench.default_only(bench.second_order(recorded.recorded_as(inputs, RECORDINGS[recording])))
    module, _, function = BENCH[experiment].partition(".")
    ready: StudiedExperiment = getattr(MODULES[module], function)(inputs)
    return ready


def batch_rows(experiment: str, numbers: range, inputs: StudyInputs) -> list[StudyRow]:
    """Estimates of the trials (or campaigns of walking) of these numbers.

    Raises
    ------
    InputError
        The simulation lacks what the experiment needs.
    """
    if experiment in WALKING:
        rows = list(walking_rows(inputs, numbers, recorded=WALKING[experiment][0] == "recorded"))
    else:
        analysis = inputs.actuator if experiment == "actuator" else inputs.dynamometer
        names = [f"{experiment}_{number:05d}" for number in numbers]
        rows = trial_rows(studied(experiment, inputs), names, analysis.low_pass)
    return [{"experiment": experiment, **row} for row in rows]
