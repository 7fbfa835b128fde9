# SPDX-License-Identifier: Apache-2.0
"""Step 4, set-up: check a crossing against its static trial, and measure its quality.

The plate, the markers of each cluster, the ankle between foot and shank, the platform at rest and
the corners stay as in the static trial; the largest difference is named. The spectrum of markers
shows whether they were smoothed, the residual of the foot's rigid body whether gaps were filled.

Example: `crossing_quality(trial, passage, ankle, load, calibration, settings).different_mm`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from osl_analysis.base.errors import InputError
from osl_analysis.base.trial import Array, Trial
from osl_analysis.signals.filters import longest_run
from osl_analysis.walking import platform
from osl_analysis.walking.geometry import Ankle, Passage
from osl_analysis.walking.plate import (
    FLAT,
    SINGLE_SUPPORT,
    Stance,
    between,
    outside,
)
from osl_analysis.walking.poses import Poses, StaticCalibration, marker_tracks, moved_marker
from osl_analysis.walking.walking_settings import CrossingSettings

FRAMES_OF_SPECTRUM = 128  # of markers: 0.4 s at 300 Hz
SLOW_NOISE = (0.05, 0.12)  # frequencies of marker noise, as shares of their rate
FAST = (0.4, 0.5)
LEAST_RESIDUAL_M = 1e-5  # of a foot's rigid body: a measured one has more
LARGEST_OUTSIDE_M = 0.02  # of a foot marker from the plate: markers stand so far off the sole
LATE = (0.6, SINGLE_SUPPORT[1])  # phases in which every foot pushes off, the toes down
SMALLEST_CHANGE = np.array([0.03, 20.0])  # of roll [m] and push [N] that have a direction
# its largest angle from forward: a foot out-toes by 20 deg, and the side force of slow gait changes
# nearly as much as its push
LARGEST_TURN_DEG = 60.0


def differences(
    trial: Trial,
    passage: Passage,
    ankle: Ankle,
    calibration: StaticCalibration,
    settings: CrossingSettings,
) -> dict[str, float]:
    """Differences [m] between a crossing and the static trial, by what differs.

    Parameters
    ----------
    ankle : Ankle
        Ankle in the rows of the passage; its centre is the mean of the foot's and the shank's.
    """
    distances = {}
    before = passage.onset if passage.onset is not None else passage.stance.toe_off
    undisturbed = Stance(passage.stance.heel_strike, before)
    stands = undisturbed.contains(passage.frames)
    for segment, names in settings.markers.clusters.items():
        poses = passage.recorded[segment]
        rows = stands & poses.seen() & ~poses.bridged
        if not rows.any():
            continue
        _, tracks = marker_tracks(trial, names)
        reference = calibration.positions(names)
        marker, distance_m = moved_marker(reference, tracks[rows], poses[rows])
        distances[f"marker {names[marker]} of the {segment}"] = distance_m

    inside = undisturbed.contains(passage.time)
    foot = passage.poses["foot"]
    foot_centre = foot.point(calibration.ankle_centre)
    # the ankle's centre is the mean of the foot's and the shank's: these are twice as far apart
    distance = 2 * (foot_centre - ankle.centre)[inside]
    in_foot = np.einsum("nji,nj->ni", foot.rotation[inside], distance)
    distances["the ankle between foot and shank"] = float(np.linalg.norm(in_foot.mean(axis=0)))

    in_static = calibration.corners.get(settings.plate)
    if in_static is not None:
        shift = passage.corners - in_static
        distances[f"the corners of force plate {settings.plate}"] = root_mean_square(shift)

    plate = passage.recorded["platform"]
    rests = (passage.frames < passage.stance.heel_strike) & plate.seen()
    if rests.sum() >= platform.FEWEST_FRAMES:
        reference = calibration.positions(settings.markers.platform)
        place = np.median(plate[rests].points(reference), axis=0)
        distances["the platform at rest"] = root_mean_square(place - reference)
    return distances


def root_mean_square(distances: Array) -> float:
    """RMS length of vectors (k, 3)."""
    return np.linalg.norm(distances) / np.sqrt(len(distances))


@dataclass(frozen=True)
class CrossingQuality:
    """Measures of one crossing; None where unknown. The dictionary says what each is."""

    cop_outside_m: float | None = None
    different: str | None = None
    different_mm: float | None = None
    marker_noise_ratio: float | None = None
    foot_residual_ratio: float | None = None
    turn_share: float | None = None


def crossing_quality(
    trial: Trial,
    passage: Passage,
    ankle: Ankle,
    load: Array,
    calibration: StaticCalibration,
    settings: CrossingSettings,
) -> CrossingQuality:
    """Measure the quality of a crossing that markers and plate recorded."""
    flat = between(passage.stance.phase(passage.time), FLAT)
    foot = passage.poses["foot"][flat]
    markers = foot.points(calibration.positions(settings.markers.foot))

    _, left_m, forward_m = load[:, :, None]
    centre_of_pressure = (ankle.centre + left_m * ankle.axis + forward_m * ankle.forward)[flat]
    unlike_static = differences(trial, passage, ankle, calibration, settings)
    plate_poses = passage.poses["platform"][flat]
    platform_markers = plate_poses.points(calibration.positions(settings.markers.platform))
    points = np.concatenate([markers, platform_markers], axis=1).reshape(-1, 3)
    heights = points[outside(points, passage.corners) == 0, 2]
    above_m = passage.corners[:, 2].mean() - heights.min(initial=np.inf)
    corners_above = f"the corners of force plate {settings.plate} above a marker that is over it"
    unlike_static[corners_above] = max(above_m, 0.0)
    different = max(unlike_static, key=unlike_static.__getitem__)
    return CrossingQuality(
        cop_outside_m=cop_outside(centre_of_pressure, markers),
        different=different,
        different_mm=1e3 * unlike_static[different],
        marker_noise_ratio=marker_noise_ratio(trial, settings.markers.platform),
        **window_quality(passage, settings.window_s),
    )


def marker_noise_ratio(trial: Trial, names: Sequence[str]) -> float | None:
    """Power of the noise of markers near half their rate, over that where feet hardly move.

    Of raw markers it is 0.07 to 1, also where their noise is coloured. A low-pass leaves nothing.
    """
    _, tracks = marker_tracks(trial, names)
    rows = longest_run(np.asarray(np.isfinite(tracks).all(axis=(1, 2))))
    if rows.stop - rows.start < FRAMES_OF_SPECTRUM:
        return None
    welch: Any = scipy.signal.welch
    f, power = welch(
        tracks[rows].reshape(-1, 3 * len(names)),
        nperseg=FRAMES_OF_SPECTRUM,
        detrend="linear",
        average="median",
        axis=0,
    )
    high, low = (power[between(f, band)].mean() for band in (FAST, SLOW_NOISE))
    return float(high / low) if low else None


def window_quality(passage: Passage, window_s: float) -> dict[str, float]:
    """Residual of the foot's rigid body in the window over that before, and the share of the
    platform's turn in the window.

    Filled markers raise the first.
    """
    if passage.onset is None:
        return {}
    time = passage.frames
    window = between(time, (passage.onset, passage.onset + window_s))
    before = (time >= passage.stance.heel_strike) & (time < passage.onset)
    residual = passage.recorded["foot"].residual
    in_window, usual = (np.sqrt(np.nanmean(residual[rows] ** 2)) for rows in (window, before))
    turn = platform.rotation_from_rest(passage.recorded["platform"])
    ratios = {"turn_share": float(np.nanmax(turn[window]) / np.nanmax(turn))}
    if usual > LEAST_RESIDUAL_M:
        ratios["foot_residual_ratio"] = float(in_window / usual)
    return ratios


def check_followed(
    segment: str, frames: Array, pose: Poses, stance: Stance, largest_residual_mm: float
) -> None:
    """Refuse a cluster that is occluded in stance, or was put on again since the static trial."""
    occluded = np.flatnonzero(stance.contains(frames) & ~pose.seen())
    if len(occluded):
        raise InputError(
            f"the {segment} markers cannot be followed at {frames[occluded[0]]:.3f} s, in"
            f" {len(occluded)} frames of stance: fewer than three are seen, or they stand more than"
            f" {largest_residual_mm:g} mm (RMS) otherwise than in the static trial",
            "correct exchanged labels in Nexus (if all crossings fail, those of the static trial),"
            " record a static trial after they were put on again and name it in the column static,"
            " or exclude the trial",
        )


def check_on_plate(plate: int, frames: Array, foot: Array, stance: Stance, corners: Array) -> None:
    """Refuse a foot whose markers (k, m, 3) [m] lie beside the plate while this is loaded."""
    flat = between(stance.phase(frames), FLAT)
    outside_m = outside(foot[flat].reshape(-1, 3), corners).max(initial=0.0)
    if outside_m > LARGEST_OUTSIDE_M:
        raise InputError(
            f"a foot marker lies {100 * outside_m:.1f} cm beside force plate {plate} while a flat"
            f" foot loads it, expected {100 * LARGEST_OUTSIDE_M:g} cm or less: another foot stands"
            " on it, or a part of this one beside it",
            "state the plate under this foot as `walking.plate`, correct its corners, or exclude"
            " the trial",
        )


def check_turn(turns: bool, perturbed: bool) -> None:
    """Refuse a platform that turns although the sheet says that it does not, or the other way."""
    if turns != perturbed:
        raise InputError(
            f"the platform {'does not turn' if perturbed else 'turns'}, but the sheet says"
            f" perturbed = {str(perturbed).lower()}",
            "correct the sheet, perturbation_deg or the platform markers, or exclude the trial",
        )


def check_onset(onset: float, stance: Stance, settings: CrossingSettings) -> None:
    """Refuse an onset [s] whose response leaves stance."""
    first = onset - settings.guard_s - settings.baseline_s
    last = onset + settings.window_s
    if first < stance.heel_strike or last > stance.toe_off:
        raise InputError(
            f"baseline and window of the perturbation, {first:.3f}-{last:.3f} s, leave stance"
            f" {stance.heel_strike:.3f}-{stance.toe_off:.3f} s",
            "exclude the trial, or turn the platform nearer to midstance; if stance is cut short in"
            " all trials, a part of the foot stands beside the plate",
        )


def check_side(phase: Array, ahead: Array) -> None:
    """Refuse an ankle's axis that points to the right.

    The shank, which is `ahead` (n,) [m] of the ankle, then leans backwards in stance.
    """
    first, last = np.interp(SINGLE_SUPPORT, phase, ahead)
    if last <= first:
        raise InputError(
            f"the shank moves {100 * (first - last):.0f} cm backwards over the foot in stance:"
            " the ankle's axis points to the wrong side",
            "correct `side`, exchange ankle_medial and ankle_lateral, or correct the labels of"
            " the static trial's markers",
        )


def check_roll(phase: Array, load: Array, push: Array, torque: Array) -> None:
    """Refuse a load that does not roll and push forward over the foot, or pulls the toes up.

    Turned corners turn both. A channel of the wrong sign turns one, and corners that are turned to
    make up for it turn the other.

    Parameters
    ----------
    phase : Array
        Phase of stance (n,).
    load : Array
        Load (3, n), as in `Crossing`.
    push : Array
        Horizontal force [N] to the left and forward (2, n), which brakes before it pushes.
    torque : Array
        Undisturbed torque (n,) [N*m], else 0; in late stance every foot pushes the toes down.
    """
    both = np.vstack([load[1:], push])
    late = both[:, between(phase, LATE)].mean(axis=1)
    flat = both[:, between(phase, FLAT)].mean(axis=1)
    left, forward = (late - flat).reshape(2, 2).T
    size = np.hypot(left, forward)
    deg = np.abs(np.rad2deg(np.arctan2(left, forward)))
    turned = (deg > LARGEST_TURN_DEG) & (size > SMALLEST_CHANGE)
    moment = torque[between(phase, LATE)].mean()
    if moment >= 0 and not turned.any():
        return
    cause = (
        "a channel of the plate, of a moment or of a horizontal force, has the wrong sign: correct"
        " it in the recorder and export again; the source file cannot reverse one channel, and"
        " corners that are turned in its place give a wrong K"
    )
    if turned.all():
        cause = (
            "the plate's corners or axes are turned: correct the corners' order, the first lies in"
            " +x and +y of the plate's own axes, or `axes` in the source file"
        )
    pulls = f", and the ankle pulls the toes up with {-moment:.1f} N*m" if moment < 0 else ""
    raise InputError(
        f"from the flat foot to late stance the centre of pressure moves by {100 * size[0]:.0f}"
        f" cm, {deg[0]:.0f} deg from forward, and the horizontal force changes by {size[1]:.0f}"
        f" N, {deg[1]:.0f} deg from forward{pulls}. If it is so in all trials, {cause}",
        "else another foot stands on the plate: exclude the trial",
    )


def body_mass(trial: Trial, sheet: float | None) -> float | None:
    """Body mass [kg] of a trial: that of the sheet, else that of the recording; None where neither
    has one."""
    return sheet or trial.provenance.get("mocap", {}).get("body_mass_kg") or None


def cop_outside(centre_of_pressure: Array, markers: Array) -> float:
    """Mean distance [m] of the centre of pressure (n, 3) [m] beyond the edges of the area between
    foot markers.

    Both are seen from above, the markers (n, m, 3) [m] at their mean place.
    """
    on_mean_foot = centre_of_pressure - markers.mean(axis=1) + markers.mean(axis=(0, 1))
    hull = scipy.spatial.ConvexHull(markers.mean(axis=0)[:, :2])
    beyond = on_mean_foot[:, :2] @ hull.equations[:, :2].T + hull.equations[:, 2]
    return float(np.mean(np.maximum(beyond.max(axis=1), 0.0)))
