"""The lines of a run: a line per stage, failures at once, no spam, and the right count and time left."""

import io
import logging
import threading
from types import SimpleNamespace

import pytest
from snakemake.scheduling.job_scheduler import JobScheduler
from snakemake_interface_logger_plugins.common import LogEvent

from osl_analysis.jobs import progress
from osl_analysis.jobs.job_log import JobLog, write_log
from osl_analysis.jobs.progress import LogHandler, Progress, stage_of


@pytest.fixture
def clock(monkeypatch):
    """A clock that the test turns."""
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock.now)
    return clock


def test_a_stage_writes_one_line_now_and_then_and_one_at_its_end(clock):
    out = io.StringIO()
    lines = Progress(out, is_terminal=False)
    lines.plan({"ingest": 40, "reproduce-all": 1, "total": 41})
    for job in range(40):
        lines.begin(job, "ingest", [])
        clock.now += 0.5
        lines.finish(job)
    said = out.getvalue().splitlines()
    assert said[-1] == "read and check recordings 40/40 in 20 s"
    assert 2 <= len(said) <= 4


def test_a_terminal_has_what_runs_on_its_last_line(clock):
    out = io.StringIO()
    lines = Progress(out, is_terminal=True)
    lines.plan({"ingest": 4, "fit_belt_trial": 2})
    lines.begin(0, "ingest", [])
    lines.begin(1, "fit_belt_trial", [])
    clock.now += 2
    lines.finish(0)
    assert out.getvalue().endswith("\r\x1b[Kread and check recordings 1/4, 0.5/s, 6 s left | fit 0/2")


def test_a_refusal_is_said_when_its_job_ends(tmp_path):
    log = tmp_path / "belt_01.log"
    write_log(log, JobLog("ingest.ingest_trial", "refused", error="belt_01.mcap: no such file; copy it\x1b[31m"), {})
    out = io.StringIO()
    lines = Progress(out, is_terminal=False)
    lines.plan({"ingest": 2})
    lines.begin(0, "ingest", [str(log)])
    lines.finish(0)
    (said,) = out.getvalue().splitlines()
    assert said.startswith("refused: belt_01: belt_01.mcap: no such file; copy it")
    assert "\x1b" not in said


@pytest.mark.parametrize("prefix", ["", "osl_"])
@pytest.mark.parametrize(
    ("rule", "stage"),
    [("simulate_belt", "simulate"), ("ingest", "read and check recordings"), ("fit_belt_trial", "fit"),
     ("plot_numbers_fig4", "figures"), ("summarise_walking", "fit"),
     *((rule, "tables and page") for rule in ("table", "headline_numbers", "report", "judge", "excluded_trials"))],
)  # fmt: skip
def test_a_rule_has_its_stage_in_a_module_too(prefix, rule, stage):
    assert stage_of(prefix + rule) == stage


def record(event=None, text="", level=logging.INFO, **more):
    made = logging.LogRecord("snakemake", level, "", 0, text, (), None)
    made.__dict__ |= {"event": event, **more}
    return made


def test_the_lines_of_snakemake_are_left_out_but_for_what_a_user_must_know(capsys):
    settings = SimpleNamespace(verbose=False, dryrun=False)
    handler = LogHandler(settings, None)
    handler.emit(record(LogEvent.RUN_INFO, stats={"ingest": 1, "total": 1}))
    handler.emit(record(text="Building DAG of jobs..."))
    handler.emit(record(text="Execute 1 jobs..."))
    handler.emit(record(LogEvent.JOB_INFO, jobid=3, rule_name="ingest", log=[]))
    handler.emit(record(LogEvent.JOB_FINISHED, job_id=3))
    handler.emit(record(text="Unlocked working directory."))
    handler.emit(record(LogEvent.ERROR, "Error: Directory cannot be locked.", logging.ERROR))
    said = capsys.readouterr().err.splitlines()
    assert said == [
        "read and check recordings 1/1 in 0 s",
        "Unlocked working directory.",
        "Error: Directory cannot be locked.",
    ]


@pytest.mark.parametrize("settings", [{"verbose": True, "dryrun": False}, {"verbose": False, "dryrun": True}])
def test_a_dry_run_and_a_verbose_one_have_the_lines_of_snakemake(settings, capsys):
    handler = LogHandler(SimpleNamespace(**settings), None)
    handler.emit(record(text="Unlocked working directory."))
    assert not handler.writes_to_stream
    assert capsys.readouterr().err == ""


def test_timers_of_the_scheduler_do_not_add_up_and_none_outlives_the_last_job():
    handler = LogHandler(SimpleNamespace(verbose=False, dryrun=False), None)
    timers = [threading.Timer(60, JobScheduler._noop) for _ in range(3)]
    other = threading.Timer(60, print)
    for timer in (*timers, other):
        timer.start()
    left = []
    for event, counted in [(LogEvent.JOB_STARTED, {}), (LogEvent.PROGRESS, {"done": 4, "total": 4})]:
        handler.emit(record(event, **counted))
        left.append([timer.finished.is_set() for timer in (*timers, other)])
    other.cancel()
    assert left == [[True, True, False, False], [True, True, True, False]]
