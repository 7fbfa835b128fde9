# SPDX-License-Identifier: Apache-2.0
"""Marker clusters and the ankle: the pose that moved them comes out, signs are a clinician's."""

from dataclasses import dataclass, replace

import numpy as np
import polars as pl
import pytest
from conftest import refused_with, white_noise
from scipy.spatial.transform import Rotation
from walking_synthetic import (
    FOOT,
    LEFT,
    OF_WALKING,
    RATE,
    about_y,
    changed,
    hidden,
    pose,
    settings,
    static_trial,
)

from osl_analysis.base.trial import Array, Trial
from osl_analysis.walking.geometry import ankle_angle, moment_of_foot
from osl_analysis.walking.poses import (
    body_motion,
    bridge_gaps,
    cluster_poses,
    moved_marker,
    static_calibration,
    without_held,
)

TIME = np.arange(240) / RATE
ANKLE = np.array([0.02, -0.1, 0.09])
GRAVITY = 9.80665  # [m/s^2]


@dataclass(frozen=True)
class MovingFoot:
    """A foot that turns about a fixed skew axis by 0.4 sin(7 t)."""

    tracks: Array  # of its markers (n, 4, 3) [m]
    rotation: Array  # (n, 3, 3)
    path: Array  # of its origin (n, 3) [m]


def moving_foot() -> MovingFoot:
    axis = np.array([1.0, 2.0, -0.5]) / np.linalg.norm([1.0, 2.0, -0.5])
    rotation = Rotation.from_rotvec(0.4 * np.sin(7 * TIME)[:, None] * axis).as_matrix()
    path = np.stack([1.3 * TIME, 0.2 * np.cos(5 * TIME), 0.1 * np.sin(9 * TIME)], axis=1)
    tracks = np.einsum("nij,mj->nmi", rotation, FOOT) + path[:, None]
    return MovingFoot(tracks, rotation, path)


def test_the_pose_that_moved_the_markers_comes_out_with_one_of_four_hidden() -> None:
    foot = moving_foot()
    tracks = foot.tracks.copy()
    tracks[50:80, 2] = np.nan
    tracks[70:90, 0, 1] = np.nan  # one coordinate is enough; frames 70-79 keep two markers only

    poses = cluster_poses(FOOT, tracks)

    seen = np.r_[0:70, 80:240]
    np.testing.assert_allclose(poses.rotation[seen], foot.rotation[seen], atol=1e-12)
    np.testing.assert_allclose(poses.point(np.zeros(3))[seen], foot.path[seen], atol=1e-12)
    assert poses.residual[seen].max() < 1e-12
    assert np.isnan(poses.position[70:80]).all()


def test_a_marker_that_repeats_its_place_is_occluded_one_at_rest_is_not() -> None:
    tracks = moving_foot().tracks.copy()
    tracks[150:] = tracks[149]
    held = tracks.copy()
    held[60:72, 2] = held[60, 2]

    hidden = np.isnan(without_held(held)).any(axis=2)

    assert np.flatnonzero(hidden[:, 2]).tolist() == list(range(61, 72))
    assert not np.delete(hidden, 2, axis=1).any()


def test_a_mirrored_cluster_is_lack_of_fit_and_no_reflection() -> None:
    poses = cluster_poses(FOOT, (FOOT * [1, -1, 1])[None])

    assert np.linalg.det(poses.rotation[0]) == pytest.approx(1)
    assert poses.residual[0] > 5e-3


def test_a_cluster_on_a_line_has_no_pose() -> None:
    line = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.2, 0.001, 0]])

    assert not cluster_poses(line, np.tile(line, (3, 1, 1))).seen().any()


@pytest.mark.parametrize(("hidden", "distance"), [(None, 0.02), (3, 0.013)])
def test_a_moved_marker_is_that_without_which_the_others_agree(
    hidden: int | None, distance: float
) -> None:
    """Of three that are left, the lack of fit is shared: the largest part is told."""
    foot = moving_foot()
    moved = foot.tracks + 0.02 * foot.rotation[:, :, 0][:, None] * (np.arange(4) == 0)[:, None]
    if hidden is not None:
        moved[:, hidden] = np.nan

    index, distance_m = moved_marker(FOOT, moved, cluster_poses(FOOT, moved))

    assert index == 0
    assert distance_m == pytest.approx(distance, abs=2e-3)


def test_only_short_gaps_between_frames_are_bridged() -> None:
    foot = moving_foot()
    tracks = foot.tracks.copy()
    for gap in (slice(4), slice(60, 66), slice(100, 130), slice(-3, None)):
        tracks[gap] = np.nan
    poses = cluster_poses(FOOT, tracks)

    bridged = bridge_gaps(TIME, FOOT, poses, longest=6 / RATE)

    assert list(np.flatnonzero(bridged.bridged)) == list(range(60, 66))
    hidden = [0, 1, 2, 3, *range(100, 130), 237, 238, 239]
    assert list(np.flatnonzero(~bridged.seen())) == hidden
    # a cubic errs by 2.5e-6, a parabola by 6e-6, a straight line by 2e-3
    origin = bridged.point(np.zeros(3))
    np.testing.assert_allclose(bridged.rotation[60:66], foot.rotation[60:66], atol=4e-6)
    np.testing.assert_allclose(origin[60:66], foot.path[60:66], atol=4e-6)
    assert not bridge_gaps(TIME, FOOT, poses, longest=5 / RATE).bridged.any()


def test_the_angle_is_the_twist_about_a_skew_axis_wherever_the_leg_is() -> None:
    axis = np.array([0.2, 0.95, 0.1]) / np.linalg.norm([0.2, 0.95, 0.1])
    theta = np.linspace(-2.5, 2.5, 11)
    shank = Rotation.random(11, rng=np.random.default_rng(3))
    across = Rotation.from_rotvec(0.3 * np.cross(axis, [1.0, 0.0, 0.0]))
    at_origin = np.zeros((11, 3))

    for swing in (Rotation.identity(), across):
        foot = shank * swing * Rotation.from_rotvec(-theta[:, None] * axis)
        angle = ankle_angle(
            pose(foot.as_matrix(), at_origin), pose(shank.as_matrix(), at_origin), axis
        )
        np.testing.assert_allclose(angle, theta, atol=1e-12)


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_calibrated_axis_points_to_the_left_for_either_leg(side: str) -> None:
    medial = "ANKLE_MED"
    lateral = "ANKLE_LAT"
    if side == "left":
        medial, lateral = lateral, medial
    markers = OF_WALKING["markers"] | {"ankle_medial": medial, "ankle_lateral": lateral}
    standing = hidden(static_trial(ANKLE), ["SHANK2"], 0.2, 0.9)

    static = static_calibration(standing, settings(side=side, markers=markers))

    np.testing.assert_allclose(static.ankle_axis, LEFT, atol=1e-12)
    np.testing.assert_allclose(static.ankle_centre, ANKLE, atol=1e-12)


FLAT = [pl.col(f"marker_FOOT{k}_{axis}") * 0 for k in range(1, 5) for axis in "yz"]


@pytest.mark.parametrize(
    ("trial", "told"),
    [
        (hidden(static_trial(ANKLE), ["SHANK2"], 0, 2), "^marker SHANK2"),
        (changed(static_trial(ANKLE), *FLAT), "foot markers FOOT1, FOOT2, FOOT3, FOOT4"),
        (
            replace(static_trial(), samples=static_trial().samples.drop("marker_FOOT3_x")),
            "'FOOT3'.*'FOOT[124]'",
        ),
    ],
)
def test_a_hidden_static_marker_and_a_cluster_on_a_line_are_refused(
    trial: Trial, told: str
) -> None:
    with refused_with(told):
        static_calibration(trial, settings())


def test_exchanged_foot_and_shank_are_refused() -> None:
    markers = OF_WALKING["markers"]
    exchanged = markers | {"foot": markers["shank"], "shank": markers["foot"]}

    with refused_with(r"foot markers SHANK1,.*24 cm.*shank markers FOOT1"):
        static_calibration(static_trial(), settings(markers=exchanged))


def test_a_hanging_foot_needs_its_weight_and_its_inertia() -> None:
    """A foot that swings freely about a still ankle: tau = I_ankle alpha + m g x_com, toes-down
    positive."""
    mass = 1.2
    inertia = 0.007
    com = np.array([0.05, 0.0, -0.04])
    phi = 0.3 * np.sin(6 * TIME)
    alpha = -10.8 * np.sin(6 * TIME)
    motion = body_motion(TIME, pose(about_y(phi), np.zeros((len(TIME), 3))), com)

    torque = moment_of_foot(motion, 0 * motion.point, np.tile(LEFT, (len(TIME), 1)), mass, inertia)

    x_com = np.cos(phi) * com[0] + np.sin(phi) * com[2]
    expected = (inertia + mass * (com @ com)) * alpha - mass * GRAVITY * x_com
    inside = slice(6, -6)  # a spline is less exact at its ends
    np.testing.assert_allclose(torque[inside], expected[inside], atol=1e-5)


def test_a_bridged_gap_of_a_resting_cluster_has_little_noise() -> None:
    """25 frames at 300 Hz, where a spline leaves by 10 standard deviations of noise."""
    noise = 1e-4 * white_noise((200, 100, *FOOT.shape), 0)
    noise[:, 25:50] = np.nan

    deviations = []
    for deviation in noise:
        bridged = bridge_gaps(TIME[:100], FOOT, cluster_poses(FOOT, FOOT + deviation), 0.2)
        deviations.append(bridged.points(FOOT)[25:50] - FOOT)

    assert np.sqrt(np.mean(np.square(deviations))) < 2.5e-4
