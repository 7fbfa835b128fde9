"""Impedance from motions that are no stepped sine, against joints whose torque is a formula."""

import numpy as np
import polars as pl
import pytest
from any_motion import LEAD, RATE, TRUE, chirp, made_trial, multisine, noise
from bench_synthetic import second_order, stepped_sine, table_of
from conftest import ROOT, findings_of
from scipy.interpolate import make_interp_spline
from scipy.ndimage import gaussian_filter1d
from scipy.signal import butter, cont2discrete, lfilter, lsim, sosfilt

from osl_analysis.bench.analysis import analysed, angle_noise_bias, angle_noise_share
from osl_analysis.bench.bench_settings import (
    BenchStiffness,
    DynamometerAnalysis,
    ModelComparison,
    TimeBase,
)
from osl_analysis.bench.condition_tables import repeated_trials_table
from osl_analysis.bench.effects import IMPEDANCE, plain_sums, with_effects
from osl_analysis.bench.fit_tables import timebase_table
from osl_analysis.bench.frequency_response import impedance_over_frequency
from osl_analysis.bench.impedance import (
    DesiredImpedance,
    fit_and_judge_impedance,
    impedance_table,
    rendered_impedance,
)
from osl_analysis.bench.recorded_motion import record_of_trial, stated_windows
from osl_analysis.campaign.configuration import read_section
from osl_analysis.commands.bench import fit_impedance_trial
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.ingest import examine
from osl_analysis.judge.finding import Grade
from osl_analysis.judge.limits import DoubtfulFits, Limits
from osl_analysis.model.compensator import PAPER_WEIGHT
from osl_analysis.model.drivetrain import joint_admittance, read_parameters
from osl_analysis.spectral.periods import periodic_motion
from osl_analysis.trial import Trial

CONFIG = ROOT / "config/config.yaml"
SETTINGS = read_section(CONFIG, "dynamometer", DynamometerAnalysis)
DOUBTS = read_section(CONFIG, "doubtful", DoubtfulFits)
LIMITS = DOUBTS.of("impedance")
MOTIONS = {"multisine": multisine, "noise": noise, "chirp": chirp}
LIGHT = {"torque_noise": 0.002, "bits": 24, "K": 1.0, "B": 0.5, "I": 0.05}


def moving_record(trial, windows=None, **settings):
    record = record_of_trial(
        trial, SETTINGS.model_copy(update={"excitation": "any", **settings}), windows
    )
    assert not record.is_stepped_sine
    return record


def row_of(trial, windows=None, **settings):
    record = moving_record(trial, windows, **{"excitation": "auto", **settings})
    return impedance_table(*rendered_impedance(record)).to_dicts()[0]


def fit_of(record):
    return with_effects(plain_sums(record, IMPEDANCE), IMPEDANCE)


OF_AMPLITUDES = {f"{name}_amplitudes_{end}" for name in TRUE for end in ("low", "high")}
OF_SINES = OF_AMPLITUDES | {"amplitude_deg", "commanded_deg", "K_change", "B_change"}
OF_PERIODS = {"K_drift", *(f"{name}_repeat_se" for name in TRUE)}  # and of sines
BESIDE_RIVALS = [f"{name}_without{end}" for name in TRUE for end in ("", "_low", "_high")]
OF_ANOTHER_FIT = {"cov_K_B", "cov_K_I", "cov_B_I"}  # where the inference gave the estimates
OF_FAULTS = {"fault", "fault_family", "explanations", *BESIDE_RIVALS, *OF_ANOTHER_FIT}
"""What is there where something is heard: on sines without noise that is rounding, and each
processor's is its own."""


def test_every_motion_has_the_same_columns_and_leaves_none_empty_but_those_that_are_named_here():
    """A new column that one kind of motion does not compute is named here with its reason, or is a
    fault."""
    rng, sines = np.random.default_rng(5), table_of(stepped_sine(second_order))
    empty = {column for column in sines.columns if sines[column].is_null().all()}
    for name, move in MOTIONS.items():
        table = impedance_table(*rendered_impedance(moving_record(made_trial(rng, move(rng)))))
        assert table.schema == sines.schema
        own = {column for column in table.columns if table[column].is_null().all()}
        assert own - empty - OF_FAULTS == (
            OF_SINES if name == "multisine" else OF_SINES | OF_PERIODS
        )
        of_motion = {"period_s", "periods", "realisations"} if name == "multisine" else set()
        assert empty - own - OF_FAULTS == of_motion


@pytest.mark.usefixtures("without_inference")
@pytest.mark.parametrize("name", MOTIONS)
def test_any_motion_gives_the_impedance_that_made_the_torque_wherever_the_zero_of_the_angle_is(
    name,
):
    """Bias and spread of 0.03, 0.05 and 0.3 % are claimed for 60 s at 1 kHz; here a quarter of the
    samples."""
    row = row_of(trial := made_trial(rng := np.random.default_rng(5), MOTIONS[name](rng)))
    turned = row_of(Trial("made", trial.samples.with_columns(pl.col("theta") + 0.5)))
    for column in (
        "K_se",
        "condition_number",
        "largest_correlation",
        "theta_rms_deg",
    ):
        assert turned[column] == pytest.approx(row[column], rel=1e-3), column
    assert [row[k] for k in TRUE] == pytest.approx(list(TRUE.values()), rel=0.006)
    assert row["K"] == pytest.approx(300, rel=4e-4)
    assert (row["B"], row["excitation"]) == (
        pytest.approx(5, rel=8e-4),
        {"multisine": "periodic"}.get(name, "other"),
    )
    if name == "multisine":
        assert (row["realisations"], row["interval_method"]) == (1, "units")
        assert row["periods"] >= 4
        assert row["period_s"] == pytest.approx(6.0, rel=1e-5)
        sixths = [6 * row[f"band_{end}_hz"] for end in ("low", "high")]
        assert sixths == pytest.approx(np.round(sixths), abs=1e-4), "lines of the period"
        # equal, but for rounding, where nothing is missed
        assert row["K_repeat_se"] < row["K_se"] * (1 + 1e-9)
    assert row["load_cell_drift"] == pytest.approx(0.06, abs=0.02)  # N*m/min, as 1e-3 N*m/s
    assert row["VAF_held_out"] > 99.9
    assert row["band_low_hz"] < 1.2
    assert 5 < row["band_high_hz"] < 6.6


@pytest.mark.usefixtures("without_inference")
def test_windows_are_fitted_and_nothing_else(tmp_path):
    motion = noise(rng := np.random.default_rng(1), duration=40.0)
    disturbed = np.where((motion[0] > 15) & (motion[0] < 25), 30 * np.sin(9 * motion[0]), 0.0)
    trial = made_trial(rng, motion, more=disturbed)
    row = row_of(trial, "0.1-1.2 2-14.5 25.5-40")  # less than 1 s is left of the first
    assert [row[k] for k in TRUE] == pytest.approx(list(TRUE.values()), rel=0.01)
    assert row["fitted_s"] == pytest.approx(12.5 + 14.5 - 4 * 2 / 15, abs=0.02)
    assert abs(row_of(trial)["K"] / 300 - 1) > 0.004
    assert row_of(trial, windows=None, excitation="any")["fitted_s"] == pytest.approx(40, abs=0.8)
    own = SETTINGS.model_copy(update={"excitation": "any", "windows": "25.5-40"})
    seconds = [record_of_trial(trial, own, stated).seconds for stated in (None, "2-14.5")]
    assert seconds == pytest.approx([14.5 - 4 / 15, 12.5 - 4 / 15], abs=0.02)
    device, asked = ROOT / "config/parameters/default.yaml", DesiredImpedance("compensated", 300, 5)
    chosen = PAPER_WEIGHT, ModelComparison(sign_width=0.05), SETTINGS
    fitted = fit_impedance_trial(trial, device, asked, *chosen, "2-14.5 25.5-40").everything()
    assert fitted["impedance"]["fitted_s"].item() == pytest.approx(
        sum(seconds[1:]) + 14.5 - 4 / 15, abs=0.05
    )
    both, longest = (
        impedance_over_frequency(moving_record(trial, x)) for x in ("2-9 26-40", "26-40")
    )
    assert both["frequency_hz"].to_list() == longest["frequency_hz"].to_list() != []


@pytest.mark.parametrize(
    ("text", "why"), [("5-3", "from-to"), ("1-5 4-9", "overlap"), ("1-32", "end at 32")]
)
def test_windows_that_are_none_are_refused(text, why):
    with pytest.raises(InputError, match=why):
        stated_windows(text, 30.0)


@pytest.mark.parametrize(("motion", "joint", "words"), [
    ({"band": (0.5, 1.5)}, {}, r"cannot tell K from I.*band from 1\.[56] to about 2\.\d Hz"),
    ({"rms_deg": 0.04},
     {"bits": 14}, "hardly moves: theta turns by 1[0-9] steps of its encoder, 20 are needed"),
    ({"band": (8.0, 14.0)}, LIGHT, r"changes K by .*band below 8(\.\d)? Hz is missing"),
])  # fmt: skip
def test_a_motion_of_too_narrow_a_band_or_size_is_refused_with_what_is_missing(
    motion, joint, words
):
    samples = made_trial(rng := np.random.default_rng(3), noise(rng, **motion), **joint).samples
    with pytest.raises((IdentifiabilityError, InputError), match=words):
        # wherever the zero of the angle is
        row_of(Trial("made", samples.with_columns(pl.col("theta") + 0.5)))


def test_a_joint_without_stiffness_has_none_to_tell():
    row = row_of(made_trial(rng := np.random.default_rng(5), noise(rng), K=0.0, B=5.0, I=0.1))
    assert abs(row["K"]) < 3 * row["K_se"]


def test_steps_too_quick_for_their_rate_are_refused_as_such_whatever_the_encoder():
    """They were told that theta turns by 11 steps of its encoder, which turned by 261."""
    time, x = np.arange(10_000) / 500, np.zeros((3, 10_000))
    for k in range(9):
        t = np.clip((time - 1 - 2 * k) / 0.02, 0, 1)
        shape = (
            t**3 * (10 - 15 * t + 6 * t**2),
            30 * (t - t * t) ** 2 / 0.02,
            60 * (t - t * t) * (1 - 2 * t) / 0.02**2,
        )
        x += 0.1 * (-1) ** k * np.array(shape)
    with pytest.raises(InputError, match=r"theta has 11 values in all.* move it more slowly"):
        row_of(made_trial(np.random.default_rng(1), (time, x), bits=14))


def test_ramps_between_levels_tell_K():
    """0.1 % of the torque's RMS in the shape of the acceleration is 0.04 kg*m^2."""
    rng, time = np.random.default_rng(3), np.arange(15_000) / 250
    levels, knots = np.deg2rad(rng.uniform(-8, 8, 60)), 1 + np.cumsum(rng.uniform(0.3, 1.0, 120))
    theta = gaussian_filter1d(
        np.interp(time, knots, np.repeat(np.append(0.0, levels), 2)[1:-1]), 10
    )
    spline = make_interp_spline(time, theta, 5)
    motion = theta, spline(time, 1), spline(time, 2)
    row = row_of(made_trial(rng, (time, motion), torque_noise=0.01))
    X = np.column_stack(motion)
    own = X[:, 2] - X[:, :2] @ np.linalg.lstsq(X[:, :2], X[:, 2])[0]
    assert row["I_se"] == pytest.approx(1e-3 * np.std(X @ [*TRUE.values()]) / own.std(), rel=0.2)
    assert abs(row["K"] - 300) < 3 * row["K_se"] < 0.3
    with pytest.raises(IdentifiabilityError, match="check the units of theta and torque"):
        row_of(made_trial(rng, (time, motion), K=3e5, B=5e3, I=20.0))


@pytest.mark.usefixtures("without_inference")
def test_what_the_gains_should_give_is_what_the_torque_of_the_linear_model_gives():
    """Torque of the linear drivetrain by its admittance at each line, and K, B and I of the joint
    beside it."""
    rng, p = np.random.default_rng(5), read_parameters(ROOT / "config/parameters/default.yaml")
    gains = (asked := DesiredImpedance("uncompensated", 300.0, 5.0)).gains(p, PAPER_WEIGHT)
    expected = joint_admittance(gains.K_1, gains.B_1, p, p.J_j)
    _, (theta, *_) = motion = noise(rng, (0.5, 10.0))
    s = 2j * np.pi * np.fft.rfftfreq(len(theta), 1 / 250)
    spectrum = np.fft.rfft(theta) * (np.abs(s) < 2 * np.pi * 45)
    s[0] = 1e-9j
    torque, late = (
        np.fft.irfft(spectrum / expected(s) * np.exp(-s * d), len(theta)) for d in (0.0, 3e-4)
    )
    record = moving_record(trial := made_trial(rng, motion, K=0.0, B=0.0, I=0.0, more=late))
    table = fit_and_judge_impedance(
        record, examine.saturated(trial), p, asked, asked.gains(p, PAPER_WEIGHT)
    )[1]
    on_time = row_of(made_trial(rng, motion, K=0.0, B=0.0, I=0.0, more=torque))
    assert table.select("K_predicted", "B_predicted").row(0) == pytest.approx(
        (on_time["K"], on_time["B"]), rel=3e-3
    )
    assert table["I_predicted"][0] == pytest.approx(on_time["I"], abs=2e-3)
    assert table["B_gap_s"][0] is None, "friction hides it without compensation"


@pytest.mark.usefixtures("without_inference")
@pytest.mark.parametrize("late", [0.0, 5e-3])
def test_the_b_of_a_compensated_leg_is_held_against_that_of_its_gains(late):
    """A torque that is late by d loses K d of B: d K over torque per angle, in seconds. Without
    noise, by formula."""
    p, asked = (
        read_parameters(ROOT / "config/parameters/default.yaml"),
        DesiredImpedance("compensated", 300.0, 5.0),
    )
    gains, (_, (theta, *_)) = (
        asked.gains(p, PAPER_WEIGHT),
        (motion := noise(np.random.default_rng(2), (0.5, 5.0))),
    )
    s = 2j * np.pi * np.fft.rfftfreq(len(theta), 1 / 250)
    s[0] = 1e-9j
    spectrum = (
        np.fft.rfft(theta) / joint_admittance(gains.K_1, gains.B_1, p, p.J_j)(s) * np.exp(-s * late)
    )
    torque = np.fft.irfft(spectrum * (np.abs(s) < 2 * np.pi * 45), len(theta))
    record = moving_record(
        trial := made_trial(np.random.default_rng(3), motion, K=0.0, B=0.0, I=0.0, more=torque)
    )
    table = fit_and_judge_impedance(
        record, examine.saturated(trial), p, asked, asked.gains(p, PAPER_WEIGHT)
    )[1]
    size = np.std(torque) / np.std(theta)
    assert table["B_gap_s"][0] == pytest.approx(late * table["K"][0] / size, rel=0.1, abs=2e-4)
    assert table["B_predicted"][0] == pytest.approx(5.46, rel=0.05)


@pytest.mark.usefixtures("without_inference")
@pytest.mark.parametrize("width", [0.001, 0.003, 0.01])
def test_friction_is_told_from_damping_whatever_the_velocity_over_which_it_turns_its_sign(width):
    motion = noise(rng := np.random.default_rng(8), band=(0.3, 4), rms_deg=1.5)
    row = row_of(made_trial(rng, motion, 0.01, more=0.5 * np.tanh(motion[1][1] / width)))
    assert row["B"] - row["coulomb_damping"] == pytest.approx(5, rel=0.05)
    assert row["f_C_low"] < 0.5 < row["f_C_high"]
    assert row["B_viscous_low"] < 5 < row["B_viscous_high"]
    assert row["f_C_high"] - row["f_C_low"] < 0.05


def test_clocks_of_one_file_that_drift_apart_are_the_only_cause():
    """They were a stiffness that changes, too, or friction by the amplitudes, or a path by I."""

    def late(motion):
        torque = second_order(motion)
        time = np.arange(len(torque)) / 500
        return make_interp_spline(time, torque, 5)(time * (1 - 2e-4))

    row = table_of(stepped_sine(late, noise=0.02)).row(-1, named=True)
    limits = Limits(above={"K_drift": LIMITS.above["K_drift"]})
    doubts = {
        one.cause for one in findings_of(row, limits, "impedance") if one.grade is Grade.DOUBTS
    }
    assert doubts == {"change over time"}


def bristle(x, width):
    """Friction of 1 N*m that is wound up exponentially over a width [rad] before it slides
    (Dahl)."""
    torque = [0.0]
    for step in np.diff(x):
        torque.append(np.sign(step) + (torque[-1] - np.sign(step)) * np.exp(-abs(step) / width))
    return np.array(torque)


@pytest.mark.usefixtures("without_inference")
@pytest.mark.parametrize("move", [multisine, noise, chirp])
def test_a_spring_behind_a_damper_is_not_taken_for_friction_and_friction_beside_it_has_its_size(
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
    assert rubbing["f_C_low"] < 0.3 < rubbing["f_C_high"]
    assert rubbing["B_viscous"] == pytest.approx(sound["B"], abs=0.02)


def binary_steps(cutoff_hz=None, order=2, every=20, rate=1000.0):
    """A second-order servo follows a binary command, whose acceleration jumps at every change of
    the command, on the clock of the sampling; recorded as it is, or through a low-pass. Torque of
    `TRUE` with time and angle."""
    rng, fine, w = np.random.default_rng(9), rate * every, 2 * np.pi * 30
    command = np.concatenate(
        [np.zeros(1500), np.repeat(rng.choice([-0.035, 0.035], 120), 100), np.zeros(1500)]
    )
    wanted = np.repeat(command, every)

    def follows(*numerator):
        top, bottom, _ = cont2discrete((numerator, [1, 1.8 * w, w**2]), 1 / fine)
        return lfilter(top[0], bottom, wanted)

    theta, omega = follows(w**2), follows(w**2, 0)
    alpha = w**2 * (wanted - theta) - 1.8 * w * omega
    signals = theta, TRUE["K"] * theta + TRUE["B"] * omega + TRUE["I"] * alpha
    if cutoff_hz:
        low_pass = butter(order, cutoff_hz, fs=fine, output="sos")
        signals = [sosfilt(low_pass, one) for one in signals]
    time = np.arange(len(command)) / rate
    theta, torque = (one[::every] for one in signals)
    return pl.DataFrame(
        {"time": time, "theta": theta, "torque": torque + 0.05 * rng.standard_normal(len(time))}
    )


@pytest.mark.usefixtures("without_inference")
@pytest.mark.parametrize(
    ("rate", "band"), [(100.0, (0.5, 6.0)), (125.0, (0.5, 6.0)), (150.0, (0.3, 8.0))]
)
def test_a_sweep_that_is_recorded_at_a_low_rate_is_fitted(rate, band):
    row = row_of(
        made_trial(
            rng := np.random.default_rng(3), chirp(rng, band, duration=60.0, rate=rate), bits=14
        )
    )
    for name, true in TRUE.items():
        assert abs(row[name] - true) < 3 * row[f"{name}_se"]


def test_binary_steps_whose_acceleration_jumps_give_k_b_and_i_without_a_doubt():
    """Without a low-pass the area of the torque's jumps is known to half a sample: by Eq. 15 alone
    I was off by a tenth, and a late torque was accused."""
    low_pass = {"low_pass": {"cutoff_hz": 200.0, "order": 2}}
    told = Trial("made", binary_steps(200.0), {"columns": {"theta": low_pass, "torque": low_pass}})
    trials = Trial("made", binary_steps(every=1)), Trial("made", binary_steps(200.0)), told
    plain, behind, told = map(row_of, trials)
    for row in (plain, behind, told):
        assert row["K"] == pytest.approx(300, rel=3e-4)
        assert row["B"] == pytest.approx(5, rel=2e-3)
        assert row["I"] == pytest.approx(0.02, rel=5e-3)
        assert row["fault"] is None


def test_a_multisine_that_stops_in_the_middle_of_a_period_tells_its_lag_by_whole_periods():
    time, (theta, omega, alpha) = multisine(rng := np.random.default_rng(3), rate=1000.0)
    ends = time < LEAD + 27.3
    motion = time[ends], tuple(one[ends] for one in (theta, omega, alpha))
    row = row_of(made_trial(rng, motion, bits=14, late=2e-3))
    assert (row["excitation"], row["periods"]) == ("periodic", 4)
    assert (row["fault_family"], row["fault_harm"] > 10) == ("path", True)
    assert row["B_without_low"] < 5 < row["B_without_high"]


def test_an_angle_of_constant_acceleration_without_noise_has_no_period_and_is_no_fault():
    t = np.arange(1250) / 250
    turns = np.concatenate([np.zeros(500), 0.1 * np.abs(t / 0.4 % 2 - 1), np.full(500, 0.05)])
    assert periodic_motion(turns, 300 * turns, 250.0, 22.5) is None


# REKLAB, McGill University: binary steps, 1 kHz
HUMAN = ROOT.parent / "shared/real_data/human/human_ankles.npz"


def reflexive(
    rng,
    gain,
    noise_nm=0.15,
    rate=500.0,
    delay=0.044,
    band=(0.3, 8.0),
    order=2,
    second=0.0,
    seconds=30.0,
    **impedance,
):
    """A joint of 30 s whose torque has, beside Eq. 15, `gain` [N*m*s/rad] times the rising speed,
    44 ms late behind a low-pass of some order at 20 rad/s, maybe again 50 ms later, and slow noise
    as of a person's will."""
    time, motion = noise(rng, band, 1.2, seconds, rate)
    rising = np.maximum(motion[1], 0)
    late = sum(
        share * np.concatenate([np.zeros(round((delay + more) * rate)), rising])[: len(time)]
        for share, more in ((1.0, 0.0), (second, 0.05))
    )
    top, bottom, _ = cont2discrete(
        ([400.0], [[20, 400.0], [1, 36.0, 400.0], [1 / 20, 2.8, 56.0, 400.0]][order - 1]),
        1 / rate,
        "bilinear",
    )
    will = lfilter(*butter(1, 2 / (rate / 2)), rng.standard_normal(len(time)))
    more = gain * lfilter(top[0], bottom, late) + noise_nm * will / will.std()
    return made_trial(
        rng, (time, motion), more=more, **{"K": 90.0, "B": 1.0, "I": 0.016} | impedance
    )


@pytest.mark.parametrize(("move", "even"), [
    *((move, lambda t, motion: 1.5 * np.tanh(motion[1] / 0.003)) for move in (noise, chirp)),
    (chirp, lambda t, motion: 0.5 * np.tanh(motion[1] / 0.01) * (1 + 0.5 * np.sign(motion[1]))),
    (noise, lambda t, motion: 400.0 * motion[0] ** 2),
    (chirp, lambda t, motion: np.maximum(300.0 * motion[0], -8.0) - 300.0 * motion[0]),
], ids=["friction", "friction swept", "friction of one side", "spring of one side",
"end stop"])  # fmt: skip
def test_what_differs_between_the_directions_at_once_is_no_reflex(move, even):
    motion = move(rng := np.random.default_rng(3))
    row = row_of(made_trial(rng, motion, more=even(motion[0], motion[1])))
    assert (row["reflex_probability"] or 0.0) < 0.05


@pytest.mark.parametrize(("move", "seconds", "made", "seeds", "low", "high"), [
    (noise, {"duration": 20.0}, {}, 25, 1 - 4 * 0.08, 1 + 4 * 0.08),  # RMS of z, within 4 SE
    (chirp, {}, {"bits": 14, "torque_noise": 0.01}, 12, 0.4, 1 + 4 * 0.12),
    (multisine, {}, {"bits": 14, "torque_noise": 0.01}, 12, 0.4, 1 + 4 * 0.12),
])  # fmt: skip
def test_intervals_cover_the_truth_also_where_every_period_repeats_the_rounding(
    move, seconds, made, seeds, low, high
):
    """Periods of whole samples, 14 bits: beside noise alone z has an RMS of 8. 95 +- 2 % needs
    hundreds of records."""
    z, noise_alone = [], []
    for seed in range(seeds):
        record = moving_record(
            made_trial(rng := np.random.default_rng(seed), move(rng, **seconds), **made)
        )
        fit = analysed(record, plain_sums(record, IMPEDANCE), IMPEDANCE).whole
        z += [(fit[k] - true) / fit.se(k) for k, true in TRUE.items()]
        noise_alone += [
            (fit[k] - true) / (fit.repeat_se(k) or fit.se(k)) for k, true in TRUE.items()
        ]
    assert low < np.sqrt(np.mean(np.square(z))) < high
    assert move is not multisine or np.sqrt(np.mean(np.square(noise_alone))) > 1.8


def two_devices(trial, ppm, every=1):
    """The trial with every n-th sample of the torque, by a clock of its own that runs faster."""
    torque = trial.samples.select("time", "torque").gather_every(every)
    torque = torque.with_columns(
        pl.col("time") + 1e-3 + 1e-6 * ppm * (pl.col("time") - pl.col("time").mean())
    )
    return Trial(
        "made",
        pl.concat([trial.samples.select("time", "theta"), torque], how="diagonal").sort("time"),
    )


@pytest.mark.parametrize(("motion", "friction", "ppm", "every", "said"), [
    (multisine(np.random.default_rng(4)), 0.5, 20.0, 1, r"(19|20|21)\.\d+"),
    (noise(np.random.default_rng(4)), 0.0, 1000.0, 1, r"9[6-9]\d\.\d+"),
    (noise(np.random.default_rng(5), rate=500.0), 0.0, 5.0, 2, r"[45]\.\d+"),
])  # fmt: skip
def test_clocks_that_drift_apart_are_seen_at_any_rate_in_periods_or_beside_friction(
    motion, friction, ppm, every, said
):
    trial = made_trial(np.random.default_rng(4), motion, more=friction * np.sign(motion[1][1]))
    with pytest.raises(InputError, match=rf"drift apart by {said} \+- \d\."):
        row_of(two_devices(trial, ppm, every))


def test_clocks_of_two_devices_do_not_drift_whatever_the_joint_is():
    motion = noise(np.random.default_rng(6), rate=500.0)
    torques = (odd * np.sin(80 * motion[1][0]) for odd in (0.0, 3.0))
    quiet, hidden = (
        two_devices(made_trial(np.random.default_rng(6), motion, more=x), 0.0, 2) for x in torques
    )
    row = row_of(quiet)
    assert row["fault_family"] == "path"  # one of them is late
    assert not row["certain_clock_drift_ppm"]
    assert not row_of(hidden)["certain_clock_drift_ppm"]


def test_what_else_changes_with_time_is_no_drift_of_clocks():
    """A K that steps by 15 % in a recording of two devices whose clocks agree."""
    time, (theta, *_) = motion = noise(np.random.default_rng(6), rate=500.0)
    trial = made_trial(np.random.default_rng(6), motion, more=-45 * (time > 0.6 * time[-1]) * theta)
    row = row_of(two_devices(trial, 0.0, 2))
    assert (row["fault"], row["fault_harm"] > 1) == ("K steps", True)
    assert row["certain_clock_drift_ppm"] is None


def test_samples_that_one_channel_lost_are_heard():
    trial = made_trial(np.random.default_rng(6), noise(np.random.default_rng(6), rate=500.0))
    torque = trial.samples["torque"].to_numpy()
    lost = len(torque) // 3
    shifted = np.concatenate([torque[:lost], torque[lost + 60 :], torque[-60:]])
    row = row_of(Trial("made", trial.samples.with_columns(torque=pl.Series(shifted))))
    assert (row["fault"], row["fault_harm"] > 1) == ("lag that steps", True)


@pytest.mark.parametrize(("name", "clip", "sides"), [
    ("noise", 10.0, "both"), ("noise", 12.0, "one"), ("multisine", 12.0, "both"),
    ("chirp", 8.0, "one"), ("chirp", 10.0, "both"),
])  # fmt: skip
def test_a_torque_that_an_amplifier_clips_before_the_noise_is_named_and_its_b_and_i_are_held(
    name, clip, sides
):
    trial = made_trial(rng := np.random.default_rng(2), MOTIONS[name](rng), torque_noise=0.0)
    clipped = trial.samples["torque"].clip(-clip, clip if sides == "both" else None)
    noisy = clipped + pl.Series(0.05 * rng.standard_normal(len(clipped)))

    row = row_of(Trial("made", trial.samples.with_columns(torque=noisy)), excitation="any")

    assert row["fault"] == "clipping"
    assert row["B_without_low"] < 5 < row["B_without_high"]
    assert row["I_without_low"] < 0.02 < row["I_without_high"]


def test_the_interval_of_one_period_is_that_of_white_noise():
    rng = np.random.default_rng(1)

    analysis, _ = rendered_impedance(moving_record(made_trial(rng, multisine(rng, periods=1))))

    assert analysis.whole.interval_method == "white noise"


@pytest.mark.usefixtures("without_inference")
def test_repeats_of_one_motion_are_averaged_and_other_motions_kept_apart():
    rows = [row_of(made_trial(rng, multisine(rng))) for rng in map(np.random.default_rng, range(2))]
    rows[1] |= {"band_low_hz": 0.3, "theta_rms_deg": 1.1 * rows[0]["theta_rms_deg"]}
    rows.append(
        row_of(made_trial(rng := np.random.default_rng(9), multisine(rng, band=(0.5, 9.0))))
    )
    rows.append(rows[0] | {"K": 1.0})
    for number, row in enumerate(rows):
        row["trial"] = f"trial_{number}"
    doubtful = pl.when(pl.col("K") < 2).then(pl.lit("soft")).otherwise(pl.lit(""))
    asked = {
        "controller": pl.lit("x"),
        "K_d": pl.lit(300.0),
        "B_d": pl.lit(None, pl.Float64),
        "doubtful": doubtful,
    }
    table = repeated_trials_table(
        pl.DataFrame(rows, infer_schema_length=None).with_columns(**asked)
    )
    assert (
        table.select("n", "n_doubtful", "n_left_out", "band_low_hz").rows() == [(2, 1, 1, 0.3)] * 3
    )
    rubbed = [
        row | {"B_viscous": 4.0, "f_C": 0.2 + 0.1 * k, "B_se_bench": 0.5}
        for k, row in enumerate(rows[:2])
    ]
    with_friction = repeated_trials_table(pl.DataFrame(rubbed).with_columns(**asked))
    assert with_friction.select("quantity", "mean").rows()[3:] == [
        ("B_viscous", 4.0),
        ("f_C", pytest.approx(0.25)),
    ]
    assert with_friction["se"][3] == 0.5, "what all trials of the bench share"
    K = [row["K"] for row in rows[:2]]
    assert table["mean"][0] == pytest.approx(np.mean(K))
    assert table["high"][0] - table["mean"][0] == pytest.approx(
        12.7062047 * np.std(K, ddof=1) / np.sqrt(2), rel=1e-6
    )
    assert repeated_trials_table(pl.DataFrame(rows[:1]).with_columns(**asked)).is_empty()
    sides = [
        row | {"side": side, "K": k * row["K"]}
        for k, side in ((1, "left"), (2, "right"))
        for row in rows[:2]
    ]
    of_sides = repeated_trials_table(pl.DataFrame(sides).with_columns(**asked)).filter(
        pl.col("quantity") == "K"
    )
    assert of_sides["side", "n"].rows() == [("left", 2), ("right", 2)]
    assert of_sides["mean"].to_numpy() == pytest.approx(np.mean(K) * np.array([1, 2]))


def test_a_damaged_stepped_sine_is_refused_as_one_and_the_setting_for_another_motion_is_named():
    rng, time = np.random.default_rng(1), np.arange(0, 60, 1 / 250)
    theta = 0.07 * np.sin(2 * np.pi * np.repeat([1.0, 2.0, 3.0, 4.0, 5.0], len(time) // 5) * time)
    trial = made_trial(rng, (time, (theta + 0.08 * np.sin(0.8 * time), 0 * theta, 0 * theta)))
    with pytest.raises(
        InputError, match=r"is no stepped sine.* 1 % of the moving time.*`excitation: any`"
    ):
        record_of_trial(trial, SETTINGS)
    theta = np.where(rng.random(len(time)) < 0.05, 0.1 * rng.standard_normal(len(time)), theta)
    spiky = made_trial(rng, (time, (theta, 0 * theta, 0 * theta)))
    with pytest.raises(InputError, match=r"`excitation: any`"):
        record_of_trial(spiky, SETTINGS)


@pytest.mark.parametrize(("K", "sign"), [(300.0, 1), (3.0, -1)])
def test_noise_of_the_angle_changes_the_inertia_by_the_share_that_is_stated(K, sign):
    """A stiff joint has too large an I, a light one too small; over six records, within three
    standard errors. What is less than a fit's standard error is in its interval, and no share."""
    errors, shares = [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        record = moving_record(
            made_trial(rng, noise(rng), torque_noise=0.005, angle_noise=2e-3, K=K, B=0.5)
        )
        fit = fit_of(record)
        errors.append(fit["I"] / 0.02 - 1)
        shares.append(angle_noise_bias(record, plain_sums(record, IMPEDANCE), fit) / 0.02)
    spread = np.std(errors, ddof=1) / np.sqrt(6)
    assert (np.sign(shares).tolist(), np.mean(errors)) == (
        [sign] * 6,
        pytest.approx(np.mean(shares), abs=3 * spread),
    )
    assert abs(np.mean(shares)) > 4 * spread
    assert angle_noise_share(record, plain_sums(record, IMPEDANCE), fit) == pytest.approx(
        abs(shares[-1]), rel=0.3
    )
    loud = moving_record(
        made_trial(rng, noise(rng), torque_noise=5.0, angle_noise=2e-3, K=K, B=0.5)
    )
    assert angle_noise_share(loud, plain_sums(loud, IMPEDANCE), fit_of(loud)) == 0


@pytest.mark.parametrize(
    ("band", "lost", "left_out"), [((0.5, 9.0), 4, True), ((0.3, 3.0), 6, False)]
)
def test_the_time_base_bridges_gaps_by_the_band_of_this_motion(band, lost, left_out):
    """Gaps of 16 and 24 ms: a tenth of a period is 11 ms at 9 Hz and 33 ms at 3 Hz; 20 ms were the
    stepped sine's."""
    whole = made_trial(rng := np.random.default_rng(7), noise(rng, band, rms_deg=4.0)).samples
    rows = np.arange(len(whole))
    record = moving_record(
        Trial("made", whole.filter(pl.Series((rows % 1500 > lost) | (rows < 10))))
    )
    assert (not record.uniform.usable.all()) == left_out
    bench = BenchStiffness(value="4000 N*m/rad", standard_error="200 N*m/rad")
    said = (
        timebase_table(record.uniform, None, bench)
        .select("masked", "farthest_s", "^bench_stiffness.*$")
        .row(0)
    )
    assert said == pytest.approx(
        (np.sum(~record.uniform.usable), record.uniform.farthest_s, 4000, 200)
    )
    assert fit_of(record)["K"] == pytest.approx(300, rel=2e-3)
    long = Trial("made", whole.filter(pl.Series((rows < 4000) | (rows > 4150))))  # 0.6 s
    assert moving_record(long, time_base=TimeBase(longest_gap_s=0.7)).seconds > 28


def test_quality_control_says_that_another_motion_is_not_compared_with_the_protocol():
    rng, commanded = (
        np.random.default_rng(7),
        examine.Commanded((2.0, 4.0, 6.0), (1.0, 2.0, 3.0, 4.0, 5.0), 20),
    )
    experiments = (EXPERIMENTS[x] for x in ("impedance", "transmission"))
    other, sines = (
        examine.Examined(made_trial(rng, noise(rng)), one, commanded) for one in experiments
    )
    said = examine.measure_protocol(other)
    assert (said.value, said.remark) == (
        0,
        "no stepped sine but another motion, which is fitted as such",
    )
    assert examine.measure_protocol(sines).value == 15


def up_and_down(time, within_s):
    """An angle [rad] that goes up by 4 deg at 5 s, and down at 25 s."""
    up, down = (np.clip((time - at) / within_s, 0, 1) for at in (5.0, 25.0))
    return np.deg2rad(4) * (
        10 * up**3 - 15 * up**4 + 6 * up**5 - (10 * down**3 - 15 * down**4 + 6 * down**5)
    )


@pytest.mark.parametrize(("angle", "words"), [
    (lambda t: up_and_down(t, 0.2),
     r"made: the joint moves for 0\.\d+ of the \d+.* s.*keep it moving"),
    (lambda t: up_and_down(t, 15.0), r"moves too slowly.*1\.\d deg RMS"),
    (lambda t: 0.1 * np.arcsin(np.sin(0.12 * t)),
     r"too slowly: of 18 deg.*at 250 rows per second"),
    (lambda t: 0 * t, r"trial made: the joint does not move: theta turns by 0 deg in all"),
    (
        lambda t: np.deg2rad(4) * np.sin(2 * np.pi * 1.7 * t) * (t > 2) * (t < 2 + 40 / 1.7),
        r"K and I cannot .* sines of 4 deg are of 1\.7 Hz alone"
        r".*below 0\.85 Hz or from 3\.4 Hz as well",
    ),
])  # fmt: skip
def test_a_motion_that_cannot_tell_is_refused_with_what_is_missing(angle, words):
    time = np.arange(0, 40, 1 / 250)
    trial = made_trial(
        np.random.default_rng(1), (time, (angle(time), 0 * time, 0 * time)), B=0.0, I=0.0
    )
    with pytest.raises((IdentifiabilityError, InputError), match=words):
        impedance_table(*rendered_impedance(record_of_trial(trial, SETTINGS)))
    still = Trial("made", trial.samples.with_columns(theta=pl.lit(0.0)))
    for windows in (None, "2-30"):
        with pytest.raises(
            InputError, match="made: the joint does not move; check the channel of theta"
        ):
            moving_record(still, windows)


@pytest.mark.parametrize("excitation", ["auto", "any"])
def test_an_angle_of_noise_or_of_too_few_rows_is_no_slow_motion_and_recorded_faster_it_passes(
    excitation,
):
    def recorded(rate, turn=None):
        time, (theta, *others) = noise(rng := np.random.default_rng(4), rate=rate)
        trial = made_trial(
            rng, (time, (theta if turn is None else turn * rng.standard_normal(time.size), *others))
        )
        return row_of(trial, excitation=excitation)

    for rate in (8, 25):
        few = rf"jumps from row to row .* or {rate} rows per second are too few .* 100 pe"
        with pytest.raises(InputError, match=few):
            recorded(rate)
    noisy = r"jumps from row to row by 2\.[89] deg of its 2\.[89] deg RMS: it is noise, or"
    with pytest.raises(InputError, match=noisy):
        recorded(RATE, 0.05)
    time, motion = noise(rng := np.random.default_rng(4), rate=45.0)
    short = made_trial(rng, (time[200:240], tuple(x[200:240] for x in motion)))
    with pytest.raises(InputError, match=r"nothing is left to fit: .*; record for longer"):
        row_of(short, excitation="any")
    assert recorded(100.0)["K"] == pytest.approx(TRUE["K"], rel=0.01)


def test_an_angle_beyond_a_joint_beside_a_torque_of_an_angle_s_size_is_said_to_be_swapped():
    trial = made_trial(rng := np.random.default_rng(3), noise(rng))
    swapped = Trial("made", trial.samples.rename({"theta": "torque", "torque": "theta"}))
    with pytest.raises(
        InputError,
        match=r"theta turns by \+-\d+.*torque has \+-0\.\d+ N\*m only, are the two swapped",
    ):
        examine.check_recording(swapped, SETTINGS)


def changing(motion, share):
    """Torque of a stiffness that changes by a share of K from the begin of the motion of 30 s to
    its end."""
    time, (theta, *_) = motion
    return TRUE["K"] * share * (time - LEAD) / 30.0 * theta


@pytest.mark.parametrize(
    ("name", "share"), [("multisine", 0.02), ("noise", -0.04), ("noise", 0.02), ("chirp", -0.04)]
)
def test_a_change_of_the_stiffness_is_told_in_any_motion_with_k_before_and_after_it(name, share):
    motion = MOTIONS[name](np.random.default_rng(3))
    trial = made_trial(
        np.random.default_rng(1), motion, torque_noise=0.02, more=changing(motion, share)
    )
    row = row_of(trial, excitation="any")
    assert row["K_without_low"] < min(300, 300 * (1 + share)) * 1.002
    assert row["K_without_high"] > max(300, 300 * (1 + share)) * 0.998
    assert "change over time" in [
        one.cause for one in findings_of(row, Limits(above={"fault_harm": 1}), "phasors")
    ]


@pytest.mark.usefixtures("without_inference")
def test_a_motion_by_hand_and_a_sweep_beyond_the_filter_give_their_stiffness():
    """A hand rests between its turns, so that most of the third differences are those of noise."""
    time, rng = np.arange(0, 34, 1 / 300), np.random.default_rng(2)
    theta = np.zeros_like(time)
    for start in np.arange(2, 30, 0.6):
        u = (time - start) / rng.uniform(0.2, 0.6)
        theta += rng.normal(0, 0.1) * np.where(abs(u) < 1, (1 - u**2) ** 4, 0.0)
    motion = theta, np.gradient(theta, time), np.gradient(np.gradient(theta, time), time)
    for made in ((time, motion), chirp(rng, band=(0.5, 60.0), rms_deg=0.3, rate=500.0)):
        row = row_of(made_trial(rng, made, bits=24))
        assert row["K"] == pytest.approx(300, rel=0.01)
        assert row["angle_noise_share"] < 0.01


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
