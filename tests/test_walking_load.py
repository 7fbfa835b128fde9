"""How the foot loads the plate, and whether axes, side and malleoli are right: by geometry, and on simulated files."""

import numpy as np
import polars as pl
import pytest

from osl_analysis.errors import InputError
from osl_analysis.plate_surface import furthest_outside, plate_axes
from osl_analysis.trial import Trial
from osl_analysis.walking.checks import check_heading, check_push, check_vertical
from osl_analysis.walking.events import Stance
from osl_analysis.walking.plate import PlateWrench, load_of_weight, load_on_foot, recorded_corners

CORNERS = np.array([[0.3, 0.2, 0], [-0.3, 0.2, 0], [-0.3, -0.2, 0], [0.3, -0.2, 0]]) + np.array([1.0, 2.0, 0.1])
PHASE = np.linspace(0, 1, 11)


def test_the_pressure_beside_the_ankle_is_where_the_force_acts() -> None:
    """A force through a known point of the surface, the ankle 0.1 m above it; the axis points along -x, heading +y."""
    centre, ankle = np.array([[1.0, 2.0, 0.1]]), np.array([[1.05, 1.9, 0.2]])
    force, point = np.array([[30.0, -20.0, 700.0]]), np.array([0.93, 2.1, 0.1])
    moment = np.cross(point - centre, force) + np.array([0, 0, 4.0])  # and a free moment
    load = load_on_foot(PlateWrench(force, moment), centre, ankle, np.array([[-1.0, 0, 0]]))
    assert load.force == pytest.approx([700])
    assert load.left == pytest.approx([1.05 - 0.93])


def test_without_load_there_is_no_pressure() -> None:
    light = PlateWrench(np.array([[0.0, 0, 60]]), np.array([[0.0, 40, 0]]))
    assert load_on_foot(light, np.zeros((1, 3)), np.zeros((1, 3)), np.array([[0.0, 1, 0]])).left == [0.0]


def test_the_load_is_a_share_of_the_weight_in_single_support() -> None:
    force = np.where((PHASE > 0.15) & (PHASE < 0.85), 0.9 * 70 * 9.81, 5000.0)
    stance = Stance(3.0, 3.8)
    share = load_of_weight(3.0 + 0.8 * PHASE, force, stance, 70.0)
    assert share == pytest.approx(0.9, rel=1e-3)
    assert load_of_weight(3.0 + 0.8 * PHASE, force, stance, None) is None


@pytest.mark.parametrize(
    ("point", "distance"), [([1.29, 2.19, 0.1], 0.0), ([1.35, 2.1, 0.3], 0.05), ([0.66, 1.77, 0.1], 0.05)]
)
def test_the_distance_of_a_marker_outside_the_plate(point: list[float], distance: float) -> None:
    assert furthest_outside(np.array([[1.0, 2.0, 0.1], point]), CORNERS) == pytest.approx(distance)


@pytest.mark.parametrize(
    ("force", "problem"),
    [
        (
            [20.0, 700, 30],
            r"acts along \+y \(570 N\), expected \+z: its vertical axis is y; state `axes: \[x, -z, y\]`",
        ),
        ([20.0, 30, -700], r"acts along -z \(-570 N\), expected \+z: the force is of the other sign"),
        ([-700.0, 30, 10], r"acts along -x \(-570 N\), expected \+z: state `axes`"),
    ],
)
def test_a_load_that_does_not_act_upwards_is_refused(force: list[float], problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        check_vertical(np.sin(np.pi * PHASE)[:, None] * force)


def test_a_load_that_acts_upwards_and_an_empty_plate_pass() -> None:
    check_vertical(np.sin(np.pi * PHASE)[:, None] * [200.0, 100, 700])
    check_vertical(np.zeros((5, 3)))


@pytest.mark.parametrize("turn", [0.0, 2.0, np.pi])
def test_a_shank_that_leans_against_its_own_heading_is_refused(turn: float) -> None:
    heading, left = (np.array([f(turn), g(turn), 0]) for f, g in ((np.cos, np.sin), (lambda a: -np.sin(a), np.cos)))
    shank = np.outer(-0.1 + 0.25 * PHASE, heading) + np.array([0, 0, 0.3])
    axis = np.tile(left, (PHASE.size, 1))
    check_heading(PHASE, shank, axis)
    with pytest.raises(InputError, match=r"the shank moves 20 cm backwards over the foot .* correct `side`, exchange"):
        check_heading(PHASE, shank, -axis)


def test_a_moment_that_lifts_the_toes_in_late_stance_is_refused() -> None:
    torque = -10 + 90 * PHASE
    check_push(PHASE, torque)
    with pytest.raises(InputError, match=r"moment in late stance is -53 N\*m"):
        check_push(PHASE, -torque)


@pytest.mark.parametrize(
    ("axes", "named"), [([0, 2, 1], r"across the y axis.*`axes: \[x, -z, y\]`"), ([2, 1, 0], "across the x")]
)
def test_a_plate_that_stands_on_edge_says_that_z_is_not_up(axes: list[int], named: str) -> None:
    facts = {"plates": [{"plate": 1, "type": 2, "corners": CORNERS[:, axes].tolist()}]}
    trial = Trial("plate_1", pl.DataFrame({"time": [0.0]}), facts)
    with pytest.raises(InputError, match=named):
        recorded_corners(trial, 1)
    level = Trial("plate_1", trial.samples, {"plates": [{"plate": 1, "type": 2, "corners": CORNERS.tolist()}]})
    np.testing.assert_allclose(recorded_corners(level, 1), CORNERS)


def test_the_normal_of_a_plate_points_up_whichever_way_its_corners_go_round() -> None:
    for corners in (CORNERS, CORNERS[::-1]):
        np.testing.assert_allclose(plate_axes(np.array(corners))[:, 2], [0, 0, 1], atol=1e-12)
