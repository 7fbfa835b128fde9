# SPDX-License-Identifier: Apache-2.0
"""What loggers do to clocks and signs: each is mended with a remark, or told by its cause."""

import numpy as np
import polars as pl
import pytest
from conftest import refused_with
from mcap_builder import stamped, write_log
from recognised_files import refusal_by, source_of

import osl_analysis as osl
from osl_analysis.base.errors import Advice, InputError
from osl_analysis.base.trial import Trial
from osl_analysis.base.units import si_factor
from osl_analysis.ingest.batches import spread_batches
from osl_analysis.ingest.guard import check_sign
from osl_analysis.ingest.likely_clock import beginnings, unwrapped
from osl_analysis.ingest.raw_files import read_converted

STEP_NS = 2_000_000  # 500 Hz
RATE_HZ = 500


# --- several samples with one stamp -------------------------------------------------------------


def batched(stamps, late):
    """Stamps of samples of which `late` ones wait for the next."""
    received = stamps.copy()
    for row in np.flatnonzero(late)[::-1]:
        received[row] = received[row + 1]
    return received


@pytest.mark.parametrize("share", [0.02, 0.2])
def test_samples_of_a_batch_are_spread_over_the_time_since_the_stamp_before(share):
    true = STEP_NS * np.arange(5000) + 1_700_000_000_000_000_000
    late = np.random.default_rng(3).random(5000) < share
    late[[0, -1]] = False

    stamps, is_moved = spread_batches(batched(true, late))

    np.testing.assert_array_equal(stamps, true)
    np.testing.assert_array_equal(is_moved, late)


@pytest.mark.parametrize(
    "stamps",
    [
        np.repeat(STEP_NS * np.arange(100), 2),  # each sample twice
        np.sort(np.r_[STEP_NS * np.arange(100), STEP_NS * np.arange(0, 100, 20)]),  # of two sensors
    ],
)
def test_equal_stamps_within_one_step_are_no_batch(stamps):
    assert spread_batches(stamps) is None


def messages_of_joint(stamps):
    """A joint of 85 N*m/rad that is moved by several sines."""
    time = np.arange(stamps.size) / RATE_HZ
    rng = np.random.default_rng(5)
    theta, omega = np.zeros((2, time.size))
    for frequency_hz in (0.5, 1.1, 2.3, 3.7):
        turned = 2 * np.pi * frequency_hz * time + rng.uniform(0, 6)
        theta += 0.03 * np.sin(turned)
        omega += 0.03 * 2 * np.pi * frequency_hz * np.cos(turned)
    torque = 85 * theta + 1.7 * omega + rng.normal(0, 0.05, time.size)
    theta = theta + rng.normal(0, 1e-5, time.size)
    rows = zip(stamps.tolist(), theta.tolist(), torque.tolist(), strict=True)
    return [stamped(stamp, angle=a, torque=m, sync=False) for stamp, a, m in rows]


def test_a_driver_that_sends_in_batches_is_fitted_with_a_row_of_the_budget(tmp_path):
    true = STEP_NS * np.arange(20 * RATE_HZ)
    late = np.random.default_rng(7).random(true.size) < 0.02
    late[-1] = False
    log = write_log(tmp_path / "a.mcap", messages_of_joint(batched(true, late)))
    source = tmp_path / "source.yaml"
    source.write_text(
        "format: mcap\ntime: {source: header}\nchannels:\n"
        "  theta: {topic: /lab, field: angle, unit: rad}\n"
        "  torque: {topic: /lab, field: torque, unit: N*m}\n"
    )

    with pytest.warns(Advice, match="batches"):
        trial = osl.read_recording(log, source)
    fit = osl.fit(trial, parameters=None)

    (warning,) = (text for text in trial.provenance["warnings"] if "batches" in text)
    assert f"{late.sum()} of {true.size} messages" in warning
    assert "500 Hz" in warning
    assert fit.K_low < 85 < fit.K_high
    assert "undecided_time_stamps" in [*fit.budget["source"]]


# --- clocks that begin anew ---------------------------------------------------------------------


def test_nanoseconds_within_a_second_go_on_by_a_second():
    ticks = (730_999_947 + 9_999_990 * np.arange(300)) % 10**9

    readings, message = unwrapped(ticks)

    np.testing.assert_array_equal(np.diff(readings), 9_999_990)
    assert "a second" in message


@pytest.mark.parametrize("bits", [8, 16, 32])
def test_a_counter_of_bits_goes_on_by_its_power_of_two(bits):
    readings, message = unwrapped((3 * np.arange(2000) * 2 ** (bits - 8)) % 2**bits)

    assert np.unique(np.diff(readings)).size == 1
    assert f"2**{bits}" in message


def anew(rows, parts=3, start=0.0):
    return np.tile(start + np.arange(rows) / 100, parts)


def test_several_recordings_in_a_file_are_told_with_the_lines_at_which_they_begin(tmp_path):
    path = tmp_path / "a.csv"
    time = anew(200)
    rows = [f"{t:.2f},{np.sin(t):.5f},{np.cos(t):.5f}" for t in time]
    path.write_text("t,angle,torque\n" + "\n".join(rows) + "\n")
    source = source_of(
        "csv",
        time={"column": "t", "unit": "s"},
        channels={"theta": {"column": "angle", "unit": "rad"}},
    )

    message = refusal_by(read_converted, path, source)

    assert "holds 3 recordings" in message
    assert "line 202, line 402" in message
    assert "interval" not in message


@pytest.mark.parametrize(
    "readings", [anew(200, parts=1), anew(15), np.r_[anew(200, 1), anew(200, 1, start=0.7)]]
)
def test_a_clock_that_goes_on_or_back_is_one_recording(readings):
    assert beginnings(readings).tolist() == [0]


@pytest.mark.parametrize("rows", [25, 200])
def test_a_clock_that_begins_anew_tells_where_each_recording_begins(rows):
    assert beginnings(anew(rows)).tolist() == [0, rows, 2 * rows]


# --- a torque without its sign ------------------------------------------------------------------

TIME = np.arange(0, 30, 1 / 200)
THETA = 0.05 * np.sin(2 * np.pi * 1.3 * TIME) + 0.02 * np.sin(2 * np.pi * 2.9 * TIME + 1)
NOISE = np.random.default_rng(2).normal(0, 0.02, TIME.size)
TORQUE = 85 * THETA + 1.7 * np.gradient(THETA, TIME) + NOISE


def joint(torque):
    return Trial("a", pl.DataFrame({"time": TIME, "theta": THETA, "torque": torque}), {})


@pytest.mark.parametrize("torque", [np.abs(TORQUE), -np.abs(TORQUE), np.abs(TORQUE + 1)])
def test_a_torque_that_was_logged_without_its_sign_is_told_so(torque):
    with refused_with("its sign is lost"):
        check_sign(joint(torque), "torque", "theta")


@pytest.mark.parametrize(
    "torque",
    [TORQUE, TORQUE - TORQUE.min(), (85 * THETA) ** 2, np.maximum(TORQUE, 0), np.abs(NOISE)],
    ids=["signed", "preloaded", "even in the angle", "one-sided", "unmoved"],
)
def test_a_torque_of_one_sign_that_the_motion_does_not_explain_with_two_passes(torque):
    check_sign(joint(torque), "torque", "theta")


# --- scales -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scale", "expected"),
    [
        ("1/41232.2", 1 / 41232.2),
        ("0.5/3", 1 / 6),
        ("2.5", 2.5),
        ("0.25*9.80665", 2.4516625),
        ("0.25*9.80665/32768*2", 2.4516625 / 16384),
    ],
)
def test_a_scale_is_a_number_or_products_and_quotients_of_numbers(scale, expected):
    torque = {"column": "adc", "unit": "N*m", "scale": scale}

    source = source_of("csv", time={"rate": 100}, channels={"torque": torque})

    assert source.channels["torque"].scale == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    ("unit", "scale"), [("kg", "ARM*9.80665"), ("N", "ARM`"), ("g", "ARM*0.00980665")]
)
def test_a_force_or_a_mass_is_no_torque_until_its_arm_is_stated(unit, scale):
    with pytest.raises(InputError) as refused:
        si_factor(unit, "N*m")

    assert f"unit: N*m` and `scale: {scale}" in str(refused.value)
