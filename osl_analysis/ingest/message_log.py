"""Logs of messages by topic, in MCAP or a bag of ROS, as canonical columns."""

from collections import defaultdict
from collections.abc import Callable, Collection, Mapping
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.formats.mcap import read_mcap
from osl_analysis.formats.message_fields import Indices
from osl_analysis.formats.messages import Decoded, MessageFile, RefusedFileError, WrongFieldError, decode_topics
from osl_analysis.formats.rosbag import read_rosbag1, read_rosbag2, siblings
from osl_analysis.ingest.recording import LEVEL, Recording, canonical_series, checked_numbers
from osl_analysis.ingest.source import Channel, Source
from osl_analysis.ingest.stamps import (
    SECOND,
    Ordering,
    in_order,
    joined_on_stamp,
    log_times_of,
    stamp_fields,
    stamps_of,
)
from osl_analysis.trial import Array, counter_column, unit_of

LOG_TIME = "write source: log in the source file, or exclude the trial"
NO_OTHER_CLOCK = "its times cannot be used: record again, or exclude the trial"
EXACT = 2.0**53
"""Size below which a float64 counts exactly."""
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
    contradict each other or go back (`stamps.py`).
    """
    file = FILES[source.format](path)
    if source.format == "mcap" and (remark := siblings(path)[1]):
        file.damage.remark(remark)
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
        "rates_hz": {topic: median_rate(table["stamp"].to_numpy()) for topic, (table, _) in tables.items()},
        "decoding": {topic: one.how for topic, one in decoded.items()},
        "stamps": {topic: order.report() for topic, (_, order) in tables.items()},
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


def read_topic(
    topic: str, channels: Mapping[str, Channel], decoded: Decoded, source: Source
) -> tuple[pl.DataFrame, Ordering]:
    """Stamps [ns] and columns of one topic in the order of the stamps, and counts of the sorting."""
    from_header = source.time.source == "header"
    stamp = stamps_of(topic, decoded, str(source.time.field)) if from_header else log_times_of(topic, decoded)
    counters = [
        pl.Series(counter_column(column), counts_of(topic, channel.counter, decoded))
        for column, channel in channels.items()
        if channel.counter
    ]
    time = (stamp - stamp[0]) / SECOND
    columns = [series_of(column, channel, decoded, time, source.most_missing) for column, channel in channels.items()]
    table = pl.DataFrame([pl.Series("stamp", stamp), *columns, *counters])
    logged, number = decoded.log_time, decoded.channel
    logged_in_order = (logged[1:] >= logged[:-1]) | (number[1:] != number[:-1])
    advice = LOG_TIME if from_header and logged_in_order.all() else NO_OTHER_CLOCK
    return in_order(topic, table, decoded.channel, source.largest_loss, advice)


def series_of(column: str, channel: Channel, decoded: Decoded, time: Array, most_missing: float) -> pl.Series:
    """One column in SI units; null where a message lacks the field, NaN where its value is."""
    values, present, unit = decoded.values[channel.field], decoded.present[channel.field], unit_of(column)
    if values.dtype == bool and unit != LEVEL:
        row = int(np.argmax(present))
        raise WrongFieldError(
            f"topic '{channel.topic}': field '{channel.field}' is {str(bool(values[row])).lower()} in message "
            f"{row + 1}, a truth value and no number in {unit}; name a number as `field` in the source file"
        )
    numbers = checked_numbers(f"topic {channel.topic}, field {channel.field}", values, time, most_missing)
    return canonical_series(column, channel, numbers, ~present)


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


def median_rate(stamp: Indices) -> float | None:
    """Median rate [Hz] of stamps [ns]; None for a single one."""
    return float(SECOND / np.median(np.diff(stamp))) if stamp.size > 1 else None
