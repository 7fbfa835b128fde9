# SPDX-License-Identifier: Apache-2.0
"""The interval of a fit to groups: the spread of what repeats, or the jackknife over the rest."""

from dataclasses import replace

import numpy as np
import pytest
from bench_synthetic import second_order, stepped_sine

from osl_analysis.bench.bench_settings import BenchAnalysis
from osl_analysis.bench.friction import without_friction
from osl_analysis.bench.record import Groups, Record, Stratum, unlike_groups
from osl_analysis.bench.regression import IMPEDANCE, gram_sums, least_squares, sums_of
from osl_analysis.signals.filters import Motion
from osl_analysis.spectral.stepped_sine import SteppedSineProtocol

LINE = {"K": "theta", "offset": "one"}


def line_record(x, torque, groups):
    """A record of n rows whose angle and its derivatives are all one column."""
    return Record(
        "made",
        np.arange(len(x)) / 100,
        x,
        torque,
        Motion(x, x, x),
        torque,
        BenchAnalysis(cutoff_hz=15, order=4),
        np.ones(len(x), dtype=bool),
        groups,
        100.0,
    )


def line_sums(x, torque, groups, **columns):
    """Of a torque over a column, and further ones, all of n rows."""
    record = line_record(x, torque, groups)
    return gram_sums(record, {"theta": x, "one": np.ones(len(x)), **columns})


def made_sums(rng, groups, lack_of_fit_g):
    """Of a torque that leaves a line by another slope in each group, and of noise."""
    rows = int(groups.stop[-1])
    x = rng.standard_normal(rows)
    slope = np.repeat(3 + lack_of_fit_g, rows // len(groups.first))
    torque = 20 + slope * x + rng.standard_normal(rows)
    return x, torque, line_sums(x, torque, groups)


def test_rows_near_those_that_are_fitted_are_those_of_their_edges():
    x = np.arange(30.0)
    groups = unlike_groups(np.array([2.0, 15.0]), np.array([6.0, 20.0]))
    record = line_record(x, x, groups)

    near = np.flatnonzero(record.is_fitted(edge=3))

    assert near.tolist() == [*range(9), *range(12, 23)]


def test_what_does_not_repeat_itself_is_left_out_one_at_a_time():
    """By refits, and the freedoms of Bell and McCaffrey by the matrix of all rows' errors."""
    rng = np.random.default_rng(1)
    first = 10.0 * np.arange(9)
    x, torque, s = made_sums(rng, unlike_groups(first, first + 10), rng.standard_normal(9))

    fit = least_squares(s, LINE)

    X = np.column_stack([x, np.ones(90)])
    every = np.linalg.pinv(X)
    of_group = np.repeat(np.arange(9), 10)
    without = []
    for group in range(9):
        kept = of_group != group
        by_rows = np.zeros((2, 90))
        by_rows[:, kept] = np.linalg.pinv(X[kept])
        without.append(by_rows - every)
    apart = np.array(without)
    moved = apart @ torque
    np.testing.assert_allclose(fit.covariance, 8 / 9 * moved.T @ moved, rtol=1e-9)
    for k in range(2):
        C = apart[:, k] @ apart[:, k].T
        assert fit.degrees_of_freedom[k] == pytest.approx(np.trace(C) ** 2 / np.sum(C**2))
    assert fit.interval_method == "blocks"


@pytest.mark.parametrize(
    ("kind", "strata"),
    [("cycles", [5] * 4), ("cycles", [5, 5, *[1] * 10]), ("periods", [5, 5, 5, 1, 1, 1])],
)
def test_what_repeats_itself_has_the_spread_of_its_noise_alone(kind, strata):
    """What differs between strata alone is lack of fit. A group alone scatters as the others do."""
    stratum = np.repeat(np.arange(len(strata)), strata)
    first = 10.0 * np.arange(len(stratum))
    groups = Groups(kind, first, first + 10, stratum, (Stratum(frequency_hz=1.0),) * 12)
    found = []
    standard_errors = []
    for seed in range(300):
        lack_of_fit = np.array([-5.0, 2.0, 0.0, 3.0])[stratum % 4]
        rng = np.random.default_rng(7)  # the same motion
        x = np.tile(rng.standard_normal(10), len(stratum))
        noise = np.random.default_rng(seed).standard_normal(len(x))
        fit = least_squares(
            line_sums(x, (3 + np.repeat(lack_of_fit, 10)) * x + noise, groups), LINE
        )
        found.append(fit["K"])
        standard_errors.append(fit.se("K"))

    assert np.sqrt(np.mean(np.square(standard_errors))) == pytest.approx(np.std(found), rel=0.13)


def test_odd_and_even_cycles_agree_within_intervals_that_no_edge_widens():
    """No cycle is of whole rows, and Eq. 15 misses the same of friction in each."""
    protocol = SteppedSineProtocol((0.05, 0.1), (0.7, 1.7, 2.7, 3.7, 4.7), 9)
    rubbing = stepped_sine(lambda m: second_order(m) + 3 * np.tanh(10 * m.omega), 2e-3, protocol)
    s = sums_of(rubbing)
    is_odd = np.arange(len(s.gram)) % 2 == 1

    odd, even = (least_squares(s.chosen(half), IMPEDANCE) for half in (is_odd, ~is_odd))

    for name in "KBI":
        apart = abs(odd[name] - even[name])
        assert apart < np.hypot(odd.half_width(name), even.half_width(name))
    assert odd.half_width("B") < 1e-3


def test_an_estimate_less_its_friction_has_the_freedom_of_both_errors():
    """Satterthwaite's formula by hand, for a friction that two freedoms tell."""
    rng = np.random.default_rng(5)
    first = 10.0 * np.arange(12)
    x, sign = rng.standard_normal((2, 120))
    torque = 3 * x + 0.5 * sign + rng.standard_normal(120)
    s = line_sums(x, torque, unlike_groups(first, first + 10), T_C=sign)
    told = least_squares(s, {**LINE, "T_C": "T_C"})
    friction = replace(told, degrees_of_freedom=np.full(3, 2.0))
    alone = least_squares(s.less("T_C", friction["T_C"]), LINE)

    fit = without_friction(s, LINE, friction)

    own = np.diag(alone.covariance)
    of_friction = np.diag(fit.covariance)[:2] - own
    freedom = (own + of_friction) ** 2 / (own**2 / alone.degrees_of_freedom + of_friction**2 / 2)
    np.testing.assert_allclose(fit.degrees_of_freedom, [*freedom, 2.0], rtol=1e-9)
    assert (fit.degrees_of_freedom[:2] > 2.5).all()
