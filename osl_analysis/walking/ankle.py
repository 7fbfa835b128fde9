"""The ankle in the laboratory: static calibration, joint angle, and the moment about the joint's axis."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.cluster import GRAVITY, BodyMotion, Poses, axial_vector, marker_tracks, spans_a_plane
from osl_analysis.walking.plate import PlateWrench
from osl_analysis.walking.settings import CalibrationSettings

Side = Literal["left", "right"]
Vectors = dict[str, Array]
SEGMENTS = ("foot", "shank", "platform")
HIGHEST_FOOT = 0.05
"""Height [m] of the foot's markers above the shank's beyond which the clusters are exchanged. Standing, they are
lower by 0.1 m and more."""


@dataclass(frozen=True)
class StaticCalibration:
    """Result of the static trial, in laboratory axes. In the static pose every segment's axes are the laboratory's.

    foot, shank, platform: marker positions (3,) [m] by name.
    ankle_centre: point (3,) [m] that belongs to the foot and to the shank.
    ankle_axis: unit vector (3,) to the subject's left, the same for foot and shank.
    """

    foot: Vectors
    shank: Vectors
    platform: Vectors
    ankle_centre: Array
    ankle_axis: Array


Calibrations = StaticCalibration | Mapping[str, StaticCalibration]
"""One calibration of all trials, or that of each trial by its name."""


def calibration_of(calibrations: Calibrations, trial: str) -> StaticCalibration:
    """The calibration of a trial."""
    return calibrations if isinstance(calibrations, StaticCalibration) else calibrations[trial]


@dataclass(frozen=True)
class FootInertia:
    """Inertial parameters of all that moves with the foot.

    mass: [kg].
    centre_of_mass: (3,) [m] from the ankle centre in the static pose.
    inertia: [kg*m^2] about the axis through the centre of mass that is parallel to the ankle's.
    """

    mass: float
    centre_of_mass: Array
    inertia: float


def static_calibration(trial: Trial, settings: CalibrationSettings) -> StaticCalibration:
    """Calibration from the static trial, with the markers that the settings name."""
    markers = settings.markers
    clusters = {segment: named_tracks(trial, getattr(markers, segment)) for segment in SEGMENTS}
    medial, lateral = named_tracks(trial, (markers.ankle_medial, markers.ankle_lateral)).values()
    try:
        return calibrate_static(clusters, medial, lateral, settings.side)
    except InputError as error:
        raise InputError(f"trial {trial.name}: {error}") from error


def named_tracks(trial: Trial, names: Sequence[str]) -> Vectors:
    """Tracks (n, 3) [m] by marker."""
    tracks = marker_tracks(trial, names)[1]
    return {name: tracks[:, index] for index, name in enumerate(names)}


def calibrate_static(clusters: dict[str, Vectors], medial: Array, lateral: Array, side: Side) -> StaticCalibration:
    """Calibration from marker tracks (n, 3) [m] by name, for `foot`, `shank` and `platform`.

    `medial` and `lateral` (n, 3) [m] are the malleoli of the `side` that wears the prosthesis.

    Raises
    ------
    InputError
        A marker was never seen, a cluster's markers lie on a line, or the foot's are above the shank's.
    """
    means = {
        segment: {name: mean_position(name, track) for name, track in tracks.items()}
        for segment, tracks in clusters.items()
    }
    for segment, markers in means.items():
        if not spans_a_plane(np.array(list(markers.values()))):
            raise InputError(
                f"the {segment} markers {', '.join(markers)} lie on a line or are fewer than three, expected three or "
                "more that span a plane; name others under `markers` in the configuration"
            )
    check_heights(means["foot"], means["shank"])
    inner, outer = mean_position("medial ankle", medial), mean_position("lateral ankle", lateral)
    across = inner - outer if side == "right" else outer - inner
    centre, axis = (inner + outer) / 2, across / np.linalg.norm(across)
    return StaticCalibration(means["foot"], means["shank"], means["platform"], centre, axis)


def check_heights(foot: Vectors, shank: Vectors) -> None:
    """Refuse a foot whose markers (3,) [m] stand above the shank's: names or labels of the clusters are exchanged."""
    above = float(np.mean([p[2] for p in foot.values()]) - np.mean([p[2] for p in shank.values()]))
    if above > HIGHEST_FOOT:
        raise InputError(
            f"the foot markers {', '.join(foot)} stand {100 * above:.0f} cm above the shank markers "
            f"{', '.join(shank)}: exchange them under `markers` or in Nexus; or z does not point up, then state `axes` "
            "in the source file"
        )


def mean_position(name: str, track: Array) -> Array:
    """Mean (3,) [m] of a marker's track (n, 3) over the frames in which it was seen."""
    seen = np.isfinite(track).all(axis=1)
    if not seen.any():
        raise InputError(f"marker {name} is never seen in the static trial; label it, or record the trial again")
    return np.asarray(track[seen].mean(axis=0))


def ankle_angle(foot: Poses, shank: Poses, axis: Array) -> Array:
    """Joint angle theta (n,) [rad]: dorsiflexion positive, zero in the static pose.

    It is minus the twist, about the axis (3,), of the foot's rotation relative to the shank: a positive rotation about
    the axis, which points to the left, turns the toes down.
    """
    relative = np.einsum("nji,njk->nik", shank.rotation, foot.rotation)
    trace = np.trace(relative, axis1=1, axis2=2)
    # Quaternion of `relative`, up to a common factor: w ~ 1 + trace, vector part v ~ the axial vector.
    # Twist = 2 atan2(v.axis, w).
    return np.asarray(-2 * np.arctan2(axial_vector(relative) @ axis, 1 + trace))


def ankle_in_lab(foot: Poses, shank: Poses, calibration: StaticCalibration) -> tuple[Array, Array]:
    """Ankle centre (n, 3) [m] and axis (n, 3). Each is the mean of the foot's and the shank's."""
    centres = [body.point(calibration.ankle_centre) for body in (foot, shank)]
    across = (foot.rotation + shank.rotation) @ calibration.ankle_axis
    return (centres[0] + centres[1]) / 2, across / np.linalg.norm(across, axis=1, keepdims=True)


def ankle_torque(reaction: PlateWrench, plate_centre: Array, ankle: Array, axis: Array) -> Array:
    """Internal plantarflexion moment tau (n,) [N*m] from the ground reaction on the foot.

    tau = -(M + (c - a) x F) . axis, with the force F and the moment M about the plate's centre c (n, 3) or (3,) [m],
    ankle a (n, 3) [m], and axis (n, 3) pointing to the left, all in laboratory axes. The centre of pressure is not
    used: it is undefined when the plate is unloaded.
    """
    about_ankle = reaction.moment + np.cross(plate_centre - ankle, reaction.force)
    return np.asarray(-np.sum(about_ankle * axis, axis=1))


def foot_torque(foot: BodyMotion, ankle: Array, axis: Array, inertia: FootInertia) -> Array:
    """Torque (n,) [N*m] of the foot's weight and inertia, to be added to `ankle_torque`.

    `foot` is the motion of the foot with its centre of mass c as the point. The balance of moments about the ankle a
    gives axis . ((c - a) x m (acceleration - g)) + I alpha . axis.
    """
    load = inertia.mass * (foot.acceleration - GRAVITY)
    lever = np.cross(foot.point - ankle, load)
    return np.asarray(np.sum(axis * (lever + inertia.inertia * foot.alpha), axis=1))
