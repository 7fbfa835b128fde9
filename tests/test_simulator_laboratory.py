"""The simulated gait laboratory: plate, capture, conditions, gait, platform, recorders; measured from written files."""

import json
from collections import defaultdict
from dataclasses import replace
from itertools import product

import ezc3d
import numpy as np
import polars as pl
import pytest
from conftest import ROOT
from decoded_capture import decoded_crossing
from scipy.signal import StateSpace, lsim
from walking_setup import PERTURBED, STATIC, UNPERTURBED, Setup, leg_log, load_setup

from osl_analysis.config.sheet import read_impedance_trajectory
from osl_analysis.errors import InputError
from osl_analysis.ingest.raw_files import trial_from_files
from osl_analysis.model.compensator import Weight, compensated_gains
from osl_analysis.simulator import step as gait
from osl_analysis.simulator.crossing import impedance_of_leg, move, react, walking_commands
from osl_analysis.simulator.plan import Condition, condition_of, plan_trials
from osl_analysis.simulator.settings import Conditions, Subject
from osl_analysis.simulator.step import GaitTrial, Pose, draw_step, drawn_change, unloaded_platform
from osl_analysis.simulator.vicon import leg_markers, seen_markers
from osl_analysis.simulator.walking_settings import CaptureSettings, Rates, StepChange, WalkingSettings
from osl_analysis.yaml_settings import read_yaml

REAL, G, QUARTERS = ROOT.parent / "shared/real_data/c3d/btk_PiG_Motion3_FF.c3d", 9.81, np.linspace(0, 1, 5)
SENSORS = ("marker_noise", "marker_gaps", "force_noise", "moment_noise", "force_offset", "moment_offset")


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
    experiments = setup.settings.experiments.model_copy(update={"conditions": Conditions(**lists)} | numbers)
    return Setup(setup.settings.model_copy(update={"experiments": experiments}), setup.walking, setup.p)


def altered(setup, **fields):
    return Setup(setup.settings, setup.walking.model_copy(update=fields), setup.p)


def imperfect(setup, **sizes):
    known = setup.walking.effects
    effects = {n: getattr(known, n).model_copy(update={"enabled": True, "size": s}) for n, s in sizes.items()}
    return altered(setup, effects=known.model_copy(update=effects))


def stepping(setup, **change):
    return altered(setup, changes=(StepChange(**change),))


def ramped(setup, **ramp):
    return altered(setup, perturbation=setup.walking.perturbation.model_copy(update=ramp))


def decoded(setup, folder, perturbed=False, trial="walking_01"):
    setup.record(folder, (PERTURBED if perturbed else UNPERTURBED) | {"trial": trial})
    return decoded_crossing(folder / f"vicon/{trial}.c3d")


def captured(setup, folder, row=UNPERTURBED, **capture):
    """Parameters, analogs and points of a recording whose file is as `capture` says."""
    altered(setup, capture=CaptureSettings.model_validate(capture)).record(folder, row)
    file = ezc3d.c3d(str(folder / f"vicon/{row['trial']}.c3d"))
    return file["parameters"], file["data"]["analogs"][0], file["data"]["points"][:3]


def plate_of(folder, trial):
    """Force [N] and moment [N*m] of the plate, (n, 6), as ingest reads them, whose formulas have tests of their own."""
    row = {"trial": trial, "mocap": f"vicon/{trial}.c3d", "mocap_source": "vicon"}
    return trial_from_files(row, folder, ROOT / "config/sources").samples.select("^plate1_.*$").to_numpy()


@pytest.mark.parametrize("kind", [1, 3, 4])
def test_every_type_of_plate_carries_the_wrench_of_type_2(setup, tmp_path, kind):
    captured(setup, tmp_path, PERTURBED)
    expected = plate_of(tmp_path, "walking_01")
    parameters, _, _ = captured(setup, tmp_path, PERTURBED, plate_type=kind)
    loaded, labels = expected[:, 2] > 50, parameters["ANALOG"]["LABELS"]["value"]
    np.testing.assert_allclose(plate_of(tmp_path, "walking_01")[loaded], expected[loaded], atol=2e-3)
    assert (len(labels), labels[-2:]) == (10 if kind == 3 else 8, ["Sync", "Trigger"])


@pytest.mark.parametrize(("effect", "size", "kind", "rows"), [
    ("moment_clip", 50, 2, slice(3, 6)), ("force_clip", 500, 2, slice(0, 3)), ("sensor_clip", 150, 3, slice(0, 8)),
])  # fmt: skip
def test_raw_channels_stop_at_their_rails(setup, tmp_path, effect, size, kind, rows):
    """Exactly the samples beyond the rails change, and no other channel does."""
    free = captured(setup, tmp_path, plate_type=kind)[1]
    seen = captured(imperfect(setup, **{effect: size}), tmp_path, plate_type=kind)[1]
    rail = size * (1e3 if effect == "moment_clip" else 1)
    assert (np.abs(free[rows]) > 1.2 * rail).any()
    free[rows] = np.clip(free[rows], -rail, rail)
    np.testing.assert_allclose(seen, free, rtol=1e-6)


SWAPPED, TURN = {"swapped_labels": [("FOOT1", "FOOT2")]}, np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])


@pytest.mark.parametrize(("capture", "changed"), [
    ({"moment_label": "Nm"}, {"units": lambda units: [*units[:3], "Nm", "Nm", "Nm", *units[6:]]}),
    ({"dead_channels": {"Mx1": -12.0}}, {"analogs": lambda a: np.vstack([a[:3], 0 * a[:1] - 12, a[4:]])}),
    (SWAPPED | {"swapped_in": ["walking_02"]}, {}),
    (SWAPPED | {"swapped_in": ["walking_01"]}, {"labels": lambda labels: [labels[1], labels[0], *labels[2:]]}),
    ({"states_axes": False}, {"screen": lambda _: None}),
    # x stays forward, y is up, z is to the right: (x, y, z) -> (x, z, -y)
    ({"up_axis": "y"}, {"screen": lambda _: ["+Y"], **dict.fromkeys(("points", "corners"), TURN.dot)}),
])  # fmt: skip
def test_a_capture_differs_as_its_switch_says_and_in_nothing_else(setup, tmp_path, capture, changed):
    plain, seen = ({}, {})
    for facts, own in ((plain, {}), (seen, capture)):
        groups, facts["analogs"], points = captured(setup, tmp_path, **own)
        facts["labels"], facts["units"] = groups["POINT"]["LABELS"]["value"], groups["ANALOG"]["UNITS"]["value"]
        facts["screen"] = groups["POINT"].get("Y_SCREEN", {"value": None})["value"]
        facts["corners"], facts["points"] = groups["FORCE_PLATFORM"]["CORNERS"]["value"][:, :, 0], points[:, 0]
    for name, value in plain.items():
        expected = changed[name](value) if name in changed else value
        if isinstance(value, np.ndarray):
            np.testing.assert_allclose(seen[name], expected, atol=1e-3)
        else:
            assert seen[name] == expected


def test_the_second_session_has_other_marker_places_in_its_static_trial_and_crossings(setup):
    """Distances between markers of a foot: equal within a session, and some mm apart between two of them."""
    again = imperfect(with_conditions(setup, {"static": 2, "walking": 2}, sessions=2), marker_placement=5)
    flat, spans = Pose(np.eye(3)[None], np.zeros((1, 3))), []
    for trial, experiment in (("static_1", "static"), ("walking_01", "walking"), ("walking_02", "walking")):
        condition = condition_of({"trial": trial, "experiment": experiment}, again.settings)
        feet = np.array(list(leg_markers(flat, flat, GaitTrial(trial, 1, again.walking, condition)).values()))[:4, 0]
        spans.append(1e3 * np.linalg.norm(feet[:, None] - feet, axis=2)[np.triu_indices(4, 1)])
    np.testing.assert_allclose(spans[0], spans[1], atol=1e-3)
    assert 2 < np.sqrt(np.mean((spans[2] - spans[0]) ** 2)) < 15


def test_a_second_foot_adds_its_force_and_one_partly_beside_the_plate_leaves_some_to_the_floor(setup, usual, tmp_path):
    """20 % of 80 kg at mid-stance, 0.15 m behind and 0.18 m to the left of the nominal ankle (0.24, 0.25)."""
    seen, middle = decoded(stepping(setup, second_foot_percent=20), tmp_path), np.abs(usual.time - 1.26).argmin()
    added = seen.force - usual.force
    assert added[middle, 2] == pytest.approx(0.2 * 80 * G, rel=1e-3)
    assert added[:, 2].argmax() == pytest.approx(middle, abs=1)
    moved = seen.pressure[middle] * seen.force[middle, 2] - usual.pressure[middle] * usual.force[middle, 2]
    np.testing.assert_allclose((moved / added[middle, 2])[:2], [0.09, 0.43], atol=1e-3)
    assert seen.torque[middle] - usual.torque[middle] == pytest.approx(-0.15 * 0.2 * 80 * G, rel=0.02)
    # 30 of 90 mm: two thirds of force and torque; their middle is 30 mm from the edge of the plate, y = 0.
    seen, middle = decoded(stepping(setup, overhang_mm=30), tmp_path), np.abs(usual.time - 1.26).argmin()
    loaded = usual.force[:, 2] > 200
    np.testing.assert_allclose(seen.force[loaded], usual.force[loaded] * 2 / 3, rtol=1e-5)
    np.testing.assert_allclose(seen.torque[loaded], usual.torque[loaded] * 2 / 3, atol=1e-2)
    np.testing.assert_allclose(seen.theta, usual.theta, atol=1e-6)
    assert seen.foot.origin[middle, 1] == pytest.approx(0.015, abs=1e-5)
    assert seen.pressure[middle, 1] == pytest.approx(0.030, abs=5e-3)


@pytest.mark.parametrize(("K_d", "phase"), [(200, 0.2), (480, 0.6)])
def test_a_crossing_has_the_commanded_stiffness_and_is_perturbed_at_the_planned_phase(setup, tmp_path, K_d, phase):
    """K_1 = K_d K_s / (K_s - K_d) / n_T^2: actuator and belt in series. The phase scatters by 0.01; stance: 0.72 s."""
    seen = decoded(with_conditions(setup, K_d=[K_d], B_d=[5], stance_phases=[phase]), tmp_path, True)
    high = np.flatnonzero(seen.analogs[7] > 2.5) / 1500
    assert np.ptp(high) == pytest.approx(0.02, abs=1.1 / 1500)
    fired, gain = high[0], K_d * 685.6 / (685.6 - K_d) / (83 / 18) ** 2
    assert leg_log(tmp_path)["stiffness_gain"].max() == pytest.approx(gain, rel=1e-6)
    with_conditions(setup, K_d=[K_d], B_d=[4]).record(tmp_path, PERTURBED | {"controller": "uncompensated"})
    assert leg_log(tmp_path)["damping_gain"].max() == pytest.approx(4 / (83 / 18) ** 2, rel=1e-6)
    assert leg_log(tmp_path)["stiffness_gain"].max() == pytest.approx(K_d / (83 / 18) ** 2, rel=1e-6)
    assert (fired - 0.9) / 0.72 == pytest.approx(phase, abs=0.011)
    assert seen.time[np.abs(seen.platform_angle) > 1e-4][0] > fired + 0.004


def crossings_of(settings):
    """The sheet's rows of the crossings, and their conditions."""
    rows = [row for row in plan_trials(settings).values() if row["experiment"] == "walking"]
    return rows, [condition_of(row, settings) for row in rows]


def test_every_combination_is_planned_equally_often_and_what_the_sheet_states_is_simulated(setup):
    lists = {"directions": ("up", "down"), "K_d": (200.0, 480.0), "stance_phases": (0.2, 0.4, 0.6)}
    rows, _ = crossings_of(with_conditions(setup, {"walking": 100, "perturbed_share": 0.1}).settings)
    assert 1 < sum(row["perturbed"] for row in rows) < 25
    rows, found = crossings_of(with_conditions(setup, **lists).settings)
    drawn = [(c.direction, c.K_d, c.stance_phase) for c in found]
    assert sorted(drawn) == sorted(2 * list(product(*lists.values())))
    assert drawn[:12] != drawn[12:], "in no simple order"
    assert {row["K_d"] for row in rows} == {None}, "left unsaid"
    stated, found = crossings_of(with_conditions(setup, **lists, stated=("K_d", "group", "direction")).settings)
    for row, condition in zip(stated, found, strict=True):
        group = f"{condition.direction}_K{condition.K_d:g}_{100 * condition.stance_phase:.0f}"
        assert (row["K_d"], row["group"]) == (condition.K_d, group)
        assert row["direction"] == (condition.direction if row["perturbed"] else None)
    own = condition_of(stated[0] | {"perturbed": True, "K_d": 123.0, "B_d": 4.5, "direction": "down"}, setup.settings)
    assert (own.K_d, own.B_d, own.direction, own.perturbed) == (123.0, 4.5, "down", True)
    with pytest.raises(InputError, match="the plan has two trials 'impedance_K300_B"):
        plan_trials(with_conditions(setup, {"K_d": (300.0, 300.0001)}).settings)


def test_persons_and_sessions_follow_each_other_in_equal_blocks(setup, tmp_path):
    people = [Subject(name="A", body_mass_kg=60, stance_s=0.6), Subject(name="B", body_mass_kg=90, stance_s=0.8)]
    columns = ("subject", "session", "body_mass_kg", "side")
    mixed = with_conditions(setup, subjects=people, sessions=2, stated=columns)
    rows, found = crossings_of(mixed.settings)
    assert [c.subject.name for c in found] == 12 * ["A"] + 12 * ["B"]
    assert [c.session for c in found] == 2 * (6 * [1] + 6 * [2])
    assert [[rows[k][name] for name in columns] for k in (0, -1)] == [["A", "1", 60, "right"], ["B", "2", 90, "right"]]
    light, heavy = (decoded(mixed, tmp_path, False, trial) for trial in ("walking_01", "walking_24"))
    stated, plain = (captured(mixed, tmp_path, STATIC, states_body_mass=True)[0], captured(setup, tmp_path, STATIC)[0])
    assert (stated["SUBJECTS"]["NAMES"]["value"], stated["PROCESSING"]["BODYMASS"]["value"][0]) == (["A"], 60)
    alone = captured(mixed, tmp_path, {"trial": "plate_01", "experiment": "plate"}, states_body_mass=True)[0]
    assert not {"PROCESSING", "SUBJECTS"} & {*plain, *alone}, "nobody stands on the plate"
    stood = plate_of(tmp_path, "static_1")  # half of 80 kg above the ankle, 60 mm behind the middle of the plate
    np.testing.assert_allclose(stood, np.outer(np.ones(4500), 40 * G * np.array([0, 0, 1, 0, 0.06, 0])), atol=1e-3)
    assert light.force[:, 2].max() / heavy.force[:, 2].max() == pytest.approx(60 / 90, rel=1e-3)
    assert np.ptp(light.stance) / np.ptp(heavy.stance) == pytest.approx(0.6 / 0.8, abs=0.01)  # one frame of 0.6 s


def test_load_amplitude_and_slowness_are_factors_of_torque_angle_and_time(setup, usual, tmp_path):
    changes = ({"load": 0.7}, {"amplitude": 0.8}, {"slower_percent": 10})
    light, small, slow = (decoded(stepping(setup, **change), tmp_path) for change in changes)
    middle, level = usual.force[:, 2] > 400, np.abs(usual.time - 0.9 - 0.46 * 0.72) < 0.1 * 0.72
    np.testing.assert_allclose(light.force[middle] / usual.force[middle], 0.7, rtol=1e-4)
    np.testing.assert_allclose(light.theta, usual.theta, atol=1e-6)
    # damping and the actuator's inertia follow the angle, which is the same: 2 N*m where the impedance is constant
    np.testing.assert_allclose(light.torque[level], 0.7 * usual.torque[level], atol=2)
    np.testing.assert_allclose(small.theta, 0.8 * usual.theta, atol=1e-6)
    np.testing.assert_allclose(small.torque[middle], 0.8 * usual.torque[middle], atol=1e-2)
    later, inside = 0.9 + (usual.time - 0.9) * 1.1, (usual.time > 0.95) & (usual.time < 1.55)
    np.testing.assert_allclose(np.interp(later, slow.time, slow.theta)[inside], usual.theta[inside], atol=1e-3)


@pytest.mark.parametrize("percent", [-8.0, 8.0])
def test_stance_changes_only_after_the_window(setup, tmp_path, percent):
    changes = ({"after_window_percent": p, "of": "perturbed"} for p in (percent, 0.0))
    moved, same = (decoded(stepping(setup, **change), tmp_path, True) for change in changes)
    onset = same.time[np.abs(same.platform_angle) > 1e-4][0]
    before = same.time < onset + 0.095  # a curve with three derivatives starts at 100 ms
    np.testing.assert_allclose(moved.torque[before], same.torque[before], atol=1e-3)
    np.testing.assert_allclose(moved.force[before], same.force[before], atol=1e-3)
    assert moved.stance[1] - same.stance[1] == pytest.approx(0.01 * percent * 0.72, abs=0.007)
    assert moved.stance[0] == same.stance[0]
    with pytest.raises(InputError, match="trial walking_01: after_window_percent 90 leaves"):
        decoded(stepping(setup, after_window_percent=90), tmp_path, True)


def test_the_torque_wanders_by_the_size_and_the_angle_stays(setup, usual, tmp_path):
    """Slow waves: the leg follows its equilibrium. RMS over 8 crossings, with 30 % for the few waves in one stance."""
    seen = [decoded(imperfect(setup, torque_wander=4), tmp_path, trial=f"walking_{k:02d}") for k in range(1, 9)]
    np.testing.assert_allclose([one.theta for one in seen], 8 * [usual.theta], atol=1e-6)
    errors = np.array([one.torque - usual.torque for one in seen])[:, usual.force[:, 2] > 400]
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(4, rel=0.3)


def test_a_change_concerns_the_named_crossings_or_a_share_of_a_kind(setup):
    some = StepChange(of="unperturbed", share=0.3, load=0.7, slower_percent=5)
    lab = altered(setup, changes=(some, StepChange(of=("walking_03",), load=0.5, slower_percent=5))).walking
    trials = [f"walking_{i:02d}" for i in range(400)]
    drawn = [drawn_change(GaitTrial(trial, 1, lab, Condition(perturbed=False))) for trial in trials]
    assert np.mean([one.load in (0.7, 0.35) for one in drawn]) == pytest.approx(0.3, abs=0.09)
    perturbed = [drawn_change(GaitTrial(trial, 1, lab, Condition(perturbed=True))).load for trial in trials[:50]]
    assert [k for k, load in enumerate(perturbed) if load != 1] == [3]
    assert (drawn[3].load, drawn[3].slower_percent) in ((0.5, 5), (0.35, 10))


def test_a_platform_turns_about_the_axis_in_its_depth_and_a_shift_turns_the_leg_over_it(setup, tmp_path):
    """The point 0.12 m below the surface and below the nominal ankle (x = 0.24 m) stays; one at the ankle does not."""
    platform = decoded(ramped(setup, axis_depth_m=0.12), tmp_path, True).platform
    axis, ankle = (platform.point(np.array([0.24, 0.25, z])) for z in (-0.12, 0.08))
    np.testing.assert_allclose(axis, np.tile(axis[0], (len(axis), 1)), atol=1e-5)
    assert np.ptp(ankle[:, 0]) == pytest.approx(0.20 * np.sin(np.radians(5)), rel=1e-3)
    shifted = ramped(setup, shift_mm=50.0, leg_length_m=0.9)
    moved, still = decoded(shifted, tmp_path, True), decoded(shifted, tmp_path)
    travel, turned = moved.platform.point(np.array([0.3, 0.25, 0.0]))[:, 0], moved.theta - still.theta
    np.testing.assert_allclose(moved.platform_angle, 0, atol=1e-6)
    assert travel.min() - travel[0] == pytest.approx(-0.05, abs=1e-5)
    ramp = (moved.time > 1.15) & (moved.time < 1.35)
    np.testing.assert_allclose(turned[ramp], (travel[0] - travel[ramp]) / 0.9, atol=1e-5)
    down = unloaded_platform(GaitTrial("plate_01", 1, shifted.walking, Condition(direction="down")))
    assert (down.shift[:, 0].min(), down.shift[:, 0].max() > 0.04) == (0, True), "forward"


def test_a_heaving_platform_rises_in_the_middle_of_its_way_and_a_slipping_foot_slides_back(setup, tmp_path):
    seen, still = (decoded(lab, tmp_path, True) for lab in (imperfect(setup, platform_heave=3, foot_slip=4), setup))
    ankle, angle = np.array([0.24, 0.25, 0.08]), np.degrees(seen.platform_angle)
    raised = 1e3 * (seen.platform.point(ankle) - still.platform.point(ankle))[:, 2]
    moved = 1e3 * (seen.foot.origin - still.foot.origin)
    assert (raised.max(), angle[raised.argmax()]) == (pytest.approx(3, abs=0.05), pytest.approx(2.5, abs=0.5))
    np.testing.assert_allclose(raised[angle > 4.999], 0, atol=0.01)
    assert moved[:, 2].max() == pytest.approx(3, abs=0.1), "the foot is carried"
    assert moved[:, 0].min() == pytest.approx(-4 * np.cos(np.radians(5)), abs=0.01)


def unloaded_ramps(setup, trials):
    """Times [s], and the motions of unloaded platforms."""
    found = [GaitTrial(f"plate_{k + 1:02d}", 1, setup.walking) for k in range(trials)]
    return found[0].time, [unloaded_platform(trial) for trial in found]


def test_ramps_differ_by_their_scatter_and_unloaded_trials_move_the_plate_about_every_axis_now_and_then(setup, shipped):
    """Time from 10 to 90 % of 60 ramps, and from trigger to onset: within 30 % (3 sigma)."""
    plain = ramped(setup, same_unloaded=True)
    time, ramps = unloaded_ramps(imperfect(plain, rise_scatter=8, trigger_scatter=2), 60)
    rises = [np.ptp(time[(a > 0.5) & (a < 4.5) & (time < 0.8)]) for a in (np.degrees(ramp.angle) for ramp in ramps)]
    starts = [time[np.abs(r.angle) > 1e-9][0] - r.command for r in ramps]
    assert np.std(rises) / np.mean(rises) == pytest.approx(0.08, rel=0.3)
    assert (1e3 * np.std(starts), np.mean(starts)) == (pytest.approx(2, rel=0.3), pytest.approx(0.004, abs=0.0015))
    smooth, shivering = (unloaded_ramps(lab, 40)[1] for lab in (plain, imperfect(plain, servo_shiver=0.1)))
    rest = np.degrees([ramp.angle - smooth[0].angle for ramp in shivering])
    assert np.sqrt(np.mean(rest[:, (time > 0.56) & (time < 0.64)] ** 2)) == pytest.approx(0.1, rel=0.25)
    assert not rest[:, (time < 0.5) | (time > 0.9)].any()
    ramps = unloaded_ramps(shipped, 6)[1]
    spans = np.array([np.ptp(r.pose.point(shipped.walking.plate.centre_m), axis=0) for r in ramps])
    rolls = np.array([np.ptp(r.pose.rotation[:, 2, 1]) for r in ramps])
    assert rolls == pytest.approx(np.sin(np.radians([0, 0, 2, 0, 0, 2])), abs=1e-6)
    assert (spans[[2, 5]] > 5e-3).all()
    tops = np.degrees([r.angle.max() for r in ramps])
    assert (len(set(tops.round(3))), tops.min() > 4, tops.max() < 6) == (6, True, True)
    assert all(abs(r.angle[-1]) < 1e-9 and abs(r.angle[0]) < 1e-9 for r in ramps)


def test_an_exact_analysis_of_the_recording_gives_back_angle_and_torque(shipped, tmp_path):
    """Gait varies, sensors are perfect and nothing but the foot has mass: what remains is rounding to float32."""
    seen = decoded(shipped.lacking("plate_inertia", "plate_lag", "foot_inertia", *SENSORS), tmp_path, True)
    truth, inside = pl.read_parquet(tmp_path / "truth/walking_01.parquet")[::5], seen.force[:, 2] > 400
    np.testing.assert_allclose(seen.theta, truth["theta"], atol=1e-6)
    np.testing.assert_allclose(seen.torque[inside], truth["torque"].to_numpy()[inside], atol=2e-3)
    assert 90 < seen.torque.max() < 150


def test_recorders_see_the_same_edges_and_joint_through_the_leg_s_clock_and_a_late_plate_lags(shipped, tmp_path):
    analogs, count = shipped.record(tmp_path, PERTURBED)["analogs"][0], 2 * np.pi / 2**14
    log, facts = leg_log(tmp_path), json.loads((tmp_path / "truth/walking_01.json").read_text())
    truth = pl.read_parquet(tmp_path / "truth/walking_01.parquet")
    offset, drift = facts["leg_clock"].values()
    assert (2.5 < offset < 7.5, 0 < abs(drift) < 2e-4) == (True, True)
    np.testing.assert_allclose(np.diff(log["time"]), 1 / 500, atol=1e-6)
    time = (log["time"] - offset) / (1 + drift)
    vicon, leg = np.flatnonzero(np.diff(analogs[6] > 2.5)) / 1500, time[np.flatnonzero(np.diff(log["sync"]))]
    assert len(leg) > 12
    np.testing.assert_allclose(leg, vicon, rtol=0, atol=1 / 500)
    assert np.ptp(np.diff(vicon)) > 0.05, "irregular, so that a shift by a period shows"
    theta, torque = (np.interp(time, truth["time"], truth[name]) for name in ("theta", "torque"))
    np.testing.assert_allclose(log["joint_angle"], theta, atol=0.51 * count + 1e-5)
    effects, step = shipped.settings.effects, draw_step(GaitTrial("walking_01", shipped.settings.seed, shipped.walking))
    steps = {"actuator_angle": effects.actuator_encoder.value, "motor_current": effects.current_quantisation.value}
    for name, size in (steps | {"joint_angle": count}).items():
        np.testing.assert_allclose(log[name] / size, np.rint(log[name] / size), atol=5e-3)
    assert all(facts[f"{name}_s"] == getattr(step, name) for name in ("command", "onset", "heel_strike", "toe_off"))
    belt = shipped.p.K_s * (theta - log["actuator_angle"] / shipped.p.n_T)
    assert np.interp(facts["onset_s"], time, belt - torque) == pytest.approx(0, abs=3)
    labs = (shipped.lacking(*SENSORS[2:], *lag) for lag in ((), ("plate_lag",)))
    late, prompt = (lab.record(tmp_path, PERTURBED)["analogs"][0, :6] for lab in labs)
    assert np.abs(prompt[:, :600]).max() < 1e-3, "of 12 kg, and its moment"
    slope = np.gradient(prompt[2], 1 / 1500)
    assert slope @ (prompt - late)[2] / (slope @ slope) == pytest.approx(0.5e-3, rel=0.01)


def test_switching_one_effect_off_leaves_the_draws_of_the_others_and_gaps_are_few_and_mostly_short(shipped, tmp_path):
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
    assert (np.std(noise[:3]), np.std(noise[3:6])) == (pytest.approx(0.4, rel=0.03), pytest.approx(80, rel=0.03))
    # 4500 independent samples: standard error of a correlation 0.015
    assert np.abs(np.corrcoef(noise[:6]) - np.eye(6)).max() < 0.06
    trials = [GaitTrial(f"walking_{i:02d}", 1, shipped.walking) for i in range(1, 13)]
    hidden = np.array([np.isnan(seen_markers(one, np.zeros((900, 12, 3)))[..., 0]).T for one in trials])
    lengths = np.diff(np.flatnonzero(np.diff(hidden, axis=-1, prepend=0, append=0)))[::2]
    assert (20 < len(lengths) < 80, lengths.max() <= 61, np.median(lengths) < 15) == (True, True, True)


def test_a_trial_depends_on_the_seed_and_its_name_only(shipped, tmp_path):
    row, other = PERTURBED | {"trial": "walking_02"}, shipped.settings.model_copy(update={"seed": 7})
    shipped.record(tmp_path / "again", PERTURBED)
    for folder, seed in (("first", shipped.settings), ("again", shipped.settings), ("other", other)):
        Setup(seed, shipped.walking, shipped.p).record(tmp_path / folder, row)
    for name in ("vicon/walking_02.c3d", "leg/walking_02.mcap", "truth/walking_02.parquet", "truth/walking_02.json"):
        first, again, seeded = ((tmp_path / folder / name).read_bytes() for folder in ("first", "again", "other"))
        assert first == again != seeded, name


def test_a_bad_impedance_trajectory_and_a_wrong_duration_or_rate_are_refused(tmp_path):
    for text, said in (
        ("phase,K_d\n0,100\n1,100\n", "no column 'B_d'"), ("phase,K_d,B_d\n0,1,1\n", "fewer than two rows"),
        ("phase,K_d,B_d\n0,100,1\n0.9,100,1\n", "from 0 to 0.9; it must rise from 0 to 1"),
        ("phase,K_d,B_d\n0,100,1\n0.5,100,1\n0.5,200,1\n1,100,1\n", "it must rise from 0 to 1"),
        ("phase,K_d,B_d\n0.1,1,1\n1,1,1\n", "from 0.1 to 1; it must"), ("phase,K_d,B_d\n0,1,1\n1,1,nan\n", "B_d holds"),
        ("phase,K_d,B_d\n0,1,1\n1,a,1\n", "not a table of numbers"),
        ("phase,K_d,B_d,K_d\n0,1,1,1\n", "'K_d' stands twice"),
    ):  # fmt: skip
        (tmp_path / "impedance.csv").write_text(text)
        with pytest.raises(InputError, match=said):
            read_impedance_trajectory(tmp_path / "impedance.csv")
    with pytest.raises(InputError, match=r"none.csv: no such impedance trajectory; correct its path in the configurat"):
        read_impedance_trajectory(tmp_path / "none.csv")
    text = (ROOT / "config/simulation/walking.yaml").read_text()
    for right, wrong, said in (
        ("recording_s: 3.0", "recording_s: 1.5", r"gait.*stance_s = .* is not below recording_s = 1.5"),
        ("analogs_hz: 1500", "analogs_hz: 1000", r"analogs_hz must be a multiple of points_hz \(300\)"),
        ("[0.38, 0.40]", "[0.41, 0.40]", "stance_phase falls; write the lower first"),
    ):
        (tmp_path / "walking.yaml").write_text(text.replace(right, wrong))
        with pytest.raises(InputError, match=said):
            read_yaml(tmp_path / "walking.yaml", WalkingSettings)
    (tmp_path / "walking.yaml").write_text(text.replace("[0.38, 0.40]", "[0.40, 0.40]"))  # every time the same
    read_yaml(tmp_path / "walking.yaml", WalkingSettings)


def test_a_given_equilibrium_and_a_weight_of_the_gains_are_used(shipped, tmp_path):
    path = tmp_path / "impedance.csv"
    path.write_text("phase,K_d,B_d,theta_eq_rad\n0,300,5,0.05\n1,300,5,0.05\n")
    own = altered(shipped, impedance=path, gain_weight=(weight := Weight(cutoff_hz=1, order=1)))
    gains = compensated_gains(300, 5, shipped.p, weight)
    trials = (GaitTrial("walking_01", 1, lab.walking) for lab in (own, stepping(own, load=0.5)))
    usual, light = (walking_commands(draw_step(trial), True, shipped.p) for trial in trials)
    expected = np.array([[gains.K_1], [gains.B_1], [0.05 * shipped.p.n_T]])
    np.testing.assert_allclose(usual, np.broadcast_to(expected, usual.shape))
    assert (light - usual)[2].max() == pytest.approx(0.5 * 1.4 * 80 / 300 * shipped.p.n_T, rel=0.1)


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
    shipped = altered(imperfect(shipped, load_scatter=3, amplitude_scatter=5, timing_wander=1), rates=coarse)
    found = defaultdict(list)
    for i in range(400):
        step = draw_step(GaitTrial(f"walking_{i}", 1, shipped.lacking("angle_wander").walking))
        motion, foot, *_ = move(step, False)
        time, load, amplitude = step.trial.time, step.change.load, step.change.amplitude
        middle, straight = np.searchsorted(time, step.heel_strike + step.stance / 2), foot.rotation[0]
        phase = step.stance_phase(step.heel_strike + QUARTERS * step.stance) - QUARTERS
        assert phase[[0, -1]] == pytest.approx(0, abs=1e-12), "heel strike and toe-off stay"
        force = react(step, foot, 0 * time)[1].force[middle] / (load * amplitude * 80 * G)
        usual = amplitude * gait.nominal_ankle_angle(step.cycle_phase(time))[middle]
        wandering = replace(step, trial=replace(step.trial, walking=shipped.walking))
        found["stance_scatter"].append(100 * step.stance / 0.72)
        found["heel_strike_scatter"].append(step.heel_strike)
        found["angle_scale"].append(100 * motion.theta[middle] / usual)
        found["angle_wander"].append(np.degrees(move(wandering, False)[0].theta - motion.theta))
        found["force_scale"].append(100 * force / gait.ground_reaction(step.stance_phase(time[[middle]]))[0])
        found["placement_forward"].append(1e3 * step.placement[0])
        found["placement_sideways"].append(1e3 * step.placement[1])
        found["foot_yaw"].append(np.degrees(np.arctan2(straight[1, 0], straight[0, 0])))
        found["load_scatter"].append(100 * load)
        found["amplitude_scatter"].append(100 * amplitude)
        found["timing_wander"].append([100 * phase[2], 50 * (phase[3] - phase[1]) / (256 * 0.1875**4)])
    for name, values in found.items():
        assert np.std(values) == pytest.approx(getattr(shipped.walking.effects, name).size, rel=0.15), name


def test_a_perturbation_changes_nothing_before_its_onset_and_turns_the_ankle_as_far_as_the_shank_stays(walked, calm):
    """4 % of 5 deg, 0.2 s after the onset."""
    onset, added = walked.platform.onset, np.degrees(walked.motion.theta - calm.motion.theta)
    for name in ("theta", "omega", "alpha"):
        early = walked.time < onset - 5 / 3000  # the central differences look two samples ahead, twice
        np.testing.assert_array_equal(getattr(walked.motion, name)[early], getattr(calm.motion, name)[early])
    early = walked.time < onset - 3e-3  # and the torque between two updates of the controller is interpolated
    np.testing.assert_array_equal(walked.torque[early], calm.torque[early])
    assert added[np.searchsorted(walked.time, onset + 0.25)] == pytest.approx(0.96 * 5, abs=1e-6)
    ramp, down = walked.step.trial.walking.perturbation, replace(walked.step.trial, condition=Condition(True, "down"))
    half_way = walked.step.toe_off + ramp.hold_s + ramp.return_s / 2
    assert np.interp(half_way, walked.time, np.degrees(walked.platform.angle)) == pytest.approx(2.5, abs=1e-3)
    down = draw_step(down)
    turned = np.degrees(move(down, True)[0].theta - move(down, False)[0].theta)
    assert turned[np.searchsorted(walked.time, onset + 0.25)] == pytest.approx(-0.96 * 5, abs=1e-6)


def test_the_leg_renders_what_linear_theory_says_and_340_within_a_few_percent_with_imperfections(setup, walked, calm):
    """The linear drivetrain (Eqs. 7-8) under the perturbation's rotation, integrated apart by scipy."""
    p, gains, crossing, still = setup.p, compensated_gains(340, 5, setup.p), setup.crossing(True), setup.crossing(False)
    moved = np.array(list(vars(crossing.motion).values())) - np.array(list(vars(still.motion).values()))
    A = [[0, 1], [-(gains.K_1 + p.K_s / p.n_T**2) / p.J_m, -(p.B_m + gains.B_1) / p.J_m]]
    theta_m = lsim(StateSpace(A, [[0], [p.K_s / p.n_T / p.J_m]], [[1, 0]], [[0]]), moved[0], crossing.time)[1]
    theory = p.K_s * (moved[0] - theta_m / p.n_T) + p.B_j * moved[1] + p.J_j * moved[2]
    since = crossing.time - crossing.platform.onset
    window = (since >= 0) & (since <= 0.1)
    K, B, inertia = np.linalg.lstsq(moved.T[window], theory[window])[0]
    found = np.array(list(impedance_of_leg(crossing, still).values()))
    assert np.all(np.abs(found - [K, B, inertia]) < [2e-3 * K, 1e-2 * B, 1e-3])
    assert impedance_of_leg(walked, calm)["K_rendered"] == pytest.approx(340, rel=0.04)


@pytest.mark.skipif(not REAL.exists(), reason="public sample recordings are not on this machine")
def test_every_force_plate_parameter_of_a_nexus_file_is_there_with_its_type_and_sign(setup, tmp_path):
    ours = captured(setup, tmp_path, STATIC)[0]["FORCE_PLATFORM"]
    nexus = ezc3d.c3d(str(REAL))["parameters"]["FORCE_PLATFORM"]
    for name in set(nexus) - {"__METADATA__"}:
        assert ours[name]["type"] == nexus[name]["type"], name
    assert np.sign(ours["ORIGIN"]["value"][2, 0]) == np.sign(nexus["ORIGIN"]["value"][2, 0])


def test_a_person_who_reacts_adds_the_stated_torque_from_the_delay_on_and_else_nothing(shipped, calm, walked):
    """Where the angle is that of the leg alone, the torque is the leg's and the reaction's."""
    onset, time, spent = walked.step.onset, walked.time, walked.step.stance_phase(walked.time)
    turned, speed = (getattr(walked.motion, n) - getattr(calm.motion, n) for n in ("theta", "omega"))
    middle = (spent > 0.1) & (spent < 0.9)
    late = np.interp(time - 0.05, time, speed)
    for change, added in (
        ({"reflex": 4.0}, 4.0 * late),
        (
            {"co_contraction": 1.4, "co_contracted": 300.0},
            120.0 * gait.smooth_step((time - onset - 0.05) / 0.03) * turned,
        ),
        ({"voluntary_nm": 6.0, "reaction_delay_s": 0.08}, 6.0 * gait.smooth_step((time - onset - 0.08) / 0.1)),
    ):
        reacts = stepping(shipped, **change).crossing(perturbed=True)
        np.testing.assert_array_equal(reacts.motion.theta, walked.motion.theta)
        np.testing.assert_allclose((reacts.torque - walked.torque)[middle], added[middle], atol=1e-5)
        np.testing.assert_array_equal(reacts.drivetrain_torque, walked.drivetrain_torque)
        still = stepping(shipped, **change).crossing(perturbed=False)
        np.testing.assert_array_equal(still.torque, calm.torque)
    for percent in (25.0, -20.0):
        step = stepping(shipped, pace_percent=percent).crossing(perturbed=True).step
        phase, before = step.stance_phase(time), time < onset + 0.05
        assert step.stance_phase(np.array([step.toe_off])) == pytest.approx(1)
        np.testing.assert_array_equal(phase[before], spent[before])
        rate = np.gradient(phase, time) / np.gradient(spent, time)
        assert rate[(time > onset + 0.11) & (time < onset + 0.15)] == pytest.approx(1 + percent / 100, rel=0.02)
