"""A lag of the torque behind the angle beside any model, and what the belt of a leg tells of lags
of the torque and of theta_m."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
import scipy

from osl_analysis.bench.record import Record
from osl_analysis.bench.regression import (
    EFFECTS_LIMIT,
    FALSE_ALARM,
    GroupFit,
    Model,
    columns_of,
    fit_groups,
    gram_sums,
)
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.inference.friction_shapes import slipping_springs
from osl_analysis.model.drivetrain import DrivetrainParameters, belt_deflection
from osl_analysis.stats.estimates import INTERVAL_ENDS
from osl_analysis.trial import Array

NEXT = {"theta": "omega", "omega": "alpha", "alpha": "jerk"}  # derivative of each column
LONGEST_LAG = 0.02  # s; the largest lag that is sought
LAG_FOUND = 1e-6  # s; last step of a search that has come to its end
LAG_CONVERGED = 1e-9  # s; the step after it would be a thousand times smaller
# of a search for a lag: four shrink from 20 ms below `LAG_CONVERGED`, as each is about a thousandth
# of the one before; one is to spare
MOST_STEPS = 5
# half-widths [rad] of the slipping springs that model a belt's hysteresis
WOUND_UP = (0.5e-3, 1.5e-3, 4e-3)
# the same for friction of the joint, beyond the belt: bristles and seals; and velocities [rad/s]
# over which sliding friction changes its sign
BRISTLES = (1.5e-4, 5e-4, 1.5e-3, 5e-3, 1.5e-2)
SLIDES = np.array([[0.01], [0.05]])
# SD [s] of a lag due to hysteresis that these do not model; simulated legs: 10 to 150
BELT_ERROR = 80e-6
# of the joint's angle: errors of encoders reach that, and a joint beside an idle motor is no leg
LEAST_DEFLECTION = 0.05
# of the file's K_s, beyond which the belt is another one
LEAST_K_S = 0.7
LARGEST_K_S = 1.4
OF_JOINT = ("theta", "alpha")  # columns that the belt's torque has no part of
OTHER_B_J = 3.0  # factor by which losses vary from joint to joint about the parameter file's
# the motion cannot tell effects apart
CANNOT_TELL = (IdentifiabilityError, InputError, np.linalg.LinAlgError)


def late_fit(
    few: Record,
    columns: Mapping[str, Array],
    model: Model,
    prompt_torque: Array | float = 0.0,
    lag_s: float = 0.0,
) -> tuple[GroupFit, bool]:
    """Fit a model to a torque that is late (Gauss-Newton).

    In each step the torque is advanced by the lag that is known so far. The slope of the torque is
    a column, which gives the lag that remains. The slope is the model's, as far as its derivatives
    are columns: that of a noisy torque would pull the lag to 0. It needs estimates, so that the
    first step is a fit without a lag. A model without derivatives uses the torque's own slope.

    Parameters
    ----------
    few : Record
        A coarse record of n rows.
    columns : Mapping of Array (n,)
        Columns by name.
    model : Mapping
        Column of each estimate.
    prompt_torque : Array (n,) or float
        Part of the torque that is not late, and is subtracted [N*m].
    lag_s : float
        Where the search starts [s].

    Returns
    -------
    fit : GroupFit
        Its last estimate is the lag, `lag_s` [s].
    has_ended : bool
        Whether the search has come to its end.

    Raises
    ------
    InputError, IdentifiabilityError
        As `fit_groups`.
    """
    torque_at = scipy.interpolate.make_interp_spline(few.time, few.filtered_torque, 5)
    derivatives = {
        name: columns[NEXT[column]] for name, column in model.items() if NEXT.get(column) in columns
    }

    def fit_at(times: Array, slope: Mapping[str, Array]) -> GroupFit:
        """The model, with the torque's slope if it is given, for the torque at other times."""
        torque = torque_at(times) - prompt_torque
        advanced = replace(few, filtered_torque=torque, torque=torque)
        sums = gram_sums(advanced, {**columns, **slope})
        with_lag = {**model, "lag_s": "late"} if slope else model
        return fit_groups(sums, with_lag, EFFECTS_LIMIT)

    times = np.clip(few.time + lag_s, few.time[0], few.time[-1])
    fit = fit_at(times, {})
    for _ in range(MOST_STEPS):
        slope = torque_at(times, 1)
        if derivatives:
            slope = np.sum([fit[name] * column for name, column in derivatives.items()], axis=0)
        fit = fit_at(times, {"late": -slope})
        step_s = fit["lag_s"]
        lag_s = np.clip(lag_s + step_s, -LONGEST_LAG, LONGEST_LAG)
        times = np.clip(few.time + lag_s, few.time[0], few.time[-1])
        if abs(step_s) < LAG_CONVERGED:
            break
    with_lag = np.append(fit.estimates[:-1], lag_s)
    return replace(fit, estimates=with_lag), abs(step_s) <= LAG_FOUND


@dataclass(frozen=True)
class Lag:
    """A lag of the torque behind the joint's angle."""

    seconds: float  # [s]
    half_width: float  # of its 95 % interval [s]
    is_certain: bool  # whether it differs from 0

    @classmethod
    def of(cls, fit: GroupFit) -> "Lag":
        """The lag `lag_s` of a fit, with the error by the belt's hysteresis; it is certain by a
        two-sided test at the level `FALSE_ALARM`."""
        se = np.hypot(fit.se("lag_s"), BELT_ERROR)
        quantiles = scipy.special.stdtrit(fit.freedom("lag_s"), [0.975, 1 - FALSE_ALARM / 2])
        half_width, least = (se * quantiles).tolist()
        return cls(fit["lag_s"], half_width, abs(fit["lag_s"]) > least)


@dataclass(frozen=True)
class Belt:
    """The belt between theta_m and the joint, by a leg's recording."""

    K_s_ratio: float | None = None  # K_s over the parameter file's; None: not told
    lag: Lag | None = None  # None: the belt is not the file's, or the search has not ended


def without_lag(lag_s: pl.Expr, half_width_s: pl.Expr) -> list[pl.Expr]:
    """B and I of the torque earlier by a lag, with 95 % intervals, of a table with K, B and I.

    exp(s d) (K + B s + I s^2) = K + (B + K d) s + (I + B d + K d^2/2) s^2 to second order.
    """
    K, B, I = pl.col("K"), pl.col("B"), pl.col("I")
    earlier_B = B + K * lag_s
    earlier_I = I + B * lag_s + K * lag_s**2 / 2
    columns = []
    for name, value, per_second in (("B", earlier_B, K), ("I", earlier_I, earlier_B)):
        of_fit = (pl.col(f"{name}_high") - pl.col(f"{name}_low")) / 2
        half_width = (of_fit**2 + (per_second * half_width_s) ** 2).sqrt()
        bounds = (value, value - half_width, value + half_width)
        for end, bound in zip(INTERVAL_ENDS, bounds, strict=True):
            columns.append(bound.alias(f"{name}_without_lag{end}"))
    return columns


def is_leg(record: Record, p: DrivetrainParameters | None) -> bool:
    """Whether a drivetrain renders the joint: its motor turns, and winds up the belt. A joint
    beside an idle motor is no leg. Without a parameter file the motor's turning has to do."""
    few = record.coarse
    theta_m = few.actuator.get("theta_m")
    if theta_m is None:
        return False
    theta = few.motion.theta
    angles = [theta, theta_m]
    if p is not None:
        angles = [theta, theta_m / p.n_T, belt_deflection(theta, theta_m, p)]
    whole, *others = np.std(np.array(angles)[:, few.is_fitted()], axis=1)
    return bool(min(others) >= LEAST_DEFLECTION * whole)


def belt_of_leg(record: Record, p: DrivetrainParameters) -> Belt:
    """The belt of a leg, and what it tells of lags.

    Whatever the controller and the actuator's friction do, torque - J_j alpha - B_j omega is the
    belt's torque (Eq. 4), a spring with slipping springs over theta - theta_m/n_T, and friction of
    the joint, which would pass for a lag of a millisecond. A late theta_m looks like a smaller
    B_j, so that B_j is free while it agrees with the file's; a wrong B_j then makes no lag.
    Otherwise either theta_m is late and B_j the file's, or B_j differs and theta_m is on time. If
    the joint may have that B_j, a lag that depends on this choice is not found.

    Returns
    -------
    Belt
        Nothing is told where the motion cannot tell it.
    """
    few = record.coarse
    motion = few.motion
    theta_m = few.actuator["theta_m"]
    wound = belt_deflection(motion.theta, theta_m, p)
    of_belt = slipping_springs(wound, WOUND_UP)
    of_joint = slipping_springs(motion.theta, BRISTLES)
    slips = np.vstack([of_belt, of_joint, np.tanh(motion.omega / SLIDES)])
    slips = few.settings.low_pass(slips.T, few.rate_hz).T
    columns = {name: column for name, column in columns_of(few).items() if name not in OF_JOINT}
    columns |= {"wound": wound - wound.mean(), **{f"slips_{k}": x for k, x in enumerate(slips)}}
    model = {name: name for name in columns}
    belt = Belt()
    with suppress(*CANNOT_TELL):
        # the torque per velocity of the joint is B_j
        of_inertia = p.J_j * motion.alpha
        fit, has_ended = late_fit(few, columns, model, prompt_torque=of_inertia)
        K_s = fit["wound"]
        B_j = fit["omega"]
        belt = Belt(K_s / p.K_s)
        if not (LEAST_K_S < K_s / p.K_s < LARGEST_K_S and has_ended):
            return belt
        lag = Lag.of(fit)
        of_motor = fit.derived({"lag_s": ((p.B_j - B_j) / K_s, {"omega": -1 / K_s})})
        if not Lag.of(of_motor).is_certain:
            return replace(belt, lag=lag)

        # B_j is the file's, and the torque per velocity of the motor is its lag
        of_losses = of_inertia + p.B_j * motion.omega
        columns["omega"] = np.gradient(theta_m, 1 / few.rate_hz) / p.n_T
        fit, has_ended = late_fit(few, columns, model, prompt_torque=of_losses)
        if has_ended:
            otherwise = Lag.of(fit)
            agree = lag.is_certain and lag.seconds * otherwise.seconds > 0
            joint_may_have_B_j = p.B_j / OTHER_B_J < B_j < p.B_j * OTHER_B_J
            is_certain = otherwise.is_certain and (agree or not joint_may_have_B_j)
            belt = replace(belt, lag=replace(otherwise, is_certain=is_certain))
    return belt
