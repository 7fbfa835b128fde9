"""From C3D files to the walking tables: what the simulated leg rendered comes out; and moments of
overground gait."""

import json
import re
import shutil
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import yaml
from click.testing import CliRunner
from conftest import ROOT, beyond_in, findings_of
from walking_crossings import Tables, Walk, run_jobs, several, walked
from walking_setup import Setup, load_setup
from walking_synthetic import (
    CORNERS,
    PLATE_RATE,
    RATE,
    changed,
    hidden,
    recording,
    settings,
    step,
)

from osl_analysis.cli import main
from osl_analysis.commands import walking, walking_files
from osl_analysis.commands.figure import plot_walking_page
from osl_analysis.commands.trials import ingest_trial
from osl_analysis.errors import InputError
from osl_analysis.judge.limits import Limits
from osl_analysis.table import read_table, write_table
from osl_analysis.trial import Trial, plate_columns, read_trial, write_trial
from osl_analysis.walking.crossing import Crossing, RefusedCrossing
from osl_analysis.walking.impedance_fit import fit_response
from osl_analysis.walking.isolated_response import isolate_response
from osl_analysis.walking.overground import CURVES, overground_contacts
from osl_analysis.walking.plate_model import PlateModel
from osl_analysis.walking.setup_checks import body_mass
from osl_analysis.walking.unperturbed_gait import unperturbed_gait
from osl_analysis.walking.walking_settings import OvergroundAnalysis, WalkingAnalysis

FOOT = {"mass_kg": 1.0, "centre_of_mass_m": [0.045, 0.0, -0.045], "inertia_kg_m2": 0.085**2}


@dataclass(frozen=True)
class Session:
    """A simulated session of the gait laboratory, ingested; perturbed crossings by name, and the
    others."""

    folder: Path
    perturbed: list[str]
    unperturbed: list[str]
    unloaded: list[str]  # trials of the plate alone
    chosen: WalkingAnalysis

    def trial(self, name: str) -> Path:
        return self.folder / f"trials/{name}.parquet"

    def crossing(self, name: str) -> Path:
        return self.folder / f"crossings/{name}.parquet"

    def read(self, names: list[str]) -> list[Crossing]:
        return [walking_files.read_crossing(self.crossing(name)) for name in names]

    def truth(self, name: str) -> dict[str, Any]:
        return dict(json.loads((self.folder / f"truth/{name}.json").read_text()))

    def table(self, name: str) -> pl.DataFrame:
        return read_table(self.folder / f"{name}.csv")

    def analyse(self, trial: Path, perturbed: bool, output: Path, *direction: str) -> None:
        """One crossing; without what crossings share if there is no such file."""
        calibration, plate, shared = (
            self.folder / f"{name}.json" for name in ("calibration", "plate", "platform")
        )
        platform = shared if shared.exists() else None
        files = (trial, calibration, plate, perturbed, self.chosen, output)
        walking.analyse(*files, *direction, platform=platform)

    def share(self, job: Any, names: list[str], output: str) -> None:
        """What several trials tell together."""
        calibration = self.folder / "calibration.json"
        static = dict.fromkeys(names, "calibration")
        tables = (self.folder / f"{output}.json", self.folder / f"{output}.csv")
        job([self.trial(name) for name in names], [calibration], static, self.chosen, *tables)

    def analysed(self) -> "Session":
        """Run every step."""
        walking.calibrate(self.trial("static_1"), self.chosen, self.folder / "calibration.json")
        self.share(walking.identify_plate, self.unloaded, "plate")
        if len(self.perturbed) > 2:
            self.share(walking.measure_platform, self.perturbed, "platform")
        for name in (*self.perturbed, *self.unperturbed):
            self.analyse(self.trial(name), name in self.perturbed, self.crossing(name))
        self.summarised()
        return self

    def summarised(self, limits: Limits | None = None) -> Tables:
        """The jobs from the crossings to the summary."""
        limits = limits or Limits()
        return run_jobs(self.folder, self.perturbed, self.unperturbed, self.chosen, limits=limits)

    def copied(self, folder: Path) -> "Session":
        """The session with its crossings alone, which may be changed."""
        shutil.copytree(self.folder / "crossings", folder / "crossings")
        return replace(self, folder=folder)

    def rendered(self, quantity: str) -> float:
        """Mean of what the simulated drivetrain rendered."""
        return float(np.mean([self.truth(name)[f"{quantity}_rendered"] for name in self.perturbed]))


def recorded(setup: Setup, folder: Path, **row: Any) -> None:
    """Simulate a trial, write C3D, ingest."""
    trial = row["trial"]
    setup.record(folder, row)
    files = {"mocap": f"vicon/{trial}.c3d", "mocap_source": "vicon"}
    ingest_trial(row | files, folder, ROOT / "config/sources", folder / f"trials/{trial}.parquet")


def record_session(
    setup: Setup, folder: Path, perturbed: int, unperturbed: int, unloaded: int, **choices: Any
) -> Session:
    names = [f"walking_{k:02d}" for k in range(1, perturbed + unperturbed + 1)]
    plates = [f"plate_{k:02d}" for k in range(1, unloaded + 1)]
    recorded(setup, folder, trial="static_1", experiment="static")
    for name in plates:
        recorded(setup, folder, trial=name, experiment="plate")
    for k, name in enumerate(names):
        recorded(setup, folder, trial=name, experiment="walking", perturbed=k < perturbed)
    chosen = settings(**choices)
    return Session(folder, names[:perturbed], names[perturbed:], plates, chosen).analysed()


@pytest.fixture(scope="module")
def ideal(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """No imperfection anywhere."""
    return record_session(load_setup().ideal(), tmp_path_factory.mktemp("ideal"), 2, 3, 1)


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """Every imperfection as shipped; the foot's inertia is known."""
    return record_session(load_setup(), tmp_path_factory.mktemp("real"), 5, 4, 3, foot=FOOT)


@contextmanager
def refused(output: Path, reason: str) -> Iterator[None]:
    """The crossing is refused for a reason like this, with a warning, and its file says so."""
    with pytest.warns(UserWarning, match=reason), suppress(InputError):
        yield
    crossing = walking_files.read_crossing_file(output)
    assert isinstance(crossing, RefusedCrossing)
    assert re.search(reason, crossing.reason)
    with pytest.raises(InputError, match="was refused"):
        walking_files.read_crossing(output)


def test_a_turn_of_the_toes_down_has_its_sign(ideal: Session, tmp_path: Path) -> None:
    row = {"experiment": "walking", "perturbed": True, "direction": "down"}
    recorded(load_setup().ideal(), tmp_path, trial="walking_77", **row)
    trial = tmp_path / "trials/walking_77.parquet"

    ideal.analyse(trial, True, tmp_path / "down.parquet", "down")

    down = walking_files.read_crossing(tmp_path / "down.parquet")
    assert np.rad2deg(down.turn) == pytest.approx(-5, abs=0.1)
    assert {crossing.sign for crossing in ideal.read(ideal.perturbed)} == {1}
    contradiction = r"walking_77: the platform turned by -5\.\d deg .* expected 'down'"
    with refused(tmp_path / "up.parquet", contradiction):
        ideal.analyse(trial, True, tmp_path / "up.parquet", "up")


@pytest.mark.parametrize("estimator", ["mean of perturbations", "ensemble"])
def test_the_rendered_impedance_comes_out_with_all_imperfections(
    real: Session, estimator: str
) -> None:
    """5 + 4 crossings that scatter by 13 N*m/rad: the standard error is 2 %."""
    K, B, I = (Tables(real.folder).estimate("all", name, estimator) for name in "KBI")

    assert K["mean"] == pytest.approx(real.rendered("K"), rel=0.05)
    assert B["mean"] == pytest.approx(real.rendered("B"), rel=0.1)
    assert I["mean"] == pytest.approx(real.rendered("I"), abs=0.01)
    assert K["low"] < real.rendered("K") < K["high"]
    assert 1 < K["se"] < 12


def test_onsets_are_found_to_half_a_millisecond(real: Session) -> None:
    late_s = [c.onset - real.truth(c.name)["onset_s"] for c in real.read(real.perturbed)]

    assert np.abs(late_s).max() < 5e-4


def test_the_residuals_of_the_clusters_are_the_noise_of_the_markers(real: Session) -> None:
    """0.15 mm, over three axes less six freedoms of twelve."""
    table = real.table("selection")

    assert set(table["status"]) == {"used"}
    for segment in ("foot", "shank", "platform"):
        np.testing.assert_allclose(table[f"{segment}_residual_mm"], 0.15 * np.sqrt(3 / 2), rtol=0.1)
    assert (table["plate_zero_N"].abs() < 8).all()  # 2 N of offset drawn per trial


def test_the_plate_s_lag_and_its_own_wrench_come_out(real: Session) -> None:
    effects = real.truth("plate_01")["gait_laboratory"]["effects"]

    plate = real.table("plate")

    assert plate["lag_s"][0] == pytest.approx(1e-3 * effects["plate_lag"]["size"], abs=1e-4)
    assert 0 < plate["lag_se_s"][0] < 1e-4
    assert plate["trials"].to_list() == [3] * 6
    left_percent = (100 * plate["rms_after"] / plate["rms_before"]).to_list()
    assert plate["left_percent"].to_list() == pytest.approx(left_percent)
    moving = plate.filter(pl.col("component").is_in(["F_x", "F_z", "M_y"]))
    assert (moving["left_percent"] < 10).all()


def pilot(folder: Path, perturbed: int) -> Path:
    """Crossings by formula; the platform turns by 3 deg within 120 ms at 30 % of stance."""
    walks = several("p", perturbed, Walk(0.3)) | several("u", 8, Walk())
    for name, walk in walks.items():
        crossing = walked(name, walk)
        if crossing.onset is not None:
            turn = np.deg2rad(3) * step(crossing.time, crossing.onset, 0.12)[0]
            crossing = replace(crossing, platform=turn, turn=np.deg2rad(3))
        walking_files.write_crossing(crossing, folder / f"crossings/{name}.parquet")
    rows = [{"trial": name, "perturbed": walk.phase is not None} for name, walk in walks.items()]
    table = pl.DataFrame(rows).with_columns(reason=None, gait=None)
    write_table(table, folder / "tables/walking_crossings.csv")
    return folder


@dataclass(frozen=True)
class Plan:
    """What `design-walking` assumes, and what it promises."""

    turn_deg: float
    ramp_ms: float
    phase_percent: float
    K_half_width: float  # [N*m/rad] of eight crossings


def planned(folder: Path, *options: str) -> Plan:
    arguments = [str(folder), "--crossings", "8", *options]
    config = ["--config", str(ROOT / "config/config.yaml")]
    done = CliRunner().invoke(main, ["design-walking", *arguments, *config], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    assumed = re.search(r"a turn of (\S+) deg in (\S+) ms at (\S+) % of stance", done.stdout)
    assert assumed is not None
    K_half_width = done.stdout.splitlines()[-1].split()[2]
    return Plan(*(float(number) for number in (*assumed.groups(), K_half_width)))


def test_a_plan_from_unperturbed_crossings_alone_assumes_the_usual_turn(tmp_path: Path) -> None:
    plot = tmp_path / "plan.png"

    plan = planned(pilot(tmp_path, perturbed=0), "--plot", str(plot))

    assert (plan.turn_deg, plan.ramp_ms, plan.phase_percent) == (5, 80, 40)
    assert plot.read_bytes()[1:4] == b"PNG"


def test_a_plan_takes_what_is_stated_and_the_rest_from_the_pilot(tmp_path: Path) -> None:
    folder = pilot(tmp_path, perturbed=3)

    measured = planned(folder)
    larger = planned(folder, "--turn", "6")
    stated = planned(folder, "--turn", "6", "--ramp", "50", "--phase", "45")

    assert measured.turn_deg == pytest.approx(3, abs=0.01)
    assert measured.ramp_ms == pytest.approx(120, rel=0.03)
    assert measured.phase_percent == pytest.approx(30, abs=1)
    assert larger.turn_deg == 6
    assert larger.ramp_ms == measured.ramp_ms
    assert larger.phase_percent == measured.phase_percent
    assert larger.K_half_width == pytest.approx(measured.K_half_width / 2, rel=0.15)
    assert (stated.turn_deg, stated.ramp_ms, stated.phase_percent) == (6, 50, 45)


def exact(session: Session, crossing: Crossing) -> Crossing:
    """The crossing with its true angle and torque, through the low-pass of the analysis."""
    truth = pl.read_parquet(session.folder / f"truth/{crossing.name}.parquet").gather_every(5)
    rows = np.searchsorted(truth["time"].to_numpy(), crossing.time - 1e-6)
    theta, torque = (
        session.chosen.low_pass(truth[name].to_numpy(), 300.0)[rows] for name in ("theta", "torque")
    )
    return replace(crossing, theta=theta, torque=torque)


def test_without_imperfections_angle_and_torque_are_the_true_ones(ideal: Session) -> None:
    """What is left is the file's single precision, and a low-pass of products that is not the
    product of low-passes."""
    for crossing in ideal.read([*ideal.perturbed, *ideal.unperturbed]):
        truth = exact(ideal, crossing)

        since = crossing.time - crossing.stance.heel_strike
        inside = (since > 0.1) & (since < crossing.stance.duration - 0.1)
        theta_error = (crossing.theta - truth.theta)[inside]
        torque_error = (crossing.torque - truth.torque)[inside]
        assert np.abs(theta_error).max() < np.deg2rad(0.005)
        assert np.abs(torque_error).max() < 0.2


def test_without_imperfections_the_impedance_is_that_of_the_true_curves(ideal: Session) -> None:
    """The leg is of third order, so that K, B and I depend on the filter: the exact curves pass it
    too."""
    perturbed = ideal.read(ideal.perturbed)
    unperturbed = ideal.read(ideal.unperturbed)
    gait = unperturbed_gait(unperturbed, 3)
    true_gait = unperturbed_gait([exact(ideal, crossing) for crossing in unperturbed], 3)

    for crossing in perturbed:
        measured = fit_response(isolate_response(crossing, gait, ideal.chosen))
        true = fit_response(isolate_response(exact(ideal, crossing), true_gait, ideal.chosen))

        assert measured["K"] == pytest.approx(true["K"], abs=0.06)
        assert measured["B"] == pytest.approx(true["B"], abs=0.005)
        assert measured["I"] == pytest.approx(true["I"], abs=1e-4)


def page_of(session: Session, tables: Path) -> pl.DataFrame:
    """Points of the walking page, with the tables in a folder."""
    names = {
        "selection": "selection.csv",
        "unperturbed": "gait.parquet",
        "responses": "responses.csv",
        "table": "walking.csv",
    }
    plot_walking_page(
        crossings=[session.crossing(name) for name in session.perturbed],
        settings=session.chosen,
        output=session.folder / "page.csv",
        **{name: tables / file for name, file in names.items()},
    )
    return session.table("page")


def test_what_cannot_be_used_is_listed_and_the_rest_goes_on(real: Session, tmp_path: Path) -> None:
    """A hidden cluster, a platform that did not move, a plate at its limit, a foot put down
    elsewhere."""
    session = real.copied(tmp_path)
    blind, still, elsewhere = session.perturbed[:3]
    cut, flat = session.unperturbed[:2]
    trials = {name: read_trial(real.trial(name)) for name in (blind, still, cut, flat)}
    faulty = {
        blind: hidden(trials[blind], ("FOOT1", "FOOT2"), 1.2, 1.6),
        still: replace(trials[still], samples=trials[flat].samples),
        cut: changed(trials[cut], pl.col("plate1_force_z").clip(upper_bound=600)),
    }
    for name, trial in faulty.items():
        write_trial(trial, tmp_path / "trial.parquet")
        with pytest.warns(UserWarning, match=f"excluded: trial {name}"):
            real.analyse(tmp_path / "trial.parquet", name != cut, session.crossing(name))
    (outlier,) = session.read([elsewhere])
    moved = replace(outlier, quality=replace(outlier.quality, foot_forward_m=0.2))
    walking_files.write_crossing(moved, session.crossing(elsewhere))

    tables = session.summarised()

    listed = dict(tables["excluded"].select("trial", "reason").iter_rows())
    assert list(listed) == [blind, still, elsewhere, cut]
    assert "foot markers cannot be followed" in listed[blind]
    assert "does not turn but the sheet says perturbed" in listed[still]
    assert "foot forward 0.2 m lies" in listed[elsewhere]
    assert "Fz stays at 60" in listed[cut]
    assert set(tables["summary"]["n"]) == {2}
    assert tables.estimate("all")["mean"] == pytest.approx(real.rendered("K"), rel=0.05)
    gaits = page_of(session, tmp_path).filter(panel="angle").drop_nulls("n")
    assert set(gaits.select("curve", "n").iter_rows()) == {("perturbed", 2), ("unperturbed", 3)}


def test_doubtful_crossings_are_counted_and_named_on_the_page(
    real: Session, tmp_path: Path
) -> None:
    session = real.copied(tmp_path)

    tables = session.summarised(limits=Limits(above={"K": real.rendered("K")}))

    doubtful = set(tables["walking"].filter(pl.col("K") > real.rendered("K"))["trial"])
    page = page_of(session, tmp_path).filter(pl.col("curve") == "each", pl.col("doubtful") != "")
    assert 0 < len(doubtful) < 5
    assert set(page["trial"]) == doubtful
    assert tables["summary"]["n_doubtful"].drop_nulls().unique().to_list() == [len(doubtful)]


def test_the_page_shows_each_direction_apart(real: Session, tmp_path: Path) -> None:
    """A mean of a single crossing has no scatter."""
    session = real.copied(tmp_path)
    (turned,) = session.read(session.perturbed[:1])
    walking_files.write_crossing(replace(turned, turn=-turned.turn), session.crossing(turned.name))

    page = page_of(session, real.folder).filter(panel="angle").drop_nulls("n")

    assert set(page["curve"]) == {"unperturbed", "perturbed up", "perturbed down"}
    assert page.filter(curve="perturbed down")["sd"].is_null().all()
    assert not page.filter(curve="perturbed up")["sd"].is_null().any()


@dataclass(frozen=True)
class Hiding:
    """Analyses a trial of a session with markers hidden between two times [s]."""

    session: Session
    folder: Path

    @property
    def output(self) -> Path:
        return self.folder / "crossing.parquet"

    def analyse(self, name: str, markers: tuple[str, ...], start: float, end: float) -> Crossing:
        trial = hidden(read_trial(self.session.trial(name)), markers, start, end)
        write_trial(trial, self.folder / "hidden.parquet")
        perturbed = name in self.session.perturbed
        self.session.analyse(self.folder / "hidden.parquet", perturbed, self.output)
        return walking_files.read_crossing(self.output)


def test_a_cluster_that_is_hidden_for_30_ms_is_bridged(ideal: Session, tmp_path: Path) -> None:
    name = ideal.unperturbed[0]
    (whole,) = ideal.read([name])

    bridged = Hiding(ideal, tmp_path).analyse(name, ("SHANK1", "SHANK4"), 1.2, 1.23)

    assert bridged.bridged == pytest.approx(0.03 / bridged.stance.duration, rel=0.12)
    np.testing.assert_allclose(bridged.theta, whole.theta, atol=np.deg2rad(0.1))


def test_a_cluster_that_is_hidden_for_200_ms_is_refused(ideal: Session, tmp_path: Path) -> None:
    name = ideal.unperturbed[0]
    hiding = Hiding(ideal, tmp_path)

    with refused(
        hiding.output, rf"trial {name}: the shank markers cannot be followed at 1\.2\d+ s"
    ):
        hiding.analyse(name, ("SHANK1", "SHANK4"), 1.2, 1.4)


def test_while_the_perturbation_is_fitted_7_ms_are_bridged_and_30_ms_refused(
    ideal: Session, tmp_path: Path
) -> None:
    name = ideal.perturbed[0]
    onset = ideal.read([name])[0].onset
    foot = ("FOOT1", "FOOT2")
    hiding = Hiding(ideal, tmp_path)

    assert hiding.analyse(name, foot, onset + 0.03, onset + 0.037).bridged > 0
    assert hiding.analyse(name, foot, onset - 0.15, onset - 0.12).bridged > 0
    for segment, markers in (("foot", foot), ("platform", ("PLAT1", "PLAT2"))):
        reason = rf"the {segment} markers are hidden for \d+ ms from 1\.\d+ s, while the pert"
        with refused(hiding.output, reason):
            hiding.analyse(name, markers, onset + 0.03, onset + 0.06)


def test_a_crossing_knows_what_each_trial_of_the_plate_does_to_its_torque(
    real: Session, tmp_path: Path
) -> None:
    plate = walking_files.read_model(real.folder / "plate.json", PlateModel)
    files = (real.trial(real.perturbed[0]), real.folder / "calibration.json")

    def crossing_with(model: PlateModel) -> Crossing:
        walking_files.write_model(model, tmp_path / "plate.json")
        output = tmp_path / "crossing.parquet"
        walking.analyse(
            *files, tmp_path / "plate.json", True, real.chosen, output, body_mass_kg=77.0
        )
        return walking_files.read_crossing(output)

    crossing = crossing_with(plate)
    without = crossing_with(plate.leave_one_out[1])

    assert len(crossing.plate_errors) == 3
    assert np.abs(crossing.plate_errors[1]).max() > 1e-3
    change = without.torque - crossing.torque
    np.testing.assert_allclose(crossing.plate_errors[1], change, atol=1e-9)
    assert without.plate_errors.shape == (0, len(without.time))
    assert crossing.body_mass == 77.0


def test_the_stored_gait_has_the_errors_of_the_plate(real: Session) -> None:
    expected = unperturbed_gait(real.read(real.unperturbed), 3)

    (gait,) = walking_files.read_unperturbed_gaits(real.folder / "gait.parquet").values()

    np.testing.assert_array_equal(gait.plate_errors, expected.plate_errors)


def without_reference_marker(calibration: Path, marker: str, output: Path) -> Path:
    """A static calibration that lacks a marker."""
    content = json.loads(calibration.read_text())
    content["markers"].pop(marker, None)
    output.write_text(json.dumps(content))
    return output


@pytest.mark.parametrize(
    ("turns", "perturbed", "lost_column", "lost_marker", "reason"),
    [
        (True, False, "", "", "the platform .* sheet says perturbed = false"),
        (False, False, "marker_FOOT3_x", "",
         "no marker 'FOOT3'; correct `walking.markers` .*; did you mean 'FOOT[124]'"),
        (False, False, "", "FOOT2", "marker FOOT2 is not in the static calibration"),
    ],
)  # fmt: skip
def test_what_contradicts_sheet_markers_or_calibration_is_refused_by_name(
    ideal: Session, tmp_path: Path, turns: bool, perturbed: bool, lost_column: str,
    lost_marker: str, reason: str,
) -> None:  # fmt: skip
    name = ideal.perturbed[0] if turns else ideal.unperturbed[0]
    trial = read_trial(ideal.trial(name))
    samples = trial.samples.drop(lost_column, strict=False)
    write_trial(replace(trial, samples=samples), tmp_path / "t.parquet")
    calibration = without_reference_marker(
        ideal.folder / "calibration.json", lost_marker, tmp_path / "calibration.json"
    )
    output = tmp_path / "crossing.parquet"
    files = (tmp_path / "t.parquet", calibration, ideal.folder / "plate.json")

    with refused(output, f"trial {name}: {reason}"):
        walking.analyse(*files, perturbed, ideal.chosen, output)

    assert walking_files.read_crossing_file(output).perturbed == perturbed


def test_each_trial_has_the_static_calibration_that_it_names(
    ideal: Session, tmp_path: Path
) -> None:
    calibration = ideal.folder / "calibration.json"
    other = without_reference_marker(calibration, "FOOT2", tmp_path / "other.json")
    first, second = ideal.perturbed
    named = {first: "other", second: "calibration", "absent": "unread"}
    trials = [ideal.trial(second), ideal.trial(first)]

    pairs = walking.calibrated_trials(trials, [calibration, other], named)

    has_marker = {trial.name: "FOOT2" in static.markers for trial, static in pairs}
    assert has_marker == {second: True, first: False}


def test_a_single_perturbation_is_too_few(ideal: Session, tmp_path: Path) -> None:
    single = replace(ideal.copied(tmp_path), perturbed=ideal.perturbed[:1])

    with pytest.raises(InputError, match="1 of 1 perturbations can be used, expected 2 or more"):
        single.summarised()


def test_a_missing_file_between_the_steps_names_the_step(ideal: Session, tmp_path: Path) -> None:
    selection = ideal.folder / "selection.csv"
    crossing = ideal.crossing(ideal.perturbed[0])

    with pytest.raises(
        InputError, match=r"plate\.json: no such file; run the step 'identify-plate'"
    ):
        walking_files.read_model(tmp_path / "plate.json", PlateModel)
    with pytest.raises(InputError, match="no such file; run the step 'average-unperturbed'"):
        walking.fit_perturbation(
            crossing, selection, tmp_path / "n.parquet", ideal.chosen, tmp_path / "fit.csv"
        )


@pytest.mark.parametrize("content", ["{", "{}", "[]"])
def test_a_damaged_model_names_the_step(tmp_path: Path, content: str) -> None:
    (tmp_path / "plate.json").write_text(content)

    with pytest.raises(InputError, match=r"plate\.json: not what .* run the step 'identify-plate'"):
        walking_files.read_model(tmp_path / "plate.json", PlateModel)


def test_a_trial_in_place_of_a_crossing_is_refused(ideal: Session) -> None:
    with pytest.raises(InputError, match="a trial without events"):
        walking_files.read_crossing(ideal.trial(ideal.unperturbed[0]))


def test_a_window_of_fewer_samples_than_parameters_is_listed(
    ideal: Session, tmp_path: Path
) -> None:
    crossing = ideal.crossing(ideal.perturbed[0])
    tables = (ideal.folder / "selection.csv", ideal.folder / "gait.parquet")

    with pytest.warns(UserWarning, match="excluded: trial walking_01: 3 samples cannot determine"):
        walking.fit_perturbation(crossing, *tables, settings(window_s=0.009), tmp_path / "fit.csv")

    (row,) = read_table(tmp_path / "fit.csv").to_dicts()
    assert row["K"] is None
    assert "samples cannot determine 3 parameters" in row["excluded"]


REAL = Path(__file__).parents[2] / "shared" / "real_data"
MASS = 70.0
KNOWN = OvergroundAnalysis(load_on_n=50, body_mass_kg=MASS)
PEAK = 0.12 * 800 / MASS  # [N*m/kg] of the load of `gait_trial`


def gait_trial(side: str = "left", over: float = 0.0) -> Trial:
    """0.5 to 1.5 s on plate 1, load 0.12 m ahead of the ankle at `over` [m]. The laboratory's
    moment is 5 % larger."""
    time = np.arange(2 * PLATE_RATE) / PLATE_RATE
    load = 800 * np.clip(np.minimum(time - 0.5, 1.5 - time) / 0.1, 0, 1)
    force = np.outer(load, [0.0, 0.0, 1.0])
    ankle = np.array([over, 0.03, 0.09])
    ahead = np.array([over + 0.12, 0.03, 0.0])
    letter = side[0].upper()
    places = {f"{letter}TIO": ankle, f"{letter}TIL": ankle + np.array([0.0, 0.1, 0.0])}
    markers = {label: np.tile(place, (len(time) // 5, 1)) for label, place in places.items()}
    trial = recording("gait_1", markers, force, np.cross(ahead, force))
    is_frame = pl.arange(0, len(time)) % 5 == 0
    moments = pl.when(is_frame).then(pl.Series(1.05 * 0.12 * load / MASS))
    return changed(trial, **{f"reference_ankle_moment_{side}": moments})


def overground_rows(trial: Trial, settings: OvergroundAnalysis = KNOWN) -> list[dict[str, Any]]:
    """Rows of `ankle_moment.csv`, with their curves."""
    return [contact.row() for contact in overground_contacts(trial, settings)]


def numbers_of(row: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in row.items() if name not in CURVES}


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_moment_of_a_known_load_comes_out_in_stance(side: str) -> None:
    """Loaded above 50 N from 0.50625 to 1.49375 s."""
    (row,) = overground_rows(gait_trial(side))

    assert (row["side"], row["plate"]) == (side, 1)
    assert row["heel_strike_s"] == pytest.approx(0.50625, abs=1e-3)
    assert row["toe_off_s"] == pytest.approx(1.49375, abs=1e-3)
    assert row["frames"] == pytest.approx(0.9875 * RATE, abs=1)
    assert row["moment_at_peak"] == pytest.approx(PEAK, rel=2e-3)
    assert row["slope"] == pytest.approx(1.05, abs=1e-3)
    assert row["correlation"] == pytest.approx(1, abs=1e-5)


def test_the_order_of_the_corners_does_not_matter() -> None:
    trial = gait_trial()
    turned = replace(trial, provenance={"plates": [{"plate": 1, "corners": CORNERS[::-1]}]})

    (row,) = overground_rows(trial)
    (same,) = overground_rows(turned)

    assert numbers_of(same) == numbers_of(row)


def test_moments_are_compared_where_both_are_known() -> None:
    column = "reference_ankle_moment_left"

    def known_until(end: float) -> Trial:
        unknown = pl.lit(np.nan) + 0 * pl.col(column)
        kept = pl.when(pl.col("time") < end).then(column).otherwise(unknown)
        return changed(gait_trial(), kept.alias(column))

    (half,) = overground_rows(known_until(1.0))
    (none,) = overground_rows(known_until(0.0))

    assert half["frames"] == pytest.approx(0.49375 * RATE, abs=1)
    assert half["slope"] == pytest.approx(1.05, abs=1e-3)
    assert none["frames"] == pytest.approx(0.9875 * RATE, abs=1)
    assert none["slope"] is None
    assert none["peak_moment"] == pytest.approx(PEAK, rel=2e-3)


def test_the_moment_is_per_kilogram_of_the_sheet() -> None:
    tables = walking.compare_ankle_moment(gait_trial(), KNOWN, {"body_mass_kg": 60.0})

    moment = tables["ankle_moment"]["moment_at_peak"][0]
    assert moment == pytest.approx(PEAK * MASS / 60, rel=2e-3)


def with_subject(trial: Trial, subject: str) -> Trial:
    names = {
        name: name.replace("marker_", f"marker_{subject}:")
        for name in trial.samples.columns
        if name.startswith("marker_")
    }
    return replace(trial, samples=trial.samples.rename(names))


def without_columns(trial: Trial, pattern: str) -> Trial:
    return replace(trial, samples=trial.samples.select(pl.exclude(pattern)))


@pytest.mark.parametrize(
    ("trial", "known", "message"),
    [
        (gait_trial(over=0.3), KNOWN, "gait_1: no foot stands on a plate"),
        (replace(gait_trial(), provenance={}), KNOWN, "of a C3D under `plate_geometry`"),
        (without_columns(gait_trial(), "^marker_LTI.*$"), KNOWN,
         r"gait_1: no marker of an ankle; name one under overground\.lateral_malleolus"),
        (with_subject(gait_trial(), "P07"), KNOWN,
         r"with its prefix \(there are P07\), as 'P07:\?ANK', and likewise medial_malleolus"),
        (gait_trial(), OvergroundAnalysis(load_on_n=50),
         r"states no body mass; state body_mass_kg in the sheet, or overground\.body"),
        (changed(gait_trial(), pl.col("plate1_force_z") - 110.0), KNOWN,
         "trial gait_1: force plate 1 reads -110 N"),
    ],
)  # fmt: skip
def test_what_cannot_be_compared_is_refused_with_the_remedy(
    trial: Trial, known: OvergroundAnalysis, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        overground_rows(trial, known)


@pytest.mark.parametrize("offset", [-90.0, 110.0])
def test_a_plate_is_refused_only_if_it_pulls_by_more_than_noise(offset: float) -> None:
    known = KNOWN.model_copy(update={"load_on_n": 200.0})

    assert overground_rows(changed(gait_trial(), pl.col("plate1_force_z") + offset), known)


Place = tuple[float, float, float]


def steps(feet: dict[str, Place], contacts: tuple[tuple[float, float], ...], names: str) -> Trial:
    """Feet, each at y [m] and at rest at x = 0 from one time to another [s], walk at 3 m/s before
    and after. Their toes are out by 20 deg. A load of 800 N and 80 N forward acts 0.12 m before the
    left ankle, on the ground. The names are those of the lateral and medial malleolus, heel and
    toe."""
    time = np.arange(0, 3, 1 / PLATE_RATE)
    frames = time[::5]
    out = np.array([np.cos(ACROSS), np.sin(ACROSS), 0.0])
    load = sum(np.clip(np.minimum(time - on, off - time) / 0.1, 0, 1) for on, off in contacts)
    force = np.outer(load, [80.0, 0.0, 800.0])
    markers = {}
    for side, (y, on, off) in feet.items():
        sign = 1 if side == "L" else -1
        x = 3.0 * (np.minimum(frames - on, 0) + np.maximum(frames - off, 0))
        path = np.column_stack([x, 0 * x, 0.1 * (np.abs(x) > 0)])
        places = (
            np.array([0.0, 0.04 * sign, 0.09]),
            np.array([0.0, -0.04 * sign, 0.09]),
            -0.05 * out * [1, sign, 0],
            0.15 * out * [1, sign, 0],
        )
        for place, name in zip(places, names.split(), strict=False):
            markers[name.replace("?", side)] = place + np.array([0.0, y, 0.02]) + path
    ahead = np.array([0.12, 0.0, 0.0])
    return recording("gait_1", markers, force, np.cross(ahead, force))


QTM = "?_FAL ?_TAM ?_FCC ?_FM2"
ONE_FOOT = {"L": (0.0, 1.0, 1.7)}
CONTACT = ((1.0, 1.7),)
ACROSS = np.deg2rad(20)
# of 800 N 0.12 m ahead, and 80 N 0.11 m below the ankle [N*m]
MOMENT = 96.0 + 8.8
# The axis is turned by 20 deg, and goes through a point 0.04 m beside the ankle's centre
MOMENT_ACROSS_FOOT = MOMENT * np.cos(ACROSS) - 32 * np.sin(ACROSS)


@pytest.mark.parametrize(
    ("names", "axis_from", "moment"),
    [
        (QTM, "L_FAL to L_TAM", MOMENT),
        ("?LM ?MM", "LLM to LMM", MOMENT),
        ("?.Ankle.Lat ?.Ankle.Med ?.Heel ?.Toe.Tip", "L.Ankle.Lat to L.Ankle.Med", MOMENT),
        ("?ANK - ?HEE ?TOE", "LANK, across LHEE to LTOE", MOMENT_ACROSS_FOOT),
        ("?ANK", "LANK, across its way", MOMENT),
    ],
)
def test_the_ankle_s_axis_is_from_the_markers_that_exist(
    names: str, axis_from: str, moment: float
) -> None:
    (row,) = overground_rows(steps(ONE_FOOT, CONTACT, names))

    assert row["axis_from"] == axis_from
    assert row["excluded"] is None
    assert row["side"] == "left"
    assert row["peak_moment"] == pytest.approx(moment / MASS, rel=2e-3)
    assert row["slope"] is None
    assert row["moment_at_peak"] is None


def test_a_right_foot_has_the_same_moment() -> None:
    (row,) = overground_rows(steps({"R": ONE_FOOT["L"]}, CONTACT, "?LM ?MM"))

    assert row["side"] == "right"
    assert row["peak_moment"] == pytest.approx(MOMENT / MASS, rel=2e-3)


def test_the_curve_over_stance_has_the_moment_of_each_frame() -> None:
    tables = walking.compare_ankle_moment(steps(ONE_FOOT, CONTACT, QTM), KNOWN)

    curves = tables["ankle_moment_curves"]
    middle = curves.filter(pl.col("phase").is_between(0.2, 0.8))["moment"].to_numpy()
    assert middle == pytest.approx(MOMENT / MASS, rel=0.01)
    assert len(curves) == tables["ankle_moment"]["frames"][0]
    assert curves["reference_moment"].is_null().all()


BOTH_FEET = ONE_FOOT | {"R": (-0.15, 1.5, 2.2)}
LONG = ((1.0, 2.2),)


def reasons_of(trial: Trial, **changes: float) -> list[Any]:
    """Why each contact is excluded."""
    return [row["excluded"] for row in overground_rows(trial, KNOWN.model_copy(update=changes))]


def test_two_feet_on_one_plate_are_excluded_with_a_warning() -> None:
    reason = "the right foot stands on the same plate in 58 % of the contact"
    trial = steps(BOTH_FEET, LONG, QTM)

    with warnings.catch_warnings(record=True, action="always") as caught:
        tables = walking.compare_ankle_moment(trial, KNOWN)

    assert tables["ankle_moment"]["excluded"][0] == reason
    assert tables["ankle_moment"]["peak_moment"][0] is None
    message = r"the left stance at 1\.\d\d s on plate 1 is excluded: the right foot"
    assert re.search(message, str(caught[0].message))


def test_the_ankle_alone_shows_a_second_foot() -> None:
    assert "the right foot stands" in reasons_of(steps(BOTH_FEET, LONG, "?ANK"))[0]


def test_a_foot_rests_on_a_plate_that_is_higher_than_the_floor() -> None:
    trial = steps(ONE_FOOT, CONTACT, QTM)
    x = pl.col("marker_L_FCC_x")
    floor = [
        pl.when(x.abs() < 0.5).then(pl.col(name)).otherwise(pl.col(name) - 0.2).alias(name)
        for name in trial.samples.columns
        if name.startswith("marker_L_") and name.endswith("_z")
    ]

    assert reasons_of(replace(trial, samples=trial.samples.with_columns(floor))) == [None]


def test_a_foot_that_left_before_is_no_second_one() -> None:
    earlier = ONE_FOOT | {"R": (-0.15, 0.2, 0.7)}

    assert reasons_of(steps(earlier, CONTACT, QTM)) == [None]


def test_an_unseen_second_foot_loads_the_plate_for_longer_than_the_first() -> None:
    (reason,) = reasons_of(steps(ONE_FOOT, LONG, QTM))

    assert reason == "heel and toe rest on the plate in 58 % of the contact: a second foot"
    assert reasons_of(steps(ONE_FOOT, LONG, "?ANK ?MED")) == [None]


def test_a_contact_much_longer_than_others_is_excluded() -> None:
    trial = steps({"L": (0.0, 0.2, 2.3)}, ((0.2, 0.7), (1.0, 2.2)), "?ANK ?MED")
    reason = "a contact of 1.19 s where others last 0.49 s: a second foot, or a plate off zero"

    assert reasons_of(trial) == [None, reason]
    assert reasons_of(trial, longest_contact=2.5) == [None, None]


def test_the_foot_that_the_forces_are_of_is_the_only_one_on_its_plate() -> None:
    """As OpenSim's files state it, of a floor on which both feet stand."""
    trial = steps(ONE_FOOT | {"R": (-0.15, 1.0, 1.7)}, CONTACT, "?LM ?MM")
    plate = trial.provenance["plates"][0]
    of_left = replace(trial, provenance={"plates": [{**plate, "foot": "left"}]})

    (row,) = overground_rows(of_left)

    assert (row["side"], row["excluded"]) == ("left", None)
    assert row["peak_moment"] == pytest.approx(MOMENT / MASS, rel=2e-3)
    assert "the right foot stands" in reasons_of(trial)[0]


@pytest.mark.parametrize(("factor", "side"), [(1.0, None), (-1.0, "below"), (3.0, "above")])
def test_a_moment_unlike_walking_is_doubtful(factor: float, side: str | None) -> None:
    shipped = yaml.safe_load((ROOT / "config/config.yaml").read_text())
    limits = Limits.model_validate(shipped["doubtful"]["ankle_moment"])
    trial = steps(ONE_FOOT, CONTACT, "?ANK ?MED")
    scaled = changed(trial, *(pl.col(name) * factor for name in plate_columns(1, "moment")))

    table = walking.compare_ankle_moment(scaled, KNOWN)["ankle_moment"]

    late = table.with_columns(peak_phase=pl.lit(0.8)).row(0, named=True)
    doubts = findings_of(late, limits, "ankle_moment")
    assert [doubt.cause for doubt in doubts] == ([] if side is None else ["moment unlike walking"])
    assert beyond_in(doubts) == ({} if side is None else {"peak_moment": side})


def mass_of(sheet: float | None, recorded: float | None, configured: float | None) -> float | None:
    trial = replace(gait_trial(), provenance={"mocap": {"body_mass_kg": recorded}})
    return body_mass(trial, sheet, configured)


@pytest.mark.parametrize(
    ("sheet", "recorded", "configured", "mass"),
    [(70.0, 76.0, 50.0, 70.0), (None, 74.0, 50.0, 74.0), (None, None, 50.0, 50.0),
     (None, 0.0, None, None)],
)  # fmt: skip
def test_the_mass_is_the_sheet_s_else_the_recording_s_else_the_campaign_s(
    sheet: float | None, recorded: float | None, configured: float | None, mass: float | None
) -> None:
    assert mass_of(sheet, recorded, configured) == mass


@pytest.mark.parametrize(
    ("sheet", "recorded", "message"),
    [
        (70.0, 79.0, "body_mass_kg is 70 in the sheet and 79 in the recording; correct the sheet"),
        (None, 9.0, "a body mass of 9 kg, from the recording, is not one of a person"),
        (None, 310.0, "a body mass of 310 kg, from the recording, is not one of a person"),
    ],
)
def test_a_contradicting_or_impossible_mass_is_refused(
    sheet: float | None, recorded: float, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        mass_of(sheet, recorded, None)


UNKNOWN = OvergroundAnalysis(load_on_n=50)


@pytest.fixture(scope="module")
def plug_in_gait(tmp_path_factory: pytest.TempPathFactory) -> Trial:
    """A public recording with the moments of Plug-in Gait."""
    if not REAL.is_dir():
        pytest.skip("the recordings of others are not here")
    path = tmp_path_factory.mktemp("pig") / "pig.parquet"
    row = {"trial": "pig", "mocap": "btk_PiG_Motion3_FF.c3d", "mocap_source": "plug_in_gait"}
    ingest_trial(row, REAL / "c3d", ROOT / "config/sources", path)
    return read_trial(path)


def test_agrees_with_plug_in_gait_as_the_published_reference_does(plug_in_gait: Trial) -> None:
    """The reference is half a frame late: without delay the correlation is better, slope and peak
    move by below 1 %."""
    reference = pl.read_csv(REAL / "reference/ankle_moment.csv").sort("side", "plate")

    table = walking.compare_ankle_moment(plug_in_gait, UNKNOWN)["ankle_moment"].sort(
        "side", "plate"
    )

    same = reference.select(pl.col("plate") + 1, body_mass_kg="mass_kg", frames="n_frames")
    assert table.select(same.columns).rows() == same.rows()
    assert (table["correlation"] > np.maximum(-reference["corr"], 0.998)).all()
    np.testing.assert_allclose(table["slope"], -reference["slope"], rtol=0.01)
    peak, at_peak = (
        reference["pig_peak_Nmm_per_kg"],
        reference["own_quasistatic_at_peak_Nmm_per_kg"],
    )
    np.testing.assert_allclose(table["reference_peak"] * 1e3, peak, rtol=1e-5)
    np.testing.assert_allclose(table["moment_at_peak"] * 1e3, at_peak, rtol=0.01)


@pytest.mark.parametrize(
    ("lost", "largest_error"),
    [("LTIL|RTIL", 0.05), ("[LR]TI[LO]", 0.09), ("[LR](TI[LO]|HEE|TOE)", 0.13)],
)
def test_fewer_markers_cost_accuracy_but_the_reference_is_not_used(
    plug_in_gait: Trial, lost: str, largest_error: float
) -> None:
    fewer = without_columns(plug_in_gait, f"^marker_({lost})_[xyz]$")

    compared = walking.compare_ankle_moment(fewer, UNKNOWN)["ankle_moment"]
    alone = walking.compare_ankle_moment(without_columns(fewer, "^reference_.*$"), UNKNOWN)

    assert compared["excluded"].null_count() == 3
    assert (compared["correlation"] > 0.998).all()
    np.testing.assert_allclose(
        compared["peak_moment"], compared["reference_peak"], rtol=largest_error
    )
    np.testing.assert_allclose(
        alone["ankle_moment"]["peak_moment"], compared["peak_moment"], rtol=1e-12
    )
