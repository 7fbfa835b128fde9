# SPDX-License-Identifier: Apache-2.0
"""The guard of angle and torque: it tells a number that leaves its curve, and accuses no sound
recording."""

import numpy as np
import pytest
from conftest import white_noise

from osl_analysis.signals.plateaus import find_leaps, steps_by_friction

ROWS = 2000
RATE_HZ = 200.0
TIME = np.arange(ROWS) / RATE_HZ
NOISE = white_noise((2, ROWS), 3)
OMEGA = 2 * np.pi * 5.0  # rad/s; second differences of this motion are large, third ones small
TORQUE = 30.0 * np.cos(OMEGA * TIME) + 0.01 * NOISE[1]  # N*m
USUAL_BEND = np.quantile(np.abs(np.diff(TORQUE, 3)), 0.99)  # N*m
BESIDE_GAP = np.delete(np.arange(ROWS), np.arange(700, 730))


def changed(values, rows, new):
    leaping = values.copy()
    leaping[rows] = new
    return leaping


SOUND = {
    "sine": TORQUE,
    "failed reading": changed(TORQUE, 700, np.nan),
    # the largest third difference is three times the leap
    "leap below the limit": changed(TORQUE, 700, TORQUE[700] + 2.5 * USUAL_BEND),
    "flickering at rest": np.where(NOISE[0] > 2.0, 0.1, 0.0),
    "white noise": NOISE[0],
    "coarse encoder": np.round(20 * np.sin(TIME)) / 20,
    "ramps that begin between two samples": np.clip(TIME - 2.0013, 0, 1)
    - np.clip(TIME - 6.0032, 0, 1),
    "too few samples": changed(TORQUE, 150, 1e6)[:300],
}


@pytest.mark.parametrize("values", SOUND.values(), ids=SOUND)
def test_a_steady_a_noisy_and_a_coarse_channel_are_not_accused(values):
    assert find_leaps(TIME[: values.size], values).size == 0


def test_rows_that_are_missing_are_a_gap_and_no_leap():
    assert np.abs(np.diff(TORQUE[BESIDE_GAP], 3)).max() > 20 * USUAL_BEND
    assert find_leaps(TIME[BESIDE_GAP], TORQUE[BESIDE_GAP]).size == 0


BORDERS = [3.5, 3.8]
LEAPS = {
    "a flipped bit of the exponent": (TIME, changed(TORQUE, 700, 2 * TORQUE[700]), [3.5]),
    # the largest third difference is twice the leap
    "a part of a short recording": (
        TIME[500:1100],
        np.where(TIME < 3.5, TORQUE, TORQUE + 7.5 * USUAL_BEND)[500:1100],
        [3.5],
    ),
    "a block of zeros": (TIME, changed(TORQUE, slice(700, 760), 0.0), BORDERS),
}


@pytest.mark.parametrize(("time", "values", "times"), LEAPS.values(), ids=LEAPS)
def test_a_leap_is_told_with_its_time(time, values, times):
    assert find_leaps(time, values) == pytest.approx(times, abs=1.5 / RATE_HZ)


@pytest.mark.parametrize("share", [0.001, 0.01, 0.04])
def test_readings_that_are_zero_now_and_then_are_told_however_many_they_are(share):
    is_zero = np.random.default_rng(7).random(ROWS) < share

    times = find_leaps(TIME, np.where(is_zero, 0.0, TORQUE))

    of_zeros = TIME[is_zero & (np.abs(TORQUE) > 10)]
    found = [np.abs(times - time).min() < 1.01 / RATE_HZ for time in of_zeros]
    assert np.mean(found) > 0.6
    assert times.size <= is_zero.sum()


@pytest.mark.recordings
def test_no_human_ankle_is_accused(recordings):
    """Moved by binary steps, which no smooth curve describes."""
    with np.load(recordings / "human/human_ankles.npz") as records:
        ankles = {name: records[name].astype(float) for name in records if name != "sv"}
    assert len(ankles) == 6

    for name, recording in ankles.items():
        time = np.arange(len(recording)) / 1e3
        assert [find_leaps(time, values).size for values in recording.T] == [0, 0], name


def test_a_motion_before_a_long_rest_has_no_leaps():
    """Nine tenths of the rows are rest, whose third differences are those of rounding alone."""
    step = 1e-3
    motion = step * np.round(np.sin(2 * np.pi * np.arange(2000) / 100) / step)
    values = np.concatenate([motion, np.zeros(18_000)])
    time = np.arange(values.size) / RATE_HZ

    assert find_leaps(time, values).size == 0
    wrong = changed(values, slice(700, 760), 3.0)
    assert find_leaps(time, wrong) == pytest.approx([3.5, 3.8], abs=1.5 / RATE_HZ)


def test_friction_steps_the_torque_also_where_a_motion_has_just_begun():
    """It rests until 50 ms before its first turn, and goes on far behind it."""
    time = np.arange(400) / 1000
    angle = 0.02 - 5 * np.maximum(time - 0.2, -0.05) ** 2
    torque = np.where(time < 0.2, 1.0, -1.0)  # down where the joint turns down
    turn_s = np.array([0.2])

    assert steps_by_friction(turn_s, (time, angle), (time, torque)).all()
    assert not steps_by_friction(turn_s, (time, angle), (time, -torque)).any()


def test_the_last_digit_of_an_encoder_before_a_long_rest_is_no_spike():
    step = 1e-3
    motion = step * np.round(20 * np.sin(2 * np.pi * np.arange(2000) / 100))
    motion[25::100] += step  # for one row where it turns
    values = np.concatenate([motion, np.zeros(16_500)])

    assert find_leaps(np.arange(values.size) / RATE_HZ, values).size == 0
