"""The one inference of joints that are known: exact ones, by scipy's `lsim`, with one fault."""

from functools import cache

import numpy as np
import pytest
import scipy

from osl_analysis.errors import NotWeighedError
from osl_analysis.inference import BenchSignals, ImpedanceInference, infer_impedance

RATE = 500.0
K, B, I = 300.0, 5.0, 0.02
STEP = 2 * np.pi / 2**16


@cache
def driven(seconds: float = 20.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, torque and angle of the joint that a random torque moves (scipy.signal.lsim)."""
    rng = np.random.default_rng(5)
    fine = 4 * RATE  # lsim joins torques by straight lines, which loses 0.3 % at 15 Hz and 500 Hz
    time = np.arange(round(seconds * fine)) / fine
    torque = scipy.ndimage.gaussian_filter1d(rng.normal(size=len(time)), fine / 25)
    torque = 12.0 * torque / torque.std()
    _, theta, _ = scipy.signal.lsim(([1.0], [I, B, K]), torque, time)
    return time[::4], torque[::4], theta[::4]


def inferred(torque: np.ndarray, **more: object) -> ImpedanceInference:
    """The inference beside white noise and an encoder of 16 bits."""
    theta = driven()[2]
    noisy = torque + 0.05 * np.random.default_rng(6).normal(size=len(torque))
    read = np.round(theta / STEP) * STEP
    return infer_impedance(BenchSignals(read, noisy, RATE, encoder_step=STEP, **more))


def velocity() -> np.ndarray:
    time, _, theta = driven()
    return np.asarray(scipy.interpolate.make_interp_spline(time, theta, 5)(time, 1))


@cache
def sound() -> ImpedanceInference:
    return inferred(driven()[1])


@cache
def late() -> ImpedanceInference:
    time, torque, _ = driven()
    shifted = scipy.interpolate.make_interp_spline(time, torque, 5)
    return inferred(shifted(np.clip(time - 0.003, 0, time[-1])))


def test_exact_joint_is_held_and_not_doubted():
    found = sound()

    assert found.doubt is None
    assert max(found.fault_shares) < 0.02
    assert found.fault_probability < 0.2


def test_late_torque_is_a_path():
    found = late()

    assert found.doubt is not None
    assert found.doubt.family == "path"
    assert "delay" in {each.name for each in found.explanations}
    moved = K * 0.003 / (B - K * 0.003)  # by the delay; by other rivals more
    assert 0.95 * moved < found.fault_shares[1] < 3 * moved


def test_friction_is_part_of_the_joint():
    found = inferred(driven()[1] + 0.4 * np.tanh(velocity() / 2e-3))

    assert found.doubt is None
    assert found.friction_probability > 0.9


def test_friction_that_drives_is_no_friction():
    found = inferred(driven()[1] - 0.4 * np.tanh(velocity() / 2e-3))

    assert found.friction_probability < 0.1


def test_hardening_spring_is_named_by_size():
    found = inferred(driven()[1] + 3000.0 * driven()[2] ** 3)

    assert found.doubt is not None
    assert found.doubt.family == "size"


def test_stiffness_that_steps_is_named_by_time():
    time, torque, theta = driven()

    found = inferred(torque - 30.0 * theta * (time > 10.0))

    assert found.doubt is not None
    assert found.doubt.family == "time"


def test_rows_that_the_torque_lost_are_no_sound_joint():
    torque = driven()[1]
    lost = 60  # rows after a third, from which the torque is early
    first = len(torque) // 3
    shifted = np.concatenate([torque[:first], torque[first + lost :], torque[-lost:]])

    assert inferred(shifted).doubt is not None


def test_rivals_are_not_weighed_where_the_acceleration_jumps():
    """A servo of second order follows a binary command."""
    w = 2 * np.pi * 30
    levels = np.repeat(np.random.default_rng(9).choice([-0.035, 0.035], 60), 100)
    command = np.pad(levels, 1500)
    time = np.arange(len(command)) / 1000
    _, theta, _ = scipy.signal.lsim(([w**2], [1, 1.8 * w, w**2]), command, time)

    with pytest.raises(NotWeighedError, match="acceleration jumps"):
        infer_impedance(BenchSignals(theta, K * theta, 1000.0))


def test_gap_is_left_out():
    time, torque, _ = driven()
    usable = (time < 7.0) | (time > 8.0)
    broken = np.where(usable, torque, 50.0)

    found = inferred(broken, usable=usable)

    assert found.doubt is None


def test_torque_that_stands_still_now_and_then_is_bounded_by_what_it_could_move():
    torque = driven()[1]
    rows = np.arange(len(torque))
    stands = rows // 50 % 12 == 0  # for 0.1 s, 8 % of the time

    found = inferred(torque[rows - rows % 50 * stands])

    assert found.doubt is None
    assert found.unexplained_shares[0] > 0.02


def test_noise_of_any_colour_is_explained():
    noise = np.random.default_rng(3).normal(size=len(driven()[0]))
    slow = scipy.ndimage.gaussian_filter1d(noise, RATE / 8)

    found = inferred(driven()[1] + 0.5 * slow / slow.std())

    assert max(found.unexplained_shares) == 0.0


def test_rest_at_a_level_is_no_end_of_the_torque():
    """A filter rings by some steps of a coarse encoder where the joint comes to rest."""
    rests = np.random.default_rng(2).integers(60, 240, 60)
    levels = np.repeat(np.tile([0.07, -0.07], 30), rests)
    derivatives = [scipy.ndimage.gaussian_filter1d(levels, 5.0, order=n) for n in range(3)]
    torque = np.array([40.0, 1.0 * 200, 0.01 * 200**2]) @ derivatives
    step = 2 * np.pi / 2**13
    read = np.round(derivatives[0] / step) * step

    found = infer_impedance(BenchSignals(read, torque, 200.0, step))

    assert found.doubt is None or found.doubt.family != "clipping"


def test_stiffness_that_differs_by_direction_is_harm_of_its_half_difference():
    theta = driven()[2]
    sign = np.tanh(velocity() / 1e-2)

    found = inferred(driven()[1] + 20.0 * theta * sign)

    assert found.doubt is not None
    assert found.doubt.family == "direction"
    assert found.fault_shares[0] == pytest.approx(20 / K, rel=0.25)


def test_torque_is_cut_where_it_no_longer_follows_the_model():
    torque = driven()[1]
    end = float(np.quantile(torque, 0.97))

    found = inferred(np.minimum(torque, end))

    assert found.doubt is not None
    assert found.doubt.family == "clipping"
