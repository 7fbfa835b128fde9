"""Figures: the numbers to be plotted from result tables, the drawn page from those numbers, and the captions."""

from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.figures import FIGURES, OTHER_DRAWINGS
from osl_analysis.files import atomic_path, digest
from osl_analysis.refusal import Refusal, is_refused, read_refusals
from osl_analysis.table import read_table, write_table

NOTHING_SHOWN = "no trial of the campaign has the numbers that this figure shows"
"""Why a figure without any number is not drawn; a module with a reason of its own has `NOTHING`."""
METADATA = {".pdf": ("Subject", "CreationDate"), ".svg": ("Description", "Date"), ".png": ("Description", "Date")}
"""Formats that can be written, each with the entries of its metadata that say what the data are, and the time. That is
left out: equal numbers give equal files."""


def figure_module(name: str) -> Any:
    """The module of one drawing, imported only when it is needed: importing matplotlib takes half a second."""
    if name in OTHER_DRAWINGS:
        return import_module("osl_analysis.figures.others").DRAWINGS[name]
    if name not in FIGURES:
        raise InputError(f"no figure '{name}'; there are {', '.join((*FIGURES, *OTHER_DRAWINGS))}")
    return import_module(f"osl_analysis.figures.{name}")


def plot_numbers(name: str, table: Path, option: Any, output: Path) -> None:
    """Write what figure `name` plots, from the one result table that it shows.

    `option` is the value of the setting that the list of figures names; None: not set.

    Raises InputError: the result table is missing, lacks a column, or holds nothing that the figure draws.
    """
    module = figure_module(name)
    rows = read_table(table, required=module.TABLE_COLUMNS)
    write_table(module.points(rows) if option is None else module.points(rows, option), output)


def draw_figure(
    name: str, table_csv: Path, outputs: Sequence[Path], refused: Sequence[Refusal] = (), footer: str = ""
) -> None:
    """Draw the numbers of `table_csv` as figure `name` (one of `FIGURES`) into PDF, SVG or PNG files, by suffix.

    `refused` are the causes of what the figure lacks. It names these trials; if there are no numbers, it says why. The
    `footer` says what the data are; the first digits of the SHA-256 of `table_csv` are added to it.

    Raises InputError: unknown figure or suffix; the table is missing or lacks a column.
    """
    if footer:
        footer += f", numbers {str(digest(table_csv))[:8]}"
    if is_refused(table_csv):
        causes = [(cause.trial, cause.file, cause.reason) for cause in read_refusals(table_csv)]
        draw_table("not_drawn", not_drawn(name, causes), outputs, footer=footer)
        return
    module = figure_module(name)
    table = read_table(table_csv, required=module.COLUMNS)
    if table.is_empty():
        why = getattr(module, "NOTHING", NOTHING_SHOWN)
        draw_table("not_drawn", not_drawn(name, [("", str(table_csv), why)]), outputs, footer=footer)
        return
    draw_table(name, table, outputs, list(dict.fromkeys(cause.trial for cause in refused if cause.trial)), footer)


def not_drawn(name: str, causes: Sequence[tuple[str, str, str]]) -> pl.DataFrame:
    columns = ("figure", "trial", "file", "reason")
    return pl.DataFrame([(name, *cause) for cause in causes], schema=columns, orient="row")


def draw_table(
    name: str, table: pl.DataFrame, outputs: Sequence[Path], missing: Sequence[str] = (), footer: str = ""
) -> None:
    """The same for numbers in memory; `name` is one of `FIGURES` or `OTHER_DRAWINGS`. `missing` trials are named in
    the `footer`, which the files have in their metadata too.
    """
    for path in outputs:
        if path.suffix not in METADATA:
            raise InputError(f"{path}: figures are written as {', '.join(METADATA)}; choose one of these suffixes")
    names, style = (import_module(f"osl_analysis.figures.{module}") for module in ("names", "style"))
    figure = figure_module(name).draw(table)
    footer = ". ".join(filter(None, [footer, names.said_of_missing(missing)]))
    page_box = names.write_footer(figure, footer) if footer else None
    style.lay_out(figure)
    for path in outputs:
        subject, date = METADATA[path.suffix]
        said = ({date: None} if path.suffix != ".png" else {}) | ({subject: footer} if footer else {})
        page = BytesIO()  # a writer that the disk interrupts would leave its file open
        with style.paper_style():
            figure.savefig(page, format=path.suffix.removeprefix("."), metadata=said, bbox_inches=page_box)
        with atomic_path(path) as temporary:
            temporary.write_bytes(page.getvalue())


def write_captions(
    *, tables: Mapping[str, Path], shown: Mapping[str, Sequence[Path]], footer: str, output: Path
) -> None:
    """Write a section per figure: its title, and its caption or why it is not drawn.

    `tables` are the plotted numbers by the name of the figure, `shown` the results of single trials that it shows; of
    these, the refused ones are named. `footer` says once, above all sections, what the data are.

    Raises InputError: a table is missing or lacks a column.
    """
    names = import_module("osl_analysis.figures.names")
    sections = [
        f"## {names.figure_title(name)}\n\n{caption_of(name, table, blamed_trials(shown.get(name, ())))}\n"
        for name, table in tables.items()
    ]
    with atomic_path(output) as path:
        doubts = "Why a fit is doubtful stands in the column `doubtful` of the figure's CSV file."
        said = f"# Captions\n\n{names.as_text(footer)}. {doubts}\n"
        path.write_text("\n".join([said, *sections]), encoding="utf-8")


def caption_of(name: str, table_csv: Path, missing: Sequence[str] = ()) -> str:
    """The caption of one figure from its plotted numbers, with the trials that it lacks; or why it is not drawn."""
    names = import_module("osl_analysis.figures.names")
    if is_refused(table_csv):
        causes = (f"{cause.trial or cause.file}: {cause.reason}" for cause in read_refusals(table_csv))
        return f"This figure is not drawn. {names.listed_text(causes)}."
    module = figure_module(name)
    table = read_table(table_csv, required=module.COLUMNS)
    if table.is_empty():
        why = getattr(module, "NOTHING", NOTHING_SHOWN)
        return f"This figure is not drawn. {names.as_text(why[:1].upper() + why[1:])}."
    said: str = module.caption(table)
    lacks = f"Without {names.count_of(len(missing), 'trial')} whose recordings or fits were refused: "
    return f"{said} {lacks}{names.listed_text(missing)}." if missing else said


def blamed_trials(files: Iterable[Path]) -> list[str]:
    """The trials to blame for the refusal records among these results."""
    return list(dict.fromkeys(cause.trial for file in files for cause in read_refusals(file) if cause.trial))
