"""What a reader must know of a campaign, in the same words at the end of a run, by `results` and on the page: causes
and the trials that they concern, not the rows of tables that inherit them.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import polars as pl

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.errors import listing
from osl_analysis.jobs.refusal import is_refused
from osl_analysis.judge.doubts import CAUSES, DOUBTFUL, LATENESS, causes_by_trial, not_checked_of, of_whole_trial
from osl_analysis.judge.recording import CHECKS
from osl_analysis.judge.table import Cause
from osl_analysis.judge.usable import HOW_TO_USE, exclusions
from osl_analysis.table import read_table

MOST_NAMED = 3  # trials that a line names
BEGINS_SIZE = ", each ms of delay would take"  # as `doubts.sized` writes it


@dataclass(frozen=True)
class Finding:
    """One cause, or one thing that could not be checked, and the trials that it concerns."""

    verdict: Literal["doubtful", "flagged", "not checked"]
    of: str  # what was judged: `impedance trials`
    cause: str
    says: str
    remedy: str
    trials: tuple[str, ...]
    judged: tuple[str, ...]  # all trials that were judged

    def line(self) -> str:
        others = [trial for trial in self.judged if trial not in self.trials]
        few = len(others) <= MOST_NAMED < len(self.trials)
        names = others if few else self.trials
        more = ", ..." if len(names) > MOST_NAMED else ""
        named = f" [{'all but ' if few else ''}{', '.join(names[:MOST_NAMED])}{more}]" if others else ""
        remedy = f". {self.remedy[0].upper()}{self.remedy[1:]}" if self.remedy else ""
        counts = f"{len(self.trials)} of {len(self.judged)} {self.of}"
        return f"{self.verdict}, {counts}: {self.cause}: {self.says}{remedy}{named}"

    def content(self) -> dict[str, Any]:
        """It for `summary.json`."""
        said = {name: getattr(self, name) for name in ("verdict", "of", "cause", "says", "remedy")}
        return {**said, "n": len(self.judged), "trials": list(self.trials), "line": self.line()}


def findings(verdicts: pl.DataFrame, tables: Mapping[str, pl.DataFrame]) -> list[Finding]:
    """What `quality.csv` and the result tables, by name, say of a campaign: what most trials have first."""
    judged = [*doubts_in(tables), *flags_in(verdicts), *unchecked_in(tables)]
    order = ("doubtful", "flagged", "not checked")
    return sorted(judged, key=lambda one: (order.index(one.verdict), -len(one.trials)))


def doubts_in(tables: Mapping[str, pl.DataFrame]) -> Iterator[Finding]:
    """The causes of doubt by experiment; those of its other tables, and of tables of groups, are their own."""
    for name, facts in EXPERIMENTS.items():
        fitted = {table.name: table.doubts_of for table in facts.tables if table.judged}
        for table, of in (fitted | dict.fromkeys(facts.judged_further, "")).items():
            if DOUBTFUL not in tables.get(table, pl.DataFrame()).columns:
                continue
            causes = causes_by_trial(tables[table], tables.get(of))
            by_cause: dict[str, dict[str, str]] = {}
            for trial, texts in causes.items():
                for cause, text in texts.items():
                    by_cause.setdefault(cause, {})[str(trial)] = text
            judged = f"{name} trials" if table in fitted else table.replace("_", " ")
            judged += f", in {table}.csv alone" if of else ""
            for cause, trials in by_cause.items():
                known = CAUSES.get(cause) or Cause(cause, next(iter(trials.values())), "")
                single = not known.otherwise or any(known.remedy[1:] in text for text in trials.values())
                remedy = known.remedy if single else known.otherwise
                yield Finding("doubtful", judged, cause, known.says, remedy, tuple(trials), tuple(map(str, causes)))


def flags_in(verdicts: pl.DataFrame) -> Iterator[Finding]:
    """The checks of recordings that trials do not pass, though they are used."""
    for name, check in CHECKS.items():
        own = verdicts.filter(pl.col("check") == name)
        failed = own.filter(pl.col("verdict") == "flag")
        if len(failed):
            row = failed.row(0, named=True)
            example = f"{check.cause.says}, as {row['value']:.4g} {row['unit']} in {row['trial']}"
            example += f" ({row['remark']})" if row["remark"] else ""
            trials = tuple(failed["trial"]), tuple(own["trial"])
            yield Finding("flagged", "trials", check.cause.name, example, check.cause.remedy, *trials)


def unchecked_in(tables: Mapping[str, pl.DataFrame]) -> Iterator[Finding]:
    """What could not be checked, by experiment; a torque that comes late with what that would do, over all trials."""
    for name, table in tables.items():
        if "not_checked" not in table.columns:
            continue
        found: dict[str, dict[str, str]] = {}
        for (trial,), rows in table.group_by("trial", maintain_order=True):
            for what, why in not_checked_of(rows).items():
                found.setdefault(what, {})[str(trial)] = why
        for what, reasons in found.items():
            why = next(iter(reasons.values()))
            if LATENESS in what:
                why = why.partition(BEGINS_SIZE)[0] + sizes(table.filter(pl.col("trial").is_in(list(reasons))))
            of = f"{name.replace('_', ' ')} trials"
            yield Finding(
                "not checked", of, what, why, "", tuple(reasons), tuple(table["trial"].unique(maintain_order=True))
            )


def sizes(table: pl.DataFrame) -> str:
    """What each ms by which the torque is late would do in these trials, from the fits to all of each."""
    whole = pl.DataFrame([row for row in table.to_dicts() if of_whole_trial(row)], infer_schema_length=None)
    if whole.is_empty() or not {"K", "B", "I"} <= set(whole.columns):
        return ""
    of_B, B, of_I, I = (
        " to ".join(dict.fromkeys(f"{x:.2g}" for x in (values.min(), values.max())))  # type: ignore[str-bytes-safe]
        for values in (1e-3 * whole["K"], whole["B"], 1e-3 * whole["B"], whole["I"])
    )
    return (
        f"{BEGINS_SIZE} {of_B} N*m*s/rad off B = {B} and {of_I} kg*m^2 off I = {I}, check it with a known spring on "
        "the same bench"
    )


def written_tables(tables: Iterable[Path]) -> dict[str, pl.DataFrame]:
    """The tables among these files by name, without refusal records."""
    return {path.stem: read_table(path) for path in tables if path.is_file() and not is_refused(path)}


def findings_report(verdicts: pl.DataFrame, tables: Iterable[Path]) -> str:
    """The findings of a campaign for the end of a run, a line each; empty without any."""
    return "\n".join(one.line() for one in findings(verdicts, written_tables(tables)))


def exclusion_report(verdicts: pl.DataFrame, by_sheet: Mapping[str, str]) -> str:
    """Excluded trials with reasons, in the sample sheet or by the `verdicts`, for the end of a run, also of a failed
    run; empty without any. Trials that fail the same check are one line."""
    failed = verdicts.filter(pl.col("verdict") == "exclude").unique("trial", keep="first", maintain_order=True)
    reasons, lines = exclusions(verdicts), []
    for (check,), rows in failed.group_by("check", maintain_order=True):
        cause = CHECKS[str(check)].cause
        named = listing([f"{trial} ({reasons[trial]})" for trial in rows["trial"]], MOST_NAMED)
        lines.append(
            f"excluded from tables and figures by quality control: {named}: {cause.name}, {cause.says}; {cause.remedy}"
        )
    stated = [f"excluded by the sample sheet: {trial} ({why})" for trial, why in by_sheet.items()]
    return "\n".join([*stated, *lines, *([f"to change that: {HOW_TO_USE}"] if lines else [])])


def left_behind_report(stored: Iterable[Path], trials: Collection[str]) -> str:
    """A line on trials that are not among those of the sheet, as after a renaming, whose files are still `stored` among
    the results; empty without such files."""
    unknown = sorted({path.stem for path in stored} - set(trials))
    if not unknown:
        return ""
    return (
        f"not in the sample sheet, and in no table or figure: {listing(unknown, 12)}; files of theirs are left "
        "below the results; delete them, or enter the trials again"
    )
