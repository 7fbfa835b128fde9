# SPDX-License-Identifier: Apache-2.0
"""What is refused is a row with its reason and stops nothing else; and the lines of a run: one per
stage, the right counts."""

import errno
import logging
import os
import re
import subprocess
import sys
import warnings
import zipfile
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from pkgutil import resolve_name
from types import SimpleNamespace

import numpy as np
import polars as pl
import psutil
import pytest
from conftest import ROOT, refused_with, white_noise
from polars.testing import assert_frame_equal
from shipped import CONFIG
from snakemake.exceptions import LockException, format_exception_to_string
from snakemake_interface_logger_plugins.common import LogEvent
from snakemake_runs import run_forked

from osl_analysis.base.errors import InputError, MemoryLimitError, WriteError, advise
from osl_analysis.base.table import NotAnalysed, not_analysed, read_table, write_table, write_tables
from osl_analysis.base.trial import Trial, read_trial
from osl_analysis.commands import trials
from osl_analysis.commands.report import failure_lines
from osl_analysis.commands.tables import gather, judge, list_excluded, read_summary_file
from osl_analysis.commands.walking import (
    read_crossing_file,
    read_model,
)
from osl_analysis.ingest.quality import Commanded, measure_quality
from osl_analysis.jobs.job import Job, TrialFiles
from osl_analysis.jobs.perform import drop_excluded, drop_refused, perform, write_reasons
from osl_analysis.jobs.progress import LogHandler, read_log, write_log
from osl_analysis.judge.campaign import exclusion_report
from osl_analysis.judge.recording_checks import QualityRules, measured_table, read_verdicts
from osl_analysis.walking.poses import StaticCalibration

LOST = NotAnalysed("b_1", "raw/b_1.mcap: no such file; copy it there")


NO_TRIAL = TrialFiles()


def job(tmp_path, function, inputs=None, outputs=None, trial=NO_TRIAL, **arguments):
    return Job(
        resolve_name(f"osl_analysis.commands.{function}"),
        outputs or [tmp_path / "tables/belt.csv"],
        tmp_path / "logs/belt.log",
        inputs or {},
        arguments,
        trial=trial,
        data="measured",
    )


@dataclass(frozen=True)
class Fields:
    """An input of several files."""

    several: list[Path]
    single: Path


def lost(path, *causes):
    """A file of what was not analysed, as a job leaves it."""
    write_reasons(job(path.parent, "fit.fit_belt_trial", outputs=[path]), causes)
    return path


def result(path):
    write_table(pl.DataFrame({"trial": [path.stem], "K_s": [685.6]}), path)
    return path


@pytest.mark.parametrize("name", ["fits/belt/x.csv", "x.parquet", "fits/belt/x.zip", "x.json"])
def test_why_there_is_no_result_reads_back_whatever_the_reason_holds(tmp_path, name):
    odd = NotAnalysed("b,1", "columns 'a', \"b\": 1,2; # no \u00e9")

    path = lost(tmp_path / name, odd, LOST)

    assert not_analysed(path) == (odd, LOST)


def test_a_result_is_none_that_was_not_analysed(tmp_path):
    frame = pl.DataFrame({"trial": ["not analysed"]})
    frame.write_parquet(tmp_path / "a.parquet")
    write_tables({tmp_path / "a.zip/series.csv": frame, tmp_path / "a.csv": frame}, "measured")
    names = ("a.parquet", "a.zip", "a.csv", "missing.csv")
    assert [not_analysed(tmp_path / name) for name in names] == [()] * 4


READERS = [
    (read_trial, "parquet"),
    (read_table, "csv"),
    (read_summary_file, "json"),
    (read_crossing_file, "parquet"),
    (lambda path: read_model(path, StaticCalibration), "json"),
]


@pytest.mark.parametrize(("read", "suffix"), READERS)
def test_who_reads_it_for_a_result_is_told_the_reason(tmp_path, read, suffix):
    with refused_with(r"b_1: raw/b_1\.mcap:"):
        read(lost(tmp_path / f"b_1.{suffix}", LOST))


def test_a_trial_refused_in_one_list_is_missing_from_every_list(tmp_path):
    good = [result(tmp_path / f"{folder}/b_2.csv") for folder in ("trials", "fits", "quality")]
    bad = [result(tmp_path / "trials/b_1.csv"), lost(tmp_path / "fits/b_1.csv", LOST)]
    inputs = {"trials": [bad[0], good[0]], "fitted": [bad[1], good[1]], "quality": [good[2]]}
    used = {"trials": [good[0]], "fitted": [good[1]], "quality": [good[2]]}
    assert drop_refused(inputs) == (used, [LOST], [])
    assert drop_refused({"trials": good}, also_of=bad) == ({"trials": good}, [LOST], [])
    by_name = {"tables": {"b_1": bad[1], "b_2": good[1]}}
    assert drop_refused(by_name) == ({"tables": {"b_2": good[1]}}, [LOST], [])
    assert drop_refused({"rows": bad[1:]}) == ({"rows": []}, [LOST], [LOST])
    assert drop_refused({"trial": bad[1]}) == ({"trial": bad[1]}, [LOST], [LOST])
    assert drop_refused({"trial": good[1], "parameters": None})[1:] == ([], [])
    used, refused, missing = drop_refused({"fields": Fields([bad[1], good[1]], good[2])})
    assert (used, refused, missing) == ({"fields": Fields([good[1]], good[2])}, [LOST], [])
    assert drop_refused({"fields": Fields([good[1]], bad[1])})[2] == [LOST]
    refused = lost(tmp_path / "quality/b_1.csv", LOST)
    assert read_verdicts([refused], QualityRules(), {}).is_empty()  # that is no verdict


def ended(job):
    perform(job)
    return read_log(job.log)["outcome"], not_analysed(job.outputs[-1])


def test_where_the_input_is_at_fault_the_reason_replaces_an_old_result(tmp_path):
    result(tmp_path / "tables/belt.csv")

    inputs = {"rows": [tmp_path / "b_1.csv"]}
    outcome, (cause,) = ended(job(tmp_path, "tables.gather", inputs, name="belt"))

    assert outcome == "refused"
    assert cause.reason.startswith(f"{tmp_path}/b_1.csv: ")


def test_a_job_over_several_trials_refuses_the_one_at_fault(tmp_path):
    def refuse(trials: list[Path]) -> None:
        raise InputError("trial b_2: no motion", "record it again", trial="b_2")

    of_all = job(tmp_path, "tables.gather", {"trials": [Path("b_1.parquet"), Path("b_2.parquet")]})

    _, causes = ended(replace(of_all, function=refuse))

    assert causes == (NotAnalysed("b_2", "trial b_2: no motion; record it again"),)


def test_a_refused_trial_has_a_row_with_its_reason_and_without_estimates(tmp_path):
    fit = pl.DataFrame({"trial": "b_2", "K_s": 685.6, "status": "analysed"})
    write_table(fit, tmp_path / "b_2.csv")

    table = gather([tmp_path / "b_2.csv"], "belt", not_analysed=[LOST])

    assert set(table.select("trial", "status", "K_s", "reason").rows()) == {
        ("b_2", "analysed", 685.6, None),
        ("b_1", "not analysed", None, LOST.reason),
    }


def test_a_fault_of_the_program_is_an_error_of_the_job_and_writes_nothing(tmp_path):
    inputs = {"trial": tmp_path / "trials/b_1.parquet"}
    asked = job(tmp_path, "walking.analyse", inputs, settings={}, mistyped={})

    with pytest.raises(RuntimeError, match="unexpected"):
        perform(asked)

    log = read_log(asked.log)
    assert log["outcome"] == "failed"
    assert "logs/belt.log" in log["remedy"]
    assert "Traceback" in log["traceback"]
    assert not any(file.exists() for file in asked.outputs)


def test_a_job_that_lacks_an_input_passes_the_reasons_on(tmp_path):
    other = NotAnalysed("b_2", "no belt")
    inputs = {"table": lost(tmp_path / "belt.csv", LOST, other)}
    assert ended(job(tmp_path, "fit.derive", inputs)) == (
        "skipped",
        (LOST, other),
    )


def test_of_ingest_and_quality_control_both_results_stand_or_none(tmp_path, monkeypatch):
    trial = tmp_path / "trials/b_1.parquet"
    quality = tmp_path / "quality/b_1.csv"
    limited = []

    def refuse(*_):
        raise InputError("raw/b_1.mcap: too short", "record it again")

    monkeypatch.setattr(trials, "checked_trial", lambda *_: None)
    monkeypatch.setattr(trials, "write_trial", lambda _, path: result(path))
    monkeypatch.setattr(trials, "measure_quality", refuse)
    monkeypatch.setattr(
        "osl_analysis.jobs.perform.limited_memory",
        lambda files, at_once: limited.append(files) or nullcontext(),
    )
    settings = {
        "row": {"trial": "b_1", "experiment": "belt", "log": "b_1.mcap"},
        "needed_columns": [],
        "raw_folder": Path("raw"),
        "sources_folder": Path(),
        "commanded": Commanded(),
        "quality": quality,
    }
    asked = job(tmp_path, "trials.ingest_and_check", outputs=[trial, quality], **settings)
    of_trial = TrialFiles("b_1", [Path("raw/b_1.mcap")])
    arguments = {**settings, "trial": trial}
    outcome, causes = ended(replace(asked, trial=of_trial, arguments=arguments))
    assert outcome == "refused"
    assert not_analysed(trial) == causes == (("b_1", "raw/b_1.mcap: too short; record it again"),)
    assert limited == [[Path("raw/b_1.mcap")]], "where memory is short, the recording is named"


WORKERS = """
import os, signal
from pathlib import Path
from osl_analysis.base.errors import show_advice_alone
from osl_analysis.jobs import workers
from osl_analysis.jobs.job import Job

os.environ["OMP_NUM_THREADS"] = "64"
def do(worker, log):
    worker.connection.send(Job(show_advice_alone, [], Path(log)))
    worker.connection.recv()

first, second = workers.Worker(), workers.Worker()
for worker in (first, second):
    do(worker, "job.log")
process = Path(f"/proc/{first.process.pid}")
one_core = b"OMP_NUM_THREADS=1\\0" in (process / "environ").read_bytes()
environment = [one_core, os.environ["OMP_NUM_THREADS"]]
mapped = "llvmlite" in (process / "maps").read_text()
os.kill(first.process.pid, signal.SIGKILL)
do(second, "again.log")
print([environment, mapped, Path("again.log").exists(), first.end()])
workers.IDLE[False].append(second)
print(second.process.pid, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_worker_does_several_jobs_and_ends_with_a_killed_snakemake(tmp_path):
    """On one core; and a killed worker takes no other with it."""
    path = os.environ | {"PYTHONPATH": str(ROOT)}
    told = subprocess.run(
        [sys.executable, "-c", WORKERS], capture_output=True, text=True, cwd=tmp_path, env=path
    )

    facts, pid = told.stdout.splitlines()
    assert facts == "[[True, '64'], False, True, 'SIGKILL']", told.stderr
    assert (told.returncode, told.stderr) == (-9, "")
    left = [process for process in psutil.process_iter() if process.pid == int(pid)]
    assert psutil.wait_procs(left, timeout=20)[1] == []


def test_the_same_cause_in_many_trials_is_one_line_and_another_its_own():
    recordings = {name: [f"raw/{name}.c3d"] for name in ("heel", "knee", "toe", "walk", "run")}
    reasons = {"walk": "no plate; zero it"}
    for n, name in enumerate(("heel", "knee", "toe")):
        reasons[name] = f"trial {name}: {n}.5 N in raw/{name}.c3d; zero it"

    title, *told = failure_lines(reasons, {"tables/plate.csv": "no trials"}, recordings)

    assert re.search(" 4 .* 5 ", title)
    patterns = (
        r"heel, .*raw/heel\.c3d: .*0\.5 N .*; zero it.* knee, toe",
        r"walk, .*raw/walk\.c3d: no plate; zero it",
        r"tables/plate\.csv: no trials",
    )
    for line, pattern in zip(told, patterns, strict=True):
        assert re.search(pattern, line)


TABLES = {
    "phasors": pl.DataFrame({"trial": ["01", "01"], "gain": [0.1 + 0.2, 1e-17]}),
    "series": pl.DataFrame({"time": [0.0, 1.0], "torque": [None, float("nan")]}),
}


def test_an_archive_of_tables_holds_all_that_was_written_or_nothing(tmp_path):
    path = tmp_path / "fits/t_1.zip"
    write_tables({path / f"{name}.csv": table for name, table in TABLES.items()})
    before = path.read_bytes()

    for name, table in TABLES.items():
        assert_frame_equal(read_table(path, name=name), table, check_column_order=False)
    with zipfile.ZipFile(path) as archive:
        dates = {entry.date_time for entry in archive.infolist()}
    assert dates == {(1980, 1, 1, 0, 0, 0)}, "the same tables make the same archive"
    with pytest.raises(AttributeError):
        write_tables({path / "series.csv": TABLES["series"], path / "other.csv": None})
    assert path.read_bytes() == before
    with refused_with(r"t_1\.zip: "):
        read_table(path, name="response")


@pytest.mark.parametrize(
    "error",
    [
        WriteError("a.csv: cannot be written (No space left on device)", "make room"),
        MemoryLimitError("a.mcap: not enough memory", "make room"),
        OSError(errno.EIO, "Input/output error; make room", "raw_data/b_1.mcap"),
        PermissionError(errno.EACCES, "denied", "parameters.yaml"),  # which is no recording
    ],
)
def test_what_the_machine_lacks_is_an_error_of_the_run_and_no_refusal(tmp_path, monkeypatch, error):
    """The next run tries again."""

    def lacking(_):
        warnings.warn("of a library", stacklevel=1)
        advise("late\x1b")
        advise("late\x1b")
        raise error

    monkeypatch.setattr("osl_analysis.jobs.perform.run", lacking)
    recorded = TrialFiles("b_1", [Path("raw_data/b_1.mcap")])
    asked = job(tmp_path, "tables.gather", trial=recorded)
    with pytest.raises(RuntimeError, match=r"No space left|not enough memory|Input/output|denied"):
        perform(asked)
    log = read_log(asked.log)
    assert (log["outcome"], log["warnings"]) == ("failed", [r"late\x1b"])
    assert not any(file.exists() for file in asked.outputs)


RULES = CONFIG.quality
ACCEPT = {"plate_3": ["unzeroed_plate"]}


@pytest.fixture
def checked(tmp_path):
    """What was measured on three plate trials: a slow one, which flags it, two with a plate that
    was not zeroed."""
    paths = []
    for name, offset, rate in (
        ("plate_1", 1.0, 50),
        ("plate_2", -80.0, 1000),
        ("plate_3", -90.0, 1000),
    ):
        force = offset + white_noise(1000, 1)
        trial = Trial(name, pl.DataFrame({"time": np.arange(1000) / rate, "plate1_force_z": force}))
        paths.append(tmp_path / f"quality/{name}.csv")
        write_table(
            measured_table(name, measure_quality(trial, "plate", Commanded((), (), 1))), paths[-1]
        )
    return paths


def test_who_was_left_out_is_listed_with_value_threshold_and_remedy(checked):
    folder = checked[0].parent
    lost = NotAnalysed("plate_9", "p.c3d: truncated; export it again")
    verdicts = folder / "quality.csv"
    sheet = {
        "b_2": {"experiment": "plate", "exclude": "stumbled"},
        "w_1": {"experiment": "walking", "exclude": None},
    }

    write_table(judge(checked, RULES, ACCEPT, [lost]), verdicts)
    listed = list_excluded({}, verdicts, sheet, [lost])

    judged = read_table(verdicts).filter(~pl.col("verdict").is_in(["pass", "not applicable"]))
    outcomes = [("plate_1", "flag"), ("plate_2", "exclude"), ("plate_9", "refused")]
    assert judged.select("trial", "verdict").rows() == outcomes
    assert judged["value"].to_list()[1:] == [pytest.approx(80, abs=0.5), None]
    assert listed.select("trial", "check").rows() == [
        ("plate_9", "refused"),
        ("plate_2", "unzeroed_plate"),
        ("b_2", "sample sheet"),
        ("w_1", "needs another"),
    ]
    assert listed["remark"][0] == lost.reason
    assert listed["remark"][-1].endswith(" was refused or excluded: b_2")
    said = exclusion_report(listed)
    assert "b_2 (stumbled)" in said
    assert "plate_2 (unzeroed_plate" in said


@pytest.mark.parametrize(
    "inputs",
    [{"rows": [Path("fits/plate_2.csv")]}, {"trial": Path("trials/plate_2.parquet")}],
)
def test_where_nothing_is_left_the_reason_is_one_line_with_a_remedy(inputs):
    with refused_with(r"^[^\n]*plate_2; [^\n]*`exclude`[^\n]*$"):
        drop_excluded(inputs, ["plate_2"])


def handler():
    return LogHandler(SimpleNamespace(verbose=False, dryrun=False), None)


def tell(lines, event=None, text="", level=logging.INFO, **more):
    lines.emit(logging.makeLogRecord({"levelno": level, "msg": text, "event": event, **more}))


def test_a_run_has_lines_now_and_then_and_tells_what_is_refused_at_once(
    monkeypatch, tmp_path, capsys
):
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr("time.monotonic", lambda: clock.now)
    outcomes = ("refused", "failed", "killed", "skipped")
    for outcome in outcomes:
        ending = {"outcome": outcome, "error": "b.mcap: no such file\x1b[31m"}
        remedy = {} if outcome == "skipped" else {"remedy": "copy it"}
        write_log(tmp_path / f"{outcome}.log", ending | remedy)
    lines = handler()
    tell(lines, LogEvent.RUN_INFO, stats={"osl_ingest": 40, "reproduce-all": 1, "total": 41})
    tell(lines, text="Building DAG of jobs...")
    for job in range(40):
        logs = [f"{tmp_path}/{one}.log" for one in outcomes]
        tell(
            lines,
            LogEvent.JOB_INFO,
            jobid=job,
            rule_name="osl_ingest",
            log=logs if job >= 38 else [],  # the same causes twice,
        )
        clock.now += 0.5
        tell(lines, LogEvent.JOB_FINISHED, job_id=job)
    first, *of_jobs, last = capsys.readouterr().err.splitlines()
    assert re.search("21/40.* 10 s", first)
    assert [line.partition(":")[0] for line in of_jobs] == [*outcomes[:3]]
    assert re.search("40/40.* 20 s", last)
    assert r"no such file\x1b[31m" in of_jobs[0]


def test_an_error_in_a_file_of_the_user_is_one_sentence(capsys):
    lines = handler()
    frames = (
        'WorkflowError in file "/a/rules/common.smk", line 79:\n{}\n  File "/a/x", line 79, in b'
    )

    tell(lines, LogEvent.ERROR, frames.format("c.yaml: line 9: no"), logging.ERROR)

    assert capsys.readouterr().err == "error: c.yaml: line 9: no\n"


def test_no_line_of_snakemake_follows_the_error_of_a_job(tmp_path, capsys):
    write_log(tmp_path / "verdict.log", {"outcome": "failed", "error": "1 trial", "remedy": "mend"})
    lines = handler()
    log = [f"{tmp_path}/verdict.log"]
    following = "Exiting because a job execution failed."

    tell(lines, text=following, level=logging.ERROR)
    tell(lines, LogEvent.JOB_INFO, jobid=1, rule_name="verdict", log=log)
    tell(lines, LogEvent.JOB_ERROR, jobid=1, log=log)
    tell(lines, text=following, level=logging.ERROR)

    assert capsys.readouterr().err.splitlines() == [following, "failed: verdict: 1 trial; mend"]


def lines_of_a_stage(ended, monkeypatch, capsys):
    """What is printed while the first of ten jobs of a stage end, each after 11 s."""
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr("time.monotonic", lambda: clock.now)
    lines = handler()
    tell(lines, LogEvent.RUN_INFO, stats={"ingest": 10})
    for job in range(ended):
        tell(lines, LogEvent.JOB_INFO, jobid=job, rule_name="ingest", log=[])
        clock.now += 11
        tell(lines, LogEvent.JOB_FINISHED, job_id=job)
    return capsys.readouterr().err.splitlines()


def test_a_line_of_a_stage_tells_the_time_left(monkeypatch, capsys):
    of_six = lines_of_a_stage(6, monkeypatch, capsys)[-1]

    assert of_six.endswith("6/10, about 44 s left")


def test_no_time_left_is_told_before_half_of_a_stage(monkeypatch, capsys):
    of_five = lines_of_a_stage(5, monkeypatch, capsys)[-1]

    assert of_five.endswith("5/10")


def test_a_lock_is_one_line(capsys):
    lines = handler()
    text = format_exception_to_string(LockException())

    tell(lines, LogEvent.ERROR, text, logging.ERROR, exception="LockException")

    (lock,) = capsys.readouterr().err.splitlines()
    assert lock.startswith("error: ")


WORKFLOW = """
from pathlib import Path
from osl_analysis.jobs.progress import write_log

rule all:
    input: "own", "other", "of_shell"

rule own:
    output: "own"
    log: "b_1.log"
    run:
        ending = {"outcome": "failed", "error": "a.csv: not written", "remedy": "make room"}
        write_log(Path(log[0]), ending)
        raise RuntimeError(ending["error"])

rule other:
    output: "other"
    log: "other.log"
    run:
        Path(log[0]).write_text("no mapping of YAML")
        raise RuntimeError("this rule is broken")

rule of_shell:
    output: "of_shell"
    shell: "exit 3"
"""


def test_an_error_of_ours_is_told_once_another_s_as_snakemake_does(tmp_path):
    (tmp_path / "Snakefile").write_text(WORKFLOW)
    asked = "snakemake --cores 3 --keep-going --force-use-threads --show-failed-logs --logger osl"

    said = run_forked(asked.split(), tmp_path).stdout

    assert re.findall(".*not written.*", said) == ["failed: b_1: a.csv: not written; make room"]
    for told in ("rule other:", "this rule is broken", "no mapping", "rule of_shell:", "exit 3"):
        assert told in said
