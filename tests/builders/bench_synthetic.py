# SPDX-License-Identifier: Apache-2.0
"""A stepped-sine record whose torque is a function of its motion, for the tests of the bench."""

from dataclasses import replace
from functools import cache

import numpy as np
from conftest import white_noise
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, sosfiltfilt

from osl_analysis.bench.belt import branches_of
from osl_analysis.bench.bench_settings import BeltAnalysis, DynamometerAnalysis
from osl_analysis.bench.evidence import impedance_table
from osl_analysis.bench.impedance import rendered_impedance
from osl_analysis.bench.motion import cycles_of
from osl_analysis.bench.record import Record, unlike_groups
from osl_analysis.signals.filters import LowPass, Motion, seven_point_motion
from osl_analysis.spectral.stepped_sine import (
    SteppedSineProtocol,
    find_segments,
    find_sines,
    moving_bins,
)

RATE = 500.0
PROTOCOL = SteppedSineProtocol((0.05, 0.1), (1.0, 3.0, 5.0), 9)
SETTINGS = BeltAnalysis(cutoff_hz=15, order=4)
FIVE = SteppedSineProtocol((0.05, 0.1), (1.0, 2.0, 3.0, 4.0, 5.0), 9)


def sine_settings(amplitudes_deg, frequencies_hz, cycles=10, settle_cycles=2):
    own = {"amplitudes_deg": amplitudes_deg, "frequencies_hz": frequencies_hz, "cycles": cycles}
    return DynamometerAnalysis(cutoff_hz=15, order=4, settle_cycles=settle_cycles, **own)


def with_settings(record, **changes):
    """The record, to be analysed with other settings."""
    return replace(record, settings=sine_settings([2], [1]).model_copy(update=changes))


def unit_sines(sines, rate):
    """Sines of unit amplitude, one after the other: frequency [Hz] and number of cycles of each."""
    pieces = []
    for frequency, cycles in sines:
        rows = np.arange(round(cycles / frequency * rate))
        pieces.append(np.sin(2 * np.pi * frequency * rows / rate))
    return np.concatenate(pieces)


def segments_of(time, theta, protocol):
    rate_hz = (len(time) - 1) / (time[-1] - time[0])
    moving = moving_bins(theta, rate_hz, 0.0)
    sines, _ = find_sines(theta, rate_hz, 0.0, moving, protocol)
    return find_segments(theta, rate_hz, sines, protocol)


def unit_block(protocol, rate):
    """All frequencies of a protocol at unit amplitude, without a rest, at `rate` [Hz]."""
    cycles = np.broadcast_to(protocol.cycles, len(protocol.frequencies_hz))
    return unit_sines(list(zip(protocol.frequencies_hz, cycles, strict=True)), rate)


def true_motion(time, theta):
    """An angle without what is faster than 100 Hz and its derivatives, none of it by the
    package."""
    spline = make_interp_spline(
        time, sosfiltfilt(butter(4, 100, fs=RATE, output="sos"), theta), k=5
    )
    return Motion(*(spline(time, order) for order in range(3)))


@cache
def moved_by(protocol):
    """Times, angle, its derivatives and the segments of a protocol between rests."""
    rest = np.zeros(round(2 * RATE))
    theta = np.concatenate(
        [rest, *(x for a in protocol.amplitudes for x in (a * unit_block(protocol, RATE), rest))]
    )
    time = np.arange(len(theta)) / RATE
    return time, theta, true_motion(time, theta), segments_of(time, theta, protocol)


def stepped_sine(torque_of, noise=0.0, protocol=PROTOCOL):
    """A stepped-sine record whose torque [N*m] is a function of its motion, with white noise."""
    time, theta, motion, segments = moved_by(protocol)
    torque = torque_of(motion) + noise * white_noise(len(time), 1)
    return record_of_sines(time, theta, torque, protocol, segments)


def record_of(time, theta, torque, groups):
    """The record of raw signals."""
    rate = (len(time) - 1) / (time[-1] - time[0])
    motion = seven_point_motion(LowPass(15)(theta, rate), rate)
    filtered = LowPass(15)(torque, rate)
    usable = np.ones(len(time), dtype=bool)
    return Record("made", time, theta, torque, motion, filtered, SETTINGS, usable, groups, rate)


def record_of_sines(time, theta, torque, protocol=PROTOCOL, segments=None):
    """The record of raw signals that follow a protocol."""
    segments = segments or segments_of(time, theta, protocol)
    cycles = cycles_of(segments, 2, np.ones(len(time), dtype=bool))
    made = record_of(time, theta, torque, cycles)
    return replace(made, band_hz=(min(protocol.frequencies_hz), max(protocol.frequencies_hz)))


def belt_record(theta_s, torque, unusable=()):
    """The record of a belt's deflection [rad] and torque [N*m], as if they were filtered."""
    time = np.arange(len(theta_s)) / RATE
    usable = ~np.isin(np.arange(len(theta_s)), unusable)
    omega = np.gradient(theta_s) * RATE
    motion = Motion(theta_s, omega, np.gradient(omega) * RATE)
    groups = unlike_groups(np.zeros(1), np.full(1, len(time)))
    record = Record("b", time, theta_s, torque, motion, torque, SETTINGS, usable, groups, RATE)
    return replace(record, groups=branches_of(record))


def table_of(record):
    """Its rows of `impedance.csv`."""
    return impedance_table(rendered_impedance(record))["impedance"]


def second_order(motion: Motion):
    """Eq. 15."""
    return 200 * motion.theta + 4 * motion.omega + 0.05 * motion.alpha


ACTUATOR = {"k_tau_n_m": 0.1133 * 9, "f_C": 0.377, "f_G": 0.0896, "B_m": 5.6e-3, "J_m": 9.211e-3}


def by_hand(omega, alpha, current):
    """Eqs. 1-2 retyped, for a motion (n,) and I_q [A]."""
    friction = np.sign(omega) * (ACTUATOR["f_C"] + ACTUATOR["f_G"] * np.abs(current))
    return (
        ACTUATOR["k_tau_n_m"] * current
        - friction
        - ACTUATOR["B_m"] * omega
        - ACTUATOR["J_m"] * alpha
    )


def schedule(velocity_offset=0.0):
    """Time, angle, velocity, acceleration, current of sums of sines over 20 s; derivatives by
    hand."""
    t = np.arange(20_000) / 1000
    w = 2 * np.pi * np.array([[0.3], [1.1]])
    a = np.array([[8.0], [5.0]])
    theta = (-a / w * np.cos(w * t)).sum(axis=0) + velocity_offset * t
    omega = (a * np.sin(w * t)).sum(axis=0) + velocity_offset
    alpha = (a * w * np.cos(w * t)).sum(axis=0)
    return (
        t,
        theta,
        omega,
        alpha,
        4 * np.sin(2 * np.pi * 0.17 * t) + 3 * np.sin(2 * np.pi * 0.73 * t),
    )


def belt_cycle(K_s=685.6, K_s2=0.0, coulomb=0.0):
    rest = np.zeros(200)
    way = 0.0873 * (1 - np.cos(np.linspace(0, np.pi, 1500))) / 2
    theta_s = np.concatenate([rest, way, way[::-1], rest])
    direction = np.concatenate([0 * rest, 0 * way + 1, 0 * way - 1, 0 * rest])
    return theta_s, K_s * theta_s + K_s2 * theta_s * np.abs(theta_s) + coulomb * direction + 2.0
