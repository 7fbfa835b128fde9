"""By how much the torque of a stepped sine lags the angle: a filter or a clock, and not friction."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.bench.frequency_response import Admittance, SegmentPhasors
from osl_analysis.bench.nonlinearity import Phasors, stacked
from osl_analysis.errors import OslAnalysisError
from osl_analysis.stats.fit_row import Row, lag_damping_row
from osl_analysis.stats.regression import LinearFit, linear_fit
from osl_analysis.trial import Array

CERTAIN_LAG = 10.0
"""Standard errors from which a lag is certain. They come from what the fit leaves, so that a lag is certain only if it
explains most of what a fit without it leaves. Friction and higher dynamics also leave something."""
LAG_STEPS = 5
"""Steps of Gauss and Newton to the lag; a lag of 5 ms is found to a nanosecond in four."""
LAG_CONDITION = 1e6
"""Largest scaled condition number: near 1000 with five frequencies, since a lag is nearly a damping."""
MUCH_BETTER = 5.0
"""A model of the joint decides alone if it leaves less than the other by this factor."""


@dataclass(frozen=True)
class TorqueLag:
    """By how much the torque lags the angle."""

    lag: float
    """Lag [s]; positive if the torque is late."""
    se: float
    """Its standard error [s], from what the fit leaves."""
    misfit: float
    """Standard deviation of what the fit leaves [N*m, at 1 Hz]."""


@dataclass(frozen=True)
class ImpedancePoints:
    """Measured impedances, shape (n,) each."""

    frequency_hz: Array
    """Frequency [Hz]."""
    theta: Array
    """Amplitude [rad]."""
    amplitude: Array
    """Commanded amplitude, in any unit: equal where the protocol's is."""
    impedance: Phasors
    """torque/theta [N*m/rad]."""


def torque_lag(points: ImpedancePoints, expected: Phasors) -> TorqueLag:
    """Lag of the torque behind the angle.

    `expected` (n,) are the impedances of the linear model with the same gains. A lag d multiplies the impedance by
    exp(-s d). This differs from a damping of -K d only in that B and I are turned, too. The joint is taken as a
    second-order system, or as the linear model with other K, B and I, whichever fits better together with a lag. Their
    higher dynamics differ by as much as a lag of milliseconds. Where neither fits much better than the other, the
    difference between their lags is part of the standard error.

    Raises
    ------
    InputError, IdentifiabilityError
        Too few points, or points that are too similar, to distinguish a lag from the rest.
    """
    better, worse = sorted((lag_beyond(points, base) for base in (0 * expected, expected)), key=lambda lag: lag.misfit)
    doubt = better.lag - worse.lag if worse.misfit < MUCH_BETTER * better.misfit else 0.0
    return replace(better, se=float(np.hypot(better.se, doubt)))


def lag_beyond(points: ImpedancePoints, base: Phasors) -> TorqueLag:
    """The lag d if the impedance is exp(-s d) (base + K + B s + I s^2) and Coulomb friction; raises as `torque_lag`.

    Every amplitude has a K of its own, so that a spring that stiffens is not taken for a lag. Coulomb friction T_C adds
    4j T_C/(pi theta), its describing function. A point weighs as its torque is known: as many cycles at each frequency.
    """
    s, weight = 2j * np.pi * points.frequency_hz, points.theta / np.sqrt(points.frequency_hz)
    shared = {"B": s, "I": s**2, "T_C": 4j / (np.pi * points.theta)}
    own = {f"K at {a:g}": (points.amplitude == a).astype(np.complex128) for a in np.unique(points.amplitude)}
    lag, y, columns = 0.0, np.empty(0), dict[str, Array]()
    for _ in range(LAG_STEPS):
        early = points.impedance * np.exp(s * lag)
        columns = {name: stacked(c * weight) for name, c in {**own, **shared, "lag": -s * early}.items()}
        y = stacked((early - base) * weight)
        lag += linear_fit(y, columns, condition_limit=LAG_CONDITION)["lag"]
    left = linear_fit(y, columns, condition_limit=LAG_CONDITION).residual
    X = np.column_stack(list(columns.values()))
    variance = float(left @ left) / (len(left) - X.shape[1])
    return TorqueLag(lag, float(np.sqrt(variance * np.linalg.inv(X.T @ X)[-1, -1])), float(np.sqrt(variance)))


def torque_lag_row(phasors: Sequence[SegmentPhasors], fit: LinearFit, expected: Admittance | None) -> Row:
    """`lag_damping_row` of the torque's lag, and `lag_share`, the share of B that a certain lag makes.

    `expected` is the admittance of the linear model, None where the gains are not known; `fit` is that of Eq. 15. All
    null where the lag cannot be estimated.
    """
    lag = None if expected is None else lag_of(phasors, expected)
    row = lag_damping_row(None, None, fit["K"])
    if lag is not None:
        row = lag_damping_row(lag.lag, lag.se, fit["K"], CERTAIN_LAG)
    certain = row["certain_lag_damping"]
    return {**row, "lag_share": abs(certain / fit["B"]) if isinstance(certain, float) else None}


def lag_of(phasors: Sequence[SegmentPhasors], expected: Admittance) -> TorqueLag | None:
    """The torque's lag; None where it cannot be estimated."""
    points = ImpedancePoints(
        np.array([s.frequency_hz for s in phasors]),
        np.array([abs(s.theta.value) for s in phasors]),
        np.array([s.amplitude_deg for s in phasors]),
        np.array([s.torque.value / s.theta.value for s in phasors]),
    )
    try:
        return torque_lag(points, 1 / expected(np.asarray(2j * np.pi * points.frequency_hz, dtype=np.complex128)))
    except OslAnalysisError:
        return None
