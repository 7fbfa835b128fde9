# SPDX-License-Identifier: Apache-2.0
"""A page, and a trial on it, with what a test changes."""

from dataclasses import replace

import polars as pl

from osl_analysis.judge.findings import Finding
from osl_analysis.judge.rules import Grade
from osl_analysis.report.page import trial_view

ABOUT = {
    "campaign": "<b>",
    "data": "measured",
    "version": "2.0",
    "configuration": "c",
    "recorded": "recorded 2026-03-14",
}

IMPEDANCE = pl.DataFrame(
    {
        "trial": "a",
        "amplitude_deg": [2.0, None],
        "K": [90.0, 101.0],
        "K_low": [80.0, 99.0],
        "K_high": [100.0, 103.0],
        "VAF": [97.0, 98.0],
    }
)


ROW = {"trial": "a", "experiment": "impedance", "K_d": 100.0, "log": "a.csv"}


WHOLE = Finding("friction", "impedance", "a")


PART = Finding("friction", "impedance", "a", amplitude_deg=2.0)


REMARK = replace(WHOLE, grade=Grade.NOTES)


def worded(*findings):
    return [replace(each, says="says", size="size", remedy="remedy") for each in findings]


def view(*findings, left_out=None, **changed):
    row = {**ROW, **changed}
    return trial_view(row, {"impedance": IMPEDANCE}, worded(*findings), left_out, None)


def page(*trials, **changed):
    facts = {
        "about": ABOUT,
        "made_of": "made of <i>",
        "answer": "K is 300.",
        "sentences": ["1 trial."],
        "notes": [],
        "conditions": (),
        "groups": (),
        "numbers": (),
        "findings": (),
        "trials": trials,
        "figures": (),
        "absent_figures": {},
        "missing_results": {},
    }
    return {**facts, **changed}
