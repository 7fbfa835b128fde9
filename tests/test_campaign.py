"""The trials of a campaign: which names the rules of an experiment take."""

import re
from types import SimpleNamespace

import pandas as pd
import pytest

from osl_analysis.campaign import Campaign
from osl_analysis.errors import InputError


def campaign(experiments: dict[str, str]) -> Campaign:
    """A campaign of these trials, each with its experiment."""
    rows = pd.DataFrame({"trial": list(experiments), "experiment": list(experiments.values())})
    sheet = rows.set_index("trial", drop=False)
    return Campaign(SimpleNamespace(sheet="trials.csv"), sheet, sheet[:0])


@pytest.mark.parametrize(
    "experiments",
    [
        {"belt_01": "belt", "belt_02": "belt", "actuator_1": "actuator", "b": "impedance"},
        {"t_1": "belt", "t_10": "impedance", "t_2": "impedance", "t_11": "belt", "t_100": "belt"},
        {"a.b": "belt", "acb": "impedance", "a.b.c": "impedance"},
    ],
)
def test_the_pattern_of_an_experiment_matches_its_trials_and_no_other(experiments):
    found = campaign(experiments)
    for experiment in set(experiments.values()):
        pattern = re.compile(found.pattern(experiment))
        matched = {trial for trial in experiments if pattern.fullmatch(trial)}
        assert matched == {trial for trial, own in experiments.items() if own == experiment}


def test_an_experiment_without_trials_matches_nothing():
    assert re.fullmatch(campaign({"t": "belt"}).pattern("impedance"), "t") is None


def test_the_pattern_of_many_trials_is_no_longer_than_that_of_a_few():
    """Snakemake reads it for every file: with a name of each trial in it, planning takes time with their square."""
    few, many = (
        campaign({f"{experiment}_{n:04d}": experiment for experiment in ("belt", "impedance") for n in range(number)})
        for number in (2, 500)
    )
    assert few.pattern("impedance") == many.pattern("impedance")


def test_the_row_of_another_experiment_s_trial_is_refused_by_name():
    found = campaign({"belt_01": "belt", "k300": "impedance"})
    assert found.row("k300", "impedance")["experiment"] == "impedance"
    with pytest.raises(InputError, match=r"trials\.csv: trial 'belt_01' is of experiment 'belt', not 'impedance'; ask"):
        found.row("belt_01", "impedance")
    with pytest.raises(InputError, match=r"trials\.csv: no trial 'belt_02'; it has belt_01, k300"):
        found.row("belt_02", "impedance")
