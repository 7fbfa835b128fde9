# SPDX-License-Identifier: Apache-2.0
"""The plots of the page's trials, as one document of Bokeh.

The page's script puts the signals of the open trial into the document.

Example: `plots()["target_id"]` is the element of the page that holds them.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bokeh.core.types import ID
from bokeh.embed import json_item
from bokeh.layouts import column
from bokeh.models import ColumnDataSource, HoverTool
from bokeh.models.annotations import Whisker
from bokeh.plotting import figure
from bokeh.resources import Resources
from bokeh.themes import Theme

from osl_analysis.report.trial_signals import RESPONSE, SIGNALS

# colours that show on light and on dark ground
MEASURED_COLOUR = "#3f7fbf"
MODEL_COLOUR = "#e06000"
RESIDUAL_COLOUR = "#1a9070"
BAR_COLOUR = "#7a7a7a"
TOOLS = "xpan,xbox_zoom,xwheel_zoom,reset"
TALL_PX = 260  # height of a panel [px]
FLAT_PX = 170


def library() -> str:
    """Bokeh's JavaScript, without its widgets and tables, as `script` elements."""
    return str(Resources(mode="inline", components=["bokeh"], log_level="error").render_js())


def plots() -> Mapping[str, Any]:
    """The plots as JSON, to be embedded in the page's element `plots`.

    Panels over time zoom together, and so do panels over frequency. The page hides a panel if the
    trial lacks one of the columns in its tags. An axis with the tag `motion` gets the name of the
    moving part.
    """
    signals = ColumnDataSource({name: [0.0, 1.0] for name in SIGNALS}, name="signals")
    response = ColumnDataSource({name: [1.0, 2.0] for name in RESPONSE}, name="response")
    torque = panel("torque", "Time (s)", "Torque (N·m)", TALL_PX)
    residual = panel("residual", "Time (s)", "Residual (N·m)", FLAT_PX, x_range=torque.x_range)
    residual.line("time", "residual", source=signals, color=RESIDUAL_COLOUR)
    motion = panel("motion", "Time (s)", "Joint angle (deg)", FLAT_PX, x_range=torque.x_range)
    motion.line("time", "motion", source=signals, color=MEASURED_COLOUR)
    motion.yaxis.tags = ["motion"]
    loop = panel("motion", "Joint angle (deg)", "Torque (N·m)", TALL_PX)
    loop.tags.append("torque")
    loop.xaxis.tags = ["motion"]
    for signal, color in (("torque", MEASURED_COLOUR), ("model", MODEL_COLOUR)):
        torque.line("time", signal, source=signals, color=color, legend_label=signal)
        loop.line("motion", signal, source=signals, color=color, alpha=0.6)
    for over_time in (torque, residual, motion):
        over_time.add_tools(HoverTool(tooltips=[("", "$y at $x s")], mode="vline"))
    magnitude = panel(
        "magnitude",
        "Frequency (Hz)",
        "|Y| (rad/(N·m))",
        TALL_PX,
        x_axis_type="log",
        y_axis_type="log",
    )
    bars = Whisker(
        base="frequency", lower="low", upper="high", source=response, line_color=BAR_COLOUR
    )
    magnitude.add_layout(bars)
    phase = panel(
        "phase",
        "Frequency (Hz)",
        "Phase (deg)",
        FLAT_PX,
        x_axis_type="log",
        x_range=magnitude.x_range,
    )
    for over_frequency, measured in ((magnitude, "magnitude"), (phase, "phase")):
        over_frequency.scatter("frequency", measured, source=response, color=MEASURED_COLOUR)
        over_frequency.line("frequency", f"model_{measured}", source=response, color=MODEL_COLOUR)
    panels = [torque, residual, motion, loop, magnitude, phase]
    return json_item(
        column(*panels, sizing_mode="stretch_width"),
        ID("plots"),
        theme=Theme(Path(__file__).with_suffix(".yaml")),
    )


def panel(tag: str, x_label: str, y_label: str, height: int, **choices: Any) -> figure:
    """An empty panel."""
    return figure(
        height=height,
        sizing_mode="stretch_width",
        tools=TOOLS,
        toolbar_location="right" if height == TALL_PX else None,
        active_drag="xbox_zoom",
        x_axis_label=x_label,
        y_axis_label=y_label,
        tags=[tag],
        **choices,
    )
