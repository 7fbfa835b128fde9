"""Which of its inputs a job uses: not those that were refused, nor those of excluded trials."""

from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from osl_analysis.errors import InputError
from osl_analysis.judge.exclusions import HOW_TO_USE
from osl_analysis.status import NotAnalysed, not_analysed

Files = str | list[str] | Mapping[str, str]
"""An input of a job: a file, a list of files, or files by trial or table."""


class Usable(NamedTuple):
    """What is left of the inputs of a job."""

    inputs: dict[str, Files]  # without what was not analysed
    refused: tuple[NotAnalysed, ...]  # causes of all that was removed
    missing: tuple[NotAnalysed, ...]  # those of them that keep the job from running


def without_missing(inputs: Mapping[str, Files]) -> Usable:
    """Take the refusals out of the inputs of a job.

    A trial with a refusal in one list is taken out of every list. The job cannot run if a refusal
    stands for a single input, if its input `trial` is such a trial, or if a list loses everything;
    beside an input `trial` lists may become empty. Files by name are taken out one by one.
    """
    lists = {name: files for name, files in inputs.items() if isinstance(files, list)}
    by_name = {name: files for name, files in inputs.items() if isinstance(files, Mapping)}
    single = [file for file in inputs.values() if isinstance(file, str)]

    refused_by_stem = {}
    for file in chain(*lists.values()):
        if reasons := not_analysed(file):
            refused_by_stem[Path(file).stem] = reasons
    causes = [*chain(*refused_by_stem.values())]
    missing = [*chain(*map(not_analysed, single))]
    if isinstance(trial := inputs.get("trial"), str):
        missing += refused_by_stem.get(Path(trial).stem, ())

    usable = dict(inputs)
    for name, files in lists.items():
        not_refused = [file for file in files if Path(file).stem not in refused_by_stem]
        usable[name] = not_refused
        if not not_refused and "trial" not in inputs:
            missing += chain(*(refused_by_stem[Path(file).stem] for file in files))
    for name, named_files in by_name.items():
        usable[name] = {key: file for key, file in named_files.items() if not not_analysed(file)}
        causes += chain(*map(not_analysed, named_files.values()))
    return Usable(usable, tuple(dict.fromkeys([*causes, *missing])), tuple(dict.fromkeys(missing)))


def without_excluded(inputs: Mapping[str, Files], excluded: Sequence[str]) -> dict[str, Files]:
    """Take the files of excluded trials out of the lists of a job.

    Raises
    ------
    InputError
        The input `trial` is excluded, or a list loses everything.
    """
    lists = {name: files for name, files in inputs.items() if isinstance(files, list)}
    not_excluded = {
        name: [file for file in files if Path(file).stem not in excluded]
        for name, files in lists.items()
    }
    trial = inputs.get("trial")
    lost = {Path(trial).stem} & set(excluded) if isinstance(trial, str) else set()
    for name, files in lists.items():
        if files and not not_excluded[name] and trial is None:
            lost |= {Path(file).stem for file in files}
    if lost:
        raise InputError(
            f"quality control excludes every trial that is needed here: {', '.join(sorted(lost))};"
            f" {HOW_TO_USE}; the reasons stand in tables/excluded.csv"
        )
    return {**inputs, **not_excluded}
