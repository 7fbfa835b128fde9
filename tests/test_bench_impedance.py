"""The rendered impedance: rows by amplitude, and the numbers of Fig. 4."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from bench_synthetic import PROTOCOL, RATE, second_order, stepped_sine

from osl_analysis.bench.impedance import amplitude_series, impedance_of, impedance_table, trial_phasors
from osl_analysis.bench.model_comparison import thinned_amplitudes
from osl_analysis.bench.segments import unit_sines
from osl_analysis.bench.settings import DynamometerAnalysis
from osl_analysis.bench.stepped_sine import stepped_sine_trial
from osl_analysis.campaign import ImpedanceExample
from osl_analysis.commands import plotted_numbers
from osl_analysis.commands.fit_text import estimates_text
from osl_analysis.doubtful import Doubt
from osl_analysis.figures.fig4 import draw as draw_fig4
from osl_analysis.protocol.runs import SteppedSineProtocol
from osl_analysis.signals import LowPass, filtered_motion
from osl_analysis.table import read_table, write_table
from osl_analysis.trial import Trial, read_trial, write_trial


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


def test_one_amplitude_has_no_range():
    record = stepped_sine(second_order, protocol=SteppedSineProtocol((0.1,), PROTOCOL.frequencies_hz, 9))
    table = impedance_table(record, trial_phasors(record))
    assert table["K_amplitudes_low"].to_list() == table["K_amplitudes_high"].to_list() == [None, None]


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
        choice = ImpedanceExample("made", "ankle", None, amplitude, 1, "")
        limits = Doubt(below={"VAF": 90})
        plotted_numbers.fig4(
            tmp_path / "made.parquet", tmp_path / "fit.csv", settings, choice, limits, tmp_path / "fig4.csv"
        )
        assert set(read_table(tmp_path / "fig4.csv")["doubtful"]) == {reason}


def test_the_model_of_fig4_is_the_fit_to_the_settled_cycles_and_has_no_torque_beyond_them():
    """Before the settled cycles the torque is three times as large, which a fit to all rows would take up."""

    def disturbed(motion):
        joint, fast = second_order(motion), np.abs(motion.theta) > 0
        ends = np.flatnonzero(np.diff(fast.astype(int), prepend=0) == 1)  # each block begins with the 1 Hz
        for start in ends[np.diff(ends, prepend=-RATE * 5) > RATE * 5]:
            joint[start : start + round(0.8 * RATE)] *= 3
        return joint

    record = stepped_sine(disturbed)
    shown = amplitude_series(record, record.blocks[1].amplitude_deg, 1000.0)
    row = impedance_table(record, trial_phasors(record)).row(1, named=True)
    block = record.blocks[1].stretches[0]
    motion = record.motion[np.r_[block]]
    expected = row["K"] * motion.theta + row["B"] * motion.omega + row["I"] * motion.alpha + row["offset"]
    fitted = shown["torque_model"].is_not_null().to_numpy()
    np.testing.assert_allclose(shown["torque_model"].to_numpy()[fitted], expected[fitted], rtol=1e-9, atol=1e-9)
    assert row["K"] == pytest.approx(200, rel=1e-3)
    # of nine cycles at 1, 3 and 5 Hz the first two and the last one
    assert (~fitted).sum() == pytest.approx(3 * RATE * (1 + 1 / 3 + 1 / 5), abs=4)


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
    choice = ImpedanceExample("made", "ankle", None, degrees, 1, "")
    plotted_numbers.fig4(
        tmp_path / "made.parquet", tmp_path / "fit.csv", settings, choice, Doubt(), tmp_path / "fig4.csv"
    )
    assert len(read_table(tmp_path / "fig4.csv")) == RATE


def test_where_amplitudes_nest_inside_frequencies_fig4_and_the_comparison_use_one_amplitude_only(tmp_path):
    """1 Hz at both amplitudes, then 3, then 5 Hz. The small amplitude has half of the stiffness of the large one: an
    exact joint at each amplitude, of which a fit to rows of both leaves several percent."""
    sines = [a * unit_sines([(f, 9)], RATE) for f in PROTOCOL.frequencies_hz for a in PROTOCOL.amplitudes]
    rest = np.zeros(round(2 * RATE))
    theta = np.concatenate([rest, *(x for sine in sines for x in (sine, rest))])
    large = np.concatenate([rest, *(np.full(len(s) + len(rest), np.max(s) > 0.08) for s in sines)]).astype(bool)
    time = np.arange(len(theta)) / RATE
    motion, _ = filtered_motion(time, theta, theta, LowPass(100))
    torque = second_order(motion) * np.where(large, 1.0, 0.5) + 1e-3 * np.random.default_rng(1).standard_normal(
        len(theta)
    )
    write_trial(
        Trial("made", pl.DataFrame({"time": time, "theta": theta, "torque": torque})), tmp_path / "made.parquet"
    )
    degrees = [round(float(np.rad2deg(a)), 9) for a in PROTOCOL.amplitudes]
    settings = DynamometerAnalysis(
        cutoff_hz=15, order=4, amplitudes_deg=degrees, frequencies_hz=PROTOCOL.frequencies_hz, cycles=9, settle_cycles=2
    )
    record = stepped_sine_trial(read_trial(tmp_path / "made.parquet"), settings)
    table = impedance_table(record, trial_phasors(record))
    assert table["K"].to_list()[:2] == pytest.approx([100, 200], rel=1e-3)
    write_table(table, tmp_path / "fit.csv")
    for amplitude, size in zip(degrees, PROTOCOL.amplitudes, strict=True):
        choice = ImpedanceExample("made", "ankle", None, amplitude, 10, "")
        plotted_numbers.fig4(
            tmp_path / "made.parquet", tmp_path / "fit.csv", settings, choice, Doubt(), tmp_path / "fig4.csv"
        )
        shown = read_table(tmp_path / "fig4.csv")
        assert np.rad2deg(size) == pytest.approx(shown["theta_deg"].abs().max(), rel=0.02)
        assert 1 - (shown["torque"] - shown["torque_model"]).var() / shown["torque"].var() > 0.9995
        assert draw_fig4(shown).axes[1].lines[0].get_ydata().shape[0] > len(shown)  # broken between the frequencies
    small_rows, large_rows = thinned_amplitudes(record)
    assert not large[small_rows].any()
    assert large[large_rows].all()
    assert len(large_rows) == pytest.approx(len(small_rows), abs=3)


def test_a_trial_that_is_made_of_a_fitted_one_is_fitted_anew():
    """Fits are kept with their trial, and not taken over by another one with other signals."""
    record = stepped_sine(second_order, noise=0.1)
    whole = impedance_of(record, None)
    assert impedance_of(record, None) is whole
    stiffer = replace(record, filtered_torque=2 * record.filtered_torque, torque=2 * record.torque)
    assert impedance_of(stiffer, None)["K"] == pytest.approx(2 * whole["K"], rel=1e-9)
    assert impedance_of(record, None)["K"] == whole["K"]
