# SPDX-License-Identifier: Apache-2.0
"""Compute the plotted numbers of figures, draw figures from them, and write captions.

Example: `draw_figure("fig5", Path("figures/fig5.csv"), [Path("figures/fig5.pdf")])`.
"""

import math
import textwrap
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import polars as pl

from osl_analysis.base.errors import InputError, listing, on_one_line
from osl_analysis.base.files import atomic_path, digest, write_text
from osl_analysis.base.table import (
    NotAnalysed,
    by_trial,
    not_analysed,
    read_table,
    read_tables,
)
from osl_analysis.bench.summaries import PLACE
from osl_analysis.campaign.configuration import FrequencyResponseFigure
from osl_analysis.commands.walking import Gaits, read_model, selected_crossings
from osl_analysis.dictionary.described import described_tables_by_name
from osl_analysis.figures.drawing import (
    FIGURES,
    caption_of,
    drawn,
    figure_title,
    look_numbers,
    plotted_columns,
    plotted_numbers,
)
from osl_analysis.judge.findings import read_findings
from osl_analysis.judge.joining import joined
from osl_analysis.model.compensator import Weight
from osl_analysis.model.drivetrain import (
    joint_of,
    known_parameters,
)
from osl_analysis.report.numbers import macro_name
from osl_analysis.report.typography import in_markdown, prose_in_latex
from osl_analysis.stats.doubts import is_doubtful
from osl_analysis.walking.isolated_response import unperturbed_gait
from osl_analysis.walking.walking_settings import TimingSettings

if TYPE_CHECKING:
    from matplotlib.text import Text

    from osl_analysis.figures.style import PaperFigure

MOST_REFUSED = 4  # refused trials below a figure; `excluded.csv` names all
# metadata by format: without the time, equal numbers give equal files
METADATA: Any = {
    ".pdf": {"CreationDate": None},
    ".svg": {"Date": None},
    ".png": {},
}

SVG_POINTS_PER_INCH = 72

# The line below a figure that says where its data come from
FOOTER_POINTS = 6  # size of the letters, the smallest that IEEE prints
FOOTER_LINE_IN = 0.11  # height of a line


def plot_numbers(
    name: str,
    table: Path,
    option: Any = None,
    further_tables: Sequence[Path] = (),
    findings: Sequence[Path] = (),
) -> pl.DataFrame:
    """The plotted numbers of a figure.

    They come from its result table and `further_tables`, with the `findings` on their rows.
    `option` is the value of the setting that `figures.yaml` names; None: not set.
    """
    read = read_findings(findings)
    shown = [joined(read_table(path), path.stem, read) for path in further_tables]
    if option is not None:
        shown.append(option)
    described = described_tables_by_name()[FIGURES[name].table].columns
    needed = [column for column in plotted_columns(name) if column in described]
    return plotted_numbers(name, joined(read_table(table, needed), table.stem, read), *shown)


def draw_figure(
    name: str,
    table_csv: Path,
    outputs: Sequence[Path],
    refused: Sequence[NotAnalysed] = (),
    origin: str = "",
    footer: bool = True,
) -> None:
    """Draw a figure, or say on its page why it is not drawn.

    Parameters
    ----------
    name
        The name of the figure.
    table_csv
        The plotted numbers.
    outputs
        PDF, SVG or PNG files.
    refused
        The causes of missing trials.
    origin
        The origin of the data; the first digits of the SHA-256 of `table_csv` are added.
    footer
        Whether a small line below the figure has the origin, as its metadata always have.
    """
    reasons = reasons_not_drawn(name, table_csv)
    texts = [f"{origin}, numbers {str(digest(table_csv))[:8]}"] if origin else []
    missing = list(by_trial(refused))
    if reasons:
        figure = page_of_reasons(name, reasons)
    else:
        figure = drawn(name, read_plotted(name, table_csv))
        if missing:
            texts.append(f"Without {len(missing)} refused: {listing(missing, MOST_REFUSED)}")
    write_figure(figure, outputs, ". ".join(texts), footer)


def reasons_not_drawn(name: str, table_csv: Path) -> list[str]:
    """The reasons for which a figure is not drawn; none if it is."""
    causes = [cause.text for cause in not_analysed(table_csv)]
    if not causes and read_plotted(name, table_csv).is_empty():
        return [FIGURES[name].nothing]
    return causes


def page_of_reasons(name: str, reasons: Sequence[str]) -> "PaperFigure":
    """A page with the reasons, in place of a figure that is not drawn."""
    from osl_analysis.figures.style import DOUBLE_COLUMN, PaperFigure, paper_style

    lines = [f"{figure_title(name)} is not drawn"]
    for reason in reasons:
        lines += textwrap.wrap(reason)
    with paper_style():
        height = 2 * FOOTER_LINE_IN * (1 + len(lines))  # letters twice as large as in a footer
        figure = PaperFigure(figsize=(DOUBLE_COLUMN, height))
        figure.suptitle("\n".join(lines), parse_math=False)
    return figure


def write_figure(
    figure: "PaperFigure", outputs: Sequence[Path], origin: str = "", footer: bool = True
) -> None:
    """Write a figure as PDF, SVG or PNG, with the origin of its data in the metadata and, if
    `footer`, in one small line below it."""
    from osl_analysis.figures.style import GREY, paper_style

    unknown = [path for path in outputs if path.suffix not in METADATA]
    if unknown:
        raise InputError(
            f"{unknown[0]}: figures are written as {', '.join(METADATA)}",
            "choose one of these suffixes",
        )
    with paper_style():
        if origin and footer:
            figure.set_figheight(figure.get_figheight() + 2 * FOOTER_LINE_IN)
            line = figure.supxlabel(origin, parse_math=False, fontsize=FOOTER_POINTS, color=GREY)
            shorten_to_width(line, figure)
        layout = figure.get_layout_engine()
        if layout is not None:
            layout.execute(figure)
    # the layout was found above; with another engine, "none", each format would be drawn twice
    figure.set_layout_engine(None)
    for path in outputs:
        metadata = {**METADATA[path.suffix], "Title": origin}
        page = BytesIO()  # on a full disk, a writer to the file itself would leave it open
        figure.savefig(page, format=path.suffix.removeprefix("."), metadata=metadata)
        with atomic_path(path) as temporary:
            temporary.write_bytes(page.getvalue())


def shorten_to_width(line: "Text", figure: "PaperFigure") -> None:
    """Shorten a line to the width of its figure, with an ellipsis. The file's metadata have it
    whole."""
    text = line.get_text()
    while text and line.get_window_extent().width > figure.bbox.width:
        text = text[:-1].rstrip()
        line.set_text(f"{text}…")


def read_plotted(name: str, table_csv: Path) -> pl.DataFrame:
    """The plotted numbers of a figure."""
    return read_table(table_csv, list(plotted_columns(name)))


def write_captions(*, tables: Mapping[str, Path], footer: str, markdown: Path, tex: Path) -> None:
    r"""Write the captions of all figures in Markdown and as macros of LaTeX.

    Parameters
    ----------
    tables : Mapping of str to Path
        The files of plotted numbers by figure; the figure's SVG file is in the same folder.
    footer : str
        The origin of the data.
    markdown : Path
        File for a section per figure: title, caption and width, or why it is not drawn.
    tex : Path
        File for a macro per drawn figure, as `\oslCaptionFigFive`.
    """
    from osl_analysis.figures.style import SINGLE_COLUMN

    macros = [f"% {on_one_line(footer)}. \\input this file and use the macros in \\caption."]
    sections = [
        f"# Captions\n\n{in_markdown(footer)}. Why a fit is doubtful stands in the column"
        " `doubtful` of the figure's CSV file.\n"
    ]
    for name, table in tables.items():
        reasons = in_markdown("; ".join(reasons_not_drawn(name, table)))
        text = f"Not drawn: {reasons}."
        if not reasons:
            text = " ".join(caption_of(name, read_plotted(name, table)))
            macro = f"oslCaption{macro_name(readable_name(name))}"
            macros.append(rf"\newcommand{{\{macro}}}{{{prose_in_latex(text)}}}")
            width_in = drawn_width_in(table.with_suffix(".svg"))
            is_single = math.isclose(width_in, SINGLE_COLUMN, rel_tol=1e-3)
            text += f"\n\n{'One column' if is_single else 'Two columns'} wide."
        sections.append(f"## {figure_title(name)}\n\n{text}\n")
    write_text(markdown, "\n".join(sections))
    write_text(tex, "\n".join([*macros, ""]))


def readable_name(figure: str) -> str:
    """The name of a figure with a blank before its number, as `fig 5`."""
    number = figure.removeprefix("fig")
    return f"fig {number}" if number.isdecimal() else figure


def drawn_width_in(drawing: Path) -> float:
    """The width of a figure's SVG file [in]."""
    svg = ElementTree.parse(drawing).getroot()
    width_points = float(svg.attrib["width"].removesuffix("pt"))
    return width_points / SVG_POINTS_PER_INCH


def fig3(
    curves: Sequence[Path], table: Path, summary: Path, findings: Sequence[Path]
) -> pl.DataFrame:
    """The plotted numbers of Fig. 3, from the trials' curves, `belt.csv` with the `findings` on its
    rows, and `belt_summary.csv`."""
    drawn = read_tables(curves, "belt_curves")
    belts = read_table(table, ["trial", *PLACE, "K_s", "doubtful"])
    judged = joined(belts, "belt", read_findings(findings))
    return plotted_numbers("fig3", drawn, judged, read_table(summary))


def fig4(
    series: Sequence[Path], table: Path, chosen: str, findings: Sequence[Path]
) -> pl.DataFrame:
    """The numbers of Fig. 4.

    Parameters
    ----------
    series : Sequence of Path
        Series of the trials that may be shown. The first trial that is not doubtful is drawn, or
        the first where all are doubtful.
    table : Path
        `impedance.csv`.
    chosen : str
        The reason for the choice of trials, in words.
    findings : Sequence of Path
        The findings on the fits.

    Returns
    -------
    DataFrame
        A part of the trial, and its row of the table with the findings on it.
    """
    fits = joined(read_table(table), "impedance", read_findings(findings))
    whole_fits = fits.filter(pl.col("amplitude_deg").is_null())
    doubtful_trials = set(whole_fits.filter(is_doubtful(whole_fits))["trial"])
    clear = [file for file in series if file.stem not in doubtful_trials]
    shown = clear[0] if clear else series[0]

    row = whole_fits.filter(trial=shown.stem)
    samples = read_table(shown, name="series").join(row, how="cross")
    samples = samples.with_columns(chosen=pl.lit(chosen or None, pl.String))
    return plotted_numbers("fig4", samples)


def fig7(
    table: Path,
    parameters: Path | None,
    choice: FrequencyResponseFigure | None,
    weight: Weight,
    findings: Sequence[Path],
) -> pl.DataFrame:
    """The plotted numbers of Fig. 7, for one K_d and B_d: those of `choice`, or of most trials.

    They have measured responses, with the `findings` on their fits; the desired response (Eq. 11),
    if K_d and B_d are known; and the linear model (Eq. 9), if the gains are known and the parameter
    file is of this joint.
    """
    responses = joined(read_table(table), "response", read_findings(findings))
    responses = responses.with_columns(look_numbers(responses["controller"]))
    if responses.is_empty():
        return pl.DataFrame(schema=plotted_columns("fig7"))
    counts = responses.group_by("K_d", "B_d", maintain_order=True).agg(n=pl.col("trial").n_unique())
    K_d, B_d, _ = counts.sort("n", descending=True, maintain_order=True).row(0)
    why: str | None = "the desired impedance with the most trials"
    if choice is not None:
        K_d, B_d, why = choice.K_d, choice.B_d, None
    is_shown = pl.col("K_d").eq_missing(K_d) & pl.col("B_d").eq_missing(B_d)
    points = fig7_points(responses.filter(is_shown), parameters, weight)
    return points.with_columns(chosen=pl.lit(why, pl.String))


def fig7_points(responses: pl.DataFrame, parameters: Path | None, weight: Weight) -> pl.DataFrame:
    """The plotted numbers of Fig. 7 from rows of `response.csv` of one desired impedance."""
    joint = joint_of(parameters) if parameters else None
    return plotted_numbers("fig7", responses, known_parameters(parameters), joint, weight)


def plot_walking_page(
    *,
    crossings: Sequence[Path],
    selection: Path,
    unperturbed: Path,
    responses: Path,
    table: Path,
    findings: Sequence[Path],
    settings: TimingSettings,
) -> pl.DataFrame:
    """The plotted numbers of the walking page.

    `crossings` are the perturbed ones, `selection` is `walking_crossings.csv`, `responses` is
    `walking_responses.csv`, `table` is `walking.csv`, with the `findings` on its rows.
    """
    from osl_analysis.figures.walking_page import walking_page_points

    isolated = read_table(
        responses, ["group", "trial", "time", "theta_deg", "torque", "torque_model"]
    )
    fits = joined(read_table(table, ["trial"]), "walking", read_findings(findings))
    doubts = fits.select("trial", "doubtful", is_doubtful=is_doubtful(fits))
    isolated = isolated.join(doubts, on="trial", how="left", maintain_order="left")
    selected = selected_crossings(crossings, selection)
    gaits: Gaits = read_model(unperturbed, Gaits)
    frames = []
    for group_responses in isolated.partition_by("group"):
        trials = set(group_responses["trial"])
        perturbed = [crossing for crossing in selected if crossing.name in trials]
        gait_curves = {
            "unperturbed": gaits[group_responses["group"][0]],
            "perturbed": unperturbed_gait(perturbed, 1),
        }
        points = walking_page_points(gait_curves, group_responses.drop("group"), settings)
        frames.append(points.with_columns(group=pl.lit(group_responses["group"][0])))
    return pl.concat(frames, how="diagonal")
