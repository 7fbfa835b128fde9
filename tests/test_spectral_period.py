"""The period of a motion that repeats itself, its realisations, and Eq. 15 on their lines."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from conftest import ROOT

from osl_analysis.bench.record import record_of, stretches_of
from osl_analysis.bench.response_tables import MODELS, RESPONSE_COLUMNS, response_tables
from osl_analysis.bench.settings import BenchAnalysis
from osl_analysis.commands.figure import plot_numbers
from osl_analysis.commands.tables import pool_responses
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.figures.frequency import condition_words
from osl_analysis.signals import LowPass
from osl_analysis.spectral.periods import LINES as COLUMNS
from osl_analysis.spectral.periods import distinct, lines_of, period_spectra, periodic_motion
from osl_analysis.spectral.response import SecondOrder, fit_by_power, lines_of_periods
from osl_analysis.table import read_table, write_table

RATE, PERIOD, LOW_PASS = 250.0, 4.0, LowPass(15)
LINES, K, B, I = np.array([3, 5, 9, 11, 13, 17, 21, 23, 27, 29]), 200.0, 4.0, 0.05


def multisine(seed: int, periods: float = 5, ppm: float = 0.0, lines=LINES):
    """theta, omega, alpha (n,) of a random-phase multisine on a clock that is fast by ppm; derivatives by hand."""
    t = np.arange(round(periods * PERIOD * RATE)) / RATE * (1 + 1e-6 * ppm)
    w, phase = 2 * np.pi * lines / PERIOD, np.random.default_rng(seed).uniform(0, 2 * np.pi, len(lines))
    turn, size = np.outer(t, w) + phase, 0.05 / np.sqrt(len(lines))
    return np.array([size * np.cos(turn).sum(1), -size * np.sin(turn) @ w, -size * np.cos(turn) @ w**2])


def record(seed: int, *motions, noise: float = 0.0):
    """Angle and torque (n,) of motions one after another, each after a second of rest and a ramp of a second."""
    rest, parts = np.zeros((3, round(RATE))), []
    for motion in motions:
        parts += [rest, np.minimum(np.arange(motion.shape[1]) / RATE, 1.0) * motion]
    theta, omega, alpha = np.hstack([*parts, rest])
    rng = np.random.default_rng(seed)
    torque = K * theta + B * omega + I * alpha + noise * rng.standard_normal(len(theta))
    return theta + 1e-5 * rng.standard_normal(len(theta)), torque


@pytest.mark.parametrize("ppm", [0.0, 100.0, -100.0])
def test_the_period_is_found_on_a_clock_that_is_off_within_its_stated_error_of_less_than_a_millionth(ppm):
    found = [periodic_motion(*record(seed, multisine(seed, 6, ppm)), RATE, 10.0) for seed in range(1, 9)]
    assert [r.periods for r in found[0].realisations] == [5]
    errors = [1e6 * (one.period / PERIOD * (1 + 1e-6 * ppm) - 1) for one in found]
    stated = np.sqrt(np.mean([one.period_error_ppm**2 for one in found]))
    assert np.abs(errors).max() < 0.4
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) / stated < 2


def test_a_record_of_several_motions_with_one_period_has_as_many_realisations_and_one_of_a_motion_that_is_repeated():
    once, other = multisine(1), multisine(2)
    found = periodic_motion(*record(3, once, other, np.roll(once, 300, axis=1)), RATE, 10.0)
    assert [r.periods for r in found.realisations] == [4, 4, 4]
    starts = [r.start for r in found.realisations]  # after a second of rest, and a ramp within the first period
    assert np.diff(starts) == pytest.approx([21, 21], abs=0.2)
    assert [start + 4 * PERIOD for start in starts] == pytest.approx([21, 42, 63], abs=0.3)  # what is over is left out
    assert 2 < starts[0] < 1 + PERIOD + 0.1
    joined = distinct(found.realisations)
    assert [r.periods for r in joined] == [8, 4]
    theta = joined[0].spectra[0][:, LINES]
    assert np.abs(theta - theta.mean(0)).max() < 1e-3 * np.abs(theta).min()


@pytest.mark.parametrize("motion", ["chirp", "noise", "rest", "once", "by hand"])
def test_what_does_not_repeat_itself_has_no_period(motion):
    t, rng = np.arange(round(40 * RATE)) / RATE, np.random.default_rng(4)
    walk = np.convolve(rng.standard_normal(len(t)), np.hanning(60), "same")
    made = {"chirp": np.sin(np.pi * 0.1 * t**2), "noise": walk, "rest": np.zeros(len(t)), "once": multisine(5, 1.5)[0]}
    made["by hand"] = np.sin(2 * np.pi * 1.2 * t + 2e-2 * np.cumsum(walk) / RATE)  # a sine whose period changes by 5 %
    assert periodic_motion(made[motion], made[motion], RATE, 10.0) is None


def test_lines_are_those_that_were_excited_and_the_others_odd_and_even():
    lines = lines_of(periodic_motion(*record(6, multisine(1)), RATE, 10.0).realisations)
    assert (list(np.flatnonzero(lines.excited)), list(np.flatnonzero(lines.odd))) == (list(LINES), [7, 15, 19, 25])
    assert lines.only_odd
    assert list(np.flatnonzero(lines.even)) == list(range(2, 29, 2))


def test_spectra_of_a_period_that_is_no_whole_number_of_samples_leak_nothing():
    samples, k = 333.37, np.array([2, 7])
    t = np.arange(2000)
    y = 3 + 0.5 * np.cos(2 * np.pi * 2 * t / samples + 0.3) + 0.1 * np.sin(2 * np.pi * 7 * t / samples)
    X = period_spectra(y, 100.6, samples, 4, 20)
    expected = np.array([0.5 * np.exp(0.3j), -0.1j]) * np.exp(2j * np.pi * k * 100.6 / samples)
    assert (X[0, k], X[:, 0]) == (pytest.approx(expected, abs=1e-6), pytest.approx(3, abs=1e-6))
    turns = np.exp(2j * np.pi * np.outer(np.arange(4), k))  # every period begins at the same phase
    assert X[:, k] == pytest.approx(expected * turns, abs=1e-6)


def fit_periodic(realisations):
    return fit_by_power(SecondOrder(), lines_of_periods(realisations, LOW_PASS), (K, B))


def test_drift_of_the_load_cell_does_not_reach_the_lines():
    theta, torque = record(7, multisine(1))
    drift = 0.2 * np.arange(len(torque)) / RATE
    still, moved = (fit_periodic(periodic_motion(theta, y, RATE, 10.0).realisations) for y in (torque, torque + drift))
    assert moved.estimates[:3] == pytest.approx(still.estimates[:3], rel=1e-6)


def test_one_line_does_not_tell_stiffness_from_inertia():
    with pytest.raises((IdentifiabilityError, InputError), match=r"two frequencies|cannot be told apart"):
        fit_periodic(periodic_motion(*record(10, multisine(1, lines=np.array([5]))), RATE, 10.0).realisations)


def recorded(name, theta, torque):
    groups = stretches_of([slice(0, len(theta))], RATE)
    made = record_of(name, np.arange(len(theta)) / RATE, theta, torque, LOW_PASS, groups)
    return replace(made, torque=torque, periodic=periodic_motion(theta, torque, RATE, LOW_PASS.cutoff_hz))


def periodic(name, *seeds, size=1.0):
    return recorded(name, *record(sum(seeds), *(size * multisine(seed) for seed in seeds), noise=0.02))


def test_the_tables_of_a_periodic_trial_have_a_row_per_line_and_the_parameters_that_made_the_torque(parameters):
    tables = response_tables(periodic("M", 1, 2), parameters)
    for name, schema in (("response", RESPONSE_COLUMNS), ("response_models", MODELS), ("response_lines", COLUMNS)):
        assert dict(tables[name].schema) == schema
    s = 2j * np.pi * tables["response"]["frequency_hz"].to_numpy()
    Z = K + B * s + I * s**2
    for end, at_most in (("", 2.0), ("_eq15", 1.0)):
        magnitude, phase = (tables["response"][f"{name}{end}"].to_numpy() for name in ("magnitude", "phase_deg"))
        assert magnitude == pytest.approx(np.abs(Z), rel=1e-3 * at_most)
        assert phase == pytest.approx(np.rad2deg(np.angle(Z)), rel=1e-2 * at_most)
    row = tables["response_models"].row(0, named=True)
    assert (row["model"], row["method"], row["realisations"], row["periods"]) == ("Eq. 15", "robust", 2, 8)
    assert (row["weights"], row["misfit"] < 0.1, row["misfit_p"] > 0.01) == ("noise", True, True)
    for name, true in (("K", K), ("B", B), ("I", I)):
        assert row[f"{name}_low"] - 2 * row[f"{name}_se"] < true < row[f"{name}_high"] + 2 * row[f"{name}_se"]
    assert tables["response_models"]["model"].to_list() == ["Eq. 15", "Eq. 9"]
    assert tables["response_models"]["K_1"].is_not_null().to_list() == [False, True]
    softer = response_tables(periodic("M", 1, 2), replace(parameters, K_s=150.0))["response_models"]
    assert softer["excluded"][1].startswith("K = 200 N*m/rad is not between 0 and the belt's K_s = 150; Eq. 9")


def test_a_motion_that_does_not_repeat_itself_has_the_local_polynomial_method():
    t = np.arange(round(30 * RATE)) / RATE
    turn, rate = 2 * np.pi * (0.4 * t + 0.1 * t**2), 2 * np.pi * (0.4 + 0.2 * t)  # a chirp to 6.4 Hz
    theta, omega = 0.05 * np.sin(turn), 0.05 * rate * np.cos(turn)
    alpha = -(rate**2) * theta + 0.4 * np.pi * omega / rate
    noise = 0.02 * np.random.default_rng(1).standard_normal(len(t))
    tables = response_tables(recorded("C", theta, K * theta + B * omega + I * alpha + noise), None)
    row, response = tables["response_models"].row(0, named=True), tables["response"]
    assert (row["method"], row["period_s"], row["odd_level"]) == ("local polynomial", None, None)
    assert (row["K"], row["B"], row["I"]) == pytest.approx((K, B, I), rel=5e-3)
    assert (len(response) > 5, tables["response_lines"].is_empty()) == (True, True)
    s = 2j * np.pi * response["frequency_hz"].to_numpy()
    assert response["magnitude"].to_numpy() == pytest.approx(np.abs(K + B * s + I * s**2), rel=0.05)
    short = response_tables(recorded("S", *(x[:250] for x in (theta, omega))), None)
    assert short["response"].is_empty()
    assert "record for longer" in short["response_models"]["excluded"][0]
    alone = response_tables(recorded("N", theta, 50 * noise), None)  # a torque that is noise alone
    assert alone["response_models"]["excluded"][0].startswith("the joint moves at no frequency up to the filter's")


def test_trials_of_one_condition_are_pooled_where_their_motions_differ_in_phases_alone(tmp_path):
    trials = {"M1": (1.0, (1, 2)), "M2": (1.0, (3, 4)), "small": (0.5, (5, 6)), "other": (1.0, (7, 8))}
    paths = {name: tmp_path / f"{name}.csv" for name in (*trials, "sines")}
    for name, (size, seeds) in trials.items():
        write_table(response_tables(periodic(name, *seeds, size=size), None)["response_lines"], paths[name])
    write_table(pl.DataFrame(schema=COLUMNS), paths["sines"])
    knee = {"joint": "knee", "side": "left", "controller": None, "K_d": None, "B_d": None}
    conditions = {name: {**knee, "K_d": 300.0 if name == "other" else None} for name in paths}
    pooled, models = tmp_path / "response_pooled.csv", tmp_path / "response_models_pooled.csv"
    settings, device = BenchAnalysis(cutoff_hz=15, order=4), ROOT / "config/parameters/default.yaml"
    pool_responses(list(paths.values()), conditions, settings, pooled, models, device)  # that of an ankle
    (row,) = read_table(models).to_dicts()
    found = [row[name] for name in ("trials", "joint", "side", "controller", "K_d", "realisations")]
    assert found == ["M1, M2", "knee", "left", None, None, 4]
    single = response_tables(periodic("M1", 1, 2), None)
    assert row["K_se"] < single["response_models"]["K_se"][0]
    write_table(single["response"], tmp_path / "response.csv")
    plot_numbers("response", tmp_path / "response.csv", tmp_path / "plotted.csv", second=pooled)
    (row,) = read_table(tmp_path / "plotted.csv").unique("trials").to_dicts()
    assert condition_words(row, 28) == ["Knee, left", "M1 and 1 more", "4 realisations"]
