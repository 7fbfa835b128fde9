# SPDX-License-Identifier: Apache-2.0
"""Belt stiffness: recovery, refusals, intervals, and what a straight line lacks."""

import numpy as np
import polars as pl
import pytest
from bench_synthetic import RATE, belt_cycle, belt_record, stepped_sine
from conftest import least_squares_alone, refused_with, white_noise

from osl_analysis.base.trial import Trial
from osl_analysis.bench import belt as belt_fits
from osl_analysis.bench.bench_settings import BeltAnalysis
from osl_analysis.bench.impedance import fit_all_groups
from osl_analysis.bench.parts_alone import transmission_table
from osl_analysis.bench.regression import TRANSMISSION
from osl_analysis.figures.fig3 import points as belt_points
from osl_analysis.signals.filters import LowPass


def fitted(theta_s, torque):
    return belt_fits.fit_branches(belt_record(theta_s, torque))


@pytest.mark.parametrize("sign", [-1, 1])
def test_the_stiffness_of_a_belt_is_found_in_both_directions_beside_gaps(sign):
    theta_s, torque = belt_cycle(685.6)
    torque[700:760] += 40.0
    record = belt_record(sign * theta_s, sign * torque, unusable=range(690, 770))
    belt = belt_fits.fit_branches(record)
    assert belt.whole["K_s"] == pytest.approx(685.6, rel=1e-8)
    rows = np.flatnonzero(belt.record.is_fitted("loading"))
    assert (rows.min(), rows.max(), len(rows)) == (416, 1699, 1699 - 416 + 1 - 80)
    straight = belt_fits.fit_branches(record, model=belt_fits.STRAIGHT)
    assert straight.model == belt_fits.STRAIGHT != belt.model


@pytest.mark.parametrize(
    ("size", "rows", "unusable", "message"),
    [
        (0.01, 3400, (), r"0\.050 deg.*0\.5 deg"),
        (1.0, 2000, (), r"0\.00 deg.*5\.00 deg.*4\.53 deg"),
        (1.0, 3400, range(1690, 3400), "unloading.*gaps.*highest_hz"),
    ],
)
def test_refuses_a_belt_that_hardly_moved_ends_loaded_or_has_gaps_all_along(
    size, rows, unusable, message
):
    theta_s, torque = belt_cycle()
    with refused_with(message):
        belt_record(size * theta_s[:rows], torque[:rows], unusable=unusable)


@pytest.mark.parametrize(
    ("share", "model"),
    [
        (0.03, belt_fits.STRAIGHT),
        (0.08, belt_fits.STRAIGHT_AND_DAMPED),
    ],
)
def test_a_belt_has_damping_where_its_velocity_varies(share, model):
    """By this share of its mean; at an even velocity, damping is an offset."""
    turns = np.linspace(0, 1, 1500)
    way = 0.08 * turns + share * 0.08 * np.sqrt(2) / (6 * np.pi) * np.sin(6 * np.pi * turns)
    theta_s = np.concatenate([way, way[::-1]])

    assert fitted(theta_s, 500 * theta_s).model == model


def test_errors_of_a_belt_s_stiffness_are_as_large_as_they_say():
    """A joint that is turned by 5 deg in 3.5 s and back at an even velocity: errors over standard
    errors of 50 trials of K_s 685.6 and 0.05 N*m of noise, behind the fit's filter."""
    low_pass = LowPass(15)
    time = np.arange(5000) / RATE
    theta = 0.0873 * np.interp(time, (1.5, 5, 8.5), (0, 1, 0))
    theta_s = low_pass(theta, RATE)
    noise = 0.05 * white_noise((50, len(time)), 4)

    errors = []
    for of_trial in noise:
        torque = low_pass(685.6 * theta + 0.3 + of_trial, RATE)
        belt = fitted(theta_s, torque).whole
        errors.append((belt["K_s"] - 685.6) / belt.se("K_s"))

    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1, abs=0.29)
    assert abs(np.mean(errors)) < 0.4


def test_a_locked_belt_on_a_bench_that_yields_has_its_stiffness_and_error():
    theta_s, torque = belt_cycle(300.0)
    angle = theta_s + torque / 12000
    time = np.arange(len(theta_s)) / RATE
    frame = {"value": "12000 N*m/rad", "standard_error": "600 N*m/rad"}

    def found(turned):
        samples = pl.DataFrame(
            {"time": time, "theta": angle, "theta_m": turned * angle, "torque": torque}
        )
        belt = belt_fits.belt_trial(
            Trial("b", samples), None, BeltAnalysis(cutoff_hz=15, order=4, bench_stiffness=frame)
        )
        return belt.calibrated["loading"]

    assert (found(0.009)["K_s"], found(0.0).se("K_s")) == pytest.approx(
        (300, 300**2 * 600 / 12000**2), rel=2e-3
    )
    with refused_with(r"b: theta_m.*0\.000984 rad.*theta.*0\.0873 rad"):
        found(0.011)


def test_belt_intervals_hold_what_a_drift_per_minute_makes_of_the_slope():
    theta_s, torque = belt_cycle()
    noise = 0.05 * white_noise(len(theta_s) + 1000, 19)
    torque = torque + LowPass(15)(noise, 1000.0)[500:-500]  # without its edges
    time = np.arange(len(theta_s)) / RATE

    def fits_of(torque, drift_per_minute=0.0):
        samples = {"time": time, "theta": theta_s, "theta_m": 0 * theta_s, "torque": torque}
        settings = BeltAnalysis(cutoff_hz=15, order=4, load_cell_drift=drift_per_minute)
        return belt_fits.belt_trial(Trial("b", pl.DataFrame(samples)), None, settings).fits

    alone = fits_of(torque)
    known = fits_of(torque, 3.0)
    drifted = fits_of(torque + 0.05 * time)
    for name in ("loading", "unloading"):
        change = drifted[name]["K_s"] - alone[name]["K_s"]
        expected = np.hypot(alone[name].se("K_s"), change)
        assert known[name].se("K_s") == pytest.approx(expected, rel=1e-3)


def test_a_belt_tells_what_a_straight_line_leaves_out():
    """Energy lost to friction of 0.5 N*m over the elastic one; slope of 876 theta + 14913 theta
    |theta| at the peak."""
    belts = [fitted(*belt) for belt in (belt_cycle(685, coulomb=0.5), belt_cycle(876, K_s2=14913))]
    rubbing, stiffening = (belt_fits.belt_table(belt)["belt"].row(0, named=True) for belt in belts)
    assert rubbing["unloading"] == pytest.approx(685, rel=1e-3)
    assert belts[1].whole.vaf == stiffening["VAF"] < 99.99
    assert rubbing["energy_lost"] == pytest.approx(2 * 0.5 / (685 * 0.0873 / 2), rel=1e-3)
    assert rubbing["hysteresis_area"] == pytest.approx(2 * 0.5 * 0.0873, rel=1e-3)
    assert stiffening["stiffening"] == pytest.approx(2 * 14913 * 0.0873 / 876, rel=1e-6)
    (half,) = belt_fits.belt_table(belts[1])["budget"].filter(part="motion")["standard"]
    assert half == pytest.approx(14913 * 0.0873, rel=1e-6)


def test_where_loading_begins_moves_a_bent_belt_as_its_budget_says():
    """A line through K x + c x^2 between a and b has the slope K + c (a + b)."""
    ramp = np.clip(np.linspace(-0.5, 10.5, 5501), 0, 10)
    theta = 0.1 * np.minimum(ramp, 10 - ramp)
    samples = {"time": np.arange(5501) / RATE, "theta": theta, "theta_m": 0.0}
    bent = pl.DataFrame(samples | {"torque": 600 * theta + 100 * theta**2})

    belt = belt_fits.belt_trial(Trial("b", bent), None, BeltAnalysis(cutoff_hz=15, order=4))

    (begins,) = belt.whole.budget("K_s").from_source("loading_begins")
    moved = 100 * 0.5 * (2 - 1 / 2) * belt_fits.LOADED_SHARE
    assert begins.standard == pytest.approx(moved / 2, rel=0.1)


def test_cycles_of_a_belt_count_alike_and_its_loop_is_that_of_one():
    theta_s, torque = belt_cycle(685, coulomb=0.5)
    once = belt_fits.belt_table(fitted(theta_s, torque))["belt"].row(0, named=True)

    belt = fitted(np.tile(theta_s, 3), np.tile(torque, 3))
    thrice = belt_fits.belt_table(belt)["belt"].row(0, named=True)

    assert belt.record.groups.of("loading").sum() == 3 * (
        fitted(theta_s, torque).record.groups.of("loading").sum()
    )
    for name in ("K_s", "unloading", "hysteresis_area", "energy_lost"):
        assert thrice[name] == pytest.approx(once[name], rel=1e-3)


def test_the_figure_of_belts_has_what_torque_differs_by_from_the_mean_slope():
    """A belt of 720/pi N*m/rad, 4 N*m per degree, that carries 0.5 N*m more while loading, bent the
    other way."""
    deflection = np.array([0.0, -1.0, -2.0, -1.0])
    torque = 4 * deflection + [0.5, 0.5, 0.5, 0.0]
    of_curve = {"trial": "b", "branch": "loading"}
    curves = pl.DataFrame({**of_curve, "theta_s_deg": deflection, "torque": torque})
    place = {"joint": "ankle", "side": pl.Series([None, None], dtype=pl.String)}
    table = pl.DataFrame({"trial": "b", "doubtful": None, "K_s": 1.0, **place})[:1]
    means = {"mean": [720 / np.pi, 0.5], "low": [200.0, 0.4], "high": [260.0, 0.7]}
    summary = pl.DataFrame({"quantity": ["K_s", "hysteresis_area"], **means, **place})

    points = belt_points(curves, table, summary)

    deviation = points["torque"] - points["mean_slope"]
    np.testing.assert_allclose(deviation, [0.5, 0.5, 0.5, 0.0], atol=1e-12)
    assert set(points.select("K_s_low", "K_s_high").rows()) == {(200, 260)}


def losses(torque_of):
    """The last row of the transmission table of a torque, and the rows of its budget."""
    tables = transmission_table(fit_all_groups(stepped_sine(torque_of), TRANSMISSION))
    return tables["transmission"].row(-1, named=True), tables["budget"]


def test_a_late_torque_of_a_transmission_hides_inertia_and_is_found():
    delay_s = 2e-3

    def torque(m):  # to first order of the delay
        jerk = np.gradient(m.alpha, 1 / RATE)
        return 0.45 * (m.omega - delay_s * m.alpha) + 0.005 * (m.alpha - delay_s * jerk)

    record = stepped_sine(torque, 0.01)
    tables = transmission_table(fit_all_groups(record, TRANSMISSION))
    row = tables["transmission"].row(-1, named=True)

    late = tables["budget"].filter(estimate="J_j", source="torque_path", detail="delay")
    assert late["standard"].max() == pytest.approx(0.45 * delay_s, rel=0.2)
    assert row["J_j"] == pytest.approx(0.005 - 0.45 * delay_s, rel=0.02)


@least_squares_alone
def test_transmission_tells_how_much_of_its_damping_is_coulomb_friction():
    smooth, _ = losses(lambda m: 0.45 * m.omega + 0.005 * m.alpha - 3.0)
    row, budget = losses(lambda m: 0.3 * m.omega + 0.005 * m.alpha + 0.15 * np.tanh(m.omega / 0.01))
    (half,) = budget.filter(estimate="B_j", part="motion")["standard"]
    assert 2 * half == pytest.approx(row["B_j"] - row["B_j_viscous"])
    assert (smooth["B_j"], smooth["J_j"]) == pytest.approx((0.45, 0.005), rel=1e-4)
    assert smooth["B_j_viscous"] == pytest.approx(0.45, rel=1e-4)
    assert row["B_j_viscous"] == pytest.approx(0.3, abs=0.03)
    assert row["T_C"] == pytest.approx(0.15, rel=0.02)
    assert row["B_j_viscous_low"] < 0.3 < row["B_j_viscous_high"] < row["B_j"]


@least_squares_alone
def test_a_weight_and_a_delay_change_the_inertia_as_its_budget_says():
    """Without the weight it is that of the torque; exp(-s d) (B s + J s^2) has B d less."""
    row, budget = losses(lambda m: 0.45 * m.omega + 0.005 * m.alpha + 0.2 * m.theta)

    own = budget.filter(estimate="J_j")
    (half,) = own.filter(part="motion")["standard"]
    assert 2 * half == pytest.approx(abs(row["J_j"] - 0.005), rel=1e-3)
    assert own.filter(source="late_torque")["per"].item() == "0.00045 kg*m^2 per ms"
