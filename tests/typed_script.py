# SPDX-License-Identifier: Apache-2.0
"""A user's script, as `mypy --strict` sees it: every public name has its type.

It is among the files that `mypy` checks (`pyproject.toml`), and `test_public_names.py` sees that it
uses each name.
"""

from pathlib import Path
from typing import assert_type

import pandas as pd
import polars as pl
from matplotlib.figure import Figure

import osl_analysis as osl


def analyse(folder: Path) -> Figure | None:
    """Everything that a notebook does."""
    trial: osl.Trial = osl.read_recording(*osl.simulate_trial(folder, "belt_01"))
    assert_type(osl.read_trial("a.parquet"), osl.Trial)
    assert_type(osl.check(trial), pl.DataFrame)
    desired = osl.DesiredImpedance("compensated", K_d=300, B_d=5)

    any_fit = osl.fit(trial, "impedance", desired=desired)
    assert_type(any_fit, osl.Fit)
    findings: list[osl.Finding] = [finding for row in any_fit.findings for finding in row]
    print(any_fit.doubtful, [finding.source for finding in findings])
    assert_type(osl.to_pandas(any_fit.table), pd.DataFrame)
    assert_type(osl.read_summary(folder), pl.DataFrame)
    assert_type(osl.read_table(folder / "belt.csv"), pl.DataFrame)

    figures: list[Figure] = [osl.plot_torque(any_fit), osl.plot_figure("results/figures/fig5.csv")]
    figures.append(osl.plot_torque_angle(osl.fit(trial, "torque_angle")))
    try:
        response: osl.FrequencyResponse = osl.frequency_response(trial, desired)
        figures.append(osl.plot_frequency_response(response))
    except (osl.InputError, osl.IdentifiabilityError, osl.UnreachableImpedanceError) as error:
        assert_type(error.remedy, str)
    except osl.OslAnalysisError:
        return None
    return figures[-1]


def mistaken() -> None:
    """What a type checker tells."""
    osl.fit_impedence("a.parquet")  # type: ignore[attr-defined]
    osl.fit(3)  # type: ignore[arg-type]
