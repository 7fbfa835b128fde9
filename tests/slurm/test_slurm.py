"""A campaign of 30 trials through SLURM on this machine: `make test-slurm`, as root on Debian (`one_node.sh`).

A local run simulates and analyses it. SLURM analyses the same recordings in another folder: with one of them broken and
one submission cancelled, then with a node that is lost, with a full disk, with a submission that
SLURM does not take, and at last as it should be.
"""

import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from thirty_trials import CONFIG, measured, write

from osl_analysis.refusal import is_refused

ROOT = Path(__file__).parents[2]
SLURM = ["--workflow-profile", str(ROOT / "profiles/slurm")]
BROKEN = "belt_02"
LOG = f"raw_data/small/dynamometer/{BROKEN}.mcap"
DISK_MB = 200
LONGEST_S = 400
"""Of one run on a busy machine [s]."""

pytestmark = pytest.mark.slurm


def run(folder: Path, *arguments: str, then: Callable[[], None] = lambda: None, once: str = CONFIG) -> str:
    """What Snakemake says in a folder, and its exit code as a last line.

    `then` is called when there is a file like `once` that is no refusal record.
    """
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile"), "--configfile", CONFIG]
    begun, said = time.perf_counter(), folder / "said.txt"
    with (
        said.open("w") as file,
        subprocess.Popen([*command, *arguments], cwd=folder, stdout=file, stderr=file) as process,
    ):
        while all(map(is_refused, folder.glob(once))) and process.poll() is None:
            time.sleep(0.1)
        then()
        process.wait(timeout=LONGEST_S)
    print(f"\n{folder.name}, {' '.join(arguments[2:]) or 'as it is'}: {time.perf_counter() - begun:.0f} s")
    return f"{said.read_text()}\nexit code {process.returncode}"


def slurm(*command: str) -> str:
    """What a command of SLURM says."""
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return done.stdout.strip()


def running() -> str:
    """The number of the submission that runs."""
    return slurm("squeue", "--noheader", "--states=running", "--format=%i")


def lost_trials(said: str, why: str) -> set[str]:
    """Trials that are listed because their submission was lost."""
    return set(re.findall(rf"^  trial (\S+), file .*: the cluster's job \d+ was lost \({why}\); ", said, re.MULTILINE))


@pytest.fixture(scope="module")
def local(tmp_path_factory) -> Path:
    """The campaign after a local run."""
    assert shutil.which("sbatch"), "SLURM is started by `make test-slurm`"
    folder = tmp_path_factory.mktemp("local")
    write(folder)
    assert run(folder).endswith("exit code 0")
    return folder


@pytest.fixture(scope="module")
def cluster(local, tmp_path_factory):
    """The same recordings and configuration with a broken recording, and results on a disk of their own."""
    folder = tmp_path_factory.mktemp("cluster")
    shutil.copytree(local, folder, ignore=shutil.ignore_patterns("results", ".snakemake"), dirs_exist_ok=True)
    measured(folder)
    (folder / LOG).write_bytes(b"no log")
    (folder / "results").mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK_MB}m", "tmpfs", folder / "results"], check=True)
    yield folder
    subprocess.run(["umount", "--lazy", folder / "results"], check=True)


def test_a_broken_recording_and_a_cancelled_submission_are_named_and_the_rest_is_made(cluster):
    """Batches of ten trials; the last is cancelled when its first trial is there."""
    options = (*SLURM, "--group-components", "trials=10")
    said = run(cluster, *options, then=lambda: slurm("scancel", running()), once="results/trials/walking_1*.parquet")
    assert said.endswith("exit code 1"), said
    assert re.search(rf"^  trial {BROKEN}, file \S+{BROKEN}\.mcap: .*; remedy: ", said, re.MULTILINE), said
    lost = lost_trials(said, "CANCELLED")
    assert lost, said
    assert all(trial.startswith("walking_") for trial in lost)
    assert f"NOT ANALYSED: {1 + len(lost)} of 30 trials" in said
    assert re.search(r"^trials +\d+ jobs", said, re.MULTILINE)
    assert len((cluster / "results/tables/belt.csv").read_text().splitlines()) == 1 + 3
    assert not list((cluster / "results").rglob(".*"))
    assert said.count("has been submitted with SLURM jobid") == 4


def test_a_lost_node_is_named_for_every_trial_that_it_had_not_finished(cluster, local):
    """The recording is whole again. The node returns as soon as its daemon answers."""
    shutil.copy2(local / LOG, cluster / LOG)
    node = slurm("sinfo", "--noheader", "--format=%n")

    def lose() -> None:
        slurm("scontrol", "update", f"nodename={node}", "state=down", "reason=test")

    said = run(cluster, *SLURM, then=lose, once=f"results/trials/{BROKEN}.parquet")
    assert said.endswith("exit code 1"), said
    assert lost_trials(said, "NODE_FAIL"), said
    assert not list((cluster / "results").rglob(".*"))


def test_a_full_disk_is_named(cluster):
    """It has room for a few results more."""
    used = sum(path.stat().st_blocks * 512 for path in (cluster / "results").rglob("*"))
    remount = ("mount", "-o")
    subprocess.run([*remount, f"remount,size={used + 300_000}", cluster / "results"], check=True)
    said = run(cluster, *SLURM)
    subprocess.run([*remount, f"remount,size={DISK_MB}m", cluster / "results"], check=True)
    assert said.endswith("exit code 1"), said
    assert "No space left on device" in said


def test_what_slurm_does_not_take_is_named_and_the_run_ends(cluster):
    """The submission asks for more memory than the node has."""
    said = run(cluster, *SLURM, "--set-resources", "fit_perturbation:mem_mb=9000000")
    assert said.endswith("exit code 1"), said
    assert "the cluster did not take its job (Memory specification can not be satisfied" in said


def test_the_next_run_makes_what_is_missing_and_every_table_is_that_of_the_local_run(cluster, local):
    said = run(cluster, *SLURM)
    assert said.endswith("exit code 0"), said
    assert said.count("has been submitted with SLURM jobid") == 1
    tables = sorted(
        path.relative_to(local) for path in (local / "results").rglob("*") if path.suffix in (".csv", ".zip")
    )
    assert len(tables) > 100
    differing = [path for path in tables if (local / path).read_bytes() != (cluster / path).read_bytes()]
    assert differing == []


def test_a_local_run_has_nothing_left_to_do(cluster):
    assert "Nothing to be done" in run(cluster, "-n")
    shutil.rmtree(cluster / ".snakemake")
    assert "Nothing to be done" in run(cluster, "-n")
