# SPDX-License-Identifier: Apache-2.0
"""Crossings under different conditions have results of their own."""

import re
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from c3d_builder import FACE
from conftest import doubt, refused_with, white_noise
from walking_crossings import (
    TURN,
    Walk,
    campaign,
    crossing,
    selected,
    several,
    walked,
)
from walking_synthetic import settings

from osl_analysis.commands.walking_summary import (
    commanded_trajectory,
    commanded_value,
    estimate_verdict,
)
from osl_analysis.walking.groups import (
    Measure,
    crossing_features,
    feature_of,
    places,
    split_keys,
)
from osl_analysis.walking.isolated_response import unperturbed_gait
from osl_analysis.walking.plate import Stance
from osl_analysis.walking.plate_inertia import NO_CORRECTION
from osl_analysis.walking.plate_lag import PlateTiming
from osl_analysis.walking.set_up import cop_outside
from osl_analysis.walking.tables import fitted_time, group_headline, set_up_difference

MIDSTANCE = Walk(0.4)


def crossings(walks):
    return [walked(name, walk) for name, walk in walks.items()]


def headline(walks, **choices):
    gait = unperturbed_gait(crossings(several("u", 8, Walk())), 3)
    return group_headline(
        crossings(walks), gait, settings(**choices), NO_CORRECTION, PlateTiming({}, {})
    )


@pytest.mark.parametrize("is_stated", [True, False])
def test_each_direction_of_the_turn_has_a_result_of_its_own(is_stated, tmp_path):
    """A torque of 12 N*m after either turn reads as 138 N*m/rad more up, and as much less down."""
    up = several("up", 3, MIDSTANCE, common=12.0)
    down = several("down", 3, MIDSTANCE, common=12.0, sign=-1)
    cells = {name: {"direction": "up" if name in up else "down"} for name in up | down}

    tables = campaign(tmp_path, up | down | several("u", 4, Walk()), cells if is_stated else {})

    assert tables["groups"]["group"].to_list() == ["direction up", "direction down"]
    assert tables.estimate("direction up")["mean"] == pytest.approx(340 + 138, abs=12)
    assert tables.estimate("direction down")["mean"] == pytest.approx(340 - 138, abs=12)
    assert set(tables["groups"]["n_unperturbed"]) == {4}


def walks_by_stiffness(values):
    """Crossings of legs with these stiffnesses, whose gait differs, and their cells."""
    walks = {}
    cells = {}
    for K in values:
        gait = 0.8 + K / 2000
        leg_walks = several(f"p{K:.0f}_", 3, MIDSTANCE, impedance=(K, 5.0, 0.03), gait=gait)
        leg_walks |= several(f"u{K:.0f}_", 3, Walk(gait=gait))
        walks |= leg_walks
        cells |= {name: {"K_d": float(K), "B_d": 5.0} for name in leg_walks}
    return walks, cells


@pytest.fixture(scope="module")
def three_legs(tmp_path_factory):
    walks, cells = walks_by_stiffness((200.0, 340.0, 480.0))
    cells["fell"] = {"perturbed": True, "K_d": 340.0, "exclude": "he fell"}
    return campaign(tmp_path_factory.mktemp("legs"), walks, cells)


@pytest.mark.parametrize("K", [200.0, 340.0, 480.0])
def test_each_commanded_stiffness_has_its_own_result(three_legs, K):
    row = three_legs.estimate(f"K_d {K:.0f}")

    assert three_legs["groups"]["group"].to_list() == ["K_d 200", "K_d 340", "K_d 480"]
    assert row["mean"] == pytest.approx(K, abs=10)
    assert row["commanded"] == K
    assert row["low"] < K < row["high"]


def test_an_unstated_condition_serves_every_value():
    K_d = {"p200": 200.0, "p400": 400.0, "every": None, "u400": 400.0, "u300": 300.0}
    sheet = {name: {"perturbed": name[0] == "p", "K_d": value} for name, value in K_d.items()}

    groups = {name: place["group"] for name, place in places([], sheet).items()}

    assert groups["every"] == "K_d 200; K_d 400"
    assert groups["u400"] == "K_d 400"
    assert groups["u300"] is None


@pytest.mark.parametrize(
    ("column", "is_perturbed"),
    [("K_d", True), ("speed", False), ("side", False)],
)
def test_a_condition_that_only_some_crossings_state_is_refused(column, is_perturbed):
    """An unperturbed one has a pace too."""
    sheet = {
        "p0": {"perturbed": True, column: 200.0},
        "p1": {"perturbed": is_perturbed, column: None},
    }

    with refused_with(rf"trial p1:.*{column}.*200;"):
        split_keys(sheet)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_group_without_a_result_has_rows_that_say_why_and_the_others_go_on(tmp_path):
    walks, cells = walks_by_stiffness((200.0,))
    few = several("few", 1, MIDSTANCE) | several("few_u", 3, Walk())
    bare = several("bare", 3, MIDSTANCE)
    cells |= {name: {"K_d": 600.0 if name in bare else 500.0, "B_d": 5.0} for name in few | bare}

    tables = campaign(tmp_path, walks | few | bare, cells)

    reasons = dict(tables["groups"].select("group", "reason").iter_rows())
    excluded = dict(tables["walking"].select("trial", "reason").iter_rows())
    assert reasons["K_d 200"] is None
    assert re.search("^1 .* 2 ", reasons["K_d 500"])
    assert "unperturbed" in reasons["K_d 600"]
    assert "unperturbed" in excluded["bare1"]
    assert tables["groups"].filter(group="K_d 600")["n"].item() == 0


def test_what_the_sheet_does_not_state_is_commanded_by_the_trajectory(tmp_path):
    """Its stiffness is 1000 times the phase of the gait cycle. A synthetic one led no measured
    leg."""
    trajectory = tmp_path / "trajectory.csv"
    lines = "phase,K_d,B_d\n0,0,1\n0.62,620,1\n1,0,1\n"
    trajectory.write_text(lines)
    synthetic = tmp_path / "synthetic.csv"
    synthetic.write_text("# kind: synthetic\n" + lines)

    commanded = commanded_trajectory([trajectory], "measured")

    values = [commanded_value(commanded, name, 0.5) for name in ("K_d", "B_d")]
    assert values == pytest.approx([310, 1])
    assert commanded_value(commanded, "I_d", 0.5) is None
    assert commanded_trajectory([synthetic], "measured") is None
    assert commanded_trajectory([], "measured") is None


def test_a_stiffness_that_changes_linearly_is_read_at_the_fitted_time():
    result = headline(several("p", 4, MIDSTANCE, noise=0.0))
    time = result.responses[0].time
    window = result.responses[0].window
    mean = result.ensemble.response
    motion = mean.motion
    slope = 1000.0  # [N*m/rad per second]
    torque = mean.torque + slope * time * motion.theta

    K = np.linalg.lstsq(motion.columns[window], torque[window])[0][0]

    change = K - result.ensemble.budgets["K"].value
    assert change == pytest.approx(slope * fitted_time(mean), rel=1e-9)
    assert 0.05 < fitted_time(mean) < 0.1


def session(**changed):
    """Eleven crossings that hardly differ, the last of which is changed."""
    random = np.random.default_rng(6)
    crossings = []
    for k in range(11):
        stance = 0.72 + 0.01 * random.standard_normal()
        plain = crossing(f"w{k}", onset=0.6 if k % 2 else None, stance=stance)
        crossings.append(plain)
    return [*crossings[:-1], replace(crossings[-1], **changed)]


def reasons(crossings):
    rows = selected(crossings, settings())
    return {name: str(row["reason"]) for name, row in rows.items() if row["reason"] is not None}


def loaded(c, share=1.0, left=0.01, mass=None, seed=0, late=1.0):
    """The crossing of 70 kg with a share of its load, of the last fifth also `late`, and its centre
    of pressure [m] to the left of the ankle."""
    force_noise, pressure_noise = white_noise(2, seed)
    phase = np.clip(c.stance.phase(c.time), 0, 1)
    shape = np.clip(np.sin(np.pi * phase) * 1.15, 0, 0.95) * np.where(phase > 0.8, late, 1)
    force = share * (1 + 0.02 * force_noise) * 9.81 * 70 * shape
    load = np.array([force, np.full_like(force, left + 0.002 * pressure_noise)])
    return replace(c, load=load, torque=share * c.torque, body_mass=mass)


LAST = session()[-1]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (vars(crossing("w10", stance=1.0)), "stance is 1 s"),
        ({"theta": LAST.theta + 0.3 * np.sin(9 * LAST.time)}, "markers that jump"),
    ],
)
def test_an_outlier_is_named_with_the_reason(changes, message):
    ((name, reason),) = reasons(session(**changes)).items()

    assert name == "w10"
    assert message in reason


def loaded_session(shares=None, **last):
    """The session with shares of its load, by name, and a last crossing of its own."""
    shares = shares or {}
    crossings = [loaded(c, share=shares.get(c.name, 1.0), seed=k) for k, c in enumerate(session())]
    return [*crossings[:-1], loaded(session()[-1], seed=10, **last)]


def test_crossings_that_hardly_differ_exclude_nobody():
    assert reasons(session()) == {}
    assert reasons(loaded_session()) == {}


def test_another_load_a_second_foot_and_a_foot_over_an_edge_are_named():
    light = reasons(loaded_session(share=0.7))["w10"]
    assert re.search(r"load .* 3\d(\.\d)? % of.*another foot", light)
    assert " m " in reasons(loaded_session(left=0.04))["w10"]
    assert "load until toe-off" in reasons(loaded_session(late=0.6))["w10"]


def test_a_curve_is_too_far_from_the_median_and_never_too_near():
    """RMS deviations of 1, 1.1 and 0.9 from the median scatter by 1.48 * 0.1: a curve on the median
    is as sound as any, one of 10 is no crossing like the others."""
    wave = np.sin(np.arange(100))
    sizes = np.array([1.0, -1.1, 0.9, -1.0, 0.0, 10.0, -0.9])
    curves = np.outer(sizes / np.sqrt(np.mean(wave**2)), wave)
    measure = Measure("x", "m", curves, 1e-9, "")

    feature = feature_of(measure, np.zeros(7, dtype=int), np.ones(7, dtype=bool))

    assert feature.distance[4] < 0
    assert feature.distance[5] > 50


def test_four_of_twelve_do_not_hide_in_the_scatter_that_they_make():
    light = {"w0": 0.7, "w2": 0.72, "w4": 0.78, "w8": 0.6}

    assert set(reasons(loaded_session(light))) == set(light)


def test_a_crossing_is_not_judged_by_its_turn():
    """Gaits are compared until the earliest onset: later ones may have turned already."""
    crossings = [replace(c, onset=0.5) if c.name == "w1" else c for c in session()]

    turned = [
        replace(c, theta=c.theta + 0.2 * (c.time > c.onset - 0.02)) if c.onset else c
        for c in crossings
    ]

    assert reasons(turned) == {}


def test_a_stance_is_compared_among_those_of_its_direction():
    """Of eleven, three stances are prolonged by a turn up by 0.2 s, one by a turn down by 0.4 s."""
    crossings = [replace(c, onset=None, turn=None) for c in session()]
    for k, turn, longer_s in ((1, TURN, 0.2), (5, TURN, 0.2), (9, TURN, 0.2), (3, -TURN, 0.4)):
        stance = Stance(0.3, crossings[k].stance.toe_off + longer_s)
        crossings[k] = replace(crossings[k], onset=0.6, turn=turn, stance=stance)

    features = crossing_features(crossings, settings())

    (stance_feature,) = (feature for feature in features if feature.measure.name == "stance")
    assert stance_feature.distance.max() < 5


LONG = ("w1", "w3", "w5")  # three of five perturbed ones, bent by 0.3 rad before


def test_crossings_that_start_otherwise_do_not_tell_a_usual_stance():
    """Three of five perturbed ones: their median would make outliers of the two sound ones."""
    crossings = []
    for plain in session():
        long = replace(plain, theta=plain.theta + 0.3, stance=Stance(0.3, 1.2))
        crossings.append(long if plain.name in LONG else plain)

    assert set(reasons(crossings)) == set(LONG)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (loaded(LAST, mass=70), None),
        (loaded(LAST, share=0.6), None),  # of a person whose mass nobody states
        (loaded(LAST, share=0.6, mass=70), "plate.* 0.5"),
        (loaded(LAST, mass=35), "plate.* 1."),
    ],
)
def test_a_load_far_from_the_known_weight_is_excluded(changed, message):
    (row,) = selected([changed], settings()).values()

    if message is None:
        assert (row["status"], row["reason"]) == ("used", None)
    else:
        assert row["status"] == "outlier"
        assert re.search(message, row["reason"])


def test_a_difference_counts_where_half_of_a_kind_of_crossings_have_it():
    rows = pl.DataFrame(
        {
            "perturbed": [True, True, False, False, False, False],
            "different": ["a marker", "corners", "corners", "corners", "ankle", "a marker"],
            "different_mm": [1.0, 2.0, 20.0, 30.0, 90.0, 40.0],
        }
    )

    assert set_up_difference(rows) == ("corners", 25.0)


def test_a_difference_that_most_crossings_of_a_kind_do_not_have_is_none():
    rows = pl.DataFrame(
        {
            "perturbed": [False] * 3,
            "different": ["a marker", "corners", "ankle"],
            "different_mm": [40.0, 20.0, 90.0],
        }
    )

    assert set_up_difference(rows) == (None, None)


@pytest.mark.parametrize(("beside_m", "outside_m"), [(0.0, 0.0), (0.05, 0.0), (0.13, 0.03)])
def test_the_pressure_is_outside_as_far_as_it_is_from_the_foot(beside_m, outside_m):
    """A foot of 0.2 m that rests, and a centre of pressure to its left."""
    corners = FACE / [3, 2, 1]
    pressure = np.tile([0.02, beside_m, 0.0], (5, 1))

    assert cop_outside(pressure, np.tile(corners, (5, 1, 1))) == pytest.approx(outside_m)


LATE = [doubt("late_torque", "K")]


@pytest.mark.parametrize(
    ("estimator", "wide", "doubts", "expected"),
    [
        ("ensemble", ["K"], [], "wide"),
        ("ensemble", ["K_predicted"], [], "clear"),
        ("ensemble, predicted gait", ["K"], [], "clear"),
        ("ensemble, predicted gait", ["K_predicted"], [], "wide"),
        ("ensemble, predicted gait", ["K_predicted"], LATE, "delay of the torque"),
        ("mean of perturbations", ["K"], [], None),
        ("mean of perturbations", [], LATE, "delay of the torque"),
    ],
)
def test_each_estimator_of_a_group_has_its_own_width(estimator, wide, doubts, expected):
    row = {"estimator": estimator, "quantity": "K", "mean": 300.0, "wide_estimates": wide}

    assert estimate_verdict(row, doubts) == expected
