"""What a draft guesses of recordings of a known joint."""

import numpy as np
import pytest
from nptdms import ChannelObject, TdmsWriter

from osl_analysis.commands import trials as module
from osl_analysis.draft.draft_source import draft_source

pytestmark = pytest.mark.usefixtures("without_inference", "schemas_made_once")
TRUE = {"K": 80.0, "B": 1.5, "I": 0.03}  # N*m/rad, N*m*s/rad, kg*m^2
NOISE = np.random.default_rng(5).standard_normal((6, 20_000))


def joint(rate, motion):
    """Time [s], angle, velocity and torque of a joint, with 0.05 N*m of noise, by its motion and
    two derivatives."""
    theta, omega, alpha = motion
    time = np.arange(len(theta)) / rate
    torque = (
        TRUE["K"] * theta + TRUE["B"] * omega + TRUE["I"] * alpha + 0.05 * NOISE[0, : len(theta)]
    )
    return time, theta, omega, torque


def sines(runs, amplitude_deg, rate=250):
    """A joint that is moved by runs of (Hz, cycles), with rests of 1 s."""
    pieces = [np.zeros((3, rate))]
    for hz, cycles in runs:
        t, w, a = (
            np.arange(round(cycles / hz * rate)) / rate,
            2 * np.pi * hz,
            np.radians(amplitude_deg),
        )
        pieces += [
            [a * np.sin(w * t), a * w * np.cos(w * t), -a * w * w * np.sin(w * t)],
            np.zeros((3, rate)),
        ]
    return joint(rate, np.hstack(pieces))


def write_csv(path, columns, sign=",", decimal="."):
    rows = [
        sign.join(f"{x:.6f}".replace(".", decimal) for x in row)
        for row in zip(*columns.values(), strict=True)
    ]
    path.write_text("\n".join([sign.join(columns), *rows]) + "\n", encoding="utf-8")


def test_a_torque_has_the_sign_by_which_a_joint_resists(
    tmp_path,
):
    time, theta, _, torque = sines([(1, 8), (3, 20)], 4)
    noise, drafted = 1e-3 * NOISE[1, : time.size], {}
    for name, columns in (
        ("spring", {"theta [rad]": theta, "torque [Nm]": torque}),
        ("turned", {"theta [rad]": theta, "torque [Nm]": -torque}),
        ("damper", {"theta [rad]": theta, "torque [Nm]": -np.gradient(theta, time)}),
        (
            "actuator",
            {
                "theta_m [rad]": theta,
                "current [A]": np.cos(3 * time) + noise,
                "torque [Nm]": np.sin(time),
            },
        ),
    ):
        write_csv(tmp_path / f"{name}.csv", {"time_s": time, **columns})
        drafted[name] = draft_source(module.inspect_file(tmp_path / f"{name}.csv"), "")
    assert [drafted[name].count("sign: -1") for name in drafted] == [0, 1, 0, 0]
    assert "\n  torque_m: {" in drafted["actuator"]


def test_channels_of_tdms_that_begin_apart_are_compared_at_their_own_instants(tmp_path):
    _time, theta, _, torque = sines([(1, 8), (3, 20)], 4)
    with TdmsWriter(tmp_path / "a.tdms") as writer:
        for name, unit, one, start in (("x", "rad", theta, 0), ("y", "Nm", torque[75:], 300)):
            begin = np.datetime64("2026-01-01T00:00:00") + np.timedelta64(start, "ms")
            named = {
                "wf_increment": 1 / 250,
                "wf_start_time": begin,
                "wf_start_offset": 0.0,
                "unit_string": unit,
            }
            writer.write_segment([ChannelObject("Log", name, one, named)])
    drafted = draft_source(module.inspect_file(tmp_path / "a.tdms"), "")
    assert '\n  theta: {channel: "Log/x"' in drafted
    assert '\n  torque: {channel: "Log/y"' in drafted
