"""A log of messages by topic, in MCAP or a bag of ROS: its source file, and the canonical columns that it asks for."""

from collections import Counter, defaultdict
from collections.abc import Collection
from typing import Any, Literal

import numpy as np
import polars as pl
from pydantic import Field

from osl_analysis.columns import counter_column, unit_of
from osl_analysis.errors import InputError
from osl_analysis.formats.mcap.limits import RefusedFileError, WrongFieldError
from osl_analysis.formats.mcap.topics import Decoded, decode_topics
from osl_analysis.formats.message_file import MessageFile
from osl_analysis.formats.messages.leaves import Indices
from osl_analysis.ingest.joined_topics import joined_on_stamp
from osl_analysis.ingest.message_values import absent_values, counts_of, physical_values
from osl_analysis.ingest.recording import Recording, check_values
from osl_analysis.ingest.source_fields import Conversion, LogSource, Stamps
from osl_analysis.ingest.stamps import SECOND, Ordering, in_order, log_times_of, stamp_fields, stamps_of
from osl_analysis.ingest.units import Unit
from osl_analysis.trial import Array
from osl_analysis.yaml_settings import Settings

LOG_TIME = "write source: log in the source file, or exclude the trial"
NO_OTHER_CLOCK = "its times cannot be used: record again, or exclude the trial"


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


def read_message_log(file: MessageFile, source: MessageSource) -> Recording:
    """The columns that the source file maps, in SI units; time [s] counts from the first stamp.

    Topics with different stamps have rows of their own, null in the columns of the other topics. Nothing is
    interpolated or held. The losses of the file are in the facts under `damage` (`damage.py`).

    Raises
    ------
    InputError
        The file unpacks to too much, a topic or field is missing or has no messages, its encoding or
        schema cannot be read, a larger share of a topic than `source.largest_loss` is lost, a value is infinite, too
        many values are NaN, or stamps are missing, contradict each other or go back (`stamps.py`).
    """
    by_topic: dict[str, dict[str, LogChannel]] = defaultdict(dict)
    for column, channel in source.channels.items():
        by_topic[channel.topic][column] = channel
    path = file.path
    try:
        tables, how, absent = read_topics(file, by_topic, source)
    except InputError as error:
        if str(path) in str(error):
            raise
        raise InputError(f"{path}: {error}") from error
    orders = {topic: order for topic, (_, order) in tables.items()}
    rates = {topic: median_rate(table["stamp"].to_numpy()) for topic, (table, _) in tables.items()}
    joined = joined_on_stamp([tables.pop(topic)[0] for topic in orders])
    missing = {column: int(joined[column].is_nan().sum()) for column in source.channels}
    start = int(joined["stamp"][0])
    time = ((joined.drop_in_place("stamp") - start) / SECOND).alias("time")
    facts = {
        "time": {**source.time.origin(), "start_ns": start},
        "rates_hz": rates,
        "decoding": how,
        "stamps": {topic: order.report() for topic, order in orders.items()},
        "missing": missing,
        "damage": file.damage.report(channels_of(file, by_topic)),
    }
    columns = {column: channel.origin(column) for column, channel in source.channels.items()}
    says = [text for topic, order in orders.items() for text in order.says(topic)]
    nan = [f"{column} is NaN in {n} of {len(joined)} rows" for column, n in missing.items() if n]
    remarks = [*file.damage.all_remarks(), *says, *absent, *nan]
    samples = pl.DataFrame([time, *joined])
    try:
        return Recording(samples, columns, facts, [f"{path.name}: {remark}" for remark in remarks])
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def read_topics(
    file: MessageFile, by_topic: dict[str, dict[str, LogChannel]], source: MessageSource
) -> tuple[dict[str, tuple[pl.DataFrame, Ordering]], dict[str, Any], list[str]]:
    """By topic the table with its order, and how it was decoded; and remarks on values that are absent.

    Each topic is released as soon as its table stands, so that a long log is in memory once.
    """
    decoded = decode_wanted(file, by_topic, source)
    tables: dict[str, tuple[pl.DataFrame, Ordering]] = {}
    how: dict[str, Any] = {}
    absent: list[str] = []
    for topic in list(decoded):
        one = decoded.pop(topic)
        how[topic] = one.how
        absent += absent_values(topic, [channel.field for channel in by_topic[topic].values()], one)
        tables[topic] = read_topic(topic, by_topic[topic], one, source)
        del one
    return tables, how, absent


def decode_wanted(
    file: MessageFile, by_topic: dict[str, dict[str, LogChannel]], source: MessageSource
) -> dict[str, Decoded]:
    """The fields of each topic and of its stamp; a file that has lost too much is refused."""
    stamps = [name for pair in stamp_fields(source.time.field) for name in pair]
    from_header = source.time.source == "header"
    wanted = {
        topic: [*dict.fromkeys([*(stamps if from_header else []), *(f for c in channels.values() for f in c.fields)])]
        for topic, channels in by_topic.items()
    }
    try:
        decoded = decode_topics(file, wanted, either=stamps)
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


def channels_of(file: MessageFile, topics: Collection[str]) -> dict[str, Collection[int]]:
    """Numbers of the channels of each topic, of a file that has been read."""
    declared = file.declared.channels.values()
    return {topic: [channel.id for channel in declared if channel.topic == topic] for topic in topics}


def check_loss(file: MessageFile, topics: Collection[str], most: float) -> None:
    """Refuse a file that has lost a larger share of a topic than allowed."""
    for topic, channels in channels_of(file, topics).items():
        share = file.damage.share_lost(channels or None)
        if share > most:
            misfits = sum(file.damage.misfits[channel] for channel in channels)
            is_whole = misfits == file.damage.messages_lost(channels)
            what = "messages that cannot be used" if is_whole else f"damaged or incomplete {file.kind}"
            raise InputError(
                f"{what}: {100 * share:.3g} % of topic '{topic}' is lost, at most "
                f"{100 * most:.3g} % may be (largest_loss in the source file): "
                f"{'; '.join(file.damage.all_remarks())}; record again"
                f"{', or map another field' * is_whole}"
            )


def read_topic(
    topic: str, channels: dict[str, LogChannel], decoded: Decoded, source: MessageSource
) -> tuple[pl.DataFrame, Ordering]:
    """Stamps [ns] and columns of one topic in the order of the stamps, and counts of the sorting.

    A field is taken out of the values once its last column stands.
    """
    from_header = source.time.source == "header"
    stamp = stamps_of(topic, decoded, source.time.field) if from_header else log_times_of(topic, decoded)
    counters = [
        pl.Series(counter_column(column), counts_of(topic, channel.counter, decoded))
        for column, channel in channels.items()
        if channel.counter is not None
    ]
    columns, time = [pl.Series("stamp", stamp)], (stamp - stamp[0]) / SECOND
    del stamp
    waiting = Counter(channel.field for channel in channels.values())
    for path in decoded.values.keys() - waiting.keys():
        del decoded.values[path]
    for column, channel in channels.items():
        columns.append(canonical_series(column, channel, decoded, time, source.most_missing))
        waiting[channel.field] -= 1
        if not waiting[channel.field]:
            del decoded.values[channel.field]
    del time
    table = pl.DataFrame([*columns, *counters])
    logged, number = decoded.log_time, decoded.channel
    logged_in_order = (logged[1:] >= logged[:-1]) | (number[1:] != number[:-1])
    advice = LOG_TIME if from_header and logged_in_order.all() else NO_OTHER_CLOCK
    return in_order(topic, table, decoded.channel, source.largest_loss, advice)


def canonical_series(column: str, channel: LogChannel, decoded: Decoded, time: Array, most_missing: float) -> pl.Series:
    """One column in SI units; null where a message lacks the field, NaN where its value is."""
    raw = physical_values(channel.topic, channel.field, decoded, unit_of(column))
    check_values(f"topic {channel.topic}, field {channel.field}", raw, time, most_missing)
    series = pl.Series(column, channel.to_si(raw, unit_of(column)))
    present = decoded.present[channel.field]
    return series if present.all() else series.set(pl.Series(~present), None)


def median_rate(stamp: Indices) -> float | None:
    """Median rate [Hz] of stamps [ns]; None for a single one."""
    return float(SECOND / np.median(np.diff(stamp))) if stamp.size > 1 else None
