"""The lag of a torque in a stepped sine where the gains are not known: a late torque is named, and nothing else is."""

from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from bench_synthetic import RATE, second_order, stepped_sine
from conftest import ROOT
from scipy.ndimage import shift

from osl_analysis.bench.impedance import DesiredImpedance
from osl_analysis.bench.lag import (
    TorqueLag,
    degrees_of_freedom,
    lag_in_noise,
    lag_of,
    lag_row,
    lag_shares,
    points_of,
    torque_lag_row,
)
from osl_analysis.bench.phasors import SegmentPhasors
from osl_analysis.bench.plausibility import Saturated
from osl_analysis.bench.rendered import AskedImpedance, judged_impedance
from osl_analysis.config import read_section
from osl_analysis.doubtful import REMEDIES, DoubtfulFits, marked
from osl_analysis.model.compensator import PAPER_WEIGHT, select_gains
from osl_analysis.model.drivetrain import joint_admittance
from osl_analysis.parameters import read_parameters
from osl_analysis.shared_choices import PAPER

P = read_parameters(ROOT / "config/parameters/default.yaml")
LIMITS = read_section(ROOT / "config/config.yaml", "doubtful", DoubtfulFits).of("impedance")
UNKNOWN = AskedImpedance(DesiredImpedance("ours", None, None), PAPER.weight, (1.0, 3.0, 5.0))
FIT = {"K": 300.0, "B": 5.0, "I": 0.02}
FREQUENCY, THETA = np.tile([1.0, 2, 3, 4, 5], 3), np.repeat([0.035, 0.07, 0.105], 5)
S = 2j * np.pi * FREQUENCY
JOINT = 300 + 5 * S + 0.02 * S**2
GAINS = select_gains("compensated", 300.0, 5.0, P, PAPER_WEIGHT)
DRIVETRAIN = 1 / joint_admittance(GAINS.K_1, GAINS.B_1, P, P.J_j)(S)


def phasors(impedance, noise=1e-3, at=slice(None), seed=2):
    """Phasors of impedances [N*m/rad], whose torque has a noise [N*m] in each part that is stated with it."""
    drawn = noise * np.random.default_rng(seed).standard_normal((2, len(S)))
    torque = impedance * THETA + drawn[0] + 1j * drawn[1]
    exact = np.zeros((2, 2))
    return [
        SegmentPhasors(
            a, f, SimpleNamespace(value=a, covariance=exact), SimpleNamespace(value=y, covariance=noise**2 * np.eye(2))
        )
        for a, f, y in zip(THETA[at], FREQUENCY[at], torque[at], strict=True)
    ]


def table_of(torque_of):
    record = stepped_sine(torque_of, 0.01)
    return marked(judged_impedance(record, Saturated("made", 0), None, UNKNOWN), LIMITS, "impedance")


def late(torque, by):
    return shift(torque, by * RATE, mode="nearest")


def test_a_late_torque_is_doubtful_without_a_parameter_file_with_its_lag_and_what_it_does_to_b_and_i():
    *_, row = table_of(lambda m: late(second_order(m), 2e-3)).to_dicts()
    assert row["lag_s"] == pytest.approx(2e-3, abs=5e-5)
    assert row["lag_share"] == pytest.approx((4 - row["B"]) / row["B"], rel=0.25)  # to first order
    assert row["lag_inertia_share"] == pytest.approx((0.05 - row["I"]) / row["I"], rel=0.25)
    for cause in ("lag_share", "lag_inertia_share", "the torque is late", "`delay`"):
        assert cause in row["doubtful"]


def test_a_torque_in_time_is_not_doubtful_and_its_lag_counts_as_checked():
    table = table_of(second_order)
    assert table["certain_lag_damping"].to_list() == table["lag_inertia_share"].to_list() == [0.0] * 3
    assert not table["doubtful"].str.contains("lag").any()
    assert "whether K is what the gains should give" in table["not_checked"][-1]
    assert "late" not in table["not_checked"][-1]


@pytest.mark.parametrize("lag", [5e-4, -5e-4])
def test_a_lag_that_makes_little_of_b_is_doubtful_for_what_it_makes_of_i(lag):
    row = torque_lag_row(phasors(JOINT * np.exp(-S * lag)), {**FIT, "B": 5 - 300 * lag}, None)
    assert row["lag_s"] == pytest.approx(lag, abs=1.5e-4)
    assert row["lag_share"] < 0.05
    assert row["lag_inertia_share"] == pytest.approx(5 * 5e-4 / 0.02, rel=0.35)
    assert (row["frame_stiffness"] is None) == (lag < 0)


@pytest.mark.parametrize("noise", [1e-3, 0.05, 0.5])
def test_what_a_drivetrain_leaves_is_not_taken_for_a_lag(noise):
    """It would be one of 13 ms. With much noise nothing else is left of it."""
    row = torque_lag_row(phasors(DRIVETRAIN, noise), FIT, None)
    assert row["lag_s"] is None
    assert row["lag_inertia_share"] is None


def test_friction_and_a_spring_that_stiffens_are_no_lag():
    joint = JOINT + 4j * 0.5 / (np.pi * THETA) + 1e3 * THETA**2
    found = lag_in_noise(phasors(joint), FIT)
    assert abs(found.lag) < 4 * found.se


def test_where_a_lag_of_a_tenth_of_b_would_not_be_certain_it_is_not_known_but_a_certain_one_is():
    noisy = 8e-3
    assert lag_in_noise(phasors(JOINT, noisy), FIT) is None
    found = lag_in_noise(phasors(JOINT * np.exp(-S * 3.5e-3), noisy), FIT)
    assert found.lag == pytest.approx(3.5e-3, abs=3 * found.se)
    assert found.lag > 5 * found.se


def test_few_phasors_that_leave_little_by_chance_have_the_standard_error_of_their_noise():
    """Three frequencies at one amplitude are six numbers for five unknowns."""
    few = slice(10, 15, 2)
    z = [lag_in_noise(phasors(JOINT, 2e-4, few, seed), FIT) for seed in range(60)]
    assert max(abs(found.lag / found.se) for found in z if found) < 4
    assert sum(found is None for found in z) <= 2


def test_a_lag_of_more_than_a_fifth_of_a_radian_stands_for_other_dynamics():
    assert lag_in_noise(phasors(JOINT * np.exp(-S * 6e-3)), FIT) is not None
    assert lag_in_noise(phasors(JOINT * np.exp(-S * 7e-3)), FIT) is None


def test_of_two_lags_that_explain_the_torque_the_larger_counts_if_it_leaves_certainly_less():
    """-4.7 ms leave 1.26 times the noise of 30 numbers, 5 ms leave 0.86."""
    found = lag_in_noise(phasors(JOINT * np.exp(-S * 5e-3), 2e-3), FIT)
    assert found.lag == pytest.approx(5e-3, abs=4 * found.se)


def test_shares_are_what_a_late_torque_takes_off_the_joints_own_b_and_i():
    """B = 5 seen as 4.4 is 300 times 2 ms; I loses 5 times 2 ms."""
    assert lag_shares(2e-3, {"K": 300.0, "B": 4.4, "I": 0.012}) == pytest.approx((0.6 / 4.4, 0.01 / 0.013), rel=1e-12)


def test_too_few_phasors_tell_no_lag():
    assert degrees_of_freedom(points_of(phasors(JOINT))) == 30 - 7  # three K, B, I, friction, lag
    assert degrees_of_freedom(points_of(phasors(JOINT, at=slice(3, 6)))) == 0
    assert lag_in_noise(phasors(JOINT, at=slice(3, 6)), FIT) is None


ONE = slice(5, 10)


@pytest.mark.parametrize("expected", [None, joint_admittance(GAINS.K_1, GAINS.B_1, P, P.J_j)])
@pytest.mark.parametrize("seed", range(3))
def test_a_lag_that_is_not_certain_but_may_change_the_inertia_by_a_tenth_is_said_not_to_be_checked(expected, seed):
    """0.3 ms make 7 % of I; the five phasors of one amplitude know it to 0.1 ms."""
    row = torque_lag_row(phasors(JOINT * np.exp(-S * 3e-4), 1e-3, ONE, seed), FIT, expected)
    assert row["certain_lag_damping"] == 0
    assert row["lag_se_s"] > 7e-5
    assert row["lag_share"] is row["lag_inertia_share"] is row["frame_stiffness"] is None


@pytest.mark.parametrize(("lag", "share"), [(3.5e-4, None), (1e-5, 0.0)])
def test_a_lag_may_be_larger_than_it_is_found(lag, share):
    """Five standard errors of 73 us make 9 % of I; 350 us and two of them make 12 %."""
    assert lag_row(TorqueLag(lag, 7.3e-5, 1e-3), 5.0, FIT)["lag_inertia_share"] == share


def test_where_two_lags_of_either_sign_explain_the_torque_the_standard_error_has_their_distance():
    """5 ms and -4.7 ms: that one signal is late is certain, and which one is not."""
    row = torque_lag_row(phasors(JOINT * np.exp(-S * 5e-3), 2.5e-3, ONE, 1), {**FIT, "B": 3.5}, None)
    assert row["lag_se_s"] == pytest.approx(9.7e-3, abs=1.5e-3)
    assert row["certain_lag_damping"] != 0
    assert "the torque or the angle is late" in REMEDIES["lag_inertia_share"](1.0, {"K": 300.0, **row})
    sound = torque_lag_row(phasors(JOINT, 2.5e-4, ONE, 1), FIT, None)
    assert sound["lag_se_s"] < 1e-4


def test_whether_the_torque_is_late_is_said_in_the_rows_that_cannot_tell_and_in_no_other():
    table = pl.DataFrame({"lag_s": [5e-4, 5e-4, None], "lag_inertia_share": [0.13, None, None]})
    for p in (None, P):
        reasons = table.select(UNKNOWN.left_unchecked(p))["not_checked"].to_list()
        assert ["late" in reason for reason in reasons] == [False, True, True]
        assert all("whether K is what the gains should give" in reason for reason in reasons)
    known = AskedImpedance(DesiredImpedance("compensated", 300.0, 5.0), PAPER.weight, (1.0, 3.0, 5.0))
    reasons = table.select(known.left_unchecked(P))["not_checked"].to_list()
    assert reasons[0] is None
    assert "whether the torque is late: a lag that would change I by a tenth" in reasons[1]


@pytest.mark.parametrize("noise", [1e-4, 2e-4])
def test_few_phasors_beside_known_gains_have_the_standard_error_of_their_noise_too(noise):
    few, expected = slice(10, 15, 2), joint_admittance(GAINS.K_1, GAINS.B_1, P, P.J_j)
    z = [lag_of(phasors(JOINT, noise, few, seed), expected) for seed in range(40)]
    assert max(abs(found.lag / found.se) for found in z if found) < 4
