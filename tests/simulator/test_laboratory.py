# SPDX-License-Identifier: Apache-2.0
"""The simulated gait laboratory: plate, capture, conditions, gait, platform, recorders; measured
from written files."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from conftest import ROOT, refused_with
from scipy.signal import StateSpace, lsim
from walking_setup import PERTURBED, STATIC, leg_log, load_setup, with_toes_down

from osl_analysis.config.impedance_trajectory import read_impedance_trajectory
from osl_analysis.ingest.raw_files import trial_from_files
from osl_analysis.model.compensator import Weight, compensated_gains
from osl_analysis.simulator.laboratory_files import capture_parameters
from osl_analysis.simulator.rigid_body import interpolated_at
from osl_analysis.simulator.simulated_crossing import (
    impedance_of_leg,
    move,
    walking_commands,
)
from osl_analysis.simulator.step import GaitTrial, draw_step
from osl_analysis.simulator.trial_plan import plan_trials

G = 9.81  # [m/s^2]


@pytest.fixture(scope="module")
def shipped():
    return load_setup()


@pytest.fixture(scope="module")
def setup(shipped):
    """Exact sensors, massless plate and foot, and a platform that alone turns the ankle."""
    return shipped.ideal()


@pytest.fixture(scope="module")
def walked(shipped):
    return shipped.crossing(perturbed=True)


@pytest.fixture(scope="module")
def calm(shipped):
    return shipped.crossing(perturbed=False)


def with_experiments(setup, **numbers):
    experiments = setup.settings.experiments.model_copy(update=numbers)
    chosen = setup.settings.model_copy(update={"experiments": experiments})
    return replace(setup, settings=chosen)


def altered(setup, **fields):
    return replace(setup, walking=setup.walking.model_copy(update=fields))


def write_trajectory(folder, *values):
    """A trajectory of the impedance that is the same at every phase."""
    path = folder / "impedance.csv"
    cells = ",".join(map(str, values))
    path.write_text(f"phase,K_d,B_d\n0,{cells}\n1,{cells}\n")
    return path


def test_a_crossing_has_the_commanded_stiffness(setup, tmp_path):
    """K_1 = K_d K_s / (K_s - K_d) / n_T^2: actuator and belt in series."""
    own = altered(setup, impedance=write_trajectory(tmp_path, 200, 4))

    own.record(tmp_path, PERTURBED)

    stiffness = leg_log(tmp_path)["stiffness_gain"].max()
    assert stiffness == pytest.approx(200 * 685.6 / (685.6 - 200) / (83 / 18) ** 2, rel=1e-6)


def test_a_crossing_is_perturbed_at_the_planned_phase(setup):
    """The phase scatters by 0.01; stance lasts 0.72 s from 0.9 s on."""
    early = setup.walking.perturbation.model_copy(update={"stance_phase": (0.19, 0.21)})
    planned = altered(setup, perturbation=early).crossing(True)

    moves = planned.time[np.abs(planned.motion.theta - setup.crossing(False).motion.theta) > 1e-4]
    assert (planned.platform.command - 0.9) / 0.72 == pytest.approx(0.2, abs=0.011)
    assert 0.004 < moves[0] - planned.platform.onset < 0.05


def test_a_cubic_between_samples_is_interpolated_exactly():
    times = np.linspace(0.13, 1.66, 9)  # s, of samples from 0 to 1.9

    cubic = interpolated_at(np.arange(20.0) ** 3, 10.0, times)

    np.testing.assert_allclose(cubic, (10 * times) ** 3)


def test_a_plan_without_trials_is_refused(setup):
    none = dict.fromkeys(("belt", "transmission", "actuator", "static", "plate", "walking"), 0)
    with refused_with("trials"):
        plan_trials(with_experiments(setup, **none, K_d=()).settings)


def test_two_trials_of_one_name_are_refused(setup):
    with refused_with("trials 'impedance_K300_B"):
        plan_trials(with_experiments(setup, K_d=(300.0, 300.0001)).settings)


def test_the_planned_share_of_crossings_is_perturbed(setup):
    planned = plan_trials(with_experiments(setup, walking=100, perturbed_share=0.1).settings)

    perturbed = [row["perturbed"] for row in planned.values() if row["experiment"] == "walking"]
    assert len(perturbed) == 100
    assert 1 < sum(perturbed) < 25


def test_half_a_person_stands_on_the_plate_in_the_static_trial(setup, tmp_path):
    """40 kg of 80 kg above the ankle, 60 mm behind the middle of the plate."""
    setup.record(tmp_path, STATIC)

    row = {"trial": "static_1", "mocap": "vicon/static_1.c3d", "mocap_source": "vicon"}
    samples = trial_from_files(row, tmp_path, ROOT / "config/sources").samples
    # force [N] and moment [N*m] as ingest reads them, whose formulas have tests of their own
    wrench = samples.select("^plate1_.*$").to_numpy()
    weight = 40 * G
    expected = np.tile([0, 0, weight, 0, 0.06 * weight, 0], (len(wrench), 1))
    np.testing.assert_allclose(wrench, expected, atol=1e-3)


@pytest.fixture(scope="module")
def recorded(shipped, tmp_path_factory):
    """A crossing as shipped: what each recorder saw, and the truth."""
    folder = tmp_path_factory.mktemp("recorded")
    data = shipped.record(folder, PERTURBED)
    facts = json.loads((folder / "truth/walking_01.json").read_text())
    truth = pl.read_parquet(folder / "truth/walking_01.parquet")
    return SimpleNamespace(
        analogs=data["analogs"][0],
        points=data["points"],
        log=leg_log(folder),
        facts=facts,
        truth=truth,
    )


def test_the_leg_s_clock_has_an_offset_and_a_drift(recorded):
    offset, drift = recorded.facts["leg_clock"].values()

    assert 2.5 < offset < 7.5
    assert 0 < abs(drift) < 2e-4
    np.testing.assert_allclose(np.diff(recorded.log["time"]), 1 / 500, atol=1e-6)


def test_the_leg_s_log_has_the_true_angle_in_steps_of_its_sensors(recorded, shipped):
    effects = shipped.settings.effects
    steps = {
        "joint_angle": 2 * np.pi / 2**14,
        "actuator_angle": effects.actuator_encoder.value,
        "motor_current": effects.current_quantisation.value,
    }

    offset, drift = recorded.facts["leg_clock"].values()
    time = (recorded.log["time"] - offset) / (1 + drift)  # [s] in the laboratory's clock
    true = np.interp(time, recorded.truth["time"], recorded.truth["theta"])
    error = recorded.log["joint_angle"] - true

    assert np.abs(error).max() < 0.51 * steps["joint_angle"] + 1e-5
    for name, size in steps.items():
        counts = recorded.log[name] / size
        np.testing.assert_allclose(counts, np.rint(counts), atol=5e-3)


def test_the_plate_has_noise_and_offsets_of_the_set_sizes(recorded, shipped, tmp_path):
    """0.4 N and 80 N*mm, offsets of 2 N and 300 N*mm."""
    exact = shipped.lacking("force_noise", "moment_noise", "force_offset", "moment_offset")
    quiet = exact.record(tmp_path, PERTURBED)["analogs"][0]

    error = (recorded.analogs - quiet)[:6]

    offset = np.abs(error.mean(axis=1))
    noise = error - error.mean(axis=1, keepdims=True)
    assert offset[0] > 1
    assert offset[3] > 100
    assert np.std(noise[:3]) == pytest.approx(0.4, rel=0.03)
    assert np.std(noise[3:]) == pytest.approx(80, rel=0.03)


def test_a_plate_is_late_by_its_lag(shipped, tmp_path):
    """0.5 ms: the difference over the slope of the vertical force. Unloaded it reads nothing."""
    sensors = shipped.lacking("force_noise", "moment_noise", "force_offset", "moment_offset")
    late = sensors.record(tmp_path, PERTURBED)["analogs"][0, :6]
    prompt = sensors.lacking("plate_lag").record(tmp_path, PERTURBED)["analogs"][0, :6]

    slope = np.gradient(prompt[2], 1 / 1500)
    lag_s = slope @ (prompt - late)[2] / (slope @ slope)
    assert lag_s == pytest.approx(0.5e-3, rel=0.01)
    assert np.abs(prompt[:, :600]).max() < 1e-3


def test_an_effect_that_is_off_leaves_the_draws_of_the_others(recorded, shipped, tmp_path):
    """Noise of the plate and gaps of markers are the same; noise of markers has 0.15 mm."""
    clean = shipped.lacking("marker_noise").record(tmp_path, PERTURBED)

    np.testing.assert_array_equal(recorded.analogs, clean["analogs"][0])
    np.testing.assert_array_equal(np.isnan(recorded.points), np.isnan(clean["points"]))
    noise_mm = (recorded.points - clean["points"])[:3]
    assert np.nanstd(noise_mm) == pytest.approx(0.15, rel=0.02)


@pytest.mark.parametrize("effect", ["stance_scatter", "heel_strike_scatter", "placement_forward"])
def test_steps_scatter_by_the_sizes_that_are_set(shipped, effect):
    """150 steps tell a standard deviation to 6 %."""
    size = getattr(shipped.walking.effects, effect).size
    steps = [draw_step(GaitTrial(f"walking_{k}", 1, shipped.walking)) for k in range(150)]

    drawn = {
        "stance_scatter": [100 * step.stance / 0.72 for step in steps],  # [%]
        "heel_strike_scatter": [step.heel_strike for step in steps],  # [s]
        "placement_forward": [1e3 * step.placement[0] for step in steps],  # [mm]
    }

    assert np.std(drawn[effect]) == pytest.approx(size, rel=0.25)


def test_a_trial_depends_on_the_seed_and_its_name_only(shipped, tmp_path):
    other_seed = shipped.settings.model_copy(update={"seed": 7})

    for folder, setup in (
        ("first", shipped),
        ("again", shipped),
        ("other", replace(shipped, settings=other_seed)),
    ):
        setup.record(tmp_path / folder, PERTURBED)

    first, again, other = (
        (tmp_path / folder / "vicon/walking_01.c3d").read_bytes()
        for folder in ("first", "again", "other")
    )
    assert first == again
    assert first != other


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("phase,K_d\n0,100\n1,100\n", "column 'B_d'"),
        ("phase,K_d,B_d\n0,1,1\n", "0.*0;.*0.*1"),
        ("phase,K_d,B_d\n0,100,1\n0.9,100,1\n", "0.*0.9;.*0.*1"),
        ("phase,K_d,B_d\n0,1,1\n1,1,NaN\n", "column B_d:"),
        ("phase,K_d,B_d\n0,1,1\n1,a,1\n", "column 'K_d',.*text"),
    ],
)
def test_a_bad_impedance_trajectory_is_refused(tmp_path, text, message):
    (tmp_path / "impedance.csv").write_text(text)

    with refused_with(message):
        read_impedance_trajectory(tmp_path / "impedance.csv")


def test_columns_of_an_impedance_trajectory_that_nothing_uses_are_named(tmp_path):
    path = tmp_path / "impedance.csv"
    path.write_text("phase,K_d,B_d,theta_eq_rad\n0,100,1,0\n1,100,1,0\n")

    with pytest.warns(UserWarning, match="theta_eq_rad"):
        read_impedance_trajectory(path)


def test_corners_of_the_plate_go_round_as_c3d_has_them(shipped):
    groups = capture_parameters(GaitTrial("static_1", 1, shipped.walking), [])

    x, y, _ = groups["FORCE_PLATFORM"]["CORNERS"][:, :, 0] / 1e3
    assert np.sign(x - x.mean()).tolist() == [1, 1, -1, -1]
    assert np.sign(y - y.mean()).tolist() == [1, -1, -1, 1]


def test_the_foot_s_place_scatters_forward_and_sideways_on_its_own(walked):
    forward, sideways, _ = walked.step.placement

    assert forward != sideways


def test_the_ankle_wanders_by_one_standard_deviation_from_step_to_step(shipped):
    """Six waves of normal sizes; the mean square of 300 steps is known to 4 %."""
    steps = [GaitTrial("walking_01", seed, shipped.walking) for seed in range(300)]

    deviations = np.array([step.wandering()[::100] for step in steps])

    assert np.mean(deviations**2) == pytest.approx(1.0, rel=0.15)
    assert np.mean(deviations, axis=0) == pytest.approx(0.0, abs=0.25)


def test_a_weight_of_the_gains_is_used(shipped, tmp_path):
    path = write_trajectory(tmp_path, 300, 5)
    weight = Weight(cutoff_hz=1, order=1)
    gains = compensated_gains(300, 5, shipped.p, weight)
    walking = altered(shipped, impedance=path, gain_weight=weight).walking

    commands = walking_commands(draw_step(GaitTrial("walking_01", 1, walking)), shipped.p)

    expected = np.array([[gains.K_1], [gains.B_1]])
    np.testing.assert_allclose(commands[:2], np.broadcast_to(expected, commands[:2].shape))


def test_torque_and_load_are_those_of_level_walking(calm, shipped):
    """Peaks per body mass and weight; there is no load in swing."""
    upward = calm.reaction.force[:, 2] / (80 * G)
    phase = calm.step.stance_phase(calm.time)

    torque_per_kg = calm.torque.max() / shipped.walking.gait.body_mass_kg
    assert torque_per_kg == pytest.approx(1.4, abs=0.15)
    assert 1.0 < upward.max() < 1.25
    assert not calm.reaction.force[(phase < 0) | (phase > 1)].any()


def test_a_walking_leg_renders_what_linear_theory_says(setup):
    """The linear drivetrain (Eqs. 7-8) under the perturbation's rotation, integrated by scipy."""
    p = setup.p
    gains = compensated_gains(340, 5, p)
    crossing = setup.crossing(True)
    still = setup.crossing(False)
    theta, omega, alpha = (
        getattr(crossing.motion, name) - getattr(still.motion, name)
        for name in ("theta", "omega", "alpha")
    )
    A = [[0, 1], [-(gains.K_1 + p.K_s / p.n_T**2) / p.J_m, -(p.B_m + gains.B_1) / p.J_m]]
    drivetrain = StateSpace(A, [[0], [p.K_s / p.n_T / p.J_m]], [[1, 0]], [[0]])
    theta_m = lsim(drivetrain, theta, crossing.time)[1]
    torque = p.K_s * (theta - theta_m / p.n_T) + p.B_j * omega + p.J_j * alpha
    since_s = crossing.time - crossing.platform.onset
    window = (since_s >= 0) & (since_s <= 0.1)
    columns = np.column_stack([theta, omega, alpha])[window]
    K, B, I = np.linalg.lstsq(columns, torque[window])[0]

    rendered = impedance_of_leg(crossing, still)

    assert rendered["K_rendered"] == pytest.approx(K, rel=2e-3)
    assert rendered["B_rendered"] == pytest.approx(B, rel=1e-2)
    assert rendered["I_rendered"] == pytest.approx(I, abs=1e-3)


def test_a_perturbation_changes_nothing_before_its_onset(walked, calm):
    """Central differences look two samples ahead, twice; the torque between two updates of the
    controller is interpolated."""
    onset = walked.platform.onset
    still = walked.time < onset - 5 / 3000
    unchanged = walked.time < onset - 3e-3

    for name in ("theta", "omega", "alpha"):
        perturbed, unperturbed = (getattr(c.motion, name) for c in (walked, calm))
        np.testing.assert_array_equal(perturbed[still], unperturbed[still])
    np.testing.assert_array_equal(walked.torque[unchanged], calm.torque[unchanged])


def added_turn_deg(step):
    """What the perturbation adds to the ankle's angle 0.25 s after its onset."""
    added = move(step, True)[0].theta - move(step, False)[0].theta
    return np.degrees(added[np.searchsorted(step.trial.time, step.onset + 0.25)])


def test_a_perturbation_turns_the_ankle_by_its_size_in_its_direction(shipped):
    """A foot that yields takes 4 % of 5 deg."""
    for planned, sign in ((shipped, 1), (with_toes_down(shipped), -1)):
        step = draw_step(GaitTrial("walking_01", planned.settings.seed, planned.walking))
        assert added_turn_deg(step) == pytest.approx(sign * 0.96 * 5, abs=1e-6)
