"""Drift between the clocks of two devices, one of which measured the angle and the other the torque."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy

from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.signals import LowPass, Motion
from osl_analysis.trial import Array

PER_PERIOD = 5
"""Samples kept per period of the highest harmonic; the filter leaves nothing that more of them would show."""
CERTAIN = 4.0  # standard errors by which a drift must differ from zero before it is believed, if they are known exactly
FILTERED_HARMONICS = 1.5  # frequency, in cut-offs, up to which the filter leaves harmonics that count
PARTS = 100  # chunks from whose scatter the standard error comes: the more there are, the better it is known
CHUNKS, FEWEST_CHUNKS = 20, 5  # chunks of `chunked_slope`, and the fewest of them that tell an error
TIE = 1e-9  # share of x^2 by which two chunks may differ
LEAST_SEEN = 0.02  # share of the noise's scatter that must be left where its standard error is to be told from it


@dataclass(frozen=True)
class ClockDrift:
    """How much faster the torque's clock runs than the angle's [ppm], and its standard error [ppm]."""

    ppm: float
    se: float
    freedom: float = np.inf  # degrees of freedom of the standard error

    @property
    def certain_ppm(self) -> float:
        """The drift [ppm] if it is larger than chance makes it, else 0."""
        return self.ppm if abs(self.ppm) > self.enough * self.se else 0.0

    @property
    def enough(self) -> float:
        """Standard errors that are as rare as `CERTAIN` of them would be if they were known exactly (Student)."""
        return (
            CERTAIN
            if np.isinf(self.freedom)
            else float(-scipy.special.stdtrit(self.freedom, float(scipy.special.ndtr(-CERTAIN))))
        )


@dataclass(frozen=True)
class SinePiece:
    """Filtered signals of settled cycles of one sine, (n,) each, at uniform times."""

    frequency_hz: float  # frequency of the sine [Hz]
    time: Array  # time [s]
    motion: Motion  # joint angle and its derivatives
    torque: Array  # resisting torque [N*m]


@dataclass(frozen=True)
class DriftColumns:
    """What a drift of 1 does to the torque of a piece, and the torque, (n,) each [N*m], without what is fitted too."""

    drifting: Array
    torque: Array
    beside: Array  # what is fitted beside the drift (k, n)
    inverse: Array  # inverse of its products (k, k)

    def left_of(self, signals: Array) -> Array:
        """What the fit beside the drift leaves of signals (m, n)."""
        return signals - (signals @ self.beside.T) @ self.inverse @ self.beside


def clock_drift(pieces: Sequence[SinePiece], low_pass: LowPass) -> ClockDrift:
    """Drift between the clocks of angle and torque from the settled sines of a trial, behind a filter.

    A torque whose clock gains is stamped later and later: at time t it is that of t - ppm (t - mean t), which to first
    order adds -ppm (t - mean t) dtorque/dt. Within a piece nothing that repeats in every cycle looks like it: angle,
    velocity, offset and all harmonics that the filter leaves are fitted beside it, and a stiffness that changes with
    time. The pieces are not compared with one another, because friction makes a damping that differs between amplitudes
    and frequencies: that would pass for a drift of 100 ppm. A constant offset between the clocks is not seen.

    Raises IdentifiabilityError: The joint does not move, the torque does not follow it, or too few cycles leave no
    noise beside their harmonics.
    """
    highest = FILTERED_HARMONICS * low_pass.cutoff_hz
    rests = [drift_columns(piece, highest) for piece in pieces]
    x, y = map(np.concatenate, zip(*((one.drifting, one.torque) for one in rests), strict=True))
    edges = chunk_edges(x, PARTS)
    if edges is None:
        raise IdentifiabilityError("the torque does not follow the angle: a drift between clocks cannot be seen")
    slope, left = chunk_scatter(x, y, edges)
    step = float(pieces[0].time[1] - pieces[0].time[0])
    memory = low_pass.memory(1 / step)[:: thinning(step, highest)]
    larger, freedom = scatter_of_noise(rests, edges, memory)
    return ClockDrift(1e6 * slope, 1e6 * float(np.sqrt(left @ left * larger) / (x @ x)), freedom)


def scatter_of_noise(rests: Iterable[DriftColumns], edges: Sequence[int], memory: Array) -> tuple[float, float]:
    """Variance of x'y over the sum of the chunks' squares that shows it, and the degrees of freedom of that sum.

    What is fitted takes part of the noise out of the chunks: nearly all of it in two cycles, whose harmonics are as
    many as their independent samples. Both follow from the autocovariance of the noise, `memory` (m,) at 0, 1, ...
    samples (Bell and McCaffrey 2002, Survey Methodology 28, 169-181).
    """
    kernel, chunks = np.concatenate([memory[:0:-1], memory])[None], len(edges) - 1
    products, shares, first = np.zeros((chunks, chunks)), np.zeros(chunks), 0
    for one in rests:
        chunk = np.searchsorted(edges, first + np.arange(len(one.drifting)), side="right") - 1
        there = np.unique(chunk)
        parts = np.where(chunk == there[:, None], one.drifting, 0.0)
        left = one.left_of(parts)
        products[np.ix_(there, there)] += left @ scipy.signal.fftconvolve(left, kernel, mode="same", axes=1).T
        shares[there] += parts @ one.drifting
        first += len(one.drifting)
    without_slope = np.eye(chunks) - shares[:, None] / shares.sum()
    seen = without_slope @ products @ without_slope.T
    if not np.trace(seen) > LEAST_SEEN * products.sum():
        raise IdentifiabilityError("too few cycles leave no noise beside their harmonics: a drift cannot be judged")
    return float(products.sum() / np.trace(seen)), float(np.trace(seen) ** 2 / np.sum(seen**2))


def thinning(step: float, highest_hz: float) -> int:
    """Samples, a step [s] apart, of which one is kept where nothing is faster than `highest_hz`."""
    return max(int(1 / (PER_PERIOD * highest_hz * step)), 1)


def drift_columns(piece: SinePiece, highest_hz: float) -> DriftColumns:
    """What a drift does to the torque of a piece, without all that needs no drift: harmonics up to `highest_hz`."""
    step = float(piece.time[-1] - piece.time[0]) / (len(piece.time) - 1)
    thinned = slice(None, None, thinning(step, highest_hz))
    late, theta = (piece.time - piece.time.mean())[thinned], piece.motion.theta[thinned]
    rows = [theta, piece.motion.omega[thinned], np.ones_like(late), late, late * (theta - theta.mean())]
    turn = np.exp(2j * np.pi * piece.frequency_hz * late)
    harmonic = turn
    for _ in range(2, int(highest_hz / piece.frequency_hz) + 1):
        harmonic = harmonic * turn
        rows += [harmonic.real, harmonic.imag]
    X = np.array(rows)
    scale = np.linalg.norm(X, axis=1)
    if not scale.all():
        raise IdentifiabilityError("the joint does not move: a drift between clocks cannot be seen; use another trial")
    X /= scale[:, None]
    drifting, torque = -late * np.gradient(piece.torque, step)[thinned], piece.torque[thinned]
    found = DriftColumns(drifting, torque, X, np.linalg.pinv(X @ X.T, hermitian=True))
    drifting, torque = found.left_of(np.array([drifting, torque]))
    return replace(found, drifting=drifting, torque=torque)


def drift_row(drift: ClockDrift | None) -> dict[str, float | str | None]:
    """The drift [ppm], its standard error, and the drift if it is certain, as columns of a table; null without one."""
    values = (None, None, None) if drift is None else (drift.ppm, drift.se, drift.certain_ppm)
    return dict(zip(("clock_drift_ppm", "clock_drift_se_ppm", "certain_clock_drift_ppm"), values, strict=True))


def check_drift(drift: ClockDrift, largest_ppm: float) -> None:
    """Refuse a drift beyond what B and I bear.

    Raises InputError: It is; the message states it.
    """
    if abs(drift.certain_ppm) > largest_ppm:
        raise InputError(
            f"the clocks of angle and torque drift apart by {drift.ppm:.2f} +- {drift.se:.2f} ppm, "
            f"more than {largest_ppm:g}: B and I would be wrong; "
            "synchronise the clocks, or record both channels with one device"
        )


def chunked_slope(x: Array, y: Array) -> tuple[float, float]:
    """Slope of y on x, (n,) each, through the origin, and its standard error from the scatter of 20 chunks. The chunks
    carry equal shares of x^2. Where fewer than five can be made, since a few samples carry everything, or x is zero,
    the error is infinite."""
    edges = chunk_edges(x)
    if edges is None:
        return 0.0, np.inf
    slope, left = chunk_scatter(x, y, edges)
    return slope, float(np.sqrt(left @ left * len(left) / (len(left) - 1)) / (x @ x))


def chunk_edges(x: Array, chunks: int = CHUNKS) -> list[int] | None:
    """First rows of chunks of x (n,) with equal shares of x^2, and n; None where fewer than five can be made."""
    total = float(x @ x)
    if not total > 0:
        return None
    # motions that repeat themselves have ties: which row is the first is not left to rounding
    shares = np.searchsorted(np.cumsum(x**2), total * (np.arange(chunks) / chunks - TIE))
    edges = np.unique(np.minimum(shares, len(x) - 1))
    return None if len(edges) < FEWEST_CHUNKS else [*edges.tolist(), len(x)]


def chunk_scatter(x: Array, y: Array, edges: list[int]) -> tuple[float, Array]:
    """Slope of y on x, (n,) each, and the sums (chunks,) of x times what it leaves of y."""
    slope = float(x @ y) / float(x @ x)
    chunks = (slice(*ends) for ends in pairwise(edges))
    return slope, np.array([x[rows] @ (y[rows] - slope * x[rows]) for rows in chunks])
