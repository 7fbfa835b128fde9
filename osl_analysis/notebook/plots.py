"""For notebooks: figures of results. Each takes a result and returns a matplotlib `Figure`; nothing is computed."""

from typing import TYPE_CHECKING

import polars as pl

from osl_analysis.commands.figure import figure_module
from osl_analysis.errors import InputError, listing
from osl_analysis.figures.style import NotebookFigure, on_screen
from osl_analysis.notebook.fit import Fit

if TYPE_CHECKING:
    from osl_analysis.notebook.response import Response


def plot_torque(fit: Fit) -> NotebookFigure:
    """Measured and modelled torque [N*m] of a fit over time [s], and below the residual.

    Returns
    -------
    A matplotlib `Figure`, which a notebook shows and `figure.savefig("torque.pdf")` saves as a campaign does.

    Raises
    ------
    InputError
        It is given another thing than a fit.
    """
    return drawn("torque", checked(fit).series)


def plot_frequency_response(response: "Response") -> NotebookFigure:
    """Magnitude and phase over frequency [Hz] with 95 % intervals: Fig. 7, or the figure `response`, with noise and
    distortion, of any other motion than a stepped sine. Returns as `plot_torque`.

    Raises
    ------
    InputError
        It is given another thing than what `frequency_response` returns, or it has no rows.
    """
    if type(response).__name__ != "Response":  # by name: its module takes long to import
        raise InputError(f"give what `frequency_response` returned, not {type(response).__name__}")
    if response.plotted.is_empty():
        why = response.models["excluded"].drop_nulls().to_list() if "excluded" in response.models.columns else []
        raise InputError(f"trial {response.trial}: no frequency response to draw{': ' if why else ''}{'; '.join(why)}")
    return drawn(response.figure, response.plotted)


def plot_torque_angle(*fits: Fit) -> NotebookFigure:
    """Torque [N*m] over angle [deg], loading and unloading, and stiffness [N*m/rad] over angle, of one trial or
    several. Returns as `plot_torque`.

    Raises
    ------
    InputError
        A fit is of another experiment than torque_angle, there is none, or two trials have one name.
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
    """A fit as it is.

    Raises
    ------
    InputError
        It is none.
    """
    if not isinstance(fit, Fit):
        raise InputError(f"a fit is needed, not {type(fit).__name__}; give what a function fit_... returned")
    return fit


def drawn(name: str, table: pl.DataFrame) -> NotebookFigure:
    """The figure of this name with the numbers of a table."""
    return on_screen(figure_module(name).draw(table))
