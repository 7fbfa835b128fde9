# SPDX-License-Identifier: Apache-2.0
"""The parts of the one inference, against mathematics and other libraries."""

from types import SimpleNamespace

import numpy as np
import pytest
import scipy
import statsmodels.api as sm
from conftest import refused_with, white_noise

from osl_analysis.base.measured import rms
from osl_analysis.inference import BenchSignals
from osl_analysis.inference.candidate_models import (
    CANDIDATE_MODELS,
    EQ_15,
    ModelAtValue,
    Search,
    behind_spring,
    late,
    low_passed,
)
from osl_analysis.inference.rounding_errors import repeated_share, rounding_torques
from osl_analysis.inference.spectra import (
    WorkingSpectra,
    noise_and_band,
    slipping_springs,
    wound_at_turns,
)
from osl_analysis.inference.weighing import BlockFit, Predicted, largest_shifts, predict, weigh
from osl_analysis.inference.whitening import Whitened

RATE = 500.0
TRUE = np.array([300.0, 5.0, 0.02])


def random_motion() -> np.ndarray:
    """Angle, velocity and acceleration (3, n) of smooth noise up to 6 Hz, from its spectrum."""
    rng = np.random.default_rng(1)
    n = round(30 * RATE)
    hz = np.fft.rfftfreq(n, 1 / RATE)
    spectrum = np.fft.rfft(rng.normal(size=n)) / (1 + (hz / 5) ** 8) * (hz > 0.3)
    s = 2j * np.pi * hz
    motion = np.array([np.fft.irfft(s**k * spectrum, n) for k in range(3)])
    return motion * 0.04 / motion[0].std()


def whitened(torque_noise: np.ndarray) -> Whitened:
    """A sound joint for as long as the noise."""
    motion = random_motion()[:, : len(torque_noise)]
    theta = motion[0] + 1e-6 * np.random.default_rng(101).normal(size=len(torque_noise))
    return Whitened(WorkingSpectra(BenchSignals(theta, TRUE @ motion + torque_noise, RATE)))


def predicted(data: Whitened, rounding: np.ndarray) -> Predicted:
    """Eq. 15 alone."""
    return predict(Search(data, False), ModelAtValue(EQ_15, data.motion, data.torque), rounding)


def white(size: float = 0.1) -> np.ndarray:
    return size * white_noise(round(30 * RATE), 2)


def coloured() -> np.ndarray:
    """Noise through one lag of 30 ms, with SD 0.5 N*m."""
    x = scipy.signal.lfilter([1.0], [1.0, -np.exp(-1 / (RATE * 0.03))], white(1.0))
    return 0.5 * x / x.std()


def test_whitened_fit_is_that_of_statsmodels_gls():
    data = whitened(coloured())
    motion = random_motion()
    rows = slice(round(RATE), -round(RATE))
    time = np.linspace(-1, 1, motion.shape[1])
    X = np.column_stack([*motion, np.ones_like(time), time])[rows]
    model = sm.GLSAR(((TRUE @ motion) + coloured())[rows], X, rho=1)
    gls = model.iterative_fit(4)

    fit = predicted(data, np.zeros((1, len(data.torque))))

    # two estimators of one noise: they agree within a part of their common error
    assert np.all(np.abs(fit.impedances[0] - gls.params[:3]) < gls.bse[:3])


def test_noise_beside_the_motion_is_taken_for_as_large_as_far_from_it():
    """Without their leverage 34 columns leave a quarter less of it in 15 s. It is a mean over 0.75
    Hz: of eleven lines."""
    ratios = []
    scatters = []
    for seed in range(6):
        data = whitened(0.1 * white_noise(round(15 * RATE), 10 + seed))
        f = data.spectra.frequency
        bands = ((0.5, 5), (9, 14))
        near, far = (data.gain[(f > low) & (f < high)] ** 2 for low, high in bands)
        ratios.append(near.mean() / far.mean())
        scatters.append(np.log(far).std())
    assert 0.9 < np.mean(ratios) < 1.2
    assert 0.2 < np.mean(scatters) < 0.3


def test_a_recording_that_the_columns_of_models_fill_is_not_weighed():
    with refused_with("too short.*record for longer"):
        whitened(0.1 * white_noise(round(8 * RATE), 1))


def test_each_block_is_predicted_by_a_fit_that_has_not_seen_it():
    rows = white_noise((4, 1001), 3)  # three columns and the torque

    fit = BlockFit(rows)

    unseen = np.arange(*fit.edges[[5, 6]])
    *columns, torque = np.delete(rows, unseen, axis=1)
    by_others = np.linalg.lstsq(np.transpose(columns), torque)[0]
    miss = rows[3, unseen] - by_others @ rows[:3, unseen]
    assert fit.squares_of_unseen()[5] == pytest.approx(miss @ miss, rel=1e-6)


@pytest.mark.parametrize(
    ("squares", "freedom", "probability"),
    [
        ([24 + 2 * np.log(3), 24], 24, 3 / 4),
        # what leaves noise alone is certain beside a fault that leaves a little more
        ([2e5, 2e5, 1e4, 2e3], 2e3, 1.0),
    ],
)
def test_the_odds_of_models_are_the_ratio_of_their_likelihoods(squares, freedom, probability):
    """Of noise of variance 1, exp(-squares/2); whether there is friction is not known before."""
    models = [EQ_15, EQ_15, *CANDIDATE_MODELS[4:6]]
    fits = [with_squares(models[k], left, has_friction=k == 1) for k, left in enumerate(squares)]

    assert weigh(fits, freedom)[0][-1][1] == pytest.approx(probability)


def with_squares(model, left, has_friction=False, rounding_left=0.0):
    """A fit that leaves this sum of squares in units of noise, evenly over its blocks."""
    return SimpleNamespace(
        model=model,
        has_friction=has_friction,
        squares=np.full(24, left / 24),
        rounding_left=rounding_left,
        friction_torque=0.0,
        impedances=np.ones((1, 3)),
        errors=np.full(3, 1e-3),
    )


def test_friction_that_takes_up_rounding_alone_is_as_likely_as_none():
    """Of 30 that Eq. 15 leaves 6 are of rounding, which friction follows."""
    fits = [
        with_squares(EQ_15, 30.0, rounding_left=6.0),
        with_squares(EQ_15, 24.0, has_friction=True),
    ]

    weighed, _ = weigh(fits, 24)

    assert weighed[1][1] == pytest.approx(0.5)


def test_a_mechanism_may_miss_a_fifth_of_the_torque_that_it_explains():
    """It then leaves a square of that, 4 % of what it explains. Its odds rise by exp(gain) where
    the variance is that of noise, and by exp(gain / (1 + 0.04 * 2 gain)) where this is in it."""
    freedom = 2000.0

    def log_odds(explained):
        """Of a fault against Eq. 15, which leaves so much more."""
        fits = [
            with_squares(EQ_15, freedom + explained),
            with_squares(EQ_15, 10 * freedom, has_friction=True),
            with_squares(CANDIDATE_MODELS[4], freedom),
        ]
        (_, sound), _, (_, fault) = weigh(fits, freedom)[0]
        return np.log(fault / sound)

    gains = [log_odds(explained) - log_odds(0.0) for explained in (5.0, 50.0)]

    assert gains == pytest.approx([2.5 / (1 + 0.04 * 5), 25 / (1 + 0.04 * 50)], rel=1e-6)


@pytest.mark.parametrize("noise_steps", [0.0, 0.15, 0.3])
def test_noise_before_an_encoder_leaves_of_rounding_what_averages_leave(noise_steps):
    """Of 4000 readings at each of 50 places within a step the mean still errs, by a sine of the
    place; without noise it errs by a sawtooth, whose sine is 1/pi."""
    places = (np.arange(50) + 0.5) / 50
    readings = np.rint(places + noise_steps * white_noise((4000, 50), 5)) - places
    sine = 2 * np.mean(readings.mean(axis=0) * np.sin(2 * np.pi * places))
    step, rate_hz = 1e-3, 500.0
    noise_density = np.var(readings) * step**2 * 2 / rate_hz

    share = repeated_share(noise_density, rate_hz, step)

    assert share == pytest.approx(abs(sine) * np.pi, abs=0.03)


def test_candidates_are_sought_from_the_smallest_to_the_largest_of_benches():
    """Delays to 30 frames, filters of 500 to 3 Hz, frames of 100 kN*m/rad to belts of 250 N*m/rad,
    gaps of 0.03 deg to the SD of the angle."""
    filters = 1 / (2 * np.pi * np.array([500, 3]))
    data = whitened(white())
    gaps = [np.deg2rad(0.03), data.spectra.angle[data.spectra.inside].std()]

    sizes = {
        model.name: np.sort(np.abs(model.grid(data)))[[0, -1]]
        for model in CANDIDATE_MODELS
        if model.grid
    }

    assert sizes == {
        "delay": pytest.approx([0, 0.03]),
        "low-pass": pytest.approx(filters, rel=0.1),
        "spring in series": pytest.approx([1e-5, 1 / 250]),
        "viscoelastic branch": pytest.approx([5e-3, 0.5]),
        "backlash": pytest.approx(gaps, rel=0.1),
        "backlash in the mount": pytest.approx(gaps, rel=0.1),
    }


def test_a_delay_in_the_spectrum_takes_the_torque_of_a_later_time():
    data = whitened(white(1e-3))
    spectra = data.spectra

    advanced = late(Search(data, False), 0.01)[1]

    time = np.arange(spectra.working_rows) * spectra.padded_seconds / spectra.working_rows
    torque = scipy.fft.irfft(spectra.torque, spectra.working_rows)
    spline = scipy.interpolate.make_interp_spline(time, torque, 7)
    by_time = data.column(scipy.fft.rfft(spline(np.clip(time + 0.01, 0, time[-1]))))
    assert np.abs(advanced - by_time).max() < 1e-3 * np.abs(advanced).max()


def test_a_second_of_noise_tells_its_density():
    density, _ = noise_and_band(white_noise(500, 3), RATE)
    assert density * RATE / 2 == pytest.approx(1, rel=0.5)


def test_slipping_spring_follows_prandtl_step_by_step():
    angle = np.cumsum(white_noise(300, 4))
    torque = [0.0]
    for step in np.diff(angle):
        torque.append(np.clip(torque[-1] + step / 2.0, -1, 1))

    assert slipping_springs(angle, [2.0])[0] == pytest.approx(np.array(torque), abs=1e-12)


def test_a_spring_that_slips_is_wound_by_each_way_up_to_its_limits():
    """Ways of all lengths, of which those of 2 or more are computed without the one before."""
    ways = np.random.default_rng(4).normal(scale=1.5, size=500)
    level = 0.0
    levels = [level]
    for way in ways:
        level = min(max(level + way, -1.0), 1.0)
        levels.append(level)

    assert wound_at_turns(ways) == pytest.approx(np.array(levels), abs=1e-15)


def test_rounding_is_no_unexplained_torque_even_where_the_motion_takes_it_up():
    data = whitened(white() * (1 + 3 * (np.abs(random_motion()[1]) > 0.6)))
    rounding = 200 * data.motion / np.linalg.norm(data.motion, axis=1, keepdims=True)

    def shifts(rounding):
        best = predicted(data, rounding)
        return largest_shifts(Search(data, False), best, best.left, TRUE, rounding)

    assert (shifts(0 * rounding) > 0).all()
    assert (shifts(rounding) == 0).all()


def test_errors_of_rounding_average_out_over_the_zeros_that_are_drawn():
    """Of a motion of some steps. As many independent draws would leave 1/sqrt(12)."""
    motion = random_motion()
    step = float(np.std(motion[0]))
    theta = np.round(motion[0] / step) * step
    signals = BenchSignals(theta, TRUE @ motion + white(), RATE, encoder_step=step)

    torques = rounding_torques(Whitened(WorkingSpectra(signals)), TRUE)

    assert len(torques) == 12
    assert rms(torques.mean(axis=0)) < 0.5 / np.sqrt(12) * rms(torques)


def test_signals_that_are_too_short_are_refused():
    with refused_with("6 s"):
        WorkingSpectra(BenchSignals(np.ones(100), np.ones(100), RATE))


@pytest.mark.parametrize(
    ("model", "value", "response"),
    [
        (low_passed, 2e-3, lambda _, s: 1 / (1 + 2e-3 * s)),
        (low_passed, -2e-3, lambda _, s: 1 + 2e-3 * s),
        (behind_spring, 1e-3, lambda Z, _: 1 / (1 + 1e-3 * Z)),
    ],
)
def test_a_path_gives_the_joint_behind_it(model, value, response):
    data = whitened(white(1e-6))
    Z = TRUE @ data.spectra.s ** np.arange(3)[:, None]
    data.torque = data.column(response(Z, data.spectra.s) * Z * data.spectra.derivatives[0])
    search = Search(data, False)

    assert search.fit(*model(search, value))[1] == pytest.approx(TRUE, rel=1e-3)
