"""Looks that share a panel are told apart in a grey print and by readers without medium-wavelength cones."""

import importlib.util
from itertools import combinations
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from PIL import Image

from osl_analysis.errors import InputError
from osl_analysis.figures import names, style

SPEC = importlib.util.spec_from_file_location("figure_views", Path(__file__).parents[1] / "benchmarks/figure_views.py")
assert SPEC is not None
assert SPEC.loader is not None
views = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(views)

LIGHTER, APART = 15, 20
"""Smallest difference in lightness L*, and smallest Delta E (CIE 1976) with deuteranopia, of looks without other marks:
a difference of about 2 is just seen where large fields touch, and markers of 1 mm need several times as much."""


def every_look(others):
    """Desired, the draft's controllers, this number of others, and no controller."""
    controllers = ["compensated", "uncompensated", *(f"c{number}" for number in range(others)), None]
    numbers = [None, None, *range(others), None]
    table = pl.DataFrame(
        {"controller": controllers, "look": numbers}, schema={"controller": pl.String, "look": pl.Int64}
    )
    return [style.LOOKS["desired"], *names.looks_in(table).values()]


def test_looks_differ_in_grey_by_lightness_or_by_marker_and_line_and_in_deuteranopia_by_colour_too():
    for one, other in combinations(every_look(len(names.COLOURS)), 2):
        if abs(views.lightness(one.colour) - views.lightness(other.colour)) < LIGHTER:
            assert one.marker != other.marker, (one, other)
            assert one.dash != other.dash, (one, other)
        if names.NO_CONTROLLER not in (one, other):  # a grey, whose marker and line are its own
            assert views.distance(one.colour, other.colour) > APART, (one, other)


def test_more_controllers_than_colours_have_pairs_of_colour_and_marker_of_their_own():
    looks = every_look(12)
    assert len({(look.colour, look.marker) for look in looks}) == len(looks)


def test_a_red_and_a_green_of_one_lightness_are_one_grey_and_close_with_deuteranopia_unlike_blue_and_orange():
    red, green = "#C04040", "#3F8840"
    assert abs(views.lightness(red) - views.lightness(green)) < 6
    grey = [views.in_grey(np.array(style.mpl.colors.to_rgb(colour))) for colour in (red, green)]
    np.testing.assert_allclose(*grey, atol=0.06)
    assert views.distance(red, green) < 15
    assert views.distance("#3060D0", style.ORANGE) > 80


def test_greys_stay_and_published_numbers_of_lightness_and_colour_distance_are_met():
    """L* of mid grey #777777 is 50.03; sRGB red has L*a*b* 53.24, 80.09, 67.20 (Lindbloom, white D65)."""
    greys = np.repeat(np.linspace(0, 1, 5)[:, None], 3, axis=1)
    np.testing.assert_allclose(views.with_deuteranopia(greys), greys, atol=1e-6)
    np.testing.assert_allclose(views.in_grey(greys), greys, atol=1e-6)
    assert views.lightness("#777777") == pytest.approx(50.03, abs=0.01)
    np.testing.assert_allclose(views.lab(np.array([1.0, 0, 0])), [53.24, 80.09, 67.20], atol=0.02)


def test_a_contact_sheet_has_three_views_at_both_widths_and_other_formats_are_refused(tmp_path):
    Image.new("RGBA", (60, 30), "#E66100FF").save(tmp_path / "f.png")
    sheet = np.asarray(views.contact_sheet(views.picture(tmp_path / "f.png")))
    single, double = (round(inches * views.DPI) for inches in (style.SINGLE_COLUMN, style.DOUBLE_COLUMN))
    inked = (sheet < 255).any(axis=2)
    middle = views.EDGE + views.LETTERS + single // 4
    assert inked[middle].sum() == 3 * single
    assert inked[middle + single // 2 + views.LETTERS + views.EDGE].sum() == 3 * double
    left = views.EDGE + single + views.EDGE
    assert len(set(sheet[middle, left + 5])) == 1, "the second view is grey"
    with pytest.raises(InputError, match=r"f\.pdf: figures are seen as \.png or \.svg"):
        views.picture(tmp_path / "f.pdf")
