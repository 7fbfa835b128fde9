# SPDX-License-Identifier: Apache-2.0
"""Motions of a joint that are no stepped sine, with derivatives written by hand, and trials made of
them."""

import numpy as np
import polars as pl
from scipy.interpolate import CubicSpline
from scipy.signal import lsim

from osl_analysis.base.trial import Trial

RATE = 250.0
LEAD = 1.5
FADE = 1.0
TRUE = {"K": 300.0, "B": 5.0, "I": 0.02}


def faded(time, duration, motion):
    """A motion (angle, velocity, acceleration) between two rests, that fades in and out as a
    cosine."""
    t = time - LEAD
    inside = np.clip(np.minimum(t, duration - t) / FADE, 0, 1)
    turns = (inside > 0) & (inside < 1)
    side = np.where(t < duration / 2, 1.0, -1.0)
    w = np.pi / FADE
    size = 0.5 * (1 - np.cos(np.pi * inside))
    rate = 0.5 * w * np.sin(np.pi * inside) * side * turns
    curve = 0.5 * w**2 * np.cos(np.pi * inside) * turns
    x, v, a = motion
    return size * x, rate * x + size * v, curve * x + 2 * rate * v + size * a


def times(duration, rate):
    return np.arange(round((duration + 2 * LEAD) * rate)) / rate


def sines(rng, frequencies_hz, rms_deg=2.0, duration=30.0, rate=RATE):
    """A sum of sines of equal size and random phase: a multisine, or noise where they are many at
    any frequency."""
    time = times(duration, rate)
    w = 2 * np.pi * np.asarray(frequencies_hz)[:, None]
    turning = (
        np.deg2rad(rms_deg)
        * np.sqrt(2 / len(w))
        * np.exp(1j * rng.uniform(0, 2 * np.pi, len(w)))[:, None]
    )
    # of a time that is a whole number of seconds and a rest, each sine is a product of two, which
    # sums as of matrices
    rows = round(rate)
    whole, rest = (np.exp(1j * w * t) for t in (time[::rows], time[:rows]))
    motion = (
        ((turning * (1j * w) ** k * whole).T @ rest).imag.ravel()[: len(time)] for k in range(3)
    )
    return time, faded(time, duration, tuple(motion))


def multisine(rng, period=6.0, periods=5, band=(0.5, 6.0), rate=RATE):
    """Odd lines of a period, one in four left out."""
    lines = np.arange(1, round(band[1] * period) + 1, 2)
    lines = lines[(lines >= band[0] * period) & (np.arange(len(lines)) % 4 != 2)]
    return sines(rng, lines / period, 2.0, period * periods, rate)


def noise(rng, band=(0.5, 6.0), rms_deg=2.0, duration=30.0, rate=RATE):
    """60 sines at random frequencies."""
    return sines(rng, rng.uniform(*band, 60), rms_deg, duration, rate)


def chirp(rng, band=(0.5, 6.0), rms_deg=2.0, duration=30.0, rate=RATE):
    """A linear sweep."""
    time = times(duration, rate)
    t = np.clip(time - LEAD, 0, duration)
    slope = (band[1] - band[0]) / duration
    phase = 2 * np.pi * (band[0] * t + slope * t**2 / 2) + rng.uniform(0, 6)
    w = 2 * np.pi * (band[0] + slope * t)
    motion = (
        np.sin(phase),
        w * np.cos(phase),
        2 * np.pi * slope * np.cos(phase) - w**2 * np.sin(phase),
    )
    return time, faded(time, duration, tuple(np.deg2rad(rms_deg) * np.sqrt(2) * x for x in motion))


def made_trial(rng, motion, torque_noise=0.05, bits=18, late=0.0, more=0.0, **impedance):
    """A trial of a `TRUE` or another joint, noisy and rounded; `late` [s] lags its torque, `more`
    [N*m] adds to it."""
    true = {**TRUE, **impedance}
    time, (theta, omega, alpha) = motion
    torque = true["K"] * theta + true["B"] * omega + true["I"] * alpha + more
    if np.any(late):
        torque = CubicSpline(time, torque)(time - late)
    torque = torque + 0.4 + 1e-3 * time + torque_noise * rng.standard_normal(len(time))
    step = 2 * np.pi / 2**bits
    samples = {
        "time": time + 7.0,
        "theta": np.rint(theta / step + rng.uniform()) * step,
        "torque": torque,
    }
    return Trial("made", pl.DataFrame(samples))


def binary_steps(hold=100):
    """Time and angle of a servo of second order that follows a binary command, by lsim."""
    w = 2 * np.pi * 30
    levels = np.repeat(np.random.default_rng(9).choice([-0.035, 0.035], 60), hold)
    command = np.pad(levels, 1500)
    time = np.arange(len(command)) / 1000
    return time, lsim(([w**2], [1, 1.8 * w, w**2]), command, time)[1]
