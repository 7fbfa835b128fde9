"""K, B, I, friction and faults of an impedance recording, as the table tells them."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from any_motion import TRUE, binary_steps, made_trial, noise
from conftest import findings_of, joint_trial
from scipy.ndimage import gaussian_filter1d
from shipped import CONFIG

from osl_analysis.bench.evidence import impedance_table
from osl_analysis.bench.friction import CoulombFit, friction_columns
from osl_analysis.bench.impedance import rendered_impedance
from osl_analysis.bench.motion import record_of_trial
from osl_analysis.inference.friction_shapes import slipping_springs
from osl_analysis.judge.finding import Grade
from osl_analysis.judge.limits import Limits
from osl_analysis.stats.estimates import Estimate

SETTINGS = CONFIG.dynamometer


def record_with(seed=5, more=lambda *_: 0.0, **changes):
    """A joint of 300 N*m/rad for half a minute; `more` of time, angle, velocity and acceleration is
    added to its torque."""
    rng = np.random.default_rng(seed)
    time, motion = noise(rng, rms_deg=2.5, rate=500.0)
    options = {"bits": 14, **changes}
    trial = made_trial(rng, (time, motion), more=more(time, *motion), **options)
    return record_of_trial(trial, SETTINGS.model_copy(update={"excitation": "any"}))


def row_of(record):
    return impedance_table(rendered_impedance(record)).row(-1, named=True)


def causes_of(row, grade=Grade.DOUBTS):
    """The causes of doubt about K, B and I: the finding about the inference alone."""
    found = findings_of(row, Limits(), "impedance")
    return [finding.cause for finding in found if finding.grade is grade]


SOUND = {
    "exact": {},
    "drift": {"more": lambda time, *_: 3 * np.exp(-time / 20)},
    "friction": {"more": lambda time, theta, omega, alpha: 0.3 * np.tanh(omega / 2e-3)},
    "bristles": {"more": lambda time, theta, *_: 0.3 * slipping_springs(theta, [1e-3])[0]},
}
WITHOUT_FRICTION = {"K": "K_without_friction", "B": "B_viscous", "I": "I_without_friction"}


@cache
def sound_row(joint):
    return row_of(record_with(**SOUND[joint]))


@pytest.mark.parametrize("joint", SOUND)
def test_a_sound_joint_is_not_doubted_and_its_impedance_is_held(joint):
    row = sound_row(joint)

    assert causes_of(row) == []
    for name, column in WITHOUT_FRICTION.items():
        low, high = (row[column + end] or row[name + end] for end in ("_low", "_high"))
        assert low <= TRUE[name] <= high, name


def test_friction_is_in_b_as_in_equation_15_and_not_in_b_viscous():
    row = sound_row("friction")

    assert row["B"] > row["B_viscous_high"]
    assert row["B_viscous"] == pytest.approx(5, rel=0.02)
    assert row["coulomb_share"] == pytest.approx(1 - row["B_viscous"] / row["B"])


def test_friction_that_the_column_alone_sees_is_untold():
    row = friction_columns(
        None, SimpleNamespace(friction_probability=0.1), CoulombFit(0.0, None, True), None, False
    )

    assert row == {"coulomb_share": None}


FAULTS = {
    "torque path": {"late": 3e-3},
    "change over time": {"more": lambda t, x, *_: -45 * (t > 0.6 * t[-1]) * x},
    "play or speed": {"more": lambda t, x, v, a: 3 * v * np.abs(v)},
    "spring that is not linear": {"more": lambda t, x, *_: 20000 * x**3},
    "asymmetric torque": {"more": lambda t, x, v, a: 2 * np.abs(v)},
}


@cache
def faulty_row(cause):
    return row_of(record_with(**FAULTS[cause]))


@pytest.mark.parametrize("cause", FAULTS)
def test_a_fault_is_doubted_by_its_cause_and_a_property_of_the_joint_told(cause):
    told, doubted = (causes_of(faulty_row(cause), grade) for grade in (Grade.NOTES, Grade.DOUBTS))

    assert (told if cause == "spring that is not linear" else doubted) == [cause]
    assert told + doubted == [cause]


def test_a_late_torque_tells_by_how_much_it_moves_the_damping():
    row = faulty_row("torque path")

    assert "delay" in row["explanations"].split(", ")
    moved = 300 * 3e-3 / row["B"]  # by the delay; by other rivals more
    assert 0.95 * moved < row["B_fault_share"] < 3 * moved


def test_of_a_late_torque_the_friction_is_late_too():
    late = record_with(late=3e-3, more=lambda t, x, v, a: 6 * np.tanh(v / 2e-3))

    assert row_of(late)["explanations"] == "delay"


# ---- what is known of the bench


@pytest.mark.parametrize(("joint", "B"), [("exact", "B"), ("friction", "B_viscous")])
def test_stamps_that_can_be_read_in_two_ways_widen_the_intervals(joint, B):
    record = record_with(**SOUND[joint])
    later = np.interp(record.time - 2e-4, record.time, record.torque)
    later_filtered = np.interp(record.time - 2e-4, record.time, record.filtered_torque)
    other = replace(record, torque=later, filtered_torque=later_filtered)

    plain = sound_row(joint)
    both = row_of(replace(record, with_other_stamps=other))

    assert both[B] == plain[B]
    # 300 N*m/rad late by 0.2 ms
    assert plain[f"{B}_low"] - both[f"{B}_low"] == pytest.approx(0.06, rel=0.2)


def test_an_inertia_behind_a_soft_spring_does_not_drive_the_motion():
    """Above its resonance K of Eq. 15 is negative, and B positive."""
    rng = np.random.default_rng(2)
    time, motion = noise(rng, (3.0, 8.0))
    trial = made_trial(rng, (time, motion), K=-30.0, B=9.0, I=-0.02)
    record = record_of_trial(trial, SETTINGS.model_copy(update={"excitation": "any"}))

    row = row_of(record)

    assert row["K"] == pytest.approx(-30, rel=0.2)


def test_above_the_cutoff_a_joint_is_fitted_and_no_fault_weighed():
    time, theta = binary_steps()
    trial = joint_trial(time, theta, 300 * theta)

    row = row_of(record_of_trial(trial, SETTINGS))

    assert row["K"] == pytest.approx(300, rel=3e-4)
    assert row["fault_probability"] is None


@pytest.mark.parametrize("smoothing_ms", [0.1, 20.0])
def test_under_steps_between_two_levels_friction_is_not_checked(smoothing_ms):
    time, steps = binary_steps(hold=300)
    theta, omega = (gaussian_filter1d(steps, smoothing_ms, order=n) * 1e3**n for n in (0, 1))
    torque = 300 * theta + 5 * omega + 0.3 * np.tanh(omega / 5e-3)
    trial = joint_trial(time, theta, torque)

    row = row_of(record_of_trial(trial, SETTINGS))

    assert row["B_viscous"] is None
    assert "how much of B is friction" in causes_of(row, Grade.UNCHECKED)


def test_an_independent_error_adds_in_quadrature():
    widened = Estimate(10.0, 4.0, 18.0).widened_by(4.0 / 1.959964)

    assert (widened.low, widened.high) == pytest.approx((10 - np.hypot(6, 4), 10 + np.hypot(8, 4)))
