"""The interval of a fit to groups: what tells noise and misfit, and how they add up."""

import numpy as np
import pytest
from scipy.special import stdtrit

from osl_analysis.bench.bench_settings import BenchAnalysis
from osl_analysis.bench.record import Groups, Record, Stratum, unlike_groups
from osl_analysis.bench.regression import combined, fit_groups, gram_sums, held_out_vaf
from osl_analysis.signals import Motion

LINE = {"K": "theta", "offset": "one"}


def line_sums(x, torque, groups):
    """Of a torque over a column, both of n rows."""
    record = Record(
        "made", np.arange(len(x)) / 100, x, torque, Motion(x, x, x), torque,
        BenchAnalysis(cutoff_hz=15, order=4), np.ones(len(x), dtype=bool), groups,
    )  # fmt: skip
    return gram_sums(record, {"theta": x, "one": np.ones(len(x))})


@pytest.mark.parametrize(
    ("strata", "repeat", "units", "method"),
    [
        ([5, 5, 5, 5], True, 4, "units"),
        ([5, 5], True, 10, "repeats"),
        ([1] * 12, False, 12, "units"),
        ([4, 4], False, 8, "units"),
        ([1, 1, 1, 1], True, 4, "units"),
    ],
)
def test_misfit_is_told_by_strata_or_groups_and_noise_by_what_repeats(
    strata, repeat, units, method
):
    """The torque leaves a line by another slope in each unit."""
    stratum = np.repeat(np.arange(len(strata)), strata)  # so many groups in each
    first = 10.0 * np.arange(len(stratum))
    kind = "cycles" if repeat else "stretches"
    groups = Groups(kind, first, first + 10, stratum, (Stratum(frequency_hz=1.0),) * len(strata))
    unit = stratum if len(strata) >= 4 else np.arange(len(stratum))
    rng = np.random.default_rng(1)
    rows = 10 * len(stratum)
    x = rng.standard_normal(rows)
    torque = 20 + 3 * x + np.repeat(10 * rng.standard_normal(units)[unit], 10) * x
    s = line_sums(x, torque, groups)

    fit = fit_groups(s, LINE)

    left = torque - fit["K"] * x
    assert fit.vaf == pytest.approx(100 * (1 - np.var(left) / np.var(torque)))
    assert fit.interval_method == method
    assert (fit.repeat is not None) == (repeat and min(strata) > 1)
    of_cycles = strata == [5, 5]
    assert fit.freedom("K") == (pytest.approx(8, abs=2) if of_cycles else units - 1)


@pytest.mark.parametrize("moved", [slice(None), slice(50, 60)])
def test_a_third_of_the_groups_is_predicted_by_a_line_through_the_others(moved):
    """The lowest VAF is that of the noisy third. Where one group alone moves, the others tell no
    line."""
    rng = np.random.default_rng(3)
    first = 10.0 * np.arange(12)
    x = np.zeros(120)
    x[moved] = rng.standard_normal(120)[moved]
    third = np.arange(120) // 10 % 3
    torque = 3 * x + np.where(third == 1, 2.0, 0.1) * rng.standard_normal(120)

    found = held_out_vaf(line_sums(x, torque, unlike_groups(first, first + 10)), LINE)

    is_unseen = third == 1
    slope = np.polyfit(x[~is_unseen], torque[~is_unseen], 1)[0]
    left = (torque - slope * x)[is_unseen]
    expected = 100 * (1 - np.var(left) / np.var(torque[is_unseen]))
    assert found == (pytest.approx(expected) if moved == slice(None) else None)


@pytest.mark.parametrize(("noise", "misfit", "variance", "freedom"), [
    (1.0, 0.5, 0.9, 25), (0.0, 1.0, 1.0, 5), (1.0, 2.0, 2.0, 5),
])  # fmt: skip
def test_noise_and_misfit_are_one_variance_unless_the_misfit_is_larger(
    noise, misfit, variance, freedom
):
    """By hand: (20 * 1 + 5 * 0.5) / 25 = 0.9. A quarter of F with 5 and 20 degrees is over 1.45."""
    found, degrees = combined(np.diag([noise]), np.array([20.0]), np.diag([misfit]), 6)

    assert found[0, 0] == pytest.approx(variance)
    assert degrees[0] == pytest.approx(freedom)


@pytest.mark.parametrize("units", [4, 5, 15])
@pytest.mark.parametrize("misfit_sd", [0.0, 0.5, 1.0, 1.5, 3.0])
def test_intervals_hold_the_truth_of_few_units_whose_misfit_is_small_or_large(units, misfit_sd):
    """1,500 means, each over units of five cycles, whose noise makes an SD of 1 of a unit's mean;
    the truth is 0."""
    seeds = 1500
    cycles = 5
    rng = np.random.default_rng(units)
    of_units = misfit_sd * rng.standard_normal((seeds, units, 1))
    of_cycles = of_units + np.sqrt(cycles) * rng.standard_normal((seeds, units, cycles))
    unit_means = of_cycles.mean(axis=-1)
    noise = of_cycles.var(axis=-1, ddof=1).mean(axis=-1) / (units * cycles)
    misfit = unit_means.var(axis=-1, ddof=1) / units  # as by leaving out one unit at a time
    freedom_of_noise = np.full(seeds, units * (cycles - 1.0))

    covariance, freedom = combined(np.diag(noise), freedom_of_noise, np.diag(misfit), units)

    half_width = stdtrit(freedom, 0.975) * np.sqrt(np.diag(covariance))
    coverage = np.mean(abs(unit_means.mean(axis=-1)) < half_width)
    assert 0.92 <= coverage <= 0.995


def test_rows_near_those_that_are_fitted_are_those_of_their_edges():
    x = np.arange(30.0)
    groups = unlike_groups(np.array([2.0, 15.0]), np.array([6.0, 20.0]))
    record = Record(
        "made", x, x, x, Motion(x, x, x), x, BenchAnalysis(cutoff_hz=15, order=4), x >= 0, groups
    )

    near = np.flatnonzero(record.is_fitted(edge=3))

    assert near.tolist() == [*range(9), *range(12, 23)]
