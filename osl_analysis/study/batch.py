"""One batch of the study: the estimates of some trials, or some campaigns of walking, of one experiment."""

from collections.abc import Callable

from osl_analysis.study.actuator import actuator
from osl_analysis.study.bench import belt, drivetrain, linear_drivetrain, second_order, transmission
from osl_analysis.study.phasors import response_bench
from osl_analysis.study.recorded import with_fewer_bits, with_jitter, with_printed_stamps
from osl_analysis.study.repeats import repeated_belt, repeated_transmission
from osl_analysis.study.trials import StudiedExperiment, StudyInputs, StudyRow, trial_rows
from osl_analysis.study.walking import walking_rows

WALKING = ("walking", RECORDED := "walking recorded")
"""Walking from angle and torque on, and through markers, plate, C3D files and ingest."""
BENCH: dict[str, Callable[[StudyInputs], StudiedExperiment]] = {
    "second order": second_order,
    "second order, jitter": lambda inputs: second_order(with_jitter(inputs)),
    "second order, printed stamps": lambda inputs: second_order(with_printed_stamps(inputs)),
    "second order, 14 bits": lambda inputs: second_order(with_fewer_bits(inputs)),
    "linear drivetrain": linear_drivetrain,
    "drivetrain": drivetrain,
    "transmission": transmission,
    "belt": belt,
    "repeated transmission": repeated_transmission,
    "repeated belt": repeated_belt,
    "frequency response": response_bench,
    "actuator": actuator,
}


def batch_rows(experiment: str, numbers: range, inputs: StudyInputs) -> list[StudyRow]:
    """Estimates of the trials (or campaigns of walking) of these numbers.

    Raises
    ------
    InputError
        The simulation lacks what the experiment needs.
    """
    if experiment in WALKING:
        rows = list(walking_rows(inputs, numbers, recorded=experiment == RECORDED))
    else:
        analysis = inputs.actuator if experiment == "actuator" else inputs.dynamometer
        names = [f"{experiment}_{number:05d}" for number in numbers]
        rows = trial_rows(BENCH[experiment](inputs), names, analysis.low_pass)
    return [{"experiment": experiment, **row} for row in rows]
