"""Angle and moment at the ankle: signs a clinician expects, mechanics that do not depend on the frame."""

from typing import Literal

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from walking_synthetic import CLUSTERS, FOOT, SHANK, about_y, pose, settings, static_trial

from osl_analysis.errors import InputError
from osl_analysis.walking.bodies import (
    FootInertia,
    ankle_angle,
    ankle_in_lab,
    body_motion,
    calibrate_static,
    cluster_poses,
    foot_torque,
    static_calibration,
)
from osl_analysis.walking.plate import PlateWrench, ankle_torque

LEFT = np.array([0.0, 1.0, 0.0])
ANKLE = np.array([0.02, -0.1, 0.09])
UPRIGHT = np.eye(3)[None]


def turned(angle: float) -> np.ndarray:
    return about_y(np.array([angle]))


@pytest.mark.parametrize(
    ("foot", "shank", "theta"),
    [
        pytest.param(-0.1, 0.0, 0.1, id="toes up against an upright shank"),
        pytest.param(0.1, 0.0, -0.1, id="toes down"),
        pytest.param(0.0, 0.2, 0.2, id="shank forward over a flat foot"),
        pytest.param(0.5, 0.5, 0.0, id="both together"),
    ],
)
def test_dorsiflexion_is_positive(foot: float, shank: float, theta: float) -> None:
    still = np.zeros((1, 3))
    angle = ankle_angle(pose(turned(foot), still), pose(turned(shank), still), LEFT)
    assert angle[0] == pytest.approx(theta, abs=1e-12)


def test_the_angle_is_the_twist_about_a_skew_axis_wherever_the_leg_is() -> None:
    axis = np.array([0.2, 0.95, 0.1]) / np.linalg.norm([0.2, 0.95, 0.1])
    theta = np.linspace(-2.5, 2.5, 11)
    shank = Rotation.random(11, rng=np.random.default_rng(3))
    foot = shank * Rotation.from_rotvec(-theta[:, None] * axis)
    still = np.zeros((11, 3))
    angle = ankle_angle(pose(foot.as_matrix(), still), pose(shank.as_matrix(), still), axis)
    np.testing.assert_allclose(angle, theta, atol=1e-12)


def test_what_a_soft_joint_adds_across_the_axis_does_not_leak_into_the_angle() -> None:
    """Inversion by 0.3 rad about the long axis of the foot, and the angle is still the twist about the ankle's."""
    swing, twist = Rotation.from_rotvec([0.3, 0.0, 0.1]), Rotation.from_rotvec([0.0, -0.25, 0.0])
    still = np.zeros((1, 3))
    foot = pose((swing * twist).as_matrix()[None], still)
    assert ankle_angle(foot, pose(UPRIGHT, still), LEFT)[0] == pytest.approx(0.25, abs=1e-12)


def test_a_load_in_front_of_the_ankle_needs_a_plantarflexion_moment() -> None:
    """800 N through a point 0.1 m ahead of the ankle: +80 N*m, wherever plate and origin are."""
    force, ahead = np.array([[0.0, 0.0, 800.0]]), ANKLE + np.array([0.1, 0.0, -0.09])
    for centre in (np.zeros(3), np.array([0.3, 0.25, 0.0])):
        moment = np.cross(ahead - centre, force)
        assert ankle_torque(PlateWrench(force, moment), centre, ANKLE[None], LEFT[None])[0] == pytest.approx(80.0)


def test_friction_that_brakes_the_sole_needs_a_dorsiflexion_moment() -> None:
    force, below = np.array([[-100.0, 0.0, 0.0]]), ANKLE - [0.0, 0.0, 0.09]
    moment = np.cross(below, force)
    # r = (0, 0, -h), F = (-100, 0, 0): (r x F)_y = 100 h turns the toes down, the joint must hold them up
    assert ankle_torque(PlateWrench(force, moment), np.zeros(3), ANKLE[None], LEFT[None])[0] == pytest.approx(-9.0)


def test_the_torque_of_an_unloaded_plate_is_its_couple_and_no_centre_of_pressure_appears() -> None:
    couple = np.array([[0.3, -0.7, 0.2]])
    assert ankle_torque(PlateWrench(0 * couple, couple), np.zeros(3), ANKLE[None], LEFT[None])[0] == pytest.approx(0.7)


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_calibrated_axis_points_to_the_left_for_either_leg(side: Literal["left", "right"]) -> None:
    inner = 0.04 if side == "right" else -0.04
    medial, lateral = (np.tile(ANKLE + np.array([0, y, 0]), (5, 1)) for y in (inner, -inner))
    clusters = {
        name: {f"{key}{k}": np.tile(p, (5, 1)) for k, p in enumerate(CLUSTERS[key])}
        for name, key in (("foot", "FOOT"), ("shank", "SHANK"), ("platform", "PLAT"))
    }
    static = calibrate_static(clusters, medial, lateral, side)
    np.testing.assert_allclose(static.ankle_axis, LEFT, atol=1e-12)
    np.testing.assert_allclose(static.ankle_centre, ANKLE, atol=1e-12)


def test_the_ankle_moves_with_foot_and_shank() -> None:
    calibration = static_calibration(static_trial(ANKLE), settings())
    shift, turn = np.array([1.0, 0.2, 0.05]), Rotation.from_rotvec([0.1, -0.3, 0.2])
    poses = [
        cluster_poses(points, (turn.apply(points) + shift)[None])
        for points in (np.array(list(calibration.foot.values())), np.array(list(calibration.shank.values())))
    ]
    centre, axis = ankle_in_lab(poses[0], poses[1], calibration)
    np.testing.assert_allclose(centre[0], turn.apply(ANKLE) + shift, atol=1e-12)
    np.testing.assert_allclose(axis[0], turn.apply(LEFT), atol=1e-12)


def test_a_static_marker_that_is_never_seen_is_named() -> None:
    trial = static_trial(ANKLE)
    nan = trial.samples["marker_SHANK2_y"] * np.nan
    blind = type(trial)("static", trial.samples.with_columns(nan), trial.provenance)
    with pytest.raises(InputError, match=r"trial static: marker SHANK2 is never seen"):
        static_calibration(blind, settings())


def test_a_static_cluster_on_a_line_is_refused() -> None:
    row = {f"M{k}": np.tile([0.1 * k, 0.0, 0.0], (5, 1)) for k in range(4)}
    good = {f"S{k}": np.tile(p, (5, 1)) for k, p in enumerate(SHANK)}
    with pytest.raises(InputError, match="foot markers M0, M1, M2, M3 lie on a line"):
        calibrate_static({"foot": row, "shank": good, "platform": good}, FOOT[:1], FOOT[1:2], "right")


def test_a_hanging_foot_needs_its_weight_and_its_inertia() -> None:
    """A foot that swings freely about a still ankle: tau = I_ankle alpha + m g x_com, toes-down positive."""
    time = np.arange(300) / 300
    phi, alpha = 0.3 * np.sin(6 * time), -10.8 * np.sin(6 * time)
    com, body = np.array([0.05, 0.0, -0.04]), FootInertia(1.2, np.array([0.05, 0.0, -0.04]), 0.007)
    R = about_y(phi)
    motion = body_motion(time, pose(R, np.zeros((300, 3))), com)
    n = np.ones((300, 1))
    torque = foot_torque(motion, 0 * motion.point, n * LEFT, body)
    about_ankle = 0.007 + 1.2 * (com @ com)
    x = np.cos(phi) * com[0] + np.sin(phi) * com[2]
    expected = about_ankle * alpha - 1.2 * 9.80665 * x
    np.testing.assert_allclose(torque[6:-6], expected[6:-6], atol=1e-5)
