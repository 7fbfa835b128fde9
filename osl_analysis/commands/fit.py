"""The fit of one trial, by the job of its experiment, and judged by the limits of a campaign: for
the command line and notebooks."""

from collections.abc import Mapping
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import polars as pl

from osl_analysis.bench.analysis import FitTables
from osl_analysis.campaign.configuration import config_for_trials
from osl_analysis.commands.fit_results import Fit
from osl_analysis.commands.remedies import fit_or_advise
from osl_analysis.config.experiments import EXPERIMENTS, FitJob
from osl_analysis.errors import InputError
from osl_analysis.judge.judging import judged, marked
from osl_analysis.judge.limits import DoubtfulFits
from osl_analysis.trial import Trial


def job_of(experiment: str) -> FitJob:
    """The fit of an experiment's trials. Raises InputError where it has none."""
    fit = EXPERIMENTS[experiment].fit
    if fit is None:
        raise InputError(
            f"a trial of '{experiment}' is not fitted alone; choose another experiment for it"
        )
    return fit


def fit_settings(experiment: str, config: Path) -> tuple[dict[str, Any], DoubtfulFits]:
    """Read the settings of an experiment's fit.

    Parameters
    ----------
    experiment : str
    config : Path
        A configuration file, which may override fields of the default only.

    Returns
    -------
    settings : dict
        By the arguments of the fit's job.
    limits : DoubtfulFits
        Beyond which a fit is doubtful.
    """
    stated = config_for_trials(config)
    settings = {
        argument: getattr(stated, section)
        for argument, (section, _) in job_of(experiment).settings.items()
    }
    return settings, stated.doubtful


def run_fit(
    experiment: str,
    trial: Trial,
    parameters: Path | None,
    settings: Mapping[str, Any],
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
    settings : Mapping
        By the arguments of the job, as of `fit_settings`.
    condition : DesiredImpedance or Mapping or None
        What the sheet states; a mapping has its cells by column.
    windows : str or None
        Those of the sheet [s].

    Raises
    ------
    InputError
        The experiment has no fit, or the recording cannot be fitted.
    """
    job = job_of(experiment)
    arguments = dict(settings)
    if job.parameters:
        arguments["parameters"] = parameters
    if job.sheet:
        arguments["condition"] = condition
    if job.windows:
        arguments["windows"] = windows
    elif windows:
        trial = trial.within(windows)
    return fit_or_advise(resolve_name(job.job), trial, **arguments)


def fit_trial(
    experiment: str,
    trial: Trial,
    parameters: Path | None,
    settings: Mapping[str, Any],
    limits: DoubtfulFits,
    condition: Any = None,
    windows: str | None = None,
) -> Fit:
    """Fit a trial and judge it; `fit_settings` gives `settings` and `limits`, the rest and errors
    as `run_fit`."""
    tables = run_fit(experiment, trial, parameters, settings, condition, windows).estimates
    name = EXPERIMENTS[experiment].tables[0].name
    findings = judged(tables[name], limits.of(name), name)
    curves = [table for name, table in tables.items() if name.endswith("_curves")]
    no_torque = pl.DataFrame(schema=dict.fromkeys(("time", "torque", "torque_model"), pl.Float64))
    return Fit(
        experiment=experiment,
        table=marked(tables[name], findings, name),
        series=tables.get("torque", no_torque),
        curves=curves[0] if curves else None,
        findings=findings,
    )
