"""Recorders, clocks and random draws of the simulated gait laboratory, and the settings that it refuses."""

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from conftest import ROOT
from walking_setup import PERTURBED, UNPERTURBED, Setup, leg_log, load_setup

from osl_analysis.errors import InputError
from osl_analysis.shared_choices import read_impedance_trajectory
from osl_analysis.simulator.walking import simulate_walking_trial
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.yaml_settings import read_yaml


@pytest.fixture(scope="module")
def setup() -> Setup:
    return load_setup()


def test_both_recorders_see_the_same_sync_edges_through_the_leg_s_clock(setup: Setup, tmp_path: Path) -> None:
    analogs = setup.record(tmp_path, PERTURBED)["analogs"][0]
    log, clock = leg_log(tmp_path), json.loads((tmp_path / "truth/walking_01.json").read_text())["leg_clock"]
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


def test_the_leg_logs_its_joint_and_gains(setup: Setup, tmp_path: Path) -> None:
    setup.record(tmp_path, PERTURBED)
    log, facts = leg_log(tmp_path), json.loads((tmp_path / "truth/walking_01.json").read_text())
    truth = pl.read_parquet(tmp_path / "truth/walking_01.parquet")
    time = (log["time"] - facts["leg_clock"]["offset_s"]) / (1 + facts["leg_clock"]["drift"])
    theta = np.interp(time, truth["time"], truth["theta"])
    count = 2 * np.pi / 2**14
    np.testing.assert_allclose(log["joint_angle"], theta, atol=0.51 * count + 1e-5)
    np.testing.assert_allclose(log["joint_angle"] / count, np.rint(log["joint_angle"] / count), atol=1e-3)
    K_1 = 340 * setup.p.K_s / (setup.p.n_T**2 * (setup.p.K_s - 340))
    assert log["stiffness_gain"].max() == pytest.approx(K_1, rel=1e-6)
    belt = setup.p.K_s * (theta - log["actuator_angle"] / setup.p.n_T)
    assert np.interp(facts["onset_s"], time, belt) == pytest.approx(
        np.interp(facts["onset_s"], truth["time"], truth["torque"]), abs=3
    )


def test_the_trigger_fires_only_for_a_perturbation_and_before_the_platform_moves(setup: Setup, tmp_path: Path) -> None:
    assert not setup.record(tmp_path / "calm", UNPERTURBED)["analogs"][0, 7].any()
    analogs = setup.record(tmp_path / "perturbed", PERTURBED)["analogs"][0]
    fired = np.argmax(analogs[7] > 2.5) / 1500
    facts = json.loads((tmp_path / "perturbed/truth/walking_01.json").read_text())
    assert fired == pytest.approx(facts["command_s"], abs=1 / 1500)
    assert facts["onset_s"] - facts["command_s"] == pytest.approx(setup.walking.perturbation.latency_s)
    assert json.loads((tmp_path / "calm/truth/walking_01.json").read_text())["onset_s"] is None


def test_switching_one_effect_off_leaves_the_draws_of_the_others(setup: Setup, tmp_path: Path) -> None:
    noisy = setup.record(tmp_path / "noisy", PERTURBED)
    clean = setup.lacking("marker_noise").record(tmp_path / "clean", PERTURBED)
    np.testing.assert_array_equal(noisy["analogs"], clean["analogs"])
    np.testing.assert_array_equal(np.isnan(noisy["points"]), np.isnan(clean["points"]))
    difference = (noisy["points"] - clean["points"])[:3]
    assert np.nanstd(difference) == pytest.approx(0.15, rel=0.02)
    quiet = setup.lacking("force_noise").record(tmp_path / "quiet", PERTURBED)
    np.testing.assert_array_equal(noisy["analogs"][0, 3:], quiet["analogs"][0, 3:])
    force = (noisy["analogs"] - quiet["analogs"])[0, :3]
    assert np.std(force) == pytest.approx(0.4, rel=0.03)
    still = setup.lacking("moment_noise").record(tmp_path / "still", PERTURBED)
    moment = (noisy["analogs"] - still["analogs"])[0, 3:6]
    assert np.std(moment) == pytest.approx(80, rel=0.03)
    # 4500 independent samples: standard error of a correlation 0.015
    assert np.abs(np.corrcoef(force, moment)[:3, 3:]).max() < 0.06


def test_gaps_are_few_mostly_short_and_marked_as_nexus_marks_them(setup: Setup, tmp_path: Path) -> None:
    lengths: list[int] = []
    for i in range(1, 13):
        file = setup.record(tmp_path, PERTURBED | {"trial": f"walking_{i:02d}"})
        hidden = np.isnan(file["points"][0])
        np.testing.assert_array_equal(hidden, file["meta_points"]["residuals"][0] < 0)
        for row in hidden:
            edges = np.flatnonzero(np.diff(np.concatenate([[0], row, [0]]).astype(int)))
            lengths += (edges[1::2] - edges[::2]).tolist()
    assert 20 < len(lengths) < 80, "4 per crossing on average"
    assert max(lengths) <= 61
    assert np.median(lengths) < 15
    assert not np.isnan(setup.lacking("marker_gaps").record(tmp_path, PERTURBED)["points"]).any()


def test_a_trial_depends_on_the_seed_and_its_name_only(setup: Setup, tmp_path: Path) -> None:
    first, again = tmp_path / "first", tmp_path / "again"
    setup.record(first, PERTURBED | {"trial": "walking_02"})
    setup.record(again, PERTURBED)
    setup.record(again, PERTURBED | {"trial": "walking_02"})
    for name in ("vicon/walking_02.c3d", "leg/walking_02.mcap", "truth/walking_02.parquet", "truth/walking_02.json"):
        assert (first / name).read_bytes() == (again / name).read_bytes(), name
    other = Setup(setup.settings.model_copy(update={"seed": setup.settings.seed + 1}), setup.walking, setup.p)
    other.record(first, PERTURBED | {"trial": "walking_02"})
    assert (first / "vicon/walking_02.c3d").read_bytes() != (again / "vicon/walking_02.c3d").read_bytes()


def test_a_slipping_foot_slides_back_and_is_off_by_default(setup: Setup) -> None:
    assert not setup.walking.effects.foot_slip.enabled
    slip = setup.walking.effects.foot_slip.model_copy(update={"enabled": True})
    effects = setup.walking.effects.model_copy(update={"foot_slip": slip})
    slid = Setup(setup.settings, setup.walking.model_copy(update={"effects": effects}), setup.p).crossing(True)
    moved = slid.motion.foot.origin - setup.crossing(True).motion.foot.origin
    assert np.linalg.norm(moved, axis=1).max() == pytest.approx(3e-3, rel=1e-3)
    assert moved[:, 0].min() < -2.9e-3


def test_the_late_plate_lags_by_half_a_millisecond(setup: Setup, tmp_path: Path) -> None:
    off = ("force_noise", "moment_noise", "force_offset", "moment_offset")
    late = setup.lacking(*off).record(tmp_path / "late", PERTURBED)["analogs"][0, 2]
    prompt = setup.lacking("plate_lag", *off).record(tmp_path / "prompt", PERTURBED)["analogs"][0, 2]
    slope = np.gradient(prompt, 1 / 1500)
    assert slope @ (prompt - late) / (slope @ slope) == pytest.approx(0.5e-3, rel=0.01)


def test_an_experiment_of_the_bench_is_refused(setup: Setup, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"belt_01.*'belt'.*walking, plate or static"):
        simulate_walking_trial(
            {"trial": "belt_01", "experiment": "belt"}, setup.settings, setup.walking, setup.p, tmp_path
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
def test_a_bad_impedance_trajectory_is_refused(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "impedance.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=complaint):
        read_impedance_trajectory(path)
    with pytest.raises(InputError, match="no such impedance trajectory"):
        read_impedance_trajectory(tmp_path / "absent.csv")


def test_a_given_equilibrium_is_used(setup: Setup, tmp_path: Path) -> None:
    path = tmp_path / "impedance.csv"
    path.write_text("phase,K_d,B_d,theta_eq_rad\n0,300,5,0.05\n1,300,5,0.05\n")
    own = Setup(setup.settings, setup.walking.model_copy(update={"impedance": path}), setup.p)
    np.testing.assert_allclose(own.crossing(False).commands.theta_eq, 0.05 * setup.p.n_T)


def test_settings_with_a_wrong_unit_or_rate_are_refused(tmp_path: Path) -> None:
    text = (ROOT / "config/simulation/walking.yaml").read_text()
    path = tmp_path / "walking.yaml"
    path.write_text(text.replace("size: 0.15, unit: mm", "size: 0.15, unit: m"))
    with pytest.raises(InputError, match=r"effects.marker_noise.*unit must be 'mm'"):
        read_yaml(path, WalkingSettings)
    path.write_text(text.replace("recording_s: 3.0", "recording_s: 1.5"))
    with pytest.raises(InputError, match=r"gait.*recording_s must be longer than heel_strike_s \+ stance_s"):
        read_yaml(path, WalkingSettings)
    path.write_text(text.replace("analogs_hz: 1500", "analogs_hz: 1000"))
    with pytest.raises(InputError, match=r"analogs_hz must be a multiple of points_hz \(300\)"):
        read_yaml(path, WalkingSettings)
