# SPDX-License-Identifier: Apache-2.0
"""The plate's lag in each crossing, and what shows that the set-up is right."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from conftest import refused_with
from walking_synthetic import (
    CORNERS,
    Ramp,
    Rig,
    changed,
    plate_trials,
    settings,
    static_trial,
    walked_over,
)

from osl_analysis.signals.filters import LowPass
from osl_analysis.walking.crossing import analyse_crossing
from osl_analysis.walking.plate import check_place
from osl_analysis.walking.plate_inertia import NO_CORRECTION, TurnLag, identify_plate_model
from osl_analysis.walking.plate_lag import plate_timing, timing_of
from osl_analysis.walking.poses import static_calibration
from osl_analysis.walking.set_up import marker_noise_ratio

CALIBRATION = static_calibration(static_trial(), settings())
NOISE_S = {"plate": 0.2e-3, "walk": 0.6e-3}  # of a lag


def crossings(count=3, **changes):
    """Perturbed crossings whose platform turns back after toe-off; `changes` of the rig."""
    rig = Rig(**changes)
    names = [f"walk_{k}" for k in range(count)]
    return [(walked_over(name, Ramp(), rig, k), CALIBRATION) for k, name in enumerate(names)]


def test_crossings_that_are_later_than_the_unloaded_plate_are_read_later():
    quiet = Rig(marker=1e-4)
    unloaded = [(trial, CALIBRATION) for trial in plate_trials(quiet, Ramp(), 3)]
    model = identify_plate_model(unloaded, settings())

    timing = timing_of(crossings(marker=1e-4, lag=0.006), model, settings())

    assert list(timing.lags.values()) == pytest.approx([0.006] * 3, abs=5e-4)
    assert 0.003 < timing.change < 0.006


def test_a_plate_with_a_mass_and_no_model_is_refused():
    timing_of(crossings(mass=0.0), NO_CORRECTION, settings())

    with refused_with(r"follows its acceleration with 2\d\.\d kg.*identified"):
        timing_of(crossings(), NO_CORRECTION, settings())


def timing_with(random, late=0.0, drift=0.0, scatter=0.0):
    """Of five unloaded recordings with two turns each and twelve crossings, and the true lags."""
    true = {}
    turns = {"plate": [], "walk": []}
    for kind, count, times in (("plate", 5, (0.8, 1.5)), ("walk", 12, (1.9,))):
        for k in range(count):
            own_lag = scatter * random.normal() + late * (kind == "walk")
            true[f"{kind}_{k}"] = own_lag + drift * 1.1
            for time in times:
                lag = own_lag + drift * time + NOISE_S[kind] * random.normal()
                turns[kind].append(TurnLag(f"{kind}_{k}", time, lag, NOISE_S[kind]))
    walked = {turn.trial: [turn] for turn in turns["walk"]}
    model = replace(NO_CORRECTION, turns=tuple(turns["plate"]))
    timing = plate_timing(model, walked, dict.fromkeys(walked, 1.1))
    errors = [timing.lags[name] - true[name] for name in walked]
    return timing, np.sqrt(np.mean(np.square(errors)))


@pytest.mark.parametrize(
    ("fault", "told", "largest_error_s"),
    [
        ({}, (), 0.3e-3),
        ({"late": 4e-3}, ("change",), 0.5e-3),
        ({"drift": 4e-3}, ("drift",), 0.5e-3),
        ({"scatter": 4e-3}, ("scatter",), 1e-3),
    ],
)
def test_noise_is_no_fault_and_each_fault_is_told_as_itself(fault, told, largest_error_s):
    random = np.random.default_rng(8)

    timings = [timing_with(random, **fault) for _ in range(40)]

    for name in ("change", "drift", "scatter"):
        share = np.mean([bool(getattr(timing, name)) for timing, _ in timings])
        assert share == pytest.approx(float(name in told), abs=0.15)
    assert np.median([error for _, error in timings]) < largest_error_s


@pytest.mark.parametrize("late", [0.0, 0.4e-3, 0.8e-3])
def test_a_change_too_small_to_tell_is_within_the_lag_s_standard_error(late):
    """Up to 4.5 standard errors: read as none, the lag would be off by these."""
    random = np.random.default_rng(9)

    timings = [timing_with(random, late=late)[0] for _ in range(80)]

    held = [abs(timing.lag - late) < 1.96 * timing.se for timing in timings]
    assert np.mean(held) > 0.88
    if not late:  # the mean of the twelve crossings alone scatters by 0.17e-3 s
        assert np.std([timing.lag for timing in timings]) < 0.12e-3


def coloured(random, correlation):
    """A track (200, 3) [m] of noise of which neighbours correlate."""
    noise = random.normal(0, 3e-4, (200, 3))
    for k in range(1, len(noise)):
        noise[k] += correlation * noise[k - 1]
    return noise


@pytest.mark.parametrize("correlation", [0.0, 0.8])
def test_smoothed_markers_are_told_from_coloured_ones(correlation):
    names = ["marker_A_x", "marker_A_y", "marker_A_z"]
    raw = coloured(np.random.default_rng(1), correlation)
    trial = walked_over("walk", None, Rig(), 1)

    def ratio(tracks):
        samples = pl.DataFrame(tracks, names).with_columns(time=np.arange(200) / 300)
        return marker_noise_ratio(replace(trial, samples=samples), ["A"])

    assert ratio(raw) > 0.03
    assert ratio(LowPass(15.0, 2)(raw, 300.0)) < 1e-4


def test_a_window_that_ends_on_the_ramp_is_told():
    ramp = Ramp(rise=0.16)
    trial = walked_over("walk", ramp, Rig(), 1)

    crossing = analyse_crossing(
        trial, CALIBRATION, NO_CORRECTION, True, settings(), ramp.onset, 0.0
    )

    assert crossing.quality.turn_share == pytest.approx(0.73, abs=0.05)
    assert crossing.quality.foot_residual_ratio == pytest.approx(1.0, abs=0.15)


def test_a_plate_that_stands_where_another_stood_is_refused():
    here = np.array(CORNERS)
    other_place = here + np.array([0.6, 0.0, 0.0])

    check_place(here, 1, {1: here + 0.01, 2: other_place})
    with refused_with(r"plate 1 stands where plate 2 stood.*60 cm"):
        check_place(other_place, 1, {1: here, 2: other_place + 0.01})


def test_metres_that_are_labelled_as_millimetres_are_refused_for_their_unit():
    too_small = changed(static_trial(), pl.col("^marker_.*$") / 1000)

    with refused_with(r"foot and shank are 0\.000\d+ m apart, expected 0\.03 to 5 m.*point_unit"):
        static_calibration(too_small, settings())
