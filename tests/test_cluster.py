"""What one submission to a cluster takes, and what is left of a lost one: without a cluster, which tests/slurm has."""

import asyncio
from pathlib import Path
from types import SimpleNamespace

import pytest
from snakemake_interface_common.exceptions import WorkflowError

from osl_analysis import cluster
from osl_analysis.files import temporary_path
from osl_analysis.job_log import JobLog, write_log
from osl_analysis.refusal import Refusal, is_refused, read_refusals, write_refusals

TRIALS = [f"t_{n}" for n in (3, 1, 2, 10, 5)]
ORDER = {trial: number for number, trial in enumerate(TRIALS)}


def job(rule: str, group: str | None, output: Path | str = "x.csv", log: Path | str = "x.log", **more):
    """A job as Snakemake has it: of the wildcards in `more`, beside its inputs and resources."""
    inputs, resources = more.pop("input", ()), more.pop("resources", {})
    return SimpleNamespace(
        rule=SimpleNamespace(name=rule),
        group=group,
        wildcards_dict=more,
        input=inputs,
        output=[str(output)],
        log=[str(log)],
        resources=resources,
        is_group=lambda: False,
    )


def submission(*jobs):
    one = type("Submission", (list,), {"is_group": lambda self: True})
    return one(jobs)


def test_a_submission_takes_all_jobs_of_its_trials_in_the_order_of_the_sheet_and_of_about_as_many_trials_each():
    jobs = [job(rule, "trials", trial=trial) for trial in sorted(TRIALS) for rule in ("ingest", "fit")]
    found = cluster.members([*jobs, job("table", None)], ORDER)
    assert found.keys() == {"trials"}
    taken = [
        [(one.rule.name, one.wildcards_dict["trial"]) for one in batch] for batch in cluster.batches(found["trials"], 2)
    ]
    assert [[trial for rule, trial in batch if rule == "fit"] for batch in taken] == [
        ["t_3"],
        ["t_1", "t_2"],
        ["t_10", "t_5"],
    ]
    assert all([rule for rule, _ in batch] == ["ingest", "fit"] * (len(batch) // 2) for batch in taken)


@pytest.mark.parametrize(
    ("parts", "most", "sizes"), [(100, 50, [50, 50]), (101, 50, [33, 34, 34]), (3, 50, [3]), (3, 1, [1] * 3)]
)
def test_no_submission_takes_more_than_stated_and_none_is_left_with_a_few(parts, most, sizes):
    assert [len(batch) for batch in cluster.batches([[n] for n in range(parts)], most)] == sizes


def test_jobs_without_a_trial_are_told_apart_by_their_wildcards():
    found = cluster.members([job("draw", "figures", figure=name) for name in ("fig4", "fig3")], ORDER)
    assert [[one.wildcards_dict["figure"] for one in part] for part in found["figures"]] == [["fig3"], ["fig4"]]


def test_resources_are_those_of_the_jobs_that_run_at_a_time_and_of_their_recordings():
    """On two cores 60 s to start and 3 x (20 + 100 + 100 s) / 2 are 390 s."""
    use = {"mem_mb": 100, "core_ms": 10_000, "mem_mb_per_mb": 10, "core_ms_per_mb": 10_000, "slurm_partition": "long"}
    sizes = {"a": 1.0, "b": 9.0, "c": 8.0, "d": 1.0}
    results = ["trials/c.parquet", "quality/c.csv", "trials/d.parquet", "calibration.json"]
    jobs = [job("fit", "trials", trial=trial, resources=use) for trial in "ab"]
    jobs.append(job("compare", "shared", input=results, resources=use))
    asked = cluster.resources(jobs, 2, sizes)
    memory = cluster.STARTING_MB + 2 * (100 + 9 * 10)
    assert asked == {"slurm_partition": "long", "_cores": 2, "_nodes": 1, "mem_mb": memory, "runtime": 7}
    page = job("report", "figures", input=["tables/impedance.csv"], resources=use)
    assert cluster.resources([page], 1, sizes)["mem_mb"] == cluster.STARTING_MB + 100 + sum(sizes.values()) * 10


def test_the_longest_job_sets_the_time_however_many_cores_there_are():
    jobs = [job("fit", "trials", trial="a", resources={"core_ms": ms}) for ms in (600_000, 1000, 1000)]
    assert cluster.resources(jobs, 16, {})["runtime"] == 1 + 30


@pytest.fixture
def ended(tmp_path: Path):
    """Three fits of a submission: `done`, one that was killed, and one that was writing; with a done job's log."""
    jobs = [job("fit", "trials", tmp_path / f"{name}.csv", tmp_path / f"{name}.log", trial=name) for name in "abc"]
    for one, outcome in zip(jobs, ("done", "died"), strict=False):
        Path(one.output[0]).write_text("1")
        write_log(Path(one.log[0]), JobLog("bench.fit", outcome), {})
    write_refusals([Refusal("b", "b.csv", "bench.fit", "died", "killed", "run again")], Path(jobs[1].output[0]))
    temporary_path(Path(jobs[2].output[0]), 99).write_text("half a table")
    return tmp_path, submission(*jobs)


def test_the_results_of_a_lost_submission_that_are_whole_stay_and_the_others_are_named(ended):
    folder, lost = ended
    causes = cluster.record_lost(lost, "12", "SLURM-job '12' failed, SLURM status is: 'TIMEOUT'. Detailed reason: no")
    assert [(cause.trial, cause.outcome, cause.reason) for cause in causes] == [
        (trial, "died", "the cluster's job 12 was lost (TIMEOUT)") for trial in "bc"
    ]
    assert "core_ms" in causes[0].remedy
    assert (folder / "a.csv").read_text() == "1"
    assert [read_refusals(folder / f"{name}.csv") for name in "bc"] == [(cause,) for cause in causes]
    assert not list(folder.glob(".*"))


def test_a_trial_of_several_lost_jobs_is_one_cause_and_a_job_over_trials_is_named_by_its_file(tmp_path):
    jobs = [job(rule, "trials", tmp_path / f"{rule}.csv", tmp_path / "no.log", trial="a") for rule in ("ingest", "fit")]
    shared = job("plate", "shared", tmp_path / "plate.json", tmp_path / "no.log")
    causes = cluster.record_lost(submission(*jobs, shared), "7", "node gone\nmore")
    assert [(cause.trial, cause.reason) for cause in causes] == [
        (t, "the cluster's job 7 was lost (node gone)") for t in ("a", "")
    ]
    assert causes[1].file == str(tmp_path / "plate.json")
    assert read_refusals(tmp_path / "fit.csv") == (causes[0],)


def test_a_full_disk_leaves_no_record_and_the_cause_is_told_all_the_same(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(cluster, "write_refusals", full)
    (cause,) = cluster.record_lost(job("fit", "trials", tmp_path / "a.csv", tmp_path / "a.log", trial="a"), "3", "")
    assert cause.reason == "the cluster's job 3 was lost (no reason is known)"
    assert not (tmp_path / "a.csv").exists()


class Executor:
    """As far as an executor of Snakemake is adapted."""

    next_seconds_between_status_checks = 180

    def __init__(self) -> None:
        self.said: list[tuple] = []
        self.workflow = SimpleNamespace(remote_execution_settings=SimpleNamespace(seconds_between_status_checks=5))
        self.logger = SimpleNamespace(warning=lambda text: self.said.append(("warning", text)))
        self.states: dict[str, str] | None = {}

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


def test_a_lost_submission_is_recorded_before_the_run_goes_on_and_one_that_was_not_taken_is_an_error(tmp_path):
    adapted = type("Adapted", (Executor,), {})
    cluster.adapt(adapted, lambda *lost: cluster.record_lost(*lost))
    one = job("fit", "trials", tmp_path / "a.csv", tmp_path / "a.log", trial="a")
    Path(one.output[0]).write_text("old")
    executor = adapted()
    executor.run_job_pre(one)
    executor.report_job_error(SimpleNamespace(job=one, external_jobid="4"), msg="status is: 'NODE_FAIL'")
    executor.report_job_error(SimpleNamespace(job=one, external_jobid=None), msg="sbatch failed")
    assert executor.said == [("before", False), ("success", True), ("error", "sbatch failed")]
    executor.next_seconds_between_status_checks = 30
    assert executor.next_seconds_between_status_checks == 5
    assert "--executor local" in executor.additional_general_args()


def asked(executor, active):
    """What an executor goes on to ask for."""

    async def collected():
        return [info async for info in executor.check_active_jobs(active)]

    return asyncio.run(collected())


@pytest.fixture
def three(tmp_path):
    """An adapted executor, and three submissions of it."""
    adapted = type("Adapted", (Executor,), {})
    cluster.adapt(adapted, lambda *lost: None)
    jobs = [job("fit", "trials", tmp_path / f"{n}.csv", tmp_path / "no.log", trial=f"t_{n}") for n in "123"]
    return adapted(), [SimpleNamespace(job=one, external_jobid=n) for n, one in zip("123", jobs, strict=True)]


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
    monkeypatch.setattr(cluster.time, "monotonic", lambda: clock[0])
    for now, executor.states in ((0, None), (599, None), (601, {}), (700, None), (1299, None)):
        clock[0] = now
        assert asked(executor, submissions) == submissions
    clock[0] = 1301
    with pytest.raises(
        WorkflowError, match="for 10 min: the end of its jobs 1, 2, 3 is not known; remedy: when squeue"
    ):
        asked(executor, submissions)
