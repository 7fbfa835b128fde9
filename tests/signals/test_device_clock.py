# SPDX-License-Identifier: Apache-2.0
"""When samples were taken, and how long a log repeats them, on both sides of each limit."""

import numpy as np
import pytest
import scipy

from osl_analysis.signals.agreement import turns
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
