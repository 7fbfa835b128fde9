"""The clocks of angle and torque where two devices recorded them: how far they drift apart during a trial."""

from osl_analysis.bench.stepped_sine import SteppedSineTrial
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.stats.fit_row import Row
from osl_analysis.timebase.drift import ClockDrift, SinePiece, check_drift, clock_drift


def clock_drift_row(trial: SteppedSineTrial) -> Row:
    """`clock_drift_ppm` of the torque's clock against the angle's, its standard error, and the drift if it is certain.

    All null where one device recorded both.

    Raises
    ------
    InputError
        The drift is beyond what the configuration allows; the message names the trial.
    """
    drift = drift_of(trial)
    values = (None, None, None) if drift is None else (drift.ppm, drift.se, drift.certain_ppm)
    return dict(zip(("clock_drift_ppm", "clock_drift_se_ppm", "certain_clock_drift_ppm"), values, strict=True))


def drift_of(trial: SteppedSineTrial) -> ClockDrift | None:
    """The drift; None where one device recorded angle and torque, or the signals do not show it."""
    if trial.uniform is None or trial.uniform.one_device("theta", "torque"):
        return None
    pieces = [
        SinePiece(segment.frequency_hz, trial.time[rows], trial.motion[rows], trial.filtered_torque[rows])
        for segment in trial.segments(None)
        for rows in segment.pieces
    ]
    try:
        drift = clock_drift(pieces, trial.low_pass)
        check_drift(drift, trial.largest_drift_ppm)
    except IdentifiabilityError:
        return None
    except InputError as error:
        raise InputError(f"trial {trial.name}: {error}") from error
    return drift
