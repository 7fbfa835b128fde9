# SPDX-License-Identifier: Apache-2.0
"""osl-analysis: `osl.fit` (docs/notebook.md)."""

import tempfile
from pathlib import Path

import polars as pl

import osl_analysis as osl
from osl_analysis.base.files import DISTRIBUTION
from osl_analysis.judge.rules import Grade

PACKAGES = (DISTRIBUTION,)


def fitted(t, theta, torque, person):
    """K, B and I with their ends by column, and the findings that doubt them or are friction or
    another property of the joint."""
    trial = osl.Trial("recording", pl.DataFrame({"time": t, "theta": theta, "torque": torque}))
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder, "config.yaml")
        config.write_text(
            "parameters: null\ndynamometer: {" + ("cutoff_hz: 40" if person else "") + "}\n"
        )
        fit = osl.fit(trial, config=config)
    found = dict(fit.row)
    if found.get("B_viscous") is not None:  # friction is certain
        found |= {f"B{end}": found[f"B_viscous{end}"] for end in ("", "_low", "_high")}
    told = [f for f in fit.findings[-1] if f.grade is Grade.DOUBTS or f.is_result]
    return found, told


def answer(found, doubts):
    intervals = {name: (found[f"{name}_low"], found[f"{name}_high"]) for name in "KBI"}
    return found["K"], found["B"], found["I"], intervals, [finding.cause for finding in doubts]


def estimate(t, theta, torque, person=0.0, **known):
    return answer(*fitted(t, theta, torque, person))
