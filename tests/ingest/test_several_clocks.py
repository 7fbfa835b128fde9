# SPDX-License-Identifier: Apache-2.0
"""Channels of several clocks: in one table, and in two files of one trial."""

import numpy as np
import pytest
from conftest import refused_with
from shipped import CONFIG

from osl_analysis.base.recording import Rows
from osl_analysis.bench.calibration import with_clock_error
from osl_analysis.ingest.raw_files import trial_from_files
from osl_analysis.ingest.table_log import with_own_rows
from osl_analysis.signals.grid import stream_of

FAST = np.arange(0, 20, 0.004)
SLOW = 0.0013 + np.arange(0, 20, 0.02)
NOISE = np.random.default_rng(1).normal(0, 0.02, FAST.size)
EDGES = np.cumsum(np.random.default_rng(2).uniform(0.3, 1.2, 40))
LATE_S, FAST_PPM = 0.031, 40.0


def turned(time):
    """A motion that does not repeat within a recording [deg]."""
    return np.sin(5.1 * time) + np.sin(11.3 * time + 1) + 0.6 * np.sin(2.3 * time**1.2)


def pulses(time):
    return 3.3 * (np.searchsorted(EDGES, time) % 2)


def on_second_clock(time):
    """Readings of a clock that begins late and runs fast."""
    return (time - LATE_S) * (1 + 1e-6 * FAST_PPM) + 1000


def write(path, head, *columns):
    rows = [
        ",".join("" if np.isnan(x) else f"{x:.6f}" for x in row)
        for row in zip(*columns, strict=True)
    ]
    path.write_text("\n".join([head, *rows]) + "\n")


def trial_of_two(folder, clock, *, angle="", torque=""):
    """The trial of x.csv and x_torque.csv, whose source files have more channels."""
    (folder / "a.yaml").write_text(
        "format: csv\ntime: {column: t, unit: s}\nchannels:\n  theta: {column: angle, unit: deg}\n"
        + angle
    )
    (folder / "b.yaml").write_text(
        f"format: csv\nclock: {clock}\ntime: {{column: t, unit: s}}\nchannels:\n"
        f"  torque: {{column: load, unit: Nm}}\n{torque}"
    )
    row = {"trial": "x", "log": "x.csv", "log_source": "a"}
    row |= {"log_2": "x_torque.csv", "log_2_source": "b"}
    return trial_from_files(row, folder, folder)


def write_pair(folder, second=on_second_clock, last_s=20.0):
    """An angle on the first clock, and a torque on the second; both have pulses and the angle."""
    stops = SLOW[SLOW < last_s]
    write(folder / "x.csv", "t,angle,ttl", FAST, turned(FAST) + NOISE, pulses(FAST))
    columns = (3 * turned(stops), pulses(stops), 1.1 * turned(stops) + 2)
    write(folder / "x_torque.csv", "t,load,ttl,pot", second(stops), *columns)


SYNC = "  sync: {column: ttl, unit: V}\n"


def test_a_sync_line_of_both_files_tells_offset_and_drift_within_their_errors(tmp_path):
    write_pair(tmp_path)

    trial = trial_of_two(tmp_path, "sync", angle=SYNC, torque=SYNC)

    fit = trial.provenance["clock"]
    time, torque = trial.arrays("torque")
    error_s = fit["residual"] / np.sqrt(max(fit["edges"], 1))
    assert abs((time - SLOW).mean()) < 4 * error_s < 5e-3
    assert abs(-1e6 * fit["drift"] - FAST_PPM) < 4e6 * fit["drift_error"] < 500
    np.testing.assert_allclose(torque, 3 * turned(SLOW), atol=1e-5)


@pytest.mark.parametrize(("last_s", "is_told"), [(19.2, False), (18.5, True)])
def test_logs_of_which_one_ends_more_than_a_second_earlier_are_told(tmp_path, last_s, is_told):
    write_pair(tmp_path, last_s=last_s)

    trial = trial_of_two(tmp_path, "sync", angle=SYNC, torque=SYNC)

    assert ("log_2 ends" in " ".join(trial.provenance["warnings"])) == is_told


def test_what_a_host_is_late_is_no_offset_of_its_clock(tmp_path):
    """A fit takes it off the stamps again: B was 2 %, I 13 % off by a millisecond."""
    late_s = np.minimum(np.random.default_rng(4).exponential(8e-3, SLOW.size), 19e-3)
    write_pair(tmp_path, lambda time: on_second_clock(time + late_s))

    clock = trial_of_two(tmp_path, "sync", angle=SYNC, torque=SYNC).provenance["clock"]

    sampled = on_second_clock(SLOW) - on_second_clock(SLOW[0] + late_s[0])
    error_s = clock["offset"] + (1 + clock["drift"]) * sampled - SLOW
    assert abs(error_s.mean()) < 3e-3


def test_the_error_of_a_fitted_clock_is_one_of_the_torque_s_delay(tmp_path):
    write_pair(tmp_path)
    clock = trial_of_two(tmp_path, "sync", angle=SYNC, torque=SYNC).provenance["clock"]

    calibration = with_clock_error(CONFIG.dynamometer, clock).calibration

    assert calibration.delay == clock["residual"] / np.sqrt(clock["edges"]) > 0
    assert not calibration.tells_delay


@pytest.mark.parametrize(
    ("clock", "second", "late_s"),
    [
        ("common", lambda time: time + 0.5, 0.5),
        ("start", lambda time: time + 4000, -SLOW[0]),
    ],
)
def test_stated_clocks_are_joined_and_what_nothing_shows_is_told(tmp_path, clock, second, late_s):
    write_pair(tmp_path, second, last_s=15.0)

    trial = trial_of_two(tmp_path, clock)

    time, _ = trial.arrays("torque")
    np.testing.assert_allclose(time, SLOW[: time.size] + late_s, atol=1e-5)
    message = " ".join(trial.provenance["warnings"])
    assert "0.001 K" in message
    assert "log_2 ends" in message
    assert "x_torque.csv" in stream_of(trial, ["torque"]).name


@pytest.mark.parametrize("clock", ["master", "sync"])
def test_files_that_nothing_aligns_are_refused_with_what_to_record(tmp_path, clock):
    write_pair(tmp_path)

    with refused_with("record a line with pulses .* clock: sync; .* clock: common.* clock: start"):
        trial_of_two(tmp_path, clock)


def test_a_column_of_both_files_is_refused(tmp_path):
    write_pair(tmp_path)

    with refused_with("column 'theta' is mapped in both source files"):
        trial_of_two(tmp_path, "start", torque="  theta: {column: pot, unit: deg}\n")


def read_table(folder, text, channels):
    source = f"format: csv\ntime: {{column: t, unit: s}}\nchannels:\n{channels}"
    (folder / "source.yaml").write_text(source)
    (folder / "log.csv").write_text(text)
    row = {"trial": "x", "log": "log.csv", "log_source": "source"}
    return trial_from_files(row, folder, folder)


def test_a_channel_of_a_table_has_the_time_that_stands_with_it(tmp_path):
    padded = [
        np.pad(x, (0, FAST.size - SLOW.size), constant_values=np.nan)
        for x in (1e3 * SLOW, turned(SLOW))
    ]
    write(tmp_path / "a.csv", "t,angle,t_load,load", FAST, turned(FAST), *padded)
    channels = "  theta: {column: angle, unit: deg}\n"
    channels += "  torque: {column: load, unit: Nm, time: {column: t_load, unit: ms}}\n"

    trial = read_table(tmp_path, (tmp_path / "a.csv").read_text(), channels)

    time, torque = trial.arrays("torque")
    np.testing.assert_allclose(time, SLOW, atol=2e-9)
    np.testing.assert_allclose(torque, turned(SLOW), atol=1e-6)
    np.testing.assert_allclose(trial.arrays("theta")[0], FAST, atol=2e-9)


BOTH_RATES = np.union1d(FAST, SLOW)[1:-4]
NOISY = turned(FAST) + NOISE


def test_a_channel_that_was_interpolated_is_read_at_its_own_samples(tmp_path):
    angle = np.interp(BOTH_RATES, FAST, NOISY)
    load = np.interp(BOTH_RATES, SLOW, turned(SLOW) + NOISE[: SLOW.size])
    write(tmp_path / "a.csv", "t,angle,load", BOTH_RATES, angle, load)
    channels = "  theta: {column: angle, unit: deg}\n  torque: {column: load, unit: Nm}\n"

    trial = read_table(tmp_path, (tmp_path / "a.csv").read_text(), channels)

    for column, stamps in (("theta", FAST), ("torque", SLOW)):
        time, _ = trial.arrays(column)
        assert np.isin(np.round(time + BOTH_RATES[0], 6), np.round(stamps, 6)).mean() > 0.999
        assert time.size > 0.98 * stamps.size


@pytest.mark.parametrize(
    "values",
    [
        np.round(turned(FAST), 2),
        turned(FAST),
        FAST,
        np.repeat(NOISY[::5], 5),
    ],
)
def test_a_coarse_smooth_or_held_channel_is_no_interpolated_one(values):
    _, remarks = with_own_rows({"theta": values}, Rows(values.size), FAST)

    assert not remarks


def test_damage_between_blank_cells_of_each_clock_is_told_and_left_out(tmp_path):
    wrong = turned(FAST) + NOISE
    wrong[[500, 900, 2000]] = 8388607
    lacks = np.full(FAST.size - SLOW.size, np.nan)
    load = turned(SLOW)
    load[[70, 300]] = 1e6
    columns = (np.append(SLOW, lacks), np.append(load, lacks))
    write(tmp_path / "a.csv", "t,angle,t_load,load", FAST, wrong, *columns)
    text = (tmp_path / "a.csv").read_text().replace("1000000.000000", "ERR", 1)
    channels = "  theta: {column: angle, unit: deg}\n"
    channels += "  torque: {column: load, unit: Nm, time: {column: t_load, unit: s}}\n"

    with refused_with(r"ERR.*'angle' leaps.*'load' leaps.*`damaged: skip`"):
        read_table(tmp_path, text, channels)
    trial = read_table(tmp_path, text, channels + "damaged: skip\n")

    assert np.isnan(trial.arrays("theta")[1]).sum() == 3
    assert np.isnan(trial.arrays("torque")[1]).sum() == 2
