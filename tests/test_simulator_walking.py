"""A simulated crossing is rigid-body mechanics, and the leg in it renders what it should."""

import numpy as np
import pytest
from walking_setup import load_setup

from osl_analysis.model.compensator import compensated_gains
from osl_analysis.shared_choices import read_impedance_trajectory
from osl_analysis.simulator import step as gait
from osl_analysis.simulator.bench import drivetrain_effects
from osl_analysis.simulator.crossing import rendered_impedance, simulate_crossing
from osl_analysis.simulator.rigid_body import Pose, RigidBody, interpolated_at, rotation_about, time_derivative
from osl_analysis.simulator.step import draw_step
from osl_analysis.simulator.walking import motion_grid

G = 9.81
GRAVITY = np.array([0, 0, -G])


@pytest.fixture(scope="module")
def setup():
    return load_setup()


@pytest.fixture(scope="module")
def walked(setup):
    return setup.crossing(perturbed=True)


@pytest.fixture(scope="module")
def calm(setup):
    return setup.crossing(perturbed=False)


def inside_stance(crossing):
    phase = crossing.step.stance_phase(crossing.time)
    return (phase > 0.08) & (phase < 0.92)


# Newton and Euler


def test_the_derivative_of_a_sine_is_a_cosine():
    t = np.arange(600) / 3000
    np.testing.assert_allclose(time_derivative(np.sin(60 * t), 3000)[2:-2], 60 * np.cos(60 * t)[2:-2], atol=60 * 6e-9)


def test_interpolation_is_exact_for_cubics_and_on_the_grid():
    t, other = np.arange(50) / 100, np.array([0.0, 0.0123, 0.2, 0.3777, 0.49])
    values = np.stack([t**3 - t, 2 * t**2], axis=-1)
    expected = np.stack([other**3 - other, 2 * other**2], axis=-1)
    np.testing.assert_allclose(interpolated_at(values, 100, other)[1:-1], expected[1:-1], atol=1e-14)


def test_a_turning_body_needs_what_its_six_point_masses_need():
    """Swung about y through a pivot by phi = 0.2 sin 9t: a = alpha x r + omega x (omega x r), by hand per mass."""
    rate, t = 3000.0, np.arange(900) / 3000
    phi, omega, alpha = 0.2 * np.sin(9 * t), 1.8 * np.cos(9 * t), -16.2 * np.sin(9 * t)
    pivot, centre, gyration = np.array([0.3, 0.2, 0.1]), np.array([0.34, 0.17, -0.05]), np.array([0.1, 0.13, 0.12])
    body, y = RigidBody(7.0, centre, gyration), np.array([0.0, 1.0, 0.0])
    rotation = rotation_about(1, phi)
    wrench = body.support(Pose(rotation, pivot - rotation @ pivot), rate)
    spread = np.sqrt(1.5 * (np.sum(gyration**2) - 2 * gyration**2))
    force, moment = np.zeros((900, 3)), np.zeros((900, 3))
    for place in np.vstack([np.diag(spread), -np.diag(spread)]) + centre - pivot:
        r = rotation @ place
        acceleration = alpha[:, None] * np.cross(y, r) + (omega**2)[:, None] * np.cross(y, np.cross(y, r))
        share = 7.0 / 6 * (acceleration - GRAVITY)
        force, moment = force + share, moment + np.cross(r, share)
    np.testing.assert_allclose(wrench.force[4:-4], force[4:-4], atol=1e-4)
    np.testing.assert_allclose(wrench.moment_about(np.tile(pivot, (900, 1)))[4:-4], moment[4:-4], atol=1e-4)


def test_the_ground_gives_the_foot_what_torque_weight_and_inertia_leave(walked, setup):
    """tau = N - u . M_a, with N of the foot's mass written out as a point mass and a gyration about the axis."""
    foot, rate = walked.motion.foot, setup.walking.rates.motion_hz
    axis, inside = foot.rotation[:, :, 1], inside_stance(walked)
    mass = setup.walking.effects.foot_inertia.size
    centre = foot.point(np.array(setup.walking.foot.centre_of_mass_m))
    acceleration = np.gradient(np.gradient(centre, 1 / rate, axis=0), 1 / rate, axis=0) - GRAVITY
    pitch = np.arctan2(-foot.rotation[:, 2, 0], foot.rotation[:, 2, 2])
    turning = mass * setup.walking.foot.gyration_m[1] ** 2 * np.gradient(np.gradient(pitch, 1 / rate), 1 / rate)
    needed = turning + np.einsum("ni,ni->n", np.cross(centre - foot.origin, mass * acceleration), axis)
    ground = np.einsum("ni,ni->n", walked.reaction.moment_about(foot.origin), axis)
    np.testing.assert_allclose((needed - ground)[inside], walked.torque[inside], atol=0.02)
    np.testing.assert_allclose(walked.torque[inside], walked.drivetrain_torque[inside], atol=1e-9)


def test_shank_and_foot_are_hinged_at_the_ankle_by_theta(walked):
    foot, shank = walked.motion.foot, walked.motion.shank
    between = foot.rotation.transpose(0, 2, 1) @ shank.rotation
    np.testing.assert_allclose(between, rotation_about(1, walked.motion.theta), atol=1e-12)
    np.testing.assert_array_equal(foot.origin, shank.origin)


def test_leaning_forward_over_the_foot_is_dorsiflexion(calm):
    lean = calm.motion.shank.rotation[:, 0, 2] - calm.motion.foot.rotation[:, 0, 2]
    flat = (calm.step.stance_phase(calm.time) > 0.3) & (calm.step.stance_phase(calm.time) < 0.58)
    np.testing.assert_allclose(lean[flat], np.sin(calm.motion.theta[flat]), atol=1e-3)


# The gait


def test_the_flat_foot_is_rigid_on_the_platform(walked):
    phase = walked.step.stance_phase(walked.time)
    flat = (phase > gait.FLAT_FROM) & (phase < gait.FLAT_TO)
    platform, foot = walked.motion.platform.pose, walked.motion.foot
    held = np.einsum("nji,nj->ni", platform.rotation, foot.origin - platform.origin)[flat]
    turned = (platform.rotation.transpose(0, 2, 1) @ foot.rotation)[flat]
    np.testing.assert_allclose(held, np.tile(held[0], (len(held), 1)), atol=1e-9)
    np.testing.assert_allclose(turned, np.tile(turned[0], (len(turned), 1, 1)), atol=1e-9)
    assert np.degrees(np.ptp(walked.motion.platform.angle[flat])) == pytest.approx(5, abs=1e-6)


def test_the_foot_stays_above_the_floor(calm, setup):
    for point in (gait.HEEL, gait.BALL):
        assert calm.motion.foot.point(point)[:, 2].min() > setup.walking.plate.centre_m[2] - 1e-3


@pytest.mark.parametrize("trial", [f"walking_{i:02d}" for i in range(1, 6)])
def test_the_ground_presses_under_the_foot(setup, trial):
    crossing = setup.crossing(perturbed=False, trial=trial)
    inside = inside_stance(crossing)
    below = crossing.motion.foot.origin.copy()
    below[:, 2] = setup.walking.plate.centre_m[2]
    moment = crossing.reaction.moment_about(below)[inside]
    ahead = -moment[:, 1] / crossing.reaction.force[inside, 2] + below[inside, 0] - below[inside, 0][0]
    assert ahead.min() > -0.12
    assert ahead.max() < 0.20


def test_ankle_moment_and_force_are_those_of_level_walking(calm, setup):
    phase, mass = calm.step.stance_phase(calm.time), setup.walking.gait.body_mass_kg
    window = (phase > 0.39) & (phase < 0.53)
    assert 30 < calm.torque[window].mean() < 50
    assert calm.torque[(phase > 0) & (phase < 1)].max() / mass == pytest.approx(1.4, abs=0.15)
    upward = calm.reaction.force[:, 2] / (mass * G)
    assert 1.0 < upward[phase < 0.4].max() < 1.25
    assert upward[(phase > 0.4) & (phase < 0.6)].min() < 0.85
    swing = (phase < 0) | (phase > 1)
    assert not calm.reaction.force[swing].any()
    assert not calm.reaction.moment[swing].any()


def test_step_to_step_variability_has_the_sizes_that_are_set(setup):
    """Standard deviations over 400 steps are within 15 % (4 sigma) of the sizes."""
    time = motion_grid(setup.walking)[::300]
    steps = [draw_step(f"walking_{i}", 1, time, setup.walking) for i in range(400)]
    gaits, effects = setup.walking.gait, setup.walking.effects
    found = {
        "stance_scatter": 100 * np.std([s.stance for s in steps]) / gaits.stance_s,
        "heel_strike_scatter": np.std([s.heel_strike for s in steps]),
        "angle_scale": 100 * np.std([s.angle_factor for s in steps]),
        "angle_wander": np.degrees(np.std([s.wander for s in steps])),
        "force_scale": 100 * np.std([s.force_factor for s in steps]),
        "placement_forward": 1e3 * np.std([s.placement[0] for s in steps]),
        "placement_sideways": 1e3 * np.std([s.placement[1] for s in steps]),
        "foot_yaw": np.degrees(np.std([s.yaw for s in steps])),
    }
    for name, value in found.items():
        assert value == pytest.approx(getattr(effects, name).size, rel=0.15), name


# The perturbation


def test_a_perturbation_changes_nothing_before_its_onset(walked, calm):
    onset = walked.motion.platform.onset
    assert onset is not None
    before = walked.time <= onset
    for name in ("theta", "omega", "alpha"):
        # the central differences look two samples ahead, twice
        early = before & (walked.time < onset - 5 / 3000)
        np.testing.assert_array_equal(getattr(walked.motion, name)[early], getattr(calm.motion, name)[early])
    early = walked.time < onset - 3e-3  # and the torque between two updates of the controller is interpolated
    np.testing.assert_array_equal(walked.torque[early], calm.torque[early])
    np.testing.assert_array_equal(walked.reaction.moment[early], calm.reaction.moment[early])


def test_the_ramp_is_five_degrees_of_dorsiflexion_within_the_window(walked, calm):
    onset, phase = walked.motion.platform.onset, walked.step.stance_phase(walked.time)
    assert onset is not None
    turned = np.degrees(walked.motion.theta - calm.motion.theta)
    window = (walked.time > onset) & (walked.time < onset + 0.1)
    assert turned[window].max() == pytest.approx(5, rel=0.03)
    assert (walked.motion.foot.rotation[:, 2, 0] - calm.motion.foot.rotation[:, 2, 0])[window].max() > 0.08, "toes up"
    assert 0.38 < phase[window].min() < 0.41
    assert phase[window].max() < gait.FLAT_TO
    assert (walked.torque - calm.torque)[window].max() > 20


def linear_answer(setup, K_d, B_d, crossing, calm):
    """Torque of the linear drivetrain (Eqs. 7-8) to the perturbation's rotation, integrated apart by scipy."""
    from scipy.signal import StateSpace, lsim

    p, gains = setup.p, compensated_gains(K_d, B_d, setup.p)
    theta, omega, alpha = (getattr(crossing.motion, n) - getattr(calm.motion, n) for n in ("theta", "omega", "alpha"))
    stiffness = gains.K_1 + p.K_s / p.n_T**2
    A = [[0, 1], [-stiffness / p.J_m, -(p.B_m + gains.B_1) / p.J_m]]
    actuator = StateSpace(A, [[0], [p.K_s / p.n_T / p.J_m]], [[1, 0]], [[0]])
    _, theta_m, _ = lsim(actuator, theta, crossing.time)
    return np.asarray(p.K_s * (theta - theta_m / p.n_T) + p.B_j * omega + p.J_j * alpha)


def fitted(torque, crossing, calm):
    columns = [getattr(crossing.motion, n) - getattr(calm.motion, n) for n in ("theta", "omega", "alpha")]
    onset = crossing.motion.platform.onset
    assert onset is not None
    window = (crossing.time >= onset) & (crossing.time <= onset + 0.1)
    return np.asarray(np.linalg.lstsq(np.stack(columns, axis=-1)[window], torque[window], rcond=None)[0])


def test_without_imperfections_the_leg_renders_what_linear_theory_says(setup):
    ideal = setup.ideal()
    crossing, calm = ideal.crossing(perturbed=True), ideal.crossing(perturbed=False)
    theory = linear_answer(ideal, 340, 5, crossing, calm)
    onset = crossing.motion.platform.onset
    assert onset is not None
    window = (crossing.time >= onset) & (crossing.time <= onset + 0.1)
    answer = crossing.drivetrain_torque - calm.drivetrain_torque
    np.testing.assert_allclose(answer[window], theory[window], atol=0.1)
    rendered = rendered_impedance(crossing, calm)
    K, B, inertia = fitted(theory, crossing, calm)
    assert rendered["K_rendered"] == pytest.approx(K, rel=2e-3)
    assert rendered["B_rendered"] == pytest.approx(B, rel=1e-2)
    assert rendered["I_rendered"] == pytest.approx(inertia, abs=1e-3)


def test_with_imperfections_it_renders_340_within_a_few_percent(walked, calm):
    rendered = rendered_impedance(walked, calm)
    assert rendered["K_rendered"] == pytest.approx(340, rel=0.04)
    assert rendered["B_rendered"] == pytest.approx(5, rel=0.1)


def test_the_desired_stiffness_peaks_at_340_and_is_level_in_the_window(setup):
    desired = read_impedance_trajectory(setup.walking.impedance)
    assert desired.K_d.max() == 340
    assert desired.K_d[0] == desired.K_d[-1]
    window = gait.STANCE_FRACTION * np.linspace(0.36, 0.56, 50)
    assert np.ptp(desired.at(desired.K_d, window)) < 0.005 * 340
    assert np.abs(np.diff(desired.K_d)).max() < 0.05 * 340
    np.testing.assert_allclose(desired.at(desired.K_d, window - 1), desired.at(desired.K_d, window))


def test_an_uncompensated_leg_gets_the_naive_gains_and_renders_less(setup, walked):
    time = motion_grid(setup.walking)
    effects = drivetrain_effects(setup.settings)
    naive, calm = (
        simulate_crossing(time, walked.step, perturbed, False, setup.walking, effects, setup.p)
        for perturbed in (True, False)
    )
    assert naive.commands.K_1.max() == pytest.approx(340 / setup.p.n_T**2)
    assert not naive.commands.cancels_friction
    assert rendered_impedance(naive, calm)["K_rendered"] < 0.75 * 340
