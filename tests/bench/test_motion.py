# SPDX-License-Identifier: Apache-2.0
"""Impedance from motions that are no stepped sine, against joints whose torque is a formula."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
import scipy
from any_motion import RATE, TRUE, chirp, made_trial, multisine, noise, sines
from bench_synthetic import table_of, unit_sines
from conftest import half_width, least_squares_alone, refused_with, white_noise
from scipy.ndimage import gaussian_filter1d
from shipped import CONFIG
from shipped import LEG as P

from osl_analysis.base.errors import IdentifiabilityError, InputError
from osl_analysis.base.trial import Trial
from osl_analysis.bench.evidence import DesiredImpedance, impedance_table
from osl_analysis.bench.impedance import rendered_impedance
from osl_analysis.bench.motion import record_of_trial
from osl_analysis.bench.plausibility import check_resists
from osl_analysis.model.compensator import PAPER_WEIGHT
from osl_analysis.model.drivetrain import dynamic_stiffness, linear_torque
from osl_analysis.signals.grid import TimeBase

SETTINGS = CONFIG.dynamometer
# a protocol of which nothing is stated
ANY = SETTINGS.model_copy(update={"amplitudes_deg": None, "frequencies_hz": None, "cycles": None})


def moved(move=noise, seed=5, motion=None, **made):
    """A trial of a motion of this seed, with changed facts of its motion and of its joint."""
    rng = np.random.default_rng(seed)
    return made_trial(rng, move(rng, **(motion or {})), **made)


def moving_record(trial, windows=None, **settings):
    record = record_of_trial(
        trial, SETTINGS.model_copy(update={"excitation": "any", **settings}), windows
    )
    assert record.groups.kind != "cycles"
    return record


def row_of(trial, windows=None, **settings):
    record = moving_record(trial, windows, **{"excitation": "auto", **settings})
    return table_of(record).row(0, named=True)


def smoothed(angle, sd_s, rate=RATE):
    """Times, and an angle (n,) behind a Gaussian filter, with its derivatives."""
    motion = [
        gaussian_filter1d(angle, sd_s * rate, order=n, truncate=8) * rate**n for n in range(3)
    ]
    return np.arange(len(angle)) / rate, motion


@least_squares_alone
@pytest.mark.parametrize("move", [multisine, noise, chirp])
def test_any_motion_about_any_zero_gives_the_impedance_of_the_torque(
    move,
):
    """Bias and spread of 0.03, 0.05 and 0.3 % are claimed for 60 s at 1 kHz; here a quarter of the
    samples."""
    trial = moved(move)
    about_another_zero = Trial("made", trial.samples.with_columns(pl.col("theta") + 0.5))

    row = row_of(trial)
    turned = row_of(about_another_zero)

    assert half_width(turned, "K") == pytest.approx(half_width(row, "K"), rel=1e-3)
    assert row["K"] == pytest.approx(300, rel=4e-4)
    assert row["B"] == pytest.approx(5, rel=8e-4)
    assert row["I"] == pytest.approx(0.02, rel=0.006)
    assert row["excitation"] == ("periodic" if move is multisine else "other")
    assert row["band_low_hz"] < 1.2
    assert 5 < row["band_high_hz"] < 6.6


def disturbed_trial():
    """Of 40 s, from 15 to 25 s disturbed."""
    rng = np.random.default_rng(1)
    motion = noise(rng, duration=40.0)
    time = motion[0]
    disturbance = np.where((time > 15) & (time < 25), 30 * np.sin(9 * time), 0.0)
    return made_trial(rng, motion, more=disturbance)


EDGES_S = 4 / 15  # of a window, which the filter needs


@least_squares_alone
def test_windows_are_fitted_and_nothing_else():
    trial = disturbed_trial()

    row = row_of(trial, "0.1-1.2 2-14.5 25.5-40")  # less than 1 s is left of the first
    whole = row_of(trial, excitation="any")

    assert [row[name] for name in TRUE] == pytest.approx(list(TRUE.values()), rel=0.01)
    assert row["fitted_s"] == pytest.approx(12.5 + 14.5 - 2 * EDGES_S, abs=0.02)
    assert abs(whole["K"] / 300 - 1) > 0.004
    assert whole["fitted_s"] == pytest.approx(40, abs=0.8)


def test_windows_of_the_trial_replace_those_of_the_settings():
    settings = SETTINGS.model_copy(update={"excitation": "any", "windows": "25.5-40"})

    record = record_of_trial(disturbed_trial(), settings, "2-14.5")

    fitted = record.time[record.is_fitted()] - record.time[0]
    assert 2.0 < fitted.min() < 2.3
    assert 14.2 < fitted.max() < 14.5


def test_a_window_beyond_the_end_is_refused():
    with refused_with("'1-90' reach beyond"):
        disturbed_trial().cut_to("1-90")


COMPENSATED = DesiredImpedance("compensated", 300.0, 5.0)


@least_squares_alone
@pytest.mark.parametrize("late_s", [0.0, 5e-3])
def test_the_b_of_a_compensated_leg_is_compared_with_that_of_its_gains(late_s):
    """A leg of the linear model, by its admittance at each line. A torque that is late by d loses
    K d of B."""
    motion = noise(np.random.default_rng(2), (0.5, 5.0))
    theta = motion[1][0]
    gains = COMPENSATED.gains(P, PAPER_WEIGHT)

    def late_stiffness(s):
        return dynamic_stiffness(s, gains.K_1, gains.B_1, P) * np.exp(-s * late_s)

    torque = linear_torque(late_stiffness, theta, RATE, 45.0)
    trial = made_trial(np.random.default_rng(3), motion, K=0.0, B=0.0, I=0.0, more=torque)

    analysis = rendered_impedance(moving_record(trial))
    row = impedance_table(analysis, P, COMPENSATED, gains)["impedance"].row(0, named=True)

    # less what another part of the motion makes of B
    assert row["B_gap_s"] == pytest.approx(late_s, rel=0.15, abs=2e-4)
    assert row["B_predicted"] == pytest.approx(5.46, rel=0.05)
    faster = replace(analysis, record=replace(analysis.record, band_hz=(0.5, 16.0)))
    assert impedance_table(faster, P, COMPENSATED, gains)["impedance"]["B_gap_s"].has_nulls()


def rubbing_row(width, **motion):
    """The row of a joint with friction of 0.5 N*m that turns its sign within `width` [rad/s]."""
    rng = np.random.default_rng(8)
    rubbing = noise(rng, rms_deg=1.5, **motion)
    friction = 0.5 * np.tanh(rubbing[1][1] / width)
    return row_of(made_trial(rng, rubbing, 0.01, more=friction), excitation="any")


@least_squares_alone
@pytest.mark.parametrize("width", [0.001, 0.003, 0.01])
def test_friction_is_told_from_damping_however_quickly_it_turns_its_sign(width):
    """The column's is 0.01 rad/s. If it were sampled at the coarse rate, f_C would be 0.497."""
    row = rubbing_row(width, band=(0.3, 4), rate=1000.0)

    assert row["f_C"] == pytest.approx(0.5, abs=5e-4 + 0.3 * (0.01 - width))
    assert row["B_viscous_low"] < 5 < row["B_viscous_high"]


@least_squares_alone
@least_squares_alone
def test_a_spring_behind_a_damper_is_no_friction_and_hides_none():
    """A Maxwell element of 300 N*m/rad and 3 N*m*s/rad makes the joint one of third order."""
    motion = noise(np.random.default_rng(5))
    time, (theta, omega, _) = motion
    element = scipy.signal.lsim(([3.0, 0.0], [3.0 / 300, 1.0]), theta, time)[1]

    sound, rubbing = (
        row_of(made_trial(np.random.default_rng(6), motion, more=element + friction))
        for friction in (0.0, 0.3 * np.tanh(omega / 0.003))
    )

    assert sound["f_C"] is None
    assert rubbing["f_C"] == pytest.approx(0.3, rel=0.1)
    assert rubbing["B_viscous"] == pytest.approx(sound["B"], abs=0.02)


def test_friction_of_a_motion_beyond_the_cutoff_is_that_of_all_that_moves():
    """By what the filter leaves of the motion it is 0.17 N*m."""
    row = rubbing_row(2e-3, band=(0.4, 20.0), duration=60.0, rate=1000.0)

    assert row["f_C"] == pytest.approx(0.5, rel=0.1)
    assert row["B_viscous"] == pytest.approx(5, rel=0.01)


LEANING = 5 * np.tanh(5 * np.sin(0.6 * np.arange(33 * RATE) / RATE))  # N*m


@pytest.mark.parametrize(
    ("move", "seeds", "motion", "made", "least", "most"),
    [
        # within 4 standard errors of an RMS of 75 numbers; 95 +- 2 % needs hundreds of records
        (noise, 25, {"duration": 10.0}, {}, 1 - 4 * 0.08, 1 + 4 * 0.08),
        # periods that repeat their rounding: beside noise alone the errors have an RMS of 8
        (multisine, 8, {}, {"bits": 14, "torque_noise": 0.01}, 0.4, 1 + 4 * 0.14),
        # noise of the angle in slow columns: without it in the intervals the errors have an
        # RMS of 1.4
        (
            noise,
            6,
            {"band": (0.2, 2.0), "rms_deg": 4.0, "duration": 90.0},
            {"bits": 12, "torque_noise": 0.01},
            0.4,
            1.2,
        ),
        # a person who leans on the handle: without the high-pass the errors have an RMS of 0.2
        (noise, 8, {}, {"more": LEANING}, 0.5, 1 + 4 * 0.14),
    ],
)
def test_intervals_cover_the_truth(move, seeds, motion, made, least, most):
    errors = []  # of K, B and I over their standard errors
    for seed in range(seeds):
        whole = rendered_impedance(moving_record(moved(move, seed, motion, **made))).whole
        errors.extend((whole[name] - true) / whole.se(name) for name, true in TRUE.items())

    assert least < np.sqrt(np.mean(np.square(errors))) < most


def test_any_motion_is_fitted_by_least_squares_behind_a_high_pass():
    """As by NumPy over the lines of a cosine transform, times the gain."""
    record = moving_record(moved(noise, 3, {"duration": 10.0}, bits=22))
    fit = rendered_impedance(record).whole
    rows = record.is_fitted()
    n = rows.sum()
    X = np.column_stack([record.motion.columns, np.ones_like(record.time), record.time])[rows]
    columns, torque = (scipy.fft.dct(x, axis=0) for x in (X, record.filtered_torque[rows]))
    hz = np.arange(n) * record.rate_hz / (2 * n)
    hz[0] = hz[1] / 4
    gain = (1 + (record.band_hz[0] / hz) ** 4) ** -0.5

    plain, *_ = np.linalg.lstsq(gain[:, None] * columns, gain * torque)

    np.testing.assert_allclose(fit.estimates[:3], plain[:3], rtol=2e-4)


@pytest.mark.parametrize("period_s", [0.4, 0.8, 1.25, 1.48, 1.52, 1.9])
def test_one_repeated_part_of_a_period_is_enough_for_repeats(period_s):
    """Gait at any pace: a period below a second and a half is a single part."""
    rng = np.random.default_rng(3)
    gait = sines(rng, np.arange(1, 7) / period_s, duration=24.0)

    record = moving_record(made_trial(rng, gait))

    assert record.groups.kind == "periods"
    assert record.groups.repeat().any()


@pytest.mark.parametrize("periods", [2.6, 3.6])
def test_a_part_of_a_period_counts_once_however_often_it_was_recorded(periods):
    """A hardening spring, by NumPy over two periods. By what stands twice K is 2.5 % less, by all
    rows alike 0.7 %."""
    motion = multisine(np.random.default_rng(5))
    time, (theta, *_) = motion
    harder = 2e4 * theta**3
    trial = made_trial(np.random.default_rng(3), motion, 1e-3, more=harder)
    steady = replace(trial, samples=trial.samples.slice(round(3 * RATE), round(6 * periods * RATE)))
    rows = (time > 4) & (time < 16)
    of_spring, *_ = np.linalg.lstsq(np.column_stack(motion[1])[rows], harder[rows])

    fit = rendered_impedance(moving_record(steady)).whole
    assert fit["K"] == pytest.approx(TRUE["K"] + of_spring[0], rel=5e-4)


JUMPS = [
    ("sines about a quarter of the moving time", (5, 6, 7, 8)),
    ("three to four sines", (3, 4, 5)),
    ("periods that differ by 3 %", (0.02, 0.03, 0.035, 0.04)),
    ("one more cycle", (4, 5, 6)),
]


def neighbour(kind, size):
    """An angle, and a recording of it beside one whose `size` is a little larger: friction of 4 %
    makes what Eq. 15 misses."""
    rng = np.random.default_rng(6)
    if kind == "sines about a quarter of the moving time":
        x = noise(rng, duration=30.0, rms_deg=1.0)[1][0]
        sines = np.deg2rad(2) * unit_sines([(hz, size) for hz in (1, 2, 3, 4)], RATE)
        angle = np.concatenate([x, sines])
    elif kind == "three to four sines":
        angle = np.deg2rad(3) * unit_sines([(hz, 10) for hz in np.linspace(1, 4, size)], RATE)
    elif kind == "one more cycle":
        parts = [(hz, 8) for hz in (1, 2, 3, 4)]
        angle = np.deg2rad(3) * unit_sines([*parts, *parts, (5, size)], RATE)
    else:
        t = np.arange(int(8 * RATE)) / RATE
        lines = np.arange(3, 48, 2)
        period = np.sin(2 * np.pi / 8 * np.outer(t, lines) + rng.uniform(0, 6, len(lines)))
        one = np.deg2rad(3) * (period @ (1 / np.sqrt(lines)))
        angle = np.concatenate([one * (1 + size * sign) for sign in (1, -1, 1, -1)])
    motion = smoothed(np.pad(angle, int(RATE)), 0.01)
    trial = made_trial(np.random.default_rng(1), motion, torque_noise=0.05)
    rubs = 0.04 * np.std(trial.samples["torque"].to_numpy()) * np.tanh(motion[1][1] / 5e-3)
    return Trial("made", trial.samples.with_columns(torque=pl.col("torque") + rubs))


def test_noise_drawn_anew_hardly_moves_an_interval():
    sines = np.deg2rad(3) * unit_sines([(hz, 14) for hz in (1, 2, 3, 4, 5)], RATE)
    motion = smoothed(np.pad(sines, int(RATE)), 0.01)
    fits = [
        rendered_impedance(record_of_trial(made_trial(np.random.default_rng(k), motion), ANY)).whole
        for k in range(16)
    ]

    low, high = np.quantile([fit.half_width("K") for fit in fits], [0.05, 0.95])
    assert high < 2.5 * low
    assert np.median([fit.budget("K").spread()[1] for fit in fits]) > 11


@pytest.mark.parametrize(("kind", "sizes"), JUMPS)
def test_no_estimate_and_no_interval_jumps(kind, sizes):
    fits = [rendered_impedance(record_of_trial(neighbour(kind, s), ANY)).whole for s in sizes]

    for name in "KBI":
        half_widths = np.array([fit.half_width(name) for fit in fits])
        assert np.all(np.abs(np.diff(np.log(half_widths))) < np.log(2.2)), name
    # B changes with the motion, as friction does
    K = [fit["K"] for fit in fits]
    assert np.ptp(K) < max(fit.half_width("K") for fit in fits)


def test_rounding_of_a_creep_to_two_levels_is_in_the_interval_of_K():
    """By what K scatters over zeros of the encoder. With the other sign of what an error's rate
    does it is 1.6 times as large."""
    levels = np.repeat(np.tile(np.deg2rad([3, -3]), 20), 200)
    motion = smoothed(scipy.signal.lfilter([0.02], [1, -0.98], levels), 0.03)
    fits = []
    for seed in range(16):
        trial = made_trial(np.random.default_rng(seed), motion, 1e-3, bits=12, K=100.0)
        fits.append(rendered_impedance(moving_record(trial)).whole)

    assert fits[0].se("K") == pytest.approx(np.std([fit["K"] for fit in fits]), rel=0.25)


@least_squares_alone
@pytest.mark.parametrize(
    "joint",
    [
        {"K": -20.0, "B": 0.0},
        {"K": -30.0, "B": 9.0, "I": -0.02},
    ],
)
def test_a_weight_above_its_axis_and_a_mass_behind_a_spring_are_fitted(joint):
    """Above its resonance K of Eq. 15 is negative, and B positive."""
    assert row_of(moved(multisine, 2, **joint))["K"] == pytest.approx(joint["K"], rel=1e-2)


def test_a_negative_stiffness_is_refused_where_its_interval_excludes_zero():
    check_resists("made", "K", -0.1, high=0.1)
    with refused_with("drives the motion"):
        check_resists("made", "K", -0.1, high=-0.05)


def test_rounding_of_a_small_stepped_sine_is_in_the_interval_of_K():
    """Of 23 steps of the encoder."""
    rate = 1000.0
    sines = unit_sines([(hz, 8) for hz in (0.5, 0.75, 1, 2)], rate)
    motion = smoothed(np.deg2rad(2) * np.pad(sines, 1000), 0.01, rate)
    held = []
    for seed in range(12):
        trial = made_trial(np.random.default_rng(seed), motion, 0.01, bits=11)
        fits = rendered_impedance(record_of_trial(trial, SETTINGS)).fits
        for fit in fits.values():  # of its amplitude, and of all
            held.append(abs(fit["K"] - TRUE["K"]) < fit.half_width("K"))
            assert fit.half_width("K") < 0.05 * TRUE["K"]
    assert sum(held) >= 20


def test_two_sines_of_one_settled_cycle_are_fitted_in_blocks():
    """As cycles, two of five estimates' residuals are 0: K was held in one of seven."""
    parts = [np.pad(unit_sines([(hz, 4)], RATE), 60) for hz in (1, 4)]
    motion = smoothed(np.deg2rad(4) * np.pad(np.concatenate(parts), int(RATE)), 0.01)
    held = []
    for seed in range(12):
        trial = made_trial(np.random.default_rng(seed), motion)
        record = record_of_trial(trial, SETTINGS)
        whole = rendered_impedance(record).whole
        held += [abs(whole[name] - true) < whole.half_width(name) for name, true in TRUE.items()]
        assert record.groups.kind != "cycles"
        assert whole.half_width("K") < 0.01 * TRUE["K"]
    assert np.mean(held) > 0.85


def test_a_longest_gap_that_is_stated_is_bridged():
    samples = moved(noise, 7, {"rms_deg": 4.0}).samples
    rows = np.arange(len(samples))
    gap_of_600_ms = Trial("made", samples.filter(pl.Series((rows < 4000) | (rows > 4150))))
    record = moving_record(gap_of_600_ms, time_base=TimeBase(longest_gap_s=0.7))
    assert record.is_fitted().sum() / record.rate_hz > 28


@pytest.mark.parametrize(
    ("angle", "words"),
    [
        (lambda t: 0.1 * np.arcsin(np.sin(0.12 * t)), "18 deg.*torque_angle"),
        (lambda t: 0 * t, "trial made:.*theta.*0 deg"),
        (
            lambda t: np.deg2rad(4) * np.sin(2 * np.pi * 1.7 * t) * (t > 2) * (t < 2 + 40 / 1.7),
            r"K.*I.*1\.7 Hz.*0\.85 Hz.*3\.4 Hz",
        ),
    ],
)
def test_a_motion_that_cannot_tell_is_refused_with_what_is_missing(angle, words):
    time = np.arange(0, 40, 1 / 250)
    motion = angle(time), 0 * time, 0 * time
    trial = made_trial(np.random.default_rng(1), (time, motion), B=0.0, I=0.0)
    with pytest.raises((IdentifiabilityError, InputError), match=words):
        table_of(record_of_trial(trial, SETTINGS))


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        ({"rate": 8}, "8 rows"),
        ({"rate": 25}, "100 rows"),
        ({"rms_deg": 0.04}, "theta.* 1[0-9] steps.* 20 "),
        ({"rms_deg": 0.2, "band": (0.2, 2.0)}, r"encoder has 0\.3[0-9]* times"),
    ],
)
def test_few_rows_per_second_steps_and_noise_of_the_encoder_are_refused(motion, words):
    with pytest.raises((IdentifiabilityError, InputError), match=words):
        row_of(moved(noise, 4, motion, bits=14))


@pytest.mark.parametrize("excitation", ["auto", "any"])
def test_an_angle_of_noise_is_refused_as_noise(excitation):
    samples = moved(noise, 4).samples
    white = 0.05 * white_noise(len(samples), 4)
    with refused_with(r"theta.*torque_angle"):
        row_of(Trial("made", samples.with_columns(theta=white)), excitation=excitation)


def test_a_second_of_motion_is_too_short():
    short = moved(noise, 4, {"rate": 45.0}).samples[200:240]
    with refused_with(r"trial made:.*0\.733 s.*1 s"):
        row_of(Trial("made", short), excitation="any")
