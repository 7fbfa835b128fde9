"""Rendered impedance of a stepped sine: amplitudes, phasors and the lag that they show."""

from dataclasses import replace

import bench_synthetic
import numpy as np
import polars as pl
import pytest
from bench_synthetic import FIVE, PROTOCOL, RATE, impedance_torque, record_of_sines, second_order, stepped_sine
from conftest import ROOT
from scipy.ndimage import shift
from scipy.signal import butter, sosfilt

from osl_analysis.bench.analysis import analysed
from osl_analysis.bench.effects import IMPEDANCE, Fault, causes, lag_of, linear_torque, plain_sums, sums_of
from osl_analysis.bench.impedance import DesiredImpedance, judged_impedance, lag_row, left_unchecked
from osl_analysis.bench.model_comparison import thinned_amplitudes
from osl_analysis.bench.phasors import frequency_response_table, phasor_table, phasors_of_record
from osl_analysis.bench.record import record_of_trial
from osl_analysis.bench.settings import BenchStiffness
from osl_analysis.campaign.configuration import read_section
from osl_analysis.commands import figure as plotted_numbers
from osl_analysis.commands.bench import estimates_text, summarise
from osl_analysis.errors import InputError
from osl_analysis.figures.impedance import draw_fig4
from osl_analysis.judge.doubts import marked
from osl_analysis.judge.table import Doubt, DoubtfulFits
from osl_analysis.model.compensator import PAPER_WEIGHT, select_gains
from osl_analysis.model.drivetrain import joint_admittance
from osl_analysis.model.parameters import read_parameters
from osl_analysis.protocol.stepped_sine import unit_sines
from osl_analysis.table import read_table, write_table
from osl_analysis.trial import Trial, write_trial


def test_the_row_over_all_amplitudes_says_from_where_to_where_the_single_ones_read():
    """K falls from the small amplitude to the large one as Coulomb friction's share does in K theta^3."""
    record = stepped_sine(lambda m: second_order(m) + 2e3 * m.theta**3)
    table = bench_synthetic.table_of(record)
    small, large, both = table.to_dicts()
    assert small["K"] + 3 < both["K"] < large["K"]
    assert phasors_of_record(record)[3].torque.distortion == pytest.approx(2e3 * 0.1**3 / 4 / 21.45, rel=0.02)
    for name in "KBI":
        low, high = sorted((small[name], large[name]))
        assert (both[f"{name}_amplitudes_low"], both[f"{name}_amplitudes_high"]) == (low, high)
        assert small[f"{name}_amplitudes_low"] is None
    assert f"single amplitudes {small['K']:.5g} to {large['K']:.5g}" in estimates_text(table)
    assert estimates_text(table).count("single amplitudes") == 3


def test_the_model_of_fig4_is_the_fit_to_the_settled_cycles_and_has_no_torque_beyond_them():
    """Before the settled cycles the torque is three times as large, which a fit to all rows would take up."""

    def disturbed(motion):
        joint, fast = second_order(motion), np.abs(motion.theta) > 0
        ends = np.flatnonzero(np.diff(fast.astype(int), prepend=0) == 1)  # each block begins with the 1 Hz
        for start in ends[np.diff(ends, prepend=-RATE * 5) > RATE * 5]:
            joint[start : start + round(0.8 * RATE)] *= 3
        return joint

    record = stepped_sine(disturbed)
    large = record.label_near(None)
    assert [record.label_near(3), large] == list(record.groups.labels)
    with pytest.raises(InputError, match=r"amplitude_deg = 4\.2 is not in the protocol"):  # 2.86 and 5.73 deg
        record.label_near(4.2)
    shown = analysed(record, plain_sums(record, IMPEDANCE), IMPEDANCE).last_seconds(large, 1000.0)
    row = bench_synthetic.table_of(record).row(1, named=True)
    motion = record.motion[np.r_[record.moving(large)[0]]]
    expected = row["K"] * motion.theta + row["B"] * motion.omega + row["I"] * motion.alpha + row["offset"]
    fitted = shown["torque_model"].is_not_null().to_numpy()
    left = shown["torque_model"].to_numpy()[fitted] - expected[fitted]  # the drift of 5e-8 N*m that is fitted too
    np.testing.assert_allclose(left, 0, atol=2e-7)
    assert row["K"] == pytest.approx(200, rel=1e-3)
    # of nine cycles at 1, 3 and 5 Hz the first two and the last one
    assert (~fitted).sum() == pytest.approx(3 * RATE * (1 + 1 / 3 + 1 / 5), abs=4)


def test_where_amplitudes_nest_inside_frequencies_fig4_and_the_comparison_use_one_amplitude_only(tmp_path):
    """A fit to both amplitudes leaves several percent: the small one has half of the stiffness of the large one."""
    sines = [a * unit_sines([(f, 9)], RATE) for f in PROTOCOL.frequencies_hz for a in PROTOCOL.amplitudes]
    rest = np.zeros(round(2 * RATE))
    theta = np.concatenate([rest, *(x for sine in sines for x in (sine, rest))])
    large = np.concatenate([rest, *(np.full(len(s) + len(rest), np.max(s) > 0.08) for s in sines)]).astype(bool)
    time, noise = np.arange(len(theta)) / RATE, 1e-3 * np.random.default_rng(1).standard_normal(len(theta))
    torque = second_order(bench_synthetic.true_motion(time, theta)) * np.where(large, 1.0, 0.5) + noise
    trial = Trial("made", pl.DataFrame({"time": time, "theta": theta, "torque": torque}))
    path = tmp_path / "made.parquet"
    write_trial(trial, path)
    degrees = [round(float(np.rad2deg(a)), 9) for a in PROTOCOL.amplitudes]
    record = record_of_trial(trial, settings := bench_synthetic.sine_settings(degrees, (1, 3, 5), 9))
    table, limits = bench_synthetic.table_of(record), Doubt(below={"K": 150})
    assert table["K"].to_list()[:2] == pytest.approx([100, 200], rel=1e-3)
    write_table(table, tmp_path / "fit.csv")
    for amplitude, reason in zip(degrees, ("[K 100 is below 150]", ""), strict=True):
        choice = {"trial": "made", "joint": "ankle", "side": None, "chosen": ""}
        choice |= {"amplitude_deg": amplitude, "duration_s": 10}
        plotted_numbers.fig4(path, tmp_path / "fit.csv", settings, choice, limits, tmp_path / "fig4.csv")
        shown = read_table(tmp_path / "fig4.csv")
        assert all(text.endswith(reason) and bool(text) == bool(reason) for text in shown["doubtful"])
        assert amplitude == pytest.approx(shown["theta_deg"].abs().max(), rel=0.02)
        assert 1 - (shown["torque"] - shown["torque_model"]).var() / shown["torque"].var() > 0.9995
        assert draw_fig4(shown).axes[1].lines[0].get_ydata().shape[0] > len(shown)  # broken between the frequencies
    small_rows, large_rows = thinned_amplitudes(record)
    assert not large[small_rows].any()
    assert large[large_rows].all()
    assert len(large_rows) == pytest.approx(len(small_rows), abs=3)


def test_phasors_keep_their_covariance_and_the_response_over_amplitudes_its_interval_and_its_doubts(tmp_path):
    condition = {"controller": pl.lit("compensated"), "K_d": pl.lit(200.0), "B_d": pl.lit(4.0)}
    table = phasor_table("made", phasors_of_record(stepped_sine(second_order, noise=0.5))).with_columns(**condition)
    assert set(table["interval_method"]) == {"cycles"}
    assert (table["torque_var_re"] > 100 * table["theta_var_re"]).all()
    np.testing.assert_allclose(table["torque_degrees_of_freedom"], 5)
    first = table.row(0, named=True)
    half = 2.5706 * first["Y_magnitude_se"]  # Student's quantile for the five degrees of freedom of six cycles
    assert first["Y_magnitude_high"] - first["Y_magnitude"] == pytest.approx(half, rel=1e-3)
    write_table(marked(table, Doubt(above={"amplitude_deg": 4}), "phasors"), tmp_path / "phasors.csv")
    summarise(tmp_path / "phasors.csv", tmp_path / "response.csv")
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
    assert mean["doubtful"] == "at 5.73 deg: amplitude_deg 5.73 is above 4"


def test_an_error_of_the_bench_s_stiffness_is_in_the_admittance_and_is_not_averaged_away():
    """theta = theta_bench - torque/k: an error of 1/k is an error of Y, real and the same at every amplitude."""
    bench = BenchStiffness(value="3000 N*m/rad", standard_error="300 N*m/rad")
    table = phasor_table("made", phasors_of_record(replace(stepped_sine(second_order, noise=0.01), bench=bench)))
    assert table["Y_se_bench"].unique().to_list() == pytest.approx([300 / 3000**2])
    assert (table["Y_var_re"] > (300 / 3000**2) ** 2).all()
    condition = {"controller": pl.lit("compensated"), "K_d": pl.lit(200.0), "B_d": pl.lit(4.0), "doubtful": pl.lit("")}
    mean = frequency_response_table(table.with_columns(**condition)).row(0, named=True)
    assert np.sqrt(mean["Y_var_re"]) == pytest.approx(300 / 3000**2, rel=0.01)


P = read_parameters(ROOT / "config/parameters/default.yaml")
GAINS = select_gains("compensated", 300.0, 5.0, P, PAPER_WEIGHT)
LIMITS = read_section(ROOT / "config/config.yaml", "doubtful", DoubtfulFits).of("impedance")
UNSATURATED, UNKNOWN = pl.lit(0).alias("saturated_samples"), DesiredImpedance("ours", None, None)


def judged(torque_of, protocol=FIVE, noise=0.01, seed=1):
    record = stepped_sine(torque_of, noise, protocol, seed)
    return marked(judged_impedance(record, UNSATURATED, None, UNKNOWN)[1], LIMITS, "impedance")


def late(torque, by):
    return shift(torque, by * RATE, mode="nearest")


def test_a_torque_in_time_is_not_doubtful_and_its_lag_counts_as_checked():
    table = judged(second_order)
    assert table["certain_lag_damping"].to_list() == table["lag_inertia_share"].to_list() == [0.0] * 3
    assert not table["doubtful"].str.contains("lag").any()
    assert "whether K is what the gains should give" in table["not_checked"][-1]
    assert "late" not in table["not_checked"][-1]


@pytest.mark.parametrize(("lag", "friction"), [(2e-3, 0.0), (5e-4, 0.0), (-5e-4, 0.0), (5e-4, 0.3), (-5e-4, 0.3)])
def test_a_lag_is_doubtful_with_its_sign_beside_friction_and_said_for_what_it_makes_of_b_and_i(lag, friction):
    """Without a parameter file. Shares are of first order."""

    def torque(m):
        return late(second_order(m) + friction * np.tanh(m.omega / 0.01), lag)

    *_, row = judged(torque).to_dicts()
    assert row["lag_s"] == pytest.approx(lag, abs=4 * row["lag_se_s"] + 5e-5)
    assert row["lag_inertia_share"] == pytest.approx(abs(4 * lag) / 0.05, rel=0.35)
    assert friction or row["lag_share"] == pytest.approx(abs(4 - row["B"]) / row["B"], rel=0.25)
    assert (row["frame_stiffness"] is None) == (lag < 0)
    for cause in ("lag_inertia_share", "is late", "`delay`"):
        assert cause in row["doubtful"]


@pytest.mark.parametrize("noise", [1e-3, 0.05, 0.5])
@pytest.mark.parametrize("known", [False, True])
def test_what_a_drivetrain_leaves_is_taken_for_a_lag_only_if_noise_hides_the_rest_and_gains_are_unknown(noise, known):
    """It would be one of 15 ms. With much noise nothing else is left of it: both are named then."""
    joint = joint_admittance(GAINS.K_1, GAINS.B_1, P, P.J_j)
    plain = stepped_sine(lambda m: 0 * m.theta, noise, FIVE)
    record = record_of_sines(plain.time, plain.theta, linear_torque(plain, joint) + plain.torque, FIVE)
    s = sums_of(record, IMPEDANCE, joint if known else None)
    found = lag_of(record, s, IMPEDANCE, causes(record, s, IMPEDANCE))
    assert (found is not None and found.found) == (noise > 0.01 and not known)


@pytest.mark.parametrize(
    ("lag", "seed"), [(-5e-3, 1), (4e-3, 1), (5e-3, 1), (10e-3, 1), (10e-3, 2), (10e-3, 9), (15e-3, 1)]
)
def test_a_lag_is_told_from_its_mirror_image_and_where_its_jerk_vanishes(lag, seed):
    """Beyond a fifth of a radian it may be a drivetrain. At 10 ms Eq. 15 leaves nothing, but an I of -0.015: by chance
    the image at 0 even leaves less, and the one of a possible joint counts."""
    *_, row = judged(lambda m: late(impedance_torque(300, 5, 0.02, m), lag), FIVE, 0.05, seed).to_dicts()
    assert row["lag_s"] == pytest.approx(lag, abs=4 * row["lag_se_s"])
    assert row["lag_se_s"] < 1.5e-4
    causes_of = {-5e-3: "late torque: ", 10e-3: "late torque or drivetrain: ", 15e-3: "late torque or drivetrain: "}
    assert row["doubtful"].startswith(causes_of.get(lag, "late torque or yielding bench: "))
    assert f"a torque that is late by {row['lag_s']:.3g} s" in row["explained_by"]


@pytest.mark.parametrize(("cutoff_hz", "before", "behind"), [(30, 0.05, 0.0), (20, 0.0, 0.005)])
def test_a_load_cell_behind_a_low_pass_is_late_and_not_its_encoder(cutoff_hz, before, behind):
    """The low-pass takes off noise by which noise is known. At 20 Hz a delay would have to be of the angle."""
    low_pass = butter(1, cutoff_hz, fs=RATE, output="sos")
    plain = stepped_sine(lambda m: impedance_torque(300, 5, 0.02, m), before, FIVE)
    torque = sosfilt(low_pass, plain.torque) + behind * np.random.default_rng(1).standard_normal(len(plain.time))
    record = record_of_sines(plain.time, plain.theta, torque, FIVE)
    s = sums_of(record, IMPEDANCE)
    found = lag_of(record, s, IMPEDANCE, causes(record, s, IMPEDANCE))
    assert found.found
    assert found.size > 1e-3


def test_a_lag_that_is_not_certain_but_may_change_the_inertia_by_a_tenth_is_said_not_to_be_checked():
    fit = {"K": 300.0, "B": 5.0, "I": 0.02}
    row = lag_row(Fault(3e-4, 2e-4, False, 7e-4), fit, None)
    assert row["certain_lag_damping"] == 0
    assert row["lag_share"] is row["lag_inertia_share"] is row["frame_stiffness"] is None
    assert lag_row(Fault(3e-5, 2e-5, False, 7e-5), fit, None)["lag_inertia_share"] == 0
    assert lag_row(Fault(1e-3, 1e-3, False, 2e-3), fit | {"B": -0.5}, None)["lag_inertia_share"] is None
    found = lag_row(Fault(-2e-3, 1e-5, True, 2e-3), fit, 4e3)
    shares = found["lag_share"], found["lag_inertia_share"], found["certain_lag_damping"], found["frame_stiffness"]
    assert shares == pytest.approx((0.12, (5 - 0.6) * 2e-3 / np.hypot(0.02, 5e-3), 0.6, 4e3))


def test_whether_the_torque_is_late_is_said_in_the_rows_that_cannot_tell_and_in_no_other():
    told = {"lag_inertia_share": 0.13, "K_drift": 0.0, "clock_drift_ppm": None}
    for p in (None, P):
        reasons = [left_unchecked(told | {"lag_inertia_share": share}, p, UNKNOWN, False) for share in (0.13, None)]
        assert ["late" in reason for reason in reasons] == [False, True]
        assert all("whether K is what the gains should give" in reason for reason in reasons)
    known = DesiredImpedance("compensated", 300.0, 5.0)
    assert left_unchecked(told, P, known, False) is None
    late = left_unchecked(told | {"lag_inertia_share": None}, P, known, False)
    assert late.startswith("whether the torque is late: a delay that matters would look like noise")
