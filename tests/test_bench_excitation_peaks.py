"""A torque that is clipped, with noise on its plateaus, is told from one that has friction, noise or another spring."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from any_motion import chirp, made_trial, multisine, noise
from conftest import ROOT

from osl_analysis.bench.any_excitation import ratio_at_peaks, record_table
from osl_analysis.bench.moving_record import moving_record
from osl_analysis.bench.settings import DynamometerAnalysis
from osl_analysis.config import read_section
from osl_analysis.doubtful import DoubtfulFits, doubts
from osl_analysis.rails import samples_at_rail

CONFIG = Path(ROOT / "config/config.yaml")
SETTINGS = read_section(CONFIG, "dynamometer", DynamometerAnalysis)
LIMIT = read_section(CONFIG, "doubtful", DoubtfulFits).of("impedance").below["torque_at_peaks"]
MOTIONS = {"multisine": multisine, "noise": noise, "chirp": chirp}


def ratio_of(trial):
    return record_table(moving_record(trial, SETTINGS)).to_dicts()[0]["torque_at_peaks"]


@pytest.mark.parametrize(
    ("name", "clip", "sides"),
    [("multisine", 20.0, "both"), ("noise", 20.0, "both"), ("noise", 20.0, "lower"), ("chirp", 11.0, "both")],
)
def test_a_torque_that_an_amplifier_clips_before_the_noise_is_doubtful_as_clipped(name, clip, sides):
    """It takes 4 to 15 % off K. A clip at one side only is told too."""
    rng = np.random.default_rng(2)
    trial = made_trial(rng, MOTIONS[name](rng), torque_noise=0.0)
    clipped = trial.samples["torque"].clip(-clip, clip if sides == "both" else None)
    noisy = clipped + pl.Series(0.05 * rng.standard_normal(len(clipped)))
    trial = type(trial)("made", trial.samples.with_columns(torque=noisy))
    assert samples_at_rail(trial, "torque") < 5
    said = doubts({"torque_at_peaks": ratio_of(trial)}, {}, {"torque_at_peaks": LIMIT})
    assert "it is clipped, by the range of its sensor or amplifier" in said


@pytest.mark.parametrize("name", MOTIONS)
def test_a_torque_with_friction_is_not_clipped(name):
    rng = np.random.default_rng(3)
    motion = MOTIONS[name](rng)
    assert ratio_of(made_trial(rng, motion, more=0.5 * np.tanh(motion[1][1] / 0.01))) > LIMIT + 0.15


def test_noise_raises_the_ratio_and_the_flat_top_of_a_sine_is_not_compared_alone():
    rng, sine = np.random.default_rng(4), np.sin(np.linspace(0, 60, 6000))
    assert ratio_at_peaks(sine, sine) == pytest.approx(1)
    assert ratio_at_peaks(sine + rng.standard_normal(6000), sine) > 1
    assert ratio_at_peaks(0.7 + np.minimum(sine, 0.7), sine) < 0.1
    assert ratio_at_peaks(np.maximum(sine, -0.7), sine) < 0.1
    assert ratio_at_peaks(np.sign(sine), np.sign(sine)) is None
