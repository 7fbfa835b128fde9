# SPDX-License-Identifier: Apache-2.0
"""What is damaged in a log is told at once, and one setting leaves all of it out."""

import re

import numpy as np
import pytest
from conftest import refused_with, white_noise
from shipped import CONFIG

from osl_analysis.base.measured import spoiled
from osl_analysis.base.trial import Trial
from osl_analysis.ingest.guard import check_recording
from osl_analysis.ingest.quality import Commanded, measure_quality
from osl_analysis.ingest.raw_files import read_converted, read_source

TIME = np.arange(4000) / 200
TORQUE = 30 * np.sin(7 * TIME) + 12 * np.sin(17 * TIME) + 0.05 * white_noise(TIME.size, 3)
SOURCE = """format: csv
time: {column: time, unit: s}
channels:
  theta: {column: angle, unit: rad}
  torque: {column: torque, unit: N*m}
"""
ONES = 2.0**15 - 1


def converted(folder, lines, more=""):
    (folder / "log.yaml").write_text(SOURCE + more)
    (folder / "log.csv").write_text("\n".join(["time,angle,torque", *lines, ""]))
    return read_converted(folder / "log.csv", read_source(folder / "log.yaml"))


@pytest.fixture
def lines():
    return [f"{t:.3f},{0.01 * q:.6f},{q:.4f}" for t, q in zip(TIME, TORQUE, strict=True)]


def test_every_damage_is_told_at_once_and_left_out_by_one_remedy(tmp_path, lines):
    lines[500] = "2.5,0.1"  # cells
    lines[900] = ",0.1,10"  # no time
    lines[1300] = lines[1300].replace(lines[1300].split(",")[2], "ERROR")
    lines[2000:2002] = [lines[200], lines[201]]  # order
    lines[3000] = lines[3000].rpartition(",")[0] + ",99999"

    with refused_with(
        r"line 502 .*line 902.*line 2002.* a word .*line 1302.*99999.* line 3002"
        "(?!.*damaged: skip.*damaged: skip)"
    ):
        converted(tmp_path, lines)
    message = converted(tmp_path, lines, "damaged: skip\n")

    rows = np.delete(np.arange(4000), [500, 900, 2000, 2001])
    torque = message.samples["torque"].to_numpy()
    assert np.isnan(torque).sum() == 2
    np.testing.assert_allclose(message.samples["time"], TIME[rows], atol=1e-9)
    np.testing.assert_allclose(torque[~np.isnan(torque)].sum(), TORQUE[rows].sum(), atol=80)


def test_more_than_a_tenth_is_no_damage_but_the_log_itself(tmp_path, lines):
    lines[::8] = ["0.1,0.2" for _ in lines[::8]]

    with refused_with("500 of 4000"):
        converted(tmp_path, lines, "damaged: skip\n")


@pytest.mark.parametrize("bad", [(ONES, 2 * ONES, 0.0), (ONES,)])
def test_values_that_recur_are_none_of_the_sensor_also_side_by_side(bad):
    rows = np.random.default_rng(5).permutation(4000)[:80]
    values = TORQUE.copy()
    values[rows] = np.resize(bad, 80)

    is_spoiled = spoiled(values)

    assert np.array_equal(np.flatnonzero(is_spoiled), np.sort(rows))


def test_a_number_far_off_that_recurs_is_none_of_the_sensor_also_in_a_row():
    is_bad = (TIME > 3) & (TIME < 3.4)

    assert np.array_equal(spoiled(np.where(is_bad, 9999.0, TORQUE)), is_bad)


WRAPPED = np.round(40 * TORQUE) % 4096


@pytest.mark.parametrize(
    "values",
    [
        TORQUE,
        np.round(TORQUE),
        np.sign(TORQUE),
        WRAPPED[WRAPPED.argmax() :][:300],
        np.where(TIME % 5 < 1, 8.0, 2.0) + 0.01 * TORQUE,
        np.where(np.arange(4000) % 50 == 0, 5.0, 0.0),
        np.full(50, 3.0),
        TORQUE[:2],
        np.full(9, np.nan),
    ],
)
def test_a_sound_channel_has_no_spoiled_value(values):
    assert not spoiled(values).any()


def test_the_remark_on_leaps_says_what_leaving_them_out_costs(tmp_path, lines):
    still = [f"{20 + k / 200:.3f},0.2,{1 + 0.001 * (k % 7):.4f}" for k in range(400)]
    every = lines + still
    for row in range(20, 4400, 40):
        every[row] = every[row].rpartition(",")[0] + f",{ONES}"
    samples = converted(tmp_path, every).samples

    checks = measure_quality(Trial("a", samples), "impedance", Commanded())

    assert re.search("`damaged: skip` .* leaves out 110 values", checks["dropout"].remark)
    assert checks["stuck"].value == 0
    with refused_with("torque leaps or recurs, as 32767, in 110 of .*`damaged: skip`"):
        check_recording(Trial("a", samples), CONFIG.dynamometer)
