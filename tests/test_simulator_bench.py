"""The simulated bench: its motions, its experiments, each imperfection with its stated size, and
the written log."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from conftest import ROOT
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory
from scipy.interpolate import CubicSpline

from osl_analysis.commands.simulate import row_of_trial, simulate_campaign, simulate_trial
from osl_analysis.errors import InputError
from osl_analysis.model.compensator import (
    Weight,
    compensated_gains,
    uncompensated_gains,
)
from osl_analysis.model.drivetrain import read_parameters
from osl_analysis.model.rendered_impedance import predicted_impedance
from osl_analysis.simulator import joint_motion
from osl_analysis.simulator import simulation_settings as settings
from osl_analysis.simulator.bench_trial import (
    drivetrain_effects,
    simulate_bench_trial,
    true_signals,
    write_bench_log,
)
from osl_analysis.simulator.joint_motion import JointMotion
from osl_analysis.simulator.mcap_log import joint_states, wrenches, write_topics
from osl_analysis.simulator.recorder import Bench
from osl_analysis.simulator.simulation_settings import SimulationSettings
from osl_analysis.yaml_settings import read_yaml

DEFAULT, TINY = ROOT / "config/simulation/default.yaml", ROOT / "tests/tiny_simulation.yaml"
P, RATE = read_parameters(ROOT / "config/parameters/default.yaml"), 1000.0
TRIAL, JOINT = "impedance_K300_B5.0_compensated", {"K": 300, "B": 5, "I": 0.02}  # exactly Eq. 15
TORQUE, ANGLE = "load_cell_torque", "joint_angle"


def on(size, unit, **more):
    return {"enabled": True, "size": size, "unit": unit, **more}


def node(**changes):
    return {"recorder": {"node": changes}}


def only(changes, file=TINY):
    """Settings of a campaign with an exact joint and no imperfection but some."""
    content = yaml.safe_load(file.read_text())
    for name, entry in content["effects"].items():
        entry["enabled"] = name == "dynamometer_bandwidth"
    for section, values in ({"recorder": {}, "joint": JOINT} | changes).items():
        content[section] = (
            content[section] | values
            if section in ("effects", "protocol", "dynamometer")
            else values
        )
    return SimulationSettings.model_validate(content)


def simulated(changes, trial=TRIAL):
    """Log and truth of a trial."""
    made = only(changes)
    return simulate_bench_trial(row_of_trial(made, Path("settings.yaml"), trial), made, P)


def log_of(changes):
    return simulated(changes)[0]


@pytest.fixture(scope="module")
def clean():
    return log_of({})


def settled(time):
    """Rows well inside the motion."""
    return (time - time[0] > 1.0) & (time < time[-1] - 1.2)


def stepped(**changes):
    plain = {
        "frequencies_hz": (1, 3),
        "cycles": 4,
        "amplitudes_deg": (2,),
        "rest_s": 0.5,
        "lead_s": 1.0,
    }
    return joint_motion.sine_command(
        settings.SteppedSineSchedule.model_validate(plain | changes), RATE
    )


def excited(kind, seed=3, **fields):
    plain = {
        "name": "x",
        "kind": kind,
        "rms_deg": 2.0,
        "duration_s": 20.0,
        "period_s": 4.0,
        "periods": 3,
    }
    return joint_motion.excitation_motion(
        settings.Excitation.model_validate(plain | fields), "trial_x_1", seed, RATE
    )


SMOOTH, BELT = (
    ("multisine", "chirp", "noise", "hand"),
    settings.BeltMotion(amplitude_deg=5, ramp_s=2.0, rest_s=0.5),
)
PLAIN = {"frequencies_hz": (1,), "rest_s": 0, "lead_s": 0}


@pytest.mark.parametrize(("motion", "largest"), [
    (stepped(**PLAIN, ramp_s=0.4), 2e-4),
    (JointMotion(*(one[501:4499] for one in vars(joint_motion.there_and_back(BELT,
     RATE)).values())), 1e-12),
    (joint_motion.actuator_command(read_yaml(DEFAULT, SimulationSettings).actuator, RATE)[0], 1e-5),
    *((excited(kind), 1e-5) for kind in SMOOTH),
    # a sweep so fast that its own part of the acceleration shows
    (excited("chirp", duration_s=3.0, band_hz=(0.1, 4.0)), 1e-5),
])  # fmt: skip
def test_every_motion_comes_with_its_true_derivatives(motion, largest):
    """Simpson's rule is exact to h^5/90 of the fourth derivative, and to 4 h of the kink that a
    ramp's end has."""
    for signal, slope in ((motion.theta, motion.omega), (motion.omega, motion.alpha)):
        integral = (slope[2:-4] + 4 * slope[3:-3] + slope[4:-2]) / (3 * RATE)
        assert np.max(np.abs(signal[4:-2] - signal[2:-4] - integral)) < largest * np.ptp(slope)


@pytest.mark.parametrize(("changes", "duration"), [
    ({"ramp_s": 0.5}, 1 + 4 + 4 / 3 + 2 + 0.5), ({"cycles": None, "seconds": 2.0}, 1 + 4 + 0.5),
    ({"cycles": (2, 6)}, 1 + 2 + 2 + 0.5),
])  # fmt: skip
def test_a_schedule_lasts_as_long_as_it_says(changes, duration):
    assert len(stepped(**changes).theta) == pytest.approx(RATE * duration, abs=1)


@pytest.mark.parametrize("kind", [*SMOOTH, "prbs", "ramps"])
def test_an_excitation_has_its_length_its_size_its_band_and_rests_at_both_ends(kind):
    theta, other = (excited(kind, seed, band_hz=(1.0, 4.0), clock_s=0.125).theta for seed in (3, 4))
    assert np.abs(theta - other).max() > 0.01
    assert (
        kind != "prbs"
        or np.gcd.reduce(np.diff(np.flatnonzero(np.diff(np.sign(theta[3000:-3000]))))) == 125
    )
    # 5 s of rests and fades
    assert len(theta) == pytest.approx((17 if kind == "multisine" else 25) * RATE, abs=4)
    assert not np.append(theta[:1500], theta[-1500:]).any()
    assert np.rad2deg(np.std(theta[3000:-3000])) == pytest.approx(2.0, rel=0.25)
    power, f = np.abs(np.fft.rfft(theta)) ** 2, np.fft.rfftfreq(len(theta), 1 / RATE)
    assert (
        kind in ("hand", "prbs", "ramps") or power[(f > 0.8) & (f < 4.3)].sum() > 0.98 * power.sum()
    )
    assert kind != "hand" or power[f < 2].sum() > 0.6 * power.sum(), "slow motions are the larger"
    assert kind != "hand" or power[f < 0.85].sum() > 5e-3 * power.sum(), "its size wanders"
    turns = [
        np.count_nonzero(np.diff(np.sign(half)))
        for half in (theta[: len(theta) // 2], theta[len(theta) // 2 :])
    ]
    assert kind != "chirp" or turns[0] < 0.7 * turns[1], "it sweeps upwards"


def test_a_multisine_repeats_itself_and_its_realisations_have_the_same_odd_lines_and_other_phases():
    theta = excited("multisine", realisations=2).theta
    one, again, other = (
        theta[start : start + 4000] for start in (2500, 6500, 2500 + 12000 + 2000 + 1500)
    )
    np.testing.assert_allclose(one, again, atol=1e-9)
    sizes = [np.abs(np.fft.rfft(x))[:40] / 4000 for x in (one, other)]
    np.testing.assert_allclose(*sizes, atol=1e-6)
    # 25 s: 12 Hz is line 300
    smooth = np.abs(np.fft.rfft(excited("prbs", smoothing_hz=4.0).theta)) ** 2
    assert smooth[300:].sum() < 1e-3 * smooth.sum()
    assert (np.abs(one - other).max() > 0.02, (sizes[0][::2] > 1e-6).any()) == (True, False)


@pytest.mark.parametrize("controller", [compensated_gains, uncompensated_gains])
def test_without_effects_the_leg_renders_what_linear_theory_says_and_the_transmission_its_losses(
    controller,
):
    """Least squares on the true motion of the settled 2 Hz and 5 Hz, three cycles each, of which
    the last two count."""
    sizes = {
        "actuator_encoder": on(1e-3, "rad"),
        "belt_hysteresis": on(2, "N*m"),
        "control_delay": on(3, "update"),
    }
    sizes |= {"velocity_filter": on(40, "Hz"), "friction": on(1.5, "1")}
    integrated = {"substeps": 40, "control_updates": 4, "sign_width": 0.2, "hysteresis_width": 2e-3}
    found = drivetrain_effects(only({"drivetrain": integrated, "effects": sizes}))
    expected = {
        "encoder_resolution": 1e-3,
        "hysteresis_torque": 2,
        "control_delay": 3,
        "velocity_cutoff_hz": 40,
    }
    assert found | expected | integrated | {"friction_scale": 1.5, "friction": True} == found
    assert drivetrain_effects(only({"drivetrain": integrated}))["control_updates"] == 40, (
        "continuous"
    )
    made, gains = only({"joint": None}), controller(300, 5, P)
    weighed = simulated({"joint": None, "gain_weight": (weight := {"cutoff_hz": 1, "order": 1})})[
        1
    ]["gains"]["B_1"]
    assert (
        weighed
        == compensated_gains(300, 5, P, Weight(**weight)).B_1
        != compensated_gains(300, 5, P).B_1
    )
    t = np.arange(round((0.5 + 1.5 + 0.6 + 0.5) * RATE)) / RATE
    rows = ((t > 1.0) & (t < 1.99)) | ((t > 2.2) & (t < 2.59))
    for experiment, own, expected in (
        ("impedance", gains, predicted_impedance(gains, P, (2.0, 5.0))), ("transmission", None,
         (0.0, P.B_j, P.J_j)),
    ):  # fmt: skip
        motion, signals = true_signals({"trial": TRIAL, "experiment": experiment}, made, P, own)
        columns = np.column_stack([motion.theta, motion.omega, motion.alpha])[rows]
        np.testing.assert_allclose(
            np.linalg.lstsq(columns, -signals[TORQUE][rows])[0], expected, rtol=5e-3, atol=2e-3
        )


def test_the_belt_is_loaded_by_its_own_stiffness():
    stiffness, loading = [], slice(600, 1400)
    for trial in ("belt_01", "belt_02"):
        log, truth = simulated({"effects": {"belt_scatter": on(0.01, "1")}}, trial)
        theta, omega = log[ANGLE][loading], np.gradient(log[ANGLE], 1e-3)[loading]
        stiffness.append(np.polyfit(theta, -log[TORQUE][loading] - P.B_j * omega, 1)[0])
        assert stiffness[-1] == pytest.approx(truth["parameters"]["K_s"], rel=1e-4)
        assert not np.any(log["actuator_angle"])
    assert 1e-4 < abs(stiffness[0] / stiffness[1] - 1) < 0.06
    made = only({"effects": {"friction": on(1.5, "1")}}, DEFAULT)
    found = simulate_bench_trial({"trial": "a_1", "experiment": "actuator"}, made, P)[1][
        "parameters"
    ]
    assert (found["f_C"], found["f_G"]) == (1.5 * P.f_C, 1.5 * P.f_G)


def test_each_sensor_effect_adds_what_the_truth_says_and_leaves_the_other_draws_alone():
    sizes = {"load_cell_offset": on(0.5, "N*m"), "load_cell_drift": on(0.05, "N*m/min")}
    sizes["load_cell_noise"] = on(0.05, "N*m")
    chosen = {"clean": {}, "all": sizes} | {name: {name: size} for name, size in sizes.items()}
    logs, truths = zip(
        *(simulated({"effects": one}, "belt_01") for one in chosen.values()), strict=True
    )
    drawn, elapsed = truths[1]["drawn"], logs[1]["time"] - logs[1]["time"][0]
    added = {n: log[TORQUE] - logs[0][TORQUE] for n, log in zip(chosen, logs, strict=True)}
    assert added["all"] == pytest.approx(sum(added[name] for name in sizes), abs=1e-10)
    assert added["load_cell_offset"] == pytest.approx(drawn["load_cell_offset"], abs=1e-10)
    assert added["load_cell_drift"] == pytest.approx(
        drawn["load_cell_drift"] * elapsed / 60, abs=1e-10
    )
    assert drawn["load_cell_offset"] / 0.5 != pytest.approx(drawn["load_cell_drift"] / 0.05), (
        "streams of their own"
    )
    assert np.std(added["load_cell_noise"]) == pytest.approx(0.05, rel=4 / np.sqrt(2 * 3000))


def test_an_exact_joint_answers_by_eq_15_and_true_jitter_within_the_motion_leaves_its_samples_true(
    clean,
):
    log = log_of(node(jitter=on(20e-6, "s", distribution="normal")))
    count = np.arange(len(log["time"]))
    residual = log["time"] - np.polynomial.Polynomial.fit(count, log["time"], 1)(count)
    assert np.std(residual) == pytest.approx(20e-6, rel=4 / np.sqrt(2 * len(residual)))
    assert log[ANGLE] == pytest.approx(
        CubicSpline(clean["time"], clean[ANGLE])(log["time"]), abs=1e-8
    )
    # A hundred samples that scatter by ten steps: a third would be outside, were there nothing to
    # hold them.
    made = only(node(jitter=on(0.01, "s")))
    instants = Bench("trial", made, {}, 100).sampling("node", made.recorder.node).instants
    assert 0 <= instants.min() < 0.01 < 0.09 < instants.max() <= 0.099
    assert len(instants) < 100
    for f, rows in ((2, slice(1000, 2000)), (5, slice(2200, 2600))):
        kernel = np.exp(-2j * np.pi * f * clean["time"][rows])
        assert 2 * np.abs(clean["commanded_angle"][rows] @ kernel) / len(kernel) == pytest.approx(
            np.deg2rad(4)
        )
        w, ratio = 2 * np.pi * f, -(clean[TORQUE][rows] @ kernel) / (clean[ANGLE][rows] @ kernel)
        # 30 Hz, damping 0.9
        followed = (clean[ANGLE][rows] @ kernel) / (clean["commanded_angle"][rows] @ kernel)
        assert followed == pytest.approx(1 / (1 - (f / 30) ** 2 + 1.8j * f / 30), rel=1e-3)
        # the servo's transient is left
        assert ratio == pytest.approx(300 - 0.02 * w**2 + 5j * w, rel=1e-4)


def test_two_nodes_have_stamps_rates_and_clocks_of_their_own(clean):
    log = log_of({"recorder": {"torque_node": {"phase": on(3e-4, "s"), "rate": on(333, "Hz")}}})
    np.testing.assert_allclose(log["time"], clean["time"], rtol=0, atol=1e-9)
    assert log["torque_time"][0] - log["time"][0] == pytest.approx(3e-4, abs=1e-9)
    assert np.diff(log["torque_time"]).mean() == pytest.approx(1 / 333, rel=1e-6)
    rows, expected = (
        settled(log["torque_time"]),
        CubicSpline(clean["time"], clean[TORQUE])(log["torque_time"]),
    )
    assert log[TORQUE][rows] == pytest.approx(expected[rows], abs=1e-4)
    log, truth = simulated(
        {"recorder": {"torque_node": {"clock_offset": on(0.2, "s"), "clock_drift": on(-50, "ppm")}}}
    )
    own, elapsed = (
        log["torque_time"] - truth["drawn"]["clock_start_s"],
        log["time"] - log["time"][0],
    )
    assert own == pytest.approx(0.2 + (1 - 50e-6) * elapsed, abs=2e-9)


def test_samples_are_dropped_singly(clean):
    def missing(**changes):
        return np.rint(np.diff(log_of(node(**changes))["time"]) * 1000).astype(int) - 1

    n = len(clean["time"])
    assert [missing(dropped=on(share, "1")).sum() for share in (1e-3, 1e-6)] == [round(1e-3 * n), 1]
    assert set(missing(dropped=on(0.2, "1"))) == {0, 1}
    assert (
        log_of(node(dropped=on(0.4, "1")))["time"][[0, -1]].tolist()
        == clean["time"][[0, -1]].tolist()
    )


@pytest.mark.parametrize(("changes", "channel", "expected", "within"), [
    # rests
    ({"effects": {"load_cell_delay": on(2e-3, "s")}}, TORQUE, lambda log: np.roll(log[TORQUE], 2),
     1e-5),
    ({"effects": {"mount_stiffness": on(3e3, "N*m/rad")}}, ANGLE,
     lambda log: log[ANGLE] - log[TORQUE] / 3e3, 1e-9),
])  # fmt: skip
def test_a_late_load_cell_and_a_yielding_frame_change_one_channel(
    clean, changes, channel, expected, within
):
    log, other = log_of(changes), ({TORQUE, ANGLE} - {channel}).pop()
    assert log[channel] == pytest.approx(expected(clean), abs=within)
    np.testing.assert_array_equal(log[other], clean[other])


def test_coulomb_friction_turns_with_the_velocity(clean):
    log, omega = (
        log_of({"joint": JOINT | {"coulomb": on(3, "N*m")}}),
        np.gradient(clean[ANGLE], 1e-3),
    )
    moving = settled(clean["time"]) & (np.abs(omega) > 0.02)
    assert (clean[TORQUE] - log[TORQUE])[moving] == pytest.approx(
        3 * np.sign(omega[moving]), abs=1e-4
    )


CYCLES = {"lowest_deg": -10, "highest_deg": 10, "speed_deg_s": [4], "turn_s": 0.2, "rest_s": 1}
TONES = [{"frequency_hz": 1, "size": 1}]
SLIPS = {"K": 100, "slipping": [{"stiffness": 500, "limit": 90}], "cycles": CYCLES}


@pytest.mark.parametrize(("section", "value", "match"), [
    ("recorder", {"node": {"jitter": on(20, "us")}}, "unit must be 's'"),
    ("recorder",
     {"node": {"latency": on(1e-4, "s", distribution="normal")}}, "latency is never negative"),
    ("recorder", {"node": {"dropped": on(1.5, "1")}}, "less than 1"),
    ("recorder", {"node": {"rate": on(0, "Hz")}}, "must be positive; set enabled: false"),
    ("protocol", {"seconds": 2.0}, "cycles or seconds"),
    ("protocol", {"cycles": [1, 2, 3]}, "3 numbers of cycles for 2 frequencies"),
    ("excitations",
     [{"name": "x", "kind": "noise", "rms_deg": 1, "band_hz": [6, 2]}],
     "2.0 stands behind 6.0; write"),
    ("actuator",
     {"duration_s": 3, "fade_s": 1, "velocity": TONES, "current": TONES},
     "at least four times fade_s"),
    ("experiments", {"belt": 0, "transmission": 0, "K_d": []}, "no trials are planned"),
    ("experiments",
     {"actuator": 2}, "2 actuator trials are planned but 'actuator' has no schedule"),
    ("foot", SLIPS, "does not reach its limit of 90 N"),
    ("experiments",
     {"torque_angle": 3}, "3 torque-angle trials are planned but there is no 'foot'"),
])  # fmt: skip
def test_a_wrong_imperfection_or_motion_is_refused(tmp_path, section, value, match):
    content = yaml.safe_load(TINY.read_text())
    known = content.get(section)
    content[section] = known | value if isinstance(known, dict) else value
    (tmp_path / "settings.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match=match):
        read_yaml(tmp_path / "settings.yaml", SimulationSettings)


def test_without_a_compiler_nothing_is_simulated_and_one_line_says_what_to_install(
    monkeypatch, tmp_path, in_root
):
    monkeypatch.setattr("osl_analysis.model.compiled.HAS_COMPILER", False)
    said = r"needs numba, which is not installed; pip install 'osl-analysis\[simulator\]'"
    with pytest.raises(InputError, match=said):
        simulate_trial(TINY, tmp_path, "belt_01")
    assert list(tmp_path.iterdir()) == []


def test_a_trial_simulated_alone_is_the_campaigns(tmp_path, in_root):
    simulate_campaign(TINY, tmp_path / "all")
    simulate_trial(TINY, tmp_path / "one", TRIAL)
    written = sorted(str(f.relative_to(tmp_path / "one")) for f in (tmp_path / "one").rglob("*.*"))
    assert written == [f"dynamometer/{TRIAL}.mcap", f"truth/{TRIAL}.json"]
    for path in written:
        assert (tmp_path / "one" / path).read_bytes() == (tmp_path / "all" / path).read_bytes()
    assert (
        len([*(tmp_path / "all/dynamometer").iterdir()]),
        (tmp_path / "all/trials.csv").is_file(),
    ) == (5, True)


def test_two_nodes_write_standard_messages_of_their_stamps_and_values(tmp_path):
    log = log_of(
        {
            "joint": None,
            "recorder": {"torque_node": {"phase": on(3e-4, "s"), "rate": on(333, "Hz")}},
        }
    )
    write_bench_log(tmp_path / "log.mcap", log, two_nodes=True)
    found = {}  # messages by topic, with their arrival [ns], by an independent reader
    with (tmp_path / "log.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, record, message in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((record.log_time, message))
    for topic, time in (("/joint_states", "time"), ("/wrench", "torque_time")):
        stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for _, m in found[topic]]
        assert stamps == np.rint(log[time] * 1e9).astype(int).tolist()
        assert [arrived for arrived, _ in found[topic]] == [stamp + 150_000 for stamp in stamps]
    assert [m.wrench.torque.z for _, m in found["/wrench"]] == log[TORQUE].tolist()
    assert {tuple(m.name) for _, m in found["/joint_states"]} == {("joint", "actuator", "command")}
    angles = [log[name].tolist() for name in (ANGLE, "actuator_angle", "commanded_angle")]
    assert [list(m.position) for _, m in found["/joint_states"]] == [
        list(row) for row in zip(*angles, strict=True)
    ]
    assert [list(m.effort) for _, m in found["/joint_states"]] == [
        [0, own, 0] for own in log["motor_current"].tolist()
    ]


@pytest.mark.parametrize("counts", [(9000, 4000), (5, 0), (0, 0)])
def test_a_log_is_the_file_that_the_mcap_package_writes_of_the_same_messages(tmp_path, counts):
    """Two topics of messages of different size, in turn, over two chunks; stamps that repeat and
    are not in order."""
    rng, messages = np.random.default_rng(4), []
    times = [
        np.round(end * rng.random(count), 1) for end, count in zip((100, 33), counts, strict=True)
    ]
    angle, torque = (rng.normal(size=count) for count in counts)
    topics = (
        joint_states("/joint", "a", times[0], {"a": angle, "bc": angle}, {}),
        wrenches("/f", "f", times[1], torque),
    )
    write_topics(tmp_path / "ours.mcap", topics)
    writer = Writer(str(tmp_path / "theirs.mcap"))
    writer.start(profile="ros2", library="osl-analysis")
    writer.add_metadata(
        "recording", {"origin": "simulated", "topic": "/joint, /f", "time": "header stamp"}
    )
    for topic in topics:
        schema = writer.register_schema(topic.schema_name, "ros2msg", topic.schema_text.encode())
        channel = writer.register_channel(topic.name, "cdr", schema)
        records = topic.records(np.arange(topic.stamps.size))
        messages += [
            (int(m["publish"]), channel, row, m["data"].tobytes()) for row, m in enumerate(records)
        ]
    for stamp, channel, row, data in sorted(messages, key=lambda message: message[0]):
        writer.add_message(channel, stamp + 150_000, data, stamp, row)
    writer.finish()
    assert (tmp_path / "ours.mcap").read_bytes() == (tmp_path / "theirs.mcap").read_bytes()
