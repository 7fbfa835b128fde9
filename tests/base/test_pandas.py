# SPDX-License-Identifier: Apache-2.0
"""Data frames of pandas at the doors of a notebook."""

import numpy as np
import pandas as pd
import polars as pl
import pytest
from any_motion import made_trial, multisine
from conftest import refused_with
from polars.testing import assert_frame_equal

import osl_analysis as osl


def test_a_pandas_frame_gives_the_numbers_of_a_polars_frame():
    rng = np.random.default_rng(3)
    trial = made_trial(rng, multisine(rng, periods=3))
    of_pandas = osl.Trial("made", osl.to_pandas(trial.samples))

    fit = osl.fit(of_pandas, parameters=None)

    expected = osl.fit(trial, parameters=None)
    assert_frame_equal(fit.table, expected.table)


def test_an_index_of_pandas_is_no_matter():
    frame = pd.DataFrame({"time": [0.0, 0.1, 0.2], "theta": [1.0, np.nan, 3.0]}, index=[7, 8, 9])

    samples = osl.Trial("made", frame[1:]).samples

    assert_frame_equal(samples, pl.DataFrame({"time": [0.1, 0.2], "theta": [np.nan, 3.0]}))


@pytest.mark.parametrize("samples", [3, "theta", [1.0, 2.0]])
def test_what_is_no_frame_is_refused_by_name(samples):
    with refused_with(r"trial made: .*`time`"):
        osl.Trial("made", samples)
