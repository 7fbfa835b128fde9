# SPDX-License-Identifier: Apache-2.0
"""The Monte Carlo study of benchmarks/study.py: its bounds."""

import numpy as np
import pytest
from conftest import ROOT


def test_bound_of_a_sinusoid_is_the_published_one(monkeypatch):
    """Rife and Boorstyn, IEEE Trans. Inf. Theory 20, 1974: var(A) >= 2 s^2/N and var(phase) >= 2
    s^2/(A^2 N)."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    import study

    N = 1000
    noise = 0.3
    phase = 2 * np.pi * np.arange(1000) / 50
    bound = study.regression_bound(
        {"cos": np.cos(phase), "sin": np.sin(phase), "offset": np.ones(N)}, noise
    )
    expected = {"cos": np.sqrt(2 / N), "sin": np.sqrt(2 / N), "offset": 1 / np.sqrt(N)}
    assert bound == pytest.approx({name: noise * each for name, each in expected.items()})
