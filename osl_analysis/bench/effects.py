"""Every fault is a column: lag, clocks that drift apart, a stiffness that changes, beside the physics of the joint.

A model (Eq. 15, Eq. 4) names its columns; an effect is one more, and all that is known of it is one object (`EFFECTS`).
All of it is algebra on the Gram matrices of groups (gram.py).

Friction passes for a lag and for a changing stiffness as long as it is left out. So physics of the joint and faults of
the recording compete, and a fault is found only beside all of the physics.
"""

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
from osl_analysis.model.drivetrain import belt_deflection
from osl_analysis.model.parameters import DrivetrainParameters
from osl_analysis.signals import seven_point_motion
from osl_analysis.signals.samples import NO_DRIFT, drift_row
from osl_analysis.stats.covariance import welch_satterthwaite
from osl_analysis.stats.fit_row import Row
from osl_analysis.stats.regression import CONDITION_LIMIT
from osl_analysis.trial import Array

Admittance = Callable[[NDArray[np.complex128]], NDArray[np.complex128]]
"""theta/torque [rad/(N*m)] of a model, for complex s [rad/s]."""
Model = Mapping[str, str]  # column of `sums_of`, by estimate
Keep = NDArray[np.bool_] | Label
"""Groups: those to keep (m,), those of a label, or all (None)."""
IMPEDANCE: Model = {"K": "theta", "B": "omega", "I": "alpha", "offset": "one", "drift": "ramp"}  # Eq. 15
TRANSMISSION: Model = {"B_j": "omega", "J_j": "alpha", "offset": "one", "drift": "ramp"}  # Eq. 4 without a belt
LARGEST_TURN = 0.2
"""Phase [rad] by which a lag turns the highest frequency, 6 ms at 5 Hz, beyond which a drivetrain may make it."""
FALSE_ALARM = 1e-3  # probability of a false alarm for one effect
POSSIBLE = 2.0  # standard errors by which an effect may be larger than it is found
WOUND_UP = (0.5e-3, 1.5e-3, 4e-3)  # half-widths [rad] of springs that slip, of which a belt's hysteresis is made
FRICTION_ERROR = 60e-6  # s by which friction that is not made of `EFFECTS` shifts a lag beside it (SD)
BELT_ERROR = 80e-6  # s by which hysteresis that is not made of these shifts a lag (SD); of simulated legs 10 to 150
CANNOT_TELL = (IdentifiabilityError, InputError, np.linalg.LinAlgError)  # a motion does not tell effects apart


@dataclass(frozen=True)
class Moved:
    """The motion of a joint (n,) and its Eq. 15, of which the columns of effects are made."""

    theta: Array  # angle [rad] about its mean
    omega: Array
    size: float  # RMS [rad] of the fitted angle
    torque: Array  # of Eq. 15 without its offset [N*m]
    passed: Array  # share of the record that has passed, about its middle


@dataclass(frozen=True)
class Effect:
    """What a joint has beside a model, or a recording may have: a column beside those of the model. Its estimate and
    its column have its name, and so have its words in the table of judgements."""

    name: str
    made: Callable[[Moved], Array] | None = None  # its column (n,); None: it is one of the model's, or of `sums_of`
    is_filtered: bool = True  # whether the column passes the filter of the torque
    has_rate: bool = False  # whether NAME_rate, its derivative, is a column: a late torque has it
    is_fault: bool = False  # of the recording, and not of the joint
    is_tried: bool = True  # whether it competes for the misfit of any model
    of_spring: bool = False  # a model without stiffness has none
    is_friction: bool = False
    is_rich: bool = True  # whether the richest model has it, which leaves noise


def slipping(name: str, share: float) -> Effect:
    """A spring that slips, of a half-width that is a share of the motion's RMS: presliding friction, a belt that winds
    up."""
    return Effect(name, lambda moved: spring_that_slips(moved.theta, share * moved.size), is_friction=True)


EFFECTS = (
    Effect("K_change", lambda moved: moved.passed * moved.theta, is_filtered=False, is_fault=True, of_spring=True),
    # Coulomb friction; 0.01 rad/s are ten times the velocity noise of 14 bits
    Effect("T_C", lambda moved: np.tanh(moved.omega / 0.01), has_rate=True, is_friction=True),
    Effect("T_C_sharp", lambda moved: np.tanh(moved.omega / 0.001), is_tried=False, is_rich=False),
    # friction that grows with the angle
    Effect("T_G", lambda moved: np.abs(moved.theta) * np.tanh(moved.omega / 0.01), is_friction=True),
    slipping("hysteresis", 0.05),
    slipping("hysteresis_2", 0.15),
    slipping("hysteresis_3", 0.4),
    Effect("cubic", lambda moved: moved.theta**3, of_spring=True),  # a spring that stiffens
    # play opens where the torque of Eq. 15 is 0, without its offset
    Effect("gap", lambda moved: -np.sign(moved.torque), of_spring=True, is_rich=False),
    Effect("linear", has_rate=True, is_rich=False),  # the higher dynamics of the linear model with its gains
    Effect("lag_s", is_fault=True, is_rich=False),  # its columns hang on the estimates (`told_lag`)
)
FAULTS = frozenset(effect.name for effect in EFFECTS if effect.is_fault)
FRICTION = frozenset(effect.name for effect in EFFECTS if effect.is_friction)
COLUMN = {"weight": "theta"}  # of an estimate beside a model that is not named like its column


def plain_sums(record: Record, model: Model) -> Sums:
    """The sums of a record without effects."""
    columns, centre = columns_of(record)
    return gram.gram_sums(record, columns, list(model.values()), centre)


def columns_of(record: Record) -> tuple[dict[str, Array], float]:
    """The columns (n,) of the models by name, and the angle [rad] that `theta` is about."""
    motion, centre = record.motion, float(record.part(record.motion.theta).mean())
    columns = {"theta": motion.theta - centre, "omega": motion.omega, "alpha": motion.alpha}
    columns |= {"one": np.ones_like(motion.theta), "ramp": record.time - record.time.mean()}
    return columns, centre


def sums_of(record: Record, model: Model, expected: Admittance | None = None) -> Sums:
    """The sums of a coarse record with all effects.
    `expected` is the admittance of the linear model, where the gains are known."""
    few = record.coarse
    columns, centre = columns_of(few)
    theta, omega, alpha, one, ramp = columns.values()
    higher = seven_point_motion(few.time, alpha, few.rate_hz)
    duration = np.concatenate([few.time[[p.start, p.stop - 1]] for p in few.pieces])
    X = np.array([few.part(x) for x in (theta, omega, alpha, one)])
    K, B, I, _ = np.linalg.lstsq(X @ X.T, X @ few.part(few.filtered_torque), rcond=1e-12)[0]
    size, linear_part = float(few.part(few.motion.theta).std()), K * theta + B * omega + I * alpha
    moved = Moved(theta, omega, size, linear_part, ramp / max(float(np.ptp(duration)), np.finfo(float).tiny))
    columns |= {"jerk": higher.omega, "snap": higher.alpha}
    if record.two_clocks and not record.groups.repeat:
        columns |= {f"ramp_{name}": ramp * columns[name] for name in ("omega", "alpha", "jerk")}
    shaped = {effect: effect.made(moved) for effect in EFFECTS if effect.made}
    sharp = [effect for effect in shaped if effect.is_filtered]
    smooth = few.low_pass(np.array([shaped[effect] for effect in sharp]).T, few.rate_hz).T
    shaped |= dict(zip(sharp, smooth, strict=True))
    columns |= {effect.name: column for effect, column in shaped.items()}
    if expected is not None:
        columns["linear"] = linear_torque(few, expected)
    for effect in EFFECTS:
        if effect.has_rate and effect.name in columns:
            columns[f"{effect.name}_rate"] = np.gradient(columns[effect.name], 1 / few.rate_hz)
    rich = [*model.values(), "jerk", "snap", *(effect.name for effect in EFFECTS if effect.is_rich)]
    return gram.gram_sums(few, columns, rich, centre)


def spring_that_slips(x: Array, width: float) -> Array:
    """Torque (n,) of a spring that slips at +-1 (Prandtl's stop operator), wound up by x to its end over a `width`:
    friction that winds something up before it slides. It starts slack."""
    rising = np.diff(x) >= 0
    turns = np.concatenate([[0], np.flatnonzero(rising[1:] != rising[:-1]) + 1, [len(x) - 1]])
    wound = [0.0]  # at the turns
    for way in (np.diff(x[turns]) / width).tolist():
        wound.append(min(max(wound[-1] + way, -1.0), 1.0))
    last = np.repeat(np.arange(len(turns) - 1), np.diff(turns))  # the turn before each row
    found = np.clip(np.array(wound)[last] + (x[:-1] - x[turns][last]) / width, -1.0, 1.0)
    return np.append(found, wound[-1])


def linear_torque(record: Record, expected: Admittance) -> Array:
    """Torque (n,) [N*m] of the linear model of admittance `expected` for the filtered motion, up to three cut-offs. The
    record is continued by its mirror image, so that its ends fit together."""
    n, theta = len(record.time), record.motion.theta - record.motion.theta.mean()
    mirrored = np.fft.rfft(np.concatenate([theta, theta[::-1]]))
    s = np.asarray(2j * np.pi * np.fft.rfftfreq(2 * n, 1 / record.rate_hz), dtype=np.complex128)
    kept = (np.abs(s) < 2 * np.pi * 3.0 * record.low_pass.cutoff_hz) & (s != 0)
    response = np.zeros(len(s), dtype=np.complex128)
    response[kept] = 1 / expected(s[kept])
    return np.asarray(np.fft.irfft(response * mirrored, 2 * n)[:n])


def noise_of_angle(record: Record) -> tuple[float, float, float]:
    """Variances of the angle's noise behind the filter, and of its first and second derivative."""
    f = np.linspace(0, min(8 * record.low_pass.cutoff_hz, record.rate_hz / 2), 2000)
    passed = record.noise[0] * record.low_pass.gain(f) ** 2
    w = 2 * np.pi * f
    still, moving, turning = (float(np.trapezoid(w**k * passed, f)) for k in (0, 2, 4))
    return still, moving, turning


def with_effects(s: Sums, model: Model, effects: Sequence[str] = (), keep: Keep = None) -> GroupFit:
    """Fit of a model with effects beside it, over some groups. Raises as `fit_groups`."""
    if "lag_s" in effects:
        return told_lag(s, model, effects, keep)[0]
    limit = gram.EFFECTS_LIMIT if effects else CONDITION_LIMIT
    return gram.fit_groups(s, with_columns(model, effects), keep, limit=limit)


def with_columns(model: Model, effects: Sequence[str]) -> Model:
    """The columns of a model with effects, but for a lag's."""
    return dict(model) | {effect: COLUMN.get(effect, effect) for effect in effects if effect != "lag_s"}


def told_lag(s: Sums, model: Model, effects: Sequence[str], keep: Keep = None) -> tuple[GroupFit, Sums]:
    """The fit with the lag that leaves least, and the sums that are about it; raises as `fit_groups`.

    A lag that is certain has an image, of the other sign or even at 0, which leaves nearly as little: what is left is
    asked over all lags. Of equals the one of a joint counts whose K, B and I are not negative, of which there is one at
    most: to third order an image takes so much off B that B or I is below 0. Of a delay and a low-pass that leave as
    little the delay is told.
    """
    base = with_columns(model, effects)
    near = near_lag(s, base, 0.0, keep)
    if not near.certain("lag_s", FALSE_ALARM) and possible_joint(near, model):
        return near, s
    left, lags = left_over_lags(s, base, keep)
    delays, tried = int(np.count_nonzero(s.restored.noise_gain == 1)), []
    over = left[:delays].ravel()
    lowest = [k for k in range(1, len(over) - 1) if over[k] <= over[k - 1] and over[k] < over[k + 1]]
    for k in (*lowest, over.size + int(np.argmin(left[delays:]))):
        one = s.restored.by(k // lags.shape[1])
        with suppress(*CANNOT_TELL):
            tried.append((near_lag(one, base, float(lags.ravel()[k]), keep), one))
    tried.sort(key=lambda both: both[0].left)
    if not tried:
        return near, s
    least = tried[0][0]
    more = float(scipy.special.chdtri(1, FALSE_ALARM)) * least.left / least.samples * s.independent
    equal = [both for both in tried if both[0].left < least.left + more]
    equal.sort(key=lambda both: both[1].noise_gain > 1)
    return next((both for both in equal if possible_joint(both[0], model)), tried[0])


def possible_joint(fit: GroupFit, model: Model) -> bool:
    """Whether no stiffness, damping or inertia of a fit is certainly negative."""
    names = [name for name, column in model.items() if column in ("theta", "omega", "alpha")]
    return all(fit[name] > 0 or not fit.certain(name, FALSE_ALARM) for name in names)


def left_over_lags(s: Sums, base: Model, keep: Keep = None) -> tuple[Array, Array]:
    """What a model leaves of a late torque over all lags: the sum of squares and the lag [s], each (w, 5) by the way in
    which the torque is restored and five lags about it."""
    ways, p = s.restored, len(base)
    between = np.diff(ways.late[ways.noise_gain == 1]).max() / 2
    about = np.where(ways.noise_gain == 1, between, ways.late / 3)[:, None] * np.linspace(-0.8, 0.8, 5)
    late = s.late_by(about)
    turns = np.zeros((*about.shape, s.torque + 2, p + 1))
    turns[..., :-2, :p], turns[..., -2, p] = late[..., s.index(list(base.values()))], 1.0
    left = gram.least_left(np.swapaxes(turns, -1, -2) @ ways.totals(keep)[:, None] @ turns)
    return left / ways.noise_gain[:, None], ways.late[:, None] + about


def near_lag(s: Sums, base: Model, start: float, keep: Keep = None) -> GroupFit:
    """A late torque is m - d m' + d^2/2 m'': its columns hang on the estimates and on d, which is found by Gauss and
    Newton's steps from `start` [s], of which `late` has been taken off the sums already; the last one is a fit."""
    lag, total = start - s.late, s.over(keep)
    columns = s.combinations([{column: 1.0} for column in base.values()])

    def solved_at(*slope: Array) -> tuple[Array, Array]:
        late = s.late_by(lag)
        turn = s.turned(late @ np.column_stack([columns, *slope]))
        own = turn.T @ total @ turn
        return gram.solved(own[:-2, :-2], own[:-2, -2])[0], turn

    estimates = solved_at()[0]
    for _ in range(8):
        slope = s.late_series[1] @ columns @ estimates[: len(base)]
        estimates, turn = solved_at(slope)
        before, lag = lag, float(np.clip(lag + estimates[-1], -gram.SPACING, gram.SPACING))
        if abs(lag - before) < 1e-8:  # s
            break
    fit = gram.fit_groups(s, {**base, "lag_s": "jerk"}, keep, turn, gram.EFFECTS_LIMIT)
    return replace(fit, estimates=np.append(fit.estimates[:-1], s.late + lag), left=fit.left / s.noise_gain)


def taken_by(s: Sums, model: Model, column: str, label: Label = None) -> dict[str, float]:
    """What the estimates of a model take of a column of size 1 that it lacks."""
    estimates = gram.estimates_of(s.over(label), s.index(list(model.values())), s.names.index(column))
    return dict(zip(model, estimates.tolist(), strict=True))


@dataclass(frozen=True)
class Causes:
    """What explains the misfit of a model, the best explanation first."""

    chosen: tuple[str, ...]  # effects by forward selection
    fit: GroupFit  # the model with them
    only_noise: bool  # whether the model with them leaves no more than noise

    def certain(self, effect: str) -> bool:
        """Whether an effect is among the causes and these explain all: a drivetrain leaves something of any shape."""
        return self.only_noise and effect in self.chosen and self.fit.certain(effect, FALSE_ALARM)


def causes(record: Record, s: Sums, model: Model) -> Causes:
    """Physics of the joint and faults of the recording compete step by step: the one that leaves least is taken, as
    long as it is certain, and takes a thousandth of what is left or more. Of few units nothing is asked."""
    physics = physics_of(s, model)
    effects = [*physics, *(e.name for e in EFFECTS if e.is_fault and (not e.of_spring or "theta" in model.values()))]
    chosen: list[str] = []
    now, at, lag = with_effects(s, model), s, None
    wide = not (leaves_noise(record, now) and possible_joint(now, model))

    def left_by(sets: Sequence[Sequence[str]]) -> list[float]:
        """Sums of squares that the model leaves with each set of effects, of a lag with the column by which it is told;
        the sets are of one size."""
        columns = [[*model.values(), *("jerk" if e == "lag_s" else COLUMN.get(e, e) for e in one)] for one in sets]
        own = np.array([[*at.index(names), at.torque] for names in columns])
        return list(gram.least_left(at.total[own[:, :, None], own[:, None, :]]).tolist())

    while len(chosen) < len(effects):
        rest = [e for e in effects if e not in chosen]
        left = dict(zip(rest, left_by([(*chosen, e) for e in rest]), strict=True))
        most = (1 - 1e-3) * left_by([chosen])[0]
        if wide and "lag_s" in left:
            left["lag_s"] = min(left["lag_s"], float(left_over_lags(s, with_columns(model, chosen))[0].min()))
        likely = [e for e in sorted(left, key=left.__getitem__) if left[e] < most]
        tried = ((e, tried_fit(at, model, (*chosen, e), lag=lag)) for e in likely)
        effect, fit = next(((e, fit) for e, fit in tried if fit and fit.certain(e, FALSE_ALARM)), ("", None))
        if fit is None:
            break
        chosen.append(effect)
        now = fit
        if effect == "lag_s":
            lag, at = fit["lag_s"], told_lag(s, model, chosen)[1]
    return Causes(tuple(chosen), now, leaves_noise(record, now))


def leaves_noise(record: Record, fit: GroupFit, more: float = 1.5) -> bool:
    """Whether a fit leaves no more than the noise of torque and angle behind the filter, by a factor that allows for
    its own error."""
    of_angle, of_torque = record.noise
    stiffness = float(abs(fit["K"])) if "K" in fit.names else 0.0
    noise = (of_torque + stiffness**2 * of_angle) * record.low_pass.noise_bandwidth_hz
    return fit.left < more**2 * noise * fit.samples


def physics_of(s: Sums, model: Model) -> tuple[str, ...]:
    """The physics that a model may lack and the columns have; without a stiffness neither a spring nor play."""
    elastic = "theta" in model.values()
    joint = (e for e in EFFECTS if e.is_tried and not e.is_fault)
    return tuple(e.name for e in joint if e.name in s.names and (elastic or not e.of_spring))


def tried_fit(
    s: Sums, model: Model, effects: Sequence[str], keep: Keep = None, lag: float | None = None
) -> GroupFit | None:
    """As `with_effects`, with a lag near a given one [s]; None where the motion does not tell the effects apart."""
    with suppress(*CANNOT_TELL):
        if lag is None:
            return with_effects(s, model, effects, keep)
        return near_lag(s, with_columns(model, effects), lag, keep)
    return None


def competing(s: Sums, model: Model, fault: str, found: Causes) -> tuple[str, ...]:
    """What a fault must be certain beside: all of the physics and what was chosen; this alone where it explains all."""
    chosen = tuple(e for e in found.chosen if e != fault)
    return chosen if found.only_noise else tuple(dict.fromkeys((*physics_of(s, model), *chosen)))


def is_alike(s: Sums, model: Model, fault: str, found: Causes, lag: float | None = None) -> bool:
    """Whether the labels of a recording agree on the size of a fault; of a lag [s] near that of all of it, whose sums
    `s` are about it."""
    effects = (*competing(s, model, fault, found), fault)
    parts = [s.groups.of(label) for label in s.groups.labels]
    fits = [tried_fit(s, model, effects, part, lag) for part in parts if part.sum() > len(model) + len(effects) + 1]
    known = [(fit[fault], fit.se(fault) ** 2) for fit in fits if fit is not None]
    if len(known) < 2:
        return True
    estimates, variances = np.array(known).T
    mean = np.sum(estimates / variances) / np.sum(1 / variances)
    return bool(scipy.special.chdtrc(len(known) - 1, float(np.sum((estimates - mean) ** 2 / variances))) > 0.01)


@dataclass(frozen=True)
class Fault:
    """The size of a fault of a recording."""

    size: float  # in its unit, beside all of the physics
    se: float  # its standard error
    found: bool  # whether it is certain, the same in all parts, and nothing else
    possible: float  # size up to which there may be one that was not found


def is_certain(size: float, se: float, freedom: float) -> bool:
    """Whether a size differs from 0 by more than chance does once in `FALSE_ALARM` (two-sided)."""
    return abs(size) > float(scipy.special.stdtrit(freedom, 1 - FALSE_ALARM / 2)) * se


def lag_of(record: Record, s: Sums, model: Model, found: Causes) -> Fault | None:
    """By how much the torque lags the angle [s]; None where the motion does not tell it from the physics.

    It is found only in a joint of which the model, the physics and the lag leave no more than noise: what a drivetrain
    leaves looks like a lag of 2 to 20 ms. Beyond `LARGEST_TURN` it may be one, and must be 15 standard errors large,
    from which a reader must know of it: 5 ms make 30 to 70, sound joints 3.
    """
    others = competing(s, model, "lag_s", found)
    try:
        fit, about = told_lag(s, model, (*others, "lag_s"))
    except CANNOT_TELL:
        return None
    size, beside = fit["lag_s"], FRICTION_ERROR if FRICTION.intersection(others) else 0.0
    se = float(np.hypot(fit.se("lag_s"), beside))
    sure = is_certain(size, se, fit.freedom("lag_s")) and (
        "lag_s" in found.chosen or not possible_joint(found.fit, model)
    )
    sure &= 2 * np.pi * record.band_hz[1] * abs(size) < LARGEST_TURN or abs(size) > 15.0 * se
    if sure and not leaves_noise(record, fit):
        # a low-pass of the torque's sensor may have taken off the part of the noise by which it is known: then little
        # more is left, of which the richest model explains nothing
        names = list(dict.fromkeys([*about.rich, *with_columns(model, others).values()]))
        at = [*about.index(names), about.torque]
        least = float(gram.least_left(about.total[np.ix_(at, at)])) / about.noise_gain
        free = max(len(names) - len(fit.names), 1)
        beyond_noise = float(scipy.special.chdtri(free, FALSE_ALARM)) * fit.left / fit.samples
        explained = fit.left - least > beyond_noise * about.independent
        sure = leaves_noise(record, fit, 2.0) and not explained
    return Fault(size, se, sure and is_alike(about, model, "lag_s", found, size), abs(size) + POSSIBLE * se)


@dataclass(frozen=True)
class Belt:
    """What the belt between theta_m and the joint shows of a leg's recording."""

    K_s: float  # [N*m/rad]
    torque: Fault | None = None  # lag [s] of the torque behind the joint's angle; None of another belt than the file's
    theta_m: Fault | None = None  # the same of theta_m


def belt_of_leg(record: Record, p: DrivetrainParameters | None) -> Belt | None:
    """The belt of a leg; None without a parameter file or theta_m, or where it deflects, or theta_m turns, by less than
    a twentieth of the joint's angle: encoders may be wrong by as much, and a joint beside an idle motor is no leg.

    Whatever the controller and its friction do, torque - J_j alpha - B_j omega is the belt's torque (Eq. 4), a spring
    with springs that slip over theta - theta_m/n_T. A late theta_m looks like a smaller B_j. So B_j is free as long as
    it agrees with the file's: a B_j that is wrong then makes no lag. Else theta_m is late, and B_j is that of the file.
    """
    if p is None or record.theta_m is None:
        return None
    few = record.coarse
    assert few.theta_m is not None
    columns = {name: column for name, column in columns_of(few)[0].items() if name not in ("theta", "alpha")}
    wound = belt_deflection(few.motion.theta, few.theta_m, p)
    turned, *both = (float(np.std(few.part(angle))) for angle in (few.motion.theta, few.theta_m / p.n_T, wound))
    if min(both) < 0.05 * turned:
        return None
    slips = few.low_pass(np.array([spring_that_slips(wound, width) for width in WOUND_UP]).T, few.rate_hz).T
    columns |= {"wound": wound - wound.mean(), **{f"slips_{k}": column for k, column in enumerate(slips)}}
    torque, first, last = scipy.interpolate.make_interp_spline(few.time, few.filtered_torque, 5), *few.time[[0, -1]]

    def fitted(known: float) -> tuple[float, GroupFit]:
        """The torque's lag, and the last step of the iteration; `omega` is the torque per velocity beside a known B_j,
        or per velocity of theta_m."""
        lag, rest = 0.0, p.J_j * few.motion.alpha + known * few.motion.omega
        for _ in range(3):
            then = np.clip(few.time + lag, first, last)
            torque_then = torque(then) - rest
            made = replace(few, filtered_torque=torque_then, torque=torque_then)
            sums = gram.gram_sums(made, columns | {"late": -torque(then, 1)}, list(columns))
            fit = gram.fit_groups(sums, {name: name for name in sums.names}, limit=gram.EFFECTS_LIMIT)
            lag += fit["late"]
        return lag, fit

    def fault(size: float, se: float, freedom: float) -> Fault:
        se = float(np.hypot(se, BELT_ERROR))
        return Fault(size, se, is_certain(size, se, freedom), abs(size) + POSSIBLE * se)

    try:
        lag, fit = fitted(0.0)
        K_s = fit["wound"]
        if not 0.7 < K_s / p.K_s < 1.4:
            return Belt(K_s)
        own = fault((p.B_j - fit["omega"]) / K_s, fit.se("omega") / K_s, fit.freedom("omega"))
        if own.found:
            columns["omega"] = np.gradient(few.theta_m, 1 / few.rate_hz) / p.n_T
            lag, fit = fitted(p.B_j)
            own = fault(-fit["omega"] / fit["wound"], fit.se("omega") / K_s, fit.freedom("omega"))
        return Belt(K_s, fault(lag, fit.se("late"), fit.freedom("late")), own)
    except CANNOT_TELL:
        return None


def stiffness_change(s: Sums, model: Model, found: Causes) -> Fault | None:
    """By how much K [N*m/rad] changes from the first fitted row to the last; None where the motion does not tell.

    Repeats of one motion differ by what K changes alone, whatever the joint is. Where the model with the physics
    explains all others, too, the change from one frequency to the next tells more: the surer one of both counts.
    """

    def beyond_noise(fit: GroupFit, name: str, sure: bool, duration: float = 1.0) -> Fault:
        """A change in a `duration` of the estimate's unit of time; 0 if it is no more than noise."""
        change, se = duration * fit[name], duration * fit.se(name)
        noise = float(scipy.special.stdtrit(fit.freedom(name), 1 - FALSE_ALARM)) * se  # one-sided
        return Fault(float(np.sign(change)) * (abs(change) - noise), se, sure and abs(change) > noise, noise)

    tried: list[Fault] = []
    if s.groups.repeat and (within := changes_of_repeats(s, model, {"K_within": {"theta": 1.0}})):
        tried.append(beyond_noise(within, "K_within", True, s.seconds))
    enough = len(s.groups.first) >= gram.FEWEST_GROUPS
    full = tried_fit(s, model, (*competing(s, model, "K_change", found), "K_change")) if enough else None
    if full is not None:
        sure = "K_change" in found.chosen and full.certain("K_change", FALSE_ALARM)
        if sure and not found.only_noise:  # as after a step: no dynamics of higher order may make it
            others = (e for e in competing(s, model, "K_change", found) if e != "lag_s")
            rich = tried_fit(s, model, (*others, "jerk", "snap", "K_change"))
            # in a sweep, whose frequency rises or falls with time, dynamics pass for a change over time
            theta, omega = s.index(["theta", "omega"])
            speed = s.gram[:, omega, omega] / np.maximum(s.gram[:, theta, theta], np.finfo(float).tiny)
            sweeps = abs(float(scipy.stats.spearmanr(s.groups.first, speed).statistic)) > 0.5
            sure = rich is not None and rich.certain("K_change", FALSE_ALARM**2) and not sweeps
        tried.append(beyond_noise(full, "K_change", sure and is_alike(s, model, "K_change", found)))
    return min(tried, key=lambda fault: fault.possible if not fault.found else fault.se, default=None)


def changes_of_repeats(s: Sums, model: Model, effects: Mapping[str, Mapping[str, float]]) -> GroupFit | None:
    """Sizes of effects that grow with time [1/s], by what repeats of one motion differ by: each stratum has a misfit
    of its own, whatever the joint is. An effect is a combination of columns; None where no stratum has three repeats.

    The time is that of the group and not of the row. A score is the product of column and residual in a group, less
    the mean of its stratum.
    """
    middle, kind = (s.groups.first + s.groups.stop) / 2 / s.rate_hz, s.groups.stratum
    members = np.bincount(kind)
    if members.max() < 3:
        return None
    base, q, one = with_effects(s, model), s.torque, s.names.index("one")
    at, C = s.index(list(model.values())), s.combinations(list(effects.values()))
    mean = s.gram[:, one] / s.gram[:, one, one][:, None]
    about_mean = s.gram - mean[:, :, None] * s.gram[:, one][:, None]  # a slow disturbance is an offset of a group
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
    taken = np.einsum("spq,qp->s", added(weighted), inverse)  # by the mean of a stratum 1, by the slopes their share
    free = members - 1 - taken
    rest *= np.sqrt(members / np.maximum(free, 0.5))[kind, None]
    noise, sums = rest.T @ rest, added(rest)
    freedom = welch_satterthwaite(added(rest**2), np.maximum(free, 0.5))
    misfit = sums.T @ sums * len(members) / max(len(members) - 1, 1)
    covariance, degrees = gram.combined(noise, freedom, misfit, len(members))
    return replace(base, names=tuple(effects), estimates=estimates, covariance=covariance, degrees_of_freedom=degrees)


def clocks_row(record: Record, s: Sums, model: Model, found: Causes) -> Row:
    """Drift of the torque's clock against the angle's [ppm]; null where one device recorded both, or it is not seen.

    A torque whose clock gains is later and later: at time t it is that of t - ppm (t - mean t), which to first order
    adds -ppm (t - mean t) dtorque/dt. Repeats of a motion differ by this and by a change of K alone. Where nothing
    repeats, a joint that the model with the physics explains shows it. A constant offset between clocks is not seen.

    Raises InputError: the drift is certain and larger than the settings allow; the message names the trial.
    """
    if not record.two_clocks:
        return NO_DRIFT
    slope = {gram.NEXT[c]: -1e-6 * found.fit[name] for name, c in model.items() if c in gram.NEXT}
    try:
        if s.groups.repeat:
            seen = changes_of_repeats(s, model, {"K_within": {"theta": 1.0}, "ppm": slope})
        else:
            seen, drifting = None, {f"ramp_{name}": weight for name, weight in slope.items()}
            for effects in ([e for e in found.chosen if e not in FAULTS | {"linear"}], physics_of(s, model)):
                base = with_columns(model, effects)
                turn = s.turned(s.combinations([*({column: 1.0} for column in base.values()), drifting]))
                fit = gram.fit_groups(s, {**base, "ppm": "one"}, None, turn, gram.EFFECTS_LIMIT)
                if leaves_noise(record, fit):
                    seen = fit
                    break
        if seen is None:
            return NO_DRIFT
        largest = record.settings.time_base.largest_drift_ppm if record.settings else np.inf
        return {**drift_row(seen["ppm"], seen.se("ppm"), seen.freedom("ppm"), largest)}
    except IdentifiabilityError:
        return NO_DRIFT
    except InputError as error:
        raise InputError(f"trial {record.name}: {error}") from error


def yielding_in(series: Mapping[str, float]) -> float | None:
    """Stiffness [N*m/rad] of a frame in series with a second-order joint of which K, B, I and J are measured.
    1/measured = 1/joint + 1/stiffness, to the third power of s, where the joint has none. None if there is none, or it
    would yield by more than half of the joint's angle."""
    K, B, I, J = (series[name] for name in "KBIJ")
    b, i, j = B / K, I / K, J / K
    first, second, third = -b, b**2 - i, 2 * b * i - b**3 - j
    left = np.roots([third, -2 * first * second, first**3])
    yielded = [1 - float(share.real) for share in left if abs(share.imag) < 1e-9]
    return K / min(sound) if (sound := [share for share in yielded if 0 < share < 0.5]) else None


def frame_stiffness(s: Sums, model: Model, found: Causes) -> float | None:
    """Stiffness [N*m/rad] of a frame in series that explains a lag as well, beside the physics that was chosen."""
    physics = [e for e in found.chosen if e not in FAULTS]
    with suppress(*CANNOT_TELL):
        fit = with_effects(s, model, (*physics, "jerk"))
        return yielding_in({"K": fit["K"], "B": fit["B"], "I": fit["I"], "J": fit["jerk"]})
    return None
