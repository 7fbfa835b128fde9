"""The stretch reflex of a person as columns beside Eq. 15, and whether a torque has one.

The reflex is the parallel pathway of Kearney, Stein and Parameswaran (IEEE Trans. Biomed. Eng. 44, 1997): half-wave
rectified velocity, some 40 ms late, through an impulse response of half a second; here of both directions. What is slow
counts for the person's own will.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy

from osl_analysis.bench import gram
from osl_analysis.bench.analysis import without_row
from osl_analysis.bench.effects import IMPEDANCE, Model, columns_of
from osl_analysis.bench.gram import GroupFit, Sums
from osl_analysis.bench.record import Record, stretches_of
from osl_analysis.bench.settings import HumanJoint
from osl_analysis.signals import LowPass, Motion
from osl_analysis.stats.covariance import products_between
from osl_analysis.stats.regression import Row
from osl_analysis.trial import Array

COSINES = 8  # in which an impulse response is described; each next one is broader
EARLY_S = 0.04  # lag [s] from which on there are equally many for each doubling of it
BLOCKS, SHORTEST_BLOCK_S = 30, 2.0  # stretches whose scores make the intervals: number, and least duration [s]
TESTED_BLOCKS, SHORTEST_TESTED_S, FEWEST_TESTED = 48, 1.0, 20  # the same of the test for a reflex
SOONER_MS = 10.0  # by which a reflex sooner than all that are tried is asked for
USUAL_DELAY_S = 0.04  # of a stretch reflex of the ankle [s]
SIGN_WIDTHS = (0.005, 0.02, 0.1)  # speeds [rad/s] over which friction turns its sign
BEFORE_OVER_AFTER = 1.7  # how much more past speed must explain than the speed to come; sound joints: 1.5


@dataclass(frozen=True)
class Reflexive:
    """A record without its slow part, and the columns of a reflex that are fitted beside Eq. 15."""

    raw: Record  # with its slow part
    human: HumanJoint
    record: Record
    beside: Mapping[str, Array]  # columns (n,), of the reflex and of what K and B change with
    delays: Mapping[float, float]
    """K [N*m/rad] by delay [s] of the reflex, the best one first, then those that predict as well within chance."""
    K_sooner: float | None = None
    """K [N*m/rad] by a delay that is 10 ms below the shortest one, where it predicts better than all; else None."""
    slow: Array | None = None  # signal (n,) that K and B change with; None: they do not

    @property
    def model(self) -> Model:
        """Eq. 15, with what is fitted beside it."""
        return {**IMPEDANCE, **{name: name for name in self.beside}}

    @property
    def sums(self) -> Sums:
        return sums_beside(self.record, self.beside)

    def fit_with(self, *further: Array) -> GroupFit:
        """The fit with further columns (n,) beside it, as `gain_0`."""
        gains = {f"gain_{k}": column for k, column in enumerate(further)}
        sums, model = (
            sums_beside(self.record, {**self.beside, **gains}),
            {**self.model, **{name: name for name in gains}},
        )
        return gram.fit_groups(sums, model, limit=np.inf)


def sums_beside(record: Record, beside: Mapping[str, Array]) -> Sums:
    """The sums of a record with columns (n,) beside those of Eq. 15, which are like one another and no estimates."""
    columns, centre = columns_of(record)
    return gram.gram_sums(record, {**columns, **beside}, [*IMPEDANCE.values(), *beside], centre, frozenset(beside))


def through_memory(signals: Array, rate_hz: float, memory_s: float) -> Array:
    """Signals (n, k) through raised cosines on the logarithm of the lag, (n, 8 k): what impulse responses are made of,
    up to two thirds of the memory [s], in units of the signal times seconds."""
    log_lag = np.log(np.arange(round(memory_s * rate_hz)) / rate_hz + EARLY_S)
    middle = np.linspace(np.log(EARLY_S), np.log(0.7 * memory_s + EARLY_S), COSINES + 2)[2:]
    away = (log_lag[:, None] - middle) / (middle[1] - middle[0])
    responses = (1 + np.cos(np.pi * np.clip(away / 2, -1, 1))) / 2 / rate_hz
    return np.concatenate(
        [scipy.signal.fftconvolve(one[:, None], responses, axes=0)[: len(one)] for one in signals.T], axis=1
    )


def static_gains(record: Record, memory_s: float) -> Array:
    """What each of the columns of one half-wave is in the end [s], (8,), if the half-wave stays 1."""
    step = np.ones((round(memory_s * record.rate_hz) + 1, 1))
    return np.asarray(through_memory(step, record.rate_hz, memory_s)[-1])


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


def without_will(record: Record, slow_hz: float) -> Record:
    """The record without the slow part of angle and torque, about their means, in stretches of a thirtieth."""
    signals = record.motion.theta, record.motion.omega, record.motion.alpha, record.filtered_torque
    theta, omega, alpha, torque = (without_slow(record, one, slow_hz) for one in signals)
    angle, level = (float(record.part(signals[k]).mean()) for k in (0, 3))
    groups = stretches_of(record.pieces, record.rate_hz, max(record.seconds / BLOCKS, SHORTEST_BLOCK_S))
    motion = Motion(theta + angle, omega, alpha)
    return replace(record, motion=motion, filtered_torque=torque + level, groups=groups, periodic=None)


def with_reflex(raw: Record, human: HumanJoint, slow: Array | None = None) -> Reflexive:
    """The record of a person's joint, whose K and B may change with a `slow` signal (n,). The delay of the reflex is
    the one of those in the settings with which the other stretches predict each stretch best; beside it stand those
    that do so as well within chance, by the scatter of what they leave in the stretches."""
    rate, record = raw.rate_hz, without_will(raw, human.slow_hz)
    columns, changing = half_waves(raw, human.memory_s), dict[str, Array]()
    if slow is not None:
        turned = slow - raw.part(slow).mean()  # the reflex's gain changes with the signal in a straight line
        columns = np.hstack([columns, columns * (turned / np.abs(turned).max())[:, None]])
        changing = changing_columns(raw, human, slow, record.part(slow))
    few = record.coarse
    step = round(rate / few.rate_hz)
    thinned = {name: column[::step] for name, column in changing.items()}
    quick = without_slow(raw, columns, human.slow_hz)[::step]
    left, stiffness = list[Array](), list[float]()
    sooner = [min(human.delays_ms) - SOONER_MS] if min(human.delays_ms) > SOONER_MS else []
    for delay in (*human.delays_ms, *sooner):
        s = sums_beside(few, thinned | reflex_columns(late_by(quick, few.rate_hz, 1e-3 * delay)))
        rest = s.total - s.gram
        estimates = gram.solved(rest[:, :-2, :-2], rest[:, :-2, s.torque])[0]
        error = np.column_stack([estimates, -np.ones(len(rest))])
        left.append(np.einsum("mp,mpq,mq->m", error, s.gram[:, :-1, :-1], error))
        stiffness.append(float(gram.solved(s.total[:-2, :-2], s.total[:-2, s.torque])[0][s.names.index("theta")]))
    tried = left[: len(human.delays_ms)]
    best = min(tried, key=np.sum)
    K_sooner = stiffness[-1] if left[-1].sum() < best.sum() else None
    more = np.array(tried) - best
    chance = scipy.special.stdtrit(len(rest) - 1, 0.975) * np.sqrt(len(rest)) * more.std(axis=1, ddof=1)
    order = [k for k in np.argsort(more.sum(axis=1)) if more[k].sum() <= chance[k]]
    delays = {1e-3 * human.delays_ms[k]: stiffness[k] for k in order}
    quick = without_slow(raw, late_by(columns, rate, next(iter(delays))), human.slow_hz)
    return Reflexive(raw, human, record, changing | reflex_columns(quick), delays, K_sooner, slow)


def changing_columns(raw: Record, human: HumanJoint, slow: Array, fitted: Array) -> dict[str, Array]:
    """Columns (n,) by which K, B and the torque without motion change with a slow signal (n,), of which rows (m,) are
    fitted."""
    shares = over_basis(fitted, slow) - over_basis(fitted, fitted).mean(axis=0)
    moved = {"K": raw.motion.theta - raw.part(raw.motion.theta).mean(), "B": raw.motion.omega}
    if human.over != "time":
        moved["level"] = np.ones_like(slow)
    return {
        f"{name}_over_{k}": column
        for name, signal in moved.items()
        for k, column in enumerate(without_slow(raw, signal[:, None] * shares[:, 1:], human.slow_hz).T, 1)
    }


def over_basis(fitted: Array, values: Array) -> Array:
    """Cubic B-splines (m, 6) at values (m,) of a signal, with knots at thirds of its `fitted` rows; they sum to 1."""
    low, *thirds, high = np.quantile(fitted, [0.0, 1 / 3, 2 / 3, 1.0])
    knots = np.r_[[low] * 4, thirds, [high] * 4]
    return np.asarray(scipy.interpolate.BSpline.design_matrix(np.clip(values, low, high), knots, 3).toarray())


def friction_columns(record: Record, *cutoffs_hz: float) -> Array:
    """Friction (n, 3 k) in the rows of the coarse record, which turns its sign over three speeds. It follows the speed
    below each of k cut-offs, before the record's filter: of a creeping joint both differ, of a coarse encoder too."""
    rate, theta = record.rate_hz, record.theta
    speeds = [np.gradient(LowPass(min(hz, 0.45 * rate), 2)(theta, rate), 1 / rate) for hz in cutoffs_hz]
    step, widths = round(rate / record.coarse.rate_hz), SIGN_WIDTHS
    return np.array([record.low_pass(np.tanh(v / width), rate)[::step] for v in speeds for width in widths]).T


def reflex_columns(columns: Array) -> dict[str, Array]:
    """The columns (n, k) of a reflex by name."""
    return {f"reflex_{k}": column for k, column in enumerate(columns.T)}


def unstated_reflex_row(record: Record) -> Row:
    """Whether the torque of a device has a reflex, and K, B and I with one in the model."""
    p = reflex_test(record, HumanJoint(), USUAL_DELAY_S)
    fit = with_reflex(record, HumanJoint()).fit_with() if p is not None and p < 1e-2 else None
    return {"reflex_p": p, **without_row(fit, "with_reflex")}


def reflex_test(raw: Record, human: HumanJoint, delay_s: float, person: Reflexive | None = None) -> float | None:
    """Probability of what the speed, late by a delay or more, explains of the torque, if it were chance (Wald's test by
    the scores of stretches); None where a record, or the period after which its motion repeats itself, is too short.

    The speed is the even part of a half-wave: no linear dynamics makes it. Springs and stops that differ between the
    directions do, and friction of a joint that creeps after stretches, but at once: their columns compete, and what
    they leave goes along with the speed to come as much as with the past one. It is 1 where that explains little more.
    Of a `person` what is fitted competes, too.
    """
    few = raw.coarse
    groups = stretches_of(few.pieces, few.rate_hz, max(few.seconds / TESTED_BLOCKS, SHORTEST_TESTED_S))
    blocks = len(groups.first)
    new_s = few.seconds if raw.periodic is None else raw.periodic.period
    if raw.is_stepped_sine or min(blocks, new_s / SHORTEST_TESTED_S) < FEWEST_TESTED:
        return None
    quick = (person.record if person else without_will(raw, human.slow_hz)).coarse
    step = round(raw.rate_hz / few.rate_hz)
    beside = [column[::step] for column in person.beside.values()] if person else []
    theta, omega = few.motion.theta - few.part(few.motion.theta).mean(), few.motion.omega
    even = np.array([theta**2, np.abs(theta), theta**4, omega**2, np.abs(omega)]).T
    at_once = np.column_stack([even, friction_columns(raw, 80.0, 25.0)])
    base = [*columns_of(quick)[0].values(), *beside, *without_slow(few, at_once, human.slow_hz).T]
    own = slice(len(base), len(base) + COSINES)
    Z = np.column_stack([*base, np.empty((len(theta), COSINES)), quick.filtered_torque])
    speed, less = np.abs(omega)[:, None], np.r_[: own.start, -1]
    del even, at_once, base
    explained, scores, found = list[float](), np.empty(0), np.empty(0)
    for way in (-1, 1):  # the speed to come, then the past one
        late = late_by(through_memory(speed[::way], few.rate_hz, human.memory_s), few.rate_hz, delay_s)[::way]
        Z[:, own] = without_slow(few, late, human.slow_hz)
        each = products_between(Z, Z, groups.first, groups.stop)
        total = each.sum(axis=0)
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
    return float(scipy.special.fdtrc(COSINES, free, size * free / (COSINES * (blocks - 1))))
