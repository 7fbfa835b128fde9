"""The page's content on each trial (conditions, verdict, estimates, doubts, provenance, panels) and
on the campaign."""

import math
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import cycle
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.dictionary import apparent_inertia, described_tables_by_name
from osl_analysis.judge.campaign import QUALITY, Entry
from osl_analysis.judge.exclusions import exclusion_said
from osl_analysis.judge.finding import Grade
from osl_analysis.judge.limits import NOT_APPLICABLE
from osl_analysis.judge.words import WORDS, Words, printed, sentence_of
from osl_analysis.report.headlines import digits_of, fixed
from osl_analysis.stats.repeats import sizes_said

Content = dict[str, Any]  # as `templates/report.js` reads it
LINE_LOOKS = ("measured", "model", "second", "third")  # looks of several lines of one panel
TORQUE_AXIS = "Torque (N·m)"


class Pictures(NamedTuple):
    """The panels of a trial, the tables that they draw, and a sentence on how these were
    thinned."""

    panels: list[Content]
    tables: dict[str, pl.DataFrame]
    remark: str = ""


def line(table: str, x: str, y: str, name: str, look: str = "measured", **more: str) -> Content:
    """Columns of one table as a line. `kind`="points": points with an interval from `low` to
    `high`; "range": from `y` to `high`. Drawn where the column `where` has a value. The `look` is
    one of `LINE_LOOKS` or "residual"."""
    own = {"table": table, "x": x, "y": y, "name": name, "look": look}
    return own | {"kind": "line", "low": "", "high": "", "where": ""} | more


def panel(
    title: str, x_label: str, y_label: str, *lines: Content, linked: str = "", **axes: bool
) -> Content:
    """One panel; `axes` are `log_x`, `log_y` and `square`. Panels with the same `linked` zoom
    together."""
    own = {"title": title, "x_label": x_label, "y_label": y_label, "drawn": lines, "linked": linked}
    return own | {"log_x": False, "log_y": False, "square": False} | axes


def over_time(title: str, label: str, *lines: Content) -> Content:
    return panel(title, "Time (s)", label, *lines, linked="time")


def over_frequency(what: str, magnitude: str, lines: Sequence[Iterable[Content]]) -> list[Content]:
    """Two panels: the magnitude of a response, with the name of its axis, and its phase."""
    both = (("magnitude", magnitude, True), ("phase", "Phase (deg)", False))
    return [
        panel(
            f"{what}: {name}",
            "Frequency (Hz)",
            label,
            *drawn,
            linked="frequency",
            log_x=True,
            log_y=log,
        )
        for (name, label, log), drawn in zip(both, lines, strict=True)
    ]


def bench_pictures(series: pl.DataFrame, motion: str, whole_loop: bool = False) -> Pictures:
    """Torque, residual and motion over time, and torque against angle, of a fitted trial on the
    bench. `series` is a `fit_tables.Series.table`, `motion` the moving angle. The loop has the
    fitted samples, or all (`whole_loop`)."""
    x, unit = ("omega", "rad/s") if "omega" in series.columns else ("theta_deg", "deg")
    label, of = f"{motion} ({unit})", partial(line, "series")
    both = of("time", "torque", "measured"), of("time", "torque_model", "model", "model")
    left = of(
        "time",
        "residual_low",
        "measured minus model",
        "residual",
        kind="range",
        high="residual_high",
    )
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
    where = (
        f"the model{'' if whole_loop else ', the loop'} and the residual are drawn where the fit"
        " uses the samples"
    )
    return Pictures(panels, {"series": series}, f"{drawn}; {where}")


def phasor_pictures(phasors: pl.DataFrame, fit: Mapping[str, Any]) -> Pictures:
    """Magnitude and phase of the measured admittance over frequency, with intervals, points per
    amplitude. The line is Eq. 15 with `K`, `B` and `I` of the `fit` to all amplitudes."""
    parts = phasors.partition_by("amplitude_deg", maintain_order=True, as_dict=True)
    tables = {f"{deg:g} deg": part for (deg,), part in parts.items()}
    drawn = []
    for y in ("Y_magnitude", "Y_phase_deg"):
        shape = {"kind": "points", "low": f"{y}_low", "high": f"{y}_high"}
        looks = zip(tables, cycle(LINE_LOOKS), strict=False)
        points = [line(name, "frequency_hz", y, name, look, **shape) for name, look in looks]
        drawn.append(
            [*points, line("model", "frequency_hz", y, "K, B and I, fit to all", "residual")]
        )
    measured = phasors["frequency_hz"].to_numpy()
    f = np.geomspace(float(measured.min()), float(measured.max()), 60)
    s = 2j * np.pi * f
    Y = 1 / (fit["K"] + fit["B"] * s + fit["I"] * s**2)
    curve = {"frequency_hz": f, "Y_magnitude": np.abs(Y), "Y_phase_deg": np.rad2deg(np.angle(Y))}
    tables["model"] = pl.DataFrame(curve)
    return Pictures(over_frequency("Admittance", "|Y| (rad/(N·m))", drawn), tables)


def response_pictures(response: pl.DataFrame) -> Pictures:
    """Magnitude and phase of the impedance over frequency, without a model, and the fit of Eq.
    15."""
    of = partial(line, "response", "frequency_hz")
    measured, model = (
        partial(of, name="without a model", kind="points"),
        partial(of, name="K, B and I", look="model"),
    )
    drawn = [(measured(y), model(f"{y}_eq15")) for y in ("magnitude", "phase_deg")]
    return Pictures(
        over_frequency("Impedance", "|Z| (N·m/rad)", drawn),
        {"response": response.sort("frequency_hz")},
    )


def crossing_pictures(crossing: pl.DataFrame) -> Pictures:
    """Torque, angle and platform of one analysed crossing, and torque against angle."""
    of, angle_axis = partial(line, "crossing"), "Angle (deg)"
    panels = [
        over_time("Ankle torque", TORQUE_AXIS, of("time", "torque", "measured")),
        over_time("Ankle angle", angle_axis, of("time", "theta_deg", "measured")),
        panel(
            "Torque against angle",
            angle_axis,
            TORQUE_AXIS,
            of("theta_deg", "torque", "measured"),
            square=True,
        ),
    ]
    if "platform" in crossing.columns:
        panels.insert(2, over_time("Platform", angle_axis, of("time", "platform_deg", "measured")))
    degrees = [
        pl.col(name).degrees().name.suffix("_deg")
        for name in ("theta", "platform")
        if name in crossing.columns
    ]
    return Pictures(
        panels,
        {"crossing": crossing.with_columns(pl.col("time") - pl.col("time").first(), *degrees)},
    )


def isolated_pictures(response: pl.DataFrame) -> Pictures:
    """Isolated angle and torque around the onset of a perturbation, with the torque of its fit."""
    label, of = "Time from the onset (ms)", partial(line, "isolated", "time_ms")
    both = (
        of("torque", "isolated: perturbed minus mean unperturbed"),
        of("torque_model", "model", "model"),
    )
    left, angle = of("residual", "isolated minus model", "residual"), of("theta_deg", "isolated")
    panels = [
        panel("Isolated torque", label, TORQUE_AXIS, *both, linked="onset"),
        panel("Residual", label, TORQUE_AXIS, left, linked="onset"),
        panel("Isolated angle", label, "Angle (deg)", angle, linked="onset"),
    ]
    residual = pl.col("torque") - pl.col("torque_model")
    return Pictures(
        panels, {"isolated": response.with_columns(time_ms=1e3 * pl.col("time"), residual=residual)}
    )


def recorded_pictures(samples: pl.DataFrame, units: dict[str, str]) -> Pictures:
    """The recorded signals of a trial without a fit: a panel per quantity, with four lines at
    most."""
    most = 3000  # rows
    tables, panels = {}, []
    for unit in dict.fromkeys(units.values()):
        columns = [name for name, its_unit in units.items() if its_unit == unit][: len(LINE_LOOKS)]
        rows = samples.select("time", *columns).drop_nulls()
        rows = rows.gather_every(max(-(-len(rows) // most), 1))
        if len(rows) > 1:
            tables[unit] = rows.with_columns(pl.col("time") - samples["time"][0])
            drawn = (
                line(unit, "time", name, name, look)
                for name, look in zip(columns, LINE_LOOKS, strict=False)
            )
            panels.append(over_time("As recorded", f"({unit})", *drawn))
    return Pictures(
        panels, tables, f"raw signals in canonical units, as ingested, {most} samples or fewer"
    )


def together(*pictures: Pictures) -> Pictures:
    """Several pictures joined: all panels, and the drawn columns of their tables."""
    panels = [one for each in pictures for one in each.panels]
    tables = {name: table for each in pictures for name, table in each.tables.items()}
    used: dict[str, dict[str, None]] = {}
    for drawn in (drawn for one in panels for drawn in one["drawn"]):
        columns = filter(None, (drawn[key] for key in ("x", "y", "low", "high", "where")))
        used.setdefault(drawn["table"], {}).update(dict.fromkeys(columns))
    kept = {name: tables[name].select(list(columns)) for name, columns in used.items()}
    return Pictures(panels, kept, "; ".join(filter(None, [each.remark for each in pictures])))


NO_VALUE = "–"
VERDICTS = ("clear", "doubtful in part", "flagged", "doubtful", "excluded", "refused")
"""Verdicts on a trial: `doubtful`: the fit to all of it is; `doubtful in part`: others are. The
last two are unused."""
STATES = {
    "all": "doubtful",
    "recording": "flagged",
    "part": "doubtful in part",
    "other": "doubtful in part",
}
"""The verdict that follows from a doubt, by its subject; the worst first."""


def left_out_trials(
    excluded: pl.DataFrame, tables: Mapping[str, pl.DataFrame], refused: Mapping[str, str]
) -> dict[str, tuple[bool, list[str]]]:
    """The trials that are left out, by name: whether a job refused or failed (False: excluded), and
    the reasons. `refused` has the reason of each refused trial."""
    said = []
    for row in excluded.iter_rows(named=True):
        # outcomes of a job, which are no checks
        by_job = row["check"] in ("refused", "failed")
        said.append((row["trial"], by_job, row["remark"] if by_job else exclusion_said(row)))
    known = {trial for trial, *_ in said}
    said += [(trial, True, reason) for trial, reason in refused.items() if trial not in known]
    for name, why in (("walking", "excluded"), ("walking_excluded", "reason")):
        crossings = tables.get(name, pl.DataFrame(schema=["trial", why]))
        said += [
            (trial, False, reason)
            for trial, reason in crossings.select("trial", why).rows()
            if reason
        ]
    found: dict[str, tuple[bool, list[str]]] = {}
    for trial, by_job, reason in dict.fromkeys(said):
        found.setdefault(trial, (by_job, []))[1].append(reason)
    return found


@dataclass(frozen=True)
class ReportedTrial:
    """One trial with its results."""

    name: str
    row: Mapping[str, Any]  # of the sample sheet
    # its rows of each table, that of its fit first
    tables: Mapping[str, pl.DataFrame] = field(default_factory=dict)
    findings: Sequence[Entry] = ()  # findings on it, from `findings.csv`
    quality: pl.DataFrame | None = None  # verdicts on it; None if it was never examined
    provenance: Mapping[str, Any] = field(default_factory=dict)
    left_out: Sequence[str] = ()  # why it has no result, or is excluded
    refused: bool = False  # whether it is missing because a job refused or failed
    pictures: Pictures = field(default_factory=lambda: Pictures([], {}))

    @property
    def main(self) -> pl.DataFrame:
        """The rows of its fit; an empty table if it has none."""
        return next(iter(self.tables.values()), pl.DataFrame())

    @property
    def main_table(self) -> str:
        """The name of the table of its fit; empty if it has none."""
        return next(iter(self.tables), "")

    @property
    def unchecked(self) -> list[Entry]:
        """Findings on the fit to all of it that could not be checked, and remarks."""
        whole = (
            one for one in self.findings if one["table"] == self.main_table and not one["in_part"]
        )
        return [one for one in whole if one["grade"] in (Grade.UNCHECKED, Grade.NOTES)]

    @cached_property
    def doubts(self) -> list[dict[str, Any]]:
        """Each doubt about it: `where`; `of`: all of its fit, a part, its recording or another
        table; `cause`, with what it `says`, its `size` and `remedy`; and `numbers`: column, value,
        limit, meaning. Doubts that other tables only repeat are left out."""
        found = list[dict[str, Any]]()
        for entry in self.findings:
            if entry["grade"] != Grade.DOUBTS or entry["inherited"]:
                continue
            table, recording = entry["table"], entry["table"] == QUALITY
            other = table != self.main_table and not recording
            parts = {"amplitude_deg": "deg", "frequency_hz": "Hz"}
            known = (
                f"{entry[column]:g} {unit}"
                for column, unit in parts.items()
                if entry[column] is not None
            )
            place = ", ".join(known)
            place = place or ("all amplitudes" if table == "impedance" else "whole trial")
            where = (
                "its recording"
                if recording
                else f"{table.replace('_', ' ')}, {place}"
                if other
                else place
            )
            words = Words(*(printed(entry[name] or "") for name in Words._fields))
            numbers = []
            for one in entry["evidence"]:
                said = (
                    WORDS["checks"][one.column]
                    if recording
                    else unit_and_meaning(one.column, table)["meaning"]
                )
                sides = {"nan": "not a number", "near": "near a factor between units"}
                limit = sides.get(one.side, f"{one.side} {one.limit:g}")
                numbers.append([*map(printed, (one.column, f"{one.value:.3g}", limit)), said])
            of = (
                "recording"
                if recording
                else "other"
                if other
                else "part"
                if entry["in_part"]
                else "all"
            )
            told = {"where": where, "of": of, "cause": entry["cause"], "numbers": numbers}
            found.append(told | words._asdict() | {"text": sentence_of(words, entry["cause"])})
        return found

    @property
    def verdict(self) -> str:
        if self.left_out:
            return "refused" if self.refused else "excluded"
        made = {STATES[one["of"]] for one in self.doubts}
        return next((verdict for verdict in STATES.values() if verdict in made), "clear")

    def causes_of(self, verdict: str) -> set[str]:
        """The causes of a verdict. Only the worst doubt of each cause counts, as in the map of
        trials and causes."""
        worst = {
            one["cause"]: one["of"]
            for one in sorted(self.doubts, key=lambda one: -[*STATES].index(one["of"]))
        }
        return {cause for cause, of in worst.items() if STATES[of] == verdict}

    def condition(self, columns: Collection[str] | None = None) -> str:
        """Its conditions in one line; with `columns`, only those in these columns of the sheet."""
        others = [
            "trial",
            "experiment",
            "log",
            "log_source",
            "mocap",
            "mocap_source",
            "log_part",
            "exclude",
            "accept",
        ]
        words = {True: "perturbed", False: "unperturbed"}
        return ", ".join(
            words[bool(value)] if name == "perturbed" else f"{name} {cell_text(value)}"
            for name, value in self.row.items()
            if name not in others and value is not None and (columns is None or name in columns)
        )


def trial_content(trial: ReportedTrial) -> dict[str, Any]:
    tables = {name: table for name, table in trial.tables.items() if len(table)}
    name = next(iter(tables), "")
    last = tables[name].row(-1, named=True) if tables else {}  # the fit to all of it
    experiment = trial.row["experiment"]
    # report of the time base on each group of signals: column, values, meaning
    time_base: list[list[str]] = []
    for column in trial.tables.get("timebase", pl.DataFrame()):
        if column.name == "signals" or (
            column.name not in ("trial", "joint", "side", "data") and column.count()
        ):
            said = unit_and_meaning(column.name, "timebase")["meaning"]
            time_base.append(
                [column.name, *map(cell_text, column), "" if column.name == "signals" else said]
            )
    time_base.sort(key=lambda cells: cells[0] != "signals")
    return {
        "name": trial.name,
        "experiment": experiment,
        "description": EXPERIMENTS[experiment].description,
        "condition": trial.condition(),
        "verdict": trial.verdict,
        "left_out": [*map(printed, trial.left_out)],
        "doubts": trial.doubts,
        "not_checked": [
            printed(sentence_of(Words(one["says"] or "", "", one["remedy"] or ""), one["cause"]))
            for one in trial.unchecked
        ],
        "table": name,
        "estimates": estimate_rows(tables[name], name) if tables else None,
        "columns": [
            [column, cell_text(value), *unit_and_meaning(column, name).values()]
            for column, value in last.items()
            if value not in (None, "")
        ],
        "quality": quality_rows(trial.quality) if trial.quality is not None else [],
        "time_base": time_base,
        "provenance": provenance_content(trial.provenance),
        "panels": trial.pictures.panels,
        "remark": trial.pictures.remark,
    }


def quality_rows(verdicts: pl.DataFrame) -> list[list[str]]:
    """Check, its meaning, value, threshold, verdict and remark of each row of `quality.csv` that
    applies."""
    found = []
    for row in (one for one in verdicts.iter_rows(named=True) if one["verdict"] != NOT_APPLICABLE):
        unit = printed(row["unit"] or "")
        value, threshold = (
            f"{cell_text(row[key])} {'' if row[key] is None else unit}".strip()
            for key in ("value", "threshold")
        )
        meaning = WORDS["checks"][row["check"]]
        found.append([row["check"], meaning, value, threshold, row["verdict"], row["remark"] or ""])
    return found


def cell_text(value: Any) -> str:
    """A cell of a table as the page has it: numbers with six digits, text as it is."""
    if isinstance(value, float):
        return printed(f"{value:.6g} ").rstrip() if math.isfinite(value) else NO_VALUE
    return NO_VALUE if value is None else str(value)


def unit_and_meaning(column: str, table: str) -> dict[str, str]:
    described = described_tables_by_name().get(table)
    known = described.columns.get(column) if described else None
    return {"unit": printed(known.unit) if known else "", "meaning": known.meaning if known else ""}


def value_and_interval(row: Mapping[str, Any], column: str) -> tuple[str, str]:
    """A value with as many digits as its interval allows, and the interval; empty where it has
    none."""
    value, low, high = (row.get(f"{column}{end}") for end in ("", "_low", "_high"))
    if value is None or not math.isfinite(value):
        return NO_VALUE, ""
    if low is None or high is None:
        return f"{value:.4g}", ""
    digits, finer = digits_of(value, low, high)
    return printed(fixed(value, digits)), printed(f"[{fixed(low, finer)}, {fixed(high, finer)}]")


def estimate_rows(table: pl.DataFrame, of: str) -> dict[str, Any]:
    """The estimates of one trial from the table named `of`: `columns` with unit and meaning, and
    texts per fit."""
    there = set(table.columns)
    names = [
        name
        for name in table.columns
        if {f"{name}_low", f"{name}_high"} <= there and table[name].count()
    ]
    # numbers of a fit without an interval
    names += [name for name in ("VAF", "R2") if name in there]
    first, rows = ["amplitude_deg"] * ("amplitude_deg" in there), []
    for row in table.iter_rows(named=True):
        head = ["all" if row[name] is None else f"{row[name]:g}" for name in first]
        rows.append([*head, *(" ".join(value_and_interval(row, name)).strip() for name in names)])
    columns = [{"name": name, **unit_and_meaning(name, of)} for name in (*first, *names)]
    return {"columns": columns, "rows": rows}


def provenance_content(provenance: Mapping[str, Any]) -> dict[str, Any]:
    """The provenance of a trial as `files`, `signals` (file, channel, conversion; the axes of a
    marker or plate are one signal) and further `facts`."""
    files, signals = [], dict[str, list[str]]()
    for role, one in provenance.get("files", {}).items():
        files.append(
            [role, *(cell_text(one.get(key)) for key in ("path", "bytes", "sha256", "source"))]
        )
    usual = {"sign": 1, "scale": 1, "offset": 0}
    for name, origin in provenance.get("columns", {}).items():
        vector = name.rpartition("_")[0] if "component" in origin or "plate" in origin else name
        told = {key: value for key, value in origin.items() if key not in ("file", "component")}
        known = {key: value for key, value in told.items() if value and value != usual.get(key)}
        signals.setdefault(vector, [vector, cell_text(origin.get("file")), fact_said(known)])
    others = {name: value for name, value in provenance.items() if name not in ("files", "columns")}
    return {"files": files, "signals": list(signals.values()), "facts": facts(others)}


def fact_said(value: Any) -> str:
    if isinstance(value, dict):  # as JSON has it; to ask for a Mapping takes ten times as long
        return ", ".join(f"{name} {fact_said(part)}" for name, part in value.items())
    return "; ".join(map(fact_said, value)) if isinstance(value, list) else cell_text(value)


def facts(content: Mapping[str, Any], place: str = "") -> list[list[str]]:
    """Every other fact with its path: clocks, stamps, rates, damage, versions, warnings."""
    found: list[list[str]] = []
    for name, value in content.items():
        if isinstance(value, dict):
            found += facts(value, f"{place}{name} ")
        elif value not in (None, "", []):
            found.append([f"{place}{name}", fact_said(value)])
    return found


def trials_content(trials: Sequence[ReportedTrial]) -> dict[str, Any]:
    """The template's content on all trials; only conditions that differ."""
    differing = {
        name for trial in trials for name in trial.row if trial.row[name] != trials[0].row.get(name)
    }
    found = Counter(trial.verdict for trial in trials)
    worst_first = sorted(trials, key=lambda trial: -VERDICTS.index(trial.verdict))
    experiments = dict.fromkeys(cell_text(trial.row["experiment"]) for trial in trials)
    return {
        "counts": {verdict: found[verdict] for verdict in VERDICTS},
        "choices": {
            "experiment": [*experiments],
            "verdict": [verdict for verdict in VERDICTS if found[verdict]],
        },
        "quantities": ["VAF", "K", "B", "I"],
        "apparent_inertia": apparent_inertia(),
        "trials": [trial_row(trial, differing) for trial in worst_first],
        "left_out": [
            {"name": t.name, "verdict": t.verdict, "reason": why}
            for t in trials
            for why in t.left_out
        ],
        "experiments": {name: facts.description for name, facts in EXPERIMENTS.items()},
    }


def methods_content(
    config: Mapping[str, Any], tables: Mapping[str, pl.DataFrame], trials: Sequence[ReportedTrial]
) -> dict[str, Any]:
    """The content of `methods.html.j2`: settings, values of tables, facts on the recordings, and,
    by kind of motion, the number of impedance trials with columns of their fits to all
    amplitudes."""
    columns = """excitation commanded_deg frequency_hz band_low_hz band_high_hz controller group
        plate_inertia K_d B_d B_viscous direction onset_phase interval_method theta_rms_deg fitted_s
        n_up n_down"""
    said: defaultdict[str, defaultdict[str, list[Any]]] = defaultdict(lambda: defaultdict(list))
    for name, table in tables.items():
        for one in columns.split():
            if one in table.columns and len(table):
                said[name][one] = table[one].drop_nulls().unique().sort().to_list()
    # where nobody stated what was commanded, all that moved, without a fit of its own too
    if "impedance" in tables:
        sines, stated = (
            tables.get("phasors", tables["impedance"]),
            said["impedance"]["commanded_deg"],
        )
        measured = [] if stated else sizes_said(sines["amplitude_deg"].cast(pl.Float64))
        said["impedance"]["commanded_deg"] = [f"{size:g}" for size in stated] or measured
    if hz := said["phasors"]["frequency_hz"]:
        said["phasors"]["frequency_hz"] = pl.Series(hz).round_sig_figs(3).unique().sort().to_list()
    groups = tables.get("walking_groups", pl.DataFrame())
    ways = {
        way: groups.get_column(f"n_{way}", default=pl.Series([0])).sum() for way in ("up", "down")
    }
    table = tables.get("impedance", pl.DataFrame(schema=["amplitude_deg", "excitation"]))
    shown, motions = (
        ("band_low_hz", "band_high_hz", "theta_rms_deg", "fitted_s"),
        list[Mapping[str, Any]](),
    )
    for (kind,), rows in table.filter(pl.col("amplitude_deg").is_null()).group_by(
        "excitation", maintain_order=True
    ):
        values = {
            one: rows[one].drop_nulls().to_list() if one in rows.columns else [] for one in shown
        }
        motions.append({"kind": kind, "n": len(rows), **values})
    facts = {"config": config, "tables": said, "recorded": recorded_of(trials)}
    return facts | {"motions": motions, "ways": ways, "response": response_said(groups)}


def recorded_of(trials: Sequence[ReportedTrial]) -> dict[str, dict[str, Any]]:
    """By experiment: numbers of trials recorded and used, lowest rates [Hz] of all, of each of
    their `streams` and of the `grids` of these, files, rates of plates, turns."""
    recorded = dict[str, dict[str, Any]]()
    for trial in trials:
        none: dict[str, Any] = {
            "rates": [],
            "files": [],
            "plates": [],
            "turns": [],
            "streams": {},
            "grids": [],
        }
        own = recorded.setdefault(trial.row["experiment"], none)
        if (base := trial.tables.get("timebase")) is not None:
            for signals, rate in base.select("signals", "rate_hz").iter_rows():
                if signals is not None and rate is not None:
                    own["streams"].setdefault(signals, []).append(rate)
            own["grids"] += base["grid_rate_hz"].to_list()
        used, perturbed = not trial.left_out, bool(trial.row.get("perturbed"))
        counts = {
            "n": 1,
            "used": used,
            "perturbed": perturbed,
            "perturbed_used": perturbed and used,
        }
        own |= {count: own.get(count, 0) + more for count, more in counts.items()}
        if trial.quality is not None:
            for check, value in trial.quality.select("check", "value").iter_rows():
                if check == "rate":
                    own["rates"].append(value)
        for file in trial.provenance.get("files", {}).values():
            own["files"].append(str(file["path"]).rpartition(".")[2].upper())
        frames = trial.provenance.get("mocap") or {}
        if trial.provenance.get("plates") and frames.get("samples_per_frame"):
            own["plates"].append(frames["frame_rate_hz"] * frames["samples_per_frame"])
        if (
            perturbed
            and used
            and "platform_deg" in trial.pictures.tables.get("crossing", pl.DataFrame()).columns
        ):
            own["turns"].append(turn_of(trial.pictures.tables["crossing"]))
    for own in recorded.values():
        own["rates"] = three_digits(own["rates"])
        own["grids"] = three_digits(own["grids"])
        own["streams"] = {name: three_digits(rates) for name, rates in own["streams"].items()}
    return recorded


def three_digits(values: Sequence[float | None]) -> list[float]:
    """The values that are known, rounded to three digits."""
    return pl.Series(values, dtype=pl.Float64).drop_nulls().round_sig_figs(3).to_list()


def response_said(groups: pl.DataFrame) -> str:
    """A text on which response is fitted in the `walking_groups`."""
    columns = {"n_up", "n_down"} <= {*groups.columns}
    both = (
        groups.select((pl.col("n_up") > 0) & (pl.col("n_down") > 0)).to_series()
        if columns
        else pl.Series([False])
    )
    ways = ["the mean response"] * (not both.all()) + [
        "half the difference of both directions"
    ] * bool(both.any())
    return " or ".join(ways)


def turn_of(crossing: pl.DataFrame) -> tuple[float, float]:
    """Size [deg] of the platform's turn in a perturbed crossing, and its rise time [ms] from 10 to
    90 %."""
    time, turned = (
        crossing["time"].to_numpy(),
        crossing["platform_deg"].fill_nan(None).fill_null(0.0).abs().to_numpy(),
    )
    size = float(np.median(turned[turned >= 0.9 * turned.max()]))  # beside the noise of markers
    end = int(np.argmax(turned > 0.9 * size))
    start = int(np.flatnonzero(turned[:end] < 0.1 * size)[-1:].sum())
    ends = []  # between two samples, of which a turn of 50 ms may have ten
    for k, share in ((start, 0.1), (end - 1, 0.9)):
        ends.append(np.interp(share * size, turned[k : k + 2], time[k : k + 2]))
    return size, 1e3 * float(ends[1] - ends[0])


def trial_row(trial: ReportedTrial, differing: Collection[str]) -> dict[str, Any]:
    estimates = trial.main.row(-1, named=True) if len(trial.main) else {}  # of the fit to all of it
    numbers = []
    for column in ("VAF", *EXPERIMENTS[trial.row["experiment"]].impedance):
        value = estimates.get(column)
        known = isinstance(value, int | float) and math.isfinite(value)
        text, interval = value_and_interval(estimates, column) if known else (NO_VALUE, "")
        numbers.append(
            {
                "column": column,
                "sort": repr(value) if known else "",
                "text": text,
                "interval": interval,
            }
        )
    # the text of the last row, which is of all of the trial, and where
    by_cause: dict[str, tuple[str, list[str]]] = {}
    for one in (one for one in trial.doubts if STATES[one["of"]] == trial.verdict):
        by_cause[one["cause"]] = (
            one["text"],
            [*by_cause.get(one["cause"], ("", []))[1], one["where"]],
        )
    doubts = [f"{', '.join(places)}: {text}" for text, places in by_cause.values()]
    return {
        "name": trial.name,
        "experiment": trial.row["experiment"],
        "condition": trial.condition(differing),
        "verdict": trial.verdict,
        "doubt": next(iter(trial.left_out), "; ".join(doubts)),
        "causes": [*by_cause],
        "numbers": numbers,
    }
