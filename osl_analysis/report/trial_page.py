"""What the page shows of one trial: conditions, verdict, estimates, doubts, and where its samples come from."""

import math
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import polars as pl

from osl_analysis.dictionary import DescribedTable
from osl_analysis.experiments import EXPERIMENTS
from osl_analysis.report.panels import Pictures
from osl_analysis.summary.text import AMPLITUDES, decimals, fixed, rounded_by, told_apart, trials_text

OUTCOMES = ("refused", "failed", "died")
"""Entries of the column `check` of `excluded.csv` that are no checks: outcomes of a job."""
MOST_NAMED = 3  # trials that a reason names


@dataclass
class LeftOut:
    """Why one trial is left out."""

    refused: bool  # whether it is missing because a job refused or failed; False: it was excluded
    reasons: list[str] = field(default_factory=list)

    def say(self, reason: str) -> None:
        if reason not in self.reasons:
            self.reasons.append(reason)


def left_out_trials(
    excluded: pl.DataFrame, crossings: pl.DataFrame | None, refused: Mapping[str, str]
) -> dict[str, LeftOut]:
    """The trials that are left out, by name.

    `excluded` is `excluded.csv`, `crossings` is `walking_excluded.csv`, `refused` has the reason of each refused trial.
    """
    found: dict[str, LeftOut] = {}
    for row in excluded.iter_rows(named=True):
        by_job = row["check"] in OUTCOMES
        numbers = "" if row["value"] is None else f" {row['value']:.4g} {row['unit']}, threshold {row['threshold']}"
        reason = row["remark"] if by_job else f"{row['check']}{numbers}: {row['remark']}"
        found.setdefault(row["trial"], LeftOut(by_job)).say(reason)
    for trial, reason in refused.items():
        if trial not in found:
            found[trial] = LeftOut(True, [reason])
    for row in crossings.iter_rows(named=True) if crossings is not None else ():
        found.setdefault(row["trial"], LeftOut(False)).say(row["reason"])
    return found


def without_result(causes: list[str]) -> LeftOut:
    named = ", ".join(causes[:MOST_NAMED]) + (f" and {len(causes) - MOST_NAMED} more" if causes[MOST_NAMED:] else "")
    because = f", because {named} {'was' if len(causes) == 1 else 'were'} refused or excluded" if causes else ""
    return LeftOut(True, [f"it has no result{because}"])


QUALITY_OF_FIT = ("VAF", "R2")  # numbers of a fit without an interval that stand beside its estimates
UNKNOWN = "–"


def shown(value: Any) -> str:
    """A cell of a table as the page has it: numbers with six digits, text as it is."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return UNKNOWN
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def estimate(value: float | None, low: float | None = None, high: float | None = None) -> tuple[str, str]:
    """A value with as many digits as its interval allows, and the interval; empty where it has none."""
    if value is None or not math.isfinite(value):
        return UNKNOWN, ""
    if low is None or high is None:
        return f"{value:.4g}", ""
    digits = decimals(value, low, high, None)
    return fixed(value, digits), f"[{fixed(low, digits)}, {fixed(high, digits)}]"


def estimated(table: pl.DataFrame) -> list[str]:
    return [name for name in table.columns if {f"{name}_low", f"{name}_high"} <= set(table.columns)]


def estimates_of(table: pl.DataFrame, described: DescribedTable | None) -> dict[str, Any]:
    """The estimates of one trial: `columns` with name, unit and meaning, and a row of texts per fit."""
    with_interval = estimated(table)
    names = [*with_interval, *(name for name in QUALITY_OF_FIT if name in table.columns)]
    columns = [{"name": name, **said_of(name, described)} for name in names]
    first = ["amplitude_deg"] * ("amplitude_deg" in table.columns)
    rows = []
    for row in table.iter_rows(named=True):
        head = ["all" if row[name] is None else f"{row[name]:g}" for name in first]
        ends = [(row[name], row.get(f"{name}_low"), row.get(f"{name}_high")) for name in names]
        rows.append([*head, *(" ".join(estimate(*number)).strip() for number in ends)])
    return {"columns": [{"name": name, **said_of(name, described)} for name in first] + columns, "rows": rows}


def every_column(table: pl.DataFrame, described: DescribedTable | None) -> list[list[str]]:
    """Every filled column of the last row of a trial, which is the fit to all of it: name, value, unit, meaning."""
    row = table.row(-1, named=True) if len(table) else {}
    filled = {name: value for name, value in row.items() if value not in (None, "")}
    return [[name, shown(value), *said_of(name, described).values()] for name, value in filled.items()]


def said_of(column: str, described: DescribedTable | None) -> dict[str, str]:
    known = described.columns.get(column) if described else None
    return {"unit": printed(known.unit) if known else "", "meaning": known.meaning if known else ""}


def printed(unit: str) -> str:
    return "" if unit == "1" else unit.replace("*", "·").replace("^2", "²")


def number_cell(row: Mapping[str, Any], column: str) -> dict[str, str]:
    """An estimate as a cell: `column`, the value by which it is sorted, its `text` and `interval`."""
    value = row.get(column)
    if not isinstance(value, int | float) or not math.isfinite(value):
        return {"column": column, "sort": "", "text": UNKNOWN, "interval": ""}
    text, interval = estimate(float(value), row.get(f"{column}_low"), row.get(f"{column}_high"))
    return {"column": column, "sort": repr(value), "text": text, "interval": interval}


BEGINNING = re.compile(r"(?:^|; )(?=(?:\w+\.csv: )?\w+ (?:\S+ is (?:above|below) |is not a number))")
"""Where the next doubt of a cell begins, as `doubtful.doubts` writes it."""
PARTS = {"amplitude_deg": "deg", "frequency_hz": "Hz"}
"""Columns that say which part of a trial a row is of, and their units."""
REPEATED = re.compile(r"\w+\.csv: ")  # beginning of a doubt that another table has
COLUMN = re.compile(r"(?:\w+\.csv: )?(\w+) ")


def doubts_of(tables: Mapping[str, pl.DataFrame], described: Mapping[str, DescribedTable]) -> list[dict[str, Any]]:
    """Each doubt about one trial: `where` in it, `of` all of its fit, a part, or an other table, `text`, `meaning`.

    `tables` has its rows of each table, that of its fit first. Doubts that other tables only repeat are left out.
    """
    found = []
    for number, (name, table) in enumerate(tables.items()):
        for row in table.iter_rows(named=True):
            part = "part" if row.get("amplitude_deg") is not None else "all"
            place = where(row) if number == 0 else f"{name}.csv, {where(row)}"
            for text in split(row.get("doubtful") or ""):
                if number and REPEATED.match(text):
                    break  # the rest of the cell is the other table's
                said = meaning(text, described.get(name))
                found.append({"where": place, "of": "other" if number else part, "text": text, "meaning": said})
    return found


def split(cell: str) -> list[str]:
    return [part for part in BEGINNING.split(cell) if part]


def where(row: Mapping[str, Any]) -> str:
    at = [f"{row[column]:g} {unit}" for column, unit in PARTS.items() if row.get(column) is not None]
    return ", ".join(at) or ("all amplitudes" if "amplitude_deg" in row else "whole trial")


def meaning(text: str, described: DescribedTable | None) -> str:
    named = COLUMN.match(text)
    column = described.columns.get(named[1]) if named and described else None
    return column.meaning if column else ""


Lines = list[list[str]]  # rows of text


def provenance_of(provenance: Mapping[str, Any]) -> dict[str, Any]:
    """What ingest wrote about a trial (`Trial.provenance`), as `files`, `signals` and further `facts`."""
    return {
        "files": [
            [
                role, str(file.get("path", "")), shown(file.get("bytes")), str(file.get("sha256", "")),
                str(file.get("source")),
            ]
            for role, file in provenance.get("files", {}).items()
        ],
        "signals": signals(provenance.get("columns", {})),
        "facts": facts({name: provenance[name] for name in provenance if name not in ("files", "columns")}),
    }  # fmt: skip


def signals(columns: Mapping[str, Mapping[str, Any]]) -> Lines:
    """Each signal with its channel in the file, and how it was converted; the axes of a marker or plate in one row."""
    found: dict[str, list[str]] = {}
    for name, origin in columns.items():
        vector = name.rpartition("_")[0] if "component" in origin or "plate" in origin else name
        found.setdefault(vector, [vector, str(origin.get("file", "")), channel(origin), conversion(origin)])
    return list(found.values())


def channel(origin: Mapping[str, Any]) -> str:
    if "plate" in origin:
        return f"force plate {origin['plate']}, type {origin.get('type')}, analogue channels {origin.get('analogs')}"
    named = (origin.get(key) for key in ("topic", "field", "label", "channel", "column"))
    return " ".join(str(part) for part in named if part)


def conversion(origin: Mapping[str, Any]) -> str:
    """From the unit of the file to that of the trial, with sign, scale, offset and what else was taken off."""
    unit = origin.get("unit") or ", ".join(dict.fromkeys(origin.get("units", ())))
    steps = [f"{unit} → {origin.get('si_unit', '')}"]
    usual = {"sign": 1, "scale": 1, "offset": 0}
    steps += [f"{key} {shown(origin[key])}" for key in usual if origin.get(key, usual[key]) != usual[key]]
    steps += [f"{key} {origin[key]}" for key in ("delay", "low_pass", "resolution", "counter") if origin.get(key)]
    return ", ".join(steps)


def facts(content: Mapping[str, Any], place: str = "") -> Lines:
    """Every other fact with its place: clocks, stamps, rates, damage, versions, warnings."""
    found: Lines = []
    for name, value in content.items():
        if isinstance(value, Mapping):
            found += facts(value, f"{place}{name} ")
        elif value not in (None, "", []):
            found.append([f"{place}{name}", listed(value)])
    return found


def listed(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {listed(part)}" for name, part in value.items())
    return "; ".join(map(listed, value)) if isinstance(value, list) else shown(value)


Verdict = Literal["used", "doubtful", "excluded", "refused"]
NOT_CONDITIONS = ("trial", "experiment", "log", "log_source", "mocap", "mocap_source", "log_part", "exclude", "accept")
"""Columns of the sheet that are not conditions of the trial."""


@dataclass(frozen=True)
class ReportedTrial:
    """One trial, as far as the campaign's results know it."""

    name: str
    row: Mapping[str, Any]  # of the sample sheet
    tables: Mapping[str, pl.DataFrame] = field(default_factory=dict)  # its rows of each, those of its fit first
    quality: pl.DataFrame | None = None  # the verdicts on it; None if it was never examined
    provenance: Mapping[str, Any] = field(default_factory=dict)
    left_out: Sequence[str] = ()  # why it has no result, or is excluded
    refused: bool = False  # whether it is missing because a job refused or failed
    pictures: Pictures = field(default_factory=Pictures)

    @property
    def main(self) -> pl.DataFrame:
        """The rows of its fit; an empty table if it has none."""
        return next(iter(self.tables.values()), pl.DataFrame())

    @property
    def doubtful(self) -> bool:
        return "doubtful" in self.main.columns and bool((self.main["doubtful"].fill_null("") != "").any())

    @property
    def verdict(self) -> Verdict:
        if self.left_out:
            return "refused" if self.refused else "excluded"
        return "doubtful" if self.doubtful else "used"

    def not_checked(self) -> list[str]:
        found = self.main["not_checked"] if "not_checked" in self.main.columns else pl.Series(dtype=pl.String)
        return [str(reason) for reason in found.drop_nulls().unique(maintain_order=True)]

    def condition(self, columns: Collection[str] | None = None) -> str:
        """Its conditions in one line, or those of them in these columns of the sheet."""
        said = {name: value for name, value in self.row.items() if name not in NOT_CONDITIONS and value is not None}
        words = {True: "perturbed", False: "unperturbed"}
        return ", ".join(
            words[bool(value)] if name == "perturbed" else f"{name} {shown(value)}"
            for name, value in said.items()
            if columns is None or name in columns
        )

    def estimates(self) -> Mapping[str, Any]:
        """Its row of K, B and I from the fit to all of it; empty without a fit."""
        return self.main.row(-1, named=True) if len(self.main) else {}


def trial_content(
    trial: ReportedTrial, described: Mapping[str, DescribedTable], checks: Mapping[str, str]
) -> dict[str, Any]:
    """All text of a trial for the page; `checks` has the meaning of each check of quality control."""
    tables = {name: table for name, table in trial.tables.items() if len(table)}
    name = next(iter(tables), "")
    return {
        "name": trial.name,
        "experiment": trial.row["experiment"],
        "description": EXPERIMENTS[trial.row["experiment"]].description,
        "condition": trial.condition(),
        "verdict": trial.verdict,
        "left_out": list(trial.left_out),
        "doubts": doubts_of(tables, described),
        "not_checked": trial.not_checked(),
        "table": name,
        "estimates": estimates_of(tables[name], described.get(name)) if tables else None,
        "columns": every_column(tables[name], described.get(name)) if tables else [],
        "quality": quality_rows(trial.quality, checks),
        "time_base": time_base(trial.tables.get("timebase"), described.get("timebase")),
        "provenance": provenance_of(trial.provenance),
        "panels": [panel.content() for panel in trial.pictures.panels],
        "remark": trial.pictures.remark,
    }


def quality_rows(quality: pl.DataFrame | None, checks: Mapping[str, str]) -> list[list[str]]:
    """Check, meaning, value, threshold, verdict and remark of every check."""
    if quality is None:
        return []
    return [
        [
            row["check"], checks.get(row["check"], ""), with_unit(row["value"], row["unit"]),
            with_unit(row["threshold"], row["unit"]), row["verdict"], row["remark"] or "",
        ]
        for row in quality.iter_rows(named=True)
    ]  # fmt: skip


def with_unit(value: float | None, unit: str | None) -> str:
    return shown(value) if value is None else f"{shown(value)} {printed(unit or '')}".strip()


def time_base(table: pl.DataFrame | None, described: DescribedTable | None) -> list[list[str]]:
    """What the time base did to each group of signals: column, its values, its meaning."""
    if table is None:
        return []
    names = [name for name in table.columns if name not in ("trial", "joint", "side", "data", "signals")]
    filled = [name for name in names if table[name].count()]
    signals = table["signals"].to_list()
    lines = [["signals", *map(shown, signals), ""]]
    return lines + [[name, *map(shown, table[name]), said_of(name, described)["meaning"]] for name in filled]


QUANTITIES = ["VAF", "K", "B", "I"]  # numbers of the table of trials


def trial_rows(trials: Sequence[ReportedTrial]) -> list[dict[str, Any]]:
    differing = differing_conditions(trials)
    return [trial_row(trial, differing) for trial in trials]


def differing_conditions(trials: Sequence[ReportedTrial]) -> set[str]:
    """Columns of the sheet whose entries differ between trials; the others would say the same in every row."""
    return {name for trial in trials for name in trial.row if trial.row[name] != trials[0].row.get(name)}


def trial_row(trial: ReportedTrial, differing: Collection[str]) -> dict[str, Any]:
    facts, estimates = EXPERIMENTS[trial.row["experiment"]], trial.estimates()
    return {
        "name": trial.name,
        "experiment": trial.row["experiment"],
        "condition": trial.condition(differing),
        "verdict": trial.verdict,
        "doubt": doubt_line(trial),
        "numbers": [number_cell(estimates, column) for column in ("VAF", *facts.impedance)],
    }


def doubt_line(trial: ReportedTrial) -> str:
    """Why a trial is doubtful or left out, for a cell of the table."""
    if trial.left_out:
        return trial.left_out[0]
    if not trial.doubtful:
        return ""
    rows = trial.main.filter(trial.main["doubtful"].fill_null("") != "")
    parts = ["whole trial"] * len(rows)
    if "amplitude_deg" in rows.columns:
        parts = ["all amplitudes" if deg is None else f"{deg:g} deg" for deg in rows["amplitude_deg"]]
    return "; ".join(f"{part}: {text}" for part, text in zip(parts, rows["doubtful"], strict=True))


def headline_rows(summary: Mapping[str, Any]) -> list[dict[str, str]]:
    """The headline numbers of a summary (`summary.json`) beside those that the paper's draft prints."""
    return [headline_row(number) for number in summary["numbers"].values()]


def headline_row(number: Mapping[str, Any]) -> dict[str, str]:
    digits = decimals(number["value"], *rounded_by(number))
    interval = UNKNOWN
    if number["low"] is not None:
        finer = told_apart(number["low"], number["high"], digits)
        interval = f"{fixed(number['low'], finer)} to {fixed(number['high'], finer)} ({number['interval']})"
    elif number.get("amplitudes_low") is not None:
        interval = " to ".join(fixed(number[key], digits) for key in AMPLITUDES) + " (single amplitudes)"
    return {
        "meaning": number["meaning"],
        "value": fixed(number["value"], digits),
        "unit": printed(number["unit"]),
        "interval": interval,
        "n": trials_text(number),
        "draft": UNKNOWN if number["draft"] is None else f"{number['draft']:g}",
    }


def left_out(trials: Sequence[ReportedTrial]) -> list[dict[str, Any]]:
    return [
        {"name": trial.name, "verdict": trial.verdict, "reason": reason}
        for trial in trials
        for reason in trial.left_out
    ]


def counts(trials: Sequence[ReportedTrial]) -> dict[str, int]:
    found = Counter(trial.verdict for trial in trials)
    return {verdict: found[verdict] for verdict in ("used", "doubtful", "excluded", "refused")}


def choices(trials: Sequence[ReportedTrial]) -> dict[str, list[str]]:
    experiments = dict.fromkeys(shown(trial.row["experiment"]) for trial in trials)
    return {"experiment": list(experiments), "verdict": [name for name, number in counts(trials).items() if number]}
