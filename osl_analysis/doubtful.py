"""Doubtful fits: fits with a value beyond a limit of the configuration, in words with likely cause and remedy."""

import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Self

import polars as pl
from pydantic import ConfigDict, Field, model_validator

from osl_analysis.errors import InputError
from osl_analysis.experiments import judged_tables
from osl_analysis.refusal import is_refused
from osl_analysis.table import read_table
from osl_analysis.yaml_settings import Settings

FACTORS: dict[str, float] = {
    "between peak and RMS current": math.sqrt(2),
    "between lbf*ft and N*m": 1.3558,
    "between lbf and N": 4.4482,
    "between lbf*in and N*m": 8.8507,
    "between kgf*m and N*m": 9.8067,
    "between degrees and radians": 180 / math.pi,
    "between N*cm and N*m": 100.0,
    "between N*mm and N*m, or mA and A": 1000.0,
}
"""Factors between units that are often taken for one another."""
NEAR = 0.08
"""Largest relative distance of a ratio from a factor, or from its inverse, that names the factor as the cause."""


def wrong_scale(ratio: float) -> str:
    """What may make a number `ratio` times too large: the factor between two units, or else where to look."""
    size = max(abs(ratio), 1 / abs(ratio)) if ratio else math.inf
    name = min(FACTORS, key=lambda known: abs(math.log(size / FACTORS[known])) if math.isfinite(size) else math.inf)
    if math.isfinite(size) and abs(size / FACTORS[name] - 1) < NEAR:
        return f"{FACTORS[name]:.3g} is the factor {name}: correct the `unit` or the `scale` in the source file"
    return "check unit and scale of the channels in the source file"


Words = Callable[[float, Mapping[str, object]], str]
"""Words for a number beyond its limit, by the number and the row of the table in which it stands."""


def too_far(symbol: str, reference: str) -> Words:
    """Words for an estimate of `symbol` that is far from its `reference`, by their ratio."""
    return lambda ratio, _: f"{symbol} is {ratio:.3g} times {reference}, {wrong_scale(ratio)}"


def far_from_gains(ratio: float, row: Mapping[str, object]) -> str:
    """The words for a K that is far from what the gains should give: units, or a frame that yields if K is low."""
    words = too_far("K", "what K_d and the controller should give")(ratio, row)
    frame = ", or state `bench_stiffness` in the configuration if the bench's frame yields"
    return words + (frame if SOFT_FRAME < ratio < 1 else "")


SOFT_FRAME = 0.5  # smallest K, as a share of what the gains should give, that a frame is a likely cause of
FROM_FILE = "that of the parameter file"
SAME_K = 0.03
"""Largest relative distance of K from what the gains should give that counts as agreement, without much friction."""
LATE = (
    "the torque is late, or the angle is where it is negative: state `delay` or `low_pass` of the channel in the "
    "source file, as in `delay: 2 ms` or `low_pass: {cutoff: 100 Hz, order: 1}`"
)
YIELDING = (
    "a spring in series yields, as the bench's frame or a belt, {k:.3g} N*m/rad explain it and the low K: measure its "
    "stiffness and state `bench_stiffness` in the configuration"
)
LATE_OR_YIELDING = (
    "{who} is late, or a spring of {k:.3g} N*m/rad in series yields, as the bench's frame or a belt, which this "
    "recording cannot tell apart: state `delay` or `low_pass` of the channel in the source file, or `bench_stiffness` "
    "in the configuration"
)


def late_or_yielding(_: float, row: Mapping[str, object]) -> str:
    """The words for a torque that comes late: a delay or low-pass, a spring in series, or both where K does not tell.

    A spring of stiffness k in series lowers K by K/k, a delay does not change it. K_ratio says which of the two agrees
    with the gains; without it, or with friction, neither is named alone.
    """
    k, K, ratio = (row.get(name) for name in ("frame_stiffness", "K", "K_ratio"))
    if not isinstance(k, float) or not isinstance(K, float):
        return LATE
    both = LATE_OR_YIELDING.format(k=k, who=late_signal(row))
    if not isinstance(ratio, float):
        return both
    late, yielding = (abs(r - 1) for r in (ratio, ratio / (1 - K / k)))
    if min(late, yielding) > SAME_K or max(late, yielding) < SAME_K:
        return both
    return LATE if late < yielding else YIELDING.format(k=k)


def late_signal(row: Mapping[str, object]) -> str:
    lag, se = row.get("lag_s"), row.get("lag_se_s")
    if isinstance(lag, float) and isinstance(se, float) and se > abs(lag):
        return "the torque or the angle"
    return "the angle" if isinstance(lag, float) and lag < 0 else "the torque"


def late_for_inertia(share: float, row: Mapping[str, object]) -> str:
    """The words for a lag that makes a share of I; certain only where no spring in series explains it as well."""
    lag, of_damping = row.get("lag_s"), row.get("lag_share")
    if not isinstance(lag, float) or not isinstance(of_damping, float):
        return LATE
    words = late_or_yielding(share, row)
    size, makes = f"{1e6 * abs(lag):.0f} us", f"{100 * of_damping:.1f} % of B and {100 * share:.0f} % of I"
    if words == LATE:
        return f"{late_signal(row)} is late by {size}, which make {makes}: {words}"
    return f"as a lag of {size} it makes {makes}: {words}"


def changing(symbol: str, rising: str, falling: str) -> Words:
    """Words for an estimate that changes with the amplitude, by its relative change."""

    def words(change: float, _: Mapping[str, object]) -> str:
        way, cause = ("rises", rising) if change > 0 else ("falls", falling)
        return (
            f"{symbol} {way} by {100 * abs(change):.0f} % from the smallest to the largest amplitude: {cause}, use the "
            "rows of single amplitudes"
        )

    return words


REMEDIES: dict[str, str | Words] = {
    "K_ratio": far_from_gains,
    "K_over_K_s": too_far("K", "the belt's K_s"),
    "k_tau_n_m_ratio": too_far("k_tau n_m", FROM_FILE),
    **{f"{name}_ratio": too_far(name, FROM_FILE) for name in ("K_s", "B_j", "J_j", "J_m", "f_C", "f_G", "B_m")},
    "saturated_samples": "a torque, angle or current is clipped, it stands at an end of its sensor's range, see the "
    "quality check `saturation`: use a sensor of larger range",
    "torque_at_peaks": "the torque stands still where Eq. 15 has its peaks, it is clipped, by the range of its sensor "
    "or amplifier or by a limit of the motor, or the spring softens: use a larger range, or a smaller motion",
    "lag_share": late_or_yielding,
    "certain_lag_damping": late_or_yielding,
    "lag_inertia_share": late_for_inertia,
    "angle_noise_share": "noise of the encoder changes I by this share, move the joint further or faster",
    "K_change": changing("K", "a spring that stiffens, or backlash", "friction, or a spring that softens"),
    "B_change": changing("B", "damping that grows with the velocity", "friction"),
    "K_drift": "K changes by this share while the trial is recorded, as by warming up or creep, and I takes what "
    "differs from one frequency to the next for its own, record the joint warm and in a shorter time",
    "drift_inertia_share": "K changes while the trial is recorded, as by warming up or creep, and makes this share of "
    "I, record the joint warm and in a shorter time, or by several sweeps",
    "coulomb_share": "this share of B is Coulomb friction and not damping",
    "stiffening": "the spring stiffens by this share up to the largest amplitude, or softens if it is negative",
    "backlash_share": "this share of K is lost to backlash, the play between joint and bench",
    "closure_angle": "a cycle does not end where it began, record the way back",
    "closure_torque": "the torque does not come back with the angle, the load cell drifts, the device creeps, or "
    "it begins another way than it goes on, record several cycles",
    "rest_change": "at rest the torque at the end is not that at the start, hysteresis leaves a torque in the device "
    "that is taken for zero, or the load cell drifts, write zero: start if the device was without load there",
    "cycle_drift": "the torque drifts from cycle to cycle, let the device settle and zero the load cell",
    "bridged_share": "the recording has gaps, and what the device did there is not known",
    "rate_change": "the energy lost depends on the speed, so that the trial is not quasi-static, record it slower",
    "returned_share": "the device gives back more than it takes up, the torque is late or its sign is wrong",
    "coherence": "perturbations cancel each other, look at their directions and onsets",
    "outside_interval": "an estimate lies outside its own interval, look at the single responses for one unlike the "
    "others",
    "heterogeneity": "perturbations show several stiffnesses, state K_d or group in the sheet to part them",
    "onset_phase_sd": "perturbations begin at several phases of stance, name timing under walking.group_by",
    "stance_change": "its duration is not the one that its gait before the onset leads to expect: the perturbation "
    "changes the stance, or its pace is misread, compare K with the other perturbations",
    "uncorrected_stance_change": "perturbed crossings have not the stance that phase is computed with, set "
    "walking.perturbed_stance: matched",
    "unperturbed_stance_sd": "unperturbed crossings walk at several paces, state subject, session or speed in the "
    "sheet to part them",
    "residual_over_gait": "neither a second-order joint nor ordinary gait explains the torque, look for clipped "
    "channels and a second foot",
    "estimator_difference": "the fit to the mean response and the mean of the single fits disagree, look at the single "
    "responses",
    "K_se_share": "record more crossings, or larger perturbations",
}
"""By column of a result table: what a number beyond its limit means, and what to do; as words, or as a function of the
number and its row. No text contains a semicolon, which separates the reasons."""


def remedy(column: str, value: float, row: Mapping[str, object]) -> str:
    """What a number of a row beyond its limit means, in brackets after a blank; empty where the column says it all."""
    words = REMEDIES.get(column, "")
    text = words if isinstance(words, str) else words(value, row)
    return f" ({text})" if text else ""


DOUBTFUL = "doubtful"  # column with the reasons: empty text if the fit is not doubtful, null in a row without a fit
IS_DOUBTFUL = pl.col(DOUBTFUL).fill_null("") != ""
FEWEST_SOUND = 0.5
"""Share of sound trials from which on a mean over trials leaves out the doubtful ones. With fewer, all trials count:
the doubt is then about the campaign, and the rest would be a selection."""
EXCLUDED = "excluded"
"""Column with the reason why a row has no fit, in tables that have such rows; null in rows with a fit."""


class Doubt(Settings):
    """Limits of one table, by column. Null: no limit."""

    above: dict[str, float | None] = Field(default_factory=dict)
    """Upper limits, by column. A fit is doubtful if the absolute value is above its limit."""
    below: dict[str, float | None] = Field(default_factory=dict)
    """Lower limits, by column. A fit is doubtful if the value is below its limit."""


class DoubtfulFits(Settings):
    """Limits by table. The tables of `judged_tables` can have limits on every numeric column."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Doubt] = Field(init=False)

    @model_validator(mode="after")
    def _tables_are_judged(self) -> Self:
        unknown = [name for name in self.__pydantic_extra__ if name not in judged_tables()]
        if unknown:
            raise ValueError(f"unknown table '{unknown[0]}'; limits may stand on {', '.join(judged_tables())}")
        return self

    def of(self, table: str) -> Doubt:
        return self.__pydantic_extra__.get(table, Doubt())


def marked(table: pl.DataFrame, limits: Doubt, name: str) -> pl.DataFrame:
    """The table `name` with the column `DOUBTFUL`, which lists each value beyond its limit, with the limit.

    Raises InputError: a limit is set on a column that the table does not have or that is not numeric.
    """
    fitted = pl.col(EXCLUDED).is_null() if EXCLUDED in table.columns else pl.lit(True)
    fits = table.filter(fitted)
    above, below = (
        {column: limit for column, limit in side.items() if limit is not None} for side in (limits.above, limits.below)
    )
    numeric = {column for column, dtype in table.schema.items() if dtype.is_numeric() or dtype == pl.Null}
    for column in [*above, *below] if len(fits) else ():
        if column not in numeric:
            known = ", ".join(other for other in table.columns if table[other].dtype.is_numeric())
            raise InputError(
                f"configuration, doubtful.{name}: the table has no column '{column}' of numbers; put the limit on one "
                f"of {known}, or write null for no limit"
            )
    reasons = pl.Series([doubts(row, above, below) for row in table.iter_rows(named=True)], dtype=pl.String)
    return table.with_columns(reasons.alias(DOUBTFUL)).with_columns(pl.when(fitted).then(DOUBTFUL).alias(DOUBTFUL))


def doubts(row: Mapping[str, object], largest: Mapping[str, float], smallest: Mapping[str, float]) -> str:
    """Why a row of a table is doubtful: each value that is beyond its limit or NaN, with likely cause and remedy if the
    column has one. The text is empty if the row is not doubtful.

    `largest` are upper limits of absolute values, `smallest` lower limits of values. A null is not checked.
    """
    reasons = []
    for limits, word in ((largest, "above"), (smallest, "below")):
        for name, limit in limits.items():
            value = row.get(name)
            if not isinstance(value, int | float):
                continue
            if math.isnan(value):
                reasons.append(f"{name} is not a number")
            elif word == "above" and value < -limit:
                reasons.append(f"{name} {value:.3g} is below {-limit:g}{remedy(name, value, row)}")
            elif value > limit if word == "above" else value < limit:
                reasons.append(f"{name} {value:.3g} is {word} {limit:g}{remedy(name, value, row)}")
    return "; ".join(reasons)


def with_doubts_of(table: pl.DataFrame, fits: pl.DataFrame, limits: Doubt, name: str) -> pl.DataFrame:
    """The marked table with the reasons of another table, `name`, on the same trial and amplitude.

    What makes a fit doubtful, as a clipped or late torque, concerns everything that comes from the same samples. A
    table without amplitudes has the reasons of the row of `fits` over all amplitudes.
    """
    judged = marked(fits, limits, name)
    reasons = {(row["trial"], row["amplitude_deg"]): row[DOUBTFUL] for row in judged.iter_rows(named=True)}
    shared = []
    for row in table.iter_rows(named=True):
        other = reasons.get((row["trial"], row.get("amplitude_deg")))
        both = [row[DOUBTFUL], f"{name}.csv: {other}" if other else ""]
        shared.append(None if row[DOUBTFUL] is None else "; ".join(filter(None, both)))
    return table.with_columns(pl.Series(DOUBTFUL, shared, dtype=pl.String))


def counted(table: pl.DataFrame) -> pl.DataFrame:
    """The rows, one per trial, that count in a mean: the sound ones if they are a share of `FEWEST_SOUND`, else all."""
    if DOUBTFUL not in table.columns:
        return table
    doubtful, n = doubtful_count(table)
    return table.filter(~IS_DOUBTFUL) if doubtful and n - doubtful >= FEWEST_SOUND * n else table


def doubtful_row(table: pl.DataFrame) -> dict[str, int]:
    """`n_doubtful` for a row that summarises a table; empty for a table without the column `DOUBTFUL`."""
    return {"n_doubtful": doubtful_count(table)[0]} if DOUBTFUL in table.columns else {}


def doubtful_count(table: pl.DataFrame) -> tuple[int, int]:
    """Numbers of doubtful fits and of all fits of a table with the column `DOUBTFUL`."""
    return len(table.filter(IS_DOUBTFUL)), table[DOUBTFUL].count()


def unchecked_report(tables: Iterable[Path]) -> str:
    """Message at the end of a run: for each thing that could not be checked, the number of trials; empty if all was."""
    counts: dict[str, set[str]] = {}
    for path in tables:
        table = read_table(path) if path.is_file() and not is_refused(path) else pl.DataFrame()
        if "not_checked" in table.columns:
            for trial, reason in table.select("trial", "not_checked").drop_nulls().unique().iter_rows():
                counts.setdefault(reason, set()).add(trial)
    return "\n".join(f"not checked: {reason} (trials: {len(counts[reason])})" for reason in sorted(counts))


def doubt_report(tables: Iterable[Path]) -> str:
    """Message at the end of a run: the number of doubtful fits of each table; empty without doubtful fits."""
    written = {path.stem: read_table(path) for path in tables if path.is_file() and not is_refused(path)}
    counts = {name: doubtful_count(table) for name, table in written.items() if DOUBTFUL in table.columns}
    parts = [f"{name} {doubtful} of {fits}" for name, (doubtful, fits) in counts.items() if doubtful]
    return f"doubtful fits (the column `{DOUBTFUL}` of each table says why): {', '.join(parts)}" if parts else ""
