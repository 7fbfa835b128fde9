"""Marker clusters and the ankle: the pose that moved them is found, and signs and mechanics are a clinician's."""

import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation
from walking_synthetic import FOOT, RATE, SETTINGS, about_y, changed, hidden, pose, settings, static_trial

from osl_analysis.errors import InputError
from osl_analysis.walking.bodies import (
    ankle_angle,
    body_motion,
    bridge_gaps,
    cluster_poses,
    moment_of_foot,
    static_calibration,
)
from osl_analysis.walking.plate import ankle_torque

TIME = np.arange(240) / RATE


def tracks() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Markers of a foot that turns about a fixed skew axis by 0.4 sin(7 t), its rotation, and its path."""
    axis = np.array([1.0, 2.0, -0.5]) / np.linalg.norm([1.0, 2.0, -0.5])
    R = Rotation.from_rotvec(0.4 * np.sin(7 * TIME)[:, None] * axis).as_matrix()
    path = np.stack([1.3 * TIME, 0.2 * np.cos(5 * TIME), 0.1 * np.sin(9 * TIME)], axis=1)
    return np.einsum("nij,mj->nmi", R, FOOT) + path[:, None], R, path


def test_recovers_the_pose_that_moved_the_markers() -> None:
    observed, R, path = tracks()
    poses = cluster_poses(FOOT, observed)
    np.testing.assert_allclose(poses.rotation, R, atol=1e-12)
    np.testing.assert_allclose(poses.points(np.zeros((1, 3)))[:, 0], path, atol=1e-12)
    assert poses.residual.max() < 1e-12


def test_a_hidden_marker_of_four_changes_nothing() -> None:
    observed, R, _ = tracks()
    observed[50:80, 2] = np.nan
    observed[70:90, 0, 1] = np.nan  # one coordinate is enough; frames 70-79 keep two markers only
    poses = cluster_poses(FOOT, observed)
    lost = np.zeros(len(TIME), dtype=bool)
    lost[70:80] = True
    np.testing.assert_allclose(poses.rotation[~lost], R[~lost], atol=1e-12)
    assert np.isnan(poses.position[lost]).all()


def test_a_mirrored_cluster_is_a_misfit_and_not_a_reflection_and_one_on_a_line_has_no_pose() -> None:
    poses = cluster_poses(FOOT, (FOOT * [1, -1, 1])[None])
    assert np.linalg.det(poses.rotation[0]) == pytest.approx(1)
    assert poses.residual[0] > 5e-3
    line = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.2, 0.001, 0]])
    assert not cluster_poses(line, np.tile(line, (3, 1, 1))).seen().any()


def test_a_bridge_over_noisy_frames_follows_a_cubic_and_carries_little_noise_into_the_gap() -> None:
    """25 frames at 300 Hz. A spline through the frames leaves a resting cluster by 10 standard deviations of noise."""
    time = np.arange(100) / 300
    x = (time - 0.15) / 0.15
    path = np.column_stack([0.3 * x**3 - 0.2 * x, 0.1 * x**2, 0.05 * x])
    exact = FOOT + path[:, None]
    quiet = np.where((np.arange(100) // 25 == 1)[:, None, None], np.nan, exact)
    found = bridge_gaps(time, cluster_poses(FOOT, quiet), 0.2)
    np.testing.assert_allclose(found.points(FOOT), exact, atol=1e-9)
    resting = FOOT + np.random.default_rng(0).normal(0, 1e-4, (200, 100, *FOOT.shape))
    resting[:, 25:50] = np.nan
    off = [bridge_gaps(time, cluster_poses(FOOT, one), 0.2).points(FOOT)[25:50] - FOOT for one in resting]
    assert np.sqrt(np.mean(np.square(off))) < 2.5e-4


def test_short_interior_gaps_are_bridged_and_flagged_the_others_stay() -> None:
    observed, R, path = tracks()
    observed[:4], observed[60:66], observed[100:130], observed[-3:] = np.nan, np.nan, np.nan, np.nan
    seen = cluster_poses(FOOT, observed)
    bridged_poses = bridge_gaps(TIME, seen, longest=6 / RATE)
    assert list(np.flatnonzero(bridged_poses.bridged)) == list(range(60, 66))
    assert list(np.flatnonzero(~bridged_poses.seen())) == [0, 1, 2, 3, *range(100, 130), 237, 238, 239]
    # slerp over 7 frames errs by (7/300)^2/8 * 0.4 * 7^2 = 1.3 mrad where the turn accelerates most
    np.testing.assert_allclose(bridged_poses.rotation[60:66], R[60:66], atol=1.3e-3)
    np.testing.assert_allclose(bridged_poses.points(np.zeros((1, 3)))[60:66, 0], path[60:66], atol=2e-4)
    assert not bridge_gaps(TIME, seen, longest=5 / RATE).bridged.any()


LEFT = np.array([0.0, 1.0, 0.0])
ANKLE = np.array([0.02, -0.1, 0.09])


def test_dorsiflexion_is_positive() -> None:
    """Toes up against an upright shank; the shank forward over a flat foot; both together."""
    for foot, shank, theta in ((-0.1, 0.0, 0.1), (0.0, 0.2, 0.2), (0.5, 0.5, 0.0)):
        angle = ankle_angle(*(pose(about_y(np.array([a])), np.zeros((1, 3))) for a in (foot, shank)), LEFT)
        assert angle[0] == pytest.approx(theta, abs=1e-12)


def test_the_angle_is_the_twist_about_a_skew_axis_wherever_the_leg_is_and_whatever_a_soft_joint_adds_across() -> None:
    axis = np.array([0.2, 0.95, 0.1]) / np.linalg.norm([0.2, 0.95, 0.1])
    theta, across = np.linspace(-2.5, 2.5, 11), 0.3 * np.cross(axis, [1.0, 0.0, 0.0])
    shank, still = Rotation.random(11, rng=np.random.default_rng(3)), np.zeros((11, 3))
    for swing in (Rotation.identity(), Rotation.from_rotvec(across)):
        foot = shank * swing * Rotation.from_rotvec(-theta[:, None] * axis)
        angle = ankle_angle(pose(foot.as_matrix(), still), pose(shank.as_matrix(), still), axis)
        np.testing.assert_allclose(angle, theta, atol=1e-12)


@pytest.mark.parametrize(
    ("force", "point", "couple", "torque"),
    [
        pytest.param([0, 0, 800], [0.1, 0, -0.09], [0, 0, 0], 80.0, id="a load ahead turns the toes up"),
        pytest.param([-100, 0, 0], [0, 0, -0.09], [0, 0, 0], -9.0, id="friction that brakes the sole"),
        pytest.param([0, 0, 0], [0, 0, 0], [0.3, -0.7, 0.2], 0.7, id="an unloaded plate, without centre of pressure"),
    ],
)
def test_the_ankles_moment_holds_the_load_wherever_plate_and_origin_are(force, point, couple, torque) -> None:
    for centre in np.array([[0.0, 0.0, 0.0], [0.3, 0.25, 0.0]]):
        wrench = np.hstack([force, np.cross(ANKLE + point - centre, force) + couple])[None]
        assert ankle_torque(wrench, centre, ANKLE[None], LEFT[None])[0] == pytest.approx(torque)


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_calibrated_axis_points_to_the_left_for_either_leg(side) -> None:
    labels = ["ANKLE_MED", "ANKLE_LAT"] if side == "right" else ["ANKLE_LAT", "ANKLE_MED"]
    markers = SETTINGS["markers"] | dict(zip(("ankle_medial", "ankle_lateral"), labels, strict=True))
    static = static_calibration(static_trial(ANKLE), settings(side=side, markers=markers))
    np.testing.assert_allclose(static.ankle_axis, LEFT, atol=1e-12)
    np.testing.assert_allclose(static.ankle_centre, ANKLE, atol=1e-12)


def test_a_static_marker_that_is_never_seen_and_a_cluster_on_a_line_are_refused_by_name() -> None:
    with pytest.raises(InputError, match=r"trial static: marker SHANK2 is never seen"):
        static_calibration(hidden(static_trial(ANKLE), ["SHANK2"], 0, 2), settings())
    flat = [pl.col(f"marker_FOOT{k}_{axis}") * 0 for k in range(1, 5) for axis in "yz"]
    with pytest.raises(InputError, match="foot markers FOOT1, FOOT2, FOOT3, FOOT4 lie on a line"):
        static_calibration(changed(static_trial(ANKLE), *flat), settings())


def test_a_hanging_foot_needs_its_weight_and_its_inertia() -> None:
    """A foot that swings freely about a still ankle: tau = I_ankle alpha + m g x_com, toes-down positive."""
    time = np.arange(300) / 300
    phi, alpha = 0.3 * np.sin(6 * time), -10.8 * np.sin(6 * time)
    com = np.array([0.05, 0.0, -0.04])
    R = about_y(phi)
    motion = body_motion(time, pose(R, np.zeros((300, 3))), com)
    n = np.ones((300, 1))
    torque = moment_of_foot(motion, 0 * motion.point, n * LEFT, 1.2, 0.007)
    about_ankle = 0.007 + 1.2 * (com @ com)
    x = np.cos(phi) * com[0] + np.sin(phi) * com[2]
    expected = about_ankle * alpha - 1.2 * 9.80665 * x
    np.testing.assert_allclose(torque[6:-6], expected[6:-6], atol=1e-5)
