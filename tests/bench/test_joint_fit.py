# SPDX-License-Identifier: Apache-2.0
"""K, B, I, friction and faults of an impedance recording, as the table tells them."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from any_motion import TRUE, binary_steps, made_trial, noise
from conftest import findings_on, joint_trial, least_squares_alone
from scipy.ndimage import gaussian_filter1d
from scipy.stats import uniform
from shipped import CONFIG

from osl_analysis.bench.bench_settings import Calibration
from osl_analysis.bench.budgets import alternatives
from osl_analysis.bench.evidence import impedance_table
from osl_analysis.bench.friction import friction_of_joint
from osl_analysis.bench.impedance import rendered_impedance
from osl_analysis.bench.motion import record_of_trial
from osl_analysis.bench.regression import sums_of
from osl_analysis.inference.spectra import slipping_springs
from osl_analysis.inference.weighing import Alternative, ImpedanceInference
from osl_analysis.judge.limits import Limits
from osl_analysis.judge.rules import Grade

SETTINGS = CONFIG.dynamometer


def record_with(seed=5, more=lambda *_: 0.0, **changes):
    """A joint of 300 N*m/rad for half a minute; `more` of time, angle, velocity and acceleration is
    added to its torque."""
    rng = np.random.default_rng(seed)
    time, motion = noise(rng, rms_deg=2.5, rate=500.0)
    options = {"bits": 14, **changes}
    trial = made_trial(rng, (time, motion), more=more(time, *motion), **options)
    return record_of_trial(trial, SETTINGS.model_copy(update={"excitation": "any"}))


def tables_of(record):
    return impedance_table(rendered_impedance(record))


def row_of(record):
    return tables_of(record)["impedance"].row(-1, named=True)


def causes_of(tables, grade=Grade.DOUBTS):
    """The causes of doubt about K, B and I."""
    return [found.cause for found in findings_on(tables, Limits()) if found.grade is grade]


def contributions(tables, estimate, **of):
    return tables["budget"].filter(estimate=estimate, **of)


SOUND = {
    "exact": {},
    "drift": {"more": lambda time, *_: 3 * np.exp(-time / 20)},
    "friction": {"more": lambda time, theta, omega, alpha: 0.3 * np.tanh(omega / 2e-3)},
    "bristles": {"more": lambda time, theta, *_: 0.3 * slipping_springs(theta, [1e-3])[0]},
}
WITHOUT_FRICTION = {"K": "K_without_friction", "B": "B_viscous", "I": "I_without_friction"}


@cache
def sound_tables(joint):
    return tables_of(record_with(**SOUND[joint]))


def sound_row(joint):
    return sound_tables(joint)["impedance"].row(-1, named=True)


def test_without_friction_b_is_the_only_damping():
    row = sound_row("exact")

    assert (row["B_viscous"], row["f_C"]) == (None, None)
    assert row["B"] == pytest.approx(5, rel=0.01)


@pytest.mark.parametrize("joint", SOUND)
def test_a_sound_joint_is_not_doubted_and_its_impedance_is_held(joint):
    row = sound_row(joint)

    assert causes_of(sound_tables(joint)) == []
    for name, column in WITHOUT_FRICTION.items():
        low, high = (row[column + end] or row[name + end] for end in ("_low", "_high"))
        assert low <= TRUE[name] <= high, name


def test_friction_is_in_b_as_in_equation_15_and_not_in_b_viscous():
    row = sound_row("friction")

    assert row["B"] > row["B_viscous_high"]
    assert row["B_viscous"] == pytest.approx(5, rel=0.02)
    (change,) = contributions(sound_tables("friction"), "B", source="friction")["standard"]
    assert 2 * change == pytest.approx(row["B"] - row["B_viscous"])
    (half,) = contributions(sound_tables("friction"), "B_viscous", part="motion")["standard"]
    assert 2 * half == pytest.approx(row["B_viscous_range_high"] - row["B_viscous_range_low"])
    assert half < 0.01  # of a part, too, all friction is taken off


def test_friction_that_the_column_alone_sees_is_untold():
    """Of bristles that hardly rub, and of none."""
    unseen = SimpleNamespace(friction_probability=0.0)
    told = []
    for size in (0.3, 0.0):
        record = record_with(more=lambda t, x, v, a, size=size: size * np.tanh(v / 2e-3))
        analysis = rendered_impedance(record)
        told.append(friction_of_joint(sums_of(record), analysis, unseen).is_untold)

    assert told == [True, False]


FAULTS = {
    "torque path": {"late": 3e-3},
    "change over time": {"more": lambda t, x, *_: -45 * (t > 0.6 * t[-1]) * x},
    "backlash, speed or direction": {"more": lambda t, x, v, a: 2 * np.abs(v)},
    "K that changes with amplitude beyond friction": {"more": lambda t, x, *_: 20000 * x**3},
}


@cache
def faulty_tables(cause):
    return tables_of(record_with(**FAULTS[cause]))


@pytest.mark.parametrize("cause", FAULTS)
def test_a_fault_is_doubted_by_its_cause_and_a_property_of_the_joint_told(cause):
    tables = faulty_tables(cause)
    told, doubted = (causes_of(tables, grade) for grade in (Grade.NOTES, Grade.DOUBTS))
    told = [each for each in told if each != "wide interval"]

    assert (told if cause == "K that changes with amplitude beyond friction" else doubted) == [
        cause
    ]
    assert told + doubted == [cause]


def test_play_of_a_mount_is_told_from_a_hardening_spring():
    """Within 5 mrad the spring gives no torque, as a cubic one hardly does."""
    tables = tables_of(record_with(more=lambda t, x, *_: -300 * np.clip(x, -2.5e-3, 2.5e-3)))

    assert causes_of(tables) == ["backlash, speed or direction"]
    assert causes_of(tables, Grade.NOTES) == []
    of_play = contributions(tables, "K", detail="backlash in the mount")
    assert of_play["probability"].sum() > 0.9


def test_an_angle_behind_a_mean_of_its_rows_is_a_late_one():
    """Of six rows, by 12.5 ms. It lowers B the more, the more the inertia takes of the torque: the
    range over the band is wider than what is lost."""
    rng = np.random.default_rng(5)
    time, motion = noise(rng, band=(0.2, 3.0), rms_deg=2.5, rate=200.0)
    trial = made_trial(rng, (time, motion), K=375.0, B=26.7, I=2.77, bits=14)
    mean_of_rows = pl.col("theta").rolling_mean(6, min_samples=1)
    late = replace(trial, samples=trial.samples.with_columns(mean_of_rows))
    tables = tables_of(record_of_trial(late, SETTINGS.model_copy(update={"excitation": "any"})))

    (doubt,) = [found for found in findings_on(tables, Limits()) if found.grade is Grade.DOUBTS]
    assert (doubt.cause, [each.column for each in doubt.evidence]) == ("torque path", ["B"])
    half_range = contributions(tables, "B", part="motion")["standard"].max()
    assert half_range > contributions(tables, "B", source="torque_path")["standard"].max()


def test_damping_that_depends_on_the_speed_is_a_property_of_the_joint():
    tables = tables_of(record_with(more=lambda t, x, v, a: 3 * v * np.abs(v)))

    assert causes_of(tables) == []
    assert "backlash, speed or direction" in causes_of(tables, Grade.NOTES)


def test_a_late_torque_tells_by_how_much_it_moves_the_damping():
    late = contributions(faulty_tables("torque path"), "B", source="torque_path", detail="delay")

    # by the delay
    assert late["standard"].max() == pytest.approx(300 * 3e-3, rel=0.1)


def test_of_a_late_torque_the_friction_is_late_too():
    late = record_with(late=3e-3, more=lambda t, x, v, a: 6 * np.tanh(v / 2e-3))

    paths = contributions(tables_of(late), "B", source="torque_path")
    assert set(paths.filter(pl.col("probability") > 0.05)["detail"]) == {"delay"}


def test_a_spring_in_series_and_more_than_all_of_K_have_no_size():
    change = np.full(3, 1e5)
    paths = [
        Alternative("path", name, 0.4, change, change) for name in ("spring in series", "delay")
    ]

    series, late, left = alternatives(ImpedanceInference({}, 0.0, paths, change), (), 0, 300.0)

    assert series.standard is None
    assert late.standard == left.standard == pytest.approx(300, rel=1e-3)


def test_a_known_spring_takes_the_models_of_the_path_out():
    record = record_with(late=3e-3)
    known = Calibration(torque_gain=1e-3, delay=1e-4)
    calibrated = replace(record, settings=record.settings.model_copy(update={"calibration": known}))

    assert causes_of(tables_of(calibrated)) == []


def test_what_a_candidate_model_changes_is_a_size_half_of_a_range_or_a_bound():
    change = np.full(3, 6.0)
    models = [
        Alternative(family, name, 0.6, change, change)
        for family, name in (("path", "delay"), ("size", "nonlinear spring"))
    ]

    rows = alternatives(ImpedanceInference({}, 0.0, models, change), (), 0, 300.0)

    assert {row.source: row.standard for row in rows} == {
        "torque_path": 6.0,
        "nonlinear_spring": 3.0,
        "unexplained_torque": pytest.approx(uniform(-6, 12).std()),
    }


def test_what_nobody_checked_changes_an_estimate_by_so_much_per_unit():
    """Eq. 15 times exp(-s d), times a gain, by a faster clock, and beside a spring and a mass."""
    Z = np.array([*TRUE.values()])
    budget = sound_tables("exact")["budget"]

    for source, change in {
        "late_torque": Z - np.convolve(Z, [1, -1e-3])[:3],
        "wrong_gain": 0.01 * Z,
        "clocks_disagree": Z * (1.01 ** np.arange(3) - 1),
        "fixture_inertia": np.array([1, 0, 1]),
    }.items():
        rows = budget.filter(source=source).select("estimate", pl.col("per").str.extract(r"(\S+)"))
        told = {name: float(size) for name, size in rows.rows()}
        assert [told.get(name, 0.0) for name in TRUE] == pytest.approx(change, rel=0.05), source


# ---- what is known of the bench


@pytest.mark.parametrize(("joint", "B"), [("exact", "B"), ("friction", "B_viscous")])
def test_stamps_that_are_read_in_two_ways_are_a_fault_of_the_estimates(joint, B):
    record = record_with(**SOUND[joint])
    later = np.interp(record.time - 2e-4, record.time, record.torque)
    later_filtered = np.interp(record.time - 2e-4, record.time, record.filtered_torque)
    other = replace(record, torque=later, filtered_torque=later_filtered)

    both = tables_of(replace(record, with_other_stamps=other))

    (moved,) = contributions(both, B, source="undecided_time_stamps")["standard"]
    late = 0.06  # 300 N*m/rad late by 0.2 ms
    assert moved == pytest.approx(late / np.sqrt(3), rel=0.2)
    ends = [f"{B}_low", f"{B}_high"]
    assert both["impedance"].select(ends).row(0) == tuple(sound_row(joint)[end] for end in ends)


def test_above_the_cutoff_a_joint_is_fitted_and_no_fault_weighed():
    time, theta = binary_steps()
    trial = joint_trial(time, theta, 300 * theta)

    tables = tables_of(record_of_trial(trial, SETTINGS))

    assert tables["impedance"]["K"][0] == pytest.approx(300, rel=3e-4)
    assert contributions(tables, "K", basis="weighed").is_empty()
    unchecked = causes_of(tables, Grade.UNCHECKED)
    assert {"change over time", "backlash, speed or direction"} <= {*unchecked}


@least_squares_alone
@pytest.mark.parametrize(("smoothing_ms", "rests"), [(0.1, True), (20.0, True), (60.0, False)])
def test_friction_is_not_checked_where_a_joint_mostly_rests_at_two_levels(smoothing_ms, rests):
    time, steps = binary_steps(hold=300)
    theta, omega = (gaussian_filter1d(steps, smoothing_ms, order=n) * 1e3**n for n in (0, 1))
    torque = 300 * theta + 5 * omega + 0.3 * np.tanh(omega / 5e-3)
    trial = joint_trial(time, theta, torque)

    tables = tables_of(record_of_trial(trial, SETTINGS))

    assert tables["impedance"]["B_viscous"].null_count() == rests
    assert ("friction" in causes_of(tables, Grade.UNCHECKED)) == rests
