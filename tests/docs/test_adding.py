# SPDX-License-Identifier: Apache-2.0
"""The five examples of CONTRIBUTING.md, which stand as patches in tests/changes: a rule, a fit, a
format, a figure and a finding, applied together to a copy of the project."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from bench_synthetic import unit_block
from conftest import ROOT, white_noise

from osl_analysis.spectral.stepped_sine import SteppedSineProtocol

DAMPING = {"damper_1": 3.0, "damper_2": 6.0}  # N*m*s/rad, by trial
RATE = 500
AMPLITUDE = np.deg2rad(4)
PROTOCOL = {"amplitudes_deg": [4], "frequencies_hz": [1, 2], "cycles": 4}
OURS = f"""campaign: dampers
raw_data: logs
sheet: logs/trials.csv
sources: logs
simulation: null
impedance_trajectory: null
dynamometer: {json.dumps(PROTOCOL)}
doubtful: {{damper: {{above: {{B_v: 5}}}}}}
"""
SOURCE = f"""format: xyz
clock: master
time: {{rate: {RATE}}}
channels:
  theta: {{column: angle}}
  torque: {{column: torque}}
"""


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the project with the examples, and two trials of a damper in the new format."""
    folder = tmp_path_factory.mktemp("project")
    shutil.copy(ROOT / "Snakefile", folder)
    # with the compiled modules, which the same dates keep valid, and not those that another process
    # just writes
    ignored = shutil.ignore_patterns("*.pyc.*")
    for part in ("osl_analysis", "snakemake_logger_plugin_osl", "rules", "profiles", "config"):
        shutil.copytree(ROOT / part, folder / part, ignore=ignored)
    for change in sorted((ROOT / "tests/changes").glob("*.patch")):
        for name in re.findall(r"^--- a/((?:docs|tests)/.+)", change.read_text(), re.MULTILINE):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, folder / name)
        applied = subprocess.run(
            ["git", "apply", str(change)], cwd=folder, text=True, capture_output=True
        )
        assert applied.returncode == 0, f"write {change.name} anew: {applied.stderr}"

    protocol = SteppedSineProtocol((AMPLITUDE,), tuple(PROTOCOL["frequencies_hz"]), 4)
    rest = np.zeros(RATE)
    angle = np.concatenate([rest, AMPLITUDE * unit_block(protocol, RATE), rest])
    velocity = np.gradient(angle, 1 / RATE)
    noise = white_noise(angle.size, 1)
    logs = folder / "logs"
    logs.mkdir()
    for trial, damping in DAMPING.items():
        torque = damping * velocity + 0.01 * noise
        np.savetxt(
            logs / f"{trial}.xyz",
            np.column_stack([np.rad2deg(angle), torque]),
            header="XYZ 1 angle[deg] torque[N*m]",
            comments="",
        )
    rows = [f"{trial},damper,{trial}.xyz,bench_xyz,knee" for trial in DAMPING]
    (logs / "trials.csv").write_text(
        "\n".join(["trial,experiment,log,log_source,joint", *rows, ""])
    )
    (logs / "bench_xyz.yaml").write_text(SOURCE)
    (folder / "config.yaml").write_text(OURS)
    return folder


IN_COPY = """
import json
from contextlib import suppress
from pathlib import Path
import polars as pl
import snakemake.cli
from click.testing import CliRunner
from osl_analysis.jobs import perform, workers

def do_here(job):  # without a process of workers, whose imports take 2 s
    perform.perform(job)

workers.run_in_worker = do_here
targets = ["results/tables/damper.csv", "results/tables/rates.csv"]
with suppress(SystemExit):
    snakemake.cli.main([*targets, "--configfile", "config.yaml", "--cores", "1"])

from osl_analysis.cli import main
from osl_analysis.figures.drawing import (drawn, plotted_numbers)
from osl_analysis.judge.limits import Limits
from osl_analysis.judge.judging import judged
from osl_analysis.judge.wording import finding_text
from osl_analysis.notebook import fit
from osl_analysis.base.table import read_table

trial, ours = "results/trials/damper_2.parquet", Path("config.yaml")
command = ["fit", trial, "--model", "damper", "--config", "config.yaml"]
impedance = read_table("tests/figure_tables/impedance.csv")
vaf = "vaf_over_amplitude"
(ax,) = drawn(vaf, plotted_numbers(vaf, impedance)).axes
belt = {"trial": "belt_1", "preload": 3.0}
((finding,),) = judged(pl.DataFrame([belt]), Limits(), "belt")
answers = {
    "command": CliRunner().invoke(main, command).output,
    "notebook": repr(fit(trial, "damper", config=ours, parameters=None)),
    "figure": ax.get_ylabel(),
    "finding": finding_text(finding),
}
Path("answers.json").write_text(json.dumps(answers))
"""


def test_a_rule_fit_format_figure_and_finding_are_known_everywhere(
    project: Path,
) -> None:
    environment = os.environ | {"PYTHONPATH": str(project)}
    shutil.copytree(ROOT / "tests/figure_tables", project / "tests/figure_tables")

    done = subprocess.run(
        [sys.executable, "-c", IN_COPY],
        cwd=project,
        env=environment,
        text=True,
        capture_output=True,
    )
    assert (project / "answers.json").is_file(), done.stdout + done.stderr
    answers = json.loads((project / "answers.json").read_text())
    damper = pl.read_csv(project / "results/tables/damper.csv")
    rates = pl.read_csv(project / "results/tables/rates.csv")

    assert damper["B_v"].to_list() == pytest.approx(list(DAMPING.values()), abs=0.01)
    doubts = damper["doubtful"].fill_null("").str.split("; ")
    assert doubts.list.contains("beyond a stated limit").to_list() == [False, True]
    assert rates["rate"].min() == pytest.approx(RATE)
    for door in ("command", "notebook"):
        assert re.search(rf"B_v +{damper['B_v'][1]:.4g}", answers[door]), answers[door]
    assert answers["figure"] == "VAF (%)"
    assert "the torque at rest is 3 N*m" in answers["finding"]
