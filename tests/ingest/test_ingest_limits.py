# SPDX-License-Identifier: Apache-2.0
"""Where the limits of reading a recording stand: what passes, and what is just beyond.

The values are stated here and not taken from the limits, so that a limit that is doubled no longer
parts them.
"""

from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from conftest import joint_trial, refused_with, white_noise

from osl_analysis.base.errors import InputError
from osl_analysis.base.recording import Channel, Rows
from osl_analysis.base.trial import Trial, plate_columns
from osl_analysis.ingest.capture import vertical_axis
from osl_analysis.ingest.clock import (
    Edges,
    find_edges,
    fit_clock,
    gate_fit,
)
from osl_analysis.ingest.conversion import fresh_rows
from osl_analysis.ingest.guard import (
    changes_of_angle,
    check_recording,
    check_sign,
    check_sizes,
    in_other_units,
)
from osl_analysis.ingest.likely_clock import check_other_clocks, ticks, time_unit, unwrapped
from osl_analysis.ingest.message_log import count_late
from osl_analysis.ingest.quality import (
    cause_of_leaps,
    longest_gap,
    measure_turns,
    measure_unzeroed_plates,
    pressed_plates,
    remedy_of_leaps,
    samples_at_rail,
)
from osl_analysis.ingest.table_log import check_clock_runs, keeps_step, on_line, with_stamps_once

# Pulses that two recorders share


@pytest.mark.parametrize(("swing", "has_edges"), [(0.30, True), (0.20, False)])
def test_a_line_that_changes_by_less_than_a_twentieth_of_its_level_has_no_edges(swing, has_edges):
    square = np.repeat([0.0, 1.0, 0.0, 1.0], 50)

    edges = find_edges(np.arange(200.0), 5.0 - swing * square)

    assert bool(edges.time.size) == has_edges


@pytest.mark.parametrize(("samples", "has_edges"), [(6, True), (4, False)])
def test_a_line_with_an_edge_every_fifth_sample_or_more_often_is_no_pulse_train(samples, has_edges):
    square = np.arange(240) // samples % 2

    edges = find_edges(np.arange(240.0), square.astype(float))

    assert bool(edges.time.size) == has_edges


CHANGES = np.cumsum(np.random.default_rng(0).uniform(0.06, 0.25, 60))  # [s]


def edges_at(times: np.ndarray) -> Edges:
    return Edges(times, np.arange(times.size) % 2 == 0, 1e-3)


def test_six_edges_that_both_recorded_are_enough_for_a_clock():
    fit = fit_clock(edges_at(CHANGES[:6]), edges_at(CHANGES + 0.5))

    assert fit.offset == pytest.approx(0.5, abs=1e-3)
    with refused_with("3 runs of three sync edges"):
        fit_clock(edges_at(CHANGES[:5]), edges_at(CHANGES + 0.5))


def test_edges_of_clocks_that_drift_by_more_than_crystals_do_do_not_agree():
    """Over 200 s: a drift of 400 ppm is one of crystals, of 1500 ppm not."""
    changes = np.cumsum(np.random.default_rng(0).uniform(0.06, 0.25, 1300))

    fit = fit_clock(edges_at(changes / 1.0004), edges_at(changes))

    assert fit.drift == pytest.approx(4e-4, rel=0.01)
    with refused_with("sync edges"):
        fit_clock(edges_at(changes / 1.0015), edges_at(changes))


@pytest.mark.parametrize(("seconds", "longer_s", "is_gate"), [
    (1.0, 0.005, True), (1.0, 0.010, False),  # three steps of 2 ms
    (100.0, 0.050, True), (100.0, 0.070, False),  # and 500 ppm of the length
])  # fmt: skip
def test_a_gate_is_as_long_as_its_capture_but_for_steps_and_drift(seconds, longer_s, is_gate):
    step = 2e-3
    time = np.arange(0.0, seconds, step)
    pulse = Edges(np.array([5.0, 5.0 + seconds + longer_s]), np.array([True, False]), step)

    if is_gate:
        assert gate_fit(pulse, time).offset == -5.0
    else:
        with refused_with("0 pulses of the log are as long as the capture"):
            gate_fit(pulse, time)


# Which axis is vertical


@pytest.mark.parametrize(("slope_deg", "axis"), [(20.0, "z"), (30.0, "")])
def test_a_plate_that_slopes_by_more_than_a_quarter_tells_no_vertical_axis(slope_deg, axis):
    across, up = np.cos(np.deg2rad(slope_deg)), np.sin(np.deg2rad(slope_deg))
    corners = np.array([[1.0, 1, 0], [0, 1, 0], [0, 0, 0], [1, 0, 0]])
    corners = corners @ np.array([[across, 0, up], [0, 1, 0], [-up, 0, across]])

    assert vertical_axis([], [SimpleNamespace(corners=corners)]) == axis


@pytest.mark.parametrize(("share", "axis"), [(0.12, "z"), (0.08, "")])
def test_markers_that_hardly_move_are_of_nobody_who_walks(share, axis):
    heights = np.array([0.0, 0.3, 0.6, 0.9])
    forward = share * heights.std() * np.sqrt(2) * np.sin(np.linspace(0, 20 * np.pi, 2000))
    still = np.zeros_like(forward)
    markers = [
        SimpleNamespace(values=np.column_stack([forward, still, still + height]))
        for height in heights
    ]

    assert vertical_axis(markers, []) == axis


# Stamps of another time


def late_stamps(rows: int, late: int, steps: float) -> np.ndarray:
    """Stamps [s] of which some are late by so many steps of 10 ms."""
    stamps = np.arange(rows) * 0.01
    stamps[rows // 2 : rows // 2 + late] -= steps * 0.01
    return stamps


@pytest.mark.parametrize(("late", "steps", "left_out"), [
    (3, 60, 3), (3, 40, 0),  # fifty steps back
    (4, 100, 4), (6, 100, 0),  # one row of a thousand
])  # fmt: skip
def test_few_rows_far_back_in_time_are_left_out(late, steps, left_out):
    stamps = late_stamps(4500, late, steps)

    places, _ = fresh_rows(Rows("rows", stamps.size), stamps)

    assert stamps.size - places.size == left_out


@pytest.mark.parametrize("in_a_row", [10, 11])
def test_eleven_late_messages_in_a_row_are_a_clock_that_was_set_back(in_a_row):
    stamps = np.arange(100, dtype=np.int64) * 10_000_000
    stamps[50 : 50 + in_a_row] -= 200_000_000

    if in_a_row == 10:
        assert count_late(stamps) == 10
    else:
        with refused_with("time goes back by"):
            count_late(stamps)


# What tells a clock


@pytest.mark.parametrize(("readings", "is_clock"), [(22, True), (20, False)])
def test_twenty_steps_show_whether_a_column_rises_like_a_clock(readings, is_clock):
    assert ticks(np.arange(readings) * 0.01, "s") == is_clock


@pytest.mark.parametrize(("rate_hz", "unit"), [(4000.0, "s"), (6000.0, "")])
def test_a_clock_of_six_kilohertz_has_no_likely_unit(rate_hz, unit):
    assert time_unit(np.arange(100) / rate_hz) == unit


# Tables of rows


@pytest.mark.parametrize(("missing", "keeps"), [(1, True), (2, False)])
def test_a_clock_that_lacks_two_samples_of_a_hundred_does_not_keep_step(missing, keeps):
    steps = np.full(100, 0.01)
    steps[10 : 10 + missing] = 0.02

    assert keeps_step(np.concatenate([[0.0], np.cumsum(steps)])) == keeps


@pytest.mark.parametrize(("off", "is_on_line"), [(0.9e-3, True), (1.5e-3, False)])
def test_a_value_is_on_the_line_of_its_neighbours_to_a_microsecond(off, is_on_line):
    """Beside a slope of 1000 per second, in a channel that is printed to 1e-9."""
    time = np.arange(20) * 0.01
    values = 1000 * time
    values[10] += off
    values[-1] = values[-2] + 1e-9

    assert on_line(time, values)[10] == is_on_line


TABLE_TIME = SimpleNamespace(repeated="", title="time", ADDRESS="column")
TABLE = SimpleNamespace(time=TABLE_TIME, place=lambda name: name)


@pytest.mark.parametrize(("copied", "is_refused"), [(9, False), (15, True)])
def test_rows_of_which_a_tenth_repeats_the_row_before_were_read_twice(copied, is_refused):
    rows = np.sort(np.concatenate([np.arange(100 - copied), np.arange(copied)]))
    frame = pl.DataFrame({"time": rows * 0.01, "torque": rows * 1.0})

    if is_refused:
        with refused_with(f"{copied} of 100 rows have time and values of the row before"):
            with_stamps_once(frame, TABLE, "row")
    else:
        assert len(with_stamps_once(frame, TABLE, "row")[0]) == 100 - copied


def coarse_clock(step_s: float, rows: int) -> np.ndarray:
    """A minute of stamps [s] that so many rows share."""
    return np.repeat(np.arange(0, 60, step_s), rows)


STOPPED_100_MS = np.maximum(np.arange(1000) - 110, 0) * 1e-3
STOPPED_80_MS = np.maximum(np.arange(1000) - 80, 0) * 1e-3


@pytest.mark.parametrize(("time", "is_refused"), [
    (coarse_clock(0.5, 25), True), (coarse_clock(0.3, 25), False),  # tells seconds
    (coarse_clock(0.5, 21), True), (coarse_clock(0.5, 20), False),  # rows with one stamp
    (STOPPED_100_MS, True), (STOPPED_80_MS, False),  # share of the rows
])  # fmt: skip
def test_a_clock_that_tells_seconds_or_stops_is_refused(time, is_refused):
    rows = SimpleNamespace(noun="row", place=str)

    if is_refused:
        with refused_with("time stands still"):
            check_clock_runs(rows, TABLE, time, 0.0)
    else:
        check_clock_runs(rows, TABLE, time, 0.0)


# What no recording has


@pytest.mark.parametrize(("column", "largest"), [
    ("theta", 1e6), ("torque", 1e7), ("current", 1e5), ("omega_m", 1e5),
    ("marker_A_x", 1e3), ("plate1_force_z", 1e6), ("sync", 1e6),
    ("K_1", 1e8), ("B_1", 1e8), ("reference_ankle_moment_left", 1e6), ("signal_emg", 1e9),
])  # fmt: skip
def test_a_value_that_nothing_can_reach_is_refused(column, largest):
    """Two percent beyond, of the whole range from the least to the largest."""
    check_sizes(pl.DataFrame({"time": [0.0], column: [1.01 * largest]}), {column: {}})
    with refused_with(column):
        check_sizes(pl.DataFrame({"time": [0.0], column: [1.03 * largest]}), {column: {}})


POSSIBLE = SimpleNamespace(largest_angle=1.2, load_cell_range=1000.0)


def turning(time: np.ndarray, half_range: float = 0.5) -> Trial:
    angle = half_range * np.sin(2 * np.pi * np.arange(time.size) / 50)
    return joint_trial(time, angle, 100 * angle)


def test_samples_ten_microseconds_apart_are_of_no_recorder():
    check_recording(turning(np.arange(200) * 1.1e-5), POSSIBLE)
    with refused_with("samples are 9e-06 s apart"):
        check_recording(turning(np.arange(200) * 0.9e-5), POSSIBLE)


@pytest.mark.parametrize(("half_range", "is_advised"), [(0.3, True), (0.2, False)])
def test_a_unit_in_which_the_joint_turns_by_less_than_half_a_degree_is_not_advised(
    half_range, is_advised
):
    changes = in_other_units(turning(np.arange(200) * 0.01, half_range), ["theta"])

    assert ("deg" in " ".join(change.words for change in changes)) == is_advised


@pytest.mark.parametrize(("share", "begins_anew"), [(0.95, True), (0.85, False)])
def test_an_angle_that_jumps_by_nine_tenths_of_its_range_begins_anew(share, begins_anew):
    """Another unit would not mend it."""
    angle = np.concatenate([np.linspace(0, 100, 101), 100 * (1 - share) + np.zeros(50)])
    trial = joint_trial(np.arange(151) * 0.01, angle, np.linspace(-90, 90, 151))

    changes = changes_of_angle(trial, "torque", "theta", 1.2)

    assert (len(changes) == 0) == begins_anew


# Checks of recordings


@pytest.mark.parametrize(("step", "gap"), [(1.4, 0.0), (1.6, 0.6)])
def test_a_step_of_one_and_a_half_lacks_a_sample(step, gap):
    assert longest_gap(np.array([0.0, 1.0, 1.0 + step]), 1.0) == pytest.approx(gap)


@pytest.mark.parametrize(("level", "is_at_end"), [(9.993, True), (9.985, False)])
def test_a_torque_within_a_thousandth_of_its_range_is_at_its_end(level, is_at_end):
    torque = white_noise(500, 1)
    torque[100:120] = level + 1e-3 * np.sin(np.arange(20))
    trial = joint_trial(np.arange(500) * 0.01, np.sin(np.arange(500)), torque)
    trial.provenance["columns"] = {"torque": {"range": (-10.0, 10.0)}}

    assert (samples_at_rail(trial, "torque", "torque") == 20) == is_at_end


TURNS = (np.arange(1000) * 0.01, np.sin(np.arange(1000) * 0.05))
"""Times [s] and an angle [rad] from -1 to 1."""


def times_at(angles: np.ndarray) -> np.ndarray:
    """Times at which the angle first has each value."""
    return np.arcsin(angles) / 5.0


@pytest.mark.parametrize(("angles", "at_rail", "cause"), [
    (np.array([0.5, 0.5, 0.5]), 0, "a stop"), (np.array([0.5, 0.5]), 0, "a sensor failed"),
    (np.array([0.42, 0.5, 0.58]), 0, "a stop"), (np.array([0.3, 0.5, 0.7]), 0, "a sensor failed"),
    (np.array([0.5]), 6, "the torque stands"), (np.array([0.5]), 5, "a sensor failed"),
])  # fmt: skip
def test_leaps_at_one_angle_are_a_stop_and_at_an_end_of_the_range_a_clipped_torque(
    angles, at_rail, cause
):
    assert cause_of_leaps({"torque": times_at(angles)}, TURNS, at_rail).startswith(cause)


def remedy(seconds: float, leaps: list[float], alone: int = 0) -> str:
    examined = SimpleNamespace(
        fitted=turning(np.arange(0, seconds, 0.01)), experiment=SimpleNamespace(place="bench")
    )
    return remedy_of_leaps(examined, np.array(leaps), "a sensor failed", alone)


@pytest.mark.parametrize(("alone", "skips"), [(3, True), (2, False)])
def test_leaps_of_which_three_of_four_are_single_values_are_left_out(alone, skips):
    assert ("damaged: skip" in remedy(10.0, [1.0, 2.0, 3.0, 4.0], alone)) == skips


def test_a_window_begins_a_fifth_of_a_second_beside_a_leap_and_lasts_a_second():
    assert "`windows` 2.2-9.8" in remedy(10.0, [2.0])
    assert "`windows` 0.3-1.4" in remedy(1.61, [0.1])
    assert "exclude the trial" in remedy(1.41, [0.1])


@pytest.mark.parametrize(("turns", "wraps"), [(1.08, 1), (1.15, 0)])
def test_a_step_within_a_tenth_of_a_turn_is_one(turns, wraps):
    angle = np.where(np.arange(100) < 50, 0.0, 2 * np.pi * turns)
    examined = SimpleNamespace(trial=joint_trial(np.arange(100) * 0.01, angle, angle))

    assert measure_turns(examined) == {"theta": wraps}


def plate_trial(force: np.ndarray) -> SimpleNamespace:
    """A plate of 0.4 m at 1000 Hz with a vertical force [N]."""
    columns = dict.fromkeys(plate_columns(1), np.zeros(force.size))
    columns["plate1_force_z"] = force
    samples = pl.DataFrame({"time": np.arange(force.size) * 1e-3, **columns})
    corners = [[0.4, 0.4, 0.0], [0.0, 0.4, 0.0], [0.0, 0.0, 0.0], [0.4, 0.0, 0.0]]
    trial = Trial("plate", samples, {"plates": [{"plate": 1, "corners": corners}]})
    return SimpleNamespace(trial=trial, experiment=SimpleNamespace(walker=True, bare_plate=False))


@pytest.mark.parametrize(("noise", "is_at_rest"), [(18.0, True), (25.0, False)])
def test_a_plate_whose_force_scatters_by_more_than_20_newtons_is_not_at_rest(noise, is_at_rest):
    force = 5.0 + noise * white_noise(2000, 1)

    assert bool(measure_unzeroed_plates(plate_trial(force))) == is_at_rest


def test_a_plate_that_is_bare_for_a_fifth_of_a_second_tells_its_zero():
    force = np.full(2000, 800.0)
    force[400:600] = 5.0

    assert measure_unzeroed_plates(plate_trial(force)) == {"plate1": 5.0}


@pytest.mark.parametrize(("force", "samples", "is_pressed"), [
    (150.0, 50, True), (80.0, 50, False), (800.0, 12, True), (800.0, 8, False),
])  # fmt: skip
def test_a_plate_is_stepped_on_from_100_newtons_in_ten_samples(force, samples, is_pressed):
    load = np.zeros(2000)
    load[100 : 100 + samples] = force

    assert bool(list(pressed_plates(plate_trial(load)))) == is_pressed


@pytest.mark.parametrize(("irregular", "is_clock"), [(15, True), (25, False)])
def test_a_clock_has_four_of_five_steps_within_a_fifth_of_the_usual_one(irregular, is_clock):
    steps = np.full(100, 0.01)
    steps[:irregular] = 0.013  # beyond a fifth

    assert ticks(np.cumsum(steps), "s") == is_clock
    steps[:irregular] = 0.0115  # within
    assert ticks(np.cumsum(steps), "s")


@pytest.mark.parametrize(("tick", "bits", "is_counter"), [
    (1.0, 8, True), (1.0, 7, False), (1e-3, 16, True), (1e-3, 15, False),
    (1e-6, 16, True), (1e-6, 15, False),
])  # fmt: skip
def test_a_counter_that_overflows_has_eight_bits_or_sixteen_of_a_fine_tick(tick, bits, is_counter):
    readings = np.arange(0, 3 * 2**bits, 2 ** (bits - 5)) % 2**bits * tick

    _, period = unwrapped(readings)

    assert (period == f"2**{bits} ticks of {tick:g}") == is_counter


ROWS = 2000
STAMPS = np.arange(ROWS) * 0.01  # [s] of a table at 100 Hz


def other_clocks(
    readings: np.ndarray, rate: float | None = None, notes: tuple[str, ...] = ()
) -> dict[str, float]:
    """The clocks beside the time of a table that go on at another rate."""
    clock = Channel({"column": "clock"}, Rows(ROWS), lambda: readings, name="clock", unit="s")
    recording = SimpleNamespace(channels=[clock], notes=notes)
    time = SimpleNamespace(ADDRESS="column", rate=rate, title="t")
    return check_other_clocks(recording, SimpleNamespace(time=time), None, STAMPS, {}, [])[0]


@pytest.mark.parametrize(("faster", "differs"), [(1.004, False), (1.008, True)])
def test_a_clock_beside_time_differs_from_five_parts_in_a_thousand(faster, differs):
    assert ("clock" in other_clocks(faster * STAMPS)) == differs


@pytest.mark.parametrize(("longest", "is_clock"), [(0.05, True), (0.08, False)])
def test_readings_with_a_step_of_more_than_six_hundredths_of_their_span_are_no_clock(
    longest, is_clock
):
    """Steps of 10 ms on average, and 10 ms more: a clock would be told to differ."""
    readings = 1.5 * STAMPS
    readings[ROWS // 2 :] += longest / (1 - longest) * readings[-1]

    assert ("clock" in other_clocks(readings)) == is_clock


@pytest.mark.parametrize(("faster", "is_refused"), [(1.04, False), (1.07, True)])
def test_a_rate_that_is_five_percent_off_a_clock_of_the_table_is_refused(faster, is_refused):
    if is_refused:
        with refused_with("`rate: 100` of time, but the file says"):
            other_clocks(faster * STAMPS, rate=100.0)
    else:
        other_clocks(faster * STAMPS, rate=100.0)


@pytest.mark.parametrize(("stated", "is_refused"), [(100.7, False), (101.5, True)])
def test_a_rate_that_is_one_percent_off_the_one_in_the_file_s_text_is_refused(stated, is_refused):
    notes = (f"Sample rate: {stated} Hz",)

    if is_refused:
        with refused_with("`rate: 100` of time, but the file says .* Hz .in words."):
            other_clocks(STAMPS, rate=100.0, notes=notes)
    else:
        other_clocks(STAMPS, rate=100.0, notes=notes)


# A torque without its sign


def loses_sign(trial: Trial) -> bool:
    try:
        check_sign(trial, "torque", "theta")
    except InputError:
        return True
    return False


@pytest.mark.parametrize(("left", "is_lost"), [(0.1, True), (0.25, False)])
def test_a_sign_is_lost_if_the_motion_leaves_less_than_a_third_once_it_is_put_back(left, is_lost):
    """It leaves 0.19 and 0.42 of what it leaves without signs."""
    time = np.arange(4000) * 5e-3
    theta = 0.08 * np.sin(4.4 * time) + 0.03 * np.sin(14.5 * time)
    slow = np.convolve(white_noise(4000, 5), np.ones(40) / 40, "same")  # as an offset that wanders
    torque = theta / theta.std() + left * slow / slow.std()

    assert loses_sign(joint_trial(time, theta, abs(torque))) == is_lost


def test_a_cycle_of_fifty_samples_tells_a_lost_sign():
    time = np.arange(60) * 0.02
    theta = 0.1 * np.sin(2 * np.pi * time)

    assert loses_sign(joint_trial(time, theta, abs(100 * theta)))
