# SPDX-License-Identifier: Apache-2.0
"""Stamps and sensors as a source file states them give the right K, B, I of trials in closed
form."""

import numpy as np
import polars as pl
import pytest
from bench_synthetic import table_of
from conftest import least_squares_alone, refused_with, white_noise
from scipy.signal import lsim, lti

from osl_analysis.base.trial import Trial, read_trial, write_trial
from osl_analysis.bench.bench_settings import DynamometerAnalysis
from osl_analysis.bench.motion import record_of_trial
from osl_analysis.signals.grid import USUAL_FILTER, uniform_signals, with_clocks
from osl_analysis.signals.samples import SensorLowPass

K = 300.0
B = 5.0
I = 0.02
RATE = 1000  # [Hz] of the log
FINE = 6  # steps of the simulation per sample
CYCLES = 10
FREQUENCIES = (2.0, 3.0, 5.0)
AMPLITUDE = np.deg2rad(4)
OFFSET = 0.3  # [N*m]
SETTINGS = {
    "cutoff_hz": 15,
    "order": 4,
    "cycles": CYCLES,
    "settle_cycles": 2,
    "amplitudes_deg": [4],
    "frequencies_hz": FREQUENCIES,
}
TIMES = np.arange(0, 13.0, 1 / RATE)


# ---- A joint in closed form


def motion(time):
    """Angle [rad] and derivatives (3, n) at times [s]: rest, then whole cycles of each frequency,
    then rest."""
    columns = np.zeros((3, len(time)))
    start = 1.0
    for frequency in FREQUENCIES:
        stop = start + CYCLES / frequency
        moves = (time >= start) & (time < stop)
        w = 2 * np.pi * frequency
        phase = w * (time[moves] - start)
        columns[0, moves] = AMPLITUDE * np.sin(phase)
        columns[1, moves] = AMPLITUDE * w * np.cos(phase)
        columns[2, moves] = -AMPLITUDE * w**2 * np.sin(phase)
        start = stop
    return columns


def angle(time):
    return motion(time)[0]


def torque(time):
    """Torque of the joint (n,) [N*m] at times [s]."""
    theta, omega, alpha = motion(time)
    return K * theta + B * omega + I * alpha + OFFSET


def trial_of(theta, measured, torque_stamps=TIMES, torque_facts=None, stamps="auto"):
    """A trial of columns with their own stamps [s]; those of the angle are the times.

    `torque_facts` are what the source file states of the torque, `stamps` how they are read.
    """
    of_angle = pl.DataFrame({"time": TIMES, "theta": theta})
    of_torque = pl.DataFrame({"time": torque_stamps, "torque": measured})
    samples = of_angle.join(of_torque, on="time", how="full", coalesce=True).sort("time")
    provenance = {
        "columns": {"theta": {"file": "log"}, "torque": {"file": "log", **(torque_facts or {})}},
        "log": {"time": {"stamps": stamps}},
    }
    return Trial("made", samples, provenance)


def fitted(trial, **settings):
    """The row of the trial's fit over all amplitudes."""
    record = record_of_trial(trial, DynamometerAnalysis(**SETTINGS, **settings))
    return table_of(record).row(-1, named=True)


def errors_percent(row):
    return 100 * (np.array([row[name] for name in "KBI"]) / [K, B, I] - 1)


def assert_right(row):
    assert (abs(errors_percent(row)) < [0.1, 0.5, 3.0]).all(), row


# ---- Sensors


@least_squares_alone
def test_a_load_cell_s_filter_takes_a_share_of_I_until_it_is_stated():
    """A first-order low-pass of 100 Hz, by a second library's simulation at 6 kHz that takes a
    torque for linear in between. What it did to the torque is then done to the angle."""
    time_constant = 1 / (2 * np.pi * 100.0)
    fine = np.arange(len(TIMES) * FINE) / (RATE * FINE)
    low_pass = lti([1.0], [time_constant, 1.0])
    _, filtered, _ = lsim(low_pass, torque(fine), fine, X0=OFFSET * time_constant)
    facts = {"low_pass": {"cutoff_hz": 100.0, "order": 1}}
    unstated = trial_of(angle(TIMES), filtered[::FINE])
    stated = trial_of(angle(TIMES), filtered[::FINE], torque_facts=facts)

    assert errors_percent(fitted(unstated))[2] < -20
    assert_right(fitted(stated))


def test_a_sensor_s_low_pass_starts_in_its_steady_state():
    assert SensorLowPass(100.0, 1)(np.full(9, 3.0), 1000.0) == pytest.approx(3.0)


@least_squares_alone
@pytest.mark.parametrize("stamps", ["even", "exact"])
def test_a_delay_takes_a_share_of_B_until_it_is_stated(stamps):
    """To first order a torque that is late by d has B - K d: 5 - 300 x 2e-3, 12 % less."""
    late = torque(TIMES - 2e-3)
    unstated = trial_of(angle(TIMES), late, stamps=stamps)
    stated = trial_of(angle(TIMES), late, torque_facts={"delay": 2e-3}, stamps=stamps)

    assert errors_percent(fitted(unstated))[1] == pytest.approx(-12, abs=1)
    assert_right(fitted(stated))


# ---- The bench's frame


@least_squares_alone
def test_a_frame_that_yields_takes_shares_of_K_B_and_I_until_it_is_stated():
    """The bench's encoder sees the joint's angle and the frame's, wound up by the torque: K and
    3000 N*m/rad are springs in series, K / (1 + K / 3000) to first order, 9 % less."""
    yielding = trial_of(angle(TIMES) + torque(TIMES) / 3000.0, torque(TIMES))

    assert errors_percent(fitted(yielding)).round().tolist() == [-9, -17, -49]
    assert_right(fitted(yielding, bench_stiffness={"value": "3000 N*m/rad"}))


@pytest.mark.parametrize("text", ["218", "-3 N*m/rad", "3 N*m"])
def test_a_bench_stiffness_without_number_or_unit_is_refused(text):
    frame = {"value": text, "standard_error": "1 N*m/rad"}

    with pytest.raises(ValueError, match=r"N\*m/(deg|rad)"):
        DynamometerAnalysis(**SETTINGS, bench_stiffness=frame)


# ---- Stamps


SCATTERED = TIMES + 20e-6 * white_noise(len(TIMES), 1)
EVEN = {"theta": (True, True, "even")}


def scattered_trial(stated="auto", clocks=None):
    """A trial of true stamps."""
    columns = {"time": SCATTERED, "theta": angle(SCATTERED), "torque": torque(SCATTERED)}
    provenance = {"columns": {"theta": {"file": "log"}}, "log": {"time": {"stamps": stated}}}
    return Trial("made", pl.DataFrame(columns), provenance, clocks or {})


@pytest.mark.parametrize(
    ("stated", "found", "used"),
    [
        ("exact", EVEN, "exact"),
        ("auto", EVEN, "even"),
        ("auto", {}, "exact"),
        ("even", {}, "even"),
    ],
)
def test_a_use_of_the_stamps_that_is_stated_or_that_ingest_found_stands(stated, found, used):
    trial = scattered_trial(stated, found)

    (stream,) = uniform_signals(trial, ["theta", "torque"], USUAL_FILTER).streams

    assert stream["stamps"] == used
    assert stream["why"].startswith("stated") == (stated != "auto")


def test_a_fit_reads_of_the_file_what_ingest_found(tmp_path):
    write_trial(with_clocks(scattered_trial()), tmp_path / "made.parquet")

    ingested = read_trial(tmp_path / "made.parquet")

    assert ingested.clocks["torque"][:2] == [False, True]
    assert not ingested.within("1-3").clocks  # of a part it may be another


# ---- A late host that loses samples


LATE = TIMES[:-1] + 0.3e-3  # when the torque is sampled [s]
KEPT = np.flatnonzero(np.arange(len(LATE)) % 100 != 50)


@least_squares_alone
def test_only_a_counter_tells_which_samples_a_late_host_lost():
    """A trial of two devices, of which the torque's host stamps late and loses one sample in a
    hundred."""
    latency = np.random.default_rng(8).exponential(0.5e-3, len(LATE))
    # no two samples share a stamp
    stamps = np.maximum.accumulate(LATE + latency) + 1e-9 * np.arange(len(LATE))
    lossy = trial_of(angle(TIMES), torque(LATE)[KEPT], stamps[KEPT])

    with refused_with(r"torque:.*samples.*counter"):
        fitted(lossy)

    counter = pl.DataFrame({"time": stamps[KEPT], "torque_counter": KEPT + 1000})
    samples = lossy.samples.join(counter, on="time", how="left")

    assert_right(fitted(Trial("made", samples, lossy.provenance)))
