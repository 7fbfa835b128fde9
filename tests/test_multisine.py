"""An odd random-phase multisine: its spectrum, its derivatives and the lines that detect distortion."""

import numpy as np
import pytest

from osl_analysis.errors import InputError
from osl_analysis.multisine import odd_lines, odd_multisine

DEFAULT = odd_multisine(8.0, (0.5, 6.0), np.deg2rad(2), seed=3)


def test_only_odd_lines_within_the_band_move_all_alike_and_with_the_stated_size():
    n = 4096
    size = 2 * np.abs(np.fft.rfft(DEFAULT.one_period(n))) / n
    moved = np.flatnonzero(size > 1e-12)
    np.testing.assert_array_equal(moved, DEFAULT.lines)
    assert (moved % 2 == 1).all()
    assert 0.5 <= moved[0] / 8 < moved[-1] / 8 <= 6
    np.testing.assert_allclose(size[moved], size[moved[0]])
    assert np.rad2deg(np.sqrt(np.mean(DEFAULT.one_period(n) ** 2))) == pytest.approx(2)
    assert np.rad2deg(DEFAULT.rms) == pytest.approx(2)


def test_one_odd_line_in_four_is_left_out_and_none_at_the_ends():
    for seed in range(40):
        lines, left_out = odd_lines(8.0, (0.5, 6.0), seed)
        together = np.sort(np.concatenate([lines, left_out]))
        np.testing.assert_array_equal(together, np.arange(5, 48, 2))
        assert len(left_out) == 5
        for group, line in enumerate(left_out):
            assert line in together[4 * group : 4 * group + 4]
        assert lines[[0, -1]].tolist() == [5, 47]
        assert odd_lines(8.0, (0.5, 5.5), seed)[0][-1] == 43  # 20 lines: the last group is a whole one


def test_its_derivatives_are_those_of_its_angle():
    time, h = np.linspace(0, 8, 50), 1e-4
    for k in (0, 1):
        slope = (DEFAULT.angle(time + h, k) - DEFAULT.angle(time - h, k)) / (2 * h)
        np.testing.assert_allclose(DEFAULT.angle(time, k + 1), slope, atol=1e-4 * np.abs(slope).max())


def test_another_realisation_has_the_same_lines_and_independent_phases():
    again, other = (odd_multisine(8.0, (0.5, 6.0), np.deg2rad(2), seed=3, realisation=r) for r in (0, 1))
    np.testing.assert_array_equal(again.angle(np.arange(9.0)), DEFAULT.angle(np.arange(9.0)))
    np.testing.assert_array_equal(other.lines, DEFAULT.lines)
    alike = np.corrcoef(other.one_period(1000), DEFAULT.one_period(1000))[0, 1]
    assert abs(alike) < 4 / np.sqrt(2 * len(other.lines))  # of independent phases: 1/sqrt(2 n), four times


@pytest.mark.parametrize(
    ("period", "band", "rms"), [(8, (6, 0.5), 0.1), (0.5, (0.5, 6), 0.1), (0, (1, 2), 0.1), (8, (0.5, 6), 0)]
)
def test_what_moves_nothing_or_has_too_few_lines_is_refused(period, band, rms):
    with pytest.raises(InputError):
        odd_multisine(period, band, rms, seed=1)
