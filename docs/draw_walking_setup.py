"""Draw the walking laboratory of docs/walking.md: side view and top view, with markers, axes and
signs.

python docs/draw_walking_setup.py [docs/walking_setup.png]
"""

import sys
from pathlib import Path

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from osl_analysis.figures.style import (
    BLACK,
    DOUBLE_COLUMN,
    GREY,
    MAGENTA,
    ORANGE,
    PAPER,
    PURPLE,
    WHITE,
)

PLATFORM, FOOT, SHANK, ANKLE = GREY, ORANGE, PURPLE, MAGENTA
"""Colours of the clusters and of the malleoli."""
Point = tuple[float, float]


def markers(ax: Axes, points: list[Point], colour: str, hollow: bool = False) -> None:
    """Reflective markers at points [m]."""
    x, y = zip(*points, strict=True)
    ax.plot(x, y, "o", ms=6, mec=colour, mfc=WHITE if hollow else colour, mew=1.3, zorder=5)


def say(ax: Axes, text: str, at: Point, point: Point | None = None, colour: str = BLACK) -> None:
    """Text at a place, with a thin line to the point that it names."""
    line = {"arrowstyle": "-", "color": colour, "lw": 0.6, "shrinkB": 4} if point else None
    ax.annotate(
        text,
        point or at,
        at,
        color=colour,
        fontsize=9.5,
        ha="left",
        va="center",
        arrowprops=line,
        zorder=6,
    )


def arrow(ax: Axes, start: Point, end: Point, colour: str = BLACK, bend: float = 0.0) -> None:
    """An arrow, straight or bent."""
    style = {"arrowstyle": "-|>", "color": colour, "lw": 1.2, "connectionstyle": f"arc3,rad={bend}"}
    ax.annotate("", end, start, arrowprops=style | {"shrinkA": 0, "shrinkB": 0}, zorder=6)


def axes_at(ax: Axes, origin: Point, names: tuple[str, str], out: str) -> None:
    """The laboratory's axes at a corner: to the right, up, and out of the page."""
    x, y = origin
    arrow(ax, origin, (x + 0.11, y))
    arrow(ax, origin, (x, y + 0.11))
    ax.plot(x, y, "o", ms=7, mec=BLACK, mfc=WHITE, zorder=7)
    ax.plot(x, y, out, ms=2 if out == "." else 5, color=BLACK, zorder=8)
    ax.text(x + 0.12, y, names[0], fontsize=10, va="center")
    ax.text(x, y + 0.125, names[1], fontsize=10, ha="center")


def side_view(ax: Axes) -> None:
    """The sagittal plane, the person walking to the right; x to the right, z up [m]."""
    ax.add_patch(
        Polygon(
            [(-0.62, -0.07), (-0.33, -0.07), (-0.33, 0), (-0.62, 0)], fc="#E4E4E4", ec=GREY, lw=0.8
        )
    )
    ax.add_patch(
        Polygon([(0.33, -0.07), (0.62, -0.07), (0.62, 0), (0.33, 0)], fc="#E4E4E4", ec=GREY, lw=0.8)
    )
    ax.add_patch(
        Polygon(
            [(-0.29, -0.05), (0.29, -0.05), (0.29, 0), (-0.29, 0)], fc="#C9C9C9", ec=BLACK, lw=0.9
        )
    )
    ax.plot([0, 0], [-0.16, -0.05], color=GREY, lw=3, zorder=1)
    ax.add_patch(
        Polygon(
            [(-0.13, -0.2), (0.13, -0.2), (0.06, -0.14), (-0.06, -0.14)],
            fc="#C9C9C9",
            ec=GREY,
            lw=0.8,
        )
    )
    foot = [
        (-0.13, 0.0),
        (0.14, 0.0),
        (0.14, 0.03),
        (0.02, 0.075),
        (-0.04, 0.12),
        (-0.1, 0.12),
        (-0.13, 0.05),
    ]
    ax.add_patch(Polygon(foot, fc="#FBE3D2", ec=ORANGE, lw=1.0, joinstyle="round"))
    shank = [(-0.105, 0.1), (-0.035, 0.1), (0.075, 0.52), (-0.025, 0.52)]
    ax.add_patch(Polygon(shank, fc="#E2DAF0", ec=PURPLE, lw=1.0, joinstyle="round", zorder=2))
    markers(ax, [(-0.27, 0.015), (0.27, 0.015)], PLATFORM)
    markers(ax, [(-0.12, 0.04), (0.12, 0.05), (0.07, 0.025), (0.03, 0.09)], FOOT)
    markers(ax, [(-0.005, 0.25), (0.045, 0.33), (-0.015, 0.37), (0.05, 0.45)], SHANK)
    markers(ax, [(-0.065, 0.11)], ANKLE, hollow=True)
    say(
        ax,
        "shank cluster: 3 or more markers,\nnot on a line, on the pylon or shell",
        (0.15, 0.42),
        (0.05, 0.45),
        SHANK,
    )
    say(
        ax,
        "foot cluster: on the shoe or keel,\nwhere it does not bend",
        (0.2, 0.23),
        (0.12, 0.05),
        FOOT,
    )
    say(
        ax,
        "malleoli, medial and lateral:\non the joint's axis,\nstatic trial only",
        (-0.62, 0.24),
        (-0.065, 0.11),
        ANKLE,
    )
    say(
        ax,
        "platform cluster: on what turns\nwith the plate",
        (0.33, 0.085),
        (0.27, 0.015),
        "#4A4A4A",
    )
    say(ax, "force plate, bolted to\nthe moving platform", (-0.62, -0.14), (-0.2, -0.03))
    say(ax, "hexapod or hinge", (-0.5, -0.22), (-0.1, -0.18), "#4A4A4A")
    arrow(ax, (0.205, -0.085), (0.235, -0.005), BLACK, 0.25)
    say(ax, "toes up: direction up,\n$\\theta$ grows", (0.27, -0.14))
    arrow(ax, (-0.34, 0.5), (-0.17, 0.5))
    say(ax, "walking", (-0.34, 0.525))
    axes_at(ax, (-0.58, 0.38), ("$x$", "$z$, up"), "x")
    limits(ax, (-0.64, 0.74), (-0.24, 0.56), "(a) Side view, right leg")


def top_view(ax: Axes) -> None:
    """The ground plane; x to the right, y up [m]. The corners of the plate in the order of the C3D
    file."""
    ax.add_patch(
        Polygon(
            [(-0.48, -0.35), (0.42, -0.35), (0.42, 0.35), (-0.48, 0.35)],
            fc="#F1F1F1",
            ec=GREY,
            lw=0.8,
        )
    )
    ax.add_patch(
        Polygon(
            [(-0.3, -0.26), (0.3, -0.26), (0.3, 0.26), (-0.3, 0.26)], fc="#DADADA", ec=GREY, lw=0.9
        )
    )
    ax.add_patch(
        Polygon(
            [(-0.25, -0.22), (0.25, -0.22), (0.25, 0.22), (-0.25, 0.22)],
            fc="#C2C2C2",
            ec=BLACK,
            lw=0.9,
        )
    )
    foot = [
        (-0.14, -0.03),
        (-0.1, -0.05),
        (0.05, -0.06),
        (0.13, -0.035),
        (0.14, 0.02),
        (0.05, 0.045),
        (-0.11, 0.035),
    ]
    ax.add_patch(Polygon(foot, fc="#FBE3D2", ec=ORANGE, lw=1.0))
    markers(ax, [(-0.275, 0.24), (0.275, 0.24), (0.275, -0.24), (-0.275, -0.24)], PLATFORM)
    markers(ax, [(-0.12, 0.0), (0.11, 0.015), (0.07, -0.045), (0.03, 0.0)], FOOT)
    markers(ax, [(-0.065, 0.055), (-0.065, -0.065)], ANKLE, hollow=True)
    arrow(ax, (-0.065, -0.15), (-0.065, 0.17), ANKLE)
    say(ax, "ankle's axis, to the left", (-0.05, 0.155), None, ANKLE)
    say(ax, "ANKLE_MED", (0.0, 0.095), (-0.065, 0.055), ANKLE)
    say(ax, "ANKLE_LAT", (-0.02, -0.13), (-0.065, -0.065), ANKLE)
    say(ax, "corners of the plate,\nas in the C3D file", (0.08, -0.3))
    ax.plot([0.16, 0.248], [-0.262, -0.222], color=BLACK, lw=0.6)
    ax.plot(0.25, -0.22, "s", ms=4, color=BLACK)
    say(ax, "platform cluster,\nbeside the foot's path", (-0.12, 0.3), (-0.275, 0.24), "#4A4A4A")
    say(ax, "the whole foot on the\nplate, the other beside", (-0.46, -0.3))
    arrow(ax, (-0.46, -0.1), (-0.32, -0.1))
    say(ax, "walking", (-0.46, -0.07))
    axes_at(ax, (-0.45, 0.16), ("", "$y$"), ".")
    say(ax, "$x$", (-0.335, 0.135))
    limits(ax, (-0.49, 0.43), (-0.36, 0.36), "(b) From above")


def limits(ax: Axes, x: Point, y: Point, title: str) -> None:
    """A panel without frame, true to scale [m]."""
    ax.set(xlim=x, ylim=y, aspect="equal")
    ax.set_axis_off()
    ax.set_title(title, fontsize=11, loc="left")


def main() -> None:
    output = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/walking_setup.png")
    with mpl.rc_context(PAPER):
        figure = Figure(figsize=(1.3 * DOUBLE_COLUMN, 3.7), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1.25, 0.95))
        side_view(left)
        top_view(right)
        figure.savefig(output, dpi=220)


if __name__ == "__main__":
    main()
