"""A result that is no longer what its log says is made again, also where Snakemake has no notes of it."""

import hashlib
import os
from pathlib import Path
from types import SimpleNamespace

import polars as pl
import pytest

from osl_analysis import workflow
from osl_analysis.files import file_state
from osl_analysis.job_log import JobLog, read_log, write_log
from osl_analysis.refusal import Refusal, write_refusals
from osl_analysis.stale import RECORDINGS, SETTINGS, UNKNOWN, logged, made_of, stale
from osl_analysis.trial import Trial, write_trial

PARAMS = {"code": "1f", "row": {"trial": "b_1"}, "columns": ("theta", "torque")}


class Ingested:
    """A trial as ingest leaves it: recording, Parquet with the recording's hash, log."""

    def __init__(self, folder: Path) -> None:
        self.raw, self.trial, self.log = (folder / name for name in ("raw.csv", "b_1.parquet", "b_1.log"))
        self.raw.write_bytes(b"0,1\n")
        identity = {"path": "raw.csv", "bytes": 4, "sha256": hashlib.sha256(b"0,1\n").hexdigest(), "source": "s"}
        samples = pl.DataFrame({"time": [0.0, 1.0]})
        write_trial(Trial("b_1", samples, {"files": {"log": identity}}), self.trial)
        write_log(self.log, JobLog("j", "done", warnings=("w",)), {"made_of": self.now(), "input": {"made_of": "x"}})

    def now(self, inputs=(), **changes):
        return made_of(inputs, PARAMS | {"recorded": {str(self.raw): file_state(self.raw)}} | changes)

    def stale(self, known=False, **changes):
        return stale(self.now(**changes), self.log, [self.trial], known)


@pytest.fixture
def ingested(tmp_path: Path) -> Ingested:
    return Ingested(tmp_path)


def test_a_log_says_what_its_results_were_made_of_and_its_outcome_as_before(ingested: Ingested) -> None:
    assert logged(ingested.log) == ingested.now()
    assert read_log(ingested.log) == JobLog("j", "done", warnings=("w",))


@pytest.mark.parametrize("known", [False, True])
def test_results_hold_while_nothing_changes(ingested: Ingested, known: bool) -> None:
    assert ingested.stale(known) == ""


@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("date", [None, 10**9])
@pytest.mark.parametrize("content", [b"0,2\n", b"0,1\n0,1\n"])
def test_another_recording_is_seen_with_a_newer_date_and_with_an_older_one(
    ingested: Ingested, content: bytes, date: int | None, known: bool
) -> None:
    ingested.raw.write_bytes(content)
    os.utime(ingested.raw, date and (date, date))
    assert ingested.stale(known) == RECORDINGS


def test_a_copy_of_the_same_recording_with_another_date_is_the_same_recording(ingested: Ingested) -> None:
    os.utime(ingested.raw, (10**9, 10**9))
    assert ingested.stale() == ""


def test_a_recording_that_is_gone_is_another_one(ingested: Ingested) -> None:
    ingested.raw.unlink()
    assert ingested.stale() == RECORDINGS


def test_a_refused_trial_is_tried_again_with_any_other_date_because_its_record_has_no_hash(ingested: Ingested) -> None:
    write_refusals([Refusal("b_1", "raw.csv", "ingest.ingest_trial", "refused", "no", "yes")], ingested.trial)
    assert ingested.stale() == ""
    os.utime(ingested.raw, (10**9, 10**9))
    assert ingested.stale() == RECORDINGS


def test_other_settings_program_and_inputs_are_seen_without_notes_of_snakemake(ingested: Ingested) -> None:
    assert ingested.stale(code="2f") == SETTINGS
    assert ingested.stale(columns=("theta",)) == SETTINGS
    assert ingested.stale(inputs=["another.csv"]) == SETTINGS
    assert ingested.stale(known=True, code="2f") == ""


def test_without_a_log_results_hold_only_by_notes_of_snakemake(ingested: Ingested) -> None:
    for text in ("", "made_of:\n  - 1\n", None):
        ingested.log.unlink() if text is None else ingested.log.write_text(text)
        assert (ingested.stale(), ingested.stale(known=True)) == (UNKNOWN, "")


def test_snakemake_is_told_of_results_that_do_not_hold(ingested: Ingested) -> None:
    """As Snakemake calls it: `has_metadata`, and only if this is true `params_changed`."""

    def found(job, file=None):
        return type("Change", (dict,), {})()

    run = SimpleNamespace(_prepare_dag=lambda **_: None, dryrun=False)
    reason = SimpleNamespace(missing_output=set())
    dag = SimpleNamespace(reason=lambda job: reason)
    run.persistence = SimpleNamespace(has_metadata=lambda job: False, params_changed=found, dag=dag)
    workflow.know_by_logs(run, [ingested.trial.parent])
    run._prepare_dag(forceall=False)
    recorded = {str(ingested.raw): file_state(ingested.raw)}
    job = SimpleNamespace(output=[str(ingested.trial)], log=[str(ingested.log)], input=[])
    job.params = PARAMS | {"recorded": recorded}
    assert run.persistence.has_metadata(job)
    assert not run.persistence.params_changed(job)
    ingested.raw.write_bytes(b"0,3\n0")
    job.params = PARAMS | {"recorded": {str(ingested.raw): file_state(ingested.raw)}}
    assert run.persistence.params_changed(job) == {"only_old": {RECORDINGS}, "files": {str(ingested.trial)}}
    assert reason.missing_output == set()
    job.output.append(str(ingested.trial.with_suffix(".csv")))
    assert not run.persistence.params_changed(job)
    assert reason.missing_output == {job.output[1]}
    ingested.trial.unlink()
    assert run.persistence.has_metadata(job)
    run.persistence.params_changed(job)
    assert reason.missing_output == set(job.output)


@pytest.mark.parametrize(("outcome", "again"), [("died", True), ("refused", False)])
def test_a_dry_run_tells_of_killed_jobs_which_a_run_tries_again(ingested: Ingested, outcome, again) -> None:
    reason = SimpleNamespace(missing_output=set())
    run = SimpleNamespace(_prepare_dag=lambda: None, dryrun=True)
    dag = SimpleNamespace(reason=lambda job: reason)
    run.persistence = SimpleNamespace(has_metadata=lambda job: True, params_changed=lambda job, file: False, dag=dag)
    workflow.know_by_logs(run, [ingested.trial.parent])
    write_refusals([Refusal("b_1", "raw.csv", "ingest.ingest_trial", outcome, "no", "yes")], ingested.trial)
    run._prepare_dag()
    job = SimpleNamespace(output=[str(ingested.trial)], log=[str(ingested.log)], input=[], params=PARAMS)
    assert not run.persistence.params_changed(job)
    assert reason.missing_output == ({str(ingested.trial)} if again else set())


def test_parameters_of_one_function_are_parameters_as_any_other() -> None:
    """As a rule gives them: `of_trial` is one function of the wildcards for them all."""
    together = {"code": "1f", "of_trial": {"row": {"trial": "b_1"}, "recorded": {"b.mcap": [1, 2, 3]}}}
    alone = {"code": "1f", "row": {"trial": "b_1"}, "recorded": {"b.mcap": [1, 2, 3]}}
    assert made_of([], together) == made_of([], alone)
    assert made_of([], together)["recordings"] == {"b.mcap": [1, 2, 3]}
    assert made_of([], together) != made_of([], together | {"of_trial": {"row": {"trial": "b_2"}}})
