"""The words of findings: each cause has some, numbers of a row fill them, and they decide
nothing."""

import re
from math import inf

import pytest
import yaml
from conftest import findings_of
from shipped import SETTINGS

from osl_analysis.config.experiments import JUDGED_TABLES
from osl_analysis.dictionary import described_tables, described_tables_by_name
from osl_analysis.judge.finding import Finding, Grade
from osl_analysis.judge.known_findings import CHECKS, CONTENT, FAMILIES, FINDINGS, RULES
from osl_analysis.judge.limits import Accuracy, DoubtfulFits, Limits
from osl_analysis.judge.words import finding_text, words_of

LATE_TORQUE = {
    "trial": "a",
    "lag_s": 2e-3,
    "lag_share": 0.1,
    "lag_inertia_share": 0.9,
    "band_high_hz": 5.0,
}
TORQUE_PATH = {
    "trial": "a",
    "fault_family": "path",
    "explanations": "delay, moving mean",
    "B_fault_share": 0.2,
}
FRICTION = {"trial": "a", "coulomb_share": 0.6, "B": 2.264, "B_viscous": 1.0465, "f_C": 1.402}


DOUBTS = {
    *FAMILIES.values(),
    *(rule.finding for rule in RULES if rule.column and rule.finding != "fault_family"),
    *(check.finding for check in CHECKS.values()),
}
"""Findings that have evidence."""


def test_every_doubt_says_what_is_wrong_and_what_to_do():
    silent = [name for name in DOUBTS if not FINDINGS[name].remedy]

    assert silent == []
    assert all(known.says for known in FINDINGS.values())
    assert all(check.meaning for check in CHECKS.values())


def test_no_two_findings_have_one_title():
    titles = [known.title for known in FINDINGS.values()]
    assert len(titles) == len(set(titles))


def test_a_finding_without_evidence_is_not_taken_for_a_limit_on_a_column_of_its_name():
    columns = {name for table in described_tables() for name in table.columns}
    assert (FINDINGS.keys() - DOUBTS) & columns == set()


def test_rules_name_findings_and_columns_of_result_tables():
    columns = set()
    for table in JUDGED_TABLES:
        described = described_tables_by_name()[table]
        columns |= {*described.columns, *described.of_fits}
    for rule in RULES:
        is_known = rule.finding in {*FINDINGS, "fault_family"}
        assert is_known, "describe it under `findings` of findings.yaml"
        named = set(rule.condition.meta.root_names() if rule.when else [])
        named -= {"accuracy_K", "accuracy_B", "accuracy_I"}
        assert {*named, *filter(None, [rule.column, rule.second])} <= columns, rule
        assert set(rule.tables) <= set(JUDGED_TABLES)
    named = {check.finding for check in CHECKS.values()} | set(FAMILIES.values())
    assert named <= FINDINGS.keys()


def test_every_column_that_a_limit_decides_has_one():
    """A forgotten limit would never be told: the number would be beyond nothing."""
    doubtful = DoubtfulFits.model_validate(SETTINGS["doubtful"])
    limited = set()
    for table in JUDGED_TABLES:
        stated = doubtful.of(table)
        limited |= {*stated.above, *stated.below, *stated.ratio}
    without = {
        rule.column
        for rule in RULES
        if rule.column and rule.ends(Accuracy().model_dump())[0] == -inf
    }
    assert without - limited == set(), "state its limit under `doubtful`, or in findings.yaml"


@pytest.mark.parametrize(("row", "limits", "numbers"), [
    (LATE_TORQUE, {},
     " 2 ms.* B .*10 %.* I .*90 %"),
    (TORQUE_PATH, {},
      "delay, moving mean.* B .*20 %"),
     (FRICTION, {},
      r"B 2\.26.* 1\.05 N\*m\*s/rad.* 1\.40 N\*m"),
     (FRICTION | {"B_viscous": None}, {},
      r"60 %.* B .*2\.26 N\*m\*s/rad"),
     ({"coulomb_share": 0.6}, {},
      r"60 %.*coulomb_share 0\.6 .*0\.05"),
     ({"preload": 3.0}, {"preload": 2.0}, "preload 3.* 2"),
     ({"plate_height_m": -0.0331}, {"plate_height_m": 0.01}, "off by -33 mm"),
     ({"bridged": 0.2}, {"bridged": 0.1}, "hidden in 20 % of the frames"),
])  # fmt: skip
def test_a_finding_is_said_with_the_numbers_of_its_row(row, limits, numbers):
    judged_row = row | {"J_j_ratio": 1.0}
    (finding,) = findings_of(judged_row, Limits(above=limits), "response")
    assert re.search(numbers, finding_text(finding, judged_row))


def test_a_detail_whose_number_is_missing_is_left_out():
    (finding,) = findings_of({"lag_share": 0.1}, Limits(above={"lag_share": 0.05}), "response")
    assert words_of(finding, {"lag_share": 0.1}).size == ""
    late = Finding("late_torque_unseen", "impedance", "a", Grade.UNCHECKED)
    full, empty = (words_of(late, row) for row in ({"K": 300.0, "B": 5.0, "I": 0.02}, {}))
    assert re.search(r"B .*5 .*0\.3 N\*m\*s/rad.* I .*0\.02 .*0\.005 kg\*m\^2", full.says)
    assert (empty.says, empty.remedy) == ("", full.remedy)


@pytest.mark.parametrize(("row", "remedy"), [
    ({"lag_s": 4.21e-4}, r"0\.421 ms .*`delay`"),
    ({}, r"^\D*$"),
])  # fmt: skip
def test_the_delay_that_is_advised_is_the_one_that_was_found(row, remedy):
    late = Finding("late_torque", "impedance", "a", Grade.DOUBTS)

    assert re.search(remedy, words_of(late, row).remedy)


def test_each_number_that_a_text_names_is_a_column_or_is_computed():
    """A misspelt name would leave its sentence out without a word."""
    columns = {name for table in described_tables() for name in (*table.columns, *table.of_fits)}
    texts = yaml.safe_dump(CONTENT, width=10_000)
    named = set(re.findall(r"(?<!\w: )(?<!\{)\{([A-Za-z_]+)[:.}]", texts))
    assert named - columns == {"percent"}
