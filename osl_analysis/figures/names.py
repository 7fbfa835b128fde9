"""Words in a figure: labels of quantities, titles by condition, and names of a campaign as the
fonts can draw them."""

import unicodedata
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cache

import polars as pl
from matplotlib.font_manager import FontProperties, findfont, get_font

from osl_analysis.figures.style import BLUE, BROWN, LOOKS, PAPER, Dash, Look

AXIS_LABELS = {  # one name per quantity, in every figure
    "K": r"Stiffness $\hat{K}$ (N·m/rad)",
    "B": r"Damping $\hat{B}$ (N·m·s/rad)",
    "I": r"Apparent inertia $\hat{I}$ (10$^{-3}$ kg·m$^2$)",
    "K_d": "Desired stiffness $K_d$ (N·m/rad)",
    "B_d": "Desired damping $B_d$ (N·m·s/rad)",
}
VISCOUS_DAMPING = r"Viscous damping $B_\mathrm{viscous}$"
LINEAR_MODEL = "Linear model"  # drivetrain with a controller's gains, without friction (Eq. 9)
MEAN_RESPONSE = "mean response"  # isolated, over all perturbations of a group

# of controllers other than those of the draft: with these two and black, colours are 20 or more
# apart (CIE 1976) for readers without long- or medium-wavelength cones
COLOURS = (BLUE, BROWN, "#2F5555", "#B98860", "#2B46F0")
MARKERS = ("s", "^", "v", "P", "X", "p", "h")
DASHES: tuple[Dash, ...] = (
    (0, (2, 1.2)),
    (0, (9, 2)),
    (0, (3, 1, 1, 1, 1, 1)),
    (0, (6, 1, 2, 1)),
    (0, (12, 1.5, 1.5, 1.5)),
)
NO_CONTROLLER = Look("#757575", ">", 3.6, "Controller not stated", (0, (1, 0.8)))
JOINT_SIDE = ("joint", "side")
TEXT_COLUMNS = ("trial", "trials", *JOINT_SIDE, "controller", "method", "doubtful")


# Names as the fonts can draw them


@cache
def drawable_letters() -> frozenset[int]:
    """The letters, by code, that the fonts have."""
    files = [findfont(FontProperties(family=[family])) for family in PAPER["font.family"]]
    return frozenset(code for file in files for code in get_font(file).get_charmap())


def with_glyphs(text: str) -> str:
    """A text of which every letter can be drawn: a sign stands for those that no font of the
    figures has."""
    composed = unicodedata.normalize("NFC", text)
    letters = [
        letter if ord(letter) in drawable_letters() or letter == "\n" else "\ufffd"
        for letter in composed
    ]
    return "".join(letters)


def drawn_name(name: str, longest: int = 28) -> str:
    """Write a name from a file as matplotlib draws it: no mathematics, no label that `_` hides.

    Parameters
    ----------
    name : str
    longest : int
        Letters at most. A longer name is shortened in its middle.
    """
    short = name
    if len(name) > longest:
        n_last = longest // 3
        short = f"{name[: longest - n_last - 1]}…{name[-n_last:]}"
    escaped = with_glyphs(short).replace("$", r"\$")
    return f" {escaped}" if escaped.startswith("_") else escaped


def place_name(joint: str | None, side: str | None) -> str:
    """Joint and side in the title of a panel, such as `Knee, left`; empty where no joint is
    known."""
    name = drawn_name(joint or "")
    capital = name[:1].upper() + name[1:] if name.isascii() else name
    return ", ".join(part for part in (capital, side) if part)


def figure_title(figure: str) -> str:
    """The title of a figure's section: `Fig. 5` of `fig5`, `Walking page` of `walking_page`."""
    number = figure.removeprefix("fig")
    return f"Fig. {number}" if number.isdecimal() else figure.replace("_", " ").capitalize()


def count_of(n: int, noun: str) -> str:
    """A number of things, such as `1 trial` or `3 trials`."""
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


# Titles by condition


def condition_parts(
    controller: str | None,
    K_d: float | None,
    B_d: float | None,
    *,
    with_units: bool = True,
    written: Callable[[str], str] = drawn_name,
) -> list[str]:
    """What is stated of a condition: K_d, B_d and the controller.

    Parameters
    ----------
    controller : str or None
    K_d : float or None
        Desired stiffness [N·m/rad].
    B_d : float or None
        Desired damping [N·m·s/rad].
    with_units : bool
        Whether the units are written. A narrow panel has no room for them.
    written : callable
        How a name from a file is written, in a figure or in Markdown.

    Returns
    -------
    list of str
        Such as `$K_d$ = 200 N·m/rad`. Empty where nothing is stated.
    """
    parts = []
    for symbol, value, unit in (("K_d", K_d, "N·m/rad"), ("B_d", B_d, "N·m·s/rad")):
        if value is not None:
            parts.append(f"${symbol}$ = {value:g}{f' {unit}' if with_units else ''}")
    if controller is not None:
        parts.append(written(controller))
    return parts


def trial_titles(
    table: pl.DataFrame, *, is_narrow: bool = False, written: Callable[[str], str] | None = None
) -> dict[str, str]:
    """Name trials by their conditions.

    Parameters
    ----------
    table : DataFrame
        With `trial`, `controller`, `K_d` and `B_d`, and any number of rows for each trial.
    is_narrow : bool
        The title is for a third of a page: without units, and with the controller below.
    written : callable, optional
        How a name from a file is written; as in a figure by default.

    Returns
    -------
    dict of str
        By trial. A trial without a stated condition, and one of several of one condition, has its
        name there.
    """
    keys = ["controller", "K_d", "B_d"]
    trials = table.select("trial", *keys).unique("trial", maintain_order=True)
    trials = trials.with_columns(n_alike=pl.len().over(keys))
    titles = {}
    for trial, controller, K_d, B_d, n_alike in trials.iter_rows():
        parts = condition_parts(
            controller, K_d, B_d, with_units=not is_narrow, written=written or drawn_name
        )
        name = written(trial) if written else drawn_name(trial, 18 if is_narrow else 60)
        if not parts:
            titles[trial] = name if written else f"Trial {name}"
            continue
        if n_alike > 1:
            parts.append(name)
        desired = [part for part in parts if part.startswith("$")]
        others = [part for part in parts if not part.startswith("$")]
        lines = [", ".join(desired), ", ".join(others)] if is_narrow else [", ".join(parts)]
        titles[trial] = "\n".join(line for line in lines if line)
    return titles


# Rows of joints, sides and controllers


def placed_rows(table: pl.DataFrame) -> list[tuple[str, pl.DataFrame]]:
    """The rows of each joint and side, with its name; results of different ones never share a
    panel."""
    parts = table.partition_by(JOINT_SIDE, maintain_order=True)
    return [(place_name(*part.select(JOINT_SIDE).row(0)), part) for part in parts]


def panel_titles(parts: Sequence[tuple[str, pl.DataFrame]]) -> list[str]:
    """What stands over a panel of each of `placed_rows`: joint and side, if these differ."""
    return [name if len(parts) > 1 else "" for name, _ in parts]


def completed(table: pl.DataFrame, columns: Iterable[str], only: bool = False) -> pl.DataFrame:
    """The table with these columns, or `only` these; null where it lacks them."""
    columns = list(columns)
    nulls = []
    for name in columns:
        if name not in table.columns:
            kind = pl.String if name in TEXT_COLUMNS else pl.Float64
            nulls.append(pl.lit(None, kind).alias(name))
    full = table.with_columns(nulls)
    return full.select(columns) if only else full


def has_values(table: pl.DataFrame, column: str) -> bool:
    """Whether the table has this column, and a row a value in it."""
    return column in table.columns and table[column].count() > 0


def has_desired(table: pl.DataFrame) -> bool:
    """Whether a trial of the table states K_d or B_d."""
    return has_values(table, "K_d") or has_values(table, "B_d")


def look_numbers(controllers: pl.Series) -> pl.Series:
    """The number of each controller (n,) among those that are not the draft's; a campaign's colours
    mean one thing."""
    others = sorted(set(controllers.drop_nulls()) - set(LOOKS))
    numbers = [others.index(name) if name in others else None for name in controllers]
    return pl.Series("look", numbers, dtype=pl.Int64)


def looks_in(table: pl.DataFrame) -> dict[str | None, Look]:
    """The look of each controller of a table.

    Parameters
    ----------
    table : DataFrame
        With `controller`, and its number `look` by `look_numbers`.

    Returns
    -------
    dict of Look
        Those of the draft, the others by name, and that of trials without a controller. A number
        tells equal labels apart.
    """
    numbers = dict(table.select("controller", "look").unique().iter_rows())
    looks: dict[str | None, Look] = {name: look for name, look in LOOKS.items() if name in numbers}
    for name in sorted(name for name in numbers if name is not None and name not in LOOKS):
        number = numbers[name] or 0
        looks[name] = Look(
            COLOURS[number % len(COLOURS)],
            MARKERS[number % len(MARKERS)],
            NO_CONTROLLER.size,
            drawn_name(name),
            DASHES[number % len(DASHES)],
        )
    if None in numbers:
        looks[None] = NO_CONTROLLER

    labels = [look.label for look in looks.values()]
    for place, (controller, look) in enumerate(looks.items()):
        if look.label in labels[:place]:
            looks[controller] = replace(look, label=f"{look.label} ({place + 1})")
    return looks


def of_controller(table: pl.DataFrame, controller: str | None) -> pl.DataFrame:
    """The rows of one controller; None: those without."""
    return table.filter(pl.col("controller").eq_missing(pl.lit(controller)))
