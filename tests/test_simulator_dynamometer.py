"""The simulated bench: commanded and followed motion, the experiments, the sensors, the files."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from conftest import ROOT

from osl_analysis.bench.torque_angle import cycle_table, torque_angle_table, torque_angle_trial
from osl_analysis.campaign.configuration import read_config
from osl_analysis.commands.simulate import row_of_trial, simulate_campaign, simulate_trial
from osl_analysis.model.compensator import Gains, predicted_impedance
from osl_analysis.model.parameters import read_parameters
from osl_analysis.simulator.bench import simulate_bench_trial
from osl_analysis.simulator.joint_motion import (
    JointMotion,
    excitation_motion,
    position_loop,
    sine_command,
    slow_cycles,
    there_and_back,
)
from osl_analysis.simulator.settings import (
    BeltMotion,
    Excitation,
    RecorderSettings,
    SimulationSettings,
    SlowCycles,
    SteppedSineSchedule,
)
from osl_analysis.trial import Trial
from osl_analysis.yaml_settings import read_yaml

DEFAULT, TINY = ROOT / "config/simulation/default.yaml", ROOT / "tests/tiny_simulation.yaml"
P = read_parameters(ROOT / "config/parameters/default.yaml")
RATE = 1000.0


def simulate(path, trial, p=P, only=None, **changes):
    """Log and truth of a trial, with the named effects only, and one node that samples evenly."""
    settings = read_yaml(path, SimulationSettings)
    effects = settings.effects
    if only is not None:
        effects = effects.without().model_copy(update={name: getattr(effects, name) for name in only})
    settings = settings.model_copy(update={"effects": effects, "recorder": RecorderSettings(), **changes})
    return simulate_bench_trial(row_of_trial(settings, Path("settings.yaml"), trial), settings, p)


def effect(size, unit):
    return {"enabled": True, "size": size, "unit": unit}


def stepped(**changes):
    plain = {"frequencies_hz": (1, 3), "cycles": 4, "amplitudes_deg": (2,), "rest_s": 0.5, "lead_s": 1.0}
    return sine_command(SteppedSineSchedule.model_validate(plain | changes), RATE)


def excited(kind, **fields):
    settings = {"name": "x", "kind": kind, "rms_deg": 2.0, "duration_s": 20.0, "period_s": 4.0, "periods": 3} | fields
    return excitation_motion(Excitation.model_validate(settings), "trial_x_1", 3, RATE)


def test_the_stepped_sine_makes_whole_cycles_of_each_frequency_at_each_amplitude():
    motion = stepped(amplitudes_deg=(2, 5))
    block, t = 4 + 4 / 3 + 0.5, np.arange(len(motion.theta)) / RATE
    assert len(t) == round((1 + 2 * block) * RATE)
    moving = np.zeros(len(t), dtype=bool)
    for amplitude, start in ((2, 1.0), (5, 1.0 + block)):
        for f, begin, end in ((1, start, start + 4), (3, start + 4, start + 4 + 4 / 3)):
            inside = (t > begin - 1e-6) & (t < end - 1e-6)
            w, sine = 2 * np.pi * f, np.deg2rad(amplitude) * np.exp(2j * np.pi * f * (t[inside] - begin))
            assert motion.theta[inside] == pytest.approx(sine.imag, abs=1e-12)
            assert motion.omega[inside] == pytest.approx(w * sine.real, abs=1e-10)
            assert motion.alpha[inside] == pytest.approx(-(w**2) * sine.imag, abs=1e-9)
            moving |= inside
    assert not np.any(motion.theta[~moving])


SMOOTH = ("multisine", "chirp", "noise", "hand")
BELT = BeltMotion(amplitude_deg=5, ramp_s=2.0, rest_s=0.5)
PLAIN = {"frequencies_hz": (1,), "rest_s": 0, "lead_s": 0}


@pytest.mark.parametrize(
    ("motion", "largest"),
    [
        (stepped(**PLAIN, decay=effect(0.3, "1/s")), 1e-12),
        (stepped(**PLAIN, third_harmonic=effect(0.05, "1"), ramp_s=0.4), 2e-4),
        (JointMotion(*(signal[501:4499] for signal in vars(there_and_back(BELT, RATE)).values())), 1e-12),
        *((excited(kind), 1e-5) for kind in SMOOTH),
    ],
)
def test_every_motion_comes_with_its_true_derivatives(motion, largest):
    """Simpson's rule is exact to h^5/90 of the fourth derivative, and to 4 h of the kink that a ramp's end has."""
    for signal, slope in ((motion.theta, motion.omega), (motion.omega, motion.alpha)):
        integral = (slope[2:-4] + 4 * slope[3:-3] + slope[4:-2]) / (3 * RATE)
        assert np.max(np.abs(signal[4:-2] - signal[2:-4] - integral)) < largest * np.ptp(slope)


@pytest.mark.parametrize(
    ("changes", "duration"),
    [
        ({"rest_between_s": 1.0}, 1 + 4 + 4 / 3 + 2 + 0.5),
        ({"ramp_s": 0.5}, 1 + 4 + 4 / 3 + 2 + 0.5),
        ({"cycles": None, "seconds": 2.0}, 1 + 4 + 0.5),
        ({"cycles": (2, 6)}, 1 + 2 + 2 + 0.5),
        ({"clock_error": effect(5000, "ppm")}, (1 + 4 + 4 / 3 + 0.5) / 1.005),
    ],
)
def test_a_schedule_lasts_as_long_as_it_says(changes, duration):
    assert len(stepped(**changes).theta) == pytest.approx(RATE * duration, abs=1)


def test_frequencies_run_in_their_order_and_on_the_benchs_clock():
    motion = stepped(frequencies_hz=(3, 1), clock_error=effect(-5000, "ppm"), start="cosine")
    t = np.arange(1010, 2300) / RATE - 1 / 0.995
    assert motion.theta[1010:2300] == pytest.approx(np.deg2rad(2) * np.cos(2 * np.pi * 3 * 0.995 * t), abs=1e-9)
    assert np.sum(np.diff(np.sign(motion.theta[1010:])) != 0) == pytest.approx(2 * 8, abs=2)


def test_belt_and_slow_motions_go_to_both_ends_and_come_back_to_rest():
    theta = np.rad2deg(there_and_back(BELT, RATE).theta)
    assert (len(theta), theta.argmax(), theta.max()) == (5000, 2500, pytest.approx(5))
    assert np.append(theta[:500], theta[-500:]) == pytest.approx(0, abs=1e-10)
    cycles = {"lowest_deg": -10, "highest_deg": 10, "speed_deg_s": [4, 8], "turn_s": 0.2, "rest_s": 1}
    motion = slow_cycles(SlowCycles.model_validate(cycles), 500)
    degrees, speed = np.rad2deg(motion.theta), np.rad2deg(np.abs(motion.omega))
    assert motion.theta.size / 500 == pytest.approx(2 + 40 / 4 + 40 / 8)
    assert (degrees.min(), degrees.max()) == pytest.approx((-10, 10), abs=0.25)  # a tenth of a second at 4 deg/s
    assert degrees[-400:] == pytest.approx(0, abs=1e-9)
    assert {4, 8} <= set(speed.round(9))
    np.testing.assert_allclose(np.diff(motion.theta), (motion.omega[1:] + motion.omega[:-1]) / 1000, atol=1e-12)


@pytest.mark.parametrize("kind", [*SMOOTH, "prbs", "ramps"])
def test_an_excitation_has_its_length_its_size_and_rests_at_both_ends(kind):
    theta = excited(kind).theta
    assert len(theta) == pytest.approx((17 if kind == "multisine" else 25) * RATE, abs=4)  # 5 s of rests and fades
    assert not np.append(theta[:1500], theta[-1500:]).any()
    assert np.rad2deg(np.std(theta[3000:-3000])) == pytest.approx(2.0, rel=0.25)


def test_a_multisine_repeats_itself_and_its_realisations_have_the_same_lines_and_other_phases():
    theta = excited("multisine", realisations=2).theta
    one, again, other = (theta[start : start + 4000] for start in (2500, 6500, 2500 + 12000 + 2000 + 1500))
    np.testing.assert_allclose(one, again, atol=1e-9)
    sizes = [np.abs(np.fft.rfft(x))[:40] / 4000 for x in (one, other)]
    np.testing.assert_allclose(*sizes, atol=1e-6)
    assert np.abs(one - other).max() > 0.02
    assert not (sizes[0][::2] > 1e-6).any()


@pytest.mark.parametrize("kind", ["noise", "chirp"])
def test_noise_and_sweep_stay_within_their_band(kind):
    theta = excited(kind, band_hz=(1.0, 4.0)).theta
    power, f = np.abs(np.fft.rfft(theta)) ** 2, np.fft.rfftfreq(len(theta), 1 / RATE)
    assert power[(f > 0.8) & (f < 4.3)].sum() > 0.98 * power.sum()


@pytest.mark.parametrize("frequency_hz", [1, 30])
def test_the_dynamometer_follows_as_a_second_order_system(frequency_hz):
    rate, w, bandwidth = 2000.0, 2 * np.pi * frequency_hz, 2 * np.pi * 30
    t = np.arange(int(4 * rate)) / rate
    command = JointMotion(np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t))
    motion, turn = position_loop(command, rate, 30.0, 0.9), np.exp(-1j * w * t[4000:])
    found = [2j * np.mean(signal[4000:] * turn) for signal in vars(motion).values()]
    expected = bandwidth**2 / (bandwidth**2 - w**2 + 2j * 0.9 * bandwidth * w)
    assert found == [pytest.approx(expected * (1j * w) ** k, abs=1e-6 * w**k) for k in range(3)]


def fitted_impedance(log, protocol, dropped=4):
    """K, B, I of Eq. 15 from a log without noise, derivatives by fourth-order differences, without the first cycles of
    each frequency, where transients die out."""
    rows, start = [], protocol.lead_s
    for _ in protocol.amplitudes_deg:
        for f in protocol.frequencies_hz:
            end = start + protocol.cycles / f
            rows.append(np.arange(round((start + dropped / f) * RATE), round(end * RATE) - 2))
            start = end
        start += protocol.rest_s
    theta, torque, i = log["joint_angle"], -log["load_cell_torque"], np.concatenate(rows)
    omega = (theta[i - 2] - 8 * theta[i - 1] + 8 * theta[i + 1] - theta[i + 2]) * RATE / 12
    alpha = (-theta[i - 2] + 16 * theta[i - 1] - 30 * theta[i] + 16 * theta[i + 1] - theta[i + 2]) * RATE**2 / 12
    return np.linalg.lstsq(np.column_stack([theta[i], omega, alpha, np.ones(len(i))]), torque[i])[0][:3]


PROTOCOL = read_yaml(DEFAULT, SimulationSettings).protocol


@pytest.mark.parametrize(
    ("controller", "J_j", "expected"),
    [
        ("compensated", 0.0, (299.1, 5.46, 0.000)),
        ("uncompensated", 0.0, (209.7, 3.61, 0.093)),
        ("uncompensated", P.J_j, (209.7, 3.61, 0.093 + P.J_j)),
    ],
)
def test_without_effects_the_fit_of_eq_15_finds_what_linear_theory_and_the_design_page_say(controller, J_j, expected):
    p = replace(P, J_j=J_j)
    log, truth = simulate(DEFAULT, f"impedance_K300_B5.0_{controller}", p, only=("dynamometer_bandwidth",))
    K, B, I = fitted_impedance(log, PROTOCOL)
    for reference in (expected, predicted_impedance(Gains(**truth["gains"]), p, PROTOCOL.frequencies_hz)):
        assert pytest.approx(reference[0], rel=1e-3) == K
        assert pytest.approx(reference[1], rel=3e-3) == B
        assert pytest.approx(reference[2], abs=1e-3) == I


def test_the_stiffest_undamped_impedance_is_stable_with_every_effect():
    protocol = SteppedSineSchedule(frequencies_hz=(1,), cycles=20, amplitudes_deg=(6,), rest_s=0, lead_s=0)
    log, _ = simulate(DEFAULT, "impedance_K400_B0.0_compensated", protocol=protocol)
    assert np.max(np.abs(log["load_cell_torque"])) < 1.2 * 400 * np.deg2rad(6)


def test_the_belt_trial_loads_the_belt_by_its_own_stiffness_with_the_actuator_locked():
    stiffness, loading = [], slice(600, 1400)
    for trial in ("belt_01", "belt_02"):
        log, truth = simulate(TINY, trial, only=("belt_scatter", "dynamometer_bandwidth"))
        theta, omega = log["joint_angle"][loading], np.gradient(log["joint_angle"], 1e-3)[loading]
        stiffness.append(np.polyfit(theta, -log["load_cell_torque"][loading] - P.B_j * omega, 1)[0])
        assert stiffness[-1] == pytest.approx(truth["parameters"]["K_s"], rel=1e-4)
        assert not np.any(log["actuator_angle"])
    assert 1e-4 < abs(stiffness[0] / stiffness[1] - 1) < 0.06


def test_the_transmission_trial_shows_damping_and_inertia_only():
    log, _ = simulate(DEFAULT, "transmission_1", only=("dynamometer_bandwidth",))
    K, B, I = fitted_impedance(log, PROTOCOL)
    assert (B, I) == (pytest.approx(P.B_j, rel=1e-4), pytest.approx(P.J_j, rel=1e-3))
    assert pytest.approx(0, abs=1e-3) == K
    assert not np.any([log["actuator_angle"], log["motor_current"]])


def test_each_sensor_effect_adds_what_the_truth_says_and_leaves_the_other_draws_alone():
    names = ("load_cell_offset", "load_cell_drift", "load_cell_noise")
    chosen = {"clean": (), "all": names, **{name: (name,) for name in names}}
    logs, truths = zip(*(simulate(TINY, "belt_01", only=only) for only in chosen.values()), strict=True)
    truth, elapsed = truths[1], logs[1]["time"] - logs[1]["time"][0]
    added = {n: log["load_cell_torque"] - logs[0]["load_cell_torque"] for n, log in zip(chosen, logs, strict=True)}
    assert added["all"] == pytest.approx(sum(added[name] for name in names), abs=1e-10)
    assert added["load_cell_offset"] == pytest.approx(truth["drawn"]["load_cell_offset"], abs=1e-10)
    assert added["load_cell_drift"] == pytest.approx(truth["drawn"]["load_cell_drift"] * elapsed / 60, abs=1e-10)
    sizes = [truth["drawn"][name] / truth["effects"][name]["size"] for name in names[:2]]
    assert sizes[0] != pytest.approx(sizes[1]), "each effect draws from a stream of its own"
    assert np.std(added["load_cell_noise"]) == pytest.approx(0.05, rel=4 / np.sqrt(2 * 3000))


def test_a_trial_simulated_alone_is_the_campaigns(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    name = "impedance_K300_B5.0_compensated"
    simulate_campaign(TINY, tmp_path / "all")
    simulate_trial(TINY, tmp_path / "one", name)
    written = sorted(str(f.relative_to(tmp_path / "one")) for f in (tmp_path / "one").rglob("*.*"))
    assert written == [f"dynamometer/{name}.mcap", f"truth/{name}.json"]
    for path in written:
        assert (tmp_path / "one" / path).read_bytes() == (tmp_path / "all" / path).read_bytes()
    assert len(list((tmp_path / "all/dynamometer").iterdir())) == 5
    assert (tmp_path / "all/trials.csv").is_file()


def test_the_analysis_finds_the_springs_of_the_foot_and_what_each_cycle_loses():
    settings = read_yaml(ROOT / "config/simulation/torque_angle.yaml", SimulationSettings)
    row, foot = row_of_trial(settings, Path("settings.yaml"), "torque_angle_1"), settings.foot
    log, truth = simulate_bench_trial(row, settings, P)
    columns = {"time": log["time"] - log["time"][0], "theta": log["joint_angle"], "torque": -log["load_cell_torque"]}
    campaign = read_config(ROOT / "config/campaigns/torque_angle/config.yaml")
    found = torque_angle_trial(Trial("foot", pl.DataFrame(columns)), campaign.torque_angle)
    cycles, table = cycle_table(found), torque_angle_table(found).to_dicts()[0]
    assert truth["foot"] == foot.model_dump()
    assert cycles["speed_deg_s"].to_list() == pytest.approx([3, 4, 5], rel=0.03)  # the turns are slower
    for cycle, lost in zip(found.cycles, cycles["energy_lost"], strict=True):
        half = np.ptp(found.theta[cycle[0] : cycle[-1] + 1]) / 2
        assert lost == pytest.approx(sum(4 * s.limit * (half - s.limit / s.stiffness) for s in foot.slipping), rel=0.01)
    assert table["K_lowest"] == pytest.approx(foot.K, rel=0.01)  # at rest, where both springs slip
    assert table["rate_change"] == pytest.approx(0, abs=0.05)
    assert abs(table["cycle_drift"]) < 0.005
