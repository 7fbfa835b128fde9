# SPDX-License-Identifier: Apache-2.0
"""A small campaign, and runs in forks of one process with all imports, which takes 2 s less."""

import atexit
import json
import os
import re
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import polars as pl
import yaml
from conftest import ROOT

from osl_analysis.campaign.configuration import overriding

PROTOCOL = {"frequencies_hz": [2, 5], "cycles": 5, "amplitudes_deg": [2, 4]}
OVERRIDES = {
    "campaign": "small",
    "raw_data": "raw_data/small",
    "sheet": "raw_data/small/trials.csv",
    "simulation": "config/simulation/small.yaml",
    "dynamometer": PROTOCOL,
    "figures": {"frequency_response": {"K_d": 300, "B_d": 5}},
}
"""Its configuration."""

FORKING = """
import gc, json, multiprocessing, os, sys
from multiprocessing import forkserver
import snakemake.cli, snakemake.api, snakemake.workflow, snakemake.dag, snakemake.storage
# what Snakemake imports while it reads a Snakefile and compares params
import pandas, smart_open
import osl_analysis.judge.campaign, osl_analysis.base.table, osl_analysis.commands.run
import osl_analysis.commands.simulate, osl_analysis.campaign.campaign_trials
import osl_analysis.figures.drawing
import osl_analysis.campaign.result_files, osl_analysis.campaign.origin
import osl_analysis.report.verdicts, osl_analysis.report.numbers
import osl_analysis.cli
from osl_analysis.formats import known_formats
from osl_analysis.jobs import workers
from osl_analysis.base.files import default_config
from osl_analysis.base.yaml_settings import read_mapping
import planned_jobs

snakemake.cli.get_argument_parser()  # imports the plug-ins
read_mapping(default_config())
known_formats()
programs = {
    "snakemake": snakemake.cli.main,
    "osl-analysis": osl_analysis.cli.main,
    "planned": planned_jobs.main,
}
gc.freeze()

# All campaigns fork their workers from one process, which imports once what any job needs. Only
# this process may ask whether that one lives, for only this one is its parent.
os.environ.update(workers.ENVIRONMENT)
commands = ("simulate", "walking", "figure", "report", "gains")
workers.PRELOADED += [f"osl_analysis.commands.{name}" for name in commands]
workers.PRELOADED += [f"osl_analysis.formats.{name}" for name in known_formats()]
workers.PRELOADED += [f"osl_analysis.simulator.{name}" for name in ("bench_trial", "walking_trial")]
workers.PRELOADED += ["compiled_functions", "ezc3d"]
multiprocessing.get_context("forkserver").set_forkserver_preload(workers.PRELOADED)
forkserver.ensure_running()
forkserver._forkserver.ensure_running = lambda: None

for line in sys.stdin:
    arguments, folder, said = json.loads(line)
    pid = os.fork()
    if not pid:
        os.chdir(folder)
        os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 1)
        os.dup2(1, 2)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        sys.argv = arguments
        programs[arguments[0]]()
        os._exit(0)
    print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)
"""


SMALL = {
    "experiments": {
        "K_d": [200, 300],
        "B_d": [5.0],
        "belt": 2,
        "transmission": 2,
        "actuator": 2,
        "plate": 3,
        "walking": 8,
    },
    "actuator": {"duration_s": 10},
    "protocol": PROTOCOL | {"rest_s": 0.5, "lead_s": 0.5},
}
"""What its simulation changes in the shipped settings."""


def write_small(folder: Path, simulation: dict[str, Any] | None = None) -> None:
    """Write the shipped configuration to a folder, with a small simulation or one further
    changed."""
    shutil.copytree(ROOT / "config", folder / "config")
    shipped = yaml.safe_load((ROOT / "config/simulation/default.yaml").read_text())
    small = overriding(overriding(shipped, SMALL), simulation or {})
    (folder / "config/simulation/small.yaml").write_text(yaml.safe_dump(small))


@cache
def forking() -> subprocess.Popen[str]:
    """The process from which the runs are forked."""
    pipes = dict.fromkeys(("stdin", "stdout"), subprocess.PIPE)
    here = Path(__file__).parent
    path = {"PYTHONPATH": f"{here / 'unlucky'}:{here}:{os.environ.get('PYTHONPATH', ROOT)}"}
    started = subprocess.Popen(
        [sys.executable, "-c", FORKING], cwd=ROOT, env=os.environ | path, text=True, **pipes
    )
    atexit.register(started.communicate)  # closes its pipes, once it is killed
    atexit.register(started.kill)
    return started


def run_forked(arguments: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run Snakemake or `osl-analysis` in a folder; both of its streams are in `stdout`."""
    said = folder / "said.txt"
    server = forking()
    assert server.stdin is not None
    assert server.stdout is not None
    server.stdin.write(json.dumps([arguments, str(folder), str(said)]) + "\n")
    server.stdin.flush()
    return subprocess.CompletedProcess(
        arguments, int(server.stdout.readline()), said.read_text(), ""
    )


FILES = ["--snakefile", str(ROOT / "Snakefile"), "--configfile", "config/small.yaml"]


class Workspace:
    """A folder with a copy of config/ in which the repository's Snakefile runs."""

    def __init__(
        self,
        folder: Path,
        of: "Workspace | None" = None,
        without: tuple[str, ...] = (),
    ):
        """A new campaign, or a copy of one, dates included, without files of these names."""
        self.folder = folder
        if of is None:
            write_small(folder)
            self.configure({})
        else:
            shutil.copytree(
                of.folder, folder, ignore=shutil.ignore_patterns(*without), dirs_exist_ok=True
            )

    def configure(self, changes):
        (self.folder / "config/small.yaml").write_text(yaml.safe_dump(OVERRIDES | changes))

    def run(self, *arguments):
        """Snakemake in this folder."""
        return run_forked(["snakemake", *arguments, *FILES], self.folder)

    def planned(self, *arguments):
        """Jobs per rule of a dry run."""
        result = self.run("-n", *arguments)
        assert result.returncode == 0, result.stdout
        stats = re.findall(r"^([\w-]+) +(\d+)$", result.stdout, re.MULTILINE)
        return {rule: int(count) for rule, count in stats if rule not in ("total", "reproduce-all")}

    def jobs(self, *targets):
        """The jobs that make these targets, with their params."""
        asked = ["planned", str(ROOT / "Snakefile"), "config/small.yaml", *targets]
        result = run_forked(asked, self.folder)
        assert result.returncode == 0, result.stdout
        return json.loads((self.folder / "planned.json").read_text())

    def table(self, name):
        return pl.read_csv(self.folder / f"results/tables/{name}.csv")
