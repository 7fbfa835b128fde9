# SPDX-License-Identifier: Apache-2.0
"""The command line from simulation to fit, and what a machine does to it: one line each, nothing
lost, nothing half."""

import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import yaml
from command_line import call
from conftest import ROOT, refused_with
from shipped import SETTINGS

from osl_analysis.base import memory
from osl_analysis.base.memory import limited_memory
from osl_analysis.base.table import write_table
from osl_analysis.base.trial import Trial, write_trial
from osl_analysis.cli import main
from osl_analysis.commands.figure import write_figure
from osl_analysis.figures.drawing import completed, drawn

pytestmark = pytest.mark.usefixtures("in_root")
linux_alone = pytest.mark.skipif(sys.platform != "linux", reason="the limit is Linux's")
TRIAL = "impedance_K300_B5.0_compensated"
GAINS = ("gains", "--stiffness", "300", "--damping", "5")
SYNTHETIC = "config/impedance/synthetic_walking.csv"


def one_line(result, code=1):
    """The error of a command, which is one line without a traceback."""
    assert result.exit_code == code, result.output
    assert "Traceback" not in result.stderr
    assert code == 2 or result.stderr.count("\n") == 1
    return result.stderr.strip().splitlines()[-1]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A configuration whose protocol is the tiny campaign's, and two of its trials, simulated and
    ingested."""
    folder = tmp_path_factory.mktemp("cli")
    protocol = {
        "amplitudes_deg": [3],
        "frequencies_hz": [2, 5],
        "cycles": 3,
        "settle_cycles": 1,
    }
    config = SETTINGS | {"dynamometer": SETTINGS["dynamometer"] | protocol}
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        for trial in (TRIAL, "belt_01"):
            settings = (
                "--settings",
                "tests/tiny_simulation.yaml",
                "--config",
                folder / "config.yaml",
            )
            assert call("simulate", *settings, "--trial", trial, folder).exit_code == 0
            log = folder / f"dynamometer/{trial}.mcap"
            output = folder / f"{trial}.parquet"
            result = call("ingest", "--log", log, "--log-source", "dynamometer", "--output", output)
            assert result.exit_code == 0, result.stderr
    return folder


def test_fit_prints_the_impedance_of_linear_theory_and_draws_it(folder, tmp_path):
    arguments = (
        folder / f"{TRIAL}.parquet",
        "--config",
        folder / "config.yaml",
        "--plot",
        tmp_path / "fit.png",
    )
    result = call("fit", *arguments)
    *_, whole = json.loads(call("fit", *arguments[:3], "--json").stdout)

    assert result.exit_code == 0, result.stderr
    assert re.search(r"K +clear: \d{3}[.\d]* \([.\d]+.*[.\d]+\) N·m/rad", result.stdout)
    assert (tmp_path / "fit.png").stat().st_size > 10_000
    assert whole["K"] == pytest.approx(299, rel=0.03)
    assert whole["B"] == pytest.approx(5.46, rel=0.15)


def test_a_raw_recording_is_fitted_with_its_source_as_after_ingest(folder):
    options = ("--config", folder / "config.yaml", "--json")
    raw = folder / f"dynamometer/{TRIAL}.mcap"
    source = ("--source", "config/sources/dynamometer.yaml")

    from_raw = call("fit", raw, *source, *options)
    from_trial = call("fit", folder / f"{TRIAL}.parquet", *options)

    assert json.loads(from_raw.stdout) == json.loads(from_trial.stdout)
    assert raw.name in one_line(call("fit", raw, "--source", raw))


@pytest.mark.parametrize("trial", [["--trial", TRIAL], []])
def test_a_campaign_is_simulated_with_the_configuration_that_is_named(tmp_path, trial):
    """A belt of 200 N*m/rad cannot render the 300 of the trial."""
    belt = (ROOT / "config/parameters/default.yaml").read_text()
    assert "value: 685.6" in belt
    (tmp_path / "soft.yaml").write_text(belt.replace("value: 685.6", "value: 200"))
    config = SETTINGS | {"parameters": str(tmp_path / "soft.yaml")}
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(config))

    settings = ["--settings", "tests/tiny_simulation.yaml", "--config", tmp_path / "config.yaml"]
    message = one_line(call("simulate", *settings, *trial, tmp_path / "recordings"))

    assert "K_s = 200 N*m/rad" in message


def test_fit_says_what_it_cannot_check_and_takes_an_overriding_file(folder, tmp_path):
    own = yaml.safe_load((folder / "config.yaml").read_text())
    config = tmp_path / "own.yaml"
    config.write_text(yaml.safe_dump({"campaign": "mine", "dynamometer": own["dynamometer"]}))

    def fitted(*arguments):
        said = call("fit", folder / f"{TRIAL}.parquet", *arguments, "--config", config, "--json")
        return json.loads(said.stdout)[-1], said.stderr

    asked = ("--stiffness", "300", "--damping", "5")
    unasked, lacks = fitted()
    known, unchecked = fitted(*asked)
    other, _ = fitted(*asked, "--controller", "impedance PD")

    assert known["K"] == unasked["K"]
    assert "wrong gain" in lacks
    assert "wrong gain" not in unchecked
    assert known["K_ratio"] == pytest.approx(1, abs=0.1)
    assert fitted(*asked, "--parameters", "none")[0]["K_predicted"] is None
    assert [other[name] for name in ("K_d", "K_ratio", "K_predicted")] == [300, None, None]


@pytest.mark.parametrize(
    "refused",
    [
        "--stiffness nan",
        "--damping -3",
        "--controller compnsated",
        "--windows 2-",
        "--windows 200-300",
        "--model belt --stiffness 3",
    ],
)
def test_what_is_refused_of_an_option_is_told_by_the_option(folder, refused):
    *_, option, _ = arguments = refused.split()
    said = one_line(call("fit", folder / f"{TRIAL}.parquet", *arguments))
    assert said.startswith(f"error: {option}: ")


@pytest.mark.filterwarnings("default")
def test_a_lost_end_is_told_and_no_recording_is_written_over(folder, tmp_path):
    log = tmp_path / "cut.mcap"
    output = tmp_path / "cut.parquet"
    log.write_bytes((folder / f"dynamometer/{TRIAL}.mcap").read_bytes()[:-20])
    result = call("ingest", "--log", log, "--log-source", "dynamometer", "--output", output)
    assert (result.exit_code, output.exists()) == (0, True)
    assert re.search(r"(?m)^warning: .*cut\.mcap: .*byte \d+", result.stderr)
    (tmp_path / "dynamometer").mkdir()
    log = tmp_path / "dynamometer/belt_01.mcap"
    log.write_bytes(b"a laboratory's own")
    said = one_line(
        call("simulate", "--settings", "tests/tiny_simulation.yaml", "--trial", "belt_01", tmp_path)
    )
    assert "cut.mcap: " in said
    assert log.read_bytes() == b"a laboratory's own"


def test_gains_of_a_pair_a_grid_and_a_trajectory_are_those_of_the_paper(tmp_path):
    table = tmp_path / "gains.csv"
    short = tmp_path / "t.csv"
    short.write_text("phase,K_d,B_d\n0,300,5\n1,700,5\n")
    grid = ("gains", "--stiffness", "100,300", "--damping", "0,5", "--output", table, "--json")
    beyond = ("gains", "--stiffness", 600, "--damping", 0, "--weight-hz", 50)

    rows = json.loads(call(*grid).stdout)
    walked = json.loads(call("gains", "--trajectory", SYNTHETIC, "--json").stdout)

    assert [(row["K_d"], row["B_d"]) for row in rows] == [(100, 0), (100, 5), (300, 0), (300, 5)]
    assert (rows[3]["K_1"], rows[3]["B_1"]) == pytest.approx((25.0867, 0.664687), rel=1e-5)
    assert pl.read_csv(table)["B_1"].to_list() == pytest.approx([row["B_1"] for row in rows])
    assert max(row["K_d"] for row in walked) == 340
    assert "t.csv: K_d = 700 " in one_line(call("gains", "--trajectory", short))
    assert "--weight-hz" in call(*beyond).stdout


MISTAKES = {
    r"--weight-hz: .*cutoff_hz: 1e\+300 .* 10000": (*GAINS, "--weight-hz", 1e300),
    r"osl-analysis init FOLDER --from \.`": ("fit", "README.md"),
    "profiles/slrm.*profiles/slurm": ("run", "--workflow-profile", "profiles/slrm"),
    r"no\.mcap: ": ("ingest", "--log", "no.mcap", "--log-source", "leg", "--output", "no.parquet"),
    r"\\x1b\[31mred: ": ("fit", "\x1b[31mred"),
    r"o\\udcff\.csv: .*UTF-8": (*GAINS, "--output", os.fsdecode(b"o\xff.csv")),
}
UNFIT = {
    "--trajectory": (*GAINS, "--trajectory", SYNTHETIC),
    "'100:400:50'": ("gains", "--stiffness", "100:400:50", "--damping", 5),
    "--log-source": ("ingest", "--log", "x.mcap", "--output", "x.parquet"),
    "--mocap": ("ingest", "--output", "x.parquet"),
    "a.csv": (*GAINS, "--output", "a.csv", "--parameters", "a.csv"),
    "is a folder": ("inspect", ".", "--draft", "s.yaml"),
    "/a.csv": ("fit", "a.csv", "--plot", "../{}/a.csv"),
    "--from": ("init", "new", "--example", "--from", "."),
}


@pytest.mark.parametrize("message", MISTAKES)
def test_a_mistake_is_one_line_with_exit_code_1(message):
    assert re.search(f"^error:.*{message}", one_line(call(*MISTAKES[message])))


@pytest.mark.parametrize(("stated", "threads"), [(None, "1"), ("3", "3")])
def test_the_matrix_library_has_one_thread_unless_the_user_states_more(
    monkeypatch, stated, threads
):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", stated or "")
    if stated is None:
        monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    one_line(call("inspect", "no.csv"))
    assert os.environ["OPENBLAS_NUM_THREADS"] == threads


@pytest.mark.parametrize("message", UNFIT)
def test_a_call_that_does_not_fit_is_refused_and_writes_nothing(message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.csv").write_text("precious")
    assert message in one_line(
        call(*(str(one).format(tmp_path.name) for one in UNFIT[message])), code=2
    )
    assert ((tmp_path / "a.csv").read_text(), [path.name for path in tmp_path.iterdir()]) == (
        "precious",
        ["a.csv"],
    )


@contextmanager
def full_disk():
    """No file may grow beyond 1000 bytes: the system's error is EFBIG, as ENOSPC on a full
    disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    writes_bytecode = sys.dont_write_bytecode
    # a module that is imported here would leave half of its bytecode in the package
    sys.dont_write_bytecode = True
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        sys.dont_write_bytecode = writes_bytecode


TIMES = [float(k) for k in range(900)]
TABLE = pl.DataFrame({"trial": "a", "time": TIMES, "torque": TIMES, "torque_model": TIMES})
WRITERS = {
    "csv": write_table,
    "parquet": lambda table, path: write_trial(
        Trial("made", pl.DataFrame({"time": range(9000)}).cast(float)), path
    ),
    "pdf": lambda table, path: write_figure(drawn("fig4", completed("fig4", table)), [path]),
}


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_full_disk_is_one_line_and_leaves_the_older_file_as_it_was(tmp_path, suffix):
    path = tmp_path / f"results.{suffix}"
    said = rf"results\.{suffix}: "
    path.write_text("older")
    with refused_with(said), full_disk():
        WRITERS[suffix](TABLE, path)
    assert (path.read_text(), list(tmp_path.iterdir())) == ("older", [path])


def test_nothing_but_a_regular_file_is_replaced(
    tmp_path,
):
    """The device is a link, so that a fault here deletes none."""
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "null.csv").symlink_to("/dev/null")
    (tmp_path / "mine.yaml").write_text("precious")
    (tmp_path / "link.csv").symlink_to(tmp_path / "mine.yaml")
    write_table(TABLE, tmp_path / "link.csv")
    assert (tmp_path / "mine.yaml").read_text() == "precious"
    assert not (tmp_path / "link.csv").is_symlink()
    for name in ("pipe", "folder", "null"):
        path = tmp_path / f"{name}.csv"
        before = path.lstat()[:2]
        said = rf"{name}\.csv:"
        with refused_with(said):
            write_table(TABLE, path)
        assert path.lstat()[:2] == before  # kind and inode
    below = str(tmp_path / "mine.yaml/x.csv")
    said = one_line(call(*GAINS, "--output", below))
    assert below in said


def test_an_odd_name_never_reaches_the_terminal_as_it_is(tmp_path):
    log = tmp_path / "two\nlines ü\x1b[31m.csv"
    log.write_text("time,red\n0,1\n0.01,2\n0.02,1\n")

    seen = call("inspect", log)

    assert seen.exit_code == 0, seen.output
    assert {sign for sign in seen.output if not sign.isprintable()} == {"\n"}


def test_an_output_that_takes_nothing_is_one_line(capsys):
    with (
        suppress(OSError),  # of closing it
        Path("/dev/full").open("w") as full,
        pytest.raises(SystemExit) as ended,
        redirect_stdout(full),
    ):
        main(["results", "--columns"])

    said = capsys.readouterr().err
    assert (ended.value.code, said.count("\n")) == (1, 1)
    assert said.startswith("error: ")
    assert "No space left on device" in said


def test_an_output_that_is_closed_ends_a_command_quietly():
    code = "from osl_analysis.cli import main; main(['results', '--columns'])"
    with subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as reader:
        reader.stdout.close()  # as `head` does

        assert (reader.stderr.read(), reader.wait()) == ("", 1)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_ends_a_command_quietly_and_leaves_nothing_half(tmp_path, monkeypatch, number):
    """The signal arrives while the table is written."""

    def interrupted(frame, path):
        path.write_text("half")
        os.kill(os.getpid(), number)
        time.sleep(10)

    monkeypatch.setattr(pl.DataFrame, "write_csv", interrupted)
    # a process in the background ignores it
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    assert one_line(call(*GAINS, "--output", tmp_path / "gains.csv"), code=130) == "interrupted"
    assert (list(tmp_path.iterdir()), signal.getsignal(signal.SIGTERM)) == ([], signal.SIG_DFL)


@linux_alone
def test_a_job_may_have_four_fifths_of_the_least_of_machine_and_batch_job(monkeypatch, tmp_path):
    """A machine of 4 GB whose batch job, a folder above, has 2 GB."""
    for name, text in (
        ("proc/self/cgroup", "0::/job/step\n"),
        ("sys/fs/cgroup/job/memory.max", "2000000000\n"),
    ):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(memory, "memory_limits", memory.memory_limits.__wrapped__)
    monkeypatch.setattr(memory, "Path", lambda *parts: tmp_path / "/".join(parts).lstrip("/"))
    monkeypatch.setattr("os.sysconf", {"SC_PAGE_SIZE": 4000, "SC_PHYS_PAGES": 10**6}.get)
    with limited_memory([]):
        assert resource.getrlimit(resource.RLIMIT_DATA)[0] == 1.6e9
        monkeypatch.setenv("OSL_MEMORY_MB", "9000")
        with limited_memory([]):
            assert resource.getrlimit(resource.RLIMIT_DATA)[0] == 1.6e9, (
                "a lower limit of before stays"
            )


@linux_alone
def test_what_needs_more_memory_than_a_job_may_have_is_refused(monkeypatch):
    before = resource.getrlimit(resource.RLIMIT_DATA)
    monkeypatch.setenv("OSL_MEMORY_MB", "2000")

    with refused_with(r"^bomb\.mat: .*2000 MB.*OSL_MEMORY_MB"), limited_memory(["bomb.mat"]):
        np.zeros(10**9)

    assert resource.getrlimit(resource.RLIMIT_DATA) == before
