"""What the crossings of a session share: the static calibration, and the model of the force plate."""

from collections.abc import Sequence
from pathlib import Path

from osl_analysis.commands.calibration_file import read_calibration, write_calibration, write_plate
from osl_analysis.trial_file import read_trial
from osl_analysis.walking.segments import static_calibration
from osl_analysis.walking.settings import WalkingAnalysis
from osl_analysis.walking.unloaded_plate import identify_plate_model


def calibrate(trial: Path, settings: WalkingAnalysis, output: Path) -> None:
    """Marker clusters, ankle centre and axis of the static trial, to a JSON file."""
    record = read_trial(trial)
    write_calibration(static_calibration(record, settings), record.name, output)


def identify_plate(trials: Sequence[Path], calibration: Path, settings: WalkingAnalysis, output: Path) -> None:
    """The plate's own inertia and its lag from trials without a foot on it, to a JSON file."""
    records = [read_trial(path) for path in trials]
    write_plate(identify_plate_model(records, read_calibration(calibration), settings), output)
