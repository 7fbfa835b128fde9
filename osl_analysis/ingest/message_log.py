"""Logs of messages by topic, in MCAP or a bag of ROS: their source files, and the columns that these ask for."""

from collections import defaultdict
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
import polars as pl
from pydantic import Field

from osl_analysis.columns import counter_column, unit_of
from osl_analysis.errors import InputError
from osl_analysis.formats.mcap import read_mcap
from osl_analysis.formats.messages import Decoded, MessageFile, RefusedFileError, WrongFieldError, decode_topics
from osl_analysis.formats.object_messages import Indices
from osl_analysis.formats.rosbag import read_rosbag1, read_rosbag2, siblings
from osl_analysis.ingest.recording import Recording, check_values
from osl_analysis.ingest.source_fields import Conversion, LogSource, Stamps
from osl_analysis.ingest.stamps import SECOND, Ordering, in_order, log_times_of, stamp_fields, stamps_of
from osl_analysis.ingest.units import Unit
from osl_analysis.trial import Array
from osl_analysis.yaml_settings import Settings

LOG_TIME = "write source: log in the source file, or exclude the trial"
NO_OTHER_CLOCK = "its times cannot be used: record again, or exclude the trial"
LEVEL = "V"
"""Unit of the columns that may be read from truth values: levels of `sync` and `trigger`."""
EXACT = 2.0**53
"""Size below which a float64 counts exactly."""


class LogChannel(Conversion):
    """One field of one topic."""

    topic: str
    """Name of the topic."""
    field: str
    """Dotted path of the field, with an index or a name where it passes an array: `wrench.force.x`, `position[0]`,
    `position[name=ankle]`."""
    unit: Unit
    """Unit of the field; messages state none."""
    counter: str | None = None
    """Path of the field in which the device counts its samples, such as `seq`. It tells which samples are missing."""

    @property
    def fields(self) -> list[str]:
        """Paths of the fields to read."""
        return [self.field] if self.counter is None else [self.field, self.counter]


class TimeSource(Settings):
    """Where the time of a message comes from."""

    source: Literal["header", "log"]
    """`header`: the stamp in the message. `log`: when the recorder logged it."""
    field: str = "header.stamp"
    """Path of the stamp in the message."""
    stamps: Stamps = "auto"
    """How the stamps are taken."""

    def origin(self) -> dict[str, str]:
        """Source and use of the stamps, for the trial's provenance."""
        return {"source": self.source if self.source == "log" else self.field, "stamps": self.stamps}


class MessageSource(LogSource):
    """A log of messages."""

    time: TimeSource
    """Where the time of a message comes from."""
    largest_loss: float = Field(default=0.01, ge=0.0, le=1.0)
    """Largest share of a topic's messages that may be lost; a log that has lost more is refused."""
    most_missing: float = Field(default=0.01, ge=0.0, le=1.0)
    """Largest share of a field's values that may be NaN: readings that failed. More where a field has a lower rate."""
    channels: dict[str, LogChannel] = Field(min_length=1)
    """The field of each canonical column."""


class McapSource(MessageSource):
    """A log in MCAP."""

    format: Literal["mcap"]
    """Format of the file."""


class Rosbag1Source(MessageSource):
    """A log in a bag of ROS 1, or in the bags of a split recording, whose folder is named."""

    format: Literal["rosbag1"]
    """Format of the file or folder."""


class Rosbag2Source(MessageSource):
    """A log in a bag of ROS 2: a database of sqlite3, or the folder of a recording with its `metadata.yaml`."""

    format: Literal["rosbag2"]
    """Format of the file or folder."""


def read_mcap_log(path: Path, source: McapSource) -> Recording:
    """The columns that the source file maps, in SI units; raises InputError as `read_mcap`, `read_message_log`."""
    file = read_mcap(path)
    remark = siblings(path)[1]
    if remark:
        file.damage.remark(remark)
    return read_message_log(file, source)


def read_rosbag1_log(path: Path, source: Rosbag1Source) -> Recording:
    """The same for a bag of ROS 1; raises InputError as `read_rosbag1`, `read_message_log`."""
    return read_message_log(read_rosbag1(path), source)


def read_rosbag2_log(path: Path, source: Rosbag2Source) -> Recording:
    """The same for a bag of ROS 2; raises InputError as `read_rosbag2`, `read_message_log`."""
    return read_message_log(read_rosbag2(path), source)


def read_message_log(file: MessageFile, source: MessageSource) -> Recording:
    """The columns that the source file maps, in SI units; time [s] counts from the first stamp.

    Topics with different stamps have rows of their own, null in the columns of the other topics. Nothing is
    interpolated or held. The losses of the file are in the facts under `damage` (`formats/messages.py`).
    Refused is what cannot be decoded, a loss above `source.largest_loss`, a value that is infinite, and stamps that
    contradict each other or go back (`stamps.py`).
    """
    by_topic: dict[str, dict[str, LogChannel]] = defaultdict(dict)
    for column, channel in source.channels.items():
        by_topic[channel.topic][column] = channel
    path = file.path
    try:
        decoded = decode_wanted(file, by_topic, source)
        tables = {topic: read_topic(topic, by_topic[topic], decoded[topic], source) for topic in decoded}
    except InputError as error:
        if str(path) in str(error):
            raise
        raise InputError(f"{path}: {error}") from error
    joined = joined_on_stamp([table for table, _ in tables.values()])
    missing = {column: int(joined[column].is_nan().sum()) for column in source.channels}
    start = int(joined["stamp"][0])
    time = ((joined.drop_in_place("stamp") - start) / SECOND).alias("time")
    facts = {
        "time": {**source.time.origin(), "start_ns": start},
        "rates_hz": {topic: median_rate(table["stamp"].to_numpy()) for topic, (table, _) in tables.items()},
        "decoding": {topic: one.how for topic, one in decoded.items()},
        "stamps": {topic: order.report() for topic, (_, order) in tables.items()},
        "missing": missing,
        "damage": file.damage.report({topic: file.channels_of(topic) for topic in by_topic}),
    }
    columns = {column: channel.origin(column) for column, channel in source.channels.items()}
    remarks = file.damage.all_remarks()
    remarks += [text for topic, (_, order) in tables.items() for text in order.says(topic)]
    remarks += [text for topic, one in decoded.items() for text in absent_values(topic, by_topic[topic], one)]
    remarks += [f"{column} is NaN in {n} of {len(joined)} rows" for column, n in missing.items() if n]
    try:
        samples = pl.DataFrame([time, *joined])
        return Recording(samples, columns, facts, [f"{path.name}: {remark}" for remark in remarks])
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def decode_wanted(
    file: MessageFile, by_topic: dict[str, dict[str, LogChannel]], source: MessageSource
) -> dict[str, Decoded]:
    """The fields of each topic and of its stamp; a file that has lost too much is refused."""
    stamps = [name for pair in stamp_fields(source.time.field) for name in pair]
    first = stamps if source.time.source == "header" else []
    wanted = {
        topic: [*dict.fromkeys([*first, *(path for channel in channels.values() for path in channel.fields)])]
        for topic, channels in by_topic.items()
    }
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


def read_topic(
    topic: str, channels: dict[str, LogChannel], decoded: Decoded, source: MessageSource
) -> tuple[pl.DataFrame, Ordering]:
    """Stamps [ns] and columns of one topic in the order of the stamps, and counts of the sorting."""
    from_header = source.time.source == "header"
    stamp = stamps_of(topic, decoded, source.time.field) if from_header else log_times_of(topic, decoded)
    counters = [
        pl.Series(counter_column(column), counts_of(topic, channel.counter, decoded))
        for column, channel in channels.items()
        if channel.counter is not None
    ]
    time = (stamp - stamp[0]) / SECOND
    columns = [
        canonical_series(column, channel, decoded, time, source.most_missing) for column, channel in channels.items()
    ]
    table = pl.DataFrame([pl.Series("stamp", stamp), *columns, *counters])
    logged, number = decoded.log_time, decoded.channel
    logged_in_order = (logged[1:] >= logged[:-1]) | (number[1:] != number[:-1])
    advice = LOG_TIME if from_header and logged_in_order.all() else NO_OTHER_CLOCK
    return in_order(topic, table, decoded.channel, source.largest_loss, advice)


def canonical_series(column: str, channel: LogChannel, decoded: Decoded, time: Array, most_missing: float) -> pl.Series:
    """One column in SI units; null where a message lacks the field, NaN where its value is."""
    values, present, unit = decoded.values[channel.field], decoded.present[channel.field], unit_of(column)
    if values.dtype == bool and unit != LEVEL:
        row = int(np.argmax(present))
        raise WrongFieldError(
            f"topic '{channel.topic}': field '{channel.field}' is {str(bool(values[row])).lower()} in message "
            f"{row + 1}, a truth value and no number in {unit}; name a number as `field` in the source file"
        )
    with np.errstate(invalid="ignore"):  # a signalling NaN is one, too
        raw = values.astype(np.float64)
    check_values(f"topic {channel.topic}, field {channel.field}", raw, time, most_missing)
    series = pl.Series(column, channel.to_si(raw, unit))
    return series if present.all() else series.set(pl.Series(~present), None)


def counts_of(topic: str, path: str, decoded: Decoded) -> Indices:
    """A device's count of its samples, (n,); refused if a message lacks it, or it is no whole number."""
    values, present = decoded.values[path], decoded.present[path]
    largest = EXACT if values.dtype.kind == "f" else 2**63
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


def absent_values(topic: str, channels: dict[str, LogChannel], decoded: Decoded) -> list[str]:
    """A warning for each field that some messages lack."""
    present = {channel.field: decoded.present[channel.field] for channel in channels.values()}
    return [
        f"topic '{topic}': {int((~one).sum())} of {one.size} messages have no value in field '{path}', first message "
        f"{int(np.argmin(one)) + 1}"
        for path, one in present.items()
        if not one.all()
    ]


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


def median_rate(stamp: Indices) -> float | None:
    """Median rate [Hz] of stamps [ns]; None for a single one."""
    return float(SECOND / np.median(np.diff(stamp))) if stamp.size > 1 else None
