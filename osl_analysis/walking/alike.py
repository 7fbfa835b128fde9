"""What stays the same from the static trial on, compared directly: the markers of each cluster, the
ankle between foot and shank, the platform at rest and the corners of the plate.

What differs is named by itself, whatever it does to the torque.
"""

import numpy as np

from osl_analysis.trial import Array, Trial
from osl_analysis.walking.ankle import Ankle
from osl_analysis.walking.passage import Passage
from osl_analysis.walking.plate import recorded_plate
from osl_analysis.walking.poses import StaticCalibration, marker_tracks, moved_marker
from osl_analysis.walking.walking_settings import CrossingSettings

FEWEST_FRAMES = 10  # at rest, that tell where the platform stands


def differences(
    trial: Trial,
    passage: Passage,
    ankle: Ankle,
    calibration: StaticCalibration,
    settings: CrossingSettings,
) -> dict[str, float]:
    """Tell by how much [m] each thing stands otherwise in a crossing than in the static trial.

    Parameters
    ----------
    ankle : Ankle
        In the rows of the passage; its centre is the mean of the foot's and the shank's.
    """
    distances = {}
    before = passage.onset if passage.onset is not None else passage.stance.toe_off
    stands = (passage.frames >= passage.stance.heel_strike) & (passage.frames <= before)
    for segment, names in settings.markers.clusters.items():
        poses = passage.recorded[segment]
        rows = stands & poses.seen() & ~poses.bridged
        if not rows.any():
            continue
        _, tracks = marker_tracks(trial, names)
        reference = calibration.positions(names, trial.name)
        moved = moved_marker(reference, tracks[rows], poses[rows])
        distances[f"marker {names[moved.index]} of the {segment}"] = moved.distance_m

    inside = (passage.time >= passage.stance.heel_strike) & (passage.time <= before)
    of_foot = passage.poses["foot"].point(calibration.ankle_centre)
    apart = 2 * (of_foot - ankle.centre)[inside]  # the shank's centre is as far on the other side
    in_foot = np.einsum("nji,nj->ni", passage.poses["foot"].rotation[inside], apart)
    distances["the ankle between foot and shank"] = float(np.linalg.norm(in_foot.mean(axis=0)))

    in_static = calibration.corners.get(settings.plate)
    in_trial = recorded_plate(trial, settings.plate).get("corners")
    if in_static is not None and in_trial is not None:
        shift = np.asarray(in_trial) - in_static
        distances[f"the corners of force plate {settings.plate}"] = root_mean_square(shift)

    platform = passage.recorded["platform"]
    rests = (passage.frames < passage.stance.heel_strike) & platform.seen()
    if rests.sum() >= FEWEST_FRAMES:
        reference = calibration.positions(settings.markers.platform, trial.name)
        place = np.median(platform[rests].points(reference), axis=0)
        distances["the platform at rest"] = root_mean_square(place - reference)
    return distances


def root_mean_square(distances: Array) -> float:
    """RMS length of vectors (k, 3)."""
    return float(np.sqrt(np.mean(np.sum(distances**2, axis=1))))
