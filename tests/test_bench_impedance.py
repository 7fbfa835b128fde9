"""Rendered impedance of a stepped sine, its phasors and lag; and rival models: the one that made the data is found."""

from dataclasses import replace

import bench_synthetic
import numpy as np
import polars as pl
import pytest
from bench_synthetic import (
    FIVE,
    PROTOCOL,
    RATE,
    second_order,
    sine_settings,
    stepped_sine,
)
from conftest import ROOT, marked, multisine
from scipy.ndimage import shift
from scipy.stats import t as student

from osl_analysis.bench.analysis import analysed
from osl_analysis.bench.effects import IMPEDANCE, Fault, plain_sums
from osl_analysis.bench.impedance import DesiredImpedance, judged_impedance, lag_row
from osl_analysis.bench.model_comparison import (
    BELT_MODELS,
    TRANSMISSION_MODELS,
    DrivetrainTrial,
    fold_of,
    linear_rivals,
    thinned_amplitudes,
)
from osl_analysis.bench.phasors import frequency_response_table, phasor_table, phasors_of_record
from osl_analysis.bench.record import record_of_trial, sine_record
from osl_analysis.bench.settings import BenchStiffness, ModelComparison
from osl_analysis.campaign.configuration import read_section
from osl_analysis.commands import figure as plotted_numbers
from osl_analysis.commands.bench import (
    compare_belt_models,
    compare_drivetrain_models,
    compare_transmission_models,
    estimates_text,
    fit_impedance_trial,
    summarise,
)
from osl_analysis.commands.simulate import row_of_trial
from osl_analysis.errors import InputError
from osl_analysis.figures.impedance import draw_fig4
from osl_analysis.judge.judging import LATENESS, unchecked_in
from osl_analysis.judge.limits import DoubtfulFits, Limits
from osl_analysis.model.compensator import PAPER_WEIGHT, Weight, select_gains
from osl_analysis.model.parameters import read_parameters
from osl_analysis.signals import LowPass, filtered_motion
from osl_analysis.simulator.bench import simulate_bench_trial
from osl_analysis.simulator.settings import SimulationSettings, SteppedSineSchedule
from osl_analysis.spectral.stepped_sine import unit_sines
from osl_analysis.stats.repeats import score_models
from osl_analysis.table import read_table, write_table
from osl_analysis.trial import Trial, read_trial, write_trial
from osl_analysis.yaml_settings import read_yaml


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
    table, limits = judged_impedance(record, UNSATURATED, None, None)[1], Limits(below={"K": 150})
    assert table["K"].to_list()[:2] == pytest.approx([100, 200], rel=1e-3)
    write_table(table, tmp_path / "fit.csv")
    for amplitude, cause in zip(degrees, ("impossible estimate", ""), strict=True):
        choice = {"trial": "made", "joint": "ankle", "side": None, "chosen": ""}
        choice |= {"amplitude_deg": amplitude, "duration_s": 10}
        plotted_numbers.fig4(path, tmp_path / "fit.csv", settings, choice, limits, tmp_path / "fig4.csv")
        shown = read_table(tmp_path / "fig4.csv")
        assert set(shown["doubtful"].fill_null("")) == {cause}
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
    write_table(marked(table, Limits(above={"amplitude_deg": 4}), "phasors"), tmp_path / "phasors.csv")
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
    assert mean["doubtful"] == "amplitude_deg"


def test_an_error_of_the_bench_s_stiffness_is_in_the_admittance_and_is_not_averaged_away():
    """theta = theta_bench - torque/k: an error of 1/k is an error of Y, real and the same at every amplitude."""
    bench = BenchStiffness(value="3000 N*m/rad", standard_error="300 N*m/rad")
    stated = sine_settings([2], [1]).model_copy(update={"bench_stiffness": bench})
    record = replace(stepped_sine(second_order, noise=0.01), settings=stated)
    table = phasor_table("made", phasors_of_record(record))
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
    assert table["path_shift"].to_list() == [0.0] * 3
    assert table["doubtful"].to_list() == [""] * 3
    assert LATENESS not in table["not_checked"][-1]


def test_a_lag_by_the_belt_makes_shares_of_b_and_i_if_it_is_certain():
    fit = {"K": 300.0, "B": 5.0, "I": 0.02}
    row = lag_row(Fault(3e-4, 2e-4, False, 7e-4), fit)
    assert row["certain_lag_damping"] == row["lag_share"] == row["lag_inertia_share"] == 0
    found = lag_row(Fault(-2e-3, 1e-5, True, 2e-3), fit)
    shares = found["lag_share"], found["lag_inertia_share"], found["certain_lag_damping"]
    assert shares == pytest.approx((0.12, (5 - 0.6) * 2e-3 / np.hypot(0.02, 5e-3), 0.6))


def test_whether_the_torque_is_late_is_said_in_the_rows_that_cannot_tell_and_in_no_other():
    told = {"path_shift": 0.0, "lag_s": None, "K_drift": 0.0, "clock_drift_ppm": None, "controller": "compensated"}
    told |= {"K_over_K_s": 0.4, "K_predicted": 300.0}
    gains = ["whether K is what the gains should give", "whether the bench's frame yields"]
    for changes, expected in (
        ({}, []), ({"path_shift": None}, [LATENESS]), ({"K_predicted": None}, gains),
        ({"K_predicted": None, "path_shift": None}, [*gains, LATENESS]), ({"path_shift": None, "lag_s": 0.0}, []),
        ({"K_over_K_s": None}, []), ({"K_over_K_s": None, "K_predicted": None}, []),
        ({"band_high_hz": 16.0, "cutoff_hz": 15.0}, ["what moves faster than the cut-off"]),
        ({"K_predicted": None, "K_low": 299.9, "K_high": 300.1}, [*gains, "whether a fixture's weight is in K"]),
    ):  # fmt: skip
        assert [one.cause for one in unchecked_in("impedance", told | changes)] == expected


TINY, DEFAULT_FILE = ROOT / "tests/tiny_simulation.yaml", ROOT / "config/parameters/default.yaml"
QUADRATIC_FILE = ROOT / "config/parameters/osl-v2-published.yaml"
DEFAULT, LOW_PASS, ANALYSIS = read_parameters(DEFAULT_FILE), LowPass(15), sine_settings((2, 4, 6), (2, 5), 3, 0)


def settings(*off, amplitudes_deg=(4,)):
    found = read_yaml(TINY, SimulationSettings)
    own = {"amplitudes_deg": amplitudes_deg, "rest_s": 0.5, "lead_s": 0.5}
    protocol = SteppedSineSchedule(frequencies_hz=(2, 5), cycles=3, **own)
    effects = found.effects.without(*off) if off else found.effects
    wanted = found.experiments.model_copy(update={"belt": 3})
    return found.model_copy(update={"effects": effects, "protocol": protocol, "experiments": wanted})


def written(folder, name, found, p, as_name=None):
    """The path of a simulated trial of a device."""
    log, _ = simulate_bench_trial(row_of_trial(found, TINY, name), found, p)
    path = folder / f"{as_name or name}.parquet"
    columns = {"time": log["time"], "theta": log["joint_angle"], "theta_m": log["actuator_angle"]}
    write_trial(Trial(path.stem, pl.DataFrame({**columns, "torque": -log["load_cell_torque"]})), path)
    return path


BELTS = {
    "M1": (DEFAULT_FILE, ("belt_hysteresis",)), "M2": (QUADRATIC_FILE, ("belt_hysteresis",)), "M3": (DEFAULT_FILE, ()),
    "M4": (QUADRATIC_FILE, ()),
}  # fmt: skip


def scored(folds, k, models):
    """Rows of the models on trial k, by model."""
    scores = score_models(folds[k].torque, linear_rivals(folds, [folds[k]], models))
    return {row["model"]: row for row in scores.to_dicts()}


@pytest.mark.parametrize("true", BELT_MODELS)
def test_the_belt_that_was_simulated_is_ranked_first(true, tmp_path):
    """By BIC over the trials it is the first. On each held-out repeat, every model without one of its terms is worse.
    With a single trial of 40 effective samples, BIC accepts a needless term if chi2(1) > ln 40: one time in twenty.
    What damps the joint (B_j) differs between the branches too, so it is switched off where there is no hysteresis."""
    device, off = BELTS[true]
    p = read_parameters(device)
    p = p if "T_h" in BELT_MODELS[true] else replace(p, B_j=0.0)
    found = settings("load_cell_drift", *off).model_copy(update={"seed": 3})
    belts = [written(tmp_path, f"belt_0{i}", found, p) for i in (1, 2, 3)]
    compare_belt_models(belts, device, ANALYSIS, tmp_path / "belt.csv")
    table = pl.read_csv(tmp_path / "belt.csv")
    assert table["trial"].to_list() == [f"belt_0{i}" for i in (1, 2, 3) for _ in BELT_MODELS]
    trials = [{row["model"]: row for row in one.to_dicts()} for one in table.partition_by("trial")]
    total = {model: sum(scores[model]["BIC"] for scores in trials) for model in BELT_MODELS}
    assert min(total, key=total.__getitem__) == true
    for model, terms in BELT_MODELS.items():
        lacking = not set(BELT_MODELS[true]) <= set(terms)
        assert lacking == (total[model] > total[true] + 60)
        for scores in trials:
            worse = scores[true]["VAF_held_out"] - scores[model]["VAF_held_out"]
            assert worse > 0.002 if lacking else abs(worse) < 0.001


@pytest.mark.parametrize(("T_C", "best"), [(0.05, "M2"), (0.0, "M1")])
def test_coulomb_friction_in_the_joint_is_preferred_where_it_is_and_not_where_it_is_not(T_C, best):
    """Motor detached, by hand: B_j 0.45, J_j 0.005, Coulomb friction, noise, an offset of each trial's own."""
    rng, t, folds = np.random.default_rng(11), np.arange(10_000) / 1000, []
    motion, inner = multisine(1.0, 3.0, 5.0, amplitude=0.05, rate=1000), slice(300, -300)
    for i in range(3):
        torque = 0.45 * motion.omega + 0.005 * motion.alpha + T_C * np.tanh(motion.omega / 0.05) + i + 0.01 * t * i
        measured, filtered = filtered_motion(t, motion.theta, torque + rng.normal(0, 0.05, len(t)), LOW_PASS)
        sign = LOW_PASS(np.tanh(measured.omega / 0.05), 1000.0)
        columns = {"B_j": measured.omega, "J_j": measured.alpha, "T_C": sign}
        folds.append(fold_of(filtered[inner], {name: column[inner] for name, column in columns.items()}))
    for k in range(3):
        scores = scored(folds, k, TRANSMISSION_MODELS)
        assert scores[best]["rank"] == 1
        gain = scores["M2"]["VAF_held_out"] - scores["M1"]["VAF_held_out"]
        assert gain > 0.05 if T_C else gain < 0.001


UNCOMPENSATED = "impedance_K300_B5.0_uncompensated"


def rivals_of_eq_15(folder, *off):
    """The table of a trial at 2, 4 and 6 deg, without some effects of the simulator, by model."""
    path = written(folder, UNCOMPENSATED, settings(*off, amplitudes_deg=(2, 4, 6)), DEFAULT)
    trial, condition = read_trial(path), DesiredImpedance("uncompensated", 300.0, 5.0)
    weight, kept, compared = Weight(cutoff_hz=1, order=3), folder / f"{trial.name}.parquet", folder / "compared.csv"
    models = ModelComparison(sign_width=0.05)
    write_table(fit_impedance_trial(trial, DEFAULT_FILE, condition, weight, models, ANALYSIS)["record"], kept)
    compare_drivetrain_models(kept, DEFAULT_FILE, condition, weight, 0.05, ANALYSIS, compared)
    table = read_table(compared)
    assert (table["experiment"].to_list(), table["model"].to_list()) == (["impedance"] * 4, ["M1", "M2", "M3", "M4"])
    return {row["model"]: row for row in table.to_dicts()}


def test_the_drivetrain_with_its_friction_predicts_another_amplitude_and_eq_15_does_not(tmp_path):
    scores = rivals_of_eq_15(tmp_path)
    assert set(sorted(scores, key=lambda model: -scores[model]["VAF_held_out"])[:2]) == {"M3", "M4"}
    assert scores["M3"]["VAF_held_out"] > 99.8
    assert scores["M1"]["VAF_held_out"] < 99
    assert {scores["M3"]["rank"], scores["M4"]["rank"]} == {1, 2}
    assert [scores[model]["parameters"] for model in ("M1", "M2", "M3", "M4")] == [3, 0, 0, 3]


def test_without_friction_the_linear_drivetrain_wins_with_no_parameter_fitted(tmp_path):
    scores = rivals_of_eq_15(tmp_path, "friction", "control_delay", "velocity_filter", "belt_hysteresis")
    assert scores["M2"]["rank"] == 1
    assert scores["M2"]["VAF_held_out"] > 99.99
    assert scores["M3"]["VAF_held_out"] < 99


def test_a_loop_that_would_be_unstable_is_refused_by_name(tmp_path):
    path = written(tmp_path, UNCOMPENSATED, settings(amplitudes_deg=(2, 4, 6)), DEFAULT)
    record = sine_record(read_trial(path), ANALYSIS)
    wild = replace(select_gains("uncompensated", 300.0, 5.0, DEFAULT), B_1=-50.0)
    with pytest.raises(InputError, match="grows without bounds for K_1 = "):
        DrivetrainTrial(record, [], wild, DEFAULT, 0.05).predicted(np.array([1.0, 1.0, 0.0]))


def test_vaf_on_data_held_out_is_that_of_the_other_trials_fit():
    """Trials of gain 1, 1 and 1.3: for the third the fit says 1, so 0.3 of 1.3 is left, VAF 100 (1 - (3/13)^2)."""
    x = np.sin(np.arange(600) / 7)
    folds = [fold_of(gain * x, {"B_j": x}) for gain in (1.0, 1.0, 1.3)]
    third = scored(folds, 2, {"M1": ("B_j",)})["M1"]
    assert third["VAF_held_out"] == pytest.approx(100 * (1 - (3 / 13) ** 2), abs=1e-6)
    assert third["VAF"] == pytest.approx(100)
    alone = scored(folds[:1], 0, {"M1": ("B_j",)})["M1"]
    assert np.isnan(alone["VAF_held_out"])
    assert (alone["rank"], alone["VAF"]) == (1, pytest.approx(100))


def test_the_transmission_that_was_simulated_has_no_friction_of_its_own(tmp_path):
    found = settings(amplitudes_deg=(2, 4, 6))
    paths = [written(tmp_path, "transmission_1", found, DEFAULT, f"transmission_{i}") for i in "12"]
    compare_transmission_models(paths, ANALYSIS, 0.05, tmp_path / "transmission.csv")
    table = pl.read_csv(tmp_path / "transmission.csv")
    assert table.filter(pl.col("rank") == 1)["terms"].to_list() == ["B_j + J_j"] * 2
    assert table["VAF_held_out"].min() > 99


def test_the_summary_has_a_row_per_model_with_its_difference_to_the_drafts(tmp_path):
    """Three belts, of which a term takes 0.04, 0.03 and 0.05 of the variance; two trials of each controller."""
    scores = []
    for trial, vaf, gain in (("belt_1", 99.90, 0.04), ("belt_2", 99.92, 0.03), ("belt_3", 99.91, 0.05)):
        models = ("M1", "K_s", 1, vaf, -100.0), ("M2", "K_s + T_h", 2, vaf + gain, -300.0)
        scores += [("belt", trial, None, *model) for model in models]
    for controller, vaf, k in (*(("compensated", 99.0, k) for k in (1, 2)), *(("other", 90.0, k) for k in (1, 2))):
        models = ("M1", "K + B + I", 3, vaf, 10.0 * k), ("M2", "Eq. 9", 0, vaf, 10.0 * k + 4)
        scores += [("impedance", f"{controller}_{k}", controller, *model) for model in models]
    names = ("experiment", "trial", "controller", "model", "terms", "parameters", "VAF_held_out", "BIC")
    table = pl.DataFrame(scores, schema=names, orient="row", infer_schema_length=None)
    write_table(table, tmp_path / "model_comparison.csv")
    summarise(tmp_path / "model_comparison.csv", tmp_path / "summary.csv")
    rows = pl.read_csv(tmp_path / "summary.csv").to_dicts()
    named = [(r["experiment"], r["controller"], r["trials"]) for r in rows]
    assert named[::2] == named[1::2] == [("belt", None, 3), ("impedance", "compensated", 2), ("impedance", "other", 2)]
    assert [r["model"] for r in rows] == ["M1", "M2"] * 3
    linear, hysteresis, *_ = rows
    half = student.ppf(0.975, 2) * np.sqrt(1e-4 / 3 + 1e-4 / 2)
    assert (hysteresis["VAF_gain"], hysteresis["VAF_gain_high"] - 0.04) == (pytest.approx(0.04), pytest.approx(half))
    assert hysteresis["unexplained_ratio"] == pytest.approx(np.prod([0.06 / 0.10, 0.05 / 0.08, 0.04 / 0.09]) ** (1 / 3))
    assert (linear["VAF_gain"], linear["unexplained_ratio"]) == (0, 1)
    assert (linear["VAF_behind"], hysteresis["BIC_change"], linear["BIC_behind"]) == (pytest.approx(0.04), -200, 200)
    assert [(r["by_VAF"], r["by_BIC"]) for r in rows[:2]] == [("worse", "worse"), ("preferred", "preferred")]
    assert [(r["by_VAF"], r["by_BIC"]) for r in rows[2:4]] == [("preferred", "preferred"), ("tied", "worse")]
