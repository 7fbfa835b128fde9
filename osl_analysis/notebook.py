"""The functions of `import osl_analysis as osl`, for notebooks and scripts that need no workflow.
They call what the jobs of a campaign call: their numbers are those of its tables."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars as pl

from osl_analysis.bench.bench_settings import DynamometerAnalysis
from osl_analysis.bench.frequency_response import frequency_response_table
from osl_analysis.bench.impedance import DesiredImpedance
from osl_analysis.campaign.configuration import read_section
from osl_analysis.commands import tables as tables_of_campaign
from osl_analysis.commands.fit import campaign_parameters, fit_settings, fit_trial, run_fit
from osl_analysis.commands.fit_results import (
    ActuatorFit,
    BeltFit,
    Fit,
    ImpedanceFit,
    TorqueAngleFit,
    TransmissionFit,
)
from osl_analysis.commands.trials import checked_trial
from osl_analysis.config.experiments import EXPERIMENTS, PROTOCOL
from osl_analysis.errors import InputError, listing, nearest
from osl_analysis.figures import columns_of, drawn, look_numbers, plotted_numbers
from osl_analysis.files import config_here, shipped
from osl_analysis.ingest.examine import UNITS, Commanded, examine, measured_table
from osl_analysis.ingest.raw_files import read_source
from osl_analysis.judge.judging import judged, marked, with_inherited
from osl_analysis.judge.recording_checks import QualityRules, judged_table, validate_rules
from osl_analysis.model.drivetrain import joint_of
from osl_analysis.schema import read_table
from osl_analysis.source_file import MarkerSource
from osl_analysis.trial import Trial, read_trial

if TYPE_CHECKING:
    from osl_analysis.figures.style import PaperFigure as Figure

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


def device_file(parameters: File | None, config: Path) -> Path | None:
    """The parameter file that is stated, or that of the configuration."""
    if parameters == OF_CONFIG:
        return campaign_parameters(config)
    return None if parameters is None else shipped(parameters)


def checked_desired(desired: DesiredImpedance | None) -> DesiredImpedance:
    if not isinstance(desired, DesiredImpedance | None):
        raise InputError(
            f"desired is of type {type(desired).__name__}, not a DesiredImpedance; write"
            " DesiredImpedance(controller, K_d, B_d)"
        )
    return desired or DesiredImpedance(None, None, None)


def fitted(
    experiment: str,
    trial: Trial | File,
    config: File | None,
    parameters: File | None,
    condition: Any = None,
    windows: str | None = None,
) -> Any:
    """Fit a trial of an experiment; the arguments are those of the functions below."""
    file = Path(config or config_here())
    device = device_file(parameters, file)
    settings, limits = fit_settings(experiment, file)
    return fit_trial(experiment, as_trial(trial), device, settings, limits, condition, windows)


def fit_impedance(
    trial: Trial | File,
    desired: DesiredImpedance | None = None,
    windows: str | None = None,
    config: File | None = None,
    parameters: File | None = OF_CONFIG,
) -> ImpedanceFit:
    """Fit K, B and I of Eq. 15, torque = K theta + B omega + I alpha + offset.

    Parameters
    ----------
    trial : Trial or Path or str
        With `theta` [rad] and the resisting `torque` [N*m], or its Parquet file.
    desired : DesiredImpedance or None
        What the leg was asked to render. With it the fit is judged by what the gains should give.
        None: `remarks` says what is not judged.
    windows : str or None
        What of the trial is fitted [s], as in the column `windows` of a sample sheet, "2-30 40-62".
        None: all that moves.
    config : Path or str or None
        A configuration file, which states what differs from the default. None: `config.yaml` in
        the working folder, else the shipped one.
    parameters : Path or str or None
        The parameter file of the device; default: that of the configuration. None: a device without
        one.

    Returns
    -------
    ImpedanceFit
        Its rows are those of `impedance.csv`: one per amplitude of a stepped sine, and one over all
        of them. K in N*m/rad, B in N*m*s/rad, I in kg*m^2.

    Raises
    ------
    InputError
        The trial lacks a signal, does not move, or follows a damaged stepped sine; or a file is not
        valid.
    IdentifiabilityError
        The motion cannot tell K, B and I apart.
    UnreachableImpedanceError
        No gains render `desired`.

    Examples
    --------
    >>> fit = osl.fit_impedance(trial, osl.DesiredImpedance("compensated", K_d=300, B_d=5))
    >>> print(f"K {fit.K:.0f} N*m/rad")
    K 300 N*m/rad
    """
    condition = checked_desired(desired)
    fit: ImpedanceFit = fitted("impedance", trial, config, parameters, condition, windows)
    return fit


def fit_belt(
    trial: Trial | File, config: File | None = None, parameters: File | None = OF_CONFIG
) -> BeltFit:
    """Fit the belt's stiffness K_s (Fig. 3).

    Parameters
    ----------
    trial : Trial or Path or str
        With `theta`, `theta_m` [rad] and `torque` [N*m], or its file.
    config, parameters
        As in `fit_impedance`; it needs a parameter file, for n_T.

    Returns
    -------
    BeltFit
        The row of `belt.csv`; K_s in N*m/rad.

    Raises
    ------
    InputError
        As `fit_impedance`.
    IdentifiabilityError
        The belt is not loaded enough.

    Examples
    --------
    >>> fit = osl.fit_belt(belt_trial)
    >>> print(f"K_s {fit.K_s:.0f} N*m/rad")
    K_s 686 N*m/rad
    """
    fit: BeltFit = fitted("belt", trial, config, parameters)
    return fit


def fit_transmission(
    trial: Trial | File, config: File | None = None, parameters: File | None = OF_CONFIG
) -> TransmissionFit:
    """Fit the transmission's damping B_j and inertia J_j (Eq. 4) to a trial without motor.

    Parameters
    ----------
    trial : Trial or Path or str
        With `theta` [rad] and `torque` [N*m], or its file.
    config, parameters
        As in `fit_impedance`.

    Returns
    -------
    TransmissionFit
        The rows of `transmission.csv`; B_j in N*m*s/rad, J_j in kg*m^2.

    Raises
    ------
    InputError, IdentifiabilityError
        As `fit_impedance`.

    Examples
    --------
    >>> fit = osl.fit_transmission(motorless_trial)
    >>> print(f"B_j {fit.B_j:.1f} N*m*s/rad")
    B_j 0.5 N*m*s/rad
    """
    fit: TransmissionFit = fitted("transmission", trial, config, parameters)
    return fit


def fit_actuator(
    trial: Trial | File, config: File | None = None, parameters: File | None = OF_CONFIG
) -> ActuatorFit:
    """Fit the actuator alone (Eqs. 1-2), at its output.

    Parameters
    ----------
    trial : Trial or Path or str
        With `current` [A], `torque_m` [N*m], and `theta_m` [rad] or `omega_m` [rad/s], or its file.
    config, parameters
        As in `fit_impedance`.

    Returns
    -------
    ActuatorFit
        The row of `actuator.csv`; k_tau_n_m and f_G in N*m/A, f_C in N*m, B_m in N*m*s/rad, J_m in
        kg*m^2.

    Raises
    ------
    InputError, IdentifiabilityError
        As `fit_impedance`.

    Examples
    --------
    >>> fit = osl.fit_actuator(actuator_trial)
    >>> print(f"k_tau n_m {fit.k_tau_n_m:.2f} N*m/A")
    k_tau n_m 1.02 N*m/A
    """
    fit: ActuatorFit = fitted("actuator", trial, config, parameters)
    return fit


def fit_torque_angle(
    trial: Trial | File, curve: str | None = None, config: File | None = None
) -> TorqueAngleFit:
    """Fit torque over angle of a passive foot or a spring in slow cycles.

    Parameters
    ----------
    trial : Trial or Path or str
        With `theta` [rad] and `torque` [N*m], or its file.
    curve : str or None
        Name of the curve of the configuration that the device was designed for.
    config
        As in `fit_impedance`.

    Returns
    -------
    TorqueAngleFit
        The row of `torque_angle.csv`, and in `curves` those of `torque_angle_curves.csv`; K in
        N*m/rad, energies in J.

    Raises
    ------
    InputError
        As `fit_impedance`; or the cycles are too fast, or none is whole.

    Examples
    --------
    >>> fit = osl.fit_torque_angle(foot)
    >>> print(f"K {fit.K:.0f} N*m/rad")
    K 200 N*m/rad
    """
    fit: TorqueAngleFit = fitted("torque_angle", trial, config, None, {"desired": curve})
    return fit


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """The frequency response of one trial.

    Attributes
    ----------
    trial : str
        Name of the trial.
    figure : str
        Figure that `plot_frequency_response` draws: `fig7`, or `response` of any other motion than
        a stepped sine.
    table : polars.DataFrame
        A row per frequency. Of a stepped sine those of `frequency_response.csv`, the admittance Y,
        angle over torque [rad/(N*m)], averaged over amplitudes. Of any other motion those of
        `response.csv`, the impedance Z, torque over angle [N*m/rad], with noise and distortion.
    plotted : polars.DataFrame
        The numbers that are drawn.

    Examples
    --------
    >>> response = osl.frequency_response(trial)
    >>> response.figure
    'response'
    """

    trial: str
    figure: str
    table: pl.DataFrame
    plotted: pl.DataFrame


def frequency_response(
    trial: Trial | File,
    desired: DesiredImpedance | None = None,
    windows: str | None = None,
    config: File | None = None,
    parameters: File | None = OF_CONFIG,
) -> FrequencyResponse:
    """Compute the frequency response of an impedance trial, with 95 % intervals of noise.

    Parameters
    ----------
    trial : Trial or Path or str
        As in `fit_impedance`.
    desired : DesiredImpedance or None
        With it the desired response (Eq. 11) is plotted too. If it names a controller of the draft,
        so is the response that its gains give to the drivetrain without friction (Eq. 9).
    windows, config, parameters
        As in `fit_impedance`.

    Returns
    -------
    FrequencyResponse
        Magnitude [rad/(N*m) or N*m/rad] and phase [deg] over frequency [Hz].

    Raises
    ------
    InputError, IdentifiabilityError, UnreachableImpedanceError
        As `fit_impedance`.

    Examples
    --------
    >>> response = osl.frequency_response(trial)
    >>> response.table["frequency_hz"].is_sorted()
    True
    """
    from osl_analysis.commands.figure import beside_theory

    name_of_fits = "impedance"
    recorded = as_trial(trial)
    file = Path(config or config_here())
    device = device_file(parameters, file)
    settings, limits = fit_settings(name_of_fits, file)
    fit = run_fit(name_of_fits, recorded, device, settings, checked_desired(desired), windows)
    tables = fit.everything()
    fits = tables[name_of_fits]
    findings_of_fits = judged(fits, limits.of(name_of_fits), name_of_fits)

    def with_doubts(name: str) -> pl.DataFrame:
        """A table of the trial, marked with its own doubts and with those of the fits."""
        findings = judged(tables[name], limits.of(name), name)
        findings = with_inherited(tables[name], findings, fits, findings_of_fits)
        return marked(tables[name], findings, name)

    if tables["phasors"].is_empty():  # the motion is no stepped sine
        response = with_doubts("response")
        plotted = plotted_numbers("response", response)
        return FrequencyResponse(recorded.name, "response", response, plotted)
    table = frequency_response_table(with_doubts("phasors"))
    joint = pl.lit(joint_of(device) if device else None, pl.String)
    no_side = pl.lit(None, pl.String)
    looks = look_numbers(table["controller"])
    rows = table.with_columns(looks, joint=joint, side=no_side)
    gain_weight = settings["weight"]  # W of Eq. 14, a low-pass of a cut-off [Hz], chooses the gains
    plotted = beside_theory(rows, device, gain_weight)
    return FrequencyResponse(recorded.name, "fig7", table, plotted)


def read_recording(
    path: File, source: File, part: str | None = None, name: str | None = None
) -> Trial:
    """Read the raw log, or the capture, of one recorder, converted to SI units by its source file.

    Parameters
    ----------
    path : Path or str
        The recording, or the folder of a split ROS 2 bag.
    source : Path or str
        The source file (YAML), or the name of a shipped one, such as "opensourceleg".
    part : str or None
        The part of a log that holds several trials, such as a struct of a MATLAB file.
    name : str or None
        Name of the trial; None: that of the file.

    Returns
    -------
    Trial
        Its samples have the columns that the source file names, in SI units.

    Raises
    ------
    InputError
        A file is missing, or the recording is not what the source file says.

    Examples
    --------
    >>> trial = osl.read_recording("bench.csv", "bench.yaml", name="day 1")
    >>> trial.name, trial.samples.columns
    ('day 1', ['time', 'theta', 'torque'])
    """
    file = Path(path)
    described = Path(source)
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
    """Check the quality of a trial, and whether it has what an experiment needs.

    Parameters
    ----------
    trial : Trial or Path or str
    experiment : str
        As in the column `experiment` of a sample sheet.
    config : Path or str or None
        A configuration, whose section `quality` has the thresholds; None: as in `fit_impedance`.

    Returns
    -------
    polars.DataFrame
        A row per check, as in `quality.csv`: `check`, `value`, `unit`, `threshold`, `verdict`, ...

    Raises
    ------
    InputError
        As `read_trial`; no such experiment; or the configuration is not valid.

    Examples
    --------
    >>> quality = osl.check(trial)
    >>> quality.filter(check="gap")["verdict"].item()
    'pass'
    """
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
    """Simulate one bench trial into a folder.

    Parameters
    ----------
    folder : Path or str
        What is true of the trial is written there to `truth/TRIAL.json`.
    trial : str
        A name of the plan, such as "impedance_K300_B5.0_compensated".
    settings : Path or str
        A file of the simulator.

    Returns
    -------
    (Path, str)
        Its log, and the name of its source file: `read_recording(*simulate_trial(...))` is the
        trial.

    Raises
    ------
    InputError
        The settings plan no such trial, it is not of a bench, or the folder has recordings that the
        simulator did not make.

    Examples
    --------
    >>> log, source = osl.simulate_trial("example", "belt_01", "tiny.yaml")
    >>> log.name, source
    ('belt_01.mcap', 'dynamometer')
    """
    from osl_analysis.commands import simulate  # half a second, which only this needs

    path = shipped(settings)
    place = Path(folder)
    row = simulate.row_of_trial(simulate.read_simulation(path, simulate.UNFOLLOWED), path, trial)
    if EXPERIMENTS[row["experiment"]].place != "bench":
        raise InputError(
            f"trial {trial}: is of the walkway; simulate a campaign (`osl-analysis simulate`) and"
            " run it"
        )
    simulate.simulate_trial(path, place, trial)
    return place / str(row["log"]), str(row["log_source"])


def read_summary(folder: File = "results") -> pl.DataFrame:
    """Read the headline numbers of a campaign, walking among them.

    Parameters
    ----------
    folder : Path or str
        Of its results.

    Returns
    -------
    polars.DataFrame
        A row per number: `quantity`, `value` in its `unit`, 95 % interval `low` to `high`, and what
        else `summary.json` says of it.

    Raises
    ------
    InputError
        There is no summary, it is damaged, or of another release.

    Examples
    --------
    >>> numbers = osl.read_summary("results")
    >>> numbers.filter(quantity="K_s").select("value", "unit").row(0)
    (685.6, 'N*m/rad')
    """
    numbers = tables_of_campaign.read_summary(Path(folder, "summary.json"))["numbers"]
    return pl.DataFrame(
        [{"quantity": name, **entry} for name, entry in numbers.items()], infer_schema_length=None
    )


def plot_torque(fit: Fit) -> "Figure":
    """Draw measured and modelled torque [N*m] of a fit over time [s], and below the residual.

    Parameters
    ----------
    fit : Fit
        Of any experiment.

    Returns
    -------
    matplotlib.figure.Figure
        It saves itself in the style of the paper.

    Examples
    --------
    >>> osl.plot_torque(osl.fit_belt(belt_trial)).savefig("torque.pdf")
    """
    return drawn("torque", fit.series)


def plot_frequency_response(response: FrequencyResponse) -> "Figure":
    """Draw magnitude and phase [deg] over frequency [Hz] with 95 % intervals: Fig. 7, or the figure
    `response`, with noise and distortion, of any other motion than a stepped sine.

    Parameters
    ----------
    response : FrequencyResponse

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        There is no frequency to draw.

    Examples
    --------
    >>> figure = osl.plot_frequency_response(osl.frequency_response(trial))
    """
    if response.plotted.is_empty():
        raise InputError(
            f"trial {response.trial}: no frequency response to draw; move the joint further, or for"
            " longer"
        )
    return drawn(response.figure, response.plotted)


def plot_torque_angle(*fits: TorqueAngleFit) -> "Figure":
    """Draw torque [N*m] over angle [deg], loading and unloading, and stiffness [N*m/rad] over
    angle.

    Parameters
    ----------
    *fits : TorqueAngleFit
        Of trials of different names.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        There is no fit, one is of another experiment, or two have one name.

    Examples
    --------
    >>> figure = osl.plot_torque_angle(osl.fit_torque_angle(foot))
    """
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
    return drawn("torque_angle", plotted_numbers("torque_angle", all_curves, all_rows))


def plot_figure(numbers: File) -> "Figure":
    """Draw a figure of a campaign, of the bench or of walking, to change it.

    Parameters
    ----------
    numbers : Path or str
        Its plotted numbers, such as `results/figures/fig5.csv`; the name of the file says which
        figure it is.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        The file is missing or was refused, there is no such figure, or it shows nothing.

    Examples
    --------
    >>> figure = osl.plot_figure("results/figures/torque.csv")
    >>> figure.axes[0].set_title("Day 1")
    Text(0.5, 1.0, 'Day 1')
    """
    path = Path(numbers)
    table = read_table(path, list(columns_of(path.stem)))
    if table.is_empty():
        raise InputError(f"{path}: no numbers to draw; run the campaign with trials that it shows")
    return drawn(path.stem, table)
