"""One trial fitted for the command line and notebooks: the estimates, and the torque beside the fitted model's."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.bench.analysis import Series
from osl_analysis.bench.impedance import AskedImpedance, DesiredImpedance
from osl_analysis.bench.settings import ActuatorAnalysis, DynamometerAnalysis, TorqueAngleAnalysis
from osl_analysis.commands import bench
from osl_analysis.config import read_section
from osl_analysis.files import default_config, shipped
from osl_analysis.judge.doubts import marked, not_checked_of
from osl_analysis.judge.table import DoubtfulFits
from osl_analysis.parameters import known_parameters
from osl_analysis.shared_choices import WeightSettings
from osl_analysis.table import finite_or_null
from osl_analysis.trial import Trial
from osl_analysis.yaml_settings import Settings, read_mapping

FITS: dict[str, Callable[..., bench.Fitted]] = {
    "belt": bench.fit_belt,
    "transmission": bench.fit_transmission,
    "actuator": bench.fit_actuator,
    "impedance": bench.fit_impedance,
    "torque_angle": bench.fit_torque_angle,
}
"""By experiment: the fit of one trial."""


@dataclass(frozen=True)
class FittedTrial:
    """A fitted trial for the command line and for notebooks."""

    estimates: pl.DataFrame  # a row per fit, as in the result tables
    series: pl.DataFrame  # time [s] from the start, measured and modelled torque [N*m] of the fit to all data
    curves: pl.DataFrame | None = None  # torque over angle, as in the table of curves; None for one without


@dataclass(frozen=True)
class FitRequest:
    """What the fit of a trial uses besides the trial: settings and limits of a campaign, and what the leg was asked."""

    settings: Any  # the section of the configuration that the fit uses, of its whole model
    limits: DoubtfulFits  # limits beyond which a fit is doubtful
    asked: AskedImpedance | None = None  # what the leg was asked to render; None if it is not known
    windows: str | None = None  # what of an impedance trial is fitted [s], as in the sample sheet; None: all that moves
    curve: str | None = None  # name of the curve of torque over angle that the device was designed for; None: none


def fit_request(experiment: str, config: Path, desired: DesiredImpedance | None = None) -> FitRequest:
    """What the fit of an experiment uses, from a configuration file that may override fields of the default only.

    `desired` is that of an impedance trial, as far as it is known. Raises InputError where the file is none.
    """
    of_section: dict[str, type[Settings]] = {"actuator": ActuatorAnalysis, "torque_angle": TorqueAngleAnalysis}
    section = experiment if experiment in of_section else "dynamometer"
    settings: Any = read_section(config, section, of_section.get(experiment, DynamometerAnalysis))
    asked = None
    if desired is not None:
        weight = read_section(config, "gain_weight", WeightSettings).weight
        asked = AskedImpedance(desired, weight, settings.frequencies_hz)
    return FitRequest(settings, read_section(config, "doubtful", DoubtfulFits), asked)


NOT_CHECKED = (
    "not checked without --stiffness and --damping: whether the torque is late or the bench's frame yields, and "
    "whether K is what the gains should give"
)


def said_not_checked(fitted: FittedTrial) -> str:
    """What the fit of a trial could not check, as a line for the user; empty if it checked all."""
    return "\n".join(f"not checked: {what}: {why}" for what, why in not_checked_of(fitted.estimates).items())


def campaign_parameters(config: Path) -> Path | None:
    """The parameter file that a configuration names, which may override fields of the default only; None: null."""
    named = (read_mapping(default_config()) | read_mapping(config))["parameters"]
    return None if named is None else shipped(str(named))


def fit_trial(experiment: str, trial: Trial, parameters: Path | None, request: FitRequest) -> FittedTrial:
    """Fit a trial of one of the `FITS`; `request` as `fit_request` gives it.

    Raises InputError or IdentifiabilityError where the trial lacks a signal, does not follow the protocol, or cannot
    identify the model.
    """
    stated = {"impedance": (request.asked, request.windows), "torque_angle": (request.curve,)}.get(experiment, ())
    found = FITS[experiment](trial, known_parameters(parameters), request.settings, *stated)
    estimates = marked(found.table, request.limits.of(experiment), experiment)
    return FittedTrial(estimates, torque_table(found.series), found.curves)


def torque_table(series: Series) -> pl.DataFrame:
    """Time [s] from the start, measured and modelled torque [N*m] of every sample that the model has."""
    table = pl.DataFrame({"time": series.time, "torque": series.torque, "torque_model": series.torque_model})
    return table.filter(pl.col("torque_model").is_finite()).with_columns(pl.col("time") - pl.col("time").first())


UNITS = {
    "K": "N·m/rad", "B": "N·m·s/rad", "B_viscous": "N·m·s/rad", "I": "kg·m²", "K_s": "N·m/rad", "B_j": "N·m·s/rad",
    "J_j": "kg·m²",
    "T_C": "N·m", "k_tau_n_m": "N·m/A", "f_C": "N·m", "f_G": "N·m/A", "B_m": "N·m·s/rad", "J_m": "kg·m²",
    "offset": "N·m", "drift": "N·m/s", "K_secant": "N·m/rad", "K_unloading": "N·m/rad", "energy_stored": "J",
    "energy_returned": "J", "energy_lost": "J",
}  # fmt: skip


def estimates_json(estimates: pl.DataFrame) -> str:
    """The estimates as JSON in SI units: an object per fit, null for what is not finite."""
    return json.dumps([finite_or_null(row) for row in estimates.to_dicts()], indent=2)


def estimates_text(estimates: pl.DataFrame) -> str:
    """The estimates as text: a line per fit and quantity, with 95 % interval and VAF."""
    lines = []
    for row in estimates.to_dicts():
        amplitude = row.get("amplitude_deg")
        which = motion_text(row) if amplitude is None else f"{amplitude:g} deg"
        which = f"mean of cycles: {row['cycles']}" if "cycles" in row else which
        quality = f"VAF {row['VAF']:.2f} %"
        if "R2" in row:
            quality += f", R2 {row['R2']:.5f}, condition {row['condition_number']:.1f}"
        lines.append(f"{row['trial']}, {which}: {quality}")
        for name in estimated(row):
            high = row[f"{name}_high"]
            half = f"± {high - row[name]:<10.2g}" if high is not None else f"{'':<12}"
            lines.append(f"  {name:<15}{row[name]:>12.5g} {half} {UNITS[name]}{amplitudes_text(row, name)}")
        if row.get("doubtful"):
            lines.append(f"  doubtful: {row['doubtful']}")
    return "\n".join([*lines, "± is the half-width of the 95 % interval, by the method that interval_method names"])


def estimated(row: Mapping[str, Any]) -> list[str]:
    """The quantities that a fit estimates. A belt that moves at a constant velocity has no B_j."""
    return [name for name in UNITS if f"{name}_se" in row and row[name] is not None]


def motion_text(row: Mapping[str, Any]) -> str:
    """What a fit without an amplitude is a fit to."""
    excitation = row.get("excitation")
    if excitation in (None, "stepped sine"):
        return "all amplitudes"
    band = f"{row['band_low_hz']:.3g} to {row['band_high_hz']:.3g} Hz, {row['theta_rms_deg']:.2g} deg RMS"
    return f"{row['fitted_s']:.1f} s of {'periodic' if excitation == 'periodic' else 'any'} motion, {band}"


def amplitudes_text(row: Mapping[str, Any], name: str) -> str:
    """The lowest and the highest estimate of a single amplitude, if the row has them."""
    low, high = row.get(f"{name}_amplitudes_low"), row.get(f"{name}_amplitudes_high")
    return "" if low is None or high is None else f", single amplitudes {low:.5g} to {high:.5g}"
