"""Eqs. 12-13: gains against static physics and the limits of the possible; Eq. 15 as linear theory predicts it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from osl_analysis.errors import UnreachableImpedanceError
from osl_analysis.model.compensator import compensated_gains, stiffness_gain, uncompensated_gains
from osl_analysis.model.drivetrain import joint_admittance
from osl_analysis.model.rendering import predicted_impedance

TESTED_HZ = (1.0, 2.0, 3.0, 4.0, 5.0)


@given(K_d=st.floats(1, 680))
def test_stiffness_gain_in_series_with_the_belt_gives_the_desired_stiffness(parameters, K_d):
    K_1 = stiffness_gain(K_d, parameters)
    assert 1 / abs(joint_admittance(float(K_1), 0.1, parameters)(0)) == pytest.approx(K_d)


@settings(max_examples=25, deadline=None)
@given(K_d=st.floats(5, 650), B_d=st.just(0) | st.floats(1e-9, 20))
def test_the_loop_is_stable_for_every_reachable_impedance(parameters, K_d, B_d):
    gains = compensated_gains(K_d, B_d, parameters)
    assert parameters.B_m + gains.B_1 > 0
    assert (joint_admittance(gains.K_1, gains.B_1, parameters).poles().real < 0).all()


@pytest.mark.parametrize(
    ("K_d", "B_d", "message"),
    [
        (685.6, 5, r"K_d = 685\.6 .* less than 685\.6"),
        (900, 5, r"99 % of it: 678\.7"),
        (0, 5, "more than 0"),
        (-10, 5, "more than 0"),
        (float("nan"), 5, "K_d = nan"),
        (300, -1, r"B_d = -1 .* ask for 0 or more"),
        (300, float("inf"), "B_d = inf"),
        (300, 1e300, r"B_d = 1e\+300 N\*m\*s/rad is outside the accepted range; ask for 1e-09 to 1e\+06 N"),
        (300, 2e6, r"B_d = 2e\+06 .* outside the accepted range"),
        (300, 1e-300, "B_d = 1e-300 .* outside the accepted range"),
        (1e-300, 5, "K_d = 1e-300 N.* outside the accepted range"),
    ],
)
def test_an_impossible_request_is_refused_with_the_reason(parameters, K_d, B_d, message):
    with pytest.raises(UnreachableImpedanceError, match=message):
        compensated_gains(K_d, B_d, parameters)


def test_uncompensated_gains_are_reflected_through_the_belt(parameters):
    gains = uncompensated_gains(300, 5, parameters)
    n2 = parameters.n_T**2
    assert (gains.K_1 * n2, gains.B_1 * n2, gains.cancels_friction) == pytest.approx((300, 5, False))


def test_prediction_reproduces_the_design_page_without_joint_inertia(parameters):
    """design.md, section 3: the paper's model, J_j dropped."""
    p = replace(parameters, J_j=0.0)
    compensated = predicted_impedance(compensated_gains(300, 5, p), p, TESTED_HZ)
    uncompensated = predicted_impedance(uncompensated_gains(300, 5, p), p, TESTED_HZ)
    assert compensated == pytest.approx((299.1, 5.46, 0.000), abs=0.05)
    assert uncompensated == pytest.approx((209.7, 3.61, 0.093), abs=0.05)


def test_prediction_is_the_regression_of_the_linear_response_in_time(parameters):
    """The same numbers from time series: equal cycles per frequency, one sample per millisecond."""
    gains = compensated_gains(200, 7.5, parameters)
    Z = 1 / joint_admittance(gains.K_1, gains.B_1, parameters, parameters.J_j)(2j * np.pi * np.array(TESTED_HZ))
    rows, torque = [], []
    for f, z in zip(TESTED_HZ, Z, strict=True):
        t, w = np.arange(0, 20 / f, 1e-3), 2 * np.pi * f
        rows.append(np.column_stack([np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t)]))
        torque.append(abs(z) * np.sin(w * t + np.angle(z)))
    found, *_ = np.linalg.lstsq(np.vstack(rows), np.concatenate(torque), rcond=None)
    assert predicted_impedance(gains, parameters, TESTED_HZ) == pytest.approx(found, rel=2e-4, abs=1e-5)
