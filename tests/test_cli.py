"""The command line from simulation to fit, each step on what the one before wrote, and its errors as one line."""

import json
import re
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import yaml
from click.testing import CliRunner
from conftest import ROOT

from osl_analysis.cli import main
from osl_analysis.commands.simulate import check_folder

TRIAL = "impedance_K300_B5.0_compensated"


def call(*arguments):
    return CliRunner().invoke(main, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A configuration whose protocol is the tiny campaign's, and two of its trials, simulated and ingested."""
    folder = tmp_path_factory.mktemp("cli")
    config = yaml.safe_load((ROOT / "config/config.yaml").read_text())
    config["dynamometer"] |= {"amplitudes_deg": [4], "frequencies_hz": [2, 5], "cycles": 3, "settle_cycles": 1}
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        for trial in (TRIAL, "belt_01"):
            settings = ("--settings", "tests/tiny_simulation.yaml")
            assert call("simulate", *settings, "--trial", trial, folder).exit_code == 0
            log = folder / f"dynamometer/{trial}.mcap"
            output = ("--output", folder / f"{trial}.parquet")
            result = call("ingest", "--log", log, "--log-source", "dynamometer", *output)
            assert result.exit_code == 0, result.stderr
    return folder


@pytest.fixture(autouse=True)
def in_root(monkeypatch):
    monkeypatch.chdir(ROOT)


def test_fit_prints_the_impedance_of_linear_theory_and_draws_it(folder, tmp_path):
    arguments = (folder / f"{TRIAL}.parquet", "--config", folder / "config.yaml", "--plot", tmp_path / "fit.png")
    result = call("fit", *arguments)
    assert result.exit_code == 0, result.stderr
    assert re.search(r"K +\d{3}\.?\d* ± [\d.]+ +N·m/rad", result.stdout)
    assert (tmp_path / "fit.png").stat().st_size > 10_000
    rows = json.loads(call("fit", *arguments[:3], "--json").stdout)
    whole = next(row for row in rows if row["amplitude_deg"] is None)
    assert (whole["K"], whole["B"]) == (pytest.approx(299, rel=0.03), pytest.approx(5.46, rel=0.15))


def test_the_interval_of_a_belt_counts_the_drift_that_the_configuration_names(folder, tmp_path):
    """Twice the drift, twice its share; 50 N*m/min, so that the noise of two trials cannot pass for it."""
    config, widths = yaml.safe_load((folder / "config.yaml").read_text()), []
    for drift in (0.0, 50.0, 100.0):
        config["dynamometer"]["load_cell_drift"] = drift
        (tmp_path / "config.yaml").write_text(yaml.safe_dump(config))
        said = call(
            "fit", folder / "belt_01.parquet", "--model", "belt", "--config", tmp_path / "config.yaml", "--json"
        )
        (row,) = json.loads(said.stdout)
        widths.append(row["K_s_se"])
        assert row["interval_method"] == ("units + drift" if drift else "units")
    shares = [np.sqrt(width**2 - widths[0] ** 2) for width in widths[1:]]
    # slope of time on deflection beside a constant and the velocity: a raised cosine of 1 s and 5 deg, from 5 % on
    t = np.linspace(np.arccos(0.9) / np.pi, 1, 1000)
    columns = np.column_stack([np.deg2rad(5) * (1 - np.cos(np.pi * t)) / 2, np.ones_like(t), np.sin(np.pi * t)])
    slope = np.linalg.lstsq(columns, t, rcond=None)[0][0]
    assert shares == pytest.approx([drift / 60 * slope for drift in (50, 100)], rel=0.06)


def test_fit_says_what_it_cannot_check_and_takes_a_campaign_s_overriding_file(folder, tmp_path):
    own = yaml.safe_load((folder / "config.yaml").read_text())
    (tmp_path / "own.yaml").write_text(yaml.safe_dump({"campaign": "mine", "dynamometer": own["dynamometer"]}))
    whole, over = (
        call("fit", folder / f"{TRIAL}.parquet", "--config", config, "--json")
        for config in (folder / "config.yaml", tmp_path / "own.yaml")
    )
    assert over.exit_code == 0, over.stderr
    assert [row["K"] for row in json.loads(over.stdout)] == [row["K"] for row in json.loads(whole.stdout)]
    assert "not checked without --stiffness and --damping" in over.stderr
    asked = ("--stiffness", "300", "--damping", "5", "--config", tmp_path / "own.yaml", "--json")
    known = call("fit", folder / f"{TRIAL}.parquet", *asked)
    assert known.exit_code == 0, known.stderr
    unchecked = known.stderr.splitlines()  # a line for each
    assert "whether K changes while it is recorded" in unchecked[-1]  # three cycles at each frequency do not tell
    assert json.loads(known.stdout)[-1]["K_ratio"] == pytest.approx(1, abs=0.1)
    (tmp_path / "typo.yaml").write_text("dynamometr: {cutoff_hz: 10}")
    typo = call("fit", folder / f"{TRIAL}.parquet", "--config", tmp_path / "typo.yaml")
    assert (typo.exit_code, "unknown field 'dynamometr'" in typo.stderr) == (1, True)
    typed = ("--stiffness", "300", "--damping", "5", "--controller", "compensatd")
    for unknown, why in ((typed[:2], "B_d is not stated"), (typed, "did you mean 'compensated'?")):
        said = call("fit", folder / f"{TRIAL}.parquet", *unknown, "--config", tmp_path / "own.yaml", "--json")
        assert (said.exit_code, "not checked: whether K is what" in said.stderr, why in said.stderr) == (0, True, True)
        row = json.loads(said.stdout)[-1]
        assert (row["K_d"], row["K_ratio"], row["K_predicted"]) == (300, None, None)
        assert row["K"] == json.loads(known.stdout)[-1]["K"]


def test_fit_of_the_belt_finds_the_truth_beside_the_log(folder):
    result = call("fit", folder / "belt_01.parquet", "--model", "belt", "--json")
    truth = json.loads((folder / "truth/belt_01.json").read_text())
    assert json.loads(result.stdout)[0]["K_s"] == pytest.approx(truth["parameters"]["K_s"], rel=0.003)


def test_the_simulator_never_writes_over_recordings(tmp_path):
    (tmp_path / "dynamometer").mkdir()
    log = tmp_path / "dynamometer/belt_01.mcap"
    log.write_bytes(b"a laboratory's own")
    result = call("simulate", "--settings", "tests/tiny_simulation.yaml", "--trial", "belt_01", tmp_path)
    assert result.exit_code == 1
    assert "the simulator did not make it" in result.stderr
    assert log.read_bytes() == b"a laboratory's own"


def test_ingest_says_that_a_log_has_lost_its_end(folder, tmp_path):
    log, output = tmp_path / "cut.mcap", tmp_path / "cut.parquet"
    log.write_bytes((folder / f"dynamometer/{TRIAL}.mcap").read_bytes()[:-20])
    result = call("ingest", "--log", log, "--log-source", "dynamometer", "--output", output)
    assert result.exit_code == 0
    assert re.search(r"(?m)^warning: .*cut\.mcap: no footer", result.stderr)
    assert output.exists()


def test_gains_prints_the_paper_s_example_with_its_proof_and_draws_it_without_bars_of_data(tmp_path):
    result = call("gains", "--stiffness", 300, "--damping", 5, "--plot", tmp_path / "gains.svg")
    assert "K_1 = 25.0867 N·m/rad" in result.stdout
    assert "; exactly one local minimum among the stable gains" in result.stdout
    drawn = (tmp_path / "gains.svg").read_text()
    assert len(drawn) > 5000
    assert "interval" not in drawn


def test_gains_of_a_grid_is_a_row_per_pair(tmp_path):
    arguments = ("--stiffness", "100:400:100", "--damping", "0,5", "--output", tmp_path / "gains.csv")
    result = call("gains", *arguments, "--plot", tmp_path / "gains.svg", "--json")
    rows = json.loads(result.stdout)
    assert [(r["K_d"], r["B_d"]) for r in rows] == [(k, b) for k in (100, 200, 300, 400) for b in (0, 5)]
    table = pl.read_csv(tmp_path / "gains.csv")
    assert np.allclose(table["B_1"], [r["B_1"] for r in rows], rtol=1e-12)
    assert (tmp_path / "gains.svg").exists()


def test_gains_of_a_trajectory_follows_the_file():
    result = call("gains", "--trajectory", "config/impedance/synthetic_walking.csv", "--json")
    rows = json.loads(result.stdout)
    assert max(r["K_d"] for r in rows) == 340
    assert all(r["minima"] == 1 for r in rows)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("gains", "--stiffness", 700, "--damping", 5),
            r"K_d = 700 .* ask for less than 685\.6 \(99 % of it: 678\.7\)",
        ),
        (("gains", "--stiffness", 0, "--damping", 5), "K_d = 0 .* ask for more than 0"),
        (("gains", "--stiffness", 300, "--damping", 1e300), "B_d = 1e.300 .* ask for 1e-09 to 1e.06"),
        (("gains", "--stiffness", 300, "--damping", 5, "--weight-hz", 1e300), "cut-off at 1e.300 Hz; use"),
        (("gains", "--stiffness", 300, "--damping", 5, "--weight-order", 0), "W of Eq. 14 has order 0"),
        (("gains", "--stiffness", 300, "--damping", 5, "--parameters", "no.yaml"), r"no\.yaml: no such file"),
        (("gains", "--trajectory", "no.csv"), r"no\.csv: no such impedance trajectory"),
        (("gains", "--stiffness", 300, "--damping", 5, "--output", "x.txt"), "written as .csv or .json"),
        (("fit", "no.parquet"), r"no\.parquet: no such trial"),
        (("fit", "README.md"), "not a Parquet file"),
        (("ingest", "--log", "no.mcap", "--log-source", "leg", "--output", "no.parquet"), r"no\.mcap: no such file"),
    ],
)
def test_a_mistake_is_one_line_with_exit_code_1(arguments, message):
    result = call(*arguments)
    assert result.exit_code == 1
    assert re.search(f"^error: .*{message}", result.stderr)
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ("gains",),
        ("gains", "--trajectory", "config/impedance/synthetic_walking.csv", "--stiffness", 300, "--damping", 5),
        ("fit", "x.parquet", "--controller", "uncompensated", "--model", "belt"),
        ("gains", "--stiffness", "stiff", "--damping", 5),
        ("gains", "--stiffness", "400:100:50", "--damping", 5),
        ("gains", "--stiffness", "1:600:0.0001", "--damping", 5),
        ("ingest", "--log", "x.mcap", "--output", "x.parquet"),
    ],
)
def test_a_call_that_does_not_fit_is_explained_with_exit_code_2(arguments):
    result = call(*arguments)
    assert result.exit_code == 2
    assert "Error: " in result.stderr


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("phase,K_d,B_d,K_d\n0,100,1,200\n1,100,1,200\n", "column 'K_d' stands twice; rename or remove one"),
        ("phase,K_d,B_d\n0,100,1\n1,100\n", "row '1,100' has 2 entries for 3 columns; write one in each"),
    ],
)
def test_a_trajectory_whose_columns_are_not_certain_is_refused(tmp_path, content, message):
    (tmp_path / "own.csv").write_text(content)
    assert f"own.csv: {message}" in call("gains", "--trajectory", tmp_path / "own.csv").stderr


def test_every_command_has_help_with_an_example():
    for name in main.commands:
        assert "Example: osl-analysis" in call(name, "--help").stdout, name


def test_a_link_to_itself_is_refused_in_one_line(tmp_path):
    loop = tmp_path / "loop.csv"
    loop.symlink_to(loop)
    result = call("ingest", "--log", loop, "--log-source", "bench_csv", "--output", tmp_path / "a.parquet")
    assert result.exit_code == 1
    assert result.stderr == f"error: {loop}: no such file; correct the sample sheet, or copy the file there\n"


def test_a_log_that_another_job_begins_meanwhile_is_no_recording_of_somebody_else(tmp_path, monkeypatch):
    """The folder `truth` was looked for before the logs, and was made with the first log in between."""
    search = Path.rglob

    def begun(folder, pattern):
        (tmp_path / "truth").mkdir(exist_ok=True)
        (tmp_path / "a.mcap").touch()
        return search(folder, pattern)

    monkeypatch.setattr(Path, "rglob", begun)
    check_folder(tmp_path)
