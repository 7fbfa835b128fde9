"""Several logs of one recorder as one: a clamped actuator has one for each of its currents."""

import re
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.ingest.conversion import Converted
from osl_analysis.trial import OWN_CLOCKS

PATTERN = "*"  # stands for any text in the name of a log
PAUSE_S = 1.0  # s between logs whose clocks do not tell it; longer than any gap that is bridged


def matching_files(path: Path) -> list[Path]:
    """The files that a name with `*` stands for, 2 before 10; a name of one file has none."""
    if PATTERN not in path.name or path.exists():
        return []

    def key(file: Path) -> list[tuple[float, str]]:
        parts = re.split(r"(\d+)", file.name)
        return [(float(part), "") if part.isdigit() else (-1.0, part) for part in parts]

    return sorted(path.parent.glob(path.name), key=key)


def join_logs(logs: Sequence[Converted], names: Sequence[str]) -> Converted:
    """Put logs behind one another.

    Their clocks tell when each was recorded, unless each counts from its own start. Then they stand
    in the order of their names, a second apart.

    Parameters
    ----------
    logs : sequence of Converted
        By the same source file.
    names : sequence of str
        Of their files.

    Raises
    ------
    InputError
        They have other columns.
    """
    if len(logs) == 1:
        return logs[0]
    columns = logs[0].samples.columns
    for log, name in zip(logs, names, strict=True):
        if log.samples.columns != columns:
            raise InputError(
                f"{name} has other columns than {names[0]}; join logs of one source file alone"
            )
    times = [log.samples["time"].to_numpy() for log in logs]
    lengths = np.array([time[-1] - time[0] for time in times])
    begins = np.array([np.nan if log.begins_s is None else log.begins_s for log in logs])
    order = np.argsort(begins, kind="stable")
    is_one_clock = bool(
        np.isfinite(begins).all()
        and all(begins[k] + lengths[k] < begins[after] for k, after in pairwise(order))
    )
    if not is_one_clock:
        order = np.arange(len(logs))
        begins = np.append(0.0, np.cumsum(lengths[:-1] + PAUSE_S))
    first = begins[order[0]]
    parts = [
        logs[k].samples.with_columns(time=pl.Series(times[k] - times[k][0] + begins[k] - first))
        for k in order
    ]
    warnings = list(warnings_of(logs, names))
    facts = {**logs[0].facts, "joined": [names[k] for k in order]}
    if not is_one_clock:
        facts[OWN_CLOCKS] = True
        warnings.append("the clocks of its logs begin anew: they stand in the order of their names")
    damaged = [log.losses for log in logs if log.losses]
    most_lost = max(damaged, key=lambda losses: losses.get("share_lost") or 0.0, default={})
    return Converted(pl.concat(parts), logs[0].origins, facts, warnings, most_lost)


def warnings_of(logs: Sequence[Converted], names: Sequence[str]) -> Iterator[str]:
    """Each warning of the logs once, with the first log that has it."""
    told: set[str] = set()
    for log, name in zip(logs, names, strict=True):
        for warning in log.warnings:
            text = warning.removeprefix(f"{name}: ")
            if text not in told:
                told.add(text)
                yield warning
