"""By how much the torque of a stepped sine lags the angle, from its phasors, as columns of `impedance.csv`."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from osl_analysis.bench.frequency_response import Admittance, SegmentPhasors
from osl_analysis.bench.torque_lag import (
    CERTAIN_BESIDE_NOISE,
    LAG,
    MUCH_BETTER,
    ONLY_NOISE,
    ImpedancePoints,
    TorqueLag,
    lag_beyond,
    torque_lag,
    yielding_frame,
)
from osl_analysis.errors import OslAnalysisError
from osl_analysis.stats.fit_row import Row, lag_damping_row
from osl_analysis.stats.regression import LinearFit

LARGEST_TURN = 0.2
"""Phase [rad] at the highest frequency, 6 ms at 5 Hz, beyond which a lag stands for other dynamics if no model is
known."""
ONCE_IN = 1e-3
"""Probability that noise alone leaves more than what counts as noise, beside which few phasors count for less."""
CERTAINLY_LESS = 3.0
"""Square root of the difference of two sums of squares, in noise, from which one fit leaves certainly less."""
UNSEEN = 0.1
"""Share of B that a lag may make without being certain, beyond which it is not known whether the torque is late."""
LITTLE_DAMPING, LITTLE_INERTIA = 2.0, 5e-3
"""B [N*m*s/rad] and I [kg*m^2] below which their shares say little; added in quadrature to what a share is taken of."""
OF_CERTAIN_LAG = ("lag_share", "lag_inertia_share", "frame_stiffness")
"""Columns of a lag that is certain."""


def torque_lag_row(phasors: Sequence[SegmentPhasors], fit: LinearFit, expected: Admittance | None) -> Row:
    """`lag_damping_row` of the torque's lag, `lag_share` and `lag_inertia_share`, the shares of B and I that a certain
    lag makes, and the `frame_stiffness` [N*m/rad] that explains a certain lag as well.

    `expected` is the admittance of the linear model, None where the gains are not known; `fit` is that of Eq. 15. All
    null where the lag cannot be estimated.
    """
    lag = lag_in_noise(phasors, fit) if expected is None else lag_of(phasors, expected)
    if lag is None:
        return {**lag_damping_row(None, None, fit["K"]), **dict.fromkeys(OF_CERTAIN_LAG)}
    row = lag_damping_row(lag.lag, lag.se, fit["K"], lag.certain_from(noise_of(phasors)))
    certain = bool(row["certain_lag_damping"])
    shares = lag_shares(lag.lag if certain else 0.0, fit)
    return {**row, **dict(zip(OF_CERTAIN_LAG, (*shares, lag.frame_stiffness if certain else None), strict=True))}


def lag_shares(lag: float, fit: LinearFit) -> tuple[float, float]:
    """Shares of B and of I that a lag [s] makes: exp(-s d) takes K d off B, and d times the joint's own B off I."""
    own_damping = fit["B"] + fit["K"] * lag
    return abs(fit["K"] * lag / fit["B"]), abs(own_damping * lag) / float(np.hypot(fit["I"], LITTLE_INERTIA))


def noise_of(phasors: Sequence[SegmentPhasors]) -> float:
    """RMS standard error of measured impedances, weighed as `lag_beyond` weighs them [N*m, at 1 Hz]."""
    variances = [
        (np.trace(s.torque.covariance) + abs(s.torque.value / s.theta.value) ** 2 * np.trace(s.theta.covariance))
        / (2 * s.frequency_hz)
        for s in phasors
    ]  # of torque/theta times |theta|, to first order
    return float(np.sqrt(np.mean(variances)))


def lag_of(phasors: Sequence[SegmentPhasors], expected: Admittance) -> TorqueLag | None:
    """The torque's lag; None where it cannot be estimated."""
    points = points_of(phasors)
    try:
        return torque_lag(points, 1 / expected(np.asarray(2j * np.pi * points.frequency_hz, dtype=np.complex128)))
    except OslAnalysisError:
        return None


def lag_in_noise(phasors: Sequence[SegmentPhasors], fit: LinearFit) -> TorqueLag | None:
    """The torque's lag where the gains are not known; None where it cannot be told.

    It is told of a second-order joint only, of which Eq. 15, Coulomb friction and a lag leave no more than the noise of
    the phasors. What a drivetrain leaves looks like a lag of 2 to 20 ms. That there is none is not told where one that
    makes much of B would not be certain.
    """
    noise, points = noise_of(phasors), points_of(phasors)
    found = smallest_lag(points, noise)
    if found is None:
        return None
    se = found.se * max(noise / found.misfit, 1.0)  # few phasors may leave less than their noise by chance
    unseen = abs(fit["K"]) * CERTAIN_BESIDE_NOISE * se / float(np.hypot(fit["B"], LITTLE_DAMPING))
    if unseen > UNSEEN and abs(found.lag) < CERTAIN_BESIDE_NOISE * se:
        return None
    frame = yielding_frame(points, np.zeros_like(points.impedance), MUCH_BETTER * found.misfit)
    return replace(found, se=se, frame_stiffness=frame)


def smallest_lag(points: ImpedancePoints, noise: float) -> TorqueLag | None:
    """The smallest lag beside which a second-order joint leaves the `noise` [N*m, at 1 Hz]; None if there is none.

    Up to the third power of s two lags explain the same torque, some ms apart; a larger one counts if it leaves
    certainly less. One that turns the fastest sine by more than `LARGEST_TURN` stands for other dynamics.
    """
    largest = LARGEST_TURN / (2 * np.pi * float(np.max(points.frequency_hz)))
    freedom = degrees_of_freedom(points)
    enough = max(ONLY_NOISE, float(np.sqrt(chdtri(freedom, ONCE_IN) / freedom))) * noise
    tried = [lag_from(points, start) for start in (0.0, largest, -largest)]
    sound = [one for one in tried if one is not None and one.misfit < enough and abs(one.lag) < largest]
    least = min((one.misfit for one in sound), default=0.0)
    alike = [one for one in sound if freedom * (one.misfit**2 - least**2) < (CERTAINLY_LESS * noise) ** 2]
    return min(alike, key=lambda one: abs(one.lag), default=None)


def lag_from(points: ImpedancePoints, start: float) -> TorqueLag | None:
    """The lag [s] of a second-order joint that is found from a start [s]; None if it is not found."""
    try:
        with np.errstate(all="ignore"):
            return lag_beyond(points, np.zeros_like(points.impedance), LAG, start)
    except (OslAnalysisError, np.linalg.LinAlgError):
        return None


def degrees_of_freedom(points: ImpedancePoints) -> int:
    """Numbers that are left when K of each amplitude, B, I, Coulomb friction and a lag are fitted to the points."""
    return 2 * len(points.theta) - len(np.unique(points.amplitude)) - 4


def points_of(phasors: Sequence[SegmentPhasors]) -> ImpedancePoints:
    """The impedances of phasors."""
    return ImpedancePoints(
        np.array([s.frequency_hz for s in phasors]),
        np.array([abs(s.theta.value) for s in phasors]),
        np.array([s.amplitude_deg for s in phasors]),
        np.array([s.torque.value / s.theta.value for s in phasors]),
    )
