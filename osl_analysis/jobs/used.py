"""Which of its inputs a job uses: not those that were refused, nor those of excluded trials."""

from collections.abc import Collection, Iterable, Mapping
from itertools import chain
from pathlib import Path

from osl_analysis.errors import InputError
from osl_analysis.judge.recording_checks import HOW_TO_USE
from osl_analysis.table import NotAnalysed, not_analysed

Files = str | list[str]
"""An input of a job: a file, or a list of files."""


def without_missing(
    inputs: Mapping[str, Files],
) -> tuple[dict[str, Files], list[NotAnalysed], list[NotAnalysed]]:
    """Take the refusals out of the inputs of a job.

    Returns the inputs that are left, the causes of all that was removed, and those of them that
    keep the job from running. A trial with a refusal in one list is taken out of every list. The
    job cannot run if a refusal stands for a single input, if its input `trial` is such a trial, or
    if a list loses everything; beside an input `trial` lists may become empty.
    """
    causes_of = {}
    for file in chain(*lists_of(inputs).values()):
        if causes := not_analysed(file):
            causes_of[Path(file).stem] = causes
    usable = without_trials(inputs, causes_of)

    singles = [file for file in inputs.values() if isinstance(file, str)]
    missing = [*chain(*map(not_analysed, singles))]
    for trial in needed_trials(inputs, causes_of):
        missing += causes_of[trial]
    refused = [*chain(*causes_of.values()), *missing]
    return usable, list(dict.fromkeys(refused)), list(dict.fromkeys(missing))


def without_excluded(inputs: Mapping[str, Files], excluded: Collection[str]) -> dict[str, Files]:
    """Take the files of excluded trials out of the lists of a job.

    Raises
    ------
    InputError
        The input `trial` is excluded, or a list loses everything.
    """
    lost = needed_trials(inputs, excluded)
    if lost:
        raise InputError(
            f"quality control excludes every trial that is needed here: {', '.join(lost)};"
            f" {HOW_TO_USE}; the reasons stand in tables/excluded.csv"
        )
    return without_trials(inputs, excluded)


def lists_of(inputs: Mapping[str, Files]) -> dict[str, list[str]]:
    return {name: files for name, files in inputs.items() if isinstance(files, list)}


def without_trials(inputs: Mapping[str, Files], trials: Collection[str]) -> dict[str, Files]:
    """The inputs, without the files of some trials in their lists."""
    left = dict(inputs)
    for name, files in lists_of(inputs).items():
        left[name] = [file for file in files if Path(file).stem not in trials]
    return left


def needed_trials(inputs: Mapping[str, Files], removed: Collection[str]) -> list[str]:
    """Those of the removed trials without which the job cannot run, in the order of their names."""
    trial = inputs.get("trial")
    if isinstance(trial, str):
        return sorted(stems([trial]).intersection(removed))
    needed: set[str] = set()
    for files in lists_of(inputs).values():
        trials = stems(files)
        if trials.issubset(removed):
            needed |= trials
    return sorted(needed)


def stems(files: Iterable[str]) -> set[str]:
    return {Path(file).stem for file in files}
