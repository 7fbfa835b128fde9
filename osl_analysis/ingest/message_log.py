"""Logs of messages by topic, in MCAP or a bag of ROS, as canonical columns, in the order of their stamps.

Messages of equal stamp keep the order in which they were logged. A message may come late by up to `LATEST`; a larger
step back means that the clock was set, and the log is refused. Messages of equal stamp become one sample; a field that
one message lacks is taken from another. If they contradict each other, the first one is used, and the others count as
lost. A log with more contradictions than the allowed share is refused. So is a log with more repeated stamps within one
channel, because its clock stands still. Stamps that repeat because they are rounded to a sampling step or more are kept
as they are. The counts are reported.
"""

from collections import defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.formats.mcap import read_mcap
from osl_analysis.formats.message_fields import Indices
from osl_analysis.formats.messages import Decoded, MessageFile, RefusedFileError, WrongFieldError, decode_topics
from osl_analysis.formats.rosbag import read_rosbag1, read_rosbag2, siblings
from osl_analysis.ingest.recording import LEVEL_UNIT, Recording, canonical_series, checked_numbers
from osl_analysis.ingest.source import Channel, Source
from osl_analysis.signals import runs
from osl_analysis.trial import Array, counter_column, unit_of

SECOND = 1_000_000_000
FILES: Mapping[str, Callable[[Path], MessageFile]] = {
    "mcap": read_mcap,
    "rosbag1": read_rosbag1,
    "rosbag2": read_rosbag2,
}


def read_message_log(path: Path, source: Source) -> Recording:
    """The columns that the source file maps, in SI units; time [s] counts from the first stamp.

    Topics with different stamps have rows of their own, null in the columns of the other topics. Nothing is
    interpolated or held. The losses of the file are in the facts under `damage` (`formats/messages.py`).
    Refused is what cannot be decoded, a loss above `source.largest_loss`, a value that is infinite, and stamps that
    contradict each other or go back.
    """
    file = FILES[source.format](path)
    if source.format == "mcap" and (remark := siblings(path)[1]):
        file.damage.remarks.append(remark)
    by_topic: dict[str, dict[str, Channel]] = defaultdict(dict)
    for column, channel in source.channels.items():
        by_topic[channel.topic][column] = channel
    decoded = decode_wanted(file, by_topic, source)
    tables = {topic: read_topic(topic, by_topic[topic], decoded[topic], source) for topic in decoded}
    joined = joined_on_stamp([table for table, _ in tables.values()])
    missing = {column: int(joined[column].is_nan().sum()) for column in source.channels}
    start, stamp = int(joined["stamp"][0]), str(source.time.field if source.time.source == "header" else "log")
    time = ((joined.drop_in_place("stamp") - start) / SECOND).alias("time")
    facts = {
        "time": {"source": stamp, "stamps": source.time.stamps, "start_ns": start},
        "rates_hz": {topic: median_rate(table["stamp"].to_numpy(), SECOND) for topic, (table, _) in tables.items()},
        "decoding": {topic: one.how for topic, one in decoded.items()},
        "stamps": {topic: asdict(order) for topic, (_, order) in tables.items()},
        "missing": missing,
        "damage": file.damage.report({topic: file.channels_of(topic) for topic in by_topic}),
    }
    columns = {column: channel.origin(column) for column, channel in source.channels.items()}
    remarks = file.damage.all_remarks()
    remarks += [text for topic, (_, order) in tables.items() for text in order.says(topic)]
    for topic, one in decoded.items():
        for path_of_field in dict.fromkeys(channel.field for channel in by_topic[topic].values()):
            there = one.present[path_of_field]
            if not there.all():
                count = f"{int((~there).sum())} of {there.size} messages have no value in field '{path_of_field}'"
                remarks.append(f"topic '{topic}': {count}, first message {int(np.argmin(there)) + 1}")
    remarks += [f"{column} is NaN in {n} of {len(joined)} rows" for column, n in missing.items() if n]
    return Recording(pl.DataFrame([time, *joined]), columns, facts, [f"{path.name}: {remark}" for remark in remarks])


def median_rate(stamps: Array | Indices, second: float = 1.0) -> float | None:
    """Median sampling rate [Hz] of stamps (n,), of which `second` are a second; None for a single row, or if most rows
    repeat a stamp."""
    step = float(np.median(np.diff(stamps))) if stamps.size > 1 else 0.0
    return second / step if step > 0 else None


def decode_wanted(
    file: MessageFile, by_topic: Mapping[str, Mapping[str, Channel]], source: Source
) -> dict[str, Decoded]:
    """The fields of each topic and of its stamp; a file that has lost too much is refused."""
    stamps = [name for pair in stamp_fields(str(source.time.field)) for name in pair]
    first, wanted = stamps if source.time.source == "header" else [], {}
    for topic, channels in by_topic.items():
        named = (name for channel in channels.values() for name in (channel.field, channel.counter) if name)
        wanted[topic] = [*dict.fromkeys([*first, *named])]
    try:
        decoded = decode_topics(file, wanted, optional=stamps)
    except (RefusedFileError, WrongFieldError):
        raise
    except InputError as error:
        check_loss(file, by_topic, source.largest_loss)  # if too much is lost, that is the reason
        if file.damage.remarks:
            reason, semicolon, remedy = str(error).rpartition("; ")
            remarks = f" ({', '.join(file.damage.all_remarks())})"
            raise InputError(f"{reason}{remarks}; {remedy}" if semicolon else f"{error}{remarks}") from error
        raise
    check_loss(file, by_topic, source.largest_loss)
    return decoded


def check_loss(file: MessageFile, topics: Collection[str], most: float) -> None:
    """Refuse a file that has lost a larger share of a topic than allowed."""
    for topic in topics:
        channels = file.channels_of(topic)
        share = file.damage.share_lost(channels or None)
        if share > most:
            misfits = sum(file.damage.misfits[channel] for channel in channels)
            are_all = misfits == file.damage.messages_lost(channels)
            what = "messages that cannot be used" if are_all else f"damaged or incomplete {file.kind}"
            raise InputError(
                f"{what}: {100 * share:.3g} % of topic '{topic}' is lost, at most "
                f"{100 * most:.3g} % may be (largest_loss in the source file): "
                f"{'; '.join(file.damage.all_remarks())}; record again"
                f"{', or map another field' * are_all}"
            )


@dataclass(frozen=True)
class Ordering:
    """Counts from sorting the messages of a topic by their stamps."""

    late: int = 0  # messages that came after one of a later stamp
    repeated: int = 0  # messages that have the stamp of an earlier one
    contradicted: int = 0  # messages that have the stamp of an earlier one and other values

    def says(self, topic: str) -> list[str]:
        counts = {
            "came late and were put in the order of their stamps": self.late,
            "repeat a stamp and were joined to its first": self.repeated - self.contradicted,
            "contradict an earlier one of the same stamp and are lost": self.contradicted,
        }
        return [f"topic '{topic}': {count} messages {what}" for what, count in counts.items() if count]


def read_topic(
    topic: str, channels: Mapping[str, Channel], decoded: Decoded, source: Source
) -> tuple[pl.DataFrame, Ordering]:
    """Stamps [ns] and columns of one topic in the order of the stamps, and counts of the sorting."""
    logged, number, from_header = decoded.log_time, decoded.channel, source.time.source == "header"
    if not from_header and (logged < 0).any():
        row = int(np.argmax(logged < 0))
        raise InputError(
            f"topic '{topic}': message {row + 1} was logged at {int(logged[row]) + 2**64} ns, which is not a time; "
            "write source: header, or record again"
        )
    stamp = stamps_of(topic, decoded, str(source.time.field)) if from_header else logged
    counters = [
        pl.Series(counter_column(column), counts_of_samples(topic, channel.counter, decoded))
        for column, channel in channels.items()
        if channel.counter
    ]
    time, columns = (stamp - stamp[0]) / SECOND, []
    for column, channel in channels.items():
        values, present = decoded.values[channel.field], decoded.present[channel.field]
        if values.dtype == bool and unit_of(column) != LEVEL_UNIT:
            row = int(np.argmax(present))
            raise WrongFieldError(
                f"topic '{topic}': field '{channel.field}' is {str(bool(values[row])).lower()} in message "
                f"{row + 1}, a truth value and no number in {unit_of(column)}; name a number as `field` in the source "
                "file"
            )
        numbers = checked_numbers(f"topic {topic}, field {channel.field}", values, time, source.most_missing)
        columns.append(canonical_series(column, channel, numbers, ~present))
    table = pl.DataFrame([pl.Series("stamp", stamp), *columns, *counters])
    logged_in_order = ((logged[1:] >= logged[:-1]) | (number[1:] != number[:-1])).all()
    advice = "its times cannot be used: record again, or exclude the trial"
    if from_header and logged_in_order:
        advice = "write source: log in the source file, or exclude the trial"
    return in_order(topic, table, number, source.largest_loss, advice)


def counts_of_samples(topic: str, path: str, decoded: Decoded) -> Indices:
    """A device's count of its samples, (n,); refused if a message lacks it, or it is no whole number."""
    values, present = decoded.values[path], decoded.present[path]
    largest = 2.0**53 if values.dtype.kind == "f" else 2**63  # below which a float counts exactly
    wrong = ~present | (values.dtype == bool)
    if values.dtype != bool:
        wrong |= ~(np.abs(values.astype(np.float64)) < largest) | (values != np.rint(values))
    if wrong.any():
        row = int(np.argmax(wrong))
        shown = values[row] if present[row] else "missing"
        raise InputError(
            f"topic '{topic}': counter '{path}' is {shown} in message {row + 1} of {values.size}, and no whole number "
            f"below {largest:.3g}; correct `counter` in the source file, or leave it out"
        )
    return values.astype(np.int64)


LATEST = SECOND  # by which a message may come after one of a later stamp [ns]
EMPTY_TICKS = 0.5  # of the messages that repeat a stamp: more ticks without one are no rounding
SET_BACK = 10  # messages in a row that fall among as many earlier ones
LAST_SECOND = 2**63 // SECOND - 1


def stamp_fields(field: str) -> list[tuple[str, str]]:
    """Paths at which a stamp's seconds and nanoseconds may stand, as ROS 2, protobuf, Foxglove's JSON and ROS 1 do."""
    names = (("sec", "nanosec"), ("seconds", "nanos"), ("sec", "nsec"), ("secs", "nsecs"))
    return [(f"{field}.{seconds}", f"{field}.{nanoseconds}") for seconds, nanoseconds in names]


def stamps_of(topic: str, decoded: Decoded, field: str) -> Indices:
    """Stamps [ns] from the messages' own field, (n,)."""
    present = decoded.present
    named = [pair for pair in stamp_fields(field) if present[pair[0]].any() and present[pair[1]].any()]
    if not named:
        raise InputError(
            f"topic '{topic}' has no field '{field}' with seconds and nanoseconds; correct time.field in the source "
            "file, or write source: log"
        )
    lacking = int((~(present[named[0][0]] & present[named[0][1]])).sum())
    if lacking:
        raise InputError(
            f"topic '{topic}': {lacking} of {decoded.log_time.size} messages have no '{field}'; write source: log"
        )
    whole = []
    for path, most in zip(named[0], (LAST_SECOND, SECOND), strict=True):
        values = decoded.values[path]
        wrong = (np.abs(values.astype(np.float64)) > most) | (values.dtype == bool)
        if values.dtype.kind not in "iu":
            wrong |= values != np.rint(values)
        if wrong.any():
            row = int(np.argmax(wrong))
            raise InputError(
                f"topic '{topic}': {path} is {values[row]} in message {row + 1}, which is not a time; write source: log"
            )
        whole.append(values.astype(np.int64))
    return np.asarray(whole[0] * SECOND + whole[1])


def in_order(
    topic: str, table: pl.DataFrame, channel: NDArray[np.uint16], largest_loss: float, advice: str
) -> tuple[pl.DataFrame, Ordering]:
    """The topic's rows, given channel by channel in the order of recording, sorted by increasing `stamp` [ns].

    `channel` is the number of each row's channel, (n,); `advice` says what to do where the clock was set.
    """
    numbers = np.flatnonzero(np.bincount(channel))
    channels, late = len(numbers), 0
    for number in numbers:
        late += check_not_set(topic, table if channels == 1 else table.filter(channel == number), advice)
    stamp = table["stamp"].to_numpy()
    if (stamp[1:] > stamp[:-1]).all():
        return table, Ordering()
    once = table.group_by("stamp", maintain_order=True).agg(pl.all().drop_nulls().first()).sort("stamp")
    columns = [name for name in table.columns if name != "stamp"]
    beside = table.join(once, on="stamp", how="left", suffix=" kept", maintain_order="left")
    differs = [(pl.col(name) != pl.col(f"{name} kept")).fill_null(value=False) for name in columns]
    contradicted, most = int(beside.select(pl.any_horizontal(differs).sum()).item()), largest_loss * stamp.size
    if channels == 1 and not table.is_duplicated().any() and rounded(stamp):
        return table.sort("stamp", maintain_order=True), Ordering(late)
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
    by = np.maximum.accumulate(stamp) - stamp
    if (by > LATEST).any():
        row = int(np.argmax(by > LATEST))
        raise InputError(
            f"topic {topic}: time goes back by {by[row] / SECOND:.6f} s at message {row + 1} of {stamp.size}; the "
            f"clock was set while recording: {advice}"
        )
    late = by > 0
    if not late.any():
        return 0
    behind = late & ~table.is_duplicated().to_numpy()
    for run in (one for one in runs(behind) if one.stop - one.start >= SET_BACK):
        before, inside = stamp[: run.start], stamp[run]
        if ((before >= inside[0]) & (before <= inside[-1])).sum() >= SET_BACK:
            raise InputError(
                f"topic {topic}: time goes back from {before.max() / SECOND:.6f} s to {inside[0] / SECOND:.6f} s at "
                f"message {run.start + 1} of {stamp.size}, and {len(inside)} messages fall among those before; the "
                f"clock was set while recording: {advice}"
            )
    return int(late.sum())


def joined_on_stamp(tables: Sequence[pl.DataFrame]) -> pl.DataFrame:
    """One table with a row per stamp of any of the tables, which are sorted by it.

    Where stamps are rounded and equal, the tables have rows of their own.
    """
    if len(tables) == 1:
        return tables[0].clone()
    if any((np.diff(table["stamp"].to_numpy()) == 0).any() for table in tables):
        return pl.concat(tables, how="diagonal").sort("stamp", maintain_order=True)
    stamps = [table["stamp"].to_numpy() for table in tables]
    every = np.sort(np.concatenate(stamps), kind="stable")  # a third of the time of `unique`, as each table's rise
    every = every[np.append(True, np.diff(every) != 0)]
    columns = [pl.Series("stamp", every)]
    for table, stamp in zip(tables, stamps, strict=True):
        rows = np.full(every.size, -1)
        rows[np.searchsorted(every, stamp)] = np.arange(stamp.size)
        taken = pl.Series(rows).set(pl.Series(rows < 0), None)
        columns += [column.gather(taken) for column in table.drop("stamp")]
    return pl.DataFrame(columns)
