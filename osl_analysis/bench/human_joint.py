"""A person's joint: Eq. 15 beside the columns of a reflex, its row of `human_joint.csv`, and K and B over a signal."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
import scipy

from osl_analysis.bench import effects, gram
from osl_analysis.bench.analysis import Analysis, fitted_motion, turn_deg, without_row
from osl_analysis.bench.effects import columns_of
from osl_analysis.bench.gram import held_out_vaf
from osl_analysis.bench.impedance import (
    QUANTITIES,
    alias_share,
    angle_noise_bias,
    share_of_inertia,
    torque_at_peaks,
)
from osl_analysis.bench.plausible import check_resists
from osl_analysis.bench.record import logged, record_of_trial
from osl_analysis.bench.reflex import (
    USUAL_DELAY_S,
    Reflexive,
    friction_columns,
    half_waves,
    late_by,
    over_basis,
    reflex_test,
    static_gains,
    with_reflex,
    without_slow,
    without_will,
)
from osl_analysis.bench.settings import HumanJoint, HumanJointAnalysis
from osl_analysis.bench.witness import HIDDEN
from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass, sampling_rate, seven_point_motion
from osl_analysis.signals.grid import uniform_signals
from osl_analysis.spectral.stepped_sine import Likeness
from osl_analysis.stats.regression import Row
from osl_analysis.trial import Array, Trial

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
    """The fit of a person's joint, moved at random. Raises as `record_of_trial` and `fitted_motion`; InputError: the
    motion is a stepped sine."""
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
    signal = slow[human.over] if human.over in slow else logged(raw, trial, str(human.over))
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
    """The lag of the torque, and K, B and I without it, or without 1 ms of lag where one might change K, B or I by more
    than a tenth."""
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


def reflex_gains(whole: gram.GroupFit, gains: Array) -> Row:
    """Torque per speed [N*m*s/rad] that a lasting speed of either direction would end in by the reflex."""
    row: Row = {}
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
    tried, (K, *others), (low, high) = list(person.delays), person.delays.values(), whole.interval("K")
    row: Row = {
        **reflex_gains(whole, static_gains(raw, human.memory_s)),
        "reflex_share": 100 * float(np.var(reflex) / np.var(record.part(record.filtered_torque))),
        "reflex_delay_ms": 1e3 * tried[0],
        "reflex_delay_low_ms": 1e3 * min(tried),
        "reflex_delay_high_ms": 1e3 * max(tried),
        "K_over_delays": max((abs(other - K) for other in others), default=0.0),
        "K_sooner": person.K_sooner,
        "untold_share": max((whole.interval(name)[1] - whole[name]) / abs(whole[name]) for name in "KBI"),
    }
    late = late_by(half_waves(raw, human.memory_s), raw.rate_hz, tried[0])
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
    noise = angle_noise_bias(person.record, analysis.sums, whole)
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
            "angle_noise_share": abs(noise) / share_of_inertia(whole),
            "alias_share": alias_share(person.record, whole),
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
