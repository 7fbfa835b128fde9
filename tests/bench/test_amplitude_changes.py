# SPDX-License-Identifier: Apache-2.0
"""How K, B and I change over the amplitudes and frequencies of a motion."""

from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from any_motion import TRUE, made_trial, noise
from bench_synthetic import FIVE, stepped_sine, table_of
from conftest import least_squares_alone
from shipped import CONFIG

from osl_analysis.base.trial import Trial
from osl_analysis.bench import impedance, regression
from osl_analysis.bench.budgets import Evidence, over_motion
from osl_analysis.bench.motion import record_of_trial
from osl_analysis.bench.regression import with_gain
from osl_analysis.spectral.stepped_sine import SteppedSineProtocol
from osl_analysis.stats.linear_fit import LinearFit

pytestmark = least_squares_alone


def faster_is_stiffer(motion):
    """A spring that is stiffer in faster motion, which Eq. 15 misses at each frequency in its own
    way."""
    return (200 + 20 * np.abs(motion.omega)) * motion.theta + 4 * motion.omega


def test_the_range_is_over_amplitudes_and_both_parts_of_the_band():
    """By NumPy's least squares on the rows of each part."""
    record = stepped_sine(faster_is_stiffer, protocol=FIVE)
    row = table_of(record).row(-1, named=True)
    groups = record.groups
    hz = np.array([stratum.frequency_hz for stratum in groups.strata])[groups.stratum]
    labels = {stratum.label for stratum in groups.strata}
    middle = np.median(hz)
    parts = [*(groups.of(label) for label in labels), hz < middle + 0.1, hz > middle - 0.1]

    found = [stiffness_of(record, part) for part in [*parts, hz > 0]]

    assert row["K_range_low"] == pytest.approx(min(found), rel=1e-5)
    assert row["K_range_high"] == pytest.approx(max(found), rel=1e-5)
    assert row["K_range_low"] < row["K"] - 10 * (row["K_high"] - row["K"])


def stiffness_of(record, is_part):
    """K by NumPy's least squares in some groups."""
    groups = record.groups
    edges = np.rint([groups.first, groups.stop]).astype(int).T[is_part]
    rows = np.concatenate([np.arange(first, stop) for first, stop in edges])
    motion = record.motion
    columns = [motion.theta, motion.omega, motion.alpha, np.ones_like(motion.theta), record.time]
    X = np.stack(columns, axis=1)[rows]
    return np.linalg.lstsq(X, record.filtered_torque[rows])[0][0]


@pytest.mark.parametrize("half", [0, 1])
def test_the_range_of_a_motion_without_sines_is_over_its_blocks_and_its_band(half):
    """A spring that is stiffer at large angles, or in fast motion: one end of the range is that of
    the large blocks, or of the upper part of the band."""
    rng = np.random.default_rng(1)
    motion = noise(rng, duration=40.0)
    trial = made_trial(rng, motion, torque_noise=0.01)
    theta, omega, _ = motion[1]
    more = (3e4 * theta**3, 20 * np.abs(omega) * theta)[half]
    trial = Trial("made", trial.samples.with_columns(torque=pl.col("torque") + more))

    row = table_of(record_of_trial(trial, CONFIG.dynamometer)).row(-1, named=True)

    assert row["K_range_high"] - row["K_range_low"] > 1.2 * (row["K_high"] - row["K_low"])
    assert row["K_range_low"] < row["K"] < row["K_range_high"]


def test_a_person_s_lean_is_in_the_range_as_little_as_in_the_estimate():
    rng = np.random.default_rng(1)
    motion = noise(rng, duration=40.0)
    trial = made_trial(rng, motion, torque_noise=0.01)
    time = trial.samples["time"].to_numpy()
    lean = 0.3 * trial.samples["torque"].std() * np.sin(2 * np.pi * 0.12 * time + 1)
    leant = Trial("leant", trial.samples.with_columns(torque=pl.col("torque") + lean))

    upright_row, leant_row = (
        table_of(record_of_trial(each, CONFIG.dynamometer)) for each in (trial, leant)
    )

    for name in ("I_range_low", "I_range_high"):
        assert leant_row[name][-1] == pytest.approx(upright_row[name][-1], rel=0.05)


def test_noise_of_a_coarse_encoder_is_in_neither_part_of_the_band():
    """Where the upper part keeps it, I is half as large again."""
    rng = np.random.default_rng(1)
    trial = made_trial(rng, noise(rng, (0.2, 2.0), rms_deg=4.0), torque_noise=0.01, bits=12)

    row = table_of(record_of_trial(trial, CONFIG.dynamometer)).row(-1, named=True)

    assert row["I_range_high"] == pytest.approx(TRUE["I"], rel=0.3)


def test_one_amplitude_of_two_sines_has_no_range():
    record = stepped_sine(
        faster_is_stiffer,
        protocol=SteppedSineProtocol((0.1,), (1.0, 3.0), 9),
    )

    row = table_of(record).row(-1, named=True)

    assert row["K_range_low"] is None


def of_amplitude(K, B):
    """A fit whose half-widths are 0.02."""
    estimates = np.array([K, B])
    freedom = np.full(2, 9.0)
    return LinearFit(("K", "B"), estimates, 1e-4 * np.eye(2), 100.0, "repeats", freedom)


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        ({"K": -4.0, "B": -1.0}, {"K": "friction", "B": "friction"}),
        ({"K": 4.0, "B": -1.0}, {"K": "nonlinear_spring", "B": "friction"}),
        ({"K": -4.0, "B": 1.0}, {"K": "nonlinear_spring"}),
        ({"K": -4.0, "B": -0.02}, {"K": "nonlinear_spring"}),  # B within its noise
    ],
)
def test_half_of_a_change_over_amplitudes_is_friction_s_or_a_spring_s(changes, names):
    large = of_amplitude(100 + changes["K"], 5 + changes["B"])
    analysis = SimpleNamespace(fits={4.0: large, 2.0: of_amplitude(100.0, 5.0), None: large})
    ranges = {name: (change, -change) for name, change in changes.items()}
    found = Evidence(analysis, None, None, None, ranges, False, is_leg=False)

    for name, change in changes.items():
        sizes = {row.source: row.standard for row in over_motion(found, name)}
        half = abs(change) / 2
        assert sizes == {"amplitude": 2 * half} | ({names[name]: half} if name in names else {})


def hardening_trial(seed):
    """A joint with friction whose spring stiffens, which rests before and after its motion."""
    rng = np.random.default_rng(seed)
    motion = noise(rng, (0.6, 5.0), rms_deg=3.0, duration=60.0, rate=250.0)
    theta, omega, _ = motion[1]
    return made_trial(rng, motion, more=4e3 * theta**3 + 0.5 * np.tanh(omega / 0.05))


def ranges_of(trial, windows=None):
    """Ends (6,) of the ranges of K, B and I."""
    row = table_of(record_of_trial(trial, CONFIG.dynamometer, windows)).row(-1, named=True)
    return np.array([row[f"{name}_range_{end}"] for name in "KBI" for end in ("low", "high")])


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_torque_that_is_not_tared_moves_no_range(seed):
    trial = hardening_trial(seed)
    torque = trial.samples["torque"]
    not_tared = Trial("not tared", trial.samples.with_columns(torque + 3 * torque.std()))

    assert ranges_of(not_tared) == pytest.approx(ranges_of(trial), rel=0.01)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_range_hangs_on_how_a_motion_goes_on_beyond_its_ends(seed, monkeypatch):
    """A filter sees beyond them the mirror image at once, or first half of the run's image or three
    seconds of what was recorded there."""
    trial = hardening_trial(seed)
    alone = ranges_of(trial, "12-52")

    with monkeypatch.context() as patch:
        for module in (impedance, regression):
            patch.setattr(module, "with_gain", with_gain_of_mirrored)
        mirrored = ranges_of(trial, "12-52")
    with monkeypatch.context() as patch:
        for module in (impedance, regression):
            patch.setattr(module, "EDGE_ROWS", 3 * 250)
        recorded = ranges_of(trial, "12-52")

    assert mirrored == pytest.approx(alone, rel=0.02)
    assert recorded == pytest.approx(alone, rel=0.02)


def with_gain_of_mirrored(signals, gain):
    """Signals filtered with half of their mirror image behind them."""
    n = signals.shape[1]
    extended = np.pad(signals, ((0, 0), (0, n // 2)), "symmetric")
    return with_gain(extended, gain)[:, :n]
