"""A large study is few jobs, which together take every trial once, each with the time that it is expected to take."""

import pytest

from osl_analysis.study import BENCH, REPEATED, WALKING
from osl_analysis.study.plan import MOST_JOBS, SECONDS, Batch, batches, planned, time_limit


def study(trials: int, campaigns: int, recorded: int) -> dict[str, tuple[int, int]]:
    """Numbers of trials or campaigns, and how many one job takes at least, as rules/study.smk has them."""
    numbers = dict.fromkeys(BENCH, (trials, 50)) | {name: (campaigns, least) for name, least in REPEATED.items()}
    return numbers | {"walking": (campaigns, WALKING["walking"][1]), "walking recorded": (recorded, 5)}


@pytest.mark.parametrize(
    "numbers", [(500, 200, 80), (10_000, 200, 80), (10_000, 2000, 1000), (1000, 1000, 1000), (1, 1, 1), (0, 0, 0)]
)
def test_every_trial_is_in_one_job_and_there_are_fewer_than_a_hundred_with_table_page_and_figure(numbers):
    asked = study(*numbers)
    found = batches(asked)
    assert len(found) <= MOST_JOBS
    assert MOST_JOBS + 4 < 100
    for name, (number, _) in asked.items():
        taken = [n for one in found if one.experiment == name for n in range(one.first, one.first + one.number)]
        assert taken == list(range(number))


def test_jobs_of_a_large_study_take_about_as_long_and_those_of_a_small_one_are_not_smaller_than_stated():
    whole = [one.seconds for one in batches(study(10_000, 2000, 1000))]
    assert max(whole) < 1.5 * sum(whole) / MOST_JOBS
    small = batches(study(500, 200, 80))
    assert min(one.number for one in small if one.experiment == "drivetrain") >= 50


def test_every_experiment_has_an_expected_time_and_no_other_has():
    named = {name for name in (*BENCH, *WALKING) if not name.startswith("second order")}
    assert set(SECONDS) == named


def test_a_dry_run_says_how_long_each_job_is_expected_to_take():
    assert Batch("drivetrain", 100, 1000).seconds == pytest.approx(550)
    assert planned({"drivetrain_0_1000": 550.0, "belt_0_500": 20.0}).splitlines() == [
        "expected time of one core for 2 jobs of the study, 0.2 h in all:",
        "  drivetrain_0_1000: 9 min",
        "  belt_0_500: 20 s",
    ]
    assert planned({}) == ""
    assert time_limit(550.0) == 29
