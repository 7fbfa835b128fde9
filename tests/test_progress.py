"""The lines of a run: a line per stage, failures at once, no spam, and the right count and time left."""

import logging
from types import SimpleNamespace

import pytest
from snakemake_interface_logger_plugins.common import LogEvent

from osl_analysis.jobs import progress
from osl_analysis.jobs.job_log import write_log
from osl_analysis.jobs.progress import LogHandler, stage_of


@pytest.fixture
def clock(monkeypatch):
    """A clock that the test turns."""
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock.now)
    return clock


def handler(verbose=False, dryrun=False):
    return LogHandler(SimpleNamespace(verbose=verbose, dryrun=dryrun), None)


def tell(handler, event=None, text="", level=logging.INFO, **more):
    record = logging.LogRecord("snakemake", level, "", 0, text, (), None)
    record.__dict__ |= {"event": event, **more}
    handler.emit(record)


def begin(handler, job, rule, *logs):
    tell(handler, LogEvent.JOB_INFO, jobid=job, rule_name=rule, log=[*logs])


def test_a_stage_writes_one_line_now_and_then_and_one_at_its_end(clock, capsys):
    lines = handler()
    tell(lines, LogEvent.RUN_INFO, stats={"ingest": 40, "reproduce-all": 1, "total": 41})
    for job in range(40):
        begin(lines, job, "ingest")
        clock.now += 0.5
        tell(lines, LogEvent.JOB_FINISHED, job_id=job)
    assert capsys.readouterr().err.splitlines() == [
        "read and check recordings 21/40, 2/s, 10 s left",
        "read and check recordings 40/40 in 20 s",
    ]


def test_a_rule_has_its_stage_in_a_module_too():
    stages = {"simulate_belt": "simulate", "ingest": "read and check recordings", "plot_numbers_fig4": "figures"}
    stages |= dict.fromkeys(("fit_belt_trial", "summarise_walking"), "fit")
    stages |= dict.fromkeys(("table", "headline_numbers", "report", "judge", "excluded_trials"), "tables and page")
    assert {rule: stage_of(rule) for rule in stages} == {rule: stage_of(f"osl_{rule}") for rule in stages} == stages


def test_what_a_user_must_know_is_said_at_once_and_the_lines_of_snakemake_are_left_out(clock, tmp_path, capsys):
    log, lines = tmp_path / "belt_01.log", handler()
    ended = {"job": "ingest.ingest_trial", "outcome": "refused", "error": "belt_01.mcap: no such file; copy it\x1b[31m"}
    write_log(log, ended, {})
    tell(lines, LogEvent.RUN_INFO, stats={"ingest": 1, "total": 1})
    tell(lines, text="Building DAG of jobs...")
    tell(lines, text="Execute 1 jobs...")
    begin(lines, 3, "ingest", str(log))
    tell(lines, LogEvent.JOB_FINISHED, job_id=3)
    tell(lines, text="Unlocked working directory.")
    tell(lines, LogEvent.ERROR, "Error: Directory cannot be locked.", logging.ERROR)
    for settings in ({"verbose": True}, {"dryrun": True}):  # these have the lines of Snakemake
        tell(handler(**settings), text="Unlocked working directory.")
        assert not handler(**settings).writes_to_stream
    assert capsys.readouterr().err.splitlines() == [
        r"refused: belt_01: belt_01.mcap: no such file; copy it\x1b[31m",
        "read and check recordings 1/1 in 0 s",
        "Unlocked working directory.",
        "Error: Directory cannot be locked.",
    ]
