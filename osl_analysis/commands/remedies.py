"""Remedies that are tried on the recording before they are printed.

A refused or doubtful fit is made again with each change that may mend its recording
(`errors.Change`), in memory. Those that help are the remedy, with what they give. Rows that were
lost, joined or wrong are tried first. This costs time only where something is wrong."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import wraps
from inspect import signature
from itertools import groupby
from typing import Any, ParamSpec, TypeVar, cast

import numpy as np
import polars as pl
import scipy

from osl_analysis.bench.fit_tables import FitTables
from osl_analysis.commands.estimates import estimated, interval_text, printed_units
from osl_analysis.commands.fit import fit_settings, function_of, job_of
from osl_analysis.errors import Change, OslAnalysisError
from osl_analysis.files import default_config
from osl_analysis.ingest.examine import SMALLEST_MOTION, half_range, in_other_units
from osl_analysis.ingest.row_faults import row_faults_of
from osl_analysis.judge.causes import LEAST_EFFECT
from osl_analysis.judge.words import RENDERED_OF_K_D
from osl_analysis.signals.grid import with_stamp_evidence
from osl_analysis.trial import Trial, stretches

OTHER_EXPERIMENT = 9  # rank of a change that takes another one
SMOOTHED_S = 0.05  # of the angle, whose derivatives are taken
LARGEST_LAG_S = 0.3  # at the end, of clocks that drift
LAG_STEP_S = 0.005  # of those that are tried
LEFT_BY_CAUSE = 0.1  # share of the power left as recorded, below which a drift or part is believed
MOST_PARTS = 5  # between rows that are wrong; of more, the sensor is another one
FITS_WORSE = 2.0  # times what the best change leaves unexplained, from which one is no remedy
LEAST_UNEXPLAINED = 1e-6  # percent; less is rounding
WORTH_TELLING = 0.1  # percent; wrong rows that leave less move no estimate
MOST_TOLD = 5  # estimates that a remedy names
NOT_TOLD = ("offset", "drift", "K_secant", "K_unloading", "energy_stored", "energy_returned")
"""Estimates that do not show whether a change helps."""
DOUBTFUL_OF_K_D = (0.5, 1.5)  # beyond which channels, units and experiment are tried otherwise
LEAST_OF_JOINT = 0.1  # times K_d; of less, what is recorded may be the fixture alone
CHANGES_OF_STIFFNESS = ("K steps", "K drifts")  # hypotheses by which parts may be sound
PARTS = ((0.0, 0.3), (0.35, 0.65), (0.7, 1.0))  # of a recording that are tried then
OF_ANOTHER_JOINT = 50.0  # percent in the band, below which the channels may be others
LEAST_VAF = 90.0  # percent in the band of the motion, as `doubtful.impedance.below.VAF_in_band`
OF_ROWS: Mapping[str, pl.DataType] = {
    "row_harm": pl.Float64(), "row_fault": pl.String(), "mended": pl.String(),
    "mended_fault": pl.String(),
}  # fmt: skip
"""Columns of a table whose fits are tried again where they are doubtful."""


@dataclass(frozen=True)
class Outcome:
    """A change that helps, and the estimates that it gives."""

    change: Change
    row: Mapping[str, Any]

    @property
    def text(self) -> str:
        """The estimates: the first with its interval and unit."""
        first, *others = [name for name in estimated(self.row) if name not in NOT_TOLD][:MOST_TOLD]
        value = self.row[first]
        interval = interval_text(value, self.row.get(f"{first}_low"), self.row.get(f"{first}_high"))
        unit = printed_units().get(first)
        texts = [" ".join(filter(None, [f"{first} {value:.3g}", interval, unit]))]
        texts += [f"{name} {self.row[name]:.2g}" for name in others]
        return ", ".join(texts)


@dataclass(frozen=True)
class RowRemedy:
    """What helps a doubtful fit: the values of its columns `OF_ROWS`, None where nothing does."""

    row_harm: float | None = None  # multiples of what is doubtful, or of what is left unexplained
    row_fault: str | None = None  # what is wrong with rows
    mended: str | None = None  # the changes that help, and what they give
    mended_fault: str | None = None  # finding of `findings.yaml` that a change of no rows mends


P = ParamSpec("P")  # the arguments of a fit
T = TypeVar("T")  # its tables


def remedies_tried(fit: Callable[P, T]) -> Callable[P, T]:
    """Decorate the fit of a trial.

    The error of a refused fit gets the changes that help as its remedy. Tried are, until one helps:
    to leave out wrong rows, then the changes that the error names, then other readings of the
    recording. A fit that is doubtful gets its remedy from `with_remedy`.
    """

    @wraps(fit)
    def fitted(*args: P.args, **kwargs: P.kwargs) -> T:
        given = signature(fit).bind(*args, **kwargs).arguments
        try:
            tables = fit(*args, **kwargs)
        except OslAnalysisError as error:
            trial = given["trial"]
            helpful = tried(fit, given, changes_of_rows(trial), is_possible)
            if not helpful:
                helpful = tried(fit, given, error.changes, is_possible)
            if not helpful:
                helpful = tried(fit, given, other_readings(given, {}), is_as_stated)
            if not helpful:
                raise
            reason = error.reason
            faults = row_faults_of(trial)
            if helpful[0].change.windows and faults.texts:
                reason += f", and {faults.texts[0]}"
            raise type(error)(f"{reason}; {remedy_of(helpful)}") from error
        return with_remedy(fit, given, tables)

    return fitted


def with_remedy(fit: Callable[..., T], given: Mapping[str, Any], tables: T) -> T:
    """Add the columns `OF_ROWS` to the first table of a fit.

    They say of a doubtful fit which of its rows are wrong, and what a fit without them gives; or,
    where its rows are right, what another change gives. They are null if nothing helps.
    """
    if not isinstance(tables, FitTables):
        return tables
    name, table = next(iter(tables.estimates.items()))
    if "VAF" not in table.columns or "known_K" in table.columns:
        return tables
    remedy = RowRemedy()
    changes = changes_of_rows(given["trial"])
    before = last_row(tables)
    has_faults = bool(changes) and row_faults_of(given["trial"]).count > 0
    if has_faults and ("fault_harm" not in before or is_harmed(before)):
        outcomes = tried(fit, given, changes, lambda row: is_better(row, before))
        if outcomes:
            harm = harm_in(before)
            if harm == 0.0:  # a fit without inference and band: only its misfit tells
                harm = unexplained(before) / unexplained(outcomes[0].row)
            fault = row_faults_of(given["trial"]).texts[0]
            remedy = RowRemedy(row_harm=harm, row_fault=fault, mended=remedy_of(outcomes))
    if remedy.mended is None:
        finding, outcomes = mended_otherwise(fit, given, before)
        if outcomes:
            remedy = RowRemedy(mended=remedy_of(outcomes), mended_fault=finding)
    values = asdict(remedy)
    columns = [pl.lit(values[column], dtype).alias(column) for column, dtype in OF_ROWS.items()]
    estimates = {**tables.estimates, name: table.with_columns(columns)}
    return cast(T, replace(tables, estimates=estimates))


def mended_otherwise(
    fit: Callable[..., Any], given: Mapping[str, Any], before: Mapping[str, Any]
) -> tuple[str, list[Outcome]]:
    """What makes a doubtful fit sound whose rows are right: the finding (`findings.yaml`), and the
    changes that help."""
    trial = given["trial"]
    if not is_between(before.get("K_over_K_d"), DOUBTFUL_OF_K_D) or is_misfit(before):
        outcomes = tried(fit, given, other_readings(given, before), is_as_stated)
        if outcomes:
            return "wrong_reading", outcomes
    if not is_harmed(before):
        return "", []
    if before.get("fault") in CHANGES_OF_STIFFNESS:
        parts = parts_of(trial, given.get("windows"))
        changes = [windows_stated(part) for part in parts]
        most_left = LEFT_BY_CAUSE * unexplained(before)

        def is_without_person(row: Mapping[str, Any]) -> bool:
            """Whether a part is sound, and does not leave what a person adds."""
            return not is_harmed(row) and unexplained(row) <= most_left

        return "held_joint", tried(fit, given, changes, is_without_person)
    if before.get("fault_family") in ("path", "time"):
        drift_ppm = clock_drift_ppm(trial)
        if drift_ppm:
            words = f"record both with one device. Without a drift of {drift_ppm:.0f} ppm"
            change = Change(words, drift_ppm=drift_ppm)
            return "drifting_logger", tried(fit, given, [change], is_sound)
    return "", []


def is_between(value: Any, ends: tuple[float, float]) -> bool:
    """Whether a number lies between both ends; also of none."""
    return value is None or ends[0] <= value <= ends[1]


def is_possible(row: Mapping[str, Any]) -> bool:
    """Whether a fit gives what a joint can have: a stiffness that is told from 0, no negative
    damping, and a K near K_d."""
    first = estimated(row)[0]
    if first in ("K", "K_s"):
        low, high = row.get(f"{first}_low"), row.get(f"{first}_high")
        if low is not None and high is not None and low <= 0 <= high:
            return False
    if (row.get("B_high") or 0.0) < 0:
        return False
    return is_between(row.get("K_over_K_d"), DOUBTFUL_OF_K_D)


def is_misfit(row: Mapping[str, Any]) -> bool:
    """Whether the motion does not make the torque, as that of another joint."""
    vaf = row.get("VAF_in_band")
    return vaf is not None and vaf < OF_ANOTHER_JOINT


def is_as_stated(row: Mapping[str, Any]) -> bool:
    """Whether a fit reads a recording as its laboratory states it: possible, of the K_d that is
    stated, and near its torque."""
    in_band = row.get("VAF_in_band")
    vaf = (row.get("VAF") or 0.0) if in_band is None else in_band
    return (
        is_possible(row) and is_between(row.get("K_over_K_d"), RENDERED_OF_K_D) and vaf >= LEAST_VAF
    )


def other_readings(given: Mapping[str, Any], before: Mapping[str, Any]) -> list[Change]:
    """Other channels, units and experiments by which a recording may be right. Channels and units
    need a stated K_d, or a torque that the motion does not make, that tells which is."""
    trial = given["trial"]
    changes: list[Change] = []
    if not {"theta", "torque"} <= set(trial.columns):
        return changes
    condition = given.get("condition")
    K_d = (
        condition.get("K_d") if isinstance(condition, Mapping) else getattr(condition, "K_d", None)
    )
    if K_d or is_misfit(before):
        changes += in_other_units(trial, ["theta"]) + in_other_units(trial, ["torque"])
    of_shaft = {"theta_m", "torque_m"} & set(trial.columns)
    turn = 2 * half_range(trial, "theta")
    largest_turn = 2 * getattr(given.get("settings"), "largest_angle", np.inf)
    is_joint = SMALLEST_MOTION <= turn <= largest_turn
    if "current" in trial.columns and not of_shaft and not is_joint:
        changes.append(
            Change(
                "take experiment 'actuator', with theta named theta_m and torque torque_m in the"
                " source file",
                renamed={"theta": "theta_m", "torque": "torque_m"},
                experiment="actuator",
                rank=OTHER_EXPERIMENT,
            )
        )
    B_low, B_high = before.get("B_low"), before.get("B_high")
    has_no_damping = B_low is not None and B_high is not None and B_low <= 0 <= B_high
    if has_no_damping and (before.get("K_over_K_d") or 1.0) < LEAST_OF_JOINT:
        changes.append(
            Change(
                "take experiment 'calibration', with `alone` under fixture in the sheet",
                experiment="calibration",
                sheet={"fixture": "alone"},
                rank=OTHER_EXPERIMENT,
            )
        )
    return changes


def parts_of(trial: Trial, windows: str | None) -> list[str]:
    """Parts of a recording that may each be sound: the windows of the sheet, or its beginning,
    middle and end."""
    stated = (windows or "").split()
    if len(stated) > 1:
        return stated
    first, last = stretches(stated[0])[0] if stated else (0.0, float(np.ptp(trial.arrays()[0])))
    length = last - first
    return [f"{first + length * begin:.1f}-{first + length * end:.1f}" for begin, end in PARTS]


def clock_drift_ppm(trial: Trial) -> float | None:
    """The drift of the torque's clock against the angle's with which K, B and I describe the torque
    much better; None where none does. The inference finds a lag that stays below some 30 ms."""
    time, theta = trial.arrays("theta")
    torque_time, torque = trial.arrays("torque")  # two loggers may have no row in common
    step = float(np.ptp(time)) / (len(time) - 1)
    window = max(2 * round(SMOOTHED_S / step / 2) + 1, 5)
    motion = [
        scipy.signal.savgol_filter(theta, window, 3, deriv=order, delta=step) for order in range(3)
    ]
    X = np.column_stack([*motion, np.ones_like(theta)])

    def left(drift: float) -> float:
        late = np.interp(time + drift * (time - time[0]), torque_time, torque)
        return float(np.sum((late - X @ np.linalg.lstsq(X, late)[0]) ** 2))

    seconds = float(np.ptp(time))
    n_steps = round(2 * LARGEST_LAG_S / LAG_STEP_S)
    drifts = np.linspace(-LARGEST_LAG_S, LARGEST_LAG_S, n_steps + 1) / seconds
    best = drifts[np.argmin([left(drift) for drift in drifts])]
    ends = (best - LAG_STEP_S / seconds, best + LAG_STEP_S / seconds)
    refined = scipy.optimize.minimize_scalar(left, bounds=ends, method="bounded")
    return 1e6 * float(refined.x) if refined.fun < LEFT_BY_CAUSE * left(0.0) else None


def is_better(row: Mapping[str, Any], before: Mapping[str, Any]) -> bool:
    """Whether a fit is sound that was not before; without an inference, whether it leaves much less
    of the torque."""
    if "fault_harm" in before:
        return is_sound(row)
    left = unexplained(before)
    return left > WORTH_TELLING and left > FITS_WORSE * unexplained(row)


def unexplained(row: Mapping[str, Any]) -> float:
    """What a fit leaves of the torque's variance [percent]; the same for all without a VAF."""
    return max(100.0 - float(row.get("VAF") or 0.0), LEAST_UNEXPLAINED)


def harm_in(row: Mapping[str, Any]) -> float:
    """By how much a fault moves the estimates of a fit, or the model misses the recording, in
    multiples of what is doubtful."""
    vaf = row.get("VAF_in_band")
    missed = 0.0 if vaf is None else (100.0 - vaf) / (100.0 - LEAST_VAF)
    return max(float(row.get("fault_harm") or 0.0), missed)


def is_harmed(row: Mapping[str, Any]) -> bool:
    return harm_in(row) > LEAST_EFFECT


def is_sound(row: Mapping[str, Any]) -> bool:
    return not is_harmed(row)


def tried(
    fit: Callable[..., Any],
    given: Mapping[str, Any],
    changes: Sequence[Change],
    helps: Callable[[Mapping[str, Any]], bool] = lambda row: True,
) -> list[Outcome]:
    """Try changes on a recording.

    Parameters
    ----------
    fit : callable
        The fit that was refused or is doubtful, without remedies.
    given : Mapping
        Its arguments by name: `trial` and `settings` are changed.
    changes : sequence of Change
    helps : callable
        Whether a fit with a change, by its row, is what is looked for.

    Returns
    -------
    list of Outcome
        Of the changes of the lowest rank with which the trial can be fitted, and fits about as well
        as with the best.
    """
    expanded: list[Change] = []
    for change in changes:
        column = change.other_unit_of
        expanded += in_other_units(given["trial"], [column]) if column else [change]
    for _, of_rank in groupby(sorted(expanded, key=rank_of), key=rank_of):
        outcomes = [outcome_of(fit, given, change) for change in of_rank]
        helpful = [outcome for outcome in outcomes if outcome is not None and helps(outcome.row)]
        if helpful:
            least = min(unexplained(outcome.row) for outcome in helpful)
            return [
                outcome
                for outcome in helpful
                if outcome.change.windows or unexplained(outcome.row) <= FITS_WORSE * least
            ]
    return []


def rank_of(change: Change) -> int:
    return change.rank


def outcome_of(fit: Callable[..., Any], given: Mapping[str, Any], change: Change) -> Outcome | None:
    """What the fit gives with a change; None where it is refused."""
    arguments = {**given, "trial": changed(given["trial"], change)}
    if change.windows and "windows" in signature(fit).parameters:
        arguments["windows"] = change.windows
    elif change.windows:
        arguments["trial"] = arguments["trial"].within(change.windows)
    if change.settings:
        arguments["settings"] = given["settings"].model_copy(update=change.settings)
    if change.experiment:
        fit, settings = fit_of(change)
        arguments = {"trial": arguments["trial"], **settings}
    try:
        return Outcome(change, last_row(fit(**arguments)))
    except OslAnalysisError:
        return None


def changes_of_rows(trial: Trial) -> list[Change]:
    """To leave out the rows that are wrong or lie in gaps, or, where that does not help, all parts
    between them but one; none where no rows or too many are."""
    faults = row_faults_of(trial)
    parts = [f"{first:.1f}-{last:.1f}" for first, last in faults.windows(trial)]
    if not faults.part(trial) or not 0 < len(parts) <= MOST_PARTS:
        return []
    return [windows_stated(" ".join(parts)), *(windows_stated(part, rank=1) for part in parts)]


def windows_stated(windows: str, rank: int = 0) -> Change:
    return Change(f"write windows `{windows}` in the sheet", windows=windows, rank=rank)


def changed(trial: Trial, change: Change) -> Trial:
    """The recording with a change of its columns, or another one."""
    if change.recording is not None:
        trial = change.recording
    if change.delays:
        origins = dict(trial.provenance.get("columns", {}))
        for name, delay_s in change.delays.items():
            origins[name] = {**origins.get(name, {}), "delay": delay_s}
        trial = replace(trial, provenance={**trial.provenance, "columns": origins}, clocks={})
    if change.renamed:
        trial = replace(trial, samples=trial.samples.rename(dict(change.renamed)), clocks={})
    if change.drift_ppm:
        time, torque = trial.arrays("torque")
        stamps = trial.samples["time"].to_numpy()
        then = stamps + 1e-6 * change.drift_ppm * (stamps - stamps[0])
        at_angle = pl.Series("torque", np.interp(then, time, torque))
        trial = replace(trial, samples=trial.samples.with_columns(at_angle), clocks={})
    if not change.factors:
        return trial
    columns = [pl.col(name) * factor for name, factor in change.factors.items()]
    recording = replace(trial, samples=trial.samples.with_columns(columns), clocks={})
    return with_stamp_evidence(recording) if "time" in change.factors else recording


def fit_of(change: Change) -> tuple[Callable[..., Any], dict[str, Any]]:
    """The fit of another experiment, without remedies, and its settings by argument: the default
    ones, since a job has those of its own experiment alone."""
    job = job_of(change.experiment)
    settings, _ = fit_settings(change.experiment, default_config())
    if job.parameters:
        settings["parameters"] = None
    if job.sheet:
        settings["condition"] = change.sheet or None
    fit: Any = function_of(job)
    return cast(Callable[..., Any], fit.__wrapped__), settings


def last_row(tables: FitTables | Mapping[str, pl.DataFrame]) -> Mapping[str, Any]:
    """The estimates of all of a trial, in its first table."""
    by_name = tables.estimates if isinstance(tables, FitTables) else tables
    return next(iter(by_name.values())).row(-1, named=True)


def remedy_of(helpful: Sequence[Outcome]) -> str:
    """What helps and what it gives; changes that give the same stand together."""
    alike = groupby(helpful, key=lambda outcome: outcome.text)
    texts = [
        f"{' or '.join(outcome.change.words for outcome in same)}: {text}" for text, same in alike
    ]
    return "; or ".join(texts)
