"""The captions of a campaign's figures, written from the plotted numbers: results/figures/captions.md."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from osl_analysis.commands.figure import figure_module, nothing_to_draw
from osl_analysis.figures.captions import as_text, counted, listed
from osl_analysis.figures.names import figure_title
from osl_analysis.files import atomic_path
from osl_analysis.refusal import is_refused, read_refusals
from osl_analysis.table import read_table

DOUBTS = "Why a fit is doubtful stands in the column `doubtful` of the figure's CSV file."


def write_captions(
    *, tables: Mapping[str, Path], shown: Mapping[str, Sequence[Path]], footer: str, output: Path
) -> None:
    """Write a section per figure: its title, and its caption or why it is not drawn.

    `tables` are the plotted numbers by the name of the figure, `shown` the results of single trials that it shows; of
    these, the refused ones are named. `footer` says once, above all sections, what the data are.

    Raises
    ------
    InputError
        A table is missing or lacks a column.
    """
    sections = [
        f"## {figure_title(name)}\n\n{caption_of(name, table, refused_trials(shown.get(name, ())))}\n"
        for name, table in tables.items()
    ]
    with atomic_path(output) as path:
        path.write_text("\n".join([f"# Captions\n\n{as_text(footer)}. {DOUBTS}\n", *sections]), encoding="utf-8")


def caption_of(name: str, table_csv: Path, missing: Sequence[str] = ()) -> str:
    """The caption of one figure from its plotted numbers, with the trials that it lacks; or why it is not drawn."""
    if is_refused(table_csv):
        causes = (f"{cause.trial or cause.file}: {cause.reason}" for cause in read_refusals(table_csv))
        return f"This figure is not drawn. {listed(causes)}."
    module = figure_module(name)
    table = read_table(table_csv, required=module.COLUMNS)
    if table.is_empty():
        why = nothing_to_draw(module)
        return f"This figure is not drawn. {as_text(why[:1].upper() + why[1:])}."
    said: str = module.caption(table)
    lacks = f"Without {counted(len(missing), 'trial')} whose recordings or fits were refused: {listed(missing)}."
    return f"{said} {lacks}" if missing else said


def refused_trials(files: Iterable[Path]) -> list[str]:
    """The trials to blame for the refusal records among these results."""
    return list(dict.fromkeys(cause.trial for file in files for cause in read_refusals(file) if cause.trial))
