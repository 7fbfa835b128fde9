"""Trials that are not used in any result of several trials: those that quality control excludes, and those without a
result of their own (`refusal.py`). Both are always listed.
"""

import csv
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from osl_analysis.errors import InputError, listing
from osl_analysis.refusal import Refusal, distinct, is_refused, read_refusals

REMEDY = "record again, give a reason under `exclude` in the sample sheet, or name the check under `accept`"
TRUNCATED = "truncated"
"""Check of quality control that fails where the end of a log is missing."""
JUDGES = ("quality", "fitted")
"""Inputs that only tell which trials are used: verdicts of quality control, and other results of the same trials."""


@dataclass(frozen=True)
class Usable:
    """The inputs of a job without refusal records.

    inputs: what is left, by name.
    refused: the causes of everything that was removed.
    missing: the causes without which the job cannot run; empty if it can.
    """

    inputs: Mapping[str, Any]
    refused: tuple[Refusal, ...] = ()
    missing: tuple[Refusal, ...] = ()


def without_refused(inputs: Mapping[str, Any], unnamed: Sequence[str] = ()) -> Usable:
    """The named inputs of a job without refusal records.

    A trial with a record in one list, or among the verdicts in `quality` or the results in `fitted`, is removed from
    every list. The job cannot run if a record stands for a single input or for one of the `unnamed` files, if the input
    `trial` is such a trial, or if nothing is left of a list; beside an input `trial`, lists may become empty. Lists by
    name are handed over as they are.
    """
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
    return Usable({**inputs, **kept}, distinct([*causes, *missing]), distinct(missing))


def verdicts(quality: Iterable[Path]) -> Iterator[dict[str, str]]:
    """The rows of the quality tables of single trials."""
    for path in quality:
        with path.open(newline="", encoding="utf-8") as file:
            yield from csv.DictReader(file)


def excluded(quality: Iterable[Path]) -> dict[str, str]:
    """Excluded trials and why, from the quality tables of single trials."""
    reasons: dict[str, str] = {}
    for row in verdicts(quality):
        if row["verdict"] == "exclude":
            said = f"{row['check']} {float(row['value']):.4g} {row['unit']}, threshold {row['threshold']}"
            said += f": {row['remark'].replace('; ', ', ')}" if row["remark"] else ""
            reasons[row["trial"]] = "; ".join(filter(None, [reasons.get(row["trial"]), said]))
    return reasons


def without_excluded(inputs: Mapping[str, Any]) -> dict[str, Any]:
    """The named inputs of a job without the files of excluded trials; the input `quality` has the verdicts.

    Files with the name of an excluded trial are removed from every list. The inputs `JUDGES` are not passed on.

    Raises
    ------
    InputError
        The input `trial` is excluded, or all trials of the lists are excluded.
    """
    quality = [Path(path) for path in inputs.get("quality", ())]
    judged, reasons = {path.stem for path in quality}, excluded(quality)
    lists = {name: files for name, files in inputs.items() if isinstance(files, list) and name not in JUDGES}
    needed = {Path(file).stem for files in lists.values() for file in files} & judged
    single = {Path(str(inputs.get("trial"))).stem} & judged
    if single & set(reasons) or (needed | single and needed | single <= set(reasons)):
        refuse({trial: reasons[trial] for trial in sorted(single or needed)})
    kept = {name: [file for file in files if Path(file).stem not in reasons] for name, files in lists.items()}
    return {name: kept.get(name, value) for name, value in inputs.items() if name not in JUDGES}


def refuse(reasons: Mapping[str, str]) -> NoReturn:
    """Raise an error: all trials that a job needs are excluded. The message has the first reasons."""
    why = "; ".join(f"{trial} ({reason})" for trial, reason in list(reasons.items())[:3])
    raise InputError(f"quality control excludes every trial that is needed here: {why}; {REMEDY}")


def exclusion_report(quality: Iterable[Path], by_sheet: Mapping[str, str]) -> str:
    """Excluded trials with reasons, for the end of a run, also of a failed run; empty without excluded trials.

    `by_sheet` has the reasons in the sample sheet. Trials without a quality table are ignored.
    """
    reasons = excluded(path for path in quality if path.is_file() and not is_refused(path))
    judged = [f"excluded from tables and figures by quality control: {trial} ({why})" for trial, why in reasons.items()]
    stated = [f"excluded by the sample sheet: {trial} ({why})" for trial, why in by_sheet.items()]
    return "\n".join([*stated, *judged, *([f"to change that: {REMEDY}"] if judged else [])])


def left_behind_report(stored: Iterable[Path], trials: Collection[str]) -> str:
    """A line on trials that are not in the sample sheet, as after a renaming, whose files are still among the results.

    `stored` are the files of trials there, `trials` all those of the sheet. Empty without such files.
    """
    unknown = sorted({path.stem for path in stored} - set(trials))
    if not unknown:
        return ""
    return (
        f"not in the sample sheet, and in no table or figure: {listing(unknown, 12)}; files of theirs are left "
        "below the results; delete them, or enter the trials again"
    )


def truncation_report(quality: Iterable[Path], recordings: Mapping[str, Sequence[str]]) -> str:
    """A line per trial that is used although the end of its recording is missing, for the end of a run.

    `recordings` has the raw files of every trial. A trial that the sheet accepts with this is not named.
    """
    read = verdicts(path for path in quality if path.is_file() and not is_refused(path))
    cut = [row["trial"] for row in read if row["check"] == TRUNCATED and row["verdict"] == "flag"]
    return "\n".join(
        f"warning: trial {trial}, file {', '.join(recordings.get(trial, ()))}: the end of the log is missing, and what "
        "is there is analysed; copy or record it again, give a reason under `exclude` in the sample sheet, or write "
        f"`{TRUNCATED}` under `accept` there"
        for trial in cut
    )
