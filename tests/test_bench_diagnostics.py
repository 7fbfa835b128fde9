"""What makes a bench fit doubtful, by its right name: a late torque, friction, a spring that stiffens, play."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from any_motion import multisine
from bench_synthetic import FIVE, record_of_sines, second_order, stepped_sine, table_of, true_motion
from conftest import ROOT, beyond_in, findings_of, marked
from scipy.interpolate import CubicSpline

from osl_analysis.bench.analysis import fitted_motion, with_friction, without_friction
from osl_analysis.bench.effects import (
    IMPEDANCE,
    belt_of_leg,
    causes,
    is_alike,
    plain_sums,
    sums_of,
    with_effects,
    yielding_in,
)
from osl_analysis.bench.impedance import DesiredImpedance, judged_impedance
from osl_analysis.bench.plausible import plausible_impedance
from osl_analysis.bench.record import record_of_trial, with_actuator
from osl_analysis.bench.settings import DynamometerAnalysis
from osl_analysis.campaign.configuration import read_section
from osl_analysis.ingest.examine import saturated
from osl_analysis.judge.limits import DoubtfulFits, Limits
from osl_analysis.judge.unchecked import LATENESS
from osl_analysis.model.parameters import read_parameters
from osl_analysis.protocol.stepped_sine import SteppedSineProtocol
from osl_analysis.trial import Trial

ENDS = ("", "_low", "_high")
P = read_parameters(ROOT / "config/parameters/default.yaml")
LIMITS = read_section(ROOT / "config/config.yaml", "doubtful", DoubtfulFits).of("impedance")
UNKNOWN, SETTINGS = (
    DesiredImpedance(None, None, None),
    read_section(ROOT / "config/config.yaml", "dynamometer", DynamometerAnalysis),
)


def rows(torque_of, noise=0.03, protocol=FIVE, seed=1):
    """Rows of a joint, judged by what they tell without gains and belt."""
    table = table_of(stepped_sine(torque_of, noise, protocol, seed))
    limits = {end: {k: v for k, v in getattr(LIMITS, end).items() if k in table.columns} for end in ("above", "below")}
    return marked(table, LIMITS.model_copy(update=limits), "phasors").to_dicts()


def test_a_sound_joint_is_not_doubtful_and_shows_no_cause():
    *_, whole = both = rows(second_order)
    assert [row["doubtful"] for row in both] == [""] * 3
    assert whole["K_change"] == whole["B_change"] == whole["K_drift"] == 0  # noise is no change
    assert abs(whole["coulomb_torque"]) < 0.02
    assert abs(whole["stiffening"]) < 5e-3
    assert whole["backlash_share"] < 2e-3


@pytest.mark.parametrize("cycles", [8, 12])
@pytest.mark.parametrize(("fall", "noise"), [(0.01, 0.002), (-0.02, 0.002), (0.02, 0.05)])
def test_a_stiffness_that_changes_while_it_is_recorded_is_named_and_has_its_size(fall, noise, cycles):
    """It makes I wrong by four times as much, forty standard errors, and nothing else of the fit shows it. With more
    noise it changes by less within a segment; from one frequency to the next it looks like inertia."""
    protocol = SteppedSineProtocol((np.deg2rad(4.0),), (1.0, 2.0, 3.0, 4.0, 5.0), cycles)

    def torque(m):
        return second_order(m) - fall * 200 * np.linspace(0, 1, len(m.theta)) * m.theta

    record = stepped_sine(torque, noise, protocol)
    fitted = (record.groups.stop.max() - record.groups.first.min()) / len(record.time)
    for seed in (1, 2):
        *_, whole = rows(torque, noise, protocol, seed)
        assert whole["K_drift"] * whole["K"] == pytest.approx(-fall * 200 * fitted, rel=0.1 if noise < 0.05 else 0.4)
        made = (whole["I"] - 0.05) / np.hypot(whole["I"], 0.005)
        assert whole["drift_inertia_share"] == pytest.approx(abs(made), rel=0.15)
        assert whole["doubtful"] == "stiffness that changes"
        *_, sound = rows(second_order, noise, protocol, seed)
        assert sound["K_drift"] == sound["drift_inertia_share"] == 0


@pytest.mark.parametrize(("first", "second"), [(0.02, 0.02), (0.02, 0.03), (0.02, -0.02)])
def test_amplitudes_agree_on_a_change_of_the_stiffness_if_it_is_one_and_not_if_each_has_its_own(first, second):
    """By the share of K in the whole recording."""

    def torque(m):
        is_first = np.arange(len(m.theta)) < np.argmax(abs(m.theta) > 0.06)
        share = np.where(is_first, first, second) * np.linspace(0, 1, len(m.theta))
        return second_order(m) + 200 * share * m.theta

    record = stepped_sine(torque, 0.002, FIVE)
    s = sums_of(record, IMPEDANCE)
    assert is_alike(s, IMPEDANCE, "K_change", causes(record, s, IMPEDANCE)) == (first == second)


@pytest.mark.parametrize(("noise", "drift"), [(0.002, 0.0), (2.0, None)])
def test_a_stiffness_that_eq_15_misses_at_some_frequencies_is_no_change_over_time(noise, drift):
    """Frequencies follow one another: K of the joint seems to change over time, too. Noisy cycles cannot deny it."""
    protocol = SteppedSineProtocol((0.1,), (1.0, 2.0, 3.0, 4.0, 5.0), 8)
    *_, whole = rows(lambda m: second_order(m) + 0.03 * m.alpha * np.abs(m.alpha) / 100, noise, protocol)
    assert whole["K_drift"] == whole["drift_inertia_share"] == drift


def test_coulomb_friction_is_named_and_has_its_size():
    *single, whole = rows(lambda m: second_order(m) + 0.8 * np.sign(m.omega))
    for row in (*single, whole):
        assert row["coulomb_torque"] == pytest.approx(0.8, rel=0.05)
        assert row["coulomb_damping"] == pytest.approx(row["B"] - 4, rel=0.1)
        assert (row["f_C"], row["B_viscous"]) == (row["coulomb_torque"], pytest.approx(4, abs=0.05))
    assert whole["B_viscous_low"] < 4 < whole["B_viscous_high"]
    assert whole["f_C_low"] < 0.8 < whole["f_C_high"]
    assert whole["K_without_friction_low"] < 200 < whole["K_without_friction_high"]
    assert whole["I_without_friction_low"] < 0.05 < whole["I_without_friction_high"]
    (finding,) = findings_of(whole, Limits(above={"coulomb_share": 0.01}), "impedance")[:1]
    assert (finding.cause, [*finding.without]) == ("friction", [f"{x}{end}" for x in "KBI" for end in ENDS])
    assert finding.without["B_high"] == whole["B_viscous_high"]
    s = sums_of(stepped_sine(lambda m: second_order(m) + 0.8 * np.sign(m.omega), 0.03, FIVE), IMPEDANCE)
    smooth, sharp = (
        without_friction(
            *(with_effects(s, IMPEDANCE, x) for x in ((), (T,))), with_friction(s, IMPEDANCE, None, T), ["B"], T
        )
        for T in ("T_C", "T_C_sharp")
    )
    width = (sharp.estimates - smooth.estimates) / np.sqrt(3)  # of a rectangle of that half-width
    expected = [np.hypot(smooth.se(smooth.names[k]), width[k]) for k in range(2)]
    assert [whole["B_viscous_se"], whole["f_C_se"]] == pytest.approx(expected, rel=1e-3)
    assert whole["B_change"] < -0.03
    assert whole["stiffening"] == whole["backlash_share"] == 0
    assert whole["doubtful"] == ""


@pytest.mark.parametrize("cubic", [4e3, -4e3])
def test_a_spring_that_stiffens_or_softens_is_named_and_not_called_friction(cubic):
    *_, whole = rows(lambda m: second_order(m) + cubic * m.theta**3)
    assert whole["stiffening"] == pytest.approx(cubic * 0.1**2 / whole["K"], rel=0.1)
    assert abs(whole["coulomb_torque"]) < 0.03
    assert whole["backlash_share"] < 5e-3
    assert whole["K_change"] == pytest.approx(0.75 * cubic * (0.1**2 - 0.05**2) / whole["K"], rel=0.05)
    assert whole["doubtful"] == "spring that is not linear"


def test_a_gap_is_named_and_has_its_width():
    """Where the torque changes its sign, the joint has turned by the gap before it resists again."""
    half = 200 * np.deg2rad(0.15) / 2

    def with_gap(m):
        torque = second_order(m)
        return torque - half * np.sign(torque) * np.minimum(np.abs(torque) / half, 1)

    *_, whole = rows(with_gap)
    assert whole["backlash_deg"] == pytest.approx(0.15, rel=0.2)
    assert whole["backlash_share"] == pytest.approx(1 - whole["K"] / 200, rel=0.25)
    assert whole["doubtful"] == "backlash"
    assert abs(whole["coulomb_torque"]) < 0.05


def test_harmonics_of_the_bench_s_own_motion_are_no_friction():
    """An angle with a third harmonic of 2 % makes a third harmonic of the torque in the most linear joint."""
    pure = stepped_sine(second_order)
    theta = pure.theta - 4 * 0.02 * pure.theta**3 / np.maximum(np.max(np.abs(pure.theta)) ** 2, 1e-9)
    *_, whole = table_of(record_of_sines(pure.time, theta, second_order(true_motion(pure.time, theta)))).to_dicts()
    assert whole["odd_harmonics"] < 2e-3
    assert abs(whole["coulomb_torque"]) < 0.02


def test_an_asymmetric_joint_has_even_harmonics_and_chatter_at_any_phase_has_none():
    *_, asymmetric = rows(lambda m: second_order(m) + 60 * np.abs(m.theta))
    assert asymmetric["even_harmonics"] > 0.05
    assert "asymmetric torque" in asymmetric["doubtful"].split("; ")


EITHER = "late torque or yielding bench"


@pytest.mark.parametrize(("k", "ratio", "cause"), [
    *((k, 1 / (1 + 300 / k), "yielding bench") for k in (686.0, 2e3, 6e3)), (1e4, 1.0, "late torque"),
    *((2e3, ratio, EITHER) for ratio in (None, 1.2, 0.8)),  # no gains, or friction
])  # fmt: skip
def test_a_lag_is_that_of_a_yielding_frame_where_k_is_as_much_too_low_for_the_gains(k, ratio, cause):
    row = {"frame_stiffness": k, "K": 300.0 * (ratio or 1.0), "K_ratio": ratio}
    for lag in ({}, {"lag_s": 2e-3}, {"lag_s": -2e-3}):
        limits = Limits(above={"lag_share": 0.05, "lag_inertia_share": 0.02})
        (finding,) = findings_of(row | {"lag_share": 0.1, "lag_inertia_share": 0.9} | lag, limits, "calibration")
        assert (finding.cause, beyond_in([finding])) == (cause, dict.fromkeys(limits.above, "above"))


def third_order(impedance):
    """Coefficients to the third power of s of an impedance, by Cauchy's integral on a circle of 2 rad/s."""
    s = 2 * np.exp(2j * np.pi * np.arange(64) / 64)
    return dict(zip("KBIJ", (np.fft.fft(impedance(s)).real / 64 / 2.0 ** np.arange(64))[:4], strict=True))


def test_a_spring_in_series_is_found_from_the_jerk_in_any_motion_and_none_where_the_torque_comes_early():
    for k in (686.0, 3000.0):
        found = yielding_in(third_order(lambda s, k=k: 1 / (1 / (300 + 5 * s + 0.02 * s**2) + 1 / k)))
        assert found == pytest.approx(k, 1e-6)
    assert yielding_in(third_order(lambda s: (300 + 5 * s + 0.02 * s**2) * np.exp(1e-3 * s))) is None


def test_a_change_of_a_small_damping_is_a_share_of_two_newton_metres_per_rad_per_second_too():
    """B is 0.8 at the small amplitude and 0.4 at the large one, in the second half."""
    *_, whole = rows(
        lambda m: second_order(m) - np.where(np.arange(len(m.theta)) < len(m.theta) / 2, 3.2, 3.6) * m.omega, 1e-6
    )
    assert whole["B_change"] == pytest.approx(-0.4 / np.hypot(whole["B"], 2), rel=0.02)
    assert whole["K_change"] == pytest.approx(0, abs=1e-4)


def test_k_over_what_the_gains_should_give_is_that_of_the_largest_amplitude_in_every_row():
    amplitudes = pl.DataFrame({"amplitude_deg": [6.0, 2.0, 4.0, None], "K": [200.0, 240.0, 220.0, 210.0]})
    rows = amplitudes.with_columns(K_high=pl.col("K"), trial=pl.lit("made"))
    assert plausible_impedance(rows, pl.lit(0).alias("saturated_samples"), P, 200.0)["K_ratio"].to_list() == [1.0] * 4


def leg(torque_late=0.0, theta_m_late=0.0, theta_late=0.0, B_j=P.B_j):
    """A drivetrain's trial from Eqs. 3-4 and a belt with hysteresis; the actuator moves as no second-order joint."""
    rng = np.random.default_rng(8)
    time, (theta, omega, alpha) = multisine(rng, rate=500.0)
    wound = 0.45 * theta + 6e-3 * omega + 4e-3 * np.tanh(omega / 0.05)
    slips = np.zeros_like(wound)
    for k, step in enumerate(np.diff(wound), 1):
        slips[k] = np.clip(slips[k - 1] + step / 1e-3, -1, 1)
    torque = P.J_j * alpha + B_j * omega + P.K_s * wound + 0.5 * slips + 0.03 * rng.standard_normal(len(time))
    late = {"theta": theta_late, "theta_m": theta_m_late, "torque": torque_late}
    signals = {"theta": theta, "theta_m": P.n_T * (theta - wound), "torque": torque}
    columns = {name: CubicSpline(time, signals[name])(time - late[name]) for name in signals}
    for name in ("theta", "theta_m"):
        columns[name] = np.round(columns[name] * 2**14 / (2 * np.pi)) * (2 * np.pi / 2**14)
    return Trial("leg", pl.DataFrame({"time": time, **columns}))


@pytest.mark.parametrize(
    ("fault", "lag", "of_theta_m"),
    [({}, 0, 0), ({"torque_late": 1e-3}, 1e-3, 0), ({"torque_late": -4e-3}, -4e-3, 0), ({"B_j": 1.1 * P.B_j}, 0, 0),
     ({"theta_m_late": 1e-3}, 0, 1e-3), ({"theta_late": 1e-3}, -1e-3, -1e-3)],
)  # fmt: skip
def test_the_belt_shows_which_channel_of_a_leg_is_late(fault, lag, of_theta_m):
    """Eq. 15 misses so much of a leg that it passes for a delay of 10 ms; a belt stays a spring."""
    trial = leg(**fault)
    record = with_actuator(record_of_trial(trial, SETTINGS), trial)
    row = judged_impedance(record, saturated(trial, "torque", "theta"), P, UNKNOWN)[1].row(0, named=True)
    in_time = record_of_trial(leg(**fault | dict.fromkeys(("torque_late", "theta_late"), 0.0)), SETTINGS)
    sound = fitted_motion(in_time, plain_sums(in_time, IMPEDANCE), IMPEDANCE).whole
    for name in "KBI":
        told = [row[f"{name}_without_lag{end}"] for end in ENDS]
        assert (told == [None] * 3) if not lag else (told[1] < sound[name] < told[2]), name
    assert (row["lag_by"], row["lag_s"]) == ("theta_m", pytest.approx(lag, abs=1.5e-4))
    assert row["certain_theta_m_lag_s"] == pytest.approx(of_theta_m, abs=1.5e-4 if of_theta_m else 0)
    assert row["lag_share"] == pytest.approx(abs(row["K"] * row["lag_s"] / row["B"]) if lag else 0)
    causes = [finding.cause for finding in findings_of(row, LIMITS, "impedance")]
    assert ("late torque" in causes) == bool(lag)
    assert ("whether theta_m or B_j is wrong" in causes) == bool(of_theta_m)
    assert LATENESS not in causes
    assert belt_of_leg(record, None) is None


def test_a_theta_m_that_shows_no_belt_says_nothing_of_lags():
    trial = leg(torque_late=1e-3)
    idle = replace(trial, samples=trial.samples.with_columns(theta_m=0.3 + 1e-3 * pl.col("theta_m")))
    assert belt_of_leg(with_actuator(record_of_trial(idle, SETTINGS), idle), P) is None
    turned = replace(trial, samples=trial.samples.with_columns(theta_m=-pl.col("theta_m")))
    belt = belt_of_leg(with_actuator(record_of_trial(turned, SETTINGS), turned), P)
    assert (belt.torque, belt.K_s / P.K_s < 0.7) == (None, True)
