"""Jobs of the benches: read trials and tables, call the experiment in `bench/`, write its tables."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import polars as pl

from osl_analysis.bench.actuator import (
    actuator_series,
    actuator_summary,
    actuator_table,
    actuator_time_base,
    actuator_trial,
)
from osl_analysis.bench.belt import belt_curve, belt_series, belt_summary, belt_table, belt_time_base, belt_trial
from osl_analysis.bench.impedance import DesiredImpedance
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
from osl_analysis.bench.plausibility import (
    check_recording,
    plausible_actuator,
    plausible_belt,
    plausible_transmission,
    saturated,
)
from osl_analysis.bench.rendered import (
    AskedImpedance,
    judged_impedance,
    rendered_phasors,
    rendered_response,
    rendered_series,
    rendered_time_base,
    rendered_trial,
    repeated_trials_table,
    sines_of,
)
from osl_analysis.bench.settings import ActuatorAnalysis, BeltAnalysis, ImpedanceAnalysis, SteppedSineAnalysis
from osl_analysis.bench.stepped_sine import stepped_sine_trial
from osl_analysis.bench.transmission import (
    transmission_series,
    transmission_summary,
    transmission_table,
    transmission_time_base,
)
from osl_analysis.errors import InputError
from osl_analysis.model.gain_selection import Weight
from osl_analysis.parameters import FileOrNone, known_parameters, read_parameters
from osl_analysis.table import read_table, write_table
from osl_analysis.trial import read_trial


def fit_belt_trial(trial: Path, parameters: FileOrNone, settings: BeltAnalysis, tables: Mapping[str, Path]) -> None:
    """Fit one belt trial: its rows of the tables `belt` and `belt_curves` (torque against deflection)."""
    read, p = read_trial(trial), known_parameters(parameters)
    check_recording(read, settings)
    rails = saturated(read, "torque", "theta")
    belt = belt_trial(read, p, settings)
    write_table(plausible_belt(belt_table(belt), rails, p), tables["belt"])
    write_table(belt_curve(belt), tables["belt_curves"])
    write_table(belt_time_base(belt), tables["timebase"])
    write_table(belt_series(belt).table(), tables["series"])


def fit_transmission_trial(
    trial: Path, parameters: FileOrNone, settings: SteppedSineAnalysis, tables: Mapping[str, Path]
) -> None:
    """Fit one transmission trial: its rows of the table `transmission`."""
    read = read_trial(trial)
    check_recording(read, settings)
    rails = saturated(read, "torque", "theta")
    stepped = stepped_sine_trial(read, settings)
    table = plausible_transmission(transmission_table(stepped), rails, known_parameters(parameters))
    write_table(table, tables["transmission"])
    write_table(transmission_time_base(stepped), tables["timebase"])
    write_table(transmission_series(stepped).table(), tables["series"])


def fit_impedance_trial(
    trial: Path,
    parameters: FileOrNone,
    condition: DesiredImpedance,
    weight: Weight,
    settings: ImpedanceAnalysis,
    tables: Mapping[str, Path],
    windows: str | None = None,
) -> None:
    """Fit one impedance trial: its rows of the tables `impedance`, `phasors`, `response` and its models.

    `parameters` is the file of the device, None for one without, here as in all these jobs. `condition` is the desired
    impedance of the trial, as far as it is known. `weight` is W of Eq. 14 with which its gains were selected.
    `windows` [s] are those of the sheet, which are fitted where the motion is no stepped sine.
    """
    p, read = known_parameters(parameters), read_trial(trial)
    check_recording(read, settings)
    rails = saturated(read, "torque", "theta")
    rendered = rendered_trial(read, settings, windows)
    asked = AskedImpedance(condition, weight, settings.frequencies_hz)
    phasors = sines_of(rendered)
    write_table(judged_impedance(rendered, rails, p, asked, phasors), tables["impedance"])
    write_table(rendered_phasors(rendered, phasors).with_columns(**condition.columns()), tables["phasors"])
    for name, frame in rendered_response(rendered, p).frames().items():
        write_table(frame.with_columns(**condition.columns()), tables[name])
    write_table(rendered_time_base(rendered), tables["timebase"])
    write_table(rendered_series(rendered).table(), tables["series"])


def fit_actuator_trial(
    trial: Path, parameters: FileOrNone, settings: ActuatorAnalysis, tables: Mapping[str, Path]
) -> None:
    """Fit one trial of the actuator's bench: its row of the table `actuator`."""
    read = read_trial(trial)
    check_recording(read, settings, "torque_m", angle=None)
    rails = saturated(read, "torque_m", "current")
    actuator = actuator_trial(read, settings)
    table = plausible_actuator(actuator_table(actuator), rails, known_parameters(parameters))
    write_table(table, tables["actuator"])
    write_table(actuator_time_base(actuator), tables["timebase"])
    write_table(actuator_series(actuator).table(), tables["series"])


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
    stepped = [stepped_sine_trial(read_trial(path), settings) for path in trials]
    write_table(transmission_scores(stepped, sign_width), output)


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
    p, rendered = read_parameters(parameters), rendered_trial(read_trial(trial), settings, windows)
    gains = condition.gains(p, weight)
    if gains is None:
        raise InputError(f"trial {trial.stem}: {condition.unknown_gains()}; Eq. 9 needs the gains of the controller")
    write_table(impedance_scores(drivetrain_of(rendered, gains, p, sign_width), condition.controller), output)
