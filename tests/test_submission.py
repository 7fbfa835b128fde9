"""How a submission is adapted, asked for, and what is left of a lost one: without a cluster, which tests/slurm has."""

import asyncio
from pathlib import Path
from types import SimpleNamespace

import pytest
from snakemake_interface_common.exceptions import WorkflowError
from submitted_jobs import job, together

from osl_analysis import submission
from osl_analysis.files import temporary_path
from osl_analysis.job_log import JobLog, write_log
from osl_analysis.refusal import Refusal, is_refused, read_refusals, write_refusals


@pytest.fixture
def ended(tmp_path: Path):
    """Three fits of a submission: `done`, one that was killed, and one that was writing; with a done job's log."""
    jobs = [job("fit", "trials", tmp_path / f"{name}.csv", tmp_path / f"{name}.log", trial=name) for name in "abc"]
    for one, outcome in zip(jobs, ("done", "died"), strict=False):
        Path(one.output[0]).write_text("1")
        write_log(Path(one.log[0]), JobLog("bench.fit", outcome), {})
    write_refusals([Refusal("b", "b.csv", "bench.fit", "died", "killed", "run again")], Path(jobs[1].output[0]))
    temporary_path(Path(jobs[2].output[0]), 99).write_text("half a table")
    return tmp_path, together(*jobs)


def test_the_results_of_a_lost_submission_that_are_whole_stay_and_the_others_are_named(ended):
    folder, lost = ended
    causes = submission.record_lost(
        lost, "12", "SLURM-job '12' failed, SLURM status is: 'TIMEOUT'. Detailed reason: no"
    )
    assert [(cause.trial, cause.outcome, cause.reason) for cause in causes] == [
        (trial, "died", "the cluster's job 12 was lost (TIMEOUT)") for trial in "bc"
    ]
    assert "core_ms" in causes[0].remedy
    assert (folder / "a.csv").read_text() == "1"
    assert [read_refusals(folder / f"{name}.csv") for name in "bc"] == [(cause,) for cause in causes]
    assert not list(folder.glob(".*"))


def test_a_trial_of_several_lost_jobs_is_one_cause_and_all_jobs_over_trials_are_one_named_by_the_first_file(tmp_path):
    jobs = [job(rule, "trials", tmp_path / f"{rule}.csv", tmp_path / "no.log", trial="a") for rule in ("ingest", "fit")]
    shared = [job("plate", "shared", tmp_path / f"{name}.json", tmp_path / "no.log") for name in ("plate", "page")]
    causes = submission.record_lost(together(*jobs, *shared), "7", "node gone\nmore")
    assert [(cause.trial, cause.reason) for cause in causes] == [
        (t, "the cluster's job 7 was lost (node gone)") for t in ("a", "")
    ]
    assert causes[1].file == str(tmp_path / "plate.json")
    assert read_refusals(tmp_path / "fit.csv") == (causes[0],)
    assert read_refusals(tmp_path / "page.json") == (causes[1],)


def test_a_submission_that_failed_as_a_whole_is_named_with_the_first_error_of_its_output(tmp_path):
    (tmp_path / "7.log").write_text(
        "Execute 1 jobs...\nTraceback (most recent call last):\n"
        "osl_analysis.errors.InputError: a.csv: cannot be written\n"
        "OSError: [Errno 28] No space left on device\n"
    )
    one = job("fit", "trials", tmp_path / "a.csv", tmp_path / "a.log", trial="a")
    (cause,) = submission.record_lost(one, "7", "SLURM status is: 'FAILED'", tmp_path / "7.log")
    assert cause.reason == "the cluster's job 7 was lost (FAILED: InputError: a.csv: cannot be written)"
    (cause,) = submission.record_lost(one, "7", "SLURM status is: 'FAILED'", tmp_path / "8.log")
    assert cause.reason == "the cluster's job 7 was lost (FAILED)"


def test_a_full_disk_leaves_no_record_and_the_cause_is_told_all_the_same(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(submission, "write_refusals", full)
    (cause,) = submission.record_lost(job("fit", "trials", tmp_path / "a.csv", tmp_path / "a.log", trial="a"), "3", "")
    assert cause.reason == "the cluster's job 3 was lost (no reason is known)"
    assert not (tmp_path / "a.csv").exists()


class Executor:
    """As far as an executor of Snakemake is adapted."""

    next_seconds_between_status_checks = 180

    def __init__(self) -> None:
        self.said: list[tuple] = []
        self.workflow = SimpleNamespace(
            remote_execution_settings=SimpleNamespace(seconds_between_status_checks=5),
            execution_settings=SimpleNamespace(keep_incomplete=False),
            scheduler=SimpleNamespace(error_callback=lambda lost: self.said.append(("error", lost[0].rule.name))),
        )
        self.logger = SimpleNamespace(warning=lambda text: self.said.append(("warning", text)))
        self.states: dict[str, str] | None = {}

    def run_job(self, job) -> None:
        """As SLURM's plug-in: its handler of an exception asks a submission for its rule, which it has not."""
        try:
            raise ConnectionError("Unable to contact slurm controller")
        except ConnectionError:
            raise AttributeError("'GroupJob' object has no attribute 'rule'")  # noqa: B904

    def report_job_submission(self, info) -> None:
        self.said.append(("taken", info.external_jobid))

    def run_job_pre(self, job) -> None:
        self.said.append(("before", Path(job.output[0]).exists()))

    def report_job_error(self, info, msg=None) -> None:
        self.said.append(("error", msg))

    def report_job_success(self, info) -> None:
        self.said.append(("success", is_refused(info.job.output[0])))

    async def check_active_jobs(self, active):
        """As SLURM's plug-in does: without an answer (None) it yields none of its jobs."""
        for info in active if self.states is not None else ():
            if self.states.get(info.external_jobid) == "COMPLETED":
                self.report_job_success(info)
            elif self.states.get(info.external_jobid) == "FAILED":
                self.report_job_error(info, msg="status is: 'FAILED'")
            else:
                yield info


@pytest.fixture
def adapted():
    """An adapted executor."""
    one = type("Adapted", (Executor,), {})
    submission.adapt(one, lambda *lost: submission.record_lost(*lost))
    return one()


@pytest.fixture
def fit(tmp_path):
    """A fit of trial a, with an old result."""
    one = job("fit", "trials", tmp_path / "a.csv", tmp_path / "a.log", trial="a")
    Path(one.output[0]).write_text("old")
    return one


def test_a_lost_submission_is_recorded_before_the_run_goes_on(adapted, fit):
    adapted.run_job_pre(fit)
    adapted.report_job_error(SimpleNamespace(job=fit, external_jobid="4", aux=None), msg="status is: 'NODE_FAIL'")
    assert adapted.said == [("before", False), ("success", True)]
    assert "--executor local" in adapted.additional_general_args()


def test_where_records_have_no_room_what_needs_the_results_is_not_run_and_what_is_finished_stays(fit):
    full = type("Full", (Executor,), {})
    submission.adapt(full, lambda *lost: None)
    executor, done = full(), job("fit", "trials", fit.output[0] + ".done", trial="b")
    Path(done.output[0]).write_text("made")
    Path(fit.output[0]).unlink()
    executor.report_job_error(SimpleNamespace(job=together(fit, done), external_jobid="4", aux=None), msg="FAILED")
    assert executor.said == [("error", "fit")]
    assert executor.workflow.execution_settings.keep_incomplete


def test_a_submission_that_the_cluster_does_not_take_is_named_with_what_the_cluster_said(adapted, fit):
    said = (
        "sbatch: error: Memory specification can not be satisfied\n"
        "sbatch: error: Batch job submission failed: Requested node configuration is not available"
    )
    msg = f"SLURM sbatch failed. The error message was '{said}'.\n    sbatch call:\n        sbatch --mem 90000"
    adapted.report_job_error(SimpleNamespace(job=fit, external_jobid=None, aux=None), msg=msg)
    (cause,) = read_refusals(fit.output[0])
    what = "Memory specification can not be satisfied; Requested node configuration is not available"
    assert cause.reason == f"the cluster did not take its job ({what})"
    assert "ask for less" in cause.remedy


def test_an_exception_while_a_job_is_submitted_ends_it_with_its_reason_and_not_with_waiting(adapted, fit):
    Path(fit.output[0]).unlink()
    adapted.run_job(fit)
    assert adapted.said == [("success", True)]
    (cause,) = read_refusals(fit.output[0])
    assert cause.reason == "the cluster did not take its job (Unable to contact slurm controller)"


def test_states_are_asked_for_after_a_tenth_of_the_time_since_the_last_change_within_limits(adapted, monkeypatch, fit):
    clock = [0.0]
    monkeypatch.setattr(submission.time, "monotonic", lambda: clock[0])
    info = SimpleNamespace(job=fit, external_jobid="4", aux=None)
    for change in (adapted.report_job_submission, adapted.report_job_success):
        clock[0] += 7
        change(info)
        adapted.next_seconds_between_status_checks = 180
        for passed, pause in ((0, 1), (5, 1), (20, 2), (40, 4), (3600, 5)):
            monkeypatch.setattr(submission.time, "monotonic", lambda passed=passed: clock[0] + passed)
            assert adapted.next_seconds_between_status_checks == pytest.approx(pause)
        monkeypatch.setattr(submission.time, "monotonic", lambda: clock[0])


def asked(executor, active):
    """What an executor goes on to ask for."""

    async def collected():
        return [info async for info in executor.check_active_jobs(active)]

    return asyncio.run(collected())


@pytest.fixture
def three(adapted, tmp_path):
    """An adapted executor, and three submissions of it."""
    jobs = [job("fit", "trials", tmp_path / f"{n}.csv", tmp_path / "no.log", trial=f"t_{n}") for n in "123"]
    return adapted, [SimpleNamespace(job=one, external_jobid=n, aux=None) for n, one in zip("123", jobs, strict=True)]


def test_submissions_are_asked_for_again_while_the_cluster_does_not_answer_and_end_when_it_does(three):
    executor, submissions = three
    executor.states = None
    assert asked(executor, submissions) == submissions
    assert asked(executor, submissions) == submissions
    assert [kind for kind, _ in executor.said] == ["warning"]
    executor.states = {"1": "COMPLETED", "2": "FAILED", "3": "RUNNING"}
    assert asked(executor, submissions) == submissions[2:]
    assert [kind for kind, _ in executor.said] == ["warning", "success", "success"]


def test_a_cluster_that_does_not_answer_for_long_ends_the_run_with_the_numbers_of_its_jobs(three, monkeypatch):
    """Short silences do not add up."""
    executor, submissions = three
    clock = [0.0]
    monkeypatch.setattr(submission.time, "monotonic", lambda: clock[0])
    for now, executor.states in ((0, None), (599, None), (601, {}), (700, None), (1299, None)):
        clock[0] = now
        assert asked(executor, submissions) == submissions
    clock[0] = 1301
    with pytest.raises(
        WorkflowError, match="for 10 min: the end of its jobs 1, 2, 3 is not known; remedy: when squeue"
    ):
        asked(executor, submissions)
