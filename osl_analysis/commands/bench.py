"""The fits of bench trials, which give their tables at every door, and the jobs of the benches, which write tables."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.bench.actuator import (
    actuator_series,
    actuator_summary,
    actuator_table,
    actuator_time_base,
    actuator_trial,
)
from osl_analysis.bench.analysis import FitTables
from osl_analysis.bench.belt import belt_curve, belt_series, belt_summary, belt_table, belt_time_base, belt_trial
from osl_analysis.bench.impedance import (
    QUANTITIES,
    AskedImpedance,
    DesiredImpedance,
    judged_impedance,
    rendered_phasors,
    rendered_response,
    repeated_trials_table,
)
from osl_analysis.bench.model_comparison import (
    PLACE,
    SCORE_COLUMNS,
    belt_scores,
    comparison_summary,
    drivetrain_of,
    impedance_scores,
    transmission_scores,
)
from osl_analysis.bench.phasors import frequency_response_table
from osl_analysis.bench.record import record_of_trial, sine_record
from osl_analysis.bench.settings import (
    ActuatorAnalysis,
    BeltAnalysis,
    ImpedanceAnalysis,
    SteppedSineAnalysis,
    TorqueAngleAnalysis,
)
from osl_analysis.bench.torque_angle import torque_angle_trial
from osl_analysis.bench.torque_angle_tables import curve_table, cycle_table, torque_angle_table, torque_angle_time_base
from osl_analysis.bench.transmission import LOSSES, transmission_of, transmission_summary, transmission_table
from osl_analysis.errors import InputError
from osl_analysis.judge.impossible import (
    check_recording,
    plausible_actuator,
    plausible_belt,
    plausible_transmission,
    saturated,
)
from osl_analysis.model.gain_selection import Weight
from osl_analysis.parameters import FileOrNone, known_parameters, read_parameters
from osl_analysis.table import read_table, write_table
from osl_analysis.trial import Trial, read_trial


def fit_belt_trial(trial: Trial, parameters: FileOrNone, settings: BeltAnalysis) -> Mapping[str, pl.DataFrame]:
    """The belt's row, and torque against deflection.

    `parameters` is the file of the device, None for one without, here as in all these fits.
    """
    p = known_parameters(parameters)
    check_recording(trial, settings)
    rails = saturated(trial, "torque", "theta")
    belt = belt_trial(trial, p, settings)
    return FitTables(
        belt_series(belt),
        lambda: {"timebase": belt_time_base(belt)},
        belt=plausible_belt(belt_table(belt), rails, p),
        belt_curves=belt_curve(belt),
    )


def fit_transmission_trial(
    trial: Trial, parameters: FileOrNone, settings: SteppedSineAnalysis
) -> Mapping[str, pl.DataFrame]:
    """The transmission's rows, and the series of the fit to all amplitudes."""
    p = known_parameters(parameters)
    check_recording(trial, settings)
    rails = saturated(trial, "torque", "theta")
    analysis = transmission_of(sine_record(trial, settings))
    table = plausible_transmission(transmission_table(analysis), rails, p)
    return FitTables(analysis.series(), lambda: {"timebase": analysis.time_base(LOSSES)}, transmission=table)


def fit_impedance_trial(
    trial: Trial,
    parameters: FileOrNone,
    condition: DesiredImpedance | None,
    weight: Weight,
    settings: ImpedanceAnalysis,
    windows: str | None = None,
) -> Mapping[str, pl.DataFrame]:
    """The rows of Eq. 15, and the series of the fit to all amplitudes.

    `condition` is what the leg was asked to render, as far as it is known, and `weight` W of Eq. 14. `windows` [s] are
    those of the sheet, which are fitted where the motion is no stepped sine.
    """
    p = known_parameters(parameters)
    asked = None if condition is None else AskedImpedance(condition, weight, settings.frequencies_hz)
    check_recording(trial, settings)
    rails = saturated(trial, "torque", "theta")
    rendered, table = judged_impedance(record_of_trial(trial, settings, windows), rails, p, asked)
    stated = condition.columns() if condition else {}

    def further() -> dict[str, pl.DataFrame]:
        frames = {"phasors": rendered_phasors(rendered), **rendered_response(rendered.record, p).frames()}
        of_condition = {name: frame.with_columns(**stated) for name, frame in frames.items()}
        return of_condition | {"timebase": rendered.analysis.time_base(QUANTITIES)}

    return FitTables(rendered.analysis.series(), further, impedance=table)


def fit_actuator_trial(trial: Trial, parameters: FileOrNone, settings: ActuatorAnalysis) -> Mapping[str, pl.DataFrame]:
    """The actuator's row."""
    p = known_parameters(parameters)
    check_recording(trial, settings, "torque_m", angle=None)
    rails = saturated(trial, "torque_m", "current")
    actuator = actuator_trial(trial, settings)
    table = plausible_actuator(actuator_table(actuator), rails, p)
    return FitTables(actuator_series(actuator), lambda: {"timebase": actuator_time_base(actuator)}, actuator=table)


def fit_torque_angle_trial(
    trial: Trial, settings: TorqueAngleAnalysis, condition: Mapping[str, Any] | None = None
) -> Mapping[str, pl.DataFrame]:
    """The row of torque against angle, and its curves; `condition` may name the curve that it should follow."""
    desired = (condition or {}).get("desired")
    check_recording(trial, settings)
    rails = saturated(trial, "torque", "theta")
    found = torque_angle_trial(trial, settings)
    return FitTables(
        found.series(),
        lambda: {"torque_angle_cycles": cycle_table(found), "timebase": torque_angle_time_base(found)},
        torque_angle=rails.beside(torque_angle_table(found, desired)),
        torque_angle_curves=curve_table(found, desired),
    )


def by_place(table: pl.DataFrame, summary: Callable[[pl.DataFrame], pl.DataFrame]) -> pl.DataFrame:
    """The summary of each joint and side on its own, one below the other, with columns that name them."""
    if not set(PLACE) <= set(table.columns):
        return summary(table)
    parts = table.partition_by(PLACE, maintain_order=True)
    found = [(part.select(PLACE).row(0, named=True), summary(part)) for part in parts]
    named = [
        one.select([pl.lit(v, pl.String).alias(name) for name, v in place.items()] + [pl.all()]) for place, one in found
    ]
    return pl.concat(named, how="vertical_relaxed")


def summarise_belt(table: Path, output: Path) -> None:
    """Mean, scatter and interval over the trials of `belt.csv`."""
    write_table(by_place(read_table(table), belt_summary), output)


def summarise_transmission(table: Path, output: Path) -> None:
    """Mean, scatter and interval over the trials of `transmission.csv`."""
    write_table(by_place(read_table(table), transmission_summary), output)


def summarise_actuator(table: Path, output: Path) -> None:
    """Mean, scatter and interval over the trials of `actuator.csv`."""
    write_table(by_place(read_table(table), actuator_summary), output)


def summarise_model_comparison(table: Path, output: Path) -> None:
    """Standing of the rival models over the trials of `model_comparison.csv`."""
    write_table(comparison_summary(read_table(table, required=SCORE_COLUMNS)), output)


def average_over_trials(table: Path, output: Path) -> None:
    """K, B and I over the trials of each condition of `impedance.csv` that has several."""
    write_table(repeated_trials_table(read_table(table, ["amplitude_deg", "doubtful"])), output)


def average_over_amplitudes(table: Path, output: Path) -> None:
    """Frequency response of every trial: Y averaged over the amplitudes of `phasors.csv`."""
    write_table(frequency_response_table(read_table(table, ["amplitude_deg", "doubtful"])), output)


def compare_belt_models(trials: Sequence[Path], parameters: FileOrNone, settings: BeltAnalysis, output: Path) -> None:
    """Rival models of the belt on each trial, predicted by fits to all the others."""
    p = known_parameters(parameters)
    write_table(belt_scores([belt_trial(read_trial(path), p, settings) for path in trials]), output)


def compare_transmission_models(
    trials: Sequence[Path], settings: SteppedSineAnalysis, sign_width: float, output: Path
) -> None:
    """Rival models of the transmission on each trial, predicted by fits to all the others."""
    records = [sine_record(read_trial(path), settings) for path in trials]
    write_table(transmission_scores(records, sign_width), output)


def compare_impedance_models(
    trial: Path,
    parameters: Path,
    condition: DesiredImpedance,
    weight: Weight,
    settings: ImpedanceAnalysis,
    sign_width: float,
    output: Path,
    windows: str | None = None,
) -> None:
    """Eq. 15 and the drivetrain of Eq. 9 on one trial, each amplitude predicted from the others.

    A motion that is no stepped sine has consecutive parts in place of amplitudes. `condition`, `weight` and `windows`
    as in `fit_impedance_trial`; the drivetrain smooths the sign of the velocity over
    `sign_width` [rad/s].
    """
    p, record = read_parameters(parameters), record_of_trial(read_trial(trial), settings, windows)
    gains = condition.gains(p, weight)
    if gains is None:
        raise InputError(f"trial {trial.stem}: {condition.unknown_gains()}; Eq. 9 needs the gains of the controller")
    write_table(impedance_scores(drivetrain_of(record, gains, p, sign_width), condition.controller), output)
