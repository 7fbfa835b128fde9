"""Figures: the numbers to be plotted from the result tables, and the drawn page from those numbers."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.files import atomic_path
from osl_analysis.table import read_table, write_table

FIGURES = ("fig3", "fig4", "fig5", "fig6", "fig7", "fig8", "fig9", "walking_page", "model_comparison")
DRAWINGS = (*FIGURES, "torque", "gain_grid", "gain_map", "study")
METADATA: dict[str, dict[str, Any]] = {".pdf": {"CreationDate": None}, ".svg": {"Date": None}, ".png": {}}
"""Formats that can be written, and what keeps the hour out of them: the same numbers give the same bytes."""


def draw_figure(name: str, table_csv: Path, outputs: Sequence[Path]) -> None:
    """Draw the numbers of `table_csv` as figure `name` (one of `FIGURES`) into PDF, SVG or PNG files, by suffix.

    Raises
    ------
    InputError
        Unknown figure or suffix; the table is missing, has no rows or lacks a column.
    """
    table = read_table(table_csv, required=figure_module(name).COLUMNS)
    if table.is_empty():
        raise InputError(f"{table_csv}: no rows to draw as {name}; does the campaign have trials of this experiment?")
    draw_table(name, table, outputs)


def draw_table(name: str, table: pl.DataFrame, outputs: Sequence[Path]) -> None:
    """The same for numbers in memory; `name` is one of `DRAWINGS`."""
    for path in outputs:
        if path.suffix not in METADATA:
            raise InputError(f"{path}: figures are written as {', '.join(METADATA)}; choose one of these suffixes")
    figure = figure_module(name).draw(table)
    style = import_module("osl_analysis.figures.style")
    for path in outputs:
        with style.paper_style(), atomic_path(path) as temporary:
            figure.savefig(temporary, metadata=METADATA[path.suffix])


def figure_module(name: str) -> Any:
    """The module of one drawing, imported only when it is needed: matplotlib takes half a second."""
    if name not in DRAWINGS:
        raise InputError(f"no figure '{name}'; there are {', '.join(DRAWINGS)}")
    return import_module(f"osl_analysis.figures.{name}")


def plotted_numbers_fig5(impedance_csv: Path, figure_csv: Path) -> None:
    """Write what Fig. 5 plots, from the impedance table."""
    fig5 = figure_module("fig5")
    write_table(fig5.points(read_table(impedance_csv, required=fig5.IMPEDANCE)), figure_csv)


def plotted_numbers_fig6(impedance_csv: Path, figure_csv: Path) -> None:
    """Write what Fig. 6 plots, from the impedance table."""
    fig6 = figure_module("fig6")
    write_table(fig6.points(read_table(impedance_csv, required=fig6.IMPEDANCE)), figure_csv)


def plotted_numbers_fig8(gains_csv: Path, figure_csv: Path) -> None:
    """Write what Fig. 8 plots, from the table of gains."""
    fig8 = figure_module("fig8")
    write_table(fig8.points(read_table(gains_csv, required=fig8.COLUMNS)), figure_csv)


def plotted_numbers_model_comparison(scores_csv: Path, figure_csv: Path) -> None:
    """Write what the figure of the model comparison plots, from the scores of every trial."""
    figure = figure_module("model_comparison")
    write_table(figure.points(read_table(scores_csv, required=figure.COLUMNS)), figure_csv)


def plotted_numbers_fig9(walking_summary_csv: Path, commanded_K: float | None, figure_csv: Path) -> None:
    """Write what Fig. 9 plots, from the summary of walking; `commanded_K` [N*m/rad] if it is known."""
    fig9 = figure_module("fig9")
    write_table(fig9.points(read_table(walking_summary_csv, required=fig9.SUMMARY), commanded_K), figure_csv)
