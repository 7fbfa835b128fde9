"""Names of a campaign on paper: letters that the fonts have, looks of its controllers, its joints and sides."""

import unicodedata
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import polars as pl
from matplotlib.font_manager import FontProperties, findfont, get_font

from osl_analysis.figures.style import LOOKS, PAPER, Dash, Look, width_of

DRAFT = ("compensated", "uncompensated")
"""The controllers of the draft, whose looks are fixed."""
LONGEST = 28
"""Characters of a name in a figure; a longer one is shortened in its middle."""
MISSING = "\ufffd"
"""Sign in place of a letter that no font of the figures has."""
COLOURS = ("#3F8FBF", "#6B3A0A", "#2F5555", "#B98860", "#2B46F0")
"""Colours of controllers other than those of the draft: with these two and black 20 or more apart (CIE 1976) for
readers without long- or medium-wavelength cones."""
MARKERS = ("s", "^", "v", "P", "X", "p", "h")
DASHES: tuple[Dash, ...] = (
    (0, (2, 1.2)), (0, (9, 2)), (0, (3, 1, 1, 1, 1, 1)), (0, (6, 1, 2, 1)), (0, (12, 1.5, 1.5, 1.5)),
)  # fmt: skip
"""Line styles of their models."""
SIZE = 3.6
"""Size [pt] of their markers."""
NO_CONTROLLER = Look("#757575", ">", SIZE, "No controller", (0, (1, 0.8)))
PLACE = ("joint", "side")


@cache
def letters() -> frozenset[int]:
    """The letters, by code, that the fonts of the figures have."""
    files = (findfont(FontProperties(family=[family])) for family in PAPER["font.family"])
    return frozenset(code for file in files for code in get_font(file).get_charmap())


def with_glyphs(text: str) -> str:
    """A text of which every letter can be drawn; `MISSING` stands for the others."""
    composed = unicodedata.normalize("NFC", text)
    return "".join(sign if ord(sign) in letters() or sign == "\n" else MISSING for sign in composed)


def drawn_name(name: str, longest: int = LONGEST) -> str:
    """A name as matplotlib draws it letter by letter: no mathematics, no hidden entry of a legend, not too long.

    Matplotlib reads text between dollar signs as mathematics, and lists no label that begins with an underscore.
    """
    short = name if len(name) <= longest else f"{name[: longest - longest // 3 - 1]}…{name[-(longest // 3) :]}"
    escaped = with_glyphs(short).replace("$", r"\$")
    return f" {escaped}" if escaped.startswith("_") else escaped


def place_name(joint: str | None, side: str | None) -> str:
    """Joint and side in the title of a panel, such as `Knee, left`; empty where no joint is known."""
    name = drawn_name(joint or "")
    capital = name[:1].upper() + name[1:] if name.isascii() else name
    return ", ".join(filter(None, [capital, side]))


def lines_of(words: Sequence[str], width: float) -> str:
    """The words with commas between them, in lines that are no wider than `width` [in]."""
    lines: list[str] = []
    for word in words:
        longer = f"{lines[-1]}, {word}" if lines else word
        if lines and width_of(longer) <= width:
            lines[-1] = longer
        else:
            lines.append(word)
    return "\n".join(lines)


def figure_title(figure: str) -> str:
    """Title of a figure by its name: `Fig. 5`, or `Walking page`."""
    number = figure.removeprefix("fig")
    return f"Fig. {number}" if number.isdecimal() else figure.replace("_", " ").capitalize()


def placed_rows(table: pl.DataFrame) -> list[tuple[str, pl.DataFrame]]:
    """The rows of each joint and side, with its name; results of different ones never share a panel."""
    parts = table.partition_by(PLACE, maintain_order=True)
    return [(place_name(part["joint"][0], part["side"][0]), part) for part in parts]


def of_place(table: pl.DataFrame) -> pl.DataFrame:
    """The table with the columns `joint` and `side`; null where it lacks them."""
    return table.with_columns(pl.lit(None, pl.String).alias(name) for name in PLACE if name not in table.columns)


def look_numbers(controllers: pl.Series) -> pl.Series:
    """For each controller (n,) its number among those that are not the draft's, in alphabetical order; null for these
    two, and where there is none.

    A figure of some controllers of a campaign has the numbers of all, so that a colour means one in every figure.
    """
    others = sorted({name for name in controllers.drop_nulls() if name not in DRAFT})
    return pl.Series("look", [others.index(name) if name in others else None for name in controllers], dtype=pl.Int64)


def looks_in(table: pl.DataFrame) -> dict[str | None, Look]:
    """Each controller of a table (`controller`, `look`) with colour, marker and label: the draft's first, then the
    others by name, then none. Where two long names are shortened to the same label, a number tells them apart.
    """
    numbers = dict(table.select("controller", "look").unique().iter_rows())
    others = sorted(name for name in numbers if name is not None and name not in DRAFT)
    names = [*(name for name in DRAFT if name in numbers), *others]
    looks: dict[str | None, Look] = {
        name: LOOKS[name] if name in DRAFT else other_look(name, numbers[name]) for name in names
    }
    if None in numbers:
        looks[None] = NO_CONTROLLER
    labels = [look.label for look in looks.values()]
    for number, (name, look) in enumerate(looks.items()):
        if labels.index(look.label) < number:
            looks[name] = replace(look, label=f"{look.label} ({number + 1})")
    return looks


def other_look(controller: str, number: int | None) -> Look:
    """Colour and marker of a controller that is not the draft's, by its number."""
    number = number or 0
    colour, marker = COLOURS[number % len(COLOURS)], MARKERS[number % len(MARKERS)]
    return Look(colour, marker, SIZE, drawn_name(controller), DASHES[number % len(DASHES)])
