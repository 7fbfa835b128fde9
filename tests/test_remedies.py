"""What a source file states wrongly is tried otherwise before it is advised."""

import numpy as np
import polars as pl
import pytest

from osl_analysis.commands.fit import fit_settings, run_fit
from osl_analysis.commands.remedies import fit_or_advise
from osl_analysis.errors import InputError, Suspect
from osl_analysis.files import default_config
from osl_analysis.trial import Trial

RATE = 100.0
SWAP = {"theta": "torque", "torque": "theta"}


def slow_cycles():
    """A spring of 40 N*m/rad that is moved in a sine of 0.1 Hz, and rests before and after it."""
    time = np.arange(0, 40, 1 / RATE)
    theta = 0.3 * np.sin(0.2 * np.pi * np.clip(time - 5.0, 0.0, 30.0))
    torque = 40 * theta + 0.01 * np.random.default_rng(2).standard_normal(time.size)
    return pl.DataFrame({"time": time, "theta": theta, "torque": torque})


def fast_motion():
    """A joint of 150 N*m/rad that is moved by sines of 0.7 to 4.7 Hz."""
    time = np.arange(0, 20, 1 / 200)
    motion = np.zeros((3, time.size))
    for hz, size in {0.7: 0.03, 1.9: 0.02, 3.1: 0.01, 4.7: 0.01}.items():
        w = 2 * np.pi * hz
        motion += [size * w**n * np.sin(w * time + hz + n * np.pi / 2) for n in range(3)]
    torque = np.array([150, 2.4, 0.02]) @ motion
    torque += 0.03 * np.random.default_rng(6).standard_normal(time.size)
    return pl.DataFrame({"time": time, "theta": motion[0], "torque": torque})


def clamped_actuator():
    """A clamped actuator of 0.8 N*m/A whose current is stepped."""
    rng = np.random.default_rng(4)
    current = np.repeat([0.0, 1, -1, 2, -2, 3, -3, 4, -4, 2], 200)
    torque = 0.8 * current + 0.01 * rng.standard_normal(current.size)
    measured = current + 0.01 * rng.standard_normal(current.size)
    time = np.arange(current.size) / RATE
    return pl.DataFrame({"time": time, "current": measured, "torque_m": torque})


RECORDINGS = {
    "torque_angle": slow_cycles(), "impedance": fast_motion(), "actuator": clamped_actuator(),
}  # fmt: skip


@pytest.mark.parametrize(("experiment", "column", "factor", "remedy"), [
    ("torque_angle", "torque", -1.0,
     "turn the `sign` of the torque, or of all angles, in the source file: K 40 ± "),
    ("torque_angle", "theta", 180 / np.pi,
     "state `unit: deg` of theta in the source file: K 40 ± "),
    ("torque_angle", "torque", 1e3, "state `unit: N*mm` of torque in the source file: K 40 ± "),
    ("impedance", "time", 1e-3,
     "take a 1000 times larger `unit` of `time` (s for ms) in the source file: K 150 ± "),
    ("actuator", "torque_m", -1.0,
     "turn the `sign` of current in the source file: k_tau_n_m 0.8 "),
])  # fmt: skip
def test_a_wrong_sign_or_unit_is_named_by_the_refusal(experiment, column, factor, remedy):
    recorded = RECORDINGS[experiment].with_columns(pl.col(column) * factor)
    settings, _ = fit_settings(experiment, default_config())

    with pytest.raises(InputError) as refused:
        run_fit(experiment, Trial("a", recorded), None, settings)

    assert refused.value.remedy.startswith(remedy)


def test_each_sign_that_may_be_wrong_is_named():
    recorded = RECORDINGS["actuator"].with_columns(-pl.col("torque_m"))
    settings, _ = fit_settings("actuator", default_config())

    with pytest.raises(InputError, match="; or turn the `sign` of torque_m in the source file"):
        run_fit("actuator", Trial("a", recorded), None, settings)


def test_swapped_channels_are_named_by_the_refusal():
    settings, _ = fit_settings("impedance", default_config())

    with pytest.raises(InputError) as refused:
        run_fit("impedance", Trial("a", RECORDINGS["impedance"].rename(SWAP)), None, settings)

    swap = "swap the channels of theta and torque in the source file: K 150 "
    assert refused.value.remedy.startswith(swap)


@pytest.mark.parametrize(("estimates", "is_advised"), [
    ({"K_low": 30.0, "K_high": 50.0}, True),
    ({"K_low": -10.0, "K_high": 50.0}, False),  # not told from 0
    ({"B_high": -1.0}, False),
    ({"K_over_K_d": 6.0}, False),
    ({"K_ratio": 0.1}, False),
])  # fmt: skip
def test_only_a_possible_estimate_is_advised(estimates, is_advised):
    row = {"K": 40.0, "K_se": 1.0, "K_low": 38.0, "K_high": 42.0} | estimates

    def fit(trial):
        if trial.samples["torque"][0] < 0:
            raise InputError("it is negative; do something", [Suspect("sign", ("torque",))])
        return {"impedance": pl.DataFrame([row])}

    trial = Trial("a", pl.DataFrame({"time": [0.0, 1.0], "torque": [-1.0, -1.0]}))
    with pytest.raises(InputError) as refused:
        fit_or_advise(fit, {"trial": trial})

    assert refused.value.reason == "it is negative"
    assert ("turn the `sign`" in refused.value.remedy) == is_advised
    assert (refused.value.remedy == "do something") != is_advised
