"""What makes a bench fit doubtful, by its right name: a late torque, friction, a spring that stiffens, play."""

import re

import numpy as np
import pytest
from bench_synthetic import PROTOCOL, RATE, second_order, stepped_sine
from conftest import ROOT

from osl_analysis.bench.diagnostics import check_resists
from osl_analysis.bench.frequency_response import trial_phasors
from osl_analysis.bench.impedance import impedance_table
from osl_analysis.bench.protocol import find_blocks
from osl_analysis.bench.stepped_sine import SteppedSineTrial
from osl_analysis.bench.torque_lag import ImpedancePoints, torque_lag
from osl_analysis.causes import REMEDIES
from osl_analysis.config import read_section
from osl_analysis.doubtful import DoubtfulFits, marked
from osl_analysis.errors import InputError
from osl_analysis.model.compensator import PAPER_WEIGHT, select_gains
from osl_analysis.model.drivetrain import joint_admittance
from osl_analysis.parameters import read_parameters
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


def test_where_neither_model_of_the_joint_fits_their_difference_makes_the_lag_uncertain():
    odd = SECOND_ORDER + 20 * np.exp(1j * FREQUENCY * 2)
    assert measured_lag(odd).se > 1e-3


def rows(torque_of, noise=0.03):
    record = stepped_sine(torque_of, noise)
    return marked(impedance_table(record, trial_phasors(record)), LIMITS_WITHOUT_PLAUSIBILITY, "impedance").to_dicts()


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
    assert abs(whole["coulomb_torque"]) < 0.02
    assert abs(whole["stiffening"]) < 5e-3
    assert whole["backlash_share"] < 2e-3


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
    ("cubic", "words"), [(4e3, "K rises by .*: a spring that stiffens"), (-4e3, "K falls by .*softens")]
)
def test_a_spring_that_stiffens_or_softens_is_named_and_not_called_friction(cubic, words):
    *_, whole = rows(lambda m: second_order(m) + cubic * m.theta**3)
    assert whole["stiffening"] == pytest.approx(cubic * 0.1**2 / whole["K"], rel=0.1)
    assert abs(whole["coulomb_torque"]) < 0.03
    assert whole["backlash_share"] < 5e-3
    assert whole["K_change"] == pytest.approx(0.75 * cubic * (0.1**2 - 0.05**2) / whole["K"], rel=0.05)
    assert re.search(words, whole["doubtful"])


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
    record = SteppedSineTrial("made", pure.time, RATE, theta, torque, *filtered, blocks, None, 2, LowPass(15), 0.0)
    *_, whole = impedance_table(record, trial_phasors(record)).to_dicts()
    assert whole["odd_harmonics"] < 2e-3
    assert abs(whole["coulomb_torque"]) < 0.02


def test_an_asymmetric_joint_has_even_harmonics_and_chatter_at_any_phase_has_none():
    *_, asymmetric = rows(lambda m: second_order(m) + 60 * np.abs(m.theta))
    assert asymmetric["even_harmonics"] > 0.05
    assert "even_harmonics" in asymmetric["doubtful"]


def test_a_torque_of_the_wrong_sign_is_refused_and_one_of_the_right_sign_is_not():
    check_resists("belt_1", "K_s", 685.6)
    check_resists("free", "K", -0.1, 0.2)  # a joint without stiffness
    with pytest.raises(InputError, match=r"trial belt_1: K_s = -685\.6 is negative.*`sign`"):
        check_resists("belt_1", "K_s", -685.6)
    with pytest.raises(InputError, match="K = -2 is negative"):
        check_resists("free", "K", -2, -1.5)


@pytest.mark.parametrize("k", [2000.0, 3000.0, 6000.0])
def test_a_frame_that_yields_is_found_with_its_stiffness_and_named_where_k_is_too_low_for_the_gains(k):
    found = measured_lag(1 / (1 / SECOND_ORDER + 1 / k))
    assert found.frame_stiffness == pytest.approx(k, rel=0.1)
    assert found.lag > 10 * found.se  # as certain as a lag
    K = 300 / (1 + 300 / k)
    row = {"frame_stiffness": found.frame_stiffness, "K": K}
    assert "bench_stiffness" in REMEDIES["lag_share"](0.1, row | {"K_ratio": K / 300})
    assert "delay" not in REMEDIES["lag_share"](0.1, row | {"K_ratio": K / 300})
    for no_help in (None, 1.2, 0.8):  # no gains; friction
        words = REMEDIES["lag_share"](0.1, row | {"K_ratio": no_help})
        assert "delay" in words
        assert "low_pass" in words
        assert "bench_stiffness" in words


def test_a_late_torque_is_named_alone_where_k_is_that_of_the_gains():
    found = measured_lag(SECOND_ORDER * np.exp(-2e-3 * S))
    row = {"frame_stiffness": found.frame_stiffness, "K": 300.0}
    words = REMEDIES["lag_share"](0.1, row | {"K_ratio": 1.0})
    assert "delay" in words
    assert "bench_stiffness" not in words
    assert "bench_stiffness" in REMEDIES["lag_share"](0.1, row)


def test_a_torque_that_comes_early_has_no_frame():
    assert measured_lag(SECOND_ORDER * np.exp(2e-3 * S)).frame_stiffness is None
