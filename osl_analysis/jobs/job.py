# SPDX-License-Identifier: Apache-2.0
"""A job: one call of a function by a rule, and the files around it."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, is_dataclass, replace
from pathlib import Path
from typing import Any

Files = Any
"""An input of a job: a file (`Path`), files in their order (`list`), files by name (`dict`), an
optional file that is not there (None), or a dataclass whose fields are such."""


def listed(files: Files) -> list[Path]:
    """The files of an input."""
    if files is None:
        return []
    if isinstance(files, Path):
        return [files]
    if isinstance(files, list):
        return files
    by_name = files if isinstance(files, Mapping) else vars(files)
    return [file for part in by_name.values() for file in listed(part)]


def as_paths(files: Any) -> Files:
    """Files as Snakemake has them in a `run:` block, as plain paths, which a worker can be sent."""
    if files is None:
        return None
    if isinstance(files, str | Path):
        return Path(files)
    if isinstance(files, Mapping):
        return {name: Path(file) for name, file in files.items()}
    if is_dataclass(files):
        paths = {name: as_paths(part) for name, part in vars(files).items()}
        return replace(files, **paths)  # type: ignore[type-var]
    return [Path(file) for file in files]


@dataclass(frozen=True)
class TrialFiles:
    """The trial that a job is of, and the files of it that the job reads: they are named where
    memory is short, and one that cannot be opened refuses the trial."""

    name: str = ""  # empty for a job over several trials
    files: Sequence[Path] = ()


@dataclass(frozen=True)
class LeftOut:
    """The trials without which a job is done, and what its function is told of them."""

    excluded: Collection[str] = ()  # by quality control: they are taken out of lists of inputs
    argument: str = ""  # of the function, which gets the causes of what was refused; empty: none
    also_of: Sequence[Path] = ()  # files that the function does not read, whose causes it gets
    is_called_anyway: bool = False  # also where a single input, or all of a list, was refused


@dataclass(frozen=True)
class Job:
    """A call `function(**inputs, **arguments)`.

    Attributes
    ----------
    function : callable
        Of a module: workers are told its name. It writes its outputs, or returns a table, which the
        job writes to the first of them.
    outputs : Sequence of Path
        They hold the reason where the input is at fault.
    log : Path
        It says how the job ended.
    inputs : Mapping of str to Files
        Results of earlier jobs: refused and excluded trials are taken out of them.
    arguments : Mapping
        All other arguments.
    left_out : LeftOut
    trial : TrialFiles
    data : str
        Whether the recordings are simulated or measured, as tables say.
    parallel_jobs : int
        Jobs that share the memory of the machine.
    simulates : bool
        Whether its outputs are recordings, or their sheet: these hold no reasons.
    """

    function: Callable[..., Any]
    outputs: Sequence[Path]
    log: Path
    inputs: Mapping[str, Files] = field(default_factory=dict)
    arguments: Mapping[str, Any] = field(default_factory=dict)
    left_out: LeftOut = LeftOut()
    trial: TrialFiles = TrialFiles()
    data: str = ""
    parallel_jobs: int = 1
    simulates: bool = False

    @property
    def name(self) -> str:
        """The full name of its function."""
        return f"{self.function.__module__}.{self.function.__qualname__}"
