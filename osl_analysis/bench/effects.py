"""Effects as columns beside the physics of the joint: lag, drifting clocks, friction, a changing
stiffness.

A model (Eq. 15, Eq. 4) names its columns; an effect is one more. All of it is algebra on the Gram
matrices of groups (group_sums.py).

Friction that is left out passes for a lag and for a changing stiffness. Faults of a recording are
found by the inference (joint_inference.py), or by the belt of a leg."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.bench.group_fit import GroupFit, fit_groups
from osl_analysis.bench.group_interval import combined
from osl_analysis.bench.group_sums import EFFECTS_LIMIT, NEXT, Sums, gram_sums, solved
from osl_analysis.bench.record import Record, actuator_turns
from osl_analysis.bench.row_groups import Label
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.inference.friction_shapes import slipping_spring
from osl_analysis.model.drivetrain import DrivetrainParameters, belt_deflection
from osl_analysis.signals import seven_point_motion
from osl_analysis.signals.clock_drift import NO_DRIFT, drift_row
from osl_analysis.stats.regression import CONDITION_LIMIT, Row, welch_satterthwaite
from osl_analysis.trial import Array

Admittance = Callable[[NDArray[np.complex128]], NDArray[np.complex128]]
"""theta/torque [rad/(N*m)] of a model, for complex s [rad/s]."""
Model = Mapping[str, str]  # estimate -> column of `sums_of`
Keep = NDArray[np.bool_] | Label
"""The groups to keep (m,), those of a label, or all (None)."""
# Eq. 15
IMPEDANCE: Model = {"K": "theta", "B": "omega", "I": "alpha", "offset": "one", "drift": "ramp"}
# Eq. 4 without a belt
TRANSMISSION: Model = {"B_j": "omega", "J_j": "alpha", "offset": "one", "drift": "ramp"}
FEWEST_REPEATS = 3  # of one motion, by which a change with time differs from noise
FALSE_ALARM = 1e-3  # probability of a false alarm for one effect
LONGEST_LAG = 0.02  # s; the largest lag that is sought
LAG_FOUND = 1e-6  # s; last step of a search that has come to its end
LAG_CONVERGED = 1e-9  # s; the step after it would be a thousand times smaller
MOST_STEPS = 6  # of a search for a lag
POSSIBLE = 2.0  # standard errors by which an effect may exceed its estimate
# half-widths [rad] of the slipping springs that model a belt's hysteresis
WOUND_UP = (0.5e-3, 1.5e-3, 4e-3)
# SD [s] of a lag due to hysteresis that these do not model; simulated legs: 10 to 150
BELT_ERROR = 80e-6
# of the joint's angle: errors of encoders reach that, and a joint beside an idle motor is no leg
LEAST_DEFLECTION = 0.05
# of the file's K_s, beyond which the belt is another one
LEAST_K_S, LARGEST_K_S = 0.7, 1.4
OTHER_B_J = 3.0  # factor by which losses vary from joint to joint about the parameter file's
# the motion cannot tell effects apart
CANNOT_TELL = (IdentifiabilityError, InputError, np.linalg.LinAlgError)
SIGN_WIDTHS = {"T_C_sharp": 1e-3, "T_C": 1e-2}
"""Columns of Coulomb friction, by the velocity [rad/s] over which it changes sign; the larger is
ten times the velocity noise of 14 bits."""


def plain_sums(record: Record, model: Model) -> Sums:
    """The sums of a record without effects."""
    columns, centre = columns_of(record)
    return gram_sums(record, columns, list(model.values()), centre, rounded=record.rounded)


def columns_of(record: Record) -> tuple[dict[str, Array], float]:
    """The columns (n,) of the models by name, and the angle [rad] about which `theta` is
    centred."""
    motion = record.motion
    centre = float(record.part(motion.theta).mean())
    columns = {
        "theta": motion.theta - centre,
        "omega": motion.omega,
        "alpha": motion.alpha,
        "one": np.broadcast_to(1.0, motion.theta.shape),
        "ramp": record.time - record.time.mean(),
    }
    return columns, centre


def sums_of(record: Record, model: Model, expected: Admittance | None = None) -> Sums:
    """The sums of a coarse record with all effects; the arguments are those of `effect_columns`."""
    few = record.coarse
    columns, centre = effect_columns(record, expected)
    rich = [*model.values(), "jerk", "snap", "T_C"]
    sums = gram_sums(few, columns, rich, centre, rounded=record.rounded)
    return replace(sums, columns={})  # unused, and large


def effect_columns(
    record: Record, expected: Admittance | None = None
) -> tuple[dict[str, Array], float]:
    """The columns (n,) of models and effects of a coarse record, and the centre [rad] of `theta`.
    `expected` is the linear model's admittance, if the gains are known."""
    few = record.coarse
    columns, centre = columns_of(few)
    higher = seven_point_motion(few.time, columns["alpha"], few.rate_hz)
    columns["jerk"] = higher.omega
    columns["snap"] = higher.alpha
    for name, width in SIGN_WIDTHS.items():
        sign = np.tanh(record.swift_omega / width)
        columns[name] = few.low_pass(sign, few.rate_hz)
    if expected is not None:
        columns["linear"] = linear_torque(few, expected)
    return columns, centre


def linear_torque(record: Record, expected: Admittance) -> Array:
    """Torque (n,) [N*m] of the linear model with admittance `expected` for the filtered motion, up
    to three cut-offs. The record is extended by its mirror image to make it periodic."""
    n, theta = len(record.time), record.motion.theta - record.motion.theta.mean()
    mirrored = np.fft.rfft(np.concatenate([theta, theta[::-1]]))
    s = np.asarray(2j * np.pi * np.fft.rfftfreq(2 * n, 1 / record.rate_hz), dtype=np.complex128)
    kept = (np.abs(s) < 2 * np.pi * 3.0 * record.low_pass.cutoff_hz) & (s != 0)
    response = np.zeros(len(s), dtype=np.complex128)
    response[kept] = 1 / expected(s[kept])
    return np.asarray(np.fft.irfft(response * mirrored, 2 * n)[:n])


def noise_of_angle(record: Record) -> tuple[float, float, float]:
    """Variances of the noise of the filtered angle, and of its first and second derivative."""
    f = np.linspace(0, min(8 * record.low_pass.cutoff_hz, record.rate_hz / 2), 2000)
    passed = record.noise[0] * record.low_pass.gain(f) ** 2
    w = 2 * np.pi * f
    still, moving, turning = (float(np.trapezoid(w**k * passed, f)) for k in (0, 2, 4))
    return still, moving, turning


def with_effects(s: Sums, model: Model, effects: Sequence[str] = (), keep: Keep = None) -> GroupFit:
    """Fit of a model with effects, over some groups. Raises as `fit_groups`."""
    columns = dict(model)
    for effect in effects:
        # a weight acts as a spring: its torque grows with the angle
        columns[effect] = "theta" if effect == "weight" else effect
    limit = EFFECTS_LIMIT if effects else CONDITION_LIMIT
    return fit_groups(s, columns, keep, limit=limit)


def late_fit(
    few: Record,
    columns: Mapping[str, Array],
    model: Model,
    centre: float = 0.0,
    rest: Array | float = 0.0,
    no_estimates: frozenset[str] = frozenset(),
    rounded: Array | None = None,
    lag: float = 0.0,
    low_pass: bool = False,
) -> tuple[GroupFit, float]:
    """Fit a model to a torque that is late (Gauss-Newton).

    In each step the torque is advanced by the lag, or the low-pass of first order with this time
    constant is inverted. The slope of the torque is a column that gives the lag that remains. The
    slope is the model's, as far as its derivatives are columns: that of a noisy torque would pull
    the lag to 0. A model without derivatives uses the torque's own slope.

    Parameters
    ----------
    few
        A coarse record of n rows.
    columns
        Columns (n,) by name.
    model
        Column of each estimate.
    centre, no_estimates, rounded
        As `gram_sums` takes them.
    rest
        Part (n,) of the torque that is not late, and is subtracted [N*m].
    lag
        Where the search starts [s].
    low_pass
        Whether a low-pass is sought in place of a delay.

    Returns
    -------
    fit
        Its last estimate is the lag, `lag_s`.
    more
        Last step of the search [s].

    Raises
    ------
    InputError, IdentifiabilityError
        As `fit_groups`.
    """
    torque = scipy.interpolate.make_interp_spline(few.time, few.filtered_torque, 5)
    derivatives = {
        name: columns[NEXT[column]] for name, column in model.items() if NEXT.get(column) in columns
    }
    fit, more, slope = None, 0.0, np.zeros_like(few.time)
    for _ in range(MOST_STEPS):
        advance = 0.0 if low_pass else lag
        then = np.clip(few.time + advance, few.time[0], few.time[-1])
        earlier = (torque(then) if lag else few.filtered_torque) - rest
        if low_pass:
            earlier = earlier + lag * torque(few.time, 1)
        if not derivatives:
            slope = torque(then, 1)
        elif fit is not None:
            slope = np.sum([fit[name] * column for name, column in derivatives.items()], axis=0)

        is_late = bool(slope.any())  # not in the first step of a model with derivatives
        with_late = {**columns, "late": -slope}
        with_lag = {**model, "lag_s": "late"} if is_late else model
        made = replace(few, filtered_torque=earlier, torque=earlier)
        sums = gram_sums(made, with_late, list(columns), centre, no_estimates, rounded)
        fit = fit_groups(sums, with_lag, limit=EFFECTS_LIMIT)
        more = fit["lag_s"] if is_late else 0.0
        lag = float(np.clip(lag + more, -LONGEST_LAG, LONGEST_LAG))
        if is_late and abs(more) < LAG_CONVERGED:
            break
    assert fit is not None
    return replace(fit, estimates=np.append(fit.estimates[:-1], lag)), more


@dataclass(frozen=True)
class Fault:
    """Size of a fault of a recording."""

    size: float  # in its unit
    se: float  # its standard error
    found: bool  # whether it is certain
    possible: float  # largest size that may be present without being found


def is_certain(size: float, se: float, freedom: float) -> bool:
    """Whether a size differs from 0 by a two-sided test at the level `FALSE_ALARM`."""
    return abs(size) > float(scipy.special.stdtrit(freedom, 1 - FALSE_ALARM / 2)) * se


@dataclass(frozen=True)
class Belt:
    """The belt between theta_m and the joint, by a leg's recording."""

    K_s: float  # [N*m/rad]
    # lag [s] of the torque behind the joint's angle; None: the belt is not the file's
    torque: Fault | None = None
    theta_m: Fault | None = None  # the same of theta_m


def is_leg(record: Record, p: DrivetrainParameters | None) -> bool:
    """Whether a drivetrain renders the joint: its motor turns, and winds up the belt. A joint
    beside an idle motor is no leg. Without a parameter file the motor's turning has to do."""
    if p is None or "theta_m" not in record.actuator:
        return actuator_turns(record)
    few = record.coarse
    theta_m = few.actuator["theta_m"]
    deflection = belt_deflection(few.motion.theta, theta_m, p)
    least = LEAST_DEFLECTION * float(np.std(few.part(few.motion.theta)))
    motor_turns = float(np.std(few.part(theta_m / p.n_T))) >= least
    belt_is_wound = float(np.std(few.part(deflection))) >= least
    return motor_turns and belt_is_wound


def belt_of_leg(record: Record, p: DrivetrainParameters | None) -> Belt | None:
    """The belt of a leg, and what it tells of lags.

    Whatever controller and friction do, torque - J_j alpha - B_j omega is the belt's torque (Eq.
    4): a spring with slipping springs over theta - theta_m/n_T. A late theta_m looks like a smaller
    B_j, so that B_j is free while it agrees with the file's; a wrong B_j then makes no lag.
    Otherwise either theta_m is late and B_j the file's, or B_j differs and theta_m is on time. If
    the joint may have that B_j, a lag that depends on this choice is not found.

    Returns
    -------
    Belt or None
        None without a parameter file or theta_m, of a joint that is no leg, or where the motion
        cannot tell.
    """
    if p is None or "theta_m" not in record.actuator or not is_leg(record, p):
        return None
    few = record.coarse
    theta_m = few.actuator["theta_m"]
    columns = belt_columns(few, belt_deflection(few.motion.theta, theta_m, p))
    try:
        return belt_from(few, columns, theta_m, p)
    except CANNOT_TELL:
        return None


def belt_columns(few: Record, wound: Array) -> dict[str, Array]:
    """Columns (n,) of the belt's torque for its deflection (n,) [rad]."""
    columns, _ = columns_of(few)
    del columns["theta"], columns["alpha"]
    columns["wound"] = wound - wound.mean()
    slips = np.array([slipping_spring(wound, width) for width in WOUND_UP])
    for k, column in enumerate(few.low_pass(slips.T, few.rate_hz).T):
        columns[f"slips_{k}"] = column
    return columns


def belt_from(
    few: Record, columns: Mapping[str, Array], theta_m: Array, p: DrivetrainParameters
) -> Belt:
    """The belt by fits to columns (n,). Raises as `fit_groups`."""
    # the torque per velocity of the joint is B_j
    fit = belt_fit(few, columns, p, known_B_j=0.0)
    K_s, B_j = fit["wound"], fit["omega"]
    if not LEAST_K_S < K_s / p.K_s < LARGEST_K_S:
        return Belt(K_s)
    torque_late = lag_of(fit)
    motor_late = fault((p.B_j - B_j) / K_s, fit.se("omega") / K_s, fit.freedom("omega"))
    if not motor_late.found:
        return Belt(K_s, torque_late, motor_late)

    # B_j is the file's, and the torque per velocity of the motor is its lag
    of_motor = {**columns, "omega": np.gradient(theta_m, 1 / few.rate_hz) / p.n_T}
    fit = belt_fit(few, of_motor, p, known_B_j=p.B_j)
    K_s_on_time = fit["wound"]
    lag = -fit["omega"] / K_s_on_time
    lag_se = fit.se("omega") / K_s_on_time
    motor_late = fault(lag, lag_se, fit.freedom("omega"))
    otherwise, torque_late = torque_late, lag_of(fit)
    agree = otherwise.found and otherwise.size * torque_late.size > 0
    joint_may_have_B_j = p.B_j / OTHER_B_J < B_j < p.B_j * OTHER_B_J
    is_found = torque_late.found and (agree or not joint_may_have_B_j)
    return Belt(K_s, replace(torque_late, found=is_found), motor_late)


def belt_fit(
    few: Record, columns: Mapping[str, Array], p: DrivetrainParameters, known_B_j: float
) -> GroupFit:
    """Fit the belt's columns to what joint inertia and a known damping leave of the torque."""
    rest = p.J_j * few.motion.alpha + known_B_j * few.motion.omega
    return late_fit(few, columns, {name: name for name in columns}, rest=rest)[0]


def lag_of(fit: GroupFit) -> Fault:
    return fault(fit["lag_s"], fit.se("lag_s"), fit.freedom("lag_s"))


def fault(size: float, se: float, freedom: float) -> Fault:
    """A lag [s] with its standard error, to which that by the belt's hysteresis is added."""
    se = float(np.hypot(se, BELT_ERROR))
    return Fault(size, se, is_certain(size, se, freedom), abs(size) + POSSIBLE * se)


def changes_of_repeats(
    s: Sums, model: Model, effects: Mapping[str, Mapping[str, float]]
) -> GroupFit | None:
    """Sizes of effects that grow with time, from differences between repeats of one motion.

    Each stratum has its own misfit, whatever the joint is. Time is the group's. A score is the
    product of column and residual in a group, less the mean of its stratum.

    Parameters
    ----------
    s
        Sums of m groups.
    model
        Column of each estimate.
    effects
        Each as a combination of columns, by its name.

    Returns
    -------
    GroupFit or None
        Its estimates are sizes per time [1/s]. None if no stratum has three repeats.
    """
    stratum = s.groups.stratum
    members = np.bincount(stratum)
    if members.max() < FEWEST_REPEATS:
        return None
    base = with_effects(s, model)
    q, one = s.torque, s.names.index("one")
    of_model = s.index(list(model.values()))
    combination = np.array([[part.get(name, 0.0) for part in effects.values()] for name in s.names])

    # a slow disturbance is an offset of a group
    mean = s.gram[:, one] / s.gram[:, one, one][:, None]
    about_mean = s.gram - mean[:, :, None] * s.gram[:, one][:, None]
    products = combination.T @ about_mean[:, :q, :q] @ combination
    modelled = about_mean[:, :q][:, :, of_model] @ base.estimates
    scores = (about_mean[:, :q, q + 1] - modelled) @ combination

    def by_stratum(values: Array) -> Array:
        """Sums (strata, ...) of values (m, ...)."""
        total = np.zeros((len(members), *values.shape[1:]))
        np.add.at(total, stratum, values)
        return total

    scores = scores - (by_stratum(scores).T / members).T[stratum]
    middle = (s.groups.first + s.groups.stop) / 2 / s.rate_hz
    since_mean = middle - (by_stratum(middle) / members)[stratum]
    weighted = products * (since_mean**2)[:, None, None]
    estimates, inverse = solved(weighted.sum(axis=0), since_mean @ scores)

    grown = np.einsum("mpq,q,m->mp", products, estimates, since_mean)
    rest = since_mean[:, None] * (scores - grown) @ inverse
    taken = np.einsum("spq,qp->s", by_stratum(weighted), inverse)  # freedom of the slopes
    free = members - 1 - taken
    rest *= np.sqrt(members / np.maximum(free, 0.5))[stratum, None]
    noise = rest.T @ rest
    freedom = welch_satterthwaite(by_stratum(rest**2), np.maximum(free, 0.5))
    sums = by_stratum(rest)
    misfit = sums.T @ sums * len(members) / max(len(members) - 1, 1)
    covariance, degrees = combined(noise, freedom, misfit, len(members))
    return replace(
        base,
        names=tuple(effects),
        estimates=estimates,
        covariance=covariance,
        degrees_of_freedom=degrees,
    )


def repeats_row(record: Record, s: Sums, model: Model) -> Row:
    """What repeats of one motion show for any joint.

    If the torque's clock gains, its torque gets later and later: at time t it is that of t - ppm (t
    - mean t), which to first order adds -ppm (t - mean t) dtorque/dt. A constant offset between
    clocks is not seen.

    Returns
    -------
    dict
        `K_drift`, the relative change of K from the first to the last fitted row beyond noise, and
        the drift of the torque's clock against the angle's [ppm]. Null if nothing repeats; the
        drift also if one device recorded both.

    Raises
    ------
    InputError
        The drift is certain and larger than the settings allow; the message names the trial.
    """
    row: Row = {"K_drift": None, **NO_DRIFT}
    fit = with_effects(s, model)
    if not s.groups.repeat:
        return row
    slope = {NEXT[column]: -1e-6 * fit[name] for name, column in model.items() if column in NEXT}
    try:
        growing = changes_of_repeats(s, model, {"K_within": {"theta": 1.0}, "ppm": slope})
    except IdentifiabilityError:
        return row
    if growing is None:
        return row
    if "K" in model:
        change, se = s.seconds * growing["K_within"], s.seconds * growing.se("K_within")
        one_sided = float(scipy.special.stdtrit(growing.freedom("K_within"), 1 - FALSE_ALARM))
        beyond_noise = max(abs(change) - one_sided * se, 0.0)
        row["K_drift"] = float(np.sign(change)) * beyond_noise / fit["K"]
    if record.two_clocks:
        drift = clocks_row(record, growing["ppm"], growing.se("ppm"), growing.freedom("ppm"))
        row.update(drift)
    return row


def clocks_row(record: Record, ppm: float, error: float, freedom: float) -> Row:
    """The drift between the clocks of two devices [ppm].

    Raises
    ------
    InputError
        It certainly exceeds the settings' limit.
    """
    largest = record.settings.time_base.largest_drift_ppm if record.settings else np.inf
    try:
        return dict(drift_row(ppm, error, freedom, largest))
    except InputError as problem:
        raise InputError(f"trial {record.name}: {problem}") from problem
