"""Segments of a recording: markers of a trial to the poses of foot, shank and platform."""

from collections.abc import Mapping, Sequence

import numpy as np

from osl_analysis.columns import marker_columns, plate_columns
from osl_analysis.errors import InputError
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.ankle import StaticCalibration, calibrate_static
from osl_analysis.walking.moving_plate import Wrench
from osl_analysis.walking.rigid_body import Poses, bridge_gaps, cluster_poses
from osl_analysis.walking.settings import WalkingAnalysis


def marker_tracks(trial: Trial, names: Sequence[str]) -> tuple[Array, Array]:
    """Time (n,) [s] of the marker frames and positions (n, m, 3) [m], NaN where a marker was hidden."""
    columns = [column for name in names for column in marker_columns(name)]
    rows = trial.sampled(*columns)
    if rows.is_empty():
        raise InputError(f"trial {trial.name}: markers {', '.join(names)} have no frames; record the trial again")
    return rows["time"].to_numpy(), rows.select(columns).to_numpy().reshape(-1, len(names), 3)


def plate_wrench(trial: Trial, plate: int) -> tuple[Array, Wrench]:
    """Time (k,) [s] of the plate's samples and its wrench, in the plate's axes about its centre."""
    signals = trial.signals(*plate_columns(plate, "force"), *plate_columns(plate, "moment"))
    values = np.column_stack(signals[1:])
    return signals[0], Wrench(values[:, :3], values[:, 3:])


def plate_centre(trial: Trial, plate: int) -> Array:
    """Centre (3,) [m] of the plate's surface at rest, the mean of its corners."""
    return np.asarray(plate_corners(trial, plate).mean(axis=0))


def plate_corners(trial: Trial, plate: int) -> Array:
    """Corners (4, 3) [m] of the plate at rest.

    Raises
    ------
    InputError
        The recording describes no such plate.
    """
    plates = trial.provenance.get("plates", [])
    found = [p["corners"] for p in plates if p["plate"] == plate]
    if not found:
        known = ", ".join(str(p["plate"]) for p in plates) or "none"
        raise InputError(f"trial {trial.name}: no corners of force plate {plate}, it has {known}; correct `plate`")
    return np.asarray(found[0], dtype=float)


def static_calibration(trial: Trial, settings: WalkingAnalysis) -> StaticCalibration:
    """Calibration from the static trial, by the names of the settings."""
    markers = settings.markers
    clusters = {
        segment: named_tracks(trial, names)
        for segment, names in (("foot", markers.foot), ("shank", markers.shank), ("platform", markers.platform))
    }
    ankle = named_tracks(trial, (markers.ankle_medial, markers.ankle_lateral))
    try:
        return calibrate_static(clusters, ankle[markers.ankle_medial], ankle[markers.ankle_lateral], settings.side)
    except InputError as error:
        raise InputError(f"trial {trial.name}: {error}") from error


def named_tracks(trial: Trial, names: Sequence[str]) -> dict[str, Array]:
    """Tracks (n, 3) [m] by marker."""
    tracks = marker_tracks(trial, names)[1]
    return {name: tracks[:, index] for index, name in enumerate(names)}


def reference_of(cluster: Mapping[str, Array], names: Sequence[str], trial: str) -> Array:
    """Calibrated positions (m, 3) [m] of the named markers."""
    absent = [name for name in names if name not in cluster]
    if absent:
        raise InputError(f"trial {trial}: marker {absent[0]} was not calibrated; calibrate the static trial again")
    return np.array([cluster[name] for name in names])


def segment_poses(
    trial: Trial, names: Sequence[str], cluster: Mapping[str, Array], settings: WalkingAnalysis
) -> tuple[Array, Poses]:
    """Time (n,) [s] and poses of one cluster: not filtered, short gaps bridged, long ones NaN."""
    time, observed = marker_tracks(trial, names)
    reference = reference_of(cluster, names, trial.name)
    poses = cluster_poses(reference, observed, settings.largest_residual_mm * 1e-3)
    return time, bridge_gaps(time, poses, settings.longest_gap_s)
