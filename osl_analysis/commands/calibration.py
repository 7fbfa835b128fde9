"""What the crossings of a session share: static calibration, the ankle's hinge, and the model of the force plate."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.commands.calibration_file import COMPONENTS, read_calibration, write_calibration, write_plate
from osl_analysis.errors import InputError
from osl_analysis.table import write_table
from osl_analysis.trial import Trial
from osl_analysis.trial_file import read_trial
from osl_analysis.walking.ankle import StaticCalibration
from osl_analysis.walking.hinge import Hinge, functional_hinge, hinged
from osl_analysis.walking.plate_inertia import PlateModel
from osl_analysis.walking.rigid_body import Poses
from osl_analysis.walking.segments import segment_poses, static_calibration
from osl_analysis.walking.settings import WalkingAnalysis
from osl_analysis.walking.unloaded_plate import identify_plate_model


def calibrate(trial: Path, motion: Sequence[Path], settings: WalkingAnalysis, output: Path, comparison: Path) -> None:
    """Marker clusters, ankle centre and axis of the static trial, to a JSON file.

    `motion` are trials in which the ankle moves: their functional hinge is compared with the anatomical axis in the
    table `comparison`, and takes its place if the settings say so.
    """
    record = read_trial(trial)
    static = static_calibration(record, settings)
    try:
        hinge = hinge_of([read_trial(path) for path in motion], static, settings)
    except InputError as error:
        if settings.hinge == "functional":
            raise
        write_table(pl.DataFrame([{"axis": settings.hinge, "reason": str(error)}]), comparison)
    else:
        write_table(pl.DataFrame([hinge_row(hinge, settings.hinge)]), comparison)
        static = hinged(static, hinge) if settings.hinge == "functional" else static
    write_calibration(static, record.name, output)


def hinge_of(motion: Sequence[Trial], static: StaticCalibration, settings: WalkingAnalysis) -> Hinge:
    """The hinge that the trials show together; a trial whose markers cannot be read does not count."""
    recordings: list[tuple[Poses, Poses]] = []
    for trial in motion:
        try:
            foot = segment_poses(trial, settings.markers.foot, static.foot, settings)[1]
            shank = segment_poses(trial, settings.markers.shank, static.shank, settings)[1]
        except InputError:
            continue
        recordings.append((foot, shank))
    if not recordings:
        raise InputError("no trial in which foot and shank move; add walking trials, or set hinge to anatomical")
    return functional_hinge(recordings, static)


def hinge_row(hinge: Hinge, used: str) -> dict[str, object]:
    """The row of `hinge.csv`: functional axis (to the left) in the static pose, and how far the anatomical one is."""
    return {
        "axis": used,
        **{f"functional_{name}": float(value) for name, value in zip("xyz", hinge.axis, strict=True)},
        "angle_deg": float(np.rad2deg(hinge.angle)),
        "distance_mm": 1e3 * hinge.distance,
        "excursion_deg": float(np.rad2deg(hinge.excursion)),
        "off_axis_deg": float(np.rad2deg(hinge.off_axis)),
        "gap_mm": 1e3 * hinge.gap,
        "frames": hinge.frames,
    }


def identify_plate(
    trials: Sequence[Path], calibration: Path, settings: WalkingAnalysis, output: Path, comparison: Path
) -> None:
    """The plate's own inertia and its lag from trials without a foot on it, to a JSON file, and to the table
    `comparison` what the unloaded plate reads before and after both are removed."""
    records = [read_trial(path) for path in trials]
    model = identify_plate_model(records, read_calibration(calibration), settings)
    write_plate(model, output)
    write_table(plate_table(model), comparison)


def plate_table(model: PlateModel) -> pl.DataFrame:
    """Per component of the wrench: RMS [N, N*m] before and after, and what is left of it; lag [s] with its SE."""
    before, after = model.inertia.rms_before, model.inertia.rms_after
    left = [100 * a / b if b > 0 else None for b, a in zip(before.tolist(), after.tolist(), strict=True)]
    rows = {"component": COMPONENTS, "rms_before": before, "rms_after": after, "left_percent": left}
    lag = {"lag_s": model.lag, "lag_se_s": model.lag_se, "trials": len(model.lags)}
    return pl.DataFrame(rows).with_columns(**{name: pl.lit(value) for name, value in lag.items()})
