"""The fit of one trial, by the job of its experiment, and judged by the limits of a campaign: for
the command line, `watch` and notebooks. Its recording is checked by `watch` alone, and predictions
need the other trials of a campaign."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.bench.fit_tables import FitTables
from osl_analysis.campaign.configuration import Config, over_default, own_fields, section_of
from osl_analysis.commands.estimates import estimated, estimates_text
from osl_analysis.config.experiments import EXPERIMENTS, FitJob
from osl_analysis.errors import InputError, nearest, printable_lines
from osl_analysis.files import shipped
from osl_analysis.judge.finding import Finding, Grade
from osl_analysis.judge.judging import judged, marked
from osl_analysis.judge.limits import DoubtfulFits
from osl_analysis.judge.words import finding_text
from osl_analysis.trial import Trial


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """A fitted trial. Every column of its table is an attribute, with the value of the fit to all
    data: `fit.K`, `fit.K_se`, `fit.VAF`; `fit.K_interval` is (low, high), the 95 % interval.
    Meaning and unit of each are told by `osl-analysis results --columns`.

    Attributes
    ----------
    experiment : str
        It names the table that the fit has rows of in a campaign.
    table : DataFrame
        Those rows: one per amplitude, if there are several, and last the fit to all data.
    series : DataFrame
        `time` [s] from the start, `torque` and `torque_model` [N*m] of all samples that the fit
        explains.
    curves : DataFrame or None
        Torque over angle, rows of `belt_curves` or `torque_angle_curves`; None for another
        experiment.
    findings : list
        What was judged of each row: doubts, what could not be checked, notes.
    """

    experiment: str
    table: pl.DataFrame
    series: pl.DataFrame
    curves: pl.DataFrame | None
    findings: Sequence[Sequence[Finding]] = ()

    @property
    def row(self) -> Mapping[str, Any]:
        """The fit to all data."""
        return self.table.row(-1, named=True)

    @property
    def doubtful(self) -> str:
        """Why the fit to all data is not to be trusted: what is beyond which limit, and what to do.
        Empty: nothing."""
        return "\n".join(self.sentences(Grade.DOUBTS))

    @property
    def not_checked(self) -> str:
        """What could not be checked, and why, a line each, and what is to be known; empty if there
        is nothing."""
        lines = [f"not checked: {text}" for text in self.sentences(Grade.UNCHECKED)]
        lines += [f"remark: {text}" for text in self.sentences(Grade.NOTES)]
        return "\n".join(lines)

    def sentences(self, *grades: Grade) -> list[str]:
        """The findings of some grades about the fit to all data, in words."""
        of_whole = self.findings[-1] if self.findings else ()
        return [finding_text(finding, self.row) for finding in of_whole if finding.grade in grades]

    def __getattr__(self, name: str) -> Any:
        """A column of the table by name, of the fit to all data, or `NAME_interval`."""
        if name.startswith("_"):  # also while a copy is made, which has no fields yet
            raise AttributeError(name)
        row = self.row
        quantity = name.removesuffix("_interval")
        if quantity != name and f"{quantity}_low" in row:
            return row[f"{quantity}_low"], row[f"{quantity}_high"]
        if name not in row:
            estimates = ", ".join(estimated(row))
            raise AttributeError(
                f"a fit of {self.experiment} has no '{name}'{nearest(name, row)}; it has"
                f" {estimates}"
            )
        return row[name]

    def __dir__(self) -> list[str]:
        intervals = [f"{name}_interval" for name in estimated(self.row)]
        return sorted({*super().__dir__(), *self.row, *intervals})

    def __repr__(self) -> str:
        text = f"{self.experiment}, {estimates_text(self.table.tail(1), self.findings[-1:])}"
        if self.not_checked:
            text += f"\n{self.not_checked}"
        return printable_lines(text)


def job_of(experiment: str) -> FitJob:
    """The fit of an experiment's trials. Raises InputError where it has none."""
    fit = EXPERIMENTS[experiment].fit
    if fit is None:
        raise InputError(
            f"a trial of '{experiment}' is not fitted alone; choose another experiment for it"
        )
    return fit


def function_of(job: FitJob) -> Callable[..., FitTables | Mapping[str, pl.DataFrame]]:
    """The function of `commands` that a job of a fit names."""
    module_name, _, function_name = job.job.partition(".")
    module = import_module(f"osl_analysis.commands.{module_name}")
    fit: Callable[..., FitTables | Mapping[str, pl.DataFrame]] = getattr(module, function_name)
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
    settings: dict[str, Any] = {}
    content = over_default(own_fields(config))
    for argument, (section, _) in job_of(experiment).settings.items():
        model: Any = Config.model_fields[section].annotation
        settings[argument] = section_of(content, config, section, model)
    return settings, section_of(content, config, "doubtful", DoubtfulFits)


def campaign_parameters(config: Path) -> Path | None:
    """The parameter file that a configuration names, which may override fields of the default only;
    None: null."""
    name = over_default(own_fields(config))["parameters"]
    return None if name is None else shipped(str(name))


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
    tables = function_of(job)(trial, **arguments)
    return tables if isinstance(tables, FitTables) else FitTables(tables)


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
