"""How far a crossing can be trusted: the leg's encoder, the ankle's hinge, and which crossings are outliers."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation
from walking_crossings import crossing
from walking_synthetic import FOOT, SHANK, settings

from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.bodies import Poses, StaticCalibration, cluster_poses, functional_hinge
from osl_analysis.walking.crossing import Crossing, CrossingQuality, EncoderCheck, encoder_check
from osl_analysis.walking.groups import crossing_features, selection_rows
from osl_analysis.walking.plate import Load

RULE = settings().outliers


def gait(time: Array) -> Array:
    return np.asarray(0.2 * np.sin(7 * time) + 0.05 * np.sin(19 * time))


low_pass, time, own = LowPass(20.0), 0.5 + np.arange(240) / 300, np.arange(1000) / 500


def compared(theta: Array, stamps: Array, encoder: Array) -> EncoderCheck | None:
    """The angle from markers with an encoder's, which a trial has at these stamps."""
    trial = Trial("w", pl.DataFrame({"time": np.r_[-1.0, stamps], "theta": [None, *encoder]}))
    return encoder_check(trial, time, theta, low_pass)


@pytest.mark.parametrize("delay", [-0.0042, 0.0, 0.0137])
def test_offset_and_delay_of_the_encoder_come_out_whatever_its_rate(delay: float) -> None:
    theta = low_pass(gait(np.arange(600) / 300), 300.0)[150:390]
    check = compared(theta, own, gait(own - delay) + 0.01)
    assert check is not None
    assert check.delay == pytest.approx(delay, abs=2e-5)
    assert check.offset == pytest.approx(0.01, abs=1e-5)
    assert check.rms < 2e-5


def test_what_offset_and_delay_leave_is_the_noise_and_an_encoder_of_another_joint_is_refused() -> None:
    """White noise of 1e-3 rad at 500 Hz, of which a 20 Hz low-pass leaves about 40/500 of the power."""
    noise = 1e-3 * np.random.default_rng(4).standard_normal(1000)
    check = compared(gait(time), own, gait(own) + noise)
    assert check is not None
    assert check.rms == pytest.approx(1e-3 * np.sqrt(40 / 500), rel=0.3)
    with pytest.raises(InputError, match="does not follow the angle from markers within 50 ms"):
        compared(gait(time), own, gait(own - 0.2))
    for count in (200, 0):  # one that was off is none
        assert compared(gait(time), own[:count], gait(own[:count])) is None


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


@pytest.mark.parametrize("points", [1, -1])
def test_the_functional_hinge_is_the_one_that_the_foot_turned_about(points: int) -> None:
    """It points as the anatomical axis does."""
    hinge = functional_hinge([hinged_motion()], replace(ANATOMICAL, ankle_axis=points * ANATOMICAL.ankle_axis))
    np.testing.assert_allclose(hinge.axis, points * AXIS, atol=1e-9)
    np.testing.assert_allclose(np.cross(hinge.centre - CENTRE, AXIS), 0, atol=1e-9)
    assert (hinge.off_axis, hinge.gap) == pytest.approx((0, 0), abs=1e-9)
    assert hinge.angle == pytest.approx(np.arccos(AXIS[1]), abs=1e-9)
    assert hinge.distance == pytest.approx(np.linalg.norm(np.cross(CENTRE - ANATOMICAL.ankle_centre, AXIS)), abs=1e-9)
    assert (hinge.centre - ANATOMICAL.ankle_centre) @ AXIS == pytest.approx(0, abs=1e-9)


def test_the_functional_hinge_stands_noise_gaps_and_a_joint_that_yields() -> None:
    foot, shank = hinged_motion(across=0.01, noise=2e-4)
    foot.position[30:60], foot.rotation[30:60] = np.nan, np.nan
    hinge = functional_hinge([(foot, shank)], ANATOMICAL)
    assert np.rad2deg(np.arccos(hinge.axis @ AXIS)) < 0.3
    assert np.linalg.norm(np.cross(hinge.centre - CENTRE, AXIS)) < 1e-3
    assert hinge.off_axis == pytest.approx(0.01 / np.sqrt(2), rel=0.2)
    assert hinge.frames == 370
    both = functional_hinge([hinged_motion(across=0.04, upward=0.03)], ANATOMICAL)
    assert both.off_axis == pytest.approx(0.05 / np.sqrt(2), rel=0.05)  # of 0.04 and 0.03 rad about two axes
    with pytest.raises(InputError, match=r"the ankle turned by 0\.\d deg RMS, expected 5 deg"):
        functional_hinge([hinged_motion(size=0.01)], ANATOMICAL)


def session(**changed: object) -> list[Crossing]:
    """Eleven crossings that hardly differ, the last of which is changed."""
    random = np.random.default_rng(6)
    crossings = []
    for k in range(11):
        place = tuple(0.01 * random.standard_normal(2))
        one = crossing(f"w{k}", onset=0.6 if k % 2 else None, stance=0.72 + 0.01 * random.standard_normal())
        crossings.append(replace(one, quality=CrossingQuality({}, None, place, None)))  # type: ignore[arg-type]
    return [*crossings[:-1], replace(crossings[-1], **changed)]  # type: ignore[arg-type]


def reasons(crossings: list[Crossing]) -> dict[str, str]:
    rows = selection_rows(crossings, [], settings())
    return {name: str(row["reason"]) for name, row in rows.items() if row["reason"] is not None}


def test_a_foot_beside_its_place_a_long_stance_and_another_gait_are_named_with_the_reason() -> None:
    assert reasons(session()) == {}
    beside = reasons(session(quality=CrossingQuality({}, None, (0.0, 0.3), None)))
    assert list(beside) == ["w10"]
    assert "foot to the left 0.3 m lies" in beside["w10"]
    assert "hidden" not in beside["w10"]
    gone = reasons(session(quality=CrossingQuality({}, None, (0.0, 0.3), None), bridged=0.16))
    assert "markers were hidden for 16% of it: fill the gaps in Nexus" in gone["w10"]
    long = session()[-1]
    assert "stance 1 s lies" in reasons(session(stance=replace(long.stance, toe_off=1.3)))["w10"]
    stiff = reasons(session(theta=long.theta + 0.3 * np.sin(9 * long.time)))
    assert "angle before the onset" in stiff["w10"]


def test_the_load_and_a_second_foot_on_the_plate_are_named_and_what_is_not_known_is_not_compared() -> None:
    """And four of twelve with less load do not hide in the scatter that they make."""

    def loads(of: dict[str, float], **last: float) -> list[Crossing]:
        some = [loaded(c, share=of.get(c.name, 1.0), seed=k) for k, c in enumerate(session())]
        return [*some[:-1], loaded(session()[-1], seed=10, **last)]

    assert reasons(loads({})) == reasons([*loads({})[:-1], session()[-1]]) == {}
    assert "load" in reasons(loads({}, share=0.7))["w10"]
    assert "pressure beside the ankle" in reasons(loads({}, left=0.06))["w10"]
    bad = {"w0": 0.7, "w2": 0.72, "w4": 0.78, "w8": 0.6}
    assert set(reasons(loads(bad))) == set(bad)


def test_a_crossing_is_not_judged_by_its_perturbation() -> None:
    """Another turn after the onset; and three perturbed of eleven, whose stance the perturbation prolongs by 0.2 s."""
    crossings = session()
    turned = [replace(c, theta=c.theta + 0.2 * (c.time > c.onset)) if c.onset else c for c in crossings]
    assert reasons(turned) == {}
    few = [replace(c, onset=0.6 if k % 4 == 1 else None) for k, c in enumerate(crossings)]
    longer = [replace(c, stance=replace(c.stance, toe_off=c.stance.toe_off + 0.2)) if c.onset else c for c in few]
    (stance,) = (f for f in crossing_features(longer, settings(), RULE) if f.name == "stance")
    assert stance.distance.max() < 5


def loaded(
    crossing: Crossing, share: float = 1.0, left: float = 0.01, mass: float | None = None, seed: int = 0
) -> Crossing:
    """The crossing of 70 kg with a share of its load, and its centre of pressure [m] to the left of the ankle."""
    phase = (crossing.time - crossing.stance.heel_strike) / crossing.stance.duration
    noise = np.random.default_rng(seed).standard_normal(2)
    force = share * (1 + 0.02 * noise[0]) * 9.81 * 70 * np.clip(np.sin(np.pi * np.clip(phase, 0, 1)) * 1.15, 0, 0.95)
    load = Load(force, np.full_like(force, left + 0.002 * noise[1]))
    return replace(crossing, load=load, torque=share * crossing.torque, body_mass=mass)


def test_a_load_far_from_the_weight_where_the_mass_is_known_and_a_foot_beside_the_plate_are_excluded() -> None:
    one = session()[0]
    cases = {
        None: [loaded(one, mass=70), loaded(one, share=0.6), replace(one, quality=replace(one.quality, outside=0.02))],
        "the plate carries 0.54 of the weight of 70 kg": [loaded(one, share=0.6, mass=70)],
        "the plate carries 1.8": [loaded(one, mass=35)],
        "a foot marker lies 5.0 cm outside the plate": [replace(one, quality=replace(one.quality, outside=0.05))],
    }
    for expected, some in cases.items():
        for c in some:
            row = selection_rows([c], [], settings(outliers=None))[c.name]
            assert row["status"] == ("used" if expected is None else "outlier")
            assert (row["reason"] is None) if expected is None else (expected in str(row["reason"]))
