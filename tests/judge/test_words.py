# SPDX-License-Identifier: Apache-2.0
"""The words of findings: each cause has some, numbers of a row fill them, and they decide
nothing."""

import re

import pytest
import yaml
from conftest import findings_of
from shipped import SETTINGS

from osl_analysis.bench.budgets import ERROR_SOURCES
from osl_analysis.config.experiments import JUDGED_TABLES
from osl_analysis.dictionary.described import described_tables
from osl_analysis.judge.checks import CHECKS
from osl_analysis.judge.findings import Finding
from osl_analysis.judge.known_findings import CONTENT, FINDINGS, WORDS_OF_RULES
from osl_analysis.judge.limits import DoubtfulFits, Limits
from osl_analysis.judge.rules import RULES, Grade, number_rules
from osl_analysis.judge.wording import finding_text, worded

DOUBTS = {
    *ERROR_SOURCES.values(),
    *(rule.source for rule in number_rules()),
    *(check.source for check in CHECKS.values()),
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


def test_each_source_that_is_found_has_words():
    found = {
        *ERROR_SOURCES.values(),
        *(rule.source for rule in RULES),
        *(check.source for check in CHECKS.values()),
    }

    assert found - FINDINGS.keys() == set(), "describe it under `findings` of words.yaml"


def test_each_rule_in_words_is_a_rule():
    assert WORDS_OF_RULES.keys() - {rule.name for rule in RULES} == {"stated_limit"}


def test_every_column_that_a_limit_decides_has_one():
    """A forgotten limit would never be told: the number would be beyond nothing."""
    doubtful = DoubtfulFits.model_validate(SETTINGS["doubtful"])
    limited = set()
    for table in JUDGED_TABLES:
        limits = doubtful.of(table)
        limited |= {*limits.above, *limits.below, *limits.ratio}
    without = {rule.column for rule in number_rules() if rule.limit is None}
    assert without - limited == set(), "state its limit under `doubtful`, or in judge/rules.py"


@pytest.mark.parametrize(
    ("row", "limits", "numbers"),
    [
        ({"preload": 3.0}, {"preload": 2.0}, "preload 3.* 2"),
        ({"bridged": 0.2}, {"bridged": 0.1}, "occluded in 20 % of the frames"),
    ],
)
def test_a_finding_is_said_with_the_numbers_of_its_row(row, limits, numbers):
    judged_row = row | {"J_j_ratio": 1.0}
    (finding,) = findings_of(judged_row, Limits(above=limits), "response")
    assert re.search(numbers, finding_text(finding))


def test_what_was_not_checked_has_words_of_its_own():
    late = Finding("late_torque", "impedance", "a", Grade.UNCHECKED, size="B 0.3 per ms")

    worded_finding = worded(late, {"lag_s": 1e-3})

    assert "may not be of the same instant" in worded_finding.says
    assert "`calibration`" in worded_finding.remedy
    assert worded_finding.size == "B 0.3 per ms"


@pytest.mark.parametrize(
    ("row", "remedy"),
    [
        ({"lag_s": 4.21e-4}, r"0\.421 ms .*`delay`"),
        ({}, r"^\D*$"),
    ],
)
def test_the_delay_that_is_advised_is_the_one_that_was_found(row, remedy):
    late = Finding("late_torque", "impedance", "a", Grade.DOUBTS)

    assert re.search(remedy, worded(late, row).remedy)


def test_each_number_that_a_text_names_is_a_column_or_is_computed():
    """A misspelt name would leave its sentence out without a word."""
    columns = {name for table in described_tables() for name in (*table.columns, *table.of_fits)}
    texts = yaml.safe_dump(CONTENT, width=10_000)
    named = set(re.findall(r"(?<!\w: )(?<!\{)\{([A-Za-z_]+)[:.}]", texts))
    assert named - columns == {"percent", "column"}
