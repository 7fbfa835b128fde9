"""Doubtful fits: the columns of result tables that are evidence against a fit, by cause, and the words for a reader.

A doubt begins with its cause, then says what it does to the numbers and what to do; what is beyond its limit stands in
brackets. A fault of the recording, such as a late torque, is named only where the fit to all of a trial shows
it too: friction may pass for one at a single amplitude. What a known cause explains, as a low VAF under friction, is no
doubt of its own.
"""

import math
import re
from collections.abc import Callable, Sequence
from typing import NamedTuple

import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.judge.impossible import known_factor
from osl_analysis.judge.table import AnyRow, Cause, Doubt, Evidence
from osl_analysis.stats.repeats import summary_table

SOFT_FRAME = 0.5  # smallest K, as a share of what the gains should give, that a frame is a likely cause of
SAME_K = 0.03
"""Largest relative distance of K from what the gains should give that counts as agreement, without much friction."""


LARGEST_TURN = 0.2
"""Phase [rad] by which a lag turns the highest frequency, 6 ms at 5 Hz, beyond which a drivetrain may make it."""


def too_far(symbol: str, reference: str = "that of the parameter file") -> Callable[[float, AnyRow], str]:
    """Words for an estimate of `symbol` that is far from its `reference`, by their ratio."""
    return lambda ratio, _: ", ".join(filter(None, [f"{symbol} is {ratio:.3g} times {reference}", known_factor(ratio)]))


def far_from_gains(ratio: float, row: AnyRow) -> str:
    """The words for a K that is far from what the gains should give: units, or a frame that yields if K is low."""
    words = too_far("K", "what K_d and the controller should give")(ratio, row)
    frame = " (state `bench_stiffness` in the configuration if the bench's frame yields)"
    return words + (frame if SOFT_FRAME < ratio < 1 else "")


def changing(symbol: str) -> Callable[[float, AnyRow], str]:
    """Words for an estimate that changes with the amplitude, by its relative change."""
    return lambda change, _: (
        f"{symbol} {'rises' if change > 0 else 'falls'} by {100 * abs(change):.0f} % with the amplitude"
    )


def cell_number(row: AnyRow, name: str) -> float | None:
    value = row.get(name)
    return float(value) if isinstance(value, int | float) else None


def late_signal(row: AnyRow) -> str:
    return "the angle" if (cell_number(row, "lag_s") or 0.0) < 0 else "the torque"


def late(_: float, row: AnyRow) -> str:
    """How late a signal is, and what that makes of B and I."""
    lag, of_damping, of_inertia = (cell_number(row, name) for name in ("lag_s", "lag_share", "lag_inertia_share"))
    if lag is None or of_damping is None:
        return ""
    makes = f"{100 * of_damping:.1f} % of B" + ("" if of_inertia is None else f" and {100 * of_inertia:.0f} % of I")
    size = f"{1e6 * abs(lag):.0f} us"
    if turns_far(row):
        return f"a delay of {late_signal(row)} by {size} would explain it, and make {makes}"
    return f"{late_signal(row)} is late by {size}, which make {makes}"


def turns_far(row: AnyRow) -> bool:
    """Whether a lag turns the highest frequency by more than `LARGEST_TURN`."""
    lag, highest = (cell_number(row, name) or 0.0 for name in ("lag_s", "band_high_hz"))
    return 2 * math.pi * highest * abs(lag) > LARGEST_TURN


# fmt: off
DELAYED = Cause("late torque", "angle and torque of one time do not stand together, which falsifies B and I",
    "state `delay` or `low_pass` of the channel in the source file, as in `delay: 2 ms` or `low_pass: {cutoff: 100 "
    "Hz, order: 1}`", explains=True)
YIELDING = Cause("yielding bench", "a spring in series yields, as the bench's frame or a belt, which explains the "
    "delay and the low K", "state `bench_stiffness`, once measured, in the configuration", explains=True)
LATE_OR_YIELDING = Cause("late torque or yielding bench", "the torque comes late, or a spring in series yields, as "
    "the bench's frame or a belt, which this recording cannot tell apart", "state `delay` or `low_pass` of the "
    "channel in the source file, or `bench_stiffness` in the configuration", explains=True)
LATE_OR_DRIVETRAIN = Cause("late torque or drivetrain", "the torque comes late, or the joint is not of second order, "
    "as where a drivetrain turns its torque, which this recording cannot tell apart", "state `delay` or `low_pass` of "
    "the channel in the source file if a known spring on the same bench shows it, else use K alone", explains=True)
FRICTION = Cause("friction", "it does not grow with the motion, so that B, and K of small motions, depend on the "
    "amplitude", "use the rows of single amplitudes, or the damping that is not friction (B_viscous, "
    "beside f_C)", explains=True, otherwise="use the damping that is not friction (B_viscous, beside f_C)")
CLIPPED = Cause("clipped signal", "a torque, angle or current is clipped, it stands at an end of its sensor's range "
    "or of a motor's limit", "use a sensor of larger range, or a smaller motion, see the quality check "
    "`saturation`", explains=True)
STIFFENING = Cause("spring that is not linear", "the stiffness depends on the deflection, the spring stiffens, or "
    "softens", "use the rows of single amplitudes", explains=True, otherwise="state the deflection that it is "
    "meant for")
BACKLASH = Cause("backlash", "play between joint and bench takes off stiffness", "mend the mount", explains=True)
WARMING = Cause("stiffness that changes", "K changes while the trial is recorded, as by warming up or creep, and I "
    "takes what differs from one frequency to the next for its own", "record the joint warm and in a shorter time, "
    "or by several sweeps", explains=True)
CLOCKS = Cause("clocks that drift apart", "the clocks of angle and torque drift apart, which shifts B and I",
    "record both by one device, or by synchronised clocks")
DRIFTING = Cause("load cell that drifts", "the torque drifts while the trial is recorded", "zero the load cell once "
    "it is warm")
ASYMMETRY = Cause("asymmetric torque", "the torque differs between the two directions of motion, as of an end stop "
    "or a spring with a preload", "look at torque against angle", explains=True)
SCALE = Cause("unlikely size", "an estimate is far from what this device can have", "check units and scales in the "
    "source file")
TOO_LITTLE = Cause("motion that tells too little", "the motion hardly tells the estimates apart, or is small beside "
    "the noise of the sensors", "move the joint further, or by more frequencies")
STAMPS = Cause("undecided time stamps", "the estimates depend on whether the stamps or an even sampling are true, "
    "which nothing decides", "state `stamps: exact` or `stamps: even` in the source file")
UNEXPLAINED = Cause("model that does not fit", "the model leaves more of the torque unexplained than it should, for "
    "no cause that is known here", "look at measured and modelled torque of the trial in the report")
LOOP = Cause("loop that does not close", "the torque does not come back with the angle, the load cell drifts, the "
    "device creeps, or it begins another way than it goes on", "zero the load cell, and record several cycles with "
    "the way back once the device has settled")
BENT = Cause("distorted motion", "the bench did not move the joint in a sine", "lower its speed or improve its "
    "control")
# fmt: on


def late_or_yielding(row: AnyRow) -> Cause:
    """The cause of a torque that comes late: a delay or low-pass, a spring in series, or both where K does not tell;
    or a drivetrain where the lag is large.

    A spring of stiffness k in series lowers K by K/k, a delay does not change it. K_ratio says which of the two agrees
    with the gains; without it, or with friction, neither is named alone.
    """
    k, K, ratio = (cell_number(row, name) for name in ("frame_stiffness", "K", "K_ratio"))
    if turns_far(row):
        return LATE_OR_DRIVETRAIN
    if k is None or K is None:
        return DELAYED
    if ratio is None:
        return LATE_OR_YIELDING
    of_lag, of_spring = (abs(r - 1) for r in (ratio, ratio / (1 - K / k)))
    if min(of_lag, of_spring) > SAME_K or max(of_lag, of_spring) < SAME_K:
        return LATE_OR_YIELDING
    return DELAYED if of_lag < of_spring else YIELDING


ROWS = (
    Evidence("coulomb_share", FRICTION, "{percent} of B is Coulomb friction and not damping"),
    Evidence("odd_harmonics", FRICTION, "odd harmonics make {percent} of the torque", misfit=True),
    Evidence("torque_distortion", FRICTION, "harmonics make {percent} of the torque", misfit=True),
    Evidence("K_change", FRICTION, changing("K")),
    Evidence("B_change", FRICTION, changing("B")),
    Evidence("saturated_samples", CLIPPED),
    Evidence("torque_at_peaks", CLIPPED, "the torque stands still where Eq. 15 has its peaks, or the spring softens"),
    Evidence("stiffening", STIFFENING, "the stiffness changes by {percent} up to the largest amplitude"),
    Evidence("energy_lost", Cause("hysteresis", "loading and unloading have different slopes", "state which is meant"),
        "{percent} of the energy is lost in the belt"),
    Evidence("backlash_share", BACKLASH, "{percent} of K is lost to backlash"),
    Evidence("even_harmonics", ASYMMETRY, "even harmonics make {percent} of the torque"),
    *(Evidence(name, DELAYED, late, of_recording=True)
        for name in ("certain_lag_damping", "lag_share", "lag_inertia_share")),
    Evidence("B_j_high", DELAYED, "the damping comes out negative"),
    Evidence("returned_share", Cause("energy from nothing", "the device gives back more than it takes up, the torque "
        "is late or its sign is wrong", "state `delay`, or turn the `sign`, of the torque in the source file")),
    Evidence("K_drift", WARMING, "K changes by {percent} over the trial", of_recording=True),
    Evidence("drift_inertia_share", WARMING, "that makes this share of I: {percent}", of_recording=True),
    Evidence("certain_clock_drift_ppm", CLOCKS, "they drift by {value} ppm", of_recording=True),
    Evidence("load_cell_drift", DRIFTING, "the torque drifts by {value} N*m/min"),
    Evidence("closure_angle", LOOP, "a cycle does not end where it began"), Evidence("closure_torque", LOOP),
    Evidence("cycle_drift", LOOP, "the torque drifts from cycle to cycle"),
    Evidence("rest_change", Cause("torque at rest that changes", "at rest the torque at the end is not that at the "
        "start, and hysteresis leaves a torque in the device that is taken for zero, or the load cell drifts",
        "write zero: start if the device was without load there")),
    Evidence("bridged_share", Cause("gaps in the recording", "what the device did in the gaps is not known",
        "record again")),
    Evidence("rate_change", Cause("speed that matters", "the energy lost depends on the speed, so that the trial is "
        "not quasi-static", "record it slower")),
    Evidence("K_ratio", SCALE, far_from_gains), Evidence("K_over_K_s", SCALE, too_far("K", "the belt's K_s")),
    Evidence("k_tau_n_m_ratio", SCALE, too_far("k_tau n_m")),
    *(Evidence(f"{name}_ratio", SCALE, too_far(name)) for name in ("K_s", "B_j", "J_j", "J_m", "f_C", "f_G", "B_m")),
    Evidence("angle_noise_share", TOO_LITTLE, "noise of the encoder changes I by {percent}"),
    *(Evidence(name, TOO_LITTLE) for name in ("condition_number", "largest_correlation", "Y_phase_se_deg")),
    Evidence("theta_distortion", BENT, "harmonics make {percent} of the angle"),
    Evidence("time_base_shift", STAMPS, "the other reading would shift an estimate by {value} half-widths"),
    *(Evidence(name, UNEXPLAINED, misfit=True)
        for name in ("VAF", "R2", "VAF_held_out", "residual_autocorrelation", "misfit")),
    Evidence("coherence", Cause("responses that cancel", "perturbations cancel each other",
        "look at their directions and onsets")),
    Evidence("outside_interval", Cause("estimate outside its interval", "one response is unlike the others",
        "look at the single responses")),
    Evidence("heterogeneity", Cause("several stiffnesses", "perturbations show several stiffnesses",
        "state K_d or group in the sheet to part them")),
    Evidence("onset_phase_sd", Cause("several timings", "perturbations begin at several phases of stance",
        "name timing under walking.group_by")),
    Evidence("stance_change", Cause("stance that changes", "its duration is not the one that its gait before the onset "
        "leads to expect: the perturbation changes the stance, or its pace is misread",
        "look whether K is that of the other perturbations")),
    Evidence("uncorrected_stance_change", Cause("phase by another stance", "perturbed crossings have not the stance "
        "that phase is computed with", "set walking.perturbed_stance: matched")),
    Evidence("unperturbed_stance_sd", Cause("several paces", "unperturbed crossings walk at several paces",
        "state subject, session or speed in the sheet to part them")),
    Evidence("residual_over_gait", Cause("torque that nothing explains", "neither a second-order joint nor ordinary "
        "gait explains the torque", "look for clipped channels and a second foot")),
    Evidence("offset_over_gait", Cause("offset", "an offset that ordinary gait does not have changes K",
        "look at the single response")),
    Evidence("offset_share", Cause("offset", "an offset in the fit would change K much",
        "look at the single responses")),
    Evidence("estimator_difference", Cause("estimators that disagree", "the fit to the mean response and the mean of "
        "the single fits disagree", "look at the single responses")),
    Evidence("K_se_share", Cause("too few crossings", "K is uncertain", "record more crossings, or larger "
        "perturbations")),
    Evidence("bridged", Cause("hidden markers", "much of the motion is interpolated between sightings of markers",
        "correct the markers' places, or fill their gaps in the capture software")),
    Evidence("K", Cause("impossible estimate", "K is not positive",
        "look at onsets and signs of the single responses")),
    Evidence("B_high", Cause("impossible estimate", "B is negative", "look at the time between angle and torque")),
    Evidence("I_high", Cause("impossible estimate", "I is negative", "look at the time between angle and torque")),
)  # fmt: skip
"""The rows of result tables, by column. Any other column may have a limit: its name is then all that is known of it."""
EVIDENCE = {row.column: row for row in ROWS}
CAUSES = {cause.name: cause for cause in (*(row.cause for row in ROWS), YIELDING, LATE_OR_YIELDING, LATE_OR_DRIVETRAIN)}
DOUBTFUL = "doubtful"  # column with the reasons: empty text if the fit is not doubtful, null in a row without a fit
IS_DOUBTFUL = pl.col(DOUBTFUL).fill_null("") != ""
FEWEST_SOUND = 0.5
"""Share of sound trials from which on a mean over trials leaves out the doubtful ones. With fewer, all trials count:
the doubt is then about the campaign, and the rest would be a selection."""
EXCLUDED = "excluded"
"""Column with the reason why a row has no fit, in tables that have such rows; null in rows with a fit."""
Found = dict[str, tuple[float, str]]  # what is beyond its limit: value, and how, by column


def beyond(row: AnyRow, limits: Doubt) -> Found:
    """What of a row is beyond its limit or NaN, and how, by column; a null is not checked."""
    found: Found = {}
    for side, word in ((limits.above, "above"), (limits.below, "below")):
        for name, limit in side.items():
            value = cell_number(row, name)
            if limit is None or value is None:
                continue
            if math.isnan(value):
                found[name] = (value, f"{name} is not a number")
            elif word == "above" and value < -limit:
                found[name] = (value, f"{name} {value:.3g} is below {-limit:g}")
            elif value > limit if word == "above" else value < limit:
                found[name] = (value, f"{name} {value:.3g} is {word} {limit:g}")
    return found


def cause_in(name: str, value: float, row: AnyRow) -> Cause | None:
    """The cause of a number beyond its limit; None for a column of which nothing but its name is known."""
    if name not in EVIDENCE:
        return None
    if name == "K_change" and (value > 0 or (cell_number(row, "stiffening") or 0.0) < 0):
        return STIFFENING
    return late_or_yielding(row) if EVIDENCE[name].detail is late else EVIDENCE[name].cause


def explaining(row: AnyRow, found: Found) -> Cause | None:
    """The cause in a row that makes its fit worse, if there is one; harmonics alone are friction's."""
    names = sorted((name for name in found if name in EVIDENCE), key=lambda name: EVIDENCE[name].misfit)
    causes = (cause_in(name, found[name][0], row) for name in names)
    return next((cause for cause in causes if cause is not None and cause.explains), None)


def reasons(row: AnyRow, found: Found, of_trial: Cause | None, single: bool) -> list[str]:
    """The doubts about a row for what was `found` in it, one per cause. `of_trial` explains a misfit for which the row
    itself has no cause, `single`: there are rows of single amplitudes. A column without a row speaks for itself."""
    misfit_by = explaining(row, found) or of_trial
    by_cause: dict[Cause, list[str]] = {}
    unknown = []
    for name, (value, how) in found.items():
        cause = cause_in(name, value, row)
        if cause is None:
            unknown.append(how)
        else:
            by_cause.setdefault(misfit_by if misfit_by and EVIDENCE[name].misfit else cause, []).append(name)
    said = [doubt(cause, row, {name: found[name] for name in names}, single) for cause, names in by_cause.items()]
    return said + unknown


def doubt(cause: Cause, row: AnyRow, found: Found, single: bool) -> str:
    """A doubt in words: its cause, what it does here, what to do, and the numbers that show it."""
    details = dict.fromkeys(EVIDENCE[name].words(value, row) for name, (value, _) in found.items())
    if cause in (YIELDING, LATE_OR_YIELDING):
        details[f"a spring of {cell_number(row, 'frame_stiffness'):.3g} N*m/rad in series would explain it"] = None
    damping = "B_j" if "B_j_viscous" in row else "B"
    viscous, f_C = cell_number(row, f"{damping}_viscous"), cell_number(row, "f_C")
    if cause is FRICTION and viscous is not None and f_C is not None:
        details[f"without it {damping} is {viscous:.3g} N*m*s/rad, and the friction is {f_C:.2g} N*m"] = None
    said = ": ".join(filter(None, [cause.says, ", ".join(filter(None, details))]))
    remedy = cause.remedy if single else cause.otherwise or cause.remedy
    return f"{cause.name}: {said}. {remedy[0].upper()}{remedy[1:]} [{', '.join(how for _, how in found.values())}]"


def marked(table: pl.DataFrame, limits: Doubt, name: str) -> pl.DataFrame:
    """The table `name` with the column `DOUBTFUL`, which lists the causes of doubt with each value beyond its limit,
    and with the size of what could not be checked.

    Raises InputError: a limit is set on a column that the table does not have or that is not numeric.
    """
    fitted = pl.col(EXCLUDED).is_null() if EXCLUDED in table.columns else pl.lit(True)
    numeric = {column for column, dtype in table.schema.items() if dtype.is_numeric() or dtype == pl.Null}
    for side in (limits.above, limits.below) if len(table.filter(fitted)) else ():
        for column, limit in side.items():
            if limit is not None and column not in numeric:
                known = ", ".join(other for other in table.columns if table[other].dtype.is_numeric())
                raise InputError(
                    f"configuration, doubtful.{name}: the table has no column '{column}' of numbers; put the limit on "
                    f"one of {known}, or write null for no limit"
                )
    rows = table.to_dicts()
    found = [beyond(row, limits) for row in rows]
    whole = {row.get("trial"): one for row, one in zip(rows, found, strict=True) if of_whole_trial(row)}
    of_trial: dict[object, Cause | None] = {}
    for row, one in sorted(zip(rows, found, strict=True), key=lambda both: not of_whole_trial(both[0])):
        for column in [name for name in one if name in EVIDENCE and EVIDENCE[name].of_recording]:
            if column not in whole.get(row.get("trial"), one):
                del one[column]  # at one amplitude friction passes for it
        of_trial[row.get("trial")] = of_trial.get(row.get("trial")) or explaining(row, one)
    single = {row.get("trial") for row in rows if row.get("amplitude_deg") is not None}
    said = [
        "; ".join(reasons(row, one, of_trial[row.get("trial")], row.get("trial") in single))
        for row, one in zip(rows, found, strict=True)
    ]
    judged = table.with_columns(pl.Series(DOUBTFUL, said, dtype=pl.String))
    if "not_checked" in table.columns:
        judged = judged.with_columns(pl.Series("not_checked", [sized(row) for row in rows], dtype=pl.String))
    return judged.with_columns(pl.when(fitted).then(DOUBTFUL).alias(DOUBTFUL))


def of_whole_trial(row: AnyRow) -> bool:
    """Whether a row is of the fit to all of a trial, where others are of single amplitudes."""
    return "amplitude_deg" in row and row["amplitude_deg"] is None


LATENESS = "whether the torque is late"


def sized(row: AnyRow) -> str | None:
    """What could not be checked on a row, a torque that comes late with what it would do to the estimates."""
    text, K, B, I = row.get("not_checked"), *(cell_number(row, name) for name in "KBI")
    if not text or LATENESS not in str(text) or K is None or B is None or I is None:
        return None if text is None else str(text)
    taken = f"{1e-3 * K:.2g} N*m*s/rad off B = {B:.3g} and {1e-3 * B:.2g} kg*m^2 off I = {I:.2g}"
    size = f"each ms of delay would take {taken}, check it with a known spring on the same bench"
    return "; ".join(f"{item}, {size}" if LATENESS in item else item for item in str(text).split("; "))


def not_checked_of(table: pl.DataFrame) -> dict[str, str]:
    """What could not be checked on the rows of a trial, and why, each once: as the last row that has it says."""
    texts = table["not_checked"].drop_nulls().to_list() if "not_checked" in table.columns else []
    items = (item.partition(": ") for text in texts for item in text.split("; "))
    return {what: why for what, _, why in items}


def with_doubts_of(table: pl.DataFrame, fits: pl.DataFrame, limits: Doubt, name: str) -> pl.DataFrame:
    """The marked table with the reasons of another table, `name`, on the same trial and amplitude.

    What makes a fit doubtful, as a clipped or late torque, concerns everything that comes from the same samples. A
    table without amplitudes has the reasons of the row of `fits` over all amplitudes.
    """
    judged = marked(fits, limits, name)
    of_fit = {(row["trial"], row["amplitude_deg"]): row[DOUBTFUL] for row in judged.iter_rows(named=True)}
    shared = []
    for row in table.iter_rows(named=True):
        other = of_fit.get((row["trial"], row.get("amplitude_deg")))
        inherited = [f"{name}.csv: {one}" for one in (other or "").split("; ") if one]
        shared.append(None if row[DOUBTFUL] is None else "; ".join(filter(None, [row[DOUBTFUL], *inherited])))
    return table.with_columns(pl.Series(DOUBTFUL, shared, dtype=pl.String))


class Reason(NamedTuple):
    """One doubt of a cell, as it is written there."""

    cause: str  # its name; the column, where that is all that is known
    text: str
    inherited: bool  # from another table of the same trial


PLACED = re.compile(r"at \S+ deg: ")  # which phasor a doubt of their mean is about
INHERITED = re.compile(r"\w+\.csv: ")


def reasons_in(cell: str | None) -> list[Reason]:
    """The doubts of a cell of the column `DOUBTFUL`."""
    found = []
    for text in (cell or "").split("; ") if cell else ():
        own = INHERITED.sub("", PLACED.sub("", text, count=1), count=1)
        name = own.partition(": ")[0]
        found.append(Reason(name if name in CAUSES else own.partition(" ")[0], text, bool(INHERITED.search(text))))
    return found


def causes_by_trial(table: pl.DataFrame, of: pl.DataFrame | None = None) -> dict[object, dict[str, str]]:
    """Per trial, or group, with a fit its causes of doubt, each with a text; without those that the table `of`, whose
    doubts its rows share, has for the same trial."""
    known = {} if of is None else causes_by_trial(of)
    key = next((name for name in ("trial", "group") if name in table.columns), None)
    found: dict[object, dict[str, str]] = {}
    for number_of_row, row in enumerate(table.iter_rows(named=True)):
        if row[DOUBTFUL] is not None:
            trial = number_of_row if key is None else row[key]
            causes = {one.cause: one.text for one in reasons_in(row[DOUBTFUL]) if one.cause not in known.get(trial, {})}
            found[trial] = causes | found.get(trial, {})
    return found


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


def summary_of_trials(table: pl.DataFrame, quantities: Sequence[str]) -> pl.DataFrame:
    """`summary_table` of the trials that count (`counted`), with `n_doubtful` and `n_left_out`: how many fits are
    doubtful, and how many of these are not in the mean."""
    used = counted(table)
    numbers = {**doubtful_row(table), "n_left_out": len(table) - len(used)}
    return summary_table(used, quantities).with_columns(**{name: pl.lit(value) for name, value in numbers.items()})
