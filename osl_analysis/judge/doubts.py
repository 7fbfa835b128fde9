"""Doubtful fits: the columns of result tables that are evidence against a fit, by cause, and the words for a reader;
what estimates cannot be, and what a motion cannot show, is refused.

A doubt begins with its cause, what that does and what to do; the numbers stand in brackets. What a known cause
explains, as a low VAF under friction, is no doubt of its own.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import polars as pl

from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.judge.table import TABLE, Cause, Doubt, Judgement
from osl_analysis.measured import check_measured, rms, significant
from osl_analysis.model.parameters import DrivetrainParameters
from osl_analysis.stats.repeats import summary_row
from osl_analysis.trial import Array

AnyRow = Mapping[str, object]  # a row of a result table
LARGEST_TURN = 0.2
"""Phase [rad] by which a lag turns the highest frequency, 6 ms at 5 Hz, beyond which a drivetrain may make it."""
CAUSES = {name: Cause(name, **facts) for name, facts in TABLE["causes"].items()}
EVIDENCE = {
    name: Judgement(name, **facts | {"cause": CAUSES[facts["cause"]]}) for name, facts in TABLE["columns"].items()
}
"""The rows of result tables, by column. Any other column may have a limit: its name is then all that is known of it."""
DOUBTFUL = "doubtful"  # column with the reasons: empty text if the fit is not doubtful, null in a row without a fit
IS_DOUBTFUL = pl.col(DOUBTFUL).fill_null("") != ""
EXCLUDED = "excluded"  # column of some tables with the reason why a row has no fit; null in rows with a fit
Found = dict[str, tuple[float, str]]  # what is beyond its limit: value, and how, by column


def cell_number(row: AnyRow, name: str) -> float | None:
    value = row.get(name)
    return float(value) if isinstance(value, int | float) else None


def of_whole_trial(row: AnyRow) -> bool:
    """Whether a row is of the fit to all of a trial, where others are of single amplitudes."""
    return "amplitude_deg" in row and row["amplitude_deg"] is None


def beyond(row: AnyRow, limits: Doubt) -> Found:
    """What of a row is beyond its limit or NaN, and how, by column; a null is not checked, nor is what the model leaves
    of a person's torque: he pushes as he likes, which the interval contains."""
    found: Found = {}
    of_person = row.get("reflex_delay_ms") is not None and "reaction" not in row
    for side, word in ((limits.above, "above"), (limits.below, "below")):
        for name, limit in side.items():
            value = cell_number(row, name)
            if limit is None or value is None or (of_person and name in EVIDENCE and EVIDENCE[name].misfit):
                continue
            if math.isnan(value):
                found[name] = (value, f"{name} is not a number")
            elif word == "above" and value < -limit:
                found[name] = (value, f"{name} {value:.3g} is below {-limit:g}")
            elif value > limit if word == "above" else value < limit:
                found[name] = (value, f"{name} {value:.3g} is {word} {limit:g}")
            elif name not in found and suspected_unit(name, value, row):
                found[name] = (value, f"{name} {value:.3g} is close to it")
    return found


def known_factor(ratio: float, signals: Sequence[str] = ("torque", "angle"), near: float = 0.08) -> str:
    """The factor between two units of some signals that may make a number `ratio` times too large, in words; empty if
    none is `near`."""
    size = max(abs(ratio), 1 / abs(ratio)) if ratio else math.inf
    factors: dict[str, float] = {name: x for signal in signals for name, x in TABLE["factors"][signal].items()}
    name = min(factors, key=lambda known: abs(math.log(size / factors[known])), default="")
    is_near = name and abs(size / factors[name] - 1) < near
    return f"{factors[name]:.3g} is the factor {name}" if is_near else ""


def suspected_unit(name: str, ratio: float, row: AnyRow) -> str:
    """The factor between units, as `known_factor`, that a ratio is near, although a device may differ as much: within
    4 %, as components differ from their file by 2 % (SD), of a desired curve within 1.5 %. Its witness tells which: a
    wrong torque scales both alike, a wrong current the ratio alone, to a tenth each."""
    evidence, symbol = EVIDENCE.get(name), name.removesuffix("_ratio")
    witness = cell_number(row, evidence.witness) if evidence and evidence.witness else None
    value, high = cell_number(row, symbol), cell_number(row, f"{symbol}_high")
    if evidence is None or not witness or (value and high and high > 1.05 * value):
        return ""
    of_current = [signal for signal in evidence.of if signal == "current" and abs(witness - 1) < 0.1]
    others = [signal for signal in evidence.of if signal != "current" and abs(witness / ratio - 1) < 0.1]
    return known_factor(ratio, of_current + others, 0.015 if symbol == "desired" else 0.04)


def turns_far(row: AnyRow) -> bool:
    """Whether a lag turns the highest frequency by more than `LARGEST_TURN`, and only Eq. 15 shows it."""
    lag, highest = (cell_number(row, name) or 0.0 for name in ("lag_s", "band_high_hz"))
    return 2 * math.pi * highest * abs(lag) > LARGEST_TURN and row.get("lag_by") in (None, "Eq. 15")


def number_said(name: str, value: float, row: AnyRow) -> str:
    """What the number of a column says of this fit; of a lag, how late a signal is, or would have to be, and what that
    makes of B and I."""
    late, factor = "", suspected_unit(name, value, row) or known_factor(value, EVIDENCE[name].of)
    lag, of_damping, of_inertia = (cell_number(row, name) for name in ("lag_s", "lag_share", "lag_inertia_share"))
    shares = [f"B by {significant(100 * of_damping)} %"] if of_damping is not None else []
    inertia = "J_j" if "J_j" in row else "I"
    shares += [f"{inertia} by {significant(100 * of_inertia)} %"] if of_inertia is not None else []
    without = {one: cell_number(row, f"{one}_without_lag") for one in "KB"}  # of a person's joint
    shares += [f"{one} from {value:.3g} to {row[one]:.3g}" for one, value in without.items() if value is not None]
    if lag is not None and shares:
        makes = " and ".join(shares)
        signal, size = "the angle" if lag < 0 else "the torque", f"{significant(1e3 * abs(lag), 3)} ms"
        if lag and abs(lag / 5e-3 - round(lag / 5e-3)) < 1e-6:  # the end of a range of delays that were tried
            size += " or more"
        late = f"{signal} is late by {size}, which moves {makes}"
        if turns_far(row):
            late = f"a delay of {signal} by {size} would explain it, and move {makes}"
    behind, per_ms, lost = (cell_number(row, name) or 0.0 for name in ("late_s", "energy_per_ms", "energy_lost"))
    loop, taken = "", 1e3 * behind * per_ms  # off the energy lost [J]
    if taken > 0:
        share = 100 * taken / abs(lost + taken)
        loop = f"a torque late by {1e3 * behind:.2g} ms would make it so, and take {share:.0f} % off the energy lost"
    known, ends = "", [cell_number(row, one) or 0.0 for one in ("lag_s", "lag_s_high", "gain", "gain_high")]
    if name == "certain_lag_s":
        half = ends[1] - ends[0]
        state = f"write `delay: {1e3 * ends[0]:.3g} ms` more for it and `{row['to_state']}`"
        if half > 0.2 * ends[0]:  # or early, which no load cell is
            state = "which a spring that loses energy shows too, so measure it with a known inertia"
        known = f"the torque is late by {1e3 * ends[0]:.3g} ± {1e3 * half:.2g} ms, {state}"
    if name == "certain_gain_error":
        said = f"torque over angle is {100 * (ends[2] - 1):+.3g} ± {100 * (ends[3] - ends[2]):.2g} % off"
        known = f"{said}, divide the torque's `scale` by {ends[2]:.5g} and write `{row['to_state']}`"
    frame = " (state `bench_stiffness` in the configuration if the bench's frame yields)"
    return EVIDENCE[name].shows.format(
        percent=f"{significant(100 * abs(value))} %",
        value=significant(value, 3),
        moves=f"{'rises' if value > 0 else 'falls'} by {100 * abs(value):.0f} %",
        symbol=name.removesuffix("_ratio").removesuffix("_high"),
        rubs=friction_said(row) or f"it is {significant(100 * abs(value))} % of the damping",
        gap=damping_gap_said(row),
        factor=factor and f", {factor}",
        frame=frame if 0.5 < value < 1 else "",  # a frame that yields lowers K, and hardly to a half
        late=late,
        loop=loop,
        known=known,
        reaction=row.get("reaction"),
        left_out_by=row.get("left_out_by"),
        row=row,
    )


def friction_said(row: AnyRow) -> str:
    """What friction makes of the damping, in units of the result; empty where that is not known."""
    B, f_C = ("B_j", "T_C") if "B_j_viscous" in row else ("B", "f_C")
    damping, viscous, friction, share = (cell_number(row, one) for one in (B, f"{B}_viscous", f_C, "coulomb_share"))
    if damping is not None and viscous is not None and friction is not None:
        without, all_of_it = significant(viscous, 3), significant(damping, 3)
        return f"{B} is {without} N*m*s/rad without friction and {all_of_it} with it, friction is {friction:.2g} N*m"
    if damping is not None and share:
        return f"friction makes {significant(share * damping)} N*m*s/rad of {B} = {significant(damping, 3)}"
    return ""


def damping_gap_said(row: AnyRow) -> str:
    """How far B is from what the gains should give; a delay explains less, and never more."""
    B, given, late = (cell_number(row, name) or 0.0 for name in ("B", "B_predicted", "B_gap_s"))
    said = f"B is {significant(B, 3)} N*m*s/rad and not {significant(given, 3)}"
    return f"{said}, which a delay of {significant(1e3 * late)} ms would explain" if 0 < late < 0.02 else said


def cause_in(name: str, value: float, row: AnyRow) -> Cause:
    """The cause of a number beyond its limit. A torque that comes late may be a delay or low-pass, or a spring in
    series, which of stiffness k lowers K by K/k: K_ratio says which agrees with the gains; without it, or with
    friction, neither is named alone. Where the lag is large it may be a drivetrain."""
    if suspected_unit(name, value, row):
        return CAUSES["another unit"]
    if name == "residual_over_gait" and cell_number(row, "plate_ringing_hz"):
        return CAUSES["plate that rings"]
    if name == "rate_change" and value < 0:
        return CAUSES["loss that falls with speed"]
    if name == "K_change" and (value > 0 or (cell_number(row, "stiffening") or 0.0) < 0):
        return CAUSES["spring that is not linear"]
    if EVIDENCE[name].shows != "{late}":
        return EVIDENCE[name].cause
    k, K, ratio = (cell_number(row, name) for name in ("frame_stiffness", "K", "K_ratio"))
    if turns_far(row):
        return CAUSES["late torque or drivetrain"]
    if k is None or K is None:
        return CAUSES["late torque"]
    of_lag, of_spring = (0.0, 0.0) if ratio is None else (abs(r - 1) for r in (ratio, ratio / (1 - K / k)))
    same = 0.03  # largest relative distance of K from what the gains should give, without much friction
    if min(of_lag, of_spring) > same or max(of_lag, of_spring) < same:
        return CAUSES["late torque or yielding bench"]
    return CAUSES["late torque" if of_lag < of_spring else "yielding bench"]


def explaining(row: AnyRow, found: Found) -> Cause | None:
    """The cause in a row that makes its fit worse, if there is one; harmonics alone are friction's."""
    names = sorted((name for name in found if name in EVIDENCE), key=lambda name: EVIDENCE[name].misfit)
    causes = (cause_in(name, found[name][0], row) for name in names)
    return next((cause for cause in causes if cause.explains), None)


def doubts(row: AnyRow, found: Found, of_trial: Cause | None, scope: str) -> Iterator[str]:
    """The doubts about a row for what was `found` in it, one per cause. `of_trial` explains a misfit for which the row
    itself has no cause, `scope` the field of `Cause` with the remedy for it. An unknown column speaks for itself."""
    misfit_by = explaining(row, found) or of_trial
    by_cause: dict[Cause, list[str]] = {}
    # first: a wrong unit or sign makes others of these
    units = [CAUSES[name] for name in ("another unit", "unlikely size", "stiffness unlike K_d", "impossible estimate")]
    for name in sorted(filter(EVIDENCE.__contains__, found), key=lambda name: EVIDENCE[name].cause not in units):
        cause = cause_in(name, found[name][0], row)
        by_cause.setdefault(misfit_by if misfit_by and EVIDENCE[name].misfit else cause, []).append(name)
    for cause, names in by_cause.items():
        said_of = [name for name in names if cause_in(name, found[name][0], row) is cause]  # of itself, not of a misfit
        details = [friction_said(row)] * (cause.name == "friction")
        details += [number_said(name, found[name][0], row) for name in said_of]
        if "yielding" in cause.name:
            k = significant(cell_number(row, "frame_stiffness") or 0.0, 3)
            details.append(f"a spring of {k} N*m/rad in series would explain it")
        said = ": ".join(filter(None, [cause.says, ", ".join(dict.fromkeys(filter(None, details)))]))
        remedy = getattr(cause, scope) or cause.remedy
        how = ", ".join(found[name][1] for name in names)
        yield f"{cause.name}: {said}. {remedy[0].upper()}{remedy[1:]} [{how}]"
    yield from (how for name, (_, how) in found.items() if name not in EVIDENCE)


def marked(table: pl.DataFrame, limits: Doubt, name: str) -> pl.DataFrame:
    """The table `name` with the column `DOUBTFUL`, which lists the causes of doubt with each value beyond its limit,
    and with the size of what could not be checked. Raises InputError: a limit is set on a column that the table does
    not have or that is not numeric."""
    fitted = pl.col(EXCLUDED).is_null() if EXCLUDED in table.columns else pl.lit(True)
    numeric = {column for column, dtype in table.schema.items() if dtype.is_numeric() or dtype == pl.Null}
    for column, limit in (*limits.above.items(), *limits.below.items()) if len(table.filter(fitted)) else ():
        if limit is not None and column not in numeric:
            known = ", ".join(other for other in table.columns if table[other].dtype.is_numeric())
            raise InputError(
                f"configuration, doubtful.{name}: the table has no column '{column}' of numbers; put the limit on "
                f"one of {known}, or write null for no limit"
            )
    rows = [(row.get("trial"), row, beyond(row, limits)) for row in table.to_dicts()]
    whole = {trial: found for trial, row, found in rows if of_whole_trial(row)}
    single = {trial for trial, row, _ in rows if row.get("amplitude_deg") is not None}
    of_trial: dict[object, Cause | None] = {}
    for trial, row, found in sorted(rows, key=lambda each: not of_whole_trial(each[1])):
        for column in [one for one in found if one in EVIDENCE and EVIDENCE[one].cause.of_recording]:
            if column not in whole.get(trial, found):
                del found[column]  # at one amplitude friction passes for it
        of_trial[trial] = of_trial.get(trial) or explaining(row, found)
    said = []
    for trial, row, found in rows:
        alone = row.get("amplitude_deg") is not None and not whole.get(trial, True)
        scope = "of_amplitude" if alone else "remedy" if trial in single else "otherwise"
        scope = "of_frequency" if row.get("frequency_hz") is not None else scope
        said.append("; ".join(doubts(row, found, of_trial[trial], scope)))
    judged = table.with_columns(pl.when(fitted).then(pl.Series(said, dtype=pl.String)).alias(DOUBTFUL))
    if "not_checked" in table.columns:
        judged = judged.with_columns(pl.Series("not_checked", [with_size(row) for _, row, _ in rows], dtype=pl.String))
    return judged


def with_doubts_of(table: pl.DataFrame, fits: pl.DataFrame, limits: Doubt, name: str) -> pl.DataFrame:
    """The marked table with the reasons of another table, `name`, on the same trial and amplitude, or over all of them:
    a clipped or late torque concerns everything that comes from the same samples."""
    judged = marked(fits, limits, name)
    of_fit = {(trial, deg): cell for trial, deg, cell in judged.select("trial", "amplitude_deg", DOUBTFUL).iter_rows()}
    shared = []
    for row in table.iter_rows(named=True):
        other = of_fit.get((row["trial"], row.get("amplitude_deg")))
        inherited = [f"{name}.csv: {one}" for one in (other or "").split("; ") if one]
        shared.append(None if row[DOUBTFUL] is None else "; ".join(filter(None, [row[DOUBTFUL], *inherited])))
    return table.with_columns(pl.Series(DOUBTFUL, shared, dtype=pl.String))


# What could not be checked: "what: why" for each, with its size in units of the result.

LATENESS, SIZED = "whether the torque is late", ". Each ms of delay would take"
NEGATIVE = "is certainly negative"  # of an inertia: checked, and a remark
EFFECTS: Mapping[str, str] = TABLE["effects"]  # what an effect of `bench.effects` is, for the column `explained_by`


def size_of_lateness(of_B: str, B: str, of_I: str, I: str) -> str:
    taken = f"{SIZED} {of_B} N*m*s/rad off B = {B} and {of_I} kg*m^2 off I = {I}"
    return f"{taken}. Measure it by a `calibration` of this bench"


def with_size(row: AnyRow) -> str | None:
    """What could not be checked on a row, a torque that comes late with what it would do to the estimates."""
    items = str(row.get("not_checked") or "").split("; ")
    K, B, I = (cell_number(row, name) for name in "KBI")
    if K is not None and B is not None and I is not None and row.get("reflex_delay_ms") is None:
        size = size_of_lateness(*map(significant, (1e-3 * K, B, 1e-3 * B, I)))
        items = [f"{item}{size}" if LATENESS in item else item for item in items]
    items += [
        f"{name} {NEGATIVE}: it is no inertia of a mass, since a motor behind its gains takes so much off it (the "
        "apparent inertia), and so does a torque that is late. Use the other estimates"
        for name in ("I", "J_j")
        if (cell_number(row, f"{name}_high") or 0.0) < 0
    ]
    return "; ".join(filter(None, items)) or None


def not_checked_of(table: pl.DataFrame) -> dict[str, str]:
    """What could not be checked on the rows of a trial, and why, as the last row that has it says; what has one reason
    is said together."""
    texts = table["not_checked"].drop_nulls().to_list() if "not_checked" in table.columns else []
    reasons = {what: why for what, _, why in (item.partition(": ") for text in texts for item in text.split("; "))}
    by_reason: dict[str, list[str]] = {}
    for what, why in reasons.items():
        by_reason.setdefault(why, []).append(what)
    return {", ".join(whats): why for why, whats in by_reason.items()}


def not_checked_line(table: pl.DataFrame) -> str:
    """The same on one line, of the fit to all data; empty if all was checked."""
    return "; ".join(f"{unchecked_kind(a).upper()}: {a} ({why})" for a, why in not_checked_of(table.tail(1)).items())


def unchecked_kind(what: str) -> str:
    """Whether this of the column `not_checked` was checked after all, and is to be known: `remark`."""
    return "remark" if what.endswith(NEGATIVE) else "not checked"


class Reason(NamedTuple):
    """A doubt of a cell of the column `DOUBTFUL`."""

    cause: str  # its name, or the column where that is all that is known
    text: str  # for a reader: cause, size and remedy
    inherited: bool  # whether it is from another table of the same trial
    beyond: tuple[tuple[str, str, str], ...] = ()
    """What is beyond its limit: column, value, limit with its side, as ("VAF", "80", "below 90")."""

    @property
    def parts(self) -> tuple[str, str, str]:
        """What is wrong, its size, and what to do; of an unknown column the text alone."""
        if (known := CAUSES.get(self.cause)) is None:
            return self.text, "", ""
        size, _, remedy = self.text.partition(known.says)[2].removeprefix(": ").rpartition(". ")
        return known.says, size, remedy

    @property
    def excess(self) -> float:
        """By which factor the farthest of them is beyond its limit."""
        pairs = ((float(value), float(limit.split()[-1])) for _, value, limit in self.beyond)
        return max((max(abs(a / b), abs(b / a)) for a, b in pairs if a * b), default=0.0)


def reasons_in(cell: str | None) -> Iterator[Reason]:
    """The doubts of a cell of the column `DOUBTFUL`. One of a mean of phasors begins with that which it is about."""
    of_table = re.compile(r"\w+\.csv: ")
    for item in (cell or "").split("; ") if cell else ():
        text = re.sub(r" \[[^\[]*\]$", "", item)
        own = of_table.sub("", re.sub(r"at \S+ deg: ", "", text, count=1), count=1)
        name = own.partition(": ")[0]
        cause = name if name in CAUSES else own.partition(" ")[0]
        found = re.findall(r"(\w+) (\S+) is ((?:above|below) [^\s,\]]+)", item)
        yield Reason(cause, of_table.sub("", text), bool(of_table.search(item)), tuple(found))


def causes_by_trial(table: pl.DataFrame, of: pl.DataFrame | None = None) -> dict[object, dict[str, Reason]]:
    """Per trial, or group, with a fit its causes of doubt, each as the last row that has it says it, which is that of
    all of the trial; without those that the table `of`, whose doubts its rows share, has for the same trial."""
    known = {} if of is None else causes_by_trial(of)
    key = next((name for name in ("trial", "group") if name in table.columns), None)
    found: dict[object, dict[str, Reason]] = {}
    for number, row in enumerate(table.iter_rows(named=True)):
        if row[DOUBTFUL] is not None:
            trial = number if key is None else row[key]
            causes = {one.cause: one for one in reasons_in(row[DOUBTFUL]) if one.cause not in known.get(trial, {})}
            found[trial] = found.get(trial, {}) | causes
    return found


def doubtful_count(table: pl.DataFrame) -> tuple[int, int]:
    """Numbers of doubtful fits and of all fits of a table with the column `DOUBTFUL`."""
    return len(table.filter(IS_DOUBTFUL)), table[DOUBTFUL].count()


def counted(table: pl.DataFrame) -> pl.DataFrame:
    """The rows, one per trial, that count in a mean: the sound ones if they are half or more, else all, as the doubt is
    then about the campaign."""
    if DOUBTFUL not in table.columns:
        return table
    doubtful, n = doubtful_count(table)
    return table.filter(~IS_DOUBTFUL) if doubtful and n - doubtful >= 0.5 * n else table


def doubtful_row(table: pl.DataFrame) -> dict[str, int]:
    """`n_doubtful` for a row that summarises a table; empty for a table without the column `DOUBTFUL`."""
    return {"n_doubtful": doubtful_count(table)[0]} if DOUBTFUL in table.columns else {}


def summary_of_trials(table: pl.DataFrame, quantities: Sequence[str]) -> pl.DataFrame:
    """A row per quantity (a column of `table`): `summary_row` over the trials that count (`counted`), with `n_doubtful`
    and `n_left_out`, how many fits are doubtful, and how many of these are not in the mean."""
    used = counted(table)
    numbers = {**doubtful_row(table), "n_left_out": len(table) - len(used)}
    return pl.DataFrame([{"quantity": name, **summary_row(used, name), **numbers} for name in quantities])


# What estimates cannot be, and what a motion cannot show. What is only unlikely is a column with a limit, as above.


def check_changes(column: str, values: Array) -> None:
    """Refuse a signal (n,) that never changes, as that of a dead sensor."""
    check_measured(column, values)
    if not np.ptp(values):
        raise InputError(
            f"{column} stays at {values[0]:g} throughout; check its sensor and its channel in the source file, or "
            "exclude the trial"
        )


def check_resists(trial: str, symbol: str, value: float, high: float | None = None) -> None:
    """Refuse a negative estimate of what can only resist motion. A torque of the wrong sign changes the sign of every
    estimate, and the fit is as good as before. Where `high`, the upper end of the interval, is positive, it may be the
    estimate of a joint without stiffness."""
    if value < 0 and (high is None or high < 0):
        raise InputError(
            f"trial {trial}: {symbol} = {value:.4g} is negative, so the torque drives the motion instead of resisting "
            "it; turn the `sign` of the torque, or of the angle, in the source file"
        )


def plausible(table: pl.DataFrame, rails: pl.Expr, p: DrivetrainParameters | None, *names: str) -> pl.DataFrame:
    """Rows of belt, transmission or actuator with `saturated_samples`, each named estimate's ratio to the parameter
    file's, null without one or where that is 0, and `not_checked`. Raises InputError: the first estimate is negative:
    torque, angle or current has the wrong sign."""
    last = table.row(-1, named=True)
    if names[0] != "k_tau_n_m":
        check_resists(last["trial"], names[0], last[names[0]])
    elif last["k_tau_n_m_high"] < 0:
        raise InputError(
            f"trial {last['trial']}: k_tau_n_m = {last['k_tau_n_m']:.4g} N*m/A is negative, a positive current gives a "
            "negative torque; turn the `sign` of the current, or of torque_m and theta_m, in the source file"
        )
    known = {name: p.k_tau * p.n_m if name == "k_tau_n_m" else getattr(p, name) for name in names} if p else {}
    ratios = [(pl.col(name) / pl.lit(known.get(name) or None, pl.Float64)).alias(f"{name}_ratio") for name in names]
    why = None if p else "estimates against those of a parameter file: the configuration names none"
    own = [pl.col("not_checked")] if "not_checked" in table.columns else []
    said = pl.concat_str(*own, pl.lit(why, pl.String), separator="; ", ignore_nulls=True).replace("", None)
    return table.with_columns(rails, *ratios, not_checked=said)


def plausible_impedance(
    table: pl.DataFrame,
    rails: pl.Expr,
    p: DrivetrainParameters | None,
    predicted: float | None = None,
    K_d: float | None = None,
) -> pl.DataFrame:
    """The rows of Eq. 15 with `saturated_samples`, `K_over_K_s` and `K_ratio`: K over `predicted`, by linear theory
    [N*m/rad], if the gains are known, else `K_over_K_d`, over K_d [N*m/rad] if that is stated. Both are of the largest
    amplitude in every row, since friction changes K least there.
    Raises InputError: K is negative, its interval too, or larger than that of the belt through which the motor acts."""
    last = table.row(-1, named=True)
    check_resists(last["trial"], "K", K := last["K"], last["K_high"])
    if p is not None and K > 1.1 * p.K_s:  # a motor in series with the belt; a tenth allows for the belt at hand
        ratio, reference = K / (predicted or p.K_s), "what the gains should give" if predicted else "K_s"
        factor = known_factor(ratio)
        what = "correct the `unit` or the `scale`" if factor else "check unit and scale of the channels"
        raise InputError(
            f"trial {last['trial']}: K = {K:.4g} N*m/rad is larger than the belt's K_s = {p.K_s:g} of the parameter "
            f"file, which no motor behind the belt can render; it is {ratio:.3g} times {reference}: "
            f"{factor and f'{factor}: '}{what} in the source file"
        )
    largest = pl.lit(table.sort("amplitude_deg", nulls_last=False)["K"][-1])
    none = pl.lit(None, pl.Float64)
    of_gains = (largest / predicted if predicted else none).alias("K_ratio")
    of_sheet = (none if predicted or not K_d else largest / K_d).alias("K_over_K_d")
    of_belt = (pl.col("K") / p.K_s if p and p.K_s else none).alias("K_over_K_s")
    return table.with_columns(rails, of_belt, of_gains, of_sheet)


def check_told(
    what: str,
    band_hz: tuple[float, float],
    motion: Array,
    torque_rms: float,
    stiffness: tuple[float, float],
    largest_inertia_error: float | None,
) -> None:
    """Refuse a motion whose band [Hz] cannot tell K from I; the message begins with `what` and names the band that is
    missing (IdentifiabilityError). It is judged by what an error of 0.1 % of the torque's RMS does, which calibrations
    and models leave, in the shape of the part of a column that the others do not explain: a slow motion has little of
    it. `motion`: angle [rad], velocity and acceleration, filtered, without means, (3, n), `torque_rms` [N*m] filtered,
    `stiffness` K with its standard error."""
    theta, omega, alpha = motion

    def own_part(column: Array, *others: Array) -> float:
        X = np.column_stack(others)
        return max(rms(column - X @ np.linalg.lstsq(X, column, rcond=None)[0]), float(np.finfo(float).tiny))

    of_K, of_I = (1e-3 * torque_rms / own_part(*x) for x in ((theta, omega, alpha), (alpha, omega, theta)))
    (low, high), (K, K_se) = band_hz, stiffness
    cannot = f"{what}: a motion of {low:.2g} to {high:.2g} Hz cannot tell K from I: an error of 0.1 % of the torque"
    if largest_inertia_error is not None and of_I > largest_inertia_error:
        needed = max(high * np.sqrt(of_I / (0.5 * largest_inertia_error)), 1.5 * high)
        raise IdentifiabilityError(
            f"{cannot} changes I by {of_I:.2g} kg*m^2, more than the {largest_inertia_error:g} of "
            f"`largest_inertia_error` in the configuration; the band from {high:.2g} to about {needed:.2g} Hz is "
            "missing, excite it as well, or take the stiffness alone by experiment 'torque_angle', or check the units "
            f"of theta and torque, by which K would be {K:.3g} N*m/rad"
        )
    # K by a tenth, and three times what the error is of torque over angle: without stiffness there is no share of K. It
    # is 1.6 from 0.5 to 6 Hz.
    if of_K > max(0.1 * abs(K), K_se) and rms(theta) > 3 * own_part(theta, omega, alpha):
        raise IdentifiabilityError(
            f"{cannot} changes K by {of_K:.2g} N*m/rad; the band below {low:.2g} Hz is missing, excite it as well"
        )
