"""Words and looks in a figure: labels of quantities, titles by condition, and names of a campaign
as matplotlib draws them."""

import textwrap

import polars as pl

from osl_analysis.figures.style import ORANGE, PURPLE, Look

AXIS_LABELS = {  # one name per quantity, in every figure
    "K": r"Stiffness $\hat{K}$ (N·m/rad)",
    "B": r"Damping $\hat{B}$ (N·m·s/rad)",
    "I": r"Apparent inertia $\hat{I}$ (10$^{-3}$ kg·m$^2$)",
    "K_d": "Desired stiffness $K_d$ (N·m/rad)",
    "B_d": "Desired damping $B_d$ (N·m·s/rad)",
}
LINEAR_MODEL = "Linear model"  # drivetrain with a controller's gains, without friction (Eq. 9)

LOOKS = {  # of the controllers of the draft
    "compensated": Look(ORANGE, "o", 3.8, "Compensated", (0, (4, 1.5))),
    "uncompensated": Look(PURPLE, "D", 3.4, "Uncompensated", (0, (5, 1.5, 1, 1.5))),
}
# of other controllers by their numbers: with these two and black, colours are 20 or more apart
# (CIE 1976) for readers without long- or medium-wavelength cones
COLOURS = ("#3F8FBF", "#6B3A0A", "#2F5555", "#B98860", "#2B46F0")
MARKERS = ("s", "^", "v", "P", "X", "p", "h")
NO_CONTROLLER = Look("#757575", ">", 3.6, "Controller not stated", (0, (1, 0.8)))


def drawn_name(name: str, letters: int = 22) -> str:
    """A name from a file as matplotlib draws it: in lines of so many letters, without mathematics,
    and no label that `_` hides."""
    lines = textwrap.fill(name, letters).replace("$", r"\$")
    return f" {lines}" if lines.startswith("_") else lines


def condition(rows: pl.DataFrame) -> list[str]:
    """What is stated of the condition of these rows, such as `$K_d$ = 200 N·m/rad`; empty where
    nothing is."""
    K_d, B_d, controller = rows.select("K_d", "B_d", "controller").row(0)
    parts = []
    for symbol, value, unit in (("$K_d$", K_d, " N·m/rad"), ("$B_d$", B_d, " N·m·s/rad")):
        if value is not None:
            parts.append(f"{symbol} = {value:g}{unit}")
    if controller is not None:
        parts.append(drawn_name(controller))
    return parts


def by_place(table: pl.DataFrame) -> list[tuple[str, pl.DataFrame]]:
    """The rows of each joint and side, whose results never share a panel, with a title such as
    `Knee, left`; it is empty where there is only one."""
    parts = table.partition_by("joint", "side", maintain_order=True)
    if len(parts) == 1:
        return [("", table)]
    titled = []
    for part in parts:
        joint, side = part.select("joint", "side").row(0)
        name = drawn_name(joint or "")
        named = f"{name[:1].upper()}{name[1:]}"
        titled.append((", ".join(word for word in (named, side) if word), part))
    return titled


def by_controller(table: pl.DataFrame) -> list[tuple[Look, pl.DataFrame]]:
    """The rows of each controller with its look: those of the draft, those that state none, and the
    others by `look`, their number."""
    ordered = table.sort("look", "controller", nulls_last=[False, True], maintain_order=True)
    parts = []
    for rows in ordered.partition_by("controller", maintain_order=True):
        name, number = rows.select("controller", "look").row(0)
        look = LOOKS.get(name, NO_CONTROLLER)
        if number is not None:
            look = Look(
                COLOURS[number % len(COLOURS)], MARKERS[number % len(MARKERS)], NO_CONTROLLER.size,
                drawn_name(name), NO_CONTROLLER.dash,
            )  # fmt: skip
        parts.append((look, rows))
    return parts


def has_values(table: pl.DataFrame, column: str) -> bool:
    """Whether the table has this column, and a row a value in it."""
    return column in table.columns and table[column].count() > 0
