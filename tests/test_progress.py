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
    clock, ended = SimpleNamespace(now=100.0), {"job": "ingest.ingest_trial", "error": "b.mcap: no such file\x1b[31m"}
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock.now)
    for outcome in (outcomes := ("refused", "failed", "died", "skipped")):
        write_log(tmp_path / f"{outcome}.log", ended | {"outcome": outcome}, {})
    lines = LogHandler(SimpleNamespace(verbose=False, dryrun=False), None)
    tell(lines, LogEvent.RUN_INFO, stats={"ingest": 40, "reproduce-all": 1, "osl_validate": 1, "total": 42})
    for text in ("Building DAG of jobs...", "Unlocked."):
        tell(lines, text=text)
    tell(lines, text="of a developer", level=logging.DEBUG)
    tell(lines, LogEvent.JOB_FINISHED, job_id=99)  # of a target, which has no stage
    for job in range(40):
        logs = [f"{tmp_path}/{one}.log" for one in outcomes]
        tell(lines, LogEvent.JOB_INFO, jobid=job, rule_name="ingest", log=logs if job == 39 else None)
        clock.now += 0.5
        tell(lines, LogEvent.JOB_FINISHED, job_id=job)
    tell(lines, LogEvent.ERROR, "Error: Directory cannot be locked.", logging.ERROR)
    for settings in ((True, False), (False, True)):  # verbose and dry runs have the lines of Snakemake
        tell(LogHandler(SimpleNamespace(verbose=settings[0], dryrun=settings[1]), None), text="Unlocked.")
    assert lines.total.total() == 40
    assert capsys.readouterr().err.splitlines() == [
        "Unlocked.", "read and check recordings 21/40, 2/s, 10 s left",
        *(rf"{outcome}: {outcome}: b.mcap: no such file\x1b[31m" for outcome in outcomes[:3]),
        "read and check recordings 40/40 in 20 s", "Error: Directory cannot be locked.",
    ]  # fmt: skip


def test_a_rule_has_its_stage_in_a_module_too():
    stages = {"simulate_belt": "simulate", "trial_sheet": "simulate", "ingest": "read and check recordings"}
    stages |= dict.fromkeys(("plot_numbers_fig4", "draw_figure", "captions"), "figures") | {"study_batch": "study"}
    fits = "fit_belt_trial compare_belt_models pool_responses calibrate_markers identify_plate measure_platform "
    fits += "analyse_crossing select_crossings average_unperturbed summarise_walking impedance_over_stance"
    stages |= dict.fromkeys(fits.split(), "fit")
    stages |= dict.fromkeys(("table", "headline_numbers", "report", "judge", "excluded_trials"), "tables and page")
    assert {rule: stage_of(rule) for rule in stages} == {rule: stage_of(f"osl_{rule}") for rule in stages} == stages
