"""From recorded C3D files to the walking tables: what the simulated leg rendered is what comes out."""

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from conftest import ROOT
from walking_setup import Setup, load_setup
from walking_synthetic import settings

from osl_analysis.about import About
from osl_analysis.commands.crossing import analyse, calibrate, identify_plate
from osl_analysis.commands.ingest import ingest_trial
from osl_analysis.commands.summarise import read_summary, write_summary
from osl_analysis.commands.tables import gather
from osl_analysis.commands.walking import (
    average_unperturbed,
    fit_perturbation,
    select_crossings,
    summarise_perturbations,
)
from osl_analysis.commands.walking_files import (
    read_calibration,
    read_crossing,
    read_crossing_file,
    read_plate,
    write_crossing,
    write_plate,
)
from osl_analysis.commands.walking_page import plot_walking_page
from osl_analysis.doubtful import Doubt
from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass
from osl_analysis.table import read_table, write_table
from osl_analysis.trial import Array, Trial, read_trial, write_trial
from osl_analysis.walking.crossing import Crossing, RefusedCrossing
from osl_analysis.walking.gait import unperturbed_gait
from osl_analysis.walking.response import fit_response, isolate_response
from osl_analysis.walking.settings import WalkingAnalysis

FOOT = {"mass_kg": 1.0, "centre_of_mass_m": [0.045, 0.0, -0.045], "inertia_kg_m2": 0.085**2}
COLUMNS = [
    "trial", "onset_s", "onset_phase", "K", "K_se", "B", "B_se", "I", "I_se", "offset", "VAF", "R2",
    "condition_number", "samples",
]  # fmt: skip


FILES = {"calibration": "calibration.json", "plate": "plate.json", "gait": "unperturbed.parquet"}
FILES["selection"] = "walking_crossings.csv"


@dataclass(frozen=True)
class Session:
    """A simulated session of the gait laboratory, ingested; perturbed crossings by name, and the others."""

    folder: Path
    perturbed: list[str]
    unperturbed: list[str]

    def trial(self, name: str) -> Path:
        return self.folder / "trials" / f"{name}.parquet"

    def crossing(self, name: str) -> Path:
        return self.folder / "crossings" / f"{name}.parquet"

    def truth(self, name: str) -> dict[str, Any]:
        facts: dict[str, Any] = json.loads((self.folder / "truth" / f"{name}.json").read_text())
        return facts

    def __getattr__(self, name: str) -> Path:
        """The files of the session."""
        return self.folder / FILES[name]

    def analysed(self, **choices: Any) -> "Session":
        """Run every step."""
        chosen = settings(**choices)
        motion = [self.trial(n) for n in self.unperturbed[:3]]
        calibrate(self.trial("static_1"), motion, chosen, self.calibration, self.folder / "hinge.csv")
        unloaded = [self.trial(f"plate_0{k}") for k in (1, 2, 3)]
        of = {path.stem: self.calibration.stem for path in unloaded}
        identify_plate(unloaded, [self.calibration], of, chosen, self.plate, self.folder / "plate.csv")
        for name in (*self.perturbed, *self.unperturbed):
            walked = name in self.perturbed
            analyse(self.trial(name), self.calibration, self.plate, walked, chosen, self.crossing(name))
        select_crossings([self.crossing(n) for n in (*self.perturbed, *self.unperturbed)], chosen, self.selection)
        average_unperturbed([self.crossing(n) for n in self.unperturbed], self.selection, chosen, self.gait)
        rows = [self.folder / "fits" / f"{n}.csv" for n in self.perturbed]
        for name, row in zip(self.perturbed, rows, strict=True):
            fit_perturbation(self.crossing(name), self.selection, self.gait, chosen, row)
        gather(rows, self.folder / "walking.csv")
        summarise(self, [self.crossing(n) for n in self.perturbed], chosen, self.folder)
        return self

    def rendered(self, quantity: str) -> float:
        """Mean of what the simulated drivetrain rendered."""
        return float(np.mean([self.truth(name)[f"{quantity}_rendered"] for name in self.perturbed]))

    def estimate(self, quantity: str, estimator: str = "mean of perturbations") -> dict[str, Any]:
        table = read_table(self.folder / "summary.csv")
        rows = table.filter((pl.col("quantity") == quantity) & (pl.col("estimator") == estimator))
        return dict(rows.row(0, named=True))


def summarise(session: Session, crossings: list[Path], chosen: WalkingAnalysis, folder: Path) -> None:
    """The summary job on `walking.csv` of a folder, with that folder's selection and unperturbed gait."""
    summarise_perturbations(
        table=folder / "walking.csv",
        crossings=crossings,
        selection=folder / session.selection.name,
        unperturbed=folder / session.gait.name,
        settings=chosen,
        output=folder / "summary.csv",
        responses=folder / "responses.csv",
        excluded=folder / "excluded.csv",
        groups=folder / "groups.csv",
    )


def record_session(setup: Setup, folder: Path, perturbed: int, unperturbed: int) -> Session:
    """Simulate, write C3D, ingest."""
    names = [f"walking_{k:02d}" for k in range(1, perturbed + unperturbed + 1)]
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
    for name in (ideal.perturbed[0], ideal.unperturbed[0]):
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


def test_a_turn_of_the_toes_down_is_measured_with_its_sign_and_not_taken_for_one_up(
    ideal: Session, tmp_path: Path
) -> None:
    row = {"trial": "walking_77", "experiment": "walking", "perturbed": True, "direction": "down"}
    load_setup().ideal().record(tmp_path, row)
    files = {"mocap": "vicon/walking_77.c3d", "mocap_source": "vicon"}
    ingest_trial(row | files, tmp_path, ROOT / "config/sources", tmp_path / "w.parquet")
    common = tmp_path / "w.parquet", ideal.calibration, ideal.plate, True, settings()
    analyse(*common, tmp_path / "down.parquet", "down")
    turn = read_crossing(tmp_path / "down.parquet").turn
    assert turn is not None
    assert np.rad2deg(turn) == pytest.approx(-5, abs=0.1)
    with pytest.warns(UserWarning, match=r"walking_77: the platform turned by -5\.\d deg .* expected 'down'"):
        analyse(*common, tmp_path / "up.parquet", "up")
    assert isinstance(read_crossing_file(tmp_path / "up.parquet"), RefusedCrossing)
    assert {read_crossing(ideal.crossing(name)).sign for name in ideal.perturbed} == {1}


def test_the_onset_is_the_platforms(real: Session) -> None:
    late = [read_crossing(real.crossing(n)).onset - real.truth(n)["onset_s"] for n in real.perturbed]  # type: ignore[operator]
    assert abs(np.mean(late)) < 0.004
    assert np.max(np.abs(late)) < 0.015
    assert all(read_crossing(real.crossing(n)).onset is None for n in real.unperturbed)


def test_with_all_imperfections_the_rendered_stiffness_comes_out_to_five_percent(real: Session) -> None:
    """12 + 12 crossings that scatter by 13 N*m/rad: the standard error is 1.6 %."""
    for estimator in ("mean of perturbations", "ensemble"):
        assert real.estimate("K", estimator)["mean"] == pytest.approx(real.rendered("K"), rel=0.05)
        assert real.estimate("B", estimator)["mean"] == pytest.approx(real.rendered("B"), rel=0.1)
        assert real.estimate("I", estimator)["mean"] == pytest.approx(real.rendered("I"), abs=0.01)
    assert real.estimate("VAF")["mean"] > 99
    K = real.estimate("K", "ensemble")
    assert K["low"] < real.rendered("K") < K["high"]
    assert 1 < K["se"] < 10


def test_the_plate_and_its_lag_are_the_simulated_ones(real: Session) -> None:
    model = read_plate(real.plate)
    simulated = real.truth("plate_01")["gait_laboratory"]
    mass, com = simulated["effects"]["plate_inertia"]["size"], np.array(simulated["plate"]["centre_of_mass_m"])
    assert model.lag == pytest.approx(1e-3 * simulated["effects"]["plate_lag"]["size"], abs=1e-4)
    assert model.inertia.parameters[0] == pytest.approx(mass, rel=0.02)
    np.testing.assert_allclose(model.inertia.parameters[1:4], mass * com, atol=0.02)
    assert model.inertia.rms_after[4] < 0.1 * model.inertia.rms_before[4]
    table = read_table(real.folder / "plate.csv", ["rms_before", "rms_after", "left_percent", "lag_s", "lag_se_s"])
    assert (table.filter(pl.col("component").is_in(["F_x", "F_z", "M_y"]))["left_percent"] < 10).all()
    assert table["lag_s"][0] == pytest.approx(5e-4, abs=1e-4)
    assert 0 < table["lag_se_s"][0] < 1e-4


def test_a_plate_whose_inertia_stays_in_passes_for_the_ankles(real: Session, tmp_path: Path) -> None:
    content = json.loads(real.plate.read_text())
    for value in content["parameters"].values():
        value["value"] = 0.0
    (tmp_path / "plate.json").write_text(json.dumps(content))
    name, chosen = real.perturbed[0], settings(foot=FOOT)
    analyse(real.trial(name), real.calibration, tmp_path / "plate.json", True, chosen, tmp_path / "c.parquet")
    fit_perturbation(tmp_path / "c.parquet", real.selection, real.gait, chosen, tmp_path / "fit.csv")
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


def test_a_campaign_in_which_no_perturbation_can_be_used_has_its_other_headline_numbers(
    real: Session, tmp_path: Path
) -> None:
    selection = read_table(real.selection).with_columns(pl.lit("a shoe was lost").alias("reason"))
    write_table(selection, tmp_path / "walking_crossings.csv")
    rows = [tmp_path / f"{name}.csv" for name in real.perturbed]
    for row in rows:
        crossing = real.crossing(row.stem)
        fit_perturbation(crossing, tmp_path / "walking_crossings.csv", real.gait, settings(), row)
    gather(rows, tmp_path / "walking.csv", Doubt(below={"VAF": 80}))
    belt = pl.DataFrame([{"quantity": "K_s", "n": 3, "mean": 685.6, "low": 680.0, "high": 690.0}])
    write_table(belt, tmp_path / "belt_summary.csv")
    tables = {name: tmp_path / f"{name}.csv" for name in ("belt_summary", "walking")}
    summary = tmp_path / "summary.json"
    made = About("made", "simulated", "1.2.3", "0a1b2c3d", "made with seed 1")
    write_summary(about=made, table_paths=tables, summary_json=summary, numbers_tex=tmp_path / "numbers.tex")
    assert read_summary(summary)["numbers"]["K_s"]["value"] == 685.6
    assert read_table(tmp_path / "walking.csv")["excluded"].unique().to_list() == ["a shoe was lost"]


def test_a_longer_filter_leaves_the_stiffness_alone(real: Session, tmp_path: Path) -> None:
    """Angle and torque lose the same, so that what relates them stays; 15 Hz instead of the 20 Hz of the session."""
    name, chosen = real.perturbed[1], settings(cutoff_hz=15, foot=FOOT)
    assert settings(foot=FOOT).cutoff_hz == 20
    for trial in (name, *real.unperturbed):
        output = tmp_path / f"{trial}.parquet"
        analyse(real.trial(trial), real.calibration, real.plate, trial == name, chosen, output)
    gait, unperturbed = tmp_path / "gait.parquet", [tmp_path / f"{t}.parquet" for t in real.unperturbed]
    average_unperturbed(unperturbed, real.selection, chosen, gait)
    fit_perturbation(tmp_path / f"{name}.parquet", real.selection, gait, chosen, tmp_path / "fit.csv")
    at_20_hz = read_table(real.folder / "walking.csv").filter(pl.col("trial") == name)["K"].item()
    assert read_table(tmp_path / "fit.csv")["K"].item() == pytest.approx(at_20_hz, rel=0.03)


def test_without_imperfections_measured_angle_and_torque_fit_as_the_exact_ones_do_to_numerical_precision(
    ideal: Session,
) -> None:
    """What is left of the error is the model's, not the measurement's: the leg that answers is of third order, so that
    K, B and I of Eq. 15 depend on the filter. The exact curves through the same filter give the same numbers, but for
    the file's single precision and a low-pass of products that is not the product of low-passes."""
    crossings = [read_crossing(ideal.crossing(n)) for n in (*ideal.perturbed, *ideal.unperturbed)]
    measured, exact = (fits_of(c) for c in (crossings, [exact_crossing(ideal, c) for c in crossings]))
    np.testing.assert_allclose(measured[:, 0], exact[:, 0], rtol=2e-4)
    np.testing.assert_allclose(measured[:, 1], exact[:, 1], rtol=1e-3)
    np.testing.assert_allclose(measured[:, 2], exact[:, 2], atol=1e-4)


def exact_crossing(session: Session, crossing: Crossing) -> Crossing:
    """The crossing with the exact angle and torque at the marker frames, through the analysis' filter."""
    truth = pl.read_parquet(session.folder / "truth" / f"{crossing.name}.parquet").gather_every(5)
    rows = np.searchsorted(truth["time"].to_numpy(), crossing.time - 1e-6)
    theta, torque = (settings().low_pass(truth[c].to_numpy(), 300.0)[rows] for c in ("theta", "torque"))
    return replace(crossing, theta=theta, torque=torque)


def fits_of(crossings: list[Crossing]) -> Array:
    """K, B, I (perturbed, 3) of the perturbed ones among crossings."""
    gait = unperturbed_gait([c for c in crossings if c.onset is None], 3)
    fits = [fit_response(isolate_response(c, gait, settings().timing)) for c in crossings if c.onset]
    return np.array([[f.K, f.B, f.I] for f in fits])


def test_every_estimate_says_where_its_interval_is_from_and_keeps_its_covariances(real: Session) -> None:
    for estimator, method in (("mean of perturbations", "Student + shared errors"), ("ensemble", "bootstrap")):
        assert real.estimate("K", estimator)["interval_method"] == method
    K, B = real.estimate("K", "ensemble"), real.estimate("B", "ensemble")
    assert K["cov_K"] == pytest.approx(K["se"] ** 2)
    assert K["cov_B"] == pytest.approx(B["cov_K"])
    assert abs(K["cov_B"]) < K["se"] * B["se"]
    single = read_table(real.folder / "walking.csv").row(0, named=True)
    assert single["interval_method"] == "unperturbed crossings + plate trials"
    assert abs(single["cov_K_B"]) < single["K_se"] * single["B_se"]


def test_the_torque_is_true_to_two_newton_metres_in_the_window(real: Session) -> None:
    for name in real.perturbed:
        crossing = read_crossing(real.crossing(name))
        truth = pl.read_parquet(real.folder / "truth" / f"{name}.parquet")
        assert crossing.onset is not None
        rows = (crossing.time >= crossing.onset) & (crossing.time <= crossing.onset + 0.1)
        exact = np.interp(crossing.time[rows], truth["time"], truth["torque"])
        assert np.sqrt(np.mean((crossing.torque[rows] - exact) ** 2)) < 2


def test_the_tables_say_how_far_each_crossing_can_be_trusted(real: Session) -> None:
    """Markers of 0.15 mm noise, RMS over three axes less the pose's six freedoms of twelve: 0.18 mm."""
    table = read_table(real.selection)
    assert table["trial"].to_list() == [*real.perturbed, *real.unperturbed]
    assert set(table["status"]) == {"used"}
    for segment in ("foot", "shank", "platform"):
        np.testing.assert_allclose(table[f"{segment}_residual_mm"], 0.15 * np.sqrt(3 / 2), rtol=0.1)
    assert (table["plate_zero_N"].abs() < 8).all()  # 2 N of offset drawn per trial
    assert (table["encoder_rms_deg"].is_null()).all()  # these trials have no log


def test_the_hinge_from_motion_is_the_simulated_one(real: Session) -> None:
    hinge = read_table(real.folder / "hinge.csv")
    assert hinge["angle_deg"][0] < 0.2
    assert hinge["distance_mm"][0] < 1


def test_the_functional_hinge_takes_the_place_of_wrong_malleoli(real: Session, tmp_path: Path) -> None:
    """A medial malleolus that stands 20 mm too far forward turns the anatomical axis by 13 degrees."""
    static = read_trial(real.trial("static_1"))
    moved = static.samples.with_columns(pl.col("marker_ANKLE_MED_x") + 0.02)
    write_trial(Trial("static_1", moved, static.provenance), tmp_path / "static.parquet")
    motion, outputs = [real.trial(n) for n in real.unperturbed[:2]], (tmp_path / "c.json", tmp_path / "h.csv")
    calibrate(tmp_path / "static.parquet", motion, settings(hinge="anatomical"), *outputs)
    assert read_table(outputs[1])["angle_deg"][0] == pytest.approx(13.4, abs=0.5)
    assert read_calibration(outputs[0]).ankle_axis[0] == pytest.approx(np.sin(np.deg2rad(13.4)), abs=0.01)
    calibrate(tmp_path / "static.parquet", motion, settings(hinge="functional"), *outputs)
    np.testing.assert_allclose(read_calibration(outputs[0]).ankle_axis, [0, 1, 0], atol=5e-3)


def test_without_a_motion_the_anatomical_axis_stays_and_the_functional_one_is_refused(
    real: Session, tmp_path: Path
) -> None:
    outputs = tmp_path / "c.json", tmp_path / "h.csv"
    calibrate(real.trial("static_1"), [], settings(), *outputs)
    assert "no trial in which foot and shank move" in read_table(outputs[1])["reason"][0]
    with pytest.raises(InputError, match="set hinge to anatomical"):
        calibrate(real.trial("static_1"), [], settings(hinge="functional"), *outputs)


# What users get wrong


def test_a_plate_that_was_not_zeroed_changes_nothing(ideal: Session, tmp_path: Path) -> None:
    """60 N and 7 N*m off: more than what begins a stance. The zero is read before the foot comes."""
    name, output = ideal.perturbed[0], tmp_path / "c.parquet"
    trial = read_trial(ideal.trial(name))
    off = [pl.col("plate1_force_z") + 60, pl.col("plate1_moment_y") - 7, pl.col("plate1_force_x") - 20]
    write_trial(Trial(name, trial.samples.with_columns(off), trial.provenance), tmp_path / "t.parquet")
    analyse(tmp_path / "t.parquet", ideal.calibration, ideal.plate, True, settings(), output)
    whole, shifted = read_crossing(ideal.crossing(name)), read_crossing(output)
    assert shifted.stance.heel_strike == pytest.approx(whole.stance.heel_strike, abs=1e-6)
    np.testing.assert_allclose(shifted.torque, whole.torque, atol=1e-6)
    assert shifted.quality.zero == pytest.approx(60, abs=1e-4)


def saturate(trial: Trial, limit: float) -> Trial:
    """The trial with its plate's vertical force cut off."""
    return Trial(
        trial.name, trial.samples.with_columns(pl.col("plate1_force_z").clip(upper_bound=limit)), trial.provenance
    )


def test_what_cannot_be_used_is_named_and_listed_and_the_rest_goes_on(real: Session, tmp_path: Path) -> None:
    """A hidden cluster, a platform that did not move, a plate at its limit, a foot put down elsewhere."""
    chosen, crossings = settings(foot=FOOT), {}
    for name in (*real.perturbed, *real.unperturbed):
        crossings[name] = tmp_path / f"{name}.parquet"
        crossings[name].write_bytes(real.crossing(name).read_bytes())
    hidden, still, elsewhere = real.perturbed[:3]
    cut = real.unperturbed[0]
    changed = {
        hidden: hide(read_trial(real.trial(hidden)), ("FOOT1", "FOOT2"), 1.2, 1.6),
        still: Trial(
            still, read_trial(real.trial(real.unperturbed[1])).samples, read_trial(real.trial(still)).provenance
        ),
        cut: saturate(read_trial(real.trial(cut)), 600),
    }
    for name, trial in changed.items():
        write_trial(trial, tmp_path / "trial.parquet")
        with pytest.warns(UserWarning, match=f"excluded: trial {name}"):
            analyse(tmp_path / "trial.parquet", real.calibration, real.plate, name != cut, chosen, crossings[name])
    outlier = read_crossing(crossings[elsewhere])
    moved = replace(outlier, quality=replace(outlier.quality, placement=(0.2, 0.0)))
    write_crossing(moved, crossings[elsewhere])
    selection, gait = tmp_path / real.selection.name, tmp_path / real.gait.name
    select_crossings(list(crossings.values()), chosen, selection)
    average_unperturbed([crossings[n] for n in real.unperturbed], selection, chosen, gait)
    rows = [tmp_path / f"{n}.csv" for n in real.perturbed]
    for name, row in zip(real.perturbed, rows, strict=True):
        fit_perturbation(crossings[name], selection, gait, chosen, row)
    gather(rows, tmp_path / "walking.csv", Doubt(above={"offset_share": 0.06}))
    perturbed = [crossings[n] for n in real.perturbed]
    summarise(real, perturbed, chosen, tmp_path)
    listed = dict(read_table(tmp_path / "excluded.csv").select("trial", "reason").iter_rows())
    assert list(listed) == [hidden, still, elsewhere, cut]
    assert "foot markers cannot be followed" in listed[hidden]
    assert "does not turn but the sheet says perturbed" in listed[still]
    assert "foot forward 0.2 m lies" in listed[elsewhere]
    assert "Fz stays at 600 N" in listed[cut]
    assert set(read_table(tmp_path / "summary.csv")["n"]) == {9}
    assert read_table(tmp_path / "summary.csv")["mean"][0] == pytest.approx(real.rendered("K"), rel=0.05)
    page = tmp_path / "page.csv"
    plot_walking_page(
        crossings=perturbed,
        selection=selection,
        unperturbed=gait,
        responses=tmp_path / "responses.csv",
        table=tmp_path / "walking.csv",
        settings=chosen,
        output=page,
    )
    counts = read_table(page).filter(pl.col("panel") == "angle").group_by("curve").agg(pl.col("n").first())
    assert dict(counts.drop_nulls().iter_rows()) == {"perturbed": 9, "unperturbed": 11}
    each = read_table(page).filter(pl.col("curve") == "each")
    assert each["trial"].n_unique() == 9
    fits = read_table(tmp_path / "walking.csv")
    doubtful = set(fits.filter(pl.col("offset_share").abs() > 0.06)["trial"])
    assert 0 < len(doubtful) < 9
    fitted = fits.filter(pl.col("K").is_not_null())
    assert fitted["lag_out_of_reach"].to_list() == fitted["lag_s"].is_null().cast(pl.Float64).to_list()
    assert set(each.filter(pl.col("doubtful") != "")["trial"]) == doubtful
    assert read_table(tmp_path / "summary.csv")["n_doubtful"].drop_nulls().unique().to_list() == [len(doubtful)]
    np.testing.assert_allclose(
        fits["offset_share"].drop_nulls(), (1 - fits["K_with_offset"] / fits["K"]).drop_nulls(), rtol=1e-9
    )


def test_a_perturbation_that_cannot_be_fitted_is_listed_too(ideal: Session, tmp_path: Path) -> None:
    """A window so short that it has fewer samples than parameters."""
    name, chosen = ideal.perturbed[0], settings(window_s=0.009)
    fit_perturbation(ideal.crossing(name), ideal.selection, ideal.gait, chosen, tmp_path / "fit.csv")
    (row,) = read_table(tmp_path / "fit.csv").to_dicts()
    assert row["trial"] == name
    assert "samples cannot determine 3 parameters" in row["excluded"]


@contextmanager
def refused(output: Path, reason: str) -> Iterator[None]:
    """The crossing is refused for a reason like this, with a warning, and its file says so."""
    with pytest.warns(UserWarning, match=reason):
        yield
    crossing = read_crossing_file(output)
    assert isinstance(crossing, RefusedCrossing)
    assert re.search(reason, crossing.reason)
    with pytest.raises(InputError, match="was refused"):
        read_crossing(output)


def hide(trial: Trial, markers: tuple[str, ...], start: float, end: float) -> Trial:
    """The trial with markers hidden between two times [s]."""
    hidden = pl.col("time").is_between(start, end)
    columns = [f"marker_{m}_{axis}" for m in markers for axis in "xyz"]
    gone = [pl.when(hidden & pl.col(c).is_not_null()).then(float("nan")).otherwise(pl.col(c)).alias(c) for c in columns]
    return Trial(trial.name, trial.samples.with_columns(gone), trial.provenance)


def test_a_cluster_hidden_for_long_in_stance_is_refused_and_for_short_is_bridged(
    ideal: Session, tmp_path: Path
) -> None:
    name = ideal.unperturbed[0]
    source, path, output = read_trial(ideal.trial(name)), tmp_path / "hidden.parquet", tmp_path / "crossing.parquet"
    write_trial(hide(source, ("SHANK1", "SHANK4"), 1.2, 1.23), path)
    analyse(path, ideal.calibration, ideal.plate, False, settings(), output)
    whole, bridged = read_crossing(ideal.crossing(name)), read_crossing(output)
    assert 0 < bridged.bridged < 0.1
    np.testing.assert_allclose(bridged.theta, whole.theta, atol=np.deg2rad(0.1))
    output.unlink()
    write_trial(hide(source, ("SHANK1", "SHANK4"), 1.2, 1.4), path)
    with refused(output, rf"trial {name}: the shank markers cannot be followed at 1\.2\d+ s"):
        analyse(path, ideal.calibration, ideal.plate, False, settings(), output)


def test_a_crossing_knows_what_each_trial_of_the_plate_does_to_its_torque(real: Session, tmp_path: Path) -> None:
    name, plate = real.perturbed[0], read_plate(real.plate)
    crossing = read_crossing(real.crossing(name))
    assert len(crossing.plate_errors) == len(plate.leave_one_out) > 1
    write_plate(plate.leave_one_out[1], tmp_path / "plate.json")
    chosen = settings(foot=FOOT)
    analyse(real.trial(name), real.calibration, tmp_path / "plate.json", True, chosen, tmp_path / "c.parquet")
    without = read_crossing(tmp_path / "c.parquet")
    np.testing.assert_allclose(crossing.plate_errors[1], without.torque - crossing.torque, atol=1e-9)
    assert np.abs(crossing.plate_errors[1]).max() > 1e-3
    assert without.plate_errors.shape == (0, len(without.time))


def test_a_cluster_hidden_while_the_perturbation_is_fitted_is_refused(ideal: Session, tmp_path: Path) -> None:
    """30 ms that would be bridged elsewhere in stance; 7 ms are bridged even here."""
    name, path, output = ideal.perturbed[0], tmp_path / "hidden.parquet", tmp_path / "crossing.parquet"
    onset = read_crossing(ideal.crossing(name)).onset
    assert onset is not None
    source = read_trial(ideal.trial(name))
    write_trial(hide(source, ("FOOT1", "FOOT2"), onset + 0.03, onset + 0.06), path)
    with refused(output, rf"trial {name}: the foot markers are hidden for \d+ ms from 1\.\d+ s, while the pert"):
        analyse(path, ideal.calibration, ideal.plate, True, settings(), output)
    for start, duration in ((0.03, 0.007), (-0.15, 0.03)):
        write_trial(hide(source, ("FOOT1", "FOOT2"), onset + start, onset + start + duration), path)
        analyse(path, ideal.calibration, ideal.plate, True, settings(), output)
        assert read_crossing(output).bridged > 0


@pytest.mark.parametrize(
    ("which", "claimed", "lost", "choices", "reason"),
    [
        ("perturbed", False, "", {}, "the platform .* sheet says perturbed = false"),
        ("unperturbed", True, "", {}, "the platform .* sheet says perturbed = true"),
        ("unperturbed", False, "column", {}, "no column 'marker_FOOT3_x'"),
        ("unperturbed", False, "calibration", {}, "marker FOOT2 is not in the static calibration"),
        ("perturbed", True, "", {"window_s": 0.6}, "baseline and window, .* leave stance"),
    ],
)
def test_what_contradicts_sheet_markers_calibration_or_stance_is_refused_by_name(
    ideal: Session, tmp_path: Path, which: str, claimed: bool, lost: str, choices: dict[str, Any], reason: str
) -> None:
    name, path, output = getattr(ideal, which)[0], tmp_path / "t.parquet", tmp_path / "c.parquet"
    source, content = read_trial(ideal.trial(name)), json.loads(ideal.calibration.read_text())
    samples = source.samples.drop("marker_FOOT3_x") if lost == "column" else source.samples
    write_trial(Trial(name, samples, source.provenance), path)
    if lost == "calibration":
        del content["foot"]["FOOT2"]
    (tmp_path / "calibration.json").write_text(json.dumps(content))
    with refused(output, f"trial {name}: {reason}"):
        analyse(path, tmp_path / "calibration.json", ideal.plate, claimed, settings(**choices), output)


def test_too_few_unperturbed_crossings_leave_no_file(ideal: Session, tmp_path: Path) -> None:
    few = [ideal.crossing(n) for n in ideal.unperturbed[:2]]
    with pytest.raises(InputError, match=r"2 unperturbed crossings .* expected 3 or more"):
        average_unperturbed(few, ideal.selection, settings(), tmp_path / "gait.parquet")
    assert not (tmp_path / "gait.parquet").exists()


def test_one_perturbation_has_no_summary(ideal: Session, tmp_path: Path) -> None:
    (tmp_path / "walking.csv").write_bytes((ideal.folder / "fits" / f"{ideal.perturbed[0]}.csv").read_bytes())
    (tmp_path / ideal.selection.name).write_bytes(ideal.selection.read_bytes())
    with pytest.raises(InputError, match="1 of 1 perturbations can be used, expected 2 or more"):
        summarise(ideal, [ideal.crossing(ideal.perturbed[0])], settings(), tmp_path)
    assert not (tmp_path / "summary.csv").exists()


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
        read_crossing(ideal.trial(ideal.unperturbed[0]))
    perturbed, absent = ideal.crossing(ideal.perturbed[0]), tmp_path / "n.parquet"
    with pytest.raises(InputError, match=r"n\.parquet: no such file; run the step 'average-unperturbed'"):
        fit_perturbation(perturbed, ideal.selection, absent, settings(), tmp_path / "f.csv")
