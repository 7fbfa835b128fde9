"""A person's joint: Eq. 15 with columns of a reflex, its row of `human_joint.csv`, and K and B over
a signal; and a test whether the torque of a device has a reflex.

The reflex is the parallel pathway of Kearney, Stein and Parameswaran (IEEE Trans. Biomed. Eng. 44,
1997): half-wave rectified velocity, delayed by some 40 ms, through muscle; here for both
directions. Slow torque is voluntary."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from operator import itemgetter
from typing import Any

import numpy as np
import polars as pl
import scipy

from osl_analysis.bench import effects, gram
from osl_analysis.bench.analysis import (
    QUANTITIES,
    Analysis,
    angle_noise_share,
    check_resists,
    fitted_motion,
    torque_at_peaks,
    turn_deg,
    without_row,
)
from osl_analysis.bench.effects import IMPEDANCE, Model, columns_of
from osl_analysis.bench.gram import GroupFit, Sums, held_out_vaf
from osl_analysis.bench.record import (
    QUICK,
    Groups,
    Record,
    logged,
    periods_of,
    record_of_trial,
    stretches_of,
)
from osl_analysis.bench.settings import HumanJoint, HumanJointAnalysis
from osl_analysis.bench.witness import ALIKE, HIDDEN, harm_of, no_witness, wald, witness_row
from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass, Motion, sampling_rate, seven_point_motion
from osl_analysis.signals.grid import uniform_signals
from osl_analysis.spectral.stepped_sine import Likeness
from osl_analysis.stats.regression import ROUNDED, Row, products_between
from osl_analysis.trial import Array, Trial

COSINES = 8  # basis functions of a reflex's impulse response; each next one is broader
EARLY_S = 0.04  # above this lag [s] they are evenly spaced in its logarithm
# stretches whose scores give the intervals: number, and least duration [s]
BLOCKS, SHORTEST_BLOCK_S = 30, 2.0
# the same for the reflex test, and their least number
TESTED_BLOCKS, SHORTEST_TESTED_S, FEWEST_TESTED = 48, 1.0, 20
# how much sooner than allowed one is tried; delays this near [s] to an end are at it
SOONER_MS, AT_END_S = 10.0, 2e-4
# orders of muscle that are tried, and numbers of cosines beside it
ORDERS, FURTHER = (2, 3), (0, 4, 8, 12)
TOLD = 0.5 * ROUNDED  # largest scaled condition number with cosines: above it the fit is refused
# least, first and largest; muscle of damping 10 is of first order
LAG_S, DAMPED = (0.01, 0.1, 0.25), (0.4, 3.0, 10.0)
# steps of delay [s], log lag and log damping, for the derivatives of the answer
MOVES = np.array([5e-4, 0.03, 0.03])
OWN_SHARE = 0.95  # of the power of the angle's speed that lies below the cut-off if none is stated
# limits of misfit (delay/low-pass) and lag (low-pass/delay) for a delay; low-passes: 0.86, 1.22
DELAYED = 0.8, 1.15
REFLEX_ERROR = 60e-6  # SD [s] of a lag due to a reflex that the columns do not describe
# % of the variance below which there is no reflex: 20 joints without one had up to 0.23, ankles 0.7
LEAST_REFLEX = 0.5
# share of the misfit and p-value at which friction is the cause; p-value at which it may be
RUBS = 0.2, 1e-6, 1e-4
USUAL_DELAY_S = 0.04  # of the ankle's stretch reflex
SIGN_WIDTHS = (0.005, 0.02, 0.1)  # speeds [rad/s] over which friction changes its sign
# past speed must explain this much more than future speed; sound joints: up to 1.5
BEFORE_OVER_AFTER = 1.7


@dataclass(frozen=True)
class Muscle:
    """The answer to half-waves of the velocity: a muscle of some order and of gain 1 behind a
    delay, its derivatives by its `values`, and cosines for other shapes of the answer."""

    order: int
    values: Array  # delay [s], log of the lag [s] behind a lasting speed, log of the damping
    known: bool = False  # whether the delay is stated, or at an end of those that are allowed
    half_s: float = np.inf  # half-width of the delay's 95 % interval [s]
    cosines: int = 0  # number of them

    def answers(self, half_waves: Array, rate_hz: float, values: Array) -> Array:
        """The response of a muscle with some values to half-waves (n, k), by its transfer
        function."""
        n = scipy.fft.next_fast_len(len(half_waves) + round(4 * LAG_S[-1] * rate_hz), real=True)
        s = 2j * np.pi * np.fft.rfftfreq(n, 1 / rate_hz)
        lag, damping = np.exp(values[1:])
        slow = lag / (2 * damping)
        muscle = np.exp(-s * values[0]) / (
            (1 + lag * s + (slow * s) ** 2) * (1 + slow * s) ** (self.order - 2)
        )
        return np.fft.irfft(np.fft.rfft(half_waves, n, axis=0) * muscle[:, None], n, axis=0)[
            : len(half_waves)
        ]

    def columns(self, half_waves: Array, rate_hz: float, memory_s: float) -> Array:
        """Its columns (n, m) for half-waves (n, k); the k columns of each kind follow one
        another."""
        found = [self.answers(half_waves, rate_hz, self.values)]
        for move in np.diag(MOVES)[self.known :]:
            ends = (self.answers(half_waves, rate_hz, self.values + end) for end in (move, -move))
            found.append(np.subtract(*ends) / (2 * move.max()))
        if self.cosines:
            broad = cosines(rate_hz, memory_s, self.cosines)
            of_each = [
                scipy.signal.fftconvolve(one[:, None], broad, axes=0)[: len(one)]
                for one in half_waves.T
            ]
            found += [
                late_by(one, rate_hz, self.values[0]) for one in np.transpose(of_each, (2, 1, 0))
            ]
        return np.hstack(found)


@dataclass(frozen=True)
class Reflexive:
    """A record without its slow part, and the columns of a reflex that are fitted beside Eq. 15."""

    raw: Record  # with its slow part
    human: HumanJoint
    record: Record
    beside: Mapping[str, Array]  # columns (n,) of the reflex, and of the changes of K and B
    muscles: "Sequence[Tried]"  # the first one made the columns
    slow: Array | None = None  # signal (n,) with which K and B change; None: they do not

    @cached_property
    def half_waves(self) -> Array:
        """The positive and the negative part of the velocity (n, 2) [rad/s], filtered like the
        torque. The sign is that of a velocity with a higher cut-off: the filtered one changes its
        sign at other times."""
        low_pass, rate = self.raw.low_pass, self.raw.rate_hz
        swift = replace(low_pass, cutoff_hz=min(QUICK * low_pass.cutoff_hz, 0.2 * rate))
        omega = np.gradient(swift(self.raw.theta, rate), 1 / rate)
        return low_pass(np.column_stack([np.maximum(omega, 0), np.minimum(omega, 0)]), rate)

    @property
    def coarse(self) -> dict[str, Array]:
        """The columns `beside` in the rows of the coarse record."""
        step = round(self.raw.rate_hz / self.record.coarse.rate_hz)
        return {name: column[::step] for name, column in self.beside.items()}

    @property
    def model(self) -> Model:
        """Eq. 15, with what is fitted beside it."""
        return {**IMPEDANCE, **{name: name for name in self.beside}}

    @property
    def sums(self) -> Sums:
        return sums_beside(self.record, self.beside)

    @property
    def fit(self) -> GroupFit:
        return gram.fit_groups(self.sums, self.model, limit=np.inf)


Tried = tuple[Muscle, Array]  # and its prediction error in each stretch (m,), as `predicted`
PersonFit = tuple[Reflexive, Analysis]  # Eq. 15 with a reflex, fitted to a trial


def sums_beside(record: Record, beside: Mapping[str, Array]) -> Sums:
    """The sums of a record with columns (n,) beside those of Eq. 15, which are collinear and no
    estimates."""
    columns, centre = columns_of(record)
    return gram.gram_sums(
        record, {**columns, **beside}, [*IMPEDANCE.values(), *beside], centre, frozenset(beside)
    )


def cosines(rate_hz: float, memory_s: float, number: int = COSINES) -> Array:
    """Raised cosines on the logarithm of the lag (m, n), to two thirds of the memory [s], times the
    sampling step."""
    log_lag = np.log(np.arange(round(memory_s * rate_hz)) / rate_hz + EARLY_S)
    middle, apart = np.linspace(
        np.log(EARLY_S), np.log(0.7 * memory_s + EARLY_S), number + 2, retstep=True
    )
    away = (log_lag[:, None] - middle[2:]) / apart
    return np.asarray((1 + np.cos(np.pi * np.clip(away / 2, -1, 1))) / 2 / rate_hz)


def turned(raw: Record, columns: Array, slow: Array | None) -> Array:
    """Columns (n, k) of a reflex, and those of a gain that is linear in a slow signal."""
    if slow is None:
        return columns
    away = slow - raw.part(slow).mean()
    return np.hstack([columns, columns * (away / np.abs(away).max())[:, None]])


def late_by(columns: Array, rate_hz: float, delay_s: float) -> Array:
    """Columns (n, k) delayed, with zeros before them."""
    return np.pad(columns, ((round(delay_s * rate_hz), 0), (0, 0)))[: len(columns)]


def long_pieces(record: Record, slow_hz: float) -> list[slice]:
    """The pieces of a record, between ends and gaps, that are long enough for a filter at
    `slow_hz`; the longest anyway."""
    lengths = [piece.stop - piece.start for piece in record.pieces]
    least = min(3 * record.rate_hz / slow_hz + 1, max(lengths))
    return [piece for piece, length in zip(record.pieces, lengths, strict=True) if length >= least]


def without_slow(record: Record, signals: Array, slow_hz: float) -> Array:
    """Signals (n, ...) of a record, high-passed at some frequency [Hz] by a zero-phase filter in
    each piece: across a gap derivatives are wrong, and the filter would spread this error over a
    second."""
    quick = np.zeros_like(signals)
    for piece in long_pieces(record, slow_hz):
        quick[piece] = signals[piece] - LowPass(slow_hz, 2)(signals[piece], record.rate_hz)
    return quick


def without_will(record: Record, slow_hz: float, memory_s: float = 0.0) -> Record:
    """The record without the slow part of angle and torque, which keep their means, divided into 30
    stretches. The start of each piece is dropped, since the `memory_s` before it was not
    recorded."""
    signals = record.motion.theta, record.motion.omega, record.motion.alpha, record.filtered_torque
    theta, omega, alpha, torque = (without_slow(record, one, slow_hz) for one in signals)
    angle, level = (float(record.part(signals[k]).mean()) for k in (0, 3))
    past = round(memory_s * record.rate_hz)
    pieces = [
        slice(one.start + past, one.stop)
        for one in long_pieces(record, slow_hz)
        if one.stop - one.start > past
    ]
    groups, motion, quick, seen = (
        None,
        Motion(theta + angle, omega, alpha),
        torque + level,
        np.zeros(len(theta), bool),
    )
    if record.periodic is not None:
        seen[np.concatenate([np.r_[piece] for piece in pieces])] = True
        groups = periods_of(record.periodic, record.rate_hz, seen, SHORTEST_TESTED_S)
    groups = groups or stretches_of(
        pieces, record.rate_hz, max(record.seconds / BLOCKS, SHORTEST_BLOCK_S)
    )
    return replace(
        record, motion=motion, torque=quick, filtered_torque=quick, groups=groups, periodic=None
    )


def of_units(groups: Groups, sums: Array) -> Array:
    """Sums (m, ...) of groups, added up over repeats of one another, which share what the model
    misses."""
    begins = (
        np.flatnonzero(np.diff(groups.stratum, prepend=-1))
        if groups.repeat
        else np.arange(len(sums))
    )
    return np.asarray(np.add.reduceat(sums, begins))


def with_reflex(
    raw: Record,
    human: HumanJoint,
    slow: Array | None = None,
    muscles: Sequence[Tried] = (),
    late: bool = False,
) -> Reflexive:
    """A person's record with the columns of the best muscle; K and B may change with a `slow`
    signal (n,)."""
    record = without_will(raw, human.slow_hz, human.memory_s)
    changing = {} if slow is None else changing_columns(raw, human, slow, record.part(slow))
    person = Reflexive(raw, human, record, changing, muscles, slow)
    muscles = muscles or muscles_like(person, late)
    columns = turned(
        raw, muscles[0][0].columns(person.half_waves, raw.rate_hz, human.memory_s), slow
    )
    reflex = {
        f"reflex_{k}": column
        for k, column in enumerate(without_slow(raw, columns, human.slow_hz).T)
    }
    return replace(person, beside=changing | reflex, muscles=muscles)


def muscles_like(person: Reflexive, late: bool) -> list[Tried]:
    """Least-squares muscle of each order, with and without cosines; first the one with the best
    leave-one-out prediction of stretches. (Taking the fewest cosines among those that predict
    equally well misses a second burst: 114 of 128 intervals of sound joints held B, now 122.) If
    the torque may be `late`, the terms of Eq. 15 that a delay adds are fitted, too, lest the reflex
    make up for them."""
    raw, few, human, found = person.raw, person.record.coarse, person.human, list[Tried]()
    step = round(raw.rate_hz / few.rate_hz)
    waves, slow = person.half_waves[::step], None if person.slow is None else person.slow[::step]
    beside = person.coarse
    if late:
        higher = seven_point_motion(few.time, few.motion.alpha, few.rate_hz)
        beside |= {"jerk": higher.omega, "snap": higher.alpha}
    base = np.array(
        [few.part(column) for column in (*columns_of(few)[0].values(), *beside.values())]
    )
    torque, rows = few.part(few.filtered_torque), few.rows()

    def quick(columns: Array) -> Array:
        return without_slow(raw.coarse, turned(raw.coarse, columns, slow), human.slow_hz)

    def unexplained(values: Array, order: int) -> Array:
        answer = quick(Muscle(order, values).answers(waves, few.rate_hz, values))
        X = np.vstack([base, few.part(answer).T])
        return np.asarray(torque - gram.solved(X @ X.T, X @ torque)[0] @ X)

    (soonest, latest), (low, start, high) = (
        np.quantile(human.delays_ms, [0, 1]) / 1e3,
        np.log([LAG_S, DAMPED]).T,
    )
    first, bounds = (
        [(soonest + latest) / 2, *start],
        ([soonest - 1e-6, *low], [latest + 1e-6, *high]),
    )
    for order in ORDERS:
        ways: dict[str, Any] = {
            "x_scale": 10 * MOVES,
            "diff_step": 1e-4,
            "xtol": 1e-4,
            "ftol": 1e-6,
            "max_nfev": 30,
        }
        fit = scipy.optimize.least_squares(unexplained, first, bounds=bounds, args=(order,), **ways)
        jacobian = np.asarray(fit.jac)
        at = [end for end in (soonest, latest) if abs(fit.x[0] - end) < AT_END_S]
        values, products = np.array([*at, *fit.x])[[0, -2, -1]], np.zeros((len(few.time), 4))
        products[rows] = np.column_stack([jacobian, fit.fun])
        of_each = products_between(
            products[:, :3], products[:, 3:], few.groups.first, few.groups.stop
        )[:, :, 0]
        covariance, freedom = gram.noise_of_scores(
            of_units(few.groups, of_each) @ np.linalg.pinv(jacobian.T @ jacobian), 3
        )
        half = float(scipy.special.stdtrit(freedom[0], 0.975) * np.sqrt(covariance[0, 0]))
        for number in FURTHER:
            muscle = Muscle(order, values, bool(at), half, number)
            columns = quick(muscle.columns(waves, few.rate_hz, human.memory_s))
            sums = sums_beside(few, beside | {f"reflex_{k}": x for k, x in enumerate(columns.T)})
            size = np.sqrt(np.maximum(np.diag(sums.total)[:-2], np.finfo(float).tiny))
            if not number or np.linalg.cond(sums.total[:-2, :-2] / np.outer(size, size)) < TOLD**2:
                found.append((muscle, predicted(sums)))
    return sorted(found, key=lambda one: float(one[1].sum()))


def predicted(sums: Sums) -> Array:
    """The residual sum of squares in each stretch (m,), of the fit to all others."""
    of_each = of_units(sums.groups, sums.gram[:, :-1, :-1])
    rest = of_each.sum(axis=0) - of_each
    error = np.hstack(
        [gram.solved(rest[:, :-1, :-1], rest[:, :-1, -1])[0], -np.ones((len(rest), 1))]
    )
    return np.asarray(np.einsum("mp,mpq,mq->m", error, of_each, error))


def delay_by_muscle(person: Reflexive) -> Row:
    """The delay [ms] of the columns' muscle, and the ends of the delay's intervals over all muscles
    that predict as well within chance, by the scatter between stretches."""
    more = [(one, left - person.muscles[0][1]) for one, left in person.muscles]
    chance = scipy.special.stdtrit(len(more[0][1]) - 1, 0.975) * np.sqrt(len(more[0][1]))
    good = [one for one, left in more if left.sum() <= chance * left.std(ddof=1)]
    ends = [one.values[0] + np.array([-1, 1]) * one.half_s for one in good]
    delays = 1e3 * np.array([person.muscles[0][0].values[0], np.min(ends), np.max(ends)])
    delays = np.clip(delays, min(person.human.delays_ms), max(person.human.delays_ms))
    return dict(
        zip(
            [f"reflex_delay_{end}ms" for end in ("", "low_", "high_")], delays.tolist(), strict=True
        )
    )


def changing_columns(
    raw: Record, human: HumanJoint, slow: Array, fitted: Array
) -> dict[str, Array]:
    """Columns (n,) by which K, B and torque at rest change with a `slow` signal (n,), whose
    `fitted` rows are (m,)."""
    shares = over_basis(fitted, slow) - over_basis(fitted, fitted).mean(axis=0)
    moved = {"K": raw.motion.theta - raw.part(raw.motion.theta).mean(), "B": raw.motion.omega}
    if human.over != "time":
        moved["level"] = np.ones_like(slow)
    return {
        f"{name}_over_{k}": column
        for name, signal in moved.items()
        for k, column in enumerate(
            without_slow(raw, signal[:, None] * shares[:, 1:], human.slow_hz).T, 1
        )
    }


def over_basis(fitted: Array, values: Array) -> Array:
    """Cubic B-splines (m, 6) at values (m,) of a signal, with knots at thirds of its `fitted` rows;
    they sum to 1."""
    low, *thirds, high = np.quantile(fitted, [0.0, 1 / 3, 2 / 3, 1.0])
    knots = np.r_[[low] * 4, thirds, [high] * 4]
    return np.asarray(
        scipy.interpolate.BSpline.design_matrix(np.clip(values, low, high), knots, 3).toarray()
    )


def friction_columns(record: Record, *cutoffs_hz: float) -> Array:
    """Friction (n, 3 k) in the rows of the coarse record, which changes sign over three widths of
    speed. Its speed has one of k cut-offs, before the record's filter: signs differ if the joint
    creeps or the encoder is coarse."""
    rate, theta = record.rate_hz, record.theta
    speeds = [
        np.gradient(LowPass(min(hz, 0.45 * rate), 2)(theta, rate), 1 / rate) for hz in cutoffs_hz
    ]
    step, widths = round(rate / record.coarse.rate_hz), SIGN_WIDTHS
    return np.array(
        [record.low_pass(np.tanh(v / width), rate)[::step] for v in speeds for width in widths]
    ).T


def unstated_reflex_row(record: Record, is_device: bool) -> Row:
    """Whether the torque of a joint has a reflex, and K, B and I with one in the model; null for a
    device."""
    p = None if is_device else reflex_test(record, HumanJoint())
    fit = with_reflex(record, HumanJoint()).fit if p is not None and p < 1e-2 else None
    return {"reflex_p": p, **without_row(fit, "with_reflex")}


def reflex_test(raw: Record, human: HumanJoint) -> float | None:
    """p-value of what the speed of 40 ms ago, or earlier, explains of the torque (Wald's test by
    the scores of stretches). None if a record, or the period of its motion, is too short.

    The speed is the even part of a half-wave: no linear dynamics makes it. Friction of a creeping
    joint and springs and stops that differ between directions make it, but without a delay: their
    columns compete. It is 1 if the past speed explains little more than the future speed, or than
    rounding, which steps repeat."""
    few = raw.coarse
    groups = stretches_of(
        few.pieces, few.rate_hz, max(few.seconds / TESTED_BLOCKS, SHORTEST_TESTED_S)
    )
    blocks = len(groups.first)
    new_s = few.seconds if raw.periodic is None else raw.periodic.period
    if raw.is_stepped_sine or min(blocks, new_s / SHORTEST_TESTED_S) < FEWEST_TESTED:
        return None
    quick = without_will(raw, human.slow_hz).coarse
    theta, omega = few.motion.theta - few.part(few.motion.theta).mean(), few.motion.omega
    even = np.array([theta**2, np.abs(theta), theta**4, omega**2, np.abs(omega)]).T
    at_once = np.column_stack([even, friction_columns(raw, 80.0, 25.0)])
    base = [*columns_of(quick)[0].values(), *without_slow(few, at_once, human.slow_hz).T]
    own, made = range(len(base), len(base) + COSINES), [] if raw.rounded is None else [*raw.rounded]
    made = [without_slow(few, torque, human.slow_hz) for torque in made]
    Z = np.column_stack([*base, np.empty((len(theta), COSINES)), *made, quick.filtered_torque])
    speed, sums, explained = np.abs(omega)[:, None], np.empty(0), list[Array]()
    torques = range(own.stop, Z.shape[1])
    del even, at_once, base, made
    for way in (-1, 1):  # the speed to come, then the past one
        answers = scipy.signal.fftconvolve(
            speed[::way], cosines(few.rate_hz, human.memory_s), axes=0
        )[: len(speed)]
        Z[:, own] = without_slow(
            few, late_by(answers, few.rate_hz, USUAL_DELAY_S)[::way], human.slow_hz
        )
        sums = products_between(Z, Z, groups.first, groups.stop)
        each = [[np.r_[:end, k] for k in torques] for end in (own.start, own.stop)]
        left = [
            [float(gram.least_left(sums.sum(axis=0)[np.ix_(x, x)])) for x in some] for some in each
        ]
        explained.append(np.array(left[0]) - left[1])
    *rounding, past = explained[1]
    if past < max(BEFORE_OVER_AFTER * explained[0][-1], ALIKE**2 * max(rounding, default=0.0)):
        return 1.0
    return float(10 ** wald(sums, range(own.start), own, 0)[0])


def own_cutoff_hz(trial: Trial, settings: HumanJointAnalysis) -> float:
    """The frequency [Hz] below which 95 % of the power of a trial's speed lies, unfiltered and less
    the floor of noise; at least `cutoff_hz`, at most an eighth of the sampling rate. Raises as
    `uniform_signals`."""
    signals = uniform_signals(trial, ("theta",), settings.gap_limits)
    rate = sampling_rate(signals.time)
    f, power = scipy.signal.welch(
        signals["theta"], rate, nperseg=min(round(4 * rate), len(signals.time))
    )
    floor = np.median(power[f > rate / 4])
    speed = np.cumsum(np.where(power > 10 * floor, power - floor, 0.0) * f**2)
    own = f[np.searchsorted(speed, OWN_SHARE * speed[-1])]
    return max(settings.cutoff_hz, round(float(min(own, rate / 8)), 3))


def fit_person(trial: Trial, settings: HumanJointAnalysis, windows: str | None = None) -> PersonFit:
    """The fit of a person's joint. Raises as `record_of_trial` and `fitted_motion`; InputError: a
    stepped sine."""
    if settings.own_cutoff:
        settings = settings.model_copy(update={"cutoff_hz": own_cutoff_hz(trial, settings)})
    raw, human = (
        record_of_trial(trial, settings, windows, excitation="any"),
        settings.human or HumanJoint(),
    )
    assert raw.uniform is not None
    if Likeness(raw.time, raw.uniform["theta"], settings.protocol).kind == "stepped sine":
        raise InputError(
            f"trial {trial.name}: theta is a stepped sine, in which a reflex is hardly told from K,"
            " B and I; move a person's joint at random, as in binary steps, or leave out `human`"
            " under `dynamometer`"
        )
    slow = {
        "angle": LowPass(human.slow_hz, 2)(raw.motion.theta, raw.rate_hz),
        "time": raw.time,
        None: None,
    }
    signal = slow.get(human.over)
    if human.over not in slow:
        signal = logged(raw, trial, {"over": (str(human.over), raw.low_pass)})["over"]
    person = with_reflex(raw, human, signal)
    again = lambda one, model: with_reflex(one, human, signal, person.muscles).sums  # noqa: E731 - its model is the same
    record = replace(person.record, other=raw.other, softer=raw.softer)
    return person, fitted_motion(record, person.sums, person.model, again)


def holding(fits: Sequence[GroupFit], *own: Row) -> Row:
    """The range that holds the intervals of K, B and I of some fits and rows."""
    found = Row()
    for name in "KBI":
        stated = [(row[f"{name}_low"], row[f"{name}_high"]) for row in own]
        each = np.array([*(one.interval(name) for one in fits), *stated], dtype=float)
        found |= {f"{name}_low": each.min(), f"{name}_high": each.max()}
    return found


def lag_of_person_row(fit: PersonFit, own: Row) -> Row:
    """The lag of the torque, and K, B and I beside it; where a first-order low-pass may be the lag,
    the range with either. These ranges join the intervals of the trial's `own` row if no lag is
    certain, a possible one changes B or I by a tenth, and no calibration states the delay. The
    reflex is refitted beside a lag, for which it would make up."""
    (person, analysis), row = (
        fit,
        dict.fromkeys(("lag_s", "lag_se_s", "lag_shift")) | without_row(None, "without_lag"),
    )
    late, whole = with_reflex(person.raw, person.human, person.slow, late=True), analysis.whole
    friction = without_slow(
        person.raw.coarse, friction_columns(person.raw, 160.0), person.human.slow_hz
    )
    few, beside = (
        late.record.coarse,
        late.coarse | {f"friction_{k}": column for k, column in enumerate(friction.T)},
    )
    columns, centre = columns_of(few)
    model = {**effects.IMPEDANCE, **{name: name for name in beside}}
    columns |= beside | {"jerk": seven_point_motion(few.time, few.motion.alpha, few.rate_hz).omega}
    seek = partial(effects.late_fit, few, columns, model, centre, no_estimates=frozenset(beside))
    try:
        (delay, more), (behind, _) = seek(), seek(low_pass=True)
    except effects.CANNOT_TELL:
        return row
    lag, se = delay["lag_s"], float(np.hypot(delay.se("lag_s"), REFLEX_ERROR))
    found = abs(more) < se and effects.is_certain(lag, se, delay.freedom("lag_s"))
    # steps between two levels tell neither from friction
    found &= delay.certain("B", effects.FALSE_ALARM)
    per_s, possible = (
        max(abs(whole["K"] / whole["B"]), abs(whole["B"] / whole["I"])),
        abs(lag) + effects.POSSIBLE * se,
    )
    if not found and possible * per_s > HIDDEN and not person.raw.calibration.delay:
        both = holding([delay, behind], own)
        return row | both | {x.replace("_", "_without_lag_"): end for x, end in both.items()}
    shift = np.max(
        [2 * abs(delay[name] - whole[name]) / np.ptp(whole.interval(name)) for name in "KBI"]
    )
    row |= {"lag_s": lag, "lag_se_s": se, "lag_shift": float(shift) if found else 0.0}
    # else the lag is found, and is an image of the true one
    found &= min(delay["B"], delay["I"]) > 0
    if found and (
        delay.left < DELAYED[0] * behind.left or abs(behind["lag_s"]) < DELAYED[1] * abs(lag)
    ):
        return row | without_row(delay, "without_lag")
    return row | {
        x.replace("_", "_without_lag_"): end for x, end in holding([delay, behind]).items() if found
    }


def misfit_row(fit: PersonFit, own: Row) -> Row:
    """What explains a torque without a lag, beside the reflex: friction (play is friction that
    drives), and a spring that is not linear, as a dead zone is. Leave-one-out prediction must gain
    by its columns: far more than by chance, of friction also more than by a reflex of another
    shape. The row has the harm of what gains most, of friction also K, B and I beside it. If the
    gain is only more than by chance, the intervals of the trial's `own` row hold these."""
    person, whole, few, row = fit[0], fit[1].whole, fit[0].record.coarse, no_witness()
    heard = list[tuple[float, str, gram.GroupFit]]()
    if own["lag_shift"]:
        return row
    theta, alone = person.raw.coarse.motion.theta, person.muscles[0][1]
    away = theta - theta.mean()
    tried = {
        "friction": effects.shapes_of_friction(person.raw),
        "size": {"square": away * abs(away), "cube": away**3},
    }
    for family, shapes in tried.items():
        quick = without_slow(
            person.raw.coarse, np.transpose([*shapes.values()]), person.human.slow_hz
        )
        beside = person.coarse | dict(zip(shapes, quick.T, strict=True))
        left = predicted(sums := sums_beside(few, beside))
        gained = 1 - left / alone  # shares, which are alike where the joint moves little and far
        t = float(gained.mean() / max(gained.std(ddof=1), 1e-300)) * len(gained) ** 0.5
        chance = scipy.special.stdtr(len(gained) - 1, -t)
        if chance > RUBS[2]:
            continue
        found = gram.fit_groups(
            sums, {**IMPEDANCE, **{name: name for name in beside}}, limit=np.inf
        )
        if chance > RUBS[1] or (family == "friction" and left.sum() > (1 - RUBS[0]) * alone.sum()):
            row |= holding([found], own)
        else:
            heard.append((float(left.sum()), family, found))
    if not heard:
        return row
    _, family, found = min(heard, key=itemgetter(0))
    moved, of_whole = (np.array([one[name] for name in "KBI"]) for one in (found, whole))
    harm = float(harm_of(moved - of_whole, of_whole).max())
    if family == "size":
        return row | {"size_shift": harm, "rivals": "stiffness that changes with the angle"}
    family, name = ("friction", "friction") if found["slides"] > 0 else ("speed", "play")
    return row | {f"{family}_shift": harm, "rivals": name, **without_row(found, "without")}


def reflex_gains(person: Reflexive, whole: gram.GroupFit) -> Row:
    """Torque per speed [N*m*s/rad] of the reflex after a lasting speed in either direction."""
    row, (muscle, _) = Row(), person.muscles[0]
    broad = cosines(person.raw.rate_hz, person.human.memory_s, muscle.cosines)
    gains = [1.0, *np.zeros(3 - muscle.known), *broad.sum(axis=0)]  # of each kind of column
    for k, way in enumerate(("up", "down")):
        weights = {f"reflex_{k + 2 * n}": float(gain) for n, gain in enumerate(gains)}
        row |= weighted_sum(whole, f"reflex_gain_{way}", weights)
    return row


def weighted_sum(whole: gram.GroupFit, name: str, weights: Mapping[str, float]) -> Row:
    """A weighted sum of estimates: its value, standard error and 95 % interval."""
    turn = np.array([weights.get(one, 0.0) for one in whole.names])
    best, se = float(turn @ whole.estimates), float(np.sqrt(turn @ whole.covariance @ turn))
    half = float(scipy.special.stdtrit(min(map(whole.freedom, weights)), 0.975)) * se
    return {name: best, f"{name}_se": se, f"{name}_low": best - half, f"{name}_high": best + half}


def reflex_row(fit: PersonFit) -> Row:
    """The evidence on the reflex in the model."""
    person, whole = fit[0], fit[1].whole
    raw, record, human = person.raw, person.record, person.human
    reflex = sum(
        whole[name] * record.part(person.beside[name])
        for name in person.beside
        if name[:6] == "reflex"
    )
    delay = 1e3 * person.muscles[0][0].values[0]
    K_sooner, least = None, min(human.delays_ms) - SOONER_MS
    if delay < least + SOONER_MS + 1e-6 and least > 0:
        other = with_reflex(raw, human.model_copy(update={"delays_ms": (least,)}), person.slow)
        K_sooner = (
            other.fit["K"] if other.muscles[0][1].sum() < person.muscles[0][1].sum() else None
        )
    return {
        **reflex_gains(person, whole),
        "reflex_share": 100 * float(np.var(reflex) / np.var(record.part(record.filtered_torque))),
        **delay_by_muscle(person),
        "K_sooner": K_sooner,
    }


def human_joint_table(fit: PersonFit) -> pl.DataFrame:
    """The trial's row of `human_joint.csv`. Voluntary torque is in the interval, and no doubt. A
    joint without a reflex may be a device, so that the witness examines it. Raises InputError: K
    and its interval are negative."""
    (person, analysis), whole = fit, fit[1].whole
    check_resists(person.raw.name, "K", whole["K"], whole.interval("K")[1])
    row = analysis.row(None, *QUANTITIES)
    for name in ("amplitude_deg", "commanded_deg", *(f"{name}_repeat_se" for name in QUANTITIES)):
        del row[name]  # of sines and repeats
    reflex: dict[str, Any] = reflex_row(fit)
    row |= lag_of_person_row(fit, row) | reflex
    row |= (
        witness_row(person.raw, answers=False)
        if reflex["reflex_share"] <= LEAST_REFLEX
        else misfit_row(fit, row)
    )
    low, high, at = np.array(
        [[row[f"{name}{end}"] for name in "KBI"] for end in ("_low", "_high", "")], dtype=float
    )
    row |= {
        "untold_share": float(np.max((high - low) / 2 / abs(at))),
        "VAF_held_out": held_out_vaf(analysis.sums, analysis.model, interleaved=True),
        **analysis.time_base_row(None, QUANTITIES),
        "band_low_hz": person.raw.band_hz[0],
        "band_high_hz": person.raw.band_hz[1],
        "cutoff_hz": float(person.raw.low_pass.cutoff_hz),
        "theta_rms_deg": turn_deg(analysis.sums),
        "fitted_s": person.raw.seconds,
        "angle_noise_share": angle_noise_share(person.record, analysis.sums, whole),
        **{f"{name}_bound": whole.interval(name)[1] for name in "BI"},
        "torque_at_peaks": torque_at_peaks(analysis, person.raw),
    }
    table = pl.DataFrame(
        [row],
        infer_schema_length=None,
        schema_overrides=dict.fromkeys(("heard", "rivals"), pl.String),
    )
    return table.with_columns(pl.col(pl.Null).cast(pl.Float64))


OVER: dict[str, type[pl.DataType]] = {
    "trial": pl.String,
    "over": pl.String,
    "share": pl.Float64,
    "at": pl.Float64,
}
OVER |= {f"{name}{end}": pl.Float64 for name in "KB" for end in ("", "_se", "_low", "_high")}


def over_table(fit: PersonFit) -> pl.DataFrame:
    """The trial's rows of `impedance_over.csv`: K and B at evenly spaced values of the signal with
    which they change, from its 5 % to its 95 % quantile; none if no signal is stated."""
    person, whole, rows = fit[0], fit[1].whole, list[Row]()
    record, over = person.record, person.human.over
    if person.slow is None:
        return pl.DataFrame(schema=OVER)
    fitted = record.part(person.slow)
    low, high = np.quantile(fitted, [0.05, 0.95]).tolist()
    at = np.linspace(low, high, 19)
    shares = np.searchsorted(np.sort(fitted), at) / len(fitted)
    weights = over_basis(fitted, at) - over_basis(fitted, fitted).mean(axis=0)
    shown = (
        np.rad2deg(at)
        if over in ("angle", "theta_slow")
        else at - record.time[0]
        if over == "time"
        else at
    )
    for share, value, weight in zip(shares, shown, weights, strict=True):
        row: Row = {"trial": record.name, "over": over, "share": float(share), "at": float(value)}
        for name in "KB":
            parts = {f"{name}_over_{k}": float(part) for k, part in enumerate(weight[1:], 1)}
            row |= weighted_sum(whole, name, {name: 1.0, **parts})
        rows.append(row)
    return pl.DataFrame(rows, schema=OVER)
