"""The stepped sine is found as it was recorded, told from every other motion, and refused for its
true reason."""

import numpy as np
import polars as pl
import pytest
from any_motion import RATE as FINE
from any_motion import chirp, multisine, noise
from bench_synthetic import sine_settings, table_of, unit_block

from osl_analysis.bench.record import cycles_of, drift_rate, record_of_trial
from osl_analysis.bench.settings import BenchStiffness
from osl_analysis.errors import InputError
from osl_analysis.signals import Motion
from osl_analysis.spectral import sine_runs, stepped_sine
from osl_analysis.trial import Trial

PROTOCOL = stepped_sine.SteppedSineProtocol(
    amplitudes=(0.03, 0.06, 0.1), frequencies_hz=(2.0, 4.0), cycles=6
)
RATE = 500.0
WARM = 0.2 * np.sin(2 * np.pi * 2 * np.arange(0, 2.5, 1 / RATE))


def segments_of(theta, protocol=PROTOCOL, rate=RATE):
    return stepped_sine.find_segments(
        stepped_sine.Likeness(np.arange(len(theta)) / rate, theta, protocol)
    )


def stepped(protocol=PROTOCOL, start=3.0, rests=(1.0, 1.0, 2.0), rate=RATE):
    """Blocks of all frequencies (n,) [rad], one for each amplitude, with a rest [s] before the
    first and after each."""
    pieces = [np.zeros(round(start * rate))]
    for amplitude, rest in zip(protocol.amplitudes, rests, strict=True):
        pieces += [amplitude * unit_block(protocol, rate), np.zeros(round(rest * rate))]
    return np.concatenate(pieces)


def as_run(
    rest_s=0.0,
    phase=0.0,
    ramp=0,
    clock=1.0,
    cycles=(8, 8, 8),
    frequencies=(1, 2, 3),
    amplitudes=(0.03, 0.1),
):
    """A stepped sine as people run it: rest, start, ramps, a clock that is off. The angle [rad] at
    300 Hz, a function of time, not of rows; of each segment true start [s] of full cycles,
    amplitude, frequency and number."""
    edges, parts, now = [], [], 1.0
    for a in amplitudes:
        for f, n in zip(frequencies, cycles, strict=True):
            f *= clock
            parts.append((now, now + (2 * ramp + n) / f, a, f))
            edges.append((now + ramp / f, a, f, n))
            now = parts[-1][1] + rest_s
        now += 1.0
    time = np.arange(round(now * 300)) / 300
    theta = np.zeros_like(time)
    for begin, end, a, f in parts:
        rows = (time >= begin) & (time < end)
        t = time[rows]
        size = np.clip(np.minimum(t - begin, end - t) * f / ramp, 0, 1) if ramp else 1.0
        theta[rows] = a * size * np.sin(2 * np.pi * f * (t - begin) + phase)
    return theta, edges


PRACTICES = [
    {"rest_s": 1.0}, {"phase": np.pi / 2}, {"ramp": 2}, {"ramp": 1, "rest_s": 0.7}, {"cycles": (5,
    10, 15)},
    {"frequencies": (3.0, 1.0, 2.0), "amplitudes": (0.1, 0.03)}, {"frequencies": (2.0, 2.2, 3.0)},
    {"clock": 1 + 5e-5}, {"clock": 0.995}, {"clock": 1.005, "rest_s": 0.5},
]  # fmt: skip


@pytest.mark.parametrize("practice", PRACTICES)
def test_a_protocol_is_found_as_people_run_it(practice):
    """A clock that is right has the commanded frequency, one that is off its own, the same for all
    amplitudes."""
    theta, edges = as_run(**practice)
    theta += 0.01 + 1e-4 * np.random.default_rng(3).standard_normal(len(theta))
    commanded = practice.get("frequencies", (1.0, 2.0, 3.0))
    found = segments_of(theta, stepped_sine.SteppedSineProtocol((0.03, 0.1), commanded, 8), 300.0)
    assert [s.amplitude for s in found] == pytest.approx([s.commanded for s in found], rel=0.01)
    assert [(s.commanded, s.cycles) for s in found] == [(a, n) for _, a, _, n in edges]
    assert [s.frequency_hz for s in found] == pytest.approx([f for *_, f, _ in edges], rel=1e-4)
    assert [s.frequency_hz for s in found[:3]] == [s.frequency_hz for s in found[3:]]
    if abs(practice.get("clock", 1.0) - 1) < 1e-4:
        assert {s.frequency_hz for s in found} == set(commanded)
    late = [
        (s.start / 300.0 - start) * s.frequency_hz
        for s, (start, *_) in zip(found, edges, strict=True)
    ]
    assert np.abs(late).max() < 0.2  # of a cycle; two settle before the fit begins


@pytest.mark.parametrize(("theta", "message"), [
    (57.3 * stepped(),
     r"sine of 2 Hz at 3\.0 s has an amplitude of 98\.\d+ deg, the protocol says 1\.7"),
    (0.0 * stepped(), r"no sine was found: the joint angle moves by 0 deg"),
    (1e-4 * np.random.default_rng(1).standard_normal(9000),
     r"no sine was found: .* by 0\.0\d+ deg"),
])  # fmt: skip
def test_a_record_that_is_no_stepped_sine_of_these_amplitudes_is_refused_with_what_it_is(
    theta, message
):
    with pytest.raises(InputError, match=message):
        segments_of(theta)


def test_sines_of_another_protocol_are_taken_as_they_are_each_size_under_its_own_amplitude():
    """Of a size a bench loses some; a protocol that was cut short is fitted with its warm-up."""
    sizes = np.radians([8.02, 4.01, 7.9, 12.0])
    blocks = [
        a * unit_block(stepped_sine.SteppedSineProtocol((1,), (f,), 6), RATE)
        for a, f in zip(sizes, (1.5, 2.5, 3.5, 4.5), strict=True)
    ]
    theta = np.concatenate([np.zeros(500), *(x for one in blocks for x in (one, np.zeros(500)))])
    found = segments_of(theta, stepped_sine.SteppedSineProtocol((0.02, 0.04), (2.0, 4.0), 6))
    assert [(round(np.rad2deg(s.commanded), 6), s.cycles) for s in found] == [
        (8, 6),
        (4, 6),
        (8, 6),
        (12, 6),
    ]
    cut = segments_of(np.concatenate([np.zeros(500), WARM, stepped()])[:4500])
    assert {round(np.rad2deg(s.commanded), 1) for s in cut} > {11.5}


@pytest.mark.parametrize("before", [WARM, 0.15 * WARM[:500], -0.15 * WARM[:650]])
def test_a_warm_up_at_another_amplitude_or_of_two_cycles_is_not_used(before):
    found = segments_of(np.concatenate([np.zeros(500), before, stepped()]))
    assert [(s.commanded, s.cycles) for s in found] == [
        (a, 6) for a in PROTOCOL.amplitudes for _ in range(2)
    ]


def test_a_run_has_three_cycles_of_an_amplitude_within_a_quarter():
    """Runs that are alike have the mean of their frequencies, weighted by the squares of their
    cycles."""
    theta = np.pad(0.1 * np.sin(4 * np.pi * np.arange(750) / RATE - 0.5), 500, mode="edge")
    assert len(stepped_sine.Likeness(np.arange(len(theta)) / RATE, theta, PROTOCOL).runs) == 1
    runs = [
        sine_runs.Run(0.1, f, 0.1j, 0.0, 0.0, n / f, 0.0) for f, n in ((2.0098, 10), (2.0102, 20))
    ]
    assert stepped_sine.common_frequencies(runs, PROTOCOL) == [2.01012] * 2
    assert [PROTOCOL.amplitude_near(a) for a in (0.124, 0.126, 0.08, 0.074)] == [
        0.1,
        None,
        0.1,
        0.06,
    ]
    assert [PROTOCOL.frequency_near(f) for f in (2.09, 2.11, 1.89)] == [2.0, None, None]


def test_a_run_is_one_sine_up_to_where_the_next_begins_also_over_two_disturbed_cycles():
    """Crossings lie between samples, noise adds none; a misfit of 0.3 of its RMS is no sine."""
    t, white = np.arange(3000) / RATE, 0.05 * np.random.default_rng(1).standard_normal(3000)
    sine = np.sin(2 * np.pi * 2.3 * t - 0.5)
    assert np.diff(sine_runs.upward_crossings(t, sine)) == pytest.approx(1 / 2.3, abs=1e-6)
    assert len(sine_runs.upward_crossings(t, sine + white)) == 14
    found = [sine_runs.fit_run(t, np.sin(4 * np.pi * t) + k * np.sin(12 * np.pi * t), slice(0,
        3000), 2.04)
             for k in (0, 0.29, 0.31)]  # fmt: skip
    assert (found[0].frequency_hz, [one is None for one in found]) == (
        pytest.approx(2),
        [False, False, True],
    )
    for factors, slip, cycles in (
        ((1.5, 0.5), 0.2, [12]),
        ((1.5, 0.5), 0.5, [5, 5]),
        ((1.5, 0.5, 1.5), 0, [5, 4]),
    ):
        theta = np.pad(0.1 * np.sin(4 * np.pi * t - 0.5 + slip * (t > 3)), 500, mode="edge")
        theta[1750 : 1750 + 250 * len(factors)] *= np.repeat(factors, 250)
        runs = stepped_sine.Likeness(np.arange(4000) / RATE, theta, PROTOCOL).runs
        assert [round(run.cycles) for run in runs] == cycles
    two = np.sin(4 * np.pi * t + np.pi * np.maximum(t - 3.125, 0))  # within a cycle
    first, second = sine_runs.find_runs(t, two, sine_runs.upward_crossings(t, two), 3)
    assert first.stop == second.start == pytest.approx(3.125, abs=0.01)


def test_amplitudes_that_differ_are_never_one_label_and_labels_are_measured():
    """Of a commanded amplitude a bench loses some at high frequencies; a run of another size is
    another label."""
    sizes = np.deg2rad([2.0, 1.98, 1.9, 2.45, 2.5, 4.02])
    commanded = np.deg2rad([2.0, 2.0, 2.0, 2.0, 2.6, 4.0])
    segments = [
        stepped_sine.Segment(a, 1.0, 0, 100, 4, c) for a, c in zip(sizes, commanded, strict=True)
    ]
    assert stepped_sine.labels_deg(segments) == [1.98, 1.98, 1.98, 2.45, 2.5, 4.02]


def test_the_first_cycles_the_last_one_and_those_with_a_row_that_was_not_measured_are_left_out():
    segment, usable = stepped_sine.Segment(0.1, 2.0, 100, 1100, 10), np.ones(2000, dtype=bool)
    settled = stepped_sine.settled_cycles(segment, 2, usable)
    assert settled.tolist() == [[row, row + 100] for row in range(300, 1000, 100)]
    # one is kept
    assert stepped_sine.settled_cycles(segment, 20, usable).tolist() == [[1000, 1100]]
    segments = [
        stepped_sine.Segment(0.1, 3.0, 100, 1100, 12),
        stepped_sine.Segment(0.1, 2.0, 1100, 1600, 4),
    ]
    usable[550] = False  # four cycles are before it, too few beside five
    # of the cycles from row 183 on, 83.3 rows each, and of 125 rows each
    groups = cycles_of(segments, 1, usable)
    np.testing.assert_allclose(
        groups.first, [*(183 + 250 / 3 * np.arange(5, 10)), 1225, 1350], atol=1e-9
    )
    np.testing.assert_allclose(groups.stop - groups.first, [*5 * [250 / 3], 125, 125])
    with pytest.raises(
        InputError, match=r"no cycle of 5\.73 deg at 3 Hz is free of rows near a gap"
    ):
        cycles_of(segments, 1, ~usable)


SEGMENTS = [
    stepped_sine.Segment(0.1, 2.0, 250, 2750, 10),
    stepped_sine.Segment(0.1, 4.0, 2750, 4000, 10),
]
TIME, STILL = np.arange(4500) / RATE, np.zeros(4500)


def sines(amplitude, phase=1.0):
    """Whole cycles of two frequencies, rest before and after."""
    signal = np.zeros_like(TIME)
    for segment in SEGMENTS:
        t = TIME[segment.rows] - TIME[segment.rows.start]
        signal[segment.rows] = amplitude * np.sin(2 * np.pi * segment.frequency_hz * t + phase)
    return signal


def drift_of(torque, segments=SEGMENTS):
    """The drift of a torque; the joint moves by its sines."""
    groups = cycles_of(segments, 0, np.ones(len(TIME), dtype=bool))
    return drift_rate(TIME, Motion(sines(0.1), STILL, STILL), torque, groups)


@pytest.mark.parametrize("drift", [0.0, 0.02])
def test_a_drift_is_found_under_a_sine_of_any_phase(
    drift,
):
    """As of an asymmetric joint, in a protocol whose amplitudes grow: 200 theta^2 read 0.56 N*m/min
    and K 12 SE off."""
    assert drift_of(sines(20.0) + 3.0 + drift * TIME) == pytest.approx(drift, rel=1e-9, abs=1e-12)
    # four cycles
    assert drift_of(sines(20.0) + drift * TIME, [stepped_sine.Segment(0.1, 2.0, 250, 1250, 4)]) == 0
    larger = [stepped_sine.Segment(0.2, 2.0, 2750, 4000, 5, 0.2)]
    torque = np.where(np.arange(len(TIME)) < 2750, 1.0, 4.0) + drift * TIME
    assert drift_of(torque, SEGMENTS[:1] + larger) == pytest.approx(drift, abs=1e-12)


@pytest.mark.usefixtures("without_inference")
def test_a_trial_is_read_without_its_drift_which_the_table_gives_per_minute():
    """A joint of 100 N*m/rad and 2 N*m*s/rad under a load cell that drifts by 0.6 N*m/min."""
    theta = sines(np.deg2rad(4), phase=0.0)
    torque = 100 * theta + 2 * np.gradient(theta, TIME) + 3.0
    samples = pl.DataFrame(
        {"time": TIME, "theta": theta, "torque": torque + 0.01 * (TIME - TIME.mean())}
    )
    record = record_of_trial(Trial("a", samples), sine_settings([4], [2, 4]))
    np.testing.assert_allclose(record.torque, torque, atol=2e-3)
    yielding = sine_settings([4], [2, 4]).model_copy(
        update={"bench_stiffness": BenchStiffness(value="3000 N*m/rad")}
    )
    bent = record_of_trial(Trial("a", samples.with_columns(theta=theta + torque / 3000)), yielding)
    np.testing.assert_allclose(bent.theta, theta, atol=1e-6)  # which the drift does not bend
    whole = table_of(record).row(-1, named=True)
    assert (whole["load_cell_drift"], whole["K"]) == (
        pytest.approx(0.6, rel=0.02),
        pytest.approx(100, rel=0.01),
    )


SIX = stepped_sine.SteppedSineProtocol(
    tuple(np.deg2rad([2.0, 4.0, 6.0])), (1.0, 2.0, 3.0, 4.0, 5.0), 8
)


def kind_of(theta, rng):
    theta = theta + 1e-5 * rng.standard_normal(len(theta))
    return stepped_sine.Likeness(np.arange(len(theta)) / FINE, theta, SIX).kind


DAMAGE = {
    "sound": lambda x, _: (x, "stepped sine"), "in degrees": lambda x, _: (57.3 * x,
    "stepped sine"),
    "half of it at rest": lambda x, _: (np.where(np.arange(len(x)) < len(x) / 2, x, 0),
    "stepped sine"),
    "clipped": lambda x, _: (np.clip(x, -0.03, 0.03), "stepped sine"),
    "freezes": lambda x, _: (np.where(np.arange(len(x)) % 7500 < 1500, 0.02, x), "stepped sine"),
    "spikes": lambda x, rng: (np.where(rng.random(len(x)) < 0.01,
    0.15 * rng.standard_normal(len(x)), x), "unclear"),
    "wanders": lambda x, _: (x + 0.05 * np.sin(0.8 * np.arange(len(x)) / FINE), "unclear"),
    "hum": lambda x, _: (x + 0.05 * np.sin(314 * np.arange(len(x)) / FINE), "unclear"),
    "still": lambda x, _: (0 * x, "unclear"),
}  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_stepped_sine_is_not_taken_for_another_motion(damage):
    theta, expected = DAMAGE[damage](
        stepped(SIX, 1.0, (1.0, 1.0, 1.0), FINE), rng := np.random.default_rng(4)
    )
    assert kind_of(theta, rng) == expected


@pytest.mark.parametrize("move", [multisine, noise, chirp])
@pytest.mark.parametrize("band", [(0.5, 3.0), (0.5, 6.0), (0.5, 10.0), (0.2, 2.0)])
def test_multisine_noise_and_sweep_are_other_motions_at_the_commanded_amplitudes(move, band):
    for seed in range(3):
        _, (theta, *_) = move(rng := np.random.default_rng(seed), band=band)
        assert kind_of(np.deg2rad(4) * theta / theta.max(), rng) == "other"


def test_ramps_and_a_binary_sequence_are_other_motions():
    rng = np.random.default_rng(2)
    ramps = 0.09 * (2 * np.abs(2 * (0.3 * np.arange(0, 40, 1 / FINE) % 1) - 1) - 1)
    sequence = np.convolve(
        np.repeat(rng.choice([-0.06, 0.06], 400), 50), np.hanning(25) / 12, "same"
    )
    assert kind_of(ramps, rng) == kind_of(sequence, rng) == "other"
