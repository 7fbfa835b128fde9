"""Jobs up to the analysed crossing: static calibration, the plate's model, and each crossing."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import polars as pl

from osl_analysis.commands.walking_files import (
    on_the_walkway,
    read_calibration,
    read_plate,
    read_platform,
    write_calibration,
    write_crossing,
    write_plate,
    write_platform,
    write_refusal,
)
from osl_analysis.errors import InputError, OslAnalysisError
from osl_analysis.table import Places, write_table
from osl_analysis.trial import read_trial
from osl_analysis.walking.bodies import StaticCalibration, hinge_of_trials, hinge_row, static_calibration
from osl_analysis.walking.crossing import RefusedCrossing, analyse_crossing
from osl_analysis.walking.plate import NO_CORRECTION, NOT_REMOVED, identify_plate_model, plate_table
from osl_analysis.walking.platform import ALONE, identify_platform, platform_table
from osl_analysis.walking.settings import (
    CalibrationSettings,
    CrossingSettings,
    PlateModelSettings,
    PlatformMotionSettings,
)
from osl_analysis.walking.setup import body_mass, check_direction


def calibrate(
    trial: Path, motion: Sequence[Path], settings: CalibrationSettings, output: Path, comparison: Path
) -> None:
    """Marker clusters, ankle centre and axis of the static trial, to a JSON file. The functional hinge of the trials
    `motion` is compared with the anatomical axis in the table `comparison`, and replaces it if the settings say so."""
    standing = read_trial(trial)
    static = static_calibration(standing, settings)
    row: dict[str, object]
    try:
        hinge = hinge_of_trials([read_trial(path) for path in motion], static, settings)
    except InputError as error:
        if settings.hinge == "functional":
            raise
        row = {"axis": settings.hinge, "reason": str(error)}
    else:
        row = hinge_row(hinge, settings.hinge)
        if settings.hinge == "functional":
            static = replace(static, ankle_axis=hinge.axis, ankle_centre=hinge.centre)
    write_table(pl.DataFrame([{"trial": standing.name} | row]), comparison)
    write_calibration(static, standing.name, output)


def calibrations_of(calibrations: Sequence[Path], statics: Mapping[str, str]) -> dict[str, StaticCalibration]:
    """The calibration of each trial that has one. `statics` has the static trial of each, which names the file."""
    read = {path.stem: read_calibration(path) for path in calibrations}
    return {trial: read[static] for trial, static in statics.items() if static in read}


def identify_plate(
    trials: Sequence[Path],
    calibrations: Sequence[Path],
    statics: Mapping[str, str],
    settings: PlateModelSettings,
    output: Path,
    comparison: Path,
) -> None:
    """The plate's inertia and lag from trials of the unloaded plate, to a JSON file. `statics` has the static trial of
    each trial, whose files `calibrations` are. The table `comparison` shows the unloaded plate's wrench before and
    after both are removed. A warning says so where the settings remove nothing."""
    if settings.plate_inertia == "none":
        warnings.warn(f"the plate's own inertia and lag stay in the torque: {NOT_REMOVED}", stacklevel=2)
        model = NO_CORRECTION
    else:
        calibrated = calibrations_of(calibrations, statics)
        read = [read_trial(path) for path in trials if path.stem in calibrated]
        model = identify_plate_model(read, calibrated, settings)
    write_plate(model, output)
    table = plate_table(model).fill_nan(None)
    write_table(table.with_columns(plate_inertia=pl.lit(settings.plate_inertia)), comparison)


def measure_platform(
    trials: Sequence[Path],
    calibrations: Sequence[Path],
    statics: Mapping[str, str],
    settings: PlatformMotionSettings,
    output: Path,
    comparison: Path,
    places: Places | None = None,
) -> None:
    """The motion that the platform's perturbations share, from the perturbed crossings, to a JSON file. The table
    `comparison` shows when each crossing's perturbation starts, and whether it follows the shared motion; `places` has
    joint and side of each."""
    calibrated = calibrations_of(calibrations, statics)
    read = [read_trial(path) for path in trials if path.stem in calibrated]
    model = identify_platform(read, calibrated, settings)
    write_platform(model, output)
    write_table(on_the_walkway(platform_table(model), places), comparison)


def analyse(
    trial: Path,
    calibration: Path,
    plate: Path,
    perturbed: bool,
    settings: CrossingSettings,
    output: Path,
    direction: str | None = None,
    body_mass_kg: float | None = None,
    platform: Path | None = None,
) -> None:
    """Angle and torque of one crossing, with its events, to a Parquet file. `perturbed`, `direction` and `body_mass_kg`
    are entries of the sheet. Without the file `platform`, the crossing has its own motion and onset of the platform.
    The file of a crossing that cannot be analysed has the reason instead of samples, and a warning states it."""
    static, model, walked = read_calibration(calibration), read_plate(plate), read_trial(trial)
    shared = ALONE if platform is None else read_platform(platform)
    try:
        crossing = analyse_crossing(walked, static, model, perturbed, settings, shared)
        check_direction(walked.name, direction, crossing.turn)
        crossing = replace(crossing, body_mass=body_mass(walked, body_mass_kg))
    except OslAnalysisError as error:
        warnings.warn(f"excluded: {error}", stacklevel=2)
        write_refusal(RefusedCrossing(walked.name, perturbed, str(error)), output)
    else:
        write_crossing(crossing, output)
