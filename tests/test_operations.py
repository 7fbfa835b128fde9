"""What a machine does to commands: full disks, odd file names, Ctrl-C. One line each, nothing lost, nothing half."""

import os
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
from click.testing import CliRunner
from conftest import ROOT

from osl_analysis.cli import main
from osl_analysis.commands import gains as gains_command
from osl_analysis.commands.figure import draw_table
from osl_analysis.compiled import compiled
from osl_analysis.config.configuration import Config, overriding
from osl_analysis.config.yaml_settings import read_mapping, validated
from osl_analysis.errors import InputError, MemoryLimitError, OslAnalysisError
from osl_analysis.files import atomic_path
from osl_analysis.jobs.memory import limited_memory
from osl_analysis.jobs.run import noticed_interrupt
from osl_analysis.table import write_table
from osl_analysis.trial import Trial, write_trial

DEFAULT = (ROOT / "config/config.yaml").read_text()
GAINS = ("gains", "--stiffness", "300", "--damping", "5")


@pytest.fixture(autouse=True)
def in_root(monkeypatch):
    monkeypatch.chdir(ROOT)


def call(*arguments):
    return CliRunner().invoke(main, [str(a) for a in arguments])


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


def test_an_error_of_another_file_is_not_taken_for_a_full_disk(tmp_path):
    with pytest.raises(FileNotFoundError), atomic_path(tmp_path / "x.csv"):
        (tmp_path / "nowhere").read_text()


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


@pytest.fixture
def no_files(tmp_path):
    """A folder with everything that is no regular file; the devices are links, so that a fault here deletes none."""
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "folder.csv").mkdir()
    for device in ("full", "null"):
        (tmp_path / f"{device}.csv").symlink_to(f"/dev/{device}")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(tmp_path / "socket.csv"))
    return tmp_path


NO_FILES = {"pipe": "a named pipe", "folder": "a folder", "full": "a device", "null": "a device", "socket": "a socket"}


@pytest.mark.parametrize("name", NO_FILES)
def test_nothing_but_a_regular_file_is_ever_replaced(no_files, name):
    path = no_files / f"{name}.csv"
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


ODD_NAMES = {
    "blanks and umlauts": "a b ü\u0308.csv",
    "a line break": "two\nlines.csv",
    "an escape sequence": "\x1b[31mred.csv",
}


@pytest.mark.parametrize("name", ODD_NAMES)
def test_an_odd_file_name_is_used_as_it_is_and_never_reaches_the_terminal_as_it_is(tmp_path, name):
    log = tmp_path / ODD_NAMES[name]
    log.write_text("time,a\n0,1\n0.01,2\n0.02,1\n")
    seen = call("inspect", log)
    assert seen.exit_code == 0, seen.output
    missing = one_line(call("fit", tmp_path / f"no {ODD_NAMES[name]}"))
    assert missing.startswith("error: ")
    drawn = call(*GAINS, "--output", log.with_suffix(".csv.csv"))
    assert drawn.exit_code == 0, drawn.output
    assert "\x1b" not in seen.output + missing
    assert log.with_suffix(".csv.csv").is_file()


def test_a_file_name_that_is_no_text_is_refused_where_it_would_be_written(tmp_path):
    name = os.fsdecode(b"o\xff.csv")
    assert r"o\udcff.csv: its name is not UTF-8; choose another name" in one_line(
        call(*GAINS, "--output", tmp_path / name)
    )
    assert list(tmp_path.iterdir()) == []


def test_a_channel_s_control_characters_never_reach_the_terminal(tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("time,\x1b[31mred\x07,b\n0,1,2\n0.01,1,2\n0.02,2,3\n")
    said = call("inspect", log)
    assert said.exit_code == 0
    assert not {sign for sign in said.output if not sign.isprintable()} - {"\n"}


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


def test_ctrl_c_is_noticed_and_handled_as_before():
    before, seen = signal.getsignal(signal.SIGINT), []
    try:
        signal.signal(signal.SIGINT, lambda *_: seen.append("Snakemake"))
        pressed = noticed_interrupt()
        assert not pressed.is_set()
        signal.raise_signal(signal.SIGINT)
        assert (pressed.is_set(), seen) == (True, ["Snakemake"])
    finally:
        signal.signal(signal.SIGINT, before)
