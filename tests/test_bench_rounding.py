"""Intervals of a stepped sine: edges of cycles that are no whole rows, and rounding that every cycle repeats."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from bench_synthetic import LOW_PASS, second_order, stepped_sine

from osl_analysis.bench.impedance import impedance_of, trial_phasors
from osl_analysis.bench.rounding import RepeatedRounding, Rounded, interpolated, with_sines
from osl_analysis.bench.segments import Segment, repeated_cycles, rows_of
from osl_analysis.bench.settings import DynamometerAnalysis
from osl_analysis.bench.stepped_sine import fits_by_amplitude, stepped_sine_trial
from osl_analysis.protocol.runs import SteppedSineProtocol
from osl_analysis.second_order import fit_impedance, impedance_columns
from osl_analysis.signals import filtered_motion
from osl_analysis.stats.covariance import Cycles, between_cycles, sums_between
from osl_analysis.stats.rounding import (
    SIZES,
    noise_before_rounding,
    rounding_harmonics,
    scatter_between_cycles,
    visible_step,
)
from osl_analysis.stats.sinusoid import sinusoid
from osl_analysis.trial import Trial

TRUTH = {"K": 300.0, "B": 5.0, "I": 0.02}
SETTINGS = DynamometerAnalysis(
    cutoff_hz=15, order=4, amplitudes_deg=[4], frequencies_hz=[2, 3, 5], cycles=10, settle_cycles=2
)


def record(seed, rate, step=0.0, noise=0.05, angle_noise=0.0):
    """An exact joint by formula: each frequency rises from rest and goes back to it, by cosine tapers of a cycle."""
    rng, pieces, now = np.random.default_rng(seed), [], 0.5
    for f in (2.0, 3.0, 5.0):
        pieces.append((now, f))
        now += 10 / f + 0.4
    time = np.arange(round(now * rate)) / rate
    theta, omega, alpha = np.zeros((3, len(time)))
    for start, f in pieces:
        rows, w = (time >= start) & (time < start + 10 / f), 2 * np.pi * f
        phase = w * (time[rows] - start)
        theta[rows], omega[rows] = np.deg2rad(4) * np.sin(phase), np.deg2rad(4) * w * np.cos(phase)
        alpha[rows] = -(w**2) * theta[rows]
    torque = 300 * theta + 5 * omega + 0.02 * alpha + 2.0 + noise * rng.standard_normal(len(time))
    read = theta + angle_noise * rng.standard_normal(len(time)) + step * rng.random()
    read = step * np.rint(read / step) if step else read
    return Trial("made", pl.DataFrame({"time": time, "theta": read, "torque": torque}))


def fitted(trial):
    stepped = stepped_sine_trial(trial, SETTINGS)
    motion, torque = stepped.part(None)
    return fit_impedance(motion, torque, stepped.residual_correlation(None)).fit


def share_covered(fits):
    inside = [[low <= TRUTH[k] <= high for k in TRUTH for low, high in [fit.interval(k)]] for fit in fits]
    return np.mean(inside, axis=0)


def stated_over_true(fits, name):
    """Stated standard error over the RMS error of the estimates."""
    return np.sqrt(
        np.mean([fit.se(name) ** 2 for fit in fits]) / np.mean([(fit[name] - TRUTH[name]) ** 2 for fit in fits])
    )


@pytest.mark.parametrize("rate", [250.0, 300.0, 333.0, 1000.0, 1024.0])
def test_standard_errors_do_not_depend_on_whether_a_period_is_whole_rows(rate):
    """30 seeded records: 90 shares of 95 % within 3 errors, and errors as large as stated, at 3 Hz and any rate."""
    fits = [fitted(record(seed, rate)) for seed in range(30)]
    assert np.mean(share_covered(fits)) == pytest.approx(0.95, abs=0.07)
    for name in TRUTH:
        assert stated_over_true(fits, name) == pytest.approx(1, abs=0.4), name


def test_rounding_of_an_encoder_that_every_cycle_repeats_is_in_the_interval():
    """14 bits, 40 seeded zeros of the encoder; without it K, B, I were covered in 66, 90 and 76 of 100 cases."""
    fits = [fitted(record(seed, 1000.0, step=2 * np.pi / 2**14)) for seed in range(40)]
    assert {fit.interval_method for fit in fits} == {"cycles + rounding"}
    assert np.mean(share_covered(fits)) == pytest.approx(0.95, abs=0.06)
    assert share_covered(fits).min() >= 0.85
    for name in TRUTH:
        assert stated_over_true(fits, name) == pytest.approx(1, abs=0.35), name


FEW_CYCLES = SETTINGS.model_copy(update={"settle_cycles": 5})
"""Four settled cycles at each frequency: too few for a spread between them."""


def test_rounding_is_in_the_interval_of_few_cycles_too_unless_noise_has_dithered_it():
    """12 bits in step with the motion: the errors of 12 zeros of the encoder, fitted by numpy, are the truth.

    Without it the stated error was 0.3 times the true one. The residuals' autocorrelation has a part of the rounding,
    and it is not known which: the error may be stated too large, never too small.
    """
    step, errors, of_sine, w = 2 * np.pi / 2**12, [], [], 4 * np.pi
    for seed in range(12):
        stepped = stepped_sine_trial(record(seed, 250.0, step=step, noise=0.02), FEW_CYCLES)
        motion, torque = stepped.part(None)
        X = np.array(list(impedance_columns(motion).values())).T
        errors.append(np.linalg.lstsq(X, torque)[0][:3] - list(TRUTH.values()))
        segment = stepped.segments(None)[0]
        t = segment.part(stepped.time)
        of_sine.append(2 * np.mean(segment.part(stepped.theta) * np.sin(w * (t - 0.5))))  # it began at 0.5 s
    fit = fits_by_amplitude(stepped, impedance_columns)[None]
    phasor = trial_phasors(stepped)[0].theta
    assert [len(segment.used) for segment in stepped.segments(None)] == [4, 4, 4]
    assert (fit.interval_method, phasor.interval_method) == ("HAC + rounding", "HAC + rounding")
    stated = [fit.se(name) for name in TRUTH] / np.sqrt(np.mean(np.square(errors), axis=0))
    assert stated.min() > 0.8
    assert stated.max() < 2.5
    assert 0.8 < np.sqrt(phasor.covariance[1, 1] / np.mean(np.square(np.array(of_sine) - np.deg2rad(4)))) < 2.5
    dithered = stepped_sine_trial(record(1, 250.0, step=step, angle_noise=0.8 * step), FEW_CYCLES)
    assert list(dithered.rounded) == ["theta"]
    assert {found.theta.interval_method for found in trial_phasors(dithered)} == {"HAC"}
    assert not dithered.repeated_rounding(dithered.segments(None))[0].covariance(X, np.eye(4)).any()


def test_rounding_counts_whole_where_one_segment_has_too_few_cycles_and_from_a_single_cycle():
    """No spread of cycles shows a part of it then; a single cycle shows no noise that would make it smaller."""
    time, theta, omega, rounded, segments = whole_sines(0.4, 2 * np.pi / 2**12, 0.0)
    few = replace(segments[1], excluded_cycles=frozenset({4, 5}))
    one = replace(segments[2], stop=segments[2].start + 200, cycles=1)
    seen, X = Rounded(2 * np.pi / 2**12, rounded, theta, time, time), np.array([theta, omega]).T
    for chosen in ([segments[0], few], [one]):
        rows, torque = rows_of(chosen), 300 * theta + 30 * omega
        rounding_of = RepeatedRounding(seen, torque, chosen)
        parts = rounding_of.sums(X[rows])
        sums = np.sum([own.total for own in parts], axis=0)
        assert not parts[-1].shown.any()
        np.testing.assert_allclose(rounding_of.covariance(X[rows], np.eye(2)), sums @ sums.T, rtol=1e-9)
    assert (seen.surviving(one) == 1).all()


def whole_sines(phase, step, zero, cycles=6, rate=1000.0):
    """Angle of 2, 3 and 5 Hz that repeats row by row where a period is whole rows, its velocity, and its rounding."""
    time, pieces, start = np.arange(0, 3 * cycles + 1, 1 / rate), [], 0.0
    theta, omega = np.zeros((2, len(time)))
    for f in (2.0, 3.0, 5.0):
        rows = slice(round(start * rate), round((start + cycles / f) * rate))
        w, size = 2 * np.pi * f, np.deg2rad(4)
        theta[rows] = size * np.sin(w * (time[rows] - start) + phase)
        omega[rows] = size * w * np.cos(w * (time[rows] - start) + phase)
        pieces.append(Segment(np.deg2rad(4), f, start * rate, (start + cycles / f) * rate, cycles))
        start += cycles / f
    return time, theta, omega, step * np.rint((theta + zero) / step) - zero, tuple(pieces)


@pytest.mark.parametrize("phase", [0.4, 1.1, 2.0])
def test_the_variance_of_rounding_is_what_rounding_with_every_zero_of_the_encoder_does(phase):
    """By brute force: the record rounded with 64 zeros, and fitted. The torque is 300 theta + 30 omega.

    The derivative of the error is periodic, up to the filter's 15 Hz. 8 harmonics of the rounding have 93 % of the
    variance; the others are taken to be alike.
    """
    step = 2 * np.pi / 2**14
    time, theta, omega, _, segments = whole_sines(phase, step, 0.0)
    rows = rows_of(segments)
    X = np.column_stack([theta[rows], omega[rows], np.ones(len(rows))])
    influence, errors = X @ np.linalg.inv(X.T @ X), []
    for zero in step * (np.arange(64) + 0.5) / 64:
        error = whole_sines(phase, step, zero)[3] - theta
        errors.append(influence.T @ np.concatenate([through_joint(error[segment.rows]) for segment in segments]))
    expected = np.cov(np.transpose(errors))
    seen = Rounded(step, whole_sines(phase, step, 0.3 * step)[3], theta, time, time)
    found = RepeatedRounding(seen, 300 * theta + 30 * omega, segments).covariance(influence, np.eye(3))
    size = np.sqrt(np.diag(expected))[:2]
    np.testing.assert_allclose(found[:2, :2] / np.outer(size, size), expected[:2, :2] / np.outer(size, size), atol=0.12)


def through_joint(error):
    """300 e + 30 de/dt of an error (n,) of the angle that repeats after the last sample, at 1000 Hz."""
    w = 2j * np.pi * np.fft.rfftfreq(len(error), 1e-3)
    return np.fft.irfft(np.fft.rfft(error) * (300 + 30 * w * (np.abs(w) < 2 * np.pi * 15)), len(error))


def test_rounding_that_differs_from_cycle_to_cycle_is_not_counted_twice():
    """At 1013 Hz no period is whole rows: the spread of the cycles has all of it. At 1000 Hz it has nothing."""
    step, added = 2 * np.pi / 2**12, {}
    for rate in (1000.0, 1013.0):
        time, theta, omega, rounded, segments = whole_sines(0.3, step, 0.0, cycles=40, rate=rate)
        rows, cycles = rows_of(segments), repeated_cycles(segments)
        X = np.column_stack([theta, omega, np.ones(len(time))])[rows]
        influence = X @ np.linalg.inv(X.T @ X)
        seen = Rounded(step, rounded, theta, time, time)
        found = RepeatedRounding(seen, 300 * theta, segments).covariance(influence, np.eye(3))
        errors = influence * (300 * (rounded - theta)[rows])[:, None]
        spread, _ = between_cycles(cycles.sums(errors, np.ones(len(errors))), cycles.stratum)
        added[rate] = found[1, 1] / spread[1, 1]
    assert added[1000.0] > 100
    assert added[1013.0] < 0.5


@pytest.mark.parametrize("size", [0.05, 0.2, 0.4, 1.5])
def test_noise_before_rounding_is_found_from_what_it_leaves(size):
    """40 000 places within a step, five readings of each: a standard error of 1 % of the scatter."""
    rng = np.random.default_rng(8)
    place = rng.random(40_000)[:, None]
    readings = np.rint(place + size * rng.standard_normal((len(place), 5))) - place
    scatter = np.mean(np.var(readings, axis=1, ddof=1))
    assert noise_before_rounding(np.array([scatter]))[0] == pytest.approx(size, rel=0.05)


def test_rounding_that_noise_dithers_is_not_counted_twice():
    step = 2 * np.pi / 2**14
    dithered = record(1, 1000.0, step=step, angle_noise=0.6 * step)
    fit = fitted(dithered)
    unknown = replace(stepped_sine_trial(dithered, SETTINGS), steps=(None, None))
    motion, torque = unknown.part(None)
    assert fit.interval_method == "cycles"
    without = fit_impedance(motion, torque, unknown.residual_correlation(None)).fit
    assert [fit.se(name) for name in TRUTH] == pytest.approx([without.se(name) for name in TRUTH], rel=1e-3)


def test_a_step_is_stated_or_seen():
    rng = np.random.default_rng(1)
    values = rng.normal(0, 0.1, 20_000)
    assert visible_step(0.003 * np.rint(values / 0.003) + 0.0007) == pytest.approx(0.003, rel=1e-6)
    assert visible_step(values) is None
    assert visible_step(np.zeros(100)) is None
    trial = record(2, 500.0)
    stated = Trial("made", trial.samples, {"columns": {"theta": {"resolution": 1e-3}}})
    assert stepped_sine_trial(stated, SETTINGS).steps == (1e-3, None)
    assert stepped_sine_trial(trial, SETTINGS).steps == (None, None)


def test_sums_between_rows_are_integrals_of_the_curve_and_whole_where_edges_are():
    t = np.arange(400)
    wave = np.column_stack([np.sin(2 * np.pi * t / 83.4 + 1), np.ones(400)])
    edges = 7 + 83.4 * np.arange(4)
    sums = sums_between(wave, edges[:-1], edges[1:])
    assert np.abs(sums[:, 0]).max() < 2e-4
    np.testing.assert_allclose(sums[:, 1], 83.4)
    np.testing.assert_array_equal(sums_between(wave, np.array([3.0]), np.array([90.0]))[0, 1], 87)
    np.testing.assert_allclose(sums_between(wave, np.array([3.0]), np.array([400.0]))[0], wave[3:].sum(axis=0))


@pytest.mark.parametrize("begin", [0.0, 0.3])
def test_the_cycles_at_both_ends_of_a_stretch_are_summed_from_its_own_rows(begin):
    """The sum of sin^2 over a period is half of it, by integral; beyond the ends stand rows of another frequency.

    Between the rows 2e-4 of a row are lost in interpolation. Rows of the neighbours made 0.06 of a row of it.
    """
    edges, others = begin + 83.4 * np.arange(5), np.full(50, 7.0)
    own = np.sin(2 * np.pi * np.arange(int(np.ceil(edges[-1]))) / 83.4 + 1)
    values, edges = np.concatenate([others, own, others]), 50 + edges
    first, stop = np.concatenate([[0], edges[:-1], [384]]), np.concatenate([[50], edges[1:], [434]])
    sums = Cycles(first, stop, np.array([0, 1, 1, 1, 1, 2])).sums(values[:, None], values)[:, 0]
    np.testing.assert_allclose(sums[1:5], 83.4 / 2, atol=5e-4)
    np.testing.assert_allclose(sums[[0, 5]], 50 * 49, rtol=1e-14)
    whole = own @ own - begin * own[0] ** 2 - (len(own) - edges[-1] + 50) * own[-1] ** 2
    assert sums[1:5].sum() == pytest.approx(whole, abs=0.02)


def test_scatter_between_cycles_is_that_of_what_does_not_repeat():
    rng, edges = np.random.default_rng(5), 50.0 * np.arange(21)
    cycles = Cycles(edges[:-1], edges[1:], np.repeat([0, 1], 10))
    repeats = np.tile(rng.standard_normal(50), 20)
    assert scatter_between_cycles(repeats, cycles) == pytest.approx([0, 0], abs=1e-20)
    noisy = repeats + np.repeat([0.1, 0.3], 500) * rng.standard_normal(1000)
    assert scatter_between_cycles(noisy, cycles) == pytest.approx([0.01, 0.09], rel=0.2)
    for some in (range(0, 50, 2), range(0, 50, 7)):
        expected = [part[:, some].var(axis=0, ddof=1).mean() for part in noisy.reshape(2, 10, 50)]
        assert scatter_between_cycles(noisy, cycles, some.step) == pytest.approx(expected, rel=1e-9)


def test_harmonics_of_the_rounding_are_cosines_and_sines_of_the_place_between_two_steps():
    x = np.concatenate([np.random.default_rng(2).uniform(-40, 40, 300), [0.0, 0.3, 0.15, -0.45]])
    expected = [f(2 * np.pi * k * x / 0.3) for f in (np.cos, np.sin) for k in range(1, 9)]
    np.testing.assert_allclose(rounding_harmonics(x, 0.3), expected, rtol=0, atol=1e-11)
    assert np.sum(SIZES**2) == pytest.approx(2 / 12, rel=1e-12)  # the squares of both have the mean 1/2


def test_what_noise_leaves_of_the_rounding_is_known_from_all_rows_unless_it_is_next_to_nothing():
    rng, time, segment = np.random.default_rng(8), np.arange(5000) / 500, Segment(0.1, 1.0, 0.0, 5000.0, 10)
    smooth = 0.1 * np.sin(2 * np.pi * time)
    for noise in (0.1, 0.4, 3.0):
        signal = 1e-3 * np.rint(smooth / 1e-3 + noise * rng.standard_normal(5000))
        errors = np.array([signal, 1e-3 * np.rint(smooth / 1e-3)]) - smooth
        seen, expected = np.var(errors.reshape(2, 10, 500), axis=1, ddof=1).mean(axis=1) / 1e-6
        left = np.exp(-2 * (np.pi * noise_before_rounding(seen - expected)) ** 2)
        found = Rounded(1e-3, signal, smooth, time, time).surviving(segment)
        assert found[0] == pytest.approx(left, rel=1e-9, abs=1e-6)


def test_the_fits_of_a_trial_know_what_the_filter_took_off_the_torque():
    """Without it the spread between cycles is that of noise which the filter has correlated."""
    stepped = stepped_sine_trial(record(3, 1000.0), SETTINGS)
    rows = rows_of(stepped.segments(None))
    taken = stepped.residual_correlation(None).filtered_off
    np.testing.assert_allclose(taken, (stepped.torque - stepped.filtered_torque)[rows])
    assert np.std(taken) == pytest.approx(0.05, rel=0.05)


def test_columns_between_their_rows_are_those_of_numpy_beyond_their_ends_too():
    rng = np.random.default_rng(4)
    values, place = (
        rng.standard_normal((3, 50)),
        np.concatenate([[-1.0, 0.0], 49 * rng.random(200), [48.0, 49.0, 51.0]]),
    )
    in_turn = np.arange(3, 40) + rng.random(37)
    for at in (place, in_turn):
        expected = np.array([np.interp(at, np.arange(50), row) for row in values])
        np.testing.assert_allclose(interpolated(at, values), expected, rtol=0, atol=1e-13)


def test_a_signal_that_is_fitted_itself_follows_its_own_rounding_whole():
    """What is found from a copy of the signal, which is not known to be the same one."""
    time = np.arange(5000) / 500
    smooth = 0.1 * np.sin(2 * np.pi * time)
    rounded = Rounded(1e-3, smooth, smooth, time, time)
    segment = Segment(0.1, 1.0, 0.0, 5000.0, 10)
    itself, copy = (RepeatedRounding(rounded, fitted, [segment]) for fitted in (smooth, smooth.copy()))
    assert itself.transfer(segment) == (1.0, 0.0)
    assert copy.transfer(segment) == pytest.approx((1.0, 0.0), abs=1e-12)


def test_the_smooth_signal_is_known_when_the_sensor_took_its_samples():
    """A cubic through samples 2 ms apart knows sin(t) to 1e-12 (h^4/384). The sensor began before the grid does."""
    time = 0.3 + np.arange(5000) / 500
    sampled = np.arange(6000) / 500 + 7e-4
    found = Rounded(1e-3, np.sin(time), np.sin(time), time, sampled).at_samples
    inside = (sampled > time[0]) & (sampled < time[-1])
    np.testing.assert_allclose(found[inside], np.sin(sampled[inside]), rtol=0, atol=1e-9)
    assert (found[0], found[-1]) == (np.sin(time[0]), np.sin(time[-1]))


def test_the_fit_to_one_amplitude_is_that_to_its_rows_alone():
    """Made of copied rows and of the rounding of its own segments; the spread that rounding shows is numpy's."""
    stepped = replace(stepped_sine(second_order, noise=0.1), steps=(2 * np.pi / 2**14, None))
    for amplitude, fit in fits_by_amplitude(stepped, impedance_columns).items():
        segments = stepped.segments(amplitude)
        rows, rounding = rows_of(segments), stepped.repeated_rounding(segments)
        motion = stepped.motion[rows]
        known = replace(
            stepped.residual_correlation(amplitude),
            filtered_off=(stepped.torque - stepped.filtered_torque)[rows],
            repeated=rounding,
        )
        alone = fit_impedance(motion, stepped.filtered_torque[rows], known).fit
        np.testing.assert_allclose(fit.estimates, alone.estimates, rtol=1e-9)
        np.testing.assert_allclose(np.diag(fit.covariance), np.diag(alone.covariance), rtol=1e-7)
    one, segment = rounding[0], segments[0]
    X = np.array(list(impedance_columns(stepped.motion[segment.rows]).values())).T
    sums = np.array(list(one.cycle_sums(segment, X, X[:, :0]))) * np.tile(one.rounded.surviving(segment), 2)
    shown = len(sums) * sum(np.cov(wave, rowvar=False) for wave in np.moveaxis(sums, 2, 0))
    np.testing.assert_allclose(one.sums_of(segment, X).shown, shown, rtol=1e-9, atol=1e-12 * np.abs(shown).max())


def test_the_rounding_that_comes_along_with_the_phasors_is_that_of_the_fit_alone():
    """Both are made of the same error; neither changes the other. The phasors' own is that of their columns alone."""
    stepped = replace(stepped_sine(second_order, noise=0.1), steps=(2 * np.pi / 2**14, None))
    before, phasors = fits_by_amplitude(replace(stepped), impedance_columns), trial_phasors(stepped)
    for amplitude, fit in fits_by_amplitude(stepped, impedance_columns).items():
        np.testing.assert_allclose(fit.covariance, before[amplitude].covariance, rtol=1e-12)
    for segment, found in zip(stepped.segments(None), phasors, strict=True):
        sine = sinusoid(segment.part(stepped.time), segment.frequency_hz, segment.repeated)
        alone = RepeatedRounding(stepped.rounded["theta"], stepped.rounded["theta"].smooth, [segment])
        theta = sine.phasors({"theta": segment.part(stepped.theta)}, {"theta": [alone]})["theta"]
        np.testing.assert_allclose(found.theta.covariance, theta.covariance, rtol=1e-9, atol=1e-24)
        assert found.theta.interval_method == "cycles + rounding"


def test_a_segment_with_a_gap_has_the_rounding_of_the_cycles_that_are_left():
    """Cycle 4 of 10 is left out, so that there are two stretches; columns of two fits."""
    time, step = np.arange(5000) / 500, 2 * np.pi / 2**12
    smooth = 0.1 * np.sin(2 * np.pi * time + 0.3)
    whole = Segment(0.1, 1.0, 0.0, 5000.0, 10)
    parted = replace(whole, excluded_cycles=frozenset([4]))
    X = np.column_stack([smooth, np.ones(5000), np.cos(2 * np.pi * time)])
    each = RepeatedRounding(Rounded(step, smooth, smooth, time, time), smooth, [whole])
    expected = np.delete(np.array(list(each.cycle_sums(whole, X, X[:, :0]))), 4, axis=0)
    found = np.array(list(each.cycle_sums(parted, *np.split(X[parted.rows], [2], axis=1))))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_a_step_is_seen_in_floats_of_four_bytes_and_where_every_other_one_is_hardly_used():
    random = np.random.default_rng(5)
    turns = 0.003 * np.rint(200 * np.sin(np.linspace(0, 60, 40_000)) + random.standard_normal(40_000)) + 0.0007
    assert visible_step(turns.astype(np.float32).astype(float)) == pytest.approx(0.003, rel=1e-3)
    doubled = np.where(np.arange(40_000) % 39 == 0, 2 * np.rint(turns / 0.006), np.rint(turns / 0.003)) * 0.003
    assert visible_step(doubled) == pytest.approx(0.003, rel=1e-9)


TWELVE_BITS = 2 * np.pi / 2**12
SLOW_SINES = SteppedSineProtocol((0.07,), (1.0, 2.0, 5.0), 9)


def test_peaks_are_known_to_a_twentieth_of_a_step_where_the_filtered_angle_stays_on_the_step():
    record = stepped_sine(second_order, protocol=SLOW_SINES)
    rounded = TWELVE_BITS * np.rint(record.theta / TWELVE_BITS + 0.3)
    filtered = filtered_motion(record.time, rounded, record.torque, LOW_PASS)[0].theta
    found = with_sines(filtered, record.time, record.segments(None))
    slowest = record.segments(None)[0]
    error = np.array([slowest.part(x - record.theta) for x in (found, filtered)])
    error = np.ptp(error - error.mean(axis=1)[:, None], axis=1)
    assert error[0] < 0.1 * TWELVE_BITS
    assert error[1] > 3 * error[0]
    between = np.ones(len(found), dtype=bool)
    for segment in record.segments(None):
        between[segment.rows] = False
    assert between.any()
    np.testing.assert_array_equal(found[between], filtered[between])


def test_a_motion_with_a_third_harmonic_is_kept():
    record = stepped_sine(second_order, protocol=SLOW_SINES)
    segment, time = record.segments(None)[1], record.time
    bent = 0.07 * np.sin(4 * np.pi * time + 0.3) + 0.01 * np.cos(12 * np.pi * time) + 0.2
    found = with_sines(bent, time, [segment])
    np.testing.assert_allclose(segment.part(found), segment.part(bent), atol=1e-9)


@pytest.mark.parametrize("amplitude", [0.07, 0.0704])
def test_the_standard_error_of_k_at_12_bits_does_not_hang_on_where_the_zero_of_the_encoder_is(amplitude):
    """Rounding makes nearly all of it; its size belongs to the motion, whatever the zero happens to be."""
    found = []
    for zero in np.arange(8) / 8:
        record = twelve_bits(amplitude, zero)
        fit = impedance_of(record, None)
        found.append((fit["K"] - 200, fit.se("K")))
    errors, standard = np.array(found).T
    assert standard.std() < 0.25 * standard.mean()
    assert np.abs(errors).max() < 2 * standard.mean()


def twelve_bits(amplitude, zero):
    """A trial whose angle is rounded to 12 bits from some zero, of a joint that moves without rounding."""
    record = stepped_sine(second_order, 0.003, SteppedSineProtocol((amplitude,), (1.0, 2.0, 5.0), 9))
    theta = TWELVE_BITS * np.rint(record.theta / TWELVE_BITS + zero)
    motion, torque = filtered_motion(record.time, theta, record.torque, LOW_PASS)
    return replace(record, theta=theta, motion=motion, filtered_torque=torque, steps=(TWELVE_BITS, None))
