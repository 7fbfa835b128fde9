"""The claims of the paper's text: verdicts of single claims (`judge/claims.py`)."""

import re

import numpy as np
import polars as pl
import pytest
from scipy import stats

from osl_analysis.bench.summaries import compensation_table
from osl_analysis.judge.claims import (
    Claims,
    claims_of,
    rendered_claims,
    share_claims,
    walking_claims,
)


def mean(value, se):
    return {"mean": value, "se": se, "n": 3}


def fits(*K_intervals):
    """Compensated trials of K_d = 300 with these intervals of K."""
    rows = [
        {"trial": f"t{k}", "controller": "compensated", "K_d": 300.0, "B_d": None,
         "K": (low + high) / 2, "K_low": low, "K_high": high, "theta_rms_deg": 3.0}
        for k, (low, high) in enumerate(K_intervals)
    ]  # fmt: skip
    return pl.DataFrame(rows, schema_overrides={"B_d": pl.Float64})


def test_the_interval_of_load_friction_is_that_of_its_derivative_by_the_coulomb_friction():
    f_C = 0.377
    f_C_se = 0.01
    n_T = 4.6
    means = {
        "f_C": mean(f_C, f_C_se),
        "f_G": mean(0.0896, 0.0),
        "k_tau_n_m": mean(1.02, 0.0),
    }

    known = {"K_d": 300.0, "turn": np.deg2rad(3.0), "n_T": n_T}
    (claim,) = share_claims(means, known)

    of_load = 0.0896 * 300 * np.deg2rad(3.0) / (n_T * 1.02)
    shares = [100 * of_load / (coulomb + of_load) for coulomb in (f_C - 1e-6, f_C + 1e-6)]
    slope = (shares[1] - shares[0]) / 2e-6
    half_width = stats.t.ppf(0.975, 2) * abs(slope) * f_C_se
    assert claim["high"] - claim["value"] == pytest.approx(half_width, rel=1e-4)


VISCOUS = {"B_viscous": 5.25, "B_viscous_low": 5.0, "B_viscous_high": 5.5}


def fit(controller, B, half, **stated):
    """A fit of K = K_d with this B and the half-width of its interval."""
    row = {
        "joint": "ankle", "side": None, "controller": controller, "K_d": 100.0, "B_d": 5.0,
        "K": 100.0, "K_low": 99.0, "K_high": 101.0, "B": B, "B_low": B - half, "B_high": B + half,
        "B_viscous": None, "B_viscous_low": None, "B_viscous_high": None, "torque_error": 1.0,
        "VAF": 99.0, "amplitude_deg": None, "commanded_deg": None, "doubtful": "", **stated,
    }  # fmt: skip
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


def of_damping(fits, quantity="B_error"):
    table = compensation_table(pl.DataFrame(fits, infer_schema_length=None))
    return table.filter(quantity=quantity)


def test_the_difference_of_a_pair_has_the_root_of_both_squared_half_widths():
    rows = of_damping(pairs(((1.0, 0.3), (2.0, 0.4)), ((0.5, 0.6), (0.7, 0.8))))

    first, second = rows.filter(of="trial").to_dicts()
    (all_pairs,) = rows.filter(of="trials").to_dicts()
    ends = ("difference", "difference_low", "difference_high")
    assert [first[end] for end in ends] == pytest.approx([-1.0, -1.5, -0.5])
    assert [second[end] for end in ends] == pytest.approx([-0.2, -1.2, 0.8])
    assert [all_pairs[end] for end in ends] == pytest.approx([-0.6, -1.0, -0.2])
    assert (all_pairs["pairs"], all_pairs["better"]) == (2, 2)
    assert (all_pairs["compensated"], all_pairs["uncompensated"]) == pytest.approx((0.75, 1.35))


def test_damping_is_compared_with_friction_on_both_sides_and_without_it_only_where_both_have_it():
    one_side = [fit("compensated", 6.0, 0.1), fit("uncompensated", 7.0, 0.1, **VISCOUS)]
    both = [fit("compensated", 6.0, 0.1, **VISCOUS), one_side[1]]

    assert of_damping(one_side).filter(of="trials")["uncompensated"].item() == pytest.approx(2)
    assert of_damping(one_side, "B_viscous_error").is_empty()
    row = of_damping(both, "B_viscous_error").row(-1, named=True)
    assert (row["compensated"], row["difference"]) == pytest.approx((0.25, 0.0))
    assert row["difference_high"] == pytest.approx(np.hypot(0.25, 0.25))


def test_a_doubtful_trial_has_no_pair():
    fits = pairs(((1.0, 0.1), (2.0, 0.1)), ((1.0, 0.1), (9.0, 0.1)))
    fits[-1]["doubtful"] = "late torque"

    assert of_damping(fits).filter(of="trials")["difference"].item() == pytest.approx(-1.0)


BETTER = ((1.0, 0.3), (2.0, 0.4))
WORSE = ((2.0, 0.3), (1.0, 0.4))
UNSURE = ((1.0, 0.3), (1.1, 0.4))
UNSURE_WORSE = ((1.1, 0.3), (1.0, 0.4))


@pytest.mark.parametrize(
    ("conditions", "verdict"),
    [
        ([BETTER, BETTER, UNSURE], "holds"),
        ([BETTER, UNSURE, UNSURE], "undecided"),
        ([BETTER, BETTER, UNSURE_WORSE], "undecided"),
        ([BETTER] * 9 + [WORSE], "undecided"),
        ([WORSE, WORSE, UNSURE_WORSE], "fails"),
        ([WORSE, WORSE, UNSURE], "undecided"),
    ],
)
def test_a_verdict_over_conditions_rests_on_the_interval_of_each(conditions, verdict):
    table = of_damping(pairs(*conditions))

    (claim,) = claims_of("pairs", table)

    assert (claim["verdict"], claim["n"], claim["interval"]) == (
        verdict,
        len(conditions),
        "lowest to highest",
    )
    n_better = len(conditions) - conditions.count(WORSE) - conditions.count(UNSURE_WORSE)
    assert re.search(f" {n_better} .*{len(conditions)} ", claim["quantity"])


def test_more_torque_explained_is_better_and_counts_by_its_sign():
    fits = [fit("compensated", 6.0, 0.1, VAF=99.0), fit("uncompensated", 6.0, 0.1, VAF=98.0)]
    table = compensation_table(pl.DataFrame(fits)).filter(quantity="VAF")

    (claim,) = claims_of("pairs", table)

    assert (claim["value"], claim["wanted"], claim["verdict"]) == (1.0, "above", "holds")


def test_viscous_damping_is_a_claim_of_its_own_with_its_interval():
    fits = pl.DataFrame([fit("compensated", 9.0, 0.1, **VISCOUS)])

    claims = {
        claim["name"]: claim for claim in rendered_claims(fits, Claims(K_percent=None, B=1.0))
    }

    assert (claims["B"]["value"], claims["B"]["verdict"]) == (9.0, "different")
    of_viscous = claims["B_viscous"]
    assert (of_viscous["low"], of_viscous["target"], of_viscous["high"]) == (5.0, 5.0, 5.5)
    assert of_viscous["verdict"] == "equivalent"


@pytest.mark.parametrize(
    ("intervals", "count", "verdict"),
    [
        ([(298.0, 302.0), (299.0, 301.0)], 2, "holds"),
        ([(298.0, 302.0), (200.0, 210.0)], 1, "fails"),
        ([(298.0, 302.0), (270.0, 310.0)], 1, "undecided"),
    ],
)
def test_trials_render_what_was_asked_if_all_of_them_do(intervals, count, verdict):
    of_all, *of_trials = rendered_claims(fits(*intervals), Claims())

    assert (of_all["value"], of_all["verdict"]) == (count, verdict)
    assert len(of_trials) == len(intervals)


@pytest.mark.parametrize(
    ("offset_share", "ends", "verdict"),
    [
        (0.0, (330.0, 345.0), "equivalent"),
        (0.06, (330.0 - 0.06 * 338, 345.0), "undecided"),
        (-0.06, (330.0, 345.0 + 0.06 * 338), "undecided"),
    ],
)
def test_the_claim_on_walking_holds_its_offset_and_names_its_conditions(
    offset_share, ends, verdict
):
    row = {
        "group": "all", "estimator": "ensemble", "quantity": "K", "mean": 338.0, "low": 330.0,
        "high": 345.0, "n": 30, "interval_method": "bootstrap", "commanded": 340.0,
        "joint": "ankle", "side": None,
    }  # fmt: skip
    groups = pl.DataFrame({"group": ["all"], "offset_share": [offset_share]})

    (claim,) = walking_claims(pl.DataFrame([row]), groups, None, Claims())

    assert (claim["low"], claim["high"]) == pytest.approx(ends)
    assert claim["verdict"] == verdict
    assert "plate" in claim["claim"]


@pytest.mark.parametrize(
    ("lows", "highs", "verdict"),
    [([0.1, 0.9], [0.3, 2.0], "holds"), ([0.1, -0.1], [0.3, 2.0], "undecided"),
     ([-0.3, 0.9], [-0.1, 2.0], "fails")],
)  # fmt: skip
def test_a_joint_is_passive_if_the_intervals_of_all_frequencies_are(lows, highs, verdict):
    rows = pl.DataFrame({
        "controller": "compensated", "trial": "a", "frequency_hz": [1.0, 2.0],
        "damping": [0.2, 1.0], "damping_low": lows, "damping_high": highs,
    })  # fmt: skip

    (claim,) = claims_of("response", rows)

    assert (claim["value"], claim["n"], claim["verdict"]) == (0.2, 2, verdict)


def test_a_share_is_beyond_its_limit_if_its_whole_interval_is():
    known = {"hz": 1.0, "omega": 1.0}
    verdicts = []
    for J_j in (9.0, 9.9, 11.0):
        means = {"J_j": mean(J_j, 0.05), "B_j": mean(100.0, 0.0)}
        verdicts += [claim["verdict"] for claim in share_claims(means, known)]

    assert verdicts == ["holds", "undecided", "fails"]
