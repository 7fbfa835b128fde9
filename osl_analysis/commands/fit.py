"""One trial fitted for the command line and notebooks: the estimates, and the torque beside the fitted model's."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.config import Config, read_section
from osl_analysis.errors import InputError
from osl_analysis.experiments import EXPERIMENTS, Fit
from osl_analysis.files import default_config, shipped
from osl_analysis.judge.doubts import marked, not_checked_of
from osl_analysis.judge.table import DoubtfulFits
from osl_analysis.table import finite_or_null
from osl_analysis.trial import Trial
from osl_analysis.yaml_settings import read_mapping


@dataclass(frozen=True)
class FittedTrial:
    """A fitted trial for the command line and for notebooks."""

    estimates: pl.DataFrame  # a row per fit, as in the result tables
    series: pl.DataFrame  # time [s] from the start, measured and modelled torque [N*m]; empty for a fit without them
    curves: pl.DataFrame | None = None  # torque over angle, as in the table of curves; None for one without


@dataclass(frozen=True)
class FitRequest:
    """What the fit of a trial uses besides the trial: settings and limits of a campaign, and what the sheet states."""

    settings: Mapping[str, Any]  # by argument of the fit (`Fit.settings`): the section of the configuration
    limits: DoubtfulFits  # limits beyond which a fit is doubtful
    condition: Any = None  # what the sheet states of the trial: `DesiredImpedance`, or cells by column; None: unknown
    windows: str | None = None  # what of an impedance trial is fitted [s], as in the sample sheet; None: all that moves


def fit_of(experiment: str) -> Fit:
    """The fit of an experiment's trials. Raises InputError where it has none."""
    if (fit := EXPERIMENTS[experiment].fit) is None:
        raise InputError(f"a trial of '{experiment}' is not fitted alone; choose another experiment for it")
    return fit


def fit_request(experiment: str, config: Path, condition: Any = None) -> FitRequest:
    """What the fit of an experiment uses, from a configuration file that may override fields of the default only.

    Raises InputError where the file is none.
    """
    models: Mapping[str, Any] = {name: field.annotation for name, field in Config.model_fields.items()}
    settings = {name: read_section(config, of, models[of]) for name, (of, _) in fit_of(experiment).settings.items()}
    if "weight" in settings:
        settings["weight"] = settings["weight"].weight  # the cut-off and order are W themselves
    return FitRequest(settings, read_section(config, "doubtful", DoubtfulFits), condition)


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


def fit_tables(
    experiment: str, trial: Trial, parameters: Path | None, request: FitRequest
) -> Mapping[str, pl.DataFrame]:
    """The tables of a trial's fit, as the job of a campaign gives them; `request` as `fit_request` gives it.

    Raises InputError or IdentifiabilityError where the trial lacks a signal, does not follow the protocol, or cannot
    identify the model.
    """
    fit = fit_of(experiment)
    module, _, function = fit.job.partition(".")
    stated = {"parameters": parameters, "condition": request.condition, "windows": request.windows}
    taken = {"parameters": fit.parameters, "condition": bool(fit.sheet), "windows": fit.windows}
    given = {**request.settings, **{name: value for name, value in stated.items() if taken[name]}}
    found: Mapping[str, pl.DataFrame] = getattr(import_module(f"osl_analysis.commands.{module}"), function)(
        trial, **given
    )
    return found


def fit_trial(experiment: str, trial: Trial, parameters: Path | None, request: FitRequest) -> FittedTrial:
    """Fit a trial and judge it; arguments and errors as `fit_tables`."""
    found = fit_tables(experiment, trial, parameters, request)
    own = EXPERIMENTS[experiment].tables[0].name
    curves = next((frame for name, frame in found.items() if name.endswith("_curves")), None)
    estimates = marked(found[own], request.limits.of(own), own)
    return FittedTrial(estimates, found.get("torque", NO_TORQUE), curves)


NO_TORQUE = pl.DataFrame(schema=dict.fromkeys(("time", "torque", "torque_model"), pl.Float64))


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
        quality = f"VAF {row['VAF']:.2f} %" if "VAF" in row else "no VAF"
        if "R2" in row:
            quality += f", R2 {row['R2']:.5f}, condition {row['condition_number']:.1f}"
        lines.append(f"{row['trial']}, {which}: {quality}")
        for name in estimated(row):
            high = row.get(f"{name}_high")
            half = f"± {high - row[name]:<10.2g}" if high is not None else f"{'':<12}"
            lines.append(f"  {name:<15}{row[name]:>12.5g} {half} {UNITS.get(name, '')}{amplitudes_text(row, name)}")
        if row.get("doubtful"):
            lines.append(f"  doubtful: {row['doubtful']}")
    return "\n".join([*lines, "± is the half-width of the 95 % interval, by the method that interval_method names"])


def estimated(row: Mapping[str, Any]) -> list[str]:
    """The quantities that a fit estimates, or all its numbers where it has none that we know.

    A belt that moves at a constant velocity has no B_j.
    """
    known = [name for name in UNITS if f"{name}_se" in row and row[name] is not None]
    return known or [name for name, value in row.items() if isinstance(value, float)]


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
