"""osl-analysis: `osl.fit_impedance` (docs/notebook.md); a person's joint with `human: true` (docs/human_joint.md)."""

import tempfile
from pathlib import Path

import polars as pl

import osl_analysis as osl
from osl_analysis.judge.finding import Grade


def estimate(t, theta, torque, person=0.0, **known):
    trial = osl.Trial("recording", pl.DataFrame({"time": t, "theta": theta, "torque": torque}))
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder, "config.yaml")
        config.write_text("parameters: null\ndynamometer: {" + ("cutoff_hz: 40, human: true" if person else "") + "}\n")
        fit = osl.fit_impedance(trial, config=config)
    row = fit.row
    own = {name: name for name in "KBI"}
    if row.get("B_viscous") is not None:  # friction is certain
        own["B"] = "B_viscous"
    intervals = {name: (row[f"{column}_low"], row[f"{column}_high"]) for name, column in own.items()}
    doubts = [finding.cause for finding in fit.findings[-1] if finding.grade is Grade.DOUBTS]
    return *(row[column] for column in own.values()), intervals, doubts
