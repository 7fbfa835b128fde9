# SPDX-License-Identifier: Apache-2.0
"""Wrong units, signs and swapped channels: what would mend them is tried on the recording before it
is printed."""

import re

import numpy as np
import polars as pl
import pytest
from conftest import refused_with, white_noise
from shipped import CONFIG

from osl_analysis.base.errors import Change, InputError
from osl_analysis.base.trial import Trial
from osl_analysis.commands.fit import run_fit
from osl_analysis.commands.fit_results import FitTables
from osl_analysis.commands.tried_changes import tries_changes

RATE = 200.0


def cycles_of_spring():
    """A spring of 40 N*m/rad that is moved in a sine of 0.1 Hz, and rests before and behind it."""
    time = np.arange(0, 40, 1 / RATE)
    theta = 0.3 * np.sin(0.2 * np.pi * (np.clip(time, 5.0, 35.0) - 5.0))
    torque = 40 * theta + 0.01 * white_noise(time.size, 2)
    return {"time": time, "theta": theta, "torque": torque}


def joint(noise=0.03):
    """A joint of 150 N*m/rad that is moved by four sines."""
    time = np.arange(0, 26, 1 / RATE)
    amplitudes = {0.7: 0.03, 1.9: 0.02, 3.1: 0.01, 4.7: 0.01}
    torque = noise * white_noise(time.size, 6)
    theta = np.zeros(time.size)
    for hz, size in amplitudes.items():
        w = 2 * np.pi * hz
        angle = size * np.sin(w * time + hz)
        theta += angle
        torque += (150 - 0.02 * w**2) * angle + 2.4 * w * size * np.cos(w * time + hz)
    return {"time": time, "theta": theta, "torque": torque}


def clamped_actuator():
    """A clamped actuator of 0.8 N*m/A whose current is stepped."""
    rng = np.random.default_rng(4)
    current = np.repeat([0.0, 1, -1, 2, -2, 3, -3, 4, -4, 2], 400)
    time = np.arange(current.size) / RATE
    measured = current + 0.01 * rng.standard_normal(time.size)
    torque = 0.8 * current + 0.01 * rng.standard_normal(time.size)
    return {"time": time, "current": measured, "torque_m": torque}


def turned(column):
    return lambda signals: signals | {column: -signals[column]}


def swapped(signals):
    return signals | {"theta": signals["torque"], "torque": signals["theta"]}


def swapped_in_deg(signals):
    """Channels of N*m and deg under each other's names, whose units were converted."""
    theta = signals["theta"]
    torque = signals["torque"]
    return signals | {"theta": np.radians(torque), "torque": np.degrees(theta)}


def remedy_of(call, *given, **stated):
    """What is proposed where a call refuses what it is given."""
    with pytest.raises(InputError) as refused:
        call(*given, **stated)
    return refused.value.remedy


def test_channels_that_are_swapped_are_told_where_the_fit_is_accepted():
    of_theta = {"columns": {"theta": {"unit": "deg", "factor": np.radians(1)}}}
    wrong = Trial("wrong", pl.DataFrame(swapped_in_deg(joint(noise=0.01))), of_theta)

    with refused_with(r"trial wrong: B = -0\.35 N·m·s/rad") as refused:
        run_fit("impedance", wrong, None, CONFIG)

    assert re.search(SWAP.replace("rad", "deg").removesuffix(" 150"), refused.value.remedy)


SIGN = "`sign`.* torque.*: K"
SWAP = r" theta .*torque.*`unit: rad`.* theta.*`unit: N\*m`.* torque.*: K 150"


def assert_mended(experiment, recording, fault, remedy):
    """A trial with this fault is refused, and what is proposed gives the estimate of a sound
    one."""
    wrong = Trial("wrong", pl.DataFrame(fault(recording())))

    advised = remedy_of(run_fit, experiment, wrong, None, CONFIG)

    words, true = remedy.rsplit(" ", 1)
    estimate = re.search(rf"{words} (\S+)", advised)
    assert float(estimate[1]) == pytest.approx(float(true), rel=1e-3)


@pytest.mark.parametrize(
    ("column", "factor", "unit"),
    [
        ("theta", 180 / np.pi, "deg"),
        ("torque", 1000.0, r"N\*mm"),
    ],
)
def test_a_wrong_unit_is_refused_with_the_unit_that_makes_the_trial_fit(column, factor, unit):
    for experiment, recording, true in (
        ("torque_angle", cycles_of_spring, 40),
        ("impedance", joint, 150),
    ):
        assert_mended(
            experiment,
            recording,
            lambda signals: signals | {column: factor * signals[column]},
            f"`unit: {unit}`.*? {column}.*?: K {true}",
        )


def test_a_torque_that_is_too_large_may_be_of_several_units():
    wrong = Trial("wrong", pl.DataFrame(joint() | {"torque": 1000 * joint()["torque"]}))

    advised = remedy_of(run_fit, "impedance", wrong, None, CONFIG)

    assert re.search(r"N\*mm`.*: K 149\.9.*; or .*N\*cm`.*: K 1499\.", advised)


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "ms"), (1e9, "ns")])
def test_stamps_of_a_smaller_unit_are_refused_with_it(factor, unit):
    def stamped(signals):
        return signals | {"time": factor * signals["time"]}

    assert_mended("impedance", joint, stamped, f"`unit: {unit}` of time.*: K 150")


@pytest.mark.parametrize(
    ("experiment", "recording", "fault", "remedy"),
    [
        ("torque_angle", cycles_of_spring, turned("torque"), f"{SIGN} 40"),
        ("impedance", joint, turned("torque"), f"{SIGN} 150"),
        ("impedance", joint, swapped, SWAP),
        ("actuator", clamped_actuator, turned("current"), "`sign`.* current.*: k_tau_n_m 0.8"),
    ],
)
def test_a_wrong_sign_or_swapped_channels_are_refused_with_what_fits(
    experiment, recording, fault, remedy
):
    assert_mended(experiment, recording, fault, remedy)


def test_a_clamped_actuator_does_not_tell_whose_sign_is_wrong():
    wrong = Trial("wrong", pl.DataFrame(turned("torque_m")(clamped_actuator())))

    advised = remedy_of(run_fit, "actuator", wrong, None, CONFIG)

    assert re.search("`sign`.* current.*`sign`.* torque_m", advised)


@tries_changes
def mean_as_stiffness(trial, K_d=None):
    """A fit whose K is the mean angle, to 2 N*m/rad."""
    K = trial.samples["theta"].mean()
    if K < 0:
        changes = [Change("turn theta", {"theta": -1.0}), Change("take mrad", {"theta": 1e-3})]
        raise InputError("the mean is negative", "do something", changes=changes)
    row = {"K": K, "K_low": K - 2, "K_high": K + 2, "VAF": 99.0}
    return FitTables({"impedance": pl.DataFrame([row | {"K_over_K_d": K_d and K / K_d}])}, None)


def constant_angle(value):
    return Trial("a", pl.DataFrame({"time": [0.0, 1.0], "theta": [value, value]}))


@pytest.mark.parametrize(("value", "K_d"), [(-1.0, None), (-6.0, 1.0)])
def test_a_change_that_gives_an_impossible_estimate_is_not_advised(value, K_d):
    advised = remedy_of(mean_as_stiffness, constant_angle(value), K_d=K_d)

    assert advised == "do something"
