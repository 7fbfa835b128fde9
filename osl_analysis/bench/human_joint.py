"""A person's joint: Eq. 15 beside the columns of a reflex, its row of `human_joint.csv`, and K and B over a signal; and
whether the torque of a device has a reflex.

The reflex is the parallel pathway of Kearney, Stein and Parameswaran (IEEE Trans. Biomed. Eng. 44, 1997): half-wave
rectified velocity, some 40 ms late, through an impulse response of half a second; here of both directions. What is slow
is his own will."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

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
from osl_analysis.bench.record import Record, logged, record_of_trial, stretches_of
from osl_analysis.bench.settings import HumanJoint, HumanJointAnalysis
from osl_analysis.bench.witness import ALIKE, HIDDEN, wald
from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass, Motion, sampling_rate, seven_point_motion
from osl_analysis.signals.grid import uniform_signals
from osl_analysis.spectral.stepped_sine import Likeness
from osl_analysis.stats.regression import Row, products_between
from osl_analysis.trial import Array, Trial

COSINES = 8  # in which an impulse response is described; each next one is broader
EARLY_S = 0.04  # lag [s] from which on there are equally many for each doubling of it
BLOCKS, SHORTEST_BLOCK_S = 30, 2.0  # stretches whose scores make the intervals: number, and least duration [s]
TESTED_BLOCKS, SHORTEST_TESTED_S, FEWEST_TESTED = 48, 1.0, 20  # the same of the test for a reflex
SOONER_MS = 10.0  # by which a reflex sooner than all that are tried is asked for
CORNERS, DAMPINGS = np.geomspace(8, 100, 15).tolist(), (0.6, 0.8, 1.0, 1.4, 2.5)  # [rad/s] of muscle; 2.5: first order
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
    """K [N*m/rad] by delay [s] of the impulse response, that of the columns first."""
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
    answers = [scipy.signal.fftconvolve(one[:, None], responses, axes=0)[: len(one)] for one in signals.T]
    return np.concatenate(answers, axis=1)


def half_waves(record: Record, memory_s: float) -> Array:
    """The velocity of a record, half-wave rectified in each direction, through the memory [s]: (n, 16) [rad]."""
    return through_memory(rectified(record), record.rate_hz, memory_s)


def turned(raw: Record, columns: Array, slow: Array | None) -> Array:
    """Columns (n, k) of a reflex, and those of a gain that changes with a slow signal in a straight line."""
    if slow is None:
        return columns
    away = slow - raw.part(slow).mean()
    return np.hstack([columns, columns * (away / np.abs(away).max())[:, None]])


def rectified(record: Record) -> Array:
    """The velocity of a record where it is positive and where it is negative, else 0, (n, 2) [rad/s]."""
    return np.column_stack([np.maximum(record.motion.omega, 0), np.minimum(record.motion.omega, 0)])


def late_by(columns: Array, rate_hz: float, delay_s: float) -> Array:
    """Columns (n, k) late by a delay, with rest before them."""
    return np.pad(columns, ((round(delay_s * rate_hz), 0), (0, 0)))[: len(columns)]


def long_pieces(record: Record, slow_hz: float) -> list[slice]:
    """The pieces of a record between its ends and gaps that a filter of some cut-off [Hz] takes; the longest anyway."""
    lengths = [piece.stop - piece.start for piece in record.pieces]
    least = min(3 * record.rate_hz / slow_hz + 1, max(lengths))
    return [piece for piece, length in zip(record.pieces, lengths, strict=True) if length >= least]


def without_slow(record: Record, signals: Array, slow_hz: float) -> Array:
    """Signals (n, ...) of a record without what is slower than some frequency [Hz], by a zero-phase filter in each of
    its pieces: beside them derivatives are wrong, and would be so for a second within."""
    quick = np.zeros_like(signals)
    for piece in long_pieces(record, slow_hz):
        quick[piece] = signals[piece] - LowPass(slow_hz, 2)(signals[piece], record.rate_hz)
    return quick


def without_will(record: Record, slow_hz: float, memory_s: float = 0.0) -> Record:
    """The record without the slow part of angle and torque, about their means, in stretches of a thirtieth, and without
    the rows of each piece whose past of `memory_s` was not recorded."""
    signals = record.motion.theta, record.motion.omega, record.motion.alpha, record.filtered_torque
    theta, omega, alpha, torque = (without_slow(record, one, slow_hz) for one in signals)
    angle, level = (float(record.part(signals[k]).mean()) for k in (0, 3))
    past = round(memory_s * record.rate_hz)
    longer = [one for one in long_pieces(record, slow_hz) if one.stop - one.start > past]
    pieces = [slice(one.start + past, one.stop) for one in longer]
    groups = stretches_of(pieces, record.rate_hz, max(record.seconds / BLOCKS, SHORTEST_BLOCK_S))
    motion = Motion(theta + angle, omega, alpha)
    return replace(record, motion=motion, filtered_torque=torque + level, groups=groups, periodic=None)


def with_reflex(raw: Record, human: HumanJoint, slow: Array | None = None) -> Reflexive:
    """The record of a person's joint, whose K and B may change with a `slow` signal (n,). The delay of the reflex is
    the one of those in the settings with which the other stretches predict each stretch best."""
    rate, record = raw.rate_hz, without_will(raw, human.slow_hz, human.memory_s)
    columns = turned(raw, half_waves(raw, human.memory_s), slow)
    changing = {} if slow is None else changing_columns(raw, human, slow, record.part(slow))
    few, quick = record.coarse, without_slow(raw, columns, human.slow_hz)
    step = round(rate / few.rate_hz)
    thinned = {name: column[::step] for name, column in changing.items()}
    sooner = [min(human.delays_ms) - SOONER_MS] if min(human.delays_ms) > SOONER_MS else []
    late = {ms: late_by(quick[::step], few.rate_hz, 1e-3 * ms) for ms in (*human.delays_ms, *sooner)}
    tried = {ms: predicted(few, thinned, [one]) for ms, one in late.items()}
    first, *_ = order = sorted(tried, key=lambda ms: float(tried[ms][0].sum()))
    K_sooner = float(tried[first][1][0]) if first in sooner else None
    delays = {1e-3 * ms: float(tried[ms][1][0]) for ms in order if ms not in sooner}
    quick = without_slow(raw, late_by(columns, rate, next(iter(delays))), human.slow_hz)
    return Reflexive(raw, human, record, changing | reflex_columns(quick), delays, K_sooner, slow)


def predicted(record: Record, beside: Mapping[str, Array], tried: Sequence[Array]) -> tuple[Array, Array]:
    """What the fit to the other stretches leaves of each, (k, m), with columns beside Eq. 15 and of k sets (n, c) one
    after another, and K (k,) by all."""
    every = reflex_columns(np.hstack(tried))
    s = sums_beside(record, {**beside, **every})
    base, own = s.index([name for name in s.names if name not in every]), s.index([*every])
    at = np.array([[*base, *one, s.torque] for one in np.split(np.array(own), len(tried))])
    of_each = s.gram[:, at[:, :, None], at[:, None, :]]
    total = of_each.sum(axis=0)
    rest = total - of_each
    estimates = gram.solved(rest[..., :-1, :-1], rest[..., :-1, -1])[0]
    error = np.concatenate([estimates, -np.ones((*estimates.shape[:2], 1))], axis=2)
    K = gram.solved(total[:, :-1, :-1], total[:, :-1, -1])[0][:, base.index(s.names.index("theta"))]
    return np.einsum("mkp,mkpq,mkq->km", error, of_each, error), K


def delay_by_muscle(person: Reflexive) -> tuple[float, float, float]:
    """The delay [ms] by which muscle of second order, of any corner and damping, predicts best, and from where to where
    muscle of second or third order predicts as well as the best of its order, within chance, by the scatter of what is
    left in stretches, and half way to the next delays tried. An impulse response of any shape takes up some delay."""
    raw, human, few = person.raw, person.human, person.record.coarse
    step, delays, best, good = round(raw.rate_hz / few.rate_hz), sorted(person.delays), 0, set[int]()
    changing = {name: one[::step] for name, one in person.beside.items() if not name.startswith("reflex")}
    for order in (3, 2):
        left = list[Array]()
        for corner, damping in product(CORNERS, DAMPINGS):
            lag = np.polymul([corner**-2, 2 * damping / corner, 1.0], [1 / corner, 1.0][3 - order :])
            muscle = scipy.signal.bilinear([1.0], lag, raw.rate_hz)
            answer = turned(raw, scipy.signal.lfilter(*muscle, rectified(raw), axis=0), person.slow)
            quick = without_slow(few, answer[::step], human.slow_hz)
            left += [*predicted(few, changing, [late_by(quick, few.rate_hz, delay) for delay in delays])[0]]
        best = int(np.argmin(np.sum(left, axis=1)))
        more = np.array(left) - left[best]
        blocks = more.shape[1]
        chance = scipy.special.stdtrit(blocks - 1, 0.975) * np.sqrt(blocks) * more.std(axis=1, ddof=1)
        good.update((np.flatnonzero(more.sum(axis=1) <= chance) % len(delays)).tolist())
    ends = np.concatenate([delays[:1], np.convolve(delays, (0.5, 0.5), "valid"), delays[-1:]])
    return 1e3 * delays[best % len(delays)], 1e3 * float(ends[min(good)]), 1e3 * float(ends[max(good) + 1])


def changing_columns(raw: Record, human: HumanJoint, slow: Array, fitted: Array) -> dict[str, Array]:
    """Columns (n,) by which K, B and the torque at rest change with a slow signal (n,), fitted in rows (m,)."""
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


def unstated_reflex_row(record: Record, is_device: bool) -> Row:
    """Whether the torque of a joint has a reflex, and K, B and I with one in the model; null where it is a device."""
    p = None if is_device else reflex_test(record, HumanJoint(), USUAL_DELAY_S)
    fit = with_reflex(record, HumanJoint()).fit_with() if p is not None and p < 1e-2 else None
    return {"reflex_p": p, **without_row(fit, "with_reflex")}


def reflex_test(raw: Record, human: HumanJoint, delay_s: float, person: Reflexive | None = None) -> float | None:
    """Probability of what the speed, late by a delay or more, explains of the torque, if it were chance (Wald's test by
    the scores of stretches); None where a record, or the period after which its motion repeats itself, is too short.

    The speed is the even part of a half-wave: no linear dynamics makes it. Springs and stops that differ between the
    directions do, and friction of a joint that creeps after stretches, but at once: their columns compete, and what
    they leave goes along with the speed to come as much as with the past one. It is 1 where that explains little more,
    or than rounding does, which steps between two levels repeat. Of a `person` what is fitted competes, too."""
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
    own, made = range(len(base), len(base) + COSINES), [] if raw.rounded is None else [*raw.rounded]
    made = [without_slow(few, torque, human.slow_hz) for torque in made]
    Z = np.column_stack([*base, np.empty((len(theta), COSINES)), *made, quick.filtered_torque])
    speed, sums, explained = np.abs(omega)[:, None], np.empty(0), list[Array]()
    torques = range(own.stop, Z.shape[1])
    del even, at_once, base, made
    for way in (-1, 1):  # the speed to come, then the past one
        late = late_by(through_memory(speed[::way], few.rate_hz, human.memory_s), few.rate_hz, delay_s)[::way]
        Z[:, own] = without_slow(few, late, human.slow_hz)
        sums = products_between(Z, Z, groups.first, groups.stop)
        each = [[np.r_[:end, k] for k in torques] for end in (own.start, own.stop)]
        left = [[float(gram.least_left(sums.sum(axis=0)[np.ix_(x, x)])) for x in some] for some in each]
        explained.append(np.array(left[0]) - left[1])
    *rounding, past = explained[1]
    if past < max(BEFORE_OVER_AFTER * explained[0][-1], ALIKE**2 * max(rounding, default=0.0)):
        return 1.0
    return float(10 ** wald(sums, range(own.start), own, 0)[0])


ABOVE_HZ = 10.0  # frequencies by which a late torque is told from a reflex, which is slow
OWN_SHARE = 0.95  # of the power of the angle's speed, which lies below the cut-off where none is stated
REFLEX_ERROR = 60e-6  # s by which a reflex that is not made of the columns shifts a lag (SD)


@dataclass(frozen=True)
class PersonFit:
    """Eq. 15 with a reflex, fitted to a trial."""

    person: Reflexive
    analysis: Analysis


def own_cutoff_hz(trial: Trial, settings: HumanJointAnalysis) -> float:
    """The frequency [Hz] below which 95 % of the power of a trial's speed lies, before any filter and without the floor
    of noise; up to an eighth of the sampling rate, and `cutoff_hz` at least. Raises as `uniform_signals`."""
    signals = uniform_signals(trial, ("theta",), settings.gap_limits)
    rate = sampling_rate(signals.time)
    f, power = scipy.signal.welch(signals["theta"], rate, nperseg=min(round(4 * rate), len(signals.time)))
    floor = np.median(power[f > rate / 4])
    speed = np.cumsum(np.where(power > 10 * floor, power - floor, 0.0) * f**2)
    own = f[np.searchsorted(speed, OWN_SHARE * speed[-1])]
    return max(settings.cutoff_hz, round(float(min(own, rate / 8)), 3))


def fit_person(trial: Trial, settings: HumanJointAnalysis, windows: str | None = None) -> PersonFit:
    """The fit of a person's joint. Raises as `record_of_trial` and `fitted_motion`; InputError: a stepped sine."""
    if settings.own_cutoff:
        settings = settings.model_copy(update={"cutoff_hz": own_cutoff_hz(trial, settings)})
    raw, human = record_of_trial(trial, settings, windows, excitation="any"), settings.human or HumanJoint()
    assert raw.uniform is not None
    if Likeness(raw.time, raw.uniform["theta"], settings.protocol).kind == "stepped sine":
        raise InputError(
            f"trial {trial.name}: theta is a stepped sine, in which a reflex is hardly told from K, B and I; move a "
            "person's joint at random, as in binary steps, or leave out `human` under `dynamometer`"
        )
    slow = {"angle": LowPass(human.slow_hz, 2)(raw.motion.theta, raw.rate_hz), "time": raw.time, None: None}
    signal = slow.get(human.over)
    if human.over not in slow:
        signal = logged(raw, trial, {"over": (str(human.over), raw.low_pass)})["over"]
    person = with_reflex(raw, human, signal)
    again = lambda one, model: with_reflex(one, human, signal).sums  # noqa: E731 - its model is the same
    return PersonFit(
        person,
        fitted_motion(replace(person.record, other=raw.other, softer=raw.softer), person.sums, person.model, again),
    )


def lag_of_person(person: Reflexive) -> effects.Fault | None:
    """By how much the torque of a person's joint lags the angle [s], by what is quick, beside reflex and friction; None
    where the motion does not tell. `record` has the columns of the reflex."""
    record = person.record
    quick = without_will(record, ABOVE_HZ).coarse
    step = round(record.rate_hz / quick.rate_hz)
    beside = {name: column[::step] for name, column in person.beside.items()}
    beside |= {f"friction_{k}": column for k, column in enumerate(friction_columns(record, 160.0).T)}
    beside = {name: without_slow(quick, column, ABOVE_HZ) for name, column in beside.items()}
    columns, centre = columns_of(quick)
    columns |= beside
    model = {**effects.IMPEDANCE, **{name: name for name in beside}}
    columns["jerk"] = seven_point_motion(quick.time, quick.motion.alpha, quick.rate_hz).omega
    try:
        fit, more = effects.late_fit(quick, columns, model, centre, no_estimates=frozenset(beside))
    except effects.CANNOT_TELL:
        return None
    lag = fit["lag_s"]
    se = float(np.hypot(fit.se("lag_s"), REFLEX_ERROR))
    sure = abs(more) < se and effects.is_certain(lag, se, fit.freedom("lag_s"))
    return effects.Fault(lag, se, sure, abs(lag) + effects.POSSIBLE * se)


def lag_of_person_row(fit: PersonFit) -> Row:
    """The lag of the torque, and K, B and I without it, or without 1 ms of lag where one might matter."""
    person, whole, lag = fit.person, fit.analysis.whole, lag_of_person(fit.person)
    raw, taken = person.raw, lag.size if lag and lag.found else 1e-3
    earlier = np.interp(raw.time + taken, raw.time, raw.filtered_torque)
    made = with_reflex(replace(raw, filtered_torque=earlier), person.human, person.slow)
    without = effects.with_effects(made.sums, made.model)
    moved = {name: abs(without[name] - whole[name]) for name in "KBI"}
    without_lag = without_row(without, "without_lag")
    row: Row = dict.fromkeys(("lag_s", "lag_se_s", "lag_by", "lag_shift"))
    share = max(by / abs(whole[name]) for name, by in moved.items())
    if lag is None or (not lag.found and lag.possible / taken * share > HIDDEN):
        return row | without_lag
    shift = max(by / (whole.interval(name)[1] - whole[name]) for name, by in moved.items()) if lag.found else 0.0
    row |= {"lag_s": lag.size, "lag_se_s": lag.se, "lag_shift": shift, "lag_by": "Eq. 15 with a reflex"}
    return row | (without_lag if lag.found else dict.fromkeys(without_lag))


def reflex_gains(whole: gram.GroupFit, rate_hz: float, memory_s: float) -> Row:
    """Torque per speed [N*m*s/rad] that a lasting speed of either direction would end in by the reflex."""
    row: Row = {}
    step = np.ones((round(memory_s * rate_hz) + 1, 1))
    gains = through_memory(step, rate_hz, memory_s)[-1]  # of each column [s], (8,), if the half-wave stays 1
    for k, way in enumerate(("up", "down")):
        weights = {f"reflex_{k * len(gains) + n}": gain for n, gain in enumerate(gains)}
        row |= weighted_sum(whole, f"reflex_gain_{way}", weights)
    return row


def weighted_sum(whole: gram.GroupFit, name: str, weights: Mapping[str, float]) -> Row:
    """A sum of estimates with weights, by column: itself, its standard error, and the ends of its interval of 95 %."""
    turn = np.array([weights.get(one, 0.0) for one in whole.names])
    best, se = float(turn @ whole.estimates), float(np.sqrt(turn @ whole.covariance @ turn))
    half = float(scipy.special.stdtrit(min(map(whole.freedom, weights)), 0.975)) * se
    return {name: best, f"{name}_se": se, f"{name}_low": best - half, f"{name}_high": best + half}


def reflex_row(fit: PersonFit) -> Row:
    """What the torque has of the reflex in the model, and whether it has another one. `K_with_reflex` is K with a later
    one in the model, which must be beyond the interval of K, and so must K with a gain that changes with the angle, for
    which the fitted reflex times the angle is asked (t)."""
    person, whole = fit.person, fit.analysis.whole
    raw, record, human = person.raw, person.record, person.human
    columns = {name: column for name, column in person.beside.items() if name.startswith("reflex")}
    reflex = sum(whole[name] * record.part(column) for name, column in columns.items())
    delay, K = next(iter(person.delays.items()))
    (by_muscle, soonest, latest), (low, high) = delay_by_muscle(person), whole.interval("K")
    others = [of for at, of in person.delays.items() if soonest <= 1e3 * at <= latest]
    row: Row = {
        **reflex_gains(whole, raw.rate_hz, human.memory_s),
        "reflex_share": 100 * float(np.var(reflex) / np.var(record.part(record.filtered_torque))),
        "reflex_delay_ms": by_muscle,
        "reflex_delay_low_ms": soonest,
        "reflex_delay_high_ms": latest,
        "K_over_delays": max((abs(other - K) for other in others), default=0.0),
        "K_sooner": person.K_sooner,
        "untold_share": max((whole.interval(name)[1] - whole[name]) / abs(whole[name]) for name in "KBI"),
    }
    late = late_by(half_waves(raw, human.memory_s), raw.rate_hz, delay)
    angle = raw.motion.theta - raw.part(raw.motion.theta).mean()
    moved = without_slow(raw, late * angle[:, None], human.slow_hz)
    gain = person.fit_with(moved @ [whole[f"reflex_{k}"] for k in range(len(moved.T))])
    chance = 2 * float(scipy.special.stdtr(gain.freedom("gain_0"), -abs(gain["gain_0"]) / gain.se("gain_0")))
    with_gain = person.fit_with(*moved.T) if chance < 1e-2 else None
    if with_gain is not None and low < with_gain["K"] < high:
        chance, with_gain = 1.0, None
    # the reflex that the model has ends with its memory
    p, with_later = reflex_test(raw, human, USUAL_DELAY_S + human.memory_s, person), None
    if p is not None and p < 1e-2:
        longer = human.model_copy(update={"memory_s": 2 * human.memory_s})
        with_later = with_reflex(raw, longer, person.slow).fit_with()
        p, with_later = (1.0, None) if low < with_later["K"] < high else (p, with_later)
    row |= {"reflex_gain_p": chance, **without_row(with_gain, "with_gain")}
    return row | {"reflex_p": p, **without_row(with_later, "with_reflex")}


def human_joint_table(fit: PersonFit) -> pl.DataFrame:
    """The trial's row of `human_joint.csv`. What a person pushes as he likes is in the interval, and no doubt. Raises
    InputError: K is negative, its interval too."""
    person, analysis, whole = fit.person, fit.analysis, fit.analysis.whole
    check_resists(person.raw.name, "K", whole["K"], whole.interval("K")[1])
    row = analysis.row(None, *QUANTITIES)
    for name in ("amplitude_deg", "commanded_deg", *(f"{name}_repeat_se" for name in QUANTITIES)):
        del row[name]  # of sines and repeats
    row |= (
        lag_of_person_row(fit)
        | reflex_row(fit)
        | {
            "VAF_held_out": held_out_vaf(analysis.sums, analysis.model, interleaved=True),
            **analysis.time_base_row(None, QUANTITIES),
            "band_low_hz": person.raw.band_hz[0],
            "band_high_hz": person.raw.band_hz[1],
            "cutoff_hz": float(person.raw.low_pass.cutoff_hz),
            "theta_rms_deg": turn_deg(analysis.sums),
            "fitted_s": person.raw.seconds,
            "angle_noise_share": angle_noise_share(person.record, analysis.sums, whole),
            "I_bound": whole.interval("I")[1],
            "torque_at_peaks": torque_at_peaks(analysis, person.raw),
        }
    )
    texts = {"lag_by": pl.String}
    table = pl.DataFrame([row], infer_schema_length=None, schema_overrides=texts)
    return table.with_columns(pl.col(pl.Null).cast(pl.Float64))


OVER: dict[str, type[pl.DataType]] = {"trial": pl.String, "over": pl.String, "share": pl.Float64, "at": pl.Float64}
OVER |= {f"{name}{end}": pl.Float64 for name in "KB" for end in ("", "_se", "_low", "_high")}


def over_table(fit: PersonFit) -> pl.DataFrame:
    """The trial's rows of `impedance_over.csv`: K and B at even values of the signal that they change with, from that
    which 5 % of the rows are below to that of 95 %; none where nothing is asked for."""
    person, whole, rows = fit.person, fit.analysis.whole, list[Row]()
    record, over = person.record, person.human.over
    if person.slow is None:
        return pl.DataFrame(schema=OVER)
    fitted = record.part(person.slow)
    low, high = np.quantile(fitted, [0.05, 0.95]).tolist()
    at = np.linspace(low, high, 19)
    shares = np.searchsorted(np.sort(fitted), at) / len(fitted)
    weights = over_basis(fitted, at) - over_basis(fitted, fitted).mean(axis=0)
    shown = np.rad2deg(at) if over in ("angle", "theta_slow") else at - record.time[0] if over == "time" else at
    for share, value, weight in zip(shares, shown, weights, strict=True):
        row: Row = {"trial": record.name, "over": over, "share": float(share), "at": float(value)}
        for name in "KB":
            parts = {f"{name}_over_{k}": float(part) for k, part in enumerate(weight[1:], 1)}
            row |= weighted_sum(whole, name, {name: 1.0, **parts})
        rows.append(row)
    return pl.DataFrame(rows, schema=OVER)
