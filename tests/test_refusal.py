"""What is refused leaves a record and stops nothing else; and the lines of a run: one per stage,
the right counts."""

import json
import logging
import os
import platform
import re
import signal
import socket
import subprocess
import sys
import warnings
import zipfile
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from conftest import ROOT
from snakemake.exceptions import LockException, format_exception_to_string
from snakemake_interface_logger_plugins.common import LogEvent

from osl_analysis.campaign.configuration import read_section
from osl_analysis.commands import trials
from osl_analysis.commands.tables import gather, judge, list_excluded, read_summary
from osl_analysis.commands.walking import read_crossing_file, read_model, read_unperturbed_gaits
from osl_analysis.errors import InputError, WriteError
from osl_analysis.files import digest, file_state, temporary_path
from osl_analysis.ingest.examine import Commanded, examine, measured_table
from osl_analysis.jobs import progress
from osl_analysis.jobs import request as jobs_request
from osl_analysis.jobs import run as jobs_run
from osl_analysis.jobs.job import died, perform, refusal
from osl_analysis.jobs.job_log import read_log, write_log
from osl_analysis.jobs.progress import LogHandler
from osl_analysis.jobs.run import job_server, run_job
from osl_analysis.judge.campaign import campaign_findings, exclusion_report
from osl_analysis.judge.limits import DoubtfulFits, QualityRules
from osl_analysis.judge.used import (
    Judge,
    exclusions,
    left_behind_report,
    without_excluded,
    without_refused,
)
from osl_analysis.refusal import (
    Refusal,
    alike,
    is_refused,
    read_refusals,
    refusal_report,
    refused_trials,
    write_refusals,
)
from osl_analysis.table import read_table, write_table, write_tables
from osl_analysis.trial import Trial, read_trial, write_trial
from osl_analysis.walking.poses import StaticCalibration

LOST = Refusal(
    "b_1",
    "raw/b_1.mcap",
    "ingest.ingest_trial",
    "refused",
    "raw/b_1.mcap: no such file",
    "copy it there",
)
KILLED = Refusal(
    "b_2", "raw/b_2.mcap", "bench.fit", "died", "the process of this job was killed", "run again"
)


def record(path, *causes):
    write_refusals(causes, path)
    return str(path)


def result(path):
    write_table(pl.DataFrame({"trial": [path.stem], "K_s": [685.6]}), path)
    return str(path)


def test_a_record_reads_back_whatever_the_reason_holds(tmp_path):
    odd = Refusal("b,1", 'a "file"', "j", "refused", "columns 'a', \"b\": 1,2; # no", "")
    assert read_refusals(record(tmp_path / "x.parquet", odd, LOST)) == (odd, LOST)
    (tmp_path / "large.csv").write_bytes((tmp_path / "x.parquet").read_bytes().ljust(1 << 20))
    assert not is_refused(tmp_path / "large.csv")
    assert refused_trials([LOST, replace(LOST, reason="later"), KILLED]) == {
        "b_1": LOST,
        "b_2": KILLED,
    }


READERS = [read_trial, read_table, read_unperturbed_gaits, read_summary, read_crossing_file]


@pytest.mark.parametrize("read", [*READERS, lambda path: read_model(path, StaticCalibration)])
def test_who_reads_a_record_for_a_result_is_told_the_reason(tmp_path, read):
    with pytest.raises(
        InputError, match=r"no result: trial b_1: raw/b_1\.mcap: no such file; copy it there"
    ):
        read(Path(record(tmp_path / "b_1.csv", LOST)))


def test_a_trial_refused_in_one_list_is_missing_from_every_list_and_the_job_goes_on(tmp_path):
    good = [result(tmp_path / f"{folder}/b_2.csv") for folder in ("trials", "fits", "quality")]
    bad = [result(tmp_path / "trials/b_1.csv"), record(tmp_path / "fits/b_1.csv", LOST)]
    inputs = {"trials": [bad[0], good[0]], "fitted": [bad[1], good[1]], "quality": [good[2]]}
    used = {"trials": [good[0]], "fitted": [good[1]], "quality": [good[2]]}
    assert without_refused(inputs) == (used, (LOST,), ())
    for given, kept, missing in (
        ({"shown": {"b_1": bad[1], "b_2": good[1]}}, {"shown": {"b_2": good[1]}}, ()),
        ({"rows": bad[1:]}, {"rows": []}, (LOST,)), ({"rows": bad[1:], "trial": good[0]},
         {"rows": []}, ()),
        ({"rows": good, "quality": bad[1:]}, {"quality": []}, ()), ({"f": bad[1:], "trial": bad[0]},
         {"f": []}, (LOST,))
    ):  # fmt: skip
        assert without_refused(given) == ({**given, **kept}, (LOST,), missing)
    assert without_refused({"rows": good}, bad[1:])[1:] == ((LOST,), (LOST,))
    assert without_excluded({"table": good[1], "fitted": [good[1]], "quality": []}, {}) == {
        "table": good[1]
    }
    assert Judge(QualityRules(), {}).verdicts([Path(bad[1])]).is_empty()  # a record is no verdict


def job(tmp_path, command, inputs, output=None, **settings):
    output = output or {"output": str(tmp_path / "tables/belt.csv")}
    said = {
        "command": command,
        "input": inputs,
        "output": output,
        "settings": settings,
        "files": [*output.values()],
    }
    return said | {"needs": [], "data": "", "judge": "", "log": str(tmp_path / "logs/belt.log")}


def ended(job):
    perform(job)
    return read_log(Path(job["log"]))["outcome"], read_refusals(job["files"][-1])


def test_a_job_that_refuses_its_input_leaves_reason_and_remedy_in_place_of_an_old_result(tmp_path):
    result(tmp_path / "tables/belt.csv")
    inputs = {"trial": str(tmp_path / "trials/b_1.parquet")}
    outcome, (cause,) = ended(
        job(tmp_path, "walking.compare_ankle_moment", inputs, settings={}, tables={})
    )
    assert (outcome, cause.trial, cause.file, cause.outcome) == (
        "failed",
        "b_1",
        inputs["trial"],
        "failed",
    )
    assert "logs/belt.log" in cause.remedy
    outcome, (cause,) = ended(job(tmp_path, "tables.gather", {"rows": [str(tmp_path / "b_1.csv")]}))
    assert (outcome, cause.outcome, cause.reason) == (
        "refused",
        "refused",
        f"{tmp_path}/b_1.csv: no such table",
    )
    assert cause.remedy == "run the step that writes it, or check the path"


def test_a_job_that_lacks_an_input_passes_its_causes_on_and_is_no_cause_itself(tmp_path):
    causes = LOST, KILLED, replace(LOST, reason="later")  # and none twice
    inputs = {"table": record(tmp_path / "belt.csv", *causes, replace(LOST, file="other"))}
    assert ended(job(tmp_path, "bench.summarise", inputs)) == ("skipped", causes)


def test_ingest_and_quality_control_are_one_job_of_which_both_results_stand_or_none(
    tmp_path, monkeypatch
):
    trial, quality, limited = tmp_path / "trials/b_1.parquet", tmp_path / "quality/b_1.csv", []

    def refuse(*_):
        raise InputError("raw/b_1.mcap: too short; record it again")

    monkeypatch.setattr(
        trials, "ingest_trial", lambda row, raw, sources, output, columns: Path(result(output))
    )
    monkeypatch.setattr(trials, "examine", refuse)
    monkeypatch.setattr(
        "osl_analysis.jobs.job.limited_memory", lambda files: limited.append(files) or nullcontext()
    )
    settings = {
        "row": {"trial": "b_1", "experiment": "belt", "log": "b_1.mcap"},
        "needed_columns": [],
    }
    settings |= {"raw_folder": "raw", "sources_folder": "."}
    settings |= {"commanded": {"amplitudes_deg": [], "frequencies_hz": [], "cycles": 1}}
    outputs = {"trial": str(trial), "quality": str(quality)}
    outcome, (cause,) = ended(job(tmp_path, "trials.ingest_and_check", {}, outputs, **settings))
    assert [outcome, is_refused(trial), is_refused(quality)] == ["refused", True, True]
    assert (cause.trial, cause.file, cause.remedy) == ("b_1", "raw/b_1.mcap", "record it again")
    assert limited == [["raw/b_1.mcap"]], "where memory is short, the recording is named"


def written(tmp_path, **more):
    """The request of a fit of the trial b_7, and how often it was tried."""
    path, made = tmp_path / "requests/b_7.json", [str(tmp_path / "fits/b_7.csv")]
    content = {
        "command": "bench.fit",
        "data": "",
        "log": str(tmp_path / "b_7.log"),
        "files": made,
        "needs": [],
    }
    content |= {
        "input": {"trial": "results/trials/b_7.parquet"},
        "output": {},
        "settings": {},
        "recorded": {},
    }
    path.parent.mkdir(exist_ok=True)
    text = jobs_request.request_text(path, content | {"judge": ""} | more, digest)
    if text != (path.is_file() and path.read_text()):
        path.write_text(text)
    return path, json.loads(path.read_text())["tried"]


def test_a_killed_job_leaves_nothing_half(tmp_path):
    (request, _), output = written(tmp_path), tmp_path / "fits/b_7.csv"
    left = temporary_path(output, 12345)
    left.parent.mkdir()
    left.write_text("half a table")
    died(request, 12345, 9)
    assert not left.exists()
    assert [(cause.trial, cause.outcome) for cause in read_refusals(output)] == [("b_7", "died")]


@pytest.mark.parametrize("host", [platform.node(), "another"])
def test_the_next_start_cleans_what_a_killed_run_on_this_machine_left_and_takes_its_lock(
    tmp_path, monkeypatch, host
):
    monkeypatch.chdir(tmp_path)
    ended = subprocess.Popen(["true"])
    ended.wait()
    kept = [Path(f"results/.a.{os.getpid()}.csv"), Path("results/.hidden"), Path("results/a.csv")]
    left = [
        Path(f"results/.a.{ended.pid}.csv"),
        Path(".snakemake/locks/0.output.lock"),
        Path("snakemakeab/source"),
    ]
    for file in (*kept, *left):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    jobs_run.RUNS.write_text(
        json.dumps({"host": host, "pid": ended.pid, "temporary": "snakemakeab"}) + "\n"
    )
    is_here = host == platform.node()
    with jobs_run.RUNS.open() as at_work:
        jobs_run.fcntl.flock(at_work, jobs_run.fcntl.LOCK_SH)
        assert not jobs_run.locked_by_killed_run(), "another run holds it"
    assert jobs_run.locked_by_killed_run() == is_here
    file, are_ended_here = jobs_run.begin(tmp_path / "own")
    assert are_ended_here == is_here
    if are_ended_here:
        jobs_run.remove_half_written([Path("results")])
    jobs_run.begin.cache_clear()
    assert [one.exists() for one in (*kept, *left)] == [True] * 3 + [not is_here] * 3
    (mine,) = (json.loads(line) for line in jobs_run.RUNS.read_text().splitlines())
    assert (mine["pid"], mine["temporary"]) == (os.getpid(), f"{tmp_path}/own")
    beside, are_ended_here = jobs_run.begin(tmp_path / "other")
    jobs_run.begin.cache_clear()
    with file, beside:
        assert not are_ended_here, "this run is at work"


def test_a_job_that_a_killed_server_had_not_begun_is_done_by_a_new_one_and_one_that_ran_is_named(
    tmp_path, monkeypatch
):
    request, _ = written(tmp_path)
    monkeypatch.chdir(tmp_path)
    job_server.cache_clear()
    monkeypatch.setenv("OMP_NUM_THREADS", "64")
    link, server = job_server()
    assert os.getsid(server.pid) == server.pid, "Ctrl-C is for Snakemake"
    # until its program has begun
    while not (variables := Path(f"/proc/{server.pid}/environ").read_bytes()):
        pass
    assert b"OMP_NUM_THREADS=1\0" in variables, "a job counts as one core"
    server.kill()
    server.wait()
    run_job(str(request))
    (cause,) = read_refusals(tmp_path / "fits/b_7.csv")
    assert cause.outcome == "failed", "a new server did it: there is no such trial"
    link.close()
    monkeypatch.setattr(jobs_run, "answer_to", lambda *_: b"12345 ")  # it had begun
    run_job(str(request))
    with job_server()[0], job_server()[1] as second:
        second.kill()
    assert read_refusals(tmp_path / "fits/b_7.csv")[0].reason.endswith(
        "was killed (signal 9, SIGKILL)"
    )
    job_server.cache_clear()


def test_one_process_does_several_jobs_and_another_one_takes_its_place_when_it_is_killed(
    tmp_path, monkeypatch
):
    request, _ = written(tmp_path)
    monkeypatch.chdir(tmp_path)
    job_server.cache_clear()
    link, server = job_server()
    first, second = (jobs_run.answer_to(link, str(request)).decode().split() for _ in range(2))
    assert b"llvmlite" not in Path("/proc", first[0], "maps").read_bytes(), (
        "100 MB that a fit does without"
    )
    os.kill(int(first[0]), signal.SIGKILL)
    while Path("/proc", first[0]).exists():
        pass
    third = jobs_run.answer_to(link, str(request)).decode().split()
    assert first == second
    assert third[1] == first[1] == "0"
    assert third[0] != first[0]
    server.kill()
    server.wait()
    link.close()
    job_server.cache_clear()


def test_a_worker_ends_its_job_without_a_word_where_the_server_is_killed_meanwhile(tmp_path):
    request, _ = written(tmp_path)
    ours, theirs = socket.socketpair()
    code = (
        "import socket; from osl_analysis.jobs.run import work;"
        f" work(socket.socket(fileno={theirs.fileno()}))"
    )
    with (tmp_path / "said").open("w+") as said, ours, theirs:
        worker = subprocess.Popen([sys.executable, "-c", code], pass_fds=[theirs.fileno()])
        socket.send_fds(ours, [f"{tmp_path}\0{request}".encode()], [said.fileno(), said.fileno()])
        ours.close()
        theirs.close()
        assert worker.wait() == 0
        assert (tmp_path / "said").read_text() == ""
    assert is_refused(tmp_path / "fits/b_7.csv")


def test_a_job_that_crashes_on_its_recording_is_refused_with_the_file(
    tmp_path,
):
    of_raw = {"raw_folder": "raw", "row": {"trial": "b_7", "log": "b_7.mat"}}
    request, _ = written(tmp_path, settings=of_raw)
    for number, outcome in ((signal.SIGSEGV, "refused"), (signal.SIGKILL, "died")):
        died(request, 12345, number)
        (cause,) = read_refusals(tmp_path / "fits/b_7.csv")
        assert (cause.outcome, cause.file) == (outcome, "raw/b_7.mat")


def test_failed_killed_and_deleted_results_are_tried_again_and_refused_ones_stay(tmp_path):
    assert written(tmp_path)[1] == written(tmp_path)[1] == 0  # it never ran
    (tmp_path / "b_7.log").write_text("job: bench.fit\noutcome: done\n")
    tried = written(
        tmp_path, files=[result(tmp_path / "fits/b_8.csv"), str(tmp_path / "fits/b_7.csv")]
    )[1]
    assert tried == 1  # one of its results was deleted
    for outcome, again in (("died", 1), ("failed", 1), ("refused", 0)):
        record(tmp_path / "fits/b_7.csv", replace(KILLED, outcome=outcome))
        tried += again
        assert written(tmp_path)[1] == written(tmp_path)[1] == tried, outcome
    assert written(tmp_path, settings={"cutoff_hz": 20})[1] == tried


def test_a_recording_of_another_date_with_the_same_bytes_is_the_same(
    tmp_path,
):
    log, made = tmp_path / "b_7.mcap", tmp_path / "trials/b_7.parquet"
    log.write_bytes(b"a recording")
    provenance = {"files": {"log": {"sha256": digest(log)}}}
    write_trial(Trial("b_7", pl.DataFrame({"time": [0.0, 0.1]}), provenance), made)
    of_log = {"files": [str(made)]}
    before = written(tmp_path, recorded={str(log): file_state(log)}, **of_log)[0].read_text()
    os.utime(log, (10**9, 10**9))
    assert (
        written(tmp_path, recorded={str(log): file_state(log)}, **of_log)[0].read_text() == before
    )
    log.write_bytes(b"another one")
    os.utime(log, (10**9, 10**9))
    assert (
        written(tmp_path, recorded={str(log): [*file_state(log)[:2], 0]}, **of_log)[0].read_text()
        != before
    )


def test_a_copied_recording_is_read_once_for_each_of_its_states_whatever_the_number_of_runs(
    tmp_path, monkeypatch
):
    read, log = [], tmp_path / "b_7.mcap"
    monkeypatch.setattr(jobs_request, "digest", lambda path: read.append(path) or digest(path))
    for content in (b"a recording", b"another one, which is longer"):
        log.write_bytes(content)
        for _ in range(2):
            run = jobs_request.Requests(tmp_path, "", None, None)
            assert run.digest_in_state(log) == digest(log)
            run.sources.write()
    assert read == [log, log]


@pytest.mark.parametrize(("reason", "remedy"), [
    ("x.csv: no such file", "correct the sheet; or copy it there"),
    ("no field 'a[name=b]'", "it has position[name=left], position[name=right]"),
    ("x.mcap: no topic '/a' (no footer; record again)", ""),
])  # fmt: skip
def test_the_remedy_of_an_error_stands_behind_the_first_semicolon_outside_brackets(reason, remedy):
    fault = InputError("; ".join(filter(None, [reason, remedy])))
    assert (fault.reason, fault.remedy) == (reason, remedy)


def test_the_same_cause_in_many_trials_is_one_line_and_another_its_own(tmp_path):
    files = [
        (name, f"raw/{name}.c3d", f"trial {name}: {n}.5 N")
        for n, name in enumerate(("heel", "knee", "toe"))
    ]
    rest = [
        Refusal(trial, file, "j", "refused", f"{said} in {file}", "zero it")
        for trial, file, said in files
    ]
    other = Refusal("walk", "raw/walk.c3d", "j", "refused", "no plate", "zero it")
    recordings = {name: [f"raw/{name}.c3d"] for name in ("heel", "knee", "toe", "walk", "run")}
    told = refusal_report(
        [record(tmp_path / "a.csv", *rest, other)], recordings, accept=False
    ).splitlines()
    also = ", and 2 more trials with the same cause, knee, toe"
    assert told[2:4] == [
        f"  trial heel, file raw/heel.c3d{also}: 0.5 N in raw/heel.c3d; remedy: zero it",
        "  trial walk, file raw/walk.c3d: no plate; remedy: zero it",
    ]
    same = {alike("a.csv: no 'knee' at 1.5e3", "knee"), alike("a.csv: no 'toe' at -2", "toe")}
    assert same == {"a.csv: no 'TRIAL' at #"}


def test_a_figure_whose_process_was_killed_leaves_its_trial_analysed_and_nothing_to_correct(
    tmp_path,
):
    files = {"figures": tmp_path / "figures/fig4.csv", "fits": tmp_path / "fits/b_7.zip"}
    ended = {"outcome": "died", "error": "the process of this job was killed (signal 9, SIGKILL)"}
    job = {"command": "j", "input": {"trial": "trials/b_7.parquet"}, "settings": {}, "log": "log"}
    said = {}
    for kind, file in files.items():
        record(file, refusal(job | {"files": [str(file)]}, ended))
        said[kind] = refusal_report(
            [file], {"b_7": ["raw/b_7.mcap"], "b_8": ["raw/b_8.mcap"]}, accept=False
        )
    assert "NOT ANALYSED: some results" in said["figures"]
    assert "b_7" in said["fits"].splitlines()[2]
    assert "NOT ANALYSED: 1 of 2 trials" in said["fits"]
    assert not any("Correct" in text or "exclude" in text for text in said.values())


def test_what_a_renaming_leaves_among_the_results_is_named_at_the_end_of_a_run():
    stored = [
        Path(f"results/trials/{trial}.parquet")
        for trial in ("b_1", "old_2", "b_3", "old_1", "b_2", "old_0")
    ]
    said = (
        "not in the sample sheet, and in no table or figure: old_0, old_1, old_2; files of theirs"
    )
    assert left_behind_report(stored, ["b_1", "b_2", "b_3"]).startswith(said)
    assert left_behind_report(stored[::2], ["b_1", "b_2", "b_3"]) == ""


def test_a_trial_that_is_used_without_its_end_is_named_at_the_end_of_a_run():
    said = {"check": "truncated", "value": 1.0, "unit": "logs", "remark": ""}
    rows = [
        {"trial": f"b_{n}", "verdict": verdict, **said}
        for n, verdict in enumerate(("flag", "pass", "exclude"))
    ]
    for some, named in ((rows, ["b_0"]), (rows[1:], [])):
        found = campaign_findings({}, pl.DataFrame(some), DoubtfulFits()).filter(grade="doubts")
        assert found.select("trial", "cause").rows() == [
            (trial, "log without its end") for trial in named
        ]
    twice = pl.DataFrame(
        [rows[2] | {"threshold": 0.0}, rows[2] | {"check": "gap", "threshold": 0.0}]
    )
    assert exclusions(twice) == {
        "b_2": "truncated 1 logs, threshold 0.0; gap 1 logs, threshold 0.0"
    }


TABLES = {
    "phasors": pl.DataFrame({"trial": ["01", "01"], "gain": [0.1 + 0.2, 1e-17]}),
    "series": pl.DataFrame({"time": [0.0, 1.0], "torque": [None, float("nan")]}),
}


def test_an_archive_of_tables_holds_what_was_written_completely_or_not_at_all(tmp_path):
    path = tmp_path / "fits/t_1.zip"
    write_tables({path / f"{name}.csv": table for name, table in TABLES.items()})
    before = path.read_bytes()
    for name, table in TABLES.items():
        assert read_table(path, of=name).equals(table, null_equal=True)
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        # the same tables make the same archive
        assert archive.infolist()[0].date_time == (1980, 1, 1, 0, 0, 0)
    with pytest.raises(AttributeError):
        write_tables({path / "series.csv": TABLES["series"], path / "other.csv": None})
    assert ([*path.parent.iterdir()], path.read_bytes()) == ([path], before)
    with pytest.raises(
        InputError, match=r"t_1\.zip/response\.csv: no such table .*run the step that writes it"
    ):
        read_table(path, of="response")


def test_a_table_is_not_made_of_nothing(tmp_path):
    with pytest.raises(InputError, match=r"belt\.csv: no trials fill this table"):
        gather([], tmp_path / "belt.csv")


def test_a_full_disk_is_no_fault_of_the_input_and_is_tried_again_with_the_advice_to_make_room(
    tmp_path, monkeypatch
):
    def full(_):
        warnings.warn("late\x1b", stacklevel=1)
        warnings.warn("late\x1b", stacklevel=1)
        raise WriteError(
            "a.csv: cannot be written (No space left on device); make room, or choose another place"
        )

    monkeypatch.setattr("osl_analysis.jobs.job.call", full)
    outcome, (cause,) = ended(asked := job(tmp_path, "tables.gather", {}))
    assert (outcome, cause.outcome, cause.remedy) == (
        "failed",
        "failed",
        "make room, or choose another place",
    )
    assert read_log(Path(asked["log"]))["warnings"] == [r"late\x1b"]


RULES, ACCEPT = (
    read_section(ROOT / "config/config.yaml", "quality", QualityRules),
    {"plate_3": ["unzeroed_plate"]},
)
JUDGE = Judge(RULES, ACCEPT)


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
        force = offset + np.random.default_rng(1).standard_normal(1000)
        trial = Trial(name, pl.DataFrame({"time": np.arange(1000) / rate, "plate1_force_z": force}))
        paths.append(tmp_path / f"quality/{name}.csv")
        write_table(measured_table(name, examine(trial, "plate", Commanded((), (), 1))), paths[-1])
    return paths


def test_an_excluded_trial_is_left_out_and_an_accepted_one_is_not(checked):
    files = [f"fits/{name}.parquet" for name in ("plate_1", "plate_2", "plate_3")]
    reasons = exclusions(JUDGE.verdicts(checked))
    left = without_excluded(
        {"trials": files, "table": "tables/plate_2.csv", "quality": [*map(str, checked)]}, reasons
    )
    assert left == {"trials": [files[0], files[2]], "table": "tables/plate_2.csv"}
    alone = {
        "trial": "trials/plate_1.parquet",
        "motion": ["trials/plate_2.parquet"],
        "quality": checked,
    }
    assert without_excluded(alone, reasons) == {"trial": alone["trial"], "motion": []}
    wider = RULES.model_dump(mode="json") | {
        "unzeroed_plate": {"threshold": "85 N", "on_failure": "exclude"}
    }
    for rules, named in (
        (RULES, ["plate_2", "plate_3"]),
        (QualityRules.model_validate(wider), ["plate_3"]),
    ):
        assert [*exclusions(Judge(rules, {}).verdicts(checked))] == named


def test_who_was_left_out_or_not_judged_is_listed_and_told_with_value_threshold_and_remedy(checked):
    folder = checked[0].parent
    lost = Refusal(
        "plate_9", "p.c3d", "ingest.ingest_trial", "refused", "p.c3d: truncated", "export it again"
    )
    verdicts, excluded = folder / "quality.csv", folder / "excluded.csv"
    for judged, names in (([], ["plate_9", "b_2"]), (checked, ["plate_9", "plate_2", "b_2"])):
        judge(judged, RULES, ACCEPT, verdicts, [lost])
        list_excluded(verdicts, {"b_2": "stumbled"}, excluded, [lost])
        listed = read_table(excluded, ["trial", "check", "value", "unit", "threshold", "remark"])
        assert (listed["trial"].to_list(), listed["remark"][0]) == (
            names,
            "p.c3d: truncated; export it again",
        )
    judged = read_table(verdicts).filter(~pl.col("verdict").is_in(["pass", "not applicable"]))
    outcomes = [("plate_1", "flag"), ("plate_2", "exclude"), ("plate_9", "refused")]
    assert judged.select("trial", "verdict").rows() == outcomes
    assert judged["value"].to_list()[1:] == [pytest.approx(80, abs=0.5), None]
    assert listed["check"].to_list() == ["refused", "unzeroed_plate", "sample sheet"]
    said = exclusion_report(JUDGE.verdicts([*checked, folder / "missing.csv"]), {"b_2": "stumbled"})
    assert "excluded by the sample sheet: b_2 (stumbled)" in said
    assert re.search(
        r"plate_2 \(unzeroed_plate (80\.0|79\.9)\S* N, threshold 20\.0: plate1 -(80\.0|79\.9) N\)",
        said,
    )


@pytest.mark.parametrize(
    "inputs", [{"rows": ["fits/plate_2.csv"]}, {"trial": "trials/plate_2.parquet"}]
)
def test_where_nothing_is_left_the_reason_is_one_line_with_a_remedy(checked, inputs):
    with pytest.raises(
        InputError,
        match=r"^[^\n]*excludes every trial .*: plate_2 \(unzeroed_plate .*; record again",
    ):
        without_excluded({**inputs, "quality": checked}, exclusions(JUDGE.verdicts(checked)))


def tell(handler, event=None, text="", level=logging.INFO, **more):
    record = logging.LogRecord("snakemake", level, "", 0, text, (), None)
    record.__dict__ |= {"event": event, **more}
    handler.emit(record)


def test_a_run_has_a_line_now_and_then_one_per_stage_and_what_is_refused_at_once(
    monkeypatch, tmp_path, capsys
):
    clock, ended = (
        SimpleNamespace(now=100.0),
        {"job": "ingest.ingest_trial", "error": "b.mcap: no such file\x1b[31m"},
    )
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock.now)
    for outcome in (outcomes := ("refused", "failed", "died", "skipped")):
        write_log(tmp_path / f"{outcome}.log", ended | {"outcome": outcome}, {})
    lines = LogHandler(SimpleNamespace(verbose=False, dryrun=False), None)
    tell(lines, LogEvent.RUN_INFO, stats={"osl_ingest": 40, "reproduce-all": 1, "total": 41})
    for text in ("Building DAG of jobs...", "Unlocked."):
        tell(lines, text=text)
    for job in range(40):
        logs = [f"{tmp_path}/{one}.log" for one in outcomes]
        tell(
            lines,
            LogEvent.JOB_INFO,
            jobid=job,
            rule_name="osl_ingest",
            log=logs if job == 39 else None,
        )
        clock.now += 0.5
        tell(lines, LogEvent.JOB_FINISHED, job_id=job)
    said = capsys.readouterr().err.splitlines()
    assert said[:2] == ["Unlocked.", "read and check recordings 21/40, 2/s, 10 s left"]
    assert [line.partition(":")[0] for line in said[2:5]] == [*outcomes[:3]]
    assert said[5:] == ["read and check recordings 40/40 in 20 s"]
    assert r"no such file\x1b[31m" in said[2]


@pytest.mark.parametrize(("text", "told"), [
    (format_exception_to_string(LockException()), str(Path.cwd())),
    ("Traceback (most recent call last):\n  File\n\nOSError: [Errno 30] Read-only: 'results/t.csv'\n", "results/t.csv"),
    ("InputFunctionException in rule a:\nError:\n  WriteError: a.json: cannot be written\nWildcards:\n\n", "a.json"),
    ("MissingRuleException:\nNo rule to produce x/no.csv (if you use input functions make sure).",
     "x/no.csv"),
])  # fmt: skip
def test_what_snakemake_cannot_go_on_with_is_one_line_also_in_a_dry_run(capsys, text, told):
    for is_dry in (False, True):
        lines = LogHandler(SimpleNamespace(verbose=False, dryrun=is_dry), None)
        tell(lines, LogEvent.ERROR, text, logging.ERROR)
        (said,) = capsys.readouterr().err.splitlines()
        assert re.match(rf"error: .*{re.escape(told)}", said), said
