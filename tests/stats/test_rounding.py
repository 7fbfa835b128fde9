# SPDX-License-Identifier: Apache-2.0
"""Numbers are printed with the digits that their intervals allow."""

import pytest

from osl_analysis.stats.rounding import decimal_places, plus_minus


@pytest.mark.parametrize(
    ("value", "interval", "unit", "places"),
    [
        (300.1234, (298.7, 301.5), "N*m/rad", 1),
        (300.1234, (299.99, 300.26), "N*m/rad", 2),
        (0.5, (None, None), "", 3),
        (12.0, (None, None), "", 0),
        (99.914, (None, None), "%", 3),
        (99.914, (None, None), "", 1),
        (98.914, (None, None), "%", 1),
        (12.5, (11.0, None), "", 1),
        (12.5, (None, 14.0), "", 1),
    ],
)
def test_half_of_an_interval_has_two_digits_and_a_number_alone_three(value, interval, unit, places):
    assert decimal_places(value, *interval, unit) == places


@pytest.mark.parametrize(
    ("interval", "text"),
    [
        ((298.7, 301.5), "300.1 ± 1.4"),
        ((298.7, 305.0), "300.1 (298.7 to 305.0)"),
        ((298.7, 301.6), "300.1 ± 1.5"),
        ((None, 301.5), "300.1"),
        ((298.7, None), "300.1"),
    ],
)
def test_a_number_has_half_of_its_interval_where_it_is_in_the_middle(interval, text):
    assert plus_minus(1, 300.1, *interval) == text
