"""Words on paper: names of a campaign as the fonts can draw them, captions, and the small line below every figure."""

import math
import re
import textwrap
import unicodedata
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from typing import Any

import polars as pl
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.transforms import Bbox

from osl_analysis.figures.style import GREY, LOOKS, PAPER, Dash, Look, paper_style
from osl_analysis.stats.repeats import IS_DOUBTFUL

COLOURS = ("#3F8FBF", "#6B3A0A", "#2F5555", "#B98860", "#2B46F0")
MARKERS = ("s", "^", "v", "P", "X", "p", "h")
DASHES: tuple[Dash, ...] = (
    (0, (2, 1.2)), (0, (9, 2)), (0, (3, 1, 1, 1, 1, 1)), (0, (6, 1, 2, 1)), (0, (12, 1.5, 1.5, 1.5)),
)  # fmt: skip
"""Of controllers other than those of the draft: with these two and black, colours are 20 or more apart (CIE 1976) for
readers without long- or medium-wavelength cones."""
NO_CONTROLLER = Look("#757575", ">", 3.6, "No controller", (0, (1, 0.8)))
JOINT_SIDE = ("joint", "side")


@cache
def drawable_letters() -> frozenset[int]:
    """The letters, by code, that the fonts have."""
    files = (findfont(FontProperties(family=[family])) for family in PAPER["font.family"])
    return frozenset(code for file in files for code in get_font(file).get_charmap())


def with_glyphs(text: str) -> str:
    """A text of which every letter can be drawn: a sign stands for those that no font of the figures has."""
    composed = unicodedata.normalize("NFC", text)
    return "".join(sign if ord(sign) in drawable_letters() or sign == "\n" else "\ufffd" for sign in composed)


def drawn_name(name: str, longest: int = 28) -> str:
    """A name as matplotlib draws it, shortened in its middle: no mathematics, and no label that `_` hides."""
    short = name if len(name) <= longest else f"{name[: longest - longest // 3 - 1]}…{name[-(longest // 3) :]}"
    escaped = with_glyphs(short).replace("$", r"\$")
    return f" {escaped}" if escaped.startswith("_") else escaped


def place_name(joint: str | None, side: str | None) -> str:
    """Joint and side in the title of a panel, such as `Knee, left`; empty where no joint is known."""
    name = drawn_name(joint or "")
    capital = name[:1].upper() + name[1:] if name.isascii() else name
    return ", ".join(filter(None, [capital, side]))


def figure_title(figure: str) -> str:
    number = figure.removeprefix("fig")
    return f"Fig. {number}" if number.isdecimal() else figure.replace("_", " ").capitalize()


def placed_rows(table: pl.DataFrame) -> list[tuple[str, pl.DataFrame]]:
    """The rows of each joint and side, with its name; results of different ones never share a panel."""
    parts = table.partition_by(JOINT_SIDE, maintain_order=True)
    return [(place_name(*part.select(JOINT_SIDE).row(0)), part) for part in parts]


def completed(table: pl.DataFrame, columns: Iterable[str], only: bool = False) -> pl.DataFrame:
    """The table with these columns, or `only` these; null where it lacks them."""
    words, columns = ("trial", "trials", *JOINT_SIDE, "controller", "method", "doubtful"), list(columns)
    absent = (name for name in columns if name not in table.columns)
    nulls = (pl.lit(None, pl.String if name in words else pl.Float64).alias(name) for name in absent)
    return table.with_columns(nulls).select(columns if only else pl.all())


def look_numbers(controllers: pl.Series) -> pl.Series:
    """The number of each controller (n,) among those that are not the draft's; a campaign's colours mean one thing."""
    others = sorted(set(controllers.drop_nulls()) - set(LOOKS))
    return pl.Series("look", [others.index(name) if name in others else None for name in controllers], dtype=pl.Int64)


def looks_in(table: pl.DataFrame) -> dict[str | None, Look]:
    """Each controller with its look: the draft's, the others by name, none. A number tells equal labels apart."""
    numbers = dict(table.select("controller", "look").unique().iter_rows())
    looks: dict[str | None, Look] = {name: look for name, look in LOOKS.items() if name in numbers}
    for name in sorted(name for name in numbers if name is not None and name not in LOOKS):
        k = numbers[name] or 0
        colour, marker = COLOURS[k % len(COLOURS)], MARKERS[k % len(MARKERS)]
        looks[name] = Look(colour, marker, NO_CONTROLLER.size, drawn_name(name), DASHES[k % len(DASHES)])
    if None in numbers:
        looks[None] = NO_CONTROLLER
    labels = [look.label for look in looks.values()]
    for k, (controller, look) in enumerate(looks.items()):
        if look.label in labels[:k]:
            looks[controller] = replace(look, label=f"{look.label} ({k + 1})")
    return looks


def of_controller(table: pl.DataFrame, controller: str | None) -> pl.DataFrame:
    return table.filter(pl.col("controller").eq_missing(pl.lit(controller)))


UNIT_SIGN = {"K": "N·m/rad", "B": "N·m·s/rad", "I": "kg·m²"}  # as they are printed


def as_text(name: str) -> str:
    """A name from a file, of which Markdown shows every sign. Some dialects join repeated hyphens and dots."""
    special = r"[\\`*_{}\[\]<>#|~$&!^@\"']|:(?=//)|(?<=-)-|(?<=\.)\.|(?<=www)\."
    plain = " ".join(re.sub(r"[\x00-\x1f\x7f\u2028\u2029]", " ", name).split())
    return re.sub(special, lambda sign: f"\\{sign[0]}", plain)


def capital_text(*parts: str | None) -> str:
    """Names from files as the beginning of a sentence, with commas between those that are known."""
    said = ", ".join(filter(None, parts))
    return as_text(said[:1].upper() + said[1:])


def listed_text(names: Iterable[str], most: int = 6) -> str:
    """Names from files, each once; of more than `most` the first ones and how many more: the tables have all."""
    found = [as_text(name) for name in dict.fromkeys(names)]
    return ", ".join(found[:most]) + (f" and {len(found) - most} more" if len(found) > most else "")


def decimals_of(spread: float, largest: float = 0.0) -> int:
    """Digits behind the point at which a half width or standard deviation has two significant ones. A number of the
    size `largest` has no more than five: rounding leaves a spread where there is none."""
    sizes = ((spread, 2), (largest, 5))
    digits = [most - 1 - math.floor(math.log10(abs(size))) for size, most in sizes if size and math.isfinite(size)]
    return max(min(digits, default=0), 0)


def rounded_number(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}".replace("-", "−") if round(value, decimals) else f"{0:.{decimals}f}"


def with_interval(value: float, low: float | None, high: float | None, unit: str) -> str:
    """An estimate with its 95 % interval, as `299.1 N·m/rad (95 % interval 298.2 to 300.0)`; alone without one."""
    if low is None or high is None:
        return f"{value:.4g} {unit}".replace("-", "−")
    digits = decimals_of((high - low) / 2, value)
    ends = f"{rounded_number(low, digits)} to {rounded_number(high, digits)}"
    return f"{rounded_number(value, digits)} {unit} (95 % interval {ends})"


def with_sd(mean: float, sd: float | None, unit: str) -> str:
    """A mean with its standard deviation, as `338 ± 20 N·m/rad`; alone without one."""
    if sd is None:
        return f"{mean:.3g} {unit}".replace("-", "−")
    digits = decimals_of(sd, mean)
    return f"{rounded_number(mean, digits)} ± {rounded_number(sd, digits)} {unit}"


def count_of(n: int, one: str, several: str = "") -> str:
    return f"{n} {one if n == 1 else several or one + 's'}"


def doubtful_said(table: pl.DataFrame, look: str, fit: str = "fit") -> str:
    """Which of the drawn fits are doubtful, how they `look`, and why, as `Doubtful, drawn open: 2 of 32 fits (a, b),
    for friction.`"""
    found = table.filter(IS_DOUBTFUL)
    if found.is_empty():
        return f"No {fit} is doubtful."
    causes = dict.fromkeys(found["doubtful"])
    drawn = f"{len(found)} of {count_of(len(table), fit)} ({listed_text(found['trial'])})"
    return f"Doubtful, {look}: {drawn}, for {as_text(', '.join(causes))}."


@paper_style()
def write_footer(figure: Figure, text: str) -> Bbox:
    """A small line below a drawn figure, whose size and layout stay; the part of the plane [in] to be saved, which is
    as much taller."""
    (width, height), size, line, edge = figure.get_size_inches(), 5.5, 0.1, 0.02  # [in]; size of the letters [pt]
    lines = textwrap.wrap(text, int(width * 28))  # letters per inch
    look: dict[str, Any] = {"fontsize": size, "color": GREY, "ha": "center", "va": "top", "linespacing": 1.1}
    words = figure.text(0.5, -edge / height, with_glyphs("\n".join(lines)), parse_math=False, **look)
    words.set_in_layout(False)
    return Bbox.from_extents(0.0, -(line * len(lines) + 2 * edge), width, height)
