"""Rows of a recording that are missing, joined, wrong, or stand twice. Ingest finds them once and
notes them in the provenance: what explains rows is told before any physical cause of a misfit."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from itertools import compress, pairwise, zip_longest
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.ingest.guard import EVEN, Leaps, LostRows, find_leaps, lost_rows
from osl_analysis.trial import Array, Trial

KEY = "row_faults"  # of the provenance
LONGEST_FAILURE = 50  # rows after which a channel that leapt is back, if a sensor failed
BESIDE_LEAP_S = 0.2  # left out at each side of a leap, which the filter spreads
LONGEST_GAP_S = 0.5  # of those that are bridged (`time_base.longest_gap_s`)
SHORTEST_PART_S = 2.0  # of a recording that is analysed without its leaps
FEWEST_REPEATED = 10  # rows of a block that stands twice


@dataclass(frozen=True)
class RowFaults:
    """Where rows of angle and torque are not what a sensor gives one after another."""

    lost: LostRows | None
    leaps: tuple[Leaps, ...]  # by channel; of those that are guarded and in the trial

    @property
    def count(self) -> int:
        """The largest number of places in a channel."""
        return self.lost.count if self.lost else max((one.count for one in self.leaps), default=0)

    @property
    def failures(self) -> list[tuple[str, int, int, float]]:
        """Channel, first row, row in which it is back, and time [s] of short wrong stretches."""
        return [
            (one.column, first, back, time)
            for one in self.leaps
            for (first, back), time in zip(pairwise(one.rows), one.times, strict=False)
            if back - first <= LONGEST_FAILURE
        ]

    @property
    def breaks(self) -> list[tuple[list[str], int, float]]:
        """Channels, row and time [s] of the places behind which a channel goes on elsewhere."""
        found: list[tuple[list[str], int, float]] = []
        failed = {(column, row) for column, *rows, _ in self.failures for row in rows}
        places = sorted(
            (row, time, one.column)
            for one in self.leaps
            for row, time in zip(one.rows, one.times, strict=True)
            if (one.column, row) not in failed
        )
        for row, time, column in places:
            if found and row - found[-1][1] <= 2:
                found[-1][0].append(column)
            else:
                found.append(([column], row, time))
        return found

    @property
    def texts(self) -> list[str]:
        """What is wrong, by row, for messages."""
        texts = [self.lost.text] if self.lost else []
        if self.breaks:
            columns, row, time = self.breaks[0]
            leaps, goes = ("leaps", "goes") if len(columns) == 1 else ("leap", "go")
            text = f"{' and '.join(sorted(columns))} {leaps} in row {row} ({time:.3f} s)"
            frozen = self.frozen_before(row)
            if frozen:
                text = f"{columns[0]} repeats one value in {frozen} rows before row {row}"
                text += f" ({time:.3f} s): it is frozen, as with a loose cable"
            elif row <= LONGEST_FAILURE:
                text += ": the rows before it are of another time"
            elif len(self.breaks) == 1:
                text += f" and {goes} on elsewhere: rows were lost, another trial joined, or a"
                text += " sensor failed"
            else:
                text += f" and {len(self.breaks) - 1} more, and {goes} on elsewhere: rows were lost"
            texts.append(text)
        if self.failures:
            column, first, back, time = self.failures[0]
            texts.append(
                f"{column} leaps in row {first} ({time:.3f} s) and is back in row {back}: values of"
                " no sensor"
            )
        return texts

    def frozen_before(self, row: int) -> int:
        """The number of rows in which a channel stands before it leaps in a row."""
        counts = [
            count
            for one in self.leaps
            for at, count in zip(one.rows, one.frozen, strict=False)
            if at == row
        ]
        return max(counts, default=0)

    def part(self, trial: Trial) -> bool:
        """Whether a trial is to be analysed in parts: rows are wrong, or lie in a gap."""
        return self.count > 0 or len(self.windows(trial)) > 1

    def windows(self, trial: Trial) -> list[tuple[float, float]]:
        """The parts of a trial between the leaps and the gaps, from and to [s] after its start."""
        time = trial.samples["time"].to_numpy() - trial.samples["time"][0]
        start = float(trial.samples["time"][0])
        lost = self.lost.times if self.lost else ()
        step = float(time[-1]) / max(len(time) - 1, 1)
        borders = [(at - start - BESIDE_LEAP_S, at - start + BESIDE_LEAP_S) for at in lost]
        for one in self.leaps:
            for at, count in zip_longest(one.times, one.frozen, fillvalue=0):
                first = at - start - count * step
                borders.append((first - BESIDE_LEAP_S, at - start + BESIDE_LEAP_S))
        gaps = np.flatnonzero(np.diff(time) > LONGEST_GAP_S).tolist()
        borders += [(float(time[row]), float(time[row + 1])) for row in gaps]
        ends = [0.0, *(at for border in sorted(borders) for at in border), float(time[-1])]
        parts = list(zip(ends[::2], ends[1::2], strict=True))
        return [(first, last) for first, last in parts if last - first >= SHORTEST_PART_S]


def find_row_faults(trial: Trial) -> RowFaults:
    """Look for them in the angle and the torque of a joint, which it moves both smoothly; of an
    actuator alone in its angle, since its torque follows steps of the current."""
    guarded = ("theta", "torque") if "theta" in trial.columns else ("theta_m", "torque")
    columns = [column for column in guarded if column in trial.columns]
    leaps = tuple(find_leaps(column, *trial.arrays(column)) for column in columns)
    has_angle = guarded[0] in columns
    return RowFaults(lost_rows(*trial.arrays(guarded[0])) if has_angle else None, leaps)


def row_faults_of(trial: Trial) -> RowFaults:
    """The faults that ingest noted, as far as the trial still has their rows."""
    noted: Mapping[str, Any] | None = trial.provenance.get(KEY)
    if noted is None:
        return find_row_faults(trial)
    time = trial.samples["time"].to_numpy()

    def kept(fault: Mapping[str, Any]) -> dict[str, Any]:
        times = fault["times"]
        is_kept = np.isin(times, time).tolist() if times else []  # which sorts all stamps
        by_place = {
            name: tuple(compress(values, is_kept))
            for name, values in fault.items()
            if name in ("rows", "times", "frozen")
        }
        return {**fault, **by_place}

    lost = LostRows(**kept(noted["lost"])) if noted["lost"] else None
    leaps = tuple(Leaps(**kept(each)) for each in noted["leaps"])
    return RowFaults(lost if lost and lost.count else None, leaps)


def with_row_faults(trial: Trial) -> Trial:
    """The trial without blocks of rows that stand twice, and with a note and a warning of what else
    is wrong with its rows."""
    faults = find_row_faults(trial)
    warnings: list[str] = []
    for first, count in repeated_blocks(trial, faults):
        warnings.append(
            f"rows {first + 1} to {first + count} repeat the {count} rows before them and are left"
            " out, and later rows are numbered anew"
        )
        rows = np.delete(np.arange(len(trial.samples)), slice(first, first + count))
        time = trial.samples["time"][: len(rows)]
        samples = trial.samples[rows].with_columns(time)
        trial = replace(trial, samples=samples, clocks={})
    if warnings:
        faults = find_row_faults(trial)
    warnings += faults.texts
    told = [*trial.provenance.get("warnings", []), *warnings]
    noted = asdict(faults, dict_factory=with_lists)
    return replace(trial, provenance={**trial.provenance, "warnings": told, KEY: noted})


def with_lists(fields: list[tuple[str, Any]]) -> dict[str, Any]:
    """Fields by name, as JSON has them."""
    return {name: list(value) if isinstance(value, tuple) else value for name, value in fields}


def repeated_blocks(trial: Trial, faults: RowFaults) -> Iterator[tuple[int, int]]:
    """First row, from 0, and length of blocks that repeat the rows before them, the last one first.
    They begin where a channel leaps, and the stamps were numbered after that."""
    if not faults.breaks:
        return
    steps = np.diff(trial.samples["time"].to_numpy())
    samples = trial.samples.drop("time")
    has_gaps = any(column.has_nulls() for column in samples)
    if has_gaps or np.abs(steps - steps[0]).max() > EVEN * steps[0]:
        return
    values = samples.select(pl.all().cast(pl.Float64)).to_numpy()
    for _, row, _ in reversed(faults.breaks):
        for first in range(row - 2, row + 1):
            count = repeated_rows(values, first)
            if count >= FEWEST_REPEATED:
                yield first, count
                break


def repeated_rows(values: Array, first: int) -> int:
    """The number of rows of a table (n, k) from `first` on that repeat those right before it; 0 if
    none do."""
    if not 0 < first < len(values):
        return 0
    is_same = (values[:first] == values[first]).all(axis=1)
    for place in np.flatnonzero(is_same)[::-1].tolist():
        count = first - place
        if not np.array_equal(values[first : first + count], values[place:first]):
            continue
        goes_on = np.array_equal(values[first + count :][:1], values[first:][:1])
        came_before = place > 0 and np.array_equal(values[place - 1], values[first - 1])
        return 0 if goes_on or came_before else count  # a motion that repeats itself
    return 0
