"""What a run does before its jobs: it reads the workflow without scipy, and starts jobs as soon as a core is free."""

import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import pytest
from snakemake.cli import get_argument_parser
from snakemake.settings.types import MaxJobsPerTimespan

from osl_analysis.scheduling import without_usual_rate

USUAL = get_argument_parser().get_default("max_jobs_per_timespan")


def rate_after(rate: str, local: bool) -> Any:
    """The rate of a workflow's settings after `without_usual_rate`."""
    settings = SimpleNamespace(max_jobs_per_timespan=MaxJobsPerTimespan.parse_choice(rate))
    executor = SimpleNamespace(common_settings=SimpleNamespace(local_exec=local))
    without_usual_rate(SimpleNamespace(scheduling_settings=settings), executor)
    return settings.max_jobs_per_timespan


def test_the_rate_that_snakemake_takes_without_being_told_is_dropped_on_this_machine() -> None:
    assert rate_after(USUAL, local=True) is None


@pytest.mark.parametrize(("rate", "local"), [("5/1s", True), ("100/1m", True), (USUAL, False)])
def test_a_rate_that_a_user_states_and_the_rate_on_a_cluster_stay(rate: str, local: bool) -> None:
    asked = MaxJobsPerTimespan.parse_choice(rate)
    kept = rate_after(rate, local)
    assert (kept.max_jobs, kept.timespan) == (asked.max_jobs, asked.timespan)


def test_the_workflow_is_read_without_the_parts_of_scipy_that_take_a_second_to_import() -> None:
    read = "import sys, osl_analysis.campaign, osl_analysis.commands.simulate; print(*sys.modules)"
    said = subprocess.run([sys.executable, "-c", read], capture_output=True, text=True, check=True).stdout.split()
    assert "osl_analysis.signals" in said
    assert not {"scipy.signal", "scipy.interpolate", "scipy.optimize", "matplotlib"} & set(said)
