"""The interval of a fit to groups: what tells noise and misfit, and how they add up."""

import numpy as np
import pytest
from scipy.special import stdtrit

from osl_analysis.bench.bench_settings import BenchAnalysis
from osl_analysis.bench.record import Groups, Record, Stratum
from osl_analysis.bench.regression import combined, fit_groups, gram_sums
from osl_analysis.signals import Motion


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
    record = Record(
        "made", np.arange(rows) / 100, x, torque, Motion(x, x, x), torque,
        BenchAnalysis(cutoff_hz=15, order=4), np.ones(rows, dtype=bool), groups,
    )  # fmt: skip
    s = gram_sums(record, {"theta": x, "one": np.ones(rows)})

    fit = fit_groups(s, {"K": "theta", "offset": "one"})

    left = torque - fit["K"] * x
    assert fit.vaf == pytest.approx(100 * (1 - np.var(left) / np.var(torque)))
    assert fit.interval_method == method
    assert (fit.repeat is not None) == (repeat and min(strata) > 1)
    misfit_freedom = units - 1
    by_noise = fit.freedom("K") != misfit_freedom
    assert by_noise == (strata == [5, 5])


@pytest.mark.parametrize(("noise", "misfit", "freedom"), [(1.0, 0.0, 20), (0.0, 1.0, 5)])
def test_degrees_of_freedom_are_those_of_what_makes_the_variance(noise, misfit, freedom):
    """Noise has its own, and the misfit of six units one fewer than these."""
    _, found = combined(np.diag([noise]), np.array([20.0]), np.diag([misfit]), 6)

    assert found[0] == pytest.approx(freedom)


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
