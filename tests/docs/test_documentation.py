# SPDX-License-Identifier: Apache-2.0
"""The pages of the documentation: their code, and the functions that they name."""

import ast
import re
import subprocess
import sys
from contextlib import redirect_stdout
from importlib import import_module
from io import StringIO
from xml.etree import ElementTree

import polars as pl
import pytest
from conftest import ROOT

import osl_analysis as osl

BLOCK = re.compile(r"^```python\n(.*?)^```\n(?:\n```text\n(.*?)^```\n)?", re.MULTILINE | re.DOTALL)


def test_every_equation_of_the_method_leads_to_its_function():
    functions = re.compile(r"^\| [0-9–]+ \|.*\| `([\w.]+)` \|$", re.MULTILINE).findall(
        (ROOT / "docs/method.md").read_text(encoding="utf-8")
    )
    assert len(functions) >= 9
    for name in functions:
        module, _, function = name.rpartition(".")
        assert callable(getattr(import_module(f"osl_analysis.{module}"), function)), name


def printed_by(code, names):
    """What a notebook shows of a cell: what it prints, its last expression, or its refusal."""
    *statements, last = ast.parse(code).body
    with redirect_stdout(StringIO()) as printed:
        exec(compile(ast.Module(statements, []), "page", "exec"), names)
        try:
            value = eval(compile(ast.Expression(last.value), "page", "eval"), names)
        except osl.OslAnalysisError as error:
            print(f"{type(error).__name__}: {error}")
            value = None
    if value is not None and not hasattr(value, "_repr_png_"):
        printed.write(repr(value))
    return [line.rstrip() for line in printed.getvalue().strip().splitlines()]


def test_the_page_on_notebooks_shows_what_its_code_prints(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {}
    with pl.Config(
        tbl_width_chars=110,
        tbl_cols=12,
        tbl_rows=12,
        fmt_str_lengths=40,
        tbl_hide_dataframe_shape=True,
    ):
        for code, shown in BLOCK.findall((ROOT / "docs/notebook.md").read_text(encoding="utf-8")):
            assert printed_by(code, names) == shown.splitlines()


def test_the_leg_in_mujoco_has_the_means_over_the_trials_of_components(tmp_path):
    means = {
        "belt": {"K_s": 700.0},
        "transmission": {"B_j": 0.5, "J_j": 0.005},
        "actuator": {"k_tau_n_m": 1.0, "f_C": 0.4, "f_G": 0.09, "B_m": 0.006, "J_m": 0.009},
    }
    (tmp_path / "tables").mkdir()
    for name, quantities in means.items():
        rows = "".join(f"ankle,{symbol},{mean}\n" for symbol, mean in quantities.items())
        (tmp_path / f"tables/{name}_summary.csv").write_text(f"joint,quantity,mean\n{rows}")
    script = (ROOT / "docs/leg_to_mujoco.py", tmp_path, ROOT / "config/parameters/default.yaml")

    written = subprocess.run(
        [sys.executable, *map(str, script)], capture_output=True, text=True, check=True, cwd=ROOT
    )

    model = ElementTree.fromstring(written.stdout)
    belt = model.find("tendon/fixed")
    assert float(belt.get("stiffness")) == 700.0
    assert float(belt.find("joint[@joint='motor']").get("coef")) == pytest.approx(-18 / 83)
    motor = model.find(".//joint[@name='motor']")
    assert (float(motor.get("damping")), float(motor.get("frictionloss"))) == (0.006, 0.4)
