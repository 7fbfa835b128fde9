"""The simulated gait laboratory: plate, capture, conditions, gait, platform, recorders; measured
from written files."""

import json
from collections import defaultdict
from dataclasses import replace

import ezc3d
import numpy as np
import polars as pl
import pytest
from conftest import ROOT
from decoded_capture import decoded_crossing
from scipy.signal import StateSpace, lsim
from walking_setup import PERTURBED, STATIC, UNPERTURBED, Setup, leg_log, load_setup

from osl_analysis.config.impedance_trajectory import read_impedance_trajectory
from osl_analysis.errors import InputError
from osl_analysis.ingest.raw_files import trial_from_files
from osl_analysis.model.compensator import Weight, compensated_gains
from osl_analysis.simulator import step as gait
from osl_analysis.simulator.laboratory_files import seen_markers
from osl_analysis.simulator.laboratory_settings import Rates, WalkingSettings
from osl_analysis.simulator.simulated_crossing import (
    impedance_of_leg,
    move,
    react,
    walking_commands,
)
from osl_analysis.simulator.simulation_settings import Conditions, Subject
from osl_analysis.simulator.step import GaitTrial, draw_step, unloaded_platform
from osl_analysis.simulator.trial_plan import Condition, condition_of, plan_trials
from osl_analysis.yaml_settings import read_yaml

REAL, G = ROOT.parent / "shared/real_data/c3d/btk_PiG_Motion3_FF.c3d", 9.81
SENSORS = (
    "marker_noise",
    "marker_gaps",
    "force_noise",
    "moment_noise",
    "force_offset",
    "moment_offset",
)


@pytest.fixture(scope="module")
def shipped():
    return load_setup()


@pytest.fixture(scope="module")
def setup(shipped):
    """Exact sensors, massless plate and foot, and a platform that alone turns the ankle."""
    return shipped.ideal()


@pytest.fixture(scope="module")
def usual(setup, tmp_path_factory):
    return decoded(setup, tmp_path_factory.mktemp("usual"))


@pytest.fixture(scope="module")
def walked(shipped):
    return shipped.crossing(perturbed=True)


@pytest.fixture(scope="module")
def calm(shipped):
    return shipped.crossing(perturbed=False)


def with_conditions(setup, numbers=None, **lists):
    numbers = numbers or {"walking": 24}
    experiments = setup.settings.experiments.model_copy(
        update={"conditions": Conditions(**lists)} | numbers
    )
    return Setup(
        setup.settings.model_copy(update={"experiments": experiments}), setup.walking, setup.p
    )


def altered(setup, **fields):
    return Setup(setup.settings, setup.walking.model_copy(update=fields), setup.p)


def ramped(setup, **ramp):
    return altered(setup, perturbation=setup.walking.perturbation.model_copy(update=ramp))


def decoded(setup, folder, perturbed=False, trial="walking_01"):
    setup.record(folder, (PERTURBED if perturbed else UNPERTURBED) | {"trial": trial})
    return decoded_crossing(folder / f"vicon/{trial}.c3d")


def parameters_of(setup, folder, row):
    """Parameters of the file of a recording."""
    setup.record(folder, row)
    return ezc3d.c3d(str(folder / f"vicon/{row['trial']}.c3d"))["parameters"]


def plate_of(folder, trial):
    """Force [N] and moment [N*m] of the plate, (n, 6), as ingest reads them, whose formulas have
    tests of their own."""
    row = {"trial": trial, "mocap": f"vicon/{trial}.c3d", "mocap_source": "vicon"}
    return (
        trial_from_files(row, folder, ROOT / "config/sources")
        .samples.select("^plate1_.*$")
        .to_numpy()
    )


@pytest.mark.parametrize("compensated", [True, False])
def test_a_crossing_has_the_commanded_stiffness_and_is_perturbed_at_the_planned_phase(
    setup, tmp_path, compensated
):
    """K_1 = K_d K_s / (K_s - K_d) / n_T^2: actuator and belt in series. The phase scatters by 0.01;
    stance: 0.72 s."""
    path = tmp_path / "impedance.csv"
    path.write_text("phase,K_d,B_d\n0,200,4\n1,200,4\n")
    own = altered(ramped(setup, stance_phase=(0.19, 0.21)), impedance=path)
    controller = "compensated" if compensated else "uncompensated"
    own.record(tmp_path, PERTURBED | {"controller": controller})
    seen, log = decoded_crossing(tmp_path / "vicon/walking_01.c3d"), leg_log(tmp_path)
    high = np.flatnonzero(seen.analogs[7] > 2.5) / 1500
    assert np.ptp(high) == pytest.approx(0.02, abs=1.1 / 1500)
    in_series = 685.6 / (685.6 - 200) if compensated else 1
    assert log["stiffness_gain"].max() == pytest.approx(200 * in_series / (83 / 18) ** 2, rel=1e-6)
    assert compensated or log["damping_gain"].max() == pytest.approx(4 / (83 / 18) ** 2, rel=1e-6)
    assert (high[0] - 0.9) / 0.72 == pytest.approx(0.2, abs=0.011)
    assert seen.time[np.abs(seen.platform_angle) > 1e-4][0] > high[0] + 0.004


def crossings_of(settings):
    """The sheet's rows of the crossings, and their conditions."""
    rows = [row for row in plan_trials(settings).values() if row["experiment"] == "walking"]
    return rows, [condition_of(row, settings) for row in rows]


def test_every_direction_is_planned_equally_often_and_what_the_sheet_states_is_simulated(setup):
    rows, _ = crossings_of(
        with_conditions(setup, {"walking": 100, "perturbed_share": 0.1}).settings
    )
    assert 1 < sum(row["perturbed"] for row in rows) < 25
    assert {row["direction"] for row in rows} == {None}, "there is one"
    rows, found = crossings_of(with_conditions(setup, directions=("up", "down")).settings)
    drawn = [one.direction for one in found]
    assert [sorted(pair) for pair in zip(drawn[::2], drawn[1::2], strict=True)] == 12 * [
        ["down", "up"]
    ]
    assert 0 < drawn[::2].count("up") < 12, "in no simple order"
    for row, condition in zip(rows, found, strict=True):
        assert row["direction"] == (condition.direction if row["perturbed"] else None)
    own = condition_of(rows[0] | {"perturbed": True, "direction": "down"}, setup.settings)
    assert (own.direction, own.perturbed) == ("down", True)
    with pytest.raises(InputError, match="the plan has two trials 'impedance_K300_B"):
        plan_trials(with_conditions(setup, {"K_d": (300.0, 300.0001)}).settings)


def test_persons_follow_each_other_in_equal_blocks(setup, tmp_path):
    people = [
        Subject(name="A", body_mass_kg=60, stance_s=0.6),
        Subject(name="B", body_mass_kg=90, stance_s=0.8),
    ]
    mixed = with_conditions(setup, subjects=people)
    rows, found = crossings_of(mixed.settings)
    assert [c.subject.name for c in found] == 12 * ["A"] + 12 * ["B"]
    assert [rows[k]["subject"] for k in (0, -1)] == ["A", "B"]
    light, heavy = (
        decoded(mixed, tmp_path, False, trial) for trial in ("walking_01", "walking_24")
    )
    stated, plain = (parameters_of(lab, tmp_path, STATIC) for lab in (mixed, setup))
    assert stated["SUBJECTS"]["NAMES"]["value"] == ["A"]
    alone = parameters_of(mixed, tmp_path, {"trial": "plate_01", "experiment": "plate"})
    assert "SUBJECTS" not in {*plain, *alone}, "nobody stands on the plate"
    # half of 80 kg above the ankle, 60 mm behind the middle of the plate
    stood = plate_of(tmp_path, "static_1")
    np.testing.assert_allclose(
        stood, np.outer(np.ones(4500), 40 * G * np.array([0, 0, 1, 0, 0.06, 0])), atol=1e-3
    )
    assert light.force[:, 2].max() / heavy.force[:, 2].max() == pytest.approx(60 / 90, rel=1e-3)
    # one frame of 0.6 s
    assert np.ptp(light.stance) / np.ptp(heavy.stance) == pytest.approx(0.6 / 0.8, abs=0.01)


def test_a_platform_turns_about_the_ankle_and_a_shift_turns_the_leg_over_it(setup, tmp_path):
    """The point 0.08 m above the surface, x = 0.24 m, stays; one 0.2 m below it does not."""
    platform = decoded(setup, tmp_path, True).platform
    ankle, below = (platform.point(np.array([0.24, 0.25, z])) for z in (0.08, -0.12))
    np.testing.assert_allclose(ankle, np.tile(ankle[0], (len(ankle), 1)), atol=1e-5)
    assert np.ptp(below[:, 0]) == pytest.approx(0.20 * np.sin(np.radians(5)), rel=1e-3)
    shifted = ramped(setup, shift_mm=50.0)
    moved, still = decoded(shifted, tmp_path, True), decoded(shifted, tmp_path)
    travel, turned = (
        moved.platform.point(np.array([0.3, 0.25, 0.0]))[:, 0],
        moved.theta - still.theta,
    )
    np.testing.assert_allclose(moved.platform_angle, 0, atol=1e-6)
    assert travel.min() - travel[0] == pytest.approx(-0.05, abs=1e-5)
    ramp = (moved.time > 1.15) & (moved.time < 1.35)
    np.testing.assert_allclose(turned[ramp], (travel[0] - travel[ramp]) / 0.9, atol=1e-5)
    down = unloaded_platform(GaitTrial("plate_01", 1, shifted.walking, Condition(direction="down")))
    assert (down.shift[:, 0].min(), down.shift[:, 0].max() > 0.04) == (0, True), "forward"


def test_an_exact_analysis_of_the_recording_gives_back_angle_and_torque(shipped, tmp_path):
    """Gait varies, sensors are perfect and nothing but the foot has mass: what remains is rounding
    to float32."""
    seen = decoded(
        shipped.lacking("plate_inertia", "plate_lag", "foot_inertia", *SENSORS), tmp_path, True
    )
    truth, inside = (
        pl.read_parquet(tmp_path / "truth/walking_01.parquet")[::5],
        seen.force[:, 2] > 400,
    )
    np.testing.assert_allclose(seen.theta, truth["theta"], atol=1e-6)
    np.testing.assert_allclose(seen.torque[inside], truth["torque"].to_numpy()[inside], atol=2e-3)
    assert 90 < seen.torque.max() < 150


def test_recorders_see_the_same_edges_and_joint_through_the_leg_s_clock_and_a_late_plate_lags(
    shipped, tmp_path
):
    analogs, count = shipped.record(tmp_path, PERTURBED)["analogs"][0], 2 * np.pi / 2**14
    log, facts = leg_log(tmp_path), json.loads((tmp_path / "truth/walking_01.json").read_text())
    truth = pl.read_parquet(tmp_path / "truth/walking_01.parquet")
    offset, drift = facts["leg_clock"].values()
    assert (2.5 < offset < 7.5, 0 < abs(drift) < 2e-4) == (True, True)
    np.testing.assert_allclose(np.diff(log["time"]), 1 / 500, atol=1e-6)
    time = (log["time"] - offset) / (1 + drift)
    vicon, leg = (
        np.flatnonzero(np.diff(analogs[6] > 2.5)) / 1500,
        time[np.flatnonzero(np.diff(log["sync"]))],
    )
    assert len(leg) > 12
    np.testing.assert_allclose(leg, vicon, rtol=0, atol=1 / 500)
    assert np.ptp(np.diff(vicon)) > 0.05, "irregular, so that a shift by a period shows"
    theta, torque = (np.interp(time, truth["time"], truth[name]) for name in ("theta", "torque"))
    np.testing.assert_allclose(log["joint_angle"], theta, atol=0.51 * count + 1e-5)
    effects, step = (
        shipped.settings.effects,
        draw_step(GaitTrial("walking_01", shipped.settings.seed, shipped.walking)),
    )
    steps = {
        "actuator_angle": effects.actuator_encoder.value,
        "motor_current": effects.current_quantisation.value,
    }
    for name, size in (steps | {"joint_angle": count}).items():
        np.testing.assert_allclose(log[name] / size, np.rint(log[name] / size), atol=5e-3)
    assert all(
        facts[f"{name}_s"] == getattr(step, name)
        for name in ("command", "onset", "heel_strike", "toe_off")
    )
    belt = shipped.p.K_s * (theta - log["actuator_angle"] / shipped.p.n_T)
    assert np.interp(facts["onset_s"], time, belt - torque) == pytest.approx(0, abs=3)
    labs = (shipped.lacking(*SENSORS[2:], *lag) for lag in ((), ("plate_lag",)))
    late, prompt = (lab.record(tmp_path, PERTURBED)["analogs"][0, :6] for lab in labs)
    assert np.abs(prompt[:, :600]).max() < 1e-3, "of 12 kg, and its moment"
    slope = np.gradient(prompt[2], 1 / 1500)
    assert slope @ (prompt - late)[2] / (slope @ slope) == pytest.approx(0.5e-3, rel=0.01)


def test_switching_one_effect_off_leaves_the_draws_of_the_others_and_gaps_are_few_and_mostly_short(
    shipped, tmp_path
):
    labs = shipped, shipped.lacking("marker_noise"), shipped.lacking(*SENSORS[2:])
    noisy, clean, quiet = (lab.record(tmp_path, PERTURBED) for lab in labs)
    np.testing.assert_array_equal(noisy["analogs"], clean["analogs"])
    hidden = np.isnan(noisy["points"][0])
    np.testing.assert_array_equal(hidden, np.isnan(clean["points"][0]))
    assert 0 < hidden.mean() < 0.01, "gaps are few and short"
    assert np.nanstd((noisy["points"] - clean["points"])[:3]) == pytest.approx(0.15, rel=0.02)
    noise = (noisy["analogs"] - quiet["analogs"])[0]
    assert (np.abs(noise.mean(axis=1))[[0, 3]] > [1, 100]).all(), "offsets of 2 N and 300 N*mm"
    noise -= noise.mean(axis=1, keepdims=True)
    assert (np.std(noise[:3]), np.std(noise[3:6])) == (
        pytest.approx(0.4, rel=0.03),
        pytest.approx(80, rel=0.03),
    )
    # 4500 independent samples: standard error of a correlation 0.015
    assert np.abs(np.corrcoef(noise[:6]) - np.eye(6)).max() < 0.06
    trials = [GaitTrial(f"walking_{i:02d}", 1, shipped.walking) for i in range(1, 13)]
    hidden = np.array(
        [np.isnan(seen_markers(one, np.zeros((900, 12, 3)))[..., 0]).T for one in trials]
    )
    lengths = np.diff(np.flatnonzero(np.diff(hidden, axis=-1, prepend=0, append=0)))[::2]
    assert (20 < len(lengths) < 80, lengths.max() <= 61, np.median(lengths) < 15) == (
        True,
        True,
        True,
    )


def test_a_trial_depends_on_the_seed_and_its_name_only(shipped, tmp_path):
    row, other = (
        PERTURBED | {"trial": "walking_02"},
        shipped.settings.model_copy(update={"seed": 7}),
    )
    shipped.record(tmp_path / "again", PERTURBED)
    for folder, seed in (
        ("first", shipped.settings),
        ("again", shipped.settings),
        ("other", other),
    ):
        Setup(seed, shipped.walking, shipped.p).record(tmp_path / folder, row)
    for name in (
        "vicon/walking_02.c3d",
        "leg/walking_02.mcap",
        "truth/walking_02.parquet",
        "truth/walking_02.json",
    ):
        first, again, seeded = (
            (tmp_path / folder / name).read_bytes() for folder in ("first", "again", "other")
        )
        assert first == again != seeded, name


def test_a_bad_impedance_trajectory_and_a_wrong_duration_or_rate_are_refused(tmp_path):
    for text, said in (
        ("phase,K_d\n0,100\n1,100\n", "no column 'B_d'"),
        ("phase,K_d,B_d\n0,1,1\n", "fewer than two rows"),
        ("phase,K_d,B_d\n0,100,1\n0.9,100,1\n", "from 0 to 0.9; it must rise from 0 to 1"),
        ("phase,K_d,B_d\n0,100,1\n0.5,100,1\n0.5,200,1\n1,100,1\n", "it must rise from 0 to 1"),
        ("phase,K_d,B_d\n0.1,1,1\n1,1,1\n", "from 0.1 to 1; it must"),
        ("phase,K_d,B_d\n0,1,1\n1,1,nan\n", "B_d holds"),
        ("phase,K_d,B_d\n0,1,1\n1,a,1\n", "not a table of numbers"),
        ("phase,K_d,B_d,K_d\n0,1,1,1\n", "'K_d' stands twice"),
    ):  # fmt: skip
        (tmp_path / "impedance.csv").write_text(text)
        with pytest.raises(InputError, match=said):
            read_impedance_trajectory(tmp_path / "impedance.csv")
    with pytest.raises(
        InputError,
        match=r"none.csv: no such impedance trajectory; correct its path in the configurat",
    ):
        read_impedance_trajectory(tmp_path / "none.csv")
    text = (ROOT / "config/simulation/walking.yaml").read_text()
    for right, wrong, said in (
        (
            "recording_s: 3.0",
            "recording_s: 1.5",
            r"gait.*stance_s = .* is not below recording_s = 1.5",
        ),
        (
            "analogs_hz: 1500",
            "analogs_hz: 1000",
            r"analogs_hz must be a multiple of points_hz \(300\)",
        ),
        ("[0.38, 0.40]", "[0.41, 0.40]", "stance_phase falls; write the lower first"),
    ):
        (tmp_path / "walking.yaml").write_text(text.replace(right, wrong))
        with pytest.raises(InputError, match=said):
            read_yaml(tmp_path / "walking.yaml", WalkingSettings)
    # every time the same
    (tmp_path / "walking.yaml").write_text(text.replace("[0.38, 0.40]", "[0.40, 0.40]"))
    read_yaml(tmp_path / "walking.yaml", WalkingSettings)


def test_a_given_equilibrium_and_a_weight_of_the_gains_are_used(shipped, tmp_path):
    path = tmp_path / "impedance.csv"
    path.write_text("phase,K_d,B_d,theta_eq_rad\n0,300,5,0.05\n1,300,5,0.05\n")
    own = altered(shipped, impedance=path, gain_weight=(weight := Weight(cutoff_hz=1, order=1)))
    gains = compensated_gains(300, 5, shipped.p, weight)
    usual = walking_commands(draw_step(GaitTrial("walking_01", 1, own.walking)), True, shipped.p)
    expected = np.array([[gains.K_1], [gains.B_1], [0.05 * shipped.p.n_T]])
    np.testing.assert_allclose(usual, np.broadcast_to(expected, usual.shape))


def test_the_torque_peaks_as_in_level_walking_and_the_foot_stays_above_the_floor(calm, shipped):
    assert calm.torque.max() / shipped.walking.gait.body_mass_kg == pytest.approx(1.4, abs=0.15)
    upward, phase = calm.reaction.force[:, 2] / (80 * G), calm.step.stance_phase(calm.time)
    assert 1.0 < upward[phase < 0.4].max() < 1.25
    assert upward[(phase > 0.4) & (phase < 0.6)].min() < 0.85, "it dips at mid-stance"
    assert not calm.reaction.force[(phase < 0) | (phase > 1)].any(), "nor is there any in swing"
    for point in (gait.HEEL, gait.BALL):
        assert calm.foot.point(point)[:, 2].min() > shipped.walking.plate.centre_m[2] - 1e-3


def test_step_to_step_variability_has_the_sizes_that_are_set(shipped):
    """Standard deviations over 400 steps are within 15 % (4 sigma) of the sizes."""
    coarse = Rates(points_hz=50, analogs_hz=50, leg_hz=50, controller_hz=50)
    shipped = altered(shipped, rates=coarse)
    found = defaultdict(list)
    for i in range(400):
        step = draw_step(GaitTrial(f"walking_{i}", 1, shipped.lacking("angle_wander").walking))
        motion, foot, *_ = move(step, False)
        time = step.trial.time
        middle, straight = (
            np.searchsorted(time, step.heel_strike + step.stance / 2),
            foot.rotation[0],
        )
        force = react(step, foot, 0 * time)[1].force[middle] / (80 * G)
        usual = gait.nominal_ankle_angle(step.cycle_phase(time))[middle]
        wandering = replace(step, trial=replace(step.trial, walking=shipped.walking))
        found["stance_scatter"].append(100 * step.stance / 0.72)
        found["heel_strike_scatter"].append(step.heel_strike)
        found["angle_scale"].append(100 * motion.theta[middle] / usual)
        found["angle_wander"].append(np.degrees(move(wandering, False)[0].theta - motion.theta))
        found["force_scale"].append(
            100 * force / gait.ground_reaction(step.stance_phase(time[[middle]]))[0]
        )
        found["placement_forward"].append(1e3 * step.placement[0])
        found["placement_sideways"].append(1e3 * step.placement[1])
        found["foot_yaw"].append(np.degrees(np.arctan2(straight[1, 0], straight[0, 0])))
    for name, values in found.items():
        assert np.std(values) == pytest.approx(
            getattr(shipped.walking.effects, name).size, rel=0.15
        ), name


def test_a_perturbation_changes_nothing_before_its_onset(walked, calm):
    """4 % of 5 deg, 0.2 s after the onset."""
    onset, added = walked.platform.onset, np.degrees(walked.motion.theta - calm.motion.theta)
    for name in ("theta", "omega", "alpha"):
        # the central differences look two samples ahead, twice
        early = walked.time < onset - 5 / 3000
        np.testing.assert_array_equal(
            getattr(walked.motion, name)[early], getattr(calm.motion, name)[early]
        )
    # and the torque between two updates of the controller is interpolated
    early = walked.time < onset - 3e-3
    np.testing.assert_array_equal(walked.torque[early], calm.torque[early])
    assert added[np.searchsorted(walked.time, onset + 0.25)] == pytest.approx(0.96 * 5, abs=1e-6)
    ramp, down = (
        walked.step.trial.walking.perturbation,
        replace(walked.step.trial, condition=Condition(True, "down")),
    )
    half_way = walked.step.toe_off + ramp.hold_s + ramp.return_s / 2
    assert np.interp(half_way, walked.time, np.degrees(walked.platform.angle)) == pytest.approx(
        2.5, abs=1e-3
    )
    down = draw_step(down)
    turned = np.degrees(move(down, True)[0].theta - move(down, False)[0].theta)
    assert turned[np.searchsorted(walked.time, onset + 0.25)] == pytest.approx(-0.96 * 5, abs=1e-6)


def test_the_leg_renders_what_linear_theory_says_and_340_within_a_few_percent_with_imperfections(
    setup, walked, calm
):
    """The linear drivetrain (Eqs. 7-8) under the perturbation's rotation, integrated apart by
    scipy."""
    p, gains, crossing, still = (
        setup.p,
        compensated_gains(340, 5, setup.p),
        setup.crossing(True),
        setup.crossing(False),
    )
    moved = np.array(list(vars(crossing.motion).values())) - np.array(
        list(vars(still.motion).values())
    )
    A = [[0, 1], [-(gains.K_1 + p.K_s / p.n_T**2) / p.J_m, -(p.B_m + gains.B_1) / p.J_m]]
    theta_m = lsim(
        StateSpace(A, [[0], [p.K_s / p.n_T / p.J_m]], [[1, 0]], [[0]]), moved[0], crossing.time
    )[1]
    theory = p.K_s * (moved[0] - theta_m / p.n_T) + p.B_j * moved[1] + p.J_j * moved[2]
    since = crossing.time - crossing.platform.onset
    window = (since >= 0) & (since <= 0.1)
    K, B, inertia = np.linalg.lstsq(moved.T[window], theory[window])[0]
    found = np.array(list(impedance_of_leg(crossing, still).values()))
    assert np.all(np.abs(found - [K, B, inertia]) < [2e-3 * K, 1e-2 * B, 1e-3])
    assert impedance_of_leg(walked, calm)["K_rendered"] == pytest.approx(340, rel=0.04)


@pytest.mark.skipif(not REAL.exists(), reason="public sample recordings are not on this machine")
def test_every_force_plate_parameter_of_a_nexus_file_is_there_with_its_type_and_sign(
    setup, tmp_path
):
    ours = parameters_of(setup, tmp_path, STATIC)["FORCE_PLATFORM"]
    nexus = ezc3d.c3d(str(REAL))["parameters"]["FORCE_PLATFORM"]
    for name in set(nexus) - {"__METADATA__"}:
        assert ours[name]["type"] == nexus[name]["type"], name
    assert np.sign(ours["ORIGIN"]["value"][2, 0]) == np.sign(nexus["ORIGIN"]["value"][2, 0])
