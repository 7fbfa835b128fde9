"""Two nodes, a late host and lost samples: nothing is wrong and silent, however regularly the samples are lost."""

import numpy as np
import pytest
from conftest import ROOT
from test_timebase import assert_recovers_the_joint, cell, clock, joint, log, waits

from osl_analysis.errors import InputError
from osl_analysis.timebase.grid import one_time_base
from osl_analysis.timebase.samples import take
from osl_analysis.timebase.stream import Stream

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


@pytest.mark.parametrize("wait", [3e-3, 8e-3])
def test_waits_of_many_steps_beside_a_device_of_almost_the_same_rate_are_refused(wait):
    nodes = two_nodes(np.random.default_rng(6), (0.0, wait), (0, 300))
    with pytest.raises(InputError, match=r"load cell: .* too late to see whether some of its 99\d\.\d\d samples per"):
        one_time_base(nodes)


# ---- Values that are missing from rows that are there


def with_nan(random, change, stamps=None, taken=None):
    """A log of one device whose columns lack the values that `change` takes away."""
    t = clock(RATE, DURATION)
    whole = log(t if stamps is None else stamps, t if taken is None else taken, random)
    signals = {name: values.copy() for name, values in whole.signals.items()}
    change(signals, random)
    return Stream("log", whole.stamps, signals)


def one_percent_of_each(signals, random):
    for values in signals.values():
        values[random.random(len(values)) < 0.01] = np.nan


def two_of_three_torques(signals, _random):
    signals["torque"][np.arange(len(signals["torque"])) % 3 > 0] = np.nan


@pytest.mark.parametrize("change", [one_percent_of_each, two_of_three_torques])
@pytest.mark.parametrize("kind", ["even", "jitter", "latency"])
def test_values_that_are_missing_cost_nothing_and_split_no_device(kind, change):
    random, t = np.random.default_rng(7), clock(RATE, DURATION)
    jittered = np.sort(t + 2e-5 * random.standard_normal(len(t)))
    stamps, taken = {"even": (t, t), "jitter": (jittered, jittered), "latency": (late(t, 5e-4, random), t)}[kind]
    recorded = with_nan(random, change, stamps, taken)
    grid = one_time_base([recorded])
    angle, torque = grid.report.streams
    lower = change is two_of_three_torques
    lacking = [int(np.isnan(values).sum()) for values in recorded.signals.values()]
    assert [angle.empty, torque.empty] == ([0, 0] if lower else lacking)
    assert torque.error == pytest.approx(81 * angle.error if lower else angle.error, rel=1e-4)
    assert {angle.even, torque.even} == {kind != "jitter"}
    assert_recovers_the_joint(grid)


@pytest.mark.parametrize(("length", "bridged", "marked"), [(20, 1, 0), (21, 0, 1)])
def test_missing_values_in_a_row_are_a_gap_of_their_own_length(length, bridged, marked):
    def change(signals, _random):
        signals["torque"][5000 : 5000 + length] = np.nan

    grid = one_time_base([with_nan(np.random.default_rng(8), change)])
    assert [(s.empty, s.bridged, s.marked) for s in grid.report.streams] == [(0, 0, 0), (length, bridged, marked)]
    assert_recovers_the_joint(grid)


def test_losses_behind_a_late_host_are_not_refused_where_one_device_has_channels_with_missing_values():
    t, random = clock(RATE, DURATION), np.random.default_rng(13)
    kept = lost(len(t), 100, 3, random)
    one = log(late(t, 2e-4, random)[kept], t[kept], random)
    one.signals["torque"][::150] = np.nan
    grid = one_time_base([one])
    assert [stream.signals for stream in grid.report.streams] == [("theta",), ("torque",)]
    assert_recovers_the_joint(grid)


def test_a_channel_without_values_and_one_that_lacks_them_for_too_long_are_refused():
    random = np.random.default_rng(9)
    with pytest.raises(InputError, match=r"log: torque has 0 values in 24000 rows; at least 20 are needed"):
        one_time_base([with_nan(random, lambda signals, _: signals["torque"].fill(np.nan))])
    with pytest.raises(InputError, match=r"torque has no sample from 4\.9990 s to 5\.6000 s"):
        one_time_base([with_nan(random, lambda signals, _: signals["torque"][5000:5600].fill(np.nan))])


def test_rows_written_twice_go_though_a_value_is_missing_in_both():
    def twice(signals, _random):
        signals["torque"][100] = np.nan

    one = with_nan(np.random.default_rng(10), twice)
    rows = np.sort(np.append(np.arange(len(one.stamps)), 100))
    again = Stream("log", one.stamps[rows], {name: values[rows] for name, values in one.signals.items()})
    assert one_time_base([again]).report.streams[0].repeated == 1


def test_20_ms_missing_in_every_cycle_are_bridged_and_cost_nothing():
    t, random = clock(RATE, DURATION), np.random.default_rng(11)
    kept = np.arange(len(t)) % 200 < 180
    grid = one_time_base([log(t[kept], t[kept], random)])
    assert (grid.report.streams[0].marked, grid.report.masked) == (0, 0)
    assert_recovers_the_joint(grid)


# ---- The page's example of sixth differences


def example(even):
    """A row of the page's table: RMS of D6 x and of D6(x' delta) [1e-4 rad], g and its standard error."""
    t, random = clock(1000.0, 60.0), np.random.default_rng(12)
    stamps = t + 2e-5 * random.standard_normal(len(t))
    taken, w, size = (t if even else stamps), 2 * np.pi, np.deg2rad(4.0)
    theta = np.round(size * np.sin(w * taken) * 2**18 / w) * w / 2**18
    pushed = size * w * np.cos(w * t) * (stamps - t)
    seen = [1e4 * np.std(np.diff(x, 6)) for x in (theta, pushed)]
    (part,) = take([Stream("encoder", stamps, {"theta": theta})])
    said = part.decision.evidence["theta"]
    name = "device samples evenly, stamps scatter" if even else "stamps are true"
    return f"| {name} | {seen[0]:.2f} | {seen[1]:.2f} | {said.g:.3f} | {said.se:.3f} |"


@pytest.mark.parametrize("even", [False, True])
def test_the_page_s_example_of_sixth_differences_is_what_the_rule_finds(even):
    print(example(even))
    assert example(even) in (ROOT / "docs/time_base.md").read_text(encoding="utf-8")
