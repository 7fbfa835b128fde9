"""Quantiles that are found among a tenth of the values are those of all values, beside numpy's."""

import numpy as np
import pytest

from osl_analysis import quantiles
from osl_analysis.quantiles import median, quantile

RANDOM = np.random.default_rng(1)
VALUES = {
    "noise": RANDOM.standard_normal(20_001),
    "a sine": np.sin(0.01 * np.arange(20_000)),
    "ties": np.round(RANDOM.standard_normal(20_000)),
    "all alike": np.full(5000, 0.1),
    "rising": np.arange(30_011.0),
    "not like every tenth": np.where(np.arange(20_480) % 10 == 0, 1e3, np.arange(20_480)),
    "few": RANDOM.standard_normal(7),
    "two": np.array([3.0, -1.0]),
    "one": np.array([2.0]),
}


@pytest.mark.parametrize("name", VALUES)
@pytest.mark.parametrize("share", [0.0, 0.05, 0.5, 0.9, 0.95, 1.0])
def test_a_quantile_is_that_of_all_values(name, share):
    values = VALUES[name]
    before = values.copy()
    assert quantile(values, share) == pytest.approx(float(np.quantile(values, share)), rel=1e-14, abs=1e-14)
    assert median(values) == pytest.approx(float(np.median(values)), rel=1e-14, abs=1e-14)
    np.testing.assert_array_equal(values, before)


def test_few_of_many_values_are_sorted(monkeypatch):
    sorted_at_once, partition = [], np.partition

    def counted(values, places):
        sorted_at_once.append(len(values))
        return partition(values, places)

    monkeypatch.setattr(quantiles.np, "partition", counted)
    median(VALUES["noise"])
    assert sorted_at_once[0] < 0.15 * len(VALUES["noise"])
