# SPDX-License-Identifier: Apache-2.0
"""Quality control: every check sees the fault it is for, and nothing in a sound recording; raw
channels of force plates before any rotation, and the centre of pressure under load."""

import re
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from bench_synthetic import unit_block
from c3d_builder import FACE, level_plates, write_c3d
from conftest import ROOT, joint_trial, refused_with, white_noise
from recognised_files import source_of
from scipy import signal
from scipy.ndimage import gaussian_filter1d
from shipped import CONFIG, SETTINGS
from stamp_recorders import rounded_to_bits

from osl_analysis.base.trial import Trial
from osl_analysis.base.yaml_settings import Settings, validated
from osl_analysis.commands.fit import is_broken_outside
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.ingest.guard import check_sizes
from osl_analysis.ingest.quality import (
    CheckResult,
    Commanded,
    measure_quality,
    samples_at_rail,
)
from osl_analysis.ingest.raw_files import read_converted
from osl_analysis.judge.checks import CHECKS
from osl_analysis.judge.recording_checks import (
    QualityRules,
    judged_table,
    measured_table,
)
from osl_analysis.signals.filters import longest_run
from osl_analysis.signals.plateaus import run_at_extreme

COMMANDED = Commanded((2.0, 4.0), (2.0, 5.0), 6, clusters={"foot": "ABCD"})
RULES = CONFIG.quality
RATE = 1000.0


NOT_JUDGED = ".+"


def stepped_sine(commanded=COMMANDED):
    """The joint's angle [rad]: half a second of rest, then each amplitude at every frequency, rests
    between."""
    rest = np.zeros(500)
    pieces = [rest]
    for amplitude in np.radians(commanded.amplitudes_deg):
        pieces += [amplitude * unit_block(commanded, RATE), rest]
    return np.concatenate(pieces)


ANGLE = stepped_sine()


def bench(theta=ANGLE, **changed):
    """A sound recording of the dynamometer, with columns changed or added."""
    rng = np.random.default_rng(5)
    torque = 300 * theta + 0.5 + 0.05 * rng.standard_normal(theta.size)
    current = theta * 20 + 0.01 * rng.standard_normal(theta.size)
    columns = {"theta": theta, "theta_command": theta, "torque": torque, "current": current}
    return pl.DataFrame({"time": np.arange(theta.size) / RATE, **columns, **changed})


TORQUE = bench()["torque"].to_numpy()


def laboratory(**changed):
    """A sound crossing: a plate at 1000 Hz that is stepped on, three markers at 200 Hz."""
    time = np.arange(2000) / RATE
    load = 800 * np.clip(np.minimum(time - 0.7, 1.4 - time) / 0.02, 0, 1)
    plate = {"plate1_force_z": load + 2 + white_noise(2000, 6)}
    markers = {f"marker_{name}_x": every_fifth(0.1 * time[::5]) for name in "ABC"}
    return pl.DataFrame({"time": time, **plate, **markers, **changed})


def every_fifth(values):
    """A marker's column beside one that is sampled five times as often."""
    return pl.Series("marker_A_x", [None] * (5 * values.size), pl.Float64).scatter(
        np.arange(values.size) * 5, values
    )


def actuator_bench(**changed):
    """A sound recording of the actuator's own bench: two seconds of a slow sine."""
    time = np.arange(2000) / RATE
    noise = white_noise((2, 2000), 8)
    columns = {"theta_m": np.sin(3 * time), "current": 5 * np.sin(3 * time) + 0.01 * noise[0]}
    return pl.DataFrame(
        {"time": time, **columns, "torque_m": 5 * np.sin(3 * time) + 0.01 * noise[1], **changed}
    )


def test_the_torque_of_an_actuator_may_leap_where_its_current_does():
    bench = actuator_bench()
    steps = 20.0 * (bench["time"].to_numpy() > 1)
    stepped = bench.with_columns(pl.col("torque_m") + steps)

    driven = results(stepped.with_columns(pl.col("current") + steps), "actuator")
    assert driven["dropout"].value == 0
    assert results(stepped, "actuator")["dropout"].value == 1


@pytest.mark.parametrize(
    ("sign", "delay_s", "leaps"), [(1.0, 0.0, False), (-1.0, 0.0, True), (1.0, 0.03, True)]
)
def test_a_torque_may_step_by_friction_where_the_joint_turns(sign, delay_s, leaps):
    time = np.arange(4000) / RATE
    angle = np.sin(np.pi * time)
    friction = sign * 3.0 * np.sign(np.cos(np.pi * (time - delay_s)))
    torque = 10 * angle + friction + 0.01 * white_noise((4000,), 9)

    counted = results(joint_trial(time, angle, torque).samples)["dropout"].value

    assert (counted > 0) == leaps


@pytest.mark.parametrize(
    ("angle_jumps", "stiffness", "cause"),
    [
        (0.0, 3000.0, r"a stop .* at 34\.\d deg"),
        (0.02, 0.0, "rows were lost"),
    ],
)
def test_where_signals_leap_tells_why(angle_jumps, stiffness, cause):
    """At 0.6 rad a stop begins, so stiff that the torque bends there; or both leap on the way."""
    time = np.arange(4000) / RATE
    angle = np.sin(np.pi * time) + angle_jumps * (time > 1.7)
    over = angle > 0.6
    torque = 10 * angle + 3 * over * np.sign(stiffness) + 0.01 * white_noise((4000,), 9)

    remark = results(joint_trial(time, angle, torque).samples)["dropout"].remark

    assert re.search(cause, remark)


def with_piece(values, first, last, new=None):
    """The values with one value from `first` to `last`, that which they have there or another
    one."""
    changed = values.copy()
    changed[first:last] = values[first] if new is None else new
    return changed


def results(samples, experiment="impedance", commanded=COMMANDED, **provenance):
    return measure_quality(Trial("t", samples, provenance), experiment, commanded)


def judged(checks, *accepted):
    """The verdicts of the shipped rules."""
    return judged_table(measured_table("t", checks), RULES, {"t": accepted})


def failed(checks):
    """Names of the checks that the shipped thresholds do not pass."""
    return {
        name
        for name, result in checks.items()
        if CHECKS[name].failed(result.value, RULES.limit(name))
    }


def test_a_sound_recording_passes_every_check():
    assert (failed(results(bench())), failed(results(laboratory(), "walking"))) == (set(), set())
    of_older = measured_table("t", results(bench())).with_columns(check=pl.lit("gone"))
    assert judged_table(of_older, RULES, {}).is_empty(), "a check that an older release had"


AWAY = (np.arange(ANGLE.size) > 2000) & (np.arange(ANGLE.size) < 2500)
BEYOND = longest_run(TORQUE > 15)
NUMBERS = np.arange(1000)
LEVELS = np.repeat([1.0, 4.0, -2.0, 0.0], 1000)[:2000]
SEEN = with_piece(with_piece(np.linspace(0, 0.1, 400), 0, 40, np.nan), 100, 160, np.nan)
# faults that begin or end in a leap of one sample: a rail out of nowhere, and a turn
STILL = pl.DataFrame({"time": np.arange(2000) / RATE, "theta": 0.1})
BARE = laboratory()["plate1_force_z"].to_numpy()
STOOD_ON = 800 + white_noise(2000, 1)


@pytest.mark.parametrize(("check", "samples", "experiment", "value", "remark"), [
    ("rate", bench()[::20], "impedance", 50.0, None),
    ("rate", laboratory(), "walking", 200.0, "marker_A_x"),
    # a load cell at either rail, by its samples
    ("saturation", bench(torque=-np.minimum(TORQUE, 15.0)), "impedance",
     BEYOND.stop - BEYOND.start, "torque"),
    ("saturation", bench(torque=with_piece(TORQUE, 1000, 1009, 40.0)), "impedance", 9, "torque"),
    # an encoder at both ends of its range, once more at one
    ("saturation", bench(ANGLE.clip(-0.05, 0.05), torque=TORQUE)[:8000], "impedance", 123, "theta"),
    ("dropout", bench(torque=with_piece(TORQUE, BEYOND.start, BEYOND.start + 20, 0.0)), "impedance",
     2, f"torque .* {BEYOND.start / RATE:.3f} s.*`windows` 0.2-{BEYOND.start / RATE - 0.2:.1f} .*"
     f"leaves out {ANGLE.size - BEYOND.start + 399} of {ANGLE.size} rows"),
    ("dropout", bench(ANGLE + 0.02 * AWAY), "impedance", 2,
     f"theta .* 2.001 s.*`windows` 2.7-{ANGLE.size / RATE - 0.2:.1f} .*"),
    ("stuck", bench(torque=with_piece(TORQUE, 2000, 3000)), "impedance", 0.999, "torque"),
    ("stuck", bench(with_piece(ANGLE, 6000, None), theta_command=ANGLE), "impedance",
     (ANGLE.size - 6001) / RATE, "theta"),
    ("stuck", actuator_bench(current=LEVELS), "actuator", 0.0, ""),  # a command has levels
    ("stuck", bench(torque=0.0), "impedance", (ANGLE.size - 1) / RATE, "torque"),
    ("stuck", bench(current=0.0, theta_m=0.0), "belt", 0.0, ""),  # the motor is locked
    ("stuck", bench(with_piece(ANGLE, 0, 1000, 0.0), current=with_piece(TORQUE, 0, 1000, 0.0)),
     "impedance", 0.0, ""),
    # it moves from 0.5 s on
    ("stuck", bench(current=with_piece(TORQUE, 0, 1000, 0.0)), "impedance", 0.999, "current"),
    ("stuck", STILL, "impedance", 1.999, "theta"),
    ("stuck", STILL, "static", None, NOT_JUDGED),
    ("encoder_wrap", bench(ANGLE + 2 * np.pi * AWAY), "impedance", 2.0, "theta"),
    ("encoder_wrap", bench(ANGLE + 360 * AWAY), "impedance", 2.0, "theta"),
    ("gap", bench().filter(pl.col("time") != 1.0), "impedance", 0.001, None),  # of one sample
    ("unzeroed_plate", laboratory(plate1_force_z=BARE + 60), "walking", 62.0, None),
    ("unzeroed_plate", laboratory(plate1_force_z=BARE - 50.0 * (np.arange(2000) >= 1600)),
     "walking", 2.0, None),
    # somebody stands there
    ("unzeroed_plate", laboratory(plate1_force_z=STOOD_ON), "static", None, None),
    ("unzeroed_plate", laboratory(plate1_force_z=-STOOD_ON), "static", 800.0, None),
    ("marker_gap", laboratory(marker_A_x=every_fifth(SEEN)), "walking", 60 / 200,
     "foot"),
    # never seen
    ("marker_gap", laboratory(marker_A_x=every_fifth(np.full(400, np.nan))), "walking", 1.999,
     None),
    # a fourth is in sight
    ("marker_gap", laboratory(marker_A_x=every_fifth(SEEN), marker_D_x=every_fifth(NUMBERS[:400])),
     "walking", 0.0, None),
])  # fmt: skip
def test_a_fault_is_measured_where_it_is_and_fails_its_own_check_alone(
    check, samples, experiment, value, remark
):
    checks = results(samples, experiment)

    slack = 0.5 if check == "unzeroed_plate" else 1e-9
    assert checks[check].value == pytest.approx(value, abs=slack)
    assert remark is None or re.fullmatch(remark, checks[check].remark)
    if experiment == "impedance" and samples is not STILL:
        also = (
            {"dropout"} if (check, value) in {("saturation", 9), ("encoder_wrap", 2.0)} else set()
        )
        assert failed(checks) - {"protocol"} <= {check} | also


@pytest.mark.parametrize(("change", "stuck_s"), [(0.04, 0.0), (0.07, 3.999)])
def test_an_angle_is_frozen_while_the_torque_changes_by_a_twentieth_of_its_range(change, stuck_s):
    """In the third quarter of the 4 s at the end in which the angle stands."""
    moves = np.sin(2 * np.pi * np.arange(6000) / RATE)
    ramp = 4 * change * 2 * np.linspace(0, 1, 4000)  # the torque has a range of 2
    samples = {
        "time": np.arange(10_000) / RATE,
        "theta": np.append(0.1 * moves, np.zeros(4000)),
        "torque": np.append(moves, ramp),
    }

    checks = results(pl.DataFrame(samples), "impedance")

    assert checks["stuck"].value == pytest.approx(stuck_s, abs=0.01)


@pytest.mark.parametrize(("last_s", "stuck_s"), [(3, 0.0), (9, 8.8)])
def test_an_angle_that_rests_on_the_last_stair_as_on_the_others_is_not_frozen(last_s, stuck_s):
    """The joint relaxes on each, so that the torque changes."""
    levels = np.repeat([0.01, 0.05, 0.1, 0.05, 0.08], [3000] * 4 + [1000 * last_s])
    stairs = 1e-5 * np.rint(1e5 * gaussian_filter1d(levels, 60))
    since_step = np.concatenate([np.arange(3000)] * 4 + [np.arange(1000 * last_s)])
    torque = 0.5 + 300 * stairs * (1 + 0.8 * np.exp(-since_step / 500 / last_s))
    samples = {"time": np.arange(stairs.size) / RATE, "theta": stairs, "torque": torque}

    checks = results(pl.DataFrame(samples), "impedance")

    assert checks["stuck"].value == pytest.approx(stuck_s, abs=0.1)


def test_a_torque_that_leaps_to_an_end_of_its_range_is_of_no_failed_sensor():
    """A board that loses the sign of what is beyond its range."""
    samples = bench(torque=np.where(TORQUE < -12, 12.0, TORQUE.clip(None, 12.0)))

    checks = results(samples)

    assert "the torque stands at an end of its range" in checks["dropout"].remark


LOADED = np.where(NUMBERS < 800, 700 + np.sin(NUMBERS), 0.0)
PEAKS = np.maximum(np.ceil(500 - (NUMBERS % 200 - 100.0) ** 2 / 12), 440.0)  # seven samples long
# a coarse encoder at the peaks of a slow sine
SINE = np.rint(30.45 * np.sin(NUMBERS / 60))
STEEP = np.where(NUMBERS % 200 > 103, 440.0, PEAKS)  # steep behind its peaks alone
# an unzeroed plate whose noise is below its resolution
COARSE = np.where(NUMBERS < 800, -80.0, 700 + np.sin(NUMBERS))


@pytest.mark.parametrize(
    "values",
    [
        LOADED + 5,
        COARSE,
        300 - COARSE,
        np.minimum(LOADED, 700.5),
        PEAKS,
        STEEP,
        SINE,
        np.rint(200 * np.tanh(4 * np.sin(NUMBERS / 20))),  # slows down to rest at both ends
    ],
)
def test_an_extreme_where_the_channel_rests_or_peaks_slowly_is_no_rail(
    values,
):
    assert run_at_extreme(np.array([5.0, np.nan, 5.0, 0.0])) == slice(0, 0)
    run = run_at_extreme(values)
    assert run.stop - run.start < 5
    assert run_at_extreme(np.abs(NUMBERS % 200 - 100.0) + 50) == slice(100, 101), "the first"


def test_edges_in_the_steps_of_a_slow_log_do_not_doubt_its_clock():
    edges_s = np.sort(np.random.default_rng(3).uniform(0, 60, 400))
    step_s = 1 / 333
    late_s = np.ceil(edges_s / step_s) * step_s - edges_s
    for residual_s, beyond_s in ((np.std(late_s), 0.0), (2e-3, 1.8e-3)):
        clock = {"edges": 0, "method": "edges", "residual": residual_s}
        checks = results(bench(), clock=clock, log={"rates_hz": {"rows": 333.0}})
        assert checks["clock_residual"].value == pytest.approx(beyond_s, abs=1e-4)


DAMAGED_LOG = {
    "complete": False,
    "end_missing": True,
    "lost": 130,
    "share_lost": 0.04,
    "remarks": ["chunk 3"],
}


@pytest.mark.parametrize(("provenance", "beyond", "check", "value", "remark"), [
    ({"clock": {"drift": 5e-5, "residual": 2.5e-3, "edges": 20, "method": "edges"}},
     {"clock_residual"}, "clock_residual", 2.5e-3, "20 .*edges"),
    ({"columns": {"torque": {"unit": "lbf*in", "unit_of_file": "N*m"}, "theta": {"unit": "deg"}}},
     {"unit"}, "unit", 1.0, r"torque .*lbf\*in.*N\*m"),
    ({"damage": {"log": DAMAGED_LOG, "mocap": {
        **DAMAGED_LOG, "end_missing": False, "lost": 3, "share_lost": 0.05,
    }}}, {"damage", "truncated"}, "damage",
     5.0, "mocap: 3 .*chunk 3"),
    ({"columns": {"torque": {"unit": "N*m"}, "theta": {"speeds": {"'v'": 0.5}}}},
     {"contradiction"}, "contradiction", 50.0, "of theta and 'v' .* 0.5 times.*"),
    ({"warnings": ["a.csv: 1 of 9 lines"]}, set(), "damage", 0.0, "a.csv: 1 of 9 lines"),
])  # fmt: skip
def test_what_ingest_found_out_is_judged(provenance, beyond, check, value, remark):
    checks = results(bench(), **provenance)

    assert failed(checks) == beyond
    assert checks[check].value == value
    assert re.fullmatch(remark, checks[check].remark)


@pytest.mark.parametrize(
    ("really", "missing", "remark"),
    [
        (Commanded((2.0, 4.0), (2.0,), 6), 2, "2 deg.* 5 Hz.* 4 deg.* 5 Hz"),
        (Commanded((2.0, 6.0), (2.0, 5.0), 6), 4, "6 deg.* 2 Hz.* 6 deg"),
        (Commanded((1.2 * 2, 1.2 * 4), (2.0, 5.0), 6), 2, "2.4 deg.* 2 Hz.* 1.2 "),
        (Commanded((1.02 * 2, 1.02 * 4), (2.0, 5.0), 6), 0, ""),
        (Commanded((1.045 * 2, 1.045 * 4), (2.0, 5.0), 6), 2, "1.0[45]"),
    ],
)
def test_the_protocol_in_the_log_is_compared_with_the_configured_one(really, missing, remark):
    protocol = results(bench(stepped_sine(really)))["protocol"]

    assert protocol.value == missing
    assert re.search(remark, protocol.remark)


def test_the_protocol_is_found_beside_a_gap_as_long_as_is_stated():
    samples = bench(np.concatenate([np.zeros(1000), ANGLE]))
    broken = pl.concat([samples[:200], samples[900:]])

    stated = results(broken, commanded=replace(COMMANDED, longest_gap_s=0.8))
    assert stated["protocol"].value == 0
    assert "0.5 s, are bridged" in results(broken)["protocol"].remark


def test_cycles_may_differ_by_frequency_and_any_motion_may_be_commanded():
    theta = stepped_sine(Commanded((2.0, 4.0), (2.0, 5.0), (6, 15)))
    timed = replace(COMMANDED, cycles=(6, 15))
    other = (
        sum(
            np.sin(2 * np.pi * f * np.arange(theta.size) / RATE + f * f)
            for f in np.arange(1, 6, 0.37)
        )
        / 50
    )
    for experiment, motion, commanded, value in (
        ("impedance", theta, timed, 0),
        ("impedance", 0 * theta, COMMANDED, 4),
        ("impedance", other, COMMANDED, 0),
        ("impedance", other, replace(COMMANDED, excitation="stepped_sine"), 4),
        ("transmission", 0 * theta, replace(COMMANDED, excitation="any"), 4),
    ):
        assert results(bench(motion), experiment, commanded)["protocol"].value == value
    # a frequency that returns has the cycles of both
    again = Commanded((2.0, 4.0), (2.0, 5.0, 2.0), 6)
    assert results(bench(stepped_sine(again)), commanded=again)["protocol"].value == 0


def test_a_failure_flags_or_excludes_by_rule_and_a_sheet_accepts_it():
    checks = {
        "gap": CheckResult(0.2, "theta"),
        "unzeroed_plate": CheckResult(700.0, "plate1 -700 N"),
    }
    table = judged(checks | {"rate": CheckResult(None)})
    assert table["verdict"].to_list() == ["flag", "exclude", "not applicable"]
    plate = table.row(1, named=True)
    assert (plate["value"], plate["threshold"], plate["remark"]) == (700.0, 20.0, "plate1 -700 N")
    accepted = judged(checks, "unzeroed_plate")
    assert accepted["verdict"].to_list() == ["flag", "pass"]
    assert accepted["remark"][1].endswith("; plate1 -700 N")


class OnlyQuality(Settings):
    quality: QualityRules


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"unzeroed_plate": "20"}, "quality.unzeroed_plate: .*'20'.*'1 N'"),
        ({"unzeroed_plate": "-1 N"}, "quality.unzeroed_plate: .*'-1 N'.*'1 N'"),
        ({"gaps": "1 s"}, "'gaps'.* rate, "),
        ({"exclude": ["gaps"]}, "quality.exclude: 'gaps'.* rate, "),
    ],
)
def test_rules_and_checks_are_one_list_and_thresholds_have_their_units(changed, message):
    there = SETTINGS["quality"] | changed
    with refused_with(message):
        validated({"quality": there}, OnlyQuality, ROOT)


# Sensors at the end of their range: stated in the source file, or seen in the recording.


@pytest.mark.parametrize(("rate", "torque_hz"), [(50, 8), (200, 100), (1000, 8)])
def test_rest_at_a_level_is_no_rail_at_any_rate_though_the_torque_settles(rate, torque_hz):
    """Levels of a noiseless encoder, whose torque is as it is or settles behind a low-pass."""
    fine = 5000
    rng = np.random.default_rng(rate)
    starts = np.cumsum(rng.uniform(0.2, 1.2, 50))
    levels = np.searchsorted(starts, np.arange(30 * fine) / fine) % 2
    moved = np.radians(6) * np.convolve(levels, np.hanning(250) / np.hanning(250).sum(), "same")
    omega = np.gradient(moved) * fine
    of_joint = 150 * moved + 3 * omega + 0.03 * np.gradient(omega) * fine
    behind = signal.butter(2, torque_hz, fs=fine, output="sos")
    columns = {
        "time": np.arange(30 * rate) / rate,
        "theta": rounded_to_bits(moved[:: fine // rate], 14),
        "torque": np.round(signal.sosfilt(behind, of_joint)[:: fine // rate], 3),
    }

    checks = results(pl.DataFrame(columns))

    assert failed(checks) - {"protocol", "rate"} == set()


def test_a_command_s_level_is_no_rail_a_clipped_current_is():
    time = np.arange(2000) / 500.0
    levels = np.repeat([3.0, -2.0, 3.0, 1.0], 500)
    measured = np.minimum(4 * np.sin(7 * time) + 0.02 * white_noise(2000, 1), 3.0)
    torque = np.concatenate([time[:997], np.full(3, 59.7), np.full(7, 59.97), time[:993]])
    origin = {"columns": {"torque": {"range": [-60.0, 60.0]}}}
    moved = np.sin(7 * time)
    for column, values, least, most in (
        ("current", levels, 0, 0),
        ("current", measured, 51, 999),
        ("torque", torque, 7, 7),
        ("torque", np.repeat(measured[::20], 20), 100, 160),
        ("torque", np.repeat(4 * np.sin(7 * time[::20]), 20), 0, 2),
    ):
        samples = pl.DataFrame({"time": time, "theta": moved, column: values})
        assert least <= samples_at_rail(Trial("a", samples, origin), column, "torque") <= most
    # electronics reach a hundredth of the range further
    for low, high in ((-61.1, 61.1), (-61.3, 0.0), (0.0, 61.3)):
        samples = pl.DataFrame({"time": [0.0, 1.0], "torque": [low, high]})
        with refused_with(r"torque.* N\*m") if low + high else nullcontext():
            check_sizes(samples, origin["columns"])


PLATE_RATE = 500
FRAMES = 200
TIME = np.arange(5 * FRAMES) / PLATE_RATE
STANCE = np.clip(np.minimum(TIME - 0.2, 0.8 - TIME) / 0.05, 0, 1)
ROLL = np.interp(TIME, [0.2, 0.8], [-0.08, 0.14])  # centre of pressure along x [m]


def force_and_moment(roll=ROLL):
    """Force and moment (n, 6) on the plate in its axes (z down): 700 N that rolls along x [m], with
    noise."""
    rng = np.random.default_rng(1)
    vertical = -700 * STANCE * (1 + 0.1 * np.sin(10 * TIME))
    force = np.column_stack([60 * STANCE * np.sin(10 * (TIME - 0.5)), 20 * STANCE, vertical])
    moment = np.column_stack([0.02 * vertical, -roll * vertical, 0.0 * TIME])
    noise = rng.normal(0, 1.0, force.shape), rng.normal(0, 0.1, moment.shape)
    return np.hstack([force, moment]) + np.hstack(noise)


def plate_trial(folder, channels):
    """The C3D of one level plate of 0.6 m by 0.4 m, as ingest reads it."""
    path = folder / "a.c3d"
    # z down: y to the right
    corners = FACE * [1000, -1000, 1]
    units = ["N"] * 3 + ["Nm"] * 3
    points = np.ones((FRAMES, 1, 4))
    write_c3d(path, points, channels, **level_plates(corners), ANALOG__UNITS=units)
    recording = read_converted(path, source_of("c3d"))
    return Trial("walk", recording.samples, recording.facts)


def checked(trial, experiment="walking"):
    return measure_quality(trial, experiment, Commanded((2,), (1,), 3))


def test_a_clipped_raw_channel_is_named_with_its_time(tmp_path):
    channels = force_and_moment()
    channels[:, 4] = np.clip(channels[:, 4], -60.0, 60.0)
    trial = plate_trial(tmp_path, channels)

    facts = trial.provenance["plates"][0]["channels"][4]
    assert abs(facts["clipped_at"]) == 60.0
    assert 0.2 < facts["clipped_from_s"] < facts["clipped_to_s"] < 0.8


@pytest.mark.parametrize(
    ("highest", "change", "samples"),
    [(1000, 150, 0), (1000, 250, 250), (100, 40, 0), (100, 60, 600)],
)
def test_a_channel_stands_where_the_load_changes_by_a_fifth_and_50_newtons(
    tmp_path, highest, change, samples
):
    load = np.linspace(0, highest, TIME.size)
    channels = np.outer(load, [1e-4, 1e-4, -1, 1e-4, 1e-4, 1e-4])
    channels[: TIME.size * change // highest, 4] = 5.0

    trial = plate_trial(tmp_path, channels)

    facts = trial.provenance["plates"][0]["channels"][4]
    assert facts["stands_to_s"] == (samples - 1) / PLATE_RATE


def test_dead_moments_put_the_centre_of_pressure_outside_or_at_rest(
    tmp_path,
):
    channels = force_and_moment()
    without = channels * [1, 1, 1, 0, 0, 0]
    outside = plate_trial(tmp_path, without + 840 * np.eye(6)[4])
    dead = plate_trial(tmp_path, without)
    far = checked(outside)["cop_outside_plate"]
    still = checked(dead)["cop_travel"]

    assert far.value > 840 / 770 - 0.3  # at the largest force
    assert far.remark == "plate1"
    assert still.value == pytest.approx(0, abs=0.005)


def test_a_centre_of_pressure_may_lie_as_far_along_a_plate_as_it_is_not_wide(tmp_path):
    """The plate is 0.6 m long and 0.4 m wide; the foot rolls up to 0.27 m from its centre."""
    checks = checked(plate_trial(tmp_path, force_and_moment(ROLL + 0.13)))

    assert checks["cop_outside_plate"].value == 0
    # 5th to 95th percentile of a steady roll of 0.22 m
    assert checks["cop_travel"].value == pytest.approx(0.9 * 0.22, rel=0.08)


def test_3_samples_of_300_put_no_centre_of_pressure_outside(tmp_path):
    channels = force_and_moment()
    channels[[150, 250, 350], 4] += 3e3

    assert checked(plate_trial(tmp_path, channels))["cop_outside_plate"].value == 0


def test_a_plate_on_which_nobody_stands_is_not_judged(tmp_path):
    trial = plate_trial(tmp_path, 0.05 * force_and_moment())
    for experiment in ("walking", "plate"):
        assert re.fullmatch(NOT_JUDGED, checked(trial, experiment)["cop_outside_plate"].remark)


def test_stamps_of_which_most_are_repeated_are_examined_by_their_mean_step():
    """Whole ms at 2 kHz ended in a division by zero."""
    time = np.arange(4000) // 2 / 1000
    checks = results(joint_trial(time, np.sin(6 * time), time).samples)
    assert {"stuck", "rate"} <= checks.keys()


@pytest.mark.parametrize("experiment", ["impedance", "torque_angle"])
def test_the_window_that_the_remark_on_a_leap_names_leaves_it_and_gaps_out(experiment):
    trial = Trial(
        "a", bench(torque=with_piece(TORQUE, 1000, 1002, 2e6)).filter(pl.col("time") != 0.5)
    )
    windows = EXPERIMENTS[experiment].fit.windows

    whole = measure_quality(trial, experiment, COMMANDED)["dropout"]
    window = re.search(r"`windows` (\S+)", whole.remark)[1]
    cut = trial if windows else trial.within(window)
    rest = measure_quality(cut, experiment, COMMANDED, window)

    assert (whole.value, rest["dropout"].value) == (1, 0)
    assert rest["gap"].value == 0


@pytest.mark.parametrize(
    ("windows", "is_outside"), [("0-0.9", True), ("2-3", True), ("0-3", False)]
)
def test_a_long_gap_outside_of_the_windows_is_cut_off_before_the_time_base(windows, is_outside):
    time = np.arange(0.0, 3.0, 1 / RATE)
    torque = np.where((time > 1) & (time < 2), np.nan, np.sin(6 * time))
    trial = joint_trial(time, np.sin(6 * time), torque)

    cut, shifted = trial.cut_to(windows)

    assert is_broken_outside(trial, cut, 0.5) == is_outside
    assert cut.within(shifted).samples.equals(trial.within(windows).samples)
