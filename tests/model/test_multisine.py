# SPDX-License-Identifier: Apache-2.0
"""The odd random-phase multisine, by its discrete Fourier transform."""

import numpy as np
from conftest import refused_with

from osl_analysis.model.multisine import odd_lines, odd_multisine

BAND = (0.5, 6.0)  # [Hz]
WHOLE_PERIOD = 8.0 * np.arange(4096) / 4096
DEFAULT = odd_multisine(WHOLE_PERIOD, 8.0, BAND, seed=3)


def test_only_odd_lines_move_all_by_the_same_size_to_an_rms_of_1():
    size = 2 * np.abs(np.fft.rfft(DEFAULT)) / len(DEFAULT)

    moved = np.flatnonzero(size > 1e-12)
    np.testing.assert_array_equal(moved, odd_lines(8.0, BAND))
    assert (moved % 2 == 1).all()
    np.testing.assert_allclose(size[moved], np.sqrt(2 / len(moved)))


def test_a_multisine_of_too_few_lines_is_refused():
    with refused_with("2 odd lines"):
        odd_lines(1.0, (1.0, 4.0))
    assert odd_lines(1.0, (1.0, 5.0)).tolist() == [1, 3, 5]


def test_phases_are_drawn_from_the_whole_circle():
    """Of 1,100 lines: their mean on the unit circle has an RMS of 0.03, that of half a circle of
    0.64."""
    period_s = 400.0
    time = period_s * np.arange(8192) / 8192
    spectrum = np.fft.rfft(odd_multisine(time, period_s, BAND, seed=1))[odd_lines(period_s, BAND)]

    assert abs(np.mean(spectrum / np.abs(spectrum))) < 0.1
