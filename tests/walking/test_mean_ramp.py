# SPDX-License-Identifier: Apache-2.0
"""Onsets by the mean ramp, against ramps whose start is known."""

import numpy as np
import pytest
from conftest import white_noise
from scipy.optimize import curve_fit
from scipy.special import betainc
from walking_synthetic import RATE, about_y, pose, step

from osl_analysis.walking.platform import (
    FITTED_RISE,
    SINCE_MIDDLE,
    Ramp,
    ramp_of,
    ramp_onsets,
    start_of_rise,
)

TIME = np.arange(3 * RATE) / RATE
ONSETS = 1.2 + np.random.default_rng(5).uniform(-0.05, 0.05, 20)


def angle_of(onset, size_deg=5.0, rise_s=0.08):
    return np.deg2rad(size_deg) * step(TIME, onset, rise_s)[0]


def errors_of(angles, noise_deg):
    """Errors (n,) [s] of the onsets of ramps that start at `ONSETS`."""
    random = np.random.default_rng(8)
    ramps = {
        f"walking_{k}": Ramp(
            TIME, angle + np.deg2rad(noise_deg) * random.standard_normal(len(TIME))
        )
        for k, angle in enumerate(angles)
    }
    return np.array(list(ramp_onsets(ramps)[0].values())) - ONSETS[: len(angles)]


@pytest.mark.parametrize("noise_deg", [0.0, 0.03])
def test_onsets_are_found_to_half_a_millisecond(noise_deg):
    errors = errors_of([angle_of(onset) for onset in ONSETS], noise_deg)

    assert errors.std(ddof=1) < 2e-4
    assert abs(errors.mean()) < 1e-3


def test_ramps_of_mixed_sizes_share_one_shape():
    sizes = np.tile([5.0, 2.5, 4.0, 3.0], 5)

    errors = errors_of([angle_of(o, d) for o, d in zip(ONSETS, sizes, strict=True)], 0.03)

    assert errors.std(ddof=1) < 5e-4


@pytest.mark.parametrize(("ramps", "noise_deg"), [(20, 0.01), (1, 0.2)])
def test_a_straight_ramp_starts_where_it_bends(ramps, noise_deg):
    straight = [np.deg2rad(5 * np.clip((TIME - onset) / 0.08, 0, 1)) for onset in ONSETS]

    assert np.abs(errors_of(straight[:ramps], noise_deg)).max() < 1.5e-3


@pytest.mark.parametrize("bulge_deg", [1.5, 0.22])
def test_a_ramp_unlike_the_others_leaves_their_onsets_as_they_are(bulge_deg):
    angles = [angle_of(onset) for onset in ONSETS]
    angles[0] = angles[0] + np.deg2rad(bulge_deg) * np.exp(
        -(((TIME - ONSETS[0] - 0.05) / 0.01) ** 2)
    )

    with pytest.warns(UserWarning, match=r"trial walking_0:.*platform"):
        errors = errors_of(angles, 0.01)

    assert np.abs(errors[1:]).max() < 1e-3


def test_ramps_of_another_duration_have_onsets_of_their_own():
    """Against the mean ramp half of the difference of the durations would be a time shift."""
    rises_s = np.tile([0.07, 0.09], 10)
    ramps = [angle_of(onset, rise_s=rise) for onset, rise in zip(ONSETS, rises_s, strict=True)]

    with pytest.warns(UserWarning, match="platform"):
        errors = errors_of(ramps, 0.01)

    assert np.median(np.abs(errors)) < 3e-4
    assert np.abs(errors).max() < 8e-3


def test_the_start_of_a_rise_has_the_error_of_a_step_of_any_shape():
    """As SciPy's fit of start, duration and shape has it: eight times that of a known shape."""
    clean = step_of(SINCE_MIDDLE, -0.04, 0.08, 3.0)
    noise = 2e-3
    rises = clean < FITTED_RISE

    start, se = start_of_rise(clean + noise * white_noise(len(clean), 5))

    free = (-0.04, 0.08, 3.0)
    noise_options = {"sigma": np.full(rises.sum(), noise), "absolute_sigma": True}
    _, covariance = curve_fit(step_of, SINCE_MIDDLE[rises], clean[rises], free, **noise_options)
    assert se == pytest.approx(np.sqrt(covariance[0, 0]), rel=0.2)
    assert abs(start + 0.04) < 1.96 * se


def step_of(time, start, duration, shape):
    return betainc(shape, shape, np.clip((time - start) / duration, 0, 1))


def turned(angle):
    """A platform that turns about an axis to the left."""
    return pose(about_y(angle), np.zeros((len(angle), 3)))


@pytest.mark.parametrize("sign", [1, -1])
def test_a_turn_in_either_direction_is_a_ramp(sign):
    ramp = ramp_of(TIME, turned(sign * angle_of(1.2)), np.deg2rad(1))

    assert ramp is not None
    assert ramp_onsets({"a": ramp})[0]["a"] == pytest.approx(1.2, abs=5e-4)


def test_a_platform_that_hardly_turns_has_no_ramp():
    assert ramp_of(TIME, turned(angle_of(1.2, 0.5)), np.deg2rad(1)) is None
