"""The power density of a signal."""

import numpy as np
import pytest
import scipy

from osl_analysis.stats.power_density import power_density


@pytest.mark.parametrize("rows", [200, 201])
@pytest.mark.parametrize("has_overlap", [True, False])
@pytest.mark.parametrize("takes_off_mean", [True, False])
def test_a_power_density_is_that_of_scipy(rows, has_overlap, takes_off_mean):
    signal = 3.0 + np.random.default_rng(1).normal(size=1_130)

    frequency, density = power_density(signal, 50.0, rows, has_overlap, takes_off_mean)

    expected = scipy.signal.welch(
        signal,
        50.0,
        nperseg=rows,
        noverlap=None if has_overlap else 0,
        detrend="constant" if takes_off_mean else False,
    )
    np.testing.assert_allclose(frequency, expected[0], rtol=1e-12)
    np.testing.assert_allclose(density, expected[1], rtol=1e-9, atol=1e-18)
