# SPDX-License-Identifier: Apache-2.0
"""The claims of a text (`judge/claims.py`), and the pairs of trials of `compensation.csv`."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from conftest import doubt

from osl_analysis.base.errors import InputError
from osl_analysis.bench.summaries import compensation_table
from osl_analysis.judge.claims import Claim, claims_table, read_claims

VISCOUS = {"B_viscous": 5.25, "B_viscous_low": 5.0, "B_viscous_high": 5.5}


def fit(controller, B, half, **stated):
    """A fit of K = K_d with this B and the half-width of its interval."""
    row = {
        "joint": "ankle",
        "side": None,
        "controller": controller,
        "K_d": 100.0,
        "B_d": 5.0,
        "K": 100.0,
        "K_low": 99.0,
        "K_high": 101.0,
        "B": B,
        "B_low": B - half,
        "B_high": B + half,
        "B_viscous": None,
        "B_viscous_low": None,
        "B_viscous_high": None,
        "torque_error": 1.0,
        "VAF": 99.0,
        "amplitude_deg": None,
        "commanded_deg": None,
        "doubts": [],
        **stated,
    }
    return {"trial": f"{controller} {row['K_d']}", **row}


def pairs(*compensated_and_not):
    """Fits of both controllers with these |B - B_d| and half-widths, a condition each."""
    rows = []
    for number, (compensated, uncompensated) in enumerate(compensated_and_not):
        K_d = 100.0 * (number + 1)
        for controller, (error, half) in zip(
            ("compensated", "uncompensated"), (compensated, uncompensated), strict=True
        ):
            ends = {"K": K_d, "K_low": K_d - 1, "K_high": K_d + 1}
            rows.append(fit(controller, 5.0 + error, half, K_d=K_d, **ends))
    return rows


def damping_pairs(fits, quantity="B_error"):
    table = compensation_table(pl.DataFrame(fits, infer_schema_length=None))
    return table.filter(quantity=quantity)


def test_the_difference_of_a_pair_has_the_root_of_both_squared_half_widths():
    rows = damping_pairs(pairs(((1.0, 0.3), (2.0, 0.4)), ((0.5, 0.6), (0.7, 0.8))))

    first, second = rows.filter(of="trial").to_dicts()
    (all_pairs,) = rows.filter(of="trials").to_dicts()
    ends = ("difference", "difference_low", "difference_high")
    assert [first[end] for end in ends] == pytest.approx([-1.0, -1.5, -0.5])
    assert [second[end] for end in ends] == pytest.approx([-0.2, -1.2, 0.8])
    assert [all_pairs[end] for end in ends] == pytest.approx([-0.6, -1.0, -0.2])
    assert (all_pairs["pairs"], all_pairs["better"]) == (2, 2)
    assert (all_pairs["compensated"], all_pairs["uncompensated"]) == pytest.approx((0.75, 1.35))


def test_damping_is_compared_with_friction_on_both_sides_or_without_it():
    one_side = [fit("compensated", 6.0, 0.1), fit("uncompensated", 7.0, 0.1, **VISCOUS)]
    both = [fit("compensated", 6.0, 0.1, **VISCOUS), one_side[1]]

    assert damping_pairs(one_side).filter(of="trials")["uncompensated"].item() == pytest.approx(2)
    assert damping_pairs(one_side, "B_viscous_error").is_empty()
    row = damping_pairs(both, "B_viscous_error").row(-1, named=True)
    assert (row["compensated"], row["difference"]) == pytest.approx((0.25, 0.0))
    assert row["difference_high"] == pytest.approx(np.hypot(0.25, 0.25))


def test_a_doubtful_trial_has_no_pair():
    fits = pairs(((1.0, 0.1), (2.0, 0.1)), ((1.0, 0.1), (9.0, 0.1)))
    fits[-1]["doubts"] = [doubt("late_torque")]

    assert damping_pairs(fits).filter(of="trials")["difference"].item() == pytest.approx(-1.0)


BETTER = ((1.0, 0.3), (2.0, 0.4))
WORSE = ((2.0, 0.3), (1.0, 0.4))
UNSURE = ((1.0, 0.3), (1.1, 0.4))
UNSURE_WORSE = ((1.1, 0.3), (1.0, 0.4))
CLOSER = {
    "says": "damping is closer",
    "at": "Fig. 5",
    "table": "impedance",
    "number": "B",
    "low": "B_low",
    "high": "B_high",
    "unit": "N*m*s/rad",
    "target": "B_d",
    "margin": 0,
    "controller": "compensated",
    "than": "uncompensated",
    "pairs": ("K_d", "B_d"),
}


def verdict_on(rows, **stated):
    claims = {"c": Claim.model_validate(CLOSER | stated)}
    table = pl.DataFrame(rows, infer_schema_length=None)
    return claims_table({"impedance": table}, claims).row(0, named=True)


@pytest.mark.parametrize(
    ("conditions", "verdict"),
    [
        ([BETTER, BETTER, UNSURE], "holds"),
        ([BETTER, BETTER, UNSURE_WORSE], "undecided"),
        ([BETTER] * 9 + [WORSE], "mixed"),
        ([WORSE, WORSE, UNSURE_WORSE], "fails"),
    ],
)
def test_a_verdict_over_conditions_rests_on_the_interval_of_each(conditions, verdict):
    row = verdict_on(pairs(*conditions))

    n_better = len(conditions) - conditions.count(WORSE) - conditions.count(UNSURE_WORSE)
    n = len(conditions)
    assert (row["verdict"], row["n"]) == (verdict, n)
    assert f"nearer in {n_better} of {n}," in row["quantity"]
    assert row["quantity"].endswith(f"with none of it in {conditions.count(WORSE)}")


def test_a_pair_is_nearer_only_by_more_than_the_margin():
    by_one = pairs(((1.0, 0.1), (2.0, 0.1)))

    row = verdict_on(by_one, margin=0.5, better="higher")

    assert (row["verdict"], row["value"], row["quantity"]) == ("holds", 1.0, "higher")
    assert verdict_on(by_one, margin=1.5)["verdict"] == "fails"


def test_what_one_of_a_pair_lacks_is_not_compared_and_few_decide_nothing():
    rows = pairs(BETTER, BETTER, BETTER)
    for row in rows[2:]:
        row["B"] = None

    row = verdict_on(rows)

    assert (row["n"], row["among"], row["verdict"]) == (1, 3, "undecided")


def test_a_doubtful_trial_and_another_controller_are_in_no_pair():
    rows = pairs(BETTER, BETTER)
    rows[0]["doubts"] = [doubt("torque_path", "K", "B")]
    rows[3]["controller"] = "other"

    assert verdict_on(rows)["verdict"] == "not tested"


def test_a_doubt_about_another_estimate_takes_no_pair_out():
    rows = pairs(BETTER, BETTER)
    rows[0]["doubtful"] = "I: torque path"

    assert verdict_on(rows)["n"] == 2


@pytest.mark.parametrize(
    ("B", "verdict"), [(5.2, "holds"), (5.9, "undecided"), (6.5, "fails"), (3.5, "fails")]
)
def test_a_number_is_its_target_if_its_whole_interval_is_within_the_margin(B, verdict):
    row = verdict_on([fit("compensated", B, 0.3)], margin=1.0, than=None)

    assert (row["verdict"], row["low"], row["value"]) == (verdict, B - 0.3, B)


def test_the_claims_of_the_draft_can_be_tested_and_a_wrong_column_is_named(tmp_path):
    shipped = read_claims(Path("config/claims/draft.yaml"))
    assert {claim.margin for claim in shipped.values() if claim.than} == {0}

    wrong = tmp_path / "own.yaml"
    wrong.write_text(
        Path("config/claims/draft.yaml").read_text().replace("number: B\n", "number: Bd\n")
    )
    with pytest.raises(InputError, match=r"damping_closer.*'Bd' is no column.*did you mean 'B_d'"):
        read_claims(wrong)
