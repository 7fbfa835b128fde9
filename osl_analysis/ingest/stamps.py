"""Time stamps of a topic's messages: where they are in the message, and the order of the messages by them.

Messages are sorted by their stamps; those of equal stamp keep the order in which they were logged. A message may come
late by up to `LATEST`; a larger step back means that the clock was set, and the log is refused. Messages of equal stamp
become one sample; a field that one message lacks is taken from another. If they contradict each other, the first one is
used, and the others count as lost. A log with more contradictions than the allowed share is refused. So is a log with
more repeated stamps within one channel, because its clock stands still. Stamps that repeat because they are rounded
to a sampling step or more are kept as they are. The counts are reported.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.formats.message_fields import Indices
from osl_analysis.formats.messages import Decoded

SECOND = 1_000_000_000
LATEST = SECOND  # by which a message may come after one of a later stamp [ns]
EMPTY_TICKS = 0.5  # of the messages that repeat a stamp: more ticks without one are no rounding
SET_BACK = 10  # messages in a row that fall among as many earlier ones
LAST_SECOND = 2**63 // SECOND - 1
PARTS = (("sec", "nanosec"), ("seconds", "nanos"), ("sec", "nsec"), ("secs", "nsecs"))
"""How ROS 2, protobuf, Foxglove's JSON and ROS 1 name the parts of a stamp."""


@dataclass(frozen=True)
class Ordering:
    """Counts from sorting the messages of a topic by their stamps."""

    late: int  # messages that came after one of a later stamp
    repeated: int  # messages that have the stamp of an earlier one
    contradicted: int  # messages that have the stamp of an earlier one and other values

    def report(self) -> dict[str, Any]:
        """The counts, for the provenance."""
        return asdict(self)

    def says(self, topic: str) -> list[str]:
        counts = {
            "came late and were put in the order of their stamps": self.late,
            "repeat a stamp and were joined to its first": self.repeated - self.contradicted,
            "contradict an earlier one of the same stamp and are lost": self.contradicted,
        }
        return [f"topic '{topic}': {count} messages {what}" for what, count in counts.items() if count]


def stamp_fields(field: str) -> list[tuple[str, str]]:
    """Paths at which a stamp's seconds and nanoseconds may stand."""
    return [(f"{field}.{seconds}", f"{field}.{nanoseconds}") for seconds, nanoseconds in PARTS]


def stamps_of(topic: str, decoded: Decoded, field: str) -> Indices:
    """Stamps [ns] from the messages' own field, (n,)."""
    for seconds, nanoseconds in stamp_fields(field):
        if decoded.present[seconds].any() and decoded.present[nanoseconds].any():
            break
    else:
        raise InputError(
            f"topic '{topic}' has no field '{field}' with seconds and nanoseconds; correct time.field in the source "
            "file, or write source: log"
        )
    lacking = int((~(decoded.present[seconds] & decoded.present[nanoseconds])).sum())
    if lacking:
        raise InputError(
            f"topic '{topic}': {lacking} of {decoded.log_time.size} messages have no '{field}'; write source: log"
        )
    whole = integers(topic, seconds, decoded.values[seconds], LAST_SECOND)
    return whole * SECOND + integers(topic, nanoseconds, decoded.values[nanoseconds], SECOND)


def log_times_of(topic: str, decoded: Decoded) -> Indices:
    """When the messages were logged [ns], (n,)."""
    if (decoded.log_time < 0).any():
        row = int(np.argmax(decoded.log_time < 0))
        raise InputError(
            f"topic '{topic}': message {row + 1} was logged at {int(decoded.log_time[row]) + 2**64} ns, which is not a "
            "time; write source: header, or record again"
        )
    return decoded.log_time


def integers(topic: str, path: str, values: np.ndarray[Any, Any], most: int) -> Indices:
    """Seconds or nanoseconds of stamps, which must be whole numbers of at most `most`."""
    wrong = (np.abs(values.astype(np.float64)) > most) | (values.dtype == bool)
    if values.dtype.kind not in "iu":
        wrong |= values != np.rint(values)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InputError(
            f"topic '{topic}': {path} is {values[row]} in message {row + 1}, which is not a time; write source: log"
        )
    return values.astype(np.int64)


def in_order(
    topic: str, table: pl.DataFrame, channel: NDArray[np.uint16], largest_loss: float, advice: str
) -> tuple[pl.DataFrame, Ordering]:
    """The topic's rows, given channel by channel in the order of recording, sorted by increasing `stamp` [ns].

    `channel` is the number of each row's channel, (n,); `advice` says what to do where the clock was set.
    """
    numbers = np.unique(channel)
    channels, late = len(numbers), 0
    for number in numbers:
        late += check_not_set(topic, table if channels == 1 else table.filter(channel == number), advice)
    stamp = table["stamp"].to_numpy()
    if (stamp[1:] > stamp[:-1]).all():
        return table, Ordering(0, 0, 0)
    once = table.group_by("stamp", maintain_order=True).agg(pl.all().drop_nulls().first()).sort("stamp")
    contradicted, most = contradictions(table, once), largest_loss * stamp.size
    repeats = int(table.is_duplicated().sum())
    if channels == 1 and not repeats and rounded(stamp):
        return table.sort("stamp", maintain_order=True), Ordering(late, 0, 0)
    standing = int(np.maximum(np.unique(stamp, return_counts=True)[1] - channels, 0).sum())
    if standing > most:
        raise InputError(
            f"topic {topic}: {standing} of {stamp.size} messages have the stamp of an earlier one; stamps must be "
            "their own: check the recorder's clock, or write source: log in the source file"
        )
    if contradicted > most:
        raise InputError(
            f"topic {topic}: {contradicted} of {stamp.size} messages have the stamp of an earlier one and other "
            "values; stamps must be their own: check the recorder's clock or the time source in the source file"
        )
    return once, Ordering(late, stamp.size - once.height, contradicted)


def rounded(stamp: Indices) -> bool:
    """Whether stamps [ns] repeat because they are rounded to a step that is not shorter than the sampling step.

    Every tick of the rounding then has a message, and none has two more than another. The messages are kept: the time
    base finds when they were sampled, as in a CSV log.
    """
    ticks, messages = np.unique(stamp, return_counts=True)
    if ticks.size < 2:
        return False
    step = int(np.diff(ticks).min())
    empty = (int(ticks[-1] - ticks[0]) // step + 1) - ticks.size
    inner = messages[1:-1]
    even = inner.size > 0 and int(inner.max()) - int(np.median(inner)) <= 1
    return bool(even and empty <= EMPTY_TICKS * (stamp.size - ticks.size))


def check_not_set(topic: str, table: pl.DataFrame, advice: str) -> int:
    """Refuse a clock that was set back, in one channel's rows; returns how many of them are merely late.

    It was set back by more than `LATEST`, or many messages in a row fall among those before. Messages that are merely
    late fill the gap that they left; those that repeat others do not count.
    """
    stamp = table["stamp"].to_numpy()
    if (np.diff(stamp) >= 0).all():
        return 0
    by = np.maximum.accumulate(stamp) - stamp
    if (by > LATEST).any():
        row = int(np.argmax(by > LATEST))
        raise InputError(
            f"topic {topic}: time goes back by {by[row] / SECOND:.6f} s at message {row + 1} of {stamp.size}; the "
            f"clock was set while recording: {advice}"
        )
    late = by > 0
    behind = late.copy()
    if behind.any():
        behind[behind] = ~table.is_duplicated().to_numpy()[behind]
    edges = np.flatnonzero(np.diff(np.concatenate([[0], behind.astype(np.int8), [0]])))
    for first, stop in (run for run in edges.reshape(-1, 2) if run[1] - run[0] >= SET_BACK):
        before = stamp[:first]
        if ((before >= stamp[first]) & (before <= stamp[stop - 1])).sum() >= SET_BACK:
            raise InputError(
                f"topic {topic}: time goes back from {before.max() / SECOND:.6f} s to {stamp[first] / SECOND:.6f} s at "
                f"message {first + 1} of {stamp.size}, and {stop - first} messages fall among those before; the clock "
                f"was set while recording: {advice}"
            )
    return int(late.sum())


def contradictions(table: pl.DataFrame, once: pl.DataFrame) -> int:
    """How many rows differ from the row that is kept for their stamp."""
    columns = [name for name in table.columns if name != "stamp"]
    beside = table.join(once, on="stamp", how="left", suffix=" kept", maintain_order="left")
    differs = [(pl.col(name) != pl.col(f"{name} kept")).fill_null(value=False) for name in columns]
    return int(beside.select(pl.any_horizontal(differs).sum()).item())


def joined_on_stamp(tables: Sequence[pl.DataFrame]) -> pl.DataFrame:
    """One table with a row per stamp of any of the tables, which are sorted by it.

    Where stamps are rounded and equal, the tables have rows of their own.
    """
    if len(tables) == 1:
        return tables[0].clone()
    if any((np.diff(table["stamp"].to_numpy()) == 0).any() for table in tables):
        return pl.concat(tables, how="diagonal").sort("stamp", maintain_order=True)
    stamps = [table["stamp"].to_numpy() for table in tables]
    every = np.sort(np.concatenate(stamps), kind="stable")  # fast, as the stamps of each table rise
    every = every[np.append(True, every[1:] != every[:-1])]
    columns = [pl.Series("stamp", every)]
    for table, stamp in zip(tables, stamps, strict=True):
        rows = np.full(every.size, -1)
        rows[np.searchsorted(every, stamp)] = np.arange(stamp.size)
        taken = pl.Series(rows).set(pl.Series(rows < 0), None)
        columns += [column.gather(taken) for column in table.drop("stamp")]
    return pl.DataFrame(columns)
