"""What is told to be unchecked in a row: only what could change K much."""

import pytest

from osl_analysis.judge.known_findings import known_finding
from osl_analysis.judge.unchecked import unchecked_in
from osl_analysis.judge.words import finding_text

GAIN = known_finding("wrong_gain_unseen").title


def unchecked_causes(table, row):
    return [finding.cause for finding in unchecked_in(table, row)]


@pytest.mark.parametrize(("table", "name", "near", "far"), [
    ("belt", "K_s", 1.04, 0.94),
    ("actuator", "k_tau_n_m", 0.96, 1.06),
    ("transmission", "B_j", 1.09, 0.89),  # losses differ by more
])  # fmt: skip
def test_a_component_is_noted_if_it_is_unusually_far_off_its_file(table, name, near, far):
    known = {"trial": "a", "fault_probability": 0.0}

    assert unchecked_causes(table, known | {f"{name}_ratio": near}) == []
    assert unchecked_causes(table, known | {f"{name}_ratio": far}) == [
        f"{name} is not that of the parameter file"
    ]


@pytest.mark.parametrize(("table", "name"), [("belt", "K_s"), ("actuator", "k_tau_n_m")])
def test_a_component_without_a_file_tells_no_gain(table, name):
    row = {"trial": "a", f"{name}_ratio": None}

    (finding,) = unchecked_in(table, row)

    assert "so a wrong gain would not show" in finding_text(finding, row)


def test_without_known_gains_of_a_controller_it_says_which_gain_of_the_bench_would_pass():
    own = {"trial": "a", "gain_error": None, "K_over_K_d": 0.9}

    (finding,) = (one for one in unchecked_in("impedance", own) if one.name == "wrong_gain_unseen")
    text = finding_text(finding, own)

    assert "the gain may be off by a factor of 0.85 to 1.36" in text  # 0.9 / 1.06, 0.9 / 0.66
    assert "Assumed that 0.66 to 1.06 of it are rendered, as by the shipped ankle" in text
    unknown = own | {"K_over_K_d": None}
    assert "a wrong gain would not show" in finding_text(finding, unknown)


def test_a_gain_is_checked_by_a_device_or_by_its_stated_uncertainty():
    own = {"trial": "a", "gain_error": 0.0, "K_over_K_d": 0.9}

    assert GAIN not in unchecked_causes("impedance", own)


@pytest.mark.parametrize("table", ["impedance", "transmission", "torque_angle"])
def test_a_fixture_is_unchecked_until_something_of_it_is_taken_off(table):
    cause = "what turns with the joint behind the load cell"

    assert cause in unchecked_causes(table, {"trial": "a", "fixture": None})
    assert cause not in unchecked_causes(table, {"trial": "a", "fixture": "inertia 0.01"})


def test_beside_a_stated_fixture_and_of_one_alone_nobody_asks_for_it():
    cause = "what turns with the joint behind the load cell"
    stated = {"trial": "a", "fixture": "inertia 0.01"}

    assert "cross-talk of the load cell" in unchecked_causes("impedance", stated)
    alone = {"trial": "a", "fixture": None, "rest_deg": 0.1}
    assert cause not in unchecked_causes("calibration", alone)


def test_a_constant_torque_tells_that_a_fixture_may_hang_about_another_angle():
    """By hand: 5.2 N*m about an angle 60 deg off leave 4.503 N*m, and add 2.6 N*m/rad to K."""
    row = {"trial": "a", "K": 60.6, "offset": 4.503, "fixture_weight": 5.2}

    (finding,) = (each for each in unchecked_in("impedance", row) if each.name == "zeros_disagree")

    text = finding_text(finding, row)
    assert "torque is zero at -4.3 deg" in text
    assert "by up to 2.6 N*m/rad" in text
    of_load_cell = {each.name for each in unchecked_in("impedance", row | {"offset": 2.0})}
    assert "zeros_disagree" not in of_load_cell  # 0.4 N*m/rad


@pytest.mark.parametrize(("B", "is_told"), [(6.1, True), (3.1, False), (1.4, True)])
def test_a_damping_unlike_B_d_beside_a_K_of_K_d_is_told(B, is_told):
    row = {"trial": "a", "B": B, "B_over_B_d": B / 3.0}

    names = {finding.name for finding in unchecked_in("impedance", row)}

    assert ("damping_unlike_B_d" in names) == is_told


def test_what_the_walkway_does_not_show_is_said_of_each_group_with_a_result():
    assert unchecked_causes("walking_groups", {"group": "all", "K": 340.0})
    assert not unchecked_causes("walking_groups", {"group": "all", "K": None})


def test_the_rate_of_an_only_clock_is_unchecked():
    cause = known_finding("clock_rate_unseen").title

    assert cause in unchecked_causes("impedance", {"clock_ppm": None})
    assert cause not in unchecked_causes("impedance", {"clock_ppm": 12.0})
