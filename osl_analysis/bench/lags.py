# SPDX-License-Identifier: Apache-2.0
"""A lag of the torque behind the angle beside any model, and what the belt of a leg tells of lags
of the torque and of theta_m."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import scipy

from osl_analysis.base.errors import IdentifiabilityError, InputError
from osl_analysis.base.trial import Array
from osl_analysis.bench.record import Record
from osl_analysis.bench.regression import (
    EFFECTS_LIMIT,
    TRANSMISSION,
    Model,
    columns_of,
    gram_sums,
    least_squares,
)
from osl_analysis.inference.spectra import slipping_springs
from osl_analysis.model.drivetrain import DrivetrainParameters, belt_deflection
from osl_analysis.signals.filters import seven_point_motion
from osl_analysis.stats.linear_fit import LinearFit
from osl_analysis.stats.sources import Source

LONGEST_LAG = 0.02  # s; the largest lag that is sought
SEARCH_ROUNDING = 1e-7  # s; a smaller step of a search ends it: the next is an eighth or less
# of a search for a lag, of which each is half of the one before or less; of most an eighth
MOST_LAG_STEPS = round(np.log2(LONGEST_LAG / SEARCH_ROUNDING))
# half-widths [rad] of the slipping springs that model a belt's hysteresis, and friction of the
# joint beyond the belt: bristles and seals
WINDS = np.geomspace(1.5e-4, 1.5e-2, 5).tolist()
# the same of sliding friction: velocities [rad/s] over which it changes its sign
SLIDES = np.array([[0.01], [0.05]])
# SD [s] of a lag due to hysteresis that these do not model; simulated legs: 10 to 310, as of a
# rectangular distribution
BELT_ERROR = 180e-6
LEAST_BELT_SHARE = 0.1  # of this error: what a fit has beside it
# of the joint's angle: errors of encoders reach that, and a joint beside an idle motor is no leg
LEAST_DEFLECTION = 0.05
OTHER_K_S = 1.4  # of the file's K_s, or 1 over it, beyond which the belt is another one
ERROR_OF_J_J = 0.1  # SD of the file's J_j, as a share: drawings leave out screws and cables
OTHER_B_J = 3.0  # factor by which losses vary from joint to joint about the parameter file's
# the motion cannot tell effects apart
CANNOT_TELL = (IdentifiabilityError, InputError, np.linalg.LinAlgError)


def late_fit(
    coarse: Record, columns: Mapping[str, Array], model: Model, drifts: bool = False
) -> tuple[LinearFit, bool]:
    """Fit a model to a torque that is late (Gauss-Newton).

    In each step the torque is advanced by the lag that is known so far. The slope of the torque is
    a column, which gives the lag that remains. From the second step on it is that of the model's
    torque: that of a noisy torque would pull the lag to 0.

    Parameters
    ----------
    coarse : Record
        A coarse record of n rows.
    columns : Mapping of Array (n,)
        Columns by name.
    model : Mapping
        Column of each estimate.
    drifts : bool
        Whether the lag goes on with time, as between two clocks. Without the drift, friction and
        damping take its place. The lag is then the mean over the fitted rows.

    Returns
    -------
    fit : LinearFit
        Its last estimates are the `clock_drift`, if any, and the lag, `lag_s` [s].
    has_ended : bool
        Whether the search has come to its end.

    Raises
    ------
    InputError, IdentifiabilityError
        As `least_squares`.
    """
    of_model = np.column_stack([columns[name] for name in model.values()])
    shapes = {"lag_s": columns["one"]}
    if drifts:
        shapes = {"clock_drift": columns["ramp"], **shapes}
    late_model = {**model, **{name: name for name in shapes}}
    lags = np.zeros(len(shapes))
    torque_at = scipy.interpolate.make_interp_spline(coarse.time, coarse.filtered_torque, k=5)
    modelled = coarse.filtered_torque
    for _ in range(MOST_LAG_STEPS):
        lag = lags @ np.array([*shapes.values()])
        torque = torque_at(np.clip(coarse.time + lag, coarse.time[0], coarse.time[-1]))
        in_time = replace(coarse, filtered_torque=torque, torque=torque)
        slope = seven_point_motion(modelled, coarse.rate_hz).omega
        late = {name: -slope * shape for name, shape in shapes.items()}
        fit = least_squares(gram_sums(in_time, {**columns, **late}), late_model, EFFECTS_LIMIT)
        modelled = of_model @ fit.estimates[: len(model)]
        lags = np.clip(lags + fit.estimates[len(model) :], -LONGEST_LAG, LONGEST_LAG)
        has_ended = abs(fit["lag_s"]) < SEARCH_ROUNDING
        if has_ended:
            break
    estimates = np.append(fit.estimates[: len(model)], lags)
    return replace(fit, estimates=estimates), has_ended


@dataclass(frozen=True)
class Belt:
    """The belt between theta_m and the joint, by a leg's recording."""

    K_s_ratio: float | None = None  # K_s over the parameter file's; None: not told
    # `lag_s` of the torque behind the joint's angle [s]; None: no belt is seen, it is not the
    # file's, or no search has ended
    lag: LinearFit | None = None


def is_leg(record: Record, p: DrivetrainParameters | None, is_of_gains: bool) -> bool:
    """Whether a drivetrain renders the joint: its motor turns, and winds up the belt. A joint
    beside an idle motor is no leg. Without a parameter file the motor's turning has to do, and
    without `theta_m` that Eq. 9 with gains leaves less than Eq. 15 (`is_of_gains`)."""
    coarse = record.coarse
    theta_m = coarse.actuator.get("theta_m")
    if theta_m is None:
        return is_of_gains
    theta = coarse.motion.theta
    angles = [theta, theta_m]
    if p is not None:
        angles = [theta, theta_m / p.n_T, belt_deflection(theta, theta_m, p)]
    whole, *others = np.std(np.array(angles)[:, coarse.is_fitted()], axis=1)
    return bool(min(others) >= LEAST_DEFLECTION * whole)


def fit_belt(
    coarse: Record, p: DrivetrainParameters, theta_m_late_s: float = 0.0
) -> tuple[LinearFit, bool]:
    """Fit the belt of a leg.

    Whatever the controller and the actuator's friction do, torque - J_j alpha - B_j omega is the
    belt's torque (Eq. 4), a spring with slipping springs over theta - theta_m/n_T, and friction of
    the joint, which would pass for a lag of a millisecond. K_s and B_j are free, and J_j about the
    file's: taken as exact, one that is a tenth off would make 0.3 ms. The covariance holds what
    hysteresis of other shapes does, the more, the less the motion tells the lag from J_j.

    Returns
    -------
    fit : LinearFit
        With `K_s`, `B_j`, `J_j` and `lag_s`.
    has_ended : bool
        As `late_fit`, whose errors it raises.
    """
    motion = coarse.motion
    theta_m = np.interp(coarse.time + theta_m_late_s, coarse.time, coarse.actuator["theta_m"])
    wound = belt_deflection(motion.theta, theta_m, p)
    of_belt = slipping_springs(wound, WINDS)
    of_joint = slipping_springs(motion.theta, WINDS)
    slips = np.vstack([of_belt, of_joint, np.tanh(motion.omega / SLIDES)])
    slips = coarse.settings.low_pass(slips.T, coarse.rate_hz).T
    of_slips = {f"slips_{k}": torque for k, torque in enumerate(slips)}
    columns = {**columns_of(coarse), "theta": wound - wound.mean(), **of_slips}
    model = {"K_s": "theta", **TRANSMISSION, **{name: name for name in of_slips}}
    fit, has_ended = late_fit(coarse, columns, model)
    k = fit.names.index("J_j")
    of_J_j = fit.covariance[k]
    # of the lag if J_j were known; of few units rounding may leave less than nothing
    known = fit.covariance[-1, -1] - of_J_j[-1] ** 2 / of_J_j[k]
    variance = max(known, (LEAST_BELT_SHARE * BELT_ERROR) ** 2)
    fit = replace(fit, covariance=fit.covariance * (1 + BELT_ERROR**2 / variance))
    if np.isfinite(p.J_j):
        # of minimum variance beside the file's
        of_J_j = fit.covariance[k]
        gain = of_J_j / (of_J_j[k] + (ERROR_OF_J_J * p.J_j) ** 2)
        estimates = fit.estimates + gain * (p.J_j - fit["J_j"])
        covariance = fit.covariance - np.outer(gain, of_J_j)
        fit = replace(fit, estimates=estimates, covariance=covariance)
    return fit, has_ended


def belt_of_leg(record: Record, p: DrivetrainParameters) -> Belt:
    """The belt of a leg, and what it tells of lags.

    A theta_m that is late by d takes K_s d off B_j, and d off the lag. While the joint may have the
    B_j that is found, theta_m is on time, or off by its difference from the file's over K_s
    at most; without a B_j of the file, from 0. Otherwise B_j is the file's, and theta_m late.

    Parameters
    ----------
    record : Record
        Of a leg (`is_leg`).
    p : DrivetrainParameters
        n_T, and what else is known.

    Returns
    -------
    Belt
        Nothing is told where the motion cannot tell it.
    """
    coarse = record.coarse
    belt = Belt()
    with suppress(*CANNOT_TELL):
        fit, has_ended = fit_belt(coarse, p)
        K_s = fit["K_s"]
        if fit.half_width("K_s") > (OTHER_K_S - 1) * abs(K_s):
            return belt  # which slow or small motion does not tell from its hysteresis
        if np.isfinite(p.K_s):
            belt = Belt(K_s / p.K_s)
            is_belt = 1 / OTHER_K_S < K_s / p.K_s < OTHER_K_S
        else:
            # a joint is softer than its belt
            wound = belt_deflection(coarse.motion.theta, coarse.actuator["theta_m"], p)
            is_belt = K_s > 0 and np.std(wound) < np.std(coarse.motion.theta)
        if not (is_belt and has_ended):
            return belt

        of_file = np.nan_to_num(p.B_j)
        late_s = (of_file - fit["B_j"]) / K_s
        low, high = fit.interval("B_j")
        lag_s = fit["lag_s"]
        of_lag = {"lag_s": 1.0}
        theta_m_error = abs(late_s) / np.sqrt(3)  # a rectangular distribution
        if high < of_file / OTHER_B_J or low > of_file * OTHER_B_J > 0:
            # B_j is the file's, and theta_m late
            fit, has_ended = fit_belt(coarse, p, late_s)
            if not (has_ended and of_file):
                return belt
            lag_s = fit["lag_s"] + (of_file - fit["B_j"]) / K_s
            of_lag["B_j"] = -1 / K_s
            theta_m_error = 0.0
        lag = fit.derived({"lag_s": (lag_s, of_lag)})
        # the covariance holds the belt's error, too, which is no scatter
        lag = replace(lag, covariance=np.maximum(lag.covariance - BELT_ERROR**2, 0.0))
        lag = lag.with_known_error(Source.BELT_ERROR, np.array([BELT_ERROR]))
        lag = lag.with_known_error(Source.THETA_M_DELAY, np.array([theta_m_error]))
        return replace(belt, lag=lag)
    return belt
