# SPDX-License-Identifier: Apache-2.0
"""What a laboratory states of its bench's calibration is in every interval of the bench."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
import yaml
from any_motion import made_trial, sines
from bench_synthetic import (
    FIVE,
    belt_cycle,
    belt_record,
    record_of_sines,
    second_order,
    stepped_sine,
    with_settings,
)
from conftest import findings_of, half_width, joint_trial, marked, refused_with, white_noise
from scipy.interpolate import CubicSpline
from scipy.stats import uniform
from shipped import CONFIG

from osl_analysis.base.trial import Trial
from osl_analysis.bench.belt import belt_table, fit_branches
from osl_analysis.bench.bench_settings import (
    BeltAnalysis,
    BenchStiffness,
    Calibration,
    Fixture,
)
from osl_analysis.bench.calibration import SPRING_LOSS, fixture_column, with_fixture
from osl_analysis.bench.friction import coulomb_fit
from osl_analysis.bench.impedance import fit_all_groups
from osl_analysis.bench.regression import IMPEDANCE, SHARP_WIDTH, sums_of
from osl_analysis.commands.fit import run_fit
from osl_analysis.judge.wording import finding_text
from osl_analysis.signals.filters import LowPass, differentiate
from osl_analysis.signals.grid import origin

TRUE = {"K": 200.0, "B": 4.0, "I": 0.05}
CENTRED = stepped_sine(second_order, 0.01, FIVE)
SOUND = record_of_sines(CENTRED.time, CENTRED.theta + 0.5, CENTRED.torque, FIVE)


def fit_of(record=SOUND, **stated):
    """Eq. 15 with the stated errors of the bench in its intervals."""
    if "standard_error" in stated:
        changes = {"bench_stiffness": BenchStiffness(**stated)}
    elif "inertia_error" in stated:
        changes = {"fixture": Fixture(**stated)}
    else:
        changes = {"calibration": Calibration(**stated)}
    return fit_all_groups(with_settings(record, **changes), IMPEDANCE).calibrated[None]


LATE = np.interp(SOUND.time - 1e-3, SOUND.time, SOUND.torque)


RISING = np.sign(differentiate(SOUND.time, SOUND.filtered_torque).omega)
# readings that differ by 1 % of the range of torque between rising and falling, over sqrt(3)
LOOPED = SOUND.torque + 0.01 / np.sqrt(12) * np.ptp(SOUND.filtered_torque) * RISING


@pytest.mark.parametrize(
    ("stated", "other", "within"),
    [
        ({"torque_gain": 0.01}, {"torque": 1.01 * SOUND.torque}, 1e-3),
        ({"angle_gain": 0.01}, {"theta": SOUND.theta / 1.01}, 1e-3),
        ({"misalignment_deg": 5}, {"torque": SOUND.torque * np.cos(np.deg2rad(5))}, 1e-3),
        ({"delay": 1e-3}, {"torque": LATE}, 0.05),
        # softer by the standard error of the bench's inverse stiffness
        (
            {"value": "20000 N*m/rad", "standard_error": "400 N*m/rad"},
            {"theta": SOUND.theta - 400 / 20000**2 * SOUND.torque},
            1e-3,
        ),
        (
            {"inertia_error": 5e-3, "weight_error": 0.0},
            {"torque": SOUND.torque + 5e-3 * SOUND.motion.alpha},
            0.02,
        ),
        (
            {"inertia_error": 0.0, "weight_error": 5.0, "rest_deg": 30.0},
            {"torque": SOUND.torque + 5.0 * np.sin(SOUND.theta - np.pi / 6)},
            0.01,
        ),
        # a rectangular distribution
        ({"hysteresis": 0.01}, {"torque": LOOPED}, 0.03),
    ],
)
def test_an_error_of_the_bench_moves_estimates_as_its_interval_says(stated, other, within):
    recorded = {"theta": SOUND.theta, "torque": SOUND.torque} | other
    changed = fit_of(record_of_sines(SOUND.time, recorded["theta"], recorded["torque"], FIVE))
    fit = fit_of(**stated)
    plain = fit_of()
    for name, true in TRUE.items():
        change = changed[name] - plain[name]
        least = 1e-4 * true  # what a record's ends and its noise make of a shift
        of_bench = fit.budget(name).se_bench
        assert of_bench == pytest.approx(abs(change), rel=within, abs=least), name
        assert fit.se(name) ** 2 == pytest.approx(plain.se(name) ** 2 + of_bench**2)
        assert plain.budget(name).se_bench == 0
    np.testing.assert_array_equal(fit.covariance, plain.covariance)  # it repeats itself


def test_friction_has_it_too_and_a_loop_of_the_load_cell_is_friction():
    record = stepped_sine(lambda m: second_order(m) + 0.5 * np.tanh(m.omega / 0.005), 0.01, FIVE)
    fits = []
    for stated in ({}, {"torque_gain": 0.02}, {"hysteresis": 0.02}):
        own = with_settings(record, calibration=Calibration(**stated))
        analysis = fit_all_groups(own, IMPEDANCE)
        fits.append(coulomb_fit(sums_of(own), analysis).without)
    plain, gain, loop = fits
    more = [
        np.sqrt(fit.se(name) ** 2 - plain.se(name) ** 2)
        for fit in (gain, loop)
        for name in ("B", "T_C")
    ]
    half = 0.02 * np.ptp(record.filtered_torque[record.is_fitted()]) / np.sqrt(12)
    assert more[:2] == pytest.approx([0.02 * plain["B"], 0.02 * plain["T_C"]], rel=1e-3)
    assert more[3] == pytest.approx(half, rel=0.2)  # the torque leads the velocity
    # B without it is that of a damper
    assert more[2] < 0.1 * fit_of(record, hysteresis=0.02).budget("B").se_bench


def test_friction_of_a_tenth_of_the_width_is_off_by_its_standard_error():
    sharp = stepped_sine(lambda m: second_order(m) + np.tanh(m.omega / SHARP_WIDTH), 1e-4, FIVE)

    fit = coulomb_fit(sums_of(sharp), fit_all_groups(sharp, IMPEDANCE)).without

    (error,) = fit.budget("B").from_source("friction_sign")
    assert error.standard == pytest.approx(abs(fit["B"] - 4), rel=0.1)


THETA_S, BELT_TORQUE = belt_cycle()


def of_belt(torque=BELT_TORQUE, **stated):
    settings = BeltAnalysis(cutoff_hz=15, order=4, calibration=Calibration(**stated))
    record = replace(belt_record(THETA_S, torque), settings=settings)
    return belt_table(fit_branches(record))["belt"].row(0, named=True)


def test_an_error_of_the_gain_is_in_the_estimates_of_a_belt():
    plain = of_belt()
    other = of_belt(1.01 * (BELT_TORQUE - BELT_TORQUE[0]) + BELT_TORQUE[0])

    stated = of_belt(torque_gain=0.01)

    for name in ("K_s", "unloading", "hysteresis_area"):
        change = abs(other[name] - plain[name])
        least = 1e-6 * plain["K_s"]
        assert stated[f"{name}_se_bench"] == pytest.approx(change, rel=1e-6, abs=least), name


def test_a_loop_of_the_load_cell_is_in_the_area_of_a_belt():
    area = of_belt(hysteresis=0.01)["hysteresis_area_se_bench"]
    size = np.ptp(BELT_TORQUE) * 2 * THETA_S.max()
    assert area == pytest.approx(0.01 / np.sqrt(12) * size, rel=0.1)


def spring(late_s=0.0, gain=1.0, K=300.0, damping=0.0, weight=0.0, I=0.004, seed=1):
    """A recording of 14 bits whose torque is late."""
    rng = np.random.default_rng(seed)
    motion = sines(rng, np.linspace(0.5, 6, 12), rms_deg=3.0, duration=27.0, rate=500.0)
    joint = {"K": gain * (K + weight), "B": gain * damping, "I": gain * I}
    return replace(made_trial(rng, motion, bits=14, late=late_s, **joint), name="spring")


def estimates_of(trial, bench=CONFIG.dynamometer, **known):
    """The tables of a calibration, by name."""
    config = CONFIG.model_copy(update={"dynamometer": bench})
    return run_fit("calibration", trial, None, config, known).estimates


def calibrated(trial, bench=CONFIG.dynamometer, **known):
    table = estimates_of(trial, bench, **known)["calibration"]
    return marked(table, CONFIG.doubtful.of("calibration"), "calibration").row(0, named=True)


def standard_error(row, name):
    """By the interval of a row, as if it were normal: of few degrees of freedom it is larger."""
    return half_width(row, name) / 1.96


def test_what_is_known_badly_and_what_a_spring_loses_are_in_the_budget():
    """A loss is a phase at most, in the middle of 0.5 and 6 Hz."""
    known = {"known_K": 300.0, "known_I": 0.003, "known_percent": 1.0}
    tables = estimates_of(spring(1e-3, 1.02), **known)
    row = tables["calibration"].row(0, named=True)
    rows = tables["budget"].select("estimate", "source", "standard").rows()
    sizes = {(name, source): size for name, source, size in rows}
    phase = uniform(-SPRING_LOSS, 2 * SPRING_LOSS).std()

    stated = yaml.safe_load(row["to_state"])["calibration"]
    assert stated["delay"] == pytest.approx(standard_error(row, "lag_s"), rel=0.05)
    assert tables["budget"].filter(source="known_part")["freedom"].null_count() == 2
    assert row["inertia"] == pytest.approx(0.004 - 0.003, rel=0.05)
    for name in ("gain", "inertia"):
        assert sizes[name, "known_part"] == pytest.approx(0.01 * row[name])
    lag_s = phase / (2 * np.pi * np.sqrt(0.5 * 6))
    assert sizes["lag_s", "spring_loss"] == pytest.approx(
        lag_s, rel=0.2
    )  # of the band that is found


def test_a_gain_that_a_fixture_s_weight_explains_asks_for_the_fixture_first():
    """1.6 N*m beside 80 N*m/rad are 2 %; stated, nothing is wrong."""
    trial = spring(K=80.0, weight=1.6)
    weighed = CONFIG.dynamometer.model_copy(update={"fixture": Fixture(weight=1.6)})

    row = calibrated(trial, known_K=80.0)
    stated = calibrated(trial, weighed, known_K=80.0)

    findings = findings_of(row, CONFIG.doubtful.of("calibration"), "calibration")
    (gain,) = [finding for finding in findings if finding.cause == "wrong gain"]
    assert "`fixture`" in finding_text(gain)
    half_width = row["gain_high"] - row["gain"]
    assert row["certain_gain_error"] == pytest.approx(0.02 - half_width, abs=2e-3)
    assert stated["fixture"] == "weight 1.6"
    assert (stated["doubtful"], stated["gain"]) == (None, pytest.approx(1.0, abs=2e-3))


KNOWN_SPRING = {"known_K": 300.0}
PENDULUM = {"K": 0.0, "damping": 0.05, "weight": 2.0, "I": 0.2}


@pytest.mark.parametrize(
    ("made", "known", "true", "lag_se", "doubtful"),
    [
        (
            {"I": 0.003},
            KNOWN_SPRING,
            {"gain": 1.0, "lag_s": 0.0, "inertia": 0.003, "B": 0.0},
            1e-4,
            "",
        ),
        ({"late_s": 8e-3}, KNOWN_SPRING, {"lag_s": 8e-3}, 1e-4, "delay of the torque"),
        ({"damping": 3.0}, KNOWN_SPRING, {"B": 3.0, "lag_s": 0.0}, 8e-4, ""),
        (
            {"late_s": -5e-4, "gain": 0.97, **PENDULUM},
            {"known_I": 0.2},
            {"lag_s": -5e-4, "gain": 0.97, "weight": 2.0, "B": 0.97 * 0.05},
            1e-4,
            "delay of the torque; wrong gain",
        ),
    ],
)
def test_a_known_spring_or_inertia_tells_what_is_true_of_the_bench(
    made, known, true, lag_se, doubtful
):
    row = calibrated(spring(**made), **known)

    for name, value in true.items():
        assert abs(row[name] - value) < 4 * standard_error(row, name), name
    assert row["doubtful"] == (doubtful or None)
    assert standard_error(row, "gain") < 1e-3
    assert standard_error(row, "lag_s") < lag_se


def test_a_calibration_needs_what_is_known():
    with refused_with(r"spring:.*known_K"):
        calibrated(spring())


def test_a_spring_without_inertia_tells_its_gain_and_no_damping():
    """As where the stated fixture takes all of it off; a delay and damping then look alike."""
    row = calibrated(spring(I=2e-5), known_K=300.0)

    assert row["gain"] == pytest.approx(1.0, abs=2e-3)
    assert (row["doubtful"], row["B"]) == (None, None)
    assert abs(row["lag_s"]) < 3e-4


@pytest.mark.parametrize(
    ("stated", "doubt"),
    [
        ({"inertia": 0.012, "weight": 0.8, "weight_error": 0.05}, ""),
        ({"inertia": 0.0124, "weight": 0.8, "weight_error": 0.05}, "fixture"),
        ({"inertia": 0.012, "weight": 1.6, "weight_error": 0.05}, "fixture"),
    ],
)
def test_a_stated_fixture_is_compared_with_the_recorded_one(stated, doubt):
    bench = CONFIG.dynamometer.model_copy(update={"fixture": Fixture(**stated)})

    row = calibrated(spring(K=0.0, weight=0.8, I=0.012), bench, fixture="alone")

    assert row["doubtful"] == (doubt or None)


@pytest.mark.parametrize(("weight", "rest_deg"), [(0.8, 0.0), (-0.8, 180.0)])
def test_a_fixture_alone_gives_its_inertia_and_weight_and_what_to_write(weight, rest_deg):
    """Upright, its weight drives the motion, and it hangs on the other side."""
    trial = spring(K=0.0, weight=weight, I=0.012)

    row = calibrated(trial, fixture="alone")

    for name, true, within in (("inertia", 0.012, 3e-4), ("weight", 0.8, 0.05)):
        assert abs(row[name] - true) < 4 * standard_error(row, name) < 2 * within, name
        assert row[f"{name}_low"] < true < row[f"{name}_high"]
    assert row["rest_deg"] == pytest.approx(rest_deg, abs=0.5)
    assert (row["doubtful"], row["gain"], row["lag_s"]) == (None, None, None)
    stated = yaml.safe_load(row["to_state"])["fixture"]
    assert stated["inertia"] == pytest.approx(row["inertia"], rel=1e-3)
    assert stated["weight_error"] == pytest.approx(standard_error(row, "weight"), rel=0.05)


def pendulum(largest_deg, rest_deg, seed=1):
    """A fixture alone of 3.31 N*m that hangs at an angle, turned by so much to each side."""
    rng = np.random.default_rng(seed)
    time, motion = sines(rng, np.linspace(0.3, 2.0, 8), 3.0, 30.0, rate=200.0)
    theta, _, alpha = np.array(motion) * np.deg2rad(largest_deg) / np.abs(motion[0]).max()
    torque = 0.164 * alpha + 3.31 * np.sin(theta - np.deg2rad(rest_deg)) + 0.4
    return joint_trial(time, theta, torque + 0.05 * rng.standard_normal(time.size))


@pytest.mark.parametrize("largest_deg", [19.0, 60.0])
@pytest.mark.parametrize("rest_deg", [4.0, -20.0, 180.0])
def test_a_fixture_is_fitted_as_it_is_taken_off(largest_deg, rest_deg):
    row = calibrated(pendulum(largest_deg, rest_deg), fixture="alone")

    assert row["weight"] == pytest.approx(3.31, rel=0.02)
    assert row["rest_deg"] == pytest.approx(rest_deg, abs=2.0)
    stated = Fixture(**yaml.safe_load(row["to_state"])["fixture"])
    assert 3 * stated.rest_error_deg > abs(row["rest_deg"] - rest_deg)
    assert 3 * stated.weight_error > abs(row["weight"] - 3.31)


def test_where_a_small_motion_does_not_tell_the_rest_its_middle_is_taken_and_has_no_interval():
    row = calibrated(pendulum(2.0, 20.0), fixture="alone")

    assert row["rest_deg"] == pytest.approx(0.0, abs=0.5)
    assert row["rest_deg_low"] is None
    assert row["weight"] == pytest.approx(3.31 * np.cos(np.deg2rad(20)), rel=0.06)


@pytest.mark.parametrize(("rest_deg", "is_other"), [(4.0, False), (8.0, True)])
def test_a_fixture_that_is_stated_to_hang_elsewhere_is_another(rest_deg, is_other):
    bench = CONFIG.dynamometer.model_copy(
        update={"fixture": Fixture(inertia=0.164, weight=3.31, rest_deg=rest_deg)}
    )

    row = calibrated(pendulum(40.0, 4.0), bench, fixture="alone")

    assert (row["fixture_error"] > 1) == is_other


def on_frame(trial, stiffness):
    """The same recording on a bench whose encoder stands before a frame [N*m/rad] that yields."""
    joint = trial.samples["theta"].to_numpy()
    torque = trial.samples["torque"].to_numpy()
    noise = 2e-5 * white_noise(len(joint), 3)
    wound = LowPass(30.0)(torque, 500.0) / stiffness
    samples = trial.samples.with_columns(
        theta=pl.Series(joint + wound), theta_joint=pl.Series(joint + noise)
    )
    return Trial("spring", samples)


def test_angles_beside_a_frame_give_its_stiffness_and_the_gain_behind():
    row = calibrated(on_frame(spring(), 3000.0), known_K=300.0)

    assert row["frame_stiffness"] == pytest.approx(3000.0, rel=5e-3)
    assert row["frame_stiffness_low"] < 3000.0 < row["frame_stiffness_high"]
    assert row["gain"] == pytest.approx(1.0, abs=2e-3)  # in front of the frame 0.91
    stated = yaml.safe_load(row["to_state"])["bench_stiffness"]
    assert BenchStiffness(**stated).compliance == pytest.approx(1 / 3000.0, rel=5e-3)


def test_of_a_rigid_frame_nothing_is_said_to_yield():
    """A smallest stiffness of 1e9 N*m/rad, beside noise of both angles."""
    assert calibrated(on_frame(spring(), 1e9), known_K=300.0)["frame_stiffness"] is None


def test_one_encoder_under_two_names_is_refused():
    samples = spring().samples.with_columns(theta_joint="theta")
    with refused_with(r"trial spring: .*theta_joint is 0 rad.*; name"):
        calibrated(Trial("spring", samples), known_K=300.0)


def test_a_fixture_of_the_sheet_comes_before_that_of_the_settings():
    provenance = {"columns": {"torque": {"fixture": {"inertia": 0.02}}}}
    trial = Trial("a", spring().samples, provenance)

    kept = with_fixture(trial, Fixture(inertia=0.012))
    assert origin(kept, "torque")["fixture"] == {"inertia": 0.02}


def test_a_fixture_of_no_weight_is_stated_and_keeps_that_of_the_settings_away():
    trial = Trial("a", spring().samples, {"columns": {"torque": {"fixture": {"weight": 0.0}}}})

    kept = with_fixture(trial, Fixture(inertia=0.012))

    assert origin(kept, "torque")["fixture"] == {"weight": 0.0}
    assert kept.samples.select(fixture_column(kept))["fixture"][0] == "none"


@pytest.mark.parametrize("ppm", [-15.0, 15.0])
def test_a_clock_that_drifts_is_told_from_lag_and_friction(ppm):
    """Without the drift the lag was 0.4 ms off, and a friction stood in its place."""
    trial = spring(3e-3)
    stamps, torque = trial.arrays("torque")
    fast = 1 + 1e-6 * ppm
    drifting = CubicSpline(stamps, torque)(np.clip(stamps / fast, stamps[0], stamps[-1]))
    trial = Trial("spring", trial.samples.with_columns(torque=pl.Series(drifting)))

    row = calibrated(trial, known_K=300.0)

    middle_s = (row["lag_s"] - row["lag_at_start_s"]) / (1e-6 * row["clock_drift_ppm"])
    for name, true in (("clock_drift_ppm", ppm), ("lag_s", 3e-3 + 1e-6 * ppm * middle_s)):
        assert abs(row[name] - true) < 4 * standard_error(row, name), name
    assert standard_error(row, "clock_drift_ppm") < 3
    assert "clocks that do not fit" in row["doubtful"]
    assert "delay of the torque" not in row["doubtful"]


def test_a_friction_that_drives_the_motion_is_refused():
    trial = spring()
    theta, torque = (trial.arrays(name)[1] for name in ("theta", "torque"))
    velocity = differentiate(trial.arrays("theta")[0], LowPass(20.0)(theta, 500.0)).omega
    driven = trial.samples.with_columns(torque=pl.Series(torque - 0.025 * np.sign(velocity)))

    with refused_with(r"spring: friction T_C = -0\.\d+ N\*m"):
        calibrated(Trial("spring", driven), known_K=300.0)
