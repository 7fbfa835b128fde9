# SPDX-License-Identifier: Apache-2.0
"""What nobody stated neither labels nor judges a recording (campaign/configuration.py)."""

from functools import reduce

import numpy as np
import polars as pl
import pytest
import yaml
from bench_synthetic import sine_settings, unit_sines
from conftest import ROOT, joint_trial, least_squares_alone, white_noise
from walking_crossings import Walk, run_jobs, several, walked

from osl_analysis.base.files import default_config
from osl_analysis.base.yaml_settings import flat, read_mapping
from osl_analysis.bench.evidence import DesiredImpedance
from osl_analysis.bench.motion import record_of_trial
from osl_analysis.campaign.campaign_trials import Campaign
from osl_analysis.campaign.configuration import (
    FACTS_OF_DEFAULT,
    config_for_trials,
    overriding,
    read_config,
)
from osl_analysis.campaign.origin import EXPERIMENTS_BY_SETTING, states_of
from osl_analysis.commands.fit import fit_trial
from osl_analysis.commands.run import left_out_recordings
from osl_analysis.commands.walking import write_crossing
from osl_analysis.config.experiments import EXPERIMENTS, PROTOCOL
from osl_analysis.ingest.quality import Commanded, measure_quality
from osl_analysis.judge.recording_checks import judged_table, measured_table
from osl_analysis.judge.rules import Grade

OTHERS = {
    "parameters": "config/parameters/osl-v2-published.yaml",
    "impedance_trajectory": "other.csv",
    "dynamometer.amplitudes_deg": [20],
    "dynamometer.frequencies_hz": [7],
    "dynamometer.cycles": 9,
    "figures.midstance_stiffness": 1.0,
    "claims": "config/config.yaml",
    "torque_angle.zero": "start",
}


@pytest.fixture
def with_default(tmp_path, monkeypatch):
    """A campaign that states nothing, beside a default configuration with other values of
    settings."""

    monkeypatch.chdir(tmp_path)

    def made(values):
        (tmp_path / "own.yaml").write_text("{campaign: own, simulation: null}")
        nested = (
            reduce(lambda inner, key: {key: inner}, reversed(name.split(".")), one)
            for name, one in values.items()
        )
        own = reduce(overriding, nested)
        default = overriding(read_mapping(default_config()), own)
        for folder in ("config", "osl_analysis"):  # of a clone
            (tmp_path / folder).mkdir()
        (tmp_path / "config/config.yaml").write_text(yaml.safe_dump(default))
        return tmp_path / "own.yaml", own

    return made


@pytest.mark.parametrize("name", flat(FACTS_OF_DEFAULT))
def test_what_the_default_campaign_states_is_no_fact_of_others(name, tmp_path, with_default):
    (tmp_path / "plain.yaml").write_text("{campaign: own, simulation: null}")
    alike = read_config(tmp_path / "plain.yaml")
    stated = tmp_path / "stated.yaml"
    unstated, own = with_default({name: OTHERS[name]})
    stated.write_text(str({"simulation": None, **own}).replace("None", "null"))
    assert read_config(stated) != alike
    assert read_config(unstated) == alike


ASSUMED = {
    "gain_weight": {"cutoff_hz": 30, "order": 1},
    "dynamometer.load_cell_drift": 40,
    "walking.side": "left",
    "walking.plate": 2,
    "walking.markers": {},
    "dynamometer.cutoff_hz": 12,
    "torque_angle.cutoff_hz": 9,
}
"""Other values of settings of the default, with which what nobody stated is computed."""


RECORDED = {"torque_angle": None, "impedance": DesiredImpedance("compensated", 300.0, 0.0)}
"""Experiments of sound recordings, with the condition of the sheet."""


OF_BENCH = {
    name: value
    for name, value in ASSUMED.items()
    if {*EXPERIMENTS_BY_SETTING[name]} & RECORDED.keys()
}


@least_squares_alone
def test_unstated_settings_make_no_finding_on_a_sound_recording(with_default):
    """Whatever the default says of them: of a slow spring and of sines of a joint with a
    command."""
    own, _ = with_default(OF_BENCH)
    config = read_config(own)
    slow = np.deg2rad(5) * (1 - np.cos(np.pi * np.clip(np.arange(-300, 8300) / 1000, 0, 8)))
    noise = 0.02 * white_noise(slow.size, 2)
    of_spring = joint_trial(np.arange(slow.size) / 250, slow, 300 * slow + noise)
    recorded = {"impedance": sines(1.3, 4.97), "torque_angle": of_spring}
    for experiment, condition in RECORDED.items():
        trial = recorded[experiment]
        fit = fit_trial(experiment, trial, config.parameters, config_for_trials(own), condition)
        assert [one.cause for row in fit.findings for one in row if one.grade is Grade.DOUBTS] == []
        commanded = Commanded(**{key: getattr(config.dynamometer, key) for key in PROTOCOL})
        judged = judged_table(
            measured_table("t", measure_quality(trial, experiment, commanded)), config.quality, {}
        )
        assert {*judged["verdict"]} == {"pass", "not applicable"}
    states = {row["setting"]: row["state"] for row in states_of(config, {}, EXPERIMENTS)}
    assert {states[name] for name in OF_BENCH} <= {"assumed", "none"}


OF_GAIT = {
    name: ASSUMED[name]
    for name, of in EXPERIMENTS_BY_SETTING.items()
    if "walking" in of and name in ASSUMED
}


def test_unstated_settings_make_no_finding_on_sound_gait(tmp_path, with_default):
    own, _ = with_default(OF_GAIT)
    config = read_config(own)
    turned = Walk(0.4)
    walks = several("u", 8, Walk()) | several("up", 8, turned)
    (tmp_path / "crossings").mkdir()
    for trial, walk in walks.items():
        write_crossing(walked(trial, walk), tmp_path / f"crossings/{trial}.parquet")
    perturbed, unperturbed = (
        [trial for trial, walk in walks.items() if (walk.phase is None) == still]
        for still in (False, True)
    )
    limits = (config.doubtful.of(table) for table in ("walking", "walking_groups"))

    tables = run_jobs(tmp_path, perturbed, unperturbed, config.walking, None, *limits)

    for table in (tables["walking"], tables["groups"]):
        doubts = table.get_column("doubtful", default=pl.Series(dtype=pl.String)).drop_nulls()
        assert {*doubts} <= {""}
    assert tables["groups"]["n"].to_list() == [8]


@pytest.mark.parametrize(
    ("weight", "judges"), [("", False), (", gain_weight: {cutoff_hz: 1, order: 3}", True)]
)
def test_a_weight_that_is_assumed_does_not_judge_the_damping_of_the_gains(weight, judges, tmp_path):
    (tmp_path / "own.yaml").write_text("{campaign: own, simulation: null" + weight + "}")
    limit = read_config(tmp_path / "own.yaml").doubtful.of("impedance").above["B_gap_s"]
    assert (limit is not None) == judges


def test_the_default_campaign_assumes_no_fact():
    default = read_config(default_config())
    assert {row["state"] for row in states_of(default, {}, EXPERIMENTS)} == {"stated", "none"}


def test_facts_that_nobody_stated_are_none_or_assumed(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text("{campaign: own, simulation: null, dynamometer: {amplitudes_deg: [3]}}")

    rows = states_of(read_config(path), read_mapping(path), EXPERIMENTS)

    states = {row["setting"]: row["state"] for row in rows}
    stated = [name for name, state in states.items() if state == "stated"]
    assert stated == ["dynamometer.amplitudes_deg"]
    known = {name for name, state in states.items() if state != "assumed"}
    assert known >= {*flat(FACTS_OF_DEFAULT)} & {*EXPERIMENTS_BY_SETTING}


def test_recordings_that_are_not_analysed_are_named(tmp_path):
    places = {"raw_data": tmp_path, "sheet": tmp_path / "trials.csv", "results": tmp_path / "r"}
    config = read_config(ROOT / "config/config.yaml").model_copy(
        update={"simulation": None, **places}
    )
    for name in ("a.csv", "b.csv", "trials.csv", "r/tables/belt.csv"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("x")
    row = {"log": "a.csv", "mocap": None, "experiment": "belt", "exclude": None}
    message = left_out_recordings(Campaign(config, {"a": row}))
    assert "b.csv" in message
    assert str(tmp_path) in message
    fell = {"a": row, "b": row | {"log": "b.csv", "exclude": "he fell"}}
    assert left_out_recordings(Campaign(config, fell)) == ""
    both = {"a": row, "b": row | {"log": "b.csv", "experiment": "ingest_only"}}
    assert left_out_recordings(Campaign(config, both)).endswith("ingest_only: b")


def sines(*amplitudes_deg):
    rate = 500.0
    rest = np.zeros(500)
    steps = unit_sines([(hz, 8) for hz in (0.5, 1, 2, 4)], rate)
    parts = [rest]
    for size in np.deg2rad(amplitudes_deg):
        parts += [size * steps, rest]
    theta = np.concatenate(parts)
    torque = 300 * theta + 0.02 * white_noise(len(theta), 1)
    return joint_trial(np.arange(len(theta)) / rate, theta, torque)


def test_without_a_stated_protocol_the_recording_is_its_own_label():
    trial = sines(1.3, 4.97)
    none = {"amplitudes_deg": None, "frequencies_hz": None, "cycles": None}
    strata = record_of_trial(trial, sine_settings(**none)).groups.strata
    assert {(one.label, one.frequency_hz, one.commanded_deg) for one in strata} == {
        (size, hz, None) for size in (1.3, 4.97) for hz in (0.5, 1, 2, 4)
    }
    asked = record_of_trial(trial, sine_settings((5,), (1, 2))).groups.strata
    assert {one.commanded_deg for one in asked} == {5}
    unstated = Commanded(**none)
    stated = Commanded((5,), (1, 2), None)
    assert measure_quality(trial, "impedance", unstated)["protocol"].value is None
    # what was not asked for
    assert measure_quality(trial, "impedance", stated)["protocol"].value == 6
