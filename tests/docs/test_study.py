# SPDX-License-Identifier: Apache-2.0
"""The Monte Carlo study of benchmarks/study.py: its bounds and its figures of merit."""

import numpy as np
import polars as pl
import pytest


def test_bound_of_a_sinusoid_is_the_published_one(study):
    """Rife and Boorstyn, IEEE Trans. Inf. Theory 20, 1974: var(A) >= 2 s^2/N and var(phase) >= 2
    s^2/(A^2 N)."""
    N = 1000
    noise = 0.3
    phase = 2 * np.pi * np.arange(1000) / 50
    bound = study.regression_bound(
        {"cos": np.cos(phase), "sin": np.sin(phase), "offset": np.ones(N)}, noise
    )
    expected = {"cos": np.sqrt(2 / N), "sin": np.sqrt(2 / N), "offset": 1 / np.sqrt(N)}
    assert bound == pytest.approx({name: noise * each for name, each in expected.items()})


def test_bias_is_measured_in_standard_deviations_and_coverage_as_a_share(study):
    rows = {
        "value": [1.0, 2.0, 3.0],
        "truth": 0.0,
        "se": 2.0,
        "low": [-1.0, 1.0, 1.0],
        "high": 4.0,
        "bound": 2.0,
    }
    found = study.performance(pl.DataFrame(rows))
    expected = {"bias": 2.0, "coverage": 1 / 3, "bias_mc": 1 / np.sqrt(3), "se_over_sd": 2.0}
    expected |= {"rmse_over_bound": np.sqrt(14 / 12), "coverage_mc": np.sqrt(3 / 7 * 4 / 7 / 7)}
    assert found == pytest.approx(expected)
