"""A new experiment: a toy of one file of its own and five entries goes through all of a copy of the
project."""

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
from conftest import ROOT

FIT = '''"""A joint that holds still under load: the mean torque."""

import polars as pl

from osl_analysis.bench.bench_settings import FilterSettings
from osl_analysis.trial import Trial


def holding_table(trial: Trial, settings: FilterSettings) -> pl.DataFrame:
    """One row of `holding.csv`: mean filtered torque [N*m]."""
    time, _, torque = trial.signals("theta", "torque")
    filtered = settings.low_pass(torque, 1 / (time[1] - time[0]))
    return pl.DataFrame([{"trial": trial.name, "mean_torque": float(filtered.mean())}])
'''
ADDITIONS = {
    "osl_analysis/config/experiments.py": (
        '    "static": Experiment(',
        """    "holding": on_dynamometer(
        "a joint that holds still under load",
        tables=(ResultTable("holding", derived={"holding_summary": "bench.summarise_holding"}),),
        fit=FitJob("bench.fit_holding_trial", {"settings": ("dynamometer", "FilterSettings")}),
    ),
""",
    ),
    "osl_analysis/commands/bench.py": (
        "@remedies_tried\ndef fit_belt_trial(",
        """from osl_analysis.bench.holding import holding_table
from osl_analysis.bench.bench_settings import FilterSettings


def fit_holding_trial(trial: Trial, settings: FilterSettings) -> Mapping[str, pl.DataFrame]:
    return {"holding": holding_table(trial, settings)}


def summarise_holding(table: Path, output: Path) -> None:
    write_table(read_table(table).select(pl.col("mean_torque").mean()), output)


""",
    ),
    "rules/bench.smk": (
        "rule fit_belt:",
        """rule fit_holding:
    input:
        trial="<results>/trials/{trial}.parquet",
    output:
        holding="<results>/fits/holding/{trial}.csv",
    params:
        settings=CONFIG.dynamometer.part("FilterSettings"),
        made_by=MADE_BY,
    log:
        "<logs>/holding/{trial}.log",
    run:
        job("bench.fit_holding_trial", input, output, params, log)


""",
    ),
    "config/config.yaml": ("  belt:    ", "  holding: {above: {mean_torque: 5}}\n"),
    "osl_analysis/dictionary/bench.yaml": (
        "tables/belt:",
        """tables/holding:
  rows: one per holding trial
  columns:
    trial:
    mean_torque: N*m | mean torque
    doubtful:

""",
    ),
}
TORQUES = {"holding_1": 2.0, "holding_2": 6.0}
OURS = (
    "{campaign: holding, raw_data: ., sheet: trials.csv, simulation: null, impedance_trajectory:"
    " null}"
)


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the project with the toy experiment, and a campaign of two of its trials, as CSV
    logs of 2 s."""
    folder = tmp_path_factory.mktemp("project")
    shutil.copy(ROOT / "Snakefile", folder)
    for part in ("osl_analysis", "snakemake_logger_plugin_osl", "rules", "profiles", "config"):
        # with the compiled modules, which the same dates keep valid, and not those that another
        # process just writes
        shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("*.pyc.*"))
    (folder / "osl_analysis/bench/holding.py").write_text(FIT)
    for name, (place, text) in ADDITIONS.items():
        before = (folder / name).read_text()
        assert before.count(place) == 1
        (folder / name).write_text(before.replace(place, text + place))
    time, noise = np.arange(1000) / 500, np.random.default_rng(1).standard_normal((2, 1000))
    rows = ["trial,experiment,log,log_source"]
    for name, torque in TORQUES.items():
        columns = {
            "time [s]": time,
            "joint angle [deg]": 1e-3 * noise[0],
            "actuator angle [deg]": 1e-3 * noise[0],
        }
        columns |= {
            "load cell torque [N*m]": -torque + 0.01 * noise[1],
            "motor current [A]": noise[1],
        }
        pl.DataFrame(columns).write_csv(folder / f"{name}.csv")
        rows.append(f"{name},holding,{name}.csv,bench_csv")
    (folder / "trials.csv").write_text("\n".join(rows) + "\n")
    (folder / "config.yaml").write_text(OURS)
    return folder


def python(project: Path, *arguments: str) -> str:
    """What a Python of the copy says."""
    environment, command = os.environ | {"PYTHONPATH": str(project)}, [sys.executable, *arguments]
    return subprocess.run(
        command, cwd=project, env=environment, stdout=subprocess.PIPE, text=True, check=True
    ).stdout


DOORS = """
import json
from pathlib import Path
from click.testing import CliRunner
from osl_analysis.cli import main
from osl_analysis.commands.watch import WatchedBench, first_look, recording_line
from osl_analysis.notebook import asked, fit_trial

trial, ours = "results/trials/holding_2.parquet", Path("config.yaml")
bench = WatchedBench(ours, None, Path())
command = ["fit", trial, "--model", "holding", "--config", "config.yaml"]
fit = [CliRunner().invoke(main, [*command, *more]).output for more in ([], ["--json"])]
watched = recording_line(Path("holding_2.csv"), Path(), bench)[0]
fitted = fit_trial(*asked("holding", trial, ours, None))
print(json.dumps([*[look.text for look in first_look(Path())], *fit, watched, repr(fitted)]))
"""


def test_sheet_rules_tables_quality_control_and_every_door_know_it(project: Path):
    made = ("results/tables/holding_summary.csv", "results/tables/quality.csv")
    python(project, "-m", "snakemake", *made, "--configfile", "config.yaml")
    table = pl.read_csv(project / "results/tables/holding.csv")
    assert table["mean_torque"].to_list() == pytest.approx(list(TORQUES.values()), abs=0.01)
    assert table["doubtful"].fill_null("").to_list() == ["", "mean_torque"]
    assert pl.read_csv(project / made[0])["mean_torque"].item() == pytest.approx(4, abs=0.01)
    checks = pl.read_csv(project / made[1]).filter(pl.col("check") == "saturation")
    assert (checks["value"].null_count(), set(checks["trial"])) == (0, set(TORQUES))
    row = table.row(-1, named=True)
    first, text, as_json, *others = json.loads(python(project, "-c", DOORS))
    assert re.search(rf"holding_1: ok\n.*\n +mean_torque +{table['mean_torque'][0]:.5g}", first), (
        first
    )
    assert json.loads(as_json)[0]["mean_torque"] == row["mean_torque"]
    for said in (text, *others):
        assert re.search(rf"mean_torque +{row['mean_torque']:.4g}", said), said
        assert row["doubtful"] in said
