"""Eqs. 1-4, 8-14: solved anew, norm, minimum, limits; drivetrains in time against linear and
sampled-data theory."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from conftest import ROOT
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.integrate import quad

from osl_analysis.commands.gains import gain_table
from osl_analysis.errors import InputError, UnreachableImpedanceError
from osl_analysis.model import compensator, drivetrain
from osl_analysis.model.actuator_in_time import Controller, belt_responses
from osl_analysis.model.drivetrain import joint_admittance, read_parameters
from osl_analysis.model.rendered_impedance import rendering
from osl_analysis.simulator.two_mass_drivetrain import (
    IDEAL,
    belt_path,
    constants,
    simulate_drivetrain,
    turned_belt,
)

FREQUENCIES, RATE = np.array([0.0, 0.3, 1.0, 5.0, 40.0]), 1000.0
WIDTH = 0.05  # velocity [rad/s] over which the sign is smoothed
P = read_parameters(ROOT / "config/parameters/default.yaml")


def test_actuator_torque_is_the_sum_of_equation_1_and_friction_opposes_motion(parameters):
    p, by_hand = (
        parameters,
        4.0 * 0.1133 * 9 - (0.377 + 0.0896 * 4.0) - 5.6e-3 * 2.0 - 9.211e-3 * 30.0,
    )
    assert drivetrain.actuator_torque(4.0, 2.0, 30.0, p) == pytest.approx(by_hand)
    assert drivetrain.motor_friction(-1.0, -10.0, p) == pytest.approx(-(0.377 + 0.896))
    assert drivetrain.motor_friction(0.0, 5.0, p) == 0


@given(u=st.floats(-20, 20), s=st.floats(-1, 1))
def test_closed_form_of_equation_5_solves_the_implicit_equation(parameters, u, s):
    p = parameters
    current = float(compensator.motor_current(u, s, p))
    assert current * p.k_tau * p.n_m == pytest.approx(
        u + float(drivetrain.motor_friction(s, current, p)), abs=1e-12
    )


@pytest.mark.parametrize("J_j", [0.0, 5e-3])
@pytest.mark.parametrize(("K_1", "B_1"), [(25.0, 0.66), (5.5, -0.003), (45.0, 1.8)])
def test_admittance_solves_the_equations_of_motion(parameters, K_1, B_1, J_j):
    """Eqs. 7 and 8 as a linear system in (theta_m, theta_s) for theta_j = 1, per frequency."""
    p = parameters
    for f in FREQUENCIES:
        s = 2j * np.pi * f
        feedback = K_1 + (p.B_m + B_1) * s + p.J_m * s**2
        _, theta_s = np.linalg.solve(
            np.array([[1 / p.n_T, 1.0], [feedback, -p.K_s / p.n_T]]), [1.0, 0.0]
        )
        torque = p.K_s * theta_s + p.B_j * s + J_j * s**2
        assert joint_admittance(K_1, B_1, p, J_j)(s) == pytest.approx(1 / torque, rel=1e-10)
        assert drivetrain.desired_admittance(200, B_1)(s) == pytest.approx(
            1 / (200 + max(B_1, 0) * s)
        )


@pytest.mark.parametrize("K_s2", [0.0, 14913.0])
@pytest.mark.parametrize(
    "controller", [compensator.compensated_gains, compensator.uncompensated_gains]
)
def test_two_integrators_that_share_nothing_agree(parameters, controller, K_s2):
    """The simulator's fine explicit steps against exact linear steps of a sample: 1 % of the
    torque."""
    gains, t, w = (
        controller(300, 5, p := replace(parameters, K_s2=K_s2)),
        np.arange(6000) / RATE,
        2 * np.pi * 2.0,
    )
    theta, omega = 0.07 * (1 - np.cos(w * t)) / 2, 0.035 * w * np.sin(w * t)
    commands = np.array([[gains.K_1], [gains.B_1], [0.0]])
    own = {"cancels_friction": gains.cancels_friction, "sign_width": 0.05, "control_updates": 20}
    expected = simulate_drivetrain(
        RATE, theta, omega, commands, IDEAL | {"friction": True} | own, p
    )["belt_torque"]
    (found,) = belt_responses(theta, RATE, [(Controller(gains, p, WIDTH), p)])
    assert np.std(found - expected) < 0.01 * np.std(expected)


def test_a_joint_in_equilibrium_resists_with_the_desired_stiffness():
    law = Controller(compensator.compensated_gains(300, 5, P), P, WIDTH)
    np.testing.assert_allclose(belt_responses(np.full(50, 0.2), RATE, [(law, P)])[0], 60.0)


def joint_stiffness_at(frequency_hz, gains, effects):
    """Complex torque over angle from whole settled cycles of a simulated sine, without J_j."""
    w, t = 2 * np.pi * frequency_hz, np.arange(int(8 * RATE)) / RATE
    theta, omega = 0.07 * np.sin(w * t), 0.07 * w * np.cos(w * t)
    commands = np.array([[gains.K_1], [gains.B_1], [0.0]])
    effects = effects | {"cancels_friction": gains.cancels_friction}
    motion, settled = (
        simulate_drivetrain(RATE, theta, omega, commands, effects, P),
        slice(int(4 * RATE), None),
    )
    turn = np.exp(-1j * w * t[settled])
    return ((motion["belt_torque"] + P.B_j * omega)[settled] @ turn) / (theta[settled] @ turn)


def sampled_data_stiffness(frequency_hz, gains, delay, cutoff_hz, updates):
    """Independent formula: held and delayed feedback of angle and filtered difference, at one
    frequency."""
    s, T = 2j * np.pi * frequency_hz, 1 / (RATE * updates)
    hold, a = (
        (1 - np.exp(-s * T)) / (s * T) * np.exp(-s * T * delay),
        1 - np.exp(-2 * np.pi * cutoff_hz * T),
    )
    difference = (1 - np.exp(-s * T)) / T * a / (1 - (1 - a) * np.exp(-s * T))
    M = P.J_m * s**2 + P.B_m * s + hold * (gains.K_1 + gains.B_1 * difference)
    return P.B_j * s + P.K_s * M / (M + P.K_s / P.n_T**2)


@pytest.mark.parametrize(("delay", "updates"), [(0, 1), (1, 1), (4, 1), (0, 5), (6, 5)])
@pytest.mark.parametrize("frequency_hz", [1, 5])
def test_hold_delay_and_velocity_filter_shift_the_phase_as_sampled_data_theory_says(
    delay, updates, frequency_hz
):
    gains = compensator.uncompensated_gains(300, 5, P)
    effects = IDEAL | {
        "control_delay": delay,
        "velocity_cutoff_hz": 40.0,
        "control_updates": updates,
    }
    found = joint_stiffness_at(frequency_hz, gains, effects)
    assert found == pytest.approx(
        sampled_data_stiffness(frequency_hz, gains, delay, 40.0, updates), rel=5e-4
    )


def pushed_with(torque, n, effects):
    """An actuator without damping or belt under a constant control torque, from rest."""
    p = replace(P, B_m=0.0, K_s=1e-9)
    return simulate_drivetrain(
        RATE, np.zeros(n), np.zeros(n), np.array([[1e-9], [0.0], [torque / 1e-9]]), effects, p
    )


@pytest.mark.parametrize(("torque", "sign"), [(2.0, 1), (-2.0, -1)])
@pytest.mark.parametrize("scale", [1.0, 1.5])
def test_friction_brakes_by_coulomb_and_gear_friction(torque, sign, scale):
    motion = pushed_with(torque, 201, IDEAL | {"friction": True, "friction_scale": scale})
    friction, t = scale * (P.f_C + P.f_G * 2.0 / (P.k_tau * P.n_m)), np.arange(201) / RATE
    assert motion["omega_m"] == pytest.approx(
        sign * (2.0 - friction) / P.J_m * t, rel=1e-9, abs=1e-12
    )


def test_the_actuator_sticks_below_the_breakaway_torque_and_moves_above_it():
    friction, breakaway = IDEAL | {"friction": True}, P.f_C / (1 - P.f_G / (P.k_tau * P.n_m))
    assert not np.any(pushed_with(0.999 * breakaway, 500, friction)["theta_m"])
    assert pushed_with(1.001 * breakaway, 500, friction)["theta_m"][-1] > 0


def test_a_controller_that_cancels_friction_accelerates_the_bare_inertia():
    motion = pushed_with(
        3.0, 400, IDEAL | {"friction": True, "sign_width": 0.01, "cancels_friction": True}
    )
    assert (motion["omega_m"][-1] - motion["omega_m"][100]) * RATE / 299 == pytest.approx(
        3.0 / P.J_m, rel=1e-7
    )


def test_a_belt_has_the_torque_of_the_model():
    p, theta_s = replace(P, K_s2=14913.0), np.linspace(-0.05, 0.08, 50)
    assert belt_path(theta_s, constants(IDEAL, p)) == pytest.approx(
        drivetrain.belt_torque(theta_s, p), rel=1e-14
    )
    # a series
    assert turned_belt(0.0, 0.3, 0.06, 1.0) == pytest.approx(
        0.3 - 0.7 * np.expm1(-0.06), rel=1e-14, abs=0
    )
    effects, up = (
        IDEAL | {"hysteresis_torque": 2.0, "hysteresis_width": 0.002},
        np.linspace(-0.05, 0.05, 20001),
    )
    for cycle in (np.concatenate([up, up[-2::-1]]), np.concatenate([up[::100], up[-2::-1]])):
        path = np.concatenate([cycle, cycle[1:]])
        torque = belt_path(path, constants(effects, P))[len(cycle) - 1 :]
        assert np.trapezoid(torque, path[len(cycle) - 1 :]) == pytest.approx(
            2.0 * (4 * 0.05 - 4 * 0.002), rel=2e-3
        )


def test_a_command_holds_from_its_own_sample():
    """With the equilibrium at k in sample k, an actuator that rests at 0 gets the current for a
    torque of K_1 k."""
    commands = np.array([np.full(6, 2.0), np.zeros(6), np.arange(6.0)])
    motion = simulate_drivetrain(
        RATE, np.zeros(6), np.zeros(6), commands, IDEAL, replace(P, J_m=1e9)
    )
    assert motion["current"] == pytest.approx(2.0 * np.arange(6.0) / (P.k_tau * P.n_m), rel=1e-9)


PAIRS = [(300, 5), (100, 0), (400, 7.5), (20, 2.5), (31.4159265358979, 5.0), (340, 1e-7)]


def weight_of(cutoff_hz, order):
    return compensator.Weight(cutoff_hz=cutoff_hz, order=order)


WEIGHTS = [
    compensator.PAPER_WEIGHT,
    weight_of(0.1, 5),
    weight_of(50, 1),
    weight_of(7, 3),
    weight_of(1, 1),
]
PROVED = [
    (300, 5, compensator.PAPER_WEIGHT, False, [0.664686846657257]),
    (31.4159265358979, 5.0, compensator.PAPER_WEIGHT, True, [0.2336021263447045]),
    (250, 1e-7, weight_of(7, 3), False, [0.7027444066679175]), (1, 0, weight_of(50, 1), False,
     [16.83962680009294]),
    (0.99 * 685.6, 20, weight_of(0.1, 5), True, [4699.7192679253]),
    (600, 0, compensator.PAPER_WEIGHT, False, []),
    (641, 7.4, weight_of(1, 1), True, [2.5755454822996087, 11.0603951499571]),
]  # fmt: skip
"""All minima B_1 of the default device by Sturm's theorem in rational arithmetic (release 0.2.0):
K_d, B_d, W, whether J_j counts."""


def norm(K_d, B_d, B_1, p, weight=compensator.PAPER_WEIGHT, J_j=0.0):
    """By the product's own recursion."""
    polynomials = compensator.admittance_error(
        np.array([K_d], float), np.array([B_d], float), p, weight, J_j
    )
    return float(np.sqrt(compensator.squared_norm(np.array([p.B_m + B_1]), *polynomials)[0][0]))


def norm_by_quadrature(K_d, B_d, B_1, p, weight, J_j=0.0):
    """An integral over frequency; |W|^2 of a Butterworth filter needs no filter design."""
    Y = joint_admittance(float(compensator.stiffness_gain(K_d, p)), B_1, p, J_j)
    Y_d, corner = drivetrain.desired_admittance(K_d, B_d), 2 * np.pi * weight.cutoff_hz

    def density(log_w):
        w = np.exp(log_w)
        return w * abs(Y(1j * w) - Y_d(1j * w)) ** 2 / (1 + (w / corner) ** (2 * weight.order))

    edges = np.log([1e-6, 1e-2, 1, 10, 30, 60, 100, 300, 1e3, 1e4, 1e7, 1e13])
    return np.sqrt(
        sum(quad(density, a, b, limit=200, epsabs=0, epsrel=1e-8)[0] for a, b in pairwise(edges))
        / np.pi
    )


@pytest.mark.parametrize("weight", WEIGHTS, ids=str)
@pytest.mark.parametrize(("K_d", "B_d"), PAIRS)
def test_norm_is_the_integral_over_frequency(parameters, K_d, B_d, weight):
    J_j = parameters.J_j if B_d > 2 else 0.0
    by_quadrature = norm_by_quadrature(K_d, B_d, 0.4, parameters, weight, J_j)
    assert norm(K_d, B_d, 0.4, parameters, weight, J_j) == pytest.approx(by_quadrature, rel=1e-6)


def test_the_minima_are_those_that_were_proved_in_rational_arithmetic(parameters):
    """The lowest of two; none where the error falls towards no damping at all."""
    p = parameters
    for K_d, B_d, weight, with_inertia, minima in PROVED:
        J_j = p.J_j if with_inertia else 0.0
        found = compensator.optimal_damping([K_d], [B_d], p, weight, J_j)
        assert (found.minima[0], found.at_lower_bound[0]) == (len(minima), not minima)
        assert found.B_1[0] + p.B_m > 0
        if minima:
            best = min(minima, key=lambda B_1: norm(K_d, B_d, B_1, p, weight, J_j))
            assert found.B_1[0] + p.B_m == pytest.approx(best + p.B_m, rel=1e-8)


def test_a_locked_motor_is_refused_by_name_and_leaves_other_rows_as_they_are_alone(parameters):
    with pytest.raises(
        UnreachableImpedanceError, match=r"no finite B_1 minimises .* the motor is locked"
    ):
        compensator.compensated_gains(600.0, 0.0, parameters, weight_of(50, 3))
    both = gain_table([600.0, 300.0], [0.0, 5.0], parameters, weight_of(50, 3), (1.0, 5.0))
    assert (both["unbounded"].to_list(), both["K_predicted"][0]) == ([True, False], None)
    assert both.row(1) == pytest.approx(
        gain_table([300.0], [5.0], parameters, weight_of(50, 3), (1.0, 5.0)).row(0)
    )


@pytest.mark.parametrize(
    "weight", [(1, 0), (1, 2.5), (1, 11), (-1, 3), (1e-300, 3), (np.inf, 3), (np.nan, 3)]
)
def test_a_weight_that_weighs_nothing_is_refused(weight):
    with pytest.raises(ValidationError):
        weight_of(*weight)


def stiffness_at(f, gains, p, J_j=0.0):
    return 1 / joint_admittance(gains.K_1, gains.B_1, p, J_j)(2j * np.pi * np.asarray(f))


@settings(max_examples=30, deadline=None)
@given(K_d=st.floats(5, 650), B_d=st.just(0) | st.floats(1e-9, 20))
def test_every_selected_impedance_is_stable_and_passive(parameters, K_d, B_d):
    """Im Z >= w B_j at every frequency: the claim of `rendering`, by the admittance itself."""
    w, gains = np.geomspace(1e-3, 1e5, 400), compensator.compensated_gains(K_d, B_d, parameters)
    Z = stiffness_at(w / (2 * np.pi), gains, parameters, parameters.J_j)
    assert (Z.imag >= parameters.B_j * w * (1 - 1e-6)).all()
    assert parameters.B_m + gains.B_1 > 0
    assert (joint_admittance(gains.K_1, gains.B_1, parameters).poles().real < 0).all()


# it leaves the range once, or several times
@pytest.mark.parametrize(("K_d", "B_d"), [(300.0, 5.0), (100.0, 0.5)])
def test_fidelity_ends_where_the_stiffness_is_ten_percent_off(parameters, K_d, B_d):
    gains = compensator.compensated_gains(K_d, B_d, parameters)
    found = rendering(gains.K_1, gains.B_1, [K_d], [B_d], parameters)
    f, poles = (
        float(found.faithful_to_hz[0]),
        joint_admittance(gains.K_1, gains.B_1, parameters).poles(),
    )
    assert found.decay_rate[0] == pytest.approx(np.min(-poles.real))
    below, at = np.linspace(0, 0.999 * f, 500), np.array([f])
    off = [
        np.abs(stiffness_at(g, gains, parameters) / (K_d + 2j * np.pi * g * B_d) - 1)
        for g in (below, at)
    ]
    assert (off[0] < 0.1).all()
    assert off[1][0] == pytest.approx(0.1, rel=1e-6)


def test_positive_real_is_decided_as_a_dense_grid_does(parameters):
    f = np.geomspace(1e-3, 1e3, 4000)
    K_d, B_d = (
        v.ravel() for v in np.meshgrid([50.0, 200.0, 400.0, 600.0], [0.0, 2.5, 7.5], indexing="ij")
    )
    for k, b in zip(K_d, B_d, strict=True):
        gains = compensator.compensated_gains(k, b, parameters)
        decided = rendering(gains.K_1, gains.B_1, [k], [b], parameters).positive_real[0]
        assert decided == (stiffness_at(f, gains, parameters).real >= 0).all()


def test_delay_margin_is_where_a_pole_reaches_the_axis(parameters):
    """At the margin 1 + L(jw) exp(-jw delay) = 0 for some w, and for no w at a shorter delay."""
    p, gains = parameters, compensator.compensated_gains(300, 5, parameters)
    delay = float(rendering(gains.K_1, gains.B_1, [300.0], [5.0], p).delay_margin[0])
    w = np.linspace(0.1, 500, 500_000)
    loop = (gains.K_1 + 1j * w * gains.B_1) / (p.K_s / p.n_T**2 - p.J_m * w**2 + 1j * w * p.B_m)
    assert np.abs(1 + loop * np.exp(-1j * w * delay)).min() < 1e-3
    for shorter in (0.5, 0.9, 0.98):
        assert np.abs(1 + loop * np.exp(-1j * w * delay * shorter)).min() > 5e-3


@pytest.mark.parametrize(("K_d", "B_d", "message"), [
    (685.6, 5, r"K_d = 685\.6 .* less than 685\.6.*99 % of it: 678\.7"), (0, 5, "more than 0"),
    (float("nan"), 5, "K_d = nan"), (300, -1, r"B_d = -1 .* ask for 0 or more"),
    (300, 1e300,
     r"B_d = 1e\+300 N\*m\*s/rad is outside the accepted range; ask for 1e-09 to 1e\+06 N"),
    (1e-300, 5, "K_d = 1e-300 N.* outside the accepted range"),
])  # fmt: skip
def test_an_impossible_request_is_refused_with_the_reason(parameters, K_d, B_d, message):
    with pytest.raises(UnreachableImpedanceError, match=message):
        compensator.compensated_gains(K_d, B_d, parameters)


def test_uncompensated_gains_are_reflected_through_the_belt_and_other_controllers_have_none(
    parameters,
):
    gains, n2 = compensator.uncompensated_gains(300, 5, parameters), parameters.n_T**2
    assert (gains.K_1 * n2, gains.B_1 * n2, gains.cancels_friction) == pytest.approx(
        (300, 5, False)
    )
    for pair in ((float("nan"), 5), (300, float("inf")), (-1, 5)):
        with pytest.raises(UnreachableImpedanceError, match="cannot be asked for"):
            compensator.uncompensated_gains(*pair, parameters)
    with pytest.raises(InputError, match=r"'compensatd' are not known.*compensated"):
        compensator.select_gains("compensatd", 300.0, 5.0, P)


@pytest.mark.parametrize(("B_d", "sign"), [(2.5, 1), (7.5, -1)])
def test_the_apparent_inertia_of_the_method_page_is_that_of_eq_9_at_low_frequency(B_d, sign):
    gains, w = compensator.compensated_gains(300.0, B_d, P), 0.02
    damping, kappa = P.B_m + gains.B_1, gains.K_1 + P.K_s / P.n_T**2
    written = P.J_j + (P.K_s / (P.n_T * kappa)) ** 2 * (P.J_m - damping**2 / kappa)
    stiffness = (
        1 / joint_admittance(gains.K_1, gains.B_1, P, P.J_j)(1j * np.array([w, 2 * w]))
    ).real
    assert written == pytest.approx((stiffness[0] - stiffness[1]) / (3 * w**2), rel=1e-3)
    assert np.sign(written) == sign
