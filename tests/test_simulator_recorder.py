"""Each imperfection of recorders, sensors, joint and motion has the stated size in the written log, by numpy alone."""

import json
from functools import partial

import numpy as np
import pytest
import yaml
from conftest import ROOT
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from scipy.interpolate import CubicSpline

from osl_analysis.commands.simulate import simulate_trial
from osl_analysis.errors import InputError
from osl_analysis.simulator.mcap_writer import sample_topic, write_topics
from osl_analysis.simulator.recorder import Bench
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.yaml_settings import read_yaml

TRIAL = "impedance_K300_B5.0_compensated"
JOINT = {"K": 300, "B": 5, "I": 0.02}  # exactly Eq. 15
TORQUE, ANGLE = "load_cell_torque", "joint_angle"


def on(size, unit, **more):
    return {"enabled": True, "size": size, "unit": unit, **more}


def node(**changes):
    return {"recorder": {"node": changes}}


def torque_sensor(**changes):
    return {"recorder": {"sensors": {TORQUE: changes}}}


def written(folder, changes, rate=1000):
    """The log of a trial with no imperfection but some, as columns by name."""
    content = yaml.safe_load((ROOT / "tests/tiny_simulation.yaml").read_text())
    for entry in content["effects"].values():
        entry["enabled"] = False
    content["effects"]["dynamometer_bandwidth"]["enabled"] = True
    content["dynamometer"]["rate_hz"] = rate
    for section, values in ({"recorder": {}, "joint": JOINT} | changes).items():
        content[section] = content[section] | values if section in ("effects", "protocol") else values
    content["parameters"] = str(ROOT / content["parameters"])
    (folder / "settings.yaml").write_text(yaml.safe_dump(content))
    simulate_trial(folder / "settings.yaml", folder, TRIAL)
    with next(folder.rglob("*.mcap")).open("rb") as file:
        messages = list(make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages())
    topics = {channel.topic for _, channel, _, _ in messages}
    log = {topic: columns_of([m for _, c, _, m in messages if c.topic == topic]) for topic in topics}
    return log.popitem()[1] if len(log) == 1 else log


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


@pytest.fixture
def truth(tmp_path):
    return lambda: json.loads((tmp_path / "truth" / f"{TRIAL}.json").read_text())


@pytest.fixture
def log_of(tmp_path):
    return partial(written, tmp_path)


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    return written(tmp_path_factory.mktemp("clean"), {})


def at(log, clean, name=ANGLE):
    """The clean log's channel, to 1e-9 of a sine by a cubic spline, at the other log's stamps."""
    return CubicSpline(clean["time"], clean[name])(log["time"])


def settled(log):
    """Rows well inside the motion."""
    elapsed = log["time"] - log["time"][0]
    return (elapsed > 1.0) & (elapsed < elapsed[-1] - 1.2)


def test_an_exact_joint_answers_by_eq_15(log_of, truth):
    clean = log_of({})
    for f, rows in ((2, slice(1000, 2000)), (5, slice(2200, 2600))):
        kernel = np.exp(-2j * np.pi * f * clean["time"][rows])
        w, ratio = 2 * np.pi * f, -(clean[TORQUE][rows] @ kernel) / (clean[ANGLE][rows] @ kernel)
        assert ratio == pytest.approx(300 - 0.02 * w**2 + 5j * w, rel=1e-4)  # the servo's transient is left
    assert truth()["joint"]["K"] == 300


def test_true_jitter_scatters_the_instants_and_leaves_the_samples_true(log_of, clean):
    log = log_of(node(jitter=on(20e-6, "s", distribution="normal")))
    count = np.arange(len(log["time"]))
    residual = log["time"] - np.polynomial.Polynomial.fit(count, log["time"], 1)(count)
    assert np.std(residual) == pytest.approx(20e-6, rel=4 / np.sqrt(2 * len(residual)))
    assert log[ANGLE] == pytest.approx(at(log, clean), abs=1e-8)  # single precision of the log: 6e-8 of 0.07 rad


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
def test_host_latency_scatters_the_stamps_and_leaves_the_device_even(log_of, clean, distribution, mean):
    log = log_of(node(latency=on(2e-4, "s", distribution=distribution)))
    np.testing.assert_array_equal(log[ANGLE], clean[ANGLE])
    late = log["time"] - clean["time"]
    assert late.min() >= -1e-9
    assert late.mean() == pytest.approx(mean, rel=0.1)  # of 150 exponential latencies one waits for that before it
    assert np.all(np.diff(log["time"]) > 0)


def test_stamps_are_printed_with_so_many_decimals(log_of):
    clean, log = log_of({}, rate=300), log_of(node(decimals=on(3, "decimal")), rate=300)
    assert log["time"] * 1e3 == pytest.approx(np.rint(log["time"] * 1e3), abs=1e-4)
    assert np.abs(log["time"] - clean["time"]).max() <= 0.5001e-3
    np.testing.assert_array_equal(log[ANGLE], clean[ANGLE])


def test_two_nodes_write_standard_messages_with_stamps_rates_and_clocks_of_their_own(log_of, clean, truth):
    log = log_of({"recorder": {"torque_node": {"phase": on(3e-4, "s"), "rate": on(333, "Hz")}}})
    joint, wrench = log["/joint_states"], log["/wrench"]
    np.testing.assert_allclose(joint["time"], clean["time"], rtol=0, atol=1e-9)
    assert wrench["time"][0] - joint["time"][0] == pytest.approx(3e-4, abs=1e-9)
    assert np.diff(wrench["time"]).mean() == pytest.approx(1 / 333, rel=1e-6)
    rows = settled(wrench)
    assert wrench["torque"][rows] == pytest.approx(at(wrench, clean, TORQUE)[rows], abs=1e-4)
    assert not np.any(joint["effort"])
    log = log_of({"recorder": {"torque_node": {"clock_offset": on(0.25, "s"), "clock_drift": on(-50, "ppm")}}})
    own, bench = log["/wrench"]["time"] - truth()["drawn"]["clock_start_s"], log["/joint_states"]["time"]
    assert own == pytest.approx(0.25 + (1 - 50e-6) * (bench - bench[0]), abs=2e-9)


def test_samples_are_dropped_singly_or_in_bursts_or_at_regular_intervals_and_written_twice(log_of, clean):
    def missing(**changes):
        return np.rint(np.diff(log_of(node(**changes))["time"]) * 1000).astype(int) - 1

    n = len(clean["time"])
    assert missing(dropped=on(1e-3, "1")).sum() == round(1e-3 * n)
    gaps = missing(dropped=on(0.02, "1"), burst=on(20, "sample"))
    assert (set(gaps), gaps.sum()) == ({0, 20}, 20 * round(0.02 * n / 20))
    gaps = missing(lost_every=on(100, "sample", scatter=3), burst=on(5, "sample"))
    between = np.diff(np.flatnonzero(gaps)) + 5
    assert (set(gaps), between.min(), between.max()) == ({0, 5}, 97, 103)
    twice = log_of(node(duplicated=on(0.01, "1")))
    again = np.diff(twice["time"]) == 0
    assert again.sum() == len(twice["time"]) - n == pytest.approx(0.01 * n, abs=4 * np.sqrt(0.01 * n))
    assert np.all(np.diff(twice[ANGLE])[again] == 0)


def test_encoders_and_converters_have_bits_and_an_encoders_zero_stands_between_its_steps(log_of, clean, truth):
    adc, encoder = torque_sensor(clipping=on(50, "N*m"), adc=on(10, "bit")), {"joint_encoder": on(14, "bit")}
    log, count = log_of({"effects": encoder} | adc), 2 * np.pi / 2**14
    for values, step in ((log[ANGLE], count), (log[TORQUE], 100 / 2**10)):
        assert values / step == pytest.approx(np.rint(values / step), abs=2e-4)  # single precision
        assert np.diff(np.unique(np.rint(values / step))).min() == 1
    moved = log_of({"effects": encoder | {"encoder_zero": on(0.5, "step")}})
    zero = truth()["drawn"]["encoder_zero"]
    assert 0 < abs(zero) < count / 2
    assert np.mean(np.abs(moved[ANGLE] - np.rint((clean[ANGLE] + zero) / count) * count) < 1e-7) > 0.999


@pytest.mark.parametrize("order", [1, 2])
def test_a_sensors_low_pass_weakens_and_delays_a_sine_as_butterworths_does(log_of, order):
    protocol = {"protocol": {"frequencies_hz": [5], "cycles": 10}}
    clean, log = log_of(protocol), log_of(protocol | torque_sensor(low_pass=on(30, "Hz", order=order)))
    kernel, rows = np.exp(-2j * np.pi * 5 * np.arange(800) / 1000), slice(1500, 2300)  # four cycles
    s = 5j / 30
    expected = 1 / (1 + s) if order == 1 else 1 / (1 + np.sqrt(2) * s + s**2)
    assert (log[TORQUE][rows] @ kernel) / (clean[TORQUE][rows] @ kernel) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize(
    ("changes", "channel", "expected", "within"),
    [
        (torque_sensor(delay=on(2e-3, "s")), TORQUE, lambda log: np.roll(log[TORQUE], 2), 1e-5),  # at rest at both ends
        (torque_sensor(clipping=on(15, "N*m")), TORQUE, lambda log: np.clip(log[TORQUE], -15, 15), 1e-5),
        (torque_sensor(gain=on(-4.45, "1")), TORQUE, lambda log: -4.45 * log[TORQUE], 2e-5),
        ({"effects": {"mount_stiffness": on(3e3, "N*m/rad")}}, ANGLE, lambda log: log[ANGLE] - log[TORQUE] / 3e3, 1e-7),
        ({"joint": JOINT | {"stiffening": on(18.2, "1/rad^2")}}, TORQUE,
         lambda log: log[TORQUE] - 300 * 18.2 * log[ANGLE] ** 3, 1e-4),
    ],
)  # fmt: skip
def test_a_sensor_a_frame_and_a_joint_change_one_channel_as_they_say(log_of, clean, changes, channel, expected, within):
    log, other = log_of(changes), ({TORQUE, ANGLE} - {channel}).pop()
    assert log[channel] == pytest.approx(expected(clean), abs=within)
    np.testing.assert_array_equal(log[other], clean[other])


def test_coulomb_friction_turns_with_the_velocity_and_failed_readings_are_nan(log_of, clean):
    log, omega = log_of({"joint": JOINT | {"coulomb": on(3, "N*m")}}), np.gradient(clean[ANGLE], 1e-3)
    moving = settled(clean) & (np.abs(omega) > 0.02)
    assert (clean[TORQUE] - log[TORQUE])[moving] == pytest.approx(3 * np.sign(omega[moving]), abs=1e-4)
    log = log_of(torque_sensor(failed=on(0.01, "1")))
    assert np.isnan(log[TORQUE]).mean() == pytest.approx(0.01, rel=0.5)
    assert not np.isnan(log[ANGLE]).any()


def test_backlash_takes_the_gap_from_the_angle_at_which_the_joint_pushes_back(log_of):
    """In slow motion the joint has followed: the torque is that of the angle less half the gap, or nothing."""
    gap = float(np.deg2rad(1.0))
    slow = {"protocol": {"frequencies_hz": [0.5], "cycles": 2}, "joint": JOINT | {"backlash": on(gap, "rad")}}
    log = log_of(slow)
    theta, torque = log[ANGLE], -log[TORQUE]
    pushing, away = torque != 0, (np.abs(theta) > 1.5 * gap) & settled(log)
    assert np.all(pushing[away])
    expected = 300 * (theta - np.sign(theta) * gap / 2) + 5 * np.gradient(theta, 1e-3)
    assert torque[away] == pytest.approx(expected[away], abs=0.02 * (2 * np.pi * 0.5) ** 2 * 0.08)
    free = settled(log) & ~pushing
    assert np.abs(theta[free]).max() < 0.75 * gap
    assert free.sum() > 100, "it passes the gap freely"


def test_hum_and_1_over_f_noise_have_their_spectra(log_of, clean):
    extra = log_of({"effects": {"load_cell_hum": on(0.3, "N*m", frequency_hz=50)}})[TORQUE] - clean[TORQUE]
    whole = extra[: len(extra) // 20 * 20]
    line = 2 * np.abs(whole @ np.exp(-2j * np.pi * 50 * np.arange(len(whole)) / 1000)) / len(whole)
    assert line == pytest.approx(0.3, rel=1e-4)
    assert np.std(whole) == pytest.approx(0.3 / np.sqrt(2), rel=1e-3)
    extra = log_of({"effects": {"load_cell_flicker": on(0.1, "N*m")}})[TORQUE] - clean[TORQUE]
    power, f = 2 * np.abs(np.fft.rfft(extra)) ** 2 / len(extra) ** 2, np.fft.rfftfreq(len(extra), 1e-3)
    for low in (5.0, 40.0):
        decade = power[(f >= low) & (f < 10 * low)]
        assert np.sqrt(decade.sum()) == pytest.approx(0.1, rel=0.25)  # fewer than 50 lines carry half of it


def test_the_motion_has_harmonics_and_decays(log_of):
    still = {"effects": {"dynamometer_bandwidth": {"enabled": False, "size": 30, "unit": "Hz"}}}
    sine = {"frequencies_hz": [2], "cycles": 10, "amplitudes_deg": [4], "lead_s": 0, "rest_s": 0}
    harmonics, t = {"second_harmonic": on(0.02, "1"), "third_harmonic": on(0.05, "1")}, np.arange(5000) / 1000
    log = log_of(still | {"protocol": sine | harmonics})
    sizes = [2 * np.abs(log[ANGLE] @ np.exp(-4j * np.pi * k * t)) / 5000 for k in (1, 2, 3)]
    assert np.array(sizes) == pytest.approx(np.deg2rad(4) * np.array([1, 0.02, 0.05]), abs=1e-7)
    log = log_of(still | {"protocol": sine | {"decay": on(0.1, "1/s")}})
    assert log[ANGLE] == pytest.approx(np.deg2rad(4) * np.exp(-0.1 * t) * np.sin(4 * np.pi * t), abs=1e-8)


CYCLES = {"lowest_deg": -10, "highest_deg": 10, "speed_deg_s": [4], "turn_s": 0.2, "rest_s": 1}
SLIPS = {"K": 100, "slipping": [{"stiffness": 500, "limit": 90}], "cycles": CYCLES}


@pytest.mark.parametrize(
    ("section", "value", "match"),
    [
        ("recorder", {"node": {"jitter": on(20, "us")}}, "unit must be 's'"),
        ("recorder", {"node": {"latency": on(1e-4, "s", distribution="normal")}}, "latency is never negative"),
        ("recorder", {"node": {"dropped": on(1.5, "1")}}, "less than 1"),
        ("recorder", {"node": {"rate": on(0, "Hz")}}, "must be positive; set enabled: false"),
        ("recorder", {"sensors": {TORQUE: {"adc": on(12, "bit")}}}, "enable clipping"),
        ("recorder", {"sensors": {"torque": {}}}, "joint_angle"),
        ("joint", JOINT | {"I": 0, "backlash": on(1e-3, "rad")}, "inertia"),
        ("protocol", {"seconds": 2.0}, "either cycles or seconds"),
        ("protocol", {"cycles": [1, 2, 3]}, "3 numbers of cycles for 2 frequencies"),
        ("excitations", [{"name": "x", "kind": "noise", "rms_deg": 1, "band_hz": [6, 2]}], "from 6 to 2 Hz; write"),
        ("foot", SLIPS, "does not reach its limit of 90 N"),
        ("experiments", {"torque_angle": 3}, "3 torque-angle trials are planned but there is no 'foot'"),
    ],
)
def test_a_wrong_imperfection_or_motion_is_refused(tmp_path, section, value, match):
    content = yaml.safe_load((ROOT / "tests/tiny_simulation.yaml").read_text())
    known = content.get(section)
    content[section] = known | value if isinstance(known, dict) and section != "recorder" else value
    (tmp_path / "settings.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match=match):
        read_yaml(tmp_path / "settings.yaml", SimulationSettings)


def test_without_a_compiler_nothing_is_simulated_and_one_line_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr("osl_analysis.compiled.numba", None)
    said = r"needs numba, which is not installed; pip install 'osl-analysis\[simulator\]'"
    with pytest.raises(InputError, match=said):
        simulate_trial(ROOT / "tests/tiny_simulation.yaml", tmp_path, "belt_01")
    assert list(tmp_path.iterdir()) == []


def write_mixed(path, n, frame_id="f"):
    t = np.arange(n)
    columns = {"flag": t % 2 == 0, "wide": np.sqrt(t), "level": t % 7, "narrow": np.sin(t)}
    fields = "bool flag\nfloat64 wide\nuint8 level\nfloat32 narrow # unit\n"
    write_topics(path, [sample_topic("/t", frame_id, fields, 3.0 + t, columns)])
    return columns


@pytest.mark.parametrize("frame_id", ["", "a", "ab", "abc", "abcd", "abcde", "abcdef", "abcdefg"])
def test_every_field_is_aligned_whatever_the_length_of_the_frame_id(tmp_path, frame_id):
    columns = write_mixed(tmp_path / "a.mcap", 5, frame_id)
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        ros = [message for *_, message in reader.iter_decoded_messages()]
    assert [m.header.frame_id for m in ros] == [frame_id] * 5
    assert [m.wide for m in ros] == columns["wide"].tolist()
    assert [m.narrow for m in ros] == columns["narrow"].astype(np.float32).tolist()
    assert [m.flag for m in ros] == columns["flag"].tolist()
    assert [m.level for m in ros] == columns["level"].tolist()


def test_a_recording_that_breaks_off_leaves_the_older_file(tmp_path, monkeypatch):
    path = tmp_path / "a.mcap"
    write_mixed(path, 5)
    before = path.read_bytes()

    def fail(*_):
        raise OSError("no space left on device")

    monkeypatch.setattr("mcap.writer.Writer.finish", fail)
    with pytest.raises(InputError, match=r"a\.mcap: cannot be written \(no space left on device\); make room"):
        write_mixed(path, 9)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
