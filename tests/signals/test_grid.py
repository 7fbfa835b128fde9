# SPDX-License-Identifier: Apache-2.0
"""One time base: stamps of real recorders, the truth written by hand, the joint's K, B, I at the
end."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from conftest import refused_with
from stamp_recorders import (
    DURATION,
    RATE,
    angle_at,
    assert_recovers_the_joint,
    cell,
    clock,
    held_log,
    jittered,
    joint,
    log,
    noisy,
    one_time_base,
    recorded,
    rounded_to_bits,
    sines,
    stepped_sine,
    torque_at,
    two_nodes,
    waits,
)

from osl_analysis.base.trial import check_time
from osl_analysis.signals.device_clock import DeviceClock, held_values
from osl_analysis.signals.grid import USUAL_FILTER, fixture_torque, on_one_grid
from osl_analysis.signals.sample_count import count_from_stamps
from osl_analysis.signals.samples import Stream, take
from osl_analysis.signals.stamp_evidence import Reading


@pytest.mark.parametrize(("rate", "largest"), [(100.0, 2.6e-5), (300.0, 3.2e-7), (1000.0, 2.6e-9)])
def test_a_5_hz_sine_comes_to_the_grid_with_the_stated_error(rate, largest):
    t = clock(rate, 10.0)
    wave = Stream("wave", t, {"wave": np.sin(10 * np.pi * t)})
    half_a_step_later = Stream("other", t + 0.5 / rate, {"other": t})

    grid = one_time_base([wave, half_a_step_later])

    errors = np.abs(grid.signals["wave"] - np.sin(10 * np.pi * grid.time))[20:-20]
    assert np.max(errors) == pytest.approx(largest, rel=0.05)


# ---- Are the stamps true?


MOTIONS = {
    "multisine": lambda t: sines(t)[0],
    "stepped": stepped_sine,
    "ramp": lambda t: 0.05 * t,
}


@pytest.mark.parametrize("motion", MOTIONS)
def test_no_case_is_decided_wrongly_over_bits_jitter_and_lateness(motion):
    random = np.random.default_rng(len(motion))
    t = clock(1000.0, 12.0)
    firm = 0
    for bits, jitter, is_late, is_even in product(
        (12, 18), (1e-5, 3e-4), (False, True), (False, True)
    ):
        stamps = waits(t, jitter, random) if is_late else jittered(t, jitter, random)
        values = rounded_to_bits(MOTIONS[motion](t if is_even else stamps), bits)

        reading = take([Stream("x", stamps, {"x": values})])[0].reading

        if reading.firm:
            firm += 1
            assert reading.even == is_even, (bits, jitter, is_late, reading.why)
    assert firm >= 5


def test_channels_firmly_true_and_firmly_even_fit_no_one_decision():
    random = np.random.default_rng(6)
    t = clock(1000.0)
    stamps = jittered(t, 2e-4, random)
    signals = {"theta": angle_at(t), "torque": torque_at(stamps, random)}

    (row,) = one_time_base([Stream("log", stamps, signals)]).streams

    assert (row["stamps"], row["firm"]) == ("exact", False)


MINUTE = clock(500.0, 60.0)


def test_jitter_is_not_believed_where_no_signal_decides():
    random = np.random.default_rng(7)
    stamps = jittered(MINUTE, 2e-4, random)
    slow = rounded_to_bits(0.03 * np.sin(0.2 * np.pi * MINUTE), 14)
    rest = noisy(0 * MINUTE, random)

    grid = one_time_base([Stream("belt", stamps, {"angle": slow, "rest": rest})])

    (row,) = grid.streams
    assert row["stamps"] == "even"
    assert not row["firm"]
    assert grid.signals["angle"] == pytest.approx(slow, abs=1e-12)
    assert "rest" not in row["why"]  # its slope is noise


def test_a_signal_that_stands_is_no_evidence():
    stamps = jittered(MINUTE, 2e-4, np.random.default_rng(7))

    (row,) = one_time_base([Stream("dead", stamps, {"zero": 0 * MINUTE})]).streams

    assert not row["firm"]
    assert "zero" not in row["why"]


def test_stamps_that_wander_slowly_are_kept_where_nothing_decides():
    rest = noisy(0 * MINUTE, np.random.default_rng(7))
    wandering = MINUTE + 0.02 * np.sin(2 * np.pi * MINUTE / 30)

    (row,) = one_time_base([Stream("rest", wandering, {"x": rest})]).streams

    assert (row["stamps"], row["firm"]) == ("exact", False)


def test_samples_of_a_creeping_clock_lie_where_its_stamps_do():
    taken = MINUTE + 0.02 * np.sin(2 * np.pi * MINUTE / 30)
    stamps = jittered(taken, 2e-4, np.random.default_rng(7))

    (part,) = take([joint(stamps, taken)])

    assert part.reading.even
    assert np.std(part.reading.times(part.clock) - taken) < 1.7e-4 < np.std(stamps - taken)


@pytest.mark.parametrize("kind", ["even", "true"])
@pytest.mark.parametrize(
    "case",
    [
        {"decimals": 4, "jitter": 6.5e-5},
        {"rate": 200.0, "jitter": 1e-3},
        {"lost": 1e-3},
    ],
)
def test_even_devices_and_true_stamps_are_told_apart(kind, case):
    recording, taken = recorded(**{"seed": len(str(case)), "kind": kind, **case})

    (part,) = take([recording])

    reading = part.reading
    assert reading.firm, reading.why
    assert reading.even == (kind == "even")
    late_in_loops = (reading.times(part.clock) - taken) * case.get("rate", RATE)
    assert np.std(late_in_loops[50:-50]) < 0.06
    assert_recovers_the_joint(on_one_grid([part], USUAL_FILTER))


def test_values_older_than_their_stamps_are_read_firmly_as_neither():
    recording, _ = recorded(3, "true", age=0.5, rate=200.0, jitter=1e-3)

    (part,) = take([recording])

    assert not part.reading.firm
    assert "neither even nor true samples fit" in part.reading.why


def test_an_even_device_whose_stamps_are_rounded_is_told_by_this_alone():
    recording, _ = recorded(1, "even", rate=333.0, jitter=1e-6, decimals=3)

    (part,) = take([recording])

    assert part.reading.firm
    assert part.reading.why == "even: the stamps scatter by their rounding alone"


def test_stamps_whose_rate_changes_for_good_are_those_of_no_even_device():
    recording, _ = recorded(107, "even", rate=333.0, changes=0.05, lost=1e-3)

    (part,) = take([recording])

    assert (part.reading.even, part.reading.firm) == (False, True)
    assert_recovers_the_joint(on_one_grid([part], USUAL_FILTER))


def test_stamps_that_fit_no_hypothesis_are_kept_and_not_firm():
    """Half of the host's scatter is in the samples: no device does that."""
    random = np.random.default_rng(5)
    t = clock(1000.0)
    stamps = jittered(t, 1e-4, random)

    reading = take([log(stamps, (t + stamps) / 2, random)])[0].reading

    assert not reading.firm
    assert not reading.even


def test_a_held_value_of_an_uneven_source_is_half_a_row_older():
    random = np.random.default_rng(2)
    recording = held_log(97.0)
    taken = clock(97.0, DURATION + 0.1)
    taken += np.clip(np.cumsum(random.normal(0, 3e-4, taken.size)), -4e-3, 4e-3)
    newest = np.maximum(np.searchsorted(taken, clock(RATE), "right") - 1, 0)
    recording.signals["torque"][:] = torque_at(taken, random)[newest]

    grid = one_time_base([recording])

    (row,) = [row for row in grid.streams if row["signals"] == "torque"]
    assert not row["firm"]
    assert row["delay_s"] == pytest.approx(5e-4, abs=2e-6)
    assert_recovers_the_joint(grid)


# ---- Channels whose source is slower than the log


@pytest.mark.parametrize("of", ["theta", "torque"])
@pytest.mark.parametrize(
    ("rate", "delay_s", "sure"),  # the last in fourteen phases
    [(333.0, 5e-4, True), (1000 / 3, 0, False), (50.0, 0, False), (14e3 / 43, 4.64e-4, False)],
)
def test_a_held_channel_is_doubtful_where_the_rates_do_not_beat(of, rate, delay_s, sure):
    grid = one_time_base([held_log(rate, of=of)])

    rows = {row["signals"]: row for row in grid.streams}
    held = rows.pop(of)
    assert f" {RATE / rate:.4g} rows" in held["why"]
    assert held["rate_hz"] == pytest.approx(rate, rel=1e-4)
    assert held["firm"] == sure
    assert held["delay_s"] == pytest.approx(delay_s, abs=2e-5)
    assert not any(" rows" in row["why"] for row in rows.values())
    assert_recovers_the_joint(grid)


TAKEN_BEFORE = held_log(50.0, late=0.9)  # within the row before the first that has a value


def test_a_value_taken_within_the_row_before_lies_where_its_doubt_says():
    grid = one_time_base([TAKEN_BEFORE])

    with pytest.raises(AssertionError):
        assert_recovers_the_joint(grid)
    assert_recovers_the_joint(grid.with_other_reading())


def test_the_other_reading_of_a_held_channel_is_a_row_older_where_it_is_doubtful():
    other = one_time_base([held_log(50.0)]).with_other_reading()

    assert other.taken[0].stream.name == "torque"
    assert other.taken[0].delay == pytest.approx(1e-3, abs=2e-5)
    assert other.with_other_reading().taken[0].delay == pytest.approx(0, abs=2e-5)
    assert one_time_base([held_log(333.0)]).is_decided


def test_a_stated_delay_leaves_no_doubt_about_held_values():
    grid = one_time_base([replace(TAKEN_BEFORE, stated={"torque": {"delay": 1e-3}})])

    assert grid.is_decided
    assert_recovers_the_joint(grid)


@pytest.mark.parametrize(("rate", "long"), [(970.0, 0.0), (97.0, 7e-4)])
def test_a_held_signal_is_read_at_its_own_rate_whatever_the_rows_do(rate, long):
    """Of ten values nine are new; or some loops of the log are so long that it lies in wait for
    more than a usual one."""
    assert_recovers_the_joint(one_time_base([held_log(rate, long=long)]))


SLOW_SIGNALS = {
    "slow": lambda t: sines(t, (0.2,))[0],
    "rests": lambda t: stepped_sine(t) * (t > 6),
    "ramp": lambda t: 0.001 * t,
    "steps": lambda t: 0.1 * np.tanh(100 * np.sin(t)),
}


@pytest.mark.parametrize("bits", [10, 14])
@pytest.mark.parametrize("noise_steps", [0.0, 0.3])
@pytest.mark.parametrize("signal", SLOW_SIGNALS.values(), ids=SLOW_SIGNALS)
def test_a_coarse_slow_or_resting_signal_is_not_held(signal, noise_steps, bits):
    noise = noise_steps * 2 * np.pi / 2**bits
    values = noisy(signal(clock(RATE)), np.random.default_rng(bits), noise)

    assert held_values(rounded_to_bits(values, bits), step=1e-3) is None


def test_a_command_with_a_level_each_150_ms_is_not_held():
    levels = np.sin((clock(RATE) // 0.15) ** 2)

    assert held_values(levels, step=1e-3) is None


# ---- Missing samples


# Where the sample before a missing one waited, the gap is no long step.
@pytest.mark.parametrize(
    ("lost", "jitter", "late", "share_misplaced"),
    [
        (30, 0.0, 0.0, 0),
        (30, 1e-4, 0.0, 0),
        (30, 0.0, 1e-4, 5e-3),
        (3000, 0.0, 0.0, 0),
        (3000, 0.0, 1e-4, 3e-2),
    ],
)
def test_every_missing_sample_is_found_at_its_place(lost, jitter, late, share_misplaced):
    random = np.random.default_rng(lost)
    t = clock(1000.0, 60.0)
    inner = np.sort(random.choice(np.arange(200, len(t) - 200), len(t) - 400 - lost, replace=False))
    kept = np.r_[:200, inner, len(t) - 200 : len(t)]
    stamps = waits(t, late, random) if late else t + jitter * random.standard_normal(len(t))

    count = count_from_stamps(stamps[kept])

    assert np.mean(count != kept) <= share_misplaced


@pytest.mark.parametrize(("missing", "left_out"), [(20, []), (21, [20.0 - 0.2, 20.022 + 0.2])])
def test_a_gap_is_bridged_up_to_20_ms_and_left_out_beyond(missing, left_out):
    t = clock(1000.0)
    left = np.delete(t, np.arange(20_001, 20_001 + missing))

    grid = one_time_base([log(left, left, np.random.default_rng(40))])

    row = grid.streams[0]
    is_marked = bool(left_out)
    assert (row["bridged"], row["marked"], row["missing"]) == (not is_marked, is_marked, missing)
    assert len(grid.time) == len(t)
    unusable = grid.time[~grid.usable]
    assert unusable[[0, -1] if is_marked else []] == pytest.approx(left_out, abs=1.1e-3)
    assert len(unusable) == pytest.approx(423 * is_marked, abs=1)


@pytest.mark.parametrize(("empty", "marked"), [(20, 0), (21, 1)])
def test_rows_without_a_value_are_a_gap_of_their_channel(empty, marked):
    t = clock(1000.0)
    recording = log(t, t, np.random.default_rng(40))
    recording.signals["torque"][20_001 : 20_001 + empty] = np.nan

    _, row = one_time_base([recording]).streams

    assert (row["bridged"], row["marked"]) == (1 - marked, marked)


# ---- Refusals: channel, time, value, remedy


TICKS = clock(100.0, 60.0)
JUMP = r"no sample .*4\.9900 s .*3605\.0000 s.* 3600\.010 s.*`windows`"


def of(stamps, values=None, **fields):
    return Stream(
        "cell", stamps, {"torque": np.sin(stamps) if values is None else values}, **fields
    )


@pytest.mark.parametrize(
    ("stamps", "values", "counter", "says"),
    [
        *(
            (np.delete(np.where(TICKS < 5, TICKS, TICKS + 3600), lost), None, None, JUMP)
            for lost in ([], 100)
        ),
        (0 * TICKS + 3, None, None, r"time.*3\.000000 s.*6000"),
        (TICKS[:5], None, None, "torque has 5 values.*20"),
        (TICKS[:90], np.full(90, np.inf), None, r"torque.* inf .*row 0.* 0\.000000 s"),
        (TICKS[:90], np.full(90, np.nan), None, "torque.*0.*90.*20"),
        (TICKS[:20], None, np.minimum(np.arange(20), 6), r"counter.*6.*6.*0\.070000 s;"),
        (TICKS + 0.6 * (TICKS >= 5), None, np.arange(6000), r"no sample .*4\.9900 s .*5\.6000 s"),
        (
            clock(1000.0, 10.0)[np.arange(10_000) // 100 % 2 == 0],
            None,
            None,
            r"0\.0000 s.*9\.8990 s.*0\.20 s.*gap.*20 ms",
        ),
    ],
)
def test_refuses_a_recording_with_channel_time_value_and_remedy(stamps, values, counter, says):
    with refused_with(rf"cell:.*{says}"):
        one_time_base([of(stamps, values, counter=counter)])


def test_stamps_may_be_equal_and_never_go_back():
    check_time("log", np.array([7.0, 7.0, 8.0]))
    with refused_with("log:.*time"):
        check_time("log", np.array([7.0, 6.9]))


@pytest.mark.parametrize(("apart_s", "merged"), [(0.004, 1), (0.006, 0)])
def test_stamps_within_half_a_step_are_one(apart_s, merged):
    stamps = np.where(TICKS == 0.5, 0.49 + apart_s, TICKS)[:200]
    (part,) = take([of(stamps, reading=Reading(False, True, "stated"))])
    assert len(part.samples.times) == 200 - merged


def test_a_clock_that_is_slow_by_100_ppm_is_said_to_be():
    t = clock(1000.0, 5.0)
    slow = one_time_base(
        [of(t), Stream("slow", 1.0001 * t, {"a": t}), Stream("another rate", 1.0015 * t, {"b": t})]
    )
    assert [stream["ppm"] for stream in slow.streams] == pytest.approx([0, -100, None], abs=0.05)


@pytest.mark.parametrize(
    ("streams", "message"),
    [
        ([Stream("early", TICKS, {"a": TICKS}), of(TICKS + 70)], r"cell .*70\.0000 s .*59\.9900 s"),
        (two_nodes(np.random.default_rng(1), (0.0, 7e-3)), r"cell: .*\d+\.\d+ ms .*samples"),
    ],
)
def test_streams_apart_and_a_host_that_hides_its_rhythm_are_refused(streams, message):
    with refused_with(message):
        one_time_base(streams)


def test_what_comes_along_is_at_its_own_times_and_leaves_the_grid_as_it_is():
    t = clock(500.0, 9.0, first=0.5003)
    lost = np.delete(t, slice(1000, 2000))
    motor = Stream("motor", t, {"theta_m": np.sin(t)}, optional=["theta_m"])
    drive = Stream("drive", lost, {"current": lost}, optional=["current"])

    grid = one_time_base([of(TICKS), motor, drive])

    assert len(grid.time) == len(TICKS)
    inside = slice(60, 900)
    assert grid.signals["theta_m"][inside] == pytest.approx(np.sin(TICKS)[inside], abs=1e-9)
    assert "current" not in grid.signals


def test_a_gap_before_the_other_stream_begins_does_not_count():
    early = np.delete(TICKS, slice(200, 300))
    assert one_time_base([Stream("early", early, {"a": early}), of(TICKS + 5)]).usable.all()


@pytest.mark.parametrize(
    ("wait", "one_in", "rate"),
    [
        (2e-4, (0, 50), RATE),
        (2e-3, (300, 300), RATE),
        (1 / 150, (50, 50), 300.0),
    ],
)
def test_regular_losses_behind_a_late_host_are_refused(wait, one_in, rate):
    random = np.random.default_rng(one_in[1] + int(1e6 * wait))
    waiting = tuple(wait if every else 0.0 for every in one_in)
    nodes = two_nodes(random, waiting, one_in, (rate, rate))

    with refused_with(r"samples (are|seem to be) missing.*counter"):
        one_time_base(nodes)


@pytest.mark.parametrize(
    ("wait", "rates"),
    [
        ((0.0, 2e-3), (RATE, RATE)),
        ((5e-4, 1e-3), (333.0, 1000.0)),
        ((5e-4, 1e-3), (1024.0, 1000.0)),
    ],
)
def test_late_hosts_that_lose_nothing_are_right_at_any_rates(wait, rates):
    grid = one_time_base(two_nodes(np.random.default_rng(int(sum(rates))), wait, rates=rates))
    assert [stream["missing"] for stream in grid.streams] == [0, 0]
    assert (grid.streams[1]["stamps"], grid.streams[1]["firm"]) == ("even", True)
    assert_recovers_the_joint(grid)


def test_a_clock_that_was_set_while_the_device_counts_on_is_a_marked_gap():
    t = clock(RATE)
    was_set = t + 0.3 * (t > 12)

    grid = one_time_base(
        [replace(log(was_set, t, np.random.default_rng(4)), counter=np.arange(t.size))]
    )

    (row,) = grid.streams
    assert (row["stamps"], row["marked"]) == ("exact", 1)
    assert not grid.usable[(grid.time > 12) & (grid.time < 12.3)].any()


# ---- Values that are missing from rows that are there


@pytest.mark.parametrize("smallest", [8, 1])
def test_of_a_batch_the_last_sample_waited_least(smallest):
    """Batches of up to 8 samples, which have the stamp of their last one."""
    random = np.random.default_rng(3)
    t = clock(RATE)
    last = np.minimum(np.cumsum(random.integers(smallest, 9, len(t))) - 1, len(t) - 1)
    batch = np.searchsorted(last, np.arange(len(t)))
    stamps = t[last[batch]] + 3e-4 * random.random(len(t))[batch]

    grid = one_time_base([joint(t, t), cell(stamps, t, random)])

    assert grid.streams[1]["stamps"] == "even"
    assert_recovers_the_joint(grid)


def test_samples_of_a_batch_that_was_stamped_at_once_are_counted_one_by_one():
    rows = np.arange(2000)
    stamps = rows // 10 * 0.01 + rows % 10 * 1e-9

    assert np.array_equal(count_from_stamps(stamps), rows)


@pytest.mark.parametrize("jitter", [0.0, 2e-5])
def test_values_that_are_missing_cost_nothing_and_split_no_device(jitter):
    """One percent of each signal."""
    random = np.random.default_rng(7)
    t = clock(RATE)
    stamps = jittered(t, jitter, random) if jitter else t
    recorded = log(stamps, stamps, random)
    for values in recorded.signals.values():
        values[random.random(len(values)) < 0.01] = np.nan

    grid = one_time_base([recorded])

    assert {row["stamps"] for row in grid.streams} == {"exact" if jitter else "even"}
    assert_recovers_the_joint(grid)


def test_latency_of_a_part_of_a_step_is_taken_off_where_it_is_constant():
    """Messages wait 0.05 steps on average, and some hardly: samples are as early as these."""
    count = np.arange(2000)
    stamps = 0.01 * count + np.random.default_rng(4).exponential(0.0005, 2000)

    times = DeviceClock(stamps, count).times()

    assert np.abs(times - 0.01 * count).max() < 0.0001


@pytest.mark.parametrize(("frequency_hz", "share", "tolerance"), [
    (5.0, 1.0, 3e-6), (30.0, 0.5, 1e-3),
])  # fmt: skip
def test_the_inertia_of_a_fixture_is_seen_up_to_twice_the_cut_off(frequency_hz, share, tolerance):
    """A motion at a third of the fit's 15 Hz loses nothing; at 30 Hz noise has a half."""
    t = clock(1000.0, 10.0)
    w = 2 * np.pi * frequency_hz
    theta = 0.01 * np.sin(w * t)

    torque = fixture_torque(t, theta, cutoff_hz=15.0, inertia=0.02, weight=0.0)

    expected = -0.02 * w**2 * share * theta
    inside = slice(1000, -1000)
    assert torque[inside] == pytest.approx(expected[inside], abs=tolerance * expected.max())
