"""Marker clusters and the ankle: the pose that moved them is found, and signs and mechanics are a
clinician's."""

import numpy as np
import polars as pl
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation
from walking_synthetic import (
    FOOT,
    LEFT,
    RATE,
    SETTINGS,
    about_y,
    changed,
    hidden,
    pose,
    settings,
    static_trial,
)

from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.ankle import ankle_angle, moment_of_foot
from osl_analysis.walking.crossing_quality import EncoderComparison, compare_encoder
from osl_analysis.walking.poses import (
    body_motion,
    bridge_gaps,
    cluster_poses,
    filled_frames,
    static_calibration,
)

TIME = np.arange(240) / RATE
ANKLE = np.array([0.02, -0.1, 0.09])
low_pass = LowPass(20.0)
time = 0.5 + np.arange(240) / 300
own = np.arange(1000) / 500


def tracks() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Markers of a foot that turns about a fixed skew axis by 0.4 sin(7 t), its rotation, and its
    path."""
    axis = np.array([1.0, 2.0, -0.5]) / np.linalg.norm([1.0, 2.0, -0.5])
    R = Rotation.from_rotvec(0.4 * np.sin(7 * TIME)[:, None] * axis).as_matrix()
    path = np.stack([1.3 * TIME, 0.2 * np.cos(5 * TIME), 0.1 * np.sin(9 * TIME)], axis=1)
    return np.einsum("nij,mj->nmi", R, FOOT) + path[:, None], R, path


def test_recovers_the_pose_that_moved_the_markers_also_with_a_hidden_one_of_four() -> None:
    observed, R, path = tracks()
    observed[50:80, 2] = np.nan
    observed[70:90, 0, 1] = np.nan  # one coordinate is enough; frames 70-79 keep two markers only
    poses = cluster_poses(FOOT, observed)
    seen = np.r_[0:70, 80:240]
    np.testing.assert_allclose(poses.rotation[seen], R[seen], atol=1e-12)
    np.testing.assert_allclose(poses.point(np.zeros(3))[seen], path[seen], atol=1e-12)
    assert poses.residual[seen].max() < 1e-12
    assert np.isnan(poses.position[70:80]).all()


def test_a_mirrored_cluster_is_a_misfit_and_not_a_reflection_and_one_on_a_line_has_no_pose() -> (
    None
):
    poses = cluster_poses(FOOT, (FOOT * [1, -1, 1])[None])
    assert np.linalg.det(poses.rotation[0]) == pytest.approx(1)
    assert poses.residual[0] > 5e-3
    line = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.2, 0.001, 0]])
    assert not cluster_poses(line, np.tile(line, (3, 1, 1))).seen().any()


def test_short_interior_gaps_are_bridged_with_little_noise_and_flagged_the_others_stay() -> None:
    """25 frames at 300 Hz. A spline through the frames leaves a resting cluster by 10 standard
    deviations of noise."""
    resting = FOOT + np.random.default_rng(0).normal(0, 1e-4, (200, 100, *FOOT.shape))
    resting[:, 25:50] = np.nan
    off = [
        bridge_gaps(TIME[:100], cluster_poses(FOOT, one), 0.2).points(FOOT)[25:50] - FOOT
        for one in resting
    ]
    assert np.sqrt(np.mean(np.square(off))) < 2.5e-4
    observed, R, path = tracks()
    observed[:4] = np.nan
    observed[60:66] = np.nan
    observed[100:130] = np.nan
    observed[-3:] = np.nan
    seen = cluster_poses(FOOT, observed)
    bridged_poses = bridge_gaps(TIME, seen, longest=6 / RATE)
    assert list(np.flatnonzero(bridged_poses.bridged)) == list(range(60, 66))
    assert list(np.flatnonzero(~bridged_poses.seen())) == [
        0,
        1,
        2,
        3,
        *range(100, 130),
        237,
        238,
        239,
    ]
    # a cubic errs by 2.5e-6, a parabola by 6e-6, a straight line by 2e-3
    np.testing.assert_allclose(bridged_poses.rotation[60:66], R[60:66], atol=4e-6)
    np.testing.assert_allclose(
        bridged_poses.points(np.zeros((1, 3)))[60:66, 0], path[60:66], atol=4e-6
    )
    assert not bridge_gaps(TIME, seen, longest=5 / RATE).bridged.any()
    with pytest.raises(
        InputError, match=r"frame 7 is stamped 0\.020000 s, not later than the one before; record"
    ):
        bridge_gaps(np.where(np.arange(240) == 7, TIME[6], TIME), seen, 0.1)


def test_the_angle_is_the_twist_about_a_skew_axis_wherever_the_leg_is() -> None:
    axis = np.array([0.2, 0.95, 0.1]) / np.linalg.norm([0.2, 0.95, 0.1])
    theta = np.linspace(-2.5, 2.5, 11)
    across = 0.3 * np.cross(axis, [1.0, 0.0, 0.0])
    shank = Rotation.random(11, rng=np.random.default_rng(3))
    still = np.zeros((11, 3))
    for swing in (Rotation.identity(), Rotation.from_rotvec(across)):
        foot = shank * swing * Rotation.from_rotvec(-theta[:, None] * axis)
        angle = ankle_angle(pose(foot.as_matrix(), still), pose(shank.as_matrix(), still), axis)
        np.testing.assert_allclose(angle, theta, atol=1e-12)


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_calibrated_axis_points_to_the_left_for_either_leg(side) -> None:
    medial, lateral = ("ANKLE_MED", "ANKLE_LAT") if side == "right" else ("ANKLE_LAT", "ANKLE_MED")
    markers = SETTINGS["markers"] | {"ankle_medial": medial, "ankle_lateral": lateral}
    standing = hidden(static_trial(ANKLE), ["SHANK2"], 0.2, 0.9)
    static = static_calibration(standing, settings(side=side, markers=markers))
    np.testing.assert_allclose(static.ankle_axis, LEFT, atol=1e-12)
    np.testing.assert_allclose(static.ankle_centre, ANKLE, atol=1e-12)


def test_a_static_marker_that_is_never_seen_and_a_cluster_on_a_line_are_refused_by_name() -> None:
    with pytest.raises(InputError, match=r"trial static: marker SHANK2 is never seen"):
        static_calibration(hidden(static_trial(ANKLE), ["SHANK2"], 0, 2), settings())
    with pytest.raises(
        InputError, match="trial static: markers FOOT1, FOOT2, FOOT3, FOOT4 have no frames; record"
    ):
        static_calibration(
            changed(static_trial(), marker_FOOT1_x=pl.lit(None, pl.Float64)), settings()
        )
    flat = [pl.col(f"marker_FOOT{k}_{axis}") * 0 for k in range(1, 5) for axis in "yz"]
    with pytest.raises(InputError, match="foot markers FOOT1, FOOT2, FOOT3, FOOT4 lie on a line"):
        static_calibration(changed(static_trial(ANKLE), *flat), settings())
    foot, shank = (SETTINGS["markers"][segment] for segment in ("foot", "shank"))
    exchanged = SETTINGS["markers"] | {"foot": shank, "shank": foot}
    with pytest.raises(
        InputError, match=r"the foot markers SHANK1, .* stand 24 cm above the shank markers FOOT1"
    ):
        static_calibration(static_trial(), settings(markers=exchanged))


def test_a_hanging_foot_needs_its_weight_and_its_inertia() -> None:
    """A foot that swings freely about a still ankle: tau = I_ankle alpha + m g x_com, toes-down
    positive."""
    phi = 0.3 * np.sin(6 * TIME)
    alpha = -10.8 * np.sin(6 * TIME)
    com = np.array([0.05, 0.0, -0.04])
    motion = body_motion(TIME, pose(about_y(phi), np.zeros((len(TIME), 3))), com)
    torque = moment_of_foot(motion, 0 * motion.point, np.tile(LEFT, (len(TIME), 1)), 1.2, 0.007)
    x = np.cos(phi) * com[0] + np.sin(phi) * com[2]
    np.testing.assert_allclose(
        torque[6:-6], ((0.007 + 1.2 * (com @ com)) * alpha - 1.2 * 9.80665 * x)[6:-6], atol=1e-5
    )


def gait(time: Array) -> Array:
    return np.asarray(0.2 * np.sin(7 * time) + 0.05 * np.sin(19 * time))


def compared(
    theta: Array, stamps: Array, encoder: Array, torque: float = 0.0
) -> EncoderComparison | None:
    """The angle from markers with an encoder's, which a trial has at these stamps."""
    trial = Trial("w", pl.DataFrame({"time": np.r_[-1.0, stamps], "theta": [None, *encoder]}))
    return compare_encoder(trial, time, theta, torque * np.cos(3 * time), low_pass)


@pytest.mark.parametrize(
    ("delay", "first", "last"),
    [(-0.0042, 0, 2), (0.0137, 0, 2), (-0.045, 0.7, 1.2), (0.045, 0.7, 1.2)],
)
def test_offset_and_delay_of_the_encoder_come_out_whatever_its_rate(
    delay: float, first: float, last: float
) -> None:
    """Also of one that was switched on and off in stance, where a spline beyond its ends is
    anywhere."""
    some = own[(own >= first) & (own < last)]
    check = compared(
        low_pass(gait(np.arange(600) / 300), 300.0)[150:390], some, gait(some - delay) + 0.01
    )
    assert check.offset_deg == pytest.approx(np.rad2deg(0.01), abs=0.06 if first else 1e-3)
    assert check.delay_ms == pytest.approx(1e3 * delay, abs=1 if first else 0.02)
    assert check.rms_deg < (np.rad2deg(1e-3) if first else 1e-3)


def test_the_difference_that_follows_the_torque_is_the_compliance_of_the_shoe() -> None:
    """A foot that yields by 1 deg in 60 N*m: markers see more dorsiflexion than the encoder, here
    with a delay."""
    k = 60 / np.deg2rad(1)
    check = compared(
        gait(time), own, gait(own - 0.004) - 100 * np.cos(3 * (own - 0.004)) / k, 100.0
    )
    assert check.shoe_compliance == pytest.approx(1 / k, rel=0.02)


def test_what_offset_and_delay_leave_is_the_noise_and_an_encoder_of_another_joint_is_refused() -> (
    None
):
    """White noise of 1e-3 rad at 500 Hz, of which a 20 Hz low-pass leaves about 40/500 of the
    power."""
    check = compared(
        gait(time), own, gait(own) + 1e-3 * np.random.default_rng(4).standard_normal(1000)
    )
    assert np.deg2rad(check.rms_deg) == pytest.approx(1e-3 * np.sqrt(40 / 500), rel=0.3)
    with pytest.raises(InputError, match="does not follow the angle from markers within 50 ms"):
        compared(gait(time), own, gait(own - 0.2))
    for on in (slice(200), slice(0), slice(260, 270), slice(250, 320)):  # one that was off is none
        assert compared(gait(time), own[on], gait(own[on])) is None


FILLS = {
    "cubic": lambda beside, values, inside: CubicSpline(beside, values)(inside),
    "line": lambda beside, values, inside: np.interp(inside, beside, values),
    "polynomial": lambda beside, values, inside: np.polynomial.Polynomial.fit(beside, values, 5)(
        inside
    ),
}


@pytest.mark.parametrize("kind", FILLS)
@pytest.mark.parametrize(("rate", "length"), [(300, 10), (300, 40), (100, 20)])
def test_a_filled_run_of_frames_is_found_and_noise_and_rest_are_not_accused(
    kind, rate, length
) -> None:
    """A marker that swings and rests, as a foot does, with noise of 0.2 mm: of 20 runs nearly all
    are found; at 100 Hz third differences keep more of the swing."""
    random = np.random.default_rng(length)
    time = np.arange(3 * rate) / rate
    found = []
    path = 0.3 * np.outer(np.clip(np.sin(2 * np.pi * time), 0, None) ** 3, [1.0, 0.2, 0.5])
    for start in random.integers(30, len(time) - length - 30, 20):
        track = path + 2e-4 * random.standard_normal(path.shape)
        assert not filled_frames(track).any()
        inside = np.arange(start, start + length)
        beside = np.r_[start - 20 : start, start + length : start + length + 20]
        for axis in track.T:
            axis[inside] = FILLS[kind](beside, axis[beside], inside)
        told = np.flatnonzero(filled_frames(track))
        found.append(np.isin(told, inside).sum() >= length / 2)
        assert np.isin(told, np.arange(start - 5, start + length + 5)).all()
    assert np.mean(found) >= (0.95 if rate == 300 else 0.7)


def test_a_smoothed_rounded_or_short_track_does_not_tell_what_was_filled() -> None:
    random = np.random.default_rng(4)
    time = np.arange(900) / 300
    noisy = 0.1 * np.outer(np.sin(time), np.ones(3)) + 2e-4 * random.standard_normal((900, 3))
    for track in (
        LowPass(6.0)(noisy, 300.0),
        np.round(noisy, 3),
        noisy[:40],
        np.full((900, 3), np.nan),
    ):
        assert filled_frames(track) is None
