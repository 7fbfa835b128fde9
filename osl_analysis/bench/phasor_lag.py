"""By how much the torque of a stepped sine lags the angle, from its phasors, as columns of `impedance.csv`."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from osl_analysis.bench.frequency_response import Admittance, SegmentPhasors
from osl_analysis.bench.torque_lag import (
    CERTAIN_BESIDE_NOISE,
    CERTAINLY_LESS,
    MUCH_BETTER,
    ONCE_IN,
    ONLY_NOISE,
    ImpedancePoints,
    TorqueLag,
    beside_others,
    lag_from,
    largest_lag,
    torque_lag,
    yielding_frame,
)
from osl_analysis.errors import OslAnalysisError
from osl_analysis.stats.fit_row import Row, lag_damping_row
from osl_analysis.stats.regression import LinearFit

UNSEEN = 0.1
"""Share of B or of I that a lag may make without being certain, beyond which it is not known whether the torque is
late."""
POSSIBLE = 2.0
"""Standard errors by which a lag may be larger than it is found."""
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
    return lag_row(lag, lag.certain_from(noise_of(phasors)), fit)


def lag_row(lag: TorqueLag, certain_from: float, fit: LinearFit) -> Row:
    """As `torque_lag_row`, of a lag that is certain from so many standard errors.

    Both shares are null where it is not certain, and might yet change I by more than `UNSEEN`. Where two lags explain
    the data, and none does not, the smaller one counts as certain, and its standard error contains their distance.
    """
    se = float(np.hypot(lag.se, lag.apart))
    row = {**lag_damping_row(lag.lag, lag.se, fit["K"], certain_from), "lag_se_s": se}
    if row["certain_lag_damping"]:
        return {**row, **dict(zip(OF_CERTAIN_LAG, (*lag_shares(lag.lag, fit), lag.frame_stiffness), strict=True))}
    possible = max(certain_from * lag.se, abs(lag.lag) + POSSIBLE * se)
    share = None if lag_shares(possible, fit)[1] > UNSEEN else 0.0
    return {**row, **dict(zip(OF_CERTAIN_LAG, (share, share, None), strict=True))}


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
        found = torque_lag(points, 1 / expected(np.asarray(2j * np.pi * points.frequency_hz, dtype=np.complex128)))
    except OslAnalysisError:
        return None
    return replace(found, se=se_in_noise(found, noise_of(phasors)))


def se_in_noise(found: TorqueLag, noise: float) -> float:
    """Standard error [s] of a lag in a `noise` [N*m, at 1 Hz]; few phasors may leave less than theirs by chance."""
    return found.se * max(noise / found.misfit, 1.0)


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
    se = se_in_noise(found, noise)
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
    largest = largest_lag(points)
    freedom = degrees_of_freedom(points)
    enough = max(ONLY_NOISE, float(np.sqrt(chdtri(freedom, ONCE_IN) / freedom))) * noise
    tried = [lag_from(points, np.zeros_like(points.impedance), start) for start in (0.0, largest, -largest)]
    sound = [one for one in tried if one is not None and one.misfit < enough and abs(one.lag) < largest]
    least = min((one.misfit for one in sound), default=0.0)
    alike = [one for one in sound if freedom * (one.misfit**2 - least**2) < (CERTAINLY_LESS * noise) ** 2]
    return beside_others(min(alike, key=lambda one: abs(one.lag)), alike) if alike else None


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
