"""What one submission to a cluster takes, and what it asks for: without a cluster, which tests/slurm has."""

import pytest
from submitted_jobs import job

from osl_analysis import cluster

TRIALS = [f"t_{n}" for n in (3, 1, 2, 10, 5)]
ORDER = {trial: number for number, trial in enumerate(TRIALS)}


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


def planned(wide: int) -> tuple[dict, list, dict]:
    """A campaign: fits of so many batches, a table of them, models over trials, a figure of these, and a page.

    Its batches by group, its jobs of no group, and what waits for a job.
    """
    fits = [job("fit", "trials", trial=f"t_{n}") for n in range(wide)]
    shared, figure = job("compare", "shared"), job("draw", "figures")
    gains, table, page = job("gains", None), job("table", None), job("page", None)
    waiting = {one: [shared, table] for one in fits} | {shared: [figure], gains: [figure], table: [page]}
    taken = {"trials": [[one] for one in fits], "shared": [[shared]], "figures": [[figure]]}
    return taken, [gains, table, page], waiting | {figure: [page]}


def rules(submissions: list[tuple[str, list]]) -> list[tuple[str, list[str]]]:
    return [(name, [one.rule.name for one in jobs]) for name, jobs in submissions]


def test_a_campaign_of_one_batch_is_one_submission_with_the_jobs_of_no_group():
    taken, single, waiting = planned(1)
    everything = ["fit", "compare", "draw", "gains", "table", "page"]
    found = cluster.submissions(taken, single, lambda one: waiting.get(one, ()))
    assert rules(found) == [("trials_shared_figures", everything)]


def test_groups_of_one_batch_are_taken_together_to_the_end_and_what_does_not_follow_from_them_runs_at_home():
    taken, single, waiting = planned(2)
    found = cluster.submissions(taken, single, lambda one: waiting.get(one, ()))
    assert rules(found) == [("trials", ["fit"])] * 2 + [("shared_figures", ["compare", "draw", "page"])]


def test_a_group_that_another_of_several_batches_waits_for_stays_alone():
    """Else the others would wait for it and it for them. What a group without a follower is taken with follows too."""
    taken, single, waiting = planned(1)
    taken["figures"] = [taken["figures"][0], [job("draw", "figures")]]
    found = cluster.submissions(taken, single, lambda one: waiting.get(one, ()))
    assert rules(found) == [("trials", ["fit"]), ("shared", ["compare"]), ("figures", ["draw"]), ("figures", ["draw"])]


def test_a_job_of_no_group_takes_no_memory_for_recordings():
    use = {"mem_mb": 100, "mem_mb_per_mb": 10}
    table = job("table", None, input=["rows/a.csv"], resources=use)
    assert cluster.resources([table], 1, {"a": 50.0})["mem_mb"] == cluster.STARTING_MB + 100
