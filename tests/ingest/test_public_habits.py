# SPDX-License-Identifier: Apache-2.0
"""Habits of loggers as public issues describe them: with the one source file that a user writes,
each gives the joint's angle and torque, or is told by its cause.

Met in, among others: OpenLog Artemis 192, PaxInstruments t400 154, SavvyCAN 571, swift-nav
piksi_tools 629, OpenBikeSensor 48, DSView 788, PlotJuggler 1038, bagpy 15, jsk_common 739 and
FlySight 61. No text of theirs is here.
"""

import re
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from recognised_files import refusal_by, source_of

from osl_analysis.base.errors import InputError
from osl_analysis.base.trial import Trial
from osl_analysis.bench.bench_settings import BenchAnalysis
from osl_analysis.ingest.guard import check_recording
from osl_analysis.ingest.raw_files import read_converted

RATE_HZ, ROWS = 200, 1000
TIME = np.arange(ROWS) / RATE_HZ
ANGLE = 8 * np.sin(7 * TIME) + 2 * np.sin(19 * TIME + 1)  # deg
TORQUE = 12 * np.sin(7 * TIME + 0.2) + 3 * np.sin(19 * TIME + 1.4)  # N*m
START = datetime(2026, 5, 1, 10, tzinfo=UTC)
JOINT = list(zip(TIME.tolist(), ANGLE.tolist(), TORQUE.tolist(), strict=True))
PLAIN = [f"{t:.3f},{a:.5f},{m:.5f}" for t, a, m in JOINT]
USUAL = {"time": ("t", "s"), "theta": ("angle", "deg"), "torque": ("torque", "N*m")}


def stamp(seconds):
    return START + timedelta(seconds=seconds)


def comma(text):
    return text.replace(".", ",")


RIGHT = {
    # Excel's first line, and a German locale
    "sep=": (
        ["sep=;", "t;angle;torque"] + [comma(f"{t:.3f};{a:.5f};{m:.5f}") for t, a, m in JOINT],
        {},
    ),
    "quoted decimal commas": (
        ['"t [s]";"angle [Grad]";"torque [Nm]"']
        + [comma(f'"{t:.3f}";"{a:.5f}";"{m:.5f}"') for t, a, m in JOINT],
        {},
    ),
    "index of pandas": (
        [",t,angle,torque", *(f"{row},{line}" for row, line in enumerate(PLAIN))],
        {},
    ),
    "row names of R": (
        ['"t" "angle" "torque"']
        + [f'"{row}" {line.replace(",", " ")}' for row, line in enumerate(PLAIN, start=1)],
        {},
    ),
    "micros() overflows": (
        ["t,angle,torque"]
        + [f"{(round(1e6 * t) + 2**32 - 2_000_000) % 2**32},{a:.5f},{m:.5f}" for t, a, m in JOINT],
        {"time": ("t", "us")},
    ),
    "millis() of 16 bits": (
        ["t,angle,torque"]
        + [f"{(round(1e3 * t) + 63_000) % 2**16},{a:.5f},{m:.5f}" for t, a, m in JOINT],
        {"time": ("t", "ms")},
    ),
    "__time of PlotJuggler": (
        ["__time,/joint/position,/wrench/z"]
        + [f"{1.7e9 + t:.6f},{np.deg2rad(a):.8f},{m:.5f}" for t, a, m in JOINT],
        {
            "time": ("__time", "s"),
            "theta": ("/joint/position", "rad"),
            "torque": ("/wrench/z", "N*m"),
        },
    ),
    "rows of topics between blanks": (
        ["t,angle,torque,other"]
        + [
            row
            for t, a, m in JOINT
            for row in (f"{t:.3f},{a:.5f},{m:.5f},", f"{t + 0.001:.3f},,,7")
        ],
        {"most_missing": 0.6},
    ),
    "rostopic echo -p": (
        ["%time,field.angle,field.torque"]
        + [f"{1_700_000_000_000_000_000 + round(1e9 * t)},{a:.5f},{m:.5f}" for t, a, m in JOINT],
        {
            "time": ("time", "ns"),
            "theta": ("field.angle", "deg"),
            "torque": ("field.torque", "N*m"),
        },
    ),
    "secs and nsecs": (
        ["secs,nsecs,angle,torque"]
        + [
            f"{1_700_000_000 + int(t)},{round(1e9 * t) % 10**9},{a:.5f},{m:.5f}"
            for t, a, m in JOINT
        ],
        {"time": ("secs + nsecs", None)},
    ),
    "ISO 8601 with a zone": (
        ["t,angle,torque"]
        + [f"{stamp(t).isoformat(timespec='milliseconds')},{a:.5f},{m:.5f}" for t, a, m in JOINT],
        {"time": ("t", None)},
    ),
    "date and time apart": (
        ["date,t,angle,torque"]
        + [f"2026-05-01,{stamp(t):%H:%M:%S.%f},{a:.5f},{m:.5f}" for t, a, m in JOINT],
        {"time": ("t", None)},
    ),
    "minutes and seconds": (
        ["t,angle,torque"] + [f"00:{t:06.3f},{a:.5f},{m:.5f}" for t, a, m in JOINT],
        {"time": ("t", None)},
    ),
    "negative stamps": (
        ["t,angle,torque"] + [f"{t - 100:.3f},{a:.5f},{m:.5f}" for t, a, m in JOINT],
        {},
    ),
    "time since the row before": (
        ["t,angle,torque"] + [f"{1 / RATE_HZ:.4f},{a:.5f},{m:.5f}" for _, a, m in JOINT],
        {"time": ("t", "s"), "each": "interval"},
    ),
    "a row of units": (
        ["t\tangle\ttorque", "s\tdeg\tN-m", *(line.replace(",", "\t") for line in PLAIN)],
        {},
    ),
    "units in the cells": (
        ["t,angle,torque"] + [f"{t:.3f} s,{a:.5f} °,{m:.5f} N·m" for t, a, m in JOINT],
        {},
    ),
    "names in the cells": (
        [f"t:{t:.3f}\tangle:{a:.5f}\ttorque:{m:.5f}" for t, a, m in JOINT],
        {},
    ),
    "arrays of one number": (
        ["t,angle,torque"] + [f"{t:.3f},[{a:.5f}],np.float64({m:.5f})" for t, a, m in JOINT],
        {},
    ),
    "the serial monitor's time": (
        ["10:00:00.000 -> angle,torque"]
        + [f"{stamp(t):%H:%M:%S.%f}"[:12] + f" -> {a:.5f},{m:.5f}" for t, a, m in JOINT],
        {"time": ("1", None)},
    ),
    "a comma ends each line": (
        ["# logger 2", "t,angle,torque,", *(f"{line}," for line in PLAIN), "# end"],
        {},
    ),
    "grams at an arm of 0.1 m": (
        ["t,angle,load_g"] + [f"{t:.3f},{a:.5f},{m / 0.980665e-3:.4f}" for t, a, m in JOINT],
        {"torque": ("load_g", "N*m"), "scale": 0.980665e-3},
    ),
    "counts of a converter": (
        ["t,angle,adc"] + [f"{t:.3f},{a:.5f},{m * 41232.2:.1f}" for t, a, m in JOINT],
        {"torque": ("adc", "N*m"), "scale": "1/41232.2"},
    ),
    "the header after each reset": (
        ["t,angle,torque", *PLAIN[:500], "t,angle,torque", *PLAIN[500:]],
        {},
    ),
}
TOLD = {
    "hexadecimal counts": (
        ["t,angle,torque"] + [f"{t:.3f},{a:.5f},0x{3000 + int(9 * m):04X}" for t, a, m in JOINT],
        "'torque' holds no number: its first cell is '0x",
    ),
    "an array in a cell": (
        ["t,angle,torque"] + [f'{t:.3f},{a:.5f},"[{m:.5f}, 1.0]"' for t, a, m in JOINT],
        r"'torque' holds no number: its first cell is '\[",
    ),
    "the log level before each line": (
        ["t,angle,torque"]
        + [f"I ({1000 * t:.0f}) bench: {t},{a:.5f},{m:.5f}" for t, a, m in JOINT],
        "'t' holds no number: its first cell is 'I",
    ),
    "Python's dictionaries": (
        [f"{{'t': {t:.3f}, 'angle': {a:.5f}, 'torque': {m:.5f}}}" for t, a, m in JOINT],
        "dictionaries.*json.dumps",
    ),
    "a line a value": (
        [
            f">{name}:{1000 * t:.0f}:{value:.5f}"
            for t, a, m in JOINT
            for name, value in (("angle", a), ("torque", m))
        ],
        "no table of numbers.*>angle:.*row per sample",
    ),
    "decimal commas between commas": (
        ["t,angle,torque"]
        + [f"{line},{row % 9}" if row % 7 else line for row, line in enumerate(PLAIN)],
        "4 cells under 3 names",
    ),
    "profiles one after the other": (
        ["t,angle,torque", *PLAIN, *PLAIN],
        "holds 2 recordings",
    ),
}


def log_source(torque_scale=1.0, each="stamp", **stated):
    """What a user states of a log: name and unit of each column."""
    names = USUAL | {key: value for key, value in stated.items() if isinstance(value, tuple)}
    others = {key: value for key, value in stated.items() if not isinstance(value, tuple)}
    column, unit = names.pop("time")
    channels = {
        name: {"column": title, "unit": unit_of_column}
        for name, (title, unit_of_column) in names.items()
    }
    channels["torque"]["scale"] = torque_scale
    time = {"column": column, "each": each} | ({"unit": unit} if unit else {})
    return source_of("csv", time=time, channels=channels, **others)


@pytest.mark.parametrize("habit", RIGHT)
def test_a_log_of_this_habit_gives_the_joints_angle_and_torque(tmp_path, habit):
    lines, stated = RIGHT[habit]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines) + "\n")
    stated = dict(stated)
    scale = stated.pop("scale", 1.0)

    samples = read_converted(path, log_source(torque_scale=scale, **stated)).samples.drop_nulls()

    np.testing.assert_allclose(samples["time"], TIME, atol=1e-6)
    np.testing.assert_allclose(samples["theta"], np.deg2rad(ANGLE), atol=2e-6)
    np.testing.assert_allclose(samples["torque"], TORQUE, atol=1e-4)


@pytest.mark.parametrize("habit", TOLD)
def test_a_log_of_this_habit_is_told_by_its_cause(tmp_path, habit):
    lines, message = TOLD[habit]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines) + "\n")

    assert re.search(message, refusal_by(read_converted, path, log_source()))


def test_a_header_that_states_another_unit_of_time_is_told_by_the_step(tmp_path):
    """Milliseconds in the header, seconds in the rows."""
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["t(msec),angle,torque", *PLAIN]) + "\n")
    converted = read_converted(path, log_source(time=("t", "ms")))

    with pytest.raises(InputError, match="its samples are 5e-06 s apart; correct the `unit`"):
        check_recording(Trial("a", converted.samples, {}), BenchAnalysis(cutoff_hz=15, order=4))
