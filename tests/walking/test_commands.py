# SPDX-License-Identifier: Apache-2.0
"""From C3D files to the walking tables: what the simulated leg rendered comes out."""

import json
import re
import shutil
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from conftest import ROOT, refused_with
from walking_crossings import Tables, run_jobs
from walking_setup import load_setup, with_toes_down
from walking_synthetic import hidden, settings, static_trial

from osl_analysis.base.errors import InputError
from osl_analysis.base.trial import read_trial, write_trial
from osl_analysis.commands import walking
from osl_analysis.commands.trials import checked_trial
from osl_analysis.judge.limits import Limits
from osl_analysis.walking.crossing import PER_UNIT
from osl_analysis.walking.plate_inertia import PlateModel
from osl_analysis.walking.plate_lag import PlateTiming
from osl_analysis.walking.set_up import body_mass
from osl_analysis.walking.walking_settings import WalkingAnalysis

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

    def trial(self, name):
        return self.folder / f"trials/{name}.parquet"

    def crossing(self, name):
        return self.folder / f"crossings/{name}.parquet"

    def read(self, names):
        return [walking.read_crossing(self.crossing(name)) for name in names]

    def truth(self, name):
        return json.loads((self.folder / f"truth/{name}.json").read_text())

    def analyse(self, trial, perturbed, output, *direction):
        names = ("calibration", "plate", "timing")
        files = [self.folder / f"{name}.json" for name in names]
        stated = walking.StatedOfCrossing(perturbed, *direction)
        walking.analyse(trial, *files, stated, self.chosen, output)

    def share(self, job, names, output, plate=()):
        """What several trials tell together."""
        calibration = self.folder / "calibration.json"
        static = dict.fromkeys(names, "calibration")
        trials = [self.trial(name) for name in names]
        job(trials, [calibration], static, *plate, self.chosen, self.folder / f"{output}.json")

    def analysed(self):
        """Run every step."""
        walking.calibrate(self.trial("static_1"), self.chosen, self.folder / "calibration.json")
        self.share(walking.identify_plate, self.unloaded, "plate")
        plate = [self.folder / "plate.json"]
        self.share(walking.find_timing, self.perturbed, "timing", plate=plate)
        for name in (*self.perturbed, *self.unperturbed):
            self.analyse(self.trial(name), name in self.perturbed, self.crossing(name))
        self.summarised()
        return self

    def summarised(self, **limits):
        """The jobs from the crossings to the summary."""
        return run_jobs(self.folder, self.perturbed, self.unperturbed, self.chosen, **limits)

    def copied(self, folder):
        """The session with its crossings alone, which may be changed."""
        shutil.copytree(self.folder / "crossings", folder / "crossings")
        return replace(self, folder=folder)

    def rendered(self, quantity):
        """Mean of what the simulated drivetrain rendered."""
        return np.mean([self.truth(name)[f"{quantity}_rendered"] for name in self.perturbed])


def recorded(setup, folder, **row):
    """Simulate a trial, write C3D, ingest."""
    trial = row["trial"]
    setup.record(folder, row)
    files = {"mocap": f"vicon/{trial}.c3d", "mocap_source": "vicon"}
    recording = checked_trial(row | files, folder, ROOT / "config/sources")
    write_trial(recording, folder / f"trials/{trial}.parquet")


def record_session(setup, folder, perturbed, unperturbed, unloaded, **choices):
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
def ideal(tmp_path_factory):
    """No imperfection anywhere."""
    return record_session(load_setup().ideal(), tmp_path_factory.mktemp("ideal"), 2, 3, 1)


@pytest.fixture(scope="module")
def real(tmp_path_factory):
    """Every imperfection as shipped; the foot's inertia is known."""
    return record_session(load_setup(), tmp_path_factory.mktemp("real"), 5, 4, 3, foot=FOOT)


@contextmanager
def refused(output, reason):
    """The crossing is refused for a reason like this, with a warning, and its file says so."""
    with pytest.warns(UserWarning, match=reason), suppress(InputError):
        yield
    crossing = walking.read_crossing_file(output)
    assert isinstance(crossing, str)
    assert re.search(reason, crossing)
    with refused_with(reason):
        walking.read_crossing(output)


def test_a_turn_of_the_toes_down_has_its_sign(ideal, tmp_path):
    row = {"experiment": "walking", "perturbed": True}
    recorded(with_toes_down(load_setup().ideal()), tmp_path, trial="walking_77", **row)
    trial = tmp_path / "trials/walking_77.parquet"

    ideal.analyse(trial, True, tmp_path / "down.parquet", "down")

    down = walking.read_crossing(tmp_path / "down.parquet")
    assert np.rad2deg(down.turn) == pytest.approx(-5, abs=0.1)
    assert {crossing.direction for crossing in ideal.read(ideal.perturbed)} == {"up"}
    contradiction = r"walking_77: .*-5\.\d deg .*'up'"
    with refused(tmp_path / "up.parquet", contradiction):
        ideal.analyse(trial, True, tmp_path / "up.parquet", "up")


@pytest.mark.parametrize("estimator", ["mean of perturbations", "ensemble"])
def test_the_rendered_impedance_comes_out_with_all_imperfections(real, estimator):
    """5 + 4 crossings of which each pace is uncertain: the standard error is 5 %."""
    K, B, I = (Tables(real.folder).estimate("all", name, estimator) for name in "KBI")

    assert K["mean"] == pytest.approx(real.rendered("K"), rel=0.1)
    assert B["mean"] == pytest.approx(real.rendered("B"), rel=0.1)
    assert I["mean"] == pytest.approx(real.rendered("I"), abs=0.015)
    if estimator == "ensemble":
        assert K["low"] < real.rendered("K") < K["high"]
        assert 4 < K["high"] - K["low"] < 100


def test_the_plate_s_lag_mass_and_height_come_out(real):
    effects = real.truth("plate_01")["gait_laboratory"]["effects"]

    plate = walking.read_model(real.folder / "plate.json", PlateModel)

    assert plate.lag == pytest.approx(1e-3 * effects["plate_lag"]["size"], abs=1e-4)
    assert plate.height == pytest.approx(0, abs=1e-3)
    assert plate.mass == pytest.approx(12.0, rel=0.02)


def test_without_imperfections_angle_and_torque_are_the_true_ones(ideal):
    """What is left is the file's single precision, and a low-pass of products that is not the
    product of low-passes."""
    for crossing in ideal.read([*ideal.perturbed, *ideal.unperturbed]):
        truth = pl.read_parquet(ideal.folder / f"truth/{crossing.name}.parquet").gather_every(5)
        rows = np.searchsorted(truth["time"].to_numpy(), crossing.time - 1e-6)
        # through the low-pass of the analysis
        theta, torque = (
            ideal.chosen.low_pass(truth[name].to_numpy(), 300.0)[rows]
            for name in ("theta", "torque")
        )

        since = crossing.time - crossing.stance.heel_strike
        inside = (since > 0.1) & (since < crossing.stance.duration - 0.1)
        assert np.abs(crossing.theta - theta)[inside].max() < np.deg2rad(0.005)
        assert np.abs(crossing.torque - torque)[inside].max() < 0.2


def test_what_cannot_be_used_is_listed_and_the_rest_goes_on(real, tmp_path):
    """A hidden cluster, a platform that did not move, an ankle that is bent otherwise."""
    session = real.copied(tmp_path)
    blind, still, bent = session.perturbed[:3]
    flat = session.unperturbed[0]
    trials = {name: read_trial(real.trial(name)) for name in (blind, still, flat)}
    faulty = {
        blind: hidden(trials[blind], ("FOOT1", "FOOT2"), 1.2, 1.6),
        still: replace(trials[still], samples=trials[flat].samples),
    }
    for name, trial in faulty.items():
        write_trial(trial, tmp_path / "trial.parquet")
        with pytest.warns(UserWarning, match=f"excluded: trial {name}"):
            real.analyse(tmp_path / "trial.parquet", True, session.crossing(name))
    (outlier,) = session.read([bent])
    walking.write_crossing(replace(outlier, theta=outlier.theta + 0.2), session.crossing(bent))

    tables = session.summarised()

    listed = dict(tables["selection"].drop_nulls("reason").select("trial", "reason").iter_rows())
    assert list(listed) == [blind, still, bent]
    assert re.search(r"foot markers .*1\.200 s", listed[blind])
    assert "perturbed" in listed[still]
    assert "deviation in angle before the onset" in listed[bent]
    assert set(tables["summary"]["n"]) == {2}
    assert tables.estimate("all")["mean"] == pytest.approx(real.rendered("K"), rel=0.05)


def test_doubtful_crossings_are_counted(real, tmp_path):
    session = real.copied(tmp_path)

    limit = np.median(Tables(real.folder)["walking"]["K"])

    tables = session.summarised(limits=Limits(above={"K": limit}))

    # of five
    assert tables["summary"]["n_doubtful"].drop_nulls().unique().to_list() == [2]


def test_while_the_perturbation_is_fitted_7_ms_are_bridged_and_30_ms_refused(ideal, tmp_path):
    name = ideal.perturbed[0]
    onset = ideal.read([name])[0].onset
    foot = ("FOOT1", "FOOT2")
    output = tmp_path / "crossing.parquet"

    def analyse(markers, start, end):
        """Analyse the trial with markers hidden between two times after the onset [s]."""
        trial = hidden(read_trial(ideal.trial(name)), markers, onset + start, onset + end)
        write_trial(trial, tmp_path / "hidden.parquet")
        ideal.analyse(tmp_path / "hidden.parquet", True, output)

    for start, end in ((0.03, 0.037), (-0.15, -0.12)):
        analyse(foot, start, end)
        assert walking.read_crossing(output).bridged > 0
    for segment, markers in (("foot", foot), ("platform", ("PLAT1", "PLAT2"))):
        reason = rf"{segment} markers .*\d+ ms .*1\.\d+ s"
        with refused(output, reason):
            analyse(markers, 0.03, 0.06)


def test_a_crossing_knows_what_each_trial_of_the_plate_does_to_its_torque(real, tmp_path):
    plate = walking.read_model(real.folder / "plate.json", PlateModel)
    files = (real.trial(real.perturbed[0]), real.folder / "calibration.json")
    known = walking.read_model(real.folder / "timing.json", PlateTiming)
    timing = tmp_path / "timing.json"

    def crossing_with(model):
        walking.write_model(replace(known, lags={}, lag=plate.lag), timing)
        walking.write_model(model, tmp_path / "plate.json")
        output = tmp_path / "crossing.parquet"
        stated = walking.StatedOfCrossing(perturbed=True, body_mass_kg=77.0)
        walking.analyse(*files, tmp_path / "plate.json", timing, stated, real.chosen, output)
        return walking.read_crossing(output)

    crossing = crossing_with(plate)
    without = crossing_with(plate.leave_one_out[1])

    assert len(crossing.changes) == 3 + len(PER_UNIT)
    assert np.abs(crossing.changes[1]).max() > 1e-3
    change = without.torque - crossing.torque
    np.testing.assert_allclose(crossing.changes[1], change, atol=1e-9)
    assert without.changes.shape == (len(PER_UNIT), len(without.time))
    assert crossing.body_mass == 77.0


def test_each_trial_has_the_static_calibration_that_it_names(ideal, tmp_path):
    calibration = ideal.folder / "calibration.json"
    content = json.loads(calibration.read_text())
    del content["markers"]["FOOT2"]
    other = tmp_path / "other.json"
    other.write_text(json.dumps(content))
    first, second = ideal.perturbed
    named = {first: "other", second: "calibration", "absent": "unread"}
    trials = [ideal.trial(second), ideal.trial(first)]

    pairs = walking.calibrated_trials(trials, [calibration, other], named)

    has_marker = {trial.name: "FOOT2" in static.markers for trial, static in pairs}
    assert has_marker == {second: True, first: False}


@pytest.mark.parametrize("content", ["{", "{}", "[]"])
def test_a_damaged_model_names_the_step(tmp_path, content):
    (tmp_path / "plate.json").write_text(content)

    with refused_with(r"plate\.json:"):
        walking.read_model(tmp_path / "plate.json", PlateModel)


@pytest.mark.parametrize(
    ("sheet", "recorded", "mass"), [(70.0, 76.0, 70.0), (None, 74.0, 74.0), (None, 0.0, None)]
)
def test_the_mass_is_the_sheet_s_else_the_recording_s(sheet, recorded, mass):
    trial = replace(static_trial(), provenance={"mocap": {"body_mass_kg": recorded}})

    assert body_mass(trial, sheet) == mass
