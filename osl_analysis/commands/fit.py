"""One trial fitted for the command line: the estimates, and the torque beside the fitted model's."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import polars as pl

from osl_analysis.bench.actuator import actuator_series, actuator_table, actuator_trial
from osl_analysis.bench.belt import belt_curve, belt_series, belt_table, belt_trial
from osl_analysis.bench.impedance import DesiredImpedance
from osl_analysis.bench.plausibility import (
    check_recording,
    plausible_actuator,
    plausible_belt,
    plausible_transmission,
    saturated,
)
from osl_analysis.bench.rendered import AskedImpedance, judged_impedance, rendered_series, rendered_trial
from osl_analysis.bench.series import Series
from osl_analysis.bench.settings import (
    ActuatorAnalysis,
    BeltAnalysis,
    DynamometerAnalysis,
    ImpedanceAnalysis,
    SteppedSineAnalysis,
    TorqueAngleAnalysis,
)
from osl_analysis.bench.stepped_sine import stepped_sine_trial
from osl_analysis.bench.torque_angle import torque_angle_trial
from osl_analysis.bench.torque_angle_tables import curve_table, torque_angle_table
from osl_analysis.bench.transmission import transmission_series, transmission_table
from osl_analysis.config import read_campaign_section
from osl_analysis.doubtful import DoubtfulFits, marked
from osl_analysis.files import default_config, shipped
from osl_analysis.parameters import known_parameters
from osl_analysis.shared_choices import WeightSettings
from osl_analysis.trial import Trial, read_trial
from osl_analysis.yaml_settings import Settings, read_mapping


class Estimated(NamedTuple):
    """What the fit of an experiment gives."""

    table: pl.DataFrame
    """A row per fit."""
    series: Series
    """Measured and modelled signals."""
    curves: pl.DataFrame | None = None
    """Torque over angle, as in the table of curves of the experiment; None for one without."""


@dataclass(frozen=True)
class FittedTrial:
    """A fitted trial for the command line and for notebooks."""

    estimates: pl.DataFrame
    """A row per fit, as in the result tables."""
    series: pl.DataFrame
    """Time [s] from the start, measured and modelled torque [N*m] of the fit to all data."""
    curves: pl.DataFrame | None = None
    """Torque over angle, as in the table of curves of the experiment; None for one without."""


@dataclass(frozen=True)
class FitRequest:
    """What the fit of a trial uses besides the trial: settings and limits of a campaign, and what the leg was asked."""

    settings: Any
    """The section of the configuration that the fit uses, of the model in `SECTIONS`."""
    limits: DoubtfulFits
    """Limits beyond which a fit is doubtful."""
    asked: AskedImpedance | None = None
    """What the leg was asked to render; None if it is not known."""
    windows: str | None = None
    """What of an impedance trial is fitted [s], as in the sample sheet; None: all that moves."""
    curve: str | None = None
    """Name of the curve of torque over angle that the device was designed for; None: none."""


def fit_request(experiment: str, config: Path, desired: DesiredImpedance | None = None) -> FitRequest:
    """What the fit of an experiment uses, from a configuration file that may override fields of the default only.

    Raises
    ------
    InputError
        The file is not a configuration.
    """
    settings = read_campaign_section(config, *SECTIONS[experiment])
    limits = read_campaign_section(config, "doubtful", DoubtfulFits)
    if desired is None or not isinstance(settings, SteppedSineAnalysis):
        return FitRequest(settings, limits)
    return FitRequest(settings, limits, asked_impedance(desired, config, settings))


def asked_impedance(desired: DesiredImpedance, config: Path, settings: SteppedSineAnalysis) -> AskedImpedance:
    """What the leg was asked to render, with W of Eq. 14 in a configuration file; raises as `fit_request`."""
    weight = read_campaign_section(config, "gain_weight", WeightSettings).weight
    return AskedImpedance(desired, weight, settings.frequencies_hz)


NOT_CHECKED = (
    "not checked without --stiffness and --damping: whether the torque is late or the bench's frame yields, and "
    "whether K is what the gains should give"
)


def said_not_checked(fitted: FittedTrial) -> str:
    """What the fit of a trial could not check, as a line for the user; empty if it checked all."""
    if "not_checked" not in fitted.estimates.columns:
        return ""
    reasons = fitted.estimates["not_checked"].drop_nulls().unique(maintain_order=True)
    return "\n".join(f"not checked: {reason}" for reason in reasons)


def campaign_parameters(config: Path) -> Path | None:
    """The parameter file that a configuration names, which may override fields of the default only; None: null.

    Raises
    ------
    InputError
        The file is not a configuration.
    """
    content = read_mapping(config)
    if "parameters" not in content:
        content = read_mapping(default_config())
    named = content.get("parameters")
    return None if named is None else shipped(str(named))


def fit_one_trial(experiment: str, trial: Path, parameters: Path | None, request: FitRequest) -> FittedTrial:
    """Fit an ingested trial of one of the `FITS`; `request` as `fit_request` gives it.

    Raises
    ------
    InputError, IdentifiabilityError
        The trial lacks a signal, does not follow the protocol, or cannot identify the model.
    """
    return fit_trial(experiment, read_trial(trial), parameters, request)


def fit_trial(experiment: str, trial: Trial, parameters: Path | None, request: FitRequest) -> FittedTrial:
    """The same for a trial in memory."""
    found = FITS[experiment](trial, parameters, request)
    estimates = marked(found.table, request.limits.of(experiment), experiment)
    return FittedTrial(estimates, torque_table(found.series), found.curves)


def fit_belt(trial: Trial, parameters: Path | None, request: FitRequest) -> Estimated:
    """The belt's row, and its series."""
    settings: BeltAnalysis = request.settings
    p = known_parameters(parameters)
    check_recording(trial, settings)
    rails = saturated(trial, "torque", "theta")
    belt = belt_trial(trial, p, settings)
    return Estimated(plausible_belt(belt_table(belt), rails, p), belt_series(belt), belt_curve(belt))


def fit_transmission_losses(trial: Trial, parameters: Path | None, request: FitRequest) -> Estimated:
    """The transmission's rows, and the series of the fit to all amplitudes."""
    settings: SteppedSineAnalysis = request.settings
    check_recording(trial, settings)
    rails = saturated(trial, "torque", "theta")
    stepped = stepped_sine_trial(trial, settings)
    table = plausible_transmission(transmission_table(stepped), rails, known_parameters(parameters))
    return Estimated(table, transmission_series(stepped))


def fit_rendered_impedance(trial: Trial, parameters: Path | None, request: FitRequest) -> Estimated:
    """The rows of Eq. 15, and the series of the fit to all amplitudes."""
    settings: ImpedanceAnalysis = request.settings
    check_recording(trial, settings)
    rails = saturated(trial, "torque", "theta")
    rendered = rendered_trial(trial, settings, request.windows)
    table = judged_impedance(rendered, rails, known_parameters(parameters), request.asked)
    return Estimated(table, rendered_series(rendered))


def fit_actuator_bench(trial: Trial, parameters: Path | None, request: FitRequest) -> Estimated:
    """The actuator's row, and its series."""
    settings: ActuatorAnalysis = request.settings
    check_recording(trial, settings, "torque_m", angle=None)
    rails = saturated(trial, "torque_m", "current")
    actuator = actuator_trial(trial, settings)
    table = plausible_actuator(actuator_table(actuator), rails, known_parameters(parameters))
    return Estimated(table, actuator_series(actuator))


def fit_torque_angle(trial: Trial, parameters: Path | None, request: FitRequest) -> Estimated:
    """The row of torque against angle, the torque beside its curve over angle, and the curves of both branches."""
    settings: TorqueAngleAnalysis = request.settings
    check_recording(trial, settings)
    rails = saturated(trial, "torque", "theta")
    found = torque_angle_trial(trial, settings)
    table = rails.beside(torque_angle_table(found, request.curve))
    return Estimated(table, found.series(), curve_table(found, request.curve))


FITS: dict[str, Callable[[Trial, Path | None, FitRequest], Estimated]] = {
    "belt": fit_belt,
    "transmission": fit_transmission_losses,
    "actuator": fit_actuator_bench,
    "impedance": fit_rendered_impedance,
    "torque_angle": fit_torque_angle,
}
"""By experiment: the fit of one trial, from the trial, the parameter file and the request."""
SECTIONS: dict[str, tuple[str, type[Settings]]] = dict.fromkeys(FITS, ("dynamometer", DynamometerAnalysis)) | {
    "actuator": ("actuator", ActuatorAnalysis),
    "torque_angle": ("torque_angle", TorqueAngleAnalysis),
}
"""By experiment: the section of the configuration that its fit uses, and the model of that section."""


def torque_table(series: Series) -> pl.DataFrame:
    """Time [s] from the start, measured and modelled torque [N*m] of every sample that the model has."""
    table = pl.DataFrame({"time": series.time, "torque": series.torque, "torque_model": series.torque_model})
    return table.filter(pl.col("torque_model").is_finite()).with_columns(pl.col("time") - pl.col("time").first())
