# SPDX-License-Identifier: Apache-2.0
"""The comparison with peers: a method of ten lines goes through the whole, and its answers are
scored as they are."""

import subprocess
import sys

import numpy as np
import polars as pl
import pytest
from conftest import ROOT

from osl_analysis.base.table import read_table

PEERS = ROOT / "benchmarks/peers"
TOY = """
import numpy as np

PACKAGES = ("pytest", "numpy")

def estimate(t, theta, torque, rate_hz, bits, person=0, **known):
    if person:
        raise NotImplementedError("a person's joint")
    smooth = lambda x: np.convolve(x, np.hanning(21) / np.hanning(21).sum(), "valid")
    x, y, step = smooth(theta), smooth(torque), 1 / rate_hz
    omega = np.gradient(x, step)
    X = np.column_stack([x, omega, np.gradient(omega, step), np.ones_like(x)])
    K, B, I, _ = np.linalg.lstsq(X, y, rcond=None)[0]
    intervals = {"K": (0.99 * K, 1.01 * K), "B": (0.99 * B, 1.01 * B)}
    return K, B, I, intervals, ["coarse"] if bits < 16 else []
"""
HEAD = (
    "method,trial,K,K_low,K_high,B,B_low,B_high,I,I_low,I_high,doubtful,seconds,megabytes,version\n"
)
RIGHT = "300,299,301,5,4.9,5.1,0.02,0.019,0.021"
OFF = "300,299,301,6,5.9,6.1,0.02,0.019,0.021"


@pytest.fixture(autouse=True)
def peers_are_importable(monkeypatch):
    monkeypatch.syspath_prepend(PEERS)


def test_a_method_of_one_file_and_one_function_is_compared(tmp_path):
    import closed_form
    import generator
    import laboratory
    import recordings
    from score import score_answers

    chosen = {"exact joint", "late torque", "14 bits", "human ankle"}
    cases = [case for case in generator.CASES if case.case in chosen and case.motion == "multisine"]
    sines = {case.case: case for case in laboratory.CASES if case.motion == "stepped sine"}
    # what one case differs in is no part of the next
    sines = [sines["late torque"], sines["exact joint"]]
    recordings.write(tmp_path, [1], cases, sines, closed_form.CASES[:1], seconds=4.0)
    toy = tmp_path / "toy.py"
    toy.write_text(TOY)
    subprocess.run(
        [sys.executable, PEERS / "answers.py", tmp_path, toy], check=True, capture_output=True
    )
    table = score_answers(tmp_path / "answers.csv", tmp_path / "truth.csv")
    found = {row["group"]: row for row in table.iter_rows(named=True)}
    counted = ("answered", "silent", "announced", "false_alarms")
    counts = {case: [row[n] for n in counted] for case, row in found.items()}
    assert counts == {
        "all": [6, 2, 0, 1],
        "14 bits": [1, 0, 0, 1],
        "exact joint": [2, 0, 0, 0],
        "bursts": [1, 0, 0, 0],
        "human ankle": [0, 0, 0, 0],
        "late torque": [2, 2, 0, 0],
    }
    # K times the delay, 300 x 2e-3, is 12 % of B
    assert found["late torque"]["bias_B"] == pytest.approx(-12, rel=0.06)
    answers = read_table(tmp_path / "answers.csv")
    assert answers.filter(pl.col("K").is_null())["doubtful"].to_list() == [
        "not applicable: a person's joint"
    ]
    assert answers["megabytes"].min() > 10
    assert set(answers["version"]) == {f"pytest {pytest.__version__}, numpy {np.__version__}"}


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        # b, without a line, is not answered; B of ±2 % is as wide as what is off
        (
            f"m,a,{RIGHT},,,",
            {
                "silent": 0,
                "announced": 0,
                "false_alarms": 0,
                "coverage": 100,
                "trials": 2,
                "answered": 1,
                "half_width": pytest.approx(1),
                "version": "mine 1.10",
            },
        ),
        (
            f"m,a,{OFF},,,",
            {
                "silent": 1,
                "announced": 0,
                "bias_B": pytest.approx(20),
                "coverage": pytest.approx(200 / 3),
            },
        ),
        (f"m,a,{OFF},late,,", {"silent": 0, "announced": 1, "false_alarms": 0}),
        (
            "m,a,,,,,,,,,,refused,,",
            {"answered": 0, "silent": 0, "false_alarms": 0, "coverage": None},
        ),
        # as MATLAB writes no number
        ("m,a,300,,,NaN,NaN,NaN,0.03,,,,,", {"answered": 1, "silent": 1, "bias_B": None}),
        # its interval says that B may be 5
        ("m,a,300,,,6,4,8,0.02,,,,,", {"silent": 0, "coverage": 100}),
    ],
)
def test_a_miss_is_off_beyond_the_interval_and_silent_without_a_doubt(tmp_path, lines, expected):
    """The row over all cases of some lines of answers."""
    from score import score_answers

    answers, truth = tmp_path / "answers.csv", tmp_path / "truth.csv"
    truth.write_text("trial,group,K,B,I,cause\na,one,300,5,0.02,\nb,one,300,5,0.02,friction\n")
    answers.write_text(HEAD + "".join(f"{line},mine 1.10\n" for line in lines.splitlines()))

    row = score_answers(answers, truth).row(0, named=True)

    assert {name: row[name] for name in expected} == expected
