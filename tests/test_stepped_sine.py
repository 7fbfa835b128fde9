"""The stepped sine is found as it was recorded, told from every other motion, and refused for its
true reason."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import polars as pl
import pytest
from any_motion import RATE as FINE
from any_motion import chirp, multisine, noise
from bench_synthetic import segments_of as segments_in
from bench_synthetic import sine_settings, table_of, unit_block

from osl_analysis.bench.motion import cycles_of, record_of_trial, settled_cycles
from osl_analysis.errors import InputError
from osl_analysis.spectral.stepped_sine import (
    Segment,
    SteppedSineProtocol,
    find_sines,
    labels_deg,
)
from osl_analysis.trial import Trial

PROTOCOL = SteppedSineProtocol(amplitudes=(0.03, 0.06, 0.1), frequencies_hz=(2.0, 4.0), cycles=6)
RATE = 500.0
WARM = 0.2 * np.sin(2 * np.pi * 2 * np.arange(0, 2.5, 1 / RATE))


def segments_of(theta, protocol=PROTOCOL, rate=RATE):
    return segments_in(np.arange(len(theta)) / rate, theta, protocol)


def stepped(protocol=PROTOCOL, start=3.0, rests=(1.0, 1.0, 2.0), rate=RATE):
    """Blocks of all frequencies (n,) [rad], one for each amplitude, with a rest [s] before the
    first and after each."""
    pieces = [np.zeros(round(start * rate))]
    for amplitude, rest in zip(protocol.amplitudes, rests, strict=True):
        pieces.append(amplitude * unit_block(protocol, rate))
        pieces.append(np.zeros(round(rest * rate)))
    return np.concatenate(pieces)


# ---- Protocols as people run them


@dataclass(frozen=True)
class Practice:
    """How people run a stepped sine: rests, starts, ramps, a clock that is off."""

    rest_s: float = 0.0  # after each frequency
    phase: float = 0.0  # of the start [rad]
    ramp: int = 0  # cycles in which the amplitude grows, and falls
    clock: float = 1.0  # factor of the frequencies
    cycles: tuple[int, ...] = (8, 8, 8)
    frequencies: tuple[float, ...] = (1.0, 2.0, 3.0)
    amplitudes: tuple[float, ...] = (0.03, 0.1)


class TruePart(NamedTuple):
    """One frequency of a recorded protocol."""

    begin: float  # [s], ramps included
    end: float  # [s]
    start: float  # [s] of the full cycles
    amplitude: float  # [rad]
    frequency: float  # [Hz]
    cycles: int


PRACTICES = {
    "rests": Practice(rest_s=1.0),
    "cosines": Practice(phase=np.pi / 2),
    "ramps": Practice(ramp=2),
    "ramps and rests": Practice(ramp=1, rest_s=0.7),
    "other numbers of cycles": Practice(cycles=(5, 10, 15)),
    "another order": Practice(frequencies=(3.0, 1.0, 2.0), amplitudes=(0.1, 0.03)),
    "neighbouring frequencies": Practice(frequencies=(2.0, 2.2, 3.0)),
    "a clock off by 50 ppm": Practice(clock=1 + 5e-5),
    "a slow clock": Practice(clock=0.995),
    "a fast clock and rests": Practice(clock=1.005, rest_s=0.5),
}
PRACTICE_RATE = 300.0


def parts_of(practice):
    """The parts of a protocol, after a second of rest, and a second between amplitudes."""
    parts = []
    now = 1.0
    for amplitude in practice.amplitudes:
        for commanded, cycles in zip(practice.frequencies, practice.cycles, strict=True):
            frequency = commanded * practice.clock
            start = now + practice.ramp / frequency
            end = now + (2 * practice.ramp + cycles) / frequency
            parts.append(TruePart(now, end, start, amplitude, frequency, cycles))
            now = end + practice.rest_s
        now += 1.0
    return parts


def run_as(practice):
    """The angle (n,) [rad] of a practice with an offset and noise: a function of time, not of
    rows."""
    parts = parts_of(practice)
    time = np.arange(round((parts[-1].end + practice.rest_s + 1.0) * PRACTICE_RATE)) / PRACTICE_RATE
    theta = 0.01 + 1e-4 * np.random.default_rng(3).standard_normal(len(time))
    for part in parts:
        rows = (time >= part.begin) & (time < part.end)
        t = time[rows]
        size = part.amplitude
        if practice.ramp:
            from_ends = np.minimum(t - part.begin, part.end - t)
            size = part.amplitude * np.clip(from_ends * part.frequency / practice.ramp, 0, 1)
        phase = 2 * np.pi * part.frequency * (t - part.begin) + practice.phase
        theta[rows] += size * np.sin(phase)
    return theta


def segments_of_practice(practice):
    protocol = SteppedSineProtocol((0.03, 0.1), practice.frequencies, 8)
    return segments_of(run_as(practice), protocol, PRACTICE_RATE)


every_practice = pytest.mark.parametrize("practice", PRACTICES.values(), ids=PRACTICES)


@every_practice
def test_amplitudes_and_cycles_are_found_as_people_run_a_protocol(practice):
    segments = segments_of_practice(practice)

    parts = parts_of(practice)
    assert [s.commanded for s in segments] == [part.amplitude for part in parts]
    assert [s.cycles for s in segments] == [part.cycles for part in parts]
    assert [s.amplitude for s in segments] == pytest.approx([s.commanded for s in segments], 0.01)


@every_practice
def test_cycles_begin_where_the_sine_does_to_a_fifth_of_a_cycle(practice):
    """Two cycles settle before the fit begins."""
    segments = segments_of_practice(practice)

    late = [
        (segment.start / PRACTICE_RATE - part.start) * segment.frequency_hz
        for segment, part in zip(segments, parts_of(practice), strict=True)
    ]
    assert np.abs(late).max() < 0.2


@every_practice
def test_frequencies_are_the_recorded_ones_and_the_same_for_all_amplitudes(practice):
    frequencies = [s.frequency_hz for s in segments_of_practice(practice)]

    recorded = [part.frequency for part in parts_of(practice)]
    assert frequencies == pytest.approx(recorded, rel=1e-4)
    assert frequencies[:3] == frequencies[3:]


@pytest.mark.parametrize("clock", [1.0, 1 + 5e-5])
def test_a_clock_that_is_right_has_the_commanded_frequencies(clock):
    segments = segments_of_practice(Practice(clock=clock))

    assert {s.frequency_hz for s in segments} == {1.0, 2.0, 3.0}


# ---- Other protocols than the stated one


NOISE_ALONE = 1e-4 * np.random.default_rng(1).standard_normal(9000)


@pytest.mark.parametrize(("theta", "message"), [
    (57.3 * stepped(),
     r"sine of 4 Hz at 17\.0 s has an amplitude of 328\.\d+ deg, the protocol says 1\.7"),
    (0.0 * stepped(), r"no sine was found: the joint angle moves by 0 deg"),
    (NOISE_ALONE, r"no sine was found: .* by 0\.0\d+ deg"),
], ids=["in degrees", "still", "noise"])  # fmt: skip
def test_a_record_without_the_commanded_sines_is_refused_with_what_it_is(theta, message):
    with pytest.raises(InputError, match=message):
        segments_of(theta)


def test_sines_of_another_protocol_are_taken_each_size_under_its_own_amplitude():
    """Of a size a bench loses some: 7.9 deg counts as 8."""
    sizes_deg = [8.02, 4.01, 7.9, 12.0]
    rest = np.zeros(500)
    pieces = [rest]
    for size_deg, frequency in zip(sizes_deg, (1.5, 2.5, 3.5, 4.5), strict=True):
        sine = unit_block(SteppedSineProtocol((1,), (frequency,), 6), RATE)
        pieces.extend([np.deg2rad(size_deg) * sine, rest])

    segments = segments_of(np.concatenate(pieces), SteppedSineProtocol((0.02, 0.04), (2.0, 4.0), 6))

    assert [round(np.rad2deg(s.commanded), 6) for s in segments] == [8, 4, 8, 12]
    assert [s.cycles for s in segments] == [6, 6, 6, 6]


def test_a_protocol_that_was_cut_short_is_fitted_with_its_warm_up():
    theta = np.concatenate([np.zeros(500), WARM, stepped()])[:4500]

    amplitudes_deg = {round(np.rad2deg(s.commanded), 1) for s in segments_of(theta)}

    assert 11.5 in amplitudes_deg
    assert len(amplitudes_deg) > 1


@pytest.mark.parametrize("before", [WARM, 0.15 * WARM[:500], -0.15 * WARM[:650]])
def test_a_warm_up_at_another_amplitude_or_of_two_cycles_is_not_used(before):
    segments = segments_of(np.concatenate([np.zeros(500), before, stepped()]))

    both_frequencies = [a for a in PROTOCOL.amplitudes for _ in range(2)]
    assert [s.commanded for s in segments] == both_frequencies
    assert {s.cycles for s in segments} == {6}


# ---- Runs


def test_a_run_has_three_cycles():
    three_cycles = 0.1 * np.sin(4 * np.pi * np.arange(750) / RATE - 0.5)
    theta = np.pad(three_cycles, 500, mode="edge")

    runs = find_sines(np.arange(len(theta)) / RATE, theta, PROTOCOL).runs

    assert len(runs) == 1


SIX_SECONDS = np.arange(3000) / RATE


def test_the_sine_of_a_run_is_found_beside_noise_and_a_harmonic():
    turns = 2 * np.pi * 2.3 * SIX_SECONDS + 0.7
    noise = 5e-3 * np.random.default_rng(1).standard_normal(3000)
    theta = 0.3 + 0.2 * np.sin(turns) + 0.01 * np.sin(3 * turns) + noise

    (run,) = find_sines(SIX_SECONDS, theta, PROTOCOL).runs

    assert run.frequency_hz == pytest.approx(2.3, abs=1e-3)
    assert run.amplitude == pytest.approx(0.2, rel=5e-3)
    assert run.centre == pytest.approx(0.3, abs=1e-3)
    assert run.cycles == pytest.approx(13.8, abs=0.3)


@pytest.mark.parametrize(("disturbed", "cycles"), [(2, [5, 5]), (3, [5, 4])])
def test_disturbed_cycles_part_a_run(disturbed, cycles):
    theta = np.pad(0.1 * np.sin(4 * np.pi * SIX_SECONDS - 0.5), 500, mode="edge")
    rows = slice(1750, 1750 + 250 * disturbed)
    theta[rows] *= np.repeat([1.5, 0.5, 1.5][:disturbed], 250)

    runs = find_sines(np.arange(4000) / RATE, theta, PROTOCOL).runs

    assert [round(run.cycles) for run in runs] == cycles


def test_a_run_ends_where_the_next_begins():
    """The frequency changes within a cycle, at 3.125 s."""
    after = np.maximum(SIX_SECONDS - 3.125, 0)
    theta = np.sin(4 * np.pi * SIX_SECONDS + np.pi * after)

    first, second = find_sines(SIX_SECONDS, theta, PROTOCOL).runs

    assert first.stop <= second.start
    assert first.stop == pytest.approx(3.125, abs=0.05)


# ---- Segments


def test_amplitudes_that_differ_are_never_one_label_and_labels_are_measured():
    """Of a commanded amplitude a bench loses some at high frequencies; a run of another size is
    another label."""
    sizes = np.deg2rad([2.0, 1.98, 1.9, 2.45, 2.5, 4.02])
    commanded = np.deg2rad([2.0, 2.0, 2.0, 2.0, 2.6, 4.0])
    segments = [Segment(a, 1.0, 0, 100, 4, c) for a, c in zip(sizes, commanded, strict=True)]
    assert labels_deg(segments) == [1.98, 1.98, 1.98, 2.45, 2.5, 4.02]


ALL_ROWS = np.ones(2000, dtype=bool)


def test_the_first_cycles_and_the_last_one_are_left_out():
    segment = Segment(0.1, 2.0, start=100, stop=1100, cycles=10)

    settled = settled_cycles(segment, 2, ALL_ROWS)

    assert settled.tolist() == [[row, row + 100] for row in range(300, 1000, 100)]


def test_one_cycle_is_kept_where_all_would_settle():
    segment = Segment(0.1, 2.0, start=100, stop=1100, cycles=10)

    assert settled_cycles(segment, 20, ALL_ROWS).tolist() == [[1000, 1100]]


# of 83.3 rows a cycle, and of 125
TWO_SEGMENTS = [
    Segment(0.1, 3.0, start=100, stop=1100, cycles=12),
    Segment(0.1, 2.0, start=1100, stop=1600, cycles=4),
]


def test_cycles_near_a_gap_are_left_out():
    """Row 550 is in the fifth of ten cycles. The first cycle of a segment begins at a whole row;
    the others are not rounded."""
    usable = ALL_ROWS.copy()
    usable[550] = False

    groups = cycles_of(TWO_SEGMENTS, 1, usable)

    of_first = 183 + 250 / 3 * np.delete(np.arange(10), 4)
    np.testing.assert_allclose(groups.first, [*of_first, 1225, 1350], atol=1e-9)
    np.testing.assert_allclose(groups.stop - groups.first, [*[250 / 3] * 9, 125, 125])


def test_a_segment_without_a_cycle_free_of_gaps_is_refused():
    with pytest.raises(
        InputError, match=r"no cycle of 5\.73 deg at 3 Hz is free of rows near a gap"
    ):
        cycles_of(TWO_SEGMENTS, 1, ~ALL_ROWS)


# ---- Drift of the load cell


SEGMENTS = [
    Segment(0.1, 2.0, 250, 2750, 10),
    Segment(0.1, 4.0, 2750, 4000, 10),
]
TIME = np.arange(4500) / RATE


def sines(amplitude, phase=1.0):
    """Whole cycles of two frequencies, rest before and after."""
    signal = np.zeros_like(TIME)
    for segment in SEGMENTS:
        t = TIME[segment.rows] - TIME[segment.rows.start]
        signal[segment.rows] = amplitude * np.sin(2 * np.pi * segment.frequency_hz * t + phase)
    return signal


THETA = sines(np.deg2rad(4), phase=0.0)
TORQUE = 100 * THETA + 2 * np.gradient(THETA, TIME) + 3.0  # of 100 N*m/rad and 2 N*m*s/rad


@pytest.fixture
def drifting():
    """Samples of a joint under a load cell that drifts by 0.6 N*m/min."""
    drift = 0.01 * (TIME - TIME.mean())
    return pl.DataFrame({"time": TIME, "theta": THETA, "torque": TORQUE + drift})


@pytest.mark.usefixtures("without_inference")
def test_a_drift_is_fitted_beside_the_impedance(drifting):
    record = record_of_trial(Trial("a", drifting), sine_settings([4], [2, 4]))

    row = table_of(record).row(-1, named=True)
    assert row["K"] == pytest.approx(100, rel=0.01)


# ---- Stepped sines and other motions


SIX = SteppedSineProtocol(tuple(np.deg2rad([2.0, 4.0, 6.0])), (1.0, 2.0, 3.0, 4.0, 5.0), 8)


def is_stepped(theta, seed):
    """What a motion is taken for, with the noise of an encoder."""
    noise = 1e-5 * np.random.default_rng(seed).standard_normal(len(theta))
    return find_sines(np.arange(len(theta)) / FINE, theta + noise, SIX).is_stepped


SOUND = stepped(SIX, 1.0, (1.0, 1.0, 1.0), FINE)
ROW = np.arange(len(SOUND))
STEPPED_SINES = {
    "sound": SOUND,
    "in degrees": 57.3 * SOUND,
    "half of it at rest": np.where(ROW < len(SOUND) / 2, SOUND, 0),
    "clipped": np.clip(SOUND, -0.03, 0.03),
    "freezes": np.where(ROW % 7500 < 1500, 0.02, SOUND),
}


@pytest.mark.parametrize("theta", STEPPED_SINES.values(), ids=STEPPED_SINES)
def test_a_stepped_sine_is_one_also_if_it_is_clipped_or_freezes(theta):
    assert is_stepped(theta, seed=4)


@pytest.mark.parametrize("move", [multisine, noise, chirp])
@pytest.mark.parametrize("band", [(0.5, 3.0), (0.5, 10.0), (0.2, 2.0)])
def test_multisine_noise_and_sweep_are_other_motions(move, band):
    _, (theta, *_) = move(np.random.default_rng(1), band=band)

    assert not is_stepped(np.deg2rad(4) * theta / theta.max(), seed=1)


def test_ramps_are_another_motion():
    triangle = 2 * np.abs(2 * (0.3 * np.arange(0, 40, 1 / FINE) % 1) - 1) - 1

    assert not is_stepped(0.09 * triangle, seed=2)


def test_a_binary_sequence_is_another_motion():
    steps = np.random.default_rng(2).choice([-0.06, 0.06], 400)
    smooth = np.convolve(np.repeat(steps, 50), np.hanning(25) / 12, "same")

    assert not is_stepped(smooth, seed=2)
