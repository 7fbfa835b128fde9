"""The lines of a run: a line per stage, failures at once, no spam, and the right count and time left."""

import logging
from types import SimpleNamespace

from snakemake_interface_logger_plugins.common import LogEvent

from osl_analysis.jobs import progress
from osl_analysis.jobs.job_log import write_log
from osl_analysis.jobs.progress import LogHandler, stage_of


def tell(handler, event=None, text="", level=logging.INFO, **more):
    record = logging.LogRecord("snakemake", level, "", 0, text, (), None)
    record.__dict__ |= {"event": event, **more}
    handler.emit(record)


def test_a_run_has_a_line_now_and_then_one_per_stage_and_what_is_refused_at_once(monkeypatch, tmp_path, capsys):
    clock, log = SimpleNamespace(now=100.0), tmp_path / "belt_01.log"
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock.now)
    ended = {"job": "ingest.ingest_trial", "outcome": "refused", "error": "belt_01.mcap: no such file; copy it\x1b[31m"}
    write_log(log, ended, {})
    lines = LogHandler(SimpleNamespace(verbose=False, dryrun=False), None)
    tell(lines, LogEvent.RUN_INFO, stats={"ingest": 40, "reproduce-all": 1, "total": 41})
    tell(lines, text="Building DAG of jobs...")
    for job in range(40):
        tell(lines, LogEvent.JOB_INFO, jobid=job, rule_name="ingest", log=[str(log)] * (job == 39))
        clock.now += 0.5
        tell(lines, LogEvent.JOB_FINISHED, job_id=job)
    tell(lines, LogEvent.ERROR, "Error: Directory cannot be locked.", logging.ERROR)
    for settings in ((True, False), (False, True)):  # verbose and dry runs have the lines of Snakemake
        tell(LogHandler(SimpleNamespace(verbose=settings[0], dryrun=settings[1]), None), text="Unlocked.")
    assert capsys.readouterr().err.splitlines() == [
        "read and check recordings 21/40, 2/s, 10 s left",
        r"refused: belt_01: belt_01.mcap: no such file; copy it\x1b[31m",
        "read and check recordings 40/40 in 20 s",
        "Error: Directory cannot be locked.",
    ]


def test_a_rule_has_its_stage_in_a_module_too():
    stages = {"simulate_belt": "simulate", "ingest": "read and check recordings", "plot_numbers_fig4": "figures"}
    stages |= dict.fromkeys(("fit_belt_trial", "summarise_walking"), "fit")
    stages |= dict.fromkeys(("table", "headline_numbers", "report", "judge", "excluded_trials"), "tables and page")
    assert {rule: stage_of(rule) for rule in stages} == {rule: stage_of(f"osl_{rule}") for rule in stages} == stages
