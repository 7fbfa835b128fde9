# SPDX-License-Identifier: Apache-2.0
"""From a recording to its estimates: the fit of each kind of trial on the bench, as the jobs of a
campaign, the command line and notebooks call it, and what its tables tell together.

From a recording to K, in the order in which a maintainer reads:

1. `commands/trials.py`, `checked_trial`: `ingest/raw_files.py` reads a file by its format
   (`formats/`), and `ingest/conversion.py` makes SI units and our signs of it: a `base/trial.py`.
2. Here, `fit_impedance_trial`. `ingest/guard.py` refuses what cannot be fitted.
3. `bench/motion.py`: `signals/grid.py` brings the columns on one time base, and what moved tells
   which rows are fitted: the settled cycles of sines (`spectral/stepped_sine.py`), or whatever
   moves. `bench/record.py`: angle and torque behind one filter.
4. `bench/regression.py`: normal equations of groups, estimates, standard errors
   (`stats/linear_fit.py`). `bench/impedance.py`: Eq. 15 for each amplitude and all of them.
5. `bench/evidence.py`, `weigh_alternatives`: what else may make K, which is of a leg its belt
   (`bench/lags.py`), of a joint the candidate models (`inference/`), of both dry friction
   (`bench/friction.py`) and the range over the motion.
6. `bench/budgets.py` makes rows of a budget of it, `stats/budget.py` sums these to the interval and
   gives the verdict, and `judge/judging.py` makes findings of it.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from inspect import signature
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.base.errors import Change, InputError, OslAnalysisError
from osl_analysis.base.table import read_table
from osl_analysis.base.trial import Trial
from osl_analysis.base.yaml_settings import validated
from osl_analysis.bench import bench_settings as choices
from osl_analysis.bench import calibration
from osl_analysis.bench.belt import belt_curve, belt_table, belt_trial
from osl_analysis.bench.calibration import fixture_column, with_clock_error, with_fixture
from osl_analysis.bench.evidence import (
    UNSTATED,
    DesiredImpedance,
    impedance_table,
)
from osl_analysis.bench.frequency_response import response_table, with_errors
from osl_analysis.bench.impedance import fit_all_groups, rendered_impedance
from osl_analysis.bench.motion import record_of_trial
from osl_analysis.bench.parts_alone import actuator_table, actuator_trial, transmission_table
from osl_analysis.bench.plausibility import computed_torque, gear_told, plausible, speed_alone
from osl_analysis.bench.regression import IMPEDANCE, TRANSMISSION
from osl_analysis.bench.summaries import compensation_table, delay_table, part_summary
from osl_analysis.bench.torque_angle import torque_angle_trial
from osl_analysis.campaign.configuration import Config
from osl_analysis.commands.fit_results import Fit, FitTables, estimated, printed_units, samples_of
from osl_analysis.config.experiments import EXPERIMENTS, PROTOCOL
from osl_analysis.config.sheet import Asked
from osl_analysis.dictionary.described import table_of
from osl_analysis.ingest.guard import (
    check_own_torque,
    check_recording,
    in_other_units,
    swapped_channels,
)
from osl_analysis.ingest.quality import Commanded, measure_quality, saturated
from osl_analysis.judge.judging import judged, marked
from osl_analysis.judge.recording_checks import (
    judged_table,
    measured_table,
)
from osl_analysis.model.compensator import Weight
from osl_analysis.model.drivetrain import (
    NOTHING_STATED,
    FileOrNone,
    known_parameters,
    stated_of_device,
)
from osl_analysis.signals.plateaus import find_leaps
from osl_analysis.stats.budget import LIKELY
from osl_analysis.stats.rounding import estimate_text

FITS_WORSE = 2.0  # times what the best change leaves of the torque, from which one is no remedy
VAF_ROUNDING = 1e-6  # percent of the torque's variance; less is rounding
USUAL_OF_K_D = (0.5, 1.5)  # K over the stated K_d, beyond which a change is no remedy


def fit_impedance_trial(
    trial: Trial,
    parameters: FileOrNone,
    condition: DesiredImpedance | None,
    weight: Weight,
    settings: choices.ImpedanceAnalysis,
    windows: str | None = None,
) -> FitTables:
    """Fit Eq. 15 to a trial, and tell what else its record shows.

    Parameters
    ----------
    trial : Trial
    parameters : Path or None
        The device's file; None for a device without one.
    condition : DesiredImpedance or None
        What the leg was asked to render, as far as it is known.
    weight : Weight
        W of Eq. 14.
    settings : ImpedanceAnalysis
    windows : str or None
        Those of the sheet [s], which are fitted where the motion is no stepped sine.

    """
    check_recording(trial, settings)
    of_joint = trial if settings.fixture is None else with_fixture(trial, settings.fixture)
    clock = trial.provenance.get("clock") or {}
    if clock.get("drift_error") is not None:
        settings = with_clock_error(settings, clock)
    if windows is not None:
        cut, shifted_windows = of_joint.cut_to(windows)
        if is_broken_outside(of_joint, cut, settings.time_base.longest_gap_s):
            of_joint, windows = cut, shifted_windows
    record = record_of_trial(of_joint, settings, windows, extra_columns=("theta_m", "current"))
    analysis = rendered_impedance(record)  # K, B and I, with what this motion tells of them

    # what else the recording tells, and what is to be expected of the device
    check_own_torque(trial)
    p = known_parameters(parameters, ["n_T"])
    stated = condition or UNSTATED
    gains = stated.gains(known_parameters(parameters), weight)
    of_device = stated_of_device(parameters) if stated.controller else NOTHING_STATED
    tables = impedance_table(analysis, p, stated, gains, of_device)
    table = tables["impedance"].with_columns(
        saturated(trial), fixture_column(of_joint), computed_torque(trial), *gear_told(trial, p)
    )

    def others() -> dict[str, pl.DataFrame]:
        return {"response": with_errors(response_table(analysis, settings.at_hz, **vars(stated)))}

    tables = {**tables, "impedance": table}
    return FitTables(tables, samples_of(analysis), record.streams, others)


def is_broken_outside(trial: Trial, cut: Trial, longest_gap_s: float) -> bool:
    """Whether an angle or the torque leaps, or has a long gap, in a part that was cut off a trial.
    The filters would spread a leap into the windows, an angle that slipped there would look like
    backlash, and no time base crosses the gap. A sound trial is filtered whole, since a filter
    needs what lies around the windows."""
    first, last = cut.samples["time"][0], cut.samples["time"][-1]
    for column in {"theta", "theta_m", "torque"} & {*trial.columns}:
        time, values = trial.arrays(column)
        sampled = time[np.isfinite(values)]
        before_gaps = sampled[:-1][np.diff(sampled) > longest_gap_s]
        broken = np.append(find_leaps(time, values), before_gaps)
        if ((broken < first) | (broken >= last)).any():
            return True
    return False


def fit_belt_trial(
    trial: Trial, parameters: FileOrNone, settings: choices.BeltAnalysis
) -> FitTables:
    """The belt's row, and torque against deflection. `parameters` is the device's file, None for
    one without."""
    p = known_parameters(parameters, ["n_T"])
    trial, rails = ready_to_fit(trial, settings)
    belt = belt_trial(trial, p, settings)
    tables = belt_table(belt)
    table = plausible(tables["belt"], rails, p, "K_s")
    # against the deflection
    samples = samples_of(belt, theta_deg=np.rad2deg(belt.sums.columns["theta"]))
    tables = {**tables, "belt": table, "belt_curves": belt_curve(belt)}
    return FitTables(tables, samples, belt.record.streams)


def ready_to_fit(trial: Trial, settings: Any) -> tuple[Trial, pl.Expr]:
    """The trial of the joint without its fixture, and the column of samples at a rail. Raises
    InputError: it cannot be fitted."""
    check_recording(trial, settings)
    check_own_torque(trial)
    rails = saturated(trial)
    return trial if settings.fixture is None else with_fixture(trial, settings.fixture), rails


def fit_transmission_trial(
    trial: Trial, parameters: FileOrNone, settings: choices.SteppedSineAnalysis
) -> FitTables:
    """The transmission's rows, and the series of the fit to all amplitudes."""
    p = known_parameters(parameters, ["B_j", "J_j"])
    trial, rails = ready_to_fit(trial, settings)
    record = record_of_trial(trial, settings, excitation="stepped_sine")
    analysis = fit_all_groups(record, TRANSMISSION)
    tables = transmission_table(analysis)
    table = plausible(tables["transmission"], rails, p, "B_j", "J_j")
    tables = {**tables, "transmission": table.with_columns(fixture_column(trial))}
    return FitTables(tables, samples_of(analysis), record.streams)


def fit_actuator_trial(
    trial: Trial, parameters: FileOrNone, settings: choices.ActuatorAnalysis
) -> FitTables:
    """The row of an actuator alone, and the series of its fit."""
    p = known_parameters(parameters, ["k_tau", "n_m", "f_C", "J_m"])
    check_recording(trial, settings, "torque_m", angle=None)
    check_own_torque(trial, "torque_m", angle=None)
    rails = saturated(trial, "torque_m", "current")
    actuator = actuator_trial(trial, settings)
    tables = actuator_table(actuator)
    table = plausible(tables["actuator"], rails, p, "k_tau_n_m", "f_C", "J_m")
    table = table.with_columns(computed_torque(trial, "torque_m"), speed_alone(trial))
    record = actuator.record
    is_velocity = table["motion"][0] == "omega_m"
    motion = {"omega": record.theta} if is_velocity else {"theta_deg": np.rad2deg(record.theta)}
    tables = {**tables, "actuator": table}
    return FitTables(tables, samples_of(actuator, **motion), record.streams)


def fit_torque_angle_trial(
    trial: Trial, settings: choices.TorqueAngleAnalysis, condition: Mapping[str, Any] | None = None
) -> FitTables:
    """The row of torque against angle, and its curves; `condition` may name the curve that it
    should follow."""
    desired = (condition or {}).get("desired")
    trial, rails = ready_to_fit(trial, settings)
    fit = torque_angle_trial(trial, settings, desired)
    table = fit.table.with_columns(rails, fixture_column(trial), computed_torque(trial))
    tables = {"torque_angle": table, "torque_angle_curves": fit.curves}
    return FitTables(tables, fit.samples, fit.signals.streams)


def fit_calibration_trial(
    trial: Trial, settings: choices.ImpedanceAnalysis, condition: Mapping[str, Any] | None = None
) -> FitTables:
    """What a bench reads of a spring or an inertia that is known, or of its fixture alone;
    `condition` has the columns `known_...` and `fixture`."""
    stated = condition or {}
    uncertainty = (stated.get("known_percent") or 0.0) / 100
    known = None
    stated_fixture = settings.fixture
    if stated.get("fixture"):  # alone, which nothing is taken off
        settings = settings.model_copy(update={"fixture": None})
    else:
        known = calibration.Known(stated.get("known_K"), stated.get("known_I"), uncertainty)
    trial, rails = ready_to_fit(trial, settings)
    record = record_of_trial(trial, settings)
    frame = calibration.measured_frame(trial, record)
    if frame is not None and settings.bench_stiffness is None:  # the spring is behind the frame
        stiffness = calibration.stiffness_to_state(frame)
        settings = settings.model_copy(update={"bench_stiffness": stiffness})
        record = record_of_trial(trial, settings)
    analysis = fit_all_groups(record, IMPEDANCE)
    tables = calibration.calibration_table(analysis, known, frame, stated_fixture)
    table = tables["calibration"].with_columns(rails, fixture_column(trial))
    tables = {**tables, "calibration": table}
    return FitTables(tables, samples_of(analysis), record.streams)


FITS: Mapping[str, Callable[..., FitTables]] = {
    "belt": fit_belt_trial,
    "transmission": fit_transmission_trial,
    "actuator": fit_actuator_trial,
    "impedance": fit_impedance_trial,
    "torque_angle": fit_torque_angle_trial,
    "calibration": fit_calibration_trial,
}
"""The fit of a trial of each experiment on the bench, for rules, command line and notebook."""


@cache
def taken_by(experiment: str) -> Mapping[str, Any]:
    """The parameters of the fit of an experiment."""
    return signature(FITS[experiment]).parameters


def fit_arguments(
    experiment: str,
    config: Config,
    parameters: Path | str | None,
    condition: Any = None,
    windows: str | None = None,
) -> dict[str, Any]:
    """What the fit of an experiment takes, beside a trial, of these: its settings and W of the
    configuration, the device's file, and what the sheet states."""
    facts = EXPERIMENTS[experiment].fit
    assert facts is not None
    stated = {
        "settings": getattr(config, facts.settings),
        "parameters": parameters,
        "condition": condition,
        "weight": config.gain_weight,
        "windows": windows,
    }
    return {name: stated[name] for name in stated if name in taken_by(experiment)}


def derive(table: Path, name: str) -> pl.DataFrame:
    """A table that is computed from another one alone: of controllers beside each other, the delay
    of the bench, or the summary of a part of the drivetrain over its trials."""
    rows = read_table(table)
    if name == "compensation":
        return compensation_table(rows)
    if name.endswith("delay"):
        return delay_table(rows, name)
    return part_summary(table.stem, rows)


def run_fit(
    experiment: str,
    trial: Trial,
    parameters: Path | None,
    config: Config,
    condition: Any = None,
    windows: str | None = None,
) -> FitTables:
    """Run the fit of an experiment on a trial, as the job of a campaign does.

    Parameters
    ----------
    experiment : str
    trial : Trial
    parameters : Path or None
        The device's file; None for a device without one.
    config : Config
        Whose sections are the settings of the job.
    condition : DesiredImpedance or Mapping or None
        What the sheet states; a mapping has its cells by column.
    windows : str or None
        Those of the sheet [s].

    Raises
    ------
    InputError
        The experiment has no fit, the sheet would not take what is stated, or the recording cannot
        be fitted.
    """
    facts = EXPERIMENTS[experiment].fit
    if facts is None:
        raise InputError(
            f"a trial of '{experiment}' is not fitted alone", "choose another experiment for it"
        )
    if facts.sheet:
        stated = DesiredImpedance if experiment == "impedance" else Mapping
        if not isinstance(condition, stated | None):
            raise InputError(
                f"desired: {condition!r} is no desired impedance",
                "give osl.DesiredImpedance(controller, K_d, B_d)",
            )
    asked = vars(condition) if isinstance(condition, DesiredImpedance) else {}
    if windows is not None or asked != vars(UNSTATED):
        validated({**asked, "windows": windows}, Asked, f"trial {trial.name}", ())
    if windows and not facts.windows:
        trial = trial.within(windows)
    arguments = fit_arguments(experiment, config, parameters, condition, windows)
    return fit_or_advise(FITS[experiment], trial, **arguments)


def fit_trial(
    experiment: str,
    trial: Trial,
    parameters: Path | None,
    config: Config,
    condition: Any = None,
    windows: str | None = None,
) -> Fit:
    """Fit a trial and judge it; arguments and errors as `run_fit`."""
    tables = run_fit(experiment, trial, parameters, config, condition, windows)
    name = EXPERIMENTS[experiment].tables[0].name
    table = tables.estimates[name]
    budget = tables.estimates.get("budget")
    findings = judged(table, config.doubtful.of(name), name, budget=budget)
    curves = (table for name, table in tables.estimates.items() if name.endswith("_curves"))
    of_model = tables.samples.filter(pl.col("torque_model").is_finite())
    series = of_model.select(pl.col("time") - pl.col("time").first(), "torque", "torque_model")
    return Fit(
        experiment=experiment,
        table=marked(table, findings, name),
        series=series,
        curves=next(curves, None),
        estimate_findings=findings,
        budget=budget,
        recording_checks=partial(checks_of, experiment, trial, config, windows or ""),
    )


def checks_of(experiment: str, trial: Trial, config: Config, windows: str = "") -> pl.DataFrame:
    """The checks of a recording, a row each, as in `quality.csv`."""
    commanded = Commanded(
        **{name: getattr(config.dynamometer, name) for name in PROTOCOL},
        longest_gap_s=config.dynamometer.time_base.longest_gap_s,
        clusters=config.walking.markers.clusters,
    )
    measured = measure_quality(trial, experiment, commanded, windows)
    return judged_table(measured_table(trial.name, measured), config.quality, {})


# What may mend a recording whose fit is refused, by a wrong sign, unit or channel: the error names
# the changes of the source file that may mend it (`errors.Change`). They are tried on the
# recording: those with which the trial can be fitted become its remedy.


@dataclass(frozen=True)
class Outcome:
    """A change, and the row that the fit to all data then has."""

    change: Change
    row: Mapping[str, Any]
    fault_probability: float = 0.0  # of the recording

    @property
    def unexplained(self) -> float:
        """What the fit leaves of the torque's variance [percent]."""
        return max(100.0 - float(self.row["VAF"]), VAF_ROUNDING)

    @property
    def text(self) -> str:
        """What to do, and the first estimate that it gives."""
        name = estimated(self.row)[0]
        return (
            f"{self.change.words}: {name} {estimate_text(self.row, name)} {printed_units()[name]}"
        )


def fit_or_advise(fit: Callable[..., FitTables], trial: Trial, **arguments: Any) -> FitTables:
    """Fit a trial; where it is refused, try the changes that the error names.

    Parameters
    ----------
    fit : callable
        The job of an experiment.
    trial : Trial
    **arguments
        Its other arguments, by name.

    Raises
    ------
    OslAnalysisError
        The fit is refused. Its remedy is what makes the trial fit, where a change does.
    """
    try:
        tables = fit(trial=trial, **arguments)
        if not is_possible(tables.row):
            check_not_swapped(fit, trial, arguments, tables)
    except OslAnalysisError as error:
        helpful = diagnose(fit, trial, arguments, error.changes)
        if not helpful:
            raise
        remedy = "; or ".join(outcome.text for outcome in helpful)
        raise type(error)(error.reason, remedy) from error
    return tables


def check_not_swapped(
    fit: Callable[..., FitTables], trial: Trial, arguments: Mapping[str, Any], tables: FitTables
) -> None:
    """Refuse estimates that no joint has, with InputError, if angle and torque explain each other
    much better in exchanged channels, and without a fault. A late torque makes B negative, too, and
    is late in exchanged channels as well."""
    row = tables.row
    if not {"theta", "torque"} <= set(trial.columns):
        return
    changes = swapped_channels(trial, "theta", "torque")
    least = math.inf
    for outcome in diagnose(fit, trial, arguments, changes):
        if outcome.fault_probability < LIKELY:
            least = min(least, outcome.unexplained)
    if FITS_WORSE * least < Outcome(changes[0], row).unexplained:
        name = "B" if (row.get("B_high") or 0.0) < 0 else estimated(row)[0]
        raise InputError(
            f"trial {trial.name}: {name} = {row[name]:.3g} {printed_units()[name]}, which no"
            " joint has, and angle and torque explain each other better if they are exchanged",
            "swap their channels in the source file",
            changes=changes,
        )


def diagnose(
    fit: Callable[..., FitTables],
    trial: Trial,
    arguments: Mapping[str, Any],
    changes: Sequence[Change],
) -> list[Outcome]:
    """Try sign, unit and swapped channels of a refused trial.

    The changes of the lowest rank are returned with which it can be fitted to possible estimates,
    and about as well as with the best of them."""
    expanded = []
    for change in changes:
        column = change.other_unit_of
        expanded += in_other_units(trial, [column]) if column else [change]
    expanded.sort(key=lambda change: change.rank)
    for _, of_rank in groupby(expanded, key=lambda change: change.rank):
        outcomes = [outcome_of(fit, trial, arguments, change) for change in of_rank]
        possible = [outcome for outcome in outcomes if outcome and is_possible(outcome.row)]
        if possible:
            most = FITS_WORSE * min(outcome.unexplained for outcome in possible)
            return [outcome for outcome in possible if outcome.unexplained <= most]
    return []


def outcome_of(
    fit: Callable[..., FitTables], trial: Trial, arguments: Mapping[str, Any], change: Change
) -> Outcome | None:
    """What the fit gives with a change; None where it is refused."""
    try:
        tables = fit(trial=changed(trial, change), **arguments)
    except OslAnalysisError:
        return None
    budget = tables.estimates.get("budget", table_of([], "budget"))
    faults = budget.filter(estimate="K", part="fault").drop_nulls("standard")
    weighed = faults.filter(basis="weighed")["probability"]
    # where none was weighed, a fault is not ruled out
    return Outcome(change, tables.row, float(weighed.sum()) if len(faults) else 1.0)


def changed(trial: Trial, change: Change) -> Trial:
    """The recording with columns that are renamed, or multiplied by a factor."""
    samples = trial.samples.rename(dict(change.renamed))
    samples = samples.with_columns(pl.col(name) * by for name, by in change.factors.items())
    return replace(trial, samples=samples, clocks={})


def is_possible(row: Mapping[str, Any]) -> bool:
    """Whether a fit gives what a joint can have: a stiffness that is told from 0 and near a stated
    K_d, and no negative damping."""
    first = estimated(row)[0]
    low = row.get(f"{first}_low")
    if first in ("K", "K_s") and low is not None and low <= 0:
        return False
    if (row.get("B_high") or 0.0) < 0:
        return False
    of_K_d = row.get("K_over_K_d")
    return of_K_d is None or USUAL_OF_K_D[0] <= of_K_d <= USUAL_OF_K_D[1]
