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
from walking_crossings import Tables, run_jobs
from walking_setup import Setup, load_setup
from walking_synthetic import CORNERS, PLATE_RATE, RATE, changed, hidden, recording, settings

from osl_analysis.cli import main
from osl_analysis.commands import walking as jobs
from osl_analysis.commands.figure import plot_walking_page
from osl_analysis.commands.trials import ingest_trial
from osl_analysis.commands.walking import compare_ankle_moment
from osl_analysis.errors import InputError
from osl_analysis.judge.finding import Limits
from osl_analysis.simulator.step import smooth_step
from osl_analysis.table import read_table
from osl_analysis.trial import Trial, plate_columns, read_trial, write_trial
from osl_analysis.walking.crossing import Crossing, RefusedCrossing
from osl_analysis.walking.impedance_fit import fit_response
from osl_analysis.walking.isolated_response import isolate_response
from osl_analysis.walking.overground import CURVES, overground_contacts
from osl_analysis.walking.plate_model import PlateModel
from osl_analysis.walking.settings import OvergroundAnalysis, WalkingAnalysis
from osl_analysis.walking.setup_checks import body_mass
from osl_analysis.walking.unperturbed_gait import unperturbed_gait

FOOT = {"mass_kg": 1.0, "centre_of_mass_m": [0.045, 0.0, -0.045], "inertia_kg_m2": 0.085**2}


@dataclass(frozen=True)
class Session:
    """A simulated session of the gait laboratory, ingested; perturbed crossings by name, and the
    others."""

    folder: Path
    perturbed: list[str]
    unperturbed: list[str]

    def file(self, name: str) -> Path:
        return self.folder / name

    def trial(self, name: str) -> Path:
        return self.folder / "trials" / f"{name}.parquet"

    def crossings(self, *names: str) -> list[Path]:
        return [
            self.folder / "crossings" / f"{name}.parquet"
            for name in names or (*self.perturbed, *self.unperturbed)
        ]

    def read(self, *names: str) -> list[Crossing]:
        return [jobs.read_crossing(path) for path in self.crossings(*names)]

    def truth(self, name: str) -> dict[str, Any]:
        return dict(json.loads(self.file(f"truth/{name}.json").read_text()))

    def analyse(
        self, trial: Path, perturbed: bool, output: Path, *direction: str, **choices: Any
    ) -> None:
        """One crossing; without what crossings share if there is no such file."""
        shared = self.file("platform.json")
        files = (
            trial,
            self.file("calibration.json"),
            self.file("plate.json"),
            perturbed,
            settings(**choices),
            output,
        )
        jobs.analyse(*files, *direction, platform=shared if shared.exists() else None)

    def analysed(self, **choices: Any) -> "Session":
        """Run every step."""
        chosen = settings(**choices)
        calibration = self.file("calibration.json")
        unloaded = [f"plate_0{k}" for k in (1, 2, 3)]
        jobs.calibrate(self.trial("static_1"), chosen, calibration)
        for job, names, made in (
            (jobs.identify_plate, unloaded, "plate"),
            (jobs.measure_platform, self.perturbed if len(self.perturbed) > 2 else [], "platform"),
        ):
            trials = list(map(self.trial, names))
            static = dict.fromkeys(names, calibration.stem)
            if names:
                job(
                    trials,
                    [calibration],
                    static,
                    chosen,
                    self.file(f"{made}.json"),
                    self.file(f"{made}.csv"),
                )
        for name, path in zip((*self.perturbed, *self.unperturbed), self.crossings(), strict=True):
            self.analyse(self.trial(name), name in self.perturbed, path, **choices)
        self.summarised(chosen)
        return self

    def summarised(self, chosen: WalkingAnalysis, limits: Limits | None = None) -> Tables:
        """The jobs from the crossings to the summary."""
        return run_jobs(self.folder, self.perturbed, self.unperturbed, chosen, limits=limits)

    def rendered(self, quantity: str) -> float:
        """Mean of what the simulated drivetrain rendered."""
        return float(np.mean([self.truth(name)[f"{quantity}_rendered"] for name in self.perturbed]))

    def estimate(self, quantity: str, estimator: str = "mean of perturbations") -> dict[str, Any]:
        return Tables(self.folder).estimate("all", quantity, estimator)


def recorded(setup: Setup, folder: Path, **row: Any) -> None:
    """Simulate a trial, write C3D, ingest."""
    setup.record(folder, row)
    files = {"mocap": f"vicon/{row['trial']}.c3d", "mocap_source": "vicon"}
    ingest_trial(
        row | files, folder, ROOT / "config/sources", folder / "trials" / f"{row['trial']}.parquet"
    )


def record_session(setup: Setup, folder: Path, perturbed: int, unperturbed: int) -> Session:
    names = [f"walking_{k:02d}" for k in range(1, perturbed + unperturbed + 1)]
    recorded(setup, folder, trial="static_1", experiment="static")
    for k in (1, 2, 3):
        recorded(setup, folder, trial=f"plate_0{k}", experiment="plate")
    for k, name in enumerate(names):
        recorded(setup, folder, trial=name, experiment="walking", perturbed=k < perturbed)
    return Session(folder, names[:perturbed], names[perturbed:])


@pytest.fixture(scope="module")
def ideal(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """No imperfection anywhere."""
    return record_session(load_setup().ideal(), tmp_path_factory.mktemp("ideal"), 2, 3).analysed()


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """Every imperfection as shipped; the foot's inertia is known."""
    return record_session(load_setup(), tmp_path_factory.mktemp("real"), 12, 12).analysed(foot=FOOT)


def test_a_turn_of_the_toes_down_is_measured_with_its_sign_and_not_taken_for_one_up(
    ideal, tmp_path: Path
) -> None:
    row = {"experiment": "walking", "perturbed": True, "direction": "down"}
    recorded(load_setup().ideal(), tmp_path, trial="walking_77", **row)
    trial = tmp_path / "trials/walking_77.parquet"
    ideal.analyse(trial, True, tmp_path / "down.parquet", "down")
    assert np.rad2deg(jobs.read_crossing(tmp_path / "down.parquet").turn) == pytest.approx(
        -5, abs=0.1
    )
    with refused(
        tmp_path / "up.parquet", r"walking_77: the platform turned by -5\.\d deg .* expected 'down'"
    ):
        ideal.analyse(trial, True, tmp_path / "up.parquet", "up")
    assert {crossing.sign for crossing in ideal.read(*ideal.perturbed)} == {1}


def test_with_all_imperfections_the_rendered_stiffness_comes_out_to_five_percent(
    real: Session,
) -> None:
    """12 + 12 crossings that scatter by 13 N*m/rad: the standard error is 1.6 %."""
    for estimator in ("mean of perturbations", "ensemble"):
        assert real.estimate("K", estimator)["mean"] == pytest.approx(real.rendered("K"), rel=0.05)
        assert real.estimate("B", estimator)["mean"] == pytest.approx(real.rendered("B"), rel=0.1)
        assert real.estimate("I", estimator)["mean"] == pytest.approx(real.rendered("I"), abs=0.01)
    assert real.estimate("VAF")["mean"] > 99
    K = real.estimate("K", "ensemble")
    assert K["low"] < real.rendered("K") < K["high"]
    assert 1 < K["se"] < 10
    assert (
        np.max(
            np.abs(
                [
                    (c.onset or 0.0) - real.truth(c.name)["onset_s"]
                    for c in real.read(*real.perturbed)
                ]
            )
        )
        < 5e-4
    )
    table = read_table(real.file("selection.csv"))
    assert set(table["status"]) == {"used"}
    # 0.15 mm of noise, over three axes less six freedoms of twelve
    for segment in ("foot", "shank", "platform"):
        np.testing.assert_allclose(table[f"{segment}_residual_mm"], 0.15 * np.sqrt(3 / 2), rtol=0.1)
    assert (table["plate_zero_N"].abs() < 8).all()  # 2 N of offset drawn per trial
    plate = read_table(real.file("plate.csv"))
    effects = real.truth("plate_01")["gait_laboratory"]["effects"]
    assert plate["lag_s"][0] == pytest.approx(1e-3 * effects["plate_lag"]["size"], abs=1e-4)
    assert 0 < plate["lag_se_s"][0] < 1e-4
    model = jobs.read_model(real.file("plate.json"), PlateModel)
    for column, values in (
        ("rms_before", model.rms_before),
        ("rms_after", model.rms_after),
        ("trials", [3] * 6),
    ):
        assert plate[column].cast(pl.Float64).to_list() == pytest.approx(list(values))
    assert plate["left_percent"].to_list() == pytest.approx(
        list(100 * model.rms_after / model.rms_before)
    )
    assert (
        plate.filter(pl.col("component").is_in(["F_x", "F_z", "M_y"]))["left_percent"] < 10
    ).all()


def test_a_plan_assumes_the_turn_that_the_pilot_made_or_what_is_stated(
    real: Session, tmp_path: Path
) -> None:
    """It promised the interval of 5 deg in 80 ms to a pilot of small turns; the line on top says
    what it assumes."""
    names = [f"walking_9{k}" for k in range(3)]
    setup = load_setup()
    ramp = setup.walking.perturbation.model_copy(update={"angle_deg": 3.0, "rise_s": 0.12})
    setup = replace(setup, walking=setup.walking.model_copy(update={"perturbation": ramp}))
    shutil.copytree(real.file("crossings"), tmp_path / "crossings")
    for name in names:
        recorded(setup, tmp_path, trial=name, experiment="walking", perturbed=True)
        real.analyse(
            tmp_path / f"trials/{name}.parquet", True, tmp_path / f"crossings/{name}.parquet"
        )

    def assumed(perturbed: list[str], *options: str) -> tuple[list[float], float]:
        """Turn [deg], duration [ms] and onset [%], and the half-width of K of eight crossings."""
        trials = {"trial": [*perturbed, *real.unperturbed]}
        flags = [name in perturbed for name in trials["trial"]]
        (tmp_path / "tables").mkdir(exist_ok=True)
        rows = pl.DataFrame(trials).with_columns(
            perturbed=pl.Series(flags), reason=pl.lit(None), gait=pl.lit(None)
        )
        rows.write_csv(tmp_path / "tables/walking_crossings.csv")
        asked = [
            "--walking",
            "--from",
            str(tmp_path),
            "--config",
            str(ROOT / "config/config.yaml"),
            "--crossings",
            "8",
        ]
        made = CliRunner().invoke(main, ["design", *asked, *options], catch_exceptions=False)
        assert made.exit_code == 0, made.output
        turn = re.search(r"a turn of (\S+) deg in (\S+) ms at (\S+) % of stance", made.stdout)
        assert turn is not None
        return [float(found) for found in turn.groups()], float(
            made.stdout.splitlines()[-1].split()[2]
        )

    x = np.linspace(0, 1, 1001)
    low, high = np.interp([0.1, 0.9], smooth_step(x), x)
    own, half = assumed(names)
    read = [jobs.read_crossing(tmp_path / f"crossings/{name}.parquet") for name in names]
    phase = np.median([(c.onset - c.stance.heel_strike) / c.stance.duration for c in read])
    assert own == pytest.approx([3.0, 120 * (high - low) / 0.506, 100 * phase], rel=0.06)
    # unperturbed crossings alone
    assert assumed([], "--plot", str(tmp_path / "plan.png"))[0] == [5, 80, 40]
    assert assumed(names, "--turn", "6", "--ramp", "50", "--phase", "45")[0] == [6, 50, 45]
    larger = assumed(names, "--turn", "6")
    assert larger[0][1:] == own[1:]  # what is not stated stays the pilot's
    assert larger[1] == pytest.approx(half / 2, rel=0.15)
    assert (tmp_path / "plan.png").read_bytes()[1:4] == b"PNG"


def test_without_imperfections_angle_and_torque_are_the_true_ones_through_one_filter(
    ideal: Session,
) -> None:
    """The leg is of third order, so that K, B and I depend on the filter: the exact curves pass it
    too. What is left is the file's single precision, and a low-pass of products that is not the
    product of low-passes."""
    crossings = ideal.read()
    exact = []
    fits = []
    for one in crossings:
        truth = pl.read_parquet(ideal.file(f"truth/{one.name}.parquet")).gather_every(5)
        rows = np.searchsorted(truth["time"].to_numpy(), one.time - 1e-6)
        theta, torque = (
            settings().low_pass(truth[c].to_numpy(), 300.0)[rows] for c in ("theta", "torque")
        )
        exact.append(replace(one, theta=theta, torque=torque))
        inside = (one.time > one.stance.heel_strike + 0.1) & (one.time < one.stance.toe_off - 0.1)
        np.testing.assert_allclose(one.theta[inside], theta[inside], atol=np.deg2rad(0.005))
        np.testing.assert_allclose(one.torque[inside], torque[inside], atol=0.2)
    for some in (crossings, exact):
        gait = unperturbed_gait([c for c in some if c.onset is None], 3)
        fits.append(
            [fit_response(isolate_response(c, gait, settings())).estimates for c in some if c.onset]
        )
    for found, true, tolerance in zip(
        np.array(fits[0]).T, np.array(fits[1]).T, (0.06, 0.005, 1e-4), strict=True
    ):
        np.testing.assert_allclose(found, true, atol=tolerance)


def test_what_cannot_be_used_is_named_and_listed_and_the_rest_goes_on(
    real: Session, tmp_path: Path
) -> None:
    """A hidden cluster, a platform that did not move, a plate at its limit, a foot put down
    elsewhere."""
    copied = Session(tmp_path, real.perturbed, real.unperturbed)
    shutil.copytree(real.file("crossings"), tmp_path / "crossings")
    blind, still, elsewhere = real.perturbed[:3]
    cut, flat = real.unperturbed[:2]
    trials = {name: read_trial(real.trial(name)) for name in (blind, still, cut, flat)}
    for name, trial in {
        blind: hidden(trials[blind], ("FOOT1", "FOOT2"), 1.2, 1.6),
        still: replace(trials[still], samples=trials[flat].samples),
        cut: changed(trials[cut], pl.col("plate1_force_z").clip(upper_bound=600)),
    }.items():
        write_trial(trial, path := tmp_path / "trial.parquet")
        with pytest.warns(UserWarning, match=f"excluded: trial {name}"):
            real.analyse(path, name != cut, copied.crossings(name)[0], foot=FOOT)
    (outlier,) = copied.read(elsewhere)
    moved = replace(outlier, quality=replace(outlier.quality, foot_forward_m=0.2))
    jobs.write_crossing(moved, copied.crossings(elsewhere)[0])
    chosen = settings(foot=FOOT)
    tables = copied.summarised(chosen, Limits(above={"K": real.rendered("K")}))
    listed = dict(tables["excluded"].select("trial", "reason").iter_rows())
    reasons = {
        blind: "foot markers cannot be followed",
        still: "does not turn but the sheet says perturbed",
    }
    reasons |= {elsewhere: "foot forward 0.2 m lies", cut: "Fz stays at 600 N"}
    assert list(listed) == list(reasons)
    assert all(reason in listed[name] for name, reason in reasons.items())
    summary = tables["summary"]
    fits = tables["walking"]
    assert (set(summary["n"]), summary["mean"][0]) == (
        {9},
        pytest.approx(real.rendered("K"), rel=0.05),
    )
    files = {
        "selection": "selection.csv",
        "unperturbed": "gait.parquet",
        "responses": "responses.csv",
    }
    sources = {name: tmp_path / file for name, file in (files | {"table": "walking.csv"}).items()}
    perturbed = copied.crossings(*real.perturbed)
    plot_walking_page(crossings=perturbed, settings=chosen, output=tmp_path / "page.csv", **sources)
    page = read_table(tmp_path / "page.csv")
    counts = page.filter(pl.col("panel") == "angle").group_by("curve").agg(pl.col("n").first())
    assert dict(counts.drop_nulls().iter_rows()) == {"perturbed": 9, "unperturbed": 11}
    # toes down: no mean of both directions, and one of a single crossing has no scatter
    for path in perturbed[3:5]:
        (turned,) = copied.read(path.stem)
        jobs.write_crossing(replace(turned, turn=-abs(turned.turn)), path)
        plot_walking_page(
            crossings=perturbed, settings=chosen, output=tmp_path / "both.csv", **sources
        )
        both = (
            read_table(tmp_path / "both.csv")
            .filter(panel="angle")
            .group_by("curve")
            .agg(pl.col("n", "sd").first())
        )
        down = both.filter(curve="perturbed down").row(0)
        assert {*both.drop_nulls("n")["curve"]} == {"unperturbed", "perturbed up", "perturbed down"}
        assert (down[1], down[2] is None) in [(1, True), (2, False)]
    doubtful = set(fits.filter(pl.col("K") > real.rendered("K"))["trial"])
    assert 0 < len(doubtful) < 9
    assert (
        set(page.filter(pl.col("curve") == "each", pl.col("doubtful") != "")["trial"]) == doubtful
    )
    assert summary["n_doubtful"].drop_nulls().unique().to_list() == [len(doubtful)]


@contextmanager
def refused(output: Path, reason: str) -> Iterator[None]:
    """The crossing is refused for a reason like this, with a warning, and its file says so."""
    with pytest.warns(UserWarning, match=reason), suppress(InputError):
        yield
    crossing = jobs.read_crossing_file(output)
    assert isinstance(crossing, RefusedCrossing)
    assert re.search(reason, crossing.reason)
    with pytest.raises(InputError, match="was refused"):
        jobs.read_crossing(output)


def test_a_cluster_hidden_for_long_is_refused_and_for_short_is_bridged(
    ideal: Session, tmp_path: Path
) -> None:
    """30 ms are bridged in stance, but not while the perturbation is fitted; there 7 ms are."""
    path = tmp_path / "hidden.parquet"
    output = tmp_path / "crossing.parquet"

    def analysed(name: str, markers: tuple[str, ...], start: float, end: float) -> Crossing:
        write_trial(hidden(read_trial(ideal.trial(name)), markers, start, end), path)
        ideal.analyse(path, name in ideal.perturbed, output)
        return jobs.read_crossing(output)

    flat = ideal.unperturbed[0]
    turned = ideal.perturbed[0]
    shank = ("SHANK1", "SHANK4")
    foot = ("FOOT1", "FOOT2")
    (whole,) = ideal.read(flat)
    bridged = analysed(flat, shank, 1.2, 1.23)
    assert bridged.bridged == pytest.approx(0.03 / bridged.stance.duration, rel=0.12)  # of stance
    np.testing.assert_allclose(bridged.theta, whole.theta, atol=np.deg2rad(0.1))
    output.unlink()
    with refused(output, rf"trial {flat}: the shank markers cannot be followed at 1\.2\d+ s"):
        analysed(flat, shank, 1.2, 1.4)
    onset = ideal.read(turned)[0].onset or 0.0
    for of, markers in (("foot", foot), ("platform", ("PLAT1", "PLAT2"))):
        with refused(
            output,
            rf"trial {turned}: the {of} markers are hidden for \d+ ms from 1\.\d+ s, while the"
            r" pert",
        ):
            analysed(turned, markers, onset + 0.03, onset + 0.06)
    for start, duration in ((0.03, 0.007), (-0.15, 0.03)):
        assert analysed(turned, foot, onset + start, onset + start + duration).bridged > 0


def test_a_crossing_knows_what_each_trial_of_the_plate_does_to_its_torque(
    real: Session, tmp_path: Path
) -> None:
    plate = jobs.read_model(real.file("plate.json"), PlateModel)
    found = []
    for model in (plate, plate.leave_one_out[1]):
        jobs.write_model(model, tmp_path / "plate.json")
        files = (
            real.trial(real.perturbed[0]),
            real.file("calibration.json"),
            tmp_path / "plate.json",
        )
        jobs.analyse(
            *files, True, settings(foot=FOOT), tmp_path / "crossing.parquet", body_mass_kg=77.0
        )
        found.append(jobs.read_crossing(tmp_path / "crossing.parquet"))
    crossing, without = found
    assert len(crossing.plate_errors) == len(plate.leave_one_out) > 1
    np.testing.assert_allclose(
        crossing.plate_errors[1], without.torque - crossing.torque, atol=1e-9
    )
    assert (np.abs(crossing.plate_errors[1]).max() > 1e-3, crossing.body_mass) == (True, 77.0)
    (gait,) = jobs.read_unperturbed_gaits(real.file("gait.parquet")).values()
    own = real.read(*real.unperturbed)
    np.testing.assert_array_equal(gait.plate_errors, unperturbed_gait(own, 3).plate_errors)
    assert without.plate_errors.shape == (0, len(without.time))


def test_what_contradicts_sheet_markers_or_calibration_is_refused_by_name(
    ideal: Session, tmp_path: Path
) -> None:
    path, calibration, output = (
        tmp_path / name for name in ("t.parquet", "calibration.json", "c.parquet")
    )
    lost_marker = "no marker 'FOOT3'; correct `walking.markers` .*; did you mean 'FOOT[124]'"
    for name, claimed, lost, reason in (
        (ideal.perturbed[0], False, "", "the platform .* sheet says perturbed = false"),
        (ideal.unperturbed[0], True, "", "the platform .* sheet says perturbed = true"),
        (ideal.unperturbed[0], False, "marker_FOOT3_x", lost_marker),
        (ideal.unperturbed[0], False, "FOOT2", "marker FOOT2 is not in the static calibration"),
    ):
        source = read_trial(ideal.trial(name))
        content = json.loads(ideal.file("calibration.json").read_text())
        content["markers"].pop(lost, None)
        write_trial(replace(source, samples=source.samples.drop(lost, strict=False)), path)
        calibration.write_text(json.dumps(content))
        with refused(output, f"trial {name}: {reason}"):
            jobs.analyse(path, calibration, ideal.file("plate.json"), claimed, settings(), output)
        assert jobs.read_crossing_file(output).perturbed == claimed
    (b, a) = ideal.perturbed
    other = calibration.rename(tmp_path / "other.json")
    own = {a: "calibration", b: "other", name: "unread"}
    files = [ideal.file("calibration.json"), other]
    pairs = jobs.calibrated_trials([ideal.trial(one) for one in own], files, own)
    assert [(trial.name, "FOOT2" in static.markers) for trial, static in pairs] == [
        (a, True),
        (b, False),
    ]


def test_missing_and_damaged_files_between_the_steps_name_the_step(
    ideal: Session, tmp_path: Path
) -> None:
    (perturbed,) = ideal.crossings(ideal.perturbed[0])
    (tmp_path / "crossings").symlink_to(ideal.file("crossings"))
    with pytest.raises(InputError, match="1 of 1 perturbations can be used, expected 2 or more"):
        Session(tmp_path, ideal.perturbed[:1], ideal.unperturbed).summarised(settings())
    broken = tmp_path / "plate.json"
    with pytest.raises(
        InputError, match=r"plate\.json: no such file; run the step 'identify-plate'"
    ):
        jobs.read_model(broken, PlateModel)
    for content in ("{", "{}", "[]", '{"a": 1}'):
        broken.write_text(content)
        with pytest.raises(
            InputError,
            match=r"plate\.json: not what .* delete it and run the step 'identify-plate'",
        ):
            jobs.read_model(broken, PlateModel)
    with pytest.raises(InputError, match="a trial without events"):
        jobs.read_crossing(ideal.trial(ideal.unperturbed[0]))
    # a window so short that it has fewer samples than parameters: listed, and other results go on
    selection = ideal.file("selection.csv")
    gait = ideal.file("gait.parquet")
    with pytest.warns(UserWarning, match="excluded: trial walking_01: 3 samples cannot determine"):
        jobs.fit_perturbation(
            perturbed, selection, gait, settings(window_s=0.009), tmp_path / "fit.csv"
        )
    (row,) = read_table(tmp_path / "fit.csv").to_dicts()
    assert (row["K"], "samples cannot determine 3 parameters" in row["excluded"]) == (None, True)
    with pytest.raises(
        InputError, match=r"n\.parquet: no such file; run the step 'average-unperturbed'"
    ):
        jobs.fit_perturbation(
            perturbed, selection, tmp_path / "n.parquet", settings(), tmp_path / "f.csv"
        )


REAL = Path(__file__).parents[2] / "shared" / "real_data"
MASS = 70.0
KNOWN = OvergroundAnalysis(load_on_n=50, body_mass_kg=MASS)
LOADED = {"load_on_n": 200.0}


def gait_trial(side: str = "left", over: float = 0.0) -> Trial:
    """0.5 to 1.5 s on plate 1, load 0.12 m ahead of the ankle at `over` [m]. The laboratory's
    moment is 5 % larger."""
    t = np.arange(2 * PLATE_RATE) / PLATE_RATE
    load = 800 * np.clip(np.minimum(t - 0.5, 1.5 - t) / 0.1, 0, 1)
    force = np.outer(load, [0.0, 0.0, 1.0])
    ankle = np.array([over, 0.03, 0.09])
    ahead = np.array([over + 0.12, 0.03, 0.0])
    tracks = {
        f"{side[0].upper()}TIO": ankle,
        f"{side[0].upper()}TIL": ankle + np.array([0.0, 0.1, 0.0]),
    }
    markers = {label: np.tile(place, (len(t) // 5, 1)) for label, place in tracks.items()}
    trial = recording("gait_1", markers, force, np.cross(ahead, force))
    moments = pl.Series(1.05 * 0.12 * load / MASS)
    return changed(
        trial,
        **{f"reference_ankle_moment_{side}": pl.when(pl.arange(0, len(t)) % 5 == 0).then(moments)},
    )


def overground_rows(trial: Trial, settings: OvergroundAnalysis) -> list[dict[str, Any]]:
    """Rows of `ankle_moment.csv`, with their curves."""
    return [contact.row() for contact in overground_contacts(trial, settings)]


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_moment_of_a_known_load_and_its_ratio_to_the_reference(side: str) -> None:
    trial = gait_trial(side)
    (row,) = overground_rows(trial, KNOWN)
    turned = {"plates": [{"plate": 1, "corners": CORNERS[::-1]}]}
    (same,) = overground_rows(replace(trial, provenance=turned), KNOWN)
    assert {**same, **dict.fromkeys(CURVES)} == {**row, **dict.fromkeys(CURVES)}
    assert (row["side"], row["plate"]) == (side, 1)
    assert [row["heel_strike_s"], row["toe_off_s"]] == pytest.approx([0.50625, 1.49375], abs=1e-3)
    column = f"reference_ankle_moment_{side}"
    # compared where both are known; a stance that the laboratory did not compute stays
    (part,), (none,) = (
        overground_rows(
            changed(
                trial,
                pl.when(kept).then(column).otherwise(0 * pl.col(column) + np.nan).alias(column),
            ),
            KNOWN,
        )
        for kept in (pl.col("time") < 1.0, pl.lit(False))
    )
    assert (part["frames"], part["slope"]) == (
        pytest.approx(0.49375 * RATE, abs=1),
        pytest.approx(1.05, abs=1e-3),
    )
    assert (none["frames"], none["slope"], none["peak_moment"]) == (
        row["frames"],
        None,
        row["peak_moment"],
    )
    found = compare_ankle_moment(gait_trial(side), KNOWN, {"body_mass_kg": 60.0})["ankle_moment"]
    # the sheet's mass
    assert found["moment_at_peak"][0] == pytest.approx(row["moment_at_peak"] * MASS / 60)
    assert (row["slope"], row["correlation"]) == (
        pytest.approx(1.05, abs=1e-3),
        pytest.approx(1, abs=1e-5),
    )
    assert row["moment_at_peak"] == pytest.approx(0.12 * 800 / MASS, rel=2e-3)
    # loaded above 50 N from 0.50625 to 1.49375 s
    assert row["frames"] == pytest.approx(0.9875 * RATE, abs=1)


def test_what_cannot_be_compared_is_refused_with_the_remedy() -> None:
    trial = gait_trial()
    with pytest.raises(InputError, match="gait_1: no foot stands on a plate"):
        overground_rows(gait_trial(over=0.3), KNOWN)
    with pytest.raises(InputError, match="gait_1: no force plate; map it"):
        overground_rows(replace(trial, provenance={}), KNOWN)
    said = r"gait_1: no marker of an ankle; name one under overground\.lateral_malleolus"
    with pytest.raises(InputError, match=said):
        overground_rows(
            replace(trial, samples=trial.samples.select(pl.exclude("^marker_LTI.*$"))), KNOWN
        )
    with pytest.raises(
        InputError,
        match=r"states no body mass; state body_mass_kg in the sheet, or overground\.body",
    ):
        overground_rows(trial, OvergroundAnalysis(load_on_n=50))
    # a plate is only refused if it pulls, and by more than noise
    for shift in (-90.0, 110.0):
        assert overground_rows(
            changed(trial, pl.col("plate1_force_z") + shift), KNOWN.model_copy(update=LOADED)
        )
    with pytest.raises(InputError, match=r"trial gait_1: force plate 1 reads -110 N"):
        overground_rows(changed(trial, pl.col("plate1_force_z") - 110.0), KNOWN)


def steps(
    feet: dict[str, tuple[float, float, float]],
    contacts: tuple[tuple[float, float], ...],
    names: str,
) -> Trial:
    """Feet, each at y [m] and at rest at x = 0 from one time to another [s], walk at 3 m/s before
    and after. Their toes are out by 20 deg. A load of 800 N and 80 N forward acts 0.12 m before the
    left ankle, on the ground."""
    t = np.arange(0, 3, 1 / PLATE_RATE)
    heading = np.deg2rad(20)
    out = np.array([np.cos(heading), np.sin(heading), 0.0])
    load = sum(np.clip(np.minimum(t - on, off - t) / 0.1, 0, 1) for on, off in contacts)
    force = np.outer(load, [80.0, 0.0, 800.0])
    markers = {}
    for side, (y, on, off) in feet.items():
        sign = 1 if side == "L" else -1
        frames = t[::5]
        walked = 3.0 * (np.minimum(frames - on, 0) + np.maximum(frames - off, 0))
        place = {
            "lateral": np.array([0.0, 0.04 * sign, 0.09]),
            "medial": np.array([0.0, -0.04 * sign, 0.09]),
        }
        place |= {"heel": -0.05 * out * [1, sign, 0], "toe": 0.15 * out * [1, sign, 0]}
        for part, name in zip(place, names.split(), strict=False):
            still = place[part] + [0.0, y, 0.02]
            raised = 0.1 * (np.abs(walked) > 0)
            markers[name.replace("?", side)] = still + np.column_stack([walked, 0 * walked, raised])
    ahead = np.array([0.12, 0.0, 0.0])
    return recording("gait_1", markers, force, np.cross(ahead, force))


QTM = "?_FAL ?_TAM ?_FCC ?_FM2"
ONE_FOOT = {"L": (0.0, 1.0, 1.7)}
CONTACT = ((1.0, 1.7),)
ACROSS = np.deg2rad(20)


@pytest.mark.parametrize(
    ("names", "axis_from", "moment"),
    [  # of 800 N 0.12 m ahead, and 80 N 0.11 m below the ankle
        (QTM, "L_FAL to L_TAM", 96.0 + 8.8),
        ("?LM ?MM", "LLM to LMM", 96.0 + 8.8),
        ("?.Ankle.Lat ?.Ankle.Med ?.Heel ?.Toe.Tip", "L.Ankle.Lat to L.Ankle.Med", 96.0 + 8.8),
        # the axis is turned by 20 deg, and goes through a point 0.04 m beside the ankle's centre
        (
            "?ANK - ?HEE ?TOE",
            "LANK, across LHEE to LTOE",
            104.8 * np.cos(ACROSS) - 32 * np.sin(ACROSS),
        ),
        ("?ANK", "LANK, across its way", 96.0 + 8.8),
    ],
)
def test_without_a_reference_the_axis_is_from_the_markers_that_exist(
    names: str, axis_from: str, moment: float
) -> None:
    found = compare_ankle_moment(steps(ONE_FOOT, CONTACT, names), KNOWN)
    (row,) = found["ankle_moment"].to_dicts()
    assert (row["axis_from"], row["excluded"], row["side"]) == (axis_from, None, "left")
    assert row["peak_moment"] == pytest.approx(moment / MASS, rel=2e-3)
    assert [row[name] for name in ("correlation", "slope", "reference_peak", "moment_at_peak")] == [
        None
    ] * 4
    curves = found["ankle_moment_curves"]
    middle = curves.filter(pl.col("phase").is_between(0.2, 0.8))["moment"].to_numpy()
    assert middle == pytest.approx(moment / MASS, rel=0.01)
    assert curves.columns == ["trial", "side", "plate", "heel_strike_s", *CURVES]
    assert (len(curves), curves["reference_moment"].null_count()) == (row["frames"], row["frames"])
    right = steps({"R": ONE_FOOT["L"]}, CONTACT, names)
    if "across its" not in axis_from and "HEE" not in names:
        assert overground_rows(right, KNOWN)[0]["peak_moment"] == pytest.approx(
            moment / MASS, rel=2e-3
        )


def test_two_feet_on_one_plate_are_excluded_with_the_reason() -> None:
    def reasons(trial: Trial, **changes: float) -> list[Any]:
        rows = overground_rows(trial, KNOWN.model_copy(update=changes))
        assert all((row["excluded"] is None) == (row["peak_moment"] is not None) for row in rows)
        return [row["excluded"] for row in rows]

    both = ONE_FOOT | {"R": (-0.15, 1.5, 2.2)}
    long = ((1.0, 2.2),)
    with warnings.catch_warnings(record=True, action="always") as told:
        compare_ankle_moment(steps(both, long, QTM), KNOWN)
    assert re.search(
        r"the left stance at 1\.\d\d s on plate 1 is excluded: the right foot", str(told[0].message)
    )
    first, *_ = reasons(steps(both, long, QTM))
    assert first == "the right foot stands on the same plate in 58 % of the contact"
    # the ankle alone shows it
    assert "the right foot stands" in reasons(steps(both, long, "?ANK"))[0]
    assert reasons(steps(ONE_FOOT | {"R": (-0.15, 0.2, 0.7)}, CONTACT, QTM)) == [None]
    # the other foot has no markers: its own foot does not rest for as long as the plate is loaded
    (said,) = reasons(steps(ONE_FOOT, long, QTM))
    assert said == "heel and toe rest on the plate in 58 % of the contact: a second foot"
    assert reasons(steps(ONE_FOOT, long, "?ANK ?MED")) == [None]
    again = steps({"L": (0.0, 0.2, 2.3)}, ((0.2, 0.7), (1.0, 2.2)), "?ANK ?MED")
    assert reasons(again) == [
        None,
        "a contact of 1.19 s where others last 0.49 s: a second foot, or a plate off zero",
    ]
    assert reasons(again, longest_contact=2.5) == [None, None]


def test_a_moment_unlike_walking_is_doubtful() -> None:
    shipped = yaml.safe_load((ROOT / "config/config.yaml").read_text())
    limits = Limits.model_validate(shipped["doubtful"]["ankle_moment"])

    def doubts(force: float) -> list[tuple[str, dict[str, str]]]:
        trial = steps(ONE_FOOT, CONTACT, "?ANK ?MED")
        turned = changed(trial, *(pl.col(name) * force for name in plate_columns(1, "moment")))
        found = compare_ankle_moment(turned, KNOWN)["ankle_moment"]
        late = found.with_columns(peak_phase=pl.lit(0.8))
        return [
            (one.cause, beyond_in([one]))
            for one in findings_of(late.row(0, named=True), limits, "ankle_moment")
        ]

    assert doubts(1.0) == []
    for force, side in ((-1.0, "below"), (3.0, "above")):
        assert doubts(force) == [("moment unlike walking", {"peak_moment": side})]


def test_markers_and_forces_of_opensim_give_the_moment_of_the_foot_that_the_forces_are_of(
    tmp_path: Path,
) -> None:
    t = np.arange(0, 2.5, 0.01)
    load = 700 * np.clip(np.minimum(t - 0.8, 1.5 - t) / 0.1, 0, 1)
    force = np.outer(load, [0.0, 1.0, 0.0])
    point = np.tile([0.11, 0.0, -0.1], (t.size, 1))
    table = np.column_stack([5 + t, force, point, 0 * force])
    columns = ["time", *(f"L_{kind}{axis}" for kind in "vpm" for axis in "xyz")]
    lines = ["grf", f"nRows={t.size}", f"nColumns={len(columns)}", "endheader", "\t".join(columns)]
    rows = ["\t".join(f"{value:.6f}" for value in row) for row in table]
    (tmp_path / "a.mot").write_text("\n".join([*lines, *rows]) + "\n")
    shift = 3.0 * (np.minimum(t - 0.8, 0) + np.maximum(t - 1.5, 0))
    tracks = {
        "L.Ankle.Lat": [0, 0.09, -0.14],
        "L.Ankle.Med": [0, 0.09, -0.06],
        "R.Ankle.Lat": [0.05, 0.09, 0.1],
    }
    head = [
        "PathFileType\t4\t(X/Y/Z)\ta.trc",
        "DataRate\tNumFrames\tNumMarkers\tUnits",
        f"100\t{t.size}\t3\tm",
    ]
    names = "Frame#\tTime\t" + "\t\t\t".join(tracks) + "\t\t"
    cells = np.hstack(
        [np.array(p) + np.outer(shift * (name[0] == "L"), [1, 0, 0]) for name, p in tracks.items()]
    )
    rows = [
        f"{k + 1}\t{5 + t[k]:.3f}\t" + "\t".join(f"{v:.6f}" for v in cells[k])
        for k in range(t.size)
    ]
    (tmp_path / "a.trc").write_text("\n".join([*head, names, "\t\tX1", *rows]) + "\n")
    (tmp_path / "trc.yaml").write_text("format: trc\naxes: [x, -z, y]\n")
    floor = [[2.0, 0, -1.0], [2.0, 0, 1.0], [-2.0, 0, 1.0], [-2.0, 0, -1.0]]
    plate = {"force": "L_v", "point": "L_p", "moment": "L_m", "corners": floor}
    sheet = {
        "trial": "a",
        "log": "a.mot",
        "log_source": "mot",
        "mocap": "a.trc",
        "mocap_source": "trc",
    }
    both = "the right foot stands on the same plate in 100 % of the contact"
    for foot, reason in (({}, both), ({"foot": "left"}, None)):
        described = {"format": "opensim", "clock": "common", "plates": {1: plate | foot}}
        (tmp_path / "mot.yaml").write_text(yaml.safe_dump(described))
        ingest_trial(sheet, tmp_path, tmp_path, tmp_path / "a.parquet")
        found = overground_rows(read_trial(tmp_path / "a.parquet"), KNOWN)
        assert (found[0]["side"], found[0]["excluded"]) == ("left", reason)
    assert len(found) == 1
    # 0.11 m before the ankle
    assert found[0]["peak_moment"] == pytest.approx(700 * 0.11 / MASS, rel=0.01)


def test_the_sheets_mass_comes_before_the_recordings_and_that_before_the_campaigns() -> None:
    def found(
        sheet: float | None, recorded: float | None, configured: float | None
    ) -> float | None:
        return body_mass(
            replace(gait_trial(), provenance={"mocap": {"body_mass_kg": recorded}}),
            sheet,
            configured,
        )

    masses = [(70.0, 76.0, 50.0), (None, 74.0, 50.0), (None, None, 50.0), (None, 0.0, None)]
    assert [found(*three) for three in masses] == [70.0, 74.0, 50.0, None]
    with pytest.raises(
        InputError,
        match="body_mass_kg is 70 in the sheet and 79 in the recording; correct the sheet",
    ):
        found(70.0, 79.0, None)
    for mass in (9, 310):
        with pytest.raises(
            InputError,
            match=f"a body mass of {mass} kg, from the recording, is not one of a person",
        ):
            found(None, mass, None)


@pytest.mark.skipif(not REAL.is_dir(), reason="the recordings of others are not here")
def test_agrees_with_plug_in_gait_as_the_published_reference_does(tmp_path: Path) -> None:
    """The reference is half a frame late: without delay the correlation is better, slope and peak
    move by below 1 %."""
    row = {"trial": "pig", "mocap": "btk_PiG_Motion3_FF.c3d", "mocap_source": "plug_in_gait"}
    ingest_trial(row, REAL / "c3d", ROOT / "config/sources", tmp_path / "pig.parquet")
    found = compare_ankle_moment(
        read_trial(tmp_path / "pig.parquet"), OvergroundAnalysis(load_on_n=50)
    )
    reference = pl.read_csv(REAL / "reference/ankle_moment.csv").sort("side", "plate")
    table = found["ankle_moment"].sort("side", "plate")
    same = reference.select(pl.col("plate") + 1, body_mass_kg="mass_kg", frames="n_frames")
    assert table.select(same.columns).rows() == same.rows()
    assert (table["correlation"] > np.maximum(-reference["corr"], 0.998)).all()
    np.testing.assert_allclose(table["slope"], -reference["slope"], rtol=0.01)
    np.testing.assert_allclose(
        table["reference_peak"] * 1e3, reference["pig_peak_Nmm_per_kg"], rtol=1e-5
    )
    at_peak = reference["own_quasistatic_at_peak_Nmm_per_kg"]
    np.testing.assert_allclose(table["moment_at_peak"] * 1e3, at_peak, rtol=0.01)
    bare = read_trial(tmp_path / "pig.parquet")
    for left_out, off in (
        ("LTIL|RTIL", 0.05),
        ("[LR]TI[LO]", 0.09),
        ("[LR](TI[LO]|HEE|TOE)", 0.13),
    ):
        without = replace(
            bare, samples=bare.samples.select(pl.exclude(f"^marker_({left_out})_[xyz]$"))
        )
        found = compare_ankle_moment(without, OvergroundAnalysis(load_on_n=50))["ankle_moment"]
        assert (found["excluded"].null_count(), (found["correlation"] > 0.998).all()) == (3, True)
        np.testing.assert_allclose(found["peak_moment"], found["reference_peak"], rtol=off)
        unknown = replace(without, samples=without.samples.select(pl.exclude("^reference_.*$")))
        alone = compare_ankle_moment(unknown, OvergroundAnalysis(load_on_n=50))["ankle_moment"]
        np.testing.assert_allclose(alone["peak_moment"], found["peak_moment"], rtol=1e-12)
