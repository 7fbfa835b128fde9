"""Effects as columns beside the physics of the joint: lag, drifting clocks, friction, a changing
stiffness.

A model (Eq. 15, Eq. 4) names its columns; an effect is one more. All of it is algebra on the Gram
matrices of groups (gram.py).

Friction that is left out passes for a lag and for a changing stiffness. Faults of a recording are
found by the inference (joint_inference.py), or by the belt of a leg."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.bench import gram
from osl_analysis.bench.gram import GroupFit, Sums
from osl_analysis.bench.record import Label, Record
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
FALSE_ALARM = 1e-3  # probability of a false alarm for one effect
# largest lag [s] that is sought; last step [s] of a search that has converged
LONGEST_LAG, LAG_FOUND = 0.02, 1e-6
POSSIBLE = 2.0  # standard errors by which an effect may exceed its estimate
# half-widths [rad] of the slipping springs that model a belt's hysteresis
WOUND_UP = (0.5e-3, 1.5e-3, 4e-3)
# SD [s] of a lag due to hysteresis that these do not model; simulated legs: 10 to 150
BELT_ERROR = 80e-6
OTHER_B_J = 3.0  # factor by which losses vary from joint to joint about the parameter file's
# the motion cannot tell effects apart
CANNOT_TELL = (IdentifiabilityError, InputError, np.linalg.LinAlgError)
# rad/s over which friction changes sign; the larger is ten times the velocity noise of 14 bits
TURNS = (1e-3, 1e-2)


def plain_sums(record: Record, model: Model) -> Sums:
    """The sums of a record without effects."""
    columns, centre = columns_of(record)
    return gram.gram_sums(record, columns, list(model.values()), centre, rounded=record.rounded)


def columns_of(record: Record) -> tuple[dict[str, Array], float]:
    """The columns (n,) of the models by name, and the angle [rad] about which `theta` is
    centred."""
    motion, centre = record.motion, float(record.part(record.motion.theta).mean())
    columns = {"theta": motion.theta - centre, "omega": motion.omega, "alpha": motion.alpha}
    columns |= {
        "one": np.broadcast_to(1.0, motion.theta.shape),
        "ramp": record.time - record.time.mean(),
    }
    return columns, centre


def sums_of(record: Record, model: Model, expected: Admittance | None = None) -> Sums:
    """The sums of a coarse record with all effects; the arguments are those of `effect_columns`."""
    few = record.coarse
    columns, centre = effect_columns(record, expected)
    rich = [*model.values(), "jerk", "snap", "T_C"]
    sums = gram.gram_sums(few, columns, rich, centre, rounded=record.rounded)
    return replace(sums, columns={})  # unused, and large


def effect_columns(
    record: Record, expected: Admittance | None = None
) -> tuple[dict[str, Array], float]:
    """The columns (n,) of models and effects of a coarse record, and the centre [rad] of `theta`.
    `expected` is the linear model's admittance, if the gains are known."""
    few = record.coarse
    columns, centre = columns_of(few)
    higher = seven_point_motion(few.time, columns["alpha"], few.rate_hz)
    columns |= {"jerk": higher.omega, "snap": higher.alpha}
    signs = np.array([np.tanh(record.swift_omega / turn) for turn in TURNS])
    columns |= dict(zip(("T_C_sharp", "T_C"), few.low_pass(signs.T, few.rate_hz).T, strict=True))
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
    both = {**model, **{effect: {"weight": "theta"}.get(effect, effect) for effect in effects}}
    return gram.fit_groups(s, both, keep, limit=gram.EFFECTS_LIMIT if effects else CONDITION_LIMIT)


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
    """Fit of a model to a torque with a lag `lag_s`, and the last step of the search, which starts
    at `lag` (Gauss-Newton). A `rest` of the torque is not late and is subtracted. In each step the
    torque is advanced by the lag, or the `low_pass` of first order with this time constant is
    inverted; the slope of the torque is a column that gives the remaining lag. The slope is the
    model's, as far as its derivatives are columns: that of a noisy torque would pull the lag to 0.
    A model without derivatives uses the torque's own slope. Raises as `fit_groups`."""
    torque, first, last = (
        scipy.interpolate.make_interp_spline(few.time, few.filtered_torque, 5),
        *few.time[[0, -1]],
    )
    slopes = {
        name: columns[gram.NEXT[c]] for name, c in model.items() if gram.NEXT.get(c) in columns
    }
    fit, slope = None, np.zeros_like(few.time)
    for _ in range(6):
        then = np.clip(few.time + lag * (not low_pass), first, last)
        earlier = (torque(then) if lag else few.filtered_torque) - rest
        if low_pass:
            earlier = earlier + lag * torque(few.time, 1)
        made = replace(few, filtered_torque=earlier, torque=earlier)
        if not slopes:
            slope = torque(then, 1)
        elif fit is not None:
            slope = np.sum([fit[name] * column for name, column in slopes.items()], axis=0)
        both, with_lag = (
            {**columns, "late": -slope},
            {**model, "lag_s": "late"} if slope.any() else model,
        )
        sums = gram.gram_sums(made, both, list(columns), centre, no_estimates, rounded)
        fit = gram.fit_groups(sums, with_lag, limit=gram.EFFECTS_LIMIT)
        more = fit["lag_s"] if slope.any() else 0.0
        lag = float(np.clip(lag + more, -LONGEST_LAG, LONGEST_LAG))
        if slope.any() and abs(more) < 1e-9:  # s; the next step would be a thousand times smaller
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


def belt_of_leg(record: Record, p: DrivetrainParameters | None) -> Belt | None:
    """The belt of a leg. None without a parameter file or theta_m, or if the belt's deflection or
    theta_m is below 5 % of the joint's angle: errors of encoders reach that, and a joint beside an
    idle motor is no leg.

    Whatever controller and friction do, torque - J_j alpha - B_j omega is the belt's torque (Eq.
    4): a spring with slipping springs over theta - theta_m/n_T. A late theta_m looks like a smaller
    B_j, so that B_j is free while it agrees with the file's; a wrong B_j then makes no lag.
    Otherwise either theta_m is late and B_j the file's, or B_j differs and theta_m is on time. If
    the joint may have that B_j, a lag that depends on this choice is not found."""
    if p is None or "theta_m" not in record.actuator:
        return None
    few = record.coarse
    theta_m = few.actuator["theta_m"]
    columns = {
        name: column
        for name, column in columns_of(few)[0].items()
        if name not in ("theta", "alpha")
    }
    wound = belt_deflection(few.motion.theta, theta_m, p)
    turned, *both = (
        float(np.std(few.part(angle))) for angle in (few.motion.theta, theta_m / p.n_T, wound)
    )
    if min(both) < 0.05 * turned:
        return None
    slips = few.low_pass(
        np.array([slipping_spring(wound, width) for width in WOUND_UP]).T, few.rate_hz
    ).T
    columns |= {
        "wound": wound - wound.mean(),
        **{f"slips_{k}": column for k, column in enumerate(slips)},
    }

    def fitted(known: float) -> GroupFit:
        """`omega` is the torque per velocity beside a known B_j, or per velocity of theta_m."""
        rest = p.J_j * few.motion.alpha + known * few.motion.omega
        return late_fit(few, columns, {name: name for name in columns}, rest=rest)[0]

    def fault(size: float, se: float, freedom: float) -> Fault:
        se = float(np.hypot(se, BELT_ERROR))
        return Fault(size, se, is_certain(size, se, freedom), abs(size) + POSSIBLE * se)

    try:
        fit = fitted(0.0)
        K_s = fit["wound"]
        if not 0.7 < K_s / p.K_s < 1.4:
            return Belt(K_s)
        own = fault((p.B_j - fit["omega"]) / K_s, fit.se("omega") / K_s, fit.freedom("omega"))
        torque_late = fault(fit["lag_s"], fit.se("lag_s"), fit.freedom("lag_s"))
        is_possible = p.B_j / OTHER_B_J < fit["omega"] < p.B_j * OTHER_B_J
        if own.found:
            columns["omega"] = np.gradient(theta_m, 1 / few.rate_hz) / p.n_T
            fit = fitted(p.B_j)
            own = fault(-fit["omega"] / fit["wound"], fit.se("omega") / K_s, fit.freedom("omega"))
            otherwise = torque_late
            torque_late = fault(fit["lag_s"], fit.se("lag_s"), fit.freedom("lag_s"))
            agree = otherwise.found and otherwise.size * torque_late.size > 0
            torque_late = replace(
                torque_late, found=torque_late.found and (agree or not is_possible)
            )
        return Belt(K_s, torque_late, own)
    except CANNOT_TELL:
        return None


def changes_of_repeats(
    s: Sums, model: Model, effects: Mapping[str, Mapping[str, float]]
) -> GroupFit | None:
    """Sizes of effects that grow with time [1/s], from differences between repeats of one motion:
    each stratum has its own misfit, whatever the joint is. An effect is a combination of columns.
    None if no stratum has three repeats.

    Time is the group's. A score is the product of column and residual in a group, less the mean of
    its stratum."""
    middle, kind = (s.groups.first + s.groups.stop) / 2 / s.rate_hz, s.groups.stratum
    members = np.bincount(kind)
    if members.max() < 3:
        return None
    base, q, one = with_effects(s, model), s.torque, s.names.index("one")
    at = s.index(list(model.values()))
    C = np.array([[part.get(name, 0.0) for part in effects.values()] for name in s.names])
    mean = s.gram[:, one] / s.gram[:, one, one][:, None]
    # a slow disturbance is an offset of a group
    about_mean = s.gram - mean[:, :, None] * s.gram[:, one][:, None]
    products = C.T @ about_mean[:, :q, :q] @ C
    scores = (about_mean[:, :q, q + 1] - about_mean[:, :q][:, :, at] @ base.estimates) @ C

    def added(values: Array) -> Array:
        total = np.zeros((len(members), *values.shape[1:]))
        np.add.at(total, kind, values)
        return total

    scores = scores - (added(scores).T / members).T[kind]
    v = middle - (added(middle) / members)[kind]
    weighted = products * (v**2)[:, None, None]
    estimates, inverse = gram.solved(weighted.sum(axis=0), v @ scores)
    rest = v[:, None] * (scores - np.einsum("mpq,q,m->mp", products, estimates, v)) @ inverse
    taken = np.einsum("spq,qp->s", added(weighted), inverse)  # degrees of freedom of the slopes
    free = members - 1 - taken
    rest *= np.sqrt(members / np.maximum(free, 0.5))[kind, None]
    noise, sums = rest.T @ rest, added(rest)
    freedom = welch_satterthwaite(added(rest**2), np.maximum(free, 0.5))
    misfit = sums.T @ sums * len(members) / max(len(members) - 1, 1)
    covariance, degrees = gram.combined(noise, freedom, misfit, len(members))
    return replace(
        base,
        names=tuple(effects),
        estimates=estimates,
        covariance=covariance,
        degrees_of_freedom=degrees,
    )


def repeats_row(record: Record, s: Sums, model: Model) -> Row:
    """What repeats of one motion show for any joint: `K_drift`, the relative change of K from the
    first to the last fitted row beyond noise, and the drift of the torque's clock against the
    angle's [ppm]. Null if nothing repeats; the drift also if one device recorded both.

    If the torque's clock gains, its torque gets later and later: at time t it is that of t - ppm (t
    - mean t), which to first order adds -ppm (t - mean t) dtorque/dt. A constant offset between
    clocks is not seen.

    Raises InputError: the drift is certain and larger than the settings allow; the message names
    the trial."""
    row: Row = {"K_drift": None, **NO_DRIFT}
    fit = with_effects(s, model)
    slope = {gram.NEXT[c]: -1e-6 * fit[name] for name, c in model.items() if c in gram.NEXT}
    growing = {"K_within": {"theta": 1.0}, "ppm": slope}
    with suppress(IdentifiabilityError):
        seen = changes_of_repeats(s, model, growing) if s.groups.repeat else None
        if seen and "K" in model:
            change, se = s.seconds * seen["K_within"], s.seconds * seen.se("K_within")
            # one-sided
            noise = float(scipy.special.stdtrit(seen.freedom("K_within"), 1 - FALSE_ALARM)) * se
            row["K_drift"] = float(np.sign(change)) * max(abs(change) - noise, 0.0) / fit["K"]
        if seen and record.two_clocks:
            row |= clocks_row(record, seen["ppm"], seen.se("ppm"), seen.freedom("ppm"))
    return row


def clocks_row(record: Record, ppm: float, error: float, freedom: float) -> Row:
    """The drift between the clocks of two devices. Raises InputError: it certainly exceeds the
    settings' limit."""
    largest = record.settings.time_base.largest_drift_ppm if record.settings else np.inf
    try:
        return {**drift_row(ppm, error, freedom, largest)}
    except InputError as problem:
        raise InputError(f"trial {record.name}: {problem}") from problem
