# SPDX-License-Identifier: Apache-2.0
"""Oddities that recordings of others have: a stale row, a gate, a copied topic."""

import re

import numpy as np
import polars as pl
import pytest
from conftest import white_noise
from log_builders import ankle
from mcap_builder import HEADER, stamped, write_log
from recognised_files import read_recognised, refusal_of

from osl_analysis.base.recording import Rows
from osl_analysis.ingest.clock import aligned_clock
from osl_analysis.ingest.conversion import Converted, fresh_rows

TIME, ANGLE, TORQUE = ankle(4000)
ROWS = np.column_stack([1e3 * TIME + 50_000, ANGLE, TORQUE])
CSV = {
    "time": {"column": "time", "unit": "ms"},
    "channels": {
        "theta": {"column": "angle", "unit": "deg"},
        "torque": {"column": "torque", "unit": "N*m"},
    },
}


def write_rows(path, rows):
    lines = [f"{t:.0f},{a:.9f},{f:.9f}" for t, a, f in rows]
    path.write_text("\n".join(["time,angle,torque", *lines, ""]))
    return path


# Rows of another time.


@pytest.mark.parametrize("row", [0, 1800, 3999])
def test_a_stale_row_is_left_out_and_named(tmp_path, row):
    rows = ROWS.copy()
    rows[row] = rows[1200] + [1, 0, 0]

    recording = read_recognised(write_rows(tmp_path / "a.csv", rows), **CSV)

    kept = np.delete(np.arange(TIME.size), row)
    if row == 3999:  # it stands at the end, where time just ends
        kept = np.arange(3999)
    np.testing.assert_allclose(recording.samples["torque"], TORQUE[kept], atol=1e-8)
    assert any(f" {row + 2} " in f"{text} " for text in recording.warnings)


@pytest.mark.parametrize("back", [slice(2000, None), slice(300, 3900, 30)])
def test_a_clock_that_stays_or_goes_back_often_is_refused(tmp_path, back):
    rows = ROWS.copy()
    rows[back, 0] -= 1000

    message = refusal_of(write_rows(tmp_path / "a.csv", rows), **CSV)

    assert "'time'" in message


@pytest.mark.parametrize("after", [(10,), (10, 11), (700, 703, 1995)])
def test_rows_between_gaps_are_not_stale(after):
    clock = np.arange(2000) * 0.002
    for row in after:
        clock[row:] += 5

    assert fresh_rows(Rows(2000), clock)[0].size == 2000


def test_a_stale_message_is_left_out_and_named(tmp_path):
    stamps = 10**10 + np.arange(2000) * 2_000_000
    stamps[1200] -= 3 * 10**9
    text = "std_msgs/Header header\nfloat64 force\n" + HEADER
    path = write_log(tmp_path / "a.mcap", [stamped(int(ns), force=1.0) for ns in stamps], text)
    torque = {"topic": "/lab", "field": "force", "unit": "N*m"}

    recording = read_recognised(path, time={"source": "header"}, channels={"torque": torque})

    assert len(recording.samples) == 1999
    assert any(re.search(" 1201 .* 2000", text) for text in recording.warnings)


# A gate in place of pulses.


def recorded(time, level):
    return Converted(pl.DataFrame({"time": time, "sync": level}), {})


def test_a_gate_is_the_one_pulse_that_is_as_long_as_the_capture():
    session = np.arange(0, 60, 0.002)
    level = ((session > 10) & (session < 14)) | ((session > 30) & (session < 37))
    noise = 0.01 * white_noise(7000, 1)

    fit = aligned_clock(
        recorded(session, level.astype(float)),
        recorded(np.arange(7000) / 1000, 4.93 + noise),
    )

    assert fit.to_master(np.array([30.0]))[0] == pytest.approx(0.0, abs=0.003)
    assert fit.method == "gate"
    uniform = np.hypot(0.002, 0.001) / np.sqrt(12)  # an edge lies anywhere in a step of both
    assert fit.residual == pytest.approx(uniform, rel=1e-3)


@pytest.mark.parametrize("drift", [3e-4, -3e-4])
def test_a_gate_is_as_long_as_its_capture_on_a_clock_that_drifts(drift):
    """Over 100 s two crystals differ by 30 ms, ten times a sample."""
    session = np.arange(0, 120, 0.002)
    level = (session > 10) & (session < 10 + (1 + drift) * 100)

    fit = aligned_clock(
        recorded(session, level.astype(float)),
        recorded(np.arange(20_000) / 200, np.full(20_000, 4.93)),
    )

    assert (fit.method, fit.to_master(10.0)) == ("gate", pytest.approx(0.0, abs=0.003))
