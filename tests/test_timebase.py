"""One time base: stamps of real recorders, the truth written by hand, the joint's K, B, I at the
end."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from itertools import product

import numpy as np
import polars as pl
import pytest
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, sosfiltfilt

from osl_analysis.errors import InputError
from osl_analysis.signals.clock_drift import drift_row
from osl_analysis.signals.device_clock import DeviceClock, savitzky_golay
from osl_analysis.signals.grid import GapLimits, UniformSignals, on_one_grid, streams
from osl_analysis.signals.held_values import held_values
from osl_analysis.signals.sample_count import count_from_stamps, missing_by_rhythm
from osl_analysis.signals.samples import take
from osl_analysis.signals.stamp_evidence import StampEvidence
from osl_analysis.signals.stamp_reading import reading_of
from osl_analysis.signals.stream import Stream
from osl_analysis.trial import Trial, check_time, counter_column


def one_time_base(streams: list[Stream]) -> UniformSignals:
    return on_one_grid(take(streams), GapLimits())


JOINT, SIZE = np.array([300.0, 5.0, 0.02]), np.deg2rad(4.0)
DURATION, RATE = 24.0, 1000.0

# ---- The laboratory: motions with derivatives written by hand, recorders, a plain fit. It shares
# no code with ours.


def sines(t, frequencies=(0.5, 0.9, 1.3, 1.9, 2.3, 3.1), size=SIZE / 3):
    w = 2 * np.pi * np.asarray(frequencies)[:, None]
    p = w * t + np.arange(len(frequencies))[:, None] ** 2
    return tuple(size * x.sum(axis=0) for x in (np.sin(p), w * np.cos(p), -(w**2) * np.sin(p)))


def stepped_sine(t):
    step = np.minimum(t // 6, 4).astype(int)
    w = 2 * np.pi * np.array([0.5, 1.0, 2.0, 3.0, 1.0])[step]
    return SIZE * np.array([1.0, 0.5, 1.0, 0.7, 1.0])[step] * np.sin(w * (t - 6 * step))


def rounded_to_bits(x, bits):
    lsb = 2 * np.pi / 2**bits
    return np.round(x / lsb) * lsb


def clock(rate, duration=DURATION, first=0.0):
    return first + np.arange(int(duration * rate)) / rate


def joint(stamps, taken, **choice):
    return Stream("encoder", stamps, {"theta": rounded_to_bits(sines(taken)[0], 18)}, **choice)


def cell(stamps, taken, random, **choice):
    return Stream(
        "load cell", stamps, {"torque": noisy(JOINT @ np.stack(sines(taken)), random)}, **choice
    )


def log(stamps, taken, random):
    return Stream("log", stamps, joint(stamps, taken).signals | cell(stamps, taken, random).signals)


def noisy(x, random, sd=0.05):
    return x + sd * random.standard_normal(len(x))


def jittered(t, sd, random):
    return np.sort(t + sd * random.standard_normal(len(t)))


def waits(t, mean, random):
    """A host that is late by an exponential wait and hands messages on in order, none twice."""
    return (
        np.maximum.accumulate(t + random.exponential(mean, len(t))) if mean else t
    ) + 1e-9 * np.arange(len(t))


def assert_recovers_the_joint(grid):
    """K, B, I of least squares behind a 15 Hz filter, on the usable rows, as close as a laboratory
    wants them."""
    sections = butter(4, min(15.0, 0.4 * grid.rate_hz), fs=grid.rate_hz, output="sos")
    theta, torque = (
        sosfiltfilt(sections, grid.signals[n], padlen=int(grid.rate_hz / 5))
        for n in ("theta", "torque")
    )
    spline = make_interp_spline(grid.time, theta, k=5)
    rows = grid.usable & (grid.time > grid.time[0] + 0.2) & (grid.time < grid.time[-1] - 0.2)
    columns = np.stack(
        [theta, spline(grid.time, 1), spline(grid.time, 2), np.ones_like(theta)], axis=1
    )
    errors = 100 * (np.linalg.lstsq(columns[rows], torque[rows], rcond=None)[0][:3] / JOINT - 1)
    assert (np.abs(errors) < [0.1, 0.5, 3.0]).all(), errors


@pytest.mark.parametrize(("rate", "largest"), [(100.0, 2.6e-5), (300.0, 3.2e-7), (1000.0, 2.6e-9)])
def test_a_5_hz_sine_comes_to_the_grid_with_the_error_that_the_report_states(rate, largest):
    t = clock(rate, 10.0)
    wave = Stream("wave", t, {"wave": np.sin(10 * np.pi * t)})
    grid = one_time_base([wave, Stream("other", t + 0.5 / rate, {"other": t})])
    error = np.max(np.abs(grid.signals["wave"] - np.sin(10 * np.pi * grid.time))[20:-20])
    assert (error, grid.streams[0]["error"]) == (
        pytest.approx(largest, rel=0.05),
        pytest.approx(largest, rel=0.06),
    )
    assert grid.farthest_s == pytest.approx(0.5 / rate)


# ---- Are the stamps true?


MOTIONS: dict[str, Callable] = {
    "multisine": lambda t: sines(t)[0], "sine": lambda t: sines(t, (1.3,), SIZE)[0],
    "stepped": stepped_sine,
    "ramp": lambda t: 0.05 * t,
}  # fmt: skip


@pytest.mark.parametrize("motion", MOTIONS)
def test_no_case_is_decided_wrongly_over_bits_jitter_and_lateness(motion):
    random, firm = np.random.default_rng(len(motion)), 0
    for bits, jitter, late, even in product(
        (12, 18), (1e-5, 1e-4, 3e-4), (False, True), (False, True)
    ):
        t = clock(1000.0, 12.0)
        stamps = (waits if late else jittered)(t, jitter, random)
        (part,) = take(
            [
                Stream(
                    "x",
                    stamps,
                    {"x": rounded_to_bits(MOTIONS[motion](t if even else stamps), bits)},
                )
            ]
        )
        if part.firm:
            firm += 1
            assert (part.even, abs(part.age) < 0.15) == (even, True), (bits, jitter, late, part.why)
    assert firm >= 8


def test_a_python_loop_with_absolute_targets_is_late_and_never_early_and_yet_its_stamps_are_true():
    """Late by 0.1 ms or so, sometimes by 4 ms; then it catches up."""
    random, t = np.random.default_rng(4), clock(500.0)
    late = 1.5e-4 * np.abs(random.standard_normal(len(t)))
    late[random.integers(100, len(t), 15)] += random.uniform(1e-3, 4e-3, 15)
    stamps = np.maximum.accumulate(t + late) + 1e-9 * np.arange(len(t))
    grid = one_time_base([log(stamps, stamps, random)])
    (said,) = grid.streams
    assert (said["stamps"], said["firm"], said["skew"] > 3, said["merged"] > 5) == (
        "exact",
        True,
        True,
        True,
    )
    assert said["g"] == pytest.approx(1.0, abs=4 * said["g_se"])
    assert_recovers_the_joint(grid)


def test_channels_firmly_true_and_firmly_even_are_taken_apart():
    t, random = clock(1000.0), np.random.default_rng(6)
    stamps = jittered(t, 2e-4, random)
    grid = one_time_base(
        [Stream("log", stamps, joint(t, t).signals | cell(stamps, stamps, random).signals)]
    )
    assert {s["signals"]: s["stamps"] for s in grid.streams} == {"torque": "exact", "theta": "even"}
    assert [part.stream.name for part in grid.taken] == ["log [torque]", "log [theta]"]
    assert_recovers_the_joint(grid)


def test_a_resting_or_slow_signal_decides_nothing_jitter_is_then_not_believed():
    t, random = clock(500.0, 60.0), np.random.default_rng(7)
    stamps, rest = jittered(t, 2e-4, random), noisy(0 * t, random)
    slow = rounded_to_bits(0.05 * np.sin(0.2 * np.pi * t), 14)
    grid = one_time_base([Stream("belt", stamps, {"angle": slow, "rest": rest})])
    (said,) = grid.streams
    assert (said["stamps"], said["firm"], said["missing"]) == ("even", False, 0)
    assert said["why"].startswith("undecided, even: the residual wanders by 0.0")
    assert grid.signals["angle"] == pytest.approx(slow, abs=1e-12)
    assert "rest" not in grid.taken[0].evidence  # its slope is noise
    (dead,) = one_time_base([Stream("dead", stamps, {"zero": 0 * t})]).streams
    assert (dead["g"], dead["g_se"], dead["firm"]) == (None, None, False)
    (wander,) = one_time_base(
        [Stream("rest", t + 0.02 * np.sin(2 * np.pi * t / 30), {"x": rest})]
    ).streams
    assert (wander["stamps"], wander["firm"]) == ("exact", False)


def recorded(seed, kind, age=0.0, *, rate=1000.0, jitter=1e-4, changes=0.0, decimals=9, lost=0.0):
    """A log of 24 s of the joint: host latency on an even device, or stamps of loops, of which the
    values are `age` loops older; from the middle on the loops are faster by `changes`. And when its
    rows were sampled."""
    random, n = np.random.default_rng(seed), int(24 * rate)
    loops = np.arange(n + 1, dtype=float)
    even = np.where(loops < n / 2, loops, n / 2 + (loops - n / 2) / (1 + changes)) / rate
    stamps = waits(even, jitter, random) if kind == "even" else jittered(even, jitter, random)
    taken = even if kind == "even" else np.interp(loops - age, loops, stamps)
    kept = (random.random(n + 1) >= lost) | (loops < 30) | (loops > n - 30)
    one = log(np.round(stamps, decimals)[kept], taken[kept], random)
    return one, taken[kept]


@pytest.mark.parametrize(
    ("kind", "age"), [("even", 0.0), ("true", 0.0), ("true", 0.5), ("true", 1.0)]
)
@pytest.mark.parametrize("case", [
    {}, {"changes": 0.05}, {"changes": 0.2, "rate": 333.0, "lost": 1e-3}, {"decimals": 4},
    {"rate": 200.0, "jitter": 1e-3},
    # one is lost at the change
    *({"changes": 0.2, "rate": 333.0, "lost": 1e-3, "seed": seed} for seed in (107, 203)),
])  # fmt: skip
def test_even_devices_true_stamps_and_values_of_an_age_are_told_apart_also_where_the_rate_changes(
    kind, age, case
):
    one, taken = recorded(**{"seed": len(str(case)), "kind": kind, "age": age} | case)
    (part,) = take([one])
    assert part.firm, part.why
    assert (part.even, part.age) == (kind == "even", pytest.approx(age, abs=0.11))
    late = (part.times - taken) * case.get("rate", RATE)
    assert np.std(late[50:-50]) < 0.06 + 1.5 * age * case.get("changes", 0.0)
    assert_recovers_the_joint(on_one_grid([part], GapLimits()))


def test_stamps_that_fit_no_hypothesis_are_kept_and_not_firm():
    """Half of the host's scatter is in the samples: no device does that."""
    random, t = np.random.default_rng(5), clock(1000.0)
    stamps = jittered(t, 1e-4, random)
    (part,) = take([log(stamps, (t + stamps) / 2, random)])
    assert (part.firm, part.even, part.why.startswith("undecided, true: neither")) == (
        False,
        False,
        True,
    )


def binary_steps(t, seed):
    """Angle, velocity, acceleration of steps of minimum jerk between two angles, 30 ms long, 0.1 to
    0.5 s apart."""
    starts = np.cumsum(np.random.default_rng(seed).uniform(0.1, 0.5, int(t[-1] / 0.3) - 5))
    last = np.maximum(np.searchsorted(starts, t) - 1, 0)
    x, way = np.clip((t - starts[last]) / 0.03, 0, 1), np.where(last % 2, -SIZE, SIZE)
    angle = 10 * x**3 - 15 * x**4 + 6 * x**5 - 0.5
    return np.stack([
        way * angle, way * 30 * (x * (1 - x)) ** 2 / 0.03,
        way * 60 * x * (1 - x) * (1 - 2 * x) / 0.03**2,
    ])  # fmt: skip


@pytest.mark.parametrize("seed", range(3))
def test_an_encoder_that_stands_between_steps_is_no_evidence_of_an_even_device(seed):
    random = np.random.default_rng(seed)
    stamps = jittered(clock(1000.0), 5e-5, random)
    motion = binary_steps(stamps, seed)
    signals = {"theta": rounded_to_bits(motion[0], 18), "torque": noisy(JOINT @ motion, random)}
    (part,) = take([Stream("log", stamps, signals)])
    assert (part.even, part.age, part.firm) == (False, 0.0, True), part.why
    # steps of 30 ms are no polynomials
    assert part.evidence["theta"].g == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize(
    ("response", "se"), [((0.3, 0.7, 0.0, 0.0), 0.01), ((0.05, 0.95, -0.3, -0.45), 0.14)]
)
def test_no_value_is_younger_than_its_stamp_and_a_share_within_its_error_of_the_rival_s_is_not_firm(
    response, se
):
    """Rows of LAGS from -1 on: 0.3 loops after the stamp, and g = 0.25 +- 0.28, which is 0 of an
    even device, too."""
    evidence = StampEvidence(np.array(response), se**2 * np.eye(4))
    stamps = jittered(clock(1000.0), 5e-5, np.random.default_rng(1))
    reading = reading_of(DeviceClock(stamps, np.arange(len(stamps))), {"torque": evidence})
    assert (reading.even, reading.age, reading.firm) == (False, 0.0, False), reading.why


@pytest.mark.parametrize("mean_wait", [2e-2, 5e-2])
def test_a_host_of_long_waits_is_counted_in_seconds(mean_wait):
    """Most of its stamps are those of a cluster; the time taken is the claim."""
    t = clock(RATE)
    count = count_from_stamps(waits(t, mean_wait, np.random.default_rng(1)))
    assert count[-1] < 1.2 * len(t)


# ---- Channels whose source is slower than the log


def held_log(rate, late=0.0, of="torque", bits=14):
    """A log at 1 kHz in which one signal stands for several rows: its newest value, `late` rows
    after it was taken."""
    t, random = clock(RATE), np.random.default_rng(int(rate))
    newest = np.floor((t - late / RATE) * rate + 1e-6).astype(int)
    own = np.arange(newest[0], newest[-1] + 1) / rate
    one, there = log(t, t, random), newest - newest[0]
    values = {
        "theta": rounded_to_bits(sines(own)[0], bits),
        "torque": noisy(JOINT @ np.stack(sines(own)), random),
    }
    one.signals[of][:] = values[of][there]
    return one


@pytest.mark.parametrize("of", ["theta", "torque"])
@pytest.mark.parametrize(
    ("rate", "sure"),
    [(333.0, True), (101.0, True), (1000 / 3, False), (50.0, False), (500.0, False)],
)
def test_a_held_channel_is_read_at_its_own_rate_and_doubtful_where_the_rates_do_not_beat(
    of, rate, sure
):
    grid = one_time_base([held_log(rate, of=of)])
    said = {stream["signals"]: stream for stream in grid.streams}
    assert said[of]["held"] == pytest.approx(RATE / rate, rel=1e-3)
    assert (said[of]["rate_hz"], said[of]["firm"]) == (pytest.approx(rate, rel=1e-4), sure)
    assert said[of]["delay_s"] == pytest.approx(5e-4 * sure, abs=2e-5)
    assert [one["held"] for name, one in said.items() if name != of] == [None]
    assert_recovers_the_joint(grid)
    other = grid.other()
    if sure:
        assert other is None
    else:  # all values one row older
        assert other.of(of).delay == pytest.approx(1e-3, abs=2e-5)
        assert other.other().of(of).delay == pytest.approx(0, abs=2e-5)


def test_a_held_value_that_was_taken_within_the_row_before_lies_where_its_doubt_says():
    grid = one_time_base([held_log(50.0, late=0.9)])
    with pytest.raises(AssertionError):
        assert_recovers_the_joint(grid)
    assert_recovers_the_joint(grid.other())
    stated = one_time_base([replace(held_log(50.0, late=0.9), delays={"torque": 1e-3})])
    assert_recovers_the_joint(stated)
    assert stated.other() is None
    assert_recovers_the_joint(one_time_base([held_log(970.0)]))  # of ten values nine are new


def test_a_held_value_of_an_uneven_source_is_half_a_row_older_than_the_first_row_that_has_it():
    random, one = np.random.default_rng(2), held_log(97.0)
    t, own = clock(RATE), clock(97.0, DURATION + 0.1)
    own += np.clip(np.cumsum(random.normal(0, 3e-4, own.size)), -4e-3, 4e-3)
    newest = np.maximum(np.searchsorted(own, t, "right") - 1, 0)
    one.signals["torque"][:] = noisy(JOINT @ np.stack(sines(own)), random)[newest]
    grid = one_time_base([one])
    (said,) = (stream for stream in grid.streams if stream["signals"] == "torque")
    assert (said["firm"], said["delay_s"]) == (False, pytest.approx(5e-4, abs=2e-6))
    assert_recovers_the_joint(grid)


def test_held_values_have_one_entry_for_each_value_of_the_source_at_its_first_row():
    """A source at a quarter of the rate. The log begins within its first value, which does not
    count; two of its values equal the ones before."""
    own = np.random.default_rng(1).standard_normal(200)
    own[2] = own[1]
    own[50] = own[49]
    log_of_source = np.repeat(own, 4)[2:]

    held = held_values(log_of_source, 1e-3)

    assert held.period == pytest.approx(4)
    np.testing.assert_array_equal(held.values, own[1:])
    np.testing.assert_allclose(held.rows, np.arange(2, 798, 4), atol=1e-9)


@pytest.mark.parametrize("bits", [10, 14])
def test_a_coarse_slow_or_resting_signal_is_not_held(bits):
    t = clock(RATE)
    for signal in (
        sines(t, (0.2,))[0],
        stepped_sine(t) * (t > 6),
        0.001 * t,
        0.1 * np.tanh(100 * np.sin(t)),
    ):
        for noise in (0.0, 0.3, 1.0):
            lsb = 2 * np.pi / 2**bits
            values = rounded_to_bits(noisy(signal, np.random.default_rng(bits), noise * lsb), bits)
            assert held_values(values, 1e-3) is None


SHARE_MISPLACED = {(False, False): 0, (False, True): 5e-5, (True, False): 5e-3, (True, True): 1e-2}
"""By lateness and by a loss of 5 %: where the sample before a missing one waited, the gap is no
long step."""


@pytest.mark.parametrize(("jitter", "late"), [(0.0, 0.0), (2e-5, 0.0), (1e-4, 0.0), (0.0, 1e-4)])
@pytest.mark.parametrize("lost", [1, 30, 600, 3000])
def test_every_missing_sample_is_found_at_its_place(lost, jitter, late):
    random, t = np.random.default_rng(lost), clock(1000.0, 60.0)
    inner = np.sort(random.choice(np.arange(200, len(t) - 200), len(t) - 400 - lost, replace=False))
    kept = np.r_[:200, inner, len(t) - 200 : len(t)]
    stamps = (waits(t, late, random) if late else t + jitter * random.standard_normal(len(t)))[kept]
    assert np.mean(count_from_stamps(stamps) != kept) <= SHARE_MISPLACED[late > 0, lost == 3000]


@pytest.mark.parametrize("jitter", [0.0, 2e-5])
def test_missing_samples_cost_nothing(jitter):
    t, random = clock(1000.0), np.random.default_rng(31)
    kept = np.sort(random.choice(len(t), len(t) - 240, replace=False))
    stamps = np.sort(t + jitter * random.standard_normal(len(t)))[kept]
    grid = one_time_base([log(stamps, stamps, random)])
    (said,) = grid.streams
    assert said["missing"] == kept[-1] - kept[0] + 1 - len(kept)
    assert 200 < said["bridged"] <= 240
    found = said["firm"], said["stamps"], said["marked"], grid.usable.all()
    assert found == (True, "exact" if jitter else "even", 0, True)
    assert_recovers_the_joint(grid)


@pytest.mark.parametrize(("missing", "marked"), [(20, 0), (21, 1)])
def test_a_gap_of_20_samples_is_data_and_a_longer_one_marked_with_three_periods_of_the_filter(
    missing, marked
):
    t, random = clock(1000.0), np.random.default_rng(40)
    gone = np.arange(20_001, 20_001 + missing)
    grid = one_time_base([log(np.delete(t, gone), np.delete(t, gone), random)])
    said, left_out = grid.streams[0], grid.time[~grid.usable]
    assert (said["bridged"], said["marked"], said["missing"]) == (1 - marked, marked, missing)
    assert (len(grid.time), grid.farthest_s) == (
        len(t),
        pytest.approx(0.01 * (1 - marked), abs=1e-9),
    )
    if marked:
        assert left_out[[0, -1]] == pytest.approx([20.0 - 0.2, 20.022 + 0.2], abs=1.1e-3)
        assert len(left_out) == pytest.approx(423, abs=1)
    else:
        assert grid.usable.all()
        assert said["bridge_error"] == pytest.approx(4.93e-4, rel=0.02)
    lacking = log(t, t, random)  # rows that are there, without a value
    lacking.signals["torque"][gone] = np.nan
    _, said = one_time_base([lacking]).streams
    assert (said["empty"], said["bridged"], said["marked"]) == (missing, 1 - marked, marked)


# ---- Refusals: channel, time, value, remedy


TICKS, PIECES = clock(100.0, 60.0), clock(1000.0, 10.0)[np.arange(10_000) // 100 % 2 == 0]
JUMP = (
    r"torque has no sample from 4\.9900 s to 3605\.0000 s, 3600\.010 s long; .*cut the log"
    r" there.*jumped"
)
WAS_SET = r"clock jumps by 0\.5 s at 5\.5.* s, row 500, while .* cut"


def of(stamps, values=None, **fields):
    return Stream(
        "cell", stamps, {"torque": np.sin(stamps) if values is None else values}, **fields
    )


@pytest.mark.parametrize(("stamps", "values", "counter", "says"), [
    *((np.delete(np.where(TICKS < 5, TICKS, TICKS + 3600), lost), None, None, JUMP) for lost in ([],
    100)),
    (0 * TICKS + 3, None, None, r"time stands still at 3\.000000 s for 6000 samples; take another"),
    (TICKS[:5], None, None, r"5 samples are too few .* at least 20"),
    (TICKS[:90], np.full(90, np.inf), None,
     r"torque is inf at row 0, after 0\.000000 s; 90 of 90 .*: repair"),
    (TICKS[:90], np.full(90, np.nan), None,
     r"torque has 0 values in 90 rows; at least 20 are needed"),
    (TICKS[:20], None, np.minimum(np.arange(20), 6),
     r"counter goes from 6 to 6 at 0\.070000 s; it must rise"),
    (TICKS + 0.5 * (TICKS >= 5), None, np.arange(6000), WAS_SET),
    (TICKS, None, np.arange(6000) + 50 * (TICKS >= 5),
     r"clock jumps by -0\.49 s at 5\.0* s, row 500, while .* cut"),
    (PIECES, None, None,
     r"every row from 0\.0000 s to 9\.8990 s lies within 0\.20 s of a gap longer than 20 ms"),
    (np.arange(20_000) // 100 / 10, np.sin(np.arange(20_000) / 99), None,
     "stamps are rounded, 100 rows share one"),
])  # fmt: skip
def test_refuses_a_recording_with_channel_time_value_and_remedy(stamps, values, counter, says):
    with pytest.raises(InputError, match=f"cell: .*{says}"):
        one_time_base([of(stamps, values, counter=counter)])


@pytest.mark.parametrize(("time", "refused"), [
    ([0, 2e-9], False), ([0, 5e-10], True), ([0, 5e19], False), ([0, 2e20], True),
    ([7, 7, 8], False), ([7, 6.9], True),
])  # fmt: skip
def test_stamps_that_no_clock_tells_or_that_go_back_are_refused_and_equal_ones_are_not(
    time, refused
):
    with pytest.raises(InputError, match="log: time ") if refused else nullcontext():
        check_time("log", np.array(time, float))


@pytest.mark.parametrize(("time", "remedy"), [
    ([0.0, 0.1, 0.2, 0.1, 0.2, 0.3], "its stamps stand there already: delete rows"),
    ([0.0, 0.1, 0.3, 0.2, 0.4, 0.5], "rows changed places: sort them by time"),
    ([0.0, 0.1, 0.2, 0.11, 0.21, 0.31], "the recorder's clock was set back: cut the log there"),
])  # fmt: skip
def test_stamps_that_go_back_are_told_by_what_happened_to_the_rows(time, remedy):
    with pytest.raises(InputError, match=remedy):
        check_time("log", np.array(time))


def test_a_row_that_was_written_twice_counts_once_and_stamps_within_half_a_step_are_one():
    twice, values = (
        np.repeat(np.arange(30), np.where(np.arange(30) == 7, 2, 1)),
        np.where(TICKS == 0.07, np.nan, TICKS),
    )
    assert of(
        TICKS[twice], values[twice], counter=twice
    ).without_repeats().counter.tolist() == list(range(30))
    near = [np.where(TICKS == 0.5, 0.49 + apart, TICKS)[:200] for apart in (0.004, 0.006)]
    assert [take([of(stamps, choice="exact")])[0].samples[2] for stamps in near] == [1, 0]


def test_a_clock_that_is_slow_by_a_tenth_of_a_thousandth_is_said_to_be():
    t = clock(1000.0, 5.0)
    slow = one_time_base(
        [of(t), Stream("slow", 1.0001 * t, {"a": t}), Stream("another rate", 1.01 * t, {"b": t})]
    )
    assert [stream["ppm"] for stream in slow.streams] == pytest.approx([0, -100, None], abs=0.05)


def test_refuses_streams_that_do_not_overlap_or_whose_host_is_so_late_that_it_hides_its_rhythm():
    for seed, (wait, one_in) in enumerate(((5e-3, (0, 50)), (7e-3, (0, 0)), (1e-2, (0, 50)))):
        with pytest.raises(
            InputError,
            match=r"cell: .* late by \d+\.\d+ ms \(SD\), too late to see whether some of ",
        ):
            one_time_base(two_nodes(np.random.default_rng(seed), (0.0, wait), one_in))
    with pytest.raises(
        InputError,
        match=r"cell begins at 70\.0000 s and early ends at 59\.9900 s: they overlap in 0",
    ):
        one_time_base([Stream("early", TICKS, {"a": TICKS}), of(TICKS + 70)])
    early = np.delete(TICKS, slice(200, 300))  # a gap before the other begins does not count
    assert one_time_base([Stream("early", early, {"a": early}), of(TICKS + 5)]).usable.all()


def test_drift_is_refused_beyond_what_damping_and_inertia_bear_if_it_is_certain():
    """From a Student quantile on that is as rare as four exact standard errors: t.isf(3.167e-5, 5)
    = 12.28."""
    assert [drift_row(d, 1.0, 5.0, 20.0)["certain_clock_drift_ppm"] for d in (12.5, 12.0)] == [
        12.5,
        0.0,
    ]
    drift_row(1.9, 0.01, np.inf, 2.0)
    drift_row(-5.0, 4.0, np.inf, 2.0)
    with pytest.raises(
        InputError, match=r"drift apart by -2\.10 \+- 0\.10 ppm, more than 2: .*synchronise"
    ):
        drift_row(-2.1, 0.1, np.inf, 2.0)


def two_nodes(random, wait=(0.0, 0.0), one_in=(0, 0), rates=(RATE, RATE)):
    """Angle and torque, 0.3 ms apart: per node the mean wait [s], the rate, and one in how many (+-
    3) is lost."""
    made = []
    for node, first in ((0, 0.0), (1, 3e-4)):
        t, often = clock(rates[node], first=first), one_in[node]
        places = (
            np.cumsum(random.integers(often - 3, often + 4, len(t) // often + 1))
            if often
            else np.empty(0, int)
        )
        kept = np.setdiff1d(np.arange(len(t)), places[places < len(t) - 1])
        stamps = waits(t, wait[node], random)[kept]
        made.append(joint(stamps, t[kept]) if node == 0 else cell(stamps, t[kept], random))
    return made


@pytest.mark.parametrize(
    ("wait", "one_in"), [(2e-4, (0, 50)), (5e-4, (100, 0)), (2e-3, (300, 300)), (5e-4, (0, 5000))]
)
def test_regular_losses_behind_a_late_host_are_refused(wait, one_in):
    random, waiting = (
        np.random.default_rng(one_in[1] + int(1e6 * wait)),
        tuple(wait if n else 0.0 for n in one_in),
    )
    true = DURATION * RATE / max(one_in)
    with pytest.raises(
        InputError, match=r"about \d+ samples are missing.* nothing tells which.* counter"
    ) as refused:
        one_time_base(two_nodes(random, waiting, one_in))
    assert int(str(refused.value).split("about ")[1].split()[0]) == pytest.approx(
        true, rel=0.05, abs=1.1
    )


def test_a_host_too_late_to_tell_another_rate_from_losses_is_refused_and_a_prompt_one_tells_them():
    late = (
        r"cell: .* late by 5\.\d\d ms \(SD\), too late to see whether some of its 989\.\d\d samples"
        r" per second are"
    )
    with pytest.raises(InputError, match=late):
        one_time_base(two_nodes(np.random.default_rng(3), (0.0, 5e-3), rates=(RATE, 990.0)))
    count = np.delete(np.arange(40), [9, 17, 18])
    # a slope across gaps
    assert savitzky_golay(2.0 * count + 1, count, 9, 1) == pytest.approx(np.full(37, 2.0))
    # of which no, one and two samples are missing; and one that is too short to tell
    t = clock(100.0, 20.0, 7.0)
    assert [
        missing_by_rhythm(one) for one in (t, np.delete(t, 9), np.delete(t, [9, 700]), t[:900])
    ] == [0, 1, 2, None]


@pytest.mark.parametrize(("wait", "rates"), [
    ((0.0, 2e-4), (RATE, RATE)), ((0.0, 2e-3), (RATE, RATE)), ((5e-4, 1e-3), (333.0, 1000.0)),
    ((5e-4, 1e-3), (1024.0, 1000.0)), ((5e-4, 1e-3), (990.0, 990.0)),
])  # fmt: skip
def test_late_hosts_that_lose_nothing_are_right_at_any_rates_and_their_mean_wait_is_taken_away(
    wait, rates
):
    grid = one_time_base(two_nodes(np.random.default_rng(int(sum(rates))), wait, rates=rates))
    assert [stream["missing"] for stream in grid.streams] == [0, 0]
    assert (grid.streams[1]["stamps"], grid.streams[1]["firm"]) == ("even", True)
    assert_recovers_the_joint(grid)


# ---- Values that are missing from rows that are there


@pytest.mark.parametrize("first", [False, True])
@pytest.mark.parametrize(("within", "jitter"), [(0.0, 3e-4), (3e-4, 1e-6)])
@pytest.mark.parametrize("sizes", [(2, 2), (8, 8), (1, 6)])
def test_stamps_of_batches_are_firm_only_where_their_sizes_tell_which_sample_is_prompt(
    sizes, jitter, within, first
):
    """The last or the first sample, all with its stamp or later as rows are written. A log of both
    is as right."""
    random, t = np.random.default_rng(3), clock(RATE)
    last = np.minimum(np.cumsum(random.integers(sizes[0], sizes[1] + 1, len(t))) - 1, len(t) - 1)
    batch = np.searchsorted(last, np.arange(len(t)))
    begin = np.append(0, last + 1)[batch]
    stamps = t[begin if first else last[batch]] + jitter * random.random(len(t))[batch]
    stamps = np.maximum.accumulate(
        stamps + within * (np.arange(len(t)) - begin)
    ) + 1e-9 * np.arange(len(t))
    grid, alone = (
        one_time_base([joint(t, t), cell(stamps, t, random)]),
        one_time_base([log(stamps, t, random)]),
    )
    assert grid.streams[1]["firm"] == (sizes[0] < sizes[1] and not within and not first)
    assert (
        "state `stamps: even`, with a `delay`" in grid.streams[1]["why"] or grid.streams[1]["firm"]
    )
    read = grid.other() if first else grid
    if sizes != (1, 6) or not (first or within):
        assert_recovers_the_joint(read)
    for one in (alone, alone.other() or alone):
        assert_recovers_the_joint(one)


def test_a_clock_that_ticks_slower_than_the_samples_stamps_no_batches():
    """Its stamps are early, and not late."""
    stamps = np.floor(clock(RATE) * 300) / 300
    assert DeviceClock(stamps, np.arange(len(stamps))).batches is None


@pytest.mark.parametrize("lower", [False, True])
@pytest.mark.parametrize("kind", ["even", "jitter", "latency"])
def test_values_that_are_missing_cost_nothing_and_split_no_device(kind, lower):
    """One percent of each signal, or two of three torques: a signal of a lower rate."""
    random, t = np.random.default_rng(7), clock(RATE)
    scattered = jittered(t, 2e-5, random)
    stamps, taken = {
        "even": (t, t),
        "jitter": (scattered, scattered),
        "latency": (waits(t, 5e-4, random), t),
    }[kind]
    recorded = log(stamps, taken, random)
    for name, values in recorded.signals.items():
        if lower:
            values[(np.arange(len(values)) % 3 > 0) & (name == "torque")] = np.nan
        else:
            values[random.random(len(values)) < 0.01] = np.nan
    grid = one_time_base([recorded])
    angle, torque = grid.streams
    lacking = [int(np.isnan(values).sum()) for values in recorded.signals.values()]
    assert [angle["empty"], torque["empty"]] == ([0, 0] if lower else lacking)
    assert torque["error"] == pytest.approx(
        81 * angle["error"] if lower else angle["error"], rel=1e-4
    )
    assert {angle["stamps"], torque["stamps"]} == {"exact" if kind == "jitter" else "even"}
    assert_recovers_the_joint(grid)


# ---- The cache of a trial


def test_each_device_of_a_trial_keeps_its_own_clock_and_one_with_a_counter_that_of_the_counter():
    t, later = clock(100, 10), clock(70, 10, first=0.0031)
    counted = pl.DataFrame(
        {"time": t, "theta": np.sin(t), counter_column("theta"): 2 * np.arange(t.size), "torque": t}
    )
    both = pl.concat(
        [counted, pl.DataFrame({"time": later, "current": later})], how="diagonal"
    ).sort("time")
    trial = Trial("two devices", both)
    for _ in range(2):  # as found, and as kept
        found = {
            name: take(streams(trial, [[name]]))[0].clock.step
            for name in ("theta", "torque", "current")
        }
        assert found == pytest.approx({"theta": 0.005, "torque": 0.01, "current": 1 / 70})
    assert len(trial.clocks) == 3
