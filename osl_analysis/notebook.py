# SPDX-License-Identifier: Apache-2.0
"""The functions of `import osl_analysis as osl`, for notebooks and scripts without a workflow.

They call the functions that the jobs of a campaign call, so that their numbers are those of its
tables.

Example: `osl.fit("trial.parquet", "belt").K_s`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard

import polars as pl

from osl_analysis.base.errors import InputError, listing
from osl_analysis.base.files import shipped
from osl_analysis.base.result_table import read_table
from osl_analysis.base.trial import Trial, read_trial
from osl_analysis.base.yaml_settings import check_known
from osl_analysis.bench.evidence import UNSTATED, DesiredImpedance
from osl_analysis.campaign.configuration import OF_CONFIG, config_for_trials
from osl_analysis.commands.fit import checks_of, fit_trial, run_fit
from osl_analysis.commands.fit_results import Fit, estimated, printed_units
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.figures.drawing import drawn, look_numbers, plotted_columns, plotted_numbers
from osl_analysis.judge.joining import findings_of_rows, with_findings, with_texts
from osl_analysis.judge.judging import judged
from osl_analysis.model.drivetrain import joint_of
from osl_analysis.stats.rounding import estimate_text

if TYPE_CHECKING:
    from osl_analysis.figures.style import PaperFigure as Figure

File = str | Path
PARQUET_BEGINS = b"PAR1"  # the first bytes of a stored trial


def as_trial(trial: Trial | File) -> Trial:
    if isinstance(trial, Path | str):
        return read_trial(trial)
    if not isinstance(trial, Trial):
        raise InputError(
            f"a trial is needed, not {type(trial).__name__}",
            "give what `read_trial` or `read_recording` returned, a path, or `Trial(name,"
            " samples)` with a data frame in SI units",
        )
    for name, dtype in trial.samples.schema.items():
        if not (dtype.is_numeric() or dtype.is_(bool)):
            raise InputError(
                f"trial {trial.name}: column '{name}' holds {dtype}, expected numbers",
                "convert or drop it",
            )
    return trial


def fit(
    trial: Trial | File,
    experiment: str = "impedance",
    desired: DesiredImpedance | None = None,
    windows: str | None = None,
    config: File | None = None,
    parameters: File | None = OF_CONFIG,
    curve: str | None = None,
    sign: int | None = None,
) -> Fit:
    """Fit a trial of an experiment, as a campaign does.

    Parameters
    ----------
    trial : Trial or Path or str
        A trial in SI units, or its Parquet file; or a CSV file whose columns are named by signal
        and unit, as `time_s,theta_deg,torque_Nm`, in any known units. `impedance`, `transmission`
        and `torque_angle` need `theta` [rad] and the resisting `torque` [N*m]; `belt` needs
        `theta_m` [rad] too; `actuator` needs `current` [A], `torque_m` [N*m], and `theta_m` [rad]
        or `omega_m` [rad/s].
    experiment : str
        As in the column `experiment` of a sample sheet:

        * `impedance`: K, B and I of Eq. 15, torque = K theta + B omega + I alpha + offset,
        * `belt`: the belt's stiffness K_s (Fig. 3),
        * `transmission`: damping B_j and inertia J_j (Eq. 4) of a trial without motor,
        * `actuator`: the actuator alone (Eqs. 1-2), at its output,
        * `torque_angle`: torque over angle of a passive foot or a spring in slow cycles.
    desired : DesiredImpedance or None
        The impedance that the leg was asked to render. With it the fit is compared with what the
        gains should give. None: `remarks` says what is not judged.
    windows : str or None
        The fitted parts of the trial [s], as in the column `windows` of a sample sheet,
        "2-30 40-62". None: all parts that move.
    config : Path or str or None
        A configuration file with the settings that differ from the default. None: `config.yaml`
        in the working folder, else the shipped one.
    parameters : Path or str or None
        The parameter file of the device; default: that of the configuration. None: a device without
        one. A belt needs one, for n_T.
    curve : str or None
        Name of the curve of the configuration that the device of a torque_angle trial was designed
        for.
    sign : int or None
        Sign of the torque in a CSV file: 1 if it is the joint's resisting torque, positive when it
        opposes positive motion, -1 if it is the opposite.

    Returns
    -------
    Fit
        Its rows are those of the experiment's table in a campaign.

    Raises
    ------
    InputError
        The trial lacks a signal, does not move, or follows a damaged stepped sine; no such
        experiment; a file is not valid; or a CSV file is given without `sign`: the error says which
        one its motion suggests.
    IdentifiabilityError
        The motion does not determine the estimates, or the belt is not loaded enough.
    UnreachableImpedanceError
        No gains render `desired`.

    Examples
    --------
    >>> fit = osl.fit(trial, desired=osl.DesiredImpedance("compensated", K_d=300, B_d=5))
    >>> print(f"K {fit.K:.0f} N*m/rad")
    K 300 N*m/rad
    >>> print(f"K {osl.fit('knee.csv', sign=-1).K:.0f} N*m/rad")
    K 93 N*m/rad
    >>> print(f"K_s {osl.fit(belt_trial, 'belt').K_s:.0f} N*m/rad")
    K_s 686 N*m/rad
    """
    condition: Any = None
    check_known(EXPERIMENTS, "experiment", experiment)
    if experiment == "impedance":
        condition = desired or UNSTATED
    elif desired is not None:
        raise InputError(
            f"a fit of {experiment} has no desired impedance",
            "leave it out",
            settings=[*vars(desired)],
        )
    elif experiment == "torque_angle":
        condition = {"desired": curve}
    settings = config_for_trials(config, parameters)

    def fit_of(recorded: Trial) -> Fit:
        return fit_trial(experiment, recorded, settings.parameters, settings, condition, windows)

    if is_table_of_rows(trial):
        return fit_of(trial_with_sign(Path(trial), sign, fit_of))
    if sign is not None:
        raise InputError(
            f"sign={sign}: a trial, or its Parquet file, has the sign that its source file states",
            "leave out `sign`",
        )
    return fit_of(as_trial(trial))


def is_table_of_rows(trial: Trial | File) -> TypeGuard[File]:
    """Whether a recording is given, in place of a trial or of its Parquet file."""
    if not isinstance(trial, Path | str):
        return False
    path = Path(trial)
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(PARQUET_BEGINS)) != PARQUET_BEGINS


def trial_with_sign(path: Path, sign: int | None, fit_of: Callable[[Trial], Fit]) -> Trial:
    """The trial of a table with named columns. Raises InputError without a sign, which names the
    one with which `fit_of` gives possible estimates."""
    from osl_analysis.commands.named_columns import SIGNS, sign_not_stated, trial_of_named_columns

    def first_estimate(trial: Trial) -> str:
        row = fit_of(trial).row
        name = estimated(row)[0]
        return f"{name} {estimate_text(row, name)} {printed_units()[name]}"

    if sign is None:
        raise sign_not_stated(path, first_estimate)
    if sign not in SIGNS:
        raise InputError(
            f"sign={sign}: the torque is the resisting one, or its opposite", "1 or -1"
        )
    return trial_of_named_columns(path, sign)


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """The frequency response of one trial.

    Attributes
    ----------
    trial : str
        Name of the trial.
    table : polars.DataFrame
        The rows of `response.csv`, the admittance Y, angle over torque [rad/(N*m)], at each
        frequency: of the whole trial, and of each amplitude of a stepped sine.
    plotted : polars.DataFrame
        The numbers that are drawn.

    Examples
    --------
    >>> response = osl.frequency_response(trial)
    >>> set(response.table["scope"])
    {'all'}
    """

    trial: str
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
        As in `fit`.
    desired : DesiredImpedance or None
        With it the desired response (Eq. 11) is plotted too. If it names a controller of the draft,
        so is the response that its gains give to the drivetrain without friction (Eq. 9).
    windows, config, parameters
        As in `fit`.

    Returns
    -------
    FrequencyResponse
        Magnitude [rad/(N*m)] and phase [deg] over frequency [Hz].

    Raises
    ------
    InputError, IdentifiabilityError, UnreachableImpedanceError
        As `fit`.

    Examples
    --------
    >>> response = osl.frequency_response(trial)
    >>> response.table["frequency_hz"].is_sorted()
    True
    """
    from osl_analysis.commands.figure import fig7_points

    recorded = as_trial(trial)
    settings = config_for_trials(config, parameters)
    device = settings.parameters
    fitted = run_fit("impedance", recorded, device, settings, desired or UNSTATED, windows)
    tables = fitted.everything()
    fits, response = tables["impedance"], tables["response"]

    limits = settings.doubtful.of("impedance")
    findings = list(chain(*judged(fits, limits, "impedance", budget=tables["budget"])))
    about_rows = findings_of_rows(response, findings, "response")
    table = with_texts(response, about_rows, "response")
    rows = with_findings(table, about_rows).with_columns(
        look_numbers(table["controller"]),
        joint=pl.lit(joint_of(device) if device else None, pl.String),
        side=pl.lit(None, pl.String),
    )
    # W of Eq. 14, a low-pass of a cut-off [Hz], chooses the gains
    return FrequencyResponse(recorded.name, table, fig7_points(rows, device, settings.gain_weight))


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
    # the formats, which the fit of a stored trial does not need
    from osl_analysis.base.source_file import MarkerSource
    from osl_analysis.commands.trials import checked_trial
    from osl_analysis.ingest.raw_files import read_source

    file = Path(path)
    described = Path(source)
    if not (described.suffix == ".yaml" and described.is_file()):
        known = {path.stem: path for path in sorted(shipped("config/sources").glob("*.yaml"))}
        kind = "source file (YAML), and no shipped one"
        described = known[check_known(known, kind, str(source))]
    role = "mocap" if isinstance(read_source(described), MarkerSource) else "log"
    if part is not None and role == "mocap":
        raise InputError(f"{file}: a capture has no part '{part}'", "leave out `part`")
    row = {
        "trial": file.stem if name is None else name,
        role: file.name,
        f"{role}_source": described.stem,
        "log_part": part,
    }
    return checked_trial(row, file.parent, described.parent)


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
        A configuration, whose section `quality` has the thresholds; None: as in `fit`.

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
    check_known(EXPERIMENTS, "experiment", experiment)
    return checks_of(experiment, as_trial(trial), config_for_trials(config))


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
            f"trial {trial}: is of the walkway",
            "simulate a campaign (`osl-analysis simulate`) and run it",
        )
    simulate.simulate_planned_trial(path, place, trial)
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
    from osl_analysis.commands.tables import read_summary_file  # takes as long as a fit

    numbers = read_summary_file(Path(folder, "summary.json"))["numbers"]
    return pl.DataFrame(
        [{"quantity": name, **entry} for name, entry in numbers.items()], infer_schema_length=None
    )


def plot_torque(fit: Fit) -> "Figure":
    """Draw angle [deg], measured and modelled torque, and residual [N*m] of a fit over time [s].

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
    >>> osl.plot_torque(osl.fit(belt_trial, "belt")).savefig("torque.pdf")
    """
    if fit.series.is_empty():
        raise InputError(f"a fit of {fit.experiment} has no modelled torque to draw")
    return fit.drawing


def plot_frequency_response(response: FrequencyResponse) -> "Figure":
    """Draw magnitude and phase [deg] over frequency [Hz] with 95 % intervals, and the distance from
    the desired impedance where it is known, as Fig. 7.

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
            f"trial {response.trial}: no frequency response to draw",
            "move the joint further, or for longer",
        )
    return drawn("fig7", response.plotted)


def plot_torque_angle(*fits: Fit) -> "Figure":
    """Draw torque [N*m] over angle [deg], loading and unloading, and stiffness [N*m/rad] over
    angle.

    Parameters
    ----------
    *fits : Fit
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
    >>> figure = osl.plot_torque_angle(osl.fit(foot, "torque_angle"))
    """
    if {fit.experiment for fit in fits} != {"torque_angle"}:
        raise InputError("torque over angle needs fits of `torque_angle`, and no others")
    names = [fit.trial for fit in fits]
    if len(set(names)) < len(names):
        raise InputError(
            f"two fits are of trials of one name, {listing(names)}", "name each trial differently"
        )
    curves = [fit.curves for fit in fits if fit.curves is not None]
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
    >>> figure = osl.plot_figure("results/figures/fig8.csv")
    >>> figure.axes[0].set_title("Day 1")
    Text(0.5, 1.0, 'Day 1')
    """
    path = Path(numbers)
    table = read_table(path, list(plotted_columns(path.stem)))
    if table.is_empty():
        raise InputError(
            f"{path}: no numbers to draw", "run the campaign with trials that it shows"
        )
    return drawn(path.stem, table)
