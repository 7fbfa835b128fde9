"""What makes crossings differ: load, amplitude, pace and timing, measured from the written files."""

from pathlib import Path

import numpy as np
import pytest
from decoded_capture import DecodedCrossing, decoded_crossing
from walking_setup import PERTURBED, UNPERTURBED, Setup, load_setup

from osl_analysis.errors import InputError
from osl_analysis.simulator.settings import Effect
from osl_analysis.simulator.step import change_of, draw_step
from osl_analysis.simulator.walking import motion_grid
from osl_analysis.simulator.walking_settings import StepChange


@pytest.fixture(scope="module")
def setup() -> Setup:
    return load_setup().ideal()


def changed(setup: Setup, **change: object) -> Setup:
    walking = setup.walking.model_copy(update={"changes": (StepChange(**change),)})  # type: ignore[arg-type]
    return Setup(setup.settings, walking, setup.p)


def scattered(setup: Setup, name: str, size: float) -> Setup:
    unit = getattr(setup.walking.effects, name).unit
    effects = setup.walking.effects.model_copy(update={name: Effect(enabled=True, size=size, unit=unit)})
    return Setup(setup.settings, setup.walking.model_copy(update={"effects": effects}), setup.p)


def decoded(setup: Setup, folder: Path, perturbed: bool = False, trial: str = "walking_01") -> DecodedCrossing:
    setup.record(folder, (PERTURBED if perturbed else UNPERTURBED) | {"trial": trial})
    return decoded_crossing(folder / f"vicon/{trial}.c3d")


@pytest.fixture(scope="module")
def usual(setup: Setup, tmp_path_factory: pytest.TempPathFactory) -> DecodedCrossing:
    return decoded(setup, tmp_path_factory.mktemp("usual"))


def test_less_load_is_less_force_and_torque_at_the_same_angle(
    setup: Setup, usual: DecodedCrossing, tmp_path: Path
) -> None:
    light = decoded(changed(setup, load=0.7), tmp_path)
    middle = usual.force[:, 2] > 400
    np.testing.assert_allclose(light.force[middle] / usual.force[middle], 0.7, rtol=1e-4)
    np.testing.assert_allclose(light.theta, usual.theta, atol=1e-6)
    # damping and the actuator's inertia follow the angle, which is the same: 2 N*m where the impedance is constant
    level = (usual.time > 0.9 + 0.36 * 0.72) & (usual.time < 0.9 + 0.56 * 0.72)
    np.testing.assert_allclose(light.torque[level], 0.7 * usual.torque[level], atol=2)
    assert (usual.torque[level] > 20).all()
    # the torque that does not scale moves the pressure: 4 N*m over 280 N
    np.testing.assert_allclose(light.pressure[middle], usual.pressure[middle], atol=1.5e-2)


def test_a_smaller_amplitude_is_one_factor_of_angle_torque_and_force(
    setup: Setup, usual: DecodedCrossing, tmp_path: Path
) -> None:
    small = decoded(changed(setup, amplitude=0.8), tmp_path)
    middle = usual.force[:, 2] > 400
    np.testing.assert_allclose(small.theta, 0.8 * usual.theta, atol=1e-6)
    np.testing.assert_allclose(small.force[middle], 0.8 * usual.force[middle], rtol=1e-4)
    np.testing.assert_allclose(small.torque[middle], 0.8 * usual.torque[middle], atol=1e-2)


def test_a_slower_crossing_is_slower_throughout(setup: Setup, usual: DecodedCrossing, tmp_path: Path) -> None:
    slow = decoded(changed(setup, slower_percent=10), tmp_path)
    assert np.ptp(slow.stance) / np.ptp(usual.stance) == pytest.approx(1.1, rel=0.01)
    later = 0.9 + (usual.time - 0.9) * 1.1
    inside = (usual.time > 0.95) & (usual.time < 1.55)
    np.testing.assert_allclose(np.interp(later, slow.time, slow.theta)[inside], usual.theta[inside], atol=1e-3)


@pytest.mark.parametrize("percent", [-8.0, 8.0])
def test_stance_changes_only_after_the_window(setup: Setup, tmp_path: Path, percent: float) -> None:
    moved, same = (
        decoded(changed(setup, after_window_percent=p, of="perturbed"), tmp_path, True) for p in (percent, 0.0)
    )
    onset = same.time[np.abs(same.platform_angle) > 1e-4][0]
    before = same.time < onset + 0.095  # a curve with three derivatives starts at 100 ms
    np.testing.assert_allclose(moved.torque[before], same.torque[before], atol=1e-3)
    np.testing.assert_allclose(moved.force[before], same.force[before], atol=1e-3)
    assert moved.stance[1] - same.stance[1] == pytest.approx(0.01 * percent * 0.72, abs=0.007)
    assert moved.stance[0] == same.stance[0]
    assert moved.force[:, 2].max() == pytest.approx(same.force[:, 2].max(), rel=1e-3)


def test_an_impossible_stance_is_refused(setup: Setup, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="trial walking_01: after_window_percent 90 leaves"):
        decoded(changed(setup, after_window_percent=90), tmp_path, True)


def test_only_perturbed_crossings_change_after_the_window(setup: Setup, usual: DecodedCrossing, tmp_path: Path) -> None:
    np.testing.assert_array_equal(decoded(changed(setup, after_window_percent=-8), tmp_path).force, usual.force)


def test_other_timing_keeps_heel_strike_and_toe_off(setup: Setup, usual: DecodedCrossing, tmp_path: Path) -> None:
    warped = decoded(scattered(setup, "timing_wander", 3), tmp_path)
    assert warped.stance == pytest.approx(usual.stance, abs=0.004)
    assert np.abs(warped.force[:, 2] - usual.force[:, 2]).max() > 10


def test_timing_scatters_by_the_size_at_mid_stance(setup: Setup) -> None:
    """SD of the phase at the middle of stance over 400 steps, within 15 % (4 sigma)."""
    other, time = scattered(setup, "timing_wander", 2), motion_grid(setup.walking)[::300]
    steps = [draw_step(f"walking_{i}", 1, time, other.walking) for i in range(400)]
    middle = [float(s.stance_phase(np.array([s.heel_strike + s.stance / 2]))[0]) for s in steps]
    assert np.std(middle) == pytest.approx(0.02, rel=0.15)
    assert np.mean(middle) == pytest.approx(0.5, abs=0.004)


def test_the_torque_wanders_by_the_size_and_the_angle_stays(
    setup: Setup, usual: DecodedCrossing, tmp_path: Path
) -> None:
    """Slow waves: the leg follows its equilibrium. RMS over 8 crossings, with 30 % for the few waves in one stance."""
    wandering = scattered(setup, "torque_wander", 4)
    middle, errors = usual.force[:, 2] > 400, []
    for k in range(1, 9):
        seen = decoded(wandering, tmp_path, trial=f"walking_{k:02d}")
        np.testing.assert_allclose(seen.theta, usual.theta, atol=1e-6)
        errors.append((seen.torque - usual.torque)[middle])
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(4, rel=0.3)


def test_load_and_amplitude_scatter_by_their_sizes(setup: Setup) -> None:
    time = motion_grid(setup.walking)[::300]
    for name, factor in (("load_scatter", "load"), ("amplitude_scatter", "amplitude")):
        walking = scattered(setup, name, 5).walking
        found = [getattr(draw_step(f"walking_{i}", 1, time, walking).change, factor) for i in range(400)]
        assert np.std(found) == pytest.approx(0.05, rel=0.15), name


def test_a_change_concerns_the_named_crossings_or_a_share_of_a_kind() -> None:
    named = StepChange(of=("walking_03",), load=0.7)
    assert change_of("walking_03", 1, False, [named]).load == 0.7
    assert change_of("walking_04", 1, False, [named]).load == 1.0
    some = StepChange(of="unperturbed", share=0.3, load=0.7, slower_percent=5)
    drawn = [change_of(f"walking_{i}", 1, False, [some]).load for i in range(400)]
    assert np.mean(np.array(drawn) == 0.7) == pytest.approx(0.3, abs=0.09)
    assert {change_of(f"walking_{i}", 1, True, [some]).load for i in range(50)} == {1.0}
    both = change_of("walking_03", 1, False, [named, StepChange(load=0.5, slower_percent=5)])
    assert (both.load, both.slower_percent) == (0.35, 5)
