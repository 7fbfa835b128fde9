"""Eq. 15 recovers what made its data; the traps of the design page are shown to be traps."""

import pytest
from conftest import multisine
from hypothesis import given
from hypothesis import strategies as st

from osl_analysis.stats.fit_row import lag_damping_row
from osl_analysis.walking.second_order import fit_impedance, impedance_torque


@given(st.floats(1, 500), st.floats(-2, 10), st.floats(-0.2, 0.5), st.floats(-10, 10))
def test_recovers_the_impedance_that_made_the_torque(K, B, I, offset):
    motion = multisine(0.7, 2.3, 5.9)
    fit = fit_impedance(motion, impedance_torque(K, B, I, motion) + offset)
    assert tuple(fit.estimates) == pytest.approx((K, B, I, offset), rel=1e-8, abs=1e-9)


def test_a_lag_costs_damping_and_counts_where_it_is_certain():
    assert lag_damping_row(2e-3, 0.9e-3, 300.0)["certain_lag_damping"] == pytest.approx(-0.6)
    row = lag_damping_row(2e-3, 1.1e-3, 300.0)
    assert (row["lag_damping"], row["certain_lag_damping"]) == (pytest.approx(-0.6), 0.0)
    assert set(lag_damping_row(None, None, 300.0).values()) == {None}
