# SPDX-License-Identifier: Apache-2.0
"""The names of `osl_analysis`: each has its docstring, whose example runs, and its types."""

import dataclasses
import doctest
import inspect
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from any_motion import made_trial, multisine
from bench_recordings import RECORDINGS
from conftest import ROOT, joint_trial, refused_with, white_noise

import osl_analysis as osl
from osl_analysis.base.table import SCHEMA, write_table
from osl_analysis.base.trial import SCHEMA_KEY, write_trial
from osl_analysis.figures.drawing import completed

FUNCTIONS = [name for name in osl.__all__ if inspect.isfunction(getattr(osl, name))]
SOURCE = "format: csv\nclock: master\ntime: {column: t, unit: s}\nchannels:\n"
SOURCE += "  theta: {column: a, unit: deg}\n  torque: {column: m, unit: 'N*m'}\n"


@pytest.mark.parametrize(
    "name",
    [*FUNCTIONS, *[name for name in osl.__all__ if dataclasses.is_dataclass(getattr(osl, name))]],
)
def test_a_docstring_names_all_that_comes_in_and_goes_out(name):
    thing = getattr(osl, name)
    text = inspect.getdoc(thing)
    if inspect.isfunction(thing):
        section = "Parameters"
        names = list(inspect.signature(thing).parameters)
        assert "\nReturns\n---" in text
        assert inspect.signature(thing).return_annotation is not inspect.Signature.empty
    else:
        section = "Attributes"
        own = set(inspect.get_annotations(thing))
        names = [field.name for field in dataclasses.fields(thing) if field.name in own]
    told = re.search(rf"\n{section}\n-+\n(.*?)(\n\n\w+\n---|$)", text, re.DOTALL)[1]
    heads = re.findall(r"(?m)^(\S.*?)(?: :|$)", told)
    assert names == [one.strip("*") for head in heads for one in head.split(", ")]


@pytest.fixture(scope="module")
def names_of_examples():
    """Trials by the names that examples give them."""
    rng = np.random.default_rng(3)
    time = np.arange(0, 22, 0.01)
    theta = np.deg2rad(10) * np.sin(2 * np.pi * np.clip(time - 2, 0, 18) / 6)
    torque = 200 * theta + 2 * np.tanh(50 * np.gradient(theta, time))
    sine = np.deg2rad(5) * np.sin(4 * np.pi * np.clip(time - 2, 0, 18))
    noise = 0.05 * white_noise(len(time), 4)  # of a load cell
    made = {name: osl.Trial(name, pl.DataFrame(RECORDINGS[name])) for name in RECORDINGS}
    return {
        "osl": osl,
        "trial": made_trial(rng, multisine(rng)),
        "belt_trial": made["belt"],
        "motorless_trial": made["transmission"],
        "actuator_trial": made["actuator"],
        "foot": joint_trial(time, theta, torque),
        "trial_of_one_frequency": joint_trial(time, sine, 300 * sine + noise),
    }


@pytest.fixture
def laboratory(tmp_path, monkeypatch, names_of_examples):
    """A folder with the files that examples read, and the shipped configuration."""
    write_trial(
        replace(names_of_examples["belt_trial"], name="belt_01"),
        tmp_path / "results/trials/belt_01.parquet",
    )
    write_table(
        pl.DataFrame({"trial": ["a"], "K_s": [685.6]}), tmp_path / "results/tables/belt.csv"
    )
    stance = pl.DataFrame({"stance": [0.0, 100.0], "K_d": [80.0, 340.0], "B_d": [1.0, 5.0]})
    write_table(completed("fig8", stance), tmp_path / "results/figures/fig8.csv")
    number = dict.fromkeys(("low", "high", "interval", "draft", "n_doubtful"))
    number |= {"value": 685.6, "unit": "N*m/rad", "n": 3, "meaning": "stiffness of the belt"}
    summary = {"tables_schema": SCHEMA, "numbers": {"K_s": number}}
    (tmp_path / "results/summary.json").write_text(json.dumps(summary))
    (tmp_path / "bench.yaml").write_text(SOURCE)
    rows = "".join(f"{k / 100},{k % 7},{k}\n" for k in range(200))
    (tmp_path / "bench.csv").write_text(f"t,a,m\n{rows}")
    knee = (ROOT / "docs/five_minutes/knee_K100_B1.csv").read_text()
    (tmp_path / "knee.csv").write_text(knee.replace("knee_angle_deg", "theta_deg"))
    tiny = (ROOT / "tests/tiny_simulation.yaml").read_text()
    (tmp_path / "tiny.yaml").write_text(tiny)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.usefixtures("without_inference", "laboratory")
@pytest.mark.parametrize("name", osl.__all__)
def test_the_example_of_a_docstring_runs(name, names_of_examples):
    found = doctest.DocTestFinder(recurse=False).find(
        getattr(osl, name), name, module=False, globs=names_of_examples
    )
    (example,) = found
    assert example.examples
    told = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS, verbose=False)
    runner.run(example, out=told.append)
    assert not told, "".join(told)


@pytest.mark.usefixtures("laboratory")
@pytest.mark.parametrize("schema", [SCHEMA + 1, SCHEMA - 1, None])
def test_results_of_another_release_are_refused_from_any_folder(monkeypatch, schema):
    summary = Path("results/summary.json")
    content = {**json.loads(summary.read_text()), "version": "9.1", "tables_schema": schema}
    summary.write_text(json.dumps(content))
    told = rf"schema {schema},.*release 9\.1;.*release.*{SCHEMA}:"

    with refused_with(told):
        osl.read_summary()
    monkeypatch.chdir("results/tables")
    with refused_with(told):
        osl.read_table("belt.csv")


def test_an_unknown_name_or_column_is_none():
    table = pl.DataFrame({"trial": "a", "K_s": 685.6, "K_s_low": 680.0, "K_s_high": None})
    fit = osl.Fit("belt", table, pl.DataFrame(), None, (), None, pl.DataFrame)

    assert not hasattr(osl, "fit_impedence")
    assert fit.K_s_interval == pytest.approx((680.0, np.nan), nan_ok=True)
    with pytest.raises(AttributeError, match="'K_t_interval'"):
        _ = fit.K_t_interval


@pytest.mark.usefixtures("laboratory")
def test_a_trial_of_a_newer_release_is_refused(names_of_examples):
    write_trial(names_of_examples["belt_trial"], Path("old.parquet"))
    newer = pl.read_parquet_metadata("old.parquet") | {SCHEMA_KEY: str(SCHEMA + 1)}
    pl.read_parquet("old.parquet").write_parquet("new.parquet", metadata=newer)

    with refused_with(rf"new\.parquet: columns.*schema {SCHEMA + 1}"):
        osl.read_trial("new.parquet")
