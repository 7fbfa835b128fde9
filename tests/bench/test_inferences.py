# SPDX-License-Identifier: Apache-2.0
"""What the program infers of a recording of the bench never passes for what was stated."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from any_motion import made_trial, noise
from conftest import findings_on
from scipy.interpolate import CubicSpline
from shipped import CONFIG

from osl_analysis.bench.budgets import stated_models
from osl_analysis.bench.evidence import impedance_table
from osl_analysis.bench.impedance import rendered_impedance
from osl_analysis.bench.motion import record_of_trial
from osl_analysis.judge.limits import Limits
from osl_analysis.judge.rules import Grade

SETTINGS = CONFIG.dynamometer.model_copy(update={"excitation": "any"})


def record_of(trial):
    return record_of_trial(trial, SETTINGS)


def tables_of(trial):
    return impedance_table(rendered_impedance(record_of(trial)))


def causes_of(tables, grade=Grade.DOUBTS):
    """The causes of the findings of a grade about K, B and I."""
    return [found.cause for found in findings_on(tables, Limits()) if found.grade is grade]


# ---- a delay that the beat of a held channel tells


SOURCE_HZ = 321.0


def held_torque(late_s, stated_s=None):
    """A trial at 1 kHz whose torque is that of a source at 321 Hz, late by `late_s`; the source
    file states `stated_s`."""
    trial = made_trial(np.random.default_rng(3), noise(np.random.default_rng(3), rate=1000.0))
    time = trial.samples["time"].to_numpy()
    since_start = time - time[0]
    value = np.floor(since_start * SOURCE_HZ + 1e-9).astype(int)
    taken = np.arange(value[-1] + 1) / SOURCE_HZ - late_s
    values = CubicSpline(since_start, trial.samples["torque"])(np.clip(taken, 0, None))
    held = trial.samples.with_columns(torque=pl.Series(values[value]))
    sensor = {} if stated_s is None else {"delay": stated_s}
    return replace(trial, samples=held, provenance={"columns": {"torque": sensor}})


@pytest.mark.parametrize("late_s", [0.0, 4e-3])
def test_the_beat_of_a_held_torque_tells_no_delay_of_its_source(late_s):
    trial = held_torque(late_s)
    tables = tables_of(trial)

    assert record_of(trial).streams[0]["delay_s"] > 0
    assert stated_models(record_of(trial)) == set()
    assert "delay of the torque" in causes_of(tables, Grade.UNCHECKED)
    assert causes_of(tables) == ["torque path"] * (late_s > 0)


def test_a_stated_delay_of_zero_is_a_statement():
    trial = held_torque(4e-3, stated_s=0.0)

    assert stated_models(record_of(trial)) == {"delay"}
    assert "delay of the torque" not in causes_of(tables_of(trial), Grade.UNCHECKED)


def test_what_a_beat_leaves_open_of_a_delay_is_in_the_interval_of_damping():
    """B is off by K times the delay. The rates 321 and 1000 Hz share 1 Hz: the beat leaves a
    thousandth of a second of 321 values open, which is a rectangular distribution."""
    trial = held_torque(0.0)
    record = record_of(trial)
    budget = tables_of(trial)["budget"].filter(estimate="B")

    (part,) = [part for part in record.signals.taken if part.held]
    (held,) = budget.filter(source="held_delay")["standard"]
    assert 0 < part.beat_width < 0.05e-3
    assert held == pytest.approx(300 * part.beat_width / np.sqrt(12), rel=0.1)
