"""Which rows of a record are fitted where the joint moves in any way, and the band of frequencies of its motion."""

import re
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from osl_analysis.errors import InputError
from osl_analysis.pieces import pieces
from osl_analysis.protocol.likeness import moving_bins
from osl_analysis.signals import LowPass, Motion, runs
from osl_analysis.uniform import UniformSignals

EDGE = 2.0
"""Periods of the cut-off at each end of what is fitted that are left out: 130 ms at 15 Hz. The ends of a record,
filtered with an invented continuation, would change K by 0.05 % and I by 0.4 %."""
SHORTEST_S = 1.0
"""Shortest stretch [s] that is fitted."""
LEAST, MOST = 0.01, 0.99
"""Shares of the power of angle and acceleration beyond the band of a motion."""
PARTS = 3
"""Number of consecutive parts of a record, each of which is predicted by a fit to the others."""
BAND_PIECE_S = 8.0
"""Longest piece [s] of the spectrum from which the band is read."""
WINDOWS = 16
"""Windows of this spectrum that are transformed at a time."""


def fitted_pieces(signals: UniformSignals, low_pass: LowPass, windows: str | None) -> tuple[slice, ...]:
    """Rows of the stretches that are fitted: in the windows, or from the first to the last motion, without their ends.

    Raises
    ------
    InputError
        The joint does not move, a window is not in the record, or no stretch is long enough.
    """
    time = signals.time - signals.time[0]
    if windows is None:
        moving = moving_bins(time, signals["theta"])
        if not moving.any():
            raise InputError("the joint does not move; check the channel of theta in the source file")
        stated = [(float(time[np.argmax(moving)]), float(time[len(moving) - 1 - np.argmax(moving[::-1])]))]
    else:
        stated = stated_windows(windows, float(time[-1]))
    inside = np.zeros(len(time), dtype=bool)
    edge = EDGE / low_pass.cutoff_hz
    for start, stop in stated:
        inside |= (time >= start + edge) & (time <= stop - edge)
    shortest = SHORTEST_S * signals.rate_hz
    found = tuple(run for run in runs(inside & signals.usable) if run.stop - run.start >= shortest)
    if not found:
        raise InputError(
            f"nothing is left to fit: the joint moves for {sum(b - a for a, b in stated):.3g} s, of which "
            f"{edge:.2g} s at each end and rows near gaps do not count, and stretches need {SHORTEST_S:g} s; record "
            "for longer"
        )
    return found


def rows_inside(signals: UniformSignals, windows: str | None) -> NDArray[np.bool_]:
    """Rows of the stated windows, all of them without one; raises as `stated_windows`."""
    time = signals.time - signals.time[0]
    if windows is None:
        return np.ones(len(time), dtype=bool)
    parts = [(time >= start) & (time <= stop) for start, stop in stated_windows(windows, float(time[-1]))]
    return np.asarray(np.any(parts, axis=0))


def stated_windows(text: str, duration: float) -> list[tuple[float, float]]:
    """Windows [s] from the start of a record of some duration [s], stated as `2-30 40-62`.

    Raises
    ------
    InputError
        They are not windows, overlap, or lie beyond the record.
    """
    parts = [re.fullmatch(r"(\d+\.?\d*)-(\d+\.?\d*)", word) for word in text.split()]
    windows = [(float(part[1]), float(part[2])) for part in parts if part]
    if len(windows) < len(parts) or any(start >= stop for start, stop in windows):
        raise InputError(f"windows '{text}' are not from-to in s, as in '2-30 40-62'; correct the sheet")
    for (_, stop), (start, _) in pairwise(windows):
        if start < stop:
            raise InputError(f"windows '{text}' overlap, or are not in the order of time; correct the sheet")
    if windows[-1][1] > duration + 1.0:
        raise InputError(f"windows '{text}' end at {windows[-1][1]:g} s, the record after {duration:.1f} s")
    return windows


def band_of(motion: Motion, rate_hz: float, stretches: Sequence[slice]) -> tuple[float, float]:
    """Lowest and highest frequency [Hz] of a motion (n,): 1 % of the angle's power lies below, of the acceleration's
    above. Its spectrum is the mean over the stretches, in which gaps are bridged.

    Raises
    ------
    InputError
        The joint does not move.
    """
    length = min(round(BAND_PIECE_S * rate_hz), *(one.stop - one.start for one in stretches))
    f, low, high = np.empty(0), np.zeros(length // 2 + 1), np.zeros(length // 2 + 1)
    for one in stretches:
        step, weight = length - length // 2, one.stop - one.start
        windows = (weight - length) // step + 1
        for some in pieces(windows, WINDOWS):
            rows = slice(one.start + some.start * step, one.start + (some.stop - 1) * step + length)
            share, part = weight * (some.stop - some.start) / windows, motion[rows]
            f, angle = welch(part.theta, rate_hz, nperseg=length)
            low += share * angle
            high += share * welch(part.alpha, rate_hz, nperseg=length)[1]
    below, up_to = np.cumsum(low[1:]), np.cumsum(high[1:])
    if not below[-1] > 0 or not up_to[-1] > 0:
        raise InputError("the joint does not move; check the channel of theta in the source file")
    return float(f[1:][np.argmax(below > LEAST * below[-1])]), float(f[1:][np.argmax(up_to > MOST * up_to[-1])])


def stretches_of(pieces: Sequence[slice], inside: NDArray[np.bool_]) -> list[slice]:
    """Stretches from the first to the last piece in each window; the gaps between pieces belong to them."""
    joined: list[slice] = []
    for piece in pieces:
        if joined and inside[joined[-1].stop : piece.start].all():
            joined[-1] = slice(joined[-1].start, piece.stop)
        else:
            joined.append(piece)
    return joined


def consecutive_parts(samples: int) -> list[slice]:
    """The fitted rows, counted from 0 to m, as three consecutive parts, the first ones longer by one at most."""
    each, more = divmod(samples, PARTS)
    ends = np.cumsum([0, *(each + (k < more) for k in range(PARTS))]).tolist()
    return [slice(*pair) for pair in pairwise(ends)]
