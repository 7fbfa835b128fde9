# SPDX-License-Identifier: Apache-2.0
"""The simulated bench: its motions, its experiments, each imperfection with its stated size, and
the written log."""

import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, refused_with
from scipy.interpolate import CubicSpline
from shipped import LEG as P

from osl_analysis.base.yaml_settings import read_mapping, read_yaml
from osl_analysis.campaign.configuration import overriding
from osl_analysis.commands.simulate import row_of_trial, simulate_campaign, simulate_planned_trial
from osl_analysis.model.compensator import compensated_gains, uncompensated_gains
from osl_analysis.model.drivetrain import predicted_impedance
from osl_analysis.simulator import bench_trial
from osl_analysis.simulator import simulation_settings as settings
from osl_analysis.simulator.bench_trial import (
    JointMotion,
    simulate_bench_trial,
    true_signals,
)
from osl_analysis.simulator.simulation_settings import SimulationSettings

TINY = ROOT / "tests/tiny_simulation.yaml"
RATE = 1000.0  # [Hz]
TRIAL = "impedance_K300_B5.0_compensated"
JOINT = {"K": 300, "B": 5, "I": 0.02}  # exactly Eq. 15
TORQUE = "load_cell_torque"
ANGLE = "joint_angle"


def on(size, unit, **more):
    return {"enabled": True, "size": size, "unit": unit, **more}


def node(**changes):
    return {"recorder": {"node": changes}}


def only(changes):
    """Settings of a campaign with an exact joint and no imperfection but some."""
    content = read_mapping(TINY)
    for name, effect in content["effects"].items():
        effect["enabled"] = name == "dynamometer_bandwidth"
    chosen = overriding(content | {"recorder": {}, "joint": JOINT}, changes)
    return SimulationSettings.model_validate(chosen)


def simulated(changes):
    """Log and truth of a trial."""
    chosen = only(changes)
    return simulate_bench_trial(row_of_trial(chosen, Path("settings.yaml"), TRIAL), chosen, P)


def log_of(changes):
    return simulated(changes)[0]


@pytest.fixture(scope="module")
def clean():
    return log_of({})


PROTOCOL = {
    "frequencies_hz": (1, 3),
    "cycles": 4,
    "amplitudes_deg": (2,),
    "rest_s": 0.5,
    "lead_s": 1.0,
}


def stepped(**changes):
    schedule = settings.SteppedSineSchedule.model_validate({**PROTOCOL, **changes})
    return bench_trial.sine_command(schedule, RATE)


def excited(kind, **changes):
    """Angle [rad] of an excitation."""
    excitation = settings.Excitation.model_validate(
        {
            "name": "x",
            "rms_deg": 2.0,
            "duration_s": 20.0,
            "period_s": 4.0,
            "periods": 3,
            "kind": kind,
            **changes,
        }
    )
    return bench_trial.excitation_motion(excitation, "trial_x_1", 3, RATE)


SMOOTH = ("multisine", "chirp", "noise", "hand")
THERE_AND_BACK = [
    signal[501:4499]
    for signal in vars(
        bench_trial.there_and_back(
            settings.BeltMotion(amplitude_deg=5, ramp_s=2.0, rest_s=0.5), RATE
        )
    ).values()
]


@pytest.mark.parametrize(
    ("motion", "largest"),
    [
        (stepped(frequencies_hz=(1,), rest_s=0, lead_s=0), 2e-4),
        (JointMotion(*THERE_AND_BACK), 1e-12),
        (
            bench_trial.actuator_command(
                read_yaml((ROOT / "config/simulation/default.yaml"), SimulationSettings).actuator,
                RATE,
            )[0],
            1e-5,
        ),
        *((excited(kind), 1e-5) for kind in SMOOTH),
        # a sweep so fast that its own part of the acceleration shows
        (excited("chirp", duration_s=3.0, band_hz=(0.1, 4.0)), 1e-5),
    ],
)
def test_every_motion_comes_with_its_true_derivatives(motion, largest):
    """Simpson's rule is exact to h^5/90 of the fourth derivative, and to 4 h of the kink that a
    ramp's end has."""
    for signal, slope in ((motion.theta, motion.omega), (motion.omega, motion.alpha)):
        integral = (slope[2:-4] + 4 * slope[3:-3] + slope[4:-2]) / (3 * RATE)

        error = signal[4:-2] - signal[2:-4] - integral
        assert np.abs(error).max() < largest * np.ptp(slope)


def test_a_schedule_lasts_as_long_as_it_says():
    """A second of rest, two cycles of 1 Hz, six of 3 Hz, half a second of rest."""
    assert len(stepped(cycles=(2, 6)).theta) == 5500


@pytest.mark.parametrize("kind", SMOOTH)
def test_an_excitation_has_its_length_and_size_and_rests_at_its_ends(kind):
    """5 s of rests and fades beside 20 s, or three periods of 4 s."""
    theta = excited(kind, band_hz=(1.0, 4.0)).theta

    duration_s = 17 if kind == "multisine" else 25
    assert len(theta) == pytest.approx(duration_s * RATE, abs=4)
    assert not theta[:1500].any()
    assert not theta[-1500:].any()
    assert np.rad2deg(np.std(theta[3000:-3000])) == pytest.approx(2.0, rel=0.25)


@pytest.mark.parametrize("kind", ["multisine", "chirp", "noise"])
def test_an_excitation_has_its_band(kind):
    theta = excited(kind, band_hz=(1.0, 4.0)).theta

    power = np.abs(np.fft.rfft(theta)) ** 2
    f = np.fft.rfftfreq(len(theta), 1 / RATE)
    is_in_band = (f >= 0.8) & (f < 4.3)
    assert power[is_in_band].sum() / power.sum() > 0.98


def test_a_multisine_has_odd_lines_and_repeats_its_period():
    theta = excited("multisine").theta
    first = theta[2500:6500]
    repeated = theta[6500:10500]
    lines = np.abs(np.fft.rfft(first))[:40] / 4000

    np.testing.assert_allclose(first, repeated, atol=1e-9)
    assert lines[::2].max() < 1e-6
    assert lines.max() > 1e-6


def fitted(experiment, gains):
    """K, B and I of the true signals in the settled 2 Hz and 5 Hz: of three cycles each the last
    two."""
    motion, signals = true_signals(
        {"trial": TRIAL, "experiment": experiment}, only({"joint": None}), P, gains
    )
    time = np.arange(len(motion.theta)) / RATE
    rows = ((time > 1.0) & (time < 1.99)) | ((time > 2.2) & (time < 2.59))
    columns = np.column_stack([motion.theta, motion.omega, motion.alpha])
    return np.linalg.lstsq(columns[rows], -signals[TORQUE][rows])[0]


@pytest.mark.parametrize("controller", [compensated_gains, uncompensated_gains])
def test_without_effects_the_leg_renders_what_linear_theory_says(controller):
    gains = controller(300, 5, P)

    impedance = fitted("impedance", gains)

    expected = predicted_impedance(gains.K_1, gains.B_1, P, (2.0, 5.0))
    np.testing.assert_allclose(impedance[:2], expected, rtol=5e-3, atol=2e-3)


def test_the_transmission_alone_has_its_losses():
    impedance = fitted("transmission", None)

    np.testing.assert_allclose(impedance, (0.0, P.B_j, P.J_j), rtol=5e-3, atol=2e-3)


def test_effects_of_the_load_cell_add_what_the_truth_says(clean):
    sizes = {
        "load_cell_offset": on(0.5, "N*m"),
        "load_cell_drift": on(0.05, "N*m/min"),
        "load_cell_noise": on(0.05, "N*m"),
    }

    log, truth = simulated({"effects": sizes})

    minutes = (log["time"] - log["time"][0]) / 60
    drawn = truth["drawn"]
    noise = log[TORQUE] - clean[TORQUE] - drawn["load_cell_offset"]
    noise -= drawn["load_cell_drift"] * minutes
    assert np.std(noise) == pytest.approx(0.05, rel=0.05)
    assert np.abs(np.mean(noise)) < 0.005
    assert drawn["load_cell_offset"] / 0.5 != pytest.approx(drawn["load_cell_drift"] / 0.05)


def test_an_offset_and_a_drift_are_as_large_as_the_truth_says(clean):
    sizes = {"load_cell_offset": on(0.5, "N*m"), "load_cell_drift": on(0.05, "N*m/min")}

    log, truth = simulated({"effects": sizes})

    minutes = (log["time"] - log["time"][0]) / 60
    drawn = truth["drawn"]
    added = drawn["load_cell_offset"] + drawn["load_cell_drift"] * minutes
    assert log[TORQUE] - clean[TORQUE] == pytest.approx(added, abs=1e-10)


def test_effects_of_the_drivetrain_have_their_sizes():
    sizes = {
        "actuator_encoder": on(1e-3, "rad"),
        "belt_hysteresis": on(2, "N*m"),
        "control_delay": on(3, "update"),
        "velocity_filter": on(40, "Hz"),
        "friction": on(1.5, "1"),
    }

    effects = bench_trial.drivetrain_effects(only({"effects": sizes}))

    expected = {
        "encoder_resolution": 1e-3,
        "hysteresis_torque": 2,
        "control_delay": 3,
        "velocity_cutoff_hz": 40,
        "friction_scale": 1.5,
    }
    assert {name: effects[name] for name in expected} == expected


def test_the_belt_is_loaded_by_a_stiffness_that_scatters_between_trials():
    """By 1 %; the torque has the joint's damping, too, and the actuator is idle."""
    stiffnesses = []
    for trial in ("belt_01", "belt_02"):
        chosen = only({"effects": {"belt_scatter": on(0.01, "1")}})
        log, truth = simulate_bench_trial(
            row_of_trial(chosen, Path("settings.yaml"), trial), chosen, P
        )
        omega = np.gradient(log[ANGLE], 1e-3)
        belt_torque = -log[TORQUE] - P.B_j * omega
        loading = slice(600, 1400)
        stiffness = np.polyfit(log[ANGLE][loading], belt_torque[loading], 1)[0]
        stiffnesses.append(stiffness)

        assert stiffness == pytest.approx(truth["parameters"]["K_s"], rel=1e-4)
        assert not log["actuator_angle"].any()
    assert 1e-4 < abs(stiffnesses[0] / stiffnesses[1] - 1) < 0.06


def test_two_nodes_sample_at_their_own_rate_and_phase(clean):
    torque_node = {"phase": on(3e-4, "s"), "rate": on(333, "Hz")}

    log = log_of({"recorder": {"torque_node": torque_node}})

    time = log["torque_time"]
    rows = (time - time[0] > 1.0) & (time < time[-1] - 1.2)
    expected = CubicSpline(clean["time"], clean[TORQUE])(time)
    np.testing.assert_allclose(log["time"], clean["time"], rtol=0, atol=1e-9)
    assert time[0] - log["time"][0] == pytest.approx(3e-4, abs=1e-9)
    assert np.diff(time).mean() == pytest.approx(1 / 333, rel=1e-6)
    assert log[TORQUE][rows] == pytest.approx(expected[rows], abs=1e-4)


def test_true_jitter_leaves_each_sample_true(clean):
    log = log_of(node(jitter=on(20e-6, "s")))

    jitter = np.diff(log["time"]) - 1 / RATE
    expected = CubicSpline(clean["time"], clean[ANGLE])(log["time"])
    assert np.std(jitter) == pytest.approx(20e-6 * np.sqrt(2), rel=0.1)
    assert log[ANGLE] == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize(("f", "rows"), [(2, slice(1000, 2000)), (5, slice(2200, 2600))])
def test_an_exact_joint_answers_by_eq_15_to_what_the_bench_follows(clean, f, rows):
    """The bench has 30 Hz and a damping of 0.9; its transient is left."""
    w = 2 * np.pi * f
    kernel = np.exp(-1j * w * clean["time"][rows])

    commanded, theta, torque = (
        clean[name][rows] @ kernel for name in ("commanded_angle", ANGLE, TORQUE)
    )

    followed = 1 / (1 - (f / 30) ** 2 + 2j * 0.9 * f / 30)
    assert theta / commanded == pytest.approx(followed, rel=1e-3)
    assert -torque / theta == pytest.approx(300 - 0.02 * w**2 + 5j * w, rel=1e-4)


def test_a_late_load_cell_reads_the_torque_of_two_samples_ago(clean):
    """It rests at both ends."""
    log = log_of({"effects": {"load_cell_delay": on(2e-3, "s")}})

    assert log[TORQUE] == pytest.approx(np.roll(clean[TORQUE], 2), abs=1e-5)
    np.testing.assert_array_equal(log[ANGLE], clean[ANGLE])


def test_coulomb_friction_turns_with_the_velocity(clean):
    omega = np.gradient(clean[ANGLE], 1e-3)
    time = clean["time"]
    is_inside = (time - time[0] > 1.0) & (time < time[-1] - 1.2)
    moving = is_inside & (np.abs(omega) > 0.02)

    log = log_of({"joint": {**JOINT, "coulomb": on(3, "N*m")}})

    friction = (clean[TORQUE] - log[TORQUE])[moving]
    assert friction == pytest.approx(3 * np.sign(omega[moving]), abs=1e-4)


def test_an_actuator_s_friction_is_the_stated_multiple_at_rest_and_per_ampere():
    """Eq. 2: k_tau n_m I_q less friction, viscous torque and inertia; by least squares."""
    trial = "actuator_1"
    shipped = read_mapping(ROOT / "config/simulation/default.yaml")
    changes = {"effects": {"friction": on(1.5, "1")}}
    chosen = SimulationSettings.model_validate(overriding(shipped, changes))
    true = bench_trial.parameters_of_trial(trial, "actuator", chosen, P)
    motion, signals = true_signals({"trial": trial, "experiment": "actuator"}, chosen, true, None)
    current = signals["motor_current"]
    instants = np.arange(len(current)) / RATE
    torque = signals["output_torque"](instants)
    direction = np.sign(motion.omega)
    columns = np.column_stack(
        [current, direction, direction * np.abs(current), motion.omega, motion.alpha]
    )

    fitted = np.linalg.lstsq(columns, torque)[0]

    expected = [P.k_tau * P.n_m, -1.5 * P.f_C, -1.5 * P.f_G, -P.B_m, -P.J_m]
    assert fitted == pytest.approx(expected, rel=1e-6)


def test_without_a_compiler_one_line_says_what_to_install(monkeypatch, tmp_path, in_root):
    monkeypatch.setitem(sys.modules, "numba", None)
    message = "numba,.*-m pip install numba$"

    with refused_with(message):
        simulate_planned_trial(TINY, tmp_path, "belt_01")

    assert list(tmp_path.iterdir()) == []


def test_a_trial_simulated_alone_is_the_campaign_s(tmp_path, in_root):
    campaign = tmp_path / "all"
    alone = tmp_path / "alone"

    simulate_campaign(TINY, campaign)
    simulate_planned_trial(TINY, alone, TRIAL)

    written = sorted(str(file.relative_to(alone)) for file in alone.rglob("*.*"))
    assert written == [f"dynamometer/{TRIAL}.mcap", f"truth/{TRIAL}.json"]
    for path in written:
        assert (alone / path).read_bytes() == (campaign / path).read_bytes()
    assert len(list((campaign / "dynamometer").iterdir())) == 5
    assert (campaign / "trials.csv").is_file()
