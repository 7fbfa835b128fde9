"""Two nodes, a late host and lost samples: nothing is wrong and silent, however regularly the samples are lost."""

import numpy as np
import pytest
from test_timebase import assert_recovers_the_joint, cell, clock, joint, waits

from osl_analysis.errors import InputError
from osl_analysis.timebase.grid import one_time_base
from osl_analysis.timebase.rhythm import BLOCKS, device_step, missing_by_rhythm

RATE, DURATION = 1000.0, 24.0


def lost(n, one_in, scatter, random):
    """Rows of n that are left if one in so many is lost, the interval scattering by up to `scatter` samples."""
    places = np.cumsum(random.integers(one_in - scatter, one_in + scatter + 1, n // one_in + 1))
    kept = np.ones(n, dtype=bool)
    kept[places[places < n - 1]] = False
    return np.flatnonzero(kept)


def late(t, wait, random):
    """Stamps of a host that is late by an exponential wait, in order and none twice."""
    return (waits(t, wait, random) if wait else t) + 1e-9 * np.arange(len(t))


def two_nodes(random, wait=(0.0, 0.0), one_in=(0, 0), rates=(RATE, RATE), scatter=3, counter=False):
    """Streams of angle and torque, 0.3 ms apart: per node the mean wait [s], the loss and the rate."""
    made = []
    for node, first in ((0, 0.0), (1, 3e-4)):
        t = clock(rates[node], DURATION, first)
        kept = lost(len(t), one_in[node], scatter, random) if one_in[node] else np.arange(len(t))
        stamps, more = late(t, wait[node], random)[kept], {"counter": kept} if counter else {}
        made.append(joint(stamps, t[kept], **more) if node == 0 else cell(stamps, t[kept], random, **more))
    return made


@pytest.mark.parametrize("wait", [2e-4, 5e-4, 2e-3])
@pytest.mark.parametrize("one_in", [(0, 50), (100, 0), (300, 300), (0, 5000)])
def test_regular_losses_behind_a_late_host_are_refused(wait, one_in):
    random = np.random.default_rng(one_in[1] + int(1e6 * wait))
    waiting = tuple(wait if n else 0.0 for n in one_in)
    true = DURATION * RATE / max(one_in)
    with pytest.raises(InputError, match=r"about \d+ samples are missing.* nothing tells which.* counter") as refused:
        one_time_base(two_nodes(random, waiting, one_in))
    said = int(str(refused.value).split("about ")[1].split()[0])
    assert said == pytest.approx(true, rel=0.05, abs=1.1)


@pytest.mark.parametrize("one_in", [50, 100])
def test_regular_losses_where_no_host_is_late_are_counted_and_cost_nothing(one_in):
    random = np.random.default_rng(one_in)
    grid = one_time_base(two_nodes(random, (5e-4, 0.0), (0, one_in)))
    assert grid.report.streams[1].missing == pytest.approx(DURATION * RATE / one_in, rel=0.02)
    assert_recovers_the_joint(grid)


@pytest.mark.parametrize("one_in", [50, 300])
def test_regular_losses_behind_a_late_host_cost_nothing_where_a_counter_counts_them(one_in):
    random = np.random.default_rng(one_in)
    assert_recovers_the_joint(one_time_base(two_nodes(random, (0.0, 1e-3), (0, one_in), counter=True)))


@pytest.mark.parametrize(
    "rates", [(333.0, 1000.0), (1000.0, 333.0), (833.3, 833.3), (1024.0, 1000.0), (990.0, 990.0), (1005.0, 1005.0)]
)
def test_late_hosts_that_lose_nothing_are_right_at_any_rates(rates):
    random = np.random.default_rng(int(sum(rates)))
    grid = one_time_base(two_nodes(random, (5e-4, 1e-3), rates=rates))
    assert [stream.missing for stream in grid.report.streams] == [0, 0]
    assert_recovers_the_joint(grid)


@pytest.mark.parametrize("wait", [2e-4, 1e-3, 2e-3])
@pytest.mark.parametrize("share", [0.0, 1e-4, 0.01, 0.05])
def test_the_rhythm_of_the_stamps_tells_the_device_s_step_whatever_is_lost(wait, share):
    random = np.random.default_rng(int(1e5 * (wait + share)))
    t = clock(RATE, DURATION)
    kept = np.sort(random.choice(len(t), round((1 - share) * len(t)), replace=False))
    stamps = late(t, wait, random)[kept]
    missing = kept[-1] - kept[0] + 1 - len(kept)
    assert device_step(stamps, BLOCKS[0]) == pytest.approx(1 / RATE, rel=1e-5)  # a quarter of a step in 24 s
    assert missing_by_rhythm(stamps) == pytest.approx(missing, rel=0.02, abs=0.1)


def test_stamps_without_rhythm_tell_nothing():
    random = np.random.default_rng(5)
    assert missing_by_rhythm(np.cumsum(random.exponential(1e-3, 40_000))) is None
    assert missing_by_rhythm(clock(RATE, 0.5)) is None


@pytest.mark.parametrize("wait", [3e-3, 8e-3])
def test_waits_of_many_steps_beside_a_device_of_almost_the_same_rate_are_refused(wait):
    nodes = two_nodes(np.random.default_rng(6), (0.0, wait), (0, 300))
    with pytest.raises(InputError, match=r"load cell: .* too late to see whether some of its 99\d\.\d\d samples per"):
        one_time_base(nodes)
