"""The claims of the paper's text: verdicts of single claims (`judge/claims.py`)."""

import numpy as np
import polars as pl
import pytest
from scipy import stats

from osl_analysis.judge.claims import (
    Claims,
    compensation_claims,
    rendered_claims,
    stiffness_claims,
    walking_claims,
)


def mean(value, se, n=3):
    return {"mean": value, "se": se, "n": n}


def fits(*K_intervals):
    """Compensated trials of K_d = 300 with these intervals of K."""
    rows = [
        {"trial": f"t{k}", "controller": "compensated", "K_d": 300.0, "B_d": None,
         "K": (low + high) / 2, "K_low": low, "K_high": high, "theta_rms_deg": 3.0}
        for k, (low, high) in enumerate(K_intervals)
    ]  # fmt: skip
    return pl.DataFrame(rows, schema_overrides={"B_d": pl.Float64})


def test_the_interval_of_load_friction_is_that_of_its_derivative_by_the_coulomb_friction():
    f_C, f_C_se, n_T = 0.377, 0.01, 4.6
    means = {
        "f_C": mean(f_C, f_C_se),
        "f_G": mean(0.0896, 0.0),
        "k_tau_n_m": mean(1.02, 0.0),
    }

    (claim, _) = stiffness_claims(means, fits((290.0, 310.0)), n_T)

    of_load = 0.0896 * 300 * np.deg2rad(3.0) / (n_T * 1.02)
    shares = [100 * of_load / (coulomb + of_load) for coulomb in (f_C - 1e-6, f_C + 1e-6)]
    slope = (shares[1] - shares[0]) / 2e-6
    half_width = stats.t.ppf(0.975, 2) * abs(slope) * f_C_se
    assert claim.high - claim.value == pytest.approx(half_width, rel=1e-4)


@pytest.mark.parametrize(("quantity", "wanted"), [("VAF", "above"), ("K_error", "below")])
def test_compensation_should_raise_vaf_and_lower_errors(quantity, wanted):
    row = {"quantity": quantity, "unit": "%", "by": "trials", "pairs": 4, "better": 4}
    table = pl.DataFrame(
        [{**row, "difference": 2.0, "difference_low": 1.0, "difference_high": 3.0}]
    )

    (claim,) = compensation_claims(table)

    assert claim.wanted == wanted
    assert claim.verdict == ("holds" if wanted == "above" else "fails")


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

    assert (of_all.value, of_all.verdict) == (count, verdict)
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

    assert (claim.low, claim.high) == pytest.approx(ends)
    assert claim.verdict == verdict
    assert "the plate's gain" in claim.claim
