"""For notebooks: control gains, the results that a campaign has written, and figures of results."""

from collections.abc import Sequence

import numpy as np
import polars as pl

from osl_analysis.commands.figure import figure_module
from osl_analysis.commands.gains import Request, requested_gains
from osl_analysis.commands.summarise import read_summary as read_summary_file
from osl_analysis.config import read_section
from osl_analysis.errors import InputError, listing
from osl_analysis.figures.style import NotebookFigure, on_screen
from osl_analysis.notebook.fits import OF_CONFIG, File, Fit, Response, config_of, device_of, path_of
from osl_analysis.shared_choices import WeightSettings
from osl_analysis.table import read_table as read_table_file

Numbers = float | Sequence[float]


def gains(K_d: Numbers, B_d: Numbers, parameters: File | None = OF_CONFIG, config: File | None = None) -> pl.DataFrame:
    """Control gains for desired stiffnesses K_d [N*m/rad] and dampings B_d [N*m*s/rad], a row per combination.

    As `osl-analysis gains`: `K_1` and `B_1` at the actuator's output (Eqs. 13 and 14), `K_1_joint` and `B_1_joint` at
    the joint, and what theory predicts for them: `K_predicted`, `faithful_to_hz`, `delay_margin` and more
    (`describe-tables`). `parameters` and `config` as in `fit_impedance`; the configuration has W of Eq. 14.

    Raises InputError: there is no parameter file, or a file is not valid. Raises UnreachableImpedanceError: no
    gains render one of the pairs, as K_d from K_s up.
    """
    path = config_of(config)
    device, weight = device_of(parameters, path), read_section(path, "gain_weight", WeightSettings).weight
    if device is None:
        raise InputError("gains need a parameter file; name the one of your device as `parameters`")
    return requested_gains(
        Request(numbers("K_d", K_d), numbers("B_d", B_d), None, weight.cutoff_hz, weight.order), device
    )


def numbers(name: str, values: Numbers) -> list[float]:
    try:
        found = [float(value) for value in np.ravel(values)]
    except (TypeError, ValueError):
        found = []
    if not found or not np.isfinite(found).all():
        raise InputError(f"{name}: {values!r} is not a finite number, or several of them; correct it")
    return found


def read_summary(folder: File = "results") -> pl.DataFrame:
    """The headline numbers of a campaign from the folder of its results, walking among them: a row per number.

    `quantity`, `value`, `unit`, the 95 % interval `low` to `high` and what else `summary.json` says of it. Walking
    needs all crossings of a campaign, plate and static trials: there is no `fit_walking` of a single crossing.

    Raises InputError: there is no summary, or it is damaged.
    """
    numbers = read_summary_file(path_of(folder, "folder") / "summary.json")["numbers"]
    return pl.DataFrame([{"quantity": name, **entry} for name, entry in numbers.items()], infer_schema_length=None)


def read_table(path: File) -> pl.DataFrame:
    """A result table of a campaign, such as `results/tables/impedance.csv`; `osl-analysis describe-tables` explains it.

    Raises InputError: the table is missing, is no CSV, or was refused; the message says why.
    """
    return read_table_file(path_of(path, "path"))


def plot_torque(fit: Fit) -> NotebookFigure:
    """Measured and modelled torque [N*m] of a fit over time [s], and below the residual.

    Returns a matplotlib `Figure`, which a notebook shows and `figure.savefig("torque.pdf")` saves as a campaign does.

    Raises InputError: it is given another thing than a fit.
    """
    return drawn("torque", checked(fit).series)


def plot_frequency_response(response: Response) -> NotebookFigure:
    """Magnitude and phase over frequency [Hz] with 95 % intervals: Fig. 7, or the figure `response`, with noise and
    distortion, of any other motion than a stepped sine. Returns as `plot_torque`.

    Raises InputError: it is given another thing than what `frequency_response` returns, or it has no rows.
    """
    if not isinstance(response, Response):
        raise InputError(f"give what `frequency_response` returned, not {type(response).__name__}")
    if response.plotted.is_empty():
        why = response.models["excluded"].drop_nulls().to_list() if "excluded" in response.models.columns else []
        raise InputError(f"trial {response.trial}: no frequency response to draw{': ' if why else ''}{'; '.join(why)}")
    return drawn(response.figure, response.plotted)


def plot_torque_angle(*fits: Fit) -> NotebookFigure:
    """Torque [N*m] over angle [deg], loading and unloading, and stiffness [N*m/rad] over angle, of one trial or
    several. Returns as `plot_torque`.

    Raises InputError: a fit is of another experiment than torque_angle, there is none, or two trials have one name.
    """
    curves = [fit.curves for fit in fits if checked(fit).experiment == "torque_angle"]
    if len(curves) < len(fits) or not fits:
        given = ", ".join(fit.experiment for fit in fits) or "no fit"
        raise InputError(f"torque over angle needs what `fit_torque_angle` returns, not {given}")
    names = [fit.trial for fit in fits]
    if len(set(names)) < len(names):
        raise InputError(f"two fits are of trials of one name, {listing(names)}; name each trial differently")
    points = figure_module("torque_angle").points
    tables = pl.concat([fit.table for fit in fits], how="diagonal_relaxed")
    return drawn(
        "torque_angle",
        points(pl.concat([curve for curve in curves if curve is not None], how="diagonal_relaxed"), tables),
    )


def checked(fit: Fit) -> Fit:
    if not isinstance(fit, Fit):
        raise InputError(f"a fit is needed, not {type(fit).__name__}; give what a function fit_... returned")
    return fit


def drawn(name: str, table: pl.DataFrame) -> NotebookFigure:
    return on_screen(figure_module(name).draw(table))
