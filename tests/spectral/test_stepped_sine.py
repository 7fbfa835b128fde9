# SPDX-License-Identifier: Apache-2.0
"""The stepped sine is found as it was recorded, told from every other motion, and refused for its
true reason."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest
from any_motion import RATE as FINE
from any_motion import chirp, multisine, noise
from bench_synthetic import segments_of as segments_in
from bench_synthetic import unit_block
from conftest import refused_with, white_noise
from scipy import signal

from osl_analysis.bench.motion import cycles_of
from osl_analysis.spectral.stepped_sine import (
    Segment,
    SteppedSineProtocol,
    find_sines,
    moving_bins,
    similar_cycles,
)

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
    within: float = 1e-3  # cycles that the start that is found may be off
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
    "cosines": Practice(phase=np.pi / 2, within=0.2),
    "sines from 40 deg": Practice(phase=0.7, rest_s=0.7, within=0.05),
    "ramps and rests": Practice(ramp=1, rest_s=0.7),
    "other numbers of cycles": Practice(cycles=(5, 10, 15)),
    "another order": Practice(frequencies=(3.0, 1.0, 2.0), amplitudes=(0.1, 0.03)),
    "neighbouring frequencies": Practice(frequencies=(2.0, 2.2, 3.0)),
    "frequencies as near as 0.15 %": Practice(frequencies=(2.0, 2.003, 3.0), rest_s=0.7),
    "a clock off by 1000 ppm": Practice(clock=1 + 1e-3),
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


def segments_of_practice(practice):
    """The segments of a practice with an offset and noise: a function of time, not of rows."""
    parts = parts_of(practice)
    time = np.arange(round((parts[-1].end + practice.rest_s + 1.0) * PRACTICE_RATE)) / PRACTICE_RATE
    theta = 0.01 + 1e-4 * white_noise(len(time), 3)
    for part in parts:
        rows = (time >= part.begin) & (time < part.end)
        t = time[rows]
        size = part.amplitude
        if practice.ramp:
            from_ends = np.minimum(t - part.begin, part.end - t)
            size = part.amplitude * np.clip(from_ends * part.frequency / practice.ramp, 0, 1)
        phase = 2 * np.pi * part.frequency * (t - part.begin) + practice.phase
        theta[rows] += size * np.sin(phase)
    protocol = SteppedSineProtocol((0.03, 0.1), practice.frequencies, 8)
    return segments_of(theta, protocol, PRACTICE_RATE)


@pytest.mark.parametrize("practice", PRACTICES.values(), ids=PRACTICES)
def test_sines_are_found_as_people_run_a_protocol(practice):
    """Two cycles settle before the fit begins: a start elsewhere than at the centre may be off by a
    fifth of a cycle."""
    segments = segments_of_practice(practice)

    parts = parts_of(practice)
    assert [s.commanded for s in segments] == [part.amplitude for part in parts]
    assert [s.cycles for s in segments] == [part.cycles for part in parts]
    assert [s.amplitude for s in segments] == pytest.approx([s.commanded for s in segments], 0.01)
    frequencies = [s.frequency_hz for s in segments]
    assert frequencies == pytest.approx([part.frequency for part in parts], rel=1e-4)
    assert frequencies[:3] == frequencies[3:]
    for segment, part in zip(segments, parts, strict=True):
        assert segment.start / PRACTICE_RATE == pytest.approx(
            part.start, abs=practice.within / part.frequency
        )


EVEN = np.full(20, 100)
SAME = np.ones(20)


@pytest.mark.parametrize(
    ("rows", "sizes", "cycles"),
    [
        (EVEN, 8 * SAME, [18]),
        (EVEN, 4 * SAME, []),  # noises
        # a cycle within 5 % of those before it, and 15 or 25 % longer than the first
        (100 * 1.012 ** np.arange(20), 100 * SAME, [18]),
        (np.repeat([100, 110], 10), 100 * SAME, [9, 9]),
        # a ramp of 8 %
        (EVEN, 100 * np.clip(SAME - 0.08 * (np.arange(20) < 5), 0, 1), [14]),
    ],
)
def test_cycles_of_a_run_are_like_the_five_before_them(rows, sizes, cycles):
    pieces = [
        size * np.sin(2 * np.pi * np.arange(round(n)) / round(n))
        for n, size in zip(rows, sizes, strict=True)
    ]
    theta = np.concatenate(pieces)

    found = similar_cycles(theta, 1.0, np.ones(len(theta), dtype=bool))

    assert [len(crossings) - 1 for crossings in found] == cycles


def runs_of(theta, protocol):
    moving = np.ones(len(theta), dtype=bool)
    return find_sines(theta, RATE, 1e-4, moving, protocol)[0]


def test_a_run_has_the_rows_in_which_the_angle_follows_its_sine():
    rows = np.arange(1000)
    sine = 0.1 * np.sin(2 * np.pi * rows / 100 + 0.5)
    theta = np.concatenate([np.full(300, 0.3), sine, np.full(300, 0.3)])

    (run,) = runs_of(theta, PROTOCOL)

    assert (run.start, run.stop) == (300, 1299)


@pytest.mark.parametrize(("cycles", "found"), [(3, [3, 3, 3]), (2, [2])])
def test_three_cycles_of_each_sine_are_enough(cycles, found):
    """Of two, only those of the last sine are told from a transient."""
    frequencies_hz = (1.0, 2.0, 5.0)
    protocol = SteppedSineProtocol((0.1,), frequencies_hz, cycles)
    theta = np.pad(0.1 * unit_block(protocol, RATE), 300)

    runs = runs_of(theta, protocol)

    assert [run.cycles for run in runs] == pytest.approx(found, abs=0.05)


def test_a_clock_that_is_right_to_50_ppm_has_the_commanded_frequencies():
    segments = segments_of_practice(Practice(clock=1 + 5e-5))

    assert {s.frequency_hz for s in segments} == {1.0, 2.0, 3.0}


# ---- Other protocols than the stated one


@pytest.mark.parametrize(
    ("theta", "message"),
    [
        (57.3 * stepped(), r"328 deg at \d Hz.*1\d\.0 s.*amplitude.*1\.7"),
        (0.0 * stepped(), "angle.*0 deg"),
        ((1e-4 * white_noise(9000, 1)), r"0\.0\d+ deg"),
    ],
    ids=["in degrees", "still", "noise"],
)
def test_a_record_without_the_commanded_sines_is_refused_with_what_it_is(theta, message):
    with refused_with(message):
        segments_of(theta)


def test_sines_of_another_protocol_are_taken_by_their_own_amplitudes():
    """Of a size a bench loses some: 7.9 deg counts as 8."""
    sizes_deg = [8.02, 4.01, 7.9, 0.34]
    rest = np.zeros(500)
    pieces = [rest]
    for size_deg, frequency in zip(sizes_deg, (1.5, 2.5, 3.5, 4.5), strict=True):
        sine = unit_block(SteppedSineProtocol((1,), (frequency,), 6), RATE)
        pieces.extend([np.deg2rad(size_deg) * sine, rest])

    segments = segments_of(np.concatenate(pieces), SteppedSineProtocol((0.02, 0.04), (2.0, 4.0), 6))

    assert [round(np.rad2deg(s.commanded), 6) for s in segments] == [8, 4, 8, 0.34]
    assert [s.cycles for s in segments] == [6, 6, 6, 6]


def test_amplitudes_a_quarter_apart_are_two_without_a_rest_between():
    protocol = SteppedSineProtocol((0.08, 0.1), (2.0,), 8)

    segments = segments_of(stepped(protocol, rests=(0.0, 1.0)), protocol)

    assert [(segment.commanded, segment.cycles) for segment in segments] == [(0.08, 8), (0.1, 8)]


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


# ---- Segments


# of 83.3 rows a cycle, and of 125
TWO_SEGMENTS = [
    Segment(0.1, 3.0, start=100, stop=1100, cycles=12, commanded=0.1),
    Segment(0.1, 2.0, start=1100, stop=1600, cycles=4, commanded=0.1),
]


def test_cycles_near_a_gap_are_left_out():
    """Row 550 is in the fifth of ten cycles. The first cycle of a segment begins at a whole row;
    the others are not rounded."""
    groups = cycles_of(TWO_SEGMENTS, 1, np.arange(2000) != 550)

    of_first = 183 + 250 / 3 * np.delete(np.arange(10), 4)
    np.testing.assert_allclose(groups.first, [*of_first, 1225, 1350], atol=1e-9)
    np.testing.assert_allclose(groups.stop - groups.first, [*[250 / 3] * 9, 125, 125])


# ---- Stepped sines and other motions


SIX = SteppedSineProtocol(tuple(np.deg2rad([2.0, 4.0, 6.0])), (1.0, 2.0, 3.0, 4.0, 5.0), 8)


NOISE = 1e-5


def is_stepped(theta, seed, protocol=SIX):
    """What a motion is taken for, with the noise of an encoder."""
    noisy = theta + NOISE * white_noise(len(theta), seed)
    moving = moving_bins(noisy, FINE, NOISE)
    return find_sines(noisy, FINE, NOISE, moving, protocol)[1]


def test_a_joint_moves_by_eight_noises_and_not_by_one():
    time = np.arange(0, 10, 1 / FINE)
    sine = np.where(time < 5, 0, 8 * np.sin(8 * np.pi * time))

    moving = moving_bins(NOISE * (sine + white_noise(len(time), 1)), FINE, NOISE)

    assert np.mean(moving == (time >= 5)) > 0.99


@pytest.mark.parametrize(("duration_s", "moves"), [(8, True), (16, False)])
def test_a_joint_moves_that_turns_by_a_thirtieth_and_not_by_a_sixtieth(duration_s, moves):
    """Of its range, in a quarter of a second."""
    ramp = np.linspace(0, 1, round(duration_s * FINE))

    assert (moving_bins(ramp, FINE, 0.0) == moves).all()


@pytest.mark.parametrize(("change", "stepped"), [(0.007, True), (0.015, False)])
def test_a_sine_has_one_frequency_in_both_halves(change, stepped):
    turns = np.linspace(0, 10, 1250)  # 10 cycles of 2 Hz
    theta = 0.05 * np.sin(2 * np.pi * (turns + change * turns * (turns / 10 - 1)))

    assert is_stepped(theta, 1, SteppedSineProtocol((0.05,), (2.0,))) == stepped


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


def test_sines_whose_ends_a_bench_smooths_are_still_pure():
    """Along a quintic, within a third of a cycle: that makes a tenth of eight cycles' RMS."""
    pieces = [np.zeros(250)]
    for frequency in (1.0, 2.0, 3.0, 4.0):
        cycle = np.arange(0, 8, frequency / FINE)
        from_end = np.clip(np.minimum(cycle, 8 - cycle) / 0.35, 0, 1)
        size = from_end**3 * (10 - 15 * from_end + 6 * from_end**2)
        pieces.extend([0.1 * size * np.sin(2 * np.pi * cycle), np.zeros(175)])

    assert is_stepped(np.concatenate(pieces), seed=6, protocol=SteppedSineProtocol((), ()))


@pytest.mark.parametrize("move", [multisine, noise, chirp])
@pytest.mark.parametrize("band", [(0.5, 3.0), (0.5, 10.0), (0.2, 2.0)])
def test_multisine_noise_and_sweep_are_other_motions(move, band):
    _, (theta, *_) = move(np.random.default_rng(1), band=band)

    assert not is_stepped(np.deg2rad(4) * theta / theta.max(), seed=1)


STEPS = np.repeat(np.random.default_rng(2).choice([-0.06, 0.06], 400), 50)


@pytest.mark.parametrize(
    "theta",
    [
        0.09 * signal.sawtooth(0.6 * np.pi * np.arange(0, 40, 1 / FINE), 0.5),
        np.convolve(STEPS, np.hanning(25) / 12, "same"),
        np.convolve(0.06 * np.sign(SOUND), np.hanning(9) / 4, "same"),
    ],
    ids=["ramps", "binary", "squares"],
)
def test_ramps_squares_and_a_binary_sequence_are_other_motions(theta):
    assert not is_stepped(theta, seed=2)
