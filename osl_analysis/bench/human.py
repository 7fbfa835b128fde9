"""A person's joint: the stretch reflex is columns beside Eq. 15, and what is slow counts for the person's own will.

The reflex is the parallel pathway of Kearney, Stein and Parameswaran (IEEE Trans. Biomed. Eng. 44, 1997): half-wave
rectified velocity, some 40 ms late, through an impulse response of half a second; here of both directions.
"""

from dataclasses import replace

import numpy as np
import polars as pl
from scipy.interpolate import BSpline
from scipy.signal import fftconvolve
from scipy.special import fdtrc, stdtr, stdtrit

from osl_analysis.bench import effects, gram
from osl_analysis.bench.analysis import Analysis
from osl_analysis.bench.effects import IMPEDANCE, columns_of, eq15_of, plain_sums
from osl_analysis.bench.record import Record, stretches_of
from osl_analysis.bench.settings import HumanJoint, ImpedanceAnalysis
from osl_analysis.signals import LowPass, Motion, seven_point_motion
from osl_analysis.stats.covariance import products_between
from osl_analysis.stats.fit_row import Row
from osl_analysis.trial import Array

COSINES = 8  # in which an impulse response is described; each next one is broader
EARLY_S = 0.04  # lag [s] from which on there are equally many for each doubling of it
BLOCKS, SHORTEST_BLOCK_S = 30, 2.0  # stretches whose scores make the intervals: number, and least duration [s]
TESTED_BLOCKS, SHORTEST_TESTED_S, FEWEST_TESTED = 48, 1.0, 20  # the same of the test for a reflex
USUAL_DELAY_S = 0.04  # of a stretch reflex of the ankle [s]
SIGN_WIDTHS = (0.005, 0.02, 0.1)  # speeds [rad/s] over which friction turns its sign
BEFORE_OVER_AFTER = 1.7  # how much more past speed must explain than the speed to come; sound joints: 1.5

ABOVE_HZ = 10.0  # frequencies by which a late torque is told from a reflex, which is slow
REFLEX_ERROR = 60e-6  # s by which a reflex that is not made of the columns shifts a lag (SD)


def human_of(record: Record) -> HumanJoint | None:
    """How a person's joint is fitted; None of a device."""
    return record.settings.human if isinstance(record.settings, ImpedanceAnalysis) else None


def through_memory(signals: Array, rate_hz: float, memory_s: float) -> Array:
    """Signals (n, k) through raised cosines on the logarithm of the lag, (n, 8 k): what impulse responses are made of,
    up to two thirds of the memory [s], in units of the signal times seconds."""
    log_lag = np.log(np.arange(round(memory_s * rate_hz)) / rate_hz + EARLY_S)
    middle = np.linspace(np.log(EARLY_S), np.log(0.7 * memory_s + EARLY_S), COSINES + 2)[2:]
    away = (log_lag[:, None] - middle) / (middle[1] - middle[0])
    responses = (1 + np.cos(np.pi * np.clip(away / 2, -1, 1))) / 2 / rate_hz
    return np.concatenate([fftconvolve(one[:, None], responses, axes=0)[: len(one)] for one in signals.T], axis=1)


def half_waves(record: Record, memory_s: float) -> Array:
    """The velocity of a record, half-wave rectified in each direction, through the memory [s]: (n, 16) [rad]."""
    omega = record.motion.omega
    return through_memory(np.column_stack([np.maximum(omega, 0), np.minimum(omega, 0)]), record.rate_hz, memory_s)


def late_by(columns: Array, rate_hz: float, delay_s: float) -> Array:
    """Columns (n, k) late by a delay, with rest before them."""
    return np.pad(columns, ((round(delay_s * rate_hz), 0), (0, 0)))[: len(columns)]


def without_slow(record: Record, signals: Array, slow_hz: float) -> Array:
    """Signals (n, ...) of a record without what is slower than some frequency [Hz], by a zero-phase filter."""
    return np.asarray(signals - LowPass(slow_hz, 2)(signals, record.rate_hz))


def without_will(record: Record, human: HumanJoint) -> Record:
    """The record without the slow part of angle and torque, about their means, in stretches of a thirtieth."""
    signals = [record.motion.theta, record.motion.omega, record.motion.alpha, record.filtered_torque]
    theta, omega, alpha, torque = without_slow(record, np.array(signals).T, human.slow_hz).T
    angle, level = (float(record.part(signals[k]).mean()) for k in (0, 3))
    groups = stretches_of(record.pieces, record.rate_hz, max(record.seconds / BLOCKS, SHORTEST_BLOCK_S))
    motion = Motion(theta + angle, omega, alpha)
    return replace(record, motion=motion, filtered_torque=torque + level, groups=groups, periodic=None)


def with_reflex(record: Record, human: HumanJoint | None = None) -> Record:
    """The record of a person's joint, without its slow part and with the columns of the reflex; any other record as it
    is. The delay of the reflex is the one of those in the settings with which the other stretches predict each stretch
    best; beside it stand those that do so as well within chance, by the scatter of what they leave in the stretches.
    `human` is that of the settings unless it is given."""
    human = human or human_of(record)
    if human is None:
        return record
    omega, rate, slow = record.motion.omega, record.rate_hz, record.slow
    if human.over in ("angle", "time"):
        slow = LowPass(human.slow_hz, 2)(record.motion.theta, rate) if human.over == "angle" else record.time
    columns, made = half_waves(record, human.memory_s), replace(without_will(record, human), slow=slow)
    if slow is not None:
        turned = slow - made.part(slow).mean()  # the reflex's gain changes with the signal in a straight line
        columns = np.hstack([columns, columns * (turned / np.abs(turned).max())[:, None]])
        shares = over_basis(made, slow) - over_basis(made, made.part(slow)).mean(axis=0)
        moved = {"K": record.motion.theta - record.part(record.motion.theta).mean(), "B": omega}
        if human.over != "time":  # the torque without motion changes with the signal, too
            moved["level"] = np.ones_like(omega)
        made = replace(
            made,
            also={
                f"{name}_over_{k}": column
                for name, signal in moved.items()
                for k, column in enumerate(without_slow(record, signal[:, None] * shares[:, 1:], human.slow_hz).T, 1)
            },
        )
    few, quick = made.coarse, without_slow(record, columns, human.slow_hz)[:: round(rate / made.coarse.rate_hz)]
    left, stiffness = list[Array](), list[float]()
    for delay in human.delays_ms:
        s = plain_sums(
            replace(few, also={**few.also, **reflex_columns(late_by(quick, few.rate_hz, 1e-3 * delay))}), IMPEDANCE
        )
        rest = s.total - s.gram
        estimates = gram.solved(rest[:, :-2, :-2], rest[:, :-2, s.torque])[0]
        error = np.column_stack([estimates, -np.ones(len(rest))])
        left.append(np.einsum("mp,mpq,mq->m", error, s.gram[:, :-1, :-1], error))
        stiffness.append(float(gram.solved(s.total[:-2, :-2], s.total[:-2, s.torque])[0][s.names.index("theta")]))
    more = np.array(left) - min(left, key=np.sum)
    chance = stdtrit(len(rest) - 1, 0.975) * np.sqrt(len(rest)) * more.std(axis=1, ddof=1)
    order = [k for k in np.argsort(more.sum(axis=1)) if more[k].sum() <= chance[k]]
    delays = {1e-3 * human.delays_ms[k]: stiffness[k] for k in order}
    quick = without_slow(record, late_by(columns, rate, next(iter(delays))), human.slow_hz)
    also = {**made.also, **reflex_columns(quick)}
    other, softer = (
        one and with_reflex(replace(one, slow=record.slow), human) for one in (record.other, record.softer)
    )
    return replace(made, also=also, reflex_delays=delays, other=other, softer=softer)


def lag_of_person(record: Record) -> effects.Fault | None:
    """By how much the torque of a person's joint lags the angle [s], by what is quick, beside reflex and friction; None
    where the motion does not tell. `record` has the columns of the reflex."""
    quick, lag = without_will(record, HumanJoint(slow_hz=ABOVE_HZ)).coarse, 2e-3
    also = {**quick.also, **{f"friction_{k}": one for k, one in enumerate(friction_columns(record, 160.0).T)}}
    quick = replace(quick, also={name: without_slow(quick, one, ABOVE_HZ) for name, one in also.items()})
    columns, centre = columns_of(quick)
    higher = seven_point_motion(quick.time, quick.motion.alpha, quick.rate_hz)
    columns |= {"jerk": higher.omega, "snap": higher.alpha}
    try:
        for _ in range(5):  # from 2 ms on; the series in the lag is short about 0
            earlier = replace(quick, filtered_torque=np.interp(quick.time + lag, quick.time, quick.filtered_torque))
            fit = effects.near_lag(gram.gram_sums(earlier, columns, list(columns), centre), eq15_of(quick), 0.0)
            lag += fit["lag_s"]
    except effects.CANNOT_TELL:
        return None
    se = float(np.hypot(fit.se("lag_s"), REFLEX_ERROR))
    sure = abs(fit["lag_s"]) < se and effects.is_certain(lag, se, fit.freedom("lag_s"))
    return effects.Fault(lag, se, sure, abs(lag) + effects.POSSIBLE * se)


def person_lag_row(analysis: Analysis, raw: Record, hidden: float) -> Row:
    """The lag of a person's torque, and K and B without it, or without 1 ms of lag where one might change K, B or I by
    more than the share that may be `hidden`. `raw` is the record with its slow part."""
    lag, fit = lag_of_person(analysis.record), analysis.whole
    taken = lag.size if lag and lag.found else 1e-3
    earlier = np.interp(raw.time + taken, raw.time, raw.filtered_torque)
    made = with_reflex(replace(raw, filtered_torque=earlier, other=None, softer=None))
    without = effects.with_effects(plain_sums(made, eq15_of(made)), eq15_of(made))
    moved = {name: abs(without[name] - fit[name]) for name in "KBI"}
    row: Row = {f"{name}_without_lag": without[name] for name in "KB"}
    share = max(by / abs(fit[name]) for name, by in moved.items())
    if lag is None or (not lag.found and lag.possible / taken * share > hidden):
        return row
    shift = max(by / (fit.interval(name)[1] - fit[name]) for name, by in moved.items()) if lag.found else 0.0
    told: Row = {"lag_s": lag.size, "lag_se_s": lag.se, "lag_shift": shift, "lag_by": "Eq. 15 with a reflex"}
    return told | row if lag.found else told


def over_basis(record: Record, values: Array) -> Array:
    """Cubic B-splines (m, 6) at values (m,) of the slow signal of a record, with knots at its thirds; they sum to 1."""
    assert record.slow is not None
    fitted = record.part(record.slow)
    low, *thirds, high = np.quantile(fitted, [0.0, 1 / 3, 2 / 3, 1.0])
    knots = np.r_[[low] * 4, thirds, [high] * 4]
    return np.asarray(BSpline.design_matrix(np.clip(values, low, high), knots, 3).toarray())


OVER: dict[str, type[pl.DataType]] = {"trial": pl.String, "over": pl.String, "share": pl.Float64, "at": pl.Float64}
OVER |= {f"{name}{end}": pl.Float64 for name in "KB" for end in ("", "_se", "_low", "_high")}


def over_table(analysis: Analysis) -> pl.DataFrame:
    """The trial's rows of `impedance_over.csv`: K and B at even values of the signal that they change with, from that
    which 5 % of the rows are below to that of 95 %; none where nothing is asked for."""
    record, fit, rows, human = analysis.record, analysis.whole, list[Row](), human_of(analysis.record)
    if record.slow is None or human is None:
        return pl.DataFrame(schema=OVER)
    fitted = record.part(record.slow)
    low, high = np.quantile(fitted, [0.05, 0.95]).tolist()
    at = np.linspace(low, high, 19)
    shares = np.searchsorted(np.sort(fitted), at) / len(fitted)
    weights = over_basis(record, at) - over_basis(record, fitted).mean(axis=0)
    shown = (
        np.rad2deg(at) if human.over in ("angle", "theta_slow") else at - record.time[0] if human.over == "time" else at
    )
    for share, value, weight in zip(shares, shown, weights, strict=True):
        row: Row = {"trial": record.name, "over": human.over, "share": float(share), "at": float(value)}
        for name in "KB":
            turn, own = np.zeros(len(fit.names)), [name, *(f"{name}_over_{k}" for k in range(1, len(weight)))]
            turn[[fit.names.index(one) for one in own]] = [1.0, *weight[1:]]
            se, free = float(np.sqrt(turn @ fit.covariance @ turn)), min(map(fit.freedom, own))
            half, best = float(stdtrit(free, 0.975)) * se, float(turn @ fit.estimates)
            row |= {name: best, f"{name}_se": se, f"{name}_low": best - half, f"{name}_high": best + half}
        rows.append(row)
    return pl.DataFrame(rows, schema=OVER)


def friction_columns(record: Record, *cutoffs_hz: float) -> Array:
    """Friction (n, 3 k) in the rows of the coarse record, which turns its sign over three speeds. It follows the speed
    below each of k cut-offs, before the record's filter: of a creeping joint both differ, of a coarse encoder too."""
    rate, theta = record.rate_hz, record.theta
    speeds = [np.gradient(LowPass(min(hz, 0.45 * rate), 2)(theta, rate), 1 / rate) for hz in cutoffs_hz]
    signs = np.tanh(np.array([speed / width for speed in speeds for width in SIGN_WIDTHS]).T)
    return record.low_pass(signs, rate)[:: round(rate / record.coarse.rate_hz)]


def reflex_columns(columns: Array) -> dict[str, Array]:
    """The columns (n, k) of a reflex by name."""
    return {f"reflex_{k}": column for k, column in enumerate(columns.T)}


def fit_beside(record: Record, columns: Array) -> gram.GroupFit:
    """Eq. 15 of a record with columns (n, k) beside those that it has, as `gain_0`."""
    made = replace(record, also={**record.also, **{f"gain_{k}": column for k, column in enumerate(columns.T)}})
    return gram.fit_groups(plain_sums(made, eq15_of(made)), eq15_of(made), limit=np.inf)


def reflex_row(analysis: Analysis, raw: Record) -> Row:
    """What a fit has of a reflex, and whether the torque has one that the model has not; `raw` is the record with its
    slow part. `K_with_reflex` is K with that one in the model; of a person it must be beyond the interval of K, and so
    must K with a gain that changes with the angle, for which the fitted reflex times the angle is asked (t)."""
    record, human, fit = analysis.record, human_of(raw), analysis.whole
    delays = [f"reflex_delay_{end}ms" for end in ("", "low_", "high_")]
    row: Row = dict.fromkeys(("reflex_share", *delays, "K_over_delays", "untold_share", "reflex_p", "K_with_reflex"))
    row |= {"reflex_gain_p": None, "K_with_gain": None}
    low, high = fit.interval("K")
    if human:
        columns = {name: column for name, column in record.also.items() if name.startswith("reflex")}
        reflex = sum(fit[name] * record.part(column) for name, column in columns.items())
        share = 100 * float(np.var(reflex) / np.var(record.part(record.filtered_torque)))
        tried, (K, *others) = list(record.reflex_delays), record.reflex_delays.values()
        row |= dict(zip(delays, (1e3 * one for one in (tried[0], min(tried), max(tried))), strict=True))
        row["untold_share"] = max((fit.interval(name)[1] - fit[name]) / abs(fit[name]) for name in "KBI")
        row |= {"reflex_share": share, "K_over_delays": max((abs(other - K) for other in others), default=0.0)}
        late = late_by(half_waves(raw, human.memory_s), raw.rate_hz, tried[0])
        angle = raw.motion.theta - raw.part(raw.motion.theta).mean()
        moved = without_slow(raw, late * angle[:, None], human.slow_hz)
        one = fit_beside(record, moved @ [[fit[f"reflex_{k}"]] for k in range(len(moved.T))])
        row["reflex_gain_p"] = chance = 2 * float(stdtr(one.freedom("gain_0"), -abs(one["gain_0"]) / one.se("gain_0")))
        if chance < 1e-2:
            K = fit_beside(record, moved)["K"]
            row |= {"reflex_gain_p": 1.0} if low < K < high else {"K_with_gain": K}
    memory = human.memory_s if human else 0.0  # the reflex that the model has ends there
    row["reflex_p"] = p = reflex_test(record, raw, USUAL_DELAY_S + memory)
    if p is not None and p < 1e-2:
        longer = HumanJoint() if human is None else human.model_copy(update={"memory_s": 2 * human.memory_s})
        K = fit_beside(with_reflex(raw, longer), np.empty((len(raw.time), 0)))["K"]
        row |= {"reflex_p": 1.0} if human and low < K < high else {"K_with_reflex": K}
    return row


def reflex_test(record: Record, raw: Record, delay_s: float) -> float | None:
    """Probability of what the speed, late by a delay or more, explains of the torque, if it were chance (Wald's test by
    the scores of stretches); None where a record, or the period after which its motion repeats itself, is too short.

    The speed is the even part of a half-wave: no linear dynamics makes it. Springs and stops that differ between the
    directions do, and friction of a joint that creeps after stretches, but at once: their columns compete, and what
    they leave goes along with the speed to come as much as with the past one. It is 1 where that explains little more.
    """
    few, human = raw.coarse, human_of(raw) or HumanJoint()
    groups = stretches_of(few.pieces, few.rate_hz, max(few.seconds / TESTED_BLOCKS, SHORTEST_TESTED_S))
    blocks = len(groups.first)
    new_s = few.seconds if raw.periodic is None else raw.periodic.period
    if record.is_stepped_sine or min(blocks, new_s / SHORTEST_TESTED_S) < FEWEST_TESTED:
        return None
    quick = (record if human_of(raw) else without_will(raw, human)).coarse
    theta, omega = few.motion.theta - few.part(few.motion.theta).mean(), few.motion.omega
    even = np.array([theta**2, np.abs(theta), theta**4, omega**2, np.abs(omega)]).T
    at_once = np.column_stack([even, friction_columns(raw, 80.0, 25.0)])
    base = [*columns_of(quick)[0].values(), *without_slow(few, at_once, human.slow_hz).T]
    speed = np.abs(omega)[:, None]
    explained, scores, found = list[float](), np.empty(0), np.empty(0)
    for way in (-1, 1):  # the speed to come, then the past one
        late = late_by(through_memory(speed[::way], few.rate_hz, human.memory_s), few.rate_hz, delay_s)[::way]
        Z = np.column_stack([*base, without_slow(few, late, human.slow_hz), quick.filtered_torque])
        each = products_between(Z, Z, groups.first, groups.stop)
        total, less = each.sum(axis=0), np.r_[: len(base), -1]
        explained.append(float(gram.least_left(total[np.ix_(less, less)]) - gram.least_left(total)))
        estimates, inverse = gram.solved(total[:-1, :-1], total[:-1, -1])
        scores, found = (
            ((each[:, :-1, -1] - each[:, :-1, :-1] @ estimates) @ inverse)[:, -COSINES:],
            estimates[-COSINES:],
        )
    if explained[1] < BEFORE_OVER_AFTER * explained[0]:
        return 1.0
    size = found @ np.linalg.pinv(scores.T @ scores * blocks / (blocks - 1)) @ found
    free = blocks - COSINES
    return float(fdtrc(COSINES, free, size * free / (COSINES * (blocks - 1))))
