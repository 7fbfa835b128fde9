# SPDX-License-Identifier: Apache-2.0
"""The Monte Carlo study of benchmarks/study.py: its bounds, and what it says of estimators."""

import sys

import numpy as np
import polars as pl
import pytest
from conftest import ROOT

sys.path.insert(0, str(ROOT / "benchmarks"))  # as for a script there
import study

sys.path.pop(0)


def test_bound_of_a_sinusoid_is_the_published_one():
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


def test_bias_is_measured_in_standard_deviations_and_coverage_as_a_share():
    """Three estimates of 0 with a standard deviation of 1; one interval of three holds 0."""
    trials = pl.DataFrame(
        {
            "value": [1.0, 2.0, 3.0],
            "truth": 0.0,
            "se": 2.0,
            "low": [-1.0, 1.0, 1.0],
            "high": 4.0,
            "bound": 2.0,
        }
    )

    assert study.performance(trials) == pytest.approx(
        {
            "bias": 2.0,
            "bias_mc": 1 / np.sqrt(3),
            "rmse_over_bound": np.sqrt((1 + 4 + 9) / 3) / 2.0,
            "se_over_sd": 2.0,
            "coverage": 1 / 3,
            "coverage_mc": np.sqrt(3 / 7 * 4 / 7 / 7),  # Agresti and Coull: 1 + 2 of 3 + 4
        }
    )
