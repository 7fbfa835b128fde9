"""Drift between the clocks of two devices, one of which measured the angle and the other the torque."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.signals import Motion
from osl_analysis.timebase.chunks import chunked_slope
from osl_analysis.trial import Array

PER_PERIOD = 5
"""Samples kept per period of the highest harmonic; the filter leaves nothing that more of them would show."""
CERTAIN = 4.0
"""Standard errors by which a drift must differ from zero before it is believed."""


@dataclass(frozen=True)
class ClockDrift:
    """How much faster the torque's clock runs than the angle's [ppm], and its standard error [ppm]."""

    ppm: float
    se: float

    @property
    def certain_ppm(self) -> float:
        """The drift [ppm] if it is larger than chance makes it, else 0."""
        return self.ppm if abs(self.ppm) > CERTAIN * self.se else 0.0

    def beyond(self, limit_ppm: float) -> bool:
        """The drift is larger than the limit, and larger than chance makes it."""
        return abs(self.certain_ppm) > limit_ppm


@dataclass(frozen=True)
class SinePiece:
    """Filtered signals of settled cycles of one sine, (n,) each, at uniform times."""

    frequency_hz: float
    """Frequency of the sine [Hz]."""
    time: Array
    """Time [s]."""
    motion: Motion
    """Joint angle and its derivatives."""
    torque: Array
    """Resisting torque [N*m]."""


def clock_drift(pieces: Sequence[SinePiece], highest_hz: float) -> ClockDrift:
    """Drift between the clocks of angle and torque from the settled sines of a trial.

    A torque whose clock gains is stamped later and later: at time t it is that of t - ppm (t - mean t), which to first
    order adds -ppm (t - mean t) dtorque/dt. Within a piece nothing that repeats in every cycle looks like it: angle,
    velocity, offset and harmonics up to `highest_hz` are fitted beside it, and a stiffness that changes with time. The
    pieces are not compared with one another, because friction makes a damping that differs between amplitudes and
    frequencies: that would pass for a drift of 100 ppm. A constant offset between the clocks is not seen.

    Raises
    ------
    IdentifiabilityError
        The joint does not move, or the torque does not follow it.
    """
    rests = [drift_columns(piece, highest_hz) for piece in pieces]
    slope, se = chunked_slope(*(np.concatenate(column) for column in zip(*rests, strict=True)))
    if not np.isfinite(se):
        raise IdentifiabilityError("the torque does not follow the angle: a drift between clocks cannot be seen")
    return ClockDrift(1e6 * slope, 1e6 * se)


def drift_columns(piece: SinePiece, highest_hz: float) -> tuple[Array, Array]:
    """What a drift of 1 does to the torque, and the torque, (n,) each [N*m], without all that needs no drift."""
    step = float(piece.time[-1] - piece.time[0]) / (len(piece.time) - 1)
    thinned = slice(None, None, max(int(1 / (PER_PERIOD * highest_hz * step)), 1))
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
    both = np.array([-late * np.gradient(piece.torque, step)[thinned], piece.torque[thinned]])
    explained, *_ = np.linalg.lstsq(X @ X.T, X @ both.T, rcond=None)
    drifting, rest = both - explained.T @ X
    return drifting, rest


def check_drift(drift: ClockDrift, largest_ppm: float) -> None:
    """Refuse a drift beyond what B and I bear.

    Raises
    ------
    InputError
        It is; the message states it.
    """
    if drift.beyond(largest_ppm):
        raise InputError(
            f"the clocks of angle and torque drift apart by {drift.ppm:.2f} +- {drift.se:.2f} ppm, "
            f"more than {largest_ppm:g}: B and I would be wrong; "
            "synchronise the clocks, or record both channels with one device"
        )
