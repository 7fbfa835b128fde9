"""Drift between the clocks of two devices, one of which measured the angle and the other the torque."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from osl_analysis.errors import InputError
from osl_analysis.trial import Array

CERTAIN = 4.0  # standard errors by which a drift must differ from zero before it is believed, if they are known exactly
CHUNKS, FEWEST_CHUNKS = 20, 5  # chunks of `chunked_slope`, and the fewest of them that tell an error
TIE = 1e-9  # share of x^2 by which two chunks may differ


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
