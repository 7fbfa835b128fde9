"""Eqs. 12-14: the norm by its integral, its minimum, the limits of the possible, what the joint does."""

import warnings
from itertools import pairwise

import numpy as np
import pytest
from conftest import ROOT
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from osl_analysis.commands.gains import gain_table
from osl_analysis.errors import UnreachableImpedanceError
from osl_analysis.model.compensator import (
    PAPER_WEIGHT,
    compensated_gains,
    rendering,
    stiffness_gain,
    uncompensated_gains,
)
from osl_analysis.model.drivetrain import desired_admittance, joint_admittance
from osl_analysis.model.gain_selection import Weight, admittance_error, optimal_damping, squared_norm
from osl_analysis.model.parameters import read_parameters

PAIRS = [(300, 5), (100, 0), (400, 7.5), (20, 2.5), (31.4159265358979, 5.0), (340, 1e-7)]
WEIGHTS = [PAPER_WEIGHT, Weight(0.1, 5), Weight(50, 1), Weight(7, 3), Weight(1, 1)]
PROVED = [
    (300, 5, PAPER_WEIGHT, False, [0.664686846657257]),
    (31.4159265358979, 5.0, PAPER_WEIGHT, True, [0.2336021263447045]),
    (250, 1e-7, Weight(7, 3), False, [0.7027444066679175]),
    (1, 0, Weight(50, 1), False, [16.83962680009294]),
    (0.99 * 685.6, 20, Weight(0.1, 5), True, [4699.7192679253]),
    (641, 7.4, Weight(1, 1), True, [2.5755454822996087, 11.0603951499571]),
    (600, 0, PAPER_WEIGHT, False, []),
]
"""All minima B_1 of the default device by Sturm's theorem in rational arithmetic (release 0.2.0): K_d, B_d, W, whether
J_j counts."""


@pytest.fixture(params=["default", "table1-as-printed", "osl-v2-published"])
def device(request):
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*83/11")  # as printed
        return read_parameters(ROOT / f"config/parameters/{request.param}.yaml")


def squared(K_d, B_d, x, p, weight, J_j=0.0):
    """The squared norm of the product's own recursion and its slope; K_d, B_d and x are arrays of one shape."""
    polynomials = admittance_error(np.asarray(K_d, float), np.asarray(B_d, float), p, weight, J_j)
    return squared_norm(np.asarray(x), *polynomials)


def norm(K_d, B_d, B_1, p, weight=PAPER_WEIGHT, J_j=0.0):
    return float(np.sqrt(squared([K_d], [B_d], [p.B_m + B_1], p, weight, J_j)[0][0]))


def norm_by_quadrature(K_d, B_d, B_1, p, weight, J_j=0.0):
    """An integral over frequency; |W|^2 of a Butterworth filter needs no filter design."""
    Y = joint_admittance(float(stiffness_gain(K_d, p)), B_1, p, J_j)
    Y_d, corner = desired_admittance(K_d, B_d), 2 * np.pi * weight.cutoff_hz

    def density(log_w):
        w = np.exp(log_w)
        return w * abs(Y(1j * w) - Y_d(1j * w)) ** 2 / (1 + (w / corner) ** (2 * weight.order))

    edges = np.log([1e-6, 1e-2, 1, 10, 30, 60, 100, 300, 1e3, 1e4, 1e7, 1e13])
    return np.sqrt(sum(quad(density, a, b, limit=200, epsabs=0, epsrel=1e-8)[0] for a, b in pairwise(edges)) / np.pi)


@pytest.mark.parametrize("weight", WEIGHTS, ids=str)
@pytest.mark.parametrize(("K_d", "B_d"), PAIRS)
def test_norm_is_the_integral_over_frequency(parameters, K_d, B_d, weight):
    J_j = parameters.J_j if B_d > 2 else 0.0
    by_quadrature = norm_by_quadrature(K_d, B_d, 0.4, parameters, weight, J_j)
    assert norm(K_d, B_d, 0.4, parameters, weight, J_j) == pytest.approx(by_quadrature, rel=1e-6)


@pytest.mark.parametrize("weight", WEIGHTS, ids=str)
def test_no_gain_of_a_dense_search_does_better(device, weight):
    pairs = np.array([(K_d, B_d) for K_d in (1.0, 50.0, 300.0, 0.99 * device.K_s) for B_d in (0.0, 0.4, 5.0, 20.0)])
    found = optimal_damping(*pairs.T, device, weight)
    finite = ~found["unbounded"]
    assert finite.any()
    K_d, B_d, x = (grid.ravel() for grid in np.broadcast_arrays(*pairs.T[:, :, None], np.geomspace(1e-7, 1e6, 800)))
    tried = squared(K_d, B_d, x, device, weight)[0].reshape(len(pairs), -1)
    assert (found["error"][finite] <= np.sqrt(tried.min(axis=1))[finite] * (1 + 1e-9)).all()


def test_the_minima_are_those_that_were_proved_in_rational_arithmetic(parameters):
    """The lowest of two; none where the error falls towards no damping at all."""
    p = parameters
    for K_d, B_d, weight, with_inertia, minima in PROVED:
        J_j = p.J_j if with_inertia else 0.0
        found = optimal_damping([K_d], [B_d], p, weight, J_j)
        assert found["minima"][0] == len(minima)
        assert found["at_lower_bound"][0] == (not minima)
        assert found["B_1"][0] + p.B_m > 0
        if minima:
            best = min(minima, key=lambda B_1: norm(K_d, B_d, B_1, p, weight, J_j))
            assert found["B_1"][0] + p.B_m == pytest.approx(best + p.B_m, rel=1e-8)


def test_a_locked_motor_is_refused_by_name(parameters):
    assert optimal_damping([600.0], [0.0], parameters, Weight(50, 3))["unbounded"][0]
    with pytest.raises(UnreachableImpedanceError, match=r"no finite B_1 minimises .* the motor is locked"):
        compensated_gains(600.0, 0.0, parameters, Weight(50, 3))


def test_a_row_without_a_finite_gain_leaves_the_others_as_they_are_alone(parameters):
    both = gain_table([600.0, 300.0], [0.0, 5.0], parameters, Weight(50, 3), (1.0, 5.0))
    alone = gain_table([300.0], [5.0], parameters, Weight(50, 3), (1.0, 5.0))
    assert both["unbounded"].to_list() == [True, False]
    assert both["K_predicted"][0] is None
    assert both.row(1) == pytest.approx(alone.row(0))


@pytest.mark.parametrize("B_d", [0.0, 1e-9, 1e-3, 1e6])
@pytest.mark.parametrize("K_d", [1e-9, 1.0, 685.6 * (1 - 1e-12)])
def test_every_request_within_the_limits_has_an_answer(parameters, K_d, B_d):
    """The ends of what is allowed, with W at the ends of its own: numbers, and no warning on the way."""
    for weight in (PAPER_WEIGHT, Weight(1e-3, 1), Weight(1, 1), Weight(1e4, 3)):
        row = gain_table([K_d], [B_d], parameters, weight, (1.0, 5.0)).to_dicts()[0]
        assert np.isfinite(row["error"])
        assert row["unbounded"] or np.isfinite([row["B_1"], row["K_predicted"]]).all()


@pytest.mark.parametrize(
    "weight", [(1, 0), (1, 2.5), (1, 11), (0, 3), (-1, 3), (1e-300, 3), (1e300, 3), (np.inf, 3), (np.nan, 3)]
)
def test_a_weight_that_weighs_nothing_is_refused(weight):
    with pytest.raises(UnreachableImpedanceError, match="W "):
        Weight(*weight)


def stiffness_at(f, gains, p, J_j=0.0):
    return 1 / joint_admittance(gains.K_1, gains.B_1, p, J_j)(2j * np.pi * np.asarray(f))


@settings(max_examples=30, deadline=None)
@given(K_d=st.floats(5, 650), B_d=st.just(0) | st.floats(1e-9, 20))
def test_every_selected_impedance_is_stable_and_passive(parameters, K_d, B_d):
    """Im Z >= w B_j at every frequency: the claim of `rendering`, by the admittance itself."""
    w, gains = np.geomspace(1e-3, 1e5, 400), compensated_gains(K_d, B_d, parameters)
    Z = stiffness_at(w / (2 * np.pi), gains, parameters, parameters.J_j)
    assert (Z.imag >= parameters.B_j * w * (1 - 1e-6)).all()
    assert parameters.B_m + gains.B_1 > 0
    assert (joint_admittance(gains.K_1, gains.B_1, parameters).poles().real < 0).all()


def test_fidelity_ends_where_the_stiffness_is_ten_percent_off(parameters):
    gains = compensated_gains(300, 5, parameters)
    f = float(rendering(gains.K_1, gains.B_1, [300.0], [5.0], parameters)["faithful_to_hz"][0])
    below, at = np.linspace(0, 0.999 * f, 500), np.array([f])
    off = [np.abs(stiffness_at(g, gains, parameters) / (300 + 2j * np.pi * g * 5) - 1) for g in (below, at)]
    assert (off[0] < 0.1).all()
    assert off[1][0] == pytest.approx(0.1, rel=1e-6)


def test_positive_real_is_decided_as_a_dense_grid_does(parameters):
    f = np.geomspace(1e-3, 1e3, 4000)
    K_d, B_d = (v.ravel() for v in np.meshgrid([50.0, 200.0, 400.0, 600.0], [0.0, 2.5, 7.5], indexing="ij"))
    for k, b in zip(K_d, B_d, strict=True):
        gains = compensated_gains(k, b, parameters)
        decided = rendering(gains.K_1, gains.B_1, [k], [b], parameters)["positive_real"][0]
        assert decided == (stiffness_at(f, gains, parameters).real >= 0).all()


def test_delay_margin_is_where_a_pole_reaches_the_axis(parameters):
    """At the margin 1 + L(jw) exp(-jw delay) = 0 for some w, and for no w at a shorter delay."""
    p, gains = parameters, compensated_gains(300, 5, parameters)
    delay = float(rendering(gains.K_1, gains.B_1, [300.0], [5.0], p)["delay_margin"][0])
    w = np.linspace(0.1, 500, 500_000)
    loop = (gains.K_1 + 1j * w * gains.B_1) / (p.K_s / p.n_T**2 - p.J_m * w**2 + 1j * w * p.B_m)
    assert np.abs(1 + loop * np.exp(-1j * w * delay)).min() < 1e-3
    for shorter in (0.5, 0.9, 0.98):
        assert np.abs(1 + loop * np.exp(-1j * w * delay * shorter)).min() > 5e-3


@given(K_d=st.floats(1, 680))
def test_stiffness_gain_in_series_with_the_belt_gives_the_desired_stiffness(parameters, K_d):
    K_1 = stiffness_gain(K_d, parameters)
    assert 1 / abs(joint_admittance(float(K_1), 0.1, parameters)(0)) == pytest.approx(K_d)


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
        (300, 1e-300, "B_d = 1e-300 .* outside the accepted range"),
        (1e-300, 5, "K_d = 1e-300 N.* outside the accepted range"),
    ],
)
def test_an_impossible_request_is_refused_with_the_reason(parameters, K_d, B_d, message):
    with pytest.raises(UnreachableImpedanceError, match=message):
        compensated_gains(K_d, B_d, parameters)


def test_uncompensated_gains_are_reflected_through_the_belt_and_refuse_what_is_no_number(parameters):
    gains, n2 = uncompensated_gains(300, 5, parameters), parameters.n_T**2
    assert (gains.K_1 * n2, gains.B_1 * n2, gains.cancels_friction) == pytest.approx((300, 5, False))
    for pair in ((float("nan"), 5), (300, float("inf")), (-1, 5)):
        with pytest.raises(UnreachableImpedanceError, match="cannot be asked for"):
            uncompensated_gains(*pair, parameters)
