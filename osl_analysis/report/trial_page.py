"""The page's content on each trial (conditions, verdict, estimates, doubts, provenance) and on the
campaign."""

import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import Any, NamedTuple

import polars as pl

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.dictionary import described_tables_by_name
from osl_analysis.judge.campaign import QUALITY
from osl_analysis.judge.exclusions import exclusion_text
from osl_analysis.judge.finding import Beyond, Finding, Grade, WordedFinding, Words
from osl_analysis.judge.known_findings import CHECKS, FINDINGS
from osl_analysis.judge.recording_checks import NOT_APPLICABLE
from osl_analysis.judge.words import sentence_of
from osl_analysis.report.decimal_places import digits_of, fixed
from osl_analysis.report.panels import Pictures
from osl_analysis.report.typography import printed

NO_VALUE = "–"
VERDICTS = ("clear", "doubtful in part", "flagged", "doubtful", "excluded", "refused")
"""Verdicts on a trial: `doubtful`: the fit to all of it is; `doubtful in part`: others are. The
last two are unused."""


class Scope(StrEnum):
    """What of a trial a doubt is about; `report.js` sorts doubts by it. The worst first."""

    WHOLE_FIT = "whole fit"
    RECORDING = "recording"
    PART_OF_FIT = "part of the fit"
    OTHER_TABLE = "other table"


VERDICT_BY_SCOPE = {
    Scope.WHOLE_FIT: "doubtful",
    Scope.RECORDING: "flagged",
    Scope.PART_OF_FIT: "doubtful in part",
    Scope.OTHER_TABLE: "doubtful in part",
}
"""The verdict on a trial that a doubt leads to."""

NOT_ANALYSED = "recording that could not be analysed"
UNLIKE_OTHERS = "crossing unlike the others under its conditions"
LACKS_ANOTHER = "missing trial that its fit needs"


class LeftOut(NamedTuple):
    """Why a trial has no result."""

    by_job: bool  # whether a job refused or failed; else it was excluded
    cause: str  # of the first reason, in a few words, as trials are counted by
    reasons: list[str]


def left_out_trials(
    excluded: pl.DataFrame, tables: Mapping[str, pl.DataFrame], refused: Mapping[str, str]
) -> dict[str, LeftOut]:
    """Gather the trials that are left out.

    Parameters
    ----------
    excluded : polars.DataFrame
        `excluded.csv`.
    tables : Mapping of str to polars.DataFrame
        Result tables by name, of which those of walking name excluded crossings.
    refused : Mapping of str to str
        The reason of each refused trial.

    Returns
    -------
    dict of str to LeftOut
        By trial; each reason once.
    """
    left_out: dict[str, LeftOut] = {}

    def add(trial: str, by_job: bool, cause: str, reason: str) -> None:
        reasons = left_out.setdefault(trial, LeftOut(by_job, cause, [])).reasons
        if reason not in reasons:
            reasons.append(reason)

    for row in excluded.iter_rows(named=True):
        # outcomes of a job, which are no checks
        by_job = row["check"] in ("refused", "failed")
        reason = row["remark"] if by_job else exclusion_text(row)
        add(row["trial"], by_job, exclusion_cause(row), reason)
    of_table = set(left_out)
    for trial, reason in refused.items():
        if trial not in of_table:
            add(trial, True, NOT_ANALYSED, reason)
    crossings = tables.get("walking_crossings", pl.DataFrame(schema=["trial", "status"]))
    outliers = crossings.filter(pl.col("status") == "outlier")["trial"].to_list()
    for table, column in (("walking", "excluded"), ("walking_excluded", "reason")):
        not_used = tables.get(table, pl.DataFrame(schema=["trial", column]))
        for trial, reason in not_used.select("trial", column).rows():
            if reason:
                cause = UNLIKE_OTHERS if trial in outliers else NOT_ANALYSED
                add(trial, False, cause, reason)
    return left_out


def exclusion_cause(row: Mapping[str, Any]) -> str:
    """Why a trial is not used, in a few words, by a row of `excluded.csv`: what the sheet says, or
    the cause that its check tells."""
    if row["check"] == "sample sheet":
        return str(row["remark"])
    check = CHECKS.get(row["check"])
    return FINDINGS[check.finding].title if check else NOT_ANALYSED


@dataclass(frozen=True)
class Doubt:
    """A doubt about a trial, for a reader.

    Attributes
    ----------
    where
        An amplitude and frequency, its recording, or another table.
    scope
        What of the trial it is about.
    numbers
        Evidence: column, value, limit and meaning of each.
    says, size, remedy, text
        Its words, and all of them in a sentence.
    """

    where: str
    scope: Scope
    cause: str
    numbers: list[list[str]]
    says: str
    size: str
    remedy: str
    text: str

    @property
    def verdict(self) -> str:
        return VERDICT_BY_SCOPE[self.scope]


def doubt_of(worded: WordedFinding, main_table: str) -> Doubt:
    """A finding as a doubt about a trial; `main_table` is that of the trial's fit."""
    finding = worded.finding
    place = place_of(finding)
    if finding.table == QUALITY:
        where = "its recording"
        scope = Scope.RECORDING
    elif finding.table != main_table:
        where = f"{finding.table.replace('_', ' ')}, {place}"
        scope = Scope.OTHER_TABLE
    else:
        where = place
        scope = Scope.PART_OF_FIT if finding.is_of_part else Scope.WHOLE_FIT
    words = Words(*map(printed, worded.words))
    return Doubt(
        where=where,
        scope=scope,
        cause=finding.cause,
        numbers=[number_cells(number, finding.table) for number in finding.evidence],
        says=words.says,
        size=words.size,
        remedy=words.remedy,
        text=sentence_of(words, finding.cause),
    )


def place_of(finding: Finding) -> str:
    """The amplitude and the frequency that a finding is about, or all of them."""
    parts = []
    if finding.amplitude_deg is not None:
        parts.append(f"{finding.amplitude_deg:g} deg")
    if finding.frequency_hz is not None:
        parts.append(f"{finding.frequency_hz:g} Hz")
    if parts:
        return ", ".join(parts)
    return "all amplitudes" if finding.table == "impedance" else "whole trial"


def number_cells(number: Beyond, table: str) -> list[str]:
    """Column, value, limit and meaning of a number beyond its limit."""
    if table == QUALITY:
        meaning = CHECKS[number.column].meaning
    else:
        meaning = unit_and_meaning(number.column, table)["meaning"]
    sides = {"nan": "not a number", "near": "near a factor between units"}
    limit = sides.get(number.side, f"{number.side} {number.limit:g}")
    return [printed(number.column), printed(f"{number.value:.3g}"), printed(limit), meaning]


NO_CONDITIONS = (
    "trial",
    "experiment",
    "log",
    "log_source",
    "mocap",
    "mocap_source",
    "log_part",
    "exclude",
    "accept",
)
"""Columns of the sample sheet that are no conditions of a trial."""


@dataclass(frozen=True)
class ReportedTrial:
    """One trial with its results.

    Attributes
    ----------
    row
        Its row of the sample sheet.
    tables
        Its rows of each table, that of its fit first.
    findings
        Those of `findings.csv` about it.
    quality
        Verdicts on it; None if it was never examined.
    provenance
        Where its columns come from.
    left_out
        Why it has no result, or is excluded.
    left_out_for
        The cause of the first of these reasons, in a few words.
    refused
        Whether it is missing because a job refused or failed.
    """

    name: str
    row: Mapping[str, Any]
    tables: Mapping[str, pl.DataFrame] = field(default_factory=dict)
    findings: Sequence[WordedFinding] = ()
    quality: pl.DataFrame | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)
    left_out: Sequence[str] = ()
    left_out_for: str = ""
    refused: bool = False
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
    def unchecked(self) -> list[WordedFinding]:
        """Findings on the fit to all of it that could not be checked, and remarks."""
        unchecked = []
        for worded in self.findings:
            finding = worded.finding
            is_of_whole_fit = finding.table == self.main_table and not finding.is_of_part
            if is_of_whole_fit and finding.grade in (Grade.UNCHECKED, Grade.NOTES):
                unchecked.append(worded)
        return unchecked

    @cached_property
    def doubts(self) -> list[Doubt]:
        """Each doubt about it. Doubts that other tables only repeat are left out."""
        doubts = []
        for worded in self.findings:
            if worded.finding.grade is Grade.DOUBTS and not worded.finding.inherited:
                doubts.append(doubt_of(worded, self.main_table))
        return doubts

    @property
    def doubts_worst_first(self) -> list[Doubt]:
        """The doubts about it in the order of `Scope`."""
        scopes = list(Scope)
        return sorted(self.doubts, key=lambda doubt: scopes.index(doubt.scope))

    @property
    def verdict(self) -> str:
        """One of `VERDICTS`: the worst that follows from its doubts."""
        if self.left_out:
            return "refused" if self.refused else "excluded"
        verdicts = {doubt.verdict for doubt in self.doubts}
        for verdict in VERDICT_BY_SCOPE.values():
            if verdict in verdicts:
                return verdict
        return "clear"

    def causes_of(self, verdict: str) -> set[str]:
        """The causes of a verdict. Only the worst doubt of each cause counts, as in the map of
        trials and causes."""
        worst: dict[str, str] = {}
        for doubt in self.doubts_worst_first:
            worst.setdefault(doubt.cause, doubt.verdict)
        return {cause for cause, worst_verdict in worst.items() if worst_verdict == verdict}

    def condition(self, columns: Collection[str] | None = None) -> str:
        """Its conditions in one line; with `columns`, only those in these columns of the sheet."""
        texts = []
        for name, value in self.row.items():
            is_asked = columns is None or name in columns
            if name in NO_CONDITIONS or value is None or not is_asked:
                continue
            if name == "perturbed":
                texts.append("perturbed" if value else "unperturbed")
            else:
                texts.append(f"{name} {cell_text(value)}")
        return ", ".join(texts)


def trial_content(trial: ReportedTrial) -> dict[str, Any]:
    """The content of one trial's part of the page, as `templates/report.js` reads it."""
    tables = {name: table for name, table in trial.tables.items() if len(table)}
    name = next(iter(tables), "")
    fit_to_all = tables[name].row(-1, named=True) if tables else {}
    columns = []
    column_values = []
    for column, value in fit_to_all.items():
        if value not in (None, ""):
            columns.append([column, cell_text(value), *unit_and_meaning(column, name).values()])
            column_values.append([None, shown_estimate(fit_to_all, column).full[:1]])
    not_checked = []
    for worded in trial.unchecked:
        words = worded.words._replace(size="")
        not_checked.append(printed(sentence_of(words, worded.finding.cause)))
    experiment = trial.row["experiment"]
    return {
        "name": trial.name,
        "experiment": experiment,
        "description": EXPERIMENTS[experiment].description,
        "condition": trial.condition(),
        "verdict": trial.verdict,
        "left_out": [printed(reason) for reason in trial.left_out],
        "doubts": [asdict(doubt) for doubt in trial.doubts],
        "not_checked": not_checked,
        "table": name,
        "estimates": estimate_rows(tables[name], name) if tables else None,
        "columns": columns,
        "column_values": column_values,
        "quality": quality_rows(trial.quality) if trial.quality is not None else [],
        "time_base": time_base_rows(trial.tables.get("timebase", pl.DataFrame())),
        "provenance": provenance_content(trial.provenance),
        "panels": trial.pictures.panels,
        "remark": trial.pictures.remark,
    }


def time_base_rows(time_base: pl.DataFrame) -> list[list[str]]:
    """What is known of the time base of each group of signals: column, a value per group, meaning;
    the names of the signals first."""
    rows: list[list[str]] = []
    for column in time_base:
        cells = [column.name, *map(cell_text, column)]
        if column.name == "signals":
            rows.insert(0, [*cells, "meaning"])
        elif column.name not in ("trial", "joint", "side", "data") and column.count():
            rows.append([*cells, unit_and_meaning(column.name, "timebase")["meaning"]])
    return rows


def quality_rows(verdicts: pl.DataFrame) -> list[list[str]]:
    """Check, its meaning, value, threshold, verdict and remark of each row of `quality.csv` that
    applies."""
    rows = []
    for row in verdicts.iter_rows(named=True):
        if row["verdict"] == NOT_APPLICABLE:
            continue
        cells = [row["check"], CHECKS[row["check"]].meaning]
        unit = printed(row["unit"] or "")
        for name in ("value", "threshold"):
            unit_of_cell = "" if row[name] is None else unit
            cells.append(f"{cell_text(row[name])} {unit_of_cell}".strip())
        rows.append([*cells, row["verdict"], row["remark"] or ""])
    return rows


def cell_text(value: Any) -> str:
    """A cell of a table as the page has it: numbers with six digits, text as it is."""
    if value is None:
        return NO_VALUE
    if not isinstance(value, float):
        return str(value)
    # the blank behind it tells the end of a power
    return printed(f"{value:.6g} ").rstrip() if math.isfinite(value) else NO_VALUE


def unit_and_meaning(column: str, table: str) -> dict[str, str]:
    """`unit` and `meaning` of a column of a result table; empty if it is not described."""
    tables = described_tables_by_name()
    if table not in tables or column not in tables[table].columns:
        return {"unit": "", "meaning": ""}
    described = tables[table].columns[column]
    return {"unit": printed(described.unit), "meaning": described.meaning}


@dataclass(frozen=True)
class ShownEstimate:
    """A number of a result table with its interval, as the page shows it and in full."""

    column: str
    text: str  # with as many digits as its interval allows
    interval: str  # empty where it has none
    full: Sequence[float | None]  # value and ends of the interval; None where one is missing


def shown_estimate(row: Mapping[str, Any], column: str) -> ShownEstimate:
    """A column of a row, with the ends `_low` and `_high` of its interval."""
    full: list[float | None] = []
    for name in (column, f"{column}_low", f"{column}_high"):
        number = row.get(name)
        is_number = isinstance(number, int | float) and math.isfinite(number)
        full.append(number if is_number else None)
    value, low, high = row.get(column), row.get(f"{column}_low"), row.get(f"{column}_high")
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ShownEstimate(column, NO_VALUE, "", full)
    if low is None or high is None:
        text = f"{value:.4g}" if full[0] is not None else cell_text(value)
        return ShownEstimate(column, text, "", full)
    places = digits_of(value, low, high)
    interval = f"[{fixed(low, places.ends)}, {fixed(high, places.ends)}]"
    return ShownEstimate(column, printed(fixed(value, places.value)), printed(interval), full)


def estimate_rows(table: pl.DataFrame, of: str) -> dict[str, Any]:
    """The estimates of one trial from the table named `of`: `columns` with unit and meaning, and
    per fit texts (`rows`) and the numbers behind them (`values`)."""
    present = set(table.columns)
    estimates = []
    for name in table.columns:
        if {f"{name}_low", f"{name}_high"} <= present and table[name].count():
            estimates.append(name)
    for name in ("VAF", "R2"):  # without an interval
        if name in present:
            estimates.append(name)
    has_amplitudes = "amplitude_deg" in present
    rows = []
    values = []
    for row in table.iter_rows(named=True):
        cells = []
        numbers: list[Sequence[float | None] | None] = []
        if has_amplitudes:
            amplitude = row["amplitude_deg"]
            cells.append("all" if amplitude is None else f"{amplitude:g}")
            numbers.append(None)
        for name in estimates:
            shown = shown_estimate(row, name)
            cells.append(f"{shown.text} {shown.interval}".strip())
            numbers.append(shown.full)
        rows.append(cells)
        values.append(numbers)
    names = ["amplitude_deg", *estimates] if has_amplitudes else estimates
    columns = [{"name": name, **unit_and_meaning(name, of)} for name in names]
    return {"columns": columns, "rows": rows, "values": values}


USUAL_CONVERSION = {"sign": 1, "scale": 1, "offset": 0}  # is not told


def provenance_content(provenance: Mapping[str, Any]) -> dict[str, Any]:
    """The provenance of a trial as `files`, `signals` (file, channel, conversion; the axes of a
    marker or plate are one signal) and further `facts`."""
    files = []
    for role, file in provenance.get("files", {}).items():
        cells = [cell_text(file.get(key)) for key in ("path", "bytes", "sha256", "source")]
        files.append([role, *cells])
    signals: dict[str, list[str]] = {}
    for name, origin in provenance.get("columns", {}).items():
        is_axis = "component" in origin or "plate" in origin
        signal = name.rpartition("_")[0] if is_axis else name
        conversion = {}
        for key, value in origin.items():
            is_usual = not value or value == USUAL_CONVERSION.get(key)
            if key not in ("file", "component") and not is_usual:
                conversion[key] = value
        row = [signal, cell_text(origin.get("file")), fact_text(conversion)]
        signals.setdefault(signal, row)
    further = {
        name: value for name, value in provenance.items() if name not in ("files", "columns")
    }
    return {"files": files, "signals": list(signals.values()), "facts": facts(further)}


def fact_text(value: Any) -> str:
    """A fact of the provenance, with all of its parts, as text."""
    if isinstance(value, dict):  # as JSON has it; to ask for a Mapping takes ten times as long
        return ", ".join(f"{name} {fact_text(part)}" for name, part in value.items())
    if isinstance(value, list):
        return "; ".join(map(fact_text, value))
    return cell_text(value)


def facts(content: Mapping[str, Any], place: str = "") -> list[list[str]]:
    """Every other fact with its path: clocks, stamps, rates, damage, versions, warnings."""
    rows: list[list[str]] = []
    for name, value in content.items():
        if isinstance(value, dict):
            rows += facts(value, f"{place}{name} ")
        elif value not in (None, "", []):
            rows.append([f"{place}{name}", fact_text(value)])
    return rows


@dataclass(frozen=True)
class TrialRow:
    """A trial in the page's table of trials.

    Attributes
    ----------
    condition
        Those of its conditions that differ between trials.
    doubt
        Why it is left out, or doubtful.
    causes
        Of its verdict, each once.
    estimates
        VAF, stiffness, damping and inertia of the fit to all of it.
    """

    name: str
    experiment: str
    condition: str
    verdict: str
    doubt: str
    causes: Sequence[str]
    estimates: Sequence[ShownEstimate]


class LeftOutTrial(NamedTuple):
    """A reason why a trial is not used."""

    name: str
    verdict: str
    reason: str


@dataclass(frozen=True)
class TrialTable:
    """What the page shows of all trials.

    Attributes
    ----------
    rows
        The worst verdict first.
    counts
        Number of trials by verdict.
    choices
        Experiments and verdicts that the table can be filtered by.
    left_out
        Why trials are not used.
    """

    rows: Sequence[TrialRow]
    counts: Mapping[str, int]
    choices: Mapping[str, Sequence[str]]
    left_out: Sequence[LeftOutTrial]


def trial_table(trials: Sequence[ReportedTrial]) -> TrialTable:
    """The page's table of trials, and which are left out."""
    differing = set()
    for trial in trials:
        for name, value in trial.row.items():
            if value != trials[0].row.get(name):
                differing.add(name)
    counts = Counter(trial.verdict for trial in trials)
    worst_first = sorted(trials, key=lambda trial: -VERDICTS.index(trial.verdict))
    experiments = dict.fromkeys(cell_text(trial.row["experiment"]) for trial in trials)
    left_out = []
    for trial in trials:
        for reason in trial.left_out:
            left_out.append(LeftOutTrial(trial.name, trial.verdict, reason))
    return TrialTable(
        rows=[trial_row(trial, differing) for trial in worst_first],
        counts={verdict: counts[verdict] for verdict in VERDICTS},
        choices={
            "experiment": list(experiments),
            "verdict": [verdict for verdict in VERDICTS if counts[verdict]],
        },
        left_out=left_out,
    )


def trial_row(trial: ReportedTrial, differing: Collection[str]) -> TrialRow:
    """A row of the page's table of trials; of its conditions those that `differ` between trials."""
    fit_to_all = trial.main.row(-1, named=True) if len(trial.main) else {}
    estimates = []
    for column in ("VAF", *EXPERIMENTS[trial.row["experiment"]].impedance):
        estimates.append(shown_estimate(fit_to_all, column))
    # the text of the last row, which is of all of the trial, and where
    text_of: dict[str, str] = {}
    places_of: dict[str, list[str]] = {}
    for doubt in trial.doubts:
        if doubt.verdict == trial.verdict:
            text_of[doubt.cause] = doubt.text
            places_of.setdefault(doubt.cause, []).append(doubt.where)
    doubts = [f"{', '.join(places_of[cause])}: {text}" for cause, text in text_of.items()]
    return TrialRow(
        name=trial.name,
        experiment=trial.row["experiment"],
        condition=trial.condition(differing),
        verdict=trial.verdict,
        doubt=trial.left_out[0] if trial.left_out else "; ".join(doubts),
        causes=list(text_of),
        estimates=estimates,
    )
