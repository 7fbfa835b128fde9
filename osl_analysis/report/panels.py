"""What the page draws of a trial: panels with lines, and the tables that these draw."""

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from itertools import cycle
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from osl_analysis.trial import Array

Content = dict[str, Any]  # as `templates/report.js` reads it
LINE_LOOKS = ("measured", "model", "second", "third")  # looks of several lines of one panel
TORQUE_AXIS = "Torque (N·m)"
ANGLE_AXIS = "Angle (deg)"
MOST_SAMPLES = 3000  # rows of a recording that are drawn
CURVE_POINTS = 60  # of a model over frequency


class Pictures(NamedTuple):
    """What is drawn of a trial."""

    panels: list[Content]
    tables: dict[str, pl.DataFrame]  # that the panels draw
    remark: str = ""  # how these were thinned


def line(
    table: str,
    x: str,
    y: str,
    name: str,
    look: str = "measured",
    kind: str = "line",
    low: str = "",
    high: str = "",
    where: str = "",
) -> Content:
    """Columns of one table as a line.

    Parameters
    ----------
    look : str
        One of `LINE_LOOKS` or "residual".
    kind : str
        "line"; "points", with an interval from `low` to `high`; or "range", from `y` to `high`.
    where : str
        The line is drawn where this column has a value.
    """
    return {
        "table": table,
        "x": x,
        "y": y,
        "name": name,
        "look": look,
        "kind": kind,
        "low": low,
        "high": high,
        "where": where,
    }


def panel(
    title: str,
    x_label: str,
    y_label: str,
    *lines: Content,
    linked: str = "",
    log_x: bool = False,
    log_y: bool = False,
    square: bool = False,
) -> Content:
    """One panel; panels with the same `linked` zoom together."""
    return {
        "title": title,
        "x_label": x_label,
        "y_label": y_label,
        "drawn": lines,
        "linked": linked,
        "log_x": log_x,
        "log_y": log_y,
        "square": square,
    }


def over_time(title: str, label: str, *lines: Content) -> Content:
    return panel(title, "Time (s)", label, *lines, linked="time")


def over_frequency(
    what: str, magnitude_axis: str, magnitude: Iterable[Content], phase: Iterable[Content]
) -> list[Content]:
    """Two panels: the magnitude of a response, with the name of its axis, and its phase."""
    over_hz = partial(panel, linked="frequency", log_x=True)
    return [
        over_hz(f"{what}: magnitude", "Frequency (Hz)", magnitude_axis, *magnitude, log_y=True),
        over_hz(f"{what}: phase", "Frequency (Hz)", "Phase (deg)", *phase),
    ]


def bench_pictures(series: pl.DataFrame, motion: str, whole_loop: bool = False) -> Pictures:
    """Torque, residual and motion over time, and torque against angle, of a fitted trial.

    Parameters
    ----------
    series : polars.DataFrame
        A `fit_tables.Series.table`.
    motion : str
        The name of the moving angle.
    whole_loop : bool
        Whether torque against angle has all samples, not only those that are fitted.
    """
    x, unit = ("omega", "rad/s") if "omega" in series.columns else ("theta_deg", "deg")
    motion_axis = f"{motion} ({unit})"
    series_line = partial(line, "series")
    torque = series_line("time", "torque", "measured")
    torque_of_model = series_line("time", "torque_model", "model", "model")
    residual = series_line(
        "time",
        "residual_low",
        "measured minus model",
        "residual",
        kind="range",
        high="residual_high",
    )
    loop_where = "" if whole_loop else "torque_model"
    loop = series_line(x, "torque", "measured", where=loop_where)
    loop_of_model = series_line(x, "torque_model", "model", "model")
    against_motion = f"Torque against {motion.lower()}"
    panels = [
        over_time("Torque", TORQUE_AXIS, torque, torque_of_model),
        over_time("Residual, range of all samples that are fitted", TORQUE_AXIS, residual),
        over_time(motion, motion_axis, series_line("time", x, "measured")),
        panel(against_motion, motion_axis, TORQUE_AXIS, loop, loop_of_model, square=True),
    ]
    where = "the model and the residual" if whole_loop else "the model, the loop and the residual"
    remark = (
        f"{rate_text(series['time'].to_numpy())} samples a second are drawn; {where} are drawn"
        " where the fit uses the samples"
    )
    return Pictures(panels, {"series": series}, remark)


def rate_text(time: Array) -> str:
    """The mean rate [Hz] of samples at these times (n,)."""
    seconds = float(time[-1] - time[0]) if len(time) > 1 else 0.0
    rate_hz = (len(time) - 1) / seconds if seconds else 0.0
    return f"{rate_hz:.0f}" if rate_hz > 10 else f"{rate_hz:.2g}"


def phasor_pictures(phasors: pl.DataFrame, fit: Mapping[str, Any]) -> Pictures:
    """Magnitude and phase of the measured admittance over frequency, with intervals, points per
    amplitude. The line is Eq. 15 with `K`, `B` and `I` of the `fit` to all amplitudes."""
    tables: dict[str, pl.DataFrame] = {}
    for of_amplitude in phasors.partition_by("amplitude_deg", maintain_order=True):
        tables[f"{of_amplitude['amplitude_deg'][0]:g} deg"] = of_amplitude
    magnitude = phasor_lines(list(tables), "Y_magnitude")
    phase = phasor_lines(list(tables), "Y_phase_deg")

    measured_hz = phasors["frequency_hz"].to_numpy()
    hz = np.geomspace(float(measured_hz.min()), float(measured_hz.max()), CURVE_POINTS)
    s = 2j * np.pi * hz
    Y = 1 / (fit["K"] + fit["B"] * s + fit["I"] * s**2)
    curve = {"frequency_hz": hz, "Y_magnitude": np.abs(Y), "Y_phase_deg": np.rad2deg(np.angle(Y))}
    tables["model"] = pl.DataFrame(curve)
    return Pictures(over_frequency("Admittance", "|Y| (rad/(N·m))", magnitude, phase), tables)


def phasor_lines(amplitudes: Sequence[str], y: str) -> list[Content]:
    """The points of each amplitude with their intervals, and the line of Eq. 15."""
    lines = []
    for amplitude, look in zip(amplitudes, cycle(LINE_LOOKS), strict=False):
        lines.append(
            line(
                amplitude,
                "frequency_hz",
                y,
                amplitude,
                look,
                kind="points",
                low=f"{y}_low",
                high=f"{y}_high",
            )
        )
    lines.append(line("model", "frequency_hz", y, "K, B and I, fit to all", "residual"))
    return lines


def response_pictures(response: pl.DataFrame) -> Pictures:
    """Magnitude and phase of the impedance over frequency, without a model, and the fit of Eq.
    15."""
    response_line = partial(line, "response", "frequency_hz")
    magnitude, phase = (
        [
            response_line(y, "without a model", kind="points"),
            response_line(f"{y}_eq15", "K, B and I", "model"),
        ]
        for y in ("magnitude", "phase_deg")
    )
    panels = over_frequency("Impedance", "|Z| (N·m/rad)", magnitude, phase)
    return Pictures(panels, {"response": response.sort("frequency_hz")})


def crossing_pictures(crossing: pl.DataFrame) -> Pictures:
    """Torque, angle and platform of one analysed crossing, and torque against angle."""
    measured = partial(line, "crossing", name="measured")
    panels = [
        over_time("Ankle torque", TORQUE_AXIS, measured("time", "torque")),
        over_time("Ankle angle", ANGLE_AXIS, measured("time", "theta_deg")),
    ]
    if "platform" in crossing.columns:
        panels.append(over_time("Platform", ANGLE_AXIS, measured("time", "platform_deg")))
    loop = measured("theta_deg", "torque")
    panels.append(panel("Torque against angle", ANGLE_AXIS, TORQUE_AXIS, loop, square=True))

    drawn = crossing.with_columns(pl.col("time") - pl.col("time").first())
    for name in ("theta", "platform"):
        if name in crossing.columns:
            drawn = drawn.with_columns(pl.col(name).degrees().alias(f"{name}_deg"))
    return Pictures(panels, {"crossing": drawn})


def isolated_pictures(response: pl.DataFrame) -> Pictures:
    """Isolated angle and torque around the onset of a perturbation, with the torque of its fit."""
    time_axis = "Time from the onset (ms)"
    isolated_line = partial(line, "isolated", "time_ms")
    torque = isolated_line("torque", "isolated: perturbed minus mean unperturbed")
    torque_of_model = isolated_line("torque_model", "model", "model")
    residual = isolated_line("residual", "isolated minus model", "residual")
    angle = isolated_line("theta_deg", "isolated")
    around_onset = partial(panel, linked="onset")
    panels = [
        around_onset("Isolated torque", time_axis, TORQUE_AXIS, torque, torque_of_model),
        around_onset("Residual", time_axis, TORQUE_AXIS, residual),
        around_onset("Isolated angle", time_axis, ANGLE_AXIS, angle),
    ]
    drawn = response.with_columns(
        time_ms=1e3 * pl.col("time"), residual=pl.col("torque") - pl.col("torque_model")
    )
    return Pictures(panels, {"isolated": drawn})


def recorded_pictures(samples: pl.DataFrame, units: dict[str, str]) -> Pictures:
    """The recorded signals of a trial without a fit: a panel per quantity, with four lines at
    most. `units` has the unit of each signal."""
    tables: dict[str, pl.DataFrame] = {}
    panels: list[Content] = []
    for unit in dict.fromkeys(units.values()):
        columns = [name for name, other_unit in units.items() if other_unit == unit]
        columns = columns[: len(LINE_LOOKS)]
        rows = samples.select("time", *columns).drop_nulls()
        rows = rows.gather_every(max(math.ceil(len(rows) / MOST_SAMPLES), 1))
        if len(rows) < 2:
            continue
        tables[unit] = rows.with_columns(pl.col("time") - samples["time"][0])
        lines = []
        for name, look in zip(columns, LINE_LOOKS, strict=False):
            lines.append(line(unit, "time", name, name, look))
        panels.append(over_time("As recorded", f"({unit})", *lines))
    remark = f"raw signals in canonical units, as ingested, {MOST_SAMPLES} samples or fewer"
    return Pictures(panels, tables, remark)


def together(*pictures: Pictures) -> Pictures:
    """Several pictures joined: all panels, and the drawn columns of their tables."""
    panels: list[Content] = []
    tables: dict[str, pl.DataFrame] = {}
    remarks: list[str] = []
    for picture in pictures:
        panels += picture.panels
        tables.update(picture.tables)
        if picture.remark:
            remarks.append(picture.remark)
    columns_of: dict[str, dict[str, None]] = {}  # by table, each column once
    for each_panel in panels:
        for drawn in each_panel["drawn"]:
            columns = columns_of.setdefault(drawn["table"], {})
            for key in ("x", "y", "low", "high", "where"):
                if drawn[key]:
                    columns[drawn[key]] = None
    used = {name: tables[name][list(columns)] for name, columns in columns_of.items()}
    return Pictures(panels, used, "; ".join(remarks))
