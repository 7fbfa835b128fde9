# SPDX-License-Identifier: Apache-2.0
"""Two clocks: offset and drift of a log against motion capture, by edges of a shared line."""

import numpy as np
import pytest
from conftest import refused_with, white_noise

from osl_analysis.ingest.clock import (
    Edges,
    find_edges,
    fit_clock,
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


def slave_edges(changes: np.ndarray, duration: float) -> Edges:
    """As a logger on its own clock sees them: a logic level, sampled."""
    time = np.arange(0, duration - OFFSET + 1, 1 / SLAVE_RATE) + OFFSET
    edges = find_edges(time, level(changes, (1 + DRIFT) * time))
    return edges._replace(time=edges.time - OFFSET)


def master_edges(changes: np.ndarray, duration: float) -> Edges:
    """As motion capture sees them: a noisy voltage."""
    time = np.arange(0, duration, 1 / MASTER_RATE)
    return find_edges(
        time,
        5.0 * level(changes, time) + 0.02 * white_noise(time.size, 1),
    )


@pytest.mark.parametrize("duration", [3.0, 30.0, 300.0])
def test_recovers_offset_and_drift_within_what_sampling_allows(duration: float) -> None:
    changes = irregular(duration)
    fit = fit_clock(slave_edges(changes, duration), master_edges(changes, duration))
    sampling = np.hypot(1 / SLAVE_RATE, 1 / MASTER_RATE) / np.sqrt(12)
    time = np.array([0.0, duration / 2, duration])
    error = fit.to_master(time - OFFSET) - (1 + DRIFT) * time
    # at its ends a line is twice as uncertain
    assert abs(error).max() < 4 * 2 * sampling / np.sqrt(fit.edges)
    told = duration * np.sqrt(fit.edges / 12) / sampling  # of the drift, beside its usual size
    assert abs(fit.drift - DRIFT) < 4 / np.hypot(told, 1e4)
    assert fit.residual == pytest.approx(sampling, rel=0.4)


def test_edges_that_are_two_samples_late_take_no_part_in_the_clock() -> None:
    """One in ten: with them the offset is wrong by 0.4 ms."""
    changes = irregular(30.0)
    edges = slave_edges(changes, 30.0)
    is_late = np.arange(edges.time.size) % 10 == 5
    late = edges._replace(time=edges.time + is_late * 2.1 / SLAVE_RATE)
    master = master_edges(changes, 30.0)

    fit = fit_clock(late, master)

    assert fit.to_master(15.0) == pytest.approx(fit_clock(edges, master).to_master(15.0), abs=2e-4)


def test_edges_lie_between_samples_and_noise_at_mid_level_makes_none() -> None:
    time = np.arange(0, 1, 1e-3)
    at, rising, _ = find_edges(time, np.clip((time - 0.4003) / 0.02 + 0.5, 0, 1) * 5)
    np.testing.assert_allclose(at, [0.4003], atol=1e-9)
    assert rising.tolist() == [True]
    last_bit = 0.0024 * np.random.default_rng(0).integers(0, 2, 200)
    assert find_edges(np.arange(200.0), 4.93 + last_bit)[0].size == 0
    noisy = find_edges(np.arange(9.0), np.array([0, 0, 3.4, 1.6, 2.4, 2.7, 5, 5, 5]))
    assert (noisy[0].tolist(), noisy[1].tolist()) == ([3.5], [True])


PERIODIC = np.arange(0.5, 10, 0.25)
SHORT = irregular(3.0)
LONG = irregular(30.0)
SOUND = slave_edges(LONG, 30.0)
# by more than a sample
SCATTERED = SOUND._replace(time=SOUND.time + 0.004 * white_noise(SOUND.time.size, 3))


@pytest.mark.parametrize(
    ("in_log", "in_capture", "message"),
    [
        (slave_edges(PERIODIC, 10.0), master_edges(PERIODIC, 10.0), "pulses vary"),
        (slave_edges(irregular(3.0, 4), 3.0), master_edges(irregular(3.0, 5), 3.0), "0 runs.* "),
        (slave_edges(SHORT, 3.0), master_edges(SHORT[:4], 3.0), "[0-4] runs.* "),
        (SCATTERED, master_edges(LONG, 30.0), r" 2\.00 ms"),
    ],
)
def test_pulses_that_tell_no_one_clock_are_refused(
    in_log: Edges, in_capture: Edges, message: str
) -> None:
    with refused_with(message):
        fit_clock(in_log, in_capture)
