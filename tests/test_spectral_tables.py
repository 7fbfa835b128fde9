"""The tables of a frequency response: one trial, several trials of one condition, and those without a response."""

import numpy as np
import polars as pl
import pytest
from conftest import ROOT
from test_spectral_period import LOW_PASS, RATE, B, I, K, multisine, record

from osl_analysis.bench.settings import FilterSettings
from osl_analysis.commands.response import plotted_numbers, pool_responses
from osl_analysis.figures.response import points, words_of
from osl_analysis.spectral.realisations import LINES, periodic_motion
from osl_analysis.spectral.tables import MODELS, RESPONSE, RecordedMotion, response_tables
from osl_analysis.table import read_table, write_table


def recorded(name, theta, torque):
    whole = (slice(0, len(theta)),)
    found = periodic_motion(theta, torque, RATE, LOW_PASS.cutoff_hz)
    return RecordedMotion(name, theta, torque, RATE, LOW_PASS, found, whole)


def periodic(name, *seeds, size=1.0):
    return recorded(name, *record(sum(seeds), *(size * multisine(seed) for seed in seeds), noise=0.02))


def test_the_tables_of_a_periodic_trial_have_a_row_per_line_and_the_parameters_that_made_the_torque(parameters):
    tables = response_tables(periodic("M", 1, 2), parameters)
    assert dict(tables.response.schema) == RESPONSE
    assert dict(tables.models.schema) == MODELS
    assert dict(tables.lines.schema) == LINES
    s = 2j * np.pi * tables.response["frequency_hz"].to_numpy()
    Z = K + B * s + I * s**2
    for name, expected, at_most in (
        ("magnitude", np.abs(Z), 0.002),
        ("phase_deg", np.rad2deg(np.angle(Z)), 0.02),
        ("magnitude_eq15", np.abs(Z), 0.001),
        ("phase_deg_eq15", np.rad2deg(np.angle(Z)), 0.01),
    ):
        assert tables.response[name].to_numpy() == pytest.approx(expected, rel=at_most), name
    row = tables.models.row(0, named=True)
    assert (row["model"], row["method"], row["realisations"], row["periods"]) == ("Eq. 15", "robust", 2, 8)
    assert (row["weights"], row["misfit"] < 0.1, row["misfit_p"] > 0.01) == ("noise", True, True)
    for name, true in (("K", K), ("B", B), ("I", I)):
        assert row[f"{name}_low"] - 2 * row[f"{name}_se"] < true < row[f"{name}_high"] + 2 * row[f"{name}_se"]
    assert tables.models["model"].to_list() == ["Eq. 15", "Eq. 9"]
    assert tables.models["K_1"].is_not_null().to_list() == [False, True]


def test_a_device_without_parameters_has_no_eq_9():
    tables = response_tables(periodic("M", 1), None)
    assert tables.models["model"].to_list() == ["Eq. 15"]
    assert tables.response["magnitude_eq9"].null_count() == len(tables.response)


def test_a_motion_that_does_not_repeat_itself_has_the_local_polynomial_method():
    t = np.arange(round(30 * RATE)) / RATE
    rate = 2 * np.pi * (0.4 + 0.2 * t)  # a chirp to 6.4 Hz, its derivatives by hand
    theta = 0.05 * np.sin(2 * np.pi * (0.4 * t + 0.1 * t**2))
    omega = 0.05 * rate * np.cos(2 * np.pi * (0.4 * t + 0.1 * t**2))
    alpha = -(rate**2) * theta + 0.4 * np.pi * omega / rate
    noise = 0.02 * np.random.default_rng(1).standard_normal(len(t))
    tables = response_tables(recorded("C", theta, K * theta + B * omega + I * alpha + noise), None)
    row = tables.models.row(0, named=True)
    assert (row["method"], row["period_s"], row["odd_level"]) == ("local polynomial", None, None)
    assert (row["K"], row["B"], row["I"]) == pytest.approx((K, B, I), rel=5e-3)
    s = 2j * np.pi * tables.response["frequency_hz"].to_numpy()
    error = np.abs(tables.response["Z_re"].to_numpy() + 1j * tables.response["Z_im"].to_numpy() - K - B * s - I * s**2)
    assert np.mean((error / tables.response["noise_sd"].to_numpy()) ** 2) == pytest.approx(1, abs=0.6)
    assert tables.lines.is_empty()


def test_a_record_too_short_for_a_response_has_a_row_with_the_reason():
    theta, torque = (x[round(2 * RATE) : round(3 * RATE)] for x in record(1, multisine(1)))
    tables = response_tables(recorded("S", theta, torque), None)
    assert tables.response.is_empty()
    assert "record for longer" in tables.models["excluded"][0]


def test_trials_of_one_condition_are_pooled_where_their_motions_differ_in_phases_alone(tmp_path):
    trials = {"M1": (1.0, (1, 2)), "M2": (1.0, (3, 4)), "small": (0.5, (5, 6)), "other": (1.0, (7, 8))}
    paths = {name: tmp_path / f"{name}.csv" for name in (*trials, "sines")}
    for name, (size, seeds) in trials.items():
        write_table(response_tables(periodic(name, *seeds, size=size), None).lines, paths[name])
    write_table(pl.DataFrame(schema=LINES), paths["sines"])
    knee = {"joint": "knee", "side": "left", "controller": None, "K_d": None, "B_d": None}
    conditions = {name: {**knee, "K_d": 300.0 if name == "other" else None} for name in paths}
    pooled, models = tmp_path / "response_pooled.csv", tmp_path / "response_models_pooled.csv"
    settings, device = FilterSettings(cutoff_hz=15, order=4), ROOT / "config/parameters/default.yaml"
    pool_responses(list(paths.values()), conditions, settings, pooled, models, device)  # that of an ankle
    rows = read_table(models)
    assert rows["trials"].to_list() == ["M1, M2"]
    row = rows.row(0, named=True)
    assert (row["joint"], row["side"], row["controller"], row["K_d"], row["realisations"]) == (
        "knee", "left", None, None, 4,
    )  # fmt: skip
    single = response_tables(periodic("M1", 1, 2), None).models
    assert row["K_se"] < single["K_se"][0]
    write_table(response_tables(periodic("M1", 1, 2), None).response, tmp_path / "response.csv")
    plotted_numbers(tmp_path / "response.csv", pooled, tmp_path / "plotted.csv")
    (row,) = read_table(tmp_path / "plotted.csv").unique("trials").to_dicts()
    assert words_of(row) == ["Knee, left", "M1 and 1 more", "4 realisations"]


def test_conditions_without_a_second_trial_are_not_pooled(tmp_path):
    write_table(response_tables(periodic("M1", 1), None).lines, tmp_path / "M1.csv")
    pooled, models = tmp_path / "response_pooled.csv", tmp_path / "response_models_pooled.csv"
    pool_responses([tmp_path / "M1.csv"], {"M1": {}}, FilterSettings(cutoff_hz=15, order=4), pooled, models)
    assert read_table(pooled).is_empty()
    assert points(pl.DataFrame(schema=RESPONSE), read_table(pooled)).is_empty()
