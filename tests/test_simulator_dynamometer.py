"""The simulated bench: commanded and followed motion, the three experiments, the sensors, the files."""

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
from osl_analysis.simulator.plan import plan_trials
from osl_analysis.simulator.settings import (
    BeltMotion,
    Excitation,
    PassiveFoot,
    RecorderSettings,
    SimulationSettings,
    SlowCycles,
    SteppedSineSchedule,
)
from osl_analysis.trial import Trial
from osl_analysis.yaml_settings import read_yaml

DEFAULT = ROOT / "config" / "simulation" / "default.yaml"
TINY = ROOT / "tests" / "tiny_simulation.yaml"
P = read_parameters(ROOT / "config" / "parameters" / "default.yaml")
SETTINGS = read_yaml(ROOT / "config/simulation/torque_angle.yaml", SimulationSettings)
CYCLES = {"lowest_deg": -10, "highest_deg": 10, "speed_deg_s": [4, 8], "turn_s": 0.2, "rest_s": 1}


def settings_from(path, *, without=None, only=None):
    """Settings without the named effects, or with the named ones only, and one node that samples evenly."""
    settings = read_yaml(path, SimulationSettings)
    effects = settings.effects
    if without is not None:
        effects = effects.without(*without)
    if only is not None:
        effects = effects.without().model_copy(update={name: getattr(effects, name) for name in only})
    return settings.model_copy(update={"effects": effects, "recorder": RecorderSettings()})


def simulate(trial, settings, p=P):
    return simulate_bench_trial(row_of_trial(settings, Path("settings.yaml"), trial), settings, p)


def regress(y, *columns):
    return np.linalg.lstsq(np.column_stack(columns), y, rcond=None)[0]


def test_the_stepped_sine_makes_whole_cycles_of_each_frequency_at_each_amplitude():
    motion = sine_command(schedule(amplitudes_deg=(2, 5)), 1000.0)
    block = 4 + 4 / 3 + 0.5
    assert len(motion.theta) == round((1 + 2 * block) * 1000)
    t = np.arange(len(motion.theta)) / 1000
    for amplitude, start in ((2, 1.0), (5, 1.0 + block)):
        for f, begin, end in ((1, start, start + 4), (3, start + 4, start + 4 + 4 / 3)):
            inside = (t > begin + 1e-6) & (t < end - 1e-6)
            w, phase = 2 * np.pi * f, 2 * np.pi * f * (t[inside] - begin)
            assert motion.theta[inside] == pytest.approx(np.deg2rad(amplitude) * np.sin(phase), abs=1e-12)
            assert motion.omega[inside] == pytest.approx(np.deg2rad(amplitude) * w * np.cos(phase), abs=1e-10)
            assert motion.alpha[inside] == pytest.approx(-np.deg2rad(amplitude) * w**2 * np.sin(phase), abs=1e-9)
    rests = (t < 1) | ((t > 1 + block - 0.5 + 1e-6) & (t < 1 + block - 1e-6)) | (t > 1 + 2 * block - 0.5 + 1e-6)
    assert not np.any(motion.theta[rests])
    assert np.max(np.abs(np.diff(motion.theta))) < 1.01 * np.deg2rad(5) * 2 * np.pi * 3 / 1000, "no jumps"


def schedule(**changes):
    plain = {"frequencies_hz": (1, 3), "cycles": 4, "amplitudes_deg": (2,), "rest_s": 0.5, "lead_s": 1.0}
    return SteppedSineSchedule.model_validate(plain | changes)


def effect(size, unit):
    return {"enabled": True, "size": size, "unit": unit}


def simpson_error(values, derivative, rate):
    """Largest mismatch between two-sample increments and Simpson's integral of the derivative."""
    integral = (derivative[:-2] + 4 * derivative[1:-1] + derivative[2:]) / (3 * rate)
    return np.max(np.abs(values[2:] - values[:-2] - integral))


@pytest.mark.parametrize(
    ("changes", "largest"),
    [({"decay": effect(0.3, "1/s")}, 1e-9), ({"third_harmonic": effect(0.05, "1"), "ramp_s": 0.4}, 2e-3)],
)
def test_every_motion_comes_with_its_true_derivatives(changes, largest):
    """Simpson's rule is exact to h^5/90 of the fourth derivative, and to 4 h of the kink that a ramp's end has."""
    motion = sine_command(schedule(frequencies_hz=(1,), rest_s=0, lead_s=0, **changes), 1000.0)
    theta, omega, alpha = (signal[2:-2] for signal in (motion.theta, motion.omega, motion.alpha))
    assert simpson_error(theta, omega, 1000) < largest
    assert simpson_error(omega, alpha, 1000) < largest


@pytest.mark.parametrize(
    ("changes", "duration"),
    [
        ({}, 1 + 4 + 4 / 3 + 0.5),
        ({"rest_between_s": 1.0}, 1 + 4 + 4 / 3 + 2 + 0.5),
        ({"ramp_s": 0.5}, 1 + 4 + 4 / 3 + 2 + 0.5),
        ({"cycles": None, "seconds": 2.0}, 1 + 4 + 0.5),
        ({"cycles": (2, 6)}, 1 + 2 + 2 + 0.5),
        ({"clock_error": effect(5000, "ppm")}, (1 + 4 + 4 / 3 + 0.5) / 1.005),
    ],
)
def test_a_schedule_lasts_as_long_as_it_says(changes, duration):
    assert len(sine_command(schedule(**changes), 1000.0).theta) == pytest.approx(1000 * duration, abs=1)


def test_frequencies_run_in_their_order_and_on_the_benchs_clock():
    motion = sine_command(schedule(frequencies_hz=(3, 1), clock_error=effect(-5000, "ppm"), start="cosine"), 1000.0)
    first = slice(1010, 2300)
    t = np.arange(len(motion.theta))[first] / 1000 - 1 / 0.995
    assert motion.theta[first] == pytest.approx(np.deg2rad(2) * np.cos(2 * np.pi * 3 * 0.995 * t), abs=1e-9)
    assert np.sum(np.diff(np.sign(motion.theta[1010:])) != 0) == pytest.approx(2 * 8, abs=2)


def test_cycles_and_seconds_are_not_both_stated():
    with pytest.raises(ValueError, match="either cycles or seconds"):
        schedule(seconds=2.0)
    with pytest.raises(ValueError, match="3 numbers of cycles for 2 frequencies"):
        schedule(cycles=(1, 2, 3))


def test_the_belt_motion_goes_there_and_back_with_true_derivatives():
    motion = there_and_back(BeltMotion(amplitude_deg=5, ramp_s=2.0, rest_s=0.5), 1000.0)
    assert len(motion.theta) == 5000
    assert np.max(motion.theta) == motion.theta[2500] == pytest.approx(np.deg2rad(5))
    assert not np.any(motion.theta[:500])
    assert motion.theta[-500:] == pytest.approx(np.zeros(500), abs=1e-12)
    moving = slice(501, 4499)
    assert simpson_error(motion.theta[moving], motion.omega[moving], 1000) < 1e-12
    assert simpson_error(motion.omega[moving], motion.alpha[moving], 1000) < 1e-10


@pytest.mark.parametrize("frequency_hz", [1, 5, 30])
def test_the_dynamometer_follows_as_a_second_order_system(frequency_hz):
    rate, w, bandwidth = 2000.0, 2 * np.pi * frequency_hz, 2 * np.pi * 30
    t = np.arange(int(4 * rate)) / rate
    command = JointMotion(np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t))
    motion = position_loop(command, rate, 30.0, 0.9)
    settled = slice(int(2 * rate), None)
    phasor = 2j * np.mean(motion.theta[settled] * np.exp(-1j * w * t[settled]))
    expected = bandwidth**2 / (bandwidth**2 - w**2 + 2j * 0.9 * bandwidth * w)
    assert phasor == pytest.approx(expected, abs=1e-6)
    assert simpson_error(motion.theta[settled], motion.omega[settled], rate) < 1e-5 * w / rate
    assert simpson_error(motion.omega[settled], motion.alpha[settled], rate) < 1e-5 * w**2 / rate


def settled_rows(protocol, rate=1000.0, dropped=4):
    """Rows of the stepped sine without the first cycles of each frequency, where transients die out."""
    rows, start = [], protocol.lead_s
    for _ in protocol.amplitudes_deg:
        for f in protocol.frequencies_hz:
            end = start + protocol.cycles / f
            rows.append(np.arange(round((start + dropped / f) * rate), round(end * rate) - 2))
            start = end
        start += protocol.rest_s
    return np.concatenate(rows)


def fitted_impedance(log, protocol, rate=1000.0):
    """K, B, I of Eq. 15 from a log without noise, settled cycles, derivatives by fourth-order differences."""
    theta, torque, i = log["joint_angle"], -log["load_cell_torque"], settled_rows(protocol, rate)
    omega = (theta[i - 2] - 8 * theta[i - 1] + 8 * theta[i + 1] - theta[i + 2]) * rate / 12
    alpha = (-theta[i - 2] + 16 * theta[i - 1] - 30 * theta[i] + 16 * theta[i + 1] - theta[i + 2]) * rate**2 / 12
    return regress(torque[i], theta[i], omega, alpha, np.ones(len(i)))[:3]


@pytest.mark.parametrize(
    ("controller", "J_j", "expected"),
    [
        ("compensated", 0.0, (299.1, 5.46, 0.000)),
        ("uncompensated", 0.0, (209.7, 3.61, 0.093)),
        ("uncompensated", P.J_j, (209.7, 3.61, 0.093 + P.J_j)),
    ],
)
def test_without_effects_the_fit_of_eq_15_finds_what_linear_theory_and_the_design_page_say(controller, J_j, expected):
    settings, p = settings_from(DEFAULT, only=("dynamometer_bandwidth",)), replace(P, J_j=J_j)
    log, truth = simulate(f"impedance_K300_B5.0_{controller}", settings, p)
    K, B, I = fitted_impedance(log, settings.protocol)
    predicted = predicted_impedance(Gains(**truth["gains"]), p, settings.protocol.frequencies_hz)
    for reference in (expected, predicted):
        assert pytest.approx(reference[0], rel=1e-3) == K
        assert pytest.approx(reference[1], rel=3e-3) == B
        assert pytest.approx(reference[2], abs=1e-3) == I


def test_the_stiffest_undamped_impedance_is_stable_with_every_effect():
    settings = settings_from(DEFAULT)
    protocol = SteppedSineSchedule(frequencies_hz=(1,), cycles=20, amplitudes_deg=(6,), rest_s=0, lead_s=0)
    log, _ = simulate("impedance_K400_B0.0_compensated", settings.model_copy(update={"protocol": protocol}))
    assert np.max(np.abs(log["load_cell_torque"])) < 1.2 * 400 * np.deg2rad(6)


def test_the_belt_trial_loads_the_belt_by_its_own_stiffness_with_the_actuator_locked():
    settings = settings_from(TINY, only=("belt_scatter", "dynamometer_bandwidth"))
    stiffness = []
    for trial in ("belt_01", "belt_02"):
        log, truth = simulate(trial, settings)
        loading = slice(600, 1400)
        omega = np.gradient(log["joint_angle"], 1e-3)[loading]
        slope, _ = regress(-log["load_cell_torque"][loading] - P.B_j * omega, log["joint_angle"][loading], np.ones(800))
        assert slope == pytest.approx(truth["parameters"]["K_s"], rel=1e-4)
        assert not np.any(log["actuator_angle"])
        stiffness.append(slope)
    assert 1e-4 < abs(stiffness[0] / stiffness[1] - 1) < 0.06


def test_the_transmission_trial_shows_damping_and_inertia_only():
    settings = settings_from(DEFAULT, only=("dynamometer_bandwidth",))
    log, _ = simulate("transmission_1", settings)
    K, B, I = fitted_impedance(log, settings.protocol)
    assert (B, I) == (pytest.approx(P.B_j, rel=1e-4), pytest.approx(P.J_j, rel=1e-3))
    assert pytest.approx(0, abs=1e-3) == K
    assert not np.any(log["actuator_angle"])
    assert not np.any(log["motor_current"])


def test_each_sensor_effect_adds_what_the_truth_says_and_leaves_the_other_draws_alone():
    names = ("load_cell_offset", "load_cell_drift", "load_cell_noise")
    clean = simulate("belt_01", settings_from(TINY, only=()))[0]["load_cell_torque"]
    all_on, truth = simulate("belt_01", settings_from(TINY, only=names))
    parts = {
        name: simulate("belt_01", settings_from(TINY, only=(name,)))[0]["load_cell_torque"] - clean for name in names
    }
    assert all_on["load_cell_torque"] - clean == pytest.approx(sum(parts.values()), abs=1e-10)
    elapsed = all_on["time"] - all_on["time"][0]
    assert parts["load_cell_offset"] == pytest.approx(np.full(3000, truth["drawn"]["load_cell_offset"]), abs=1e-10)
    assert parts["load_cell_drift"] == pytest.approx(truth["drawn"]["load_cell_drift"] * elapsed / 60, abs=1e-10)
    sizes = [truth["drawn"][name] / truth["effects"][name]["size"] for name in names[:2]]
    assert sizes[0] != pytest.approx(sizes[1]), "each effect draws from a stream of its own"
    assert np.std(parts["load_cell_noise"]) == pytest.approx(0.05, rel=4 / np.sqrt(2 * 3000))


def test_a_trial_simulated_alone_is_the_campaigns(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    simulate_campaign(TINY, tmp_path / "all")
    simulate_trial(TINY, tmp_path / "one", "impedance_K300_B5.0_compensated")
    written = sorted(str(f.relative_to(tmp_path / "one")) for f in (tmp_path / "one").rglob("*.*"))
    assert written == [
        "dynamometer/impedance_K300_B5.0_compensated.mcap",
        "truth/impedance_K300_B5.0_compensated.json",
    ]
    for name in written:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "all" / name).read_bytes()
    assert len(list((tmp_path / "all" / "dynamometer").iterdir())) == 5
    assert (tmp_path / "all" / "trials.csv").is_file()


SMOOTH = ("multisine", "chirp", "noise", "hand")


def made(kind, **fields):
    settings = {"name": "x", "kind": kind, "rms_deg": 2.0, "duration_s": 20.0, "period_s": 4.0, "periods": 3} | fields
    excitation = Excitation.model_validate(settings)
    return excitation, excitation_motion(excitation, "trial_x_1", 3, 1000.0)


@pytest.mark.parametrize("kind", SMOOTH)
def test_velocity_and_acceleration_are_the_derivatives_of_the_angle(kind):
    _, motion = made(kind)
    for signal, derivative in ((motion.theta, motion.omega), (motion.omega, motion.alpha)):
        error = np.gradient(signal) * 1000 - derivative
        assert np.std(error[100:-100]) < 2e-3 * np.std(derivative)


@pytest.mark.parametrize("kind", [*SMOOTH, "prbs", "ramps"])
def test_a_motion_has_its_length_its_size_and_rests_at_both_ends(kind):
    excitation, motion = made(kind)
    assert len(motion.theta) == pytest.approx(excitation.total_s * 1000, abs=4)
    rest = round(excitation.rest_s * 1000.0)
    assert not motion.theta[:rest].any()
    assert not motion.theta[-rest:].any()
    full = slice(rest + 1500, -rest - 1500)
    assert np.rad2deg(np.std(motion.theta[full])) == pytest.approx(2.0, rel=0.25)


def test_a_multisine_repeats_itself_and_its_realisations_have_the_same_lines_and_other_phases():
    _, motion = made("multisine", realisations=2)
    start, period = 2500, 4000
    one, again = motion.theta[start : start + period], motion.theta[start + period : start + 2 * period]
    np.testing.assert_allclose(one, again, atol=1e-9)
    second = start + 12000 + 2000 + 1500
    other = motion.theta[second : second + period]
    sizes = [np.abs(np.fft.rfft(x))[:40] / period for x in (one, other)]
    np.testing.assert_allclose(*sizes, atol=1e-6)
    assert np.abs(one - other).max() > 0.02
    assert not (sizes[0][::2] > 1e-6).any()


def test_noise_and_sweep_stay_within_their_band():
    for kind in ("noise", "chirp"):
        _, motion = made(kind, band_hz=(1.0, 4.0))
        power = np.abs(np.fft.rfft(motion.theta)) ** 2
        f = np.fft.rfftfreq(len(motion.theta), 1 / 1000.0)
        assert power[(f > 0.8) & (f < 4.3)].sum() > 0.98 * power.sum()


def test_the_motion_goes_to_both_ends_at_each_speed_and_comes_back_to_rest():
    cycles = SlowCycles.model_validate(CYCLES)
    motion = slow_cycles(cycles, 500)
    degrees, speed = np.rad2deg(motion.theta), np.rad2deg(np.abs(motion.omega))
    assert motion.theta.size / 500 == pytest.approx(cycles.total_s) == pytest.approx(2 + 40 / 4 + 40 / 8)
    assert (degrees.min(), degrees.max()) == pytest.approx((-10, 10), abs=0.25)  # a tenth of a second at 4 deg/s
    assert degrees[-400:] == pytest.approx(0, abs=1e-9)
    assert {4, 8} <= set(speed.round(9))
    np.testing.assert_allclose(np.diff(motion.theta), (motion.omega[1:] + motion.omega[:-1]) / 1000, atol=1e-12)


def test_a_spring_that_never_slips_is_refused():
    with pytest.raises(ValueError, match="does not reach its limit of 90 N"):
        PassiveFoot.model_validate({"K": 100, "slipping": [{"stiffness": 500, "limit": 90}], "cycles": CYCLES})


def test_torque_angle_trials_without_a_foot_are_refused():
    with pytest.raises(ValueError, match="3 torque-angle trials are planned but there is no 'foot'"):
        SimulationSettings.model_validate(SETTINGS.model_dump() | {"foot": None})


def test_the_analysis_finds_the_springs_of_the_foot_and_what_each_cycle_loses():
    row = next(iter(plan_trials(SETTINGS).values()))
    log, truth = simulate_bench_trial(row, SETTINGS, read_parameters(SETTINGS.parameters))
    columns = {"time": log["time"] - log["time"][0], "theta": log["joint_angle"], "torque": -log["load_cell_torque"]}
    campaign = read_config(ROOT / "config/campaigns/torque_angle/config.yaml")
    found = torque_angle_trial(Trial("foot", pl.DataFrame(columns)), campaign.torque_angle)
    cycles, foot = cycle_table(found), SETTINGS.foot
    assert foot is not None
    assert truth["foot"] == foot.model_dump()
    assert cycles["speed_deg_s"].to_list() == pytest.approx([3, 4, 5], rel=0.03)  # the turns are slower
    for cycle, lost in zip(found.cycles, cycles["energy_lost"], strict=True):
        half = np.ptp(found.theta[cycle[0] : cycle[-1] + 1]) / 2
        assert lost == pytest.approx(sum(4 * s.limit * (half - s.limit / s.stiffness) for s in foot.slipping), rel=0.01)
    table = torque_angle_table(found).to_dicts()[0]
    assert table["K_lowest"] == pytest.approx(foot.K, rel=0.01)  # at rest, where both springs slip
    assert table["rate_change"] == pytest.approx(0, abs=0.05)
    assert abs(table["cycle_drift"]) < 0.005
