"""Ticks of logarithmic axes and of phases, and names that stand apart at the ends of curves."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from matplotlib.text import Text

from osl_analysis.figures.style import (
    apart,
    label_log_axis,
    label_phase_axis,
    log_ticks,
    name_ends,
    paper_style,
    widened,
)


@pytest.mark.parametrize(
    ("low", "high", "most", "expected"),
    [
        (1, 5, 6, [1, 2, 3, 4, 5]),
        (0.5, 6, 8, [0.5, 1, 2, 3, 5]),
        (0.01, 100, 5, [0.01, 0.1, 1, 10, 100]),
        (0.1, 15, 8, [0.1, 0.2, 0.5, 1, 2, 5, 10]),
        (0.8, 4.75, 8, [0.8, 1, 2, 3, 4]),
        (1e-4, 1e5, 5, [1e-4, 1e-2, 1, 1e2, 1e4]),
        (2.9, 3.11, 5, [2.9, 3.0, 3.1]),
    ],
)
def test_ticks_of_a_logarithmic_axis_are_round_whatever_its_span(low, high, most, expected):
    assert log_ticks(low, high, most) == pytest.approx(expected)


@given(st.floats(-6, 6), st.floats(1e-3, 9), st.integers(4, 10))
def test_a_logarithmic_axis_has_two_ticks_or_more_within_its_limits_and_not_too_many(start, decades, most):
    low, high = 10.0**start, 10.0 ** (start + decades)
    ticks = log_ticks(low, high, most)
    assert 2 <= len(ticks) <= most
    assert min(ticks) >= low * (1 - 1e-6)
    assert max(ticks) <= high * (1 + 1e-6)
    assert (np.diff(ticks) > 0).all()


def test_a_single_frequency_stands_in_the_middle_of_its_axis_with_a_tick():
    low, high = widened(3.0, 3.0)
    assert low < 3 < high
    assert 3 / low == pytest.approx(high / 3)
    ax = Figure().subplots()
    ax.set_xscale("log")
    ax.plot([3.0], [1.0], "o")
    label_log_axis(ax.xaxis, (low, high), 6)
    assert ax.get_xlim() == (low, high)
    assert 3.0 in ax.get_xticks()


@pytest.mark.parametrize("phases", [[-10, -70], [12, 80], [-5, 5], [0, 0]])
def test_an_axis_of_phases_has_0_on_it_as_a_tick(phases):
    ax = Figure().subplots()
    ax.plot(phases)
    label_phase_axis(ax)
    low, high = ax.get_ylim()
    assert low < 0 < high
    assert low <= min(phases) <= max(phases) <= high
    assert 0 in np.round(ax.get_yticks(), 9)


@given(st.lists(st.floats(-5, 5), min_size=1, max_size=12), st.floats(0.01, 1))
def test_places_move_apart_in_their_order_and_only_where_they_must(places, gap):
    moved = apart(places, gap)
    order = np.argsort(places, kind="stable")
    steps = np.diff(moved[order])
    assert (steps >= gap - 1e-9).all()
    assert moved.mean() == pytest.approx(np.mean(places), abs=1e-9)
    if len(places) == 1 or np.diff(np.sort(places)).min() >= gap:
        np.testing.assert_allclose(moved, places, atol=1e-9)


def test_two_close_places_move_as_far_either_way():
    np.testing.assert_allclose(apart([1.0, 0.0, 0.2], 1.0), [1.4, -0.6, 0.4])
    np.testing.assert_allclose(apart([1.0, 0.0, 0.2], 1.0, (-0.5, 1.0)), [1.5, -0.5, 0.5])
    np.testing.assert_allclose(apart([1.0, 0.0, 0.2], 0.5, (0.0, 1.0)), [1.0, 0.0, 0.5])


@paper_style()
def test_names_at_the_ends_of_equal_curves_do_not_overlap():
    figure = Figure(figsize=(3.5, 2), layout="constrained")
    ax = figure.subplots()
    ax.plot([0, 1], [0, 5])
    limits = ax.get_ylim()
    name_ends(ax, [(1.0, 5.0)] * 8, [f"trial_{k}" for k in range(8)], ["black"] * 8)
    figure.draw_without_rendering()
    assert ax.get_ylim() == limits
    boxes = [Text.get_window_extent(text) for text in ax.texts]
    assert all(one.y1 < other.y0 for one, other in pairwise(sorted(boxes, key=lambda box: box.y0)))
