# SPDX-License-Identifier: Apache-2.0
"""Torque against angle: loops whose area, slopes and energies are known in closed form, and what is
no such trial."""

from itertools import pairwise

import numpy as np
import polars as pl
import pytest
from conftest import marked, refused_with, white_noise
from shipped import CONFIG

from osl_analysis.base.trial import Trial
from osl_analysis.bench.bench_settings import TorqueAngleAnalysis
from osl_analysis.bench.cycles import find_loop
from osl_analysis.bench.torque_angle import torque_angle_trial
from osl_analysis.ingest.quality import saturated

ALWAYS = {"not checked: delay of the torque", "not checked: fixture"}

RATE = 250.0
PERIOD = 8.0
A = np.deg2rad(10)
K = 200.0
B = 30.0
W = 2 * np.pi / PERIOD
PLAIN = {"zero": "none"}


def trial_of(theta, torque, **provenance):
    samples = pl.DataFrame({"time": np.arange(theta.size) / RATE, "theta": theta, "torque": torque})
    return Trial("foot", samples, provenance)


def fitted(theta, torque, curve=None, **changes):
    settings = TorqueAngleAnalysis.model_validate(CONFIG.torque_angle.model_dump() | changes)
    return torque_angle_trial(trial_of(theta, torque), settings, curve)


def row_of(theta, torque, **changes):
    """The row of the table, with causes of doubt and what is not checked by name, but that one
    speed does not tell a delay."""
    rails = saturated(trial_of(theta, torque))
    table = fitted(theta, torque, **changes).table.with_columns(rails)
    row = marked(table, CONFIG.doubtful.of("torque_angle"), "torque_angle").row(0, named=True)
    others = [item for item in (row.get("remarks") or "").split("; ") if item not in ALWAYS]
    return row | {"remarks": "; ".join(others)}


def clock(duration):
    return np.arange(round(duration * RATE) + 1) / RATE


def path(*angles_deg, speed=4.0, rest=1.0):
    """Ramps [rad] from angle to angle at one speed [deg/s], with rests before and after."""
    ramps = [np.full(round(rest * RATE), angles_deg[0])]
    for a, b in pairwise(angles_deg):
        ramps.append(np.linspace(a, b, round(abs(b - a) / speed * RATE), endpoint=False))
    return np.deg2rad(np.concatenate([*ramps, np.full(round(rest * RATE), angles_deg[-1])]))


def jenkins(theta, stiffness, limit):
    """Torque of a spring that slips at a limit."""
    torque = np.zeros_like(theta)
    for k in range(1, theta.size):
        torque[k] = np.clip(torque[k - 1] + stiffness * (theta[k] - theta[k - 1]), -limit, limit)
    return torque


TURNS = W * clock(3 * PERIOD)
CYCLED = A * np.sin(TURNS)
OF_CYCLES = K * CYCLED + B * A * W * np.cos(TURNS)


def test_an_elliptic_loop_has_the_energies_of_a_spring_with_damping():
    row = row_of(CYCLED, OF_CYCLES, **PLAIN)
    assert row["cycles"] == 3
    assert row["energy_lost"] == pytest.approx(np.pi * B * W * A**2, rel=1e-4)
    size = A * np.hypot(K, B * W)
    lag = np.arctan2(B * W, K)
    stored = size * A / 2 * (2 * np.cos(lag) + (np.pi + 2 * lag) * np.sin(lag))
    returned = size * A / 2 * (2 * np.cos(lag) - (np.pi - 2 * lag) * np.sin(lag))
    assert row["energy_stored"] == pytest.approx(stored, rel=1e-3)
    assert row["energy_returned"] == pytest.approx(returned, rel=1e-3)
    assert row["returned_share"] == pytest.approx(returned / stored, rel=1e-3)
    assert (row["K"], row["K_unloading"]) == pytest.approx((K, K), rel=1e-3)


def test_one_cycle_has_no_interval():
    theta = A * np.sin(W * clock(PERIOD))
    row = row_of(theta, K * theta, **PLAIN)
    assert row["cycles"] == 1
    assert row["interval_method"] is row["K_low"] is None


STIFFENING = 3000.0
END = np.deg2rad(12)


def cubic_spring():
    """A fit to a spring that stiffens, turned without corners, which the filter would round."""
    turns = 1 - np.cos(W * clock(2 * PERIOD))
    theta = np.deg2rad(6) * np.concatenate([turns, np.zeros(250)])
    return fitted(theta, K * theta + STIFFENING * theta**3 + 3.0)


def test_a_cubic_spring_has_the_energy_and_the_slope_of_its_curve_and_no_loss():
    row = cubic_spring().table.row(0, named=True)

    assert (row["cycles"], row["loading"]) == (2, "rising")
    assert row["torque_zero"] == pytest.approx(3, abs=1e-6)
    assert row["energy_lost"] == pytest.approx(0, abs=1e-3)
    # a line over angle, whatever the speed
    assert row["K"] == pytest.approx(K + 0.9 * STIFFENING * END**2, rel=1e-3)
    assert row["energy_stored"] == pytest.approx(K * END**2 / 2 + STIFFENING * END**4 / 4, rel=1e-3)


def test_a_cubic_spring_has_its_curve_and_its_slope_at_every_angle():
    curve = cubic_spring().curves

    loading = curve.filter(pl.col("branch") == "loading")
    assert loading["angle_deg"].to_list()[-23:] == list(np.arange(0.5, 12, 0.5))
    angle = np.deg2rad(curve["angle_deg"].to_numpy())
    window = 0.05 * END
    inside = (angle > 1.2 * window) & (angle < END - 1.2 * window)
    expected = (K * angle + STIFFENING * angle**3)[inside]
    np.testing.assert_allclose(curve["torque"].to_numpy()[inside], expected, rtol=2e-3)
    # of a parabola through a cubic
    slope = K + 3 * STIFFENING * angle**2 + 0.6 * STIFFENING * window**2
    np.testing.assert_allclose(curve["stiffness"].to_numpy()[inside], slope[inside], rtol=2e-3)


SMALLER = (*(x for a in (6, 8, 10, 6, 8, 10) for x in (0, a, -a)), 0)


@pytest.mark.parametrize(
    ("angles", "count"),
    [
        ((0, -10, 12, 0), 1),  # as the tests of the DESR foot
        ((6, 10, -10, 10, -10, 6), 2),
        ((0, 10, 0, 10, 0, 5), 2),
        ((0, -10, 10, -10, 10, 5), 1),
        ((0, 10, 1, 10, 1, 10, 0), 1),  # from a preload
        ((6, 10, -10, 10, -10, 5.4), 1),  # open by 3 % of the motion
        (SMALLER, 2),
    ],
)
def test_cycles_begin_and_end_where_the_angle_comes_back(angles, count):
    """Without those of a smaller amplitude, or without the way back."""
    assert len(find_loop(path(*angles)).cycles) == count


def test_a_device_that_starts_within_its_loop_is_doubtful_by_one_cycle():
    """Cycles of +-A lose 4 limit (A - limit/slip); on its way out the first one has not the torque
    of the others."""
    slip = 400.0
    limit = 4.0
    theta = path(0, *(10, -10) * 4, 0)
    torque = K * theta + jenkins(theta, slip, limit)

    whole = row_of(theta, torque, zero="start")
    later = row_of(theta, torque, zero="start", settle_cycles=1)

    assert (whole["cycles"], whole["doubtful"]) == (4, "loop that does not close")
    assert (later["cycles"], later["doubtful"]) == (3, None)
    assert later["energy_lost"] == pytest.approx(4 * limit * (A - limit / slip), rel=1e-3)


def test_a_zero_changes_energies_and_no_slope():
    """A foot that rests under 5 N*m at its middle, which its end takes for the load cell's
    offset."""
    theta = path(0, *(10, -10) * 3, 0)
    torque = K * theta + 5.0

    unstated, stated, at_end = (row_of(theta, torque, zero=z) for z in (None, "none", "end"))

    zeros = (unstated["torque_zero"], stated["torque_zero"], at_end["torque_zero"])
    assert zeros == (None, 0.0, pytest.approx(5.0))
    assert (unstated["remarks"], stated["remarks"], at_end["remarks"]) == (
        "not checked: sensor not zeroed",
        "",
        "",
    )
    assert at_end["K"] == pytest.approx(stated["K"], rel=1e-9), "a slope has no zero"
    assert unstated["energy_stored"] == stated["energy_stored"] > at_end["energy_stored"]


FULL = path(0, 10, 0, 10, 0)
OPEN = path(0, 10, 0.7)
NOISE = white_noise(FULL.size, 3)
CREEPING = FULL + np.deg2rad(0.2) * np.linspace(1 - FULL.size / RATE, 1, FULL.size).clip(0)


@pytest.mark.parametrize(
    ("theta", "torque", "changes", "message"),
    [
        (FULL / 100, K * FULL, {}, r" 0\.0997 deg .* 1 "),
        (OPEN, K * OPEN, {}, r" 0\.00 deg.* 0\.00 .*9\.97 deg.* 0\.70 deg"),
        (path(0, 10, 0, speed=20), K * path(0, 10, 0, speed=20), {}, r" 1 s.*shortest_cycle_s"),
        (0 * FULL, K * FULL, {}, "theta .*0"),
        (FULL, -K * FULL, {}, "K = -200 "),
        (path(0, 10, 0, rest=0.2), K * path(0, 10, 0, rest=0.2), {}, r"torque_angle\.zero"),
        (CREEPING, K * CREEPING, {}, r"does not rest at the end.* 0\.14 deg"),
        (FULL, K * FULL, {"angle_step_deg": 5}, "angle_step_deg = 5 .* 5"),
        (FULL, K * FULL, {"bench_stiffness": {"value": "150 N*m/rad"}}, "K = -.*150 N"),
        (FULL, K * FULL, {"settle_cycles": 2}, " 2 .*settle_cycles"),
    ],
)
def test_what_is_no_trial_of_torque_against_angle_is_refused(theta, torque, changes, message):
    with refused_with(rf"^trial foot:.*{message}"):
        fitted(theta, torque, **changes)


@pytest.mark.parametrize(
    ("theta", "torque", "changes", "column", "cause"),
    [
        (FULL, K * FULL + jenkins(FULL, 300, 0.5) + 0.05 * NOISE, {}, "doubtful", ""),
        (
            FULL,
            K * FULL + 6 * np.linspace(0, 1, FULL.size),
            PLAIN,
            "doubtful",
            "loop that does not close",
        ),
        (FULL, np.minimum(K * FULL + 0.01 * NOISE, 25), {}, "doubtful", "clipped signal"),
        (FULL, 1e3 * K * FULL, {}, "doubtful", "unlikely size"),
        (FULL, np.roll(K * FULL, 30) + 0.01 * NOISE, {}, "doubtful", "loop that does not close"),
        # no offset beside a wide loop
        (FULL, K * FULL + jenkins(FULL, 400, 4), {"zero": "start"}, "remarks", ""),
    ],
)
def test_drift_clipping_speed_and_energy_from_nothing_are_doubtful(
    theta, torque, changes, column, cause
):
    assert cause in (row_of(theta, torque, **changes)[column] or "").split("; ")


def test_intervals_have_what_a_drift_makes_of_slopes_and_energies():
    """2 % of the range of torque in six cycles: less than a doubt, and without scatter."""
    theta = path(0, *(10, -10) * 6, 0)
    drift = 0.02 * K * np.ptp(theta) * np.linspace(0, 1, theta.size)

    sound, drifting = (row_of(theta, K * theta + error, zero="end") for error in (0, drift))

    assert drifting["doubtful"] is None
    for name in ("K", "K_unloading", "energy_stored", "energy_returned"):
        half = drifting[f"{name}_high"] - drifting[name]
        assert half == pytest.approx(1.96 * abs(drifting[name] - sound[name]), rel=0.1), name


def test_a_desired_curve_that_no_setting_has_is_refused():
    with refused_with(r"'other'.*torque_angle\.desired"):
        fitted(FULL, K * FULL, "other")


def test_a_desired_curve_stands_beside_the_measured_one():
    curve = {"angle_deg": [0.0, 5.0, 8.0], "torque": [0.0, 10.0, 12.0]}
    found = fitted(FULL, K * FULL, "design", desired={"design": curve})
    table = found.curves.filter(pl.col("branch") == "loading")
    wanted = dict(zip(table["angle_deg"], table["desired_torque"], strict=True))
    assert (wanted[2.5], wanted[8.0], wanted[8.5]) == (5.0, 12.0, None)


def of_cycles(theta, torque, **stated):
    settings = {"zero": "none", "calibration": stated}
    return fitted(theta, torque, **settings).table.row(0, named=True)


def test_an_error_of_the_gain_is_in_the_estimates_of_quasi_static_cycles():
    plain = of_cycles(CYCLED, OF_CYCLES)

    stated = of_cycles(CYCLED, OF_CYCLES, torque_gain=0.01)

    for name in ("K", "K_unloading", "energy_stored", "energy_lost"):
        half, before = (row[f"{name}_high"] - row[name] for row in (stated, plain))
        assert half == pytest.approx(np.hypot(before, 1.96 * 0.01 * plain[name]), rel=0.01)


def test_an_error_of_the_frame_s_stiffness_is_one_of_its_compliance():
    """100/2000^2 rad/(N*m), by which K of a spring behind it is off by K^2 times as much."""
    frame = {"value": "2000 N*m/rad", "standard_error": "100 N*m/rad"}

    row = row_of(CYCLED, OF_CYCLES, zero="none", bench_stiffness=frame)

    assert row["K_high"] - row["K"] == pytest.approx(1.96 * row["K"] ** 2 * 2.5e-5, rel=0.02)


@pytest.mark.parametrize(
    ("stated", "lost"),
    [
        ({"hysteresis": 0.02}, 0.02 / np.sqrt(12) * np.ptp(OF_CYCLES) * 4 * A),
        ({"delay": 1e-3}, 1e-3 * 200 * np.pi * A**2 * W),  # K times the delay is a damping
    ],
)
def test_what_takes_part_in_a_loop_is_in_the_energy_that_it_loses(stated, lost):
    row = of_cycles(CYCLED, OF_CYCLES, **stated)
    plain = of_cycles(CYCLED, OF_CYCLES)
    half, before = (each["energy_lost_high"] - each["energy_lost"] for each in (row, plain))
    assert half == pytest.approx(np.hypot(before, 1.96 * lost), rel=0.05)
