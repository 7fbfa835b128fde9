"""Types and faults of the force plate, and what a capture states, measured from the written files."""

import json
from pathlib import Path
from typing import Any

import ezc3d
import numpy as np
import pytest
from decoded_capture import DecodedCrossing, decoded_crossing
from walking_setup import PERTURBED, STATIC, UNPERTURBED, Setup, load_setup

from osl_analysis.simulator.settings import Conditions, Effect
from osl_analysis.simulator.walking_settings import CaptureSettings, StepChange
from osl_analysis.trial import Array

G = 9.81


@pytest.fixture(scope="module")
def setup() -> Setup:
    return load_setup().ideal()


@pytest.fixture(scope="module")
def usual(setup: Setup, tmp_path_factory: pytest.TempPathFactory) -> DecodedCrossing:
    return decoded(setup, tmp_path_factory.mktemp("usual"))


def changed(setup: Setup, **fields: object) -> Setup:
    return Setup(setup.settings, setup.walking.model_copy(update=fields), setup.p)


def imperfect(setup: Setup, name: str, size: float) -> Setup:
    unit = getattr(setup.walking.effects, name).unit
    effect = Effect(enabled=True, size=size, unit=unit)
    return changed(setup, effects=setup.walking.effects.model_copy(update={name: effect}))


def decoded(setup: Setup, folder: Path) -> DecodedCrossing:
    setup.record(folder, UNPERTURBED)
    return decoded_crossing(folder / "vicon/walking_01.c3d")


def recorded(setup: Setup, folder: Path, row: dict[str, object] = UNPERTURBED) -> Any:
    setup.record(folder, row)
    return ezc3d.c3d(str(folder / f"vicon/{row['trial']}.c3d"))


def wrench_of(file: Any) -> Array:
    """Fx, Fy, Fz [N] and moments [N*m] about the surface's centre, plate axes, by the formulas of the C3D manual."""
    plate = file["parameters"]["FORCE_PLATFORM"]
    kind, origin = plate["TYPE"]["value"][0], plate["ORIGIN"]["value"][:, 0] / 1e3
    c = file["data"]["analogs"][0, : 8 if kind == 3 else 6]
    if kind == 1:
        x, y, zero = c[3] / 1e3, c[4] / 1e3, 0 * c[3]
        m_x, m_y, m_z = np.cross([x, y, zero], c[:3], axis=0)
        return np.array([*c[:3], m_x, m_y, m_z + c[5] / 1e3])
    if kind == 3:
        a, b, depth = origin
        force = np.array([c[0] + c[1], c[2] + c[3], c[4:].sum(axis=0)])
        moment = [b * (c[4] + c[5] - c[6] - c[7]), a * (-c[4] + c[5] + c[6] - c[7])]
        moment.append(b * (c[1] - c[0]) + a * (c[2] - c[3]))
        centre = np.array([0.0, 0.0, depth])
    else:
        c = plate["CAL_MATRIX"]["value"][:, :, 0] @ c if kind == 4 else c
        force, moment, centre = c[:3], c[3:] / 1e3, -origin
    return np.array([*force, *(np.array(moment) - np.cross(centre, force.T).T)])


@pytest.mark.parametrize("kind", [1, 3, 4])
def test_every_type_of_plate_carries_the_wrench_of_type_2(setup: Setup, tmp_path: Path, kind: int) -> None:
    expected = wrench_of(recorded(setup, tmp_path / "2", PERTURBED))
    other = changed(setup, capture=CaptureSettings.model_validate({"plate_type": kind}))
    file = recorded(other, tmp_path / "other", PERTURBED)
    loaded = expected[2] < -50
    np.testing.assert_allclose(wrench_of(file)[:, loaded], expected[:, loaded], atol=2e-3)
    labels = file["parameters"]["ANALOG"]["LABELS"]["value"]
    assert len(labels) == (10 if kind == 3 else 8)
    assert labels[-2:] == ["Sync", "Trigger"]


@pytest.mark.parametrize(
    ("effect", "size", "kind", "rows"),
    [("moment_clip", 50, 2, slice(3, 6)), ("force_clip", 500, 2, slice(0, 3)), ("sensor_clip", 150, 3, slice(0, 8))],
)
def test_raw_channels_stop_at_their_rails(
    setup: Setup, tmp_path: Path, effect: str, size: float, kind: int, rows: slice
) -> None:
    """Exactly the samples beyond the rails change, and no other channel does."""
    plate = changed(setup, capture=CaptureSettings.model_validate({"plate_type": kind}))
    free = recorded(plate, tmp_path / "free")["data"]["analogs"][0]
    seen = recorded(imperfect(plate, effect, size), tmp_path / "clipped")["data"]["analogs"][0]
    rail = size * (1e3 if effect == "moment_clip" else 1)
    np.testing.assert_allclose(seen[rows], np.clip(free[rows], -rail, rail), rtol=1e-6)
    assert (np.abs(free[rows]) > 1.2 * rail).any()
    others = np.setdiff1d(np.arange(len(free)), np.arange(len(free))[rows])
    np.testing.assert_array_equal(seen[others], free[others])


def test_dead_channels_stand_still(setup: Setup, tmp_path: Path) -> None:
    dead = changed(setup, capture=CaptureSettings(dead_channels={"Mx1": -12.0, "My1": 7.5, "Mz1": 0.0}))
    analogs = recorded(dead, tmp_path)["data"]["analogs"][0]
    assert [set(channel) for channel in analogs[3:6]] == [{-12.0}, {7.5}, {0.0}]
    assert np.ptp(analogs[2]) > 500


def test_the_label_of_moments_changes_and_the_values_do_not(setup: Setup, tmp_path: Path) -> None:
    file = recorded(changed(setup, capture=CaptureSettings(moment_label="Nm")), tmp_path / "label")
    assert file["parameters"]["ANALOG"]["UNITS"]["value"][:6] == ["N", "N", "N", "Nm", "Nm", "Nm"]
    true = recorded(setup, tmp_path / "true")
    np.testing.assert_array_equal(file["data"]["analogs"], true["data"]["analogs"])
    assert np.abs(true["data"]["analogs"][0, 3]).max() > 5e4, "N*mm"


def test_a_second_foot_adds_its_force_where_it_stands(setup: Setup, usual: DecodedCrossing, tmp_path: Path) -> None:
    """20 % of 80 kg at mid-stance, 0.15 m behind and 0.18 m to the left of the nominal ankle (0.24, 0.25)."""
    seen = decoded(changed(setup, changes=(StepChange(second_foot_percent=20),)), tmp_path)
    added = seen.force - usual.force
    middle = np.abs(seen.time - (0.9 + 0.36)).argmin()
    assert added[middle, 2] == pytest.approx(0.2 * 80 * G, rel=1e-3)
    assert added[:, 2].argmax() == pytest.approx(middle, abs=1)
    moved = seen.pressure[middle] * seen.force[middle, 2] - usual.pressure[middle] * usual.force[middle, 2]
    np.testing.assert_allclose((moved / added[middle, 2])[:2], [0.09, 0.43], atol=1e-3)
    assert seen.torque[middle] - usual.torque[middle] == pytest.approx(-0.15 * 0.2 * 80 * G, rel=0.02)


def test_a_foot_partly_beside_the_plate_leaves_a_part_of_its_load_to_the_floor(
    setup: Setup, usual: DecodedCrossing, tmp_path: Path
) -> None:
    """30 of 90 mm: two thirds of force and torque; their middle is 30 mm from the edge of the plate, y = 0."""
    seen = decoded(changed(setup, changes=(StepChange(overhang_mm=30),)), tmp_path)
    loaded = usual.force[:, 2] > 200
    np.testing.assert_allclose(seen.force[loaded], usual.force[loaded] * 2 / 3, rtol=1e-5)
    np.testing.assert_allclose(seen.torque[loaded], usual.torque[loaded] * 2 / 3, atol=1e-2)
    np.testing.assert_allclose(seen.theta, usual.theta, atol=1e-6)
    middle = np.abs(seen.time - (0.9 + 0.36)).argmin()
    assert seen.foot.origin[middle, 1] == pytest.approx(0.015, abs=1e-5)
    assert seen.pressure[middle, 1] == pytest.approx(0.030, abs=5e-3)


def test_swapped_labels_exchange_two_markers_in_the_named_trials(setup: Setup, tmp_path: Path) -> None:
    capture = CaptureSettings(swapped_labels=(("FOOT1", "SHANK2"),), swapped_in=("walking_01",))
    for row, swapped in ((UNPERTURBED, True), (STATIC, False)):
        true, seen = (
            recorded(setup, tmp_path / "a", row),
            recorded(changed(setup, capture=capture), tmp_path / "b", row),
        )
        places = [f["parameters"]["POINT"]["LABELS"]["value"].index("FOOT1") for f in (true, seen)]
        assert (places[0] != places[1]) is swapped
        np.testing.assert_array_equal(true["data"]["points"], seen["data"]["points"])


def test_a_file_with_y_up_is_the_same_laboratory_turned(setup: Setup, tmp_path: Path) -> None:
    """x stays forward, y is up, z is to the right: (x, y, z) -> (x, z, -y)."""
    true = recorded(setup, tmp_path / "z")
    turn = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    assert np.linalg.det(turn) == pytest.approx(1)
    for states in (True, False):
        capture = CaptureSettings(up_axis="y", states_axes=states)
        seen = recorded(changed(setup, capture=capture), tmp_path / f"y{states}")
        np.testing.assert_allclose(
            seen["data"]["points"][:3], np.tensordot(turn, true["data"]["points"][:3], 1), atol=1e-3
        )
        corners = (f["parameters"]["FORCE_PLATFORM"]["CORNERS"]["value"][:, :, 0] for f in (seen, true))
        np.testing.assert_allclose(next(corners), turn @ next(corners), atol=1e-3)
        np.testing.assert_array_equal(seen["data"]["analogs"], true["data"]["analogs"])
        stated = seen["parameters"]["POINT"].get("Y_SCREEN", {"value": None})["value"]
        assert stated == (["+Y"] if states else None)


def test_the_file_states_the_body_mass_and_the_person(setup: Setup, tmp_path: Path) -> None:
    conditions = Conditions.model_validate({"subjects": [{"name": "Anna", "body_mass_kg": 61.5}]})
    experiments = setup.settings.experiments.model_copy(update={"conditions": conditions})
    people = Setup(setup.settings.model_copy(update={"experiments": experiments}), setup.walking, setup.p)
    groups = recorded(changed(people, capture=CaptureSettings(states_body_mass=True)), tmp_path, STATIC)["parameters"]
    assert groups["PROCESSING"]["BODYMASS"]["value"][0] == pytest.approx(61.5)
    assert groups["SUBJECTS"]["NAMES"]["value"] == ["Anna"]
    silent = recorded(setup, tmp_path, STATIC)["parameters"]
    assert "PROCESSING" not in silent
    assert "SUBJECTS" not in silent


def test_the_second_session_has_other_marker_places_in_its_static_trial_and_crossings(
    setup: Setup, tmp_path: Path
) -> None:
    """Distances between markers of a foot: equal within a session, and some mm apart between two of them."""
    experiments = setup.settings.experiments.model_copy(
        update={"conditions": Conditions(sessions=2), "static": 2, "walking": 2}
    )
    again = Setup(setup.settings.model_copy(update={"experiments": experiments}), setup.walking, setup.p)
    again = imperfect(again, "marker_placement", 5)

    def spans(trial: str) -> Array:
        row = UNPERTURBED if trial.startswith("walking") else STATIC
        file = recorded(again, tmp_path, row | {"trial": trial})
        places = [file["parameters"]["POINT"]["LABELS"]["value"].index(f"FOOT{k}") for k in range(1, 5)]
        feet = file["data"]["points"][:3, places, 0]
        return np.asarray([np.linalg.norm(feet[:, i] - feet[:, j]) for i in range(4) for j in range(i)])

    first, second = spans("static_1"), spans("static_2")
    np.testing.assert_allclose(spans("walking_01"), first, atol=1e-3)
    np.testing.assert_allclose(spans("walking_02"), second, atol=1e-3)
    assert 2 < np.sqrt(np.mean((second - first) ** 2)) < 15


def test_the_truth_says_what_was_simulated(setup: Setup, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    recorded(changed(setup, changes=(StepChange(load=0.7),)), tmp_path / "out")
    facts = json.loads((tmp_path / "out/truth/walking_01.json").read_text())
    assert facts["gait_laboratory"]["changes"][0]["load"] == 0.7
    assert (facts["condition"]["direction"], facts["change"]["load"]) == ("up", 0.7)
