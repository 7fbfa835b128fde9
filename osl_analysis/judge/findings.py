"""Which trials a job uses: not those that quality control excludes, nor those without a result (`refusal`); and
what a reader must know of a campaign, in the same words at the end of a run, by `results` and on the page: causes and
the trials that they concern, not the rows of tables that inherit them."""

import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import polars as pl

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.errors import InputError, listing
from osl_analysis.files import write_text
from osl_analysis.judge import doubts
from osl_analysis.judge.recording import CHECKS, judged_table
from osl_analysis.judge.table import Cause, QualityRules
from osl_analysis.measured import significant
from osl_analysis.refusal import Refusal, distinct_causes, is_refused, read_refusals
from osl_analysis.table import read_table

HOW_TO_USE = "record again, give a reason under `exclude` in the sample sheet, or name the check under `accept`"
JUDGES = ("quality", "fitted")
"""Inputs that only tell which trials are used: what was measured of them, and other results of the same trials."""
AS_IF = "the recorded torque is as if"
LARGEST_MISFIT = 1.0  # percent of the torque that a prediction may leave along angle, velocity and acceleration
MOST_NAMED = 3  # trials that a line names


def without_refused(
    inputs: Mapping[str, Any], unnamed: Sequence[str] = ()
) -> tuple[dict[str, Any], tuple[Refusal, ...], tuple[Refusal, ...]]:
    """The named inputs of a job without refusal records, the causes of all that was removed, and those without which it
    cannot run. A trial with a record in one list is removed from every list. The job cannot run if a record stands for
    a single input or for one of the `unnamed` files, if the input `trial` is such a trial, or if nothing is left of a
    list; beside an input `trial`, lists may become empty. Lists by name are handed over as they are."""
    lists = {name: files for name, files in inputs.items() if isinstance(files, list)}
    named = {name: files for name, files in inputs.items() if isinstance(files, Mapping)}
    groups = {name: files for name, files in named.items() if not any(isinstance(f, list) for f in files.values())}
    alone = [file for name, file in inputs.items() if name not in lists and name not in named]
    gone = {Path(file).stem: read_refusals(file) for files in lists.values() for file in files if is_refused(file)}
    kept: dict[str, Any] = {name: [f for f in files if Path(f).stem not in gone] for name, files in lists.items()}
    kept |= {name: {key: f for key, f in files.items() if not is_refused(f)} for name, files in groups.items()}
    missing = [cause for file in (*alone, *unnamed) for cause in read_refusals(file)]
    if "trial" not in inputs:
        emptied = [files for name, files in lists.items() if files and not kept[name] and name not in JUDGES]
        missing += [cause for files in emptied for file in files for cause in gone[Path(file).stem]]
    missing += gone.get(Path(str(inputs.get("trial"))).stem, ())
    causes = [cause for found in gone.values() for cause in found]
    causes += [cause for files in groups.values() for file in files.values() for cause in read_refusals(file)]
    return {**inputs, **kept}, distinct_causes([*causes, *missing]), distinct_causes(missing)


@dataclass(frozen=True)
class Judge:
    """What decides which trials are used: the configured rules, and what the sheet accepts by trial. Jobs that measure
    know neither, and a job over several trials reads it from a file, whose change alone runs no job again."""

    rules: QualityRules
    accept: Mapping[str, Collection[str]]

    def write(self, path: Path) -> None:
        accept = {trial: list(names) for trial, names in self.accept.items() if names}
        write_text(path, json.dumps({"rules": self.rules.model_dump(mode="json"), "accept": accept}))

    @classmethod
    def read(cls, path: Path) -> Self:
        said = json.loads(path.read_text(encoding="utf-8"))
        return cls(QualityRules.model_validate(said["rules"]), said["accept"])

    def verdicts(self, measured: Iterable[Path]) -> pl.DataFrame:
        """The rows of `quality.csv` for trials whose checks were measured; a missing file, or a record, has none."""
        there = [path for path in measured if path.is_file() and not is_refused(path)]
        kinds = dict.fromkeys(("trial", "check", "value", "unit", "remark"), pl.String) | {"value": pl.Float64}
        read = (pl.read_csv(path, columns=list(kinds), schema_overrides=kinds) for path in there)
        table = pl.concat([pl.DataFrame(schema=kinds), *read])
        return judged_table(table.with_columns(pl.col("remark").fill_null("")), self.rules, self.accept)


def exclusion_said(row: Mapping[str, Any]) -> str:
    """Why a trial is not used, by a row of `quality.csv` or `excluded.csv`: check, value, threshold, what was seen."""
    if row["value"] is None:
        return f"{row['check']}: {row['remark']}"
    said = f"{row['check']} {row['value']:.4g} {row['unit']}, threshold {row['threshold']}"
    return said + (f": {row['remark'].replace('; ', ', ')}" if row["remark"] else "")


def exclusions(verdicts: pl.DataFrame) -> dict[str, str]:
    """The trials that quality control excludes, and why."""
    reasons: dict[str, str] = {}
    for row in verdicts.filter(pl.col("verdict") == "exclude").iter_rows(named=True):
        reasons[row["trial"]] = "; ".join(filter(None, [reasons.get(row["trial"]), exclusion_said(row)]))
    return reasons


def without_excluded(inputs: Mapping[str, Any], reasons: Mapping[str, str]) -> dict[str, Any]:
    """The named inputs of a job without the files of excluded trials (`exclusions`) among those in the input `quality`,
    and without `JUDGES`. An excluded input `trial` is refused, and so are lists of excluded trials alone."""
    judged = {Path(path).stem for path in inputs.get("quality", ())}
    lists = {name: files for name, files in inputs.items() if isinstance(files, list) and name not in JUDGES}
    needed = {Path(file).stem for files in lists.values() for file in files} & judged
    single = {Path(str(inputs.get("trial"))).stem} & judged
    if single & set(reasons) or (needed | single and needed | single <= set(reasons)):
        why = "; ".join(f"{trial} ({reasons[trial]})" for trial in sorted(single or needed)[:3])
        raise InputError(f"quality control excludes every trial that is needed here: {why}; {HOW_TO_USE}")
    kept = {name: [file for file in files if Path(file).stem not in reasons] for name, files in lists.items()}
    return {name: kept.get(name, value) for name, value in inputs.items() if name not in JUDGES}


def finding(
    verdict: str, of: str, cause: str, says: str, remedy: str, trials: Sequence[str], judged: Sequence[str],
    size: str = "", limits: Mapping[str, str] | None = None,
) -> dict[str, Any]:  # fmt: skip
    """One cause, or one thing that could not be checked, as `summary.json` has it: what was judged, as `impedance
    trials`, the trials that it concerns and the number of all that were `judged`, its `size` in the worst of them, a
    `line` that says it, and the `limits` that are passed, by check or column, as `measure` and `limit`."""
    others = [trial for trial in judged if trial not in trials]
    few = len(others) <= MOST_NAMED < len(trials)
    names = others if few else trials
    more = ", ..." if len(names) > MOST_NAMED else ""
    named = f" [{'all but ' if few else ''}{', '.join(names[:MOST_NAMED])}{more}]" if others else ""
    what_to_do = f". {remedy[0].upper()}{remedy[1:]}" if remedy else ""
    line = f"{verdict}, {len(trials)} of {len(judged)} {of}: {cause}: {says}{size and f': {size}'}{what_to_do}{named}"
    said = {"verdict": verdict, "of": of, "cause": cause, "says": says, "size": size, "remedy": remedy}
    said |= {"measure": ", ".join(limits or ()), "limit": ", ".join((limits or {}).values())}
    return {**said, "n": len(judged), "trials": list(trials), "line": line}


def findings(verdicts: pl.DataFrame, tables: Mapping[str, pl.DataFrame]) -> list[dict[str, Any]]:
    """What `quality.csv` and the result tables, by name, say of a campaign: doubts, then checks of recordings that
    trials do not pass though they are used, then what could not be checked; of each what most trials have first."""
    flags = []
    for name, check in CHECKS.items():
        own = verdicts.filter(pl.col("check") == name)
        if len(failed := own.filter(pl.col("verdict") == "flag")):
            row, cause = failed.row(0, named=True), check.cause
            size = f"{significant(row['value'], 3)} {row['unit']} in {row['trial']}"
            size += f" ({row['remark']})" if row["remark"] else ""
            trials = [*failed["trial"]], [*own["trial"]]
            limit = {name: f"{check.fails} {row['threshold']}" if "threshold" in row else ""}
            flags.append(finding("flagged", "trials", cause.name, cause.says, cause.remedy, *trials, size, limit))
    parts = ([*doubts_in(tables), *causes_of_misfit(tables)], flags, unchecked_in(tables))
    return [one for part in parts for one in sorted(part, key=lambda one: -len(one["trials"]))]


def doubts_in(tables: Mapping[str, pl.DataFrame]) -> Iterator[dict[str, Any]]:
    """The causes of doubt by experiment; those of its other tables, and of tables of groups, are their own."""
    for name, facts in EXPERIMENTS.items():
        fitted = {table.name: table.doubts_of for table in facts.tables if table.judged}
        for table, of in (fitted | dict.fromkeys(facts.judged_further, "")).items():
            if doubts.DOUBTFUL not in (rows := tables.get(table, pl.DataFrame())).columns:
                continue
            of_all = rows.filter(pl.col("amplitude_deg").is_null()) if "amplitude_deg" in rows.columns else rows
            causes, whole = doubts.causes_by_trial(rows, tables.get(of)), doubts.causes_by_trial(of_all)
            by_cause: dict[tuple[str, bool], dict[str, doubts.Reason]] = {}
            for trial, reasons in causes.items():
                for cause, reason in reasons.items():
                    in_part = bool(of) or cause not in whole.get(trial, ())
                    by_cause.setdefault((cause, in_part), {})[str(trial)] = reason
            judged = f"{name} trials" if table in fitted else table.replace("_", " ")
            judged += f", in {table.replace('_', ' ')} alone" if of else ""
            for (cause, in_part), trials in by_cause.items():
                worst = max(trials, key=lambda trial: trials[trial].excess)
                known = doubts.CAUSES.get(cause) or Cause(cause, trials[worst].text, "")
                size, remedy = trials[worst].parts[1:]
                remedy = remedy[:1].lower() + remedy[1:] or known.otherwise or known.remedy
                size += f", most in {worst}" if size and len(trials) > 1 else ""
                limits = {column: limit for one in trials.values() for column, _, limit in one.beyond}
                about = cause, known.says, remedy, [*trials], [*map(str, causes)]
                where = judged + ", at single amplitudes alone" * (in_part and not of)
                yield finding("doubtful" + " in part" * in_part, where, *about, size, limits)


def causes_of_misfit(tables: Mapping[str, pl.DataFrame]) -> Iterator[dict[str, Any]]:
    """The component, or the late controller, that `prediction_causes.csv` names; or that the components of a joint and
    side do not predict the torque, and nothing alone explains it."""
    causes = tables.get("prediction_causes", pl.DataFrame(schema=["joint", "side"]))
    for rows in causes.partition_by("joint", "side", maintain_order=True):
        at = [pl.col(key).eq_missing(pl.lit(rows[key][0], pl.String)) for key in ("joint", "side")]
        trials = [*tables["prediction"].filter(*at, pl.col("VAF").is_not_null())["trial"]]
        is_late, said = pl.col("component").str.ends_with("_delay"), dict[str, tuple[str, str]]()
        late = rows.filter(is_late).to_dicts()
        if parts := rows.filter("named", ~is_late).to_dicts():
            as_if = " or ".join(f"{one['component']} were {off_said(one)}" for one in parts)
            remedy = "repeat the component trials, or look for what changed between them and the impedance trials"
            cause = f"component {' or '.join(one['component'] for one in parts)}"
            said[cause] = f"{AS_IF} {as_if} than in the component trials", remedy
        if any(row["named"] for row in late):
            angle, velocity = (f"{1e3 * row['change']:.2g} ms" for row in late)
            as_if = f"{AS_IF} the controller used angles of {angle} and velocities of {velocity} ago"
            said["late controller"] = as_if, "measure the delay of the loop and of its velocity filter, or lower it"
        left = max((row["left_without"] or 0.0 for row in late), default=0.0)
        if not said and left > LARGEST_MISFIT:
            own = tables["prediction"].filter(pl.col("trial").is_in(trials))
            K, B = (100 * float(np.median((own[f"{x}_measured"] / own[x]).to_numpy())) - 100 for x in "KB")
            what = f"K is {K:+.2g} % and B {B:+.2g} % off what they predict (medians), and no "
            remedy = (
                "check the calibration of both benches, and whether two parts changed between their trials and these"
            )
            said["components that do not predict"] = f"{what}single one, no delay and no gain explains it", remedy
        for cause, (what, remedy) in said.items():
            yield finding("doubtful", "predicted trials", cause, what, remedy, trials, trials)


def off_said(row: Mapping[str, Any]) -> str:
    """How far a component is off, as `9.8 % (± 0.4 % by the scatter of trials) less`."""
    off, half = (100 * one / abs(row["value"]) for one in (row["change"], 2 * row["change_se"]))
    return f"{abs(off):.2g} % (± {half:.1g} % by the scatter of trials) {'more' if off > 0 else 'less'}"


def unchecked_in(tables: Mapping[str, pl.DataFrame]) -> Iterator[dict[str, Any]]:
    """What could not be checked, by experiment; of a torque that may be late what that would do, over all trials."""
    for name, table in tables.items():
        if "not_checked" not in table.columns:
            continue
        found: dict[str, dict[str, str]] = {}
        of = "trial" if "trial" in table.columns else "group"
        for (trial,), rows in table.group_by(of, maintain_order=True):
            for what, why in doubts.not_checked_of(rows).items():
                found.setdefault(what, {})[str(trial)] = why
        for what, reasons in found.items():
            why = next(iter(reasons.values()))
            whole = [row for row in table.to_dicts() if doubts.of_whole_trial(row) and row["trial"] in reasons]
            if doubts.LATENESS in what and "change" not in why and whole and {"K", "B", "I"} <= set(table.columns):
                numbers = []
                for scale, symbol in ((1e-3, "K"), (1, "B"), (1e-3, "B"), (1, "I")):
                    values = [scale * row[symbol] for row in whole]
                    numbers.append(" to ".join(dict.fromkeys(map(significant, (min(values), max(values))))))
                why = why.partition(doubts.SIZED)[0] + doubts.size_of_lateness(*numbers)
            judged = [*table[of].unique(maintain_order=True)]
            judged_are = f"{name.replace('_', ' ').removesuffix(' groups')} {of}s"
            yield finding(doubts.unchecked_kind(what), judged_are, what, why, "", [*reasons], judged)


def findings_report(verdicts: pl.DataFrame, tables: Iterable[Path]) -> str:
    """The findings of a campaign for the end of a run, a line each; tables may be refusal records or not be there."""
    written = {path.stem: read_table(path) for path in tables if path.is_file() and not is_refused(path)}
    return "\n".join(one["line"] for one in findings(verdicts, written))


def exclusion_report(verdicts: pl.DataFrame, by_sheet: Mapping[str, str]) -> str:
    """Excluded trials with reasons, for the end of a run; those that fail the same check are one line."""
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
    """A line on trials whose files are `stored` though the sheet has them not, as after a renaming; empty without."""
    unknown = sorted({path.stem for path in stored} - set(trials))
    said = f"not in the sample sheet, and in no table or figure: {listing(unknown, 12)}; files of theirs are left below"
    return f"{said} the results; delete them, or enter the trials again" if unknown else ""
