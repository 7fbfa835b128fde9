"""The words of findings: each cause has some, numbers of a row fill them, and they decide
nothing."""

import re
from pathlib import Path

import pytest
import yaml
from conftest import ROOT, findings_of

from osl_analysis.config.experiments import judged_tables
from osl_analysis.dictionary import described_tables, described_tables_by_name
from osl_analysis.judge import unchecked
from osl_analysis.judge.finding import Finding, Grade
from osl_analysis.judge.known_findings import CHECKS, CONTENT, EVIDENCE, FINDINGS
from osl_analysis.judge.limits import Limits
from osl_analysis.judge.words import (
    COMPUTED,
    OF_EVIDENCE,
    finding_text,
    words_of,
)

LATE_TORQUE = {
    "trial": "a",
    "lag_s": 2e-3,
    "lag_share": 0.1,
    "lag_inertia_share": 0.9,
    "band_high_hz": 5.0,
}
TORQUE_PATH = {
    "trial": "a",
    "fault_harm": 20.0,
    "fault": "delay",
    "fault_family": "path",
    "explanations": "delay, moving mean",
    "K_without": 300.0,
    "K_without_low": 300.0,
    "K_without_high": 300.01,
    "B_without": 4.95,
    "B_without_low": 4.9,
    "B_without_high": 5.1,
    "I_without": None,
}
FRICTION = {"trial": "a", "coulomb_share": 0.6, "B": 2.264, "B_viscous": 1.0465, "f_C": 1.402}


def finding_in_words(row, above=None, below=None):
    """The one finding about a row, in words."""
    (finding,) = findings_of(row, Limits(above=above or {}, below=below or {}), "response")
    return finding_text(finding, row)


DOUBTS = {
    *(evidence.finding for evidence in EVIDENCE.values()),
    *(check.finding for check in CHECKS.values()),
}
"""Findings that have evidence."""


def test_every_doubt_says_what_is_wrong_and_what_to_do():
    silent = [name for name in DOUBTS if not (FINDINGS[name].remedy and FINDINGS[name].brief)]

    assert silent == []
    assert all(known.says for known in FINDINGS.values())
    assert all(check.meaning for check in CHECKS.values())


def test_no_two_findings_have_one_title():
    titles = [known.title for known in FINDINGS.values()]
    assert len(titles) == len(set(titles))


def test_a_finding_without_evidence_is_not_taken_for_a_limit_on_a_column_of_its_name():
    columns = {name for table in described_tables() for name in table.columns}
    assert (FINDINGS.keys() - DOUBTS) & columns == set()


def test_what_could_not_be_checked_is_described():
    code = Path(unchecked.__file__).read_text(encoding="utf-8")
    named = set(re.findall(r'(?:yield |finding_in_row\()"(\w+)"', code))
    assert named
    assert named - FINDINGS.keys() == set(), "describe it under `findings` of findings.yaml"


def test_evidence_is_a_column_of_a_result_table():
    columns = set()
    for table in judged_tables():
        columns |= described_tables_by_name()[table].columns.keys()
    assert EVIDENCE.keys() - columns == set(), "describe the column in osl_analysis/dictionary/"


def test_every_column_that_the_configuration_decides_has_a_limit_there():
    """A forgotten limit would never be told: the number would be beyond nothing."""
    sections = yaml.safe_load((ROOT / "config/config.yaml").read_text())["doubtful"]
    limited = set()
    for name, sides in sections.items():
        if name != "accuracy":
            for columns in sides.values():
                limited |= columns.keys()
    by_configuration = {
        name for name, evidence in EVIDENCE.items() if evidence.decided_by == "configuration"
    }
    assert by_configuration - limited == set(), "state its limit under `doubtful`"


@pytest.mark.parametrize(("row", "limits", "parts"), [
    (LATE_TORQUE, {},
     ["late torque: ", "the torque is late by 2 ms, which moves B by 10 % and I by 90 %"]),
    (TORQUE_PATH, {"fault_harm": 1},
     ["torque path: ", "explained by delay, moving mean", "B 4.9 to 5.1, I not identifiable"]),
    (FRICTION, {"coulomb_share": 0.5},
     ["B 2.26, viscous part 1.05 N*m*s/rad, friction 1.40 N*m"]),
    (FRICTION | {"B_viscous": None}, {"coulomb_share": 0.5},
     ["friction makes 1.4 N*m*s/rad of B = 2.26"]),
    ({"coulomb_share": 0.6}, {"coulomb_share": 0.5},
     ["it is 60 % of the damping", "[coulomb_share 0.6 is above 0.5]"]),
])  # fmt: skip
def test_a_finding_is_said_with_the_numbers_of_its_row(row, limits, parts):
    text = finding_in_words(row | {"J_j_ratio": 1.0}, limits)
    assert [part for part in parts if part not in text] == [], text


def test_a_detail_whose_number_is_missing_is_left_out():
    (finding,) = findings_of({"lag_share": 0.1}, Limits(above={"lag_share": 0.05}), "response")
    assert words_of(finding, {"lag_share": 0.1}).size == ""
    late = Finding("late_torque_unseen", "impedance", "a", Grade.UNCHECKED)
    full, empty = (words_of(late, row) for row in ({"K": 300.0, "B": 5.0, "I": 0.02}, {}))
    assert "lower B = 5 by 0.3 N*m*s/rad and I = 0.02 by 0.005 kg*m^2" in full.says
    assert (empty.says, empty.remedy) == ("", full.remedy)


@pytest.mark.parametrize(("row", "remedy"), [
    ({"lag_s": 4.21e-4}, "Add 0.421 ms to the `delay` of the torque in"),
    ({"lag_s": -4.21e-4}, "Add 0.421 ms to the `delay` of the angle in"),
    ({}, "Measure the delay by a known spring"),
    ({"lag_s": 4e-4, "certain_lag_s": 3e-4}, ""),  # its size says what to state
])  # fmt: skip
def test_the_delay_that_is_advised_is_the_one_that_was_found(row, remedy):
    late = Finding("late_torque", "impedance", "a", Grade.DOUBTS)

    advised = words_of(late, row).remedy

    assert advised.startswith(remedy)
    assert bool(advised) is bool(remedy)


def test_each_number_that_a_text_names_is_a_column_or_is_computed():
    """A misspelt name would leave its sentence out without a word."""
    columns = {name for table in described_tables() for name in table.columns}
    texts = yaml.safe_dump(CONTENT, width=10_000)
    named = set(re.findall(r"(?<!\w: )(?<!\{)\{([A-Za-z_]+)[:.}]", texts))
    of_campaign = {"usual_s", "about"}
    assert named - columns - {*COMPUTED, *OF_EVIDENCE} == of_campaign
