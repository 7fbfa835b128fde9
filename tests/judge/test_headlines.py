# SPDX-License-Identifier: Apache-2.0
"""Doubts and headline numbers: limits on any column, the mark on its way to the reader, JSON, LaTeX
and Markdown."""

import os

import polars as pl
import pytest
from conftest import beyond_in, doubt, findings_of, marked

from osl_analysis.dictionary.described import table_of
from osl_analysis.jobs.progress import later_failures, write_log
from osl_analysis.judge.campaign import campaign_findings, causes_in_campaign, table_findings
from osl_analysis.judge.findings import Finding, findings_table, read_findings, view_of
from osl_analysis.judge.joining import JOINED_COLUMNS, joined
from osl_analysis.judge.judging import judged
from osl_analysis.judge.limits import Limits
from osl_analysis.judge.rules import Beyond, Grade
from osl_analysis.stats.budget import Budget, Contribution, budget_rows
from osl_analysis.stats.doubts import DOUBTS, counted
from osl_analysis.stats.repeats import summary_of_trials
from osl_analysis.stats.sources import Source


def fits(**columns):
    return pl.DataFrame({"trial": ["a", "b"], **columns})


def doubts(row, above, below):
    return findings_of(row, Limits(above=above, below=below), "response")


def causes_of(table, limits):
    return [[finding.cause for finding in row] for row in judged(table, limits, "response")]


UNCHECKED = pl.DataFrame(schema=["trial", "check", "verdict"])
"""The verdicts of recordings of which nothing was checked."""


def test_a_fit_is_doubtful_for_every_limit_that_it_passes():
    row = {"fit": 80.0, "lag": -0.7, "condition": 5.0, "held_out": None, "n": 3}
    findings = doubts(row, {"lag": 0.5, "condition": 10, "n": 2}, {"fit": 90, "held_out": 80})
    (doubt,) = findings
    assert doubt.source == Source.STATED_LIMIT
    assert [(number.column, number.value, number.limit) for number in doubt.evidence] == [
        ("lag", -0.7, -0.5), ("n", 3.0, 2), ("fit", 80.0, 90),
    ]  # fmt: skip
    assert doubts(row, {"lag": 0.7, "condition": None}, {"fit": 80}) == []
    assert beyond_in(doubts({"fit": float("nan")}, {}, {"fit": 90})) == {"fit": "nan"}


def test_a_named_cause_stands_before_torque_that_nothing_explains():
    group = {"group": "all", "VAF": 60.0, "marker_noise_ratio": 1e-7}

    findings = findings_of(group, Limits(below={"VAF": 80.0}), "walking_groups")

    assert [finding.source for finding in findings] == ["smoothed_markers", "unexplained_torque"]


@pytest.mark.parametrize(
    ("value", "limit", "side", "excess"),
    [
        (30.0, 90.0, "below", 3.0),
        (-1.5, -0.5, "below", 3.0),
        (-5.0, 0.0, "below", float("inf")),
    ],
)
def test_a_number_is_as_far_beyond_its_limit_below_it_as_above_it(value, limit, side, excess):
    number = Beyond("VAF", value, limit, Source.UNEXPLAINED_TORQUE, side)

    assert number.excess == pytest.approx(excess)


def test_a_crossing_without_a_fit_is_neither_doubtful_nor_not():
    table = marked(
        fits(vaf=[None, 80.0], reason=["no markers", None]), Limits(below={"vaf": 90}), "walking"
    )
    assert table["doubtful"].to_list() == [None, "beyond a stated limit"]


@pytest.mark.parametrize(
    ("n_doubtful", "mean", "sd"),
    [(0, 700.0, 10.0), (1, 705.0, 50**0.5), (2, 710.0, None), (3, None, None)],
)
def test_a_mean_is_over_trials_that_are_not_doubtful_however_few(n_doubtful, mean, sd):
    doubts = [[doubt("clipped_signal")]] * n_doubtful + [[]] * (3 - n_doubtful)
    cells = pl.Series(doubts, dtype=JOINED_COLUMNS[DOUBTS])
    table = pl.DataFrame({"K_s": [690.0, 700.0, 710.0], DOUBTS: cells})

    (row,) = summary_of_trials(table, ["K_s"]).to_dicts()

    assert (row["n"], row["n_doubtful"]) == (3 - n_doubtful, n_doubtful)
    assert row["mean"] == mean
    assert (row["interval_method"] == "Student") == (sd is not None)
    assert row["sd"] == (sd if sd is None else pytest.approx(sd))
    assert len(counted(table.drop(DOUBTS))) == 3


def test_responses_share_the_doubts_of_the_fit_of_their_trial_and_amplitude():
    late = Finding("late_torque", "impedance", "a", amplitude_deg=2.0, estimates=("K",))
    trial_doubt = Finding("friction", "impedance", "a", estimates=("B",))
    response = pl.DataFrame({"trial": "a", "amplitude_deg": [2.0, 2.0, 4.0, None]})

    shared = joined(response, "response", [late, trial_doubt])

    late_K, friction_B = doubt("late_torque", "K"), doubt("friction", "B")
    assert shared[DOUBTS].to_list() == [[late_K, friction_B]] * 2 + [[friction_B]] * 2


def test_a_finding_of_a_source_that_there_is_not_is_no_row_of_the_table():
    with pytest.raises(ValueError, match="late_torqe"):
        findings_table([Finding("late_torqe", "impedance", "a")])


def test_numbers_that_a_failed_run_left_behind_are_said_to_be_old(tmp_path):
    summary = tmp_path / "summary.json"
    summary.write_text("{}")
    refused = {"outcome": "refused", "error": "b_1.mcap: no such file"}
    for job, later, ending, old in (
        ("ingest.before", -1, refused, False),
        ("bench.fine", 1, {"outcome": "done"}, False),
        ("ingest.after", 1, refused, True),
    ):
        log = tmp_path / f"logs/{job}.log"
        write_log(log, {"job": f"osl_analysis.commands.{job}", **ending})
        os.utime(log, (summary.stat().st_mtime + later,) * 2)
        assert ("b_1.mcap: no such file" in later_failures(summary)) == old


def test_what_a_run_refused_before_its_own_verdict_is_no_later_failure(tmp_path):
    summary = tmp_path / "summary.json"
    summary.write_text("{}")
    for job, later in (("methods", 1), ("verdict", 2)):
        log = tmp_path / f"logs/{job}.log"
        write_log(log, {"outcome": "refused", "error": "b_1.mcap: no such file"})
        os.utime(log, (summary.stat().st_mtime + later,) * 2)

    assert not later_failures(summary)


def test_a_finding_that_is_written_is_read_as_it_was_made(tmp_path):
    late = Source.LATE_TORQUE
    findings = [
        Finding(
            source=late,
            table="impedance",
            subject="t",
            grade=Grade.DOUBTS,
            evidence=(Beyond("B", 0.3, 0.1, late, probability=0.9), Beyond("I", 0.1, 0.05, late)),
            amplitude_deg=4.0,
            estimates=("B", "I"),
            joint="ankle",
            says="what is wrong",
            size="by 0.3",
            remedy="what to do",
        ),
        Finding("fixture_inertia", "transmission", "=t", Grade.UNCHECKED),
    ]
    table = findings_table(findings)
    table.write_parquet(tmp_path / "findings.parquet")

    assert read_findings([tmp_path / "findings.parquet"]) == findings
    assert view_of(table)["estimates"].to_list() == ["B, I", "B, I", None]
    assert table["grade"].dtype.categories.to_list() == [grade.value for grade in Grade]


def friction(trial, share):
    evidence = (Beyond("B", share, 0.05, Source.FRICTION, "above"),)
    return Finding("friction", "impedance", trial, evidence=evidence, size=f"that of {trial}")


def test_the_worst_trial_of_a_cause_has_the_largest_number_shown():
    impedance = fits(B=[0.6, 2.0])

    findings = [friction("a", 0.3), friction("b", 0.5)]
    (cause,) = causes_in_campaign(findings, {"impedance": impedance}, UNCHECKED)

    assert (cause.worst, cause.size) == ("b", "that of b")


def test_a_trial_that_is_doubtful_is_not_counted_again_as_doubtful_in_part():
    tables = {"impedance": fits(B=1.0)}
    findings = [friction("a", 0.5)]
    for trial in "ab":
        findings.append(Finding("other_motion", "impedance", trial, amplitude_deg=2.0))

    causes = causes_in_campaign(findings, tables, UNCHECKED)

    assert {cause.verdict: cause.trials for cause in causes} == {
        "doubtful": ["a"],
        "doubtful in part": ["b"],
    }


def test_a_delay_that_a_trial_does_not_tell_is_listed_though_another_tells_its_own():
    impedance = fits(B=[2.0, 2.0], lag_s=[None, 1e-4])
    unchecked = Contribution("late_torque", None, part="fault", per="0.3 N*m*s/rad per ms")
    rows = budget_rows({"trial": "a"}, {"B": Budget(2.0, (unchecked,))})

    findings = table_findings(impedance, Limits(), "impedance", budget=table_of(rows, "budget"))

    assert "late_torque" in [finding.source for finding in findings]


def test_a_fact_that_a_check_and_a_fit_tell_is_one_finding():
    impedance = fits(saturated_samples=[9, 0])
    verdicts = fits(check="saturation", verdict="flag", value=9.0, unit="samples", remark="")

    findings = campaign_findings(table_findings(impedance, Limits(), "impedance"), verdicts)

    clipped = [finding for finding in findings if finding.source == "clipped_signal"]
    assert [(finding.subject, finding.table) for finding in clipped] == [
        ("b", "quality"),
        ("a", "impedance"),
    ]


def test_a_trial_that_is_used_without_its_end_is_doubtful_for_a_damaged_log():
    verdicts = pl.DataFrame(
        {
            "trial": ["flagged", "sound", "left_out"],
            "verdict": ["flag", "pass", "exclude"],
            "check": "truncated",
            "value": 1.0,
            "unit": "logs",
            "remark": "",
        }
    )

    all_findings = campaign_findings([], verdicts)
    findings_on_others = campaign_findings([], verdicts[1:])

    doubts = [finding for finding in all_findings if finding.grade is Grade.DOUBTS]
    assert [(finding.subject, finding.cause) for finding in doubts] == [("flagged", "damaged log")]
    assert [finding for finding in findings_on_others if finding.grade is Grade.DOUBTS] == []


def test_a_check_of_a_trial_is_not_hidden_by_a_doubt_at_one_amplitude():
    impedance = fits(B=[2.0, 2.0], amplitude_deg=[2.0, None], saturated_samples=[9, 9])
    verdicts = fits(check="saturation", verdict="flag", value=9.0, unit="samples", remark="")

    findings = campaign_findings(table_findings(impedance, Limits(), "impedance"), verdicts)

    clipped = [finding for finding in findings if finding.source == "clipped_signal"]
    assert [(finding.subject, finding.table, finding.amplitude_deg) for finding in clipped] == [
        ("a", "quality", None),
        ("a", "impedance", 2.0),
        ("b", "impedance", None),
    ]
