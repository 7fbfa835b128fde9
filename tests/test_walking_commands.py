"""From recorded C3D files to the walking tables: what the simulated leg rendered is what comes out."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from conftest import ROOT
from walking_setup import Setup, load_setup
from walking_synthetic import settings

from osl_analysis.commands.calibration import calibrate, identify_plate
from osl_analysis.commands.calibration_file import read_calibration, read_plate
from osl_analysis.commands.crossing import analyse
from osl_analysis.commands.crossing_file import read_crossing
from osl_analysis.commands.ingest import ingest_trial
from osl_analysis.commands.repeats import gather
from osl_analysis.commands.walking import average_unperturbed, fit_perturbation, summarise
from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass
from osl_analysis.table_file import read_table
from osl_analysis.trial import Trial
from osl_analysis.trial_file import read_trial, write_trial

FOOT = {"mass_kg": 1.0, "centre_of_mass_m": [0.045, 0.0, -0.045], "inertia_kg_m2": 0.085**2}
COLUMNS = [
    "trial", "onset_s", "onset_phase", "K", "K_se", "B", "B_se", "I", "I_se", "offset", "VAF", "R2",
    "condition_number", "samples",
]  # fmt: skip


@dataclass(frozen=True)
class Session:
    """A simulated session of the gait laboratory, ingested; perturbed crossings by name, and the others."""

    folder: Path
    perturbed: list[str]
    calm: list[str]

    def trial(self, name: str) -> Path:
        return self.folder / "trials" / f"{name}.parquet"

    def crossing(self, name: str) -> Path:
        return self.folder / "crossings" / f"{name}.parquet"

    def truth(self, name: str) -> dict[str, Any]:
        facts: dict[str, Any] = json.loads((self.folder / "truth" / f"{name}.json").read_text())
        return facts

    @property
    def calibration(self) -> Path:
        return self.folder / "calibration.json"

    @property
    def plate(self) -> Path:
        return self.folder / "plate.json"

    @property
    def normal(self) -> Path:
        return self.folder / "unperturbed.parquet"

    def analysed(self, **choices: Any) -> "Session":
        """Run every step."""
        chosen = settings(**choices)
        calibrate(self.trial("static_1"), chosen, self.calibration)
        identify_plate([self.trial(f"plate_0{k}") for k in (1, 2, 3)], self.calibration, chosen, self.plate)
        for name in (*self.perturbed, *self.calm):
            walked = name in self.perturbed
            analyse(self.trial(name), self.calibration, self.plate, walked, chosen, self.crossing(name))
        average_unperturbed([self.crossing(n) for n in self.calm], chosen, self.normal)
        rows = [self.folder / "fits" / f"{n}.csv" for n in self.perturbed]
        for name, row in zip(self.perturbed, rows, strict=True):
            fit_perturbation(self.crossing(name), self.normal, chosen, row)
        gather(rows, self.folder / "walking.csv")
        crossings = [self.crossing(n) for n in self.perturbed]
        summary, responses = self.folder / "summary.csv", self.folder / "responses.csv"
        summarise(self.folder / "walking.csv", crossings, self.normal, chosen, summary, responses)
        return self

    def rendered(self, quantity: str) -> float:
        """Mean of what the simulated drivetrain rendered."""
        return float(np.mean([self.truth(name)[f"{quantity}_rendered"] for name in self.perturbed]))

    def estimate(self, quantity: str, estimator: str = "mean of perturbations") -> dict[str, Any]:
        table = read_table(self.folder / "summary.csv")
        rows = table.filter((pl.col("quantity") == quantity) & (pl.col("estimator") == estimator))
        return dict(rows.row(0, named=True))


def record_session(setup: Setup, folder: Path, perturbed: int, calm: int) -> Session:
    """Simulate, write C3D, ingest."""
    names = [f"walking_{k:02d}" for k in range(1, perturbed + calm + 1)]
    rows: list[dict[str, object]] = [{"trial": "static_1", "experiment": "static"}]
    rows += [{"trial": f"plate_0{k}", "experiment": "plate"} for k in (1, 2, 3)]
    rows += [{"trial": n, "experiment": "walking", "perturbed": k < perturbed} for k, n in enumerate(names)]
    for row in rows:
        setup.record(folder, row)
        files = {"mocap": f"vicon/{row['trial']}.c3d", "mocap_source": "vicon"}
        ingest_trial(row | files, folder, ROOT / "config/sources", folder / "trials" / f"{row['trial']}.parquet")
    return Session(folder, names[:perturbed], names[perturbed:])


@pytest.fixture(scope="module")
def ideal(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """No imperfection anywhere."""
    return record_session(load_setup().ideal(), tmp_path_factory.mktemp("ideal"), 2, 3).analysed()


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """Every imperfection as shipped; the foot's inertia is known."""
    return record_session(load_setup(), tmp_path_factory.mktemp("real"), 12, 12).analysed(foot=FOOT)


def test_without_imperfections_angle_and_torque_are_the_true_ones_through_one_filter(ideal: Session) -> None:
    for name in (ideal.perturbed[0], ideal.calm[0]):
        crossing, low_pass = read_crossing(ideal.crossing(name)), LowPass(20.0)
        truth = pl.read_parquet(ideal.folder / "truth" / f"{name}.parquet")
        stamps = truth["time"].to_numpy()
        theta, torque = (
            np.interp(crossing.time, stamps, low_pass(truth[c].to_numpy(), 1500.0)) for c in ("theta", "torque")
        )
        inside = (crossing.time > crossing.stance.heel_strike + 0.1) & (crossing.time < crossing.stance.toe_off - 0.1)
        # 300 Hz and 1500 Hz Butterworths of one cut-off differ by 0.5 % in gain where they fall off
        np.testing.assert_allclose(crossing.theta[inside], theta[inside], atol=np.deg2rad(0.005))
        np.testing.assert_allclose(crossing.torque[inside], torque[inside], atol=0.2)


def test_without_imperfections_the_rendered_stiffness_comes_out_to_half_a_percent(ideal: Session) -> None:
    for estimator in ("mean of perturbations", "ensemble"):
        assert ideal.estimate("K", estimator)["mean"] == pytest.approx(ideal.rendered("K"), rel=0.005)
        assert ideal.estimate("B", estimator)["mean"] == pytest.approx(ideal.rendered("B"), rel=0.03)
        assert ideal.estimate("I", estimator)["mean"] == pytest.approx(ideal.rendered("I"), abs=0.002)


def test_the_onset_is_the_platforms(real: Session) -> None:
    late = [read_crossing(real.crossing(n)).onset - real.truth(n)["onset_s"] for n in real.perturbed]  # type: ignore[operator]
    assert abs(np.mean(late)) < 0.004
    assert np.max(np.abs(late)) < 0.015
    assert all(read_crossing(real.crossing(n)).onset is None for n in real.calm)


def test_with_all_imperfections_the_rendered_stiffness_comes_out_to_five_percent(real: Session) -> None:
    """12 + 12 crossings that scatter by 13 N*m/rad: the standard error is 1.6 %."""
    for estimator in ("mean of perturbations", "ensemble"):
        assert real.estimate("K", estimator)["mean"] == pytest.approx(real.rendered("K"), rel=0.05)
        assert real.estimate("B", estimator)["mean"] == pytest.approx(real.rendered("B"), rel=0.1)
        assert real.estimate("I", estimator)["mean"] == pytest.approx(real.rendered("I"), abs=0.01)
    assert real.estimate("VAF")["mean"] > 99


def test_the_truth_is_in_the_bootstrap_interval(real: Session) -> None:
    found = real.estimate("K", "ensemble")
    assert found["low"] < real.rendered("K") < found["high"]
    assert 1 < found["se"] < 10


def test_the_plate_and_its_lag_are_the_simulated_ones(real: Session) -> None:
    model = read_plate(real.plate)
    simulated = real.truth("plate_01")["gait_laboratory"]
    mass, com = simulated["effects"]["plate_inertia"]["size"], np.array(simulated["plate"]["centre_of_mass_m"])
    assert model.lag == pytest.approx(1e-3 * simulated["effects"]["plate_lag"]["size"], abs=1e-4)
    assert model.inertia.parameters[0] == pytest.approx(mass, rel=0.02)
    np.testing.assert_allclose(model.inertia.parameters[1:4], mass * com, atol=0.02)
    assert model.inertia.rms_after[4] < 0.1 * model.inertia.rms_before[4]


def test_a_plate_whose_inertia_stays_in_passes_for_the_ankles(real: Session, tmp_path: Path) -> None:
    content = json.loads(real.plate.read_text())
    for value in content["parameters"].values():
        value["value"] = 0.0
    (tmp_path / "plate.json").write_text(json.dumps(content))
    name, chosen = real.perturbed[0], settings(foot=FOOT)
    analyse(real.trial(name), real.calibration, tmp_path / "plate.json", True, chosen, tmp_path / "c.parquet")
    fit_perturbation(tmp_path / "c.parquet", real.normal, chosen, tmp_path / "fit.csv")
    assert read_table(tmp_path / "fit.csv")["I"][0] > real.rendered("I") + 0.3


def test_the_tables_have_what_figures_and_summary_read(real: Session) -> None:
    table, responses = read_table(real.folder / "walking.csv", COLUMNS), read_table(real.folder / "responses.csv")
    assert table["trial"].to_list() == real.perturbed
    assert (table["onset_phase"].is_between(0.3, 0.5)).all()
    assert (table["samples"] == 30).all()
    assert set(responses["trial"]) == {*real.perturbed, "ensemble"}
    ensemble = responses.filter(pl.col("trial") == "ensemble")
    assert ensemble["time"].max() == pytest.approx(29 / 300)
    assert ensemble["torque_model"].count() == 30
    assert 3 < ensemble["theta_deg"].max() < 6  # type: ignore[operator]


def test_a_longer_filter_leaves_the_stiffness_alone(real: Session, tmp_path: Path) -> None:
    """Angle and torque lose the same, so that what relates them stays; 15 Hz instead of 20 Hz."""
    name = real.perturbed[1]
    found = []
    for cutoff in (15, 20):
        chosen = settings(cutoff_hz=cutoff, foot=FOOT)
        for trial in (name, *real.calm):
            output = tmp_path / f"{trial}.parquet"
            analyse(real.trial(trial), real.calibration, real.plate, trial == name, chosen, output)
        average_unperturbed([tmp_path / f"{t}.parquet" for t in real.calm], chosen, tmp_path / "normal.parquet")
        fit_perturbation(tmp_path / f"{name}.parquet", tmp_path / "normal.parquet", chosen, tmp_path / "fit.csv")
        found.append(read_table(tmp_path / "fit.csv")["K"][0])
    assert found[0] == pytest.approx(found[1], rel=0.03)


# What users get wrong


@pytest.mark.parametrize(("which", "claimed"), [("perturbed", False), ("calm", True)])
def test_a_sheet_that_disagrees_with_the_platform_is_refused(
    ideal: Session, tmp_path: Path, which: str, claimed: bool
) -> None:
    name, output = getattr(ideal, which)[0], tmp_path / "crossing.parquet"
    with pytest.raises(
        InputError, match=f"trial {name}: the platform .* sheet says perturbed = {str(claimed).lower()}"
    ):
        analyse(ideal.trial(name), ideal.calibration, ideal.plate, claimed, settings(), output)
    assert not output.exists()


def hide(trial: Trial, markers: tuple[str, ...], start: float, end: float) -> Trial:
    """The trial with markers hidden between two times [s]."""
    hidden = pl.col("time").is_between(start, end)
    columns = [f"marker_{m}_{axis}" for m in markers for axis in "xyz"]
    gone = [pl.when(hidden & pl.col(c).is_not_null()).then(float("nan")).otherwise(pl.col(c)).alias(c) for c in columns]
    return Trial(trial.name, trial.samples.with_columns(gone), trial.provenance)


def test_a_cluster_hidden_for_long_in_stance_is_refused_and_for_short_is_bridged(
    ideal: Session, tmp_path: Path
) -> None:
    name = ideal.calm[0]
    source, path, output = read_trial(ideal.trial(name)), tmp_path / "hidden.parquet", tmp_path / "crossing.parquet"
    write_trial(hide(source, ("SHANK1", "SHANK4"), 1.2, 1.23), path)
    analyse(path, ideal.calibration, ideal.plate, False, settings(), output)
    whole, bridged = read_crossing(ideal.crossing(name)), read_crossing(output)
    assert 0 < bridged.bridged < 0.1
    np.testing.assert_allclose(bridged.theta, whole.theta, atol=np.deg2rad(0.1))
    output.unlink()
    write_trial(hide(source, ("SHANK1", "SHANK4"), 1.2, 1.4), path)
    with pytest.raises(InputError, match=rf"trial {name}: the shank markers cannot be followed at 1\.2\d+ s"):
        analyse(path, ideal.calibration, ideal.plate, False, settings(), output)
    assert not output.exists()


def test_a_missing_marker_is_named(ideal: Session, tmp_path: Path) -> None:
    name = ideal.calm[0]
    source = read_trial(ideal.trial(name))
    write_trial(Trial(name, source.samples.drop("marker_FOOT3_x"), source.provenance), tmp_path / "t.parquet")
    with pytest.raises(InputError, match=f"trial {name}: no column 'marker_FOOT3_x'"):
        analyse(tmp_path / "t.parquet", ideal.calibration, ideal.plate, False, settings(), tmp_path / "c.parquet")


def test_a_marker_that_was_not_calibrated_is_named(ideal: Session, tmp_path: Path) -> None:
    content = json.loads(ideal.calibration.read_text())
    del content["foot"]["FOOT2"]
    (tmp_path / "calibration.json").write_text(json.dumps(content))
    name = ideal.calm[0]
    with pytest.raises(InputError, match=f"trial {name}: marker FOOT2 was not calibrated"):
        analyse(ideal.trial(name), tmp_path / "calibration.json", ideal.plate, False, settings(), tmp_path / "c")


def test_too_few_unperturbed_crossings_leave_no_file(ideal: Session, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"2 unperturbed crossings .* expected 3 or more"):
        average_unperturbed([ideal.crossing(n) for n in ideal.calm[:2]], settings(), tmp_path / "normal.parquet")
    assert not (tmp_path / "normal.parquet").exists()


def test_a_window_that_leaves_stance_is_refused_by_name(ideal: Session, tmp_path: Path) -> None:
    name = ideal.perturbed[0]
    with pytest.raises(InputError, match=f"trial {name}: baseline and window, .* leave stance"):
        analyse(ideal.trial(name), ideal.calibration, ideal.plate, True, settings(window_s=0.6), tmp_path / "c")


def test_one_perturbation_has_no_summary(ideal: Session, tmp_path: Path) -> None:
    table, crossing = ideal.folder / "fits" / f"{ideal.perturbed[0]}.csv", ideal.crossing(ideal.perturbed[0])
    with pytest.raises(InputError, match="1 perturbation cannot give an ensemble"):
        summarise(table, [crossing], ideal.normal, settings(), tmp_path / "s.csv", tmp_path / "r.csv")
    assert not list(tmp_path.iterdir())


def test_missing_and_damaged_files_between_the_steps_name_the_step(ideal: Session, tmp_path: Path) -> None:
    broken = tmp_path / "plate.json"
    with pytest.raises(InputError, match=r"plate\.json: no such file; run the step 'identify-plate'"):
        read_plate(broken)
    broken.write_text("{")
    with pytest.raises(InputError, match=r"plate\.json: not JSON"):
        read_plate(broken)
    broken.write_text("{}")
    with pytest.raises(InputError, match=r"plate\.json: no field 'ankle_centre'|no field 'foot'"):
        read_calibration(broken)
    with pytest.raises(InputError, match="a trial without events"):
        read_crossing(ideal.trial(ideal.calm[0]))
    with pytest.raises(InputError, match=r"n\.parquet: no such file; run the step 'average-unperturbed'"):
        fit_perturbation(ideal.crossing(ideal.perturbed[0]), tmp_path / "n.parquet", settings(), tmp_path / "f.csv")
