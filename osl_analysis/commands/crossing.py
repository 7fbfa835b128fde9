"""One crossing of the walkway: from the ingested trial to angle and torque, or to the reason why not."""

import warnings
from pathlib import Path

from osl_analysis.commands.calibration_file import read_calibration, read_plate
from osl_analysis.commands.crossing_file import Refusal, write_crossing, write_refusal
from osl_analysis.errors import OslAnalysisError
from osl_analysis.trial_file import read_trial
from osl_analysis.walking.crossing import analyse_crossing
from osl_analysis.walking.settings import WalkingAnalysis


def analyse(
    trial: Path, calibration: Path, plate: Path, perturbed: bool, settings: WalkingAnalysis, output: Path
) -> None:
    """Angle and torque of one crossing, with its events, to a Parquet file; `perturbed` is what the sheet says.

    A crossing that cannot be analysed is one that cannot be used, not one that stops the others: its file holds the
    reason in place of samples, and the reason is given as a warning.
    """
    static, model, record = read_calibration(calibration), read_plate(plate), read_trial(trial)
    try:
        crossing = analyse_crossing(record, static, model, perturbed, settings)
    except OslAnalysisError as error:
        warnings.warn(f"left out: {error}", stacklevel=2)
        write_refusal(Refusal(record.name, perturbed, str(error)), output)
    else:
        write_crossing(crossing, output)
