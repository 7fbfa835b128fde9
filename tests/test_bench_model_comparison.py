"""The model that made the data is found: on data held out, and by BIC where its terms are not needed."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from bench_synthetic import sine_settings
from conftest import ROOT, multisine
from scipy.stats import t as student

from osl_analysis.bench.impedance import DesiredImpedance
from osl_analysis.bench.model_comparison import (
    BELT_MODELS,
    TRANSMISSION_MODELS,
    DrivetrainTrial,
    fold_of,
    linear_rivals,
)
from osl_analysis.bench.record import sine_record
from osl_analysis.commands.bench import (
    compare_belt_models,
    compare_impedance_models,
    compare_transmission_models,
    summarise,
)
from osl_analysis.commands.simulate import row_of_trial
from osl_analysis.errors import InputError
from osl_analysis.model.compensator import Weight, select_gains
from osl_analysis.model.parameters import read_parameters
from osl_analysis.signals import LowPass, filtered_motion
from osl_analysis.simulator.bench import simulate_bench_trial
from osl_analysis.simulator.settings import SimulationSettings, SteppedSineSchedule
from osl_analysis.stats.repeats import score_models
from osl_analysis.table import write_table
from osl_analysis.trial import Trial, read_trial, write_trial
from osl_analysis.yaml_settings import read_yaml

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
    output, condition = folder / "impedance.csv", DesiredImpedance("uncompensated", 300.0, 5.0)
    compare_impedance_models(path, DEFAULT_FILE, condition, Weight(cutoff_hz=1, order=3), ANALYSIS, 0.05, output)
    table = pl.read_csv(output)
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
