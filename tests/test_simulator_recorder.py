"""Each imperfection of recorders, sensors, joint and motion has the stated size in the written log, by numpy alone."""

import json

import numpy as np
import pytest
import yaml
from conftest import ROOT
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from scipy.interpolate import CubicSpline

from osl_analysis.commands.simulate import simulate_trial
from osl_analysis.errors import InputError
from osl_analysis.simulator.recorder import Bench
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.yaml_settings import read_yaml

TRIAL = "impedance_K300_B5.0_compensated"
JOINT = {"K": 300, "B": 5, "I": 0.02}
EXACT = {"recorder": {}, "joint": JOINT}
"""A joint that is exactly Eq. 15, and everything else off."""


def effect(size, unit, **more):
    return {"enabled": True, "size": size, "unit": unit, **more}


def written(tmp_path, changes, trial=TRIAL, rate=1000):
    """The log of a trial with no imperfection but `changes`, as columns by name, and its truth."""
    content = yaml.safe_load((ROOT / "tests/tiny_simulation.yaml").read_text())
    for entry in content["effects"].values():
        entry["enabled"] = False
    content["effects"]["dynamometer_bandwidth"]["enabled"] = True
    content["dynamometer"]["rate_hz"] = rate
    for section, values in (EXACT | changes).items():
        content[section] = content[section] | values if section in ("effects", "protocol", "experiments") else values
    content["parameters"] = str(ROOT / content["parameters"])
    (tmp_path / "settings.yaml").write_text(yaml.safe_dump(content))
    simulate_trial(tmp_path / "settings.yaml", tmp_path, trial)
    path = next(tmp_path.rglob(f"{trial}.mcap"))
    with path.open("rb") as file:
        messages = list(make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages())
    topics = {channel.topic for _, channel, _, _ in messages}
    log = {topic: columns_of([m for _, c, _, m in messages if c.topic == topic]) for topic in topics}
    truth = json.loads((tmp_path / "truth" / f"{trial}.json").read_text())
    return (log.popitem()[1] if len(log) == 1 else log), truth


def columns_of(messages):
    """Stamps and scalar fields of one topic's messages, (n,) each."""
    time = np.array([m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in messages])
    if hasattr(messages[0], "wrench"):
        return {"time": time, "torque": np.array([m.wrench.torque.z for m in messages])}
    if hasattr(messages[0], "position"):
        assert {tuple(m.name) for m in messages} == {("joint", "actuator", "command")}
        return {"time": time, "effort": np.array([m.effort for m in messages])}
    names = [name for name in messages[0].__slots__ if name != "header"]
    return {"time": time} | {name: np.array([getattr(m, name) for m in messages]) for name in names}


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    return written(tmp_path_factory.mktemp("clean"), {})[0]


def node(**changes):
    return {"recorder": {"node": changes}}


def torque_sensor(**changes):
    return {"recorder": {"sensors": {"load_cell_torque": changes}}}


def at(log, clean, name="joint_angle"):
    """The clean log's channel, to 1e-9 of a sine by a cubic spline, at the other log's stamps."""
    return CubicSpline(clean["time"], clean[name])(log["time"])


def settled(log):
    """Rows well inside the motion."""
    elapsed = log["time"] - log["time"][0]
    return (elapsed > 1.0) & (elapsed < elapsed[-1] - 1.2)


def test_an_exact_joint_answers_by_eq_15(tmp_path):
    log, truth = written(tmp_path, {})
    for f, rows in ((2, slice(1000, 2000)), (5, slice(2200, 2600))):
        kernel = np.exp(-2j * np.pi * f * log["time"][rows])
        w, ratio = 2 * np.pi * f, -(log["load_cell_torque"][rows] @ kernel) / (log["joint_angle"][rows] @ kernel)
        assert ratio == pytest.approx(300 - 0.02 * w**2 + 5j * w, rel=1e-4)  # the servo's transient is left
    assert truth["joint"]["K"] == 300


def test_true_jitter_scatters_the_instants_and_leaves_the_samples_true(tmp_path, clean):
    log, _ = written(tmp_path, node(jitter=effect(20e-6, "s", distribution="normal")))
    count = np.arange(len(log["time"]))
    residual = log["time"] - np.polynomial.Polynomial.fit(count, log["time"], 1)(count)
    assert np.std(residual) == pytest.approx(20e-6, rel=4 / np.sqrt(2 * len(residual)))
    # single precision of the log: 6e-8 of 0.07 rad
    assert log["joint_angle"] == pytest.approx(at(log, clean), abs=1e-8)


def test_no_sample_is_taken_before_or_after_the_simulated_motion():
    """A hundred samples that scatter by ten steps: a third would be outside, were there nothing to hold them."""
    settings = read_yaml(ROOT / "config/simulation/default.yaml", SimulationSettings)
    node = settings.recorder.node
    wide = node.model_copy(update={"jitter": node.jitter.model_copy(update={"size": 0.01})})
    instants, _, _ = Bench("trial", settings, {}, 100).sampling("node", wide)
    assert 0 <= instants.min() < 0.01
    assert 0.09 < instants.max() <= 0.099
    assert len(instants) < 100


@pytest.mark.parametrize(("distribution", "mean"), [("exponential", 2e-4), ("half_normal", 2e-4 * np.sqrt(2 / np.pi))])
def test_host_latency_scatters_the_stamps_and_leaves_the_device_even(tmp_path, clean, distribution, mean):
    log, _ = written(tmp_path, node(latency=effect(2e-4, "s", distribution=distribution)))
    np.testing.assert_array_equal(log["joint_angle"], clean["joint_angle"])
    late = log["time"] - clean["time"]
    assert late.min() >= -1e-9
    # a message waits for the one before it, in one of 150 of exponential latencies
    assert late.mean() == pytest.approx(mean, rel=0.1)
    assert np.all(np.diff(log["time"]) > 0)


@pytest.mark.parametrize("decimals", [3, 4])
def test_stamps_are_printed_with_so_many_decimals(tmp_path, decimals):
    clean, _ = written(tmp_path, {}, rate=300)
    log, _ = written(tmp_path, node(decimals=effect(decimals, "decimal")), rate=300)
    assert log["time"] * 10**decimals == pytest.approx(np.rint(log["time"] * 10**decimals), abs=1e-4)
    assert np.abs(log["time"] - clean["time"]).max() <= 0.5001 * 10**-decimals
    np.testing.assert_array_equal(log["joint_angle"], clean["joint_angle"])


def test_two_nodes_write_standard_messages_with_stamps_and_rates_of_their_own(tmp_path, clean):
    later = {"phase": effect(3e-4, "s"), "rate": effect(333, "Hz")}
    log, _ = written(tmp_path, {"recorder": {"torque_node": later}})
    joint, wrench = log["/joint_states"], log["/wrench"]
    np.testing.assert_allclose(joint["time"], clean["time"], rtol=0, atol=1e-9)
    assert wrench["time"][0] - joint["time"][0] == pytest.approx(3e-4, abs=1e-9)
    assert np.diff(wrench["time"]).mean() == pytest.approx(1 / 333, rel=1e-6)
    rows = settled(wrench)
    assert wrench["torque"][rows] == pytest.approx(at(wrench, clean, "load_cell_torque")[rows], abs=1e-4)
    assert not np.any(joint["effort"])


def test_a_nodes_clock_has_an_offset_and_a_drift(tmp_path):
    clock = {"clock_offset": effect(0.25, "s"), "clock_drift": effect(-50, "ppm")}
    log, truth = written(tmp_path, {"recorder": {"torque_node": clock}})
    own, bench = log["/wrench"]["time"] - truth["drawn"]["clock_start_s"], log["/joint_states"]["time"]
    elapsed = bench - bench[0]
    assert own == pytest.approx(0.25 + (1 - 50e-6) * elapsed, abs=2e-9)


def test_samples_are_dropped_singly_or_in_bursts_and_written_twice(tmp_path, clean):
    n = len(clean["time"])
    single, _ = written(tmp_path, node(dropped=effect(1e-3, "1")))
    assert n - len(single["time"]) == round(1e-3 * n)
    burst, _ = written(tmp_path, node(dropped=effect(0.02, "1"), burst=effect(20, "sample")))
    gaps = np.rint(np.diff(burst["time"]) * 1000).astype(int) - 1
    assert set(gaps) == {0, 20}
    assert gaps.sum() == 20 * round(0.02 * n / 20)
    twice, _ = written(tmp_path, node(duplicated=effect(0.01, "1")))
    again = np.diff(twice["time"]) == 0
    assert again.sum() == len(twice["time"]) - n == pytest.approx(0.01 * n, abs=4 * np.sqrt(0.01 * n))
    assert np.all(np.diff(twice["joint_angle"])[again] == 0)


def test_encoders_and_converters_have_bits(tmp_path):
    sensors = {"load_cell_torque": {"clipping": effect(50, "N*m"), "adc": effect(10, "bit")}}
    log, _ = written(tmp_path, {"effects": {"joint_encoder": effect(14, "bit")}, "recorder": {"sensors": sensors}})
    for values, step in ((log["joint_angle"], 2 * np.pi / 2**14), (log["load_cell_torque"], 100 / 2**10)):
        assert values / step == pytest.approx(np.rint(values / step), abs=2e-4)  # single precision
        assert np.diff(np.unique(np.rint(values / step))).min() == 1


def test_the_encoders_zero_stands_anywhere_between_its_steps(tmp_path, clean):
    zero = {"effects": {"joint_encoder": effect(14, "bit"), "encoder_zero": effect(0.5, "step")}}
    log, truth = written(tmp_path, zero)
    step = 2 * np.pi / 2**14
    assert 0 < abs(truth["drawn"]["encoder_zero"]) < step / 2
    expected = np.rint((clean["joint_angle"] + truth["drawn"]["encoder_zero"]) / step) * step
    assert np.mean(np.abs(log["joint_angle"] - expected) < 1e-7) > 0.999


def test_a_delayed_channel_shows_what_was(tmp_path, clean):
    log, _ = written(tmp_path, torque_sensor(delay=effect(2e-3, "s")))
    assert log["load_cell_torque"][2:] == pytest.approx(clean["load_cell_torque"][:-2], abs=1e-5)
    np.testing.assert_array_equal(log["joint_angle"], clean["joint_angle"])


@pytest.mark.parametrize("order", [1, 2])
def test_a_sensors_low_pass_weakens_and_delays_a_sine_as_butterworths_does(tmp_path, order):
    protocol = {"frequencies_hz": [5], "cycles": 10}
    clean, _ = written(tmp_path, {"protocol": protocol})
    slow = torque_sensor(low_pass=effect(30, "Hz", order=order))
    log, _ = written(tmp_path, {"protocol": protocol} | slow)
    rows = slice(1500, 2300)  # four cycles
    kernel = np.exp(-2j * np.pi * 5 * np.arange(800) / 1000)
    ratio = (log["load_cell_torque"][rows] @ kernel) / (clean["load_cell_torque"][rows] @ kernel)
    s = 5j / 30
    expected = 1 / (1 + s) if order == 1 else 1 / (1 + np.sqrt(2) * s + s**2)
    assert ratio == pytest.approx(expected, abs=1e-5)


def test_a_load_cell_clips_and_a_recorder_takes_a_wrong_unit(tmp_path, clean):
    clipped, _ = written(tmp_path, torque_sensor(clipping=effect(15, "N*m")))
    assert clipped["load_cell_torque"] == pytest.approx(np.clip(clean["load_cell_torque"], -15, 15), abs=1e-5)
    wrong, _ = written(tmp_path, torque_sensor(gain=effect(-4.45, "1")))
    assert wrong["load_cell_torque"] == pytest.approx(-4.45 * clean["load_cell_torque"], rel=1e-6, abs=1e-5)


def test_the_frame_yields_to_the_torque(tmp_path, clean):
    log, _ = written(tmp_path, {"effects": {"mount_stiffness": effect(3000, "N*m/rad")}})
    extra = log["joint_angle"] - clean["joint_angle"]
    assert extra == pytest.approx(-clean["load_cell_torque"] / 3000, abs=1e-7)


def test_a_spring_stiffens_and_coulomb_friction_turns_with_the_velocity(tmp_path, clean):
    theta = clean["joint_angle"]
    stiff, _ = written(tmp_path, {"joint": JOINT | {"stiffening": effect(18.2, "1/rad^2")}})
    extra = clean["load_cell_torque"] - stiff["load_cell_torque"]
    assert extra == pytest.approx(300 * 18.2 * theta**3, abs=1e-4)
    rubbing, _ = written(tmp_path, {"joint": JOINT | {"coulomb": effect(3, "N*m")}})
    omega, rows = np.gradient(theta, 1e-3), settled(clean)
    moving = rows & (np.abs(omega) > 0.02)
    extra = clean["load_cell_torque"] - rubbing["load_cell_torque"]
    assert extra[moving] == pytest.approx(3 * np.sign(omega[moving]), abs=1e-4)


def test_backlash_takes_the_gap_from_the_angle_at_which_the_joint_pushes_back(tmp_path):
    """In slow motion the joint has followed: the torque is that of the angle less half the gap, or nothing."""
    gap = float(np.deg2rad(1.0))
    slow = {"protocol": {"frequencies_hz": [0.5], "cycles": 2}, "joint": JOINT | {"backlash": effect(gap, "rad")}}
    log, _ = written(tmp_path, slow)
    theta, torque = log["joint_angle"], -log["load_cell_torque"]
    omega = np.gradient(theta, 1e-3)
    pushing = torque != 0
    away = (np.abs(theta) > 1.5 * gap) & settled(log)
    assert np.all(pushing[away])
    expected = 300 * (theta - np.sign(theta) * gap / 2) + 5 * omega
    assert torque[away] == pytest.approx(expected[away], abs=0.02 * (2 * np.pi * 0.5) ** 2 * 0.08)
    free = settled(log) & ~pushing
    assert np.abs(theta[free]).max() < 0.75 * gap
    assert free.sum() > 100, "it passes the gap freely"


def test_hum_and_1_over_f_noise_have_their_spectra(tmp_path, clean):
    hum, _ = written(tmp_path, {"effects": {"load_cell_hum": effect(0.3, "N*m", frequency_hz=50)}})
    extra = hum["load_cell_torque"] - clean["load_cell_torque"]
    whole = len(extra) // 20 * 20
    line = 2 * np.abs(extra[:whole] @ np.exp(-2j * np.pi * 50 * np.arange(whole) / 1000)) / whole
    assert line == pytest.approx(0.3, rel=1e-4)
    assert np.std(extra[:whole]) == pytest.approx(0.3 / np.sqrt(2), rel=1e-3)
    pink, _ = written(tmp_path, {"effects": {"load_cell_flicker": effect(0.1, "N*m")}})
    extra = pink["load_cell_torque"] - clean["load_cell_torque"]
    power = 2 * np.abs(np.fft.rfft(extra)) ** 2 / len(extra) ** 2
    f = np.fft.rfftfreq(len(extra), 1e-3)
    for low in (5.0, 40.0):
        decade = power[(f >= low) & (f < 10 * low)]
        assert np.sqrt(decade.sum()) == pytest.approx(0.1, rel=0.25)  # fewer than 50 lines carry half of it


def test_the_motion_has_harmonics_and_decays(tmp_path):
    still = {"effects": {"dynamometer_bandwidth": {"enabled": False, "size": 30, "unit": "Hz"}}}
    sine = {"frequencies_hz": [2], "cycles": 10, "amplitudes_deg": [4], "lead_s": 0, "rest_s": 0}
    harmonics = {"second_harmonic": effect(0.02, "1"), "third_harmonic": effect(0.05, "1")}
    log, _ = written(tmp_path, still | {"protocol": sine | harmonics})
    t = np.arange(5000) / 1000
    sizes = [2 * np.abs(log["joint_angle"] @ np.exp(-4j * np.pi * k * t)) / 5000 for k in (1, 2, 3)]
    assert np.array(sizes) == pytest.approx(np.deg2rad(4) * np.array([1, 0.02, 0.05]), abs=1e-7)
    log, _ = written(tmp_path, still | {"protocol": sine | {"decay": effect(0.1, "1/s")}})
    expected = np.deg2rad(4) * np.exp(-0.1 * t) * np.sin(4 * np.pi * t)
    assert log["joint_angle"] == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize(
    ("section", "value", "match"),
    [
        ("recorder", {"node": {"jitter": effect(20, "us")}}, "unit must be 's'"),
        ("recorder", {"node": {"latency": effect(1e-4, "s", distribution="normal")}}, "latency is never negative"),
        ("recorder", {"node": {"dropped": effect(1.5, "1")}}, "less than 1"),
        ("recorder", {"sensors": {"load_cell_torque": {"adc": effect(12, "bit")}}}, "enable clipping"),
        ("recorder", {"sensors": {"torque": {}}}, "joint_angle"),
        ("joint", JOINT | {"I": 0, "backlash": effect(1e-3, "rad")}, "inertia"),
    ],
)
def test_a_wrong_imperfection_is_refused_with_its_place(tmp_path, section, value, match):
    content = yaml.safe_load((ROOT / "tests/tiny_simulation.yaml").read_text())
    content[section] = value
    (tmp_path / "settings.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match=f"{section}.*{match}"):
        read_yaml(tmp_path / "settings.yaml", SimulationSettings)


def test_samples_are_lost_at_nearly_regular_intervals(tmp_path):
    every = {"enabled": True, "size": 100, "unit": "sample", "scatter": 3}
    log, _ = written(tmp_path, node(lost_every=every, burst=effect(5, "sample")))
    step = np.round(np.diff(log["time"]) * 1000).astype(int)
    assert set(step) == {1, 6}
    between = np.diff(np.flatnonzero(step == 6)) + 5
    assert (between.min(), between.max()) == (97, 103)


def test_failed_readings_are_nan_in_the_log(tmp_path):
    log, _ = written(tmp_path, torque_sensor(failed=effect(0.01, "1")))
    failed = np.isnan(log["load_cell_torque"])
    assert failed.mean() == pytest.approx(0.01, rel=0.5)
    assert not np.isnan(log["joint_angle"]).any()


def test_without_a_compiler_nothing_is_simulated_and_one_line_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr("osl_analysis.compiled.numba", None)
    with pytest.raises(
        InputError, match=r"needs numba, which is not installed; pip install 'osl-analysis\[simulator\]'"
    ):
        simulate_trial(ROOT / "tests/tiny_simulation.yaml", tmp_path, "belt_01")
    assert list(tmp_path.iterdir()) == []
