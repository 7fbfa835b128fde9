# SPDX-License-Identifier: Apache-2.0
"""The one inference of joints that are known: exact ones, by scipy's `lsim`, with one fault."""

from functools import cache, partial

import numpy as np
import pytest
import scipy
from conftest import white_noise

from osl_analysis.inference import BenchSignals, ImpedanceInference, infer_impedance

RATE = 500.0
K = 300.0
B = 5.0
STEP = 2 * np.pi / 2**16


@cache
def driven() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, torque and angle of the joint that a random torque moves (scipy.signal.lsim)."""
    rng = np.random.default_rng(5)
    fine = 4 * RATE  # lsim joins torques by straight lines, which loses 0.3 % at 15 Hz and 500 Hz
    time = np.arange(round(20 * fine)) / fine
    torque = scipy.ndimage.gaussian_filter1d(rng.normal(size=len(time)), fine / 25)
    torque = 12.0 * torque / torque.std()
    _, theta, _ = scipy.signal.lsim(([1.0], [0.02, B, K]), torque, time)
    return time[::4], torque[::4], theta[::4]


def inferred(torque: np.ndarray, **more: object) -> ImpedanceInference:
    """The inference beside white noise of 0.05 N*m and an encoder of 16 bits."""
    theta = driven()[2]
    noisy = torque + 0.05 * white_noise(len(torque), 6)
    read = np.round(theta / STEP) * STEP
    return infer_impedance(BenchSignals(read, noisy, RATE, encoder_step=STEP, **more))


def velocity() -> np.ndarray:
    time, _, theta = driven()
    return scipy.interpolate.make_interp_spline(time, theta, 5)(time, 1)


def family_of(found: ImpedanceInference) -> str | None:
    """The family of the most probable fault; None where none is likely."""
    likely = sum(each.probability for each in found.alternatives) > 0.5
    return found.alternatives[0].family if likely else None


def changed(change) -> ImpedanceInference:
    return inferred(change(driven()[1]))


def with_lost_rows(torque):
    """60 rows are lost after a third, from which the torque is early."""
    first = len(torque) // 3
    return np.concatenate([torque[:first], torque[first + 60 :], torque[-60:]])


def standing(torque):
    """It stands still for 0.1 s now and then, 8 % of the time."""
    rows = np.arange(len(torque))
    return torque[rows - rows % 50 * (rows // 50 % 12 == 0)]


def with_slow_noise(torque):
    noise = scipy.ndimage.gaussian_filter1d(white_noise(len(torque), 3), RATE / 8)
    return torque + 0.5 * noise / noise.std()


def stiffer_forwards(torque, size=20.0):
    return torque + size * driven()[2] * np.tanh(velocity() / 1e-2)


def rubbing(torque, size):
    return torque + size * np.tanh(velocity() / 2e-3)


@pytest.mark.parametrize(
    ("change", "family"),
    [
        (partial(rubbing, size=0.4), None),
        (with_slow_noise, None),
        (standing, None),
        (lambda torque: np.minimum(torque, np.quantile(torque, 0.97)), "clipping"),
        (stiffer_forwards, "direction"),
        (partial(np.roll, shift=3), "path"),
    ],
)
def test_a_fault_is_named_by_its_family_and_a_sound_joint_has_none(change, family):
    found = changed(change)

    assert family_of(found) == family


def test_rest_at_a_level_is_no_end_of_the_torque():
    """A filter rings by some steps of a coarse encoder where the joint comes to rest."""
    rests = np.random.default_rng(2).integers(60, 240, 60)
    levels = np.repeat(np.tile([0.07, -0.07], 30), rests)
    motion = [scipy.ndimage.gaussian_filter1d(levels, 5.0, order=n) * 200.0**n for n in range(3)]
    torque = np.array([40.0, 1.0, 0.01]) @ motion
    step = 2 * np.pi / 2**11
    read = np.round(motion[0] / step) * step

    found = infer_impedance(BenchSignals(read, torque, 200.0, step))

    assert "clipping" not in {fault.family for fault in found.alternatives}


@pytest.mark.parametrize(("size", "families"), [(0.0, []), (0.15, ["direction"])])
def test_models_are_tried_only_where_all_together_gain_something(size, families):
    found = changed(partial(stiffer_forwards, size=size))

    assert [fault.family for fault in found.alternatives[:1]] == families


def test_rows_of_a_gap_tell_nothing():
    torque = driven()[1]
    usable = np.ones(len(torque), dtype=bool)
    usable[3000:3400] = False
    bridged = np.where(usable, torque, -torque)

    found = inferred(bridged, usable=usable)

    assert found.without_friction["K"] == pytest.approx(K, rel=2e-3)
    assert family_of(found) is None


def test_rows_that_the_torque_lost_are_no_sound_joint():
    assert family_of(changed(with_lost_rows)) is not None


@pytest.mark.parametrize(("size", "least", "most"), [(0.4, 0.9, 1.01), (-0.4, 0.0, 0.1)])
def test_friction_opposes_the_motion(size, least, most):
    found = changed(partial(rubbing, size=size))

    assert least <= found.friction_probability <= most


def test_what_no_model_explains_is_bounded_by_what_it_could_move():
    assert changed(standing).unexplained[0] > 0.02 * K
    assert max(changed(with_slow_noise).unexplained) == 0.0


@pytest.mark.parametrize(
    ("wave", "most"), [(np.sin, 0.5), (lambda phase: np.tanh(4 * np.sin(3 * phase)), 1.0)]
)
def test_rounding_that_every_cycle_repeats_is_neither_fault_nor_friction(wave, most):
    """An encoder of 12 bits reads a slow sine, which turns at the same place in each cycle, or
    where the joint rests at both ends, so that neither friction nor a cut torque is told there."""
    rng = np.random.default_rng(1)
    time = np.arange(160_000) / 1000
    theta = np.deg2rad(10) * wave(2 * np.pi * 0.2 * time)
    moved = scipy.interpolate.make_interp_spline(time, theta, 5)
    torque = (
        100 * theta + 2 * moved(time, 1) + 0.02 * moved(time, 2) + 0.1 * rng.normal(size=160_000)
    )
    step = 2 * np.pi / 2**12
    read = np.round(theta / step + rng.uniform()) * step

    found = infer_impedance(BenchSignals(read, torque, 1000.0, step))

    assert found.friction_probability < most
    assert family_of(found) is None


def test_a_late_torque_has_the_delay_among_its_explanations():
    """3 rows of 2 ms: a torque that is late by T lowers B by K T, and more by other models."""
    found = changed(partial(np.roll, shift=3))

    delay = next(model for model in found.alternatives if model.name == "delay")
    assert delay.probability > 0.01
    assert delay.change[1] == pytest.approx(K * 3 / RATE, rel=0.1)


def test_gap_is_left_out():
    time, torque, _ = driven()
    usable = (time < 7.0) | (time > 8.0)
    broken = np.where(usable, torque, 50.0)

    found = inferred(broken, usable=usable)

    assert family_of(found) is None


def test_stiffness_by_direction_is_a_change_of_its_half_difference():
    (most_probable, *_) = changed(stiffer_forwards).alternatives

    assert most_probable.change[0] == pytest.approx(20, rel=0.25)
