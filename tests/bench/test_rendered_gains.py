# SPDX-License-Identifier: Apache-2.0
"""The gains that a leg renders, from recordings made by its stiffness at each frequency, which
`tests/model` holds against the equations of motion."""

import numpy as np
import polars as pl
import pytest
from conftest import least_squares_alone
from shipped import DEVICE, LEG

import osl_analysis as osl
from osl_analysis.bench.rendered_gains import Leg
from osl_analysis.model.drivetrain import dynamic_stiffness, held_actuator

RATE_HZ = 250.0
DURATION_S = 30.0
LINES = 2j * np.pi * np.fft.rfftfreq(int(RATE_HZ * DURATION_S), 1 / RATE_HZ)
SINES_HZ = np.array([0.4, 0.9, 1.7, 2.6, 3.7, 5.1, 6.8])


def through(gain, signal):
    """A periodic signal through a linear system of this gain at its lines."""
    return np.fft.irfft(gain * np.fft.rfft(signal))


def recorded_leg(K_1, B_1, delay=2e-4, seed=0, friction=0.0):
    """Angle and torque of a leg with these gains, which act `delay` [s] late, and with friction
    [N*m] of the joint, and a third of it of the actuator."""
    random = np.random.default_rng(seed)
    time = np.arange(0, DURATION_S, 1 / RATE_HZ)
    torque = random.normal(0, 0.05, len(time))
    cycles = np.outer(SINES_HZ, time) + random.uniform(size=(7, 1))
    theta = 0.02 * np.sin(2 * np.pi * cycles).sum(axis=0)
    torque += linear_torque(theta, K_1, B_1, delay)
    torque += friction * np.sign(np.gradient(theta))
    turned = LEG.K_s / LEG.n_T / held_actuator(LINES, K_1, B_1, LEG, delay)
    torque += through(turned, friction / 3 * np.sign(np.gradient(through(turned, theta))))
    return osl.Trial("leg", pl.DataFrame({"time": time, "theta": theta, "torque": torque}))


def linear_torque(theta, K_1, B_1, delay=2e-4):
    return through(dynamic_stiffness(LINES, K_1, B_1, LEG, delay), theta)


def fitted(trial, parameters=DEVICE):
    desired = osl.DesiredImpedance("compensated", K_d=300.0, B_d=5.0)
    return osl.fit(trial, desired=desired, parameters=parameters)


@pytest.fixture(scope="module")
def usual():
    """A leg, and its fit."""
    trial = recorded_leg(25.0, 0.66)
    return trial, fitted(trial)


def at_rest(K_1, B_1, delay=2e-4):
    """Stiffness and damping in slow motion."""
    Z = dynamic_stiffness(1e-3j, K_1, B_1, LEG, delay)
    return Z.real, 1e3 * Z.imag


def rewritten(folder, old, new):
    """The parameter file of the default device with another line."""
    text = DEVICE.read_text()
    assert old in text
    file = folder / "leg.yaml"
    file.write_text(text.replace(old, new))
    return file


@pytest.mark.parametrize(("K_1", "B_1", "delay"), [(25.0, 0.66, 2e-3), (5.5, 0.1, 2e-4)])
def test_gains_behind_a_belt_are_told_where_eq_15_does_not_fit(K_1, B_1, delay):
    """Of a loop that is ten times as late as its parameter file states, and of one that is not."""
    held = []
    for seed in range(7):
        fit = fitted(recorded_leg(K_1, B_1, delay, seed=seed))
        truths = at_rest(K_1, B_1, delay)
        for name, true in zip(("K_d_rendered", "B_d_rendered"), truths, strict=True):
            low, high = getattr(fit, f"{name}_interval")
            held.append(low <= true <= high)
        assert fit.VAF_rendered > fit.VAF

    assert np.mean(held) >= 0.85  # 95 % of 14


@least_squares_alone
def test_friction_is_told_from_damping_and_its_range_is_in_the_interval():
    """By NumPy's least squares, without friction and with that of the joint alone. The leg is known
    for one by its gains and friction, and its belt is no fault of the torque's path."""
    trial = recorded_leg(25.0, 0.66, friction=3.0)

    fit = fitted(trial)

    assert "torque path" not in fit.row["doubtful"]
    K_d, B_d = at_rest(25.0, 0.66)
    assert fit.K_d_rendered == pytest.approx(K_d, rel=2e-3)
    assert fit.B_d_rendered == pytest.approx(B_d, rel=2e-2)
    _, theta, torque = trial.samples.to_numpy().T
    rendered = linear_torque(theta, 25.0, 0.66)
    of_K_1 = linear_torque(theta, 26.0, 0.66) - rendered
    of_B_1 = linear_torque(theta, 25.0, 0.67) - rendered
    X = np.transpose([of_K_1, of_B_1, np.sign(np.gradient(theta))])
    changes = [np.linalg.lstsq(X[:, :k], torque - rendered)[0][0] for k in (2, 3)]
    half = np.diff([at_rest(25.0 + change, 0.66)[0] for change in changes]) / 2
    of_friction = fit.budget.filter(source="friction", estimate="K_d_rendered")
    assert of_friction["standard"].item() == pytest.approx(half, rel=0.05)


def test_sines_between_lines_of_windows_are_told_at_their_frequencies(usual):
    """In less than two periods of 10 s, which is no periodic motion."""
    short = osl.Trial("short", usual[0].samples.head(4500))

    table = osl.frequency_response(short, parameters=DEVICE).table

    Z = dynamic_stiffness(2j * np.pi * table["frequency_hz"].to_numpy(), 25.0, 0.66, LEG, 2e-4)
    assert table["magnitude"].to_numpy() == pytest.approx(1 / np.abs(Z), rel=8e-3)


@pytest.mark.parametrize("name", ["K_1", "B_1", "delay"])
def test_slopes_of_what_is_rendered_are_those_of_differences(name):
    leg = Leg(None, LEG, K_1=25.0, B_1=0.66, delay=1e-3, fitted=(name,))
    step = 1e-6

    before, after = (leg.moved_by({name: sign * step}).impedance() for sign in (-1, 1))

    for column, (_, slopes) in leg.impedance_slopes().items():
        slope = (after[column] - before[column]) / (2 * step)
        assert slopes.get(name, 0.0) == pytest.approx(slope, rel=2e-3, abs=1e-6)


@pytest.mark.parametrize("delay", [-0.01, 0.005, 0.03])
def test_a_loop_delay_is_fitted_and_bounds_what_a_stated_one_changes(tmp_path, delay):
    """By a rectangular distribution."""
    trial = recorded_leg(10.0, 1.5, delay)

    fit = fitted(trial, rewritten(tmp_path, "loop_delay: 0.2e-3", "loop_delay: null"))

    assert fit.loop_delay_s == pytest.approx(delay, rel=1e-3)
    assert fit.K_d_rendered == pytest.approx(at_rest(10.0, 1.5)[0], rel=1e-3)
    stated = fitted(trial)
    row = stated.budget.filter(detail="loop_delay", estimate="K_d_rendered")
    change = abs(stated.K_d_rendered - fit.K_d_rendered)
    assert row["standard"].item() == pytest.approx(change / np.sqrt(3), rel=1e-2)


def test_gains_change_by_what_is_said_of_a_component(tmp_path, usual):
    """Per percent where its error is not stated, else in the interval."""
    trial, fit = usual
    of_components = fit.budget.filter(source="component", estimate="K_d_rendered")
    per = of_components.drop_nulls("per")["per"][0]
    low, high = fit.K_d_rendered_interval
    assert high - low < 1e-3 * low  # white noise is hardly taken for a gain
    assert per.endswith("N*m/rad per % of K_s")

    other = fitted(trial, parameters=rewritten(tmp_path, "value: 685.6", "value: 692.456"))

    change = abs(other.K_d_rendered - fit.K_d_rendered)
    stated = rewritten(tmp_path, "value: 685.6", "standard_error: 6.856, value: 685.6")
    low, high = fitted(trial, parameters=stated).K_d_rendered_interval
    assert float(per.split()[0]) == pytest.approx(change, rel=0.1)
    assert (high - low) / 2 == pytest.approx(1.96 * change, rel=0.1)
