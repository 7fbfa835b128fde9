"""Axes have round ticks within their limits, and looks are told apart in grey and without medium-wavelength cones."""

import importlib.util
from itertools import combinations, pairwise

import numpy as np
import polars as pl
import pytest
from conftest import ROOT
from matplotlib.figure import Figure
from matplotlib.text import Text

from osl_analysis.figures import names, style


def test_ticks_are_round_a_single_frequency_is_in_the_middle_of_its_axis_and_0_on_one_of_phases():
    for low, high, most, expected in (
        (1, 5, 6, [1, 2, 3, 4, 5]), (0.5, 6, 8, [0.5, 1, 2, 3, 5]), (0.01, 100, 5, [0.01, 0.1, 1, 10, 100]),
        (0.1, 15, 8, [0.1, 0.2, 0.5, 1, 2, 5, 10]), (1e-4, 1e5, 5, [1e-4, 1e-2, 1, 1e2, 1e4]),
        (2.9, 3.11, 5, [2.9, 3.0, 3.1]),
    ):  # fmt: skip
        assert style.log_ticks(low, high, most) == pytest.approx(expected)
    for phases in ([-10, -70], [12, 80], [0, 0]):
        ax = Figure().subplots()
        ax.plot(phases)
        style.label_frequency_axis(ax, pl.Series([3.0]), 6)
        style.label_phase_axis(ax)
        (low, high), (lowest, highest) = ax.get_xlim(), ax.get_ylim()
        assert 1 < 3 / low == pytest.approx(high / 3)
        assert lowest < 0 < highest
        assert lowest <= min(phases) <= max(phases) <= highest
        assert (3.0 in ax.get_xticks(), 0 in np.round(ax.get_yticks(), 9)) == (True, True)


@style.paper_style()
def test_names_at_the_ends_of_curves_do_not_overlap_and_stay_at_their_ends_where_there_is_room():
    figure = Figure(figsize=(3.5, 2), layout="constrained")
    ax = figure.subplots()
    ax.plot([0, 1], [0, 5])
    limits = ax.get_ylim()
    heights = [5.0, 5.0, 5.0, 5.0, 1.0, 2.5]
    style.name_ends(ax, [(f"trial_{k}", f"trial_{k}", "black", (1.0, y)) for k, y in enumerate(heights)])
    figure.draw_without_rendering()
    assert ax.get_ylim() == limits
    boxes = sorted((Text.get_window_extent(text) for text in ax.texts), key=lambda box: box.y0)
    assert all(one.y1 < other.y0 for one, other in pairwise(boxes))
    places = [text.xyann[1] for text in ax.texts]
    assert (places[:2], places) == (pytest.approx([1.0, 2.5]), sorted(places))
    assert places[-1] <= limits[1]


SPEC = importlib.util.spec_from_file_location("figure_views", ROOT / "benchmarks/figure_views.py")
views = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(views)


def every_look(others):
    """Desired, the draft's controllers, this number of others, and no controller."""
    controllers = ["compensated", "uncompensated", *(f"c{number}" for number in range(others)), None]
    numbers = pl.Series("look", [None, None, *range(others), None], dtype=pl.Int64)
    looks = names.looks_in(pl.DataFrame({"controller": controllers}).with_columns(numbers))
    return [style.Look(style.BLACK, "", 0, "Desired"), *looks.values()]


def test_looks_differ_in_grey_by_lightness_or_by_marker_and_line_and_in_deuteranopia_by_colour_too():
    """By 15 of lightness L*, and 20 of Delta E (CIE 1976) with deuteranopia; 2 is just seen in large fields."""
    for one, other in combinations(every_look(len(names.COLOURS)), 2):
        if abs(views.lightness(one.colour) - views.lightness(other.colour)) < 15:
            assert one.marker != other.marker, (one, other)
            assert one.dash != other.dash, (one, other)
        if names.NO_CONTROLLER not in (one, other):  # a grey, whose marker and line are its own
            assert views.distance(one.colour, other.colour) > 20, (one, other)
    assert max(views.lightness(look.colour) for look in every_look(0)) < 62, "three to one against paper"
    assert len({(look.colour, look.marker) for look in every_look(12)}) == 16, "more controllers than colours"
    assert names.looks_in(pl.DataFrame({"controller": ["c1"], "look": [1]}))["c1"] == every_look(2)[4], "one meaning"
    assert names.look_numbers(pl.Series(["pd", "compensated", "a", None])).to_list() == [1, None, 0, None]
    assert names.drawn_name(20 * "a" + 20 * "b") == 18 * "a" + "…" + 9 * "b"


def test_greys_stay_and_published_numbers_of_lightness_and_colour_distance_are_met():
    """L* of mid grey #777777 is 50.03; sRGB red has L*a*b* 53.24, 80.09, 67.20 (Lindbloom, white D65)."""
    greys = np.repeat(np.linspace(0, 1, 5)[:, None], 3, axis=1)
    np.testing.assert_allclose(views.with_deuteranopia(greys), greys, atol=1e-6)
    np.testing.assert_allclose(views.in_grey(greys), greys, atol=1e-6)
    assert views.lightness("#777777") == pytest.approx(50.03, abs=0.01)
    np.testing.assert_allclose(views.lab(np.array([1.0, 0, 0])), [53.24, 80.09, 67.20], atol=0.02)
    assert views.distance("#C04040", "#3F8840") < 15, "a red and a green of one lightness"
