"""The stepped sine is found as it was recorded, and refused for its true reason."""

from dataclasses import dataclass

import numpy as np
import polars as pl
import pytest
from bench_synthetic import table_of, unit_block

from osl_analysis.bench.record import cycles_of, drift_rate, record_of_trial
from osl_analysis.bench.settings import DynamometerAnalysis
from osl_analysis.errors import InputError
from osl_analysis.protocol.stepped_sine import (
    Segment,
    SteppedSineProtocol,
    find_segments,
    labels_deg,
    settled_cycles,
)
from osl_analysis.signals import Motion
from osl_analysis.trial import Trial

PROTOCOL = SteppedSineProtocol(amplitudes=(0.03, 0.06, 0.1), frequencies_hz=(2.0, 4.0), cycles=6)
RATE = 500.0


def stepped_record(start=3.0, rests=(1.0, 1.0, 2.0), unit=1.0, protocol=PROTOCOL):
    pieces = [np.zeros(round(start * RATE))]
    for amplitude, rest in zip(protocol.amplitudes, rests, strict=True):
        pieces += [amplitude * unit * unit_block(protocol, RATE), np.zeros(round(rest * RATE))]
    theta = np.concatenate(pieces)
    return np.arange(len(theta)) / RATE, theta


@dataclass(frozen=True)
class Practice:
    """How somebody runs a stepped sine: rest between frequencies, starts, ramps, and a clock that is off."""

    rest_s: float = 0.0
    phase: float = 0.0
    ramp_cycles: int = 0
    clock: float = 1.0
    cycles: tuple[int, ...] = (8, 8, 8)
    frequencies_hz: tuple[float, ...] = (1.0, 2.0, 3.0)
    amplitudes: tuple[float, ...] = (0.03, 0.1)


def as_run(practice: Practice, rate: float = 300.0):
    """Angle [rad] at `rate`, with the true start [s] of the full cycles of each segment; one period shorter than 1 row
    is left over where rate/f is not whole, so that the angle is a function of time and not of rows."""
    edges, parts, now = [], [], 1.0
    for a in practice.amplitudes:
        for f, n in zip(practice.frequencies_hz, practice.cycles, strict=True):
            f, ramp = f * practice.clock, practice.ramp_cycles / (f * practice.clock)
            parts.append((now, now + 2 * ramp + n / f, a, f, ramp))
            edges.append((now + ramp, a, f, n))
            now += 2 * ramp + n / f + practice.rest_s
        now += 1.0
    time = np.arange(round(now * rate)) / rate
    theta = np.zeros_like(time)
    for begin, end, a, f, ramp in parts:
        rows = (time >= begin) & (time < end)
        t = time[rows]
        size = np.clip(np.minimum(t - begin, end - t) / ramp, 0, 1) if ramp else 1.0
        theta[rows] = a * size * np.sin(2 * np.pi * f * (t - begin) + practice.phase)
    return time, theta, edges


@pytest.mark.parametrize(
    "practice",
    [
        Practice(),
        Practice(rest_s=1.0),
        Practice(phase=np.pi / 2),
        Practice(ramp_cycles=2),
        Practice(ramp_cycles=1, rest_s=0.7),
        Practice(cycles=(5, 10, 15)),
        Practice(frequencies_hz=(3.0, 1.0, 2.0), amplitudes=(0.1, 0.03)),
        Practice(clock=0.995),
        Practice(clock=1.005, rest_s=0.5),
    ],
)
def test_a_protocol_is_found_as_people_run_it(practice):
    """Frequency, amplitude, start, order and cycles as recorded, whatever lies between; commanded were 1, 2, 3 Hz."""
    time, theta, edges = as_run(practice)
    theta = theta + 0.01 + 1e-4 * np.random.default_rng(3).standard_normal(len(theta))
    found = find_segments(time, theta, SteppedSineProtocol((0.03, 0.1), (1.0, 2.0, 3.0), 8))
    assert list(dict.fromkeys(s.commanded for s in found)) == list(practice.amplitudes)
    assert [s.amplitude for s in found] == pytest.approx([s.commanded for s in found], rel=0.01)
    assert [(s.commanded, s.cycles) for s in found] == [(a, n) for _, a, _, n in edges]
    assert [s.frequency_hz for s in found] == pytest.approx([f for *_, f, _ in edges], rel=1e-4)
    late = [(s.start / 300.0 - start) * s.frequency_hz for s, (start, *_) in zip(found, edges, strict=True)]
    assert np.abs(late).max() < 0.2  # of a cycle; two settle before the fit begins


def test_a_clock_that_is_right_has_the_commanded_frequency_and_one_that_is_off_its_own_for_all_amplitudes():
    commanded = SteppedSineProtocol((0.03, 0.1), (1.0, 2.0, 3.0), 8)
    for clock, expected in ((1 + 5e-5, 3.0), (0.995, 2.985)):
        time, theta, _ = as_run(Practice(clock=clock))
        theirs = {s.frequency_hz for s in find_segments(time, theta, commanded)[2::3]}
        assert len(theirs) == 1
        assert theirs.pop() == pytest.approx(expected, rel=1e-12 if expected == 3 else 1e-5)


def test_a_record_that_is_no_stepped_sine_of_these_amplitudes_is_refused_with_what_it_is():
    off = r"sine of 2 Hz at 3\.0 s has an amplitude of 98\.\d+ deg, the protocol says 1\.7"
    with pytest.raises(InputError, match=off):
        find_segments(*stepped_record(unit=57.3), PROTOCOL)
    time, theta = stepped_record()
    with pytest.raises(InputError, match=r"no sine was found: the joint angle moves by 0 deg"):
        find_segments(time, 0 * theta, PROTOCOL)
    with pytest.raises(InputError, match=r"no sine was found: .* by 0\.0\d+ deg"):
        find_segments(time, 1e-4 * np.random.default_rng(1).standard_normal(len(theta)), PROTOCOL)


def test_a_warm_up_at_another_amplitude_is_not_used_where_all_commanded_ones_were_recorded():
    _, theta = stepped_record()
    warm = 0.2 * np.sin(2 * np.pi * 2 * np.arange(0, 2.5, 1 / RATE))
    theta = np.concatenate([np.zeros(500), warm, theta])
    found = find_segments(np.arange(len(theta)) / RATE, theta, PROTOCOL)
    assert list(dict.fromkeys(s.commanded for s in found)) == list(PROTOCOL.amplitudes)
    with pytest.raises(InputError, match=r"amplitude of 11\.46 deg"):
        find_segments(np.arange(4500) / RATE, theta[:4500], PROTOCOL)


@pytest.mark.parametrize("frequencies_hz", [(2.0, 4.0), (1.0, 2.0, 3.0, 4.0, 5.0), (3.0,), (4.0, 4.4, 5.0)])
@pytest.mark.parametrize("really", [4, 6, 7, 12])
def test_all_recorded_cycles_are_found_whatever_their_number_in_the_configuration(frequencies_hz, really):
    """At rest, at another frequency (a tenth higher at least) and at another amplitude a sine does not go on."""
    configured = SteppedSineProtocol(PROTOCOL.amplitudes, frequencies_hz, 6)
    recorded = SteppedSineProtocol(PROTOCOL.amplitudes, frequencies_hz, really)
    time, theta = stepped_record(rests=(1.0, 0.0, 0.0), protocol=recorded)
    theta += 1e-4 * np.random.default_rng(1).standard_normal(len(theta)) + 0.02
    found = find_segments(time, theta, configured)
    assert [(s.commanded, s.cycles) for s in found] == [
        (a, really) for a in PROTOCOL.amplitudes for _ in frequencies_hz
    ]


def test_amplitudes_that_differ_are_never_one_label_and_labels_are_measured():
    """Of a commanded amplitude a bench loses some at high frequencies; a run of another size is another label."""
    sizes = np.deg2rad([2.0, 1.98, 1.9, 2.45, 4.02])
    commanded = np.deg2rad([2.0, 2.0, 2.0, 2.0, 4.0])
    segments = [Segment(a, 1.0, 0, 100, 4, c) for a, c in zip(sizes, commanded, strict=True)]
    assert labels_deg(segments) == [1.98, 1.98, 1.98, 2.45, 4.02]


def test_settled_cycles_leave_out_the_first_and_the_last_and_keep_one():
    segment, usable = Segment(0.1, 2.0, 100, 1100, 10), np.ones(2000, dtype=bool)
    kept = settled_cycles(segment, 2, usable)
    assert (kept.start, kept.stop, kept.cycles, kept.used) == (300, 1000, 7, tuple(range(7)))
    kept = settled_cycles(segment, 20, usable)
    assert (kept.start, kept.stop, kept.cycles) == (1000, 1100, 1)


def test_cycles_with_a_row_that_was_not_measured_are_left_out():
    segments = [Segment(0.1, 3.0, 100, 100 + 2500 / 3, 10), Segment(0.1, 2.0, 1000, 1500, 4)]
    usable = np.ones(2000, dtype=bool)
    usable[390] = False
    kept, other = (settled_cycles(one, 1, usable) for one in segments)
    assert (kept.used, other.used) == ((3, 4, 5, 6, 7), (0, 1))  # of the cycles from row 183 on, 83.3 rows each
    groups = cycles_of(segments, 1, usable)
    assert [(p.start, p.stop) for p in groups.pieces()] == [(433, 850), (1125, 1375)]
    np.testing.assert_allclose(groups.first[:5] - groups.first[0], 250 / 3 * np.arange(5), atol=1e-9)
    np.testing.assert_allclose(groups.stop[:5] - groups.first[:5], 250 / 3)


SEGMENTS = [Segment(0.1, 2.0, 250, 2750, 10), Segment(0.1, 4.0, 2750, 4000, 10)]
TIME = np.arange(4500) / RATE


STILL = np.zeros_like(TIME)


def sines(amplitude=20.0):
    """Whole cycles of two frequencies, rest before and after."""
    signal = np.zeros_like(TIME)
    for segment in SEGMENTS:
        t = TIME[segment.rows] - TIME[segment.rows.start]
        signal[segment.rows] = amplitude * np.sin(2 * np.pi * segment.frequency_hz * t + 1.0)
    return signal


def drift_of(torque, segments=SEGMENTS, theta=None):
    """The drift of a torque; the joint moves by its sines."""
    groups = cycles_of(segments, 0, np.ones(len(TIME), dtype=bool))
    return drift_rate(TIME, Motion(sines(0.1) if theta is None else theta, STILL, STILL), torque, groups)


def test_a_sine_of_any_phase_has_no_drift_and_a_drift_is_found_under_it():
    assert drift_of(sines() + 3.0) == pytest.approx(0, abs=1e-12)
    assert drift_of(sines() + 3.0 + 0.02 * TIME) == pytest.approx(0.02, rel=1e-9)


@pytest.mark.parametrize("drift", [0.0, 0.02])
def test_a_mean_torque_that_grows_with_the_amplitude_is_no_drift(drift):
    """As of an asymmetric joint, in a protocol whose amplitudes grow: 200 theta^2 read 0.56 N*m/min and K 12 SE off."""
    larger = [Segment(0.2, 2.0, 2750, 4000, 5, 0.2)]
    torque = np.where(np.arange(len(TIME)) < 2750, 1.0, 4.0) + drift * TIME
    assert drift_of(torque, SEGMENTS[:1] + larger) == pytest.approx(drift, abs=1e-12)


def test_a_trial_is_read_without_its_drift_which_the_table_gives_per_minute():
    """A joint of 100 N*m/rad and 2 N*m*s/rad under a load cell that drifts by 0.6 N*m/min."""
    settings = DynamometerAnalysis(
        cutoff_hz=15, order=4, amplitudes_deg=[4], frequencies_hz=[2, 4], cycles=10, settle_cycles=2
    )
    theta = np.zeros_like(TIME)
    for segment in SEGMENTS:
        t = TIME[segment.rows] - TIME[segment.rows.start]
        theta[segment.rows] = np.sin(2 * np.pi * segment.frequency_hz * t)
    theta *= np.deg2rad(4)
    torque = 100 * theta + 2 * np.gradient(theta, TIME) + 3.0
    samples = pl.DataFrame({"time": TIME, "theta": theta, "torque": torque + 0.01 * (TIME - TIME.mean())})
    record = record_of_trial(Trial("a", samples), settings)
    np.testing.assert_allclose(record.torque, torque, atol=2e-3)
    whole = table_of(record).row(-1, named=True)
    assert whole["load_cell_drift"] == pytest.approx(0.6, rel=0.02)
    assert whole["K"] == pytest.approx(100, rel=0.01)
