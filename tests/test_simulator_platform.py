"""The platform's motion: heave, axis, shift, shiver, ramps and trigger, measured from the written markers."""

from pathlib import Path

import numpy as np
import pytest
from decoded_capture import DecodedCrossing, decoded_crossing
from walking_setup import PERTURBED, UNPERTURBED, Setup, load_setup

from osl_analysis.simulator.platform import unloaded_platform
from osl_analysis.simulator.settings import Effect
from osl_analysis.simulator.walking import motion_grid
from osl_analysis.trial import Array


@pytest.fixture(scope="module")
def setup() -> Setup:
    return load_setup().ideal()


def changed(setup: Setup, **ramp: object) -> Setup:
    perturbation = setup.walking.perturbation.model_copy(update=ramp)
    return Setup(setup.settings, setup.walking.model_copy(update={"perturbation": perturbation}), setup.p)


def imperfect(setup: Setup, name: str, size: float) -> Setup:
    unit = getattr(setup.walking.effects, name).unit
    effects = setup.walking.effects.model_copy(update={name: Effect(enabled=True, size=size, unit=unit)})
    return Setup(setup.settings, setup.walking.model_copy(update={"effects": effects}), setup.p)


def decoded(setup: Setup, folder: Path, perturbed: bool = True) -> DecodedCrossing:
    setup.record(folder, PERTURBED if perturbed else UNPERTURBED)
    return decoded_crossing(folder / "vicon/walking_01.c3d")


def test_a_platform_turns_about_the_axis_in_its_depth(setup: Setup, tmp_path: Path) -> None:
    """The point 0.12 m below the surface and below the nominal ankle (x = 0.24 m) stays; one at the ankle does not."""
    platform = decoded(changed(setup, axis_depth_m=0.12), tmp_path).platform
    axis, ankle = (platform.point(np.array([0.24, 0.25, z])) for z in (-0.12, 0.08))
    np.testing.assert_allclose(axis, np.tile(axis[0], (len(axis), 1)), atol=1e-5)
    assert np.ptp(ankle[:, 0]) == pytest.approx(0.20 * np.sin(np.radians(5)), rel=1e-3)


def test_a_shift_dorsiflexes_the_ankle_by_the_angle_of_the_leg_over_it(setup: Setup, tmp_path: Path) -> None:
    shifted = changed(setup, shift_mm=50.0, leg_length_m=0.9)
    moved, calm = decoded(shifted, tmp_path), decoded(shifted, tmp_path, perturbed=False)
    travel = moved.platform.point(np.array([0.3, 0.25, 0.0]))
    np.testing.assert_allclose(moved.platform_angle, 0, atol=1e-6)
    assert travel[:, 0].min() - travel[0, 0] == pytest.approx(-0.05, abs=1e-5)
    turned = moved.theta - calm.theta
    assert turned.max() == pytest.approx(0.05 / 0.9, rel=1e-3)
    ramp = (moved.time > 1.15) & (moved.time < 1.35)
    np.testing.assert_allclose(turned[ramp], (travel[0, 0] - travel[ramp, 0]) / 0.9, atol=1e-5)
    assert (moved.torque - calm.torque)[ramp].max() > 15


def test_a_heaving_platform_rises_in_the_middle_of_its_way(setup: Setup, tmp_path: Path) -> None:
    seen = decoded(imperfect(setup, "platform_heave", 3), tmp_path)
    still = decoded(setup, tmp_path)
    raised = 1e3 * (
        seen.platform.point(np.array([0.24, 0.25, 0.08])) - still.platform.point(np.array([0.24, 0.25, 0.08]))
    )
    assert raised[:, 2].max() == pytest.approx(3, abs=0.05)
    top = raised[:, 2].argmax()
    assert np.degrees(seen.platform_angle[top]) == pytest.approx(2.5, abs=0.5)
    held = np.degrees(seen.platform_angle) > 4.999
    np.testing.assert_allclose(raised[held, 2], 0, atol=0.01)
    lifted = 1e3 * (seen.foot.origin - still.foot.origin)[:, 2]
    assert lifted.max() == pytest.approx(3, abs=0.1), "the foot is carried"


def unloaded_angles(setup: Setup, trials: int) -> tuple[Array, Array]:
    """Times [s], and angles [deg] of unloaded ramps, shape (trials, n)."""
    time = motion_grid(setup.walking)
    ramps = [unloaded_platform(time, f"plate_{k + 1:02d}", 1, setup.walking) for k in range(trials)]
    return time, np.degrees([ramp.angle for ramp in ramps])


def test_ramps_differ_in_duration_by_the_share(setup: Setup) -> None:
    """Time from 10 to 90 % of 60 ramps: SD 8 % within 30 % (3 sigma); equal ramps are equal."""
    for share in (8.0, 0.0):
        ramps = changed(imperfect(setup, "rise_scatter", share), same_unloaded=True)
        time, angles = unloaded_angles(ramps, 60)
        up = time < 0.8
        rises = np.array([np.ptp(time[up][(a[up] > 0.5) & (a[up] < 4.5)]) for a in angles])
        assert np.std(rises) / np.mean(rises) == pytest.approx(0.01 * share, rel=0.3, abs=1e-9)


def test_a_shivering_servo_adds_another_vibration_to_each_ramp(setup: Setup) -> None:
    shivering = changed(imperfect(setup, "servo_shiver", 0.1), same_unloaded=True)
    time, angles = unloaded_angles(shivering, 40)
    _, smooth = unloaded_angles(changed(setup, same_unloaded=True), 1)
    rest = angles - smooth
    assert np.sqrt(np.mean(rest[:, (time > 0.56) & (time < 0.64)] ** 2)) == pytest.approx(0.1, rel=0.25)
    assert abs(np.corrcoef(rest[0], rest[1])[0, 1]) < 0.9
    assert not rest[:, (time < 0.5) | (time > 0.9)].any()


def test_the_platform_starts_at_another_time_after_each_trigger(setup: Setup) -> None:
    time = motion_grid(setup.walking)
    late = imperfect(setup, "trigger_scatter", 2)
    ramps = [unloaded_platform(time, f"plate_{k}", 1, late.walking) for k in range(60)]
    starts = np.array([time[np.abs(r.angle) > 1e-9][0] - (r.command or 0) for r in ramps])
    assert 1e3 * np.std(starts) == pytest.approx(2, rel=0.3)
    assert np.mean(starts) == pytest.approx(0.004, abs=0.0015)
