"""osl-analysis as its doubt says: where the first doubt has K, B and I without its cause, these, with their range.

docs/bench_validation.md. The range is over all causes that explain the recording as well. Else as `osl_analysis_fit`.
"""

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
    doubts = [finding for finding in fit.findings[-1] if finding.grade is Grade.DOUBTS]
    found = dict(fit.row)
    if found.get("B_viscous") is not None:  # friction is certain
        found |= {f"B{end}": found[f"B_viscous{end}"] for end in ("", "_low", "_high")}
    if doubts:
        found |= doubts[0].without
    intervals = {name: (found[f"{name}_low"], found[f"{name}_high"]) for name in "KBI"}
    return found["K"], found["B"], found["I"], intervals, [finding.cause for finding in doubts]
