"""How far a crossing can be trusted: the plate's zero and range, the leg's encoder, the hinge, outliers, the lag."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_walking_response import TIMING, crossing, mean_gait, respond
from walking_synthetic import CORNERS, FOOT, PLATE_RATE, SHANK

from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass
from osl_analysis.trial import Array
from osl_analysis.walking.ankle import StaticCalibration
from osl_analysis.walking.cluster import Poses, cluster_poses
from osl_analysis.walking.crossing import Crossing, CrossingQuality
from osl_analysis.walking.encoder import compare_encoder
from osl_analysis.walking.hinge import functional_hinge, with_hinge
from osl_analysis.walking.plate import PlateWrench, RecordedWrench, check_range, plate_axes, unloaded_zero
from osl_analysis.walking.response_fit import response_lag
from osl_analysis.walking.selection import crossing_features, outlier_reasons
from osl_analysis.walking.settings import OutlierRule

RULE = OutlierRule(limit=5, stance_s=0.01, placement_m=0.005, angle_deg=0.5)
TIME = np.arange(3 * PLATE_RATE) / PLATE_RATE
LEVEL = np.eye(3)


# The plate


def stepped(offset: float, limit: float = np.inf, noise: float = 0.4) -> PlateWrench:
    """A step of 0.7 s and 800 N from 1 s on; afterwards the tilted plate reads 5 N more, with
    half the noise. Fz is cut off at a limit."""
    load = 800 * np.sin(np.pi * np.clip((TIME - 1) / 0.7, 0, 1)) + 5.0 * (TIME > 1.75)
    calmer = np.where(TIME > 1.75, 0.5, 1.0)[:, None] * noise
    force = np.outer(load, [0.1, 0.0, 1.0]) + offset + calmer * np.random.default_rng(2).standard_normal((len(TIME), 3))
    force[:, 2] = np.minimum(force[:, 2], limit)
    return PlateWrench(force, 0.02 * offset + np.outer(load, [0.0, -0.1, 0.0]))


@pytest.mark.parametrize("offset", [0.0, 12.0, -60.0])
def test_the_zero_is_read_before_the_foot_comes_not_after_the_platform_tilted(offset: float) -> None:
    """0.2 s of noise of 0.4 N: the mean's standard deviation is 0.02 N."""
    zero = unloaded_zero(RecordedWrench(TIME, stepped(offset)), 0.2, 100)
    np.testing.assert_allclose(zero.force[0], offset, atol=0.1)
    np.testing.assert_allclose(zero.moment[0], 0.02 * offset, atol=1e-9)


def test_a_plate_that_is_far_off_zero_is_refused_with_its_reading() -> None:
    with pytest.raises(InputError, match="reads -713 N with nobody on it, expected less than 100 N"):
        unloaded_zero(RecordedWrench(TIME, stepped(-713.0)), 0.2, 100)


def test_a_record_that_starts_under_load_has_no_zero() -> None:
    late = RecordedWrench(TIME[2000:], stepped(0.0)[2000:])
    with pytest.raises(InputError, match=r"loaded within 0\.2 s of the record's start"):
        unloaded_zero(late, 0.2, 100)


def test_a_plate_at_its_limit_is_refused_and_one_that_peaks_is_not() -> None:
    axes = plate_axes(np.array(CORNERS))
    check_range(TIME, stepped(0.0).force, axes, 30)
    with pytest.raises(InputError, match=r"Fz stays at 600 N for \d+ ms .* reached its limit"):
        check_range(TIME, stepped(0.0, limit=600).force, axes, 30)
    check_range(TIME, stepped(0.0, noise=0.0).force[:1400], axes, 30)  # an unloaded plate may well read one value


def test_a_limit_shows_in_the_axes_of_a_plate_that_stands_askew() -> None:
    """Turned by 20 degrees: Fx of the plate is a mixture in the laboratory, and neither of its parts is flat."""
    turn = Rotation.from_euler("z", 20, degrees=True).as_matrix()
    own = stepped(0.0).force @ np.diag([4.0, 1.0, 1.0])
    own[:, 0] = np.minimum(own[:, 0], 250.0)
    axes = plate_axes(np.array(CORNERS) @ turn.T)
    np.testing.assert_allclose(np.abs(axes.T @ turn), np.abs(plate_axes(np.array(CORNERS))), atol=1e-12)
    check_range(TIME, own @ turn.T, LEVEL, 30)
    with pytest.raises(InputError, match="stays at 250 N"):
        check_range(TIME, own @ turn.T, axes, 30)


# The encoder


def gait(time: Array) -> Array:
    return np.asarray(0.2 * np.sin(7 * time) + 0.05 * np.sin(19 * time))


@pytest.mark.parametrize("delay", [-0.0042, 0.0, 0.0137])
def test_offset_and_delay_of_the_encoder_come_out_whatever_its_rate(delay: float) -> None:
    low_pass, time, own = LowPass(20.0), 0.5 + np.arange(240) / 300, np.arange(1000) / 500
    theta = low_pass(gait(np.arange(600) / 300), 300.0)[150:390]
    found = compare_encoder(time, theta, own, gait(own - delay) + 0.01, low_pass)
    assert found is not None
    assert found.delay == pytest.approx(delay, abs=2e-5)
    assert found.offset == pytest.approx(0.01, abs=1e-5)
    assert found.rms < 2e-5


def test_what_offset_and_delay_leave_is_the_noise() -> None:
    """White noise of 1e-3 rad at 500 Hz, of which a 20 Hz low-pass leaves about 40/500 of the power."""
    low_pass, time, own = LowPass(20.0), 0.5 + np.arange(240) / 300, np.arange(1000) / 500
    noise = 1e-3 * np.random.default_rng(4).standard_normal(1000)
    found = compare_encoder(time, gait(time), own, gait(own) + noise, low_pass)
    assert found is not None
    assert found.rms == pytest.approx(1e-3 * np.sqrt(40 / 500), rel=0.3)


def test_an_encoder_of_another_joint_is_refused_and_one_that_was_off_is_none() -> None:
    low_pass, time, own = LowPass(20.0), 0.5 + np.arange(240) / 300, np.arange(1000) / 500
    with pytest.raises(InputError, match="does not follow the angle from markers within 50 ms"):
        compare_encoder(time, gait(time), own, gait(own - 0.2), low_pass)
    assert compare_encoder(time, gait(time), own[:200], gait(own[:200]), low_pass) is None
    assert compare_encoder(time, gait(time), own[:0], own[:0], low_pass) is None


# The hinge

AXIS = np.array([0.06, 0.99, -0.05]) / np.linalg.norm([0.06, 0.99, -0.05])
CENTRE = np.array([0.012, -0.1, 0.095])
ANATOMICAL = StaticCalibration({}, {}, {}, np.array([0.02, -0.1, 0.09]), np.array([0.0, 1.0, 0.0]))


def hinged_motion(
    across: float = 0.0, noise: float = 0.0, size: float = 0.3, upward: float = 0.0
) -> tuple[Poses, Poses]:
    """A shank that wanders through the room, a foot hinged to it about AXIS through CENTRE, which yields about the
    axes forward and upward by the amplitudes `across` and `upward` [rad]."""
    t, random = np.arange(400) / 100, np.random.default_rng(5)
    shank = Rotation.from_rotvec(np.column_stack([0.1 * np.sin(t), 0.4 * np.sin(2 * t), 0.2 * t]))
    joint = Rotation.from_rotvec(np.outer(-size * np.sin(5 * t), AXIS)) * Rotation.from_rotvec(
        np.column_stack([across * np.sin(11 * t), 0 * t, upward * np.sin(8 * t)])
    )
    shift = np.column_stack([t, 0.02 * np.sin(t), 0.01 * np.cos(3 * t)])
    at_shank = shank.as_matrix() @ (SHANK - CENTRE).T
    at_foot = (shank * joint).as_matrix() @ (FOOT - CENTRE).T
    return tuple(  # type: ignore[return-value]
        cluster_poses(
            reference,
            np.moveaxis(moved, 2, 1) + (CENTRE + shift)[:, None] + noise * random.standard_normal((400, 4, 3)),
        )
        for reference, moved in ((FOOT, at_foot), (SHANK, at_shank))
    )


def test_the_functional_hinge_is_the_one_that_the_foot_turned_about() -> None:
    found = functional_hinge([hinged_motion()], ANATOMICAL)
    np.testing.assert_allclose(found.axis, AXIS, atol=1e-9)
    aside = np.cross(found.centre - CENTRE, AXIS)
    np.testing.assert_allclose(aside, 0, atol=1e-9)
    assert found.off_axis < 1e-9
    assert found.gap < 1e-9
    assert found.angle == pytest.approx(np.arccos(AXIS[1]), abs=1e-9)
    assert found.distance == pytest.approx(np.linalg.norm(np.cross(CENTRE - ANATOMICAL.ankle_centre, AXIS)), abs=1e-9)
    assert (found.centre - ANATOMICAL.ankle_centre) @ AXIS == pytest.approx(0, abs=1e-9)


def test_the_functional_hinge_stands_noise_gaps_and_a_joint_that_yields() -> None:
    foot, shank = hinged_motion(across=0.01, noise=2e-4)
    foot.position[30:60], foot.rotation[30:60] = np.nan, np.nan
    found = functional_hinge([(foot, shank)], ANATOMICAL)
    assert np.rad2deg(np.arccos(found.axis @ AXIS)) < 0.3
    assert np.linalg.norm(np.cross(found.centre - CENTRE, AXIS)) < 1e-3
    assert found.off_axis == pytest.approx(0.01 / np.sqrt(2), rel=0.2)
    assert found.frames == 370


def test_the_rotation_across_the_hinge_is_that_about_both_other_axes() -> None:
    """Amplitudes of 0.04 and 0.03 rad about two axes are 0.05 rad together, 0.05/sqrt(2) RMS."""
    hinge = functional_hinge([hinged_motion(across=0.04, upward=0.03)], ANATOMICAL)
    assert hinge.off_axis == pytest.approx(0.05 / np.sqrt(2), rel=0.05)


def test_a_joint_that_hardly_turned_has_no_functional_axis() -> None:
    with pytest.raises(InputError, match=r"the ankle turned by 0\.\d deg RMS, expected 5 deg"):
        functional_hinge([hinged_motion(size=0.01)], ANATOMICAL)


def test_the_functional_axis_takes_the_anatomical_ones_place_and_points_to_the_left_too() -> None:
    other = replace(ANATOMICAL, ankle_axis=-ANATOMICAL.ankle_axis)
    found = functional_hinge([hinged_motion()], other)
    assert with_hinge(other, found).ankle_axis @ other.ankle_axis > 0.9


# Crossings that are unlike the others


def session(**changed: object) -> list[Crossing]:
    """Eleven crossings that hardly differ, the last of which is changed."""
    random = np.random.default_rng(6)
    found = []
    for k in range(11):
        place = tuple(0.01 * random.standard_normal(2))
        one = crossing(f"w{k}", onset=0.6 if k % 2 else None, stance=0.72 + 0.01 * random.standard_normal())
        found.append(replace(one, quality=CrossingQuality({}, None, place, None)))  # type: ignore[arg-type]
    return [*found[:-1], replace(found[-1], **changed)]  # type: ignore[arg-type]


def reasons(crossings: list[Crossing]) -> dict[str, str]:
    return outlier_reasons(crossing_features(crossings, TIMING, RULE), [c.name for c in crossings], RULE.limit)


def test_crossings_that_scatter_as_gait_does_all_stay() -> None:
    assert reasons(session()) == {}


def test_a_foot_beside_its_place_a_long_stance_and_another_gait_are_named_with_the_reason() -> None:
    beside = reasons(session(quality=CrossingQuality({}, None, (0.0, 0.3), None)))
    assert list(beside) == ["w10"]
    assert "foot to the left 0.3 m lies" in beside["w10"]
    long = session()[-1]
    assert "stance 1 s lies" in reasons(session(stance=replace(long.stance, toe_off=1.3)))["w10"]
    stiff = reasons(session(theta=long.theta + 0.3 * np.sin(9 * long.time)))
    assert "gait before the onset" in stiff["w10"]


def test_a_crossing_is_not_judged_by_its_perturbation() -> None:
    """Another turn after the onset; and three perturbed of eleven, whose stance the perturbation prolongs by 0.2 s."""
    crossings = session()
    turned = [replace(c, theta=c.theta + 0.2 * (c.time > c.onset)) if c.onset else c for c in crossings]
    assert reasons(turned) == {}
    few = [replace(c, onset=0.6 if k % 4 == 1 else None) for k, c in enumerate(crossings)]
    longer = [replace(c, stance=replace(c.stance, toe_off=c.stance.toe_off + 0.2)) if c.onset else c for c in few]
    assert crossing_features(longer, TIMING, RULE)[0].distance.max() < 5


# The lag of the torque


def test_the_lag_of_a_second_order_response_comes_out_within_its_standard_error() -> None:
    response = respond(crossing("p", 0.6, impedance=(340.0, 5.0, 0.2)), mean_gait())
    for lag in (-0.003, 0.0, 0.004):
        moved = np.interp(response.time - lag, response.time, response.torque)
        found = response_lag(replace(response, torque=moved))
        assert found is not None
        assert found.lag == pytest.approx(lag, abs=5e-4)
