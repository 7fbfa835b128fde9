"""The guard of angle and torque: it tells a number that leaves its curve, and accuses no sound
recording."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from conftest import ROOT
from recognised_files import read_recognised

from osl_analysis.commands.simulate import (
    UNFOLLOWED,
    read_simulation,
    row_of_trial,
    simulate_trial,
)
from osl_analysis.ingest.leaps import LARGEST_BEND, find_leaps
from osl_analysis.ingest.raw_files import read_source, trial_from_files
from osl_analysis.trial import Array, Trial

REAL_DATA = ROOT.parent / "shared/real_data"
needs_real_data = pytest.mark.skipif(not REAL_DATA.is_dir(), reason="real data are not here")

ROWS, RATE_HZ = 2000, 200.0
TIME = np.arange(ROWS) / RATE_HZ
NOISE = np.random.default_rng(3).standard_normal((2, ROWS))
OMEGA = 2 * np.pi * 5.0  # rad/s; second differences of this motion are large, third ones small
THETA = 0.1 * np.sin(OMEGA * TIME) + 1e-5 * NOISE[0]  # rad
TORQUE = 30.0 * np.cos(OMEGA * TIME) + 0.01 * NOISE[1]  # N*m
USUAL_TORQUE_BEND = float(np.quantile(np.abs(np.diff(TORQUE, 3)), 0.99))  # N*m


def trial_of(**columns: Array) -> Trial:
    return Trial("t", pl.DataFrame({"time": TIME, "theta": THETA, "torque": TORQUE, **columns}))


def accused(trial: Trial) -> dict[str, Array]:
    """Times of the leaps of each column that has some."""
    columns = [column for column in ("theta", "theta_m", "torque") if column in trial.columns]
    leaps = {column: find_leaps(*trial.arrays(column)) for column in columns}
    return {column: times for column, times in leaps.items() if times.size}


def with_number(values: Array, row: int, number: float) -> Array:
    changed = values.copy()
    changed[row] = number
    return changed


def test_a_sound_trial_is_not_accused() -> None:
    assert accused(trial_of()) == {}


def test_a_bit_that_flips_in_the_exponent_is_told_with_its_time() -> None:
    bits = TORQUE.view(np.uint64).copy()
    bits[700] ^= np.uint64(1) << np.uint64(52)  # twice the number, or half of it

    leaps = accused(trial_of(torque=bits.view(np.float64)))

    assert leaps == {"torque": pytest.approx([3.5], abs=1.01 / RATE_HZ)}


@pytest.mark.parametrize("column", ["theta", "torque"])
def test_a_leap_of_one_sample_is_told_in_either_channel(column: str) -> None:
    sound = {"theta": THETA, "torque": TORQUE}[column]
    usual = np.quantile(np.abs(np.diff(sound, 3)), 0.99)
    leaping = with_number(sound, 700, sound[700] + 30 * usual)

    leaps = accused(trial_of(**{column: leaping}))

    assert leaps == {column: pytest.approx([3.5], abs=1.01 / RATE_HZ)}


def test_a_leap_below_the_limit_is_not_told() -> None:
    """The largest third difference is three times the leap."""
    below = 0.25 * LARGEST_BEND * USUAL_TORQUE_BEND

    assert accused(trial_of(torque=with_number(TORQUE, 700, TORQUE[700] + below))) == {}


def test_a_leap_is_seen_in_a_motion_whose_second_differences_hide_it() -> None:
    largest_second = np.abs(np.diff(TORQUE, 2)).max()
    leap = 2.0 * largest_second
    leaping = with_number(TORQUE, 700, TORQUE[700] + leap)
    assert np.abs(np.diff(leaping, 2)).max() < LARGEST_BEND * largest_second

    assert [*accused(trial_of(torque=leaping))] == ["torque"]


def test_a_block_that_was_zeroed_or_is_of_another_place_is_told_at_its_borders() -> None:
    zeroed, elsewhere = TORQUE.copy(), THETA.copy()
    zeroed[700:760] = 0.0
    elsewhere[700:760] = THETA[990:1050]

    leaps = accused(trial_of(torque=zeroed))["torque"]
    assert (leaps.size, leaps[0]) == (2, 3.5)
    assert [*accused(trial_of(theta=elsewhere))] == ["theta"]


@pytest.mark.parametrize("share", [0.001, 0.01, 0.04])
def test_readings_that_are_zero_now_and_then_are_told_however_many_they_are(share: float) -> None:
    is_zero = np.random.default_rng(7).random(ROWS) < share

    times = accused(trial_of(torque=np.where(is_zero, 0.0, TORQUE)))["torque"]

    of_zeros = TIME[is_zero & (np.abs(TORQUE) > 10)]
    found = [np.abs(times - time).min() < 1.01 / RATE_HZ for time in of_zeros]
    assert np.mean(found) > 0.6
    assert times.size <= is_zero.sum()


NOTHING = {
    "flickering at rest": np.where(NOISE[0] > 2.0, 0.1, 0.0),
    "constant": np.full(ROWS, 3.0),
    "resting, with one step": np.where(TIME < 5.0, 0.0, 1.0),
    "white noise": NOISE[0],
    "drifting noise": np.cumsum(NOISE[0]),
    "coarse encoder": np.round(20 * np.sin(TIME)) / 20,
    "stepper": np.floor(20 * TIME),
    "triangle": np.abs(TIME % 1.0 - 0.5) + 1e-4 * NOISE[0],
    "sine that begins at full speed": np.where(TIME < 5.0, 0.0, np.sin(TIME - 5.0)),
    "ramps that begin between two samples": np.clip(TIME - 2.0013, 0, 1)
    - np.clip(TIME - 6.0032, 0, 1),
    "slow ramps that turn smoothly": np.convolve(
        np.abs((np.arange(ROWS + 8) / RATE_HZ) % 10.0 - 5.0), np.hanning(11)[1:-1] / 5.0, "valid"
    ),
    "blow": np.exp(-np.abs(TIME - 5.0) / 0.1) + 1e-4 * NOISE[0],
}


@pytest.mark.parametrize("values", NOTHING.values(), ids=NOTHING)
def test_a_steady_a_noisy_and_a_coarse_channel_are_not_accused(values: Array) -> None:
    assert accused(trial_of(torque=values)) == {}


def test_readings_that_failed_are_no_leap() -> None:
    assert accused(trial_of(torque=with_number(TORQUE, 700, np.nan))) == {}


@pytest.mark.parametrize("rows", [0, 1, 5, 300])
def test_of_a_few_samples_nothing_is_said(rows: int) -> None:
    leaping = with_number(TORQUE, 150, 1e6)[:rows]

    assert not find_leaps(TIME[:rows], leaping).size


def test_rows_that_are_missing_are_a_gap_and_no_leap() -> None:
    present = np.delete(np.arange(ROWS), np.arange(700, 730))
    assert np.abs(np.diff(TORQUE[present], 3)).max() > LARGEST_BEND * USUAL_TORQUE_BEND

    assert not find_leaps(TIME[present], TORQUE[present]).size


def test_stamps_that_scatter_hide_no_leap() -> None:
    scattered = TIME + 0.4 / RATE_HZ * np.random.default_rng(4).uniform(-1, 1, ROWS)
    leaping = TORQUE.copy()
    leaping[[300, 700, 1100, 1500]] += 10.0

    assert find_leaps(scattered, leaping).size == 4


DEFAULT = ROOT / "config/simulation/default.yaml"
KINDS = ["belt_01", "actuator_1", "impedance_K300_B5.0_compensated", "walking_01"]


@pytest.mark.parametrize("name", KINDS)
def test_sound_trials_of_the_default_campaign_are_not_accused(name: str, tmp_path: Path) -> None:
    simulate_trial(DEFAULT, tmp_path, name)
    row = row_of_trial(read_simulation(DEFAULT, UNFOLLOWED), DEFAULT, name)

    assert accused(trial_from_files(row, tmp_path, ROOT / "config/sources")) == {}


@needs_real_data
def test_no_human_ankle_is_accused() -> None:
    """Moved by binary steps, which no smooth curve describes."""
    with np.load(REAL_DATA / "human/human_ankles.npz") as records:
        recordings = {name: records[name].astype(float) for name in records if name != "sv"}
    assert len(recordings) == 6

    for name, (theta, torque) in ((name, both.T) for name, both in recordings.items()):
        time = np.arange(theta.size) / 1e3
        trial = Trial(name, pl.DataFrame({"time": time, "theta": theta, "torque": torque}))
        assert accused(trial) == {}, name


@needs_real_data
def test_no_test_of_the_desr_foot_is_accused() -> None:
    source = read_source(ROOT / "config/sources/desr.yaml")
    sheet = pl.read_csv(ROOT / "config/campaigns/desr/trials.csv")
    path = REAL_DATA / "mat/DESR_Characterization_Data.mat"

    for part in sheet["log_part"].unique():
        described = source.of_part(part).model_dump(exclude_unset=True)
        recording = read_recognised(path, **described)
        assert recording.warnings == []
        assert accused(Trial(part, recording.samples)) == {}, part


WITHOUT_DOUBT = ["c3d/Eb015pr.c3d", "c3d/opensim_jogging_300_1500.c3d"]


@needs_real_data
@pytest.mark.parametrize("name", WITHOUT_DOUBT)
def test_a_sound_public_capture_is_read_without_a_doubt(name: str) -> None:
    recording = read_recognised(REAL_DATA / name)

    assert (recording.warnings, recording.losses) == ([], {})
