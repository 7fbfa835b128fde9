# SPDX-License-Identifier: Apache-2.0
"""A laboratory of recorders: motions with derivatives written by hand, how stamps come about, and a
plain fit. It shares no code with the package but the value `Stream`."""

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, sosfiltfilt

from osl_analysis.signals.grid import USUAL_FILTER, UniformSignals, on_one_grid
from osl_analysis.signals.samples import Stream, take

JOINT = np.array([300.0, 5.0, 0.02])  # K, B, I
SIZE = np.deg2rad(4.0)
DURATION = 24.0  # [s]
RATE = 1000.0  # [Hz]


def one_time_base(streams: list[Stream]) -> UniformSignals:
    return on_one_grid(take(streams), USUAL_FILTER)


# ---- Motions


def sines(t, frequencies=(0.5, 0.9, 1.3, 1.9, 2.3, 3.1), size=SIZE / 3):
    """theta, omega, alpha (3, n) of a sum of sines."""
    w = 2 * np.pi * np.asarray(frequencies)[:, None]
    phase = w * t + np.arange(len(frequencies))[:, None] ** 2
    theta = np.sin(phase).sum(axis=0)
    omega = (w * np.cos(phase)).sum(axis=0)
    alpha = (-(w**2) * np.sin(phase)).sum(axis=0)
    return size * np.array([theta, omega, alpha])


def stepped_sine(t):
    step = np.minimum(t // 6, 4).astype(int)
    w = 2 * np.pi * np.array([0.5, 1.0, 2.0, 3.0, 1.0])[step]
    amplitude = SIZE * np.array([1.0, 0.5, 1.0, 0.7, 1.0])[step]
    return amplitude * np.sin(w * (t - 6 * step))


# ---- Sensors


def rounded_to_bits(x, bits):
    step = 2 * np.pi / 2**bits
    return np.round(x / step) * step


def noisy(x, random, sd=0.05):
    return x + sd * random.standard_normal(len(x))


def angle_at(taken):
    return rounded_to_bits(sines(taken)[0], 18)


def torque_at(taken, random):
    return noisy(JOINT @ sines(taken), random)


# ---- Stamps


def clock(rate, duration=DURATION, first=0.0):
    """Even times [s]."""
    return first + np.arange(int(duration * rate)) / rate


def jittered(t, sd, random):
    return np.sort(t + sd * random.standard_normal(len(t)))


def waits(t, mean, random):
    """A host that is late by an exponential wait and hands messages on in order, none twice."""
    late = np.maximum.accumulate(t + random.exponential(mean, len(t))) if mean else t
    return late + 1e-9 * np.arange(len(t))


# ---- Recorders: stamps, and when the samples were taken


def joint(stamps, taken, **facts):
    return Stream("encoder", stamps, {"theta": angle_at(taken)}, **facts)


def cell(stamps, taken, random, **facts):
    return Stream("load cell", stamps, {"torque": torque_at(taken, random)}, **facts)


def log(stamps, taken, random):
    """One log of both."""
    return Stream("log", stamps, {"theta": angle_at(taken), "torque": torque_at(taken, random)})


def recorded(seed, kind, age=0.0, *, rate=1000.0, jitter=1e-4, changes=0.0, decimals=9, lost=0.0):
    """A log of 24 s of the joint, and when its rows were sampled.

    It has host latency on an `even` device, or stamps of loops, of which the values are `age` loops
    older; from the middle on the loops are faster by `changes`.
    """
    random = np.random.default_rng(seed)
    n = int(24 * rate)
    loops = np.arange(n + 1, dtype=float)
    slowed = np.where(loops < n / 2, loops, n / 2 + (loops - n / 2) / (1 + changes))
    even = slowed / rate
    if kind == "even":
        stamps = waits(even, jitter, random)
        taken = even
    else:
        stamps = jittered(even, jitter, random)
        taken = np.interp(loops - age, loops, stamps)
    kept = (random.random(n + 1) >= lost) | (loops < 30) | (loops > n - 30)
    return log(np.round(stamps, decimals)[kept], taken[kept], random), taken[kept]


def held_log(rate, late=0.0, of="torque", long=0.0):
    """A log at 1 kHz in which one signal stands for several rows: its newest value, `late` rows
    after it was taken. One loop in twelve is longer by `long` [s]."""
    random = np.random.default_rng(int(rate))
    t = clock(RATE)
    t += long * np.cumsum(np.arange(t.size) % 12 == 0)
    newest = np.floor((t - late / RATE) * rate + 1e-6).astype(int)
    taken = np.arange(newest[0], newest[-1] + 1) / rate
    recording = log(t, t, random)
    values = {"theta": rounded_to_bits(sines(taken)[0], 14), "torque": torque_at(taken, random)}
    recording.signals[of][:] = values[of][newest - newest[0]]
    return recording


def two_nodes(random, wait, one_in=(0, 0), rates=(RATE, RATE)):
    """Angle and torque, 0.3 ms apart.

    Per node: the mean wait [s], one in how many (+- 3) is lost (0: none), and the rate [Hz].
    """
    of_angle = node_stamps(random, wait[0], one_in[0], clock(rates[0]))
    angle = joint(*of_angle)
    of_torque = node_stamps(random, wait[1], one_in[1], clock(rates[1], first=3e-4))
    return [angle, cell(*of_torque, random)]


def node_stamps(random, wait, one_in, t):
    """Stamps, and when the samples were taken, of a node that waits and loses samples."""
    lost = np.empty(0, int)
    if one_in:
        lost = np.cumsum(random.integers(one_in - 3, one_in + 4, len(t) // one_in + 1))
    kept = np.setdiff1d(np.arange(len(t)), lost[lost < len(t) - 1])
    return waits(t, wait, random)[kept], t[kept]


# ---- The fit


def assert_recovers_the_joint(grid):
    """K, B, I of least squares behind a 15 Hz filter, on the usable rows, as close as a laboratory
    wants them."""
    sections = butter(4, min(15.0, 0.4 * grid.rate_hz), fs=grid.rate_hz, output="sos")
    edge = int(grid.rate_hz / 5)
    theta = sosfiltfilt(sections, grid.signals["theta"], padlen=edge)
    torque = sosfiltfilt(sections, grid.signals["torque"], padlen=edge)
    spline = make_interp_spline(grid.time, theta, k=5)
    columns = np.stack(
        [theta, spline(grid.time, 1), spline(grid.time, 2), np.ones_like(theta)], axis=1
    )
    rows = grid.usable & (grid.time > grid.time[0] + 0.2) & (grid.time < grid.time[-1] - 0.2)
    estimates = np.linalg.lstsq(columns[rows], torque[rows], rcond=None)[0][:3]
    errors = 100 * (estimates / JOINT - 1)
    assert (np.abs(errors) < [0.1, 0.5, 3.0]).all(), errors
