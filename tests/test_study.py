"""The study of the estimators: small, seeded, from the simulator to the figure, with nothing on disk between."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
import yaml
from conftest import ROOT

from osl_analysis.bench.settings import ActuatorAnalysis, DynamometerAnalysis
from osl_analysis.campaign.configuration import StudySettings
from osl_analysis.commands.study import performance, run_batch, study_inputs, study_page, summarise_study
from osl_analysis.errors import InputError
from osl_analysis.study import BENCH_EXPERIMENTS, REPEATED, WALKING_EXPERIMENTS, study_batches
from osl_analysis.study import walking as study_of_walking
from osl_analysis.study.bench import regression_bound, studied, study_rows
from osl_analysis.table import read_table
from osl_analysis.walking.settings import WalkingAnalysis

pytestmark = pytest.mark.usefixtures("in_root")
CONFIG = yaml.safe_load((ROOT / "config/config.yaml").read_text())
ACTUATOR = ActuatorAnalysis.model_validate(CONFIG["actuator"])
SMALL = {"cycles": 8, "crossings": 3, "trials": 8, "campaigns": 1}


def choices(**changes):
    study = StudySettings.model_validate(CONFIG["study"] | SMALL | changes)
    dynamometer = DynamometerAnalysis.model_validate(CONFIG["dynamometer"] | {"frequencies_hz": [2, 4]})
    return study, dynamometer, ACTUATOR, WalkingAnalysis.model_validate(CONFIG["walking"]), ROOT / "config/sources"


def bench(experiment):
    return studied(experiment, study_inputs(*choices()))


def rows(experiment, trials):
    found = study_rows(bench(experiment), [f"{experiment}_{i}" for i in range(trials)])
    return pl.DataFrame(found, infer_schema_length=None).with_columns(error=pl.col("value") - pl.col("truth"))


def covered(table):
    return float(((table["low"] <= table["truth"]) & (table["truth"] <= table["high"])).mean())


def ratio(table, size):
    """Root mean square of the error over that of a stated size, over quantities with units of their own."""
    each = [(one["error"] ** 2).mean() / (one[size] ** 2).mean() for _, one in table.group_by("quantity")]
    return float(np.sqrt(np.mean(each)))


@pytest.mark.parametrize(("experiment", "trials", "methods", "near", "coverage"), [
    ("belt", 40, {"units + drift"}, 0.335, 0.104),
    ("actuator", 12, {"units"}, 0.27, 0.084),  # of five nearly independent estimates
    ("frequency response", 20, {"cycles"}, 0.335, 0.076),  # of four; the last cycle at a frequency is the next one's
])  # fmt: skip
def test_estimates_are_as_precise_as_they_say_and_as_the_noise_allows(experiment, trials, methods, near, coverage):
    """Seeded trials within three Monte Carlo errors of a ratio and of a coverage."""
    table = rows(experiment, trials)
    assert set(table["interval_method"]) == methods
    for size in ("bound", "se"):
        assert ratio(table, size) == pytest.approx(1, abs=near), size
        for _, group in table.group_by("quantity"):
            assert ratio(group, size) == pytest.approx(1, abs=3 / np.sqrt(2 * trials)), size
    assert (covered(table), len(table["value"].unique())) == (pytest.approx(0.95, abs=coverage), len(table))


def test_the_mean_of_repeated_belts_scatters_as_belts_do_and_its_bound_as_one_over_the_root_of_their_number():
    table = rows("repeated belt", 4)
    assert table["bound"][0] == pytest.approx(0.01 * 685.6 / np.sqrt(10), rel=1e-3)
    assert ratio(table, "bound") == pytest.approx(1, abs=3 / np.sqrt(8))
    assert (set(table["truth"]), set(table["interval_method"])) == ({685.6}, {"Student"})
    single, mean = bench("transmission").bounds(), bench("repeated transmission").bounds()
    assert mean == pytest.approx({name: single[name] / np.sqrt(5) for name in ("B_j", "J_j")})


def test_the_page_has_a_line_for_each_interval_and_names_what_covers_too_little():
    """Coverage of 80 % +- 2 is named, and one of 99 % +- 0.5; 90 % +- 2 may be chance."""
    row = {"estimator": "filtered", "interval_method": "cycles", "n": 400, "bias": 0.1, "bias_mc": 0.05}
    row |= {"rmse_over_bound": 1.01, "se_over_sd": None, "coverage_mc": 0.02}
    table = pl.DataFrame(
        [row | {"experiment": "belt", "quantity": "K_s", "coverage": 0.8},
         row | {"experiment": "toy", "quantity": "K", "coverage": 0.9},
         row | {"experiment": "toy", "quantity": "B", "coverage": 0.95, "bias_mc": 0.04},
         row | {"experiment": "toy", "quantity": "I", "coverage": 0.99, "coverage_mc": 0.005, "estimator": "sinusoid"}]
    )  # fmt: skip
    text = study_page(table)
    assert "| toy | filtered, cycles | K, B | 400 | 0.10, 0.10 ± 0.05 | 1.01, 1.01 | –, – | 90.0, 95.0 ± 2.0 |" in text
    assert "4 coverages with a mean of 91.0 %; 1 lie between 93 and 97 %." in text
    assert "Monte Carlo errors: belt, K_s: 80.0 %; toy, I: 99.0 %." in text


def test_each_recorded_campaign_draws_anew_and_a_linear_drivetrain_has_no_friction(monkeypatch, tmp_path):
    seeds, effects = [], bench("linear drivetrain").inputs.simulation.effects
    assert (effects.friction.value, effects.belt_hysteresis.value) == (0, 0)
    monkeypatch.setattr(study_of_walking, "recording", lambda own, *_: seeds.append(own.settings.seed))
    monkeypatch.setattr(study_of_walking, "campaign_rows", lambda *_: [])
    assert batch("walking recorded", 0, 3, tmp_path / "w.csv").rows() == [("walking recorded", "simulated")]
    assert len(set(seeds)) == 3


def test_an_actuator_without_a_schedule_is_refused():
    made = study_inputs(*choices())
    without = replace(made, simulation=made.simulation.model_copy(update={"actuator": None}))
    with pytest.raises(InputError, match="no 'actuator' schedule"):
        studied("actuator", without)
    with pytest.raises(InputError, match=r"default\.yaml: names no 'walking' file, which the study of walking needs"):
        next(study_of_walking.walking_rows(replace(made, gait=None), [0], recorded=False))


def batch(experiment, first, count, output, **changes):
    run_batch(experiment, first, count, *choices(**changes), output)
    return read_table(output)


def test_batches_become_a_table(tmp_path):
    asked = [("belt", 0, 2), ("belt", 2, 2), ("walking", 0, 1), ("walking", 1, 1), ("actuator", 0, 2)]
    files = [tmp_path / f"{name}_{first}.csv" for name, first, _ in asked]
    found = [batch(*numbers, file)["value"] for numbers, file in zip(asked, files, strict=True)]
    assert [one.n_unique() for one in (pl.concat(found[:2]), pl.concat(found[2:4]), found[4])] == [4, 18, 10]
    assert batch("belt", 0, 2, tmp_path / "other.csv", seed=7)["value"][0] not in found[0]
    summarise_study(files, tmp_path / "study.csv")
    table = read_table(tmp_path / "study.csv")
    assert table.filter(pl.col("experiment") == "belt").select("n", "data").row(0) == (4, "simulated")
    assert table.filter(pl.col("experiment") == "walking")["n"].to_list() == [2] * 9


@pytest.mark.parametrize("experiment", WALKING_EXPERIMENTS)
def test_walking_is_measured_against_the_perturbation_alone(experiment, tmp_path):
    """K rendered is 334 of the commanded 340, and the filtered estimate of it within 1 N*m/rad: a third-order leg."""
    K = batch(experiment, 7, 1, tmp_path / "k.csv", crossings=4).filter(pl.col("quantity") == "K")
    assert K["estimator"].to_list() == ["single perturbation", "mean of perturbations", "ensemble"]
    assert K["truth"].to_list() == pytest.approx([334, 334, 334], abs=1.5)
    assert K["model_error"].is_between(0.3, 1).all()  # the truth less what the leg renders
    assert ((K["value"] - K["truth"]).abs() < 5 * K["se"]).all()


def test_crossings_that_are_refused_are_excluded_and_all_of_them_is_an_error_that_says_why():
    def odd(name):
        if int(name) % 2:
            return name
        raise InputError(f"crossing {name} is refused")

    assert study_of_walking.usable(odd, "123") == ["1", "3"]
    with pytest.raises(InputError, match="crossing 4 is refused"):
        study_of_walking.usable(odd, "24")


@pytest.mark.parametrize("recorder", ["jitter of 50 us", "four decimals at 300 Hz", "333 Hz and 1 kHz", "14 bits"])
def test_intervals_hold_the_truth_of_an_exact_joint_as_recorders_write_it(recorder):
    """60 seeded estimates: three Monte Carlo errors of a coverage are 8.4 %."""
    table = rows(f"second order, {recorder}", 20)
    assert set(table.select("estimator", "interval_method").rows()) == {("filtered", "repeats")}
    assert covered(table) > 0.95 - 0.084
    assert table.with_columns(share=(pl.col("error") / pl.col("truth")).abs())["share"].max() < 0.03


def test_rounding_of_the_load_cell_is_noise_of_a_step_over_the_root_of_twelve_in_the_bounds():
    of, found = bench("transmission"), []
    effects = (simulation := of.inputs.simulation).effects
    for step in (0.01, 0.2):
        rounding = effects.load_cell_quantisation.model_copy(update={"size": step})
        changed = effects.model_copy(update={"load_cell_quantisation": rounding})
        inputs = replace(of.inputs, simulation=simulation.model_copy(update={"effects": changed}))
        found.append(np.array([*replace(of, inputs=inputs).bounds().values()]))
    before, after = np.hypot(effects.load_cell_noise.value, np.array([0.01, 0.2]) / 12**0.5)
    assert found[1] / found[0] == pytest.approx(after / before, 1e-3)


def test_bound_of_a_sinusoid_is_the_published_one():
    """Rife and Boorstyn, IEEE Trans. Inf. Theory 20, 1974: var(A) >= 2 s^2/N and var(phase) >= 2 s^2/(A^2 N)."""
    N, noise, phase = 1000, 0.3, 2 * np.pi * np.arange(1000) / 50
    bound = regression_bound({"cos": np.cos(phase), "sin": np.sin(phase), "offset": np.ones(N)}, noise)
    expected = {"cos": np.sqrt(2 / N), "sin": np.sqrt(2 / N), "offset": 1 / np.sqrt(N)}
    assert bound == pytest.approx({name: noise * each for name, each in expected.items()})


def test_the_study_measures_bias_in_standard_deviations_and_coverage_as_a_share():
    found = performance(np.array([1.0, 2.0, 3.0]), np.full(3, 2.0), np.array([True, False, False]), np.full(3, 2.0))
    expected = {"bias": 2.0, "coverage": 1 / 3, "n": 3, "rmse": np.sqrt(14 / 3), "rmse_over_bound": np.sqrt(14 / 12)}
    expected |= {"bias_mc": 1 / np.sqrt(3), "se_over_sd": 2.0, "coverage_mc": np.sqrt(3 / 7 * 4 / 7 / 7)}
    expected |= {"rmse_over_bound_mc": np.sqrt(14 / 12) * np.sqrt(0.5 / 12)}  # of a kurtosis of 1.5
    assert {name: found[name] for name in expected} == pytest.approx(expected)


@pytest.mark.parametrize("trials", [(500, 200, 80), (10_000, 2000, 1000), (1, 1, 1), (0, 0, 0)])
def test_every_trial_is_in_one_job_and_there_are_fewer_than_a_hundred_with_table_page_and_figure(trials):
    bench, campaigns, recorded = trials
    asked = dict.fromkeys(BENCH_EXPERIMENTS, (bench, 50)) | {name: (campaigns, n) for name, n in REPEATED.items()}
    asked |= {"walking": (campaigns, 10), "walking recorded": (recorded, 5)}
    found = study_batches(asked)
    assert len(found) < 97
    for name, (number, _) in asked.items():
        assert [k for one, first, n in found if one == name for k in range(first, first + n)] == list(range(number))
