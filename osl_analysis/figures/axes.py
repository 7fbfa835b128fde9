"""Ticks of logarithmic axes and of phases, and names at the ends of curves."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator, MultipleLocator
from numpy.typing import NDArray

from osl_analysis.figures.style import BLACK, SIZE_OF_TEXT

Array = NDArray[np.float64]
STEPS = ((1,), (1, 2, 5), (1, 2, 3, 5), (1, 2, 3, 4, 5, 6, 8), (1, 1.5, 2, 2.5, 3, 4, 5, 6, 7, 8, 9))
"""Ticks within a decade, from few to many."""
FEWEST, ENOUGH = 3, 5
"""Ticks of a decade's steps that an axis has at least; the fewest steps that give enough are taken."""
DEGREES = (0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 45, 90, 180)
"""Steps between ticks of an axis in degrees."""
ROOM = 1.1
"""Distance of names at the ends of curves, in heights of a letter."""


def log_ticks(low: float, high: float, most: int) -> list[float]:
    """Round values from `low` to `high` > 0 for a logarithmic axis, `most` or fewer.

    Within a span in which no decade's steps give three, they are evenly spaced.
    """
    decades = 10.0 ** np.arange(np.floor(np.log10(low)) - 1, np.ceil(np.log10(high)) + 1)
    slack = 1e-9
    found = [
        [
            decade * step
            for decade in decades
            for step in steps
            if low * (1 - slack) <= decade * step <= high * (1 + slack)
        ]
        for steps in STEPS
    ]
    wide = [float(decade) for decade in decades if low <= decade <= high]
    fitting = [ticks for ticks in found if FEWEST <= len(ticks) <= most]
    if fitting:
        return [float(tick) for tick in next((f for f in fitting if len(f) >= ENOUGH), max(fitting, key=len))]
    if len(wide) > most:
        return wide[:: -(-len(wide) // most)]
    even = MaxNLocator(nbins=max(most - 1, 2), steps=[1, 2, 2.5, 5, 10]).tick_values(low, high)
    return [float(tick) for tick in even if low <= tick <= high] or [low]


def label_log_axis(axis: Axis, limits: tuple[float, float], most: int, scale: float = 1.0) -> None:
    """A logarithmic axis from and to `limits` with `log_ticks`, written as numbers times `scale`."""
    ticks = log_ticks(*limits, most)
    axis.set_ticks(ticks, [f"{tick * scale:.4g}" for tick in ticks])
    axis.set_ticks([], minor=True)
    axis.set_view_interval(*limits, ignore=True)


def widened(low: float, high: float, share: float = 0.04) -> tuple[float, float]:
    """Limits of a logarithmic axis with a share of it free on either side; a single value stands in its middle."""
    span = np.log(high / low) if high > low else 1.0
    return low * float(np.exp(-share * span)), high * float(np.exp(share * span))


def label_phase_axis(ax: Axes) -> None:
    """Phases [deg] on the vertical axis: 0 stands on it, with a line, and ticks at usual fractions of a turn."""
    low, high = ax.get_ylim()
    margin = 0.04 * max(high, 0.0, high - low, -low)
    ax.set_ylim(min(low, -margin), max(high, margin))
    ax.axhline(0, color=BLACK, linewidth=0.4, zorder=0)
    span = float(np.ptp(ax.get_ylim()))
    ax.yaxis.set_major_locator(MultipleLocator(next((step for step in DEGREES if step >= span / 5), DEGREES[-1])))


def apart(places: Sequence[float], gap: float, limits: tuple[float, float] = (-np.inf, np.inf)) -> Array:
    """The places (n,), moved as little as possible (least squares) so that none is closer than `gap` to another.

    Their order stays: it is a monotone regression of `place - rank * gap`, by pooling neighbours that violate it. They
    lie within the limits if there is room for them.
    """
    values = np.asarray(places, dtype=float)
    order = np.argsort(values, kind="stable")
    pools: list[tuple[float, int]] = []
    for rank, value in enumerate(values[order]):
        mean, count = float(value - rank * gap), 1
        while pools and pools[-1][0] > mean:
            before, n = pools.pop()
            mean, count = (before * n + mean * count) / (n + count), n + count
        pools.append((mean, count))
    level = np.repeat([mean for mean, _ in pools], [count for _, count in pools])
    steps, moved = gap * np.arange(len(values)), np.empty(len(values))
    moved[order] = np.maximum(np.minimum(level + steps, limits[1] - steps[::-1]), limits[0] + steps)
    return moved


def name_ends(
    ax: Axes, ends: Sequence[tuple[float, float]], names: Sequence[str], colours: Sequence[str]
) -> list[Text]:
    """Names (n,) beside the right edge of a panel, each with a hair line to the end (x, y) of its curve.

    Names that would overlap are moved apart. The limits of the panel are kept.
    """
    figure = ax.figure.figure
    figure.draw_without_rendering()
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    height = ROOM * SIZE_OF_TEXT / 72 * figure.dpi / ax.get_window_extent().height * (high - low)
    places = apart([y for _, y in ends], height, (low, high))
    written: list[Text] = []
    for end, name, colour, place in zip(ends, names, colours, places, strict=True):
        hair = {"arrowstyle": "-", "color": colour, "linewidth": 0.4, "shrinkA": 0, "shrinkB": 0, "relpos": (0, 0.5)}
        beside = (right + 0.03 * (right - left), float(place))
        text = ax.annotate(name, end, beside, color=colour, va="center", arrowprops=hair, annotation_clip=False)
        written.append(text)
    ax.set(xlim=(left, right), ylim=(low, high))
    return written
