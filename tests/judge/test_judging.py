# SPDX-License-Identifier: Apache-2.0
"""An estimate is doubtful where a fault would move it by more than it needs."""

import re

import polars as pl
import pytest
from conftest import doubt as doubt_cell
from conftest import findings_of, marked_by

from osl_analysis.dictionary.described import table_of
from osl_analysis.judge.checks import CHECKS
from osl_analysis.judge.joining import results_in, wide_estimates
from osl_analysis.judge.judging import judged
from osl_analysis.judge.limits import Accuracy, Limits
from osl_analysis.judge.rules import Grade
from osl_analysis.judge.wording import finding_text, verdict_texts
from osl_analysis.stats.budget import Budget, Contribution, budget_rows, scatter
from osl_analysis.stats.doubts import doubts_about
from osl_analysis.stats.sources import Source

KNEE = {"trial": "knee", "amplitude_deg": None, "K": 150.0, "B": 3.0, "I": 0.03}
NEEDED = {"K": 3.0, "B": 0.15, "I": 0.006}
"""What a knee needs of K, B and I by the default accuracy, to a thousandth."""


def fault(by, source="torque_path", detail="delay", **of):
    return Contribution(source, by, **{"basis": "weighed", "part": "fault", **of}, detail=detail)


def findings_on_knee(contributions, limits=None, faults=None, **columns):
    """What is found on a knee whose estimates have these contributions, but what is not checked."""
    budgets = {name: Budget(KNEE[name], tuple(rows)) for name, rows in contributions.items()}
    budget = table_of(budget_rows(KNEE, budgets), "budget")
    table = pl.DataFrame([{**KNEE, **columns}], infer_schema_length=None)
    (row_findings,) = judged(table, limits or Limits(), "impedance", faults, budget)
    return [finding for finding in row_findings if finding.grade is not Grade.UNCHECKED]


@pytest.mark.parametrize("name", ["K", "B", "I"])
def test_a_fault_is_a_doubt_about_what_it_moves_by_more_than_is_needed(name):
    rows = {symbol: [fault(0.9 * needed)] for symbol, needed in NEEDED.items()}

    (doubt,) = findings_on_knee(rows | {name: [fault(1.1 * NEEDED[name])]})

    assert (doubt.cause, doubt.grade) == ("torque path", Grade.DOUBTS)
    assert [finding.column for finding in doubt.evidence] == [name]
    (remark,) = findings_on_knee(rows)  # a likely fault below what is needed
    assert (remark.cause, remark.grade) == ("torque path", Grade.NOTES)
    assert [finding.column for finding in remark.evidence] == [*NEEDED]
    assert verdict_texts([doubt]) == dict.fromkeys("KBI", "clear") | {name: "torque path"}


def test_a_doubt_about_all_of_a_trial_is_one_about_its_amplitudes():
    single = {**KNEE, "amplitude_deg": 2.0}
    budget = Budget(KNEE["K"], (fault(10.0),))
    rows = table_of(budget_rows(KNEE, {"K": budget}), "budget")
    table = pl.DataFrame([single, KNEE])

    findings = marked_by(judged(table, Limits(), "impedance", budget=rows), table, "impedance")

    assert findings["K_verdict"].to_list() == ["torque path"] * 2
    assert findings["doubtful"].to_list() == ["K: torque path"] * 2
    assert findings["B_verdict"].to_list() == ["clear"] * 2


def test_an_accuracy_of_the_user_is_what_an_estimate_needs():
    rows = {"K": [fault(3.3)]}

    (finding,) = findings_on_knee(rows, Limits(accuracy=Accuracy(K=0.03)))

    assert (finding.grade, finding.size) == (Grade.NOTES, "K by 3.3 N*m/rad (delay)")


def test_a_likely_fault_within_the_interval_is_no_remark():
    scatter = Contribution(Source.REPEATABILITY, 1.2, part="repeatability", basis="measured")

    assert findings_on_knee({"K": [fault(2.0), scatter]}) == []


def test_a_doubt_names_its_models_sizes_and_what_they_leave():
    left = fault(4.0, "unexplained_torque", "", basis="bound")
    rows = {"K": [fault(10.0, probability=0.6), fault(9.0, detail="low-pass", probability=0.3)]}

    (alone,) = findings_on_knee(rows)
    (unbounded,) = findings_on_knee({"K": [fault(151.0)]})
    (with_unexplained,) = findings_on_knee({"K": [*rows["K"], left]})

    text = (
        "delay or low-pass, which this recording does not tell apart, would change K by 10 N*m/rad"
    )
    assert alone.size == text
    assert unbounded.size == "delay would change K by an unknown size, larger than itself"
    assert (
        with_unexplained.size == f"{text}. Torque that it leaves unexplained could change at most"
        " K by 4 N*m/rad"
    )


def test_a_check_of_the_recording_names_the_cause_of_a_doubt_and_makes_none():
    check = {"knee": "signal_jumps"}

    (doubt,) = findings_on_knee({"K": [fault(10.0)]}, faults=check)

    size = "it or delay, which this recording does not tell apart, would change K by 10 N*m/rad"
    assert (doubt.source, doubt.size) == ("signal_jumps", size)
    (remark,) = findings_on_knee({"K": [fault(0.1)]}, faults=check)
    assert (remark.source, remark.grade) == ("torque_path", Grade.NOTES)


@pytest.mark.parametrize(("half_range", "is_doubt"), [(3.3, True), (2.7, False)])
def test_a_check_that_fails_takes_what_the_motion_leaves_open_for_its_fault(half_range, is_doubt):
    moved = fault(half_range, "amplitude", "", part="motion")

    findings = findings_on_knee({"K": [moved]}, faults={"knee": "signal_jumps"})

    assert [finding.source for finding in findings] == ["signal_jumps"] * is_doubt
    assert findings_on_knee({"K": [moved]}) == []


@pytest.mark.parametrize("are_weighed", [True, False])
def test_a_clipped_torque_decides_alone_where_no_models_were_weighed(are_weighed):
    left = [fault(0.0, "unexplained_torque", "", basis="bound")] if are_weighed else []

    findings = findings_on_knee({"K": [scatter(0.1, 9), *left]}, saturated_samples=9)

    assert [finding.source for finding in findings] == ["clipped_signal"] * (not are_weighed)


def test_what_spoils_a_recording_stands_before_what_follows_from_it():
    rows = {"I": [fault(0.01, "late_torque", basis="measured")]}

    findings = findings_on_knee(rows, saturated_samples=9)

    assert [finding.source for finding in findings] == ["clipped_signal", "late_torque"]
    assert verdict_texts(findings)["I"] == "clipped signal"


def test_leaps_beside_certain_friction_are_no_fault(monkeypatch):
    moved = fault(3.3, "amplitude", "", part="motion")
    monkeypatch.setitem(KNEE, "K_without_friction", KNEE["K"])

    findings = findings_on_knee(
        {"K": [moved], "K_without_friction": [moved]}, faults={"knee": "signal_jumps"}
    )

    assert findings == []


def test_what_another_motion_changes_is_a_remark_with_its_size():
    stiffening = fault(4.0, "nonlinear_spring", "over amplitudes", part="motion")

    (remark,) = findings_on_knee({"K": [stiffening]})

    assert (remark.grade, remark.is_result, remark.size) == (
        Grade.NOTES,
        True,
        "K by 8 N*m/rad (over amplitudes)",
    )


def test_an_impossible_estimate_is_doubtful_and_no_other_of_its_row():
    (doubt,) = findings_on_knee({"K": [scatter(0.1, 9)]}, B_high=-0.1)

    assert (doubt.cause, doubt.estimates) == ("impossible estimate", ("B",))
    assert verdict_texts([doubt]) == {"K": "clear", "B": "impossible estimate", "I": "clear"}


def test_a_wide_interval_is_told_under_its_own_name_and_is_no_doubt(monkeypatch):
    monkeypatch.setitem(KNEE, "B_viscous", 3.0)
    wide = [scatter(0.1, 1e9)]

    (remark,) = findings_on_knee({"B": [scatter(0.01, 9)], "B_viscous": wide})

    size = "B_viscous is known to 0.2 N*m*s/rad (largest source: repeatability), and 0.15 is needed"
    assert (remark.source, remark.size) == ("wide_interval", size)
    assert wide_estimates([remark]) == ["B_viscous"]
    assert verdict_texts([remark])["B"] == "clear"
    assert verdict_texts(findings_on_knee({"B": wide, "B_viscous": wide}))["B"] == "wide"


def test_what_is_not_known_is_told_once_per_unit_and_not_of_the_device():
    friction = Contribution("friction", None, part="fault")
    gain = Contribution("wrong_gain", None, part="fault", per="x per %")
    budgets = {name: Budget(1.0, (gain, friction)) for name in "KB"}
    table = pl.DataFrame([KNEE])

    findings = judged(
        table, Limits(), "impedance", budget=table_of(budget_rows(KNEE, budgets), "budget")
    )

    facts = [
        (finding.source, finding.size, finding.grade, finding.is_result) for finding in findings[0]
    ]
    unchecked = (Grade.UNCHECKED, False)
    assert facts == [
        ("wrong_gain", "K x per %, B x per %", *unchecked),
        ("friction", "", *unchecked),
    ]
    (remarks,) = marked_by(findings, table, "impedance")["remarks"]
    assert remarks.endswith("not checked: friction")
    assert results_in(findings[0]) == []


@pytest.mark.parametrize(
    ("doubts", "names", "is_concerned"),
    [
        ([doubt_cell("torque_path", "K", "B")], ["K"], True),
        ([doubt_cell("torque_path", "K", "B")], ["K_d", "I"], True),
        ([doubt_cell("late_torque", "I"), doubt_cell("unlikely_size")], ["K"], True),
        ([doubt_cell("late_torque", "I")], ["VAF"], True),
        ([doubt_cell("late_torque", "I")], [], True),
        ([doubt_cell("late_torque", "B_j")], ["J_j"], False),
        ([doubt_cell("late_torque", "B")], ["B_viscous"], True),
        ([], ["K"], False),
    ],
)
def test_a_mean_leaves_out_the_estimates_that_are_doubtful(doubts, names, is_concerned):
    assert bool(doubts_about(doubts, names)) == is_concerned


@pytest.mark.parametrize(("B_over_B_d", "is_told"), [(0.738, True), (0.544, False)])
def test_one_factor_of_both_gains_names_its_unit(B_over_B_d, is_told):
    """A spring in series would take the square of its factor off the damping."""
    row = {"trial": "a", "K_over_K_d": 1 / 1.3558, "B_over_B_d": B_over_B_d}

    findings = findings_of(row, Limits(), "impedance")

    texts = [finding_text(finding) for finding in findings if finding.cause == "another unit"]
    assert [bool(re.search(r"lbf\*ft.*N\*m", text)) for text in texts] == [True] * is_told


def test_no_unit_is_asked_for_where_a_torque_path_explains_the_ratio():
    findings = findings_on_knee({"K": [fault(20.0)]}, K_over_K_d=1.2)

    assert [finding.source for finding in findings] == ["torque_path"]


@pytest.mark.parametrize(("ratio", "is_beyond"), [(2.1, True), (0.49, True), (0.51, False)])
def test_a_ratio_has_one_limit_for_both_sides(ratio, is_beyond):
    findings = findings_of({"some_ratio": ratio}, Limits(ratio={"some_ratio": 2}), "belt")

    assert [finding.source for finding in findings] == ["stated_limit"] * is_beyond


def test_a_clock_of_99_99_hz_passes_a_limit_of_100_hz_and_99_does_not():
    rate = CHECKS["rate"]

    assert not rate.failed(99.99, 100)
    assert rate.failed(99.0, 100)
    assert not CHECKS["gap"].failed(0.05004, 0.05)
    assert CHECKS["gap"].failed(0.051, 0.05)
