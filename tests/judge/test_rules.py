# SPDX-License-Identifier: Apache-2.0
"""A rule, a source or a candidate model that is misspelt does not pass for another one."""

import pytest

from osl_analysis.inference.candidate_models import CANDIDATE_MODELS, EQ_15
from osl_analysis.inference.model_names import ModelName
from osl_analysis.judge.rules import Missing, NumberRule, RowRule, Table, at_most
from osl_analysis.stats.sources import Source

RULE = {"tables": (Table.IMPEDANCE,), "column": "K", "limit": at_most(1.0)}


@pytest.mark.parametrize(("name", "changes", "words"), [
    ("too_stiff", {"column": "K_over_Kd"}, "no column 'K_over_Kd'.*K_over_K_d"),
    ("too_stiff", {"second": "B_over_Bd"}, "no column 'B_over_Bd'.*B_over_B_d"),
    ("too_stiff", {"column": "k_tau_n_m_ratio"}, "impedance has no column 'k_tau_n_m_ratio'"),
    ("too_stif", {}, "no rule 'too_stif'"),
])  # fmt: skip
def test_a_rule_of_a_column_or_of_words_that_are_not_there_is_refused(name, changes, words):
    with pytest.raises(ValueError, match=words):
        NumberRule(name, Source.UNLIKELY_SIZE, **{**RULE, **changes})


def test_a_condition_on_a_column_that_is_not_there_is_refused():
    with pytest.raises(ValueError, match=r"no column 'fixtur'.*fixture"):
        RowRule(
            "no_fixture",
            Source.FIXTURE_INERTIA,
            tables=(Table.TORQUE_ANGLE,),
            conditions=(Missing("fixtur"),),
        )


def test_each_candidate_model_is_listed_once():
    """One that was left out would be weighed by nobody."""
    assert sorted(model.name for model in CANDIDATE_MODELS) == sorted(ModelName)
    assert CANDIDATE_MODELS[0] is EQ_15
