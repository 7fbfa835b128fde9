# SPDX-License-Identifier: Apache-2.0
"""The platform's motion, its onset and a heavy plate; static trials of crossings, exchanged labels,
shifts."""

from dataclasses import replace
from functools import cache

import numpy as np
import polars as pl
import pytest
import walking_synthetic as synthetic
from conftest import refused_with
from scipy.spatial.transform import Rotation
from walking_synthetic import (
    Ramp,
    Rig,
    changed,
    plate_trials,
    pose,
    settings,
    static_trial,
    walked_over,
)

from osl_analysis.base.table import write_table
from osl_analysis.commands.walking import average_unperturbed, write_refusal
from osl_analysis.walking.crossing import analyse_crossing
from osl_analysis.walking.geometry import platform_turn
from osl_analysis.walking.groups import static_of
from osl_analysis.walking.plate import Stance
from osl_analysis.walking.plate_inertia import (
    NO_CORRECTION,
    TurnLag,
    identify_plate_model,
)
from osl_analysis.walking.platform import platform_track
from osl_analysis.walking.poses import segment_poses, static_calibration
from osl_analysis.walking.set_up import check_onset

CALIBRATION = static_calibration(static_trial(), settings())
RIG = Rig()
HEAVE = 0.003
WALK = walked_over("walk_1", None, RIG, 1)


def calibrated(trials):
    return [(trial, CALIBRATION) for trial in trials]


@cache
def plate(heave=0.0):
    return identify_plate_model(calibrated(plate_trials(RIG, Ramp(heave=heave), 2)), settings())


def unperturbed(trial, model=NO_CORRECTION, **choices):
    lag = model.lag or 0.0
    return analyse_crossing(trial, CALIBRATION, model, False, settings(**choices), None, lag)


def moved(trial, *markers, by=0.01):
    """The trial with markers [m] further to the left."""
    return changed(trial, *[pl.col(f"marker_{marker}_y") + by for marker in markers])


def raised(trial, by):
    """The trial whose recording states the corners elsewhere [m]."""
    plate = {"plate": 1, "type": 2, "corners": np.add(synthetic.CORNERS, by).tolist()}
    return replace(trial, provenance={"plates": [plate]})


@pytest.mark.parametrize(
    ("trial", "what", "distance_mm"),
    [
        (moved(WALK, "SHANK2", by=0.008), "marker SHANK2 of the shank", 8.0),
        (moved(WALK, *[f"SHANK{k}" for k in (1, 2, 3, 4)]), "the ankle between foot and shank", 10),
        (moved(WALK, *[f"PLAT{k}" for k in (1, 2, 3, 4)]), "the platform at rest", 10.0),
        (raised(WALK, [0.03, 0, 0]), "the corners of force plate 1", 30.0),
    ],
)
def test_what_is_not_where_it_was_in_the_static_trial_is_named_by_itself(trial, what, distance_mm):
    quality = unperturbed(trial).quality

    assert quality.different == what
    assert quality.different_mm == pytest.approx(distance_mm, abs=0.5)
    assert unperturbed(WALK).quality.different_mm < 0.5


@pytest.mark.parametrize(
    "shift",
    [
        [0, 0, 0.05],  # a marker of the foot is 3 cm above the plate
        [0.05, 0, 0.02],  # markers of the platform are over a plate that lies there, on its surface
    ],
)
def test_corners_that_lie_2_cm_above_a_marker_over_them_are_told(shift):
    """They stand otherwise in all recordings."""
    high = raised(WALK, shift)
    calibration = replace(CALIBRATION, corners={1: np.add(synthetic.CORNERS, shift)})

    quality = analyse_crossing(high, calibration, NO_CORRECTION, False, settings(), None, 0).quality

    assert quality.different == "the corners of force plate 1 above a marker that is over it"
    assert quality.different_mm == pytest.approx(20, abs=1)


@pytest.mark.parametrize("heave", [0.0, HEAVE])
def test_the_mass_of_a_heavy_plate_is_inside_its_interval(heave):
    """25 kg, 0.3 mm, 2.5 deg: all six coordinates at 8 Hz read 22.9 +- 0.2 kg. Over 12 seeds -0.02
    +- 0.06 (0.06)."""
    model = plate(heave)

    assert abs(model.parameters[0] - RIG.mass) < 0.3
    assert abs(model.parameters[3] - RIG.mass * RIG.com[2]) < 0.04


def test_the_noise_of_the_platform_s_track_is_that_of_its_markers():
    time, poses = segment_poses(WALK, settings().markers.platform, CALIBRATION, settings())

    track = platform_track("walk_1", time, poses, CALIBRATION, settings())

    assert track.noise == pytest.approx(RIG.marker, rel=0.15)


def test_a_cluster_that_was_put_on_again_asks_for_a_static_trial():
    with refused_with("shank markers"):
        unperturbed(moved(WALK, "SHANK1", by=0.07), plate())


@pytest.mark.parametrize(
    ("cells", "statics", "own"),
    [
        (
            {"subject": "A", "session": "2", "static": "s1"},
            {"s1": {"subject": "A"}, "s2": {"session": "2"}},
            "s1",
        ),
        (
            {"subject": "A", "session": "2"},
            {"s1": {"subject": "A"}, "s2": {"subject": "A", "session": "2"}},
            "s2",
        ),
        ({"subject": "A"}, {"s1": {}}, "s1"),
    ],
)
def test_the_static_trial_is_the_named_one_else_the_subject_s_else_the_only(cells, statics, own):
    assert static_of("w", cells, statics) == own


@pytest.mark.parametrize(
    ("cells", "statics", "message"),
    [
        ({}, {"s1": {}, "s2": {}}, "subject, session.*side: 2.*static trials s1, s2"),
        ({"subject": "A"}, {"s1": {}, "s2": {}}, "subject A: 2.*static trials"),
        ({"subject": "A"}, {"s1": {"subject": "B"}}, "subject A: 0.*static trials s1"),
        ({"static": "w1"}, {"s1": {}}, "static: 'w1'.*trial.*experiment 'static'.*s1"),
    ],
)
def test_a_crossing_without_a_static_trial_of_its_own_is_refused(cells, statics, message):
    with refused_with(rf"trial 'w'.*{message}"):
        static_of("w", cells, statics)


def test_the_unloaded_plate_shows_the_height_of_its_corners_to_2_mm():
    trials = [raised(trial, [0, 0, 0.02]) for trial in plate_trials(RIG, Ramp(), 2)]

    high = identify_plate_model(calibrated(trials), settings())

    assert plate().height == pytest.approx(0, abs=2e-3)
    assert high.height == pytest.approx(0.02, abs=2e-3)
    assert high.height_se == pytest.approx(0, abs=2e-3)


def test_a_resting_plate_adds_nothing():
    weightless = replace(plate(), parameters=np.zeros(10))

    difference = unperturbed(WALK, plate()).torque - unperturbed(WALK, weightless).torque

    assert np.sqrt(np.mean(difference**2)) < 0.05


BESIDE = raised(WALK, [0.18, -0.02, 0])  # corners further forward and to the right


def test_a_foot_at_the_edge_of_the_plate_has_its_load():
    crossing = unperturbed(BESIDE)

    # through the ankle
    middle = len(crossing.time) // 2
    assert crossing.load[:, middle] == pytest.approx([680, -0.02, 0.23], rel=0.02)


def test_a_foot_partly_beside_the_plate_is_refused():
    with refused_with(
        "foot marker lies 3.* cm beside force plate 1.*another foot.*`walking.plate`"
    ):
        unperturbed(raised(WALK, [0.2, -0.02, 0]))


def test_a_late_plate_is_read_later():
    crossing = unperturbed(BESIDE)

    late = unperturbed(BESIDE, replace(NO_CORRECTION, turns=(TurnLag("plate", 0.0, 0.01, 1e-4),)))

    assert crossing.stance.heel_strike - late.stance.heel_strike == pytest.approx(0.01, abs=1e-4)
    np.testing.assert_allclose(late.torque, crossing.torque, atol=1)  # 3 frames earlier


IN_AIR = pl.col("time").is_between(1.25, 1.27)
IN_STANCE = pl.col("time").is_between(1.0, 1.6).cast(pl.Float64)


@pytest.mark.parametrize(
    ("more", "changes", "told"),
    [
        ({"load_on_n": 1000}, {}, "stance.*plate"),
        (
            {},
            {"plate1_force_z": pl.col("plate1_force_z") * ~IN_AIR},
            r"0\.93\d-1\.25\d s, 1\.2\d\d-1\.59\d s",
        ),
        ({}, {"plate1_force_x": -100 * pl.col("time") * IN_STANCE}, "N, 179 deg.*wrong sign"),
    ],
)
def test_none_or_several_stances_or_one_that_brakes_are_refused(more, changes, told):
    with refused_with(told):
        unperturbed(changed(WALK, **changes), **more)


@pytest.mark.parametrize("onset", [1.75, 0.8, 1.02, 1.53])
def test_an_onset_whose_response_leaves_stance_is_refused(onset):
    with refused_with(r"baseline.*window.*0\.930-1\.590 s"):
        check_onset(onset, Stance(0.93, 1.59), settings())


def test_too_few_unperturbed_crossings_say_how_many_and_a_reason(tmp_path):
    reason = "trial u0:.*shank.*20 cm.*foot"
    write_refusal("u0", reason, tmp_path / "u0.parquet")
    row = {"trial": "u0", "reason": reason, "perturbed": False, "group": "all", "direction": None}
    write_table(pl.DataFrame([row]), tmp_path / "selection.csv")

    with refused_with(rf"^0 unperturbed.*4.*{reason}$"):
        average_unperturbed(
            [tmp_path / "u0.parquet"], tmp_path / "selection.csv", 4, tmp_path / "gait.json"
        )


@pytest.mark.parametrize(("heading", "turn"), [(0.0, 0.087), (180.0, -0.05), (57.0, 0.087)])
def test_the_turn_is_toes_up_positive_whichever_way_the_person_walks(heading, turn):
    """The largest turn in the window counts, not its last one."""
    time = np.arange(60) / 300
    yaw = Rotation.from_euler("z", heading, degrees=True)
    rest = Rotation.from_euler("xyz", [3, -2, 20], degrees=True)
    axis = yaw.apply([0.0, 1.0, 0.0])
    angles = turn * np.interp(time, [0.05, 0.12, 0.15, 0.2], [0, 1, -0.2, 3])
    rotation = (Rotation.from_rotvec(-angles[:, None] * axis) * rest).as_matrix()
    platform = pose(rotation, np.zeros((60, 3)))

    turned = platform_turn(time, platform, np.tile(axis, (60, 1)), (0.05, 0.15))

    assert turned == pytest.approx(turn)


def test_each_unloaded_trial_is_read_with_the_cluster_of_its_session():
    """A marker moved between two sessions: by the first static trial the second misses its
    limit."""
    first, second = plate_trials(Rig(marker=1e-5), Ramp(), 2)
    later = moved(second, "PLAT1", by=0.03)
    later_static = static_calibration(moved(static_trial(), "PLAT1", by=0.03), settings())

    alike = identify_plate_model(calibrated([first, second]), settings())
    model = identify_plate_model([(first, CALIBRATION), (later, later_static)], settings())

    np.testing.assert_allclose(model.parameters, alike.parameters, atol=0.05)  # 0.01 mm of noise
    with refused_with("column static"):
        identify_plate_model(calibrated([later]), settings())
