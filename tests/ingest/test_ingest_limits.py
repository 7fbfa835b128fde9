# SPDX-License-Identifier: Apache-2.0
"""Where the limits of reading a recording stand: what passes, and what is just beyond.

The values are stated here and not taken from the limits, so that a limit that is doubled no longer
parts them.
"""

from types import SimpleNamespace

import numpy as np
import pytest
import scipy
from conftest import refused_with, white_noise

from osl_analysis.base.recording import Rows
from osl_analysis.ingest.capture import vertical_axis
from osl_analysis.ingest.clock import (
    Edges,
    find_edges,
    fit_clock,
    gate_fit,
    shared_variance,
    short_means,
)
from osl_analysis.ingest.conversion import fresh_rows
from osl_analysis.ingest.likely_clock import ticks, time_unit
from osl_analysis.ingest.message_log import count_late

# Pulses that two recorders share


@pytest.mark.parametrize(("swing", "has_edges"), [(0.30, True), (0.20, False)])
def test_a_line_that_changes_by_less_than_a_twentieth_of_its_level_has_no_edges(swing, has_edges):
    square = np.repeat([0.0, 1.0, 0.0, 1.0], 50)

    edges = find_edges(np.arange(200.0), 5.0 - swing * square)

    assert bool(edges.time.size) == has_edges


@pytest.mark.parametrize(("samples", "has_edges"), [(6, True), (4, False)])
def test_a_line_with_an_edge_every_fifth_sample_or_more_often_is_no_pulse_train(samples, has_edges):
    square = np.arange(240) // samples % 2

    edges = find_edges(np.arange(240.0), square.astype(float))

    assert bool(edges.time.size) == has_edges


CHANGES = np.cumsum(np.random.default_rng(0).uniform(0.06, 0.25, 60))  # [s]


def edges_at(times: np.ndarray) -> Edges:
    return Edges(times, np.arange(times.size) % 2 == 0, 1e-3)


def test_six_edges_that_both_recorded_are_enough_for_a_clock():
    fit = fit_clock(edges_at(CHANGES[:6]), edges_at(CHANGES + 0.5))

    assert fit.offset == pytest.approx(0.5, abs=1e-3)
    with refused_with("3 runs of three sync edges"):
        fit_clock(edges_at(CHANGES[:5]), edges_at(CHANGES + 0.5))


def test_edges_of_clocks_that_drift_by_more_than_crystals_do_do_not_agree():
    """Over 200 s: a drift of 400 ppm is one of crystals, of 1500 ppm not."""
    changes = np.cumsum(np.random.default_rng(0).uniform(0.06, 0.25, 1300))

    fit = fit_clock(edges_at(changes / 1.0004), edges_at(changes))

    assert fit.drift == pytest.approx(4e-4, rel=0.01)
    with refused_with("sync edges"):
        fit_clock(edges_at(changes / 1.0015), edges_at(changes))


@pytest.mark.parametrize(("seconds", "longer_s", "is_gate"), [
    (1.0, 0.005, True), (1.0, 0.010, False),  # three steps of 2 ms
    (100.0, 0.050, True), (100.0, 0.070, False),  # and 500 ppm of the length
])  # fmt: skip
def test_a_gate_is_as_long_as_its_capture_but_for_steps_and_drift(seconds, longer_s, is_gate):
    step = 2e-3
    time = np.arange(0.0, seconds, step)
    pulse = Edges(np.array([5.0, 5.0 + seconds + longer_s]), np.array([True, False]), step)

    if is_gate:
        assert gate_fit(pulse, time).offset == -5.0
    else:
        with refused_with("0 pulses of the log are as long as the capture"):
            gate_fit(pulse, time)


def test_means_of_an_angle_keep_a_sine_of_6_hz():
    time = np.arange(0.0, 4.0, 1e-3)

    at, means = short_means((time, np.sin(2 * np.pi * 6 * time)))

    between = at[2:-3] + np.diff(at)[2:-2] / 2  # where a spline through them is least certain
    spline = scipy.interpolate.CubicSpline(at, means)
    kept = np.sinc(6 * np.median(np.diff(at)))
    assert abs(spline(between) - kept * np.sin(2 * np.pi * 6 * between)).max() < 2e-3


def test_a_match_while_one_recording_hardly_moves_counts_little():
    """Its variance there is a fiftieth of that of the whole, which counts as a twentieth."""
    quiet = white_noise(400, 1) * np.sqrt(0.02)
    moving = white_noise(400, 2) * np.sqrt(2 - 0.02)
    ours = np.concatenate([quiet, moving])
    theirs = ours[:400]

    shared = shared_variance(ours - ours.mean(), theirs - theirs.mean())

    at_its_own_place = shared[ours.size - 1]
    assert at_its_own_place == pytest.approx(quiet.var() / (0.05 * ours.var()), rel=0.02)


# Which axis is vertical


@pytest.mark.parametrize(("slope_deg", "axis"), [(20.0, "z"), (30.0, "")])
def test_a_plate_that_slopes_by_more_than_a_quarter_tells_no_vertical_axis(slope_deg, axis):
    across, up = np.cos(np.deg2rad(slope_deg)), np.sin(np.deg2rad(slope_deg))
    corners = np.array([[1.0, 1, 0], [0, 1, 0], [0, 0, 0], [1, 0, 0]])
    corners = corners @ np.array([[across, 0, up], [0, 1, 0], [-up, 0, across]])

    assert vertical_axis([], [SimpleNamespace(corners=corners)]) == axis


@pytest.mark.parametrize(("share", "axis"), [(0.12, "z"), (0.08, "")])
def test_markers_that_hardly_move_are_of_nobody_who_walks(share, axis):
    heights = np.array([0.0, 0.3, 0.6, 0.9])
    forward = share * heights.std() * np.sqrt(2) * np.sin(np.linspace(0, 20 * np.pi, 2000))
    still = np.zeros_like(forward)
    markers = [
        SimpleNamespace(values=np.column_stack([forward, still, still + height]))
        for height in heights
    ]

    assert vertical_axis(markers, []) == axis


# Stamps of another time


def late_stamps(rows: int, late: int, steps: float) -> np.ndarray:
    """Stamps [s] of which some are late by so many steps of 10 ms."""
    stamps = np.arange(rows) * 0.01
    stamps[rows // 2 : rows // 2 + late] -= steps * 0.01
    return stamps


@pytest.mark.parametrize(("late", "steps", "left_out"), [
    (3, 60, 3), (3, 40, 0),  # fifty steps back
    (4, 100, 4), (6, 100, 0),  # one row of a thousand
])  # fmt: skip
def test_few_rows_far_back_in_time_are_left_out(late, steps, left_out):
    stamps = late_stamps(4500, late, steps)

    places, _ = fresh_rows(Rows("rows", stamps.size), stamps)

    assert stamps.size - places.size == left_out


@pytest.mark.parametrize("in_a_row", [10, 11])
def test_eleven_late_messages_in_a_row_are_a_clock_that_was_set_back(in_a_row):
    stamps = np.arange(100, dtype=np.int64) * 10_000_000
    stamps[50 : 50 + in_a_row] -= 200_000_000

    if in_a_row == 10:
        assert count_late(stamps) == 10
    else:
        with refused_with("time goes back by"):
            count_late(stamps)


# What tells a clock


@pytest.mark.parametrize(("readings", "is_clock"), [(22, True), (20, False)])
def test_twenty_steps_show_whether_a_column_rises_like_a_clock(readings, is_clock):
    assert ticks(np.arange(readings) * 0.01, "s") == is_clock


@pytest.mark.parametrize(("rate_hz", "unit"), [(4000.0, "s"), (6000.0, "")])
def test_a_clock_of_six_kilohertz_has_no_likely_unit(rate_hz, unit):
    assert time_unit(np.arange(100) / rate_hz) == unit
