"""What makes a bench fit doubtful: a late torque, friction, a wrong sign."""

import numpy as np
import pytest

from osl_analysis.bench.diagnostics import (
    check_resists,
    nonlinearity,
    torque_lag,
)
from osl_analysis.errors import InputError
from osl_analysis.stats.regression import linear_fit
from osl_analysis.stats.sinusoid import fit_sinusoid


def test_a_lag_is_told_from_coulomb_friction_by_the_linear_model():
    frequency, theta = np.tile([1.0, 2, 3, 4, 5], 3), np.repeat([0.03, 0.07, 0.1], 5)
    s = 2j * np.pi * frequency
    expected = 300 + 5 * s + 0.05 * s**2
    friction = 4j * 0.1 / (np.pi * theta)
    measured = (expected + friction) * np.exp(-s * 2e-3)
    lag = torque_lag(frequency, theta, measured, expected)
    assert lag.lag == pytest.approx(2e-3, rel=0.02)
    assert abs(torque_lag(frequency, theta, expected + friction, expected).lag) < 1e-4


def test_harmonics_of_coulomb_friction_give_its_size_and_what_it_adds_to_the_damping():
    t, w, A, T_C = np.arange(0, 10, 1e-3), 2 * np.pi, 0.1, 0.4
    omega = A * w * np.cos(w * t)
    torque = 200 * A * np.sin(w * t) + 3 * omega + T_C * np.sign(omega)
    phasor = fit_sinusoid(t, torque, 1.0)
    found = nonlinearity(np.array([1.0]), np.array([A]), phasor.amplitudes[None])
    assert found.coulomb == pytest.approx(T_C, rel=0.01)
    fitted = linear_fit(torque, {"K": A * np.sin(w * t), "B": omega})
    assert found.coulomb_damping == pytest.approx(fitted["B"] - 3, rel=0.02)
    assert found.odd == pytest.approx(4 * T_C / np.pi * np.hypot(1 / 3, 1 / 5) / phasor.amplitudes[0], rel=0.01)
    assert found.even < 0.01


def test_a_torque_of_the_wrong_sign_is_refused_and_one_of_the_right_sign_is_not():
    check_resists("belt_1", "K_s", 685.6)
    with pytest.raises(InputError, match=r"trial belt_1: K_s = -685\.6 is negative.*`sign`"):
        check_resists("belt_1", "K_s", -685.6)
