"""One crossing of the walkway: from the ingested trial to angle and torque."""

from pathlib import Path

from osl_analysis.commands.calibration_file import read_calibration, read_plate
from osl_analysis.commands.crossing_file import write_crossing
from osl_analysis.trial_file import read_trial
from osl_analysis.walking.crossing import analyse_crossing
from osl_analysis.walking.settings import WalkingAnalysis


def analyse(
    trial: Path, calibration: Path, plate: Path, perturbed: bool, settings: WalkingAnalysis, output: Path
) -> None:
    """Angle and torque of one crossing, with its events, to a Parquet file; `perturbed` is what the sheet says."""
    static, model = read_calibration(calibration), read_plate(plate)
    write_crossing(analyse_crossing(read_trial(trial), static, model, perturbed, settings), output)
