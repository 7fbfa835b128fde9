# SPDX-License-Identifier: Apache-2.0
"""A bundle: a campaign that can be checked and analysed wherever it is unpacked."""

import json
import re
from hashlib import sha256
from pathlib import Path
from zipfile import ZipFile

import pytest
from command_line import call
from conftest import ROOT

from osl_analysis.base.table import SCHEMA
from osl_analysis.campaign.campaign_trials import open_campaign
from osl_analysis.campaign.configuration import read_config
from osl_analysis.campaign.result_files import ResultFiles
from osl_analysis.commands.run import check_start

CONFIG = """# of the old bench
campaign: old_bench
raw_data: ../session
sheet: trials.csv
results: results
simulation: null
parameters: ../device.yaml
sources: sources
"""
SOURCE = """format: csv
time: {column: t, unit: s}
channels:
  theta: {column: angle, unit: rad}
  torque: {column: torque, unit: N*m}
  theta_m: {column: motor, unit: rad}
"""


SHEET = "trial,experiment,log,log_source\nfirst,belt,{},lab/bench\n"


@pytest.fixture
def campaign(tmp_path, monkeypatch):
    """A campaign with a recording, sources and device beside it, and results, also of a trial that
    its sheet does not have any more."""
    folder = tmp_path / "campaign"
    for name, text in {
        "config.yaml": CONFIG,
        "trials.csv": SHEET.format("day/first.csv"),
        "sources/lab/bench.yaml": SOURCE,
        "../session/day/first.csv": "t,angle,torque,motor\n0,0,0,0\n",
        "../session/day/not_in_the_sheet.csv": "t\n0\n",
        "../device.yaml": (ROOT / "config/parameters/default.yaml").read_text(),
        "results/trials/first.parquet": "made again",
    }.items():
        write(folder / name, text)
    monkeypatch.chdir(folder)
    files = ResultFiles(open_campaign(read_config(Path("config.yaml")), None))
    for name in [*files.published, "results/tables/impedance.csv"]:
        write(folder / name, "made")
    summary = {"tables_schema": SCHEMA, "version": "2.0.0", "numbers": {}}
    write(folder / "results/summary.json", json.dumps(summary))
    return folder


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def test_a_bundle_is_a_whole_campaign_elsewhere(campaign, tmp_path, monkeypatch):
    result = call("bundle", campaign, tmp_path / "all.zip")

    assert result.exit_code == 0, result.output
    elsewhere = tmp_path / "elsewhere"
    ZipFile(tmp_path / "all.zip").extractall(elsewhere)
    listed = {}
    for line in (elsewhere / "SHA256SUMS").read_text().splitlines():
        digest, name = line.split("  ")
        listed[name] = digest
        assert sha256((elsewhere / name).read_bytes()).hexdigest() == digest
    assert {name for name in listed if not name.startswith("results/")} == {
        "config.yaml",
        "parameters/device.yaml",
        "recordings/day/first.csv",
        "sheet/trials.csv",
        "sources/lab/bench.yaml",
    }

    for folder in (tmp_path / "session", campaign):
        folder.rename(folder.with_name(f"{folder.name}_gone"))
    monkeypatch.chdir(elsewhere)
    config = read_config(Path("config.yaml"))
    unpacked = open_campaign(config, None)
    check_start(unpacked)
    assert config.parameters == Path("parameters/device.yaml")
    needed = [*unpacked.logs("first"), *unpacked.sources("first")]
    assert all(file.is_file() for file in needed)
    results = {name for name in listed if name.startswith("results/")}
    assert results == {*ResultFiles(unpacked).published}, "of the trials in the sheet alone"


@pytest.mark.parametrize("missing", ["session/day/first.csv", "campaign/results/report.html"])
def test_a_bundle_needs_every_recording_and_result(campaign, tmp_path, missing):
    (tmp_path / missing).unlink()

    result = call("bundle", campaign, tmp_path / "all.zip")

    assert result.exit_code == 1
    assert result.stderr.startswith("error: ")
    assert Path(missing).name in result.stderr
    assert not (tmp_path / "all.zip").exists()


@pytest.mark.parametrize("log", ["{}/session/day/first.csv", "../campaign/trials.csv"])
def test_a_log_outside_the_folder_of_recordings_is_refused(campaign, tmp_path, log):
    write(campaign / "trials.csv", SHEET.format(log.format(tmp_path)))

    result = call("bundle", campaign, tmp_path / "all.zip")

    assert result.exit_code == 1
    assert re.search(r"error: trials\.csv: trial 'first': log .*\.csv .*raw_data", result.stderr)


def test_what_a_link_brings_from_elsewhere_is_named(campaign, tmp_path):
    recordings = campaign / "recordings"
    recordings.mkdir()
    write(campaign / "config.yaml", CONFIG.replace("../session", "recordings"))
    write(tmp_path / "secret", "t,angle,torque,motor\n0,0,0,0\n")
    write(campaign / "trials.csv", SHEET.format("first.csv"))
    (recordings / "first.csv").symlink_to(tmp_path / "secret")

    result = call("bundle", campaign, tmp_path / "all.zip")

    assert re.search("from outside of .*first.csv", result.stderr)


def test_no_file_of_the_campaign_is_overwritten(campaign, tmp_path):
    log = tmp_path / "session/day/first.zip"
    write(log, "a recording")
    write(campaign / "trials.csv", SHEET.format("day/first.zip"))

    result = call("bundle", campaign, log)

    assert (result.exit_code, log.read_text()) == (1, "a recording")
    assert f"{log}: is a file of the campaign" in result.stderr


def test_what_a_simulation_names_is_in_the_bundle_too(campaign, tmp_path):
    """The sheet is unpacked later than the settings: an older one would be planned anew."""
    settings = (ROOT / "config/new_campaign/simulation_bench.yaml").read_text()
    write(campaign / "own.yaml", settings.replace("config/parameters/default.yaml", "leg.yaml"))
    write(campaign / "leg.yaml", (tmp_path / "device.yaml").read_text())
    simulated = CONFIG.replace("simulation: null", "simulation: own.yaml")
    simulated = simulated.replace("../device.yaml", "null")
    write(campaign / "config.yaml", f"{simulated}impedance_trajectory: null\nclaims: null\n")

    result = call("bundle", campaign, tmp_path / "all.zip")

    assert result.exit_code == 0, result.stderr
    names = ZipFile(tmp_path / "all.zip").namelist()
    assert "leg.yaml" in names
    assert names.index("simulation/own.yaml") < names.index("recordings/trials.csv")
