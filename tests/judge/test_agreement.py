# SPDX-License-Identifier: Apache-2.0
"""Trials of a campaign that do not agree are told, and no others."""

import numpy as np
import pytest
from conftest import doubt

from osl_analysis.judge.agreement import disagreements
from osl_analysis.judge.rules import Grade
from osl_analysis.judge.wording import verdict_texts, worded
from osl_analysis.stats.budget import CLEAR

NEEDED = {"K": 0.02, "B": 0.05, "I": 0.2}


def trial(name, K_d, K, B=1.2, controller="compensated", half=0.001, **cells):
    """The row of a trial with half-widths that are a share of each estimate."""
    row = {
        "trial": name,
        "doubts": [],
        "controller": controller,
        "K_d": K_d,
        "B_d": 1.0,
        "K": K,
        "B": B,
        "I": 0.08,
    }
    for symbol in "KBI":
        row[f"{symbol}_low"] = row[symbol] * (1 - half)
        row[f"{symbol}_high"] = row[symbol] * (1 + half)
    return row | cells


def campaign(rng, repeats, scatter, spring=None):
    """Sound trials of five K_d; a spring in series lowers K."""
    rows = []
    for K_d in (60.0, 100.0, 150.0, 200.0, 300.0):
        for repeat in range(repeats):
            K = K_d if spring is None else 1 / (1 / K_d + 1 / spring)
            K, B = (x * (1 + scatter * rng.standard_normal()) for x in (K, 1.2))
            controller = "compensated" if spring is None else "uncompensated"
            rows.append(trial(f"{controller}{K_d:g}_{repeat}", K_d, K, B, controller))
    return rows


def sources_and_trials(rows):
    return [(finding.source, finding.subject) for finding in disagreements(rows, NEEDED)]


def test_a_mistyped_repeat_is_told_with_values_trial_and_what_to_look_at():
    rows = [trial("k90_1", 90.0, 90.1), trial("k90_2", 90.0, 90.3), trial("k90_3", 90.0, 60.0)]

    (finding,) = disagreements(rows, NEEDED)

    assert "K 90.1, 90.3, 60.0" in finding.size
    assert finding.size.endswith(": k90_3")
    assert worded(finding, {}).remedy.startswith("Is K_d right in the sheet?")


@pytest.mark.parametrize("repeats", [1, 2, 3])
@pytest.mark.parametrize("scatter", [0.0, 0.005, 0.02])
def test_sound_campaigns_are_not_told_and_a_mistyped_trial_is(repeats, scatter):
    rng = np.random.default_rng(7)
    for _ in range(10):
        rows = [*campaign(rng, repeats, scatter), *campaign(rng, repeats, scatter, 700.0)]
        assert sources_and_trials(rows) == []

        rows[1]["K_d"] *= 1.25
        assert {trial for _, trial in sources_and_trials(rows)} == {rows[1]["trial"]}


def test_two_repeats_that_differ_are_both_told_where_the_arm_tells_neither():
    rows = [
        *campaign(np.random.default_rng(1), 2, 0.0),
        trial("a", 80.0, 80.0),
        trial("b", 80.0, 86.0),
    ]

    assert sources_and_trials(rows) == [("unlike_other_trials", "a"), ("unlike_other_trials", "b")]


def test_trials_that_do_not_know_their_K_contradict_none():
    wide = trial("wide", 90.0, 60.0, half=0.4)

    assert sources_and_trials([trial("k90_1", 90.0, 90.1), trial("k90_2", 90.0, 90.3), wide]) == []
    assert sources_and_trials([*campaign(np.random.default_rng(1), 1, 0.0), wide]) == []


def test_a_well_known_repeat_is_not_accused_by_two_that_are_not():
    """90 +- 9 twice: what is 9 away from their median is within the error of that median."""
    rows = [
        trial("1", 90.0, 90.0, half=0.1),
        trial("2", 90.0, 90.2, half=0.1),
        trial("well_known", 90.0, 99.0, half=0.001),
    ]

    assert sources_and_trials(rows) == []
    for row in rows[:2]:
        row |= {"K_low": 0.99 * row["K"], "K_high": 1.01 * row["K"]}
    assert sources_and_trials(rows) == [("unlike_other_trials", "well_known")]


def test_a_doubtful_estimate_beside_a_clear_one_that_differs_is_told():
    def pair(K, doubtful):
        late = trial("late", 90.0, K, doubts=[doubt("late_torque", doubtful)])
        return [trial("clear", 90.0, 90.0), late]

    assert sources_and_trials(pair(94.0, "B")) == []
    assert sources_and_trials(pair(94.0, "K")) == [("unlike_other_trials", "late")]
    assert sources_and_trials(pair(90.5, "K")) == []


def test_a_repeat_that_differs_in_B_alone_leaves_its_K():
    rows = [trial("1", 90.0, 90.0), trial("2{}", 90.0, 90.0, B=2.4), trial("3", 90.0, 90.0)]

    (finding,) = disagreements(rows, NEEDED)

    assert verdict_texts([finding]) == {"K": CLEAR, "B": "unlike other trials", "I": CLEAR}
    assert "B 1.20, 2.40, 1.20" in finding.size
    rows[1] |= {"K": 60.0, "K_low": 59.9, "K_high": 60.1}
    (finding,) = disagreements(rows, NEEDED)
    assert set(verdict_texts([finding]).values()) == {"unlike other trials"}
    assert finding.size.endswith(": 2{}")


@pytest.mark.parametrize(
    ("factor", "units", "is_doubt"),
    [
        (0.9, [], False),
        (1.35582, ["lbf*ft"], True),
        (9.5, ["kgf*m", "kgf*cm", "lbf*in"], True),
    ],
)
def test_a_factor_of_K_and_B_is_told_with_all_units_that_fit(factor, units, is_doubt):
    rows = [trial(f"{K_d:g}", K_d, factor * K_d, factor) for K_d in (60.0, 100.0, 150.0)]

    findings = disagreements(rows, NEEDED)

    assert sources_and_trials(rows) == [("common_factor", row["trial"]) for row in rows]
    assert (findings[0].grade is Grade.DOUBTS) == is_doubt
    assert all(unit in findings[0].size for unit in units)
    assert ("factor" in findings[0].size) == bool(units)


def test_a_spring_in_series_is_no_common_factor():
    rows = campaign(np.random.default_rng(1), 1, 0.0, spring=500.0)

    assert sources_and_trials([row | {"B": row["K"] / row["K_d"]} for row in rows]) == []
