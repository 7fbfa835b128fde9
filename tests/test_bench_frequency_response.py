"""Phasors of a trial, and the frequency response over amplitudes."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from bench_synthetic import second_order, stepped_sine

from osl_analysis.bench.impedance import trial_phasors
from osl_analysis.bench.lag import noise_of
from osl_analysis.bench.phasors import frequency_response_table, phasor_table
from osl_analysis.bench.settings import BenchStiffness
from osl_analysis.commands.bench import average_over_amplitudes
from osl_analysis.doubtful import Doubt, marked
from osl_analysis.errors import InputError
from osl_analysis.signals import filtered_motion
from osl_analysis.stats.sinusoid import complex_quotient
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


def test_rounding_that_every_cycle_repeats_is_in_the_interval_of_a_phasor():
    """12 bits, no noise: the cycles agree exactly, and every zero of the encoder gives another amplitude."""
    step, sound = 2 * np.pi / 2**12, stepped_sine(second_order)
    true, off = [s.admittance.value for s in trial_phasors(sound)], []
    for zero in np.random.default_rng(5).uniform(0, step, 25):
        theta = np.rint((sound.theta + zero) / step) * step - zero
        motion, torque = filtered_motion(sound.time, theta, sound.torque, sound.low_pass)
        record = replace(sound, theta=theta, motion=motion, filtered_torque=torque, steps=(step, None))
        found = [s.admittance for s in trial_phasors(record)]
        off += [(abs(Y.value) - abs(Z)) / Y.magnitude_se for Y, Z in zip(found, true, strict=True)]
        assert phasor_table("made", trial_phasors(record))["interval_method"].unique().to_list() == [
            "cycles + rounding"
        ]
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.3


def test_an_error_of_the_bench_s_stiffness_is_in_the_admittance_and_is_not_averaged_away():
    """theta = theta_bench - torque/k: an error of 1/k is an error of Y, real and the same at every amplitude."""
    bench = BenchStiffness(value="3000 N*m/rad", standard_error="300 N*m/rad")
    record = replace(stepped_sine(second_order, noise=0.01), bench=bench)
    table = phasor_table("made", trial_phasors(record))
    assert table["Y_se_bench"].unique().to_list() == pytest.approx([300 / 3000**2])
    assert (table["Y_var_re"] > (300 / 3000**2) ** 2).all()
    condition = {"controller": pl.lit("compensated"), "K_d": pl.lit(200.0), "B_d": pl.lit(4.0), "doubtful": pl.lit("")}
    mean = frequency_response_table(table.with_columns(**condition)).row(0, named=True)
    assert np.sqrt(mean["Y_var_re"]) == pytest.approx(300 / 3000**2, rel=0.01)


def test_the_noise_of_measured_impedances_is_that_of_the_quotients_of_torque_and_angle():
    """RMS over all phasors, each quotient with its whole covariance, weighed as the fit of a lag weighs it."""
    phasors = trial_phasors(replace(stepped_sine(second_order, noise=0.1), steps=(2 * np.pi / 2**12, None)))
    weights = [abs(s.theta.value) ** 2 / (2 * s.frequency_hz) for s in phasors]
    variances = [np.trace(complex_quotient(s.torque, s.theta).covariance) for s in phasors]
    assert noise_of(phasors) == pytest.approx(np.sqrt(np.mean(np.multiply(weights, variances))), rel=1e-9)
