# SPDX-License-Identifier: Apache-2.0
"""What the program infers of a recording of the bench never passes for what was stated."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from any_motion import RATE, chirp, made_trial, multisine, noise, sines
from conftest import findings_on, joint_trial, white_noise
from scipy.interpolate import CubicSpline
from shipped import CONFIG

from osl_analysis.bench.budgets import stated_models
from osl_analysis.bench.evidence import impedance_table
from osl_analysis.bench.friction import raw_signals
from osl_analysis.bench.impedance import rendered_impedance
from osl_analysis.bench.motion import record_of_trial
from osl_analysis.inference.candidate_models import Search
from osl_analysis.inference.spectra import WorkingSpectra
from osl_analysis.inference.whitening import Whitened
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


# ---- motion that shakes faster than the filter, which the torque follows


def shaken(size_rad, follows=True):
    """A trial whose angle shakes by 30 to 90 Hz with an RMS of `size_rad` while it moves; its
    torque follows, or the shaking is noise of the encoder alone."""
    time, (theta, omega, alpha) = noise(np.random.default_rng(1), rate=500.0)
    hz = np.arange(30.0, 90.0, 0.1)
    phase = np.random.default_rng(2).uniform(0, 2 * np.pi, hz.size)
    turn = np.exp(1j * (2 * np.pi * np.outer(hz, time) + phase[:, None]))
    size = size_rad * np.sqrt(2 / hz.size)
    shake, shake_omega, shake_alpha = (
        size * ((2j * np.pi * hz) ** order @ turn).imag for order in range(3)
    )
    motion = (theta + shake, omega + shake_omega, alpha + shake_alpha)
    torque = 20 * theta + 0.3 * omega + 0.05 * alpha
    if follows:
        torque = 20 * motion[0] + 0.3 * motion[1] + 0.05 * motion[2]
    rng = np.random.default_rng(3)
    torque = torque + 0.02 * rng.standard_normal(time.size)
    return joint_trial(time, motion[0], torque)


@pytest.mark.parametrize("size_mrad", [0.5, 1.0, 2.0, 6.0])
def test_shaking_that_the_torque_follows_is_motion_and_not_noise(size_mrad):
    fit = rendered_impedance(record_of(shaken(1e-3 * size_mrad))).whole

    for name, true in (("K", 20), ("B", 0.3), ("I", 0.05)):
        assert fit[name] == pytest.approx(true, rel=2e-3), name


def test_shaking_that_the_torque_does_not_follow_is_noise_of_the_encoder():
    """Its power lengthens the columns, and is taken off."""
    noise_power = record_of(shaken(1e-3, follows=False)).angle_noise[1].sum()

    # as white noise of the density of the shaking, up to half of the rate
    assert noise_power == pytest.approx(1e-6 * 250 / 60, rel=0.1)


# ---- a family of faults that is certain


def with_play(share, seed=5):
    """A trial whose spring follows the angle behind a gap of a share of the angle's SD."""
    rng = np.random.default_rng(seed)
    time, motion = noise(rng, rms_deg=3.0, rate=RATE)
    theta = motion[0]
    half = share * theta.std() / 2
    behind = [0.0]
    for angle in theta.tolist():
        behind.append(min(max(behind[-1], angle - half), angle + half))
    return made_trial(rng, (time, motion), more=300 * (np.array(behind[1:]) - theta))


@pytest.mark.parametrize("share", [0.1, 0.15, 0.25, 0.4])
def test_backlash_is_told_at_any_size_by_what_it_takes_off_the_damping(share):
    """Friction beside the gap fits too where it is wide: B of Eq. 15 is wrong by as much."""
    tables = tables_of(with_play(share))
    row = tables["impedance"].row(-1, named=True)

    assert "backlash, speed or direction" in causes_of(tables)
    sizes = tables["budget"].filter(estimate="B", source="play_or_speed", part="fault")["standard"]
    assert sizes.max() > 0.6 * abs(row["B"] - 5)


# ---- candidate models and what a motion tells


def two_sines(seed, first=(5, 1.0), second=(2, 2.7)):
    """An exact joint of K 200, B 3, I 0.05 under two sines [deg, Hz], which begins and ends in
    motion: its angle is not rounded, its torque has white noise of 0.05 N*m."""
    time = np.arange(15_000) / 500
    theta = torque = 0.0
    for degrees, hz in (first, second):
        w = 2 * np.pi * hz
        amplitude = np.deg2rad(degrees)
        theta = theta + amplitude * np.sin(w * time)
        torque = torque + amplitude * (
            (200 - 0.05 * w**2) * np.sin(w * time) + 3 * w * np.cos(w * time)
        )
    return joint_trial(time, theta, torque + 0.05 * white_noise(time.size, seed))


@pytest.mark.parametrize(
    ("first", "second"), [((5, 1.0), (2, 2.7)), ((5, 0.8), (3, 2.1)), ((4, 1.3), (2, 4.1))]
)
def test_two_sines_of_an_exact_joint_show_no_property_and_no_fault(first, second):
    """They give four numbers: a viscoelastic branch beside K, B and I has five parameters."""
    for seed in range(6):
        tables = tables_of(two_sines(seed, first, second))

        assert [*causes_of(tables), *causes_of(tables, Grade.NOTES)] == [], seed
        assert tables["budget"].filter(detail="viscoelastic branch").is_empty()


def test_a_recording_that_ends_in_motion_leaves_white_noise_to_its_end():
    """A band that is cut off rings at its last line, from the end into the recording."""
    spectra = WorkingSpectra(raw_signals(record_of(two_sines(0, (5, 0.8), (3, 2.1)))))
    search = Search(Whitened(spectra), has_friction=False)
    residual = search.rest(search.data.torque - search.impedance @ search.data.motion)

    *rest, last = (np.mean(part**2) for part in np.array_split(residual, 8))
    assert last == pytest.approx(np.mean(rest), rel=0.2)


# ---- the zero of torque and of angle


MOTIONS = {
    "noise": lambda rng: noise(rng, rate=500.0),
    "chirp": lambda rng: chirp(rng, rate=500.0),
    "periods": lambda rng: multisine(rng, rate=500.0),
    "three sines": lambda rng: sines(rng, [0.7, 1.9, 4.3], rate=500.0),
    "gait": lambda rng: sines(rng, np.arange(1, 7) / 1.1, rate=500.0),
}


@pytest.mark.parametrize("column", ["torque", "theta"])
@pytest.mark.parametrize("motion", MOTIONS)
def test_a_constant_of_torque_or_angle_changes_no_estimate_range_or_verdict(motion, column):
    """A constant of three standard deviations, as of a load cell without tare."""
    rng = np.random.default_rng(7)
    trial = made_trial(rng, MOTIONS[motion](rng), bits=17)
    step = 2 * np.pi / 2**17
    offset = np.ceil(3 * trial.samples[column].std() / step) * step  # a whole number of steps
    moved = replace(trial, samples=trial.samples.with_columns(pl.col(column) + offset))

    tables, others = (tables_of(each) for each in (trial, moved))
    row, other = (each["impedance"].row(-1, named=True) for each in (tables, others))

    for name in ("K", "B", "I"):
        ends = [f"{name}_low", f"{name}_high"]
        assert [other[end] for end in ends] == pytest.approx([row[end] for end in ends], rel=1e-6)
        assert other[name] == pytest.approx(row[name], rel=1e-6)
        width = row[f"{name}_range_high"] - row[f"{name}_range_low"]
        assert other[f"{name}_range_high"] - other[f"{name}_range_low"] == pytest.approx(
            width, rel=0.01
        )
    assert causes_of(others) == causes_of(tables)
    assert causes_of(others, Grade.NOTES) == causes_of(tables, Grade.NOTES)


def test_a_likely_fault_below_what_is_needed_is_a_remark_with_its_size():
    """Backlash of 2 % of the angle's SD: B is off beyond its interval, by less than is needed."""
    tables = tables_of(with_play(0.02))
    row = tables["impedance"].row(-1, named=True)
    (remark,) = [
        finding
        for finding in findings_on(tables, Limits())
        if finding.grade is Grade.NOTES and finding.source == "play_or_speed"
    ]

    assert causes_of(tables) == []
    sizes = {number.column: number.value for number in remark.evidence}
    assert sizes["B"] == pytest.approx(abs(row["B"] - 5), rel=0.5)
