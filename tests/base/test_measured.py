# SPDX-License-Identifier: Apache-2.0
"""What can be a measurement, what is computed from another signal, and to which step it is
rounded."""

import re

import numpy as np
import pytest
from c3d_builder import FACE
from conftest import refused_with, white_noise

from osl_analysis.base.measured import check_measured, noise_of, varies, visible_step
from osl_analysis.base.trial import parsed_windows, unit_of
from osl_analysis.base.units import known_factor
from osl_analysis.ingest.force_plates import distance_from_plate, force_axes, plate_axes
from osl_analysis.stats.rounding import significant
from osl_analysis.walking.plate import outside


@pytest.fixture
def noise():
    return white_noise((2, 2000), 1)


def counts(noise):
    return np.round(20 * noise[0])


@pytest.mark.parametrize("step", [1e-3, 5.0])
def test_the_step_of_a_rounded_signal_is_seen(noise, step):
    rounded = counts(noise) * step
    rounded += 1e-13 * step * (noise[1] > 0)  # errors of the last bits

    assert visible_step(rounded) == pytest.approx(step)


def test_the_step_of_a_mean_of_six_is_a_sixth_and_not_that_of_its_decimals(noise):
    step = 360 / 2**14
    sums = np.cumsum(counts(noise) * step)  # as firmware keeps them
    means = np.round((sums[6:] - sums[:-6]) / 6, 6)

    assert visible_step(means) == pytest.approx(step / 6, rel=1e-3)


def test_a_signal_without_rounding_has_no_step(noise):
    assert visible_step(noise[0]) is None


@pytest.mark.parametrize(("off", "step"), [(0.02, 1.0), (0.045, None)])
def test_levels_that_lie_up_to_a_tenth_of_a_step_apart_have_none(off, step):
    levels = np.arange(200) + np.random.default_rng(1).uniform(-off, off, 200)

    seen = visible_step(np.repeat(levels, 3))
    assert seen == (step and pytest.approx(step, rel=0.01))


def test_the_noise_beside_a_slow_motion_is_its_standard_deviation(noise):
    slow = 1e3 * np.sin(np.arange(2000) / 100)

    assert noise_of(slow + noise[0]) == pytest.approx(1, rel=0.1)


def test_a_constant_does_not_vary_by_its_rounding():
    assert not varies(np.full(1000, 0.1))
    assert varies(np.array([0.1, 0.1001]))


@pytest.mark.parametrize("value", [1.5e30, 1e-31, np.nan, np.inf])
def test_what_no_sensor_gives_is_refused(value):
    with refused_with("torque"):
        check_measured("torque", [0.0, value])


def test_numbers_of_sentences_have_two_digits_and_no_exponent():
    assert [significant(x) for x in (-721.3, 0.0001234, 3.0)] == ["-720", "0.00012", "3"]


@pytest.mark.parametrize("ratio", [1.3558, 1 / 1.3558, -1.36])
def test_a_ratio_near_a_unit_factor_names_it(ratio):
    assert re.search(r"1\.36.*lbf\*ft.*N\*m", known_factor(ratio, ("torque", "angle"), 0.08))


@pytest.mark.parametrize("ratio", [1.0, 2.0])
def test_a_ratio_near_no_unit_factor_names_none(ratio):
    assert known_factor(ratio, ("torque", "angle"), 0.08) == ""


# ---- Plates and windows


FACE_DOWN = FACE[[0, 3, 2, 1]]


@pytest.mark.parametrize(("axes_of", "up"), [(force_axes, -1), (plate_axes, 1)])
def test_axes_of_a_plate_are_right_handed_and_along_its_edges_point_up(axes_of, up):
    axes = axes_of(FACE_DOWN)

    np.testing.assert_allclose(axes[:, 2], [0, 0, up], atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1)


def test_the_own_x_axis_of_a_plate_is_from_its_second_corner_to_its_first():
    np.testing.assert_allclose(force_axes(FACE_DOWN)[:, 0], [0, 1, 0], atol=1e-12)


def test_points_beside_a_plate_are_as_far_as_from_its_nearest_edge_or_corner():
    points = np.array([[0.0, 0.0], [0.25, 0.0], [0.24, 0.33]])  # 0.4 m along x, 0.6 m along y

    np.testing.assert_allclose(distance_from_plate(points, FACE_DOWN), [0, 0.05, 0.05], atol=1e-12)


def test_points_are_outside_a_plate_in_laboratory_axes_and_at_any_height():
    points = np.array([[0.31, 0.0, 0.5], [0.0, 0.25, -0.1]])

    assert outside(points, FACE_DOWN) == pytest.approx([0.01, 0.05])


def test_windows_are_from_to_pairs():
    assert parsed_windows("2-30  40.5-62") == [(2.0, 30.0), (40.5, 62.0)]


@pytest.mark.parametrize(
    "text", ["", "2", "30-2", "2-30 x", "2-30,40-62", "2-3040-62", "2-30 20-40", "40-62 2-30"]
)
def test_windows_of_another_form_that_overlap_or_go_back_are_refused(text):
    with refused_with(rf"'{text}'.*2-30 40-62"):
        parsed_windows(text)


def test_a_column_of_a_family_has_the_family_s_unit():
    assert unit_of("plate2_moment_z") == "N*m"
    assert unit_of("marker_left heel_x") == "m"
    assert unit_of("torque") == "N*m"
