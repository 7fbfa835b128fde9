"""Runs of Snakemake for the tests, in processes that are forked from one that has imported what every run imports.

A run that starts Python anew takes 2 s more, and the tests run Snakemake some forty times. The first run of the
campaign, and those that need another package or start, are started as a user starts them.
"""

import atexit
import json
import subprocess
import sys
from functools import cache
from pathlib import Path

from conftest import ROOT

FORKING = """
import json, os, sys
import snakemake.cli, snakemake.api, snakemake.workflow, snakemake.dag
import osl_analysis.campaign, osl_analysis.doubtful, osl_analysis.refusal_report, osl_analysis.job, osl_analysis.stale
import osl_analysis.commands.simulate, osl_analysis.study

for line in sys.stdin:
    arguments, folder, said = json.loads(line)
    pid = os.fork()
    if not pid:
        os.chdir(folder)
        os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 1)
        os.dup2(1, 2)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        sys.argv = ["snakemake", *arguments]
        snakemake.cli.main()
        os._exit(0)
    print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)
"""


@cache
def forking() -> subprocess.Popen[str]:
    """The process from which the runs are forked. `osl_analysis.workflow` notes the time when it is imported: later."""
    started = subprocess.Popen(
        [sys.executable, "-c", FORKING], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    atexit.register(started.kill)
    return started


def run_snakemake(arguments: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run Snakemake in a folder; both of its streams are in `stdout`."""
    said, server = folder / "said.txt", forking()
    assert server.stdin is not None
    assert server.stdout is not None
    server.stdin.write(json.dumps([arguments, str(folder), str(said)]) + "\n")
    server.stdin.flush()
    code = int(server.stdout.readline())
    return subprocess.CompletedProcess(arguments, code, said.read_text(), "")
