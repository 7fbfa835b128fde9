# SPDX-License-Identifier: Apache-2.0
"""Intervals hold the truth as often as they say, over many simulated recordings of
benchmarks/study.py."""

import numpy as np
import polars as pl
import pytest


def table_of(rows):
    return pl.DataFrame(rows, infer_schema_length=None).with_columns(
        error=pl.col("value") - pl.col("truth")
    )


def covered(table):
    return ((table["low"] <= table["truth"]) & (table["truth"] <= table["high"])).mean()


def ratio(table, size):
    """Root mean square of the error over that of a stated size, over quantities with units of their
    own."""
    each = [
        (one["error"] ** 2).mean() / (one[size] ** 2).mean()
        for _, one in table.group_by("quantity")
    ]
    return np.sqrt(np.mean(each))


def test_frequency_responses_are_as_precise_as_they_say_and_can_be(study):
    """Bounds are three Monte Carlo errors of a ratio and of a coverage, of half of all estimates,
    since the last cycle at a frequency is the next one's."""
    table = table_of(study.rows_of("frequency response", range(4)))

    for size in ("bound", "se"):
        assert ratio(table, size) == pytest.approx(1, abs=0.37), size
    assert covered(table) == pytest.approx(0.95, abs=0.135)


@pytest.mark.usefixtures("without_inference")
def test_intervals_hold_the_truth_of_an_exact_joint_recorded_by_two_nodes(study):
    """24 seeded estimates: three Monte Carlo errors of a coverage are 13 %."""
    table = table_of(study.rows_of("two recorders", range(8)))
    assert covered(table) > 0.95 - 0.13
    assert table.with_columns(share=(pl.col("error") / pl.col("truth")).abs())["share"].max() < 0.03
