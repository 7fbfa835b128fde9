"""Eq. 14: the norm by three independent formulas, its minimum by search and by proof, and what the joint then does."""

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from conftest import ROOT
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.linalg import solve_continuous_lyapunov
from scipy.signal import butter, tf2ss

from osl_analysis.commands.gains import gain_table
from osl_analysis.errors import UnreachableImpedanceError
from osl_analysis.model import certificate
from osl_analysis.model.admittance_error import Weight, admittance_error
from osl_analysis.model.certificate import certify, interpolated, isolating_intervals, primitive, sturm_chain
from osl_analysis.model.compensator import PAPER_WEIGHT, compensated_gains, stiffness_gain
from osl_analysis.model.drivetrain import desired_admittance, joint_admittance
from osl_analysis.model.gain_selection import optimal_damping
from osl_analysis.model.rendering import rendering
from osl_analysis.parameters import read_parameters

PAIRS = [(300, 5), (100, 0), (400, 7.5), (20, 2.5), (31.4159265358979, 5.0), (340, 1e-7)]
WEIGHTS = [PAPER_WEIGHT, Weight(0.1, 5), Weight(50, 1), Weight(7, 3), Weight(1, 1)]
FILES = ("default", "table1-as-printed", "osl-v2-published")


@pytest.fixture(scope="module", params=FILES)
def device(request):
    if request.param == "table1-as-printed":
        with pytest.warns(UserWarning, match="83/11"):
            return read_parameters(ROOT / f"config/parameters/{request.param}.yaml")
    return read_parameters(ROOT / f"config/parameters/{request.param}.yaml")


def norm(K_d, B_d, B_1, p, weight=PAPER_WEIGHT, J_j=0.0):
    """The norm of the product's own recursion."""
    return float(np.sqrt(admittance_error([K_d], [B_d], p, weight, J_j).squared(np.array([p.B_m + B_1])).value[0]))


def norm_by_quadrature(K_d, B_d, B_1, p, weight, J_j=0.0):
    """An integral over frequency; |W|^2 of a Butterworth filter needs no filter design."""
    Y = joint_admittance(float(stiffness_gain(K_d, p)), B_1, p, J_j)
    Y_d, corner = desired_admittance(K_d, B_d), 2 * np.pi * weight.cutoff_hz

    def density(log_w):
        w = np.exp(log_w)
        return w * abs(Y(1j * w) - Y_d(1j * w)) ** 2 / (1 + (w / corner) ** (2 * weight.order))

    edges = np.log([1e-6, 1e-2, 1, 10, 30, 60, 100, 300, 1e3, 1e4, 1e7, 1e13])
    return np.sqrt(sum(quad(density, a, b, limit=200, epsabs=0, epsrel=1e-8)[0] for a, b in pairwise(edges)) / np.pi)


def norm_by_lyapunov(K_d, B_d, B_1, p, weight):
    """C P C' with A P + P A' + B B' = 0 for a state-space realisation of W (Y - Y_d)."""
    Y = joint_admittance(float(stiffness_gain(K_d, p)), B_1, p)
    b, a = butter(weight.order, 2 * np.pi * weight.cutoff_hz, analog=True)
    Q = [B_d, K_d]
    difference = np.polysub(np.polymul(Y.numerator, Q), Y.denominator)
    A, B, C, _ = tf2ss(np.polymul(b, difference), np.polymul(np.polymul(Y.denominator, Q), a))
    gramian = solve_continuous_lyapunov(A, -B @ B.T)
    return float(np.sqrt((C @ gramian @ C.T)[0, 0]))


@pytest.mark.parametrize("weight", WEIGHTS, ids=str)
@pytest.mark.parametrize(("K_d", "B_d"), PAIRS)
def test_norm_is_the_integral_over_frequency(parameters, K_d, B_d, weight):
    J_j = parameters.J_j if B_d > 2 else 0.0
    by_quadrature = norm_by_quadrature(K_d, B_d, 0.4, parameters, weight, J_j)
    assert norm(K_d, B_d, 0.4, parameters, weight, J_j) == pytest.approx(by_quadrature, rel=1e-6)


@pytest.mark.parametrize(("K_d", "B_d"), [(300, 5), (400, 7.5), (200, 2.5)])
def test_norm_is_that_of_the_lyapunov_equation(parameters, K_d, B_d):
    for B_1 in (0.1, 0.7, 3.0):
        by_lyapunov = norm_by_lyapunov(K_d, B_d, B_1, parameters, PAPER_WEIGHT)
        assert norm(K_d, B_d, B_1, parameters) == pytest.approx(by_lyapunov, rel=1e-6)


def test_slope_and_curvature_are_those_of_the_norm(parameters):
    error = admittance_error([300, 100], [5, 0], parameters, PAPER_WEIGHT, parameters.J_j)
    x, h = np.array([0.5, 0.05]), 1e-3
    here, up, down = (error.squared(x * (1 + d)) for d in (0, h, -h))
    assert here.slope == pytest.approx((up.value - down.value) / (2 * h * x), rel=1e-4)
    assert here.curvature == pytest.approx((up.slope - down.slope) / (2 * h * x), rel=1e-4)


@pytest.mark.parametrize("weight", WEIGHTS, ids=str)
def test_no_gain_of_a_dense_search_does_better(device, weight):
    pairs = np.array([(K_d, B_d) for K_d in (1.0, 50.0, 300.0, 0.99 * device.K_s) for B_d in (0.0, 0.4, 5.0, 20.0)])
    found = optimal_damping(*pairs.T, device, weight)
    finite = ~found.unbounded
    assert finite.any()
    K_d, B_d, x = (grid.ravel() for grid in np.broadcast_arrays(*pairs.T[:, :, None], np.geomspace(1e-7, 1e6, 800)))
    tried = admittance_error(K_d, B_d, device, weight).squared(x).value.reshape(len(pairs), -1)
    assert (found.error[finite] <= np.sqrt(tried.min(axis=1))[finite] * (1 + 1e-9)).all()


@pytest.mark.parametrize("weight", [PAPER_WEIGHT, Weight(50, 1), Weight(7, 3)], ids=str)
@pytest.mark.parametrize("with_inertia", [False, True])
def test_the_proof_in_rational_arithmetic_finds_the_same_minima(device, weight, with_inertia):
    J_j = device.J_j if with_inertia else 0.0
    K_d, B_d = np.array([1.0, 31.4159265358979, 0.99 * device.K_s, 250.0]), np.array([0.0, 5.0, 20.0, 1e-7])
    found = optimal_damping(K_d, B_d, device, weight, J_j)
    for i, (k, b) in enumerate(zip(K_d, B_d, strict=True)):
        proof = certify(k, b, device, weight, J_j)
        assert len(proof.minima) == found.minima[i]
        if not (found.at_lower_bound[i] or found.unbounded[i]):
            closest = min(proof.minima, key=lambda m: abs(m - found.B_1[i]))
            assert found.B_1[i] + device.B_m == pytest.approx(closest + device.B_m, rel=1e-8)


def test_a_steep_and_slow_weight_keeps_eight_digits(device):
    weight = Weight(0.1, 5)
    found = optimal_damping([0.99 * device.K_s], [20.0], device, weight, device.J_j)
    (exact,) = certify(0.99 * device.K_s, 20.0, device, weight, device.J_j).minima
    assert found.B_1[0] == pytest.approx(exact, rel=1e-8)


def test_the_paper_s_weight_never_leaves_a_second_minimum(parameters):
    """Proved for each of these requests, not for those between; docs/gain_selection.md has the map."""
    requests = [(K_d, B_d) for K_d in (1.0, 150.0, 450.0, 678.0) for B_d in (0.0, 0.5, 20.0)]
    proofs = [certify(K_d, B_d, parameters, PAPER_WEIGHT) for K_d, B_d in requests]
    assert {(len(proof.minima), len(proof.maxima)) for proof in proofs} == {(0, 0), (1, 0)}


def test_another_weight_and_the_joint_s_inertia_leave_two_minima(parameters):
    weight = Weight(cutoff_hz=1, order=1)
    proof = certify(641.0, 7.4, parameters, weight, parameters.J_j)
    assert (len(proof.minima), len(proof.maxima)) == (2, 1)
    best = optimal_damping([641.0], [7.4], parameters, weight, parameters.J_j)
    errors = [norm(641.0, 7.4, B_1, parameters, weight, parameters.J_j) for B_1 in proof.minima]
    assert best.minima[0] == 2
    assert best.error[0] == pytest.approx(min(errors), rel=1e-12)


def test_the_squared_norm_levels_off_so_it_is_never_convex_where_a_minimum_is_inside(parameters):
    error = admittance_error([300], [5], parameters, PAPER_WEIGHT)
    far, farther = (error.squared(np.array([x])) for x in (1e6, 1e9))
    assert farther.value == pytest.approx(far.value, rel=1e-4)
    assert error.squared(np.array([50.0])).curvature[0] < 0


def test_a_root_of_even_multiplicity_is_neither_minimum_nor_maximum(parameters, monkeypatch):
    """The slope (x - 1) (x - 2)^2 touches zero at 2 and goes on rising."""
    slope = np.array([Fraction(c) for c in (-4, 8, -5, 1)], dtype=object)
    monkeypatch.setattr(certificate, "slope_numerator", lambda *_: slope)
    proof = certify(300.0, 5.0, parameters, PAPER_WEIGHT)
    assert proof.minima == pytest.approx([1 - parameters.B_m])
    assert proof.maxima == ()


def test_too_little_damping_asked_for_ends_at_the_edge_of_stability(parameters):
    found = optimal_damping([600.0], [0.0], parameters, PAPER_WEIGHT)
    assert found.at_lower_bound[0]
    assert found.B_1[0] + parameters.B_m > 0
    assert certify(600.0, 0.0, parameters, PAPER_WEIGHT).minima == ()


def test_a_locked_motor_is_refused_by_name(parameters):
    assert optimal_damping([600.0], [0.0], parameters, Weight(50, 3)).unbounded[0]
    with pytest.raises(UnreachableImpedanceError, match=r"no finite B_1 minimises .* the motor is locked"):
        compensated_gains(600.0, 0.0, parameters, Weight(50, 3))


def test_many_pairs_at_once_are_the_pairs_one_by_one(parameters):
    rng = np.random.default_rng(8)
    K_d, B_d = rng.uniform(1, 678, 40), rng.uniform(0, 20, 40)
    together = optimal_damping(K_d, B_d, parameters, PAPER_WEIGHT)
    alone = [optimal_damping([k], [b], parameters, PAPER_WEIGHT).B_1[0] for k, b in zip(K_d, B_d, strict=True)]
    assert together.B_1 == pytest.approx(alone, rel=1e-10)


@pytest.mark.parametrize("B_d", [0.0, 1e-9, 1e-3, 1e6])
@pytest.mark.parametrize("K_d", [1e-9, 1.0, 685.6 * (1 - 1e-12)])
def test_every_request_within_the_limits_has_an_answer(parameters, K_d, B_d):
    """The ends of what is allowed, with W at the ends of its own: numbers, and no warning on the way."""
    for weight in (PAPER_WEIGHT, Weight(1e-3, 1), Weight(1, 1), Weight(1e4, 3)):
        row = gain_table([K_d], [B_d], parameters, weight, (1.0, 5.0)).to_dicts()[0]
        assert np.isfinite(row["error"])
        assert row["unbounded"] or np.isfinite([row["B_1"], row["K_predicted"]]).all()
        certify(K_d, B_d, parameters, weight)


@pytest.mark.parametrize(
    ("cutoff", "order"),
    [(1, 0), (1, 2.5), (1, 11), (0, 3), (-1, 3), (1e-300, 3), (1e300, 3), (np.inf, 3), (np.nan, 3)],
)
def test_a_weight_that_weighs_nothing_is_refused(cutoff, order):
    with pytest.raises(UnreachableImpedanceError, match="W "):
        Weight(cutoff, order)


@given(roots=st.lists(st.fractions(-50, 50, max_denominator=20), min_size=1, max_size=5, unique=True))
def test_sturm_isolates_every_positive_root(roots):
    coefficients = np.array([Fraction(1)], dtype=object)
    for root in roots:
        coefficients = np.convolve(coefficients, np.array([-root, Fraction(1)], dtype=object))  # lowest power first
    positive = sorted(root for root in roots if root > 0)
    chain = sturm_chain(primitive(coefficients))
    intervals = isolating_intervals(chain)
    assert len(intervals) == len(positive)
    assert all(low < root <= high for (low, high), root in zip(intervals, positive, strict=True))


@given(st.lists(st.fractions(-9, 9, max_denominator=9), min_size=1, max_size=6))
def test_interpolation_through_enough_points_returns_the_polynomial(coefficients):
    nodes = [Fraction(k + 1) for k in range(8)]
    values = [sum((c * x**k for k, c in enumerate(coefficients)), Fraction(0)) for x in nodes]
    found = interpolated(nodes, values)
    assert found.tolist() == coefficients[: len(found)]
    assert not any(coefficients[len(found) :])


def stiffness_at(f, gains, p, J_j=0.0):
    return 1 / joint_admittance(gains.K_1, gains.B_1, p, J_j)(2j * np.pi * np.asarray(f))


@settings(max_examples=30, deadline=None)
@given(K_d=st.floats(5, 650), B_d=st.just(0) | st.floats(1e-9, 20))
def test_every_selected_impedance_is_passive(parameters, K_d, B_d):
    """Im Z >= w B_j at every frequency: the claim of `rendering`, by the admittance itself."""
    w = np.geomspace(1e-3, 1e5, 400)
    Z = stiffness_at(w / (2 * np.pi), compensated_gains(K_d, B_d, parameters), parameters, parameters.J_j)
    assert (Z.imag >= parameters.B_j * w * (1 - 1e-6)).all()


def test_fidelity_ends_where_the_stiffness_is_ten_percent_off(parameters):
    gains = compensated_gains(300, 5, parameters)
    f = float(rendering(gains.K_1, gains.B_1, [300.0], [5.0], parameters).faithful_to_hz[0])
    below, at = np.linspace(0, 0.999 * f, 500), np.array([f])
    off = [np.abs(stiffness_at(g, gains, parameters) / (300 + 2j * np.pi * g * 5) - 1) for g in (below, at)]
    assert (off[0] < 0.1).all()
    assert off[1][0] == pytest.approx(0.1, rel=1e-6)


def test_positive_real_is_decided_as_a_dense_grid_does(parameters):
    f = np.geomspace(1e-3, 1e3, 4000)
    K_d, B_d = (v.ravel() for v in np.meshgrid([50.0, 200.0, 400.0, 600.0], [0.0, 2.5, 7.5], indexing="ij"))
    for k, b in zip(K_d, B_d, strict=True):
        gains = compensated_gains(k, b, parameters)
        decided = rendering(gains.K_1, gains.B_1, [k], [b], parameters).positive_real[0]
        assert decided == (stiffness_at(f, gains, parameters).real >= 0).all()


def test_delay_margin_is_where_a_pole_reaches_the_axis(parameters):
    """At the margin 1 + L(jw) exp(-jw delay) = 0 for some w, and for no w at a shorter delay."""
    p, gains = parameters, compensated_gains(300, 5, parameters)
    delay = float(rendering(gains.K_1, gains.B_1, [300.0], [5.0], p).delay_margin[0])
    w = np.linspace(0.1, 500, 500_000)
    loop = (gains.K_1 + 1j * w * gains.B_1) / (p.K_s / p.n_T**2 - p.J_m * w**2 + 1j * w * p.B_m)
    assert np.abs(1 + loop * np.exp(-1j * w * delay)).min() < 1e-3
    for shorter in (0.5, 0.9, 0.98):
        assert np.abs(1 + loop * np.exp(-1j * w * delay * shorter)).min() > 5e-3
