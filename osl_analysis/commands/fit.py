# SPDX-License-Identifier: Apache-2.0
"""Fit a trial: the jobs of rule `fit`, one per experiment, and the same fits for the command line
and notebooks.

From the rule to K, in the order in which a maintainer reads:

1. `rules/bench.smk`, rule `fit`: `job(fit_trial_of_impedance, ...)`.
2. Here, `fit_trial_of_impedance` reads a trial and writes its tables.
3. Here, `fit_impedance_trial`: check, record, fit, weigh.
4. `bench/impedance.py`, `rendered_impedance`, `fit_all_groups`: Eq. 15 for each amplitude, and for
   all.
5. `bench/regression.py`, `least_squares`: the normal equations A x = b of the groups' sums, which
   `stats/linear_fit.py`, `solved`, solves. K is x[0].

`commands/trials.py` makes trials of recordings. `bench/budgets.py`, `stats/budget.py` and
`judge/judging.py` make intervals and verdicts.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.base.errors import InputError
from osl_analysis.base.table import OUTCOME, read_table, write_tables
from osl_analysis.base.trial import Trial, read_trial
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
from osl_analysis.commands.fit_results import Fit, FitTables, samples_of
from osl_analysis.commands.tried_changes import tries_changes
from osl_analysis.config.experiments import EXPERIMENTS, PROTOCOL
from osl_analysis.config.sheet import Asked
from osl_analysis.dictionary.described import columns_of_trial
from osl_analysis.ingest.guard import check_own_torque, check_recording
from osl_analysis.ingest.quality import Commanded, measure_quality, saturated
from osl_analysis.judge.findings import read_findings
from osl_analysis.judge.joining import findings_of_rows, joined, with_texts
from osl_analysis.judge.judging import judged
from osl_analysis.judge.recording_checks import (
    judged_table,
    measured_table,
)
from osl_analysis.model.compensator import Weight
from osl_analysis.model.drivetrain import (
    NOTHING_STATED,
    known_parameters,
    stated_of_device,
)
from osl_analysis.signals.plateaus import find_leaps


@dataclass(frozen=True)
class FitOutputs:
    """The files that the job of a fit writes."""

    estimates: Path  # the first table of the experiment
    secondary_tables: Path  # an archive of its other tables
    data: str  # whether the recordings are simulated or measured

    def write(self, experiment: str, fit: FitTables) -> None:
        """Write all tables of a fit, in the order of the experiment's."""
        tables = fit.everything()
        first, *further = [table.name for table in EXPERIMENTS[experiment].tables]
        by_place = {self.secondary_tables / f"{name}.csv": tables[name] for name in further}
        estimates = tables[first].with_columns(**OUTCOME)
        by_place[self.estimates] = estimates.select(columns_of_trial(first))
        write_tables(by_place, self.data)


# Each experiment: the job of rule `fit`, and the fit that it, the command line and notebooks call.
# `parameters` is the device's file, None for a device without one.


def fit_trial_of_impedance(
    trial: Path,
    parameters: Path | None,
    desired: DesiredImpedance,
    weight: Weight,
    settings: choices.ImpedanceAnalysis,
    windows: str | None,
    outputs: FitOutputs,
) -> None:
    """Read a trial, fit Eq. 15, and write its tables."""
    recorded = read_trial(trial)
    fit = fit_impedance_trial(recorded, parameters, desired, weight, settings, windows)
    outputs.write("impedance", fit)


@tries_changes
def fit_impedance_trial(
    trial: Trial,
    parameters: Path | None,
    desired: DesiredImpedance,
    weight: Weight,
    settings: choices.ImpedanceAnalysis,
    windows: str | None = None,
) -> FitTables:
    """Fit Eq. 15 to a trial, and weigh other explanations of its torque.

    Parameters
    ----------
    trial : Trial
    parameters : Path or None
    desired : DesiredImpedance
        The impedance that the leg was asked to render, as far as it is known.
    weight : Weight
        W of Eq. 14, with which the gains were selected.
    settings : ImpedanceAnalysis
    windows : str or None
        Windows of the sheet [s]; they are fitted where the motion is no stepped sine.

    Raises
    ------
    InputError
        The recording cannot be fitted, or is of another kind than the sheet says.
    IdentifiabilityError
        The motion cannot tell K, B and I.
    """
    # check
    joint_trial = check_and_remove_fixture(trial, settings)
    clock = trial.provenance.get("clock") or {}
    if clock.get("drift_error") is not None:
        settings = with_clock_error(settings, clock)
    if windows is not None:
        cut, shifted_windows = joint_trial.cut_to(windows)
        if is_broken_outside(joint_trial, cut, settings.time_base.longest_gap_s):
            joint_trial, windows = cut, shifted_windows

    # record
    record = record_of_trial(joint_trial, settings, windows, extra_columns=("theta_m", "current"))

    # fit
    analysis = rendered_impedance(record)

    # weigh, with what the device should give
    p = known_parameters(parameters, ["n_T"])
    gains = desired.gains(known_parameters(parameters), weight)
    device = stated_of_device(parameters) if desired.controller else NOTHING_STATED
    tables = impedance_table(analysis, p, desired, gains, device)
    table = tables["impedance"].with_columns(
        saturated(trial),
        fixture_column(joint_trial),
        computed_torque(trial),
        *gear_told(trial, p),
    )

    def response() -> dict[str, pl.DataFrame]:
        points = response_table(analysis, settings.at_hz, **vars(desired))
        return {"response": with_errors(points)}

    tables = {**tables, "impedance": table}
    return FitTables(tables, samples_of(analysis), record.streams, response)


def check_and_remove_fixture(trial: Trial, settings: choices.BenchAnalysis) -> Trial:
    """The trial of the joint without its fixture. Raises InputError: it cannot be fitted."""
    check_recording(trial, settings)
    check_own_torque(trial)
    return trial if settings.fixture is None else with_fixture(trial, settings.fixture)


def is_broken_outside(trial: Trial, cut: Trial, longest_gap_s: float) -> bool:
    """Whether an angle or the torque leaps, or has a long gap, in a part that was cut off a trial.

    The filters would spread a leap into the windows. An angle that slipped there would look like
    backlash, and no time base crosses the gap. A sound trial is filtered whole: a filter needs the
    samples around the windows.
    """
    first, last = cut.samples["time"][0], cut.samples["time"][-1]
    for column in {"theta", "theta_m", "torque"} & {*trial.columns}:
        time, values = trial.arrays(column)
        sampled = time[np.isfinite(values)]
        before_gaps = sampled[:-1][np.diff(sampled) > longest_gap_s]
        broken = np.append(find_leaps(time, values), before_gaps)
        if ((broken < first) | (broken >= last)).any():
            return True
    return False


def fit_trial_of_belt(
    trial: Path, parameters: Path | None, settings: choices.BeltAnalysis, outputs: FitOutputs
) -> None:
    """Read a trial, fit the belt, and write its tables."""
    outputs.write("belt", fit_belt_trial(read_trial(trial), parameters, settings))


@tries_changes
def fit_belt_trial(
    trial: Trial, parameters: Path | None, settings: choices.BeltAnalysis
) -> FitTables:
    """The belt's row, and torque against deflection."""
    p = known_parameters(parameters, ["n_T"])
    joint_trial = check_and_remove_fixture(trial, settings)
    belt = belt_trial(joint_trial, p, settings)
    tables = belt_table(belt)
    table = plausible(tables["belt"], saturated(trial), p, "K_s")
    # against the deflection
    samples = samples_of(belt, theta_deg=np.rad2deg(belt.sums.columns["theta"]))
    tables = {**tables, "belt": table, "belt_curves": belt_curve(belt)}
    return FitTables(tables, samples, belt.record.streams)


def fit_trial_of_transmission(
    trial: Path,
    parameters: Path | None,
    settings: choices.SteppedSineAnalysis,
    outputs: FitOutputs,
) -> None:
    """Read a trial, fit the transmission, and write its tables."""
    outputs.write("transmission", fit_transmission_trial(read_trial(trial), parameters, settings))


@tries_changes
def fit_transmission_trial(
    trial: Trial, parameters: Path | None, settings: choices.SteppedSineAnalysis
) -> FitTables:
    """The transmission's rows, and the series of the fit to all amplitudes."""
    p = known_parameters(parameters, ["B_j", "J_j"])
    joint_trial = check_and_remove_fixture(trial, settings)
    record = record_of_trial(joint_trial, settings, excitation="stepped_sine")
    analysis = fit_all_groups(record, TRANSMISSION)
    tables = transmission_table(analysis)
    table = plausible(tables["transmission"], saturated(trial), p, "B_j", "J_j")
    tables = {**tables, "transmission": table.with_columns(fixture_column(joint_trial))}
    return FitTables(tables, samples_of(analysis), record.streams)


def fit_trial_of_actuator(
    trial: Path, parameters: Path | None, settings: choices.ActuatorAnalysis, outputs: FitOutputs
) -> None:
    """Read a trial, fit the actuator alone, and write its tables."""
    outputs.write("actuator", fit_actuator_trial(read_trial(trial), parameters, settings))


@tries_changes
def fit_actuator_trial(
    trial: Trial, parameters: Path | None, settings: choices.ActuatorAnalysis
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


def fit_trial_of_torque_angle(
    trial: Path, settings: choices.TorqueAngleAnalysis, desired: str | None, outputs: FitOutputs
) -> None:
    """Read a trial, fit torque against angle, and write its tables."""
    outputs.write("torque_angle", fit_torque_angle_trial(read_trial(trial), settings, desired))


@tries_changes
def fit_torque_angle_trial(
    trial: Trial, settings: choices.TorqueAngleAnalysis, desired: str | None = None
) -> FitTables:
    """The row of torque against angle, and its curves; `desired` names the curve of the settings
    that it should follow."""
    joint_trial = check_and_remove_fixture(trial, settings)
    fit = torque_angle_trial(joint_trial, settings, desired)
    table = fit.table.with_columns(
        saturated(trial), fixture_column(joint_trial), computed_torque(joint_trial)
    )
    tables = {"torque_angle": table, "torque_angle_curves": fit.curves}
    return FitTables(tables, fit.samples, fit.signals.streams)


def fit_trial_of_calibration(
    trial: Path,
    settings: choices.ImpedanceAnalysis,
    sheet_cells: Mapping[str, Any],
    outputs: FitOutputs,
) -> None:
    """Read a trial, fit a known spring or inertia, and write its tables."""
    outputs.write("calibration", fit_calibration_trial(read_trial(trial), settings, sheet_cells))


@tries_changes
def fit_calibration_trial(
    trial: Trial, settings: choices.ImpedanceAnalysis, sheet_cells: Mapping[str, Any]
) -> FitTables:
    """The rows of a bench with a known spring or inertia, or with its fixture alone.

    `sheet_cells` has the cells `known_...` and `fixture` of the sheet.
    """
    uncertainty = (sheet_cells.get("known_percent") or 0.0) / 100
    known = None
    stated_fixture = settings.fixture
    if sheet_cells.get("fixture"):  # the fixture itself is measured, so that it is not taken off
        settings = settings.model_copy(update={"fixture": None})
    else:
        known = calibration.Known(
            sheet_cells.get("known_K"), sheet_cells.get("known_I"), uncertainty
        )
    joint_trial = check_and_remove_fixture(trial, settings)
    record = record_of_trial(joint_trial, settings)
    frame = calibration.measured_frame(joint_trial, record)
    if frame is not None and settings.bench_stiffness is None:  # the spring is behind the frame
        stiffness = calibration.stiffness_to_state(frame)
        settings = settings.model_copy(update={"bench_stiffness": stiffness})
        record = record_of_trial(joint_trial, settings)
    analysis = fit_all_groups(record, IMPEDANCE)
    tables = calibration.calibration_table(analysis, known, frame, stated_fixture)
    table = tables["calibration"].with_columns(saturated(trial), fixture_column(joint_trial))
    tables = {**tables, "calibration": table}
    return FitTables(tables, samples_of(analysis), record.streams)


def derive(table: Path, name: str, findings: Sequence[Path] = ()) -> pl.DataFrame:
    """A table that is computed from one other table.

    It compares controllers, has the delay of the bench, or sums up a part of the drivetrain over
    its trials. No mean has estimates that are doubtful by the `findings` on the rows.
    """
    rows = joined(read_table(table), table.stem, read_findings(findings))
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
    """Fit a trial of an experiment that is named by the user, as the job of a campaign does.

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
        allowed_type = DesiredImpedance if experiment == "impedance" else Mapping
        if not isinstance(condition, allowed_type | None):
            raise InputError(
                f"desired: {condition!r} is no desired impedance",
                "give osl.DesiredImpedance(controller, K_d, B_d)",
            )
    asked = vars(condition) if isinstance(condition, DesiredImpedance) else {}
    if windows is not None or asked != vars(UNSTATED):
        validated({**asked, "windows": windows}, Asked, f"trial {trial.name}", ())
    if windows and not facts.windows:
        trial = trial.within(windows)
    if experiment == "impedance":
        desired = condition or UNSTATED
        settings = config.dynamometer
        return fit_impedance_trial(
            trial, parameters, desired, config.gain_weight, settings, windows
        )
    if experiment == "belt":
        return fit_belt_trial(trial, parameters, config.dynamometer)
    if experiment == "transmission":
        return fit_transmission_trial(trial, parameters, config.dynamometer)
    if experiment == "actuator":
        return fit_actuator_trial(trial, parameters, config.actuator)
    if experiment == "torque_angle":
        curve = (condition or {}).get("desired")
        return fit_torque_angle_trial(trial, config.torque_angle, curve)
    if experiment == "calibration":
        return fit_calibration_trial(trial, config.dynamometer, condition or {})
    raise NotImplementedError(f"no fit of {experiment} here: rules/bench.smk names its job")


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
    about_rows = findings_of_rows(table, chain(*findings))
    curves = (table for name, table in tables.estimates.items() if name.endswith("_curves"))
    modelled = tables.samples.filter(pl.col("torque_model").is_finite())
    series = modelled.select(pl.col("time") - pl.col("time").first(), "torque", "torque_model")
    return Fit(
        experiment=experiment,
        table=with_texts(table, about_rows, name),
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
