"""The functions of `import osl_analysis as osl`, for notebooks and scripts that need no workflow.
They call what the jobs of a campaign call: their numbers are those of its tables."""

from base64 import b64encode
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import polars as pl

from osl_analysis.bench.bench_settings import DynamometerAnalysis
from osl_analysis.bench.frequency_response import frequency_response_table
from osl_analysis.bench.impedance import DesiredImpedance
from osl_analysis.campaign.configuration import read_section
from osl_analysis.commands import tables as tables_of_campaign
from osl_analysis.commands.fit import Fit, campaign_parameters, fit_settings, fit_trial, run_fit
from osl_analysis.commands.trials import checked_trial
from osl_analysis.config.experiments import EXPERIMENTS, PROTOCOL
from osl_analysis.errors import InputError, listing, nearest
from osl_analysis.figures import drawing_of
from osl_analysis.files import config_here, shipped
from osl_analysis.ingest.examine import UNITS, Commanded, examine, measured_table
from osl_analysis.ingest.raw_files import read_source
from osl_analysis.judge.judging import judged, marked, with_inherited
from osl_analysis.judge.limits import DoubtfulFits
from osl_analysis.judge.recording_checks import QualityRules, judged_table, validate_rules
from osl_analysis.model.drivetrain import joint_of
from osl_analysis.source_file import MarkerSource
from osl_analysis.table import read_table as read_table
from osl_analysis.table import to_pandas as to_pandas
from osl_analysis.trial import Trial
from osl_analysis.trial import read_trial as read_trial

if TYPE_CHECKING:
    from osl_analysis.figures.style import NotebookFigure

File = str | Path
OF_CONFIG = "of the configuration"  # stands for the parameter file that the configuration names


def as_trial(trial: Trial | File) -> Trial:
    if isinstance(trial, Path | str):
        return read_trial(trial)
    if not isinstance(trial, Trial):
        raise InputError(
            f"a trial is needed, not {type(trial).__name__}; give what `read_trial` or"
            " `read_recording` returned, a path, or `Trial(name, samples)` with a data frame in SI"
            " units"
        )
    for name, dtype in trial.samples.schema.items():
        if not (dtype.is_numeric() or dtype.is_(bool)):
            raise InputError(
                f"trial {trial.name}: column '{name}' holds {dtype}, expected numbers; convert or"
                " drop it"
            )
    return trial


@dataclass(frozen=True)
class FitArguments:
    """Arguments of `fit_trial`, by their names there."""

    experiment: str
    trial: Trial
    parameters: Path | None  # the device's file
    settings: Mapping[str, Any]
    limits: DoubtfulFits


def fit_arguments(
    experiment: str, trial: Trial | File, config: File | None, parameters: File | None
) -> FitArguments:
    """The arguments of `fit_trial`, from those of the functions below."""
    file = Path(config or config_here())
    if parameters == OF_CONFIG:
        device = campaign_parameters(file)
    else:
        device = None if parameters is None else shipped(parameters)
    settings, limits = fit_settings(experiment, file)
    return FitArguments(experiment, as_trial(trial), device, settings, limits)


def checked_desired(desired: DesiredImpedance | None) -> DesiredImpedance:
    if not isinstance(desired, DesiredImpedance | None):
        raise InputError(
            f"desired: {desired!r} is none; write DesiredImpedance(controller, K_d, B_d)"
        )
    return desired or DesiredImpedance(None, None, None)


@dataclass(frozen=True, eq=False, repr=False)
class ShownFit(Fit):
    """A `Fit` that a notebook shows: its text, which is escaped, and the picture of measured and
    modelled torque."""

    def _repr_html_(self) -> str:
        html = f"<pre>{escape(repr(self))}</pre>"
        if not self.series.is_empty():
            picture = b64encode(plot_torque(self)._repr_png_(100)).decode()
            html += (
                '<img alt="Torque over time" style="max-width: 100%"'
                f' src="data:image/png;base64,{picture}">'
            )
        return html


def shown_fit(
    arguments: FitArguments, condition: Any = None, windows: str | None = None
) -> ShownFit:
    """What `fit_trial` returns, as a notebook shows it."""
    fit = fit_trial(**vars(arguments), condition=condition, windows=windows)
    return ShownFit(**vars(fit))


def fit_impedance(
    trial: Trial | File,
    desired: DesiredImpedance | None = None,
    windows: str | None = None,
    config: File | None = None,
    parameters: File | None = OF_CONFIG,
) -> Fit:
    """K [N*m/rad], B [N*m*s/rad] and I [kg*m^2] of Eq. 15, torque = K theta + B omega + I alpha +
    offset.

    The rows are those of `impedance.csv`: one per amplitude of a stepped sine, and one over all of
    them.

    * `trial`: a trial with `theta` [rad] and the resisting `torque` [N*m], or its file.
    * `desired`: what the leg was asked to render, `DesiredImpedance("compensated", K_d=300,
      B_d=5)`. With it the fit is judged by what the gains should give. Without it `not_checked`
      says what is not judged.
    * `windows`: what of the trial is fitted [s], as in the column `windows` of a sample sheet;
      default: all that moves.
    * `config`: a configuration file, which states what differs from the default; default:
      `config.yaml` in the working folder, else the shipped one.
    * `parameters`: the parameter file of the device; default: that of the configuration; None: a
      device without one.

    Raises InputError: the trial lacks a signal, does not move, or follows a damaged stepped sine;
    or a file is not valid. IdentifiabilityError: the motion cannot tell K, B and I apart.
    UnreachableImpedanceError: no gains."""
    arguments = fit_arguments("impedance", trial, config, parameters)
    return shown_fit(arguments, checked_desired(desired), windows)


def fit_belt(
    trial: Trial | File, config: File | None = None, parameters: File | None = OF_CONFIG
) -> Fit:
    """The belt's stiffness K_s [N*m/rad] (Fig. 3) from `theta`, `theta_m` [rad] and `torque` [N*m]:
    the row of `belt.csv`. The rest as in `fit_impedance`; it needs a parameter file, for n_T."""
    return shown_fit(fit_arguments("belt", trial, config, parameters))


def fit_transmission(
    trial: Trial | File, config: File | None = None, parameters: File | None = OF_CONFIG
) -> Fit:
    """The transmission's damping B_j [N*m*s/rad] and inertia J_j [kg*m^2] (Eq. 4) from `theta`
    [rad] and `torque` [N*m] of a trial without motor: the rows of `transmission.csv`. The rest as
    in `fit_belt`."""
    return shown_fit(fit_arguments("transmission", trial, config, parameters))


def fit_actuator(
    trial: Trial | File, config: File | None = None, parameters: File | None = OF_CONFIG
) -> Fit:
    """The actuator (Eqs. 1-2) alone: k_tau n_m and f_G [N*m/A], f_C [N*m], B_m [N*m*s/rad], J_m
    [kg*m^2] from `current` [A], `torque_m` [N*m], and `theta_m` [rad] or `omega_m` [rad/s]: the row
    of `actuator.csv`. The rest as in `fit_belt`."""
    return shown_fit(fit_arguments("actuator", trial, config, parameters))


def fit_torque_angle(
    trial: Trial | File, curve: str | None = None, config: File | None = None
) -> Fit:
    """Torque over angle of a passive foot or a spring in slow cycles, K [N*m/rad], energies [J] and
    hysteresis, from `theta` [rad] and `torque` [N*m]: the row of `torque_angle.csv`, and in
    `curves` those of `torque_angle_curves.csv`. `curve` names that of the configuration that the
    device was designed for."""
    return shown_fit(fit_arguments("torque_angle", trial, config, None), {"desired": curve})


@dataclass(frozen=True, eq=False)
class Response:
    """The frequency response of one trial.

    * `table`: a row per frequency. Of a stepped sine those of `frequency_response.csv`, the
      admittance Y, angle over torque [rad/(N*m)], averaged over amplitudes. Of any other motion
      those of `response.csv`, the impedance Z, torque over angle [N*m/rad], with noise and
      distortion.
    * `plotted`: the numbers that `plot_frequency_response` draws"""

    trial: str
    figure: str  # fig7, or response of any other motion than a stepped sine
    table: pl.DataFrame
    plotted: pl.DataFrame


def frequency_response(
    trial: Trial | File,
    desired: DesiredImpedance | None = None,
    windows: str | None = None,
    config: File | None = None,
    parameters: File | None = OF_CONFIG,
) -> Response:
    """The frequency response of an impedance trial, with 95 % intervals of noise; arguments and
    errors as in `fit_impedance`. With `desired` the desired response (Eq. 11), and with the gains
    of a controller of the draft that of the drivetrain without friction (Eq. 9), are plotted
    too."""
    from osl_analysis.commands.figure import beside_theory
    from osl_analysis.figures.names import JOINT_SIDE, completed

    name_of_fits = "impedance"
    arguments = fit_arguments(name_of_fits, trial, config, parameters)
    recorded = arguments.trial
    device = arguments.parameters
    settings = arguments.settings
    limits = arguments.limits
    fit = run_fit(name_of_fits, recorded, device, settings, checked_desired(desired), windows)
    tables = fit.everything()
    fits = tables[name_of_fits]
    findings_of_fits = judged(fits, limits.of(name_of_fits), name_of_fits)

    def with_doubts(name: str) -> pl.DataFrame:
        """A table of the trial, marked with its own doubts and with those of the fits."""
        findings = judged(tables[name], limits.of(name), name)
        findings = with_inherited(name, tables[name], findings, fits, findings_of_fits)
        return marked(tables[name], findings, name)

    if tables["phasors"].is_empty():  # the motion is no stepped sine
        response = with_doubts("response")
        plotted = drawing_of("response").points(response)
        return Response(recorded.name, "response", response, plotted)
    table = frequency_response_table(with_doubts("phasors"))
    joint = pl.lit(joint_of(device) if device else None, pl.String)
    rows = completed(table.with_columns(joint=joint), JOINT_SIDE)
    return Response(recorded.name, "fig7", table, beside_theory(rows, device, settings["weight"]))


def read_recording(
    path: File, source: File, part: str | None = None, name: str | None = None
) -> Trial:
    """A trial from the raw log, or the capture, of one recorder, converted to SI units by its
    source file.

    path: the recording, or the folder of a split ROS 2 bag.
    source: the source file (YAML), or the name of a shipped one, such as "opensourceleg".
    part: the part of a log that holds several trials, such as a struct of a MATLAB file.
    name: name of the trial; default: that of the file.

    Raises InputError: a file is missing, or the recording is not what the source file says."""
    file, described = Path(path), Path(source)
    if not (described.suffix == ".yaml" and described.is_file()):
        described = shipped(Path("config/sources") / f"{source}.yaml")
    if not described.is_file():
        known = sorted(path.stem for path in shipped("config/sources").glob("*.yaml"))
        raise InputError(
            f"{source}: no such source file; give the path of a file that ends in .yaml, or one of"
            f" {', '.join(known)}{nearest(Path(source).stem, known)}"
        )
    role = "mocap" if isinstance(read_source(described), MarkerSource) else "log"
    if part is not None and role == "mocap":
        raise InputError(f"{file}: a capture has no part '{part}'; leave out `part`")
    if not file.exists():
        raise InputError(
            f"{file}: no such file; name the recording as seen from the folder {Path.cwd()}"
        )
    row = {
        "trial": file.stem if name is None else name,
        role: file.name,
        f"{role}_source": described.stem,
    }
    return checked_trial({**row, "log_part": part}, file.parent, described.parent)


def check(
    trial: Trial | File, experiment: str = "impedance", config: File | None = None
) -> pl.DataFrame:
    """The quality of a trial, and whether it has what `experiment` needs: a row per check, as in
    `quality.csv`.

    The section `quality` of `config` has the thresholds. Raises InputError: as `read_trial`; no
    such experiment; or the configuration is not valid."""
    if experiment not in EXPERIMENTS:
        known = ", ".join(EXPERIMENTS)
        raise InputError(
            f"no experiment '{experiment}'; it is one of {known}{nearest(experiment, EXPERIMENTS)}"
        )
    recorded = as_trial(trial)
    path = Path(config or config_here())
    rules = read_section(path, "quality", QualityRules)
    validate_rules(rules, UNITS)
    bench = read_section(path, "dynamometer", DynamometerAnalysis)
    commanded = Commanded(**{name: getattr(bench, name) for name in PROTOCOL})
    return judged_table(
        measured_table(recorded.name, examine(recorded, experiment, commanded)), rules, {}
    )


def simulate_trial(
    folder: File, trial: str, settings: File = "config/simulation/default.yaml"
) -> tuple[Path, str]:
    """Simulate one bench trial into a folder: its log, and the name of its source file.

    `trial` is a name of the plan, such as "impedance_K300_B5.0_compensated", and `settings` a file
    of the simulator. `read_recording(*simulate_trial(...))` is the trial. What is true of it is in
    `truth/TRIAL.json`. Raises InputError: the settings plan no such trial, it is not of a bench, or
    the folder has recordings that the simulator did not make.
    """
    from osl_analysis.commands import simulate  # half a second, which only this needs

    path, place = shipped(settings), Path(folder)
    row = simulate.row_of_trial(simulate.read_simulation(path, simulate.UNFOLLOWED), path, trial)
    if EXPERIMENTS[row["experiment"]].place != "bench":
        raise InputError(
            f"trial {trial}: is of the walkway; simulate a campaign (`osl-analysis simulate`) and"
            " run it"
        )
    simulate.simulate_trial(path, place, trial)
    return place / str(row["log"]), str(row["log_source"])


def read_summary(folder: File = "results") -> pl.DataFrame:
    """The headline numbers of a campaign from the folder of its results, walking among them: a row
    per number with its `unit`, 95 % interval `low` to `high`, and what else `summary.json` says of
    it. Raises InputError where there is no summary, or it is damaged."""
    numbers = tables_of_campaign.read_summary(Path(folder, "summary.json"))["numbers"]
    return pl.DataFrame(
        [{"quantity": name, **entry} for name, entry in numbers.items()], infer_schema_length=None
    )


def drawn(name: str, table: pl.DataFrame) -> "NotebookFigure":
    from osl_analysis.figures.style import NotebookFigure  # matplotlib takes half a second

    figure = drawing_of(name).draw(table)
    figure.__class__ = NotebookFigure
    return cast(NotebookFigure, figure)


def plot_torque(fit: Fit) -> "NotebookFigure":
    """Measured and modelled torque [N*m] of a fit over time [s], and below the residual: a
    matplotlib `Figure`."""
    return drawn("torque", fit.series)


def plot_frequency_response(response: Response) -> "NotebookFigure":
    """Magnitude and phase over frequency [Hz] with 95 % intervals: Fig. 7, or the figure
    `response`, with noise and distortion, of any other motion than a stepped sine."""
    if response.plotted.is_empty():
        raise InputError(
            f"trial {response.trial}: no frequency response to draw; move the joint further, or for"
            " longer"
        )
    return drawn(response.figure, response.plotted)


def plot_torque_angle(*fits: Fit) -> "NotebookFigure":
    """Torque [N*m] over angle [deg], loading and unloading, and stiffness [N*m/rad] over angle, of
    several trials."""
    curves = [
        fit.curves for fit in fits if fit.experiment == "torque_angle" and fit.curves is not None
    ]
    if len(curves) < len(fits) or not fits:
        given = ", ".join(fit.experiment for fit in fits) or "no fit"
        raise InputError(f"torque over angle needs what `fit_torque_angle` returns, not {given}")
    names = [fit.trial for fit in fits]
    if len(set(names)) < len(names):
        raise InputError(
            f"two fits are of trials of one name, {listing(names)}; name each trial differently"
        )
    all_curves = pl.concat(curves, how="diagonal_relaxed")
    all_rows = pl.concat([fit.table for fit in fits], how="diagonal_relaxed")
    return drawn("torque_angle", drawing_of("torque_angle").points(all_curves, all_rows))
