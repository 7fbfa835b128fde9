"""Axes with round numbers: logarithmic ones, frequencies, phases, and thousandths."""

from collections.abc import Sequence

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, MultipleLocator

from osl_analysis.figures.style import BLACK, HAIRLINE

FREE_SHARE = 0.04  # of an axis, on either side of its numbers
PHASE_STEPS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 45, 90)  # usual fractions of a turn [deg]
MOST_PHASES = 5  # steps of phase on an axis
LEAST_DISTANCE = 0.07  # share of an axis between two tested frequencies whose labels do not touch

LEAST_SHARE = 0.5  # of an axis over its most ticks, between two ticks whose numbers do not touch


def label_log_axis(axis: Axis, limits: tuple[float, float], most: int, scale: float = 1.0) -> None:
    """Give a logarithmic axis three to `most` ticks with numbers, or two.

    Parameters
    ----------
    axis : Axis
    limits : (float, float)
        Ends of the axis, in its unit.
    most : int
        Ticks at most. They are at 1, 2 and 5 of each decade, else at decades, else at 1 and 3, else
        even.
    scale : float
        The numbers that are written are those of the axis times this.
    """
    low, high = limits
    locators = (
        LogLocator(subs=(1, 2, 5), numticks=99),
        LogLocator(numticks=most),
        LogLocator(subs=(1, 3), numticks=99),
        MaxNLocator(nbins=most - 1, steps=[1, 2, 2.5, 5, 10]),
    )
    chosen: list[float] = []
    for locator in locators:
        candidates = locator.tick_values(low, high)
        ticks = [tick for tick in candidates if low * (1 - 1e-9) <= tick <= high * (1 + 1e-9)]
        is_readable = len(ticks) <= most and are_apart(ticks, limits, most)
        if is_readable and len(ticks) > len(chosen):
            chosen = ticks
        if len(chosen) >= 3:
            break
    set_log_ticks(axis, limits, chosen or [low], scale)


def are_apart(ticks: Sequence[float], limits: tuple[float, float], most: int) -> bool:
    """Whether these ticks of a logarithmic axis with room for `most` do not touch."""
    span = np.log(limits[1] / limits[0])
    return bool(np.all(np.diff(np.log(ticks)) >= LEAST_SHARE * span / most))


def set_log_ticks(
    axis: Axis, limits: tuple[float, float], ticks: Sequence[float], scale: float = 1.0
) -> None:
    """Write these ticks of a logarithmic axis as numbers times `scale`, and no others."""
    axis.set_ticks(ticks, [f"{tick * scale:.4g}" for tick in ticks])
    axis.set_ticks([], minor=True)
    axis.set_view_interval(*limits, ignore=True)


def label_frequency_axis(
    ax: Axes, frequency_hz: pl.Series, most: int, tested: Sequence[float] = ()
) -> None:
    """Make the horizontal axis one of frequencies [Hz], logarithmic.

    Parameters
    ----------
    ax : Axes
    frequency_hz : (n,)
        All that is drawn [Hz].
    most : int
        Ticks at most.
    tested : sequence of float
        Frequencies of a protocol [Hz]. Each has a tick if they are few and apart enough; else ticks
        are at round numbers.
    """
    low, high = float(frequency_hz.to_numpy().min()), float(frequency_hz.to_numpy().max())
    span = float(np.log(high / low)) if high > low else 1.0
    factor = float(np.exp(FREE_SHARE * span))
    limits = low / factor, high * factor

    ax.set_xscale("log")
    ticks = sorted(set(tested))
    are_apart = all(np.diff(np.log(ticks)) >= LEAST_DISTANCE * span)
    if 0 < len(ticks) <= most and are_apart:
        set_log_ticks(ax.xaxis, limits, ticks)
    else:
        label_log_axis(ax.xaxis, limits, most)
    ax.set_xlim(*limits)  # of all panels that share the axis


def label_phase_axis(ax: Axes) -> None:
    """Make the vertical axis one of phases [deg]: 0 stands on it, with a line, and ticks at usual
    fractions of a turn."""
    low, high = ax.get_ylim()
    # the length of the axis once 0 stands on it
    margin = FREE_SHARE * (max(high, 0.0) - min(low, 0.0))
    ax.set_ylim(min(low, -margin), max(high, margin))
    ax.axhline(0, color=BLACK, linewidth=HAIRLINE, zorder=0)

    span = float(np.ptp(ax.get_ylim()))
    wide_enough = [step for step in PHASE_STEPS if step >= span / MOST_PHASES]
    ax.yaxis.set_major_locator(MultipleLocator(wide_enough[0] if wide_enough else 180))


def label_in_thousandths(axis: Axis) -> None:
    """Write the numbers of an axis times 1000, 0.0025 as 2.5; its title says so: 10⁻³ and the
    unit."""
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{1e3 * value:.6g}".replace("-", "−")))
