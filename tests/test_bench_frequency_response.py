"""Phasors of a trial, and the frequency response over amplitudes."""

import numpy as np
import polars as pl
import pytest
from bench_synthetic import second_order, stepped_sine

from osl_analysis.bench.frequency_response import phasor_table, trial_phasors
from osl_analysis.commands.bench import average_over_amplitudes
from osl_analysis.doubtful import Doubt, marked
from osl_analysis.errors import InputError
from osl_analysis.table import read_table, write_table


@pytest.mark.parametrize("level", [0.0, 3.0])
def test_a_torque_that_stays_where_it_is_is_refused_by_trial_signal_and_time(level):
    record = stepped_sine(lambda motion: np.full_like(motion.theta, level))
    message = f"trial made, torque from 4.0 s: the signal has no sine of 1 Hz, it stays at {level:g}; check its channel"
    with pytest.raises(InputError, match=message):
        trial_phasors(record)


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
