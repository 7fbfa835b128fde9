"""For notebooks: the fits of single bench trials, as the jobs of a campaign make them, and frequency responses."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.bench.impedance import DesiredImpedance
from osl_analysis.bench.phasors import frequency_response_table
from osl_analysis.commands import bench
from osl_analysis.commands.fit import (
    UNITS,
    FitRequest,
    FittedTrial,
    campaign_parameters,
    estimated,
    estimates_text,
    fit_request,
    fit_trial,
    said_not_checked,
)
from osl_analysis.config import read_section
from osl_analysis.doubtful import IS_DOUBTFUL, marked, with_doubts_of
from osl_analysis.errors import InputError, nearest, printable, printable_lines
from osl_analysis.files import config_here
from osl_analysis.parameters import joint_of, known_parameters
from osl_analysis.shared_choices import WeightSettings
from osl_analysis.trial import Trial
from osl_analysis.trial import read_trial as read_trial_file

File = str | Path
OF_CONFIG = "of the configuration"  # in place of a parameter file: the one that the configuration names
NOT_KNOWN = DesiredImpedance(None, None, None)  # nothing is known of what the leg was asked to render


def path_of(value: File, what: str) -> Path:
    if not isinstance(value, str | Path) or not str(value):
        raise InputError(f"{what}: a path is needed, not {value!r}")
    return Path(value)


def desired_of(desired: DesiredImpedance | None) -> DesiredImpedance:
    if desired is None:
        return NOT_KNOWN
    if not isinstance(desired, DesiredImpedance):
        raise InputError(f"desired: {desired!r} is none; write DesiredImpedance(controller, K_d, B_d)")
    return desired


def trial_of(trial: Trial | File) -> Trial:
    if isinstance(trial, Path | str):
        return read_trial_file(Path(trial))
    if not isinstance(trial, Trial):
        raise InputError(
            f"a trial is needed, not {type(trial).__name__}; give what `read_trial` or `read_recording` returned, a "
            "path, or `Trial(name, samples)` with a data frame in SI units"
        )
    for name, dtype in trial.samples.schema.items():
        if not (dtype.is_numeric() or dtype.is_(bool)):
            raise InputError(f"trial {trial.name}: column '{name}' holds {dtype}, expected numbers; convert or drop it")
    return trial


def config_of(config: File | None) -> Path:
    """The configuration file; without one that of the campaign in the working folder, else the shipped one."""
    return config_here() if config is None else path_of(config, "config")


def device_of(parameters: File | None, config: Path) -> Path | None:
    if parameters == OF_CONFIG:
        return campaign_parameters(config)
    return None if parameters is None else path_of(parameters, "parameters")


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """A fitted trial. Nothing of it can be changed: its data frames are copies.

    Every column of its table is an attribute, with the value of the fit to all data: `fit.K`, `fit.K_se`, `fit.VAF`;
    `fit.K_interval` is (low, high), the 95 % interval. `osl-analysis describe-tables` has meaning and unit of each.
    """

    experiment: str  # Experiment, which names the table that the fit has rows of in a campaign
    _fitted: FittedTrial

    @property
    def table(self) -> pl.DataFrame:
        """The rows of the result table: one per amplitude, if there are several, and last the fit to all data."""
        return self._fitted.estimates.clone()

    @property
    def series(self) -> pl.DataFrame:
        """`time` [s] from the start, `torque` and `torque_model` [N*m] of all samples that the fit explains."""
        return self._fitted.series.clone()

    @property
    def curves(self) -> pl.DataFrame | None:
        """Torque over angle: rows of `belt_curves` or `torque_angle_curves`; None for another experiment."""
        return None if self._fitted.curves is None else self._fitted.curves.clone()

    @property
    def row(self) -> Mapping[str, Any]:
        return self._fitted.estimates.row(-1, named=True)

    @property
    def doubtful(self) -> str:
        """Why the fit to all data is not to be trusted: what is beyond which limit, and what to do. Empty: nothing."""
        return self.row.get("doubtful") or ""

    @property
    def not_checked(self) -> str:
        """What could not be checked, and why; empty if everything was."""
        return said_not_checked(self._fitted)

    def __getattr__(self, name: str) -> Any:
        """A column of the table by name, of the fit to all data, or `NAME_interval`."""
        if name.startswith("_"):  # also while a copy is made, which has no fields yet
            raise AttributeError(name)
        row, of = self.row, name.removesuffix("_interval")
        if of != name and f"{of}_low" in row:
            return row[f"{of}_low"], row[f"{of}_high"]
        if name not in row:
            known = ", ".join(estimated(row))
            raise AttributeError(f"a fit of {self.experiment} has no '{name}'{nearest(name, row)}; it has {known}")
        return row[name]

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self.row, *(f"{name}_interval" for name in estimated(self.row))})

    def __repr__(self) -> str:
        estimates = f"{self.experiment}, {estimates_text(self._fitted.estimates.tail(1))}"
        return printable_lines("\n".join(filter(None, [estimates, self.not_checked])))

    def _repr_html_(self) -> str:
        """The fit to all data as an HTML table, for a notebook. Text of the recording is escaped."""
        row = self.row
        rows = [
            f"<tr><td>{name}</td><td>{number(row[name])}</td>"
            f"<td>{number(row[f'{name}_low'])} to {number(row[f'{name}_high'])}</td><td>{UNITS[name]}</td></tr>"
            for name in estimated(self.row)
        ]
        said = [f"Doubtful: {self.doubtful}"] * bool(self.doubtful) + self.not_checked.splitlines()
        title = f"{self.experiment}, {row['trial']}: VAF {row['VAF']:.2f} %"
        head = "<tr><th></th><th>estimate</th><th>95 % interval</th><th>unit</th></tr>"
        return (
            f"<table><caption>{escape(printable(title))}</caption>{head}{''.join(rows)}</table>"
            f"{''.join(f'<p>{escape(printable(line))}</p>' for line in said)}"
        )


def number(value: float | None) -> str:
    return "–" if value is None else f"{value:.5g}"


def fit_impedance(
    trial: Trial | File,
    desired: DesiredImpedance | None = None,
    windows: str | None = None,
    config: File | None = None,
    parameters: File | None = OF_CONFIG,
) -> Fit:
    """K [N*m/rad], B [N*m*s/rad] and I [kg*m^2] of Eq. 15, torque = K theta + B omega + I alpha + offset.

    The rows are those of `impedance.csv`: one per amplitude of a stepped sine, and one over all of them; of any other
    motion one row.

    Parameters
    ----------
    trial
        a trial with `theta` [rad] and the resisting `torque` [N*m], or its file.
    desired
        what the leg was asked to render, `DesiredImpedance("compensated", K_d=300, B_d=5)`. With it the fit is judged
        by what the gains should give. Without it `not_checked` says what is not judged.
    windows
        what of the trial is fitted [s], as in the column `windows` of a sample sheet; default: all that moves.
    config
        a configuration file, which may state what differs from the default only; default: `config.yaml` of a campaign
        in the working folder, else the shipped one.
    parameters
        the parameter file of the device; default: the one that the configuration names; None: a device without one,
        whose stiffness is not compared with a belt.

    Raises InputError: the trial lacks a signal, does not move, or follows a damaged stepped sine; or a file is not
    valid. Raises IdentifiabilityError: the motion cannot tell K, B and I apart. Raises UnreachableImpedanceError:
    The device has no gains for the desired impedance.
    """
    path = config_of(config)
    request = replace(fit_request("impedance", path, desired_of(desired)), windows=windows)
    return fitted("impedance", trial, request, device_of(parameters, path))


def fit_belt(trial: Trial | File, config: File | None = None, parameters: File | None = OF_CONFIG) -> Fit:
    """The belt's stiffness K_s [N*m/rad]: the slope of torque over theta - theta_m / n_T while loading (Fig. 3).

    The trial has `theta` and `theta_m` [rad] and `torque` [N*m]; the row is that of `belt.csv`. `config`, `parameters`
    and what is raised as in `fit_impedance`; a belt trial needs a parameter file, for n_T.
    """
    return fitted_alone("belt", trial, config, parameters)


def fit_transmission(trial: Trial | File, config: File | None = None, parameters: File | None = OF_CONFIG) -> Fit:
    """The transmission's damping B_j [N*m*s/rad] and inertia J_j [kg*m^2] (Eq. 4), of a trial without motor.

    The trial has `theta` [rad] and `torque` [N*m]; the rows are those of `transmission.csv`. `config`, `parameters`
    and what is raised as in `fit_impedance`.
    """
    return fitted_alone("transmission", trial, config, parameters)


def fit_actuator(trial: Trial | File, config: File | None = None, parameters: File | None = OF_CONFIG) -> Fit:
    """The actuator (Eqs. 1-2) on its own bench: k_tau n_m and f_G [N*m/A], f_C [N*m], B_m [N*m*s/rad], J_m [kg*m^2].

    The trial has `current` [A], `torque_m` [N*m], and `theta_m` [rad] or `omega_m` [rad/s]; the row is that of
    `actuator.csv`. `config`, `parameters` and what is raised as in `fit_impedance`.
    """
    return fitted_alone("actuator", trial, config, parameters)


def fit_torque_angle(trial: Trial | File, curve: str | None = None, config: File | None = None) -> Fit:
    """Torque over angle of a passive foot or a spring in slow cycles: K [N*m/rad], energies [J], hysteresis.

    The trial has `theta` [rad] and `torque` [N*m]; the row is that of `torque_angle.csv`, and `curves` has the rows of
    `torque_angle_curves.csv`. `curve` names the curve of the configuration that the device was designed for. `config`
    and what is raised as in `fit_impedance`; there may be no such curve.
    """
    path = config_of(config)
    return fitted("torque_angle", trial, replace(fit_request("torque_angle", path), curve=curve), None)


def fitted_alone(experiment: str, trial: Trial | File, config: File | None, parameters: File | None) -> Fit:
    path = config_of(config)
    return fitted(experiment, trial, fit_request(experiment, path), device_of(parameters, path))


def fitted(experiment: str, trial: Trial | File, request: FitRequest, parameters: Path | None) -> Fit:
    return Fit(experiment, fit_trial(experiment, trial_of(trial), parameters, request))


@dataclass(frozen=True, eq=False, repr=False)
class Response:
    """The frequency response of one trial. Nothing of it can be changed: its data frames are copies."""

    trial: str  # name of the trial
    figure: str  # the figure that shows it: `fig7` of a stepped sine, `response` of any other motion
    _table: pl.DataFrame
    _models: pl.DataFrame
    _plotted: pl.DataFrame

    @property
    def table(self) -> pl.DataFrame:
        """A row per frequency. Of a stepped sine those of `frequency_response.csv`, the admittance Y, angle over torque
        [rad/(N*m)], averaged over amplitudes. Of any other motion those of `response.csv`, the impedance Z, torque over
        angle [N*m/rad], with noise and distortion."""
        return self._table.clone()

    @property
    def models(self) -> pl.DataFrame:
        """Eqs. 15 and 9 fitted to the response, the rows of `response_models.csv`; none of a stepped sine."""
        return self._models.clone()

    @property
    def plotted(self) -> pl.DataFrame:
        """The numbers that `plot_frequency_response` draws."""
        return self._plotted.clone()

    def __repr__(self) -> str:
        doubts = len(self._table.filter(IS_DOUBTFUL))
        counted = f"{len(self._table)} frequencies" + (f", doubtful at {doubts} of them" if doubts else "")
        return f"frequency response, {self.trial}: {counted}; `table`, `models` and `plotted` are data frames"


def frequency_response(
    trial: Trial | File,
    desired: DesiredImpedance | None = None,
    windows: str | None = None,
    config: File | None = None,
    parameters: File | None = OF_CONFIG,
) -> Response:
    """The frequency response of an impedance trial, with 95 % intervals of noise; arguments and errors as in
    `fit_impedance`.

    With `desired` the numbers to be plotted have the desired response (Eq. 11), and with the gains of a controller of
    the draft that of the drivetrain without friction (Eq. 9) too.
    """
    from osl_analysis.commands.plotted_numbers import beside_theory
    from osl_analysis.commands.tables import pooled_schema
    from osl_analysis.figures.names import of_place
    from osl_analysis.figures.response import points as any_motion_points

    path, read = config_of(config), trial_of(trial)
    device = device_of(parameters, path)
    request = fit_request("impedance", path, desired_of(desired))
    fit = bench.fit_impedance(read, known_parameters(device), request.settings, request.asked, windows)
    tables, found, limits = fit.further(), {}, request.limits
    for name in ("phasors", "response", "response_models"):
        own = marked(tables[name], limits.of(name), name)
        found[name] = with_doubts_of(own, fit.table, limits.of("impedance"), "impedance")
    if found["phasors"].is_empty():  # the motion is no stepped sine
        plotted = any_motion_points(found["response"], pl.DataFrame(schema=pooled_schema()))
        return Response(read.name, "response", found["response"], found["response_models"], plotted)
    table = frequency_response_table(found["phasors"])
    joint = pl.lit(joint_of(device) if device else None, pl.String)
    weight = read_section(path, "gain_weight", WeightSettings).weight
    plotted = beside_theory(of_place(table.with_columns(joint=joint)), device, weight)
    return Response(read.name, "fig7", table, found["response_models"], plotted)
