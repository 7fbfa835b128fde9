"""Impedance from motions that are no stepped sine, against joints whose torque is a formula."""

import numpy as np
import polars as pl
import pytest
from any_motion import LEAD, RATE, TRUE, chirp, made_trial, multisine, noise
from bench_synthetic import second_order, stepped_sine, table_of
from conftest import ROOT, findings_of, noted_in
from scipy.interpolate import make_interp_spline
from scipy.ndimage import gaussian_filter1d
from scipy.signal import butter, cont2discrete, lfilter, lsim, sosfilt

from osl_analysis.bench.analysis import analysed
from osl_analysis.bench.bench_settings import (
    TimeBase,
)
from osl_analysis.bench.effects import IMPEDANCE, plain_sums
from osl_analysis.bench.impedance import (
    DesiredImpedance,
    impedance_table,
    impedance_with_evidence,
    rendered_impedance,
)
from osl_analysis.bench.motion import record_of_trial, stated_windows
from osl_analysis.bench.regression import fit_groups
from osl_analysis.campaign.configuration import config_for_trials
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.ingest import quality
from osl_analysis.judge.limits import Limits
from osl_analysis.model.compensator import PAPER_WEIGHT
from osl_analysis.model.drivetrain import joint_admittance, read_parameters
from osl_analysis.trial import Trial

CONFIG = ROOT / "config/config.yaml"
SETTINGS = config_for_trials(CONFIG).dynamometer
MOTIONS = {"multisine": multisine, "noise": noise}
LATENESS = "whether the torque is late"
LIGHT = {"torque_noise": 0.002, "bits": 24, "K": 1.0, "B": 0.5, "I": 0.05}


def moved(move=noise, seed=5, motion=None, **made):
    """A trial of a motion of this seed, with changed facts of its motion and of its joint."""
    rng = np.random.default_rng(seed)
    return made_trial(rng, move(rng, **(motion or {})), **made)


def moving_record(trial, windows=None, **settings):
    record = record_of_trial(
        trial, SETTINGS.model_copy(update={"excitation": "any", **settings}), windows
    )
    assert not record.is_stepped_sine
    return record


def row_of(trial, windows=None, **settings):
    record = moving_record(trial, windows, **{"excitation": "auto", **settings})
    return impedance_table(*rendered_impedance(record)).to_dicts()[0]


def half_width(row, name):
    return (row[f"{name}_high"] - row[f"{name}_low"]) / 2


def fit_of(record):
    return fit_groups(plain_sums(record, IMPEDANCE), IMPEDANCE)


OF_AMPLITUDES = {f"{name}_amplitudes_{end}" for name in "KB" for end in ("low", "high")}
OF_SINES = {"amplitude_deg", "commanded_deg", "K_change", "B_change", *OF_AMPLITUDES}
OF_FAULTS = {"fault_family", "explanations"}
"""What is there where something is heard: on sines without noise that is rounding, and each
processor's is its own."""


@pytest.mark.parametrize("name", MOTIONS)
def test_every_motion_leaves_no_column_empty_but_those_named_here(name):
    """A new column that one kind of motion does not compute is named here with its reason, or is a
    fault."""
    of_sines = table_of(stepped_sine(second_order))

    table = impedance_table(*rendered_impedance(moving_record(moved(MOTIONS[name]))))

    assert table.schema == of_sines.schema
    empty, empty_of_sines = (
        {column.name for column in each if column.is_null().all()} for each in (table, of_sines)
    )
    assert empty - empty_of_sines - OF_FAULTS == OF_SINES
    assert empty_of_sines - empty - OF_FAULTS == set()


@pytest.mark.usefixtures("without_inference")
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

    for column in ("condition_number", "largest_correlation", "theta_rms_deg"):
        assert turned[column] == pytest.approx(row[column], rel=1e-3), column
    assert half_width(turned, "K") == pytest.approx(half_width(row, "K"), rel=1e-3)
    assert row["K"] == pytest.approx(300, rel=4e-4)
    assert row["B"] == pytest.approx(5, rel=8e-4)
    assert row["I"] == pytest.approx(0.02, rel=0.006)
    assert row["excitation"] == ("periodic" if move is multisine else "other")
    assert row["VAF_held_out"] > 99.9
    assert row["band_low_hz"] < 1.2
    assert 5 < row["band_high_hz"] < 6.6


def errors_of_repeats(fit):
    """Standard errors by the scatter of periods alone, by estimate."""
    return dict(zip(fit.names, np.sqrt(np.diag(fit.repeat)), strict=True))


@pytest.mark.usefixtures("without_inference")
def test_a_multisine_has_its_period_and_its_band():
    record = moving_record(moved(multisine))
    row = impedance_table(*rendered_impedance(record)).row(0, named=True)

    (realisation,) = record.periodic.realisations
    assert realisation.periods >= 4
    assert record.periodic.period == pytest.approx(6.0, rel=1e-5)
    assert row["interval_method"] == "units"
    assert row["band_low_hz"] == pytest.approx(0.5, abs=0.3)
    assert row["band_high_hz"] == pytest.approx(6.0, abs=0.3)
    # equal, but for rounding, where nothing is missed
    assert errors_of_repeats(fit_of(record))["K"] < fit_of(record).se("K") * (1 + 1e-9)


def disturbed_trial():
    """Of 40 s, from 15 to 25 s disturbed."""
    rng = np.random.default_rng(1)
    motion = noise(rng, duration=40.0)
    time = motion[0]
    disturbance = np.where((time > 15) & (time < 25), 30 * np.sin(9 * time), 0.0)
    return made_trial(rng, motion, more=disturbance)


EDGES_S = 4 / 15  # of a window, which the filter needs


@pytest.mark.usefixtures("without_inference")
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
    trial = disturbed_trial()
    records = [record_of_trial(trial, settings, of_trial) for of_trial in (None, "2-14.5")]
    seconds = [len(record.rows()) / record.rate_hz for record in records]
    assert seconds == pytest.approx([14.5 - EDGES_S, 12.5 - EDGES_S], abs=0.02)


@pytest.mark.parametrize(
    ("text", "why"), [("5-3", "from-to"), ("1-5 4-9", "overlap"), ("1-32", "end at 32")]
)
def test_windows_that_are_none_are_refused(text, why):
    with pytest.raises(InputError, match=why):
        stated_windows(text, 30.0)


@pytest.mark.usefixtures("without_inference")
@pytest.mark.parametrize(("motion", "joint", "name", "least"), [
    ({"band": (0.5, 1.5)}, {}, "I", 0.02), ({"band": (1.8, 2.2)}, {}, "I", 0.02),
    ({"band": (8.0, 14.0)}, LIGHT, "K", 1.0),
])  # fmt: skip
def test_what_a_narrow_band_hardly_tells_has_a_wide_interval(motion, joint, name, least):
    row = row_of(moved(noise, 3, motion, **joint))

    assert half_width(row, name) > least
    assert abs(row[name] - {**TRUE, **joint}[name]) < half_width(row, name)


def test_a_motion_of_a_few_steps_of_the_encoder_is_refused():
    words = "hardly moves: theta turns by 1[0-9] steps of its encoder, 20 are needed"
    with pytest.raises(InputError, match=words):
        row_of(moved(noise, 3, {"rms_deg": 0.04}, bits=14))


def ramps(rng):
    """Ramps between levels, over a minute."""
    time = np.arange(15_000) / 250
    levels, knots = np.deg2rad(rng.uniform(-8, 8, 60)), 1 + np.cumsum(rng.uniform(0.3, 1.0, 120))
    corners = np.interp(time, knots, np.repeat(np.append(0.0, levels), 2)[1:-1])
    spline = make_interp_spline(time, gaussian_filter1d(corners, 10), 5)
    return time, tuple(spline(time, order) for order in range(3))


def test_ramps_between_levels_tell_K():
    """0.1 % of the torque's RMS in the shape of the acceleration is 0.04 kg*m^2."""
    _, motion = ramps(np.random.default_rng(3))
    X = np.column_stack(motion)
    own = X[:, 2] - X[:, :2] @ np.linalg.lstsq(X[:, :2], X[:, 2])[0]

    row = row_of(moved(ramps, 3, torque_noise=0.01))

    error_of_I = 1e-3 * np.std(X @ [*TRUE.values()]) / own.std()
    assert half_width(row, "I") == pytest.approx(1.96 * error_of_I, rel=0.2)
    assert abs(row["K"] - 300) < 1.5 * half_width(row, "K") < 0.3


P = read_parameters(ROOT / "config/parameters/default.yaml")
COMPENSATED = DesiredImpedance("compensated", 300.0, 5.0)


def trial_of_gains(desired, motion, late_s=0.0, seed=3):
    """A leg of the linear model, by its admittance at each line."""
    theta = motion[1][0]
    gains = desired.gains(P, PAPER_WEIGHT)
    s = 2j * np.pi * np.fft.rfftfreq(len(theta), 1 / RATE)
    s[0] = 1e-9j
    below_45_hz = np.abs(s) < 2 * np.pi * 45
    admittance = joint_admittance(gains.K_1, gains.B_1, P, P.J_j)(s)
    spectrum = np.fft.rfft(theta) / admittance * below_45_hz * np.exp(-s * late_s)
    torque = np.fft.irfft(spectrum, len(theta))
    return made_trial(np.random.default_rng(seed), motion, K=0.0, B=0.0, I=0.0, more=torque)


def row_beside_gains(trial, desired):
    saturation, gains = quality.saturated(trial), desired.gains(P, PAPER_WEIGHT)
    _, table, *_ = impedance_with_evidence(moving_record(trial), saturation, P, desired, gains)
    return table.row(0, named=True)


@pytest.mark.usefixtures("without_inference")
def test_what_gains_should_give_is_what_the_linear_model_s_torque_gives():
    desired = DesiredImpedance("uncompensated", 300.0, 5.0)
    motion = noise(np.random.default_rng(5), (0.5, 10.0))
    on_time = row_of(trial_of_gains(desired, motion))

    row = row_beside_gains(trial_of_gains(desired, motion, late_s=3e-4), desired)

    assert row["K_predicted"] == pytest.approx(on_time["K"], rel=3e-3)
    assert row["B_predicted"] == pytest.approx(on_time["B"], rel=3e-3)
    assert row["B_gap_s"] is None, "friction hides it without compensation"


@pytest.mark.usefixtures("without_inference")
@pytest.mark.parametrize("late_s", [0.0, 5e-3])
def test_the_b_of_a_compensated_leg_is_compared_with_that_of_its_gains(late_s):
    """A torque that is late by d loses K d of B."""
    motion = noise(np.random.default_rng(2), (0.5, 5.0))
    trial = trial_of_gains(COMPENSATED, motion, late_s)

    row = row_beside_gains(trial, COMPENSATED)

    assert row["B_gap_s"] == pytest.approx(late_s, rel=0.1, abs=2e-4)
    assert row["B_predicted"] == pytest.approx(5.46, rel=0.05)


@pytest.mark.usefixtures("without_inference")
@pytest.mark.parametrize("width", [0.001, 0.003, 0.01])
def test_friction_is_told_from_damping_however_quickly_it_turns_its_sign(width):
    motion = noise(rng := np.random.default_rng(8), band=(0.3, 4), rms_deg=1.5)
    row = row_of(made_trial(rng, motion, 0.01, more=0.5 * np.tanh(motion[1][1] / width)))
    assert row["B"] * (1 - row["coulomb_share"]) == pytest.approx(5, rel=0.05)
    assert row["f_C"] == pytest.approx(0.5, abs=0.025)
    assert row["B_viscous_low"] < 5 < row["B_viscous_high"]


@pytest.mark.usefixtures("without_inference")
@pytest.mark.parametrize("move", [multisine, noise])
def test_a_spring_behind_a_damper_is_no_friction_and_hides_none(
    move,
):
    """A Maxwell element of 300 N*m/rad and 3 N*m*s/rad makes the joint one of third order."""
    motion = move(np.random.default_rng(5))
    time, (theta, omega, _) = motion
    element = lsim(([3.0, 0.0], [3.0 / 300, 1.0]), theta, time)[1]
    torques = (element + size * np.tanh(omega / 0.003) for size in (0.0, 0.3))
    sound, rubbing = (
        row_of(made_trial(np.random.default_rng(6), motion, more=more)) for more in torques
    )
    assert sound["f_C"] is None
    assert rubbing["f_C"] == pytest.approx(0.3, rel=0.1)
    assert rubbing["B_viscous"] == pytest.approx(sound["B"], abs=0.02)


def binary_steps(cutoff_hz=None, every=20, rate=1000.0):
    """A second-order servo follows a binary command, whose acceleration jumps at every change of
    the command, on the clock of the sampling; recorded as it is, or through a low-pass. Torque of
    `TRUE` with time and angle."""
    rng, fine, w = np.random.default_rng(9), rate * every, 2 * np.pi * 30
    levels = np.repeat(rng.choice([-0.035, 0.035], 60), 100)
    wanted = np.repeat(np.pad(levels, 1500), every)

    def follows(*numerator):
        top, bottom, _ = cont2discrete((numerator, [1, 1.8 * w, w**2]), 1 / fine)
        return lfilter(top[0], bottom, wanted)

    theta, omega = follows(w**2), follows(w**2, 0)
    alpha = w**2 * (wanted - theta) - 1.8 * w * omega
    signals = [theta, TRUE["K"] * theta + TRUE["B"] * omega + TRUE["I"] * alpha]
    if cutoff_hz:
        signals = sosfilt(butter(2, cutoff_hz, fs=fine, output="sos"), signals)
    theta, torque = (signal[::every] for signal in signals)
    time = np.arange(len(theta)) / rate
    noisy = torque + 0.05 * rng.standard_normal(len(time))
    return pl.DataFrame({"time": time, "theta": theta, "torque": noisy})


@pytest.mark.parametrize("steps", [{"every": 1}, {"cutoff_hz": 200.0}], ids=["plain", "low-pass"])
def test_of_binary_steps_nothing_is_accused_and_the_delay_is_not_checked(steps):
    """Without a low-pass the torque's jumps are sampled as if late by up to a sample."""
    row = row_of(Trial("made", binary_steps(**steps)))

    assert row["K"] == pytest.approx(300, rel=3e-4)
    assert row["B"] == pytest.approx(5, abs=1.5 * 300 * 1e-3)
    assert row["fault_probability"] is None
    assert LATENESS in [finding.cause for finding in noted_in("impedance", row)]


def test_a_multisine_that_stops_within_a_period_tells_its_lag():
    rng = np.random.default_rng(3)
    time, derivatives = multisine(rng)
    kept = time < LEAD + 27.3
    motion = time[kept], tuple(derivative[kept] for derivative in derivatives)

    record = moving_record(made_trial(rng, motion, bits=14, late=2e-3))
    row = impedance_table(*rendered_impedance(record)).row(0, named=True)

    assert row["excitation"] == "periodic"
    assert [each.periods for each in record.periodic.realisations] == [4]
    assert row["fault_family"] == "path"
    moved = 300 * 2e-3 / row["B"]  # by the delay; by other rivals more
    assert 0.95 * moved < row["B_fault_share"] < 3 * moved


def standardised_errors(move, seeds, motion, **made):
    """Errors of K, B and I over their standard errors, and over those of noise alone, of records
    with these seeds."""
    errors = []
    errors_of_noise = []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        record = moving_record(made_trial(rng, move(rng, **motion), **made))
        fit = analysed(record, plain_sums(record, IMPEDANCE), IMPEDANCE).whole
        for name, true in TRUE.items():
            errors.append((fit[name] - true) / fit.se(name))
            of_repeats = errors_of_repeats(fit)[name] if fit.repeat is not None else fit.se(name)
            errors_of_noise.append((fit[name] - true) / of_repeats)
    return np.array(errors), np.array(errors_of_noise)


def root_mean_square(values):
    return np.sqrt(np.mean(np.square(values)))


def test_intervals_of_noise_cover_the_truth():
    """Within 4 standard errors of an RMS of 75 numbers; 95 +- 2 % needs hundreds of records."""
    errors, _ = standardised_errors(noise, 25, {"duration": 10.0})

    assert root_mean_square(errors) == pytest.approx(1, abs=4 * 0.08)


def test_intervals_cover_the_truth_where_periods_repeat_their_rounding():
    """Periods of whole samples, 14 bits: beside noise alone the errors have an RMS of 8."""
    errors, of_noise = standardised_errors(multisine, 8, {}, bits=14, torque_noise=0.01)

    assert 0.4 < root_mean_square(errors) < 1 + 4 * 0.14
    assert root_mean_square(of_noise) > 1.8


@pytest.mark.parametrize(("name", "clip", "sides"), [
    ("noise", 12.0, "one"), ("multisine", 12.0, "both"),
])  # fmt: skip
def test_a_torque_clipped_before_its_noise_is_named(name, clip, sides):
    trial = made_trial(rng := np.random.default_rng(2), MOTIONS[name](rng), torque_noise=0.0)
    clipped = trial.samples["torque"].clip(-clip, clip if sides == "both" else None)
    noisy = clipped + pl.Series(0.05 * rng.standard_normal(len(clipped)))

    row = row_of(Trial("made", trial.samples.with_columns(torque=noisy)), excitation="any")

    assert row["fault_family"] == "clipping"


def test_a_longest_gap_that_is_stated_is_bridged():
    samples = moved(noise, 7, {"rms_deg": 4.0}).samples
    rows = np.arange(len(samples))
    gap_of_600_ms = Trial("made", samples.filter(pl.Series((rows < 4000) | (rows > 4150))))
    record = moving_record(gap_of_600_ms, time_base=TimeBase(longest_gap_s=0.7))
    assert len(record.rows()) / record.rate_hz > 28


def up_and_down(time):
    """An angle [rad] that goes up by 4 deg from 5 s on, and down from 25 s on."""
    up, down = (np.clip((time - at) / 15.0, 0, 1) for at in (5.0, 25.0))
    return np.deg2rad(4) * (
        10 * up**3 - 15 * up**4 + 6 * up**5 - (10 * down**3 - 15 * down**4 + 6 * down**5)
    )


@pytest.mark.parametrize(("angle", "words"), [
    (up_and_down, r"noise of the encoder has .* times the power.*by 0\.5 to 6 Hz"),
    (lambda t: 0.1 * np.arcsin(np.sin(0.12 * t)),
     r"of 18 deg.*moves too slowly"),
    (lambda t: 0 * t, r"trial made: the joint does not move: theta turns by 0 deg in all"),
    (
        lambda t: np.deg2rad(4) * np.sin(2 * np.pi * 1.7 * t) * (t > 2) * (t < 2 + 40 / 1.7),
        r"K and I cannot .* sines are of 1\.7 Hz alone"
        r".*below 0\.85 Hz or from 3\.4 Hz as well",
    ),
])  # fmt: skip
def test_a_motion_that_cannot_tell_is_refused_with_what_is_missing(angle, words):
    trial = turned_by(angle)
    with pytest.raises((IdentifiabilityError, InputError), match=words):
        impedance_table(*rendered_impedance(record_of_trial(trial, SETTINGS)))


def turned_by(angle):
    time = np.arange(0, 40, 1 / 250)
    motion = angle(time), 0 * time, 0 * time
    return made_trial(np.random.default_rng(1), (time, motion), B=0.0, I=0.0)


@pytest.mark.parametrize("windows", [None, "2-30"])
def test_a_joint_that_rests_is_refused_as_any_motion(windows):
    still = turned_by(lambda t: 0 * t)
    with pytest.raises(InputError, match=r"made: the joint does not move: .* check the channel"):
        moving_record(still, windows)


@pytest.mark.parametrize(("rate", "words"), [
    (8, "or 8 rows per second are too few"), (25, "record .* 100 rows per second or more"),
])  # fmt: skip
def test_too_few_rows_per_second_are_named(rate, words):
    with pytest.raises(InputError, match=words):
        row_of(moved(noise, 4, {"rate": rate}))


@pytest.mark.usefixtures("without_inference")
def test_a_hundred_rows_per_second_are_enough():
    assert row_of(moved(noise, 4, {"rate": 100.0}))["K"] == pytest.approx(300, rel=0.01)


@pytest.mark.parametrize("excitation", ["auto", "any"])
def test_an_angle_of_noise_is_refused_as_noise(excitation):
    samples = moved(noise, 4).samples
    white = 0.05 * np.random.default_rng(4).standard_normal(len(samples))
    with pytest.raises(InputError, match="theta is noise"):
        row_of(Trial("made", samples.with_columns(theta=white)), excitation=excitation)


def test_a_second_of_motion_is_too_short():
    short = moved(noise, 4, {"rate": 45.0}).samples[200:240]
    with pytest.raises(InputError, match=r"nothing is left to fit: .*; record for longer"):
        row_of(Trial("made", short), excitation="any")


def changing(motion, share):
    """Torque of a stiffness that changes by a share of K from the begin of the motion of 30 s to
    its end."""
    time, (theta, *_) = motion
    return TRUE["K"] * share * (time - LEAD) / 30.0 * theta


@pytest.mark.parametrize(("name", "share"), [("multisine", 0.06), ("noise", -0.08)])
def test_a_change_of_the_stiffness_is_told_with_its_share_of_k(name, share):
    motion = MOTIONS[name](np.random.default_rng(3))
    trial = made_trial(
        np.random.default_rng(1), motion, torque_noise=0.02, more=changing(motion, share)
    )
    row = row_of(trial, excitation="any")
    # of its mean over time K differs by half the change
    assert row["K_fault_share"] == pytest.approx(abs(share) / 2, rel=0.3)
    assert "change over time" in [one.cause for one in findings_of(row, Limits(), "response")]


@pytest.mark.usefixtures("without_inference")
def test_friction_of_a_motion_beyond_the_cutoff_is_that_of_all_that_moves():
    """By what the filter leaves of the motion it is 0.17 N*m."""
    motion = noise(
        rng := np.random.default_rng(1), band=(0.4, 20.0), rms_deg=1.5, duration=60.0, rate=1000.0
    )
    row = row_of(made_trial(rng, motion, more=0.5 * np.tanh(motion[1][1] / 2e-3)), excitation="any")
    assert row["band_high_hz"] > 1.1 * row["cutoff_hz"]
    assert row["f_C"] == pytest.approx(0.5, rel=0.1)
    assert row["B_viscous"] == pytest.approx(TRUE["B"], rel=0.01)
