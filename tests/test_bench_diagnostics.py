"""What makes a bench fit doubtful, by its right name: a late torque, friction, a spring that stiffens, play."""

import re

import numpy as np
import polars as pl
import pytest
from bench_synthetic import PROTOCOL, RATE, second_order, stepped_sine
from conftest import ROOT

from osl_analysis.bench.diagnostics import over_amplitudes
from osl_analysis.bench.impedance import impedance_table, trial_phasors
from osl_analysis.bench.lag import ImpedancePoints, torque_lag, yielding_in
from osl_analysis.bench.rendered import rendered_table
from osl_analysis.bench.segments import find_blocks
from osl_analysis.bench.stepped_sine import SteppedSineTrial
from osl_analysis.config import read_section
from osl_analysis.judge.doubts import marked
from osl_analysis.judge.impossible import Saturated, plausible_impedance
from osl_analysis.judge.table import Doubt, DoubtfulFits
from osl_analysis.model.compensator import PAPER_WEIGHT, select_gains
from osl_analysis.model.drivetrain import joint_admittance
from osl_analysis.parameters import read_parameters
from osl_analysis.protocol.runs import SteppedSineProtocol
from osl_analysis.signals import LowPass, filtered_motion

P = read_parameters(ROOT / "config/parameters/default.yaml")
LIMITS = read_section(ROOT / "config/config.yaml", "doubtful", DoubtfulFits).of("impedance")
FREQUENCY, THETA = np.tile([1.0, 2, 3, 4, 5], 3), np.repeat([0.035, 0.07, 0.105], 5)
S = 2j * np.pi * FREQUENCY
SECOND_ORDER, FRICTION = 300 + 5 * S + 0.02 * S**2, 4j * 0.5 / (np.pi * THETA)


def drivetrain(K_d=300.0, B_d=5.0):
    gains = select_gains("compensated", K_d, B_d, P, PAPER_WEIGHT)
    return joint_admittance(gains.K_1, gains.B_1, P, P.J_j)


def measured_lag(impedance):
    noise = np.random.default_rng(2).standard_normal((2, 15)) * 1e-3 / THETA
    return torque_lag(
        ImpedancePoints(FREQUENCY, THETA, THETA, impedance + noise[0] + 1j * noise[1]), 1 / drivetrain()(S)
    )


@pytest.mark.parametrize("lag", [2e-3, -1e-3, 5e-3])
@pytest.mark.parametrize("joint", [SECOND_ORDER, 1 / drivetrain()(S)])
def test_a_lag_is_found_in_a_second_order_joint_and_in_a_drivetrain(joint, lag):
    found = measured_lag((joint + FRICTION) * np.exp(-S * lag))
    assert found.lag == pytest.approx(lag, abs=1.5e-4)
    assert abs(found.lag) > 10 * found.se


@pytest.mark.parametrize(
    "joint",
    [
        SECOND_ORDER,
        SECOND_ORDER + 8 * FRICTION,
        4.45 * SECOND_ORDER,
        SECOND_ORDER + 1e3 * THETA**2,
        1 / drivetrain()(S),
        1.3 / drivetrain()(S),
    ],
    ids=["second order", "friction", "scale", "stiffening", "drivetrain", "drivetrain, scale"],
)
def test_friction_a_spring_that_stiffens_and_a_wrong_scale_are_no_lag(joint):
    found = measured_lag(joint)
    assert abs(found.lag) < 10 * found.se


def test_beside_noise_alone_a_lag_of_five_standard_errors_is_certain():
    """With B = 1, 0.3 ms are a tenth of B, and seven standard errors of a trial of 142 s."""
    noise = float(np.sqrt(np.mean(1e-6 / FREQUENCY)))  # of `measured_lag`, weighed by theta/sqrt(f)
    assert measured_lag(SECOND_ORDER * np.exp(-S * 3e-4)).certain_from(noise) == 5
    odd = measured_lag(SECOND_ORDER + 2 * np.exp(1j * FREQUENCY * 2))
    assert odd.certain_from(noise) == 10


@pytest.mark.parametrize("lag", [5e-3, -5e-3])
@pytest.mark.parametrize("seed", range(4))
def test_a_lag_of_one_amplitude_has_its_sign_although_another_of_the_other_sign_explains_nearly_as_much(lag, seed):
    """Gauss and Newton's steps from 0 end at -4.7 ms, which leaves three times the noise."""
    one = slice(5, 10)
    joint = SECOND_ORDER[one] * np.exp(-S[one] * lag)
    noise = np.random.default_rng(seed).standard_normal((2, 5)) * 8e-4 / THETA[one]
    points = ImpedancePoints(FREQUENCY[one], THETA[one], THETA[one], joint + noise[0] + 1j * noise[1])
    assert torque_lag(points, 1 / drivetrain()(S[one])).lag == pytest.approx(lag, abs=4e-4)


def test_where_neither_model_of_the_joint_fits_their_difference_makes_the_lag_uncertain():
    odd = SECOND_ORDER + 20 * np.exp(1j * FREQUENCY * 2)
    assert measured_lag(odd).se > 1e-3


def rows(torque_of, noise=0.03, protocol=PROTOCOL, seed=1):
    record = stepped_sine(torque_of, noise, protocol, seed)
    return marked(rendered_table(record, None), LIMITS_WITHOUT_PLAUSIBILITY, "impedance").to_dicts()


LIMITS_WITHOUT_PLAUSIBILITY = LIMITS.model_copy(
    update={
        "above": {k: v for k, v in LIMITS.above.items() if k not in ("K_over_K_s", "K_ratio", "saturated_samples")},
        "below": {k: v for k, v in LIMITS.below.items() if k not in ("K_over_K_s", "K_ratio")},
    }
)


def test_a_sound_joint_is_not_doubtful_and_shows_no_cause():
    *_, whole = rows(second_order)
    assert [row["doubtful"] for row in rows(second_order)] == [""] * 3
    assert whole["K_change"] == pytest.approx(0, abs=1e-3)
    assert whole["K_drift"] == 0
    assert abs(whole["coulomb_torque"]) < 0.02
    assert abs(whole["stiffening"]) < 5e-3
    assert whole["backlash_share"] < 2e-3


@pytest.mark.parametrize("fall", [0.01, -0.02])
def test_a_stiffness_that_changes_while_it_is_recorded_is_named_and_has_its_size(fall):
    """It makes I wrong by four times as much, forty standard errors, and nothing else of the fit shows it."""

    def torque(m):
        return second_order(m) - fall * 200 * np.linspace(0, 1, len(m.theta)) * m.theta

    *_, whole = rows(torque, 0.002)
    record = stepped_sine(torque, 0.002)
    first, *_, last = record.segments(None)
    middles = np.mean(first.edges[:2]), np.mean(last.edges[-2:])
    assert whole["K_drift"] * whole["K"] == pytest.approx(-fall * 200 * np.diff(middles)[0] / len(record.time), rel=0.1)
    assert "K_drift" in whole["doubtful"]
    assert "warming up" in whole["doubtful"]


@pytest.mark.parametrize("cycles", [8, 12])
def test_a_stiffness_that_changes_is_named_after_few_cycles_by_what_it_makes_of_the_inertia(cycles):
    """Within a segment it changes by less than the noise; from one frequency to the next it looks like inertia."""
    protocol = SteppedSineProtocol((np.deg2rad(4.0),), (1.0, 2.0, 3.0, 4.0, 5.0), cycles)

    def torque(m):
        return second_order(m) - 0.02 * 200 * np.linspace(0, 1, len(m.theta)) * m.theta

    for noise, seed in ((0.05, 1), (0.05, 2)):
        *_, whole = rows(torque, noise, protocol, seed)
        assert whole["K_drift"] == pytest.approx(-0.02, rel=0.4)
        assert whole["drift_inertia_share"] == pytest.approx(whole["I"] / 0.05 - 1, rel=0.15)
        assert "makes this share of I" in whole["doubtful"]
        *_, sound = rows(second_order, noise, protocol, seed)
        assert sound["K_drift"] == sound["drift_inertia_share"] == 0


def test_whether_the_stiffness_changes_is_not_known_from_two_cycles_at_each_frequency():
    *_, whole = rows(second_order, 0.05, SteppedSineProtocol((0.1,), (1.0, 3.0, 5.0), 4))
    assert whole["K_drift"] is whole["drift_inertia_share"] is None


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
    assert whole["B_change"] < -0.1
    assert "B falls by" in whole["doubtful"]
    assert "friction" in whole["doubtful"]
    assert whole["stiffening"] == whole["backlash_share"] == 0
    assert "K_change" not in whole["doubtful"]


@pytest.mark.parametrize(
    ("cubic", "words"),
    [(4e3, "K rises by"), (-4e3, "K falls by")],
)
def test_a_spring_that_stiffens_or_softens_is_named_and_not_called_friction(cubic, words):
    *_, whole = rows(lambda m: second_order(m) + cubic * m.theta**3)
    assert whole["stiffening"] == pytest.approx(cubic * 0.1**2 / whole["K"], rel=0.1)
    assert abs(whole["coulomb_torque"]) < 0.03
    assert whole["backlash_share"] < 5e-3
    assert whole["K_change"] == pytest.approx(0.75 * cubic * (0.1**2 - 0.05**2) / whole["K"], rel=0.05)
    assert re.match(f"spring that is not linear: .*{words}", whole["doubtful"])


def test_a_gap_is_named_and_has_its_width():
    """Where the torque changes its sign, the joint has turned by the gap before it resists again."""
    half = 200 * np.deg2rad(0.15) / 2

    def with_gap(m):
        torque = second_order(m)
        return torque - half * np.sign(torque) * np.minimum(np.abs(torque) / half, 1)

    *_, whole = rows(with_gap)
    assert whole["backlash_deg"] == pytest.approx(0.15, rel=0.2)
    assert whole["backlash_share"] == pytest.approx(1 - whole["K"] / 200, rel=0.25)
    assert "backlash" in whole["doubtful"]
    assert abs(whole["coulomb_torque"]) < 0.05


def test_harmonics_of_the_bench_s_own_motion_are_no_friction():
    """An angle with a third harmonic of 2 % makes a third harmonic of the torque in the most linear joint."""
    pure = stepped_sine(second_order)
    theta = pure.theta - 4 * 0.02 * pure.theta**3 / np.maximum(np.max(np.abs(pure.theta)) ** 2, 1e-9)
    motion, _ = filtered_motion(pure.time, theta, theta, LowPass(100))
    torque = second_order(motion)
    filtered = filtered_motion(pure.time, theta, torque, LowPass(15))
    blocks = find_blocks(pure.time, theta, PROTOCOL)
    record = SteppedSineTrial("made", pure.time, RATE, theta, torque, *filtered, blocks, 2, LowPass(15), 0.0)
    *_, whole = impedance_table(record, trial_phasors(record)).to_dicts()
    assert whole["odd_harmonics"] < 2e-3
    assert abs(whole["coulomb_torque"]) < 0.02


def test_an_asymmetric_joint_has_even_harmonics_and_chatter_at_any_phase_has_none():
    *_, asymmetric = rows(lambda m: second_order(m) + 60 * np.abs(m.theta))
    assert asymmetric["even_harmonics"] > 0.05
    assert "even_harmonics" in asymmetric["doubtful"]


@pytest.mark.parametrize("k", [686.0, 2000.0, 3000.0, 6000.0])
def test_a_frame_that_yields_is_found_with_its_stiffness_and_named_where_k_is_too_low_for_the_gains(k):
    found = measured_lag(1 / (1 / SECOND_ORDER + 1 / k))
    assert found.frame_stiffness == pytest.approx(k, rel=0.1)
    assert found.lag > 10 * found.se  # as certain as a lag
    K = 300 / (1 + 300 / k)
    row = {"frame_stiffness": found.frame_stiffness, "K": K}
    words = said_of(row, K_ratio=K / 300)
    assert words.startswith("yielding bench: ")
    assert "bench_stiffness" in words
    assert "`delay`" not in words
    for no_help in (None, 1.2, 0.8):  # no gains; friction
        words = said_of(row, K_ratio=no_help)
        assert words.startswith("late torque or yielding bench: ")
        assert f"a spring of {found.frame_stiffness:.3g} N*m/rad in series" in words
        assert all(key in words for key in ("delay", "low_pass", "bench_stiffness"))


def said_of(row, **more):
    """The doubts about a row with a lag that counts."""
    found = pl.DataFrame([row | {"lag_share": 0.1, "lag_inertia_share": 0.9} | more], infer_schema_length=None)
    limits = Doubt(above={"lag_share": 0.05, "lag_inertia_share": 0.02})
    return marked(found, limits, "impedance")["doubtful"][0]


def test_a_late_torque_is_named_alone_where_k_is_that_of_the_gains():
    found = measured_lag(SECOND_ORDER * np.exp(-2e-3 * S))
    row = {"frame_stiffness": found.frame_stiffness, "K": 300.0}
    words = said_of(row, K_ratio=1.0)
    assert words.startswith("late torque: ")
    assert "delay" in words
    assert "bench_stiffness" not in words
    assert "bench_stiffness" in said_of(row)
    late = f"is late by {1e6 * found.lag:.0f} us, which make 10.0 % of B and 90 % of I"
    assert f"the torque {late}" in said_of(row, K_ratio=1.0, lag_s=found.lag)
    assert f"the angle {late}" in said_of(row, K_ratio=1.0, lag_s=-found.lag)


def third_order(impedance):
    """Coefficients to the third power of s of an impedance, by Cauchy's integral on a circle of 2 rad/s."""
    s = 2 * np.exp(2j * np.pi * np.arange(64) / 64)
    return dict(zip("KBIJ", (np.fft.fft(impedance(s)).real / 64 / 2.0 ** np.arange(64))[:4], strict=True))


@pytest.mark.parametrize("k", [686.0, 3000.0])
def test_a_spring_in_series_is_found_from_the_jerk_in_any_motion(k):
    assert yielding_in(third_order(lambda s: 1 / (1 / (300 + 5 * s + 0.02 * s**2) + 1 / k))) == pytest.approx(k, 1e-6)


def test_a_torque_that_comes_early_in_any_motion_has_no_spring_in_series():
    assert yielding_in(third_order(lambda s: (300 + 5 * s + 0.02 * s**2) * np.exp(1e-3 * s))) is None


def row_at(amplitude_deg, K, B=0.5, **more):
    """A row of the impedance table with intervals of no width."""
    causes = {"backlash_share": 0.0, "backlash_deg": 0.0, "stiffening": 0.0, "coulomb_torque": 0.0}
    return {"amplitude_deg": amplitude_deg, "K": K, "K_high": K, "B": B, "B_high": B, **causes, **more}


def test_a_change_of_a_small_damping_is_a_share_of_two_newton_metres_per_rad_per_second_too():
    *_, whole = over_amplitudes([row_at(2.0, 300.0, 0.8), row_at(6.0, 300.0, 0.4), row_at(None, 300.0, 0.5)])
    assert whole["B_change"] == pytest.approx(-0.4 / np.hypot(0.5, 2))
    assert whole["K_change"] == 0


@pytest.mark.parametrize(("K", "stiffening"), [(301.0, 0.0), (312.0, 0.06), (290.0, 0.0)])
def test_a_spring_stiffens_only_if_k_rises_by_half_of_what_the_harmonic_implies(K, stiffening):
    """A stiffening of 6 % at 6 deg raises K by 0.75 0.06 (1 - 1/9) = 4 % from 2 to 6 deg."""
    rows_of_trial = [row_at(2.0, 300.0), row_at(6.0, K), row_at(None, 300.0, stiffening=0.06, backlash_share=-0.0)]
    assert over_amplitudes(rows_of_trial)[-1]["stiffening"] == stiffening


@pytest.mark.parametrize(("coulomb", "share"), [(0.1, 0.009), (-0.4, 0.0)])
def test_with_one_amplitude_a_gap_counts_only_beside_less_friction(coulomb, share):
    """0.1 deg at K = 300 N*m/rad takes off 0.26 N*m."""
    found = row_at(6.0, 300.0, backlash_deg=0.1, backlash_share=0.009, coulomb_torque=coulomb)
    assert [row["backlash_share"] for row in over_amplitudes([found, found | {"amplitude_deg": None}])] == [share] * 2


def test_k_over_what_the_gains_should_give_is_that_of_the_largest_amplitude_in_every_row():
    amplitudes = pl.DataFrame({"amplitude_deg": [6.0, 2.0, 4.0, None], "K": [200.0, 240.0, 220.0, 210.0]})
    table = amplitudes.with_columns(K_high=pl.col("K"))
    assert plausible_impedance(table, Saturated("made", 0), P, 200.0)["K_ratio"].to_list() == [1.0] * 4


def test_beside_a_gap_no_lag_is_certain():
    late = {"certain_lag_damping": 2.7, "lag_share": 0.5, "frame_stiffness": 4e3, "lag_s": -9e-3}
    trial = [row_at(2.0, 296.0, **late), row_at(6.0, 300.0, **late), row_at(None, 299.0, backlash_share=0.008, **late)]
    for row in over_amplitudes(trial):
        assert (row["certain_lag_damping"], row["lag_share"], row["frame_stiffness"]) == (0, 0, None)
        assert row["lag_s"] == -9e-3
    sound = [{**row, "backlash_share": 0.0} for row in trial]
    assert over_amplitudes(sound)[-1]["lag_share"] == 0.5
