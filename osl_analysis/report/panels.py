"""What the page draws of a trial: panels of lines, each of columns of the trial's tables."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import polars as pl

LineLook = Literal["measured", "model", "residual", "second", "third"]
MOST_RECORDED = 3000  # rows of a recording that are drawn where there is no fit
LINE_LOOKS: tuple[LineLook, ...] = ("measured", "model", "second", "third")  # looks of several lines of one panel
ANGLE_AXIS, TORQUE_AXIS = "Angle (deg)", "Torque (N·m)"


@dataclass(frozen=True)
class Drawn:
    """A line, points with an interval from `low` to `high`, or a range from `y` to `high`, of columns of one table."""

    table: str
    x: str
    y: str
    name: str
    look: LineLook = "measured"
    kind: Literal["line", "points", "range"] = "line"
    low: str = ""
    high: str = ""
    where: str = ""


@dataclass(frozen=True)
class Panel:
    """One panel. Panels with the same `linked` zoom together."""

    title: str
    x_label: str
    y_label: str
    drawn: Sequence[Drawn]
    linked: str = ""
    log_x: bool = False
    log_y: bool = False
    square: bool = False


@dataclass(frozen=True)
class Pictures:
    """The panels of a trial, the tables that they draw, and a sentence on how these were thinned."""

    panels: Sequence[Panel] = ()
    tables: dict[str, pl.DataFrame] = field(default_factory=dict)
    remark: str = ""


def over_time(title: str, label: str, *drawn: Drawn) -> Panel:
    return Panel(title, "Time (s)", label, drawn, "time")


def over_frequency(title: str, label: str, drawn: Sequence[Drawn], log_y: bool = False) -> Panel:
    return Panel(title, "Frequency (Hz)", label, drawn, "frequency", log_x=True, log_y=log_y)


def bench_pictures(series: pl.DataFrame, motion: str, whole_loop: bool = False) -> Pictures:
    """Torque, residual and motion over time, and torque against angle, of a fitted trial on the bench. `series` as
    `bench.series.Series.table` writes it, `motion` what moves. The loop is of the fitted samples, or whole."""
    x = "omega" if "omega" in series.columns else "theta_deg"
    label = f"{motion} (rad/s)" if x == "omega" else f"{motion} (deg)"
    both = [Drawn("series", "time", "torque", "measured"), Drawn("series", "time", "torque_model", "model", "model")]
    residual = Drawn(
        "series", "time", "residual_low", "measured minus model", "residual", "range", high="residual_high"
    )
    loops = [
        Drawn("series", x, "torque", "measured", where="" if whole_loop else "torque_model"),
        Drawn("series", x, "torque_model", "model", "model"),
    ]
    panels = [
        over_time("Torque", TORQUE_AXIS, *both),
        over_time("Residual, range of all samples that are fitted", TORQUE_AXIS, residual),
        over_time(motion, label, Drawn("series", "time", x, "measured")),
        Panel(f"Torque against {motion.lower()}", label, TORQUE_AXIS, loops, square=True),
    ]
    seconds = float(series["time"][-1] - series["time"][0]) if len(series) > 1 else 0.0
    rate = (len(series) - 1) / seconds if seconds else 0.0
    drawn = f"{rate:.0f} samples a second are drawn" if rate > 10 else f"{rate:.2g} samples a second are drawn"
    where = f"the model{'' if whole_loop else ', the loop'} and the residual are drawn where the fit uses the samples"
    return Pictures(panels, {"series": series}, f"{drawn}; {where}")


def phasor_pictures(phasors: pl.DataFrame, fit: Mapping[str, Any]) -> Pictures:
    """Magnitude and phase of the measured admittance over frequency, points per amplitude with their intervals. The
    line is that of Eq. 15 with `K`, `B` and `I` of the `fit` to all amplitudes."""
    magnitude = ("Y_magnitude", "Y_magnitude_low", "Y_magnitude_high")
    phase = ("Y_phase_deg", "Y_phase_low_deg", "Y_phase_high_deg")
    parts = phasors.partition_by("amplitude_deg", maintain_order=True, as_dict=True)
    tables = {f"{deg:g} deg": part for (deg,), part in parts.items()}
    looks = {name: LINE_LOOKS[k % len(LINE_LOOKS)] for k, name in enumerate(tables)}
    points = [
        [Drawn(name, "frequency_hz", y, name, look, "points", low, high) for name, look in looks.items()]
        for y, low, high in (magnitude, phase)
    ]
    tables["Eq. 15"] = second_order_admittance(phasors["frequency_hz"], fit)
    for drawn, (y, *_) in zip(points, (magnitude, phase), strict=True):
        drawn.append(Drawn("Eq. 15", "frequency_hz", y, "Eq. 15, fit to all", "residual"))
    panels = [
        over_frequency("Admittance: magnitude", "|Y| (rad/(N·m))", points[0], log_y=True),
        over_frequency("Admittance: phase", "Phase (deg)", points[1]),
    ]
    return Pictures(panels, tables)


def second_order_admittance(frequency_hz: pl.Series, fit: Mapping[str, Any]) -> pl.DataFrame:
    """Y = 1/(K + B s + I s^2) of a fit (Eq. 15) from the lowest to the highest of these frequencies."""
    f = np.geomspace(float(frequency_hz.to_numpy().min()), float(frequency_hz.to_numpy().max()), 60)
    s = 2j * np.pi * f
    Y = 1 / (fit["K"] + fit["B"] * s + fit["I"] * s**2)
    return pl.DataFrame({"frequency_hz": f, "Y_magnitude": np.abs(Y), "Y_phase_deg": np.rad2deg(np.angle(Y))})


def response_pictures(response: pl.DataFrame) -> Pictures:
    """Magnitude and phase of the impedance over frequency, without a model, and the fit of Eq. 15."""
    columns = ("magnitude", "magnitude_eq15", "phase_deg", "phase_deg_eq15")
    drawn = [
        [
            Drawn("response", "frequency_hz", measured, "without a model", kind="points"),
            Drawn("response", "frequency_hz", model, "Eq. 15", "model"),
        ]
        for measured, model in (columns[:2], columns[2:])
    ]
    panels = [
        over_frequency("Impedance: magnitude", "|Z| (N·m/rad)", drawn[0], log_y=True),
        over_frequency("Impedance: phase", "Phase (deg)", drawn[1]),
    ]
    return Pictures(panels, {"response": response.select("frequency_hz", *columns).sort("frequency_hz")})


def crossing_pictures(crossing: pl.DataFrame) -> Pictures:
    """Torque, angle and platform of one analysed crossing, and torque against angle."""
    degrees = [pl.col(name).degrees().alias(f"{name}_deg") for name in ("theta", "platform")]
    table = crossing.select((pl.col("time") - pl.col("time").first()), *degrees, "torque")
    loop = Drawn("crossing", "theta_deg", "torque", "measured")
    panels = [
        over_time("Ankle torque", TORQUE_AXIS, Drawn("crossing", "time", "torque", "measured")),
        over_time("Ankle angle", ANGLE_AXIS, Drawn("crossing", "time", "theta_deg", "measured")),
        over_time("Platform", ANGLE_AXIS, Drawn("crossing", "time", "platform_deg", "measured")),
        Panel("Torque against angle", ANGLE_AXIS, TORQUE_AXIS, [loop], square=True),
    ]
    return Pictures(panels, {"crossing": table})


def isolated_pictures(response: pl.DataFrame) -> Pictures:
    """Isolated angle and torque around the onset of a perturbation, with the torque of its fit."""
    table = response.select((1e3 * pl.col("time")).alias("time_ms"), "theta_deg", "torque", "torque_model")
    residual = (pl.col("torque") - pl.col("torque_model")).alias("residual")
    label = "Time from the onset (ms)"
    torque = [
        Drawn("isolated", "time_ms", "torque", "isolated: perturbed minus mean unperturbed"),
        Drawn("isolated", "time_ms", "torque_model", "model", "model"),
    ]
    left = Drawn("isolated", "time_ms", "residual", "isolated minus model", "residual")
    panels = [
        Panel("Isolated torque", label, TORQUE_AXIS, torque, "onset"),
        Panel("Residual", label, TORQUE_AXIS, [left], "onset"),
        Panel("Isolated angle", label, ANGLE_AXIS, [Drawn("isolated", "time_ms", "theta_deg", "isolated")], "onset"),
    ]
    return Pictures(panels, {"isolated": table.with_columns(residual)})


def recorded_pictures(samples: pl.DataFrame, units: dict[str, str]) -> Pictures:
    """What a trial recorded, a panel per quantity: of one that no fit belongs to."""
    by_unit: dict[str, list[str]] = {}
    for column, unit in units.items():
        by_unit.setdefault(unit, []).append(column)
    tables, panels = {}, []
    for unit, columns in by_unit.items():
        rows = samples.select("time", *columns[: len(LINE_LOOKS)]).drop_nulls()
        rows = rows.gather_every(max(-(-len(rows) // MOST_RECORDED), 1))
        if len(rows) < 2:
            continue
        tables[unit] = rows.with_columns(pl.col("time") - samples["time"][0])
        drawn = [Drawn(unit, "time", name, name, LINE_LOOKS[k]) for k, name in enumerate(columns[: len(LINE_LOOKS)])]
        panels.append(over_time("As recorded", f"({unit})", *drawn))
    return Pictures(panels, tables, f"raw signals in canonical units, as ingested, {MOST_RECORDED} samples or fewer")


def together(*pictures: Pictures) -> Pictures:
    """The panels of several in one, with the drawn columns of their tables."""
    remark = "; ".join(filter(None, [one.remark for one in pictures]))
    panels = [panel for one in pictures for panel in one.panels]
    used: dict[str, dict[str, None]] = {}
    for drawn in (drawn for panel in panels for drawn in panel.drawn):
        used.setdefault(drawn.table, {}).update(
            dict.fromkeys(filter(None, (drawn.x, drawn.y, drawn.low, drawn.high, drawn.where)))
        )
    tables = {name: table for one in pictures for name, table in one.tables.items()}
    return Pictures(panels, {name: tables[name].select(list(columns)) for name, columns in used.items()}, remark)
