"""Stamps and sensors as a source file states them give the right K, B, I of trials in closed form
at 20 kHz."""

import numpy as np
import polars as pl
import pytest
from bench_synthetic import table_of
from scipy.interpolate import CubicSpline
from scipy.signal import lsim, lti

from osl_analysis.bench.analysis import analysed
from osl_analysis.bench.effects import IMPEDANCE, plain_sums
from osl_analysis.bench.record import sine_record
from osl_analysis.bench.settings import DynamometerAnalysis
from osl_analysis.errors import InputError
from osl_analysis.signals import grid
from osl_analysis.signals.grid import GapLimits, uniform_signals
from osl_analysis.signals.stream import SensorLowPass
from osl_analysis.trial import Trial

K, B, I = 300.0, 5.0, 0.02
RATE, FINE, CYCLES, FREQUENCIES = 1000, 20, 10, (2.0, 3.0, 5.0)
SETTINGS = {"cutoff_hz": 15, "order": 4, "cycles": CYCLES, "settle_cycles": 2}
SETTINGS |= {"amplitudes_deg": [4], "frequencies_hz": list(FREQUENCIES)}


def motion(t):
    """Angle [rad] and derivatives at times [s]: rest, then whole cycles of each frequency, then
    rest."""
    theta, omega, alpha = np.zeros((3, len(t)))
    start = 1.0
    for f in FREQUENCIES:
        there, w = (t >= start) & (t < start + CYCLES / f), 2 * np.pi * f
        phase = w * (t[there] - start)
        theta[there], omega[there], alpha[there] = (
            np.sin(phase),
            w * np.cos(phase),
            -(w**2) * np.sin(phase),
        )
        start += CYCLES / f
    return np.deg2rad(4) * np.stack([theta, omega, alpha])


def torque(t):
    """Torque of the joint [N*m] at times [s]."""
    return np.array([K, B, I]) @ motion(t) + 0.3


def times(last=13.0):
    return np.arange(0, last, 1 / RATE)


def trial_of(theta, measured, stamps=None, origins=None, stamps_are="auto"):
    """A trial of columns with their own stamps: `stamps` [s] of the torque; those of the angle are
    the times."""
    columns = {
        name: {"file": "log"} | (origins or {}).get(name, {}) for name in ("theta", "torque")
    }
    angle = pl.DataFrame({"time": times(), "theta": theta})
    load = pl.DataFrame({"time": times() if stamps is None else stamps, "torque": measured})
    samples = angle.join(load, on="time", how="full", coalesce=True).sort("time")
    return Trial("made", samples, {"columns": columns, "log": {"time": {"stamps": stamps_are}}})


def fitted(trial, **fields):
    return table_of(sine_record(trial, DynamometerAnalysis(**SETTINGS, **fields))).row(
        -1, named=True
    )


def errors(row):
    """Errors of K, B, I [%]."""
    return np.array(
        [100 * (row[name] / truth - 1) for name, truth in (("K", K), ("B", B), ("I", I))]
    )


def assert_right(row):
    assert (abs(errors(row)) < [0.1, 0.5, 3.0]).all(), row


@pytest.mark.usefixtures("without_witness")
@pytest.mark.parametrize("stamps", ["even", "exact"])
def test_a_stated_delay_is_taken_out_of_the_stamps_of_its_channel(stamps):
    late = trial_of(motion(times())[0], torque(times() - 2e-3), stamps_are=stamps)
    assert errors(fitted(late))[1] == pytest.approx(-12, abs=1)
    stated = {"torque": {"delay": 2e-3}}
    assert_right(
        fitted(
            trial_of(motion(times())[0], torque(times() - 2e-3), origins=stated, stamps_are=stamps)
        )
    )


def test_what_the_load_cell_s_filter_did_is_done_to_the_angle():
    """A first-order low-pass at 20 kHz, by a second library's simulation that takes a torque for
    linear in between."""
    assert SensorLowPass(100.0, 1)(np.full(9, 3.0), 1000.0) == pytest.approx(3.0)  # from rest
    fine = np.arange(len(times()) * FINE) / (RATE * FINE)
    slow = lsim(
        lti([1.0], [1 / (2 * np.pi * 100.0), 1.0]), torque(fine), fine, X0=0.3 / (2 * np.pi * 100.0)
    )[1][::FINE]
    assert errors(fitted(trial_of(motion(times())[0], slow)))[2] < -20
    stated = {"torque": {"low_pass": {"cutoff_hz": 100.0, "order": 1}}}
    assert_right(fitted(trial_of(motion(times())[0], slow, origins=stated)))


@pytest.mark.parametrize(
    ("stamps", "taken"), [("exact", "exact"), ("auto", "exact"), ("even", "even")]
)
def test_a_stated_use_of_the_stamps_stands(stamps, taken):
    scattered = times() + np.random.default_rng(1).normal(0, 20e-6, len(times()))
    samples = pl.DataFrame(
        {"time": scattered, "theta": motion(scattered)[0], "torque": torque(scattered)}
    )
    provenance = {"columns": {"theta": {"file": "log"}}, "log": {"time": {"stamps": stamps}}}
    (stream,) = uniform_signals(
        Trial("made", samples, provenance), ["theta", "torque"], GapLimits()
    ).streams
    assert (stream["stamps"], stream["why"].startswith("stated")) == (taken, stamps != "auto")


@pytest.mark.usefixtures("without_witness")
def test_the_bench_s_yielding_is_taken_off_the_angle_and_its_error_is_in_the_intervals():
    """The bench's encoder sees the joint's angle and the frame's, wound up by the resisting
    torque."""
    frame = {"value": "3000 N*m/rad", "standard_error": "100 N*m/rad"}
    yielding = trial_of(motion(times())[0] + torque(times()) / 3000.0, torque(times()))
    assert errors(fitted(yielding)).round().tolist() == [-9, -17, -49]
    row = fitted(yielding, bench_stiffness=frame)
    assert_right(row)
    assert row["K_se"] == pytest.approx(300.0**2 * 100 / 3000**2, rel=0.01)


@pytest.mark.parametrize("text", ["218", "-3 N*m/rad", "nan N*m/rad", "3 N*m", "stiff N*m/rad"])
def test_a_bench_stiffness_without_number_or_unit_is_refused(text):
    with pytest.raises(ValueError, match=r"write a positive number and one of N\*m/rad"):
        DynamometerAnalysis(
            **SETTINGS, bench_stiffness={"value": text, "standard_error": "1 N*m/rad"}
        )


def test_undecided_stamps_are_also_taken_the_other_way_and_the_change_is_stated():
    """At rest before and after, and with noise that drowns the evidence, 1 ms of scatter could be
    either."""
    random, n = np.random.default_rng(3), len(times())
    scattered = np.sort(times() + random.normal(0, 0.2e-3, n))
    theta, load = (
        motion(scattered)[0] + random.normal(0, 6e-3, n),
        torque(scattered) + random.normal(0, 3, n),
    )
    undecided = Trial("made", pl.DataFrame({"time": scattered, "theta": theta, "torque": load}))
    record = sine_record(undecided, DynamometerAnalysis(**SETTINGS))
    analysis = analysed(record, plain_sums(record, IMPEDANCE), IMPEDANCE)
    table = analysis.time_base(("K", "B", "I"))
    assert (table["firm"][0], table["other_hypothesis"][0][:2]) == (False, "K ")
    row, other = table_of(record).row(-1, named=True), analysis.others[None]
    assert 0 < row["time_base_shift"] < 3
    for name in "KBI":
        low, high = analysis.whole.interval(name)
        moved = other[name] - row[name]
        assert [row[f"{name}_low"], row[f"{name}_high"]] == pytest.approx(
            [low + min(moved, 0), high + max(moved, 0)]
        )
        assert moved
    assert fitted(trial_of(motion(times())[0], torque(times())))["time_base_shift"] is None


@pytest.mark.parametrize("counted", [False, True])
def test_a_counter_in_the_log_tells_which_samples_a_late_host_lost(counted):
    random, late = np.random.default_rng(8), times()[:-1] + 0.3e-3
    kept = np.flatnonzero(np.arange(len(late)) % 100 != 50)
    stamps = np.maximum.accumulate(late + random.exponential(0.5e-3, len(late))) + 1e-9 * np.arange(
        len(late)
    )
    two = trial_of(motion(times())[0], torque(late)[kept], stamps[kept])
    if not counted:
        with pytest.raises(
            InputError, match=r"torque: about 12[89] samples are missing, and .* sample counter"
        ):
            fitted(two)
        return
    count = pl.DataFrame({"time": stamps[kept], "torque_counter": kept + 1000})
    assert_right(
        fitted(Trial("made", two.samples.join(count, on="time", how="left"), two.provenance))
    )


def test_a_long_recording_is_brought_to_the_grid_in_parts_as_by_one_spline(monkeypatch):
    rng = np.random.default_rng(1)
    stamps = np.arange(5000) / 1000 + rng.uniform(-3e-4, 3e-4, 5000)
    signals = {name: rng.standard_normal(5000) for name in ("theta", "torque")}
    times = np.linspace(stamps[0], stamps[-1], 4900)
    monkeypatch.setattr(grid, "SPLINED", 700)
    found = grid.resampled(stamps, signals, times, 1e-3)
    for name, values in signals.items():
        np.testing.assert_allclose(
            found[name], CubicSpline(stamps, values)(times), rtol=0, atol=1e-11
        )
