"""The study of the estimators: small, seeded, from the simulator to the figure, with nothing on disk between."""

import numpy as np
import polars as pl
import pytest
import yaml
from conftest import ROOT

from osl_analysis.commands.figure import draw_figure
from osl_analysis.commands.validation import bench_rows, run_batch, summarise
from osl_analysis.commands.validation_bench import EXPERIMENTS
from osl_analysis.config import DynamometerAnalysis, ValidationStudy
from osl_analysis.parameters import read_parameters
from osl_analysis.signals import LowPass
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.table_file import read_table
from osl_analysis.validation import read_yaml
from osl_analysis.walking.settings import WalkingAnalysis

CONFIG = yaml.safe_load((ROOT / "config/config.yaml").read_text())
SMALL = {"cycles": 8, "crossings": 3, "trials": 8, "campaigns": 1}


@pytest.fixture(autouse=True)
def _repository(monkeypatch):
    monkeypatch.chdir(ROOT)


def choices(**changes):
    study = ValidationStudy.model_validate(CONFIG["validation"] | SMALL | changes)
    dynamometer = DynamometerAnalysis.model_validate(CONFIG["dynamometer"] | {"frequencies_hz": [2, 4]})
    return study, dynamometer, WalkingAnalysis.model_validate(CONFIG["walking"])


def bench(experiment):
    study, dynamometer, _ = choices()
    settings = read_yaml(study.simulation, SimulationSettings)
    return EXPERIMENTS[experiment](study, settings, read_parameters(settings.parameters), dynamometer)


def rows(experiment, trials):
    table = pl.DataFrame(
        bench_rows(bench(experiment), [f"{experiment}_{i}" for i in range(trials)], LowPass(15)),
        infer_schema_length=None,
    )
    return table.with_columns(error=pl.col("value") - pl.col("truth"))


def test_every_trial_has_noise_of_its_own_and_the_same_noise_again():
    first, again, other = (bench("second order").record(name) for name in ("a", "a", "b"))
    np.testing.assert_array_equal(first.torque, again.torque)
    assert np.std(first.torque - other.torque) == pytest.approx(0.05 * np.sqrt(2), rel=0.05)
    assert np.ptp(bench("second order").record("x", ideal=True).torque - bench("second order").response.torque) == 0


def test_the_default_estimator_is_near_the_bound_and_hac_is_far_too_wide_where_friction_repeats():
    """40 seeded trials: a ratio of 1 +- 3 Monte Carlo errors of 1/sqrt(80)."""
    table = rows("drivetrain", 40).filter(pl.col("estimator") == "filtered", pl.col("quantity") == "B")
    cycles = table.filter(pl.col("interval_method") == "cycles")
    rms = float(np.sqrt((cycles["error"] ** 2).mean()))
    assert rms / cycles["bound"][0] == pytest.approx(1, abs=0.34)
    assert cycles["se"].mean() == pytest.approx(rms, rel=0.34)
    assert table.filter(pl.col("interval_method") == "HAC")["se"].mean() > 20 * rms


def test_the_truth_of_a_known_joint_is_what_made_the_torque():
    table = rows("second order", 2).filter(pl.col("estimator") == "filtered")
    assert dict(table.select("quantity", "truth").unique().rows()) == {"K": 300, "B": 5, "I": 0.02}
    errors = table.with_columns(pl.col("error") / pl.col("bound"))["error"]
    assert errors.abs().max() < 5


@pytest.mark.parametrize(("experiment", "names"), [("transmission", {"B_j", "J_j"}), ("belt", {"K_s"})])
def test_the_other_bench_experiments_are_near_their_truth_too(experiment, names):
    table = rows(experiment, 3)
    assert set(table["quantity"]) == names
    assert (table["error"].abs() / table["bound"]).max() < 5


def test_batches_become_a_table_and_a_figure(tmp_path):
    study, dynamometer, walking = choices()
    files = [tmp_path / f"{name}.csv" for name in ("belt", "belt_more", "walking")]
    run_batch("belt", 0, 2, study, dynamometer, walking, files[0])
    run_batch("belt", 2, 2, study, dynamometer, walking, files[1])
    run_batch("walking", 0, 1, study, dynamometer, walking, files[2])
    assert len(read_table(files[1])["value"].unique()) == 2
    run_batch("walking", 1, 1, study, dynamometer, walking, tmp_path / "walking_more.csv")
    summarise([*files, tmp_path / "walking_more.csv"], tmp_path / "validation.csv")
    table = read_table(tmp_path / "validation.csv")
    assert table.filter(pl.col("experiment") == "belt")["n"].to_list() == [4]
    assert table.filter(pl.col("experiment") == "walking")["n"].to_list() == [2] * 6
    draw_figure("validation", tmp_path / "validation.csv", [tmp_path / "validation.png"])
    assert (tmp_path / "validation.png").stat().st_size > 10_000


def test_walking_is_measured_against_what_the_leg_rendered(tmp_path):
    study, dynamometer, walking = choices(crossings=4)
    run_batch("walking", 7, 1, study, dynamometer, walking, tmp_path / "walking.csv")
    K = read_table(tmp_path / "walking.csv").filter(pl.col("quantity") == "K")
    assert K["truth"].to_list() == pytest.approx([340, 340], rel=0.05)
    assert (K["value"] - K["truth"]).abs().max() < 5 * K["se"].max()
