"""Two campaigns side by side: differences, their intervals, and the verdicts of equivalence."""

import math

import pytest

from osl_analysis.stats.verdicts import equivalence


@pytest.mark.parametrize(("low", "high", "verdict"), [
    (324.0, 348.0, "equivalent"), (323.0, 357.0, "equivalent"), (322.9, 348.0, "undecided"),
    (324.0, 357.1, "undecided"), (300.0, 400.0, "undecided"), (300.0, 322.9, "different"), (357.1, 360.0, "different"),
    (300.0, 323.0, "undecided"), (None, 340.0, None), (340.0, None, None), (math.nan, 340.0, None), (-math.inf, 340.0, None),
])  # fmt: skip
def test_a_verdict_asks_where_the_whole_interval_lies(low, high, verdict):
    assert equivalence(low, high, 340.0, 17.0) == verdict
    mirrored = None if high is None else -high, None if low is None else -low
    assert equivalence(*mirrored, -340.0, 17.0) == verdict
    assert equivalence(low, high, 340.0, None) is None
