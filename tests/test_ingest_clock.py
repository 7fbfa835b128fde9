"""Two clocks: offset and drift of a log against motion capture, by edges of a shared line or by a
shared movement."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, freqz, lfilter

from osl_analysis.errors import InputError
from osl_analysis.ingest.clock import (
    Edges,
    correlate_clocks,
    find_edges,
    fit_clock,
    gate_fit,
    independent_samples,
)

OFFSET = -3.2  # [s] of the logger's clock
DRIFT = 50e-6  # of the logger's clock
SLAVE_RATE = 500.0  # [Hz] of the logger
MASTER_RATE = 1500.0  # [Hz] of motion capture


def irregular(duration: float, seed: int = 0) -> np.ndarray:
    """Times [s] of level changes, 0.06 to 0.25 s apart."""
    return np.cumsum(np.random.default_rng(seed).uniform(0.06, 0.25, int(duration / 0.155)))


def level(changes: np.ndarray, time: np.ndarray) -> np.ndarray:
    return (np.searchsorted(changes, time, side="right") % 2).astype(float)


def slave_edges(changes: np.ndarray, duration: float, offset: float = OFFSET) -> Edges:
    """As a logger on its own clock sees them: a logic level, sampled."""
    time = np.arange(0, duration - OFFSET + 1, 1 / SLAVE_RATE) + OFFSET
    at, rising, step = find_edges(time, level(changes, (1 + DRIFT) * time))
    return at - offset, rising, step


def master_edges(changes: np.ndarray, duration: float) -> Edges:
    """As motion capture sees them: a noisy voltage."""
    time = np.arange(0, duration, 1 / MASTER_RATE)
    return find_edges(
        time,
        5.0 * level(changes, time) + 0.02 * np.random.default_rng(1).standard_normal(time.size),
    )


def spoilt(edges: Edges, rng: np.random.Generator) -> Edges:
    """Edges of which 2 % are missing and 1.5 % are late by up to 50 ms, with 1.5 % false edges
    added."""
    (time, rising, step), draw = edges, rng.random(edges[0].size)
    late = time + np.where(draw > 0.985, rng.uniform(0.005, 0.05, draw.size), 0)
    extra = rng.uniform(time[0], time[-1], round(0.015 * draw.size))
    every = np.concatenate([late[draw > 0.02], extra])
    order = np.argsort(every)
    return (
        every[order],
        np.concatenate([rising[draw > 0.02], rng.random(extra.size) > 0.5])[order],
        step,
    )


@pytest.mark.parametrize("duration", [3.0, 30.0, 300.0])
def test_recovers_offset_and_drift_within_what_sampling_allows(duration: float) -> None:
    changes = irregular(duration)
    fit = fit_clock(slave_edges(changes, duration), master_edges(changes, duration))
    sampling, time = (
        np.hypot(1 / SLAVE_RATE, 1 / MASTER_RATE) / np.sqrt(12),
        np.array([0.0, duration / 2, duration]),
    )
    error = fit.to_master(time - OFFSET) - (1 + DRIFT) * time
    # at its ends a line is twice as uncertain
    assert abs(error).max() < 4 * 2 * sampling / np.sqrt(fit.edges)
    assert abs(fit.drift - DRIFT) < 4 * fit.drift_error
    assert (fit.drift_error > 50e-6) == (duration == 3.0)  # a short recording cannot tell the drift
    assert fit.drift_error == pytest.approx(
        1 / np.hypot(duration * np.sqrt(fit.edges / 12) / sampling, 1e4), rel=0.15
    )
    assert (fit.residual, fit.excluded_edges) == (pytest.approx(sampling, rel=0.4), 0)


@pytest.mark.parametrize("offset", [-812.3456, 0.00071])
def test_offset_and_drift_come_back_although_a_twentieth_of_edges_are_bad(
    offset: float,
) -> None:
    changes, rng = irregular(300.0), np.random.default_rng(7)
    slave, master = slave_edges(changes, 300.0, offset), master_edges(changes, 300.0)
    fit, time = fit_clock(spoilt(slave, rng), spoilt(master, rng)), np.array([0.0, 150.0, 300.0])
    assert abs(fit.to_master(time - offset) - (1 + DRIFT) * time).max() < 0.1 / SLAVE_RATE
    assert (fit.drift, 0.02 < fit.excluded_edges / fit.edges < 0.15) == (
        pytest.approx(DRIFT, abs=1e-6),
        True,
    )
    assert (
        fit_clock((slave[0] + rng.normal(0, 1e-3, slave[0].size), *slave[1:]), master).residual
        < 1 / SLAVE_RATE
    )


def test_edges_that_are_a_few_standard_deviations_late_take_no_part_in_the_clock() -> None:
    """One edge in ten by two samples, seven standard deviations: with them the offset is wrong by
    0.4 ms."""
    changes = irregular(30.0)
    (time, *levels), master = slave_edges(changes, 30.0), master_edges(changes, 30.0)
    late = time + np.where(np.arange(time.size) % 10 == 5, 2.1 / SLAVE_RATE, 0.0)
    fit, sound = fit_clock((late, *levels), master), fit_clock((time, *levels), master)
    assert fit.excluded_edges == pytest.approx(time.size / 10, abs=2)  # but those at its ends
    assert fit.to_master(15.0) == pytest.approx(sound.to_master(15.0), abs=2e-4)


def test_edges_are_found_between_samples_and_noise_at_the_mid_level_makes_none() -> None:
    time = np.arange(0, 1, 1e-3)
    at, rising, _ = find_edges(time, np.clip((time - 0.4003) / 0.02 + 0.5, 0, 1) * 5)
    np.testing.assert_allclose(at, [0.4003], atol=1e-9)
    assert rising.tolist() == [True]
    logic = find_edges(np.array([0.0, 2.0, 4.0, 6.0]), np.array([0.0, 0.0, 1.0, 0.0]))
    assert (logic[0].tolist(), logic[1].tolist()) == ([3.0, 5.0], [True, False])
    assert find_edges(np.arange(5.0), np.full(5, 3.3))[0].size == 0
    last_bit = 0.0024 * np.random.default_rng(0).integers(0, 2, 200)
    assert find_edges(np.arange(200.0), 4.93 + last_bit)[0].size == 0
    assert find_edges(np.arange(200.0), last_bit)[0].size == 0
    noisy = find_edges(np.arange(9.0), np.array([0, 0, 3.4, 1.6, 2.4, 2.7, 5, 5, 5]))
    assert (noisy[0].tolist(), noisy[1].tolist()) == ([pytest.approx(4 + 1 / 3)], [True])


PERIODIC = np.arange(0.5, 10, 0.25)
SHORT = irregular(3.0)
LONG = irregular(30.0)
TIMES, *LEVELS = slave_edges(LONG, 30.0)
# by more than a sample
SCATTERED = TIMES + np.random.default_rng(3).normal(0, 0.004, TIMES.size), *LEVELS


@pytest.mark.parametrize(("in_log", "in_capture", "message"), [
    (slave_edges(PERIODIC, 10.0), master_edges(PERIODIC, 10.0), "let the pulses vary in length"),
    (slave_edges(irregular(3.0, 4), 3.0), master_edges(irregular(3.0, 5), 3.0),
     "sync edges of the log agree .* on one offset"),
    (slave_edges(SHORT, 3.0), master_edges(SHORT[:4], 3.0),
     "[0-4] sync edges of the log agree"),
    (slave_edges(SHORT[:0], 3.0), master_edges(SHORT, 3.0), "0 sync edges of the log"),
    (SCATTERED, master_edges(LONG, 30.0), "the sync edges fit with a residual of"),
])  # fmt: skip
def test_pulses_that_tell_no_one_clock_are_refused(
    in_log: Edges, in_capture: Edges, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        fit_clock(in_log, in_capture)


CAMERA_RATE = 300.0
KNOTS = np.arange(-120.0, 450.0, 0.15)
# never repeats itself
MOVEMENT = make_interp_spline(KNOTS, np.random.default_rng(9).standard_normal(KNOTS.size))


@pytest.mark.parametrize("offset", [-100.0, 0.1234])
def test_an_encoder_and_markers_give_offset_and_drift_to_a_tenth_of_a_sample(offset: float) -> None:
    """The encoder's clock is behind by the offset [s]; its sign, scale and zero are others, and
    both have noise."""
    rng, slave = np.random.default_rng(0), np.arange(0, 300.0 - min(offset, 0), 1 / SLAVE_RATE)
    encoder = (
        3.0 - 2 * MOVEMENT(offset + (1 + DRIFT) * slave) + 0.02 * rng.standard_normal(slave.size)
    )
    master = np.arange(0, 300.0, 1 / CAMERA_RATE)
    fit = correlate_clocks(
        (slave, encoder), (master, MOVEMENT(master) + 0.01 * rng.standard_normal(master.size))
    )
    time = np.array([10.0, 150.0, 290.0]) - offset
    assert abs(fit.to_master(time) - (offset + (1 + DRIFT) * time)).max() < 0.1 / SLAVE_RATE
    assert abs(fit.drift - DRIFT) < 4 * fit.drift_error < 4e-6
    assert fit.residual < 0.1 / SLAVE_RATE
    assert fit.method == "correlation"


WITHIN = np.arange(0, 30, 1 / CAMERA_RATE)


@pytest.mark.parametrize(("strange", "seen", "message"), [
    (np.random.default_rng(3).standard_normal(9000), MOVEMENT(WITHIN),
     r"fits (else|no)where.* times as likely; check that both channels"),
    (np.zeros(9000), MOVEMENT(WITHIN), "is constant"),
    (MOVEMENT(WITHIN[:40]), MOVEMENT(WITHIN), "fewer than 48 samples"),
    (np.sin(2 * np.pi * WITHIN), np.sin(2 * np.pi * WITHIN + 1),
     r"fits elsewhere, \S+ s from the best place, 1 times as likely"),
])  # fmt: skip
def test_signals_that_do_not_show_the_same_movement_throughout_are_refused(strange, seen, message):
    with pytest.raises(InputError, match=message):
        correlate_clocks((np.arange(strange.size) / CAMERA_RATE, strange), (WITHIN, seen))


def test_one_movement_tells_the_offset_and_crystals_the_drift() -> None:
    rng = np.random.default_rng(4)
    once = np.exp(-((WITHIN - 10) ** 2)) * MOVEMENT(WITHIN)

    fit = correlate_clocks(
        (WITHIN + OFFSET, once + 0.01 * rng.standard_normal(once.size)),
        (WITHIN, once + 0.01 * rng.standard_normal(once.size)),
    )

    assert fit.to_master(10 + OFFSET) == pytest.approx(10, abs=4e-4)
    assert abs(fit.drift) < 4 * fit.drift_error < 3e-4


def strides(duration: float, variability: float) -> tuple[np.ndarray, np.ndarray]:
    """An angle of which each second is like the others, but for what varies."""
    time = np.arange(0, duration, 1 / CAMERA_RATE)
    return time, np.sin(2 * np.pi * time) + variability * MOVEMENT(time)


def test_strides_that_differ_a_little_are_told_apart_by_their_likelihood() -> None:
    """Their correlation one stride later is 0.99 of that at the right place."""
    time, angle = strides(30.0, variability=0.05)
    noise = 0.01 * np.random.default_rng(2).standard_normal(6000)

    fit = correlate_clocks((time, angle), (time[:6000], angle[1500:7500] + noise))

    assert fit.offset == pytest.approx(-1500 / CAMERA_RATE, abs=0.1 / CAMERA_RATE)
    assert 0 <= fit.second_place < 1e-3


def test_strides_that_hardly_differ_are_refused_with_what_would_tell_them() -> None:
    time, angle = strides(5.0, variability=0.004)
    noise = 0.05 * np.random.default_rng(2).standard_normal(time.size)

    with pytest.raises(InputError, match="record longer, with one that does not repeat"):
        correlate_clocks((time, angle), (time, angle + noise))


GATE_S = 4.0  # of each capture
GATES = np.array([5.0, 15.0, 30.0])  # starts in the log


def gate_pulses() -> Edges:
    time = np.arange(0, 40, 1 / SLAVE_RATE)
    is_high = [(time >= start) & (time < start + GATE_S) for start in GATES]
    return find_edges(time, np.any(is_high, axis=0).astype(float))


def steps_of(size: float) -> tuple[np.ndarray, np.ndarray]:
    """An angle that moves alike in each capture, and by `size` more in each further one."""
    time = np.arange(0, 40, 1 / SLAVE_RATE)
    local = [np.clip(time - start, 0, GATE_S) for start in GATES]
    each = [np.sin(np.pi * at / 2) + size * k * np.sin(np.pi * at) for k, at in enumerate(local)]
    return time, np.sum(each, axis=0)


CAPTURE = np.arange(0, GATE_S, 1 / MASTER_RATE)


def test_a_gate_is_the_pulse_whose_angle_the_capture_has() -> None:
    log = steps_of(size=0.1)
    noise = 0.01 * np.random.default_rng(0).standard_normal(CAPTURE.size)
    seen = 30 - 2 * np.interp(GATES[1] + CAPTURE, *log) + noise

    at_rest = log[0], np.where(log[0] < GATES[1] - 1, 0.2, log[1])  # in the first gate

    for angle in (log, at_rest):
        fit = gate_fit(gate_pulses(), CAPTURE, lambda ours=angle: (ours, (CAPTURE, seen)))

        assert fit.offset == pytest.approx(-GATES[1], abs=1 / SLAVE_RATE)
        assert fit.method == "gate"


def test_gates_that_no_angle_tells_apart_are_refused() -> None:
    log = steps_of(size=0.0)
    noise = 0.01 * np.random.default_rng(0).standard_normal(CAPTURE.size)
    seen = np.interp(GATES[1] + CAPTURE, *log) + noise

    with pytest.raises(InputError, match="3 pulses of the log are as long as the capture"):
        gate_fit(gate_pulses(), CAPTURE)
    with pytest.raises(InputError, match=r"fits elsewhere, .* 1 times as likely"):
        gate_fit(gate_pulses(), CAPTURE, lambda: (log, (CAPTURE, seen)))


LOW_PASS = butter(4, 0.1)
SPECTRUM = np.abs(freqz(*LOW_PASS, worN=2**16)[1]) ** 2


@pytest.mark.parametrize(
    ("noise_filter", "share"),
    [
        (([1.0], [1.0]), 1.0),
        (([1.0], [1.0, -0.8]), (1 - 0.8**2) / (1 + 0.8**2)),
        (LOW_PASS, SPECTRUM.mean() ** 2 / (SPECTRUM**2).mean()),
    ],
)
def test_independent_samples_are_those_of_the_spectrum(noise_filter, share):
    n = 400_000
    noise = lfilter(*noise_filter, np.random.default_rng(0).standard_normal(n))

    assert independent_samples(noise) == pytest.approx(share * n, rel=0.03)
