"""Motions of the simulated dynamometer: each derivative is that of the signal before, and the motion is as stated."""

from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from osl_analysis.commands.simulate import read_simulation
from osl_analysis.config import read_config
from osl_analysis.simulator.joint_motion import excitation_motion
from osl_analysis.simulator.plan import plan_trials
from osl_analysis.simulator.settings import Excitation

RATE = 1000.0
SMOOTH = ("multisine", "chirp", "noise", "hand")


def made(kind, **fields):
    settings = {"name": "x", "kind": kind, "rms_deg": 2.0, "duration_s": 20.0, "period_s": 4.0, "periods": 3} | fields
    excitation = Excitation.model_validate(settings)
    return excitation, excitation_motion(excitation, "trial_x_1", 3, RATE)


@pytest.mark.parametrize("kind", SMOOTH)
def test_velocity_and_acceleration_are_the_derivatives_of_the_angle(kind):
    _, motion = made(kind)
    for signal, derivative in ((motion.theta, motion.omega), (motion.omega, motion.alpha)):
        error = np.gradient(signal) * RATE - derivative
        assert np.std(error[100:-100]) < 2e-3 * np.std(derivative)


@pytest.mark.parametrize("kind", [*SMOOTH, "prbs", "ramps"])
def test_a_motion_has_its_length_its_size_and_rests_at_both_ends(kind):
    excitation, motion = made(kind)
    assert len(motion.theta) == pytest.approx(excitation.total_s * RATE, abs=4)
    rest = round(excitation.rest_s * RATE)
    assert not motion.theta[:rest].any()
    assert not motion.theta[-rest:].any()
    full = slice(rest + 1500, -rest - 1500)
    assert np.rad2deg(np.std(motion.theta[full])) == pytest.approx(2.0, rel=0.25)


def test_a_multisine_repeats_itself_and_its_realisations_have_the_same_lines_and_other_phases():
    _, motion = made("multisine", realisations=2)
    start, period = 2500, 4000
    one, again = motion.theta[start : start + period], motion.theta[start + period : start + 2 * period]
    np.testing.assert_allclose(one, again, atol=1e-9)
    second = start + 12000 + 2000 + 1500
    other = motion.theta[second : second + period]
    sizes = [np.abs(np.fft.rfft(x))[:40] / period for x in (one, other)]
    np.testing.assert_allclose(*sizes, atol=1e-6)
    assert np.abs(one - other).max() > 0.02
    assert not (sizes[0][::2] > 1e-6).any()


def test_noise_and_sweep_stay_within_their_band():
    for kind in ("noise", "chirp"):
        _, motion = made(kind, band_hz=(1.0, 4.0))
        power = np.abs(np.fft.rfft(motion.theta)) ** 2
        f = np.fft.rfftfreq(len(motion.theta), 1 / RATE)
        assert power[(f > 0.8) & (f < 4.3)].sum() > 0.98 * power.sum()


def test_trials_differ_and_one_is_the_same_each_time():
    excitation, motion = made("noise")
    np.testing.assert_array_equal(motion.theta, excitation_motion(excitation, "trial_x_1", 3, RATE).theta)
    assert np.abs(motion.theta - excitation_motion(excitation, "trial_x_2", 3, RATE).theta).max() > 0.01


def test_the_shipped_campaign_plans_its_motions_by_the_names_of_its_trials(monkeypatch):
    monkeypatch.chdir(ROOT)
    config = read_config(Path("config/campaigns/excitations/config.yaml"))
    settings = read_simulation(config.simulation, config.shared())
    names = plan_trials(settings)["trial"].to_list()
    assert len(names) == 2 * (4 + 5)
    kinds = [settings.excitation_of(name).kind for name in names[:9]]
    assert kinds == ["multisine"] * 4 + ["chirp", "noise", "prbs", "ramps", "hand"]
    assert settings.excitation_of("impedance_K300_B5.0_compensated") is None
