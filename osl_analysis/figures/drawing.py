# SPDX-License-Identifier: Apache-2.0
"""The list of figures: the plotted numbers of each, its caption, and its drawing.

Example: `drawn("fig5", plotted_numbers("fig5", impedance))`.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import polars as pl

from osl_analysis.base.errors import InputError
from osl_analysis.base.files import package_yaml
from osl_analysis.dictionary.described import TYPES, described_in
from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.stats.doubts import is_doubtful

if TYPE_CHECKING:
    from osl_analysis.figures.style import PaperFigure


@dataclass(frozen=True, kw_only=True)
class CampaignFigure:
    """A figure of a campaign. `figures.yaml` explains its fields."""

    table: str
    caption: Sequence[str]
    rows: str
    columns: Mapping[str, str]
    further_tables: Sequence[str] = ()
    option: str | None = None
    nothing: str = "no trial of the campaign has the numbers that this figure shows"


DESCRIBED = Path(__file__).with_name("figures.yaml")
FIGURES = {
    place.removeprefix("figures/"): CampaignFigure(**entry)
    for place, entry in package_yaml(DESCRIBED).items()
}
# kinds of `curve` in Fig. 7
OBSERVED = "observed"
DESIRED = "desired"
LINEAR_MODEL = "linear model"


def figure_title(figure: str) -> str:
    """The title of a figure's section: `Fig. 5` of `fig5`, `Walking page` of `walking_page`."""
    number = figure.removeprefix("fig")
    return f"Fig. {number}" if number.isdecimal() else figure.replace("_", " ").capitalize()


def plotted_columns(name: str) -> dict[str, type[pl.DataType]]:
    """The columns of a figure's plotted numbers with their types.

    Raises
    ------
    InputError
        There is no such figure.
    """
    if name not in FIGURES:
        raise InputError(f"no figure '{name}'", f"there are {', '.join(FIGURES)}")
    (table,) = [table for table in described_in(DESCRIBED) if table.place == f"figures/{name}"]
    units = {column.name: column.unit for column in table.columns.values()}
    del units["data"]  # the writer adds this column
    return {name: TYPES.get(unit, pl.Float64) for name, unit in units.items()}


def module_of(name: str) -> ModuleType:
    """The module that draws a figure; it is imported only when it is needed: importing matplotlib
    takes half a second."""
    return import_module(f"osl_analysis.figures.{name}")


def plotted_numbers(name: str, table: pl.DataFrame, *further_inputs: Any) -> pl.DataFrame:
    """Compute the plotted numbers of a figure.

    Parameters
    ----------
    name : str
        Name of the figure.
    table : DataFrame
        Its result table.
    *further_inputs
        Further arguments of the figure's function `points`: tables, and the value of a setting.

    Returns
    -------
    DataFrame
        Rows of the figure's columns. A column that no table has is null.
    """
    columns = plotted_columns(name)
    module = module_of(name)
    points: pl.DataFrame = (
        module.points(table, *further_inputs) if hasattr(module, "points") else table
    )
    if "look" in columns and "look" not in points.columns:
        points = points.with_columns(look_numbers(points["controller"]))
    return completed(name, with_doubt_marks(points, columns))


IS_DOUBTFUL = "is_doubtful"  # column of plotted numbers: whether the fit of a row is doubtful


def with_doubt_marks(points: pl.DataFrame, columns: Collection[str]) -> pl.DataFrame:
    """Points with the columns of a figure that mark doubts, by the doubts joined to each row.

    `is_doubtful` marks a fit, `K_is_doubtful` and the like one of its estimates.
    """
    for column in columns:
        if column.endswith(IS_DOUBTFUL) and column not in points.columns:
            estimate = column.removesuffix(IS_DOUBTFUL).removesuffix("_")
            marks = is_doubtful(points, [estimate] if estimate else ())
            points = points.with_columns(marks.alias(column))
    return points


def completed(name: str, points: pl.DataFrame) -> pl.DataFrame:
    """Points with all columns of a figure's plotted numbers; missing ones are null."""
    columns = plotted_columns(name)
    absent = [column for column in columns if column not in points.columns]
    points = points.with_columns(pl.lit(None, columns[column]).alias(column) for column in absent)
    return points.select(*columns)


def caption_of(name: str, numbers: pl.DataFrame) -> list[str]:
    """The sentences of a figure's caption whose conditions these plotted numbers meet.

    Sentences with numbers, by the figure's function `statistics`, follow.
    """
    sentences = []
    for text in FIGURES[name].caption:
        *conditions, sentence = text.split(" => ")
        if all(numbers.select(pl.sql_expr(text).any()).item() for text in conditions):
            sentences.append(sentence)
    module = module_of(name)
    if hasattr(module, "statistics"):
        sentences += module.statistics(numbers)
    return sentences


def look_numbers(controllers: pl.Series) -> pl.Series:
    """The number of each controller (n,), by which its colour is the same in all figures.

    Controllers of the draft come first.
    """
    new_names = sorted({*controllers.drop_nulls()} - {*CONTROLLERS})
    numbers = {name: number for number, name in enumerate([*CONTROLLERS, *new_names])}
    return controllers.replace_strict(numbers, default=None, return_dtype=pl.Int64).alias("look")


def drawn(name: str, table: pl.DataFrame) -> "PaperFigure":
    """Draw a figure of its plotted numbers."""
    from osl_analysis.figures.style import paper_style

    with paper_style():
        figure: PaperFigure = module_of(name).draw(table)
        figure.align_ylabels()
    return figure
