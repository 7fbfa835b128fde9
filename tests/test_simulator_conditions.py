"""Crossings that differ by plan: direction, desired impedance, timing, person; measured from the written files."""

import json
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from decoded_capture import DecodedCrossing, decoded_crossing
from walking_setup import PERTURBED, UNPERTURBED, Setup, leg_log, load_setup

from osl_analysis.simulator.plan import condition_of, plan_trials
from osl_analysis.simulator.settings import Conditions, Subject

CROSSINGS = 24


@pytest.fixture(scope="module")
def setup() -> Setup:
    """Exact sensors, massless plate and foot, and a platform that alone turns the ankle."""
    return load_setup().ideal()


def with_conditions(setup: Setup, **lists: object) -> Setup:
    experiments = setup.settings.experiments
    experiments = experiments.model_copy(update={"conditions": Conditions(**lists), "walking": CROSSINGS})  # type: ignore[arg-type]
    return Setup(setup.settings.model_copy(update={"experiments": experiments}), setup.walking, setup.p)


def decoded(setup: Setup, folder: Path, trial: str = "walking_01", perturbed: bool = True) -> DecodedCrossing:
    setup.record(folder, (PERTURBED if perturbed else UNPERTURBED) | {"trial": trial})
    return decoded_crossing(folder / f"vicon/{trial}.c3d")


def response(setup: Setup, folder: Path) -> tuple[float, float]:
    """Largest angle [rad] and stiffness [N*m/rad] of what the perturbation adds within 100 ms of its onset.

    The stiffness is that of Eq. 15, with derivatives by central differences of the frames.
    """
    moved, calm = (decoded(setup, folder, perturbed=perturbed) for perturbed in (True, False))
    begins = moved.time[np.abs(moved.platform_angle) > 1e-4][0]
    theta, torque = moved.theta - calm.theta, moved.torque - calm.torque
    omega = np.gradient(theta, 1 / 300)
    columns = np.stack([theta, omega, np.gradient(omega, 1 / 300)], axis=-1)
    rows = (moved.time > begins - 0.01) & (moved.time < begins + 0.1)
    found = np.linalg.lstsq(columns[rows], torque[rows], rcond=None)[0]
    return float(theta[rows][np.abs(theta[rows]).argmax()]), float(found[0])


@pytest.mark.parametrize(("direction", "sign"), [("up", 1), ("down", -1)])
def test_the_platform_turns_up_or_down_and_the_leg_resists(
    setup: Setup, tmp_path: Path, direction: str, sign: int
) -> None:
    """5 %: the compensated leg is of third order, and not exactly its command."""
    angle, stiffness = response(with_conditions(setup, directions=[direction]), tmp_path)
    assert np.degrees(angle) == pytest.approx(5 * sign, abs=0.02)
    assert stiffness == pytest.approx(340, rel=0.05)


@pytest.mark.parametrize("K_d", [200, 480])
def test_a_crossing_has_the_gain_of_the_stiffness_that_was_commanded(setup: Setup, tmp_path: Path, K_d: float) -> None:
    """K_1 = K_d K_s / (K_s - K_d) / n_T^2: actuator and belt in series. The leg's truth is what its recording shows."""
    commanded = with_conditions(setup, K_d=[K_d], B_d=[5])
    _, stiffness = response(commanded, tmp_path)
    commanded.record(tmp_path, PERTURBED)
    gain = K_d * 685.6 / (685.6 - K_d) / (83 / 18) ** 2
    assert leg_log(tmp_path)["stiffness_gain"].max() == pytest.approx(gain, rel=1e-6)
    truth = json.loads((tmp_path / "truth/walking_01.json").read_text())["K_rendered"]
    assert stiffness == pytest.approx(truth, rel=0.05)  # differences of frames


@pytest.mark.parametrize("phase", [0.2, 0.4, 0.6])
def test_the_trigger_fires_at_the_phase_of_stance_that_was_planned(setup: Setup, tmp_path: Path, phase: float) -> None:
    """The phase scatters between -0.01 and 0.01 about the planned one; stance lasts 0.72 s from 0.9 s on."""
    seen = decoded(with_conditions(setup, stance_phases=[phase]), tmp_path)
    fired = np.flatnonzero(seen.analogs[7] > 2.5)[0] / 1500
    assert (fired - 0.9) / 0.72 == pytest.approx(phase, abs=0.011)
    assert seen.time[np.abs(seen.platform_angle) > 1e-4][0] > fired + 0.004


def test_every_combination_is_planned_equally_often_and_in_no_simple_order(setup: Setup) -> None:
    lists = {"directions": ("up", "down"), "K_d": (200.0, 340.0, 480.0), "stance_phases": (0.2, 0.4)}
    settings = with_conditions(setup, **lists).settings
    rows = [{"trial": f"walking_{k:02d}", "experiment": "walking"} for k in range(1, CROSSINGS + 1)]
    drawn = [condition_of(row, settings) for row in rows]
    found = [(c.direction, c.K_d, c.stance_phase) for c in drawn]
    assert sorted(found) == sorted(2 * list(product(*lists.values())))
    assert found[:12] != found[12:]


def test_the_sheet_states_the_condition_or_leaves_it_unsaid(setup: Setup) -> None:
    lists = {"directions": ("up", "down"), "K_d": (200.0, 480.0)}
    unsaid = plan_trials(with_conditions(setup, **lists).settings).query("experiment == 'walking'")
    assert unsaid["K_d"].isna().all()
    settings = with_conditions(setup, **lists, stated=("K_d",)).settings
    stated = plan_trials(settings).query("experiment == 'walking'")
    assert sorted(stated["K_d"]) == CROSSINGS // 2 * [200.0] + CROSSINGS // 2 * [480.0]
    for row in stated.to_dict("records"):
        assert condition_of({str(k): v for k, v in row.items()}, settings).K_d == row["K_d"]


def test_what_a_row_states_is_simulated(setup: Setup) -> None:
    row = {"trial": "walking_01", "experiment": "walking", "perturbed": True, "K_d": 123.0, "direction": "down"}
    condition = condition_of(row, setup.settings)
    assert (condition.K_d, condition.direction, condition.perturbed) == (123.0, "down", True)
    assert condition_of({"trial": "walking_01", "experiment": "walking"}, setup.settings).perturbed is False


def test_persons_and_sessions_follow_each_other_in_equal_blocks(setup: Setup, tmp_path: Path) -> None:
    people = (Subject(name="A", body_mass_kg=60, stance_s=0.6), Subject(name="B", body_mass_kg=90, stance_s=0.8))
    mixed = with_conditions(setup, subjects=people, sessions=2)
    rows = [{"trial": f"walking_{k:02d}", "experiment": "walking"} for k in (1, 6, 7, 12, 13, 18, 19, 24)]
    found = [condition_of(row, mixed.settings) for row in rows]
    assert [c.subject.name for c in found if c.subject] == list("AAAABBBB")
    assert [c.session for c in found] == [1, 1, 2, 2, 1, 1, 2, 2]
    named = with_conditions(setup, subjects=people, sessions=2, stated=("subject", "session", "body_mass_kg", "side"))
    sheet = plan_trials(named.settings).query("experiment == 'walking'").set_index("trial")
    columns = ["subject", "session", "body_mass_kg", "side"]
    assert sheet.loc[["walking_01", "walking_24"], columns].to_numpy().tolist() == [
        ["A", "1", 60, "right"], ["B", "2", 90, "right"]
    ]  # fmt: skip
    light, heavy = (decoded(mixed, tmp_path, trial, False) for trial in ("walking_01", "walking_24"))
    assert light.force[:, 2].max() / heavy.force[:, 2].max() == pytest.approx(60 / 90, rel=1e-3)
    assert np.ptp(light.stance) / np.ptp(heavy.stance) == pytest.approx(0.6 / 0.8, abs=0.01)  # one frame of 0.6 s
