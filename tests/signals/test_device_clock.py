# SPDX-License-Identifier: Apache-2.0
"""When samples were taken, and how long a log repeats them, on both sides of each limit."""

import numpy as np
import pytest
import scipy

from osl_analysis.signals.agreement import turn_ratio, turns
from osl_analysis.signals.device_clock import DeviceClock, held_values

COUNT = np.arange(2000)
EVEN = 0.0123456 * COUNT
JITTER = 1e-4 * np.tile(np.linspace(-1, 1, 10), 200)


def times_of(late):
    return DeviceClock(EVEN + late, COUNT).times()


def test_stamps_beyond_five_deviations_do_not_move_the_line():
    """A deviation of this jitter is 0.6 of it, by its quantiles."""
    outlying = JITTER + 4e-4 * (COUNT % 50 == 5)

    assert times_of(outlying) == pytest.approx(EVEN, abs=2e-6)


@pytest.mark.parametrize(("skewness", "is_latency"), [(0.35, False), (0.8, True)])
def test_skewed_lateness_is_latency_and_its_promptest_stamp_right(skewness, is_latency):
    lateness = 1e-4 * scipy.stats.pearson3(skewness).ppf((COUNT + 0.5) / 2000)
    late = np.random.default_rng(1).permutation(lateness)

    expected = lateness.min() if is_latency else 0.0
    assert times_of(late) - EVEN == pytest.approx(expected, abs=1e-5)


def test_samples_are_in_batches_also_by_two():
    assert DeviceClock(np.repeat(EVEN[::2], 2), COUNT).is_in_batches


@pytest.mark.parametrize(("change", "holds"), [(2, False), (4, True)])
def test_a_pace_shows_after_changes_of_more_than_coarse_steps(change, holds):
    held = np.repeat(np.cumsum(np.tile([1.0, change], 100)), 5)

    assert (held_values(held, 0.01) is not None) == holds


@pytest.mark.parametrize(("uneven", "holds"), [(0.1, True), (0.3, False)])
def test_a_source_hardly_slower_than_the_log_is_even_to_a_row(uneven, holds):
    rows = np.rint(1.1 * COUNT + uneven * np.sin(COUNT)).astype(int)
    logged = np.searchsorted(rows, np.arange(2200), "right") * 1.0

    assert (held_values(logged, 0.01) is not None) == holds


def test_channels_are_compared_over_a_quarter_of_a_second():
    assert turns(EVEN, 2 * EVEN, False) == pytest.approx(0.5)


@pytest.mark.parametrize(("correlation", "follows"), [(0.93, True), (0.87, False)])
def test_a_channel_follows_another_of_which_it_explains_four_fifths(correlation, follows):
    angle = np.sin(np.linspace(0, 20 * np.pi, 1000))
    other = np.sin(np.linspace(0, 30 * np.pi, 1000))  # uncorrelated, and as large

    ratio = turn_ratio(angle, correlation * angle + np.sqrt(1 - correlation**2) * other)

    assert np.isfinite(ratio) == follows


def fast_hand(seed, bits=14):
    """An angle at 2 kHz of random motion below 6 Hz, of 30 s, with a third of a step of noise."""
    random = np.random.default_rng(seed)
    time = np.arange(60000) / 2000
    hz, phase = random.uniform(0.3, 6, (2, 40))
    angle = 0.02 * np.sin(2 * np.pi * hz[:, None] * time + phase[:, None]).sum(axis=0)
    step = 2 * np.pi / 2**bits
    return step * np.rint(angle / step + 0.3 * random.standard_normal(time.size))


def test_a_coarse_angle_whose_values_last_two_rows_is_of_no_slower_source():
    """Any whole number of rows is within a row of a multiple of two: a pace is no evidence."""
    angles = [fast_hand(seed, bits) for seed in range(8) for bits in (12, 13, 14)]

    assert [held_values(angle, 1 / 2000) for angle in angles] == [None] * len(angles)


@pytest.mark.parametrize("rows", [2.0, 2.1, 2.3, 2.5, 2.9, 3.4, 4.3])
def test_an_even_source_of_any_rows_per_value_is_found_at_its_period(rows):
    random = np.random.default_rng(1)
    value = np.floor(np.arange(20000) / rows + 0.3).astype(int)
    logged = np.sin(0.01 * value) + 1e-3 * random.standard_normal(value[-1] + 1)[value]

    held = held_values(logged, 1e-3)

    assert held is not None
    assert held.period == pytest.approx(rows, rel=1e-5)
    assert len(held.values) == pytest.approx(20000 / rows, abs=2)


@pytest.mark.parametrize(("rows", "holds"), [(3, False), (5, True)])
def test_the_pace_of_an_uneven_source_tells_it_from_five_rows_per_value_on(rows, holds):
    """Each value lasts a row more or less: of three rows any number is within one of a multiple."""
    random = np.random.default_rng(2)
    taken = np.cumsum(random.uniform(rows - 0.9, rows + 0.9, 20000 // rows))
    value = np.searchsorted(taken, np.arange(19000), "right")

    held = held_values(random.standard_normal(len(taken) + 1)[value], 1e-3)

    assert (held is not None) == holds
