"""What the page draws of a trial: panels of lines, each of columns of the trial's tables."""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from itertools import cycle
from typing import Any, NamedTuple

import numpy as np
import polars as pl

Content = dict[str, Any]  # as `templates/report.js` reads it
LINE_LOOKS = ("measured", "model", "second", "third")  # looks of several lines of one panel
TORQUE_AXIS = "Torque (N·m)"


class Pictures(NamedTuple):
    """The panels of a trial, the tables that they draw, and a sentence on how these were thinned."""

    panels: list[Content]
    tables: dict[str, pl.DataFrame]
    remark: str = ""


def line(table: str, x: str, y: str, name: str, look: str = "measured", **more: str) -> Content:
    """Columns of one table as a line, or with `kind`="points" as points with an interval from `low` to `high`, or with
    "range" from `y` to `high`, where `where` has a value. The `look` is one of `LINE_LOOKS` or "residual"."""
    own = {"table": table, "x": x, "y": y, "name": name, "look": look}
    return own | {"kind": "line", "low": "", "high": "", "where": ""} | more


def panel(title: str, x_label: str, y_label: str, *lines: Content, linked: str = "", **axes: bool) -> Content:
    """One panel; `axes` are `log_x`, `log_y` and `square`. Panels with the same `linked` zoom together."""
    own = {"title": title, "x_label": x_label, "y_label": y_label, "drawn": lines, "linked": linked}
    return own | {"log_x": False, "log_y": False, "square": False} | axes


def over_time(title: str, label: str, *lines: Content) -> Content:
    return panel(title, "Time (s)", label, *lines, linked="time")


def over_frequency(what: str, magnitude: str, lines: Sequence[Iterable[Content]]) -> list[Content]:
    """Two panels: the magnitude of a response, with the name of its axis, and its phase."""
    both = (("magnitude", magnitude, True), ("phase", "Phase (deg)", False))
    return [
        panel(f"{what}: {name}", "Frequency (Hz)", label, *drawn, linked="frequency", log_x=True, log_y=log)
        for (name, label, log), drawn in zip(both, lines, strict=True)
    ]


def bench_pictures(series: pl.DataFrame, motion: str, whole_loop: bool = False) -> Pictures:
    """Torque, residual and motion over time, and torque against angle, of a fitted trial on the bench. `series` as
    `bench.analysis.Series.table` writes it, `motion` what moves. The loop is of the fitted samples, or whole."""
    x, unit = ("omega", "rad/s") if "omega" in series.columns else ("theta_deg", "deg")
    label, of = f"{motion} ({unit})", partial(line, "series")
    both = of("time", "torque", "measured"), of("time", "torque_model", "model", "model")
    left = of("time", "residual_low", "measured minus model", "residual", kind="range", high="residual_high")
    measured = of(x, "torque", "measured", where="" if whole_loop else "torque_model")
    loop = measured, of(x, "torque_model", "model", "model")
    panels = [
        over_time("Torque", TORQUE_AXIS, *both),
        over_time("Residual, range of all samples that are fitted", TORQUE_AXIS, left),
        over_time(motion, label, of("time", x, "measured")),
        panel(f"Torque against {motion.lower()}", label, TORQUE_AXIS, *loop, square=True),
    ]
    seconds = float(series["time"][-1] - series["time"][0]) if len(series) > 1 else 0.0
    rate = (len(series) - 1) / seconds if seconds else 0.0
    drawn = f"{rate:{'.0f' if rate > 10 else '.2g'}} samples a second are drawn"
    where = f"the model{'' if whole_loop else ', the loop'} and the residual are drawn where the fit uses the samples"
    return Pictures(panels, {"series": series}, f"{drawn}; {where}")


def phasor_pictures(phasors: pl.DataFrame, fit: Mapping[str, Any]) -> Pictures:
    """Magnitude and phase of the measured admittance over frequency, points per amplitude with their intervals. The
    line is that of Eq. 15 with `K`, `B` and `I` of the `fit` to all amplitudes."""
    parts = phasors.partition_by("amplitude_deg", maintain_order=True, as_dict=True)
    tables = {f"{deg:g} deg": part for (deg,), part in parts.items()}
    drawn = []
    for y, ends in (("Y_magnitude", "Y_magnitude_{}"), ("Y_phase_deg", "Y_phase_{}_deg")):
        shape = {"kind": "points", "low": ends.format("low"), "high": ends.format("high")}
        looks = zip(tables, cycle(LINE_LOOKS), strict=False)
        points = [line(name, "frequency_hz", y, name, look, **shape) for name, look in looks]
        drawn.append([*points, line("Eq. 15", "frequency_hz", y, "Eq. 15, fit to all", "residual")])
    measured = phasors["frequency_hz"].to_numpy()
    f = np.geomspace(float(measured.min()), float(measured.max()), 60)
    s = 2j * np.pi * f
    Y = 1 / (fit["K"] + fit["B"] * s + fit["I"] * s**2)
    curve = {"frequency_hz": f, "Y_magnitude": np.abs(Y), "Y_phase_deg": np.rad2deg(np.angle(Y))}
    tables["Eq. 15"] = pl.DataFrame(curve)
    return Pictures(over_frequency("Admittance", "|Y| (rad/(N·m))", drawn), tables)


def response_pictures(response: pl.DataFrame) -> Pictures:
    """Magnitude and phase of the impedance over frequency, without a model, and the fit of Eq. 15."""
    of = partial(line, "response", "frequency_hz")
    measured, model = partial(of, name="without a model", kind="points"), partial(of, name="Eq. 15", look="model")
    drawn = [(measured(y), model(f"{y}_eq15")) for y in ("magnitude", "phase_deg")]
    return Pictures(over_frequency("Impedance", "|Z| (N·m/rad)", drawn), {"response": response.sort("frequency_hz")})


def crossing_pictures(crossing: pl.DataFrame) -> Pictures:
    """Torque, angle and platform of one analysed crossing, and torque against angle."""
    of, angle_axis = partial(line, "crossing"), "Angle (deg)"
    panels = [
        over_time("Ankle torque", TORQUE_AXIS, of("time", "torque", "measured")),
        over_time("Ankle angle", angle_axis, of("time", "theta_deg", "measured")),
        panel("Torque against angle", angle_axis, TORQUE_AXIS, of("theta_deg", "torque", "measured"), square=True),
    ]
    if "platform" in crossing.columns:
        panels.insert(2, over_time("Platform", angle_axis, of("time", "platform_deg", "measured")))
    degrees = [pl.col(name).degrees().name.suffix("_deg") for name in ("theta", "platform") if name in crossing.columns]
    return Pictures(panels, {"crossing": crossing.with_columns(pl.col("time") - pl.col("time").first(), *degrees)})


def isolated_pictures(response: pl.DataFrame) -> Pictures:
    """Isolated angle and torque around the onset of a perturbation, with the torque of its fit."""
    label, of = "Time from the onset (ms)", partial(line, "isolated", "time_ms")
    both = of("torque", "isolated: perturbed minus mean unperturbed"), of("torque_model", "model", "model")
    left, angle = of("residual", "isolated minus model", "residual"), of("theta_deg", "isolated")
    panels = [
        panel("Isolated torque", label, TORQUE_AXIS, *both, linked="onset"),
        panel("Residual", label, TORQUE_AXIS, left, linked="onset"),
        panel("Isolated angle", label, "Angle (deg)", angle, linked="onset"),
    ]
    residual = pl.col("torque") - pl.col("torque_model")
    return Pictures(panels, {"isolated": response.with_columns(time_ms=1e3 * pl.col("time"), residual=residual)})


def recorded_pictures(samples: pl.DataFrame, units: dict[str, str]) -> Pictures:
    """What a trial recorded, a panel per quantity with four lines at most: of one that no fit belongs to."""
    most = 3000  # rows
    tables, panels = {}, []
    for unit in dict.fromkeys(units.values()):
        columns = [name for name, its_unit in units.items() if its_unit == unit][: len(LINE_LOOKS)]
        rows = samples.select("time", *columns).drop_nulls()
        rows = rows.gather_every(max(-(-len(rows) // most), 1))
        if len(rows) > 1:
            tables[unit] = rows.with_columns(pl.col("time") - samples["time"][0])
            drawn = (line(unit, "time", name, name, look) for name, look in zip(columns, LINE_LOOKS, strict=False))
            panels.append(over_time("As recorded", f"({unit})", *drawn))
    return Pictures(panels, tables, f"raw signals in canonical units, as ingested, {most} samples or fewer")


def together(*pictures: Pictures) -> Pictures:
    """The panels of several in one, with the drawn columns of their tables."""
    panels = [one for each in pictures for one in each.panels]
    tables = {name: table for each in pictures for name, table in each.tables.items()}
    used: dict[str, dict[str, None]] = {}
    for drawn in (drawn for one in panels for drawn in one["drawn"]):
        columns = filter(None, (drawn[key] for key in ("x", "y", "low", "high", "where")))
        used.setdefault(drawn["table"], {}).update(dict.fromkeys(columns))
    kept = {name: tables[name].select(list(columns)) for name, columns in used.items()}
    return Pictures(panels, kept, "; ".join(filter(None, [each.remark for each in pictures])))
