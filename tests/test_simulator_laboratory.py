"""The simulated gait laboratory: plate, capture, conditions, gait, platform, recorders; measured from written files."""

import json

import ezc3d
import numpy as np
import polars as pl
import pytest
from conftest import ROOT
from decoded_capture import decoded_crossing, decoded_wrench
from scipy.signal import StateSpace, lsim
from walking_setup import PERTURBED, STATIC, UNPERTURBED, Setup, leg_log, load_setup

from osl_analysis.config.shared_choices import read_impedance_trajectory
from osl_analysis.config.yaml_settings import read_yaml
from osl_analysis.errors import InputError
from osl_analysis.model.compensator import compensated_gains
from osl_analysis.simulator import step as gait
from osl_analysis.simulator.crossing import impedance_of_leg, motion_grid, simulate_walking_trial
from osl_analysis.simulator.rigid_body import Pose, RigidBody, rotation_about
from osl_analysis.simulator.step import draw_step, unloaded_platform
from osl_analysis.simulator.walking_settings import WalkingSettings

G = 9.81
GRAVITY = np.array([0, 0, -G])


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


def altered(setup, part, **fields):
    changed = getattr(setup.walking, part).model_copy(update=fields)
    return Setup(setup.settings, setup.walking.model_copy(update={part: changed}), setup.p)


def stepping(setup, **change):
    return altered(setup, "gait", **change)


def decoded(setup, folder, perturbed=False, trial="walking_01"):
    setup.record(folder, (PERTURBED if perturbed else UNPERTURBED) | {"trial": trial})
    return decoded_crossing(folder / f"vicon/{trial}.c3d")


def truth_of(folder):
    return json.loads((folder / "truth/walking_01.json").read_text())


def test_a_slower_crossing_is_slower_throughout(setup, usual, tmp_path):
    slow = decoded(stepping(setup, slower_percent=10), tmp_path)
    assert np.ptp(slow.stance) / np.ptp(usual.stance) == pytest.approx(1.1, rel=0.01)
    later = 0.9 + (usual.time - 0.9) * 1.1
    inside = (usual.time > 0.95) & (usual.time < 1.55)
    np.testing.assert_allclose(np.interp(later, slow.time, slow.theta)[inside], usual.theta[inside], atol=1e-3)


@pytest.mark.parametrize("percent", [-8.0, 8.0])
def test_stance_changes_only_after_the_window(setup, tmp_path, percent):
    moved, same = (decoded(stepping(setup, after_window_percent=p), tmp_path, True) for p in (percent, 0.0))
    onset = same.time[np.abs(same.platform_angle) > 1e-4][0]
    before = same.time < onset + 0.095  # a curve with three derivatives starts at 100 ms
    np.testing.assert_allclose(moved.torque[before], same.torque[before], atol=1e-3)
    np.testing.assert_allclose(moved.force[before], same.force[before], atol=1e-3)
    assert moved.stance[1] - same.stance[1] == pytest.approx(0.01 * percent * 0.72, abs=0.007)
    assert moved.stance[0] == same.stance[0]
    assert moved.force[:, 2].max() == pytest.approx(same.force[:, 2].max(), rel=1e-3)


def test_an_impossible_stance_is_refused(setup, tmp_path):
    with pytest.raises(InputError, match="trial walking_01: after_window_percent 90 leaves"):
        decoded(stepping(setup, after_window_percent=90), tmp_path, True)


def test_only_perturbed_crossings_change_after_the_window(setup, usual, tmp_path):
    np.testing.assert_array_equal(decoded(stepping(setup, after_window_percent=-8), tmp_path).force, usual.force)


@pytest.mark.parametrize("phase", [0.2, 0.4, 0.6])
def test_the_trigger_fires_at_the_phase_of_stance_that_is_set_and_the_leg_resists(setup, tmp_path, phase):
    """Stance lasts 0.72 s from 0.9 s on. At 0.4 K is the 340 of the trajectory, as frames with derivatives by central
    differences show it; 5 %, because the compensated leg is of third order."""
    at_phase = altered(setup, "perturbation", stance_phase=(phase, phase))
    moved, calm = (decoded(at_phase, tmp_path, perturbed) for perturbed in (True, False))
    fired = np.flatnonzero(moved.analogs[7] > 2.5)[0] / 1500
    assert (fired - 0.9) / 0.72 == pytest.approx(phase, abs=0.001)
    begins = moved.time[np.abs(moved.platform_angle) > 1e-4][0]
    assert begins > fired + 0.004
    theta, torque = moved.theta - calm.theta, moved.torque - calm.torque
    omega, rows = np.gradient(theta, 1 / 300), (moved.time > begins - 0.01) & (moved.time < begins + 0.1)
    columns = np.stack([theta, omega, np.gradient(omega, 1 / 300)], axis=-1)[rows]
    assert np.degrees(theta[rows].max()) == pytest.approx(5, abs=0.02)
    if phase == 0.4:
        assert np.linalg.lstsq(columns, torque[rows], rcond=None)[0][0] == pytest.approx(340, rel=0.05)


def test_standing_reads_as_half_the_weight_above_the_ankle(shipped, tmp_path):
    shipped.ideal().record(tmp_path, STATIC)
    force, moment, centre = decoded_wrench(ezc3d.c3d(str(tmp_path / "vicon/static_1.c3d")))
    np.testing.assert_allclose(force, np.tile([0, 0, 40 * G], (len(force), 1)), atol=1e-3)
    pressure = centre[0] + np.array([-moment[0, 1], moment[0, 0], 0]) / force[0, 2]
    np.testing.assert_allclose(pressure, [0.24, 0.25, 0], atol=1e-5)


@pytest.mark.parametrize("trial", ["walking_01", "walking_02", "walking_03"])
def test_an_exact_analysis_of_the_recording_gives_back_angle_and_torque(shipped, tmp_path, trial):
    """Gait varies, sensors are perfect and nothing but the foot has mass: what remains is rounding to float32."""
    sensors = ("marker_noise", "marker_gaps", "force_noise", "moment_noise", "force_offset", "moment_offset")
    perfect = shipped.lacking("plate_inertia", "plate_lag", "foot_inertia", *sensors)
    perfect.record(tmp_path, PERTURBED | {"trial": trial})
    seen = decoded_crossing(tmp_path / f"vicon/{trial}.c3d")
    truth = pl.read_parquet(tmp_path / f"truth/{trial}.parquet")[::5]
    np.testing.assert_allclose(seen.theta, truth["theta"], atol=1e-6)
    inside = seen.force[:, 2] > 400
    np.testing.assert_allclose(seen.torque[inside], truth["torque"].to_numpy()[inside], atol=2e-3)
    assert 90 < seen.torque.max() < 150


def test_unloaded_trials_move_the_plate_about_every_axis_now_and_then(shipped):
    time = motion_grid(shipped.walking)
    ramps = [unloaded_platform(time, f"plate_{i:02d}", 1, shipped.walking) for i in range(1, 7)]
    spans = np.array([np.ptp(r.pose.point(np.array(shipped.walking.plate.centre_m)), axis=0) for r in ramps])
    rolls = np.array([np.ptp(r.pose.rotation[:, 2, 1]) for r in ramps])
    assert (rolls > 0.02).tolist() == [False, False, True, False, False, True]
    assert (spans[[2, 5]] > 5e-3).all()
    tops = np.degrees([r.angle.max() for r in ramps])
    assert len(set(tops.round(3))) == 6
    assert tops.min() > 4
    assert tops.max() < 6
    assert all(abs(r.angle[-1]) < 1e-9 and abs(r.angle[0]) < 1e-9 for r in ramps)


def test_both_recorders_see_the_same_sync_edges_through_the_leg_s_clock(shipped, tmp_path):
    analogs = shipped.record(tmp_path, PERTURBED)["analogs"][0]
    log, clock = leg_log(tmp_path), truth_of(tmp_path)["leg_clock"]
    assert 2.5 < clock["offset_s"] < 7.5
    assert 0 < abs(clock["drift"]) < 2e-4
    np.testing.assert_allclose(np.diff(log["time"]), 1 / 500, atol=1e-6)
    vicon = np.flatnonzero(np.diff(analogs[6] > 2.5)) / 1500
    leg = log["time"][np.flatnonzero(np.diff(log["sync"]))]
    assert len(vicon) == len(leg) > 12
    late = (leg - clock["offset_s"]) / (1 + clock["drift"]) - vicon
    assert (np.abs(late) < 1 / 500).all()
    assert np.ptp(np.diff(vicon)) > 0.05, "irregular, so that a shift by a period shows"
    assert set(np.unique(analogs[6])) == {0.0, 5.0}


def test_the_leg_logs_its_joint(shipped, tmp_path):
    shipped.record(tmp_path, PERTURBED)
    log, facts = leg_log(tmp_path), truth_of(tmp_path)
    truth = pl.read_parquet(tmp_path / "truth/walking_01.parquet")
    time = (log["time"] - facts["leg_clock"]["offset_s"]) / (1 + facts["leg_clock"]["drift"])
    theta = np.interp(time, truth["time"], truth["theta"])
    count = 2 * np.pi / 2**14
    np.testing.assert_allclose(log["joint_angle"], theta, atol=0.51 * count + 1e-5)
    np.testing.assert_allclose(log["joint_angle"] / count, np.rint(log["joint_angle"] / count), atol=1e-3)
    belt = shipped.p.K_s * (theta - log["actuator_angle"] / shipped.p.n_T)
    assert np.interp(facts["onset_s"], time, belt) == pytest.approx(
        np.interp(facts["onset_s"], truth["time"], truth["torque"]), abs=3
    )


def test_the_trigger_fires_only_for_a_perturbation_and_before_the_platform_moves(shipped, tmp_path):
    assert not shipped.record(tmp_path / "calm", UNPERTURBED)["analogs"][0, 7].any()
    analogs = shipped.record(tmp_path / "perturbed", PERTURBED)["analogs"][0]
    fired = np.argmax(analogs[7] > 2.5) / 1500
    facts = truth_of(tmp_path / "perturbed")
    assert fired == pytest.approx(facts["command_s"], abs=1 / 1500)
    assert facts["onset_s"] - facts["command_s"] == pytest.approx(shipped.walking.perturbation.latency_s)
    assert truth_of(tmp_path / "calm")["onset_s"] is None


def test_switching_one_effect_off_leaves_the_draws_of_the_others(shipped, tmp_path):
    noisy = shipped.record(tmp_path / "noisy", PERTURBED)
    clean = shipped.lacking("marker_noise").record(tmp_path / "clean", PERTURBED)
    np.testing.assert_array_equal(noisy["analogs"], clean["analogs"])
    np.testing.assert_array_equal(np.isnan(noisy["points"]), np.isnan(clean["points"]))
    difference = (noisy["points"] - clean["points"])[:3]
    assert np.nanstd(difference) == pytest.approx(0.15, rel=0.02)
    quiet = shipped.lacking("force_noise").record(tmp_path / "quiet", PERTURBED)
    np.testing.assert_array_equal(noisy["analogs"][0, 3:], quiet["analogs"][0, 3:])
    force = (noisy["analogs"] - quiet["analogs"])[0, :3]
    assert np.std(force) == pytest.approx(0.4, rel=0.03)
    still = shipped.lacking("moment_noise").record(tmp_path / "still", PERTURBED)
    moment = (noisy["analogs"] - still["analogs"])[0, 3:6]
    assert np.std(moment) == pytest.approx(80, rel=0.03)
    # 4500 independent samples: standard error of a correlation 0.015
    assert np.abs(np.corrcoef(force, moment)[:3, 3:]).max() < 0.06


def test_gaps_are_few_mostly_short_and_marked_as_nexus_marks_them(shipped, tmp_path):
    lengths: list[int] = []
    for i in range(1, 13):
        file = shipped.record(tmp_path, PERTURBED | {"trial": f"walking_{i:02d}"})
        hidden = np.isnan(file["points"][0])
        np.testing.assert_array_equal(hidden, file["meta_points"]["residuals"][0] < 0)
        for row in hidden:
            edges = np.flatnonzero(np.diff(np.concatenate([[0], row, [0]]).astype(int)))
            lengths += (edges[1::2] - edges[::2]).tolist()
    assert 20 < len(lengths) < 80, "4 per crossing on average"
    assert max(lengths) <= 61
    assert np.median(lengths) < 15
    assert not np.isnan(shipped.lacking("marker_gaps").record(tmp_path, PERTURBED)["points"]).any()


def test_a_trial_depends_on_the_seed_and_its_name_only(shipped, tmp_path):
    first, again = tmp_path / "first", tmp_path / "again"
    shipped.record(first, PERTURBED | {"trial": "walking_02"})
    shipped.record(again, PERTURBED)
    shipped.record(again, PERTURBED | {"trial": "walking_02"})
    for name in ("vicon/walking_02.c3d", "leg/walking_02.mcap", "truth/walking_02.parquet", "truth/walking_02.json"):
        assert (first / name).read_bytes() == (again / name).read_bytes(), name
    other = Setup(shipped.settings.model_copy(update={"seed": shipped.settings.seed + 1}), shipped.walking, shipped.p)
    other.record(first, PERTURBED | {"trial": "walking_02"})
    assert (first / "vicon/walking_02.c3d").read_bytes() != (again / "vicon/walking_02.c3d").read_bytes()


def test_the_late_plate_lags_by_half_a_millisecond(shipped, tmp_path):
    off = ("force_noise", "moment_noise", "force_offset", "moment_offset")
    late = shipped.lacking(*off).record(tmp_path / "late", PERTURBED)["analogs"][0, 2]
    prompt = shipped.lacking("plate_lag", *off).record(tmp_path / "prompt", PERTURBED)["analogs"][0, 2]
    slope = np.gradient(prompt, 1 / 1500)
    assert slope @ (prompt - late) / (slope @ slope) == pytest.approx(0.5e-3, rel=0.01)


def test_an_experiment_of_the_bench_is_refused(shipped, tmp_path):
    with pytest.raises(InputError, match=r"belt_01.*'belt'.*walking, plate or static"):
        simulate_walking_trial(
            {"trial": "belt_01", "experiment": "belt"}, shipped.settings, shipped.walking, shipped.p, tmp_path
        )


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "no column 'phase'"),
        ("phase,K_d\n0,100\n1,100\n", "no column 'B_d'"),
        ("phase,K_d,B_d\n0,100,1\n0.9,100,1\n", "from 0 to 0.9; it must rise from 0 to 1"),
        ("phase,K_d,B_d\n0,100,1\n1,abc,1\n", "not a table of numbers"),
        ("phase,K_d,B_d\n0,100,1\n", "fewer than two rows"),
    ],
)
def test_a_bad_impedance_trajectory_is_refused(tmp_path, text, complaint):
    path = tmp_path / "impedance.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=complaint):
        read_impedance_trajectory(path)
    with pytest.raises(InputError, match="no such impedance trajectory"):
        read_impedance_trajectory(tmp_path / "absent.csv")


def test_a_given_equilibrium_is_used(shipped, tmp_path):
    path = tmp_path / "impedance.csv"
    path.write_text("phase,K_d,B_d,theta_eq_rad\n0,300,5,0.05\n1,300,5,0.05\n")
    own = Setup(shipped.settings, shipped.walking.model_copy(update={"impedance": path}), shipped.p)
    np.testing.assert_allclose(own.crossing(False).commands.theta_eq, 0.05 * shipped.p.n_T)


def test_settings_with_a_wrong_duration_or_rate_are_refused(tmp_path):
    text = (ROOT / "config/simulation/walking.yaml").read_text()
    path = tmp_path / "walking.yaml"
    path.write_text(text.replace("recording_s: 3.0", "recording_s: 1.5"))
    with pytest.raises(InputError, match=r"gait.*recording_s must be longer than heel_strike_s \+ stance_s"):
        read_yaml(path, WalkingSettings)
    path.write_text(text.replace("analogs_hz: 1500", "analogs_hz: 1000"))
    with pytest.raises(InputError, match=r"analogs_hz must be a multiple of points_hz \(300\)"):
        read_yaml(path, WalkingSettings)


@pytest.fixture(scope="module")
def walked(shipped):
    return shipped.crossing(perturbed=True)


@pytest.fixture(scope="module")
def calm(shipped):
    return shipped.crossing(perturbed=False)


def inside_stance(crossing):
    phase = crossing.step.stance_phase(crossing.time)
    return (phase > 0.08) & (phase < 0.92)


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


def test_the_ground_gives_the_foot_what_torque_weight_and_inertia_leave(walked, shipped):
    """tau = N - u . M_a, with N of the foot's mass written out as a point mass and a gyration about the axis."""
    foot, rate = walked.motion.foot, shipped.walking.rates.motion_hz
    axis, inside = foot.rotation[:, :, 1], inside_stance(walked)
    mass = shipped.walking.effects.foot_inertia.size
    centre = foot.point(np.array(shipped.walking.foot.centre_of_mass_m))
    acceleration = np.gradient(np.gradient(centre, 1 / rate, axis=0), 1 / rate, axis=0) - GRAVITY
    pitch = np.arctan2(-foot.rotation[:, 2, 0], foot.rotation[:, 2, 2])
    turning = mass * shipped.walking.foot.gyration_m[1] ** 2 * np.gradient(np.gradient(pitch, 1 / rate), 1 / rate)
    needed = turning + np.einsum("ni,ni->n", np.cross(centre - foot.origin, mass * acceleration), axis)
    ground = np.einsum("ni,ni->n", walked.reaction.moment_about(foot.origin), axis)
    np.testing.assert_allclose((needed - ground)[inside], walked.torque[inside], atol=0.02)
    np.testing.assert_allclose(walked.torque[inside], walked.drivetrain_torque[inside], atol=1e-9)


def test_the_flat_foot_is_rigid_on_the_platform(walked):
    phase = walked.step.stance_phase(walked.time)
    flat = (phase > gait.FLAT_FROM) & (phase < gait.FLAT_TO)
    platform, foot = walked.motion.platform.pose, walked.motion.foot
    held = np.einsum("nji,nj->ni", platform.rotation, foot.origin - platform.origin)[flat]
    turned = (platform.rotation.transpose(0, 2, 1) @ foot.rotation)[flat]
    np.testing.assert_allclose(held, np.tile(held[0], (len(held), 1)), atol=1e-9)
    np.testing.assert_allclose(turned, np.tile(turned[0], (len(turned), 1, 1)), atol=1e-9)
    assert np.degrees(np.ptp(walked.motion.platform.angle[flat])) == pytest.approx(5, abs=1e-6)


def test_the_ankle_turns_by_what_the_shank_does_not_yield(walked, calm):
    """4 % of 5 deg, 0.2 s after the onset."""
    held = np.searchsorted(walked.time, walked.motion.platform.onset + 0.25)
    assert np.degrees(walked.motion.theta - calm.motion.theta)[held] == pytest.approx(0.96 * 5, abs=1e-6)


def test_the_foot_stays_above_the_floor(calm, shipped):
    for point in (gait.HEEL, gait.BALL):
        assert calm.motion.foot.point(point)[:, 2].min() > shipped.walking.plate.centre_m[2] - 1e-3


@pytest.mark.parametrize("trial", [f"walking_{i:02d}" for i in range(1, 6)])
def test_the_ground_presses_under_the_foot(shipped, trial):
    crossing = shipped.crossing(perturbed=False, trial=trial)
    inside = inside_stance(crossing)
    below = crossing.motion.foot.origin.copy()
    below[:, 2] = shipped.walking.plate.centre_m[2]
    moment = crossing.reaction.moment_about(below)[inside]
    ahead = -moment[:, 1] / crossing.reaction.force[inside, 2] + below[inside, 0] - below[inside, 0][0]
    assert ahead.min() > -0.12
    assert ahead.max() < 0.20


def test_ankle_moment_and_force_are_those_of_level_walking(calm, shipped):
    phase, mass = calm.step.stance_phase(calm.time), shipped.walking.gait.body_mass_kg
    window = (phase > 0.39) & (phase < 0.53)
    assert 30 < calm.torque[window].mean() < 50
    assert calm.torque[(phase > 0) & (phase < 1)].max() / mass == pytest.approx(1.4, abs=0.15)
    upward = calm.reaction.force[:, 2] / (mass * G)
    assert 1.0 < upward[phase < 0.4].max() < 1.25
    assert upward[(phase > 0.4) & (phase < 0.6)].min() < 0.85
    swing = (phase < 0) | (phase > 1)
    assert not calm.reaction.force[swing].any()
    assert not calm.reaction.moment[swing].any()


def test_step_to_step_variability_has_the_sizes_that_are_set(shipped):
    """Standard deviations over 400 steps are within 15 % (4 sigma) of the sizes."""
    time = motion_grid(shipped.walking)[::300]
    steps = [draw_step(f"walking_{i}", 1, time, shipped.walking) for i in range(400)]
    found = {
        "stance_scatter": 100 * np.std([s.stance for s in steps]) / shipped.walking.gait.stance_s,
        "heel_strike_scatter": np.std([s.heel_strike for s in steps]),
        "angle_scale": 100 * np.std([s.angle_factor for s in steps]),
        "angle_wander": np.degrees(np.std([s.wander for s in steps])),
        "force_scale": 100 * np.std([s.force_factor for s in steps]),
        "placement_forward": 1e3 * np.std([s.placement[0] for s in steps]),
        "placement_sideways": 1e3 * np.std([s.placement[1] for s in steps]),
        "foot_yaw": np.degrees(np.std([s.yaw for s in steps])),
    }
    for name, value in found.items():
        assert value == pytest.approx(getattr(shipped.walking.effects, name).size, rel=0.15), name


def test_a_perturbation_changes_nothing_before_its_onset(walked, calm):
    onset = walked.motion.platform.onset
    before = walked.time <= onset
    for name in ("theta", "omega", "alpha"):
        # the central differences look two samples ahead, twice
        early = before & (walked.time < onset - 5 / 3000)
        np.testing.assert_array_equal(getattr(walked.motion, name)[early], getattr(calm.motion, name)[early])
    early = walked.time < onset - 3e-3  # and the torque between two updates of the controller is interpolated
    np.testing.assert_array_equal(walked.torque[early], calm.torque[early])
    np.testing.assert_array_equal(walked.reaction.moment[early], calm.reaction.moment[early])


def linear_answer(shipped, K_d, B_d, crossing, calm):
    """Torque of the linear drivetrain (Eqs. 7-8) to the perturbation's rotation, integrated apart by scipy."""
    p, gains = shipped.p, compensated_gains(K_d, B_d, shipped.p)
    theta, omega, alpha = (getattr(crossing.motion, n) - getattr(calm.motion, n) for n in ("theta", "omega", "alpha"))
    stiffness = gains.K_1 + p.K_s / p.n_T**2
    A = [[0, 1], [-stiffness / p.J_m, -(p.B_m + gains.B_1) / p.J_m]]
    actuator = StateSpace(A, [[0], [p.K_s / p.n_T / p.J_m]], [[1, 0]], [[0]])
    _, theta_m, _ = lsim(actuator, theta, crossing.time)
    return np.asarray(p.K_s * (theta - theta_m / p.n_T) + p.B_j * omega + p.J_j * alpha)


def test_without_imperfections_the_leg_renders_what_linear_theory_says(shipped):
    ideal = shipped.ideal()
    crossing, calm = ideal.crossing(perturbed=True), ideal.crossing(perturbed=False)
    theory = linear_answer(ideal, 340, 5, crossing, calm)
    onset = crossing.motion.platform.onset
    window = (crossing.time >= onset) & (crossing.time <= onset + 0.1)
    answer = crossing.drivetrain_torque - calm.drivetrain_torque
    np.testing.assert_allclose(answer[window], theory[window], atol=0.1)
    rendered = impedance_of_leg(crossing, calm)
    columns = [(getattr(crossing.motion, n) - getattr(calm.motion, n))[window] for n in ("theta", "omega", "alpha")]
    K, B, inertia = np.linalg.lstsq(np.stack(columns, axis=-1), theory[window], rcond=None)[0]
    assert rendered["K_rendered"] == pytest.approx(K, rel=2e-3)
    assert rendered["B_rendered"] == pytest.approx(B, rel=1e-2)
    assert rendered["I_rendered"] == pytest.approx(inertia, abs=1e-3)


def test_with_imperfections_it_renders_340_within_a_few_percent(walked, calm):
    rendered = impedance_of_leg(walked, calm)
    assert rendered["K_rendered"] == pytest.approx(340, rel=0.04)
    assert rendered["B_rendered"] == pytest.approx(5, rel=0.1)
