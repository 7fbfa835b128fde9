"""A stiffness that changes while any motion is recorded, against joints whose stiffness is a formula of time."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from any_motion import LEAD, RATE, TRUE, chirp, made_trial, multisine, noise, sines
from conftest import ROOT
from scipy.signal import lfilter

from osl_analysis.bench.any_excitation import record_table
from osl_analysis.bench.changes import record_drift
from osl_analysis.bench.moving_record import moving_record
from osl_analysis.bench.plausibility import saturated
from osl_analysis.bench.rendered import judged_impedance
from osl_analysis.bench.settings import DynamometerAnalysis
from osl_analysis.config import read_section
from osl_analysis.doubtful import DoubtfulFits, marked

SETTINGS = read_section(Path(ROOT / "config/config.yaml"), "dynamometer", DynamometerAnalysis)
LIMITS = read_section(Path(ROOT / "config/config.yaml"), "doubtful", DoubtfulFits).of("impedance")
DURATION = 30.0
MOTIONS = {"chirp": chirp, "noise": noise, "multisine": multisine}


def row_of(motion, more):
    trial = made_trial(np.random.default_rng(1), motion, torque_noise=0.02, more=more)
    return record_table(moving_record(trial, SETTINGS)).to_dicts()[0]


def changing(motion, share):
    """Torque of a stiffness that changes by a share of K from the begin of the motion to its end."""
    time, (theta, *_) = motion
    return TRUE["K"] * share * (time - LEAD) / DURATION * theta


def friction(motion, torque=0.5):
    return torque * np.tanh(motion[1][1] / 0.02)


def doubts(row):
    limits = LIMITS.model_copy(update={"above": {k: v for k, v in LIMITS.above.items() if k in row}, "below": {}})
    return marked(pl.DataFrame([row]), limits, "impedance")["doubtful"][0]


@pytest.mark.parametrize("name", MOTIONS)
@pytest.mark.parametrize("share", [-0.04, 0.02])
def test_a_change_of_the_stiffness_has_its_size_in_any_motion_and_is_doubtful(name, share):
    """The fitted rows are shorter than the motion by 0.13 s at both ends; the bound of noise is 0.25 % of K."""
    motion = MOTIONS[name](np.random.default_rng(3))
    row = row_of(motion, more=changing(motion, share))
    fitted = (DURATION - 2 * 0.13) / DURATION
    K = TRUE["K"] * (1 + share / 2)
    assert row["K_drift"] == pytest.approx(share * fitted * TRUE["K"] / K, abs=0.004)
    assert abs(row["K_drift"]) < abs(share)
    assert "K_drift" in doubts(row)


@pytest.mark.parametrize("share", [-0.05, 0.004])
def test_what_a_change_of_the_stiffness_makes_of_the_inertia_in_a_sweep_is_said(share):
    motion = chirp(np.random.default_rng(3))
    row = row_of(motion, more=changing(motion, share))
    wrong = abs(row["I"] - TRUE["I"]) / np.hypot(row["I"], 0.005)
    assert wrong > 0.02
    assert row["drift_inertia_share"] == pytest.approx(wrong, abs=0.015)
    assert "drift_inertia_share" in doubts(row)


def test_sound_joints_show_no_change():
    """The bound is passed by one in 500: 36 trials of three motions, late and noisy ones among them."""
    for name, made in MOTIONS.items():
        for seed in range(6):
            motion = (
                made(np.random.default_rng(seed), duration=12.0)
                if name != "multisine"
                else made(np.random.default_rng(seed), periods=2)
            )
            for joint in ({}, {"late": 1e-3}):
                drift = record_drift(moving_record(made_trial(np.random.default_rng(seed), motion, **joint), SETTINGS))
                assert drift is None or drift.change == 0


def test_beside_friction_a_sweep_does_not_tell_and_says_so_but_noise_tells():
    for made, told in ((chirp, False), (noise, True)):
        rng = np.random.default_rng(3)
        motion = made(rng)
        trial = made_trial(rng, motion, more=friction(motion) + changing(motion, -0.04))
        table = judged_impedance(moving_record(trial, SETTINGS), saturated(trial), None, None)
        drift, reason = table["K_drift"][0], table["not_checked"][0]
        if told:
            assert drift == pytest.approx(-0.04, abs=0.015)
            assert "whether K changes" not in reason
        else:
            assert drift is None
            assert table["drift_inertia_share"][0] is None
            assert "whether K changes while it is recorded" in reason
            assert "no parameter file" in reason


def test_a_sweep_that_is_repeated_tells_the_change_beside_friction():
    once = chirp(np.random.default_rng(3), duration=DURATION / 4 - 2 * LEAD)
    parts = [np.tile(x, 4) for x in once[1]]
    motion = np.arange(len(parts[0])) / RATE, parts
    assert row_of(motion, more=friction(motion) + changing(motion, -0.05))["K_drift"] == pytest.approx(-0.045, abs=0.02)
    assert row_of(motion, more=friction(motion))["K_drift"] in (0, None)


def test_a_spring_that_stiffens_in_a_motion_that_grows_is_no_change():
    """K follows the size of the motion, which follows time."""
    rng = np.random.default_rng(5)
    time, (x, v, a) = sines(rng, rng.uniform(0.5, 6, 60), duration=DURATION)
    size, rate = 0.3 + (time - LEAD) / DURATION, 1 / DURATION
    motion = time, (size * x, rate * x + size * v, 2 * rate * v + size * a)
    stiffens = 1e4 * motion[1][0] ** 3
    drift = record_drift(moving_record(made_trial(rng, motion, more=stiffens), SETTINGS))
    assert drift is None or drift.change == 0


def test_a_stiffness_that_grows_with_the_frequency_is_no_change_in_a_sweep():
    """A spring behind a damper: beside it the sweep cannot tell, rather than see K rise."""
    rng = np.random.default_rng(5)
    motion = chirp(rng)
    slow = np.exp(-2 * np.pi * 2.0 / RATE)
    follows = motion[1][0] - lfilter([1 - slow], [1, -slow], motion[1][0])
    assert record_drift(moving_record(made_trial(rng, motion, more=60 * follows), SETTINGS)) is None


def test_a_stiffness_that_warms_up_in_a_sweep_is_named_though_it_is_not_linear_in_time():
    """What it leaves beside a line is four times the noise."""
    time, motion = chirp(np.random.default_rng(1), duration=56.0)
    warm = 15 * np.exp(-(time - LEAD) / 10) * motion[0]
    row = row_of((time, motion), more=warm)
    assert -0.12 < row["K_drift"] < -0.04
    assert row["drift_inertia_share"] > 0.3


def test_rounding_to_few_bits_in_a_slow_sweep_is_no_change():
    """Rounding follows the angle, so that standard errors are too small: it passes three of them."""
    motion = chirp(np.random.default_rng(1), band=(1.0, 4.0), duration=40.0)
    assert record_drift(moving_record(made_trial(np.random.default_rng(1), motion, bits=12), SETTINGS)) is None
