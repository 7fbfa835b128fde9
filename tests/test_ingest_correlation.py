"""Clocks without sync edges: a signal that both recorded aligns them, unless it is flat, strange or repeats itself."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from osl_analysis.errors import InputError
from osl_analysis.ingest.clock import Course, correlate_clocks

DRIFT = 50e-6
SLAVE_RATE, MASTER_RATE = 500.0, 300.0
KNOTS = np.arange(-120.0, 450.0, 0.15)
MOVEMENT = make_interp_spline(KNOTS, np.random.default_rng(9).standard_normal(KNOTS.size))  # never repeats itself


def encoder(offset: float, duration: float, drift: float = DRIFT) -> Course:
    """A joint's encoder on a clock that is behind by the offset [s]: of the other sign, scale and zero, with noise."""
    time = np.arange(0, duration, 1 / SLAVE_RATE)
    noise = 0.02 * np.random.default_rng(0).standard_normal(time.size)
    return Course(time, 3.0 - 2 * MOVEMENT(offset + (1 + drift) * time) + noise)


def markers(duration: float, seed: int = 1) -> Course:
    """The same movement as motion capture sees it."""
    time = np.arange(0, duration, 1 / MASTER_RATE)
    return Course(time, MOVEMENT(time) + 0.01 * np.random.default_rng(seed).standard_normal(time.size))


@pytest.mark.parametrize("offset", [-100.0, -3.2, 0.1234, 7.7711])
def test_offset_and_drift_come_back_to_a_tenth_of_a_sample(offset: float) -> None:
    fit = correlate_clocks(encoder(offset, 300.0 - min(offset, 0)), markers(300.0))
    time = np.array([10.0, 150.0, 290.0]) - offset
    assert abs(fit.to_master(time) - (offset + (1 + DRIFT) * time)).max() < 0.1 / SLAVE_RATE
    assert abs(fit.drift - DRIFT) < 4 * fit.drift_error < 4e-6
    assert fit.residual < 0.1 / SLAVE_RATE
    assert fit.method == "correlation"


def test_a_bad_crystal_is_followed_over_a_long_recording() -> None:
    fit = correlate_clocks(encoder(0.5, 300.0, 400e-6), markers(300.0))
    assert fit.drift == pytest.approx(400e-6, abs=2e-6)
    assert fit.edges >= 10


def test_a_lag_is_found_between_the_samples() -> None:
    time = np.arange(0, 60, 1 / MASTER_RATE)
    fit = correlate_clocks(Course(time, MOVEMENT(time + 0.3 / MASTER_RATE)), Course(time, MOVEMENT(time)))
    assert fit.to_master(np.array([30.0])) - 30.0 == pytest.approx(0.3 / MASTER_RATE, abs=0.03 / MASTER_RATE)


def test_a_movement_that_repeats_itself_is_refused_as_ambiguous() -> None:
    time = np.arange(0, 30, 1 / MASTER_RATE)
    with pytest.raises(InputError, match=r"fits in two places \(correlation 1.00 and 1.00\): it repeats itself"):
        correlate_clocks(Course(time, np.sin(2 * np.pi * time)), Course(time, np.sin(2 * np.pi * time + 1)))


def test_one_movement_that_does_not_repeat_makes_it_unambiguous() -> None:
    time = np.arange(0, 30, 1 / MASTER_RATE)

    def gait(t: np.ndarray) -> np.ndarray:
        return np.sin(2 * np.pi * t) + 0.25 * MOVEMENT(t)

    stamp = Course(time, gait(time) + 8 * np.exp(-(((time - 7) / 0.3) ** 2)))
    other = Course(time, gait(time + 2) + 8 * np.exp(-(((time - 5) / 0.3) ** 2)))
    assert correlate_clocks(other, stamp).to_master(np.array([10.0])) == pytest.approx([12.0], abs=1e-3)


@pytest.mark.parametrize(
    ("strange", "message"),
    [
        (np.random.default_rng(3).standard_normal(9000), "correlates by 0.0. at best, 0.5 is needed"),
        (np.zeros(9000), "is constant"),
        (np.zeros(40), "fewer than 48 samples"),
    ],
)
def test_a_signal_that_shows_something_else_is_refused(strange: np.ndarray, message: str) -> None:
    time = np.arange(strange.size) / MASTER_RATE
    with pytest.raises(InputError, match=message):
        correlate_clocks(Course(time, strange), markers(30.0))


def test_movement_in_one_corner_of_the_recording_is_refused_because_it_says_nothing_about_drift() -> None:
    time = np.arange(0, 60, 1 / MASTER_RATE)
    once = np.exp(-(((time - 20) / 2) ** 2)) * MOVEMENT(time)
    with pytest.raises(InputError, match=r"moves in . of 12 sections of the recording, at least 6 are needed"):
        correlate_clocks(Course(time, once), Course(time, once))


def test_lags_that_scatter_more_than_a_sample_are_refused() -> None:
    time = np.arange(0, 60, 1 / MASTER_RATE)
    jumpy = time + 0.02 * np.sin(time / 2)
    with pytest.raises(InputError, match="the lags of the shared signal scatter by"):
        correlate_clocks(Course(time, MOVEMENT(jumpy)), Course(time, MOVEMENT(time)))
