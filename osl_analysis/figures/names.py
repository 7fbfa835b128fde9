"""Words on paper: names of a campaign as the fonts can draw them, captions, and the small line
below every figure."""

import re
import textwrap
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import polars as pl
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.transforms import Bbox

from osl_analysis.figures.style import GREY, LOOKS, PAPER, Dash, Look, paper_style
from osl_analysis.judge.causes import BETWEEN
from osl_analysis.stats.repeats import IS_DOUBTFUL

COLOURS = ("#3F8FBF", "#6B3A0A", "#2F5555", "#B98860", "#2B46F0")
MARKERS = ("s", "^", "v", "P", "X", "p", "h")
DASHES: tuple[Dash, ...] = (
    (0, (2, 1.2)), (0, (9, 2)), (0, (3, 1, 1, 1, 1, 1)), (0, (6, 1, 2, 1)), (0,
     (12, 1.5, 1.5, 1.5)),
)  # fmt: skip
"""Of controllers other than those of the draft: with these two and black, colours are 20 or more
apart (CIE 1976) for readers without long- or medium-wavelength cones."""
NO_CONTROLLER = Look("#757575", ">", 3.6, "Controller not stated", (0, (1, 0.8)))
JOINT_SIDE = ("joint", "side")


@cache
def drawable_letters() -> frozenset[int]:
    """The letters, by code, that the fonts have."""
    files = (findfont(FontProperties(family=[family])) for family in PAPER["font.family"])
    return frozenset(code for file in files for code in get_font(file).get_charmap())


def with_glyphs(text: str) -> str:
    """A text of which every letter can be drawn: a sign stands for those that no font of the
    figures has."""
    composed = unicodedata.normalize("NFC", text)
    return "".join(
        sign if ord(sign) in drawable_letters() or sign == "\n" else "\ufffd" for sign in composed
    )


def drawn_name(name: str, longest: int = 28) -> str:
    """A name as matplotlib draws it, shortened in its middle: no mathematics, and no label that `_`
    hides."""
    short = (
        name
        if len(name) <= longest
        else f"{name[: longest - longest // 3 - 1]}…{name[-(longest // 3) :]}"
    )
    escaped = with_glyphs(short).replace("$", r"\$")
    return f" {escaped}" if escaped.startswith("_") else escaped


def place_name(joint: str | None, side: str | None) -> str:
    """Joint and side in the title of a panel, such as `Knee, left`; empty where no joint is
    known."""
    name = drawn_name(joint or "")
    capital = name[:1].upper() + name[1:] if name.isascii() else name
    return ", ".join(filter(None, [capital, side]))


def figure_title(figure: str) -> str:
    number = figure.removeprefix("fig")
    return f"Fig. {number}" if number.isdecimal() else figure.replace("_", " ").capitalize()


def placed_rows(table: pl.DataFrame) -> list[tuple[str, pl.DataFrame]]:
    """The rows of each joint and side, with its name; results of different ones never share a
    panel."""
    parts = table.partition_by(JOINT_SIDE, maintain_order=True)
    return [(place_name(*part.select(JOINT_SIDE).row(0)), part) for part in parts]


def panel_titles(parts: Sequence[tuple[str, pl.DataFrame]], words: Sequence[str]) -> list[str]:
    """What stands over the panels of each of `placed_rows`: a word for each, behind joint and side
    if these differ."""
    return [
        ": ".join(filter(None, [name * (len(parts) > 1), word]))
        for name, _ in parts
        for word in words
    ]


def completed(table: pl.DataFrame, columns: Iterable[str], only: bool = False) -> pl.DataFrame:
    """The table with these columns, or `only` these; null where it lacks them."""
    words, columns = (
        ("trial", "trials", *JOINT_SIDE, "controller", "method", "doubtful"),
        list(columns),
    )
    absent = (name for name in columns if name not in table.columns)
    nulls = (
        pl.lit(None, pl.String if name in words else pl.Float64).alias(name) for name in absent
    )
    return table.with_columns(nulls).select(columns if only else pl.all())


def look_numbers(controllers: pl.Series) -> pl.Series:
    """The number of each controller (n,) among those that are not the draft's; a campaign's colours
    mean one thing."""
    others = sorted(set(controllers.drop_nulls()) - set(LOOKS))
    return pl.Series(
        "look",
        [others.index(name) if name in others else None for name in controllers],
        dtype=pl.Int64,
    )


def looks_in(table: pl.DataFrame) -> dict[str | None, Look]:
    """Each controller with its look: the draft's, the others by name, none. A number tells equal
    labels apart."""
    numbers = dict(table.select("controller", "look").unique().iter_rows())
    looks: dict[str | None, Look] = {name: look for name, look in LOOKS.items() if name in numbers}
    for name in sorted(name for name in numbers if name is not None and name not in LOOKS):
        k = numbers[name] or 0
        colour, marker = COLOURS[k % len(COLOURS)], MARKERS[k % len(MARKERS)]
        looks[name] = Look(
            colour, marker, NO_CONTROLLER.size, drawn_name(name), DASHES[k % len(DASHES)]
        )
    if None in numbers:
        looks[None] = NO_CONTROLLER
    labels = [look.label for look in looks.values()]
    for k, (controller, look) in enumerate(looks.items()):
        if look.label in labels[:k]:
            looks[controller] = replace(look, label=f"{look.label} ({k + 1})")
    return looks


def of_controller(table: pl.DataFrame, controller: str | None) -> pl.DataFrame:
    return table.filter(pl.col("controller").eq_missing(pl.lit(controller)))


def as_text(name: str) -> str:
    """A name from a file, of which Markdown shows every sign. Some dialects join repeated hyphens
    and dots."""
    special = r"[\\`*_{}\[\]<>#|~$&!^@\"']|:(?=//)|(?<=-)-|(?<=\.)\.|(?<=www)\."
    plain = " ".join(re.sub(r"[\x00-\x1f\x7f\u2028\u2029]", " ", name).split())
    return re.sub(special, lambda sign: f"\\{sign[0]}", plain)


def listed_text(names: Iterable[str], most: int = 6) -> str:
    """Names from files, each once; of more than `most` the first ones and how many more: the tables
    have all."""
    found = [as_text(name) for name in dict.fromkeys(names)]
    return ", ".join(found[:most]) + (f" and {len(found) - most} more" if len(found) > most else "")


def count_of(n: int, one: str, several: str = "") -> str:
    return f"{n} {one if n == 1 else several or one + 's'}"


def shown_said(caption: str, table: pl.DataFrame) -> str:
    """A caption, with `text` of each `[condition|text]` where a row of the table meets this
    condition, in SQL."""

    def told(found: re.Match[str]) -> str:
        return found[2] if table.select(pl.sql_expr(found[1]).any()).item() else ""

    return " ".join(re.sub(r"\[([^|\]]+)\|([^\]]+)\]", told, caption).split())


def doubtful_said(table: pl.DataFrame) -> str:
    """Which of the drawn trials, or groups of crossings, are doubtful, and why; empty where nothing
    was judged."""
    if "doubtful" not in table.columns:
        return ""
    of_group = [pl.format("mean response of {}", "group")] * ("group" in table.columns)
    whose = [pl.col(name) for name in ("trial", "trials") if name in table.columns]
    judged = table.drop_nulls("doubtful").with_columns(whose=pl.coalesce(*whose, *of_group))
    found = judged.filter(IS_DOUBTFUL).unique("whose", maintain_order=True)
    # no sound mean response
    counted = judged.filter(pl.coalesce(*whose).is_not_null() | IS_DOUBTFUL)
    if found.is_empty():
        return "No fit is doubtful." if len(judged) else ""
    of = f"{len(found)} of {counted['whose'].n_unique()} ({listed_text(found['whose'])})"
    causes = dict.fromkeys(cause for cell in found["doubtful"] for cause in cell.split(BETWEEN))
    return f"Doubtful: {of}, for {as_text(', '.join(causes))}."


AXIS_LABELS = {
    "K": r"Stiffness $\hat{K}$ (N·m/rad)",
    "B": r"Damping $\hat{B}$ (N·m·s/rad)",
    "I": r"Apparent inertia $\hat{I}$ (kg·m$^2$)",
}


@paper_style()
def write_footer(figure: Figure, text: str) -> Bbox:
    """A small line below a drawn figure, whose size and layout stay; the taller part of the plane
    [in] to be saved."""
    # [in]; size of the letters [pt]
    (width, height), size, line, edge = figure.get_size_inches(), 5.5, 0.1, 0.02
    lines = textwrap.wrap(text, int(width * 28))  # letters per inch
    look: dict[str, Any] = {
        "fontsize": size,
        "color": GREY,
        "ha": "center",
        "va": "top",
        "linespacing": 1.1,
    }
    words = figure.text(
        0.5, -edge / height, with_glyphs("\n".join(lines)), parse_math=False, **look
    )
    words.set_in_layout(False)
    return Bbox.from_extents(0.0, -(line * len(lines) + 2 * edge), width, height)
