"""Eq. 15 recovers what made its data; the traps of the design page are shown to be traps."""

import numpy as np
import pytest
from conftest import multisine
from hypothesis import given
from hypothesis import strategies as st

from osl_analysis.errors import IdentifiabilityError
from osl_analysis.second_order import fit_impedance, impedance_torque
from osl_analysis.signals import LowPass, differentiate, filtered_motion
from osl_analysis.stats.fit_row import lag_damping_row


@given(st.floats(1, 500), st.floats(-2, 10), st.floats(-0.2, 0.5), st.floats(-10, 10))
def test_recovers_the_impedance_that_made_the_torque(K, B, I, offset):
    motion = multisine(0.7, 2.3, 5.9)
    fit = fit_impedance(motion, impedance_torque(K, B, I, motion) + offset)
    assert (fit.K, fit.B, fit.I, fit.offset) == pytest.approx((K, B, I, offset), rel=1e-8, abs=1e-9)


def test_refuses_a_single_sine_because_stiffness_and_inertia_look_alike():
    motion = multisine(2.0)
    with pytest.raises(IdentifiabilityError, match="K and I"):
        fit_impedance(motion, impedance_torque(100, 1, 0.1, motion))


def test_mirrored_motion_gives_the_same_impedance():
    motion, mirrored = multisine(0.7, 2.3, 5.9), multisine(0.7, 2.3, 5.9, amplitude=-0.1)
    torque = impedance_torque(120, 3, 0.05, motion)
    here, there = fit_impedance(motion, torque), fit_impedance(mirrored, -torque)
    assert (here.K, here.B, here.I) == pytest.approx((there.K, there.B, there.I))


def test_a_late_torque_costs_damping_at_the_rate_of_the_stiffness():
    """To first order B shifts by -K delay, and the VAF does not change (design.md, section 5)."""
    K, B, delay, rate = 340.0, 3.0, 1 / 300, 3000.0
    motion = multisine(0.7, 2.3, 3.9, rate=rate)
    late = round(delay * rate)
    torque = impedance_torque(K, B, 0.02, motion)
    fit = fit_impedance(motion[late:], torque[:-late])
    assert fit.B - B == pytest.approx(-K * delay, rel=0.1)
    assert fit.fit.vaf > 99.9


def test_filtering_only_the_angle_spoils_the_damping_and_filtering_both_does_not():
    t = np.arange(0, 20, 1e-3)
    motion = multisine(0.7, 2.3, 5.9, 9.1, duration=20, rate=1000)
    torque = impedance_torque(100, 3, 0.02, motion)
    low_pass = LowPass(cutoff_hz=10)
    both = fit_impedance(*filtered_motion(t, motion.theta, torque, low_pass))
    only_angle = fit_impedance(differentiate(t, low_pass(motion.theta, 1000.0)), torque)
    assert (both.K, both.B, both.I) == pytest.approx((100, 3, 0.02), rel=5e-3)
    assert abs(only_angle.B - 3) > 0.3


def test_a_lag_costs_damping_and_counts_where_it_is_certain():
    assert lag_damping_row(2e-3, 0.9e-3, 300.0)["certain_lag_damping"] == pytest.approx(-0.6)
    row = lag_damping_row(2e-3, 1.1e-3, 300.0)
    assert (row["lag_damping"], row["certain_lag_damping"]) == (pytest.approx(-0.6), 0.0)
    assert set(lag_damping_row(None, None, 300.0).values()) == {None}
