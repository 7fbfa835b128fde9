# SPDX-License-Identifier: Apache-2.0
"""The budget of an estimate: one half-width of all that contributes, and the verdict from it."""

import numpy as np
import pytest
from scipy.stats import t as student

from osl_analysis.stats.budget import (
    Budget,
    Contribution,
    budget_rows,
    budgets_in,
    floored_size,
    scatter,
)

OWN = scatter(1.0, 9.0)
BENCH = Contribution("torque_gain", 1.0, shared=True)
RANGE = Contribution("amplitude", 3.0, basis="measured", part="motion")


def fault(by, probability=1.0, source="torque_path", basis="weighed"):
    return Contribution(source, by, basis=basis, part="fault", probability=probability)


def verdict(*contributions, needed=4.0):
    return Budget(100.0, (OWN, *contributions)).verdict(needed).name


def test_the_half_width_is_student_s_of_the_root_of_the_sum_of_squares():
    """By hand: variances 1 with 9 degrees of freedom and 1 with infinitely many have 36."""
    budget = Budget(100.0, (OWN, BENCH))

    assert budget.half_width() == pytest.approx(student.ppf(0.975, 36) * np.sqrt(2), rel=1e-9)
    assert budget.half_width("bench") == pytest.approx(student.ppf(0.975, np.inf), rel=1e-9)
    assert budget.high - budget.value == pytest.approx(budget.half_width())


def test_neither_a_fault_nor_another_motion_is_in_an_interval():
    alone = Budget(100.0, (OWN,)).half_width()

    assert Budget(100.0, (OWN, fault(50.0), RANGE)).half_width() == alone


@pytest.mark.parametrize(
    ("contributions", "needed", "name"),
    [
        # the half-width is 2.26; a fault counts beyond what is needed, and beyond the half-width
        ([fault(4.1)], 4.0, "torque_path"),
        ([fault(3.9)], 4.0, "clear"),
        ([fault(2.1, 0.4)], 2.0, "wide"),
        # beyond what another motion would change, too: the root of 2.26^2 + 3^2 is 3.76
        ([fault(3.8, 0.4), RANGE], 3.0, "torque_path"),
        ([fault(3.7, 0.4), RANGE], 3.0, "clear"),
        ([fault(3.7, source="unexplained_torque", basis="bound"), RANGE], 3.0, "clear"),
        # of likely faults the range is their own, if they change more than is needed
        ([fault(3.7, 0.3), fault(3.6, 0.3), RANGE], 3.0, "torque_path"),
        ([fault(3.7, 0.3), fault(2.9, 0.3), RANGE], 3.0, "clear"),
        # a change that is improbable is no doubt; those of several candidate models add up
        ([fault(9.0, 0.15)], 4.0, "clear"),
        ([fault(9.0, 0.15), fault(8.0, 0.1)], 4.0, "torque_path"),
        # a likely fault makes a lack of fit that is more than is needed
        ([fault(0.1, 0.6)], 2.0, "torque_path"),
        ([fault(0.1, 0.4)], 2.0, "wide"),
        # which the bench's share of a half-width is not
        ([BENCH, fault(0.1, 0.6)], 2.5, "wide"),
        # a bound needs no probability; a likely cause is named before what nothing explains
        ([fault(9.0, source="unexplained_torque", basis="bound")], 4.0, "unexplained_torque"),
        (
            [fault(9.0, source="unexplained_torque", basis="bound"), fault(9.0, 0.9)],
            4.0,
            "torque_path",
        ),
    ],
)
def test_a_verdict_compares_faults_with_all_the_rest(contributions, needed, name):
    assert verdict(*contributions, needed=needed) == name


def test_a_budget_is_read_as_it_was_written():
    unknown = Contribution("wrong_gain", None, part="fault", per="1 N*m/rad per %")
    budget = Budget(100.0, (OWN, BENCH, fault(3.0, 0.3), unknown))
    rows = budget_rows({"trial": "a", "amplitude_deg": None}, {"K": budget})

    assert budgets_in(rows, {"K": 100.0}) == {"K": budget}
    assert budgets_in(rows, {"K": None}) == {}


@pytest.mark.parametrize(("name", "size"), [("K", 2.0), ("B", 0.1), ("I", 1e-3)])
def test_a_share_of_an_estimate_of_zero_is_one_of_a_weak_joint(name, size):
    """[N*m/rad, N*m*s/rad, kg*m^2]"""
    assert floored_size(name, 0.0) == size
    assert floored_size(name, 100 * size) == pytest.approx(100 * size, rel=1e-4)
