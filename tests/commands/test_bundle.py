"""A bundle: a campaign that can be checked and analysed wherever it is unpacked."""

import json
from hashlib import sha256
from pathlib import Path
from zipfile import ZipFile

import pytest
from click.testing import CliRunner

from osl_analysis.campaign.campaign_trials import open_campaign
from osl_analysis.campaign.configuration import read_config
from osl_analysis.cli import main
from osl_analysis.commands.run import check_start
from osl_analysis.table import SCHEMA

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


@pytest.fixture
def campaign(tmp_path, in_root):
    """A campaign with a recording, sources and device beside it, and results."""
    device = Path("config/parameters/default.yaml").read_text()
    summary = {"tables_schema": SCHEMA, "version": "2.0.0", "numbers": {}}
    for name, text in {
        "campaign/config.yaml": CONFIG,
        "campaign/trials.csv": "trial,experiment,log,log_source\nfirst,belt,day/first.csv,bench\n",
        "campaign/sources/bench.yaml": SOURCE,
        "campaign/results/summary.json": json.dumps(summary),
        "campaign/results/tables/belt.csv": "trial,K_s\nfirst,685\n",
        "campaign/results/trials/first.parquet": "made again",
        "session/day/first.csv": "t,angle,torque,motor\n0,0,0,0\n",
        "session/day/not_in_the_sheet.csv": "t\n0\n",
        "device.yaml": device,
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path / "campaign"


def test_a_bundle_is_a_whole_campaign_elsewhere(campaign, tmp_path, monkeypatch):
    result = CliRunner().invoke(main, ["bundle", str(campaign), str(tmp_path / "all.zip")])

    assert result.exit_code == 0, result.output
    elsewhere = tmp_path / "elsewhere"
    ZipFile(tmp_path / "all.zip").extractall(elsewhere)
    listed = {}
    for line in (elsewhere / "SHA256SUMS").read_text().splitlines():
        digest, name = line.split("  ")
        listed[name] = digest
        assert sha256((elsewhere / name).read_bytes()).hexdigest() == digest
    assert set(listed) == {
        "config.yaml", "parameters/device.yaml", "recordings/day/first.csv",
        "recordings/trials.csv", "results/summary.json", "results/tables/belt.csv",
        "sources/bench.yaml",
    }  # fmt: skip

    for folder in (tmp_path / "session", campaign):
        folder.rename(folder.with_name(f"{folder.name}_gone"))
    monkeypatch.chdir(elsewhere)
    config = read_config(Path("config.yaml"))
    unpacked = open_campaign(config, None)
    check_start(unpacked)
    assert config.parameters == Path("parameters/device.yaml")
    assert all(log.is_file() for trial in unpacked.trials() for log in unpacked.logs(trial))


def test_a_bundle_needs_results_and_every_recording(campaign, tmp_path):
    output = tmp_path / "all.zip"
    (tmp_path / "session/day/first.csv").unlink()
    result = CliRunner().invoke(main, ["bundle", str(campaign), str(output)])
    assert result.exit_code == 1
    assert "first.csv" in result.output

    (campaign / "results/summary.json").unlink()
    result = CliRunner().invoke(main, ["bundle", str(campaign), str(output)])
    assert "summary.json: " in result.output
    assert not output.exists()
