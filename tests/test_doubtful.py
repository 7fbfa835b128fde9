"""Which fits are doubtful: limits on any column of a table, and what becomes of the mark on its way to the reader."""

import numpy as np
import polars as pl
import pytest
import yaml
from conftest import ROOT
from scipy.integrate import quad
from statsmodels.stats.diagnostic import acorr_ljungbox

from osl_analysis.bench.belt import BeltTrial, belt_table, fit_belt_stiffness
from osl_analysis.bench.diagnostics import summary_of_trials
from osl_analysis.bench.estimators import estimator_table
from osl_analysis.bench.frequency_response import phasor_table, trial_phasors
from osl_analysis.bench.impedance import impedance_table
from osl_analysis.bench.protocol import SteppedSineProtocol, find_blocks, unit_block
from osl_analysis.bench.settings import DynamometerAnalysis
from osl_analysis.bench.stepped_sine import SteppedSineTrial
from osl_analysis.bench.transmission import transmission_table
from osl_analysis.commands.bench import average_over_amplitudes, plotted_numbers_fig4
from osl_analysis.commands.fit import estimates_text
from osl_analysis.commands.tables import gather
from osl_analysis.config import TimeSeriesFigure, read_section
from osl_analysis.doubtful import Doubt, DoubtfulFits, doubt_report, doubtful_count, doubts, marked
from osl_analysis.errors import InputError
from osl_analysis.second_order import impedance_torque, lag_damping_row
from osl_analysis.signals import LowPass, Motion, filtered_motion
from osl_analysis.stats.whiteness import whiteness
from osl_analysis.table import read_table, write_table
from osl_analysis.trial import Trial
from osl_analysis.trial_file import write_trial

RATE, LOW_PASS = 500.0, LowPass(15)
PROTOCOL = SteppedSineProtocol((0.05, 0.1), (1.0, 3.0, 5.0), 9)


def fits(**columns):
    return pl.DataFrame({"trial": ["a", "b"], **columns})


def stepped_sine(torque_of, noise=0.0, protocol=PROTOCOL):
    """A stepped-sine trial whose torque [N*m] is a function of its motion, with white noise."""
    rest = np.zeros(round(2 * RATE))
    theta = np.concatenate([rest, *(x for a in protocol.amplitudes for x in (a * unit_block(protocol, RATE), rest))])
    time = np.arange(len(theta)) / RATE
    motion, _ = filtered_motion(time, theta, theta, LowPass(100))
    torque = torque_of(motion) + noise * np.random.default_rng(1).standard_normal(len(time))
    filtered = filtered_motion(time, theta, torque, LOW_PASS)
    blocks = find_blocks(time, theta, protocol)
    return SteppedSineTrial("made", time, RATE, theta, torque, *filtered, blocks, None, 2, LOW_PASS, 0.0)


def second_order(motion: Motion):
    return impedance_torque(200, 4, 0.05, motion)


def test_a_fit_is_doubtful_for_every_limit_that_it_passes_and_says_which():
    row = {"VAF": 80.0, "lag": -0.7, "condition": 5.0, "held_out": None, "name": "x", "n": 3}
    reasons = doubts(row, {"lag": 0.5, "condition": 10, "n": 2}, {"VAF": 90, "held_out": 80})
    assert reasons == "lag -0.7 is above 0.5; n 3 is above 2; VAF 80 is below 90"
    assert doubts(row, {"lag": 0.7}, {"VAF": 80}) == ""
    assert doubts({"VAF": float("nan")}, {}, {"VAF": 90}) == "VAF is not a number"


def test_a_lower_limit_is_on_the_value_and_an_upper_one_on_its_size():
    assert doubts({"VAF": -200.0}, {}, {"VAF": 90}) == "VAF -200 is below 90"
    assert doubts({"VAF_held_out": -95.0, "lag": -95.0}, {"lag": 90}, {"VAF_held_out": 90}) == (
        "lag -95 is above 90; VAF_held_out -95 is below 90"
    )


def test_any_numeric_column_of_any_table_can_have_a_limit_and_null_takes_it_out():
    table = fits(VAF=[80.0, 99.0], samples=[10, 1000])
    limits = Doubt(above={"samples": 500}, below={"VAF": 90})
    assert marked(table, limits, "belt")["doubtful"].to_list() == ["VAF 80 is below 90", "samples 1e+03 is above 500"]
    assert marked(table, Doubt(below={"VAF": None}), "belt")["doubtful"].to_list() == ["", ""]


@pytest.mark.parametrize("column", ["VFA", "trial"])
def test_a_limit_on_what_is_no_column_of_numbers_is_one_line_that_names_it(column):
    message = rf"doubtful\.belt: the table has no column '{column}' of numbers; put the limit on one of VAF"
    with pytest.raises(InputError, match=message):
        marked(fits(VAF=[80.0, 99.0]), Doubt(below={column: 1}), "belt")


def test_a_table_without_limits_of_its_own_is_refused_by_name(tmp_path):
    (tmp_path / "c.yaml").write_text(yaml.safe_dump({"doubtful": {"belts": {"below": {"VAF": 1}}}}))
    with pytest.raises(InputError, match=r"unknown table 'belts'; limits may stand on belt, transmission"):
        read_section(tmp_path / "c.yaml", "doubtful", DoubtfulFits)


def test_a_crossing_without_a_fit_is_neither_doubtful_nor_not():
    table = fits(VAF=[None, 80.0], excluded=["no markers", None])
    assert marked(table, Doubt(below={"VAF": 90}), "walking")["doubtful"].to_list() == [None, "VAF 80 is below 90"]
    assert doubtful_count(marked(table, Doubt(below={"VAF": 90}), "walking")) == (1, 1)
    nothing = fits(excluded=["no markers", "no onset"])
    assert marked(nothing, Doubt(below={"VAF": 90}), "walking")["doubtful"].to_list() == [None, None]


def test_gathered_tables_carry_the_mark_summaries_their_number_and_the_end_of_the_run_says_so(tmp_path):
    for trial, vaf in (("belt_1", 80.0), ("belt_2", 99.5), ("belt_3", 80.0)):
        write_table(pl.DataFrame({"trial": [trial], "VAF": [vaf], "K_s": [vaf]}), tmp_path / f"{trial}.csv")
    rows = [tmp_path / f"belt_{k}.csv" for k in (1, 2, 3)]
    gather(rows, tmp_path / "belt.csv", Doubt(below={"VAF": 99}))
    gather(rows, tmp_path / "quality.csv")
    gather(rows, tmp_path / "good.csv", Doubt())
    table = read_table(tmp_path / "belt.csv")
    assert table["doubtful"].to_list() == ["VAF 80 is below 99", "", "VAF 80 is below 99"]
    assert summary_of_trials(table, ["K_s"])["n_doubtful"].to_list() == [2]
    assert "doubtful" not in read_table(tmp_path / "quality.csv").columns
    report = doubt_report(tmp_path / f"{name}.csv" for name in ("belt", "quality", "good", "absent"))
    assert report == "doubtful fits (the column `doubtful` of each table says why): belt 2 of 3"
    assert doubt_report([tmp_path / "good.csv"]) == ""


def test_the_shipped_limits_stand_on_columns_that_the_tables_have():
    """Walking's and the actuator's are held by the workflow's test, which runs them."""
    limits = read_section(ROOT / "config/config.yaml", "doubtful", DoubtfulFits)
    record = stepped_sine(second_order, noise=0.1)
    cycle = 0.0873 * (1 - np.cos(np.linspace(0, 2 * np.pi, 3000))) / 2
    theta_s = np.concatenate([np.zeros(200), cycle, np.zeros(200)])
    belt = BeltTrial(
        "b", np.arange(3400.0), RATE, LOW_PASS, theta_s, 685 * theta_s, fit_belt_stiffness(theta_s, theta_s)
    )
    tables = {
        "belt": belt_table(belt),
        "transmission": transmission_table(stepped_sine(lambda m: 0.45 * m.omega + 0.005 * m.alpha, noise=0.01)),
        "impedance": impedance_table(record, trial_phasors(record)),
        "estimators": estimator_table(record),
        "phasors": phasor_table("made", trial_phasors(record)),
    }
    for name, table in tables.items():
        assert set(marked(table, getattr(limits, name), name)["doubtful"]) == {""}


def test_noise_bandwidth_is_the_integral_of_the_squared_gain_of_both_runs():
    for order in (1, 2, 4, 7):
        integral, _ = quad(lambda x, order=order: (1 + x ** (2 * order)) ** -2, 0, 50)
        assert LowPass(15, order).noise_bandwidth_hz == pytest.approx(15 * integral, rel=1e-3)


def test_ljung_box_is_statsmodels():
    residual = np.random.default_rng(3).standard_normal(400).cumsum()
    found = whiteness(residual, 2 * LOW_PASS.noise_bandwidth_hz, LOW_PASS)
    other = acorr_ljungbox(residual - residual.mean(), lags=10)
    centred = whiteness(residual - residual.mean(), 2 * LOW_PASS.noise_bandwidth_hz, LOW_PASS)
    assert 10 * centred.per_lag == pytest.approx(other["lb_stat"].iloc[-1])
    short = whiteness(residual[:30] - residual[:30].mean(), 20.0, LOW_PASS)
    other = acorr_ljungbox(residual[:30] - residual[:30].mean(), lags=6)
    assert (6 * short.per_lag, short.p) == pytest.approx(tuple(other.iloc[-1]))
    assert found.autocorrelation > 0.9


def test_white_noise_through_the_filter_passes_as_white_five_times_in_hundred_it_does_not():
    """95 % of 300 seeded records of 60 s, 1600 samples each: a rate of twice the cut-off itself would refuse all."""
    rng, p = np.random.default_rng(4), []
    for _ in range(300):
        found = whiteness(LOW_PASS(rng.standard_normal(round(60 * RATE)), RATE), RATE, LOW_PASS)
        p.append(found.p)
        assert abs(found.autocorrelation) < 0.15
    assert 0.02 < np.mean(np.array(p) < 0.05) < 0.09
    assert 0.4 < np.mean(p) < 0.6


def test_a_slow_residual_is_not_white_and_too_short_a_one_is_not_judged():
    t = np.arange(0, 100, 1 / RATE)
    white = LOW_PASS(np.random.default_rng(5).standard_normal(len(t)), RATE)
    slow = whiteness(white + np.sin(t), RATE, LOW_PASS)
    assert slow.autocorrelation > 0.7
    assert slow.per_lag > 100
    assert slow.p < 1e-6
    assert whiteness(white[:300], RATE, LOW_PASS) is None
    assert whiteness(np.zeros(5000), RATE, LOW_PASS) is None


def test_a_lag_costs_damping_and_counts_where_it_is_certain():
    assert lag_damping_row(2e-3, 0.9e-3, 300.0)["certain_lag_damping"] == pytest.approx(-0.6)
    row = lag_damping_row(2e-3, 1.1e-3, 300.0)
    assert (row["lag_damping"], row["certain_lag_damping"]) == (pytest.approx(-0.6), 0.0)
    assert set(lag_damping_row(None, None, 300.0).values()) == {None}


def test_the_row_over_all_amplitudes_says_from_where_to_where_the_single_ones_read():
    """K falls from the small amplitude to the large one as Coulomb friction's share does in K theta^3."""
    record = stepped_sine(lambda m: second_order(m) + 2e3 * m.theta**3)
    table = impedance_table(record, trial_phasors(record))
    small, large, both = table.to_dicts()
    assert small["K"] + 3 < both["K"] < large["K"]
    for name in "KBI":
        low, high = sorted((small[name], large[name]))
        assert (both[f"{name}_amplitudes_low"], both[f"{name}_amplitudes_high"]) == (low, high)
        assert small[f"{name}_amplitudes_low"] is None
    assert f"single amplitudes {small['K']:.5g} to {large['K']:.5g}" in estimates_text(table)
    assert estimates_text(table).count("single amplitudes") == 3


def test_an_estimator_that_thins_its_rows_has_its_times_told_in_seconds_all_the_same():
    """The whitening estimator keeps one row in eight; what is left of white noise is white for both."""
    table = estimator_table(stepped_sine(second_order, noise=0.5))
    filtered, whitened = (
        table.row(by_predicate=pl.col("estimator") == name, named=True) for name in ("filtered", "whitened")
    )
    assert whitened["samples"] < filtered["samples"] / 7
    lag = whitened["correlation_s"] * RATE / 8
    assert lag == pytest.approx(round(lag), abs=0.05 * lag)
    assert min(filtered["ljung_box_p"], whitened["ljung_box_p"]) > 0.01


def test_fig4_says_whether_the_fit_of_the_amplitude_that_it_shows_is_doubtful(tmp_path):
    record = stepped_sine(second_order)
    samples = pl.DataFrame({"time": record.time, "theta": record.theta, "torque": record.torque})
    write_trial(Trial("made", samples), tmp_path / "made.parquet")
    degrees = [round(float(np.rad2deg(a)), 9) for a in PROTOCOL.amplitudes]
    settings = DynamometerAnalysis(
        cutoff_hz=15, order=4, amplitudes_deg=degrees, frequencies_hz=PROTOCOL.frequencies_hz, cycles=9, settle_cycles=2
    )
    table = impedance_table(record, trial_phasors(record))
    write_table(table.with_columns(VAF=pl.Series([99.0, 80.0, 80.0])), tmp_path / "fit.csv")
    for amplitude, reason in zip(degrees, ("", "VAF 80 is below 90"), strict=True):
        choice = TimeSeriesFigure(K_d=1, B_d=1, controller="compensated", amplitude_deg=amplitude, duration_s=1)
        limits = Doubt(below={"VAF": 90})
        plotted_numbers_fig4(
            tmp_path / "made.parquet", tmp_path / "fit.csv", settings, choice, limits, tmp_path / "fig4.csv"
        )
        assert set(read_table(tmp_path / "fig4.csv")["doubtful"]) == {reason}


def test_fig4_shows_an_amplitude_that_the_protocol_has_twice(tmp_path):
    protocol = SteppedSineProtocol((0.05, 0.05), PROTOCOL.frequencies_hz, 9)
    record, degrees = stepped_sine(second_order, protocol=protocol), float(np.rad2deg(0.05))
    samples = pl.DataFrame({"time": record.time, "theta": record.theta, "torque": record.torque})
    write_trial(Trial("made", samples), tmp_path / "made.parquet")
    write_table(impedance_table(record, trial_phasors(record)), tmp_path / "fit.csv")
    settings = DynamometerAnalysis(
        cutoff_hz=15, order=4, amplitudes_deg=(degrees, degrees), frequencies_hz=PROTOCOL.frequencies_hz, cycles=9,
        settle_cycles=2,
    )  # fmt: skip
    choice = TimeSeriesFigure(K_d=1, B_d=1, controller="compensated", amplitude_deg=degrees, duration_s=1)
    plotted_numbers_fig4(
        tmp_path / "made.parquet", tmp_path / "fit.csv", settings, choice, Doubt(), tmp_path / "fig4.csv"
    )
    assert len(read_table(tmp_path / "fig4.csv")) == RATE


@pytest.mark.parametrize("level", [0.0, 3.0])
def test_a_torque_that_stays_where_it_is_is_refused_by_trial_signal_and_time(level):
    record = stepped_sine(lambda motion: np.full_like(motion.theta, level))
    message = f"trial made, torque from 4.0 s: there is no sine of 1 Hz in it, it stays at {level:g}; check its channel"
    with pytest.raises(InputError, match=message):
        trial_phasors(record)


def test_one_amplitude_has_no_range():
    record = stepped_sine(second_order, protocol=SteppedSineProtocol((0.1,), PROTOCOL.frequencies_hz, 9))
    table = impedance_table(record, trial_phasors(record))
    assert table["K_amplitudes_low"].to_list() == table["K_amplitudes_high"].to_list() == [None, None]


def test_transmission_tells_how_much_of_its_damping_is_coulomb_friction_and_predicts_the_amplitude_not_seen():
    smooth = transmission_table(stepped_sine(lambda m: 0.45 * m.omega + 0.005 * m.alpha)).to_dicts()
    rough = transmission_table(
        stepped_sine(lambda m: 0.3 * m.omega + 0.005 * m.alpha + 0.15 * np.tanh(m.omega / 0.05))
    ).to_dicts()
    assert abs(smooth[-1]["coulomb_share"]) < 0.01
    assert rough[-1]["coulomb_share"] == pytest.approx(1 - 0.3 / rough[-1]["B_j"], abs=0.03)
    assert rough[-1]["coulomb_share"] > 0.1
    assert smooth[0]["VAF_held_out"] > 99.9 > rough[0]["VAF_held_out"]
    assert smooth[-1]["VAF_held_out"] is None
    assert rough[-1]["odd_harmonics"] > 10 * smooth[-1]["odd_harmonics"]


def test_a_belt_tells_what_a_straight_line_leaves_out():
    """Energy lost to friction of 0.5 N*m over the elastic one; slope of 876 theta + 14913 theta |theta| at the peak."""
    peak = 0.0873
    way = peak * (1 - np.cos(np.linspace(0, np.pi, 1500))) / 2
    theta_s = np.concatenate([np.zeros(200), way, way[::-1], np.zeros(200)])
    direction = np.concatenate([np.zeros(200), np.ones(1500), -np.ones(1500), np.zeros(200)])
    time = np.arange(len(theta_s)) / RATE

    def row(torque):
        return belt_table(
            BeltTrial("b", time, RATE, LOW_PASS, theta_s, torque, fit_belt_stiffness(theta_s, torque))
        ).row(0, named=True)

    assert row(685 * theta_s + 0.5 * direction)["energy_lost"] == pytest.approx(2 * 0.5 / (685 * peak / 2), rel=1e-3)
    stiffening = row(876 * theta_s + 14913 * theta_s * np.abs(theta_s))["stiffening"]
    assert stiffening == pytest.approx(2 * 14913 * peak / 876, rel=1e-6)


def test_phasors_keep_their_covariance_and_the_response_over_amplitudes_its_interval_and_its_doubts(tmp_path):
    record = stepped_sine(second_order, noise=0.5)
    condition = {"controller": pl.lit("compensated"), "K_d": pl.lit(200.0), "B_d": pl.lit(4.0)}
    table = phasor_table("made", trial_phasors(record)).with_columns(**condition)
    assert set(table["interval_method"]) == {"cycles"}
    assert (table["torque_var_re"] > 100 * table["theta_var_re"]).all()
    np.testing.assert_allclose(table["torque_degrees_of_freedom"], 5)
    first = table.row(0, named=True)
    half = 2.5706 * first["Y_magnitude_se"]  # Student's quantile for the five degrees of freedom of six cycles
    assert first["Y_magnitude_high"] - first["Y_magnitude"] == pytest.approx(half, rel=1e-3)
    write_table(marked(table, Doubt(above={"amplitude_deg": 4}), "phasors"), tmp_path / "phasors.csv")
    average_over_amplitudes(tmp_path / "phasors.csv", tmp_path / "response.csv")
    mean = read_table(tmp_path / "response.csv").row(0, named=True)
    both = table.filter(pl.col("frequency_hz") == 1)
    assert (mean["magnitude_min"], mean["magnitude_max"]) == (both["Y_magnitude"].min(), both["Y_magnitude"].max())
    assert (mean["phase_min_deg"], mean["phase_max_deg"]) == pytest.approx(
        (both["Y_phase_deg"].min(), both["Y_phase_deg"].max())
    )
    assert mean["Y_var_re"] == pytest.approx(both["Y_var_re"].sum() / 4)
    assert 4.99 <= mean["Y_degrees_of_freedom"] <= 10.5
    assert mean["magnitude_low"] < mean["magnitude"] < mean["magnitude_high"]
    assert mean["phase_low_deg"] < mean["phase_deg"] < mean["phase_high_deg"]
    assert mean["doubtful"] == "at 5.7296 deg: amplitude_deg 5.73 is above 4".replace("5.7296", f"{np.rad2deg(0.1):g}")
