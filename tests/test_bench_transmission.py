"""Losses of the transmission: recovery, and what Coulomb friction does to them."""

import numpy as np
import pytest
from bench_synthetic import stepped_sine
from conftest import multisine
from hypothesis import given
from hypothesis import strategies as st

from osl_analysis.bench.transmission import coulomb_columns, fit_transmission, transmission_table
from osl_analysis.stats.regression import linear_fit


@given(st.floats(0.05, 2), st.floats(0, 0.1), st.floats(-1, 1))
def test_recovers_the_losses_of_the_transmission(B_j, J_j, offset):
    motion = multisine(1.0, 3.0, 5.0)
    fit = fit_transmission(motion, B_j * motion.omega + J_j * motion.alpha + offset)
    assert (fit["B_j"], fit["J_j"], fit["offset"]) == pytest.approx((B_j, J_j, offset), rel=1e-8, abs=1e-9)


def test_coulomb_friction_is_told_from_viscous():
    motion = multisine(1.0, 3.0, 5.0)
    torque = 0.45 * motion.omega + 0.005 * motion.alpha + 0.2 * np.tanh(motion.omega / 0.05)
    fit = linear_fit(torque, coulomb_columns(motion))
    assert (fit["B_j"], fit["J_j"], fit["T_C"]) == pytest.approx((0.45, 0.005, 0.2), rel=1e-8)
    assert fit_transmission(motion, torque)["B_j"] > 0.46


def test_transmission_tells_how_much_of_its_damping_is_coulomb_friction_and_predicts_the_amplitude_not_seen():
    smooth = transmission_table(stepped_sine(lambda m: 0.45 * m.omega + 0.005 * m.alpha)).to_dicts()
    rough = transmission_table(
        stepped_sine(lambda m: 0.3 * m.omega + 0.005 * m.alpha + 0.15 * np.tanh(m.omega / 0.05))
    ).to_dicts()
    assert abs(smooth[-1]["coulomb_share"]) < 0.01
    assert rough[-1]["coulomb_share"] == pytest.approx(1 - 0.3 / rough[-1]["B_j"], abs=0.03)
    assert rough[-1]["coulomb_share"] > 0.1
    assert smooth[0]["VAF_held_out"] > 99.9 > rough[0]["VAF_held_out"]
    assert smooth[-1]["VAF_held_out"] is None
    assert rough[-1]["odd_harmonics"] > 10 * smooth[-1]["odd_harmonics"]
