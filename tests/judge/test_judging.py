"""A doubt may move an estimate by more than the accuracy that it needs; of less nothing is said."""

import re

import polars as pl
import pytest
from conftest import beyond_in, findings_of

from osl_analysis.judge.finding import Grade
from osl_analysis.judge.judging import judged
from osl_analysis.judge.known_findings import CHECKS
from osl_analysis.judge.limits import Accuracy, DoubtfulFits, Limits
from osl_analysis.judge.recording_checks import spoiled_trials
from osl_analysis.judge.words import finding_text
from osl_analysis.stats.repeats import doubts_of_trials

KNEE = {
    "trial": "knee", "fault_family": "path",
    "K_fault_share": 0.0006, "B_fault_share": 0.01, "I_fault_share": 0.003,
    "K": 150.0, "K_low": 149.85, "K_high": 150.15,
    "B": 3.0, "B_low": 2.97, "B_high": 3.03,
    "I": 0.03, "I_low": 0.0299, "I_high": 0.0301,
}  # fmt: skip
"""A sound knee: K is known to 0.1 %, and a torque path would move it by 0.06 %. It is judged as a
row of `law`, of which no other number is asked."""


def grades(row, **accuracy):
    limits = Limits(accuracy=Accuracy(**accuracy))
    return [(finding.cause, finding.grade) for finding in findings_of(row, limits, "law")]


@pytest.mark.parametrize(("column", "share", "cause"), [
    ("K_fault_share", 0.02, "torque path"),
    ("B_fault_share", 0.05, "torque path"),
    ("I_fault_share", 0.2, "torque path"),
    ("B_j_fault_share", 0.05, "torque path"),
    ("K_unexplained_share", 0.02, "torque that nothing explains"),
    ("I_unexplained_share", 0.2, "torque that nothing explains"),
])  # fmt: skip
def test_a_move_beyond_the_accuracy_of_any_one_estimate_is_a_doubt(column, share, cause):
    beyond = KNEE | {column: 1.05 * share}

    assert grades(beyond) == [(cause, Grade.DOUBTS)]
    assert grades(KNEE | {column: 0.95 * share}) == []
    assert grades(beyond, K=0.1, B=0.2, I=0.5) == []


def test_a_path_that_moves_less_than_is_needed_is_told():
    findings = findings_of(KNEE, Limits(), "impedance")

    assert ("torque path", Grade.NOTES) in [(each.cause, each.grade) for each in findings]


def test_an_explanation_of_several_estimates_is_told_once():
    row = KNEE | {"K_fault_share": 0.07, "B_fault_share": 0.2, "explanations": "delay"}

    (doubt,) = findings_of(row, Limits(), "impedance")

    text = finding_text(doubt, row)
    assert text.lower().count("explained by delay") == 1
    assert "It would move B by up to 20 %" in text


def test_other_causes_yield_to_a_fault_of_the_recording():
    row = KNEE | {"K_fault_share": 0.07, "VAF_held_out": 50.0, "B_unexplained_share": 0.5}
    table = pl.DataFrame(
        [row, KNEE | {"trial": "unmoved", "VAF_held_out": 99.0}], infer_schema_length=None
    )
    verdicts = pl.DataFrame({"trial": ["knee", "unmoved"], "check": "dropout", "verdict": "flag"})
    limits = Limits(below={"VAF_held_out": 90})

    findings, sound = judged(table, limits, "impedance", spoiled_trials(verdicts))

    doubts = [each.name for each in findings if each.grade is Grade.DOUBTS]
    assert doubts == ["signal_jumps"]
    assert not any(each.grade is Grade.DOUBTS for each in sound), "it moves nothing"


@pytest.mark.parametrize(("B_over_B_d", "is_told"), [(0.738, True), (0.544, False)])
def test_one_factor_of_both_gains_names_its_unit(B_over_B_d, is_told):
    """A spring in series would take the square of its factor off the damping."""
    row = {"trial": "a", "K_over_K_d": 1 / 1.3558, "B_over_B_d": B_over_B_d}

    findings = findings_of(row, Limits(), "impedance")

    texts = [finding_text(each, row) for each in findings if each.cause == "another unit"]
    assert [bool(re.search(r"lbf\*ft.*N\*m", text)) for text in texts] == [True] * is_told


@pytest.mark.parametrize(("moved_by", "name"), [(0.0, "unlikely_size"), (0.1, "nonlinear_spring")])
def test_no_unit_is_asked_for_where_a_cause_explains_the_ratio_to_K_d(moved_by, name):
    row = {"trial": "a", "K_over_K_d": 1.2, "K_fault_share": moved_by, "fault_family": "size"}
    unexplained = dict.fromkeys(("K_unexplained_share", "B_unexplained_share"), 0.0)

    findings = findings_of({**row, **unexplained}, Limits(), "impedance")

    (first, *_) = [each.name for each in findings if each.grade is not Grade.UNCHECKED]
    assert first == name


@pytest.mark.parametrize(("K_over_K_d", "is_doubted"), [(1.0, False), (None, True)])
def test_no_unit_of_a_small_angle_is_asked_for_where_K_is_the_desired_one(K_over_K_d, is_doubted):
    row = {"trial": "a", "theta_rms_deg": 0.1, "K": 300.0, "K_ratio": None}

    findings = findings_of({**row, "K_over_K_d": K_over_K_d}, Limits(), "impedance")

    assert ("unlikely_size" in [each.name for each in findings]) == is_doubted


@pytest.mark.parametrize(("row", "shift", "is_doubted"), [
    # of 300 +- 3 N*m/rad, 2 half-widths are 2 %
    ({"K": 300.0, "K_low": 297.0, "K_high": 303.0}, 2.01, True),
    ({"K": 300.0, "K_low": 297.0, "K_high": 303.0}, 1.99, False),
    # an estimate that is not told from zero is moved by any number of half-widths
    ({"I": 0.0, "I_low": -0.01, "I_high": 0.01}, 1.01, True),
    # what is within the interval is none, whatever it moves
    ({"I": 0.0, "I_low": -0.01, "I_high": 0.01}, 0.99, False),
])  # fmt: skip
def test_other_time_stamps_move_an_estimate_by_half_widths_of_its_interval(row, shift, is_doubted):
    row = {
        "trial": "a",
        **{f"{symbol}{end}": 1.0 for symbol in "KBI" for end in ("", "_low", "_high")},
        **row,
        "time_base_shift": shift,
    }

    doubts = [each.name for each in findings_of(row, Limits(), "impedance")]

    assert doubts == ["undecided_time_stamps"] * is_doubted


@pytest.mark.parametrize(("ratio", "is_beyond"), [(2.1, True), (0.49, True), (0.51, False)])
def test_a_ratio_has_one_limit_for_both_sides(ratio, is_beyond):
    found = findings_of({"some_ratio": ratio}, Limits(ratio={"some_ratio": 2}), "belt")

    assert [finding.name for finding in found] == ["some_ratio"] * is_beyond


@pytest.mark.parametrize(("change", "family", "finding"), [
    (0.03, None, "nonlinear_spring"),
    (-0.03, "size", "nonlinear_spring"),
    (-0.03, None, "friction"),
])  # fmt: skip
def test_of_several_rules_on_a_number_the_first_that_is_met_counts(change, family, finding):
    row = {"trial": "a", "K_change": change, "fault_family": family}

    assert [each.name for each in findings_of(row, Limits(), "response")] == [finding]


def test_an_impossible_estimate_comes_before_what_it_may_have_caused():
    row = {"group": "all", "onset_phase_sd": 9.0, "K": -5.0, "B": 1.0, "I": 0.1}
    limits = Limits(above={"onset_phase_sd": 8}, below={"K": 0})

    findings = findings_of(row, limits, "walking")

    assert [finding.cause for finding in findings][:2] == [
        "impossible estimate",
        "group of several conditions",
    ]


def test_a_clock_of_99_99_hz_passes_a_limit_of_100_hz_and_99_does_not():
    rate = CHECKS["rate"]

    assert not rate.failed(99.99, 100)
    assert rate.failed(99.0, 100)
    assert not CHECKS["gap"].failed(0.05004, 0.05)
    assert CHECKS["gap"].failed(0.051, 0.05)


def test_limits_of_every_table_stand_on_the_columns_that_a_table_has():
    limits = DoubtfulFits.model_validate({"actuator": {"above": {"f_C_ratio": 2}}}).of("actuator")

    found = findings_of({"f_C_ratio": 3.0, "condition_number": 101.0}, limits, "actuator")

    assert beyond_in(found) == {"f_C_ratio": "above", "condition_number": "above"}
    with pytest.raises(ValueError, match=r"condition_number"):
        DoubtfulFits.model_validate({"belt": {"above": {"condition_number": 10}}})


def test_rows_of_single_amplitudes_share_the_doubt_of_their_trial():
    table = pl.DataFrame({
        "trial": ["a", "a", "b", "b"], "amplitude_deg": [2.0, None, 2.0, None],
        "doubtful": ["", "friction", "friction", ""],
    })  # fmt: skip

    assert doubts_of_trials(table)["doubtful"].to_list() == ["friction", "friction", "", ""]
