"""The command line from simulation to fit, and what a machine does to it: one line each, nothing lost, nothing half."""

import json
import os
import re
import resource
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import h5py
import numba
import numpy as np
import polars as pl
import pytest
import yaml
from click.testing import CliRunner
from conftest import ROOT

from osl_analysis.campaign.configuration import Config, overriding
from osl_analysis.cli import main
from osl_analysis.commands import gains as gains_command
from osl_analysis.commands.figure import draw_table
from osl_analysis.compiled import compiled
from osl_analysis.errors import InputError, MemoryLimitError, OslAnalysisError
from osl_analysis.files import atomic_path
from osl_analysis.memory import limited_memory
from osl_analysis.table import write_table
from osl_analysis.trial import Trial, write_trial
from osl_analysis.yaml_settings import read_mapping, validated

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
    options = ("--model", "belt", "--config", tmp_path / "config.yaml", "--json")
    for drift in (0.0, 50.0, 100.0):
        config["dynamometer"]["load_cell_drift"] = drift
        (tmp_path / "config.yaml").write_text(yaml.safe_dump(config))
        (row,) = json.loads(call("fit", folder / "belt_01.parquet", *options).stdout)
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
    (tmp_path / "typo.yaml").write_text("dynamometr: {cutoff_hz: 10}")

    def fitted(*arguments, config=tmp_path / "own.yaml"):
        said = call("fit", folder / f"{TRIAL}.parquet", *arguments, "--config", config, "--json")
        return json.loads(said.stdout or "null"), said.stderr

    asked = ("--stiffness", "300", "--damping", "5")
    (whole, _), (over, lacks), (known, unchecked) = fitted(config=folder / "config.yaml"), fitted(), fitted(*asked)
    assert [row["K"] for row in over] == [row["K"] for row in whole] == [row["K"] for row in known]
    assert "not checked without --stiffness and --damping" in lacks
    assert "whether K changes while it is recorded" in unchecked  # three cycles at each frequency do not tell
    assert known[-1]["K_ratio"] == pytest.approx(1, abs=0.1)
    assert "unknown field 'dynamometr'" in fitted(config=tmp_path / "typo.yaml")[1]
    typed = (*asked, "--controller", "compensatd")
    for unknown, why in ((typed[:2], "B_d is not stated"), (typed, "did you mean 'compensated'?")):
        rows, said = fitted(*unknown)
        assert ("not checked: whether K is what" in said, why in said) == (True, True)
        assert [rows[-1][name] for name in ("K_d", "K_ratio", "K_predicted")] == [300, None, None]
        assert rows[-1]["K"] == known[-1]["K"]


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


def test_gains_of_a_grid_are_a_row_per_pair_and_those_of_a_trajectory_follow_its_file(tmp_path):
    arguments = ("--stiffness", "100:400:100", "--damping", "0,5", "--output", tmp_path / "gains.csv")
    rows = json.loads(call("gains", *arguments, "--plot", tmp_path / "gains.svg", "--json").stdout)
    assert [(r["K_d"], r["B_d"]) for r in rows] == [(k, b) for k in (100, 200, 300, 400) for b in (0, 5)]
    assert np.allclose(pl.read_csv(tmp_path / "gains.csv")["B_1"], [r["B_1"] for r in rows], rtol=1e-12)
    assert (tmp_path / "gains.svg").exists()
    rows = json.loads(call("gains", "--trajectory", "config/impedance/synthetic_walking.csv", "--json").stdout)
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


BOTH = ("gains", "--trajectory", "config/impedance/synthetic_walking.csv", "--stiffness", 300, "--damping", 5)


@pytest.mark.parametrize(
    "arguments",
    [
        ("gains",),
        BOTH,
        ("fit", "x.parquet", "--controller", "uncompensated", "--model", "belt"),
        *(("gains", "--stiffness", given, "--damping", 5) for given in ("stiff", "400:100:50", "1:600:0.0001")),
        ("ingest", "--log", "x.mcap", "--output", "x.parquet"),
    ],
)
def test_a_call_that_does_not_fit_is_explained_with_exit_code_2(arguments):
    result = call(*arguments)
    assert (result.exit_code, "Error: " in result.stderr) == (2, True)


def test_every_command_has_help_with_an_example():
    for name in main.commands:
        assert "Example: osl-analysis" in call(name, "--help").stdout, name


DEFAULT = (ROOT / "config/config.yaml").read_text()
GAINS = ("gains", "--stiffness", "300", "--damping", "5")


def one_line(result, code=1):
    """The error of a command, which is one line without a traceback."""
    assert result.exit_code == code, result.output
    lines = result.stderr.strip().splitlines()
    assert "Traceback" not in result.stderr
    return lines[-1]


@contextmanager
def full_disk(room=1000):
    """No file may grow beyond `room` bytes: the system's error is EFBIG, as ENOSPC on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


PAIRS = {"K_d": [float(k // 30) for k in range(900)], "B_d": [k % 30 / 2 for k in range(900)]}
TABLE = pl.DataFrame(PAIRS).with_columns(B_1_joint=pl.col("K_d") * 1.1 + pl.col("B_d"))
WRITERS = {
    "csv": write_table,
    "parquet": lambda table, path: write_trial(Trial("made", pl.DataFrame({"time": range(9000)}).cast(float)), path),
    "json": gains_command.write_gains,
    **{suffix: lambda table, path: draw_table("gain_grid", table, [path]) for suffix in ("pdf", "svg", "png")},
}


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_full_disk_is_one_line_and_leaves_the_older_file_as_it_was(tmp_path, suffix):
    path = tmp_path / f"results.{suffix}"
    path.write_text("older")
    with (
        pytest.raises(InputError, match=rf"results\.{suffix}: cannot be written .*too large.*; make room"),
        full_disk(),
    ):
        WRITERS[suffix](TABLE, path)
    assert path.read_text() == "older"
    assert list(tmp_path.iterdir()) == [path]


def test_a_terminal_that_takes_no_output_is_one_line():
    command = [sys.executable, "-c", "from osl_analysis.cli import main; main()", "describe-tables"]
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert ended.returncode == 1
    assert ended.stderr.startswith("error: the output: No space left on device; check")
    assert ended.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((*GAINS, "--output", "both.csv", "--plot", "both.csv"), "both.csv would be overwritten"),
        ((*GAINS, "--output", "a.csv", "--parameters", "a.csv"), "a.csv would be overwritten"),
        (("ingest", "--log", "a.csv", "--log-source", "s", "--output", "s.yaml"), "`ingest` writes .parquet files"),
        (("samples", "folder", "--output", "folder/log.mcap"), "`samples` writes .md files"),
        (("describe-tables", "--output", "config.yaml"), "`describe-tables` writes .md files"),
    ],
)
def test_no_command_writes_over_what_it_reads(tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.csv").write_text("precious")
    assert said in one_line(call(*arguments), code=2)
    assert (tmp_path / "a.csv").read_text() == "precious"
    assert [path.name for path in tmp_path.iterdir()] == ["a.csv"]


NO_FILES = {"pipe": "a named pipe", "folder": "a folder", "full": "a device", "null": "a device", "socket": "a socket"}


@pytest.mark.parametrize("name", NO_FILES)
def test_nothing_but_a_regular_file_is_ever_replaced(tmp_path, name):
    """The devices are links, so that a fault here deletes none."""
    path = tmp_path / f"{name}.csv"
    with socket.socket(socket.AF_UNIX) as server:
        make = {"pipe": os.mkfifo, "folder": Path.mkdir, "socket": lambda path: server.bind(str(path))}
        make.get(name, lambda path: path.symlink_to(f"/dev/{name}"))(path)
    before = path.lstat()
    with pytest.raises(InputError, match=rf"{name}\.csv: is {NO_FILES[name]}; name a file"):
        write_table(TABLE, path)
    assert path.lstat() == before


COMMANDS_THAT_WRITE = [
    (".csv", (*GAINS, "--output")),
    (".csv", (*GAINS, "--plot")),
    (".parquet", ("ingest", "--log", "no.csv", "--log-source", "bench_csv", "--output")),
    (".csv", ("inspect", "no.csv", "--draft")),
    (".md", ("samples", "nowhere", "--output")),
    (".md", ("describe-tables", "--output")),
    (".csv", ("fit", "no.parquet", "--plot")),
]


@pytest.mark.parametrize(("suffix", "command"), COMMANDS_THAT_WRITE)
def test_every_command_refuses_what_it_cannot_write_before_it_reads(tmp_path, suffix, command):
    os.mkfifo(tmp_path / f"pipe{suffix}")
    said = one_line(call(*command, tmp_path / f"pipe{suffix}"))
    assert f"pipe{suffix}: is a named pipe; name a file" in said
    for folder in ("/proc", "/sys"):
        said = one_line(call(*command, f"{folder}/x{suffix}"))
        assert f"{folder}/x{suffix}: cannot be written, because no file can be made in {folder}" in said


@pytest.mark.parametrize("link", ["symlink_to", "hardlink_to"])
def test_a_result_replaces_a_link_and_never_what_it_leads_to(tmp_path, link):
    (tmp_path / "mine.yaml").write_text("precious")
    getattr(tmp_path / "x.csv", link)(tmp_path / "mine.yaml")
    write_table(TABLE, tmp_path / "x.csv")
    assert (tmp_path / "mine.yaml").read_text() == "precious"
    assert not (tmp_path / "x.csv").is_symlink()


@pytest.mark.parametrize("name", ["a b ü\u0308.csv", "two\nlines.csv", "\x1b[31mred.csv"])
def test_an_odd_name_of_a_file_or_channel_is_used_and_never_reaches_the_terminal_as_it_is(tmp_path, name):
    log, output = tmp_path / name, tmp_path / f"{name}.csv"
    log.write_text("time,\x1b[31mred\x07\n0,1\n0.01,2\n0.02,1\n")
    seen, drawn = call("inspect", log), call(*GAINS, "--output", output)
    assert (seen.exit_code, drawn.exit_code) == (0, 0), seen.output + drawn.output
    assert output.is_file()
    missing = one_line(call("fit", tmp_path / f"no {name}"))
    assert missing.startswith("error: ")
    assert not {sign for sign in seen.output + missing if not sign.isprintable()} - {"\n"}


def test_a_file_name_that_is_no_text_is_refused_where_it_would_be_written(tmp_path):
    said = one_line(call(*GAINS, "--output", tmp_path / os.fsdecode(b"o\xff.csv")))
    assert r"o\udcff.csv: its name is not UTF-8; choose another name" in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_ends_a_command_quietly_and_leaves_nothing_half(tmp_path, monkeypatch, number):
    """The signal arrives while the table is written."""

    def interrupted(frame, path):
        with atomic_path(path) as temporary:
            temporary.write_text("half")
            os.kill(os.getpid(), number)
            time.sleep(10)

    monkeypatch.setattr(gains_command, "write_table", interrupted)
    before = signal.getsignal(number)
    result = call(*GAINS, "--output", tmp_path / "gains.csv")
    assert one_line(result, code=130) == "interrupted"
    assert list(tmp_path.iterdir()) == []
    assert signal.getsignal(number) == before


@pytest.mark.skipif(sys.platform != "linux", reason="the limit is Linux's")
def test_what_needs_more_memory_than_a_job_may_have_is_refused_with_file_limit_and_remedy(monkeypatch):
    """Eight times the limit is asked for at once."""
    before = resource.getrlimit(resource.RLIMIT_DATA)
    said = (
        "long.mcap: not enough memory, a job may have 1000 MB here; cut the recording, .* allow more by OSL_MEMORY_MB"
    )
    monkeypatch.setenv("OSL_MEMORY_MB", "1000")
    with pytest.raises(MemoryLimitError, match=said), limited_memory(["long.mcap"]):
        np.ones(10**9)
    assert resource.getrlimit(resource.RLIMIT_DATA) == before
    monkeypatch.setenv("OSL_MEMORY_MB", "4 GB")
    with pytest.raises(InputError, match="OSL_MEMORY_MB=4 GB: write a number of megabytes"), limited_memory([]):
        pass


@pytest.mark.skipif(sys.platform != "linux", reason="the limit is Linux's")
def test_a_file_of_two_kilobytes_that_unpacks_to_more_memory_than_allowed_ends_in_one_line(tmp_path):
    """Two variables of 8 GB in a MATLAB file, of which nothing is stored."""
    path = tmp_path / "bomb.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name in "ta":
            stored = file.create_dataset(name, (1, 10**9), "f8", chunks=(1, 10**6), compression="gzip")
            stored.attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    words = [sys.executable, "-c", "from osl_analysis.cli import main; main()", "inspect", str(path)]
    ended = subprocess.run(words, capture_output=True, text=True, env=os.environ | {"OSL_MEMORY_MB": "1500"})
    assert (ended.returncode, ended.stdout, ended.stderr.count("\n")) == (1, "", 1)
    assert ended.stderr.startswith(f"error: {path}: not enough memory, a job may have 1500 MB here; cut the recording")


CONFIGURATIONS = {
    "empty": (b"", "has no fields"),
    "Latin-1": ("results: é\n".encode("latin-1"), "line 1 is not UTF-8"),
    "UTF-16": (DEFAULT.encode("utf-16"), "line 1 is not UTF-8"),
    "deep list": (b"campaign: " + b"[" * 1500 + b"]" * 1500, "nested too deeply"),
    "deep mapping": (b"{campaign: " * 1500 + b"}" * 1500, "nested too deeply"),
    "endless number": (b"dynamometer: {cutoff_hz: 1e999}", "cutoff_hz: .* finite"),
    "400 digits": (b"dynamometer: {cutoff_hz: " + b"9" * 400 + b"}", r"cutoff_hz: 9{60}\.\.\. is not allowed"),
    "6000 digits": (b"dynamometer: {cutoff_hz: " + b"9" * 6000 + b"}", "limit .4300 digits"),
    "huge count": (b"walking: {bootstrap_samples: 99999999999999}", "less than or equal to 100000"),
    "more cycles than fit": (b"dynamometer: {cycles: 99999999999999999999}", "less than or equal to 10000|valid"),
    "wrong tag": (b"campaign: !!bool x\n", "not YAML"),
    "wrong date": (b"campaign: !!timestamp x\n", "not YAML"),
    "Python object": (b"campaign: !!python/object:os.system x\n", "not YAML"),
    "escape sequence": (b'"\\e31mkey": 3\n', r"unknown field '\\x1b31mkey'"),
}


@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_a_configuration_that_cannot_be_read_is_one_short_line(tmp_path, name):
    content, match = CONFIGURATIONS[name]
    path = tmp_path / "config.yaml"
    path.write_bytes(content)
    with pytest.raises(OslAnalysisError, match=match) as refused:
        validated(overriding(read_mapping(ROOT / "config/config.yaml"), read_mapping(path)), Config, path)
    assert str(refused.value).startswith(f"{path}: ")
    assert len(str(refused.value)) < 700


def twice(x):
    return 2 * x


def test_without_a_folder_for_the_cache_functions_are_compiled_in_each_process(monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", "/proc/nowhere")
    assert compiled(twice)(2.0) == 4
